"""Studies of a joint fit: which trials are gross outliers, and which parameters the data do not determine."""

import math
from dataclasses import replace

import torch

from contactlearn import laws
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.effects import find_effect
from contactlearn.inference.identification import joint
from contactlearn.inference.identification.joint import Fit
from contactlearn.mechanics.impacts import Impacts
from sensitivity.studies.cases import between, heavy, random, some, spiked, textbook
from sensitivity.study import Study, each


def _fit(impacts: Impacts, effect: str) -> Fit:
    """Wang and Mason's law with an effect, fitted."""
    return joint.fit(impacts, laws.find("wang_mason"), {effect: find_effect(effect)()})


def _spikes(kind: str, seed: int) -> Fit:
    """A law fitted to textbook drops, to heavy-tailed ones, or to drops of which a few are far off."""
    impacts = textbook(seed, 200)
    if kind == "heavy":
        impacts = heavy(impacts, seed, (0.003, 0.003, 0.15))
    if kind == "spiked":
        impacts = spiked(impacts, some(impacts, 0.02, seed), seed, 5, 50)
    return joint.fit(impacts, laws.find("wang_mason"))


def _noisy(kind: str, seed: int) -> Fit:
    """A spin damping fitted to drops with the noise of a tracker, or with ten to two hundred times as much."""
    factor = between(10, 200, seed) if kind == "noisy" else 1.0
    return _fit(textbook(seed, 60, 0.01 * factor, 0.5 * factor), "spin_damping")


def _late(kind: str, seed: int) -> Fit:
    """A drift fitted to drops in their order, or to drops of which a few were made after all others."""
    impacts = textbook(seed, 100)
    if kind == "few":
        impacts = impacts.replace(order=torch.where(some(impacts, between(0.01, 0.08, seed), seed), 100.0, 1.0))
    return _fit(impacts, "parameter_drift")


def _speeds(kind: str, seed: int) -> Fit:
    """A late frame, which lowers v_y after impact, fitted to drops of many speeds, or of nearly one."""
    impacts = textbook(seed, 150)
    width = math.log(10 if kind == "many" else between(1.01, 1.5, seed))
    factor = (width * (torch.rand(150, 1, generator=random(seed), dtype=torch.float64) - 0.5)).exp()
    even = factor / impacts.v_pre[:, :2].norm(dim=-1, keepdim=True)
    return _fit(impacts.replace(v_pre=even * impacts.v_pre, v_post=even * impacts.v_post), "gravity_impulse")


def _outliers(fit: Fit, thresholds: Thresholds) -> bool:
    """Whether a trial is called a gross outlier."""
    return replace(fit, thresholds=thresholds.fit).outliers > 0


def _open(fit: Fit, thresholds: Thresholds) -> bool:
    """Whether the parameter of the effect is called undetermined, for any reason."""
    return fit.parameters[-1].name in replace(fit, thresholds=thresholds.fit).undetermined()


def _traded(fit: Fit, thresholds: Thresholds) -> bool:
    """Whether the parameter of the effect trades off with another."""
    name = fit.parameters[-1].name
    return any(name in pair for pair in replace(fit, thresholds=thresholds.fit).trade_offs())


OUTLIERS = Study(
    name="outliers of a fit",
    null=each(12, "clean", "heavy"),
    planted=each(24, "spiked"),
    prepare=_spikes,
    alarm=_outliers,
)
NOISE = Study(name="undetermined spin", null=each(12, "all"), planted=each(24, "noisy"), prepare=_noisy, alarm=_open)
ORDER = Study(name="drift of few trials", null=each(12, "all"), planted=each(24, "few"), prepare=_late, alarm=_open)
SPEEDS = Study(
    name="delay at one speed", null=each(12, "many"), planted=each(24, "one"), prepare=_speeds, alarm=_traded
)
