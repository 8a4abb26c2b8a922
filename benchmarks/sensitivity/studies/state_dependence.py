"""Studies of what depends on the state of each trial: drops whose coefficients do, or nothing does."""

from itertools import product

from contactlearn.diagnosis.result import StateDependence
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.diagnosis.unexplained.proxy_effects import drop_proxies
from contactlearn.diagnosis.unexplained.state_dependence import find_state_dependence
from contactlearn.effects import find_effect
from contactlearn.inference.identification.joint import FitOptions, identify_jointly
from sensitivity.studies.cases import between
from sensitivity.studies.follows import DEPENDS
from sensitivity.studies.serial_dependence import DESIGNS, NAMED, Drops, made
from sensitivity.studies.study import Row, Study, each


def state_dependence(drops: Drops, thresholds: Thresholds, block: int = 1) -> StateDependence | None:
    """What the diagnosis says of the state, where no model is better than the fitted one."""
    return find_state_dependence(drops.impacts, drops.fit, drops.fit, FitOptions(), thresholds, block)


def _studied(kind: str, seed: int) -> Drops:
    """Drops whose errors are of a kind, or of which something depends faintly on the state."""
    if kind in DEPENDS:
        return made(seed, follows=kind, coefficient=DEPENDS[kind][0], strength=between(0.25, 1.0, seed), size=200)
    return made(seed, errors=kind, design=DESIGNS[seed % len(DESIGNS)], size=200)


def _said(drops: Drops, thresholds: Thresholds) -> bool:
    """Whether anything is said of the state."""
    return state_dependence(drops, thresholds) is not None


def _large(drops: Drops, thresholds: Thresholds) -> bool:
    """Whether so much depends on the state that something unknown is missing."""
    found = state_dependence(drops, thresholds)
    return found is not None and found.large


def _nested(effect: str, follows: str, seed: int) -> Drops:
    """Drops of which something depends on the state, with the model that has an effect as well, true or not."""
    named = effect if effect in NAMED else ""
    drops = made(seed, follows=follows, coefficient=DEPENDS[follows][0], strength=1.5, named=named)
    fit = identify_jointly(drops.fit.model.law, {effect: find_effect(effect)()}, drops.impacts)
    return Drops(drops.impacts, fit)


def _left_out(drops: Drops, thresholds: Thresholds) -> bool:
    """Whether the effect is said to stand for what depends on the state."""
    alone = identify_jointly(drops.fit.model.law, {}, drops.impacts)
    return drop_proxies(drops.impacts, (alone, drops.fit), FitOptions(), thresholds.state_dependence) == 0


_NULL = each(8, "iid", "heavy", "before")
_PLANTED = each(6, "direction and angle", "spin with slip", "curtain")
_TRUE = ("spin_damping", "directional_friction", "surface_tilt")
_DEPENDENCES = ("place and angle", "spin with slip", "magnet", "curtain")
_SOAKED = (
    ("spin with slip", "slip_dependent_restitution"),
    ("place and angle", "location_dependent_restitution"),
    ("magnet", "orientation_dependent_moment"),
)
STATE = Study(name="state", null=_NULL, planted=_PLANTED, prepare=_studied, alarm=_said)
UNKNOWN = Study(name="unknown in the state", null=_NULL, planted=_PLANTED, prepare=_studied, alarm=_large)
STAND_INS = Study(
    name="stand-ins",
    null=tuple((named, follows, 900 + k) for k, (named, follows) in enumerate(product(_TRUE, _DEPENDENCES))),
    planted=tuple((name, follows, 930 + k) for k, (follows, name) in enumerate(_SOAKED * 4)),
    prepare=_nested,
    alarm=_left_out,
)
ROWS = (
    Row(field="state_dependence.level", values=(0.005, 0.01, 0.05, 0.2), study=STATE),
    Row(field="state_dependence.share", values=(0.0, 0.02, 0.05, 0.1), study=UNKNOWN),
    Row(field="state_dependence.sigmas", values=(0.0, 1.0, 2.0, 4.0, 8.0), study=STAND_INS),
)
