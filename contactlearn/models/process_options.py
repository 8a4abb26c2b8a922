"""ProcessOptions: which GPyTorch modules Gaussian processes have, and how they are trained."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

STARTS, ITERATIONS = 2, 100
"""Starts of a training, and the most iterations of each, unless an optimiser says otherwise."""


@dataclass(frozen=True, kw_only=True)
class ProcessOptions:
    """Modules and training of Gaussian processes on standardised features and outputs.

    Args:
        kernel: description of a kernel, see `contactlearn.models.gp.modules`; one without an output scale gets it from
            a `ScaleKernel` around it.  None: squared exponential with a length scale for each feature.
        mean: description of a mean; None: zero.
        likelihood: description of a Gaussian likelihood; None: `GaussianLikelihood`, with the trials weighted by their
            stated covariances.  `FixedNoiseGaussianLikelihood` has these covariances themselves as its noise.
        optimiser: `starts`, `iterations` and, for another than BFGS, a `_target_` in torch.optim with its arguments.
        prior: whether hyperparameters without a prior of their own have a weak one, so that the training maximises
            their posterior and not their likelihood.
    """

    kernel: Mapping[str, Any] | None = None
    mean: Mapping[str, Any] | None = None
    likelihood: Mapping[str, Any] | None = None
    optimiser: Mapping[str, Any] | None = None
    prior: bool = True

    def __str__(self) -> str:
        """Return the classes that are not the default, as " (MaternKernel, ConstantMean)"."""
        parts = (self.kernel, self.mean, self.likelihood, self.optimiser)
        named = ", ".join(part["_target_"].__name__ for part in parts if part and "_target_" in part)
        return f" ({named})" if named else ""
