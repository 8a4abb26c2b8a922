"""The frame of the page: title, data, the line that stays in view, panes, and what is kept in the browser."""

import secrets
from collections.abc import Sequence

from dash import dcc, html
from dash.development.base_component import Component

from contactlearn.data.audit.result import Finding
from contactlearn.report.text import correct_setting, sentence
from contactlearn.workbench.panes import compare, fails, hints, missing, model, saved
from contactlearn.workbench.panes.parts import button, note, press
from contactlearn.workbench.session import Session
from contactlearn.workbench.studies import STUDIES

_FIGURES = ("data", "model", "trial", "windows", "curve")
STORES = (*(f"{name}-sent" for name in _FIGURES), "fitted", "settled", "acted", "done")
SINKS = (*(f"{name}-drawn" for name in _FIGURES), "slider-drawn", "drag-drawn", "done-drawn")
_WORDS = (
    "Words as on a command line. The shape of the body, in m, as "
    "data.shape={kind:ellipse,semi_axes:[0.035,0.025]}; without it some effects cannot be decided."
)


def page_layout(largest: int) -> Component:
    """Return the whole page before anything is known, with a name of its own for each tab.

    Args:
        largest: bytes of a file that may be dropped.
    """
    kept: list[Component] = [dcc.Store(id=name) for name in STORES]
    kept += [html.Div(id=name, hidden=True) for name in SINKS]
    kept += [
        dcc.Store(id="tab", data=secrets.token_hex(8)),
        dcc.Location(id="address", refresh=False),
        dcc.Store(id="history", storage_type="session"),
        dcc.Store(id="job", storage_type="session"),
        *(dcc.Store(id=f"{kind}-study", storage_type="session") for kind in STUDIES),
        dcc.Interval(id="clock", interval=1000, disabled=True),
        dcc.Interval(id="study-clock", interval=700, disabled=True),
    ]
    panes = [compare.compare_pane(), fails.fails_pane(), missing.missing_pane(), model.model_pane(), saved.saved_pane()]
    return html.Div([*kept, _head(largest), _bar(), hints.hints_pane(), html.Main(panes, id="main", tabIndex="-1")])


def _head(largest: int) -> Component:
    """Title and data."""
    return html.Header(
        [
            html.A("Skip to the panes", href="#main", className="skip"),
            html.H1("contactlearn workbench"),
            html.P(id="source"),
            html.Div(id="mistakes", role="status"),
            html.Details(
                [
                    html.Summary("Other data"),
                    dcc.Upload(
                        "Drop a table here (.csv or .parquet), or choose one", id="upload", className="drop",
                        max_size=largest, accept=".csv,.parquet",
                    ),
                    html.P(
                        [
                            dcc.Input(id="words", type="text", autoComplete="off", spellCheck=False,
                                      placeholder="data=mystery data.seed=7"),
                            button("load", "Load"),
                        ],
                        className="controls line",
                    ),
                    note(_WORDS),
                    html.Div(id="findings"),
                ]
            ),
        ]
    )  # fmt: skip


def _bar() -> Component:
    """The line that stays in view: the error, undo and redo."""
    return html.Div(
        [
            html.Span("…", id="said", role="status"),
            html.Span(id="said-moving"),
            html.Span(
                [
                    press("undo", "Undo"),
                    press("redo", "Redo"),
                    press("alone", "Law alone"),
                ],
                className="controls",
            ),
            html.Span(id="trouble", role="alert"),
        ],
        id="bar",
        className="bar",
    )


def audit_notes(found: Sequence[Finding]) -> list[Component]:
    """Return what the audit says of sound data."""
    rows = [html.Li(sentence(one.sentence)) for one in found if not one.mistake]
    return [html.Ul(rows)] if rows else []


def mistakes(found: Sequence[Finding], session: Session, loaded: bool = True) -> list[Component]:
    """Return what is wrong with the data, a button that corrects it, and one that takes corrections back.

    Data that could not be loaded as they are, are loaded corrected.
    """
    wrong = [one for one in found if one.mistake]
    names = [one.correction for one in wrong if one.correction]
    shown: list[Component] = [html.Ul([html.Li(sentence(one.sentence)) for one in wrong])] if wrong else []
    if names and loaded:
        way = press("correct", "Correct it", of=",".join(names))
    elif names:
        way = press("adopt", "Load it corrected", of=session.corrected([*session.corrections, *names]).address)
    else:
        way = None
    if way is not None:
        shown.append(html.P([way, " ", html.Code(correct_setting(session.corrections, wrong))]))
    if session.corrections and loaded:
        said = f"Corrected: {', '.join(session.corrections)}. "
        shown.append(html.P([said, press("uncorrect", "As measured", label="Take the corrections back")]))
    return shown
