"""CSV and Parquet: a row a frame, columns named in the layout.

    time; x, y, theta                     in a plane
    time; x, y, z; qw, qx, qy, qz         in space
    recording                             in a file with several recordings, each of them in one piece

An empty cell is a coordinate that the tracker lost.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from pyarrow import parquet

from contactlearn.errors import DataError, suggest
from contactlearn.tracks.markers import pose_of_markers
from contactlearn.tracks.readers.layout import LARGEST, Layout
from contactlearn.tracks.track import Array, Recording

_ROWS = 500_000  # that are read at once


def read(path: Path, layout: Layout) -> Iterator[Recording]:
    """Yield the recordings of a CSV or Parquet file."""
    pending: list[pd.DataFrame] = []
    names = layout.recording
    seen: set[str] = set()
    for part in _parts(path):
        if names not in part.columns:
            if path.stat().st_size > LARGEST:
                raise DataError(
                    f"{path}: is larger than {LARGEST >> 30} GiB and has no column {names!r} of recordings: split it"
                )
            pending.append(part)
            continue
        keys = part[names].astype(str)
        for _, piece in part.groupby((keys != keys.shift()).cumsum(), sort=False):
            if pending and str(pending[-1][names].iloc[0]) != str(piece[names].iloc[0]):
                yield _whole(path, pending, layout, seen)
                pending = []
            pending.append(piece)
    if not pending:
        raise DataError(f"{path}: holds no frames")
    yield _whole(path, pending, layout, seen)


def _parts(path: Path) -> Iterator[pd.DataFrame]:
    if path.suffix.lower() == ".parquet":
        for batch in parquet.ParquetFile(path).iter_batches(_ROWS):
            yield batch.to_pandas()
        return
    with path.open("rb") as file:
        if not file.read(1):
            raise DataError(f"{path}: the file is empty; its first line names the columns")
    with pd.read_csv(path, chunksize=_ROWS, skipinitialspace=True, encoding="utf-8-sig") as reader:
        yield from reader


def _whole(path: Path, pieces: list[pd.DataFrame], layout: Layout, seen: set[str]) -> Recording:
    """One recording of its pieces."""
    table = pieces[0] if len(pieces) == 1 else pd.concat(pieces)
    name = path.stem
    if layout.recording in table.columns:
        name = str(table[layout.recording].iloc[0])
        if name in seen:
            raise DataError(
                f"{path}: the frames of recording {name!r} are not in one piece; sort the file by recording"
            )
        seen.add(name)
    if len(table) == 0:
        raise DataError(f"{path}: holds no frames")
    time = _column(path, table, layout.time) if layout.time in table.columns else layout.times(len(table), str(path))
    if layout.markers:
        markers = np.stack([_columns(path, table, names) for names in layout.markers], 1)
        return pose_of_markers(markers, time, name=name, source=str(path))
    spatial = layout.position[2:] and layout.position[2] in table.columns
    position = _columns(path, table, layout.position if spatial else layout.position[:2])
    if spatial:
        quaternion = _columns(path, table, layout.quaternion)
        return Recording(
            name=name, source=str(path), time=time, position=position, quaternion=quaternion, order=layout.order
        )
    return Recording(
        name=name, source=str(path), time=time, position=position, angle=_column(path, table, layout.angle)
    )


def _columns(path: Path, table: pd.DataFrame, names: Sequence[str]) -> Array:
    return np.stack([_column(path, table, name) for name in names], 1)


def _column(path: Path, table: pd.DataFrame, name: str) -> Array:
    """A column as numbers, not a number where it is empty."""
    if name not in table.columns:
        known = [str(column) for column in table.columns]
        raise DataError(
            f"{path}: has no column {name!r}{suggest(name, known)}; it has {', '.join(known)} (data.columns names them)"
        )
    try:
        return table[name].to_numpy(dtype=np.float64, na_value=np.nan)
    except (TypeError, ValueError):
        cells = pd.to_numeric(table[name], errors="coerce")
        row = int(np.argmax((cells.isna() & table[name].notna()).to_numpy()))
        raise DataError(
            f"{path}: row {row + 1}, column {name}: must be a number, got {table[name].iloc[row]!r}"
        ) from None
