"""A guided first time: five hints that walk through the loop, and the truth at the end, when asked."""

from dash import html
from dash.development.base_component import Component

from contactlearn.workbench.panes.parts import button

HINTS = (
    (
        "Compare",
        "These drops hide one to three physical effects. Under Compare every law stands beside the bounds: choose the "
        "one with the least error. It does not reach the noise floor of the ladder, so something is missing.",
    ),
    (
        "See where it fails",
        "The map shows the error of each trial. Change its axes, draw a box around the worst trials: where is the "
        "error larger, and in which variable?",
    ),
    (
        "Learn what is missing",
        "The effects are sorted by the error that each would leave. Near the top are the suspects; several can promise "
        "the same, because these data hardly distinguish them.",
    ),
    (
        "Add it",
        "Tick the first one. Law and effect are fitted together, the error in the bar falls, every figure and every "
        "promise follows. Add another while the ladder falls clearly; Undo takes a step back.",
    ),
    (
        "Check yourself",
        "Search laws and effects looks at thousands of sets and says which models cannot be told apart. Then reveal "
        "the truth.",
    ),
)
"""Title and text of each hint."""


def hints_pane() -> Component:
    """Return the hints, hidden unless the data hide something."""
    return html.Aside(
        [
            html.P([html.B(id="hint-title"), " ", html.Span(id="hint-text")], role="status"),
            html.P(
                [
                    button("hint-next", "Next hint"),
                    html.Button("Reveal the truth", id="reveal", n_clicks=0, type="button", hidden=True),
                    button("hint-end", "No more hints"),
                ],
                className="controls",
            ),
            html.Pre(id="truth", hidden=True),
        ],
        id="hints",
        hidden=True,
    )
