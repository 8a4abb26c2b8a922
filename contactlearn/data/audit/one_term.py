"""One wrong term of the moment balance in space, where no hypothesis about units and axes closes it.

    I Δω = r × m Δv

Each explanation has a few numbers, in which the balance is linear:

    products of inertia   moments of inertia about axes that are no principal ones: J in body axes, not diag(I)
    scale of lengths      heights at contact against the shape, and velocities, by one factor
    scale of an axis      v_x, v_y and v_z times a factor each, as of one camera's calibration
    contact points        the same vector is added to r in all trials, in world axes: the height of the floor
    mounting              spins are turned against the axes of the body, as a gyroscope in its housing is
    exchanged spins       two components of the spin before impact, after it, or both
    heading               orientation and spins are turned about the vertical, perhaps by a growing angle
    bodies                a factor on I of each body, as of masses that were exchanged

An explanation is taken where it leaves less than half of what the data as given leave, and than what effects of
physics do: other principal moments, a contact that moves with the body, a loss of spin or of speed, a force along the
normal.  Nothing is corrected: which column is wrong is for the user to say.
"""

import math
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from contactlearn.core.numerics import MAD_SCALE, biweight, number
from contactlearn.data.audit.moments import best_turn, torque
from contactlearn.data.audit.result import Finding, evidence_of
from contactlearn.data.audit.trials import named_by_mass
from contactlearn.mechanics.bodies import contact_points, numbered
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import in_body, in_world, matvec, moment, rotation, spin, turn_quaternion

_LEFT = 0.5  # of the residual, that an explanation leaves at most: a quarter of its square
_CLOSED = 0.03  # residual over the terms up to which there is nothing to explain
_SIGMAS = 6.0  # standard errors by which a number of it differs from none
_ROUNDS = 10  # of robust weights
_FEWEST = 30  # trials
_OFF = 0.03  # least relative error of a scale or a factor, and of a product of inertia, that is said
_TURNED = math.radians(5)  # least angle of a heading over all trials that is said
_UPRIGHT = torch.tensor([1.0, 0.0, 0.0, 0.0], dtype=torch.float64)


class _Explanation(NamedTuple):
    """What it leaves of the balance in the median, relative to |Δv| / ρ, its name and the sentence about it."""

    left: float
    name: str
    sentence: str


class _Fit(NamedTuple):
    """Values of numbers, their standard errors, and the residuals of the trials relative to |Δv| / ρ."""

    values: Float[Tensor, " p"]
    errors: Float[Tensor, " p"]
    residuals: Float[Tensor, " n"]

    @property
    def left(self) -> float:
        """The residual in the median."""
        return self.residuals.median().item()

    def differ(self, expected: float, least: float = _OFF) -> Bool[Tensor, " p"]:
        """Which numbers differ from the expected one, surely and by so much."""
        off = (self.values - expected).abs()
        return (off > least) & (off > _SIGMAS * self.errors)


def one_term_findings(impacts: Impacts) -> list[Finding]:
    """Find the one wrong term that closes the moment balance, where physics does not; none in the plane."""
    terms = torque(impacts)
    if len(impacts) < _FEWEST:
        return []
    size, scale = terms.size(terms.residual), terms.scale.clamp_min(1e-300)
    given = (size / scale).median().item()
    if given < _CLOSED * (terms.size(terms.spin) / scale).median().item():
        return []
    if (scaled := _scale_of_lengths(impacts)) is not None:
        return [scaled]
    by_physics = min(fit.left for fit in _physical(impacts))
    explanations = [_products, _scales, _contact_points, _mounting, _exchanged, _heading, _bodies]
    found = [one for explain in explanations if (one := explain(impacts)) is not None]
    best = min(found, key=lambda one: one.left, default=None)
    if best is None or best.left > _LEFT * min(given, by_physics):
        return []
    sentence = (
        f"{best.sentence}; the moment balance leaves {best.left / given:.0%} of its residual then, and "
        f"{by_physics / given:.0%} with any one effect of physics"
    )
    evidence = evidence_of(
        ("residual_before", given), ("residual_after", best.left), ("residual_by_physics", by_physics)
    )
    return [Finding(name=best.name, sentence=sentence, evidence=evidence)]


def _fit(impacts: Impacts, y: Float[Tensor, "n 3"], X: Float[Tensor, "n 3 p"]) -> _Fit:
    """Fit spins y in rad/s by X c, relative to |Δv| / ρ, by Tukey's biweight."""
    return _weighed(y, X, torque(impacts).scale.clamp_min(1e-300))


def _weighed(y: Float[Tensor, "n d"], X: Float[Tensor, "n d p"], scale: Float[Tensor, " n"]) -> _Fit:
    y, X = y / scale[:, None], X / scale[:, None, None]
    weight = torch.ones(len(y), dtype=y.dtype)
    c, error, size = X.new_zeros(X.shape[-1]), X.new_zeros(X.shape[-1]), y.norm(dim=-1)
    for _ in range(_ROUNDS):
        gram = torch.linalg.pinv((weight[:, None, None] * (X.mT @ X)).sum(0), hermitian=True)
        c = gram @ (weight[:, None] * matvec(X.mT, y)).sum(0)
        residual = y - matvec(X, c)
        size = residual.norm(dim=-1)
        error = (gram.diagonal() * (weight * size.square()).sum() / (y.shape[1] * weight.sum())).sqrt()
        weight = biweight(size / (MAD_SCALE * size.median()).clamp_min(1e-300))
    return _Fit(c, error, size)


def _spins(impacts: Impacts, arms: Sequence[Tensor], impulses: Sequence[Tensor]) -> Float[Tensor, "n 3 p"]:
    """Changes of the spin in rad/s by impulses at arms, a column each."""
    moments = (moment(arm, P) for arm, P in zip(arms, impulses, strict=True))
    return torch.stack([spin(impacts.world_inertia, one) for one in moments], -1)


def _physical(impacts: Impacts) -> list[_Fit]:
    """The balance with one effect of physics: all that closes it without a mistake."""
    mass, r, axes = impacts.mass[:, None], impacts.r, torch.eye(3, dtype=torch.float64)
    before, after = impacts.v_pre, impacts.v_post
    body = [in_world(axis.expand(len(impacts), 3), impacts.q) for axis in axes]
    columns = [
        _inertia_terms(impacts)[..., :3],
        _spins(impacts, body, [mass * (after - before)[:, :3]] * 3),
        torch.stack((after[:, 3:], before[:, 3:]), -1),
        _spins(impacts, [r, r], [mass * after[:, :3], mass * before[:, :3]]),
        _spins(impacts, [r], [mass * axes[2]]),
    ]
    return [_fit(impacts, torque(impacts).residual, X) for X in columns]


def _inertia_terms(impacts: Impacts) -> Float[Tensor, "n 3 6"]:
    """Change of the spin that J − diag(I) in body axes asks for: its three moments, and xy, xz, yz."""
    change = in_body(impacts.v_post[:, 3:] - impacts.v_pre[:, 3:], impacts.q)
    x, y, z = change.unbind(-1)
    zero = torch.zeros_like(x)
    rows = [(x, zero, zero), (zero, y, zero), (zero, zero, z), (y, x, zero), (z, zero, x), (zero, z, y)]
    momentum = torch.stack([torch.stack(row, -1) for row in rows], -1)
    inertia = impacts.inertia.mean(0)  # of the scale of J, so that its numbers are relative
    size = torch.cat((inertia, inertia[[0, 0, 1]] + inertia[[1, 2, 2]]))
    turned = [in_world(size[k] * momentum[..., k], impacts.q) for k in range(6)]
    return -torch.stack([spin(impacts.world_inertia, one) for one in turned], -1)


def _products(impacts: Impacts) -> _Explanation | None:
    fit = _fit(impacts, torque(impacts).residual, _inertia_terms(impacts))
    if not fit.differ(0)[3:].any():
        return None
    c, inertia = fit.values, impacts.inertia.mean(0)
    pairs = torch.tensor([[0, 0, 1], [1, 2, 2]])
    values = [(1 + c[:3]) * inertia, c[3:] * (inertia[pairs[0]] + inertia[pairs[1]])]
    diagonal, products = (", ".join(number(x, 3) for x in part.tolist()) for part in values)
    return _Explanation(
        fit.left,
        "products_of_inertia",
        f"the body's axes are not its principal axes: with moments of inertia ({diagonal}) kg m² about x, y, z and "
        f"elements ({products}) kg m² for xy, xz, yz of the inertia matrix, state the principal moments, and "
        "orientations and shape in their axes",
    )


def _scales(impacts: Impacts) -> _Explanation | None:
    P = torch.diag_embed(impacts.mass[:, None] * (impacts.v_post - impacts.v_pre)[:, :3]).unbind(-1)
    fit = _fit(impacts, torque(impacts).spin, _spins(impacts, [impacts.r] * 3, P))
    off = fit.differ(1)
    if not 0 < int(off.sum()) < len("xyz") or (fit.values <= 0).any():  # all of them: another mass, or inertia
        return None
    which = " and ".join(
        f"v_{axis} is {number(1 / x, 3)} times what the moments ask for"
        for axis, x, one in zip("xyz", fit.values.tolist(), off.tolist(), strict=True)
        if one
    )
    return _Explanation(fit.left, "scale_of_axis", f"{which}: is the calibration of that axis right?")


def _scale_of_lengths(impacts: Impacts) -> Finding | None:
    """Heights at contact above the shape's by the factor on velocities that the moments ask for: one calibration."""
    if impacts.shape is None:
        return None
    terms = torque(impacts)
    fit = _fit(impacts, terms.spin, (terms.normal + terms.tangential)[..., None])
    heights = impacts.q[:, 2] / -contact_points(impacts.shape, impacts.body, impacts.q[:, 3:])[:, 2]
    factor, moments = heights.median().item(), 1 / fit.values[0].item()
    agree = abs(factor / moments - 1) < max(_OFF / 2, _SIGMAS * fit.errors[0].item())
    if not agree or abs(factor - 1) < _OFF or (heights - factor).abs().median() > _OFF * factor / 2:
        return None
    sentence = (
        f"lengths are {number(factor, 3)} times what they should be: so are the heights at contact against the shape, "
        f"and the moments ask for velocities that are {number(moments, 3)} times smaller; is the calibration right?"
    )
    evidence = evidence_of(("heights", factor), ("moments", moments))
    return Finding(name="scale_of_lengths", sentence=sentence, evidence=evidence)


def _contact_points(impacts: Impacts) -> _Explanation | None:
    P = impacts.mass[:, None] * (impacts.v_post - impacts.v_pre)[:, :3]
    axes = [axis.expand(len(P), 3) for axis in torch.eye(3, dtype=torch.float64)]
    fit = _fit(impacts, torque(impacts).residual, _spins(impacts, axes, [P] * 3))
    if not fit.differ(0, _OFF * impacts.r.norm(dim=-1).median().item()).any():
        return None
    place = ", ".join(number(-1e3 * x, 3) for x in fit.values.tolist())
    return _Explanation(
        fit.left,
        "contact_points_moved",
        f"the contact points are off by ({place}) mm along x, y, z, the same in all trials: is the floor where it was "
        "taken to be?",
    )


def _mounting(impacts: Impacts) -> _Explanation | None:
    terms = torque(impacts)
    change, needed = (in_body(x, impacts.q) for x in (terms.spin, terms.normal + terms.tangential))
    turn = best_turn(change, needed)
    angle = math.acos(min(1.0, (turn.trace().item() - 1) / 2))
    if angle < _TURNED:
        return None
    left = terms.size(needed - change @ turn.T) / terms.scale.clamp_min(1e-300)
    axis = (turn - turn.T)[[2, 0, 1], [1, 2, 0]] / (2 * math.sin(angle))
    about = ", ".join(number(x, 2) for x in axis.tolist())
    sentence = (
        f"spins are turned against the axes of the body by {number(math.degrees(angle), 3)}° about ({about}) in them: "
        "is the gyroscope mounted so"
    )
    return _Explanation(left.median().item(), "gyroscope_turned", f"{sentence}?")


def _exchanged(impacts: Impacts) -> _Explanation | None:
    found = list[_Explanation]()
    for pair in ("xy", "xz", "yz"):
        order = ["xyz".replace(pair[0], "·").replace(pair[1], pair[0]).replace("·", pair[1]).index(a) for a in "xyz"]
        for when, before, after in (("before", True, False), ("after", False, True), ("before and after", True, True)):
            v_pre, v_post = (
                torch.cat((v[:, :3], v[:, 3:][:, order]), -1) if changed else v
                for v, changed in ((impacts.v_pre, before), (impacts.v_post, after))
            )
            terms = torque(impacts.replace(v_pre=v_pre, v_post=v_post, validate=False))
            left = (terms.size(terms.residual) / terms.scale.clamp_min(1e-300)).median().item()
            sentence = f"ω_{pair[0]} and ω_{pair[1]} {when} impact are exchanged"
            found.append(_Explanation(left, "spins_exchanged", sentence))
    return min(found, key=lambda one: one.left)


def _heading(impacts: Impacts) -> _Explanation | None:
    """Angle about the vertical between r × P and the change of angular momentum, constant or over the order."""
    terms = torque(impacts)
    change = matvec(impacts.world_inertia, terms.spin)[:, :2]
    needed = matvec(impacts.world_inertia, terms.normal + terms.tangential)[:, :2]
    cross, dot = change[:, 0] * needed[:, 1] - change[:, 1] * needed[:, 0], (change * needed).sum(-1)
    order = impacts.order.argsort().argsort().double() / len(impacts) - 0.5
    X = torch.stack((torch.ones_like(order), order), -1)[:, None]
    fit = _weighed(torch.atan2(cross, dot)[:, None], X, torch.ones_like(order))
    large = fit.differ(0, _TURNED)
    if not large.any():
        return None
    vector = torch.nn.functional.pad((X[:, 0] @ fit.values)[:, None], (2, 0))
    before, after = (
        torch.cat((v[:, :3], matvec(rotation(turn_quaternion(_UPRIGHT, vector)), v[:, 3:])), -1)
        for v in (impacts.v_pre, impacts.v_post)
    )
    q = torch.cat((impacts.q[:, :3], turn_quaternion(impacts.q[:, 3:], vector)), -1)
    turned = impacts.replace(q=q, v_pre=before, v_post=after, validate=False)
    corrected = torque(turned)
    left = (corrected.size(corrected.residual) / corrected.scale.clamp_min(1e-300)).median().item()
    whole, growing = (number(-math.degrees(x), 3) for x in fit.values.tolist())
    by = f"by {growing}° from the first trial to the last" if large[1] else f"by {whole}° in all trials"
    sentence = f"orientations and spins are turned about the vertical against velocities and contact points, {by}"
    return _Explanation(left, "heading_drifts" if large[1] else "heading_turned", sentence)


def _bodies(impacts: Impacts) -> _Explanation | None:
    names = impacts.object if len({*impacts.object}) > 1 else named_by_mass(impacts)
    count = Counter(names)
    if not 1 < len(count) <= _FEWEST or min(count.values()) < _FEWEST / len(count):
        return None
    terms, which = torque(impacts), numbered(names)
    needed = terms.normal + terms.tangential
    member = torch.nn.functional.one_hot(which, len(count)).double()
    fit = _fit(impacts, terms.spin, needed[..., None] * member[:, None])
    if int(fit.differ(1).sum()) < 2 or (fit.values <= 0).any():  # one of them is `inertia_error` of a body
        return None
    said = ", ".join(
        f"{number(x, 3)} for {name!r}" for name, x in zip(dict.fromkeys(names), fit.values.tolist(), strict=True)
    )
    return _Explanation(
        fit.left,
        "bodies_exchanged",
        f"bodies have other masses or moments of inertia: the moments ask for inertia over mass divided by {said}; are "
        "their masses exchanged?",
    )
