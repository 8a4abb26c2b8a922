"""The full model of a subsample, tested on all trials of the table.

Predictions are made a chunk at a time; of each trial stay the outcomes of law and full model.  Errors are means over
the trials outside the subsample, with intervals of the normal limit.  Outliers and failing regions are looked for among
all trials, since a subsample has few or none of what is rare.
"""

import math
from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from contactlearn.core.numerics import Z_95
from contactlearn.data.audit.model_checks import outliers_of
from contactlearn.diagnosis.error_budget import noise_floor
from contactlearn.diagnosis.failure.regions import find_regions
from contactlearn.diagnosis.failure.variables import Variable, variables
from contactlearn.diagnosis.result import Confirmation, Diagnosis, ErrorMap, FailingRegion, Record
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.diagnosis.unexplained.remainder import inlier_mask
from contactlearn.inference.evaluation.metrics import Interval, mass_error
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.models.contact_model import ContactModel

CHUNK = 50_000
"""Trials that are predicted at once."""
_WORST = 0.02  # share of the trials whose errors a failing region has many of
_NEIGHBOURS = 4000  # trials for the noise floor, at most
_ACROSS, _UP = 48, 32  # cells
_PREFERRED = ("theta_folded", "theta", "incidence", "approach_speed", "spin", "order")  # the first two that vary
_TAIL = 0.001  # share of the trials at either end of a variable that counts to its outermost cell


def confirm(
    found: Diagnosis,
    record: Record,
    impacts: Impacts,
    rows: Int[Tensor, " k"],
    *,
    generator: torch.Generator,
    noise: Sequence[float] | None,
    thresholds: Thresholds,
) -> Confirmation:
    """Compute errors, noise, outliers and failing regions of the model of a subsample on all trials.

    Args:
        found: of the subsample.
        record: of the same.
        impacts: all trials, corrected as those of the subsample.
        rows: of the subsample, fewer than all.
        generator: of the halves in which regions are searched and tested, and of the noise.
        noise: standard deviations of the measured velocities, where they are stated, see `diagnose`.
        thresholds: limits of what is reported.
    """
    assert found.budget is not None
    outside = torch.ones(len(impacts), dtype=torch.bool)
    outside[rows] = False
    law, named = (predicted(model, impacts) for model in (record.base, record.model))
    before, after = (mass_error(impacts, one) for one in (law, named))
    error = normal_interval(after[outside])
    regions = find_regions(impacts, named, generator=generator, thresholds=thresholds, worst=_WORST)
    return Confirmation(
        trials=int(outside.sum()),
        base=normal_interval(before[outside]),
        named=error,
        noise=_noise(found, record.model, impacts, outside, generator, noise),
        agrees=agree(error, found.budget.named, thresholds),
        outliers=outliers_of(impacts, lambda some: predicted(record.model, some).v_post, thresholds.audit),
        regions=tuple(FailingRegion.of(one, int((~outside[list(one.rows)]).sum())) for one in regions),
        map=error_map(impacts, law, before, after),
    )


def predicted(model: ContactModel, impacts: Impacts) -> Prediction:
    """Predict a chunk of trials after the other."""
    parts = [model.predict(impacts[k : k + CHUNK]) for k in range(0, len(impacts), CHUNK)]
    return Prediction(torch.cat([one.v_post for one in parts]), torch.cat([one.wrench for one in parts]))


def normal_interval(errors: Float[Tensor, " n"]) -> Interval:
    """Average the errors of many trials, with the 95 % interval of the normal limit."""
    mean, margin = errors.mean().item(), Z_95 * (errors.std() / math.sqrt(len(errors))).item()
    return Interval(mean, mean - margin, mean + margin)


def agree(one: Interval, other: Interval, thresholds: Thresholds) -> bool:
    """Whether two mean errors of different trials are the same but for chance."""
    spread = math.hypot(one.high - one.low, other.high - other.low) / (2 * Z_95)
    return abs(one.mean - other.mean) <= thresholds.certain_sigmas * spread


def _noise(
    found: Diagnosis,
    model: ContactModel,
    impacts: Impacts,
    outside: Bool[Tensor, " n"],
    generator: torch.Generator,
    noise: Sequence[float] | None,
) -> Interval | None:
    """The noise floor of trials outside the subsample; a model that misses something does not tell it."""
    if found.remainder is not None and found.remainder.unknown:
        return None
    others = outside.nonzero()[:, 0]
    some = impacts[others[torch.randperm(len(others), generator=generator)[:_NEIGHBOURS]].sort().values]
    inliers = inlier_mask(some.wrench - model.predict(some).wrench)
    return noise_floor(some, model, generator=generator, noise=noise, inliers=inliers).error


# --- The map of errors --------------------------------------------------------------------------


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
