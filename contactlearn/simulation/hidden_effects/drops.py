"""Mystery drops: a body, a law, noise and hidden effects, all drawn from a seed.

    body        an ellipse of uniform density: a ~ U(30, 45) mm, b/a ~ U(0.5, 0.8), m ~ U(20, 80) g
    law         Poisson's or Stronge's restitution, ε ~ U(0.4, 0.8), μ ~ U(0.08, 0.3)
    noise       σ ~ U(5, 15) mm/s on v_x and v_y, U(0.2, 0.6) rad/s on ω, before and after contact
    drops       θ ~ U(−π, π) rad,   x ~ U(0.08, 0.5) m,   ω ~ N(0, 8²) rad/s
                |v_x| ~ U(0.2, 2.5) m/s to either side,   v_y ~ U(−3.5, −1.2) m/s

Reported values are nominal: mass and moment of inertia of the drawing, the contact point of the nominal
shape at the reported θ on a level floor, y its height, velocities of the tracked point.  A drop whose
contact point does not approach clearly (v_n ≥ −5 % of the speed), truly or as reported, is drawn again.

The size of an effect is how much it changes v_post in the mass norm, √(ΔᵀMΔ) / √(vᵀMv), as an rms over
the drops.  Each is made as large as a multiple of the same measure of the noise, drawn from `strength`,
unless its plausible limit is reached first.
"""

import math
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any, NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from contactlearn.core.errors import DataError
from contactlearn.core.numerics import whole
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import contact_velocity
from contactlearn.mechanics.shapes import Ellipse, Shape, contact_point
from contactlearn.simulation.hidden_effects.effects import choose, forms
from contactlearn.simulation.hidden_effects.world import GRAZING, States, World

LAWS = {False: "wang_mason", True: "mirtich"}
"""The textbook law of a world without hidden effects, by whether restitution is energetic."""

_USUAL = 500  # drops of a sequence, of which a drift is a function, and on some of which effects get their size
_SAMPLE = 200  # drops on which the size of an effect is found
_STEPS = 100  # of each phase of those contacts
_TOLERANCE = 0.02  # relative error of the size of an effect


def draw(
    seed: int,
    *,
    size: int = 500,
    effects: Sequence[str] | None = None,
    noise: float = 1.0,
    strength: tuple[float, float] = (2, 5),
    scatter: float = 0.0,
) -> tuple[Impacts, dict[str, Any]]:
    """Drops and the truth about them; the same arguments give the same bits.

    The body, the law and the drops of a seed are the same whatever is hidden.

    Args:
        seed: an integer in [0, 2⁶³).
        size: number of drops.
        effects: names of `EFFECTS` or `UNKNOWN` to hide; None draws one to three of `EFFECTS`.
        noise: factor on the noise that is drawn.  Effects are measured by the noise at factor 1.
        strength: range in which the change by each effect lies, in units of the noise.
        scatter: standard deviation of μ and ε from drop to drop, as a share of each, drawn independently.

    Returns:
        The impacts, and a dictionary of plain values: `seed`, `size`, `law`, `mu`, `eps`; `noise` with
        the standard deviations of v (m/s) and ω (rad/s); `scatter`; `body`; `effects`, each with its name, form,
        parameters, their units and the `relative_change` that it makes on its own; `v_post`, the
        outcomes as reported but without noise; `v_post_from_measured`, the true outcomes of the noisy
        states without scatter, the best that a model can predict from them; and `v_post_without`, the outcomes
        without noise and hidden effects.

    Raises:
        DataError: a value out of its range, or an effect named twice.
        UnknownNameError: no such effect.
    """
    whole("seed", seed, 0)
    whole("size", size, 1)
    if not 0 <= noise < math.inf:
        raise DataError(f"noise must be a finite factor, at least 0, got {noise!r}")
    if len(strength) != 2 or not 0 <= strength[0] <= strength[1] < math.inf:
        raise DataError(f"strength must be a range [low, high] with 0 ≤ low ≤ high, got {strength!r}")
    if not 0 <= scatter < 1:
        raise DataError(f"scatter must be a share of μ and ε, at least 0 and below 1, got {scatter!r}")
    names = choose(random.Random(f"mystery {seed} effects")) if effects is None else _named(effects)
    shape, mass, plain, sigma = _laboratory(seed, names)
    pool = _pool(seed, size, shape, mass, noise * sigma)
    chosen, world = _world(seed, names, pool, shape, plain, sigma, strength)
    drops = pool.rows(_clear(pool, shape, world), size)
    if len(drops.noise) < size:
        raise DataError(
            f"only {len(drops.noise)} of {size} drops approach the floor clearly; use less noise than {noise}"
        )
    unit = torch.randn(size, 2, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    v_post = _scattered(world, scatter, unit).outcome(drops.states)
    truth: dict[str, Any] = {
        "seed": seed,
        "size": size,
        "law": LAWS[plain.energetic],
        "mu": plain.mu,
        "eps": plain.eps,
        "noise": {"v": noise * sigma[0].item(), "omega": noise * sigma[2].item()},
        "scatter": scatter,
        "body": {"semi_axes": list(shape.semi_axes), "mass": mass},
    }
    truth |= _account(plain, world, chosen, drops, v_post)
    return _reported(drops, v_post, shape, f"mystery drops (seed {seed})"), truth


def _laboratory(seed: int, effects: Sequence[str]) -> tuple[Ellipse, float, World, Tensor]:
    """Nominal body, its mass in kg, the world without hidden effects, and the noise (σ_vx, σ_vy, σ_ω) at factor 1."""
    rng = random.Random(f"mystery {seed}")
    a, energetic = rng.uniform(0.03, 0.045), rng.random() < 0.5
    shape = Ellipse((round(a, 4), round(a * rng.uniform(0.5, 0.8), 4)))
    mass, eps, mu = round(rng.uniform(0.02, 0.08), 4), rng.uniform(0.4, 0.8), rng.uniform(0.08, 0.3)
    sigma = torch.tensor([rng.uniform(0.005, 0.015)] * 2 + [rng.uniform(0.2, 0.6)], dtype=torch.float64)
    compliant = "tangential_restitution" in effects
    return shape, mass, World(shape, mu, eps, energetic or compliant, compliant), sigma


def _world(
    seed: int,
    names: Sequence[str],
    pool: "_Drops",
    shape: Shape,
    plain: World,
    sigma: Tensor,
    strength: tuple[float, float],
) -> tuple[list["_Chosen"], World]:
    """The hidden effects, at sizes found on a pool of drops, and the world with them."""
    sample = pool.rows(_clear(pool, shape, plain), _SAMPLE)
    chosen = [_chosen(seed, name, plain, sample, sigma, strength) for name in names]
    return chosen, reduce(lambda world, effect: effect.act(world), chosen, plain)


@dataclass(frozen=True, kw_only=True)
class Laboratory:
    """The laboratory of a seed, in which drops are made as they are asked for.

    It hides what `draw` hides with the same arguments, and measures with the same noise.  The effects have their size
    on the usual drops of `draw`, whatever is asked for.

    Args:
        shape: nominal one of the body.
        mass: of the body in kg.
        world: what is hidden.
        sigma: standard deviations of the measured v_x, v_y (m/s) and ω (rad/s), before impact as after it.
        scatter: standard deviation of μ and ε from drop to drop, as a share of each.
        source: in words.
    """

    shape: Ellipse
    mass: float
    world: World
    sigma: Float[Tensor, "3"]
    scatter: float
    source: str

    @classmethod
    def of(
        cls,
        seed: int,
        *,
        effects: Sequence[str] | None = None,
        noise: float = 1.0,
        strength: tuple[float, float] = (2, 5),
        scatter: float = 0.0,
    ) -> "Laboratory":
        """Set up the laboratory of a seed; see `draw` for the arguments and errors."""
        names = choose(random.Random(f"mystery {seed} effects")) if effects is None else _named(effects)
        shape, mass, plain, sigma = _laboratory(seed, names)
        pool = _pool(seed, _USUAL, shape, mass, noise * sigma)
        _, world = _world(seed, names, pool, shape, plain, sigma, strength)
        source = f"mystery drops (seed {seed})"
        return cls(shape=shape, mass=mass, world=world, sigma=noise * sigma, scatter=scatter, source=source)

    @property
    def inertia(self) -> float:
        """Reported moment of inertia in kg m²."""
        return self.mass * self.shape.gyration_squared()

    def measured(self, drops: Impacts, generator: torch.Generator) -> tuple[Impacts | None, Bool[Tensor, "n"]]:
        """Measure drops from true states before impact, in order; tell which of them touch the floor clearly.

        Args:
            drops: states as they are; mass, inertia and v_post play no part.
            generator: of noise and scatter.
        """
        n, theta = len(drops), drops.q[:, 2]
        noise = self.sigma * torch.randn((n, 2, 3), generator=generator, dtype=torch.float64)
        mass = torch.full((n,), self.mass, dtype=torch.float64)
        known = States(
            mass, mass * self.shape.gyration_squared(), drops.q[:, 0], theta, drops.v_pre, drops.order / _USUAL
        )
        every = _Drops(known, noise)
        good = _clear(every, self.shape, self.world)
        if not good.any():
            return None, good
        unit = torch.randn(n, 2, generator=generator, dtype=torch.float64)
        world = _scattered(self.world, self.scatter, unit[good])
        own = _Drops(States(*(value[good] for value in known)), noise[good])
        found = _reported(own, world.outcome(own.states), self.shape, self.source)
        return found.replace(order=drops.order[good]), good


def _scattered(world: World, scatter: float, unit: Float[Tensor, "n 2"]) -> World:
    """The world of n drops whose μ and ε differ from drop to drop."""
    if scatter == 0:
        return world
    mu, eps = (1 + scatter * unit).unbind(-1)
    return replace(
        world, restitution=(*world.restitution, lambda _: eps), friction=(*world.friction, lambda _, slip: mu)
    )


def _account(
    plain: World, world: World, chosen: Sequence["_Chosen"], drops: "_Drops", v_post: Tensor
) -> dict[str, Any]:
    """Effects and outcomes of the truth; see `draw`."""
    without = plain.outcome(drops.states)
    measured = drops.states._replace(v=drops.states.v + drops.noise[:, 0])
    touches = world.approaches(measured)
    return {
        "effects": [effect.account(plain, drops.states, without) for effect in chosen],
        "v_post": v_post.tolist(),
        "v_post_from_measured": torch.where(touches[:, None], world.outcome(measured), v_post).tolist(),
        "v_post_without": without.tolist(),
    }


class _Drops(NamedTuple):
    """Drops as reported, and the noise [N, 2, 3] before and after contact."""

    states: States
    noise: Tensor

    def rows(self, good: Tensor, count: int) -> "_Drops":
        """The first `count` good ones, in the order of their measurement."""
        rows = good.nonzero()[:count, 0]
        states = States(*(value[rows] for value in self.states))
        age = torch.arange(1, len(rows) + 1, dtype=torch.float64) / len(rows)
        return _Drops(states._replace(age=age), self.noise[rows])


class _Chosen(NamedTuple):
    """A hidden effect at its size."""

    name: str
    text: str
    act: Callable[[World], World]
    values: dict[str, float]
    units: dict[str, str]

    def account(self, plain: World, states: States, without: Tensor) -> dict[str, Any]:
        return {
            "name": self.name,
            "form": self.text,
            "parameters": self.values,
            "units": self.units,
            "relative_change": _change(self.act(plain), states, without).item(),
        }


def _change(world: World, states: States, without: Tensor, steps: int | None = None) -> Tensor:
    """RMS relative change of the outcomes by a world's effects, where its contacts approach."""
    good = world.approaches(states)  # with the other effects all do
    some = States(*(value[good] for value in states))
    change = _relative(world.outcome(some, steps) - without[good], without[good], some)
    return change.square().mean().sqrt()


def _chosen(
    seed: int, name: str, plain: World, sample: _Drops, sigma: Tensor, strength: tuple[float, float]
) -> _Chosen:
    """An effect with its form and parameters, at a size drawn from the strength."""
    rng = random.Random(f"mystery {seed} {name}")
    form, multiple = rng.choice(forms(name)), rng.uniform(*strength)
    parameters = form.draw(rng)
    states = sample.states
    without = plain.outcome(states, _STEPS)
    typical = _relative(sigma, without, states).square().mean().sqrt()

    def share(size: float) -> float:
        return (_change(form.act(plain, **parameters(size)), states, without, _STEPS) / typical).item()

    values = parameters(_size(share, multiple))
    units = {symbol: parameter.unit for symbol, parameter in form.parameters.items()}
    return _Chosen(name, form.text, lambda world: form.act(world, **values), values, units)


def _size(share: Callable[[float], float], wanted: float) -> float:
    """Size in [0, 1] at which the share is as wanted, by false position (Illinois); 1 where it is never reached."""
    low, below, high, above = 0.0, -wanted, 1.0, share(1.0) - wanted
    if above <= 0:
        return 1.0
    side, size = 0, 0.0
    for _ in range(20):
        size = (low * above - high * below) / (above - below)
        miss = share(size) - wanted
        if abs(miss) <= _TOLERANCE * wanted:
            break
        if miss > 0:
            high, above, below = size, miss, below / 2 if side > 0 else below
        else:
            low, below, above = size, miss, above / 2 if side < 0 else above
        side = 1 if miss > 0 else -1
    return size


def _relative(change: Tensor, v: Tensor, states: States) -> Tensor:
    """√(ΔᵀMΔ) / √(vᵀMv) of a change of v [N, 3], as [N]."""
    weight = torch.stack((states.mass, states.mass, states.inertia), -1)
    return ((weight * change**2).sum(-1) / (weight * v**2).sum(-1)).sqrt()


def _pool(seed: int, size: int, shape: Shape, mass: float, sigma: Tensor) -> _Drops:
    """More drops than are needed."""
    n = size * 3 // 2 + 100
    generator = torch.Generator().manual_seed(seed)

    def uniform(low: float, high: float) -> Tensor:
        return low + (high - low) * torch.rand(n, generator=generator, dtype=torch.float64)

    x, theta, v_y = uniform(0.08, 0.5), uniform(-math.pi, math.pi), uniform(-3.5, -1.2)
    v_x = uniform(0.2, 2.5) * uniform(-1, 1).sign()
    spin = 8 * torch.randn(n, generator=generator, dtype=torch.float64)
    noise = sigma * torch.randn((n, 2, 3), generator=generator, dtype=torch.float64)
    masses = torch.full((n,), mass, dtype=torch.float64)
    v = torch.stack((v_x, v_y, spin), -1)
    return _Drops(States(masses, masses * shape.gyration_squared(), x, theta, v, x), noise)


def _clear(pool: _Drops, shape: Shape, world: World) -> Tensor:
    """Where the contact point approaches, as reported with and without noise, and truly: bool [N]."""
    states = pool.states
    r = contact_point(shape, states.theta)
    good = world.approaches(states)
    for v in (states.v, states.v + pool.noise[:, 0]):
        good &= contact_velocity(r, v)[:, 1] < -GRAZING * v[:, :2].norm(dim=-1)
    return good


def _reported(drops: _Drops, v_post: Tensor, shape: Shape, source: str) -> Impacts:
    states = drops.states
    r = contact_point(shape, states.theta)
    return Impacts(
        mass=states.mass,
        inertia=states.inertia,
        r=r,
        q=torch.stack((states.x, -r[:, 1], states.theta), -1),
        v_pre=states.v + drops.noise[:, 0],
        v_post=v_post + drops.noise[:, 1],
        object=("ellipse",) * len(r),
        shape=shape,
        source=source,
    )


def _named(effects: Sequence[str]) -> list[str]:
    if isinstance(effects, str):
        raise DataError(f"effects must be a list of names, such as [{effects}], got {effects!r}")
    for name in effects:
        forms(name)
    if len(set(effects)) < len(effects):
        raise DataError(f"each effect can be hidden once, got {', '.join(effects)}")
    return list(effects)
