"""Per-trial parameters: the (μ_k, ε_k) with which a law comes closest to each single impact.

    minimise over (μ, ε) in the box:  ‖P_k − P̂_k(μ, ε)‖₂      for every trial k at once

For one trial P̂ is smooth within a contact mode and kinked between modes, and where the trial
sticks it does not depend on μ at all.  So the search is global first and exact afterwards: a grid
over the box, then a few rounds of Levenberg–Marquardt from seven starts a trial (the best node, the
node below it in μ, the best local minimum elsewhere in μ, sliding at the measured slope |P_t|/P_n, the
μ at which sticking gives way to reversed sliding, twice, and no friction), with bounds held by solving
for the free parameter on the edge.  Where the best end is no stationary point, the optimum is at a fold
or a jump of P̂: a search along the edge of sticking and a zooming grid finish.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from contactlearn.fit import Box, measured_impulse
from contactlearn.impacts import Impacts
from contactlearn.laws import impulse

_STEP = 1e-7  # finite difference of P̂ in μ and ε


@dataclass(frozen=True)
class TrialFit:
    """Per-trial optimum: μ, ε, error ‖P − P̂‖ (N s), and the range of μ that fits as well, each [N].

    Where `mu_high` exceeds `mu_low` the trial does not determine μ: it sticks from mu_low on.
    """

    law: str
    variant: str
    mu: Tensor
    eps: Tensor
    error: Tensor
    mu_low: Tensor
    mu_high: Tensor

    @property
    def flat(self) -> Tensor:
        """Whether μ is left undetermined [N]."""
        return self.mu_high - self.mu_low > 1e-6


def identify_trials(
    law: str,
    impacts: Impacts,
    *,
    variant: str = "textbook",
    target: str = "momentum",
    box: Box | None = None,
) -> TrialFit:
    """(μ_k, ε_k) of every trial, its error, and the interval of μ where the trial leaves it open.

    Arguments as in `fit.identify`; `box.nodes` is not used.
    """
    box = box or Box()
    problem = _Problem(law, variant, impacts.W, impacts.v_c, measured_impulse(impacts, target), box)
    scale = _square(*problem.P.unbind(-1))
    ends = _levenberg_marquardt(problem, *problem.starts(), rounds=3)
    pairs = ((ends[3] > 1e-9 * ends[0]) & (ends[0].amin(0) > 1e-20 * scale)).nonzero(as_tuple=True)
    _write(ends, pairs, _levenberg_marquardt(problem[pairs[1]], ends[1][pairs], ends[2][pairs], rounds=5))
    cost, mu, eps, slack = best = _lowest(*ends)
    rows = (slack > 1e-9 * cost) & (cost > 1e-20 * scale)
    _write(best, rows, _edge_of_sticking(problem[rows], cost[rows], mu[rows], eps[rows]))
    rows &= ~_jumps(problem, mu, eps)
    _write(best, rows, _zoom(problem[rows], cost[rows], mu[rows], eps[rows]))
    mu_low, mu_high = _mu_interval(problem, cost, mu, eps)
    return TrialFit(law, variant, mu, eps, cost.sqrt(), mu_low, mu_high)


@dataclass(frozen=True)
class _Problem:
    """N independent problems in two parameters (μ, ε); costs are squared distances."""

    law: str
    variant: str
    W: Tensor
    v_c: Tensor
    P: Tensor
    box: Box

    def __getitem__(self, rows: Tensor) -> "_Problem":
        return _Problem(self.law, self.variant, self.W[rows], self.v_c[rows], self.P[rows], self.box)

    def residual(self, mu: Tensor, eps: Tensor) -> tuple[Tensor, Tensor]:
        """P̂ − P by component, [..., N] each."""
        P_t, P_n = impulse(self.law, self.W, self.v_c, mu, eps, variant=self.variant).unbind(-1)
        return P_t - self.P[:, 0], P_n - self.P[:, 1]

    def cost(self, mu: Tensor, eps: Tensor) -> Tensor:
        """‖P̂ − P‖² [..., N]."""
        return _square(*self.residual(mu, eps))

    def starts(self, nodes: int = 16, eps_nodes: int = 16) -> tuple[Tensor, Tensor]:
        """Seven starts a trial: μ and ε [7, N]."""
        mu_low, mu_high = self.box.mu
        mu = mu_low + torch.linspace(0, 1, nodes, dtype=torch.float64) ** 2 * (mu_high - mu_low)
        eps = torch.linspace(*self.box.eps, eps_nodes, dtype=torch.float64)[:, None]
        r_t, r_n = self.residual(mu[:, None, None], eps)
        profile, which = _square(r_t, r_n).min(1)
        edge = 0.999 * (r_t[-1] + self.P[:, 0]).abs() / (r_n[-1] + self.P[:, 1]).clamp_min(1e-300)
        eps_best = eps[which, 0]
        # A plateau in μ (sticking) is entered from its far end, where ε alone moves along it.
        plateau = profile <= profile.amin(0) * (1 + 1e-9)
        best = nodes - 1 - plateau.flip(0).int().argmax(0)
        below = (plateau.int().argmax(0) - 1).clamp_min(0)
        framed = torch.nn.functional.pad(profile, (0, 0, 1, 1), value=torch.inf)
        elsewhere = (profile < framed[:-2]) & (profile <= framed[2:]) & ~plateau
        second = torch.where(elsewhere, profile, torch.inf).argmin(0)
        at_nodes = torch.stack((best, below, second, torch.zeros_like(best)))
        # Just below the slope of the measurement and below the μ at which sticking gives way to
        # reversed sliding; friction acts on all of P_n, or in some variants on that of compression.
        slope = 0.98 * (self.P[:, 0].abs() / self.P[:, 1].clamp_min(1e-300)).expand(eps_nodes, -1)
        reversal = (self.W[:, 0, 1] / self.W[:, 0, 0]).abs().expand(eps_nodes, -1)
        rows = torch.stack((slope, slope * (1 + eps), 0.9 * reversal, 0.999 * reversal, edge)).clamp(mu_low, mu_high)
        cost, which = self.cost(rows, eps).min(1)
        rows, eps_rows = rows.gather(1, which[:, None])[:, 0], eps[which, 0]
        _, *sliding = _lowest(cost[:2], rows[:2], eps_rows[:2])
        return tuple(
            torch.cat((nodes_of, one[None], two[2:]))
            for nodes_of, one, two in zip(
                (mu[at_nodes], eps_best.gather(0, at_nodes)), sliding, (rows, eps_rows), strict=True
            )
        )


def _levenberg_marquardt(problem: _Problem, mu: Tensor, eps: Tensor, rounds: int = 4):
    """(cost, μ, ε, promised decrease) [K, N] from starts [K, N], within the box; the damping is Marquardt's.

    Each round tries the full step, a shorter one, and the step in either parameter alone, all with the
    free parameter solved again where the other meets its bound, and keeps the best.
    """
    box = problem.box
    damping = torch.full_like(mu, 1e-3)
    cost = problem.cost(mu, eps)
    for _ in range(rounds):
        h_mu = torch.where(mu + _STEP > box.mu[1], -_STEP, _STEP)
        h_eps = torch.where(eps + _STEP > box.eps[1], -_STEP, _STEP)
        r_t, r_n = problem.residual(torch.stack((mu, mu + h_mu, mu)), torch.stack((eps, eps, eps + h_eps)))
        r = r_t[0], r_n[0]
        d_mu = (r_t[1] - r[0]) / h_mu, (r_n[1] - r[1]) / h_mu
        d_eps = (r_t[2] - r[0]) / h_eps, (r_n[2] - r[1]) / h_eps
        g_mu, g_eps, cross = _dot(d_mu, r), _dot(d_eps, r), _dot(d_mu, d_eps)
        a_mu = _square(*d_mu) * (1 + damping) + 1e-300
        a_eps = _square(*d_eps) * (1 + damping) + 1e-300
        det = a_mu * a_eps - cross**2
        regular = det > 1e-14 * a_mu * a_eps
        step = torch.where(regular, (cross * g_eps - a_eps * g_mu) / torch.where(regular, det, 1.0), 0.0)
        step = (mu + step).clamp(*box.mu) - mu
        tried_mu = torch.stack((mu + step, mu + 0.3 * step, mu - g_mu / a_mu, mu)).clamp(*box.mu)
        tried_eps = torch.stack((
            eps - (g_eps + cross * step) / a_eps,
            eps - (g_eps + cross * (0.3 * step)) / a_eps,
            eps,
            eps - g_eps / a_eps,
        )).clamp(*box.eps)
        # What either parameter alone promises within its bounds: nothing at a stationary point.
        promised = g_mu * (mu - tried_mu[2]) + g_eps * (eps - tried_eps[3])
        value, *at = _lowest(problem.cost(tried_mu, tried_eps), tried_mu, tried_eps)
        better = value < cost * (1 - 1e-9)
        cost, mu, eps = (torch.where(better, a, b) for a, b in zip((value, *at), (cost, mu, eps), strict=True))
        damping = torch.where(better, 0.1 * damping, 10 * damping)
    return cost, mu, eps, torch.where(better, torch.inf, promised)


def _zoom(problem: _Problem, cost: Tensor, mu: Tensor, eps: Tensor, half: float = 0.1, nodes: int = 21, shrink=0.3):
    """Best (cost, μ, ε) [N] of a grid about (μ, ε) that shrinks about its best node."""
    offsets = torch.linspace(-1, 1, nodes, dtype=torch.float64)
    offsets = torch.cartesian_prod(offsets, offsets)[..., None].unbind(1)
    while half > 1e-9:
        around = [(x + half * o).clamp(*b) for x, o, b in zip((mu, eps), offsets, (problem.box.mu, problem.box.eps), strict=True)]
        cost, mu, eps = _better((cost, mu, eps), _lowest(problem.cost(*around), *around))
        half *= shrink
    return cost, mu, eps


def _edge_of_sticking(problem: _Problem, cost: Tensor, mu: Tensor, eps: Tensor, nodes: int = 65):
    """Best (cost, μ, ε) [N] on the curve of the largest μ that still slides, where P̂ may jump."""
    low, high = problem.box.eps
    centre, half = torch.full_like(cost, 0.5 * (low + high)), 0.5 * (high - low)
    best = cost, mu, eps
    while half > 1e-9:
        eps = (centre + half * torch.linspace(-1, 1, nodes, dtype=torch.float64)[:, None]).clamp(low, high)
        r_t, r_n = problem.residual(torch.as_tensor(problem.box.mu[1], dtype=torch.float64), eps)
        P_t, P_n = r_t + problem.P[:, 0], r_n + problem.P[:, 1]
        mu = ((1 - 1e-12) * P_t.abs() / P_n.clamp_min(1e-300)).clamp(*problem.box.mu)
        found = _lowest(problem.cost(mu, eps), mu, eps)
        best = _better(best, found)
        centre, half = found[2], half * 0.1
    return best


def _jumps(problem: _Problem, mu: Tensor, eps: Tensor) -> Tensor:
    """Whether P̂ jumps just above (μ, ε) [N]: on the sliding side of such an edge nothing is left to search."""
    r_t, r_n = problem.residual(torch.stack((mu, mu * (1 + 1e-9))), eps)
    return _square(r_t[1] - r_t[0], r_n[1] - r_n[0]) > 1e-8 * _square(*problem.P.unbind(-1))


def _mu_interval(problem: _Problem, cost: Tensor, mu: Tensor, eps: Tensor, nodes: int = 15) -> tuple[Tensor, Tensor]:
    """Ends [N] of the interval of μ about the optimum on which ε alone keeps the error as small."""
    limit = cost + 1e-14 * _square(*problem.P.unbind(-1))  # in squares, so that a smooth minimum has no width
    ends = mu.expand(2, -1).clone()  # still as good: towards the lower and the upper bound
    bounds = torch.tensor(problem.box.mu, dtype=torch.float64)[:, None]
    # Most trials determine μ: one probe on each side tells.
    probe = ends + (bounds - ends).clamp(-1e-5, 1e-5)
    side, rows = ((_best_in_eps(problem, probe, eps) <= limit) & (ends != bounds)).nonzero(as_tuple=True)
    sub, limit, eps = problem[rows], limit[rows], eps[rows]
    good, bad = ends[side, rows], bounds[side, 0]
    fraction = torch.linspace(0, 1, nodes + 2, dtype=torch.float64)[:, None]
    width = 1.0
    while width > 1e-9 and len(rows):
        mu = good + fraction * (bad - good)  # [nodes + 2, pairs], the first is good
        fits = (_best_in_eps(sub, mu, eps) <= limit).cumprod(0).sum(0).clamp_min(1)
        good = mu.gather(0, (fits - 1)[None])[0]
        bad = mu.gather(0, fits.clamp_max(nodes + 1)[None])[0]
        width /= nodes + 1
    ends[side, rows] = good
    return ends[0], ends[1]


def _best_in_eps(problem: _Problem, mu: Tensor, eps: Tensor) -> Tensor:
    """Least cost at fixed μ [..., N], from two secant steps in ε (P̂ is piecewise linear in it)."""
    r = problem.residual(mu, eps)
    best = _square(*r)
    for _ in range(2):
        h = torch.where(eps + _STEP > problem.box.eps[1], -_STEP, _STEP)
        d = [(b - a) / h for a, b in zip(r, problem.residual(mu, eps + h), strict=True)]
        eps = (eps - _dot(d, r) / (_square(*d) + 1e-300)).clamp(*problem.box.eps)
        r = problem.residual(mu, eps)
        best = torch.minimum(best, _square(*r))
    return best


def _lowest(cost: Tensor, *values: Tensor) -> tuple[Tensor, ...]:
    """The least cost along the first axis, and the values that go with it."""
    cost, which = cost.min(0)
    return cost, *(value.expand(len(value), *cost.shape).gather(0, which[None])[0] for value in values)


def _write(into, where, values) -> None:
    for x, value in zip(into, values, strict=False):
        x[where] = value


def _better(old: tuple[Tensor, ...], new: tuple[Tensor, ...]) -> list[Tensor]:
    """(cost, μ, ε) of whichever has the smaller cost."""
    return [torch.where(new[0] < old[0], b, a) for a, b in zip(old, new, strict=True)]


def _dot(a: tuple[Tensor, Tensor], b: tuple[Tensor, Tensor]) -> Tensor:
    return a[0] * b[0] + a[1] * b[1]


def _square(t: Tensor, n: Tensor) -> Tensor:
    return t * t + n * n
