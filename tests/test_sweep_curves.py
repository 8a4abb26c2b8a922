"""Learning curves of a sweep over train.size in TensorBoard: joined lines that grow as jobs end."""

import json

import pytest
from commands import run
from logged import Events

from contactlearn.report.sweep_curves import FOLDER, SweepCurves, growing_curves
from contactlearn.report.tensorboard import shown_as
from contactlearn.results.state import DONE

SMALL = ("data.size=80", "train.repetitions=2", "bootstrap=20", "model=analytical", "law=whittaker")
LINES = ("whittaker", "best_post_hoc", "irb")


@pytest.fixture(scope="module")
def sweep(tmp_path_factory):
    """The folder of a sweep of two sizes and two seeds."""
    folder = tmp_path_factory.mktemp("sweep")
    run("train.py", "-m", *SMALL, "train.size=10,20", "seed=0,1", f"hydra.sweep.dir={folder}")
    return folder


@pytest.fixture
def jobs(sweep):
    """The folder of each job by size and seed."""
    found = {}
    for folder in sweep.glob("train.size=*"):
        config = json.loads((folder / "results.json").read_text())["provenance"]["config"]
        found[config["train"]["size"], config["seed"]] = folder
    return found


def lines(folder):
    """(size, error) of each line in the headline."""
    events = Events(str(folder)).Reload()
    return {
        name: [(one.step, one.value) for one in events.Scalars(shown_as(f"curve_mass_error/{name}"))] for name in LINES
    }


def test_a_line_is_the_mean_over_seeds_at_every_size(sweep, jobs):
    for name, line in lines(sweep / FOLDER).items():
        errors = {key: json.loads((job / "results.json").read_text())["errors"] for key, job in jobs.items()}
        means = {size: sum(errors[size, seed][name]["mass_error"]["mean"] for seed in (0, 1)) / 2 for size in (10, 20)}
        assert dict(line) == pytest.approx(means, rel=1e-6)
        assert len(line) == 2
    logged = [json.loads(line) for line in (sweep / FOLDER / "metrics.jsonl").read_text().splitlines()]
    assert [one["trained_on"] for one in logged] == [10, 20]


def test_lines_grow_as_jobs_end_in_any_order(sweep, jobs, tmp_path):
    """A smaller size that ends later, or another seed, makes the line anew, also in a TensorBoard that shows it."""
    settings = {job: [f"train.size={size}", f"seed={seed}"] for (size, seed), job in jobs.items()}
    waiting = {key: (job / DONE).rename(job / "waiting") for key, job in jobs.items()}
    try:
        shown, curves = None, SweepCurves(tmp_path / FOLDER, lambda: settings)
        curves.update()
        assert not (tmp_path / FOLDER).exists()
        for key, expected in {(20, 0): [20], (10, 0): [10, 20], (10, 1): [10, 20], (20, 1): [10, 20]}.items():
            waiting[key].rename(jobs[key] / DONE)
            curves.update()
            shown = shown or Events(str(tmp_path / FOLDER))
            assert [one.step for one in shown.Reload().Scalars(shown_as("curve_mass_error/whittaker"))] == expected
        curves.close()
    finally:
        for key, job in jobs.items():
            waiting[key].rename(job / DONE) if waiting[key].exists() else None
    assert lines(tmp_path / FOLDER) == lines(sweep / FOLDER)


def test_an_extended_sweep_logs_what_is_new(jobs, tmp_path, caplog):
    settings = {job: [f"train.size={size}", f"seed={seed}"] for (size, seed), job in jobs.items()}
    for ended in ([(10, 0), (10, 1)], jobs):
        with growing_curves(tmp_path, lambda ended=ended: {jobs[key]: settings[jobs[key]] for key in ended}):
            pass
    assert [size for size, _ in lines(tmp_path / FOLDER)["whittaker"]] == [10, 20]
    assert len((tmp_path / FOLDER / "metrics.jsonl").read_text().splitlines()) == 2
    assert "Purging" not in caplog.text


def test_swept_settings_name_lines_of_one_model(sweep, jobs, tmp_path):
    """Those that move no bound stand in no name of a bound."""
    settings = {job: [f"train.size={size}", f"variant={seed}"] for (size, seed), job in jobs.items()}
    with growing_curves(tmp_path, lambda: settings):
        pass
    tags = Events(str(tmp_path / FOLDER)).Reload().Tags()["scalars"]
    assert {tag.partition("/")[2] for tag in tags if not tag.endswith(" end")} == {
        "Whittaker, variant=0", "Whittaker, variant=1", "Best Post Hoc", "IRB bound",
    }  # fmt: skip
