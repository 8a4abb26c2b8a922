"""State of a run folder: finished, failed, or neither, by small files that are each written whole or not at all.

.lock         held by the process that writes to the folder; the system lets go of it when that process ends, however
failed.json   why the last attempt ended, where it could still say so
done.json     what was computed, and from what; written last, when everything else is there

A folder with a lock and without done.json is unfinished, and nothing in it is read.  Runs of versions before these
files have neither, and count as finished.
"""

import os
import shutil
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from filelock import FileLock, Timeout

from contactlearn.core.errors import ContactLearnError
from contactlearn.core.numerics import atomic_write
from contactlearn.core.serialisation import from_json, to_json

DONE, FAILED, LOCK = "done.json", "failed.json", ".lock"
_LOGS = ("train.log", "evaluate.log", "diagnose.log")
_OWN = (LOCK, FAILED, ".hydra", "progress.jsonl", *_LOGS)  # of a folder in which nothing has been computed


@dataclass(frozen=True, kw_only=True)
class Done:
    """A finished run.

    Args:
        job: digest of all that its result depends on, see `sweeps.identity`.
        config: SHA-256 of the resolved configuration.
        data: SHA-256 of the files that it names; empty where it names none.
        code: version of this program, with the SHA-256 of its sources.
        paths: data files that the configuration names.
        seconds: that the run took.
    """

    job: str
    config: str
    data: str
    code: str
    paths: tuple[str, ...] = ()
    seconds: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Failed:
    """A failed attempt: the reason in a line, and where in the program it arose, if that is not known."""

    reason: str
    traceback: str = ""


@contextmanager
def locked(folder: Path) -> Generator[bool]:
    """Lock a folder, which is made if there is none; false if another process holds it.

    Raises:
        OSError: the folder cannot be made or written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    lock = FileLock(folder / LOCK, is_singleton=False)
    try:
        lock.acquire(timeout=0)
    except Timeout:
        yield False
        return
    try:
        yield True
    finally:
        lock.release()


def is_locked(folder: Path) -> bool:
    """Whether a process writes to a folder at present."""
    if not (folder / LOCK).exists():
        return False
    with locked(folder) as free:
        return not free


def finish(folder: Path, done: Done) -> None:
    """Mark a run as finished.

    Raises:
        ContactLearnError: the folder, or its lock, is not there any more.
        OSError: it cannot be written.
    """
    if not (folder / LOCK).exists():
        raise ContactLearnError(f"{folder} vanished during the run, which is lost; was it moved or deleted?")
    with atomic_write(folder / DONE) as part:
        part.write_text(to_json(done), encoding="utf-8")


def fail(folder: Path, failed: Failed) -> None:
    """Record why a run failed, if the folder can still be written."""
    try:
        if folder.is_dir():
            with atomic_write(folder / FAILED) as part:
                part.write_text(to_json(failed), encoding="utf-8")
    except (OSError, ContactLearnError):
        return


def read_done(folder: Path) -> Done | None:
    """Return what was computed in a folder; None if it is not finished."""
    try:
        return from_json(Done, (folder / DONE).read_bytes())
    except (OSError, ContactLearnError):
        return None


def read_failed(folder: Path) -> Failed | None:
    """Return why the last attempt in a folder failed, where it did."""
    try:
        return from_json(Failed, (folder / FAILED).read_bytes())
    except (OSError, ContactLearnError):
        return None


def unfinished(folder: Path) -> bool:
    """Whether a run began in a folder and has not finished: it is running, failed, or was killed."""
    return (folder / LOCK).exists() and not (folder / DONE).exists()


def clear(folder: Path) -> None:
    """Remove what an attempt left in a folder, but for its lock.

    Raises:
        OSError: something cannot be removed.
    """
    for entry in [folder / name for name in os.listdir(folder) if name != LOCK]:
        if entry.is_dir() and not entry.is_symlink():
            shutil.rmtree(entry)
        else:
            entry.unlink()


def remove_if_empty(folder: Path) -> None:
    """Remove a folder in which nothing was computed, and those above it that are empty then, up to the working one."""
    try:
        if any(name not in _OWN for name in os.listdir(folder)):
            return
        clear(folder)
        (folder / LOCK).unlink(missing_ok=True)
        while folder != Path.cwd():
            folder.rmdir()
            folder = folder.parent
            if Path.cwd() not in folder.parents:
                break
    except OSError:  # something came into it, or it is not ours to remove
        return
