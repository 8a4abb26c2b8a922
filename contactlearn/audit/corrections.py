"""Named corrections of measurements: each a pure function from impacts to impacts, asked for by name.

    data.correct=[mirrored_x]              corrections in the order in which they are applied
    correct(impacts, ["mirrored_x"])       the same as a call

What the audit finds names the correction that undoes it; nothing is corrected that was not asked for,
and the corrected impacts say so in their source.  Most corrections undo themselves (a mirror, a swap);
units divide by what was multiplied.  Three are estimated from the data: the factor on the moment of
inertia, and which trials are duplicates or gross outliers.

Trials that gain energy have no correction: to drop them is to choose by the outcome, which biases every ε.
A column swap of x and y leaves θ and ω as they are; axes that are turned by 90° are a swap and a mirror.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from contactlearn.errors import DataError, UnknownNameError
from contactlearn.impacts import Impacts
from contactlearn.mechanics import rotate
from contactlearn.shapes import Polygon

_POSES, _VELOCITIES = ("q", "q_post"), ("v_pre", "v_post")


class Correction(NamedTuple):
    """What was wrong, as one reads it in a report, and the function that puts it right."""

    description: str
    function: Callable[[Impacts], Impacts]


def correct(impacts: Impacts, names: Sequence[str]) -> Impacts:
    """The impacts with the named corrections applied in this order; their source says so.

    Impacts that are `suspect` stay so; the others are validated in full after the last correction.

    Raises:
        UnknownNameError: no such correction.
        DataError: names that are not a list, a correction that the data does not allow, or impacts
            that break a rule once corrected.
    """
    if isinstance(names, str):
        raise DataError(f"corrections must be a list of names, such as [{names}], got {names!r}")
    for name in names:
        if name not in CORRECTIONS:
            raise UnknownNameError("correction", str(name), CORRECTIONS)
    if not names:
        return impacts
    corrected = impacts.replace(suspect=True)
    for name in names:
        corrected = CORRECTIONS[name].function(corrected)
    return corrected.replace(suspect=impacts.suspect, source=f"{impacts.source} (corrected: {', '.join(names)})")


# --- What the data says of itself; the audit asks the same questions ---------------------------


class Torque(NamedTuple):
    """Terms [N] of the moment balance spin = normal + tangential, all in rad/s."""

    spin: Tensor  # Δω
    normal: Tensor  # r_x P_n / I
    tangential: Tensor  # −r_y P_t / I
    scale: Tensor  # |Δv| / ρ with ρ² = I/m: the spin that the same momentum at one radius of gyration makes

    @property
    def residual(self) -> Tensor:
        """τ / I: what no point contact can have made."""
        return self.spin - self.normal - self.tangential

    @property
    def imbalance(self) -> Tensor:
        """|residual| relative to the terms, in [0, 1]; a twentieth of `scale` keeps tiny terms out of it."""
        size = self.spin.abs() + self.normal.abs() + self.tangential.abs() + 0.05 * self.scale
        return (self.residual.abs() / size.clamp_min(torch.finfo(size.dtype).tiny)).clamp_max(1)


def torque(impacts: Impacts) -> Torque:
    """The moment balance I Δω = r_x P_n − r_y P_t with P = m Δv, term by term."""
    dv = impacts.v_post - impacts.v_pre
    gyration = impacts.inertia / impacts.mass
    normal, tangential = impacts.r[:, 0] * dv[:, 1] / gyration, -impacts.r[:, 1] * dv[:, 0] / gyration
    return Torque(dv[:, 2], normal, tangential, dv[:, :2].norm(dim=-1) / gyration.sqrt())


def inertia_factor(impacts: Impacts) -> float:
    """Factor on I at which the moments balance; nan where no positive one is a fit.

    The geometric mean of the least-absolute lines through the origin of r × P over I Δω and of I Δω over
    r × P, so that noise in neither pulls it to one side.  Outliers hardly matter.
    """
    terms = torque(impacts)
    moment = terms.normal + terms.tangential
    one, other = _slope(moment, terms.spin), _slope(terms.spin, moment)
    return math.sqrt(one / other) if one > 0 and other > 0 else math.nan


def _slope(y: Tensor, x: Tensor) -> float:
    """Least absolute deviations of y = slope · x: the median of y/x, weighted by |x|."""
    there = x != 0
    ratio, order = (y[there] / x[there]).sort()
    share = x[there].abs()[order].cumsum(0)
    return ratio[torch.searchsorted(share, share[-1:] / 2)].item() if len(ratio) else math.nan


def kinetic_energy(impacts: Impacts) -> tuple[Tensor, Tensor]:
    """Kinetic energy [N] in J before and after contact."""
    weight = torch.stack((impacts.mass, impacts.mass, impacts.inertia), -1)
    return tuple(0.5 * (weight * v**2).sum(-1) for v in (impacts.v_pre, impacts.v_post))


def repeated(impacts: Impacts) -> Tensor:
    """Trials [N] whose every pose and velocity is, bit for bit, that of an earlier row."""
    numbers = torch.cat((impacts.r, impacts.q, impacts.v_pre, impacts.v_post), -1)
    seen: set[tuple[float, ...]] = set()
    twice = []
    for row in map(tuple, numbers.tolist()):
        twice.append(row in seen)
        seen.add(row)
    return torch.tensor(twice)


GROSS = 12.0
"""Residuals beyond this many robust standard deviations are gross; normal noise never is, heavy tails hardly."""


def gross_outliers(impacts: Impacts) -> dict[str, Tensor]:
    """Trials [N] that cannot be what was measured, by reason.

    A moment balance that is off by `GROSS` robust standard deviations and a third of its own terms; twice
    the energy that came in; no approach; a mass or inertia twice or half that of the same object's trials.
    """
    terms, left = torque(impacts), _least_residual(impacts)
    before, after = kinetic_energy(impacts)
    spread = 1.4826 * terms.residual.abs().median()
    return {
        "moment": (left > GROSS * spread) & (terms.imbalance > 1 / 3),
        "energy": after > 2 * before,
        "approach": impacts.v_c[:, 1] >= 0,
        "mass": _unlike(impacts, impacts.mass) | _unlike(impacts, impacts.inertia),
    }


def _least_residual(impacts: Impacts) -> Tensor:
    """|τ| / I [N] at the given contact point or, for a polygon, at either of its two lowest corners.

    A body that lands nearly flat may touch with the other corner, for which no measurement is to blame.
    """
    least = torque(impacts).residual.abs()
    if isinstance(impacts.shape, Polygon):
        corners = rotate(torch.tensor(impacts.shape.vertices, dtype=torch.float64), impacts.q[:, 2, None])
        lowest = corners[..., 1].topk(2, largest=False).indices
        for corner in lowest.unbind(-1):
            r = corners[torch.arange(len(impacts)), corner]
            least = least.minimum(torque(impacts.replace(r=r, suspect=True)).residual.abs())
    return least


def _unlike(impacts: Impacts, values: Tensor) -> Tensor:
    """Where a value [N] is twice or half its object's median; where that is common, objects share a name."""
    unlike = torch.zeros(len(impacts), dtype=torch.bool)
    for name in set(impacts.object):
        same = torch.tensor([other == name for other in impacts.object])
        far = same & ((values / values[same].median()).log().abs() > math.log(2))
        if far.sum() < 0.1 * same.sum():
            unlike |= far
    return unlike


# --- The corrections ---------------------------------------------------------------------------


def _scaled(impacts: Impacts, factors: Sequence[float], *names: str) -> Impacts:
    """Fields of `impacts`, those that it has, multiplied component by component."""
    factor = torch.tensor(factors, dtype=torch.float64)
    return impacts.replace(**{name: x * factor for name in names if (x := getattr(impacts, name)) is not None})


def _mirrored_x(impacts: Impacts) -> Impacts:
    return _scaled(impacts, (-1, 1, 1), *_POSES, *_VELOCITIES)


def _mirrored_y(impacts: Impacts) -> Impacts:
    return _scaled(_scaled(impacts, (1, -1, 1), *_POSES, *_VELOCITIES), (1, -1), "r")


def _mirrored_theta(impacts: Impacts) -> Impacts:
    return _scaled(impacts, (1, 1, -1), *_POSES, *_VELOCITIES)


def _swapped_axes(impacts: Impacts) -> Impacts:
    fields = {name: x for name in (*_POSES, *_VELOCITIES) if (x := getattr(impacts, name)) is not None}
    return impacts.replace(r=impacts.r.flip(-1), **{name: x[:, [1, 0, 2]] for name, x in fields.items()})


def _swapped_pre_post(impacts: Impacts) -> Impacts:
    swapped = impacts.replace(v_pre=impacts.v_post, v_post=impacts.v_pre)
    return swapped if impacts.q_post is None else swapped.replace(q=impacts.q_post, q_post=impacts.q)


def _in_degrees(*names: str) -> Callable[[Impacts], Impacts]:
    return lambda impacts: _scaled(impacts, (1, 1, math.pi / 180), *names)


def _millimetres(impacts: Impacts) -> Impacts:
    return _scaled(_scaled(impacts, (1e-3, 1e-3, 1), *_POSES), (1e-3, 1e-3), "r")


def _inertia_scaled(impacts: Impacts) -> Impacts:
    factor = inertia_factor(impacts)
    if not 0 < factor < math.inf:
        raise DataError(
            f"{impacts.source}: no positive moment of inertia balances the moments; correct the signs first"
        )
    return impacts.replace(inertia=impacts.inertia * factor)


def _drop(impacts: Impacts, bad: Tensor) -> Impacts:
    if bool(bad.all()):
        raise DataError(f"{impacts.source}: none of {len(impacts)} trials would be left")
    return impacts[~bad]


def _drop_outliers(impacts: Impacts) -> Impacts:
    return _drop(impacts, torch.stack([*gross_outliers(impacts).values()]).any(0))


def _averaged(column: int) -> Callable[[Impacts], Impacts]:
    def average(impacts: Impacts) -> Impacts:
        v_pre = impacts.v_pre.clone()
        v_pre[:, column] = v_pre[:, column].mean()
        return impacts.replace(v_pre=v_pre)

    return average


def _ordered_by_time(impacts: Impacts) -> Impacts:
    if impacts.time is None:
        raise DataError(f"{impacts.source}: has no column time to order the trials by")
    return impacts.replace(order=impacts.time.argsort(stable=True).argsort() + 1)


CORRECTIONS = {
    "swapped_pre_post": Correction(
        "what is called before contact was measured after it: velocities and poses", _swapped_pre_post
    ),
    "mirrored_y": Correction("y points down: positions, velocities and the contact point", _mirrored_y),
    "swapped_axes": Correction("x and y are exchanged: positions, velocities, contact point", _swapped_axes),
    "mirrored_x": Correction(
        "x points left in positions and velocities, but not in θ, ω and the contact point", _mirrored_x
    ),
    "mirrored_theta": Correction("θ and ω are positive clockwise", _mirrored_theta),
    "contact_point_sign": Correction(
        "r points from the contact to the centre of mass", lambda impacts: _scaled(impacts, (-1, -1), "r")
    ),
    "contact_point_mirrored": Correction(
        "x of the contact point points left", lambda impacts: _scaled(impacts, (-1, 1), "r")
    ),
    "degrees_omega": Correction("ω is in °/s", _in_degrees(*_VELOCITIES)),
    "degrees_theta": Correction("θ is in degrees", _in_degrees(*_POSES)),
    "degrees": Correction("θ is in degrees and ω in °/s", _in_degrees(*_POSES, *_VELOCITIES)),
    "millimetres": Correction("positions and the contact point are in mm", _millimetres),
    "millimetres_velocity": Correction(
        "velocities are in mm/s", lambda impacts: _scaled(impacts, (1e-3, 1e-3, 1), *_VELOCITIES)
    ),
    "grams": Correction("the mass is in g", lambda impacts: impacts.replace(mass=impacts.mass * 1e-3)),
    "inertia_scaled": Correction(
        "the moment of inertia is off by the factor that the moment balance of the data asks for", _inertia_scaled
    ),
    "drop_duplicates": Correction(
        "trials occur more than once: the first is kept", lambda impacts: _drop(impacts, repeated(impacts))
    ),
    "drop_outliers": Correction("gross outliers, which cannot be what was measured", _drop_outliers),
    "averaged_vx": Correction("v_x before impact varies by no more than its noise: its mean is used", _averaged(0)),
    "averaged_vy": Correction("v_y before impact varies by no more than its noise: its mean is used", _averaged(1)),
    "averaged_omega": Correction("ω before impact varies by no more than its noise: its mean is used", _averaged(2)),
    "ordered_by_time": Correction("the order of the trials is not that of their times", _ordered_by_time),
}
"""By name; the order is that in which several are applied where the audit proposes them together."""
