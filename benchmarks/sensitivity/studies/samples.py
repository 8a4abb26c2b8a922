"""Studies of large tables, which are diagnosed on subsamples."""

from typing import NamedTuple

import torch

from contactlearn import laws
from contactlearn.diagnosis.pipeline import diagnose
from contactlearn.diagnosis.sampling.confirmation import agree, normal_interval
from contactlearn.diagnosis.search.candidates import all_candidates
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.mechanics.impacts import Impacts
from sensitivity.studies.cases import drops, random
from sensitivity.studies.study import Row, Study, each, scaled

_TABLE = 6000  # trials


class Large(NamedTuple):
    """A table with hidden effects, and the law that nature's contacts agree with."""

    impacts: Impacts
    law: str
    effects: tuple[str, ...]


def _large(effects: tuple[str, ...], strength: tuple[float, float], seed: int) -> Large:
    return Large(*drops(effects, _TABLE, seed, strength), effects)


def _named(table: Large, thresholds: Thresholds) -> bool:
    """Whether the hidden effects are named, each of its family; where there are none, whether any is."""
    found = diagnose(table.impacts, laws.find(table.law), candidates=all_candidates(), thresholds=thresholds).effects
    return set(table.effects) <= set(found) if table.effects else bool(found)


_WEAK = (0.3, 0.7)
NAMES = Study(
    name="names in large tables", null=each(2, ((), _WEAK)),
    planted=each(1, *(((name,), _WEAK) for name in ("surface_tilt", "side_drag", "com_offset", "parameter_drift"))),
    prepare=_large, alarm=_named,
)  # fmt: skip


def _errors(factor: float, seed: int) -> tuple[Interval, Interval]:
    """Errors of 2000 trials, and of 50 000 others that are so many times larger; with the tails of a diagnosis."""
    generator = random(seed)
    inside, outside = (0.02 * torch.randn(n, generator=generator).mul(0.7).exp().double() for n in (2000, 50_000))
    return normal_interval(inside), normal_interval(factor * outside)


def _apart(errors: tuple[Interval, Interval], thresholds: Thresholds) -> bool:
    """Whether the error of the subsample is said to be another one than that of the rest."""
    return not agree(*errors, thresholds.sample)


ERRORS = Study(name="errors outside a sample", null=each(40, 1.0), planted=each(20, 1.1), prepare=_errors, alarm=_apart)

_S = "sample."
ROWS = (
    Row(field=_S + "whole", values=(1000, 2000, 5000, 6000), study=NAMES),
    Row(field=_S + "first", values=(250, 500, 1000, 2000, 4000), study=NAMES),
    Row(field=_S + "most", values=(2000, 4000, 8000), study=NAMES),
    Row(field=_S + "sigmas", values=scaled(3.0, 1 / 3, 2 / 3, 1, 5 / 3, 10 / 3), study=ERRORS),
)
