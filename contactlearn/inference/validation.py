"""Cross-validation of models: folds, fits on them, and held-out errors and losses trial by trial."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Int
from torch import Tensor

from contactlearn.core.errors import DataError
from contactlearn.effects import Effect
from contactlearn.inference.evaluation.metrics import Interval, bootstrap, mass_error
from contactlearn.inference.identification import joint
from contactlearn.inference.identification.joint import Fit, FitOptions
from contactlearn.inference.identification.robust import robust_distance
from contactlearn.laws import Law
from contactlearn.mechanics.impacts import Impacts, Prediction

RESAMPLES = 1000
"""Resamples of the bootstrap of a mean error."""
_STARTS = 4  # of a fit to all trials without a start
_TOLERANCE = 1e-4  # nats a trial, of the fits of the folds, which begin next to their ends
_CHI_SQUARED_50 = torch.tensor(  # median, by the degrees of freedom from 1
    (0.4549364, 1.3862944, 2.3659739, 3.3566940, 4.3514602, 5.3481206), dtype=torch.float64
)
_EXACT = 1e-12  # variance, (m/s)² or (rad/s)², below which a component has no residual


@dataclass(frozen=True)
class Folds:
    """Rows to fit to and rows held out in each of B folds; every trial is held out as often as any other, or never."""

    fitted: Int[Tensor, "b n"]
    held_out: Int[Tensor, "b m"]

    @classmethod
    def draw(cls, trials: int, generator: torch.Generator, folds: int = 5, repeats: int = 2) -> "Folds":
        """Draw the folds of a repeated cross-validation.

        Args:
            trials: number N of trials; up to `folds` − 1 of them are never held out in one repeat.
            generator: of the order of the trials.
            folds: in each repeat.
            repeats: of the whole.

        Raises:
            DataError: fewer than four trials a fold.
        """
        if trials < 4 * folds:
            raise DataError(f"cross-validation in {folds} folds needs at least {4 * folds} trials, got {trials}")
        size = trials // folds
        fitted, held_out = [], []
        for _ in range(repeats):
            order = torch.randperm(trials, generator=generator)
            for k in range(folds):
                part = torch.zeros(trials, dtype=torch.bool)
                part[k * size : (k + 1) * size] = True
                held_out.append(order[part])
                fitted.append(order[~part])
        return cls(torch.stack(fitted), torch.stack(held_out))

    @classmethod
    def of(cls, held_out: Int[Tensor, "b m"], trials: int) -> "Folds":
        """Make folds from the rows that they hold out; every other row of the N trials is fitted to."""
        out = torch.zeros(len(held_out), trials, dtype=torch.bool).scatter(1, held_out, True)
        return cls((~out).nonzero()[:, 1].reshape(len(held_out), -1), held_out)

    def scores(self, score: Float[Tensor, "b N"]) -> Float[Tensor, " N"]:
        """Average the scores of each trial over the folds that hold it out; nan where none does."""
        picked = score.gather(1, self.held_out)
        total = torch.zeros(score.shape[1], dtype=score.dtype).index_add(0, self.held_out.flatten(), picked.flatten())
        return total / torch.bincount(self.held_out.flatten(), minlength=score.shape[1])


@dataclass(frozen=True)
class ValidatedFit:
    """A model fitted to all trials, with held-out scores of each trial.

    Args:
        effects: of the model, by name.
        fit: to all trials.
        error: held-out mass error.
        loss: held-out −log density of v_post in nats, up to a constant: Student's t with 5 degrees of freedom, in the
            scatter of the residual.
    """

    effects: Mapping[str, Effect]
    fit: Fit
    error: Float[Tensor, " n"]
    loss: Float[Tensor, " n"]

    @property
    def mean_error(self) -> float:
        """Mean held-out mass error."""
        return self.error.nanmean().item()


@dataclass(frozen=True, kw_only=True)
class CrossValidation:
    """Fits models around one law to impacts and validates them on the same folds."""

    law: Law
    impacts: Impacts
    folds: Folds
    options: FitOptions

    def fit(self, effects: Mapping[str, Effect], start: Float[Tensor, " k"] | None = None) -> Fit:
        """Fit the law with effects to all trials, from a start or by a search."""
        return joint.fit(self.impacts, self.law, effects, options=replace(self.options, starts=_STARTS), start=start)

    def predicted(self, effects: Mapping[str, Effect], fit: Fit) -> Prediction:
        """Predict all trials [b, n] by the fits of the folds, which start at that to all trials."""
        options = replace(self.options, tolerance=_TOLERANCE, standard_errors=False)
        rows = self.folds.fitted
        held = joint.fit(self.impacts, self.law, effects, rows=rows, options=options, start=fit.values)
        return held.model.predict(self.impacts)

    def validated(
        self,
        effects: Mapping[str, Effect],
        fit: Fit,
        scatter: Float[Tensor, "D D"] | None = None,
        held: Prediction | None = None,
    ) -> ValidatedFit:
        """Score a model on held-out trials.

        Args:
            effects: of the model.
            fit: of it to all trials.
            scatter: in which the losses are measured; if None, that of the model's own residual.
            held: by the fits of the folds, where these have been made.
        """
        held = self.predicted(effects, fit) if held is None else held
        if scatter is None:
            scatter = robust_covariance(self.impacts.residual(fit.model.predict(self.impacts).v_post))
        residual = self.impacts.residual(held.v_post)
        loss = robust_distance(residual, scatter.expand(len(residual), -1, -1)) + 0.5 * scatter.logdet()
        error = mass_error(self.impacts, held)
        return ValidatedFit(effects, fit, self.folds.scores(error), self.folds.scores(loss))


def held_out_error(
    law: Law,
    effects: Mapping[str, Effect],
    impacts: Impacts,
    folds: Folds,
    options: FitOptions,
    start: Float[Tensor, " k"] | None = None,
) -> float:
    """Compute the mean held-out mass error of a law with effects, fitted from a start if one is given."""
    options = replace(options, starts=2, tolerance=_TOLERANCE, standard_errors=False)
    model = joint.fit(impacts, law, effects, rows=folds.fitted, options=options, start=start).model
    return folds.scores(mass_error(impacts, model.predict(impacts))).nanmean().item()


def paired_gain(before: ValidatedFit, after: ValidatedFit) -> tuple[float, float]:
    """Compute the mean fall of the held-out loss in nats a trial, and its standard error over the trials."""
    gain = before.loss - after.loss
    gain = gain[gain.isfinite()]
    return gain.mean().item(), (gain.std() / math.sqrt(len(gain))).item()


def held_out_interval(error: Float[Tensor, " n"], generator: torch.Generator) -> Interval:
    """Compute the mean and 95 % interval of the errors of those trials that were held out; the others are nan."""
    return bootstrap(error[error.isfinite()], generator, RESAMPLES)


def robust_covariance(residual: Float[Tensor, "*b n D"]) -> Float[Tensor, "*b D D"]:
    """Estimate the covariance of residuals by Student's t with 5 degrees of freedom, scaled to be right for Gaussians.

    Components without any residual, such as v_x and ω of bounces along the normal, are no degrees of freedom.
    Source: Lange, Little & Taylor 1989; Kent, Tyler & Vardi 1994, for the sum of the weights, which needs fewer steps.
    """
    D = residual.shape[-1]
    varying = (residual.square().mean(-2) > _EXACT).sum(-1).clamp_min(1)
    scatter = torch.diag_embed(residual.square().median(-2).values + _EXACT)
    for _ in range(15):
        weight = (5 + varying[..., None, None]) / (
            5 + (residual @ torch.linalg.inv(scatter) * residual).sum(-1, keepdim=True)
        )
        scatter = residual.mT @ (weight * residual) / weight.sum(-2, keepdim=True)
        scatter = scatter + _EXACT * torch.eye(D, dtype=residual.dtype)
    distance = (residual @ torch.linalg.inv(scatter) * residual).sum(-1)
    typical = distance.median(-1).values / _CHI_SQUARED_50.to(residual)[varying - 1]
    return scatter * typical.clamp_min(1e-6)[..., None, None]  # of exact data
