"""What a rig is, from the moment balance of impacts without any law of contact, and impacts as the rig card has them.

    I₀ e^κ Δω = r_x P_n − r_y P_t        P = m Δv, r and v about the centre of mass

holds whatever friction and restitution are.  `fit_balance` finds the changes of what was stated that close it: the
inertia and the centre of mass, with zero of θ, outline and its place as far as other measurements leave them open.  It
is linear least squares with priors and Tukey's biweight, linearised again a few times.

A contact that lasts moves contact points as well.  With m_c = P_n / Δv_n, the effective mass there as the impulse
shows it, its duration goes with √(m_c/m), and these are fitted beside the card to recordings:

    swing    s, turn over Δω √(m_c/m): flights meet in a kink, the body turns smoothly
    yield    s, way of the centre of mass towards the contact over v_n √(m_c/m)
    depth    m by which contacts lie deeper: heights show only how this changes with θ

Heights show v_n √(m_c/m) s_d, where flights meet below the floor.  A force that is half a sine in time has a swing of
s_d/4 and a yield of s_d/2; with a dashpot the swing is up to 0.35 s_d.

A moment at the contact, a spin or a speed that is lost after it do not close the balance either, and are physics.  Each
is fitted alone in place of the rig; `physical` says how much of the imbalance the best of them removes.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn.functional import pad

from contactlearn.core.numerics import MAD_SCALE, biweight
from contactlearn.data.audit.moments import torque
from contactlearn.data.audit.thresholds import AuditThresholds
from contactlearn.mechanics.apparatus import CHANGES, Apparatus, Estimate
from contactlearn.mechanics.bodies import AnyShape, contact_points, shapes_among
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import (
    contact_velocity,
    displaced_pose,
    in_body,
    in_world,
    moment,
    orientation_of,
    rotate,
    spin_momentum,
    swept,
)
from contactlearn.mechanics.shapes import Cornered, Ellipse, Polygon, Shape
from contactlearn.mechanics.space import SPACE

_STEPS, _ROUNDS = 4, 12  # linearisations, and weights of each
_INERTIA = 0.5  # standard deviation that is expected of ln I/I₀
_SHARE = 0.1  # standard deviation that is expected of an angle in rad, and of a length over the distance of contacts
_COMPARED, _AS_GOOD = 400, 1.1  # impacts on which combinations are compared, and spread over the least that is as good
_MIN_IMPACTS = 5  # impacts for each change, at least
_SLIGHT = 1e-6  # of a difference quotient: rad, relative, of a metre, or of a second
_LASTING = {"swing": 3e-4, "yield": 5e-4}  # s, standard deviations that are expected
_SHARES = {"swing": (0.3, 0.06), "yield": (0.5, 0.07)}  # of s_d, and their standard deviations: the force's course
_LIGHTER = (0.05, 2.0)  # m_c/m: a rod at its end has 1/4, friction makes it larger
_TURNS = 3e-4  # s, of `swing` in space
_DEPTH = 0.005  # of `depth`, relative to the distance of contacts
LONGEST = 3e-3
"""Longest contact in s."""
LATE = 5e-4
"""Standard deviation in s that is expected of `late`."""


def changed(impacts: Impacts, change: Mapping[str, float]) -> Impacts:
    """Return impacts as they are after changes of what was stated: fields of `Apparatus`, `swing`, `yield`, `depth`.

    The floor becomes level, positions and velocities are those of the centre of mass.
    """
    if not any(change.values()):
        return impacts.replace(validate=False)
    get = lambda name: change.get(name, 0.0)  # noqa: E731
    d, shape, before, after = impacts.space.d, impacts.shape, impacts.v_pre, impacts.v_post
    flat, vector = d == 2, impacts.r.new_tensor
    middle, centre = (vector([get(f"{name}_{axis}") for axis in "abc"[:d]]) for name in ("middle", "centre"))
    tilt = pad(vector((-get("slope"),) if flat else (-get("slope_b"), get("slope"), 0.0)), (d, 0))
    turn = tilt + vector([0.0] * d + [get("orientation")]) if flat else tilt
    tilted, turned = displaced_pose(impacts.q, tilt), displaced_pose(impacts.q, turn)
    root = root_of_mass(impacts.r, before, after)[:, None]
    swing = get("late") * (before + after) / 2 + get("swing") * (root if flat else 1.0) * (after - before)
    touching = displaced_pose(turned, pad(swing[:, d:], (d, 0)))
    placed = touching if flat else turned
    offset = in_world(centre, placed)

    def level(vectors: Float[Tensor, "n d"]) -> Float[Tensor, "n d"]:
        return in_world(in_body(vectors, impacts.q), tilted)

    def velocity(v: Float[Tensor, "n D"]) -> Float[Tensor, "n D"]:
        spin = v[:, d:] if flat else level(v[:, d:])
        return torch.cat((level(v[:, :d]) + swept(offset, spin), spin), -1)

    def pose(q: Float[Tensor, "n pose"]) -> Float[Tensor, "n pose"]:
        return torch.cat((level(q[:, :d]) + offset, displaced_pose(q, turn)[:, d:]), -1)

    r = level(impacts.r) + in_world(middle, placed) - offset
    r[:, -1] -= get("depth") + get("yield") * root[:, 0] * contact_velocity(impacts.r, before)[:, -1]
    if shape is not None:
        stated = contact_points(shape, impacts.body, orientation_of(impacts.q))
        changes = {name: reshaped(one, change) for name, one in shapes_among(shape).items()}
        shape = changes if isinstance(shape, Mapping) else changes[""]
        r = r + contact_points(shape, impacts.body, orientation_of(touching)) - level(stated)
    return impacts.replace(
        shape=shape,
        r=r,
        q=pose(impacts.q),
        q_post=None if impacts.q_post is None else pose(impacts.q_post),
        v_pre=velocity(before),
        v_post=velocity(after),
        inertia=impacts.inertia * math.exp(get("inertia")),
        validate=False,
    )


def root_of_mass(
    r: Float[Tensor, "n d"], v_pre: Float[Tensor, "n D"], v_post: Float[Tensor, "n D"]
) -> Float[Tensor, " n"]:
    """Return √(m_c/m), with the effective mass m_c at the contact as the impulse shows it."""
    change, n = v_post - v_pre, r.shape[1] - 1
    return (change[:, n] / contact_velocity(r, change)[:, n].clamp_min(1e-9)).clamp(*_LIGHTER).sqrt()


def one_point(
    shape: AnyShape | None, theta: Float[Tensor, " n"], v_pre: Float[Tensor, "n 3"], v_post: Float[Tensor, "n 3"]
) -> Bool[Tensor, " n"]:
    """Return the contacts in which no second corner of a polygon can reach the floor while they last."""
    if not isinstance(shape, Polygon):
        return torch.ones_like(theta, dtype=torch.bool)
    corners = rotate(torch.tensor(shape.vertices, dtype=theta.dtype)[:, None], theta)
    heights, order = corners[..., 1].sort(0)
    across = corners[..., 0].gather(0, order)[1]
    approach = -torch.stack([v[:, 1] + v[:, 2] * across for v in (v_pre, v_post)]).amin(0)
    return heights[1] - heights[0] > LONGEST * approach


def reshaped(shape: Shape, change: Mapping[str, float]) -> Shape:
    """Return a shape with other corners or semi-axes; a body of another kind stays as it is."""
    match shape:
        case Cornered():
            return replace(
                shape, corner=min(max(shape.corner + change.get("corner", 0.0), 0.0), shape.largest_corner())
            )
        case Ellipse(semi_axes=(a, b)):
            longer = max(change.get("oblong", 0.0), -max(a, b) / 2)
            return Ellipse((a + longer * (a > b), b + longer * (a <= b)))
        case _:
            return shape


def as_measured(impacts: Impacts) -> Impacts:
    """Return impacts with all changes that their rig card is sure of."""
    rig = impacts.apparatus
    if rig is None:
        return impacts
    change = {row.name: row.estimate.value for row in rig.differing}
    known = {name: getattr(rig, name).made() for name in change}
    return changed(impacts, change).replace(apparatus=replace(rig, **known), validate=False)


@dataclass(frozen=True, kw_only=True)
class BalanceFit:
    """Changes that close the moment balance.

    Args:
        estimates: by the fields of `Apparatus`.
        remaining: robust standard deviation of the residual, over the spin that |Δv| makes at a radius of gyration.
        given: the same of the impacts as they are.
        physical: the same with the best single moment at the contact, or loss after it, in place of the rig.
    """

    estimates: dict[str, Estimate]
    remaining: float
    given: float
    physical: float


def fit_balance(impacts: Impacts, free: Mapping[str, Estimate], known: Mapping[str, Estimate] = {}) -> BalanceFit:
    """Fit changes of what was stated to the moment balance.

    Args:
        impacts: as stated.
        free: what is expected of changes that are fitted, from measurements that do not share their errors.
        known: changes that are made as others measured them.  Their errors may be systematic: no number of impacts
            reduces what they add to the others (Schmidt's consider covariance, 1966).
    """
    estimates, remaining = _fitted(impacts, free, known)
    given = _spread(_imbalance(impacts, {}))
    return BalanceFit(estimates=estimates, remaining=remaining, given=given, physical=_physical(impacts, known))


def with_balance(impacts: Impacts, rig: Apparatus, meets_below: Estimate | None = None) -> Apparatus:
    """Return a rig card with what the moment balance adds to it; the same where it does not close, or physics may.

    The inertia and the centre of mass are fitted; what wobble says of the latter takes part with its error.  All else
    that changes contact points is as heights and flights show it.

    Args:
        impacts: as stated.
        rig: card that heights and flights show.
        meets_below: s_d, where it is known.
    """
    known = {name: one for name in CHANGES if (one := getattr(rig, name)) is not None}
    few, length = _MIN_IMPACTS * (len(known) + 1), impacts.r.norm(dim=-1).median().item()
    expected = {"inertia": _INERTIA, "depth": _DEPTH * length}
    if impacts.space is SPACE:
        expected |= {"swing": _TURNS} | {f"centre_{axis}": _SHARE * length for axis in "abc"}
    else:
        expected |= {"late": LATE, **_LASTING}
        theta = impacts.q[:, 2] + (rig.orientation.value if rig.orientation else 0.0)
        impacts = impacts[one_point(impacts.shape, theta, impacts.v_pre, impacts.v_post)]
        if meets_below is not None:
            s, e = meets_below.value, meets_below.error
            known |= {
                name: Estimate(value=share * s, error=math.hypot(share * e, spread * s))
                for name, (share, spread) in _SHARES.items()
            }
    if len(impacts) < few:
        return rig
    free = {name: Estimate(value=0.0, error=error) for name, error in expected.items() if name not in known}
    free |= {name: known.pop(name) for name in [*known] if name.startswith("centre")}
    fit = fit_balance(impacts, free, known)
    if fit.remaining >= AuditThresholds().rig_explains * min(fit.physical, fit.given):
        return rig
    return replace(rig, **{name: one for name, one in fit.estimates.items() if name in CHANGES})


def simplest_rig(impacts: Impacts, thresholds: AuditThresholds = AuditThresholds()) -> BalanceFit | None:
    """Return the fewest changes of what was stated that close the balance of a table nearly as well as any.

    Combinations of inertia, zero of θ, outline and its place are compared; None where none closes it clearly better.
    Contact points below the centre, as those of a disc, show one ratio alone: that of the inertia is compared.
    """
    some = impacts[torch.linspace(0, len(impacts) - 1, min(len(impacts), _COMPARED)).round().long()]
    length = _SHARE * some.r.norm(dim=-1).median().item()
    about = lambda error, *names: dict.fromkeys(names, Estimate(value=0.0, error=error))  # noqa: E731
    groups = [about(_INERTIA, "inertia")]
    if impacts.shape is not None and (some.r[:, 0].abs() > _SLIGHT * length).any():
        groups += [
            about(_SHARE, "orientation"),
            about(length, "corner", "oblong"),
            about(length, "middle_a", "middle_b"),
        ]
    fits = [
        (count, fit_balance(some, {name: one for group in chosen for name, one in group.items()}))
        for count in range(1, len(groups) + 1)
        for chosen in combinations(groups, count)
        if len(some) >= _MIN_IMPACTS * 2 * count
    ]
    least = min((fit.remaining for _, fit in fits), default=math.inf)
    near = [(count, fit.remaining, fit) for count, fit in fits if fit.remaining <= least * _AS_GOOD]
    best = min(near, key=lambda one: one[:2])[2] if near else None
    return best if best and best.remaining < thresholds.rig_explains * best.given else None


def _imbalance(impacts: Impacts, change: Mapping[str, float]) -> Float[Tensor, " n"]:
    """Residual of the balance, in units of the spin that |Δv| makes at the stated radius of gyration; 3 n in space."""
    rig = changed(impacts, change)
    return (_open(rig, rig.v_post - rig.v_pre) / _usual(impacts, rig)).flatten()


def _noise(impacts: Impacts, change: Mapping[str, float]) -> Float[Tensor, "..."]:
    """Standard deviation of the residual by errors of the velocities, in the same units; 0 where none are known."""
    if impacts.v_pre_cov is None or impacts.v_post_cov is None:
        return torch.zeros((), dtype=torch.float64)
    rig = changed(impacts, change)
    slope = torch.stack([_open(rig, one.expand(len(rig), -1)) for one in torch.eye(rig.space.D).to(rig.r)], -1)
    variance = torch.einsum("nki,nij,nkj->nk", slope, impacts.v_pre_cov + impacts.v_post_cov, slope)
    return (variance.sqrt() / _usual(impacts, rig)).flatten()


def _open(impacts: Impacts, dv: Float[Tensor, "n D"]) -> Float[Tensor, "n s"]:
    """I Δω − r × m Δv of a change of velocity."""
    d = impacts.space.d
    return spin_momentum(impacts.world_inertia, dv[:, d:]) - moment(impacts.r, impacts.mass[:, None] * dv[:, :d])


def _usual(impacts: Impacts, rig: Impacts) -> Float[Tensor, "n 1"]:
    """I times the spin that |Δv| makes at the radius of gyration, in the plane as stated, with its median added."""
    one, inertia = rig if rig.space is SPACE else impacts, impacts.mass_diagonal[:, -1]
    scale = (one.v_post - one.v_pre)[:, : one.space.d].norm(dim=-1) * (impacts.mass / inertia).sqrt()
    return (inertia * (scale + scale.median()))[:, None]


def _sigma(residual: Float[Tensor, " n"], noise: Float[Tensor, "..."]) -> Float[Tensor, " n"]:
    """Standard deviations: the noise, and so much more for all that the median of residuals agrees with both."""
    low, high = 0.0, _spread(residual) + 1e-12
    if not noise.any():
        return residual.new_tensor(high)
    for _ in range(30):
        middle = (low + high) / 2
        more = _spread(residual / (noise**2 + middle**2).sqrt()) > 1
        low, high = (middle, high) if more else (low, middle)
    return (noise**2 + high**2).sqrt()


def _spread(residual: Float[Tensor, " n"]) -> float:
    return (MAD_SCALE * residual.abs().median()).item()


def _fitted(
    impacts: Impacts, free: Mapping[str, Estimate], known: Mapping[str, Estimate]
) -> tuple[dict[str, Estimate], float]:
    """Estimates of what is free, and the spread of the residual."""
    names, n = [*free, *known], len(free)
    both = [*free.values(), *known.values()]
    wanted = torch.tensor([one.value for one in both], dtype=torch.float64)
    errors = torch.tensor([max(one.error, 1e-9) for one in both], dtype=torch.float64)
    at = lambda value: dict(zip(names, value.tolist(), strict=True))  # noqa: E731
    value, normal, noise = wanted.clone(), torch.diag(errors**-2), _noise(impacts, at(wanted))
    for _ in range(_STEPS):
        off = _imbalance(impacts, at(value))
        slight = _SLIGHT * torch.eye(len(names), dtype=torch.float64)
        X = torch.stack([(_imbalance(impacts, at(value + one)) - off) / _SLIGHT for one in slight], -1)
        step = torch.zeros_like(value)
        for _ in range(_ROUNDS):
            residual = off + X @ step
            sigma = _sigma(residual, noise)
            weight = biweight(residual / sigma) / sigma**2
            normal = X.mT @ (weight[:, None] * X) + torch.diag(errors**-2)
            score = errors**-2 * (wanted - value) - X.mT @ (weight * off)
            step[:n] = torch.linalg.solve(normal[:n, :n], score[:n])
        value = value + step
    inverse = torch.linalg.inv(normal[:n, :n])
    through = inverse @ normal[:n, n:] * errors[n:]
    error = (inverse + through @ through.mT).diagonal().sqrt()
    estimates = {
        name: Estimate(value=x, error=e) for name, x, e in zip(free, value.tolist(), error.tolist(), strict=False)
    }
    return estimates, _spread(_imbalance(impacts, at(value)))


def _physical(impacts: Impacts, known: Mapping[str, Estimate]) -> float:
    """Least spread that a moment P_n a, |P_n| a sign(ω) or a loss of spin or speed after contact leaves."""
    if impacts.space is SPACE:  # three moments of each impact are no such cause's
        return math.inf
    rig = changed(impacts, {name: one.value for name, one in known.items()})
    terms, v, r = torque(rig), rig.v_post, rig.r
    gyration = rig.inertia / rig.mass
    push = (rig.v_post - rig.v_pre)[:, 1] / gyration
    columns = (push, push * rig.v_pre[:, 2].sign(), v[:, 2], (r[:, 0] * v[:, 1] - r[:, 1] * v[:, 0]) / gyration)
    weight = 1 / (terms.scale + terms.scale.median())
    y, least = terms.residual * weight, math.inf
    for column in columns:
        x = column * weight
        slope, keep = 0.0, torch.ones_like(x)
        for _ in range(_ROUNDS):
            slope = ((keep * x * y).sum() / (keep * x * x).sum().clamp_min(1e-300)).item()
            remaining = y - slope * x
            keep = biweight(remaining / max(_spread(remaining), 1e-12))
        least = min(least, _spread(y - slope * x))
    return least
