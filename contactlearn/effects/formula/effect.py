"""An effect of your own as lines of mathematics, in the configuration or in Python.

    +effect.mine.tau="-c*rx*Pn"  +effect.mine.parameters.c=[-1,1]

    formula(tau="-c*rx*Pn", parameters={"c": {"low": -1, "high": 1, "unit": "–"}})

The value of an expression is added to the output that it is given for; the outputs decide the place:

    state       rx, ry m; theta rad, with which the contact point moves, so the body's shape must be known
    law         mu, eps
    wrench      Pt, Pn N s; tau N m s
    velocity    vx_post, vy_post m/s; omega_post rad/s

`contactlearn.effects.formula.symbols` lists the symbols of an expression, `contactlearn.effects.formula.expression`
its operations, `contactlearn.effects.formula.declaration` the entries of a parameter.  Several outputs of one place
are computed from the same state and added at once.
"""

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, Self

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.errors import ContactLearnError
from contactlearn.effects.base import Effect, Parameter, require_shape
from contactlearn.effects.checks import named_outputs, violations
from contactlearn.effects.formula.declaration import Declaration, place_of_outputs
from contactlearn.effects.formula.symbols import SYMBOLS, symbols
from contactlearn.effects.state import Coefficients, State, columns
from contactlearn.mechanics.impacts import Impacts


@dataclass(frozen=True, eq=False)
class _Formula:
    """What the four places share.

    Args:
        expressions: text by output, all of one place.
        declared: parameters by name, see `declaration`.
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

    expressions: Mapping[str, str]
    declared: Mapping[str, Any]
    current: tuple[Tensor | float, ...] = field(default=(), repr=False)

    def __post_init__(self) -> None:
        read = self.read
        own = {
            "expressions": dict(self.expressions),
            "declared": read.declared,
            "current": self.current or tuple(p.start for p in read.parameters),
            "needs_shape": "theta" in self.expressions,  # of this formula alone
        }
        for name, value in own.items():
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
        if "theta" in self.expressions:
            require_shape(self.name, impacts)
        for broken in violations(self, impacts):
            raise ContactLearnError(f"the formula {self.equation} {broken}")
        return self

    def added(self, state: State, so_far: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Evaluate the expression [..., N] of each output, from the outputs of the place so far."""
        names = dict.fromkeys(name for line in self.read.lines.values() for name in line.names if name in SYMBOLS)
        known = symbols(state, names, self.place, so_far) | dict(zip(self.declared, self.values, strict=True))
        return {output: line.evaluate(known) for output, line in self.read.lines.items()}

    def changed(self, state: State, so_far: Mapping[str, Tensor]) -> tuple[Tensor, ...]:
        """Return all outputs of the place, with the expressions added to some of them."""
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

    def law(self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."]) -> Coefficients:
        mu, eps = self.changed(state, {"mu": mu, "eps": eps})
        return mu, eps


@dataclass(frozen=True, eq=False)
class WrenchFormula(_Formula, Effect):
    """An impulse or a moment is added to the wrench of the law."""

    def wrench(self, state: State, wrench: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
        return columns(*self.changed(state, named_outputs("wrench", wrench)))


@dataclass(frozen=True, eq=False)
class VelocityFormula(_Formula, Effect):
    """The velocity changes between contact and the second measurement."""

    def velocity(self, state: State, v_post: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
        return columns(*self.changed(state, named_outputs("velocity", v_post)))


_CLASSES = {kind.place: kind for kind in (StateFormula, LawFormula, WrenchFormula, VelocityFormula)}


def formula(parameters: Mapping[str, Any] | None = None, **expressions: str) -> Effect:
    """Return an effect from expressions by output and its parameters by name; see the module.

    Raises:
        UnknownNameError: no such output.
        ContactLearnError: outputs of several places or none, or an error of `Declaration.read`.
    """
    return _CLASSES[place_of_outputs(expressions)](expressions, parameters or {})
