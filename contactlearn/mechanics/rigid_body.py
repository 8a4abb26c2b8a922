"""Planar rigid-body contact mechanics as pure functions on tensors.

World axes: x right, y up, θ counter-clockwise; contact axes: tangent t = +x, normal n = +y.
Impulses act on the body.  Batch axes lead, N is the number of trials, everything is SI and
float64.  Symbols are those of docs/notation.md:

    J   = [[1, 0, −r_y], [0, 1, r_x]]        contact Jacobian, rows t then n
    W   = J M⁻¹ Jᵀ                           inverse effective inertia at the contact, 1/kg
    M_c = W⁻¹                                effective inertia at the contact, kg
    v_c = J v                                velocity of the contact point, m/s
    M (v⁺ − v⁻) = Jᵀ P + (0, 0, τ)ᵀ          equation of motion, Eq. (2.2) with a moment τ

Source: Fazeli et al. (2017), Section 2; the moment τ about the contact point is what no point
contact can transmit.
"""

import torch
from jaxtyping import Bool, Float
from torch import Tensor

GRAVITY = 9.81
"""m/s²; it differs by 0.3 % over the earth."""


def rotate(vector: Float[Tensor, "*#batch 2"], angle: Float[Tensor, "*#batch"]) -> Float[Tensor, "*#batch 2"]:
    """The vector [..., 2] turned counter-clockwise by an angle [...] in rad."""
    c, s = angle.cos(), angle.sin()
    x, y = vector.unbind(-1)
    return torch.stack((c * x - s * y, s * x + c * y), -1)


def contact_jacobian(r: Float[Tensor, "*#batch 2"]) -> Float[Tensor, "*#batch 2 3"]:
    """Contact Jacobian J [..., 2, 3] (rows t, n) from the contact point r [..., 2] in m."""
    one, zero = torch.ones_like(r[..., 0]), torch.zeros_like(r[..., 0])
    rows_t = torch.stack((one, zero, -r[..., 1]), -1)
    rows_n = torch.stack((zero, one, r[..., 0]), -1)
    return torch.stack((rows_t, rows_n), -2)


def inverse_inertia(
    mass: Float[Tensor, "*#batch"], inertia: Float[Tensor, "*#batch"], r: Float[Tensor, "*#batch 2"]
) -> Float[Tensor, "*#batch 2 2"]:
    """Inverse effective inertia W [..., 2, 2] in 1/kg at the contact point r [..., 2]."""
    r_x, r_y = r.unbind(-1)
    w_tt = 1 / mass + r_y**2 / inertia
    w_tn = -r_x * r_y / inertia
    w_nn = 1 / mass + r_x**2 / inertia
    return torch.stack((torch.stack((w_tt, w_tn), -1), torch.stack((w_tn, w_nn), -1)), -2)


def effective_inertia(W: Float[Tensor, "*#batch 2 2"]) -> Float[Tensor, "*#batch 2 2"]:
    """Effective inertia M_c = W⁻¹ [..., 2, 2] in kg."""
    w_tt, w_tn, w_nn = W[..., 0, 0], W[..., 0, 1], W[..., 1, 1]
    adjugate = torch.stack((torch.stack((w_nn, -w_tn), -1), torch.stack((-w_tn, w_tt), -1)), -2)
    return adjugate / (w_tt * w_nn - w_tn**2)[..., None, None]


def contact_velocity(r: Float[Tensor, "*#batch 2"], v: Float[Tensor, "*#batch 3"]) -> Float[Tensor, "*#batch 2"]:
    """Velocity v_c = J v [..., 2] of the contact point in m/s, from v [..., 3] = (v_x, v_y, ω)."""
    (r_x, r_y), (v_x, v_y, omega) = r.unbind(-1), v.unbind(-1)
    return torch.stack((v_x - r_y * omega, v_y + r_x * omega), -1)


def apply_wrench(
    mass: Float[Tensor, "*#batch"],
    inertia: Float[Tensor, "*#batch"],
    r: Float[Tensor, "*#batch 2"],
    v: Float[Tensor, "*#batch 3"],
    wrench: Float[Tensor, "*#batch 3"],
) -> Float[Tensor, "*#batch 3"]:
    """Velocity v⁺ [..., 3] after the wrench (P_t, P_n, τ) [..., 3] in (N s, N s, N m s)."""
    (r_x, r_y), (p_t, p_n, tau) = r.unbind(-1), wrench.unbind(-1)
    spin = r_x * p_n - r_y * p_t + tau
    return v + torch.stack((p_t / mass, p_n / mass, spin / inertia), -1)


def velocity_per_wrench(
    mass: Float[Tensor, "*#batch"], inertia: Float[Tensor, "*#batch"], r: Float[Tensor, "*#batch 2"]
) -> Float[Tensor, "*#batch 3 3"]:
    """Derivative [..., 3, 3] of v⁺ (v_x, v_y, ω) in the wrench (P_t, P_n, τ): M⁻¹ (Jᵀ, (0, 0, 1)ᵀ)."""
    turning = torch.stack((torch.zeros_like(mass), torch.zeros_like(mass), torch.ones_like(mass)), -1)
    columns = torch.cat((contact_jacobian(r).mT, turning[..., None]), -1)
    return columns / torch.stack((mass, mass, inertia), -1)[..., None]


def measured_wrench(
    mass: Float[Tensor, "*#batch"],
    inertia: Float[Tensor, "*#batch"],
    r: Float[Tensor, "*#batch 2"],
    v_pre: Float[Tensor, "*#batch 3"],
    v_post: Float[Tensor, "*#batch 3"],
) -> Float[Tensor, "*#batch 3"]:
    """The one wrench (P_t, P_n, τ) [..., 3] that takes v_pre to v_post: inverse of `apply_wrench`."""
    (dv_x, dv_y, domega), (r_x, r_y) = (v_post - v_pre).unbind(-1), r.unbind(-1)
    p_t, p_n = mass * dv_x, mass * dv_y
    tau = inertia * domega - (r_x * p_n - r_y * p_t)
    return torch.stack((p_t, p_n, tau), -1)


def least_squares_impulse(
    mass: Float[Tensor, "*#batch"],
    inertia: Float[Tensor, "*#batch"],
    r: Float[Tensor, "*#batch 2"],
    dv: Float[Tensor, "*#batch 3"],
) -> Float[Tensor, "*#batch 2"]:
    """Impulse P [..., 2] that minimises ‖Δv − M⁻¹JᵀP‖₂ over Δ(v_x, v_y, ω) [..., 3], unweighted.

    What the paper's authors identified with.  It adds metres to radians, so ω (tens of rad/s)
    outweighs the velocities: it is not the momentum change m Δv unless τ = 0.
    """
    # In u = P/m the residual is (Δv_x − u_t, Δv_y − u_n, Δω − κ·u) with κ = m (−r_y, r_x)/I, so the
    # normal equations (1 + κκᵀ) u = Δv + κ Δω are inverted by Sherman and Morrison's formula.
    kappa = torch.stack((-r[..., 1], r[..., 0]), -1) * (mass / inertia)[..., None]
    rhs = dv[..., :2] + kappa * dv[..., 2:]
    u = rhs - kappa * ((kappa * rhs).sum(-1) / (1 + (kappa**2).sum(-1)))[..., None]
    return mass[..., None] * u


def energy_excess(
    W: Float[Tensor, "*#batch 2 2"], v_c: Float[Tensor, "*#batch 2"], P: Float[Tensor, "*#batch 2"]
) -> Float[Tensor, "*#batch"]:
    """Kinetic energy gained [...] in J: ½ Pᵀ W P + Pᵀ v_c.  At most 0 inside the energy ellipse.

    The energy ellipse, Eq. (2.5) with α = 1, is (P + M_c v_c)ᵀ W (P + M_c v_c) = v_cᵀ M_c v_c.
    """
    WP = (W @ P[..., None])[..., 0]
    return (P * (0.5 * WP + v_c)).sum(-1)


def energy_ellipse(
    W: Float[Tensor, "*#batch 2 2"], v_c: Float[Tensor, "*#batch 2"], points: int = 181
) -> Float[Tensor, "*#batch {points} 2"]:
    """Boundary of the energy ellipse as impulses [..., points, 2] in N s; it passes through P = 0."""
    centre = -(effective_inertia(W) @ v_c[..., None])[..., 0]
    radius = (-(centre * v_c).sum(-1)).clamp_min(0).sqrt()
    angle = torch.linspace(0, 2 * torch.pi, points, dtype=W.dtype, device=W.device)
    circle = torch.stack((angle.cos(), angle.sin()), -1)
    # W = L Lᵀ, so |Lᵀ (P − centre)| = radius on the ellipse.
    L = torch.linalg.cholesky(W)
    offsets = torch.linalg.solve_triangular(L.mT, circle.mT, upper=True).mT
    return centre[..., None, :] + radius[..., None, None] * offsets


def admissible(
    W: Float[Tensor, "*#batch 2 2"],
    v_c: Float[Tensor, "*#batch 2"],
    P: Float[Tensor, "*#batch 2"],
    tolerance: float = 1e-9,
) -> Bool[Tensor, "*#batch"]:
    """Whether P [..., 2] gains no energy, pulls nothing and leaves no penetration: bool [...].

    `tolerance` is relative: to the incident energy v_cᵀ M_c v_c, momentum and speed.
    """
    momentum = -(effective_inertia(W) @ v_c[..., None])[..., 0]
    energy = -(momentum * v_c).sum(-1)
    v_n = v_c[..., 1] + (W[..., 1, :] * P).sum(-1)
    return (
        (energy_excess(W, v_c, P) <= tolerance * energy)
        & (P[..., 1] >= -tolerance * momentum.norm(dim=-1))
        & (v_n >= -tolerance * v_c.norm(dim=-1))
    )
