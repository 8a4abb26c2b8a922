"""From sessions to data, fits, held-out errors, ladders and predicted gains, cached by configuration and data hash.

A model is fitted to the training part of the data, law and effects together, as `evaluate` fits it, and its error is
that of the held-out trials.  The fit is a function of the session alone, so a link shows the same numbers to everyone.

The gain of an effect that the model lacks is predicted before it is fitted: the model is linearised with all candidates
around it (`diagnosis.search.quadratic`), the best step of all parameters follows from sums of products, and the model
at this step is evaluated on the held-out trials.  A strongly non-linear effect does better or worse once it is fitted.
"""

import math
import os
from collections import OrderedDict
from collections.abc import Callable, Hashable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Lock
from typing import Generic, TypeVar

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn import laws
from contactlearn.cli.commands.loading import Split, load_data, split
from contactlearn.cli.hydra_main import compose
from contactlearn.cli.settings import EvaluateSettings, SourceSettings
from contactlearn.core.errors import ContactLearnError, UnknownNameError
from contactlearn.diagnosis.error_budget import NoiseFloor, noise_floor
from contactlearn.diagnosis.regions import find_regions
from contactlearn.diagnosis.result import Region
from contactlearn.diagnosis.search.candidates import SEARCHED_LAWS, all_candidates, usable
from contactlearn.diagnosis.search.quadratic import Group, Quadratic, vanishing
from contactlearn.effects import Effect, EffectId, find_effect, from_settings
from contactlearn.inference.evaluation import bounds
from contactlearn.inference.evaluation.metrics import Interval, bootstrap, mass_error
from contactlearn.inference.identification import joint
from contactlearn.inference.identification.joint import Fit, FitOptions, assemble
from contactlearn.laws import Law
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.models.contact_model import ContactModel
from contactlearn.results.types import BEST_POST_HOC, IRB
from contactlearn.workbench.lines import line_name, parse_effect
from contactlearn.workbench.session import Session

STARTS = 4
"""Starts of each fit."""
_SOURCES, _RESULTS = 4, 100  # capacities of the caches
_RESAMPLES = 1000
_NOISE_TRIALS = 600  # at most, for the noise floor
_MOST_EFFECTS = 6  # of the best model that the noise floor is estimated with
_LEAST_FALL = 0.02  # of its error, by each of them
_LINEARISED_TRIALS = 4000  # at most
_Value = TypeVar("_Value")


class Cache(Generic[_Value]):
    """Results by key, each computed once though several threads ask for it; the least recently used are dropped.

    Args:
        capacity: largest number of results.
    """

    def __init__(self, capacity: int) -> None:
        self.capacity = capacity
        self._futures: OrderedDict[Hashable, Future[_Value]] = OrderedDict()
        self._lock = Lock()

    def __len__(self) -> int:
        return len(self._futures)

    def get(self, key: Hashable, compute: Callable[[], _Value]) -> _Value:
        """Return the result of a key; compute it if it is not cached.

        An error is raised in all threads that wait for it, and is not cached.
        """
        with self._lock:
            known = self._futures.get(key)
            future: Future[_Value] = Future() if known is None else known
            self._futures[key] = future
            self._futures.move_to_end(key)
            while len(self._futures) > self.capacity:
                self._futures.popitem(last=False)
        if known is not None:
            return known.result()
        try:
            future.set_result(compute())
        except BaseException as error:
            with self._lock:
                if self._futures.get(key) is future:
                    del self._futures[key]
            future.set_exception(error)
            raise
        return future.result()


@dataclass(frozen=True, kw_only=True, eq=False)
class FittedModel:
    """A law with effects, fitted to the training part.

    Args:
        law: as it was before the fit.
        effects: prepared for the data.
        fit: of law and effects together.
        v_post: predicted velocities of all trials.
        error: mean mass error of the held-out trials.
    """

    law: Law
    effects: Mapping[str, Effect]
    fit: Fit
    v_post: Float[Tensor, "n 3"]
    error: Interval

    @property
    def model(self) -> ContactModel:
        """The fitted model."""
        return self.fit.model


@dataclass(frozen=True, kw_only=True, eq=False)
class ManualModel:
    """A fitted model with some parameter values set by hand, otherwise as `FittedModel`."""

    model: ContactModel
    values: Float[Tensor, " k"]
    v_post: Float[Tensor, "n 3"]
    error: Interval


@dataclass(frozen=True, kw_only=True)
class PredictedGain:
    """Gain that an effect would bring.

    Args:
        effect: its identity.
        gain: decrease of the loss in nats over all training trials, less the penalty of its parameters.
        error: held-out error at the linear step.
    """

    effect: EffectId
    gain: float
    error: float


class Models:
    """The data, fits and errors of all sessions."""

    def __init__(self) -> None:
        self._splits: Cache[Split] = Cache(_SOURCES)
        self._hashes: Cache[str] = Cache(_SOURCES)
        self._fits: Cache[FittedModel] = Cache(_RESULTS)
        self._floors: Cache[NoiseFloor] = Cache(_RESULTS)
        self._candidates: Cache[dict[EffectId, Effect]] = Cache(_SOURCES)
        self._gains: Cache[tuple[PredictedGain, ...]] = Cache(_RESULTS)
        self._best: Cache[FittedModel] = Cache(_SOURCES)
        self._regions: Cache[tuple[Region, ...]] = Cache(_RESULTS)
        self._composing = Lock()  # Hydra has one state for the whole process

    def split(self, session: Session) -> Split:
        """Return the data of a session, and their training and held-out parts.

        Raises:
            ContactLearnError: data that cannot be read, or too few trials.
        """

        def load() -> Split:
            with self._composing:
                seeds = (f"{name}={session.seed}" for name in ("seed", "split_seed"))
                cfg = compose("evaluate", [*session.data, *seeds, "train.size=2", "model=[]"])
            return split(EvaluateSettings.from_config(cfg))

        return self._splits.get((session.data, _file_stamps(session.data), session.seed), load)

    def unvalidated(self, session: Session) -> Impacts:
        """Return the data of a session, which may break the rules of impacts, for the audit.

        Raises:
            ContactLearnError: data that cannot be read at all.
        """
        with self._composing:
            cfg = compose("evaluate", list(session.data))
        return load_data(SourceSettings.from_config(cfg), validate=False).impacts

    def fingerprint(self, session: Session) -> str:
        """Return the hash of the data of a session with the shapes of its bodies."""

        def compute() -> str:
            impacts = self.split(session).impacts
            return f"{impacts.fingerprint()} {impacts.shape}"

        return self._hashes.get((session.data, _file_stamps(session.data)), compute)

    def _key(self, session: Session) -> tuple[object, ...]:
        return self.fingerprint(session), session.seed, session.model

    def fitted(self, session: Session) -> FittedModel:
        """Return the fitted model of a session.

        Raises:
            UnknownNameError: no such law, effect or form.
            ContactLearnError: a line that cannot be read, an option that an effect does not have, or too few trials.
        """
        return self._fits.get(self._key(session), lambda: _fit(session, self.split(session)))

    def laws(self, session: Session) -> list[str]:
        """Return the names of the laws that exist where the bodies of a session move, and that of its own."""
        space = self.split(session).impacts.space
        return [*dict.fromkeys((*(name for name in SEARCHED_LAWS if space in laws.find(name).spaces), session.law))]

    def law_alone(self, session: Session, law: str | None = None) -> FittedModel:
        """Return a law without effects; the law of the session if None."""
        return self.fitted(replace(session, law=law or session.law, effects=(), lines=()))

    def values(self, session: Session) -> Float[Tensor, " k"]:
        """Return the parameter values of a session: fitted, or set by hand.

        Raises:
            UnknownNameError: the model has no such parameter.
        """
        fit = self.fitted(session).fit
        values, names = fit.values.clone(), [p.name for p in fit.parameters]
        for name, value in session.manual:
            if name not in names:
                raise UnknownNameError("parameter of this model", name, names)
            values[names.index(name)] = value
        return values

    def manual(self, session: Session) -> ManualModel:
        """Return the model of a session with the values that are set by hand.

        Raises:
            UnknownNameError: the model has no such parameter.
        """
        fitted, data, values = self.fitted(session), self.split(session), self.values(session)
        model = assemble(fitted.law, fitted.model.effects, values)
        error = mean_error(data.test, model.predict(data.test))
        return ManualModel(model=model, values=values, v_post=model.predict(data.impacts).v_post, error=error)

    def ladder(self, session: Session) -> list[FittedModel]:
        """Return the law alone, then the models with one more effect each, in the order of the session."""
        steps = [replace(session, effects=session.effects[:k], lines=()) for k in range(len(session.effects) + 1)]
        steps += [replace(session, lines=session.lines[:k]) for k in range(1, len(session.lines) + 1)]
        return [self.fitted(step) for step in steps]

    def comparison(self, session: Session) -> dict[str, Interval]:
        """Return the held-out errors of each law alone, of Best Post Hoc and of the rigid bound, the largest first."""
        test = self.split(session).test
        fits = {name: self.law_alone(session, name) for name in self.laws(session)}
        best, _ = bounds.best_post_hoc(test, {name: fit.model.predict(test) for name, fit in fits.items()})
        errors = {name: fit.error for name, fit in fits.items()}
        errors |= {BEST_POST_HOC: mean_error(test, best), IRB: mean_error(test, bounds.irb(test))}
        return dict(sorted(errors.items(), key=lambda pair: -pair[1].mean))

    def best(self, session: Session) -> FittedModel:
        """Return the best model that is found effect by effect from the best law, whatever the session has ticked."""
        return self._best.get(self._key(session)[:2], lambda: self._climb(session))

    def best_law(self, session: Session) -> FittedModel:
        """Return the law alone with the smallest held-out error."""
        alone = replace(session, options=(), manual=())
        return min((self.law_alone(alone, name) for name in self.laws(alone)), key=_mean)

    def _climb(self, session: Session) -> FittedModel:
        best = self.best_law(session)
        found = replace(session, law=best.law.name, effects=(), lines=(), options=(), manual=())
        for _ in range(_MOST_EFFECTS):
            gains = [one for one in self.predicted_gains(found) if one.gain > 0]
            if not gains:
                break
            longer = found.with_effect(min(gains, key=lambda one: one.error).effect)
            if _mean(fitted := self.fitted(longer)) > (1 - _LEAST_FALL) * _mean(best):
                break
            found, best = longer, fitted
        return best

    def noise_floor(self, session: Session) -> NoiseFloor:
        """Return the noise floor of the best model, from some hundred trials: the same whatever is ticked."""
        impacts, generator = self.split(session).impacts[:_NOISE_TRIALS], torch.Generator().manual_seed(session.seed)
        return self._floors.get(
            self._key(session)[:2], lambda: noise_floor(impacts, self.best(session).model, generator=generator)
        )

    def regions(self, session: Session) -> tuple[Region, ...]:
        """Return the regions in which the model of a session fails."""
        impacts, fitted = self.split(session).impacts, self.fitted(session)
        generator = torch.Generator().manual_seed(session.seed)
        return self._regions.get(
            self._key(session), lambda: find_regions(impacts, fitted.model.predict(impacts), generator=generator)
        )

    def predicted_gains(self, session: Session) -> tuple[PredictedGain, ...]:
        """Return the predicted gains of the effects that the model of a session lacks, the largest first."""
        data, fitted, key = self.split(session), self.fitted(session), self._key(session)
        candidates = self._candidates.get(
            key[:2],
            lambda: {
                one: effect.prepare(data.pool)
                for one, effect in usable(all_candidates(data.pool.space), data.pool).items()
            },
        )
        return self._gains.get(key, lambda: _predicted_gains(fitted, candidates, data))


def _mean(fitted: FittedModel) -> float:
    return fitted.error.mean


def mean_error(test: Impacts, prediction: Prediction) -> Interval:
    """Return the mean mass error of held-out trials with its interval."""
    return bootstrap(mass_error(test, prediction), torch.Generator().manual_seed(0), _RESAMPLES)


def _fit(session: Session, data: Split) -> FittedModel:
    law, effects = laws.find(session.law), dict[str, Effect]()
    for effect in session.effects:
        options = {option.name: option.setting for option in session.options if option.effect == effect.name}
        effects[effect.name] = from_settings(find_effect(effect.name, effect.form), options)
    effects |= {line_name(k): parse_effect(line) for k, line in enumerate(session.lines)}
    fit = joint.fit(data.pool, law, effects, options=FitOptions(starts=STARTS))
    prediction = fit.model.predict(data.test)
    if not mass_error(data.test, prediction).isfinite().all():
        raise ContactLearnError(f"{fit.model} has errors that are not finite on held-out trials; leave an effect out")
    v_post, error = fit.model.predict(data.impacts).v_post, mean_error(data.test, prediction)
    return FittedModel(law=law, effects=fit.model.effects, fit=fit, v_post=v_post, error=error)


def _file_stamps(words: tuple[str, ...]) -> tuple[tuple[int, int], ...]:
    """Return time and size of the files in the words of a session, so that a changed file is read again."""
    paths = [Path(word.partition("=")[2].strip("\"'")) for word in words if word.startswith("data.path=")]
    return tuple((os.stat(path).st_mtime_ns, os.stat(path).st_size) for path in paths if path.exists())


def _predicted_gains(
    fitted: FittedModel, candidates: Mapping[EffectId, Effect], data: Split
) -> tuple[PredictedGain, ...]:
    others = {key: effect for key, effect in candidates.items() if key.name not in fitted.effects}
    impacts = data.pool[:_LINEARISED_TRIALS]
    quadratic = Quadratic.about(
        fitted.law,
        fitted.effects,
        fitted.fit,
        impacts,
        given=tuple(fitted.effects),
        candidates=vanishing(others, impacts),
        options=FitOptions(starts=STARTS),
    )
    groups = [group for group in quadratic.groups if group.effect is not None]
    if not groups:
        return ()
    losses, theta = quadratic.losses([frozenset[Group](), *(frozenset({group}) for group in groups)])
    best: dict[EffectId, tuple[float, Float[Tensor, " q"], Group]] = {}
    for group, decrease, values in zip(groups, (losses[0] - losses[1:]).tolist(), theta[1:], strict=True):
        assert group.effect is not None  # only the group of all models has none
        gain = decrease - len(quadratic.groups[group]) / 2 * math.log(quadratic.trials)
        if group.effect not in best or gain > best[group.effect][0]:
            best[group.effect] = gain, values, group
    gains: list[PredictedGain] = []
    for key, (gain, values, group) in best.items():
        columns = [*quadratic.groups[Group(None)], *quadratic.groups[group]]
        model = assemble(fitted.law, {**fitted.effects, "new": others[key]}, values[columns])
        with torch.no_grad():
            error = mass_error(data.test, model.predict(data.test)).mean().item()
        gains.append(PredictedGain(effect=key, gain=gain, error=error))
    return tuple(sorted(gains, key=lambda one: -one.gain))
