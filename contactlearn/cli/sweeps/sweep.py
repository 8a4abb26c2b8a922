"""A whole sweep: finds the jobs that are left, launches them whatever happens to single ones, and lists failed ones.

Jobs are judged by what they left on disk.  The return values of a launcher count for little: one killed job takes
those of the others with it.  A job that fails leaves the reason in its folder, or in its return value where the disk
is full, and the others go on.  Where a launcher itself breaks down, for example because a job was killed for its
memory, jobs that had not begun are launched again together, and those that had begun each alone.
"""

import os
import re
import shlex
import sys
import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory

from hydra.core.plugins import Plugins
from hydra.core.utils import JobStatus
from hydra.types import HydraContext, TaskFunction
from omegaconf import DictConfig, OmegaConf, open_dict

from contactlearn.cli.config_files import restrict_settings
from contactlearn.cli.resource_limits import GIB, jobs_at_a_time
from contactlearn.cli.sweeps.identity import DIGITS, job_identity, still_valid, words_digest
from contactlearn.core.errors import ContactLearnError, install_hint, terminal_safe
from contactlearn.core.numerics import atomic_write
from contactlearn.report.terminal import show_sweep
from contactlearn.results.state import FAILED, Done, begun, is_locked, read_done, read_failed

Launch = Callable[[Sequence["Job"]], Sequence[str | None]]
"""Runs jobs, and returns the reason of each that failed."""
_EXTRAS = {"joblib": "joblib", "submitit": "slurm", "ray": "ray"}  # optional dependencies by a word of the launcher
_POLL = 0.5  # s between looks at a job that another process runs
_LAUNCHES = 3  # of a job that does not begin, at most
_SILENT = "ended without a result and without a reason; was it killed?"
_LONGEST_NAME = 80  # characters of the settings in the name of a folder


@dataclass(frozen=True, kw_only=True)
class Job:
    """A job: its settings as a user would type them, those of them that are swept, and its folder."""

    words: tuple[str, ...]
    name: str
    folder: Path

    @property
    def finished(self) -> bool:
        """Whether its folder holds its whole result."""
        return read_done(self.folder) is not None

    @property
    def overrides(self) -> list[str]:
        """The words that a launcher needs: those typed, and the folder."""
        return [*self.words, f"hydra.sweep.subdir='{self.folder.name}'"]


@dataclass(frozen=True, kw_only=True)
class Plan:
    """The jobs of a sweep, each once: those to run, and those that were finished before."""

    pending: list[Job]
    finished: list[Job]


def plan_jobs(hydra: DictConfig, several: Sequence[Sequence[str]], compose: Callable[[list[str]], DictConfig]) -> Plan:
    """Find the folder of each job, and leave out the finished ones; those are not even composed.

    Args:
        hydra: Hydra's part of the configuration of the sweep.
        several: settings of each job.
        compose: gives the configuration of a job from its settings; raises for a wrong one.

    Raises:
        OSError: a data file, or the folder of the sweep, cannot be read.
    """
    root = Path(str(hydra.sweep.dir))
    folders, known = dict[str, str](), list[Done]()
    for entry in os.listdir(root) if root.is_dir() else []:
        digest = entry.rpartition("-")[2]
        if re.fullmatch(rf"[0-9a-f]{{{DIGITS}}}", digest):
            folders[digest] = entry
            done = read_done(root / entry)
            known += [] if done is None or done.job != digest else [done]
    sources = {(one.code, one.data, one.paths): one for one in known}
    sound = {key for key, one in sources.items() if still_valid(one)}
    by_words = {one.words: one for one in known if one.words and (one.code, one.data, one.paths) in sound}
    everywhere = set(several[0]).intersection(*several) if several else set[str]()
    jobs, finished = dict[str, Job](), set[str]()
    for words in several:
        name = ",".join(word for word in words if word not in everywhere)
        done = by_words.get(words_digest(hydra, words))
        if done is not None:
            finished.add(done.job)
        else:
            cfg = compose(list(words))
            done = job_identity(cfg, cfg.hydra)
        if done.job not in jobs:
            plain = re.sub(r"\[([^]]*)\]", lambda found: found[1].replace(",", "+") or "none", name)
            plain = re.sub(r"[^\w.,=+-]+", "_", plain).strip("_.,-")[:_LONGEST_NAME] or "job"
            folder = root / folders.get(done.job, f"{plain}-{done.job}")
            jobs[done.job] = Job(words=tuple(words), name=name or "all as given", folder=folder)
    finished |= {digest for digest, job in jobs.items() if digest not in finished and job.finished}
    return Plan(
        pending=[job for digest, job in jobs.items() if digest not in finished],
        finished=[job for digest, job in jobs.items() if digest in finished],
    )


@dataclass
class Outcome:
    """Launched jobs by their end: those that failed with the reason, and those that may still wait in a queue."""

    finished: list[Job] = field(default_factory=list)
    failed: list[tuple[Job, str]] = field(default_factory=list)
    queued: list[Job] = field(default_factory=list)


def sweep(
    config: DictConfig, context: HydraContext, task: TaskFunction, several: Sequence[Sequence[str]], gigabytes: float
) -> None:
    """Run the jobs of a sweep that are not finished; the process ends with status 1 if one failed.

    Args:
        config: of the sweep.
        context: of Hydra, which composes the configuration of each job.
        task: a job.
        several: settings of each job.
        gigabytes: memory of one job, GiB.

    Raises:
        ContactLearnError: a wrong setting in any of the jobs, none of which runs then; or a launcher that is missing.
        OSError: the folder of the sweep cannot be made or written.
    """
    folder = Path(str(config.hydra.sweep.dir))

    def compose(words: list[str]) -> DictConfig:
        found = context.config_loader.load_sweep_config(config, words)
        restrict_settings(found, str(config.hydra.job.config_name), words)
        return found

    plan, outcome = plan_jobs(config.hydra, several, compose), Outcome()
    before = f", {len(plan.finished)} finished before" if plan.finished else ""
    print(f"sweep    {len(plan.pending) + len(plan.finished)} jobs{before}, in {folder}", flush=True)
    if plan.pending:
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(prefix=".probe-", dir=folder):  # fails now rather than in every job
            pass
        with atomic_write(folder / "multirun.yaml") as part:  # as Hydra's own sweeper
            OmegaConf.save(config, part)
        target = str(config.hydra.launcher._target_)
        at_once = jobs_at_a_time(-1, gigabytes) if target.endswith("LocalLauncher") else None
        launch = _launcher(config, context, task, gigabytes, len(plan.pending))
        with _curves(folder, plan):
            outcome = run_jobs(plan.pending, launch, at_once, queues=target.endswith("SlurmLauncher"))
    finished = [job.folder for job in (*plan.finished, *outcome.finished)]
    if finished:
        show_sweep(finished, folder)
    counts = [f"{len(finished)} finished"]
    counts += [f"{len(outcome.queued)} without a result yet"] if outcome.queued else []
    counts += [f"{len(outcome.failed)} failed"] if outcome.failed else []
    print(f"sweep    {', '.join(counts)}")
    again = f"The same command with hydra.sweep.dir={shlex.quote(str(folder))}"
    for job, reason in outcome.failed:  # last, where a user looks
        print(terminal_safe(f"failed   {job.name}: {reason}\n         {job.folder}"), file=sys.stderr)
    if outcome.queued:
        print(f"The others go on in the queue. {again} shows them when they have ended.", file=sys.stderr)
    if outcome.failed:
        print(f"{again} runs the failed ones again, and no others.", file=sys.stderr)
    if outcome.failed or outcome.queued:
        sys.exit(1)


def _curves(folder: Path, plan: Plan) -> AbstractContextManager[None]:
    """Learning curves that grow in TensorBoard, where the sweep is over train.size."""
    jobs = {job.folder: job.words for job in (*plan.finished, *plan.pending)}
    everywhere = set[str]().union(*jobs.values()).intersection(*jobs.values())
    swept = {folder: [word for word in words if word not in everywhere] for folder, words in jobs.items()}
    if not any(word.startswith("train.size=") for words in swept.values() for word in words):
        return nullcontext()
    from contactlearn.report.sweep_curves import growing_curves  # TensorBoard takes long to load

    return growing_curves(folder, swept)


def run_jobs(jobs: Sequence[Job], launch: Launch, at_once: int | None, queues: bool) -> Outcome:
    """Run jobs until each is finished or has failed.

    Args:
        jobs: to run.
        launch: runs several jobs and returns when they have ended; an exception is its breakdown.
        at_once: jobs to launch at a time; None for all.
        queues: whether jobs go on by themselves after a breakdown, so that they must not be launched again.
    """
    outcome, vain = Outcome(), Counter[Path]()  # launches after which no job of a batch had begun
    size = at_once or max(1, len(jobs))
    batches = deque(list(jobs[k : k + size]) for k in range(0, len(jobs), size))
    while batches:
        batch = batches.popleft()
        before = {job.folder: begun(job.folder) for job in batch}
        for job in batch:
            (job.folder / FAILED).unlink(missing_ok=True)
        reasons, breakdown = [None] * len(batch), None
        try:
            reasons = launch(batch)
        except Exception as error:  # the launcher's own
            breakdown = (str(error).strip() or type(error).__name__).splitlines()[0]
        left = [job for job, why in zip(batch, reasons, strict=True) if not _is_settled(job, why, outcome)]
        stopped = [job for job in left if begun(job.folder) != before[job.folder]]
        waiting = [job for job in left if job not in stopped]
        if breakdown is not None and queues:
            outcome.queued += left
            continue
        if waiting == batch:
            if breakdown is not None:
                outcome.failed += [(job, f"could not be launched: {breakdown}") for job in batch]
                continue
            vain.update(job.folder for job in batch)
        if len(batch) > 1:
            batches += [[job] for job in stopped]
        else:
            outcome.failed += [(job, _SILENT) for job in stopped]
        outcome.failed += [(job, _SILENT) for job in waiting if vain[job.folder] == _LAUNCHES]
        if again := [job for job in waiting if vain[job.folder] < _LAUNCHES]:
            batches.append(again)
    return outcome


def _is_settled(job: Job, returned: str | None, outcome: Outcome) -> bool:
    """Enter a job that finished or failed; one that another process runs is waited for, since it may be killed."""
    while is_locked(job.folder):
        time.sleep(_POLL)
    failed = read_failed(job.folder)
    if job.finished:
        outcome.finished.append(job)
    elif failed is not None or returned is not None:
        outcome.failed.append((job, failed.reason if failed is not None else str(returned)))
    else:
        return False
    return True


def _limit(launcher: DictConfig, gigabytes: float, jobs: int) -> None:
    """Ask a launcher for no more processes than memory allows."""
    with open_dict(launcher):
        if "n_jobs" in launcher:
            launcher.n_jobs = min(jobs, jobs_at_a_time(launcher.n_jobs, gigabytes))
        elif "ray" in launcher and launcher.ray.init.get("address") is None:
            launcher.ray.init.num_cpus = min(jobs, jobs_at_a_time(launcher.ray.init.get("num_cpus") or -1, gigabytes))
            launcher.ray.remote.pop("memory", None)
        elif "ray" in launcher:
            launcher.ray.init.pop("num_cpus", None)
            launcher.ray.remote.memory = launcher.ray.remote.get("memory") or int(gigabytes * GIB)


def _launcher(config: DictConfig, context: HydraContext, task: TaskFunction, gigabytes: float, jobs: int) -> Launch:
    """The launcher of the configuration, with no more processes than memory allows."""
    target = str(config.hydra.launcher._target_)
    _limit(config.hydra.launcher, gigabytes, jobs)
    try:
        launcher = Plugins.instance().instantiate_launcher(hydra_context=context, task_function=task, config=config)
    except (ImportError, RuntimeError) as error:
        extra = next((extra for word, extra in _EXTRAS.items() if word in target), None)
        if extra is None:
            raise
        raise ContactLearnError(f"{target.rpartition('.')[2]} is not installed: {install_hint(extra)}") from error
    side_by_side = not target.endswith("BasicLauncher") and "workers" in config
    launched: list[Job] = []

    def launch(batch: Sequence[Job]) -> list[str | None]:
        first = len(launched)
        launched.extend(batch)
        words = [[*(["workers=1"] if side_by_side else []), *job.overrides] for job in batch]  # typed ones come later
        returns = launcher.launch(words, initial_job_idx=first)
        failed = (getattr(one, "_return_value", None) if one.status == JobStatus.FAILED else None for one in returns)
        return [None if error is None else str(error) for error in failed]

    return launch
