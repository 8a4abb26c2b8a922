"""When to stop: a rule for looks in sequence that does not raise false names.

Each look at more drops is a further chance for a false name at probability 0.9.  So

    settled    the same names, at least one, are found at `LOOKS` looks in a row, and none beside them is probable
    no gain    the next batch was expected to add too little at as many looks in a row, and no name is merely probable
    budget     the drops that were granted are made

A name that one look has and the next has not is never settled.  Between two looks lies a batch that was chosen to
separate the names in question, so that a false one, which fits the drops before by chance, must fit these as well.
`benchmarks/accuracy/plan.py` measures how often a false name is settled, in worlds without effects too.
"""

from collections.abc import Sequence

from contactlearn.planning.result import Goal, Look, Stop

LOOKS = 2
"""Looks in a row that must agree."""
WORTHWHILE = {Goal.NAMES: 0.01, Goal.PARAMETERS: 0.05, Goal.PREDICTION: 0.05}
"""What a batch must add: to the probability of the right name, or as a relative fall of errors."""


def decide(goal: Goal, looks: Sequence[Look], budget: int, batch: int) -> Stop | None:
    """Return why to stop after some looks, or None to go on.

    Args:
        goal: of the plans.
        looks: so far, the last one at all measurements.
        budget: impacts to measure at most, all told.
        batch: number of drops of the next plan.
    """
    last = looks[-LOOKS:]
    if len(last) == LOOKS and not any(look.probable for look in last):
        same = all(look.found == last[0].found for look in last)
        if goal is Goal.NAMES and same and last[0].found:
            return Stop.SETTLED
        if same and all(look.gain < WORTHWHILE[goal] for look in last):
            return Stop.NO_GAIN
    if looks and looks[-1].trials + batch > budget:
        return Stop.BUDGET
    return None
