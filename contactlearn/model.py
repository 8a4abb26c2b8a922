"""ContactModel: what predicts the outcome of an impact."""

from dataclasses import dataclass

import torch

from contactlearn.impacts import Impacts, Prediction
from contactlearn.laws import Law


@dataclass(frozen=True)
class ContactModel:
    """An analytical law applied through the equation of motion; the moment τ is 0."""

    law: Law

    def predict(self, impacts: Impacts) -> Prediction:
        """Post velocity and wrench of every impact, batched over the leading axes of μ and ε."""
        P = self.law.impulse(impacts.W, impacts.v_c)
        return Prediction.from_wrench(impacts, torch.nn.functional.pad(P, (0, 1)))

    def __str__(self) -> str:
        return f"{self.law.name} ({self.law.variant}): μ = {float(self.law.mu):.3f}, ε = {float(self.law.eps):.3f}"
