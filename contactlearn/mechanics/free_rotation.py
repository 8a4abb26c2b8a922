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
_CONVERGENT, _ROUNDING = math.pi / 2, 1e-16  # rad, up to which the series converges; of its sum


def _rates() -> Float[Tensor, "21 7"]:
    """Rates of (q, I ω) by the products of each of them with each of ω: q (0, ω)/2 and (I ω) × ω."""
    across = torch.linalg.cross(*torch.broadcast_tensors(torch.eye(3).double()[:, None], torch.eye(3).double()))
    rates = torch.zeros(7, 3, 7, dtype=torch.float64)
    rates[0, :, 1:4] = torch.eye(3) / 2
    rates[1:4, :, 0] = -torch.eye(3) / 2
    rates[1:4, :, 1:4] = across / 2
    rates[4:, :, 4:] = across
    return rates.flatten(0, 1)


_RATES = _rates()


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
        quaternion, omega = _step(quaternion, omega, inertia, t[:, None] / steps, _order(angle / steps))
    return quaternion, matvec(rotation(quaternion), omega)


def _order(angle: float) -> int:
    """Order from which on the terms of a step by an angle in rad are lost in rounding."""
    return min(_ORDER, math.ceil(math.log(_ROUNDING) / math.log(max(angle / _CONVERGENT, _ROUNDING))))


def _step(q: Tensor, omega: Tensor, inertia: Tensor, t: Tensor, order: int) -> tuple[Tensor, Tensor]:
    """Sum the series of q and I ω at t; ω is along the body's axes."""
    terms = torch.cat((q, inertia * omega), -1)[:, None]
    back = omega[:, None]  # its terms, the last one first
    for k in range(order):
        products = (terms.mT @ back).flatten(1)  # of all pairs of terms of order k
        added = products @ _RATES * (t / (k + 1))
        terms = torch.cat((terms, added[:, None]), 1)
        back = torch.cat(((added[:, 4:] / inertia)[:, None], back), 1)
    return terms[..., :4].sum(1), back.sum(1)
