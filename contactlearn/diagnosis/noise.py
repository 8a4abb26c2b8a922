"""The noise floor: the error that is left to a model that knows everything but the noise.

    stated      noise of the measured velocities is drawn anew before and after impact, and carried through the model
    estimated   what a model leaves of trials that began alike differs by their noise alone: half the squared
                difference of neighbours against their squared distance is a line, and at distance 0 it is the noise
                (the Gamma test).  Repeats of one drop are neighbours at distance 0.

The better the model, the less is left to the line, so the estimate is for the best model at hand.  It is the noise of
the outcome, not of an instrument: what differs from drop to drop and was not measured is noise, too.
Sources: Stefánsson, Končar & Jones 1997; Evans & Jones 2002.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import torch
from torch import Tensor

from contactlearn.effects import State
from contactlearn.effects.formula.symbols import of_state
from contactlearn.evaluation.metrics import Interval, bootstrap, mass_error
from contactlearn.impacts import Impacts, Prediction
from contactlearn.model import ContactModel

HOW = {"stated": "from the stated noise", "estimated": "from the differences of trials that began alike"}
_NEIGHBOURS = 10
_TRIALS = 4000  # whose neighbours are sought, at most
_DRAWS = 8
_RESAMPLES = 1000
_INPUTS = ("rx", "ry", "vx", "vy", "omega", "x")


class Floor(NamedTuple):
    """Mean mass error that noise alone makes, with its 95 % interval, and a key of `HOW`."""

    error: Interval
    how: str


def noise_floor(
    impacts: Impacts,
    model: ContactModel,
    *,
    generator: torch.Generator,
    noise: Sequence[float] | None = None,
    usual: Tensor | None = None,
    predicted: Tensor | None = None,
) -> Floor:
    """The mass error of a model that misses nothing.

    Args:
        model: the best at hand, fitted to these impacts.
        noise: standard deviations of the measured v_x, v_y (m/s) and ω (rad/s), before impact as after it; estimated if
            left out.
        usual: trials [N] that are no gross outliers; all of them if left out.  What an outlier leaves is all noise.
        predicted: v_post [N, 3] by something that knows more than the model, on trials that it was not fitted to.
    """
    if noise is not None:
        return Floor(_stated(impacts, model, noise, generator), "stated")
    expected = model.predict(impacts).v_post
    predicted = expected if predicted is None else torch.where(predicted.isfinite(), predicted, expected)
    usual = torch.ones(len(impacts), dtype=torch.bool) if usual is None else usual
    rows = usual.nonzero()[:, 0]
    rows = rows[torch.randperm(len(rows), generator=generator)[:_TRIALS]]
    error = _estimated(impacts[rows], predicted[rows], generator)
    outliers = mass_error(impacts, Prediction(predicted, impacts.wrench))[~usual].sum().item() / len(impacts)
    share = usual.double().mean().item()
    return Floor(Interval(*(share * end + outliers for end in error)), "estimated")


def _stated(impacts: Impacts, model: ContactModel, noise: Sequence[float], generator: torch.Generator) -> Interval:
    sigma, expected, errors = torch.tensor(noise, dtype=torch.float64), model.predict(impacts), []
    for _ in range(_DRAWS):
        before, after = sigma * torch.randn(2, len(impacts), 3, dtype=torch.float64, generator=generator)
        seen = model.predict(impacts.replace(v_pre=impacts.v_pre + before, suspect=True)).v_post
        moved = impacts.replace(v_post=expected.v_post + after, suspect=True)
        errors.append(mass_error(moved, replace(expected, v_post=seen)))
    return bootstrap(torch.stack(errors).mean(0), generator, _RESAMPLES)


def _estimated(impacts: Impacts, predicted: Tensor, generator: torch.Generator) -> Interval:
    mass = torch.stack((impacts.mass, impacts.mass, impacts.inertia), -1).sqrt()
    left = mass * (impacts.v_post - predicted)
    size = (mass * impacts.v_post).norm(dim=-1, keepdim=True)
    known = of_state(State.of(impacts))
    began = torch.stack([known[name] for name in _INPUTS], -1)
    varies = began.std(0) > 1e-9 * began.abs().amax(0)
    began = ((began - began.mean(0)) / began.std(0))[:, varies]
    apart = torch.cdist(began, began).fill_diagonal_(torch.inf)
    distance, neighbour = apart.topk(min(_NEIGHBOURS, len(impacts) - 1), largest=False)  # [N, K]
    differs = (left[:, None] - left[neighbour]).norm(dim=-1) / size / 2**0.5
    rows = torch.randint(len(impacts), (_RESAMPLES, len(impacts)), generator=generator)
    mean = _at_no_distance(distance.square().mean(0), differs.mean(0).square()).sqrt()
    resampled = _at_no_distance(distance[rows].square().mean(1), differs[rows].mean(1).square()).sqrt()
    low, high = resampled.quantile(torch.tensor((0.025, 0.975), dtype=resampled.dtype)).tolist()
    return Interval(mean.item(), low, high)


def _at_no_distance(distance: Tensor, difference: Tensor) -> Tensor:
    """Where the least-squares line of difference over distance [..., K] begins; it does not fall."""
    away = distance - distance.mean(-1, keepdim=True)
    slope = (away * difference).sum(-1) / away.square().sum(-1).clamp_min(1e-300)
    return (difference.mean(-1) - slope.clamp_min(0) * distance.mean(-1)).clamp_min(0)
