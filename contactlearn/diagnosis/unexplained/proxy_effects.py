"""Proxy effects: catalogue effects that are selected because each captures part of an unmodelled dependence.

A dependence on two variables leaves traces that several known effects absorb.  So where the remainder of a chosen model
depends on the state, the remainders of smaller models are fitted over the state as well.  Effects without which these
fits predict the held-out trials no worse are proxies.  A true effect is no proxy: processes would have to learn it in
addition to the rest, and its formula knows it better.
Source: the least complex model within chance of the best, Breiman, Friedman, Olshen & Stone 1984.
"""

import math
from collections.abc import Sequence

from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.diagnosis.unexplained.state_dependence import fit_state_dependence
from contactlearn.inference.identification.joint import Fit, FitOptions
from contactlearn.mechanics.impacts import Impacts

_TRIALS = 300  # trials that processes are fitted to and tested on, at most


def index_without_proxies(
    impacts: Impacts,
    fits: Sequence[Fit],
    options: FitOptions,
    thresholds: Thresholds,
    block: int = 1,
) -> int:
    """Find the smallest model that predicts no worse than any other, once its remainder is fitted over the state.

    Args:
        impacts: measurements.
        fits: fits of models to all of them, those of fewer effects first; the last remainder depends on the state.
        options: options of the fits.
        thresholds: level of the test, and size of differences that are chance.
        block: neighbouring trials whose errors may resemble each other.

    Returns:
        The index of the model; the last one if no remainder depends on the state.
    """
    level = thresholds.dependence_level
    dependences = [fit_state_dependence(impacts, fit, options, level, _TRIALS, block) for fit in fits]
    dependent = {k: fitted for k, fitted in enumerate(dependences) if fitted is not None}
    if not dependent:
        return len(fits) - 1
    models = [*dependent.values()]
    error = models[-1].model.errors(*(m.fit.v_post if m.fit.share.mean > 0 else m.model.v_post for m in models))
    worse = error - error[error.mean(1).argmin()]
    chance = thresholds.chance_sigmas * worse.std(1) / math.sqrt(error.shape[1])
    return next(k for k, enough in zip(dependent, worse.mean(1) <= chance, strict=True) if enough)
