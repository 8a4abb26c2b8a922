"""Impacts whose contact scatters, simulated in small steps of the normal impulse; no code of laws and scatter is used.

A square in the plane or a cube in space falls on one corner.  The floor's normal leans at every impact, the corner
touches beside the nominal point, and restitution and friction differ.  Routh's path: along dp the contact point gains
dv_c = W (f, 1) dp; f is the friction of the disc |f| ≤ μ that leaves the least slip.  Compression ends at v_n = 0,
restitution after ε times its impulse (Poisson).
"""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import contact_jacobian, rotation, swept

STEPS, PROJECTIONS = 200, 8


@dataclass(frozen=True, kw_only=True)
class World:
    """What is planted.  Lengths in m, angles in rad, speeds in m/s."""

    space: bool = False
    mu: float = 0.2
    eps: float = 0.5
    sigma_eps: float = 0.0
    sigma_mu: float = 0.0
    sigma_normal: float = 0.0
    sigma_point: float = 0.0
    noise: float = 0.004  # m/s; the spin's is this over 30 mm
    speed_loss: float = 0.0  # ε falls by it for each m/s of approach
    structure: str = ""  # what looks like scatter and is not
    tails: float = math.inf  # degrees of freedom of the noise
    outliers: float = 0.0  # share of trials that are ten times as far off
    slip: float = 1.5  # greatest tangential speed: large slides, small sticks
    half: float = 0.03
    mass: float = 0.05
    seed: int = 0
    slope: float = 0.0  # greatest slope of a corrugation, rad


def simulated(world: World, trials: int, *, stated: bool = True) -> Impacts:
    """Return the measured impacts, with the covariances of the noise if they are `stated`."""
    generator = torch.Generator().manual_seed(7919 + world.seed)

    def normal(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=generator, dtype=torch.float64)

    def uniform(*shape: int) -> Tensor:
        return 2 * torch.rand(*shape, generator=generator, dtype=torch.float64) - 1

    n, a, d = 2 * trials, world.half, 3 if world.space else 2
    pose = normal(n, 4) if world.space else math.pi * uniform(n, 1)
    pose = pose / pose.norm(dim=-1, keepdim=True) if world.space else pose
    turn = rotation(pose) if world.space else _planar(pose[:, 0])
    r = _lowest(turn, a)
    v = torch.cat((world.slip * uniform(n, d - 1), -1.5 - 1.0 * uniform(n, 1)), -1)
    w = 8.0 * normal(n, 3 if world.space else 1)
    inertia = world.mass * a**2 * 2 / 3  # of a uniform cube, and of a square
    lean = world.sigma_normal * normal(n, d - 1)
    shift = world.sigma_point * normal(n, d - 1)
    contact = v + swept(r, w)
    approach = contact[:, -1] < -0.4
    place = 0.1 * uniform(n)
    mu = world.mu + world.sigma_mu * normal(n)
    eps = world.eps + world.sigma_eps * normal(n) - world.speed_loss * (-contact[:, -1] - 1.5)
    eps = eps + _structured(world, turn, contact, approach)
    if world.structure == "corrugation":  # of a period of 11.7 mm, across x
        along = torch.tensor([1.0] + [0.0] * (d - 2), dtype=torch.float64)
        lean = lean + world.slope * (2 * math.pi * (place + r[:, 0]) / 0.0117).sin()[:, None] * along
    frame = _leaning(lean)
    point = r + (frame[..., :-1] @ shift[..., None])[..., 0]
    jacobian = frame.mT @ contact_jacobian(point)
    back = torch.diag(torch.tensor([1 / world.mass] * d + [1 / inertia] * w.shape[1], dtype=torch.float64))
    before = torch.cat((v, w), -1)
    contact = (jacobian @ before[..., None])[..., 0]
    approach &= contact[:, -1] < -0.2
    P = _impulse(jacobian @ back @ jacobian.mT, contact, mu.clamp_min(0), eps.clamp(0, 1))
    after = before + (back @ jacobian.mT @ P[..., None])[..., 0]
    sigma = torch.tensor([world.noise] * d + [world.noise / 0.03] * w.shape[1], dtype=torch.float64)
    rows = approach.nonzero()[:trials, 0]
    seen = []
    for true in (before, after):
        error = normal(n, len(sigma))
        if world.tails < math.inf:
            chi = normal(n, int(world.tails)).square().mean(-1, keepdim=True)
            error = error / chi.sqrt() * math.sqrt((world.tails - 2) / world.tails)
        far = torch.rand(n, 1, generator=generator) < world.outliers / 2
        seen.append(true + sigma * torch.where(far, 10.0, 1.0) * error)
    rows = rows[(seen[0][:, :d] + swept(r, seen[0][:, d:]))[rows, -1] < -0.05]
    r, v_pre, v_post, place, pose = (x[rows] for x in (r, *seen, place, pose))
    count = len(rows)
    position = torch.cat((place[:, None].expand(-1, d - 1), -r[:, -1:]), -1)
    covariance = torch.diag(sigma.square()).expand(count, -1, -1)
    moments = torch.full((count, 3) if world.space else (count,), inertia, dtype=torch.float64)
    return Impacts(
        torch.full((count,), world.mass, dtype=torch.float64),
        moments,
        r,
        torch.cat((position, pose), -1),
        v_pre,
        v_post,
        v_pre_cov=covariance if stated else None,
        v_post_cov=covariance if stated else None,
        source=f"scattered impacts, seed {world.seed}",
    )


def _structured(world: World, turn: Tensor, v: Tensor, approach: Tensor) -> Tensor:
    """Change of ε by what is no scatter, of rows that become trials."""
    size, change = 0.1 * math.sqrt(2), torch.zeros(len(v), dtype=torch.float64)
    if world.structure == "pose":  # turns over every fifteen degrees
        angle = torch.atan2(turn[:, 1, 0], turn[:, 0, 0]) if not world.space else turn[:, 2, :].acos()[:, 0]
        return change + size * (24 * angle).sin()
    if world.structure == "heading":  # of the slip, as over a weave
        return change + size * (12 * torch.atan2(v[:, 1], v[:, 0])).sin()
    if world.structure == "speed":
        return change + size * (12 * v[:, -1]).sin()
    if world.structure == "memory":  # of the speed of the last impact
        rows = approach.nonzero()[:, 0]
        last = v[rows, -1].roll(1)
        change[rows] = size * ((last - last.mean()) / last.std()) / math.sqrt(2)
    return change


def _impulse(W: Tensor, contact: Tensor, mu: Tensor, eps: Tensor) -> Tensor:
    """Impulse [N, d] of Routh's path in steps, from the contact's velocity."""
    tangent = W[:, :-1, :-1]
    rate = 1 / torch.linalg.eigvalsh(tangent)[:, -1:]
    total, friction = torch.zeros_like(contact), torch.zeros_like(contact[:, :-1])
    velocity, compression = contact.clone(), torch.zeros_like(mu)
    for phase in (0, 1):
        going = torch.ones_like(mu, dtype=torch.bool)
        size = -velocity[:, -1] / W[:, -1, -1] / STEPS if phase == 0 else eps * compression / STEPS
        for _ in range(8 * STEPS if phase == 0 else STEPS):
            dp = size.clamp_min(1e-300)[:, None]
            for _ in range(PROJECTIONS if friction.shape[-1] > 1 else 1):  # in the plane the first is exact
                slip = velocity[:, :-1] / dp + W[:, :-1, -1] + (tangent @ friction[..., None])[..., 0]
                friction = friction - rate * slip
                friction = friction * (mu[:, None] / friction.norm(dim=-1, keepdim=True).clamp_min(1e-300)).clamp_max(1)
            push = torch.cat((friction, torch.ones_like(dp)), -1)
            rise = (W @ push[..., None])[..., 0]
            if phase == 0:
                left = torch.where(rise[:, -1] > 0, -velocity[:, -1] / rise[:, -1].clamp_min(1e-300), math.inf)
                dp = torch.minimum(size, left)[:, None]
            dp = torch.where(going[:, None], dp, 0.0)
            velocity, total = velocity + rise * dp, total + push * dp
            if phase == 0:
                going &= velocity[:, -1] < -1e-12
                if not going.any():
                    break
        if phase == 0:
            compression = total[:, -1].clone()
    return total


def _planar(angle: Tensor) -> Tensor:
    c, s = angle.cos(), angle.sin()
    return torch.stack((torch.stack((c, -s), -1), torch.stack((s, c), -1)), -2)


def _lowest(turn: Tensor, half: float) -> Tensor:
    d = turn.shape[-1]
    corners = half * torch.cartesian_prod(*[torch.tensor([-1.0, 1.0], dtype=torch.float64)] * d)
    world = corners @ turn.mT
    return world[torch.arange(len(turn)), world[..., -1].argmin(-1)]


def _leaning(lean: Tensor) -> Tensor:
    """Rotations [N, d, d] whose last column is the normal, leaning by small angles along each tangent."""
    if lean.shape[-1] == 1:
        return _planar(-lean[:, 0])
    angle = lean.norm(dim=-1, keepdim=True).clamp_min(1e-300)
    axis = torch.cat((-lean[:, 1:], lean[:, :1], torch.zeros_like(angle)), -1) / angle
    return rotation(torch.cat(((angle / 2).cos(), (angle / 2).sin() * axis), -1))
