"""The command diagnose from a checkout; see `python diagnose.py --help`."""

from contactlearn.cli.hydra_main import diagnose

if __name__ == "__main__":
    diagnose()
