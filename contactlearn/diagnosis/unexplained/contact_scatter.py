"""Scatter of the contact around the full model: its components, their structure, and the floor that they make.

The estimate takes all trials: its mixture holds gross outliers, and the robust fit of the law would leave out four
percent of the trials of a normal that scatters, and a tenth of its standard deviation with them.  The floor is the mean
mass error of outcomes that are drawn with the deviations of the contact and the noise of the instrument; it is 0.92 to
1.02 times the error of planted worlds (benchmarks/accuracy/scattered_impacts.py).  The part of a variance that follows
something known of the impacts makes no floor.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.errors import ContactLearnError
from contactlearn.diagnosis.record import Deviations
from contactlearn.diagnosis.result import ContactScatter, DeviationDependence, ScatterComponent
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.diagnosis.unexplained.deviations import random_shares, screen_deviations
from contactlearn.diagnosis.unexplained.serial_dependence import histories
from contactlearn.effects import State
from contactlearn.inference.evaluation.metrics import Interval, bootstrap, mass_error
from contactlearn.inference.evaluation.partial_residuals import share_explained, state_quantities
from contactlearn.inference.identification.joint import FitOptions
from contactlearn.inference.identification.scatter import MIN_TRIALS, Scatter, fit_scatter
from contactlearn.mechanics.impacts import Impacts
from contactlearn.models.contact_model import ContactModel

_TRIALS = 1500  # of an estimate, at most: as many as are tested for structure
_DRAWS, _RESAMPLES = 16, 1000
_MIN_VARIANCE_SHARE = 0.01  # of the mean variances, that each trial has at least, so that none decides alone
_ROUNDING = 1e-12  # of the largest variance, up to which one is that of what never varies


@dataclass(frozen=True, kw_only=True)
class ScatterEstimate:
    """The scatter with the mean mass errors that instrument alone and both make, and its evidence by trial.

    `model` has the components, and the instrument as its noise.
    """

    result: ContactScatter
    model: ContactModel
    instrument: Interval
    floor: Interval
    deviations: tuple[Deviations, ...]


def contact_scatter(
    impacts: Impacts, model: ContactModel, options: FitOptions, thresholds: Thresholds
) -> ScatterEstimate | None:
    """Estimate the scatter around a model and test it for structure; None of few or exact data, or where it fails."""
    some = _with_stated_noise(impacts[impacts.order.argsort(stable=True)[-_TRIALS:]], options)
    if len(some) < MIN_TRIALS:
        return None
    error = mass_error(some, model.base_prediction(some))
    if error.median() <= thresholds.exact:
        return None
    try:
        scatter = fit_scatter(some, model)
    except ContactLearnError:  # of states so alike that they determine nothing
        return None
    dependences = screen_deviations(scatter, some, thresholds)
    random = random_shares(scatter, some, dependences, thresholds)
    instrument, floor, sizes = _drawn(some, scatter, random)
    by_name = {deviation.name: deviation for deviation in scatter.deviations}
    coefficients = dict(zip("με", (x.mean().item() for x in scatter.model.law.coefficients), strict=True))
    components: list[ScatterComponent] = []
    for name in scatter.names:
        coefficient = coefficients.get(scatter.model.scatter[name].symbol)
        relative = by_name[name].value / coefficient if coefficient else None
        share, follows = sizes.get(name, 0.0), 1 - random[name]
        components.append(ScatterComponent(deviation=by_name[name], relative=relative, share=share, follows=follows))
    result = ContactScatter(
        components=tuple(sorted(components, key=lambda component: -component.share)),
        instrument=tuple(deviation for deviation in scatter.deviations if deviation.name not in scatter.names),
        stated=scatter.stated,
        trials=len(some),
        bic=scatter.bic,
        confounded=tuple((a, b) for a, b, _ in scatter.confounded()),
        dependences=dependences,
        converged=scatter.converged,
    )
    return ScatterEstimate(
        result=result,
        model=replace(scatter.model, noise=_noise(some, scatter)),
        instrument=instrument,
        floor=floor,
        deviations=tuple(_evidence(some, scatter, dependences)),
    )


def weighed(impacts: Impacts, model: ContactModel, options: FitOptions, thresholds: Thresholds) -> Impacts | None:
    """Return impacts with the moments of their outcomes by instrument and scatter of the contact, where that is plain.

    It is not where the deviations of a component follow something: no weight may hide unknown physics.  The mean
    shifts where scatter makes contacts stick.  Weights alone would make the bias of friction three standard errors.
    """
    known = _with_stated_noise(impacts, options)
    some = known[impacts.order.argsort(stable=True)[-_TRIALS:]]
    if len(some) < MIN_TRIALS or mass_error(some, model.base_prediction(some)).median() <= thresholds.exact:
        return None
    try:
        scatter = fit_scatter(some, model, quick=True)
    except ContactLearnError:
        return None
    if not scatter.names or screen_deviations(scatter, some, thresholds):
        return None
    covariance = scatter.covariance(known)
    least, mass = _MIN_VARIANCE_SHARE * covariance.diagonal(dim1=-2, dim2=-1).mean(0), impacts.mass_diagonal.mean(0)
    largest = (mass * least).max() / mass  # of the same energy, for what never varies, as v_x of bounces straight down
    covariance = covariance + torch.diag(torch.where(least > _ROUNDING * largest, least, largest))
    return impacts.replace(outcome_cov=covariance, outcome_shift=scatter.model.scatter_shift(impacts))


def _with_stated_noise(impacts: Impacts, options: FitOptions) -> Impacts:
    """Give each impact the covariances of the stated noise, where any is stated."""
    if options.noise is None:
        return impacts
    before = options.noise if options.noise_before is None else options.noise_before
    variances = torch.tensor((before, options.noise), dtype=torch.float64).square()
    v_pre_cov, v_post_cov = (part.expand(len(impacts), -1, -1) for part in torch.diag_embed(variances))
    return impacts.replace(v_pre_cov=v_pre_cov, v_post_cov=v_post_cov, validate=False)


def _noise(impacts: Impacts, scatter: Scatter) -> Float[Tensor, "D D"]:
    """Mean covariance of v_post by the instrument in the axes of the slip, larger where tails are heavy."""
    turned = impacts.slip_axes.mT @ scatter.instrument(impacts) @ impacts.slip_axes
    return max(1.0, scatter.inflation) * turned.mean(0)


def _drawn(
    impacts: Impacts, scatter: Scatter, random: Mapping[str, float]
) -> tuple[Interval, Interval, dict[str, float]]:
    """Mean mass error by the instrument alone and with the scatter, and shares of the components in its variance.

    Of each component's variance the share that is random counts.  Random numbers of its own leave those of the other
    stages as they are.
    """
    generator, expected = torch.Generator().manual_seed(0), scatter.model.base_prediction(impacts)
    values, vectors = torch.linalg.eigh(scatter.instrument(impacts))
    root = vectors * values.clamp_min(0).sqrt()[:, None]
    components = {
        name: replace(component, sigma=component.sigma * math.sqrt(random[name]))
        for name, component in scatter.model.scatter.items()
        if random[name]
    }
    model = replace(scatter.model, scatter=components)

    def error(outcome: Float[Tensor, "n D"]) -> Float[Tensor, " n"]:
        return mass_error(impacts.replace(v_post=outcome, validate=False), expected)

    alone, both = [], []
    for _ in range(_DRAWS):
        unit = torch.randn(*impacts.v_pre.shape, 1, dtype=torch.float64, generator=generator)
        noise = (root @ unit)[..., 0]
        alone.append(error(expected.v_post + noise))
        both.append(error(model.scattered(impacts, generator).v_post + noise))
    sizes = {name: _mass_square(impacts, replace(model, scatter={name: c})) for name, c in components.items()}
    whole = sum(sizes.values()) or 1.0
    intervals = [bootstrap(torch.stack(part).mean(0), generator, _RESAMPLES) for part in (alone, both)]
    return intervals[0], intervals[1], {name: size / whole for name, size in sizes.items()}


def _mass_square(impacts: Impacts, model: ContactModel) -> float:
    """Mean square of the change of v_post by scatter in the mass norm, relative to the speed."""
    mass = impacts.mass_diagonal
    variance = model.scatter_covariance(impacts).diagonal(dim1=-2, dim2=-1)
    size = (mass * impacts.v_post.square()).sum(-1).clamp_min(1e-300)
    return ((mass * variance).sum(-1) / size).median().item()


def _evidence(impacts: Impacts, scatter: Scatter, dependences: tuple[DeviationDependence, ...]) -> list[Deviations]:
    """Deviations of each component over the variable that they depend on, or else the most related one."""
    known = state_quantities(State.of(impacts))
    past = histories(impacts, scatter.model.base_prediction(impacts))
    earlier = {f"{memory.variable} of earlier impacts": values for memory, values in past.items()}
    by_name, deviations = {deviation.name: deviation for deviation in scatter.deviations}, list[Deviations]()
    for name, (u, error) in scatter.each.items():
        first = next((dependence.variable for dependence in dependences if dependence.component == name), "")
        if first in earlier:
            variable, unit, x = first.replace("_", " "), "standardised", earlier[first]
        elif first in ("order", "period"):
            variable, unit, x = "order", "–", impacts.order
        else:
            symbol = {"pose": "theta"}.get(first, first.partition(", ")[0].split(" × ")[0])
            if symbol not in known:
                column = u[:, int(u.square().sum(0).argmax())]
                symbol = max(known, key=lambda key: share_explained(known[key][2], column))
            variable, unit, x = known[symbol]
        deviations.append(
            Deviations(
                component=name,
                symbol=by_name[name].symbol.removeprefix("σ_"),
                unit=by_name[name].unit,
                variable=variable,
                variable_unit=unit,
                x=x,
                order=impacts.order,
                u=u,
                error=error,
            )
        )
    return deviations
