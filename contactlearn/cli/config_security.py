"""What a configuration file may say: a file that somebody shared is data, and must not choose what is run.

A `_target_` may name

    a class of this package
    a class of a package that announces laws or effects under an entry point: it was installed
    a class that the command line itself names: law._target_=my_module.MyLaw
    under `model`, a class of GPyTorch or an optimiser of PyTorch, which `models.gp.modules` looks up

and nothing else, before anything is imported.  Of Hydra's own settings a file may set folders, the name and the working
directory of a job, the parameters of a sweep, and values of launchers and sweepers that are installed.  All others,
such as callbacks and logs, make Hydra call what they name, and are only taken from the command line.

Every file but the shipped ones is read by `read_checked`: through `--config-dir`, as Hydra composes it in whatever
process, and through `data=NAME`.
"""

import pickle
import re
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import yaml
from hydra.core.object_type import ObjectType
from hydra.plugins.config_source import ConfigResult, ConfigSource
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from contactlearn.core.entry_points import announced
from contactlearn.core.errors import ContactLearnError

_GROUPS = ("contactlearn.laws", "contactlearn.effects")
_PLUGIN = re.compile(r"(hydra_plugins|hydra\._internal\.core_plugins)(\.\w+)+\.\w+(Launcher|Sweeper)")
_HARMLESS = ("run", "sweep", "mode", "verbose", "output_subdir", "help", "sweeper", "launcher")
_HARMLESS_OF_A_JOB = ("name", "chdir", "config")
_RUNNING = ("setup", "additional_parameters", "srun_args", "python", "runtime_env", "env_vars")
"""Settings of launchers that become commands of a shell, or code."""
_PLAIN = re.compile(r"([\w ./:%@+=,-]|\$\{(hydra\.|oc\.env:|now:)[\w.,:%/-]*\})*")
"""Text in settings of launchers: a line of Slurm's script, and no reference to what another file says."""
_LARGEST_FILE, _MOST_VALUES, _MOST_REFERENCES = 1 << 20, 100_000, 32
"""Bytes, values with every alias written out, and references ${…}, which can multiply like aliases."""


def read_checked(file: Path, group: str = "") -> DictConfig:
    """Read a configuration file of somebody's, and refuse what would run code.

    Args:
        file: to read.
        group: that it is a choice of, such as hydra/launcher.

    Raises:
        ContactLearnError: it is not YAML, larger than any configuration, or sets what only the command line may.
    """
    try:
        text = file.read_text("utf-8") if file.stat().st_size <= _LARGEST_FILE else None
        size = _LARGEST_FILE if text is None else _values(yaml.compose(text, yaml.SafeLoader), {})
        if text is None or size > _MOST_VALUES or text.count("${") > _MOST_REFERENCES:
            raise ContactLearnError(
                f"{file.name}: is larger than a configuration may be: {_MOST_VALUES} values with every alias written "
                f"out, {_MOST_REFERENCES} references ${{…}} and 1 MiB"
            )
        config = OmegaConf.load(file)
    except ContactLearnError:
        raise
    except (OSError, ValueError, RecursionError, yaml.YAMLError, OmegaConfBaseException) as error:
        why = "a configuration file is not YAML: " if isinstance(error, yaml.YAMLError) else ""
        raise ContactLearnError(f"{file.name}: {why}{' '.join(str(error).split())}") from error
    if not isinstance(config, DictConfig):
        raise ContactLearnError(f"{file.name}: must hold settings by name, such as seed: 3")
    stated, own = SharedFolder.header(text).get("package"), group.replace("/", ".")
    package = own if stated is None else stated.replace("_global_", "").replace("_group_", own).strip(".")
    content: Any = {str(key): value for key, value in _plain(config).items()}
    _check_defaults(content.pop("defaults", None) or [], package, stated is not None, file.name)
    for part in reversed(package.split(".") if package else []):
        content = {part: content}
    _check_hydra(content.get("hydra", {}), file.name)
    return config


def _values(node: yaml.Node | None, known: dict[int, float]) -> float:
    """Number of values below a node with every alias written out; endless for one that holds itself."""
    if node is None or isinstance(node, yaml.ScalarNode):
        return 1
    if id(node) not in known:
        known[id(node)] = float("inf")  # until it is counted: a node that holds itself has no end
        parts = [part for pair in node.value for part in (pair if isinstance(pair, tuple) else (pair,))]
        known[id(node)] = 1 + sum(_values(part, known) for part in parts)
    return known[id(node)]


def _plain(config: DictConfig) -> Mapping[Any, Any]:
    content = OmegaConf.to_container(config)
    assert isinstance(content, dict)
    return content


def _check_defaults(entries: Any, package: str, has_header: bool, file: str) -> None:
    """Refuse a defaults list that puts another file where Hydra's settings are."""
    for entry in entries if isinstance(entries, list) else [entries]:
        names = [str(name) for name in entry] if isinstance(entry, Mapping) else [str(entry)]
        for name in names:
            place = name.partition("@")[2]
            into = place and (package.startswith("hydra") or "$" in place or "hydra" in re.split(r"[.:/]", place))
            if into or (has_header and package.startswith("hydra")):
                raise ContactLearnError(f"{file}: defaults: {name} goes into Hydra's settings; take it out of the file")


def _check_hydra(hydra: Any, file: str) -> None:
    """Refuse Hydra's settings that make it call what they name, or hand it to a shell."""
    if not isinstance(hydra, Mapping):
        raise ContactLearnError(f"{file}: hydra holds Hydra's own settings, and cannot be {hydra!r}")
    for path, value in leaf_values(hydra, ("hydra",)):
        key, text = ".".join(path), str(value)
        harmless = path[1:2] and (
            path[1] in _HARMLESS or (path[1] == "job" and path[2:3] and path[2] in _HARMLESS_OF_A_JOB)
        )
        if not harmless:
            raise ContactLearnError(f"{file}: {key} is only taken from the command line; take it out of the file")
        if path[1] not in ("sweeper", "launcher"):
            continue
        if path[-1] == "_target_" and not _PLUGIN.fullmatch(text):
            raise ContactLearnError(f"{file}: {key}={text} is no plugin of Hydra's; take it out of the file")
        if path[1:3] == ("sweeper", "params"):  # which become words of each job
            word = f"{'.'.join(path[3:])}={text}"
            if "_target_" in word or "@" in word or re.match(r"[+~\s'\"]*hydra\b", word):
                raise ContactLearnError(f"{file}: {key} is only taken from the command line; take it out of the file")
        elif not _PLAIN.fullmatch(text) or not set(path).isdisjoint(_RUNNING):
            raise ContactLearnError(f"{file}: {key} is only taken from the command line; take it out of the file")


class SharedFolder(ConfigSource):
    """A folder with configuration files: a user's, each of which is checked when Hydra composes it, or the shipped one.

    A command composes its configuration several times, and a sweep each job's: shipped files are parsed once.
    """

    @staticmethod
    def scheme() -> str:
        """Return the scheme of the paths of this source."""
        return "contactlearn-folder"

    def load_config(self, config_path: str) -> ConfigResult:
        """Read a file, and check a user's."""
        file = self._file(config_path)
        if self.provider == "main":  # the shipped folder alone: see `CatalogueSearchPath`
            status = file.stat()
            pickled, header = _shipped(file, status.st_mtime_ns, status.st_size)
            return ConfigResult(self.provider, self.full_path(), pickle.loads(pickled), dict(header))
        config = read_checked(file, config_path.removesuffix(".yaml").rpartition("/")[0])
        return ConfigResult(self.provider, self.full_path(), config, self.header(file.read_text("utf-8")))

    @staticmethod
    def header(text: str) -> dict[str, str | None]:
        """Return the header of a configuration file, such as its `@package`, as Hydra reads it."""
        return ConfigSource._get_header_dict(text[:512])

    def available(self) -> bool:
        """Whether the folder is there."""
        return self.is_group("")

    def is_group(self, config_path: str) -> bool:
        """Whether a path is a folder in this one."""
        return Path(self.path, config_path).is_dir()

    def is_config(self, config_path: str) -> bool:
        """Whether a path is a file in this folder."""
        return self._file(config_path).is_file()

    def list(self, config_path: str, results_filter: ObjectType | None) -> list[str]:
        """Return the names of files and folders in a folder."""
        found = list[str]()
        for entry in Path(self.path, config_path).iterdir():
            self._list_add_result(found, str(Path(config_path, entry.name)), entry.name, results_filter)
        return sorted(set(found))

    def _file(self, config_path: str) -> Path:
        return Path(self.path, self._normalize_file_name(config_path))


@cache
def _shipped(file: Path, changed: int, size: int) -> tuple[bytes, dict[str, str | None]]:
    """A shipped file, pickled here so that copies are quick, and its header; another one when the file has changed."""
    del changed, size
    return pickle.dumps(OmegaConf.load(file)), SharedFolder.header(file.read_text("utf-8"))


def check_targets(cfg: DictConfig, words: Iterable[str]) -> None:
    """Raise for a class that a configuration names and that was not declared.

    Args:
        cfg: a composed configuration.
        words: of the command line.

    Raises:
        ContactLearnError: naming the setting, and the word that would allow it.
    """
    typed = list(words)
    for path, target in leaf_values({str(name): _resolved(cfg, name) for name in cfg if name != "hydra"}):
        if path[-1] != "_target_" or target is None:
            continue
        key, target = ".".join(path), str(target)
        module = key.startswith("model.") and target.startswith(("gpytorch.", "torch.optim."))
        if not module and not _is_declared(target) and not _is_typed(target, typed):
            raise ContactLearnError(
                f"{key}={target} comes from a file; a class of another package is only taken from the command line: "
                f"add {key}={target} to it, if you trust that class"
            )


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


def _is_declared(target: str) -> bool:
    """Whether a class is of this package, or of one that announces laws or effects."""
    root = target.partition(".")[0]
    entries = (entry for group in _GROUPS for entry in announced(group))
    return root == "contactlearn" or any(entry.module.partition(".")[0] == root for entry in entries)


def _is_typed(target: str, words: Iterable[str]) -> bool:
    """Whether a word of the command line names a class as a `_target_`."""
    exact = re.compile(rf"""_target_['"]?\s*[=:]\s*['"]?{re.escape(target)}(?![\w.])""")
    return any(exact.search(word) for word in words)


def leaf_values(content: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield all that is neither a mapping nor a list, each with the names on the way; a list has no names."""
    if isinstance(content, Mapping):
        for name, value in content.items():
            yield from leaf_values(value, (*path, str(name)))
    elif isinstance(content, list):
        for value in content:
            yield from leaf_values(value, path)
    else:
        yield path, content
