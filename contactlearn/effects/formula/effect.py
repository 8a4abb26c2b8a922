"""An effect of your own as lines of mathematics, in the configuration or in Python.

    +effect.mine.tau="-c*rx*Pn"  +effect.mine.parameters.c=[-1,1]

    formula(tau="-c*rx*Pn", parameters={"c": {"low": -1, "high": 1, "unit": "–"}})

The value of an expression is added to the output that it is given for; the outputs decide the place:

    state       rx, ry m; theta rad, with which the contact point moves, so the body's shape must be known
    law         mu, eps
    wrench      Pt, Pn N s; tau N m s
    velocity    vx_post, vy_post m/s; omega_post rad/s

In space they are rx, ry, rz; mu, eps; P1, P2, Pn, tau1, tau2, taun in the axes of the slip, 1 along it and 2 across it;
vx_post, vy_post, vz_post, wx_post, wy_post, wz_post.  A formula exists in the spaces that have all of its names.

`contactlearn.effects.formula.symbols` lists the symbols of an expression, `contactlearn.effects.formula.expression`
its operations.  A parameter is [low, high], or these by name with a unit, a symbol, a start, and the value where the
effect vanishes: 0 if left out, null if another parameter makes it vanish.  Several outputs of one place are computed
from the same state and added at once.
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
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.errors import ContactLearnError, UnknownNameError
from contactlearn.core.frozen import Frozen
from contactlearn.effects.base import Effect, Parameter, require_shape
from contactlearn.effects.checks import named_outputs, violations
from contactlearn.effects.formula.expression import CONSTANTS, FUNCTIONS, Expression
from contactlearn.effects.formula.symbols import FORMULA_OUTPUTS, KNOWN, at_place, symbols
from contactlearn.effects.state import Coefficients, State, columns
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import matvec, slip_axes
from contactlearn.mechanics.space import BOTH, PLANE, SPACE, Space, require_space

_KEYS = ("low", "high", "unit", "vanishing", "start", "symbol")


@dataclass(frozen=True, kw_only=True)
class Declaration:
    """Expressions by output, all of one place, and the parameters that they use."""

    lines: Mapping[str, Expression]
    parameters: tuple[Parameter, ...]
    spaces: tuple[Space, ...] = BOTH

    @classmethod
    def read(cls, place: str, expressions: Mapping[str, str], declared: Mapping[str, Any]) -> Self:
        """Read text by output and parameters by name; see the module.

        Raises:
            ContactLearnError: an output of another place, an expression that cannot be read, a name that is neither
                a symbol of this place nor a parameter, or a parameter that is not used or whose numbers are not
                sensible.
        """
        place_of_outputs(expressions, place)
        if not isinstance(declared, Mapping) or not declared:
            raise ContactLearnError(
                f"a formula needs a parameter that is fitted, got {declared!r}; write such as parameters.c=[-1, 1]"
            )
        parameters = tuple(_parameter(name, given) for name, given in declared.items())
        lines = {output: Expression(text) for output, text in expressions.items()}
        spaces = [space for space in BOTH if {*lines} <= {*FORMULA_OUTPUTS[space][place]}]
        used = set[str]().union(*(_names(place, o, line, declared, spaces or BOTH) for o, line in lines.items()))
        spaces = tuple(space for space in spaces if used <= {*declared, *at_place(place, [space])})
        if not spaces:
            names = ", ".join(dict.fromkeys([*lines, *used - {*declared}]))
            raise ContactLearnError(f"names of a formula must be all of the plane, or all of space, got {names}")
        read = cls(lines=lines, parameters=parameters, spaces=spaces)
        for name in declared:
            if name not in used:
                raise ContactLearnError(
                    f"parameter {name} is not used in {read.equation}; use it in an expression or leave it out"
                )
        return read

    @property
    def equation(self) -> str:
        """Text such as τ ← τ + (-c*rx*Pn)."""
        letters = {output: KNOWN[self.spaces[0]][output].letter for output in self.lines}
        return ", ".join(f"{letters[o]} ← {letters[o]} + ({line.text})" for o, line in self.lines.items())

    @property
    def declared(self) -> dict[str, dict[str, Any]]:
        """The parameters as plain numbers and text, complete."""
        keys = ("symbol", "unit", "low", "high", "vanishing", "start")
        return {p.name: {key: getattr(p, key) for key in keys} for p in self.parameters}


def place_of_outputs(expressions: Mapping[str, str], wanted: str | None = None) -> str:
    """Return the one place of the outputs, which must be the wanted one if there is one.

    Raises:
        UnknownNameError: no such output.
        ContactLearnError: no outputs, outputs of several places, or of another place than the wanted one.
    """
    place_of = {output: place for space in BOTH for place, units in FORMULA_OUTPUTS[space].items() for output in units}
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


def _names(
    place: str, output: str, line: Expression, declared: Mapping[str, Any], spaces: Sequence[Space]
) -> Mapping[str, int]:
    """Names of an expression, all of them symbols of its place or parameters."""
    known = at_place(place, spaces)
    for name, column in line.names.items():
        elsewhere = next((KNOWN[space][name].places for space in spaces if name in KNOWN[space]), ())
        if elsewhere and name not in known:
            places = ", ".join(elsewhere)
            raise line.error(column, f"{name} is known only at {places}, and an effect on {output} acts at {place}")
    line.require([*declared, *known], "symbol or parameter")
    return line.names


def _parameter(name: str, given: Any) -> Parameter:
    """A parameter with its start, symbol and unit, checked."""
    _check_name(name)
    given = _entries(name, given)
    low, high = (_number(name, key, given[key]) for key in ("low", "high"))
    if not low < high:
        raise ContactLearnError(f"parameter {name} must have low < high, got [{low:g}, {high:g}]; swap them?")
    vanishing = given.get("vanishing", 0.0)
    vanishing = None if vanishing is None else _number(name, "vanishing", vanishing)
    start = given.get("start")
    middle = (low + high) / 2 if vanishing is None else vanishing
    start = middle if start is None else _number(name, "start", start)
    for key, value in (("vanishing", vanishing), ("start", start)):
        if value is not None and not low <= value <= high:
            raise ContactLearnError(
                f"parameter {name} must have {key} in [{low:g}, {high:g}], got {value:g}; widen the range, or say "
                "vanishing: null if another parameter makes the effect vanish"
            )
    texts = {key: given.get(key, default) for key, default in (("symbol", name), ("unit", "–"))}
    for key, text in texts.items():
        if not isinstance(text, str) or not text.isprintable():
            raise ContactLearnError(f"{key} of parameter {name} must be text, got {text!r}; write it in quotes")
    return Parameter(name, **texts, low=low, high=high, vanishing=vanishing, start=start)


def _check_name(name: Any) -> None:
    """Refuse a parameter's name that an expression could not hold, or that means something else there."""
    if not isinstance(name, str) or not re.fullmatch(r"[A-Za-z]\w{0,29}", name, re.ASCII) or keyword.iskeyword(name):
        raise ContactLearnError(f"a parameter's name is up to 30 letters, digits and _, got {name!r}; such as c or k_1")
    every = {name for space in BOTH for name in KNOWN[space]}
    for kind, taken in (("symbol", every), ("function", FUNCTIONS), ("constant", CONSTANTS)):
        if name in taken:
            raise ContactLearnError(f"a parameter must not have the name of a {kind}, got {name!r}; such as c_{name}")


def _entries(name: str, given: Any) -> Mapping[str, Any]:
    """The entries of a parameter by key, from [low, high] or a mapping."""
    if isinstance(given, Sequence) and not isinstance(given, str) and len(given) == 2:
        given = {"low": given[0], "high": given[1]}
    if not isinstance(given, Mapping) or not {"low", "high"} <= set(given):
        raise ContactLearnError(f"parameter {name} must be [low, high], or have low: and high:, got {given!r}")
    for key in given:
        if key not in _KEYS:
            raise UnknownNameError(f"entry of parameter {name}", key, _KEYS)
    return given


def _number(name: str, key: str, value: Any) -> float:
    try:
        number = math.nan if isinstance(value, bool | str) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise ContactLearnError(f"{key} of parameter {name} must be a finite number, got {value!r}")
    return number


class _Formula(Frozen):
    """Part of a formula effect that the four places share.

    Args:
        expressions: text by output, all of one place.
        declared: parameters by name, see the module.
        current: their values; their starts if left out.

    Raises:
        ContactLearnError: see `Declaration.read`.
    """

    name: ClassVar[str]
    place: ClassVar[str]
    formula: ClassVar[str] = "output ← output + (expression), for each output"
    source: ClassVar[str] = "yours"
    mirror_symmetric: ClassVar[bool] = False  # as far as anyone knows
    adds_energy: ClassVar[bool] = True
    spaces: ClassVar[tuple[Space, ...]] = BOTH

    expressions: Mapping[str, str]
    declared: Mapping[str, Any]
    current: tuple[Tensor | float, ...] = field(default=(), repr=False)

    def __post_init__(self) -> None:
        read = self.read
        completed = {
            "expressions": dict(self.expressions),
            "declared": read.declared,
            "current": self.current or tuple(p.start for p in read.parameters),
            "needs_shape": "theta" in self.expressions,  # of this formula alone
            "spaces": read.spaces,
        }
        for name, value in completed.items():
            object.__setattr__(self, name, value)

    @cached_property
    def read(self) -> Declaration:
        """The expressions and the parameters once they have been read; `at` reads nothing again."""
        return Declaration.read(self.place, self.expressions, self.declared)

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The declared parameters."""
        return self.read.parameters

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
        """Text such as τ ← τ + (-c*rx*Pn)."""
        return self.read.equation

    def at(self, values: Float[Tensor, "... k"] | Sequence[Tensor | float]) -> Self:
        """Return the effect with values [..., K] of its K parameters; they broadcast against [..., N].

        Raises:
            ContactLearnError: another number of values.
        """
        parts = tuple(values.unbind(-1) if isinstance(values, Tensor) else values)
        if len(parts) != len(self.declared):
            raise ContactLearnError(f"{self.equation} has {len(self.declared)} parameters, got {len(parts)} values")
        moved = copy.copy(self)  # with all that has been read
        object.__setattr__(moved, "current", parts)
        return moved

    def prepare(self, impacts: Impacts) -> Self:
        """Return the effect itself, once it has been tried on the measurements.

        Raises:
            ContactLearnError: it adds something where it should vanish, or it or its derivative in a parameter
                is not finite at the start.
            DataError: it needs the body's shape, and that is not known.
        """
        require_space(f"the formula {self.equation}", impacts.space, self.spaces)
        if "theta" in self.expressions:
            require_shape(self.name, impacts)
        assert isinstance(self, Effect)  # as every class that this is a part of
        for broken in violations(self, impacts):
            raise ContactLearnError(f"the formula {self.equation} {broken}")
        return self

    def added(self, state: State, so_far: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Evaluate the expression [..., N] of each output, from the outputs of the place so far."""
        names = dict.fromkeys(n for line in self.read.lines.values() for n in line.names if n not in self.declared)
        known = symbols(state, names, self.place, so_far) | dict(zip(self.declared, self.values, strict=True))
        return {output: line.evaluate(known) for output, line in self.read.lines.items()}

    def changed(self, state: State, so_far: Mapping[str, Tensor]) -> tuple[Tensor, ...]:
        """Return all outputs of the place, with the expressions added to some of them."""
        added = self.added(state, so_far)
        return tuple(value + added[name] if name in added else value for name, value in so_far.items())


class StateFormula(_Formula, Effect):
    """r or θ is another one than was measured; with θ the contact point moves (`orientation_offset`)."""

    def state(self, state: State) -> State:
        added = self.added(state, {})
        if "theta" in added:
            state = state.turned(added["theta"])
        if added.keys() - {"theta"}:
            r = zip(state.r.unbind(-1), state.space.position, strict=True)
            state = state.replace(r=columns(*(part + added.get(name, 0.0) for part, name in r)))
        return state


class LawFormula(_Formula, Effect):
    """μ or ε of the law is a function of the state."""

    def law(self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."]) -> Coefficients:
        mu, eps = self.changed(state, {"mu": mu, "eps": eps})
        return mu, eps


class WrenchFormula(_Formula, Effect):
    """An impulse or a moment is added to the wrench of the law."""

    def wrench(self, state: State, wrench: Float[Tensor, "... n D"]) -> Float[Tensor, "... n D"]:
        if state.space is PLANE:
            return columns(*self.changed(state, named_outputs("wrench", wrench)))
        axes = slip_axes(state.W, state.v_c)
        so_far = dict(zip(FORMULA_OUTPUTS[SPACE]["wrench"], matvec(axes.mT, wrench).unbind(-1), strict=True))
        added, none = self.added(state, so_far), wrench.new_zeros(())
        return wrench + matvec(axes, columns(*(added.get(name, none) for name in so_far)))


class VelocityFormula(_Formula, Effect):
    """The velocity changes between contact and the second measurement."""

    def velocity(self, state: State, v_post: Float[Tensor, "... n D"]) -> Float[Tensor, "... n D"]:
        return columns(*self.changed(state, named_outputs("velocity", v_post)))


_CLASSES = {kind.place: kind for kind in (StateFormula, LawFormula, WrenchFormula, VelocityFormula)}


def formula(parameters: Mapping[str, Any] | None = None, **expressions: str) -> Effect:
    """Return an effect from expressions by output and its parameters by name; see the module.

    Raises:
        UnknownNameError: no such output.
        ContactLearnError: outputs of several places or none, or an error of `Declaration.read`.
    """
    return _CLASSES[place_of_outputs(expressions)](expressions, parameters or {})
