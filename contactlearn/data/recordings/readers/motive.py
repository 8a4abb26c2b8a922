"""CSV exports of OptiTrack Motive: a rigid body's position and quaternion.

    line 1      pairs of a key and its value: Format Version, Export Frame Rate, Rotation Type, Length Units, …
    then        lines that say of each column its type, name, ID, from version 1.24 its parent, and its quantity
    then        Frame, Time (Seconds), from 1.24 perhaps TimeCode, and the letters X, Y, Z, W
    then        a line a frame; cells of frames in which the body was lost are empty

Versions 1.1 to 1.25 differ in how many lines there are and whether they have titles, so columns are found by the
content of these lines.  Quaternions are the columns that are called X, Y, Z and W, in this order or another.
Source: the exporter's documentation, "Data Export: CSV".
"""

import csv
from collections.abc import Iterator
from contextlib import suppress
from itertools import islice
from pathlib import Path

import numpy as np
import pandas as pd

from contactlearn.core.errors import DataError, UnknownNameError
from contactlearn.data.packed import for_library, opened_text, size_of
from contactlearn.data.recordings.readers import LARGEST, Layout
from contactlearn.data.recordings.track import Recording

_HEADER = 20  # lines among which the header ends
_UNITS = {"meters": "m", "metres": "m", "centimeters": "cm", "millimeters": "mm", "inches": "in", "feet": "ft"}
_TIME = "Time (Seconds)"


def read(path: Path, layout: Layout) -> Iterator[Recording]:
    """Yield the one recording of an export."""
    if size_of(path) > LARGEST:
        raise DataError(f"{path}: is larger than {LARGEST >> 30} GiB: export shorter takes")
    with opened_text(path, encoding="utf-8-sig", newline="") as lines:
        rows = list(islice(csv.reader(lines), _HEADER))
    about = dict(zip(rows[0][::2], rows[0][1::2], strict=False))
    start = next((k for k, row in enumerate(rows) if "Frame" in row[:2] and k), None)
    if start is None:
        raise DataError(f"{path}: no line of columns begins with Frame; is the export complete?")
    if about.get("Rotation Type", "Quaternion") != "Quaternion":
        raise DataError(f"{path}: rotations are {about['Rotation Type']}; export them as Quaternion")
    columns = _columns(path, rows[1:start], rows[start], layout.body)
    wanted = [*columns["Position"].values(), *columns["Rotation"].values()]
    clock = rows[start].index(_TIME) if _TIME in rows[start] else None
    frame = pd.read_csv(
        for_library(path), skiprows=_line(path, start), header=None,
        usecols=[*wanted, *([] if clock is None else [clock])], skip_blank_lines=True,
        dtype=np.float64, encoding="utf-8-sig",
    )  # fmt: skip
    if len(frame) == 0:
        raise DataError(f"{path}: holds no frames")
    rate = layout.rate or float(about.get("Export Frame Rate") or about.get("Capture Frame Rate") or 0) or None
    stated = layout if rate is None else Layout(rate=rate)
    time = frame[clock].to_numpy() if clock is not None and layout.rate is None else stated.times(len(frame), str(path))
    yield Recording(
        name=path.stem,
        source=str(path),
        time=time,
        position=frame[[columns["Position"][letter] for letter in "XYZ"]].to_numpy(),
        quaternion=frame[[columns["Rotation"][letter] for letter in "WXYZ"]].to_numpy(),
        unit=_UNITS.get(about.get("Length Units", "").lower()),
        order="wxyz",
    )


def bodies_of(path: Path) -> list[str]:
    """Return the names of the rigid bodies of an export; none of one that is damaged, which `read` refuses."""
    rows: list[list[str]] = []
    with opened_text(path, encoding="utf-8-sig", errors="replace", newline="") as lines, suppress(csv.Error):
        rows += [row for row in islice(csv.reader(lines), _HEADER) if any(row)]
    kinds = next((k for k, row in enumerate(rows[:-1]) if "Rigid Body" in row), None)
    if kinds is None:
        return []
    return [*dict.fromkeys(name for kind, name in zip(*rows[kinds : kinds + 2], strict=False) if kind == "Rigid Body")]


def _columns(path: Path, titles: list[list[str]], letters: list[str], body: str | None) -> dict[str, dict[str, int]]:
    """Columns of the rigid body by Position or Rotation, and by letter."""
    width = len(letters)
    padded = [row + [""] * (width - len(row)) for row in titles if any(row)]
    kinds = next((row for row in padded if "Rigid Body" in row), None)
    measured = next((row for row in padded if "Position" in row and "Rotation" in row), None)
    if kinds is None or measured is None:
        raise DataError(
            f"{path}: holds no rigid body with position and rotation; export rigid bodies as well as markers"
        )
    names = padded[padded.index(kinds) + 1]
    bodies = list(dict.fromkeys(names[k] for k in range(width) if kinds[k] == "Rigid Body"))
    if body is None and len(bodies) > 1:
        raise DataError(f"{path}: holds the bodies {', '.join(bodies)}; state data.body")
    if body is not None and body not in bodies:
        raise UnknownNameError(f"rigid body of {path}", body, bodies)
    found: dict[str, dict[str, int]] = {"Position": {}, "Rotation": {}}
    for k in range(width):
        if kinds[k] == "Rigid Body" and names[k] == (body or bodies[0]) and measured[k] in found:
            found[measured[k]][letters[k].strip().upper()] = k
    lacking = [f"{kind} {one}" for kind, all_ in (("Position", "XYZ"), ("Rotation", "XYZW")) for one in all_
               if one not in found[kind]]  # fmt: skip
    if lacking:
        raise DataError(f"{path}: the rigid body lacks {', '.join(lacking)}")
    return found


def _line(path: Path, row: int) -> int:
    """Lines of the file up to the end of a row, which a name in quotes may break."""
    with opened_text(path, encoding="utf-8-sig", newline="") as lines:
        reader = csv.reader(lines)
        for _ in islice(reader, row + 1):
            pass
        return reader.line_num
