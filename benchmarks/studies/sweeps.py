"""Sweeps that are stopped on the way: commands in processes of their own, and what their folders hold."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

from contactlearn.results.folder import find_results, read_result
from contactlearn.results.state import read_done

ROOT = Path(__file__).parent.parent.parent
JOBS = ("data.size=80", "train.repetitions=2", "bootstrap=20", "train.size=10,15,20", "law=wang_mason,whittaker")
COUNT = 6


def started(folder, *words, command="train.py"):
    """A sweep in a process group of its own."""
    return subprocess.Popen(
        [sys.executable, str(ROOT / command), "-m", *words, f"hydra.sweep.dir={folder}"],
        cwd=ROOT,
        env=os.environ | {"OMP_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(map(str, [ROOT, *sys.path[1:]]))},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # what runs in the background ignores Ctrl-C
    )


def ended(process, timeout=300):
    """Exit status and output of a sweep."""
    printed, _ = process.communicate(timeout=timeout)
    return process.returncode, printed


def killed(process, after):
    """Kill a sweep and all its processes after some seconds; whether it was still running."""
    try:
        process.communicate(timeout=after)
        return False
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        return True


def content(folder):
    """Everything that the finished jobs say, by name, but for times and the line that was typed."""
    found = {}
    for path in find_results(folder):
        if path.name == "results.json":
            result = json.loads(path.read_text("utf-8"))
            found[path.parent.name] = (result["errors"], result["fits"], result["provenance"]["config"])
    return found


def finished(folder):
    """Names of finished jobs with the time at which each was."""
    return {path.parent.name: path.stat().st_mtime_ns for path in Path(folder).glob("*/done.json")}


def nothing_half_written(folder):
    """Every result that is found can be read, and is of a finished job; every marker is whole."""
    for path in find_results(folder):
        if path.is_file():
            read_result(path)
            assert (path.parent / "done.json").exists()
    assert all(read_done(path.parent) is not None for path in Path(folder).glob("*/done.json"))


def survive(folder, kills, longest, seed=0, words=JOBS, start=started):
    """Kill a sweep at random moments and go on each time; kills that hit it, and what was lost, which must be none."""
    moments = random.Random(seed)
    hits, lost = 0, []
    before = {}
    begun = time.monotonic()
    while hits < kills and time.monotonic() - begun < 1500:
        if len(before) == COUNT:  # begin anew: there is nothing left to kill
            before = {}
            for path in Path(folder).iterdir():
                subprocess.run(["rm", "-rf", str(path)], check=True)
        hits += killed(start(folder, *words), moments.uniform(0.5, longest))
        nothing_half_written(folder)
        now = finished(folder)
        lost += [name for name, when in before.items() if now.get(name) != when]
        before = now
    return hits, lost
