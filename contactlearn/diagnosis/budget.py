"""The error budget: the error of a law in noise, explained, unexplained, and beyond any rigid contact."""

import torch

from contactlearn.diagnosis.noise import NoiseFloor
from contactlearn.diagnosis.result import ErrorBudget, ErrorLimits, ErrorShares
from contactlearn.diagnosis.search.selection import Selection
from contactlearn.diagnosis.unexplained.remainder import LearnedRemainder
from contactlearn.inference.evaluation import bounds
from contactlearn.inference.evaluation.metrics import Interval, bootstrap, mass_error
from contactlearn.inference.validation import RESAMPLES, held_out_interval


def error_limits(selection: Selection, ceiling: LearnedRemainder, generator: torch.Generator) -> ErrorLimits:
    """Compute the errors of the law, of processes on top of it that see the whole state, and of the best rigid contact.

    Args:
        selection: around the law.
        ceiling: the processes on the residual of its base.
        generator: of the bootstrap.
    """
    impacts = selection.impacts
    return ErrorLimits(
        base=held_out_interval(selection.base.error, generator),
        ceiling=held_out_interval(ceiling.error, generator),
        bound=bootstrap(mass_error(impacts, bounds.irb(impacts, "mass")), generator, RESAMPLES),
    )


def error_budget(
    limits: ErrorLimits, *, base: Interval, named: Interval, flexible: Interval, floor: NoiseFloor
) -> ErrorBudget:
    """Divide the error of the law into shares.

    Args:
        limits: of the law alone.
        base: error of the law, on the ladder.
        named: error with all effects, on the ladder.
        flexible: error with processes on the residual of that model.
        floor: the noise.
    """
    noise = floor.error.mean
    whole = base.mean or 1.0  # of exact data
    shares = ErrorShares(
        noise=noise / whole,
        explained=(base.mean - named.mean) / whole,
        unexplained=max(0.0, named.mean - noise) / whole,
        beyond_rigid=max(0.0, limits.bound.mean - noise) / whole,
    )
    return ErrorBudget(
        base=base,
        ceiling=limits.ceiling,
        bound=limits.bound,
        named=named,
        flexible=flexible,
        noise=floor.error,
        noise_source=floor.source,
        shares=shares,
    )
