"""Routh's path in space: the hodograph of the slip, followed in the normal impulse p = P_n.

    dP_t/dp = −μ v_t/|v_t|,   dv_c/dp = W (−μ v_t/|v_t|, 1)

While the contact slides the slip turns, so the path is a curve.  Where the slip ends, at a singular point of the
equation, the contact sticks if the cone allows, dP_t/dp = −W_tt⁻¹ W_tn, and otherwise slides on in the one direction
that does not turn; the rest of the path is straight.  A phase (compression, restitution) takes a fixed number of
midpoint steps, implicit in the slip, to the nearer of its two ends.  Steps shrink towards the end of the slip, and are
exact in v_n and its work.  The order is two where the slip lasts.  Restitution is followed once, up to an elastic one,
and ends within one of its steps: all ε of a grid share the path.

The steps are the cost of a law in space.  They have neither choices nor square roots but of reciprocals, which take
PyTorch three to ten times as long as a product.

Sources: Keller 1986; Batlle 1996; Bhatt & Koechling 1995; Stronge 2000.
"""

from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from itertools import pairwise
from typing import NamedTuple

import torch
from torch import Tensor

from contactlearn.laws.contact import Impulse, Pair, SpatialContact, dot, opposing

STEPS = 5
"""Midpoint steps of a phase."""
_steps = ContextVar("steps", default=STEPS)
_LEAST, _MOST = 1e-100, 1e40  # N s: a shorter step is none, and a longer one has no end
_NONE = 1e-200  # (m/s)²: a slip is none below it
_FLAT = 0.3  # of W_nn: a slower rise of v_n shortens steps no further, but for the last
_WHOLE = 1 + 1e-14  # of a step, with its rounding
_LEFT = 0.06  # of the square of the slip, in the middle of a step at least, for a first guess


class Slide(NamedTuple):
    """A point of the path: velocities (m/s) and impulses (N s) along the first slip, across it and along the normal."""

    v_1: Tensor
    v_2: Tensor
    v_n: Tensor
    P_1: Tensor
    P_2: Tensor
    P_n: Tensor
    work: Tensor  # ∫ v_n dP_n, J
    ended: Tensor  # whether the first slip has ended

    @property
    def slip(self) -> Pair:
        """v_t in m/s."""
        return self.v_1, self.v_2

    @property
    def impulse(self) -> Impulse:
        """The impulse so far."""
        return self.P_1, self.P_2, self.P_n

    def moved(self, step: Tensor, rates: Impulse, friction: Pair) -> "Slide":
        """Return the point after a straight step of P_n with dv_c/dP_n and −dP_t/dP_n."""
        v_n = torch.addcmul(self.v_n, step, rates[2])
        return Slide(
            torch.addcmul(self.v_1, step, rates[0]),
            torch.addcmul(self.v_2, step, rates[1]),
            v_n,
            torch.addcmul(self.P_1, step, friction[0], value=-1),
            torch.addcmul(self.P_2, step, friction[1], value=-1),
            self.P_n + step,
            torch.addcmul(self.work, step, self.v_n + v_n, value=0.5),
            self.ended,
        )


@contextmanager
def followed_in(steps: int) -> Generator[None]:
    """Follow every path in this number of steps; the error falls with its square where the slip lasts."""
    before = _steps.set(steps)
    try:
        yield
    finally:
        _steps.reset(before)


Left = Callable[[Slide, Tensor], Tensor]
"""Normal impulse until a phase ends from a point of the path, if v_n rises at a rate (1/kg) > 0 per impulse."""


def until(rise: Tensor) -> Left:
    """Phase that ends where v_n is `rise` (m/s)."""
    return lambda at, rate: (rise - at.v_n) / rate


def after_impulse(total: Tensor) -> Left:
    """Phase that ends where P_n is `total` (N s)."""
    return lambda at, rate: total - at.P_n


def after_work(total: Tensor) -> Left:
    """Phase that begins at v_n ≥ 0 and ends where the work is `total` (J)."""

    def left(at: Slide, rate: Tensor) -> Tensor:
        missing = (total - at.work).clamp_min(0)
        square = torch.addcmul(at.v_n * at.v_n, rate, missing, value=2).clamp_min(_NONE)
        return 2 * missing / torch.addcmul(at.v_n.clamp_min(0), square, square.rsqrt())

    return left


class Hodograph:
    """The path of a contact; it does not depend on ε."""

    def __init__(self, contact: SpatialContact, mu: Tensor, steps: int | None = None):
        self.contact, self.mu, self.steps = contact, mu, steps or _steps.get()
        w_11, w_12, w_22, w_1n, w_2n, *_ = contact
        det = torch.addcmul(w_11 * w_22, w_12, w_12, value=-1)
        self._inverse = w_22 / det, -w_12 / det, w_11 / det
        self._stuck = _times(self._inverse, (w_1n, w_2n))  # friction that keeps a slip that has ended
        self._room = mu * mu - dot(self._stuck, self._stuck)
        none, self._one, self._half_mu = torch.zeros_like(self._room), torch.ones_like(self._room), 0.5 * mu
        u_1, u_2 = opposing((w_11, w_12, w_22), (w_1n, w_2n), mu + none, (none, none))
        sticks = self._room >= 0
        self.q_1, self.q_2 = (
            torch.where(sticks, -stuck, mu * u) for stuck, u in zip(self._stuck, (u_1, u_2), strict=True)
        )
        rate_1, rate_2, self.stiffness_after = self._rates((-self.q_1, -self.q_2))
        rate_1, rate_2 = (torch.where(sticks, none, rate) for rate in (rate_1, rate_2))
        self._rates_after = rate_1, rate_2, self.stiffness_after

    def start(self) -> Slide:
        """Return the point before contact.

        Where nothing slips and the contact sticks, the impulse is 0 with the derivative of the one that ends a slip.
        """
        none, (_, _, _, w_1n, w_2n, _, slip, across, v_n) = torch.zeros_like(self.q_1), self.contact
        still = slip + none == 0
        P_1, P_2 = (torch.where(still & (self._room >= 0), -P, none) for P in _times(self._inverse, (slip, across)))
        v_n = v_n + w_1n * P_1 + w_2n * P_2
        return Slide(slip + none, none, v_n, P_1, P_2, none, none, still)

    def compressed(self) -> Slide:
        """Return the point at which compression ends, v_n = 0 without rounding: restitution with ε = 0 ends there."""
        rest = torch.zeros_like(self.q_1)
        return self.followed(self.start(), until(rest))._replace(v_n=rest)

    def restored(self, at: Slide, elastic: Left, left: Left) -> Impulse:
        """Return the impulse at which a phase of restitution ends on the path of an elastic one.

        One step alone has the derivatives, also where the phase ends at its end, as that of ε = 0.6 does in five steps.
        """
        (P_1, P_2, P_n), goes_on = at.impulse, self._one
        for first, last in pairwise(self.points(at, elastic)):
            step = (last.P_n - first.P_n).clamp_min(_LEAST)
            share = left(first, ((last.v_n - first.v_n) / step).clamp_min(_LEAST)) / step
            taken = goes_on * share.clamp(1 - _WHOLE, _WHOLE)
            goes_on = goes_on * (share > _WHOLE)
            P_1 = torch.addcmul(P_1, taken, last.P_1 - first.P_1)
            P_2 = torch.addcmul(P_2, taken, last.P_2 - first.P_2)
            P_n = torch.addcmul(P_n, taken, last.P_n - first.P_n)
        return P_1, P_2, P_n

    def followed(self, at: Slide, left: Left) -> Slide:
        """Return the point at which a phase ends."""
        *_, end = self.points(at, left)
        return end

    def points(self, at: Slide, left: Left) -> Iterator[Slide]:
        """Yield the points of a phase, from its first to its last."""
        yield at
        moving, flat = torch.where(at.ended, 0.0, self._one), _FLAT * self.contact.w_nn
        speed = dot(at.slip, at.slip).clamp_min(_NONE).rsqrt().reciprocal()
        rates = self._rates((self.mu / speed * at.v_1, self.mu / speed * at.v_2))
        ahead = left(at, torch.maximum(rates[2], flat))
        for count in range(self.steps, 1, -1):
            share, slowing = 1 / count, 1 - ((count - 1) / count) ** 2
            square, growth = dot(at.slip, at.slip), dot(at.slip, rates)
            slows = -slowing * (moving * square / growth.clamp_max(-_LEAST))
            friction = self._middle(at.slip, square, growth, torch.minimum(share * ahead, slows))
            rates = self._rates(friction)
            whole = left(at, torch.maximum(rates[2], flat))
            step = torch.minimum(share * whole, slows)
            at, ahead = at.moved(step, rates, friction), whole - step
            yield at
        before, at = at.ended, self._to_the_end(at, left, rates, ahead)
        yield at._replace(ended=before)
        step, stopped = torch.where(at.ended, left(at, self.stiffness_after).clamp_min(0), 0.0), at.ended & ~before
        v_1, v_2 = (torch.where(stopped, 0.0, v) for v in at.slip)
        yield at._replace(v_1=v_1, v_2=v_2).moved(step, self._rates_after, (-self.q_1, -self.q_2))

    def _to_the_end(self, at: Slide, left: Left, rates: Impulse, ahead: Tensor) -> Slide:
        """Return the point at which a phase or the slip ends, whichever is nearer.

        A straight path ends the slip after the normal impulse h with v_t = −h (W_tn − W_tt f), |f| = μ, which is
        quadratic in 1/h; f = x/h + y, x = W_tt⁻¹ v_t, y = W_tt⁻¹ W_tn.
        """
        x = _times(self._inverse, at.slip)
        square, half = dot(x, x), -dot(x, self._stuck)
        disc = torch.addcmul(half * half, square, self._room)
        root = disc.clamp_min(_NONE)
        root = torch.where(disc > 0, torch.addcmul(half, root, root.rsqrt()), 0.0).clamp_min(_LEAST)
        inverse = root / square.clamp_min(_NONE)
        to_rest = torch.where(at.ended, 0.0, inverse.reciprocal())
        guess = torch.minimum(ahead, to_rest)
        f_1, f_2 = self._middle(at.slip, dot(at.slip, at.slip), dot(at.slip, rates), guess)
        whole = left(at, self._rates((f_1, f_2))[2].clamp_min(_LEAST))
        step, stops = torch.minimum(whole, to_rest), to_rest < whole.clamp_max(_MOST)
        f_1 = torch.where(stops, torch.addcmul(self._stuck[0], x[0], inverse), f_1)
        f_2 = torch.where(stops, torch.addcmul(self._stuck[1], x[1], inverse), f_2)
        end = at.moved(torch.where(step < _MOST, step, guess), self._rates((f_1, f_2)), (f_1, f_2))
        return end._replace(ended=at.ended | stops | (whole > _MOST))

    def _middle(self, v: Pair, square: Tensor, growth: Tensor, step: Tensor) -> Pair:
        """Friction −dP_t/dP_n in the middle of a step: implicit in v but for its length, which falls evenly."""
        w_11, w_12, w_22, w_1n, w_2n, *_ = self.contact
        least = torch.maximum(torch.addcmul(square, step, growth), _LEFT * square).clamp_min(_NONE)
        share = self._half_mu * step * least.rsqrt()
        a_11, a_22 = torch.addcmul(self._one, share, w_11), torch.addcmul(self._one, share, w_22)
        a_12 = share * w_12
        b = torch.addcmul(v[0], step, w_1n, value=0.5), torch.addcmul(v[1], step, w_2n, value=0.5)
        u_1 = torch.addcmul(a_22 * b[0], a_12, b[1], value=-1)
        u_2 = torch.addcmul(a_11 * b[1], a_12, b[0], value=-1)
        per_length = self.mu * dot((u_1, u_2), (u_1, u_2)).clamp_min(_NONE).rsqrt()
        return per_length * u_1, per_length * u_2

    def _rates(self, friction: Pair) -> Impulse:
        """dv_c/dP_n (1/kg) with a friction −dP_t/dP_n."""
        w_11, w_12, w_22, w_1n, w_2n, w_nn, *_ = self.contact
        rate_1, rate_2, rate_n = (
            torch.addcmul(torch.addcmul(rate, a, friction[0], value=-1), b, friction[1], value=-1)
            for rate, a, b in ((w_1n, w_11, w_12), (w_2n, w_12, w_22), (w_nn, w_1n, w_2n))
        )
        return rate_1, rate_2, rate_n


def _times(A: Impulse, b: Pair) -> Pair:
    """A b of a symmetric A, by its 11, 12 and 22."""
    return dot((A[0], A[1]), b), dot((A[1], A[2]), b)
