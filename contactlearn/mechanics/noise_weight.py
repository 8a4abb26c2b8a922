"""Noise of trials by the covariances of their velocities: weights in learning and in the search for outliers.

    w² = 2 m / (m + s²)      of a value with the stated variance s², whose median is m over the trials that have one

Half of the noise is assumed equal in all trials, since models leave more residual than the stated measurement noise.
Where the covariance of the outcome is known, with the scatter of the contact, it has all of that: w² = m / s².
"""

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.mechanics import rigid_body
from contactlearn.mechanics.impacts import Impacts


def noise_weight(impacts: Impacts, target: str) -> Float[Tensor, "n o"] | None:
    """Return the weights w of a value of each trial, whose noise variance is σ²/w²; None as `noise_variance`."""
    variance = noise_variance(impacts, target)
    if variance is None:
        return None
    typical = variance.where(variance > 0, torch.nan).nanmedian(0).values.nan_to_num(1.0)
    alike = typical if impacts.outcome_cov is None else 0.0
    return ((typical + alike) / (variance + alike)).sqrt()


def noise_variance(impacts: Impacts, target: str) -> Float[Tensor, "n o"] | None:
    """Return the noise variance of a value of each trial; None if no covariance is known.

    Args:
        impacts: measurements, with the covariances of v_pre, v_post or both, or that of the outcome.
        target: velocity, impulse or wrench.
    """
    stated = [x for x in (impacts.v_pre_cov, impacts.v_post_cov) if x is not None]
    stated = stated if impacts.outcome_cov is None else [impacts.outcome_cov]
    if not stated:
        return None
    covariance = torch.stack(stated).sum(0)
    if target != "velocity":
        size = impacts.space.D
        step = torch.eye(size).to(covariance)[:, None].expand(size, len(impacts), size)
        slope = rigid_body.measured_wrench(impacts.mass, impacts.world_inertia, impacts.r, torch.zeros_like(step), step)
        slope = slope.permute(1, 2, 0)  # of the wrench in the change of velocity
        covariance = slope @ covariance @ slope.mT
    variance = covariance.diagonal(dim1=-2, dim2=-1)
    return variance[:, : impacts.space.d] if target == "impulse" else variance
