"""Sweeps: jobs that are skipped, all cores against one, kills that are survived, and the table of thousands of runs.

    python benchmarks/sweeps.py [--what skipped cores kills table] [--kills 50] [--jobs 32] [--runs 10000]

`cores` needs contactlearn[joblib].  A kill is SIGKILL to the whole sweep at a random moment; after each, the same
command
goes on, and nothing finished may be lost.  Numbers that were asked for stand beside each line.
"""

import argparse
import importlib.util
import json
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from contactlearn.core.serialisation import to_json
from contactlearn.results.state import Done, finish, held
from studies.sweeps import JOBS, content, ended, nothing_half_written, started, survive

ROOT = Path(__file__).parent.parent
CORES = {"short": (800, 300), "long": (2400, 1200)}  # trials and training trials of a job


def timed(folder, *words, status=0):
    """Seconds that a sweep takes as a command, and what it printed."""
    start = time.perf_counter()
    found, printed = ended(started(folder, *words), timeout=3600)
    assert found == status, printed
    return time.perf_counter() - start, printed


def skipped(folder, counts=(8, 1008)):
    """Seconds of a sweep with nothing to do, at two numbers of jobs: their difference is the cost of the jobs."""
    small = ("data.size=40", "train.size=10", "train.repetitions=1", "bootstrap=10")
    times = {}
    for count in counts:
        words = (*small, f"seed=range({count})")
        _made(folder / str(count), words, count)
        times[count] = statistics.median(timed(folder / str(count), *words)[0] for _ in range(5))
    few, many = counts
    cost = 1000 * (times[many] - times[few]) / (many - few)
    print(f"skipped  {cost:.2f} ms a job (≤ 5), {times[few]:.1f} s for a sweep of {few}, {times[many]:.1f} s of {many}")


def _made(folder, words, count):
    """Markers as finished jobs leave them, for every job of a sweep; the jobs themselves are not run."""
    from omegaconf import OmegaConf

    from contactlearn.cli.hydra_main import compose
    from contactlearn.cli.sweeps.identity import code_version, typed

    cfg = compose("train", [], return_hydra_config=True)
    OmegaConf.set_struct(cfg, False)
    for seed in range(count):
        job = [*words[:-1], f"seed={seed}"]
        digest = f"{seed:012x}"
        done = Done(job=digest, config="0" * 64, data="", code=code_version(), words=typed(cfg.hydra, job))
        place = folder / f"seed={seed}-{digest}"
        with held(place):
            finish(place, done)


def cores(folder, jobs):
    """One process after the other against all cores, in turn, twice each; for short jobs and for long ones."""
    if importlib.util.find_spec("hydra_plugins.hydra_joblib_launcher") is None:
        print("cores    left out: needs contactlearn[joblib]")
        return
    for kind, (trials, trained) in CORES.items():
        words = ("model=residual_wrench", f"data.size={trials}", f"train.size={trained}", f"seed=range({jobs})")
        times = {"basic": [], "joblib": []}
        for turn in range(2):
            for launcher, found in times.items():
                where = folder / f"{kind}-{launcher}{turn}"
                found.append(timed(where, *words, f"hydra/launcher={launcher}")[0])
        one, all_ = (min(found) for found in times.values())
        print(
            f"cores    {jobs} {kind} jobs of {one / jobs:.1f} s: {one:.0f} s one by one, {all_:.0f} s on all cores, "
            f"{one / all_:.2f} times (≥ 1.8)"
        )


def kills(folder, count):
    """Kills that hit a sweep, what was lost, and whether the results are those of an undisturbed one."""
    timed(folder / "undisturbed", *JOBS)
    hits, lost = survive(folder / "disturbed", kills=count, longest=8, seed=16)
    timed(folder / "disturbed", *JOBS)
    nothing_half_written(folder / "disturbed")
    same = content(folder / "disturbed") == content(folder / "undisturbed")
    print(f"kills    {hits} of {count}, {len(lost)} finished jobs lost, the same results: {same}")


def table(folder, runs):
    """Seconds of `contactlearn results` over copies of real runs."""
    timed(folder / "sweep", *JOBS)
    real = sorted((folder / "sweep").glob("*-*"))
    for k in range(runs):
        copy = folder / "many" / f"seed={k}-{k:012x}"
        copy.mkdir(parents=True)
        content = json.loads((real[k % len(real)] / "results.json").read_text("utf-8"))
        content["provenance"]["config"]["seed"] = k
        (copy / "results.json").write_text(json.dumps(content), "utf-8")
        done = Done(job=f"{k:012x}", config="0" * 64, data="", code="0")
        for name, text in ((".lock", ""), ("done.json", to_json(done))):
            (copy / name).write_text(text)
    for what, words in {"table": ["results", "-o", str(folder / "a.parquet")], "page": ["report"]}.items():
        start = time.perf_counter()
        command = [sys.executable, "-m", "contactlearn", *words[:1], str(folder / "many"), *words[1:]]
        subprocess.run(command, check=True, capture_output=True, cwd=ROOT)
        print(f"table    {what} of {runs} runs: {time.perf_counter() - start:.1f} s")
    page = folder / "many" / "report.html"
    print(f"table    the page has {page.stat().st_size / 2**20:.1f} MB")


def main():
    """Measure what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--what", nargs="+", default=["skipped", "cores", "kills", "table"])
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--jobs", type=int, default=32)
    parser.add_argument("--runs", type=int, default=10_000)
    options = parser.parse_args()
    number = {"kills": options.kills, "cores": options.jobs, "table": options.runs}
    for name in options.what:
        folder = Path(tempfile.mkdtemp(prefix="sweeps-"))
        measure = {"skipped": skipped, "cores": cores, "kills": kills, "table": table}[name]
        measure(folder, *([number[name]] if name in number else []))
        shutil.rmtree(folder)


if __name__ == "__main__":
    main()
