"""Identity of a job: digests of the configuration, data files and code that its result depends on.

Two jobs with the same digest give the same result, but for rounding.  `threads`, `workers`, `device` and `verbose` say
how a job is computed and shown, and are left out: `device=auto` may mean another one on the machine where a sweep goes
on.  Data and trained models are known by the content of the files that a configuration names under `path` and
`checkpoint`; simulated data by their settings; classes of other packages by the file that defines them.
"""

import hashlib
import json
from contextlib import chdir
from functools import cache, lru_cache
from importlib.machinery import PathFinder
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf

from contactlearn.cli.config_files import without_hydra
from contactlearn.cli.config_security import leaf_values
from contactlearn.cli.settings import check_names
from contactlearn.core import __version__
from contactlearn.results.state import Done

_DIGITS = 12  # of a digest in the name of a folder
_HOW = ("threads", "workers", "device", "verbose")


def job_identity(cfg: DictConfig, hydra: DictConfig) -> Done:
    """Return the identity of a job, from its configuration and Hydra's.

    Raises:
        OSError: a data file cannot be read.
    """
    own = without_hydra(cfg, *_HOW)
    content = OmegaConf.to_container(own, resolve=True)
    config = sha([hydra.job.config_name, content])
    paths = tuple(dict.fromkeys([*_named(content, "path"), *_named(content, "checkpoint")]))
    modules = dict.fromkeys(target.rpartition(".")[0] for target in _named(content, "_target_"))
    foreign = tuple(name for name in modules if name and not name.startswith("contactlearn."))
    data, code = data_fingerprint(paths), code_version(foreign)
    return Done(job=sha([config, data, code])[:_DIGITS], config=config, data=data, code=code, paths=paths)


def composed_identity(cfg: DictConfig) -> Done:
    """Return the identity of a job from its whole configuration, in whatever folder its process is.

    Raises:
        ContactLearnError: a setting that the command does not have.
        OSError: a data file cannot be read.
    """
    own = without_hydra(cfg)
    with chdir(str(cfg.hydra.runtime.cwd)):
        check_names(own, str(cfg.hydra.job.config_name), cfg.hydra.overrides.task)
        return job_identity(own, cfg.hydra)


def data_fingerprint(paths: tuple[str, ...]) -> str:
    """Return the SHA-256 of files, and of all files in folders; empty without any.

    Raises:
        OSError: a file cannot be read.
    """
    known = [Path(path) for path in paths if Path(path).exists()]
    files = ([path, *sorted(path.rglob("*"))] for path in known)
    return sha([[_file(one) for one in found if one.is_file()] for found in files]) if known else ""


@lru_cache(maxsize=16)
def code_version(foreign: tuple[str, ...] = ()) -> str:
    """Return this program's version with the SHA-256 of its sources, and that of other modules, by name."""
    package = Path(__file__).parents[2]
    sources = sha([_file(path) for path in sorted(package.rglob("*.py"))])
    own = f"{__version__}+{sources[:_DIGITS]}"
    return " ".join([own, *(f"{name}={_module(name)}" for name in foreign)])


def _module(name: str) -> str:
    """Digest of a module's file; `unknown` where it has none, which the job itself then says.  Nothing is imported."""
    first, *rest = name.split(".")
    try:
        spec = find_spec(first)
        for place in range(len(rest)):  # `find_spec` would import the packages on the way
            where = None if spec is None else spec.submodule_search_locations
            spec = None if where is None else PathFinder.find_spec(".".join([first, *rest[: place + 1]]), where)
    except (ImportError, ValueError):
        spec = None
    origin = Path(spec.origin) if spec is not None and spec.origin else None
    return _file(origin)[:_DIGITS] if origin is not None and origin.is_file() else "unknown"


def _named(content: Any, key: str) -> list[str]:
    """Texts under a key, alone or in a list, anywhere in a configuration."""
    return [value for path, value in leaf_values(content) if path[-1:] == (key,) and isinstance(value, str)]


def _file(path: Path) -> str:
    found = path.stat()
    return _content(str(path), found.st_size, found.st_mtime_ns)


@cache
def _content(path: str, size: int, changed: int) -> str:
    """SHA-256 of a file, read once for each size and time of its last change."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def sha(content: Any) -> str:
    """Return the digest of plain values."""
    return hashlib.sha256(json.dumps(content, default=str, ensure_ascii=True).encode()).hexdigest()
