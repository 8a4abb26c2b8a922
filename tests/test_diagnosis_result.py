"""A diagnosis and its record, written and read back; thresholds are arguments and not constants."""

from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest
import torch
from diagnoses import few

from contactlearn.core.errors import ContactLearnError, DataError
from contactlearn.diagnosis.options import DiagnoseOptions
from contactlearn.diagnosis.pipeline import diagnose
from contactlearn.diagnosis.record import Record
from contactlearn.diagnosis.result import Diagnosis, RungKind, Verdict
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.inference.evaluation.metrics import Interval, bootstrap, mass_error
from contactlearn.inference.identification import joint
from contactlearn.laws import find
from contactlearn.mechanics.impacts import Prediction
from contactlearn.simulation import hidden_effects


@pytest.fixture(scope="module")
def impacts():
    return hidden_effects.draw(11, effects=["surface_tilt", "spin_damping"], size=120)[0]


@pytest.fixture(scope="module")
def three():
    return few("surface_tilt", "spin_damping", "side_drag")


@pytest.fixture(scope="module")
def found(impacts, three):
    return diagnose(
        impacts,
        find("wang_mason"),
        options=DiagnoseOptions(candidates=three, laws=[find("wang_mason"), find("mirtich")]),
    )


def test_a_diagnosis_is_read_back_equal(found):
    text = found.to_json()
    assert Diagnosis.from_json(text) == found
    assert "record" not in text or '"record": null' in text
    assert found.missing
    with pytest.raises(ContactLearnError, match="verdict"):
        Diagnosis.from_json(text.replace('"verdict": "effects"', '"verdict": "perhaps"'))
    shown = repr(found)
    assert shown.startswith("Diagnosis(verdict='effects', law='wang_mason', ")
    assert all(f"{one.effect} (" in shown for one in found.missing)
    assert f"error {found.budget.base.mean:.3g} → {found.budget.named.mean:.3g}" in shown
    assert [rung.kind for rung in found.ladder] == [
        RungKind.LAW, *[RungKind.EFFECT] * len(found.missing), RungKind.PROCESSES, RungKind.NOISE
    ]  # fmt: skip
    assert [rung.effect for rung in found.ladder[1:-2]] == [missing.effect for missing in found.missing]
    floor = Interval(0.0022, 0.0020, 0.0024)
    for instrument, kinds in (
        (Interval(0.0023, 0.0021, 0.0025), [RungKind.NOISE]),
        (Interval(0.0010, 0.0009, 0.0011), [RungKind.SCATTER, RungKind.INSTRUMENT]),
    ):
        budget = replace(found.budget, noise=floor, instrument=instrument)
        assert [rung.kind for rung in budget.rungs[1:]] == kinds
    budget = found.budget
    assert (budget.base, budget.named) == (found.ladder[0].error, found.ladder[len(found.missing)].error)
    assert (budget.flexible, budget.noise) == (found.ladder[-2].error, found.ladder[-1].error)


def test_its_record_is_read_back_to_the_last_bit(found, tmp_path):
    with pytest.raises(ContactLearnError, match="no such file"):
        Record.load(tmp_path)
    found.record.save(tmp_path, {"made": "by hand"})
    read = Record.load(tmp_path)
    kept = found.record
    assert read.impacts.fingerprint() == kept.impacts.fingerprint()
    assert (read.impacts.source, read.impacts.shape) == (kept.impacts.source, kept.impacts.shape)
    assert torch.equal(read.outcomes, kept.outcomes)
    for one, other in ((read.base, kept.base), (read.model, kept.model)):
        assert torch.equal(one.predict(read.impacts).v_post, other.predict(kept.impacts).v_post)
    assert str(read.model) == found.equation
    for one, other in zip(read.residuals, kept.residuals, strict=True):
        for field in fields(other):
            mine, theirs = getattr(one, field.name), getattr(other, field.name)
            assert torch.equal(mine, theirs) if isinstance(theirs, torch.Tensor) else mine == theirs
    arrays = dict(np.load(tmp_path / "record.npz"))
    np.savez(tmp_path / "record.npz", **arrays | {"outcomes": arrays["outcomes"][:, 1:]})
    with pytest.raises(DataError, match="do the files belong to one run"):
        Record.load(tmp_path)
    np.savez(tmp_path / "record.npz", **arrays | {"outcomes": np.array([{"a": 1}], dtype=object)})
    with pytest.raises(DataError, match=r"record\.npz"):
        Record.load(tmp_path)
    (tmp_path / "record.npz").write_bytes(b"no archive")
    with pytest.raises(DataError, match="cannot be read"):
        Record.load(tmp_path)


def test_everything_is_frozen_and_made_with_keywords():
    """Of the types that a diagnosis consists of."""
    import contactlearn.diagnosis.result as result

    kinds = [kind for kind in map(result.__dict__.get, result.__all__) if is_dataclass(kind)]
    assert len(kinds) > 20
    for kind in kinds:
        assert kind.__dataclass_params__.frozen, kind
        assert all(field.kw_only for field in fields(kind)), kind


def test_choices_are_joint_fits(found, impacts):
    effects = found.choices.effects
    assert effects == tuple(missing.effect for missing in found.missing)
    assert len(found.choices.errors) == len(found.record.outcomes) == 2 ** len(effects)
    for k, interval in enumerate(found.choices.errors):
        chosen = {one.name: found.record.model.effects[one.name] for j, one in enumerate(effects) if k >> j & 1}
        fit = joint.fit(impacts, find("wang_mason"), chosen)
        expected = mass_error(impacts, fit.model.predict(impacts)).mean().item()
        assert interval.mean == pytest.approx(expected, rel=0.01)
    full = len(found.record.outcomes) - 1
    for j, missing in enumerate(found.missing):
        without, with_ = (
            mass_error(impacts, Prediction(found.record.outcomes[k], impacts.wrench)) for k in (full - 2**j, full)
        )
        expected = bootstrap(without - with_, torch.Generator().manual_seed(0), 10).mean
        assert missing.reduction_on_all_trials.mean == pytest.approx(expected)
    fit = next(one for one in found.laws if one.name == "mirtich")
    law = joint.fit(impacts, find("mirtich")).model.base
    assert float(fit.law().mu) == pytest.approx(float(law.mu), abs=1e-4)


def test_thresholds_decide(impacts, three):
    """An effect that would have to halve the error is not named, and a region no worse than the rest not reported."""
    strict = Thresholds(least_gain=0.99, region_ratio=100.0)
    law = find("wang_mason")
    found = diagnose(impacts, law, options=DiagnoseOptions(candidates=three, laws=[law], thresholds=strict))
    assert found.missing == ()
    assert found.regions == ()
    assert found.verdict is Verdict.UNKNOWN  # for the processes still find something
    assert found.thresholds == strict
    assert Diagnosis.from_json(found.to_json()) == found
    with pytest.raises(DataError, match="at least 121 trials, got 120"):
        diagnose(impacts, options=DiagnoseOptions(thresholds=replace(Thresholds(), fewest_trials=121)))
