"""Why something failed, in a line, and what to do about it where that is known."""

import errno

from hydra.errors import HydraException
from omegaconf.errors import OmegaConfBaseException

from contactlearn.core.errors import ContactLearnError

_ELSEWHERE = "choose another with hydra.run.dir=FOLDER, or hydra.sweep.dir=FOLDER for a sweep"
_FIXES = {
    errno.ENOSPC: "free some space and run the same command again",
    errno.EDQUOT: "free some space and run the same command again",
    errno.EROFS: _ELSEWHERE,
    errno.EACCES: _ELSEWHERE,
    errno.ENOTDIR: f"a part of the path is a file; {_ELSEWHERE}",
    errno.ENOENT: f"it cannot be created, or was moved or deleted during the run; {_ELSEWHERE}",
}


def reason(error: BaseException) -> str:
    """Return what went wrong in a line, and what to do about it where that is known."""
    if isinstance(error, ContactLearnError):
        return str(error)
    if isinstance(error, HydraException | OmegaConfBaseException):
        return " ".join(str(error).partition("Config search path")[0].split())
    if isinstance(error, OSError) and error.errno is not None:
        fix = _FIXES.get(error.errno)
        where = f"{error.filename}: " if error.filename else ""
        return f"{where}{error.strerror}" + (f"; {fix}" if fix else "")
    if isinstance(error.__context__, OSError):  # of a full disk, which the YAML library turns into errors of its own
        return reason(error.__context__)
    if isinstance(error, MemoryError):
        return "memory ran out; use fewer trials, or fewer jobs at a time"
    import torch  # which takes seconds

    if isinstance(error, torch.OutOfMemoryError):
        return "the GPU's memory ran out; use fewer trials, or device=cpu"
    first = (str(error).strip() or "no words").splitlines()[0]
    return f"{type(error).__name__}: {first}"
