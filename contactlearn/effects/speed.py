"""Reference speeds of effects that scale with a speed of the contact."""

from dataclasses import dataclass, replace
from typing import ClassVar, Self

from contactlearn.effects.base import typical
from contactlearn.mechanics.impacts import Impacts


@dataclass(frozen=True, eq=False)
class SpeedReference:
    """Mixin: a reference speed v_ref in m/s, by default the median of |v_t| or |v_n| over the measurements.

    `component` of the contact velocity (v_t, v_n) is 0 for the slip and 1 for the approach.
    """

    component: ClassVar[int]
    formula: ClassVar[str]
    v_ref: float | None = None  # m/s; None: the median of the measurements

    @property
    def equation(self) -> str:
        """The formula, and v_ref once it is known."""
        return self.formula if self.v_ref is None else f"{self.formula} at v_ref = {self.v_ref} m/s"

    def prepare(self, impacts: Impacts) -> Self:
        """Return the effect with v_ref taken from the impacts where it is open."""
        return self if self.v_ref is not None else replace(self, v_ref=typical(impacts.v_c[:, self.component]))
