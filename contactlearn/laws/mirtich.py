"""Mirtich (1996): Routh's path with Stronge's energetic restitution (1990).

The path is that of Wang & Mason; restitution ends where the normal work that it gives back,
∫ v_n dp from p_c on, is ε² times the normal work of compression.  v_n is linear in p on both pieces
of the path, so both works are quadratic and the end is a square root.
"""

import torch
from torch import Tensor

from contactlearn.laws.base import Contact
from contactlearn.laws.wang_mason import routh_path


def textbook(contact: Contact, mu: Tensor, eps: Tensor) -> tuple[Tensor, Tensor]:
    """(P_t, P_n) in N s at the end of restitution."""
    path = routh_path(contact, mu)
    w = -contact.v_n
    compressed_first = path.v_slip >= w  # compression ends before the slip does
    v_left = torch.where(compressed_first, 0.0, w - path.v_slip)
    p_slip = torch.where(torch.isfinite(path.p_slip), path.p_slip, 0.0)
    # Normal work of compression, J: over one piece of the path, or over both.
    work_first = 0.5 * w**2 / torch.where(compressed_first, path.stiffness, 1.0)
    work_both = p_slip * (w - 0.5 * path.stiffness * p_slip) + 0.5 * v_left**2 / path.stiffness_after
    # Restitution on the second piece alone.
    p_second = path.p_c + eps * (2 * work_both / path.stiffness_after).sqrt()
    # Restitution that starts on the first piece, and goes on to the second where the slip ends in it.
    p_first = (1 + eps) * path.p_c
    crosses = compressed_first & (p_first > path.p_slip)
    v_end = torch.where(crosses, path.v_slip - w, 1.0)
    work_left = torch.where(
        crosses, eps**2 * work_first - 0.5 * v_end**2 / torch.where(crosses, path.stiffness, 1.0), 0.0
    )
    p_crossed = p_slip + 2 * work_left / (v_end + (v_end**2 + 2 * path.stiffness_after * work_left).sqrt())
    return path.impulse(torch.where(compressed_first, torch.where(crosses, p_crossed, p_first), p_second))


VARIANTS = {"textbook": textbook, "fazeli2017": textbook}
