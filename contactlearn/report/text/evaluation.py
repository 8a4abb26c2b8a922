"""An evaluation in words: the model with the least error, the models that differ from it, and the bounds."""

from collections.abc import Mapping

from contactlearn.core.numerics import number
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.report.text.names import join_words, shortened
from contactlearn.report.text.numbers import interval

_FEW = 2  # models that a headline names beside the best
_BOUNDS = {
    "best_post_hoc": "The best law of each trial, chosen after the fact (Best Post Hoc), has",
    "irb": "The ideal rigid-body bound (IRB), the lowest error of any rigid point contact, is",
}


def evaluation_headline(labels: Mapping[str, str], best: str, behind: Mapping[str, Interval]) -> str:
    """Name the model with the least error, and the models that these data cannot distinguish from it.

    Args:
        labels: of the models by name.
        best: the model with the least mean error.
        behind: paired difference of each other model's error from that of the best, the smallest first.
    """
    if not behind:
        return f"{labels[best]} is the only model here."
    said = f"{labels[best]} has the lowest error of {len(behind) + 1} models"
    near = [labels[name] for name, more in behind.items() if more.low <= 0]
    if not near:
        return f"{said}."
    most = len(near) if len(near) == _FEW + 1 else _FEW
    return f"{said}, but these data cannot distinguish it from {join_words(shortened(near, most, 'model'), 'or')}."


def evaluation_summary(
    labels: Mapping[str, str],
    errors: Mapping[str, Interval],
    best: str,
    behind: Mapping[str, Interval],
    closest: str,
    trials: int,
) -> list[str]:
    """Write the numbers behind the headline, a sentence each.

    Args:
        labels: of the models by name.
        errors: held-out mass error of every model and bound.
        best, behind: as of `evaluation_headline`.
        closest: the law with the least error.
        trials: that were held out.
    """
    said = [f"On {trials} held-out trials {labels[best]} has a mass error of {interval(errors[best])}."]
    worse = next((name for name, more in behind.items() if more.low > 0), None)
    if worse is not None:
        mean, low, high = (number(x, 2) for x in behind[worse])
        which = "next" if worse == next(iter(behind)) else "next that these data can distinguish from it"
        said.append(
            f"The {which}, {labels[worse]}, has an error higher by {mean} (95\u00a0%: {low}–{high}) on the same trials."
        )
    elif behind:
        said.append("No other model differs from it by more than chance on the same trials.")
    if best != closest:
        said.append(f"Among the laws alone, {labels[closest]} has the lowest error, {interval(errors[closest])}.")
    return said + [f"{words} {interval(errors[name])}." for name, words in _BOUNDS.items() if name in errors]
