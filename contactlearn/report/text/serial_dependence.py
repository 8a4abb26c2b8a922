"""What remains and follows the sequence of the trials, in words."""

from contactlearn.core.numerics import number
from contactlearn.diagnosis.result import LaggedVariable, SerialDependence
from contactlearn.report.text.names import COEFFICIENTS
from contactlearn.report.text.numbers import p_value, share_interval

_QUANTITIES = {
    LaggedVariable.NORMAL_SPEED: "normal speed",
    LaggedVariable.NORMAL_IMPULSE: "normal impulse",
    LaggedVariable.SLIP: "signed slip velocity",
    LaggedVariable.SLIP_SPEED: "slip speed",
    LaggedVariable.SPIN: "signed spin",
    LaggedVariable.SPIN_RATE: "spin rate",
    LaggedVariable.TANGENTIAL_IMPULSE: "signed tangential impulse",
}


def follows(found: SerialDependence) -> str:
    """Say which coefficient follows what, in a clause."""
    coefficient = COEFFICIENTS[found.coefficient]
    if found.variable is LaggedVariable.ORDER:
        return f"{coefficient} drifts along the sequence, correlated over about {number(found.trials, 2)} trials"
    if found.variable is LaggedVariable.PERIOD:
        return f"{coefficient} changes periodically along the sequence, every {number(found.trials, 3)} trials"
    if found.variable is LaggedVariable.PLACE:
        near = f"within {number(1e3 * (found.width or 0.0), 2)} mm"
        return (
            f"{coefficient} depends on how many of the last {number(found.trials, 3)} impacts were {near} "
            "of the same place"
        )
    if found.trials == 1:
        return f"{coefficient} depends on the previous impact's {_QUANTITIES[found.variable]}"
    return f"{coefficient} depends on the last {number(found.trials, 1)} impacts' {_QUANTITIES[found.variable]}"


def serial_dependence(found: SerialDependence) -> str:
    """Say the same with its certainty and its size, without a full stop."""
    size = f"modelling this dependence reduces the held-out residual by {share_interval(found.share)}"
    return f"{follows(found)} ({p_value(found.p_value)}); none of the known effects explains it, and {size}"
