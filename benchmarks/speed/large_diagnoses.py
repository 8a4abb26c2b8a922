"""Diagnoses of large tables: time, peak memory and page, and whether the answer is that of a small part of the table.

    python benchmarks/speed/large_diagnoses.py [--sizes 1500 100000 1000000] [--seed 7]

Each diagnosis is the command as a user types it, on a Parquet table of mystery drops, in a process of its own.  Seconds
of processor time hold on a busy machine too, those of the clock do not.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from contactlearn.data import table
from contactlearn.simulation import hidden_effects

ROOT = Path(__file__).resolve().parents[2]
WANTED = {100_000: "≤ 120 s, ≤ 2 GB"}


def diagnosed(path, shape, folder):
    """The result of the command on a table, its seconds by clock and processor, and its peak memory in GB."""
    a, b = shape.semi_axes
    words = ["data=table", f"data.path={path}", f"data.shape={{kind:ellipse,semi_axes:[{a},{b}]}}"]
    began, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    peak = _watched([sys.executable, "diagnose.py", *words, f"hydra.run.dir={folder}"])
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    busy = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    found = json.loads((folder / "diagnosis.json").read_text())["diagnosis"]
    return found, time.perf_counter() - began, busy, peak


def _watched(command):
    """Run a command; its peak memory in GB."""
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, env=os.environ | {"OMP_NUM_THREADS": "1"})
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    assert process.returncode == 0, command
    return used.ru_maxrss * 1024 / 1e9


def main() -> None:
    """Measure each size, and print a line for it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", type=int, nargs="+", default=[1500, 100_000])
    parser.add_argument("--seed", type=int, default=7)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        for size in options.sizes:
            path, folder = Path(name, f"{size}.parquet"), Path(name, str(size))
            impacts, truth = hidden_effects.draw(options.seed, size=size)
            table.save(impacts, path)
            shape = impacts.shape
            del impacts
            found, clock, busy, peak = diagnosed(path, shape, folder)
            page = (folder / "report.html").stat().st_size / 1e6
            names = ", ".join(one["effect"]["name"] for one in found["missing"])
            sample = found["sample"]
            trials = size if sample is None else sample["answers"][-1]["trials"]
            error = found["budget"]["named"] if sample is None else sample["confirmation"]["named"]
            print(
                f"{size} trials, {trials} diagnosed: {clock:.0f} s by the clock, {busy:.0f} s of processor, "
                f"{peak:.2f} GB, page {page:.1f} MB{'; wanted ' + WANTED[size] if size in WANTED else ''}\n"
                f"    {found['law']}: {names or 'nothing'} ({found['verdict']}), error {error['mean']:.4f}; "
                f"hidden: {', '.join(one['name'] for one in truth['effects'])}",
                flush=True,
            )


if __name__ == "__main__":
    main()
