"""C3D: labelled markers, from which poses are found; the unit and the frame rate are the file's.

Of a file with the markers of several bodies, `data.body` names the prefix of the wanted ones.
Source: the format's documentation at c3d.org.
"""

from collections.abc import Iterator
from pathlib import Path

import ezc3d  # pyright: ignore[reportMissingImports]  (an extra)
import numpy as np

from contactlearn.core.errors import DataError
from contactlearn.data.packed import on_disk
from contactlearn.data.recordings.markers import pose_of_markers
from contactlearn.data.recordings.readers import Layout
from contactlearn.data.recordings.track import Recording


def read(path: Path, layout: Layout) -> Iterator[Recording]:
    """Yield the one recording of a C3D file."""
    content = ezc3d.c3d(str(on_disk(path)))
    about = content["parameters"]["POINT"]
    labels, points = about["LABELS"]["value"], content["data"]["points"]  # [4, M, T]
    chosen = [k for k, label in enumerate(labels) if layout.body is None or label.startswith(layout.body)]
    if not chosen:
        raise DataError(f"{path}: has no marker that begins with {layout.body!r}; it has {', '.join(labels)}")
    markers = np.asarray(points[:3, chosen], dtype=np.float64).transpose(2, 1, 0)
    rate = float(about["RATE"]["value"][0]) if layout.rate is None else layout.rate
    unit = next(iter(about["UNITS"]["value"]), "").lower() or None
    time = np.arange(len(markers)) / rate
    yield pose_of_markers(markers, time, layout.places, name=path.stem, source=str(path), unit=unit)
