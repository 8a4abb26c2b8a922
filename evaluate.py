"""The command evaluate from a checkout; see `python evaluate.py --help`."""

from contactlearn.cli import evaluate

if __name__ == "__main__":
    evaluate()
