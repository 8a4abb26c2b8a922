"""A floor, ramp or wall that is inclined against the axes by any angle, as the moment balance shows it.

The normal is (−sin φ, cos φ).  Every φ of a circle is tried: the axes are turned by it, and the trials contradict a
floor below the body least at the right one.  There the moment balance gives φ with its standard error.  Small angles
are the effect `surface_tilt`; this is for those beyond its range, and needs no law of contact either.
"""

import math
from dataclasses import replace

import torch

from contactlearn.core.numerics import readable
from contactlearn.data.audit.contradictions import contradictions
from contactlearn.data.audit.moments import Columns
from contactlearn.data.audit.rig import changed, fit_balance
from contactlearn.mechanics.apparatus import Estimate
from contactlearn.mechanics.bodies import contact_points
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import rotate

_DEGREE = math.radians(1)
_TRIED = _DEGREE * torch.arange(-180, 180, dtype=torch.float64)  # rad
_TRIALS = 400  # on which every angle is tried, spread evenly
_INDISTINCT = 0.01  # contradictions by which an angle may have more than the best one and be right
_WIDEST = 0.2  # rad, farthest of those angles from the best one
_FREE = {"slope": 0.1, "inertia": 0.5}  # rad, and of ln I/I₀, which must not look like an angle: expected deviations
_ROUNDS = 3  # fits of the angle, each about the one before
# of |r|: distance from the shape's lowest point above a level floor up to which r was computed there
_ON_LEVEL_FLOOR = 1e-3


def floor_angle(impacts: Impacts) -> Estimate | None:
    """Return the angle φ in rad by which the floor is inclined, with its standard error; None where that is open."""
    if impacts.shape is not None:  # where it touches a level floor, a turn moves it; where it was seen, none would show
        impacts = impacts.replace(r=contact_points(impacts.shape, impacts.body, impacts.q[:, 2]), validate=False)
    some = impacts[torch.linspace(0, len(impacts) - 1, min(len(impacts), _TRIALS)).round().long()]
    total = torch.stack([*contradictions(_turned(some)).values()]).sum(0).mean(-1)
    best = _TRIED[total.argmin()]
    near = (_TRIED[total < total.min() + _INDISTINCT] - best + math.pi).remainder(2 * math.pi) - math.pi
    if near.abs().max() > _WIDEST:
        return None
    width = (near.max() - near.min()).item() / 2 + _DEGREE / 2
    whole = Estimate(value=(best + (near.max() + near.min()) / 2).item(), error=width)
    angle, free = whole, {name: Estimate(value=0.0, error=error) for name, error in _FREE.items()}
    for _ in range(_ROUNDS):
        step = fit_balance(levelled(impacts, angle.value), free).estimates["slope"]
        angle = Estimate(value=angle.value + step.value, error=step.error)
    return angle if angle.error < width else whole  # a corner that stays lowest shows no small turn


def levelled(impacts: Impacts, angle: float) -> Impacts:
    """Return the impacts in axes along and against a floor that is inclined by an angle in rad.

    A contact point that was computed above a level floor is computed again above the inclined one; one that was seen
    stays where it is on the body.
    """
    known = impacts if _computed(impacts) else impacts.replace(shape=None, validate=False)
    level = changed(known, {"slope": angle})
    turn = torch.block_diag(rotate(torch.eye(2, dtype=torch.float64), level.q.new_tensor(angle)), torch.ones(1, 1))
    names = [f"v_{time}_cov" for time in ("pre", "post") if getattr(impacts, f"v_{time}_cov") is not None]
    return level.replace(
        shape=impacts.shape,
        **{name: turn @ getattr(impacts, name) @ turn.T for name in names},
        validate=False,
    )


def incline_text(impacts: Impacts) -> str:
    """Write by how much the floor is inclined."""
    angle = floor_angle(impacts)
    assert angle is not None  # the finding is about it
    normal = ", ".join(f"{x:.2f}".replace("-", "−") for x in (-math.sin(angle.value), math.cos(angle.value)))
    value = readable(angle.value, angle.error, "rad")
    return f"the floor is inclined by {value} against the axes, its normal is ({normal})"


def _computed(impacts: Impacts) -> bool:
    """Whether the contact points are the lowest ones of the stated shape above a level floor."""
    if impacts.shape is None:
        return False
    expected = contact_points(impacts.shape, impacts.body, impacts.q[:, 2])
    return bool((impacts.r - expected).norm(dim=-1).median() <= _ON_LEVEL_FLOOR * expected.norm(dim=-1).median())


def _turned(impacts: Impacts) -> Columns:
    """The impacts in axes that are turned by each of the angles."""
    columns, angle = Columns.of(impacts), _TRIED[:, None]
    theta = impacts.q[:, 2] - angle
    computed = impacts.shape is not None and _computed(impacts)
    r = contact_points(impacts.shape, impacts.body, theta) if impacts.shape and computed else rotate(impacts.r, -angle)
    each = {
        name: torch.cat((rotate(x[:, :2], -angle), (theta if name == "q" else x[:, 2].expand_as(theta))[..., None]), -1)
        for name, x in (("q", impacts.q), ("v_pre", impacts.v_pre), ("v_post", impacts.v_post))
    }
    fields = {name: getattr(columns, name).expand(len(_TRIED), -1) for name in ("mass", "inertia")}
    return replace(columns, q_post=None, r=r, **fields, **each)
