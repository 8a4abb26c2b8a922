"""Reselection of the law: the one that does better with the effects than the law that was best alone."""

from collections.abc import Callable, Iterable, Mapping

from contactlearn.diagnosis.search.selection import Selection
from contactlearn.diagnosis.thresholds import LawThresholds
from contactlearn.diagnosis.validation import held_out_error
from contactlearn.identification.joint import identify_jointly
from contactlearn.laws import Law


def reselected(
    selection: Selection,
    laws: Mapping[str, Law],
    errors: Mapping[str, float],
    thresholds: LawThresholds,
    progress: Callable[[Iterable], Iterable] = iter,
) -> Selection:
    """Repeat the selection around another law, if that law does clearly better with the effects that were chosen.

    Args:
        selection: after its run.
        laws: by name.
        errors: held-out errors of the laws without the effects, by name.
        thresholds: limits of the laws that are tried and taken.
        progress: wraps each round of the selection.

    Returns:
        The selection around the better law, run; or the given one.
    """
    present, own, found = selection.present, selection.law.name, {}
    near = [name for name, error in errors.items() if name != own and error < thresholds.near * errors[own]]
    impacts, folds, options = selection.impacts, selection.folds, selection.options
    for name in near:
        fit = identify_jointly(laws[name], present.effects, impacts, options=options, start=present.fit.values)
        found[name] = held_out_error(laws[name], present.effects, impacts, folds, options, start=fit.values)
    other = min(found, key=found.__getitem__, default=None)
    if other is None or found[other] > thresholds.better * present.mean_error:
        return selection
    again = Selection(laws[other], impacts, selection.candidates, folds, selection.given, options, selection.thresholds)
    again.run(progress)
    return again if again.present.mean_error < present.mean_error else selection
