"""The diagnosis: on nature's own physics, through Python and through the commands."""

from dataclasses import replace

import pytest
import torch
from diagnoses import few
from observers import RecordingObserver

from contactlearn.core.errors import DataError
from contactlearn.core.events import TaskProgress
from contactlearn.data import table
from contactlearn.diagnosis import events
from contactlearn.diagnosis.events import AuditFindings, LawChanged, LawsCompared
from contactlearn.diagnosis.options import DiagnoseOptions
from contactlearn.diagnosis.pipeline import diagnose
from contactlearn.diagnosis.result import Diagnosis, ErrorBudget, ErrorShares, NoiseSource
from contactlearn.diagnosis.search.candidates import all_candidates
from contactlearn.diagnosis.search.selection import select
from contactlearn.effects import EffectId, find_effect
from contactlearn.effects.formula.effect import formula
from contactlearn.inference.evaluation.metrics import Interval, mass_error
from contactlearn.inference.identification import joint
from contactlearn.inference.identification.joint import FitOptions
from contactlearn.inference.validation import Folds
from contactlearn.laws import find
from contactlearn.mechanics.impacts import Prediction
from contactlearn.report.events import event_lines
from contactlearn.report.text.sentences import grounds, headline
from contactlearn.simulation import hidden_effects, synthetic


def alone(truth, **options):
    """Nature's law, for a diagnosis that compares no others, so that tests are quick; with more options of it."""
    law = find(truth["law"])
    return {"law": law, "options": DiagnoseOptions(laws=[law], **options)}


def test_folds_hold_every_trial_out_as_often():
    folds = Folds.draw(103, torch.Generator().manual_seed(0), folds=5, repeats=3)
    assert folds.fitted.shape == (15, 83)
    counts = torch.bincount(folds.held_out.flatten(), minlength=103)
    assert counts.max() == 3
    assert counts.sum() == 15 * 20
    for fitted, held_out in zip(folds.fitted.tolist(), folds.held_out.tolist(), strict=True):
        assert not set(fitted) & set(held_out)
        assert len({*fitted, *held_out}) == 103
    score = torch.arange(103, dtype=torch.float64).expand(15, -1)
    found = folds.scores(score)
    assert torch.equal(found[counts > 0], score[0][counts > 0])
    assert found[counts == 0].isnan().all()
    with pytest.raises(DataError, match="needs at least 20 trials, got 12"):
        Folds.draw(12, torch.Generator())


def chosen(law, impacts, candidates, given=None, **options):
    """A selection around a law."""
    folds = Folds.draw(len(impacts), torch.Generator().manual_seed(0), repeats=1)
    return select(
        {law: find(law)}, impacts, candidates, folds, given=given or {}, options=FitOptions(**options),
        generator=torch.Generator().manual_seed(0),
    )  # fmt: skip


def test_held_out_errors_are_of_trials_that_were_not_fitted_to():
    """As by hand, fold by fold."""
    drops = synthetic.load(size=100, seed=1)
    selection = chosen("wang_mason", drops, few("surface_tilt"))
    folds, base = selection.folds, selection.base
    for fitted, held_out in zip(folds.fitted, folds.held_out, strict=True):
        by_hand = joint.fit(drops[fitted], find("wang_mason")).model.predict(drops[held_out])
        error = mass_error(drops[held_out], by_hand)
        torch.testing.assert_close(base.error[held_out], error, rtol=1e-3, atol=1e-6)


def test_a_hidden_effect_is_named():
    impacts, truth = hidden_effects.draw(12, effects=["location_dependent_restitution"], size=150)
    found = diagnose(impacts, **alone(truth))
    assert found.verdict == "effects"
    assert found.effects[0] == "location_dependent_restitution"
    floor = mass_error(impacts, Prediction(torch.tensor(truth["v_post_from_measured"]), None)).mean()
    base, named = found.budget.base.mean, found.budget.named.mean
    assert base - named > 0.85 * (base - floor)
    assert all(p.standard_error > 0 for p in found.missing[0].parameters)


def test_nothing_is_found_where_nothing_is_missing():
    impacts, _ = hidden_effects.draw(40, effects=[], size=200)
    found = diagnose(impacts)
    assert found.verdict == "none"
    assert found.missing == ()


def test_copies_of_rows_are_dropped_whatever_they_are_called(tmp_path):
    """Also through a file in which they have the names of their originals."""
    impacts, truth = hidden_effects.draw(5, effects=[], size=60)
    path = table.save(impacts, tmp_path / "drops.csv")
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines, *lines[5:15]]) + "\n")
    found = diagnose(
        table.load(path, impacts.shape, validate=False),
        **alone(truth, candidates=few("surface_tilt")),
    )
    assert [finding.correction for finding in found.findings] == ["drop_duplicates"]
    assert len(found.record.impacts) == 60
    with pytest.raises(DataError, match=r"repeats '5' of row 5 .data.correct=.drop_duplicates. drops"):
        table.load(path, impacts.shape)


def test_exact_data_are_no_trouble():
    """Nothing is left by the true law, and a law that is not true is seen to be worse."""
    drops = synthetic.load(size=80, velocity_noise=0, spin_noise=0, law="wang_mason")
    found = diagnose(drops, find("wang_mason"), options=DiagnoseOptions(candidates=few("surface_tilt", "side_drag")))
    assert Diagnosis.from_json(found.to_json()) == found
    assert min(found.laws, key=lambda one: one.error).name == "wang_mason"
    assert found.verdict == "none"
    assert found.budget.named.mean < 1e-6


@pytest.mark.nightly
def test_it_computes_on_one_thread():
    """Beside other work it takes seven times as long on two."""

    class Seen(Exception):
        pass

    def look(event):
        if not isinstance(event, AuditFindings):
            raise Seen(torch.get_num_threads())

    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        with pytest.raises(Seen, match=r"^1$"):
            diagnose(
                synthetic.load(size=30),
                **alone({"law": "mirtich"}, candidates=few("surface_tilt")),
                on_event=look,
            )
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)


@pytest.mark.nightly
def test_a_law_that_is_given_is_compared_with_the_others():
    drops = synthetic.load(size=120, law="mirtich")
    events = RecordingObserver()
    found = diagnose(drops, find("whittaker"), options=DiagnoseOptions(candidates=few("surface_tilt")), on_event=events)
    compared = events.last(LawsCompared)
    errors = {fit.name: fit.error for fit in compared.fits}
    assert compared.law == found.law == "whittaker"
    assert errors["whittaker"] > 3 * errors["mirtich"]
    assert found.better_law.name == "mirtich"
    assert found.verdict == "unknown"
    assert (
        headline(found)
        == "The Whittaker law does not describe these data; the Mirtich law does better: try law=mirtich."
    )
    assert any(one.startswith("Mirtich alone has an error of") for one in grounds(found))


def test_the_budget_adds_up():
    """Noise, explained and left are the whole error; the floor is what nature's own prediction leaves."""
    impacts, truth = hidden_effects.draw(8, effects=["contact_patch"], size=200)
    noise = truth["noise"]
    known = Prediction(torch.tensor(truth["v_post_from_measured"], dtype=torch.float64), impacts.wrench)
    floor = mass_error(impacts, known).mean().item()
    stated = (noise["v"], noise["v"], noise["omega"])
    budget = diagnose(impacts, **alone(truth, candidates=few("contact_patch"), noise=stated)).budget
    shares = budget.shares
    assert budget.noise.mean == pytest.approx(floor, rel=0.1)
    assert shares.noise + shares.explained + shares.unexplained == pytest.approx(1, abs=0.03)
    assert shares.explained == pytest.approx(1 - floor / budget.base.mean, abs=0.05)
    assert budget.named.mean < budget.ceiling.mean < budget.base.mean
    assert budget.named.mean < budget.bound.mean  # a moment is beyond any point contact
    assert shares.beyond_rigid > 0.05
    assert budget.noise_source is NoiseSource.STATED


def test_what_is_left_and_what_an_effect_removes_are_parts_of_the_squared_error():
    exact = {name: Interval(x, x, x) for name, x in (("base", 3.0), ("named", 2.0), ("flexible", 1.6), ("noise", 1.2))}
    shares = ErrorShares(noise=0.0, explained=0.0, unnamed=0.0, unexplained=0.0, beyond_rigid=0.0)
    budget = ErrorBudget(**exact, ceiling=exact["base"], bound=None, noise_source=NoiseSource.STATED, shares=shares)
    assert budget.reducible == pytest.approx((0.36 * 0.64) ** 0.5)  # 1 − (1.6/2)² and 1 − (1.2/2)²
    assert replace(budget, noise=None).reducible == pytest.approx(0.36)
    assert replace(budget, noise=exact["base"]).reducible == 0  # all of it may be noise
    assert budget.removed(1.0) == pytest.approx(1.25)  # (3/2)² − 1


def test_ones_own_effect_is_a_candidate_like_any_other():
    impacts, truth = hidden_effects.draw(3, effects=["spin_damping"], size=150)
    mine = {EffectId("mine"): formula(tau="-c*I*omega_post", parameters={"c": [0, 1]})}
    found = diagnose(impacts, **alone(truth, candidates=mine | few("surface_tilt", "adhesion")))
    assert found.effects == ("mine",)


@pytest.mark.nightly
def test_what_is_in_the_model_already_is_not_missing():
    impacts, truth = hidden_effects.draw(3, effects=["spin_damping"], size=150)
    given = {"spin_damping": find_effect("spin_damping")()}
    found = diagnose(impacts, effects=given, **alone(truth))
    assert found.verdict == "none"
    assert "spin_damping" in found.equation


def test_corrupted_data_are_mended_first_and_then_explained():
    impacts, truth = hidden_effects.draw(5, effects=["side_drag"], size=150)
    flip = torch.tensor((-1.0, 1.0, 1.0), dtype=torch.float64)
    spoilt = impacts.replace(
        q=impacts.q * flip, v_pre=impacts.v_pre * flip, v_post=impacts.v_post * flip, validate=False
    )
    events = RecordingObserver()
    found = diagnose(
        spoilt,
        **alone(truth, candidates=few("side_drag", "surface_tilt", "spin_damping")),
        on_event=events,
    )
    assert isinstance(events[0], AuditFindings)
    assert found.verdict == "bad_data"
    assert found.corrections == ("mirrored_x",)
    assert found.effects == ("side_drag",)


def test_data_of_no_impact_are_refused():
    impacts, _ = hidden_effects.draw(5, effects=[], size=120)
    order = torch.randperm(120, generator=torch.Generator().manual_seed(0))
    shuffled = impacts.v_post[order] * torch.tensor((1.0, -1.0, 3.0))
    found = diagnose(impacts.replace(v_post=shuffled, validate=False))
    assert found.verdict == "bad_data"
    assert any(finding.fatal for finding in found.findings)
    assert found.missing == ()


def test_what_is_compared_does_not_change_what_is_found():
    impacts, truth = hidden_effects.draw(12, effects=["surface_tilt"], size=250)
    selection = chosen(truth["law"], impacts, few("surface_tilt", "com_offset", "adhesion"), noise=(0.01, 0.01, 0.4))
    assert list(selection.present.effects) == ["surface_tilt"]


def test_an_unknown_effect_is_reported_as_unknown(tmp_path):
    """And in the events of the run, which a file holds as they were."""
    impacts, truth = hidden_effects.draw(7, effects=["magnetic_pull"], size=150)
    recorded, path = RecordingObserver(), tmp_path / events.FILE

    def on_event(event):
        recorded(event)
        events.append_event(path, event)

    found = diagnose(impacts, on_event=on_event, **alone(truth))
    assert found.verdict == "unknown"
    assert found.remainder.components[0] == "tau"
    assert found.remainder.variables[0].symbol == "theta"
    assert found.formulas[0].overrides()[0].startswith("+effect.mine.tau=")
    assert Diagnosis.from_json(found.to_json()) == found
    assert events.read_events(path) == recorded
    assert [type(one).__name__ for one in recorded if not isinstance(one, TaskProgress)] == [
        "AuditFindings", "LawsCompared", "LimitsEstimated", "RegionsFound", "EffectsFound", "RemainderLearned",
    ]  # fmt: skip
    assert [line.partition(":")[0] for line in event_lines(recorded[0])] == ["audit"]


@pytest.mark.nightly
def test_a_law_that_was_chosen_without_the_effects_is_chosen_again_with_them():
    """Alone, the law of the complementarity problem fits these drops better than the one that is true."""
    impacts, truth = hidden_effects.draw(31, size=200)
    events = RecordingObserver()
    both = {key: effect for key, effect in all_candidates().items() if key.name in ("spin_damping", "adhesion")}
    two = [find(truth["law"]), find("anitescu_potra_poisson")]
    found = diagnose(impacts, options=DiagnoseOptions(candidates=both, laws=two), on_event=events)
    assert min(found.laws, key=lambda one: one.error).name != found.law == truth["law"]
    assert events.last(LawChanged).law == truth["law"]
    assert set(found.effects) == {effect["name"] for effect in truth["effects"]}
