"""Recordings of tracked poses as impacts: `data=tracks data.path=FOLDER`.

Every recording of a file or folder is searched for contacts between two free flights (`contactlearn.data.recordings`).
Units, axes and orders that are not stated are found from the flights; what cannot be found must be stated.  Each
refusal has its reason and number.
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
from contactlearn.data import headers
from contactlearn.data.audit.rig import with_balance
from contactlearn.data.packed import exists
from contactlearn.data.recordings.angles import (
    find_angles,
    reading_residual,
    refuse_left_handed_axes,
    search_reading,
    without_angles,
)
from contactlearn.data.recordings.conventions import (
    Conventions,
    find_flight_model,
    find_frame,
    find_gravity,
    refuse_left_handed_words,
)
from contactlearn.data.recordings.flights import FlightOptions
from contactlearn.data.recordings.floor import Floor, find_floor, off_the_floor
from contactlearn.data.recordings.markers import (
    Centre,
    MarkerHull,
    hull_of_markers,
    markers_of,
    places_on_corners,
    places_turned,
)
from contactlearn.data.recordings.poses import Array, orientation
from contactlearn.data.recordings.readers import Layout, read, recording_files
from contactlearn.data.recordings.result import REASONS, Reason, RecordedContact, SearchedTrack
from contactlearn.data.recordings.rocking import rocked
from contactlearn.data.recordings.slides import friction_of
from contactlearn.data.recordings.survey import (
    Progress,
    Searched,
    Survey,
    TrackOptions,
    key,
    sample,
    search_recording,
    survey,
)
from contactlearn.data.recordings.track import Recording
from contactlearn.data.recordings.wobble import centre_of_mass
from contactlearn.mechanics.apparatus import Apparatus, Estimate
from contactlearn.mechanics.bodies import make_shapes, principal_moments
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.shapes import Disc, Ellipse, Polygon, Shape, Solid, Sphere, contact_point

_ORIENTATIONS = ("euler", "matrix")  # other descriptions of an orientation, in place of a quaternion
_COLUMNS = ("time", "position", "angle", "quaternion", "recording", "markers")
_ROUNDING = 1e-9
_ROUNDS = 12  # weights of a robust fit
_MOVING = 0.1  # of the velocity of approach, that of a surface which moves
_MOVING_ROUND = 0.02  # the same of round bodies, whose contact heights no zero of θ and no outline change
_VELOCITY_SIGMAS = 5.0  # standard errors of the velocity of a surface
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
        return map(search, (self.searched.get(key(recording), recording) for recording in recordings))


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
    """Impacts, and everything found on the way to them; see `find_impacts` and `track_options`.

    Without `columns` the names of the file's columns are understood as `headers.propose` understands them.
    """
    if settings.get("columns") is None and exists(Path(path)):
        named = headers.stated_by_header(Path(path))
        settings |= {name: one for name, one in named.items() if settings.get(name) is None}
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
    single one.  A factor of the angle states its sense.

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
    layout = Layout(**columns, rate=rate, body=body)
    if layout.unit is not None and unit is not None:
        raise DataError(f"data.unit={unit} is stated beside units in data.columns: leave one of them out")
    of_angle = layout.stated_columns.get(layout.angle or "", (None, None, {}))[2]
    if "unit" in of_angle and angle not in (None, "rad"):
        raise DataError(f"data.angle={angle} is stated beside a unit in data.columns.angle: leave one of them out")
    angle = "rad" if {"unit", "towards"} & {*of_angle} else angle
    sense = sense or ("as_read" if {"factor", "towards"} & {*of_angle} else None)
    return TrackOptions(
        conventions=Conventions(
            unit=unit,
            up=up,
            order=order,
            angle=angle,
            sense=sense,
            drag=None if drag is None else finite_number("drag", drag, 0),
        ),
        layout=layout,
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
    elif recordings[0].markers is not None:
        gyration = _gyration(known, finite_number("mass", mass, 0, above=True), inertia)
        options, recordings = _on_shape(files, recordings, options, known, gyration)
    if hull is None and centre is not None:
        raise DataError("data.centre is of a body without data.shape; a shape has its centre of mass at its origin")
    mass = finite_number("mass", mass, 0, above=True)
    gyration = _gyration(known, mass, inertia)
    if isinstance(known, Solid):
        refuse_left_handed_words(files[0], options.layout)
        options = replace(options, solid=known, moments=tuple(gyration.tolist()))
    turning = any(np.ptp(one.rotation[one.seen], axis=0).any() for one in recordings if one.seen.any())
    find = find_angles if turning else without_angles
    frame, model, searched = find(recordings, options, known, gyration)
    surveyed = survey(files, frame, model, options, searched=searched, progress=progress)
    _check_contacts(path, surveyed, searched.values(), options)
    limits = options.thresholds
    floor = find_floor(surveyed.contacts, known, surveyed.rests, lean=model.lean, limits=limits)
    _check_still(path, surveyed.contacts, known)
    contacts, refusals = off_the_floor(surveyed.contacts, known, floor, limits, longest=options.flight.contact_time)
    surveyed = replace(surveyed, contacts=tuple(contacts), refusals=(*surveyed.refusals, *refusals))
    _check_contacts(path, surveyed, searched.values(), options)
    if isinstance(known, Solid):
        refuse_left_handed_axes(path, contacts, known, gyration, limits.reading)
    name = options.layout.body or type(known).__name__.lower()
    apparatus = _apparatus(surveyed if turning else replace(surveyed, wobbles=()), floor, options)
    impacts = _impacts(contacts, known, mass, gyration * mass, name, f"tracks of {path}", apparatus)
    if turning:
        impacts = impacts.replace(apparatus=with_balance(impacts, apparatus, floor.sinking))
    else:
        impacts = _with_unknown_spin(impacts)
    return Tracked(
        path=path,
        impacts=impacts,
        survey=surveyed,
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


def _check_contacts(path: Path, surveyed: Survey, searched: Collection[SearchedTrack], options: TrackOptions) -> None:
    """Refuse recordings without an impact, and say how they begin or end where each has one flight.

    Raises:
        DataError: there is no contact.
    """
    if surveyed.contacts:
        return
    if {refusal.reason for refusal in surveyed.refusals} == {Reason.OUT_OF_PLANE}:
        raise DataError(
            f"{path}: all {len(surveyed.refusals)} recordings leave a plane, in which the stated shape or that of the "
            "markers is: state one in space, such as 'data.shape={kind: cuboid, half: [a, b, c]}' (docs/tables.md)"
        )
    counter = Counter(REASONS[refusal.reason] for refusal in surveyed.refusals)
    counts = ", ".join(f"{reason} {count}" for reason, count in counter.most_common())
    refused = f"; refused parts: {counts}" if counts else ""
    fewest = options.flight.narrowest(surveyed.model.air)
    searched_in = f"{surveyed.recordings} recording{'s' * (surveyed.recordings != 1)}"
    flights = [(one.track, one.flights[0]) for one in searched if len(one.flights) == 1]
    single = bool(flights) and all(len(one.flights) < 2 for one in searched)
    falling = [track.height[flight.last] < track.height[flight.first] for track, flight in flights]
    if single and all(falling):
        why = f"each has one free flight, and ends before the contact or at it; let recordings run on for {fewest}"
    elif single and not any(falling):
        why = f"each has one free flight, and begins at the contact or after it; let recordings begin {fewest}"
    else:
        raise DataError(
            f"{path}: no impact in {searched_in}: none has a contact with a free flight of {fewest} frames or "
            f"more before it and after it{refused}"
        )
    when = "after contact" if all(falling) else "before contact"
    raise DataError(f"{path}: no impact in {searched_in}: {why} frames or more {when}{refused}")


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


def _on_shape(
    files: Sequence[Path], recordings: list[Recording], options: TrackOptions, shape: Shape, gyration: Any
) -> tuple[TrackOptions, list[Recording]]:
    """Options by which poses are those of the shape, and recordings that are read so.

    Its corners carry the markers; or, in the plane, the centre of mass is found from the wobble, and of a body that is
    no disc one zero of θ closes the moment balance, and others do not.
    """
    gravity = find_gravity(recordings, options.conventions.drag)
    in_space = isinstance(shape, Solid)
    frame = find_frame(recordings, gravity, options.conventions, options.thresholds, in_space=in_space)
    places = places_on_corners(recordings, frame, shape)
    if places is None and in_space and not isinstance(shape, Sphere):
        raise DataError(
            f"{recordings[0].source}: the markers are on no corners of the stated shape, which would show where its "
            "middle and its axes are; have the tracker write poses (position and quaternion) of the body in its axes"
        )
    if places is None and isinstance(shape, Polygon | Ellipse | Disc):
        centre = find_flight_model(recordings, frame, gravity).centre
        places = places_turned(recordings, frame, np.eye(2), np.array(centre))  # about the centre of mass
        centred = replace(options, layout=replace(options.layout, places=places.tolist()))
        moved = sample(files, centred.layout)
        if isinstance(shape, Disc):  # any zero of θ will do
            return centred, moved
        frame, _, searched = search_reading(moved, gravity, options.conventions, centred)

        def left(about: float) -> float:
            return reading_residual(searched, shape, gyration, 1, about=about, zeros=(0.0,))

        by_degree = {math.radians(degree): left(math.radians(degree)) for degree in range(360)}
        nearest = min(by_degree, key=lambda about: by_degree[about])
        a = min((nearest + np.radians(np.linspace(-1, 1, 41))).tolist(), key=left)
        turned = np.array(((np.cos(a), np.sin(a)), (-np.sin(a), np.cos(a))))
        clear = by_degree[nearest] <= options.thresholds.reading * np.median([*by_degree.values()]) < math.inf
        places = places_turned(moved, frame, turned, np.zeros(2)) if clear else None
    if places is None:
        return options, recordings
    options = replace(options, layout=replace(options.layout, places=places.tolist()))
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


def _apparatus(surveyed: Survey, floor: Floor, options: TrackOptions) -> Apparatus:
    """Estimates without any impact; states at contact may be off by a part of its duration."""
    (gravity, drag), shown = surveyed.model.measured, len(surveyed.contacts) + floor.rests
    lasting = float(np.median([contact.lasting for contact in surveyed.contacts]))
    return Apparatus(
        gravity=gravity,
        friction=friction_of(surveyed.slides, gravity.value, drag.value),
        drag=drag if math.isfinite(drag.error) else None,
        slope=floor.slope if shown >= options.thresholds.contacts_of_a_slope else None,
        slope_b=floor.slope_b if shown >= options.thresholds.contacts_of_a_slope else None,
        orientation=floor.orientation,
        **floor.outline,
        **_centre(surveyed, floor.orientation),
        delay=Estimate(value=0.0, error=max(lasting / math.sqrt(12), _INSTANT)),
        **(
            rocked(surveyed.rocking, np.array(options.moments), surveyed.model.gravity, floor.outline)
            if surveyed.rocking
            else {}
        ),
    )


def _centre(surveyed: Survey, zero: Estimate | None) -> dict[str, Estimate]:
    """The centre of mass that flights show, in the plane along the axes of the body whose zero of θ is right."""
    centre = centre_of_mass(surveyed.wobbles) or ()
    if zero is not None and len(centre) == 2:
        (a, b), c, s = centre, math.cos(zero.value), math.sin(zero.value)
        centre = (
            Estimate(value=c * a.value + s * b.value, error=math.hypot(c * a.error, s * b.error)),
            Estimate(value=c * b.value - s * a.value, error=math.hypot(c * b.error, s * a.error)),
        )
    return {f"centre_{axis}": one for axis, one in zip("abc", centre, strict=False)}


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
    A, b = change[:, :-1], change[:, -1]
    if len(b) <= 2 * A.shape[1]:  # which a fit through half of them leaves without a residual in the median
        return
    weight, fit, scale = np.ones(len(b)), np.zeros(A.shape[1]), 0.0
    for _ in range(_ROUNDS):
        root = np.sqrt(weight)
        fit, *_ = np.linalg.lstsq(A * root[:, None], b * root, rcond=None)
        distance = np.abs(b - A @ fit)
        scale = max(MAD_SCALE * float(np.median(distance)), _ROUNDING)
        weight = 1 / (1 + (distance / (3 * scale)) ** 2)
    error = scale * np.sqrt(np.linalg.pinv((A * weight[:, None]).T @ A)[-1, -1])
    velocity, fall = float(fit[-1]), float(np.median([-contact.v_pre[d - 1] for contact in contacts]))
    least = _MOVING_ROUND if isinstance(shape, Disc | Sphere) else _MOVING
    if abs(velocity) > max(_VELOCITY_SIGMAS * error, least * fall):
        raise DataError(
            f"{path}: contacts {'rise' if velocity > 0 else 'sink'} by {abs(velocity):.3g} ± {error:.1g} m/s within "
            "recordings: that surface moves, as a racket does; take its position off that of the body, or "
            "write a table of impacts with its velocities (racket_vx, racket_vy)"
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
    unspun = not any(contact.v_pre[2:].any() for contact in contacts)  # a ball, whose bounces turn it unseen
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
        recording=tuple(contact.recording for contact in contacts) if in_space or unspun else (),
        object=(name,) * n,
        shape=shape,
        source=source,
        apparatus=apparatus,
    )
