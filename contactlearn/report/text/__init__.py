"""The words and number formats of terminal, page, figures and run cards, each in one place.

    sentences    templates of all sentences about a diagnosis, an evaluation and fitted parameters
    names        laws, models, effects, rungs and components as a person writes them; lists and sentences
    numbers      errors, shares, comparisons
    tracks       impacts found in recordings

A no-break space stands between a number and its % sign; the terminal prints it as a space.
"""

from contactlearn.core.numerics import measured, number
from contactlearn.report.text.names import (
    WRENCH,
    base_label,
    capitalize_first,
    effect_label,
    join_words,
    label,
    law_label,
    model_labels,
    rung_label,
    sentence,
)
from contactlearn.report.text.numbers import (
    NO_INTERVAL,
    brief_interval,
    compared,
    error,
    fine_percent,
    fix_spacing,
    interval,
    percent,
    share_of_whole,
)
from contactlearn.report.text.sentences import (
    conclusion,
    confidence,
    correct_setting,
    formula_overrides,
    headline,
    in_words,
    listed_models,
    listed_name,
    misfit,
    names_by_level,
    phrase,
    phrases,
    searched_name,
    undecided,
)

__all__ = [
    "NO_INTERVAL",
    "WRENCH",
    "base_label",
    "brief_interval",
    "capitalize_first",
    "compared",
    "conclusion",
    "confidence",
    "correct_setting",
    "effect_label",
    "error",
    "fine_percent",
    "fix_spacing",
    "formula_overrides",
    "headline",
    "in_words",
    "interval",
    "join_words",
    "label",
    "law_label",
    "listed_models",
    "listed_name",
    "measured",
    "misfit",
    "model_labels",
    "names_by_level",
    "number",
    "percent",
    "phrase",
    "phrases",
    "rung_label",
    "searched_name",
    "sentence",
    "share_of_whole",
    "undecided",
]
