"""The error budget: the error of a law in noise, explained, unexplained, and beyond any rigid contact.

The noise floor is the error of a model that misses nothing but the noise:

    stated      noise of the measured velocities is drawn before and after impact, and carried through the model
    measured    the same, with the covariances of its own that each trial carries
    estimated   residuals of trials with similar states before impact differ by their noise alone: half the squared
                difference of neighbours against their squared distance is a line, and its intercept is the noise
                (the Gamma test).  Repeats of one drop are neighbours at distance 0.

The better the model, the less depends on the line, so the estimate uses the best available model.  It is the noise of
the outcome, not of an instrument: a quantity that varies from drop to drop and is not measured is noise as well.
Sources: Stefánsson, Končar & Jones 1997; Evans & Jones 2002.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from contactlearn.diagnosis.result import ErrorBudget, ErrorLimits, ErrorShares, NoiseSource, Verdict
from contactlearn.diagnosis.search.selection import Selection
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.diagnosis.unexplained.remainder import LearnedRemainder, input_columns
from contactlearn.effects import State
from contactlearn.effects.formula.symbols import of_state
from contactlearn.inference.evaluation import bounds
from contactlearn.inference.evaluation.metrics import Interval, bootstrap, mass_error
from contactlearn.inference.validation import RESAMPLES, held_out_interval
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.mechanics.rigid_body import matvec
from contactlearn.mechanics.space import SPACE
from contactlearn.models.contact_model import ContactModel

_NEIGHBOURS = 10
_TRIALS = 4000  # whose neighbours are searched for, at most
_DRAWS = 8
_RESAMPLES, _AT_ONCE = 1000, 50
_INPUTS = ("rx", "ry", "vx", "vy", "omega", "x")


@dataclass(frozen=True, kw_only=True)
class NoiseFloor:
    """Mean mass error that noise alone makes, with its 95 % interval, and the origin of the number."""

    error: Interval
    source: NoiseSource


def noise_floor(
    impacts: Impacts,
    model: ContactModel,
    *,
    generator: torch.Generator,
    noise: Sequence[float] | None = None,
    inliers: Bool[Tensor, " n"] | None = None,
    predicted: Float[Tensor, "n D"] | None = None,
) -> NoiseFloor:
    """Compute the mass error of a model that misses nothing but the noise.

    Args:
        impacts: measurements.
        model: the best available model, fitted to these impacts.
        generator: of the draws and resamples.
        noise: standard deviations of the measured v_x, v_y (m/s) and ω (rad/s), before impact as after it; if
            None, that of the covariances of the impacts, or estimated where there are none.
        inliers: trials that are no gross outliers; all of them if None.  The residual of an outlier is all noise.
        predicted: v_post in (m/s, m/s, rad/s) by something that knows more than the model, on held-out trials, nan
            where there is none.
    """
    if noise is not None:
        sigma = torch.diag(torch.tensor(noise, dtype=torch.float64)).expand(2, len(impacts), -1, -1)
        return NoiseFloor(error=_drawn(impacts, model, sigma, generator), source=NoiseSource.STATED)
    if impacts.v_pre_cov is not None and impacts.v_post_cov is not None:
        values, vectors = torch.linalg.eigh(torch.stack((impacts.v_pre_cov, impacts.v_post_cov)))
        roots = vectors * values.clamp_min(0).sqrt()[..., None, :]
        return NoiseFloor(error=_drawn(impacts, model, roots, generator), source=NoiseSource.MEASURED)
    expected = model.outcome(impacts).v_post
    predicted = expected if predicted is None else torch.where(predicted.isfinite(), predicted, expected)
    inliers = torch.ones(len(impacts), dtype=torch.bool) if inliers is None else inliers
    rows = inliers.nonzero()[:, 0]
    rows = rows[torch.randperm(len(rows), generator=generator)[:_TRIALS]]
    error = _estimated(impacts[rows], predicted[rows], generator)
    outliers = mass_error(impacts, Prediction(predicted, impacts.wrench))[~inliers].sum().item() / len(impacts)
    share = inliers.double().mean().item()
    whole = Interval(*(share * end + outliers for end in error))
    return NoiseFloor(error=whole, source=NoiseSource.ESTIMATED)


def _drawn(
    impacts: Impacts, model: ContactModel, roots: Float[Tensor, "2 n D D"], generator: torch.Generator
) -> Interval:
    """Error of the model's own outcomes with noise drawn before and after impact, from roots of its covariances."""
    expected, errors = model.outcome(impacts), []
    for _ in range(_DRAWS):
        unit = torch.randn(2, *impacts.v_pre.shape, dtype=torch.float64, generator=generator)
        before, after = (roots @ unit[..., None])[..., 0]
        seen = model.outcome(impacts.replace(v_pre=impacts.v_pre + before, validate=False)).v_post
        moved = impacts.replace(v_post=expected.v_post + after, validate=False)
        errors.append(mass_error(moved, replace(expected, v_post=seen)))
    return bootstrap(torch.stack(errors).mean(0), generator, _RESAMPLES)


def _estimated(impacts: Impacts, predicted: Float[Tensor, "n D"], generator: torch.Generator) -> Interval:
    """The Gamma test on residuals in units of the outcome's size, in the axes of the slip."""
    mass = impacts.mass_diagonal.sqrt()
    residual = mass * matvec(impacts.slip_axes.mT, impacts.v_post - predicted)
    size = (mass * impacts.v_post).norm(dim=-1, keepdim=True)
    distance, neighbour = _neighbours(impacts)
    differs = (residual[:, None] - residual[neighbour]).norm(dim=-1) / size / 2**0.5
    rows = torch.randint(len(impacts), (_RESAMPLES, len(impacts)), generator=generator)
    mean = _intercept(distance.square().mean(0), differs.mean(0).square()).sqrt()
    means = [(distance[some].square().mean(1), differs[some].mean(1).square()) for some in rows.split(_AT_ONCE)]
    resampled = torch.cat([_intercept(*pair) for pair in means]).sqrt()
    low, high = resampled.quantile(torch.tensor((0.025, 0.975), dtype=resampled.dtype)).tolist()
    return Interval(mean.item(), low, high)


def _neighbours(impacts: Impacts) -> tuple[Float[Tensor, "n k"], Tensor]:
    """Distances to, and rows of, the nearest trials in the standardised state before impact."""
    if impacts.space is SPACE:
        began = torch.cat([columns for name, columns in input_columns(impacts).items() if name != "order"], -1)
    else:
        known = of_state(State.of(impacts))
        quantities = torch.stack([known[name] for name in _INPUTS], -1)
        began = torch.cat((quantities, *impacts.covariate_columns.values()), -1)
    varies = began.std(0) > 1e-9 * began.abs().amax(0)
    began = ((began - began.mean(0)) / began.std(0))[:, varies]
    distances = torch.cdist(began, began).fill_diagonal_(torch.inf)
    distance, neighbour = distances.topk(min(_NEIGHBOURS, len(impacts) - 1), largest=False)
    return distance, neighbour


def _intercept(distance: Float[Tensor, "*batch k"], difference: Float[Tensor, "*batch k"]) -> Float[Tensor, "*batch"]:
    """Intercept of the least-squares line of difference over distance; its slope is at least 0."""
    away = distance - distance.mean(-1, keepdim=True)
    slope = (away * difference).sum(-1) / away.square().sum(-1).clamp_min(1e-300)
    return (difference.mean(-1) - slope.clamp_min(0) * distance.mean(-1)).clamp_min(0)


# --- The budget --------------------------------------------------------------------------------


def error_limits(selection: Selection, ceiling: LearnedRemainder, generator: torch.Generator) -> ErrorLimits:
    """Compute the errors of the law, of processes on top of it that see the whole state, and of the best rigid contact.

    Args:
        selection: around the law.
        ceiling: the processes on the residual of its base.
        generator: of the bootstrap.
    """
    impacts = selection.impacts
    return ErrorLimits(
        base=held_out_interval(selection.base.error, generator),
        ceiling=held_out_interval(ceiling.error, generator),
        bound=bootstrap(mass_error(impacts, bounds.irb(impacts, "mass")), generator, RESAMPLES),
    )


def error_budget(
    limits: ErrorLimits,
    *,
    base: Interval,
    named: Interval,
    flexible: Interval,
    floor: NoiseFloor,
    instrument: Interval | None = None,
    with_candidates: float | None = None,
) -> ErrorBudget:
    """Divide the error of the law into shares.

    Args:
        limits: of the law alone.
        base: error of the law, on the ladder.
        named: error with all effects, on the ladder.
        flexible: error with processes on the residual of that model.
        floor: the noise; one that a model clearly undercuts is none, and no other exceeds the least error of a model.
        instrument: the part of the floor that is not scatter of the contact; None where both are one.
        with_candidates: mean error with the candidates as well; None without any.
    """
    models = named, flexible, limits.ceiling
    usable = floor.error.low <= min(model.high for model in models)
    best = named.mean if with_candidates is None else min(named.mean, with_candidates)
    noise = min(floor.error.mean, best, *(model.mean for model in models))
    whole = base.mean or 1.0  # of exact data
    distinguished = usable and instrument is not None
    scatter = max(0.0, noise - instrument.mean) if instrument is not None else 0.0
    shares = ErrorShares(
        noise=noise / whole if usable else None,
        explained=(base.mean - named.mean) / whole,
        unnamed=(named.mean - best) / whole,
        unexplained=(best - noise) / whole if usable else None,
        beyond_rigid=max(0.0, limits.bound.mean - noise) / whole if usable else None,
        scatter=scatter / whole if distinguished else None,
    )
    return ErrorBudget(
        base=base,
        ceiling=limits.ceiling,
        bound=limits.bound,
        named=named,
        flexible=flexible,
        noise=Interval(noise, min(floor.error.low, noise), floor.error.high) if usable else None,
        noise_source=floor.source,
        shares=shares,
        instrument=instrument if distinguished else None,
    )


def verdict(
    budget: ErrorBudget,
    *,
    named: bool,
    predictable: bool,
    better_law: bool,
    complete: bool,
    thresholds: Thresholds,
) -> Verdict:
    """Conclude from the shares of the error and the names, by the first row that holds.

    | | names | no name |
    | --- | --- | --- |
    | another law does clearly better | unknown | unknown |
    | the error is that of an integrator | effects | none |
    | much is left, and the search ended | unknown | unknown |
    | much is left, and the search ran out of time | unfinished | unfinished |
    | little is left | effects | none |

    Much is left where Gaussian processes predict it, where candidates explain it, or where it clearly exceeds noise, of
    the instrument and of the contact's scatter.  An estimated floor, which scatters, must be exceeded by twice as much
    as a measured or stated one.  Scatter that has structure is none, and no part of the floor.  So it can
    turn an unknown remainder into none, and never the reverse.

    Args:
        budget: with its shares.
        named: whether an effect is found or probable.
        predictable: whether much of the residual is predictable, see `Remainder.unknown`.
        better_law: see `clearly_better`.
        complete: whether the search came to its own end.
        thresholds: the share that is much, `form_error`.
    """
    shares, much = budget.shares, thresholds.form_error
    exceeds = budget.noise is not None and budget.named.low > budget.noise.high
    estimated = budget.noise_source in (NoiseSource.ESTIMATED, NoiseSource.SCATTER)
    beyond = 2 * much if estimated else much
    unexplained = shares.unexplained if shares.unexplained is not None and exceeds else 0.0
    if better_law:
        return Verdict.UNKNOWN
    if budget.named.mean <= thresholds.exact:
        return Verdict.EFFECTS if named else Verdict.NONE
    if predictable or shares.unnamed > much or shares.unnamed + unexplained > beyond:
        return Verdict.UNKNOWN if complete else Verdict.UNFINISHED
    return Verdict.EFFECTS if named else Verdict.NONE
