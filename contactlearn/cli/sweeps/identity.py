"""Identity of a job: digests of the configuration, data files and code that its result depends on.

Two jobs with the same digest give the same result, but for rounding.  `threads`, `workers`, `device` and `verbose` say
how a job is computed and shown, and are left out: `device=auto` may mean another one on the machine where a sweep goes
on.  Data and trained models are known by the content of the files that a configuration names under `path` and
`checkpoint`; simulated data by their settings; classes of other packages by the file that defines them.
"""

import hashlib
import json
import os
import re
from collections.abc import Sequence
from functools import cache, lru_cache
from importlib.machinery import PathFinder
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf

from contactlearn.cli.config_files import leaf_values, own_data
from contactlearn.core import __version__
from contactlearn.results.state import Done

DIGITS = 12
"""Of a digest in the name of a folder."""
_HOW = ("threads", "workers", "device", "verbose")
_CHANGING = re.compile(r"\$\{(?!oc\.)\w+:")  # a resolver that may give something else the next time
_ENVIRONMENT = re.compile(r"\$\{oc\.env:(\w+)")


def job_identity(cfg: DictConfig, hydra: DictConfig) -> Done:
    """Return the identity of a job, from its configuration and Hydra's.

    Raises:
        OSError: a data file cannot be read.
    """
    own = OmegaConf.masked_copy(cfg, [str(key) for key in cfg if key not in ("hydra", *_HOW)])
    content = OmegaConf.to_container(own, resolve=True)
    config = _sha([hydra.job.config_name, content])
    paths = tuple(dict.fromkeys([*_named(content, "path"), *_named(content, "checkpoint")]))
    modules = dict.fromkeys(target.rpartition(".")[0] for target in _named(content, "_target_"))
    foreign = tuple(name for name in modules if name and not name.startswith("contactlearn."))
    data, code = data_fingerprint(paths), code_version(foreign)
    changing = _CHANGING.search(OmegaConf.to_yaml(own))
    words = "" if changing else words_digest(hydra, list(hydra.overrides.task))
    digest = _sha([config, data, code])[:DIGITS]
    return Done(job=digest, config=config, data=data, code=code, words=words, paths=paths)


def words_digest(hydra: DictConfig, words: Sequence[str]) -> str:
    """Return the digest of the typed settings of a job, and of all files that turn them into a configuration.

    Equal digests mean equal configurations, which need not be composed to know that.
    """
    sources = [str(source.path) for source in hydra.runtime.config_sources if source.schema == "file"]
    own = [_file(path) for path in own_data().values()]
    counted = [word for word in words if word.lstrip("+").partition("=")[0] not in _HOW]
    used = [f"{name}={os.environ.get(name)}" for word in counted for name in _ENVIRONMENT.findall(word)]
    return _sha([hydra.job.config_name, *map(_tree, sources), own, counted, used, __version__])


def still_valid(done: Done) -> bool:
    """Whether the data and the code of a finished job are unchanged.

    Raises:
        OSError: a data file cannot be read.
    """
    names = tuple(one.partition("=")[0] for one in done.code.split(" ")[1:])
    return done.code == code_version(names) and done.data == data_fingerprint(done.paths)


def data_fingerprint(paths: tuple[str, ...]) -> str:
    """Return the SHA-256 of files, and of all files in folders; empty without any.

    Raises:
        OSError: a file cannot be read.
    """
    known = [Path(path) for path in paths if Path(path).exists()]
    files = ([path, *sorted(path.rglob("*"))] for path in known)
    return _sha([[_file(one) for one in found if one.is_file()] for found in files]) if known else ""


@lru_cache(maxsize=16)
def code_version(foreign: tuple[str, ...] = ()) -> str:
    """Return this program's version with the SHA-256 of its sources, and that of other modules, by name."""
    package = Path(__file__).parents[2]
    sources = _sha([_file(path) for path in sorted(package.rglob("*.py"))])
    own = f"{__version__}+{sources[:DIGITS]}"
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
    return _file(origin)[:DIGITS] if origin is not None and origin.is_file() else "unknown"


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


@lru_cache(maxsize=16)
def _tree(folder: str) -> str:
    """Digest of the configuration files below a folder, and of the environment that they use."""
    texts = {str(path.relative_to(folder)): path.read_text("utf-8") for path in sorted(Path(folder).rglob("*.yaml"))}
    used = {name: os.environ.get(name) for text in texts.values() for name in _ENVIRONMENT.findall(text)}
    return _sha([texts, used])


def _sha(content: Any) -> str:
    return hashlib.sha256(json.dumps(content, default=str, ensure_ascii=True).encode()).hexdigest()
