"""Whittaker (1904; 4th edition 1944): Newton restitution, sliding against the *initial* slip.

Stick (v_t⁺ = 0, v_n⁺ = −ε v_n) if the impulse lies in the friction cone; otherwise

    P_t = −s μ P_n,   P_n = −(1 + ε) v_n / (W_nn − s μ W_tn),   s = sign(v_t) before contact.

It can add energy (Kane's paradox), and it is discontinuous in μ where sticking needs a tangential
impulse *along* the initial slip.
"""

import torch

from contactlearn.laws.base import Law
from contactlearn.laws.contact import (
    Contact,
    Impulse,
    SpatialContact,
    Values,
    slip_direction,
    stick,
    stick_in_space,
    where,
)


class Whittaker(Law):
    """Newton restitution, with friction against the *initial* slip; it can add energy.

    It is not the solution of a complementarity problem: see `AnitescuPotraNewton` for friction against the final slip.
    """

    label = "Whittaker"
    citations = ("whittaker1944",)
    paper = 1
    adds_energy = True

    def solve(self, contact: Contact, mu: Values, eps: Values) -> tuple[Values, Values]:
        """Return (P_t, P_n) in N s; see the module."""
        target = -(1 + eps) * contact.v_n
        t_stick, n_stick = stick(contact, target)
        slope = mu * slip_direction(contact)
        sticks = t_stick.abs() <= mu * n_stick
        n_slide = target / torch.where(sticks, 1.0, contact.w_nn - slope * contact.w_tn)
        return torch.where(sticks, t_stick, -slope * n_slide), torch.where(sticks, n_stick, n_slide)

    def solve_in_space(self, contact: SpatialContact, mu: Values, eps: Values) -> Impulse:
        """Return (P_1, P_2, P_n) in N s; in space sliding keeps the direction of the initial slip.

        Where friction in that direction drives the contact into the floor, whatever P_n, it is that of sticking.
        """
        target = -(1 + eps) * contact.v_n
        stuck = stick_in_space(contact, target)
        sticks = torch.hypot(stuck[0], stuck[1]) <= mu * stuck[2]
        size = torch.where(sticks, 1.0, torch.hypot(stuck[0], stuck[1]))
        slides = contact.w_nn > mu * contact.w_1n
        u_1, u_2 = torch.where(slides, -1.0, stuck[0] / size), torch.where(slides, 0.0, stuck[1] / size)
        n = target / torch.where(sticks, 1.0, contact.w_nn + mu * (u_1 * contact.w_1n + u_2 * contact.w_2n))
        slides = mu * n * u_1, mu * n * u_2, n
        return where(sticks, stuck, slides)


class WhittakerFazeli2017(Law):
    """Whittaker's law as computed for the paper: on sliding P_n stays that of sticking, |P_t| = μ P_n, final slip.

    P_n is not solved again, so the impulse can leave the cone, add energy and penetrate.
    """

    name = Whittaker.name
    variant = "fazeli2017"
    label = Whittaker.label
    citations = (*Whittaker.citations, "fazeli2017")
    adds_energy = True
    leaves_cone = True
    pulls = True
    penetrates = True

    def solve(self, contact: Contact, mu: Values, eps: Values) -> tuple[Values, Values]:
        """Return (P_t, P_n) in N s; see the module."""
        t_stick, n_stick = stick(contact, -(1 + eps) * contact.v_n)
        sticks = t_stick.abs() <= mu * n_stick
        return torch.where(sticks, t_stick, t_stick.sign() * mu * n_stick), n_stick
