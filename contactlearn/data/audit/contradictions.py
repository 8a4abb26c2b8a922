"""Contradictions between measured impacts and rigid ones: the same questions asked of each trial.

An answer is in [0, 1], and 0 for a rigid impact on a floor below the body, in the plane as in space:

    moment      I Δω = r × P with P = m Δv: the residual as a share of the terms
    approach    v_n < 0 before contact           leaves      v_n ≥ 0 after it, within a fifth of |v_n|
    push        P_n > 0: the floor does not pull
    below       r_y < 0, in space r_z: the floor is below the centre of mass
    friction    P_t is not along the slip both before and after; negligible P_t or slip does not count
    energy      no more after than before, within a tenth; twice as much is a whole contradiction
    shape       r is the contact point of the body's shape at θ, where the shape is known
    units       I/m agrees with r, speeds and lengths are those of a laboratory, |θ| is a few turns at most

The moment balance alone knows the signs of its two terms only: turning θ looks like turning r.  The other questions
distinguish these, except for equivalent ones (a disc seen from behind).  No outlier decides, since answers are bounded.
"""

import math

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.data.audit.moments import HEAVIEST, Columns, kinetic_energy, median_gyration, torque
from contactlearn.data.audit.trials import FASTEST
from contactlearn.mechanics.bodies import contact_points
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import contact_velocity, orientation_of
from contactlearn.mechanics.space import PLANE

_LIGHTEST = 0.02  # plausible (I/m)/|r|²: a rod on its end has 1/3, a disc 1/2
_GAIN, _GROSS_GAIN = 1.1, 2.0  # ratio of energies by noise or an engine, and by another unit or order of columns
_LARGEST, _TURNED = 10.0, 8 * math.pi  # plausible |r| in m, and |θ| in rad (four turns), in the median


def contradictions(impacts: Impacts | Columns) -> dict[str, Float[Tensor, "*batch n"]]:
    """Compute the contradictions of each trial in [0, 1] by question; see the module for the questions."""
    before, after = impacts.v_c, contact_velocity(impacts.r, impacts.v_post)
    P = impacts.mass[..., None] * (impacts.v_post - impacts.v_pre)[..., : impacts.space.d]
    slips = torch.stack((before, after), -2)[..., :-1]
    along = ((P[..., None, :-1] * slips).sum(-1) > 0).all(-1)
    slip = slips.norm(dim=-1)
    energy, rebound = kinetic_energy(impacts)
    counts = (P[..., :-1].norm(dim=-1) / (0.05 * P[..., -1].abs()).clamp_min(1e-300)).clamp_max(1)
    length = impacts.r.norm(dim=-1)
    answers = {
        "moment": torque(impacts).imbalance,
        "approach": (before[..., -1] >= 0).double(),
        "leaves": (after[..., -1] < -0.2 * before[..., -1].abs()).double(),
        "push": (P[..., -1] <= 0).double(),
        "below": (impacts.r[..., -1] >= 0).double(),
        "friction": along * counts * (slip.amin(-1) / slip.amax(-1).clamp_min(1e-300)),
        "energy": ((rebound / energy.clamp_min(1e-300) - _GAIN) / (_GROSS_GAIN - _GAIN)).clamp(0, 1),
        "units": _implausible(impacts)[..., None].expand_as(length),
    }
    if impacts.shape is not None:
        off = (impacts.r - contact_points(impacts.shape, impacts.body, orientation_of(impacts.q))).norm(dim=-1)
        answers["shape"] = (off / (0.5 * length).clamp_min(1e-300)).clamp_max(1)
    return answers


def _implausible(impacts: Impacts | Columns) -> Float[Tensor, "*batch"]:
    """The most decades by which a quantity lies outside its plausible range, at most 1."""
    length = impacts.r.norm(dim=-1).median(-1).values
    gyration = median_gyration(impacts) / length.clamp_min(1e-300) ** 2
    ratios = [
        gyration / HEAVIEST,
        _LIGHTEST / gyration,
        impacts.v_pre[..., : impacts.space.d].norm(dim=-1).median(-1).values / FASTEST,
        length / _LARGEST,
    ]
    if impacts.space is PLANE:
        ratios.append(impacts.q[..., 2].abs().median(-1).values / _TURNED)
    return torch.stack(ratios).amax(0).log10().clamp(0, 1)
