"""Hydra's `-m` for contactlearn: a sweep that goes on where it stopped, see `contactlearn.cli.sweeps`."""

from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.plugins.sweeper import Sweeper
from hydra.types import HydraContext, TaskFunction
from omegaconf import DictConfig


class ResumingSweeper(Sweeper):
    """All combinations of the values of each setting, as Hydra's own sweeper forms them; finished ones are skipped."""

    def __init__(self, gigabytes: float):
        self.gigabytes = gigabytes

    def setup(self, *, hydra_context: HydraContext, task_function: TaskFunction, config: DictConfig) -> None:
        """Keep what a sweep needs."""
        self.hydra_context, self.task_function, self.config = hydra_context, task_function, config

    def sweep(self, arguments: list[str]) -> None:
        """Run the jobs of a command line that are not finished; the process ends with status 1 if one failed."""
        from contactlearn.cli.sweeps.sweep import sweep
        from contactlearn.report.sweep import show_sweep

        assert self.hydra_context is not None
        assert self.config is not None
        overrides = OverridesParser.create(self.hydra_context.config_loader).parse_overrides(arguments)
        (several,) = BasicSweeper.split_arguments(overrides, None)
        sweep(self.config, self.hydra_context, self.task_function, several, self.gigabytes, show_sweep)
