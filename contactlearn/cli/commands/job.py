"""One job in a folder of its own: the folder is held while it runs, and marked last of all as finished."""

import errno
import time
import traceback
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import cast

import torch
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf, read_write

from contactlearn.cli.configuration import check_settings
from contactlearn.cli.sweeps.identity import job_identity
from contactlearn.cli.trust import check_targets
from contactlearn.core.errors import ContactLearnError
from contactlearn.core.numerics import written_whole
from contactlearn.results.folder import is_run
from contactlearn.results.state import DONE, Done, Failed, clear, fail, finish, held, read_done, remove_if_empty

_FIXES = {
    errno.ENOSPC: "free some space and run the same command again",
    errno.EDQUOT: "free some space and run the same command again",
    errno.EROFS: "choose another with hydra.run.dir=FOLDER, or hydra.sweep.dir=FOLDER for a sweep",
    errno.EACCES: "choose another with hydra.run.dir=FOLDER, or hydra.sweep.dir=FOLDER for a sweep",
    errno.ENOENT: "was it moved or deleted during the run?",
}


def run_job(job: Callable[[DictConfig], None], cfg: DictConfig) -> None:
    """Run a job, unless its folder has its result already or another process makes it now.

    A run that fails before it computed anything leaves no folder; a job of a sweep leaves the reason.

    Raises:
        ContactLearnError: what a user can mend, and anything at all in a sweep, which then goes on.
    """
    hydra, start = cast(DictConfig, HydraConfig.get()), time.monotonic()
    with _failing_well(Path(str(hydra.runtime.output_dir)), began=False):
        check_settings(cfg, str(hydra.job.config_name))
        check_targets(cfg, [*hydra.overrides.task, *hydra.overrides.hydra])
        identity = job_identity(cfg, hydra)
    with _own_folder(identity, hydra) as folder:
        if folder is None:
            return
        with _failing_well(folder, began=True):
            with read_write(hydra.runtime):
                hydra.runtime.output_dir = str(folder)  # which the job asks for
            _keep_configuration(folder, cfg, hydra)
            job(cfg)
            finish(folder, replace(identity, seconds=round(time.monotonic() - start, 3)))


@contextmanager
def _failing_well(folder: Path, began: bool) -> Generator[None]:
    """Leave the reason of a failure in the folder of a job, but no empty folder of a run.

    Raises:
        ContactLearnError: for what a user can mend, and for anything at all in a sweep: each process can hand it on.
    """
    sweeping = HydraConfig.get().mode == RunMode.MULTIRUN
    try:
        yield
    except KeyboardInterrupt:
        if not sweeping:
            remove_if_empty(folder)
        raise
    except Exception as error:
        meant = isinstance(error, ContactLearnError)
        said = str(error) if meant else reason(error)
        if not sweeping:
            remove_if_empty(folder)
        if sweeping or (began and folder.exists()):
            fail(folder, Failed(reason=said, traceback="" if meant else traceback.format_exc()))
        if meant or not (sweeping or isinstance(error, OSError | MemoryError | torch.OutOfMemoryError)):
            raise
        raise ContactLearnError(said) from error


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


@contextmanager
def _own_folder(identity: Done, hydra: DictConfig) -> Generator[Path | None]:
    """Hold the folder of a job, or one beside it if that is taken; None if there is nothing to do.

    Raises:
        ContactLearnError: the folder was asked for by name, and has another result or another run.
    """
    wanted = Path(str(hydra.runtime.output_dir))
    sweeping = hydra.mode == RunMode.MULTIRUN
    named = sweeping and str(hydra.sweeper._target_).startswith("hydra_plugins.contactlearn_sweeper.")
    if named and not wanted.name.endswith(f"-{identity.job}"):
        raise ContactLearnError("data, code or configuration changed during the sweep; run the same command again")
    given = not sweeping and any(word.startswith("hydra.run.dir=") for word in hydra.overrides.hydra)
    for folder in _names(wanted):
        if not named and is_run(folder):
            if given and not _made(folder, identity):
                raise ContactLearnError(f"{folder} holds the result of another run; choose another hydra.run.dir")
            if given:
                yield None
                return
            continue
        with held(folder) as free:
            if not free and given:
                raise ContactLearnError(f"{folder} is in use by another run; choose another hydra.run.dir")
            if (not free and not named) or (free and not named and is_run(folder)):
                continue
            mine = free and not _made(folder, identity)
            if mine and named:
                clear(folder)
            elif mine:
                (folder / DONE).unlink(missing_ok=True)
            yield folder if mine else None
            return


def _made(folder: Path, identity: Done) -> bool:
    """Whether a folder holds the result of a job already; says so."""
    done = read_done(folder)
    found = done is not None and done.job == identity.job
    if found:
        print(f"finished already: {folder}")
    return found


def _names(wanted: Path) -> Iterator[Path]:
    """The folder, then others beside it, numbered from 2."""
    yield wanted
    number = 2
    while True:
        yield wanted.with_name(f"{wanted.name}-{number}")
        number += 1


def _keep_configuration(folder: Path, cfg: DictConfig, hydra: DictConfig) -> None:
    """Write the configuration where Hydra would; Hydra itself might write over that of another run."""
    parts = {"config": cfg, "hydra": OmegaConf.create({"hydra": hydra}), "overrides": hydra.overrides.task}
    for name, part in parts.items():
        with written_whole(folder / ".hydra" / f"{name}.yaml") as path:
            path.write_text(OmegaConf.to_yaml(part), encoding="utf-8")
