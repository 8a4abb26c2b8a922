"""The command evaluate from a checkout; see `python evaluate.py --help`."""

from contactlearn.cli.hydra_main import evaluate

if __name__ == "__main__":
    evaluate()
