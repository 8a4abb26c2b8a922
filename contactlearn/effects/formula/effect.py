"""An effect of your own as lines of mathematics, in the configuration or in Python.

    +effect.mine.tau="-c*rx*Pn"  +effect.mine.parameters.c=[-1,1]

    formula(tau="-c*rx*Pn", parameters={"c": {"low": -1, "high": 1, "unit": "–"}})

The value of an expression is added to the output that it is given for; the outputs decide the place:

    state       rx, ry m; theta rad, with which the contact point moves, so the body's shape must be known
    law         mu, eps
    wrench      Pt, Pn N s; tau N m s
    velocity    vx_post, vy_post m/s; omega_post rad/s

`contactlearn.effects.formula.symbols` lists what an expression may speak of, `contactlearn.effects.formula.expression`
what it may do with it.  Several outputs of one place are computed from the same state and added at once.
A parameter is [low, high], or these by name with a unit, a symbol, a start, and the value where the
effect vanishes: 0 if left out, null if another parameter makes it vanish.
"""

import copy
import keyword
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, Self

import torch
from torch import Tensor

from contactlearn.effects.base import Effect, Parameter
from contactlearn.effects.formula.expression import CONSTANTS, FUNCTIONS, Expression
from contactlearn.effects.formula.symbols import OUTPUTS, SYMBOLS, at_place, symbols
from contactlearn.effects.state import State, columns
from contactlearn.errors import ContactLearnError, UnknownNameError
from contactlearn.impacts import Impacts

_KEYS = ("low", "high", "unit", "vanishing", "start", "symbol")


@dataclass(frozen=True, eq=False)
class _Formula:
    """What the four places share.

    Args:
        expressions: text by output, all of one place.
        declared: parameters by name, see the module.
        current: their values; their starts if left out.

    Raises:
        ContactLearnError: an output of another place, an expression that cannot be read, a name that is neither a
            symbol of this place nor a parameter, or a parameter that is not used or whose numbers are not sensible.
    """

    place: ClassVar[str]
    formula: ClassVar[str] = "output ← output + (expression), for each output"
    source: ClassVar[str] = "yours"
    mirror_symmetric: ClassVar[bool] = False  # as far as anyone knows
    adds_energy: ClassVar[bool] = True

    expressions: Mapping[str, str]
    declared: Mapping[str, Any]
    current: tuple[Tensor | float, ...] = field(default=(), repr=False)

    def __post_init__(self):
        _check_outputs(self.expressions, self.place)
        if not isinstance(self.declared, Mapping) or not self.declared:
            raise ContactLearnError(
                f"a formula needs a parameter that is fitted, got {self.declared!r}; write such as parameters.c=[-1, 1]"
            )
        own = {
            "expressions": dict(self.expressions),
            "declared": {name: _declaration(name, given) for name, given in self.declared.items()},
            "needs_shape": "theta" in self.expressions,  # of this formula alone
        }
        for name, value in own.items():
            object.__setattr__(self, name, value)
        used = {name for output, line in self.lines.items() for name in self._names(output, line)}
        for name in self.declared:
            if name not in used:
                raise ContactLearnError(
                    f"parameter {name} is not used in {self.equation}; use it in an expression or leave it out"
                )
        if not self.current:
            object.__setattr__(self, "current", tuple(p.start for p in self.parameters))

    def _names(self, output: str, line: Expression) -> Mapping[str, int]:
        """Names of an expression, all of them symbols of this place or parameters."""
        for name, column in line.names.items():
            if name in SYMBOLS and self.place not in SYMBOLS[name].places:
                places = ", ".join(SYMBOLS[name].places)
                rule = f"{name} is known only at {places}, and an effect on {output} acts at {self.place}"
                raise line.error(column, rule)
        line.require([*self.declared, *at_place(self.place)], "symbol or parameter")
        return line.names

    @cached_property
    def lines(self) -> dict[str, Expression]:
        """The expressions as they were read, by output."""
        return {output: Expression(text) for output, text in self.expressions.items()}

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """The declared ones."""
        return tuple(Parameter(name, **declaration) for name, declaration in self.declared.items())

    @property
    def values(self) -> tuple[Tensor, ...]:
        """Values of the parameters."""
        return tuple(torch.as_tensor(value, dtype=torch.float64) for value in self.current)

    @property
    def options(self) -> dict[str, Any]:
        """The expressions and the declared parameters: plain numbers, text and dictionaries of them."""
        return copy.deepcopy({"expressions": self.expressions, "declared": self.declared})

    @property
    def equation(self) -> str:
        """Such as τ ← τ + (-c*rx*Pn)."""
        letters = {output: SYMBOLS[output].letter for output in self.expressions}
        return ", ".join(f"{letters[o]} ← {letters[o]} + ({line.text})" for o, line in self.lines.items())

    def at(self, values: Tensor | Sequence[float]) -> Self:
        """The effect with values [..., K] of its K parameters; they broadcast against [..., N]."""
        parts = tuple(values.unbind(-1) if isinstance(values, Tensor) else values)
        if len(parts) != len(self.declared):
            raise ContactLearnError(f"{self.equation} has {len(self.declared)} parameters, got {len(parts)} values")
        changed = copy.copy(self)  # nothing else has to be read again
        object.__setattr__(changed, "current", parts)
        return changed

    def prepare(self, impacts: Impacts) -> Self:
        """The effect itself, once it has been tried on the measurements.

        Raises:
            ContactLearnError: it adds something where it should vanish, or it or its derivative in a parameter
                is not finite at the start.
            DataError: it needs the body's shape, and that is not known.
        """
        Effect.prepare(self, impacts)
        state, so_far = _measured(impacts, self.place)
        start = torch.tensor([[p.start] for p in self.parameters], dtype=torch.float64).repeat(1, len(impacts))
        with torch.enable_grad():
            tried = self.at([value.requires_grad_() for value in start.unbind()])
            for output, value in tried.added(state, so_far).items():
                slopes = torch.autograd.grad(value.sum(), tried.current, allow_unused=True)
                self._refuse_infinite(impacts, output, "value", value)
                for p, slope in zip(self.parameters, slopes, strict=True):
                    if slope is not None:
                        self._refuse_infinite(impacts, output, f"derivative in {p.name}", slope)
        for share in (None, 0.25, 0.75):  # whatever the values of those that need not vanish
            self._refuse_lasting(impacts, self._vanished(share), state, so_far)
        return self

    def _vanished(self, share: float | None) -> Self:
        """The effect where it vanishes; what need not vanish at its start, or a share of its range from its low."""
        free = (p.start if share is None else p.low + share * (p.high - p.low) for p in self.parameters)
        return self.at([f if p.vanishing is None else p.vanishing for f, p in zip(free, self.parameters, strict=True)])

    def _refuse_lasting(self, impacts: Impacts, vanished: Self, state: State, so_far: Mapping[str, Tensor]) -> None:
        for output, value in vanished.added(state, so_far).items():
            self._refuse_infinite(impacts, output, "value where it should vanish", value)
            if value.any():
                at = ", ".join(f"{p.name} = {v:g}" for p, v in zip(self.parameters, vanished.current, strict=True))
                raise ContactLearnError(
                    f"an effect must change nothing where it vanishes, and at {at} {self.expressions[output]!r} adds "
                    f"up to {value.abs().max():g} {SYMBOLS[output].unit} to {output}; a factor is missing that is 0 "
                    "there, or a parameter's vanishing value is another one"
                )

    def _refuse_infinite(self, impacts: Impacts, output: str, what: str, value: Tensor) -> None:
        bad = ~value.detach().isfinite().broadcast_to(len(impacts))
        if bad.any():
            row = int(bad.nonzero()[0, 0])
            seen = value.detach().broadcast_to(len(impacts))[row].item()
            raise ContactLearnError(
                f"the formula {self.expressions[output]!r} of {output} has the {what} {seen:g} on trial "
                f"{impacts.trial[row]!r} of {impacts.source} ({int(bad.sum())} of {len(impacts)} trials); is it a "
                "root, logarithm or power of a negative number or of 0, or should a parameter start elsewhere?"
            )

    def added(self, state: State, so_far: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """What comes on top of each output [..., N], from the outputs of the place so far."""
        names = dict.fromkeys(name for line in self.lines.values() for name in line.names if name in SYMBOLS)
        known = symbols(state, names, self.place, so_far) | dict(zip(self.declared, self.values, strict=True))
        return {output: line.evaluate(known) for output, line in self.lines.items()}

    def changed(self, state: State, so_far: Mapping[str, Tensor]) -> tuple[Tensor, ...]:
        """All outputs of the place with what is added to some of them."""
        added = self.added(state, so_far)
        return tuple(value + added[name] if name in added else value for name, value in so_far.items())


@dataclass(frozen=True, eq=False)
class StateFormula(_Formula, Effect):
    """r_x, r_y or θ is another one than was measured; with θ the contact point moves (`orientation_offset`)."""

    def state(self, state: State) -> State:
        added = self.added(state, {})
        if "theta" in added:
            state = state.turned(added["theta"])
        if "rx" in added or "ry" in added:
            state = state.replace(r=columns(*(state.r[..., i] + added.get(n, 0.0) for i, n in enumerate(("rx", "ry")))))
        return state


@dataclass(frozen=True, eq=False)
class LawFormula(_Formula, Effect):
    """μ or ε of the law is a function of the state."""

    def law(self, state: State, mu: Tensor, eps: Tensor) -> tuple[Tensor, Tensor]:
        mu, eps = self.changed(state, {"mu": mu, "eps": eps})
        return mu, eps


@dataclass(frozen=True, eq=False)
class WrenchFormula(_Formula, Effect):
    """An impulse or a moment comes on top of what the law has given."""

    def wrench(self, state: State, wrench: Tensor) -> Tensor:
        return columns(*self.changed(state, _named("wrench", wrench)))


@dataclass(frozen=True, eq=False)
class VelocityFormula(_Formula, Effect):
    """The velocity changes between contact and the second measurement."""

    def velocity(self, state: State, v_post: Tensor) -> Tensor:
        return columns(*self.changed(state, _named("velocity", v_post)))


_CLASSES: dict[str, type[_Formula]] = {
    cls.place: cls for cls in (StateFormula, LawFormula, WrenchFormula, VelocityFormula)
}


def formula(parameters: Mapping[str, Any] | None = None, **expressions: str) -> Effect:
    """An effect from expressions by output and its parameters by name; see the module.

    Raises:
        UnknownNameError: no such output.
        ContactLearnError: outputs of several places or none, or what the effect itself refuses.
    """
    return _CLASSES[_check_outputs(expressions)](expressions, parameters or {})


def _check_outputs(expressions: Mapping[str, str], wanted: str | None = None) -> str:
    """The one place of the outputs, which must be the wanted one if there is one."""
    place_of = {output: place for place, outputs in OUTPUTS.items() for output in outputs}
    if not isinstance(expressions, Mapping) or not expressions:
        raise ContactLearnError(
            f'a formula needs an output, got {expressions!r}; write such as tau="-c*rx*Pn", for {", ".join(place_of)}'
        )
    for output in expressions:
        if output not in place_of:
            raise UnknownNameError("output of a formula", output, [*place_of, "parameters"])
    places = {place_of[output] for output in expressions}
    if len(places) > 1 or places != {wanted or place_of[next(iter(expressions))]}:
        seen = ", ".join(f"{output} of the {place_of[output]}" for output in expressions)
        rule = f"must be of the {wanted}" if wanted else "must be of one place"
        raise ContactLearnError(f"the outputs of a formula {rule}, got {seen}; make an effect for each place")
    return places.pop()


def _declaration(name: str, given: Any) -> dict[str, Any]:
    """What a parameter is, complete and checked."""
    if not isinstance(name, str) or not re.fullmatch(r"[A-Za-z]\w{0,29}", name, re.ASCII) or keyword.iskeyword(name):
        raise ContactLearnError(f"a parameter's name is up to 30 letters, digits and _, got {name!r}; such as c or k_1")
    for kind, taken in (("symbol", SYMBOLS), ("function", FUNCTIONS), ("constant", CONSTANTS)):
        if name in taken:
            raise ContactLearnError(f"a parameter must not have the name of a {kind}, got {name!r}; such as c_{name}")
    if isinstance(given, Sequence) and not isinstance(given, str) and len(given) == 2:
        given = {"low": given[0], "high": given[1]}
    if not isinstance(given, Mapping) or not {"low", "high"} <= set(given):
        raise ContactLearnError(f"parameter {name} must be [low, high], or have low: and high:, got {given!r}")
    for key in given:
        if key not in _KEYS:
            raise UnknownNameError(f"entry of parameter {name}", key, _KEYS)
    low, high = (_number(name, key, given[key]) for key in ("low", "high"))
    if not low < high:
        raise ContactLearnError(f"parameter {name} must have low < high, got [{low:g}, {high:g}]; swap them?")
    vanishing = given.get("vanishing", 0.0)
    vanishing = None if vanishing is None else _number(name, "vanishing", vanishing)
    start = given.get("start")
    usual = (low + high) / 2 if vanishing is None else vanishing
    start = usual if start is None else _number(name, "start", start)
    for key, value in (("vanishing", vanishing), ("start", start)):
        if value is not None and not low <= value <= high:
            raise ContactLearnError(
                f"parameter {name} must have {key} in [{low:g}, {high:g}], got {value:g}; widen the range, or say "
                "vanishing: null if another parameter makes the effect vanish"
            )
    texts = {key: given.get(key, usual) for key, usual in (("symbol", name), ("unit", "–"))}
    for key, text in texts.items():
        if not isinstance(text, str) or not text.isprintable():
            raise ContactLearnError(f"{key} of parameter {name} must be text, got {text!r}; write it in quotes")
    return texts | {"low": low, "high": high, "vanishing": vanishing, "start": start}


def _number(name: str, key: str, value: Any) -> float:
    try:
        number = math.nan if isinstance(value, bool | str) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise ContactLearnError(f"{key} of parameter {name} must be a finite number, got {value!r}")
    return number


def _named(place: str, parts: Tensor) -> dict[str, Tensor]:
    return dict(zip(OUTPUTS[place], parts.unbind(-1), strict=True))


def _measured(impacts: Impacts, place: str) -> tuple[State, dict[str, Tensor]]:
    """The measurements as an effect of that place sees them, with coefficients in the middle of what they can be."""
    middle = torch.full_like(impacts.mass, 0.5)
    state = State.of(impacts).replace(mu=middle, eps=middle)
    parts = {"wrench": impacts.wrench, "velocity": impacts.v_post}
    if place == "law":
        return state, {"mu": middle, "eps": middle}
    return state, _named(place, parts[place]) if place in parts else {}
