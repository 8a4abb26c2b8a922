"""Symbols of a formula about an impact, with their units and meanings.

    state symbols     m, I, rx, ry, x, y, theta, vx, … before contact, known at every place
    the outputs       what the effects of a place change, as it is so far: mu and eps at the law,
                      Pt, Pn and tau at the wrench, vx_post, vy_post and omega_post at the velocity
    what follows      mu and eps once the law has them; at the wrench the velocities after the wrench so far

Everything is in contact axes, but for the velocity place, which is in world axes as measured; with a
level floor these are the same.  In space the wrench is in the axes of the slip: 1 along it, 2 across it, n up.  Units
are SI; – is none.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import torch
from torch import Tensor

from contactlearn.core.errors import ContactLearnError, UnknownNameError
from contactlearn.effects.base import OUTPUTS, OUTPUTS_IN_SPACE, PLACES
from contactlearn.effects.state import State, columns
from contactlearn.mechanics.space import PLANE, SPACE, Space


@dataclass(frozen=True)
class Symbol:
    """A quantity [..., N]: its letter in formulas, and `of`, which takes it from a state that has it by itself."""

    letter: str
    unit: str
    description: str
    places: tuple[str, ...] = PLACES
    of: Callable[[State], Tensor] | None = None


SYMBOLS = {
    "m": Symbol("m", "kg", "mass", of=lambda s: s.mass),
    "I": Symbol("I", "kg m²", "moment of inertia about the centre of mass", of=lambda s: s.inertia),
    "rx": Symbol("r_x", "m", "contact point minus centre of mass, along the floor", of=lambda s: s.r[..., 0]),
    "ry": Symbol("r_y", "m", "contact point minus centre of mass, normal to the floor", of=lambda s: s.r[..., 1]),
    "x": Symbol("x", "m", "position along the floor", of=lambda s: s.x),
    "y": Symbol("y", "m", "height", of=lambda s: s.q[..., 1]),
    "theta": Symbol("θ", "rad", "orientation, counter-clockwise", of=lambda s: s.theta),
    "vx": Symbol("v_x", "m/s", "velocity along the floor before contact", of=lambda s: s.v_pre[..., 0]),
    "vy": Symbol("v_y", "m/s", "velocity normal to the floor before contact", of=lambda s: s.v_pre[..., 1]),
    "omega": Symbol("ω", "rad/s", "spin before contact", of=lambda s: s.omega),
    "vt": Symbol("v_t", "m/s", "slip of the contact point before contact", of=lambda s: s.v_t),
    "vn": Symbol("v_n", "m/s", "normal velocity of the contact point before contact, negative", of=lambda s: s.v_n),
    "Wtt": Symbol("W_tt", "1/kg", "inverse effective inertia, slip by tangential impulse", of=lambda s: s.W[..., 0, 0]),
    "Wtn": Symbol("W_tn", "1/kg", "inverse effective inertia, slip by normal impulse", of=lambda s: s.W[..., 0, 1]),
    "Wnn": Symbol(
        "W_nn", "1/kg", "inverse effective inertia, normal velocity by normal impulse", of=lambda s: s.W[..., 1, 1]
    ),
    "rho": Symbol("ρ", "m", "radius of gyration, sqrt(I/m)", of=lambda s: (s.inertia / s.mass).sqrt()),
    "order": Symbol("n", "–", "place in the sequence of measurements", of=lambda s: s.order),
    "mu": Symbol("μ", "–", "coefficient of friction", ("law", "wrench", "velocity")),
    "eps": Symbol("ε", "–", "coefficient of restitution", ("law", "wrench", "velocity")),
    "Pt": Symbol("P_t", "N s", "tangential impulse so far", ("wrench",)),
    "Pn": Symbol("P_n", "N s", "normal impulse so far", ("wrench",)),
    "tau": Symbol("τ", "N m s", "moment impulse about the contact point so far", ("wrench",)),
    "vx_post": Symbol("v_x⁺", "m/s", "velocity along the floor after contact so far", ("wrench", "velocity")),
    "vy_post": Symbol("v_y⁺", "m/s", "velocity normal to the floor after contact so far", ("wrench", "velocity")),
    "omega_post": Symbol("ω⁺", "rad/s", "spin after contact so far", ("wrench", "velocity")),
    "vt_post": Symbol("v_t⁺", "m/s", "slip of the contact point after the wrench so far", ("wrench",)),
    "vn_post": Symbol("v_n⁺", "m/s", "normal velocity of the contact point after the wrench so far", ("wrench",)),
}
"""Every symbol by the name that it has in an expression."""
IN_SPACE = {
    **{name: SYMBOLS[name] for name in ("vn", "x", "order")},
    "floor_y": Symbol("y", "m", "position along the floor, across x", of=lambda s: s.q[..., 1]),
    "slip": Symbol("|v_t|", "m/s", "speed of the slip before contact", of=lambda s: s.slip),
    "incidence": Symbol(
        "incidence", "rad", "angle of the contact velocity against the normal", of=lambda s: s.incidence
    ),
    "lever": Symbol("|r_t|/ρ", "–", "arm of the normal impulse in radii of gyration", of=lambda s: s.lever),
    "spin": Symbol("|ω|", "rad/s", "rate of the spin before contact", of=lambda s: s.v_pre[..., 3:].norm(dim=-1)),
    "twist": Symbol("ω_n", "rad/s", "spin about the normal before contact", of=lambda s: s.v_pre[..., 5]),
    "orientation": Symbol("orientation", "–", "turn of the body, which also moves its contact point"),
}
"""Quantities of a body in space by name: those of a state, which no turn about the normal changes, and the place."""
FORMULA_OUTPUTS: dict[Space, dict[str, dict[str, str]]] = {
    PLANE: OUTPUTS,
    SPACE: OUTPUTS_IN_SPACE | {"wrench": {f"{x}{k}": u for x, u in (("P", "N s"), ("tau", "N m s")) for k in "12n"}},
}
"""Units of what a formula adds to by their names, by the space and by the place; see `OUTPUTS`."""


_ALONG = {"1": "along the slip before contact", "2": "across the slip before contact", "n": "along the normal"}
KNOWN: dict[Space, dict[str, Symbol]] = {
    PLANE: SYMBOLS,
    SPACE: {
        **{name: SYMBOLS[name] for name in ("m", "mu", "eps")},
        "rho": Symbol("ρ", "m", "mean radius of gyration", of=lambda s: (s.inertia.sum(-1) / (3 * s.mass)).sqrt()),
        **{name: symbol for name, symbol in IN_SPACE.items() if symbol.of},
        **{
            f"r{axis}": Symbol(
                f"r_{axis}", "m", f"contact point minus centre of mass, along {axis}", of=lambda s, k=k: s.r[..., k]
            )
            for k, axis in enumerate("xyz")
        },
        **{f"P{k}": Symbol(f"P_{k}", "N s", f"impulse so far, {way}", ("wrench",)) for k, way in _ALONG.items()},
        **{
            f"tau{k}": Symbol(f"τ_{k}", "N m s", f"moment impulse about the contact point so far, {way}", ("wrench",))
            for k, way in _ALONG.items()
        },
        **{
            f"{x}{axis}_post": Symbol(f"{letter}_{axis}⁺", unit, f"{quantity} after contact so far", ("velocity",))
            for x, letter, unit, quantity in (("v", "v", "m/s", "velocity"), ("w", "ω", "rad/s", "spin"))
            for axis in "xyz"
        },
    },
}
"""Symbols of formulas by the space and the name that they have in an expression."""


def symbols(
    state: State,
    names: Iterable[str],
    place: str = "state",
    so_far: Mapping[str, Tensor] = MappingProxyType({}),
) -> dict[str, Tensor]:
    """The named symbols [..., N], and no others are computed.

    Args:
        state: quantities before contact, with `mu` and `eps` once the law has them.
        names: of `KNOWN`.
        place: one of `contactlearn.effects.PLACES`.
        so_far: the outputs of the place by name, see `FORMULA_OUTPUTS`; those of the place `state` are in the state.

    Raises:
        UnknownNameError: no such symbol at this place.
        ContactLearnError: μ or ε of a state that no law has been given yet.
    """
    names, known = tuple(names), dict(so_far)
    if state.space is PLANE and place == "wrench" and so_far and any(name.endswith("_post") for name in names):
        wrench = columns(*(so_far[name] for name in OUTPUTS["wrench"]))
        known |= zip(OUTPUTS["velocity"], state.v_after(wrench).unbind(-1), strict=True)
        known |= zip(("vt_post", "vn_post"), state.contact_after(wrench).unbind(-1), strict=True)
    if place in ("wrench", "velocity"):
        known |= {"mu": state.mu, "eps": state.eps}
    return {name: _value(name, state, place, known) for name in names}


def of_state(state: State) -> dict[str, Tensor]:
    """Every symbol that a state has by itself, in space those of `IN_SPACE`, and its covariates."""
    if state.space is SPACE:
        return {name: symbol.of(state) for name, symbol in IN_SPACE.items() if symbol.of} | {**state.covariates}
    return symbols(state, (name for name, symbol in SYMBOLS.items() if symbol.of)) | {**state.covariates}


def symbol_named(name: str) -> Symbol:
    """Return the symbol of a name; any that is not ours is that of a covariate, and "object" is the body."""
    if name == "object":
        return Symbol("the body", "–", "name of the body")
    known = IN_SPACE | KNOWN[SPACE] | SYMBOLS
    return known.get(name) or Symbol(name, "–", f"covariate {name}")


def at_place(place: str, spaces: Sequence[Space] = (PLANE,)) -> list[str]:
    """Names of the symbols that are known at a place in one of these spaces."""
    return [*dict.fromkeys(name for space in spaces for name, s in KNOWN[space].items() if place in s.places)]


def _value(name: str, state: State, place: str, known: Mapping[str, Tensor | None]) -> Tensor:
    symbol = KNOWN[state.space].get(name)
    if symbol is None or place not in symbol.places:
        raise UnknownNameError(f"symbol of the place {place}", name, at_place(place, [state.space]))
    value = known.get(name) if symbol.of is None else symbol.of(state)
    if value is None:
        raise ContactLearnError(f"{name} is not known yet: give the {place} so far, or a state with mu and eps")
    return torch.as_tensor(value, dtype=torch.float64)
