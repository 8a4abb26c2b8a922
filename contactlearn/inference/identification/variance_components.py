"""Variances of a linear mixed model with D components a trial, by restricted maximum likelihood.

    r_k = X_k θ + e_k,      S_k = R_k + Σ_c τ_c B_ck,      e_k ~ Σ_j π_j N(0, c_j² S_k)

R_k is known, B_ck is the covariance of component c at unit variance, τ_c ≥ 0.  The mixture keeps what is not normal out
of S: ordinary trials (c = 1), tails (c up to 5; a fifth of Student's t with four degrees of freedom is twice as wide)
and gross outliers.  The restricted log likelihood Σ_k log p(r_k) − ½ log |Σ_k w_k Xᵀ S⁻¹ X| is maximised by Fisher
scoring in τ, generalised least squares in θ, and expectation–maximisation in π and c.

Sources: Patterson & Thompson 1971; Tukey 1960 (contaminated normal).
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

_ROUNDS = 6
_REWEIGHTED = 3  # times that trials get new weights at given variances
_CALM = 1e-3  # nats that a last round brings
_MIN_VARIANCE_SHARE = 1e-6  # share of the variance of the trials below which a component is 0
_FASTEST = 0.05  # of its last value, to which a variance may fall in one step, so that it does not stick at 0 too early
_FACTOR_BOUNDS = torch.tensor(((1.0, 1.0), (1.5, 5.0), (5.0, 100.0))).double()  # of c of trials, tails, outliers
_SHARE_BOUNDS = torch.tensor((1.0, 0.4, 0.1)).double()  # bounds of their shares


@dataclass(frozen=True, kw_only=True)
class Mixture:
    """Shares π [3] of ordinary trials, tails and outliers, and factors c [3] on their standard deviations."""

    shares: Float[Tensor, "3"]
    factors: Float[Tensor, "3"]

    @classmethod
    def initial(cls) -> "Mixture":
        """Return a mixture to begin with."""
        return cls(
            shares=torch.tensor((0.93, 0.06, 0.01), dtype=torch.float64),
            factors=torch.tensor((1.0, 2.5, 10.0), dtype=torch.float64),
        )

    @cached_property
    def precisions(self) -> Float[Tensor, "3"]:
        """1/c² of each part."""
        return self.factors.square().reciprocal()

    @cached_property
    def _height(self) -> tuple[Float[Tensor, "3"], Float[Tensor, "3"]]:
        """Logarithms of each part of the density at its middle: the share, and what each component takes off."""
        return self.shares.clamp_min(1e-300).log(), self.factors.log() + 0.5 * math.log(2 * math.pi)

    def log_density(self, distance: Float[Tensor, " n"], components: int) -> Float[Tensor, "n 3"]:
        """Logarithm of each part of the density at squared distances d², without what S adds."""
        share, each = self._height
        return share - components * each - 0.5 * distance[:, None] * self.precisions

    def updated(self, distance: Float[Tensor, " n"], components: int) -> "Mixture":
        """Return the mixture after one step of expectation–maximisation."""
        each = self.log_density(distance, components).softmax(-1)
        shares = torch.minimum(each.mean(0), _SHARE_BOUNDS)
        shares[0] = 1 - shares[1:].sum()
        square = (each * distance[:, None]).sum(0) / (components * each.sum(0).clamp_min(1e-12))
        return replace(self, shares=shares, factors=square.sqrt().clamp(*_FACTOR_BOUNDS.mT))


@dataclass(frozen=True, kw_only=True)
class MixedModel:
    """Residuals r [N, D], slopes X [N, D, K], known covariances R [N, D, D] and those of components B [c, N, D, D]."""

    residual: Float[Tensor, "n D"]
    slope: Float[Tensor, "n D K"]
    known: Float[Tensor, "n D D"]
    bases: Float[Tensor, "c n D D"]

    @cached_property
    def _sides(self) -> Float[Tensor, "n D K+1"]:
        """Slopes and residuals, of which the normal equations are made."""
        return torch.cat((self.slope, self.residual[..., None]), -1)

    def _factors(self, variances: Float[Tensor, " c"]) -> "_Factors":
        """Return what depends on the variances alone."""
        covariance = self.known + (variances @ self.bases.flatten(1)).view_as(self.known)
        covariance = covariance + 1e-12 * torch.diag(covariance.diagonal(dim1=-2, dim2=-1).mean(0))
        root = torch.linalg.cholesky(covariance)
        inverse = torch.cholesky_inverse(root)
        volume = 2 * root.diagonal(dim1=-2, dim2=-1).log().sum(-1)
        return _Factors(inverse, volume, (self.slope.mT @ inverse @ self._sides).flatten(1))

    def at(self, variances: Float[Tensor, " c"], mixture: Mixture, last: "MixedFit | None" = None) -> "MixedFit":
        """Return θ and the likelihood at given variances, beginning with the weights of the `last` fit."""
        D, K = self.slope.shape[1:]
        same = last if last is not None and last.variances is variances else None  # but for its mixture
        factors = self._factors(variances) if same is None else same.factors
        weight = torch.ones_like(factors.volume) if last is None else last.weight
        for left in reversed(range(_REWEIGHTED)):
            precision, right = (weight @ factors.equations).view(K, K + 1).split((K, 1), -1)
            precision = precision + torch.diag(1e-10 * precision.diagonal() + 1e-12)
            step = torch.linalg.solve(precision, right)[:, 0]
            error = self.residual - self.slope @ step
            pull = (factors.inverse @ error[..., None])[..., 0]
            distance = (error * pull).sum(-1)
            parts = mixture.log_density(distance, D)
            weight = parts.softmax(-1) @ mixture.precisions
            if left == 0:
                density = parts.logsumexp(-1) - 0.5 * factors.volume
                return MixedFit(
                    variances=variances,
                    mixture=mixture,
                    step=step,
                    precision=precision,
                    factors=factors,
                    pull=pull,
                    distance=distance,
                    weight=weight,
                    log_likelihood=density.sum().item() - 0.5 * torch.linalg.slogdet(precision).logabsdet.item(),
                )
        raise AssertionError("unreachable: the last round returns")

    def scores(self, fit: "MixedFit") -> tuple[Float[Tensor, " c"], Float[Tensor, "c c"]]:
        """Gradient of the restricted log likelihood in the variances, and their Fisher information."""
        turned = fit.inverse @ self.bases
        information = 0.5 * turned.flatten(1) @ turned.mT.flatten(1).mT
        slope, weight = fit.inverse @ self.slope, fit.weight[:, None, None]
        lost = slope @ torch.linalg.inv(fit.precision) @ slope.mT
        seen = fit.pull[:, :, None] * fit.pull[:, None]
        return 0.5 * self.bases.flatten(1) @ (weight * (seen + lost) - fit.inverse).flatten(), information

    def fit(self, start: Float[Tensor, " c"], free: Bool[Tensor, " c"], mixture: Mixture) -> "MixedFit":
        """Maximise the restricted likelihood over the variances that are `free`; the others are 0.

        So is that of a component which no trial shows, such as the friction of impacts that all stick.
        """
        free = free & (self.bases.abs().amax((1, 2, 3)) > 0)
        fit = self.at(torch.where(free, start, 0.0), mixture)
        for _ in range(_ROUNDS):
            mixture = fit.mixture.updated(fit.distance, self.residual.shape[-1])
            fit = self.at(fit.variances, mixture, fit)
            better = self._scored(fit, free)
            if better is None or better.log_likelihood - fit.log_likelihood < _CALM:
                return better or fit
            fit = better
        return fit

    def _scored(self, fit: "MixedFit", free: Bool[Tensor, " c"]) -> "MixedFit | None":
        """Take a step of Fisher scoring, shortened until it gains; None where no step gains."""
        gradient, information = self.scores(fit)
        rows = (free & ~((fit.variances <= 0) & (gradient <= 0))).nonzero()[:, 0]
        if not len(rows):
            return None
        inside = information[rows][:, rows]
        step = torch.zeros_like(gradient)
        size = inside.diagonal().sqrt()  # of variances in units that differ
        ridge = 1e-9 * torch.eye(len(rows), dtype=size.dtype)
        step[rows] = torch.linalg.solve(inside / (size[:, None] * size) + ridge, gradient[rows] / size) / size
        whole = self.bases.flatten(1) @ fit.inverse.flatten() / len(self.residual)  # share of a unit variance
        for length in (1.0, 0.5, 0.25, 0.1, 0.02):
            tried = torch.maximum(fit.variances + length * step, _FASTEST * fit.variances)
            tried = torch.where(tried * whole > _MIN_VARIANCE_SHARE, tried, 0.0)
            moved = self.at(tried, fit.mixture, fit)
            if moved.log_likelihood >= fit.log_likelihood:
                return moved
        return None


class _Factors(NamedTuple):
    """S⁻¹, log |S|, and each trial's part of the normal equations."""

    inverse: Float[Tensor, "n D D"]
    volume: Float[Tensor, " n"]
    equations: Float[Tensor, "n rows"]


@dataclass(frozen=True, kw_only=True)
class MixedFit:
    """Variances τ [c], `step` θ [K] with its `precision`, what is made of S, S⁻¹ e as `pull`, and weights."""

    variances: Float[Tensor, " c"]
    mixture: Mixture
    step: Float[Tensor, " K"]
    precision: Float[Tensor, "K K"]
    factors: _Factors
    pull: Float[Tensor, "n D"]
    distance: Float[Tensor, " n"]
    weight: Float[Tensor, " n"]
    log_likelihood: float

    @property
    def inverse(self) -> Float[Tensor, "n D D"]:
        """S⁻¹ [N, D, D]."""
        return self.factors.inverse
