"""Data of a run: the `data` part of a configuration as impacts, and their split."""

from dataclasses import dataclass
from importlib import import_module
from inspect import signature
from pathlib import Path
from pkgutil import iter_modules
from typing import Any

import torch
from omegaconf import DictConfig, OmegaConf, flag_override

from contactlearn import data
from contactlearn.app.plain import plain_values
from contactlearn.audit.corrections import correct
from contactlearn.audit.findings import quick_audit
from contactlearn.data.table import Table
from contactlearn.data.tracks import Tracked
from contactlearn.errors import ContactLearnError, DataError, suggest
from contactlearn.impacts import Impacts
from contactlearn.report.audit import show_columns, show_mistakes
from contactlearn.report.page.recordings import RECORDINGS, SOURCES, write_recordings_page

_TABLE = "contactlearn.data.table.load"
_USUAL = 120  # training trials of a subset where as many are there: the paper's number


@dataclass(frozen=True, kw_only=True)
class Split:
    """Impacts of a run: all, the pool to fit to, and the held-out trials; and the run's random source."""

    impacts: Impacts
    pool: Impacts
    test: Impacts
    generator: torch.Generator


def load_data(cfg: DictConfig, suspect: bool = False, folder: Path | None = None) -> Impacts:
    """Load the `data` part of a configuration as impacts, corrected; nothing but this package's own sources is run.

    Columns of a table that are not used, and fields that were computed, are printed.  With `suspect` a table is read,
    and stays, without the rule that contacts approach the floor: for the audit.  Recordings leave recordings.html in
    the folder, if one is given.

    Raises:
        ContactLearnError: a setting that the source does not have, or a correction that does not exist.
        DataError: the source's own.
    """
    source = cfg.copy()  # it still knows its place in the whole, which messages name
    with flag_override(source, ["struct", "readonly"], False):
        names = source.pop("correct", None) or []
    if isinstance(names, str):
        raise ContactLearnError(f"data.correct must be a list of names, such as [{names}], got {names!r}")
    impacts, computed = _read(source, list(names), folder, suspect=suspect)
    return correct(impacts, list(names), computed_contact="r" in computed).replace(suspect=suspect)


def _read(cfg: DictConfig, names: list[str], folder: Path | None, *, suspect: bool) -> tuple[Impacts, tuple[str, ...]]:
    """The impacts of a source before the named corrections, and those of their fields that were computed.

    A table that is to be corrected may be suspect, and recordings leave a page in the folder.
    """
    target = str(cfg.get("_target_", ""))
    if target not in _sources():
        raise ContactLearnError(f"data._target_ must be a source under contactlearn.data, got {target!r}")
    for missing in sorted(OmegaConf.missing_keys(cfg)):
        raise ContactLearnError(f"{missing} must be given: {missing}=…; see configs/data")
    settings = {name: value for name, value in plain_values(cfg).items() if name != "_target_"}
    if target == _TABLE:
        lenient = {"suspect": suspect or bool(names), "drop_incomplete": "drop_incomplete" in names}
        table: Table = _made(target, "read", settings | lenient)
        show_columns(table.unused, table.computed)
        return table.impacts, table.computed
    if target not in SOURCES:
        return _made(target, "load", settings), ()
    found: Tracked = _made(target, "find", settings)
    if folder is not None:
        write_recordings_page(folder / RECORDINGS, found)
    return found.impacts, ()


def _sources() -> list[str]:
    """The sources of this package, as a configuration names them."""
    return [f"{data.__name__}.{module.name}.load" for module in iter_modules(data.__path__)]


def _made(target: str, function: str, settings: dict[str, Any]) -> Any:
    """What a function of a source returns; settings are data, whatever they look like."""
    source = import_module(target.removesuffix(".load"))
    try:
        return getattr(source, function)(**settings)
    except ContactLearnError:
        raise
    except (TypeError, ValueError, OverflowError) as error:  # a setting that it does not have, or of another kind
        known = signature(source.load).parameters
        meant = next((suggest(key, known) for key in settings if key not in known), "")
        raise ContactLearnError(f"{target}: {' '.join(str(error).split())}{meant}") from error


def split(cfg: DictConfig, folder: Path | None = None) -> Split:
    """Load the data, say what a quick audit doubts, and hold out a share `test`; recordings leave recordings.html.

    `train.size` is set where it was left open.

    Raises:
        DataError: fewer trials than `train.size`, or an outcome at rest, to which no error is relative.
    """
    impacts = load_data(cfg.data, folder=folder)
    show_mistakes(quick_audit(impacts), cfg.data.get("correct") or ())
    generator = torch.Generator().manual_seed(cfg.seed)
    pool, test = impacts.split(cfg.test, generator)
    if cfg.train.size is None:
        cfg.train.size = max(1, min(_USUAL, 4 * len(pool) // 5))
    if len(pool) < cfg.train.size:
        raise DataError(
            f"{impacts.source}: train.size={cfg.train.size}, but {len(pool)} of {len(impacts)} trials are left to "
            f"draw from after holding out a share test={cfg.test}; use train.size={len(pool)} or less"
        )
    at_rest = (test.v_post[:, :2] == 0).all(1).nonzero()[:, 0].tolist()
    if at_rest:
        raise DataError(
            f"{impacts.source}: errors are relative to the outcome, which must not be at rest; trial "
            f"{test.trial[at_rest[0]]!r} has vx_post = vy_post = 0: leave it out"
        )
    return Split(impacts=impacts, pool=pool, test=test, generator=generator)
