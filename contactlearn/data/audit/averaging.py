"""Averaging of velocities before impact that vary by no more than their noise: a constant height of the drops, no spin.

A law that is given such measurements predicts worse than one that is given their mean, and an effect that weakens the
dependence on them looks as if it were missing (regression dilution).  Therefore, where the spread of a column is hardly
larger than the residual of flexible models in the outcome, its mean replaces it if the law then predicts held-out
trials at least as well.
Source: Carroll, Ruppert, Stefanski & Crainiceanu 2006, Ch. 4: the limit of regression calibration.
"""

from collections.abc import Callable

from jaxtyping import Float
from torch import Tensor

from contactlearn.core.numerics import MAD_SCALE
from contactlearn.data.audit.corrections import CORRECTIONS, correct
from contactlearn.data.audit.result import Evidence, Finding
from contactlearn.data.audit.thresholds import AuditThresholds
from contactlearn.mechanics.impacts import Impacts

_COLUMNS = (("averaged_vx", "v_x", "m/s"), ("averaged_vy", "v_y", "m/s"), ("averaged_omega", "ω", "rad/s"))


def averaged(
    impacts: Impacts,
    predicted: Float[Tensor, "n 3"],
    held_out: Callable[[Impacts], float],
    thresholds: AuditThresholds = AuditThresholds(),
) -> tuple[Finding, ...]:
    """Find the velocities before impact whose mean serves the law at least as well as their measurements.

    Args:
        impacts: measurements.
        predicted: v_post in (m/s, m/s, rad/s) by flexible models on held-out trials, nan where there is none.
        held_out: error of the law on held-out trials, from the impacts.
        thresholds: of the audit.

    Returns:
        A note for each such velocity, with its correction.
    """
    found, error = [], held_out(impacts)
    residual = MAD_SCALE * (impacts.v_post - predicted).abs().nanmedian(0).values
    for k, (name, letter, unit) in enumerate(_COLUMNS):
        spread = impacts.v_pre[:, k].std().item()
        if not 0 < spread < thresholds.noisy_spread * residual[k].item():
            continue
        changed = correct(impacts, [name])
        with_mean = held_out(changed)
        if with_mean <= error:
            sentence = (
                f"{CORRECTIONS[name].description}: {letter} has a standard deviation of {spread:.2g} {unit}; on trials "
                f"held out the law leaves {with_mean:.4g} with its mean and {error:.4g} with its measurements"
            )
            evidence = (
                Evidence(quantity="spread", value=spread, unit=unit),
                Evidence(quantity="error_before", value=error),
                Evidence(quantity="error_after", value=with_mean),
            )
            found.append(Finding(name=name, sentence=sentence, evidence=evidence, correction=name, mistake=False))
            impacts, error = changed, with_mean
    return tuple(found)
