"""A whole sweep: plans it, runs what is left, and says what became of it."""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from hydra.core.plugins import Plugins
from hydra.core.utils import JobStatus
from hydra.types import HydraContext, TaskFunction
from omegaconf import DictConfig, open_dict

from contactlearn.cli.config_files import check_settings
from contactlearn.cli.resource_limits import GIB, jobs_at_a_time
from contactlearn.cli.sweeps.jobs import Job, Plan, planned
from contactlearn.cli.sweeps.rounds import Launch, Outcome, run_jobs
from contactlearn.core.errors import ContactLearnError, harmless, installing

_EXTRAS = {"joblib": "joblib", "submitit": "slurm", "ray": "ray"}
"""Optional dependencies by a word in the class of their launcher."""


def sweep(
    config: DictConfig,
    context: HydraContext,
    task: TaskFunction,
    several: Sequence[Sequence[str]],
    gigabytes: float,
    show: Callable[[Sequence[Path], Path], None],
) -> None:
    """Run the jobs of a sweep that are not finished; the process ends with status 1 if one failed.

    Args:
        config: of the sweep.
        context: of Hydra, which composes the configuration of each job.
        task: a job.
        several: settings of each job.
        gigabytes: memory of one job, GiB.
        show: shows the finished runs of a sweep, by their folders and its own.

    Raises:
        ContactLearnError: a wrong setting in any of the jobs, none of which runs then; or a launcher that is not there.
        OSError: the folder of the sweep cannot be made or written.
    """
    command, loader = str(config.hydra.job.config_name), context.config_loader

    def compose(words: list[str]) -> DictConfig:
        found = loader.load_sweep_config(config, words)
        check_settings(found, command)
        return found

    plan = planned(config.hydra, several, compose)
    _announce(plan, str(config.hydra.sweep.dir))
    outcome = Outcome()
    if plan.pending:
        _writable(Path(str(config.hydra.sweep.dir)))
        target = str(config.hydra.launcher._target_)
        at_once = jobs_at_a_time(-1, gigabytes) if target.endswith("LocalLauncher") else None
        launch = _launcher(config, context, task, gigabytes, len(plan.pending))
        outcome = run_jobs(plan.pending, launch, at_once, queues=target.endswith("SlurmLauncher"))
    finished = [job.folder for job in (*plan.finished, *outcome.finished)]
    if finished:
        show(finished, Path(str(config.hydra.sweep.dir)))
    _conclude(plan, outcome)


def _writable(folder: Path) -> None:
    """Make a folder, and raise now rather than in every job if it cannot be written."""
    folder.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(prefix=".probe-", dir=folder):
        pass


def _launcher(config: DictConfig, context: HydraContext, task: TaskFunction, gigabytes: float, jobs: int) -> Launch:
    """What runs several jobs: the launcher of the configuration, with no more processes than memory allows."""
    target = str(config.hydra.launcher._target_)
    _limit(config.hydra.launcher, gigabytes, jobs)
    try:
        launcher = Plugins.instance().instantiate_launcher(hydra_context=context, task_function=task, config=config)
    except (ImportError, RuntimeError) as error:
        extra = next((extra for word, extra in _EXTRAS.items() if word in target), None)
        if extra is None:
            raise
        raise ContactLearnError(f"{target.rpartition('.')[2]} is not installed: {installing(extra)}") from error
    side_by_side = not target.endswith("BasicLauncher") and "workers" in config
    launched: list[Job] = []

    def launch(batch: Sequence[Job]) -> list[str | None]:
        first = len(launched)
        launched.extend(batch)
        words = [[*(["workers=1"] if side_by_side else []), *job.overrides] for job in batch]  # unless said otherwise
        returns = launcher.launch(words, initial_job_idx=first)
        failed = (getattr(one, "_return_value", None) if one.status == JobStatus.FAILED else None for one in returns)
        return [None if error is None else str(error) for error in failed]

    return launch


def _limit(launcher: DictConfig, gigabytes: float, jobs: int) -> None:
    """Let a launcher run no more jobs at a time than memory allows."""
    with open_dict(launcher):
        if "n_jobs" in launcher:
            launcher.n_jobs = min(jobs, jobs_at_a_time(launcher.n_jobs, gigabytes))
        elif "ray" in launcher and launcher.ray.init.get("address") is None:
            launcher.ray.init.num_cpus = min(jobs, jobs_at_a_time(launcher.ray.init.get("num_cpus") or -1, gigabytes))
            launcher.ray.remote.pop("memory", None)
        elif "ray" in launcher:
            launcher.ray.init.pop("num_cpus", None)
            launcher.ray.remote.memory = launcher.ray.remote.get("memory") or int(gigabytes * GIB)


def _announce(plan: Plan, folder: str) -> None:
    before = f", {len(plan.finished)} finished before" if plan.finished else ""
    print(f"sweep    {len(plan.pending) + len(plan.finished)} jobs{before}, in {folder}", flush=True)


def _conclude(plan: Plan, outcome: Outcome) -> None:
    """Say what became of the jobs, failed ones last, where a user looks; end with status 1 if there are any."""
    finished = len(plan.finished) + len(outcome.finished)
    counts = [f"{finished} finished"]
    counts += [f"{len(outcome.queued)} without a result yet"] if outcome.queued else []
    counts += [f"{len(outcome.failed)} failed"] if outcome.failed else []
    print(f"sweep    {', '.join(counts)}")
    for job, reason in outcome.failed:
        print(harmless(f"failed   {job.name}: {reason}\n         {job.folder}"), file=sys.stderr)
    if outcome.queued:
        print("The others go on in the queue; the same command shows them when they have ended.", file=sys.stderr)
    if outcome.failed:
        print("The same command runs the failed ones again, and no others.", file=sys.stderr)
    if outcome.failed or outcome.queued:
        sys.exit(1)
