"""Numbers for the figures of the page, which are those of the report: single-precision arrays in base64.

trials   names, states, outcomes and variables of every trial, once for each data source
model    outcomes of the law alone and of the model, and what each effect changes, with every change of the model
preview  outcomes and what each effect changes, while a slider is dragged
trial    impulse and reach of every law for the selected trial
"""

import base64
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from contactlearn.inference.evaluation.impulse_space import LawImpulses
from contactlearn.inference.evaluation.partial_residuals import changes, partial_residuals
from contactlearn.inference.evaluation.variables import Variable, map_variables
from contactlearn.laws import Law
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.models.contact_model import ContactModel
from contactlearn.report.figures.effects import along
from contactlearn.report.figures.style import array
from contactlearn.report.page.effects import curve_content
from contactlearn.report.page.trials import axis_values, digits, of_laws, of_outcomes, of_trials
from contactlearn.report.text.names import label
from contactlearn.workbench.session import Window

_CURVES = 5  # effects, at most, whose curves are drawn
_CURVE_TRIALS = 5000  # up to which curves are drawn


def of_data(impacts: Impacts, prediction: Prediction) -> dict[str, Any]:
    """Return the trials of the page; the prediction decides which of them stick."""
    return of_trials(impacts, map_variables(impacts, prediction), lambda values, _: floats(values))


def of_model(impacts: Impacts, alone: Tensor, v_post: Tensor, model: ContactModel) -> dict[str, Any]:
    """Return the outcomes [2, N, …] of the law alone and of the model, and the curves of its effects."""
    partials = {name: partial_residuals(model, impacts, name) for name in _drawn(impacts, model)}
    return {
        **_outcomes(impacts, torch.stack((alone, v_post))),
        "effects": [
            {
                "name": name,
                "label": label(name),
                "curve": curve_content(one) | {"x": floats(along(one)[0]), "own": torch.equal(one.x, one.explained)},
            }
            for name, one in partials.items()
        ],
        "explained": floats(torch.stack([one.explained for one in partials.values()], -1)) if partials else "",
    }


def of_preview(impacts: Impacts, v_post: Tensor, model: ContactModel) -> dict[str, Any]:
    """Return the outcomes [N, …] of a model, and what each effect changes, [K, N, 3]: component and variable stay."""
    return _outcomes(impacts, v_post) | {"changes": floats(changes(model, impacts, _drawn(impacts, model)))}


def _outcomes(impacts: Impacts, v_post: Float[Tensor, "*m n 3"]) -> dict[str, str]:
    return {name: floats(values) for name, values in of_outcomes(impacts, v_post).items()}


def _drawn(impacts: Impacts, model: ContactModel) -> list[str]:
    """The effects whose curves are drawn."""
    return list(model.effects)[:_CURVES] if len(impacts) <= _CURVE_TRIALS else []


def of_trial(impacts: Impacts, row: int, fitted: Mapping[str, Law]) -> dict[str, Any]:
    """Return the laws at their fitted parameters, and their impulses and reach for one trial."""
    laws, found = of_laws(LawImpulses.of(impacts[[row]], fitted))
    arrays = {
        name: digits((values[0] if name == "ellipse" else values[:, 0]).double()) for name, values in found.items()
    }
    return {"row": row, "fitted": laws} | arrays


def inside(windows: tuple[Window, ...], among: list[Variable]) -> Bool[Tensor, " n"]:
    """Find the trials that lie in every window; a window of a variable that is not there holds all of them."""
    known = {one.name: one for one in among}
    found = torch.ones(len(among[0].values), dtype=torch.bool)
    for window in windows:
        if window.variable in known:
            variable = known[window.variable]
            values, width = axis_values(variable) - window.low, window.high - window.low
            values = values.remainder(variable.period * variable.scale) if variable.period else values
            found &= (values >= 0) & (values <= width)
    return found


def floats(values: Float[Tensor, "..."]) -> str:
    """Encode numbers, little-endian, in single precision."""
    return base64.b64encode(np.ascontiguousarray(array(values), dtype="<f4").tobytes()).decode()
