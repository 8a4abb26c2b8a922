r"""Tables in the source of LaTeX, Markdown and HTML: their rows, which `dialect` reads as those of any other text.

    \begin{tabular}{lS} trial & {$v_x^{+}$ (\si{mm/s})} \\ \midrule 1 & {-0.42} \\ \end{tabular}
    | trial | vx' [mm/s] |          with the line |---|---| below the header
    <table> <tr> <th> …             colspan and rowspan as empty cells, which merged cells of spreadsheets have

Nothing of it is carried out.  Commands of LaTeX that say how a cell looks are taken off.
"""

import re
from collections.abc import Iterator, Sequence
from html.parser import HTMLParser
from itertools import groupby

Row = tuple[int, list[str]]
"""Its line, from 1, and its cells."""

_BEGIN = re.compile(r"\\begin\s*\{(tabular[xy*]?|longtable|supertabular|tblr|array)\}")
_ROW_END = re.compile(r"\\\\\*?(?:\s*\[[^\]]*\])?|\\tabularnewline\b")
_COMMENT = re.compile(r"(?<!\\)%.*")
_RULES = re.compile(
    r"\\(?:(?:cline|cmidrule|specialrule|noalign|rowcolor)\s*(?:\([^)]*\)|\[[^\]]*\]|\{[^{}]*\})+"
    r"|(?:hline|toprule|midrule|bottomrule|addlinespace|end(?:first)?head|end(?:last)?foot)(?![a-zA-Z])(?:\s*\[[^\]]*\])?)"
)
_CELL_END = re.compile(r"(?<!\\)&")
_SPAN = re.compile(r"\s*\\multicolumn\s*\{(\d+)\}\s*\{[^{}]*(?:\{[^{}]*\}[^{}]*)*\}\s*(.*)", re.DOTALL)
_MULTIROW = re.compile(r"\\multirow\s*(?:\[[^\]]*\])?\s*\{[^{}]*\}\s*\{[^{}]*\}")
_DOT = re.compile(r"\\dot\s*\{?\s*(\\(?:theta|varphi|phi|alpha)\b|[xyz])\s*\}?")
_SIGNS = {
    **{"omega": "ω", "theta": "θ", "varphi": "φ", "phi": "φ", "Delta": "Δ", "mu": "µ", "pm": "±", "times": "×"},
    **{"cdot": "·", "degree": "°", "circ": "°", "degreeCelsius": "°C", "percent": "%", "prime": "'", "quad": " "},
    **{"dagger": "†", "ddagger": "‡", "ast": "*"},
    **{"per": "/", "milli": "m", "centi": "c", "kilo": "k", "micro": "µ", "squared": "²", "tothe": "^", "deg": "deg"},
    **dict.fromkeys(("metre", "meter"), "m"),
    **{"second": "s", "gram": "g", "kilogram": "kg", "radian": "rad", "minute": "min", "hour": "h", "newton": "N"},
    **dict.fromkeys(("textminus", "minus"), "-"),
}
_SIGN = re.compile(rf"\\({'|'.join(sorted(_SIGNS, key=len, reverse=True))})(?![a-zA-Z])")
_QUANTITY = re.compile(r"\\(?:SI|qty)\s*(?:\[[^\]]*\])?\s*\{([^{}]*)\}\s*\{([^{}]*)\}")
_UNIT = re.compile(r"\\(?:si|unit)\s*(?:\[[^\]]*\])?\s*\{([^{}]*)\}")
_COMMAND = re.compile(r"\\[a-zA-Z]+\*?\s*(?:\[[^\]]*\])?")
_ESCAPED = re.compile(r"\\([%_&#${}])")
_SPACE = re.compile(r"\\[,;:! ]|~|\\quad")
_RULE = re.compile(r"\s*\|?\s*:?-+:?\s*(?:[|+]\s*:?-+:?\s*)+\|?\s*")
_BAR = re.compile(r"(?<!\\)\|")
_EMPHASIS = re.compile(r"(?:\*\*|__|`)(.*?)(?:\*\*|__|`)")


def tables_in(text: str) -> tuple[str, list[list[Row]]]:
    """Return the language of the tables in a text and the rows of each; none of a text without."""
    for language, rows_of in (("LaTeX", _latex), ("HTML", _html), ("Markdown", _markdown)):
        found = [[(line, cells) for line, cells in rows if any(cells)] for rows in rows_of(text)]
        if found := [rows for rows in found if len(rows) > 1]:
            return language, found
    return "", []


def tab_separated(rows: Sequence[Row]) -> str:
    """Return rows with tabs between their cells, each in its line."""
    lines = list[str]()
    for line, cells in rows:
        lines += [""] * (line - 1 - len(lines))
        lines.append("\t".join(f'"{cell.replace(chr(34), chr(34) * 2)}"' if '"' in cell else cell for cell in cells))
    return "\n".join([*lines, ""])


def _latex(text: str) -> Iterator[list[Row]]:
    """Rows of each tabular, or of the lines alone that somebody has copied out of one."""
    lines = [_COMMENT.sub("", line) for line in text.splitlines()]
    plain = "\n".join(lines)
    begins = [*_BEGIN.finditer(plain)]
    for begin in begins:
        end = plain.find(f"\\end{{{begin[1]}}}", begin.end())
        first = _after_arguments(plain, begin.end())
        yield _latex_rows(plain[first : end if end > 0 else None], plain.count("\n", 0, first))
    rows = sum(bool(_CELL_END.search(line)) and len(_ROW_END.findall(line)) == 1 for line in lines)
    if not begins and 2 * rows > sum(map(bool, map(str.strip, lines))):
        yield _latex_rows(plain, 0)


def _after_arguments(text: str, place: int) -> int:
    """The place behind the arguments of a begin, such as {lccS[table-format=1.2]}."""
    while match := re.compile(r"\s*(?:\[[^\]]*\]|\{(?:[^{}]|\{(?:[^{}]|\{[^{}]*\})*\})*\})").match(text, place):
        place = match.end()
    return place


def _latex_rows(text: str, above: int) -> list[Row]:
    found, place = list[Row](), 0
    for part in _ROW_END.split(text):
        begin = text.index(part, place)
        place = begin + len(part)
        own = _RULES.sub("", part)
        written = len(part) - len(part.lstrip())
        line = above + text.count("\n", 0, begin + written) + 1
        cells = list[str]()
        for cell in _CELL_END.split(own):
            span = _SPAN.match(cell)
            cells += [_plain(span[2] if span else cell), *[""] * (min(int(span[1]), _WIDEST) - 1 if span else 0)]
        found.append((line, cells))
    return found


_WIDEST = 1000  # columns of a cell


def _plain(cell: str) -> str:
    """A cell of LaTeX as a person reads it."""
    cell = _MULTIROW.sub("", cell)
    cell = _DOT.sub(lambda dot: "ω" if "\\" in dot[1] else f"v_{dot[1]}", cell)
    cell = _QUANTITY.sub(r"\1 \2", _UNIT.sub(lambda unit: re.sub(r"(?<=\w)\.(?=\w)", " ", unit[1]), cell))
    cell = _SIGN.sub(lambda sign: _SIGNS[sign[1]], _SPACE.sub(" ", cell))
    cell = _ESCAPED.sub(lambda sign: chr(0xE000 + ord(sign[1])), cell)  # signs of their own, until braces are gone
    cell = re.sub(r"\^\s*(?:\{\s*([-+'°*†‡])\s*\}|([-+'°*†‡]))", r"\1\2", cell)
    cell = re.sub(r"[{}$]", "", _COMMAND.sub(" ", cell))
    cell = re.sub(r"[\ue000-\ue07f]", lambda sign: chr(ord(sign[0]) - 0xE000), cell)
    return re.sub(r"(?<=[-+])\s+(?=[\d.])", "", " ".join(cell.split()))


def _markdown(text: str) -> Iterator[list[Row]]:
    """Rows of each table whose header has a line of dashes below it."""
    lines = text.splitlines()
    for barred, group in groupby(enumerate(lines, 1), lambda one: bool(_BAR.search(one[1]))):
        rows = [*group] if barred else []
        rule = next((k for k, (_, line) in enumerate(rows) if _RULE.fullmatch(line)), 0)
        if rule:
            yield [(number, _barred(line)) for k, (number, line) in enumerate(rows) if k != rule and k >= rule - 1]


def _barred(line: str) -> list[str]:
    inner = line.strip().removeprefix("|")
    inner = inner[:-1] if inner.endswith("|") and not inner.endswith("\\|") else inner
    cells = (cell.strip().replace("\\|", "|").replace("\\_", "_") for cell in _BAR.split(inner))
    return [_EMPHASIS.sub(r"\1", cell) for cell in cells]


def _html(text: str) -> Iterator[list[Row]]:
    if re.search(r"<table\b", text, re.IGNORECASE):
        reader = _Tables()
        reader.feed(text)
        reader.close()
        yield from reader.tables


class _Tables(HTMLParser):
    """The tables of HTML; one within a cell is text of that cell."""

    def __init__(self) -> None:
        super().__init__()
        self.tables: list[list[Row]] = []
        self._depth = 0
        self._cell: list[str] | None = None
        self._span = (1, 1)
        self._below: dict[int, int] = {}  # rows that a cell of a column goes on for

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "table":
            self._depth += 1
            if self._depth == 1:
                self.tables.append([])
                self._below = {}
        elif self._depth == 1 and tag == "tr":
            self._end_cell()
            self.tables[-1].append((self.getpos()[0], []))
        elif self._depth == 1 and tag in ("td", "th") and self.tables[-1]:
            self._end_cell()
            self._cell, about = [], dict(attrs)
            spans = (about.get("colspan") or "1", about.get("rowspan") or "1")
            columns, rows = (int(one) if re.fullmatch(r"\d{1,3}", one) else 1 for one in spans)
            self._span = (max(columns, 1), max(rows, 1))
        elif tag == "br":
            self.handle_data(" ")

    def handle_endtag(self, tag: str) -> None:
        if tag in ("td", "th", "tr", "table") and self._depth == 1:
            self._end_cell()
        if tag == "table":
            self._depth = max(self._depth - 1, 0)

    def handle_data(self, data: str) -> None:
        if self._cell is not None:
            self._cell.append(data)

    def _end_cell(self) -> None:
        if self._cell is None:
            return
        cells = self.tables[-1][-1][1]
        self._fill(cells)
        columns, rows = self._span
        for place in range(len(cells), len(cells) + columns):
            self._below[place] = rows - 1
        cells += [" ".join("".join(self._cell).split()), *[""] * (columns - 1)]
        self._cell = None
        self._fill(cells)

    def _fill(self, cells: list[str]) -> None:
        """Empty cells where one of the rows above goes on."""
        while self._below.get(len(cells), 0) > 0:
            self._below[len(cells)] -= 1
            cells.append("")
