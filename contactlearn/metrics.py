"""How far a prediction is from the measured outcome, per trial, and how sure a mean over trials is.

    velocity_error              ‖v̂ − v‖₂ over (v_x, v_y) after contact              m/s
    normalised_velocity_error   the same divided by ‖v‖₂, the paper's axis           1
    mass_error                  √(eᵀ M e) / √(vᵀ M v) over (v_x, v_y, ω)             1

`mass_error` is the headline: it counts the spin, and does not add metres to radians.
"""

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor

from contactlearn.impacts import Impacts, Prediction
from contactlearn.mechanics import admissible


def velocity_error(impacts: Impacts, prediction: Prediction) -> Tensor:
    """‖v̂_post − v_post‖₂ of the centre of mass [..., N] in m/s."""
    return (prediction.v_post - impacts.v_post)[..., :2].norm(dim=-1)


def normalised_velocity_error(impacts: Impacts, prediction: Prediction) -> Tensor:
    """`velocity_error` divided by ‖v_post‖₂ [..., N]; the paper's Fig. 3.5."""
    return velocity_error(impacts, prediction) / impacts.v_post[:, :2].norm(dim=-1)


def mass_error(impacts: Impacts, prediction: Prediction) -> Tensor:
    """√(eᵀ M e) / √(v_postᵀ M v_post) over (v_x, v_y, ω) [..., N]."""
    M = torch.stack((impacts.mass, impacts.mass, impacts.inertia), -1)
    error = (M * (prediction.v_post - impacts.v_post) ** 2).sum(-1)
    return (error / (M * impacts.v_post**2).sum(-1)).sqrt()


class Metric(NamedTuple):
    """A per-trial error, what it is called on an axis, and its unit."""

    error: Callable[[Impacts, Prediction], Tensor]
    label: str
    unit: str


METRICS = {
    "mass_error": Metric(mass_error, "Mass-weighted velocity error", "–"),
    "normalised_velocity_error": Metric(normalised_velocity_error, "Normalised velocity error", "–"),
    "velocity_error": Metric(velocity_error, "Velocity error", "m/s"),
}
"""Each metric by name."""

HEADLINE = "mass_error"


def outside_admissible(impacts: Impacts, impulse: Tensor) -> Tensor:
    """Whether the impulse [..., N, 2] gains energy, pulls or leaves penetration: bool [..., N].

    For a point contact (τ = 0): see `mechanics.admissible`.
    """
    return ~admissible(impacts.W, impacts.v_c, impulse, tolerance=1e-7)


class Interval(NamedTuple):
    """A mean over trials and its bootstrap interval."""

    mean: float
    low: float
    high: float


def bootstrap(errors: Tensor, generator: torch.Generator, resamples: int = 2000, level: float = 0.95) -> Interval:
    """Mean of per-trial errors [N] with its percentile bootstrap interval over trials."""
    rows = torch.randint(len(errors), (resamples, len(errors)), generator=generator)
    low, high = errors[rows].mean(-1).quantile(torch.tensor(((1 - level) / 2, (1 + level) / 2), dtype=errors.dtype))
    return Interval(errors.mean().item(), low.item(), high.item())
