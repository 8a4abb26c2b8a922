"""What a rig is, from the moment balance of impacts without any law of contact, and impacts as the rig card has them.

    I₀ e^κ Δω = r_x P_n − r_y P_t        P = m Δv, r and v about the centre of mass

holds whatever friction and restitution are.  `fit_balance` finds the changes of what was stated that close it: the
inertia and the centre of mass, with zero of θ, outline and its place as far as other measurements leave them open.  It
is linear least squares with priors and Tukey's biweight, linearised again a few times.

Three causes outside the card move contact points as well, and are fitted beside it to recordings:

    swing    s, turn of a body while a contact lasts, over Δω: flights meet in a kink, the body turns smoothly
    late     s from the instant of a frame's angle to that of its position, over the mean of ω before and after
    depth    m by which contacts lie deeper: heights show only how this changes with θ

A moment at the contact, a spin or a speed that is lost after it do not close the balance either, and are physics.  Each
is fitted alone in place of the rig; `physical` says how much of the imbalance the best of them removes.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import combinations

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.numerics import MAD_SCALE
from contactlearn.data.audit.moments import torque
from contactlearn.mechanics.apparatus import CHANGES, Apparatus, Estimate
from contactlearn.mechanics.bodies import contact_points
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import rotate
from contactlearn.mechanics.shapes import Cuboid, Ellipse, Polygon, Shape

_STEPS, _ROUNDS = 4, 12  # linearisations, and weights of each
_BIWEIGHT = 4.685  # robust standard deviations at which the weight is 0
_INERTIA = 0.5  # standard deviation that is expected of ln I/I₀
_SHARE = 0.1  # standard deviation that is expected of an angle in rad, and of a length over the distance of contacts
_COMPARED, _NEARLY = 400, 1.1  # impacts on which combinations are compared, and spread over the least that is as good
_FEWEST = 5  # impacts for each change, at least
_CLEARLY = 0.8  # of the spread that the best single physical cause leaves, below which the rig explains the balance
_SLIGHT = 1e-6  # of a difference quotient: rad, relative, of a metre, or of a second
_SWING = 3e-4  # s, standard deviation that is expected of `swing`: a tenth of the longest contact
_LATE = 5e-4  # s, of `late`
_DEPTH = 0.005  # of `depth`, relative to the distance of contacts


def changed(impacts: Impacts, change: Mapping[str, float]) -> Impacts:
    """Return impacts as they are after changes of what was stated: fields of `Apparatus`, `swing`, `late`, `depth`.

    The floor becomes level, positions and velocities are those of the centre of mass.
    """
    if not any(change.values()):
        return impacts.replace(validate=False)
    get = lambda name: change.get(name, 0.0)  # noqa: E731
    tilt, theta = get("slope"), impacts.q[:, 2]
    turned = theta - tilt + get("orientation")
    spins = impacts.v_pre[:, 2], impacts.v_post[:, 2]
    turned = turned + get("swing") * (spins[1] - spins[0]) + get("late") * (spins[1] + spins[0]) / 2
    middle, centre = (torch.tensor([get(f"{name}_a"), get(f"{name}_b")]).to(theta) for name in ("middle", "centre"))
    level = torch.full_like(theta, -tilt)
    r, shape = rotate(impacts.r, level), impacts.shape
    if shape is not None:
        before = contact_points(shape, impacts.body, theta)
        shape = (
            {name: reshaped(one, change) for name, one in shape.items()}
            if isinstance(shape, Mapping)
            else reshaped(shape, change)
        )
        r = r + contact_points(shape, impacts.body, turned) - rotate(before, level)
    d = rotate(centre.expand(len(theta), 2), turned)
    r = r + rotate((middle - centre).expand(len(theta), 2), turned) - torch.tensor([0.0, get("depth")]).to(r)

    def velocity(v: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
        across = v[:, 2:] * torch.stack((-d[:, 1], d[:, 0]), -1)
        return torch.cat((rotate(v[:, :2], level) + across, v[:, 2:]), -1)

    def pose(q: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
        return torch.cat((rotate(q[:, :2], level) + d, q[:, 2:] - tilt + get("orientation")), -1)

    return impacts.replace(
        shape=shape,
        r=r,
        q=pose(impacts.q),
        q_post=None if impacts.q_post is None else pose(impacts.q_post),
        v_pre=velocity(impacts.v_pre),
        v_post=velocity(impacts.v_post),
        inertia=impacts.inertia * math.exp(get("inertia")),
        validate=False,
    )


def reshaped(shape: Shape, change: Mapping[str, float]) -> Shape:
    """Return a shape with other corners or semi-axes; a body of another kind stays as it is."""
    match shape:
        case Polygon():
            return replace(
                shape, corner=min(max(shape.corner + change.get("corner", 0.0), 0.0), shape.largest_corner())
            )
        case Cuboid():
            return replace(shape, corner=min(max(shape.corner + change.get("corner", 0.0), 0.0), min(shape.half)))
        case Ellipse(semi_axes=(a, b)):
            longer = change.get("oblong", 0.0)
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
        left: robust standard deviation of what is left, as a share of the spin that |Δv| makes at a radius of gyration.
        given: the same of the impacts as they are.
        physical: the same with the best single moment at the contact, or loss after it, in place of the rig.
    """

    estimates: dict[str, Estimate]
    left: float
    given: float
    physical: float


def fit_balance(impacts: Impacts, free: Mapping[str, float], known: Mapping[str, Estimate] = {}) -> BalanceFit:
    """Fit changes of what was stated to the moment balance.

    Args:
        impacts: as stated.
        free: standard deviations that are expected of changes about which nothing is known.
        known: estimates from other measurements, which take part with their errors.
    """
    prior = {name: Estimate(value=0.0, error=error) for name, error in free.items()} | dict(known)
    at = {name: one.value for name, one in prior.items()}
    at, error, left = _fitted(impacts, at, prior)
    given = _spread(_imbalance(impacts, {}))
    estimates = {name: Estimate(value=at[name], error=error[name]) for name in prior}
    return BalanceFit(estimates=estimates, left=left, given=given, physical=_physical(impacts, known))


def with_balance(impacts: Impacts, rig: Apparatus) -> Apparatus:
    """Return a rig card with what the moment balance adds to it; the same where it does not close, or physics may.

    The inertia is fitted with all that changes contact points, as far as that is known.  Systematic errors of the
    latter do not shrink with the number of impacts: they keep the errors of their own measurement.
    """
    known = {name: one for name in CHANGES if (one := getattr(rig, name)) is not None}
    if len(impacts) < _FEWEST * (len(known) + 1):
        return rig
    depth = _DEPTH * impacts.r.norm(dim=-1).median().item()
    fit = fit_balance(impacts, {"inertia": _INERTIA, "swing": _SWING, "late": _LATE, "depth": depth}, known)
    trusted = fit.left < _CLEARLY * min(fit.physical, fit.given)
    if not trusted:
        return rig
    estimates = {name: one for name, one in fit.estimates.items() if name in CHANGES}
    errors = {name: one.error for name, one in known.items()}
    return replace(rig, **{name: replace(one, error=errors.get(name, one.error)) for name, one in estimates.items()})


def simplest_rig(impacts: Impacts) -> BalanceFit | None:
    """Return the fewest changes of what was stated that close the balance of a table nearly as well as any.

    Combinations of inertia, zero of θ, outline and its place are compared; None where none closes it clearly better.
    """
    some = impacts[torch.linspace(0, len(impacts) - 1, min(len(impacts), _COMPARED)).round().long()]
    length = _SHARE * some.r.norm(dim=-1).median().item()
    groups = [{"inertia": _INERTIA}]
    if impacts.shape is not None:
        groups += [
            {"orientation": _SHARE},
            {"corner": length, "oblong": length},
            {"middle_a": length, "middle_b": length},
        ]
    fits = [
        (count, fit_balance(some, {name: error for group in chosen for name, error in group.items()}))
        for count in range(1, len(groups) + 1)
        for chosen in combinations(groups, count)
        if len(some) >= _FEWEST * 2 * count
    ]
    least = min((fit.left for _, fit in fits), default=math.inf)
    near = [(count, fit.left, fit) for count, fit in fits if fit.left <= least * _NEARLY]
    best = min(near, key=lambda one: one[:2])[2] if near else None
    return best if best and best.left < _CLEARLY * best.given else None


def _imbalance(impacts: Impacts, change: Mapping[str, float]) -> Float[Tensor, " n"]:
    """Residual of the balance, in units of the spin that |Δv| makes at the stated radius of gyration."""
    terms, scale = torque(changed(impacts, change)), torque(impacts).scale
    return terms.residual * math.exp(change.get("inertia", 0.0)) / (scale + scale.median())


def _spread(residual: Float[Tensor, " n"]) -> float:
    return (MAD_SCALE * residual.abs().median()).item()


def _fitted(
    impacts: Impacts, at: dict[str, float], prior: Mapping[str, Estimate]
) -> tuple[dict[str, float], dict[str, float], float]:
    """Values, standard errors and the spread that is left."""
    names = [*prior]
    wanted = torch.tensor([prior[name].value for name in names], dtype=torch.float64)
    errors = torch.tensor([max(prior[name].error, 1e-9) for name in names], dtype=torch.float64)
    value, covariance, off = wanted.clone(), torch.zeros(0), _imbalance(impacts, at)
    for _ in range(_STEPS):
        off = _imbalance(impacts, dict(zip(names, value.tolist(), strict=True)))
        columns = []
        for k in range(len(names)):
            moved = value.clone()
            moved[k] += _SLIGHT
            columns.append((_imbalance(impacts, dict(zip(names, moved.tolist(), strict=True))) - off) / _SLIGHT)
        X, step = torch.stack(columns, -1), torch.zeros_like(value)
        for _ in range(_ROUNDS):
            residual = off + X @ step
            spread = max(_spread(residual), 1e-12)
            weight = (1 - (residual / (_BIWEIGHT * spread)) ** 2).clamp_min(0) ** 2 / spread**2
            normal = X.mT @ (weight[:, None] * X) + torch.diag(errors**-2)
            step = torch.linalg.solve(normal, -X.mT @ (weight * off) + errors**-2 * (wanted - value))
            covariance = torch.linalg.inv(normal)
        value = value + step
    at = dict(zip(names, value.tolist(), strict=True))
    return at, dict(zip(names, covariance.diagonal().sqrt().tolist(), strict=True)), _spread(_imbalance(impacts, at))


def _physical(impacts: Impacts, known: Mapping[str, Estimate]) -> float:
    """Least spread that a moment P_n a, |P_n| a sign(ω) or a loss of spin or speed after contact leaves."""
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
            left = y - slope * x
            keep = (1 - (left / (_BIWEIGHT * max(_spread(left), 1e-12))) ** 2).clamp_min(0) ** 2
        least = min(least, _spread(y - slope * x))
    return least
