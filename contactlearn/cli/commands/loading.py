"""Data of a run: the `data` part of a configuration as impacts, and their split.

Tables of more than `LARGE` rows are read in blocks.  What is computed trial by trial goes over all of them; what is
fitted, drawn or shown has a random sample in memory, see docs/large-data.md.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from inspect import signature
from pathlib import Path
from pkgutil import iter_modules
from typing import Any

import torch
from jaxtyping import Bool
from omegaconf import DictConfig, OmegaConf, flag_override
from torch import Tensor

from contactlearn import data, simulation
from contactlearn.cli.commands.means import FITTED, MEMORY_PER_BYTE, refuse_too_large
from contactlearn.cli.commands.plain import plain_values
from contactlearn.core.devices import described
from contactlearn.core.errors import ContactLearnError, DataError, suggest
from contactlearn.core.numerics import random_share
from contactlearn.data.audit.corrections import CORRECTIONS, correct
from contactlearn.data.audit.findings import quick_audit
from contactlearn.data.blocks import BLOCK, Blocks, sampled
from contactlearn.data.table import Table, blocks_of, is_large
from contactlearn.data.tracks import Tracked
from contactlearn.diagnosis.events import OnEvent, TaskProgress
from contactlearn.inference.evaluation.sums import refuse_rest
from contactlearn.mechanics.impacts import Impacts
from contactlearn.report import terminal
from contactlearn.report.audit import show_columns, show_mistakes
from contactlearn.report.page.recordings import RECORDINGS, SOURCES, write_recordings_page
from contactlearn.results.held_out import SHOWN

_TABLE = "contactlearn.data.table.load"
_USUAL = 120  # training trials of a subset where as many are there: the paper's number


@dataclass(frozen=True, kw_only=True)
class Split:
    """Impacts of a run.

    Args:
        blocks: all of them.
        held_out: which of them no model may be made from.
        impacts: those in memory, which are all if they are few: pool and test.
        pool: to fit to.
        test: held out, to draw and to show.
        generator: the run's random source.
    """

    blocks: Blocks
    held_out: Bool[Tensor, " n"]
    impacts: Impacts
    pool: Impacts
    test: Impacts
    generator: torch.Generator

    @property
    def unseen_trials(self) -> int:
        """Number of all trials that are held out."""
        return int(self.held_out.sum())

    def unseen(self) -> Iterator[Impacts]:
        """Yield all trials that are held out, in blocks."""
        return iter((self.test,)) if len(self.test) == self.unseen_trials else self.blocks.where(self.held_out)


def load_data(cfg: DictConfig, validate: bool = True, folder: Path | None = None) -> Impacts:
    """Load the `data` part of a configuration as impacts, corrected; nothing but this package's own sources is run.

    Columns of a table that are not used, and fields that were computed, are printed.  Without `validate` a table
    is read, and stays, without the rule that contacts approach the floor: for the audit.  Recordings leave
    recordings.html in the folder, if one is given.

    Raises:
        ContactLearnError: a setting that the source does not have, or a correction that does not exist.
        DataError: the source's own.
    """
    source, names = _source_and_corrections(cfg)
    impacts, computed = _read(source, names, folder, validate=validate)
    return correct(impacts, names, computed_contact="r" in computed).replace(validate=validate)


def _source_and_corrections(cfg: DictConfig) -> tuple[DictConfig, list[str]]:
    """The settings of a source alone, and the names of corrections that stand among them."""
    source = cfg.copy()  # it still knows its place in the whole, which messages name
    with flag_override(source, ["struct", "readonly"], False):
        names = source.pop("correct", None) or []
    if isinstance(names, str):
        raise ContactLearnError(f"data.correct must be a list of names, such as [{names}], got {names!r}")
    return source, list(names)


def _read(cfg: DictConfig, names: list[str], folder: Path | None, *, validate: bool) -> tuple[Impacts, tuple[str, ...]]:
    """The impacts of a source before the named corrections, and those of their fields that were computed.

    A table that is to be corrected need not be valid, and recordings leave a page in the folder.
    """
    target = str(cfg.get("_target_", ""))
    if target not in _sources():
        raise ContactLearnError(
            f"data._target_ must be a source under contactlearn.data or contactlearn.simulation, got {target!r}"
        )
    for missing in sorted(OmegaConf.missing_keys(cfg)):
        raise ContactLearnError(f"{missing} must be given: {missing}=…; see configs/data")
    settings = _settings(cfg)
    if target == _TABLE:
        table: Table = _made(target, "read", settings | _lenient(names, validate=validate))
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
    return [
        f"{room.__name__}.{module.name}.load" for room in (data, simulation) for module in iter_modules(room.__path__)
    ]


def _made(target: str, function: str, settings: dict[str, Any]) -> Any:
    """What a function of a source returns; settings are data, whatever they look like."""
    source = import_module(target.removesuffix(".load"))
    if not hasattr(source, function):
        raise ContactLearnError(
            f"data._target_ must be a source under contactlearn.data or contactlearn.simulation, got {target!r}"
        )
    try:
        return getattr(source, function)(**settings)
    except ContactLearnError:
        raise
    except (TypeError, ValueError, OverflowError) as error:  # a setting that it does not have, or of another kind
        known = signature(source.load).parameters
        meant = next((suggest(key, known) for key in settings if key not in known), "")
        raise ContactLearnError(f"{target}: {' '.join(str(error).split())}{meant}") from error


def load_blocks(cfg: DictConfig, folder: Path | None = None) -> Blocks:
    """Load the `data` part of a configuration as `load_data` does, a large table in blocks.

    Raises:
        ContactLearnError: see `load_data`; or a correction that looks at all trials, of a table too large for memory.
        DataError: the source's own, or a row anywhere in a table.
    """
    if cfg.get("_target_") != _TABLE or OmegaConf.is_missing(cfg, "path") or not is_large(Path(str(cfg.path))):
        return Blocks.of(load_data(cfg, folder=folder))
    source, names = _source_and_corrections(cfg)
    together = [name for name in names if name in CORRECTIONS and CORRECTIONS[name].of_all]
    if together:
        needed = Path(str(cfg.path)).stat().st_size * MEMORY_PER_BYTE
        refuse_too_large(needed, f"data.correct=[{', '.join(together)}] looks at all trials of {cfg.path} together")
        return Blocks.of(load_data(cfg, folder=folder))
    shown: list[bool] = []

    def read() -> Iterator[Impacts]:
        tables = _made(_TABLE, "read_blocks", _settings(source) | _lenient(names, validate=True) | {"rows": BLOCK})
        return blocks_of(tables, corrected)

    def corrected(one: Table) -> Impacts:
        if not shown:
            show_columns(one.unused, one.computed)
            shown.append(True)
        return correct(one.impacts, names, computed_contact="r" in one.computed).replace(validate=True)

    return Blocks.survey(read)


def _settings(cfg: DictConfig) -> dict[str, Any]:
    """Settings of a source as plain values."""
    return {name: value for name, value in plain_values(cfg).items() if name != "_target_"}


def _lenient(names: Sequence[str], *, validate: bool) -> dict[str, bool]:
    """Settings of a table that is to be corrected."""
    return {"validate": validate and not names, "drop_incomplete": "drop_incomplete" in names}


def split(cfg: DictConfig, folder: Path | None = None) -> Split:
    """Load the data, say what a quick audit doubts, and hold out a share `test`; recordings leave recordings.html.

    `train.size` is set where it was left open.  Of many trials the audit sees those in memory.

    Raises:
        DataError: fewer trials than `train.size`, or an outcome at rest, to which no error is relative.
    """
    blocks = load_blocks(cfg.data, folder)
    generator = torch.Generator().manual_seed(cfg.seed)
    held_out = random_share(blocks.trials, cfg.test, generator, blocks.source)
    if cfg.train.size is None:
        cfg.train.size = max(1, min(_USUAL, 4 * int((~held_out).sum()) // 5))
    fitted, shown = sampled(~held_out, max(FITTED, cfg.train.size)), sampled(held_out, SHOWN)
    kept = fitted | shown
    impacts = blocks.pick(kept)
    show_mistakes(quick_audit(impacts), cfg.data.get("correct") or ())
    pool, test = impacts[~shown[kept]], impacts[shown[kept]]
    if len(pool) < cfg.train.size:
        raise DataError(
            f"{impacts.source}: train.size={cfg.train.size}, but {len(pool)} of {blocks.trials} trials are left to "
            f"draw from after holding out a share test={cfg.test}; use train.size={len(pool)} or less"
        )
    refuse_rest(test)
    return Split(blocks=blocks, held_out=held_out, impacts=impacts, pool=pool, test=test, generator=generator)


def show_split(data: Split, asked: str, device: torch.device) -> None:
    """Print the source of the data, the sizes of split and samples, and where a device was asked for, which it is."""
    trials, unseen = data.blocks.trials, data.unseen_trials
    terminal.show_data(data.blocks.source, trials - unseen, unseen)
    if len(data.impacts) < trials:
        terminal.show_samples(len(data.pool), len(data.test))
    if asked != "cpu":
        terminal.say(f"device={asked}: computed on {described(device)}")


def watched(on_event: OnEvent, blocks: Iterator[Impacts], trials: int, what: str) -> Iterator[Impacts]:
    """Yield blocks of so many trials in all, and say after the first of several how long the others will take."""
    begin, done = time.monotonic(), 0
    on_event(TaskProgress(task=what, done=0, total=trials))
    for block in blocks:
        yield block
        first, done = not done, done + len(block)
        on_event(TaskProgress(task=what, done=done, total=trials))
        if first and done < trials:
            terminal.show_estimate(what, trials, (time.monotonic() - begin) * trials / done)
