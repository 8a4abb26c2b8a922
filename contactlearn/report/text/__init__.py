"""The words and number formats of terminal, page, figures and run cards, each in one place.

    numbers      errors, shares, comparisons
    names        laws, models, effects, rungs and components as a person writes them
    stages       the result of each stage of a diagnosis in a sentence
    sequence     what remains and follows the sequence of the trials
    samples      the subsamples of a large table, and the test on all of it
    search       error against number of effects, and models that the data cannot tell apart
    verdict      the conclusion of a diagnosis in one line, and the numbers behind it
    known        parameters that flight has measured, and what the impacts say of them
    evaluation   the model with the least error, and its distance to the others

A no-break space stands between a number and its % sign; the terminal prints it as a space.
"""

from contactlearn.core.numerics import measured, number
from contactlearn.report.text.names import (
    WRENCH,
    base_label,
    effect_label,
    label,
    law_label,
    join_words,
    model_labels,
    capitalize_first,
    rung_label,
    sentence,
)
from contactlearn.report.text.numbers import (
    brief_interval,
    compared,
    error,
    interval,
    percent,
    fix_spacing,
)
from contactlearn.report.text.verdict import conclusion, confidence, headline, summary, support

__all__ = [
    "WRENCH",
    "base_label",
    "brief_interval",
    "compared",
    "conclusion",
    "confidence",
    "effect_label",
    "error",
    "headline",
    "interval",
    "label",
    "law_label",
    "join_words",
    "measured",
    "model_labels",
    "number",
    "capitalize_first",
    "percent",
    "rung_label",
    "sentence",
    "fix_spacing",
    "summary",
    "support",
]
