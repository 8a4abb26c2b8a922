"""From sessions to data, fits, held-out errors and ladders; everything is cached by configuration and data hash.

A model is fitted to the training part of the data, law and effects together, as `evaluate` fits it, and its error is
that of the held-out trials.  The fit is a function of the session alone, so a link shows the same numbers to everyone.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Lock

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn import laws
from contactlearn.cli.commands.loading import Split, load_data, split
from contactlearn.cli.hydra_main import compose
from contactlearn.cli.settings import EvaluateSettings, SourceSettings
from contactlearn.core.errors import ContactLearnError, UnknownNameError
from contactlearn.diagnosis.error_budget import NoiseFloor, noise_floor
from contactlearn.diagnosis.search.candidates import SEARCHED_LAWS
from contactlearn.effects import Effect, find_effect, from_settings
from contactlearn.inference.evaluation import bounds
from contactlearn.inference.evaluation.metrics import Interval, bootstrap, mass_error
from contactlearn.inference.identification.joint import FitOptions, JointFit, assemble, identify_jointly
from contactlearn.laws import Law
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.models.contact_model import ContactModel
from contactlearn.results.evaluation import BEST_POST_HOC, IRB
from contactlearn.workbench.cache import Cache
from contactlearn.workbench.lines import effect_of, name_of
from contactlearn.workbench.session import Session

STARTS = 4
"""Starts of each fit."""
_SOURCES, _FITS = 4, 100  # kept
_RESAMPLES = 1000
_NOISE_TRIALS = 600  # at most, from which the noise floor is estimated while one waits


@dataclass(frozen=True, kw_only=True, eq=False)
class Fitted:
    """A law with effects, fitted to the training part: the fit, v_post [N, 3] of all trials, errors held out [n]."""

    law: Law
    effects: Mapping[str, Effect]
    fit: JointFit
    v_post: Float[Tensor, "n 3"]
    errors: Float[Tensor, " m"]
    error: Interval

    @property
    def model(self) -> ContactModel:
        """The fitted model."""
        return self.fit.model


@dataclass(frozen=True, kw_only=True, eq=False)
class Moved:
    """A fitted model with some parameters moved by hand."""

    model: ContactModel
    values: Float[Tensor, " k"]
    v_post: Float[Tensor, "n 3"]
    error: Interval


@dataclass(frozen=True, kw_only=True)
class Compared:
    """The held-out error of a law, bound or model, by name."""

    name: str
    error: Interval


class Models:
    """The data and fits of all sessions."""

    def __init__(self) -> None:
        self._splits: Cache[Split] = Cache(_SOURCES)
        self._fits: Cache[Fitted] = Cache(_FITS)
        self._floors: Cache[NoiseFloor] = Cache(_FITS)
        self._hashes: Cache[str] = Cache(_SOURCES)
        self._composing = Lock()  # Hydra has one state for the whole process

    def split(self, session: Session) -> Split:
        """Return the data of a session, and their training and held-out parts.

        Raises:
            ContactLearnError: data that cannot be read, or are too few.
        """
        return self._splits.get((session.data, _stamp(session.data), session.seed), lambda: self._load(session))

    def suspected(self, session: Session) -> Impacts:
        """Return the data of a session though they may break the rules of impacts, for the audit.

        Raises:
            ContactLearnError: data that cannot be read at all.
        """
        with self._composing:
            cfg = compose("evaluate", list(session.data))
        return load_data(SourceSettings.from_config(cfg), validate=False)

    def fingerprint(self, session: Session) -> str:
        """Return the hash of the data of a session, and the body's shape, which the data alone do not have."""

        def known() -> str:
            impacts = self.split(session).impacts
            return f"{impacts.fingerprint()} {impacts.shape}"

        return self._hashes.get((session.data, _stamp(session.data)), known)

    def fitted(self, session: Session) -> Fitted:
        """Return the model of a session, fitted.

        Raises:
            UnknownNameError: no such law, effect or form.
            ContactLearnError: a line that cannot be read, or too few trials.
        """
        key = (self.fingerprint(session), session.seed, session.model)
        return self._fits.get(key, lambda: _fit(session, self.split(session)))

    def alone(self, session: Session, law: str | None = None) -> Fitted:
        """Return a law without effects, that of the session if none is named."""
        return self.fitted(replace(session, law=law or session.law, effects=(), lines=()))

    def values(self, session: Session) -> Float[Tensor, " k"]:
        """Return the parameters of the model of a session, those that were moved by hand where they were moved to.

        Raises:
            UnknownNameError: the model has no such parameter.
        """
        fit = self.fitted(session).fit
        values, names = fit.values.clone(), [p.name for p in fit.parameters]
        for name, value in session.hand:
            if name not in names:
                raise UnknownNameError("parameter of this model", name, names)
            values[names.index(name)] = value
        return values

    def moved(self, session: Session) -> Moved:
        """Return the model of a session with the parameters that were moved by hand.

        Raises:
            UnknownNameError: the model has no such parameter.
        """
        fitted, data, values = self.fitted(session), self.split(session), self.values(session)
        model = assemble(fitted.law, fitted.model.effects, values)
        errors = mass_error(data.test, model.predict(data.test))
        return Moved(model=model, values=values, v_post=model.predict(data.impacts).v_post, error=_interval(errors))

    def ladder(self, session: Session) -> list[Fitted]:
        """Return the law alone, then with one effect more each, in the order in which they were ticked."""
        steps = [replace(session, effects=session.effects[:k], lines=()) for k in range(len(session.effects) + 1)]
        steps += [replace(session, lines=session.lines[:k]) for k in range(1, len(session.lines) + 1)]
        return [self.fitted(step) for step in steps]

    def compared(self, session: Session) -> list[Compared]:
        """Return every law alone, the best of them after the fact, the rigid bound, and the model of the session."""
        data = self.split(session)
        names = dict.fromkeys((*SEARCHED_LAWS, session.law))
        alone = {name: self.alone(session, name) for name in names}
        found = [Compared(name=name, error=one.error) for name, one in alone.items()]
        best, _ = bounds.best_post_hoc(data.test, {name: one.model.predict(data.test) for name, one in alone.items()})
        for name, prediction in ((BEST_POST_HOC, best), (IRB, bounds.irb(data.test))):
            found.append(Compared(name=name, error=held_out(data.test, prediction)))
        return sorted(found, key=lambda one: -one.error.mean)

    def noise(self, session: Session) -> NoiseFloor:
        """Return the noise floor beneath the model of a session, from some hundred trials."""
        fitted, data = self.fitted(session), self.split(session)
        few = data.impacts[:_NOISE_TRIALS]
        key = (self.fingerprint(session), session.seed, session.model)
        return self._floors.get(
            key, lambda: noise_floor(few, fitted.model, generator=torch.Generator().manual_seed(session.seed))
        )

    def _load(self, session: Session) -> Split:
        with self._composing:
            cfg = compose("evaluate", [*session.data, f"seed={session.seed}", "train.size=2", "model=[]"])
        return split(EvaluateSettings.from_config(cfg).split)


def held_out(test: Impacts, prediction: Prediction) -> Interval:
    """Compute the mean mass error of held-out trials with its interval."""
    return _interval(mass_error(test, prediction))


def effects_of(session: Session) -> dict[str, Effect]:
    """Return the effects of a session by name: those that are ticked, then its lines.

    Raises:
        UnknownNameError: no such effect or form.
        ContactLearnError: a line that cannot be read, or an option that the effect does not have.
    """
    found: dict[str, Effect] = {}
    for one in session.effects:
        options = {option.name: option.setting for option in session.options if option.effect == one.name}
        found[one.name] = from_settings(find_effect(one.name, one.form), options)
    return found | {name_of(k): effect_of(line) for k, line in enumerate(session.lines)}


def _fit(session: Session, data: Split) -> Fitted:
    law, effects = laws.find(session.law), effects_of(session)
    fit = identify_jointly(law, effects, data.pool, options=FitOptions(starts=STARTS))
    errors = mass_error(data.test, fit.model.predict(data.test))
    if not errors.isfinite().all():
        raise ContactLearnError(f"{fit.model} has errors that are not finite on held-out trials; leave an effect out")
    v_post = fit.model.predict(data.impacts).v_post
    return Fitted(law=law, effects=fit.model.effects, fit=fit, v_post=v_post, errors=errors, error=_interval(errors))


def _interval(errors: Float[Tensor, " m"]) -> Interval:
    return bootstrap(errors, torch.Generator().manual_seed(0), _RESAMPLES)


def _stamp(words: tuple[str, ...]) -> tuple[tuple[int, int], ...]:
    """Time and size of the files that the words of a session name, so that a changed file is read again."""
    paths = [Path(word.partition("=")[2].strip("\"'")) for word in words if word.startswith("data.path=")]
    return tuple((os.stat(path).st_mtime_ns, os.stat(path).st_size) for path in paths if path.exists())
