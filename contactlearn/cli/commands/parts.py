"""Where a long run keeps its finished parts until all is done, so that the same command goes on behind them."""

import shutil
from pathlib import Path
from typing import cast

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from contactlearn.cli.commands.results import run_folder
from contactlearn.cli.sweeps.identity import job_identity


def parts_folder(cfg: DictConfig) -> Path:
    """Return the folder of the parts of this run, known by what its result depends on.

    It is beside the folder of the run, since the same command later has another one, unless that has a given name.
    """
    hydra, folder = cast(DictConfig, HydraConfig.get()), run_folder()
    named = any(word.startswith("hydra.run.dir=") for word in hydra.overrides.hydra)
    return (folder if named else folder.parent) / ".parts" / job_identity(cfg, hydra).job


def forget(parts: Path) -> None:
    """Remove the parts of a run, and the folder above theirs if nothing else is in it."""
    shutil.rmtree(parts, ignore_errors=True)
    if parts.parent.is_dir() and not any(parts.parent.iterdir()):
        parts.parent.rmdir()
