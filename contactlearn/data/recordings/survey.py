"""From files of recordings to contacts, one recording after the other.

A file that cannot be read is refused with its message, and the others go on.  No more than a few recordings are in
memory at a time; contacts, refusals and rests are kept.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import torch

from contactlearn.core.errors import ContactLearnError, DataError
from contactlearn.core.workers import WorkerPool
from contactlearn.data.recordings.contacts import find_contacts, refuse
from contactlearn.data.recordings.conventions import Conventions
from contactlearn.data.recordings.flights import FlightModel, FlightOptions
from contactlearn.data.recordings.floor import find_rests
from contactlearn.data.recordings.frame import Frame
from contactlearn.data.recordings.readers import Layout, read
from contactlearn.data.recordings.result import Reason, RecordedContact, Refusal, Rest, SearchedTrack, SlideToRest
from contactlearn.data.recordings.rocking import Rocking, rocking
from contactlearn.data.recordings.slides import find_slides
from contactlearn.data.recordings.thresholds import TrackThresholds
from contactlearn.data.recordings.track import Recording, Track
from contactlearn.data.recordings.wobble import Wobble, wobble
from contactlearn.mechanics.shapes import Solid, contact_point

_SAMPLE = 24  # recordings from which conventions are found
_MANY = 100  # files from which on they are shared among processes
_CHUNK = 16  # recordings of a file that are searched at once
_AHEAD = 4  # files, or pieces of a single one, that wait for each process

_Piece = list[Recording | SearchedTrack | Refusal]
Searched = Mapping[tuple[str, str], SearchedTrack]
"""Recordings that were searched, by source and name."""
Progress = Callable[[Iterable[Any]], Iterable[Any]]
"""Wraps files as they are read or, for a single file, pieces of at most 16 recordings."""


@dataclass(frozen=True, kw_only=True)
class TrackOptions:
    """Options of the step from files to contacts.

    Args:
        conventions: that are stated.
        layout: of the files.
        flight: of the search for flights and contacts.
        thresholds: that decide.
        solid: a body that moves in space; None of one that moves in a plane.
        moments: its principal moments of inertia, in any unit.
        workers: processes, for many files or a single one.
    """

    conventions: Conventions = Conventions()
    layout: Layout = Layout()
    flight: FlightOptions = FlightOptions()
    thresholds: TrackThresholds = TrackThresholds()
    solid: Solid | None = None
    moments: tuple[float, ...] | None = None
    workers: int = 1


@dataclass(frozen=True, eq=False, kw_only=True)
class Survey:
    """Contacts, refusals, rests and slides in files of recordings.

    Args:
        frame: conventions of all recordings, with the evidence.
        model: of their flights.
        recordings: how many were read.
        contacts: accepted ones, in the order of the files and of time.
        refusals: of recordings and their parts.
        rests: where a body is still, in the order of the files.
        slides: where a body slides until it stops.
        wobbles: of all flights.
        rocking: on edges, of the recordings in which a body rocks.
    """

    frame: Frame
    model: FlightModel
    recordings: int
    contacts: tuple[RecordedContact, ...]
    refusals: tuple[Refusal, ...]
    rests: tuple[Rest, ...]
    slides: tuple[SlideToRest, ...]
    wobbles: tuple[Wobble, ...]
    rocking: tuple[Rocking, ...]

    @classmethod
    def of(cls, frame: Frame, model: FlightModel, parts: Iterable["Survey"]) -> "Survey":
        """Return the survey of several parts, in their order."""
        parts = [*parts]
        return cls(
            frame=frame,
            model=model,
            recordings=sum(part.recordings for part in parts),
            contacts=tuple(contact for part in parts for contact in part.contacts),
            refusals=tuple(refusal for part in parts for refusal in part.refusals),
            rests=tuple(rest for part in parts for rest in part.rests),
            slides=tuple(slide for part in parts for slide in part.slides),
            wobbles=tuple(wobble for part in parts for wobble in part.wobbles),
            rocking=tuple(one for part in parts for one in part.rocking),
        )


def survey(
    files: Sequence[Path],
    frame: Frame,
    model: FlightModel,
    options: TrackOptions = TrackOptions(),
    *,
    searched: Searched,
    progress: Progress = iter,
) -> Survey:
    """Find the contacts in recordings.

    Args:
        files: of the recordings.
        frame: conventions of all of them.
        model: of their flights.
        options: of the search.
        searched: recordings that need no second search.
        progress: wraps the files as they are read, or the pieces of a single one.
    """
    layout, workers = options.layout, options.workers
    search = partial(_search, frame=frame, model=model, options=options)
    if len(files) == 1:
        pieces = progress(_pieces(files[0], layout, searched))
        parts = map(search, pieces) if workers == 1 else _shared(search, pieces, workers)
    elif workers == 1 or len(files) < _MANY:
        parts = map(search, (piece for file in progress(files) for piece in _pieces(file, layout, searched)))
    else:
        search = partial(_search_file, frame=frame, model=model, options=options)
        parts = _shared(search, progress(files), workers)
    return Survey.of(frame, model, parts)


def search_sample(recordings: Sequence[Recording], frame: Frame, model: FlightModel, options: TrackOptions) -> Searched:
    """Search a few recordings."""
    founds = map(partial(search_recording, frame=frame, model=model, options=options), recordings)
    return {key(recording): found for recording, found in zip(recordings, founds, strict=True)}


def sample(files: Sequence[Path], layout: Layout) -> list[Recording]:
    """Read a few recordings, evenly spread over the files.

    Raises:
        DataError: none can be read; the first error is the message.
    """
    chosen = [files[k] for k in np.unique(np.linspace(0, len(files) - 1, min(_SAMPLE, len(files))).astype(int))]
    found: list[Recording] = []
    first: ContactLearnError | None = None
    for file in chosen:
        try:
            for recording in islice(read(file, layout), max(1, _SAMPLE // len(chosen))):
                if isinstance(recording, Recording):
                    found.append(recording)
                else:
                    first = first or recording
        except ContactLearnError as error:
            first = first or error
    kinds = {recording.quaternion is None for recording in found}
    if len(kinds) > 1:
        raise DataError(
            f"{files[0].parent}: some recordings are in a plane and some in space; keep them in two folders"
        )
    if not found and first is not None:
        raise first
    return found


def search_recording(
    recording: Recording | SearchedTrack, frame: Frame, model: FlightModel, options: TrackOptions
) -> SearchedTrack:
    """Find the contacts of one recording, unless it was searched; one that leaves the plane of motion is refused."""
    if isinstance(recording, SearchedTrack):
        return recording
    if (recording.quaternion is None) != (frame.axes.shape[1] == 2):
        raise DataError(f"{recording.source}: is in a plane where others are in space, or the other way round")
    track = frame.track(recording)
    if options.solid is not None:
        low = contact_point(options.solid, torch.from_numpy(track.pose[:, 3:]))[:, 2].numpy() + track.height
        track = replace(track, low=low)
    leaves = _out_of_plane(track, options.thresholds)
    if leaves is not None:
        return SearchedTrack(track=track, sigma=np.zeros(3), flights=(), contacts=(), refusals=(leaves,))
    searched = find_contacts(track, model, options.flight, options.thresholds)
    lies = [refusal.time for refusal in searched.refusals if refusal.reason in (Reason.REST, Reason.SLIDING)]
    point = replace(searched.track, pose=track.pose)  # flights are of the centre of mass, all else of the tracked point
    return replace(
        searched,
        rests=find_rests(point, lies, searched.sigma),
        slides=find_slides(searched.track, lies, searched.sigma),
        wobbles=tuple(wobble(point, flight, model.prior) for flight in searched.flights),
        rocking=rocking(point, options.solid),
    )


def key(recording: Recording) -> tuple[str, str]:
    """Return source and name of a recording, by which it is known."""
    return recording.source, recording.name


def _out_of_plane(track: Track, limits: TrackThresholds) -> Refusal | None:
    for values, limit, quantity, unit, factor in (
        (track.out_of_plane, limits.plane_distance, "distance from the plane of motion", "mm", 1e3),
        (track.tilted, limits.plane_tilt, "tilt out of the plane of motion", "°", 180 / np.pi),
    ):
        value = 0.0
        if values is not None and track.seen.any():
            value = float(np.quantile(np.abs(values[track.seen]), 0.95))
        if value > limit:
            return refuse(track, 0, len(track) - 1, Reason.OUT_OF_PLANE, quantity, value * factor, unit)
    return None


Item = TypeVar("Item")


def _shared(work: Callable[[Item], Survey], items: Iterable[Item], workers: int) -> Iterator[Survey]:
    """Surveys of items by several processes, in order; few items are read ahead."""
    waiting = deque[Future[Survey]]()
    with WorkerPool(workers) as pool:
        for item in items:
            waiting.append(pool.submit(work, item))
            if len(waiting) > _AHEAD * workers:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


def _pieces(file: Path, layout: Layout, searched: Searched) -> Iterator[_Piece]:
    """A few recordings of a file at a time; one that cannot be read, or the rest of the file, is a refusal."""
    piece, read_before = _Piece(), 0
    try:
        for recording in read(file, layout):
            if isinstance(recording, Recording):
                piece.append(searched.get(key(recording), recording))
                read_before += 1
            else:
                piece.append(_not_read(file, read_before, recording))
            if len(piece) == _CHUNK:
                yield piece
                piece = []
    except ContactLearnError as error:
        piece.append(_not_read(file, read_before, error))
    yield piece


def _search_file(file: Path, frame: Frame, model: FlightModel, options: TrackOptions) -> Survey:
    pieces = _pieces(file, options.layout, {})
    return Survey.of(frame, model, (_search(piece, frame, model, options) for piece in pieces))


def _search(piece: _Piece, frame: Frame, model: FlightModel, options: TrackOptions) -> Survey:
    searched, refusals = list[SearchedTrack](), list[Refusal]()
    for recording in piece:
        if isinstance(recording, Refusal):
            refusals.append(recording)
            continue
        try:
            track = search_recording(recording, frame, model, options)
        except ContactLearnError as error:
            assert isinstance(recording, Recording)
            refusals.append(_not_read(Path(recording.source), len(searched), error))
            continue
        searched.append(track)
        refusals += track.refusals
    return Survey(
        frame=frame,
        model=model,
        recordings=len(searched),
        contacts=tuple(contact for track in searched for contact in track.contacts),
        refusals=tuple(refusals),
        rests=tuple(rest for track in searched for rest in track.rests),
        slides=tuple(slide for track in searched for slide in track.slides),
        wobbles=tuple(wobble for track in searched for wobble in track.wobbles),
        rocking=tuple(track.rocking for track in searched if track.rocking is not None and len(track.rocking)),
    )


def _not_read(file: Path, count: int, error: ContactLearnError) -> Refusal:
    return Refusal(
        recording=file.name,
        reason=Reason.NOT_READ,
        quantity="recordings read before",
        value=count,
        unit="recordings",
        message=str(error),
    )
