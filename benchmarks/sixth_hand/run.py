"""Diagnose the sets of a sixth hand, and say frankly what is right.

    python benchmarks/sixth_hand/run.py --keep sixth.jsonl [--only 05,26] [--seconds 60] [--table] [--write folder]

With --keep, every finished set is a line of a file, and an interrupted run goes on from there; --table prints the
tables of such a file without asking anything; --write puts the 64 tables into a folder, as CSV.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from fifth_hand.report import Report
from second_nature.tables import share, table
from sixth_hand import sets
from sixth_hand.judge import TRUTH, ask, left_out
from third_hand.judge import Said
from third_hand.run import command

REPORT = Report(sets, TRUTH)


def false_names(said: Sequence[Said]) -> str:
    """Names beside unknown physics, none of which is right, without and with those that were left out."""
    unknown = REPORT.beside_unknown(said)
    rows = []
    for words, more in (("as said", lambda one: []), ("with those that only stand for something unknown", left_out)):
        names = [[*one.effects, *more(one)] for one in unknown]
        rows.append([words, str(sum(map(len, names))), share([not some for some in names])])
    return table(["names beside unknown physics", "false names", "sets without any"], rows)


def tables(said: Sequence[Said]) -> str:
    """All tables."""
    return f"{REPORT.tables(said)}\n\n{false_names(said)}"


if __name__ == "__main__":
    command(__doc__, sets, ask, tables)
