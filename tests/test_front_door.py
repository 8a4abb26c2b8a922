"""The front door: tables in memory, data first, results that say what they found."""

import inspect
import re
from dataclasses import replace

import pandas as pd
import pytest
import torch
from diagnoses import made_up, record_of
from spatial import tossed

import contactlearn as cl
from contactlearn.core.errors import UnknownNameError
from contactlearn.effects import EffectId
from contactlearn.mechanics.apparatus import Apparatus, Estimate

DROPS = cl.simulation.synthetic.load(size=90)
FIT = cl.fit(DROPS, "wang_mason", ["spin_damping"])


def with_covariances(impacts):
    D = impacts.space.D
    root = torch.randn(len(impacts), D, D, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    return impacts.replace(v_pre_cov=1e-4 * root @ root.mT, v_post_cov=2e-4 * root @ root.mT)


KNOWN = Apparatus(gravity=Estimate(value=9.8, error=0.01), delay=Estimate(value=0.0, error=1e-4))


def test_a_frame_is_mended_as_a_file_is():
    """Rows without a number are left out, and the corrections of the command line are there."""
    frame = DROPS.to_frame()
    frame.loc[7, "vx"] = float("nan")
    with pytest.raises(cl.DataError, match=r"row 8, column vx: .* in Python drop_incomplete=True"):
        cl.Impacts.from_frame(frame, shape=DROPS.shape)
    kept = cl.Impacts.from_frame(frame, shape=DROPS.shape, drop_incomplete=True)
    assert (len(kept), kept.incomplete) == (89, ("8",))
    frame = DROPS.to_frame().eval("y = -y; vy = -vy; vy_post = -vy_post; ry = -ry".replace("; ", "\n"))
    mirrored = cl.Impacts.from_frame(frame, shape=DROPS.shape, validate=False)
    assert torch.equal(cl.correct(mirrored, ["mirrored_y"]).v_post, DROPS.v_post)


@pytest.mark.parametrize(
    "impacts", [with_covariances(DROPS), with_covariances(tossed(20)), DROPS.replace(apparatus=KNOWN)],
    ids=["plane", "space", "apparatus"],
)  # fmt: skip
def test_impacts_come_back_from_a_frame_to_the_last_bit(impacts):
    frame = impacts.to_frame()
    assert len(frame) == len(impacts)
    again = cl.Impacts.from_frame(frame, shape=impacts.shape)
    assert again.fingerprint() == impacts.fingerprint()
    assert again.apparatus == impacts.apparatus


def test_a_frame_has_the_columns_of_the_file(tmp_path):
    frame = DROPS.to_frame()
    frame.to_csv(tmp_path / "drops.csv", index=False)
    assert cl.read_table(tmp_path / "drops.csv").fingerprint() == cl.read_table(frame).fingerprint()


def test_names_units_and_constants_are_stated_as_for_a_file():
    frame = DROPS.to_frame().drop(columns=["mass", "inertia"]).rename(columns={"vx": "speed"})
    lengths = ["rx", "ry", "x", "y", "x_post", "y_post", "speed", "vy", "vx_post", "vy_post"]
    in_mm = frame.assign(**{name: 1e3 * frame[name] for name in lengths}).set_index("trial")
    mass, inertia = DROPS.mass[0].item(), DROPS.inertia[0].item()
    read = cl.Impacts.from_frame(in_mm, columns={"vx": "speed"}, units={"length": "mm"}, mass=mass, inertia=inertia)
    assert read.trial == DROPS.trial
    torch.testing.assert_close(read.v_pre, DROPS.v_pre, rtol=1e-14, atol=0)
    torch.testing.assert_close(read.inertia, DROPS.inertia)
    kept = cl.Impacts.from_frame(DROPS.to_frame().set_index("trial", drop=False))
    assert kept.trial == DROPS.trial


FRAME = DROPS.to_frame()


@pytest.mark.parametrize(("frame", "options", "message"), [
    (FRAME.drop(columns="vx"), {}, "DataFrame: missing column vx"),
    (FRAME.assign(vx=FRAME["vx"].where(FRAME.index != 3)), {}, "DataFrame: row 4, column vx: must be a finite number"),
    (FRAME.assign(vy=-FRAME["vy"]), {}, r"DataFrame: row 1 .*column vy: must approach the floor.* with validate=False"),
    (FRAME, {"units": {"length": "furlong"}}, "unknown unit in data.units.length: 'furlong'"),
    (FRAME[:0], {}, "DataFrame: has no rows"),
    ([1, 2], {}, "a table is the path of a file, such as drops.csv, or a DataFrame; got list"),
], ids=["missing", "empty cell", "leaves", "unit", "no rows", "list"])  # fmt: skip
def test_a_frame_is_refused_as_a_file_is(frame, options, message):
    with pytest.raises(cl.ContactLearnError, match=message):
        cl.Impacts.from_frame(frame, **options)


def test_every_verb_takes_the_data_first():
    """But for `compare`, which takes models, and those that take a model, a file or a result, as `plan` may."""
    verbs = ("audit", "diagnose", "fit", "fit_subsets", "fit_trials", "learn")
    assert {next(iter(inspect.signature(getattr(cl, verb)).parameters)) for verb in verbs} == {"impacts"}


def test_a_fit_says_what_it_found():
    assert repr(FIT).startswith("Fit(wang_mason (textbook): μ = 0.1")
    assert "spin_damping: " in repr(FIT)
    assert "90 trials" in repr(FIT)
    assert FIT.params["eps"] == FIT.values[1].item() == FIT.to_frame().loc["eps", "value"]
    torch.testing.assert_close(torch.tensor(FIT.to_frame()["standard_error"].to_numpy()), FIT.standard_errors)
    for word in ("spin_damping.c", "0 outliers", "±"):
        assert word in FIT.summary()
    assert "<table" in FIT._repr_html_()
    halves = cl.fit(DROPS, "wang_mason", rows=torch.arange(90).reshape(2, 45))
    assert "2 subsets" in repr(halves)
    assert halves.params["mu"] == pytest.approx(halves.values[:, 0].mean().item())


def test_a_summary_tells_what_the_data_do_not_determine():
    still = DROPS.replace(v_pre=DROPS.v_pre * torch.tensor([0.0, 1.0, 0.0]), q=DROPS.q * 0, validate=False)
    r = torch.tensor([0.0, -0.025], dtype=torch.float64).expand(len(DROPS), 2)
    still = still.replace(r=r, v_post=-0.55 * still.v_pre)
    assert "mu is not determined" in cl.fit(still, "wang_mason").summary()


def test_fits_to_subsets_and_trials_have_defaults_that_fit():
    subsets = cl.fit_subsets(DROPS, "wang_mason", repetitions=3)
    assert subsets.sizes == (72,)
    mu, eps = subsets.mean()
    assert f"μ = {mu:.2f}"[:8] in repr(subsets)
    assert subsets.to_frame().loc[72, "eps"] == pytest.approx(eps)
    assert list(cl.fit_subsets(DROPS[:1], "wang_mason").to_frame().index) == [1]
    trials = cl.fit_trials(DROPS, "wang_mason")
    assert f"{trials.mu.median():.3f}"[:4] in repr(trials)
    assert len(trials.to_frame()) == 90


def test_learning_fits_the_law_of_the_recipe_first():
    recipe = cl.Recipe("x1", "wrench", cl.laws.find("wang_mason"))
    learned = cl.learn(DROPS, recipe)
    law = cl.fit_subsets(DROPS, "wang_mason", sizes=[90], repetitions=1).to_law()
    given = cl.learn(DROPS, recipe, base=law)
    assert (learned.law.mu, learned.law.eps) == pytest.approx((law.mu, law.eps))
    torch.testing.assert_close(learned.predict(DROPS).v_post, given.predict(DROPS).v_post)
    rows = torch.arange(90).reshape(3, 30)
    several = cl.learn(DROPS, recipe, rows=rows)
    alone = cl.learn(DROPS, recipe, rows=rows[1])
    torch.testing.assert_close(several.predict(DROPS).v_post[1], alone.predict(DROPS).v_post, rtol=1e-3, atol=1e-3)
    with pytest.raises(cl.ContactLearnError, match="takes impacts and a Recipe"):
        cl.learn(DROPS, "x1")


def test_models_are_compared_beside_the_rigid_bound():
    law = cl.fit(DROPS, "wang_mason").model
    table = cl.compare([FIT.model, law, law], DROPS)
    assert set(table.index[:3]) == {"wang_mason + spin_damping", "wang_mason", "wang_mason #2"}
    assert table.index[-1] == "rigid bound"
    error = cl.metrics.mass_error(DROPS, law.predict(DROPS))
    assert (
        table.loc["wang_mason", "error"]
        == pytest.approx(error.mean().item())
        == law.score(DROPS, cl.metrics.mass_error).item()
    )
    assert table.loc["wang_mason", "largest"] == error.max().item()
    assert (table["low"] < table["error"]).all()
    assert list(cl.compare({"mine": law}, DROPS, "velocity_error").index) == ["mine"]
    assert cl.compare([law], DROPS, cl.metrics.mass_error).equals(cl.compare([law], DROPS))
    assert cl.plot.comparison(table).axes


@pytest.mark.parametrize(("call", "message"), [
    (lambda: cl.compare(DROPS, [FIT.model]), "impacts must be Impacts, got list"),
    (lambda: cl.compare([], DROPS), "at least one model, got none"),
    (lambda: cl.compare([FIT], DROPS), "such as fit.model, .* got a Fit"),
    (lambda: cl.compare(FIT, DROPS), r"several models, such as \[fit.model\], then impacts; got a Fit first"),
    (lambda: cl.compare([FIT.model], DROPS, "mass_eror"), "did you mean 'mass_error'"),
    (lambda: cl.compare([FIT.model], DROPS, 3), "a metric is a function, such as .*; got 3"),
    (lambda: FIT.model.score(DROPS, "mass_error"), "a metric is a function, such as contactlearn.metrics.mass_error"),
], ids=["order", "none", "fit", "alone", "metric", "number", "score"])  # fmt: skip
def test_a_slip_in_a_comparison_is_told(call, message):
    with pytest.raises((cl.ContactLearnError, UnknownNameError), match=message):
        call()


def test_a_prediction_is_a_table(tmp_path):
    learned = cl.learn(DROPS, cl.Recipe("x1", "wrench"))
    prediction = learned.predict(DROPS)
    frame = prediction.to_frame()
    assert list(frame.columns[:6]) == ["vx_post", "vy_post", "omega_post", "P_t", "P_n", "tau"]
    assert frame["cov_vx_vx_post"][4] == prediction.covariance[4, 0, 0]
    assert "90 impacts" in repr(prediction)
    assert "with covariances" in repr(prediction)
    path = cl.save(learned, tmp_path / "model.pt", provenance={"data": "drops"})
    assert cl.load(path).provenance == {"data": "drops"}
    assert cl.load(cl.save(cl.load(path), tmp_path / "again.pt")).provenance == {"data": "drops"}


def test_a_notebook_shows_impacts_as_a_table():
    shown = DROPS._repr_html_()
    assert shown.count("<tr") == 6
    assert "90 trials" in shown
    assert isinstance(DROPS.to_frame(), pd.DataFrame)


DAMPING = EffectId("spin_damping", "after")


def test_a_notebook_shows_a_diagnosis_as_its_ladder():
    found = made_up(40, DAMPING)
    shown = found._repr_html_()
    rows = re.findall(r"<tr><td style='text-align:left'>(.*?)</td><td>(\S+) ", shown)
    assert len(rows) == len(found.ladder)
    assert [float(error) for _, error in rows] == pytest.approx([rung.error.mean for rung in found.ladder], rel=5e-3)
    assert "+ spin_damping" in shown


def test_a_diagnosis_hands_its_model_on_and_writes_its_report(tmp_path):
    record = record_of(40, DAMPING)
    found = replace(made_up(40, DAMPING), record=record)
    assert found.model is record.model
    assert cl.save_report(found, tmp_path / "new").read_text("utf-8").startswith("<!DOCTYPE html>")
    with pytest.raises(cl.ContactLearnError, match="no record of its trials"):
        found.without_record().model  # noqa: B018
    with pytest.raises(cl.ContactLearnError, match="no record of them"):
        cl.save_report(found.without_record(), tmp_path)
    assert cl.plot.ladder(found).axes
    with pytest.raises(UnknownNameError, match="missing effect 'spin_dampin', did you mean 'spin_damping'"):
        cl.plot.effect(found, "spin_dampin")


def test_recordings_say_what_was_found_and_refused(tmp_path):
    recordings = cl.simulation.recordings
    takes, _ = recordings.simulate(8, seed=3)
    recordings.write_recordings(takes, tmp_path)
    tracked = cl.read_recordings(tmp_path, mass=recordings.MASS, shape=cl.shapes.Ellipse(recordings.SEMI_AXES))
    assert repr(tracked).startswith(f"Tracked({len(tracked.impacts)} impacts in 8 recordings; refused: ")
    counts = [int(count) for count in re.findall(r"<td>(\d+)</td>", tracked._repr_html_())]
    assert sum(counts) == len(tracked.survey.refusals) > 0


def test_the_fit_of_a_diagnosis_has_its_forms_and_its_corrected_data():
    """A name alone stands for the first form of an effect."""
    tilt = EffectId("surface_tilt", "seen")
    found = made_up(60, tilt)
    fit = found.fit()
    assert fit.model.effects["surface_tilt"].id == tilt
    assert torch.equal(fit.loss, cl.fit(found.record.impacts, "wang_mason", [str(tilt)]).loss)
    assert not torch.equal(fit.loss, cl.fit(found.record.impacts, found.law, found.effects).loss)
    assert not torch.equal(fit.loss, found.fit(DROPS).loss)
    with pytest.raises(cl.ContactLearnError, match="no record of its trials, and so no model"):
        found.without_record().fit()
