"""Functions of an impact that several effects share: mixins with parameters, open constants and their evaluation.

    SpeedReference      v_ref, the median speed of the measurements
    TrialShare          k/N, the share of all trials before one
    Spline              s(u), a natural cubic spline over one `Argument`
    AroundBody, …       functions of the orientation θ, of period 2π
    AlongFloor, …       functions of the place x on the floor: Legendre polynomials, or a stretch of it
    ByBody              one value for each object
    OfCovariate         functions of a covariate: LinearInCovariate, CovariateCurve, ByGroup

A function that a coefficient adds has a method `coefficient`, which `base.ChangesFriction` and
`base.ChangesRestitution` apply to μ and to ε.  It states its form and its formula for both, with {quantity} for the
letter of either.  A family whose forms are arms states their range, `ARM`.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import field, fields, replace
from functools import lru_cache
from itertools import pairwise
from typing import ClassVar, NamedTuple, Self

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.errors import ContactLearnError, DataError, suggest
from contactlearn.core.frozen import Frozen
from contactlearn.effects.base import OWN_FAMILY, Parameter, parameter, require_positive, usual_parameter
from contactlearn.effects.state import State, columns
from contactlearn.mechanics.bodies import body_code
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.space import BOTH, PLANE as IN_PLANE

ARM = ("m", -0.01, 0.01)
"""Unit and range of an arm at which an impulse acts, to the right of the contact point."""
MOST_OBJECTS = 6
"""Objects, at most, that `ByBody` tells apart."""

Knots = tuple[float, ...]

_QUANTILES = (0.05, 0.35, 0.65, 0.95)  # of four knots: Harrell 2015, §2.4.6
_FROM_REST = (1 / 3, 2 / 3, 0.95)  # of those after one at 0
_CLOSEST = 0.1  # of an even spacing; where two would be nearer, as with few distinct values, all are spaced evenly


class Argument(NamedTuple):
    """A quantity of an impact before contact: its letter, its unit (– for a number), and its values [..., N]."""

    symbol: str
    unit: str
    values: Callable[[State], Float[Tensor, "... n"]]


SLIP = Argument("|v_t|", "m/s", lambda state: state.slip)
APPROACH = Argument("|v_n|", "m/s", lambda state: state.v_n.abs())
INCIDENCE = Argument("α", "rad", lambda state: state.incidence)
LEVER = Argument("|r_x|/ρ", "–", lambda state: state.lever)
ORIENTATION = Argument("θ", "rad", lambda state: state.theta)
PLACE = Argument("x", "m", lambda state: state.x)
TRIAL = Argument("k", "trials", lambda state: state.order - 1)


# --- Speed and time ----------------------------------------------------------------------------------------


class SpeedReference(Frozen):
    """A reference speed v_ref in m/s, by default the median of |v_t| or |v_n| over the measurements."""

    speed: ClassVar[Argument]
    """`SLIP` or `APPROACH`."""
    formula: ClassVar[str]
    v_ref: float | None = None  # m/s; None: the median of the measurements

    @property
    def equation(self) -> str:
        """The formula, and v_ref once it is known."""
        return self.formula if self.v_ref is None else f"{self.formula} at v_ref = {self.v_ref} m/s"

    def taken_from(self, impacts: Impacts) -> Self:
        """Return the effect with v_ref taken from the impacts where it is open."""
        if self.v_ref is not None:
            return self
        median = self.speed.values(State.of(impacts)).median().item()
        return replace(self, v_ref=float(f"{median:.1e}") or 1.0)  # to two digits; 1 where that is 0

    def ratio(self, state: State) -> Float[Tensor, "... n"]:
        """Return the speed in units of v_ref [..., N]."""
        return self.speed.values(state) / require_positive(self.v_ref)


class TrialShare(Frozen):
    """The share k/N of all trials that come before one."""

    trials: float | None = field(default=None, kw_only=True)  # N; None: the number of the last one

    def taken_from(self, impacts: Impacts) -> Self:
        """Return the effect with N taken from the impacts where it is open."""
        return self if self.trials is not None else replace(self, trials=impacts.order.max().item())

    def share(self, state: State) -> Float[Tensor, "... n"]:
        """Return k/N of each trial [..., N]."""
        return (state.order - 1) / require_positive(self.trials)


# --- Splines -----------------------------------------------------------------------------------------------


class Spline(Frozen):
    """A smooth curve over one variable: a natural cubic spline through four knots.

        s(u) = Σ c_k S_k(u), k = 1 … 3;   S_k rises by 1 from knot k to knot k + 1, and by 0 from any other to the next

    So c_k is the rise of s from one knot to the next.  s is straight beyond the outer knots, and 0 midway between the
    inner ones, or at the first one where the curve starts at rest.  Source: Hastie, Tibshirani & Friedman 2009, §5.2.1.
    """

    form: ClassVar[str | None] = "curve"
    formula: ClassVar[str]
    in_words: ClassVar[str] = "changes by {c1}, {c2} and {c3} from knot to knot"
    argument: ClassVar[Argument]
    """The quantity u among whose values the knots lie; a report names it before `in_words`."""
    at_rest: ClassVar[bool] = False
    """Whether the first knot is at 0, and the curve is 0 there."""

    c1: Tensor | float = usual_parameter("c₁")
    c2: Tensor | float = usual_parameter("c₂")
    c3: Tensor | float = usual_parameter("c₃")
    knots: Knots | None = None  # four values of the variable; None: quantiles of the measurements

    def taken_from(self, impacts: Impacts) -> Self:
        """Return the curve with its knots at quantiles over the impacts where they are open."""
        if self.knots is not None:
            return self
        values = self.argument.values(State.of(impacts))
        return replace(self, knots=_from_rest(values) if self.at_rest else _spread(values))

    def change(self, u: Float[Tensor, "... n"]) -> Float[Tensor, "... n"]:
        """Evaluate s at values u [..., N] of the variable.

        Raises:
            ContactLearnError: the knots are open, or not four increasing numbers.
        """
        if self.knots is None or len(self.knots) != 4 or any(b <= a for a, b in pairwise(self.knots)):
            rule = f"the knots of a curve are four increasing values of {self.argument.symbol}"
            raise ContactLearnError(f"{rule}, given or taken by prepare(impacts); got {self.knots}")
        zero = self.knots[0] if self.at_rest else (self.knots[1] + self.knots[2]) / 2
        rises, origin = _rises(self.knots, zero, u.device)
        shapes = (_truncated(u, self.knots) - origin) @ rises
        return self.c1 * shapes[..., 0] + self.c2 * shapes[..., 1] + self.c3 * shapes[..., 2]

    def coefficient(self, state: State, value: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        """Return a coefficient with s(u) added."""
        return value + self.change(self.argument.values(state))

    @property
    def equation(self) -> str:
        """The formula, and the knots once they are known."""
        if self.knots is None:
            return self.formula
        symbol, unit, _ = self.argument
        knots = ", ".join(f"{knot:g}" for knot in self.knots)
        return f"{self.formula} at {symbol} = {knots}{'' if unit == '–' else f' {unit}'}"


def _spread(values: Float[Tensor, "..."]) -> Knots:
    """Knots at quantiles of values, or evenly spaced where these are too few."""
    knots = values.flatten().quantile(torch.tensor(_QUANTILES, dtype=values.dtype, device=values.device)).tolist()
    if knots[0] == knots[-1]:  # a variable that does not vary
        knots = [knots[0] - 0.5, *knots[1:-1], knots[0] + 0.5]
    return _separate(knots)


def _from_rest(sizes: Float[Tensor, "..."]) -> Knots:
    """Knots at 0 and at quantiles of values that are not negative."""
    knots = sizes.flatten().quantile(torch.tensor(_FROM_REST, dtype=sizes.dtype, device=sizes.device)).tolist()
    return _separate([0.0, *knots[:-1], knots[-1] or 1.0])


def _separate(knots: list[float]) -> Knots:
    """Space knots evenly if some are too close, and round them to a thousandth of their span or a little less."""
    low, high = knots[0], knots[-1]
    even = (high - low) / 3
    if min(b - a for a, b in pairwise(knots)) < _CLOSEST * even:
        knots = [low, low + even, high - even, high]
    digits = 2 - math.floor(math.log10(high - low))
    return tuple(round(knot, digits) for knot in knots)


@lru_cache(maxsize=256)
def _rises(knots: Knots, zero: float, device: torch.device) -> tuple[Float[Tensor, "3 3"], Float[Tensor, "3"]]:
    """The matrix from truncated powers to S_k, and the powers at `zero`."""
    at_knots = _truncated(torch.tensor(knots, dtype=torch.float64), knots)
    origin = _truncated(torch.tensor(zero, dtype=torch.float64), knots)
    return torch.linalg.inv(at_knots.diff(dim=0)).to(device), origin.to(device)


def _truncated(u: Float[Tensor, "*batch"], knots: Knots) -> Float[Tensor, "*batch 3"]:
    """Basis [..., 3] of the natural cubic splines without the constant: u itself and two that bend."""
    span = knots[-1] - knots[0]
    t, (first, second, third, last) = (u - knots[0]) / span, ((knot - knots[0]) / span for knot in knots)
    cubes = {knot: (t - knot).clamp_min(0) ** 3 for knot in (first, second, third, last)}
    bends = [(cubes[knot] - cubes[last]) / (last - knot) for knot in (first, second, third)]
    return torch.stack((t, bends[0] - bends[2], bends[1] - bends[2]), -1)


class LinearInIncidence(Frozen):
    """c α, proportional to the angle of incidence."""

    form: ClassVar[str | None] = "linear"
    formula: ClassVar[str] = "{quantity} ← {quantity} + c α, α = arctan(|v_t|/|v_n|)"
    in_words: ClassVar[str] = "{quantity} changes by {c} of incidence"
    c: Tensor | float = parameter("c", "1/rad", -1.0, 1.0)

    def coefficient(self, state: State, value: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        """Return the coefficient with c α added."""
        return value + self.c * state.incidence


class CurveOverIncidence(Spline):
    """s(α), a smooth curve over the angle of incidence."""

    argument: ClassVar[Argument] = INCIDENCE
    formula: ClassVar[str] = (
        "{quantity} ← {quantity} + s(α), α = arctan(|v_t|/|v_n|), a smooth s that rises by c₁, c₂, c₃ from knot to knot"
    )


# --- Orientation -------------------------------------------------------------------------------------------


class _OfOrientation(Frozen, ABC):
    """A function of the orientation, and a coefficient to which it is added."""

    @abstractmethod
    def change(self, theta: Float[Tensor, "... n"]) -> Float[Tensor, "... n"]:
        """Evaluate the function at orientations θ [..., N] in rad."""

    def coefficient(self, state: State, value: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        """Return the coefficient with the function of θ added."""
        return value + self.change(state.theta)


class AroundBody(_OfOrientation):
    """Σ a_k cos kθ + b_k sin kθ: smooth all around with k = 1, 2."""

    form: ClassVar[str | None] = "harmonics"
    formula: ClassVar[str] = "{quantity} ← {quantity} + a₁ cos θ + b₁ sin θ + a₂ cos 2θ + b₂ sin 2θ"
    in_words: ClassVar[str] = (
        "around the body {quantity} changes by {a1} cos θ, {b1} sin θ, {a2} cos 2θ and {b2} sin 2θ"
    )
    a1: Tensor | float = usual_parameter("a₁")
    b1: Tensor | float = usual_parameter("b₁")
    a2: Tensor | float = usual_parameter("a₂")
    b2: Tensor | float = usual_parameter("b₂")

    def change(self, theta: Float[Tensor, "... n"]) -> Float[Tensor, "... n"]:
        total = torch.zeros_like(theta)
        coefficients = [getattr(self, f.name) for f in fields(self) if "parameter" in f.metadata]
        for k, (a, b) in enumerate(zip(coefficients[::2], coefficients[1::2], strict=True), 1):
            total = total + a * (k * theta).cos() + b * (k * theta).sin()
        return total


class CurveAroundBody(AroundBody):
    """The same with k = 1 … 4: features of about 45°."""

    form: ClassVar[str | None] = "curve"
    formula: ClassVar[str] = "{quantity} ← {quantity} + Σ a_k cos kθ + b_k sin kθ, k = 1 … 4"
    in_words: ClassVar[str] = ""
    argument: ClassVar[Argument] = ORIENTATION
    a3: Tensor | float = usual_parameter("a₃")
    b3: Tensor | float = usual_parameter("b₃")
    a4: Tensor | float = usual_parameter("a₄")
    b4: Tensor | float = usual_parameter("b₄")


class SpotOnBody(_OfOrientation):
    """a/(1 + (2 sin((θ − θ_0)/2)/w)⁴): one feature of half-width w about θ_0."""

    form: ClassVar[str | None] = "spot"
    formula: ClassVar[str] = "{quantity} ← {quantity} + a/(1 + (2 sin((θ − θ₀)/2)/w)⁴)"
    in_words: ClassVar[str] = "{quantity} changes by {a} about θ = {theta_0}, within ±{w}"
    a: Tensor | float = usual_parameter("a")
    theta_0: Tensor | float = parameter("θ₀", "rad", -4.0, 4.0, vanishing=None, start=0.0)
    w: Tensor | float = parameter("w", "rad", 0.1, 1.5, vanishing=None, start=0.5)

    def change(self, theta: Float[Tensor, "... n"]) -> Float[Tensor, "... n"]:
        away = 2 * (1 - (theta - self.theta_0).cos()) / self.w**2  # squared
        return self.a / (1 + away**2)


# --- Place -------------------------------------------------------------------------------------------------


class _OnSpan(Frozen, ABC):
    """A function of the place u on a span of x, on which u is from −1 to 1.

    The span is left open for `prepare`: the middle nine tenths of the measured places, for single trials far out
    would otherwise bend the functions to themselves.
    """

    span: tuple[float, float] | None = None  # of x in m; None: that of nine tenths of the measurements

    def taken_from(self, impacts: Impacts) -> Self:
        """Return the functions with the span of the impacts where it is open, rounded outwards to 0.1 mm."""
        if self.span is not None:
            return self
        x = impacts.q[:, 0]
        low, high = x.quantile(torch.tensor((0.05, 0.95), dtype=x.dtype, device=x.device)).tolist()
        low, high = round(low - 5e-5, 4), round(high + 5e-5, 4)
        return replace(self, span=(low, max(high, round(low + 1e-4, 4))))  # also where all impacts are at one place

    @abstractmethod
    def over(self, u: Float[Tensor, "... n"]) -> Float[Tensor, "... n"]:
        """Evaluate the function at u [..., N], which may lie beyond the span."""

    def change(self, x: Float[Tensor, "... n"]) -> Float[Tensor, "... n"]:
        """Evaluate the function at x [..., N] in m.

        Raises:
            ContactLearnError: the span is open, empty, or none.
        """
        if not isinstance(self.span, tuple) or len(self.span) != 2 or not self.span[0] < self.span[1]:
            rule = "a span must be [low, high] of x in m with low < high, given or taken by prepare(impacts)"
            raise ContactLearnError(f"{rule}; got {self.span}")
        low, high = self.span
        return self.over((2 * x - low - high) / (high - low))

    def coefficient(self, state: State, value: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        """Return the coefficient with the function of the place added."""
        return value + self.change(state.x)


class AlongFloor(_OnSpan):
    """Σ c_k P_k(u), k = 1 … 5, with Legendre's polynomials; u is the place on the span, or its nearer end."""

    spaces = BOTH
    form: ClassVar[str | None] = "along"
    formula: ClassVar[str] = "{quantity} ← {quantity} + Σ c_k P_k(u), k = 1 … 5, u = x on its span"
    argument: ClassVar[Argument] = PLACE
    c1: Tensor | float = usual_parameter("c₁")
    c2: Tensor | float = usual_parameter("c₂")
    c3: Tensor | float = usual_parameter("c₃")
    c4: Tensor | float = usual_parameter("c₄")
    c5: Tensor | float = usual_parameter("c₅")

    @property
    def equation(self) -> str:
        """The formula, with the span once it is known."""
        if self.span is None:
            return self.formula
        low, high = self.span
        return self.formula.replace("its span", f"{low:g} … {high:g} m")

    def over(self, u: Float[Tensor, "... n"]) -> Float[Tensor, "... n"]:
        u = u.clamp(-1, 1)
        before, now = torch.ones_like(u), u
        total = self.c1 * now
        for k, c in enumerate((self.c2, self.c3, self.c4, self.c5), 2):
            before, now = now, ((2 * k - 1) * u * now - (k - 1) * before) / k
            total = total + c * now
        return total


SHARPNESS = 1.0, 6.0
"""Exponents n of a part of the floor: 1 is a hill of Gauss's form, tape has 4 and more."""
_NEAR = 1e-12  # square of a distance from the middle, in half-spans, below which it makes no difference


def within_part(square: Float[Tensor, "... n"], b: Tensor | float, n: Tensor | float) -> Float[Tensor, "... n"]:
    """Return exp(−(s/b)²ⁿ) of the square of a distance s."""
    return (-(n * (square.clamp_min(_NEAR).log() - torch.as_tensor(b).square().log())).exp()).exp()


class StretchOfFloor(_OnSpan):
    """a exp(−(t/b)²ⁿ) at a distance t = u − d from the middle of a stretch of the floor."""

    spaces = (IN_PLANE,)
    form: ClassVar[str | None] = "stretch"
    formula: ClassVar[str] = "{quantity} ← {quantity} + a exp(−((x − d)/b)²ⁿ)"
    in_words: ClassVar[str] = (
        "{quantity} changes by {a} on a stretch about x = {d}, {b} to each side, edges of sharpness {n}"
    )
    refines: ClassVar[tuple[str, ...]] = (OWN_FAMILY,)
    a: Tensor | float = usual_parameter("a")
    d: Tensor | float = parameter("d", "–", -1.1, 1.1, vanishing=None, start=0.0)
    b: Tensor | float = parameter("b", "–", 0.05, 1.0, vanishing=None, start=0.3)
    n: Tensor | float = parameter("n", "–", *SHARPNESS, vanishing=None, start=3.0)

    @property
    def equation(self) -> str:
        """The formula, and the span once it is known."""
        if self.span is None:
            return self.formula
        low, high = self.span
        return f"{self.formula}, lengths in {(high - low) / 2:g} m about {(low + high) / 2:g} m"

    def in_metres(self, name: str) -> tuple[float, float] | None:
        """Return half the span, and for a place where its zero lies, both in m; None of what is no length."""
        if name not in ("d", "b") or self.span is None:
            return None
        low, high = self.span
        return (high - low) / 2, (low + high) / 2 if name == "d" else 0.0

    def over(self, u: Float[Tensor, "... n"]) -> Float[Tensor, "... n"]:
        return self.a * within_part((u - self.d).square(), self.b, self.n)


# --- Objects -----------------------------------------------------------------------------------------------


class ByBody(Frozen):
    """Differences Δ_j of the objects after the first, whose coefficient is the law's.

    The objects are known once the effect is prepared, so the parameters are too: K − 1 for K objects.  Where there is
    one object, or more than `MOST_OBJECTS`, there is no parameter and the effect changes nothing.
    """

    spaces = BOTH
    source = "materials"
    formula: ClassVar[str] = "{quantity} ← {quantity} + Δ(object), 0 for the first object"
    differences: Tensor | tuple[()] = field(default=(), metadata={"parameter": None})
    objects: tuple[str | float, ...] | None = None  # names; None: those of the measurements

    def __post_init__(self) -> None:
        given = torch.as_tensor(self.differences, dtype=torch.float64)
        object.__setattr__(self, "differences", given if given.numel() else torch.zeros(len(self._others)).double())

    @property
    def _others(self) -> tuple[str | float, ...]:
        """Names of the objects with a difference."""
        return self.objects[1:] if self.objects and len(self.objects) <= MOST_OBJECTS else ()

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """A difference for each object after the first."""
        named = enumerate(self._others, 2)
        return tuple(Parameter(f"d{k}", f"Δ({_written(name)})", "–", -0.5, 0.5) for k, name in named)

    @property
    def values(self) -> tuple[Tensor, ...]:
        """The differences."""
        return torch.as_tensor(self.differences).unbind(-1)

    @property
    def equation(self) -> str:
        """The formula, and the object that the others are compared with."""
        if self.objects is None:
            return self.formula
        if not self._others:
            return f"{self.formula}; undetermined with {len(self.objects)} of them"
        return f"{self.formula}, {_written(self.objects[0])}"

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

    def taken_from(self, impacts: Impacts) -> Self:
        """Return the effect with the names of the objects taken from the impacts where they are open."""
        return self if self.objects is not None else replace(self, objects=tuple(dict.fromkeys(impacts.object)))

    def coefficient(self, state: State, value: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        """Return the coefficient with the difference of each trial's object added, 0 for an unknown object."""
        return value + self.difference(torch.zeros_like(state.mass), state.body)

    def difference(self, total: Float[Tensor, "... n"], codes: Tensor | None) -> Float[Tensor, "... n"]:
        """Add the difference of each trial's object, by its number or `body_code` of its name."""
        for name, difference in zip(self._others, self.values, strict=True):
            code = body_code(name) if isinstance(name, str) else name
            total = total + torch.where(codes == code, difference, 0.0)
        return total


def _written(name: str | float) -> str:
    return name if isinstance(name, str) else f"{name:g}"


# --- Covariates --------------------------------------------------------------------------------------------


class OfCovariate(Frozen):
    """A function of one covariate (`Impacts.covariates`), such as a temperature or an operator.

    A state without covariates, such as that of a roll-out, has the coefficient of the law: that of the first group, or
    of the middle of the measured range.
    """

    spaces = BOTH
    source = "temperature, humidity, material, operator"
    quantity: ClassVar[str]
    formula: ClassVar[str]
    covariate: str = field(kw_only=True)

    def measured(self, impacts: Impacts) -> Tensor | tuple[str, ...]:
        """Return the covariate of each trial.

        Raises:
            DataError: the impacts do not have it.
        """
        if self.covariate not in impacts.covariates:
            known = ", ".join(impacts.covariates) or "none"
            raise DataError(
                f"{impacts.source}: has no covariate {self.covariate!r}{suggest(self.covariate, impacts.covariates)}; "
                f"it has {known}; data.covariates=[{self.covariate}] reads a column"
            )
        return impacts.covariates[self.covariate]

    def _rises(self, parameters: tuple[Parameter, ...], knots: Knots | None) -> tuple[Parameter, ...]:
        """Parameters with symbols that say over which values of the covariate each of them is the rise."""
        if knots is None:
            return parameters
        symbols = (f"Δ{self.quantity}({self.covariate} {low:g} → {high:g})" for low, high in pairwise(knots))
        return tuple(replace(p, symbol=symbol) for p, symbol in zip(parameters, symbols, strict=True))


class LinearInCovariate(OfCovariate):
    """c (u − ū)/Δu over the middle nine tenths, Δu about ū, of the measured values u: c is the change over it."""

    form: ClassVar[str | None] = "linear"
    formula: ClassVar[str] = "{quantity} ← {quantity} + c (u − ū)/Δu"
    c: Tensor | float = usual_parameter("c")
    span: tuple[float, float] | None = None  # of u; None: that of nine tenths of the measurements

    def taken_from(self, impacts: Impacts) -> Self:
        """Return the function with its span taken from the impacts where it is open."""
        values = torch.as_tensor(self.measured(impacts))
        if self.span is not None:
            return self
        knots = _spread(values)
        return replace(self, span=(knots[0], knots[-1]))

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The change over the span, which its symbol says."""
        return self._rises(super().parameters, self.span)  # pyright: ignore[reportAttributeAccessIssue, reportUnknownMemberType, reportUnknownArgumentType]  (of `Effect`)

    @property
    def equation(self) -> str:
        """The formula with the span once it is known."""
        if self.span is None:
            return self.formula
        return f"{self.formula}, u = {self.covariate}, {self.span[0]:g} to {self.span[1]:g}"

    def coefficient(self, state: State, value: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        """Return the coefficient with the function of the covariate added.

        Raises:
            ContactLearnError: the span is open.
        """
        if self.covariate not in state.covariates:
            return value
        if self.span is None or not self.span[0] < self.span[1]:
            raise ContactLearnError(f"a span of {self.covariate} is [low, high], given or taken by prepare(impacts)")
        low, high = self.span
        return value + self.c * (state.covariates[self.covariate] - (low + high) / 2) / (high - low)


class CovariateCurve(OfCovariate, Spline):
    """s(u), a smooth curve over the measured values u."""

    formula: ClassVar[str] = "{quantity} ← {quantity} + s(u), a smooth s that rises by c₁, c₂, c₃ from knot to knot"

    @property
    def argument(self) -> Argument:  # pyright: ignore[reportIncompatibleVariableOverride]  (of this very effect)
        """The covariate as the argument of a curve."""
        return Argument(self.covariate, "–", lambda state: state.covariates[self.covariate])

    def taken_from(self, impacts: Impacts) -> Self:
        """Return the curve with its knots at quantiles of the covariate where they are open."""
        self.measured(impacts)
        return super().taken_from(impacts)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The rises from knot to knot, as their symbols say."""
        return self._rises(super().parameters, self.knots)  # pyright: ignore[reportAttributeAccessIssue, reportUnknownMemberType, reportUnknownArgumentType]  (of `Effect`)

    def coefficient(self, state: State, value: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        """Return the coefficient with s(u) added."""
        return super().coefficient(state, value) if self.covariate in state.covariates else value


class ByGroup(OfCovariate, ByBody):
    """Differences Δ_j of the groups of a covariate after the first, named or few distinct numbers."""

    form: ClassVar[str | None] = "group"
    formula: ClassVar[str] = "{quantity} ← {quantity} + Δ(group), 0 for the first group"

    def taken_from(self, impacts: Impacts) -> Self:
        """Return the effect with the groups taken from the impacts where they are open."""
        values = self.measured(impacts)
        if self.objects is not None:
            return self
        return replace(self, objects=tuple(dict.fromkeys(values.tolist() if isinstance(values, Tensor) else values)))

    def coefficient(self, state: State, value: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        """Return the coefficient with the difference of each trial's group added, 0 for an unknown group."""
        if self.covariate not in state.covariates:
            return value
        return value + self.difference(torch.zeros_like(state.mass), state.covariates[self.covariate])
