"""How a text file writes a table: its encoding, separator and decimal mark, and where the header stands.

All is read off the first rows.  What they leave open, such as 1,234 in every cell, is refused with both readings.
"""

import codecs
import csv
import io
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice, zip_longest
from pathlib import Path
from typing import Any, TextIO
from unicodedata import normalize

from contactlearn.core.errors import DataError
from contactlearn.data.packed import opened_bytes, opened_text, size_of
from contactlearn.data.table.comments import with_units
from contactlearn.data.table.markup import tab_separated, tables_in
from contactlearn.data.table.names import (
    SURFACES,
    are_outcomes,
    impact_vocabulary,
    is_unit,
    name_words,
    recognise,
    time_of,
)
from contactlearn.mechanics.space import BOTH

COMMENT = ("#", "%", "//", "!")
_LABVIEW = "***End_of_Header***"
_SAMPLE, _ROW = 1 << 20, 1 << 10  # bytes of a file that are looked at, and of a row, at most
_LARGEST_MARKUP = 2**26  # bytes of a text that is marked up
_ROWS = 1000  # of these, at most
_MIN_SHARE = 0.9  # of the numbers among cells, which those with one blank in names of bodies lessen
_MOST_BELOW = 3  # rows of text between names and numbers: units, comments, longer names
_MIN_GROUPS = 3  # numbers of a column that have groups of thousands, where nothing else tells them from decimals
_SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars", " ": "spaces"}
WIDE = "  "
"""The separator of columns that two or more blanks part, so that one blank is a part of a cell."""
_BLANKS = re.compile(r"[ \t]*(?:\t| {2})[ \t]*")
_ENCODINGS = {"cp1252": "Windows-1252", "cp1251": "Windows-1251", "cp932": "Shift-JIS"}
"""Names of encodings that are no Unicode."""
_BYTE_ORDER_MARKS = {codecs.BOM_UTF8: "utf-8-sig", codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16"}
_ERRORS = ("div/0", "value", "ref", "num", "null", "bezug", "zahl", "wert", "valeur")
MISSING = frozenset(
    ("nan", "na", "n/a", "n.a.", "<na>", "null", "none", "missing", "-", "--", "---", "–", "—", "nd", "n.d.", "n/d",
     "s/d", "k.a.", "k. a.", "n.v.", "b.d.", "brak", "fehlt", "manquant", "缺失", "欠測",
     "#n/a", "#na", "#nv", "#name?", *(f"#{error}!" for error in _ERRORS))
)  # fmt: skip
"""How instruments and spreadsheets write a number that is missing, in small letters."""
_GROUPS = re.compile(
    r"[-+]?\d{1,3}(?:(?P<mark>[ '’.,])\d{3})(?:(?P=mark)\d{3})*(?:(?!(?P=mark))[.,]\d*)?(?:[eE][-+]?\d+)?"
)
_NUMBER = re.compile(r"[-+]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eEdD][-+]?\d+)?")
_NUMBERED = re.compile(r"[\W_]*\d")  # a cell that begins with a number, as that of a measurement does
_FORTRAN = re.compile(r"(?<=[\d.,])[dD](?=[-+]?\d+$)")
_BLANK = dict.fromkeys(map(ord, "\u00a0\u2009\u202f"), " ")
_SPACES = _BLANK | dict.fromkeys((0x2212, 0x2013, 0xFF0D), "-")
_STARS = " *\t\r\n\f\v\u00a0"  # a number that is too long for its field in Fortran is stars
_GLUED = re.compile(r"(?<=[\d.])(?=\*{4})|(?<=\*{4})(?=[-+\d.])")  # fields of Fortran, which are as wide as numbers
_MARK = re.compile(r"[Cc*](?=\s)")
_MARKS = re.compile(r"(?<=[\d.,])\s*[*†‡§¶#ªº¹²³ᵃᵇᶜ]+$")
_ERROR = re.compile(r"\s*(?:±|\+/?-)\s*[\d.,]+(?=\D*$)|(?<=\d)\(\d+\)(?=\D*$)")
_POWER = re.compile(r"\s*[×x·*]\s*10\s*(?:(?:\^|\*\*)\s*([-+]?\d+)|([⁻⁺]?[⁰¹²³⁴⁵⁶⁷⁸⁹]+))(?=\D*$)")
_QUANTITY = re.compile(r"(?P<number>[-+]?[\d.,]*\d[.,]?)\s*(?P<unit>[^\d\s.,+\-±(].*)")
_INCHES = re.compile(r"(?<=[\d.,])\s*(?:[\"″”]|'')$")
_UNIT_AT_END = re.compile(r"\s*[\[(][^\])]*[\])]$")
_UNIT_AFTER = re.compile(r"(?P<number>.*[\d.,])\s*(?P<unit>(?:[^\W\d]|°).*)")


def is_missing(cell: Any) -> bool:
    """Return whether a cell is empty, or says that its number is missing; other text is a mistake."""
    return cell is None or (isinstance(cell, str) and (not cell.strip(_STARS) or cell.strip().lower() in MISSING))


@dataclass(frozen=True, kw_only=True)
class Written:
    """A number as it stands in a cell, its unit there, and in words what else stood beside it."""

    number: str
    unit: str
    beside: tuple[str, ...]


def written_in(text: str) -> Written | None:
    """Return the number in a cell with a unit, an error, a mark of a footnote or a power of ten; None without one."""
    plain, unit, beside = _INCHES.sub(" in", text.strip().translate(_SPACES)), "", list[str]()
    plain = _POWER.sub(lambda power: "e" + normalize("NFKC", power[1] or power[2]).replace("\u2212", "-"), plain)
    for rule, said in ((_MARKS, "marks of footnotes"), (_ERROR, "errors (±)")):
        if (shorter := rule.sub("", plain)) != plain:
            plain = shorter
            beside.append(said)
    if not is_numeral(plain) and (parts := _UNIT_AFTER.fullmatch(plain)) and is_unit(parts["unit"]):
        plain, unit = parts["number"], parts["unit"].strip()
    return Written(number=plain, unit=unit, beside=tuple(beside)) if is_numeral(plain) else None


def with_one_unit(cells: Iterable[Any]) -> tuple[list[Any], str] | None:
    """Return the numbers of a column all of whose cells have a number and one unit, whatever it is, and the unit."""
    numbers, units = list[Any](), set[str]()
    for cell in cells:
        parts = _QUANTITY.fullmatch(cell.strip().translate(_SPACES)) if isinstance(cell, str) else None
        if (parts is None and not is_missing(cell)) or is_numeral(cell):  # 3.2e-05 is no 3.2 in e-05
            return None
        numbers.append(parts["number"] if parts else None)
        units |= {parts["unit"].strip()} if parts else set()
    return (numbers, units.pop()) if len(units) == 1 else None


@dataclass(frozen=True, kw_only=True)
class Numerals:
    """How numbers are written.

    Args:
        decimal: the mark before the decimals.
        grouped: whether the other mark, or a space, groups thousands in this file.
    """

    decimal: str = "."
    grouped: bool = False

    def plain(self, text: str) -> str:
        """Return a number as Python writes it.

        Raises:
            ValueError: the number has two readings, as the message says.
        """
        text = _FORTRAN.sub("e", text.strip().translate(_SPACES))
        other = "." if self.decimal == "," else ","
        groups = _GROUPS.fullmatch(text)
        if groups and (mark := groups["mark"]) != self.decimal and (mark in " '’" or text.count(mark) > 1):
            text = text.replace(mark, "")  # which cannot be a decimal mark
        elif groups and groups["mark"] == other and (self.grouped or self.decimal in text):
            text = text.replace(other, "")
        elif groups and groups["mark"] == other:
            whole = text.replace(other, "")
            raise ValueError(f"got {text!r}, which is {whole}, or {text.replace(other, '.')} with another decimal mark")
        elif self.decimal == "," and other in text:
            written = text.replace(other, ",")
            advice = f": write {written}" if is_numeral(written) else ""
            raise ValueError(f"got {text!r} in a file with decimal commas{advice}")
        return text.replace(",", ".") if self.decimal == "," else text


@dataclass(frozen=True, kw_only=True)
class Header:
    """Where the header of a table is.

    Args:
        names: of the columns.
        rows: before the first impact, blank ones not counted.
        read_as: what is remarkable about it, in words.
        raw: its rows as the file has them.
    """

    names: list[str]
    rows: int
    read_as: tuple[str, ...]
    raw: tuple[tuple[str, ...], ...] = ()


@dataclass(frozen=True, kw_only=True)
class Dialect:
    """How a text file writes a table, with its header; comments above the header are passed over.

    Args:
        encoding: by Python's name.
        separator: of cells.
        above: lines above the first row.
        comments: comments among them.
        numerals: of its numbers.
        header: of its rows.
        language: in which the table is marked up, as of LaTeX; empty of other text.
        text: its rows with tabs between their cells, of a table that is marked up.
    """

    encoding: str
    separator: str
    above: int
    comments: int
    numerals: Numerals
    header: Header
    language: str = ""
    text: str = ""

    def opened(self, path: Path) -> TextIO:
        """Open the table as text with a separator, whose lines are those of the file."""
        return io.StringIO(self.text) if self.language else opened_text(path, newline="", encoding=self.encoding)

    def read_as(self) -> tuple[str, ...]:
        """Return what differs from a table as `save` writes it, in words."""
        parted = _SEPARATORS.get(self.separator, "columns parted by two or more blanks")
        parts = [f"a table of {self.language}"] if self.language else [parted] * (self.separator != ",")
        parts += ["decimal commas"] if self.numerals.decimal == "," else []
        parts += ["grouped thousands"] if self.numerals.grouped else []
        parts += [_ENCODINGS.get(self.encoding, "UTF-16")] * (not self.encoding.startswith("utf-8"))
        lines = f"{self.comments} comment {'line' if self.comments == 1 else 'lines'} above the header"
        parts += [lines] * bool(self.comments)
        return (*parts, *self.header.read_as)


def sniffed(path: Path, most: int = _ROWS) -> Dialect:
    """Read the dialect of a text file off its first rows, `most` of them.

    Raises:
        DataError: it is empty, no text, or has two readings.
    """
    sample = min(_SAMPLE, _ROW * most)
    with opened_bytes(path) as file:
        head = file.read(sample + 1)
    whole = len(head) <= sample
    encoding = _encoding(path, head)
    try:
        text = codecs.getincrementaldecoder(encoding)("strict").decode(head, final=whole)
    except UnicodeDecodeError as error:
        raise DataError(f"{path}: is no {encoding} text, as it begins: {error}; save it as 'CSV UTF-8'") from None
    if text.startswith("version https://git-lfs"):
        raise DataError(f"{path}: is a pointer of Git LFS and not the file itself, which 'git lfs pull' fetches")
    if tables_in(text)[0]:
        return _marked_up(path, encoding)
    lines = [*io.StringIO(text, newline="")]
    lines = lines if whole else lines[:-1]
    above = _comments_above(lines)
    fortran = _fortran_comments(lines[above:])
    above += fortran
    comments = [_MARK.sub("", line) if fortran else line for line in lines[:above] if line.strip()]
    body = "".join(lines[above : above + most])
    separator = _separator(path, body)
    rows = _rows(body, separator)
    if not rows:
        rule = (
            "is not CSV: check its quotes"
            if body or not whole
            else "the file is empty; its first line must name the columns"
        )
        raise DataError(f"{path}: {rule}")
    titled = _rows(comments[-1].strip().lstrip("#%/! "), separator) if comments else []
    names = [name.strip() for name in titled[0]] if titled else []
    if len(names) == len(rows[0]) and is_numeric(rows[0]):
        header = Header(names=names, rows=0, read_as=("names in the last comment",))
    else:
        header = header_of(rows, str(path))
    if comments:
        named, said = with_units(header.names, comments)
        header = replace(header, names=named, read_as=(*header.read_as, *said))
    return Dialect(
        encoding=encoding, separator=separator, above=above, comments=len(comments),
        numerals=numerals_of(str(path), rows[header.rows :]), header=header,
    )  # fmt: skip


def _marked_up(path: Path, encoding: str) -> Dialect:
    """The dialect of the only table in a text of LaTeX, Markdown or HTML, or the only one with outcomes.

    Raises:
        DataError: it is too large, or has several such tables.
    """
    if size_of(path) > _LARGEST_MARKUP:
        raise DataError(f"{path}: is larger than {_LARGEST_MARKUP >> 20} MiB; write its table as CSV")
    with opened_text(path, encoding=encoding) as file:
        language, tables = tables_in(file.read())
    headers = [header_of([cells for _, cells in rows], str(path)) for rows in tables]
    chosen = [k for k, header in enumerate(headers) if are_outcomes(header.names)] or [*range(len(tables))]
    if len(chosen) > 1:
        lines = ", ".join(str(tables[k][0][0]) for k in chosen)
        raise DataError(f"{path}: has {len(chosen)} tables of {language}, in lines {lines}; keep one in the file")
    rows, header = tables[chosen[0]], headers[chosen[0]]
    numerals = numerals_of(str(path), [cells for _, cells in rows[header.rows :]])
    return Dialect(
        encoding=encoding, separator="\t", above=0, comments=0, numerals=numerals, header=header, language=language,
        text=tab_separated(rows),
    )  # fmt: skip


def _comments_above(lines: Sequence[str]) -> int:
    """The number of lines above the table that are blank or comments, of which those of C end with their mark."""
    headed = [k for k, line in enumerate(lines) if line.startswith(_LABVIEW)]
    if headed:
        return headed[-1] + 1
    inside = False
    for k, line in enumerate(lines):
        text = line.strip()
        inside = inside or text.startswith("/*")
        if text and not inside and not text.startswith(COMMENT):
            return k
        inside = inside and not text.endswith("*/")
    return len(lines)


def _fortran_comments(lines: Sequence[str]) -> int:
    """The number of lines, at the top, that are comments of Fortran: the last of them names the columns below it.

    A column may be called C: then that line has as many names as the numbers below it.
    """
    count = next((k for k, line in enumerate(lines) if line.strip() and not _MARK.match(line)), 0)
    names = next((_MARK.sub("", line) for line in reversed(lines[:count]) if line.strip()), "")
    first = _rows("".join(lines[count : count + 1]), " ")
    return count if names and first and is_numeric(first[0]) and len(names.split()) == len(first[0]) else 0


def _encoding(path: Path, head: bytes) -> str:
    """The encoding of a file: that of its byte-order mark, UTF-8, or what Windows writes in Western Europe."""
    for mark, name in _BYTE_ORDER_MARKS.items():
        if head.startswith(mark):
            return name
    if head.count(0) > len(head) / 8:
        even, odd = head[::2].count(0), head[1::2].count(0)
        if not even or not odd:  # the other half of letters without accents
            return "utf-16-be" if even else "utf-16-le"
        raise DataError(f"{path}: is not text; save it as 'CSV UTF-8'")
    decoded = dict[str, str]()
    for name in ("utf-8", "cp932", "cp1252"):
        with suppress(UnicodeDecodeError):
            decoded[name] = codecs.getincrementaldecoder(name)("strict").decode(head)
    if "utf-8" in decoded:
        return "utf-8"
    if _is_japanese(decoded.get("cp932", "")):
        return "cp932"
    if b"\0" not in head and (text := decoded.get("cp1252", "")):
        letters = [letter for letter in text if letter.isalpha()]
        # In words of Western Europe few letters have accents; in Cyrillic ones of Windows-1251 all look as if.
        return "cp1251" if 2 * sum(letter > "\x7f" for letter in letters) > len(letters) else "cp1252"
    raise DataError(f"{path}: is neither UTF-8, Windows-1252 nor Shift-JIS text; save it as 'CSV UTF-8'")


def _is_japanese(text: str) -> bool:
    """Whether most letters of a text that are not ASCII are Japanese, and few alone: two bytes may be any by chance."""
    wide = [*re.finditer(r"[\u3000-\u30ff\u4e00-\u9fff\uff00-\uff60]+", text)]
    together = sum(len(one[0]) for one in wide if len(one[0]) > 1)
    return bool(wide) and 2 * together > sum(not one.isascii() for one in text)


def csv_rows(lines: Iterator[str], separator: str) -> Iterator[tuple[int, list[str]]]:
    """Yield line and cells of every row that is not blank; csv.Error with the line where quotes are wrong."""
    if separator == WIDE:
        lines, separator = (_BLANKS.sub("\t", line.translate(_BLANK).strip()) + "\n" for line in lines), "\t"
    elif separator == " ":
        lines = (_GLUED.sub(" ", line) for line in lines)
    reader = csv.reader(lines, delimiter=separator, strict=True, skipinitialspace=separator == " ")
    try:
        for cells in reader:
            if any(map(str.strip, cells)):
                yield reader.line_num, cells[:-1] if separator == " " and not cells[-1] else cells
    except csv.Error as error:
        raise csv.Error(reader.line_num, str(error)) from None


def _rows(text: str, separator: str) -> list[list[str]]:
    """The first rows of a text, as far as its quotes are right."""
    rows: list[list[str]] = []
    with suppress(csv.Error):
        rows.extend(cells for _, cells in islice(csv_rows(io.StringIO(text, newline=""), separator), _ROWS))
    return rows


def _width(rows: Sequence[Sequence[Any]]) -> int:
    """The number of cells that most rows have, the larger of two."""
    counts = Counter(map(len, rows))
    return max(counts, key=lambda width: (counts[width], width), default=0)


def _separator(path: Path, text: str) -> str:
    """The separator that makes a table of numbers; a comma if none does.

    Raises:
        DataError: two do.
    """
    shares: dict[str, float] = {}
    for separator in _SEPARATORS:
        rows = _rows(text, separator)
        width = _width(rows)
        if width > 1:
            cells = [cell for row in rows if len(row) == width for cell in row]
            of_numbers = sum(len(row) for row in rows if any(map(is_numeral, row)))
            shares[separator] = sum(map(is_numeral, cells)) / max(of_numbers, 1)
    best = sorted(shares, key=lambda one: -shares[one])
    if not best or not shares[best[0]]:
        return max(shares, key=lambda one: text.partition("\n")[0].count(one), default=",")
    if len(best) > 1 and shares[best[1]] > 0.9 * shares[best[0]]:
        readings = " or ".join(f"{_SEPARATORS[one]} ({len(_rows(text, one)[-1])} columns)" for one in best[:2])
        raise DataError(f"{path}: columns may be separated by {readings}; write it with one of them only")
    return WIDE if best[0] == " " and _is_wide(text) else best[0]


def _is_wide(text: str) -> bool:
    """Whether two or more blanks part columns: more rows are of one width then, and no fewer of their cells numbers."""
    shares, counts = list[float](), list[int]()
    for separator in (" ", WIDE):
        rows = _rows(text, separator)
        width = _width(rows)
        cells = [cell for row in rows if len(row) == width for cell in row if not is_missing(cell)]
        shares.append(sum(written_in(cell) is not None for cell in cells) / max(len(cells), 1) if width > 1 else 0)
        counts.append([*map(len, rows)].count(width))
    return counts[1] > counts[0] and shares[1] >= _MIN_SHARE * shares[0]


def is_numeral(cell: Any) -> bool:
    """Return whether a cell is a number, with whatever decimal mark and groups of thousands."""
    if isinstance(cell, str):
        text = cell.strip().translate(_SPACES)
        return bool(_NUMBER.fullmatch(text) or _GROUPS.fullmatch(text))
    return isinstance(cell, int | float) and not isinstance(cell, bool)


def is_numeric(cells: Sequence[Any]) -> bool:
    """Return whether a row is one of numbers, not of names: at least half of its cells that are not missing."""
    present = [cell for cell in cells if not is_missing(cell)]
    return bool(present) and 2 * sum(map(is_numeral, present)) >= len(present)


def numerals_of(source: str, rows: Sequence[Sequence[Any]]) -> Numerals:
    """Return the decimal mark and the groups of thousands that the numbers among the texts of some rows show.

    Raises:
        DataError: they have two readings.
    """
    rows = [[cell if isinstance(cell, str) else "" for cell in row] for row in rows]
    marks, grouped, doubtful = set[str](), False, ""
    for cell in (cell.strip().translate(_SPACES) for row in rows for cell in row):
        if not is_numeral(cell) and (written := written_in(cell)):
            cell = written.number
        if not ({*".,"} & {*cell} and (_NUMBER.fullmatch(cell) or _GROUPS.fullmatch(cell))):
            continue
        mark = max(".,", key=cell.rfind)
        if re.fullmatch(r"[-+]?[1-9]\d{0,2}[.,]\d{3}", cell):
            doubtful = doubtful or (cell if mark == "," else "")
            continue
        if {*".,"} <= {*cell}:
            grouped = True
        elif cell.count(mark) > 1:
            grouped, mark = True, "." if mark == "," else ","
        marks.add(mark)
    thousands = {mark for column in zip_longest(*rows, fillvalue="") if (mark := _thousands(column))} - marks
    if len(thousands) == 1:
        grouped, marks = True, marks | ({*".,"} - thousands)
    if doubtful and not marks:
        raise DataError(
            f"{source}: {doubtful} is {doubtful.replace(',', '')}, or {doubtful.replace(',', '.')} with a comma "
            "for decimals (no other number says which); write it with decimal points and without groups of thousands"
        )
    return Numerals(decimal="," if marks == {","} else ".", grouped=grouped)


def _thousands(cells: Sequence[str]) -> str:
    """The mark between the thousands of a column of whole numbers, such as 833 and 1,470; empty for any other column.

    Decimals would be shorter somewhere, or there in every cell.
    """
    written = [cell.strip().translate(_SPACES).lstrip("+-") for cell in cells if not is_missing(cell)]
    for mark in ".,":
        groups = sum(bool(re.fullmatch(rf"[1-9]\d{{0,2}}(\{mark}\d{{3}})+", cell)) for cell in written)
        small = [cell for cell in written if re.fullmatch(r"[1-9]\d{0,2}|0", cell)]
        if groups >= _MIN_GROUPS and groups + len(small) == len(written) and any(len(cell) == 3 for cell in small):
            return mark
    return ""


def header_of(rows: Sequence[Sequence[Any]], source: str) -> Header:
    """Find the header: the first row that has the width of the table, with names of groups above and units below it.

    Args:
        rows: the first rows, blank ones left out.
        source: of the rows, in errors.

    Raises:
        DataError: there is none.
    """
    width = _width(rows)
    named_rows = _are_named(rows, width)
    if rows and len(rows[0]) == width + 1 and name_words(text_of(rows[0][-1])) in (("comment",), ("comments",)):
        rows = [rows[0][:-1], *rows[1:]]  # of LabVIEW, which has none
    rows = [["row", *rows[0]], *rows[1:]] if named_rows else rows
    full = [
        k for k, row in enumerate(rows) if len(row) == width and 2 * sum(not is_blank(cell) for cell in row) > width
    ]
    first = next((k for k in full if not _is_group(rows[k])), 0)
    if rows and is_numeric(rows[first]) and first:
        first = 0  # rows of another width than their header: its reader says so
    if not rows or is_numeric(rows[first]):
        seen = f"begins with the numbers {', '.join(str(c).strip() for c in rows[0][:3])} …" if rows else "is empty"
        raise DataError(f"{source}: {seen}; its first line must name the columns")
    names, read_as = [text_of(cell) for cell in rows[first]], ["names of rows, which R writes"] * named_rows
    titles, last = first, first + 1
    if (
        first
        and len(above := rows[first - 1]) <= len(names)
        and _is_group([cell for cell, name in zip(above, names, strict=False) if name])
    ):
        names, titles = _grouped(names, above), first - 1
        read_as.append("two rows of names")
    units = [""] * len(names)
    for row in _texts_below(rows[last:], len(names)):
        if _is_units(row):
            units = row
            read_as.append("a row of units")
        elif not are_outcomes(names) and are_outcomes(full := _grouped(names, row)):
            names = full
            read_as.append("names with the comments below them")
        elif longer := {k for k, cell in enumerate(row) if cell and not _tells(names[k]) and _tells(cell)}:
            names = [cell if k in longer else name for k, (name, cell) in enumerate(zip(names, row, strict=True))]
            read_as.append("longer names below the names")
        last += 1
    named = zip(names, units, strict=True)
    names = [f"{name} [{unit.strip('[]()')}]" if unit not in ("", "-") else name for name, unit in named]
    if titles:
        read_as.insert(0, f"{titles} {'line' if titles == 1 else 'lines'} above the header")
    raw = tuple(tuple(map(text_of, row)) for row in rows[titles:last])
    return Header(names=names, rows=last, read_as=tuple(read_as), raw=raw)


def _are_named(rows: Sequence[Sequence[Any]], width: int) -> bool:
    """Whether rows have names or numbers, each its own, under a header that has none for them, as R writes tables.

    A decimal comma that parts a number in two leaves whole numbers only.
    """
    if len(rows) < 3 or len(rows[0]) != width - 1 or is_numeric(rows[0]) or any(len(row) != width for row in rows[1:]):
        return False
    first, others = [text_of(row[0]) for row in rows[1:]], [text_of(cell) for row in rows[1:] for cell in row[1:]]
    numbered = all(map(str.isdigit, first)) or not any(map(is_numeral, first))
    return numbered and len({*first}) == len(first) and any({*".,"} & {*cell} for cell in others if is_numeral(cell))


def text_of(cell: Any) -> str:
    """Return a cell as text, without blanks around it."""
    return "" if is_blank(cell) else str(cell).strip()


def is_blank(cell: Any) -> bool:
    """Return whether a cell is empty."""
    return cell is None or cell != cell or not str(cell).strip()  # nan of a spreadsheet is not itself


def _is_group(cells: Sequence[Any]) -> bool:
    """Whether a row says which columns are before and which after contact, and of some perhaps something else."""
    texts = [text_of(cell) for cell in cells]
    spans = len({*texts}) < len(texts)  # several columns, as the name of one column does not
    return any(time_of(text) == "post" or (spans and _time_in(text) == "post") for text in texts)


def _time_in(group: str) -> str | None:
    """Return "pre" or "post" where words of a group say so, beside those of a quantity, such as "velocity after"."""
    times = {time for word in name_words(group) if (time := time_of(word))}
    return times.pop() if len(times) == 1 else None


def _is_units(cells: Sequence[Any]) -> bool:
    """Whether a row has units, and at most a few words beside them."""
    present = [text_of(cell) for cell in cells if not is_blank(cell)]
    units = sum(map(is_unit, present))
    return not any(map(is_numeral, present)) and any(cell != "-" for cell in present) and 3 * units >= 2 * len(present)


def _tells(name: str) -> bool:
    """Whether the reader knows what a name of a column is of, such as plate velocity."""
    bare = " ".join(word for word in name_words(name) if word not in SURFACES)
    return any(recognise([bare, "out"], impact_vocabulary(space)).names for space in BOTH)


def _texts_below(rows: Sequence[Sequence[Any]], width: int) -> list[list[str]]:
    """The rows below a header that are units, comments or names once more, above the first row of numbers.

    The names of a row whose numbers are missing stand above names.
    """
    first = next((k for k, row in enumerate(rows) if any(map(is_numeral, row))), 0)
    texts = [[*map(text_of, row), *[""] * (width - len(row))] for row in rows[:first]]
    of_numbers = [k for k, cell in enumerate(rows[first]) if is_numeral(cell)] if first else []
    below = [
        row for row in texts
        if len(row) == width and not any(map(_NUMBERED.match, row))
        and (_is_units(row) or any(row[k] and not is_missing(row[k]) for k in of_numbers if k < width))
    ]  # fmt: skip
    return below if len(below) == first <= _MOST_BELOW else []


def _grouped(names: Sequence[str], above: Sequence[Any]) -> list[str]:
    """Names with that of their group, which stands above the first of them; a name may stand in the row above, too."""
    group, full = "", list[str]()
    for name, cell in zip(names, [*map(text_of, above)] + [""] * (len(names) - len(above)), strict=True):
        group = cell or group
        full.append(_in_group(name, group) if name and group else name or cell)
        group = group if name else ""
    return full


def _in_group(name: str, group: str) -> str:
    """A name with that of its group, or with the time that it says, or alone: the first that the reader knows."""
    time = {"pre": "before", "post": "after"}.get(_time_in(group) or "", "")
    unit = "".join(_UNIT_AT_END.findall(name))
    bare = name.removesuffix(unit)
    known = [f"{bare} {group}{unit}", f"{bare} {time}{unit}" if time else name]
    return next(
        (one for one in known if any(recognise([one], impact_vocabulary(space)).names for space in BOTH)), known[0]
    )
