"""The search over laws and sets of effects together, and its frontier: the best models of each number of effects.

    grow       from the best models of a size, the most promising ones with one effect more
    exchange   from the best of the new size, those with one of their effects exchanged
    refine     the best of the new size, of several laws while effects are few, with other forms, which may be misjudged
    shrink     from the best of all, those with one effect less, so that no size keeps what only the way there needed
    transfer   the effects of the best model of a size around every other law

Laws that refine others are tried in the place of the best law alone, and once more around the best model of each size
after the search.

Promising is what the linearisation of a fitted model with all candidates around it predicts (`quadratic`), for
thousands of sets at once; only these are fitted jointly with the law.  The search ends when two sizes in turn bring
nothing, or when its time is up.
Sources: Hofmann, Gatu & Kontoghiorghes 2007, for exchanges; Efroymson 1960, for deletions.
"""

import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.diagnosis.search.pool import Pool, ScoredFit, Spec, identities
from contactlearn.diagnosis.search.projection import Projection, projects
from contactlearn.diagnosis.search.quadratic import Group, Quadratic

Neighbours = Callable[[frozenset[Group], Sequence[Group]], Iterator[frozenset[Group]]]
"""Sets that are near a set, given all groups of parameters."""

_BEAM, _OF_A_LAW = 4, 2  # at most, models of a size from which the next is grown
HOPELESS = 0.5
"""Nats a trial behind the best beyond which a law is given up."""
_SAME = 2.0  # nats between laws that agree on the data
_IDENTICAL = 1e-6  # nats between laws that predict the same
_FITTED = 4  # sets that are fitted of each expansion
_DOUBT = 0.02  # nats a trial by which a prediction may be too pessimistic
_FEW = 2  # effects up to which other forms are tried around several laws, beyond them around the best alone
_SHIFTS = (0.0, *(sign * 0.005 * k for k in range(1, 7) for sign in (-1, 1)))
"""Changes of ε at which what refines others is tried."""
_TRIED, _EVERY = 32, 2  # values of the parameters of a form that refines, and the trials on which they are compared
_PASSES = 4  # of exchanges within one linearisation
_WORTH = 0.04  # nats a trial that one effect more must bring for the search to go on
_OUTLIERS = 0.02  # share of the trials; noise makes hardly any, and outliers of the measurements are set aside before
_FRUITLESS = 2  # sizes in turn without a better model after which the search ends


@dataclass(frozen=True)
class Proposal:
    """A set of groups of parameters that may be worth a fit, with the score that is predicted about a model."""

    about: ScoredFit
    quadratic: Quadratic
    groups: frozenset[Group]
    score: float

    @property
    def spec(self) -> Spec:
        """The model."""
        return Spec(self.about.spec.law, identities(self.groups))

    def start(self, pool: Pool) -> Float[Tensor, " k"]:
        """Compute the parameters at the linear step."""
        _, theta = self.quadratic.losses([self.groups])
        return pool.start(self.spec, self.about, self.quadratic.values(self.groups, theta[0]))


class Search:
    """The search; see the module.

    Args:
        pool: receives the models.
        most_effects: of a model.
        end: of the time, by `time.process_time()`, after which nothing more is fitted.
    """

    def __init__(self, pool: Pool, most_effects: int, end: float = math.inf) -> None:
        self.pool, self.most_effects, self.end = pool, most_effects, end
        self.quadratics: dict[Spec, Quadratic] = {}
        self.refined: set[Spec] = set()

    @property
    def late(self) -> bool:
        """The time is up."""
        return time.process_time() > self.end

    def run(self, progress: Callable[[Iterable[int]], Iterable[int]] = iter) -> bool:
        """Fit the models of the frontier into the pool, which has the laws alone already.

        Returns:
            Whether the search came to its own end.
        """
        fruitless, size = 0, 0
        self._transfer(self.models(0)[0], refining=True)
        for size in progress(range(1, self.most_effects + 1)):
            best = self.pool.best().score
            self._grow(size)
            self._exchange(size)
            gain = best - self.pool.best().score
            fruitless = 0 if gain > _WORTH * len(self.pool.impacts) else fruitless + 1
            if fruitless == _FRUITLESS or self.late:
                break
        self._place()
        for smaller in range(size - 1, 0, -1):
            for parent in self.models(smaller + 1)[:1]:
                self._fit(self._predicted(parent, _smaller))
                self._exchange(smaller)
        rigid = self.pool.best()
        for few in range(1, len(rigid.spec.effects) + 1):
            for model in self.models(few)[: not self.late]:
                self._transfer(model, refining=True)
        if self.pool.best() is not rigid:
            self.improve()
        return not self.late

    def _place(self) -> None:
        """Fit a law alone with each effect that has a place, such as a threshold, if the best model leaves outliers.

        About a law that lacks such an effect, linearisations and values at a few places may all be misled.
        """
        best = self.pool.best()
        if best.fit.outliers < _OUTLIERS * len(self.pool.impacts):
            return
        for key, effect in self.pool.candidates.items():
            if self.late:
                return
            if not effect.refines and any(parameter.vanishing is None for parameter in effect.parameters):
                self.pool.all_fitted({Spec(best.spec.law, frozenset({key})): None})
        if self.pool.best() is not best:
            self.improve()

    def improve(self) -> None:
        """Follow the exchanges, additions and deletions that promise a better model than the best of the pool."""
        tried: set[Spec] = set()
        while not self.late and (best := self.pool.best()).spec not in tried:
            tried.add(best.spec)
            room = len(best.spec.effects) < self.most_effects
            for neighbours in (*((_larger,) if room else ()), _exchanged, _smaller):
                self._fit(self._predicted(best, neighbours), best.score)

    def exchange_all(self, model: ScoredFit, worthwhile: float, most: int) -> None:
        """Fit exchanges of one effect of a model that may be better than a score, and its effects around other laws."""
        if model.spec.effects:
            self._fit(self._predicted(model, _exchanged), worthwhile, most)
        self._transfer(model)
        self._transfer(model, refining=True)

    def models(self, size: int) -> list[ScoredFit]:
        """Return the models with so many effects, the best first."""
        return sorted((m for m in self.pool.models.values() if len(m.spec.effects) == size), key=lambda m: m.score)

    def _grow(self, size: int) -> None:
        """Fit models of a size from those with one effect less: of each law alone, later of the best.

        About a law alone that is far off, linearisations say little: the effect that promises most is fitted.
        """
        parents = self.models(size - 1) if size == 1 else self._beam(size - 1)
        self._approximate(parents)
        each = [self._predicted(parent, _larger) for parent in parents]
        near = min((parent.score for parent in parents), default=0.0)
        margin = HOPELESS * len(self.pool.impacts)
        for parent, proposals in zip(parents, each, strict=True):
            gains = proposals and size == 1 and proposals[0].score < parent.score - margin
            self._fit(proposals[:1], math.inf if gains else near + margin, most=1)
        self._fit(sorted(chain.from_iterable(each), key=lambda proposal: proposal.score))
        if parents:
            self._localise(min(parents, key=lambda parent: parent.score))

    def _beam(self, size: int) -> list[ScoredFit]:
        """Models of a size to grow from, of several laws, and one alone of laws that agree about the same effects."""
        models, taken = self.models(size), []
        for model in models:
            same_law = [other for other in taken if other.spec.law == model.spec.law]
            same_effects = [other for other in taken if other.spec.effects == model.spec.effects]
            agree = any(model.score < other.score + _SAME for other in same_effects)
            hopeless = model.score > models[0].score + HOPELESS * len(self.pool.impacts)
            if not agree and not hopeless and len(same_law) < _OF_A_LAW and len(taken) < _BEAM:
                taken.append(model)
        return taken

    def _exchange(self, size: int) -> None:
        """Fit neighbours of the best models of a size, and the same effects around other laws."""
        tried: set[Spec] = set()
        while not self.late and (models := self.models(size)) and (best := models[0]).spec not in tried:
            tried.add(best.spec)
            if size > 1:
                self._fit(self._predicted(best, _exchanged, _PASSES), best.score)
            if self.models(size)[0] is best:
                for model in self._beam(size) if size <= _FEW else (best,):
                    self._refine(model)
                self._transfer(best)

    def _localise(self, model: ScoredFit) -> None:
        """Add to a model the forms with a place that promise most, to which a linearisation about nothing is blind."""
        pool, projection, starts = self.pool, None, dict[Spec, Tensor]()
        for key, effect in pool.candidates.items():
            if effect.refines and projects(effect) and key.name not in model.spec.families and not self.late:
                projection = projection or Projection(pool, model)
                if (spec := projection.larger(key)) not in pool.models:
                    starts[spec] = projection.starts(key)
        scored = sorted(self._best_of(starts).items(), key=lambda item: item[1][0])
        pool.all_fitted({spec: best for spec, (score, best) in scored[:_FITTED] if score < model.score})

    def _refine(self, model: ScoredFit) -> None:
        """Fit other forms of a model's effects that are promising at some values of their parameters."""
        if model.spec in self.refined:
            return
        self.refined.add(model.spec)
        worthwhile = self.pool.score_at(model.spec, model.fit.values) + _DOUBT * len(self.pool.impacts)
        tried: dict[Spec, Tensor] = {}
        for effect, other in self.pool.siblings(model.spec):
            spec = Spec(model.spec.law, model.spec.effects - {effect} | {other})
            if spec not in self.pool.models and not self.late:
                points = [self.pool.start(spec, model, {other: point}) for point in self.pool.spread(other, _TRIED)]
                tried[spec] = torch.stack([*points, *Projection(self.pool, model, effect).starts(other)])
        shifted = {spec: _shifted(best) for spec, (_, best) in self._best_of(tried, _EVERY).items()}
        scored = self._best_of(shifted).items()
        self.pool.all_fitted({spec: best for spec, (score, best) in scored if score < worthwhile})

    def _transfer(self, model: ScoredFit, refining: bool = False) -> None:
        """Fit the effects of a model around the other laws that are not hopeless at its own parameters.

        Those that refine others are tried apart, and must do better than the model at one of a few ε.
        """
        pool, values = self.pool, model.fit.values
        score, tried = pool.score_at(model.spec, values), _shifted(values) if refining else values[None]
        worthwhile = score if refining else score + HOPELESS * len(pool.impacts)
        others = [model.spec.with_law(name) for name, law in pool.laws.items() if law.refines is refining]
        new, starts = [spec for spec in others if spec not in pool.models], dict[Spec, Tensor | None]()
        for spec, scores in zip(new, pool.scores_at(dict.fromkeys(new, tried)), strict=True):
            if abs(scores[0] - score) < _IDENTICAL:
                pool.adopt(spec.law, model)
            elif min(scores) < worthwhile:
                starts[spec] = tried[scores.index(min(scores))] if spec.effects or not refining else None
        pool.all_fitted(starts)

    def _best_of(
        self, tried: Mapping[Spec, Float[Tensor, "c k"]], every: int = 1
    ) -> dict[Spec, tuple[float, Float[Tensor, " k"]]]:
        """Return the least score of each model at some values, on every so-manyth trial, and these values."""
        scores = zip(tried, self.pool.scores_at(tried, every), strict=True)
        return {spec: (min(each), tried[spec][each.index(min(each))]) for spec, each in scores}

    def _predicted(self, model: ScoredFit, neighbours: Neighbours, passes: int = 1) -> list[Proposal]:
        """Neighbours of a model that have not been fitted, and neighbours of the best of them, by predicted scores."""
        self._approximate([model])
        quadratic = self.quadratics[model.spec]
        groups = [group for group in quadratic.groups if group.effect is not None]
        offset = model.score - quadratic.losses([quadratic.present])[0].item() - self.pool.penalty(model.spec.effects)
        seen: dict[frozenset[Group], float] = {}
        present = quadratic.present
        for _ in range(passes):
            sets = [subset for subset in neighbours(present, groups) if subset not in seen]
            losses = quadratic.losses(sets)[0].tolist() if sets else []
            for subset, loss in zip(sets, losses, strict=True):
                seen[subset] = offset + loss + self.pool.penalty(identities(subset))
            best = min(seen, key=seen.__getitem__, default=present)
            if best == present:
                break
            present = best
        proposals = (Proposal(model, quadratic, subset, score) for subset, score in seen.items())
        return sorted(proposals, key=lambda proposal: proposal.score)

    def _approximate(self, models: Sequence[ScoredFit]) -> None:
        """Approximate the losses about models that have not been."""
        new = {model.spec: model for model in models if model.spec not in self.quadratics}
        self.quadratics |= zip(new, self.pool.quadratics(new.values()), strict=True)

    def _fit(self, proposals: Sequence[Proposal], worthwhile: float = math.inf, most: int = _FITTED) -> None:
        """Fit the most promising proposals of those that may be better than a score."""
        promising = self._promising(proposals, worthwhile, most)
        self.pool.all_fitted({proposal.spec: proposal.start(self.pool) for proposal in promising})

    def _promising(self, proposals: Sequence[Proposal], worthwhile: float, most: int) -> list[Proposal]:
        """The first proposals, of models that have not been fitted, that may be better than a score."""
        limit, promising = worthwhile + _DOUBT * len(self.pool.impacts), dict[Spec, Proposal]()
        for proposal in proposals:
            if len(promising) == most or self.late or proposal.score > limit:
                break
            if proposal.spec not in self.pool.models:
                promising.setdefault(proposal.spec, proposal)
        return list(promising.values())


def _shifted(values: Float[Tensor, " k"]) -> Float[Tensor, "c k"]:
    """Return values of a model with ε changed a little, which others of its parameters would follow."""
    tried = values.repeat(len(_SHIFTS), 1)
    tried[:, 1] += torch.tensor(_SHIFTS, dtype=values.dtype)
    return tried


def _larger(present: frozenset[Group], groups: Sequence[Group]) -> Iterator[frozenset[Group]]:
    """Sets with one effect more, of a family that is not there yet."""
    families = {group.effect.name for group in present if group.effect is not None}
    yield from (present | {group} for group in groups if group.effect is not None and group.effect.name not in families)


def _smaller(present: frozenset[Group], _: Sequence[Group]) -> Iterator[frozenset[Group]]:
    """Sets with one effect less."""
    yield from (present - {group} for group in present)


def _exchanged(present: frozenset[Group], groups: Sequence[Group]) -> Iterator[frozenset[Group]]:
    """Sets with one effect exchanged, also for another form of its own family."""
    for less in _smaller(present, groups):
        yield from _larger(less, groups)
