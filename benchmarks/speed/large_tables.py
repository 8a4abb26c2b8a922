"""Tables of any length: cost and memory of an evaluation against the number of impacts, and sparse processes on many.

    python benchmarks/speed/large_tables.py [--what evaluation command sparse] [--sizes 1e3 1e4 1e5] [--folder DIR]

`evaluation` reads a Parquet table in blocks, predicts every impact by six laws and two bounds, adds up errors and
writes all predictions.  `command` is `evaluate.py` on the same table, `sparse` is `train.py` with 1e6 training impacts
(or the largest size, if that is less).  Each is a process of its own; times are of the processor (user and system), so
that other work on the machine changes them little.  Numbers that were asked for stand beside them.
"""

import argparse
import json
import math
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def made(folder: Path, size: int) -> Path:
    """A table of so many drops; written in blocks, and kept for the next call."""
    from contactlearn.data import table
    from contactlearn.simulation import synthetic

    path = folder / f"drops_{size}.parquet"
    return path if path.exists() else table.save(synthetic.many(size), path)


def evaluate_all(path: Path) -> None:
    """Print trials, seconds of the processor and peak memory in MB of an evaluation of all impacts of a table."""
    few = made(path.parent, 300)
    evaluated(few)  # imports and first calls
    trials, before, start, repeats = 0, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time(), 0
    while time.process_time() - start < 2:  # a small table several times
        trials = evaluated(path)
        repeats += 1
    seconds, peak = (time.process_time() - start) / repeats, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(json.dumps([trials, seconds, peak / 1e3, before / 1e3]))


def evaluated(path: Path) -> int:
    """Evaluate all impacts of a table, and return how many they are."""
    from contactlearn import laws
    from contactlearn.data.table import table_blocks
    from contactlearn.inference.evaluation import bounds
    from contactlearn.inference.evaluation.sums import ErrorSums
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
    """Cost of each size, and the slope of its logarithm over the whole range and between neighbours."""
    rows = []
    for size in sizes:
        words = [sys.executable, __file__, "--one", str(made(folder, size))]
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
        print(
            f"slope {math.log(last / first) / math.log(many / few):.3f} over {math.log10(many / few):.1f} decades "
            "(0.9–1.1)"
        )


def as_command(name: str, folder: Path, path: Path, *words: str) -> None:
    """Cost of a command on a table; asked for: ≤ 600 s and ≤ 2000 MB."""
    out = tempfile.mkdtemp(dir=folder)
    call = [sys.executable, f"{name}.py", "data=table", f"data.path={path}", *words, f"hydra.run.dir={out}/run"]
    code = "import resource, subprocess, sys; subprocess.run(sys.argv[1:], check=True, stdout=2); "
    code += "used = resource.getrusage(resource.RUSAGE_CHILDREN); print(used.ru_utime + used.ru_stime, used.ru_maxrss)"
    start = time.monotonic()
    done = subprocess.run([sys.executable, "-c", code, *call], cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)
    seconds, peak = map(float, done.stdout.split())
    wall = time.monotonic() - start
    print(f"{name}.py on {path.name}: {seconds:.0f} s of the processor, {wall:.0f} s in all, peak {peak / 1e3:.0f} MB")


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--what", nargs="+", default=["evaluation", "command", "sparse"])
    parser.add_argument("--sizes", nargs="+", type=lambda x: int(float(x)), default=[10**k for k in range(3, 8)])
    parser.add_argument("--folder", type=Path, help="for tables and results; they stay there")
    parser.add_argument("--one", type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.one is not None:
        evaluate_all(args.one)
        return
    folder = args.folder or Path(tempfile.mkdtemp())
    folder.mkdir(parents=True, exist_ok=True)
    largest = max(args.sizes)
    if "evaluation" in args.what:
        evaluation(folder, sorted(args.sizes))
    if "command" in args.what:
        as_command("evaluate", folder, made(folder, largest), "model=[]")
    if "sparse" in args.what:
        size = min(10**6, largest // 2)
        words = "model=residual_wrench", f"train.size={size}", "threads=2", "test=0.05"
        as_command("train", folder, made(folder, min(largest, 2 * 10**6)), *words)


if __name__ == "__main__":
    main()
