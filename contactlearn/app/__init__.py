"""What the commands do, from a composed configuration to a run folder.

    train      one model from one random subset
    evaluate   laws and learned models beside the bounds; learning curves
    transfer   a trained model on other bodies
    diagnose   what is wrong with the data, and which effect is missing
    run        what they share: data, splits, errors, files

A run folder holds the configuration (`.hydra/`), results.json, the tables, the figures as PNG and
PDF, metrics.jsonl and TensorBoard's events.  These modules alone know the configuration's shape.
"""

from contactlearn.app.diagnose import diagnose
from contactlearn.app.evaluate import evaluate
from contactlearn.app.record import load_data
from contactlearn.app.train import train

__all__ = ["diagnose", "evaluate", "load_data", "train"]
