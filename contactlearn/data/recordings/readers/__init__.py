"""Readers of recordings: one small module a format, each with one function `read(path, layout)`.

    columns   CSV and Parquet: a column each, or a long file with a column that names the recordings
    motive    CSV exports of OptiTrack Motive
    tum       TUM text: time, position, quaternion
    hdf5      HDF5: a group a recording            extra contactlearn[tracks]
    c3d       C3D: markers                         extra contactlearn[tracks]
    rosbag    ROS bags and MCAP: poses of a topic  extra contactlearn[tracks]

A reader yields one recording after the other, so that a long file is never in memory as a whole; one of several in a
file that is not as it must be is yielded as its error.
"""

from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path

from contactlearn.core.errors import ContactLearnError, DataError, installing
from contactlearn.data.recordings.readers.layout import Layout
from contactlearn.data.recordings.track import Recording

_MODULES = {
    ".csv": "columns",
    ".parquet": "columns",
    ".txt": "tum",
    ".tum": "tum",
    ".h5": "hdf5",
    ".hdf5": "hdf5",
    ".c3d": "c3d",
    ".bag": "rosbag",
    ".db3": "rosbag",
    ".mcap": "rosbag",
}
SUFFIXES = tuple(_MODULES)
"""Of the files that can be read."""
_MOTIVE = "Format Version"


def read(path: Path, layout: Layout = Layout()) -> Iterator[Recording | DataError]:
    """Yield the recordings of a file; one of several that is not as it must be is its error.

    Raises:
        DataError: the file cannot be read, or is not what it seems; it names the file.
        ContactLearnError: the library that reads the format is not installed.
    """
    name = _MODULES.get(path.suffix.lower())
    if name is None:
        raise DataError(f"{path}: is no recording; a recording is one of {', '.join(SUFFIXES)}")
    try:
        if path.suffix.lower() == ".csv" and _is_motive(path):
            name = "motive"
        module = import_module(f"contactlearn.data.recordings.readers.{name}")
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("contactlearn"):
            raise
        raise ContactLearnError(
            f"{path}: files with suffix {path.suffix} need {error.name}: {installing('tracks')}"
        ) from None
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error.strerror}") from error
    reader: Callable[[Path, Layout], Iterator[Recording | DataError]] = module.read
    try:
        yield from reader(path, layout)
    except ContactLearnError:
        raise
    except Exception as error:  # a damaged file can break a library anywhere
        raise DataError(f"{path}: cannot be read: {str(error).splitlines()[0] if str(error) else error!r}") from error


def recording_files(path: Path) -> list[Path]:
    """Return the recordings of a folder and below it, by name, or the file itself.

    Raises:
        DataError: there is none.
    """
    if path.is_file():
        return [path]
    if not path.is_dir():
        raise DataError(f"{path}: no such file or folder; check the path (relative to {Path.cwd()})")
    files = sorted(file for file in path.rglob("*") if file.is_file() and file.suffix.lower() in SUFFIXES)
    files = [file for file in files if not any(part.startswith(".") for part in file.relative_to(path).parts)]
    if not files:
        raise DataError(f"{path}: holds no recordings; a recording is one of {', '.join(SUFFIXES)}")
    return files


def _is_motive(path: Path) -> bool:
    with path.open(encoding="utf-8-sig", errors="replace") as lines:
        return lines.readline(200).lstrip('"').startswith(_MOTIVE)
