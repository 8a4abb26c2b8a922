"""Criteria of a drop: what it is expected to tell, given all drops before it.

    NameInformation       mutual information between the outcome and the name of the model, nats
    EffectSeparation      growth of the distance between all effects of the catalogue, nats: T-optimality
    ParameterInformation  mutual information between the outcome and the parameters, nats: D-optimality
    SpaceFilling          fall of a Gaussian process's variance over all drops within the limits: an even spread
    PredictionVariance    fall of the variance of the prediction over all drops within the limits: I-optimality

All are of n settings with R realisations each, side by side, over which they average: a rig does not reach a setting
exactly, and leaves some quantities to chance.  `after(k)` is the criterion once a drop was made at setting k and the
models were refitted to its expected outcome, so that a batch is chosen drop by drop.

The information about names has no closed form between Gaussians.  `NameInformation` has the bound of Kolchinsky &
Tracey from below, −Σ_i p_i ln Σ_j p_j exp(−d²_ij/8): it adds over drops, and ends where two models are separated
already.
Sources: Lindley 1956; Box & Hill 1967; Atkinson & Fedorov 1975, for T-optimality; Chaloner & Verdinelli 1995; Cohn,
Ghahramani & Jordan 1996; Kolchinsky & Tracey 2017 (Entropy 19, 361).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Protocol, Self

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn.functional import pad
from torch.nn.utils.rnn import pad_sequence

from contactlearn.diagnosis.discrimination.experiment import ModelDiscrimination
from contactlearn.planning.hypotheses import Candidates

_TYPICAL = 3.0  # size of an effect that may be missing: rms change of v_post over all settings, in units of the noise
_SHOWN = 0.1  # of the noise: effects that change less at most are not sought
_NUGGET = 0.05  # variance of an observation over that of the process that spreads drops evenly
_LENGTH = 0.4  # length scale of that process, in widths of the limits
_DRAWS = 256  # of outcomes, for a forecast


class Criterion(Protocol):
    """See the module."""

    def gain(self) -> Float[Tensor, "n"]:
        """Compute the expected information of the next drop at each setting."""
        ...

    def after(self, k: int) -> Self:
        """Return the criterion after a drop at setting k."""
        ...


@dataclass(frozen=True, kw_only=True)
class NameInformation:
    """Models with different names.

    Args:
        pairs: of models, in the order of `combinations`.
        same: whether both models of a pair have the same name, so that nothing is gained between them.
        probability: of each model.
        evidence: d² of each pair over the drops so far.
        repeats: realisations of a setting.
    """

    pairs: ModelDiscrimination
    same: Bool[Tensor, "p"]
    probability: Float[Tensor, "m"]
    evidence: Float[Tensor, "p"]
    repeats: int

    @classmethod
    def of(
        cls,
        means: Float[Tensor, "m n D"],
        slopes: Sequence[Float[Tensor, "n D k"]],
        covariances: Sequence[Float[Tensor, "k k"]],
        noise: Float[Tensor, "n D D"],
        *,
        names: Sequence[object],
        probability: Float[Tensor, "m"],
        repeats: int,
    ) -> Self:
        """Set models against each other: predictions at states, their derivatives, covariances of parameters."""
        pairs = list(combinations(range(len(means)), 2))
        most = max(c.shape[-1] for c in covariances)
        slope = torch.stack([torch.nn.functional.pad(s, (0, most - s.shape[-1])) for s in slopes])
        spread = torch.stack([torch.nn.functional.pad(c, (0, most - c.shape[-1]) * 2) for c in covariances])
        first, second = torch.tensor(pairs).T
        difference, both = means[first] - means[second], torch.cat((slope[first], -slope[second]), -1)
        zero = torch.zeros_like(spread[first])
        good = difference.isfinite().all(-1) & both.isfinite().all(-1).all(-1)
        return cls(
            pairs=ModelDiscrimination(
                difference=torch.where(good[..., None], difference, 0.0),
                slope=torch.where(good[..., None, None], both, 0.0),
                covariance=torch.cat((torch.cat((spread[first], zero), -1), torch.cat((zero, spread[second]), -1)), -2),
                noise=noise,
            ),
            same=torch.tensor([names[i] == names[j] for i, j in pairs]),
            probability=probability,
            evidence=torch.zeros(len(pairs), dtype=torch.float64),
            repeats=repeats,
        )

    def gain(self) -> Float[Tensor, "n"]:
        squared = self.pairs.squared().unflatten(-1, (-1, self.repeats)).mean(-1)
        return self.information(self.evidence[:, None] + squared) - self.information(self.evidence[:, None])

    def after(self, k: int) -> Self:
        row = k * self.repeats
        squared = self.pairs.at([row]).squared()[..., 0]
        return replace(self, pairs=self.pairs.after(row), evidence=self.evidence + squared)

    def at(self, settings: Sequence[int]) -> Self:
        """Return the criterion at the first realisation of some settings."""
        return replace(self, pairs=self.pairs.at([k * self.repeats for k in settings]), repeats=1)

    def information(self, evidence: Float[Tensor, "p n"]) -> Float[Tensor, "n"]:
        """Compute the expected information about the name after drops with d² of each pair."""
        overlap = self._square((-evidence / 8).exp(), 1.0)
        return -(self.probability[:, None] * (self.probability @ overlap).log()).sum(0)

    def right(self) -> float:
        """Compute the expected probability of the most probable name after the drops so far.

        The log likelihood ratio of a pair is normal with mean d²/2 and variance d² under the first of the two; those
        to several models are drawn independently.
        """
        d, m = self._square(self.evidence[:, None].sqrt(), 0.0)[..., 0], len(self.probability)
        unit = torch.randn(_DRAWS, m, m, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
        log = self.probability.clamp_min(1e-300).log() - d.square() / 2 + d * unit  # [draw, truth, model]
        same = self._square(torch.zeros(len(self.same), 1, dtype=torch.float64), 1.0)[..., 0]
        named = (log.softmax(-1) @ same).amax(-1).mean(0)
        return (self.probability * named).sum().item()

    def _square(self, x: Float[Tensor, "p n"], diagonal: float) -> Float[Tensor, "m m n"]:
        """Values of pairs as a symmetric matrix; those of one name have the value of the diagonal."""
        m = len(self.probability)
        first, second = torch.combinations(torch.arange(m)).T
        x = torch.where(self.same[:, None], diagonal, x)
        square = x.new_full((m, m, x.shape[-1]), diagonal)
        square[first, second] = square[second, first] = x
        return square


@dataclass(frozen=True, kw_only=True)
class EffectSeparation:
    """A model, and effects of which each may be the one that it lacks: T-optimality over all pairs of effects.

    The distance of effect j from the model refitted with effect k is d²_jk = a_j² (F_jj − F_jr (F_rr + P_r)⁻¹ F_rj): F
    is the Fisher information of all drops so far, r the parameters of the model and of k, P their prior precision, and
    a_j a typical size of j.  The gain is the growth of −ln mean_k 1/(1 + d²_jk), averaged over the effects.  This
    harmonic mean is dominated by the rivals from which j is not separated yet.

    Args:
        slope: derivative of v_post in all parameters at each setting, whitened by its noise; the last column is 0.
        information: Fisher information of the parameters by all drops so far.
        precision: of the parameters before anything is measured; 1 for the last.
        refitted: parameters of the model alone, and with each rival; filled up with the last.
        sought: parameters of the effects that may be missing.
        size: typical value of each.
        weight: of each in the mean over the effects; 0 for what no drop shows.
        rival: whether each rival is another effect than that of the parameter.
    """

    slope: Float[Tensor, "n D K"]
    information: Float[Tensor, "K K"]
    precision: Float[Tensor, "K"]
    refitted: Int[Tensor, "r l"]
    sought: Int[Tensor, "s"]
    size: Float[Tensor, "s"]
    weight: Float[Tensor, "s"]
    rival: Bool[Tensor, "r s"]

    @classmethod
    def of(cls, candidates: Candidates, *, repeats: int) -> Self:
        """Set candidates about a model against each other, at the first of the realisations of each setting."""
        names, first = candidates.names, candidates.model_parameters
        effects = {effect: [k for k, name in enumerate(names) if name == effect] for effect in names[first:]}
        columns = [torch.tensor([*range(first), *own]) for own in ([], *effects.values())]
        sought = torch.arange(first, len(names))
        change = candidates.slope[..., first:].square().sum(-2).mean(0).sqrt()
        size = (_TYPICAL / change.clamp_min(1e-12)).minimum(2 * candidates.prior[first:])
        share = torch.tensor([1 / len(effects[name]) for name in names[first:]], dtype=torch.float64)
        weight = torch.where(size * change > _SHOWN, share, 0.0)
        return cls(
            slope=pad(candidates.slope[::repeats], (0, 1)),
            information=pad(candidates.information, (0, 1, 0, 1)),
            precision=pad(candidates.prior.square().reciprocal(), (0, 1), value=1.0),
            refitted=pad_sequence(columns, batch_first=True, padding_value=len(names)),
            sought=sought,
            size=size,
            weight=weight / weight.sum().clamp_min(1e-12),
            rival=torch.tensor([[name != effect for name in names[first:]] for effect in (None, *effects)]),
        )

    def gain(self) -> Float[Tensor, "n"]:
        covariance, change, squared = self._refit()
        J = self.slope[..., self.refitted].permute(2, 0, 1, 3)  # [r n D l]
        residual = self.slope[..., self.sought] - J @ change[:, None]
        spread = J @ covariance[:, None] @ J.mT + torch.eye(J.shape[-2], dtype=J.dtype)
        growth = self.size.square() * (residual * (torch.linalg.inv(spread) @ residual)).sum(-2)
        return self._separation(squared[:, None] + growth) - self._separation(squared[:, None])

    def after(self, k: int) -> Self:
        return replace(self, information=self.information + self.slope[k].mT @ self.slope[k])

    def squared(self) -> Float[Tensor, "r s"]:
        """Compute d² of each effect from the model alone and from each rival, by all drops so far."""
        return self._refit()[2]

    def _refit(self) -> tuple[Float[Tensor, "r l l"], Float[Tensor, "r l s"], Float[Tensor, "r s"]]:
        """Covariance of the refitted parameters of each rival, their change by each effect, and d² that it leaves."""
        F, r = self.information, self.refitted
        covariance = torch.linalg.inv(F[r[:, :, None], r[:, None, :]] + torch.diag_embed(self.precision[r]))
        across = F[r][..., self.sought]
        change = covariance @ across
        squared = self.size.square() * (F.diagonal()[self.sought] - (across * change).sum(1))
        return covariance, change, squared.clamp_min(0.0)

    def _separation(self, squared: Float[Tensor, "r n s"]) -> Float[Tensor, "n"]:
        near = torch.where(self.rival[:, None], 1 / (1 + squared), 0.0).sum(0) / self.rival.sum(0)
        return -near.log() @ self.weight


@dataclass(frozen=True, kw_only=True)
class MeanCriterion:
    """The mean of a criterion over several models that may be true."""

    criteria: tuple[Criterion, ...]

    def gain(self) -> Float[Tensor, "n"]:
        return torch.stack([one.gain() for one in self.criteria]).mean(0)

    def after(self, k: int) -> Self:
        return replace(self, criteria=tuple(one.after(k) for one in self.criteria))


@dataclass(frozen=True, kw_only=True)
class ParameterInformation:
    """Linearised models whose parameters are sought.

    Args:
        slope: derivative of v_post in the parameters, whitened by its noise.
        covariance: of the parameters.
        probability: of each model.
        repeats: realisations of a setting.
    """

    slope: Float[Tensor, "m n D k"]
    covariance: Float[Tensor, "m k k"]
    probability: Float[Tensor, "m"]
    repeats: int

    def gain(self) -> Float[Tensor, "n"]:
        spread = self.slope @ self.covariance[:, None] @ self.slope.mT
        nats = torch.linalg.slogdet(spread + torch.eye(spread.shape[-1], dtype=spread.dtype))[1] / 2
        return (self.probability @ nats).unflatten(0, (-1, self.repeats)).mean(-1)

    def fall(self) -> Float[Tensor, "n"]:
        """Compute the fall of the prediction's mean variance, in squares of the noise, by a drop at each setting."""
        J, C = self.slope, self.covariance
        region = (J.mT @ J).mean(1)
        seen = J @ C[:, None]
        spread = seen @ J.mT + torch.eye(J.shape[-2], dtype=J.dtype)
        fall = torch.linalg.solve(spread, seen @ region[:, None] @ seen.mT).diagonal(dim1=-2, dim2=-1).sum(-1)
        return (self.probability @ fall).unflatten(0, (-1, self.repeats)).mean(-1)

    def after(self, k: int) -> Self:
        J, C = self.slope[:, k * self.repeats], self.covariance
        seen = J @ C
        spread = seen @ J.mT + torch.eye(J.shape[-2], dtype=J.dtype)
        return replace(self, covariance=C - seen.mT @ torch.linalg.solve(spread, seen))

    def error(self) -> float:
        """Root of the mean variance of the prediction over all drops within the limits, in units of the noise."""
        variance = torch.einsum("mndk,mkl,mndl->m", self.slope, self.covariance, self.slope) / self.slope.shape[1]
        return (self.probability @ variance / self.slope.shape[2]).sqrt().item()


@dataclass(frozen=True, kw_only=True)
class SpaceFilling:
    """Posterior covariance of a process of unit variance at n settings."""

    covariance: Float[Tensor, "n n"]

    @classmethod
    def of(cls, places: Float[Tensor, "n s"], measured: Float[Tensor, "k s"]) -> Self:
        """Condition a process on what was measured; places are in widths of the limits."""

        def kernel(a: Tensor, b: Tensor) -> Tensor:
            return (-(torch.cdist(a, b) / _LENGTH).square() / 2).exp()

        covariance = kernel(places, places)
        if len(measured):
            across = kernel(measured, places)
            own = kernel(measured, measured) + _NUGGET * torch.eye(len(measured), dtype=places.dtype)
            covariance = covariance - across.T @ torch.linalg.solve(own, across)
        return cls(covariance=covariance)

    def gain(self) -> Float[Tensor, "n"]:
        return self.covariance.square().mean(0) / (self.covariance.diagonal().clamp_min(0.0) + _NUGGET)

    def after(self, k: int) -> Self:
        row = self.covariance[k]
        return replace(self, covariance=self.covariance - row[:, None] * row / (row[k] + _NUGGET))


@dataclass(frozen=True, kw_only=True)
class PredictionVariance:
    """Predictions of a model, with a process of variance `unexplained`, in squares of the noise, for what it lacks."""

    parameters: ParameterInformation
    space: SpaceFilling
    unexplained: float

    def gain(self) -> Float[Tensor, "n"]:
        D = self.parameters.slope.shape[-2]
        return self.parameters.fall() + D * self.unexplained * self.space.gain()

    def after(self, k: int) -> Self:
        return replace(self, parameters=self.parameters.after(k), space=self.space.after(k))

    def error(self) -> float:
        """Root of the mean variance over all drops within the limits, in units of the noise."""
        return math.hypot(
            self.parameters.error(),
            math.sqrt(self.unexplained * self.space.covariance.trace().item() / len(self.space.covariance)),
        )
