"""Many small minimisations in lock step: BFGS with bounds on B independent problems.

Every round evaluates each unfinished problem once, at its own trial point: one problem may be
halving a step while another goes on to its next direction.  In the first rounds the inverse Hessian
is that of the objective's own curvature, which halves the evaluations; then BFGS updates take over,
which converge where that is only near the Hessian.  A variable that sits on a bound and would leave
it is held there (Bertsekas 1982).  Problems leave the batch as they finish.
"""

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor

Objective = Callable[[Tensor, Tensor, bool], tuple[Tensor, Tensor, Tensor | None]]
"""Values [b], gradients [b, P] and, if asked for, curvatures [b, P, P] ≥ 0 at points [b, P] of the problems
`which` [b]; nan where it cannot be evaluated."""

_CURVED = 4  # rounds that use the objective's curvature
_DAMPING = 0.01  # added to it, so that what it says nothing about moves a finite way
_LONGEST = 2.0  # a step changes no variable by more: the variables are logarithms


class Minimum(NamedTuple):
    """Where each of B minimisations ended."""

    x: Tensor  # [B, P]
    value: Tensor  # [B]
    converged: Tensor  # [B] bool: what the next step promises to gain is below the tolerance
    evaluations: Tensor  # [B]
    history: Tensor  # [rounds, B], the value after each round


def minimise(
    objective: Objective, start: Tensor, low: Tensor, high: Tensor, *, tolerance: float, evaluations: int = 100
) -> Minimum:
    """Minimise B functions of P variables within [low, high] [P].

    Args:
        objective: see `Objective`.
        start: [B, P].
        low, high: bounds [P].
        tolerance: a problem ends where its next step promises to gain less.
        evaluations: a problem ends after so many, not converged.
    """
    x, damping = start.clamp(low, high), _DAMPING * torch.eye(start.shape[1]).to(start)
    which, step, count = torch.arange(len(x), device=x.device), torch.ones_like(x[:, 0]), 1
    f, g, curvature = objective(x, which, True)
    H = _inverse(curvature + damping)
    end = Minimum(x.clone(), f.clone(), *torch.zeros(2, len(x), dtype=torch.long, device=x.device), f)
    history = []
    while True:
        now = end.value.clone()
        now[which] = f
        history.append(now)
        free = ~(((x <= low) & (g > 0)) | ((x >= high) & (g < 0)))
        held = g * free
        p = -(H @ held[..., None])[..., 0] * free
        p = torch.where(((p * held).sum(-1) < 0)[:, None], p, -held)
        converged = (-0.5 * (p * held).sum(-1) < tolerance) & f.isfinite()
        done = converged | (step < 1e-4) | (count >= evaluations) | ~f.isfinite()
        if bool(done.any()):
            for target, source in zip(end[:4], (x, f, converged.long(), torch.full_like(which, count)), strict=True):
                target[which[done]] = source[done]
            which, x, f, g, H, p, step = (part[~done] for part in (which, x, f, g, H, p, step))
            if not len(which):
                return end._replace(converged=end.converged.bool(), history=torch.stack(history))
        p = p * (_LONGEST / p.abs().amax(-1, keepdim=True).clamp_min(_LONGEST))
        trial = (x + step[:, None] * p).clamp(low, high)
        s = trial - x
        slope = (s * g).sum(-1)
        f_new, g_new, curvature = objective(trial, which, count < _CURVED)
        count += 1
        accept = f_new <= f + 1e-4 * slope  # nan is refused
        # A refused step is cut to the minimum of the parabola through what is known along it.
        parabola = (-slope / (2 * (f_new - f - slope))).nan_to_num(0.1).clamp(0.1, 0.5)
        step = torch.where(accept, 1.0, step * parabola)
        H_new = _update(H, s, g_new - g) if curvature is None else _inverse(curvature + damping)
        H = torch.where(accept[:, None, None], H_new, H)
        x, g = (torch.where(accept[:, None], new, old) for new, old in ((trial, x), (g_new, g)))
        f = torch.where(accept, f_new, f)


def _inverse(curvature: Tensor) -> Tensor:
    return torch.linalg.inv_ex(curvature).inverse


def _update(H: Tensor, s: Tensor, y: Tensor) -> Tensor:
    """BFGS update of the inverse Hessian [b, P, P]; none where the curvature along s is not positive."""
    curvature = (s * y).sum(-1)
    good = curvature > 1e-10 * s.norm(dim=-1) * y.norm(dim=-1)
    rho = torch.where(good, 1 / curvature, 0.0)[:, None, None]
    Hy = H @ y[..., None]
    mixed = Hy * s[:, None]
    return H + rho * ((1 + rho * (y[:, None] @ Hy)) * s[..., None] * s[:, None] - mixed - mixed.mT)
