"""Velocities before impact that vary by no more than their noise: a constant height of the drops, no spin.

Their scatter is then mistaken for variation: a law that answers to it predicts worse than one that is told the mean,
and whatever damps that answer looks like a missing effect (regression dilution).  So where a column varies hardly more
than the outcome does beyond what even flexible models predict, its mean is used if with it the law predicts trials
held out at least as well.
Source: Carroll, Ruppert, Stefanski & Crainiceanu 2006, Ch. 4, whose calibration has this as its limit.
"""

from collections.abc import Callable

from torch import Tensor

from contactlearn.audit.corrections import CORRECTIONS, correct
from contactlearn.audit.findings import Finding
from contactlearn.impacts import Impacts

COLUMNS = {"averaged_vx": ("v_x", "m/s"), "averaged_vy": ("v_y", "m/s"), "averaged_omega": ("ω", "rad/s")}
_NOISY = 1.5  # times what is left of the outcome: what varies more is told from its noise
_DEVIATIONS = 1.4826  # standard deviations of a Gaussian in a median absolute one


def averaged(impacts: Impacts, predicted: Tensor, held_out: Callable[[Impacts], float]) -> tuple[Finding, ...]:
    """A finding for each velocity before impact whose mean serves the law better than its measurements.

    Args:
        predicted: v_post [N, 3] by flexible models on trials held out.
        held_out: error of the law on trials held out, from the impacts.
    """
    found, error = [], held_out(impacts)
    left = _DEVIATIONS * (impacts.v_post - predicted).abs().nanmedian(0).values
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
