"""What the sequence of the trials explains of a remainder: a coefficient that follows it, and the held-out error then.

What is followed is the input of `learning`: the place in the sequence, the phase of a period, or a quantity of earlier
impacts.  Where velocities that drift alike for every impact do better than a coefficient, the measurement follows the
order, and nothing is said of it here.
"""

from collections.abc import Sequence
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.diagnosis.result.remainder import Coefficient, Past, Succession
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.diagnosis.unexplained.learning import Learning, Learnt
from contactlearn.diagnosis.unexplained.scores import Scores
from contactlearn.diagnosis.unexplained.succession import Memory, Suspect, histories, suspects
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.inference.identification.joint import FitOptions, JointFit
from contactlearn.mechanics.impacts import Impacts

_FEWEST = 40  # trials below which nothing is said
_STRETCH = 560  # trials that are learnt from and held out, at most: as many as follow one another
_TRIED = 4  # suspects, the most surprising ones
_PLACES = 4.0  # trials in the unit of length of processes over the place, whose lengths begin at 7 and at 49 trials


def find_succession(
    impacts: Impacts, fit: JointFit, options: FitOptions, thresholds: Thresholds = Thresholds()
) -> Succession | None:
    """Find what the sequence of the trials tells of a fitted model's remainder; None where it tells nothing.

    Args:
        impacts: measurements, whose errors are independent.
        fit: of a law with effects to all of them.
        options: of the fit.
        thresholds: of the level, and of what is large.
    """
    if len(impacts) < _FEWEST:
        return None
    scores, model = Scores.of_sequence(impacts, fit, options), fit.model
    ordered = impacts[scores.rows]
    history = histories(ordered, model.base_prediction(ordered))
    chance, found = suspects(scores, history, thresholds.sequence.level / 2)
    if not found:
        return None
    first = max(0, (len(ordered) - _STRETCH) // 2)
    stretch = slice(first, first + _STRETCH)
    best = _best(Learning.of(ordered, fit, scores, stretch), stretch, found[:_TRIED])
    if best is None:
        return None
    coefficient, suspect, share, scale = best
    return Succession(
        coefficient=coefficient,
        follows=suspect.follows,
        trials=scale,
        width=suspect.memory.width,
        p_value=chance,
        share=share,
        large=share.mean > thresholds.sequence.share,
    )


def _best(
    learning: Learning, stretch: slice, found: Sequence[Suspect]
) -> tuple[Coefficient | None, Suspect, Interval, float] | None:
    """What takes most of the error away; None where nothing does, or where velocities that drift take more."""
    drift = learning.velocities(_inputs(replace(found[0], memory=Memory(Past.ORDER, 1.0)))[stretch])
    tried: list[tuple[Coefficient | None, Suspect, Learnt]] = []
    for one in found:
        x = _inputs(one)[stretch]
        alike = drift if one.follows is Past.ORDER else learning.velocities(x)
        if one.coefficient is not None:
            own = learning.coefficient(one.coefficient, x)
            if own.share.mean >= alike.share.mean:
                tried.append((one.coefficient, one, own))
                continue
        if one.follows not in (Past.ORDER, Past.PERIOD) and one.memory.trials == 1:
            tried.append((None, one, alike))
    if not tried:
        return None
    coefficient, suspect, learnt = max(tried, key=lambda one: one[2].share.mean)
    if learnt.share.low <= 0 or learnt.share.mean < drift.share.mean:
        return None
    return coefficient, suspect, learnt.share, _scale(suspect, learnt)


def _scale(suspect: Suspect, learnt: Learnt) -> float:
    """Trials over which neighbours resemble each other, of the period, or that are remembered."""
    if suspect.follows is not Past.ORDER:
        return suspect.memory.trials
    return _PLACES * learnt.gps.hyperparameters()[..., 0].log().mean().exp().item()


def _inputs(suspect: Suspect) -> Float[Tensor, "n d"]:
    """Inputs of a process over what is followed."""
    if suspect.follows is Past.PERIOD:
        return torch.stack((suspect.values.cos(), suspect.values.sin()), -1)
    if suspect.follows is Past.ORDER:
        return torch.arange(len(suspect.values), dtype=torch.float64)[:, None] / _PLACES
    return suspect.values[:, None]
