"""A floor, a table or a racket that moves along its normal while velocities are those of the laboratory.

    v_n⁺ − V = −ε (v_n − V)        v_n⁺ / |v_n| = ε + (1 + ε) V / |v_n|

The apparent restitution then falls as one over the speed, and is above 1 for slow impacts: it gains energy, which no
restitution that depends on the speed does.  The same form without a gain is also that of a restitution that falls with
speed, or of adhesion where V < 0: it is noted, and not corrected.
"""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.numerics import measured
from contactlearn.data.audit.result import Finding, evidence_of
from contactlearn.mechanics.apparatus import Estimate
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import contact_velocity

_MIN_TRIALS = 20  # that show a constant beside a slope
_SIGMAS = 8.0  # standard errors of the floor's velocity; random restitution of 0.1 makes 4 in one table of 1000
_CLEARER = 12.0  # fall of n ln(mean distance) against a restitution that depends on the speed, as of a likelihood
_SLOW_QUANTILE = 0.1  # quantile of the speeds at which energy must be gained
_POWERS = torch.linspace(-1.0, 0.9, 20, dtype=torch.float64)  # of the speed, in a restitution that depends on it
_ROUNDS = 20  # of weights for least absolute deviations


@dataclass(frozen=True, kw_only=True)
class MovingFloor:
    """The velocity of a floor, and how it shows.

    Args:
        velocity: along the normal in m/s, upward.
        restitution: relative to this floor.
        restitution_error: standard error that the floor's velocity adds to a restitution that is fitted relative to it,
            |∂ε/∂V| σ_V = (1 + ε) σ_V / |v_n − V|.
        slow: apparent restitution of slow impacts.
        gain: n ln of the mean distance from a restitution that depends on the speed, over that from a moving floor.
    """

    velocity: Estimate
    restitution: float
    restitution_error: float
    slow: float
    gain: float

    @property
    def sure(self) -> bool:
        """Whether nothing else gives slow impacts energy."""
        return self.velocity.value > 0 and self.slow > 1


def moving_floor(impacts: Impacts) -> MovingFloor | None:
    """Find a constant velocity of the floor that explains outcomes clearly better than any dependence on the speed."""
    before, after = (contact_velocity(impacts.r, v)[:, -1] for v in (impacts.v_pre, impacts.v_post))
    rows = before < 0
    speed, apparent = -before[rows], (-after / before)[rows]
    if len(speed) < _MIN_TRIALS or speed.max() <= speed.min():
        return None
    weight = (speed / speed.median()).clamp_max(1.0)  # errors of a velocity count for more in slow impacts
    ones = torch.ones_like(speed)
    fit, distance, errors = _fitted(torch.stack((ones, 1 / speed), -1), apparent, weight)
    eps, pushed = fit.tolist()
    velocity = Estimate(value=pushed / (1 + eps), error=errors[1].item() / abs(1 + eps))
    if eps < 0 or abs(velocity.value) <= _SIGMAS * velocity.error:
        return None
    others = [_fitted(torch.stack((ones, speed), -1), apparent, weight)[1]]
    others += [_fitted((speed**power)[:, None], apparent, weight)[1] for power in _POWERS]
    gain = len(speed) * math.log(max(min(others), 1e-12) / max(distance, 1e-12))
    if gain <= _CLEARER:
        return None
    slow = eps + pushed / speed.quantile(_SLOW_QUANTILE).item()
    carried = (1 + eps) * velocity.error / (speed + velocity.value).median().item()
    return MovingFloor(velocity=velocity, restitution=eps, restitution_error=carried, slow=slow, gain=gain)


def on_still_floor(impacts: Impacts, velocity: float) -> Impacts:
    """Return impacts with velocities relative to a floor that moves along its normal, in m/s."""
    moves = torch.zeros_like(impacts.v_pre[0])
    moves[impacts.space.d - 1] = velocity
    return impacts.replace(v_pre=impacts.v_pre - moves, v_post=impacts.v_post - moves)


def moving_floor_findings(impacts: Impacts) -> list[Finding]:
    """A mistake with its correction where slow impacts gain energy, otherwise a note."""
    floor = moving_floor(impacts)
    if floor is None:
        return []
    v, error = floor.velocity.value, floor.velocity.error
    moves = f"{'up' if v > 0 else 'down'} at {measured(abs(v), error, 'm/s')}"
    sentence = (
        f"the floor moves {moves}: v_n⁺ has a constant beside its part in proportion to v_n, whose ε is "
        f"{floor.restitution:.3g}; with the floor at rest slow impacts would have ε = {floor.slow:.2f}, and gain energy"
        f"; ε of a fit relative to it has, beside its own, a standard error of {floor.restitution_error:.2g} from that "
        "of the floor's velocity"
        if floor.sure
        else f"the rebound speed does not go to zero with the approach speed: a floor that moves {moves}, a "
        "restitution that depends on the speed, or adhesion; was the floor or racket at rest?"
    )
    evidence = evidence_of(
        ("velocity", v, "m/s"),
        ("error", error, "m/s"),
        ("restitution", floor.restitution),
        ("restitution_error", floor.restitution_error),
        ("restitution_of_slow", floor.slow),
        ("log_ratio", floor.gain),
    )
    correction = "moving_floor" if floor.sure else None
    return [
        Finding(name="moving_floor", sentence=sentence, evidence=evidence, correction=correction, mistake=floor.sure)
    ]


def _fitted(
    design: Float[Tensor, "n p"], value: Float[Tensor, " n"], weight: Float[Tensor, " n"]
) -> tuple[Float[Tensor, " p"], float, Float[Tensor, " p"]]:
    """Least weighted absolute deviations: the fit, the mean distance, and its errors by the scatter."""
    scale, fit, off = weight.clone(), design.new_zeros(design.shape[1]), value
    for _ in range(_ROUNDS):
        fit = torch.linalg.lstsq(design * scale[:, None].sqrt(), (value * scale.sqrt())[:, None]).solution[:, 0]
        off = (value - design @ fit).abs()
        scale = weight / off.clamp_min(max(off.median().item() / 10, 1e-12))
    inverse = torch.linalg.pinv((design * weight[:, None]).mT @ design, hermitian=True)
    scores = design * (weight * (value - design @ fit))[:, None]
    errors = (inverse @ scores.mT @ scores @ inverse).diagonal().clamp_min(0).sqrt()
    return fit, ((weight * off).sum() / weight.sum()).item(), errors
