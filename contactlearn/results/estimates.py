"""Fits and errors as plain numbers, of the types that result files hold."""

import math
from collections.abc import Mapping

import torch

from contactlearn.diagnosis.result.effects import FittedParameter
from contactlearn.effects import Effect, EffectId
from contactlearn.inference.evaluation.metrics import ErrorSums, Interval, Norm
from contactlearn.inference.identification.joint import Fit
from contactlearn.inference.identification.result import SubsetFit
from contactlearn.inference.learning.recipe import Recipe, named_numbers, target_units, trained_numbers
from contactlearn.mechanics.space import Space
from contactlearn.models.regressor import Regressor
from contactlearn.results.types import (
    BEST_POST_HOC,
    IRB,
    JointEstimate,
    LawEstimate,
    ModelErrors,
    ProcessEstimate,
    metrics_of,
)


def effect_ids(effects: Mapping[str, Effect]) -> tuple[EffectId, ...]:
    """Return the names and forms of the effects of a model."""
    return tuple(EffectId(name, effect.form) for name, effect in effects.items())


def law_estimate(fit: SubsetFit) -> LawEstimate:
    """Return the parameters of a law, fitted to subsets, as numbers."""
    (mu, eps), (mu_std, eps_std) = fit.mean(), fit.std()
    return LawEstimate(
        law=fit.law.name,
        variant=fit.law.variant,
        options=dict(fit.law.options),
        trials=fit.sizes[-1],
        repetitions=len(fit.mu),
        mu=mu,
        mu_std=None if math.isnan(mu_std) else mu_std,
        eps=eps,
        eps_std=None if math.isnan(eps_std) else eps_std,
        cost=fit.cost[:, -1].mean().item(),
        mu_range=tuple(fit.mu_range[:, -1].mean(0).tolist()),
        eps_range=tuple(fit.eps_range[:, -1].mean(0).tolist()),
        mu_undetermined=fit.mu_flat[:, -1].double().mean().item(),
    )


def joint_estimate(fit: Fit) -> JointEstimate:
    """Return a law with effects, fitted to one subset, as numbers."""
    numbers, ends = zip(fit.parameters, fit.values.tolist(), fit.standard_errors.tolist(), strict=True), fit.at_ends()
    return JointEstimate(
        law=fit.model.law.name,
        effects=effect_ids(fit.model.effects),
        equation=str(fit.model),
        parameters=tuple(
            FittedParameter(
                name=p.name, symbol=p.symbol, unit=p.unit, value=value, standard_error=error, at_end=p.name in ends
            )
            for p, value, error in numbers
        ),
        correlation=tuple(map(tuple, fit.correlation.tolist())),
        undetermined=fit.undetermined(),
        at_bounds=fit.at_bounds(),
        loss=fit.loss.item(),
        starts_at_best=fit.agreement.item(),
        converged=bool(fit.converged),
        trials=len(fit.weight),
        outliers=fit.outliers,
        known=fit.known_parameters(),
    )


def process_estimates(recipe: Recipe, regressor: Regressor, space: Space) -> tuple[ProcessEstimate, ...]:
    """Return the hyperparameters of each output's process, spread and noise in the output's unit.

    Columns that are constant over the training trials have no length scale.
    """
    training = regressor.training
    loss, noise, length_scales = named_numbers(recipe, space, *trained_numbers(regressor))
    spread = (regressor.gps.hyperparameters()[:, -2].sqrt() * regressor.outputs.spread[0]).tolist()
    return tuple(
        ProcessEstimate(
            output=output,
            unit=unit,
            length_scales=length_scales[output],
            spread=spread[o],
            noise=noise[output],
            loss=loss[output],
            converged=bool(training.converged[o]),
            evaluations=int(training.evaluations[o]),
        )
        for o, (output, unit) in enumerate(target_units(recipe.target, space).items())
    )


def error_table(sums: ErrorSums, norm: Norm, resamples: int, generator: torch.Generator) -> dict[str, ModelErrors]:
    """Return the errors of every model, and those of the bounds of a norm in the metrics that they bound.

    All models and metrics have the same resamples of the trials.
    """
    state = generator.get_state()
    table = {}
    for name in sums.models:
        intervals = {}
        for key in metrics_of(name, norm):
            generator.set_state(state)
            intervals[key] = sums.interval(key, name, generator, resamples)
        outside, back_spin = sums.outside_admissible(name), sums.back_spin(name)
        table[name] = ModelErrors(**intervals, outside_admissible=outside, back_spin=back_spin)
    return table


def ranked(sums: ErrorSums, metric: str) -> tuple[str, dict[str, Interval]]:
    """Compare the models by an error on the same trials.

    Returns:
        The model with the least mean error, bounds aside; and the error of each other model less that of the best,
        paired by trial, with its interval, the smallest mean first.
    """
    models = [name for name in sums.models if name not in (BEST_POST_HOC, IRB)]
    best, *others = sorted(models, key=lambda name: sums.mean(metric, name))
    generator = torch.Generator().manual_seed(0)
    return best, {name: sums.difference(metric, name, best, generator) for name in others}
