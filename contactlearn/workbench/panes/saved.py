"""Saved runs of the folder `outputs`: opened, compared, taken over; and the session as command and experiment file."""

from collections.abc import Sequence

from dash import dcc, html
from dash.development.base_component import Component

from contactlearn.workbench.panes.parts import button, note, press
from contactlearn.workbench.saved import SavedRun

_HEAD = "The address of this page is the session. Save run diagnoses the model as it is and writes a run folder."


def saved_pane() -> Component:
    """Return the pane before anything is known."""
    return html.Section(
        [
            html.H2("Keep it"),
            html.P(
                [
                    button("save", "Save run"),
                    button("experiment", "Experiment file"),
                    button("list-runs", "Saved runs"),
                    button("compare-runs", "Compare them"),
                ],
                className="controls",
            ),
            note(_HEAD),
            html.H3("The same model from the shell"),
            html.Pre(id="command"),
            dcc.Download(id="download"),
            html.P(id="runs-said", role="status"),
            html.Div(id="runs"),
        ],
        id="keep",
    )  # fmt: skip


def run_list(runs: Sequence[SavedRun]) -> list[Component]:
    """Return the runs, the newest first."""
    if not runs:
        return [note("There are no runs yet.")]
    rows: list[Component] = []
    for one in runs:
        parts: list[Component | str] = [html.Code(one.name), f" ({one.kind}): {one.said} "]
        if one.page:
            parts += [html.A("open", href=f"/runs/{one.name}/report.html", target="_blank"), " "]
        if one.session is not None:
            parts.append(press("adopt", "Take its model", of=one.session.address))
        rows.append(html.Li(parts))
    return [html.Ul(rows, className="plain")]
