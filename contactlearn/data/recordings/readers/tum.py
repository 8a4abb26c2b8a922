"""TUM text: `time x y z qx qy qz qw` in a line, separated by blanks; lines that begin with # are comments.

Source: Sturm et al. 2012, "A benchmark for the evaluation of RGB-D SLAM systems"; lengths are in metres.
"""

from collections.abc import Iterator
from pathlib import Path

from contactlearn.core.errors import DataError
from contactlearn.data.packed import opened_text, size_of
from contactlearn.data.recordings.readers import LARGEST, TUM_COLUMNS, Layout
from contactlearn.data.recordings.track import Recording


def read(path: Path, layout: Layout) -> Iterator[Recording]:
    """Yield the one recording of a file."""
    if size_of(path) > LARGEST:
        raise DataError(f"{path}: is larger than {LARGEST >> 30} GiB: split it")
    with opened_text(path, encoding="utf-8") as lines:
        rows = [line.split() for line in lines if line.strip() and not line.startswith("#")]
    for number, row in enumerate(rows, 1):
        if len(row) != TUM_COLUMNS:
            raise DataError(
                f"{path}: is no TUM text, as which {path.suffix} is read: frame {number} has {len(row)} words, "
                f"not the {TUM_COLUMNS} numbers t x y z qx qy qz qw"
            )
    try:
        frames = [[*map(float, row)] for row in rows]
    except ValueError as error:
        raise DataError(f"{path}: is no TUM text, as which {path.suffix} is read: {error}") from None
    yield layout.poses(path, frames, "xyzw")
