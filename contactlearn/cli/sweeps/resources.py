"""How many jobs may run at a time on this machine: as many as there are cores, and as memory allows."""

import os
from pathlib import Path

GIB = 2**30
_CGROUP = Path("/sys/fs/cgroup")


def jobs_at_a_time(asked: int, gigabytes: float) -> int:
    """Return how many jobs to run side by side, at least one.

    Args:
        asked: number of jobs; -1 for one a core.
        gigabytes: memory of one job, GiB.
    """
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    wanted = asked if asked > 0 else cores
    free = available_memory()
    return wanted if free is None else max(1, min(wanted, int(free / (gigabytes * GIB))))


def available_memory() -> float | None:
    """Return the memory in bytes that jobs may take: of the machine, or of the group of processes that limits it.

    None where the system does not say.
    """
    limits = [*_machine(), *_group()]
    return min(limits, default=None)


def _machine() -> list[float]:
    try:
        lines = Path("/proc/meminfo").read_text("ascii").splitlines()
    except OSError:
        return []
    return [1024.0 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable:")]


def _group() -> list[float]:
    try:
        limit, used = ((_CGROUP / name).read_text("ascii") for name in ("memory.max", "memory.current"))
    except OSError:
        return []
    return [] if limit.strip() == "max" else [float(limit) - float(used)]
