"""Mean errors of all trials of a large table in cells of two variables, for its page."""

import torch
from jaxtyping import Float, Int
from torch import Tensor

from contactlearn.diagnosis.failure.variables import Variable, variables
from contactlearn.diagnosis.result import ErrorMap
from contactlearn.mechanics.impacts import Impacts, Prediction

_ACROSS, _UP = 48, 32  # cells
_PREFERRED = ("theta_folded", "theta", "incidence", "approach_speed", "spin", "order")  # the first two that vary
_TAIL = 0.001  # share of the trials at either end of a variable that counts to its outermost cell


def error_map(impacts: Impacts, law: Prediction, before: Float[Tensor, " n"], after: Float[Tensor, " n"]) -> ErrorMap:
    """Average the errors of the law and of the full model in the cells of two variables.

    Args:
        impacts: all trials.
        law: prediction of the law.
        before: error of the law.
        after: error of the full model.
    """
    known = {one.name: one for one in variables(impacts, law)}
    folded = "theta" if "theta_folded" in known else ""
    varying = [known[name] for name in _PREFERRED if name in known and name != folded and _varies(known[name])]
    across, up = (*varying, *known.values())[:2]
    (column, left, right), (row, low, high) = _placed(across, _ACROSS), _placed(up, _UP)
    cell, size = row * _ACROSS + column, _ACROSS * _UP
    trials = torch.bincount(cell, minlength=size)
    law_mean, named_mean = (
        (torch.bincount(cell, error, minlength=size) / trials).tolist() for error in (before, after)
    )
    return ErrorMap(
        across=(across.name, across.letter, across.unit),
        up=(up.name, up.letter, up.unit),
        limits=(left, right, low, high),
        columns=_ACROSS,
        trials=tuple(trials.tolist()),
        law=tuple(None if x != x else x for x in law_mean),
        named=tuple(None if x != x else x for x in named_mean),
    )


def _varies(variable: Variable) -> bool:
    return bool(variable.values.min() < variable.values.max())


def _placed(variable: Variable, cells: int) -> tuple[Int[Tensor, " n"], float, float]:
    """The cell of each trial, and both ends of the cells in the variable's unit."""
    values = variable.values.remainder(variable.period) if variable.period else variable.values
    ordered = (variable.scale * values).sort().values
    low, high = (ordered[int(share * (len(ordered) - 1))].item() for share in (_TAIL, 1 - _TAIL))
    width = (high - low) or 1.0
    place = cells * (variable.scale * values - low) / width
    return place.long().clamp(0, cells - 1), low, low + width
