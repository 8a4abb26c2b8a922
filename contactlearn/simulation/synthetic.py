"""Synthetic drops of a planar body: a known law, known noise, nothing else.

States are spread like those of the published drops:

    θ ~ U(−π, π) rad            v_x ~ U(0.3, 0.9) m/s       x ~ U(0.08, 0.5) m
    y = height at contact       v_y ~ U(−2.9, −2.2) m/s     ω ~ N(0, 6²) rad/s

The law gives v_post from the true v_pre; then independent Gaussian noise is added to both, as two
camera fits would have it.  The contact point and the pose stay exact; that of a polygon jumps from
corner to corner as θ grows.  Drops in which the contact point does not approach the floor, truly or
as measured, are drawn again: with the default body and noise that never happens in practice; with a
long body or much noise it narrows the spreads above.
"""

import math
from collections.abc import Iterator
from typing import Any

import torch
from torch import Tensor

from contactlearn import laws
from contactlearn.core.errors import DataError
from contactlearn.core.numerics import finite_number, random, whole
from contactlearn.data.blocks import BLOCK
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import contact_velocity
from contactlearn.mechanics.shapes import Ellipse, Shape, contact_point, make_shape
from contactlearn.models.contact_model import ContactModel


def load(
    size: int = 800,
    law: str = "wang_mason",
    mu: float = 0.12,
    eps: float = 0.55,
    shape: dict[str, Any] | Shape | None = None,
    mass: float = 0.0364,
    velocity_noise: float = 0.01,
    spin_noise: float = 0.5,
    seed: int = 0,
    variant: str = "textbook",
) -> Impacts:
    """Simulated drops; the same arguments give the same drops, and no global state is touched.

    Args:
        size: number of drops, at least 1.
        law: name of the law that is true.
        mu: its coefficient of friction, at least 0.
        eps: its coefficient of restitution, in [0, 1].
        shape: body of uniform density, or its specification for `contactlearn.mechanics.shapes.make_shape`;
            None is the published one, an ellipse with semi-axes of 0.035 m and 0.025 m.
        mass: in kg.
        velocity_noise: standard deviation in m/s of the noise on v_x and v_y, before and after.
        spin_noise: standard deviation in rad/s of the noise on ω, before and after.
        seed: of the random states and noise, an integer in [0, 2⁶³).
        variant: of the law.

    Raises:
        DataError: a value out of its range, or a polygon whose centroid is not at the origin.
        UnknownNameError: no such law, variant or kind of shape.
    """
    size, seed = whole("size", size, 1), whole("seed", seed, 0)
    true = laws.find(law, variant).at(finite_number("mu", mu, 0), finite_number("eps", eps, 0, 1))
    mass = finite_number("mass", mass, 0, above=True)
    sigma_v, sigma_omega = (
        finite_number("velocity_noise", velocity_noise, 0),
        finite_number("spin_noise", spin_noise, 0),
    )
    sigma = torch.tensor((sigma_v, sigma_v, sigma_omega), dtype=torch.float64)
    body = make_shape(shape) or Ellipse((0.035, 0.025))
    r, q, v, noise = _draw(size, body, sigma, torch.Generator().manual_seed(seed))
    masses = torch.full((size,), mass, dtype=torch.float64)
    exact = Impacts(
        mass=masses,
        inertia=masses * body.gyration_squared(),
        r=r,
        q=q,
        v_pre=v,
        v_post=v,  # not known yet
        q_post=q,
        object=(type(body).__name__.lower(),) * size,
        shape=body,
        source=f"synthetic drops ({law}, seed {seed})",
    )
    v_post = ContactModel(true).predict(exact).v_post
    return exact.replace(v_pre=v + noise[:, 0], v_post=v_post + noise[:, 1])


def many(size: int, seed: int = 0) -> Iterator[Impacts]:
    """Yield any number of default drops in blocks; each block has a seed of its own.

    Raises:
        DataError: a size below 1, or a seed that is no whole number.
    """
    for place, first in enumerate(range(0, whole("size", size, 1), BLOCK)):
        drops = load(size=min(BLOCK, size - first), seed=seed + place)
        rows = range(first + 1, first + len(drops) + 1)
        yield drops.replace(trial=tuple(map(str, rows)), order=torch.tensor(rows), source=f"synthetic drops ({seed} …)")


def _draw(size: int, body: Shape, sigma: Tensor, generator: torch.Generator) -> tuple[Tensor, ...]:
    """r [size, 2], q and the true v_pre [size, 3], and the noise before and after [size, 2, 3]."""
    low, high = torch.tensor(((0.08, -math.pi, 0.3, -2.9), (0.5, math.pi, 0.9, -2.2)), dtype=torch.float64)
    batches, found = [], 0
    for _ in range(100):
        x, theta, v_x, v_y = (low + (high - low) * random(torch.rand, (size, 4), generator)).unbind(-1)
        v = torch.stack((v_x, v_y, 6 * random(torch.randn, (size,), generator)), -1)
        noise = sigma * random(torch.randn, (size, 2, 3), generator)
        r = contact_point(body, theta)
        q = torch.stack((x, -r[:, 1], theta), -1)
        approaches = (contact_velocity(r, v)[:, 1] < 0) & (contact_velocity(r, v + noise[:, 0])[:, 1] < 0)
        batches.append([part[approaches] for part in (r, q, v, noise)])
        found += int(approaches.sum())
        if found >= size:
            return tuple(torch.cat(parts)[:size] for parts in zip(*batches, strict=True))
    # ω and the noise are symmetric, so any body approaches in a quarter of the draws; only nan does not.
    raise DataError(
        f"only {found} of {100 * size} draws approach the floor, so their numbers overflow or underflow: "
        f"are the lengths in metres, {body}, and the noise right?"
    )
