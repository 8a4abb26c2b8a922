"""A diagnosis as the data of its page: plain numbers and text, for the templates and for JSON.

The data are a pure function of the diagnosis, its record and its provenance; nothing is fitted.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from matplotlib.figure import Figure

from contactlearn.core import __version__
from contactlearn.core.errors import ContactLearnError
from contactlearn.core.numerics import Z_95, measured
from contactlearn.data.audit.result import Evidence
from contactlearn.diagnosis.result import (
    Choices,
    Diagnosis,
    ErrorBudget,
    ErrorMap,
    Finding,
    Record,
    Region,
    Sample,
)
from contactlearn.inference.evaluation.impulse_space import ScatterCloud
from contactlearn.report.figures.browser import as_plotly
from contactlearn.report.figures.diagnosis import scatter_figure
from contactlearn.report.figures.impulse_space import scattered_impulses
from contactlearn.report.figures.style import law_style
from contactlearn.report.page.effects import candidate_content, effect_content, experiment_content, residual_content
from contactlearn.report.page.page import packed, reproduced, write
from contactlearn.report.page.trials import (
    EMBEDDED,
    STEPS,
    bounded,
    digits,
    finely,
    impulse_figure,
    of_laws,
    of_outcomes,
    of_trials,
)
from contactlearn.report.text.names import (
    base_label,
    capitalize_first,
    effect_label,
    label,
    rung_label,
    sentence,
    source_label,
)
from contactlearn.report.text.numbers import counted, share_of_whole
from contactlearn.report.text.sentences import (
    grounds,
    headline,
    listed_candidates,
    listed_models,
    listed_name,
    phrase,
    phrases,
    searched_name,
    undecided_laws,
)
from contactlearn.results.types import DataSource, Provenance

_NOTES = {"consistent": "No mistake of units or axes", "moving_floor": "A rebound that does not vanish at zero speed"}
_OF_THE_SET_UP = ("rig", "rig_applied")  # which a section of its own has


def save_report(diagnosis: Diagnosis, folder: str | os.PathLike[str]) -> Path:
    """Write report.html of a diagnosis that was made in Python; return its path.

    Raises:
        ContactLearnError: a diagnosis that was read without its record.
        OSError: the folder cannot be written to.
    """
    if diagnosis.record is None:
        raise ContactLearnError("a report shows trials, and this diagnosis has no record of them")
    impacts = diagnosis.record.impacts
    data = DataSource(
        source=impacts.source, trials=len(impacts), sha256=impacts.fingerprint(), space=impacts.space.name
    )
    Path(folder).mkdir(parents=True, exist_ok=True)
    return write_page(Path(folder), diagnosis, Provenance(data=data, versions={"contactlearn": __version__}))


def write_page(
    folder: Path, diagnosis: Diagnosis, provenance: Provenance, *, use: str = "", next_commands: Sequence[str] = ()
) -> Path:
    """Write report.html of a diagnosis into a folder, whole or not at all.

    Args:
        folder: of the run.
        diagnosis: with its record, unless the data were refused.
        provenance: data, versions, configuration, and the command of the diagnosis.
        use: the command that evaluates the model with the missing effects.
        next_commands: that go on from the folder of the run, as the terminal says.

    Raises:
        OSError: the folder cannot be written to.
    """
    return write(folder, of_diagnosis(diagnosis, provenance, use=use, next_commands=next_commands))


def of_diagnosis(
    diagnosis: Diagnosis, provenance: Provenance, *, use: str = "", next_commands: Sequence[str] = ()
) -> dict[str, Any]:
    """Return the data of the page of a diagnosis; the arguments are those of `write_page`."""
    content = {
        "title": f"Diagnosis of {source_label(provenance.data.source)}",
        "_measure": phrase("measure", "mass"),
        "_rig": next((finding.rig for finding in diagnosis.findings if finding.rig), ()),
        "verdict": {
            "key": str(diagnosis.verdict),
            "headline": headline(diagnosis),
            "named": [capitalize_first(phrase("named", effect)) for effect in diagnosis.missing],
            "support": grounds(diagnosis),
            "sentences": phrases("summary", diagnosis),
        },
        "findings": [_finding(one, diagnosis) for one in diagnosis.findings if one.name not in _OF_THE_SET_UP],
        "law": {"name": diagnosis.law, "label": law_style(diagnosis.law).label if diagnosis.law else ""},
        "next": list(next_commands),
        "reproduce": reproduced(provenance, use),
        "trials": None,
        **sample_content(diagnosis),
    }
    if diagnosis.record is None or diagnosis.choices is None or diagnosis.budget is None:
        return content
    models = _models(diagnosis, diagnosis.choices)
    figures = dict[str, Figure]()  # no choice changes them
    if diagnosis.record.deviations:
        figures["scatter"] = scatter_figure(diagnosis.record.deviations)
    if diagnosis.record.model.scatter:
        clouds = ScatterCloud.along(diagnosis.record.model, diagnosis.record.impacts)
        figures["cloud"] = scattered_impulses(clouds)
    fixed = {"figures": {key: digits(as_plotly(one)) for key, one in figures.items()}}
    shown = replace(diagnosis, record=thinned(diagnosis.record, diagnosis.sample))
    return (
        content
        | fixed
        | _ladder(diagnosis)
        | _budget(diagnosis, diagnosis.budget)
        | models
        | _effects(shown)
        | _arrays(shown)
    )


def _finding(finding: Finding, diagnosis: Diagnosis) -> dict[str, Any]:
    name = _NOTES.get(finding.name) if not finding.mistake else None
    explained = finding.name == "consistent" and diagnosis.missing and _is_off(finding)
    return {
        "name": name or capitalize_first(label(finding.name)),
        "sentence": sentence(finding.sentence) + (f" {phrase('imbalance_of_effects')}" if explained else ""),
        "grounds": sentence(finding.grounds) if finding.grounds else "",
        "evidence": _evidence(finding.evidence),
        "note": phrase("correction_note", finding),
        "fatal": finding.fatal,
        "mistake": finding.mistake,
    }


def _is_off(finding: Finding) -> bool:
    """Whether a coefficient of the moment balance differs from 1 by more than its error."""
    values = {one.quantity: one.value for one in finding.evidence}
    pairs = [(values.get(f"{name}_measured"), values.get(f"{name}_error_measured")) for name in "ab"]
    return any(isinstance(x, float) and isinstance(e, float) and abs(x - 1) > Z_95 * e for x, e in pairs)


def _evidence(numbers: Sequence[Evidence]) -> list[tuple[str, str]]:
    """Each quantity in words with its value, and with its standard error where that comes next."""
    rows = list[tuple[Evidence, float | str | None]]()
    for one in numbers:
        last = rows[-1][0].quantity if rows else ""
        if one.quantity in ("error", "standard_error") or one.quantity.replace("_error", "") == last:
            rows[-1] = rows[-1][0], one.value
        else:
            rows.append((one, None))
    return [(label(one.quantity.removesuffix("_measured")), _value(one, error)) for one, error in rows]


def _value(one: Evidence, error: float | str | None) -> str:
    if isinstance(one.value, str):
        return one.value
    return measured(one.value, error if isinstance(error, float) else None, one.unit)


def _ladder(diagnosis: Diagnosis) -> dict[str, Any]:
    """Rungs, laws by their error, and the regions in which the law fails."""
    base = base_label(diagnosis)
    shown = places(diagnosis.record, diagnosis.sample)
    compared = sorted(diagnosis.laws, key=lambda one: one.error)
    return {
        "base": base,
        "ladder": [
            {"name": rung_label(rung, base), "kind": str(rung.kind), **bounded(rung.error)} for rung in diagnosis.ladder
        ],
        "laws": [{"label": law_style(one.name).label, "error": finely(one.error)} for one in compared],
        "regions": [_region(region, shown) for region in diagnosis.regions],
        "no_region": phrase("no_region"),
    } | _search(diagnosis)


def _search(diagnosis: Diagnosis) -> dict[str, Any]:
    """The best model of each number of effects, and the models that the data cannot tell apart."""
    return {
        "frontier": [{"name": searched_name(diagnosis, m), **bounded(m.error)} for m in diagnosis.frontier],
        "plausible": [
            {"name": listed_name(diagnosis, m), "share": share_of_whole(m.share)} for m in listed_models(diagnosis)
        ],
        "search_notes": phrases("notes", diagnosis),
    }


def _region(region: Region, shown: Mapping[int, int]) -> dict[str, Any]:
    same = {name: getattr(region, name) for name in ("variable", "where", "low", "high", "trials", "p_value")}
    ratio = {"ratio": region.ratio.mean, "interval": [region.ratio.low, region.ratio.high]}
    return digits(same | ratio | {"rows": [shown[row] for row in region.rows if row in shown]})


def _budget(diagnosis: Diagnosis, budget: ErrorBudget) -> dict[str, Any]:
    """What the ladder lacks of the budget: models that name nothing, the bound, and the shares."""
    return {
        "limits": phrase("flexible_limits", budget),
        "parts_of_error": [
            {"name": name, "kind": kind, "share": share, "text": share_of_whole(share)}
            for kind, (name, share) in budget.shares.parts.items()
        ],
        "bound": {"mean": budget.bound.mean, "note": phrase("bound", diagnosis)},
        "shares": phrase("shares", budget),
        "scatter": [] if diagnosis.scatter is None else phrases("scatter", diagnosis.scatter),
    }


def _models(diagnosis: Diagnosis, choices: Choices) -> dict[str, Any]:
    """Every choice of the effects in play; the page starts with all of them."""
    base = base_label(diagnosis)
    in_play = set(choices.effects)
    on = [effect_label(missing.effect) for missing in diagnosis.missing if missing.effect not in in_play]
    always = [base, *(f"{name} (always on)" for name in on)]
    models = []
    for k, error in enumerate(choices.errors):
        ticked = [effect_label(effect) for j, effect in enumerate(choices.effects) if k >> j & 1]
        models.append({"name": " + ".join((*always, *ticked)), **bounded(error)})
    return {
        "models": models,
        "yardstick": 0,
        "chosen": len(models) - 1,
        "switches": [
            {"name": str(effect), "label": effect_label(effect), "short": label(effect.name)}
            for effect in choices.effects
        ],
        "always": [*map(effect_label, diagnosis.given), *on],
    }


def _effects(diagnosis: Diagnosis) -> dict[str, Any]:
    """Effects with their rivals, the next experiment, and the residual."""
    partials = () if diagnosis.record is None else diagnosis.record.residuals
    listed = listed_candidates(diagnosis)
    return {
        "effects": [
            effect_content(missing, partial, diagnosis)
            for missing, partial in zip(diagnosis.missing, partials, strict=True)
        ],
        "no_effect": phrase("no_effect"),
        "undecided": undecided_laws(diagnosis),
        "candidates": [candidate_content(candidate) for candidate in listed],
        "proxy": phrase("proxy") if any(candidate.proxy for candidate in listed) else "",
        "experiment": None if diagnosis.experiment is None else experiment_content(diagnosis.experiment),
        "residual": None if diagnosis.remainder is None else residual_content(diagnosis.remainder, diagnosis.formulas),
        "equation": diagnosis.equation,
    }


def _arrays(diagnosis: Diagnosis) -> dict[str, Any]:
    """Trials, the laws' impulses and reach, the outcome of every choice, the change by each effect."""
    record = diagnosis.record
    assert record is not None
    impacts, given = record.impacts, diagnosis.law_impulses()
    fitted, arrays = of_laws(given)
    arrays |= of_outcomes(impacts, record.outcomes)
    if record.residuals:
        arrays["explained"] = torch.stack([partial.explained for partial in record.residuals], -1)
    trials = of_trials(impacts, record.variables())
    return {"fitted": fitted, "impulses": impulse_figure(given.first), "trials": trials, **packed(arrays, STEPS)}


def sample_content(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return what was diagnosed, the answers, and the map of all trials; nothing for a table diagnosed whole."""
    sample = diagnosis.sample
    if sample is None:
        return {}
    shown = f"The figures below show {counted(min(EMBEDDED, sample.trials))} of the {counted(sample.trials)} diagnosed"
    return {
        "sample": {
            "sentences": phrases("sample_summary", sample),
            "answers": [
                {"trials": counted(answer.trials), "answer": phrase("answer", answer), "error": bounded(answer.error)}
                for answer in sample.answers
            ],
            "map": _map(sample.confirmation.map),
            "shown": f"{shown} trials one by one, every k-th of the sequence.",
        }
    }


def places(record: Record | None, sample: Sample | None) -> dict[int, int]:
    """Return the rows of the record that a page has, each with its place there: all, or of a sample every k-th."""
    trials = 0 if record is None else len(record.impacts)
    if sample is None or trials <= EMBEDDED:
        return {row: row for row in range(trials)}
    rows = torch.linspace(0, trials - 1, EMBEDDED).round().long().tolist()
    return {row: place for place, row in enumerate(rows)}


def thinned(record: Record, sample: Sample | None) -> Record:
    """Return the part of a record that a page has."""
    rows = torch.tensor([*places(record, sample)])
    if len(rows) == len(record.impacts):
        return record
    residuals = tuple(
        replace(residual, x=residual.x[rows], measured=residual.measured[rows], explained=residual.explained[rows])
        for residual in record.residuals
    )
    impacts, outcomes = record.impacts[rows], record.outcomes[:, rows]
    return Record(
        impacts=impacts,
        base=record.base,
        model=record.model,
        outcomes=outcomes,
        residuals=residuals,
        deviations=record.deviations,
    )


def _map(cells: ErrorMap) -> dict[str, Any]:
    """The cells with the labels of their axes."""
    labels = {
        key: f"{letter} ({unit})" if unit != "–" else letter
        for key, (_, letter, unit) in (("across", cells.across), ("up", cells.up))
    }
    errors = {"law": digits(cells.law), "named": digits(cells.named)}
    return {"columns": cells.columns, "limits": digits(cells.limits), "trials": list(cells.trials), **labels, **errors}
