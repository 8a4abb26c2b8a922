"""Hydra's `-m` for contactlearn: a sweep that resumes where it stopped, see `contactlearn.cli.sweeps`."""

from itertools import product

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.errors import HydraException
from hydra.plugins.sweeper import Sweeper
from hydra.types import HydraContext, TaskFunction
from omegaconf import DictConfig


class ResumingSweeper(Sweeper):
    """All combinations of the values of each setting, as Hydra's own sweeper forms them; finished ones are skipped."""

    def __init__(self, gigabytes: float):
        self.gigabytes = gigabytes

    def setup(self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig) -> None:
        """Store what a sweep needs."""
        self.hydra_context, self.task_function, self.config = hydra_context, task_function, config

    def sweep(self, arguments: list[str]) -> None:
        """Run the jobs of a command line that are not finished; the process ends with status 1 if one failed."""
        from contactlearn.cli.sweeps.sweep import sweep

        assert self.hydra_context is not None
        assert self.config is not None
        overrides = OverridesParser.create(self.hydra_context.config_loader).parse_overrides(arguments)
        words = {override.get_key_element(): _words(override) for override in overrides}  # the last of a setting counts
        several = [list(job) for job in product(*words.values())]
        sweep(self.config, self.hydra_context, self.task_function, several, self.gigabytes)


def _words(override: Override) -> list[str]:
    """A setting with each of its values.

    Raises:
        HydraException: a range without steps, which only other sweepers take.
    """
    key = override.get_key_element()
    if not override.is_sweep_override():
        return [f"{key}={override.get_value_element_as_str()}"]
    if not override.is_discrete_sweep():
        raise HydraException(f"{key} must be swept over single values, such as {key}=1,2,3; got {override.input_line}")
    return [f"{key}={value}" for value in override.sweep_string_iterator()]
