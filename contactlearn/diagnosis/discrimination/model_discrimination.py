"""Discrimination between two models: their difference at a state, and the evidence that a drop there brings.

    d² = Δᵀ (Σ + J C Jᵀ)⁻¹ Δ,      Δ = v_post of the one minus v_post of the other

with Σ the covariance of the chosen model's residual, and J C Jᵀ the covariance of Δ that the uncertainty C of both
models' parameters makes: a difference that another value of ε within its error would take away decides nothing.
d is the difference in standard deviations.  If one of the two is true, a drop is expected to bring d²/2 nats of
evidence for it.  It also informs both models: after it, C is smaller and Δ is the residual difference of a refit (a
Kalman filter), so the next such drop may bring less, and the sum over drops is that of all of them together.
Source: Box & Hill 1967.
"""

import math
from collections.abc import Hashable, Mapping
from dataclasses import dataclass, replace
from typing import Self, TypeVar

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.inference.identification.joint import linearise
from contactlearn.inference.validation import robust_covariance
from contactlearn.laws import Law
from contactlearn.mechanics.impacts import Impacts
from contactlearn.models.contact_model import ContactModel

Key = TypeVar("Key", bound=Hashable)


@dataclass(frozen=True, kw_only=True)
class ModelDiscrimination:
    """Two models at n states.

    Args:
        difference: of v_post in (m/s, m/s, rad/s).
        slope: its derivative in the parameters of both models.
        covariance: of these parameters.
        noise: covariance of the measured v_post.
    """

    difference: Float[Tensor, "n 3"]
    slope: Float[Tensor, "n 3 k"]
    covariance: Float[Tensor, "k k"]
    noise: Float[Tensor, "3 3"]

    def squared(self) -> Float[Tensor, " n"]:
        """Compute d² of the next drop at each state."""
        spread = self.noise + self.slope @ self.covariance @ self.slope.mT
        spread = spread + 1e-9 * torch.diag_embed(spread.diagonal(dim1=-2, dim2=-1))  # noise may be next to nothing
        factor = torch.linalg.cholesky(spread)
        white = torch.linalg.solve_triangular(factor, self.difference[..., None], upper=False)
        return white.square().sum((-2, -1))

    def after(self, k: int) -> Self:
        """Return the discrimination once both models are refitted to the expected outcome of a drop at state k."""
        J, C = self.slope[k], self.covariance
        gain = torch.linalg.solve(self.noise + J @ C @ J.T, J @ C).T
        difference = self.difference - self.slope @ (gain @ self.difference[k])
        covariance = C - gain @ J @ C
        return replace(self, difference=difference, covariance=(covariance + covariance.T) / 2)

    def needed(self, odds: float, most: int = 1000) -> int | None:
        """Count the drops, at the states in turn, until the evidence reaches log(odds); None beyond `most`."""
        discrimination, nats = self, 0.0
        for made in range(most):
            k = made % len(self.difference)
            nats += discrimination.squared()[k].item() / 2
            if nats >= math.log(odds):
                return made + 1
            discrimination = discrimination.after(k)
        return None


def discriminations(
    impacts: Impacts, chosen: ContactModel, rivals: Mapping[Key, ContactModel], states: Impacts
) -> dict[Key, ModelDiscrimination]:
    """Set a chosen model against each rival at states; all are fitted to the impacts."""
    noise = robust_covariance(impacts.v_post - chosen.predict(impacts).v_post)
    mean, (slope, covariance), found = chosen.predict(states).v_post, _parameters(chosen, states), {}
    for key, rival in rivals.items():
        other, spread = _parameters(rival, states)
        difference, both = mean - rival.predict(states).v_post, torch.cat((slope, -other), -1)
        good = difference.isfinite().all(-1) & both.isfinite().all(-1).all(-1)
        found[key] = ModelDiscrimination(
            difference=torch.where(good[:, None], difference, 0.0),
            slope=torch.where(good[:, None, None], both, 0.0),
            covariance=torch.block_diag(covariance, spread),
            noise=noise,
        )
    return found


def _parameters(model: ContactModel, states: Impacts) -> tuple[Float[Tensor, "n 3 k"], Float[Tensor, "k k"]]:
    """Derivative of v_post in the fitted parameters, and their covariance; k = 0 if that is not known."""
    law = model.base
    if model.parameter_covariance is None or not isinstance(law, Law):
        return torch.zeros(len(states), 3, 0, dtype=torch.float64), torch.zeros(0, 0, dtype=torch.float64)
    values = [law.mu, law.eps, *(value for effect in model.effects.values() for value in effect.values)]
    theta = torch.stack([torch.as_tensor(value, dtype=torch.float64) for value in values])
    about = linearise(law, model.effects, states, theta, torch.eye(3, dtype=torch.float64))
    return -about.slope, model.parameter_covariance
