"""The model: law, effects with values and sliders, lines of mathematics, the ladder, the noise floor."""

import math
from collections.abc import Sequence

from dash import dcc, html
from dash.development.base_component import Component

from contactlearn.core.numerics import is_number, measured
from contactlearn.diagnosis.error_budget import NoiseFloor
from contactlearn.effects import Effect, Parameter, catalogue
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.report.text import brief_interval, effect_label, label, law_label
from contactlearn.report.text.names import NOISE_SOURCES
from contactlearn.workbench.lines import EXAMPLE, name_of
from contactlearn.workbench.models import Fitted, Moved
from contactlearn.workbench.panes.parts import bars, note, press
from contactlearn.workbench.session import Session

_STEPS, _SIGMAS, _LEAST = 400, 25.0, 0.1  # of a slider: steps, reach in standard errors, least share of the range
_OPTIONS = {
    "v_ref": "Reference speed (m/s)",
    "omega_s": "Spin below which it fades (rad/s)",
    "span": "From x, to x (m)",
}


def model_pane() -> Component:
    """Return the pane before anything is known."""
    return html.Section(
        [
            html.H2("The model"),
            html.H3("Ladder"),
            html.Div(id="ladder"),
            html.H3("A line of mathematics"),
            html.P(
                [
                    dcc.Input(id="line", type="text", placeholder=EXAMPLE, autoComplete="off", spellCheck=False),
                    press("line", "Add"),
                ],
                className="controls line",
            ),
            html.Datalist(id="completions"),
            html.P(id="line-said", role="status"),
            html.Div(id="parts"),
            html.Div(id="curves", className="cards"),
        ],
        id="model",
    )  # fmt: skip


def parts(session: Session, fitted: Fitted, moved: Moved) -> list[Component]:
    """Return law, effects and lines with their parameters."""
    values = dict(zip((p.name for p in fitted.fit.parameters), moved.values.tolist(), strict=True))
    errors = dict(zip((p.name for p in fitted.fit.parameters), fitted.fit.standard_errors.tolist(), strict=True))
    best = dict(zip((p.name for p in fitted.fit.parameters), fitted.fit.values.tolist(), strict=True))
    hand, warned = {name for name, _ in session.hand}, fitted.fit.undetermined() | fitted.fit.at_bounds()

    def sliders(prefix: str) -> list[Component]:
        mine = [p for p in fitted.fit.parameters if p.name.rpartition(".")[0] == prefix]
        return [
            _slider(p, best[p.name], errors[p.name], values[p.name], p.name in hand, warned.get(p.name, ""))
            for p in mine
        ]

    found: list[Component] = [html.Div([html.H3(law_label(session.law)), *sliders("")], className="part")]
    for one in session.effects:
        effect = fitted.effects[one.name]
        head = html.H3(
            [effect_label(one), " ", press("drop", "Remove", of=one.name, label=f"Remove {effect_label(one)}")]
        )
        found.append(
            html.Div(
                [head, *_forms(effect), *_options(effect), note(effect.equation), *sliders(one.name)], className="part"
            )
        )
    for place, line in enumerate(session.lines):
        head = html.H3([html.Code(line), " ", press("unline", "Remove", of=str(place), label=f"Remove {line}")])
        found.append(html.Div([head, *sliders(name_of(place))], className="part"))
    return found


def ladder_bars(session: Session, steps: Sequence[Fitted], floor: NoiseFloor) -> list[Component]:
    """Return the errors of the law, then with one effect more each, and of noise alone."""
    names = [law_label(session.law), *(f"+ {effect_label(one)}" for one in session.effects)]
    names += [f"+ {line.partition(';')[0]}" for line in session.lines]
    rows: list[tuple[str, Interval]] = [
        *zip(names, (one.error for one in steps), strict=True),
        ("Noise floor", floor.error),
    ]
    most = 1.05 * max(x.high for _, x in rows)
    return [
        bars(rows, most),
        note(f"Held-out errors. The noise floor is {NOISE_SOURCES[floor.source]}, of all trials."),
    ]


def model_title(session: Session) -> str:
    """Name the model of a session."""
    parts = [
        law_label(session.law),
        *map(effect_label, session.effects),
        *(line.partition(";")[0] for line in session.lines),
    ]
    return " + ".join(parts) + (" (by hand)" if session.hand else "")


def said(fitted: Fitted, moved: Moved, alone: Fitted, by_hand: bool) -> tuple[str, str, str]:
    """Return the error of the model in one line: what stands before the number, the number, and what follows it."""
    share = moved.error.mean / alone.error.mean - 1 if alone.error.mean else 0.0
    change = f"{'−' if share < 0 else '+'}{abs(100 * share):.0f}\u00a0%" if fitted is not alone or by_hand else ""
    rest = f", {change} against the law alone" if change else ""
    rest += f"; moved by hand, fitted {brief_interval(fitted.error)}" if by_hand else ""
    return "Held-out error ", brief_interval(moved.error), rest


def _slider(p: Parameter, best: float, error: float, value: float, by_hand: bool, warning: str) -> Component:
    """A parameter with its fitted value, and a slider to move it by hand."""
    low, high = _reach(p, best, error)
    text = f"{p.symbol} = {measured(best, error, p.unit)}" + (f"; by hand {value:.4g}" if by_hand else "")
    reset = [press("fit", "Fitted value", of=p.name, label=f"Fitted value of {p.symbol}")] if by_hand else []
    return html.Div(
        [
            html.Label([html.Span(text), *reset], className="said"),
            dcc.Slider(
                id={"set": "slider", "of": p.name},
                min=low,
                max=high,
                step=(high - low) / _STEPS,
                value=min(max(value, low), high),
                marks=None,
                updatemode="mouseup",
                allow_direct_input=False,
            ),
            *([note(warning)] if warning else []),
        ],
        className="parameter",
    )


def _reach(p: Parameter, best: float, error: float) -> tuple[float, float]:
    """Ends of a slider: some standard errors around the fitted value, within the plausible range."""
    half = max(_SIGMAS * error if math.isfinite(error) else 0.0, _LEAST * (p.high - p.low))
    return max(p.low, best - half), min(p.high, best + half)


def _forms(effect: Effect) -> list[Component]:
    """A choice among the forms of an effect that has several."""
    if effect.form is None:
        return []
    names = [kind.form for kind in catalogue()[effect.name]]
    options = [{"label": label(name), "value": name} for name in names if name is not None]
    return [
        dcc.RadioItems(
            id={"set": "form", "of": effect.name}, options=options, value=effect.form, inline=True, className="forms"
        )
    ]


def _options(effect: Effect) -> list[Component]:
    """The constants of an effect that are not fitted, numbers, to be set by hand; empty is the default."""
    found: list[Component] = []
    for name, value in effect.options.items():
        numbers = value if isinstance(value, tuple) else (value,)
        if not numbers or not all(map(is_number, numbers)):
            continue
        text = ", ".join(f"{x:g}" for x in numbers)
        field = dcc.Input(
            id={"set": "option", "of": f"{effect.name}.{name}"}, type="text", value=text, autoComplete="off"
        )
        found.append(html.Label([f"{_OPTIONS.get(name, label(name))} ", field], className="option"))
    return found
