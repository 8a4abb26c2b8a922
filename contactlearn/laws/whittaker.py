"""Whittaker (1904; 4th edition 1944): Newton restitution, sliding against the *initial* slip.

Stick (v_t⁺ = 0, v_n⁺ = −ε v_n) if the impulse lies in the friction cone; otherwise

    P_t = −s μ P_n,   P_n = −(1 + ε) v_n / (W_nn − s μ W_tn),   s = sign(v_t) before contact.

It can add energy (Kane's paradox), and it is discontinuous in μ where sticking needs a tangential
impulse *along* the initial slip.
"""

import torch
from torch import Tensor

from contactlearn.laws.base import Contact, slip_direction, stick


def textbook(contact: Contact, mu: Tensor, eps: Tensor) -> tuple[Tensor, Tensor]:
    """(P_t, P_n) in N s as in the module's formula."""
    target = -(1 + eps) * contact.v_n
    t_stick, n_stick = stick(contact, target)
    slope = mu * slip_direction(contact)
    sticks = t_stick.abs() <= mu * n_stick
    n_slide = target / torch.where(sticks, 1.0, contact.w_nn - slope * contact.w_tn)
    return torch.where(sticks, t_stick, -slope * n_slide), torch.where(sticks, n_stick, n_slide)


def fazeli2017(contact: Contact, mu: Tensor, eps: Tensor) -> tuple[Tensor, Tensor]:
    """As computed for the paper: on sliding P_n stays that of sticking, |P_t| = μ P_n, final slip.

    P_n is not solved again, so the result can leave the cone, gain energy and penetrate.
    """
    t_stick, n_stick = stick(contact, -(1 + eps) * contact.v_n)
    sticks = t_stick.abs() <= mu * n_stick
    return torch.where(sticks, t_stick, t_stick.sign() * mu * n_stick), n_stick


VARIANTS = {"textbook": textbook, "fazeli2017": fazeli2017}
