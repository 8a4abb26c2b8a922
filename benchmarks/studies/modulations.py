"""Studies of what depends on the state of each trial: drops whose coefficients do, or nothing does."""

from contactlearn.diagnosis.result import Modulation
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.diagnosis.unexplained.modulated import find_modulation
from contactlearn.identification.joint import FitOptions
from studies.cases import between
from studies.follows import DEPENDS
from studies.sequences import DESIGNS, Drops, made
from studies.study import Row, Study, each


def modulation(drops: Drops, thresholds: Thresholds) -> Modulation | None:
    """What the diagnosis says of the state, where no model is better than the fitted one."""
    return find_modulation(drops.impacts, drops.fit, drops.fit, FitOptions(), thresholds)


def _studied(kind: str, seed: int) -> Drops:
    """Drops whose errors are of a kind, or of which something depends faintly on the state."""
    if kind in DEPENDS:
        return made(seed, follows=kind, coefficient=DEPENDS[kind][0], strength=between(0.25, 1.0, seed), size=200)
    return made(seed, errors=kind, design=DESIGNS[seed % len(DESIGNS)], size=200)


def _said(drops: Drops, thresholds: Thresholds) -> bool:
    """Whether anything is said of the state."""
    return modulation(drops, thresholds) is not None


def _large(drops: Drops, thresholds: Thresholds) -> bool:
    """Whether so much depends on the state that something unknown is missing."""
    found = modulation(drops, thresholds)
    return found is not None and found.large


_NULL = each(8, "iid", "heavy", "before")
_PLANTED = each(6, "direction and angle", "spin with slip", "curtain")
STATE = Study(name="state", null=_NULL, planted=_PLANTED, prepare=_studied, alarm=_said)
UNKNOWN = Study(name="unknown in the state", null=_NULL, planted=_PLANTED, prepare=_studied, alarm=_large)
ROWS = (
    Row(field="modulation.level", values=(0.005, 0.01, 0.05, 0.2), study=STATE),
    Row(field="modulation.share", values=(0.0, 0.02, 0.05, 0.1), study=UNKNOWN),
)
