"""Serial dependence: a law coefficient, or an outcome, that depends on the sequence of the trials.

Screening tests what remains against the sequence:

    order      sums of neighbouring scores over windows of 2, 4, 8 … trials spread more than under random signs
    period     the largest power of a periodogram of the scores
    history    scores that correlate with quantities of the previous impact, or of the last few; for the previous one
               residuals as well, and whether it slid and turned in the same sense
    place      scores that correlate with the number of earlier impacts near the same contact place

Every statistic is converted to −log p, and the largest of all is compared with those of the same residuals under random
signs.  So the level holds for all of them together, exactly for independent symmetric residuals but for the few fitted
parameters.  The estimate is a `VaryingCoefficientModel` over the place in the sequence, the phase of a period, or a
quantity of earlier impacts.  Where a drift of the velocities, the same for every impact, predicts more than a
coefficient does, the measurement drifts (`drift`), and no serial dependence is reported.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import one_hot

from contactlearn.diagnosis.result.remainder import Coefficient, LaggedVariable, SerialDependence
from contactlearn.diagnosis.sign_flips import (
    gamma_neg_log_p,
    gumbel_neg_log_p,
    normal_neg_log_p,
    periodogram_peak,
    random_signs,
    screened,
    window_spread,
)
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.diagnosis.unexplained.scores import Scores
from contactlearn.diagnosis.unexplained.varying_coefficients import VaryingCoefficientFit, VaryingCoefficientModel
from contactlearn.effects import State
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.inference.identification.joint import Fit, FitOptions
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.mechanics.rigid_body import matvec
from contactlearn.mechanics.space import PLANE

_DECAYS = (0.0, 0.8)  # of the memory of earlier impacts, from trial to trial: of the last alone, of about five
_REMEMBERED = 40  # impacts at most
_WIDTHS, _BINS = (0.03, 0.12), 128  # of a place, standard deviations in the range of all places; for the range
_PLACE_DECAYS = (1.0, 0.9)  # of the memory of a place, from trial to trial: of all earlier impacts, of about ten
_NUMBERS = 1_000_000  # of scores with flipped signs at once
_COEFFICIENTS = tuple(Coefficient)
_SEQUENTIAL = (LaggedVariable.ORDER, LaggedVariable.PERIOD)
_MIN_TRIALS = 40  # trials below which nothing is tested
_MAX_CONSECUTIVE = 560  # consecutive trials that processes are fitted to and tested on, at most
_MAX_TRIED = 4  # associations, the most significant ones
_PLACES = 4.0  # trials in the unit of length of processes over the place, whose lengths begin at 7 and at 49 trials


class Memory(NamedTuple):
    """A quantity of earlier impacts, the number of them that is remembered, and the width of a place in m."""

    variable: LaggedVariable
    trials: float
    width: float | None = None


@dataclass(frozen=True, kw_only=True)
class Association:
    """A significant association of a coefficient, or of the velocities if it is None, with a lagged variable.

    `values` [n] of the variable are in the sequence: places, phases in rad, or standardised quantities.
    """

    coefficient: Coefficient | None
    memory: Memory
    values: Float[Tensor, " n"]

    @property
    def variable(self) -> LaggedVariable:
        """The lagged variable."""
        return self.memory.variable


def histories(impacts: Impacts, prediction: Prediction) -> dict[Memory, Float[Tensor, " n"]]:
    """Compute standardised quantities of the impacts before each trial.

    Args:
        impacts: in their sequence; a gap between two makes the earlier one unknown, but for the memory of a place.  In
            space the spin is that about the normal, and there is no memory of a place.
        prediction: of them, for the impulses.
    """
    state, wrench = State.of(impacts), matvec(impacts.slip_axes.mT, prediction.wrench)
    d, spin = impacts.space.d, impacts.v_pre[:, impacts.space.d :]
    values = {LaggedVariable.NORMAL_SPEED: state.v_n.abs(), LaggedVariable.NORMAL_IMPULSE: wrench[:, d - 1]}
    if impacts.space is PLANE:
        values[LaggedVariable.SLIP] = state.v_t
    values[LaggedVariable.SLIP_SPEED] = state.slip
    values[LaggedVariable.SPIN] = spin[:, -1]
    values[LaggedVariable.SPIN_RATE] = spin.norm(dim=-1)
    values[LaggedVariable.TANGENTIAL_IMPULSE] = wrench[:, 0]
    gaps = impacts.order.diff()
    consecutive = torch.cat((torch.zeros(1, dtype=torch.bool), gaps <= 1.5 * gaps.median()))
    standardised = {
        Memory(name, 1 / (1 - decay)): torch.where(consecutive, _remembered(x, decay), 0.0)
        for decay in _DECAYS
        for name, x in values.items()
        if x.std() > 1e-9 * x.abs().max()
    }
    vectors = {LaggedVariable.SLIP_ALONG: state.v_c[..., : d - 1], LaggedVariable.SPIN_ALONG: spin}
    standardised |= {
        Memory(name, 1.0): torch.where(consecutive, along, 0.0)
        for name, vector in vectors.items()
        if (along := _along_the_last(vector)).std() > 0
    }
    return standardised | _visited(state) if impacts.space is PLANE else standardised


def screen_associations(
    scores: Scores, history: Mapping[Memory, Float[Tensor, " n"]], level: float
) -> tuple[float, tuple[Association, ...]]:
    """Compute the p-value of independence, and the associations that refute it at the level, most significant first."""
    signs, terms = random_signs(len(scores)), _lagged_terms(scores, history)
    size = max(1, _NUMBERS // len(scores))
    parts = [_statistics(scores, terms, some) for some in signs.split(size)]
    spread, peak, frequency, memory = (torch.cat(part) for part in zip(*parts, strict=True))
    neg_log_p = torch.cat((gamma_neg_log_p(spread), gumbel_neg_log_p(peak), normal_neg_log_p(memory)), 1)
    chance, refuting = screened(neg_log_p, level)
    D = scores.residual.shape[-1]
    historical = [(kind, memory, values) for memory, values in history.items() for kind in _kinds(memory, D)]
    names = [*_sequential(scores, spread.shape[1] // 2, frequency[0]), *historical]
    best: dict[tuple[Coefficient | None, LaggedVariable], Association] = {}
    for k in refuting:
        coefficient, memory, x = names[k]
        association = Association(coefficient=coefficient, memory=memory, values=x)
        best.setdefault((coefficient, association.variable), association)
    return chance, tuple(best.values())


def _statistics(
    scores: Scores, terms: Float[Tensor, "n v"], signs: Float[Tensor, "flips n"]
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Spread of windows [flips, 2 widths], peak of the periodogram and its frequency [flips, 2], sums [flips, v]."""
    flipped = scores.flipped(signs)
    peak, halves = periodogram_peak(flipped)
    return window_spread(flipped).mT.flatten(1), peak, halves / (2 * len(scores)), signs @ terms


def _lagged_terms(scores: Scores, history: Mapping[Memory, Tensor]) -> Float[Tensor, "n v"]:
    """Terms of the sums of scores and residuals times each quantity, by trial."""
    D = scores.residual.shape[-1]
    alike = torch.eye(D, dtype=torch.float64).expand(len(scores), -1, -1)
    kinds = torch.cat((scores.slope, alike), -1)  # μ, ε, and the velocities
    if not history:
        return scores.residual[:, :0]
    functions = torch.stack([*history.values()], 1)
    terms = torch.stack([scores.terms(change, functions) for change in kinds.unbind(-1)], -1)
    return torch.cat([terms[:, k, : len(_kinds(memory, D))] for k, memory in enumerate(history)], 1)


# --- Names of the statistics, in their order -------------------------------------------------------

_Name = tuple[Coefficient | None, Memory, Tensor]


def _sequential(scores: Scores, widths: int, frequency: Float[Tensor, "2"]) -> Iterator[_Name]:
    """Windows of each coefficient, then the periods of both."""
    place = torch.arange(len(scores), dtype=torch.float64)
    for coefficient in _COEFFICIENTS:
        for k in range(widths):
            yield coefficient, Memory(LaggedVariable.ORDER, 2.0 ** (k + 1)), place
    for coefficient, f in zip(_COEFFICIENTS, frequency.tolist(), strict=True):
        yield coefficient, Memory(LaggedVariable.PERIOD, 1 / f), 2 * math.pi * f * place


def _kinds(memory: Memory, D: int) -> tuple[Coefficient | None, ...]:
    """Coefficients; for a single earlier impact, which no drift resembles, the D velocities as well."""
    return (*_COEFFICIENTS, *[None] * D) if memory.trials == 1 else _COEFFICIENTS


# --- Quantities of earlier impacts -----------------------------------------------------------------


def _remembered(x: Float[Tensor, " n"], decay: float) -> Float[Tensor, " n"]:
    """Standardised sum of earlier values, each less by the decay than the one after it."""
    total = _earlier((x - x.mean()) / x.std().clamp_min(1e-300), decay)
    return total / total.std().clamp_min(1e-300)


def _along_the_last(vector: Float[Tensor, "n k"]) -> Float[Tensor, " n"]:
    """Standardised product of each vector with the one before it, over the root of their lengths."""
    lengths = vector.norm(dim=-1)
    products = (vector[1:] * vector[:-1]).sum(-1) / (lengths[1:] * lengths[:-1]).sqrt().clamp_min(1e-300)
    along = torch.cat((products.mean()[None], products))  # of the first trial nothing is known
    return (along - along.mean()) / along.std().clamp_min(1e-300)


def _visited(state: State) -> dict[Memory, Float[Tensor, " n"]]:
    """Standardised numbers of earlier impacts near the place of each, at several widths; none where all are at one."""
    place = state.x + state.r[..., 0]
    low, high = place.quantile(0.01), place.quantile(0.99)
    visits: dict[Memory, Tensor] = {}
    if not high - low > 1e-9 * place.abs().max():
        return visits
    each = ((place - low) / (high - low) * _BINS).long().clamp(0, _BINS - 1)
    distances = (torch.arange(_BINS) - torch.arange(_BINS)[:, None]) / _BINS
    for decay in _PLACE_DECAYS:
        there = _earlier(one_hot(each, _BINS).to(torch.float64), decay)
        for width in _WIDTHS:
            near = (there * (-0.5 * (distances / width).square()).exp()[each]).sum(1)
            trials = 1 / (1 - decay) if decay < 1 else float(len(place))
            memory = Memory(LaggedVariable.PLACE, trials, width * (high - low).item())
            visits[memory] = (near - near.mean()) / near.std().clamp_min(1e-300)
    return visits


def _earlier(x: Float[Tensor, "n *k"], decay: float) -> Float[Tensor, "n *k"]:
    """Sum of earlier values, each less by the decay than the one after it."""
    if decay == 1:
        return x.cumsum(0) - x
    total, weight = torch.zeros_like(x), 1.0
    for lag in range(1, min(_REMEMBERED, len(x))):
        total[lag:] += weight * x[:-lag]
        weight *= decay
        if weight == 0:
            break
    return total


def find_serial_dependence(
    impacts: Impacts, fit: Fit, options: FitOptions, thresholds: Thresholds = Thresholds()
) -> SerialDependence | None:
    """Find the serial dependence of a fitted model's remainder; None without any.

    Args:
        impacts: measurements, whose errors are independent.
        fit: fit of a law with effects to all of them.
        options: options of the fit.
        thresholds: level of the test, and size of a large share.
    """
    if len(impacts) < _MIN_TRIALS:
        return None
    scores, model = Scores.of_sequence(impacts, fit, options), fit.model
    ordered = impacts[scores.rows]
    history = histories(ordered, model.base_prediction(ordered))
    chance, associations = screen_associations(scores, history, thresholds.dependence_level)
    if not associations:
        return None
    first = max(0, (len(ordered) - _MAX_CONSECUTIVE) // 2)
    stretch = slice(first, first + _MAX_CONSECUTIVE)
    best = _best(VaryingCoefficientModel.of(ordered, fit, scores, stretch), stretch, associations[:_MAX_TRIED])
    if best is None:
        return None
    coefficient, association, share, scale = best
    return SerialDependence(
        coefficient=coefficient,
        variable=association.variable,
        trials=scale,
        width=association.memory.width,
        p_value=chance,
        share=share,
        large=share.mean > thresholds.least_gain,
    )


def _best(
    model: VaryingCoefficientModel, stretch: slice, associations: Sequence[Association]
) -> tuple[Coefficient | None, Association, Interval, float] | None:
    """Fit every association and return the best; None if none helps, or if velocities that drift predict more."""
    order = replace(associations[0], memory=Memory(LaggedVariable.ORDER, 1.0), coefficient=None)
    asked = {(a.coefficient, a.memory): a for whole in associations for a in (whole, replace(whole, coefficient=None))}
    asked = {key: a for key, a in asked.items() if a.coefficient or a.variable is not LaggedVariable.ORDER}
    drift, *others = (model.dependent(a.coefficient, _inputs(a)[stretch]) for a in (order, *asked.values()))
    fits = dict(zip(asked, others, strict=True))
    tried: list[tuple[Coefficient | None, Association, VaryingCoefficientFit]] = []
    for association in associations:
        of_velocities = fits.get((None, association.memory), drift)
        if association.coefficient is not None:
            of_coefficient = fits[association.coefficient, association.memory]
            if of_coefficient.share.mean >= of_velocities.share.mean:
                tried.append((association.coefficient, association, of_coefficient))
                continue
        if association.variable not in _SEQUENTIAL and association.memory.trials == 1:
            tried.append((None, association, of_velocities))
    if not tried:
        return None
    coefficient, association, fit = max(tried, key=lambda candidate: candidate[2].share.mean)
    if fit.share.low <= 0 or fit.share.mean < drift.share.mean:
        return None
    if association.variable is not LaggedVariable.ORDER:
        return coefficient, association, fit.share, association.memory.trials
    resembling = _PLACES * fit.gps.hyperparameters()[..., 0].log().mean().exp().item()  # neighbouring trials
    return coefficient, association, fit.share, resembling


def _inputs(association: Association) -> Float[Tensor, "n d"]:
    """Inputs of a process over the lagged variable."""
    if association.variable is LaggedVariable.PERIOD:
        return torch.stack((association.values.cos(), association.values.sin()), -1)
    if association.variable is LaggedVariable.ORDER:
        return torch.arange(len(association.values), dtype=torch.float64)[:, None] / _PLACES
    return association.values[:, None]
