"""Parts of several panes: bars of errors with intervals as in the report, figures, buttons."""

from collections.abc import Sequence
from typing import Any

from dash import html
from dash.development.base_component import Component

from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.report.text import brief_interval

Children = Sequence[Component | str] | Component | str


def press(kind: str, text: str, of: str = "", label: str = "") -> Component:
    """Return a button that changes the session: the kind of its action, and what it is about."""
    named: dict[str, Any] = {"data-press": kind, "data-of": of} | ({"aria-label": label} if label else {})
    return html.Button(text, type="button", **named)


def button(identity: str, text: str) -> Component:
    """Return a button that does something else, by its identity."""
    return html.Button(text, id=identity, n_clicks=0, type="button")


def progress_bar(identity: str, what: str) -> Component:
    """Return a bar from 0 to 1, hidden until something runs."""
    named: dict[str, Any] = {"aria-label": what}
    return html.Progress(id=identity, value="0", max="1", hidden=True, **named)


def figure(identity: str, what: str) -> Component:
    """Return the place of a figure, which the scripts of the report draw."""
    described: dict[str, Any] = {"data-what": what, "aria-label": what}
    return html.Figure([html.Div(id=identity, className="plot", role="img", **described), html.Figcaption(what)])


def bars(rows: Sequence[tuple[str, Interval]], most: float) -> Component:
    """Return a table of errors: name, number with interval, bar that ends at `most`."""
    cells = [
        html.Tr([html.Th(name, scope="row"), html.Td(brief_interval(x), className="value"), html.Td(bar(x, most))])
        for name, x in rows
    ]
    return html.Table(html.Tbody(cells), className="bars")


def bar(error: Interval, most: float) -> Component:
    """Return a bar up to the mean, with its interval."""
    low, high = max(error.low, 0.0), min(error.high, most)
    mean = {"width": f"{100 * min(max(error.mean, 0.0), most) / most:.2f}%"}
    ends = {"left": f"{100 * min(low, most) / most:.2f}%", "width": f"{100 * max(high - low, 0.0) / most:.2f}%"}
    return html.Div([html.I(style=mean), html.B(style=ends)], className="scale")


def note(text: Children) -> Component:
    """Return a remark in small print."""
    return html.P(text, className="note")
