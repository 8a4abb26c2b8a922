"""The jobs of a command line: what is swept, the folder of each, and whether it is finished."""

import os
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from omegaconf import DictConfig

from contactlearn.cli.sweeps.identity import DIGITS, job_identity, still_valid, words_digest
from contactlearn.results.state import Done, read_done

_LONGEST_NAME = 80


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
    folders, known = _known(root)
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
            folder = root / folders.get(done.job, f"{_readable(name)}-{done.job}")
            jobs[done.job] = Job(words=tuple(words), name=name or "all as given", folder=folder)
    finished |= {digest for digest, job in jobs.items() if digest not in finished and job.finished}
    return Plan(
        pending=[job for digest, job in jobs.items() if digest not in finished],
        finished=[job for digest, job in jobs.items() if digest in finished],
    )


def _known(root: Path) -> tuple[dict[str, str], list[Done]]:
    """Names of the job folders by digest, and what the finished ones hold."""
    folders, finished = {}, []
    for name in os.listdir(root) if root.is_dir() else []:
        digest = name.rpartition("-")[2]
        if re.fullmatch(rf"[0-9a-f]{{{DIGITS}}}", digest):
            folders[digest] = name
            done = read_done(root / name)
            finished += [] if done is None or done.job != digest else [done]
    return folders, finished


def _readable(name: str) -> str:
    """The swept settings, as part of the name of a folder."""
    inner = re.sub(r"\[([^]]*)\]", lambda found: found[1].replace(",", "+") or "none", name)
    return re.sub(r"[^\w.,=+-]+", "_", inner).strip("_.,-")[:_LONGEST_NAME] or "job"
