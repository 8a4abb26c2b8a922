"""Two models and what tells them apart: by how much they differ at a state, and what a drop there teaches.

    d² = Δᵀ (Σ + J C Jᵀ)⁻¹ Δ,      Δ = v_post of the one minus v_post of the other

with Σ the covariance of what the chosen model leaves of the measurements, and J C Jᵀ what the uncertainty C of both
models' parameters makes of Δ: a difference that another value of ε within its error would take away tells nothing.
d is the difference in standard deviations.  If one of the two is true, a drop is expected to bring d²/2 nats of
evidence for it.  It also teaches both models: after it, C is smaller and Δ is what a refit would leave of it (a Kalman
filter), so the next such drop may bring less, and the sum over drops is that of all of them together.
Source: Box & Hill 1967.
"""

import math
from collections.abc import Mapping
from copy import copy

import torch
from torch import Tensor

from contactlearn.identification.joint import linearise
from contactlearn.impacts import Impacts
from contactlearn.laws import Law
from contactlearn.model import ContactModel

ODDS = 20.0
"""What it takes to call one of two models the better one: evidence of log 20 = 3.0 nats."""
_CHI_SQUARED_50 = 2.3659739  # median, 3 degrees of freedom


class Contest:
    """Two models at n states: their difference [n, 3], its slope [n, 3, K] and what is not known, as drops are made."""

    def __init__(self, difference: Tensor, slope: Tensor, covariance: Tensor, noise: Tensor):
        good = difference.isfinite().all(-1) & slope.isfinite().all(-1).all(-1)
        self.difference = torch.where(good[:, None], difference, 0.0)
        self.slope = torch.where(good[:, None, None], slope, 0.0)
        self.covariance, self.noise = covariance, noise

    def squared(self) -> Tensor:
        """d² [n] of the next drop."""
        spread = self.noise + self.slope @ self.covariance @ self.slope.mT
        spread = spread + 1e-9 * torch.diag_embed(spread.diagonal(dim1=-2, dim2=-1))  # noise may be next to nothing
        factor = torch.linalg.cholesky(spread)
        white = torch.linalg.solve_triangular(factor, self.difference[..., None], upper=False)
        return white.square().sum((-2, -1))

    def make(self, k: int) -> None:
        """The drop at state k as it is expected: both models are refitted to it."""
        J, C = self.slope[k], self.covariance
        gain = torch.linalg.solve(self.noise + J @ C @ J.T, J @ C).T
        self.difference = self.difference - self.slope @ (gain @ self.difference[k])
        self.covariance = C - gain @ J @ C
        self.covariance = (self.covariance + self.covariance.T) / 2

    def needed(self, odds: float = ODDS, most: int = 1000) -> int | None:
        """Drops until the evidence is that for the odds, at the states in turn; None if it takes more than `most`."""
        contest, nats = copy(self), 0.0
        for made in range(most):
            k = made % len(self.difference)
            nats += contest.squared()[k].item() / 2
            if nats >= math.log(odds):
                return made + 1
            contest.make(k)
        return None


def contests(
    impacts: Impacts, chosen: ContactModel, rivals: Mapping[str, ContactModel], states: Impacts
) -> list[Contest]:
    """A chosen model against each rival at states; all are fitted to the impacts."""
    noise = robust_covariance(impacts.v_post - chosen.predict(impacts).v_post)
    mean, (slope, covariance), found = chosen.predict(states).v_post, _known(chosen, states), []
    for rival in rivals.values():
        other, spread = _known(rival, states)
        both = torch.cat((slope, -other), -1), torch.block_diag(covariance, spread)
        found.append(Contest(mean - rival.predict(states).v_post, *both, noise))
    return found


def robust_covariance(left: Tensor) -> Tensor:
    """Covariance [3, 3] of what is left [n, 3], by Student's t with 5 degrees of freedom, right for Gaussian noise."""
    scatter = torch.diag(left.square().median(0).values + 1e-12)
    for _ in range(30):
        distance = (left * torch.linalg.solve(scatter, left.T).T).sum(-1)
        scatter = left.T @ (8 / (5 + distance)[:, None] * left) / len(left)
        scatter = scatter + 1e-12 * torch.eye(3, dtype=left.dtype)
    distance = (left * torch.linalg.solve(scatter, left.T).T).sum(-1)
    return scatter * (distance.median() / _CHI_SQUARED_50).clamp_min(1e-6)  # of exact data


def _known(model: ContactModel, states: Impacts) -> tuple[Tensor, Tensor]:
    """Derivative [n, 3, K] of the predictions in the fitted parameters and their covariance; K = 0 if there is none."""
    law = model.base
    if model.parameter_covariance is None or not isinstance(law, Law):
        return torch.zeros(len(states), 3, 0, dtype=torch.float64), torch.zeros(0, 0, dtype=torch.float64)
    values = [law.mu, law.eps, *(value for effect in model.effects.values() for value in effect.values)]
    theta = torch.stack([torch.as_tensor(value, dtype=torch.float64) for value in values])
    unit = torch.eye(3, dtype=torch.float64)
    left = linearise(law, model.effects, states, theta, unit)
    return -left.slope, model.parameter_covariance
