"""The moment balance, fitted: what coefficients the measurements give its two terms, and which they leave open."""

import math
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.numerics import MAD_SCALE, Z_95
from contactlearn.data.audit.consistency import torque
from contactlearn.mechanics.impacts import Impacts

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
        said = " and ".join(f"{name} = {x} [{low}, {high}]" for name, (x, low, high) in numbers.items())
        return f"{said or 'no coefficient'} (95 %, R² = {self.r_squared:.2f})"


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
