"""Diagnoses in processes of their own: the command `diagnose`, whose run folder is the result.

A job is named by its run folder.  It goes on when the page is closed, ends with the server or when it is cancelled,
and what it has written stays.  The lines that it prints are its progress.
"""

import atexit
import os
import subprocess
import sys
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import datetime
from enum import StrEnum
from pathlib import Path
from threading import Lock, Thread

from contactlearn.core.errors import ContactLearnError

SIDE_BY_SIDE = 2
"""Processes that run at a time."""
_COMMAND = (sys.executable, "-m", "contactlearn", "diagnose")
_LINES = 200
_STAGES = (
    "audit",
    "law",
    "budget",
    "frontier",
    "residual",
    "verdict",
    "results",
)  # of a diagnosis, by their first lines


class RunStatus(StrEnum):
    """Where a job stands."""

    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"


@dataclass(eq=False)
class BackgroundRun:
    """A diagnosis in a process of its own, with the lines that it has printed."""

    words: tuple[str, ...]
    folder: Path
    process: "subprocess.Popen[str]"
    began: float = field(default_factory=time.monotonic)
    ended: float | None = None
    lines: deque[str] = field(default_factory=lambda: deque(maxlen=_LINES))
    cancelled: bool = False

    @property
    def status(self) -> RunStatus:
        """Where it stands."""
        code = self.process.poll()
        if code is None:
            return RunStatus.RUNNING
        if self.cancelled:
            return RunStatus.CANCELLED
        return RunStatus.DONE if code == 0 else RunStatus.FAILED

    @property
    def seconds(self) -> float:
        """Time that it has taken."""
        return (self.ended or time.monotonic()) - self.began

    @property
    def progress(self) -> float:
        """Share of the stages that have been reached."""
        reached = {line.partition(" ")[0].rstrip(":") for line in list(self.lines)}
        return max((k for k, stage in enumerate(_STAGES, 1) if stage in reached), default=0) / len(_STAGES)

    def follow(self) -> None:
        """Keep the lines that the process prints, until it ends."""
        assert self.process.stdout is not None  # a pipe
        for line in self.process.stdout:
            if line.strip():
                self.lines.append(line.rstrip())
        self.process.wait()
        self.ended = time.monotonic()

    def cancel(self) -> None:
        """End the process."""
        if self.process.poll() is None:
            self.cancelled = True
            self.process.terminate()


class Jobs:
    """The jobs of a server.

    Args:
        outputs: folder of the runs.
    """

    def __init__(self, outputs: Path) -> None:
        self._outputs, self._jobs, self._lock = outputs, dict[str, BackgroundRun](), Lock()
        atexit.register(self.close)

    def start(self, words: Sequence[str]) -> BackgroundRun:
        """Start a diagnosis with the words of a command; one that is running with the same words is joined.

        Raises:
            ContactLearnError: too many are running.
        """
        with self._lock:
            running = [job for job in self._jobs.values() if job.status is RunStatus.RUNNING]
            for job in running:
                if job.words == tuple(words):
                    return job
            if len(running) >= SIDE_BY_SIDE:
                raise ContactLearnError(f"{len(running)} diagnoses are running; wait for one, or cancel it")
            folder = self._folder()
            process = subprocess.Popen(
                [*_COMMAND, *words, f"hydra.run.dir={folder}"],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                encoding="utf-8",
                env=os.environ | {"PYTHONUNBUFFERED": "1"},  # its lines are seen as they come
            )
            job = BackgroundRun(tuple(words), folder, process)
            self._jobs[folder.name] = job
        Thread(target=job.follow, daemon=True).start()
        return job

    def find(self, name: str) -> BackgroundRun | None:
        """Return the job that writes a run folder of this name."""
        return self._jobs.get(name)

    def close(self) -> None:
        """Cancel what is running."""
        for job in self._jobs.values():
            job.cancel()

    def _folder(self) -> Path:
        """A run folder that nothing else writes to."""
        base = self._outputs / "diagnose" / datetime.now().strftime("%Y-%m-%d_%H-%M-%S")
        folder, count = base, 1
        while folder.exists() or folder.name in self._jobs:
            count += 1
            folder = base.with_name(f"{base.name}_{count}")
        return folder
