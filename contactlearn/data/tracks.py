"""Recordings of tracked poses as impacts: `data=tracks data.path=FOLDER`.

Every recording of a file or folder is searched for contacts between two free flights (`contactlearn.data.recordings`).
Units, axes and orders that are not stated are found from the flights; what cannot be found must be stated.  Each
refusal has its reason and number.

Unit and sense of angles follow from the moment balance of the impacts, I Δω = r_x P_n − r_y P_t: it holds in the right
unit and sense alone, of bodies that spin, at some zero of θ.  (Heights of contacts do not show the sense of a body with
an axis of symmetry.)  A stated reading in which it does not hold, though it holds in another one, contradicts the
recordings.
"""

import math
import os
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from html import escape
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.errors import ContactLearnError, DataError, UnknownNameError
from contactlearn.core.numerics import MAD_SCALE, finite_number, whole
from contactlearn.data.audit.rig import with_balance
from contactlearn.data.recordings.conventions import (
    ANGLES,
    SENSES,
    Conventions,
    Gravity,
    find_flight_model,
    find_frame,
    find_gravity,
)
from contactlearn.data.recordings.flights import FlightModel, FlightOptions
from contactlearn.data.recordings.floor import Floor, find_floor, off_the_floor
from contactlearn.data.recordings.frame import Clue, Frame, orders_of
from contactlearn.data.recordings.markers import Centre, MarkerHull, hull_of_markers, markers_of
from contactlearn.data.recordings.poses import Array, conjugate, orientation, product, quaternion, rotated
from contactlearn.data.recordings.readers import Layout, read, recording_files
from contactlearn.data.recordings.result import REASONS, RecordedContact, SearchedTrack
from contactlearn.data.recordings.rocking import rocked
from contactlearn.data.recordings.slides import friction_of
from contactlearn.data.recordings.sufficiency import NEEDED
from contactlearn.data.recordings.survey import (
    Progress,
    Searched,
    Survey,
    TrackOptions,
    key,
    sample,
    search_recording,
    search_sample,
    survey,
)
from contactlearn.data.recordings.track import Recording
from contactlearn.data.recordings.wobble import centre_of_mass
from contactlearn.mechanics.apparatus import Apparatus, Estimate
from contactlearn.mechanics.bodies import make_shapes, principal_moments
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import matvec, moment, rotation
from contactlearn.mechanics.shapes import Disc, Shape, Solid, Sphere, contact_point

_Reading = tuple[str | None, str]  # unit, None for quaternions, and sense
_ORIENTATIONS = ("euler", "matrix")  # other descriptions of an orientation, in place of a quaternion
_COLUMNS = ("time", "position", "angle", "quaternion", "recording", "markers")
_ROUNDING = 1e-9
# residual of a stated reading, above which others are compared with it; right ones leave 0.01 to 0.06
_MAX_RESIDUAL_OF_STATED = 0.1
_LEVELLINGS, _ROUNDS = 3, 12  # turns of the axes towards the floor, and weights of its fit
_MOVING = 0.1  # of the velocity of approach, that of a surface which moves
_MOVING_ROUND = 0.02  # the same of round bodies, whose contact heights no zero of θ and no outline change
_SLOPE_SIGMAS = 5.0  # standard errors of a slope that is allowed for
_MOMENT_SIGMAS = 5.0  # errors of a moment, of which one that is as large has half the weight
_ZEROS = np.radians(np.linspace(-6, 6, 25))  # of θ that are tried
_INSTANT = 1e-6  # s, error of the instants at which flights meet, at least


@dataclass(frozen=True, kw_only=True)
class Tracked:
    """Impacts of recordings, and everything found on the way to them."""

    path: Path
    impacts: Impacts
    survey: Survey
    floor: Floor
    shape: Shape
    options: TrackOptions
    hull: MarkerHull | None = None
    centre: Centre = None
    searched: Searched = field(default_factory=dict)

    def __repr__(self) -> str:
        """Write how many impacts were found, and why contacts and recordings were refused."""
        counts = Counter(REASONS[refusal.reason] for refusal in self.survey.refusals)
        refused = ", ".join(f"{count} {reason}" for reason, count in counts.most_common()) or "none"
        found = f"{len(self.impacts)} impacts in {self.survey.recordings} recordings"
        return f"Tracked({found}; refused: {refused}; source={str(self.path)!r})"

    def _repr_html_(self) -> str:
        """Show how many impacts were found, and the refusals by reason."""
        counts = Counter(REASONS[refusal.reason] for refusal in self.survey.refusals)
        rows = "".join(f"<tr><td>{count}</td><td>{escape(reason)}</td></tr>" for reason, count in counts.most_common())
        refused = f"<table><tr><th>refused</th><th>reason</th></tr>{rows}</table>" if rows else ""
        return f"<p>{escape(repr(self.impacts))}</p>{refused}"

    @property
    def rig(self) -> Apparatus:
        """What the recordings show of the rig without a law of contact."""
        assert self.impacts.apparatus is not None
        return self.impacts.apparatus

    @property
    def r_cov(self) -> Float[Array, "n 2 2"] | None:
        """Covariances of the contact points in m² where the shape is the hull of the markers."""
        return None if self.hull is None else self.hull.contact_covariance(self.survey.contacts)

    def reload(self, names: Collection[str]) -> Iterator[SearchedTrack]:
        """Search some recordings once more for their tracks and flights, which a survey does not keep.

        Files that cannot be read are left out.
        """
        files = recording_files(self.path)
        alone = [file for file in files if file.stem in names]
        chosen = alone if {file.stem for file in alone} == {*names} else files
        search = partial(search_recording, frame=self.survey.frame, model=self.survey.model, options=self.options)
        recordings = (one for file in chosen for one in _named(file, names, self.options.layout))
        return map(search, (self.searched.get(key(one), one) for one in recordings))


def _named(file: Path, names: Collection[str], layout: Layout) -> Iterator[Recording]:
    """Yield the recordings of a file that can be read and have one of some names."""
    with suppress(ContactLearnError):
        for recording in read(file, layout):
            if isinstance(recording, Recording) and recording.name in names:
                yield recording


def load(**settings: Any) -> Impacts:
    """Impacts from a recording, or from all recordings of a folder; the settings are those of `find`."""
    return find(**settings).impacts


def find(
    path: str | os.PathLike[str],
    mass: float,
    shape: Mapping[str, Any] | Shape | None = None,
    inertia: float | Sequence[float] | None = None,
    centre: Centre = None,
    *,
    progress: Progress = iter,
    **settings: Any,
) -> Tracked:
    """Impacts, and everything found on the way to them; see `find_impacts` and `track_options`."""
    options = track_options(**settings)
    return find_impacts(
        path, mass=mass, shape=shape, inertia=inertia, centre=centre, options=options, progress=progress
    )


def track_options(
    *,
    unit: str | float | None = None,
    up: str | None = None,
    order: str | None = None,
    angle: str | None = None,
    sense: str | None = None,
    columns: Mapping[str, Any] | None = None,
    rate: float | None = None,
    body: str | None = None,
    drag: float | None = None,
    fewest: int | None = None,
    contact_time: float = 3e-3,
    workers: int = 1,
) -> TrackOptions:
    """Return the options of a search as a configuration states them.

    `unit`, `up`, `order`, `angle`, `sense` and `drag` are those of `Conventions`, `columns`, `rate` and `body` those of
    `Layout`, `fewest` and `contact_time` those of `FlightOptions`; `workers` search a hundred files and more, or a
    single one.

    Raises:
        DataError: a value out of its range.
        UnknownNameError: a column or convention that does not exist.
    """
    unset = (*_ORIENTATIONS, "position", "quaternion", "markers")
    columns = {name: one for name, one in (columns or {}).items() if one is not None or name not in unset}
    for name in columns:
        if name not in (*_COLUMNS, *_ORIENTATIONS):
            raise UnknownNameError("entry of data.columns", name, (*_COLUMNS, *_ORIENTATIONS))
    for name in _ORIENTATIONS:
        columns |= {"quaternion": columns.pop(name)} if name in columns else {}
    return TrackOptions(
        conventions=Conventions(
            unit=unit,
            up=up,
            order=order,
            angle=angle,
            sense=sense,
            drag=None if drag is None else finite_number("drag", drag, 0),
        ),
        layout=Layout(**columns, rate=rate, body=body),
        flight=FlightOptions(
            fewest=None if fewest is None else whole("fewest", fewest, 5),
            contact_time=finite_number("contact_time", contact_time, 0, 0.1),
        ),
        workers=whole("workers", workers, 1),
    )


def find_impacts(
    path: str | os.PathLike[str],
    *,
    mass: float,
    shape: Mapping[str, Any] | Shape | None = None,
    inertia: float | Sequence[float] | None = None,
    centre: Centre = None,
    options: TrackOptions = TrackOptions(),
    progress: Progress = iter,
) -> Tracked:
    """Find the impacts of recordings with the floor.

    Args:
        path: a file, or a folder with recordings in it and below it.
        mass: of the body in kg.
        shape: of the body, or of several by name, of which `options.layout.body` is one, for
            `contactlearn.mechanics.bodies.make_shapes`; None is the convex hull of its markers.
        inertia: in kg m² about the centre of mass, in space one or three along the body's axes; None is that of uniform
            density.
        centre: of mass, in the hull of the markers: "mean" of them, or their weights; None is that of uniform density.
        options: of the search; conventions that they do not state are found.
        progress: wraps the files as they are read.

    Raises:
        DataError: no contact is found, or a convention is neither stated nor found.
        UnknownNameError: a shape that does not exist.
    """
    path, known, hull = Path(path), _shape_of(options.layout.body, shape), None
    files = recording_files(path)
    options, recordings = _sampled(files, options)
    if known is None:
        options, hull = _by_markers(recordings, options, centre)
        known, recordings = hull.shape, sample(files, options.layout)
        if centre is not None and inertia is None:
            raise DataError("data.inertia must be given with data.centre: a uniform hull has its own centre")
    elif centre is not None:
        raise DataError("data.centre is of a body without data.shape; a shape has its centre of mass at its origin")
    mass = finite_number("mass", mass, 0, above=True)
    gyration = _gyration(known, mass, inertia)
    if isinstance(known, Solid):
        options = replace(options, solid=known, moments=tuple(gyration.tolist()))
    turning = any(np.ptp(one.rotation[one.seen], axis=0).any() for one in recordings if one.seen.any())
    find = _find_angles if turning else _without_angles
    frame, model, searched = find(recordings, options, known, gyration)
    found = survey(files, frame, model, options, searched=searched, progress=progress)
    _check_contacts(path, found)
    limits = options.thresholds
    floor = find_floor(found.contacts, known, found.rests, lean=model.lean, limits=limits)
    _check_still(path, found.contacts, known)
    contacts, refusals = off_the_floor(found.contacts, known, floor, limits, longest=options.flight.contact_time)
    found = replace(found, contacts=tuple(contacts), refusals=(*found.refusals, *refusals))
    _check_contacts(path, found)
    if isinstance(known, Solid):
        _check_handedness(path, contacts, known, gyration, limits.reading)
    name = options.layout.body or type(known).__name__.lower()
    apparatus = _apparatus(found if turning else replace(found, wobbles=()), floor, options)
    impacts = _impacts(contacts, known, mass, gyration * mass, name, f"tracks of {path}", apparatus)
    if turning:
        impacts = impacts.replace(apparatus=with_balance(impacts, apparatus, floor.sinking))
    else:
        impacts = _with_unknown_spin(impacts)
    return Tracked(
        path=path,
        impacts=impacts,
        survey=found,
        floor=floor,
        shape=known,
        options=options,
        hull=hull,
        centre=centre,
        searched=searched,
    )


def _gyration(shape: Shape, mass: float, inertia: float | Sequence[float] | None) -> Any:
    """I/m in m²; in space of the three principal axes."""
    if inertia is None:
        return shape.gyration_squared()
    if not isinstance(shape, Solid):
        return finite_number("inertia", inertia, 0, above=True) / mass
    return principal_moments(inertia) / mass


def _check_contacts(path: Path, found: Survey) -> None:
    if not found.contacts:
        counter = Counter(REASONS[refusal.reason] for refusal in found.refusals)
        counts = ", ".join(f"{reason} ({count})" for reason, count in counter.items()) or "nothing"
        raise DataError(
            f"{path}: no contact between two free flights in {found.recordings} recordings; refused: {counts}"
        )


def _shape_of(body: str | None, spec: Mapping[str, Any] | Shape | None) -> Shape | None:
    """The shape of the recorded body; of several shapes the one of its name."""
    shape = make_shapes(spec)
    if not isinstance(shape, Mapping):
        return shape
    if body is None:
        raise DataError(f"data.body must say which body the recordings are of: data.shape has {', '.join(shape)}")
    if body not in shape:
        raise UnknownNameError("data.body among the bodies of data.shape:", body, shape)
    return shape[body]


def _sampled(files: Sequence[Path], options: TrackOptions) -> tuple[TrackOptions, list[Recording]]:
    """A few recordings, and options by which those of markers have the same axes of the body.

    Angles from markers are in rad and as the file's axes say: markers define the sense.
    """
    recordings = sample(files, options.layout)
    places, stated = recordings[0].markers, options.conventions
    if places is None:
        return options, recordings
    conventions = replace(stated, angle=stated.angle or "rad", sense=stated.sense or "as_read")
    options = replace(options, conventions=conventions, layout=replace(options.layout, places=places.tolist()))
    return options, sample(files, options.layout)


def _by_markers(
    recordings: Sequence[Recording], options: TrackOptions, centre: Centre
) -> tuple[TrackOptions, MarkerHull]:
    """The hull of the markers, and options by which recordings have the poses of its centre of mass."""
    markers_of(recordings[0])
    gravity = find_gravity(recordings, options.conventions.drag)
    frame = find_frame(recordings, gravity, options.conventions, options.thresholds)
    hull = hull_of_markers(recordings, frame, centre)
    return replace(options, layout=replace(options.layout, places=hull.places.tolist())), hull


def _apparatus(found: Survey, floor: Floor, options: TrackOptions) -> Apparatus:
    """Estimates without any impact; states at contact may be off by a part of its duration."""
    (gravity, drag), shown = found.model.measured, len(found.contacts) + floor.rests
    lasting = float(np.median([contact.lasting for contact in found.contacts]))
    return Apparatus(
        gravity=gravity,
        friction=friction_of(found.slides, gravity.value, drag.value),
        drag=drag if math.isfinite(drag.error) else None,
        slope=floor.slope if shown >= options.thresholds.contacts_of_a_slope else None,
        slope_b=floor.slope_b if shown >= options.thresholds.contacts_of_a_slope else None,
        orientation=floor.orientation,
        **floor.outline,
        **_centre(found, floor.orientation),
        delay=Estimate(value=0.0, error=max(lasting / math.sqrt(12), _INSTANT)),
        **(
            rocked(found.rocking, np.array(options.moments), found.model.gravity, floor.outline)
            if found.rocking
            else {}
        ),
    )


def _centre(found: Survey, zero: Estimate | None) -> dict[str, Estimate]:
    """The centre of mass that flights show, in the plane along the axes of the body whose zero of θ is right."""
    centre = centre_of_mass(found.wobbles) or ()
    if zero is not None and len(centre) == 2:
        (a, b), c, s = centre, math.cos(zero.value), math.sin(zero.value)
        centre = (
            Estimate(value=c * a.value + s * b.value, error=math.hypot(c * a.error, s * b.error)),
            Estimate(value=c * b.value - s * a.value, error=math.hypot(c * b.error, s * a.error)),
        )
    return {f"centre_{axis}": one for axis, one in zip("abc", centre, strict=False)}


def _find_angles(
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
                searches[unit] = _searched(recordings, gravity, conventions, options)
        return {
            (unit, sense): _residual(searches[unit][2], shape, gyration, SENSES[sense])
            for unit in units
            for sense in senses
        }

    by_reading = residuals(units, [stated.sense] if stated.sense else [*SENSES])
    best, *others = sorted(by_reading, key=lambda reading: by_reading[reading])
    least = by_reading[best]
    if recordings[0].markers is None and least > _MAX_RESIDUAL_OF_STATED and (len(units) < len(known) or stated.sense):
        every = residuals(known, [*SENSES])
        closing = min(every, key=lambda reading: every[reading])
        if every[closing] <= limit * min(least, 1.0):
            leaves = f"is {least:.2g} with it" if least < math.inf else "is unknown with it"
            raise DataError(
                f"{source}: the impacts contradict {_settings(setting, named, stated.sense)}: {_evidence(shape)} "
                f"{leaves}, and {every[closing]:.2g} with {_settings(setting, *closing)}"
            )
    evidence = _evidence(shape)
    if others and not least <= limit * (second := by_reading[others[0]]):
        if not least <= options.thresholds.likely * second < math.inf:
            raise DataError(_unclear(source, setting, by_reading, best, others[0], shape))
        evidence = f"{evidence} not clearly less than {second:.2g} with {', '.join(filter(None, others[0]))},"
    clue = Clue(
        convention="angles",
        value=", ".join(name for name in best if name),
        stated=not others,
        quantity=evidence,
        number=least,
        unit="–",
    )
    unit, sense = best
    frame, model, searched = searches[unit]
    if SENSES[sense] != frame.sense:  # flights and the centre of mass are others where bodies turn the other way
        conventions = replace(stated, **{setting: unit}, sense=sense)
        frame, model, searched = _searched(recordings, gravity, conventions, options)
    return replace(frame, clues=(*frame.clues, clue)), model, searched


def _without_angles(
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
    frame, model, searched = _searched(
        recordings, find_gravity(recordings, stated.drag), conventions, options, turning=False
    )
    clue = Clue(convention="angles", value="not measured", stated=False, quantity="range of θ", number=0.0, unit="rad")
    return replace(frame, clues=(*frame.clues, clue)), model, searched


def _with_unknown_spin(impacts: Impacts) -> Impacts:
    """Impacts of round bodies whose spin was not measured: 0, with the error of a body that may roll."""
    d = impacts.space.d

    def unknown(v: Tensor, covariance: Tensor | None) -> Tensor:
        assert covariance is not None
        rolling = v[:, :d].square().sum(-1) / impacts.r.square().sum(-1)
        wide = covariance.clone()
        wide[:, d:, :] = wide[:, :, d:] = 0.0
        wide[:, range(d, v.shape[1]), range(d, v.shape[1])] = rolling[:, None].expand(-1, v.shape[1] - d)
        return wide

    return impacts.replace(
        v_pre_cov=unknown(impacts.v_pre, impacts.v_pre_cov), v_post_cov=unknown(impacts.v_post, impacts.v_post_cov)
    )


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
        one, other = (", ".join(name for name in reading if name) for reading in (best, second))
        why = f"{_evidence(shape)} is {residuals[best]:.2f} with {one}, and {residuals[second]:.2f} with {other}"
    which = "unit" if setting == "angle" else "order"
    return f"{source}: the {which} and sense of angles are not clear: {why}; state {', and '.join(open_settings)}"


def _searched(
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


def _residual(searched: Searched, shape: Shape, gyration_squared: Any, sense: int) -> float:
    """Residual of a reading of angles; infinite where contacts are too few.

    It is that of the moment balance, in [0, 1], on the floor that contact points then show: level or inclined.  Of a
    body in space that is no ball, it is multiplied with the scatter of the floor's heights over that of the heights of
    the body's lowest points.
    """
    contacts = [contact for found in searched.values() for contact in found.contacts]
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
    pose, change = _on_a_level_floor(pose, change, shape)
    if k == 3:
        turned = (pose + np.array((0, 0, zero)) for zero in _ZEROS)
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
    """Slopes of the floor under contact points by least absolute deviations; 0 where they are not clear."""
    across, height = points[:, :-1] - np.median(points[:, :-1], 0), points[:, -1]
    design = np.column_stack((np.ones(len(points)), across))
    weight, fit, residual = np.ones(len(points)), np.zeros(design.shape[1]), height
    for _ in range(_ROUNDS):
        fit = np.linalg.lstsq(design * weight[:, None], height * weight, rcond=None)[0]
        residual = height - design @ fit
        middle = max(float(np.median(np.abs(residual))), 1e-9)
        weight = np.maximum(np.abs(residual), middle / 10) ** -0.5
    errors = MAD_SCALE * float(np.median(np.abs(residual))) * np.sqrt(np.linalg.pinv(design.T @ design).diagonal())
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


def _check_still(path: Path, contacts: Sequence[RecordedContact], shape: Shape) -> None:
    """Refuse contacts with something that moves along its normal, such as a racket: their heights change with time.

    From contact to contact of a recording heights change by the slope times the way, and by that velocity times the
    time.

    Raises:
        DataError: with the velocity.
    """
    pose = np.stack([contact.pose for contact in contacts])
    d = 2 if pose.shape[1] == 3 else 3
    point = contact_point(shape, torch.from_numpy(orientation(pose))).numpy() + pose[:, :d]
    whole = np.column_stack((point[:, :-1], [contact.time for contact in contacts], point[:, -1]))
    follows = np.array([one.recording == other.recording for one, other in pairwise(contacts)], bool)
    change = np.diff(whole, axis=0)[follows]
    if len(change) < NEEDED.contacts_of_reading:
        return
    A, b = change[:, :-1], change[:, -1]
    weight, found, scale = np.ones(len(b)), np.zeros(A.shape[1]), 0.0
    for _ in range(_ROUNDS):
        root = np.sqrt(weight)
        found, *_ = np.linalg.lstsq(A * root[:, None], b * root, rcond=None)
        off = np.abs(b - A @ found)
        scale = max(MAD_SCALE * float(np.median(off)), _ROUNDING)
        weight = 1 / (1 + (off / (3 * scale)) ** 2)
    error = scale * np.sqrt(np.linalg.pinv((A * weight[:, None]).T @ A)[-1, -1])
    velocity, fall = float(found[-1]), float(np.median([-contact.v_pre[d - 1] for contact in contacts]))
    least = _MOVING_ROUND if isinstance(shape, Disc | Sphere) else _MOVING
    if abs(velocity) > max(_SLOPE_SIGMAS * error, least * fall):
        raise DataError(
            f"{path}: contacts {'rise' if velocity > 0 else 'sink'} by {abs(velocity):.3g} ± {error:.1g} m/s within "
            "recordings: that surface moves, as a racket does; take its position off that of the body, or "
            "write a table of impacts with its velocities (racket_vx, racket_vy)"
        )


def _check_handedness(
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
    left = {
        axis: _unbalanced(q, change * change.new_tensor((*signs, *(1.0,) * 4)), r, gyration_squared, errors)
        for axis, signs in mirrors.items()
    }
    best = min(left, key=lambda axis: left[axis])
    if best and len(contacts) >= NEEDED.contacts_of_reading and left[best] <= limit * left[""]:
        raise DataError(
            f"{path}: axes must be right-handed: the moment balance of impacts leaves {left['']:.2g}, and "
            f"{left[best]:.2g} with {best} of the positions mirrored; mirror that column"
        )


def _impacts(
    contacts: Sequence[RecordedContact],
    shape: Shape,
    mass: float,
    inertia: Any,
    name: str,
    source: str,
    apparatus: Apparatus,
) -> Impacts:
    """The impacts of contacts with the floor, with the errors of their instants in both covariances."""
    twice = [name for name, count in Counter(contact.name for contact in contacts).items() if count > 1]
    if twice:
        name = twice[0].rpartition("#")[0]
        raise DataError(f"{source}: two recordings are called {name!r}; each needs a name of its own")
    n, k, in_space = len(contacts), len(contacts[0].v_pre), isinstance(shape, Solid)
    covariance = torch.from_numpy(np.stack([contact.covariance for contact in contacts]))
    pose = np.stack([contact.pose for contact in contacts])
    return Impacts(
        mass=torch.full((n,), mass, dtype=torch.float64),
        inertia=torch.as_tensor(inertia, dtype=torch.float64).expand(n, 3)
        if in_space
        else torch.full((n,), inertia, dtype=torch.float64),
        r=contact_point(shape, torch.from_numpy(orientation(pose))),
        q=torch.from_numpy(pose),
        v_pre=torch.from_numpy(np.stack([contact.v_pre for contact in contacts])),
        v_post=torch.from_numpy(np.stack([contact.v_post for contact in contacts])),
        v_pre_cov=covariance[:, :k, :k],
        v_post_cov=covariance[:, k : 2 * k, k : 2 * k],
        time=torch.tensor([contact.time for contact in contacts], dtype=torch.float64) if in_space else None,
        trial=tuple(contact.name for contact in contacts),
        recording=tuple(contact.recording for contact in contacts) if in_space else (),
        object=(name,) * n,
        shape=shape,
        source=source,
        apparatus=apparatus,
    )
