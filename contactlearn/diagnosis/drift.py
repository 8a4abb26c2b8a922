"""Drift of the measurement: errors that wander with the sequence of trials, distinguished from a parameter that drifts.

    dependence   tests whether residuals of neighbouring trials resemble each other: a wandering calibration
    drift_kind   distinguishes a drift of the measurement, the same for every impact, from that of a model parameter
    blocks       draws contiguous parts of the sequence to hold out, where neighbours resemble each other

Sums of neighbouring residuals over windows of 2, 4, 8 … trials spread more than under random signs if neighbours
resemble each other.  The windows of all components are judged together, by the largest excess in standard deviations.

The residual tested is that of the chosen model without effects over the order.  If the measurement drifts, effects over
the order would take its wandering for physics, and folds drawn at random would predict each trial from its neighbours.
An effect over the order is kept beside the drift where the wandering is far faster: on held-out blocks longer than the
wandering, the effect predicts more than nothing does, and more than velocities that change alike as slowly.
Source: Cochrane 1988, "How big is the random walk in GNP?", for the windows.
"""

import math
from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from contactlearn.core.errors import DataError
from contactlearn.core.numerics import MAD_SCALE, Z_95
from contactlearn.data.audit.result import Finding, evidence_of
from contactlearn.diagnosis.search.candidates import follows_order
from contactlearn.diagnosis.search.pool import Pool, ScoredFit, Spec
from contactlearn.diagnosis.search.selection import Selection, validated
from contactlearn.diagnosis.sign_flips import chance_of_gain, exceedance, random_signs, window_spread
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.effects import EffectId
from contactlearn.inference.identification.joint import Fit, FitOptions, linearise
from contactlearn.inference.identification.robust import robust_distance
from contactlearn.inference.validation import Folds, robust_covariance
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.space import Space

_CLIP = 2.5  # robust standard deviations beyond which a residual counts no more
_CONSTANT = 1e-6  # variance, in robust ones, of a component that is the same in all trials
_MIN_TRIALS = 20  # trials below which nothing is tested
_LAGS = 60  # of the autocorrelation at most, and no more than a quarter of the trials
_SCALES = 24  # correlation times that are tried
_CURVES = 40  # cosines over the sequence at most, and no more than a quarter of the trials
_DECISIVE_BIC = 6.0  # difference of BIC: "strong evidence", Kass & Raftery 1995
_FOLDS = 5
_BLOCKS = 20  # at least, to test effects over the order beside a drift
_SLOW_COSINES = 4  # cosines over the sequence by which velocities may change alike in place of an effect


# --- Dependence ------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Dependence:
    """Residuals of neighbouring trials that resemble each other.

    Args:
        p_value: of independence, over all components and time scales.
        correlation: of a trial with the next, mean of the components.
        interval: of the same, 95 %, as if there were no other dependence.
        time_scale: trials after which the dependent part has forgotten all but 1/e.
        size: standard deviation of the dependent part in each velocity, (m/s, m/s, rad/s) in the plane.
        share: of the residual variance that is dependent, mean of the components.
        block: length of blocks for folds, in trials, beyond which almost nothing is remembered.
    """

    p_value: float
    correlation: float
    interval: tuple[float, float]
    time_scale: float
    size: tuple[float, ...]
    share: float
    block: int


def dependence(
    residual: Float[Tensor, "n D"],
    order: Float[Tensor, " n"],
    inliers: Bool[Tensor, " n"] | None = None,
    level: float = 0.005,
) -> Dependence | None:
    """Test whether residuals depend on their place in the sequence; None where independence is not refuted.

    Args:
        residual: of the velocity after impact in (m/s, m/s, rad/s).
        order: place of each trial in the sequence.
        inliers: trials that are used; all if None.
        level: p-value below which independence is refuted.
    """
    rows = order.argsort(stable=True)
    rows = rows if inliers is None else rows[inliers[rows]]
    if len(rows) < _MIN_TRIALS:
        return None
    white, scale = _winsorised(residual[rows])
    chance = _chance(white)
    if chance > level:
        return None
    lags = torch.arange(1, min(_LAGS, len(rows) // 4) + 1)
    correlation = torch.stack([(white[k:] * white[:-k]).sum(0) for k in lags.tolist()])
    correlation = correlation / white.square().sum(0).clamp_min(1e-300)  # a component without a residual has none
    time_scale, shares = _decay(correlation, lags, len(rows))
    first, error = correlation[0].mean().item(), Z_95 / math.sqrt(residual.shape[1] * len(rows))
    return Dependence(
        p_value=chance,
        correlation=first,
        interval=(first - error, first + error),
        time_scale=time_scale,
        size=tuple((scale * (shares * white.var(0)).sqrt()).tolist()),
        share=shares.mean().item(),
        block=max(2, min(math.ceil(3 * time_scale), len(rows) // 10)),
    )


def _winsorised(residual: Float[Tensor, "n D"]) -> tuple[Float[Tensor, "n D"], Float[Tensor, " D"]]:
    """Residuals in robust standard deviations, at most so many of them, about 0; and these deviations."""
    centred = residual - residual.median(0).values
    scale = (MAD_SCALE * centred.abs().median(0).values).clamp_min(1e-300)
    white = (centred / scale).clamp(-_CLIP, _CLIP)
    return white - white.mean(0), scale


def _chance(white: Float[Tensor, "n D"]) -> float:
    """Probability of so large an excess over all windows and components under random signs."""
    white = white[:, white.square().mean(0) > _CONSTANT]
    if not white.shape[1]:
        return 1.0
    flipped = random_signs(len(white))[..., None] * white
    spread = window_spread(flipped - flipped.mean(1, keepdim=True))
    spread = spread / spread.mean(0)
    spread = torch.cat((spread, spread.mean(-1, keepdim=True)), -1)
    excess = ((spread - spread[1:].mean(0)) / spread[1:].std(0).clamp_min(1e-12)).flatten(1).amax(1)
    return exceedance(excess)


def _decay(
    correlation: Float[Tensor, "lags D"], lags: Int[Tensor, " lags"], trials: int
) -> tuple[float, Float[Tensor, " D"]]:
    """Time scale T and shares s of the autocorrelation s exp(−lag/T), by least squares over a grid of T."""
    scales = torch.logspace(math.log10(0.5), math.log10(trials / 2), _SCALES, dtype=correlation.dtype)
    curves = (-lags / scales[:, None]).exp()  # [scales, lags]
    shares = ((curves @ correlation) / curves.square().sum(-1, keepdim=True)).clamp(0, 1)
    misfit = (correlation - curves[..., None] * shares[:, None]).square().sum((1, 2))
    best = int(misfit.argmin())
    return scales[best].item(), shares[best]


# --- What drifts -----------------------------------------------------------------------------------


def drift_kind(
    residual: Float[Tensor, "n D"], sensitivity: Float[Tensor, "n D k"], order: Float[Tensor, " n"]
) -> Literal["measurement", "parameter", "undecided"]:
    """Distinguish a drift of the measurement, the same for every impact, from a drift of a model parameter.

    Both are smooth functions of the order: the one added to each component, the other times the derivative of v_post in
    each parameter.  The marginal likelihoods of both, over their variances and time scale, are compared by BIC.

    Args:
        residual: of the velocity after impact in (m/s, m/s, rad/s).
        sensitivity: derivative of v_post in k parameters.
        order: place of each trial in the sequence.
    """
    (n, D), parts = residual.shape, sensitivity.shape[-1]
    rows = order.argsort(stable=True)
    white, scale = _winsorised(residual[rows])
    slopes = sensitivity[rows] / scale[:, None]
    slopes = slopes / slopes.square().mean((0, 1)).sqrt().clamp_min(1e-300)
    alike = torch.eye(D, dtype=white.dtype).expand(n, -1, -1)
    measurement = _evidence(white, alike) - 0.5 * (D + 1) * math.log(D * n)
    parameter = _evidence(white, slopes) - 0.5 * (parts + 1) * math.log(D * n)
    difference = 2 * (measurement - parameter)
    if abs(difference) <= _DECISIVE_BIC:
        return "undecided"
    return "measurement" if difference > 0 else "parameter"


def _evidence(white: Float[Tensor, "n D"], columns: Float[Tensor, "n D k"]) -> float:
    """Log marginal likelihood of a smooth function of the order times each column, at its best variances."""
    (n, D), parts = white.shape, columns.shape[-1]
    waves = torch.arange(1, min(_CURVES, n // 4) + 1, dtype=white.dtype)
    place = (torch.arange(n, dtype=white.dtype) + 0.5) / n
    curves = math.sqrt(2) * (math.pi * place[:, None] * waves).cos()  # [n, q]
    design = (columns[..., None, :] * curves[:, None, :, None]).reshape(D * n, -1)  # [D n, q k]
    gram, moment, total = design.mT @ design, design.mT @ white.reshape(-1), white.square().sum()
    variances = torch.cat((torch.zeros(1), torch.logspace(-3, 1, 9))).to(white.dtype)
    best = -math.inf
    for scale in (n / 60, n / 20, n / 6, n / 2):  # trials
        spectrum = 1 / (1 + (math.pi * waves * scale / n) ** 2)
        spectrum = (spectrum / spectrum.sum())[:, None]
        chosen = torch.full((parts,), 0.1, dtype=white.dtype)
        for part in (*range(parts), *range(parts)):
            tried = chosen.repeat(len(variances), 1)
            tried[:, part] = variances
            prior = (spectrum * tried[:, None]).flatten(1)  # [tried, q k]
            likelihood = _likelihood(gram, moment, total, prior, D * n)
            chosen = tried[likelihood.argmax()]
            best = max(best, likelihood.max().item())
    return best


def _likelihood(
    gram: Float[Tensor, "p p"], moment: Float[Tensor, " p"], total: Tensor, prior: Float[Tensor, "b p"], count: int
) -> Float[Tensor, " b"]:
    """Log marginal likelihood of a linear model with Gaussian coefficients of variances `prior` σ², at its best σ²."""
    root = prior.sqrt()
    inner = root[:, :, None] * gram * root[:, None, :] + torch.eye(len(gram), dtype=gram.dtype)
    factor = torch.linalg.cholesky(inner)
    inside = torch.linalg.solve_triangular(factor, (root * moment)[..., None], upper=False)[..., 0]
    misfit = (total - inside.square().sum(-1)).clamp_min(1e-300)
    return -0.5 * count * (misfit / count).log() - factor.diagonal(dim1=-2, dim2=-1).log().sum(-1)


# --- Folds -----------------------------------------------------------------------------------------


def blocks(order: Float[Tensor, " n"], length: int, folds: int, generator: torch.Generator) -> Int[Tensor, "folds m"]:
    """Draw the held-out rows of each fold as contiguous blocks of the sequence, as many in each fold.

    Blocks are a little longer than `length` where that leaves fewer trials over; those left over, at a random place of
    the sequence, are never held out.

    Raises:
        DataError: fewer trials than one block a fold.
    """
    if not 1 <= length * folds <= len(order):
        raise DataError(f"{folds} folds of blocks of {length} trials need at least {folds * length}, got {len(order)}")
    each = len(order) // (folds * length)
    size = len(order) // (folds * each)
    used = folds * each * size
    first = int(torch.randint(len(order) - used + 1, (1,), generator=generator))
    place = torch.arange(len(order)).roll(-first)[:used].sort().values
    parts = order.argsort(stable=True)[place].view(-1, size)
    return parts[torch.randperm(len(parts), generator=generator)].view(folds, -1)


# --- Drift of a measurement ------------------------------------------------------------------------


@dataclass(frozen=True)
class Drift:
    """A measurement that drifts: what it leaves, and effects over the order that last beside it."""

    dependence: Dependence
    lasting: frozenset[EffectId] = frozenset()


def ordered_candidates(selection: Selection, drift: Drift) -> set[EffectId]:
    """Return the candidates that follow the order of the trials, without those that last beside a drift."""
    candidates, impacts = selection.pool.candidates, selection.impacts
    return {key for key, effect in candidates.items() if follows_order(effect, impacts)} - drift.lasting


def measurement_drift(selection: Selection, thresholds: Thresholds, generator: torch.Generator) -> Drift | None:
    """Find the dependence of the measurement along the sequence; None without any, or where a parameter drifts."""
    pool, spec = selection.pool, selection.spec
    unordered = frozenset(key for key in spec.effects if not follows_order(pool.candidates[key], selection.impacts))
    without_order = Spec(spec.law, unordered)
    without = pool.fitted(without_order, pool.start(without_order, selection.chosen, {}))
    before = drifts(without.fit, selection.impacts, pool.options, thresholds)
    lasting = selection.spec.effects - without.spec.effects
    if before is None or not lasting:
        return None if before is None else Drift(before)
    impacts, fit = selection.impacts, selection.present.fit
    residual = impacts.v_post - fit.model.predict(impacts).v_post
    after = dependence(residual, impacts.order, fit.inliers, thresholds.dependence_level)
    if after is None or after.block * _BLOCKS > len(impacts):
        return Drift(before)
    lasts = lasts_beside(after, pool, selection.chosen, without, thresholds.gain_level, generator)
    return Drift(after, lasting) if lasts else Drift(before)


def lasts_beside(
    drift: Dependence, pool: Pool, whole: ScoredFit, without: ScoredFit, level: float, generator: torch.Generator
) -> bool:
    """Return whether effects over the order predict held-out blocks in addition to a measurement drift.

    Args:
        drift: of what the whole model leaves.
        pool: of the models.
        whole: the model with the effects.
        without: the same without them.
        level: probability of the fall of the loss under random signs of the blocks.
        generator: of the blocks.
    """
    impacts, trials = pool.impacts, len(pool.impacts)
    place = impacts.order.argsort(stable=True).argsort()
    folds = Folds.of(blocks(impacts.order, drift.block, _FOLDS, generator), trials)
    scatter = robust_covariance(impacts.residual(whole.fit.model.predict(impacts).v_post))
    with_them, nothing = (validated(pool, folds, model, scatter).loss for model in (whole, without))
    waves = (math.pi * ((place + 0.5) / trials).double()[:, None] * torch.arange(_SLOW_COSINES + 1)).cos()
    residual = impacts.residual(without.fit.model.predict(impacts).v_post)
    each = torch.zeros(_FOLDS, trials, dtype=torch.float64)
    for k, rows in enumerate(folds.fitted):
        unexplained = residual - waves @ torch.linalg.lstsq(waves[rows], residual[rows]).solution
        each[k] = robust_distance(unexplained, scatter) + 0.5 * scatter.logdet()
    gain, over = nothing - with_them, folds.scores(each) - with_them
    held = gain.isfinite()
    sums = torch.zeros(int(place.max()) // drift.block + 1, dtype=torch.float64)
    sums = sums.index_add(0, place[held] // drift.block, gain[held])
    return chance_of_gain(sums) < level and bool(over[held].sum() > 0)


def drifts(fit: Fit, impacts: Impacts, options: FitOptions, thresholds: Thresholds) -> Dependence | None:
    """Find the dependence of the measurement in the residual of a fitted model; None without any, or of a parameter."""
    model = fit.model
    impacts = impacts.replace(outcome_cov=None, outcome_shift=None)  # an instrument drifts in its own units
    residual = impacts.residual(model.predict(impacts).v_post)
    course = dependence(residual, impacts.order, fit.inliers, thresholds.dependence_level)
    if course is None:
        return None
    unit = torch.eye(impacts.space.D, dtype=torch.float64)
    about = linearise(model.law, model.effects, impacts, fit.values, unit, options=options)
    kind = drift_kind(residual, -about.slope[..., :2].nan_to_num(), impacts.order)
    return course if kind == "measurement" else None


def blocked_folds(drift: Drift, selection: Selection, generator: torch.Generator) -> Folds:
    """Draw folds of blocks that are longer than the dependence, or as long as there are trials for."""
    order = selection.impacts.order
    length = min(drift.dependence.block, len(order) // (2 * _FOLDS))
    return Folds.of(blocks(order, length, _FOLDS, generator), len(order))


def drift_finding(drift: Drift, space: Space) -> Finding:
    """Describe the drift by its size and time scale."""
    course = drift.dependence
    sizes = [(name, size, unit) for (name, unit), size in zip(space.symbols.items(), course.size, strict=True)]
    *first, last = (f"{size:.2g} {unit}" for _, size, unit in sizes)
    some = "Other effects" if drift.lasting else "Effects"
    sentence = (
        f"the measurement drifts: neighbouring residuals correlate by {course.correlation:.2f} "
        f"(95 %: {course.interval[0]:.2f} to {course.interval[1]:.2f}), over about {course.time_scale:.0f} trials; the "
        f"drifting part has standard deviations of {', '.join(first)} and {last}, "
        f"{course.share:.0%} of the residual's variance. {some} over the order are left out, and blocks of trials are "
        "held out together"
    )
    evidence = evidence_of(
        ("correlation", course.correlation),
        ("time_scale", course.time_scale, "trials"),
        ("share", course.share),
        *((name.replace("ω", "omega"), size, unit) for name, size, unit in sizes),
    )
    return Finding(name="measurement_drift", sentence=sentence, evidence=evidence)
