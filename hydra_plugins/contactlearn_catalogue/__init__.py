"""Hydra's way to effects and laws, which have no files, and to files of the user's; see `cli.config_files`."""

from pathlib import Path

from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.object_type import ObjectType
from hydra.plugins.config_source import ConfigResult, ConfigSource
from hydra.plugins.search_path_plugin import SearchPathPlugin
from omegaconf import OmegaConf

from contactlearn.cli.config_files import CONFIGS, added_folders, choice_settings, choices
from contactlearn.cli.config_security import SharedFolder

_SCHEME = "contactlearn"
_GROUPS = ("effect", "law", "data")


class CatalogueSource(ConfigSource):
    """A configuration for each effect and law, made when it is chosen, and for each file of data of the user's."""

    @staticmethod
    def scheme() -> str:
        """Return the scheme of the paths of this source."""
        return _SCHEME

    def load_config(self, config_path: str) -> ConfigResult:
        """Make the configuration of a choice, such as effect/side_drag or data/mydata."""
        group, _, name = config_path.removesuffix(".yaml").partition("/")
        config = OmegaConf.create(choice_settings(group, name))
        return ConfigResult(self.provider, f"{_SCHEME}://", config, header={"package": None})

    def available(self) -> bool:
        """Return that it always is."""
        return True

    def is_group(self, config_path: str) -> bool:
        """Whether a path is one of the groups, or holds them."""
        return config_path.strip("/") in ("", *_GROUPS)

    def is_config(self, config_path: str) -> bool:
        """Whether a path is a choice of one of them."""
        group, _, name = config_path.removesuffix(".yaml").partition("/")
        return group in _GROUPS and name in choices(group)

    def list(self, config_path: str, results_filter: ObjectType | None) -> list[str]:
        """Return the choices of a group, or the groups."""
        group = config_path.strip("/")
        if results_filter == (ObjectType.GROUP if group else ObjectType.CONFIG):
            return []
        return choices(group) if group else [*_GROUPS]


class CatalogueSearchPath(SearchPathPlugin):
    """Adds the groups wherever the configurations of this package are used, and nowhere else."""

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        """Append the groups to the search path, and have the shipped files read once."""
        places = [one for one in search_path.get_path() if one.path]
        shipped = [one for one in places if Path(str(one.path).removeprefix("file://")) == Path(CONFIGS)]
        for one in shipped:
            one.path = f"{SharedFolder.scheme()}://{CONFIGS}"
        if shipped:
            search_path.append(_SCHEME, f"{_SCHEME}://")
            first, last = added_folders()
            if first is not None:
                search_path.prepend("user", f"{SharedFolder.scheme()}://{first}", "main")
            if last is not None:
                search_path.append("user", f"{SharedFolder.scheme()}://{last}")
