"""Where it fails: the map of errors over two variables, regions, and the selected trial."""

from collections.abc import Sequence
from typing import Any

from dash import html
from dash.development.base_component import Component

from contactlearn.diagnosis.result import Region
from contactlearn.report.text import capitalize_first, fix_spacing, phrase
from contactlearn.workbench.panes.parts import figure, note, press

_MAP = (
    "Error of each trial; draw a box to select trials, or write its ends below; click one trial to see it. The colours "
    "keep the scale of the law alone"
)
_BODY = "The body at contact: velocities as arrows, spins as arcs, before, after as measured and as predicted"
_IMPULSES = "Impulse space: admissible impulses, impulse and reach of each law, measured impulse"
_STEPS = (("worst", "Worst"), ("worse", "Next worse"), ("previous", "Previous"), ("next", "Next"))


def fails_pane() -> Component:
    """Return the pane before anything is known."""
    named: dict[str, Any] = {"aria-label": "Select trials by numbers"}
    return html.Section(
        [
            html.H2("Where it fails"),
            html.P(
                [
                    _list("Across", "map-x", []),
                    _list("Up", "map-y", []),
                    _list("Errors of", "errors-of", [("ticked", "the model"), ("alone", "the law alone")]),
                    press("unselect", "Clear selection"),
                ],
                className="controls",
            ),
            figure("map", _MAP),
            html.Div(id="box", className="controls", role="group", **named),
            html.P(id="window-said", role="status"),
            html.Div(id="regions"),
            html.H3("The selected trial"),
            html.P(
                [press(kind, text) for kind, text in _STEPS],
                className="controls",
            ),
            html.P(id="trial-said", role="status"),
            html.Div(
                [
                    figure("picture", _BODY),
                    figure("impulse", _IMPULSES),
                ],
                className="pair",
            ),
        ],
        id="fails",
    )


def region_buttons(found: Sequence[Region]) -> list[Component]:
    """Return the regions in which the model fails, each to select its trials."""
    if not found:
        return [note(phrase("no_region"))]
    rows = [
        html.Li([press("region", "Select", of=str(k)), f" {fix_spacing(capitalize_first(phrase('region', one)))}"])
        for k, one in enumerate(found)
    ]
    return [html.H3("Regions in which the model fails"), html.Ul(rows, className="plain")]


def _list(text: str, identity: str, options: Sequence[tuple[str, str]]) -> Component:
    entries: list[Any] = [html.Option(words, value=value) for value, words in options]
    return html.Label([f"{text} ", html.Select(entries, id=identity)])
