"""Selection of a law and of the effects that are missing from it, by a search over both together.

search     laws and sets of effects, on a part of many trials (`frontier`)
refit      the best of each size on all trials, and the exchanges that the linearisation still promises there
prune      effects that are not worth a name: without them the held-out error is barely higher, or only by chance
compare    the models that the data cannot distinguish from the chosen one

A model of the pool is plausible if its score is within a few nats of the chosen one's and no part of it, the same law
with fewer of its effects, scores better (Occam's window).  The shares are those of the models' pseudo-posteriors,
averaged over Bayesian bootstraps of the trials, so that a lead that rests on a few trials counts for little.
Sources: Madigan & Raftery 1994; Yao, Vehtari, Simpson & Gelman 2018.
"""

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.diagnosis.search.candidates import fitted_first
from contactlearn.diagnosis.search.frontier import HOPELESS, Search
from contactlearn.diagnosis.search.pool import Pool, ScoredFit, Spec
from contactlearn.diagnosis.sign_flips import chance_of_gain
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.diagnosis.unexplained.contact_scatter import weighed
from contactlearn.effects import Effect, EffectId
from contactlearn.inference.identification.joint import FitOptions
from contactlearn.inference.identification.robust import robust_distance
from contactlearn.inference.validation import CrossValidation, Folds, ValidatedFit, robust_covariance
from contactlearn.laws import Law
from contactlearn.mechanics.impacts import Impacts

_RESAMPLES = 2000
_MOST_EFFECTS = 8  # of a model
_SEARCHED = 400  # trials of the search; all of them decide afterwards
_CARRIED = 2  # models of each size that are fitted to all trials
_RIVAL_FITS = 8  # exchanges of an effect that are fitted for the comparison


# --- Plausible models ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Plausible:
    """A plausible model and its share of all belief."""

    model: ScoredFit
    share: float


def plausible_models(pool: Pool, chosen: ScoredFit, window: float, generator: torch.Generator) -> tuple[Plausible, ...]:
    """Find the models that the data cannot distinguish from a chosen one, that one among them, by their shares.

    Args:
        pool: of fitted models.
        chosen: one of them.
        window: nats above the chosen model's score within which others are plausible.
        generator: of the bootstrap.
    """
    near = [model for model in pool.models.values() if model.score < chosen.score + window]
    near = [model for model in near if _as_simple(model, chosen)]
    models = [model for model in near if model is chosen or not any(_part(other, model) for other in near)]
    shares = _shares(pool, models, generator)
    plausible = [Plausible(model, share) for model, share in zip(models, shares.tolist(), strict=True)]
    return tuple(sorted(plausible, key=lambda model: -model.share))


def inclusion(models: Sequence[Plausible], effect: EffectId) -> float:
    """Compute the share of the models that contain an effect, in whatever form."""
    return sum(plausible.share for plausible in models if effect.name in plausible.model.spec.families)


def _as_simple(model: ScoredFit, other: ScoredFit) -> bool:
    """Return whether a model has no more effects than another, or no more parameters: two of one do for one of four."""
    return len(model.spec.effects) <= len(other.spec.effects) or len(model.fit.values) <= len(other.fit.values)


def _part(other: ScoredFit, model: ScoredFit) -> bool:
    """Return whether another model is nested in a model and scores no worse."""
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
    residual = pool.impacts.residual(model.fit.model.predict(pool.impacts).v_post)
    scatter = robust_covariance(residual)  # that of the fit is in units of the noise, where that is known
    return robust_distance(residual, scatter) + 0.5 * scatter.logdet()


# --- Selection -------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Selection:
    """A chosen model, and what it was chosen from.

    Args:
        pool: models on all trials.
        folds: of the cross-validation.
        spec: of the chosen model.
        base: its law with the given effects.
        present: the chosen model.
        plausible: models that the data cannot distinguish from it.
        complete: whether the search came to its own end.
    """

    pool: Pool
    folds: Folds
    spec: Spec
    base: ValidatedFit
    present: ValidatedFit
    plausible: tuple[Plausible, ...]
    complete: bool

    @property
    def law(self) -> Law:
        """The law of the chosen model; its own μ and ε are not used."""
        return self.pool.laws[self.spec.law]

    @property
    def impacts(self) -> Impacts:
        """All trials."""
        return self.pool.impacts

    @property
    def given(self) -> Mapping[str, Effect]:
        """Effects that are in every model, by name."""
        return self.pool.given

    @property
    def chosen(self) -> ScoredFit:
        """The chosen model with its score."""
        return self.pool.models[self.spec]

    @property
    def missing(self) -> list[EffectId]:
        """Effects of the chosen model that were not given, in the order of its parameters."""
        return [key for key in self.pool.candidates if key in self.spec.effects]

    def validated(self, spec: Spec) -> ValidatedFit:
        """Score a fitted model of the pool on held-out trials."""
        return validated(self.pool, self.folds, self.pool.models[spec])

    def without_each(self, effects: Sequence[EffectId]) -> list[ValidatedFit]:
        """Fit and validate the chosen model without each one of some of its effects."""
        models = smaller(self.pool, self.chosen, *effects)
        predict_held_out(self.pool, self.folds, models)
        return [self.validated(model.spec) for model in models]

    def replacements(self, effect: EffectId) -> tuple[dict[str, EffectId], float]:
        """Find the effects that plausible models have in the place of a chosen one, by name, and these models' share.

        The likeliest effect comes first, each in its likeliest form.
        """
        replacing, share = dict[str, EffectId](), 0.0
        for plausible in self.plausible:
            others = [other for other in plausible.model.spec.effects if other.name not in self.spec.families]
            if others and effect.name not in plausible.model.spec.families:
                replacing |= {other.name: other for other in others if other.name not in replacing}
                share += plausible.share
        return replacing, share

    def path(self) -> list[ScoredFit]:
        """List the best model of each smaller number of effects, and the chosen one."""
        return [*(self.pool.best_of_sizes([size]) for size in range(len(self.spec.effects))), self.chosen]

    def at(self, spec: Spec, window: float, generator: torch.Generator) -> "Selection":
        """Choose another model of the pool."""
        return _chosen(self.pool, self.folds, spec, self.complete, window, generator)

    def error_around(self, law: Law) -> float | None:
        """Compute the mean held-out error of the chosen effects around a law; None if they do not suit it at all."""
        if law.name == self.spec.law:
            return self.present.mean_error
        pool = Pool({law.name: law}, self.impacts, self.pool.candidates, self.given, self.pool.options)
        spec, values = self.spec.with_law(law.name), self.present.fit.values
        score = self.pool.score_at(self.spec, values)
        if pool.score_at(spec, values) > score + HOPELESS * len(self.impacts):
            return None
        return validated(pool, self.folds, pool.fitted(spec, values)).mean_error


def select(
    laws: Mapping[str, Law],
    impacts: Impacts,
    candidates: Mapping[EffectId, Effect],
    folds: Folds,
    *,
    given: Mapping[str, Effect],
    starts: Mapping[str, Float[Tensor, " k"]] = MappingProxyType({}),
    options: FitOptions = FitOptions(),
    thresholds: Thresholds = Thresholds(),
    seconds: float = math.inf,
    generator: torch.Generator,
    progress: Callable[[Iterable[int]], Iterable[int]] = iter,
) -> Selection:
    """Choose a law and effects around it.

    Args:
        laws: by name, one or several; their own μ and ε are not used.
        impacts: measurements.
        candidates: by identity; `usable` ones.
        folds: of the cross-validation.
        given: effects that are always in the model, by name.
        starts: values to fit the laws with the given effects from, by name; others are searched for.
        options: of all fits.
        thresholds: limits of what is named.
        seconds: limit of the processor's time, s; after it, the fitted models decide.
        generator: of the part that is searched and of the bootstrap.
        progress: wraps the sizes of the search.
    """
    prepared = {key: effect.prepare(impacts) for key, effect in candidates.items()}
    prepared = {key: effect for key, effect in prepared.items() if effect.parameters}
    pool = Pool(laws, impacts, prepared, given, options)
    pool.all_fitted({Spec(law): starts.get(law) for law in fitted_first(pool.laws)})
    end = time.process_time() + seconds
    complete = _searched(pool, _MOST_EFFECTS, end, generator, progress)
    pool, complete = _weighed(pool, complete, end, thresholds)
    spec = _pruned(pool, folds, pool.best(), thresholds).spec
    return _chosen(pool, folds, spec, complete, thresholds.window, generator)


def validated(pool: Pool, folds: Folds, model: ScoredFit, scatter: Float[Tensor, "D D"] | None = None) -> ValidatedFit:
    """Score a model on held-out trials, its losses in the scatter of its own residual or in a given one."""
    predict_held_out(pool, folds, [model])
    held = pool.predicted[folds, model.spec]
    return _folds(pool, folds, model).validated(model.effects, model.fit, scatter, held)


def predict_held_out(pool: Pool, folds: Folds, models: Iterable[ScoredFit]) -> None:
    """Fit models to the folds, whose predictions `validated` then finds in the pool."""
    for model in models:
        if (folds, model.spec) not in pool.predicted:
            predicted = _folds(pool, folds, model).predicted(model.effects, model.fit)
            pool.predicted[folds, model.spec] = predicted


def _folds(pool: Pool, folds: Folds, model: ScoredFit) -> CrossValidation:
    return CrossValidation(law=pool.laws[model.spec.law], impacts=pool.impacts, folds=folds, options=pool.options)


def smaller(pool: Pool, model: ScoredFit, *effects: EffectId) -> list[ScoredFit]:
    """Fit a model without each one of some of its effects."""
    specs = [Spec(model.spec.law, model.spec.effects - {effect}) for effect in effects]
    return pool.all_fitted({spec: pool.start(spec, model, {}) for spec in specs})


def _chosen(
    pool: Pool, folds: Folds, spec: Spec, complete: bool, window: float, generator: torch.Generator
) -> Selection:
    """The selection of a model, with its neighbours."""
    model = pool.models[spec]
    pool.fitted(Spec(spec.law))  # a law that refines others may not have been fitted alone
    Search(pool, len(spec.effects)).exchange_all(model, model.score + window, _RIVAL_FITS)
    models = pool.polished(*dict.fromkeys((Spec(spec.law), spec)))
    predict_held_out(pool, folds, models)
    return Selection(
        pool=pool,
        folds=folds,
        spec=spec,
        base=validated(pool, folds, models[0]),
        present=validated(pool, folds, models[-1]),
        plausible=plausible_models(pool, pool.models[spec], window, generator),
        complete=complete,
    )


def _searched(
    pool: Pool,
    most: int,
    end: float,
    generator: torch.Generator,
    progress: Callable[[Iterable[int]], Iterable[int]],
) -> bool:
    """Fill a pool with the models that may be the best; return whether the search came to its own end."""
    trials = len(pool.impacts)
    if trials <= _SEARCHED:
        return Search(pool, most, end).run(progress)
    rows = torch.randperm(trials, generator=generator)[:_SEARCHED].sort().values
    part = Pool(pool.laws, pool.impacts[rows], pool.candidates, pool.given, pool.options)
    part.all_fitted({Spec(law): pool.models[Spec(law)].fit.values for law in fitted_first(pool.laws)})
    search, whole = Search(part, most, end), Search(pool, most, end)
    complete = search.run(progress)
    _carry(search, pool)
    whole.improve()
    return complete and not whole.late


def _weighed(pool: Pool, complete: bool, end: float, thresholds: Thresholds) -> tuple[Pool, bool]:
    """Weigh the trials by instrument and scatter of the contact, where that is plain, and search on from the best.

    The scatter is that around the best model of all sizes, which leaves the least structure.
    """
    impacts = weighed(pool.impacts, pool.best().fit.model, pool.options, thresholds)
    if impacts is None:
        return pool, complete
    reweighed = Pool(pool.laws, impacts, pool.candidates, pool.given, pool.options)
    _carry(Search(pool, _MOST_EFFECTS), reweighed)
    search = Search(reweighed, _MOST_EFFECTS, end)
    search.improve()
    return reweighed, complete and not search.late


def _carry(search: Search, pool: Pool) -> None:
    """Fit the best models of each size to other trials."""
    sizes = range(len(search.pool.best().spec.effects) + 2)
    pool.all_fitted({model.spec: model.fit.values for size in sizes for model in search.models(size)[:_CARRIED]})


def _pruned(pool: Pool, folds: Folds, model: ScoredFit, thresholds: Thresholds) -> ScoredFit:
    """The model without the effects that are not worth a name, the least judged first.

    What is left without one is exchanged for the best model of no more effects, so that the answer is on the frontier.
    In the end all effects that a smaller model of the frontier has not must be worth their names together: several that
    stand for one effect each bring little less than it does.  Where they are not, the smaller models are asked in turn.
    More effects with no more parameters that fit better need no such proof.
    """

    def improves(less: ScoredFit, more: ScoredFit) -> bool:
        if _as_simple(more, less):
            return more.score < less.score
        base = pool.fitted(Spec(more.spec.law))
        predict_held_out(pool, folds, (less, more, base))
        without, whole, alone = (validated(pool, folds, fitted) for fitted in (less, more, base))
        effects = len(more.spec.effects) - len(less.spec.effects)
        return _improves_enough(without, whole, alone.mean_error, thresholds, effects)

    def worthy(model: ScoredFit) -> bool:
        return all(improves(less, model) for less in smaller(pool, model, *sorted(model.spec.effects)))

    while model.spec.effects:
        less = pool.best(smaller(pool, model, *sorted(model.spec.effects)))
        if improves(less, model):
            break
        model = pool.best_of_sizes(range(len(less.spec.effects) + 1))
    sizes = sorted({len(spec.effects) for spec in pool.models if len(spec.effects) < len(model.spec.effects)})
    frontier = [pool.best_of_sizes([size]) for size in sizes]
    if not all(improves(less, model) for less in frontier):
        model = frontier[0]
        for more in frontier[1:]:
            if improves(model, more):
                model = more
    simple = pool.best(other for other in pool.models.values() if _as_simple(other, model))
    return simple if simple is not model and worthy(simple) else model


def _improves_enough(
    without: ValidatedFit, whole: ValidatedFit, base: float, thresholds: Thresholds, effects: int = 1
) -> bool:
    """Return whether effects reduce the error significantly, and by enough for each of them."""
    gain = without.loss - whole.loss
    fall, together = without.mean_error - whole.mean_error, base - whole.mean_error
    enough = min(thresholds.minor_share * together, thresholds.form_error * without.mean_error)
    each = max(enough, thresholds.least_gain * without.mean_error)
    return fall > effects * each and chance_of_gain(gain[gain.isfinite()]) < thresholds.gain_level
