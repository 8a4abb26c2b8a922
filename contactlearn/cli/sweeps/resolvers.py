"""Resolvers of OmegaConf: names of folders of jobs, and numbers of jobs at a time; light, since `--help` has them."""

import re
from pathlib import Path

from omegaconf import DictConfig, OmegaConf

from contactlearn.cli.resource_limits import jobs_at_a_time

_LONGEST_NAME = 80  # characters of the settings in the name of a folder


def job_folder(*swept: str, _root_: DictConfig) -> str:
    """Return the name of the folder of a job: its swept settings, and the digest of what its result depends on.

    A resolver of OmegaConf, for `hydra.sweep.subdir`.
    """
    from contactlearn.cli.sweeps.identity import composed_identity, sha

    hydra, words = _root_.hydra, [str(word).removeprefix("++") for word in _root_.hydra.overrides.task]
    try:
        digest = composed_identity(_root_).job
    except Exception:  # which the job itself then says
        digest = sha(words)[:12]
    folder = Path(str(hydra.runtime.cwd), str(hydra.sweep.dir))
    named = [word for word in words if word.partition("=")[0] in swept] if swept else words
    plain = re.sub(r"\[([^]]*)\]", lambda list_: list_[1].replace(",", "+") or "none", ",".join(named))
    plain = re.sub(r"[^\w.,=+-]+", "_", plain).strip("_.,-")[:_LONGEST_NAME] or "job"
    earlier = (place.name for place in folder.glob(f"*-{digest}"))
    return next(earlier, f"{plain}-{digest}")


def jobs_that_fit(gigabytes: float, address: str | None = None) -> int | None:
    """Return how many jobs to run at a time, by cores and memory; None on a cluster, which knows better.

    A resolver of OmegaConf, for settings of launchers.
    """
    return None if address else jobs_at_a_time(-1, float(gigabytes))


def register_resolvers() -> None:
    """Make `contactlearn.job` and `contactlearn.jobs` known to OmegaConf in this process."""
    OmegaConf.register_new_resolver("contactlearn.job", job_folder, replace=True)
    OmegaConf.register_new_resolver("contactlearn.jobs", jobs_that_fit, replace=True)
