"""What the sequence of the trials explains of a remainder: a coefficient that follows it, and the held-out error then.

Each trial tells of a coefficient by δ_k = s_kᵀ e_k / s_kᵀ s_k, with the variance 1/(s_kᵀ s_k).  A Gaussian process
learns δ over what is followed: the place in the sequence, the phase of a period, or a quantity of earlier impacts.  The
law with the coefficients so predicted is tested on the trials held out, and so are processes that add to the velocities
alike for every impact.  Where these do better, the measurement follows the order, and nothing is said of it here.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from contactlearn.diagnosis.result.remainder import Coefficient, Past, Succession
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.diagnosis.unexplained.remainder import fall
from contactlearn.diagnosis.unexplained.scores import Scores
from contactlearn.diagnosis.unexplained.succession import Suspect, histories, suspects
from contactlearn.diagnosis.validation import Folds
from contactlearn.evaluation.metrics import Interval, mass_error
from contactlearn.identification.joint import FitOptions, JointFit
from contactlearn.impacts import Impacts, Prediction
from contactlearn.model import predict_with
from contactlearn.regression.gp.exact import ExactGPs

_FEWEST = 40  # trials below which nothing is said
_STRETCH = 560  # trials that are learnt from and held out, at most: as many as follow one another
_TRIED = 4  # suspects, the most surprising ones
_PLACES = 4.0  # trials in the unit of length of processes over the place, whose lengths begin at 7 and at 49 trials
_TELLING = 0.02  # of the mean information of a trial, below which it does not tell of a coefficient


def find_succession(
    impacts: Impacts, fit: JointFit, options: FitOptions, thresholds: Thresholds = Thresholds()
) -> Succession | None:
    """Find what the sequence of the trials tells of a fitted model's remainder; None where it tells nothing.

    Args:
        impacts: measurements, whose errors are independent.
        fit: of a law with effects to all of them.
        options: of the fit.
        thresholds: of the level, and of what is large.
    """
    if len(impacts) < _FEWEST:
        return None
    scores, model = Scores.of(impacts, fit, options), fit.model
    ordered = impacts[scores.rows]
    history = histories(ordered, model.base_prediction(ordered))
    chance, found = suspects(scores, history, thresholds.sequence.level / 2)
    if not found:
        return None
    learning = _Learning.of(ordered, fit, scores)
    best = _best(learning, found[:_TRIED])
    if best is None:
        return None
    coefficient, suspect, share, scale = best
    return Succession(
        coefficient=coefficient,
        follows=suspect.follows,
        trials=scale,
        p_value=chance,
        share=share,
        large=share.mean > thresholds.sequence.share,
    )


@dataclass(frozen=True)
class _Learning:
    """A stretch of the sequence, its folds, and what each trial tells of the coefficients."""

    impacts: Impacts
    fit: JointFit
    stretch: slice
    folds: Folds
    told: Float[Tensor, "n 2"]
    information: Float[Tensor, "n 2"]
    inliers: Bool[Tensor, " n"]

    @classmethod
    def of(cls, ordered: Impacts, fit: JointFit, scores: Scores) -> "_Learning":
        """Take the middle of a long sequence."""
        first = max(0, (len(ordered) - _STRETCH) // 2)
        stretch = slice(first, first + _STRETCH)
        slope, residual = scores.slope[stretch], scores.residual[stretch]
        information = slope.square().sum(1)
        told = (slope * residual[..., None]).sum(1) / information.clamp_min(1e-300)
        impacts = ordered[stretch]
        folds = Folds.draw(len(impacts), torch.Generator().manual_seed(0), repeats=1)
        return cls(impacts, fit, stretch, folds, told, information, fit.inliers[scores.rows][stretch])

    def share(self, prediction: Prediction) -> Interval:
        """The fall of the held-out error by a prediction."""
        before = mass_error(self.impacts, self.fit.model.predict(self.impacts))
        after = mass_error(self.impacts, prediction)
        counted = self.inliers & torch.isin(torch.arange(len(before)), self.folds.held_out)
        return fall(before[counted], after[counted], torch.Generator().manual_seed(0))

    def by_coefficient(self, suspect: Suspect, which: Coefficient) -> tuple[Interval, float]:
        """Let a coefficient follow; the share that this takes away, and the trials of its scale."""
        k, law = tuple(Coefficient).index(which), self.fit.model.law
        known = self.information[:, k]
        telling = self.inliers & (known > _TELLING * known.mean())
        change, scale = self._followed(
            suspect, self.told[:, k : k + 1], (known / known[telling].median())[:, None], telling
        )
        values = torch.stack([part.expand(len(self.impacts)) for part in law.coefficients], -1).clone()
        values[:, k] += change[:, 0]
        return self.share(predict_with(law, self.impacts, values, self.fit.model.effects)), scale

    def alike(self, suspect: Suspect) -> tuple[Interval, float]:
        """Let the velocities after impact follow, alike for every impact."""
        base = self.fit.model.predict(self.impacts)
        residual = self.impacts.v_post - base.v_post
        change, scale = self._followed(suspect, residual, torch.ones_like(residual), self.inliers)
        return self.share(Prediction(base.v_post + change, base.wrench)), scale

    def _followed(
        self, suspect: Suspect, y: Float[Tensor, "n o"], weight: Float[Tensor, "n o"], telling: Bool[Tensor, " n"]
    ) -> tuple[Float[Tensor, "n o"], float]:
        """Learn y over what is followed; its value on held-out trials, and the scale in trials."""
        x = _inputs(suspect)[self.stretch]
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
        length = gps.hyperparameters()[..., 0].log().mean().exp().item()
        return value, _PLACES * length if suspect.follows is Past.ORDER else suspect.trials


def _best(learning: _Learning, found: Sequence[Suspect]) -> tuple[Coefficient | None, Suspect, Interval, float] | None:
    """What takes most of the error away; None where nothing does, or where velocities that drift take more."""
    drift = learning.alike(replace(found[0], follows=Past.ORDER))[0]
    tried: list[tuple[Coefficient | None, Suspect, Interval, float]] = []
    for one in found:
        alike, scale = (drift, 0.0) if one.follows is Past.ORDER else learning.alike(one)
        if one.coefficient is not None:
            share, own = learning.by_coefficient(one, one.coefficient)
            if share.mean >= alike.mean:
                tried.append((one.coefficient, one, share, own))
                continue
        if one.follows not in (Past.ORDER, Past.PERIOD) and one.trials == 1:
            tried.append((None, one, alike, scale))
    best = max(tried, key=lambda one: one[2].mean, default=None)
    return best if best is not None and best[2].low > 0 and best[2].mean >= drift.mean else None


def _inputs(suspect: Suspect) -> Float[Tensor, "n d"]:
    """Inputs of a process over what is followed."""
    if suspect.follows is Past.PERIOD:
        return torch.stack((suspect.values.cos(), suspect.values.sin()), -1)
    if suspect.follows is Past.ORDER:
        return torch.arange(len(suspect.values), dtype=torch.float64)[:, None] / _PLACES
    return suspect.values[:, None]
