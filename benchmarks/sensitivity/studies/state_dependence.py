"""Studies of what depends on the state of each trial: drops whose coefficients do, or nothing does."""

from contactlearn.diagnosis.result import StateDependence
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.diagnosis.unexplained.state_dependence import find_state_dependence
from contactlearn.inference.identification.joint import FitOptions
from sensitivity.studies.cases import between
from sensitivity.studies.follows import DEPENDS
from sensitivity.studies.serial_dependence import DESIGNS, Drops, made
from sensitivity.study import Study, each


def state_dependence(drops: Drops, thresholds: Thresholds, block: int = 1) -> StateDependence | None:
    """Test for state dependence where no model is better than the fitted one."""
    return find_state_dependence(drops.impacts, drops.fit, drops.fit, FitOptions(), thresholds, block)


def _studied(kind: str, seed: int) -> Drops:
    """Drops whose errors are of a kind, or of which something depends faintly on the state."""
    if kind in DEPENDS:
        return made(seed, follows=kind, coefficient=DEPENDS[kind][0], strength=between(0.25, 1.0, seed), size=200)
    return made(seed, errors=kind, design=DESIGNS[seed % len(DESIGNS)], size=200)


def _said(drops: Drops, thresholds: Thresholds) -> bool:
    """Whether a state dependence is found."""
    return state_dependence(drops, thresholds) is not None


_NULL = each(8, "iid", "heavy", "before")
_PLANTED = each(6, "direction and angle", "spin with slip", "curtain")
STATE = Study(name="state", null=_NULL, planted=_PLANTED, prepare=_studied, alarm=_said)
