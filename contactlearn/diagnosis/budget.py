"""The error budget: what of the error of a law is noise, explained, left, or out of reach of any rigid contact."""

from dataclasses import asdict
from typing import Any

import torch

from contactlearn.diagnosis.noise import HOW, Floor
from contactlearn.diagnosis.search.ladder import RESAMPLES, interval
from contactlearn.diagnosis.search.selection import Selection
from contactlearn.diagnosis.unexplained.remainder import Remainder
from contactlearn.evaluation import bounds
from contactlearn.evaluation.metrics import Interval, bootstrap, mass_error


def first_budget(selection: Selection, ceiling: Remainder, generator: torch.Generator) -> dict[str, Any]:
    """Errors of the base, of processes on top of it that see the whole state, and of the best rigid contact."""
    impacts = selection.impacts
    return {
        "base": asdict(interval(selection.base.error, generator)),
        "ceiling": asdict(interval(ceiling.error, generator)),
        "bound": asdict(bootstrap(mass_error(impacts, bounds.irb(impacts, "mass")), generator, RESAMPLES)),
    }


def full_budget(budget: dict[str, Any], steps: tuple[tuple[str, Interval], ...], floor: Floor) -> dict[str, Any]:
    """The budget with what was found, and the error of the law in shares."""
    *_, (_, named), (_, flexible), _ = steps
    base, noise = steps[0][1].mean, floor.error.mean
    whole = base or 1.0  # of exact data
    return budget | {
        "base": asdict(steps[0][1]),
        "named": asdict(named),
        "flexible": asdict(flexible),
        "noise": asdict(floor.error) | {"how": HOW[floor.how]},
        "shares": {
            "noise": noise / whole,
            "explained": (base - named.mean) / whole,
            "left": max(0.0, named.mean - noise) / whole,
            "beyond_rigid": max(0.0, budget["bound"]["mean"] - noise) / whole,
        },
    }
