"""Every trial on a page: its state and outcome, the variables of the map, the impulses of the laws and their reach."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.inference.evaluation.impulse_space import ImpulseSpace, LawImpulses, SlipDiagram
from contactlearn.inference.evaluation.metrics import METRICS, Interval, Norm, headline_metric
from contactlearn.inference.evaluation.variables import Variable
from contactlearn.mechanics import rigid_body
from contactlearn.mechanics.bodies import shapes_among
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.mechanics.space import PLANE, Space
from contactlearn.report.figures.browser import as_plotly, plotly_style
from contactlearn.report.figures.contact_in_space import slip_hodograph
from contactlearn.report.figures.impulse_space import compared_impulses
from contactlearn.report.figures.style import MILLI

EMBEDDED = 1500
"""Trials of a large table that its page has one by one, at most."""
STEPS = {"reach": 0.002, "torn": 1.0, "parts": 0.004}
"""Steps of the arrays of a page: reachable impulses are in units of the momentum of the contact."""


def digits(x: Any, count: int = 5) -> Any:
    """Round numbers to significant digits, as JSON holds them; those that are not finite become None."""
    if isinstance(x, Tensor):
        x = x.tolist()
    if isinstance(x, Mapping):
        return {key: digits(value, count) for key, value in x.items()}
    if isinstance(x, Sequence) and not isinstance(x, str):
        return [digits(value, count) for value in x]
    if isinstance(x, float):
        return float(f"{x:.{count}g}") if abs(x) < float("inf") else None
    return x


def of_trials(
    impacts: Impacts, among: Sequence[Variable], written: Callable[[Tensor, int], Any] = digits
) -> dict[str, Any]:
    """Return names, states, outcomes with their wrench, the outlines of bodies, and the variables of the map.

    Args:
        impacts: of the page.
        among: variables of the map, see `variables.map_variables`.
        written: writes the numbers of all trials, which need so many significant digits.
    """
    return {
        "count": len(impacts),
        "name": list(impacts.trial),
        "object": list(impacts.object),
        **{name: written(values, 6) for name, values in trial_columns(impacts).items()},
        "outlines": outlines(impacts),
        "space": of_space(impacts.space),
        "variables": [axis_content(one) | {"values": written(axis_values(one), 4)} for one in among],
    }


def of_space(space: Space) -> dict[str, Any]:
    """Return the columns by field, and the symbols of velocity and wrench with the units of the page."""
    letters = {"P": "mN s", "t": "mN m s"}
    return {
        "columns": {name: list(space.components[name]) for name in ("r", "q", "v_pre", "v_post")},
        "wrench": list(space.wrench),
        "velocity": [f"{symbol} ({unit})" for symbol, unit in space.symbols.items()],
        "impulse": [f"{name.replace('tau', 'τ')} ({letters[name[0]]})" for name in space.wrench],
        "parts": list(space.symbols),
        "planar": space is PLANE,
    }


def trial_columns(impacts: Impacts) -> dict[str, Float[Tensor, " n"]]:
    """Return contact point, pose and velocities of every trial by column, and its wrench in mN s and mN m s."""
    found = {
        column: values
        for name in ("r", "q", "v_pre", "v_post")
        for column, values in zip(impacts.space.components[name], getattr(impacts, name).T, strict=True)
    }
    return found | dict(zip(impacts.space.wrench, MILLI * impacts.wrench.T, strict=True))


def of_outcomes(impacts: Impacts, v_post: Float[Tensor, "m n D"], norm: Norm = "mass") -> dict[str, Tensor]:
    """Return what M models predict: `v_post`, the `wrench` to it [M, N, D] in mN s and mN m s, and their errors.

    `error` [M, N] is the headline of the norm, `parts` [M, N, D] are the shares of its square in the components.
    """
    wrench = rigid_body.measured_wrench(impacts.mass, impacts.world_inertia, impacts.r, impacts.v_pre, v_post)
    error, d = v_post - impacts.v_post, impacts.space.d
    parts = error * error
    if norm == "mass":
        spun = rigid_body.spin_momentum(impacts.world_inertia, error[..., d:])
        parts = error * torch.cat((impacts.mass[:, None] * error[..., :d], spun), -1)
    return {
        "v_post": v_post,
        "wrench": MILLI * wrench,
        "error": METRICS[headline_metric(norm)].error(impacts, Prediction(v_post, wrench)),
        "parts": (parts / parts.sum(-1, keepdim=True)).nan_to_num(0.0),
    }


def outlines(impacts: Impacts) -> dict[str, Any]:
    """Return the outline of each body by its name, one of all bodies under an empty name, none where unknown."""
    return {name: digits(one.outline(91).T) for name, one in shapes_among(impacts.shape).items()}


def of_laws(given: LawImpulses) -> tuple[list[dict[str, Any]], dict[str, Tensor]]:
    """Return the laws at their fitted parameters, and the arrays of `LawImpulses`, impulses in mN s."""
    entries = [
        {"name": name, "mu": digits(float(law.mu), 4), "eps": digits(float(law.eps), 4), **plotly_style(name)}
        for name, law in given.laws.items()
    ]
    return entries, {
        name: MILLI * values if name in ("impulse", "ellipse") else values for name, values in given.arrays.items()
    }


def impulse_figure(first: ImpulseSpace | SlipDiagram) -> dict[str, Any]:
    """Return the figure of impulse space, or of the hodograph, in which a script shows any trial, here the first."""
    drawn = compared_impulses(first) if isinstance(first, ImpulseSpace) else slip_hodograph(first)
    figure = as_plotly(drawn)
    return digits(figure | {"data": [trace | {"x": [], "y": []} for trace in figure["data"] if trace["meta"]]})


def bounded(x: Interval) -> dict[str, float | None]:
    """Round an error and the ends of its interval as `finely` does; None where there is no interval."""
    if math.isnan(x.low):
        return {"mean": finely(x.mean), "low": None, "high": None}
    return finely({"mean": x.mean, "low": x.low, "high": x.high})


def finely(x: Any) -> Any:
    """Round errors to seven significant digits, so that their four decimals are those of the numbers themselves."""
    return digits(x, 7)


def axis_content(one: Variable) -> dict[str, Any]:
    """Return name, label and unit of a variable, without its values."""
    unit = "" if one.unit == "–" else one.unit
    modulo = f" modulo {one.period * one.scale:g}°" if one.period and one.period < 6.2 else ""
    return {
        "name": one.name,
        "label": f"{one.letter}{modulo}" + (f" ({unit})" if unit else ""),
        "period": one.period and digits(one.period * one.scale),
        "scale": one.scale,
        "labels": list(one.labels),
    }


def axis_values(one: Variable) -> Float[Tensor, " n"]:
    """Return the values of a variable in the unit of its label, a whole turn as angles around 0."""
    values = one.values
    if one.period:
        values = values.remainder(one.period)
        values = torch.where((one.period > 6.2) & (values > one.period / 2), values - one.period, values)
    return one.scale * values
