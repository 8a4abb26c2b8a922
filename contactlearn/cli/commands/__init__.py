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
from functools import partial

from omegaconf import DictConfig

from contactlearn.cli.commands import diagnose, evaluate, train
from contactlearn.cli.job import Run
from contactlearn.cli.settings import DiagnoseSettings, EvaluateSettings, TrainSettings

COMMANDS: Mapping[str, Callable[[DictConfig], Callable[[Run], None]]] = {
    "train": lambda cfg: partial(train.train, TrainSettings.from_config(cfg)),
    "evaluate": lambda cfg: partial(evaluate.evaluate, EvaluateSettings.from_config(cfg)),
    "diagnose": lambda cfg: partial(diagnose.diagnose, DiagnoseSettings.from_config(cfg)),
}
"""By name: each parses a composed configuration, and returns what runs in a folder."""
