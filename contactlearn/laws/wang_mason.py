"""Wang & Mason (1992): Routh's path in impulse space with Poisson restitution.

With p = P_n as the independent variable ("clock"), dP_t/dp = −s μ while the contact slides.  Once v_t = 0 it sticks,
dP_t/dp = −W_tn/W_tt, if the friction cone allows, and otherwise slides in the other direction; in both cases dP_t/dp is
the sticking slope clamped to ±μ.  Compression ends where v_n = 0, at p = p_c; restitution ends at (1 + ε) p_c.
Five modes differ in where the initial slip ends and in what follows it: sliding (it never ends), sticking or reversed
sliding from compression on (C), or from restitution on (R).
"""

from typing import NamedTuple

import torch
from torch import Tensor

from contactlearn.laws.base import Law
from contactlearn.laws.contact import Contact, Impulse, SpatialContact, Values, slip_direction, within
from contactlearn.laws.hodograph import Hodograph, after_impulse


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
        """Return the clock p (N s) at which v_n has risen by `rise` (m/s)."""
        first = self.v_slip >= rise
        p_first = rise / torch.where(first, self.stiffness, 1.0)
        p_slip, v_slip = (torch.where(first, 0.0, x) for x in (self.p_slip, self.v_slip))
        return torch.where(first, p_first, p_slip + (rise - v_slip) / self.stiffness_after)

    def impulse(self, p: Tensor) -> tuple[Tensor, Tensor]:
        """Return (P_t, P_n) in N s at clock p."""
        before = torch.minimum(p, self.p_slip)
        return self.slope * before + self.slope_after * (p - before), p


def routh_path(contact: Contact, mu: Tensor, mu_back: Tensor | None = None, w_nt: Tensor | None = None) -> Path:
    """Return the path of a contact; it does not depend on ε.

    Args:
        contact: W and v_c by component.
        mu: coefficient of friction against the initial slip.
        mu_back: coefficient of friction against slip in the other direction; `mu` if None.
        w_nt: rise of v_n per tangential impulse in 1/kg, which a moment at the contact changes; W_tn if None.
    """
    w_tt, w_tn, w_nn, v_t, v_n = contact
    w_nt = w_tn if w_nt is None else w_nt
    direction = slip_direction(contact)
    slope = -direction * mu
    # Once the slip has ended, W_tn decides in which direction the contact slips on, if it does.
    limit = mu if mu_back is None else torch.where(w_tn * direction > 0, mu, mu_back)
    slope_after = within(-w_tn / w_tt, limit)
    stiffness, stiffness_after = w_nn + slope * w_nt, w_nn + slope_after * w_nt
    # |v_t| falls at this rate; at a rate ≤ 0 the slip never ends (and then stiffness > 0).
    braking = -(w_tn + slope * w_tt) * direction
    ends = braking > 0
    p_slip = torch.where(ends, direction * v_t / torch.where(ends, braking, 1.0), torch.inf)  # with a derivative at 0
    v_slip = torch.where(ends, stiffness * torch.where(ends, p_slip, 0.0), torch.inf)
    return Path(slope, slope_after, stiffness, stiffness_after, p_slip, v_slip, v_n)


class WangMason(Law):
    """Routh's path in impulse space with Poisson restitution; it never adds energy."""

    label = "Wang–Mason"
    citations = ("wang1992",)
    paper = 5

    def solve(self, contact: Contact, mu: Values, eps: Values) -> tuple[Values, Values]:
        """Return (P_t, P_n) in N s; see the module."""
        path = routh_path(contact, mu)
        return path.impulse((1 + eps) * path.p_c)

    def solve_in_space(self, contact: SpatialContact, mu: Values, eps: Values) -> Impulse:
        """Return (P_1, P_2, P_n) in N s; see `hodograph`."""
        path = Hodograph(contact, mu)
        compressed = path.compressed()
        return path.restored(compressed, *(after_impulse((1 + e) * compressed.P_n) for e in (1.0, eps)))
