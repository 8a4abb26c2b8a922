"""Classes that a configuration may name: a file that somebody shared is data, and must not choose what is run.

A `_target_` may name

    a class of this package
    a class of a package that announces laws or effects under an entry point: it was installed
    a class that the command line itself names: law._target_=my_module.MyLaw
    under `model`, a class of GPyTorch or an optimiser of PyTorch, which `models.gp.modules` looks up

and nothing else, before anything is imported.  Hydra's launchers and sweepers come from its plugins;
its callbacks and settings of the environment are only taken from the command line, and its logging may only write logs.
"""

import re
from collections.abc import Generator, Iterable, Iterator, Mapping
from contextlib import contextmanager
from importlib.metadata import entry_points
from typing import Any

from hydra._internal.config_loader_impl import ConfigLoaderImpl  # the one private import, see `restrict_targets`
from hydra.errors import HydraException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError

from contactlearn.cli.config_files import leaf_values
from contactlearn.core.errors import ContactLearnError
from contactlearn.core.signals import defer_interrupts

_GROUPS = ("contactlearn.laws", "contactlearn.effects")
_PLUGINS = ("hydra_plugins.", "hydra._internal.core_plugins.")
_TYPED_ALONE = ("hydra.callbacks", "hydra.job.env_set")
_LOGGING = ("hydra.job_logging", "hydra.hydra_logging")
_FORMATTERS = ("colorlog.ColoredFormatter",)  # of Hydra's plugin of that name
_STREAMS = ("ext://sys.stdout", "ext://sys.stderr")


@contextmanager
def restrict_targets() -> Generator[None]:
    """Check every configuration that `hydra.main` composes, before Hydra itself makes anything of it.

    Hydra has no public place for that.  It configures logs, whose settings can name any function to call, and builds
    callbacks, sweeper and launcher before the first event that a callback or a plugin receives; and a sweep composes
    each job by itself.  `load_configuration` is where all of these configurations come from.

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
        with defer_interrupts(), readable_errors():
            cfg = load(self, config_name, overrides, run_mode, from_shell, validate_sweep_overrides)
        check_targets(cfg, overrides)
        return cfg

    ConfigLoaderImpl.load_configuration = checked
    try:
        yield
    finally:
        ConfigLoaderImpl.load_configuration = load


@contextmanager
def readable_errors() -> Generator[None]:
    """Put into words what Hydra has no error of its own for, such as law=null.

    Raises:
        ContactLearnError: for a TypeError or ValueError of Hydra while it composes a configuration, or a file that is
            not YAML.
    """
    try:
        yield
    except (HydraException, OmegaConfBaseException, ContactLearnError):
        raise
    except YAMLError as error:
        raise ContactLearnError(f"a configuration file is not YAML: {' '.join(str(error).split())}") from error
    except (TypeError, ValueError) as error:
        seen = " ".join(str(error).split())
        raise ContactLearnError(
            f"a word of the command line cannot be read: {seen}; --help lists all settings"
        ) from error


def check_targets(cfg: DictConfig, words: Iterable[str]) -> None:
    """Raise for a class, or a function, that a configuration names and that was not declared.

    Args:
        cfg: a composed configuration, with Hydra's part or without.
        words: of the command line.

    Raises:
        ContactLearnError: naming the setting, and the word that would allow it.
    """
    typed = list(words)
    for key, target in _targets({str(name): _resolved(cfg, name) for name in cfg if name != "hydra"}):
        module = key.startswith("model.") and target.startswith(("gpytorch.", "torch.optim."))
        if not module and not _is_declared(target) and not _is_typed(target, typed):
            raise ContactLearnError(
                f"{key}={target} comes from a file; a class of another package is only taken from the command line: "
                f"add {key}={target} to it, if you trust that class"
            )
    hydra = OmegaConf.select(cfg, "hydra")
    if hydra is None:
        return
    if not OmegaConf.is_config(hydra):
        raise ContactLearnError(f"hydra holds Hydra's own settings, and cannot be {hydra!r}; set one, as hydra.run.dir")
    for key, target in _targets({"hydra": OmegaConf.to_container(hydra, resolve=False)}):
        if not target.startswith(_PLUGINS) and not _is_typed(target, typed):
            raise ContactLearnError(f"{key}={target} is no plugin of Hydra's; take it out of the configuration")
    for key in _TYPED_ALONE:
        if OmegaConf.select(cfg, key) and not any(word.lstrip("+").startswith(key) for word in typed):
            raise ContactLearnError(f"{key} comes from a file; it is only taken from the command line")
    for key in _LOGGING:
        logs = OmegaConf.select(cfg, key)
        for path, value in leaf_values({} if logs is None else OmegaConf.to_container(logs), tuple(key.split("."))):
            if value is not None and not _is_of_a_log(path[-1], str(value)):
                name = ".".join(path)
                raise ContactLearnError(f"{name}={value} is more than a log; take it out of the configuration")


def _resolved(cfg: DictConfig, name: Any) -> Any:
    """A part of a configuration as plain values; as written if it refers to something that is not there yet."""
    if OmegaConf.is_missing(cfg, name):
        return None
    try:
        part = cfg[name]
        return OmegaConf.to_container(part, resolve=True) if OmegaConf.is_config(part) else part
    except (OmegaConfBaseException, ValueError):  # a job, which refers to the same, fails
        written = OmegaConf.to_container(cfg)
        return written[name] if isinstance(written, dict) else None


def _targets(content: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Dotted keys and values of every `_target_`."""
    return (
        (".".join(path), str(one)) for path, one in leaf_values(content) if path[-1] == "_target_" and one is not None
    )


def _is_of_a_log(name: str, value: str) -> bool:
    """Whether an entry of a log's settings makes nothing but handlers and formatters of `logging`."""
    factory = name == "()" or (name == "class" and not value.startswith("logging."))
    hidden = ("${" in value and name != "filename") or ("://" in value and value not in _STREAMS)
    return not hidden and (not factory or value in _FORMATTERS)


def _is_declared(target: str) -> bool:
    """Whether a class is of this package, or of one that announces laws or effects."""
    root = target.partition(".")[0]
    announced = (entry for group in _GROUPS for entry in entry_points(group=group))
    return root == "contactlearn" or any(entry.module.partition(".")[0] == root for entry in announced)


def _is_typed(target: str, words: Iterable[str]) -> bool:
    """Whether a word of the command line names a class as a `_target_`."""
    exact = re.compile(rf"""_target_['"]?\s*[=:]\s*['"]?{re.escape(target)}(?![\w.])""")
    return any(exact.search(word) for word in words)
