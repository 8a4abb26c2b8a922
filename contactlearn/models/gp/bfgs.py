"""Many small minimisations in lock step: BFGS with bounds on B independent problems.

Every round evaluates each unfinished problem once, at its own trial point: one problem may be
halving a step while another goes on to its next direction.  In the first rounds the Hessian is the
objective's own curvature, which halves the evaluations; then BFGS updates take over, which converge
where that is only near the Hessian.  A variable that sits on a bound and would leave it is held there
(Bertsekas 1982).  Problems leave the batch as they finish.
"""

from collections.abc import Callable
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

Objective = Callable[[Tensor, Tensor, bool], tuple[Tensor, Tensor, Tensor | None]]
"""Values [b], gradients [b, P] and, if asked for, curvatures [b, P, P] ≥ 0 at points [b, P] of the problems
`which` [b]; nan where it cannot be evaluated."""

_CURVED = 4  # rounds that use the objective's curvature
_DAMPING = 0.01  # added to it, so that a direction without curvature moves a finite way
_PATIENCE = 5  # evaluations after which a start may give up
_LONGEST = 2.0  # a step changes no variable by more: the variables are logarithms


class Minimum(NamedTuple):
    """End of each of B minimisations."""

    x: Float[Tensor, "b p"]
    value: Float[Tensor, "b"]
    converged: Bool[Tensor, "b"]  # the next step promises to gain less than the tolerance
    evaluations: Int[Tensor, "b"]
    history: Float[Tensor, "rounds b"]  # the value after each round


def minimise(
    objective: Objective,
    start: Float[Tensor, "b p"],
    low: Float[Tensor, "p"],
    high: Float[Tensor, "p"],
    *,
    tolerance: float,
    evaluations: int = 100,
    starts: int = 1,
    on_round: Callable[[Minimum], None] | None = None,
) -> Minimum:
    """Minimise B functions of P variables within [low, high].

    Args:
        objective: see `Objective`.
        start: where each problem begins.
        low, high: bounds of the variables.
        tolerance: a problem ends where its next step promises to gain less.
        evaluations: a problem ends after so many, not converged.
        starts: how often the batch repeats its problems; a start that cannot overtake another one gives up.
        on_round: receives the state of all problems after each round.
    """
    x, damping = start.clamp(low, high), _DAMPING * torch.eye(start.shape[1]).to(start)
    which, step, count = torch.arange(len(x), device=x.device), torch.ones_like(x[:, 0]), 1
    f, g, curvature = objective(x, which, True)
    hessian = damping if curvature is None else curvature + damping
    end, history = Minimum(x.clone(), f.clone(), torch.zeros_like(which).bool(), torch.zeros_like(which), f), []
    while True:
        end.x[which], end.value[which] = x, f
        history.append(end.value.clone())
        if on_round is not None:
            on_round(end._replace(value=history[-1], history=torch.stack(history)))
        p, steepest = _directions(hessian, g, x <= low, x >= high)
        promise = -0.5 * (p * g).sum(-1)
        converged = (promise < tolerance) & f.isfinite()
        ahead = end.value.nan_to_num(torch.inf).view(starts, -1).amin(0).repeat(starts)[which]
        trails = (f - 2 * promise > ahead) & (count >= _PATIENCE)
        done = converged | trails | (step < 1e-4) | (count >= evaluations) | ~f.isfinite()
        if bool(done.any()):
            end.converged[which[done]], end.evaluations[which[done]] = converged[done], count
            kept = (part[~done] for part in (which, x, f, g, hessian, p, steepest, step))
            which, x, f, g, hessian, p, steepest, step = kept
            if not len(which):
                return end._replace(history=torch.stack(history))
        trial = (x + step[:, None] * _shortened(p)).clamp(low, high)
        # A bound that is met on the way may turn the rest of the step uphill.
        uphill = ((trial - x) * g).sum(-1, keepdim=True) >= 0
        trial = torch.where(uphill, x + step[:, None] * _shortened(steepest), trial).clamp(low, high)
        s = trial - x
        slope = (s * g).sum(-1)
        f_new, g_new, curvature = objective(trial, which, count < _CURVED)
        count += 1
        accept = f_new <= f + 1e-4 * slope  # nan is refused
        # A refused step is cut to the minimum of the parabola through what is known along it.
        parabola = (-slope / (2 * (f_new - f - slope))).nan_to_num(0.1).clamp(0.1, 0.5)
        step = torch.where(accept, 1.0, step * parabola)
        new = _update(hessian, s, g_new - g) if curvature is None else curvature + damping
        hessian = torch.where(accept[:, None, None], new, hessian)
        x, g = (torch.where(accept[:, None], new, old) for new, old in ((trial, x), (g_new, g)))
        f = torch.where(accept, f_new, f)


def _directions(hessian: Tensor, g: Tensor, at_low: Tensor, at_high: Tensor) -> tuple[Tensor, Tensor]:
    """Newton's step and steepest descent [b, P] in the variables that leave no bound they sit on."""
    free = ~((at_low & (g > 0)) | (at_high & (g < 0)))
    p = steepest = -g * free
    one = torch.eye(g.shape[1]).to(g)
    for _ in range(2):  # the second time without those that the others would push over their bound
        both = free[:, None] & free[..., None]
        p = torch.linalg.solve_ex(torch.where(both, hessian, one), -g * free).result
        free = free & ~((at_low & (p < 0)) | (at_high & (p > 0)))
    p = p * free
    return torch.where(((p * g).sum(-1) < 0)[:, None], p, steepest), steepest


def _shortened(p: Tensor) -> Tensor:
    return p * (_LONGEST / p.abs().amax(-1, keepdim=True).clamp_min(_LONGEST))


def _update(hessian: Tensor, s: Tensor, y: Tensor) -> Tensor:
    """BFGS update of the Hessian [b, P, P]; none where the curvature along s is not positive."""
    curvature, Hs = (s * y).sum(-1), (hessian @ s[..., None])[..., 0]
    good = curvature > 1e-10 * s.norm(dim=-1) * y.norm(dim=-1)
    gained = y[..., None] * y[:, None] / curvature[:, None, None]
    lost = Hs[..., None] * Hs[:, None] / (s * Hs).sum(-1)[:, None, None]
    return torch.where(good[:, None, None], hessian + gained - lost, hessian)
