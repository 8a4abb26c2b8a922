"""Pool of models, laws with sets of effects, each fitted once and scored by the extended Bayesian criterion.

    score = loss + ½ K log n + log C(F, s)        nats; the less the better

with the minimised robust loss over n trials, K fitted parameters, and s effects out of F families: the last term is the
prior that makes all sizes equally likely, so that a large catalogue raises no false alarms.
Sources: Schwarz 1978; Chen & Chen 2008.
"""

import math
from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.diagnosis.search.quadratic import Group, Quadratic, vanishing
from contactlearn.effects import Effect, EffectId, columns
from contactlearn.inference.identification import joint
from contactlearn.inference.identification.joint import Fit, FitOptions, assemble
from contactlearn.inference.identification.robust import robust_distance
from contactlearn.inference.validation import Folds, robust_covariance
from contactlearn.laws import Law
from contactlearn.mechanics.impacts import Impacts, Prediction

_STARTS = 4
_TOLERANCE = 3e-4  # nats a trial; scores differ by nats over all trials
_ALIKE = 0.01  # nats: models whose scores differ by less differ by what the fits leave open


@dataclass(frozen=True)
class Spec:
    """A model by the name of its law and the identities of its effects beside the given ones."""

    law: str
    effects: frozenset[EffectId] = frozenset()

    @property
    def families(self) -> frozenset[str]:
        """Names of the effects without their forms."""
        return frozenset(effect.name for effect in self.effects)

    def with_law(self, law: str) -> "Spec":
        """Return the same effects around another law."""
        return replace(self, law=law)


@dataclass(frozen=True)
class ScoredFit:
    """A model fitted to all trials, `effects` by name in the order of its parameters, and its score in nats."""

    spec: Spec
    effects: Mapping[str, Effect]
    fit: Fit
    score: float

    @cached_property
    def values(self) -> dict[EffectId, Float[Tensor, " k"]]:
        """Fitted values of each effect, given ones among them."""
        counts = [len(effect.parameters) for effect in self.effects.values()]
        parts = self.fit.values[2:].split(counts) if counts else ()
        return {EffectId(name, e.form): x for (name, e), x in zip(self.effects.items(), parts, strict=True)}


class Pool:
    """Models of one question around several laws.

    Args:
        laws: by name.
        impacts: measurements.
        candidates: effects that may be missing, by identity; prepared for the impacts.
        given: effects that are in every model, by name.
        options: of all fits.

    Attributes:
        models: fitted so far.
        predicted: all trials by the fits of folds, by these and the model.
    """

    def __init__(
        self,
        laws: Mapping[str, Law],
        impacts: Impacts,
        candidates: Mapping[EffectId, Effect],
        given: Mapping[str, Effect],
        options: FitOptions,
    ) -> None:
        self.laws, self.impacts, self.given, self.options = dict(laws), impacts, dict(given), options
        self.candidates = {key: effect for key, effect in candidates.items() if key.name not in self.given}
        self._vanishing = vanishing(self.candidates, impacts)
        self.families = len({key.name for key in self.candidates})
        self.models: dict[Spec, ScoredFit] = {}
        self.predicted: dict[tuple[Folds, Spec], Prediction] = {}

    def effects(self, spec: Spec) -> dict[str, Effect]:
        """Return the effects of a model by name, the given ones first and the others in the order of the candidates."""
        return self.given | {key.name: effect for key, effect in self.candidates.items() if key in spec.effects}

    def fitted(self, spec: Spec, start: Float[Tensor, " k"] | None = None) -> ScoredFit:
        """Return a model, fitted from a start, or by a search if there is none, unless it was fitted before."""
        return self.all_fitted({spec: start})[0]

    def all_fitted(self, starts: Mapping[Spec, Float[Tensor, " k"] | None]) -> list[ScoredFit]:
        """Return models, each fitted from its start likewise."""
        options = replace(self.options, starts=_STARTS, tolerance=_TOLERANCE, standard_errors=False)
        fit = partial(joint.fit, self.impacts, options=options)
        new = {spec: start for spec, start in starts.items() if spec not in self.models}
        for spec, start in new.items():
            self.models[spec] = self._scored(spec, fit(self.laws[spec.law], self.effects(spec), start=start))
        return [self.models[spec] for spec in starts]

    def _scored(self, spec: Spec, fit: Fit) -> ScoredFit:
        effects = self.effects(spec)
        return ScoredFit(spec, effects, fit, self.score(spec, effects, fit.loss.item()))

    def adopt(self, law: str, model: ScoredFit) -> None:
        """Take the fit of a model for that of its effects around another law, which predicts the same at its values."""
        fit, spec = model.fit, model.spec.with_law(law)
        same = assemble(self.laws[law], model.effects, fit.values, fit.model.parameter_covariance)
        self.models[spec] = replace(model, spec=spec, fit=replace(fit, model=same))

    def polished(self, *specs: Spec) -> list[ScoredFit]:
        """Return models of the pool after fits to the full tolerance, from which standard errors are taken."""
        refit = partial(joint.fit, self.impacts, options=self.options)
        models = [self.models[spec] for spec in specs]
        fits = [refit(self.laws[model.spec.law], model.effects, start=model.fit.values) for model in models]
        self.models |= {spec: self._scored(spec, fit) for spec, fit in zip(specs, fits, strict=True)}
        return [self.models[spec] for spec in specs]

    def score(self, spec: Spec, effects: Mapping[str, Effect], loss: float) -> float:
        """Compute the score from a loss in nats a trial."""
        trials = len(self.impacts)
        return trials * loss + self._penalty(2 + sum(len(e.parameters) for e in effects.values()), len(spec.effects))

    def score_at(self, spec: Spec, values: Float[Tensor, " k"]) -> float:
        """Compute the score of a model at some values without a fit; to be compared with others of these alone."""
        return self.scores_at({spec: values[None]})[0][0]

    def scores_at(self, tried: Mapping[Spec, Float[Tensor, "c k"]], every: int = 1) -> list[list[float]]:
        """Compute the same of models at several values each, with the mean loss of every so-manyth trial."""
        impacts, scores = self.impacts[::every], list[list[float]]()
        for spec, values in tried.items():
            effects = self.effects(spec)
            losses = _losses_at(impacts, self.laws[spec.law], effects, values)
            scores.append([self.score(spec, effects, loss) for loss in losses])
        return scores

    def siblings(self, spec: Spec) -> list[tuple[EffectId, EffectId]]:
        """List each effect of a model with the other forms of its family, and those that refine it.

        A model has one form of a family.
        """
        return [
            (effect, other)
            for effect in sorted(spec.effects)
            for other in self.candidates
            if other not in spec.effects
            and effect.name in (other.name, *self.candidates[other].refines)
            and other.name not in Spec(spec.law, spec.effects - {effect}).families
        ]

    def spread(self, effect: EffectId, count: int) -> Float[Tensor, "c k"]:
        """Return values of the parameters of a candidate that fill their ranges evenly."""
        low, high = torch.tensor([(p.low, p.high) for p in self.candidates[effect].parameters], dtype=torch.float64).T
        sobol = torch.quasirandom.SobolEngine(len(low), scramble=True, seed=0)
        return low + (high - low) * sobol.draw(count, dtype=torch.float64)

    def penalty(self, effects: frozenset[EffectId]) -> float:
        """Compute the penalty of a set of effects, in nats."""
        given = sum(len(effect.parameters) for effect in self.given.values())
        added = sum(len(self.candidates[key].parameters) for key in effects)
        return self._penalty(2 + given + added, len(effects))

    def best(self, models: Iterable[ScoredFit] | None = None) -> ScoredFit:
        """Return the model with the least score, of all or of some; laws that do as well in the order of the question.

        Laws predict the same where contacts slide throughout: roundings would choose between them.
        """
        some = [*(self.models.values() if models is None else models)]
        best, laws = min(some, key=lambda model: model.score), [*self.laws]
        alike = [m for m in some if m.spec.effects == best.spec.effects and m.score <= best.score + _ALIKE]
        return min(alike, key=lambda model: laws.index(model.spec.law))

    def best_of_sizes(self, sizes: Container[int]) -> ScoredFit:
        """Return the best model with so many effects."""
        return self.best(model for model in self.models.values() if len(model.spec.effects) in sizes)

    def quadratics(self, models: Iterable[ScoredFit]) -> list[Quadratic]:
        """Approximate the losses about models."""
        about = partial(
            Quadratic.about,
            impacts=self.impacts,
            given=tuple(self.given),
            candidates=self._vanishing,
            options=self.options,
        )
        return [about(self.laws[model.spec.law], model.effects, model.fit) for model in models]

    def start(self, spec: Spec, about: ScoredFit, values: Mapping[EffectId, Float[Tensor, " k"]]) -> Tensor:
        """Return values to fit a model from: those given, else those of another model, else the effects' own."""
        known = {**about.values, **values}
        parts = (known.get(EffectId(name, e.form), columns(*e.values)) for name, e in self.effects(spec).items())
        return torch.cat((about.fit.values[:2], *parts))

    def _penalty(self, parameters: int, effects: int) -> float:
        return parameters / 2 * math.log(len(self.impacts)) + math.log(math.comb(self.families, effects))


def _losses_at(impacts: Impacts, law: Law, effects: Mapping[str, Effect], values: Float[Tensor, "c k"]) -> list[float]:
    """Losses of a model at some values, nats a trial."""
    residual = impacts.residual(assemble(law, effects, values).predict(impacts).v_post)
    scatter = robust_covariance(residual)
    loss = robust_distance(residual, scatter).mean(-1) + 0.5 * scatter.logdet()
    return loss.nan_to_num(math.inf).tolist()


def identities(groups: frozenset[Group]) -> frozenset[EffectId]:
    """Return the effects of some groups of parameters."""
    return frozenset(group.effect for group in groups if group.effect is not None)
