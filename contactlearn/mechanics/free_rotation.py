"""Rotation of a free body in space, by Euler's equations: I ω̇ = (I ω) × ω along the body's axes, q̇ = q (0, ω)/2.

A body of equal moments of inertia turns about a fixed axis.  Of another one both sides are products, so that Taylor's
series of ω and q follow term by term.  They converge to π/(2|ω|) at least, where Jacobi's functions have their nearest
pole, and steps are a third of that.
"""

import math

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.mechanics.rigid_body import matvec, rotation, turn_quaternion

_ORDER = 14  # of the series: errors are of 1e-13 rad after 10 turns then
_STEP = 0.5  # rad, of a step at most


def most_spin(inertia: Float[Tensor, "n 3"], spin: Float[Tensor, "n 3"], quaternion: Float[Tensor, "n 4"]) -> Tensor:
    """Return the spin [N] in rad/s that a free body never exceeds, that of all its energy about its easiest axis."""
    return _most(inertia, matvec(rotation(quaternion).mT, spin))


def _most(inertia: Tensor, omega: Tensor) -> Tensor:
    """That of a spin along the body's axes."""
    return ((inertia * omega.square()).sum(-1) / inertia.amin(-1)).sqrt()


def turned(
    quaternion: Float[Tensor, "n 4"], spin: Float[Tensor, "n 3"], inertia: Float[Tensor, "n 3"], t: Float[Tensor, "n"]
) -> tuple[Float[Tensor, "n 4"], Float[Tensor, "n 3"]]:
    """Return quaternions and spins in world axes, after times t in s, of bodies with these principal moments."""
    if bool((inertia == inertia[:, :1]).all()):
        return turn_quaternion(quaternion, spin * t[:, None]), spin
    omega = matvec(rotation(quaternion).mT, spin)
    angle = (_most(inertia, omega) * t).abs().nan_to_num(0).max().item()
    steps = max(1, math.ceil(angle / _STEP))
    for _ in range(steps):
        quaternion, omega = _step(quaternion, omega, inertia, t[:, None] / steps)
    return quaternion, matvec(rotation(quaternion), omega)


def _step(q: Tensor, omega: Tensor, inertia: Tensor, t: Tensor) -> tuple[Tensor, Tensor]:
    """Sum the series at t; ω is along the body's axes."""
    q, omega = q[None], omega[None]  # terms so far
    for k in range(_ORDER):
        back, scalar, vector = omega.flip(0), q[..., :1], q[..., 1:]
        moment = torch.linalg.cross(inertia * omega, back).sum(0)
        product = (-(vector * back).sum(-1, keepdim=True), scalar * back + torch.linalg.cross(vector, back))
        q = torch.cat((q, torch.cat(product, -1).sum(0, keepdim=True) * t / (2 * k + 2)))
        omega = torch.cat((omega, (moment / inertia * t / (k + 1))[None]))
    return q.sum(0), omega.sum(0)
