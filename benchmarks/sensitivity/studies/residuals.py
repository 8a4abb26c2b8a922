"""Studies of the regions in which a law fails, and of the predictable part of a residual."""

import math
from typing import NamedTuple

import torch
from torch import Tensor

from contactlearn import laws
from contactlearn.core.numerics import wrapped
from contactlearn.diagnosis.regions import find_regions
from contactlearn.diagnosis.result import Remainder
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.diagnosis.unexplained.remainder import learn_remainder
from contactlearn.inference.identification import joint
from contactlearn.inference.identification.joint import Fit
from contactlearn.inference.validation import Folds
from contactlearn.mechanics.impacts import Impacts, Prediction
from sensitivity.studies.cases import between, drops, heavy, random
from sensitivity.study import Study, each


class Failing(NamedTuple):
    """A prediction, and windows [k, n] in which its errors are enlarged."""

    impacts: Impacts
    prediction: Prediction
    windows: Tensor


def _failing(kind: str, seed: int) -> Failing:
    """A law on its own drops, with errors exchanged among the trials and enlarged in windows, or on other drops."""
    effects = () if kind in ("clean", "heavy", "exchanged", "one", "two") else (kind,)
    impacts, law = drops(effects, 300, seed)
    if kind == "heavy":
        impacts = heavy(impacts, seed)
    prediction, windows = joint.fit(impacts, laws.find(law)).model.predict(impacts), _windows(impacts, seed)
    if effects:
        return Failing(impacts, prediction, torch.ones(1, 300, dtype=torch.bool))
    windows = windows[: {"one": 1, "two": 2}.get(kind, 0)]
    if kind in ("exchanged", "one", "two"):
        size = impacts.v_post.square().sum(-1, keepdim=True).sqrt()  # of one body: as good as in the mass norm
        relative = ((impacts.v_post - prediction.v_post) / size)[torch.randperm(300, generator=random(seed))]
        factor = torch.where(windows.any(0), between(1.4, 4, seed), 1.0)
        prediction = Prediction(impacts.v_post - factor[:, None] * relative * size, prediction.wrench)
    return Failing(impacts, prediction, windows)


def _windows(impacts: Impacts, seed: int) -> Tensor:
    """Orientations within 20 to 60° of a random one, and a third to a sixth of the places."""
    centre, place = torch.rand(2, generator=random(seed), dtype=torch.float64)
    half = math.radians(between(20, 60, seed))
    turned = wrapped(impacts.q[:, 2] - 2 * math.pi * centre).abs() < half
    share = between(1 / 6, 1 / 3, seed + 1)
    low, high = impacts.q[:, 0].quantile(torch.stack((place * (1 - share), place * (1 - share) + share)))
    return torch.stack((turned, (impacts.q[:, 0] >= low) & (impacts.q[:, 0] <= high)))


def _regions(failing: Failing, thresholds: Thresholds) -> list[Tensor]:
    """Trials [n] of the regions that are reported."""
    found = find_regions(
        failing.impacts, failing.prediction, generator=torch.Generator().manual_seed(0), thresholds=thresholds
    )
    masks = []
    for region in found:
        masks.append(torch.zeros(len(failing.impacts), dtype=torch.bool))
        masks[-1][list(region.rows)] = True
    return masks


def _reported(failing: Failing, thresholds: Thresholds) -> bool:
    """Whether a region is reported; where errors were enlarged, one that lies there for more than half."""
    found = _regions(failing, thresholds)
    if not len(failing.windows):
        return bool(found)
    return any(window[rows].double().mean() > 0.5 for window in failing.windows for rows in found)


REGIONS = Study(
    name="regions", null=(*each(12, "exchanged"), *each(6, "clean", "heavy")),
    planted=(*each(16, "one"), *each(2, "orientation_dependent_restitution", "location_dependent_restitution")),
    prepare=_failing, alarm=_reported,
)  # fmt: skip


class Learning(NamedTuple):
    """A law with a residual, and the component and the variables in which something unknown acts."""

    impacts: Impacts
    fit: Fit
    component: str
    variables: frozenset[str]


ACTS = {"magnetic_pull": ("tau", {"theta"}), "elastic_strap": ("t", {"x", "vy"}), "spin_lift": ("n", {"omega", "vx"})}


def residual(kind: str, strength: tuple[float, float], seed: int) -> Learning:
    """The true law, alone on its drops, on some with noise of heavy tails, or with something unknown."""
    impacts, law = drops((kind,) if kind in ACTS else (), 100, seed, strength)
    impacts = heavy(impacts, seed) if kind == "heavy" else impacts
    component, variables = ACTS.get(kind, ("", set()))
    return Learning(impacts, joint.fit(impacts, laws.find(law)), component, frozenset(variables))


def _learned(learning: Learning, thresholds: Thresholds) -> Remainder:
    impacts, fit = learning.impacts, learning.fit
    folds = Folds.draw(len(impacts), torch.Generator().manual_seed(0), repeats=1)
    generator = torch.Generator().manual_seed(0)
    return learn_remainder(
        impacts, fit.model, folds, generator=generator, inliers=fit.inliers, thresholds=thresholds
    ).remainder


def _component(learning: Learning, thresholds: Thresholds) -> bool:
    """Whether the right component is named; where nothing is hidden, whether any is."""
    named = _learned(learning, thresholds).components
    return learning.component in named if learning.component else bool(named)


def _variables(learning: Learning, thresholds: Thresholds) -> set[str]:
    return {one.symbol for one in _learned(learning, thresholds).variables}


_NOTHING = each(5, ("clean", (2, 5)), ("heavy", (2, 5)))
_WEAK = each(4, *((kind, (0.5, 2)) for kind in ACTS))
_CLEAR = each(4, *((kind, (2, 5)) for kind in ACTS))
UNKNOWN = Study(
    name="unknown remainder", null=_NOTHING, planted=_WEAK, prepare=residual,
    alarm=lambda learning, thresholds: _learned(learning, thresholds).large,
)  # fmt: skip
COMPONENT = Study(name="component of the remainder", null=_NOTHING, planted=_WEAK, prepare=residual, alarm=_component)
VARIABLES = Study(
    name="variables of the remainder", null=_CLEAR, planted=_CLEAR, prepare=residual,
    alarm=lambda learning, thresholds: learning.variables <= _variables(learning, thresholds),
    false_alarm=lambda learning, thresholds: bool(_variables(learning, thresholds) - learning.variables),
)  # fmt: skip
