"""Test of what remains against the sequence of the trials: neighbours, periods, and the impacts before each trial.

    order      sums of neighbouring scores over windows of 2, 4, 8 … trials spread more than their signs allow
    period     the largest power of a periodogram of the scores
    history    scores that correlate with quantities of the impact before, or of the last few; residuals with the former

Each statistic is written as its `surprise`; the largest of all is compared with those of the same residuals with random
signs.  So the level is that of all of them together, exact for independent symmetric residuals but for the few
parameters that were fitted.
Sources: as of `sequence` and `surprise`.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.diagnosis.result.remainder import Coefficient, Past
from contactlearn.diagnosis.sequence import exceedance, random_signs, window_spread
from contactlearn.diagnosis.unexplained.scores import Scores
from contactlearn.diagnosis.unexplained.surprise import of_maxima, of_normals, of_sums
from contactlearn.effects import State
from contactlearn.impacts import Impacts, Prediction

_DECAYS = (0.0, 0.8)  # of the memory of earlier impacts, from trial to trial: of the last alone, of about five
_REMEMBERED = 40  # impacts at most
_NUMBERS = 1_000_000  # of scores with flipped signs at once
_COEFFICIENTS = tuple(Coefficient)


@dataclass(frozen=True, kw_only=True)
class Suspect:
    """What the sequence seems to tell of a coefficient, or of the velocities, and the p-value of that among all.

    `values` [n] of what is followed are in the sequence: places, phases in rad, or standardised quantities.
    """

    coefficient: Coefficient | None
    follows: Past
    trials: float
    values: Float[Tensor, " n"]
    surprise: float


def histories(impacts: Impacts, prediction: Prediction) -> dict[tuple[Past, float], Float[Tensor, " n"]]:
    """Compute standardised quantities of the impacts before each trial, by the number of impacts remembered.

    Args:
        impacts: in their sequence; a gap between two makes the earlier one unknown.
        prediction: of them, for the impulses.
    """
    state, wrench = State.of(impacts), prediction.wrench
    told = {
        Past.NORMAL_SPEED: state.v_n.abs(),
        Past.NORMAL_IMPULSE: wrench[:, 1],
        Past.SLIP: state.v_t,
        Past.SLIP_SPEED: state.v_t.abs(),
        Past.SPIN: state.omega,
        Past.SPIN_RATE: state.omega.abs(),
        Past.TANGENTIAL_IMPULSE: wrench[:, 0],
    }
    gaps = impacts.order.diff()
    follows = torch.cat((torch.zeros(1, dtype=torch.bool), gaps <= 1.5 * gaps.median()))
    return {
        (name, 1 / (1 - decay)): torch.where(follows, _remembered(x, decay), 0.0)
        for decay in _DECAYS
        for name, x in told.items()
        if x.std() > 1e-9 * x.abs().max()
    }


def suspects(
    scores: Scores, history: Mapping[tuple[Past, float], Float[Tensor, " n"]], level: float
) -> tuple[float, tuple[Suspect, ...]]:
    """Compute the p-value of independence, and what refutes it at the level, the most surprising first."""
    signs, told = random_signs(len(scores)), _told(scores, history)
    size = max(1, _NUMBERS // len(scores))
    parts = [_statistics(scores, told, some) for some in signs.split(size)]
    spread, peak, frequency, memory = (torch.cat(part) for part in zip(*parts, strict=True))
    surprise = torch.cat((of_sums(spread), of_maxima(peak), of_normals(memory)), 1).nan_to_num(0.0)  # no scores
    chance = exceedance(surprise.amax(1))
    enough = surprise[1:].amax(1).quantile(1 - level).item()
    names = [*_sequential(scores, spread.shape[1] // 2, frequency[0]), *_historical(history)]
    found = [
        Suspect(coefficient=c, follows=f, trials=t, values=x, surprise=own)
        for (c, f, t, x), own in zip(names, surprise[0].tolist(), strict=True)
        if own > enough
    ]
    best: dict[tuple[Coefficient | None, Past], Suspect] = {}
    for one in sorted(found, key=lambda one: -one.surprise):
        best.setdefault((one.coefficient, one.follows), one)
    return chance, tuple(best.values()) if chance <= level else ()


def _statistics(
    scores: Scores, told: Float[Tensor, "n v"], signs: Float[Tensor, "flips n"]
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Spread of windows [flips, 2 widths], peak of the periodogram and its frequency [flips, 2], sums [flips, v]."""
    flipped, n = scores.flipped(signs), len(scores)
    power = torch.fft.rfft(flipped, 2 * n, dim=1).abs().square()[:, 2:] / flipped.square().sum(1, keepdim=True)
    peak, place = power.max(1)
    return window_spread(flipped).mT.flatten(1), peak, (place + 2) / (2 * n), signs @ told


def _told(scores: Scores, history: Mapping[tuple[Past, float], Tensor]) -> Float[Tensor, "n v"]:
    """Terms of the sums of scores and residuals times each quantity, by trial."""
    alike = torch.eye(3, dtype=torch.float64).expand(len(scores), 3, 3)
    kinds = torch.cat((scores.slope, alike), -1)  # μ, ε, and the three velocities
    columns = [
        scores.free(values[:, None, None] * kinds[..., : len(_kinds(trials))])
        for (_, trials), values in history.items()
    ]
    return (torch.cat(columns, -1) * scores.residual[..., None]).sum(1) if columns else scores.residual[:, :0]


# --- Names of the statistics, in their order -------------------------------------------------------

_Name = tuple[Coefficient | None, Past, float, Tensor]


def _sequential(scores: Scores, widths: int, frequency: Float[Tensor, "2"]) -> Iterator[_Name]:
    """Windows of each coefficient, then the periods of both."""
    place = torch.arange(len(scores), dtype=torch.float64)
    for coefficient in _COEFFICIENTS:
        for k in range(widths):
            yield coefficient, Past.ORDER, 2.0 ** (k + 1), place
    for coefficient, f in zip(_COEFFICIENTS, frequency.tolist(), strict=True):
        yield coefficient, Past.PERIOD, 1 / f, 2 * math.pi * f * place


def _historical(history: Mapping[tuple[Past, float], Tensor]) -> Iterator[_Name]:
    """Quantities of earlier impacts, each for all that may follow it."""
    for (name, trials), values in history.items():
        for kind in _kinds(trials):
            yield kind, name, trials, values


def _kinds(trials: float) -> tuple[Coefficient | None, ...]:
    """What may follow so many impacts: coefficients; and of one impact, which no drift resembles, three velocities."""
    return (*_COEFFICIENTS, None, None, None) if trials == 1 else _COEFFICIENTS


def _remembered(x: Float[Tensor, " n"], decay: float) -> Float[Tensor, " n"]:
    """Standardised sum of earlier values, each less by the decay than the one after it."""
    x = (x - x.mean()) / x.std().clamp_min(1e-300)
    found, weight = torch.zeros_like(x), 1.0
    for lag in range(1, min(_REMEMBERED, len(x))):
        found[lag:] += weight * x[:-lag]
        weight *= decay
        if weight == 0:
            break
    return found / found.std().clamp_min(1e-300)
