"""Tosses whose contacts are followed in small steps of the normal impulse; it shares no code with laws and effects.

Along dp the contact point gains dv_c = (A_n + A_t f) dp + (l I⁻¹ n × r) dp with A = 1/m − [r]× I⁻¹ [r]×, f the
friction |f| ≤ μ and l the moment per normal impulse about the normal, |l| ≤ torsion.  Each step is implicit: f is the
point of its disc that leaves the least slip in the metric of A, by projected gradients, and l likewise.  Compression
ends at v_n = 0; restitution after ε times its normal impulse (Poisson), or ε² times its work (Stronge).  Friction that
depends on the slip follows that of the instant.  Sources: Routh (1860); Keller (1986); Stronge (1990).
"""

import math

import torch
from torch import Tensor

from contactlearn.mechanics.impacts import Impacts
from tosses.facts import HALF, MASS, NOISE, Facts, lowest, rotation, table, tossed

GRAVITY, STEPS, PROJECTIONS = 9.81, 150, 6
_UP = torch.tensor((0.0, 0.0, 1.0), dtype=torch.float64)


def reported(facts: Facts, trials: int, seed: int) -> Impacts:
    """Return the table that the laboratory reports."""
    generator = torch.Generator().manual_seed(1000 + seed)
    n = 3 * trials
    quaternion, v, spin, place = tossed(n, generator)
    noise = NOISE * torch.randn(2, n, 6, generator=generator).double()
    half, stated = torch.tensor(HALF).double() * torch.tensor(facts.size), torch.tensor(HALF).double()
    R = rotation(quaternion)
    seen = lowest(facts.kind, stated, R, _UP)
    true = _turned(R, facts.late * spin)
    floor = _frame(facts.tilt)
    offset = (true @ torch.tensor(facts.centre).double()[:, None])[..., 0]
    r = lowest(facts.kind, half, true, floor[:, 2])
    at = place + r[:, :2]
    approach = ((v + torch.linalg.cross(spin, r)) @ floor[:, 2]) < -0.3
    v_pre = torch.cat((v, spin), -1) + noise[0]
    approach &= (v_pre[:, :3] + torch.linalg.cross(v_pre[:, 3:], seen))[:, 2] < -0.2
    rows = approach.nonzero()[:trials, 0]
    r, v, spin, true, offset, at = (x[rows] for x in (r, v, spin, true, offset, at))
    which = torch.arange(trials) % len(facts.mu)
    if "stripes" in facts.hidden:
        which = (torch.sin(150 * at[:, 0]) > 0).long()
    moments = facts.inertia_stated() * math.exp(facts.inertia)
    inertia = floor.T @ (true * moments) @ true.mT @ floor
    centred = v + torch.linalg.cross(spin, offset)  # of the mass centre
    arm, linear, turning = ((x @ floor) for x in (r - offset, centred, spin))
    mu = torch.tensor(facts.mu).double()[which] * (1 + facts.place * torch.tanh(at[:, 0] / 0.02))
    eps = _restitution(facts, linear, turning, arm, trials)
    dv, dw = _collided(facts, arm, linear, turning, inertia, mu, eps)
    v_post, w_post = (linear + dv) @ floor.T, (turning + dw) @ floor.T
    v_post, w_post, true = _later(facts, v_post, w_post, true, moments)
    v_post = v_post - torch.linalg.cross(w_post, (true @ torch.tensor(facts.centre).double()[:, None])[..., 0])
    position = torch.cat((place[rows], -seen[rows, 2:]), -1)
    position[:, :2] -= facts.late * v[:, :2]
    q = torch.cat((position, quaternion[rows]), -1)
    return table(facts, seed, which, seen[rows], q, v_pre[rows], torch.cat((v_post, w_post), -1) + noise[1][rows])


def _restitution(facts: Facts, v: Tensor, w: Tensor, r: Tensor, trials: int) -> Tensor:
    """Restitution of each trial: it falls with the speed of approach, and as the floor wears."""
    v_n = (v + torch.linalg.cross(w, r))[:, 2]
    age = torch.arange(trials).double() / trials
    return facts.eps * (-v_n / 2).clamp_min(0.05) ** -facts.speed * (1 - facts.wear * age)


def _collided(facts: Facts, r: Tensor, v: Tensor, w: Tensor, inertia: Tensor, mu: Tensor, eps: Tensor):
    """Changes of velocity and spin by a contact, in axes of the floor."""
    arm = torch.stack([torch.linalg.cross(one.expand_as(r), r) for one in torch.eye(3).double()], -1)  # ω × r
    back = torch.linalg.inv(inertia)
    A = torch.eye(3).double() / MASS + arm @ back @ arm.mT
    twist = (arm @ back)[..., 2]  # of the contact point, by a moment about the normal
    stiff, lead = back[:, 2, 2], (back @ arm.mT)[:, 2]  # spin about the normal by a moment, and by an impulse
    tangent = A[:, :2, :2]
    rate = 1 / torch.linalg.eigvalsh(tangent)[:, -1:]
    contact = v + torch.linalg.cross(w, r)
    if facts.lift:  # of a spinning body, by its spin across the slip
        eps = eps * (1 + facts.lift * (w[:, 0] * contact[:, 1] - w[:, 1] * contact[:, 0])).clamp(0.3, 1.3)
    friction, normal_spin = torch.zeros_like(r[:, :2]), w[:, 2].clone()
    total, moment = torch.zeros_like(r), torch.zeros(len(r)).double()
    stored = torch.zeros(len(r)).double()
    compression, work = torch.zeros_like(stored), torch.zeros_like(stored)
    for phase in (0, 1):
        size = -contact[:, 2] / (A[:, 2, 2] * STEPS) if phase == 0 else eps * compression / STEPS
        running = size > 0
        for _ in range(20 * STEPS):
            dp = torch.where(running, size, 1.0)[:, None]
            slip = contact[:, :2]
            bound = (mu * (1 + facts.slip * torch.exp(-slip.norm(dim=-1) / 0.3)))[:, None]
            for _ in range(PROJECTIONS):
                left = slip / dp + A[:, :2, 2] + (tangent @ friction[..., None])[..., 0]
                friction = friction - rate * left
                friction = friction * (bound / friction.norm(dim=-1, keepdim=True).clamp_min(1e-300)).clamp_max(1)
            impulse = torch.cat((friction, torch.ones_like(dp)), -1)
            drive = (lead * impulse).sum(-1)
            lever = (-(normal_spin / dp[:, 0] + drive) / stiff).clamp(-facts.torsion, facts.torsion)
            change = (A @ impulse[..., None])[..., 0] + twist * lever[:, None]
            rise = change[:, 2]
            if phase == 0:
                end = torch.where(rise > 0, -contact[:, 2] / rise, torch.inf)
            elif facts.energetic:
                goal = (eps**2 * stored - work).clamp_min(0)
                root = (contact[:, 2] ** 2 + 2 * rise * goal).clamp_min(0).sqrt()
                end = 2 * goal / (contact[:, 2] + root).clamp_min(1e-300)
            else:
                end = (1 + eps) * compression - total[:, 2]
            step = torch.where(running, torch.minimum(size, end), 0.0)
            work = work + step * (contact[:, 2] + 0.5 * step * rise)
            contact, total = contact + step[:, None] * change, total + step[:, None] * impulse
            moment, normal_spin = moment + step * lever, normal_spin + step * (drive + stiff * lever)
            running = running & (end > size)
            if not running.any():
                break
        if phase == 0:
            compression, stored, work = total[:, 2].clone(), -work, torch.zeros_like(work)
    turned = torch.linalg.cross(r, total)
    turned[:, 2] += moment
    return total / MASS, (back @ turned[..., None])[..., 0]


def _later(facts: Facts, v: Tensor, w: Tensor, R: Tensor, moments: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Velocities and attitude as they are measured: damped, dragged, pulled, and after a while of free flight."""
    v, w = v * math.exp(-facts.drag), w * math.exp(-facts.damping)
    if facts.magnet:  # along the floor, on the body's first axis
        pole = torch.linalg.cross(R[..., 0], torch.tensor((1.0, 0.0, 0.0)).double().expand(len(R), 3))
        w = w + facts.magnet * (R @ torch.diag(1 / moments) @ R.mT @ pole[..., None])[..., 0]
    count = 20 if facts.delay else 0
    for _ in range(count):
        momentum = (R @ torch.diag(moments) @ R.mT @ w[..., None])[..., 0]
        R = _turned(R, w * facts.delay / count)
        w = (R @ torch.diag(1 / moments) @ R.mT @ momentum[..., None])[..., 0]
    return v - GRAVITY * facts.delay * _UP, w, R


def _turned(R: Tensor, angle: Tensor) -> Tensor:
    """Attitudes [n, 3, 3] turned by rotation vectors in world axes."""
    x, y, z = angle.unbind(-1)
    zero = torch.zeros_like(x)
    cross = torch.stack([torch.stack(row, -1) for row in ((zero, -z, y), (z, zero, -x), (-y, x, zero))], -2)
    return torch.linalg.matrix_exp(cross) @ R


def _frame(tilt: tuple[float, float]) -> Tensor:
    """Axes of a floor of slopes in x and y, as columns; the third is its normal."""
    normal = torch.tensor((math.tan(tilt[0]), math.tan(tilt[1]), 1.0)).double()
    normal = normal / normal.norm()
    first = torch.linalg.cross(torch.tensor((0.0, 1.0, 0.0)).double(), normal)
    first = first / first.norm()
    return torch.stack((first, torch.linalg.cross(normal, first), normal), -1)
