"""Chatterjee & Ruina (1998): an algebraic law with tangential restitution e_t, which can spin back.

    P = (1 + ε) P_I + (1 + e_t) (P_II − P_I),   P_I = (0, −v_n / W_nn),   P_II = −M_c v_c,

and where |P_t| > μ P_n the factor (1 + e_t) is replaced by the one that puts P on the cone.
e_t acts on the slip u = v_t − W_tn v_n / W_nn that P_I leaves: v_t⁺ = −e_t u − ε W_tn v_n / W_nn, so
with W_tn = 0 or ε = 0, e_t = 0 ends the slip and e_t = 1 reverses it.  It is not one of the paper's six.
"""

import torch
from torch import Tensor

from contactlearn.core.numerics import finite_number
from contactlearn.laws.base import Law
from contactlearn.laws.contact import Contact, Impulse, SpatialContact, Values, stick, stick_in_space


class ChatterjeeRuina(Law):
    """Algebraic restitution in both directions; it never adds energy.

    e_t is not a coefficient of friction: within the friction cone it alone decides the final slip.

    Raises:
        DataError: e_t is not in [−1, 1].
    """

    label = "Chatterjee–Ruina"
    citations = ("chatterjee1998",)

    e_t: Values | float = 0.0
    """Coefficient of tangential restitution in [−1, 1], broadcast against [..., N]."""

    def __post_init__(self):
        if not isinstance(self.e_t, Tensor):
            finite_number("e_t", self.e_t, -1, 1)

    def solve(self, contact: Contact, mu: Values, eps: Values) -> tuple[Values, Values]:
        """Return (P_t, P_n) in N s; see the module."""
        t_2, n_2 = stick(contact, -contact.v_n)
        n_1 = -contact.v_n / contact.w_nn
        d_t, d_n = t_2, n_2 - n_1
        normal = (1 + eps) * n_1
        free = 1 + torch.as_tensor(self.e_t, dtype=normal.dtype, device=normal.device)
        slides = (free * d_t).abs() > mu * (normal + free * d_n)
        on_cone = mu * normal / torch.where(slides, d_t.abs() - mu * d_n, 1.0)
        factor = torch.where(slides, on_cone, free)
        return factor * d_t, normal + factor * d_n

    def solve_in_space(self, contact: SpatialContact, mu: Values, eps: Values) -> Impulse:
        """Return (P_1, P_2, P_n) in N s; the segment from P_I to P_II leaves the cone as in the plane."""
        d_1, d_2, n_2 = stick_in_space(contact, -contact.v_n)
        n_1 = -contact.v_n / contact.w_nn
        d_t, d_n, normal = torch.hypot(d_1, d_2), n_2 - n_1, (1 + eps) * n_1
        free = 1 + torch.as_tensor(self.e_t, dtype=normal.dtype, device=normal.device)
        slides = free * d_t > mu * (normal + free * d_n)
        on_cone = mu * normal / torch.where(slides, d_t - mu * d_n, 1.0)
        factor = torch.where(slides, on_cone, free)
        return factor * d_1, factor * d_2, normal + factor * d_n
