"""Commands, from a composed configuration to a run folder: compute, write the typed result, then show it.

    plain      a configuration's parts as plain values
    settings   checks of a configuration, and the laws, effects and models that it names
    loading    data and their split
    fitting    fits that several commands ask for
    results    fits as the types of `contactlearn.results`, the run folder and provenance
    record     TensorBoard, card and figures of a result
    train      one model from one random subset
    evaluate   laws and learned models beside the bounds; `curves` has the learning curves
    transfer   a trained model on other bodies
    diagnose   the missing effects
    audit      mistakes in the measurements alone

A run folder holds the configuration (`.hydra/`), results.json or diagnosis.json, tables, figures as PNG and PDF,
metrics.jsonl and TensorBoard's events.  These modules alone know the configuration's shape.
"""

from contactlearn.cli.commands.diagnose import diagnose
from contactlearn.cli.commands.evaluate import evaluate
from contactlearn.cli.commands.loading import load_data
from contactlearn.cli.commands.train import train

__all__ = ["diagnose", "evaluate", "load_data", "train"]
