"""Noise before impact in a joint fit: orthogonal-distance regression, or functional maximum likelihood.

    v_pre = ξ + δ,  v_post = f(ξ, θ) + ε,      δ ~ N(0, s² Σ_b),  ε ~ N(0, s² Σ_a)

A fit that treats v_pre as exact underestimates how the outcome depends on it (regression dilution).  Here each trial
has a latent velocity ξ_k before impact, estimated in rounds.  With J = ∂f/∂v_pre at the ξ_k of the last round,

    e_k = v_post − f(ξ) − J (v_pre − ξ)        S_k = Σ_a + J Σ_b Jᵀ
    ξ_k ← v_pre + Σ_b Jᵀ S_k⁻¹ e_k

and the robust fit of v_post − J (v_pre − ξ) by f(ξ, θ), whitened by S_k, updates θ.  At convergence the gradient in θ
is that of Σ_k min over ξ of the weighted squared distance to both measurements.  That minimum is e_kᵀ S_k⁻¹ e_k, and
the robust weights are functions of it.  A step of ξ_k is shortened, or left out, where the full step would increase
this distance: J is discontinuous where a contact changes its mode, and full steps oscillate there.  J is a quotient of
differences, for a third of the time of D backward passes.  Where the contact scatters as well, S_k is
`Impacts.outcome_cov`, which holds all of it.

Sources: Boggs, Byrd & Schnabel 1987; Fuller 1987; Carroll et al. 2006.
"""

from dataclasses import replace
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.inference.identification import robust
from contactlearn.inference.identification.problem import JointProblem

_ROUNDS = 4
_SETTLED = 1e-3  # change of a parameter, of its range, at which it has converged; the next is at most a thirtieth of it
_DIFFERENCE_STEP = 1e-3  # of the noise before impact: J from the outcomes so far to either side has nine digits
_STEPS = (1.0, 0.5, 0.25, 0.0)  # lengths of a latent state's step that are tried; the best is taken


class Noise(NamedTuple):
    """Standard deviations [D] of v_pre, and of v_post; the latter None where the problem is whitened by S_k."""

    before: Float[Tensor, " D"]
    after: Float[Tensor, " D"] | None


def solve(
    observed: JointProblem,
    noise: Noise,
    starts: int,
    start: Tensor | None = None,
    tolerance: float = robust.TOLERANCE,
) -> tuple[JointProblem, tuple[Tensor, ...]]:
    """Return the problem about the latent states, and its solution as `robust.search` does.

    Args:
        observed: problem about the measured v_pre.
        noise: see `Noise`.
        starts: number of starts of the first search, which treats v_pre as exact.
        start: parameters [..., K] at which to begin in place of that search.
        tolerance: of the search.
    """
    if start is None:
        theta, _, _, _, agreement, _ = robust.search(observed, starts, None, tolerance)
    else:
        theta, agreement = start.expand(len(observed), -1).clamp(observed.low, observed.high), None
    problem, width, loss = observed, observed.high - observed.low, theta.new_full((len(observed),), torch.inf)
    for left in reversed(range(_ROUNDS)):
        problem = _corrected(observed, problem, noise, theta)
        last, before = theta, loss
        theta, scatter, residual, loss, alone, converged = robust.search(problem, 1, last, tolerance)
        settled = ((theta - last).abs() <= _SETTLED * width).all(-1) | ((loss - before).abs() < tolerance)
        if settled.all() or left == 0:
            agreement = alone if agreement is None else agreement
            return problem, (theta, scatter, residual, loss, agreement, converged & settled)
    raise AssertionError("unreachable: the last round returns")


def about_latent_states(observed: JointProblem, noise: Noise, theta: Tensor) -> JointProblem:
    """Return the problem about the latent states at parameters [B, K]; arguments as of `solve`."""
    problem = observed
    for _ in range(_ROUNDS):
        problem = _corrected(observed, problem, noise, theta)
    return problem


def _corrected(observed: JointProblem, problem: JointProblem, noise: Noise, theta: Tensor) -> JointProblem:
    """Return the problem about updated latent states, from those of the last problem, at parameters [B, K]."""
    before = torch.diag(noise.before.square())
    last, seen = problem.state.v_pre, observed.state.v_pre
    apart = (_DIFFERENCE_STEP * torch.diag(noise.before))[:, None, None]
    outcomes = observed.outcome(torch.cat((last[None], last + apart, last - apart)), theta[:, None])
    outcome, up, down = outcomes[0], *outcomes[1:].chunk(2)
    J = ((up - down) / (2 * apart.sum(-1, keepdim=True))).movedim(0, -1).nan_to_num(0.0, 0.0, 0.0)
    if (root := observed.whitening) is None:
        raise AssertionError("unreachable: where v_pre has noise, v_post has")
    white = root  # by the noise after impact alone, or by all
    if noise.after is not None:
        factor = torch.linalg.cholesky(torch.diag(noise.after.square()) + J @ before @ J.mT)
        white = torch.linalg.solve_triangular(factor, torch.eye(J.shape[-1]).to(J).expand_as(J), upper=False)
    residual = observed.measured - outcome - _times(J, seen - last)
    step = seen + _times(before @ J.mT @ white.mT, _times(white, residual)) - last
    tried = last + torch.tensor(_STEPS).to(step)[:, None, None, None] * step
    missed = _times(root, observed.measured - observed.outcome(tried, theta[:, None]))
    moved = ((tried - seen) / noise.before).nan_to_num(0.0)  # 0/0 where v_pre is exact
    away = (moved.square() + missed.square()).sum(-1, keepdim=True).nan_to_num(torch.inf)
    latent = tried.gather(0, away.argmin(0, keepdim=True).expand(1, *step.shape))[0]
    return replace(
        observed,
        state=observed.state.replace(v_pre=latent),
        measured=observed.measured + _times(J, latent - seen),
        whitening=white,
    )


def _times(A: Tensor, x: Tensor) -> Tensor:
    return (A @ x[..., None])[..., 0]
