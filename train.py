"""The command train from a checkout; see `python train.py --help`."""

from contactlearn.cli.hydra_main import train

if __name__ == "__main__":
    train()
