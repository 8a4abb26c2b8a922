"""Units, axes and the order of quaternions: stated or found from free flight, never guessed.

    unit    of length: the size of gravity is 9.81 m/s² in one of them
    up      gravity points the other way
    drag    of the air: what of the acceleration of free flights is in proportion to their velocity
    plane   the horizontal direction in which bodies move, or across which they turn
    order   of a quaternion: in the right one bodies turn about the normal of the plane
    right   the file's horizontal axis, or the one of its two directions that is nearer to a positive axis

A stated convention that contradicts the recordings is an error, and so is one that is neither stated nor found: the
message asks for the setting.  Of the file's axes those within 2° of gravity are kept; others are turned upright.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from contactlearn.core.errors import DataError, UnknownNameError
from contactlearn.core.numerics import is_number
from contactlearn.data.recordings.frame import Clue, Frame
from contactlearn.data.recordings.gravity import Gravity, find_gravity
from contactlearn.data.recordings.rotations import body_axes, rotation_axis
from contactlearn.data.recordings.thresholds import FrameThresholds
from contactlearn.data.recordings.track import Array, Recording, mean_step
from contactlearn.mechanics.rigid_body import GRAVITY

UNITS = {"m": 1.0, "dm": 10.0, "cm": 100.0, "mm": 1000.0, "in": 1 / 0.0254, "ft": 1 / 0.3048}
"""Units of length in a metre."""
ORDERS = ("wxyz", "xyzw")
ANGLES = {"rad": 1.0, "deg": np.pi / 180}
AXES = ("x", "y", "z", "-x", "-y", "-z")
SENSES = {"as_read": 1, "mirrored": -1}
_CLOCKS = {"milliseconds": 1e3, "microseconds": 1e6, "nanoseconds": 1e9}
_HALF = 0.5  # of the horizontal spread, up to which an axis of rotation is across the motion all the same


@dataclass(frozen=True, kw_only=True)
class Conventions:
    """What is stated of the files; None is to be found.

    Args:
        unit: of length, one of `UNITS`, or its size in m, such as that of a pixel.
        up: the file's axis that points up, one of `AXES`.
        order: of a quaternion's components, one of `ORDERS`.
        angle: unit of an angle in the plane, one of `ANGLES`.
        sense: `as_read` if rotations belong to the file's axes, `mirrored` if they turn the other way.
        drag: linear drag of the air in 1/s.
    """

    unit: str | float | None = None
    up: str | None = None
    order: str | None = None
    angle: str | None = None
    sense: str | None = None
    drag: float | None = None

    def __post_init__(self) -> None:
        known = {"unit": UNITS, "up": AXES, "order": ORDERS, "angle": ANGLES, "sense": SENSES}
        for name, names in known.items():
            value = getattr(self, name)
            if name == "unit" and is_number(value) and value > 0:
                continue
            if value is not None and value not in names:
                raise UnknownNameError(f"data.{name}", str(value), names)


def find_frame(
    recordings: Sequence[Recording],
    stated: Conventions = Conventions(),
    limits: FrameThresholds = FrameThresholds(),
) -> Frame:
    """Find the conventions that are not stated, and check those that are.

    Raises:
        DataError: a convention contradicts the recordings, or is neither stated nor found.
    """
    gravity, first = find_gravity(recordings, stated.drag, limits.drag_sigmas), recordings[0]
    stated = replace(stated, unit=stated.unit or first.unit, order=stated.order or first.order)
    scale, unit = _unit(gravity, stated.unit, first, limits)
    up, direction = _up(gravity, stated.up, first.source, limits)
    if first.quaternion is None:
        axes = np.stack((_right(np.array((up[1], -up[0]))), up))
        frame, clues = Frame(scale=scale, axes=axes), ()
    else:
        frame, clues = _spatial(recordings, up, scale, stated.order, limits)
    angle = ANGLES[stated.angle or "rad"]
    return replace(
        frame,
        angle=angle,
        sense=SENSES[stated.sense or "as_read"],
        gravity=_in_plane(gravity, frame, limits.lean_sigmas),
        gravity_error=gravity.error * scale,
        drag=gravity.drag,
        drag_error=gravity.drag_error if stated.drag is None else 0.0,
        clues=(unit, direction, *clues, *_drag(gravity, stated.drag)),
    )


def _in_plane(gravity: Gravity, frame: Frame, sigmas: float) -> tuple[float, float]:
    """Gravity in m/s², straight down unless it is seen to lean: its error would be one of all velocities alike."""
    right, up = frame.axes[:2] @ gravity.vector * frame.scale
    leans = abs(right) > sigmas * gravity.error_along(frame.axes[0]) * frame.scale
    return (float(right), float(up)) if leans else (0.0, -float(np.hypot(right, up)))


def _drag(gravity: Gravity, stated: float | None) -> tuple[Clue, ...]:
    """The evidence for a drag, where there is one."""
    clue = Clue(
        convention="drag",
        value=f"{gravity.drag:.3g} 1/s",
        stated=stated is not None,
        quantity="standard error of the measured one",
        number=gravity.drag_error,
        unit="1/s",
    )
    return (clue,) if gravity.drag else ()


def _unit(
    gravity: Gravity, stated: str | float | None, first: Recording, limits: FrameThresholds
) -> tuple[float, Clue]:
    """Metres in the unit of length."""
    source = first.source
    counts: dict[str | float, float] = {**UNITS}
    if stated is not None and stated not in counts:
        counts[stated] = 1 / float(stated)
    ratios = {name: gravity.size / (GRAVITY * count) for name, count in counts.items()}
    fits = {name: ratio for name, ratio in ratios.items() if abs(ratio - 1) <= limits.scale}
    allowed = 4 * gravity.error / gravity.size
    if stated is not None and abs(ratios[stated] - 1) > max(limits.scale, allowed):
        ratio = ratios[stated]
        other = next(iter(fits), None)
        _check_clock(gravity, first, limits)
        hint = (
            f"is the unit {other}?"
            if other
            else f"is the frame rate {ratio**-0.5:.4g} times as high, or the scale wrong?"
        )
        raise DataError(
            f"{source}: gravity is {ratio * GRAVITY:.4g} m/s² with data.unit={stated} and these time stamps; {hint} "
            "(data.unit, data.rate)"
        )
    if stated is None and len(fits) != 1:
        _check_clock(gravity, first, limits)
        raise DataError(
            f"{source}: gravity is {gravity.size:.4g} ± {gravity.error:.2g} units of length per s², which is "
            f"9.81 m/s² in none of {', '.join(UNITS)}; state data.unit, and check the frame rate (data.rate); of "
            f"pixels state the size of one in m, which these time stamps make data.unit={GRAVITY / gravity.size:.4g}"
        )
    name = stated or next(iter(fits))
    number = ratios[name] * GRAVITY
    clue = Clue(
        convention="unit",
        value=str(name) if name in UNITS else f"{name} m",
        stated=stated is not None,
        quantity="gravity",
        number=number,
        unit="m/s²",
    )
    return 1 / counts[name], clue


def _check_clock(gravity: Gravity, first: Recording, limits: FrameThresholds) -> None:
    """Raise where gravity is 9.81 m/s² in a unit of length if time stamps are in thousandths of a second or less."""
    for clock, factor in _CLOCKS.items():
        size = gravity.size * factor**2
        unit = next((name for name, count in UNITS.items() if abs(size / (GRAVITY * count) - 1) <= limits.scale), None)
        if unit is not None:
            raise DataError(
                f"{first.source}: time stamps look like {clock}, with which gravity is "
                f"{size / UNITS[unit]:.4g} m/s² in {unit}; leave them out (time: null in data.columns), and state "
                f"data.rate={factor / mean_step(first.time):.4g}"
            )


def _axis(name: str, dimensions: int) -> Array:
    k = "xyz".index(name[-1])
    if k >= dimensions:
        raise DataError(f"data.up={name}: the recordings have no such axis")
    return np.eye(dimensions)[k] * (-1 if name.startswith("-") else 1)


def _up(gravity: Gravity, stated: str | None, source: str, limits: FrameThresholds) -> tuple[Array, Clue]:
    """Unit vector up in the file's axes: an axis, or against gravity where no axis is."""
    measured = -gravity.vector / gravity.size
    near = AXES[int(np.abs(measured).argmax())]
    near = near if measured.max() == np.abs(measured).max() else f"-{near}"
    name = stated or near
    axis = _axis(name, len(measured))
    leaning = float(np.arccos(np.clip(axis @ measured, -1, 1)))
    if stated is not None and leaning > limits.leaning:
        raise DataError(
            f"{source}: bodies fall {np.degrees(np.pi - leaning):.3g}° off the axis {stated} that data.up calls up; "
            f"is up {near}?"
        )
    upright = leaning <= limits.upright or stated is not None
    value = name if upright else f"{np.degrees(leaning):.1f}° off {name}"
    clue = Clue(
        convention="up",
        value=value,
        stated=stated is not None,
        quantity="angle of gravity to the axis",
        number=float(np.degrees(leaning)),
        unit="°",
    )
    return (axis if upright else measured), clue


def _right(direction: Array) -> Array:
    """A direction or its opposite, whichever is nearer to a positive axis."""
    return direction * np.sign(direction[int(np.abs(direction).argmax())])


def _spatial(
    recordings: Sequence[Recording], up: Array, scale: float, order: str | None, limits: FrameThresholds
) -> tuple[Frame, tuple[Clue, ...]]:
    """Axes of the plane of motion and order of the quaternions, of recordings in space."""
    source = recordings[0].source
    scatter = _scatter(recordings, up)
    across, flat = _across(scatter, up)
    axes_of = {name: rotation_axis(recordings, name) for name in ORDERS}
    off: dict[str, float] = {}
    for name, (axis, _) in axes_of.items():
        level = axis - (axis @ up) * up
        crosses = flat > limits.flat and level @ scatter @ level > _HALF**2 * scatter.trace()
        against = 0.0 if crosses else abs(axis @ across) if flat <= limits.flat else float(np.linalg.norm(level))
        off[name] = float(np.arccos(np.clip(against, 0, 1)))
    turned = max(total for _, total in axes_of.values())
    fits = [name for name in ORDERS if off[name] <= limits.aligned]
    if order is not None and order not in fits and fits and turned > limits.aligned:
        raise DataError(
            f"{source}: bodies turn {np.degrees(off[order]):.3g}° off the normal of the plane that they move in with "
            f"data.order={order}, and {np.degrees(off[fits[0]]):.2g}° with {fits[0]}"
        )
    if order is None and (len(fits) != 1 or turned <= limits.aligned):
        why = (
            "bodies hardly turn in" if turned <= limits.aligned else "both orders fit" if fits else "neither order fits"
        )
        raise DataError(
            f"{source}: which component of the quaternions is w is not seen: {why} the plane of motion; "
            "state data.order=wxyz or data.order=xyzw"
        )
    chosen = order or fits[0]
    normal = across if flat <= limits.flat else axes_of[chosen][0]
    normal = normal - (normal @ up) * up
    normal /= np.linalg.norm(normal)
    right = _right(np.cross(up, normal))
    axes = np.stack((right, up, np.cross(right, up)))
    body = body_axes(recordings, chosen, axes[2])
    clues = (
        Clue(convention="plane", value="found", stated=False, quantity="spread across it", number=flat, unit="–"),
        Clue(
            convention="order",
            value=chosen,
            stated=order is not None,
            quantity="angle of rotation axis to normal",
            number=float(np.degrees(off[chosen])),
            unit="°",
        ),
    )
    return Frame(scale=scale, axes=axes, order=chosen, body=body), clues


def _scatter(recordings: Sequence[Recording], up: Array) -> Float[Array, "3 3"]:
    """Sum of squares and products of horizontal positions about the mean of each recording."""
    scatter = np.zeros((3, 3))
    for recording in recordings:
        position = recording.position[recording.seen]
        if len(position) > 1:
            away = position - position.mean(0)
            away = away - np.outer(away @ up, up)
            scatter += away.T @ away
    return scatter


def _across(scatter: Float[Array, "3 3"], up: Array) -> tuple[Array, float]:
    """Horizontal direction in which positions spread least, and its spread over that of the other."""
    values, vectors = np.linalg.eigh(scatter)  # the least is that of up itself
    order = [k for k in np.argsort(values) if abs(vectors[:, k] @ up) < 0.7]
    least, most = values[order[0]], values[order[-1]]
    return vectors[:, order[0]], float(np.sqrt(max(least, 0.0) / max(most, 1e-300)))
