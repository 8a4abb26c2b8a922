"""ContactModel: what predicts the outcome of an impact, with one `predict` for every kind.

    base         an analytical law, another model, or nothing: no impulse at all
    parameters   Gaussian processes for (μ, ε) of each impact in place of the law's own
    residual     Gaussian processes on what the base leaves, as impulse, wrench or post velocity
    noise        covariance of the measured post velocity that none of these can predict

A purely learned model has no base; a law alone has nothing else.  Leading axes, such as training
subsets, may come before the impacts in every part.
"""

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn.functional import pad

from contactlearn import mechanics
from contactlearn.impacts import Impacts, Prediction
from contactlearn.laws import Law, impulse
from contactlearn.regressor import Regressor

RESIDUALS = ("velocity", "impulse", "wrench")
"""What a residual adds to: v_post, (P_t, P_n) or (P_t, P_n, τ)."""


@dataclass(frozen=True)
class ContactModel:
    """See the module; `target` is one of `RESIDUALS`, `noise` [..., 3, 3] in squares of (m/s, m/s, rad/s)."""

    base: "Law | ContactModel | None" = None
    residual: Regressor | None = None
    target: str = "wrench"
    parameters: Regressor | None = None
    noise: Tensor | None = None

    def predict(self, impacts: Impacts) -> Prediction:
        """Post velocity, wrench and, where noise is known, covariance of every impact.

        The covariance is that of the processes, carried through the equation of motion (and
        linearly through the law), plus the noise.
        """
        if self.parameters is not None:
            mean, variance = self.parameters.predict(impacts)
        elif self.residual is not None:
            mean, variance = self.residual.predict(impacts)
        else:
            return self.base_prediction(impacts)
        prediction = self.complete(impacts, mean)
        if self.noise is None:
            return prediction
        covariance = self.spread(impacts, mean, variance) + self.noise[..., None, :, :]
        return Prediction(prediction.v_post, prediction.wrench, covariance)

    def __str__(self) -> str:
        """The parts with their parameters, such as `wang_mason (textbook): μ = 0.120, ε = 0.550 + wrench(x1)`."""
        parts = [] if self.base is None else [str(self.base)]
        if self.parameters is not None:
            parts = [f"{self.base.name} ({self.base.variant}): (μ, ε)({self.parameters.space})"]
        if self.residual is not None:
            parts.append(f"{self.target}({self.residual.space})")
        return " + ".join(parts) or "no impulse"

    def base_prediction(self, impacts: Impacts) -> Prediction:
        """What the base alone predicts."""
        if isinstance(self.base, ContactModel):
            return self.base.predict(impacts)
        P = torch.zeros_like(impacts.r) if self.base is None else self.base.impulse(impacts.W, impacts.v_c)
        return Prediction.from_wrench(impacts, pad(P, (0, 1)))

    def complete(self, impacts: Impacts, learned: Tensor) -> Prediction:
        """Prediction from the value [..., N, O] of the learned part: (μ, ε) or the residual."""
        if self.parameters is not None:
            return predict_with(self.base, impacts, learned)
        base = self.base_prediction(impacts)
        if self.target == "velocity":
            v_post = base.v_post + learned
            body = impacts.mass, impacts.inertia, impacts.r, impacts.v_pre
            return Prediction(v_post, mechanics.measured_wrench(*body, v_post))
        return Prediction.from_wrench(impacts, base.wrench + pad(learned, (0, 3 - learned.shape[-1])))

    def spread(self, impacts: Impacts, learned: Tensor, variance: Tensor) -> Tensor:
        """Covariance [..., N, 3, 3] of v_post from the variance [..., N, O] of the learned part."""
        if self.target == "velocity":
            return torch.diag_embed(variance)
        slope = mechanics.velocity_per_wrench(impacts.mass, impacts.inertia, impacts.r)[..., : variance.shape[-1]]
        if self.parameters is not None:
            slope = slope @ impulse_per_parameter(self.base, impacts, learned)
        return (slope * variance[..., None, :]) @ slope.mT


def predict_with(law: Law, impacts: Impacts, parameters: Tensor) -> Prediction:
    """Prediction of a law with its own (μ, ε) [..., N, 2] for each impact; negative ones count as 0, ε ends at 1."""
    return Prediction.from_wrench(impacts, pad(_impulse(law, impacts, parameters), (0, 1)))


def impulse_per_parameter(law: Law, impacts: Impacts, parameters: Tensor) -> Tensor:
    """Derivative [..., N, 2, 2] of (P_t, P_n) in (μ, ε) at parameters [..., N, 2]."""
    mu, eps = (part.clone().requires_grad_() for part in _clamped(parameters))
    with torch.enable_grad():
        P = impulse(law.name, impacts.W, impacts.v_c, mu, eps, variant=law.variant, e_t=law.e_t)
        rows = [torch.stack(torch.autograd.grad(part.sum(), (mu, eps), retain_graph=True), -1) for part in P.unbind(-1)]
    return torch.stack(rows, -2)


def _impulse(law: Law, impacts: Impacts, parameters: Tensor) -> Tensor:
    return impulse(law.name, impacts.W, impacts.v_c, *_clamped(parameters), variant=law.variant, e_t=law.e_t)


def _clamped(parameters: Tensor) -> tuple[Tensor, Tensor]:
    return parameters[..., 0].clamp_min(0), parameters[..., 1].clamp(0, 1)
