"""Studies in processes of their own: the page stays quick, and a study that is cancelled ends at once.

A study is known by its kind, the data and the model, so it runs once however many tabs ask for it; what it found is
kept until many others have followed.
"""

import contextlib
import time
from dataclasses import replace
from multiprocessing import get_context
from multiprocessing.connection import Connection
from threading import Lock, Thread

import torch
from threadpoolctl import threadpool_limits

from contactlearn.core.errors import ContactLearnError
from contactlearn.core.workers import without_interrupts
from contactlearn.workbench.jobs import SIDE_BY_SIDE, RunStatus
from contactlearn.workbench.models import Models
from contactlearn.workbench.session import Session
from contactlearn.workbench.studies import STUDIES, StudyStep

_KEPT = 100


class StudyRun:
    """A study in a process of its own; `step` is the last one, `trouble` the error that ended it."""

    def __init__(self, kind: str, session: Session) -> None:
        # A new process instead of a forked one: a fork copies the threads' locks, but not the threads.
        context = get_context("spawn")
        self._receiver, sender = context.Pipe(duplex=False)
        self.session, self.began, self.ended = session, time.monotonic(), 0.0
        self.step: StudyStep | None = None
        self.trouble, self.cancelled = "", False
        self.process = context.Process(target=_work, args=(kind, session, sender), daemon=True)
        with without_interrupts():
            self.process.start()
        sender.close()
        self._reader = Thread(target=self._follow, daemon=True)
        self._reader.start()

    @property
    def status(self) -> RunStatus:
        """Where it stands; it runs until its last step has been read."""
        if self.cancelled:
            return RunStatus.CANCELLED
        if self._reader.is_alive():
            return RunStatus.RUNNING
        finished = self.step is not None and self.step.done == self.step.total
        return RunStatus.DONE if finished else RunStatus.FAILED

    @property
    def seconds(self) -> float:
        """Time that it has taken."""
        return (self.ended or time.monotonic()) - self.began

    def cancel(self) -> None:
        """End the process."""
        if self.status is RunStatus.RUNNING:
            self.cancelled = True
            self.process.terminate()

    def wait(self, seconds: float) -> None:
        """Wait until it has ended, for some seconds at most."""
        self._reader.join(seconds)

    def _follow(self) -> None:
        with contextlib.suppress(EOFError):
            while True:
                said: StudyStep | str = self._receiver.recv()
                if isinstance(said, StudyStep):
                    self.step = said
                else:
                    self.trouble = said
        self.process.join()
        self.ended = time.monotonic()


class StudyRuns:
    """The studies of a server."""

    def __init__(self, models: Models) -> None:
        self._models, self._tasks, self._lock = models, dict[str, StudyRun](), Lock()

    def start(self, kind: str, session: Session) -> str:
        """Start a study of the model of a session, unless it runs or is done; return its name.

        Raises:
            ContactLearnError: the model cannot be fitted, or too many studies are running.
        """
        self._models.fitted(session)
        session = studied(session)
        name = f"{kind} {self._models.fingerprint(session)} {session.address}"
        with self._lock:
            known = self._tasks.get(name)
            if known is not None and known.status in (RunStatus.RUNNING, RunStatus.DONE):
                return name
            running = [task for task in self._tasks.values() if task.status is RunStatus.RUNNING]
            if len(running) >= SIDE_BY_SIDE:
                raise ContactLearnError(f"{len(running)} studies are running; wait for one, or cancel it")
            ended = [key for key, task in self._tasks.items() if task.status is not RunStatus.RUNNING]
            for key in (name, *ended[: max(0, len(ended) - _KEPT)]):
                self._tasks.pop(key, None)
            self._tasks[name] = StudyRun(kind, session)
        return name

    def find(self, name: str) -> StudyRun | None:
        """Return the study of a name, if it is known."""
        return self._tasks.get(name)


def studied(session: Session) -> Session:
    """Return data and model of a session alone."""
    return replace(session, hand=(), trial=None, windows=())


def _work(kind: str, session: Session, sender: Connection) -> None:
    """Send the steps of a study, or the error that ended it."""
    torch.set_num_threads(1)
    threadpool_limits(1)
    try:
        for step in STUDIES[kind](Models(), session):
            sender.send(step)
    except ContactLearnError as error:
        sender.send(str(error))
