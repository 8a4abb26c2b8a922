"""Commands, from typed settings to a run folder: compute, write the typed result, then show it.

    loading    data and their split
    fitting    fits that several commands make
    record     TensorBoard, card and figures of a result
    train      one model from one random subset
    evaluate   laws, learned models and bounds; `curves` has the learning curves
    transfer   a trained model on other bodies
    diagnose   the missing effects
    trained    checks of models from checkpoints
    impacts    recordings to a table of impacts
    init       settings of a user's measurements in a file

A run folder holds the configuration (`.hydra/`), results.json or diagnosis.json, tables, figures as PNG and PDF,
metrics.jsonl and TensorBoard's events.
"""

from collections.abc import Callable, Mapping
from typing import Any

from contactlearn.cli.commands import diagnose, evaluate, train
from contactlearn.cli.job import Run

COMMANDS: Mapping[str, Callable[[Any, Run], None]] = {
    "train": train.train,
    "evaluate": evaluate.evaluate,
    "diagnose": diagnose.diagnose,
}
"""By name: each takes the settings of its name, and runs in a folder."""
