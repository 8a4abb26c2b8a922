"""Effects, the next experiment and the residual of a diagnosis, as data of its page."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from contactlearn.core.numerics import measured
from contactlearn.diagnosis.result import (
    Candidate,
    Diagnosis,
    Experiment,
    FittedParameter,
    Formula,
    MissingEffect,
    Remainder,
    Rival,
)
from contactlearn.effects.formula.symbols import symbol_named
from contactlearn.inference.evaluation.partial_residuals import QUANTITIES, Partial
from contactlearn.report.figures.browser import as_plotly
from contactlearn.report.figures.effects import along, effect_curve, grouped, scaled_unit
from contactlearn.report.page.trials import bounded, digits, finely
from contactlearn.report.text.names import WRENCH, effect_label, sentence
from contactlearn.report.text.numbers import error
from contactlearn.report.text.sentences import confidence, formula_overrides, in_words, phrase, phrases, uncertain_forms


class _Axis(NamedTuple):
    """A number that a drop sets: its column in the trials of the page, label, and scale to the label's unit."""

    column: str
    label: str
    scale: float = 1.0


_AXES = {
    "x": _Axis("x", "x (m)"),
    "y": _Axis("y", "y (m)"),
    "theta": _Axis("theta", "θ (°)", math.degrees(1)),
    "v_x": _Axis("vx", "v_x (m/s)"),
    "v_y": _Axis("vy", "v_y (m/s)"),
    "v_z": _Axis("vz", "v_z (m/s)"),
    "omega": _Axis("omega", "ω (rad/s)"),
    "w_x": _Axis("wx", "ω_x (rad/s)"),
    "w_y": _Axis("wy", "ω_y (rad/s)"),
    "w_z": _Axis("wz", "ω_z (rad/s)"),
}


def effect_content(missing: MissingEffect, partial: Partial, diagnosis: Diagnosis) -> dict[str, Any]:
    """Return a missing effect with its parameters, rivals, likely forms and the curve of its partial residuals."""
    on_all = missing.reduction_on_all_trials
    inadmissible = phrase("inadmissible", missing)
    return {
        "name": str(missing.effect),
        "label": " or ".join(effect_label(one) for one in (missing.effect, *missing.alternatives)),
        "level": str(missing.level),
        "formula": missing.equation,
        "in_words": sentence(in_words(missing)) if missing.parameters else "",
        "before": bounded(missing.error_before),
        "after": bounded(missing.error_after),
        "error_reduction": finely(missing.error_reduction),
        "all_trials": None if on_all is None else bounded(on_all),
        "confidence": confidence(missing),
        "parameters": [_parameter(parameter) for parameter in missing.parameters],
        "inadmissible": sentence(inadmissible) if inadmissible else "",
        "improvements": phrases("improvements", missing, diagnosis.regions),
        "rivals": [_rival(rival) for rival in missing.rivals],
        "forms": uncertain_forms(diagnosis, missing.effect),
        "curve": curve_content(partial),
    }


def candidate_content(one: Candidate) -> dict[str, Any]:
    """Return a candidate with its parameters, the error without it and with it, and its probability."""
    return {
        "label": effect_label(one.effect),
        "formula": one.equation,
        "in_words": sentence(in_words(one)) if one.parameters else "",
        "errors": f"{error(one.error_after + one.error_reduction)} → {error(one.error_after)}",
        "confidence": confidence(one),
    }


def _parameter(parameter: FittedParameter) -> dict[str, Any]:
    numbers = digits({"value": parameter.value, "standard_error": parameter.standard_error}, 4)
    text = measured(parameter.value, parameter.standard_error, parameter.unit)
    text = "undetermined" if parameter.undetermined else text
    return {"symbol": parameter.symbol, "unit": parameter.unit, "text": text, **numbers}


def _rival(rival: Rival) -> dict[str, Any]:
    numbers = {"similarity": rival.similarity, "loss": rival.loss_difference, "error": rival.standard_error}
    return {"label": effect_label(rival.effect), **digits(numbers)}


def curve_content(partial: Partial) -> dict[str, Any]:
    """Return the figure of partial residuals, and the arrays from which a script draws another model in it.

    `quantity` and `component` are where the outcomes hold what is drawn, `scale` its unit in that of `explained`;
    `groups` are the trials of each mean, null where the curve is interrupted.
    """
    every = [(name, [*dict(parts)]) for space in QUANTITIES.values() for name, parts in space.items()]
    name, letters = next((name, letters) for name, letters in every if partial.component in letters)
    figure, (x, _) = as_plotly(effect_curve(partial, "", remaining=True)), along(partial)
    for trace in figure["data"]:
        if trace["meta"] in ("measured", "explained"):
            trace |= {"x": [], "y": []}
    return {
        "figure": digits(figure),
        "quantity": "v_post" if name == "velocity" else name,
        "component": letters.index(partial.component),
        "scale": scaled_unit(partial.component_unit)[0],
        "x": digits(x, 4),
        "groups": [None if group is None else group.tolist() for group in grouped(x)],
    }


def experiment_content(experiment: Experiment) -> dict[str, Any]:
    """Return the drops by their state, θ in °, and by the difference of the model from each rival there."""
    axes = {name: axis for name, axis in _AXES.items() if getattr(experiment.drops[0], name) is not None}
    return {
        "axes": [
            {"name": name, "column": axis.column, "label": axis.label, "scale": axis.scale}
            for name, axis in axes.items()
        ],
        "rivals": [phrase("separation", separation) for separation in experiment.separations],
        "needed": phrases("needed_drops", experiment),
        "drops": [
            digits({name: axis.scale * getattr(drop, name) for name, axis in axes.items()}, 3)
            | {"body": drop.body, "orientation": drop.orientation and ", ".join(f"{x:.3f}" for x in drop.orientation)}
            | {"differences": [digits(difference, 2) for difference in drop.differences]}
            for drop in experiment.drops
        ],
    }


def residual_content(left: Remainder, formulas: Sequence[Formula]) -> dict[str, Any]:
    """Return the predictable part of the residual by component and variable, and formulas for it."""
    return {
        "text": " ".join((phrases("residual", left)[0], *phrases("dependences", left))),
        "components": [
            {
                "name": WRENCH[test.component],
                "text": measured(test.r_squared, test.standard_error),
                "named": test.clear,
            }
            for test in left.tested
        ],
        "variables": [
            {
                "name": symbol_named(variable.symbol).letter,
                "description": symbol_named(variable.symbol).description,
                "share": digits(variable.share, 3),
            }
            for variable in left.variables
        ],
        "formulas": [{"code": formula_overrides(one), "text": phrase("formula_gain", one)} for one in formulas],
    }
