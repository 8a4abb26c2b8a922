"""Changes that act while the contact lasts: Routh's path as it is, and with the change.

A law gives the end of a contact.  A change that acts at every instant, such as a moment or another friction,
moves the whole path; `perturbed_path` adds to the law's wrench the difference between the two paths, each
integrated until v_n reaches the law's value.  The path is continuous in all inputs, so the change is too.
"""

from collections.abc import Callable, Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.state import State, columns
from contactlearn.laws.contact import Contact
from contactlearn.laws.wang_mason import routh_path
from contactlearn.mechanics import rigid_body

_STEPS = 12  # of the same rise of v_n
_FLATTEST = 0.05  # of W_nn: v_n rises no slower
_NOTHING = 1e-60  # below which a square is none


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
    was, now = routh_path(contact, mu, mu, w_nt), routh_path(moved, *(friction or (mu, mu)), w_nt)
    rise = (state.contact_after(wrench)[..., 1] - state.v_n).clamp_min(0)
    before, after = was.impulse(was.until(rise)), now.impulse(now.until(rise))
    P_t, P_n = P_t + (after[0] - before[0]), P_n + (after[1] - before[1])
    return columns(P_t, P_n, tau if arm is None else tau + arm * P_n)


def _none(slip: Float[Tensor, "2 ..."]) -> Float[Tensor, "..."]:
    """No change of friction."""
    return torch.zeros_like(slip[0])


def perturbed_path_in_space(
    state: State,
    wrench: Float[Tensor, "... n 6"],
    parameters: Sequence[Float[Tensor, "..."]],
    *,
    moment: Callable[[Float[Tensor, "3 ..."]], Float[Tensor, "3 ..."]] = torch.zeros_like,
    friction: Callable[[Float[Tensor, "2 ..."]], Float[Tensor, "..."]] = _none,
) -> Float[Tensor, "... n 6"]:
    """Return the wrench [..., N, 6] after a change that follows the spin or the slip of the instant, in steps.

    Args:
        state: with μ and ε of the law.
        wrench: of the law, in contact axes.
        parameters: of the change, [...] each.
        moment: dτ/dP_n [3, ..., N] in m at a spin [3, ..., N] in rad/s.
        friction: change of μ at a slip [2, ..., N] in m/s.
    """
    rise = (state.contact_after(wrench)[..., -1] - state.v_n).clamp_min(0)
    mu = torch.as_tensor(state.coefficients[0]) + torch.zeros_like(rise)
    changed = mu + sum(torch.zeros_like(value) for value in parameters)
    after = _followed(state, rise, changed, moment, friction)
    return wrench + (after - _followed(state, rise, mu, torch.zeros_like, _none))


def _followed(
    state: State,
    rise: Float[Tensor, "... n"],
    mu: Float[Tensor, "... n"],
    moment: Callable[[Tensor], Tensor],
    friction: Callable[[Tensor], Tensor],
) -> Float[Tensor, "... n 6"]:
    """The wrench of Routh's path in steps of v_n; components of vectors and matrices are the first axes here."""
    vectors = state.r, state.approach, state.v_pre[..., 3:]
    matrices = rigid_body.inverse(state.world_inertia), state.W
    r, v, omega = (x.expand(*mu.shape, 3).movedim(-1, 0).contiguous() for x in vectors)
    inverse, W = (x.expand(*mu.shape, 3, 3).movedim((-2, -1), (0, 1)).contiguous() for x in matrices)
    P, tau, change, step = torch.zeros_like(v), torch.zeros_like(v), torch.zeros_like(v), rise / _STEPS
    for _ in range(_STEPS):
        middle = v[:2] + change[:2] / 2  # of the step, as the last one went
        mu_now = (mu + friction(middle)).clamp_min(0)
        per_push = moment(omega)
        push = W[:, 2] + torch.linalg.cross(applied(inverse, per_push), r, dim=0)  # of the contact point, 1/kg
        by_push, by_slip = against_slip(W, push[:2], v[:2])
        N = (step + (W[2, :2] * by_slip).sum(0)) / (push[2] - (W[2, :2] * by_push).sum(0))
        Q = -(by_slip + by_push * N)
        slip = v[:2] + push[:2] * step / push[2] / 2  # in the middle of the step, without friction
        along = -slip / smooth_norm(slip)
        rate = push[2] + mu_now * (W[2, :2] * along).sum(0)
        slides = smooth_norm(Q) > mu_now * N
        N = torch.where(slides, step / torch.maximum(rate, _FLATTEST * W[2, 2]), N)
        push = torch.cat((torch.where(slides, mu_now * N * along, Q), N[None]))
        P, tau = P + push, tau + per_push * N
        spun = applied(inverse, per_push * N)
        change = applied(W, push) + torch.linalg.cross(spun, r, dim=0)
        v, omega = v + change, omega + spun + applied(inverse, torch.linalg.cross(r, push, dim=0))
    return torch.cat((P, tau)).movedim(0, -1)


def applied(A: Float[Tensor, "k k ..."], x: Float[Tensor, "k ..."]) -> Float[Tensor, "k ..."]:
    """A x, with components as the first axes."""
    return (A * x).sum(1)


def against_slip(W: Float[Tensor, "3 3 ..."], *slips: Float[Tensor, "2 ..."]) -> list[Float[Tensor, "2 ..."]]:
    """The tangential impulses that would make slips, without any along the normal."""
    a, b, c = W[0, 0], W[0, 1], W[1, 1]
    det = a * c - b.square()
    return [torch.stack((c * x - b * y, a * y - b * x)) / det for x, y in slips]


def smooth_norm(vector: Float[Tensor, "2 ..."]) -> Float[Tensor, "..."]:
    """|x| with a derivative where it vanishes."""
    return vector.square().sum(0).clamp_min(_NOTHING).sqrt()


def contact_of(state: State) -> Contact:
    """Return the contact of a state by component."""
    return Contact.of(state.W, state.approach)
