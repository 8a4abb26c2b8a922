"""The page: its layout, and the callbacks that connect controls, sessions, results and figures.

A control changes the session, that is the address (`act`).  The address is answered at once with the fitted model and
its error (`show`); once that is settled follow, each by itself, the comparison, the promises, the ladder and the
regions.  Figures are drawn by the scripts of the report from numbers that are sent (`arrays`).
"""

import contextlib
from typing import Any

from dash import ALL, ClientsideFunction, Dash, Input, Output, State, ctx, no_update

from contactlearn.audit.findings import audit
from contactlearn.diagnosis.search.candidates import SEARCHED_LAWS
from contactlearn.errors import ContactLearnError
from contactlearn.report.text import effect_label, law_label
from contactlearn.workbench import arrays
from contactlearn.workbench.actions import Actions
from contactlearn.workbench.commands import command
from contactlearn.workbench.lines import completions, effect_of
from contactlearn.workbench.models import Models
from contactlearn.workbench.panes import compare, fails, frame, missing, model
from contactlearn.workbench.promises import Promises
from contactlearn.workbench.session import Session

PRESSED = {"press": ALL, "of": ALL, "at": ALL}
SET = {"set": ALL, "of": ALL}
_TICKS, _LAW = {"set": "ticks", "of": ""}, {"set": "law", "of": ""}
_NOT_SESSION = ("search", "cancel", "save")  # buttons that start or end jobs
_KEPT_STEPS = 200


class Page:
    """The callbacks that change and show a session."""

    def __init__(self, models: Models, promises: Promises, actions: Actions) -> None:
        self.models, self.promises, self.actions = models, promises, actions

    def register(self, app: Dash) -> None:
        """Connect the callbacks with an app."""
        address, settled = Input("address", "search"), Input("settled", "data")
        ticks, law = Output(_TICKS, "value", allow_duplicate=True), Output(_LAW, "value", allow_duplicate=True)
        app.callback(
            Output("address", "search"), Output("history", "data"), Output("trouble", "children"), ticks, law,
            Input(SET, "value"), Input(PRESSED, "n_clicks"), Input("picked", "data"), Input("boxed", "data"),
            Input("undo", "n_clicks"), Input("redo", "n_clicks"), Input("line", "n_submit"),
            State("address", "search"), State("history", "data"), State("line", "value"), prevent_initial_call=True,
        )(self.act)  # fmt: skip
        app.callback(
            Output("source", "children"), Output("said", "children"), Output("parts", "children"),
            Output("fitted", "data"), Output(_TICKS, "value"), Output(_LAW, "value"), Output("command", "children"),
            Output("words", "value"),
            Output("trouble", "children", allow_duplicate=True), address, prevent_initial_call="initial_duplicate",
        )(self.show)  # fmt: skip
        app.callback(
            Output("data-sent", "data"), Output("model-sent", "data"), Output("settled", "data"),
            Input("fitted", "data"), State("data-drawn", "children"),
        )(self.draw)  # fmt: skip
        app.callback(Output("undo", "disabled"), Output("redo", "disabled"), Input("history", "data"))(self.steps)
        app.callback(
            Output("model-sent", "data", allow_duplicate=True), Output("said", "children", allow_duplicate=True),
            Input(SET, "drag_value"), State("address", "search"), prevent_initial_call=True,
        )(self.preview)  # fmt: skip
        app.callback(Output("trial-sent", "data"), Output("windows-sent", "data"), settled)(self.trial)
        app.callback(Output(_LAW, "options"), Output("bounds", "children"), settled)(self.compare)
        app.callback(Output(_TICKS, "options"), settled)(self.missing)
        app.callback(Output("ladder", "children"), settled)(self.ladder)
        app.callback(Output("regions", "children"), settled)(self.regions)
        app.callback(Output("findings", "children"), Input("data-drawn", "children"), State("address", "search"))(
            self.findings
        )
        app.callback(
            Output("completions", "children"),
            Output("line-said", "children"),
            Input("line", "value"),
            State("address", "search"),
        )(self.complete)
        for name in ("data", "model", "trial", "windows"):
            drawn, sent = Output(f"{name}-drawn", "children"), Input(f"{name}-sent", "data")
            app.clientside_callback(ClientsideFunction("workbench", name), drawn, sent)

    def act(self, *values: Any) -> tuple[Any, ...]:
        """Change the session by what was pressed or set; undo and redo go along the list of addresses.

        A change that cannot be fitted is refused, and said.
        """
        *_, address, history, line = values
        history = history or {"past": [], "future": []}
        before = session = Session.read(address or "")
        try:
            if ctx.triggered_id in ("undo", "redo"):
                return *_travelled(ctx.triggered_id, address or "", history), "", no_update, no_update
            values_by_source = {one["prop_id"]: one["value"] for one in ctx.triggered}
            for source, name in ctx.triggered_prop_ids.items():
                session = self._acted(session, name, source, values_by_source[source], line)
            if session == before:
                return (no_update,) * 5
            self.models.moved(session)
        except ContactLearnError as error:
            return no_update, no_update, str(error), [one.name for one in before.effects], before.law
        past = [*history["past"], before.address][-_KEPT_STEPS:]
        return session.address or "?", {"past": past, "future": []}, "", no_update, no_update

    def _acted(self, session: Session, name: Any, source: str, value: Any, line: str | None) -> Session:
        """The session after one control; one that was made anew has no clicks yet."""
        kind, of = (name, "") if isinstance(name, str) else (name.get("press") or name["set"], name["of"])
        if value in (None, 0) and source.rpartition(".")[2] in ("n_clicks", "n_submit"):
            return session
        if value is None or kind in _NOT_SESSION:
            return session
        return self.actions.kinds[kind](session, of, line if kind == "line" else value)

    def show(self, address: str | None) -> tuple[Any, ...]:
        """Fit the model of the address; what is wrong with it is said, and the page stays."""
        try:
            session = Session.read(address or "")
            fitted, moved, data = self.models.fitted(session), self.models.moved(session), self.models.split(session)
        except ContactLearnError as error:
            return (*[no_update] * 8, str(error))
        return (
            f"{data.impacts.source}: {len(data.pool)} trials to fit to, {len(data.test)} held out.",
            model.said(fitted, moved, self.models.alone(session), bool(session.hand)),
            model.parts(session, fitted, moved),
            session.address or "?",
            [one.name for one in session.effects],
            session.law,
            command(session),
            " ".join(session.data),
            "",
        )

    def draw(self, address: str | None, shown: str | None) -> tuple[Any, Any, Any]:
        """What the figures need: the model, and the trials if they are others than those that are shown."""
        if address is None:
            return no_update, no_update, no_update
        session = Session.read(address)
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
        names = [law_label(session.law), model_title(session)]
        sent = arrays.of_model(data.impacts, alone.v_post, moved.v_post, moved.model)
        return sent | {"names": names, "count": len(data.impacts), "error": moved.error.mean}

    def steps(self, history: dict[str, list[str]] | None) -> tuple[bool, bool]:
        """Whether there is nothing to undo, and nothing to redo."""
        return not (history and history["past"]), not (history and history["future"])

    def preview(self, values: list[Any], address: str | None) -> tuple[Any, Any]:
        """Show the model with a slider where it is being dragged."""
        name, value = ctx.triggered_id, ctx.triggered[0]["value"] if ctx.triggered else None
        if not isinstance(name, dict) or name["set"] != "slider" or value is None:
            return no_update, no_update
        try:
            session = Session.read(address or "")
            if self.actions.slide(session, name["of"], value) == session:
                return no_update, no_update
            session = session.moved(name["of"], float(value))
            alone = self.models.alone(session)
            return self._drawn(session), model.said(
                self.models.fitted(session), self.models.moved(session), alone, True
            )
        except ContactLearnError:  # a slider of a model that has gone
            return no_update, no_update

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
        return compare.law_options(found, most), compare.beside(found, fitted, model_title(session), most)

    def missing(self, address: str | None) -> Any:
        """What each effect would take off."""
        if address is None:
            return no_update
        session, promises = Session.read(address), ()
        with contextlib.suppress(ContactLearnError):  # too few trials for any effect
            promises = self.promises.of(session)
        return missing.effect_options(session, promises, self.models.fitted(session).error.mean)

    def ladder(self, address: str | None) -> Any:
        """The ladder so far, above the noise floor."""
        if address is None:
            return no_update
        session = Session.read(address)
        return model.ladder_bars(session, self.models.ladder(session), self.models.noise(session))

    def regions(self, address: str | None) -> Any:
        """Regions in which the model fails."""
        return no_update if address is None else fails.region_buttons(self.actions.regions(Session.read(address)))

    def findings(self, drawn: str | None, address: str | None) -> Any:
        """What the audit says of the data."""
        if not drawn:
            return no_update
        found = audit(self.models.split(Session.read(address or "")).impacts)
        return frame.finding_list([one.sentence for one in found])

    def complete(self, line: str | None, address: str | None) -> tuple[Any, str]:
        """Completions of a line, and what is wrong with it so far."""
        from dash import html

        options = [html.Option(value=text) for text in completions(line or "")]
        if not line:
            return options, ""
        try:
            effect = effect_of(line)
            effect.prepare(self.models.split(Session.read(address or "")).pool)
        except ContactLearnError as error:
            return options, str(error)
        return options, effect.equation


def model_title(session: Session) -> str:
    """Name the model of a session."""
    parts = [
        law_label(session.law),
        *map(effect_label, session.effects),
        *(line.partition(";")[0] for line in session.lines),
    ]
    return " + ".join(parts) + (" (by hand)" if session.hand else "")


def _travelled(way: str, address: str, history: dict[str, list[str]]) -> tuple[Any, Any]:
    """The address before or after this one, and the list around it."""
    past, future = history["past"], history["future"]
    if way == "undo" and past:
        return past[-1] or "?", {"past": past[:-1], "future": [address, *future]}
    if way == "redo" and future:
        return future[0] or "?", {"past": [*past, address], "future": future[1:]}
    return no_update, no_update
