"""The body turns and falls while the contact lasts, in the plane and in space."""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.impulse_path import against_slip, applied, smooth_norm
from contactlearn.effects.state import State
from contactlearn.laws.spring_dashpot import damping
from contactlearn.mechanics import rigid_body
from contactlearn.mechanics.rigid_body import GRAVITY, matvec, turn_quaternion
from contactlearn.mechanics.space import BOTH, PLANE

_STEPS, _MOST = 12, 20  # of a contact that sticks, and of one that friction slows down
_SHARE = 0.5  # of the depth by which the contact point is nearer to the mass centre: body and floor yield alike
_SOFTEST = 0.05  # ε: below it the way back is too steep for a step
_NOTHING = 1e-60  # below which a square is none
_TURN, _FLATTEST = 1e-4, 10.0  # rad; largest radius of curvature relative to the height, instead of that of a flat side


class ContactDuration(Effect):
    """A contact lasts: the body turns, r with it, precesses in space, and falls.

        dashpot      a spring with a dashpot beside it, T the same in every pose, as of engines
        hysteretic   a spring that is 1/ε² times as stiff on its way back, T √(1/(m W_nn)), as of one material

    The path is followed in time with r of the body's shape and with gravity, until the force vanishes, and what it
    changes beside T = 0 is added to the law's wrench.  T is the duration without friction.  A dashpot pushes from the
    first moment on, a spring later; the tangent is rigid: the tangential ratio k_t/k_n is 1/c of
    `tangential_restitution:spring`, which a model may have beside it, and 400 drops determine both (correlation −0.1).
    It is neither a late frame (`sampling_delay`, `gravity_impulse`) nor a tangent that springs back.
    """

    place = "wrench"
    in_words = "the contact lasts {T}"
    refines = (
        *("sampling_delay", "gravity_impulse", "rolling_resistance", "spin_damping"),
        *("contact_patch", "orientation_dependent_moment"),
    )
    spaces = BOTH
    needs_shape = True
    adds_energy = True


class DampedContact(ContactDuration):
    """Body and floor yield alike, and damping ends the contact.

    Of soft contacts of MuJoCo T is right within 2 % at 0.05 rad/s of noise, and 4 to 10 % too long at 0.5 rad/s, stated
    or not, which its standard error does not know; of its own contacts it is not (3.49 for 3.5 ms).  It is not a spring
    that is stiffer on its way back (`HystereticContact`).
    """

    form = "dashpot"
    formula = "P ← P + P(T) − P(0), P(T) with r(θ(t)) and gravity while a spring and dashpot push"
    source = "Hunt & Crossley 1975; Tsuji, Tanaka & Ishida 1992"
    citations = ("hunt1975", "tsuji1992")
    T: Tensor | float = parameter("T", "s", 0.0, 0.02)

    def wrench(self, state: State, wrench: Float[Tensor, "... n D"]) -> Float[Tensor, "... n D"]:
        return _with_duration(state, wrench, self.T, hysteretic=False)


class HystereticContact(ContactDuration):
    """The floor yields and takes what is lost on the way back; T is the duration of a central contact, W_nn = 1/m.

    The stiffness is the same in every pose, so that a contact far from the mass centre is shorter.  It is not a spring
    with a dashpot (`DampedContact`).
    """

    form = "hysteretic"
    formula = "P ← P + P(T) − P(0), P(T) with r(θ(t)) and gravity while a spring pushes, 1/ε² as stiff on its way back"
    source = "Walton & Braun 1986; Stronge 1990"
    citations = ("walton1986", "stronge1990")
    T: Tensor | float = parameter("T", "s", 0.0, 0.02)

    def wrench(self, state: State, wrench: Float[Tensor, "... n D"]) -> Float[Tensor, "... n D"]:
        return _with_duration(state, wrench, self.T, hysteretic=True)


def _with_duration(
    state: State, wrench: Float[Tensor, "... n D"], T: Tensor | float, *, hysteretic: bool
) -> Float[Tensor, "... n D"]:
    """Add to a wrench what a duration T in s changes beside none."""
    T = torch.as_tensor(T).to(wrench) + torch.zeros_like(wrench[..., 0])
    follow = _after if state.space is PLANE else _after_in_space
    lasting, instant = follow(state, torch.stack((T, torch.zeros_like(T))), hysteretic=hysteretic)
    change = lasting - instant
    body = state.mass, state.world_inertia, state.r
    return wrench + rigid_body.measured_wrench(*body, torch.zeros_like(change), change)


@dataclass(frozen=True)
class _Normal:
    """What pushes along the normal, by a clock in which the spring has k W_nn = 1.

    Args:
        step: of the clock.
        time: of a step in s.
        stiffer: 1/ε² of a spring without a dashpot; None with one.
        yields: factor of the implicit part of a step.
        share: of the depth by which the contact point is nearer to the mass centre.
        steps: at most, of a contact that friction slows down.
    """

    step: Tensor
    time: Tensor
    stiffer: Tensor | None
    yields: Tensor
    share: float
    steps: int

    @classmethod
    def of(cls, state: State, w_nn: Tensor, coupling: Tensor, duration: Tensor, *, hysteretic: bool) -> "_Normal":
        """Choose the clock; `coupling` is the share of W_nn that a tangent which holds takes away."""
        eps = torch.as_tensor(state.coefficients[1]).to(duration)
        slower = (1 - coupling).sqrt()
        if hysteretic:
            eps = eps.clamp_min(_SOFTEST)
            step = 0.5 * math.pi / (_STEPS * slower)
            time = step * duration / (0.5 * math.pi * (1 + eps)) / (state.mass * w_nn).sqrt()
            return cls(step, time, eps.square().reciprocal(), torch.zeros_like(step), 0.0, 2 * _STEPS + 2)
        damped = damping(eps)
        step = damped.duration / (_STEPS * slower)
        yields = 0.5 * step * (0.5 * step + 2 * damped.ratio) / w_nn
        return cls(step, step * duration / damped.duration, None, yields, _SHARE, _MOST)

    def push(self, depth: Tensor, deepest: Tensor, v_n: Tensor, w_nn: Tensor) -> tuple[Tensor, Tensor]:
        """The impulse of a step but for its implicit part in N s, and the greatest depth so far."""
        if self.stiffer is None:
            return self.step * depth / w_nn - 2 * self.yields * v_n, deepest
        depth = depth - 0.5 * self.step * v_n  # in the middle of the step
        deepest = torch.maximum(deepest, depth)
        return self.step * (depth + (1 - self.stiffer) * (deepest - depth)).clamp_min(0) / w_nn, deepest


def _after(state: State, duration: Float[Tensor, "..."], *, hysteretic: bool = False) -> Float[Tensor, "... 3"]:
    """Velocity (v_x, v_y, ω) after a contact of a duration."""
    mu, W = torch.as_tensor(state.coefficients[0]).to(duration), state.W
    w_0, coupling = W[..., 1, 1], W[..., 0, 1].square() / (W[..., 0, 0] * W[..., 1, 1])
    normal = _Normal.of(state, w_0, coupling, duration, hysteretic=hysteretic)
    step, time, yields = normal.step, normal.time, normal.yields
    curvature = _curvature_radius(state)
    v_x, v_y, omega = (part + torch.zeros_like(duration) for part in state.v_pre.unbind(-1))
    x, y = (part + torch.zeros_like(duration) for part in state.r.unbind(-1))
    depth, deepest, pushes = torch.zeros_like(duration), torch.zeros_like(duration), torch.ones_like(duration)
    for _ in range(normal.steps):
        x, y = _turned(0.5 * time * omega, x, y, curvature)  # in the middle of the step
        r_x, r_y = x, y + normal.share * depth * time / step
        w_tn = -r_x * r_y / state.inertia
        w_tt, w_nn = 1 / state.mass + r_y.square() / state.inertia, 1 / state.mass + r_x.square() / state.inertia
        v_t, v_n = v_x - r_y * omega, v_y + r_x * omega
        push, deepest = normal.push(depth, deepest, v_n, w_0)
        N = (push + yields * w_tn * v_t / w_tt) / (1 + yields * (w_nn - w_tn.square() / w_tt))
        Q = -(v_t + w_tn * N) / w_tt
        slides, slope = Q.abs() > mu * N, mu * Q.sign()
        N = torch.where(slides, push / (1 + yields * (w_nn + slope * w_tn)), N)
        pushes = torch.where(N > 0, pushes, 0.0)
        N, Q = N * pushes, torch.where(slides, slope * N, Q) * pushes
        omega = omega + (r_x * N - r_y * Q) / state.inertia
        v_x, v_y = v_x + Q / state.mass, v_y + N / state.mass - GRAVITY * time * pushes
        depth = depth - 0.5 * step * (v_n + v_y + r_x * omega)
        x, y = _turned(0.5 * time * omega, x, y, curvature)
    return torch.stack((v_x, v_y, omega), -1)


def _turned(turn: Tensor, x: Tensor, y: Tensor, curvature: Tensor) -> tuple[Tensor, Tensor]:
    """The contact point after a turn in rad, by Cayley's rotation and the shift along the outline."""
    whole = 4 + turn.square()
    c, s = (8 - whole) / whole, 4 * turn / whole
    return c * x - s * y - turn * curvature, s * x + c * y


def _after_in_space(
    state: State, duration: Float[Tensor, "..."], *, hysteretic: bool = False
) -> Float[Tensor, "... 6"]:
    """The same (v, ω) in space: the slip has two directions, and the body keeps its angular momentum as it turns.

    Components of vectors and matrices are the first axes here, which makes small products four times as fast.
    """
    mu, batch, inertia = torch.as_tensor(state.coefficients[0]).to(duration), duration.shape, state.world_inertia
    matrices = (torch.linalg.inv(inertia), _surface_shift(state))
    inverse, shift = (x.expand(*batch, 3, 3).movedim((-2, -1), (0, 1)).contiguous() for x in matrices)
    vectors = (state.v_pre[..., :3], state.r, matvec(inertia, state.v_pre[..., 3:]))
    v, r, momentum = (x.expand(*batch, 3).movedim(-1, 0).contiguous() for x in vectors)
    W = _admittance(1 / state.mass, r, inverse)
    w_0, (held,) = W[2, 2], against_slip(W, W[:2, 2])
    normal = _Normal.of(state, w_0, (W[:2, 2] * held).sum(0) / w_0, duration, hysteretic=hysteretic)
    step, time, yields = normal.step, normal.time, normal.yields
    omega = applied(inverse, momentum)
    depth, deepest, pushes = torch.zeros_like(duration), torch.zeros_like(duration), torch.ones_like(duration)
    down = torch.eye(3)[2].to(v).view(3, *[1] * (v.ndim - 1))
    for _ in range(normal.steps):
        turn = 0.5 * time * pushes * omega  # until the middle of the step
        arm, turned = _rotated(turn, r, inverse, shift)
        raised = arm + down * (normal.share * depth * time / step)
        W = _admittance(1 / state.mass, raised, turned)
        velocity = v + torch.linalg.cross(applied(turned, momentum), raised, dim=0)
        coupling, v_n = W[:2, 2], velocity[2]
        push, deepest = normal.push(depth, deepest, v_n, w_0)
        by_push, by_slip = against_slip(W, coupling, velocity[:2])
        held = 1 + yields * (W[2, 2] - (coupling * by_push).sum(0))
        N = (push + yields * (coupling * by_slip).sum(0)) / held
        Q = -(by_slip + by_push * N)
        slip = velocity[:2] + coupling * N  # after the step, without friction
        along = -slip / smooth_norm(slip)
        slides = smooth_norm(Q) > mu * N
        N = torch.where(slides, push / (1 + yields * (W[2, 2] + mu * (coupling * along).sum(0))), N)
        pushes = torch.where(N > 0, pushes, 0.0)
        P = torch.cat((torch.where(slides, mu * N * along, Q), N[None])) * pushes
        momentum = momentum + torch.linalg.cross(raised, P, dim=0)
        v = v + P / state.mass - GRAVITY * time * pushes * down
        after = applied(turned, momentum)
        depth = depth - 0.5 * step * (v_n + v[2] + torch.linalg.cross(after, raised, dim=0)[2])
        r, inverse = _rotated(0.5 * time * pushes * after, arm, turned, shift)
        omega = applied(inverse, momentum)
    return torch.cat((v, omega)).movedim(0, -1)


def _product(A: Float[Tensor, "3 3 ..."], B: Float[Tensor, "3 3 ..."]) -> Float[Tensor, "3 3 ..."]:
    return (A[:, :, None] * B).sum(1)


def _admittance(
    light: Float[Tensor, "..."], r: Float[Tensor, "3 ..."], inverse: Float[Tensor, "3 3 ..."]
) -> Float[Tensor, "3 3 ..."]:
    """Velocity of the contact point per impulse, 1/m − [r]× I⁻¹ [r]×."""
    moment = _cross(r)
    eye = torch.eye(3).to(r).view(3, 3, *[1] * (r.ndim - 1))
    return eye * light - _product(moment, _product(inverse, moment))


def _rotated(
    turn: Float[Tensor, "3 ..."], r: Tensor, inverse: Tensor, shift: Tensor
) -> tuple[Float[Tensor, "3 ..."], Float[Tensor, "3 3 ..."]]:
    """The contact point and I⁻¹ after a turn in rad, by Cayley's rotation and the shift along the surface."""
    K = _cross(turn)
    share = 4 / (4 + turn.square().sum(0))
    R = torch.eye(3).to(r).view(3, 3, *[1] * (r.ndim - 1)) + share * (K + 0.5 * _product(K, K))
    return applied(R, r) + applied(shift, turn), _product(_product(R, inverse), R.transpose(0, 1))


def _cross(vector: Float[Tensor, "3 ..."]) -> Float[Tensor, "3 3 ..."]:
    """The matrix of a cross product with a vector from the left."""
    x, y, z = vector
    zero = torch.zeros_like(x)
    return torch.stack((zero, -z, y, z, zero, -x, -y, x, zero)).unflatten(0, (3, 3))


def _surface_shift(state: State) -> Float[Tensor, "... n 3 3"]:
    """By what the contact point moves along the surface in m for a turn in rad about each axis; 0 of a corner."""
    columns, height = list[Tensor](), state.r[..., 2:].abs()
    for axis in torch.eye(3).to(state.r)[:2]:
        turns = (turn_quaternion(state.orientation, sign * _TURN * axis) for sign in (1, -1))
        ends = [state.contact_points(turned) for turned in turns]
        by_turn = (ends[0] - ends[1]) / (2 * _TURN) - torch.linalg.cross(axis.expand_as(state.r), state.r)
        along = by_turn * torch.tensor((1.0, 1.0, 0.0)).to(by_turn)
        most = _FLATTEST * height / along.norm(dim=-1, keepdim=True).clamp_min(_NOTHING)
        columns.append(along * most.clamp_max(1))
    return torch.stack((*columns, torch.zeros_like(state.r)), -1)


def _curvature_radius(state: State) -> Float[Tensor, "... n"]:
    """Radius of curvature R [..., N] of the outline at the contact point in m: dr/dθ = (−(r_y + R), r_x)."""
    left, right = (state.contact_points(state.theta + turn)[..., 0] for turn in (-_TURN, _TURN))
    height = state.contact_points(state.theta)[..., 1]
    return torch.minimum((left - right) / (2 * _TURN) - height, -_FLATTEST * height).clamp_min(0)
