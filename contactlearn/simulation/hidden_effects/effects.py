"""Effects that may be hidden: their names, forms and parameters.

Each form has a text, parameters and a change of the `World`.  A `SizedParameter` vanishes with the size of the effect
and reaches its plausible limit at size 1; a `UniformParameter` is drawn once, whatever the size.  An effect may have
several forms, one of which is drawn.  `EFFECTS` share their names with the catalogue of effects, so that a diagnosis
can be compared with the truth; their forms are the simulator's own, and most differ from those that an analysis tries
first.  `UNKNOWN` effects are in no catalogue and are hidden only on request.  `CONFOUNDED` groups leave nearly the same
trace: at most one of each group is drawn.

Restitution is settled at first touch; friction and moments follow the slip and the spin of the instant.
"""

import math
import random
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

import torch
from torch import Tensor

from contactlearn.core.errors import UnknownNameError
from contactlearn.mechanics.rigid_body import GRAVITY
from contactlearn.simulation.hidden_effects.world import ContactContext, World


@dataclass(frozen=True)
class SizedParameter:
    """A parameter that is ± `limit` × size, times a share drawn from [`share`, 1]."""

    limit: float
    unit: str
    signs: Literal["both", "plus"] = "both"
    share: float = 1.0


@dataclass(frozen=True)
class UniformParameter:
    """A parameter that is drawn from [`low`, `high`]."""

    low: float
    high: float
    unit: str


Parameter = SizedParameter | UniformParameter


@dataclass(frozen=True)
class Form:
    """One form of an effect: its text, its parameters, and how it acts on a world."""

    text: str
    parameters: dict[str, Parameter]
    act: Callable[..., World]

    def draw(self, rng: random.Random) -> Callable[[float], dict[str, float]]:
        """Draw the parameters as a function of the size in [0, 1]."""
        drawn = {}
        for name, parameter in self.parameters.items():
            if isinstance(parameter, SizedParameter):
                sign = {"both": rng.choice((-1, 1)), "plus": 1}[parameter.signs]
                drawn[name] = sign * parameter.limit * rng.uniform(parameter.share, 1)
            else:
                drawn[name] = rng.uniform(parameter.low, parameter.high)
        sized = {name for name, parameter in self.parameters.items() if isinstance(parameter, SizedParameter)}
        return lambda size: {name: value * (size if name in sized else 1) for name, value in drawn.items()}


_FORMS: dict[str, list[Form]] = {}


def _form(name: str, text: str, act: Callable[..., World], **parameters: Parameter) -> None:
    """Add a form of an effect; `act` takes a world and the values of the parameters."""
    _FORMS.setdefault(name, []).append(Form(text, parameters, act))


def _sets(change: Callable[..., dict[str, Any]]) -> Callable[..., World]:
    """The act that sets fields of the world."""
    return lambda world, **values: replace(world, **change(**values))


def _adds(field: str, function: Callable[..., Tensor]) -> Callable[..., World]:
    """The act that appends a function of the contact and the parameters to a field of the world."""
    return lambda world, **values: replace(world, **{field: (*getattr(world, field), partial(function, **values))})


_restitution, _friction = partial(_adds, "restitution"), partial(_adds, "friction")
_lever, _later = partial(_adds, "levers"), partial(_adds, "after")


def _push(v: Tensor, x: Tensor | float = 0.0, y: Tensor | float = 0.0, spin: Tensor | float = 0.0) -> Tensor:
    """v [N, 3] changed by (x, y, spin)."""
    return torch.stack((v[:, 0] + x, v[:, 1] + y, v[:, 2] + spin), -1)


# State: what was measured or assumed before contact

_form("surface_tilt", "the floor is inclined by φ", _sets(lambda φ: {"tilt": φ}), φ=SizedParameter(0.1, "rad"))
_form(
    "com_offset",
    "the centre of mass lies (δ_a, δ_b) off the tracked point, along the body's axes",
    _sets(lambda δ_a, δ_b: {"centre": (δ_a, δ_b)}),
    δ_a=SizedParameter(0.006, "m", share=0.3),
    δ_b=SizedParameter(0.006, "m", share=0.3),
)
_form(
    "inertia_error",
    "the true moment of inertia is I e^κ",
    _sets(lambda κ: {"inertia_factor": math.exp(κ)}),
    κ=SizedParameter(0.6, ""),
)
_form("orientation_offset", "the true orientation is θ + δ", _sets(lambda δ: {"turn": δ}), δ=SizedParameter(0.3, "rad"))
_form(
    "sampling_delay",
    "contact comes Δt after the reported pose; velocities are those at contact",
    _sets(lambda Δt: {"delay": Δt}),
    Δt=SizedParameter(0.012, "s"),
)
_form(
    "shape_error",
    "the true semi-axes are (1 + s_a, 1 + s_b) times the nominal ones",
    _sets(lambda s_a, s_b: {"scale": (1 + s_a, 1 + s_b)}),
    s_a=SizedParameter(0.25, "", share=0.3),
    s_b=SizedParameter(0.25, "", share=0.3),
)

# Velocity: between contact and the second measurement

_form(
    "spin_damping",
    "after contact the spin decays to ω e^(−c) before it is measured",
    _later(lambda contact, v, c: _push(v, spin=v[:, 2] * math.expm1(-c))),
    c=SizedParameter(0.8, "", "plus"),
)
_form(
    "gravity_impulse",
    "gravity acts for Δt before the velocity is measured",
    _later(lambda contact, v, Δt: _push(v, y=-GRAVITY * Δt)),
    Δt=SizedParameter(0.03, "s", "plus"),
)
_form(
    "side_drag",
    "guide walls slow v_x and v_y down by e^(−c) after contact",
    _later(lambda contact, v, c: _push(v, v[:, 0] * math.expm1(-c), v[:, 1] * math.expm1(-c))),
    c=SizedParameter(0.3, "", "plus"),
)

# Restitution, at first touch


def _thornton(v: Tensor, v_0: float) -> Tensor:
    """Restitution of an elastic-plastic sphere at a speed v, which yields at v_0, without its constant factor."""
    square = (v_0 / v.clamp_min(v_0)) ** 2
    ratio = square.sqrt()
    return (
        (1.2 * math.sqrt(3)) ** 0.5
        * (1 - square / 6).sqrt()
        * (ratio / (ratio + 2 * (1.2 - 0.2 * square).sqrt())) ** 0.25
    )


_form(
    "velocity_dependent_restitution",
    "ε times (e(|v_n|)/e(2 m/s))^k, e the restitution of an elastic-plastic sphere that yields at v_0 (Thornton 1997)",
    _restitution(
        lambda contact, k, v_0: (
            (_thornton(-contact.v_c[:, 1], v_0) / _thornton(torch.full_like(contact.x, 2.0), v_0)) ** k
        )
    ),
    k=SizedParameter(3.0, "", "plus"),
    v_0=UniformParameter(0.05, 0.3, "m/s"),
)
_form(
    "slip_dependent_restitution",
    "ε (1 + a |v_t| / (|v_t| + v_s))",
    _restitution(lambda contact, a, v_s: 1 + a * contact.v_c[:, 0].abs() / (contact.v_c[:, 0].abs() + v_s)),
    a=SizedParameter(0.6, ""),
    v_s=UniformParameter(0.4, 1.5, "m/s"),
)
_form(
    "orientation_dependent_restitution",
    "a soft spot of the body: ε (1 − a exp(κ (cos(θ − θ_0) − 1)))",
    _restitution(lambda contact, a, κ, θ_0: 1 - a * torch.exp(κ * (torch.cos(contact.theta - θ_0) - 1))),
    a=SizedParameter(0.7, "", "plus"),
    κ=UniformParameter(1.0, 4.0, ""),
    θ_0=UniformParameter(-math.pi, math.pi, "rad"),
)
_form(
    "location_dependent_restitution",
    "a floor that bends between its supports: ε (1 − a sin(π (x − x_0)/L)) over the span",
    _restitution(lambda contact, a, x_0, L: 1 - a * torch.sin(math.pi * ((contact.x - x_0) / L).clamp(0, 1))),
    a=SizedParameter(0.6, "", "plus"),
    x_0=UniformParameter(0.0, 0.12, "m"),
    L=UniformParameter(0.36, 0.5, "m"),
)
_form(
    "location_dependent_restitution",
    "a soft place of the floor: ε (1 − a exp(−(x − x_0)²/(2 w²)))",
    _restitution(lambda contact, a, x_0, w: 1 - a * torch.exp(-0.5 * ((contact.x - x_0) / w) ** 2)),
    a=SizedParameter(0.7, "", "plus"),
    x_0=UniformParameter(0.15, 0.43, "m"),
    w=UniformParameter(0.05, 0.12, "m"),
)
_form(
    "configuration_dependent_restitution",
    "energy goes into vibration: ε exp(−c (r_x/ρ)²), ρ² = I/m",
    _restitution(lambda contact, c: torch.exp(-c * contact.r[:, 0] ** 2 * contact.mass / contact.inertia)),
    c=SizedParameter(2.0, "", "plus"),
)

# Friction, at the slip of the instant

_form(
    "velocity_dependent_friction",
    "Stribeck: μ (1 + a exp(−(|v_t|/v_s)^n)) at the slip of the instant",
    _friction(lambda contact, slip, a, v_s, n: 1 + a * torch.exp(-((slip.abs() / v_s) ** n))),
    a=SizedParameter(2.0, "", "plus"),
    v_s=UniformParameter(0.3, 1.0, "m/s"),
    n=UniformParameter(0.7, 2.0, ""),
)
_form(
    "velocity_dependent_friction",
    "viscous: μ + b |v_t| at the slip of the instant",
    lambda world, b: replace(world, friction=(*world.friction, lambda contact, slip: 1 + b / world.mu * slip.abs())),
    b=SizedParameter(0.3, "s/m", "plus"),
)
_form(
    "load_dependent_friction",
    "μ (|v_n|/2 m/s)^k, |v_n| of the approach",
    _friction(lambda contact, slip, k: (-contact.v_c[:, 1] / 2.0) ** k),
    k=SizedParameter(1.2, ""),
)
_form(
    "directional_friction",
    "μ (1 + a) while the contact slips to the right, μ (1 − a) to the left",
    _friction(lambda contact, slip, a: 1 + a * slip.sign()),
    a=SizedParameter(0.8, ""),
)
_form(
    "location_dependent_friction",
    "a patch of the floor from x_1 over a width w has μ (1 + a), with edges 10 mm wide",
    _friction(
        lambda contact, slip, a, x_1, w: (
            1 + 0.5 * a * (torch.tanh((contact.x - x_1) / 0.01) - torch.tanh((contact.x - x_1 - w) / 0.01))
        )
    ),
    a=SizedParameter(0.9, ""),
    x_1=UniformParameter(0.12, 0.3, "m"),
    w=UniformParameter(0.1, 0.2, "m"),
)

# Wrench

_form(
    "tangential_restitution",
    "a tangential spring, k_n/k_t = c, with a dashpot that relaxes within (1/s − 1) compression times, in series "
    "with Coulomb's slider; restitution is energetic",
    _sets(lambda s, c: {"compliant": True, "energetic": True, "compliance": c, "resilience": s}),
    s=SizedParameter(1.0, "", "plus"),
    c=UniformParameter(0.8, 1.5, ""),
)
_form(
    "adhesion",
    "the surfaces stick together: parting costs the work w",
    _sets(lambda w: {"adhesion": w}),
    w=SizedParameter(0.02, "J", "plus"),
)
_form(
    "contact_patch",
    "the centre of pressure moves by −h tanh(k r_x/h) on a contact of half-width h",
    _lever(lambda contact, spin, k, h: -h * torch.tanh(k * contact.r[:, 0] / h)),
    k=SizedParameter(1.0, "", "plus"),
    h=UniformParameter(0.003, 0.008, "m"),
)
_form(
    "rolling_resistance",
    "moment c per normal impulse against the spin of the instant, c tanh(ω/ω_s)",
    _lever(lambda contact, spin, c, ω_s: -c * torch.tanh(spin / ω_s)),
    c=SizedParameter(0.008, "m", "plus"),
    ω_s=UniformParameter(1.0, 4.0, "rad/s"),
)
_form(
    "spin_damping",
    "along the contact dω/dp = −c ω/m, p the normal impulse",
    _lever(lambda contact, spin, c: -c * spin * contact.inertia / contact.mass),
    c=SizedParameter(0.4, "s/m", "plus"),
)
_form(
    "parameter_drift",
    "ε falls by a share a as the surfaces wear: ε (1 − a (1 − exp(−n/(N τ)))) in trial n of N",
    _restitution(lambda contact, a, τ: 1 - a * (1 - torch.exp(-contact.age / τ))),
    a=SizedParameter(0.6, "", "plus"),
    τ=UniformParameter(0.15, 0.8, ""),
)
_form(
    "parameter_drift",
    "μ grows by a share a as the surfaces wear: μ (1 + a (1 − exp(−n/(N τ)))) in trial n of N",
    _friction(lambda contact, slip, a, τ: 1 + a * (1 - torch.exp(-contact.age / τ))),
    a=SizedParameter(2.0, "", "plus"),
    τ=UniformParameter(0.15, 0.8, ""),
)
EFFECTS = tuple(sorted(_FORMS))

# Physics that no catalogue describes: an analysis should see that something is missing, and not name it


def _strap(contact: ContactContext, v: Tensor, k: float) -> Tensor:
    change = k * contact.x * contact.v[:, 1]
    return _push(v, x=change, spin=-contact.r[:, 1] * change * contact.mass / contact.inertia)


def _lift(contact: ContactContext, v: Tensor, k: float) -> Tensor:
    change = k * contact.v[:, 2] * contact.v[:, 0]
    return _push(v, y=change, spin=contact.r[:, 0] * change * contact.mass / contact.inertia)


_form(
    "magnetic_pull",
    "a magnet turns the body by an impulse K cos 3θ",
    _later(lambda contact, v, K: _push(v, spin=K * torch.cos(3 * contact.theta) / contact.inertia)),
    K=SizedParameter(4e-4, "N m s"),
)
_form(
    "elastic_strap",
    "a strap pulls sideways, P_t + k m x v_y of the approach",
    _later(_strap),
    k=SizedParameter(1.0, "1/m"),
)
_form(
    "spin_lift",
    "spin lifts the body, P_n + k m ω v_x of the approach",
    _later(_lift),
    k=SizedParameter(0.05, "s"),
)
UNKNOWN = tuple(sorted({*_FORMS} - {*EFFECTS}))

CONFOUNDED = (
    {"rolling_resistance", "spin_damping"},
    {"velocity_dependent_restitution", "adhesion"},
    {"orientation_dependent_restitution", "configuration_dependent_restitution"},
    {"gravity_impulse", "side_drag"},
    {"orientation_offset", "surface_tilt"},
    {"inertia_error", "contact_patch"},
)

# The catalogue's parameters by those of the simulator, where both mean the same.
_COMPARABLE = {
    "surface_tilt": lambda p: {"phi": p["φ"]},
    "com_offset": lambda p: {"delta_a": p["δ_a"], "delta_b": p["δ_b"]},
    "inertia_error": lambda p: {"kappa": p["κ"]},
    "orientation_offset": lambda p: {"delta": p["δ"]},
    "sampling_delay": lambda p: {"dt": p["Δt"]},
    "shape_error": lambda p: {"s_a": p["s_a"], "s_b": p["s_b"]},
    "gravity_impulse": lambda p: {"dt": p["Δt"]},
    "side_drag": lambda p: {"c": 1 - math.exp(-p["c"])},
    "load_dependent_friction": lambda p: {"p": p["k"]},
    "directional_friction": lambda p: {"a": p["a"]},
    "rolling_resistance": lambda p: {"c": p["c"]},
    "contact_patch": lambda p: {"k": p["k"], "c": 0.0},
}


def comparable_parameters(name: str, parameters: dict[str, float]) -> dict[str, float]:
    """Return the true values of the catalogue's parameters of an effect; empty where its form is another one."""
    return _COMPARABLE[name](parameters) if name in _COMPARABLE else {}


def forms(name: str) -> list[Form]:
    """Return the forms of an effect.

    Raises:
        UnknownNameError: there is no such effect.
    """
    if name not in _FORMS:
        raise UnknownNameError("hidden effect", name, _FORMS)
    return _FORMS[name]


def choose(rng: random.Random) -> list[str]:
    """Choose one to three effects of the catalogue that leave different traces."""
    count = rng.randint(1, 3)
    while True:
        names = sorted(rng.sample(EFFECTS, count))
        if all(len(group.intersection(names)) < 2 for group in CONFOUNDED):
            return names
