"""The page: its layout, and the callbacks that connect controls, sessions, results and figures.

A control changes the session, that is the address (`act`).  The address is answered at once with the fitted model and
its error (`show`); once that is settled follow, each by itself, the comparison, the promises, the ladder and the
regions.  Figures are drawn by the scripts of the report from numbers that are sent (`arrays`).
"""

import contextlib
from collections.abc import Callable
from threading import Lock
from typing import Any

from dash import ALL, ClientsideFunction, Dash, Input, Output, State, html, no_update

from contactlearn.core.errors import ContactLearnError, UnknownNameError
from contactlearn.data.audit.findings import audit
from contactlearn.diagnosis.search.candidates import SEARCHED_LAWS
from contactlearn.report.text import law_label
from contactlearn.workbench import arrays
from contactlearn.workbench.actions import Actions
from contactlearn.workbench.cache import Cache
from contactlearn.workbench.commands import command
from contactlearn.workbench.lines import completions, effect_of
from contactlearn.workbench.models import Models
from contactlearn.workbench.panes import compare, fails, frame, missing, model
from contactlearn.workbench.promises import Promise, Promises
from contactlearn.workbench.session import Session

_TICKS, _LAW = {"set": "ticks", "of": ""}, {"set": "law", "of": ""}
_History = dict[str, list[str]]
_KEPT_STEPS, _TABS = 200, 100


class Page:
    """The callbacks that change and show a session."""

    def __init__(self, models: Models, promises: Promises, actions: Actions) -> None:
        self.models, self.promises, self.actions = models, promises, actions
        self._latest: Cache[dict[str, str]] = Cache(_TABS)
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
            Output("source", "children"), Output("said", "children"), Output("parts", "children"),
            Output("fitted", "data"), Output(_TICKS, "value"), Output(_LAW, "value"), Output("command", "children"),
            Output("words", "value"),
            Output("trouble", "children", allow_duplicate=True), address, State(_TICKS, "value"), State(_LAW, "value"),
            prevent_initial_call="initial_duplicate",
        )(self.show)  # fmt: skip
        app.callback(
            Output("data-sent", "data"), Output("model-sent", "data"), Output("settled", "data"),
            Input("fitted", "data"), State("data-drawn", "children"), tab,
        )(self.draw)  # fmt: skip
        app.callback(Output("trial-sent", "data"), Output("windows-sent", "data"), settled)(self.trial)
        app.callback(Output(_LAW, "options"), Output("bounds", "children"), settled)(self.compare)
        app.callback(Output(_TICKS, "options"), settled, tab)(self.missing)
        app.callback(Output("ladder", "children"), settled, tab)(self.ladder)
        app.callback(Output("regions", "children"), settled, tab)(self.regions)
        app.callback(
            Output("findings", "children"), Output("mistakes", "children"),
            Input("data-drawn", "children"), State("address", "search"),
        )(self.findings)  # fmt: skip
        app.callback(
            Output("completions", "children"),
            Output("line-said", "children"),
            Input("line", "value"),
            State("address", "search"),
        )(self.complete)
        for function, what in (("slider", "value"), ("drag", "drag_value")):
            drawn = Output(f"{function}-drawn", "children")
            app.clientside_callback(
                ClientsideFunction("workbench", function), drawn, Input({"set": "slider", "of": ALL}, what)
            )
        app.clientside_callback(
            ClientsideFunction("workbench", "done"), Output("done-drawn", "children"), Input("done", "data")
        )
        for name in ("data", "model", "trial", "windows"):
            drawn, sent = Output(f"{name}-drawn", "children"), Input(f"{name}-sent", "data")
            app.clientside_callback(ClientsideFunction("workbench", name), drawn, sent)

    def act(
        self, acted: list[dict[str, Any]] | None, done: int | None, address: str | None, history: _History | None
    ) -> tuple[Any, ...]:
        """Change the session by what was pressed, ticked or moved since the last answer, in turn.

        A change that cannot be fitted is refused, and said.  The page sends what has not been answered again with what
        follows, so nothing is lost when answers are overtaken.
        """
        fresh = [one for one in acted or [] if one["n"] > (done or 0)]
        if not fresh:
            return (no_update,) * 6
        steps, session, trouble = history or {"past": [], "future": []}, Session(), ""
        with contextlib.suppress(ContactLearnError):  # an address that cannot be read is left for the defaults
            session = Session.read(address or "")
        before = session
        for one in fresh:
            try:
                session, steps = self._acted(session, steps, one["kind"], one["of"], one["value"])
            except ContactLearnError as error:
                trouble = str(error)
        moved = (session.address or "?", steps) if session != before else (no_update, no_update)
        listed = ([one.name for one in session.effects], session.law) if trouble else (no_update, no_update)
        return *moved, fresh[-1]["n"], trouble, *listed

    def _acted(self, session: Session, steps: _History, kind: str, of: str, value: Any) -> tuple[Session, _History]:
        """The session after one action, and the addresses before it and after it."""
        past, future = steps["past"], steps["future"]
        if kind == "undo" and past:
            return Session.read(past[-1]), {"past": past[:-1], "future": [session.address, *future]}
        if kind == "redo" and future:
            return Session.read(future[0]), {"past": [*past, session.address], "future": future[1:]}
        if kind in ("undo", "redo"):
            return session, steps
        if kind not in self.actions.kinds:
            raise UnknownNameError("action", kind, self.actions.kinds)
        after = self.actions.kinds[kind](session, of, value)
        if after == session:
            return session, steps
        self.models.moved(after)
        return after, {"past": [*past, session.address][-_KEPT_STEPS:], "future": []}

    def show(self, address: str | None, ticks: list[str] | None, law: str | None) -> tuple[Any, ...]:
        """Fit the model of the address; what is wrong with it is said, and the page stays."""
        try:
            session = Session.read(address or "")
            fitted, moved, data = self.models.fitted(session), self.models.moved(session), self.models.split(session)
        except ContactLearnError as error:
            return (*[no_update] * 8, str(error))
        names = [one.name for one in session.effects]
        before, number, after = model.said(fitted, moved, self.models.alone(session), bool(session.hand))
        return (
            f"{data.impacts.source}: {len(data.pool)} trials to fit to, {len(data.test)} held out.",
            [before, html.B(number), after],
            model.parts(session, fitted, moved),
            session.address or "?",
            no_update if set(ticks or []) == set(names) else names,
            no_update if law == session.law else session.law,
            command(session),
            " ".join(session.data),
            "",
        )

    def draw(self, address: str | None, shown: str | None, tab: str) -> tuple[Any, Any, Any]:
        """What the figures need: the model, and the trials if they are others than those that are shown."""
        if address is None:
            return no_update, no_update, no_update
        session = Session.read(address)
        self._latest.get(tab, dict)["address"] = address
        if shown == self._data_name(session):
            return no_update, self._drawn(session), address
        impacts = self.models.split(session).impacts
        trials = arrays.of_data(impacts, self.models.alone(session).model.predict(impacts))
        return trials | {"source": self._data_name(session)}, self._drawn(session), address

    def _data_name(self, session: Session) -> str:
        return f"{self.models.fingerprint(session)} {session.seed}"

    def _drawn(self, session: Session) -> dict[str, Any]:
        """What the figures need of the model."""
        data, moved = self.models.split(session), self.models.moved(session)
        alone = self.models.alone(session)
        names = [law_label(session.law), model.model_title(session)]
        sent = arrays.of_model(data.impacts, alone.v_post, moved.v_post, moved.model)
        return sent | {"names": names, "count": len(data.impacts), "error": moved.error.mean}

    def trial(self, address: str | None) -> tuple[Any, Any]:
        """The selected trial, and the trials in the windows of the map."""
        if address is None:
            return no_update, no_update
        session = Session.read(address)
        data, row = self.models.split(session), self.actions.trial(session)
        known = {
            name: self.models.alone(session, name).model.law for name in dict.fromkeys((*SEARCHED_LAWS, session.law))
        }
        among = arrays.map_variables(data.impacts, self.models.fitted(session).model.predict(data.impacts))
        rows = arrays.inside(session.windows, among).nonzero()[:, 0].tolist() if session.windows else None
        windows = [{"variable": one.variable, "low": one.low, "high": one.high} for one in session.windows]
        return arrays.of_trial(data.impacts, row, known) | {"law": session.law}, {"windows": windows, "rows": rows}

    def compare(self, address: str | None) -> tuple[Any, Any]:
        """Laws, bounds and the model side by side."""
        if address is None:
            return no_update, no_update
        session = Session.read(address)
        found, fitted = self.models.compared(session), self.models.fitted(session)
        most = compare.largest(found, fitted)
        return compare.law_options(found, most), compare.beside(found, fitted, model.model_title(session), most)

    def missing(self, address: str | None, tab: str) -> Any:
        """What each effect would take off."""

        def options(session: Session) -> list[dict[str, Any]]:
            promises: tuple[Promise, ...] = ()
            with contextlib.suppress(ContactLearnError):  # too few trials for any effect
                promises = self.promises.of(session)
            return missing.effect_options(session, promises, self.models.fitted(session).error.mean)

        return self._after(address, tab, options)

    def ladder(self, address: str | None, tab: str) -> Any:
        """The ladder so far, above the noise floor."""
        return self._after(
            address, tab, lambda one: model.ladder_bars(one, self.models.ladder(one), self.models.noise(one))
        )

    def regions(self, address: str | None, tab: str) -> Any:
        """Regions in which the model fails."""
        return self._after(address, tab, lambda one: fails.region_buttons(self.actions.regions(one)))

    def _after(self, address: str | None, tab: str, make: Callable[[Session], Any]) -> Any:
        """What takes a while, one at a time, and only while the tab still shows that model."""
        if address is None:
            return no_update
        with self._slow:
            if self._latest.get(tab, dict).get("address", address) != address:
                return no_update
            return make(Session.read(address))

    def findings(self, drawn: str | None, address: str | None) -> tuple[Any, Any]:
        """What the audit says of the data, and how they can be corrected."""
        if not drawn:
            return no_update, no_update
        session = Session.read(address or "")
        found = audit(self.models.split(session).impacts)
        return frame.audit_notes(found), frame.mistakes(found, session)

    def complete(self, line: str | None, address: str | None) -> tuple[Any, str]:
        """Completions of a line, and what is wrong with it so far."""
        options = [html.Option(value=text) for text in completions(line or "")]
        if not line:
            return options, ""
        try:
            effect = effect_of(line)
            effect.prepare(self.models.split(Session.read(address or "")).pool)
        except ContactLearnError as error:
            return options, str(error)
        return options, effect.equation
