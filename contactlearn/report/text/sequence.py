"""What remains and follows the sequence of the trials, in words."""

from contactlearn.core.numerics import number
from contactlearn.diagnosis.result import Past, Succession
from contactlearn.report.text.names import COEFFICIENTS
from contactlearn.report.text.numbers import p_value, share_interval

_QUANTITIES = {
    Past.NORMAL_SPEED: "normal speed",
    Past.NORMAL_IMPULSE: "normal impulse",
    Past.SLIP: "signed slip velocity",
    Past.SLIP_SPEED: "slip speed",
    Past.SPIN: "signed spin",
    Past.SPIN_RATE: "spin rate",
    Past.TANGENTIAL_IMPULSE: "signed tangential impulse",
}


def follows(found: Succession) -> str:
    """Say which coefficient follows what, in a clause."""
    coefficient = COEFFICIENTS[found.coefficient]
    if found.follows is Past.ORDER:
        return f"{coefficient} drifts along the sequence, correlated over about {number(found.trials, 2)} trials"
    if found.follows is Past.PERIOD:
        return f"{coefficient} changes periodically along the sequence, every {number(found.trials, 3)} trials"
    if found.follows is Past.PLACE:
        near = f"within {number(1e3 * (found.width or 0.0), 2)} mm"
        return (
            f"{coefficient} depends on how many of the last {number(found.trials, 3)} impacts were {near} "
            "of the same place"
        )
    if found.trials == 1:
        return f"{coefficient} depends on the previous impact's {_QUANTITIES[found.follows]}"
    return f"{coefficient} depends on the last {number(found.trials, 1)} impacts' {_QUANTITIES[found.follows]}"


def succession(found: Succession) -> str:
    """Say the same with its certainty and its size, without a full stop."""
    size = f"modelling this dependence reduces the held-out residual by {share_interval(found.share)}"
    return f"{follows(found)} ({p_value(found.p_value)}); none of the known effects explains it, and {size}"
