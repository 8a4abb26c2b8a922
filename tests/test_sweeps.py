"""Sweeps resume where they stopped: killed, failing, side by side, on full disks, and with nothing left to do."""

import errno
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from unittest.mock import DEFAULT, patch

import pytest
from commands import TRAIN, run
from forked_sweeps import ForkedSweep
from omegaconf import OmegaConf

from contactlearn.cli import hydra_main, job as job_module
from contactlearn.cli.commands import loading
from contactlearn.cli.reasons import reason
from contactlearn.cli.resource_limits import GIB, available_memory, jobs_at_a_time
from contactlearn.cli.sweeps.identity import code_version, data_fingerprint, job_identity
from contactlearn.core.errors import ContactLearnError
from contactlearn.results import folder as results
from contactlearn.results.folder import find_results, read_result
from contactlearn.results.state import DONE, FAILED, is_locked, locked, read_done, unfinished

sys.path.append(str(Path(__file__).parent.parent / "benchmarks"))
from speed.sweeps import content, ended, finished, nothing_half_written, survive

SMALL = ("data.size=80", "train.repetitions=2", "bootstrap=20", "model=analytical")
JOBS, COUNT = (*SMALL, "law=whittaker", "train.size=10,20"), 2


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """The jobs of a sweep that nothing disturbed."""
    folder = tmp_path_factory.mktemp("undisturbed")
    printed = run("train.py", "-m", *JOBS, f"hydra.sweep.dir={folder}")
    assert f"sweep: {COUNT} finished" in printed
    return folder


def identity(name, *words):
    cfg = hydra_main.compose(name, list(words), return_hydra_config=True)
    return job_identity(cfg, cfg.hydra)


def test_finished_jobs_are_skipped(undisturbed):
    before = finished(undisturbed)
    with patch.object(job_module, "finish", side_effect=AssertionError):
        printed = run("train.py", "-m", *JOBS, f"hydra.sweep.dir={undisturbed}")
    assert f"sweep: {COUNT} finished ({COUNT} before)" in printed
    assert finished(undisturbed) == before


def test_a_larger_sweep_reuses_finished_jobs(undisturbed, tmp_path):
    subprocess.run(["cp", "-a", f"{undisturbed}/.", str(tmp_path)], check=True)
    before = finished(tmp_path)
    more = [word.replace("20", "20,25") if word.startswith("train.size") else word for word in JOBS]
    printed = run("train.py", "-m", *more, f"hydra.sweep.dir={tmp_path}")
    assert f"{COUNT + 1} finished ({COUNT} before)" in printed
    assert finished(tmp_path).items() >= before.items()
    assert len(finished(tmp_path)) == COUNT + 1


def test_identity_of_a_job(tmp_path):
    table = tmp_path / "a.csv"
    table.write_text("a")
    words = ("data=table", f"data.path={table}")
    base = identity("train", *words)
    assert identity("train", "seed=0", *reversed(words)).job == base.job  # that of the settings, not of the words
    assert identity("train", *words, "threads=2").job == base.job
    assert identity("train", *words, "device=auto").job == base.job
    assert identity("train", *words, "seed=1").job != base.job
    assert identity("evaluate", *words).job != base.job
    table.write_text("b")
    changed = identity("train", *words)
    assert (changed.config, changed.job != base.job) == (base.config, True)
    with patch("contactlearn.cli.sweeps.identity.code_version", return_value="0.2"):
        assert identity("train", *words).job != changed.job
    assert data_fingerprint((str(tmp_path),)) == data_fingerprint((str(table),))
    assert data_fingerprint((str(tmp_path / "nowhere"),)) == ""
    assert code_version(("numpy",)) != code_version()


def test_other_data_are_another_job(tmp_path):
    """Under the same name of a file; what was computed from the former data stays."""
    small = (
        "train.size=10",
        "train.repetitions=2",
        "bootstrap=20",
        "data=table",
        "data.path=drops.csv",
        "model=analytical",
    )
    for seed in (1, 2):
        run("contactlearn", "export", str(tmp_path / "drops.csv"), "--force", "data.size=60", f"data.seed={seed}")
        printed = run("train.py", "-m", *small, "law=mirtich", "hydra.sweep.dir=s", cwd=tmp_path)
        assert "before)" not in printed
    assert len(list(tmp_path.glob("s/*/done.json"))) == 2


def test_a_failing_job_stops_no_other(tmp_path):
    """The sweep goes where Hydra puts them; the same command goes on in the folder that it names."""
    words = ("-m", *SMALL, "train.size=1000,10")
    printed = run("train.py", *words, status=1, cwd=tmp_path)
    assert "sweep: 1 finished, 1 failed" in printed
    (place,) = re.findall(r"The same command with (hydra.sweep.dir=multirun/\d{4}-\d\d-\d\d/\d\d-\d\d-\d\d) ", printed)
    words, cwd, tmp_path = (*words, place), tmp_path, tmp_path / place.partition("=")[2]
    typed = [word.lstrip("+") for word in OmegaConf.load(tmp_path / "multirun.yaml").hydra.overrides.task]
    assert typed == [*SMALL, "train.size=1000,10"]
    assert "failed: train.size=1000: synthetic drops" in printed
    before = finished(tmp_path)
    assert [name.partition("-")[0] for name in before] == ["train.size=10"]
    (failed,) = tmp_path.glob("train.size=1000-*")
    assert re.search(r"\[contactlearn\]\[ERROR\] - .*use train.size=60", (failed / "train.log").read_text("utf-8"))
    assert "use train.size=60 or less" in json.loads((failed / FAILED).read_text())["reason"]
    reasons = []
    for path in find_results(tmp_path):
        try:
            read_result(path)
        except ContactLearnError as error:
            reasons.append(str(error))
    assert len(reasons) == 1
    assert reasons[0].startswith("failed: synthetic drops")
    assert "1 finished (1 before), 1 failed" in run("train.py", *words, status=1, cwd=cwd)
    assert finished(tmp_path) == before


@pytest.mark.nightly
def test_an_unexpected_failure_stops_no_other(tmp_path):
    """And leaves its place in the program; the next call runs it again."""
    words = ("-m", *SMALL, "train.size=10,20", f"hydra.sweep.dir={tmp_path}")
    first = [ZeroDivisionError("by chance"), DEFAULT]
    with patch.object(loading, "split", side_effect=first, wraps=loading.split):
        printed = run("train.py", *words, status=1)
    assert "1 finished, 1 failed" in printed
    assert "failed: train.size=10: ZeroDivisionError: by chance" in printed
    (failed,) = tmp_path.glob("train.size=10-*")
    assert "loading.split" in json.loads((failed / FAILED).read_text())["traceback"]
    assert "2 finished" in run("train.py", *words)
    assert not list(tmp_path.glob(f"*/{FAILED}"))


def test_a_wrong_setting_in_one_job_runs_none(tmp_path):
    printed = run("train.py", "-m", *SMALL, "law=whittaker,mirtisch", f"hydra.sweep.dir={tmp_path / 's'}", status=2)
    assert "did you mean 'mirtich'?" in printed
    assert not (tmp_path / "s").exists()


@pytest.mark.nightly
def test_killed_at_a_random_moment(undisturbed, tmp_path):
    """Nothing finished is lost, nothing half-written is read, and the results are those of an undisturbed sweep.

    Fifty kills are in benchmarks/speed/sweeps.py.
    """
    hits, lost = survive(tmp_path, kills=1, longest=2, words=JOBS, start=ForkedSweep)
    assert (hits, lost) == (1, [])
    status, printed = ended(ForkedSweep(tmp_path, *JOBS))
    assert status == 0, printed
    assert content(tmp_path) == content(undisturbed)


@pytest.mark.nightly
def test_leftovers_of_a_killed_job_are_cleared(undisturbed, tmp_path):
    """Events and tables of two attempts would add up."""
    subprocess.run(["cp", "-a", f"{undisturbed}/.", str(tmp_path)], check=True)
    folder = sorted(tmp_path.glob("*-*"))[0]
    (folder / DONE).unlink()
    (folder / "events.of.the.first").write_text("half")
    (folder / ".saving-x").mkdir()
    assert unfinished(folder)
    assert results.files(folder) == []
    run("train.py", "-m", *JOBS, f"hydra.sweep.dir={tmp_path}")
    assert content(tmp_path) == content(undisturbed)
    assert not {"events.of.the.first", ".saving-x"} & set(os.listdir(folder))


def test_a_half_written_marker_is_no_marker(undisturbed, tmp_path):
    subprocess.run(["cp", "-a", f"{undisturbed}/.", str(tmp_path)], check=True)
    folder = sorted(tmp_path.glob("*-*"))[0]
    (folder / DONE).write_text((folder / DONE).read_text()[:20])
    assert read_done(folder) is None
    assert f"{COUNT} finished ({COUNT - 1} before)" in run("train.py", "-m", *JOBS, f"hydra.sweep.dir={tmp_path}")


def test_ctrl_c_is_one_line(tmp_path):
    """Ctrl-C is one line and status 130, and the same command goes on."""
    sweep = ForkedSweep(tmp_path, *JOBS)
    while not finished(tmp_path) and sweep.poll() is None:
        time.sleep(0.02)
    os.kill(sweep.pid, signal.SIGINT)
    status, printed = ended(sweep)
    assert status == 130
    assert re.fullmatch(
        r"stopped; the same command with hydra.sweep.dir=\S+ runs what has no result", printed.splitlines()[-1]
    )
    assert "Traceback" not in printed
    nothing_half_written(tmp_path)


def test_interrupted_while_a_configuration_is_composed(tmp_path):
    """Where OmegaConf answers with an error of its own, which a sweep would take for a broken launcher."""
    stops = []

    def folder():
        if finished(tmp_path) and not stops:
            stops.append(signal.SIGINT)
            try:
                signal.raise_signal(signal.SIGINT)
            except KeyboardInterrupt as stop:
                raise TypeError("half of a configuration") from stop
        return "job"

    OmegaConf.register_new_resolver("stopping", folder, replace=True)
    words = (
        *SMALL,
        "train.size=10,20",
        f"hydra.sweep.dir={tmp_path}",
        "hydra.sweep.subdir='${stopping:}-${hydra.job.num}'",
    )
    try:
        printed = run("train.py", "-m", *words, status=130)
    finally:
        OmegaConf.clear_resolver("stopping")
    assert printed.splitlines()[-1].startswith("stopped")
    assert len(finished(tmp_path)) == 1


def test_two_processes_on_one_sweep(undisturbed, tmp_path):
    """They share the jobs; each is run once, and both end with all of them."""
    both = [ForkedSweep(tmp_path, *JOBS) for _ in range(2)]
    printed = []
    for sweep in both:
        status, text = ended(sweep)
        assert status == 0, text
        printed.append(text)
    assert content(tmp_path) == content(undisturbed)
    assert sum(text.count("plots: tensorboard") for text in printed) == COUNT
    assert all(len(list(folder.glob("events.*"))) == 1 for folder in tmp_path.glob("*-*"))


def test_one_folder_has_one_holder(tmp_path):
    with locked(tmp_path) as first, locked(tmp_path) as second:
        assert (first, second, is_locked(tmp_path)) == (True, False, True)
    assert not is_locked(tmp_path)
    assert not is_locked(tmp_path / "nowhere")


def test_runs_of_one_time_have_a_folder_each(tmp_path):
    """Here all times have one name; of the default, those of a second."""
    for seed in (0, 1, 1):
        run("train.py", *SMALL, "train.size=10", f"seed={seed}", "hydra.run.dir=a-${now:century}", cwd=tmp_path)
    found = sorted(tmp_path.iterdir())
    assert [path.name for path in found] == [f"a-century{end}" for end in ("", "-2", "-3")]
    seeds = [json.loads((path / "results.json").read_text())["provenance"]["config"]["seed"] for path in found]
    assert seeds == [0, 1, 1]
    configurations = [(path / ".hydra" / "config.yaml").read_text().count("\nseed: 1") for path in found]
    assert configurations == [0, 1, 1]
    assert [(path / "train.log").read_text().count("results: ") for path in found] == [1, 1, 1]


def test_a_named_folder_is_not_written_over(tmp_path):
    """The same run is finished already; another one is refused."""
    words = ("train.py", *SMALL, "train.size=10", f"hydra.run.dir={tmp_path / 'a'}")
    run(*words)
    before = {path: path.read_bytes() for path in (tmp_path / "a").rglob("*") if path.is_file()}
    assert "finished already: a\n" in run(*words, cwd=tmp_path)
    assert "holds the result of another run; choose another folder" in run(*words, "seed=1", status=2)
    with locked(tmp_path / "b"):
        printed = run(*words[:-1], f"hydra.run.dir={tmp_path / 'b'}", status=2)
        assert "is in use by another run" in printed
    assert before == {path: path.read_bytes() for path in (tmp_path / "a").rglob("*") if path.is_file()}


def test_a_run_of_an_earlier_version_stays_readable(tmp_path):
    """It has no marker; a run that is refused its folder leaves none there."""
    run("train.py", *SMALL, "train.size=10", f"hydra.run.dir={tmp_path / 'a'}")
    for name in (DONE, ".lock"):
        (tmp_path / "a" / name).unlink()
    for seed in (0, 1):
        run("train.py", *SMALL, "train.size=10", f"seed={seed}", f"hydra.run.dir={tmp_path / 'a'}", status=2)
    (path,) = find_results(tmp_path)
    assert read_result(path).trained_on == 10


@pytest.mark.nightly
def test_other_names_of_jobs_overwrite_nothing(tmp_path):
    """Numbers begin at 0 in each sweep."""
    words = ("-m", *SMALL, "train.size=10", "hydra.sweep.subdir=${hydra.job.num}", f"hydra.sweep.dir={tmp_path}")
    run("train.py", *words, "seed=0,1")
    assert "2 finished (2 before)" in run("train.py", *words, "seed=0,1")
    assert "holds the result of another run" in run("train.py", *words, "seed=2,3", status=1)
    found = {path.parent.name: read_result(path).provenance.config["seed"] for path in find_results(tmp_path)}
    assert found == {"0": 0, "1": 1}


def test_sweeps_of_one_time_have_a_folder_each(tmp_path):
    for seed in (0, 1):
        run("train.py", "-m", *SMALL, "train.size=10", f"seed={seed}", "hydra.sweep.dir=a-${now:day}", cwd=tmp_path)
    assert sorted(path.parent.parent.name for path in tmp_path.glob("*/*/done.json")) == ["a-day", "a-day-2"]


def test_the_parameters_of_a_sweep_stand_in_a_file_or_on_the_line(tmp_path):
    (tmp_path / "mine.yaml").write_text(
        "defaults: [train, _self_]\nhydra: {sweeper: {params: {train.size: '10,15'}}}\n"
    )
    words = ("-m", *SMALL, "hydra.sweep.dir=s")
    assert "2 finished" in run("train.py", "--config-dir=.", "--config-name=mine", *words, cwd=tmp_path)
    assert sorted(path.name.rpartition("-")[0] for path in tmp_path.glob("s/*-*")) == ["train.size=10", "train.size=15"]
    line = "+hydra.sweeper.params={train.size: '10,20'}"
    assert "2 finished" in run("train.py", line, *words, cwd=tmp_path)


def test_a_job_returns_what_a_sweeper_minimises(tmp_path):
    """The held-out error, also of a job that finished before; a failed one is endlessly wrong."""
    words = [*SMALL, "train.size=10", f"hydra.sweep.dir={tmp_path}"]
    returned = []
    run_job = job_module.run_job
    with patch.object(job_module, "run_job", side_effect=lambda *a: returned.append(run_job(*a))):
        run("train.py", "-m", *words)
        run("train.py", "-m", *words)
        run("train.py", "-m", *words, "train.size=1000", status=1)
    (path,) = tmp_path.glob("*/results.json")
    error = read_result(path).errors["wang_mason"].intervals["mass_error"].mean
    assert returned == [error, error, float("inf")]


def test_failed_and_interrupted_runs_leave_nothing(tmp_path):
    with patch("contactlearn.cli.commands.train.loading.split", side_effect=KeyboardInterrupt):
        assert "stopped" in run("train.py", *SMALL, cwd=tmp_path, status=130)
    assert list(tmp_path.iterdir()) == []
    # hydra.run.dir=. is a folder with other things in it.
    (tmp_path / "notes.txt").write_text("mine")
    run("train.py", *SMALL, "train.size=1000", "hydra.run.dir=.", cwd=tmp_path, status=2)
    run("train.py", *SMALL, "train.size=10", "hydra.run.dir=.", cwd=tmp_path)
    assert (tmp_path / "notes.txt").read_text() == "mine"
    assert (tmp_path / "results.json").exists()


@pytest.mark.parametrize("word", ["train.size=1000", "data=table", "+data.sise=3", "train.eps=[1,0]"])
def test_failed_runs_leave_no_folder(word, tmp_path):
    words = SMALL if word != "data=table" else SMALL[1:]
    run("train.py", *words, word, cwd=tmp_path, status=2)
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def small_disk(tmp_path):
    """A disk of 150 kB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=150k", "tmpfs", str(disk)], capture_output=True)
    if mounted.returncode:
        pytest.skip("a small disk cannot be mounted without the rights to do so")
    yield disk
    subprocess.run(["umount", str(disk)], check=True)


def test_a_full_disk_is_one_clear_error(small_disk, tmp_path):
    (small_disk / "large").write_bytes(bytes(100_000))
    words = ["-m", *SMALL, "train.size=10", "model=analytical", f"hydra.sweep.dir={small_disk}"]
    printed = run("train.py", *words, status=1, figures=True)
    assert "No space left on device; free some space" in printed
    assert "Traceback" not in printed
    assert not list(small_disk.rglob(DONE))
    nothing_half_written(small_disk)
    subprocess.run(["mount", "-o", "remount,size=4m", str(small_disk)], check=True)
    run("train.py", *words, figures=True)
    assert len(list(small_disk.rglob(DONE))) == 1


@pytest.mark.parametrize("several", [False, True], ids=["run", "sweep"])
def test_a_folder_that_cannot_be_written(small_disk, several):
    subprocess.run(["mount", "-o", "remount,ro", str(small_disk)], check=True)
    place = f"hydra.sweep.dir={small_disk}/s" if several else f"hydra.run.dir={small_disk}/run"
    printed = run("train.py", *["-m"] * several, *SMALL, "train.size=10,15" if several else "seed=1", place, status=2)
    assert "Read-only file system; choose another" in printed
    assert "Traceback" not in printed


def test_a_file_in_place_of_a_folder(tmp_path):
    (tmp_path / "a").write_text("")
    for words in (("hydra.run.dir=a/b",), ("-m", "seed=1,2", "hydra.sweep.dir=a/b")):
        printed = run("train.py", *words, *SMALL, cwd=tmp_path, status=2)
        assert "Not a directory" in printed
        assert "Traceback" not in printed


def test_a_folder_that_vanishes(tmp_path):
    """It is not made again with half of the result in it."""
    split = job_module.time.monotonic

    def vanish(*arguments):
        subprocess.run(["rm", "-rf", str(tmp_path / "a")], check=True)
        return split()

    with patch("contactlearn.cli.commands.train.checkpoint.save", side_effect=lambda *a, **k: vanish()):
        printed = run("train.py", *TRAIN, f"hydra.run.dir={tmp_path / 'a'}", status=2)
    assert "vanished during the run" in printed
    assert not (tmp_path / "a" / DONE).exists()


@pytest.mark.parametrize(("error", "message"), [
    (MemoryError(), "memory ran out; use fewer trials"),
    (OSError(errno.EACCES, "Permission denied", "/data"), "/data: Permission denied; choose another"),
    (ValueError(), "ValueError: no words"),
    (ValueError("two\nlines"), "ValueError: two"),
])  # fmt: skip
def test_reasons_are_one_line(error, message):
    assert reason(error).startswith(message)
    assert "\n" not in reason(error)


def test_no_more_jobs_than_memory_allows():
    with patch("contactlearn.cli.resource_limits.available_memory", return_value=5.5 * GIB):
        assert jobs_at_a_time(8, 2) == 2
        assert jobs_at_a_time(1, 2) == 1
        assert jobs_at_a_time(8, 100) == 1
        assert jobs_at_a_time(-1, 0.001) == len(os.sched_getaffinity(0))
    with patch("contactlearn.cli.resource_limits.available_memory", return_value=None):
        assert jobs_at_a_time(8, 2) == 8


def test_available_memory(tmp_path):
    assert 0 < available_memory() < 2**50
    (tmp_path / "memory.max").write_text(str(3 * GIB))
    (tmp_path / "memory.current").write_text(str(GIB))
    with patch("contactlearn.cli.resource_limits._CGROUP", tmp_path):
        assert available_memory() <= 2 * GIB
        (tmp_path / "memory.max").write_text("max\n")
        assert available_memory() > 0
