"""Chatterjee & Ruina (1998): an algebraic law with tangential restitution e_t, which can spin back.

    P = (1 + ε) P_I + (1 + e_t) (P_II − P_I),   P_I = (0, −v_n / W_nn),   P_II = −M_c v_c,

and where |P_t| > μ P_n the factor (1 + e_t) is replaced by the one that puts P on the cone.
e_t acts on the slip u = v_t − W_tn v_n / W_nn that P_I leaves: v_t⁺ = −e_t u − ε W_tn v_n / W_nn, so
with W_tn = 0 or ε = 0, e_t = 0 ends the slip and e_t = 1 reverses it.  It is not one of the paper's six.
"""

import torch
from torch import Tensor

from contactlearn.laws.base import Contact, stick


def textbook(contact: Contact, mu: Tensor, eps: Tensor, e_t: Tensor) -> tuple[Tensor, Tensor]:
    """(P_t, P_n) in N s as in the module's formula; e_t in [−1, 1]."""
    t_2, n_2 = stick(contact, -contact.v_n)
    n_1 = -contact.v_n / contact.w_nn
    d_t, d_n = t_2, n_2 - n_1
    normal = (1 + eps) * n_1
    free = 1 + e_t
    slides = (free * d_t).abs() > mu * (normal + free * d_n)
    on_cone = mu * normal / torch.where(slides, d_t.abs() - mu * d_n, 1.0)
    factor = torch.where(slides, on_cone, free)
    return factor * d_t, normal + factor * d_n


VARIANTS = {"textbook": textbook, "fazeli2017": textbook}
