"""Score test of a candidate effect from the fit of a model without it.

With s the trials' gradients of the loss in the candidate's parameters at their vanishing values, made orthogonal to
those of the fitted parameters, (Σ s)ᵀ (Σ s sᵀ)⁻¹ (Σ s) is χ² with as many degrees of freedom as parameters.  A
parameter that is undefined where the effect vanishes, such as the place of a spot, is tried at several values, and
the p-value is the least of them times their number.
Sources: Rao 1948, with the covariance of White 1982; Davies 1977.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from jaxtyping import Float
from scipy.stats import chi2
from torch import Tensor

from contactlearn.diagnosis.validation import CrossValidation
from contactlearn.effects import Effect, EffectId, columns
from contactlearn.identification.joint import Linearisation, linearise

_PLACES = 8  # values of parameters that are undefined where the effect vanishes


@dataclass(frozen=True, kw_only=True)
class ScoreTest:
    """The result for one candidate; `start` are the parameters at which it was tested, to be refitted from."""

    candidate: EffectId
    statistic: float
    p_value: float
    start: Float[Tensor, " k"]


def score_test(
    models: CrossValidation,
    effects: Mapping[str, Effect],
    values: Float[Tensor, " K"],
    scatter: Float[Tensor, "3 3"],
    candidate: EffectId,
    effect: Effect,
) -> ScoreTest:
    """Test whether the loss falls if an effect is let into a model.

    Args:
        models: law, impacts and options.
        effects: of the model.
        values: of its fitted parameters.
        scatter: of its residual, in which the loss is measured.
        candidate: identity of the effect.
        effect: prepared for the impacts.
    """
    tests = []
    for own in _vanishing_points(effect):
        theta = torch.cat((values, own))
        about = linearise(
            models.law,
            {**effects, candidate.name: effect},
            models.impacts,
            theta,
            scatter,
            options=models.options,
        )
        statistic, p_value = _statistic(about, len(values), effect)
        tests.append((p_value, statistic, own))
    p_value, statistic, own = min(tests, key=lambda test: test[0])
    return ScoreTest(candidate=candidate, statistic=statistic, p_value=min(1.0, len(tests) * p_value), start=own)


def _statistic(about: Linearisation, fitted: int, effect: Effect) -> tuple[float, float]:
    """χ² statistic and p-value of the parameters after the first `fitted` ones."""
    moving = about.slope.abs().amax((0, 1)) > 0
    slope, K = about.slope[..., moving], int(moving[:fitted].sum())
    weighted = (about.weight[:, None, None] * slope).flatten(0, 1)
    curvature = slope.flatten(0, 1).T @ weighted
    gradients = about.weight[:, None] * (slope * about.residual[..., None]).sum(1)
    known, new = gradients[:, :K], gradients[:, K:]
    if new.shape[1] == 0:
        return 0.0, 1.0
    efficient = new - known @ torch.linalg.lstsq(curvature[:K, :K], curvature[:K, K:]).solution
    total, spread = efficient.sum(0), efficient.T @ efficient
    scale = spread.diagonal().sqrt().clamp_min(1e-300)
    spread = spread / (scale[:, None] * scale) + 1e-9 * torch.eye(len(scale), dtype=spread.dtype)
    statistic = (total / scale @ torch.linalg.solve(spread, total / scale)).item()
    if _leaves_range(effect, total):
        return 0.0, 1.0
    return statistic, float(chi2.sf(statistic, new.shape[1]))


def _leaves_range(effect: Effect, total: Float[Tensor, " k"]) -> bool:
    """Whether the only parameter vanishes at a bound, and the loss falls beyond that bound alone."""
    only = effect.parameters[0]
    if len(effect.parameters) != 1 or only.vanishing not in (only.low, only.high):
        return False
    return total.item() > 0 if only.vanishing == only.low else total.item() < 0  # the loss rises inwards


def _vanishing_points(effect: Effect) -> Float[Tensor, "p k"]:
    """Values at which an effect vanishes: one point, or several of the parameters that are undefined there."""
    free = [k for k, p in enumerate(effect.parameters) if p.vanishing is None]
    vanished = columns(*effect.vanished().values)
    if not free:
        return vanished[None]
    low, high = torch.tensor([(p.low, p.high) for p in effect.parameters], dtype=torch.float64)[free].T
    places = torch.quasirandom.SobolEngine(len(free), scramble=True, seed=0).draw(_PLACES - 1, dtype=torch.float64)
    points = vanished.repeat(_PLACES, 1)
    points[1:, free] = low + places * (high - low)
    return points
