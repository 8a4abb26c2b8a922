"""A contact that sticks springs back sideways."""

import math
from collections.abc import Sequence
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.errors import ContactLearnError
from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.impulse_path import contact_of
from contactlearn.effects.state import Coefficients, State, columns
from contactlearn.laws.contact import Contact, SpatialContact
from contactlearn.laws.hodograph import Hodograph
from contactlearn.laws.wang_mason import routh_path
from contactlearn.mechanics.rigid_body import effective_inertia, matvec
from contactlearn.mechanics.space import BOTH, SPACE

_LEAST = 1e-300  # N s
_ROUNDING = 1e-9  # relative: nearer to its edge a contact counts as on the cone
_STEPS = 16  # of a compression in which the contact sticks
_IMPLICIT = 0.6  # share of a step's end in its mean: above a half a rigid tangent does not ring
_NO_IMPULSE = 1e-60  # (N s)²
_SOFTEST = 0.05  # ε: below it the way back is too steep for a step


class TangentialRestitution(Effect):
    """Where the slip has come to an end it rebounds, as far as the friction cone allows; v_n⁺ stays.

        slip       v_t⁺ → v_t⁺ − s β (|v_t| + ½ ⟨−s W_tn P_n⟩), s = sign v_t, ⟨x⟩ = x where x > 0 and 0 elsewhere
        impulse    P_t → P_t + e_t P_t^c, P_t^c the impulse of compression, if the contact has come to stick in it
        spring     a spring with a dashpot beside it, in series with Coulomb's slider, followed in time

    For a ball (r_x = 0) that grips, the first two turn the slip into v_t⁺ = −β v_t.  They differ where friction just
    suffices.  With `slip` the whole impulse must be in the cone, |v_t| (1 + β)/W_tt ≤ μ P_n, and v_t⁺ changes gradually
    into sliding.  With `impulse` the ball must grip in compression, |v_t|/W_tt ≤ μ P_n/(1 + ε), and what rebounds must
    be in the cone of restitution, e_t |v_t|/W_tt ≤ μ ε P_n/(1 + ε); the ball that grips later does not spring back.  A
    linear law P_t = −k_p v_t and a spring that slips at the cone (Garwin's and Walton's balls) are `slip` with
    β = k_p W_tt − 1.  `spring` is what both approximate: without the dashpot a ball that grips throughout leaves with
    v_t⁺ = v_t cos((1 + ε) π/2 √(W_tt/(c W_nn))), c = k_n/k_t.  It is not friction against the slip.
    """

    place = "wrench"
    source = "Maw, Barber & Fawcett 1976; Walton 1993"
    citations = ("maw1976", "walton1993")
    adds_energy = True


class SlipRebound(TangentialRestitution):
    """v_t⁺ → v_t⁺ − s β (|v_t| + ½ ⟨−s W_tn P_n⟩), by M_c times that, within the cone.

    A tangent that yields gives back a share β of the slip that it stopped.  And it answers late: where the
    normal impulse drives the contact back, at W_tn P_n, a part of that goes unresisted.  Where it drives on,
    the tangent is stretched against it already, and nothing is added.  One that slides throughout is on the cone's
    edge and does not change.  It does not ask when the slip ended (`ImpulseRebound`).
    """

    spaces = BOTH
    form = "slip"
    formula = "v_t⁺ ← v_t⁺ − s β (|v_t| + ½⟨−s W_tn P_n⟩) within the cone, s = sign v_t"
    in_words = "a share {beta:%} of the slip returns"
    beta: Tensor | float = parameter("β", "–", 0.0, 1.0)

    def wrench(self, state: State, wrench: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
        if state.space is SPACE:
            return self._in_space(state, wrench)
        P_t, P_n, tau = wrench.unbind(-1)
        direction, M_c = -state.v_t.sign(), effective_inertia(state.W)
        t, n = M_c[..., 0, 0] * direction, M_c[..., 0, 1] * direction  # impulse per change of v_t, kg
        room = _within_cone(state.coefficients[0], (P_t, P_n), (t, n))
        back = (direction * state.W[..., 0, 1] * P_n).clamp_min(0)  # m/s that the coupling drives against the slip
        change = torch.minimum(self.beta * (state.v_t.abs() + back / 2), room)
        change = torch.where(room < _ROUNDING * state.v_c.norm(dim=-1), 0.0, change)
        return columns(P_t + change * t, P_n + change * n, tau)

    def _in_space(self, state: State, wrench: Float[Tensor, "... n 6"]) -> Float[Tensor, "... n 6"]:
        """Return the wrench in space, where the rebound is against the direction of the slip before contact."""
        P, W = wrench[..., :3], state.W
        direction = -state.v_c[..., :2] / state.slip.clamp_min(1e-300)[..., None]
        per_speed = matvec(effective_inertia(W)[..., :2], direction)
        room = _within_circular_cone(state.coefficients[0], P, per_speed)
        back = ((direction * W[..., :2, 2]).sum(-1) * P[..., 2]).clamp_min(0)
        change = torch.minimum(self.beta * (state.slip + back / 2), room)
        change = torch.where(room < _ROUNDING * state.v_c.norm(dim=-1), 0.0, change)
        return columns(*(P + change[..., None] * per_speed).unbind(-1), *wrench[..., 3:].unbind(-1))


class ImpulseRebound(TangentialRestitution):
    """P_t → P_t + e_t P_t^c within the cone of restitution, if the contact sticks at the end of compression.

    P_t^c stopped the slip and held the contact since; slip and compression are those of Routh's path.  It is not a
    share of the slip that was stopped (`SlipRebound`).
    """

    spaces = BOTH
    form = "impulse"
    formula = "P_t ← P_t + e_t P_t^c within the cone of restitution, P_t^c the impulse of compression where it sticks"
    in_words = "a share {e_t:%} of the tangential impulse of compression returns"
    source = "Garwin 1969; Cross 2002"
    citations = ("garwin1969", "cross2002")
    e_t: Tensor | float = parameter("e_t", "–", 0.0, 1.0)

    def wrench(self, state: State, wrench: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
        if state.space is SPACE:
            return self._in_space(state, wrench)
        P_t, P_n, tau = wrench.unbind(-1)
        mu, _ = state.coefficients
        path = routh_path(contact_of(state), mu)
        p_c = path.p_c
        sticks = (path.p_slip <= p_c) & (path.slope_after.abs() < mu)
        stored, _ = path.impulse(p_c)
        t = stored.sign()
        n = -t * state.W[..., 0, 1] / state.W[..., 1, 1]  # with it v_n⁺ stays
        room = _within_cone(mu, (P_t - stored, P_n - p_c), (t, n)).clamp_min(0)
        change = torch.where(sticks, torch.minimum(self.e_t * stored.abs(), room), 0.0)
        return columns(P_t + change * t, P_n + change * n, tau)

    def _in_space(self, state: State, wrench: Float[Tensor, "... n 6"]) -> Float[Tensor, "... n 6"]:
        """Return the wrench in space, with the impulse of compression as `hodograph` has it."""
        (contact, (c, s)), (mu, _) = SpatialContact.of(state.W, state.approach), state.coefficients
        path = Hodograph(contact, mu)
        end = path.compressed()
        stored = columns(c * end.P_1 - s * end.P_2, s * end.P_1 + c * end.P_2)
        sticks = end.ended & (path.q_1.square() + path.q_2.square() < mu**2)
        size = stored.norm(dim=-1).clamp_min(_LEAST)
        t = stored / size[..., None]
        n = -(t * state.W[..., :2, 2]).sum(-1) / contact.w_nn  # with it v_n⁺ stays
        along = columns(*t.unbind(-1), n)
        room = _within_circular_cone(mu, wrench[..., :3] - columns(*stored.unbind(-1), end.P_n), along).clamp_min(0)
        change = torch.where(sticks, torch.minimum(self.e_t * size, room), 0.0)
        P = wrench[..., :3] + change[..., None] * along
        return columns(*P.unbind(-1), *wrench[..., 3:].unbind(-1))


class SpringRebound(TangentialRestitution):
    """F_t = −(k_n/c) (ξ + T dξ/dt) within |F_t| ≤ μ F_n, ξ the stretch that the slider leaves, T = (1/s − 1) t_c.

    The normal spring compresses within t_c = π/2 √(1/(k_n W_nn)) if nothing else moves, and is 1/ε² times as stiff on
    its way back.  c = k_n/k_t is 1 to 1.5 for elastic spheres (Mindlin 1949).  Where s = 0 the dashpot is rigid and the
    contact that of Routh's path with Stronge's restitution; what the tangent changes is added to the law's wrench.
    """

    spaces = BOTH
    form = "spring"
    formula = "F_t = −(k_n/c)(ξ + (1/s − 1) t_c dξ/dt) within the cone, beside what it is for s = 0"
    in_words = "the tangential spring returns a share {s:%}, and yields {c} times as much as the normal one"
    source = "Maw, Barber & Fawcett 1976; Walton & Braun 1986; Stronge 1994"
    citations = ("maw1976", "walton1986", "stronge1994")
    refines = ("tangential_restitution",)
    s: Tensor | float = parameter("s", "–", 0.0, 1.0)
    c: Tensor | float = parameter("c", "–", 0.3, 3.0, vanishing=None, start=1.2)

    def wrench(self, state: State, wrench: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
        given = (torch.as_tensor(x).to(wrench) for x in (*state.coefficients, self.s, self.c))
        mu, eps, resilience, compliance = torch.broadcast_tensors(*given, wrench[..., 0])[:4]
        both = torch.stack((resilience, torch.zeros_like(resilience)))
        if state.space is SPACE:
            contact, (c, s) = SpatialContact.of(state.W, state.approach)
            changes = (yields - rigid for yields, rigid in _springs_in_space(contact, (mu, eps), both, compliance))
            P_1, P_2, P_n = changes
            return wrench + columns(
                c * P_1 - s * P_2, s * P_1 + c * P_2, P_n, *torch.zeros_like(wrench[..., 3:]).unbind(-1)
            )
        P_t, P_n, tau = wrench.unbind(-1)
        (yields_t, rigid_t), (yields_n, rigid_n) = _integrate_springs(contact_of(state), (mu, eps), both, compliance)
        return columns(P_t + (yields_t - rigid_t), P_n + (yields_n - rigid_n), tau)


def _within_cone(
    mu: Float[Tensor, "..."], impulse: tuple[Tensor, Tensor], direction: tuple[Tensor, Tensor]
) -> Float[Tensor, "..."]:
    """Distance that an impulse (P_t, P_n) can go in a direction (t, n) before |P_t| = μ P_n."""
    (P_t, P_n), (t, n) = impulse, direction
    return torch.minimum(_room(mu * P_n - P_t, t - mu * n), _room(mu * P_n + P_t, -t - mu * n))


def _within_circular_cone(
    mu: Float[Tensor, "..."], impulse: Float[Tensor, "... 3"], direction: Float[Tensor, "... 3"]
) -> Float[Tensor, "..."]:
    """Distance that an impulse in the cone |P_t| ≤ μ P_n of space can go in a direction: the least root ≥ 0 of it."""
    metric = torch.stack(torch.broadcast_tensors(torch.ones_like(mu), torch.ones_like(mu), -mu.square()), -1)
    a, b, c = ((metric * pair).sum(-1) for pair in (direction**2, impulse * direction, impulse**2))
    c, square = c.clamp_max(0), b.square() - a * c.clamp_max(0)
    leaves = square > 0
    root = torch.where(leaves, square, 1.0).sqrt()
    out, back = leaves & (b + root > 0) & (b >= 0), leaves & (a > 0) & (b < 0)
    room = torch.where(out, -c / torch.where(out, b + root, 1.0), torch.inf)
    return torch.where(back, (root - b) / torch.where(back, a, 1.0), room)


def _room(distance: Float[Tensor, "..."], rate: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
    """Distance that an impulse can go at a rate towards an edge of the cone at a `distance`."""
    return torch.where(rate > 0, distance / torch.where(rate > 0, rate, 1.0), torch.inf)


def _integrate_springs(
    contact: Contact, coefficients: Coefficients, resilience: Float[Tensor, "..."], compliance: Float[Tensor, "..."]
) -> tuple[Float[Tensor, "..."], Float[Tensor, "..."]]:
    """Impulse (P_t, P_n) in N s of a contact on springs, in units of time in which k_n W_nn = 1."""
    (w_tt, w_tn, w_nn, v_t, v_n), (mu, eps) = contact, coefficients
    v_t, v_n = v_t + torch.zeros_like(resilience), v_n + torch.zeros_like(resilience)
    stiffer = 1 / eps.clamp_min(_SOFTEST).square()
    dt = 0.5 * math.pi / _STEPS / (1 - w_tn.square() / (w_tt * w_nn)).sqrt()  # of a contact that sticks
    implicit = _IMPLICIT * dt
    recall = resilience / (resilience * implicit + (1 - resilience) * 0.5 * math.pi)
    give = recall * compliance * w_nn
    held = give + implicit * w_tt
    by_stretch, by_slip, by_load = -dt * recall / held, -dt / held, -implicit * w_tn / held  # of what holds the contact
    softer, scale = 1 - stiffer, dt / w_nn
    depth = -0.5 * dt * v_n  # in the middle of a step, as the forces
    constants = (w_tt, w_tn, w_nn, mu, dt, softer, scale, by_stretch, by_slip, by_load, 1 - dt * recall, give)
    return _Springs.apply(*torch.broadcast_tensors(v_t, v_n, depth, *constants))


def _springs_in_space(
    contact: SpatialContact,
    coefficients: Coefficients,
    resilience: Float[Tensor, "..."],
    compliance: Float[Tensor, "..."],
) -> tuple[Float[Tensor, "..."], Float[Tensor, "..."], Float[Tensor, "..."]]:
    """The same along the slip, across it and along the normal: the stretch is a vector, and slips at the round cone."""
    (w_11, w_12, w_22, w_1n, w_2n, w_nn, slip, across, v_n), (mu, eps) = contact, coefficients
    stiffer = 1 / eps.clamp_min(_SOFTEST).square()
    det = w_11 * w_22 - w_12.square()
    coupling = (w_22 * w_1n.square() - 2 * w_12 * w_1n * w_2n + w_11 * w_2n.square()) / (det * w_nn)
    dt = 0.5 * math.pi / _STEPS / (1 - coupling).sqrt()
    implicit = _IMPLICIT * dt
    recall = resilience / (resilience * implicit + (1 - resilience) * 0.5 * math.pi)
    give, kept, scale = recall * compliance * w_nn, 1 - dt * recall, dt / w_nn
    h_11, h_12, h_22 = give + implicit * w_11, implicit * w_12, give + implicit * w_22
    whole = h_11 * h_22 - h_12.square()
    v_1, v_2 = slip + torch.zeros_like(resilience), across + torch.zeros_like(resilience)
    x_1 = x_2 = deepest = P_1 = P_2 = P_n = torch.zeros_like(resilience)
    v_n = v_n + torch.zeros_like(resilience)
    depth = -0.5 * dt * v_n
    for _ in range(2 * _STEPS + 2):
        deepest = torch.maximum(deepest, depth)
        n = (depth + (1 - stiffer) * (deepest - depth)).clamp_min(0) * scale
        b_1 = dt * (recall * x_1 + v_1) + implicit * w_1n * n
        b_2 = dt * (recall * x_2 + v_2) + implicit * w_2n * n
        t_1, t_2 = (h_12 * b_2 - h_22 * b_1) / whole, (h_12 * b_1 - h_11 * b_2) / whole  # what holds the contact
        size = (t_1.square() + t_2.square()).clamp_min(_NO_IMPULSE).sqrt()
        share = torch.where(size > mu * n, mu * n / size, 1.0)
        t_1, t_2 = share * t_1, share * t_2
        x_1, x_2 = kept * x_1 - give * t_1, kept * x_2 - give * t_2
        v_1, v_2 = v_1 + w_11 * t_1 + w_12 * t_2 + w_1n * n, v_2 + w_12 * t_1 + w_22 * t_2 + w_2n * n
        v_n = v_n + w_1n * t_1 + w_2n * t_2 + w_nn * n
        depth = depth - dt * v_n
        P_1, P_2, P_n = P_1 + t_1, P_2 + t_2, P_n + n
    return P_1, P_2, P_n


class _Springs(torch.autograd.Function):
    """Impulses of all steps from (v_t, v_n, depth) at first and constants, with their derivatives by hand.

    Automatic differentiation takes three times as long for so many small operations.
    """

    @staticmethod
    def forward(ctx: Any, *given: Float[Tensor, "..."]) -> tuple[Float[Tensor, "..."], Float[Tensor, "..."]]:
        v_t, v_n, depth, w_tt, w_tn, w_nn, mu, dt, softer, scale, by_stretch, by_slip, by_load, kept, give = given
        deepest = stretch = total_t = total_n = torch.zeros_like(v_n)
        differentiates, steps = any(ctx.needs_input_grad), list[tuple[Tensor, ...]]()
        for _ in range(2 * _STEPS + 2):
            before, deepest = deepest, torch.maximum(deepest, depth)
            P_n = torch.addcmul(depth, softer, deepest - depth).clamp_min(0) * scale
            holding = torch.addcmul(torch.addcmul(by_stretch * stretch, by_slip, v_t), by_load, P_n)
            limit = mu * P_n
            P_t = torch.minimum(torch.maximum(holding, -limit), limit)
            start = depth, before, stretch, v_t, holding
            stretch = torch.addcmul(kept * stretch, give, P_t, value=-1)
            v_t = torch.addcmul(torch.addcmul(v_t, w_tt, P_t), w_tn, P_n)
            v_n = torch.addcmul(torch.addcmul(v_n, w_tn, P_t), w_nn, P_n)
            depth = torch.addcmul(depth, dt, v_n, value=-1)
            total_t, total_n = total_t + P_t, total_n + P_n
            if differentiates:
                steps.append((*start, P_t, P_n, v_n))
        ctx.save_for_backward(*(_adjoints(given, steps) if differentiates else ()))
        return total_t, total_n

    @staticmethod
    def backward(ctx: Any, *grads: Float[Tensor, "..."]) -> tuple[Float[Tensor, "..."], ...]:
        if torch.is_grad_enabled():  # the adjoints that were kept have no derivatives
            raise ContactLearnError(
                "tangential_restitution(spring) has first derivatives alone; those of a covariance are second ones; "
                "take another form, such as impulse"
            )
        return tuple(by_t * grads[0] + by_n * grads[1] for by_t, by_n in ctx.saved_tensors)


def _adjoints(given: Sequence[Float[Tensor, "..."]], steps: Sequence[tuple[Tensor, ...]]) -> list[Tensor]:
    """Derivatives [2, ...] of the impulses (P_t, P_n) of all steps in each of what `_Springs` is given."""
    _, _, _, w_tt, w_tn, w_nn, mu, dt, softer, scale, by_stretch, by_slip, by_load, kept, give = given
    to_t, to_n = torch.eye(2).to(mu).view(2, 2, *[1] * mu.ndim)
    depth = deepest = stretch = v_t = v_n = torch.zeros(2, *mu.shape).to(mu)  # adjoints after a step, then before it
    of_constants = [torch.zeros_like(depth) for _ in given[3:]]
    for depth_k, deepest_k, stretch_k, slip, holding, P_t, P_n, v_n_after in reversed(steps):
        holds, deeper = (holding.abs() <= mu * P_n).to(mu), (depth_k >= deepest_k).to(mu)
        side, room = (1 - holds) * holding.sign(), (deepest_k - depth_k).clamp_min(0)
        v_n = torch.addcmul(v_n, dt, depth, value=-1)
        tangential = torch.addcmul(torch.addcmul(torch.addcmul(to_t, v_n, w_tn), v_t, w_tt), stretch, give, value=-1)
        held, limited = tangential * holds, tangential * side
        normal = torch.addcmul(torch.addcmul(to_n, v_n, w_nn), v_t, w_tn)
        normal = torch.addcmul(torch.addcmul(normal, limited, mu), held, by_load)
        inside = normal * ((P_n > 0) * scale)
        products = (
            *((v_t, P_t), (v_n, P_t), (v_n, P_n), (limited, P_n), (depth, -v_n_after), (inside, room), (normal, P_n)),
            *((held, stretch_k), (held, slip), (held, P_n), (stretch, stretch_k), (stretch, -P_t)),
        )
        for total, (adjoint, value) in zip(of_constants, products, strict=True):
            total.addcmul_(adjoint, value)
        of_constants[1].addcmul_(v_t, P_n)  # w_tn acts twice
        stretch = torch.addcmul(stretch * kept, held, by_stretch)
        v_t = torch.addcmul(v_t, held, by_slip)
        depth, deepest = torch.addcmul(depth, inside, 1 - softer), torch.addcmul(deepest, inside, softer)
        depth, deepest = torch.addcmul(depth, deepest, deeper), deepest * (1 - deeper)
    of_constants[6] /= scale
    return [v_t, v_n, depth, *of_constants]
