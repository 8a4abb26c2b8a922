"""A component of the contact's scatter: what differs from impact to impact, at random, around one law.

    y_k = f(x_k, u_k) + e_k,        u_k ~ N(0, σ²),  e_k of the instrument

An effect changes the mean outcome by shared parameters; a component of scatter changes its covariance by the one
standard deviation σ of its deviations u_k, one a trial or, where a direction has several angles, several of the same σ.
It overrides `perturb` and states what it is:

    class Restitution(Component):
        \"\"\"ε_k = ε + u_k.  It is not …\"\"\"

        symbol, unit, highest, in_words = "ε", "–", 0.2, "restitution by {sigma}"

        def perturb(self, state, mu, eps, u): return state, mu, (eps + u[..., 0]).clamp(0, 1)

Everything else follows: derivatives, estimation, selection, covariances, draws.  At u = 0 nothing changes.
"""

import inspect
import math
import re
from abc import ABC, abstractmethod
from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.errors import ContactLearnError
from contactlearn.core.frozen import Frozen
from contactlearn.core.numerics import is_number, measured
from contactlearn.effects.state import State
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.space import Space

Perturbed = tuple[State, Float[Tensor, "..."], Float[Tensor, "..."]]
"""State, μ and ε of each impact."""


class Component(Frozen, ABC):
    """Base of all components; `sigma` is the standard deviation of its deviations, in its unit; see the module.

    Raises:
        ContactLearnError: a standard deviation that is negative or no number.
    """

    symbol: ClassVar[str]
    """Letter of what deviates."""
    unit: ClassVar[str]
    """SI; – for a number."""
    highest: ClassVar[float]
    """Greatest plausible standard deviation, in this unit."""
    in_words: ClassVar[str]
    """A sentence's part with `{sigma}`, as an effect's: the unit is added, ° for rad and mm for m."""
    source: ClassVar[str] = ""
    """Origin of the idea, in words."""
    name: ClassVar[str]
    """Its class's name in small letters."""

    sigma: float = 0.0

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        cls.name = re.sub(r"(?<!^)(?=[A-Z])", "_", cls.__name__).lower()
        if not inspect.isabstract(cls) and not all(hasattr(cls, x) for x in ("symbol", "unit", "highest", "in_words")):
            raise TypeError(f"{cls.__name__} must state its symbol, unit, highest standard deviation and in_words")

    def __post_init__(self) -> None:
        if not is_number(self.sigma) or self.sigma < 0:
            raise ContactLearnError(
                f"scatter of {self.name}: sigma must be a standard deviation in {self.unit}, got {self.sigma!r}"
            )

    def __str__(self) -> str:
        """Say what scatters and by how much: the normal by 0.65°."""
        scale, unit = {"rad": (180 / math.pi, "°"), "m": (1e3, "mm")}.get(self.unit, (1.0, self.unit))
        return self.in_words.format(sigma=measured(scale * self.sigma, None, unit))

    @abstractmethod
    def perturb(
        self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."], u: Float[Tensor, "... n k"]
    ) -> Perturbed:
        """Return state, μ and ε of each impact from its deviations u [..., N, k], k as `deviations`."""

    def deviations(self, space: Space) -> int:
        """Number of independent deviations of one impact."""
        return 1

    def suits(self, impacts: Impacts) -> bool:
        """Whether these impacts can show it beside the other components."""
        return True

    def of_instrument(self, impacts: Impacts) -> bool:
        """Whether it is noise of the instrument that looks like scatter of the contact, and no body has it."""
        return False

    def draw(self, shape: tuple[int, ...], space: Space, generator: torch.Generator | None) -> Float[Tensor, "... k"]:
        """Draw deviations [*shape, k]."""
        drawn = torch.randn(*shape, self.deviations(space), generator=generator, dtype=torch.float64)
        return self.sigma * drawn
