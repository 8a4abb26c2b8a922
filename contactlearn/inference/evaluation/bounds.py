"""Bounds: how well could *any* model of a class explain the measured impacts?

The ideal-rigid-body (IRB) bound gives every trial the wrench that fits it best,

    min over (P_t, P_n, τ) of ‖v_post − v⁺‖,   M (v⁺ − v_pre) = Jᵀ P + (0, 0, τ)ᵀ
    subject to   v⁺ᵀ M v⁺ ≤ v_preᵀ M v_pre   no energy is gained: the energy ellipse of Eq. (2.5)
                 v_n⁺ = v_y⁺ + r_x ω⁺ ≥ 0    the contact point does not penetrate
                 P_n ≥ 0,  |τ| ≤ w P_n       nothing is pulled; the patch has half-width w

so no model that keeps these rules comes closer.  w = 0 is a point contact, the bound of the paper.

A moment |τ| ≤ w P_n is the impulse P acting at r_x + τ/P_n instead of r_x.  The reachable v⁺ are
thus a ball (energy) cut by three planes: v_n⁺ = 0 and the two ends τ = ±w P_n of the patch, each of
which is a point contact of its own.  The programme is convex, so its solution is the nearest of the
feasible minimisers over the ball, over the disc v_n⁺ = 0, over both end discs, and over the straight
edges of these.  A minimiser over a ball is (H + λ)⁻¹ g with the λ ≥ 0 that solves the secular equation
|x(λ)| = ρ (Conn, Gould & Toint, *Trust-Region Methods*, 2000, Section 7.3), by Newton's method on
1/|x(λ)|; over an edge it is a clamped parabola.  All trials and all widths are solved at once.

In space the contact is a point, and v_c⁺ = ρ L x with W = L Lᵀ, |x| ≤ 1: a ball cut by two half-spaces, P_n ≥ 0 and
v_n⁺ ≥ 0.  The nearest point is in the ball, on one of two discs, or on the segment in which these meet.

`best_post_hoc` is the other bound: trial by trial, the prediction of whichever model comes closest.
Source: Fazeli et al. (2017), Section 3.2; the curve over w is this package's.
"""

from collections.abc import Mapping

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from contactlearn.core.errors import ContactLearnError, UnknownNameError
from contactlearn.inference.evaluation.metrics import NORMS
from contactlearn.mechanics import rigid_body
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.mechanics.space import SPACE, require_space

_TINY = torch.finfo(torch.float64).tiny
_EDGE = 1e-11  # of the ball's radius, by which a point may lie beyond an edge that it is computed on
_SLACK = 1e-14  # of the disc's radius: an edge that round-off shortens below a point is still a point
_NEWTON_STEPS = 50  # from a bound below λ it converges monotonically; 10 were the most seen


def distance(impacts: Impacts, v_post: Float[Tensor, "*batch n D"], norm: str = "mass") -> Float[Tensor, "*batch n"]:
    """Compute the distance [..., N] of v_post [..., N, 3] from the measured post velocity.

    √(eᵀ M e) in √J for `mass`, √(eᵀ e) over (v_x, v_y, ω) in m/s and rad/s for `euclidean`; nothing is normalised, as
    it may be in `metrics`.

    Raises:
        UnknownNameError: no such norm.
    """
    if norm not in NORMS:
        raise UnknownNameError("norm", norm, NORMS)
    error = v_post - impacts.v_post
    squared = rigid_body.squared_mass_norm(impacts.mass, impacts.world_inertia, error)
    return (squared if norm == "mass" else error.square().sum(-1)).sqrt()


def best_post_hoc(
    impacts: Impacts, predictions: Mapping[str, Prediction], norm: str = "mass"
) -> tuple[Prediction, Int[Tensor, "*batch n"]]:
    """Choose, for each trial, the prediction closest to the measured v_post; return it and its model's index [..., N].

    The index counts the models in the order of `predictions`; the first of equals is chosen.  The choice uses the
    measured outcome, so the result is a bound and no model.

    Args:
        impacts: N measured impacts.
        predictions: by model, v_post and wrench [..., N, 3]; leading axes are broadcast.
        norm: `mass` or `euclidean`, see `distance`.

    Raises:
        UnknownNameError: no such norm.
        ContactLearnError: no predictions.
    """
    if not predictions:
        raise ContactLearnError("best_post_hoc needs the prediction of at least one model, got none")
    v_post = torch.stack(torch.broadcast_tensors(*(p.v_post for p in predictions.values())))
    wrench = torch.stack(torch.broadcast_tensors(*(p.wrench for p in predictions.values())))
    model = distance(impacts, v_post, norm).argmin(0)
    return Prediction(_pick(v_post, model), _pick(wrench, model)), model


def irb(impacts: Impacts, norm: str = "mass", patch: Float[Tensor, "*batch"] | float = 0.0) -> Prediction:
    """Find the admissible wrench (P_t, P_n, τ) whose v_post is nearest to the measured one; see the module.

    Args:
        impacts: N measured impacts.
        norm: `mass` or `euclidean`, see `distance`; the paper's is `euclidean`.
        patch: half-width w ≥ 0 of the contact patch in m, broadcast against [N]: a (K, 1) tensor
            gives the curve of the bound over K widths.  0 is a point contact, τ = 0.

    Returns:
        v_post and wrench [..., N, D]; `distance(impacts, prediction.v_post, norm)` is the bound.

    Raises:
        UnknownNameError: no such norm.
        ContactLearnError: a width that is negative, not finite or of a shape that does not fit.
    """
    width = torch.as_tensor(patch, dtype=torch.float64, device=impacts.mass.device)
    narrowest, widest = (x.item() for x in width.aminmax())
    if not 0 <= narrowest <= widest < torch.inf:
        got = narrowest if narrowest < 0 else widest
        raise ContactLearnError(f"patch is a half-width in metres, finite and not negative; got {got:g}")
    if width.ndim and width.shape[-1] not in (1, len(impacts)):
        raise ContactLearnError(
            f"patch must broadcast against {len(impacts)} trials; for a curve over K widths give them "
            f"as widths[:, None], shape (K, 1); got shape {tuple(width.shape)}"
        )
    shape = np.broadcast_shapes(width.shape, impacts.mass.shape)
    if widest > 0:
        require_space("a contact patch", impacts.space)
    if impacts.space is SPACE:
        wrench = torch.nn.functional.pad(_in_ball(impacts, norm), (0, 3))
        return Prediction.from_wrench(impacts, wrench.expand(*shape, 6))
    D = weights(impacts, norm)
    if widest == 0:
        P, _ = _point_contact(impacts, D, torch.zeros_like(impacts.mass))
        wrench = torch.stack((*P, torch.zeros_like(P[0])), -1)
        return Prediction.from_wrench(impacts, wrench.expand(*shape, 3))
    width = width.expand(shape)
    offset = torch.stack((width, -width))
    P, gap = _point_contact(impacts, D, offset)
    ends = torch.stack((*P, offset * P[1]), -1)
    free, free_gap = (x.reshape(2, *[1] * (len(shape) - 1), *x.shape[1:]) for x in _free_moment(impacts, D))
    p_n, tau = free[..., 1], free[..., 2]
    free_gap = torch.where((p_n >= 0) & (tau.abs() <= width * p_n), free_gap, torch.inf)
    wrenches = torch.cat((ends, free.expand(2, *shape, 3)))
    return Prediction.from_wrench(impacts, _pick(wrenches, torch.cat((gap, free_gap)).argmin(0)))


def weights(impacts: Impacts, norm: str) -> Float[Tensor, "3 n"]:
    """Return D of the squared norm eᵀ diag(D) e.

    Raises:
        UnknownNameError: no such norm.
    """
    if norm not in NORMS:
        raise UnknownNameError("norm", norm, NORMS)
    mass, inertia = impacts.mass, impacts.inertia
    return torch.stack((mass, mass, inertia) if norm == "mass" else (torch.ones_like(mass),) * 3)


def _pick(candidates: Tensor, index: Tensor) -> Tensor:
    """candidates[index, ...] by trial: [C, ..., N, 3] at index [..., N]."""
    return candidates.gather(0, index[None, ..., None].expand(1, *candidates.shape[1:]))[0]


def _point_contact(impacts: Impacts, weights: Tensor, offset: Tensor) -> tuple[Tensor, Tensor]:
    """Best impulse P [2, ..., N] that acts `offset` [..., N] m right of r, and its squared distance.

    v⁺ = v_pre + B (x − x₀) with B M-orthogonal, so that energy is |x| ≤ |x₀| = 1 and P_n ≥ 0 is
    x₂ ≥ x₀₂; in what follows the component leads.  Where no impulse is admissible the distance is inf.
    """
    per_m, per_i = 1 / impacts.mass, 1 / impacts.inertia
    (r_x, r_y), v_pre = impacts.r.unbind(-1), impacts.v_pre.mT
    arm = r_x + offset
    one, zero = torch.ones_like(arm), torch.zeros_like(arm)
    w_tt = per_m + r_y.square() * per_i
    back = arm * r_y * per_i / w_tt  # P_t by P_n along the second axis: −W_tn / W_tt
    schur = per_m / w_tt * (per_m + (arm.square() + r_y.square()) * per_i)  # det W / W_tt
    unit_t, unit_n = w_tt.rsqrt(), schur.rsqrt()
    # Columns M⁻¹Jᵀ(1, 0) / √W_tt and M⁻¹Jᵀ(−W_tn/W_tt, 1) / √schur.
    first = torch.stack((per_m * one, zero, -r_y * per_i * one)) * unit_t
    second = torch.stack((back * per_m, per_m * one, arm * per_i * (per_m / w_tt))) * unit_n
    slip = v_pre[0] - r_y * v_pre[2]
    x_0 = torch.stack((slip * unit_t * one, (v_pre[1] + arm * v_pre[2] + back * slip) * unit_n))
    rho = _root(x_0.square().sum(0))
    x_0 = x_0 / rho
    B = torch.stack((first, second)) * rho
    batch = (3, *[1] * (arm.ndim - 1), -1)
    target = (B * x_0[:, None]).sum(0) + (impacts.v_post - impacts.v_pre).mT.reshape(batch)
    # v_n⁺ ≥ 0 as a unit normal and an offset, like x₂ ≥ x₀₂.
    normal = B[:, 1] + r_x * B[:, 2]
    bound = (normal * x_0).sum(0) - (v_pre[1] + r_x * v_pre[2])
    length = _root(normal.square().sum(0))
    bounds = torch.stack((x_0[1], bound / length))
    x, gap = _nearest_in_disc(B, target, weights.reshape(batch), normal / length, bounds)
    dx = (x - x_0) * rho
    p_n = (dx[1] * unit_n).clamp_min(0)
    return torch.stack((dx[0] * unit_t + back * p_n, p_n)), gap


def _free_moment(impacts: Impacts, weights: Tensor) -> tuple[Tensor, Tensor]:
    """Best wrenches [2, N, 3] with any moment and any P_n, and their squared distances [2, N].

    First with v_n⁺ ≥ 0 inactive, in z = M^½ v⁺ (inf where it is violated), then with v_n⁺ = 0.
    """
    m, inertia, r_x = impacts.mass, impacts.inertia, impacts.r[:, 0]
    M = torch.stack((m, m, inertia))
    target = impacts.v_post.mT
    radius, root_M = _root((M * impacts.v_pre.mT.square()).sum(0)), _root(M)
    ball = _least_in_ball(weights / M, weights * target / root_M, radius) / root_M
    # v_n⁺ = 0 is spanned by (1, 0, 0) / √m and (0, −r_x, 1) / √(m r_x² + I), orthogonal in any norm.
    root = _root(torch.stack((m, m * r_x.square() + inertia)))
    h = torch.stack((weights[0], weights[2] + weights[1] * r_x.square())) / root.square()
    g = torch.stack((weights[0] * target[0], weights[2] * target[2] - weights[1] * r_x * target[1])) / root
    x = _least_in_ball(h, g, radius) / root
    v_post = torch.stack((ball, torch.stack((x[0], -r_x * x[1], x[1]))))
    gap = (weights * (target - v_post).square()).sum(1)
    gap[0] = torch.where(ball[1] + r_x * ball[2] >= 0, gap[0], torch.inf)
    return rigid_body.measured_wrench(m, inertia, impacts.r, impacts.v_pre, v_post.mT), gap


def _in_ball(impacts: Impacts, norm: str) -> Tensor:
    """Best impulse P [N, 3] of a point contact in space; see the module."""
    body = impacts.mass, impacts.world_inertia, impacts.r
    L, v_c = torch.linalg.cholesky(impacts.W), impacts.v_c[..., None]
    x_0 = torch.linalg.solve_triangular(L, v_c, upper=False)
    rho = x_0.norm(dim=-2, keepdim=True)
    x_0 = x_0 / rho
    eye = torch.eye(3).to(L).expand_as(L)
    impulse = rho * torch.linalg.solve_triangular(L.mT, eye, upper=True)  # P = impulse (x − x₀)
    B = rigid_body.velocity_per_wrench(*body)[..., :3] @ impulse
    target = (impacts.v_post - impacts.v_pre)[..., None] + B @ x_0
    scaled = B
    if norm == "mass":
        spun = rigid_body.spin_momentum(impacts.world_inertia[:, None], B[:, 3:].mT).mT
        scaled = torch.cat((impacts.mass[:, None, None] * B[:, :3], spun), -2)
    H, g = scaled.mT @ B, (scaled.mT @ target)[..., 0]
    up = torch.zeros_like(g)
    up[:, 2] = 1.0  # P_n grows along the last axis alone
    planes = torch.stack((up, L[:, 2] / L[:, 2].norm(dim=-1, keepdim=True)))
    bounds = torch.stack((x_0[:, 2, 0], torch.zeros_like(up[:, 0])))
    found = [
        _on_flat(H, g, torch.zeros_like(g), eye),
        *(_on_disc(H, g, *one) for one in zip(planes, bounds, strict=True)),
    ]
    # Both planes: x = foot + t along.
    along = torch.linalg.cross(*planes)
    sine = along.norm(dim=-1, keepdim=True).clamp_min(_TINY)
    foot = torch.linalg.cross(bounds[0, :, None] * planes[1] - bounds[1, :, None] * planes[0], along / sine) / sine
    found.append(_on_flat(H, g, foot, (along / sine)[..., None]))
    x = torch.stack(found)
    inside = ((planes[:, None] * x).sum(-1) >= bounds[:, None] - _EDGE).all(0) & (x.norm(dim=-1) <= 1 + _EDGE)
    value = (x * (rigid_body.matvec(H, x) - 2 * g)).sum(-1)
    x = _pick(x, torch.where(inside, value, torch.inf).argmin(0))
    P = rigid_body.matvec(impulse, x - x_0[..., 0])
    return torch.cat((P[:, :2], P[:, 2:].clamp_min(0)), -1)


def _on_disc(H: Tensor, g: Tensor, normal: Tensor, bound: Tensor) -> Tensor:
    """argmin of xᵀ H x − 2 gᵀ x on the disc normal·x = bound, |x| ≤ 1."""
    mirror = normal.clone()
    mirror[:, 2] += torch.copysign(torch.ones_like(bound), normal[:, 2])
    across = torch.eye(3).to(H) - 2 * mirror[..., None] * mirror[:, None] / mirror.square().sum(-1)[:, None, None]
    return _on_flat(H, g, bound[:, None] * normal, across[..., :2])


def _on_flat(H: Tensor, g: Tensor, foot: Tensor, basis: Tensor) -> Tensor:
    """argmin of xᵀ H x − 2 gᵀ x over x = foot + basis y in the unit ball; the foot is the nearest to its centre."""
    values, turn = torch.linalg.eigh(basis.mT @ H @ basis)
    basis = basis @ turn
    slope = rigid_body.matvec(basis.mT, g - rigid_body.matvec(H, foot))
    radius = _root(1 - foot.square().sum(-1))
    return foot + rigid_body.matvec(basis, _least_in_ball(values.mT, slope.mT, radius).mT)


def _nearest_in_disc(
    B: Tensor, target: Tensor, weights: Tensor, normal: Tensor, bounds: Tensor
) -> tuple[Tensor, Tensor]:
    """min over |x| ≤ 1, x₂ ≥ bounds[0], normal·x ≥ bounds[1] of eᵀ diag(D) e, e = target − B x: (x, its value).

    B [2, 3, ...], target and weights D [3, ...], x and the unit normal [2, ...]; inf where nothing is admissible.
    """
    scaled = weights * B
    h_11, h_12, h_22 = (scaled[0] * B[0]).sum(0), (scaled[0] * B[1]).sum(0), (scaled[1] * B[1]).sum(0)
    g = (scaled * target).sum(1)
    # The disc alone, along the principal axes of H = BᵀDB by one rotation of Jacobi's, of tangent |u| ≤ 1.
    lead = 0.5 * (h_11 - h_22)
    u = torch.where(lead < 0, -h_12, h_12) / (lead.abs() + torch.hypot(lead, h_12)).clamp_min(_TINY)
    c = (1 + u.square()).rsqrt()
    s = u * c
    h = torch.stack((h_11 + u * h_12, h_22 - u * h_12))
    y = _least_in_ball(h, torch.stack((c * g[0] + s * g[1], c * g[1] - s * g[0])), 1.0)
    disc = torch.stack((c * y[0] - s * y[1], s * y[0] + c * y[1]))
    p, q = normal
    inside = (disc[1] >= bounds[0]) & (p * disc[0] + q * disc[1] >= bounds[1])
    # Both edges, foot + t along, |t| ≤ half; along points into the other half-plane, so t ≥ cut.
    one, zero = torch.ones_like(p), torch.zeros_like(p)
    side, steep = torch.copysign(one, p), p.abs()
    foot = torch.stack((torch.stack((zero, p)), torch.stack((one, q)))) * bounds
    along = torch.stack((torch.stack((side, -side * q)), torch.stack((zero, steep))))
    half = _root(1 - bounds.square())
    cut = (bounds.flip(0) - q * bounds) / steep.clamp_min(_TINY)
    H_along = torch.stack((h_11 * along[0] + h_12 * along[1], h_12 * along[0] + h_22 * along[1]))
    t = (along * g[:, None] - H_along * foot).sum(0) / (along * H_along).sum(0).clamp_min(_TINY)
    edges = foot + t.maximum(cut).maximum(-half).minimum(half) * along
    valid = torch.cat((inside[None], (cut <= half + _SLACK) & (bounds.abs() <= 1)))
    x = torch.cat((disc[:, None], edges), 1)
    e = target[:, None] - B[0][:, None] * x[0] - B[1][:, None] * x[1]
    values = torch.where(valid, (weights[:, None] * e.square()).sum(0), torch.inf)
    # The edge v_n⁺ = 0 of a point contact is never empty, so it is what round-off falls back to.
    edge = torch.where(values[1] < values[2], edges[:, 0], edges[:, 1])
    return torch.where(inside, disc, edge), values.amin(0)


def _least_in_ball(h: Tensor, g: Tensor, radius: Tensor | float) -> Tensor:
    """argmin over |x| ≤ radius of Σ hᵢ xᵢ² − 2 gᵢ xᵢ, for h > 0; [d, ...] like h and g.

    1/|x(λ)| is concave and increases, so Newton's steps from a lower bound of λ stay below it.
    """
    h = h.clamp_min(_TINY)
    lam = (g.abs() / radius - h).amax(0).clamp_min(0)  # as |xᵢ| ≤ radius
    for _ in range(_NEWTON_STEPS):
        shifted = h + lam
        x = g / shifted
        square = x.square().sum(0)
        excess = (_root(square) / radius - 1).clamp_min(0)
        lam = lam + excess * square / (x * x / shifted).sum(0).clamp_min(_TINY)
        if bool(excess.max() <= 1e-9):  # the step just taken squares this
            break
    return g / (h + lam)


def _root(x: Tensor) -> Tensor:
    """√x, at least 1e-154.  torch.sqrt wakes all threads even for few numbers: a stall on a busy machine."""
    return x.clamp_min(_TINY).rsqrt().reciprocal()
