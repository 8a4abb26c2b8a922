"""Partial residuals: the change by one effect of a model against the residual of the model without it.

The model is evaluated with and without the effect, its other effects unchanged.  `measured` is the measurement less
the prediction without the effect, `explained` the change that the effect makes; if nothing else is missing, they
differ by noise alone.  Both are of the component in which the effect is largest relative to the remaining residual,
against the symbol of the state that predicts the effect best.  Where no symbol predicts a third of its variance, they
are against the effect itself, so that the measured values should follow the diagonal.
Source: Larsen & McCleary 1972, for linear models.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.numerics import wrapped
from contactlearn.effects import Effect, State, columns
from contactlearn.effects.formula.symbols import of_state, symbol_named
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.mechanics.rigid_body import matvec
from contactlearn.mechanics.space import PLANE, SPACE
from contactlearn.models.contact_model import ContactModel

QUANTITIES = {
    PLANE: {
        "wrench": (("P_t", "N s"), ("P_n", "N s"), ("τ", "N m s")),
        "velocity": (("v_x⁺", "m/s"), ("v_y⁺", "m/s"), ("ω⁺", "rad/s")),
    },
    SPACE: {
        "wrench": tuple((f"{x}_{axis}", unit) for x, unit in (("P", "N s"), ("τ", "N m s")) for axis in "12n"),
        "velocity": tuple((f"{x}_{axis}⁺", unit) for x, unit in (("v", "m/s"), ("ω", "rad/s")) for axis in "12n"),
    },
}
"""Components of what an effect changes, with units; in space along the slip, across it and along the normal."""
_BINS = 20
_NUDGE = 0.02  # of each parameter's range
_PREDICTED = 1 / 3  # share of the effect's variance that a symbol must predict to be the variable


@dataclass(frozen=True)
class Partial:
    """An effect over N impacts: measured and explained [N] against a variable [N], with letters and units."""

    effect: str
    component: str
    component_unit: str
    variable: str
    variable_unit: str
    x: Float[Tensor, "n"]
    measured: Float[Tensor, "n"]
    explained: Float[Tensor, "n"]


def partial_residuals(model: ContactModel, impacts: Impacts, name: str) -> Partial:
    """Compute the partial residuals of the effect `name` of a model on impacts."""
    effect = model.effects[name]
    with_, without = model.base_prediction(impacts), _without(model, impacts, name)
    quantity = _quantity(effect)
    explained = _change(effect, impacts, with_, without)
    measured = _change(effect, impacts, Prediction(impacts.v_post, impacts.wrench), without)
    # A larger effect chooses component and variable where the effect is 0: it is drawn as well, as a line at 0.
    values = columns(*effect.values)
    range_ = torch.tensor([p.high - p.low for p in effect.parameters], dtype=values.dtype, device=values.device)
    larger = replace(model, effects={**model.effects, name: effect.at(values + _NUDGE * range_)})
    would = _change(effect, impacts, larger.base_prediction(impacts), without)
    shape = explained if (explained != 0).any() else would
    # Medians, because of gross outliers.
    left = (measured - explained).abs().median(0).values
    best = int((shape.square().mean(0).sqrt() / left.clamp_min(1e-300)).argmax())
    known = {letter: (unit, x) for letter, unit, x in state_quantities(State.of(impacts)).values()}
    shares = {letter: share_explained(x, shape[:, best]) for letter, (_, x) in known.items()}
    variable = max(shares, key=shares.__getitem__)
    component, unit = QUANTITIES[impacts.space][quantity][best]
    against = variable, *known[variable]
    if shares[variable] < _PREDICTED and (explained != 0).any():
        against = f"{component} of the effect", unit, explained[:, best]
    return Partial(name, component, unit, *against, measured[:, best], explained[:, best])


def state_quantities(state: State) -> dict[str, tuple[str, str, Float[Tensor, "n"]]]:
    """Letter, unit and values of what an effect may depend on, by symbol; in space only the place knows the axes."""
    known = of_state(state)
    if state.space is PLANE:
        known["theta"] = wrapped(known["theta"])
    named = {name: symbol_named(name) for name in known}
    return {name: (named[name].letter, named[name].unit, values) for name, values in known.items()}


def changes(model: ContactModel, impacts: Impacts, names: Sequence[str]) -> Float[Tensor, "k n D"]:
    """Compute the change that each of the named effects makes, in the quantity of its partial residuals."""
    whole = model.base_prediction(impacts)
    found = [_change(model.effects[name], impacts, whole, _without(model, impacts, name)) for name in names]
    return torch.stack(found) if found else impacts.v_post.new_zeros(0, *impacts.v_post.shape)


def _without(model: ContactModel, impacts: Impacts, name: str) -> Prediction:
    """The prediction without an effect, the others unchanged."""
    others = {key: other for key, other in model.effects.items() if key != name}
    return replace(model, effects=others).base_prediction(impacts)


def _quantity(effect: Effect) -> str:
    return "velocity" if effect.place == "velocity" else "wrench"


def _change(effect: Effect, impacts: Impacts, with_: Prediction, without: Prediction) -> Float[Tensor, "n D"]:
    """The change of wrench or v_post, whichever the effect is drawn in, in the axes of the slip."""
    wrench = _quantity(effect) == "wrench"
    change = with_.wrench - without.wrench if wrench else with_.v_post - without.v_post
    return matvec(impacts.slip_axes.mT, change)


def share_explained(x: Float[Tensor, "n"], y: Float[Tensor, "n"]) -> float:
    """Compute the share of the variance of y [N] between groups of equal number along x [N]."""
    if x.max() == x.min() or y.max() == y.min():
        return 0.0
    groups = y[x.argsort()].tensor_split(min(_BINS, len(x)))
    between = sum(len(group) * (group.mean() - y.mean()) ** 2 for group in groups)
    return (between / (y - y.mean()).square().sum()).item()


def binned(x: Float[Tensor, "n"], *values: Float[Tensor, "n"], bins: int = _BINS) -> tuple[Float[Tensor, "bins"], ...]:
    """Average x and values over groups of equal number along x; [bins] each."""
    order = x.argsort()
    return tuple(
        torch.stack([group.mean() for group in part[order].tensor_split(min(bins, len(x)))]) for part in (x, *values)
    )
