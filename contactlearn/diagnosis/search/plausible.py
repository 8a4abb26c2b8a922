"""The set of models that the data cannot tell from the chosen one, with the share of belief that each has.

A model of the pool is plausible if its score is within a few nats of the chosen one's and no part of it, the same law
with fewer of its effects, scores better (Occam's window).  The shares are those of the models' pseudo-posteriors,
averaged over Bayesian bootstraps of the trials, so that a lead that rests on a few trials counts for little.
Sources: Madigan & Raftery 1994; Yao, Vehtari, Simpson & Gelman 2018.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.diagnosis.search.pool import Pool, ScoredFit
from contactlearn.effects import EffectId
from contactlearn.inference.identification.robust import robust_distance
from contactlearn.inference.validation import robust_covariance

_RESAMPLES = 2000


@dataclass(frozen=True)
class Plausible:
    """A plausible model and its share of all belief."""

    model: ScoredFit
    share: float


def plausible_models(pool: Pool, chosen: ScoredFit, window: float, generator: torch.Generator) -> tuple[Plausible, ...]:
    """Find the models that the data cannot tell from a chosen one, that one among them, by their shares.

    Args:
        pool: of fitted models.
        chosen: one of them.
        window: nats above the chosen model's score within which others are plausible.
        generator: of the bootstrap.
    """
    near = [model for model in pool.models.values() if model.score < chosen.score + window]
    near = [model for model in near if len(model.spec.effects) <= len(chosen.spec.effects)]
    models = [model for model in near if model is chosen or not any(_part(other, model) for other in near)]
    shares = _shares(pool, models, generator)
    found = [Plausible(model, share) for model, share in zip(models, shares.tolist(), strict=True)]
    return tuple(sorted(found, key=lambda one: -one.share))


def inclusion(models: Sequence[Plausible], effect: EffectId) -> float:
    """Compute the share of the models that contain an effect, in whatever form."""
    return sum(one.share for one in models if effect.name in one.model.spec.families)


def _part(other: ScoredFit, model: ScoredFit) -> bool:
    """Whether another model is a part of a model and scores no worse."""
    smaller = other.spec.law == model.spec.law and other.spec.effects < model.spec.effects
    return smaller and other.score <= model.score


def _shares(pool: Pool, models: Sequence[ScoredFit], generator: torch.Generator) -> Float[Tensor, " m"]:
    """Pseudo-posterior shares of models, averaged over bootstraps."""
    trials = len(pool.impacts)
    loss = torch.stack([_losses(pool, model) for model in models])
    penalty = torch.tensor([model.score for model in models], dtype=torch.float64) - loss.sum(1)
    weights = torch.empty(_RESAMPLES, trials, dtype=torch.float64).exponential_(generator=generator)
    total = trials * weights / weights.sum(1, keepdim=True) @ loss.T + penalty
    return torch.softmax(-total, 1).mean(0)


def _losses(pool: Pool, model: ScoredFit) -> Float[Tensor, " n"]:
    """Robust loss of each trial in nats, up to a constant."""
    residual = pool.impacts.v_post - model.fit.model.predict(pool.impacts).v_post
    scatter = robust_covariance(residual)  # that of the fit is in units of the noise, where that is known
    return robust_distance(residual, scatter) + 0.5 * scatter.logdet()
