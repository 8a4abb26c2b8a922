"""Diagnoses and learning studies in processes of their own, which report events and can be cancelled.

A diagnosis is the command `diagnose`; its name is that of its run folder, which is also its result.  A study is a
learning curve, or the learned models of `configs/model`; it is this module as a program,

    python -m contactlearn.workbench.background KIND ADDRESS FILE

and its name has its kind, data and model, so it runs once however many tabs start it.  Each process appends its events
to a file (`contactlearn.diagnosis.events`), from which the page reads them.  All processes end with the server.
"""

import atexit
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from enum import StrEnum
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Lock

import torch
from threadpoolctl import threadpool_limits

from contactlearn.cli.config_files import choices
from contactlearn.cli.hydra_main import compose
from contactlearn.cli.settings import EvaluateSettings
from contactlearn.core.errors import ContactLearnError
from contactlearn.diagnosis.events import FILE, Event, append_event, read_events
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.inference.identification import joint
from contactlearn.inference.identification.joint import FitOptions
from contactlearn.inference.learning.curves import nested_orders
from contactlearn.inference.learning.events import LearningProgress
from contactlearn.inference.learning.recipe import learn
from contactlearn.workbench.commands import words_of
from contactlearn.workbench.models import STARTS, Models, mean_error
from contactlearn.workbench.session import Session

AT_ONCE = 2
"""Diagnoses that run at the same time, and studies."""
_DIAGNOSE = (sys.executable, "-m", "contactlearn", "diagnose")
_STUDY = (sys.executable, "-m", "contactlearn.workbench.background")
_ENDED = 100  # runs that have ended and are still listed
_ERROR_LINES = 6


class RunStatus(StrEnum):
    """Status of a background run."""

    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"


@dataclass(eq=False, kw_only=True)
class BackgroundRun:
    """A command in a process of its own.

    Args:
        question: the words of a diagnosis, or the session of a study.
        events_file: file of its events.
        errors_file: file of its error messages.
        process: the process.
    """

    question: tuple[str, ...] | Session
    events_file: Path
    errors_file: Path
    process: "subprocess.Popen[bytes]"
    began: float = field(default_factory=time.monotonic)
    cancelled: bool = False
    _ended: float | None = None

    @property
    def status(self) -> RunStatus:
        """Current status."""
        code = self.process.poll()
        if code is None:
            return RunStatus.RUNNING
        self._ended = self._ended or time.monotonic()
        if self.cancelled:
            return RunStatus.CANCELLED
        return RunStatus.DONE if code == 0 else RunStatus.FAILED

    @property
    def seconds(self) -> float:
        """Elapsed time."""
        return (time.monotonic() if self.status is RunStatus.RUNNING else self._ended or 0.0) - self.began

    @property
    def events(self) -> list[Event]:
        """The events so far."""
        return read_events(self.events_file)

    @property
    def error(self) -> str:
        """The last lines of the error messages."""
        lines = self.errors_file.read_text(encoding="utf-8", errors="replace").splitlines()
        return "\n".join(lines[-_ERROR_LINES:])

    def cancel(self) -> None:
        """End the process."""
        if self.process.poll() is None:
            self.cancelled = True
            self.process.terminate()


class BackgroundRuns:
    """The background runs of a server.

    Args:
        outputs: folder of the run folders.
    """

    def __init__(self, outputs: Path) -> None:
        self._outputs, self._runs, self._lock = outputs, dict[str, BackgroundRun](), Lock()
        self._scratch = TemporaryDirectory()
        atexit.register(self.close)

    def find(self, name: str) -> BackgroundRun | None:
        """Return the run of a name."""
        return self._runs.get(name)

    def diagnose(self, words: Sequence[str]) -> str:
        """Start a diagnosis with the words of a command, unless the same one is running; return its name.

        Raises:
            ContactLearnError: too many are running.
        """
        with self._lock:
            for name, run in self._runs.items():
                if run.question == tuple(words) and run.status is RunStatus.RUNNING:
                    return name
            folder = base = self._outputs / "diagnose" / datetime.now().strftime("%Y-%m-%d_%H-%M-%S")
            count = 1
            while folder.exists() or folder.name in self._runs:
                count += 1
                folder = base.with_name(f"{base.name}_{count}")
            command = [*_DIAGNOSE, *words, f"hydra.run.dir={folder}"]
            self._start(folder.name, tuple(words), command, folder / FILE)
            return folder.name

    def study(self, kind: str, session: Session, fingerprint: str) -> str:
        """Start a study of the model of a session, unless it runs or is done; return its name.

        Args:
            kind: of `STUDIES`.
            session: without choices that change neither data nor model, see `Session.model_only`.
            fingerprint: of the data.

        Raises:
            ContactLearnError: too many are running.
        """
        name = f"{kind} {fingerprint} {session.address}"
        with self._lock:
            known = self._runs.get(name)
            if known is None or known.status in (RunStatus.FAILED, RunStatus.CANCELLED):
                events = Path(self._scratch.name, f"{time.monotonic_ns()}.jsonl")
                command = [*_STUDY, kind, session.address, str(events)]
                self._start(name, session, command, events)
        return name

    def _start(self, name: str, question: tuple[str, ...] | Session, command: list[str], events: Path) -> None:
        kind = type(question)
        running = [run for run in self._runs.values() if type(run.question) is kind and run.status is RunStatus.RUNNING]
        if len(running) >= AT_ONCE:
            plural = "studies" if kind is Session else "diagnoses"
            raise ContactLearnError(f"{len(running)} {plural} are running; wait for one, or cancel it")
        ended = [key for key, run in self._runs.items() if run.status is not RunStatus.RUNNING]
        for key in (name, *ended[: max(0, len(ended) - _ENDED)]):
            self._runs.pop(key, None)
        errors = Path(self._scratch.name, f"{time.monotonic_ns()}.txt")
        with errors.open("wb") as file:
            process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=file)
        self._runs[name] = BackgroundRun(question=question, events_file=events, errors_file=errors, process=process)

    def close(self) -> None:
        """Cancel all running processes."""
        for run in self._runs.values():
            run.cancel()


# --- Studies -----------------------------------------------------------------------------------

ALONE, MODEL = "alone", "model"
"""The law alone and the model, in a learning curve."""
_SUBSETS, _SIZES = 6, (10, 20, 50, 100, 200, 500, 1000)  # of a learning curve
_Points = tuple[tuple[int, Interval], ...]


def curve_steps(models: Models, session: Session) -> Iterator[LearningProgress]:
    """Fit the law alone and the model to several random subsets of each size, nested in each other."""
    data, fitted = models.split(session), models.fitted(session)
    orders = nested_orders(len(data.pool), _SUBSETS, torch.Generator().manual_seed(session.seed))
    least = 2 * len(fitted.fit.parameters) + 8
    sizes = [size for size in (*_SIZES, len(data.pool)) if least <= size <= len(data.pool)]
    errors: dict[str, _Points] = {ALONE: (), MODEL: ()}
    for done, size in enumerate(sizes):
        yield LearningProgress(done=done, total=len(sizes), errors=dict(errors))
        rows = orders[:, :size] if size < len(data.pool) else orders[:1]
        for name, one in ((ALONE, models.law_alone(session)), (MODEL, fitted)):
            fit = joint.fit(data.pool, one.law, one.effects, rows=rows, options=FitOptions(starts=STARTS))
            errors[name] += ((size, mean_error(data.test, fit.model.predict(data.test))),)
    yield LearningProgress(done=len(sizes), total=len(sizes), errors=errors)


def learned_steps(models: Models, session: Session) -> Iterator[LearningProgress]:
    """Train every learned model on the training part, those with a law around the model of the session."""
    data, fitted = models.split(session), models.fitted(session)
    names = ",".join(choices("model"))
    recipes = EvaluateSettings.from_config(compose("evaluate", [*words_of(session), f"model=[{names}]"])).learnable
    errors: dict[str, _Points] = {}
    for done, (name, recipe) in enumerate(recipes.items()):
        yield LearningProgress(done=done, total=len(recipes), errors=dict(errors))
        model = learn(data.pool, recipe, rows=torch.arange(len(data.pool)), base=fitted.model if recipe.law else None)
        errors[name] = ((len(data.pool), mean_error(data.test, model.predict(data.test))),)
    yield LearningProgress(done=len(recipes), total=len(recipes), errors=errors)


STUDIES: Mapping[str, Callable[[Models, Session], Iterator[LearningProgress]]] = {
    "curve": curve_steps,
    "learned": learned_steps,
}
"""The studies by kind."""


def run_study(kind: str, address: str, file: str) -> int:
    """Write the events of a study; return the exit status."""
    torch.set_num_threads(1)
    threadpool_limits(1)
    try:
        for step in STUDIES[kind](Models(), Session.read(address)):
            append_event(Path(file), step)
    except ContactLearnError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(run_study(*sys.argv[1:]))
