"""The seam: a physical effect is a small frozen dataclass that acts at one of four places.

    state(state)              corrects what was measured or assumed before contact
    law(state, mu, eps)       makes the coefficients of the law functions of the state
    wrench(state, wrench)     changes (P_t, P_n, τ) after the law has resolved the contact
    velocity(state, v_post)   acts between contact and the second measurement, in world axes

An effect overrides one of these methods and declares its parameters as fields; its class is a frozen dataclass by
itself:

    class SideDrag(Effect):
        \"\"\"(v_x, v_y) → (1 − c) (v_x, v_y) after contact.  It is not a lower restitution …\"\"\"

        formula = "(v_x⁺, v_y⁺) ← (1 − c) (v_x⁺, v_y⁺)"
        in_words = "the body loses {c:%} of its speed after contact"
        c: Tensor | float = parameter("c", "–", 0.0, 0.5)

        def velocity(self, state, v_post): …

An effect on μ or ε alone inherits `law` from `ChangesFriction` or `ChangesRestitution` and overrides `coefficient`.

An effect with several forms is a family: a subclass of `Effect` that states the `place`, or has an
`abc.abstractmethod`, holds what the forms share; each form is a final subclass with its own method, `form`, `formula`
and parameters.  The first form that is declared is the default one (`spin_damping.py`).

Everything else follows from that: fitting, standard errors, curves, tables, the configuration.  At
its vanishing values an effect changes nothing, to the last bit; `contactlearn.testing` holds it to that and
more.  In a method a parameter broadcasts against [..., N], one value a trial: `columns` puts parts side by side.
"""

import inspect
import math
import re
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar, Self

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.errors import ContactLearnError, DataError
from contactlearn.core.frozen import Frozen
from contactlearn.effects.identity import EffectId
from contactlearn.effects.state import Coefficients, State
from contactlearn.mechanics.apparatus import Estimate
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.space import PLANE, SPACE, Space, require_space

OWN_FAMILY = "own family"
"""Stands in `Effect.refines` for the family of the class itself."""
OUTPUTS: dict[str, dict[str, str]] = {
    "state": {"rx": "m", "ry": "m", "theta": "rad"},
    "law": {"mu": "–", "eps": "–"},
    "wrench": {"Pt": "N s", "Pn": "N s", "tau": "N m s"},
    "velocity": {"vx_post": "m/s", "vy_post": "m/s", "omega_post": "rad/s"},
}
"""Units of the quantities that an effect changes by their names, by the place where it acts."""

PLACES = tuple(OUTPUTS)
OUTPUTS_IN_SPACE: dict[str, dict[str, str]] = {
    "state": {"rx": "m", "ry": "m", "rz": "m"},
    "law": OUTPUTS["law"],
    "wrench": {"Px": "N s", "Py": "N s", "Pz": "N s", "taux": "N m s", "tauy": "N m s", "tauz": "N m s"},
    "velocity": {f"{v}{axis}_post": unit for v, unit in (("v", "m/s"), ("w", "rad/s")) for axis in "xyz"},
}
"""The same of bodies in space, in world axes."""


def outputs(place: str, space: Space) -> dict[str, str]:
    """Return the units of what the effects of a place change, by name."""
    return (OUTPUTS if space is PLANE else OUTPUTS_IN_SPACE)[place]


@dataclass(frozen=True)
class Parameter:
    """A fitted number of an effect: its plausible range, and the value at which the effect vanishes.

    `vanishing` is None for a parameter that need not vanish because another does; `start` is then a typical value.
    `prior_from_flight` is its estimate from free flight, where that limits the range.
    """

    name: str
    symbol: str
    unit: str
    low: float
    high: float
    vanishing: float | None = 0.0
    start: float = 0.0
    prior_from_flight: Estimate | None = None


def parameter(
    symbol: str,
    unit: str,
    low: float,
    high: float,
    *,
    vanishing: float | None = 0.0,
    start: float | None = None,
    in_space: bool = False,
) -> Any:
    """Declare a field of an effect as a fitted parameter.

    Args:
        symbol: letter in formulas.
        unit: SI; – for a number.
        low: least plausible value.
        high: greatest plausible value.
        vanishing: value at which the effect vanishes; None if another parameter makes it vanish.
        start: first value of a fit; `vanishing` if left out.
        in_space: whether bodies in space alone have it; declared last, and None until the effect is prepared on some.
    """
    start = vanishing if start is None else start
    declared = {"symbol": symbol, "unit": unit, "low": low, "high": high, "vanishing": vanishing, "start": start}
    return field(default=None if in_space else start, metadata={"parameter": declared})


def usual_parameter(symbol: str) -> Any:
    """Declare a parameter that vanishes at 0 with the unit and range of its class, see `Effect.usual_range`."""
    return field(default=0.0, metadata={"parameter": {"symbol": symbol}})


class Effect(Frozen, ABC):
    """Base of all effects, families and forms; see the module.

    Raises:
        TypeError: at the definition of a subclass that breaks a rule of the module.
    """

    formula: ClassVar[str]
    """Its equation, in the symbols of the documentation."""
    in_words: ClassVar[str] = ""
    """What its fitted values say, each parameter once by name: "the floor is tilted by {phi}".

    What stands in brackets is of space alone.
    A value is written with its unit, mm for m, ° for rad, ms for s; `{c:%}` writes a share in percent, `{kappa:exp}`
    the factor e^κ, `{p:doubled}` the change of x^p where x doubles, and `{c:-}`, `{c:-%}` or `{p:-doubled}` what the
    opposite value has.  Without words values are listed by their symbols."""
    quantity: ClassVar[str] = ""
    """What {quantity} stands for in the `formula` and `in_words` of functions that several families share: μ, ε, …"""
    form: ClassVar[str | None] = None
    """Name of a form within its family; None for an effect that has no other form."""
    source: ClassVar[str] = ""
    """Origin of the idea, in words."""
    citations: ClassVar[tuple[str, ...]] = ()
    """BibTeX keys of references.bib, or whole entries; `contactlearn.cite` prints them."""
    mirror_symmetric: ClassVar[bool] = True
    """Whether the mirror image of an impact has the mirror image of its outcome at the same parameters."""
    adds_energy: ClassVar[bool] = False
    """Whether the body may leave with more kinetic energy than it was measured to bring."""
    needs_shape: ClassVar[bool] = False
    """Whether the body's shape must be known; `State.contact_points` uses the shape of each trial's own body."""
    needs_lever: ClassVar[bool] = False
    """Whether it reads how far the contact point is beside the mass centre: noise, where those of a disc are seen."""
    of_recording: ClassVar[bool] = False
    """Whether it is of the recording alone, as a late frame is: roll-outs and simulators leave it out."""
    like_shape: ClassVar[bool] = False
    """Whether another contact point looks the same: a moment of an arm that follows from the pose alone.  Where the
    body's shape is unknown, such an effect shares its probability with those that need the shape."""
    refines: ClassVar[tuple[str, ...]] = ()
    """Families, `OWN_FAMILY` or others, in whose place alone the search tries it: it takes long, or a linearisation
    where it vanishes tells little of it."""
    last: ClassVar[bool] = False
    """Whether it acts after the others of its place, because it depends on what they change."""
    usual_range: ClassVar[tuple[str, float, float]] = ("–", -0.5, 0.5)
    """Unit, least and greatest plausible value of parameters that state none: those of a change of μ or ε."""
    spaces: ClassVar[tuple[Space, ...]] = (PLANE,)
    """Spaces in which it exists: the plane, or both."""
    place: ClassVar[str]
    """Method that the class overrides, one of `PLACES`; a family that leaves it to its forms must state it."""
    name: ClassVar[str]
    """Name of the family: its class's name in small letters."""
    id: ClassVar[EffectId]
    """Name and form."""
    _parameters: ClassVar[tuple[Parameter, ...]]  # as `parameters` found them

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "place" in vars(cls) and cls.place not in vars(cls):  # of a family, whose forms override the method
            setattr(cls, cls.place, abstractmethod(lambda *given: None))
        family = _family(cls)
        if family is not None:
            form_bases = cls.__mro__[: cls.__mro__.index(family)]
            places = {*PLACES} & {name for base in form_bases for name in vars(base)}
            if places and family.place not in places:  # of a form that acts at another place than its family
                setattr(cls, family.place, None)
            _check_form(cls, family)
        elif cls.form is not None:
            raise TypeError(f"{cls.__name__} has a form and no family; make a form a subclass of its abstract family")
        cls.place = _place(cls)
        cls.name = re.sub(r"(?<!^)(?=[A-Z])", "_", cls.__name__).lower() if family is None else family.name
        cls.id = EffectId(cls.name, cls.form)
        cls.refines = tuple(cls.name if name == OWN_FAMILY else name for name in cls.refines)
        for text in ("formula", "in_words"):
            if "{quantity}" in getattr(cls, text, ""):
                setattr(cls, text, getattr(cls, text).replace("{quantity}", cls.quantity))

    def __post_init__(self) -> None:
        for f in fields(self):
            if "parameter" in f.metadata and (given := getattr(self, f.name)) is not None:
                try:
                    object.__setattr__(self, f.name, torch.as_tensor(given, dtype=torch.float64))
                except (TypeError, ValueError, RuntimeError) as error:
                    raise ContactLearnError(f"{self.id}: {f.name} must be a number, got {given!r}") from error

    def state(self, state: State) -> State:
        """Return the state as it really is, from the state as it was measured."""
        raise NotImplementedError

    def law(self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."]) -> Coefficients:
        """Return (μ, ε) of each impact [..., N]; values outside μ ≥ 0 and 0 ≤ ε ≤ 1 are clamped afterwards."""
        raise NotImplementedError

    def wrench(self, state: State, wrench: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
        """Return the wrench [..., N, 3] in (N s, N s, N m s), in contact axes."""
        raise NotImplementedError

    def velocity(self, state: State, v_post: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
        """Return v_post [..., N, 3] in (m/s, m/s, rad/s) as it was measured."""
        raise NotImplementedError

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Fitted parameters, in the order of the fields; those of space once the effect was prepared there."""
        return tuple(p for p in self.every_parameter() if getattr(self, p.name) is not None)

    @classmethod
    def every_parameter(cls) -> tuple[Parameter, ...]:
        """Return the fields that are parameters, those of space among them."""
        if "_parameters" not in vars(cls):  # read some hundred times a fit
            named = (f for f in fields(cls) if f.metadata.get("parameter"))
            usual = dict(zip(("unit", "low", "high"), cls.usual_range, strict=True))
            cls._parameters = tuple(Parameter(f.name, **usual | f.metadata["parameter"]) for f in named)
        return cls._parameters

    @property
    def equation(self) -> str:
        """Formula of this very effect."""
        return self.formula

    @property
    def values(self) -> tuple[Tensor, ...]:
        """Values of the parameters."""
        return tuple(getattr(self, p.name) for p in self.parameters)

    @property
    def options(self) -> dict[str, Any]:
        """Fields that are not fitted, from which the class makes the effect again: numbers, text and tuples of them."""
        return {f.name: getattr(self, f.name) for f in fields(self) if "parameter" not in f.metadata}

    def at(self, values: Float[Tensor, "... k"] | Sequence[Tensor | float]) -> Self:
        """Return the effect with values [..., K] of its K parameters; they broadcast against [..., N]."""
        parts = values.unbind(-1) if isinstance(values, Tensor) else values
        parameters = self.parameters if len(parts) == len(self.parameters) else self.every_parameter()
        return replace(self, **{p.name: value for p, value in zip(parameters, parts, strict=True)})

    def vanished(self) -> Self:
        """Return the effect where it changes nothing."""
        return self.at([p.start if p.vanishing is None else p.vanishing for p in self.parameters])

    def in_metres(self, name: str) -> tuple[float, float] | None:
        """Return what a parameter of 1 is in m, and where its zero lies; None of a parameter that is no length so."""
        del name
        return None

    def in_shown_unit(self, name: str, value: float, error: float, unit: str) -> tuple[float, float, str]:
        """Return a value of a parameter and its standard error as people read them, and their unit: lengths in m."""
        metres = self.in_metres(name)
        if metres is None:
            return value, error, unit
        scale, zero = metres
        return scale * value + zero, scale * error, "m"

    @property
    def shown_equation(self) -> str:
        """The equation of parameters in their shown units."""
        return self.formula if any(self.in_metres(p.name) for p in self.parameters) else self.equation

    def prepare(self, impacts: Impacts) -> Self:
        """Return the effect with the constants that were left open taken from measurements.

        Raises:
            DataError: the effect needs the body's shape, and the impacts have none.
            ContactLearnError: it does not exist in the space of the impacts.
        """
        self.require_space(impacts.space)
        if self.needs_shape:
            require_shape(self.name, impacts)
        opened = self.every_parameter()[len(self.parameters) :] if impacts.space is SPACE else ()
        effect = self.at([*self.values, *(p.start for p in opened)]) if opened else self
        return effect.taken_from(impacts)

    def require_space(self, space: Space) -> None:
        """Refuse a space in which this form does not exist, and name the forms that do.

        Raises:
            ContactLearnError: it does not exist there.
        """
        family = _family(type(self))
        forms = family.__subclasses__() if family is not None else []
        there = " or ".join(str(form.id) for form in forms if space in form.spaces)
        require_space(f"effect {self.id}", space, self.spaces, hint=f"; there it is {there}" if there else "")

    def taken_from(self, impacts: Impacts) -> Self:
        """Return the effect with its own open constants taken from impacts that `prepare` has accepted."""
        return self


def require_shape(effect: str, impacts: Impacts) -> None:
    """Refuse impacts of a body without a shape, for an effect by name that moves the contact point.

    Raises:
        DataError: the impacts have no shape.
    """
    if impacts.shape is None:
        say = "{kind: ellipse, semi_axes: [a, b]}, or take the one that the contact points trace, "
        say = "{kind: cuboid, half: [a, b, c]}" if impacts.space is SPACE else f"{say}data.correct=[traced_shape]"
        raise DataError(
            f"effect {effect} moves the contact point, so it needs the body's shape, and {impacts.source} has "
            f"none; say it with data.shape={say}"
        )


class ChangesFriction(ABC):
    """Mixin of an effect that makes μ a function of the state and leaves ε alone."""

    quantity: ClassVar[str] = "μ"

    @abstractmethod
    def coefficient(self, state: State, value: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        """Return μ of each impact [..., N], from μ of the law."""

    def law(self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."]) -> Coefficients:
        """Return (μ, ε) of each impact."""
        return self.coefficient(state, mu), eps


class ChangesRestitution(ABC):
    """Mixin of an effect that makes ε a function of the state and leaves μ alone."""

    quantity: ClassVar[str] = "ε"

    @abstractmethod
    def coefficient(self, state: State, value: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        """Return ε of each impact [..., N], from ε of the law."""

    def law(self, state: State, mu: Float[Tensor, "..."], eps: Float[Tensor, "..."]) -> Coefficients:
        """Return (μ, ε) of each impact."""
        return mu, self.coefficient(state, eps)


def _family(kind: type[Effect]) -> type[Effect] | None:
    """The family that a class is a form of; None of a class that is no form."""
    return next((base for base in kind.__mro__[1:] if base is not Effect and issubclass(base, Effect)), None)


def _place(kind: type[Effect]) -> str:
    """Name of the one place whose method a class overrides, itself or by a base."""
    bases = [base for base in kind.__mro__ if base is not Effect]
    methods = {place: next((vars(base)[place] for base in bases if place in vars(base)), None) for place in PLACES}
    places = [place for place, method in methods.items() if method is not None]
    if len(places) != 1:
        raise TypeError(f"{kind.__name__} must override one of {', '.join(PLACES)}, not {places or 'none'}")
    return places[0]


def _check_form(kind: type[Effect], family: type[Effect]) -> None:
    """Refuse a subclass of an effect that is not a form of an abstract family."""
    if not inspect.isabstract(family):
        raise TypeError(f"{kind.__name__} must not subclass {family.__name__}, which is final; subclass Effect")
    for method in family.__abstractmethods__:
        if getattr(getattr(kind, method), "__isabstractmethod__", False):
            raise TypeError(f"{kind.__name__} must override {method}, as its family {family.name} does")
    if kind.form is None:
        raise TypeError(f'{kind.__name__} must name its form of {family.name}; write such as form = "quadratic"')


def require_positive(value: float | None) -> float:
    """Return a constant of an effect that is given, or that `Effect.prepare` has taken from measurements.

    Raises:
        ContactLearnError: it is None, or not positive.
    """
    if value is None:
        raise ContactLearnError("a constant of the effect is open: give it, or call effect.prepare(impacts)")
    if not isinstance(value, int | float) or not 0 < value < math.inf:
        raise ContactLearnError(f"a reference speed or spin must be a positive number, got {value!r}")
    return value
