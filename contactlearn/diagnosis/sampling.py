"""Diagnosis of a large table on subsamples, each twice as large as the one before, until two answers agree.

A subsample is even over objects, the sequence of the trials, and the inputs: the trials of each object are halved at
the median of the order, each half at that of θ, and so on through the inputs, as a k-d tree is built, until the cells
hold a few trials.  In the order of the cells every k-th trial is taken, a random one of its cell.  So every trial is as
likely to be taken as any other, and means over the sample are those of the table; but each corner of the space has its
share, which a random draw may miss.

Finished subsamples are kept in a folder, each in one named by its number of trials: the files of its record, and
diagnosis.json, which is written last.  A later run reuses them, and repeats what cannot be read.

The full model of the last subsample is tested on all trials of the table, predicted a chunk at a time.  Errors are
means over the trials outside the subsample, with intervals of the normal limit.  Outliers and failing regions are
searched among all trials, since a subsample has few of the rare ones or none.
Sources: Bentley 1975, for the tree; Madow & Madow 1944, for the systematic draw.
"""

import math
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from contactlearn.core.errors import ContactLearnError
from contactlearn.core.numerics import Z_95, atomic_write
from contactlearn.data.audit.corrections import correct
from contactlearn.data.audit.model_checks import find_model_outliers
from contactlearn.diagnosis.error_budget import noise_floor
from contactlearn.diagnosis.events import SampleConfirmed, SubsampleStarted
from contactlearn.diagnosis.question import Question
from contactlearn.diagnosis.regions import find_regions
from contactlearn.diagnosis.result import (
    Answer,
    Confirmation,
    Diagnosis,
    ErrorMap,
    FailingRegion,
    Finding,
    Limit,
    Record,
    Sample,
)
from contactlearn.diagnosis.stages import diagnose_audited
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.diagnosis.unexplained.remainder import inlier_mask
from contactlearn.inference.evaluation.metrics import Interval, mass_error
from contactlearn.inference.evaluation.variables import Variable, variables
from contactlearn.mechanics.bodies import numbered
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.mechanics.space import PLANE
from contactlearn.models.contact_model import ContactModel

CHUNK = 50_000
"""Trials that are predicted at once."""
_WORST_SHARE = 0.02  # share of the trials whose errors a failing region has many of
_NEIGHBOURS = 4000  # trials for the noise floor, at most
_ACROSS, _UP = 48, 32  # cells
_PREFERRED = ("theta_folded", "theta", "incidence", "approach_speed", "spin", "order")  # the first two that vary
_TAIL = 0.001  # share of the trials at either end of a variable that counts to its outermost cell
_BYTES, _BYTES_A_TRIAL = 0.3e9, 1.7e5  # of a diagnosis, measured: benchmarks/speed/large_tables.py
_SECONDS, _SECONDS_A_TRIAL = 13.0, 3e-3  # likewise, of one core; of later ones the first says how fast it is
# trials of the first and of the largest subsample, of those that are diagnosed at once
_FIRST_SHARE, _LARGEST_SHARE = 0.4, 1.6
_MIN_TRIALS = 250  # trials of a subsample, whatever the memory
_OUTSIDE_SHARE = 0.2  # share of the trials that is in no subsample, at least
_RESULT = "diagnosis.json"


# --- The test on all trials ------------------------------------------------------------------------


def confirm(
    diagnosis: Diagnosis,
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
        diagnosis: of the subsample.
        record: of the same.
        impacts: all trials, corrected as those of the subsample.
        rows: of the subsample, fewer than all.
        generator: of the halves in which regions are searched and tested, and of the noise.
        noise: standard deviations of the measured velocities, where they are stated, see `diagnose`.
        thresholds: limits of what is reported.
    """
    assert diagnosis.budget is not None
    outside = torch.ones(len(impacts), dtype=torch.bool)
    outside[rows] = False
    law, named = (predicted(model, impacts) for model in (record.base, record.model))
    before, after = (mass_error(impacts, prediction) for prediction in (law, named))
    error = normal_interval(after[outside])
    regions = find_regions(impacts, named, generator=generator, thresholds=thresholds, worst=_WORST_SHARE)
    return Confirmation(
        trials=int(outside.sum()),
        base=normal_interval(before[outside]),
        named=error,
        noise=_noise(diagnosis, record.model, impacts, outside, generator, noise),
        agrees=agree(error, diagnosis.budget.named, thresholds),
        outliers=find_model_outliers(impacts, lambda some: predicted(record.model, some).v_post, thresholds.audit),
        regions=tuple(FailingRegion.of(region, int((~outside[list(region.rows)]).sum())) for region in regions),
        map=error_map(impacts, law, before, after),
    )


def predicted(model: ContactModel, impacts: Impacts) -> Prediction:
    """Predict a chunk of trials after the other."""
    parts = [model.outcome(impacts[k : k + CHUNK]) for k in range(0, len(impacts), CHUNK)]
    return Prediction(torch.cat([part.v_post for part in parts]), torch.cat([part.wrench for part in parts]))


def normal_interval(errors: Float[Tensor, " n"]) -> Interval:
    """Average the errors of many trials, with the 95 % interval of the normal limit."""
    mean, margin = errors.mean().item(), Z_95 * (errors.std() / math.sqrt(len(errors))).item()
    return Interval(mean, mean - margin, mean + margin)


def agree(mean_error: Interval, other: Interval, thresholds: Thresholds) -> bool:
    """Return whether two mean errors of different trials differ by no more than chance."""
    spread = math.hypot(mean_error.high - mean_error.low, other.high - other.low) / (2 * Z_95)
    return abs(mean_error.mean - other.mean) <= thresholds.certain_sigmas * spread


def _noise(
    diagnosis: Diagnosis,
    model: ContactModel,
    impacts: Impacts,
    outside: Bool[Tensor, " n"],
    generator: torch.Generator,
    noise: Sequence[float] | None,
) -> Interval | None:
    """Estimate the noise floor of trials outside the subsample; None for a model that misses something."""
    if diagnosis.remainder is not None and diagnosis.remainder.unknown:
        return None
    others = outside.nonzero()[:, 0]
    some = impacts[others[torch.randperm(len(others), generator=generator)[:_NEIGHBOURS]].sort().values]
    inliers = inlier_mask(some.wrench - model.outcome(some).wrench)
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
    known = {variable.name: variable for variable in variables(impacts, law)}
    folded = "theta" if "theta_folded" in known else ""
    varying = [known[name] for name in _PREFERRED if name in known and name != folded]
    varying = [variable for variable in varying if variable.values.min() < variable.values.max()]
    across, up = (*varying, *known.values())[:2]
    (column, left, right), (row, low, high) = _placed(across, _ACROSS), _placed(up, _UP)
    cell, size = row * _ACROSS + column, _ACROSS * _UP
    trials = torch.bincount(cell, minlength=size)
    law_mean, named_mean = ((torch.bincount(cell, x, minlength=size) / trials).tolist() for x in (before, after))
    return ErrorMap(
        across=(across.name, across.letter, across.unit),
        up=(up.name, up.letter, up.unit),
        limits=(left, right, low, high),
        columns=_ACROSS,
        trials=tuple(trials.tolist()),
        law=tuple(None if x != x else x for x in law_mean),
        named=tuple(None if x != x else x for x in named_mean),
    )


def _placed(variable: Variable, cells: int) -> tuple[Int[Tensor, " n"], float, float]:
    """The cell of each trial, and both ends of the cells in the variable's unit."""
    values = variable.values.remainder(variable.period) if variable.period else variable.values
    ordered = (variable.scale * values).sort().values
    low, high = (ordered[int(share * (len(ordered) - 1))].item() for share in (_TAIL, 1 - _TAIL))
    width = (high - low) or 1.0
    place = cells * (variable.scale * values - low) / width
    return place.long().clamp(0, cells - 1), low, low + width


# --- Subsamples ------------------------------------------------------------------------------------


def affordable(trials: int, memory: float | None) -> bool:
    """Return whether the diagnosis of so many trials fits into a memory in bytes; None is unlimited."""
    return memory is None or _BYTES + _BYTES_A_TRIAL * trials <= memory


def diagnose_subsamples(
    question: Question,
    impacts: Impacts,
    findings: Sequence[Finding],
    *,
    seed: int,
    memory: float | None = None,
    resume_folder: Path | None = None,
) -> Diagnosis:
    """Diagnose subsamples of audited impacts until two answers agree, and test the last one on all trials.

    Args:
        question: what is given, what may be missing, and all settings.
        impacts: the whole table, corrected.
        findings: findings of its audit.
        seed: seed of the first subsample and its stages; the next ones count up from it.
        memory: bytes that a diagnosis may take.
        resume_folder: folder for the results of finished subsamples, which a later run reuses.
    """
    sizes, limit = _sizes(len(impacts), question.thresholds, memory)
    answers, diagnosis, rows, speed = list[Answer](), None, torch.empty(0), 1.0
    objects = numbered(impacts.object)
    for k, size in enumerate(sizes):
        generator = torch.Generator().manual_seed(seed + k)
        rows = space_filling(impacts, size, generator)
        diagnosis = None if resume_folder is None else _finished(resume_folder / str(size))
        expected = _SECONDS + _SECONDS_A_TRIAL * size
        question.on_event(
            SubsampleStarted(
                trials=size,
                table_trials=len(impacts),
                objects=int(objects.max()) + 1,
                objects_seen=len(objects[rows].unique()),
                seconds=speed * expected,
                gigabytes=1e-9 * (_BYTES + _BYTES_A_TRIAL * size),
                resumed=diagnosis is not None,
            )
        )
        if diagnosis is None:
            began = time.monotonic()
            diagnosis = diagnose_audited(question, impacts[rows], findings, generator)
            speed = (time.monotonic() - began) / expected
            if resume_folder is not None:
                _finish(resume_folder / str(size), diagnosis)
        answers.append(_answer(diagnosis, size))
        if len(answers) > 1 and answers[-1].agrees(answers[-2]):
            limit = None
            break
    assert diagnosis is not None
    return _confirmed(question, diagnosis, impacts, findings, rows, tuple(answers), limit, seed)


def _confirmed(
    question: Question,
    diagnosis: Diagnosis,
    impacts: Impacts,
    findings: Sequence[Finding],
    rows: Int[Tensor, " k"],
    answers: tuple[Answer, ...],
    limit: Limit | None,
    seed: int,
) -> Diagnosis:
    """Test the diagnosis of the last subsample on all trials; outliers then refer to the whole table."""
    assert diagnosis.record is not None
    objects = numbered(impacts.object)
    audited = sum(finding.correction is not None for finding in findings)  # the stages have added to those
    corrections = diagnosis.corrections[audited:]
    confirmation = confirm(
        diagnosis,
        diagnosis.record,
        correct(impacts, corrections),
        rows,
        generator=torch.Generator().manual_seed(seed),
        noise=question.options.noise,
        thresholds=question.thresholds,
    )
    sample = Sample(
        of=len(impacts),
        objects=int(objects.max()) + 1,
        objects_seen=len(objects[rows].unique()),
        answers=answers,
        limit=limit,
        confirmation=confirmation,
    )
    question.on_event(SampleConfirmed(sample=sample))
    # Outliers of the whole table take the place of those of the subsample.
    kept = [finding for finding in diagnosis.findings if finding.name != "model_outliers"]
    kept += [confirmation.outliers] if confirmation.outliers is not None else []
    return replace(diagnosis, findings=tuple(kept), sample=sample)


def _sizes(trials: int, thresholds: Thresholds, memory: float | None) -> tuple[list[int], Limit]:
    """Plan the sizes of the subsamples, and name what limits the last one."""
    most = int((1 - _OUTSIDE_SHARE) * trials)
    first = min(int(_FIRST_SHARE * thresholds.whole), most)
    while first > _MIN_TRIALS and not affordable(first, memory):
        first = max(_MIN_TRIALS, first // 2)
    sizes = [first]
    while 2 * sizes[-1] <= min(int(_LARGEST_SHARE * thresholds.whole), most):
        if not affordable(2 * sizes[-1], memory):
            return sizes, Limit.MEMORY
        sizes.append(2 * sizes[-1])
    return sizes, Limit.SIZE


def _answer(diagnosis: Diagnosis, trials: int) -> Answer:
    """Return the answer of a subsample."""
    assert diagnosis.law is not None
    assert diagnosis.physics is not None
    assert diagnosis.budget is not None
    effects = tuple(missing.effect for missing in diagnosis.missing)
    return Answer(
        trials=trials, law=diagnosis.law, effects=effects, physics=diagnosis.physics, error=diagnosis.budget.named
    )


def _finish(folder: Path, diagnosis: Diagnosis) -> None:
    """Write the diagnosis of a subsample."""
    assert diagnosis.record is not None
    with suppress(FileNotFoundError):  # the same command beside this one has ended, and removed the folder
        diagnosis.record.save(folder, {})
        with atomic_write(folder / _RESULT) as path:
            path.write_text(diagnosis.to_json(), encoding="utf-8")


def _finished(folder: Path) -> Diagnosis | None:
    """Read the diagnosis of a subsample; None if it was not finished."""
    try:
        diagnosis = Diagnosis.from_json((folder / _RESULT).read_bytes())
        return replace(diagnosis, record=Record.load(folder))
    except (OSError, ContactLearnError):
        return None


# --- The draw ----------------------------------------------------------------------------------


def space_filling(impacts: Impacts, size: int, generator: torch.Generator) -> Int[Tensor, " size"]:
    """Draw rows, ascending, without repetition.

    An object without a trial takes the place of one of another object that has several, unless there are more objects
    than half of the rows.

    Args:
        impacts: measurements.
        size: rows, as many as there are at most.
        generator: of the choice within cells.
    """
    n = len(impacts)
    shuffled = torch.randperm(n, generator=generator)  # ties, and places within a cell, are at random
    objects = numbered(impacts.object)
    along = _cells(impacts, objects, size, shuffled)
    place = (torch.arange(size, dtype=torch.float64) + torch.rand(1, generator=generator).double()) * (n / size)
    rows = along[place.long().clamp_max(n - 1)]
    return _with_every_object(rows, objects, shuffled).sort().values


def _cells(impacts: Impacts, objects: Int[Tensor, " n"], size: int, shuffled: Tensor) -> Int[Tensor, " n"]:
    """The rows, cell after cell."""
    order, d = impacts.order, impacts.space.d
    turn = impacts.q[:, 2].remainder(2 * math.pi) if impacts.space is PLANE else impacts.q[:, 3]
    spin = impacts.v_pre[:, d:].unbind(-1)
    # The sequence is halved twice, since a change along it is often sudden.
    columns = (order, turn, *impacts.v_c.unbind(-1), *spin, order, impacts.r[:, 0], *impacts.q[:, : d - 1].unbind(-1))
    inputs = torch.stack(columns, -1)[shuffled]
    cell = objects[shuffled]
    halvings = math.ceil(math.log2(max(2, size / (1 + int(objects.max())))))
    for level in range(halvings):
        order = inputs[:, level % inputs.shape[1]].argsort(stable=True)
        order = order[cell[order].argsort(stable=True)]
        here, counts = cell[order].unique_consecutive(return_counts=True)
        first = (counts.cumsum(0) - counts).repeat_interleave(counts)
        upper = 2 * (torch.arange(len(order)) - first) >= counts.repeat_interleave(counts)
        cell[order] = 2 * here.repeat_interleave(counts) + upper
    return shuffled[cell.argsort(stable=True)]


def _with_every_object(
    rows: Int[Tensor, " size"], objects: Int[Tensor, " n"], shuffled: Int[Tensor, " n"]
) -> Int[Tensor, " size"]:
    """The rows with one of each object that has none, in place of some whose object has several."""
    drawn = objects[rows]
    seen = torch.bincount(drawn, minlength=int(objects.max()) + 1)
    missing = (seen == 0).nonzero()[:, 0]
    if not len(missing) or len(seen) > len(rows) // 2:
        return rows
    order = drawn.argsort(stable=True)
    several = order[1:][drawn[order].diff() == 0]
    replaced = several[torch.linspace(0, len(several) - 1, len(missing)).long()]
    trial_of = torch.zeros_like(seen).scatter(0, objects[shuffled], shuffled)  # one of each object, at random
    rows[replaced] = trial_of[missing]
    return rows
