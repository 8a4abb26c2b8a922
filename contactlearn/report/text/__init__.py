"""The words and number formats of terminal, page, figures and run cards, each in one place.

    sentences    templates of all sentences about a diagnosis, an evaluation and fitted parameters
    names        laws, models, effects, rungs and components as a person writes them; lists and sentences
    numbers      errors, shares, comparisons
    tracks       impacts found in recordings

A no-break space stands between a number and its % sign; the terminal prints it as a space.
"""

from contactlearn.core.numerics import (
    measured as measured,
    number as number,
)
from contactlearn.report.text.names import (
    FLOORS as FLOORS,
    WRENCH as WRENCH,
    base_label as base_label,
    capitalize_first as capitalize_first,
    effect_label as effect_label,
    join_words as join_words,
    label as label,
    law_label as law_label,
    model_label as model_label,
    model_labels as model_labels,
    rung_label as rung_label,
    sentence as sentence,
    source_label as source_label,
)
from contactlearn.report.text.numbers import (
    NO_INTERVAL as NO_INTERVAL,
    brief_interval as brief_interval,
    compared as compared,
    error as error,
    fine_percent as fine_percent,
    fix_spacing as fix_spacing,
    interval as interval,
    percent as percent,
    share_of_whole as share_of_whole,
)
from contactlearn.report.text.sentences import (
    best_learned as best_learned,
    conclusion as conclusion,
    confidence as confidence,
    correct_setting as correct_setting,
    formula_overrides as formula_overrides,
    grounds as grounds,
    headline as headline,
    in_words as in_words,
    listed_models as listed_models,
    listed_name as listed_name,
    misfit as misfit,
    names_by_level as names_by_level,
    phrase as phrase,
    phrases as phrases,
    searched_name as searched_name,
    undecided as undecided,
)
