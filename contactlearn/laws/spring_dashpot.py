"""Routh's path until a spring with a dashpot no longer pushes (Tsuji, Tanaka & Ishida 1992).

    f = k δᵖ + c δ^((p − 1)/2) dδ/dt ≥ 0

With y ∝ δ^((p + 1)/2) and the clock dσ ∝ δ^((p − 1)/2) dt this is a linear spring, p = 1, so neither p nor k changes
the impulse (Antypov & Elliott 2011).  On a straight piece of the path, along which W_nn q is dv_n/dP_n,

    u′ = −q f,   f′ = u − 2ζ q f,   from f = 2ζ u at u = −v_n until f = 0.

A frictionless contact has the restitution ε = exp(−2β/tan β), ζ = cos β.  Friction makes a contact softer or stiffer
against its dashpot, so the rebound is not Newton's, Poisson's or Stronge's.  MuJoCo's soft contacts are of this kind.
"""

import math
from itertools import pairwise
from typing import NamedTuple

import torch
from torch import Tensor

from contactlearn.laws.base import Law
from contactlearn.laws.contact import Contact, Impulse, SpatialContact, Values
from contactlearn.laws.hodograph import Hodograph, Slide, after_work, until
from contactlearn.laws.wang_mason import routh_path

LEAST = 0.05
"""ε below which the dashpot is nearly rigid, and stays as it is here."""
_LEAST_STEP = 1e-12  # of the impulse of an elastic contact: a shorter step is none
_FLAT = 1e-8  # q: its impulse is a small difference below it
_SMALL = 1e-2  # squares of angles below which the series are exact to ten digits
_SHORT_STEPS = 4  # of a short piece, from its Taylor series: the worst contacts are at 1e-9
_STEPS = 6  # of Newton's method: of 10⁵ random contacts 99.99 % are at rounding error and the worst at 1e-8


class SpringDashpot(Law):
    """Routh's path with the restitution of a spring and a dashpot, which fixes ε without friction; it adds no energy.

    The body does not turn while the contact lasts.
    """

    label = "Spring–dashpot"
    citations = ("tsuji1992", "antypov2011")
    refines = True

    def solve(self, contact: Contact, mu: Values, eps: Values) -> tuple[Values, Values]:
        """Return (P_t, P_n) in N s; see the module."""
        path, zeta, u = routh_path(contact, mu), damping(eps).ratio, -contact.v_n
        q, q_after = path.stiffness / contact.w_nn, path.stiffness_after / contact.w_nn
        share = (eps / LEAST).clamp_max(1)  # of the rebound; nothing rebounds for ε = 0
        whole = Oscillator(torch.where(q > 0, q, 1.0), zeta, 2 * zeta * u, u)
        ends = (q <= 0) | (path.v_slip < u - share * whole.released)
        p_slip = torch.where(ends, path.p_slip, 0.0)
        slides = whole._replace(q=torch.where(ends, torch.where(q.abs() < _FLAT, _FLAT, q), 1.0))
        force = torch.where(ends, slides.force_at(torch.where(ends, contact.w_nn * p_slip, 0.5 * u)), whole.f)
        rest = Oscillator(q_after, zeta, force, u - path.stiffness * p_slip)
        p_slides = (u - share * whole.released) / torch.where(ends, 1.0, path.stiffness)
        p_ends = p_slip + (rest.u - share * rest.released) / path.stiffness_after
        return path.impulse(torch.where(ends, p_ends, p_slides))

    def solve_in_space(self, contact: SpatialContact, mu: Values, eps: Values) -> Impulse:
        """Return (P_1, P_2, P_n) in N s: each step of the hodograph is a straight piece.

        The force vanishes before the work of the normal impulse is given back, where an elastic phase ends.
        """
        path, zeta, w_nn = Hodograph(contact, mu), damping(eps).ratio, contact.w_nn
        share, none = (eps / LEAST).clamp_max(1), torch.zeros_like(path.q_1)
        squeezed = list(path.points(path.start(), until(none)))
        released = list(path.points(squeezed[-1], after_work(none)))
        force, P_n = -2 * zeta * squeezed[0].v_n, released[-1].P_n
        for first, last in pairwise(squeezed):
            moves = last.P_n - first.P_n > _LEAST_STEP * P_n
            force = _piece(first, last, force, zeta, w_nn, moves).passed(moves, w_nn * (last.P_n - first.P_n), force)
        (P_1, P_2, P_n), pushes = squeezed[-1].impulse, P_n > 0
        for first, last in pairwise(released):
            step = last.P_n - first.P_n
            moves = pushes & (step > _LEAST_STEP * P_n)
            spring = _piece(first, last, force, zeta, w_nn, moves)
            ends = moves & (-last.v_n < share * spring.released)
            whole = (spring.u - share * spring.released) / (spring.q * w_nn * torch.where(moves, step, 1.0))
            taken = torch.where(ends, whole, pushes.to(step))
            P_1 = torch.addcmul(P_1, taken, last.P_1 - first.P_1)
            P_2 = torch.addcmul(P_2, taken, last.P_2 - first.P_2)
            P_n = torch.addcmul(P_n, taken, step)
            force, pushes = spring.passed(moves & ~ends, w_nn * step, force), pushes & ~ends
        return P_1, P_2, P_n


def _piece(first: Slide, last: Slide, force: Tensor, zeta: Tensor, w_nn: Tensor, moves: Tensor) -> "Oscillator":
    """Oscillator at the first point of a straight piece of the path, and any where that does not move."""
    q = torch.where(moves, (last.v_n - first.v_n) / torch.where(moves, w_nn * (last.P_n - first.P_n), 1.0), 1.0)
    q = torch.where(q.abs() < _FLAT, _FLAT, q)
    return Oscillator(q, zeta, torch.where(moves, force, 2.0), torch.where(moves, -first.v_n, 0.0))


class Damping(NamedTuple):
    """Damping of a frictionless contact."""

    ratio: Tensor  # ζ = c / (2 √(k m))
    duration: Tensor  # until the force vanishes, in units of √(m/k); π without damping


def damping(eps: Tensor) -> Damping:
    """Return the damping that gives a restitution ε = exp(−2β/tan β), ζ = cos β, β imaginary for ζ > 1."""
    goal = -0.5 * eps.clamp_min(LEAST).log()
    with torch.no_grad():
        left = 1 - goal  # 1 for an elastic contact, 0 for ζ = 1
        s = torch.where(left > 0, left * (3 + left * (0.25 * math.pi**2 - 3)), left * (2 + goal))
        for _ in range(_STEPS):
            s = s - (_cotangent(s) - goal) / _cotangent_slope(s)
    s = s - (_cotangent(s) - goal) / _cotangent_slope(s)
    cosine, sine = _waves(-s)
    return Damping(cosine, 2 / sine)


class Oscillator(NamedTuple):
    """u′ = −q f, f′ = u − 2ζ q f from (f, u): the approach speed u in m/s and the force f in units of 1/W_nn."""

    q: Tensor
    zeta: Tensor
    f: Tensor
    u: Tensor

    @property
    def decay(self) -> Tensor:
        """Rate λ of its decay."""
        return self.zeta * self.q

    @property
    def growth(self) -> Tensor:
        """Square of the rate at which its two modes part; negative if it swings."""
        return self.decay**2 - self.q

    @property
    def end(self) -> Tensor:
        """Clock at which the force vanishes, for q > 0."""
        return _angle(self.f, self.decay * self.f - self.u, self.growth)

    @property
    def released(self) -> Tensor:
        """u < 0 where the force vanishes; q f² − 2λ f u + u² falls as exp(−2λσ)."""
        form = self.q * self.f**2 - 2 * self.decay * self.f * self.u + self.u**2
        return -(-self.decay * self.end).exp() * form.sqrt()

    def at(self, clock: Tensor) -> tuple[Tensor, Tensor]:
        """Return f and u at a clock."""
        cosine, sine = _waves(self.growth * clock**2)
        fade, sine = (-self.decay * clock).exp(), clock * sine
        f = self.f * cosine + (self.u - self.decay * self.f) * sine
        return fade * f, fade * (self.u * cosine + (self.decay * self.u - self.q * self.f) * sine)

    def force_at(self, impulse: Tensor) -> Tensor:
        """Return f where its integral is an impulse (m/s) that is reached before it vanishes."""
        rise = (self.u - 2 * self.decay * self.f).clamp_min(0)
        goal, swings = self.u - self.q * impulse, self.q > 0
        with torch.no_grad():
            early = 2 * impulse / (self.f + (self.f**2 + 2 * rise * impulse).sqrt()).clamp_min(1e-300)
            bound = self._replace(q=torch.where(swings, self.q, 1.0))
            top = _angle(rise, bound.q * self.f + bound.decay * rise, bound.growth)
            late = (2 * (bound.released - goal).abs() / (-bound.q * bound.released)).sqrt()
            late = torch.maximum(bound.end - late, top)
            clock = torch.where(swings, torch.where(bound.at(top)[1] < goal, torch.minimum(early, top), late), early)
            for _ in range(_STEPS):
                clock = clock + self._short(clock, goal)
        return self.at(clock + self._short(clock, goal))[0]

    def passed(self, goes: Tensor, impulse: Tensor, force: Tensor) -> Tensor:
        """Return f after an impulse (m/s) of a short piece on which it does not vanish, where it goes; else a force."""
        impulse = torch.where(goes, impulse, 0.0)
        goal = self.u - self.q * impulse
        with torch.no_grad():
            rise = self.u - 2 * self.decay * self.f
            clock = 2 * impulse / (self.f + (self.f**2 + 2 * rise * impulse).clamp_min(0).sqrt()).clamp_min(1e-300)
            for _ in range(_SHORT_STEPS):
                clock = clock + self._short(clock, goal)
        return torch.where(goes, self.at(clock + self._short(clock, goal))[0], force)

    def _short(self, clock: Tensor, goal: Tensor) -> Tensor:
        """Newton's step towards the clock at which u is a goal."""
        f, u = self.at(clock)
        return (u - goal) / torch.where(f > 0, self.q * f, 1.0).detach()


def _angle(a: Tensor, b: Tensor, growth: Tensor) -> Tensor:
    """Return the least t > 0 with tan(ν t) = ν a/b, ν² = −growth, of the sign of a ≥ 0: arctan, artanh, or between."""
    root = torch.where(growth.abs() > 0, growth.abs(), 1.0).sqrt()
    ratio = a / torch.where(b > 0, b, 1.0)
    z = growth * ratio**2
    near = (b > 0) & (z.abs() < _SMALL)
    series = 1 + z * (1 / 3 + z * (1 / 5 + z * (1 / 7 + z * (1 / 9 + z / 11))))
    swings = (math.pi - torch.atan2(a * root, -torch.where(near, 1.0, b))) / root
    creeps = torch.where(near | (growth <= 0), 0.5, ratio * root).clamp_max(1 - 1e-15).atanh() / root
    return torch.where(near, ratio * torch.where(near, series, 1.0), torch.where(growth > 0, creeps, swings))


def _waves(z: Tensor) -> tuple[Tensor, Tensor]:
    """Return cosh √z and sinh(√z)/√z, for z < 0 cos √−z and sin(√−z)/√−z."""
    near, grows = z.abs() < _SMALL, z > 0
    root = torch.where(near, 1.0, z.abs()).sqrt()
    cosine, sine = root.cos(), root.sin()
    if grows.any():
        up = torch.where(grows, root, 0.0)
        cosine, sine = torch.where(grows, up.cosh(), cosine), torch.where(grows, up.sinh(), sine)
    small = torch.where(near, z, 0.0)
    near_cosine = 1 + small / 2 * (1 + small / 12 * (1 + small / 30 * (1 + small / 56)))
    near_sine = 1 + small / 6 * (1 + small / 20 * (1 + small / 42 * (1 + small / 72)))
    return torch.where(near, near_cosine, cosine), torch.where(near, near_sine, sine / root)


def _cotangent(s: Tensor) -> Tensor:
    """Return √s cot √s, for s < 0 √−s coth √−s."""
    cosine, sine = _waves(-s)
    return cosine / sine


def _cotangent_slope(s: Tensor) -> Tensor:
    """Return the derivative of `_cotangent`."""
    near, c = s.abs() < _SMALL, _cotangent(s)
    series = -1 / 3 - s * (2 / 45 + s * (2 / 315 + s * 4 / 4725))
    return torch.where(near, series, (c - s - c**2) / torch.where(near, 1.0, 2 * s))
