"""Text of trackers that begins with lines of its own: where the frames begin, and what their columns are.

    Qualisys TSV     keys with values, then MARKER_NAMES, or BODY_NAMES with position and matrix; mm, FREQUENCY
    Vicon CSV        sections such as Devices and Trajectories: a rate, names, axes, units, frames and a blank line each
    Tracker (OSP)    names of tracks, t, x, y; with decimal points or commas
    DeepLabCut       scorer, bodyparts, coords: pixels
    Logger Pro       Video Analysis: Time (s), X (cm), Y (cm), and X 2, Y 2 of the next object
    ROS 2            ros2 topic echo --csv: stamp, names of frames, position and quaternion, and no header
    SLEAP            track, frame_idx, a point's x, y and score in each three columns

A point whose likelihood or score is below 0.6 is lost, and so is a marker at 0, 0, 0.
Sources: the exporters' documentation, and files in public repositories.
"""

import csv
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path

import numpy as np
import pandas as pd

from contactlearn.core.errors import DataError
from contactlearn.data.packed import opened_text
from contactlearn.data.recordings.readers import LIKELY, Layout

_HEADER = 60  # lines among which the frames begin
_UNIT = 1e-3  # by which the length of a quaternion may differ from 1
_AXES = ("x", "y", "z")
_BY_ROWS = (0, 3, 6, 1, 4, 7, 2, 5, 8)  # of Qualisys's Rot[0] … Rot[8], column by column
_TRACKED = ("Objects", "Segments", "Trajectories", "Joints")  # sections of Vicon that are read, the first that there is
_SECTIONS = (*_TRACKED, "Devices", "Model Outputs", "Events", "Gaze Vectors")
Rows = list[list[str]]


@dataclass(frozen=True, kw_only=True)
class Export:
    """How the frames of a text stand in it.

    Args:
        names: of the columns.
        above: lines above the frames.
        separator: of cells.
        rate: frames a second, where the header says so.
        unit: of length, likewise.
        clock: column of times, where the export has one.
        points: columns of each point, which are markers of one body where there are several.
        bodies: columns of position and orientation of each rigid body.
        tracks: names of bodies of which each row has one.
        likelihoods: column by the name of a point.
    """

    names: Sequence[str]
    above: int
    separator: str = ","
    rate: float | None = None
    unit: str | None = None
    clock: str = "time"
    points: dict[str, list[str]] = field(default_factory=dict)
    bodies: dict[str, tuple[list[str], list[str]]] = field(default_factory=dict)
    tracks: Sequence[str] = ()
    likelihoods: dict[str, str] = field(default_factory=dict)

    @property
    def subjects(self) -> list[str]:
        """Return whose the points are, where their names say so: `ball` of `ball:centre`."""
        return [*dict.fromkeys(name.split(":")[0] for name in self.points if ":" in name)]

    def layout(self, path: Path, stated: Layout) -> Layout:
        """Return a layout with the columns of the body.

        Raises:
            DataError: it is not stated which of several bodies, or the stated one is not there.
        """
        stated = replace(stated, rate=stated.rate or self.rate, unit=stated.unit or self.unit)
        stated = replace(stated, time=self.clock) if stated.time == "time" else stated
        if self.bodies:
            if stated.body not in self.bodies and (stated.body is not None or len(self.bodies) > 1):
                choices = " or ".join(f"data.body={name}" for name in self.bodies)
                raise DataError(f"{path}: has the bodies {', '.join(self.bodies)}; state {choices}")
            position, turned = self.bodies[stated.body or next(iter(self.bodies))]
            return replace(stated, position=position, quaternion=turned, body=None)
        if stated.markers or stated.stated_columns or {*stated.position[:2]} <= {*self.names}:
            return stated if stated.angle in self.names else replace(stated, angle=None)
        if stated.body is None and len(self.subjects) > 1:
            choices = " or ".join(f"data.body={name}" for name in self.subjects)
            raise DataError(f"{path}: has points of {', '.join(self.subjects)}; state {choices}")
        start = f"{stated.body}:" if stated.body in self.subjects else stated.body or ""
        body, start = (stated.body, "") if stated.body in self.tracks else (None, start)
        own = {name: columns for name, columns in self.points.items() if name.startswith(start)}
        if not own:
            raise DataError(f"{path}: has no point that begins with {stated.body!r}; it has {', '.join(self.points)}")
        if len(own) == 1:
            return replace(stated, position=next(iter(own.values())), angle=None, body=body)
        return replace(stated, markers=[*own.values()], body=body)

    def cleaned(self, frames: pd.DataFrame) -> pd.DataFrame:
        """Return frames in which lost points are empty."""
        for name, columns in self.points.items():
            points = frames[columns].apply(pd.to_numeric, errors="coerce")
            lost = (points == 0).all(axis=1) if len(columns) == 3 else pd.Series(False, index=frames.index)
            if name in self.likelihoods:
                lost |= pd.to_numeric(frames[self.likelihoods[name]], errors="coerce") < LIKELY
            frames[columns] = points.mask(lost, np.nan, axis=0)
        return frames


def export_of(path: Path) -> Export | None:
    """Return how an export stands in a text file, or nothing if its first line names its columns."""
    start = _section(path)
    with opened_text(path, encoding="utf-8-sig", errors="replace", newline="") as file:
        lines = [line.rstrip("\r\n") for line in islice(file, start, start + _HEADER)]
    separator = next((mark for mark in "\t;" if any(mark in line for line in lines)), ",")
    try:
        rows = [[cell.strip() for cell in row] or [""] for row in csv.reader(lines, delimiter=separator)]
    except csv.Error:  # no export has cells of so many letters
        return None
    for read in _LAYOUTS:
        if len(rows) > 3 and (found := read(rows)):
            return replace(found, separator=separator, above=start + found.above)
    return None


def _section(path: Path) -> int:
    """Lines above the section of Vicon's CSV that has poses or markers; 0 of a file without sections.

    Raises:
        DataError: the file has only other sections, such as the forces of a plate.
    """
    with opened_text(path, encoding="utf-8-sig", errors="replace", newline="") as file:
        if _title(file.readline()) not in _SECTIONS:
            return 0
        file.seek(0)
        starts: dict[str, int] = {}
        blank = True
        for number, line in enumerate(file):
            if blank and (title := _title(line)) in _SECTIONS:
                starts.setdefault(title, number)
            blank = not line.strip(", ;\t\r\n")
    if known := [starts[title] for title in _TRACKED if title in starts]:
        return known[0]
    raise DataError(
        f"{path}: has the sections {', '.join(starts)}, and none of {', '.join(_TRACKED)}; export Trajectories as well"
    )


def _title(line: str) -> str:
    return line.strip(', ;\t\r\n"')


def _qualisys(rows: Rows) -> Export | None:
    if not rows[0][0].startswith("NO_OF_"):
        return None
    about = {row[0]: row[1:] for row in rows if row[0].isupper() and len(row) > 1}
    first = next((k for k, row in enumerate(rows) if k and row[0] not in about and _numeric(row)), None)
    if first is None:
        return None
    width, rate = len([*_trimmed(rows[first])]), float(about["FREQUENCY"][0].replace(",", "."))
    if markers := [*_trimmed(about.get("MARKER_NAMES", []))]:
        points = {name: [f"{name} {axis}" for axis in _AXES] for name in markers}
        names = [column for columns in points.values() for column in columns]
        names = [*(("frame", "time")[: width - len(names)]), *names]
        return Export(names=padded(names, rows[first]), above=first, rate=rate, unit="mm", points=points)
    bodies, header = [*_trimmed(about.get("BODY_NAMES", []))], rows[first - 1]
    begins = tuple(f"{body} " for body in bodies)  # puck X, puck Rot[0]
    header = [next((cell.removeprefix(one) for one in begins if cell.startswith(one)), cell) for cell in header]
    if not bodies or header.count("X") != len(bodies):
        return None
    named = [cell for cell in header if not (cell in bodies and len(header) > len(rows[first]))]
    starts = [k for k, cell in enumerate(named) if cell == "X"]
    names, found = [f"{cell or 'column'} {k}" for k, cell in enumerate(named)], dict[str, tuple[list[str], list[str]]]()
    for body, start in zip(bodies, starts, strict=True):
        matrix = named.index("Rot[0]", start)
        found[body] = (names[start : start + 3], [names[matrix + k] for k in _BY_ROWS])
    return Export(names=padded(names, rows[first]), above=first, rate=rate, unit="mm", bodies=found)


def _vicon(rows: Rows) -> Export | None:
    header = next((k for k, row in enumerate(rows) if row[0] == "Frame"), None)
    if rows[0][0] not in _TRACKED or header is None:
        return None
    axes, units = rows[header], rows[header + 1]
    names, group = list[str](), ""
    for k, axis in enumerate(axes):
        group = rows[header - 1][k] if k < len(rows[header - 1]) and rows[header - 1][k] else group
        names.append(f"{group} {axis}" if k > 1 else axis.lower())
    groups = dict.fromkeys(name.rpartition(" ")[0] for name in names[2:] if name.rpartition(" ")[0])
    points, bodies = dict[str, list[str]](), dict[str, tuple[list[str], list[str]]]()
    several = len({one.split(":")[0] for one in groups if ":" in one}) > 1
    for one in groups:
        plain, short = [f"{one} {axis}" for axis in "XYZ"], one.split(":")[-1]
        place, turns = ([f"{one} {kind}{axis}" for axis in letters] for kind, letters in (("T", "XYZ"), ("R", "XYZW")))
        if {*place, *turns[:3]} <= {*names}:
            bodies[short.rpartition(" ")[2]] = (place, [name for name in turns if name in names])
        elif {*plain} <= {*names}:
            points[one if several else short] = plain
    if not points and not bodies:
        return None
    rate = next((float(row[0]) for row in rows[1:header] if _numeric(row[:1])), None)
    above = header + (1 if _numeric(units[:1]) else 2)
    unit = next((unit for unit in units if unit in ("mm", "m", "cm")), None)
    names = padded(names, rows[above])
    return Export(names=names, above=above, rate=rate, unit=unit, points=points, bodies=bodies)


def _tracker(rows: Rows) -> Export | None:
    above = next((k for k, row in enumerate(rows[:4]) if row[0] in ("t", "frame", "step") and "x" in row), None)
    if not above or not _numeric(rows[above + 1][:1]) or not any(rows[above - 1]):
        return None
    names, track, seen = list[str](), "", dict[str, None]()
    for k, cell in enumerate(rows[above]):
        titled = rows[above - 1][k] if k < len(rows[above - 1]) else ""
        track = titled.lstrip("#%/ ") or track
        seen |= {track: None} if cell == "x" else {}
        names.append("time" if cell == "t" and "time" not in names else f"{track} {cell}")
    axes = [axis for axis in ("x", "y", "z") if axis in rows[above]]
    return Export(
        names=padded(names, rows[above + 1]),
        above=above + 1,
        points={name: [f"{name} {axis}" for axis in axes] for name in seen},
    )


def _deeplabcut(rows: Rows) -> Export | None:
    titles = {row[0]: row for row in rows[:4]}
    if not {"scorer", "bodyparts", "coords"} <= {*titles}:
        return None
    animals = titles.get("individuals", [""] * len(titles["coords"]))
    labels = [f"{animal} {part}".strip() for animal, part in zip(animals, titles["bodyparts"], strict=False)]
    names = ["frame", *(f"{one} {axis}" for one, axis in zip(labels[1:], titles["coords"][1:], strict=True))]
    points = {one: [f"{one} {axis}" for axis in _AXES if f"{one} {axis}" in names] for one in dict.fromkeys(labels[1:])}
    likely = {one: name for one in points if (name := f"{one} likelihood") in names}
    return Export(names=names, above=[row[0] for row in rows].index("coords") + 1, points=points, likelihoods=likely)


def _sleap(rows: Rows) -> Export | None:
    header = rows[0]
    points = {name[:-2]: [name, f"{name[:-2]}.y"] for name in header if name.endswith(".x")}
    if "frame_idx" not in header or not points:
        return None
    likely = {name: f"{name}.score" for name in points if f"{name}.score" in header}
    names = ["frame" if name == "frame_idx" else name for name in header]
    tracks = [*dict.fromkeys(row[0] for row in rows[1:] if row[0])] if header[0] == "track" else []
    return Export(names=names, above=1, points=points, likelihoods=likely, tracks=tracks if len(tracks) > 1 else ())


_LOGGED = re.compile(r"([^:]+): (.+?)(?: (\d+))?(?: \(([^)]*)\))?")
"""A column of Logger Pro: its set, quantity, number of the object, and unit."""


def _logger_pro(rows: Rows) -> Export | None:
    columns = [(name, _LOGGED.fullmatch(name)) for name in rows[0] if name]
    clock = next((name for name, match in columns if match and match[2] == "Time"), None)
    if clock is None or not all(match for _, match in columns) or not _numeric(rows[1]):
        return None
    places = [(name, match) for name, match in columns if match and match[2] in ("X", "Y")]
    points: dict[str, list[str]] = {}
    for name, match in places:
        points.setdefault(f"object_{match[3] or 1}:centre", []).append(name)
    units = {match[4] for _, match in places}
    if {*map(len, points.values())} != {2}:
        return None
    unit = next(iter(units)) if len(units) == 1 else None
    return Export(names=padded(rows[0], rows[1]), above=1, unit=unit or None, clock=clock, points=points)


def _ros_echo(rows: Rows) -> Export | None:
    first = rows[0]
    names = next((k for k in (1, 2) if len(first) >= 9 + k and not _numeric(first[2 : 3 + k])), 0)  # of frames
    pose = first[2 + names : 9 + names]
    whole = [re.fullmatch(r"\d{1,10}", cell) for cell in first[:2]]
    if not names or not all(whole) or not all(_numeric([cell]) for cell in pose) or not _numeric(rows[1][:2]):
        return None
    if abs(math.hypot(*map(float, pose[3:])) - 1) > _UNIT:
        return None
    stamp, place = ["header.stamp.sec", "header.stamp.nanosec"], [f"pose.position.{axis}" for axis in _AXES]
    turned = [f"pose.orientation.{axis}" for axis in "xyzw"]
    header = [*stamp, *("header.frame_id", "child_frame_id")[:names], *place, *turned]
    return Export(names=padded(header, first), above=0, unit="m", clock=stamp[0], bodies={"pose": (place, turned)})


_LAYOUTS: Sequence[Callable[[Rows], Export | None]] = (
    *(_qualisys, _vicon, _deeplabcut, _sleap, _logger_pro, _ros_echo, _tracker),
)


def _numeric(cells: Sequence[str]) -> bool:
    """Whether cells are numbers or empty, and some are numbers."""
    present = [cell for cell in cells if cell]
    return bool(present) and all(re.fullmatch(r"[-+]?(\d+[.,]?\d*|[.,]\d+)(e[-+]?\d+)?|nan", c, re.I) for c in present)


def _trimmed(cells: Sequence[str]) -> list[str]:
    """Cells without empty ones at the end."""
    return [*cells[: max((k + 1 for k, cell in enumerate(cells) if cell), default=0)]]


def padded(names: Sequence[str], row: Sequence[str]) -> list[str]:
    """Names of all cells of a row, of which the last ones may be empty."""
    return [*names, *(f"column {k}" for k in range(len(names), len(row)))]
