"""Consistency of the measurements with themselves: moment balance, energy, outliers, contradictions, without a model.

Every trial is asked questions whose answer is a contradiction in [0, 1]; a rigid planar impact on a floor below
gives 0:

    moment      I Δω = r_x P_n − r_y P_t with P = m Δv: the share of the terms that is left over
    approach    v_n < 0 before contact           leaves      v_n ≥ 0 after it, within a fifth of |v_n|
    push        P_n > 0: the floor does not pull
    below       r_y < 0: the floor is below the centre of mass
    friction    P_t is not along the slip both before and after; next to no P_t or slip hardly counts
    energy      no more after than before, within a tenth
    shape       r is the contact point of the body's shape at θ, where the shape is known
    units       I/m suits r, speeds and lengths are those of a laboratory, |θ| is no dozen turns
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from contactlearn.audit.thresholds import ConventionThresholds, OutlierThresholds
from contactlearn.impacts import Impacts
from contactlearn.mechanics import contact_velocity, rotate
from contactlearn.numerics import MAD_SCALE
from contactlearn.shapes import Polygon, contact_point

_BIWEIGHT = 4.685  # robust standard deviations at which the weight is 0: 95 % as efficient as least squares


class Torque(NamedTuple):
    """Terms of the moment balance spin = normal + tangential, all in rad/s.

    `spin` is Δω, `normal` r_x P_n / I, `tangential` −r_y P_t / I, and `scale` |Δv| / ρ with ρ² = I/m: the spin that
    the same momentum at one radius of gyration makes.
    """

    spin: Float[Tensor, " n"]
    normal: Float[Tensor, " n"]
    tangential: Float[Tensor, " n"]
    scale: Float[Tensor, " n"]

    @property
    def residual(self) -> Float[Tensor, " n"]:
        """τ / I in rad/s: the part of the spin that no point contact makes."""
        return self.spin - self.normal - self.tangential

    @property
    def imbalance(self) -> Float[Tensor, " n"]:
        """|residual| relative to the terms, in [0, 1]; a twentieth of `scale` keeps tiny terms out of it."""
        size = self.spin.abs() + self.normal.abs() + self.tangential.abs() + 0.05 * self.scale
        return (self.residual.abs() / size.clamp_min(torch.finfo(size.dtype).tiny)).clamp_max(1)


def torque(impacts: Impacts) -> Torque:
    """Compute the terms of the moment balance I Δω = r_x P_n − r_y P_t with P = m Δv."""
    dv = impacts.v_post - impacts.v_pre
    gyration = impacts.inertia / impacts.mass
    normal, tangential = impacts.r[:, 0] * dv[:, 1] / gyration, -impacts.r[:, 1] * dv[:, 0] / gyration
    return Torque(dv[:, 2], normal, tangential, dv[:, :2].norm(dim=-1) / gyration.sqrt())


def inertia_factor(impacts: Impacts) -> float:
    """Estimate the factor on I at which the moments balance; nan where no positive one fits.

    It is the geometric mean of the slopes of r × P over I Δω and of I Δω over r × P, by least absolute deviations
    through the origin: noise in neither biases it, and it is robust to outliers.
    """
    terms = torque(impacts)
    moment = terms.normal + terms.tangential
    one, other = _slope(moment, terms.spin), _slope(terms.spin, moment)
    return math.sqrt(one / other) if one > 0 and other > 0 else math.nan


def _slope(y: Float[Tensor, " n"], x: Float[Tensor, " n"]) -> float:
    """Slope of y over x by least absolute deviations: the median of y/x, weighted by |x|."""
    there = x != 0
    ratio, order = (y[there] / x[there]).sort()
    share = x[there].abs()[order].cumsum(0)
    return ratio[torch.searchsorted(share, share[-1:] / 2)].item() if len(ratio) else math.nan


def kinetic_energy(impacts: Impacts) -> tuple[Float[Tensor, " n"], Float[Tensor, " n"]]:
    """Compute the kinetic energy in J before and after contact."""
    weight = torch.stack((impacts.mass, impacts.mass, impacts.inertia), -1)
    before, after = (0.5 * (weight * v**2).sum(-1) for v in (impacts.v_pre, impacts.v_post))
    return before, after


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


@dataclass(frozen=True, kw_only=True)
class Balance:
    """The moment balance Δω = a r_x P_n / I − b r_y P_t / I, fitted robustly: a = b = 1 for consistent data.

    `a_error` and `b_error` are standard errors, `r_squared` the share of Δω that the fit explains, without outliers.
    """

    a: float
    b: float
    a_error: float
    b_error: float
    r_squared: float

    def __str__(self) -> str:
        return f"{self.a:+.2f} ± {self.a_error:.2f} and {self.b:+.2f} ± {self.b_error:.2f} (R² = {self.r_squared:.2f})"


def balance(impacts: Impacts) -> Balance:
    """Fit both coefficients of the moment balance by Tukey's biweight, from least absolute deviations.

    A term that is 0 in every trial (r_x of a disc) has the coefficient 0 ± ∞.
    """
    terms = torque(impacts)
    X, y = torch.stack((terms.normal, terms.tangential), -1), terms.spin
    weight = torch.ones_like(y)
    fit, covariance = _weighted(X, y, weight)
    size = (y - X @ fit).abs()
    for step in range(40):
        if step:
            fit, covariance = _weighted(X, y, weight)
            size = (y - X @ fit).abs()
        spread = (MAD_SCALE * size.median()).clamp_min(1e-9 * y.abs().mean() + 1e-300)
        weight = (
            1 / size.clamp_min(spread / 10) if step < 10 else (1 - (size / (_BIWEIGHT * spread)) ** 2).clamp_min(0) ** 2
        )
    residual = (weight * size**2).sum()
    a_error, b_error = (covariance.diagonal() * residual / (weight.sum() - 2).clamp_min(1)).sqrt().tolist()
    r_squared = 1 - residual / (weight * y**2).sum().clamp_min(1e-300)
    a, b = fit.tolist()
    return Balance(a=a, b=b, a_error=a_error, b_error=b_error, r_squared=r_squared.item())


def _weighted(
    X: Float[Tensor, "n 2"], y: Float[Tensor, " n"], weight: Float[Tensor, " n"]
) -> tuple[Float[Tensor, "2"], Float[Tensor, "2 2"]]:
    """Weighted least squares and the inverse of its normal matrix; a column of zeros gets 0 and ∞."""
    there = (X**2).sum(0) > 1e-12 * (y**2).sum()
    fit = torch.zeros(2, dtype=y.dtype)
    inverse = torch.diag(torch.full((2,), math.inf, dtype=y.dtype))
    if there.any():
        some = X[:, there]
        part = torch.linalg.pinv(some.mT @ (weight[:, None] * some), hermitian=True)
        fit[there] = part @ (some.mT @ (weight * y))
        inverse[there.nonzero(), there.nonzero().mT] = part
    return fit, inverse


def spin_explained(impacts: Impacts) -> float:
    """Compute the share of Δω that the balance with coefficients +1 and +1 explains, by medians; ≤ 0 if none."""
    terms = torque(impacts)
    residual, spin = terms.residual.abs().median(), terms.spin.abs().median()
    return 1 - ((residual / spin.clamp_min(1e-300)) ** 2).item()


def contradictions(
    impacts: Impacts, thresholds: ConventionThresholds = ConventionThresholds()
) -> dict[str, Float[Tensor, " n"]]:
    """Compute the contradictions of each trial in [0, 1] by question; see the module for the questions."""
    before, after = impacts.v_c, contact_velocity(impacts.r, impacts.v_post)
    P = impacts.mass[:, None] * (impacts.v_post - impacts.v_pre)[:, :2]
    slip = torch.stack((before[:, 0], after[:, 0]), -1)
    along = (P[:, :1] * slip > 0).all(-1)
    energy, rebound = kinetic_energy(impacts)
    counts = (P[:, 0].abs() / (0.05 * P[:, 1].abs()).clamp_min(1e-300)).clamp_max(1)
    length = impacts.r.norm(dim=-1)
    answers = {
        "moment": torque(impacts).imbalance,
        "approach": (before[:, 1] >= 0).double(),
        "leaves": (after[:, 1] < -0.2 * before[:, 1].abs()).double(),
        "push": (P[:, 1] <= 0).double(),
        "below": (impacts.r[:, 1] >= 0).double(),
        "friction": along * counts * (slip.abs().amin(-1) / slip.abs().amax(-1).clamp_min(1e-300)),
        "energy": (rebound > 1.1 * energy).double(),
        "units": torch.full_like(length, _implausible(impacts, thresholds)),
    }
    if impacts.shape is not None:
        off = (impacts.r - contact_point(impacts.shape, impacts.q[:, 2])).norm(dim=-1)
        answers["shape"] = (off / (0.5 * length).clamp_min(1e-300)).clamp_max(1)
    return answers


def _implausible(impacts: Impacts, thresholds: ConventionThresholds) -> float:
    """The most decades by which a quantity lies outside its plausible range, at most 1."""
    length = impacts.r.norm(dim=-1).median()
    gyration = (impacts.inertia / impacts.mass).median() / length.clamp_min(1e-300) ** 2
    decades = (
        (gyration / thresholds.gyration[1]).log10().item(),
        (thresholds.gyration[0] / gyration).log10().item(),
        (impacts.v_pre[:, :2].norm(dim=-1).median() / thresholds.fastest).log10().item(),
        (length / thresholds.largest).log10().item(),
        (impacts.q[:, 2].abs().median() / thresholds.turned).log10().item(),
    )
    return min(1.0, max(0.0, *decades))
