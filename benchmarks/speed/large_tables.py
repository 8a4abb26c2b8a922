"""Cost and memory of commands on large tables and files.

    python benchmarks/speed/large_tables.py [--what evaluation command sparse diagnosis usual]
        [--sizes 1e3 1e4 1e5 1e6 1e7] [--folder DIR]

evaluation  reads a Parquet table in blocks, predicts every impact by six laws and two bounds, adds up errors and
            writes all predictions, for each size
command     `evaluate.py` on the largest table
sparse      `train.py` with 1e6 training impacts, or half the largest size if that is less
diagnosis   `diagnose.py` on mystery drops of every size from 1e3 to 1e6, and whether it names the hidden effects
usual       `diagnose` on 400 mystery drops with one to three effects, five of each, and on the published drops

Each is a process of its own.  Seconds of processor time hold on a busy machine too; those of the clock do not.
"""

import argparse
import json
import math
import os
import random
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
SEED = 7


def write_drops(folder: Path, size: int) -> Path:
    """Write a table of so many drops in blocks, once for all calls."""
    from contactlearn.data import table
    from contactlearn.simulation import synthetic

    path = folder / f"drops_{size}.parquet"
    return path if path.exists() else table.save(synthetic.many(size), path)


def evaluate_all(path: Path) -> None:
    """Print trials, seconds of the processor and peak memory in MB of an evaluation of all impacts of a table."""
    evaluate(write_drops(path.parent, 300))  # imports and first calls
    trials, before, start, repeats = 0, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time(), 0
    while time.process_time() - start < 2:  # a small table several times
        trials = evaluate(path)
        repeats += 1
    seconds, peak = (time.process_time() - start) / repeats, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(json.dumps([trials, seconds, peak / 1e3, before / 1e3]))


def evaluate(path: Path) -> int:
    """Evaluate all impacts of a table, and return their number."""
    from contactlearn import laws
    from contactlearn.data.table import table_blocks
    from contactlearn.inference.evaluation import bounds
    from contactlearn.inference.evaluation.metrics import ErrorSums
    from contactlearn.laws import PAPER_LAWS
    from contactlearn.mechanics.impacts import Impacts, Prediction
    from contactlearn.models.contact_model import ContactModel
    from contactlearn.results.tables import save_predictions

    models = {name: ContactModel(laws.find(name).at(0.12, 0.55)) for name in PAPER_LAWS}
    blocks, sums = table_blocks(path, None), ErrorSums((*models, "best_post_hoc", "irb"))

    def predicted() -> Iterator[tuple[Impacts, dict[str, Prediction]]]:
        for impacts in blocks.read():
            found = {name: model.predict(impacts) for name, model in models.items()}
            found["best_post_hoc"] = bounds.best_post_hoc(impacts, found)[0]
            found["irb"] = bounds.irb(impacts)
            sums.add(impacts, found)
            yield impacts, found

    with tempfile.TemporaryDirectory(dir=path.parent) as out:
        save_predictions(predicted(), Path(out) / "predictions.parquet")
    return sums.trials


def evaluation(folder: Path, sizes: list[int]) -> None:
    """Print the cost of each size, and the slope of its logarithm between neighbours and over the whole range."""
    rows = []
    for size in sizes:
        words = [sys.executable, __file__, "--one", str(write_drops(folder, size))]
        done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True)
        trials, seconds, peak, before = json.loads(done.stdout.splitlines()[-1])
        slope = f"{math.log(seconds / rows[-1][1]) / math.log(trials / rows[-1][0]):5.2f}" if rows else "     "
        rows.append((trials, seconds))
        print(
            f"evaluation {trials:>9} impacts: {seconds:8.2f} s, {1e6 * seconds / trials:6.1f} µs each, slope {slope}, "
            f"peak {peak:5.0f} MB (of which {before:.0f} before anything was read)",
            flush=True,
        )
    if len(rows) > 1:
        (few, first), (many, last) = rows[0], rows[-1]
        slope, decades = math.log(last / first) / math.log(many / few), math.log10(many / few)
        print(f"slope {slope:.3f} over {decades:.1f} decades (required: 0.9 to 1.1)")


def run(name: str, *words: str) -> str:
    """Run a command; return its seconds and its peak memory in words."""
    start = time.monotonic()
    call = [sys.executable, "-m", "contactlearn", name, *words]
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    process = subprocess.Popen(call, cwd=ROOT, stdout=subprocess.DEVNULL, env=environment)
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    assert process.returncode == 0, words
    busy, wall = used.ru_utime + used.ru_stime, time.monotonic() - start
    return f"{busy:.0f} s of the processor, {wall:.0f} s by the clock, peak {used.ru_maxrss * 1024 / 1e9:.2f} GB"


def command(folder: Path, sizes: list[int]) -> None:
    """Evaluate the laws on the largest table; required: 600 s and 2 GB."""
    path = write_drops(folder, sizes[-1])
    words = "data=table", f"data.path={path}", "model=[]", f"hydra.run.dir={tempfile.mkdtemp(dir=folder)}/run"
    print(f"evaluate.py on {path.name}: {run('evaluate', *words)}", flush=True)


def sparse(folder: Path, sizes: list[int]) -> None:
    """Train sparse processes; required: 600 s."""
    size, path = min(10**6, sizes[-1] // 2), write_drops(folder, min(sizes[-1], 2 * 10**6))
    words = "model=residual_wrench", f"train.size={size}", "threads=2", "test=0.05"
    out = tempfile.mkdtemp(dir=folder)
    spent = run("train", "data=table", f"data.path={path}", *words, f"hydra.run.dir={out}/run")
    print(f"train.py with {size} of {path.name}: {spent}", flush=True)


def diagnosis(folder: Path, sizes: list[int]) -> None:
    """Diagnose mystery drops; required of 100 000 trials: 120 s and 2 GB."""
    from contactlearn.data import table
    from contactlearn.simulation import hidden_effects

    for size in [size for size in sizes if size <= 10**6]:
        path, out = folder / f"mystery_{size}.parquet", Path(tempfile.mkdtemp(dir=folder), "run")
        impacts, truth = hidden_effects.draw(SEED, size=size)
        table.save(impacts, path)
        a, b = impacts.shape.semi_axes
        del impacts
        shape = f"data.shape={{kind:ellipse,semi_axes:[{a},{b}]}}"
        spent = run("diagnose", "data=table", f"data.path={path}", shape, f"hydra.run.dir={out}")
        found = json.loads((out / "diagnosis.json").read_text())["diagnosis"]
        sample = found["sample"]
        trials = size if sample is None else sample["answers"][-1]["trials"]
        error = found["budget"]["named"] if sample is None else sample["confirmation"]["named"]
        names = ", ".join(one["effect"]["name"] for one in found["missing"]) or "nothing"
        print(
            f"diagnose.py on {size} trials, {trials} used: {spent}, page "
            f"{(out / 'report.html').stat().st_size / 1e6:.1f} MB\n"
            f"    {found['law']}: {names} ({found['verdict']}), error {error['mean']:.4f}; "
            f"hidden: {', '.join(one['name'] for one in truth['effects'])}",
            flush=True,
        )


def usual(folder: Path, sizes: list[int]) -> None:
    """Diagnose tables of the usual size; required of two idle cores: 5 s in the median, 8 s at most, published 25 s."""
    from contactlearn.data import ellipse_drops
    from contactlearn.diagnosis.pipeline import diagnose
    from contactlearn.simulation import hidden_effects

    names, tables = sorted(hidden_effects.EFFECTS), {"1718 published drops": [ellipse_drops.load()]}
    for count in (1, 2, 3):
        chosen = [random.Random(100 * count + seed).sample(names, count) for seed in range(5)]
        drawn = [hidden_effects.draw(100 * count + k, size=400, effects=some)[0] for k, some in enumerate(chosen)]
        tables[f"400 trials, {count} effects"] = drawn
    for name, some in tables.items():
        busy, wall = zip(*(cost(diagnose, impacts) for impacts in some), strict=True)
        for words, seconds in (("processor", busy), ("clock", wall)):
            print(
                f"{name}, s of the {words}: median {statistics.median(seconds):.1f}, most {max(seconds):.1f}",
                flush=True,
            )


def cost(function: Callable[[Any], object], impacts: Any) -> tuple[float, float]:
    """Return the seconds of the processor, those of copies of this process among them, and of the clock."""
    before = os.times()
    function(impacts)
    spent = [now - then for now, then in zip(os.times(), before, strict=True)]
    return sum(spent[:4]), spent[4]


def main() -> None:
    """Run the chosen measurements."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    by_size = {"evaluation": evaluation, "command": command, "sparse": sparse, "diagnosis": diagnosis, "usual": usual}
    parser.add_argument("--what", nargs="+", default=[*by_size], choices=by_size)
    parser.add_argument("--sizes", nargs="+", type=lambda x: int(float(x)), default=[10**k for k in range(3, 8)])
    parser.add_argument("--folder", type=Path, help="for tables and results; they are not deleted")
    parser.add_argument("--one", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one is not None:
        evaluate_all(options.one)
        return
    folder = options.folder or Path(tempfile.mkdtemp())
    folder.mkdir(parents=True, exist_ok=True)
    for what in options.what:
        by_size[what](folder, sorted(options.sizes))


if __name__ == "__main__":
    main()
