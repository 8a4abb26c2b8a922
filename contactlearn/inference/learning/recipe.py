"""Learning: from a recipe and training trials to a `ContactModel`.

    target                  what the processes learn                             paper
    velocity                v_post − v_pre, or − that of the law                 Class I
    impulse                 (P_t, P_n), or what the law leaves of it             Class I, II; rigid
    wrench                  (P_t, P_n, τ), or its residual                        Class I, II
    parameters_identified   the (μ, ε) that fit each single trial best           Class II; rigid
    parameters_likelihood   (μ, ε) such that the law's impulse is likely         Class II; rigid

A trial that sticks carries no information on μ.  `parameters_likelihood` gives it almost no weight in learning μ, while
`parameters_identified` learns from it one of the many μ that fit.  In space velocities and impulses are learnt in the
axes of the slip, so that a turn about the normal turns a prediction.  Subsets of equal size are learnt from in one
batch.
Source: Fazeli et al. (2017), Section 4.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.errors import ContactLearnError, DataError, UnknownNameError
from contactlearn.inference.evaluation import metrics
from contactlearn.inference.identification.per_trial import fit_trials
from contactlearn.inference.identification.result import Box
from contactlearn.inference.identification.shared import fit_subsets
from contactlearn.inference.learning.events import OnLearningEvent, RoundScored, TrainingRound
from contactlearn.laws import Law
from contactlearn.mechanics.features import SPACES, feature_units
from contactlearn.mechanics.impacts import Impacts, measured_impulse, require_impacts
from contactlearn.mechanics.noise_weight import noise_variance, noise_weight
from contactlearn.mechanics.rigid_body import matvec
from contactlearn.mechanics.space import PLANE, Space
from contactlearn.models.contact_model import ContactModel, predict_with, wrench_per_parameter
from contactlearn.models.process_options import ProcessOptions
from contactlearn.models.regressor import Regressor
from contactlearn.models.standardisation import Standardisation

TARGETS = {
    "velocity": PLANE.symbols,
    "impulse": {"P_t": "N s", "P_n": "N s"},
    "wrench": {"P_t": "N s", "P_n": "N s", "τ": "N m s"},
    "parameters_identified": {"μ": "–", "ε": "–"},
    "parameters_likelihood": {"μ": "–", "ε": "–"},
}
"""Components of each target in the plane, with units."""


def target_units(target: str, space: Space) -> dict[str, str]:
    """Return the components of a target with their units; in space along the slip, across it and along the normal."""
    units = TARGETS[target]
    if space is PLANE or target.startswith("parameters"):
        return units
    letters = {name[0]: unit for name, unit in units.items()}
    return {f"{letter}_{axis}": unit for letter, unit in letters.items() for axis in ("1", "2", "n")}


OnRegressor = Callable[[Regressor], None]

_ROUNDS = 4  # linearisations of the law; most parameters move little after the third
_COVERAGE = 0.95
_CALIBRATED = 20_000  # training trials, evenly among all, of which so many are to be covered
_LOG_SIZE = math.log(0.05), math.log(100.0)
_LEAST_WEIGHT = 0.01  # of a trial without information on a parameter, which it then keeps at its present value
_PRIOR_SPREAD = 0.1  # standard deviation of μ and ε about the shared values, before learning


@dataclass(frozen=True)
class Recipe:
    """Definition of a learned model: `features`, `target`, and the `law` whose residual or parameters it learns.

    `processes` are the modules of its Gaussian processes and their training.

    Raises:
        UnknownNameError: no such feature space or target.
        ContactLearnError: parameters to learn but no law, or processes that do not fit the features.
    """

    features: str
    target: str
    law: Law | None = None
    processes: ProcessOptions = ProcessOptions()

    def __post_init__(self) -> None:
        if self.features not in SPACES:
            raise UnknownNameError("feature space", self.features, SPACES)
        if self.target not in TARGETS:
            raise UnknownNameError("target", self.target, TARGETS)
        if not (self.law is None or isinstance(self.law, Law)):
            raise ContactLearnError(
                f"a recipe builds on a law, such as laws.find('mirtich'), or on None; got {self.law!r}"
            )
        if self.law is None and self.target.startswith("parameters"):
            raise ContactLearnError(f"target {self.target} needs a law, got none")
        if self.processes != ProcessOptions():
            from contactlearn.models.gp.exact import checked_options  # GPyTorch takes long to load

            names, *in_space = filter(None, (SPACES[self.features].columns, SPACES[self.features].in_space))
            try:
                checked_options(self.processes, list(names))
            except ContactLearnError as error:  # names of features in space, perhaps
                if not in_space:
                    raise
                try:
                    checked_options(self.processes, list(in_space[0]))
                except ContactLearnError:
                    raise error from None

    @classmethod
    def of(cls, model: ContactModel) -> "Recipe":
        """Return the recipe that a learned model was made by.

        Raises:
            ContactLearnError: nothing is learned, or the base has a learned part itself.
        """
        processes, under = model.processes, model.base if isinstance(model.base, ContactModel) else model
        if under is not model and (under.residual or under.parameters or isinstance(under.base, ContactModel)):
            raise ContactLearnError(f"no recipe makes a model on top of a learned model, such as {model}")
        target = model.target
        if model.parameters is not None:
            _, _, weight, *_ = processes.gps.data()
            target = f"parameters_{'identified' if weight is None else 'likelihood'}"
        law = under.base if isinstance(under.base, Law) else None
        return cls(processes.space, target, law, processes.gps.options)


def learn(
    impacts: Impacts,
    recipe: Recipe,
    *,
    rows: Tensor | None = None,
    base: Law | ContactModel | None = None,
    impulse: str = "momentum",
    box: Box | None = None,
    like: Regressor | None = None,
    held_out: Impacts | None = None,
    on_event: OnLearningEvent | None = None,
) -> ContactModel:
    """Train one model on each training subset.

    Args:
        impacts: measurements.
        recipe: features, target and law of the model.
        rows: subsets [..., n] of equal size as rows of the impacts; all of them if None.
        base: the recipe's law with its shared (μ, ε) [..., 1], or any model whose residual is learnt; for the target
            `parameters_likelihood` also a law with effects.  If None, the recipe's law is fitted to the same rows.
            The scatter of its contact is noise of what is learnt, and stays in the predicted covariances.
        impulse: the measured impulse, see `impacts.measured_impulse`.
        box: limits of per-trial parameters.
        like: processes of the same recipe, whose hyperparameters the training begins with.
        held_out: trials that are not learnt from, whose errors are reported as the training goes on.
        on_event: receives a `TrainingRound` after each round, and a `RoundScored` of the held-out trials after rounds
            1, 2, 4, 8 … and after the last.

    Raises:
        DataError: fewer than two training trials, one twice, or one that is not there.
        ContactLearnError: a base that is not the recipe's.
    """
    require_impacts(impacts)
    if not isinstance(recipe, Recipe):
        raise ContactLearnError(f"learn takes impacts and a Recipe, such as Recipe('x1', 'wrench'); got {recipe!r}")
    rows = impacts.numbered(slice(None) if rows is None else rows)
    if bool((rows.sort(-1).values.diff(dim=-1) == 0).any()):
        raise DataError("a training subset must not have a trial twice; pass each row once")
    if base is None and recipe.law is not None:
        base = _fitted_law(recipe.law, impacts, rows, impulse, box)
    start = _before_learning(recipe, base)
    part = "parameters" if recipe.target.startswith("parameters") else "residual"
    fit = partial(Regressor.fit, recipe.features, impacts, rows, like=like, options=recipe.processes)

    def finished(values: Tensor, regressor: Regressor) -> ContactModel:
        return _with_noise(replace(start, **{part: regressor}), impacts, rows, values)

    watch = None if on_event is None else _Watch(recipe, impacts.space, rows.shape[-1], held_out, on_event)

    def listener(values: Tensor) -> OnRegressor | None:
        if (take := watch and watch.take) is None:
            return None
        return lambda now: take(now, partial(finished, values, now))

    if recipe.target == "parameters_likelihood":
        P = measured_impulse(impacts, impulse)
        regressor, values = _learn_parameters(recipe, impacts, rows, start, P, box or Box(), like, listener)
    elif recipe.target == "parameters_identified":
        trials = fit_trials(impacts, start.law, target=impulse, box=box)
        values = torch.stack((trials.mu, trials.eps), -1)[rows]
        regressor = fit(values, on_round=listener(values))
    else:
        values = _at(_residual(recipe.target, impacts, start, impulse), rows)
        known = _scattering(impacts, start)
        stated = noise_weight(known, recipe.target), noise_variance(known, recipe.target)
        weight, noise = (None if part is None else part[rows] for part in stated)
        regressor = fit(values, weight=weight, noise=noise, on_round=listener(values))
    model = finished(values, regressor)
    if watch is not None:
        watch.score(model)
    return model


_Row = tuple[float, ...]


def trained_numbers(regressor: Regressor) -> tuple[_Row, _Row, tuple[_Row, ...]]:
    """Return loss, noise and length scales by output, means over the training subsets.

    The loss is in nats a trial, the noise in the output's unit, a length scale for each feature in standard deviations
    of the feature, infinite where it is constant.
    """
    numbers = regressor.gps.hyperparameters()
    noise = numbers[..., -1].sqrt() * regressor.outputs.spread[..., 0, :]
    lengths = numbers[..., :-2].where(regressor.inputs.scale.isfinite(), math.inf)
    loss, noise = (values.reshape(-1, values.shape[-1]).mean(0).tolist() for values in (regressor.training.loss, noise))
    return tuple(loss), tuple(noise), tuple(map(tuple, lengths.reshape(-1, *lengths.shape[-2:]).mean(0).tolist()))


def named_numbers(
    recipe: Recipe, space: Space, loss: _Row, noise: _Row, length_scales: Sequence[_Row]
) -> tuple[dict[str, float], dict[str, float], dict[str, dict[str, float]]]:
    """Name `trained_numbers` by output and feature; only finite length scales are kept."""
    outputs, features = target_units(recipe.target, space), feature_units(recipe.features, space)
    finite = [{name: x for name, x in zip(features, row, strict=True) if x < math.inf} for row in length_scales]
    return (
        dict(zip(outputs, loss, strict=True)),
        dict(zip(outputs, noise, strict=True)),
        dict(zip(outputs, finite, strict=True)),
    )


@dataclass
class _Watch:
    """Reports each round of a training, and the held-out errors after some."""

    recipe: Recipe
    space: Space
    trained_on: int
    held_out: Impacts | None
    on_event: OnLearningEvent
    rounds: int = 0
    scored: int = 0

    def take(self, now: Regressor, model: Callable[[], ContactModel]) -> None:
        """Report a round; `model` makes the whole model of the processes at this moment."""
        self.rounds += 1
        loss, noise, length_scales = named_numbers(self.recipe, self.space, *trained_numbers(now))
        if not all(map(math.isfinite, loss.values())):
            return
        self.on_event(
            TrainingRound(
                trained_on=self.trained_on, round=self.rounds, loss=loss, noise=noise, length_scales=length_scales
            )
        )
        # A score costs a prediction of all held-out trials: after 1, 2, 4, 8 … rounds their cost stays small.
        if self.held_out is not None and self.rounds & (self.rounds - 1) == 0:
            self.score(model())

    def score(self, model: ContactModel) -> None:
        """Report the held-out errors of the model after the present round, once."""
        if self.held_out is None or self.scored == self.rounds:
            return
        self.scored, prediction = self.rounds, model.predict(self.held_out)
        density = metrics.negative_log_density(self.held_out, prediction)
        self.on_event(
            RoundScored(
                trained_on=self.trained_on,
                round=self.rounds,
                errors={
                    name: metric.error(self.held_out, prediction).mean().item()
                    for name, metric in metrics.METRICS.items()
                },
                negative_log_density=density.mean().item(),
            )
        )


def _fitted_law(law: Law, impacts: Impacts, rows: Tensor, impulse: str, box: Box | None) -> Law:
    """Fit the shared (μ, ε) of a law to each subset [..., n]; they are [..., 1] of several subsets."""
    orders = rows.reshape(-1, rows.shape[-1])
    fitted = fit_subsets(impacts, law, sizes=(rows.shape[-1],), orders=orders, target=impulse, box=box)
    if rows.ndim == 1:
        return fitted.to_law()
    return law.at(*(values.reshape(*rows.shape[:-1], 1) for values in (fitted.mu, fitted.eps)))


def _residual(target: str, impacts: Impacts, start: ContactModel, impulse: str) -> Tensor:
    """Measured target less that of the base, along the axes of the slip."""
    base = start.base_prediction(impacts)
    values = {
        "velocity": impacts.v_post - base.v_post,
        "impulse": measured_impulse(impacts, impulse) - base.wrench[..., : impacts.space.d],
        "wrench": impacts.wrench - base.wrench,
    }[target]
    size = values.shape[-1]
    return matvec(impacts.slip_axes.mT[:, :size, :size], values)


def _before_learning(recipe: Recipe, base: Law | ContactModel | None) -> ContactModel:
    """Return the base as a model without the part that is learnt.

    Raises:
        ContactLearnError: a base that is not the recipe's.
    """
    if not isinstance(base, ContactModel) and type(base) is not type(recipe.law):
        expected = f"the law {recipe.law.name}" if recipe.law else "nothing, or a model"
        raise ContactLearnError(f"the recipe builds on {expected}, got {base}")
    if not recipe.target.startswith("parameters"):
        return ContactModel(base, target=recipe.target)
    under = base if isinstance(base, ContactModel) else ContactModel(base)
    if under.residual or under.parameters or not isinstance(under.base, Law):
        raise ContactLearnError(f"target {recipe.target} needs a law under it, got a model")
    if under.effects and recipe.target == "parameters_identified":
        raise ContactLearnError(
            "target parameters_identified takes each trial's (μ, ε) from the law alone, but there are effects "
            f"({', '.join(under.effects)}); use target parameters_likelihood"
        )
    return under


def _learn_parameters(
    recipe: Recipe,
    impacts: Impacts,
    rows: Tensor,
    base: ContactModel,
    P: Tensor,
    box: Box,
    regressor: Regressor | None,
    listener: Callable[[Tensor], OnRegressor | None],
) -> tuple[Regressor, Tensor]:
    """Fit processes for (μ, ε) that make the measured impulse P [N, d] likely; return them and their data [..., n, 2].

    Generalised Gauss–Newton: about the present parameters θ₀ of each trial the law is P ≈ P̂ + G (θ − θ₀).
    With isotropic noise that is an observation of each parameter, θ₀ + H_kᵀ (P − P̂) / (G_kᵀ H_k) with a noise
    variance ∝ 1/(G_kᵀ H_k), where H_k is the part of G_k that the other parameter, free within its prior spread,
    cannot reproduce.  So a trial that sticks carries almost no information on μ.  The posteriors of the two
    parameters are taken as independent.  A `regressor` gives the first hyperparameters.
    """
    law, effects = base.law, base.effects
    shared = torch.atleast_2d(torch.stack(torch.broadcast_tensors(*law.coefficients), -1)).to(P)  # [..., 1, 2]
    outputs = Standardisation(shared, torch.full_like(shared, _PRIOR_SPREAD))
    theta = observed = shared.expand(*rows.shape, 2)
    for _ in range(_ROUNDS):
        theta = torch.minimum(torch.maximum(theta, box.low.to(theta)), box.high.to(theta))
        everywhere = _everywhere(theta, rows, len(impacts))
        G = _at(wrench_per_parameter(law, impacts, everywhere, effects)[..., : P.shape[-1], :], rows, 2)
        error = _at(P - predict_with(law, impacts, everywhere, effects).wrench[..., : P.shape[-1]], rows)
        other, typical = G.flip(-1), G.square().sum(-2).mean(-2, keepdim=True).amax(-1, keepdim=True).sqrt()
        shrunk = other.square().sum(-2, keepdim=True) + (_PRIOR_SPREAD * typical[..., None]).square()
        H = G - (G * other).sum(-2, keepdim=True) / shrunk * other
        weight = ((G * H).sum(-2).clamp_min(0).sqrt() / typical).clamp_min(_LEAST_WEIGHT)
        observed = theta + (H * error[..., None]).sum(-2) / (weight * typical).square()
        regressor = Regressor.fit(
            recipe.features,
            impacts,
            rows,
            observed,
            weight=weight,
            outputs=outputs,
            like=regressor,
            options=recipe.processes,
            on_round=listener(observed),
        )
        theta = _at(regressor.predict(impacts)[0], rows)
    assert regressor is not None  # there is at least one round
    return regressor, observed


def _scattering(impacts: Impacts, model: ContactModel) -> Impacts:
    """Return impacts whose covariances of v_post have the scatter of a model's contact."""
    if not model.law_model.scatter:
        return impacts
    stated, scatter = impacts.v_post_cov, model.scatter_covariance(impacts)
    return impacts.replace(v_post_cov=scatter if stated is None else stated + scatter, validate=False)


def _with_noise(model: ContactModel, impacts: Impacts, rows: Tensor, values: Tensor) -> ContactModel:
    """Return the model with the noise covariance t E of v_post in the axes of the slip, calibrated on training trials.

    E is the mean of e eᵀ over the leave-one-out errors e of the training trials.  The factor t is such that the 95 %
    ellipsoids of V + t E, with V the covariance of the processes and of the contact's scatter, contain 95 % of these
    errors, a small one where V alone does; the rank is that of
    conformal prediction, so that few trials give a wide covariance.  It is one of post velocities, as measurement noise
    is, and includes the moment τ that a rigid model cannot predict.
    """
    error, variance = model.processes.leave_one_out()
    learned = _everywhere(values - error, rows, len(impacts))
    back = impacts.slip_axes.mT
    e = _at(matvec(back, impacts.v_post - model.complete(impacts, learned).v_post), rows)
    V = model.spread(impacts, learned, _everywhere(variance, rows, len(impacts))) + model.scatter_covariance(impacts)
    V = _at(back @ V @ back.mT, rows, 2)
    speed = _at(matvec(back, impacts.v_post), rows).square().mean(-2).sqrt()
    speed = torch.where(speed > 0, speed, _usual_speed(impacts))  # such as v_x of drops that are vertical throughout
    scale = torch.maximum(e.square().mean(-2).sqrt(), 1e-6 * speed)
    unit = scale[..., :, None] * scale[..., None, :]
    e, V = e / scale[..., None, :], V / unit[..., None, :, :]
    E = (e.mT @ e) / e.shape[-2] + 1e-6 * torch.eye(impacts.space.D, dtype=e.dtype, device=e.device)
    some = slice(None, None, -(-rows.shape[-1] // _CALIBRATED))
    e, V = e[..., some, :], V[..., some, :, :]
    n = e.shape[-2]
    rank = min(n, math.ceil(_COVERAGE * (n + 1)))
    low, high = (E.new_full(E.shape[:-2], end) for end in _LOG_SIZE)
    for _ in range(20):
        middle = (low + high) / 2
        total = V + (middle.exp()[..., None, None] * E)[..., None, :, :]
        distance = (e * torch.linalg.solve(total, e)).sum(-1)
        wide = distance.kthvalue(rank, -1).values <= metrics.CHI_SQUARED_95[impacts.space.D]
        low, high = torch.where(wide, low, middle), torch.where(wide, middle, high)
    return replace(model, noise=high.exp()[..., None, None] * E * unit)


def _usual_speed(impacts: Impacts) -> Float[Tensor, "D"]:
    """Contact's speed before impact as a component of the velocity or of the spin, which is never 0."""
    speed, d = impacts.v_c.square().sum(-1).mean().sqrt(), impacts.space.d
    spin = speed / (impacts.inertia.reshape(len(impacts), -1) / impacts.mass[:, None]).sqrt().mean()
    return torch.stack((*[speed] * d, *[spin] * (impacts.space.D - d)))


def _at(values: Tensor, rows: Tensor, event: int = 1) -> Tensor:
    """Values [..., N, *event] at rows [..., n]: [..., n, *event]."""
    values = values.expand(*rows.shape[:-1], *values.shape[-1 - event :])
    return torch.take_along_dim(values, rows[(..., *(None,) * event)], -1 - event)


def _everywhere(values: Tensor, rows: Tensor, N: int) -> Tensor:
    """Values [..., n, O] of the trials `rows` [..., n] among all N, 0 for the others: [..., N, O]."""
    index = rows[..., None].expand(values.shape)
    return values.new_zeros(*rows.shape[:-1], N, values.shape[-1]).scatter(-2, index, values)
