"""One run in a folder of its own, which is held while it runs and marked last of all as finished."""

import errno
import logging
import platform
import shlex
import shutil
import sys
import time
import traceback
from collections.abc import Callable, Generator, Mapping
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass, replace
from importlib.metadata import version
from itertools import count
from pathlib import Path
from typing import Any, cast

import torch
from hydra.core.hydra_config import HydraConfig
from hydra.core.utils import configure_log
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf, read_write

from contactlearn.cli.config_files import restrict_settings
from contactlearn.cli.config_security import check_targets
from contactlearn.cli.sweeps.identity import job_identity
from contactlearn.core import __version__, devices
from contactlearn.core.errors import ContactLearnError
from contactlearn.core.numerics import atomic_write
from contactlearn.data.blocks import Blocks
from contactlearn.results.folder import is_run
from contactlearn.results.state import DONE, Done, Failed, clear, fail, finish, locked, read_done, remove_if_empty
from contactlearn.results.types import DataSource, Provenance

_ELSEWHERE = "choose another with hydra.run.dir=FOLDER, or hydra.sweep.dir=FOLDER for a sweep"
_FIXES = {
    errno.ENOSPC: "free some space and run the same command again",
    errno.EDQUOT: "free some space and run the same command again",
    errno.EROFS: _ELSEWHERE,
    errno.EACCES: _ELSEWHERE,
    errno.ENOENT: "was it moved or deleted during the run?",
}


_log = logging.getLogger("contactlearn")


@dataclass(frozen=True, kw_only=True)
class Run:
    """A run of a command.

    Args:
        command: train, evaluate or diagnose.
        overrides: settings from the command line, as they were typed.
        config: the resolved configuration, for the record.
        folder: to write to.
        partial: folder of partial results, from which the same command resumes.  It is named by the identity of the
            run, next to `folder`, since the next run has another one; but inside a folder given by name.
    """

    command: str
    overrides: tuple[str, ...]
    config: Mapping[str, Any]
    folder: Path
    partial: Path

    def provenance(self, data: Blocks, device: torch.device, train_size: int | None = None) -> Provenance:
        """Return the data, code, configuration and command that give the result.

        Args:
            data: all impacts of the source.
            device: that computed.
            train_size: number of training trials, which the configuration may leave open.
        """
        packages = {name: version(name) for name in ("torch", "gpytorch", "numpy")}
        space = next(data.read()).space
        config = dict(self.config)
        if train_size is not None:
            config["train"] = {**config["train"], "size": train_size}
        return Provenance(
            data=DataSource(source=data.source, trials=data.trials, sha256=data.sha256, space=space.name),
            versions={"contactlearn": __version__, "python": platform.python_version(), **packages},
            config=config,
            command=shlex.join([*invocation(self.command), *self.overrides]),
            device=devices.described(device),
        )

    def remove_partial_results(self) -> None:
        """Remove the partial results, and the folder above theirs if it is empty then."""
        shutil.rmtree(self.partial, ignore_errors=True)
        if self.partial.parent.is_dir() and not any(self.partial.parent.iterdir()):
            self.partial.parent.rmdir()


def invocation(command: str) -> list[str]:
    """Return the words that call a command in the way in which this run was called: as a script or by the package."""
    by_package = Path(sys.argv[0]).name.startswith("contactlearn")
    return ["python", "-m", "contactlearn", command] if by_package else ["python", f"{command}.py"]


def run_job(command: str, prepare: Callable[[DictConfig], Callable[[Run], None]], cfg: DictConfig) -> None:
    """Run a command, unless its folder has its result already or another process computes it now.

    A run that fails before it computed anything leaves no folder; a job of a sweep leaves the reason.

    Args:
        command: its name.
        prepare: parses the configuration, and returns what to run.
        cfg: the composed configuration.

    Raises:
        ContactLearnError: errors that a user can fix; in a sweep, which continues with its next job, any error.
    """
    hydra, start = cast(DictConfig, HydraConfig.get()), time.monotonic()
    with _logged(hydra), _failures_recorded(Path(str(hydra.runtime.output_dir)), began=False):
        restrict_settings(cfg, str(hydra.job.config_name), hydra.overrides.task)
        check_targets(cfg, [*hydra.overrides.task, *hydra.overrides.hydra])
        identity = job_identity(cfg, hydra)
        job = prepare(cfg)
    with _own_folder(identity, hydra) as folder:
        if folder is None:
            return
        with read_write(hydra.runtime):
            hydra.runtime.output_dir = str(folder)  # of the configuration that is written, and of the log
        with _logged(hydra), _failures_recorded(folder, began=True):
            # As Hydra would; Hydra itself might write over the configuration of another run.
            parts = {"config": cfg, "hydra": OmegaConf.create({"hydra": hydra}), "overrides": hydra.overrides.task}
            for name, part in parts.items():
                with atomic_write(folder / ".hydra" / f"{name}.yaml") as path:
                    path.write_text(OmegaConf.to_yaml(part), encoding="utf-8")
            shared = folder if _is_given(hydra) else folder.parent
            config = OmegaConf.to_container(cfg, resolve=True)
            job(
                Run(
                    command=command,
                    overrides=tuple(hydra.overrides.task),
                    config=cast(dict[str, Any], config),
                    folder=folder,
                    partial=shared / ".parts" / identity.job,
                )
            )
            finish(folder, replace(identity, seconds=round(time.monotonic() - start, 3)))


@contextmanager
def _logged(hydra: DictConfig) -> Generator[None]:
    """Log as `hydra.job_logging` states, to the folder of the run, and to none afterwards."""
    configure_log(hydra.job_logging, hydra.verbose)
    try:
        yield
    finally:
        for handler in _log.handlers:
            with suppress(OSError):  # of a full disk, which would leave the file open below
                handler.close()
        configure_log(hydra.hydra_logging, hydra.verbose)
        _log.handlers.clear()


@contextmanager
def _failures_recorded(folder: Path, began: bool) -> Generator[None]:
    """Leave the reason of a failure in the folder of a job, but no empty folder of a run.

    Raises:
        ContactLearnError: errors that a user can fix; in a sweep any error, since every process can unpickle this one.
    """
    sweeping = HydraConfig.get().mode == RunMode.MULTIRUN
    try:
        yield
    except KeyboardInterrupt:
        if not sweeping:
            remove_if_empty(folder)
        raise
    except Exception as error:
        foreseen = isinstance(error, ContactLearnError)
        why = str(error) if foreseen else reason(error)
        if not sweeping:
            remove_if_empty(folder)
        if sweeping or (began and folder.exists()):
            _log.error("%s", why, exc_info=not foreseen)
            fail(folder, Failed(reason=why, traceback="" if foreseen else traceback.format_exc()))
        if foreseen or not (sweeping or isinstance(error, OSError | MemoryError | torch.OutOfMemoryError)):
            raise
        raise ContactLearnError(why) from error


def reason(error: BaseException) -> str:
    """Return what went wrong in a line, and what to do about it where that is known."""
    if isinstance(error, OSError) and error.errno is not None:
        fix = _FIXES.get(error.errno)
        where = f"{error.filename}: " if error.filename else ""
        return f"{where}{error.strerror}" + (f"; {fix}" if fix else "")
    if isinstance(error, MemoryError):
        return "memory ran out; use fewer trials, or fewer jobs at a time"
    if isinstance(error, torch.OutOfMemoryError):
        return "the GPU's memory ran out; use fewer trials, or device=cpu"
    first = (str(error).strip() or "no words").splitlines()[0]
    return f"{type(error).__name__}: {first}"


def _is_given(hydra: DictConfig) -> bool:
    """Whether the folder of a single run was given by name."""
    given = any(word.startswith("hydra.run.dir=") for word in hydra.overrides.hydra)
    return given and hydra.mode != RunMode.MULTIRUN


def _own_folder(identity: Done, hydra: DictConfig) -> AbstractContextManager[Path | None]:
    """Hold the folder of a run; None if there is nothing left to do."""
    wanted = Path(str(hydra.runtime.output_dir))
    ours = str(hydra.sweeper._target_).startswith("hydra_plugins.contactlearn_sweeper.")
    if hydra.mode == RunMode.MULTIRUN and ours:
        return _folder_of_identity(wanted, identity)
    return _folder_of_name(wanted, identity) if _is_given(hydra) else _new_folder(wanted)


@contextmanager
def _folder_of_identity(folder: Path, identity: Done) -> Generator[Path | None]:
    """Hold the folder of a job of a sweep, emptied of former attempts; None if it is finished, or runs elsewhere.

    Raises:
        ContactLearnError: the folder is named after another identity.
    """
    if not folder.name.endswith(f"-{identity.job}"):
        raise ContactLearnError("data, code or configuration changed during the sweep; run the same command again")
    with locked(folder) as free:
        if not free or _is_finished(folder, identity):
            yield None
        else:
            clear(folder)
            yield folder


@contextmanager
def _folder_of_name(folder: Path, identity: Done) -> Generator[Path | None]:
    """Hold the folder that the user named; None if it has this result already.

    Raises:
        ContactLearnError: the folder has another result, or another run writes to it.
    """
    if is_run(folder):
        if not _is_finished(folder, identity):
            raise ContactLearnError(f"{folder} holds the result of another run; choose another hydra.run.dir")
        yield None
        return
    with locked(folder) as free:
        if not free:
            raise ContactLearnError(f"{folder} is in use by another run; choose another hydra.run.dir")
        (folder / DONE).unlink(missing_ok=True)
        yield folder


@contextmanager
def _new_folder(wanted: Path) -> Generator[Path]:
    """Hold the wanted folder, or the first of its successors, numbered from 2, that has no result and no run."""
    for number in count(1):
        folder = wanted if number == 1 else wanted.with_name(f"{wanted.name}-{number}")
        if is_run(folder):
            continue
        with locked(folder) as free:
            if free and not is_run(folder):
                (folder / DONE).unlink(missing_ok=True)
                yield folder
                return


def _is_finished(folder: Path, identity: Done) -> bool:
    """Whether a folder holds the result of a job already, which is printed."""
    done = read_done(folder)
    found = done is not None and done.job == identity.job
    if found:
        print(f"finished already: {folder}")
    return found
