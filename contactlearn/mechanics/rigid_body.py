"""Rigid-body contact mechanics in the plane and in space as pure functions on tensors.

World axes of the plane: x right, y up, θ counter-clockwise; contact axes: tangent t = +x, normal n = +y.  In space z is
up, and the contact axes are those of the world, the normal last.  Impulses act on the body.  Batch axes lead, N is the
number of trials, everything is SI and float64.  Symbols are those of docs/notation.md:

    J   = [[1, 0, −r_y], [0, 1, r_x]]        contact Jacobian, rows t then n; in space (1, −[r]×)
    W   = J M⁻¹ Jᵀ                           inverse effective inertia at the contact, 1/kg
    M_c = W⁻¹                                effective inertia at the contact, kg
    v_c = J v                                velocity of the contact point, m/s
    M (v⁺ − v⁻) = Jᵀ P + (0, 0, τ)ᵀ          equation of motion, Eq. (2.2) with a moment τ

Positions, impulses and velocities of the contact have d = 2 or 3 components, velocities and wrenches D = 3 or 6.  The
moment of inertia is [..., N] in the plane, and in space [..., N, 3, 3] in world axes (`inertia_in_world`).  Only
`moment`, `swept` and `spin`, of which the rest is made, and W know the dimension.

Source: Fazeli et al. (2017), Section 2; the moment τ about the contact point is what no point
contact can transmit.
"""

import numpy as np
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


def rotation(quaternion: Float[Tensor, "*batch 4"]) -> Float[Tensor, "*batch 3 3"]:
    """Rotation matrix R [..., 3, 3], body to world, of a quaternion (w, x, y, z) [..., 4] of any length."""
    w, x, y, z = (quaternion / quaternion.norm(dim=-1, keepdim=True)).unbind(-1)
    x2, y2, z2 = 2 * x, 2 * y, 2 * z
    xx, yy, zz, xy, xz, yz, wx, wy, wz = x * x2, y * y2, z * z2, x * y2, x * z2, y * z2, w * x2, w * y2, w * z2
    elements = (1 - (yy + zz), xy - wz, xz + wy, xy + wz, 1 - (xx + zz), yz - wx, xz - wy, yz + wx, 1 - (xx + yy))
    return torch.stack(elements, -1).unflatten(-1, (3, 3))


def turn_quaternion(
    quaternion: Float[Tensor, "*#batch 4"], vector: Float[Tensor, "*#batch 3"]
) -> Float[Tensor, "*#batch 4"]:
    """Quaternion [..., 4] of a body that is turned by a rotation vector [..., 3] in rad, in world axes."""
    half = vector.norm(dim=-1, keepdim=True) / 2
    c, s = half.cos(), torch.sinc(half / torch.pi) * vector / 2
    w, u = quaternion.split((1, 3), -1)
    s, u = torch.broadcast_tensors(s, u)
    return torch.cat((c * w - (s * u).sum(-1, keepdim=True), c * u + w * s + torch.linalg.cross(s, u)), -1)


def orientation_of(q: Float[Tensor, "*batch pose"]) -> Float[Tensor, "..."]:
    """θ [...] in rad of poses in the plane, or quaternions [..., 4] of those in space."""
    return q[..., 2] if q.shape[-1] == 3 else q[..., 3:]


def displaced_pose(
    q: Float[Tensor, "*#batch pose"], moved: Float[Tensor, "*#batch D"]
) -> Float[Tensor, "*#batch pose"]:
    """Pose [..., 3 or 7] after a displacement [..., D] in m and rad, in space with a rotation vector in world axes."""
    if q.shape[-1] == 3:
        return q + moved
    return torch.cat((q[..., :3] + moved[..., :3], turn_quaternion(q[..., 3:], moved[..., 3:])), -1)


def inertia_in_world(inertia: Float[Tensor, "..."], q: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
    """Moment of inertia `I` in world axes from that of the body and its pose: R diag(I) Rᵀ in space."""
    if q.shape[-1] == 3:
        return inertia
    R = rotation(q[..., 3:])
    return (R * inertia[..., None, :]) @ R.mT


def in_world(vector: Float[Tensor, "*#batch d"], q: Float[Tensor, "*#batch pose"]) -> Float[Tensor, "*#batch d"]:
    """The vector [..., d] in axes of a body in those of the world, from the body's pose."""
    return rotate(vector, q[..., 2]) if q.shape[-1] == 3 else matvec(rotation(q[..., 3:]), vector)


def in_body(vector: Float[Tensor, "*#batch d"], q: Float[Tensor, "*#batch pose"]) -> Float[Tensor, "*#batch d"]:
    """The vector [..., d] in axes of the world in those of the body: inverse of `in_world`."""
    return rotate(vector, -q[..., 2]) if q.shape[-1] == 3 else matvec(rotation(q[..., 3:]).mT, vector)


def moment(r: Float[Tensor, "*#batch d"], P: Float[Tensor, "*#batch d"]) -> Float[Tensor, "..."]:
    """Moment r × P [..., 1 or 3] about the mass centre in N m s of an impulse P [..., d] that acts at r."""
    if r.shape[-1] == 3:
        return torch.linalg.cross(*torch.broadcast_tensors(r, P))
    (r_x, r_y), (p_t, p_n) = r.unbind(-1), P.unbind(-1)
    return (r_x * p_n - r_y * p_t)[..., None]


def swept(r: Float[Tensor, "*#batch d"], omega: Float[Tensor, "..."]) -> Float[Tensor, "*#batch d"]:
    """Velocity ω × r [..., d] in m/s of an arm r that turns with ω [..., 1 or 3]."""
    if r.shape[-1] == 3:
        return torch.linalg.cross(*torch.broadcast_tensors(omega, r))
    (r_x, r_y), (spin,) = r.unbind(-1), omega.unbind(-1)
    return torch.stack((-r_y * spin, r_x * spin), -1)


def spin(inertia: Float[Tensor, "..."], moment: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
    """Change of spin I⁻¹ × moment [..., 1 or 3] in rad/s."""
    return moment / inertia[..., None] if moment.shape[-1] == 1 else matvec(inverse(inertia), moment)


def spin_momentum(inertia: Float[Tensor, "..."], omega: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
    """Angular momentum I ω [..., 1 or 3] in N m s."""
    return inertia[..., None] * omega if omega.shape[-1] == 1 else matvec(inertia, omega)


def contact_jacobian(r: Float[Tensor, "*#batch d"]) -> Float[Tensor, "*#batch d D"]:
    """Contact Jacobian J [..., d, D] (rows t, n) from the contact point r [..., d] in m."""
    d = r.shape[-1]
    spins = torch.eye(2 * d - 3).to(r)
    arms = [swept(r, one.expand(*r.shape[:-1], -1)) for one in spins]
    return torch.cat((torch.eye(d).to(r).expand(*r.shape, d), torch.stack(arms, -1)), -1)


def inverse_inertia(
    mass: Float[Tensor, "*#batch"], inertia: Float[Tensor, "..."], r: Float[Tensor, "*#batch d"]
) -> Float[Tensor, "*#batch d d"]:
    """Inverse effective inertia W [..., d, d] in 1/kg at the contact point r [..., d]."""
    if r.shape[-1] == 3:
        turning = contact_jacobian(r)[..., 3:]
        return torch.eye(3).to(r) / mass[..., None, None] + turning @ inverse(inertia) @ turning.mT
    r_x, r_y = r.unbind(-1)
    w_tt = 1 / mass + r_y**2 / inertia
    w_tn = -r_x * r_y / inertia
    w_nn = 1 / mass + r_x**2 / inertia
    return torch.stack((torch.stack((w_tt, w_tn), -1), torch.stack((w_tn, w_nn), -1)), -2)


def inverse(W: Float[Tensor, "*#batch d d"]) -> Float[Tensor, "*#batch d d"]:
    """Inverse [..., d, d] of symmetric 2 × 2 or 3 × 3 matrices by their adjugates."""
    if W.shape[-1] == 3:
        first, second, third = W.unbind(-2)
        rows = torch.stack(
            [torch.linalg.cross(*pair) for pair in ((second, third), (third, first), (first, second))], -1
        )
        return rows / (first * rows[..., 0]).sum(-1)[..., None, None]
    w_tt, w_tn, w_nn = W[..., 0, 0], W[..., 0, 1], W[..., 1, 1]
    adjugate = torch.stack((torch.stack((w_nn, -w_tn), -1), torch.stack((-w_tn, w_tt), -1)), -2)
    return adjugate / (w_tt * w_nn - w_tn**2)[..., None, None]


def effective_inertia(W: Float[Tensor, "*#batch d d"]) -> Float[Tensor, "*#batch d d"]:
    """Effective inertia M_c = W⁻¹ [..., d, d] in kg."""
    return inverse(W)


def contact_velocity(r: Float[Tensor, "*#batch d"], v: Float[Tensor, "*#batch D"]) -> Float[Tensor, "*#batch d"]:
    """Velocity v_c = J v [..., d] of the contact point in m/s, from v [..., D]."""
    d = r.shape[-1]
    return v[..., :d] + swept(r, v[..., d:])


def slip_heading(
    W: Float[Tensor, "*#batch 3 3"], v_c: Float[Tensor, "*#batch 3"]
) -> tuple[tuple[Float[Tensor, "*#batch"], ...], tuple[Float[Tensor, "*#batch"], ...]]:
    """Cosine and sine [...] of the direction of the slip in space, and the slip along it and across (0) in m/s.

    Where there is no slip at all the direction is that of the slip that a normal impulse would start, else x.  It does
    not turn with the velocity there, so the slip across has a derivative.
    """
    v_x, v_y = v_c[..., 0], v_c[..., 1]
    still = (v_x == 0) & (v_y == 0)
    a, b = torch.where(still, W[..., 0, 2], v_x), torch.where(still, W[..., 1, 2], v_y)
    a = torch.where((a == 0) & (b == 0), 1.0, a)
    length = torch.hypot(a, b)
    c, s = a / length, b / length
    return (c, s), (torch.where(still, c * v_x + s * v_y, length), torch.where(still, c * v_y - s * v_x, 0.0))


def slip_axes(W: Float[Tensor, "*#batch d d"], v_c: Float[Tensor, "*#batch d"]) -> Float[Tensor, "*#batch D D"]:
    """Rotation [..., D, D] of velocities and wrenches from the axes of the slip to those of the world.

    In space these axes are 1 along the slip, 2 across it and the normal, so that a model in them turns with the
    impact about the normal.  In the plane both are the same.
    """
    if v_c.shape[-1] == 2:
        return torch.eye(3).to(v_c).expand(*v_c.shape[:-1], -1, -1)
    (c, s), _ = slip_heading(W, v_c)
    none, one = torch.zeros_like(c), torch.ones_like(c)
    rows = (c, -s, none), (s, c, none), (none, none, one)
    turn = torch.stack([torch.stack(row, -1) for row in rows], -2)
    apart = torch.zeros_like(turn)
    return torch.cat((torch.cat((turn, apart), -1), torch.cat((apart, turn), -1)), -2)


def apply_wrench(
    mass: Float[Tensor, "*#batch"],
    inertia: Float[Tensor, "..."],
    r: Float[Tensor, "*#batch d"],
    v: Float[Tensor, "*#batch D"],
    wrench: Float[Tensor, "*#batch D"],
) -> Float[Tensor, "*#batch D"]:
    """Velocity v⁺ [..., D] after the wrench (P, τ) [..., D] in (N s, N m s)."""
    P, tau = wrench[..., : r.shape[-1]], wrench[..., r.shape[-1] :]
    turned = spin(inertia, moment(r, P) + tau)
    linear = P / mass[..., None]
    if linear.shape[:-1] != turned.shape[:-1]:
        shape = np.broadcast_shapes(linear.shape[:-1], turned.shape[:-1])  # torch's loads SymPy
        linear, turned = linear.expand(*shape, -1), turned.expand(*shape, -1)
    return v + torch.cat((linear, turned), -1)


def velocity_per_wrench(
    mass: Float[Tensor, "*#batch"], inertia: Float[Tensor, "..."], r: Float[Tensor, "*#batch d"]
) -> Float[Tensor, "*#batch D D"]:
    """Derivative [..., D, D] of v⁺ in the wrench (P, τ): M⁻¹ (Jᵀ, (0, 1)ᵀ)."""
    size = 3 * r.shape[-1] - 3
    each = torch.eye(size).to(r).view(size, *[1] * (r.ndim - 1), size).expand(size, *r.shape[:-1], size)
    return apply_wrench(mass, inertia, r, torch.zeros_like(each), each).movedim(0, -1)


def measured_wrench(
    mass: Float[Tensor, "*#batch"],
    inertia: Float[Tensor, "..."],
    r: Float[Tensor, "*#batch d"],
    v_pre: Float[Tensor, "*#batch D"],
    v_post: Float[Tensor, "*#batch D"],
) -> Float[Tensor, "*#batch D"]:
    """The one wrench (P, τ) [..., D] that takes v_pre to v_post: inverse of `apply_wrench`."""
    change, d = v_post - v_pre, r.shape[-1]
    P = mass[..., None] * change[..., :d]
    tau = spin_momentum(inertia, change[..., d:]) - moment(r, P)
    return torch.cat((P.expand(*tau.shape[:-1], -1), tau), -1)


def squared_mass_norm(
    mass: Float[Tensor, "*#batch"], inertia: Float[Tensor, "..."], v: Float[Tensor, "*#batch D"]
) -> Float[Tensor, "*#batch"]:
    """vᵀ M v [...] in J: twice the kinetic energy."""
    d = v.shape[-1] // 3 + 1
    linear, turning = v[..., :d], v[..., d:]
    return mass * linear.square().sum(-1) + (turning * spin_momentum(inertia, turning)).sum(-1)


def least_squares_impulse(
    mass: Float[Tensor, "*#batch"],
    inertia: Float[Tensor, "..."],
    r: Float[Tensor, "*#batch d"],
    dv: Float[Tensor, "*#batch D"],
) -> Float[Tensor, "*#batch d"]:
    """Impulse P [..., d] that minimises ‖Δv − M⁻¹JᵀP‖₂ over all components of Δv [..., D], unweighted.

    What the paper's authors identified with.  It adds metres to radians, so ω (tens of rad/s)
    outweighs the velocities: it is not the momentum change m Δv unless τ = 0.
    """
    A = velocity_per_wrench(mass, inertia, r)[..., : r.shape[-1]]
    return matvec(inverse(A.mT @ A), matvec(A.mT, dv))


def matvec(A: Float[Tensor, "*#batch k m"], x: Float[Tensor, "*#batch m"]) -> Float[Tensor, "*#batch k"]:
    """Product A x [..., K] of matrices and vectors."""
    return (A @ x[..., None])[..., 0]


def energy_excess(
    W: Float[Tensor, "*#batch d d"], v_c: Float[Tensor, "*#batch d"], P: Float[Tensor, "*#batch d"]
) -> Float[Tensor, "*#batch"]:
    """Kinetic energy gained [...] in J: ½ Pᵀ W P + Pᵀ v_c.  At most 0 inside the energy ellipse.

    The energy ellipse, Eq. (2.5) with α = 1, is (P + M_c v_c)ᵀ W (P + M_c v_c) = v_cᵀ M_c v_c.
    """
    WP = matvec(W, P)
    return (P * (0.5 * WP + v_c)).sum(-1)


def energy_ellipse(
    W: Float[Tensor, "*#batch d d"], v_c: Float[Tensor, "*#batch d"], points: int = 181
) -> Float[Tensor, "*#batch {points} 2"]:
    """Boundary of the energy ellipse as impulses [..., points, 2] in N s; it passes through P = 0."""
    centre = -matvec(effective_inertia(W), v_c)
    radius = (-(centre * v_c).sum(-1)).clamp_min(0).sqrt()
    angle = torch.linspace(0, 2 * torch.pi, points, dtype=W.dtype, device=W.device)
    circle = torch.stack((angle.cos(), angle.sin()), -1)
    # W = L Lᵀ, so |Lᵀ (P − centre)| = radius on the ellipse.
    L = torch.linalg.cholesky(W)
    offsets = torch.linalg.solve_triangular(L.mT, circle.mT, upper=True).mT
    return centre[..., None, :] + radius[..., None, None] * offsets


def ellipse_vectors(W: Float[Tensor, "*b 2 2"], v_c: Float[Tensor, "*b 2"]) -> Float[Tensor, "*b 4 2"]:
    """Return centre −M_c v_c of the energy ellipse and its chords c, n and s [..., 4, 2] in N s.

    The ellipse is centre + cos φ c + sin φ n.  On centre ± c, the line of maximum compression, the contact has no
    normal velocity, and beyond it, sin φ > 0, it separates; on centre ± s it sticks.  dᵀ W d = v_cᵀ M_c v_c of each.
    """
    centre = -matvec(effective_inertia(W), v_c)
    none = torch.zeros_like(W[..., 0, 0])
    components = ((W[..., 1, 1], -W[..., 0, 1]), (none, W[..., 1, 1]), (W[..., 0, 1], -W[..., 0, 0]))
    chords = torch.stack([torch.stack(pair, -1) for pair in components], -2)
    size = -(v_c * centre).sum(-1, keepdim=True) / ((chords @ W) * chords).sum(-1)
    return torch.cat((centre[..., None, :], chords * size.clamp_min(0).sqrt()[..., None]), -2)


def admissible(
    W: Float[Tensor, "*#batch d d"],
    v_c: Float[Tensor, "*#batch d"],
    P: Float[Tensor, "*#batch d"],
    tolerance: float = 1e-9,
) -> Bool[Tensor, "*#batch"]:
    """Whether P [..., d] gains no energy, pulls nothing and leaves no penetration: bool [...].

    `tolerance` is relative: to the incident energy v_cᵀ M_c v_c, momentum and speed.
    """
    momentum = -matvec(effective_inertia(W), v_c)
    energy = -(momentum * v_c).sum(-1)
    v_n = v_c[..., -1] + (W[..., -1, :] * P).sum(-1)
    return (
        (energy_excess(W, v_c, P) <= tolerance * energy)
        & (P[..., -1] >= -tolerance * momentum.norm(dim=-1))
        & (v_n >= -tolerance * v_c.norm(dim=-1))
    )
