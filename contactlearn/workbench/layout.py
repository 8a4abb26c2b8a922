"""The layout of the page before anything is known: title, data, the bar that stays in view, hints, and five panes.

A button that changes the session has its action in `data-action` and the object of the action in `data-of`; a list or
slider has the identity `{"set": action, "of": object}`.  The script of the page sends both to `actions`.
"""

import secrets
from collections.abc import Sequence
from typing import Any

from dash import dcc, html
from dash.development.base_component import Component

from contactlearn import laws
from contactlearn.cli.commands.export import TARGETS
from contactlearn.data.packed import ARCHIVES
from contactlearn.data.table import READ
from contactlearn.effects import catalogue
from contactlearn.report.text.names import label, law_label
from contactlearn.workbench.components import action_button, button, controls, figure, note, run_controls
from contactlearn.workbench.lines import EXAMPLE

_SENT = ("data", "model", "trial", "windows", "curve")  # numbers for figures
_STORES = (*(f"{name}-sent" for name in _SENT), "fitted", "settled", "acted", "done", "hint")
_SINKS = (*(f"{name}-drawn" for name in _SENT), "slider-drawn", "drag-drawn", "done-drawn")
_SESSION_STORES = ("history", "diagnosis-run", "curve-run", "learned-run")
_WORDS = (
    "Words as on a command line. The shape of the body, in m, as "
    "data.shape={kind:ellipse,semi_axes:[0.035,0.025]}; without it some effects cannot be decided."
)
HINTS = (
    (
        "Compare",
        "These drops hide one to three physical effects. Under Compare, below the effects, every law stands next to "
        "the bounds; the page opens on the law with the smallest error. Its bar above does not come down to the noise "
        "floor, so something is missing.",
    ),
    (
        "See where it fails",
        "The map shows the error of each trial. Change its axes, draw a box around the worst trials: where is the "
        "error larger, and in which variable?",
    ),
    (
        "Add what is missing",
        "The effects are sorted by their predicted errors; several can have the same error, because these data do not "
        "distinguish them well. Tick the first one: law and effect are fitted together, and the error above falls.",
    ),
    (
        "Go on",
        "Every figure and prediction is now that of the new model. Add another effect while the bars above fall "
        "clearly; Undo takes a step back.",
    ),
    (
        "Check yourself",
        "Search laws and effects compares thousands of sets and shows which models cannot be distinguished. Then "
        "reveal the truth.",
    ),
)
"""Title and text of the hints for data with hidden effects."""


def page_layout(largest: int) -> Component:
    """Return the whole page, with a name of its own for each tab.

    Args:
        largest: bytes of a file that may be dropped.
    """
    hidden: list[Component] = [
        *(dcc.Store(id=name) for name in _STORES),
        *(html.Div(id=name, hidden=True) for name in _SINKS),
        *(dcc.Store(id=name, storage_type="session") for name in _SESSION_STORES),
        dcc.Store(id="tab", data=secrets.token_hex(8)),
        dcc.Location(id="address", refresh=False),
        dcc.Interval(id="diagnosis-clock", interval=1000, disabled=True),
        dcc.Interval(id="study-clock", interval=700, disabled=True),
    ]
    panes = html.Main([_missing(), _compare(), _fails(), _model(), _plan(), _keep()], id="main", tabIndex="-1")
    buttons = (
        action_button(action, text, identity=action)
        for action, text in (("undo", "Undo"), ("redo", "Redo"), ("alone", "Law alone"))
    )
    estimated = note("The noise floor is being estimated …")
    bar: list[Component] = [
        html.Span("…", id="summary", role="status"),
        html.Span(id="summary-moving"),
        html.Span("Fitting …", id="busy", role="status"),
        html.Span(list(buttons), className="controls"),
        html.Span(id="trouble", role="alert"),
        html.Div([html.Div(id="ladder"), html.Div(estimated, id="floor")], className="pinned"),
    ]
    reveal = button("reveal", "Reveal the truth", hidden=True)
    hints = [
        html.P([html.B(id="hint-title"), " ", html.Span(id="hint-text")], role="status"),
        controls(button("hint-next", "Next hint"), reveal, button("hint-end", "No more hints")),
        html.Pre(id="truth", hidden=True),
    ]
    top = [_header(largest), html.Div(bar, id="bar"), html.Aside(hints, id="hints", hidden=True)]
    return html.Div([*hidden, *top, panes])


def _header(largest: int) -> Component:
    upload = dcc.Upload(
        "Drop a table here, or choose one", id="upload", className="drop", max_size=largest,
        accept=",".join((*READ, *ARCHIVES)),
    )  # fmt: skip
    words = dcc.Input(
        id="words", type="text", autoComplete="off", spellCheck=False, placeholder="data=mystery data.seed=7"
    )
    load = html.P([words, button("load", "Load")], className="controls line")
    parts: list[Component] = [
        html.A("Skip to the panes", href="#main", className="skip"),
        html.H1("contactlearn workbench"),
        html.P(id="source"),
        html.Div(id="mistakes", role="status"),
        html.Details([html.Summary("Other data"), upload, load, note(_WORDS), html.Div(id="findings")]),
    ]
    return html.Header(parts)


def _section(identity: str, head: str, *parts: Component) -> Component:
    return html.Section([html.H2(head), *parts], id=identity)


def _compare() -> Component:
    names = [{"label": law_label(name), "value": name} for name in laws.names()]
    curve = figure("curve", "Mean error on the held-out trials against the number of training trials")
    return _section(
        "compare",
        "Compare",
        note("Errors on held-out trials. Choose the law on which the model is built."),
        dcc.RadioItems(id={"set": "law", "of": ""}, options=names, className="rows"),
        html.Div(id="bounds"),
        controls(button("learned-start", "Train learned models"), *run_controls("learned", "Learned models")),
        html.Div(id="learned-found"),
        controls(button("curve-start", "Draw learning curve"), *run_controls("curve", "Learning curve")),
        html.Div(curve, id="curve-place", hidden=True),
    )


def _fails() -> Component:
    named: dict[str, Any] = {"aria-label": "Select trials by numbers"}
    steps = (("worst", "Worst"), ("worse", "Next worst"), ("previous", "Previous"), ("next", "Next"))
    figures = [
        figure("picture", "The body at contact: velocities as arrows, spins as arcs, before, after as measured and as "
               "predicted"),
        figure("impulse", "Impulse space: admissible impulses, measured impulse, that of each law, and all that the "
               "chosen law can give"),
    ]  # fmt: skip
    return _section(
        "fails",
        "Where it fails",
        controls(
            _choice("x axis", "map-x", ()),
            _choice("y axis", "map-y", ()),
            _choice("Errors of", "errors-of", (("ticked", "the model"), ("alone", "the law alone"))),
            action_button("unselect", "Clear selection"),
        ),
        figure("map", "Error of each trial; draw a box to select trials, or enter its limits below; click one trial "
               "to see it. The colours keep the scale of the law alone"),
        html.Div(id="box", className="controls", role="group", **named),
        html.P(id="window-status", role="status"),
        html.Div(id="regions"),
        html.H3("The selected trial"),
        controls(*(action_button(action, text) for action, text in steps)),
        html.P(id="trial-status", role="status"),
        html.Div(figures, className="pair"),
        html.Div(id="curves", className="cards"),
    )  # fmt: skip


def _choice(text: str, identity: str, options: Sequence[tuple[str, str]]) -> Component:
    entries: list[Any] = [html.Option(words, value=value) for value, words in options]
    return html.Label([f"{text} ", html.Select(entries, id=identity)])


def _missing() -> Component:
    names = [{"label": label(name), "value": name} for name in catalogue()]
    search = "Search laws and effects"
    return _section(
        "missing",
        "What is missing",
        note("Tick an effect: law and effects are fitted again together. Next to each effect stands its predicted "
             "held-out error, estimated from the present model."),
        dcc.Checklist(id={"set": "ticks", "of": ""}, options=names, value=[], className="rows effects"),
        html.Details(html.Summary("Effects without a predicted gain"), id="without-gain"),
        controls(button("diagnosis-search", search), *run_controls("diagnosis", search)),
        html.Pre(id="diagnosis-lines", hidden=True),
        html.Div(id="found"),
    )  # fmt: skip


def _model() -> Component:
    line = dcc.Input(id="line", type="text", placeholder=EXAMPLE, autoComplete="off", spellCheck=False)
    return _section(
        "model",
        "The model",
        html.H3("A line of mathematics"),
        html.P([line, action_button("line", "Add")], className="controls line"),
        html.Datalist(id="completions"),
        html.P(id="line-status", role="status"),
        html.Div(id="parts"),
    )


def _plan() -> Component:
    rig = dcc.Textarea(id="rig", rows=4, spellCheck=False)
    return _section(
        "plan",
        "Plan the next drops",
        note("What your rig can set, at first the ranges of these data. The plan is for what the last search of this "
             "page left open."),
        html.Div(id="rig-fields", className="wide"),
        html.Details([html.Summary("As a command"), html.P(rig, className="line")]),
        controls(button("plan-drops", "Plan 20 drops")),
        dcc.Loading(html.Div(id="planned"), type="dot"),
    )  # fmt: skip


def _keep() -> Component:
    return _section(
        "keep",
        "Keep it",
        controls(
            dcc.RadioItems(id="export-to", options=[*TARGETS], value="c", inline=True, className="forms"),
            button("export", "Export the model"),
        ),
        controls(
            button("diagnosis-save", "Save run"),
            button("list-runs", "Saved runs"),
            button("compare-runs", "Compare them"),
            button("experiment", "Experiment file"),
        ),
        note(
            "This page's URL stores your session: bookmark or share it. Save run diagnoses the model as it is and "
            "writes a run folder."
        ),
        html.H3("The same model from the shell"),
        html.Pre(id="command"),
        dcc.Download(id="download"),
        html.P(id="runs-status", role="status"),
        html.Div(id="runs"),
    )
