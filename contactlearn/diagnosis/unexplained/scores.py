"""Scores: the information of each trial about the law's coefficients.

    g_k = s_kᵀ e_k,    s_k = ∂v_post/∂(μ, ε) of trial k,  e_k its residual, both whitened, times the root of its weight

A coefficient that varies makes scores alike where residuals are not, since the derivative changes its sign with the
slip.  A trial without information about a coefficient (it sticks: ∂/∂μ = 0) has a score of 0.  Changes that any
parameter of the model could make are projected out of residuals and derivatives.  For tests along the sequence,
coefficients that depend smoothly on the trial's own state are projected out as well; for tests over the state,
velocities that drift slowly and the effect of errors of v_pre are.
"""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import one_hot

from contactlearn.effects import State
from contactlearn.effects.formula.symbols import of_state
from contactlearn.inference.identification.joint import Fit, FitOptions, linearise
from contactlearn.mechanics.bodies import numbered
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.space import SPACE
from contactlearn.models.contact_model import linearised, resolve

_MANY = 100  # trials from which on the trial's own state is projected out
_SLOW_COSINES, _TRIALS_A_CURVE = 12, 25  # cosines over the sequence at most, and trials for each
_ROUNDING = 1e-9  # standard deviations of the residual in the unit of a parameter
_BODIES = 10  # at most, that have coefficients of their own


@dataclass(frozen=True)
class Scores:
    """Trials in their sequence: `rows` of the impacts, and whitened, weighted residuals and derivatives in (μ, ε).

    `reach` is an orthonormal basis of q changes that are projected out.
    """

    rows: Int[Tensor, " n"]
    residual: Float[Tensor, "n D"]
    slope: Float[Tensor, "n D 2"]
    reach: Float[Tensor, "n D q"]

    @classmethod
    def of_sequence(cls, impacts: Impacts, fit: Fit, options: FitOptions) -> "Scores":
        """Linearise a fitted model about its parameters, beside coefficients that depend on the state."""
        alike = torch.eye(impacts.space.D, dtype=torch.float64).expand(len(impacts), -1, -1)
        return cls._beside(impacts, fit, options, alike, _own_state(impacts))

    @classmethod
    def of_state(cls, impacts: Impacts, fit: Fit, options: FitOptions, block: int = 1) -> "Scores":
        """Linearise a fitted model about its parameters, beside slow drifts of the velocities and errors of v_pre.

        Where so many neighbouring trials, a `block`, resemble each other, there are fewer drifts, as of fewer trials.
        """
        most = min(_SLOW_COSINES, len(impacts) // (_TRIALS_A_CURVE * block))
        place = (impacts.order.argsort(stable=True).argsort() + 0.5) / len(impacts)
        slow = (math.pi * place[:, None] * torch.arange(most + 1)).cos()
        drifts = (torch.eye(impacts.space.D, dtype=torch.float64)[..., None] * slow[:, None, None]).flatten(2)
        other = torch.cat((drifts, attenuation_regressors(impacts, fit, options)), -1)
        return cls._beside(impacts, fit, options, other)

    @classmethod
    def _beside(
        cls,
        impacts: Impacts,
        fit: Fit,
        options: FitOptions,
        other: Float[Tensor, "n D k"],
        state: Float[Tensor, "n f"] | None = None,
    ) -> "Scores":
        """Project out the parameters, other whitened changes, and coefficients over variables of the trials' own."""
        rows, model = impacts.order.argsort(stable=True), fit.model
        about = linearise(model.law, model.effects, impacts, fit.values, fit.scatter, options=options)
        root = (about.weight * fit.inliers).sqrt()[rows]
        residual = root[:, None] * about.residual[rows].nan_to_num(0.0, 0.0, 0.0)
        slopes = -root[:, None, None] * about.slope[rows].nan_to_num(0.0, 0.0, 0.0)
        slopes = torch.where(slopes.abs() > _ROUNDING, slopes, 0.0)
        slope, beside = slopes[..., :2], [root[:, None, None] * other[rows].nan_to_num(0.0, 0.0, 0.0)]
        if state is not None:
            beside.append((slope[..., None] * state[rows][:, None, None]).flatten(2))
        flat = torch.cat((slopes, *beside), -1).flatten(0, 1)
        span, size, _ = torch.linalg.svd(flat / flat.norm(dim=0).clamp_min(1e-300), full_matrices=False)
        reach = span[:, size > 1e-6 * size.max()].unflatten(0, (len(rows), -1))  # an orthonormal basis
        span = reach.flatten(0, 1)
        return cls(rows, residual - (span @ (span.mT @ residual.flatten())).view_as(residual), slope, reach)

    def __len__(self) -> int:
        return len(self.rows)

    def flipped(self, signs: Float[Tensor, "flips n"]) -> Float[Tensor, "flips n 2"]:
        """Compute the scores [flips, n, 2] of residuals with other signs, projected again."""
        each = (self.slope * self.residual[..., None]).sum(1)
        along = signs @ (self.reach * self.residual[..., None]).sum(1)  # [flips, q]
        back = torch.einsum("ncp,ncq->qnp", self.slope, self.reach)
        return signs[..., None] * each - torch.einsum("fq,qnp->fnp", along, back)

    def terms(self, change: Float[Tensor, "n D"], functions: Float[Tensor, "n k"]) -> Float[Tensor, "n k"]:
        """Return residuals times a change that follows functions of the trials, without what is projected out."""
        products = (change * self.residual).sum(1, keepdim=True)
        back, there = ((self.reach * x[..., None]).sum(1) for x in (self.residual, change))
        return products * functions - back @ (there.mT @ functions)


def _own_state(impacts: Impacts) -> Float[Tensor, "n f"]:
    """Standardised variables of the trials' own state before impact; none of few trials."""
    if len(impacts) < _MANY:
        return torch.zeros(len(impacts), 0, dtype=torch.float64)
    state, bodies = State.of(impacts), numbered(impacts.object)
    if impacts.space is SPACE:
        parts = [values for name, values in of_state(state).items() if name not in ("order", *state.covariates)]
    else:
        circle = (f(k * state.theta) for f in (torch.sin, torch.cos) for k in (1, 2))
        parts = [state.v_n, state.v_t, state.v_t.abs(), state.omega, state.x, *circle]
    if 1 <= bodies.max() < _BODIES:
        parts += one_hot(bodies).to(torch.float64).unbind(-1)
    columns = torch.cat((torch.stack([*parts], -1), *impacts.covariate_columns.values()), -1)
    return (columns - columns.mean(0)) / columns.std(0).clamp_min(1e-12)


_NOTICEABLE = 1.0  # standard errors of a sum over all trials that dilution may amount to


def attenuation_regressors(impacts: Impacts, fit: Fit, options: FitOptions) -> Float[Tensor, "n D k"]:
    """Compute the whitened changes of v_post by errors of v_pre (regression dilution); none if their size is known.

    Components of v_pre count whose errors, if as large as the residual, could be seen over so many trials.
    """
    none = impacts.v_post.new_zeros(len(impacts), impacts.space.D, 0)
    if options.with_noise_of(impacts).noise is not None or options.target != "velocity":
        return none
    centred = impacts.v_pre - impacts.v_pre.mean(0)
    scatter = fit.scatter if impacts.outcome_cov is None else impacts.outcome_cov.mean(0)
    noticeable = len(impacts) * scatter.diagonal() > _NOTICEABLE**2 * centred.square().mean(0)
    if not noticeable.any():
        return none
    model, state = fit.model, State.of(impacts)

    def outcome(*v_pre: Tensor) -> Tensor:
        moved = state.replace(v_pre=torch.stack(v_pre, -1))
        return resolve(model.law, model.effects, moved, *model.law.coefficients).v_post

    _, slope = linearised(outcome, impacts.v_pre.unbind(-1))
    columns = (slope[:, :, noticeable, None] * (centred / centred.std(0).clamp_min(1e-300))[:, None, None]).flatten(2)
    columns = columns if impacts.whitening is None else impacts.whitening @ columns
    return torch.linalg.solve_triangular(torch.linalg.cholesky(fit.scatter), columns, upper=False)
