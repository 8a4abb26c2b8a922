"""What is missing: the effects with what each would take off, the search, what remains, the next experiment."""

from collections.abc import Sequence
from typing import Any

from dash import dcc, html
from dash.development.base_component import Component

from contactlearn.diagnosis.result import Diagnosis, FrontierModel, PlausibleModel
from contactlearn.effects import catalogue
from contactlearn.report.text import (
    effect_label,
    error,
    headline,
    label,
    listed_models,
    percent,
    phrase,
    phrases,
    search_notes,
    share_of_whole,
)
from contactlearn.results.diagnosis import DiagnosisRun
from contactlearn.workbench.lines import line_of
from contactlearn.workbench.panes.parts import bars, button, note, press, progress_bar
from contactlearn.workbench.promises import Promise
from contactlearn.workbench.session import Session

_HEAD = (
    "Tick an effect: law and effects are fitted again together. Behind each stands the held-out error that it would "
    "leave, estimated from the present model."
)


def missing_pane() -> Component:
    """Return the pane before anything is known."""
    return html.Section(
        [
            html.H2("What is missing"),
            note(_HEAD),
            dcc.Checklist(
                id={"set": "ticks", "of": ""},
                options=[{"label": label(name), "value": name} for name in catalogue()],
                value=[],
                className="rows effects",
            ),
            html.P(
                [
                    button("search", "Search laws and effects"),
                    progress_bar("job-bar", "Search laws and effects"),
                    html.Button("Cancel", id="cancel", n_clicks=0, type="button", hidden=True),
                    html.Span(id="job-said", role="status"),
                ],
                className="controls",
            ),
            html.Pre(id="job-lines", hidden=True),
            html.Div(id="found"),
        ],
        id="missing",
    )  # fmt: skip


def effect_options(session: Session, promises: Sequence[Promise], present: float) -> list[dict[str, Any]]:
    """Return all effects: those in the model first, then the most promising, then those that promise nothing."""
    options: list[dict[str, Any]] = [
        _option(one.name, effect_label(one), "in the model", True) for one in session.effects
    ]
    best = {one.effect.name: one for one in reversed(promises)}  # the best form of each
    for one in sorted(best.values(), key=lambda one: (one.gain <= 0, one.error if one.gain > 0 else 0.0)):
        said, helps = "promises nothing", one.gain > 0 and one.error < present
        if helps:
            said = f"{error(one.error)} ({percent(one.error / present - 1)})"
        options.append(
            _option(one.effect.name, effect_label(one.effect) if helps else label(one.effect.name), said, helps)
        )
    shown = {option["value"] for option in options}
    left = [
        _option(name, label(name), "cannot be decided by these data", False)
        for name in catalogue()
        if name not in shown
    ]
    return options + left


def _option(name: str, text: str, said: str, strong: bool) -> dict[str, Any]:
    parts = [html.Span(text, className="name"), html.Span(said, className="value" if strong else "value faint")]
    return {"label": html.Span(parts, className="row"), "value": name}


def found_content(run: DiagnosisRun, folder: str, session: Session) -> list[Component]:
    """Return what a diagnosis found: verdict, frontier, plausible models, what remains, the next experiment."""
    found = run.diagnosis
    page = html.A("the whole report", href=f"/runs/{folder}/report.html", target="_blank")
    return [
        html.H3("What the search found"),
        html.P(headline(found), className="headline"),
        note(["Of ", html.Code(folder), ": ", page, "."]),
        *_frontier(found, session),
        *_plausible(found, session),
        *_remains(found),
        *_experiment(found),
    ]


def _take(text: str, session: Session, found: FrontierModel | PlausibleModel) -> Component:
    """A button that goes to the same data with another model."""
    other = Session(
        data=session.data, seed=session.seed, trial=session.trial, law=found.law, effects=tuple(found.effects)
    )
    return press("adopt", text, of=other.address, label=f"Take {phrase('model', found.law, found.effects)}")


def _frontier(found: Diagnosis, session: Session) -> list[Component]:
    if not found.frontier:
        return []
    most = 1.05 * max(one.error.high for one in found.frontier)
    rows = [(phrase("model", one.law, one.effects), one.error) for one in found.frontier]
    takes = [_take(f"Take {len(one.effects)}", session, one) for one in found.frontier]
    head = "The best model of each number of effects, held out:"
    return [html.H4("Frontier"), note(head), bars(rows, most), html.P(takes, className="controls")]


def _plausible(found: Diagnosis, session: Session) -> list[Component]:
    rows = [
        html.Li([_take("Take", session, one), f" {share_of_whole(one.share)}  {phrase('model', one.law, one.effects)}"])
        for one in listed_models(found)
    ]
    if not rows:
        return []
    said = [html.P(text) for text in search_notes(found)]
    return [html.H4("Models that these data cannot tell apart"), html.Ul(rows, className="plain"), *said]


def _remains(found: Diagnosis) -> list[Component]:
    if found.remainder is None:
        return []
    said = [html.P(text) for text in phrases("residual", found.remainder)]
    lines = [
        html.Li([press("line", "Add", of=line_of(one)), f" {phrase('formula_change', one)}"]) for one in found.formulas
    ]
    return [html.H4("What remains"), *said, *([html.Ul(lines, className="plain")] if lines else [])]


def _experiment(found: Diagnosis) -> list[Component]:
    if found.experiment is None:
        return []
    needed = [html.P(phrase("needed_drops", one)) for one in found.experiment.separations]
    drops = [html.Li(phrase("drop", one, found.experiment)) for one in found.experiment.drops]
    return [html.H4("The next experiment"), *needed, html.Ol(drops)]
