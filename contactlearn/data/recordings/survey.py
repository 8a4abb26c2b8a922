"""From files of recordings to contacts: conventions from a few of them, then one recording after the other.

A file that cannot be read is refused with its message, and the others go on.  No more than a few recordings are in
memory at a time; of each the contacts, refusals and rests stay.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from contactlearn.core.errors import ContactLearnError, DataError
from contactlearn.core.workers import WorkerPool
from contactlearn.data.recordings.contacts import find_contacts
from contactlearn.data.recordings.conventions import Conventions, find_frame
from contactlearn.data.recordings.flights import FlightOptions
from contactlearn.data.recordings.floor import find_rests
from contactlearn.data.recordings.frame import Frame
from contactlearn.data.recordings.readers import Layout, read, recording_files
from contactlearn.data.recordings.result import Found, Hit, Reason, Refusal, Rest
from contactlearn.data.recordings.thresholds import TrackThresholds
from contactlearn.data.recordings.track import Recording, Track

_SAMPLE = 24  # recordings from which conventions are found
_MANY = 100  # files from which on they are shared among processes
_CHUNK = 16  # files, or recordings of a single one, that a process gets at once
_AHEAD = 4  # pieces of a single file that wait for each process

_Piece = list[Recording | Refusal]


Progress = Callable[[Iterable[Any]], Iterable[Any]]
"""Wraps files as they are read or, of a single one, pieces of at most 16 recordings."""


@dataclass(frozen=True, kw_only=True)
class TrackOptions:
    """Options of the step from files to contacts.

    Args:
        conventions: that are stated.
        layout: of the files.
        flight: of the search for flights and contacts.
        thresholds: that decide.
        workers: processes, for many files or a single one.
    """

    conventions: Conventions = Conventions()
    layout: Layout = Layout()
    flight: FlightOptions = FlightOptions()
    thresholds: TrackThresholds = TrackThresholds()
    workers: int = 1

    def in_air(self, frame: Frame) -> "TrackOptions":
        """The options with gravity in the measured direction, and drag."""
        return replace(self, flight=replace(self.flight, air=frame.air))


@dataclass(frozen=True, eq=False, kw_only=True)
class Survey:
    """What files of recordings hold.

    Args:
        frame: conventions of all of them, with the evidence.
        recordings: how many were read.
        contacts: accepted ones, in the order of the files and of time.
        refusals: of recordings and their parts.
        rests: where a body is still, in the order of the files.
    """

    frame: Frame
    recordings: int
    contacts: tuple[Hit, ...]
    refusals: tuple[Refusal, ...]
    rests: tuple[Rest, ...]


def survey(path: Path, options: TrackOptions = TrackOptions(), *, progress: Progress = iter) -> Survey:
    """Find the contacts in a recording, or in all recordings of a folder and below it.

    Args:
        path: a file or a folder.
        options: of the search.
        progress: wraps the files as they are read, or the pieces of a single one.

    Raises:
        DataError: no recording can be read, or a convention is neither stated nor found.
    """
    files = recording_files(path)
    frame = find_frame(sample(files, options.layout), options.conventions, options.thresholds)
    whole = _Part()
    for part in _parts(files, frame, options.in_air(frame), progress):
        whole.add(part)
    return Survey(
        frame=frame,
        recordings=whole.recordings,
        contacts=tuple(whole.contacts),
        refusals=tuple(whole.refusals),
        rests=tuple(whole.rests),
    )


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


def tracked(recording: Recording, frame: Frame, options: TrackOptions) -> Found:
    """Find the contacts of one recording; one that leaves the plane of motion is refused."""
    if (recording.quaternion is None) != (frame.axes.shape[1] == 2):
        raise DataError(f"{recording.source}: is in a plane where others are in space, or the other way round")
    track = frame.track(recording)
    leaves = _out_of_plane(track, options.thresholds)
    if leaves is not None:
        return Found(track=track, sigma=np.zeros(3), flights=(), contacts=(), refusals=(leaves,))
    found = find_contacts(track, options.flight, options.thresholds)
    lies = [refusal.time for refusal in found.refusals if refusal.reason in (Reason.REST, Reason.SLIDING)]
    return replace(found, rests=find_rests(track, lies, found.sigma))


def _out_of_plane(track: Track, limits: TrackThresholds) -> Refusal | None:
    seen = track.seen
    if not seen.any():
        return None
    apart = float(np.quantile(np.abs(track.apart[seen]), 0.95))
    tilted = float(np.quantile(np.abs(track.tilted[seen]), 0.95))
    whole = (float(track.time[0]), float(track.time[-1]))
    for value, limit, quantity, unit, factor in (
        (apart, limits.plane_distance, "distance from the plane of motion", "mm", 1e3),
        (tilted, limits.plane_tilt, "tilt out of the plane of motion", "°", 180 / np.pi),
    ):
        if value > limit:
            return Refusal(
                recording=track.name,
                reason=Reason.OUT_OF_PLANE,
                quantity=quantity,
                value=float(value * factor),
                unit=unit,
                time=whole,
            )
    return None


@dataclass(eq=False)
class _Part:
    """What some recordings hold; the fields are those of `Survey`."""

    recordings: int = 0
    contacts: list[Hit] = field(default_factory=list)
    refusals: list[Refusal] = field(default_factory=list)
    rests: list[Rest] = field(default_factory=list)

    def add(self, other: "_Part") -> None:
        """Add what others hold."""
        self.recordings += other.recordings
        self.contacts += other.contacts
        self.refusals += other.refusals
        self.rests += other.rests


def _parts(files: Sequence[Path], frame: Frame, options: TrackOptions, progress: Progress) -> Iterator[_Part]:
    """What each file holds, or each few recordings of a single one."""
    if len(files) > 1 and (options.workers == 1 or len(files) < _MANY):
        pieces = (piece for file in progress(files) for piece in _pieces(file, options.layout))
        yield from map(partial(_searched, frame=frame, options=options), pieces)
    elif len(files) > 1:
        work = partial(_surveyed, frame=frame, options=options)
        with WorkerPool(options.workers) as pool:
            for _, part in zip(progress(files), pool.map(work, files, chunksize=_CHUNK), strict=True):
                yield part
    else:
        pieces = progress(_pieces(files[0], options.layout))
        work = partial(_searched, frame=frame, options=options)
        yield from map(work, pieces) if options.workers == 1 else _shared(work, pieces, options.workers)


def _shared(work: Callable[[_Piece], _Part], pieces: Iterable[_Piece], workers: int) -> Iterator[_Part]:
    """What pieces of a file hold, in their order; no more of them than the processes need are read ahead."""
    waiting = deque[Future[_Part]]()
    with WorkerPool(workers) as pool:
        for piece in pieces:
            waiting.append(pool.submit(work, piece))
            if len(waiting) > _AHEAD * workers:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


def _pieces(file: Path, layout: Layout) -> Iterator[_Piece]:
    """A few recordings of a file at a time; what is the matter with one, or with the rest of the file, is a refusal."""
    piece, read_before = [], 0
    try:
        for recording in read(file, layout):
            if isinstance(recording, Recording):
                piece.append(recording)
                read_before += 1
            else:
                piece.append(_not_read(file, read_before, recording))
            if len(piece) == _CHUNK:
                yield piece
                piece = []
    except ContactLearnError as error:
        piece.append(_not_read(file, read_before, error))
    yield piece


def _surveyed(file: Path, frame: Frame, options: TrackOptions) -> _Part:
    """What one file holds."""
    part = _Part()
    for piece in _pieces(file, options.layout):
        part.add(_searched(piece, frame, options))
    return part


def _searched(piece: _Piece, frame: Frame, options: TrackOptions) -> _Part:
    """What a few recordings hold."""
    part = _Part()
    for recording in piece:
        if isinstance(recording, Refusal):
            part.refusals.append(recording)
            continue
        try:
            found = tracked(recording, frame, options)
        except ContactLearnError as error:
            part.refusals.append(_not_read(Path(recording.source), part.recordings, error))
            continue
        part.recordings += 1
        part.contacts += found.contacts
        part.refusals += found.refusals
        part.rests += found.rests
    return part


def _not_read(file: Path, count: int, error: ContactLearnError) -> Refusal:
    return Refusal(
        recording=file.name,
        reason=Reason.NOT_READ,
        quantity="recordings read before",
        value=count,
        unit="recordings",
        message=str(error),
    )
