"""A sweep by Hydra's own sweeper and launchers, in a folder of its own that the same command resumes.

Each job is in a folder named by what its result depends on (`hydra.sweep.subdir`, see `resolvers`), and returns at
once where that holds its result.  Jobs are judged by what they left on disk, since a launcher may lose what they
return.
"""

import os
import shlex
import sys
import time
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from importlib.util import find_spec
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory

from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from contactlearn.cli.reasons import reason
from contactlearn.core.errors import ContactLearnError, install_hint, terminal_safe
from contactlearn.core.signals import is_interruption
from contactlearn.report.terminal import relative, show_sweep
from contactlearn.results.state import DONE, FAILED, LOCK, is_locked, read_done, read_failed

_EXTRAS = {"joblib": "joblib", "submitit": "slurm", "ray": "ray"}  # optional dependencies by a word of the launcher
_POLL = 0.5  # s between looks at a job that another process runs
_SILENT = "ended without a result and without a reason; was it killed?"


def is_fresh(folders: DictConfig) -> bool:
    """Whether `hydra.run` or `hydra.sweep` names a new folder each time, by the time of day."""
    return "${now:" in str(OmegaConf.to_container(folders, resolve=False))


@contextmanager
def sweep(hydra: DictConfig, swept: Sequence[str]) -> Generator[Path]:
    """Hold a sweep while it runs; at the end its table is printed, and it exits with status 1 if a job failed.

    Args:
        hydra: Hydra's part of the configuration of a job.
        swept: names of the settings in which jobs differ.

    Yields:
        The folder of the sweep.

    Raises:
        ContactLearnError: a launcher that is not installed, or that broke down.
        OSError: the folder of the sweep cannot be made or written.
    """
    target = str(hydra.launcher._target_)
    if not find_spec(".".join(target.split(".")[:2])):
        extra = next((extra for word, extra in _EXTRAS.items() if word in target), None)
        hint = "" if extra is None else f": {install_hint(extra)}"
        raise ContactLearnError(f"{target.rpartition('.')[2]} is not installed{hint}")
    folder = Path(str(hydra.sweep.dir)).absolute()
    folder = _new(folder) if is_fresh(hydra.sweep) else folder
    folder.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(prefix=".probe-", dir=folder) as probe:  # fails now rather than in every job
        start = os.stat(probe).st_mtime_ns  # by the clock of the disk
    print(f"sweep: in {relative(folder)}", flush=True)
    place = shlex.quote(f"hydra.sweep.dir={relative(folder)}")
    again = f"The same command with {place} runs what has no result, and nothing else."

    def jobs() -> dict[Path, list[str]]:
        return {job: _settings(job, swept) for job in _jobs(folder, start)}

    try:
        with _curves(folder, swept, jobs):
            yield folder
    except KeyboardInterrupt as stop:
        stop.add_note(f"the same command with {place} runs what has no result")
        raise
    except (HydraException, OmegaConfBaseException):  # a word that is wrong in one of the jobs
        raise
    except Exception as error:  # a launcher's own, or of a job that could not leave its reason
        if is_interruption(error):
            raise
        _show(folder, start)
        print(terminal_safe(f"error: the sweep stopped: {reason(error)}\n{again}"), file=sys.stderr)
        sys.exit(1)
    if _show(folder, start):
        print(again, file=sys.stderr)
        sys.exit(1)


def _new(folder: Path) -> Path:
    """Make the folder, or the first of its successors, numbered from 2, that another sweep did not just make."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    for number in count(1):
        place = folder if number == 1 else folder.with_name(f"{folder.name}-{number}")
        try:
            place.mkdir()
        except FileExistsError:
            if not place.is_dir():
                raise
            continue
        return place
    raise AssertionError


def _jobs(folder: Path, start: int) -> list[Path]:
    """Folders of the jobs that began, or found themselves finished, since a time."""
    return sorted(job for job in folder.iterdir() if max(_time(job / LOCK), _time(job / FAILED)) >= start)


def _time(file: Path) -> int:
    try:
        return file.stat().st_mtime_ns
    except OSError:
        return -1


def _settings(job: Path, swept: Sequence[str]) -> list[str]:
    """The swept settings of a job, as they were typed."""
    try:
        words = OmegaConf.to_container(OmegaConf.load(job / ".hydra" / "overrides.yaml"))
    except OSError:
        return []
    return [str(word) for word in words or () if str(word).partition("=")[0] in swept]


def _show(folder: Path, start: int) -> bool:
    """Print the table of a sweep and its failed jobs; return whether there is one."""
    jobs = _jobs(folder, start)
    for job in jobs:
        while is_locked(job):  # by another process, which may be killed
            time.sleep(_POLL)
    failed = {job: read_failed(job) for job in jobs if read_done(job) is None}
    finished = [job for job in jobs if job not in failed]
    if finished:
        show_sweep(finished, relative(folder))
    before = sum(_time(job / DONE) < start for job in finished)
    counts = [f"{len(finished)} finished" + (f" ({before} before)" if before else "")]
    counts += [f"{len(failed)} failed"] if failed else []
    print(f"sweep: {', '.join(counts)}", flush=True)
    for job, why in failed.items():  # last, where a user looks
        name = job.name.rpartition("-")[0] or job.name
        reason = _SILENT if why is None else why.reason
        print(terminal_safe(f"failed: {name}: {reason}\n  {relative(job)}"), file=sys.stderr)
    return bool(failed)


def _curves(
    folder: Path, swept: Sequence[str], jobs: Callable[[], Mapping[Path, Sequence[str]]]
) -> AbstractContextManager[None]:
    """Learning curves that grow in TensorBoard, where the sweep is over train.size."""
    if "train.size" not in swept:
        return nullcontext()
    from contactlearn.report.sweep_curves import growing_curves  # TensorBoard takes long to load

    return growing_curves(folder, jobs)
