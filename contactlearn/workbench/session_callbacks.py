"""Actions on a session, and the callbacks that change and show it: controls, results, figures, dragged sliders.

A control changes the session, that is the address (`act`).  The address is answered at once with the fitted model and
its error (`show`); once that is settled, comparison, predicted gains, ladder and regions follow separately.  Figures
are drawn by scripts from the numbers that are sent (`arrays`).

A page requests /preview for the outcomes of a slider that is being dragged, without a round of callbacks:

    {"address": …, "of": parameter, "value": number}  →  {"summary", …}, see `arrays.of_preview`

Releasing the slider is an action like any other.  `security` guards this path as it guards all others.
"""

import contextlib
import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from threading import Lock
from typing import Any

from dash import ALL, ClientsideFunction, Dash, Input, Output, State, html, no_update
from flask import Response, abort, jsonify, request

from contactlearn import laws
from contactlearn.core.errors import ContactLearnError, UnknownNameError
from contactlearn.core.numerics import is_number
from contactlearn.data.audit.findings import audit
from contactlearn.effects import find_effect
from contactlearn.inference.evaluation.impulse_space import LawImpulses
from contactlearn.inference.evaluation.metrics import mass_error
from contactlearn.inference.evaluation.variables import map_variables, variables
from contactlearn.mechanics.impacts import Prediction
from contactlearn.mechanics.space import PLANE
from contactlearn.report.page.trials import impulse_figure
from contactlearn.report.text.names import law_label, sentence
from contactlearn.workbench import arrays, content
from contactlearn.workbench.commands import command
from contactlearn.workbench.lines import completions, parse_effect
from contactlearn.workbench.models import Cache, Models, PredictedGain
from contactlearn.workbench.session import Session, Window

_TICKS, _LAW = {"set": "ticks", "of": ""}, {"set": "law", "of": ""}
_History = dict[str, list[str]]
_STEPS, _TABS = 200, 100  # steps of Undo, tabs whose address is known
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


def _rig_words(values: list[float | None], names: list[dict[str, str]]) -> Any:
    """Write the limits in the fields as words; a quantity with an empty field is left out."""
    ends = dict[str, list[float]]()
    for value, name in zip(values, names, strict=True):
        ends.setdefault(name["of"], []).extend([] if value is None else [value])
    return content.rig_words({name: (pair[0], pair[1]) for name, pair in ends.items() if len(pair) == 2})


class SessionCallbacks:
    """The callbacks that change and show a session."""

    def __init__(self, models: Models) -> None:
        self.models, self.actions = models, Actions(models=models)
        self._latest: Cache[dict[str, str]] = Cache(_TABS)
        self._figures: Cache[dict[str, Any]] = Cache(_TABS)
        self._slow = Lock()

    def register(self, app: Dash) -> None:
        """Connect the callbacks with an app."""
        address, settled, tab = Input("address", "search"), Input("settled", "data"), State("tab", "data")
        ticks, law = Output(_TICKS, "value", allow_duplicate=True), Output(_LAW, "value", allow_duplicate=True)
        app.callback(
            Output("address", "search"), Output("history", "data"), Output("done", "data"),
            Output("trouble", "children"), ticks, law,
            Input("acted", "data"), State("done", "data"), State("address", "search"), State("history", "data"),
            prevent_initial_call=True,
        )(self.act)  # fmt: skip
        app.callback(
            Output("source", "children"), Output("summary", "children"), Output("parts", "children"),
            Output("fitted", "data"), Output(_TICKS, "value"), Output(_LAW, "value"), Output("command", "children"),
            Output("words", "value"),
            Output("trouble", "children", allow_duplicate=True), address, State(_TICKS, "value"), State(_LAW, "value"),
            prevent_initial_call="initial_duplicate",
        )(self.show)  # fmt: skip
        app.callback(
            Output("data-sent", "data"), Output("model-sent", "data"), Output("settled", "data"),
            Input("fitted", "data"), State("data-drawn", "children"), tab, prevent_initial_call=True,
        )(self.draw)  # fmt: skip
        followers = [
            ([Output("trial-sent", "data"), Output("windows-sent", "data")], [settled], self.trial),
            ([Output(_LAW, "options"), Output("bounds", "children")], [settled], self.compare),
            (Output(_TICKS, "options"), [settled, tab], self.missing),
            (Output("ladder", "children"), [settled, tab], self.ladder),
            (Output("floor", "children"), [settled, tab], self.floor),
            (Output("regions", "children"), [settled, tab], self.regions),
        ]
        for outputs, inputs, function in followers:
            app.callback(outputs, inputs, prevent_initial_call=True)(function)
        app.callback(
            Output("findings", "children"), Output("mistakes", "children"), Output("rig", "value"),
            Output("rig-fields", "children"),
            Input("data-drawn", "children"), State("address", "search"),
        )(self.findings)  # fmt: skip
        limit = {"limit": ALL, "of": ALL}
        app.callback(
            Output("rig", "value", allow_duplicate=True), Input(limit, "value"), State(limit, "id"),
            prevent_initial_call=True,
        )(_rig_words)  # fmt: skip
        app.callback(
            Output("completions", "children"), Output("line-status", "children"),
            Input("line", "value"), State("address", "search"),
        )(self.complete)  # fmt: skip
        app.clientside_callback(
            ClientsideFunction("workbench", "steps"),
            Output("undo", "disabled"), Output("redo", "disabled"), Output("alone", "disabled"),
            Input("history", "data"), Input("address", "search"),
        )  # fmt: skip
        scripts = [("slider", Input({"set": "slider", "of": ALL}, "value"))]
        scripts += [("drag", Input({"set": "slider", "of": ALL}, "drag_value")), ("done", Input("done", "data"))]
        scripts += [(name, Input(f"{name}-sent", "data")) for name in ("data", "model", "trial", "windows")]
        for name, sent in scripts:
            drawn = Output(f"{name}-drawn", "children")
            app.clientside_callback(ClientsideFunction("workbench", name), drawn, sent)
        app.server.add_url_rule("/preview", "preview", self._answer_slider, methods=["POST"])

    def act(
        self, acted: list[dict[str, Any]] | None, done: int | None, address: str | None, history: _History | None
    ) -> tuple[Any, ...]:
        """Change the session by all actions since the last answer, in order.

        An action whose model cannot be fitted is refused with its error.  The page repeats unanswered actions with the
        next ones, so nothing is lost when answers overtake each other.
        """
        fresh = [one for one in acted or [] if one["n"] > (done or 0)]
        if not fresh:
            return (no_update,) * 6
        steps, session, trouble = history or {"past": [], "future": []}, Session(), ""
        with contextlib.suppress(ContactLearnError):  # an address that cannot be read is replaced by the defaults
            session = Session.read(address or "")
        before = session
        for one in fresh:
            try:
                session, steps = self._changed(session, steps, one["kind"], one["of"], one["value"])
            except ContactLearnError as error:
                trouble = str(error)
        moved = (session.address or "?", steps) if session != before else (no_update, no_update)
        listed = ([one.name for one in session.effects], session.law) if trouble else (no_update, no_update)
        return *moved, fresh[-1]["n"], trouble, *listed

    def _changed(self, session: Session, steps: _History, kind: str, of: str, value: Any) -> tuple[Session, _History]:
        """Return the session after one action, and the addresses before it and after it."""
        past, future = steps["past"], steps["future"]
        if kind == "undo" and past:
            return Session.read(past[-1]), {"past": past[:-1], "future": [session.address, *future]}
        if kind == "redo" and future:
            return Session.read(future[0]), {"past": [*past, session.address], "future": future[1:]}
        if kind in ("undo", "redo"):
            return session, steps
        if kind not in self.actions.handlers:
            raise UnknownNameError("action", kind, self.actions.handlers)
        after = self.actions.handlers[kind](session, of, value)
        if after == session:
            return session, steps
        self.models.manual(after)
        return after, {"past": [*past, session.address][-_STEPS:], "future": []}

    def show(self, address: str | None, ticks: list[str] | None, law: str | None) -> tuple[Any, ...]:
        """Fit the model of the address and show it; an error leaves the page as it is."""
        try:
            session = Session.read(address or "")
            fitted, manual, data = self.models.fitted(session), self.models.manual(session), self.models.split(session)
        except ContactLearnError as error:
            return (*[no_update] * 8, str(error))
        names = [effect.name for effect in session.effects]
        before, number, after = content.error_summary(session, fitted, manual, self.models.law_alone(session))
        return (
            f"{data.impacts.source}: {len(data.pool)} trials to fit to, {len(data.test)} held out.",
            [before, html.B(number), after],
            content.parts(session, fitted, manual),
            session.address or "?",
            no_update if set(ticks or []) == set(names) else names,
            no_update if law == session.law else session.law,
            command(session),
            " ".join(session.data),
            "",
        )

    def draw(self, address: str, shown: str | None, tab: str) -> tuple[Any, Any, Any]:
        """Send the numbers of the model to the figures, with the trials if other ones are shown."""
        session, trials = Session.read(address), no_update
        self._latest.get(tab, dict)["address"] = address
        data, manual, alone = self.models.split(session), self.models.manual(session), self.models.law_alone(session)
        source = f"{self.models.fingerprint(session)} {session.seed}"
        if shown != source:
            trials = arrays.of_data(data.impacts, alone.model.predict(data.impacts)) | {"source": source}
        names = [law_label(session.law), content.model_title(session)]
        sent = arrays.of_model(data.impacts, alone.v_post, manual.v_post, manual.model)
        return trials, sent | {"names": names, "count": len(data.impacts), "mean": manual.error.mean}, address

    def trial(self, address: str) -> tuple[Any, Any]:
        """Send the selected trial, and the trials in the windows of the map."""
        session = Session.read(address)
        impacts = self.models.split(session).impacts
        known = {name: self.models.law_alone(session, name).model.law for name in self.models.laws(session)}
        among = map_variables(impacts, self.models.fitted(session).model.predict(impacts))
        rows = arrays.inside(session.windows, among).nonzero()[:, 0].tolist() if session.windows else None
        windows = [{"variable": one.variable, "low": one.low, "high": one.high} for one in session.windows]
        trial = arrays.of_trial(impacts, self.actions.trial(session), known)
        figure = self._figures.get(
            tuple(known), lambda: impulse_figure(LawImpulses.of(impacts[[0]], known).first)
        )  # of the laws alone
        return trial | {"law": session.law, "figure": figure}, {"windows": windows, "rows": rows}

    def compare(self, address: str) -> tuple[Any, Any]:
        """Show laws, bounds and the model side by side."""
        session = Session.read(address)
        errors, fitted = self.models.comparison(session), self.models.fitted(session)
        largest = content.largest_error(errors, fitted)
        error = self.models.manual(session).error
        return content.law_options(errors, largest), content.bounds(errors, session, error, largest)

    def missing(self, address: str, tab: str) -> Any:
        """Show the predicted gain of each effect."""

        def options(session: Session) -> list[dict[str, Any]]:
            gains: tuple[PredictedGain, ...] = ()
            with contextlib.suppress(ContactLearnError):  # too few trials for any effect
                gains = self.models.predicted_gains(session)
            return content.effect_options(session, gains, self.models.fitted(session).error.mean)

        return self._delayed(address, tab, options)

    def ladder(self, address: str, tab: str) -> Any:
        """Show the ladder so far."""
        return self._delayed(address, tab, lambda one: content.ladder_bars(one, self.models.ladder(one)))

    def floor(self, address: str, tab: str) -> Any:
        """Show the noise floor below the ladder."""
        models = self.models
        return self._delayed(address, tab, lambda one: content.floor_bar(models.ladder(one), models.noise_floor(one)))

    def regions(self, address: str, tab: str) -> Any:
        """Show the regions in which the model fails."""
        return self._delayed(address, tab, lambda one: content.region_buttons(self.models.regions(one)))

    def _delayed(self, address: str, tab: str, make: Callable[[Session], Any]) -> Any:
        """Make slow content, one at a time, and only while the tab still shows that model."""
        with self._slow:
            if self._latest.get(tab, dict).get("address", address) != address:
                return no_update
            return make(Session.read(address))

    def findings(self, drawn: str | None, address: str | None) -> tuple[Any, Any, Any, Any]:
        """Show the findings of the audit, the corrections of the data, and their ranges as limits of a rig."""
        if not drawn:
            return no_update, no_update, no_update, no_update
        session = Session.read(address or "")
        impacts = self.models.split(session).impacts
        found = audit(impacts) if impacts.space is PLANE else ()
        notes = [html.Li(sentence(one.sentence)) for one in found if not one.mistake]
        limits = content.rig_limits(impacts)
        shown = [html.Ul(notes)] if notes else [], content.mistakes(found, session)
        return *shown, content.rig_words(limits), content.rig_fields(limits)

    def complete(self, line: str | None, address: str | None) -> tuple[Any, str]:
        """Show completions of a line, and its equation or its error."""
        options = list[Any]()
        try:
            pool = self.models.split(Session.read(address or "")).pool
            options = [html.Option(value=text) for text in completions(line or "", pool.space)]
            if not line:
                return options, ""
            effect = parse_effect(line).prepare(pool)
        except ContactLearnError as error:
            return options, str(error)
        return options, effect.equation

    def preview(self, address: str, of: str, value: float) -> dict[str, Any]:
        """Return the outcomes and the error of the model of an address with one parameter moved.

        Raises:
            ContactLearnError: an address that cannot be read, or a number that is not finite.
        """
        session = self.actions.slide(Session.read(address), of, value)
        fitted, manual = self.models.fitted(session), self.models.manual(session)
        summary = content.error_summary(session, fitted, manual, self.models.law_alone(session))
        return arrays.of_preview(self.models.split(session).impacts, manual.v_post, manual.model) | {"summary": summary}

    def _answer_slider(self) -> Response:
        question: Any = None
        with contextlib.suppress(ValueError):
            question = json.loads(request.get_data(), parse_int=float)  # a whole number may be too large for a float
        fields = ("address", "of", "value")
        address, of, value = map(question.get, fields) if isinstance(question, dict) else (None,) * 3
        if not isinstance(address, str) or not isinstance(of, str) or not is_number(value):
            abort(400, "The request needs an address, a parameter and a number.")
        try:
            return jsonify(self.preview(address, of, value))
        except ContactLearnError as error:  # the slider is of an earlier model
            abort(400, str(error))
