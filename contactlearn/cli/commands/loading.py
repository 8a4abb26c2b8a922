"""Data of a run: a source of measurements as impacts, and their split.

Tables of more than `LARGE` rows are read in blocks.  Computations trial by trial cover all of them; fits,
figures and pages use a random sample in memory, see docs/large-data.md.
"""

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Bool
from torch import Tensor

from contactlearn.cli.resource_limits import FITTED, MEMORY_PER_BYTE, affordable_train_size, refuse_too_large
from contactlearn.cli.settings import SourceSettings, SplitSettings
from contactlearn.core.devices import described
from contactlearn.core.errors import ContactLearnError, DataError
from contactlearn.core.events import TaskProgress
from contactlearn.core.numerics import random_share
from contactlearn.data import table
from contactlearn.data.audit.corrections import CORRECTIONS, correct
from contactlearn.data.audit.findings import quick_audit
from contactlearn.data.blocks import BLOCK, Blocks, sampled
from contactlearn.data.packed import only_file, size_of
from contactlearn.data.recordings import SOURCES
from contactlearn.data.table import Table, blocks_of, is_large
from contactlearn.data.tracks import Tracked
from contactlearn.diagnosis.events import OnEvent
from contactlearn.inference.evaluation.metrics import refuse_rest
from contactlearn.inference.identification.joint import least_trials
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.space import PLANE
from contactlearn.report import terminal
from contactlearn.report.terminal import show_columns, show_mistakes
from contactlearn.results.tables import SHOWN

_TABLE = "contactlearn.data.table.load"
_MIN_HELD_OUT = 2  # trials: the interval of an error is a bootstrap over them
_PARAMETERS = 2  # of a law: μ and ε
_USUAL = 120  # training trials of a subset where as many are there: the paper's number


@dataclass(frozen=True, kw_only=True)
class Loaded:
    """Impacts of a source, and of recordings everything found on the way to them."""

    impacts: Impacts
    tracked: Tracked | None = None


@dataclass(frozen=True, kw_only=True)
class Split:
    """Impacts of a run.

    Args:
        blocks: all of them.
        held_out: which of them no model may be made from.
        impacts: those in memory, which are all if they are few: pool and test.
        pool: to fit to.
        test: held out, to draw and to show.
        train_size: number of training trials of a subset of the pool.
        generator: the run's random source.
        tracked: everything found in recordings, where the source has some.
    """

    blocks: Blocks
    held_out: Bool[Tensor, " n"]
    impacts: Impacts
    pool: Impacts
    test: Impacts
    train_size: int
    generator: torch.Generator
    tracked: Tracked | None = None

    @property
    def held_out_trials(self) -> int:
        """Number of all trials that are held out."""
        return int(self.held_out.sum())

    def held_out_impacts(self) -> Iterator[Impacts]:
        """Yield all trials that are held out, in blocks."""
        return iter((self.test,)) if len(self.test) == self.held_out_trials else self.blocks.where(self.held_out)


def load_data(source: SourceSettings, validate: bool = True) -> Loaded:
    """Load a source as impacts, corrected; nothing but this package's own sources is run.

    Columns of a table that are not used, and fields that were computed, are printed.  Without `validate` a table
    is read, and stays, without the rule that contacts approach the floor: for the audit.

    Raises:
        ContactLearnError: a setting that the source does not have, or a correction that does not exist.
        DataError: the source's own.
    """
    source.refuse_missing()
    computed, tracked = (), None
    if source.target == _TABLE:
        found: Table = _call(source, "read", _lenient(source, validate=validate))
        show_columns(found.unused, found.computed, found.read_as)
        impacts, computed = found.impacts, found.computed
    elif source.target in SOURCES:
        tracked = _call(source, "find", {})
        impacts = tracked.impacts
    else:
        impacts = _call(source, "load", {})
    impacts = correct(impacts, source.corrections, computed_contact="r" in computed).replace(validate=validate)
    return Loaded(impacts=impacts, tracked=tracked)


def _call(source: SourceSettings, function: str, settings: Mapping[str, Any]) -> Any:
    """Return what a function of a source gives; settings are data, whatever they look like."""
    try:
        return getattr(import_module(source.target.removesuffix(".load")), function)(**source.options, **settings)
    except ContactLearnError:
        raise
    except (TypeError, ValueError, OverflowError) as error:  # a setting of another kind
        raise ContactLearnError(f"{source.target}: {' '.join(str(error).split())}") from error


def _lenient(source: SourceSettings, *, validate: bool) -> dict[str, bool]:
    """Settings of a table, which may break the rules of impacts if it is to be corrected."""
    return {
        "validate": validate and not source.corrections,
        "drop_incomplete": "drop_incomplete" in source.corrections,
    }


def load_blocks(source: SourceSettings) -> tuple[Blocks, Tracked | None]:
    """Load a source as `load_data` does, a large table in blocks.

    Raises:
        ContactLearnError: see `load_data`; or a correction that looks at all trials, of a table too large for memory.
        DataError: the source's own, or a row anywhere in a table.
    """
    path = Path(str(source.options.get("path", "")))
    if source.target != _TABLE or source.missing or not is_large(path):
        loaded = load_data(source)
        return Blocks.of(loaded.impacts), loaded.tracked
    names = source.corrections
    together = [name for name in names if name in CORRECTIONS and CORRECTIONS[name].needs_all_trials]
    if together:
        needed = size_of(only_file(path, table.SUFFIXES, "table")) * MEMORY_PER_BYTE
        refuse_too_large(needed, f"data.correct=[{', '.join(together)}] looks at all trials of {path} together")
        return Blocks.of(load_data(source).impacts), None
    shown: list[bool] = []

    def read() -> Iterator[Impacts]:
        return blocks_of(_call(source, "read_blocks", {**_lenient(source, validate=True), "rows": BLOCK}), corrected)

    def corrected(one: Table) -> Impacts:
        if not shown:
            show_columns(one.unused, one.computed, one.read_as)
            shown.append(True)
        return correct(one.impacts, names, computed_contact="r" in one.computed).replace(validate=True)

    return Blocks.survey(read), None


def split(settings: SplitSettings) -> Split:
    """Load the data, print the doubts of a quick audit, and hold out a share `test`.

    The number of training trials is the usual one where it was left open, and lowered where memory does not suffice.
    Of many trials the audit sees those in memory.

    Raises:
        DataError: fewer trials than a law's parameters or the training need, or an outcome at rest, to which no error
            is relative.
    """
    wanted = affordable_train_size(settings.train.size)
    blocks, tracked = load_blocks(settings.data)
    least = least_trials(_PARAMETERS, blocks.space.D)
    if blocks.trials < least + _MIN_HELD_OUT:
        raise DataError(
            f"{blocks.source}: at least {least + _MIN_HELD_OUT} trials are needed, got {blocks.trials}: {least} for "
            f"{_PARAMETERS} parameters, and {_MIN_HELD_OUT} held out for the interval of an error"
        )
    splitting, generator = (torch.Generator().manual_seed(seed) for seed in (settings.split_seed, settings.seed))
    held_out = random_share(blocks.trials, settings.test, splitting, blocks.source, blocks.groups)
    random_share(blocks.trials, settings.test, generator, blocks.source)  # equal seeds must not draw the same twice
    pooled = int((~held_out).sum())
    usual = min(pooled, FITTED) if settings.fits_all else min(_USUAL, max(least, 4 * pooled // 5))
    size = usual if wanted is None else wanted
    fitted, shown = sampled(~held_out, max(FITTED, size)), sampled(held_out, SHOWN)
    in_memory = fitted | shown
    impacts = blocks.pick(in_memory)
    if impacts.space is PLANE:
        show_mistakes(quick_audit(impacts, blocks.read), settings.data.corrections)
    pool, test = impacts[~shown[in_memory]], impacts[shown[in_memory]]
    if len(test) < _MIN_HELD_OUT:
        raise DataError(
            f"{impacts.source}: test={settings.test} holds out {len(test)} of {blocks.trials} trials, and an error of "
            f"a single trial has no interval; use test={_MIN_HELD_OUT / blocks.trials:.2g} or more"
        )
    if len(pool) < least:
        raise DataError(
            f"{impacts.source}: test={settings.test} leaves {len(pool)} of {blocks.trials} trials, but {_PARAMETERS} "
            f"parameters need at least {least}; use test={1 - least / blocks.trials:.2g} or less"
        )
    if len(pool) < size:
        raise DataError(
            f"{impacts.source}: train.size={size}, but {len(pool)} of {blocks.trials} trials are left to draw from "
            f"after holding out a share test={settings.test}; use train.size={len(pool)} or less"
        )
    refuse_rest(test)
    return Split(
        blocks=blocks,
        held_out=held_out,
        impacts=impacts,
        pool=pool,
        test=test,
        train_size=size,
        generator=generator,
        tracked=tracked,
    )


def show_split(data: Split, device_name: str, device: torch.device) -> None:
    """Print the source of the data, the sizes of split and samples, and the device if it is not the usual one."""
    trials, held_out = data.blocks.trials, data.held_out_trials
    terminal.print_line(
        f"{data.blocks.source}: {trials} impacts, {trials - held_out} for identification, {held_out} held out"
        + ("" if data.blocks.groups is None else "; recordings are held out as a whole, and resampled so for intervals")
    )
    if data.train_size < len(data.pool):
        terminal.print_line(f"models are fitted to random subsets of {data.train_size} of them (train.size)")
    if len(data.impacts) < trials:
        terminal.print_line(
            f"large table: models are fitted to {len(data.pool)} trials, figures and page show {len(data.test)}; "
            "errors are over all held-out trials"
        )
    if device_name != "cpu":
        terminal.print_line(f"device={device_name}: computed on {described(device)}")


def track_blocks(on_event: OnEvent, blocks: Iterator[Impacts], trials: int, what: str) -> Iterator[Impacts]:
    """Yield blocks of so many trials in all; after the first of several, print how long the others will take."""
    begin, done = time.monotonic(), 0
    on_event(TaskProgress(task=what, done=0, total=trials))
    for block in blocks:
        yield block
        first, done = not done, done + len(block)
        on_event(TaskProgress(task=what, done=done, total=trials))
        if first and done < trials:
            seconds = (time.monotonic() - begin) * trials / done
            duration = f"{seconds / 60:.0f} min" if seconds > 90 else f"{seconds:.0f} s"
            terminal.print_line(f"{what}: {trials}, about {duration}")
