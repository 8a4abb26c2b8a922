"""Changes that act while the contact lasts: Routh's path as it is, and with the change.

A law gives the end of a contact.  A change that acts at every instant, such as a moment or another friction,
moves the whole path; `perturbed_path` adds to the law's wrench the difference between the two paths, each
integrated until v_n reaches the law's value.  The path is continuous in all inputs, so the change is too.
"""

from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.state import State, columns
from contactlearn.laws.contact import Contact
from contactlearn.laws.wang_mason import routh_path


def perturbed_path(
    state: State,
    wrench: Float[Tensor, "... n 3"],
    *,
    arm: Float[Tensor, "... n"] | None = None,
    friction: tuple[Float[Tensor, "..."], Float[Tensor, "..."]] | None = None,
) -> Float[Tensor, "... n 3"]:
    """Return the wrench [..., N, 3] after a change to the path.

    Args:
        state: with μ and ε of the law.
        wrench: of the law, in contact axes.
        arm: distance [..., N] in m at which the normal impulse acts to the right of the contact point: τ grows by
            arm P_n.
        friction: μ against slip in the direction of the initial slip, and against slip in the other direction.
    """
    P_t, P_n, tau = wrench.unbind(-1)
    (mu, _), contact = state.coefficients, contact_of(state)
    w_nt, moved = contact.w_tn, contact
    if arm is not None:
        turn_t, turn_n = -state.r[..., 1] * arm / state.inertia, state.r[..., 0] * arm / state.inertia
        moved = contact._replace(w_tn=contact.w_tn + turn_t, w_nn=contact.w_nn + turn_n)
    rise = (state.contact_after(wrench)[..., 1] - state.v_n).clamp_min(0)
    was, now = routh_path(contact, mu, mu, w_nt), routh_path(moved, *(friction or (mu, mu)), w_nt)
    before, after = was.impulse(was.until(rise)), now.impulse(now.until(rise))
    P_t, P_n = P_t + (after[0] - before[0]), P_n + (after[1] - before[1])
    return columns(P_t, P_n, tau if arm is None else tau + arm * P_n)


def contact_of(state: State) -> Contact:
    """Return the contact of a state by component."""
    return Contact.of(state.W, state.approach)
