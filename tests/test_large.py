"""Data of any length: blocks give the numbers of the whole, in bounded memory, and nothing half-written is seen."""

import tracemalloc

import numpy as np
import pandas as pd
import pyarrow
import pytest
import torch
from commands import run
from pyarrow import parquet

from contactlearn.cli.commands import loading
from contactlearn.cli.hydra_main import compose
from contactlearn.cli.settings import SourceSettings
from contactlearn.core.errors import ContactLearnError, DataError
from contactlearn.data import blocks as blocks_module, table
from contactlearn.data.blocks import Blocks, joined, sampled
from contactlearn.data.table.files import read_parquet
from contactlearn.inference.evaluation import metrics
from contactlearn.inference.evaluation.metrics import ErrorSums
from contactlearn.laws import find
from contactlearn.mechanics.space import PLANE
from contactlearn.models.contact_model import ContactModel
from contactlearn.results.tables import load_predictions, save_predictions
from contactlearn.simulation import synthetic

SUFFIXES = pytest.mark.parametrize("suffix", ["csv", "parquet"])
ROUNDING = {"rtol": 1e-12, "atol": 1e-12}  # sums in another order
SETTINGS = ("data=table", "train.size=20", "train.repetitions=3", "figures.repetitions=2", "bootstrap=40", "model=[]")
FEW = ("laws=[whittaker,mirtich]",)


@pytest.fixture
def small_blocks(monkeypatch):
    """Blocks of 37 trials, from 50 trials on."""
    for module in (blocks_module, table, loading):
        monkeypatch.setattr(module, "BLOCK", 37, raising=False)
        monkeypatch.setattr(module, "LARGE", 50, raising=False)


@pytest.fixture(scope="module")
def drops():
    return synthetic.load(size=230, seed=5)


def models():
    return {name: ContactModel(find(name).at(0.1, 0.5)) for name in ("whittaker", "wang_mason", "mirtich")}


def predicted(parts):
    return [(part, {name: model.predict(part) for name, model in models().items()}) for part in parts]


@SUFFIXES
def test_blocks_of_a_table_are_the_table(suffix, drops, small_blocks, tmp_path):
    path = table.save(drops, tmp_path / f"drops.{suffix}")
    found = table.table_blocks(path, None)
    sizes = [len(block) for block in found.read()]
    assert sizes == [37] * 6 + [8]
    whole = joined([*found.read()])
    assert whole.trial == drops.trial
    assert whole.object == drops.object
    for name in PLANE.components:
        if getattr(drops, name) is not None:
            assert torch.equal(getattr(whole, name), getattr(drops, name))
    assert found.sha256 == drops.fingerprint() == Blocks.of(drops).sha256
    assert found.trials == 230


@SUFFIXES
def test_names_and_order_go_on_from_block_to_block(suffix, drops, small_blocks, tmp_path):
    path = table.save(drops, tmp_path / f"drops.{suffix}")
    frame = pd.read_csv(path) if suffix == "csv" else pd.read_parquet(path)
    frame = frame.drop(columns=["trial", "order"])
    frame.to_csv(path, index=False) if suffix == "csv" else frame.to_parquet(path)
    whole = joined([*table.table_blocks(path, None).read()])
    assert whole.trial == tuple(map(str, range(1, 231)))
    assert whole.order.tolist() == [*range(1, 231)]


BAD = {
    "text": ("vy", 171, "fast", r"row 171.*column vy: must be a finite number in m/s; got 'fast'"),
    "empty": ("omega_post", 200, None, r"row 200.*column omega_post"),
    "negative": ("mass", 150, -1.0, r"row 150 \(trial '150'\), column mass: must be positive.*-1"),
    "departing": ("vy", 149, 3.0, r"row 149 \(trial '149'\), column vy: must approach"),
    "repeated": ("trial", 222, "9", r"row 222, column trial repeats '9' of row 9"),
    "repeated at once": ("trial", 222, "221", r"row 222, column trial repeats '221' of row 221"),
}


@SUFFIXES
@pytest.mark.parametrize("case", BAD)
def test_a_bad_row_deep_inside_is_named(case, suffix, drops, small_blocks, tmp_path):
    column, row, value, message = BAD[case]
    path = table.save(drops, tmp_path / f"drops.{suffix}")
    frame = pd.read_csv(path, dtype=str) if suffix == "csv" else pd.read_parquet(path).astype({column: object})
    frame.loc[row - 1, column] = value if suffix == "parquet" or value is None else str(value)
    if suffix == "parquet" and case == "text":
        frame[column] = frame[column].astype(str)
    frame.to_csv(path, index=False) if suffix == "csv" else frame.to_parquet(path)
    with pytest.raises(DataError, match=message) as raised:
        table.table_blocks(path, None)
    assert raised.value.row == row
    if suffix == "csv" and case in ("text", "negative"):
        assert f"line {row + 1}" in str(raised.value)


def test_corrections_go_block_by_block_or_are_made_in_memory(drops, small_blocks, tmp_path, monkeypatch):
    path = table.save(drops, tmp_path / "drops.parquet")

    def loaded(*names):
        words = ["data=table", f"data.path={path}", f"data.correct=[{','.join(names)}]"]
        return loading.load_blocks(SourceSettings.from_config(compose("evaluate", words)))[0]

    assert len([*loaded("mirrored_x", "mirrored_theta").read()]) == 7
    assert loaded("drop_duplicates").trials == 230
    monkeypatch.setattr("contactlearn.cli.resource_limits.available_memory", lambda: 1000.0)
    with pytest.raises(ContactLearnError, match=r"drop_duplicates\] looks at all trials of .* are free"):
        loaded("drop_duplicates")


def test_sums_over_blocks_are_the_errors_of_all(drops, monkeypatch):
    sums = ErrorSums(models())
    for part, predictions in predicted([drops[:90], drops[90:]]):
        sums.add(part, predictions)
    ((_, whole),) = predicted([drops])
    error = metrics.mass_error(drops, whole["mirtich"])
    expected = metrics.bootstrap(error, torch.Generator().manual_seed(2), 60)
    assert sums.interval("mass_error", "mirtich", torch.Generator().manual_seed(2), 60) == expected
    still = drops.v_post.clone()
    still[200] = 0
    with pytest.raises(DataError, match="trial '201' has v_post = 0"):
        sums.add(drops.replace(v_post=still), {})
    monkeypatch.setattr("contactlearn.inference.evaluation.metrics.BOOTSTRAPPED", 100)
    sums = ErrorSums(models())
    for part, predictions in predicted([drops[:90], drops[90:91], drops[91:]]):
        sums.add(part, predictions)
    for name, metric in metrics.METRICS.items():
        errors = {model: metric.error(drops, one) for model, one in whole.items()}
        pair = sums.difference(name, "whittaker", "mirtich", torch.Generator())
        alone = sums.interval(name, "mirtich", torch.Generator())
        for found, values in ((pair, errors["whittaker"] - errors["mirtich"]), (alone, errors["mirtich"])):
            expected = metrics.gaussian_interval(values.mean().item(), values.var().item(), 230)
            torch.testing.assert_close(torch.tensor([*found]), torch.tensor([*expected]), **ROUNDING)


def test_the_gaussian_limit_is_that_of_the_bootstrap(monkeypatch):
    errors = torch.randn(metrics.BOOTSTRAPPED, generator=torch.Generator().manual_seed(0)).double().square()
    drawn = metrics.bootstrap(errors, torch.Generator().manual_seed(1), 500)
    monkeypatch.setattr(metrics, "BOOTSTRAPPED", 10)
    limit = metrics.bootstrap(errors, torch.Generator().manual_seed(1), 500)
    assert limit.mean == drawn.mean
    assert (limit.high - limit.low) / (drawn.high - drawn.low) == pytest.approx(1, abs=0.15)  # of 500 resamples


def test_an_evaluation_in_blocks_is_that_in_memory(drops, small_blocks, tmp_path, monkeypatch):
    path = table.save(drops, tmp_path / "drops.parquet")
    out = {}
    for name in ("blocks", "memory"):
        if name == "memory":
            for module in (blocks_module, table, loading):
                monkeypatch.setattr(module, "LARGE", 10_000, raising=False)
        folder = tmp_path / name
        run("evaluate.py", *SETTINGS, *FEW, f"data.path={path}", "tables=parquet", f"hydra.run.dir={folder}")
        out[name] = folder
    results = {name: (folder / "results.json").read_text("utf-8") for name, folder in out.items()}
    assert results["blocks"].replace("/blocks", "/memory") == results["memory"]
    for kind in ("held_out", "predictions", "trial_parameters"):
        assert read(out["blocks"] / f"{kind}.parquet").equals(read(out["memory"] / f"{kind}.parquet")), kind


def read(path):
    frame = pd.read_csv(path) if path.suffix == ".csv" else pd.read_parquet(path)
    return frame.sort_values([*frame.columns[:3]], ignore_index=True)


def test_of_many_trials_a_sample_is_fitted_and_shown(drops, small_blocks, tmp_path, monkeypatch):
    for name, value in (
        ("contactlearn.cli.commands.loading.FITTED", 60),
        ("contactlearn.cli.commands.loading.SHOWN", 30),
    ):
        monkeypatch.setattr(name, value)
    monkeypatch.setattr("contactlearn.results.tables.SHOWN", 30)
    path, folder = table.save(drops, tmp_path / "drops.parquet"), tmp_path / "out"
    said = run("evaluate.py", *SETTINGS, f"data.path={path}", f"hydra.run.dir={folder}")
    assert "models are fitted to 60 trials, figures and page show 30" in said
    assert "172 for identification, 58 held out" in said
    assert len(pd.read_parquet(folder / "predictions.parquet")) == 58 * 8
    page = (folder / "report.html").read_bytes()
    run("contactlearn", "report", str(folder))
    assert (folder / "report.html").read_bytes() == page


def test_a_training_in_blocks_is_that_in_memory(drops, small_blocks, tmp_path, monkeypatch):
    path = table.save(drops, tmp_path / "drops.parquet")
    settings = ("data=table", f"data.path={path}", "train.size=30", "bootstrap=40", "model=residual_wrench")
    run("train.py", *settings, f"hydra.run.dir={tmp_path / 'blocks'}")
    for module in (blocks_module, table, loading):
        monkeypatch.setattr(module, "LARGE", 10_000, raising=False)
    run("train.py", *settings, f"hydra.run.dir={tmp_path / 'memory'}")
    one, other = ((tmp_path / name / "results.json").read_text("utf-8") for name in ("blocks", "memory"))
    assert one.replace("/blocks", "/memory") == other


def test_memory_does_not_grow_with_the_table(tmp_path, monkeypatch):
    """Blocks that live side by side would add up: of ten times as many trials the peak is nearly the same."""
    monkeypatch.setattr(blocks_module, "BLOCK", 500)
    monkeypatch.setattr(table, "BLOCK", 500)
    monkeypatch.setattr(table, "LARGE", 500)
    monkeypatch.setattr("contactlearn.inference.evaluation.metrics.BOOTSTRAPPED", 500)
    peaks = []
    for size in (1000, 1000, 10_000):  # the first call loads what stays
        path = table.save(synthetic.load(size=size), tmp_path / f"{size}.parquet")
        tracemalloc.start()
        found, sums = table.table_blocks(path, None), ErrorSums(models())

        def pairs(found=found, sums=sums):
            for part in found.read():
                ((_, predictions),) = predicted([part])
                sums.add(part, predictions)
                yield part, predictions

        save_predictions(pairs(), tmp_path / "predictions.parquet")
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[2] < 2 * peaks[1]


def test_a_parquet_file_is_not_kept_while_it_is_read(tmp_path):
    """Arrow's memory, which Python does not trace: a buffer of what is read would hold all row groups in the end."""
    path = tmp_path / "numbers.parquet"
    numbers = torch.randn(400_000, generator=torch.Generator().manual_seed(0), dtype=torch.float64).numpy()
    parquet.write_table(
        pyarrow.table({name: numbers for name in "abc"}), path, row_group_size=10_000, use_dictionary=False
    )
    before, held = pyarrow.total_allocated_bytes(), []
    for _ in read_parquet(path, 10_000):
        held.append(pyarrow.total_allocated_bytes() - before)
    assert len(held) == 40
    assert max(held) < 0.2 * path.stat().st_size


def test_a_training_larger_than_memory_is_made_smaller(drops, tmp_path, monkeypatch):
    monkeypatch.setattr("contactlearn.cli.resource_limits.available_memory", lambda: 50 * 8000.0)
    path = table.save(drops, tmp_path / "drops.parquet")
    words = (
        "data=table",
        f"data.path={path}",
        "train.size=150",
        "train.repetitions=2",
        "bootstrap=40",
        "model=analytical",
    )
    assert "50 trials are used" in run("train.py", *words, f"hydra.run.dir={tmp_path / 'out'}")


@SUFFIXES
def test_predictions_are_read_back_in_part(suffix, drops, tmp_path):
    path = tmp_path / f"predictions.{suffix}"
    save_predictions(iter(predicted([drops[:90], drops[90:]])), path)
    some = sampled(torch.ones(230, dtype=torch.bool), 40)
    read = load_predictions(drops[some], path)
    ((_, expected),) = predicted([drops[some]])
    assert list(read) == list(expected)
    for name, one in expected.items():
        assert torch.equal(read[name].v_post, one.v_post)
        assert torch.equal(read[name].wrench, one.wrench)


@SUFFIXES
def test_nothing_half_written_is_seen(suffix, drops, tmp_path):
    path = tmp_path / f"predictions.{suffix}"

    def failing():
        yield from predicted([drops[:90]])
        assert not path.exists()
        raise RuntimeError("stopped")

    for write in (lambda: save_predictions(failing(), path), lambda: table.save((p for p, _ in failing()), path)):
        with pytest.raises(RuntimeError, match="stopped"):
            write()
        assert list(tmp_path.iterdir()) == []


def test_samples_are_reproducible_and_of_the_given_columns():
    among = torch.arange(1000) % 3 > 0
    some = sampled(among, 100)
    assert some.sum() == 100
    assert not (some & ~among).any()
    assert torch.equal(some, sampled(among, 100))
    assert sampled(among, 700) is among
    spread = np.diff(some.nonzero()[:, 0].numpy(), prepend=0)
    assert spread.max() < 100
