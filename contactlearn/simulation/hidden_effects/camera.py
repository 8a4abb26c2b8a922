"""Hidden effects before and after contact: what the camera and the drawings of the body have wrong."""

import math
from dataclasses import replace

from contactlearn.simulation.hidden_effects.forms import Grows, form, later, push
from contactlearn.simulation.hidden_effects.world import World

GRAVITY = 9.81  # m/s²


# State: what was measured or assumed before contact


@form("surface_tilt", "the floor is inclined by φ", φ=Grows(0.1, "rad"))
def _(world: World, φ: float) -> World:
    return replace(world, tilt=φ)


@form(
    "com_offset",
    "the centre of mass lies (δ_a, δ_b) off the tracked point, along the body's axes",
    δ_a=Grows(0.006, "m", share=0.3),
    δ_b=Grows(0.006, "m", share=0.3),
)
def _(world: World, δ_a: float, δ_b: float) -> World:
    return replace(world, centre=(δ_a, δ_b))


@form("inertia_error", "the true moment of inertia is I e^κ", κ=Grows(0.6, ""))
def _(world: World, κ: float) -> World:
    return replace(world, heaviness=math.exp(κ))


@form("orientation_offset", "the true orientation is θ + δ", δ=Grows(0.3, "rad"))
def _(world: World, δ: float) -> World:
    return replace(world, turn=δ)


@form(
    "sampling_delay", "contact comes Δt after the reported pose; velocities are those at contact", Δt=Grows(0.012, "s")
)
def _(world: World, Δt: float) -> World:
    return replace(world, delay=Δt)


@form(
    "shape_error",
    "the true semi-axes are (1 + s_a, 1 + s_b) times the nominal ones",
    s_a=Grows(0.25, "", share=0.3),
    s_b=Grows(0.25, "", share=0.3),
)
def _(world: World, s_a: float, s_b: float) -> World:
    return replace(world, scale=(1 + s_a, 1 + s_b))


# Velocity: between contact and the second measurement


@form(
    "spin_damping",
    "after contact the spin decays to ω e^(−c) before it is measured",
    c=Grows(0.8, "", "plus"),
)
def _(world: World, c: float) -> World:
    return later(world, lambda here, v: push(v, spin=v[:, 2] * math.expm1(-c)))


@form("gravity_impulse", "gravity acts for Δt before the velocity is measured", Δt=Grows(0.03, "s", "plus"))
def _(world: World, Δt: float) -> World:
    return later(world, lambda here, v: push(v, y=-GRAVITY * Δt))


@form("side_drag", "guide walls slow v_x and v_y down by e^(−c) after contact", c=Grows(0.3, "", "plus"))
def _(world: World, c: float) -> World:
    return later(world, lambda here, v: push(v, v[:, 0] * math.expm1(-c), v[:, 1] * math.expm1(-c)))
