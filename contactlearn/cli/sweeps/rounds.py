"""Runs the jobs that are left through a launcher, and judges them by what they left on disk.

The return values of a launcher count for little: one killed job takes those of the others with it.  A job that fails
says so in its folder, or in its return value where the disk is full, and the others go on.  Where a launcher itself
breaks down, since a job was killed for its memory, say, jobs that had not begun are launched again, and those that had
begun are, each alone.
"""

import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from contactlearn.cli.sweeps.jobs import Job
from contactlearn.results.state import FAILED, begun, is_held, read_failed

Launch = Callable[[Sequence[Job]], Sequence[str | None]]
"""Runs jobs, and returns the reason of each that failed."""
_POLL = 0.5  # s between looks at a job that another process runs
_LAUNCHES = 3  # of a job that does not begin, at most
_SILENT = "ended without a result and without a word; was it killed?"


@dataclass
class Outcome:
    """What became of launched jobs: those that failed with the reason, and those that may still wait in a queue."""

    finished: list[Job] = field(default_factory=list)
    failed: list[tuple[Job, str]] = field(default_factory=list)
    queued: list[Job] = field(default_factory=list)


def run_jobs(jobs: Sequence[Job], launch: Launch, at_once: int | None, queues: bool) -> Outcome:
    """Run jobs until each is finished or has failed.

    Args:
        jobs: to run.
        launch: runs several jobs and returns when they have ended; an exception is its breakdown.
        at_once: jobs to launch at a time; None for all.
        queues: whether jobs go on by themselves after a breakdown, so that they must not be launched again.
    """
    outcome, launches = Outcome(), Counter[Path]()
    size = at_once or max(1, len(jobs))
    batches = deque(list(jobs[k : k + size]) for k in range(0, len(jobs), size))
    while batches:
        batch = batches.popleft()
        before = {job.folder: begun(job.folder) for job in batch}
        said, trouble = _launched(batch, launch)
        left = [job for job, words in zip(batch, said, strict=True) if not _settled(job, words, outcome)]
        moved = {job.folder for job in left if begun(job.folder) != before[job.folder]}
        launches.update(job.folder for job in left if not moved and len(left) == len(batch))
        if trouble is not None and queues:
            outcome.queued += left
        elif trouble is not None and not moved and len(left) == len(batch):
            outcome.failed += [(job, f"could not be launched: {trouble}") for job in left]
        else:
            alone = moved if len(batch) == 1 else set[Path]()
            lost = [job for job in left if launches[job.folder] == _LAUNCHES or job.folder in alone]
            outcome.failed += [(job, _SILENT) for job in lost]
            left = [job for job in left if job not in lost]
            batches += [[job] for job in left if job.folder in moved]
            batches += [together] if (together := [job for job in left if job.folder not in moved]) else []
    return outcome


def _launched(batch: Sequence[Job], launch: Launch) -> tuple[Sequence[str | None], str | None]:
    """Launch jobs; what each says of its failure, and the first line of what broke the launcher down."""
    for job in batch:
        (job.folder / FAILED).unlink(missing_ok=True)
    try:
        return launch(batch), None
    except Exception as error:
        return [None] * len(batch), (str(error).strip() or type(error).__name__).splitlines()[0]


def _settled(job: Job, said: str | None, outcome: Outcome) -> bool:
    """Enter a job that finished or failed; one that another process runs is waited for, since it may be killed."""
    while is_held(job.folder):
        time.sleep(_POLL)
    failed = read_failed(job.folder)
    if job.finished:
        outcome.finished.append(job)
    elif failed is not None or said is not None:
        outcome.failed.append((job, failed.reason if failed is not None else str(said)))
    else:
        return False
    return True
