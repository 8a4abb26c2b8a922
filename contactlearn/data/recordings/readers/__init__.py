"""Readers of recordings: one small module a format, each with one function `read(path, layout)`.

    columns   CSV and Parquet: a column each, or a long file with a column that names the recordings
    nested    JSON, and text with a title above each recording, which columns reads
    exports   headers of Qualisys, Vicon, Tracker, DeepLabCut and SLEAP, which columns reads
    arrays    arrays of NumPy and PyTorch, never objects
    motive    CSV exports of OptiTrack Motive
    tum       TUM text: time, position, quaternion
    hdf5      HDF5: a group a recording            extra contactlearn[tracks]
    c3d       C3D: markers                         extra contactlearn[tracks]
    rosbag    ROS bags and MCAP: poses of a topic  extra contactlearn[tracks]

A reader yields one recording after the other, so that a long file is never in memory as a whole; one of several in a
file that is not as it must be is yielded as its error.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np

from contactlearn.core.errors import ContactLearnError, DataError, install_hint
from contactlearn.data.packed import UNREAD, files_in, is_archive, is_single, opened_text
from contactlearn.data.recordings.poses import Array
from contactlearn.data.recordings.track import Recording, mean_step, on_grid, parted

LARGEST = 2**30
"""Bytes of a file that is read as one recording."""
LIKELY = 0.6
"""Likelihood below which DeepLabCut takes a point for lost by default."""
_NUMBERED = 10  # whole numbers in a row that count frames: no flight is seen at one frame a second
RECORDED = frozenset(
    ("recording", "clip", "take", "toss", "throw", "drop", "trial", "run", "video", "movie", "episode", "experiment")
) | {"env", "environment", "rollout", "shot", "sequence", "aufnahme", "wurf", "versuch", "essai", "ensayo", "prova"}
"""Words for a recording."""
TITLE = re.compile(
    rf"[#%/;*=\s\[(<-]*(?:{'|'.join(sorted(RECORDED))})(?:[\s_#:=.-]|no|nr)*([\w.-]*\d[\w.-]*?)[\s\])>:=*-]*(?:\(.*\))?",
    re.IGNORECASE,
)
"""A line above the frames of a recording, with its number or name."""
_TOP = 10  # lines among which the first title is
VECTOR = r"(?:rvec|rot(?:ation)?[\W_]*vec(?:tor)?|axis[\W_]*angle|helical)"
"""Names of a vector of rotation begin so."""
COMMENT = ("#", "%", "//")
"""Lines that begin so are comments."""
_SINCE_1970 = {1e17: 1e-9, 1e14: 1e-6, 1e11: 1e-3}  # s, of a time in ns, µs and ms that is greater
_FAR_APART = {500.0: 1e-6, 0.5: 1e-3}  # s, of a time between frames that is greater: no flight lasts several such
_RATE_TOLERANCE = 0.01  # relative distance of a stated frame rate from that of the time stamps


def in_seconds(times: Array) -> Array:
    """Times of no stated unit in s: since 1970 in ms, µs or ns by their size, or ms and µs where s leave no flight."""
    if len(times) < 2 or not np.isfinite(times).all():
        return times
    for least, factor in _SINCE_1970.items():
        if times[0] > least:
            return (times - times[0]) * factor
    step = float(np.median(np.diff(times)))
    if step == 1 and (times == np.round(times)).all():
        return times  # frame numbers
    return times * next((factor for least, factor in _FAR_APART.items() if step > least), 1.0)


@dataclass(frozen=True, kw_only=True)
class Layout:
    """Names of columns; of each the first that the file has is taken.

    In place of a name of all but `recording` may stand {column: …, unit: …, factor: …} or {value: …} (`table.mapped`):
    the field then holds the name of the column that `made` describes.

    Args:
        time: of the time in s; None if the frame rate says it.
        rate: frames a second, for files without a column of times; one that contradicts this column is an error.
        position: of x and y, or of x, y and z; of arrays one may hold all, and of a quaternion likewise.
        angle: of the angle in the plane; None if none was measured, as of a ball; or [x, y] of a further point of the
            body, to which the angle points from the position.
        quaternion: of its four components; the order is read off names that end in w, x, y and z.  Three are turns
            about x, y and z, or a vector of rotation; nine a matrix, row by row.
        recording: of the recording's name, in a file with several; None if there is one a file.
        markers: of each marker's x and y, or x, y and z, from which the pose is found; none if the file has poses.
        body: of the rigid body, topic or group, where a file has several.
        places: of the markers in the body about its centre of mass, in the file's unit, where they are known: poses are
            then those of this body.
        unit: of length, where the file's format says so.
        stated_columns: what settings state of a column, by its name: that of the field, our column that it is like, and
            the entry.
    """

    time: str | None = "time"
    rate: float | None = None
    position: Sequence[str] = ("x", "y", "z")
    angle: str | None = "theta"
    quaternion: Sequence[str] = ("qw", "qx", "qy", "qz")
    recording: str | None = "recording"
    markers: Sequence[Sequence[str]] = field(default=())
    body: str | None = None
    places: Sequence[Sequence[float]] = field(default=())
    unit: str | None = None
    stated_columns: dict[str, tuple[str, str, Mapping[str, Any]]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("time", "angle"):
            object.__setattr__(self, name, self._named(name, getattr(self, name)))
        for name in ("position", "quaternion"):
            object.__setattr__(self, name, self._all_named(name, getattr(self, name)))
        markers = (self._all_named("markers", names) for names in self.markers)
        object.__setattr__(self, "markers", tuple(markers))
        places = [*chain.from_iterable(self.markers)] or self.position
        entries = [self.stated_columns[name][2] if name in self.stated_columns else {} for name in places]
        in_unit = {"unit" in entry for entry in entries if entry.get("value") != 0}
        if len(in_unit) > 1:
            raise DataError("data.columns.position: state the unit of each column, or of none of them and data.unit")
        if True in in_unit:
            object.__setattr__(self, "unit", "m")
        if isinstance(self.recording, Mapping):
            raise DataError(f"data.columns.recording is the name of a column, got {dict(self.recording)}")
        if self.body is not None:
            object.__setattr__(self, "body", str(self.body))  # a number in settings
        if self.rate is not None and not 0 < self.rate < np.inf:
            raise DataError(f"data.rate must be a positive number of frames a second, got {self.rate}")
        if len(self.quaternion) not in (1, 3, 4, 9):
            raise DataError(
                "data.columns.quaternion must name four columns, or in its place euler three, about x, y and z, or "
                f"matrix nine, row by row; got {self.quaternion}"
            )

    def _all_named(self, field: str, entries: Any) -> tuple[str, ...]:
        one = isinstance(entries, str | Mapping)
        return tuple(str(self._named(field, entry)) for entry in ([entries] if one else entries))

    def _named(self, field: str, entry: Any) -> str | None:
        """The name of a column; that of one which settings make ends as its source does, and shows the order."""
        if field == "angle" and isinstance(entry, Sequence) and not isinstance(entry, str):
            entry = {"towards": self._all_named("angle", entry)}
        if not isinstance(entry, Mapping):
            return None if entry is None else str(entry)
        like = {"time": "time", "angle": "theta", "quaternion": "theta"}.get(field, "x")
        unit = " [s]" if field == "time" and "unit" in entry else ""
        name = f"{field} {len(self.stated_columns)} {str(entry.get('column', ''))[-1:]}{unit}"
        self.stated_columns[name] = (field, like, entry)
        return name

    def times(self, frames: int, source: str) -> Array:
        """Times of frames by the frame rate.

        Raises:
            DataError: there is none.
        """
        if self.rate is None:
            if self.time is None:
                raise DataError(f"{source}: has no times; state data.rate")
            raise DataError(f"{source}: has no column {self.time!r}; name it (data.columns.time), or state data.rate")
        return np.arange(frames) / self.rate

    def checked(self, stamps: Array, source: str) -> Array:
        """Time stamps, unless the stated frame rate is another one; frame numbers over this rate.

        Raises:
            DataError: they are more than 1 % apart, or are frame numbers without a rate.
        """
        if len(stamps) >= _NUMBERED and (stamps == np.round(stamps)).all() and np.median(np.diff(stamps)) == 1:
            if self.rate is None:
                raise DataError(f"{source}: frames are numbered, and have no times; state data.rate, frames a second")
            return stamps / self.rate
        stamps = on_grid(stamps)
        if self.rate is None or len(stamps) < 2 or not (np.diff(stamps) > 0).all():  # the last is `Recording`'s error
            return stamps
        if abs(mean_step(stamps) * self.rate - 1) > _RATE_TOLERANCE:
            raise DataError(
                f"{source}: frames are {mean_step(stamps):.4g} s apart by their time stamps, and {1 / self.rate:.4g} s "
                f"by data.rate={self.rate:g}; leave out the wrong one, time stamps by time: null in data.columns"
            )
        return stamps

    def poses(self, path: Path, rows: Sequence[Sequence[float]], order: str) -> Recording:
        """Return the recording of rows of time, position in m and quaternion.

        Raises:
            DataError: there are none.
        """
        if not rows:
            raise DataError(f"{path}: holds no frames")
        values = np.array(rows, dtype=np.float64)
        time = values[:, 0] if self.rate is None else self.times(len(values), str(path))
        position, quaternion = values[:, 1:4], values[:, 4:]
        return Recording(
            name=path.stem, source=str(path), time=time, position=position, quaternion=quaternion, unit="m", order=order
        )

    @property
    def order(self) -> str | None:
        """Order of the quaternion's components by the last letters of their names, or that they are another vector."""
        if len(self.quaternion) == 3 and all(re.match(VECTOR, name, re.IGNORECASE) for name in self.quaternion):
            return "rotvec"
        letters = "".join(name[-1:].lower() for name in self.quaternion)
        return letters if letters in ("wxyz", "xyzw") else None


JSON = (".json", ".jsonl", ".ndjson")
"""Suffixes of JSON."""
_MODULES = {
    ".csv": "columns",
    ".tsv": "columns",
    ".parquet": "columns",
    **dict.fromkeys(JSON, "columns"),
    ".txt": "tum",
    ".tum": "tum",
    **dict.fromkeys((".npz", ".npy", ".pt", ".mat"), "arrays"),
    ".h5": "hdf5",
    ".hdf5": "hdf5",
    ".c3d": "c3d",
    ".bag": "rosbag",
    ".db3": "rosbag",
    ".mcap": "rosbag",
}
SUFFIXES = tuple(_MODULES)
"""Of the files that can be read."""
TABLES = (".xlsx", ".ods", ".dat", ".asc", ".prn", ".tab", ".lvm", ".sqlite", ".sqlite3", ".db")
"""Suffixes of other tables: a file is read by its path, and not for the folder that it is in."""
_MOTIVE = "Format Version"
TUM_COLUMNS = 8
"""Numbers in a line of TUM text."""


def read(path: Path, layout: Layout = Layout()) -> Iterator[Recording | DataError]:
    """Yield the recordings of a file; one of several that is not as it must be is its error.

    Raises:
        DataError: the file cannot be read, or its content is not of its format; it names the file.
        ContactLearnError: the library that reads the format is not installed.
    """
    _check_suffix(path)
    name = _MODULES.get(path.suffix.lower(), "columns")
    try:
        if path.suffix.lower() == ".csv" and is_motive(path):
            name = "motive"
        if path.suffix.lower() == ".txt" and (not leading_numbers(path) or has_titles(path)):
            name = "columns"
        if layout.stated_columns and name != "columns":
            raise DataError(
                f"{path}: units, factors and values of columns are read of tables of frames, and this is none; state "
                "data.unit, data.angle, data.sense and data.rate, or export it as CSV"
            )
        module = import_module(f"contactlearn.data.recordings.readers.{name}")
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("contactlearn"):
            raise
        raise ContactLearnError(
            f"{path}: files with suffix {path.suffix} need {error.name}: {install_hint('tracks')}"
        ) from None
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error.strerror}") from error
    reader: Callable[[Path, Layout], Iterator[Recording | DataError]] = module.read
    try:
        for found in reader(path, layout):
            yield from [found] if isinstance(found, DataError) else parted(found)
    except ContactLearnError:
        raise
    except Exception as error:  # a damaged file can break a library anywhere
        raise DataError(f"{path}: cannot be read: {str(error).splitlines()[0] if str(error) else error!r}") from error


def _check_suffix(path: Path) -> None:
    """Refuse a file that is no recording by its name."""
    if path.suffix.lower() in UNREAD:
        raise DataError(f"{path}: is compressed; unpack it first, and give the file or folder that comes out")
    if path.suffix.lower() in (".pkl", ".pickle", ".p", ".joblib"):
        raise DataError(
            f"{path}: is a pickle, which runs code when it is opened; write impacts as CSV or with numpy.savez("
            "'impacts.npz', vx=…, vy=…, omega=…, vx_post=…, …), and frames likewise (time=…, position=…, quaternion=…)"
        )
    if path.suffix.lower() not in (*SUFFIXES, *TABLES):
        raise DataError(
            f"{path}: is no recording; a recording is one of {', '.join(SUFFIXES)}; export it as CSV, and a table of "
            "impacts likewise (docs/tables.md)"
        )


def recording_files(path: Path) -> list[Path]:
    """Return the recordings of a folder or an archive and below it, by name, or the file itself.

    Raises:
        DataError: there is none.
    """
    if is_single(path):
        _check_suffix(path)
        return [path]
    if is_archive(path):
        files = files_in(path, SUFFIXES)
    elif path.is_dir():
        files = sorted(file for file in path.rglob("*") if file.is_file() and file.suffix.lower() in SUFFIXES)
    else:
        raise DataError(f"{path}: no such file or folder; check the path (relative to {Path.cwd()})")
    # settings often lie beside recordings
    files = [file for file in files if file.suffix.lower() not in JSON] or files
    if not files and (other := next((file for file in sorted(path.rglob("*.p*kl*")) if file.is_file()), None)):
        _check_suffix(other)
    files = [file for file in files if not file.name.lower().startswith(("readme", "license"))]
    files = [file for file in files if not any(part.startswith(".") for part in file.relative_to(path).parts)]
    if not files:
        raise DataError(f"{path}: holds no recordings; a recording is one of {', '.join(SUFFIXES)}")
    return files


def has_titles(path: Path) -> bool:
    """Whether titles such as # toss 3, or the comment in the first line, stand above the recordings of a text."""
    with opened_text(path, encoding="utf-8-sig", errors="replace") as file:
        top = [line.strip() for line in islice(file, _TOP)]
        first = top[0] if top and top[0].startswith(COMMENT) and re.search(r"\w", top[0]) else None
        if first is None and not any(map(TITLE.fullmatch, top)):
            return False
        file.seek(0)
        titles = (line for line in map(str.strip, file) if line == first or TITLE.fullmatch(line))
        return len([*islice(titles, 2)]) == 2


def leading_numbers(path: Path) -> int:
    """Count the numbers in the first line of a text that is no comment; 0 if it has other words."""
    with opened_text(path, encoding="utf-8", errors="replace") as file:
        words = next((line.split() for line in file if line.strip() and not line.startswith("#")), [])
    return len(words) * all(re.fullmatch(r"[-+]?[\d.]+(?:e[-+]?\d+)?", word, re.IGNORECASE) for word in words)


def is_motive(path: Path) -> bool:
    """Whether a CSV file is an export of OptiTrack Motive."""
    with opened_text(path, encoding="utf-8-sig", errors="replace") as lines:
        return lines.readline(200).lstrip('"').startswith(_MOTIVE)
