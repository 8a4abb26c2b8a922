"""Routh's path in space: the hodograph of the slip, followed in the normal impulse p = P_n.

    dP_t/dp = −μ v_t/|v_t|,   dv_c/dp = W (−μ v_t/|v_t|, 1)

While the contact slides the slip turns, so the path is a curve.  Where the slip ends, at a singular point of the
equation, the contact sticks if the cone allows, dP_t/dp = −W_tt⁻¹ W_tn, and otherwise slides on in the one direction
that does not turn; the rest of the path is straight.  A phase (compression, restitution) takes a fixed number of
midpoint steps, implicit in the slip, to the nearer of its two ends.  Steps shrink towards the end of the slip, and are
exact in v_n and its work.  The order is two where the slip lasts.  Restitution is followed once, up to an elastic one,
and ends within one of its steps: all ε of a grid share the path.

Sources: Keller 1986; Batlle 1996; Bhatt & Koechling 1995; Stronge 2000.
"""

from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import NamedTuple

import torch
from torch import Tensor

from contactlearn.laws.contact import Impulse, SpatialContact, opposing

STEPS = 6
"""Midpoint steps of a phase."""
_ROUNDS = 2  # of the speed in the middle of a step
_LEAST, _MOST = 1e-100, 1e100  # N s: a shorter step is none, and a longer one has no end


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
    def impulse(self) -> Impulse:
        """The impulse so far."""
        return self.P_1, self.P_2, self.P_n


Left = Callable[[Slide, Tensor], Tensor]
"""Normal impulse until a phase ends from a point of the path, if v_n rises at a rate (1/kg) per impulse."""


def until(rise: Tensor) -> Left:
    """Phase that ends where v_n is `rise` (m/s)."""

    def left(at: Slide, rate: Tensor) -> Tensor:
        gap, rises = rise - at.v_n, rate > 0
        return torch.where(rises, gap / torch.where(rises, rate, 1.0), torch.where(gap > 0, torch.inf, 0.0))

    return left


def after_impulse(total: Tensor) -> Left:
    """Phase that ends where P_n is `total` (N s)."""
    return lambda at, rate: total - at.P_n


def after_work(total: Tensor) -> Left:
    """Phase that begins at v_n ≥ 0 and ends where the work is `total` (J)."""

    def left(at: Slide, rate: Tensor) -> Tensor:
        missing = (total - at.work).clamp_min(0)
        square = at.v_n**2 + 2 * rate * missing
        reached = (missing > 0) & (square > 0) & ((at.v_n > 0) | (rate > 0))
        root = torch.where(reached, square, 1.0).sqrt()
        length = 2 * missing / torch.where(reached, at.v_n + root, 1.0)
        return torch.where(reached, length, torch.where(missing > 0, torch.inf, 0.0))

    return left


class Hodograph:
    """The path of a contact; it does not depend on ε."""

    def __init__(self, contact: SpatialContact, mu: Tensor, steps: int = STEPS):
        self.contact, self.mu, self.steps = contact, mu, steps
        w_11, w_12, w_22, w_1n, w_2n, w_nn, _, _ = contact
        det = w_11 * w_22 - w_12**2
        self._inverse = w_22 / det, -w_12 / det, w_11 / det
        q_1, q_2 = (w_12 * w_2n - w_22 * w_1n) / det, (w_12 * w_1n - w_11 * w_2n) / det
        self.y_1, self.y_2, self._room = -q_1, -q_2, mu**2 - q_1**2 - q_2**2
        self._divisor = torch.where(mu > 0, mu, 1.0)
        none = torch.zeros_like(det)
        u_1, u_2 = opposing((w_11, w_12, w_22), (w_1n, w_2n), mu + none, (none, none))
        sticks = q_1**2 + q_2**2 <= mu**2
        self.q_1, self.q_2 = torch.where(sticks, q_1, mu * u_1), torch.where(sticks, q_2, mu * u_2)
        self.after = tuple(
            torch.where(sticks, none, rate)
            for rate in (w_1n + w_11 * self.q_1 + w_12 * self.q_2, w_2n + w_12 * self.q_1 + w_22 * self.q_2)
        )
        self.stiffness_after = w_nn + w_1n * self.q_1 + w_2n * self.q_2
        self._rough = mu * w_11, mu * w_12, mu * w_22, mu * w_1n, mu * w_2n

    def start(self) -> Slide:
        """Return the point before contact."""
        slip, none = self.contact.slip, torch.zeros_like(self.q_1)
        return Slide(slip + none, none, self.contact.v_n + none, none, none, none, none, slip + none == 0)

    def compressed(self) -> Slide:
        """Return the point at which compression ends, v_n = 0 without rounding: restitution with ε = 0 ends there."""
        rest = torch.zeros_like(self.q_1)
        return self.followed(self.start(), until(rest))._replace(v_n=rest)

    def restored(self, at: Slide, elastic: Left, left: Left) -> Impulse:
        """Return the impulse at which a phase of restitution ends on the path of an elastic one."""
        P_1, P_2, P_n = at.impulse
        taken = torch.ones_like(P_n)
        for first, last in pairwise(self.points(at, elastic)):
            step, before = (last.P_n - first.P_n).clamp_min(_LEAST), taken
            taken = (left(first, (last.v_n - first.v_n) / step).clamp_max(_MOST) / step).clamp(0, 1)
            taken = torch.where(before < 1, 0.0, taken)
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
        straight, ended = at.ended, at.ended
        for count in range(self.steps, 0, -1):
            share, slowing = 1 / count, 1 - ((count - 1) / count) ** 2
            v_1 = torch.where(straight, 1.0, at.v_1)
            speed = (v_1 * v_1 + at.v_2 * at.v_2).sqrt()
            to_rest, q_1, q_2 = self._to_rest(v_1, at.v_2)
            step = torch.minimum(share * left(at, self._rates(v_1 / speed, at.v_2 / speed)[2]), slowing * to_rest)
            step = torch.where(step < torch.inf, step, 0.3 * speed / self.contact.w_11)
            c, s = self._middle(v_1, at.v_2, speed, step)
            whole = left(at, self._rates(c, s)[2])
            step = torch.minimum(share * whole, slowing * to_rest)
            if count == 1:
                stops = to_rest < whole
                ended = straight | stops | (step == torch.inf)
                c, s = torch.where(stops, -q_1 / self._divisor, c), torch.where(stops, -q_2 / self._divisor, s)
            step = torch.where(straight, 0.0, torch.where(step < torch.inf, step, 0.3 * speed / self.contact.w_11))
            rate_1, rate_2, rate_n = self._rates(c, s)
            at = Slide(
                at.v_1 + step * rate_1,
                at.v_2 + step * rate_2,
                at.v_n + step * rate_n,
                at.P_1 - self.mu * step * c,
                at.P_2 - self.mu * step * s,
                at.P_n + step,
                at.work + step * (at.v_n + 0.5 * step * rate_n),
                straight,
            )
            yield at
        step = torch.where(ended, left(at, self.stiffness_after), 0.0)
        v_1, v_2 = (torch.where(ended & ~straight, 0.0, v) for v in (at.v_1, at.v_2))
        yield Slide(
            v_1 + step * self.after[0],
            v_2 + step * self.after[1],
            at.v_n + step * self.stiffness_after,
            at.P_1 + step * self.q_1,
            at.P_2 + step * self.q_2,
            at.P_n + step,
            at.work + step * (at.v_n + 0.5 * step * self.stiffness_after),
            ended,
        )

    def _to_rest(self, v_1: Tensor, v_2: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Normal impulse h after which a straight path ends the slip, inf if none does, and its friction q per P_n.

        v_t = −h (W_tn + W_tt q), |q| = μ, is quadratic in 1/h; q = −(x/h + y), x = W_tt⁻¹ v_t, y = W_tt⁻¹ W_tn.
        """
        i_11, i_12, i_22 = self._inverse
        x_1, x_2 = i_11 * v_1 + i_12 * v_2, i_12 * v_1 + i_22 * v_2
        square, half, rest = x_1 * x_1 + x_2 * x_2, -(x_1 * self.y_1 + x_2 * self.y_2), self._room
        disc = half * half + square * rest
        fits = disc > 0
        root = half + torch.where(fits, disc, 1.0).sqrt()
        fits = fits & (root > 0)
        inverse = torch.where(fits, root, 1.0) / square
        to_rest = torch.where(fits, 1 / inverse, torch.inf)
        return to_rest, -(x_1 * inverse + self.y_1), -(x_2 * inverse + self.y_2)

    def _middle(self, v_1: Tensor, v_2: Tensor, speed: Tensor, step: Tensor) -> tuple[Tensor, Tensor]:
        """Direction of the slip in the middle of a step: implicit in v_t, with a speed that is found in two rounds."""
        m_11, m_12, m_22 = self._rough[:3]
        half = 0.5 * step
        b_1, b_2 = v_1 + half * self.contact.w_1n, v_2 + half * self.contact.w_2n
        c, s = b_1, b_2
        for _ in range(_ROUNDS):
            share = half / speed
            a_11, a_12, a_22 = 1 + share * m_11, share * m_12, 1 + share * m_22
            x_1, x_2 = a_22 * b_1 - a_12 * b_2, a_11 * b_2 - a_12 * b_1
            length = (x_1 * x_1 + x_2 * x_2).clamp_min(1e-300).sqrt()
            speed, c, s = length / (a_11 * a_22 - a_12 * a_12), x_1 / length, x_2 / length
        return c, s

    def _rates(self, c: Tensor, s: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """dv_c/dp (1/kg) in a direction of the slip."""
        m_11, m_12, m_22, m_1, m_2 = self._rough
        rate_1 = self.contact.w_1n - (m_11 * c + m_12 * s)
        rate_2 = self.contact.w_2n - (m_12 * c + m_22 * s)
        return rate_1, rate_2, self.contact.w_nn - (m_1 * c + m_2 * s)
