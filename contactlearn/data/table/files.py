"""Files of tables: text, JSON, Parquet and spreadsheets as sheets of raw cells, and frames as CSV and Parquet.

Text goes through the standard library's reader, in strict mode: it knows the line of every row, and neither pads, drops
nor guesses.  Parquet goes through pyarrow, spreadsheets through pandas; JSON has a record an impact.  Text and Parquet
come in blocks of rows, so that a file need not fit in memory.
"""

import csv
import re
import sqlite3
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from itertools import chain, islice
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zipfile import BadZipFile, ZipFile

import numpy as np

from contactlearn.core.errors import ContactLearnError, DataError, UnknownLayoutError, install_hint
from contactlearn.data.array_files import HDF5, loaded, tables_in_hdf5
from contactlearn.data.json_files import json_content
from contactlearn.data.packed import for_library, on_disk
from contactlearn.data.table.dialect import COMMENT, csv_rows, header_of, is_blank, is_numeric, numerals_of, sniffed
from contactlearn.data.table.names import are_outcomes, components_of, name_words
from contactlearn.data.table.rows import impactful, rows_joined
from contactlearn.data.table.sheet import Cells, Sheet

if TYPE_CHECKING:
    from pandas import DataFrame

_QUOTED = re.compile(r"""'([^']*)'|"([^"]*)\"""")  # the second of a name with a prime
_ROWS = re.compile(rf"\((?:(?:{_QUOTED.pattern})(?:, )?)+\)")
_UNPACKED = 2**30  # bytes of a spreadsheet when it is unpacked, at most
_SHOWN = 60  # letters of a header, in errors
_EVENTS = [(word,) for word in ("event", "type", "kind", "msg", "message", "topic", "ereignis", "typ")]
_NUMERALS = 1000  # rows, at most, in which texts show how numbers are written
_HEAD = 50  # rows of a spreadsheet in which its header is looked for


def read_text(path: Path, rows: int | None, *, gaps: bool = False) -> Iterator[Sheet]:
    """Cells of a text file with a separator; rows that are blank throughout are passed over.

    Args:
        path: the file.
        rows: in each sheet; None for one sheet of all of them.
        gaps: whether up to half of the rows may be cut short or too long; all their cells but the first are then
            empty, for which of them are whole is not known.

    Raises:
        DataError: the file is no table, has no header, or rows of another length than that.
    """
    dialect = sniffed(path)
    header, read_as = dialect.header.names, dialect.read_as()
    try:
        with dialect.opened(path) as file:
            for _ in islice(file, dialect.above):
                pass
            written = csv_rows(file, dialect.separator)
            for _ in islice(written, dialect.header.rows):
                pass
            first, numeric = 0, None
            while (block := [(dialect.above + line, row) for line, row in islice(written, rows)]) or not first:
                kept = impactful(
                    block, dialect.header, str(path), aligned=not dialect.separator.strip(" "), numeric=numeric
                )
                numeric = kept.numeric
                mostly = gaps and 2 * sum(_is_whole(row, header) for _, row in kept.rows) >= len(kept.rows)
                cells = [
                    [row[0], *[""] * (len(header) - 1)]
                    if mostly and not _is_whole(row, header)
                    else _checked(path, header, first + k, line, row)
                    for k, (line, row) in enumerate(kept.rows, 1)
                ]
                columns = ((name, [row[i] for row in cells]) for i, name in enumerate(header))
                lines = [line for line, _ in kept.rows]
                sheet = Sheet(path=path, lines=lines, first=first, numerals=dialect.numerals, read_as=read_as)
                yield sheet.with_columns(columns, *kept.read_as)
                first += len(cells)
                if not block:
                    return
    except UnicodeDecodeError:
        raise DataError(f"{path}: must be UTF-8 text throughout; save it as 'CSV UTF-8'") from None
    except csv.Error as error:
        line, why = error.args
        raise DataError(f"{path}: line {dialect.above + line} is not CSV: {why}; check its quotes") from None


def _checked(path: Path, header: Sequence[str], row: int, line: int, cells: list[str]) -> list[str]:
    """The cells of a row, which are as many as the header has; more of them may be empty."""
    if _is_whole(cells, header):
        return cells[: len(header)]
    short = (
        "a missing separator, or a truncated file? (of impacts, data.correct=[drop_incomplete] leaves such rows out)"
    )
    points = any(re.fullmatch(r"[-+]?\d*\.\d+", cell.strip()) for cell in cells)
    long = (
        "a decimal comma, another separator inside a cell, which wants quotes, or a name too few?"
        if points
        else "a decimal comma?"
    )
    hint = long if len(cells) > len(header) else short
    taken = " ".join(header)
    taken = taken if len(taken) <= _SHOWN else f"{taken[:_SHOWN]}…"
    for text, name in ((cells[0], "it"), (header[0], "the first line")):
        hint = f"is {name} a comment? remove it" if text.startswith(COMMENT) else hint
    seen = f"{len(cells)} cell{'s' if len(cells) > 1 else ''} where the header has {len(header)} ({taken!r}); {hint}"
    raise DataError(f"{path}: row {row} (line {line}) has {seen}", row=row)


def _is_whole(cells: Sequence[str], header: Sequence[str]) -> bool:
    return len(cells) >= len(header) and not any(map(str.strip, cells[len(header) :]))


def read_parquet(path: Path, rows: int | None) -> Iterator[Sheet]:
    """Cells of a Parquet file, in sheets of `rows` or in one; its page checksums are verified where it has them.

    Raises:
        DataError: the file is not Parquet, or damaged.
    """
    from pyarrow import parquet

    first = 0
    try:
        # Not read_table: that one also makes columns out of folder names such as mass=1.  A buffer would keep the file.
        with parquet.ParquetFile(for_library(path), page_checksum_verification=True, pre_buffer=False) as file:
            whole = rows is None or file.metadata.num_rows <= rows
            for block in [file.read()] if whole else file.iter_batches(rows):
                columns = zip(map(_joined, block.schema.names), map(_cells, block.columns), strict=True)
                yield Sheet(path=path, first=first).with_columns(columns)
                first += len(block)
    except DataError:
        raise
    except Exception as error:  # a damaged file can break the library anywhere
        raise DataError(f"{path}: is not a readable Parquet file ({error}); write or copy it again") from error


def _joined(name: str) -> str:
    """A name in several rows, which pandas writes as ('pre', 'vx [m/s]'), as `sheet_of` joins it."""
    return " ".join(map("".join, _QUOTED.findall(name))).strip() if _ROWS.fullmatch(name) else name


def _cells(column: Any) -> Cells:
    """The cells of an Arrow column."""
    from pyarrow import types

    if (types.is_floating(column.type) or types.is_integer(column.type)) and not column.null_count:
        return column.to_numpy()
    return column.to_pylist()


def read_spreadsheet(path: Path, rows: int | None) -> Iterator[Sheet]:
    """Cells of the only worksheet of an .xlsx or .ods file that has numbers; formulas are what was saved of them.

    Raises:
        DataError: the file is damaged, or has no or several such worksheets.
        ContactLearnError: the library that reads it is not installed.
    """
    import pandas as pd

    del rows  # a spreadsheet is read as a whole
    engine = {".xlsx": "openpyxl", ".ods": "odf"}[path.suffix.lower()]
    try:
        with ZipFile(for_library(path)) as packed:
            unpacked = sum(entry.file_size for entry in packed.infolist())
        if unpacked > _UNPACKED:
            raise DataError(f"{path}: takes {unpacked / 2**30:.1f} GiB unpacked; export it as CSV")
        frames = pd.read_excel(
            for_library(path), sheet_name=None, header=None, dtype=object, engine=engine, na_filter=False
        )
    except (DataError, OSError):
        raise
    except ImportError:
        suffix = path.suffix.lower()
        raise ContactLearnError(f"{path}: {suffix} needs {install_hint('spreadsheets')}; or export it as CSV") from None
    except BadZipFile as error:
        raise DataError(f"{path}: is no spreadsheet ({error}); export it as CSV") from None
    except Exception as error:  # a damaged file can break the library anywhere
        raise DataError(f"{path}: is not a readable spreadsheet ({error}); export it as CSV") from error
    sheets = {name: frame for name, frame in frames.items() if len(frame) > 1 and len(frame.columns) > 1}
    tables = {name: one for name, one in sheets.items() if any(is_numeric(row) for row in one.values.tolist()[:_HEAD])}
    if len(tables) > 1:
        tables = {name: one for name, one in tables.items() if _of_impacts(one)} or tables
    if len(tables) != 1 and (found := _stacked_sheets(path, tables) or _joined_sheets(path, tables or sheets)):
        yield found
        return
    if len(tables) != 1:
        names = ", ".join(map(repr, tables))
        seen = f"has tables of numbers in its worksheets {names}: export" if tables else "has no table of numbers; keep"
        raise DataError(f"{path}: {seen} that of the impacts as a file of its own")
    ((name, frame),) = tables.items()
    said = (f"worksheet {name}",) if len(frames) > 1 else ()
    yield _of_worksheet(path, frame, said)


def _of_worksheet(path: Path, frame: "DataFrame", said: tuple[str, ...] = ()) -> Sheet:
    """The cells of a worksheet."""
    cells = [(line, row) for line, row in enumerate(frame.values.tolist(), 1) if not all(map(is_blank, row))]
    top = header_of([row for _, row in cells[:_HEAD]], str(path))
    body = impactful(cells[top.rows :], top, str(path))
    columns = (
        (name, [None if is_blank(row[i]) else row[i] for _, row in body.rows]) for i, name in enumerate(top.names)
    )
    numerals = numerals_of(str(path), [row for _, row in body.rows[:_NUMERALS]])
    said = (*said, *top.read_as, *body.read_as, *(["decimal commas"] if numerals.decimal == "," else []))
    return Sheet(path=path, lines=[line for line, _ in body.rows], numerals=numerals).with_columns(columns, *said)


def _stacked_sheets(path: Path, tables: Mapping[str, "DataFrame"]) -> Sheet | None:
    """The rows of several worksheets with one header, and the names of these in a column, as of recordings."""
    sheets = {name: _of_worksheet(path, frame) for name, frame in tables.items()}
    first = next(iter(sheets.values()), None)
    if first is None or len(sheets) < 2 or any(one.header != first.header for one in sheets.values()):
        return None
    names = [name for name, one in sheets.items() for _ in range(len(one))]
    columns = ((name, [cell for one in sheets.values() for cell in one.columns[name]]) for name in first.columns)
    word = "session" if are_outcomes(first.header) else "recording"
    said = f"{len(sheets)} worksheets with one header, their names in the column {word!r}; save one as CSV for it alone"
    return replace(first, lines=None, read_as=()).with_columns([(word, names), *columns], said)


def _joined_sheets(path: Path, tables: Mapping[str, "DataFrame"]) -> Sheet | None:
    """The cells of several worksheets that a column of each joins."""
    by_name = dict[str, list[dict[str, Any]]]()
    for name, frame in tables.items():
        cells = [row for row in frame.values.tolist() if not all(map(is_blank, row))]
        top = header_of(cells[:_HEAD], str(path))
        by_name[name] = [dict(zip(top.names, row, strict=False)) for row in cells[top.rows :]]
    if (found := rows_joined(by_name)) is None or not are_outcomes([*found[0][0]]):
        return None
    rows, said = found
    columns = ((name, [None if is_blank(row[name]) else row[name] for row in rows]) for name in rows[0])
    return _of_values(path, columns, said)


def _of_values(path: Path | str, columns: Iterable[tuple[str, Cells]], *said: str) -> Sheet:
    """The sheet of cells that are numbers or text, of which the first rows show how numbers are written."""
    cells = Sheet(path=path).with_columns(columns, *said)
    texts = (column[:_NUMERALS] for column in cells.columns.values() if isinstance(column, list))
    return replace(cells, numerals=numerals_of(str(path), [*zip(*texts, strict=True)]))


def read_json(path: Path, rows: int | None) -> Iterator[Sheet]:
    """Cells of a JSON file: a list of records, a record a line, or lists by name; nested records have dotted names.

    Raises:
        DataError: the file is not JSON, or holds something else.
    """
    del rows  # JSON is read as a whole
    content = json_content(path, most=_UNPACKED)
    records = [*map(_flat, _records(path, content))]
    records, read_as = _of_one_event(records)
    header = [*dict.fromkeys(name for record in records for name in record)]
    if not header:
        raise DataError(f"{path}: its records are empty")
    yield _of_values(path, ((name, [record.get(name) for record in records]) for name in header), *read_as)


def _of_one_event(records: list[dict[str, Any]]) -> tuple[list[dict[str, Any]], tuple[str, ...]]:
    """The records of the one event of a log that has velocities after contact; all of another file."""
    for name in dict.fromkeys(name for record in records for name in record if name_words(name)[-1:] in _EVENTS):
        kinds = {str(record.get(name)): record for record in reversed(records)}
        sizes = {
            kind: {one: np.zeros((2, max(np.size(value), 1))) for one, value in record.items()}
            for kind, record in kinds.items()
        }
        hits = [kind for kind, arrays in sizes.items() if _has_outcomes(arrays)]
        if len(hits) == 1 and len(kinds) > 1:
            kept = [record for record in records if str(record.get(name)) == hits[0]]
            return kept, (f"events {name}={hits[0]!r} alone, {len(records) - len(kept)} others left out",)
    return records, ()


def _records(path: Path, content: Any) -> Sequence[Mapping[str, Any]]:
    """The records of a JSON file: a list of them, alone or under one name, or a list or records of cells by name."""
    if isinstance(content, dict) and {"columns", "data"} <= {*content}:  # of pandas: orient="split"
        return [dict(zip(content["columns"], row, strict=False)) for row in content["data"]]
    lists = [value for value in content.values() if isinstance(value, list)] if isinstance(content, dict) else [content]
    of_records = [one for one in lists if isinstance(one, list) and one and all(isinstance(row, dict) for row in one)]
    if len(of_records) == 1:
        about = content if isinstance(content, dict) else {}  # single numbers hold for all, such as the mass
        plain = {name: one for name, one in about.items() if isinstance(one, int | float)}
        return [{**plain, **row} for row in of_records[0]]
    if isinstance(content, dict) and len(of_records) > 1:
        parts = {str(name): one for name, one in content.items() if one in of_records}
        if found := rows_joined({name: [*map(_flat, rows)] for name, rows in parts.items()}):
            return found[0]
        raise DataError(
            f"{path}: has lists of records {', '.join(parts)}, and no column with the same values in each, such as the "
            "number of the trial, by which they belong together; write a record an impact"
        )
    if isinstance(content, dict) and content:
        columns = [*content.values()]
        if all(isinstance(one, dict) and one.keys() == columns[0].keys() for one in columns):  # orient="columns"
            return [{name: cells[key] for name, cells in content.items()} for key in columns[0]]
        if len(lists) == len(content) and len({*map(len, lists)}) == 1:
            return [dict(zip(content, row, strict=True)) for row in zip(*lists, strict=True)]
    raise DataError(
        f"{path}: holds no list of records; write a record an impact, such as "
        '{"x": 0.1, …, "vx": 1.2, …, "vx_post": 0.8, …}, in a list or one a line, or a CSV (docs/tables.md)'
    )


def _flat(record: Mapping[str, Any]) -> dict[str, Any]:
    """A record with the values of the records in it, under names such as `before.linear`."""
    found = dict[str, Any]()
    for name, value in record.items():
        if isinstance(value, dict):
            found |= {f"{name}.{inner}": one for inner, one in _flat(value).items()}
        else:
            found[str(name)] = value
    return found


def read_database(path: Path, rows: int | None) -> Iterator[Sheet]:
    """Cells of the only table of SQLite, or the only one with velocities after contact.

    Views are left out: one of a stranger's need not end.

    Raises:
        DataError: the file is no database, too large, or has no or several such tables.
    """
    del rows  # a database is read as a whole
    if on_disk(path).stat().st_size > _UNPACKED:
        raise DataError(f"{path}: has more than {_UNPACKED / 2**30:.0f} GiB; export its table as Parquet or CSV")
    tables = dict[str, dict[str, Cells]]()
    try:
        with closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)) as base:
            names = base.execute("SELECT name FROM sqlite_master WHERE type = 'table'").fetchall()
            for (name,) in names:
                found = base.execute('SELECT * FROM "{}"'.format(name.replace('"', '""')))
                header, content = [column[0] for column in found.description], found.fetchall()
                tables[name] = {column: [row[k] for row in content] for k, column in enumerate(header)}
    except sqlite3.Error as error:
        raise DataError(f"{path}: is no readable database of SQLite ({error}); export its table as CSV") from None
    of_impacts = {name: one for name, one in tables.items() if are_outcomes([*one])} or tables
    if len(of_impacts) != 1:
        seen = ", ".join(map(repr, of_impacts)) or "none"
        raise DataError(f"{path}: has several tables, {seen}: export that of the impacts as CSV")
    ((name, columns),) = of_impacts.items()
    yield _of_values(path, columns.items(), *[f"table {name}"] * (len(tables) > 1))


def read_arrays(path: Path, rows: int | None) -> Iterator[Sheet]:
    """Cells of arrays of MATLAB (.mat), NumPy (.npz) or HDF5, a row or a column an impact; single numbers hold for all.

    Those of a structure or a group are taken that have velocities after contact.

    Raises:
        DataError: the file cannot be read, or its arrays are not of one length.
        UnknownLayoutError: an array has as many components as impacts.
        ContactLearnError: the library that reads the format is not installed.
    """
    del rows  # arrays are read as a whole
    try:
        content = tables_in_hdf5(path) if path.suffix.lower() in HDF5 else loaded(path)
    except (ContactLearnError, OSError):
        raise
    except Exception as error:  # a damaged file can break the library anywhere
        raise DataError(f"{path}: is no readable file of arrays ({error}); export it as CSV") from error
    groups = [*_groups(content, "")] if isinstance(content, Mapping) else []
    own = {name: {key: one for key, one in arrays.items() if "." not in key} for name, arrays in groups}
    # Arrays of a group in it count only where no group has outcomes of its own.
    whole = {name for name, one in own.items() if _has_outcomes(one)} or {
        name for name, one in groups if _has_outcomes(one)
    }
    of_impacts = {
        name: arrays
        for name, arrays in groups
        if name in whole and not any(name.startswith(f"{above}/") for above in whole)
    }
    if len(of_impacts) > 1:
        names = ", ".join(name.strip("/") for name in of_impacts)
        raise DataError(f"{path}: has several tables of impacts, {names}: export each as a file of its own")
    arrays = next(iter(of_impacts.values()), groups[-1][1] if groups else {})
    lengths = Counter(max(one.shape) for one in arrays.values() if one.size > 1)
    size = max(lengths, key=lambda length: (lengths[length], length), default=0)
    columns, turned = dict[str, Cells](), list[str]()
    for name, one in arrays.items():
        if of_impacts and one.shape == (size, size) and size > 1:
            raise UnknownLayoutError(
                f"{path}: {name!r} is {size} × {size}: its impacts may be rows or columns; write columns of their own, "
                "such as vx, vy, omega, or a CSV"
            )
        if one.size == 1:
            columns[name] = [one.item()] * size
        elif size in one.shape:
            table = one if one.shape[0] == size else one.T
            turned += [name] * (table is not one and min(one.shape) > 1)
            columns[name] = table.reshape(size).astype(float) if table.size == size else table.tolist()
    if not columns or lengths[size] < 2:
        seen = ", ".join(map(str, content)) if isinstance(content, Mapping) else "one array"
        raise DataError(
            f"{path}: is no table of impacts, which is arrays of one length, a row an impact; it has {seen}; export it "
            "as CSV with a column for each component, such as vx, vy, omega, vx_post, vy_post, omega_post"
        )
    said = [f"a column an impact in {', '.join(map(repr, turned))}"] * bool(turned)
    yield Sheet(path=path).with_columns(((name, _without_gaps(one)) for name, one in columns.items()), *said)


def _groups(content: Mapping[str, Any], name: str) -> Iterator[tuple[str, dict[str, np.ndarray]]]:
    """Arrays of numbers by dotted names, of a file and of each group in it, from the outermost on."""
    content = {key: _by_name(one) for key, one in content.items()}
    flat = {key: np.asarray(one) for key, one in _flat(content).items()}
    yield name, {key: one for key, one in flat.items() if one.dtype.kind in "fiu" and one.ndim < 3}
    for key, one in content.items():
        if isinstance(one, Mapping):
            yield from _groups(one, f"{name}/{key}")


def _by_name(one: Any) -> Any:
    """The arrays of a list of structures of numbers, an impact each, as MATLAB has them; other things as they are."""
    listed = isinstance(one, list) or (isinstance(one, np.ndarray) and one.dtype.kind == "O" and one.ndim)
    if not listed or not len(one) or not all(isinstance(each, dict) for each in one):
        return one
    records = [*map(_flat, one)]
    shapes = {key: {np.shape(record.get(key, [])) for record in records} for key in records[0]}
    return {key: np.asarray([record[key] for record in records]) for key, found in shapes.items() if len(found) == 1}


def _has_outcomes(arrays: Mapping[str, np.ndarray]) -> bool:
    """Whether arrays have velocities after contact."""
    sizes = {name: min(one.shape) if one.ndim == 2 else 1 for name, one in arrays.items() if one.size > 1}
    vectors = components_of(sizes, opposite=any("out" in name_words(name) for name in sizes))
    names = [*arrays, *chain.from_iterable(vectors.values())]
    return are_outcomes(names)


def _without_gaps(column: Cells) -> Cells:
    """A column in which a number that is missing is an empty cell."""
    if isinstance(column, list) or np.isfinite(column).all():
        return column
    return [value if np.isfinite(value) else None for value in column.tolist()]


def _of_impacts(frame: "DataFrame") -> bool:
    """Whether a worksheet, and not one of means or of parameters, has velocities after contact."""
    try:
        top = header_of([row for row in frame.values.tolist()[:_HEAD] if not all(map(is_blank, row))], "")
    except DataError:
        return False
    return are_outcomes(top.names)


def sheet_of(frame: "DataFrame") -> Sheet:
    """Return the cells of a DataFrame; names in several rows are joined.

    A named index is a column, too, unless there is a column of that name, as `set_index(…, drop=False)` leaves it.

    Raises:
        DataError: something else than a DataFrame, or one without rows.
    """
    from pandas import DataFrame  # takes long to load

    if not isinstance(frame, DataFrame):
        raise DataError(f"a table is the path of a file, such as drops.csv, or a DataFrame; got {type(frame).__name__}")
    if not len(frame):
        raise DataError("DataFrame: has no rows; at least one is needed")
    levels = [name for name in frame.index.names if name not in frame.columns] if all(frame.index.names) else []
    named = frame.reset_index(level=levels) if levels else frame
    columns = list[tuple[str, Cells]]()
    for name, values in named.items():
        plain = values.dtype.kind in "fiu" and not values.hasnans
        cells = values.to_numpy() if plain else values.astype(object).where(values.notna(), None).tolist()
        columns.append((" ".join(map(str, name)).strip() if isinstance(name, tuple) else str(name), cells))
    return _of_values("DataFrame", columns)


def write_csv(frames: Iterable["DataFrame"], path: Path) -> None:
    """Write frames one below the other to a new CSV file; a float is written as its repr, which reads back exactly."""
    for place, frame in enumerate(frames):
        frame.to_csv(path, index=False, header=not place, mode="a", lineterminator="\r\n")  # quotes \r in names


def write_parquet(frames: Iterable["DataFrame"], path: Path) -> None:
    """Write frames, of which there is at least one, as row groups of a Parquet file with page checksums."""
    import pyarrow
    from pyarrow import parquet

    tables = (pyarrow.Table.from_pandas(frame, preserve_index=False) for frame in frames)
    first = next(tables)
    with parquet.ParquetWriter(path, first.schema, write_page_checksum=True) as file:
        for table in chain((first,), tables):
            file.write_table(table)
