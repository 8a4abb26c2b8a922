"""Processes that learn a coefficient, or velocities, over given inputs, and the held-out residual with them.

Each trial tells of a coefficient by δ_k = s_kᵀ e_k / s_kᵀ s_k, with the variance 1/(s_kᵀ s_k).  A Gaussian process
learns δ over the inputs; the law with the coefficients so predicted is tested on the trials held out.  So are processes
that add to the velocities alike, whatever the impact.  The share that is taken away is of the mean size of the residual
in units of its scatter: friction moves few trials, and those in the spin, which the mass error hardly counts.
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
from contactlearn.inference.identification.joint import JointFit
from contactlearn.inference.validation import Folds, robust_covariance
from contactlearn.mechanics.impacts import Impacts
from contactlearn.models.contact_model import predict_with

if TYPE_CHECKING:  # GPyTorch takes long to load
    from contactlearn.models.gp.exact import ExactGPs

_TELLING = 0.02  # of the mean information of a trial, below which it does not tell of a coefficient


@dataclass(frozen=True)
class VaryingCoefficientFit:
    """The fall of the held-out residual by what was learnt, and the processes of each fold, of one output or three.

    `x` are the inputs of the trials held out, `unit` that of each output, `v_post` the held-out predictions.
    """

    share: Interval
    v_post: Float[Tensor, "n 3"]
    gps: "ExactGPs"
    x: Float[Tensor, "b m d"]
    unit: Float[Tensor, "b 1 o"]

    def at(self, x: Float[Tensor, "b m d"]) -> Float[Tensor, "b m o"]:
        """Predict the outputs in their units, but for a constant."""
        return self.unit * self.gps.mean(x).mT


@dataclass(frozen=True)
class VaryingCoefficientModel:
    """Trials, their folds, and what each trial tells of the coefficients."""

    impacts: Impacts
    fit: JointFit
    folds: Folds
    told: Float[Tensor, "n 2"]
    information: Float[Tensor, "n 2"]
    inliers: Bool[Tensor, " n"]

    @classmethod
    def of(
        cls, ordered: Impacts, fit: JointFit, scores: Scores, rows: Int[Tensor, " m"] | slice = slice(None)
    ) -> "VaryingCoefficientModel":
        """Take some rows of the impacts in the order of their scores."""
        slope, residual = scores.slope[rows], scores.residual[rows]
        information = slope.square().sum(1)
        told = (slope * residual[..., None]).sum(1) / information.clamp_min(1e-300)
        folds = Folds.draw(len(slope), torch.Generator().manual_seed(0), repeats=1)
        return cls(ordered[rows], fit, folds, told, information, fit.inliers[scores.rows][rows])

    def coefficient(self, which: Coefficient, x: Float[Tensor, "n d"]) -> VaryingCoefficientFit:
        """Let a coefficient depend on the inputs."""
        k, law = tuple(Coefficient).index(which), self.fit.model.law
        known = self.information[:, k]
        telling = self.inliers & (known > _TELLING * known.mean())
        weight = (known / known[telling].median())[:, None]
        change, learnt = self._learnt(x, self.told[:, k : k + 1], weight, telling)
        values = torch.stack([part.expand(len(self.impacts)) for part in law.coefficients], -1).clone()
        values[:, k] += change[:, 0]
        return self._tested(predict_with(law, self.impacts, values, self.fit.model.effects).v_post, learnt)

    def velocities(self, x: Float[Tensor, "n d"]) -> VaryingCoefficientFit:
        """Let the velocities after impact depend on the inputs, whatever the impact."""
        residual = self.impacts.v_post - self.v_post
        change, learnt = self._learnt(x, residual, torch.ones_like(residual), self.inliers)
        return self._tested(self.v_post + change, learnt)

    @property
    def v_post(self) -> Float[Tensor, "n 3"]:
        """Predictions of the model alone, in (m/s, m/s, rad/s)."""
        return self.fit.model.predict(self.impacts).v_post

    def errors(self, *v_post: Float[Tensor, "n 3"]) -> Float[Tensor, "p m"]:
        """Compute sizes of the residuals of predictions, of the trials held out that are no gross outliers.

        They are in units of the model's own scatter, in which no component hides another.
        """
        counted = self.inliers & torch.isin(torch.arange(len(self.impacts)), self.folds.held_out)
        base = (self.impacts.v_post - self.v_post)[self.inliers]
        left = (self.impacts.v_post - torch.stack(v_post))[:, counted]
        root = torch.linalg.cholesky(robust_covariance(base))
        return torch.linalg.solve_triangular(root, left.mT, upper=False).norm(dim=1)

    def _tested(
        self, v_post: Float[Tensor, "n 3"], learnt: Callable[[Interval, Tensor], VaryingCoefficientFit]
    ) -> VaryingCoefficientFit:
        """What was learnt with the fall of the held-out residual by it."""
        before, after = self.errors(self.v_post, v_post)
        return learnt(relative_error_reduction(before, after, torch.Generator().manual_seed(0)), v_post)

    def _learnt(
        self,
        x: Float[Tensor, "n d"],
        y: Float[Tensor, "n o"],
        weight: Float[Tensor, "n o"],
        telling: Bool[Tensor, " n"],
    ) -> tuple[Float[Tensor, "n o"], Callable[[Interval, Tensor], VaryingCoefficientFit]]:
        """Learn y over the inputs; its value on held-out trials."""
        from contactlearn.models.gp.exact import ExactGPs

        rows = [part[telling[part]] for part in self.folds.fitted]
        size = min(map(len, rows))
        rows = torch.stack([part[:size] for part in rows])
        mean = (weight[rows] * y[rows]).sum(1, keepdim=True) / weight[rows].sum(1, keepdim=True)
        spread = (
            (weight[rows] * (y[rows] - mean).square()).sum(1, keepdim=True) / weight[rows].sum(1, keepdim=True)
        ).sqrt()
        spread = spread.clamp_min(1e-300)
        gps = ExactGPs(x[rows], ((y[rows] - mean) / spread).mT, weight[rows].sqrt().mT)
        gps.fit()
        held = mean + spread * gps.mean(x[self.folds.held_out]).mT
        each = torch.zeros(len(self.folds.held_out), len(y), y.shape[1], dtype=y.dtype)
        each = each.scatter(1, self.folds.held_out[..., None].expand_as(held), held)
        value = torch.stack([self.folds.scores(part) for part in each.unbind(-1)], -1).nan_to_num(0.0)
        return value, partial(VaryingCoefficientFit, gps=gps, x=x[self.folds.held_out], unit=spread)
