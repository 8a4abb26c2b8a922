"""TUM text: `time x y z qx qy qz qw` in a line, separated by blanks; lines that begin with # are comments.

Source: Sturm et al. 2012, "A benchmark for the evaluation of RGB-D SLAM systems"; lengths are in metres.
"""

from collections.abc import Iterator
from pathlib import Path

from contactlearn.errors import DataError
from contactlearn.tracks.readers.layout import LARGEST, Layout
from contactlearn.tracks.track import Recording

_COLUMNS = 8


def read(path: Path, layout: Layout) -> Iterator[Recording]:
    """Yield the one recording of a file."""
    if path.stat().st_size > LARGEST:
        raise DataError(f"{path}: is larger than {LARGEST >> 30} GiB: split it")
    with path.open(encoding="utf-8") as lines:
        rows = [line.split() for line in lines if line.strip() and not line.startswith("#")]
    for number, row in enumerate(rows, 1):
        if len(row) != _COLUMNS:
            raise DataError(
                f"{path}: frame {number} has {len(row)} numbers; a TUM line has {_COLUMNS}: t x y z qx qy qz qw"
            )
    yield layout.poses(path, [[*map(float, row)] for row in rows], "xyzw")
