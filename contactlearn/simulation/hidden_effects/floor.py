"""Hidden effects at the contact: restitution, friction, adhesion and moments that are no constants.

Restitution is settled at first touch; friction and moments follow the slip and the spin of the instant.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import torch
from torch import Tensor

from contactlearn.simulation.hidden_effects.forms import Grows, Within, form
from contactlearn.simulation.hidden_effects.world import Here, World

# Restitution


def _restoring(world: World, factor: Callable[[Here], Tensor]) -> World:
    return replace(world, restitution=(*world.restitution, factor))


@form(
    "velocity_dependent_restitution",
    "ε times (e(|v_n|)/e(2 m/s))^k, e the restitution of an elastic-plastic sphere that yields at v_0 (Thornton 1997)",
    k=Grows(3.0, "", "plus"),
    v_0=Within(0.05, 0.3, "m/s"),
)
def _(world: World, k: float, v_0: float) -> World:
    def thornton(v: Tensor) -> Tensor:
        square = (v_0 / v.clamp_min(v_0)) ** 2
        ratio = square.sqrt()
        return (
            (1.2 * math.sqrt(3)) ** 0.5
            * (1 - square / 6).sqrt()
            * (ratio / (ratio + 2 * (1.2 - 0.2 * square).sqrt())) ** 0.25
        )

    return _restoring(world, lambda here: (thornton(-here.v_c[:, 1]) / thornton(torch.full_like(here.x, 2.0))) ** k)


@form(
    "slip_dependent_restitution",
    "ε (1 + a |v_t| / (|v_t| + v_s))",
    a=Grows(0.6, ""),
    v_s=Within(0.4, 1.5, "m/s"),
)
def _(world: World, a: float, v_s: float) -> World:
    return _restoring(world, lambda here: 1 + a * here.v_c[:, 0].abs() / (here.v_c[:, 0].abs() + v_s))


@form(
    "orientation_dependent_restitution",
    "a soft spot of the body: ε (1 − a exp(κ (cos(θ − θ_0) − 1)))",
    a=Grows(0.7, "", "plus"),
    κ=Within(1.0, 4.0, ""),
    θ_0=Within(-math.pi, math.pi, "rad"),
)
def _(world: World, a: float, κ: float, θ_0: float) -> World:
    return _restoring(world, lambda here: 1 - a * torch.exp(κ * (torch.cos(here.theta - θ_0) - 1)))


@form(
    "location_dependent_restitution",
    "a floor that bends between its supports: ε (1 − a sin(π (x − x_0)/L)) over the span",
    a=Grows(0.6, "", "plus"),
    x_0=Within(0.0, 0.12, "m"),
    L=Within(0.36, 0.5, "m"),
)
def _(world: World, a: float, x_0: float, L: float) -> World:
    return _restoring(world, lambda here: 1 - a * torch.sin(math.pi * ((here.x - x_0) / L).clamp(0, 1)))


@form(
    "location_dependent_restitution",
    "a soft place of the floor: ε (1 − a exp(−(x − x_0)²/(2 w²)))",
    a=Grows(0.7, "", "plus"),
    x_0=Within(0.15, 0.43, "m"),
    w=Within(0.05, 0.12, "m"),
)
def _(world: World, a: float, x_0: float, w: float) -> World:
    return _restoring(world, lambda here: 1 - a * torch.exp(-0.5 * ((here.x - x_0) / w) ** 2))


@form(
    "configuration_dependent_restitution",
    "energy goes into vibration: ε exp(−c (r_x/ρ)²), ρ² = I/m",
    c=Grows(2.0, "", "plus"),
)
def _(world: World, c: float) -> World:
    return _restoring(world, lambda here: torch.exp(-c * here.r[:, 0] ** 2 * here.mass / here.inertia))


# Friction, at the slip of the instant


def _rubbing(world: World, factor: Callable[[Here, Tensor], Tensor]) -> World:
    return replace(world, friction=(*world.friction, factor))


@form(
    "velocity_dependent_friction",
    "Stribeck: μ (1 + a exp(−(|v_t|/v_s)^n)) at the slip of the instant",
    a=Grows(2.0, "", "plus"),
    v_s=Within(0.3, 1.0, "m/s"),
    n=Within(0.7, 2.0, ""),
)
def _(world: World, a: float, v_s: float, n: float) -> World:
    return _rubbing(world, lambda here, slip: 1 + a * torch.exp(-((slip.abs() / v_s) ** n)))


@form(
    "velocity_dependent_friction",
    "viscous: μ + b |v_t| at the slip of the instant",
    b=Grows(0.3, "s/m", "plus"),
)
def _(world: World, b: float) -> World:
    return _rubbing(world, lambda here, slip: 1 + b / world.mu * slip.abs())


@form(
    "load_dependent_friction",
    "μ (|v_n|/2 m/s)^k, |v_n| of the approach",
    k=Grows(1.2, ""),
)
def _(world: World, k: float) -> World:
    return _rubbing(world, lambda here, slip: (-here.v_c[:, 1] / 2.0) ** k)


@form(
    "directional_friction",
    "μ (1 + a) while the contact slips to the right, μ (1 − a) to the left",
    a=Grows(0.8, ""),
)
def _(world: World, a: float) -> World:
    return _rubbing(world, lambda here, slip: 1 + a * slip.sign())


@form(
    "location_dependent_friction",
    "a patch of the floor from x_1 over a width w has μ (1 + a), with edges 10 mm wide",
    a=Grows(0.9, ""),
    x_1=Within(0.12, 0.3, "m"),
    w=Within(0.1, 0.2, "m"),
)
def _(world: World, a: float, x_1: float, w: float) -> World:
    def patch(here: Here, slip: Tensor) -> Tensor:
        return 1 + 0.5 * a * (torch.tanh((here.x - x_1) / 0.01) - torch.tanh((here.x - x_1 - w) / 0.01))

    return _rubbing(world, patch)


# Wrench


@form(
    "tangential_restitution",
    "a tangential spring, k_n/k_t = c, with a dashpot that relaxes within (1/s − 1) compression times, in series "
    "with Coulomb's slider; restitution is energetic",
    s=Grows(1.0, "", "plus"),
    c=Within(0.8, 1.5, ""),
)
def _(world: World, s: float, c: float) -> World:
    return replace(world, compliant=True, energetic=True, compliance=c, resilience=s)


@form("adhesion", "the surfaces stick together: parting costs the work w", w=Grows(0.02, "J", "plus"))
def _(world: World, w: float) -> World:
    return replace(world, adhesion=w)


def _turning(world: World, lever: Callable[[Here, Tensor], Tensor]) -> World:
    return replace(world, levers=(*world.levers, lever))


@form(
    "contact_patch",
    "the centre of pressure moves by −h tanh(k r_x/h) on a contact of half-width h",
    k=Grows(1.0, "", "plus"),
    h=Within(0.003, 0.008, "m"),
)
def _(world: World, k: float, h: float) -> World:
    return _turning(world, lambda here, spin: -h * torch.tanh(k * here.r[:, 0] / h))


@form(
    "rolling_resistance",
    "moment c per normal impulse against the spin of the instant, c tanh(ω/ω_s)",
    c=Grows(0.008, "m", "plus"),
    ω_s=Within(1.0, 4.0, "rad/s"),
)
def _(world: World, c: float, ω_s: float) -> World:
    return _turning(world, lambda here, spin: -c * torch.tanh(spin / ω_s))


@form(
    "spin_damping",
    "along the contact dω/dp = −c ω/m, p the normal impulse",
    c=Grows(0.4, "s/m", "plus"),
)
def _(world: World, c: float) -> World:
    return _turning(world, lambda here, spin: -c * spin * here.inertia / here.mass)


@form(
    "parameter_drift",
    "ε falls by a share a as the surfaces wear: ε (1 − a (1 − exp(−n/(N τ)))) in trial n of N",
    a=Grows(0.6, "", "plus"),
    τ=Within(0.15, 0.8, ""),
)
def _(world: World, a: float, τ: float) -> World:
    return _restoring(world, lambda here: 1 - a * (1 - torch.exp(-here.age / τ)))


@form(
    "parameter_drift",
    "μ grows by a share a as the surfaces wear: μ (1 + a (1 − exp(−n/(N τ)))) in trial n of N",
    a=Grows(2.0, "", "plus"),
    τ=Within(0.15, 0.8, ""),
)
def _(world: World, a: float, τ: float) -> World:
    return _rubbing(world, lambda here, slip: 1 + a * (1 - torch.exp(-here.age / τ)))
