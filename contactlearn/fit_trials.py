"""Per-trial parameters: the (μ_k, ε_k) with which a law comes closest to each single impact.

    minimise over (μ, ε) in the box:  ‖P_k − P̂_k(μ, ε)‖₂      for every trial k at once

For one trial P̂ is smooth within a contact mode and kinked between modes, and where the trial
sticks it does not depend on μ at all.  So the search is global first and exact afterwards: a grid
over the box, then Levenberg–Marquardt from seven starts a trial (the best node, the node below it in
μ, the best local minimum elsewhere in μ, sliding at the measured slope |P_t|/P_n, the μ at which
sticking gives way to reversed sliding, twice, and no friction), with bounds held by solving for the free
parameter on the edge.  Where the best end is no stationary point, at a fold or a jump of P̂, a zooming grid finishes.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from contactlearn.fit import Box, measured_impulse, pick
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
    x, cost, slack = _levenberg_marquardt(problem, problem.starts())
    cost, which = cost.min(0)
    x, slack = pick(x, which), slack.gather(0, which[None])[0]
    rows = (slack > 1e-9 * _dot(problem.P, problem.P)).nonzero()[:, 0]
    x[rows], cost[rows] = _edge_of_sticking(problem[rows], *_zoom(problem[rows], x[rows], cost[rows]))
    mu_low, mu_high = _mu_interval(problem, x, cost)
    return TrialFit(law, variant, x[:, 0], x[:, 1], cost.sqrt(), mu_low, mu_high)


@dataclass(frozen=True)
class _Problem:
    """N independent problems in two parameters x = (μ, ε); costs are squared distances."""

    law: str
    variant: str
    W: Tensor
    v_c: Tensor
    P: Tensor
    box: Box

    def __getitem__(self, rows: Tensor) -> "_Problem":
        return _Problem(self.law, self.variant, self.W[rows], self.v_c[rows], self.P[rows], self.box)

    def residual(self, mu: Tensor, eps: Tensor) -> Tensor:
        """P̂ − P [..., N, 2]."""
        return impulse(self.law, self.W, self.v_c, mu, eps, variant=self.variant) - self.P

    def cost(self, mu: Tensor, eps: Tensor) -> Tensor:
        """‖P̂ − P‖² [..., N]."""
        return _dot(r := self.residual(mu, eps), r)

    def clamp(self, x: Tensor) -> Tensor:
        return torch.minimum(torch.maximum(x, self.box.low), self.box.high)

    def starts(self, nodes: int = 16) -> Tensor:
        """Seven starts a trial: x [7, N, 2]."""
        (mu_low, mu_high), (eps_low, eps_high) = self.box.mu, self.box.eps
        mu = mu_low + torch.linspace(0, 1, nodes, dtype=torch.float64) ** 2 * (mu_high - mu_low)
        eps = torch.linspace(eps_low, eps_high, nodes, dtype=torch.float64)
        cost = self.cost(mu[:, None, None], eps[:, None])
        profile, eps_best = cost.min(1)
        lowest = profile.amin(0)
        # A plateau in μ (sticking) is entered from its far end, where ε alone moves along it.
        plateau = profile <= lowest * (1 + 1e-9)
        best = nodes - 1 - plateau.flip(0).int().argmax(0)
        below = (plateau.int().argmax(0) - 1).clamp_min(0)
        framed = torch.nn.functional.pad(profile, (0, 0, 1, 1), value=torch.inf)
        elsewhere = (profile < framed[:-2]) & (profile <= framed[2:]) & ~plateau
        second = torch.where(elsewhere, profile, torch.inf).argmin(0)
        at_nodes = [torch.stack((mu[k], eps[eps_best.gather(0, k[None])[0]]), -1) for k in (best, below, second)]
        # Just below the slope of the measurement and below the μ at which sticking gives way to
        # reversed sliding; friction acts on all of P_n, or in some variants on that of compression.
        slope = 0.98 * (self.P[:, 0].abs() / self.P[:, 1].clamp_min(1e-300)).expand(nodes, -1)
        reversal = (self.W[:, 0, 1] / self.W[:, 0, 0]).abs().expand(1, 1, -1)
        sliding = self._best_in_row(torch.stack((slope, slope * (1 + eps[:, None])), 0), eps)
        rows = (0.9 * reversal, 0.999 * reversal, torch.full_like(reversal, mu_low))
        return torch.stack((*at_nodes, sliding, *(self._best_in_row(row, eps) for row in rows)))

    def _best_in_row(self, mu: Tensor, eps: Tensor) -> Tensor:
        """Best x [N, 2] among rows μ [R, 1 or E, N] with the nodes ε [E]."""
        mu = mu.clamp(*self.box.mu).expand(-1, len(eps), -1)
        which = self.cost(mu, eps[:, None]).flatten(0, 1).argmin(0)
        return torch.stack((mu.flatten(0, 1).gather(0, which[None])[0], eps[which % len(eps)]), -1)


def _levenberg_marquardt(problem: _Problem, x: Tensor, rounds: int = 8) -> tuple[Tensor, Tensor, Tensor]:
    """(x, cost, promised decrease) from starts x [K, N, 2], within the box; the damping is Marquardt's.

    Each round tries the full step, a shorter one, and the step in either parameter alone, all with the
    free parameter solved again where the other meets its bound, and keeps the best.
    """
    high = problem.box.high
    damping = torch.full_like(x[..., 0], 1e-3)
    cost = problem.cost(*x.unbind(-1))
    for _ in range(rounds):
        h = torch.where(x + _STEP > high, -_STEP, _STEP)
        probes = torch.stack((x, x + h * torch.tensor((1.0, 0.0)), x + h * torch.tensor((0.0, 1.0))))
        r, r_mu, r_eps = problem.residual(*probes.unbind(-1))
        d_mu, d_eps = (r_mu - r) / h[..., :1], (r_eps - r) / h[..., 1:]
        g_mu, g_eps = _dot(d_mu, r), _dot(d_eps, r)
        a_mu = _dot(d_mu, d_mu) * (1 + damping) + 1e-300
        a_eps = _dot(d_eps, d_eps) * (1 + damping) + 1e-300
        cross = _dot(d_mu, d_eps)
        det = a_mu * a_eps - cross**2
        regular = det > 1e-14 * a_mu * a_eps
        step_mu = torch.where(regular, (cross * g_eps - a_eps * g_mu) / torch.where(regular, det, 1.0), 0.0)
        mu = problem.clamp(x + step_mu[..., None])[..., 0]
        eps = x[..., 1] - (g_eps + cross * (mu - x[..., 0])) / a_eps
        short = x[..., 0] + 0.3 * (mu - x[..., 0])
        tried = problem.clamp(
            torch.stack(
                (
                    torch.stack((mu, eps), -1),
                    torch.stack((short, x[..., 1] - (g_eps + cross * (short - x[..., 0])) / a_eps), -1),
                    torch.stack((x[..., 0] - g_mu / a_mu, x[..., 1]), -1),
                    torch.stack((x[..., 0], x[..., 1] - g_eps / a_eps), -1),
                )
            )
        )
        before = x
        value, which = problem.cost(*tried.unbind(-1)).min(0)
        better = value < cost * (1 - 1e-9)
        x = torch.where(better[..., None], pick(tried, which), x)
        cost = torch.where(better, value, cost)
        damping = torch.where(better, 0.1 * damping, 10 * damping)
    # What the linear model still promises at the bounds: nothing at a stationary point.
    promised = -(g_mu * (tried[0, ..., 0] - before[..., 0]) + g_eps * (tried[0, ..., 1] - before[..., 1]))
    return x, cost, torch.where(better, torch.inf, promised.clamp_min(0))


def _zoom(problem: _Problem, x: Tensor, cost: Tensor, half: float = 0.1, nodes: int = 21) -> tuple[Tensor, Tensor]:
    """Best (x [N, 2], cost [N]) of a grid about x that shrinks about its best node."""
    offsets = torch.linspace(-1, 1, nodes, dtype=torch.float64)
    offsets = torch.cartesian_prod(offsets, offsets)[:, None]
    while half > 1e-9:
        around = problem.clamp(x + half * offsets)
        value, which = problem.cost(*around.unbind(-1)).min(0)
        x = torch.where((value < cost)[:, None], pick(around, which), x)
        cost = torch.minimum(value, cost)
        half *= 0.3
    return x, cost


def _edge_of_sticking(problem: _Problem, x: Tensor, cost: Tensor, nodes: int = 65) -> tuple[Tensor, Tensor]:
    """Best (x [N, 2], cost [N]) on the curve of the largest μ that still slides, where P̂ may jump."""
    low, high = problem.box.eps
    centre, half = torch.full_like(cost, 0.5 * (low + high)), 0.5 * (high - low)
    while half > 1e-9:
        eps = (centre + half * torch.linspace(-1, 1, nodes, dtype=torch.float64)[:, None]).clamp(low, high)
        P_t, P_n = (problem.residual(problem.box.high[0], eps) + problem.P).unbind(-1)
        mu = ((1 - 1e-12) * P_t.abs() / P_n.clamp_min(1e-300)).clamp(*problem.box.mu)
        value, which = problem.cost(mu, eps).min(0)
        found = pick(torch.stack((mu, eps), -1), which)
        x, cost = torch.where((value < cost)[:, None], found, x), torch.minimum(value, cost)
        centre, half = found[:, 1], half * 0.1
    return x, cost


def _dot(a: Tensor, b: Tensor) -> Tensor:
    """a·b over a last axis of 2; several times faster than a reduction over so short an axis."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1]


def _mu_interval(problem: _Problem, x: Tensor, cost: Tensor, nodes: int = 15) -> tuple[Tensor, Tensor]:
    """Ends [N] of the interval of μ about the optimum on which ε alone keeps the error as small."""
    limit = cost.sqrt() + 1e-9 * problem.P.norm(dim=-1)
    ends = x[:, 0].expand(2, -1).clone()  # still as good: towards the lower and the upper bound
    bounds = torch.tensor(problem.box.mu)[:, None]
    # Most trials determine μ: one probe on each side tells.
    probe = ends + (bounds - ends).clamp(-1e-5, 1e-5)
    rows = (_best_in_eps(problem, probe, x[:, 1]) <= limit).any(0).nonzero()[:, 0]
    sub, limit, eps = problem[rows], limit[rows], x[rows, 1]
    good, bad = ends[:, rows], bounds.expand(-1, len(rows))
    fraction = torch.linspace(0, 1, nodes + 2, dtype=torch.float64)[:, None, None]
    width = 1.0
    while width > 1e-9:
        mu = good + fraction * (bad - good)  # [nodes + 2, 2, rows], the first is good
        fits = (_best_in_eps(sub, mu, eps) <= limit).cumprod(0).sum(0).clamp_min(1)
        good = mu.gather(0, (fits - 1)[None])[0]
        bad = mu.gather(0, fits.clamp_max(nodes + 1)[None])[0]
        width /= nodes + 1
    ends[:, rows] = good
    return torch.minimum(ends[0], x[:, 0]), torch.maximum(ends[1], x[:, 0])


def _best_in_eps(problem: _Problem, mu: Tensor, eps: Tensor) -> Tensor:
    """Least error ‖P − P̂‖ at fixed μ [..., N], from two secant steps in ε (P̂ is piecewise linear in it)."""
    eps = eps.expand_as(mu)
    best = problem.cost(mu, eps).sqrt()
    for _ in range(2):
        h = torch.where(eps + _STEP > problem.box.eps[1], -_STEP, _STEP)
        r, r_eps = problem.residual(mu, torch.stack((eps, eps + h)))
        d = (r_eps - r) / h[..., None]
        eps = (eps - _dot(d, r) / (_dot(d, d) + 1e-300)).clamp(*problem.box.eps)
        best = torch.minimum(best, problem.cost(mu, eps).sqrt())
    return best
