"""Small components of the page: buttons, progress, figures, and bars of errors as in the report."""

import math
from collections.abc import Iterable
from typing import Any

from dash import html
from dash.development.base_component import Component

from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.report.text.numbers import brief_interval

Child = Component | str


def action_button(action: str, text: str, of: str = "", label: str = "", identity: str = "") -> Component:
    """Return a button that changes the session: its action, and the object of the action."""
    known = {"data-action": action, "data-of": of, "aria-label": label or None, "id": identity or None}
    named: dict[str, Any] = {name: value for name, value in known.items() if value is not None}
    return html.Button(text, type="button", **named)


def button(identity: str, text: str, hidden: bool = False) -> Component:
    """Return a button for a callback of its own."""
    return html.Button(text, id=identity, n_clicks=0, type="button", hidden=hidden)


def run_controls(kind: str, label: str) -> list[Component]:
    """Return progress, a button that cancels, and the status of a background run."""
    named: dict[str, Any] = {"aria-label": label}
    return [
        html.Progress(id=f"{kind}-bar", value="0", max="1", hidden=True, **named),
        button(f"{kind}-cancel", "Cancel", hidden=True),
        html.Span(id=f"{kind}-status", className="note", role="status"),
    ]


def controls(*children: Child) -> Component:
    """Return a line of controls."""
    return html.P(list(children), className="controls")


def figure(identity: str, caption: str) -> Component:
    """Return the place of a figure, which a script draws."""
    described: dict[str, Any] = {"data-what": caption, "aria-label": caption}
    return html.Figure([html.Div(id=identity, className="plot", role="img", **described), html.Figcaption(caption)])


def bars(errors: Iterable[tuple[str, Interval]], largest: float) -> Component:
    """Return a table of errors: name, number with interval, bar that ends at `largest`."""
    cells = [
        html.Tr(
            [
                html.Th(name, scope="row"),
                html.Td(brief_interval(x), className="value"),
                html.Td(bar(x, largest), className="bar"),
            ]
        )
        for name, x in errors
    ]
    return html.Table(html.Tbody(cells), className="bars")


def bar(error: Interval, largest: float) -> Component:
    """Return a bar up to the mean, with its interval; one that is longer than there is room fades out."""
    low, high = (error.mean if math.isnan(end) else end for end in (error.low, error.high))
    whole, low, high = error.mean <= largest, max(low, 0.0), min(high, largest)
    mean = {"width": f"{100 * min(max(error.mean, 0.0), largest) / largest:.2f}%"}
    ends = {
        "left": f"{100 * min(low, largest) / largest:.2f}%",
        "width": f"{100 * max(high - low, 0.0) / largest:.2f}%",
    }
    return html.Div(
        [html.I(style=mean), *([html.B(style=ends)] if whole else [])], className="scale" if whole else "scale beyond"
    )


def items(rows: list[list[Child]], head: str = "") -> list[Component]:
    """Return a list without bullets below a heading; nothing if it is empty."""
    if not rows:
        return []
    shown = html.Ul([html.Li(row) for row in rows], className="plain")
    return [html.H4(head), shown] if head else [shown]


def note(*text: Child) -> Component:
    """Return a remark in small print."""
    return html.P(list(text), className="note")
