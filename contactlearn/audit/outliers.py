"""Trials that repeat others, or that cannot be the impacts that they claim to be, without a model of contact."""

import math

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from contactlearn.audit.consistency import kinetic_energy, torque
from contactlearn.audit.thresholds import OutlierThresholds
from contactlearn.impacts import Impacts
from contactlearn.mechanics import rotate
from contactlearn.numerics import MAD_SCALE
from contactlearn.shapes import Polygon


def repeated(impacts: Impacts) -> Bool[Tensor, " n"]:
    """Find the trials whose every pose and velocity equals, bit for bit, that of an earlier row."""
    numbers = torch.cat((impacts.r, impacts.q, impacts.v_pre, impacts.v_post), -1)
    seen: set[tuple[float, ...]] = set()
    twice = []
    for row in map(tuple, numbers.tolist()):
        twice.append(row in seen)
        seen.add(row)
    return torch.tensor(twice)


def gross_outliers(
    impacts: Impacts, thresholds: OutlierThresholds = OutlierThresholds()
) -> dict[str, Bool[Tensor, " n"]]:
    """Find the trials that cannot be the impacts that they claim to be, by reason.

    `moment`: the residual of the moment balance is gross; `energy`: the body gains too much; `approach`: the contact
    point does not approach the floor; `mass`: the mass or inertia is not that of the same object's other trials.
    """
    terms, residual = torque(impacts), _least_residual(impacts)
    before, after = kinetic_energy(impacts)
    spread = MAD_SCALE * terms.residual.abs().median()
    gross = residual > thresholds.moment_sigmas * spread
    unlike = (_unlike(impacts, values, thresholds) for values in (impacts.mass, impacts.inertia))
    return {
        "moment": gross & (terms.imbalance > thresholds.imbalance),
        "energy": after > thresholds.energy_ratio * before,
        "approach": impacts.v_c[:, 1] >= 0,
        "mass": torch.stack([*unlike]).any(0),
    }


def outliers(impacts: Impacts, thresholds: OutlierThresholds = OutlierThresholds()) -> Bool[Tensor, " n"]:
    """Find the gross outliers of any reason."""
    return torch.stack([*gross_outliers(impacts, thresholds).values()]).any(0)


def _least_residual(impacts: Impacts) -> Float[Tensor, " n"]:
    """|τ| / I at the given contact point or, for a polygon, at either of its two lowest corners.

    A body that lands nearly flat may touch with the other corner, for which no measurement is to blame.
    """
    least = torque(impacts).residual.abs()
    if isinstance(impacts.shape, Polygon):
        corners = rotate(torch.tensor(impacts.shape.vertices, dtype=torch.float64), impacts.q[:, 2, None])
        lowest = corners[..., 1].topk(2, largest=False).indices
        for corner in lowest.unbind(-1):
            r = corners[torch.arange(len(impacts)), corner]
            least = least.minimum(torque(impacts.replace(r=r, suspect=True)).residual.abs())
    return least


def _unlike(impacts: Impacts, values: Float[Tensor, " n"], thresholds: OutlierThresholds) -> Bool[Tensor, " n"]:
    """Trials with a value far from its object's median; where that is common, two bodies share a name."""
    unlike = torch.zeros(len(impacts), dtype=torch.bool)
    for name in set(impacts.object):
        same = torch.tensor([other == name for other in impacts.object])
        far = same & ((values / values[same].median()).log().abs() > math.log(thresholds.mass_ratio))
        if far.sum() < thresholds.common * same.sum():
            unlike |= far
    return unlike
