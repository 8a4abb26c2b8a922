"""The seam: a physical effect is a small frozen dataclass that acts at one of four places.

    state(state)              what was measured or assumed before contact
    law(state, mu, eps)       the coefficients of the law become functions
    wrench(state, wrench)     (P_t, P_n, τ) after the law has resolved the contact
    velocity(state, v_post)   what happens between contact and the second measurement, in world axes

It overrides one of these methods and declares its parameters as fields:

    @dataclass(frozen=True)
    class SpinDamping(Effect):
        \"\"\"A moment against the spin … It is not rolling resistance.\"\"\"

        formula = "τ ← τ − c I ω⁺"
        c: Tensor | float = parameter("c", "–", 0.0, 1.0)

        def wrench(self, state, wrench): …

Everything else follows from that: fitting, standard errors, curves, tables, the configuration.  At
its vanishing values an effect changes nothing, to the last bit; `contactlearn.testing` holds it to that and
more.  In a method a parameter broadcasts against [..., N], one value a trial: `columns` puts parts side by side.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar

import torch
from torch import Tensor

from contactlearn.effects.state import State
from contactlearn.errors import ContactLearnError, DataError, UnknownNameError
from contactlearn.impacts import Impacts

PLACES = ("state", "law", "wrench", "velocity")


@dataclass(frozen=True)
class Parameter:
    """A number of an effect: where it is plausible, and where the effect vanishes.

    `vanishing` is None for one that need not vanish because another does; `start` is then a typical value.
    """

    name: str
    symbol: str
    unit: str
    low: float
    high: float
    vanishing: float | None = 0.0
    start: float = 0.0
    form: str | None = None


def parameter(
    symbol: str,
    unit: str,
    low: float,
    high: float,
    *,
    vanishing: float | None = 0.0,
    start: float | None = None,
    form: str | None = None,
) -> Any:
    """Field of an effect that is fitted; `form` names the form of the effect that has it, None all of them."""
    start = vanishing if start is None else start
    declared = {"symbol": symbol, "unit": unit, "low": low, "high": high, "vanishing": vanishing}
    return field(default=start, metadata={"parameter": declared | {"start": start, "form": form}})


class Effect:
    """Base of all effects; see the module."""

    formula: ClassVar[str | dict[str, str]]
    """What it does, in the letters of the documentation; by form where there are several."""
    source: ClassVar[str] = ""
    """Where the idea comes from."""
    mirror_symmetric: ClassVar[bool] = True
    """Whether the mirror image of an impact has the mirror image of its outcome at the same parameters."""
    adds_energy: ClassVar[bool] = False
    """Whether the body may leave with more kinetic energy than it was measured to bring."""
    needs_shape: ClassVar[bool] = False
    """Whether the body's shape must be known."""
    last: ClassVar[bool] = False
    """Whether it acts after the others of its place, because it depends on what they change."""

    def __init_subclass__(cls, **kwargs):
        super().__init_subclass__(**kwargs)
        overridden = [place for place in PLACES if place in cls.__dict__]
        if len(overridden) != 1:
            raise TypeError(f"{cls.__name__} must override one of {', '.join(PLACES)}, not {overridden or 'none'}")
        cls.place = overridden[0]
        cls.name = re.sub(r"(?<!^)(?=[A-Z])", "_", cls.__name__).lower()

    place: ClassVar[str]
    name: ClassVar[str]

    def __post_init__(self):
        if isinstance(self.formula, dict) and self.form not in self.formula:
            raise UnknownNameError(f"form of {self.name}", self.form, self.formula)
        for f in fields(self):
            if "parameter" in f.metadata:
                object.__setattr__(self, f.name, torch.as_tensor(getattr(self, f.name), dtype=torch.float64))

    def state(self, state: State) -> State:
        """The state as it really is, from the state as it was measured."""
        raise NotImplementedError

    def law(self, state: State, mu: Tensor, eps: Tensor) -> tuple[Tensor, Tensor]:
        """(μ, ε) of each impact [..., N]; whatever leaves μ ≥ 0 and 0 ≤ ε ≤ 1 is cut off afterwards."""
        raise NotImplementedError

    def wrench(self, state: State, wrench: Tensor) -> Tensor:
        """The wrench [..., N, 3] in (N s, N s, N m s), in contact axes."""
        raise NotImplementedError

    def velocity(self, state: State, v_post: Tensor) -> Tensor:
        """v_post [..., N, 3] in (m/s, m/s, rad/s) as it was measured."""
        raise NotImplementedError

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """What is fitted, in the order of the fields."""
        form = getattr(self, "form", None)
        declared = [Parameter(f.name, **f.metadata["parameter"]) for f in fields(self) if "parameter" in f.metadata]
        return tuple(p for p in declared if p.form in (None, form))

    @property
    def equation(self) -> str:
        """The formula of the form in use."""
        return self.formula[self.form] if isinstance(self.formula, dict) else self.formula

    @property
    def values(self) -> tuple[Tensor, ...]:
        """Values of the parameters."""
        return tuple(getattr(self, p.name) for p in self.parameters)

    @property
    def options(self) -> dict[str, Any]:
        """Everything else that it takes to make the effect again: plain numbers, text and tuples of them."""
        return {f.name: getattr(self, f.name) for f in fields(self) if "parameter" not in f.metadata}

    def at(self, values: Tensor | Sequence[float]) -> "Effect":
        """The effect with values [..., K] of its K parameters; they broadcast against [..., N]."""
        parts = values.unbind(-1) if isinstance(values, Tensor) else values
        return replace(self, **{p.name: value for p, value in zip(self.parameters, parts, strict=True)})

    def vanished(self) -> "Effect":
        """The effect where it changes nothing."""
        return self.at([p.start if p.vanishing is None else p.vanishing for p in self.parameters])

    def prepare(self, impacts: Impacts) -> "Effect":
        """The effect ready for a kind of measurements: constants that were left open are taken from them."""
        if self.needs_shape and impacts.shape is None:
            raise DataError(
                f"effect {self.name} moves the contact point, so it needs the body's shape, and {impacts.source} has "
                "none; say it with data.shape={kind: ellipse, semi_axes: [a, b]}"
            )
        return self


def typical(measured: Tensor) -> float:
    """Median size of what was measured, to two digits; 1 where that is 0."""
    return float(f"{measured.abs().median().item():.1e}") or 1.0


def known(value: float | None) -> float:
    """A positive constant that is given, or that `Effect.prepare` has taken from measurements.

    Raises:
        ContactLearnError: neither, or it is not positive.
    """
    if value is None:
        raise ContactLearnError("a constant of the effect is open: give it, or call effect.prepare(impacts)")
    if not isinstance(value, int | float) or not 0 < value < math.inf:
        raise ContactLearnError(f"a reference speed or spin must be a positive number, got {value!r}")
    return value
