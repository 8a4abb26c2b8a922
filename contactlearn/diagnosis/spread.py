"""Velocities before impact that vary by no more than their noise: a constant height of the drops, no spin.

Their scatter is then mistaken for variation: a law that answers to it predicts worse than one that is told the mean,
and whatever damps that answer looks like a missing effect (regression dilution).  So the mean of such a column is used
where with it the law predicts trials held out at least as well.
Source: Carroll, Ruppert, Stefanski & Crainiceanu 2006, Ch. 4, whose calibration has this as its limit.
"""

from collections.abc import Callable

from contactlearn.data.corrections import CORRECTIONS, correct
from contactlearn.diagnosis.audit import Finding
from contactlearn.fit_effects import JointFit
from contactlearn.impacts import Impacts

COLUMNS = {"averaged_vx": ("v_x", "m/s"), "averaged_vy": ("v_y", "m/s"), "averaged_omega": ("ω", "rad/s")}
_NOISY = 3.0  # times what the law leaves of a column: what varies more is told from its noise


def averaged(impacts: Impacts, fit: JointFit, held_out: Callable[[Impacts], float]) -> tuple[Finding, ...]:
    """A finding for each velocity before impact whose mean serves the law better than its measurements.

    Args:
        fit: of the law to these impacts.
        held_out: error of the law on trials held out, from the impacts.
    """
    found, error = [], held_out(impacts)
    left = fit.scatter.diagonal().sqrt()
    for k, (name, (letter, unit)) in enumerate(COLUMNS.items()):
        spread = impacts.v_pre[:, k].std().item()
        if not 0 < spread < _NOISY * left[k].item():
            continue
        changed = correct(impacts, [name])
        with_mean = held_out(changed)
        if with_mean <= error:
            sentence = (
                f"{CORRECTIONS[name].description}: {letter} has a standard deviation of {spread:.2g} {unit}; on trials "
                f"held out the law leaves {with_mean:.4g} with its mean and {error:.4g} with its measurements"
            )
            evidence = {"spread": spread, "error_before": error, "error_after": with_mean}
            found.append(Finding(name, sentence, evidence, name, mistake=False))
            impacts, error = changed, with_mean
    return tuple(found)
