"""The subsamples of a large table as data of its page, and the part of the diagnosed trials that the page has."""

from dataclasses import replace
from typing import Any

import torch
from jaxtyping import Int
from torch import Tensor

from contactlearn.diagnosis.result import Diagnosis, ErrorMap, Record, Sample
from contactlearn.inference.evaluation.partial_residuals import Partial
from contactlearn.report.page.trials import EMBEDDED, bounded, digits
from contactlearn.report.text import phrase, phrases
from contactlearn.report.text.numbers import counted


def sample_content(found: Diagnosis) -> dict[str, Any]:
    """Return what was diagnosed, the answers, and the map of all trials; nothing for a table diagnosed whole."""
    sample = found.sample
    if sample is None:
        return {}
    shown = f"The figures below show {counted(min(EMBEDDED, sample.trials))} of the {counted(sample.trials)} diagnosed"
    return {
        "sample": {
            "sentences": phrases("sample_summary", sample),
            "answers": [
                {"trials": counted(one.trials), "answer": phrase("answer", one), "error": bounded(one.error)}
                for one in sample.answers
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
    return Record(
        impacts=record.impacts[rows],
        base=record.base,
        model=record.model,
        outcomes=record.outcomes[:, rows],
        residuals=tuple(_part(one, rows) for one in record.residuals),
    )


def _part(partial: Partial, rows: Int[Tensor, " k"]) -> Partial:
    arrays = {name: getattr(partial, name)[rows] for name in ("x", "measured", "explained")}
    return replace(partial, **arrays)


def _map(cells: ErrorMap) -> dict[str, Any]:
    """The cells with the labels of their axes."""
    labels = {
        key: f"{letter} ({unit})" if unit != "–" else letter
        for key, (_, letter, unit) in (("across", cells.across), ("up", cells.up))
    }
    errors = {"law": digits(cells.law), "named": digits(cells.named)}
    return {"columns": cells.columns, "limits": digits(cells.limits), "trials": list(cells.trials), **labels, **errors}
