"""Consistency of the measurements with themselves: moment balance, energy, outliers, contradictions, without a model.

Each question about a trial has as its answer a contradiction in [0, 1], which is 0 for a rigid planar impact on a floor
below the body:

    moment      I Δω = r_x P_n − r_y P_t with P = m Δv: the residual as a share of the terms
    approach    v_n < 0 before contact           leaves      v_n ≥ 0 after it, within a fifth of |v_n|
    push        P_n > 0: the floor does not pull
    below       r_y < 0: the floor is below the centre of mass
    friction    P_t is not along the slip both before and after; negligible P_t or slip does not count
    energy      no more after than before, within a tenth
    shape       r is the contact point of the body's shape at θ, where the shape is known
    units       I/m agrees with r, speeds and lengths are those of a laboratory, |θ| is a few turns at most

`balance` fits the moment balance: which coefficients the measurements give its two terms, and which they leave open.
"""

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from contactlearn.core.numerics import MAD_SCALE, Z_95
from contactlearn.data.audit.thresholds import AuditThresholds
from contactlearn.mechanics.bodies import AnyShape, contact_points, per_body, shapes_among
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import contact_velocity
from contactlearn.mechanics.shapes import Polygon, Shape

_IMBALANCE = 1 / 3  # share of the terms of the balance that a gross residual exceeds: the spread of exact data is tiny
_COMMON = 0.1  # share of an object's trials with a gross mass from which on it is two bodies of one name
_GYRATION = (0.02, 8.0)  # plausible (I/m)/|r|²: a rod on its end has 1/3, a disc 1/2, a body that lands flat more
FASTEST = 100.0
"""Plausible speed before impact in m/s, in the median."""
_LARGEST, _TURNED = 10.0, 8 * math.pi  # plausible |r| in m, and |θ| in rad (four turns), in the median
_FIELDS = ("mass", "inertia", "r", "q", "v_pre", "v_post", "q_post")


@dataclass(frozen=True, kw_only=True)
class Columns:
    """Fields of `Impacts` in their units, [..., n] and [..., n, 2 or 3]; nothing is validated."""

    mass: Float[Tensor, "*batch n"]
    inertia: Float[Tensor, "*batch n"]
    r: Float[Tensor, "*batch n 2"]
    q: Float[Tensor, "*batch n 3"]
    v_pre: Float[Tensor, "*batch n 3"]
    v_post: Float[Tensor, "*batch n 3"]
    q_post: Float[Tensor, "*batch n 3"] | None
    shape: AnyShape | None
    body: Int[Tensor, " n"]

    @classmethod
    def of(cls, impacts: Impacts) -> "Columns":
        """Return the columns of impacts as those of one hypothesis, [1, n]."""
        there = (name for name in _FIELDS if getattr(impacts, name) is not None)
        fields: dict[str, Any] = {"q_post": None} | {name: getattr(impacts, name)[None] for name in there}
        return cls(**fields, shape=impacts.shape, body=impacts.body)

    @property
    def v_c(self) -> Float[Tensor, "*batch n 2"]:
        """Velocity (v_t, v_n) of the contact point before contact in m/s."""
        return contact_velocity(self.r, self.v_pre)

    def replace(self, **changes: Tensor) -> "Columns":
        """Return the columns with some of them changed."""
        return replace(self, **changes)

    def __getitem__(self, which: Tensor) -> "Columns":
        """Return the hypotheses at these places of the first axis."""
        fields = {name: x[which] for name in _FIELDS if (x := getattr(self, name)) is not None}
        return replace(self, **fields)

    def and_also(self, others: "Columns") -> "Columns":
        """Return the hypotheses of both, these first."""
        pairs = {name: (getattr(self, name), getattr(others, name)) for name in _FIELDS}
        return replace(self, **{name: torch.cat(pair) for name, pair in pairs.items() if pair[0] is not None})


class Torque(NamedTuple):
    """Terms [..., n] of the moment balance spin = normal + tangential, all in rad/s.

    `spin` is Δω, `normal` r_x P_n / I, `tangential` −r_y P_t / I, and `scale` |Δv| / ρ with ρ² = I/m: the spin that
    the same momentum at one radius of gyration makes.
    """

    spin: Float[Tensor, "*batch n"]
    normal: Float[Tensor, "*batch n"]
    tangential: Float[Tensor, "*batch n"]
    scale: Float[Tensor, "*batch n"]

    @property
    def residual(self) -> Float[Tensor, "*batch n"]:
        """τ / I in rad/s: the part of the spin that no point contact makes."""
        return self.spin - self.normal - self.tangential

    @property
    def imbalance(self) -> Float[Tensor, "*batch n"]:
        """|residual| relative to the terms, in [0, 1]; a twentieth of `scale` is added to them, for tiny terms."""
        size = self.spin.abs() + self.normal.abs() + self.tangential.abs() + 0.05 * self.scale
        return (self.residual.abs() / size.clamp_min(torch.finfo(size.dtype).tiny)).clamp_max(1)

    @property
    def explained(self) -> Float[Tensor, "*batch"]:
        """Share of Δω that the balance with coefficients +1 and +1 explains, by medians; ≤ 0 if none."""
        residual, spin = (x.abs().median(-1).values for x in (self.residual, self.spin))
        return 1 - (residual / spin.clamp_min(1e-300)) ** 2

    @property
    def inertia_factor(self) -> Float[Tensor, "*batch"]:
        """Factor on I at which the moments balance; nan where no positive one fits.

        It is the geometric mean of the slopes of r × P over I Δω and of I Δω over r × P, by least absolute deviations
        through the origin: noise in neither biases it, and it is robust to outliers.
        """
        moment = self.normal + self.tangential
        one, other = _slope(moment, self.spin), _slope(self.spin, moment)
        return torch.where((one > 0) & (other > 0), (one / other).sqrt(), math.nan)


def torque(impacts: Impacts | Columns) -> Torque:
    """Compute the terms of the moment balance I Δω = r_x P_n − r_y P_t with P = m Δv."""
    dv = impacts.v_post - impacts.v_pre
    gyration = impacts.inertia / impacts.mass
    normal, tangential = impacts.r[..., 0] * dv[..., 1] / gyration, -impacts.r[..., 1] * dv[..., 0] / gyration
    return Torque(dv[..., 2], normal, tangential, dv[..., :2].norm(dim=-1) / gyration.sqrt())


def _slope(y: Float[Tensor, "*batch n"], x: Float[Tensor, "*batch n"]) -> Float[Tensor, "*batch"]:
    """Slope of y over x by least absolute deviations: the median of y/x, weighted by |x|; nan where x is 0."""
    ratio, order = torch.where(x == 0, 0.0, y / x).sort(-1)
    share = x.abs().gather(-1, order).cumsum(-1)
    middle = torch.searchsorted(share, share[..., -1:] / 2).clamp_max(x.shape[-1] - 1)
    return torch.where(share[..., -1] > 0, ratio.gather(-1, middle)[..., 0], math.nan)


def kinetic_energy(impacts: Impacts | Columns) -> tuple[Float[Tensor, "*batch n"], Float[Tensor, "*batch n"]]:
    """Compute the kinetic energy in J before and after contact."""
    weight = torch.stack((impacts.mass, impacts.mass, impacts.inertia), -1)
    before, after = (0.5 * (weight * v**2).sum(-1) for v in (impacts.v_pre, impacts.v_post))
    return before, after


def repeated(impacts: Impacts) -> Bool[Tensor, " n"]:
    """Find the trials whose every pose and velocity equals, bit for bit, that of an earlier row."""
    numbers = torch.cat((impacts.r, impacts.q, impacts.v_pre, impacts.v_post), -1) + 0.0  # −0 is 0
    mixed = numbers.view(torch.int64) * torch.arange(1, 2 * numbers.shape[1], 2).pow(9)
    _, which, count = (mixed ^ (mixed >> 29)).sum(-1).unique(return_inverse=True, return_counts=True)
    seen: set[tuple[float, ...]] = set()
    twice = torch.zeros(len(numbers), dtype=torch.bool)
    for place in (count[which] > 1).nonzero()[:, 0].tolist():  # equal rows have equal sums, others almost never
        row = tuple(numbers[place].tolist())
        twice[place] = row in seen
        seen.add(row)
    return twice


def gross_outliers(impacts: Impacts, thresholds: AuditThresholds = AuditThresholds()) -> dict[str, Bool[Tensor, " n"]]:
    """Find the trials that cannot be the impacts that they claim to be, by reason.

    `moment`: the residual of the moment balance is gross; `energy`: the body gains too much; `approach`: the contact
    point does not approach the floor; `mass`: the mass or inertia is not that of the same object's other trials.
    """
    terms, residual = torque(impacts), _least_residual(impacts)
    before, after = kinetic_energy(impacts)
    spread = MAD_SCALE * terms.residual.abs().median()
    gross = residual > thresholds.moment_sigmas * spread
    far = (_mass_outliers(impacts, values, thresholds) for values in (impacts.mass, impacts.inertia))
    return {
        "moment": gross & (terms.imbalance > _IMBALANCE),
        "energy": after > thresholds.gross_ratio * before,
        "approach": impacts.v_c[:, 1] >= 0,
        "mass": torch.stack([*far]).any(0),
    }


def outliers(impacts: Impacts, thresholds: AuditThresholds = AuditThresholds()) -> Bool[Tensor, " n"]:
    """Find the gross outliers of any reason."""
    return torch.stack([*gross_outliers(impacts, thresholds).values()]).any(0)


def _least_residual(impacts: Impacts) -> Float[Tensor, " n"]:
    """|τ| / I at the given contact point or, for a polygon, at either of its two lowest corners.

    A body that lands nearly flat may touch with the other corner, for which no measurement is to blame.
    """
    least, theta = torque(impacts).residual.abs(), impacts.q[:, 2]
    if impacts.shape is None or not any(isinstance(one, Polygon) for one in shapes_among(impacts.shape).values()):
        return least

    def corners(shape: Shape) -> Float[Tensor, "n 4"]:
        return torch.cat(shape.lowest_corners(theta) if isinstance(shape, Polygon) else (impacts.r, impacts.r), -1)

    for r in per_body(impacts.shape, impacts.body, corners).chunk(2, -1):
        least = least.minimum(torque(impacts.replace(r=r, validate=False)).residual.abs())
    return least


def _mass_outliers(impacts: Impacts, values: Float[Tensor, " n"], thresholds: AuditThresholds) -> Bool[Tensor, " n"]:
    """Trials with a value far from its object's median; where that is common, two bodies share a name."""
    known = {name: k for k, name in enumerate(dict.fromkeys(impacts.object))}
    objects = torch.tensor([known[name] for name in impacts.object])
    unlike = torch.zeros(len(impacts), dtype=torch.bool)
    order, counts = objects.argsort(stable=True), torch.bincount(objects).tolist()
    for same in order.split(counts):
        far = (values[same] / values[same].median()).log().abs() > math.log(thresholds.gross_ratio)
        if far.sum() < _COMMON * len(same):
            unlike[same] = far
    return unlike


def contradictions(impacts: Impacts | Columns) -> dict[str, Float[Tensor, "*batch n"]]:
    """Compute the contradictions of each trial in [0, 1] by question; see the module for the questions."""
    before, after = impacts.v_c, contact_velocity(impacts.r, impacts.v_post)
    P = impacts.mass[..., None] * (impacts.v_post - impacts.v_pre)[..., :2]
    slip = torch.stack((before[..., 0], after[..., 0]), -1)
    along = (P[..., :1] * slip > 0).all(-1)
    energy, rebound = kinetic_energy(impacts)
    counts = (P[..., 0].abs() / (0.05 * P[..., 1].abs()).clamp_min(1e-300)).clamp_max(1)
    length = impacts.r.norm(dim=-1)
    answers = {
        "moment": torque(impacts).imbalance,
        "approach": (before[..., 1] >= 0).double(),
        "leaves": (after[..., 1] < -0.2 * before[..., 1].abs()).double(),
        "push": (P[..., 1] <= 0).double(),
        "below": (impacts.r[..., 1] >= 0).double(),
        "friction": along * counts * (slip.abs().amin(-1) / slip.abs().amax(-1).clamp_min(1e-300)),
        "energy": (rebound > 1.1 * energy).double(),
        "units": _implausible(impacts)[..., None].expand_as(length),
    }
    if impacts.shape is not None:
        off = (impacts.r - contact_points(impacts.shape, impacts.body, impacts.q[..., 2])).norm(dim=-1)
        answers["shape"] = (off / (0.5 * length).clamp_min(1e-300)).clamp_max(1)
    return answers


def _implausible(impacts: Impacts | Columns) -> Float[Tensor, "*batch"]:
    """The most decades by which a quantity lies outside its plausible range, at most 1."""
    length = impacts.r.norm(dim=-1).median(-1).values
    gyration = (impacts.inertia / impacts.mass).median(-1).values / length.clamp_min(1e-300) ** 2
    ratios = (
        gyration / _GYRATION[1],
        _GYRATION[0] / gyration,
        impacts.v_pre[..., :2].norm(dim=-1).median(-1).values / FASTEST,
        length / _LARGEST,
        impacts.q[..., 2].abs().median(-1).values / _TURNED,
    )
    return torch.stack(ratios).amax(0).log10().clamp(0, 1)


_BIWEIGHT = 4.685  # robust standard deviations at which the weight is 0: 95 % as efficient as least squares


@dataclass(frozen=True, kw_only=True)
class Balance:
    """The moment balance Δω = a r_x P_n / I − b r_y P_t / I, fitted robustly: a = b = 1 for consistent data.

    `a_error` and `b_error` are standard errors, `a_size` and `b_size` the medians of the terms, as shares of that of
    |Δv| / ρ, `r_squared` the share of Δω that the fit explains, without outliers, `freedom` the trials that count, less
    the two coefficients.
    """

    a: float
    b: float
    a_error: float
    b_error: float
    a_size: float
    b_size: float
    r_squared: float
    freedom: float

    @property
    def terms(self) -> dict[str, tuple[float, float, float]]:
        """By coefficient its value and the ends of its 95 % interval; those that the data leave open are not there."""
        values = {"a": (self.a, Z_95 * self.a_error), "b": (self.b, Z_95 * self.b_error)}
        return {name: (x, x - e, x + e) for name, (x, e) in values.items() if e < math.inf}

    @property
    def imbalance(self) -> float:
        """Relative amount by which a coefficient differs from 1 at least, with 95 %; infinite for a wrong sign.

        Noise in a moment shrinks its coefficient, to no less than the partial R² of its term (Frisch's bound).
        """
        most = 0.0
        for x, low, high in self.terms.values():
            noise = self.freedom * ((high - x) / Z_95) ** 2
            high = high / max(x**2 / (x**2 + noise) if x else 0.0, 1e-6)
            off = low - 1 if low > 1 else (1 / high - 1 if 0 < high < 1 else 0.0)
            most = max(most, math.inf if high <= 0 else off)
        return most

    def judged(self, small: float, sure: float) -> "Balance":
        """Return the balance without coefficients that noise alone may have made.

        Of a term that is all noise nothing is left, whatever its coefficient is: vertical drops without spin.

        Args:
            small: size of a term up to which it may be noise.
            sure: standard errors from 0 from which on its coefficient is none of noise.
        """
        open_ = {
            f"{name}_error": math.inf
            for name in "ab"
            if getattr(self, f"{name}_size") <= small
            and abs(getattr(self, name)) <= sure * getattr(self, f"{name}_error")
        }
        return replace(self, **open_)

    @property
    def tested(self) -> float:
        """Half-width of the narrower interval, the precision to which the data test the balance; infinite if none."""
        return min((high - x for x, _, high in self.terms.values()), default=math.inf)

    def __str__(self) -> str:
        numbers = {name: map(_signed, term) for name, term in self.terms.items()}
        text = " and ".join(f"{name} = {x} [{low}, {high}]" for name, (x, low, high) in numbers.items())
        return f"{text or 'no coefficient'} (95 %, R² = {self.r_squared:.2f})"


def _signed(value: float) -> str:
    return f"{value:+.2f}" if abs(value) >= 0.095 or value == 0 else f"{value:+.1g}"


def balance(impacts: Impacts) -> Balance:
    """Fit both coefficients of the moment balance by Tukey's biweight, from least absolute deviations.

    A term that is 0 in every trial (r_x of a disc) has the coefficient 0 ± ∞.
    """
    terms = torque(impacts)
    X, y = torch.stack((terms.normal, terms.tangential), -1), terms.spin
    X = torch.where((X**2).sum(0) > 1e-12 * (terms.scale**2).sum(), X, 0.0)  # r_x of a disc is 0 but for rounding
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
    freedom = (weight.sum() - 2).clamp_min(1)
    a_error, b_error = (covariance.diagonal() * residual / freedom).sqrt().tolist()
    r_squared = 1 - residual / (weight * y**2).sum().clamp_min(1e-300)
    a, b = fit.tolist()
    a_size, b_size = (X.abs().median(0).values / terms.scale.median().clamp_min(1e-300)).tolist()
    more = {"a_error": a_error, "b_error": b_error, "a_size": a_size, "b_size": b_size}
    return Balance(a=a, b=b, **more, r_squared=r_squared.item(), freedom=freedom.item())


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
