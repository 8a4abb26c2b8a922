"""Estimates of memory and disk before a long step, which then uses fewer trials, fewer jobs or smaller tables."""

import os
import shutil
from pathlib import Path

from contactlearn.core.errors import ContactLearnError

GIB = 2**30
FITTED = 20_000
"""Trials that laws and effects are fitted to, and subsets are drawn from: a random sample of a larger pool."""
MEMORY_PER_BYTE = 10.0
"""Bytes of memory that reading a whole table takes for each byte of its file."""
_TRAINED = 4000.0  # bytes of memory a training trial: measurements, features and sums of three sparse processes
_WRITTEN = 110.0  # bytes on disk a prediction of one model
_CGROUP = Path("/sys/fs/cgroup")


def affordable_train_size(wanted: int | None) -> int | None:
    """Return a number of training trials, lowered to what memory allows; a lower number is printed."""
    free = available_memory()
    if wanted is None or free is None or wanted * _TRAINED <= free / 2:
        return wanted
    from contactlearn.report.terminal import print_line  # which loads torch

    most = int(free / 2 / _TRAINED)
    print_line(
        f"train.size={wanted} would take about {wanted * _TRAINED / GIB:.1f} GiB of memory, and {free / GIB:.1f} are "
        f"free: {most} trials are used"
    )
    return most


def refuse_too_large(needed: float, why: str) -> None:
    """Refuse a step that needs more memory than there is.

    Raises:
        ContactLearnError: more bytes are needed than there is memory.
    """
    free = available_memory()
    if free is not None and needed > free:
        raise ContactLearnError(
            f"{why}, which takes about {needed / GIB:.1f} GiB of memory, and {free / GIB:.1f} are free; correct the "
            "table itself, or take a part of it"
        )


def fits_on_disk(folder: Path, predictions: int) -> bool:
    """Return whether tables of so many predictions have room in a folder; if not, print what is written instead."""
    needed, free = predictions * _WRITTEN, shutil.disk_usage(folder).free
    if needed > free / 2:
        from contactlearn.report.terminal import print_line

        print_line(
            f"{predictions} predictions would take about {needed / GIB:.1f} GiB on disk, and {free / GIB:.1f} are "
            "free: those of the trials that the page shows are written"
        )
    return needed <= free / 2


def jobs_at_a_time(wanted: int, gigabytes: float) -> int:
    """Return how many jobs to run side by side, at least one.

    Args:
        wanted: number of jobs; -1 for one a core.
        gigabytes: memory of one job, GiB.
    """
    jobs = wanted if wanted > 0 else usable_cores()
    free = available_memory()
    return jobs if free is None else max(1, min(jobs, int(free / (gigabytes * GIB))))


def usable_cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def available_memory() -> float | None:
    """Return the bytes of memory that this process and its jobs may take; None where the system does not report it.

    It is the memory that is free on the machine, or in the control group that limits the process.
    """
    limits: list[float] = []
    try:
        lines = Path("/proc/meminfo").read_text("ascii").splitlines()
        limits += [1024.0 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable:")]
        limit, used = ((_CGROUP / name).read_text("ascii") for name in ("memory.max", "memory.current"))
        limits += [] if limit.strip() == "max" else [float(limit) - float(used)]
    except OSError:
        pass
    return min(limits, default=None)
