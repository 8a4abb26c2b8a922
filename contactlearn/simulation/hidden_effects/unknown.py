"""Hidden effects that no catalogue describes: an analysis should see that something is missing, and not name it."""

import torch
from torch import Tensor

from contactlearn.simulation.hidden_effects.forms import Grows, later, push, uncatalogued
from contactlearn.simulation.hidden_effects.world import Here, World


@uncatalogued("magnetic_pull", "a magnet turns the body by an impulse K cos 3θ", K=Grows(4e-4, "N m s"))
def _(world: World, K: float) -> World:
    return later(world, lambda here, v: push(v, spin=K * torch.cos(3 * here.theta) / here.inertia))


@uncatalogued("elastic_strap", "a strap pulls sideways, P_t + k m x v_y of the approach", k=Grows(1.0, "1/m"))
def _(world: World, k: float) -> World:
    def pull(here: Here, v: Tensor) -> Tensor:
        change = k * here.x * here.v[:, 1]
        return push(v, x=change, spin=-here.r[:, 1] * change * here.mass / here.inertia)

    return later(world, pull)


@uncatalogued("spin_lift", "spin lifts the body, P_n + k m ω v_x of the approach", k=Grows(0.05, "s"))
def _(world: World, k: float) -> World:
    def lift(here: Here, v: Tensor) -> Tensor:
        change = k * here.v[:, 2] * here.v[:, 0]
        return push(v, y=change, spin=here.r[:, 0] * change * here.mass / here.inertia)

    return later(world, lift)
