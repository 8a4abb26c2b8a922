"""Errors of predicted trajectories in words."""

import math

from contactlearn.core.numerics import number
from contactlearn.inference.evaluation.replay import FAR, ReplayErrors, Spread
from contactlearn.report.text.numbers import percent

_DEGREES = 180 / math.pi


def replay_cells(errors: ReplayErrors) -> tuple[str, str, str, str]:
    """Write distance, angle, the time until a prediction is lost, and shares in the bands of a fan by bounce."""
    lost = "to the end" if errors.lost_after is None else f"{number(errors.lost_after, 2)} s"
    shares = () if errors.coverage is None else map(percent, filter(math.isfinite, errors.coverage))
    return _spread(errors.distance, 100, "%"), _spread(errors.angle, _DEGREES, "°"), lost, ", ".join(shares)


def replay_sentence(errors: ReplayErrors) -> str:
    """Write the errors in a line."""
    distance, angle, lost, shares = replay_cells(errors)
    held = f"; of recorded positions {shares} lie in the 90 % bands after one, two, three bounces" if shares else ""
    return f"distance {distance} of the width, angle {angle}; within {percent(FAR)} {lost} in the median{held}"


def _spread(one: Spread, factor: float, unit: str) -> str:
    mean, deviation, median = (number(factor * x, 3) for x in (one.mean, one.deviation, one.median))
    return f"{mean} ± {deviation}{unit} (median {median}{unit})"
