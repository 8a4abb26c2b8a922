"""Results about the residual of the full model: the share that is predictable, and formulas for it."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from contactlearn.evaluation.metrics import Interval


class WrenchComponent(StrEnum):
    """A component of the contact wrench: P_t and P_n in N s, τ in N m s."""

    TANGENTIAL = "t"
    NORMAL = "n"
    MOMENT = "tau"

    @property
    def output(self) -> str:
        """The name of the component in a formula: Pt, Pn or tau."""
        return {"t": "Pt", "n": "Pn", "tau": "tau"}[self.value]


@dataclass(frozen=True, kw_only=True)
class ComponentTest:
    """Held-out prediction of a component of the residual wrench by Gaussian processes.

    `r_squared` is against 0, `error_reduction` that of the mean mass error if only this component is predicted, and
    `clear` whether the component is named.
    """

    component: WrenchComponent
    r_squared: float
    standard_error: float
    error_reduction: float
    clear: bool


@dataclass(frozen=True, kw_only=True)
class VariableShare:
    """The total Sobol index of a symbol in the predicted residual, normalised to a sum of 1."""

    symbol: str
    share: float


@dataclass(frozen=True, kw_only=True)
class Remainder:
    """The part of the model's held-out error that Gaussian processes on its residual take away.

    `share` is the relative fall of the mean error, at or below 0 where there is nothing to learn; `components` are
    the named ones, by their reduction of the error; `variables` the symbols that they depend on; `large` whether the
    share is so high that something unknown must be missing.
    """

    share: Interval
    large: bool
    components: tuple[WrenchComponent, ...]
    variables: tuple[VariableShare, ...]
    tested: tuple[ComponentTest, ...]

    @property
    def found(self) -> bool:
        """Whether the residual is predictable beyond chance."""
        return bool(self.components) and self.share.low > 0


@dataclass(frozen=True, kw_only=True)
class Formula:
    """One or two terms that are added to a component of the wrench, each times a coefficient c1, c2.

    Args:
        component: of the wrench.
        terms: expressions in the documented symbols.
        ranges: [low, high] of each coefficient.
        coefficients: fitted to all trials.
        error_reduction: share of the held-out error that the formula takes away.
        standard_error: of that share, over the trials.
    """

    component: WrenchComponent
    terms: tuple[str, ...]
    ranges: tuple[tuple[float, float], ...]
    coefficients: tuple[float, ...]
    error_reduction: float
    standard_error: float

    @staticmethod
    def sum_of(terms: Sequence[str]) -> str:
        """Write the sum of terms with their coefficients, such as c1*Pn*sin(3*theta) + c2*Pn."""
        return " + ".join(f"c{k}" + ("" if term == "1" else f"*{term}") for k, term in enumerate(terms, 1))

    @property
    def text(self) -> str:
        """The sum of the terms, as the configuration takes it."""
        return self.sum_of(self.terms)

    def overrides(self, name: str = "mine") -> tuple[str, ...]:
        """Write the arguments of a command that adds the formula as an effect; quote them for a shell."""
        ranges = (f"+effect.{name}.parameters.c{k}=[{low:g},{high:g}]" for k, (low, high) in enumerate(self.ranges, 1))
        return (f'+effect.{name}.{self.component.output}="{self.text}"', *ranges)
