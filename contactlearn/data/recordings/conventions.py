"""Gravity, units, axes and the order of quaternions: stated or found from free flight, never guessed.

    gravity the acceleration that all free flights share: parabolas are fitted to all windows of a few recordings; a
            body in flight, and nothing else that lasts, has the same acceleration in every window
    drag    of the air: the part of this acceleration in proportion to the velocity, a = g − c v
    unit    of length: the size of gravity is 9.81 m/s² in one of them
    up      gravity points the other way
    plane   the horizontal direction in which bodies move, or across which they turn; not of a body that moves in space
    order   of a quaternion: in the right one bodies turn about the normal of the plane
    right   the file's horizontal axis, or the one of its two directions that is nearer to a positive axis

A stated convention that contradicts the recordings is an error, and so is one that is neither stated nor found: the
message names the missing setting.  Axes of the file within 2° of gravity are used as they are; others are turned
upright.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

import numpy as np
from jaxtyping import Float
from numpy.lib.stride_tricks import sliding_window_view

from contactlearn.core.errors import DataError, UnknownNameError
from contactlearn.core.numerics import is_number, measured
from contactlearn.data.packed import opened_bytes
from contactlearn.data.recordings.flights import (
    Air,
    FlightModel,
    fit,
    frame_noise,
    long_flights,
    own_accelerations,
    window_blocks,
    windows,
)
from contactlearn.data.recordings.frame import ORDERS, Clue, Frame, body_axes, orders_of, rotation_axis
from contactlearn.data.recordings.poses import Array
from contactlearn.data.recordings.readers import Layout
from contactlearn.data.recordings.sufficiency import NEEDED
from contactlearn.data.recordings.thresholds import TrackThresholds
from contactlearn.data.recordings.track import Mask, Recording, about_centre, mean_step
from contactlearn.data.recordings.wobble import centre_of_mass, wobble
from contactlearn.mechanics.apparatus import Estimate
from contactlearn.mechanics.rigid_body import GRAVITY

_DURATIONS = (0.06, 0.12, 0.24)  # s of a window; longer ones where noise hides the acceleration in short ones
_SLOWED = (0.48, 0.96, 1.92, 3.84)  # s of a window of a video that is shown in slow motion
_RATES = (48, 50, 60, 90, 100, 120, 125, 150, 200, 240, 250, 300, 400, 480, 500, 600, 960, 1000)  # of cameras, 1/s
_NEAR_RATE = 0.03  # relative distance of such a rate
_NARROWEST, _WIDEST = 7, 61  # frames
_SMOOTH = 2.0  # mean squared residual in units of the noise up to which a window holds one motion
# of a window, by which those before and after it hold one motion too: weak contacts hide in short flights
_EDGE_SHARE = 3
_ACCELERATION_SIGMAS = 8.0  # standard deviations of an acceleration that is not zero
_DISTINCT_SIGMAS = 6.0  # standard errors between rest and flight in a window that can distinguish them
_SAME_ACCELERATION = 0.05  # relative distance of accelerations that are the same
_MAX_CANDIDATES = 300
_BENT_SHARE = 0.6  # of second differences with one sign, from which on flights are seen: noise has half of them
_SHORTEST_FLIGHT = 0.05  # s: 3 mm high, between two bounces; less is noise
_COMMON = 0.5  # length of the mean direction of accelerations, up to which none is common; gravity has 1
_STEADY = 0.5  # of the velocity, by which it changes between hits where nothing falls: a puck slows down
_ROUNDS = 4


@dataclass(frozen=True, eq=False, kw_only=True)
class Gravity:
    """Gravity in a file's axes, and drag.

    Args:
        vector: in units of length per s², [2 or 3].
        covariance: of its errors.
        drag: linear drag c in 1/s: the stated one, or the measured one where it is seen, or 0.
        measured: gravity's size and the drag, fitted together whether the drag is seen or not.  A stated drag is exact;
            the error of one that flights are too few to show is infinite.
    """

    vector: Float[Array, " d"]
    covariance: Float[Array, "d d"]
    drag: float
    measured: tuple[Estimate, Estimate]

    @property
    def size(self) -> float:
        """Its size in units of length per s²."""
        return float(np.linalg.norm(self.vector))

    @property
    def error(self) -> float:
        """Standard error of its size."""
        return self.error_along(self.vector / self.size)

    def error_along(self, direction: Float[Array, " d"]) -> float:
        """Standard error along a unit vector."""
        return float(direction @ self.covariance @ direction) ** 0.5


@dataclass(frozen=True, eq=False, kw_only=True)
class _Motions:
    """Accelerations [S, d] of windows that hold one motion, their standard errors [S], velocities, and flights.

    Windows of one flight overlap, and share its own acceleration; those of different flights are independent.
    """

    acceleration: Float[Array, "s d"]
    error: Float[Array, " s"]
    velocity: Float[Array, "s d"]
    flight: Float[Array, " s"]

    def __getitem__(self, rows: Mask) -> "_Motions":
        return _Motions(**{name: value[rows] for name, value in vars(self).items()})


def find_gravity(recordings: Sequence[Recording], drag: float | None = None) -> Gravity:
    """Find gravity and drag in recordings.

    Args:
        recordings: a few.
        drag: that is stated, in 1/s.

    Raises:
        DataError: no acceleration is common.
    """
    for lasting in _DURATIONS:
        motions = _together([_motions(recording, k, lasting) for k, recording in enumerate(recordings)])
        if (found := _common(motions, drag)) is not None:
            return found
    _refuse_level(recordings)
    step = mean_step(recordings[0].time)
    for lasting in _SLOWED:
        motions = _together([_motions(recording, k, lasting) for k, recording in enumerate(recordings)])
        if (found := _common(motions, drag)) is not None:
            raise DataError(f"{recordings[0].source}: {_slowed(found, step, recordings[0].unit)}")
    why = _few_frames(recordings, step) or (
        f"check that frames are {step:.4g} s apart (time stamps, data.rate), and that the body flies for "
        f"{_needed(step) * step:.2g} s or longer"
    )
    raise DataError(
        f"{recordings[0].source}: no free flight is seen: no acceleration is common to the recordings; {why}"
    )


def _refuse_level(recordings: Sequence[Recording]) -> None:
    """Refuse recordings in which nothing falls: accelerations have no common direction, and change velocities little.

    Raises:
        DataError: what to write instead.
    """
    motions = _together([_motions(recording, k, _DURATIONS[0]) for k, recording in enumerate(recordings)])
    runs = [motions[motions.flight == flight] for flight in np.unique(motions.flight)]
    runs = [run for run in runs if len(run.flight) > _NARROWEST and run.velocity.any()]
    if len(runs) < NEEDED.runs_without_gravity:
        return
    mean = np.stack([run.acceleration.mean(0) for run in runs])
    sizes = np.linalg.norm(mean, axis=1, keepdims=True)
    common = np.linalg.norm((mean / np.maximum(sizes, np.finfo(float).tiny)).mean(0))
    changes = [
        np.linalg.norm(run.velocity[-1] - run.velocity[0]) / np.linalg.norm(run.velocity, axis=1).max() for run in runs
    ]
    if common < _COMMON and np.median(changes) < _STEADY:
        raise DataError(
            f"{recordings[0].source}: nothing falls: between hits bodies move straight on, as on a level table seen "
            "from above, and recordings need gravity in the plane of motion; fit a line to the frames before and after "
            "each hit, and write a table of the velocities, a row a hit (docs/tables.md)"
        )


def _slowed(gravity: Gravity, step: float, unit: str | None) -> str:
    """The frame rate with which the gravity of a video in slow motion would be 9.81 m/s²."""
    rates = {name: (GRAVITY * UNITS[name] / gravity.size) ** 0.5 / step for name in ([unit] if unit else UNITS)}
    usual = {name: min(_RATES, key=lambda one, rate=rate: abs(one / rate - 1)) for name, rate in rates.items()}
    near = [name for name in rates if abs(usual[name] / rates[name] - 1) <= _NEAR_RATE]
    name = near[0] if near else next(iter(rates))
    rate = usual[name] if near else round(rates[name])
    return (
        f"gravity is {measured(gravity.size, gravity.error)} {name}/s² with frames {step:.4g} s apart: at {rate} "
        f"frames a second it would be {gravity.size / UNITS[name] * (rate * step) ** 2:.3g} m/s²; if the video was "
        f"slowed {rate * step:.3g} times, state data.rate={rate} and time: null in data.columns; else the scale of "
        "lengths is wrong (data.unit)"
    )


def _common(motions: _Motions, drag: float | None) -> Gravity | None:
    """Gravity and drag of the windows whose acceleration most others share; None if there are none."""
    sizes = np.linalg.norm(motions.acceleration, axis=1)
    # to choose from; windows that agree are not chosen by size
    sure = np.flatnonzero(sizes > _ACCELERATION_SIGMAS * motions.error)
    if not len(sure):
        return None
    tried = sure[np.unique(np.linspace(0, len(sure) - 1, min(_MAX_CANDIDATES, len(sure))).astype(int))]
    apart = np.linalg.norm(motions.acceleration[tried, None] - motions.acceleration, axis=2)
    agree = apart <= _SAME_ACCELERATION * sizes[tried, None] + 3 * motions.error
    agree &= _DISTINCT_SIGMAS * motions.error < sizes[tried, None]
    explained = agree @ (sizes / motions.error) ** 2  # more of a fall than of bodies that slow alike as they roll
    for best in agree[np.argsort(-explained, kind="stable")]:
        if best.sum() >= NEEDED.windows_of_gravity and (found := _shared(motions, best, drag)) is not None:
            return found
    return None


def _window(step: float, lasting: float = _DURATIONS[0]) -> int:
    """Frames of a window."""
    return int(np.clip(round(lasting / step), _NARROWEST, _WIDEST))


def _needed(step: float) -> int:
    """Frames of a flight that has a window whose neighbours hold one motion too."""
    frames = _window(step)
    return frames + 2 * (frames // _EDGE_SHARE)


def _few_frames(recordings: Sequence[Recording], step: float) -> str:
    """How to film flights that have fewer frames than needed; empty if they have enough, or none are seen."""
    needed, frames = _needed(step), _longest_bent(recordings)
    lasts = frames * step
    if not _SHORTEST_FLIGHT < lasts < needed * step:
        return ""
    rate = 10 * math.ceil(_needed(_DURATIONS[0] / _NARROWEST) / lasts / 10)
    faster = f"film at {rate} frames a second or more, or " if _needed(1 / rate) / rate <= lasts else ""
    return (
        f"flights have about {frames:.0f} frames at {1 / step:.4g} frames a second (time stamps, data.rate), and "
        f"{needed} are needed: {faster}let the body fall from so high that a flight lasts {needed * step:.2g} s"
    )


def _longest_bent(recordings: Sequence[Recording]) -> float:
    """Frames in a row in which the path bends as it mostly does: the most of a recording, in the median; 0 of none.

    Along gravity most second differences of the position have its sign, and those at contact the other.
    """
    bends = [np.diff(one.position[one.seen], 2, axis=0) for one in recordings]
    bends = [bend for bend in bends if len(bend)]
    if not bends:
        return 0.0
    every = np.concatenate(bends)
    usual = np.median(every, axis=0)
    axis = int(np.abs(usual).argmax())
    alike = np.sign(every[:, axis]) == np.sign(usual[axis])
    if usual[axis] == 0 or alike.mean() < _BENT_SHARE:
        return 0.0
    rows = [np.flatnonzero(np.append(np.append(True, bend[:, axis] * usual[axis] <= 0), True)) for bend in bends]
    return float(np.median([np.diff(ends).max() + 1 for ends in rows]))


def _together(parts: Sequence[_Motions]) -> _Motions:
    return _Motions(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in vars(parts[0])})


def _shared(motions: _Motions, agree: Mask, stated: float | None) -> Gravity | None:
    """Gravity and drag of the windows that agree, and of those that then do; None where hardly any does."""
    known, covariance = _fitted(motions[agree])
    for _ in range(_ROUNDS):
        left = np.linalg.norm(motions.acceleration - known[:-1] + known[-1] * motions.velocity, axis=1)
        agree = left <= _SAME_ACCELERATION * np.linalg.norm(known[:-1]) + 3 * motions.error
        agree &= _DISTINCT_SIGMAS * motions.error < np.linalg.norm(known[:-1])
        if agree.sum() < NEEDED.windows_of_gravity:
            return None
        known, covariance = _fitted(motions[agree])
    d = motions.velocity.shape[1]
    # For their scatter to show the error of a drag.
    enough = len(np.unique(motions.flight[agree])) >= NEEDED.flights_of_drag * (d + 1)
    error = float(covariance[-1, -1] ** 0.5) if enough else np.inf
    seen = known[-1] > _DRAG_SIGMAS * error
    drag = stated if stated is not None else float(known[-1]) if seen else 0.0
    fixed, its_covariance = _fitted(motions[agree], drag)
    if stated is not None or not enough:
        known, covariance = np.append(fixed, drag), its_covariance
    if seen and stated is None:
        fixed, its_covariance = known[:d], covariance[:d, :d]
    down = known[:d] / np.linalg.norm(known[:d])
    size = Estimate(value=float(known[:d] @ down), error=float(down @ covariance[:d, :d] @ down) ** 0.5)
    slowing = Estimate(value=float(known[-1]), error=error if stated is None else 0.0)
    return Gravity(vector=fixed, covariance=its_covariance, drag=drag, measured=(size, slowing))


def _fitted(motions: _Motions, drag: float | None = None) -> tuple[Array, Array]:
    """Gravity and drag [d + 1] by least squares, or gravity [d] under a given drag, and their covariance.

    The covariance is that of the scatter of the flights, and no less than the noise of the windows makes.
    """
    count, d = motions.acceleration.shape
    design, y = np.broadcast_to(np.eye(d), (count, d, d)), motions.acceleration
    if drag is None:
        design = np.concatenate((design, -motions.velocity[..., None]), 2)
    else:
        y = y + drag * motions.velocity
    weight = 1 / motions.error**2
    normal = np.einsum("nik,n,nil->kl", design, weight, design)
    known = np.linalg.lstsq(normal, np.einsum("nik,n,ni->k", design, weight, y), rcond=None)[0]
    scores = np.einsum("nik,n,ni->nk", design, weight, y - design @ known)
    flights, flight = np.unique(motions.flight, return_inverse=True)
    summed = np.zeros((len(flights), len(known)))
    np.add.at(summed, flight, scores)
    inverse = np.linalg.pinv(normal, hermitian=True)
    few = len(flights) / max(len(flights) - len(known), 1)
    scattered, noise = few * inverse @ summed.T @ summed @ inverse, inverse
    return known, np.where(scattered.diagonal().sum() >= noise.diagonal().sum(), scattered, noise)


def _motions(recording: Recording, number: int, lasting: float) -> _Motions:
    """Windows of a recording, which last so many s, that hold one motion."""
    time, width = recording.time, recording.position.shape[1]
    frames = _window(float(np.median(np.diff(time))), lasting)
    if len(time) < frames or not recording.seen.any():
        none = np.zeros((0, width))
        return _Motions(acceleration=none, error=none[:, 0], velocity=none, flight=none[:, 0])
    pose = np.column_stack((recording.position, np.zeros((len(time), 3 - width))))
    sigma = np.maximum(frame_noise(time, pose, frames), 1e-9 * np.nanmax(np.abs(pose), initial=1e-9))
    parts: list[_Motions] = []
    for block in window_blocks(len(time), frames):
        part = _moving(time[block], pose[block], frames, sigma, width)
        parts.append(replace(part, flight=number + (part.flight + block.start) / len(time)))
    return _together(parts)


def _moving(time: Array, pose: Array, frames: int, sigma: Array, width: int) -> _Motions:
    """Windows that hold one motion; their flight is its first window."""
    fits = windows(time, pose, frames, Air().smooth(), sigma)
    share = fits.misfit[:, :width].sum(1) / (width * np.maximum(fits.count - 3, 1))
    good = (fits.count >= max(5, 0.7 * frames)) & (share <= _SMOOTH)
    edge = frames // _EDGE_SHARE
    good = sliding_window_view(np.pad(good, edge, mode="edge"), 2 * edge + 1).all(-1)
    velocity = _velocities(time, pose[:, :width], frames)
    good &= np.isfinite(velocity).all(1)
    rows = np.flatnonzero(good)
    return _Motions(
        acceleration=fits.acceleration[good, :width],
        error=np.linalg.norm(fits.error[good, :width], axis=1),
        velocity=velocity[good],
        flight=np.maximum.accumulate(np.where(np.diff(rows, prepend=-2) > 1, rows, 0)).astype(np.float64),
    )


def _velocities(time: Float[Array, " t"], position: Float[Array, "t d"], frames: int) -> Float[Array, "s d"]:
    """Mean velocity of each window, between the middles of its first and last thirds; nan where one was lost."""
    third = frames // 3
    when, where = sliding_window_view(time, frames), np.moveaxis(sliding_window_view(position, frames, axis=0), 1, -1)
    first, last = np.s_[:, :third], np.s_[:, -third:]
    with np.errstate(invalid="ignore", divide="ignore"):
        seen = np.isfinite(where[..., 0])
        sums = [(np.nansum(where[part], 1), seen[part].sum(1), (when * seen)[part].sum(1)) for part in (first, last)]
        (a, n, start), (b, m, end) = sums
        return (b / m[:, None] - a / n[:, None]) / (end / m - start / n)[:, None]


UNITS = {"m": 1.0, "dm": 10.0, "cm": 100.0, "mm": 1000.0, "in": 1 / 0.0254, "ft": 1 / 0.3048}
"""Units of length in a metre."""
ANGLES = {"rad": 1.0, "deg": np.pi / 180}
AXES = ("x", "y", "z", "-x", "-y", "-z")
SENSES = {"as_read": 1, "mirrored": -1}
_CLOCKS = {"milliseconds": 1e3, "microseconds": 1e6, "nanoseconds": 1e9}
_DRAG_SIGMAS = 3.0  # standard errors of a drag that is allowed for; 2 to 5 raise no false alarm
_CENTRE_SIGMAS = 3.0  # standard errors of a centre of mass that is allowed for
_CARRIED = "; where a hand carries the body between its flights, leave these frames out"
_LEAN_SIGMAS = 2.0  # cautious standard errors of a gravity that leans: its error would bias all velocities
_FOLDS = (6, 4, 3, 2)  # sides of a regular polygon, and 2 of an ellipse or a rectangle
_UPRIGHT = np.radians(2)  # angle of gravity from an axis of the file that is taken for up
# spread across the plane over that along it, up to which positions show it; 0.01 to 0.5 decide alike
_MAX_FLATNESS = 0.2
_HALF = 0.5  # of the horizontal spread, up to which an axis of rotation is across the motion all the same


@dataclass(frozen=True, kw_only=True)
class Conventions:
    """Stated conventions of the files; None is to be found.

    Args:
        unit: of length, one of `UNITS`, or its size in m, such as that of a pixel.
        up: the file's axis that points up, one of `AXES`.
        order: of a quaternion's components, or of turns about x, y and z, one of `frame.ORDERS`.
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
        known = {
            "unit": UNITS,
            "up": AXES,
            "order": [*chain.from_iterable(ORDERS.values())],
            "angle": ANGLES,
            "sense": SENSES,
        }
        for name, names in known.items():
            value = getattr(self, name)
            if name == "unit" and is_number(value) and value > 0:
                continue
            if value is not None and value not in names:
                raise UnknownNameError(f"data.{name}", str(value), names)


def find_frame(
    recordings: Sequence[Recording],
    gravity: Gravity,
    stated: Conventions = Conventions(),
    limits: TrackThresholds = TrackThresholds(),
    *,
    in_space: bool = False,
) -> Frame:
    """Find the conventions that are not stated, and check those that are.

    Args:
        recordings: a few.
        gravity: that they show, see `find_gravity`.
        stated: conventions.
        limits: that decide.
        in_space: whether the body moves in space rather than in a plane.

    Raises:
        DataError: a convention contradicts the recordings, or is neither stated nor found.
    """
    first = recordings[0]
    stated = replace(stated, unit=stated.unit or first.unit, order=stated.order or first.order)
    scale, unit = _unit(gravity, stated.unit, recordings, limits)
    up, direction = _up(gravity, stated.up, first.source, limits)
    if in_space:
        frame = _in_space(first, up, scale, stated.order)
        assumed = "impacts of a body that is its own mirror image cannot show it"
        hand = Clue(convention="axes", value="right-handed", stated=None, quantity=assumed, number=math.nan, unit="–")
        clues = (hand,)
    elif first.quaternion is None:
        axes = np.stack((_right(np.array((up[1], -up[0]))), up))
        folds, clues = _folds(recordings, ANGLES[stated.angle or "rad"], limits)
        frame = Frame(scale=scale, axes=axes, folds=folds)
    else:
        frame, clues = _spatial(recordings, up, scale, stated.order, limits)
    said = "frames in a column each, as many as times"
    turned = Clue(
        convention="arrays", value="turned", stated=False, quantity=said, number=len(first.time), unit="frames"
    )
    return replace(
        frame,
        angle=ANGLES[stated.angle or "rad"],
        sense=SENSES[stated.sense or "as_read"],
        clues=(unit, direction, *clues, *_drag(gravity, stated.drag), *[turned] * first.turned),
    )


def find_flight_model(
    recordings: Sequence[Recording], frame: Frame, gravity: Gravity, moments: tuple[float, ...] | None = None
) -> FlightModel:
    """Measure what bodies in flight are subject to, and where their centre of mass is.

    Args:
        recordings: a few.
        frame: of them.
        gravity: that they show.
        moments: principal moments of inertia of a body that moves in space; None of one that moves in a plane.
    """
    d = 3 if frame.in_space else 2
    *across, downward = (frame.axes[:d] @ gravity.vector * frame.scale).tolist()
    leans = any(
        abs(g) > _LEAN_SIGMAS * gravity.error_along(axis) * frame.scale
        for g, axis in zip(across, frame.axes[: d - 1], strict=True)
    )
    (size, drag), still = gravity.measured, (0.0,) * (3 * d - 3)
    model = FlightModel(
        gravity=(*across, downward) if leans else (*(0.0 for _ in across), -math.hypot(*across, downward)),
        gravity_error=gravity.error * frame.scale,
        drag=gravity.drag,
        measured=(size.times(frame.scale), drag),
        prior=(still, still),
        moments=moments,
        centre=(0.0,) * d,
    )
    long = long_flights(map(frame.track, recordings), model.air)
    k, prior = model.air.k, long[0][1].air.prior if long else model.prior
    for _ in range(2):  # own accelerations are known better where the wobble is
        measured = centre_of_mass([wobble(track, flight, prior) for track, flight, _ in long])
        if measured is not None:
            sure = any(abs(one.value) > _CENTRE_SIGMAS * one.error for one in measured)
            model = replace(model, centre=tuple(one.value * sure for one in measured))
        of_centre = ((about_centre(track, model.centre), flight, sigma) for track, flight, sigma in long)
        prior = own_accelerations(
            [fit(one.time, one.pose, of.frames, sigma, of.air) for one, of, sigma in of_centre], k
        )
    steady, (*level, falling), turning = prior[0], prior[1][:d], prior[1][d:]
    falling = math.hypot(falling, GRAVITY * min(model.measured[1].error, 1.0))
    return replace(model, prior=(steady, (*level, falling, *turning)))


def _drag(gravity: Gravity, stated: float | None) -> tuple[Clue, ...]:
    """The evidence for a drag, where there is one."""
    clue = Clue(
        convention="drag",
        value=f"{gravity.drag:.3g} 1/s",
        stated=stated is not None,
        quantity="standard error of the measured one",
        number=gravity.measured[1].error,
        unit="1/s",
    )
    return (clue,) if gravity.drag else ()


def _folds(recordings: Sequence[Recording], unit: float, limits: TrackThresholds) -> tuple[int, tuple[Clue, ...]]:
    """How often angles in such a unit begin again in a turn, and the jumps that show it.

    Those of a fitted ellipse or rectangle are known but for half a turn or a quarter: they stay in that range, and from
    frame to frame change by little, or by nearly the whole of it.
    """
    angles = [unit * one.angle[one.seen] for one in recordings if one.angle is not None]
    extent = max((float(angle.max()) for angle in angles if len(angle)), default=0.0)
    extent -= min((float(angle.min()) for angle in angles if len(angle)), default=0.0)
    steps = np.abs(np.concatenate([np.diff(angle) for angle in angles]))
    for folds in _FOLDS:
        period = 2 * np.pi / folds
        jumps = steps > period * (1 - limits.wrap)
        if extent <= period * (1 + limits.wrap) and (jumps | (steps < limits.wrap * period)).all() and jumps.any():
            clue = Clue(
                convention="period",
                value=f"angles begin again after {360 // folds}°",
                stated=False,
                quantity="jumps of that size, and none half as large",
                number=float(jumps.sum()),
                unit="–",
            )
            return folds, (clue,)
    return 1, ()


def _unit(
    gravity: Gravity, stated: str | float | None, recordings: Sequence[Recording], limits: TrackThresholds
) -> tuple[float, Clue]:
    """Metres in the unit of length."""
    first, source = recordings[0], recordings[0].source
    counts: dict[str | float, float] = {**UNITS}
    if stated is not None and stated not in counts:
        counts[stated] = 1 / float(stated)
    ratios = {name: gravity.size / (GRAVITY * count) for name, count in counts.items()}
    fits = {name: ratio for name, ratio in ratios.items() if abs(ratio - 1) <= limits.scale}
    allowed = 4 * gravity.error / gravity.size
    if stated is not None and abs(ratios[stated] - 1) > max(limits.scale, allowed):
        ratio = ratios[stated]
        other = next(iter(fits), None)
        _refuse_level(recordings)
        _check_clock(gravity, first, limits)
        hint = (
            f"is the unit {other}?"
            if other
            else f"is the frame rate {ratio**-0.5:.4g} times as high, or the scale wrong?"
        )
        raise DataError(
            f"{source}: gravity is {ratio * GRAVITY:.4g} m/s² with data.unit={stated} and these time stamps; {hint} "
            f"(data.unit, data.rate){_CARRIED}"
        )
    if stated is None and len(fits) != 1:
        _refuse_level(recordings)
        _check_clock(gravity, first, limits)
        raise DataError(
            f"{source}: gravity is {measured(gravity.size, gravity.error)} units of length per s², which is 9.81 "
            f"m/s² in none of {', '.join(UNITS)}; state data.unit, and check the frame rate (data.rate){_CARRIED}; "
            f"of pixels state the size of one in m, which these time stamps make data.unit={GRAVITY / gravity.size:.4g}"
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


def _check_clock(gravity: Gravity, first: Recording, limits: TrackThresholds) -> None:
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


def _up(gravity: Gravity, stated: str | None, source: str, limits: TrackThresholds) -> tuple[Array, Clue]:
    """Unit vector up in the file's axes: an axis, or against gravity where no axis is."""
    measured = -gravity.vector / gravity.size
    near = AXES[int(np.abs(measured).argmax())]
    near = near if measured.max() == np.abs(measured).max() else f"-{near}"
    name = stated or near
    k = "xyz".index(name[-1])
    if k >= len(measured):
        raise DataError(f"data.up={name}: the recordings have no such axis")
    axis = np.eye(len(measured))[k] * (-1 if name.startswith("-") else 1)
    leaning = float(np.arccos(np.clip(axis @ measured, -1, 1)))
    if stated is not None and leaning > limits.leaning:
        raise DataError(
            f"{source}: bodies fall {np.degrees(np.pi - leaning):.3g}° off the axis {stated} that data.up calls up; "
            f"is up {near}?"
        )
    upright = leaning <= _UPRIGHT or stated is not None
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


def _in_space(first: Recording, up: Array, scale: float, order: str | None) -> Frame:
    """World axes with z up of a body that moves in space, the file's own if its z is up.

    Raises:
        DataError: no quaternions, or no order of them.
    """
    if first.quaternion is None:
        raise DataError(
            f"{first.source}: data.shape is a body in space, which needs positions x, y, z and quaternions "
            "(data.columns.position, data.columns.quaternion)"
        )
    if order is None:
        raise DataError(
            f"{first.source}: the order of orientations is not seen; state "
            f"{' or '.join(f'data.order={name}' for name in ORDERS[first.quaternion.shape[1]])}"
        )
    level = np.eye(3)[int(np.argmax(np.abs(up) < _HALF))]
    right = (level - (level @ up) * up) / np.linalg.norm(level - (level @ up) * up)
    return Frame(scale=scale, axes=np.stack((right, np.cross(up, right), up)).astype(np.float64), order=order)


_LEFT_HANDED = re.compile(r"left\W?hand|\bunity(?:3d)?\b|\bunreal\b|\bdirectx\b|linkshänd", re.I)
_LOOKED_AT = 1 << 16  # bytes of a file in which words for its axes are looked for


def refuse_left_handed_words(path: Path, layout: Layout) -> None:
    """Refuse a file in space that says that its axes are left-handed, unless a factor says which column is mirrored.

    Impacts of a body which is its own mirror image look the same in a mirror.

    Raises:
        DataError: with the columns that mirror it.
    """
    if any("factor" in entry for _, _, entry in layout.stated_columns.values()):
        return
    with opened_bytes(path) as file:
        word = _LEFT_HANDED.search(f"{path.name} {file.read(_LOOKED_AT).decode(errors='replace')}")
    if word is None:
        return
    place, turned, order = layout.position, layout.quaternion, layout.order or "wxyz"
    mirrored = {
        place[-1],
        *(name for name, axis in zip(turned, order, strict=False) if axis in "xy" and len(turned) == 4),
    }
    position, quaternion = (
        ", ".join(f"{{column: {name}, factor: -1}}" if name in mirrored else name for name in names)
        for names in (place, turned)
    )
    raise DataError(
        f"{path}: says {word[0]!r}, where axes are left-handed; they must be right-handed: state which columns are "
        f"mirrored, 'data.columns={{position: [{position}], quaternion: [{quaternion}]}}', or a factor: 1 of one of "
        "them if they are right-handed"
    )


def _spatial(
    recordings: Sequence[Recording], up: Array, scale: float, order: str | None, limits: TrackThresholds
) -> tuple[Frame, tuple[Clue, ...]]:
    """Axes of the plane of motion and order of the quaternions, of recordings in space."""
    source = recordings[0].source
    scatter = _scatter(recordings, up)
    across, flat = _across(scatter, up)
    orders = orders_of(recordings)
    axes_of = {name: rotation_axis(recordings, name) for name in dict.fromkeys((*orders, *filter(None, [order])))}
    off: dict[str, float] = {}
    for name, (axis, _) in axes_of.items():
        level = axis - (axis @ up) * up
        crosses = flat > _MAX_FLATNESS and level @ scatter @ level > _HALF**2 * scatter.trace()
        against = 0.0 if crosses else abs(axis @ across) if flat <= _MAX_FLATNESS else float(np.linalg.norm(level))
        off[name] = float(np.arccos(np.clip(against, 0, 1)))
    turned = max(total for _, total in axes_of.values())
    fits = [name for name in axes_of if off[name] <= limits.aligned]
    if order is None and orders not in (ORDERS[4], ()):
        fits = fits[:1]  # turns about one axis are the same in several orders
    if order is not None and order not in fits and fits and turned > limits.aligned:
        raise DataError(
            f"{source}: bodies turn {np.degrees(off[order]):.3g}° off the normal of the plane that they move in with "
            f"data.order={order}, and {np.degrees(off[fits[0]]):.2g}° with {fits[0]}"
        )
    if order is None and (len(fits) != 1 or turned <= limits.aligned):
        why = "bodies barely turn in" if turned <= limits.aligned else "both orders fit" if fits else "no order fits"
        raise DataError(
            f"{source}: the order of orientations (which component of a quaternion is w) is not seen: {why} the plane "
            f"of motion; state {' or '.join(f'data.order={name}' for name in axes_of)}"
        )
    chosen = order or fits[0]
    normal = across if flat <= _MAX_FLATNESS else axes_of[chosen][0]
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
