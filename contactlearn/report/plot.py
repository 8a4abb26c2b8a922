"""Figures of results, as matplotlib `Figure` objects: `cl.plot.ladder(found).savefig("ladder.png")`.

ladder, laws_compared, frontier   held-out errors of a diagnosis: effect by effect, law by law, size by size
regions, residual                 where its law fails, and what its full model leaves
effect                            an effect's curve through the residual that it explains
comparison                        the table of `cl.compare` as bars
predictions                       predicted against measured velocities after contact
impulse_space                     the impulses that laws can give one impact
convergence, trial_parameters     fits to subsets and to single trials
planned                           the drops of a plan among those that were measured
error_densities, learning_curve   errors of learned models, and how they fall with trials
"""

from typing import TYPE_CHECKING

from matplotlib.figure import Figure

from contactlearn.core.errors import ContactLearnError, UnknownNameError, no_attribute
from contactlearn.diagnosis.result import Diagnosis, Record
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.report.figures import diagnosis as figures, style
from contactlearn.report.figures.comparison import error_comparison
from contactlearn.report.figures.diagnosis import (
    frontier_figure as frontier,
    ladder_figure as ladder,
    laws_figure as laws_compared,
)
from contactlearn.report.figures.effects import effect_curve
from contactlearn.report.figures.impulse_space import compared_impulses as impulse_space, reachable_impulses
from contactlearn.report.figures.laws import convergence, cost_map, trial_parameters
from contactlearn.report.figures.learning import error_densities, learning_curve, transfer_errors
from contactlearn.report.figures.plan import plan_figure as planned
from contactlearn.report.figures.quality import predicted_against_measured
from contactlearn.report.figures.tracks import contact_figure as contact

if TYPE_CHECKING:
    from pandas import DataFrame

__all__ = [
    "comparison", "contact", "convergence", "cost_map", "effect", "effect_curve", "error_comparison",
    "error_densities", "frontier", "impulse_space", "ladder", "laws_compared", "learning_curve", "planned",
    "predictions", "reachable_impulses", "regions", "residual", "style", "transfer_errors", "trial_parameters",
]  # fmt: skip


if not TYPE_CHECKING:  # with it a type checker would take any name for a figure

    def __getattr__(name: str) -> object:
        raise no_attribute("contactlearn.plot", name, __all__)


def regions(diagnosis: Diagnosis) -> Figure:
    """Draw the regions in which the law fails, with the error along the variable of each.

    Raises:
        ContactLearnError: the diagnosis found none, or has no record.
    """
    if not diagnosis.regions:
        raise ContactLearnError(f"no region in which the law fails was found: {diagnosis!r}")
    return figures.regions_figure(diagnosis.regions, _record(diagnosis))


def residual(diagnosis: Diagnosis) -> Figure:
    """Draw the part of the residual that Gaussian processes still predict.

    Raises:
        ContactLearnError: the diagnosis found none, or has no record.
    """
    if diagnosis.remainder is None:
        raise ContactLearnError(f"there is no remainder to draw: {diagnosis!r}")
    return figures.residual_figure(diagnosis.remainder, _record(diagnosis))


def effect(diagnosis: Diagnosis, name: str) -> Figure:
    """Draw a missing effect's curve through the residual that it explains.

    Raises:
        UnknownNameError: no such effect among the missing ones.
    """
    if name not in diagnosis.effects:
        raise UnknownNameError("missing effect", name, diagnosis.effects)
    return effect_curve(_record(diagnosis).residuals[diagnosis.effects.index(name)])


def comparison(table: "DataFrame") -> Figure:
    """Draw the table of `compare`: a bar for each model with its 95 % interval."""
    intervals = [Interval(*row) for row in table[["error", "low", "high"]].itertuples(index=False)]
    with style.look():
        return figures.error_bars([str(name) for name in table.index], intervals)


def predictions(impacts: Impacts, prediction: Prediction) -> Figure:
    """Draw predicted against measured velocities after contact."""
    return predicted_against_measured(impacts.v_post, prediction.v_post)


def _record(diagnosis: Diagnosis) -> Record:
    if diagnosis.record is None:
        raise ContactLearnError("the diagnosis has no record of its trials; read a run folder with its record")
    return diagnosis.record
