"""What remains and depends on the state of each trial, in words."""

from contactlearn.diagnosis.result import StateDependence
from contactlearn.effects.formula.symbols import SYMBOLS
from contactlearn.report.text.names import COEFFICIENTS, label, join_words
from contactlearn.report.text.numbers import p_value, share_interval


def depends(found: StateDependence) -> str:
    """Say what acts like a coefficient that depends on which variables, in a clause."""
    coefficient = COEFFICIENTS[found.coefficient]
    first, *others = (SYMBOLS[one.symbol].letter if one.symbol in SYMBOLS else "the body" for one in found.variables)
    on = f"{first} together with {join_words(others)}" if others else first
    if found.coefficient is None:
        return f"{coefficient} depends on {on} in an unknown way"
    same = "" if found.form_of is None else f", as in {label(found.form_of)} but with another functional form"
    return f"the residual behaves like {coefficient} that depends on {on}{same}"


def state_dependence(found: StateDependence) -> str:
    """Say the same with its certainty and its size, without a full stop."""
    size = f"modelling this dependence reduces the held-out residual by {share_interval(found.share)}"
    known = "none of the known effects explains it, and " if found.form_of is None else ""
    return f"{depends(found)} ({p_value(found.p_value)}); {known}{size}"
