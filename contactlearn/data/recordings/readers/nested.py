"""JSON, text with a title above each recording, and odd tables: frames which `columns` reads.

frames       [{"time": 0, "x": 0.1, "position": [..], "pose": {"x": ..}}, ..], or such a line each (JSON Lines)
columns      {"time": [..], "x": [..], "position": [[..], ..]}
recordings   a list of these, or an object of these by name; beside them a rate ("fps")
titles       run 1, # toss 3, [drop 4]: a line above the frames of each recording, with names of columns or without;
             or the same comment above each, as Kinovea writes it
long         _time, _field, _value: a row a number, as databases and pandas' melt write it
vectors      [0.1, 0.2], (1 2 3), Quaternion{Float64}(1.0, 0.0, 0.0, 0.0): several numbers in a cell
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from io import StringIO
from pathlib import Path
from statistics import mode
from typing import Any

import pandas as pd
from pandas.api.types import is_numeric_dtype

from contactlearn.core.errors import DataError
from contactlearn.data.json_files import json_content
from contactlearn.data.packed import opened_text, size_of
from contactlearn.data.recordings.readers import COMMENT, RECORDED, TITLE, TUM_COLUMNS, has_titles
from contactlearn.data.table.names import name_words
from contactlearn.data.table.reshaped import VALUES, numbers_in
from contactlearn.data.table.sheet import Sheet

_LARGEST = 2**28  # bytes of a file that is in memory as a whole
_MOST = 9  # numbers of a frame's list; a longer one holds a number a frame
_SNIFFED = 10  # rows in which the decimal mark is looked for
_PLACES = ("position", "pos", "p", "xyz", "translation", "tvec", "location", "loc", "centre", "center", "com", "point")
_PLACES = (*_PLACES, "pose_t", "trans", "origin")
_RATES = ("fps", "rate", "frame_rate", "framerate", "frequency")
_TIMES = ("time", "t", "timestamp", "stamp")
_QUATERNION = ["qw", "qx", "qy", "qz"]  # of Julia's and Eigen's types, the scalar first
_VARIABLES = [(word,) for word in ("variable", "field", "quantity", "channel", "parameter", "signal", "metric", "axis",
              "component", "coordinate", "key", "name", "größe", "messgröße", "grandeur")]  # fmt: skip
_TUM = "time x y z qx qy qz qw"


def titled(path: Path) -> pd.DataFrame | None:
    """Return the frames of a text in which a title stands above each recording; None of another file.

    Raises:
        DataError: no line names the columns, or the file is too large.
    """
    if not has_titles(path):
        return None
    if size_of(path) > _LARGEST:
        raise DataError(f"{path}: is larger than {_LARGEST >> 20} MiB: split it")
    with opened_text(path, encoding="utf-8-sig") as file:
        lines = [line.strip() for line in file.read().splitlines() if line.strip()]
    header, remark, name, pages, rows, names = "", "", "", 0, list[str](), list[str]()
    above = lines[0] if lines[0].startswith(COMMENT) and lines.count(lines[0]) > 1 else None
    for line in lines:
        numbers = re.match(r"[-+.]?\d", line) is not None
        if match := TITLE.fullmatch(line):
            name = match[1]
        elif line == above:
            pages += 1
            name = str(pages)
        elif line.startswith(COMMENT):
            remark = line.lstrip("#%/ ") or remark
        elif not header and numbers:
            count = len(line.split())
            header = remark if len(remark.split()) == count or "," in line else _TUM if count == TUM_COLUMNS else ""
        if numbers:
            rows.append(line)
            names.append(name)
        elif not match and not line.startswith(COMMENT):
            header = header or line
            if line != header:
                raise DataError(f"{path}: columns of recording {name} are {line!r}, those before {header!r}; split it")
    mark = next((one for one in ";\t," if one in header), None)
    if not header or not rows:
        raise DataError(f"{path}: has titles such as {lines[0]!r}, and no line that names the columns")
    separator = mark or (r"\s+" if len(header.split()) == len(rows[0].split()) else r"\s{2,}")
    decimal = "," if mark != "," and any(re.search(r"\d,\d", row) for row in rows[:_SNIFFED]) else "."
    text = StringIO("\n".join((header, *rows)))
    table = pd.read_csv(text, sep=separator, decimal=decimal, skipinitialspace=True, index_col=False, engine="python")
    return table.assign(recording=names)


def json_table(path: Path) -> pd.DataFrame:
    """Return the frames of all recordings of a JSON file.

    Raises:
        DataError: it is no JSON, or holds no frames.
    """
    content = json_content(path, most=_LARGEST)
    parts = [*_recordings(content, "")]
    if not parts:
        first = content[0] if isinstance(content, list) and content else content
        seen = f" (it has {', '.join(map(str, first))})" if isinstance(first, dict) else ""
        raise DataError(
            f"{path}: holds neither frames nor impacts; of JSON are read a list of frames "
            '[{"time": 0, "x": 0.1, "y": 0.2, "theta": 0.3}, …], lists by name {"time": […], "x": […], …}, and a list '
            'or an object of such recordings; and a list of impacts [{"vx": 0.1, …, "vx_post": 0.2}, …]'
            f"{seen}"
        )
    return parts[0][1] if len(parts) == 1 else pd.concat([table.assign(recording=name) for name, table in parts])


def frame_of(cells: Sheet) -> pd.DataFrame:
    """Return the rows of a table, with numbers where a column has nothing else."""
    columns = dict[str, Any]()
    for name, column in cells.columns.items():
        try:
            columns[name] = replace(cells, gaps=True).numbers(name, "")
        except DataError:
            columns[name] = column
    return pd.DataFrame(columns)


def is_folded(frames: pd.DataFrame) -> bool:
    """Return whether the first rows may have a number each, which is `unfolded`'s to decide, or several in a cell."""
    valued = any(VALUES.intersection(name_words(str(name))) for name in frames)
    worded = not all(map(is_numeric_dtype, frames.dtypes))
    return (valued and worded) or any(_are_vectors(frames[name]) for name in frames)


def unfolded(frames: pd.DataFrame) -> pd.DataFrame:
    """Return a row a frame, and a column a number, of a table that has them otherwise."""
    if found := _variable(frames):
        variable, value = found
        groups = [part for _, part in frames.groupby(variable, sort=False)]
        once = [  # those that are the same for each quantity
            name for name in frames.columns.difference([variable, value], sort=False)
            if frames[name].notna().all() and len({frozenset(part[name]) for part in groups}) == 1
        ]  # fmt: skip
        if once and not frames.duplicated([*once, variable]).any():
            wide = frames.pivot(index=once, columns=variable, values=value).reset_index()
            frames = frames[once].drop_duplicates().merge(wide, on=once, sort=False)
    for name in [name for name in frames if _are_vectors(frames[name])]:
        parts = [numbers_in(cell, ".") or [] for cell in frames[name]]
        size = mode(map(len, filter(None, parts)))
        names = (
            _QUATERNION
            if size == 4 and str(frames[name].iloc[0]).startswith("Quat")
            else [*_flat({name: [0.0] * size})]
        )
        numbers = pd.DataFrame([part if len(part) == size else [None] * size for part in parts], frames.index, names)
        others = frames.drop(columns=name)
        numbers = numbers.rename(columns={one: f"{one} of {name}" for one in numbers if one in others})
        frames = pd.concat([others, numbers.apply(pd.to_numeric, errors="coerce")], axis=1)
    return frames


def _variable(frames: pd.DataFrame) -> tuple[str, str] | None:
    """The column of names of quantities and that of their values, of a table that has a row a number."""
    value = [name for name in frames if VALUES.intersection(name_words(str(name))) and frames[name].dtype.kind in "fi"]
    for name in frames if len(value) == 1 else ():
        if not is_numeric_dtype(frames[name]) and 1 < frames[name].nunique() <= len(frames) / 2:
            known = {str(one).lower() for one in frames[name].unique()}
            if name_words(str(name))[-1:] in _VARIABLES or len({"x", "y", "z"} & known) > 1:
                return str(name), str(value[0])
    return None


def _are_vectors(column: pd.Series) -> bool:
    """Whether the first cell that is not empty has several numbers."""
    filled = column.dropna() if not is_numeric_dtype(column) else column[:0]
    return len(numbers_in(filled.iloc[0], ".") or []) > 1 if len(filled) else False


def _recordings(content: Any, name: str) -> Iterator[tuple[str, pd.DataFrame]]:
    """Each recording by its name."""
    if isinstance(content, list) and (frames := _plain(content)):
        yield name, pd.DataFrame(frames)
    elif isinstance(content, list):
        for number, part in enumerate(content):
            own = [part[key] for key in ("name", "id", *RECORDED) if key in part] if isinstance(part, dict) else []
            plain = [str(one) for one in own if isinstance(one, str | int)]
            yield from _recordings(part, plain[0] if plain else f"{number:04d}")
    elif isinstance(content, dict):
        columns = {key: one for key, one in _flat(content).items() if isinstance(one, list) and len(one) > _MOST}
        alone = not {*columns}.isdisjoint(content) and not any(
            isinstance(one, dict) for values in columns.values() for one in values
        )
        if alone and len({*map(len, columns.values())}) == 1:
            frames = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
            yield name, _timed(pd.DataFrame([_flat(frame) for frame in frames]), content)
            return
        inner = {key: one for key, one in content.items() if isinstance(one, list | dict)}
        for key, part in inner.items():
            for own, table in _recordings(part, name if len(inner) == 1 and name else key):
                yield own, _timed(table, content)


def _timed(table: pd.DataFrame, about: Mapping[str, Any]) -> pd.DataFrame:
    """Frames with times by the rate that is stated beside them."""
    rate = next((about[key] for key in _RATES if isinstance(about.get(key), int | float) and about[key] > 0), None)
    timed = {*_TIMES} & {str(name).lower() for name in table.columns}
    return table if rate is None or timed else table.assign(time=[k / rate for k in range(len(table))])


def _plain(frames: Sequence[Any]) -> list[dict[str, Any]]:
    """The numbers and texts of frames, without lists such as the tags that were seen; none of anything else."""
    if not frames or not all(isinstance(frame, dict) and frame for frame in frames):
        return []
    ragged = {
        name for name in frames[0]
        if len({len(frame[name]) for frame in frames if isinstance(frame.get(name), list)}) > 1
    }  # fmt: skip
    flat = [_flat({name: one for name, one in frame.items() if name not in ragged}) for frame in frames]
    values = [one for frame in flat for one in frame.values()]
    nested = any(isinstance(one, list | dict) for one in values)
    return [] if nested or not any(isinstance(one, int | float) for one in values) else flat


def _matrix(one: Any) -> list[list[float]] | None:
    """The rows of a matrix of 3 × 3, 3 × 4 or 4 × 4 numbers; None of anything else."""
    if not isinstance(one, list) or len(one) not in (3, 4) or not all(isinstance(row, list) for row in one):
        return None
    widths = {len(row) for row in one}
    plain = all(isinstance(number, int | float | None) for row in one for number in row)
    return one if plain and widths <= {3, 4} and len(widths) == 1 and (len(one), *widths) != (4, 3) else None


def _flat(content: Mapping[str, Any], above: str = "") -> dict[str, Any]:
    """Values by name, such as pose.x; a list of a few numbers has a name each, such as x, y and z of a position."""
    flat: dict[str, Any] = {}
    for key, one in content.items():
        name = f"{above}{key}"
        if isinstance(one, dict):
            flat |= _flat(one, f"{name}.")
        elif (rows := _matrix(one)) is not None:  # of a rotation, or of a motion with the position in its last column
            flat |= {f"r{i}{j}": rows[i - 1][j - 1] for i in (1, 2, 3) for j in (1, 2, 3)}
            flat |= {axis: row[3] for axis, row in zip("xyz", rows, strict=False) if len(row) > 3}
        elif isinstance(one, list) and 1 < len(one) <= _MOST and all(isinstance(n, int | float | None) for n in one):
            axes = "xyz" if len(one) in (2, 3) else [f".{k}" for k in range(len(one))]
            start = "" if len(one) < 4 and str(key).lower() in _PLACES else f"{name}_" if len(one) < 4 else name
            flat |= {f"{start}{axis}": number for axis, number in zip(axes, one, strict=False)}
        else:
            flat[name] = one
    return flat
