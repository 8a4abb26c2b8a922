"""Actions: what each control does to the session.

A handler maps a session, the name behind the control and its value to another session.  Only the actions `ticks`,
`form`, `option`, `slider`, `picked` and `boxed` come with a value.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from contactlearn import laws
from contactlearn.core.errors import ContactLearnError
from contactlearn.diagnosis.failure.variables import variables
from contactlearn.effects import find_effect
from contactlearn.inference.evaluation.metrics import mass_error
from contactlearn.mechanics.impacts import Prediction
from contactlearn.workbench.lines import parse_effect
from contactlearn.workbench.models import Models
from contactlearn.workbench.session import Session, Window

_CLOSE = 1e-9  # relative difference of a slider's value from the one that it was set to


@dataclass(frozen=True, kw_only=True)
class Actions:
    """The actions on sessions whose data and fits are in `models`."""

    models: Models

    @property
    def handlers(self) -> Mapping[str, Callable[[Session, str, Any], Session]]:
        """Every handler by the name of its action."""
        return {
            "ticks": self.tick,
            "law": lambda session, name, _: replace(session, law=laws.find(name).name, manual=()),
            "form": lambda session, name, form: session.with_effect(find_effect(name, str(form)).id),
            "option": _set_option,
            "drop": lambda session, name, _: session.without_effect(name),
            "slider": self.slide,
            "fit": lambda session, name, _: session.with_value(name, None),
            "line": self.add_line,
            "unline": _without_line,
            "correct": lambda session, names, _: session.corrected((*session.corrections, *names.split(","))),
            "uncorrect": lambda session, _, __: session.corrected(()),
            "adopt": lambda session, address, _: Session.read(address),
            "alone": lambda session, _, __: replace(session, effects=(), lines=(), options=(), manual=()),
            "unselect": lambda session, _, __: replace(session, windows=()),
            "region": self.select_region,
            "picked": lambda session, _, row: replace(session, trial=int(row)),
            "boxed": _select_box,
            "worst": lambda session, _, __: replace(session, trial=self.ranked(session)[0]),
            "worse": self.next_worse,
            "previous": lambda session, _, __: self.step(session, -1),
            "next": lambda session, _, __: self.step(session, 1),
        }

    def tick(self, session: Session, name: str, on: bool) -> Session:
        """Add an effect in the form with the largest predicted gain, or remove it."""
        if not on:
            return session.without_effect(name)
        if name in [effect.name for effect in session.effects]:
            return session
        forms = (one.effect for one in self.models.predicted_gains(session) if one.effect.name == name)
        return session.with_effect(next(forms, find_effect(name).id))

    def slide(self, session: Session, name: str, value: float) -> Session:
        """Set a parameter by hand, unless it has that value already."""
        names = [p.name for p in self.models.fitted(session).fit.parameters]
        if name not in names:  # the slider is of an earlier model
            return session
        now = self.models.values(session)[names.index(name)].item()
        return session if abs(value - now) <= _CLOSE * max(1.0, abs(now)) else session.with_value(name, float(value))

    def add_line(self, session: Session, line: str, _: Any) -> Session:
        """Add an effect as a line of mathematics, once it works on these data.

        Raises:
            ContactLearnError: the line cannot be read, or its effect does not vanish.
        """
        parse_effect(line).prepare(self.models.split(session).pool)
        return replace(session, lines=(*session.lines, line), manual=())

    def ranked(self, session: Session) -> list[int]:
        """Return the rows of all trials by the error of the model, the largest first."""
        impacts = self.models.split(session).impacts
        prediction = Prediction(self.models.manual(session).v_post, impacts.wrench)
        return mass_error(impacts, prediction).argsort(descending=True).tolist()

    def next_worse(self, session: Session, _: str, __: Any) -> Session:
        """Select the trial with the next smaller error than the selected one."""
        order = self.ranked(session)
        return replace(session, trial=order[(order.index(self.trial(session)) + 1) % len(order)])

    def step(self, session: Session, by: int) -> Session:
        """Select a neighbour of the selected trial."""
        return replace(session, trial=(self.trial(session) + by) % len(self.models.split(session).impacts))

    def trial(self, session: Session) -> int:
        """Return the row of the selected trial, by default the one with the largest error."""
        count = len(self.models.split(session).impacts)
        return self.ranked(session)[0] if session.trial is None else min(session.trial, count - 1)

    def select_region(self, session: Session, place: str, _: Any) -> Session:
        """Select the trials of a region in which the model fails."""
        impacts, found = self.models.split(session).impacts, self.models.regions(session)
        if int(place) >= len(found):  # the button is of an earlier model
            return session
        region = found[int(place)]
        among = variables(impacts, self.models.fitted(session).model.predict(impacts))
        variable = next(one for one in among if one.name == region.variable)
        low = variable.values.min().item() if region.low is None else region.low
        high = variable.values.max().item() if region.high is None else region.high
        window = Window(variable=variable.name, low=variable.scale * low, high=variable.scale * high)
        return replace(session, windows=(window,))


def _without_line(session: Session, place: str, _: Any) -> Session:
    rest = tuple(line for k, line in enumerate(session.lines) if str(k) != place)
    return replace(session, lines=rest, manual=())


def _set_option(session: Session, target: str, text: str) -> Session:
    """Set an option of an effect to a number or [low, high]; an empty text restores the default."""
    effect, _, name = target.partition(".")
    parts = re.split(r"[,;\s]+", text.strip(" []")) if text.strip(" []") else []
    try:
        value = tuple(float(part.replace("−", "-")) for part in parts)
    except ValueError:
        raise ContactLearnError(f"{name} is a number, or two such as -0.1, 0.1; got {text!r}") from None
    return session.with_option(effect, name, value)


def _select_box(session: Session, _: str, windows: list[dict[str, Any]]) -> Session:
    found = (Window(variable=one["variable"], low=float(one["low"]), high=float(one["high"])) for one in windows)
    return replace(session, windows=tuple({one.variable: one for one in found}.values()))
