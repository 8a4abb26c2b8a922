"""Compare: every law alone, Best Post Hoc, the rigid bound and the model, on the same held-out trials."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from dash import dcc, html
from dash.development.base_component import Component

from contactlearn import laws
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.report.text import brief_interval, law_label
from contactlearn.report.text.names import model_label
from contactlearn.workbench.models import Compared, Fitted
from contactlearn.workbench.panes.parts import bar, bars, button, figure, note, progress_bar

_HEAD = "Errors on held-out trials. Choose the law on which the model is built."
_CURVE = "Mean error on the held-out trials against the number of training trials"


def compare_pane() -> Component:
    """Return the pane before anything is known."""
    return html.Section(
        [
            html.H2("Compare"),
            note(_HEAD),
            dcc.RadioItems(
                id={"set": "law", "of": ""},
                options=[{"label": law_label(name), "value": name} for name in laws.names()],
                className="rows",
            ),
            html.Div(id="bounds"),
            _study("learned", "Learned models"),
            html.Div(id="learned-found"),
            _study("curve", "Learning curve"),
            html.Div(figure("curve", _CURVE), id="curve-place", hidden=True),
        ],
        id="compare",
    )  # fmt: skip


def _study(kind: str, text: str) -> Component:
    """A button that starts a study, its progress, and a button that cancels it."""
    parts: list[Component] = [
        button(f"{kind}-ask", text),
        progress_bar(f"{kind}-bar", text),
        html.Button("Cancel", id=f"{kind}-cancel", n_clicks=0, type="button", hidden=True),
        html.Span(id=f"{kind}-said", className="note", role="status"),
    ]
    return html.P(parts, className="controls")


def learned_bars(errors: Mapping[str, Interval], title: str, trials: int, most: float) -> list[Component]:
    """Return the learned models, the least error first."""
    rows = sorted(errors.items(), key=lambda pair: pair[1].mean)
    said = f"Trained on all {trials} training trials; those with a law learn what {title} leaves."
    return [bars([(model_label(name), error) for name, error in rows], most), note(said)] if rows else []


def law_options(found: Sequence[Compared], most: float) -> list[dict[str, Any]]:
    """Return every law as an option with its error, the least first; laws that were not compared are at the end."""
    compared = {one.name: one.error for one in found}
    options: list[dict[str, Any]] = []
    for name in sorted(laws.names(), key=lambda name: compared[name].mean if name in compared else math.inf):
        text: list[Component] = [html.Span(law_label(name), className="name")]
        if name in compared:
            text += [html.Span(brief_interval(compared[name]), className="value"), bar(compared[name], most)]
        options.append({"label": html.Span(text, className="row"), "value": name})
    return options


def beside(found: Sequence[Compared], fitted: Fitted, name: str, most: float) -> Component:
    """Return the bounds and the model."""
    rows = [(model_label(one.name), one.error) for one in found if one.name not in laws.names()]
    return bars([*rows, (name, fitted.error)], most)


def largest(found: Sequence[Compared], fitted: Fitted) -> float:
    """Return the error at the end of the bars: that of the worst law that is not hopeless."""
    return 1.05 * min(
        max(one.error.high for one in found), 3 * max(fitted.error.high, min(one.error.high for one in found))
    )
