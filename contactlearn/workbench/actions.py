"""What each control does: a session, the name behind the control and its value to another session.

An action is named by its kind; those of `ticks`, `form`, `option`, `slider`, `picked` and `boxed` come with a value.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import torch

from contactlearn import laws
from contactlearn.core.errors import ContactLearnError
from contactlearn.diagnosis.failure.regions import find_regions
from contactlearn.diagnosis.failure.variables import variables
from contactlearn.diagnosis.result import Region
from contactlearn.effects import EffectId, find_effect
from contactlearn.inference.evaluation.metrics import mass_error
from contactlearn.mechanics.impacts import Prediction
from contactlearn.workbench.cache import Cache
from contactlearn.workbench.lines import effect_of
from contactlearn.workbench.models import Models
from contactlearn.workbench.promises import Promises
from contactlearn.workbench.session import Session, Window

_CLOSE = 1e-9  # of a slider's value: what it was set to itself
_KEPT = 50


@dataclass(frozen=True, kw_only=True)
class Actions:
    """The controls of the page; `kinds` lists them."""

    models: Models
    promises: Promises
    regions_found: Cache[tuple[Region, ...]]

    @property
    def kinds(self) -> Mapping[str, Callable[[Session, str, Any], Session]]:
        """Every action by the kind of its control."""
        return {
            "ticks": self.tick,
            "law": lambda session, name, _: replace(session, law=laws.find(name).name, hand=()),
            "form": lambda session, name, form: session.ticked(find_effect(name, str(form)).id),
            "option": _opted,
            "drop": lambda session, name, _: session.ticked(EffectId(name), False),
            "slider": self.slide,
            "fit": lambda session, name, _: session.moved(name, None),
            "line": self.add_line,
            "unline": _without_line,
            "correct": lambda session, names, _: session.corrected((*session.corrections, *names.split(","))),
            "uncorrect": lambda session, _, __: session.corrected(()),
            "adopt": lambda session, address, _: Session.read(address),
            "alone": lambda session, _, __: replace(session, effects=(), lines=(), options=(), hand=()),
            "unselect": lambda session, _, __: replace(session, windows=()),
            "region": self.select_region,
            "picked": lambda session, _, row: replace(session, trial=int(row)),
            "boxed": _boxed,
            "worst": lambda session, _, __: replace(session, trial=self.ranked(session)[0]),
            "worse": self.next_worse,
            "previous": lambda session, _, __: self.step(session, -1),
            "next": lambda session, _, __: self.step(session, 1),
        }

    def tick(self, session: Session, name: str, on: bool) -> Session:
        """Add an effect in its most promising form, or remove it."""
        present = [one.name for one in session.effects]
        if not on or name in present:
            return session if on else session.ticked(EffectId(name), False)
        return session.ticked(self.best_form(session, name))

    def best_form(self, session: Session, name: str) -> EffectId:
        """Return the form of an effect that promises most; its default where nothing is promised."""
        return next((one.effect for one in self.promises.of(session) if one.effect.name == name), find_effect(name).id)

    def slide(self, session: Session, name: str, value: float) -> Session:
        """Move a parameter by hand, unless it is there already."""
        names = [p.name for p in self.models.fitted(session).fit.parameters]
        if name not in names:  # of a model that has gone
            return session
        now = self.models.values(session)[names.index(name)].item()
        return session if abs(value - now) <= _CLOSE * max(1.0, abs(now)) else session.moved(name, float(value))

    def add_line(self, session: Session, line: str, _: Any) -> Session:
        """Add an effect as a line of mathematics, once it is known to work on these data.

        Raises:
            ContactLearnError: the line cannot be read, or does not vanish.
        """
        effect_of(line).prepare(self.models.split(session).pool)
        return replace(session, lines=(*session.lines, line), hand=())

    def ranked(self, session: Session) -> list[int]:
        """Return the rows of all trials, that with the largest error of the model first."""
        impacts = self.models.split(session).impacts
        prediction = Prediction(self.models.moved(session).v_post, impacts.wrench)
        return mass_error(impacts, prediction).argsort(descending=True).tolist()

    def next_worse(self, session: Session, _: str, __: Any) -> Session:
        """Select the trial that comes after the selected one in the order of errors."""
        order = self.ranked(session)
        at = order.index(self.trial(session))
        return replace(session, trial=order[(at + 1) % len(order)])

    def step(self, session: Session, by: int) -> Session:
        """Select a neighbour of the selected trial."""
        return replace(session, trial=(self.trial(session) + by) % len(self.models.split(session).impacts))

    def trial(self, session: Session) -> int:
        """Return the row of the selected trial; the worst one of the model if there is none."""
        count = len(self.models.split(session).impacts)
        return self.ranked(session)[0] if session.trial is None else min(session.trial, count - 1)

    def regions(self, session: Session) -> tuple[Region, ...]:
        """Find the regions in which the model fails."""
        impacts, fitted = self.models.split(session).impacts, self.models.fitted(session)
        key = (self.models.fingerprint(session), session.seed, session.model)
        generator = torch.Generator().manual_seed(session.seed)
        return self.regions_found.get(
            key, lambda: find_regions(impacts, fitted.model.predict(impacts), generator=generator)
        )

    def select_region(self, session: Session, place: str, _: Any) -> Session:
        """Select the trials of a region that the model fails in."""
        impacts, found = self.models.split(session).impacts, self.regions(session)
        if int(place) >= len(found):  # of a model that has gone
            return session
        one = found[int(place)]
        known = {each.name: each for each in variables(impacts, self.models.fitted(session).model.predict(impacts))}
        scale, values = known[one.variable].scale, known[one.variable].values
        low = values.min().item() if one.low is None else one.low
        high = values.max().item() if one.high is None else one.high
        return replace(session, windows=(Window(variable=one.variable, low=scale * low, high=scale * high),))


def _without_line(session: Session, place: str, _: Any) -> Session:
    rest = tuple(line for k, line in enumerate(session.lines) if str(k) != place)
    return replace(session, lines=rest, hand=())


def _opted(session: Session, of: str, text: str) -> Session:
    """A constant of an effect as it was written, a number or [low, high]; the default if nothing was."""
    effect, _, name = of.partition(".")
    parts = re.split(r"[,;\s]+", text.strip(" []")) if text.strip(" []") else []
    try:
        value = tuple(float(part.replace("−", "-")) for part in parts)
    except ValueError:
        raise ContactLearnError(f"{name} is a number, or two such as -0.1, 0.1; got {text!r}") from None
    return session.opted(effect, name, value)


def _boxed(session: Session, _: str, windows: list[dict[str, Any]]) -> Session:
    found = tuple(Window(variable=one["variable"], low=float(one["low"]), high=float(one["high"])) for one in windows)
    return replace(session, windows=tuple({one.variable: one for one in found}.values()))


def actions_of(models: Models, promises: Promises) -> Actions:
    """Return the actions on some models."""
    return Actions(models=models, promises=promises, regions_found=Cache(_KEPT))
