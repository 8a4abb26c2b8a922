"""The content of the panes: functions from typed results to components."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from dash import dcc, html
from dash.development.base_component import Component

from contactlearn import laws
from contactlearn.cli.config_files import summaries
from contactlearn.core.numerics import is_number, measured
from contactlearn.data.audit.result import Finding
from contactlearn.diagnosis.error_budget import NoiseFloor
from contactlearn.diagnosis.result import Diagnosis, FrontierModel, PlausibleModel, Region
from contactlearn.effects import Effect, Parameter, catalogue
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.mechanics.apparatus import Row
from contactlearn.mechanics.impacts import Impacts
from contactlearn.planning.rig import HEIGHT, settings_of
from contactlearn.report.text.names import (
    NOISE_SOURCES,
    capitalize_first,
    effect_label,
    label,
    law_label,
    model_label,
    sentence,
)
from contactlearn.report.text.numbers import brief_interval, error, fix_spacing, share_of_whole
from contactlearn.report.text.sentences import (
    correct_setting,
    headline,
    listed_models,
    names_by_level,
    phrase,
    phrases,
    searched_name,
)
from contactlearn.results.types import DiagnosisRun
from contactlearn.workbench.components import Child, action_button, bar, bars, controls, items, note
from contactlearn.workbench.lines import formula_line, line_name
from contactlearn.workbench.models import FittedModel, ManualModel, PredictedGain
from contactlearn.workbench.session import Session

_STEPS, _SIGMAS, _LEAST = 400, 25.0, 0.1  # of a slider: steps, half width in standard errors, least share of the range
_OPTIONS = {
    "v_ref": "Reference speed (m/s)",
    "omega_s": "Spin below which it fades (rad/s)",
    "span": "From x, to x (m)",
}

_OF_A_RIG = {
    HEIGHT: "m", "x": "m", "y": "m", "theta": "rad", "omega": "rad/s", "w_x": "rad/s", "w_y": "rad/s", "w_z": "rad/s"
}  # fmt: skip
"""Units of what a rig sets, by name."""

# --- Header and bar ----------------------------------------------------------------------------


def mistakes(found: Sequence[Finding], session: Session, loaded: bool = True) -> list[Component]:
    """Return the mistakes and an unstated shape of the data, with buttons that correct them and take corrections back.

    Data that could not be loaded (`loaded=False`) are loaded corrected.
    """
    wrong = [one for one in found if one.mistake or one.correction or one.name == "rig_applied"]
    names = [one.correction for one in wrong if one.correction]
    shown: list[Component] = [html.Ul([html.Li(_said(one)) for one in wrong])] if wrong else []
    shown += [rig_card(one.rig) for one in found if one.rig]
    if names:
        correct = action_button("correct", "Correct it", of=",".join(names))
        if not loaded:
            address = session.corrected([*session.corrections, *names]).address
            correct = action_button("adopt", "Load it corrected", of=address)
        shown.append(html.P([correct, " ", html.Code(correct_setting(session.corrections, wrong))]))
    if session.corrections and loaded:
        back = action_button("uncorrect", "As measured", label="Take the corrections back")
        shown.append(html.P([f"Corrected: {', '.join(session.corrections)}. ", back]))
    return shown


def _said(finding: Finding) -> str:
    """A finding in words, with what shows it."""
    return " ".join(map(sentence, filter(None, (finding.sentence, finding.grounds))))


def rig_card(rows: Sequence[Row]) -> Component:
    """Return the rig card as a table; bold values differ by more than three errors from what is stated."""
    head = html.Tr([html.Th(name, scope="col") for name in ("Set-up", "Measured", "Stated", "Known from")])
    cells = [
        (
            html.Th(row.quantity, scope="row"),
            (html.B if row.differs else html.Span)(row.measured),
            row.said,
            row.known_from,
        )
        for row in rows
    ]
    body = [html.Tr([name, *(html.Td(one) for one in others)]) for name, *others in cells]
    return html.Table([html.Thead(head), html.Tbody(body)])


def rig_limits(impacts: Impacts) -> dict[str, tuple[float, float]]:
    """Return what a rig sets, within the middle nine tenths of the measured values, to three digits."""
    found = dict[str, tuple[float, float]]()
    for name, values in settings_of(impacts).items():
        low, high = values.quantile(values.new_tensor([0.05, 0.95])).tolist()
        if name in _OF_A_RIG and high > low:
            found[name] = float(f"{low:.3g}"), float(f"{high:.3g}")
    return found


def rig_words(limits: Mapping[str, tuple[float, float]]) -> str:
    """Write what a rig sets, as on a command line."""
    return " ".join(f"rig.{name}=[{low:g},{high:g}]" for name, (low, high) in limits.items())


def rig_fields(limits: Mapping[str, tuple[float, float]]) -> Component:
    """Return a lowest and a highest value to set for each quantity that a rig sets."""
    head = html.Tr([html.Th(text, scope="col") for text in ("The rig sets", "from", "to")])
    rows = list[Component]()
    for name, ends in limits.items():
        text = f"{label(name)} ({_OF_A_RIG[name]})"
        cells: list[Component] = [html.Th(text, scope="row")]
        for end, value in zip(("low", "high"), ends, strict=True):
            field = dcc.Input(id={"limit": end, "of": name}, type="number", value=value, step="any")
            cells.append(html.Td(html.Label([html.Span(f"{text}, {end}", className="skip"), field])))
        rows.append(html.Tr(cells))
    return html.Table([html.Thead(head), html.Tbody(rows)])


def model_title(session: Session) -> str:
    """Name the model of a session."""
    names = [law_label(session.law), *map(effect_label, session.effects)]
    names += [line.partition(";")[0] for line in session.lines]
    return " + ".join(names) + (" (by hand)" if session.manual else "")


def error_summary(
    session: Session, fitted: FittedModel, manual: ManualModel, law_alone: FittedModel
) -> tuple[str, str, str]:
    """Return the error of the model in one line: the text before the number, the number, and the text after it."""
    change = manual.error.mean / law_alone.error.mean - 1 if law_alone.error.mean else 0.0
    rest = ""
    if fitted is not law_alone or session.manual:
        rest = f", {'−' if change < 0 else '+'}{abs(100 * change):.0f}\u00a0%"
    if session.manual:
        rest += f"; set by hand, fitted {brief_interval(fitted.error)}"
    return "Held-out error ", brief_interval(manual.error), rest


# --- Compare -----------------------------------------------------------------------------------


def largest_error(errors: Mapping[str, Interval], fitted: FittedModel) -> float:
    """Return the error at the end of the bars: the largest one, but at most three times that of the best or the model.

    Laws that are hopeless do not set the scale.
    """
    highs = [error.high for error in errors.values()]
    return 1.05 * min(max(highs), 3 * max(fitted.error.high, min(highs)))


def law_options(errors: Mapping[str, Interval], largest: float) -> list[dict[str, Any]]:
    """Return every law as an option with its error, the smallest first; laws without an error are at the end."""
    options: list[dict[str, Any]] = []
    for name in sorted(laws.names(), key=lambda name: errors[name].mean if name in errors else math.inf):
        row: list[Component] = [html.Span(law_label(name), className="name")]
        if name in errors:
            row += [html.Span(brief_interval(errors[name]), className="value"), bar(errors[name], largest)]
        options.append({"label": html.Span(row, className="row"), "value": name})
    return options


def bounds(errors: Mapping[str, Interval], session: Session, error: Interval, largest: float) -> Component:
    """Return the errors of the bounds, and of the model if it is more than the law."""
    rows = [(model_label(name), error) for name, error in errors.items() if name not in laws.names()]
    own = [(model_title(session), error)] if session.effects or session.lines or session.manual else []
    shown = [bars(own, largest), html.Div(bars(rows, largest), className="noise"), note(phrase("bounds", "mass"))]
    return html.Div(shown)


def learned_bars(errors: Mapping[str, Interval], session: Session, trials: int, largest: float) -> list[Component]:
    """Return the errors of the learned models, the smallest first."""
    if not errors:
        return []
    rows = [(model_label(name), error) for name, error in sorted(errors.items(), key=lambda pair: pair[1].mean)]
    text = f"Trained on all {trials} training trials; those with a law learn the residual of {model_title(session)}."
    return [bars(rows, largest), note(text)]


# --- Where it fails ----------------------------------------------------------------------------


def region_buttons(found: Sequence[Region]) -> list[Component]:
    """Return the regions in which the model fails, each with a button that selects its trials."""
    if not found:
        return [note(phrase("no_region"))]
    rows: list[list[Child]] = [
        [action_button("region", "Select", of=str(k)), f" {fix_spacing(capitalize_first(phrase('region', one)))}"]
        for k, one in enumerate(found)
    ]
    return [html.H3("Regions in which the model fails"), *items(rows)]


# --- What is missing ---------------------------------------------------------------------------


def effect_options(session: Session, gains: Sequence[PredictedGain], present: float) -> list[dict[str, Any]]:
    """Return all effects: those in the model, then by predicted error, then those without a predicted gain."""
    options = [_effect_option(effect.name, effect_label(effect), "", True) for effect in session.effects]
    best = {gain.effect.name: gain for gain in reversed(gains)}  # the best form of each
    for one in sorted(best.values(), key=lambda one: (one.gain <= 0, one.error if one.gain > 0 else 0.0)):
        name = one.effect.name
        if one.gain > 0 and one.error < present:
            less = share_of_whole(1 - one.error / present)
            text = f"{error(one.error)} ({less if less.startswith('<') else f'−{less}'})"
            options.append(_effect_option(name, effect_label(one.effect), text, True))
        else:
            options.append(_effect_option(name, label(name), "no predicted gain", False))
    shown = {option["value"] for option in options}
    rest = (name for name in catalogue() if name not in shown)
    return options + [_effect_option(name, label(name), "cannot be decided by these data", False) for name in rest]


def _tooltip(name: str) -> str:
    """The physics of an effect: a sentence, the formula of its first form, and where it comes from."""
    kind = catalogue()[name][0]
    about = summaries("effect").get(name) or (kind.__doc__ or "").partition("\n")[0].rstrip(".")
    return "\n".join(filter(None, (f"{about}.", kind.formula, kind.source)))


def _effect_option(name: str, text: str, value: str, strong: bool) -> dict[str, Any]:
    """A row: of a ticked effect the page shows that it is in the model, also while other values are estimated."""
    parts = [
        html.Span(text, className="name", title=_tooltip(name)),
        html.Span(value, className="value" if strong else "value faint"),
        html.Span("in the model", className="ticked"),
    ]
    return {"label": html.Span(parts, className="row"), "value": name}


def diagnosis_content(run: DiagnosisRun, folder: str, session: Session) -> list[Component]:
    """Return a diagnosis: verdict, frontier, plausible models, residual with formulas, the next experiment."""
    found = run.diagnosis
    frontier, residual, experiment = list[Component](), list[Component](), list[Component]()
    if found.frontier:
        rows = [(searched_name(found, model), model.error) for model in found.frontier]
        buttons = (_adopt_button(f"Take {len(model.effects)}", session, found, model) for model in found.frontier)
        head = note("The best model of each number of effects, held out:")
        frontier = [html.H4("Frontier"), head, bars(rows, 1.05 * max(x.high for _, x in rows)), controls(*buttons)]
    if found.remainder is not None:
        formulas: list[list[Child]] = [
            [action_button("line", "Add", of=formula_line(formula)), f" {phrase('formula_change', formula)}"]
            for formula in found.formulas
        ]
        residual = [html.H4("Residual"), *map(html.P, phrases("residual", found.remainder)), *items(formulas)]
    if found.experiment is not None:
        needed = map(html.P, phrases("needed_drops", found.experiment))
        drops = [html.Li(phrase("drop", drop, found.experiment)) for drop in found.experiment.drops]
        experiment = [html.H4("The next experiment"), *needed, html.Ol(drops)]
    page = html.A("the whole report", href=f"/runs/{folder}/report.html", target="_blank")
    plausible: list[list[Child]] = [
        [_adopt_button("Take", session, found, one), f" {share_of_whole(one.share)}  {searched_name(found, one)}"]
        for one in listed_models(found)
    ]
    command = f"contactlearn export outputs/diagnose/{folder} --to c"
    exported = [note("As a file for other programs: ", html.Code(command))] if found.law else []
    return [
        html.H3("Result of the search"),
        html.P(headline(found), className="headline"),
        note("Of ", html.Code(folder), ": ", page, "."),
        *map(html.P, [] if found.scatter is None else phrases("scatter", found.scatter)),
        *exported,
        *items([[html.B(level), f" {text}"] for level, text in names_by_level(found)]),
        *frontier,
        *items(plausible, "Models that these data cannot distinguish"),
        *map(html.P, phrases("notes", found)),
        *residual,
        *experiment,
    ]


def _adopt_button(
    text: str, session: Session, diagnosis: Diagnosis, model: FrontierModel | PlausibleModel
) -> Component:
    """Return a button that goes to the same data with a model of the search, the given effects in it."""
    given = (one for one in diagnosis.given if not one.name.startswith("line"))  # lines belong to a session
    effects = (*given, *model.effects)
    other = Session(data=session.data, seed=session.seed, trial=session.trial, law=model.law, effects=effects)
    return action_button("adopt", text, of=other.address, label=f"Take {searched_name(diagnosis, model)}")


# --- The model ---------------------------------------------------------------------------------


def ladder_bars(session: Session, steps: Sequence[FittedModel]) -> Component:
    """Return the held-out errors of the law, then with one more effect each."""
    names = [law_label(session.law), *(f"+ {effect_label(effect)}" for effect in session.effects)]
    names += [f"+ {line.partition(';')[0]}" for line in session.lines]
    return bars(zip(names, (step.error for step in steps), strict=True), _ladder_end(steps))


def floor_bar(steps: Sequence[FittedModel], floor: NoiseFloor) -> Component:
    """Return the error of noise alone, on the scale of the ladder above it."""
    shown = bars([("Noise floor", floor.error)], _ladder_end(steps))
    told = f"{NOISE_SOURCES[floor.source]}, by the best model that is found for these data: ticks do not move it"
    return html.Div(shown, className="noise", title=f"The noise floor is {told}.")


def _ladder_end(steps: Sequence[FittedModel]) -> float:
    return 1.05 * max(step.error.high for step in steps)


def parts(session: Session, fitted: FittedModel, manual: ManualModel) -> list[Component]:
    """Return law, effects and lines with their parameters."""
    names = [p.name for p in fitted.fit.parameters]
    best, errors, values = (
        dict(zip(names, column.tolist(), strict=True))
        for column in (fitted.fit.values, fitted.fit.standard_errors, manual.values)
    )
    by_hand, warnings = {name for name, _ in session.manual}, fitted.fit.undetermined() | fitted.fit.at_bounds()

    def part(prefix: str, *head: Component) -> Component:
        sliders = [
            _slider(
                p,
                best[p.name],
                errors[p.name],
                values[p.name],
                p.name in by_hand,
                warnings.get(p.name, ""),
                fitted.effects.get(prefix),
            )
            for p in fitted.fit.parameters
            if p.name.rpartition(".")[0] == prefix
        ]
        return html.Div([*head, *sliders], className="part")

    found = [part("", html.H3(law_label(session.law)))]
    for one in session.effects:
        effect, title = fitted.effects[one.name], effect_label(one)
        head = html.H3([title, " ", action_button("drop", "Remove", of=one.name, label=f"Remove {title}")])
        found.append(part(one.name, head, *_forms(effect), *_options(effect), note(effect.shown_equation)))
    for place, line in enumerate(session.lines):
        remove = action_button("unline", "Remove", of=str(place), label=f"Remove {line}")
        found.append(part(line_name(place), html.H3([html.Code(line), " ", remove])))
    return found


def _slider(
    p: Parameter, best: float, error: float, value: float, by_hand: bool, warning: str, effect: Effect | None
) -> Component:
    """Return a parameter with its fitted value, and a slider around it within the plausible range."""
    half = max(_SIGMAS * error if math.isfinite(error) else 0.0, _LEAST * (p.high - p.low))
    low, high = max(p.low, best - half), min(p.high, best + half)
    own = p.name.rpartition(".")[2]
    in_unit = lambda x: (x, error, p.unit) if effect is None else effect.in_shown_unit(own, x, error, p.unit)  # noqa: E731
    text = f"{p.symbol} = {measured(*in_unit(best))}"
    head: list[Child] = [html.Span(text)]
    if by_hand:
        head = [html.Span(f"{text}; by hand {in_unit(value)[0]:.4g}")]
        head.append(action_button("fit", "Fitted value", of=p.name, label=f"Fitted value of {p.symbol}"))
    slider = dcc.Slider(
        id={"set": "slider", "of": p.name}, min=low, max=high, step=(high - low) / _STEPS,
        value=min(max(value, low), high), marks=None, updatemode="mouseup", allow_direct_input=False,
    )  # fmt: skip
    parts = [html.Label(head, className="parameter-value"), slider, *([note(warning)] if warning else [])]
    return html.Div(parts, className="parameter")


def _forms(effect: Effect) -> list[Component]:
    """Return a choice among the forms of an effect that has several."""
    if effect.form is None:
        return []
    names = [kind.form for kind in catalogue()[effect.name] if kind.form is not None]
    identity, options = {"set": "form", "of": effect.name}, [{"label": label(name), "value": name} for name in names]
    return [dcc.RadioItems(id=identity, options=options, value=effect.form, inline=True, className="forms")]


def _options(effect: Effect) -> list[Component]:
    """Return a field for each numeric option of an effect; an empty field is the default."""
    fields: list[Component] = []
    for name, value in effect.options.items():
        numbers = value if isinstance(value, tuple) else (value,)
        if numbers and all(map(is_number, numbers)):
            identity, text = {"set": "option", "of": f"{effect.name}.{name}"}, ", ".join(f"{x:g}" for x in numbers)
            field = dcc.Input(id=identity, type="text", value=text, autoComplete="off")
            fields.append(html.Label([f"{_OPTIONS.get(name, label(name))} ", field], className="option"))
    return fields
