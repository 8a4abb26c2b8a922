"""Hypotheses about units and axes, compared by how much the measurements contradict themselves under each.

A hypothesis is a few named corrections.  Under each the same questions are asked of every trial; an
answer is a contradiction in [0, 1], and 0 is what a rigid planar impact on a floor below would give:

    moment      I Δω = r_x P_n − r_y P_t with P = m Δv: the share of the terms that is left over
    approach    v_n < 0 before contact           leaves      v_n ≥ 0 after it, within a fifth of |v_n|
    push        P_n > 0: the floor does not pull
    below       r_y < 0: the floor is below the centre of mass
    friction    P_t is not along the slip both before and after; next to no P_t or slip hardly counts
    energy      no more after than before, within a tenth
    shape       r is the contact point of the body's shape at θ, where the shape is known
    units       I/m suits r, speeds and lengths are those of a laboratory, |θ| is no dozen turns

The moment balance alone knows the signs of its two terms only: turning θ looks like turning r.  The other
questions tell these apart, except for what is truly the same (a disc seen from behind).  Contradictions
are bounded, so no outlier decides; the mean over the trials is compared pairwise, with its standard error.
"""

import itertools
import math
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from contactlearn.audit.corrections import CORRECTIONS, inertia_factor, kinetic_energy, torque
from contactlearn.impacts import Impacts
from contactlearn.mechanics import contact_velocity
from contactlearn.shapes import contact_point

FRAME = (
    *("swapped_pre_post", "mirrored_y", "swapped_axes", "mirrored_x", "mirrored_theta"),
    *("contact_point_sign", "contact_point_mirrored"),
)
TURN = {"mirrored_y", "swapped_axes"}
"""Together a turn by 90°, to the one side or, the other way round, to the other."""

DEGREES = ("degrees_omega", "degrees_theta", "degrees")
UNITS = (*DEGREES, "millimetres", "millimetres_velocity", "grams", "inertia_scaled")
BALANCED = set(UNITS) - {"degrees_theta"}
"""Those that the moment balance can see."""

GAIN = 0.15
"""A hypothesis must take this much off the sum of the mean contradictions, for each correction it needs …"""
SIGMAS = 5.0
"""… and be this many standard errors better, trial by trial."""
INERTIA = 1.4
"""A moment of inertia that is off by less than this factor is no mistake in the data."""
_CONSISTENT = 0.5  # sum of contradictions below which no longer hypotheses are tried
_ALIKE = 0.02  # difference of scores that tells nothing
_DEPTH = 3  # corrections at once
_GYRATION = (0.02, 8.0)  # (I/m) / r²: a rod on its end has 1/3, a disc 1/2, one that lands flat more
_FASTEST, _LARGEST, _TURNED = 100.0, 10.0, 8 * math.pi  # m/s, m, rad


@dataclass(frozen=True)
class Balance:
    """The moment balance Δω = a r_x P_n / I − b r_y P_t / I, fitted robustly: a = b = 1 where all is well."""

    a: float
    b: float
    a_error: float  # standard errors
    b_error: float
    r_squared: float  # share of Δω that the fit explains, outliers left out

    def __str__(self) -> str:
        return f"{self.a:+.2f} ± {self.a_error:.2f} and {self.b:+.2f} ± {self.b_error:.2f} (R² = {self.r_squared:.2f})"


def balance(impacts: Impacts) -> Balance:
    """Robust fit of the two coefficients by Tukey's biweight (c = 4.685, from least absolute deviations).

    A term that is nowhere there (r_x = 0 for a disc) has the coefficient 0 ± ∞.
    """
    terms = torque(impacts)
    X, y = torch.stack((terms.normal, terms.tangential), -1), terms.spin
    weight = torch.ones_like(y)
    for step in range(40):
        fit, covariance = _weighted(X, y, weight)
        size = (y - X @ fit).abs()
        spread = (1.4826 * size.median()).clamp_min(1e-9 * y.abs().mean() + 1e-300)
        weight = (
            1 / size.clamp_min(spread / 10) if step < 10 else (1 - (size / (4.685 * spread)) ** 2).clamp_min(0) ** 2
        )
    left = (weight * size**2).sum()
    error = (covariance.diagonal() * left / (weight.sum() - 2).clamp_min(1)).sqrt()
    r_squared = 1 - left / (weight * y**2).sum().clamp_min(1e-300)
    return Balance(fit[0].item(), fit[1].item(), error[0].item(), error[1].item(), r_squared.item())


def _weighted(X: Tensor, y: Tensor, weight: Tensor) -> tuple[Tensor, Tensor]:
    """Weighted least squares and the inverse of its normal matrix; a column that vanishes gets 0 and ∞."""
    there = (X**2).sum(0) > 1e-12 * (y**2).sum()
    fit = torch.zeros(2, dtype=y.dtype)
    inverse = torch.diag(torch.full((2,), math.inf, dtype=y.dtype))
    if there.any():
        some = X[:, there]
        part = torch.linalg.pinv(some.mT @ (weight[:, None] * some), hermitian=True)
        fit[there] = part @ (some.mT @ (weight * y))
        inverse[there.nonzero(), there.nonzero().mT] = part
    return fit, inverse


def explained(impacts: Impacts) -> float:
    """Share of Δω that the moment balance explains with the coefficients +1 and +1, by medians; ≤ 0 if none."""
    terms = torque(impacts)
    left, spin = terms.residual.abs().median(), terms.spin.abs().median()
    return 1 - ((left / spin.clamp_min(1e-300)) ** 2).item()


def contradictions(impacts: Impacts) -> dict[str, Tensor]:
    """What each trial says against the frame and the units, by question: [N] in [0, 1]."""
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
        "units": torch.full_like(length, _implausible(impacts)),
    }
    if impacts.shape is not None:
        off = (impacts.r - contact_point(impacts.shape, impacts.q[:, 2])).norm(dim=-1)
        answers["shape"] = (off / (0.5 * length).clamp_min(1e-300)).clamp_max(1)
    return answers


def _implausible(impacts: Impacts) -> float:
    """How far the units are from any laboratory's: the most decades outside a plausible range, at most 1."""
    length = impacts.r.norm(dim=-1).median()
    gyration = (impacts.inertia / impacts.mass).median() / length.clamp_min(1e-300) ** 2
    decades = (
        (gyration / _GYRATION[1]).log10().item(),
        (_GYRATION[0] / gyration).log10().item(),
        (impacts.v_pre[:, :2].norm(dim=-1).median() / _FASTEST).log10().item(),
        (length / _LARGEST).log10().item(),
        (impacts.q[:, 2].abs().median() / _TURNED).log10().item(),
    )
    return min(1.0, max(0.0, *decades))


@dataclass(frozen=True)
class Hypothesis:
    """Corrections, and what the data says against itself once they are applied."""

    names: tuple[str, ...]
    impacts: Impacts

    @cached_property
    def answers(self) -> dict[str, Tensor]:
        return contradictions(self.impacts)

    @cached_property
    def total(self) -> Tensor:
        """Sum of the contradictions [N]."""
        return sum(self.answers.values())

    @property
    def score(self) -> float:
        """Mean sum of the contradictions, with the price of each correction: a hundredth, or twice that for a fit."""
        return self.total.mean().item() + 0.01 * len(self.names) + 0.01 * ("inertia_scaled" in self.names)

    def means(self) -> dict[str, float]:
        return {question: answer.mean().item() for question, answer in self.answers.items()}

    def __str__(self) -> str:
        return " + ".join(self.names) or "as they are"


@dataclass(frozen=True)
class Comparison:
    """The data as they are, the best hypothesis, and those of the same length that say the same."""

    given: Hypothesis
    best: Hypothesis
    equals: tuple[Hypothesis, ...]
    tried: int

    @property
    def gain(self) -> float:
        """Contradictions that the best hypothesis takes away, per trial."""
        return (self.given.total - self.best.total).mean().item()

    @property
    def sigmas(self) -> float:
        """The same in standard errors."""
        return _sigmas(self.given.total - self.best.total)


def _sigmas(gain: Tensor) -> float:
    error = gain.std() / math.sqrt(len(gain)) if len(gain) > 1 else torch.tensor(math.inf)
    return (gain.mean() / error.clamp_min(1e-3)).item()


def compare(impacts: Impacts) -> Comparison:
    """The best of all hypotheses of up to three corrections; longer ones are tried only where shorter ones fail."""
    given = best = Hypothesis((), impacts.replace(suspect=True))
    tried, equals = 1, []
    for depth in range(1, _DEPTH + 1):
        if depth > 1 and best.score < _CONSISTENT:
            break
        found = [_apply(given, names) for names in _combinations(depth)]
        found = sorted((h for h in found if h is not None), key=lambda h: h.score)
        tried += len(found)
        new = next((h for h in found if _better(h, best, depth)), None)
        if new is not None:
            alike = [h for h in found if new.score <= h.score < new.score + _ALIKE]
            best, *equals = sorted(alike, key=lambda h: [*map([*CORRECTIONS].index, h.names)])
    return Comparison(given, best, tuple(equals), tried)


def _better(new: Hypothesis, old: Hypothesis, depth: int) -> bool:
    """Other units must also make the moments balance: else they only shrink a Δω that is all noise."""
    gain = old.total - new.total
    if gain.mean().item() < GAIN * (depth - len(old.names)) or _sigmas(gain) < SIGMAS:
        return False
    return not BALANCED.intersection(new.names) or explained(new.impacts) > 0.5


def _combinations(depth: int) -> list[tuple[str, ...]]:
    """Corrections in the order in which they are applied; it matters for a swap and a mirror of y.

    An angle is in degrees once.  Before and after are not swapped with two other changes at once: a mirrored
    film run backwards explains any body that gains energy.
    """
    sets = itertools.combinations((*FRAME, *UNITS), depth)
    sensible = [
        names
        for names in sets
        if len({*names}.intersection(DEGREES)) < 2 and not (depth > 2 and "swapped_pre_post" in names)
    ]
    turned = [names for names in sensible if {*names} >= TURN]
    return sensible + [("swapped_axes", "mirrored_y", *(x for x in names if x not in TURN)) for names in turned]


def _apply(given: Hypothesis, names: tuple[str, ...]) -> Hypothesis | None:
    """None where the moment balance asks for a negative inertia, or one that is only a little different."""
    impacts = given.impacts
    for name in names:
        if name == "inertia_scaled" and not wrong_inertia(inertia_factor(impacts)):
            return None
        impacts = CORRECTIONS[name].function(impacts)
    return Hypothesis(names, impacts)


def wrong_inertia(factor: float) -> bool:
    """Whether a factor on I is a mistake in the data; a smaller one is the effect inertia_error."""
    return 0 < factor < math.inf and abs(math.log(factor)) > math.log(INERTIA)
