"""Per-trial parameters: the (μ_k, ε_k) with which a law comes closest to each single impact.

    minimise over (μ, ε) in the box:  ‖P_k − P̂_k(μ, ε)‖₂      for every trial k at once

For one trial P̂ is smooth within a contact mode and has kinks between modes, and where the trial sticks it does not
depend on μ at all.  A grid over the box therefore comes first, then Levenberg–Marquardt from eight starts a trial: the
best node, the node below it in μ, the best local minimum elsewhere in μ, no friction, sliding at the measured slope
|P_t|/P_n, two just below the μ at which reversed sliding turns into sticking, and one just below the μ above which the
trial sticks.  At a bound of one parameter the other is solved for.  After three rounds the starts that have converged
drop out, and so do the trials that are fitted exactly.  Where the best result is no stationary point, the optimum is
at a jump of P̂, found along the edge of sticking, or at a kink, found by a grid that moves and shrinks.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from contactlearn.inference.identification.result import Box, TrialFit
from contactlearn.laws import Law, named
from contactlearn.mechanics.impacts import Impacts, measured_impulse, require_impacts

_STEP = 1e-7  # finite difference of P̂ in μ and ε
_PROBES = 15  # of μ between one that fits and one that does not
_WIDEST = 0.1  # half-width of a grid in μ and ε


def fit_trials(
    impacts: Impacts,
    law: Law | str,
    *,
    target: str = "momentum",
    box: Box | None = None,
) -> TrialFit:
    """Identify (μ_k, ε_k) of every single trial, with its error and the interval of μ that fits equally well.

    The arguments are those of `shared.fit_subsets`; `box.nodes` is not used.
    """
    require_impacts(impacts)
    law, P = named(law), measured_impulse(impacts, target)
    # Component by component in memory: the laws then read them a quarter faster.
    W, v_c, P = (x.movedim(0, -1).contiguous().movedim(-1, 0) for x in (impacts.W, impacts.v_c, P))
    problem = _Problem(law, W, v_c, P, box or Box())
    zero = 1e-20 * _dot(problem.P.T, problem.P.T)
    *found, slack = _levenberg_marquardt(problem, *problem.starts(), rounds=3)
    pairs = ((slack > 1e-9 * found[0]) & (found[0].amin(0) > zero)).nonzero(as_tuple=True)
    going_on = _levenberg_marquardt(problem[pairs[1]], found[1][pairs], found[2][pairs], rounds=5)
    *best, slack = _lowest(*_written((*found, slack), pairs, going_on))
    rows = ((slack > 1e-9 * best[0]) & (best[0] > zero)).nonzero(as_tuple=True)
    best = _written(best, rows, _edge_of_sticking(problem[rows[0]], *(x[rows] for x in best)))
    rows = (rows[0][~_jumps(problem[rows[0]], *(x[rows] for x in best[1:]))],)
    cost, mu, eps = _written(best, rows, _shrinking_grid(problem[rows[0]], *(x[rows] for x in best)))
    return TrialFit(law, mu, eps, cost.sqrt(), *_mu_interval(problem, cost, mu, eps))


@dataclass(frozen=True)
class _Problem:
    """N independent problems in two parameters (μ, ε); costs are squared distances."""

    law: Law
    W: Tensor
    v_c: Tensor
    P: Tensor
    box: Box

    def __getitem__(self, rows: Tensor) -> "_Problem":
        return _Problem(self.law, self.W[rows], self.v_c[rows], self.P[rows], self.box)

    def impulse(self, mu: Tensor | float, eps: Tensor) -> tuple[Tensor, ...]:
        """P̂ by component, [..., N] each, the normal one last."""
        return self.law.at(mu, eps).impulse(self.W, self.v_c).unbind(-1)

    def residual(self, mu: Tensor, eps: Tensor) -> tuple[Tensor, ...]:
        """P̂ − P by component, [..., N] each."""
        return tuple(a - b for a, b in zip(self.impulse(mu, eps), self.P.unbind(-1), strict=True))

    def cost(self, mu: Tensor, eps: Tensor) -> Tensor:
        """‖P̂ − P‖² [..., N]."""
        return _dot(r := self.residual(mu, eps), r)

    def starts(self, nodes: int = 16) -> tuple[Tensor, Tensor]:
        """Eight starts a trial: μ and ε [8, N]."""
        (low, high), line = self.box.mu, torch.linspace(0, 1, nodes, dtype=torch.float64).to(self.P)
        mu = low + line**2 * (high - low)
        eps = torch.linspace(*self.box.eps, nodes, dtype=torch.float64).to(self.P)[:, None]
        # Few values of μ at a time, so that the temporaries stay in cache; the step that follows makes up for
        # the coarser grid of ε.
        blocks = [self.cost(block, eps[::3]).min(1).indices for block in mu[:, None, None].split(4)]
        profile, eps_best = _best_in_eps(self, mu[:, None], eps[3 * torch.cat(blocks), 0], steps=1)
        # On a plateau in μ (sticking) the start is its far end, where the cost depends on ε alone.
        plateau = profile <= profile.amin(0) * (1 + 1e-9) + 1e-12 * _dot(self.P.T, self.P.T)
        best = nodes - 1 - plateau.flip(0).int().argmax(0)
        below = (plateau.int().argmax(0) - 1).clamp_min(0)
        framed = torch.nn.functional.pad(profile, (0, 0, 1, 1), value=torch.inf)
        elsewhere = (profile < framed[:-2]) & (profile <= framed[2:]) & ~plateau
        second = torch.where(elsewhere, profile, torch.inf).argmin(0)
        at = torch.stack((best, below, second, torch.zeros_like(best)))
        # Just below the slope of the measurement and below the edges of sticking; friction acts on
        # all of P_n, or in some variants on that of compression.
        slope = 0.98 * _slope(*self.P.T).expand(nodes, -1)
        reversal = _slope(*self.W[:, :-1, -1].unbind(-1), self.W[:, 0, 0]).expand(nodes, -1)
        edge = 0.999 * _slope(*self.impulse(high, eps))
        rows = torch.stack((slope, slope * (1 + eps), 0.9 * reversal, 0.999 * reversal, edge)).clamp(low, high)
        cost, eps_row, mu_row = _lowest(self.cost(rows, eps).movedim(1, 0), eps[:, None], rows.movedim(1, 0))
        _, mu_slope, eps_slope = _lowest(cost[:2], mu_row[:2], eps_row[:2])
        return (
            torch.cat((mu[at], mu_slope[None], mu_row[2:])),
            torch.cat((eps_best.gather(0, at), eps_slope[None], eps_row[2:])),
        )


def _levenberg_marquardt(problem: _Problem, mu: Tensor, eps: Tensor, rounds: int) -> tuple[Tensor, ...]:
    """Return (cost, μ, ε, predicted decrease) from starts [..., N] within the box, with Marquardt's damping.

    Each round tries the full step, a shorter one, and the step in either parameter alone, solves for the other
    parameter where one meets its bound, and keeps the best.
    """
    box = problem.box
    damping = torch.full_like(mu, 1e-3)
    cost = problem.cost(mu, eps)
    better, promised = torch.zeros_like(mu, dtype=torch.bool), torch.zeros_like(mu)
    for _ in range(rounds):
        h_mu = torch.where(mu + _STEP > box.mu[1], -_STEP, _STEP)
        h_eps = torch.where(eps + _STEP > box.eps[1], -_STEP, _STEP)
        probes = problem.residual(torch.stack((mu, mu + h_mu, mu)), torch.stack((eps, eps, eps + h_eps)))
        r = [x[0] for x in probes]
        d_mu, d_eps = [(x[1] - x[0]) / h_mu for x in probes], [(x[2] - x[0]) / h_eps for x in probes]
        g_mu, g_eps, cross = _dot(d_mu, r), _dot(d_eps, r), _dot(d_mu, d_eps)
        a_mu = _dot(d_mu, d_mu) * (1 + damping) + 1e-300
        a_eps = _dot(d_eps, d_eps) * (1 + damping) + 1e-300
        det = a_mu * a_eps - cross**2
        regular = det > 1e-14 * a_mu * a_eps
        step = torch.where(regular, (cross * g_eps - a_eps * g_mu) / torch.where(regular, det, 1.0), 0.0)
        step = (mu + step).clamp(*box.mu) - mu
        steps = torch.stack((step, 0.3 * step))
        tried_mu = torch.cat((mu + steps, torch.stack((mu - g_mu / a_mu, mu)))).clamp(*box.mu)
        tried_eps = torch.cat((eps - (g_eps + cross * steps) / a_eps, torch.stack((eps, eps - g_eps / a_eps))))
        tried_eps = tried_eps.clamp(*box.eps)
        # The decrease predicted for each parameter alone within its bounds is 0 at a stationary point.
        promised = g_mu * (mu - tried_mu[2]) + g_eps * (eps - tried_eps[3])
        new = _lowest(problem.cost(tried_mu, tried_eps), tried_mu, tried_eps)
        better = new[0] < cost * (1 - 1e-9)
        cost, mu, eps = (torch.where(better, a, b) for a, b in zip(new, (cost, mu, eps), strict=True))
        damping = torch.where(better, 0.1 * damping, 10 * damping)
    return cost, mu, eps, torch.where(better, torch.inf, promised)


def _edge_of_sticking(problem: _Problem, cost: Tensor, mu: Tensor, eps: Tensor) -> tuple[Tensor, ...]:
    """Best (cost, μ, ε) [N] on the curve of the largest μ that still slides, where P̂ may jump."""
    low, high = problem.box.eps
    centre, half = torch.full_like(cost, 0.5 * (low + high)), 0.5 * (high - low)
    best, line = (cost, mu, eps), torch.linspace(-1, 1, 33, dtype=torch.float64).to(cost)[:, None]
    while half > 1e-9:
        eps = (centre + half * line).clamp(low, high)
        mu = ((1 - 1e-12) * _slope(*problem.impulse(problem.box.mu[1], eps))).clamp(*problem.box.mu)
        lowest = _lowest(problem.cost(mu, eps), mu, eps)
        best = _lower(lowest, best)
        centre, half = lowest[2], half * 0.1
    return best


def _jumps(problem: _Problem, mu: Tensor, eps: Tensor) -> Tensor:
    """Whether P̂ jumps just above μ [N]."""
    jump = [x[1] - x[0] for x in problem.impulse(torch.stack((mu, mu * (1 + 1e-9))), eps)]
    return _dot(jump, jump) > 1e-8 * _dot(problem.P.T, problem.P.T)


def _shrinking_grid(problem: _Problem, cost: Tensor, mu: Tensor, eps: Tensor) -> tuple[Tensor, ...]:
    """Best (cost, μ, ε) [N] of 9 × 9 grids about the best so far.

    Each is a quarter as wide as the last, but three times as wide where its best point is on the border, since a kink
    is a narrow, oblique valley.
    """
    offsets = torch.linspace(-1, 1, 9, dtype=torch.float64).to(mu)
    offset_mu, offset_eps = torch.cartesian_prod(offsets, offsets)[:, :, None].unbind(1)
    border = torch.maximum(offset_mu.abs(), offset_eps.abs())
    half = torch.full_like(cost, _WIDEST)
    for _ in range(100):
        if not bool((half > 1e-9).any()):
            break
        around_mu = (mu + half * offset_mu).clamp(*problem.box.mu)
        around_eps = (eps + half * offset_eps).clamp(*problem.box.eps)
        *found, out = _lowest(problem.cost(around_mu, around_eps), around_mu, around_eps, border)
        better = found[0] < cost
        cost, mu, eps = (torch.where(better, a, b) for a, b in zip(found, (cost, mu, eps), strict=True))
        half = torch.where(better & (out == 1), (3 * half).clamp_max(_WIDEST), 0.25 * half)
    return cost, mu, eps


def _mu_interval(problem: _Problem, cost: Tensor, mu: Tensor, eps: Tensor) -> tuple[Tensor, Tensor]:
    """Ends [N] of the interval of μ about the optimum on which ε alone keeps the error as small."""
    # An allowance on the square of the error, so that a smooth minimum above zero has no width either.
    limit = cost + 1e-14 * _dot(problem.P.T, problem.P.T)
    ends = mu.expand(2, -1).clone()  # as good as the optimum, towards the lower and the upper bound
    bounds = torch.tensor(problem.box.mu, dtype=torch.float64).to(mu)[:, None]
    # Most trials determine μ, which one probe on each side shows.
    probe = ends + (bounds - ends).clamp(-1e-5, 1e-5)
    open_ = (_best_in_eps(problem, probe, eps, steps=3)[0] <= limit) & (ends != bounds)
    side, rows = open_.nonzero(as_tuple=True)
    problem, limit, eps = problem[rows], limit[rows], eps[rows]
    good, bad = ends[open_], bounds[side, 0]
    fraction = torch.linspace(0, 1, _PROBES + 2, dtype=torch.float64).to(mu)[:, None]
    width = 1.0
    while width > 1e-7:
        mu = torch.lerp(good, bad, fraction)  # [_PROBES + 2, pairs], the first is good
        fits = (_best_in_eps(problem, mu, eps, steps=3)[0] <= limit).cumprod(0).sum(0).clamp_min(1)
        good = mu.gather(0, (fits - 1)[None])[0]
        bad = mu.gather(0, fits.clamp_max(_PROBES + 1)[None])[0]
        width /= _PROBES + 1
    ends[open_] = good
    return ends[0], ends[1]


def _best_in_eps(problem: _Problem, mu: Tensor, eps: Tensor, steps: int) -> tuple[Tensor, ...]:
    """Least (cost, ε) at fixed μ [..., N], from secant steps in ε, in which P̂ is nearly piecewise linear."""
    r = problem.residual(mu, eps)
    best = _dot(r, r), eps.expand_as(r[0])
    for _ in range(steps):
        h = torch.where(eps + _STEP > problem.box.eps[1], -_STEP, _STEP)
        d = [(b - a) / h for a, b in zip(r, problem.residual(mu, eps + h), strict=True)]
        eps = (eps - _dot(d, r) / (_dot(d, d) + 1e-300)).clamp(*problem.box.eps)
        r = problem.residual(mu, eps)
        best = _lower((_dot(r, r), eps), best)
    return best


def _dot(a: Sequence[Tensor] | Tensor, b: Sequence[Tensor] | Tensor) -> Tensor:
    """a·b of vectors by component."""
    total = a[0] * b[0]
    for one, other in zip(a[1:], b[1:], strict=True):
        total = total + one * other
    return total


def _slope(*components: Tensor) -> Tensor:
    """‖t‖ / n of components (t, n), very large where n is not positive."""
    *t, n = components
    return (t[0].abs() if len(t) == 1 else torch.hypot(*t)) / n.clamp_min(1e-300)


def _lowest(cost: Tensor, *values: Tensor) -> tuple[Tensor, ...]:
    """The least cost along the first axis, and the values that go with it."""
    cost, which = cost.min(0)
    return cost, *(x.expand(-1, *cost.shape).gather(0, which[None])[0] for x in values)


def _lower(a: Sequence[Tensor], b: Sequence[Tensor]) -> tuple[Tensor, ...]:
    """(cost, values) of `a` where its cost is the lower one, else of `b`."""
    return tuple(torch.where(a[0] < b[0], x, y) for x, y in zip(a, b, strict=True))


def _written(values: Sequence[Tensor], where: tuple[Tensor, ...], new: Sequence[Tensor]) -> list[Tensor]:
    """`values` with `new` in place at the indices `where`."""
    return [x.index_put(where, y) for x, y in zip(values, new, strict=True)]
