"""What a run can afford: memory and disk are estimated before a long step, which then takes the smaller road."""

import shutil
from pathlib import Path

from omegaconf import DictConfig, OmegaConf

from contactlearn.cli.sweeps.resources import GIB, available_memory
from contactlearn.core.errors import ContactLearnError
from contactlearn.report import terminal

FITTED = 20_000
"""Trials that laws and effects are fitted to, and subsets are drawn from: a random sample of a larger pool."""
MEMORY_PER_BYTE = 10.0
"""Bytes of memory that reading a whole table takes for each byte of its file."""
_TRAINED = 4000.0  # bytes of memory a training trial: measurements, features and sums of three sparse processes
_WRITTEN = 110.0  # bytes on disk a prediction of one model


def lower_train_size(cfg: DictConfig) -> None:
    """Lower `train.size`, where it is given, to what memory allows, and say so."""
    asked, free = cfg.train.size, available_memory()
    if asked is not None and free is not None and asked * _TRAINED > free / 2:
        most = int(free / 2 / _TRAINED)
        terminal.say(
            f"train.size={asked} would take about {asked * _TRAINED / GIB:.1f} GiB of memory, and {free / GIB:.1f} are "
            f"free: {most} trials are used"
        )
        OmegaConf.update(cfg, "train.size", most)


def refuse_too_large(needed: float, why: str) -> None:
    """Refuse what has no smaller road.

    Raises:
        ContactLearnError: more bytes are needed than there is memory.
    """
    free = available_memory()
    if free is not None and needed > free:
        raise ContactLearnError(
            f"{why}, which takes about {needed / GIB:.1f} GiB of memory, and {free / GIB:.1f} are free; correct the "
            "table itself, or take a part of it"
        )


def fits_on_disk(folder: Path, predictions: int) -> bool:
    """Whether tables of so many predictions have room in a folder; if not, say what is written instead."""
    needed, free = predictions * _WRITTEN, shutil.disk_usage(folder).free
    if needed > free / 2:
        terminal.say(
            f"{predictions} predictions would take about {needed / GIB:.1f} GiB on disk, and {free / GIB:.1f} are "
            "free: those of the trials that the page shows are written"
        )
    return needed <= free / 2
