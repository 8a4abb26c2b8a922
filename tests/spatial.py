"""Bodies in space for tests: planar ones seen in space, and random ones."""

from collections.abc import Callable

import torch
from torch import Tensor

from contactlearn.laws import find
from contactlearn.mechanics.bodies import contact_points
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import contact_velocity
from contactlearn.mechanics.shapes import Cuboid, Ellipse, Ellipsoid
from contactlearn.models.contact_model import ContactModel

BOX = Cuboid((0.05, 0.035, 0.02))
Coefficient = float | Callable[[Impacts], Tensor]
ACROSS = torch.tensor((0.0, 1.0, 0.0), dtype=torch.float64)


def vectors(planar: Tensor) -> Tensor:
    """(x, y) [..., 2] of the plane as (x, 0, z) [..., 3]."""
    x, y = planar.unbind(-1)
    return torch.stack((x, 0 * x, y), -1)


def matrices(W: Tensor, across: Tensor) -> Tensor:
    """W [..., 2, 2] of the plane in space [..., 3, 3], with a value [...] across it."""
    (tt, tn), (nt, nn) = (row.unbind(-1) for row in W.unbind(-2))
    zero = torch.zeros_like(tt)
    rows = (tt, zero, tn), (zero, across.expand_as(tt), zero), (nt, zero, nn)
    return torch.stack([torch.stack(row, -1) for row in rows], -2)


def velocities(planar: Tensor) -> Tensor:
    """(v_x, v_y, ω) [..., 3] of the plane as six components, ω about −y; wrenches likewise."""
    return torch.cat((vectors(planar[..., :2]), -planar[..., 2:] * ACROSS), -1)


def poses(q: Tensor) -> Tensor:
    """(x, y, θ) [..., 3] of the plane as position and quaternion [..., 7]."""
    half = q[..., 2:] / 2
    return torch.cat((vectors(q[..., :2]), half.cos(), -half.sin() * ACROSS), -1)


def in_space(impacts: Impacts) -> Impacts:
    """Planar impacts as spatial ones of bodies that are twice as hard to turn about the other axes."""
    fields = {"q": poses(impacts.q), "r": vectors(impacts.r), "shape": None}
    if isinstance(impacts.shape, Ellipse):
        a, b = impacts.shape.semi_axes
        fields["shape"] = Ellipsoid((a, 2 * a, b))
    fields |= {} if impacts.q_post is None else {"q_post": poses(impacts.q_post)}
    fields |= {name: velocities(getattr(impacts, name)) for name in ("v_pre", "v_post")}
    return impacts.replace(inertia=impacts.inertia[:, None] * torch.tensor((2.0, 1.0, 2.0)).double(), **fields)


def tossed(count: int, seed: int = 0) -> Impacts:
    """Random bodies in random poses on approach, with any outcome."""
    generator = torch.Generator().manual_seed(seed)

    def normal(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=generator, dtype=torch.float64)

    mass = 0.1 + normal(count).abs()
    size = torch.rand(count, 3, generator=generator, dtype=torch.float64) + 0.2  # semi-axes of an ellipsoid, 0.1 m
    inertia = mass[:, None] * 0.002 * (size.square().sum(-1, keepdim=True) - size.square())
    r = 0.1 * torch.cat((normal(count, 2), -0.1 - normal(count, 1).abs()), -1)
    quaternion = normal(count, 4)
    q = torch.cat((normal(count, 3), quaternion / quaternion.norm(dim=-1, keepdim=True)), -1)
    v_pre = torch.cat((normal(count, 3), 5 * normal(count, 3)), -1)
    swept = v_pre[:, 3] * r[:, 1] - v_pre[:, 4] * r[:, 0]
    v_pre[:, 2] = -swept - 0.1 - normal(count).abs()
    v_post = v_pre + torch.cat((normal(count, 3), 5 * normal(count, 3)), -1)
    return Impacts(mass, inertia, r, q, v_pre, v_post)


def box_tosses(mu: Coefficient, eps: Coefficient, *, noise: float, count: int = 200) -> Impacts:
    """Tosses of a box that Wang–Mason resolves, with noise in m/s, and 30 times that in rad/s, after contact.

    Args:
        mu: friction, or a function of the impacts before contact that gives it for each.
        eps: restitution, likewise.
        noise: standard deviation of a velocity.
        count: of tosses.
    """
    generator, many = torch.Generator().manual_seed(1), 5 * count
    q = torch.randn(many, 4, generator=generator, dtype=torch.float64)
    q = q / q.norm(dim=-1, keepdim=True)
    r = contact_points(BOX, None, q)
    v = torch.randn(many, 6, generator=generator, dtype=torch.float64) * torch.tensor((1.5, 1.5, 0.5, 8, 8, 8))
    v[:, 2] -= 1.5
    rows = (contact_velocity(r, v)[:, 2] < -0.2).nonzero()[:count, 0]
    place = torch.cat((torch.rand(many, 2, generator=generator, dtype=torch.float64), -r[:, 2:]), -1)
    mass = torch.full((many,), 0.3, dtype=torch.float64)
    columns = (mass, (0.3 * BOX.gyration_squared()).expand(many, 3), r, torch.cat((place, q), -1), v, v)
    impacts = Impacts(*(column[rows] for column in columns), shape=BOX, validate=False)
    law = find("wang_mason").at(*(one(impacts) if callable(one) else one for one in (mu, eps)))
    v_post = ContactModel(base=law, effects={}).predict(impacts).v_post
    errors = torch.randn(v_post.shape, generator=generator, dtype=torch.float64)
    return impacts.replace(v_post=v_post + noise * errors * torch.tensor((1.0, 1, 1, 30, 30, 30)))
