"""CSV and Parquet: a row a frame, columns named in the layout.

    time; x, y, theta                     in a plane
    time; x, y, z; qw, qx, qy, qz         in space
    recording                             in a file with several recordings, each of them in one piece

An empty cell is a coordinate that the tracker lost.
"""

from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path

import numpy as np
import pandas as pd
from pyarrow import parquet

from contactlearn.core.errors import DataError, suggest
from contactlearn.data.recordings.markers import pose_of_markers
from contactlearn.data.recordings.poses import Array
from contactlearn.data.recordings.readers import Layout
from contactlearn.data.recordings.track import Recording

_ROWS = 200_000  # that are read at once
MOST_FRAMES = 2_000_000
"""Of a recording: more than half an hour at 1000 frames a second, and a gigabyte or two of memory."""


def read(path: Path, layout: Layout) -> Iterator[Recording | DataError]:
    """Yield the recordings of a CSV or Parquet file, or the error of one."""
    names, seen = layout.recording, set[str]()
    pending, rows = list[pd.DataFrame](), 0
    for part in _parts(path):
        _check_columns(path, part, layout)
        for piece in _pieces(part, names):
            if pending and _name(pending[-1], names) != _name(piece, names):
                yield _whole(path, pending, rows, layout, seen)
                pending, rows = [], 0
            rows += len(piece)
            if rows <= MOST_FRAMES or not pending:
                pending.append(piece)
            elif names not in part.columns:
                raise DataError(
                    f"{path}: has more than {MOST_FRAMES} frames and no column {names!r} of recordings: split it"
                )
    if not pending:
        raise DataError(f"{path}: holds no frames")
    yield _whole(path, pending, rows, layout, seen)


def _name(piece: pd.DataFrame, names: str | None) -> str | None:
    return str(piece[names].iloc[0]) if names in piece.columns else None


def _pieces(part: pd.DataFrame, names: str | None) -> Iterator[pd.DataFrame]:
    """Runs of rows of one recording."""
    if names not in part.columns:
        yield part
    elif len(part):
        keys = part[names].astype(str)
        for _, piece in part.groupby((keys != keys.shift()).cumsum(), sort=False):
            yield piece


def _parts(path: Path) -> Iterator[pd.DataFrame]:
    if path.suffix.lower() == ".parquet":
        with parquet.ParquetFile(path, pre_buffer=False) as file:
            for batch in file.iter_batches(_ROWS):
                yield batch.to_pandas()
        return
    with path.open("rb") as file:
        if not file.read(1):
            raise DataError(f"{path}: the file is empty; its first line names the columns")
    with pd.read_csv(path, chunksize=_ROWS, low_memory=False, skipinitialspace=True, encoding="utf-8-sig") as reader:
        yield from reader


def _whole(path: Path, pieces: list[pd.DataFrame], rows: int, layout: Layout, seen: set[str]) -> Recording | DataError:
    """One recording of its pieces, or its error.

    Raises:
        DataError: it is alone; or its frames are not in one piece, and those of others will not be either.
    """
    name = _name(pieces[0], layout.recording) or path.stem
    if name in seen:
        raise DataError(f"{path}: the frames of recording {name!r} are not in one piece; sort the file by recording")
    seen.add(name)
    if rows > MOST_FRAMES:
        return DataError(f"{path}: {name}: has {rows} frames, more than {MOST_FRAMES}: split it")
    try:
        return _recording(path, name, pieces[0] if len(pieces) == 1 else pd.concat(pieces), layout)
    except DataError as error:
        if layout.recording not in pieces[0].columns:
            raise
        return error


def _recording(path: Path, name: str, table: pd.DataFrame, layout: Layout) -> Recording:
    if len(table) == 0:
        raise DataError(f"{path}: holds no frames")
    place = f"{path}: {name}" if layout.recording in table.columns else str(path)
    if layout.time is not None and layout.time in table.columns:
        time = layout.checked(_column(place, table, layout.time), place)
    else:
        time = layout.times(len(table), str(path))
    if layout.markers:
        markers = np.stack([_columns(place, table, names) for names in layout.markers], 1)
        return pose_of_markers(markers, time, layout.places, name=name, source=str(path))
    spatial = layout.position[2:] and layout.position[2] in table.columns
    position = _columns(place, table, layout.position if spatial else layout.position[:2])
    if spatial:
        quaternion = _columns(place, table, layout.quaternion)
        return Recording(
            name=name, source=str(path), time=time, position=position, quaternion=quaternion, order=layout.order
        )
    return Recording(
        name=name, source=str(path), time=time, position=position, angle=_column(place, table, layout.angle)
    )


def _check_columns(path: Path, table: pd.DataFrame, layout: Layout) -> None:
    """Refuse a file that lacks columns, before any of its recordings is refused for it."""
    spatial = layout.position[2:] and layout.position[2] in table.columns
    poses = (*layout.position, *layout.quaternion) if spatial else (*layout.position[:2], layout.angle)
    for name in chain.from_iterable(layout.markers) if layout.markers else poses:
        if name not in table.columns:
            known = [str(column) for column in table.columns]
            raise DataError(
                f"{path}: has no column {name!r}{suggest(name, known)}; it has {', '.join(known)} "
                "('data.columns={time: t, position: [px, py], angle: phi}' says which are which)"
            )
    if layout.time not in table.columns:
        layout.times(0, str(path))


def _columns(place: str, table: pd.DataFrame, names: Sequence[str]) -> Array:
    return np.stack([_column(place, table, name) for name in names], 1)


def _column(place: str, table: pd.DataFrame, name: str) -> Array:
    """A column as numbers, not a number where it is empty."""
    try:
        return table[name].to_numpy(dtype=np.float64, na_value=np.nan)
    except (TypeError, ValueError):
        cells = pd.to_numeric(table[name], errors="coerce")
        row = int(np.argmax((cells.isna() & table[name].notna()).to_numpy()))
        raise DataError(
            f"{place}: row {row + 1}, column {name}: must be a number, got {table[name].iloc[row]!r}"
        ) from None
