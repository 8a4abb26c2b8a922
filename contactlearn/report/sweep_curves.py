"""Learning curves of a sweep over train.size in TensorBoard: a line for each model and bound, as its jobs end."""

import json
from collections import defaultdict
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from statistics import fmean
from threading import Event, Thread

from contactlearn.core.errors import ContactLearnError
from contactlearn.inference.evaluation.metrics import METRICS, Interval
from contactlearn.report.tensorboard import CURVES, METRICS_FILE, Tracker, ends
from contactlearn.results.runs import ComparedRun, common_metric, read_runs
from contactlearn.results.state import DONE
from contactlearn.results.types import Evaluation, ModelErrors

FOLDER = "learning_curves"
"""Name of the folder of these curves in that of a sweep."""
_PERIOD = 2.0  # s between looks at the jobs
_UNNAMED = ("train.size", "seed", "model", "effect")  # along a line, averaged over, or in the name of the model
_OF_BOUNDS = ("data", "split_seed", "test", "bounds")  # settings that move a bound

Points = dict[tuple[str, int], Interval]
"""An error by its tag and the number of training impacts, mean over the runs that differ in their seed alone."""
Jobs = Callable[[], Mapping[Path, Sequence[str]]]
"""Gives the swept settings of each job so far by its folder, as they were typed."""


@contextmanager
def growing_curves(sweep: Path, jobs: Jobs) -> Generator[None]:
    """Log the curves of a sweep in its folder while its jobs run, and once more at the end.

    Args:
        sweep: folder of the sweep.
        jobs: of the sweep, also those that ended before it.
    """
    curves, ended = SweepCurves(sweep / FOLDER, jobs), Event()

    def watch() -> None:
        while not ended.wait(_PERIOD):
            curves.update()

    thread = Thread(target=watch, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()
        curves.update()
        curves.close()


class SweepCurves:
    """The curves of the jobs that have ended; `update` logs new points, and all again where an old one has changed."""

    def __init__(self, folder: Path, jobs: Jobs) -> None:
        self._folder, self._jobs, self._read = folder, jobs, set[Path]()
        self._runs = list[tuple[ComparedRun, Sequence[str]]]()
        self._logged, self._tracker = _logged(folder / METRICS_FILE), None

    def update(self) -> None:
        """Read the jobs that have ended since, and log their points; a disk that is full stops no sweep."""
        ended = {
            job: settings for job, settings in self._jobs().items() if (job / DONE).exists() and job not in self._read
        }
        for job, settings in ended.items():
            self._read.add(job)
            with suppress(ContactLearnError, OSError):
                self._runs += [(run, settings) for run in read_runs([job])[0] if run.trained_on is not None]
        if ended and self._runs:
            with suppress(OSError):
                self._log(points(self._runs))

    def close(self) -> None:
        """Close the file of events."""
        if self._tracker is not None:
            self._tracker.close()

    def _log(self, current: Points) -> None:
        """Log the points that are new; all of them after a changed one, or one before the end of its line."""
        latest = {tag: size for tag, size in sorted(self._logged)}
        changed = any(current.get(key) != value for key, value in self._logged.items())
        new = {key: value for key, value in current.items() if key not in self._logged}
        if not changed and not new:
            return
        if self._tracker is None:
            self._folder.mkdir(exist_ok=True)
            metric = common_metric(run for run, _ in self._runs)
            category = f"Sweep over train.size: held-out {METRICS[metric].name}"
            charts = {category: {"Each model, and both bounds": f"{CURVES}/"}}
            shown = rf"(interval/)?curve_{metric}/.+"
            self._tracker = Tracker(self._folder, 0, charts, continued=bool(self._logged), shown=shown)
        if changed or any(size < latest.get(tag, 0) for tag, size in new):
            self._tracker.begin_again()
            new = current
        for size in sorted({size for _, size in new}):
            self._tracker.scalars({tag: value for (tag, at), value in new.items() if at == size}, size)
        self._logged = current


def _logged(file: Path) -> Points:
    """The points that an earlier sweep in the folder logged; none where its file is damaged."""
    with suppress(OSError, ValueError, KeyError):
        rows = [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]
        tags = [(row, tag) for row in rows for tag in row if tag.startswith("curve_")]
        return {(tag, row["trained_on"]): Interval(row[tag], *(row.get(end) for end in ends(tag))) for row, tag in tags}
    return {}


def points(runs: Iterable[tuple[ComparedRun, Sequence[str]]]) -> Points:
    """Return the points of the lines through some runs: of their own models and bounds; of evaluations, of all laws."""
    values = defaultdict[tuple[str, int], list[Interval]](list)
    for run, settings in runs:
        for model in run.errors if isinstance(run.result, Evaluation) else (run.own, *run.bounds):
            errors, size = run.errors.get(model), run.trained_on
            if isinstance(errors, ModelErrors) and size is not None:
                line = ", ".join((model, *_named(settings, model, model in run.bounds)))
                for metric, interval in errors.intervals.items():
                    values[f"curve_{metric}/{line}", size].append(interval)
    return {key: Interval(*map(fmean, zip(*several, strict=True))) for key, several in values.items()}


def _named(settings: Iterable[str], model: str, bound: bool) -> Iterator[str]:
    """Yield the swept settings that distinguish a line from others of the same model."""
    for setting in settings:
        key, _, value = setting.partition("=")
        if key.partition(".")[0] in _OF_BOUNDS if bound else key not in _UNNAMED and value not in model:
            yield setting
