"""A coefficient of each object of a table: the first has the law's own, the others a difference from it.

The objects are known once the effect is prepared, so the parameters are too: K − 1 for K objects.  Where there is one
object, or more than `MOST_OBJECTS`, there is no parameter and the effect changes nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.errors import ContactLearnError
from contactlearn.effects.base import Parameter
from contactlearn.effects.state import State, columns
from contactlearn.mechanics.bodies import body_code
from contactlearn.mechanics.impacts import Impacts

MOST_OBJECTS = 6
"""Objects, at most, that are told apart."""


@dataclass(frozen=True, eq=False)
class ByBody:
    """Differences Δ_j of the objects after the first; see the module."""

    formula: ClassVar[str]
    differences: Tensor | tuple[()] = field(default=(), metadata={"parameter": None})
    objects: tuple[str, ...] | None = None  # names; None: those of the measurements

    def __post_init__(self) -> None:
        given = torch.as_tensor(self.differences, dtype=torch.float64)
        object.__setattr__(self, "differences", given if given.numel() else torch.zeros(len(self._others)).double())

    @property
    def _others(self) -> tuple[str, ...]:
        """Names of the objects with a difference."""
        return self.objects[1:] if self.objects and len(self.objects) <= MOST_OBJECTS else ()

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """A difference for each object after the first."""
        named = enumerate(self._others, 2)
        return tuple(Parameter(f"d{k}", f"Δ({name})", "–", -0.5, 0.5) for k, name in named)

    @property
    def values(self) -> tuple[Tensor, ...]:
        """The differences."""
        return torch.as_tensor(self.differences).unbind(-1)

    @property
    def equation(self) -> str:
        """The formula, and the object that the others are compared with."""
        if self.objects is None:
            return self.formula
        count = len(self.objects)
        return f"{self.formula}, {self.objects[0]}" if self._others else f"{self.formula}; {count} of them tell nothing"

    def at(self, values: Float[Tensor, "... k"] | Sequence[Tensor | float]) -> Self:
        """Return the effect with values [..., K] of its K parameters; without a value it stays as it is.

        Raises:
            ContactLearnError: another number of values.
        """
        parts = tuple(values.unbind(-1) if isinstance(values, Tensor) else values)
        if parts and len(parts) != len(self._others):
            raise ContactLearnError(f"{self.equation} has {len(self._others)} parameters, got {len(parts)} values")
        tensors = [torch.as_tensor(part, dtype=torch.float64) for part in parts]
        return replace(self, differences=columns(*tensors)) if parts else self

    def prepare(self, impacts: Impacts) -> Self:
        """Return the effect with the names of the objects taken from the impacts where they are open."""
        return self if self.objects is not None else replace(self, objects=tuple(dict.fromkeys(impacts.object)))

    def change(self, state: State) -> Float[Tensor, "... n"]:
        """Evaluate the difference [..., N] of each trial's object; 0 for one that is not known."""
        total = torch.zeros_like(state.mass)
        for name, difference in zip(self._others, self.values, strict=True):
            total = total + torch.where(state.body == body_code(name), difference, 0.0)
        return total
