"""Varying coefficients: processes that learn a law coefficient, or velocities, over given inputs.

Each trial estimates the change of a coefficient as δ_k = s_kᵀ e_k / s_kᵀ s_k, with the variance 1/(s_kᵀ s_k).  A
Gaussian process learns δ over the inputs, and the law with the predicted coefficients is tested on held-out trials.  So
are processes that add to the velocities, whatever the impact.  The share is the relative reduction of the mean size of
the residual in units of its scatter: friction moves few trials, and mostly their spin, which barely counts in the mass
error.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from contactlearn.diagnosis.result.remainder import Coefficient
from contactlearn.diagnosis.unexplained.remainder import relative_error_reduction
from contactlearn.diagnosis.unexplained.scores import Scores
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.inference.identification.joint import Fit
from contactlearn.inference.validation import Folds, robust_covariance
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.noise_weight import noise_weight
from contactlearn.models.contact_model import predict_with

if TYPE_CHECKING:  # GPyTorch takes long to load
    from contactlearn.models.gp.exact import ExactGPs

_INFORMATIVE = 0.02  # of the mean information of a trial, below which it does not inform a coefficient
_MIN_TRIALS = 40  # most informative trials that do so in any case: a single one may have nearly all information


@dataclass(frozen=True)
class VaryingCoefficientFit:
    """A fitted varying coefficient: its relative reduction of the held-out residual, and the processes of each fold.

    `learned` is the mean of these, `x` are the inputs of the trials held out, `unit` the unit of each output, `v_post`
    the held-out predictions.
    """

    share: Interval
    v_post: Float[Tensor, "n D"]
    gps: "ExactGPs"
    learned: Callable[[Float[Tensor, "b m d"]], Float[Tensor, "b o m"]]
    x: Float[Tensor, "b m d"]
    unit: Float[Tensor, "b 1 o"]

    def at(self, x: Float[Tensor, "b m d"]) -> Float[Tensor, "b m o"]:
        """Predict the outputs in their units, up to a constant."""
        return self.unit * self.learned(x).mT


@dataclass(frozen=True)
class VaryingCoefficientModel:
    """Trials, their folds, and the estimate `delta` of both coefficients' change by each trial with its information."""

    impacts: Impacts
    fit: Fit
    folds: Folds
    delta: Float[Tensor, "n 2"]
    information: Float[Tensor, "n 2"]
    inliers: Bool[Tensor, " n"]

    @classmethod
    def of(
        cls, ordered: Impacts, fit: Fit, scores: Scores, rows: Int[Tensor, " m"] | slice = slice(None)
    ) -> "VaryingCoefficientModel":
        """Take some rows of the impacts in the order of their scores."""
        slope, residual = scores.slope[rows], scores.residual[rows]
        information = slope.square().sum(1)
        delta = (slope * residual[..., None]).sum(1) / information.clamp_min(1e-300)
        folds = Folds.draw(len(slope), torch.Generator().manual_seed(0), repeats=1)
        return cls(ordered[rows], fit, folds, delta, information, fit.inliers[scores.rows][rows])

    def dependent(self, which: Coefficient | None, x: Float[Tensor, "n d"]) -> VaryingCoefficientFit:
        """Let a coefficient, or the velocities, depend on the inputs."""
        return self.velocities(x) if which is None else self.coefficient(which, x)

    def coefficient(self, which: Coefficient, x: Float[Tensor, "n d"]) -> VaryingCoefficientFit:
        """Let a coefficient depend on the inputs."""
        k, law = tuple(Coefficient).index(which), self.fit.model.law
        known = self.information[:, k]
        enough = torch.minimum(_INFORMATIVE * known.mean(), known.topk(min(_MIN_TRIALS, len(known))).values[-1])
        informative = self.inliers & (known >= enough) & (known > 0)
        weight = (known / known[informative].median())[:, None]
        change, make_fit = self._fit_processes(x, self.delta[:, k : k + 1], weight, informative)
        values = torch.stack([part.expand(len(self.impacts)) for part in law.coefficients], -1).clone()
        values[:, k] += change[:, 0]
        return self._validate(predict_with(law, self.impacts, values, self.fit.model.effects).v_post, make_fit)

    def velocities(self, x: Float[Tensor, "n d"]) -> VaryingCoefficientFit:
        """Let the velocities after impact depend on the inputs, whatever the impact."""
        residual = self.impacts.v_post - self.v_post
        known = None if self.impacts.outcome_cov is None else noise_weight(self.impacts, "velocity")
        weight = torch.ones_like(residual) if known is None else known.square()
        change, make_fit = self._fit_processes(x, residual, weight, self.inliers)
        return self._validate(self.v_post + change, make_fit)

    @property
    def v_post(self) -> Float[Tensor, "n D"]:
        """Predictions of the model alone, in (m/s, m/s, rad/s)."""
        return self.fit.model.predict(self.impacts).v_post

    def errors(self, *v_post: Float[Tensor, "n D"]) -> Float[Tensor, "p m"]:
        """Compute sizes of the residuals of predictions, of the trials held out that are no gross outliers.

        They are in units of the model's own scatter, in which no component hides another.
        """
        counted = self.inliers & torch.isin(torch.arange(len(self.impacts)), self.folds.held_out)
        base = self.impacts.residual(self.v_post)[self.inliers]
        residuals = self.impacts.residual(torch.stack(v_post))[:, counted]
        root = torch.linalg.cholesky(robust_covariance(base))
        return torch.linalg.solve_triangular(root, residuals.mT, upper=False).norm(dim=1)

    def _validate(
        self, v_post: Float[Tensor, "n D"], make_fit: Callable[[Interval, Tensor], VaryingCoefficientFit]
    ) -> VaryingCoefficientFit:
        """Complete a fit with its relative reduction of the held-out residual."""
        before, after = self.errors(self.v_post, v_post)
        return make_fit(relative_error_reduction(before, after, torch.Generator().manual_seed(0)), v_post)

    def _fit_processes(
        self,
        x: Float[Tensor, "n d"],
        y: Float[Tensor, "n o"],
        weight: Float[Tensor, "n o"],
        informative: Bool[Tensor, " n"],
    ) -> tuple[Float[Tensor, "n o"], Callable[[Interval, Tensor], VaryingCoefficientFit]]:
        """Fit processes of y over the inputs; return their held-out predictions, and a constructor of the fit."""
        from contactlearn.models.gp.exact import ExactGPs

        rows = [part[informative[part]] for part in self.folds.fitted]
        size = min(map(len, rows))
        rows = torch.stack([part[:size] for part in rows])
        total = weight[rows].sum(1, keepdim=True)
        mean = (weight[rows] * y[rows]).sum(1, keepdim=True) / total
        variance = (weight[rows] * (y[rows] - mean).square()).sum(1, keepdim=True) / total
        spread = variance.sqrt().clamp_min(1e-300)
        gps = ExactGPs(x[rows], ((y[rows] - mean) / spread).mT, weight[rows].sqrt().mT)
        gps.fit_folds()
        learned = gps.mean()
        held = mean + spread * learned(x[self.folds.held_out]).mT
        each = torch.zeros(len(self.folds.held_out), len(y), y.shape[1], dtype=y.dtype)
        each = each.scatter(1, self.folds.held_out[..., None].expand_as(held), held)
        value = torch.stack([self.folds.scores(part) for part in each.unbind(-1)], -1).nan_to_num(0.0)
        return value, partial(VaryingCoefficientFit, gps=gps, learned=learned, x=x[self.folds.held_out], unit=spread)
