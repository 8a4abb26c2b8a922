"""Sweeps on other engines than one process after the other: all cores, and Slurm's launcher on this machine."""

import os
import re
import signal
import sys
import time
from importlib.util import find_spec
from pathlib import Path
from unittest.mock import patch

import pytest
from commands import run
from omegaconf import OmegaConf

from contactlearn.cli import hydra_main
from contactlearn.cli.resource_limits import jobs_at_a_time
from contactlearn.core.errors import install_hint

sys.path.append(str(Path(__file__).parent.parent / "benchmarks"))
from speed.sweeps import COUNT, JOBS, content, ended, finished, nothing_half_written, started, survive

LAUNCHERS = {
    "joblib": ("joblib", "hydra_plugins.hydra_joblib_launcher"),
    "ray": ("ray", "hydra_plugins.hydra_ray_launcher"),
    "submitit_local": ("slurm", "hydra_plugins.hydra_submitit_launcher"),
}


def needs(launcher):
    """A mark of what is skipped without a launcher, before its fixtures are made."""
    extra, module = LAUNCHERS[launcher]
    return pytest.mark.skipif(not find_spec(module), reason=f"hydra/launcher={launcher} needs contactlearn[{extra}]")


EACH = pytest.mark.parametrize("launcher", [pytest.param(name, marks=needs(name)) for name in LAUNCHERS])


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("undisturbed")
    run("train.py", "-m", *JOBS, f"hydra.sweep.dir={folder}")
    return folder


@EACH
def test_a_launcher_gives_the_results_of_any_other(launcher, undisturbed, tmp_path):
    status, printed = ended(started(tmp_path, *JOBS[:-1], "law=wang_mason", f"hydra/launcher={launcher}"))
    assert status == 0, printed
    assert "UserWarning" not in printed
    expected = {name: found for name, found in content(undisturbed).items() if "law=wang_mason" in name}
    assert sorted(map(str, content(tmp_path).values())) == sorted(map(str, expected.values()))
    status, printed = ended(started(tmp_path, *JOBS, f"hydra/launcher={launcher}"))
    assert status == 0, printed
    assert f"{COUNT} finished ({COUNT // 2} before)" in printed


@EACH
def test_failures_on_a_launcher(launcher, tmp_path):
    status, printed = ended(started(tmp_path, *JOBS[:-2], "train.size=1000,10", f"hydra/launcher={launcher}"))
    assert status == 1
    assert "1 finished, 1 failed" in printed
    assert "failed: train.size=1000: synthetic drops" in printed
    assert "Traceback" not in printed


@needs("joblib")
def test_killed_workers_take_no_job_with_them(undisturbed, tmp_path):
    """The system kills a process that needs too much memory; the pool breaks, and the same command goes on."""
    sweep = started(tmp_path, *JOBS, "hydra/launcher=joblib")
    while not list(tmp_path.glob("*/.hydra")) and sweep.poll() is None:
        time.sleep(0.05)
    workers = [int(pid) for pid in os.listdir("/proc") if pid.isdigit() and _works_for(sweep.pid, int(pid))]
    assert workers
    os.kill(max(workers), signal.SIGKILL)
    status, printed = ended(sweep)
    assert status == 1, printed
    assert re.search(r"^error: the sweep stopped: .*\nThe same command with hydra.sweep.dir=", printed, re.MULTILINE)
    assert "Traceback" not in printed
    status, printed = ended(started(tmp_path, *JOBS, "hydra/launcher=joblib"))
    assert status == 0, printed
    assert content(tmp_path) == content(undisturbed)


def _works_for(parent, pid):
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        words = Path(f"/proc/{pid}/cmdline").read_text()
    except OSError:
        return False
    return int(fields[1]) == parent and "popen_loky" in words


@needs("joblib")
def test_killed_on_all_cores(undisturbed, tmp_path):
    words = (*JOBS, "hydra/launcher=joblib")
    assert survive(tmp_path, kills=2, longest=9, words=words) == (2, [])
    status, printed = ended(started(tmp_path, *words))
    assert status == 0, printed
    nothing_half_written(tmp_path)
    assert content(tmp_path) == content(undisturbed)
    assert len(finished(tmp_path)) == COUNT


@needs("submitit_local")
def test_slurm_on_this_machine_starts_no_more_than_fit(tmp_path):
    """submitit starts all local jobs at once; they are handed to it in portions."""
    sizes = ",".join(map(str, range(10, 10 + 2 * jobs_at_a_time(-1, 2))))
    status, printed = ended(started(tmp_path, *JOBS[:-2], f"train.size={sizes}", "hydra/launcher=submitit_local"))
    assert status == 0, printed
    portions = [len(re.findall(r"\t#\d+ :", text)) for text in printed.split("Submitit 'local' sweep")[1:]]
    assert portions == [jobs_at_a_time(-1, 2)] * 2


@pytest.mark.parametrize("launcher", ["joblib", "ray", "submitit_local", "submitit_slurm"])
def test_a_launcher_that_is_not_there_is_named(launcher, tmp_path):
    """With the words that install it."""
    with patch("contactlearn.cli.sweeps.sweep.find_spec", return_value=None):
        words = ("-m", *JOBS, f"hydra/launcher={launcher}", f"hydra.sweep.dir={tmp_path}")
        printed = run("train.py", *words, status=2)
    extra = launcher if launcher in ("joblib", "ray") else "slurm"
    assert printed.splitlines()[-1].endswith(f"is not installed: {install_hint(extra)}")


def test_requests_to_slurm_and_ray():
    """One core, the stated memory, a limit of time, and to be queued again."""
    found = hydra_main.compose(
        "train", ["hydra/launcher=submitit_slurm", "hydra.launcher.mem_gb=3"], return_hydra_config=True
    )
    wanted = OmegaConf.to_container(found.hydra.launcher, resolve=False)
    assert (wanted["cpus_per_task"], wanted["timeout_min"], wanted["max_num_timeout"]) == (1, 240, 3)
    assert wanted["additional_parameters"] == {"requeue": True}
    assert found.hydra.launcher.mem_gb == 3
    assert found.threads == 1
    # On this machine as many jobs as fit; a cluster knows its own.
    for launcher, key in (("ray", "ray.init.num_cpus"), ("joblib", "n_jobs")):
        own = hydra_main.compose("train", [f"hydra/launcher={launcher}"], return_hydra_config=True).hydra.launcher
        assert OmegaConf.select(own, key) == jobs_at_a_time(-1, 2)
    words = ["hydra/launcher=ray", "hydra.launcher.ray.init.address=auto"]
    cluster = hydra_main.compose("train", words, return_hydra_config=True).hydra.launcher
    assert cluster.ray.init.num_cpus is None


@needs("submitit_local")
def test_slurm_script(tmp_path):
    """What submitit would hand to sbatch from our configuration."""
    from submitit.slurm.slurm import _make_sbatch_string

    found = hydra_main.compose("train", ["hydra/launcher=submitit_slurm"], return_hydra_config=True)
    own = OmegaConf.to_container(found.hydra.launcher, resolve=False)
    script = _make_sbatch_string(
        command="true", folder=tmp_path, time=own["timeout_min"], mem=f"{found.hydra.launcher.mem_gb}GB",
        cpus_per_task=own["cpus_per_task"], additional_parameters=own["additional_parameters"],
        signal_delay_s=own["signal_delay_s"], map_count=400, array_parallelism=own["array_parallelism"],
    )  # fmt: skip
    for line in ("--requeue", "--mem=2GB", "--time=240", "--cpus-per-task=1", "--array=0-399%256"):
        assert f"#SBATCH {line}\n" in script
