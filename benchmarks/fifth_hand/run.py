"""Diagnose the sets of a fifth hand, and say frankly what is right.

    python benchmarks/fifth_hand/run.py --keep fifth.jsonl [--only 05,26] [--seconds 60] [--table] [--write folder]

With --keep, every finished set is a line of a file, and an interrupted run goes on from there; --table prints the
tables of such a file without asking anything; --write puts the 56 tables into a folder, as CSV.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from fifth_hand import sets
from fifth_hand.judge import TRUTH, ask
from fifth_hand.report import Report
from third_hand.run import command

if __name__ == "__main__":
    command(__doc__, sets, ask, Report(sets, TRUTH).tables)
