"""Stand-ins: known effects that a search names for a part each of something unknown.

Something that depends on two variables leaves traces that several known effects take up.  So where the state tells of
the remainder of a chosen model, it is asked of smaller ones as well: each with the processes that learn what it leaves.
Effects without which they predict the held-out trials no worse stand for the unknown.  A true effect is no stand-in:
processes would have to learn it beside the rest, and its formula knows it better.
Source: the least complex model within chance of the best, Breiman, Friedman, Olshen & Stone 1984.
"""

import math
from collections.abc import Sequence

from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.diagnosis.unexplained.state_dependence import fit_state_dependence
from contactlearn.inference.identification.joint import FitOptions, JointFit
from contactlearn.mechanics.impacts import Impacts

_LEARNT = 300  # trials that are learnt from and held out, at most


def drop_proxies(
    impacts: Impacts,
    fits: Sequence[JointFit],
    options: FitOptions,
    thresholds: Thresholds,
    block: int = 1,
) -> int:
    """Find the first model that, with what the state tells of its remainder, predicts no worse than any other.

    Args:
        impacts: measurements.
        fits: of models to all of them, those of fewer effects first; the state tells of the last one's remainder.
        options: of the fits.
        thresholds: of the level, and of differences that are chance.
        block: neighbouring trials whose errors may resemble each other.

    Returns:
        The place of the model; the last one if the state tells of none.
    """
    found = [fit_state_dependence(impacts, fit, options, thresholds.dependence_level, _LEARNT, block) for fit in fits]
    told = [(k, one) for k, one in enumerate(found) if one is not None]
    if not told:
        return len(fits) - 1
    held = [one.fit.v_post if one.fit.share.mean > 0 else one.model.v_post for _, one in told]
    error = told[-1][1].model.errors(*held)
    worse = error - error[error.mean(1).argmin()]
    chance = thresholds.chance_sigmas * worse.std(1) / math.sqrt(error.shape[1])
    return next(k for (k, _), enough in zip(told, worse.mean(1) <= chance, strict=True) if enough)
