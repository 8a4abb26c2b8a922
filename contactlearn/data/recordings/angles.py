"""Unit and sense of angles in recordings, or the order of quaternions: stated, or found from the impacts.

They follow from the moment balance of the impacts, I Δω = r_x P_n − r_y P_t: it holds in the right unit and sense
alone, of bodies that spin, at some zero of θ.  (Heights of contacts do not show the sense of a body with an axis of
symmetry.)  A stated reading in which it does not hold, though it holds in another one, contradicts the recordings.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.errors import DataError
from contactlearn.core.numerics import MAD_SCALE, median
from contactlearn.data.recordings.conventions import (
    ANGLES,
    SENSES,
    Conventions,
    Gravity,
    find_flight_model,
    find_frame,
    find_gravity,
)
from contactlearn.data.recordings.flights import FlightModel
from contactlearn.data.recordings.frame import Clue, Frame, orders_of
from contactlearn.data.recordings.poses import Array, conjugate, orientation, product, quaternion, rotated
from contactlearn.data.recordings.result import RecordedContact
from contactlearn.data.recordings.sufficiency import NEEDED
from contactlearn.data.recordings.survey import Searched, TrackOptions, search_sample
from contactlearn.data.recordings.track import Recording
from contactlearn.mechanics.rigid_body import matvec, moment, rotation
from contactlearn.mechanics.shapes import (
    Cuboid,
    Cylinder,
    Disc,
    Ellipsoid,
    Polygon,
    Shape,
    Solid,
    Sphere,
    contact_point,
)

_Reading = tuple[str | None, str]  # unit, None for quaternions, and sense
# residual of a stated reading, above which others are compared with it; right ones leave 0.01 to 0.06
_MAX_RESIDUAL_OF_STATED = 0.1
_DOUBTED_SHAPE = 0.3  # residual of the best reading, from which on the shape is doubted
_LEVELLINGS, _ROUNDS = 3, 12  # turns of the axes towards the floor, and weights of its fit
_SLOPE_SIGMAS = 5.0  # standard errors of a slope that is allowed for
_MOMENT_SIGMAS = 5.0  # errors of a moment, of which one that is as large has half the weight
_ZEROS: Sequence[float] = np.radians(np.linspace(-6, 6, 25)).tolist()  # of θ that are tried


def find_angles(
    recordings: Sequence[Recording], options: TrackOptions, shape: Shape, gyration: Any
) -> tuple[Frame, FlightModel, Searched]:
    """Find the unit and sense of angles that are not stated, and check those that are.

    Returns:
        The frame of the recordings, the model of their flights, and the recordings that were searched with both.

    Raises:
        DataError: a stated reading contradicts the impacts, or one is neither stated nor found.
    """
    stated, limit, source = options.conventions, options.thresholds.reading, recordings[0].source
    gravity = find_gravity(recordings, stated.drag)
    setting, named = (
        ("angle", stated.angle) if options.moments is None else ("order", stated.order or recordings[0].order)
    )
    known = (
        [*orders_of(recordings)] if setting == "order" else [*ANGLES] if recordings[0].quaternion is None else [named]
    )
    units = [named] if named else known
    searches: dict[str | None, tuple[Frame, FlightModel, Searched]] = {}

    def residuals(units: Sequence[str | None], senses: Sequence[str]) -> dict[_Reading, float]:
        for unit in units:
            if unit not in searches:
                conventions = replace(stated, **{setting: unit}, sense="as_read")
                searches[unit] = search_reading(recordings, gravity, conventions, options)
        return {
            (unit, sense): reading_residual(searches[unit][2], shape, gyration, SENSES[sense])
            for unit in units
            for sense in senses
        }

    by_reading = residuals(units, [stated.sense] if stated.sense else [*SENSES])
    best, *others = sorted(by_reading, key=lambda reading: by_reading[reading])
    least = by_reading[best]
    if recordings[0].markers is None and least > _MAX_RESIDUAL_OF_STATED:
        readings = {reading: searches[reading[0]][2] for reading in by_reading}
        _check_edges(recordings, gravity, options, shape, gyration, readings, min(least, 1.0))
    if recordings[0].markers is None and least > _MAX_RESIDUAL_OF_STATED and (len(units) < len(known) or stated.sense):
        every = residuals(known, [*SENSES])
        closing = min(every, key=lambda reading: every[reading])
        if every[closing] <= limit * min(least, 1.0):
            leaves = f"is {least:.2g} with it" if least < math.inf else "is unknown with it"
            raise DataError(
                f"{source}: the impacts contradict {_settings(setting, named, stated.sense)}: {_evidence(shape)} "
                f"{leaves}, and {every[closing]:.2g} with {_settings(setting, *closing)}"
            )
    second = by_reading[others[0]] if others else math.nan
    if others and not least <= limit * second and not least <= options.thresholds.likely * second < math.inf:
        raise DataError(_unclear(source, setting, by_reading, best, others[0], shape))
    sure = "" if least <= limit * second or not others else "not sure: "
    closes = "impacts close their moment balance"
    if others:
        closes += f" better than with {', '.join(filter(None, others[0]))}"
    elif least > _MAX_RESIDUAL_OF_STATED:
        closes = "impacts do not confirm it by their moment balance"
    clue = Clue(
        convention="angles",
        value=", ".join(name for name in best if name),
        stated=not others,
        quantity=f"{sure}{closes}{', by a factor of' * math.isfinite(second)}",
        number=second / max(least, 1e-12) if math.isfinite(second) else math.nan,
        unit="–",
    )
    unit, sense = best
    frame, model, searched = searches[unit]
    if SENSES[sense] != frame.sense:  # flights and the centre of mass are others where bodies turn the other way
        conventions = replace(stated, **{setting: unit}, sense=sense)
        frame, model, searched = search_reading(recordings, gravity, conventions, options)
    return replace(frame, clues=(*frame.clues, clue)), model, searched


_MIN_CONTACTS_OF_EDGES = 2 * NEEDED.contacts_of_reading  # of a box with its edges otherwise


def _check_edges(
    recordings: Sequence[Recording],
    gravity: Gravity,
    options: TrackOptions,
    shape: Shape,
    gyration: Any,
    readings: Mapping[_Reading, Searched],
    least: float,
) -> None:
    """Refuse a shape that the impacts contradict, and not if it lies otherwise in the body's axes.

    Flights do not close with wrong moments of inertia, so that few contacts are found: those show nothing.

    Args:
        recordings: a few.
        gravity: that they show.
        options: of the search.
        shape: as it is stated.
        gyration: I/m in m².
        readings: the recordings, searched in every reading of their orientations.
        least: residual of the best one.

    Raises:
        DataError: naming how it fits.
    """
    fits, counts = dict[str, float](), dict[str, int]()
    if not isinstance(shape, Solid):
        for quarter in (1, 2, 3) if isinstance(shape, Polygon) else (1,):
            about = quarter * math.pi / 2
            fits[f"turned by {90 * quarter}°"] = min(
                reading_residual(searched, shape, gyration, SENSES[sense], about=about)
                for (_, sense), searched in readings.items()
            )
    for said, (other, order) in _along_other_axes(shape).items():
        moments = gyration[[*order]]
        changed = replace(options, solid=other, moments=tuple(moments.tolist()))
        units = dict.fromkeys(unit for unit, _ in readings)
        conventions = [replace(options.conventions, order=unit, sense="as_read") for unit in units]
        again = dict(zip(units, (search_reading(recordings, gravity, c, changed)[2] for c in conventions), strict=True))
        fits[said] = min(reading_residual(again[unit], other, moments, SENSES[sense]) for unit, sense in readings)
        counts[said] = max(sum(len(one.contacts) for one in found.values()) for found in again.values())
    most = max(counts.values(), default=_MIN_CONTACTS_OF_EDGES)
    least_count = max(most / 2, _MIN_CONTACTS_OF_EDGES)  # three lie on a floor by chance
    fits = {said: residual for said, residual in fits.items() if counts.get(said, least_count) >= least_count}
    if fits and fits[best := min(fits, key=lambda said: fits[said])] <= options.thresholds.reading * least:
        raise DataError(
            f"{recordings[0].source}: the impacts contradict data.shape: {_evidence(shape)} is {least:.2g} with it, "
            f"and {fits[best]:.2g} with it {best}; are its edges of other lengths, or along other axes of the body?"
        )


def _along_other_axes(shape: Shape) -> dict[str, tuple[Solid, tuple[int, ...]]]:
    """The body with its lengths along other axes, and the order of its moments, by what would state it."""
    others = dict[Solid, tuple[str, tuple[int, ...]]]()
    for order in permutations(range(3)):
        match shape:
            case Cuboid(half=lengths) | Ellipsoid(semi_axes=lengths):
                name = "half" if isinstance(shape, Cuboid) else "semi_axes"
                lengths = tuple(lengths[k] for k in order)
                other = replace(shape, **{name: lengths})
                said = f"as {name}: [{', '.join(f'{x:g}' for x in lengths)}]"
            case Cylinder():
                other = replace(shape, axis="xyz"[order.index("xyz".index(shape.axis))])
                said = f"as axis: {other.axis}"
            case _:
                return {}
        if other != shape:
            others.setdefault(other, (said, order))
    return {said: (other, order) for other, (said, order) in others.items()}


def without_angles(
    recordings: Sequence[Recording], options: TrackOptions, shape: Shape, gyration: Any
) -> tuple[Frame, FlightModel, Searched]:
    """Frame, flights and contacts of round bodies whose angle is missing, or the same in all frames: it is no angle.

    The tracked point is taken for the centre of mass, of which nothing shows that it is off.

    Raises:
        DataError: the contact point of the body depends on its angle.
    """
    source, stated = recordings[0].source, options.conventions
    if not isinstance(shape, Disc | Sphere):
        raise DataError(
            f"{source}: no orientation was measured: it is missing, or the same in every frame; contact points of a "
            f"{type(shape).__name__.lower()} depend on it; name its columns (data.columns), or state a disc or a ball"
        )
    conventions = replace(stated, angle="rad", order=stated.order or orders_of(recordings)[0], sense="as_read")
    frame, model, searched = search_reading(
        recordings, find_gravity(recordings, stated.drag), conventions, options, turning=False
    )
    clue = Clue(convention="angles", value="not measured", stated=False, quantity="range of θ", number=0.0, unit="rad")
    return replace(frame, clues=(*frame.clues, clue)), model, searched


def _unclear(
    source: str, setting: str, residuals: Mapping[_Reading, float], best: _Reading, second: _Reading, shape: Shape
) -> str:
    """The message that asks for a reading, with the values that it can have."""
    units, senses = ([*dict.fromkeys(values)] for values in zip(*residuals, strict=True))
    open_settings = [
        f"data.{name}={' or '.join(str(value) for value in values)}"
        for name, values in ((setting, units), ("sense", senses))
        if len(values) > 1
    ]
    if math.isinf(residuals[best]):
        why = f"fewer than {NEEDED.contacts_of_reading} contacts between two flights show them"
    else:
        first, next_best = (", ".join(name for name in reading if name) for reading in (best, second))
        why = f"{_evidence(shape)} is {residuals[best]:.2g} with {first}, and {residuals[second]:.2g} with {next_best}"
    which = "unit" if setting == "angle" else "order"
    return f"{source}: the {which} and sense of angles are not clear: {why}; state {', and '.join(open_settings)}"


def search_reading(
    recordings: Sequence[Recording],
    gravity: Gravity,
    conventions: Conventions,
    options: TrackOptions,
    *,
    turning: bool = True,
) -> tuple[Frame, FlightModel, Searched]:
    """The frame of recordings in which conventions are as stated, the model of their flights, and what they hold."""
    in_space = options.moments is not None
    frame = find_frame(recordings, gravity, conventions, options.thresholds, in_space=in_space)
    model = find_flight_model(recordings, frame, gravity, options.moments)
    if not turning:
        model = replace(model, centre=(0.0,) * len(model.centre))
    return frame, model, search_sample(recordings, frame, model, options)


def _evidence(shape: Shape) -> str:
    """The quantity that shows the reading of angles."""
    if isinstance(shape, Solid) and not isinstance(shape, Sphere):
        return "scatter of the floor over that of the body's height, times the residual of the moment balance,"
    return "residual of the moment balance"


def _settings(setting: str, unit: str | None, sense: str | None) -> str:
    """The settings of a reading, as they are stated."""
    named = ((setting, unit), ("sense", sense))
    return " and ".join(f"data.{name}={value}" for name, value in named if value)


def reading_residual(
    searched: Searched,
    shape: Shape,
    gyration_squared: Any,
    sense: int,
    *,
    about: float = 0.0,
    zeros: Sequence[float] = _ZEROS,
) -> float:
    """Residual of a reading of angles, in the plane with zeros of θ about one in rad; infinite of too few contacts.

    It is that of the moment balance, in [0, 1], on the floor that contact points then show: level or inclined.  Of a
    body in space that is no ball, it is multiplied with the scatter of the floor's heights over that of the heights of
    the body's lowest points.
    """
    contacts = [contact for track in searched.values() for contact in track.contacts]
    if len(contacts) < NEEDED.contacts_of_reading:
        return math.inf
    pose = np.stack([contact.pose for contact in contacts])
    change = np.stack([contact.v_post - contact.v_pre for contact in contacts])
    k = change.shape[1]
    errors = np.stack([contact.covariance for contact in contacts])
    errors = errors[:, :k, :k] + errors[:, k : 2 * k, k : 2 * k]
    if sense < 0 and k == 3:
        pose, change = pose * (1, 1, -1), change * (1, 1, -1)
    elif sense < 0:  # quaternions turn the world's axes into the body's
        turned = conjugate(pose[:, 3:])
        pose = np.concatenate((pose[:, :3], turned), 1)
        change = np.concatenate((change[:, :3], -rotated(turned, change[:, 3:])), 1)
    if k == 3:
        pose = pose + np.array((0, 0, about))
    pose, change = _on_a_level_floor(pose, change, shape)
    if k == 3:
        turned = (pose + np.array((0, 0, zero)) for zero in zeros)
        return min(_unbalanced_in_plane(one, change, errors, shape, gyration_squared) for one in turned)
    q = torch.from_numpy(pose[:, 3:])
    r = contact_point(shape, q)
    unbalanced = _unbalanced(q, torch.from_numpy(change), r, gyration_squared, torch.from_numpy(errors))
    if isinstance(shape, Sphere):
        return unbalanced
    body, floor = ((x - x.median()).abs().median().item() for x in (r[:, 2], r[:, 2] + torch.from_numpy(pose[:, 2])))
    return unbalanced * floor / max(body, 1e-12)


def _on_a_level_floor(pose: Array, change: Array, shape: Shape) -> tuple[Array, Array]:
    """Poses and changes of velocity in axes in which the floor that contact points show is level."""
    d = 2 if pose.shape[1] == 3 else 3
    for _ in range(_LEVELLINGS):
        points = pose[:, :d] + contact_point(shape, torch.from_numpy(orientation(pose))).numpy()
        slope = _slope(points)
        if not slope.any():
            break
        angle = np.arctan(np.linalg.norm(slope))
        if d == 2:
            c, s = np.cos(angle), np.sin(angle) * np.sign(slope[0])
            level = np.array(((c, s, 0.0), (-s, c, 0.0), (0.0, 0.0, 1.0)))
            pose, change = pose @ level.T - (0, 0, np.sign(slope[0]) * angle), change @ level.T
        else:
            level = quaternion(np.array((-slope[1], slope[0], 0.0)) * angle / np.linalg.norm(slope))
            pose = np.concatenate((rotated(level, pose[:, :3]), product(level, pose[:, 3:])), 1)
            change = np.concatenate((rotated(level, change[:, :3]), rotated(level, change[:, 3:])), 1)
    return pose, change


def _slope(points: Float[Array, "n d"]) -> Float[Array, " s"]:
    """Slopes of the floor under contact points by least absolute deviations; 0 where they are not clear.

    A floor through half of few points leaves no residual in the median, and is no clear one.
    """
    across, height = points[:, :-1] - np.median(points[:, :-1], 0), points[:, -1]
    design = np.column_stack((np.ones(len(points)), across))
    if len(points) <= 2 * design.shape[1]:
        return np.zeros(points.shape[1] - 1)
    weight, fit, residual = np.ones(len(points)), np.zeros(design.shape[1]), height
    for _ in range(_ROUNDS):
        fit = np.linalg.lstsq(design * weight[:, None], height * weight, rcond=None)[0]
        residual = height - design @ fit
        middle = max(float(median(np.abs(residual))), 1e-9)
        weight = np.maximum(np.abs(residual), middle / 10) ** -0.5
    errors = MAD_SCALE * float(median(np.abs(residual))) * np.sqrt(np.linalg.pinv(design.T @ design).diagonal())
    clear = bool((np.abs(fit[1:]) > _SLOPE_SIGMAS * errors[1:]).any())
    return np.asarray(fit[1:] * clear, dtype=np.float64)


def _unbalanced_in_plane(pose: Array, change: Array, errors: Array, shape: Shape, gyration_squared: Any) -> float:
    """Typical residual of the moment balance relative to its terms, in [0, 1]."""
    r = contact_point(shape, torch.from_numpy(pose[:, 2])).numpy()
    arm = np.column_stack((r[:, 1] / gyration_squared, -r[:, 0] / gyration_squared, np.ones(len(r))))
    terms, noise = arm * change, np.sqrt(np.einsum("ni,nij,nj->n", arm, errors, arm))
    return _typical(np.abs(terms.sum(1)), np.abs(terms).sum(1), noise)


def _unbalanced(
    q: Float[Tensor, "n 4"],
    change: Float[Tensor, "n 6"],
    r: Float[Tensor, "n 3"],
    gyration_squared: Any,
    errors: Float[Tensor, "n 6 6"],
) -> float:
    """Typical residual of the moment balance in space relative to its terms, in [0, 1]."""
    R = rotation(q)
    gyration = (R * gyration_squared) @ R.mT
    spun, moved = matvec(gyration, change[:, 3:]), moment(r, change[:, :3])
    x, y, z = r.unbind(-1)
    zero = torch.zeros_like(x)
    across = torch.stack((zero, -z, y, z, zero, -x, -y, x, zero), -1).reshape(-1, 3, 3)  # r × as a matrix
    slope = torch.cat((-across, gyration), -1)
    noise = (slope @ errors @ slope.mT).diagonal(dim1=-2, dim2=-1).sum(-1).sqrt()
    return _typical(
        (spun - moved).norm(dim=-1).numpy(), (spun.norm(dim=-1) + moved.norm(dim=-1)).numpy(), noise.numpy()
    )


def _typical(residual: Array, size: Array, noise: Array) -> float:
    """Weighted median of residuals relative to the size of their terms.

    A contact at which these are within a few errors of 0 shows no reading: that of a ball that rolls has no moment.
    """
    weight = size**2 / np.maximum(size**2 + (_MOMENT_SIGMAS * noise) ** 2, 1e-300)
    share = residual / np.maximum(size, 1e-12)
    order = np.argsort(share)
    summed = np.cumsum(weight[order])
    return float(share[order][min(int(np.searchsorted(summed, summed[-1] / 2)), len(share) - 1)])


def refuse_left_handed_axes(
    path: Path, contacts: Sequence[RecordedContact], shape: Solid, gyration_squared: Any, limit: float
) -> None:
    """Refuse positions in left-handed axes: the moment balance then closes with one of them mirrored.

    Raises:
        DataError: naming the axis.
    """
    q = torch.from_numpy(np.stack([contact.pose[3:] for contact in contacts]))
    change, r = (
        torch.from_numpy(np.stack([contact.v_post - contact.v_pre for contact in contacts])),
        contact_point(shape, q),
    )
    errors = torch.from_numpy(np.stack([contact.covariance for contact in contacts]))
    errors = errors[:, :6, :6] + errors[:, 6:12, 6:12]
    mirrors = {"": (1.0, 1.0), "x": (-1.0, 1.0), "y": (1.0, -1.0)}
    residual = {
        axis: _unbalanced(q, change * change.new_tensor((*signs, *(1.0,) * 4)), r, gyration_squared, errors)
        for axis, signs in mirrors.items()
    }
    best = min(residual, key=lambda axis: residual[axis])
    if best and len(contacts) >= NEEDED.contacts_of_reading and residual[best] <= limit * residual[""]:
        raise DataError(
            f"{path}: axes must be right-handed: the moment balance of impacts leaves {residual['']:.2g}, and "
            f"{residual[best]:.2g} with {best} of the positions mirrored; mirror that column"
        )
