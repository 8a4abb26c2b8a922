"""Studies of large tables, which are diagnosed on subsamples."""

from typing import NamedTuple

from contactlearn import laws
from contactlearn.diagnosis.pipeline import diagnose
from contactlearn.diagnosis.search.candidates import all_candidates
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.mechanics.impacts import Impacts
from sensitivity.studies.cases import drops
from sensitivity.study import Study, each

_TABLE = 6000  # trials


class Large(NamedTuple):
    """A table with hidden effects, and the law of the simulated contacts."""

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
