"""The rig: what it can set before an impact, how well, and what it leaves to chance.

    height       m        of the lowest point above the floor: v_n = −√(2 g h) of the mass centre at contact
    x, y         m        place on the floor
    theta        rad      orientation; in space the tilt of the body's z axis towards `heading`,
    heading      rad      and the body's `turn` about its own z axis, before it is tilted
    v_x, v_y …   m/s      velocity at contact; the vertical one in place of a height
    omega        rad/s    spin; w_x, w_y, w_z in space

A quantity that the rig cannot set has limits too: it is drawn evenly within them at every drop, and only measured.
One that is not named is such a quantity where measurements show its range.  Without measurements its angles may be any,
and everything else is 0.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from contactlearn.core.errors import DataError, UnknownNameError
from contactlearn.diagnosis.discrimination.experiment import STATES
from contactlearn.mechanics.bodies import shapes_among
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import GRAVITY, contact_velocity, turn_quaternion
from contactlearn.mechanics.shapes import Shape, Solid, contact_point
from contactlearn.mechanics.space import PLANE, SPACE, Space

HEIGHT = "height"
NAMES = {PLANE: (HEIGHT, *STATES[PLANE]), SPACE: (HEIGHT, "theta", "heading", "turn", *STATES[SPACE])}
"""What a rig may set, by space; see the module."""
ANGLES = ("theta", "heading", "turn")
_GRAZING = 0.1  # a contact point approaches at more than this share of the body's speed
_LEVELS = 5  # values of a setting whose change has a cost
_MARGIN = 0.05  # share of the measured values beyond the limits of what comes by chance, on either side


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits of a quantity, in SI units.

    Args:
        low: least value.
        high: greatest value.
        precision: standard deviation with which a value is reached.
        share: a further one, as a share of the value.
        settable: whether the rig sets it; if not, it is drawn evenly within the limits.
        cost: of a change from one drop to the next, in drops.

    Raises:
        DataError: limits that are not finite and in order, or a negative precision, share or cost.
    """

    low: float
    high: float
    precision: float = 0.0
    share: float = 0.0
    settable: bool = True
    cost: float = 0.0

    def __post_init__(self) -> None:
        if not -math.inf < self.low <= self.high < math.inf:
            raise DataError(f"limits must be finite numbers [low, high] in order, got [{self.low}, {self.high}]")
        for name in ("precision", "share", "cost"):
            if not 0 <= getattr(self, name) < math.inf:
                raise DataError(f"{name} must be a finite number, at least 0, got {getattr(self, name)}")

    @property
    def chosen(self) -> bool:
        """Whether there is anything to choose."""
        return self.settable and self.high > self.low


@dataclass(frozen=True, kw_only=True)
class Specimen:
    """A body to drop.

    Args:
        mass: in kg.
        inertia: in kg m²; in space three principal moments.
        shape: None where it is not known: orientations and contact points are then those of measured impacts.
        name: of the body.
        measured: impacts of the body, where there are some.

    Raises:
        DataError: neither a shape nor measurements.
    """

    mass: float
    inertia: float | tuple[float, ...]
    shape: Shape | None
    name: str = "body"
    measured: Impacts | None = field(default=None, compare=False, repr=False)

    def __post_init__(self) -> None:
        if self.shape is None and self.measured is None:
            raise DataError(f"the shape of {self.name} must be known before anything is measured; state it")

    @classmethod
    def of(cls, impacts: Impacts) -> "tuple[Specimen, ...]":
        """Return the bodies of measured impacts."""
        shapes, specimens = shapes_among(impacts.shape), list[Specimen]()
        for name in dict.fromkeys(impacts.object):
            own = impacts[[k for k, other in enumerate(impacts.object) if other == name]]
            moments = own.inertia.median(0).values.reshape(-1).tolist()
            inertia = moments[0] if len(moments) == 1 else tuple(moments)
            shape = shapes.get(name, shapes.get(""))
            specimens.append(cls(mass=own.mass.median().item(), inertia=inertia, shape=shape, name=name, measured=own))
        return tuple(specimens)

    @property
    def moments(self) -> tuple[float, ...]:
        """Mass in kg and moments of inertia in kg m²."""
        return (self.mass, *(self.inertia if isinstance(self.inertia, tuple) else (self.inertia,)))

    @property
    def space(self) -> Space:
        """The space in which it moves."""
        if self.measured is not None:
            return self.measured.space
        return SPACE if isinstance(self.shape, Solid) else PLANE

    def placed(
        self, values: Mapping[str, Float[Tensor, "n"]], generator: torch.Generator
    ) -> tuple[Float[Tensor, "n d"], Float[Tensor, "n pose"]]:
        """Return contact points and poses at contact."""
        floor = torch.stack([values[name] for name in ("x", "y") if name in values], -1)
        if self.shape is None:
            assert self.measured is not None
            rows = torch.randint(len(self.measured), (len(floor),), generator=generator)
            r, turned = self.measured.r[rows], self.measured.q[rows, self.space.d :]
        else:
            turned = values["theta"][:, None]
            if self.space is SPACE:
                turned = _quaternions(*(values[name] for name in ANGLES))
            r = contact_point(self.shape, turned if self.space is SPACE else turned[:, 0])
        return r, torch.cat((floor, -r[:, -1:], turned), -1)


@dataclass(frozen=True, kw_only=True)
class Rig:
    """An apparatus that drops bodies; see the module.

    Args:
        limits: of every quantity that it names.
        noise: standard deviations of the measured velocity after impact in m/s and rad/s, three or in space six; used
            before anything is measured.

    Raises:
        DataError: a negative height, or noise that is not positive.
    """

    limits: Mapping[str, Limits]
    noise: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if HEIGHT in self.limits and (low := self.limits[HEIGHT].low) < 0:
            raise DataError(f"height must be at least 0 m above the floor, got {low}")
        if any(not 0 < x < math.inf for x in self.noise):
            raise DataError(f"noise must be positive standard deviations in m/s and rad/s, got {list(self.noise)}")

    @property
    def chosen(self) -> tuple[str, ...]:
        """Names of what is set to different values."""
        return tuple(name for name, one in self.limits.items() if one.chosen)

    def completed(self, specimens: Sequence[Specimen]) -> Self:
        """Return the rig with limits of every quantity, checked against the bodies.

        Raises:
            DataError: nothing can be set; height and vertical velocity are both given, or neither; an orientation of a
                body whose shape is not known; noise of another space.
            UnknownNameError: a quantity that a drop in this space does not have.
        """
        space = specimens[0].space
        names, vertical = NAMES[space], "v_y" if space is PLANE else "v_z"
        for name in self.limits:
            if name not in names:
                raise UnknownNameError("setting of a rig", name, names)
        if not self.chosen:
            raise DataError(
                "the rig can set nothing, and so there is nothing to plan: any drops are as good as any others; give "
                f"limits [low, high] of {', '.join(names)}"
            )
        if HEIGHT in self.limits and vertical in self.limits:
            raise DataError(f"height and {vertical} say the same of a drop; give one of them")
        if (turned := {*ANGLES} & {*self.chosen}) and (one := next((s for s in specimens if not s.shape), None)):
            raise DataError(
                f"{min(turned)} needs the shape of {one.name}, from which the contact point follows; state it"
            )
        if self.noise and len(self.noise) != space.D:
            raise DataError(f"noise must have {space.D} numbers for bodies in the {space}, got {len(self.noise)}")
        measured = [specimen.measured for specimen in specimens if specimen.measured is not None]
        if not measured and not {HEIGHT, vertical} & {*self.limits}:
            raise DataError(f"the rig must state its height, or {vertical} at contact")
        left = HEIGHT if vertical in self.limits or HEIGHT not in self.limits else vertical
        complete = {name: self.limits.get(name) or _by_chance(name, measured) for name in names if name != left}
        return replace(self, limits=complete)

    def draw(self, count: int, seed: int, *, beyond: float = 0.0) -> dict[str, Float[Tensor, "n"]]:
        """Draw values of all quantities evenly within the limits (Sobol), in round numbers that can be set.

        Args:
            count: number of values.
            seed: of the sequence.
            beyond: share of the width by which values are drawn beyond either limit and set to it; not of an angle,
                since the limits of a whole turn are one orientation.
        """
        engine = torch.quasirandom.SobolEngine(len(self.limits), scramble=True, seed=seed)
        room = torch.tensor([0.0 if name in ANGLES else beyond for name in self.limits], dtype=torch.float64)
        unit = ((1 + 2 * room) * engine.draw(count, dtype=torch.float64) - room).clamp(0, 1).unbind(-1)
        return {name: _rounded(name, one, u) for (name, one), u in zip(self.limits.items(), unit, strict=True)}

    def reached(
        self, values: Mapping[str, Float[Tensor, "n"]], generator: torch.Generator
    ) -> dict[str, Float[Tensor, "n"]]:
        """Draw what becomes of values that are set; what is not set is drawn within its limits, whatever they are."""
        found = dict[str, Tensor]()
        for name, one in self.limits.items():
            n = len(next(iter(values.values())))
            if one.settable:
                unit = torch.randn(2, n, generator=generator, dtype=torch.float64)
                found[name] = values[name] + one.precision * unit[0] + one.share * values[name] * unit[1]
            else:
                found[name] = one.low + (one.high - one.low) * torch.rand(n, generator=generator, dtype=torch.float64)
        if HEIGHT in found:
            found[HEIGHT] = found[HEIGHT].clamp_min(0.0)
        return found


def states(
    specimens: Sequence[Specimen],
    body: Int[Tensor, "n"],
    values: Mapping[str, Float[Tensor, "n"]],
    generator: torch.Generator,
) -> tuple[Impacts | None, Bool[Tensor, "n"]]:
    """Return states before impact that approach the floor, and which of all they are; v_post is not known yet.

    Args:
        specimens: bodies.
        body: number of the body of each drop.
        values: of all quantities of a rig.
        generator: of the poses of bodies whose shape is not known.
    """
    space, n = specimens[0].space, len(body)
    r, q = torch.zeros(n, space.d, dtype=torch.float64), torch.zeros(n, len(space.pose), dtype=torch.float64)
    for k, one in enumerate(specimens):
        own = body == k
        r[own], q[own] = one.placed({name: value[own] for name, value in values.items()}, generator)
    v = torch.stack([values[name] if name in values else _falling(values) for name in _velocities(space)], -1)
    good = contact_velocity(r, v)[:, -1] < -_GRAZING * v[:, : space.d].norm(dim=-1).clamp_min(1e-9)
    if not good.any():
        return None, good
    names = tuple(specimens[k].name for k in body[good].tolist())
    mass, inertia = (
        torch.tensor([getattr(specimen, name) for specimen in specimens], dtype=torch.float64)[body[good]]
        for name in ("mass", "inertia")
    )
    known = {specimen.name: specimen.shape for specimen in specimens if specimen.shape is not None}
    last = max([one.measured.order.max().item() for one in specimens if one.measured is not None], default=0.0)
    impacts = Impacts(
        mass=mass, inertia=inertia, r=r[good], q=q[good], v_pre=v[good], v_post=v[good],
        order=torch.full((len(names),), last + 1, dtype=torch.float64), object=names,
        shape=known or None, source="drops to come",
    )  # fmt: skip
    return impacts, good


def settings_of(impacts: Impacts) -> dict[str, Float[Tensor, "n"]]:
    """Return the values of `NAMES` that measured impacts had, but for the angles of a body in space."""
    space, columns = impacts.space, dict(zip(impacts.space.pose, impacts.q.unbind(-1), strict=True))
    found = {name: columns[name] for name in (("x", "theta") if space is PLANE else ("x", "y"))}
    found |= zip(_velocities(space), impacts.v_pre.unbind(-1), strict=True)
    down = found["v_y" if space is PLANE else "v_z"]
    return found | {HEIGHT: down.square() / (2 * GRAVITY)}


def _velocities(space: Space) -> tuple[str, ...]:
    return STATES[space][2:]


def _falling(values: Mapping[str, Float[Tensor, "n"]]) -> Float[Tensor, "n"]:
    return -(2 * GRAVITY * values[HEIGHT]).sqrt()


def _quaternions(
    tilt: Float[Tensor, "n"], heading: Float[Tensor, "n"], turn: Float[Tensor, "n"]
) -> Float[Tensor, "n 4"]:
    """Quaternions of bodies that are turned about their own z axis, then tilted towards a heading."""
    zero = torch.zeros_like(tilt)
    upright = tilt.new_tensor((1.0, 0.0, 0.0, 0.0)).expand(len(tilt), 4)
    turned = turn_quaternion(upright, torch.stack((zero, zero, turn), -1))
    return turn_quaternion(turned, torch.stack((-heading.sin() * tilt, heading.cos() * tilt, zero), -1))


def _by_chance(name: str, measured: Sequence[Impacts]) -> Limits:
    """Limits of a quantity that the rig does not name: the measured ones, else none of an angle and 0 of all else."""
    if name in ANGLES:
        return Limits(low=-math.pi, high=math.pi, settable=False)
    if not measured:
        return Limits(low=0.0, high=0.0, settable=False)
    every = torch.cat([settings_of(one)[name] for one in measured])
    low, high = every.quantile(torch.tensor((_MARGIN, 1 - _MARGIN), dtype=torch.float64)).tolist()
    return Limits(low=low, high=high, settable=False)


def _rounded(name: str, one: Limits, unit: Float[Tensor, "n"]) -> Float[Tensor, "n"]:
    """Values at shares of the limits in steps of about a hundredth of these; a few levels of what is costly to change.

    Angles are in whole degrees.
    """
    width = one.high - one.low
    if one.cost and one.settable:
        unit = (unit * _LEVELS).floor().clamp_max(_LEVELS - 1) / (_LEVELS - 1)
    value = one.low + width * unit
    if not one.chosen or one.cost:
        return value
    degree = math.pi / 180 if name in ANGLES else 1.0
    step = degree * 10.0 ** math.floor(math.log10(width / degree / 100))
    return ((value / step).round() * step).clamp(one.low, one.high)
