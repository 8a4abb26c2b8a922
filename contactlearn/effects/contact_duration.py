"""The body turns and falls while the contact lasts."""

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import Effect, parameter
from contactlearn.effects.state import State
from contactlearn.laws.spring_dashpot import damping
from contactlearn.mechanics import rigid_body
from contactlearn.mechanics.rigid_body import GRAVITY

_STEPS, _MOST = 12, 20  # of a contact that sticks, and of one that friction slows down
_SHARE = 0.5  # of the depth by which the contact point is nearer to the mass centre: body and floor yield alike
_TURN, _FLATTEST = 1e-4, 10.0  # rad; largest radius of curvature relative to the height, instead of that of a flat side


class ContactDuration(Effect):
    """A contact on a spring with a dashpot lasts T: the body turns, r with it, and falls.

    The path of `spring_dashpot` is followed in time with r(θ) of the body's shape and with gravity, until the force
    vanishes, and what it changes beside T = 0 is added to the law's wrench.  T is the duration without friction, the
    same in every pose; where the stiffness is the same instead, it is a mean.  Of soft contacts of MuJoCo T is right
    within 2 % at 0.05 rad/s of noise, and 4 to 10 % too long at 0.5 rad/s, stated or not, which its standard error does
    not know; of its own contacts it is not (3.49 for 3.5 ms).  The tangent is rigid: the tangential ratio k_t/k_n is
    1/c of `tangential_restitution:spring`, which a model may have beside it, and 400 drops determine both (correlation
    −0.1).  It is neither a late frame (`sampling_delay`, `gravity_impulse`) nor a tangent that springs back.
    """

    in_words = "the contact lasts {T}"
    formula = "P ← P + P(T) − P(0), P(T) with r(θ(t)) and gravity while a spring and dashpot push"
    source = "Hunt & Crossley 1975; Tsuji, Tanaka & Ishida 1992"
    citations = ("hunt1975", "tsuji1992")
    refines = (
        *("sampling_delay", "gravity_impulse", "rolling_resistance", "spin_damping"),
        *("contact_patch", "orientation_dependent_moment"),
    )
    needs_shape = True
    adds_energy = True
    T: Tensor | float = parameter("T", "s", 0.0, 0.02)

    def wrench(self, state: State, wrench: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n 3"]:
        T = torch.as_tensor(self.T).to(wrench) + torch.zeros_like(wrench[..., 0])
        lasting, instant = _after(state, torch.stack((T, torch.zeros_like(T))))
        change = lasting - instant
        body = state.mass, state.inertia, state.r
        return wrench + rigid_body.measured_wrench(*body, torch.zeros_like(change), change)


def _after(state: State, duration: Float[Tensor, "..."]) -> Float[Tensor, "... 3"]:
    """Velocity (v_x, v_y, ω) after a contact that is followed by a clock in which the spring has k W_nn = 1."""
    mu, eps = (torch.as_tensor(x).to(duration) for x in state.coefficients)
    damped, W = damping(eps), state.W
    w_0, coupling = W[..., 1, 1], W[..., 0, 1].square() / (W[..., 0, 0] * W[..., 1, 1])
    step = damped.duration / (_STEPS * (1 - coupling).sqrt())
    yields = 0.5 * step * (0.5 * step + 2 * damped.ratio) / w_0
    time = step * duration / damped.duration  # of a step, s
    curvature = _curvature_radius(state)
    v_x, v_y, omega = (part + torch.zeros_like(duration) for part in state.v_pre.unbind(-1))
    x, y = (part + torch.zeros_like(duration) for part in state.r.unbind(-1))
    depth, pushes = torch.zeros_like(duration), torch.ones_like(duration)
    for _ in range(_MOST):
        turn = 0.5 * time * omega  # until the middle of the step
        r_x, r_y = x - turn * (y + curvature), y + turn * x + _SHARE * depth * time / step
        w_tn = -r_x * r_y / state.inertia
        w_tt, w_nn = 1 / state.mass + r_y.square() / state.inertia, 1 / state.mass + r_x.square() / state.inertia
        v_t, v_n = v_x - r_y * omega, v_y + r_x * omega
        push = step * depth / w_0 - 2 * yields * v_n
        N = (push + yields * w_tn * v_t / w_tt) / (1 + yields * (w_nn - w_tn.square() / w_tt))
        Q = -(v_t + w_tn * N) / w_tt
        slides, slope = Q.abs() > mu * N, mu * Q.sign()
        N = torch.where(slides, push / (1 + yields * (w_nn + slope * w_tn)), N)
        pushes = torch.where(N > 0, pushes, 0.0)
        N, Q = N * pushes, torch.where(slides, slope * N, Q) * pushes
        before, omega = omega, omega + (r_x * N - r_y * Q) / state.inertia
        v_x, v_y = v_x + Q / state.mass, v_y + N / state.mass - GRAVITY * time * pushes
        depth = depth - 0.5 * step * (v_n + v_y + r_x * omega)
        turn = 0.5 * time * (before + omega)
        x, y = x - turn * (y + curvature), y + turn * x
    return torch.stack((v_x, v_y, omega), -1)


def _curvature_radius(state: State) -> Float[Tensor, "... n"]:
    """Radius of curvature R [..., N] of the outline at the contact point in m: dr/dθ = (−(r_y + R), r_x)."""
    left, right = (state.contact_points(state.theta + turn)[..., 0] for turn in (-_TURN, _TURN))
    height = state.contact_points(state.theta)[..., 1]
    return torch.minimum((left - right) / (2 * _TURN) - height, -_FLATTEST * height).clamp_min(0)
