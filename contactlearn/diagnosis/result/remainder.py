"""Results about the residual of the full model: the share that is predictable, and formulas for it."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.mechanics.space import Space


class WrenchComponent(StrEnum):
    """A component of the contact wrench: P_t and P_n in N s, τ in N m s."""

    TANGENTIAL = "t"
    NORMAL = "n"
    MOMENT = "tau"

    def output(self, axis: str = "") -> str:
        """Name the component in a formula: Pt, Pn or tau; along an axis of the slip P1, P2, tau1, tau2, taun."""
        return {"t": "P" if axis else "Pt", "n": "Pn", "tau": "tau"}[self.value] + axis


def wrench_columns(space: Space) -> dict[WrenchComponent, list[int]]:
    """List the columns of each component in a wrench in the axes of the slip."""
    friction, moments = range(space.d - 1), range(space.d, space.D)
    return dict(zip(WrenchComponent, ([*friction], [space.d - 1], [*moments]), strict=True))


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


class Coefficient(StrEnum):
    """A coefficient of the law: friction μ or restitution ε."""

    FRICTION = "mu"
    RESTITUTION = "eps"


class LaggedVariable(StrEnum):
    """A variable that is no part of a trial's own state: its place in the sequence, or a quantity of earlier impacts.

    Impulses are those that the model predicts; slip, spin and tangential impulse count with their signs, their sizes
    without.  Slip and spin along those of the present trial are positive where both have the same sense.  Of a place it
    is the number of earlier impacts near it.
    """

    ORDER = "order"
    PERIOD = "period"
    NORMAL_SPEED = "normal_speed"
    NORMAL_IMPULSE = "normal_impulse"
    SLIP = "slip"
    SLIP_SPEED = "slip_speed"
    SPIN = "spin"
    SPIN_RATE = "spin_rate"
    TANGENTIAL_IMPULSE = "tangential_impulse"
    SLIP_ALONG = "slip_along"
    SPIN_ALONG = "spin_along"
    PLACE = "place"


@dataclass(frozen=True, kw_only=True)
class SerialDependence:
    """A dependence of what remains on the sequence of the trials, which no effect of the model explains.

    Args:
        coefficient: of the law, which varies from trial to trial; None where only the velocities depend.
        variable: the variable that it depends on.
        trials: over which neighbours resemble each other, of the period, or impacts that are remembered.
        p_value: of independence, over all coefficients, times scales, periods and quantities of earlier impacts.
        share: of the held-out residual, in units of its scatter, that such a coefficient takes away.
        large: whether that share is so high that something unknown must be missing.
        width: in m, standard deviation, of a place that earlier impacts were near; None of anything else.
    """

    coefficient: Coefficient | None
    variable: LaggedVariable
    trials: float
    p_value: float
    share: Interval
    large: bool
    width: float | None = None


@dataclass(frozen=True, kw_only=True)
class StateDependence:
    """A dependence of what remains on the state of each trial, which no effect of the model explains.

    Args:
        coefficient: of the law, which varies with the state; None where velocities do, whatever the impact.
        variables: on which it depends, with their total Sobol indices: symbols, or `object`.
        p_value: of independence, over all coefficients and functions of one variable or two.
        share: of the held-out residual, in units of its scatter, that is taken away by such a dependence.
        large: whether that share is so high that something unknown must be missing.
        form_of: an effect of the model with the same coefficient as a function of the same variable, whose form is
            then wrong; the dependence is not unknown.
    """

    coefficient: Coefficient | None
    variables: tuple[VariableShare, ...]
    p_value: float
    share: Interval
    large: bool
    form_of: str | None = None


@dataclass(frozen=True, kw_only=True)
class Remainder:
    """The part of the model's held-out error that Gaussian processes on its residual take away.

    `share` is the relative reduction of the mean error, at or below 0 where there is nothing to learn; `components` are
    the named ones, by their reduction of the error; `variables` the symbols that they depend on; `large` whether the
    share is so high that something unknown must be missing; `state_dependence` and `serial_dependence` describe what
    remains as a function of the state and of the sequence.
    """

    share: Interval
    large: bool
    components: tuple[WrenchComponent, ...]
    variables: tuple[VariableShare, ...]
    tested: tuple[ComponentTest, ...]
    serial_dependence: SerialDependence | None = None
    state_dependence: StateDependence | None = None

    @property
    def found(self) -> bool:
        """The residual is predictable beyond chance, from the state or from the sequence."""
        return self.predictable or self.serial_dependence is not None or self.state_dependence is not None

    @property
    def predictable(self) -> bool:
        """Gaussian processes of the state and the order predict a part of it beyond chance."""
        return bool(self.components) and self.share.low > 0

    @property
    def unknown(self) -> bool:
        """So much is predictable that something unknown must be missing."""
        dependences = self.serial_dependence, self.state_dependence
        return self.large or any(dependence is not None and dependence.large for dependence in dependences)


@dataclass(frozen=True, kw_only=True)
class Formula:
    """A sum of one or two terms, each times a coefficient c1, c2, that is added to a component of the wrench.

    Args:
        component: of the wrench.
        terms: expressions in the documented symbols.
        ranges: [low, high] of each coefficient.
        coefficients: fitted to all trials.
        error_reduction: share of the held-out error that the formula takes away.
        standard_error: of that share, over the trials.
        axis: 1, 2 or n of friction and moment in space, the axes of the slip.
    """

    component: WrenchComponent
    terms: tuple[str, ...]
    ranges: tuple[tuple[float, float], ...]
    coefficients: tuple[float, ...]
    error_reduction: float
    standard_error: float
    axis: str = ""

    @property
    def output(self) -> str:
        """Name of what it is added to, such as tau or P1."""
        return self.component.output(self.axis)

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
        return (f'+effect.{name}.{self.output}="{self.text}"', *ranges)
