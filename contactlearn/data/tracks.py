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
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.errors import ContactLearnError, DataError, UnknownNameError
from contactlearn.core.numerics import finite_number, whole
from contactlearn.core.workers import one_by_one
from contactlearn.data.audit.rig import with_balance
from contactlearn.data.recordings.conventions import (
    ANGLES,
    ORDERS,
    SENSES,
    Conventions,
    Gravity,
    find_flight_model,
    find_frame,
    find_gravity,
)
from contactlearn.data.recordings.flights import FlightModel, FlightOptions
from contactlearn.data.recordings.floor import Floor, find_floor, off_the_floor
from contactlearn.data.recordings.frame import Clue, Frame
from contactlearn.data.recordings.markers import Centre, MarkerHull, hull_of_markers, markers_of
from contactlearn.data.recordings.poses import Array, conjugate, orientation, rotated
from contactlearn.data.recordings.readers import Layout, read, recording_files
from contactlearn.data.recordings.result import REASONS, Found, Hit
from contactlearn.data.recordings.rocking import rocked
from contactlearn.data.recordings.slides import friction_of
from contactlearn.data.recordings.survey import (
    Progress,
    Searched,
    Survey,
    TrackOptions,
    key,
    sample,
    search_sample,
    survey,
    tracked,
)
from contactlearn.data.recordings.track import Recording
from contactlearn.data.recordings.wobble import centre_of_mass
from contactlearn.mechanics.apparatus import Apparatus, Estimate
from contactlearn.mechanics.bodies import make_shapes
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import matvec, moment, rotation
from contactlearn.mechanics.shapes import Shape, Solid, Sphere, contact_point

_Reading = tuple[str | None, str]  # unit, None for quaternions, and sense
_READABLE = 3  # contacts that show the reading of angles, at least
_COLUMNS = ("time", "position", "angle", "quaternion", "recording", "markers")
_ROUNDING = 1e-9
_CLOSES = 0.1  # residual of a stated reading, above which others are compared with it; right ones leave 0.01 to 0.06
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

    def again(self, names: Collection[str]) -> Iterator[Found]:
        """Search some recordings once more for their tracks and flights, which a survey does not keep.

        Files that cannot be read are left out.
        """
        files = recording_files(self.path)
        alone = [file for file in files if file.stem in names]
        chosen = alone if {file.stem for file in alone} == {*names} else files
        search = partial(tracked, frame=self.survey.frame, model=self.survey.model, options=self.options)
        recordings = (one for file in chosen for one in _named(file, names, self.options.layout))
        return one_by_one(search, (self.searched.get(key(one), one) for one in recordings))


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
    for name in columns or {}:
        if name not in _COLUMNS:
            raise UnknownNameError("entry of data.columns", name, _COLUMNS)
    return TrackOptions(
        conventions=Conventions(
            unit=unit,
            up=up,
            order=order,
            angle=angle,
            sense=sense,
            drag=None if drag is None else finite_number("drag", drag, 0),
        ),
        layout=Layout(**(columns or {}), rate=rate, body=body),
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
    if known is None:
        options, hull = _by_markers(files, options, centre)
        known = hull.shape
        if centre is not None and inertia is None:
            raise DataError("data.inertia must be given with data.centre: a uniform hull has its own centre")
    elif centre is not None:
        raise DataError("data.centre is of a body without data.shape; a shape has its centre of mass at its origin")
    mass = finite_number("mass", mass, 0, above=True)
    gyration = _gyration(known, mass, inertia)
    if isinstance(known, Solid):
        options = replace(options, solid=known, moments=tuple(gyration.tolist()))
    frame, model, searched = _find_angles(sample(files, options.layout), options, known, gyration)
    found = survey(files, frame, model, options, searched=searched, progress=progress)
    _check_contacts(path, found)
    limits = options.thresholds
    floor = find_floor(found.contacts, known, found.rests, lean=model.lean, limits=limits)
    contacts, refusals = off_the_floor(found.contacts, known, floor, limits, longest=options.flight.contact_time)
    found = replace(found, contacts=tuple(contacts), refusals=(*found.refusals, *refusals))
    _check_contacts(path, found)
    if isinstance(known, Solid):
        _check_handedness(path, contacts, known, gyration, limits.reading)
    name = options.layout.body or type(known).__name__.lower()
    apparatus = _apparatus(found, floor, options)
    impacts = _impacts(contacts, known, mass, gyration * mass, name, f"tracks of {path}", apparatus)
    impacts = impacts.replace(apparatus=with_balance(impacts, apparatus, floor.sinking))
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
    moments = [*inertia] if isinstance(inertia, Sequence) and not isinstance(inertia, str) else [inertia] * 3
    if len(moments) != 3:
        raise DataError(f"data.inertia is one number in space, or three along the body's axes, got {inertia!r}")
    values = torch.tensor([finite_number("inertia", one, 0, above=True) for one in moments], dtype=torch.float64)
    if 2 * values.max() > values.sum() * (1 + _ROUNDING):
        raise DataError(
            f"data.inertia: a moment of inertia is at most the sum of the two others, got {values.tolist()}; state "
            "principal moments in kg m²"
        )
    return values / mass


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


def _by_markers(files: Sequence[Path], options: TrackOptions, centre: Centre) -> tuple[TrackOptions, MarkerHull]:
    """The hull of the markers, and options by which recordings have the poses of its centre of mass.

    Angles from markers are in rad and as the file's axes say.
    """
    stated = options.conventions
    places = markers_of(sample(files, options.layout)[0]).tolist()
    conventions = replace(stated, angle=stated.angle or "rad", sense=stated.sense or "as_read")
    options = replace(options, conventions=conventions, layout=replace(options.layout, places=places))
    recordings = sample(files, options.layout)
    frame = find_frame(recordings, find_gravity(recordings, stated.drag), options.conventions, options.thresholds)
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
    setting, named = (
        ("angle", stated.angle) if options.moments is None else ("order", stated.order or recordings[0].order)
    )
    known = [*ORDERS] if setting == "order" else [*ANGLES] if recordings[0].quaternion is None else [named]
    units = [named] if named else known
    gravity = find_gravity(recordings, stated.drag)
    searches: dict[str | None, tuple[Frame, FlightModel, Searched]] = {}

    def imbalances(units: Sequence[str | None], senses: Sequence[str]) -> dict[_Reading, float]:
        for unit in units:
            if unit not in searches:
                conventions = replace(stated, **{setting: unit}, sense="as_read")
                searches[unit] = _searched(recordings, gravity, conventions, options)
        return {
            (unit, sense): _imbalance(searches[unit][2], shape, gyration, SENSES[sense])
            for unit in units
            for sense in senses
        }

    left = imbalances(units, [stated.sense] if stated.sense else [*SENSES])
    best, *others = sorted(left, key=lambda reading: left[reading])
    if left[best] > _CLOSES and (len(units) < len(known) or stated.sense):
        every = imbalances(known, [*SENSES])
        closing = min(every, key=lambda reading: every[reading])
        if every[closing] <= limit * min(left[best], 1.0):
            leaves = f"is {left[best]:.2g} with it" if left[best] < math.inf else "is unknown with it"
            raise DataError(
                f"{source}: the impacts contradict {_settings(setting, named, stated.sense)}: {_evidence(shape)} "
                f"{leaves}, and {every[closing]:.2g} with {_settings(setting, *closing)}"
            )
    if others and not left[best] <= limit * left[others[0]]:
        needed = _settings(setting, "…" if len(units) > 1 else None, None if stated.sense else "…")
        which = "unit" if setting == "angle" else "order"
        raise DataError(
            f"{source}: the {which} and sense of angles are not clear: {_evidence(shape)} is "
            f"{left[best]:.2f} with one reading and {left[others[0]]:.2f} with another; state {needed}"
        )
    clue = Clue(
        convention="angles",
        value=", ".join(name for name in best if name),
        stated=not others,
        quantity=_evidence(shape),
        number=left[best],
        unit="–",
    )
    unit, sense = best
    frame, model, searched = searches[unit]
    if SENSES[sense] != frame.sense:  # flights and the centre of mass are others where bodies turn the other way
        conventions = replace(stated, **{setting: unit}, sense=sense)
        frame, model, searched = _searched(recordings, gravity, conventions, options)
    return replace(frame, clues=(*frame.clues, clue)), model, searched


def _searched(
    recordings: Sequence[Recording], gravity: Gravity, conventions: Conventions, options: TrackOptions
) -> tuple[Frame, FlightModel, Searched]:
    """The frame of recordings in which conventions are as stated, the model of their flights, and what they hold."""
    in_space = options.moments is not None
    frame = find_frame(recordings, gravity, conventions, options.thresholds, in_space=in_space)
    model = find_flight_model(recordings, frame, gravity, options.moments)
    return frame, model, search_sample(recordings, frame, model, options)


def _evidence(shape: Shape) -> str:
    """The quantity that shows the reading of angles."""
    heights = isinstance(shape, Solid) and not isinstance(shape, Sphere)
    return "scatter of the floor over that of the body's height" if heights else "residual of the moment balance"


def _settings(setting: str, unit: str | None, sense: str | None) -> str:
    """The settings of a reading, as they are stated."""
    named = ((setting, unit), ("sense", sense))
    return " and ".join(f"data.{name}={value}" for name, value in named if value)


def _imbalance(searched: Searched, shape: Shape, gyration: Any, sense: int) -> float:
    """Residual of the moment balance in a sense; infinite where contacts are too few."""
    contacts = [contact for found in searched.values() for contact in found.contacts]
    return _moment_imbalance(contacts, shape, gyration, sense) if len(contacts) >= _READABLE else math.inf


def _moment_imbalance(contacts: Sequence[Hit], shape: Shape, gyration_squared: Any, sense: int = 1) -> float:
    """Median residual of the moment balance relative to its terms, in [0, 1], if angles grow in this sense.

    In the plane it is that of the zero of θ at which it is least.
    """
    pose = np.stack([contact.pose for contact in contacts])
    change = np.stack([contact.v_post - contact.v_pre for contact in contacts])
    if isinstance(shape, Solid):
        return _misread(pose, change, shape, gyration_squared, sense)
    r = contact_point(shape, torch.from_numpy(sense * pose[:, 2] + _ZEROS[:, None])).numpy()
    u, v, spun = (change * (1, 1, sense)).T
    terms = np.stack(np.broadcast_arrays(spun, -r[..., 0] * v / gyration_squared, r[..., 1] * u / gyration_squared))
    return float(np.median(np.abs(terms.sum(0)) / np.maximum(np.abs(terms).sum(0), 1e-12), axis=1).min())


def _misread(pose: Array, change: Array, shape: Solid, gyration_squared: Any, sense: int) -> float:
    """Residual of a reading in space; the other sense is that of quaternions from the world's axes to the body's.

    It is the scatter of the floor's heights that contacts show, over that of the heights of the body's lowest points;
    or the residual of the moment balance, of a ball.
    """
    turned, spin = pose[:, 3:], change[:, 3:]
    if sense < 0:
        turned = conjugate(turned)
        spin = -rotated(turned, spin)
    q = torch.from_numpy(turned)
    r = contact_point(shape, q)
    if not isinstance(shape, Sphere):
        own, floor = ((x - x.median()).abs().median().item() for x in (r[:, 2], r[:, 2] + torch.from_numpy(pose[:, 2])))
        return floor / max(own, 1e-12)
    return _unbalanced(q, torch.from_numpy(np.column_stack((change[:, :3], spin))), r, gyration_squared)


def _unbalanced(
    q: Float[Tensor, "n 4"], change: Float[Tensor, "n 6"], r: Float[Tensor, "n 3"], gyration_squared: Any
) -> float:
    """Median residual of the moment balance in space relative to its terms, in [0, 1]."""
    R = rotation(q)
    spun, moved = matvec((R * gyration_squared) @ R.mT, change[:, 3:]), moment(r, change[:, :3])
    return ((spun - moved).norm(dim=-1) / (spun.norm(dim=-1) + moved.norm(dim=-1)).clamp_min(1e-12)).median().item()


def _check_handedness(path: Path, contacts: Sequence[Hit], shape: Solid, gyration_squared: Any, limit: float) -> None:
    """Refuse positions in left-handed axes: the moment balance then closes with one of them mirrored.

    Raises:
        DataError: naming the axis.
    """
    q = torch.from_numpy(np.stack([contact.pose[3:] for contact in contacts]))
    change, r = (
        torch.from_numpy(np.stack([contact.v_post - contact.v_pre for contact in contacts])),
        contact_point(shape, q),
    )
    mirrors = {"": (1.0, 1.0), "x": (-1.0, 1.0), "y": (1.0, -1.0)}
    left = {
        axis: _unbalanced(q, change * change.new_tensor((*signs, *(1.0,) * 4)), r, gyration_squared)
        for axis, signs in mirrors.items()
    }
    best = min(left, key=lambda axis: left[axis])
    if best and len(contacts) >= _READABLE and left[best] <= limit * left[""]:
        raise DataError(
            f"{path}: axes must be right-handed: the moment balance of impacts leaves {left['']:.2g}, and "
            f"{left[best]:.2g} with {best} of the positions mirrored; mirror that column"
        )


def _impacts(
    contacts: Sequence[Hit], shape: Shape, mass: float, inertia: Any, name: str, source: str, apparatus: Apparatus
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
