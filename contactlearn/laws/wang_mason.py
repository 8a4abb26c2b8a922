"""Wang & Mason (1992): Routh's path in impulse space with Poisson restitution.

With p = P_n as the clock, dP_t/dp = −s μ while sliding; once v_t = 0 the contact sticks
(dP_t/dp = −W_tn/W_tt) if the cone allows, otherwise it slides back: both are the sticking slope
clamped to ±μ.  Compression ends where v_n = 0, at p = p_c; restitution ends at (1 + ε) p_c.
The five modes (sliding, C-sticking, R-sticking, C-reversed, R-reversed) are the places where the
slip ends: never, or before or after p_c, in stick or in reversed sliding.
"""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import torch
from torch import Tensor

from contactlearn.laws.base import Law
from contactlearn.laws.contact import Contact, Values, slip_direction, within


class Path(NamedTuple):
    """Routh's path: two straight pieces in (p, P_t), and v_n along them."""

    slope: Tensor  # dP_t/dp = −s μ before the slip ends
    slope_after: Tensor
    stiffness: Tensor  # dv_n/dp (1/kg) before the slip ends
    stiffness_after: Tensor
    p_slip: Tensor  # p at which the initial slip ends (N s), inf where it never does
    v_slip: Tensor  # v_n gained by then (m/s), inf where the slip never ends
    v_n: Tensor  # v_n before contact (m/s)

    @property
    def p_c(self) -> Tensor:
        """Clock p at which compression ends (N s)."""
        return self.until(-self.v_n)

    def until(self, rise: Tensor) -> Tensor:
        """Clock p at which v_n has risen by `rise` (m/s)."""
        first = self.v_slip >= rise
        p_first = rise / torch.where(first, self.stiffness, 1.0)
        p_slip, v_slip = (torch.where(first, 0.0, x) for x in (self.p_slip, self.v_slip))
        return torch.where(first, p_first, p_slip + (rise - v_slip) / self.stiffness_after)

    def impulse(self, p: Tensor) -> tuple[Tensor, Tensor]:
        """(P_t, P_n) at clock p."""
        before = torch.minimum(p, self.p_slip)
        return self.slope * before + self.slope_after * (p - before), p


def routh_path(contact: Contact, mu: Tensor, mu_back: Tensor | None = None, w_nt: Tensor | None = None) -> Path:
    """The path of a contact; it does not depend on ε.

    Two things are as usual if left out: `mu_back`, the friction against slip in the other direction than the
    initial one, and `w_nt`, the rise of v_n per tangential impulse, which is W_tn without a moment.
    """
    w_tt, w_tn, w_nn, v_t, v_n = contact
    w_nt = w_tn if w_nt is None else w_nt
    direction = slip_direction(contact)
    slope = -direction * mu
    # Once it has stopped, the contact slips on or back as W_tn drives it.
    limit = mu if mu_back is None else torch.where(w_tn * direction > 0, mu, mu_back)
    slope_after = within(-w_tn / w_tt, limit)
    stiffness, stiffness_after = w_nn + slope * w_nt, w_nn + slope_after * w_nt
    # |v_t| falls at this rate; at a rate ≤ 0 the slip never ends (and then stiffness > 0).
    braking = -(w_tn + slope * w_tt) * direction
    ends = braking > 0
    p_slip = torch.where(ends, v_t.abs() / torch.where(ends, braking, 1.0), torch.inf)
    v_slip = torch.where(ends, stiffness * torch.where(ends, p_slip, 0.0), torch.inf)
    return Path(slope, slope_after, stiffness, stiffness_after, p_slip, v_slip, v_n)


@dataclass(frozen=True)
class WangMason(Law):
    """Routh's path in impulse space with Poisson restitution; it never adds energy."""

    label: ClassVar[str] = "Wang–Mason"
    citations: ClassVar[tuple[str, ...]] = ("wang1992",)
    paper: ClassVar[int | None] = 5

    def solve(self, contact: Contact, mu: Values, eps: Values) -> tuple[Values, Values]:
        """Return (P_t, P_n) in N s; see the module."""
        path = routh_path(contact, mu)
        return path.impulse((1 + eps) * path.p_c)
