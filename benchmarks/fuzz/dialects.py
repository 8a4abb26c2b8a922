"""Dialects of tables: bytes choose a dialect, a table and a few broken bytes; numbers that are read are those written.

A file that nothing has broken must give the numbers that pandas gives, with its dialect stated; a broken one may be
refused, but not read with other numbers in the cells that are still as written.  One column may be of whole numbers
with groups of thousands beside columns of decimals without; such a file may be refused too.
"""

import csv
import io
import random

import numpy as np
import pandas as pd
import torch

from contactlearn.core.errors import ContactLearnError
from contactlearn.data import table
from fuzz.target import Target, file

COLUMNS = ("rx", "ry", "x", "y", "theta", "vx", "vy", "omega", "vx_post", "vy_post", "omega_post")
BODY = {"mass": 0.05, "inertia": 1e-5, "validate": False}
SEPARATORS = (",", ";", "\t", "|", " ")
ENCODINGS = ("utf-8", "utf-8-sig", "utf-16", "cp1252")
BROKEN = (b",", b";", b".", b"-", b"\n", b"\t", b"#", b'"', b" ", b"e", b"NA", b"1,234", b"0", b"'", b"\xff", b"\x00")


def read(content: bytes) -> None:
    """Write a table in a dialect, break it or not, read it, and compare.

    Raises:
        AssertionError: an unbroken file is refused, or numbers differ.
    """
    draw = random.Random(content)
    separator, encoding = draw.choice(SEPARATORS), draw.choice(ENCODINGS)
    decimal, grouped, quoted = draw.choice(".,"), draw.random() < 0.3 and separator != " ", draw.random() < 0.3
    rows = [[_number(draw) for _ in COLUMNS] for _ in range(draw.randint(1, 12))]
    whole = None if grouped or separator == " " or draw.random() > 0.3 else draw.randrange(len(COLUMNS))
    for row in rows if whole is not None else ():
        row[whole] = float(draw.randint(-20_000, 20_000) // draw.choice((1, 1, 20)))
    numbers = np.array(rows)
    swapped = str.maketrans(".,", ",.") if decimal == "," else {}
    forms = [",.0f" if k == whole else ",.7f" if grouped else "" for k in range(len(COLUMNS))]
    written = [
        [(format(x, form) if form else repr(x)).translate(swapped) for x, form in zip(row, forms, strict=True)]
        for row in rows
    ]
    out = io.StringIO(newline="")
    quoting = csv.QUOTE_ALL if quoted else csv.QUOTE_MINIMAL
    csv.writer(out, delimiter=separator, quoting=quoting).writerows([[*COLUMNS], *written])
    above = "".join(
        draw.choice(["# a comment, with a comma\n", "% another\n", "\n"]) for _ in range(draw.randint(0, 3))
    )
    intact = (above + out.getvalue()).encode(encoding)
    raw = bytearray(intact)
    for _ in range(draw.choice((0, 0, 1, 2, 5))):
        place = draw.randrange(len(raw))
        raw[place : place + draw.randint(0, 2)] = draw.choice(BROKEN)
    with file(bytes(raw), draw.choice((".csv", ".txt", ".tsv"))) as path:
        try:
            found = table.read(path, **BODY).impacts
        except ContactLearnError as error:
            if bytes(raw) == intact and whole is None and _decides(written):
                raise AssertionError(f"refused: {error}") from None
            return
    values = torch.cat((found.r, found.q, found.v_pre, found.v_post), 1).numpy()
    other = "." if decimal == "," else ","
    if bytes(raw) == intact:
        theirs = pd.read_csv(
            io.StringIO(out.getvalue()), sep=separator, decimal=decimal, float_precision="round_trip",
            thousands=other if grouped or whole is not None else None,
        )  # fmt: skip
        assert np.array_equal(values, theirs.to_numpy(float)), "other numbers than pandas"
        assert np.allclose(values, numbers, rtol=1e-12, atol=1e-7), "other numbers than written"
    elif values.shape == numbers.shape:
        off = ~np.isclose(values, numbers, rtol=1e-9, atol=1e-7)
        for ratio in (values / np.where(numbers == 0, 1, numbers))[off & (numbers != 0)]:
            many = off.mean() > 0.5
            assert not (many and np.isclose(abs(np.log10(abs(ratio) or 1)) % 1, 0)), "all numbers by a power of ten"


def _number(draw: random.Random) -> float:
    """A number such as tables have, of any size and digits."""
    return round(draw.uniform(-1, 1) * 10 ** draw.choice((0, 0, 1, 2, 4)), draw.choice((1, 3, 5, 7)))


def _decides(rows: list[list[str]]) -> bool:
    """Whether some number tells the decimal mark: not all could have groups of thousands."""
    cells = [cell.lstrip("-") for row in rows for cell in row]
    return any(len(cell) > 7 or len(cell.replace(",", ".").split(".")[-1]) != 3 or cell[0] == "0" for cell in cells)


def seeds() -> list[bytes]:
    """Numbers from which dialect and table follow."""
    return [seed.to_bytes(4, "big") for seed in range(300)]


TARGET = Target(read, seeds, words=["dialect"])
