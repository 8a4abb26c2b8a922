"""One run in a folder of its own, which is held while it runs and marked last of all as finished."""

import logging
import math
import os
import platform
import shlex
import shutil
import time
import traceback
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager, suppress
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

from contactlearn.cli.config_security import check_targets
from contactlearn.cli.reasons import reason
from contactlearn.cli.settings import SETTINGS, check_names
from contactlearn.cli.sweeps.identity import job_identity
from contactlearn.cli.sweeps.sweep import is_fresh
from contactlearn.core import __version__, devices
from contactlearn.core.errors import ContactLearnError
from contactlearn.core.numerics import atomic_write
from contactlearn.data.blocks import Blocks
from contactlearn.report import terminal
from contactlearn.results.folder import is_run
from contactlearn.results.runs import common_metric, read_runs
from contactlearn.results.state import (
    DONE,
    LOCK,
    Done,
    Failed,
    clear,
    fail,
    finish,
    locked,
    read_done,
    read_failed,
    remove_if_empty,
)
from contactlearn.results.types import DataSource, Provenance

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

    @property
    def data_words(self) -> list[str]:
        """The settings that choose the same data for another command; none where an experiment chose them."""
        if any(word.startswith("experiment=") for word in self.overrides):
            return []
        return [word for word in self.overrides if word.startswith("data")] or ["data=synthetic"]

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
            command=shlex.join(["contactlearn", self.command, *self.overrides]),
            device=devices.described(device),
        )

    def remove_partial_results(self) -> None:
        """Remove the partial results, and the folder above theirs if it is empty then."""
        shutil.rmtree(self.partial, ignore_errors=True)
        if self.partial.parent.is_dir() and not any(self.partial.parent.iterdir()):
            self.partial.parent.rmdir()


def run_job(command: str, work: Callable[[Any, Run], None], cfg: DictConfig) -> float | None:
    """Run a command, unless its folder has its result already or another process computes it now.

    A run that fails before it computed anything leaves no folder.  A job of a sweep leaves the reason and returns inf,
    so that the others go on whatever the sweeper and the launcher are.

    Args:
        command: its name.
        work: what to do with its settings in a folder.
        cfg: the composed configuration.

    Returns:
        The held-out error of the job's own model, for sweepers that minimise; None in a single run, and without one.

    Raises:
        ContactLearnError: errors that a user can fix.
    """
    hydra = cast(DictConfig, HydraConfig.get())
    with _where_the_user_stands(str(hydra.runtime.cwd)):
        if hydra.mode != RunMode.MULTIRUN:
            _run(command, work, cfg, hydra)
            return None
        folder = Path(str(hydra.runtime.output_dir))
        try:
            (folder / LOCK).touch()  # the sweep lists it among its jobs
            _run(command, work, cfg, hydra)
        except Exception as error:
            if read_failed(folder) is None:  # as on a full disk
                raise ContactLearnError(reason(error)) from error  # which every process can unpickle
            return math.inf
        return objective(folder)


@contextmanager
def _where_the_user_stands(folder: str) -> Generator[None]:
    """Work in the folder from which the command was given: hydra.job.chdir and some launchers start jobs elsewhere.

    Back goes only a job whose folder is still there: one that fails before it computed anything leaves none.
    """
    before = os.getcwd()
    os.chdir(folder)
    try:
        yield
    finally:
        if os.path.isdir(before):
            os.chdir(before)


def _run(command: str, work: Callable[[Any, Run], None], cfg: DictConfig, hydra: DictConfig) -> None:
    start, wanted = time.monotonic(), Path(str(hydra.runtime.output_dir))
    with _logged(hydra), _failures_recorded(wanted, began=False):
        check_names(cfg, str(hydra.job.config_name), hydra.overrides.task)
        check_targets(cfg, hydra.overrides.task)
        identity = job_identity(cfg, hydra)
        if "workers" in cfg and cfg.workers is None and _is_beside_others(hydra):
            cfg.workers = 1
        settings = SETTINGS[command].from_config(cfg)
    sweeping = hydra.mode == RunMode.MULTIRUN
    new = not sweeping and is_fresh(hydra.run)
    with _new_folder(wanted) if new else _folder_of_name(wanted, identity, sweeping) as folder:
        if folder is None:
            return
        with read_write(hydra):
            hydra.runtime.output_dir = str(folder)  # of the configuration that is written
            for handler in hydra.job_logging.get("handlers", {}).values():  # whose files are named already
                if "filename" in handler and Path(handler.filename).parent == wanted:
                    handler.filename = str(folder / Path(handler.filename).name)
        with _logged(hydra), _failures_recorded(folder, began=True):
            # As Hydra would; Hydra itself might write over the configuration of another run.
            words = [word.removeprefix("++") for word in hydra.overrides.task]
            parts = {"config": cfg, "hydra": OmegaConf.create({"hydra": hydra}), "overrides": OmegaConf.create(words)}
            for name, part in parts.items():
                with atomic_write(folder / ".hydra" / f"{name}.yaml") as path:
                    path.write_text(OmegaConf.to_yaml(part), encoding="utf-8")
            shared = folder.parent if new or sweeping else folder
            config = OmegaConf.to_container(cfg, resolve=True)
            run = Run(
                command=command,
                overrides=tuple(words),
                config=cast(dict[str, Any], config),
                folder=folder,
                partial=shared / ".parts" / identity.job,
            )
            try:
                work(settings, run)
            except KeyboardInterrupt as stop:
                resumed = "the same command goes on after the parts that are finished"
                stop.add_note(resumed if run.partial.is_dir() else "no result was written, and nothing can be resumed")
                raise
            finish(folder, replace(identity, seconds=round(time.monotonic() - start, 3)))


def _is_beside_others(hydra: DictConfig) -> bool:
    """Whether a launcher runs several jobs at a time, which then take a core each."""
    return hydra.mode == RunMode.MULTIRUN and not str(hydra.launcher._target_).endswith("BasicLauncher")


def objective(folder: Path) -> float | None:
    """Return the held-out error of a finished run's own model, in the norm of the run; None without one."""
    with suppress(ContactLearnError):
        (run,), _ = read_runs([folder])
        error = run.error(common_metric([run]))
        return None if error is None else error.mean
    return None


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
        for one in (error, error.__context__):
            if isinstance(one, OSError) and one.errno is not None and one.filename is None:
                one.filename = str(folder)  # a write says not where the disk is full
        why = reason(error)
        if not sweeping:
            remove_if_empty(folder)
        if sweeping or (began and folder.exists()):
            _log.error("%s", why, exc_info=not foreseen)
            fail(folder, Failed(reason=why, traceback="" if foreseen else traceback.format_exc()))
        if foreseen or not (sweeping or isinstance(error, OSError | MemoryError | torch.OutOfMemoryError)):
            raise
        raise ContactLearnError(why) from error


@contextmanager
def _folder_of_name(folder: Path, identity: Done, sweeping: bool) -> Generator[Path | None]:
    """Hold the folder that the user, or the identity of a job, names; None if it has this result already.

    A job of a sweep clears what a former attempt left, and leaves a job that another process runs to that.

    Raises:
        ContactLearnError: the folder has another result, or another run writes to it.
    """
    own = sweeping and folder.name.endswith(f"-{identity.job}")
    if is_run(folder) and _is_finished(folder, identity):
        yield None
        return
    if is_run(folder) and not own:
        raise ContactLearnError(f"{folder} holds the result of another run; choose another folder")
    with locked(folder) as free:
        if not free and not own:
            raise ContactLearnError(f"{folder} is in use by another run; choose another folder")
        if not free or (own and _is_finished(folder, identity)):  # another process ended it meanwhile
            yield None
            return
        if own:
            clear(folder)
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
        print(f"finished already: {terminal.relative(folder)}")
    return found
