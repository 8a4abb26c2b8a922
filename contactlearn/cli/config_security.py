"""What a configuration may bring to life: a file that somebody shared is data, and must not choose what is run.

A `_target_` may name

    a class of this package
    a class of a package that announces laws or effects under an entry point: it was installed
    a class that the command line itself names: law._target_=my_module.MyLaw

and nothing else, before anything is imported.  What Hydra itself makes (launchers, sweepers) comes from its plugins;
its callbacks and settings of the environment are taken from the command line alone, and its logs are logs.
"""

import re
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.metadata import entry_points
from typing import Any

from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra.errors import HydraException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from contactlearn.core.errors import ContactLearnError
from contactlearn.core.signals import defer_interrupts

_GROUPS = ("contactlearn.laws", "contactlearn.effects")
_PLUGINS = ("hydra_plugins.", "hydra._internal.core_plugins.")
_FROM_WORDS_ALONE = ("hydra.callbacks", "hydra.job.env_set")
_LOGGING = ("hydra.job_logging", "hydra.hydra_logging")
_FORMATTERS = ("colorlog.ColoredFormatter",)  # of Hydra's plugin of that name
_STREAMS = ("ext://sys.stdout", "ext://sys.stderr")


def check_targets(cfg: DictConfig, words: Iterable[str]) -> None:
    """Raise for a class, or a function, that a configuration names and that was not declared.

    Args:
        cfg: a composed configuration, with Hydra's part or without.
        words: of the command line.

    Raises:
        ContactLearnError: naming the setting, and the word that would allow it.
    """
    words = list(words)
    for key, target in _targets({str(name): _resolved(cfg, name) for name in cfg if name != "hydra"}, ""):
        if not _declared(target) and not _named(target, words):
            raise ContactLearnError(
                f"{key}={target} comes from a file; a class of another package is taken from the command line alone: "
                f"add {key}={target} to it, if you trust that class"
            )
    if OmegaConf.select(cfg, "hydra") is not None:
        _check_hydra(cfg, words)


@contextmanager
def nothing_foreign() -> Generator[None]:
    """Check every configuration that Hydra composes, before Hydra itself makes anything of it.

    Hydra has no place for that: it sets up logs and callbacks first.

    Raises:
        ContactLearnError: see `check_targets`.
    """
    load = ConfigLoaderImpl.load_configuration

    def checked(
        self: ConfigLoaderImpl,
        config_name: str | None,
        overrides: list[str],
        run_mode: RunMode,
        from_shell: bool = True,
        validate_sweep_overrides: bool = True,
    ) -> DictConfig:
        with defer_interrupts(), readable_words():
            cfg = load(self, config_name, overrides, run_mode, from_shell, validate_sweep_overrides)
        check_targets(cfg, overrides)
        return cfg

    ConfigLoaderImpl.load_configuration = checked
    try:
        yield
    finally:
        ConfigLoaderImpl.load_configuration = load


@contextmanager
def readable_words() -> Generator[None]:
    """Say in words what Hydra has no error of its own for, such as law=null.

    Raises:
        ContactLearnError: for a TypeError or ValueError of Hydra while it composes a configuration.
    """
    try:
        yield
    except (HydraException, OmegaConfBaseException, ContactLearnError):
        raise
    except (TypeError, ValueError) as error:
        said = " ".join(str(error).split())
        raise ContactLearnError(
            f"a word of the command line cannot be read: {said}; --help lists all settings"
        ) from error


def _resolved(cfg: DictConfig, name: Any) -> Any:
    """A part of a configuration as plain values; as written if it refers to what is not there yet."""
    if OmegaConf.is_missing(cfg, name):
        return None
    try:
        part = cfg[name]
        return OmegaConf.to_container(part, resolve=True) if OmegaConf.is_config(part) else part
    except (OmegaConfBaseException, ValueError):  # a job, which refers to the same, fails
        written = OmegaConf.to_container(cfg)
        return written[name] if isinstance(written, dict) else None


def _check_hydra(cfg: DictConfig, words: Sequence[str]) -> None:
    """Refuse what Hydra itself would run."""
    if not OmegaConf.is_config(cfg.hydra):
        raise ContactLearnError(
            f"hydra holds Hydra's own settings, and cannot be {cfg.hydra!r}; set one, as hydra.run.dir"
        )
    hydra = {"hydra": OmegaConf.to_container(cfg.hydra, resolve=False)}
    for key, target in _targets(hydra, ""):
        if not target.startswith(_PLUGINS) and not _named(target, words):
            raise ContactLearnError(f"{key}={target} is no plugin of Hydra's; take it out of the configuration")
    for key in _FROM_WORDS_ALONE:
        if OmegaConf.select(cfg, key) and not any(word.lstrip("+").startswith(key) for word in words):
            raise ContactLearnError(f"{key} comes from a file; it is taken from the command line alone")
    for key in _LOGGING:
        found = OmegaConf.select(cfg, key)
        for path, value in _texts({} if found is None else OmegaConf.to_container(found), key):
            name = path.rpartition(".")[2]
            made = name == "()" or (name == "class" and not value.startswith("logging."))
            hidden = ("${" in value and name != "filename") or ("://" in value and value not in _STREAMS)
            if (made and value not in _FORMATTERS) or hidden:
                raise ContactLearnError(f"{path}={value} is more than a log; take it out of the configuration")


def _targets(content: Any, path: str) -> Iterator[tuple[str, str]]:
    """Dotted keys and values of every `_target_`."""
    for key, value in _texts(content, path):
        if key.rpartition(".")[2] == "_target_":
            yield key, value


def _texts(content: Any, path: str) -> Iterator[tuple[str, str]]:
    """Dotted keys and values of everything that is neither a mapping nor a list, as text."""
    if isinstance(content, Mapping):
        for name, value in content.items():
            yield from _texts(value, f"{path}.{name}" if path else str(name))
    elif isinstance(content, list):
        for value in content:
            yield from _texts(value, path)
    elif content is not None:
        yield path, str(content)


def _declared(target: str) -> bool:
    """Whether a class is of this package, or of one that announces laws or effects."""
    root = target.partition(".")[0]
    announced = (entry for group in _GROUPS for entry in entry_points(group=group))
    return root == "contactlearn" or any(entry.module.partition(".")[0] == root for entry in announced)


def _named(target: str, words: Iterable[str]) -> bool:
    """Whether a word names a class as a `_target_`."""
    exact = re.compile(rf"""_target_['"]?\s*[=:]\s*['"]?{re.escape(target)}(?![\w.])""")
    return any(exact.search(word) for word in words)
