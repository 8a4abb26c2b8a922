"""Time sweeps that skip finished jobs, are killed, and are gathered by the thousand.

    python benchmarks/speed/sweeps.py [--what skipped kills table] [--kills 50] [--runs 10000]

A kill is SIGKILL to the whole sweep at a random moment; the same command then resumes, and no finished job may be
lost.  Each line states the requirement.
"""

import argparse
import json
import os
import random
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from contactlearn.core.serialisation import to_json
from contactlearn.results.folder import find_results, read_result
from contactlearn.results.state import finish, locked, read_done

ROOT = Path(__file__).resolve().parents[2]
JOBS = (
    "data.size=80", "train.repetitions=2", "bootstrap=20", "model=analytical", "train.size=10,20",
    "law=wang_mason,whittaker",
)  # fmt: skip
COUNT = 4


def started(folder, *words, command="train.py"):
    """Start a sweep in a process group of its own."""
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
    """Wait for a sweep; return its exit status and output."""
    printed, _ = process.communicate(timeout=timeout)
    return process.returncode, printed


def killed(process, after):
    """Kill a sweep and all its processes after some seconds; return whether it was still running."""
    try:
        process.communicate(timeout=after)
        return False
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        return True


def content(folder):
    """Return errors, fits and settings of the finished jobs by name."""
    found = {}
    for path in find_results(folder):
        if path.name == "results.json":
            result = json.loads(path.read_text("utf-8"))
            found[path.parent.name] = (result["errors"], result["fits"], result["provenance"]["config"])
    return found


def finished(folder):
    """Return the names of finished jobs and the time at which each finished."""
    return {path.parent.name: path.stat().st_mtime_ns for path in Path(folder).glob("*/done.json")}


def nothing_half_written(folder):
    """Assert that every result can be read and belongs to a finished job, and that every marker is complete."""
    for path in find_results(folder):
        if path.is_file():
            read_result(path)
            assert (path.parent / "done.json").exists()
    assert all(read_done(path.parent) is not None for path in Path(folder).glob("*/done.json"))


def survive(folder, kills, longest, seed=0, words=JOBS, start=started):
    """Kill a sweep at random moments and resume it; return the kills that hit it, and the finished jobs it lost."""
    moments = random.Random(seed)
    hits, lost = 0, []
    before = {}
    begun = time.monotonic()
    while hits < kills and time.monotonic() - begun < 1500:
        hit = killed(start(folder, *words), moments.uniform(0.5, longest))
        hits += hit
        nothing_half_written(folder)
        now = finished(folder)
        lost += [name for name, when in before.items() if now.get(name) != when]
        before = now
        if not hit:  # start over: nothing is left to kill
            before = {}
            for path in Path(folder).iterdir():
                subprocess.run(["rm", "-rf", str(path)], check=True)
    return hits, lost


def seconds(folder, *words):
    """Return the seconds that a sweep takes as a command."""
    start = time.perf_counter()
    status, printed = ended(started(folder, *words), timeout=3600)
    assert status == 0, printed
    return time.perf_counter() - start


def skipped(folder, counts=(4, 104)):
    """Time a sweep with nothing to do at two numbers of jobs; their difference is the cost of the jobs."""
    small = ("data.size=40", "train.size=10", "train.repetitions=1", "bootstrap=10")
    times = {}
    for count in counts:
        words = (*small, f"seed=range({count})")
        mark_finished(folder / str(count), small, count)
        times[count] = statistics.median(seconds(folder / str(count), *words) for _ in range(3))
    few, many = counts
    cost = 1000 * (times[many] - times[few]) / (many - few)
    print(f"skipped  {cost:.0f} ms a job, {times[few]:.1f} s for a sweep of {few}, {times[many]:.1f} s of {many}")


def mark_finished(folder, words, count):
    """Write the markers of finished jobs for every job of a sweep without running any."""
    from contactlearn.cli.hydra_main import compose
    from contactlearn.cli.sweeps.identity import composed_identity

    for seed in range(count):
        done = composed_identity(compose("train", [*words, f"seed={seed}"], return_hydra_config=True))
        place = folder / f"seed={seed}-{done.job}"
        with locked(place):
            finish(place, done)


def kills(folder, count):
    """Count the kills that hit a sweep and the lost jobs, and compare the results with an undisturbed sweep."""
    seconds(folder / "undisturbed", *JOBS)
    hits, lost = survive(folder / "disturbed", kills=count, longest=8, seed=16)
    seconds(folder / "disturbed", *JOBS)
    nothing_half_written(folder / "disturbed")
    same = content(folder / "disturbed") == content(folder / "undisturbed")
    print(f"kills    {hits} of {count}, {len(lost)} finished jobs lost, the same results: {same}")


def table(folder, runs):
    """Time `contactlearn results` over copies of real runs."""
    seconds(folder / "sweep", *JOBS)
    real = sorted((folder / "sweep").glob("*-*"))
    for k in range(runs):
        copy = folder / "many" / f"seed={k}-{k:012x}"
        copy.mkdir(parents=True)
        result = json.loads((real[k % len(real)] / "results.json").read_text("utf-8"))
        result["provenance"]["config"]["seed"] = k
        (copy / "results.json").write_text(json.dumps(result), "utf-8")
        done = Done(job=f"{k:012x}", config="0" * 64, data="", code="0")
        for name, text in ((".lock", ""), ("done.json", to_json(done))):
            (copy / name).write_text(text)
    start = time.perf_counter()
    command = [sys.executable, "-m", "contactlearn", "results", str(folder / "many"), "-o", str(folder / "a.parquet")]
    subprocess.run(command, check=True, capture_output=True, cwd=ROOT)
    print(f"table    of {runs} runs: {time.perf_counter() - start:.1f} s")


def main():
    """Run the chosen measurements."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--what", nargs="+", default=["skipped", "kills", "table"])
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--runs", type=int, default=10_000)
    options = parser.parse_args()
    measures = {"skipped": (skipped,), "kills": (kills, options.kills), "table": (table, options.runs)}
    for measure, *number in (measures[name] for name in options.what):
        folder = Path(tempfile.mkdtemp(prefix="sweeps-"))
        measure(folder, *number)
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()
