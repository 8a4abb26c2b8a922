"""Large tables: subsamples that are even, grow until the answer stays, and are tested on all trials."""

from dataclasses import replace
from unittest.mock import patch

import pytest
import torch
from diagnoses import ERROR, TWO_COMPONENTS, few, made_up, provenance_of
from drops import seeded
from observers import RecordingObserver

from contactlearn.core.events import ignore
from contactlearn.data.audit.trials import repeated
from contactlearn.diagnosis.events import SubsampleStarted
from contactlearn.diagnosis.options import DiagnoseOptions
from contactlearn.diagnosis.pipeline import diagnose
from contactlearn.diagnosis.question import Question
from contactlearn.diagnosis.result import Diagnosis, Limit, Record, Verdict
from contactlearn.diagnosis.sampling import affordable, confirm, diagnose_subsamples, space_filling
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.effects import EffectId
from contactlearn.inference.identification.joint import FitOptions
from contactlearn.laws import find
from contactlearn.models.contact_model import ContactModel
from contactlearn.report.page.diagnosis import of_diagnosis
from contactlearn.report.page.page import render
from contactlearn.report.page.trials import EMBEDDED
from contactlearn.report.text.sentences import phrase, phrases
from contactlearn.simulation import hidden_effects, synthetic

SMALL = Thresholds(whole=375)  # subsamples of 150, 300 and 600 trials
LAW = find("wang_mason").at(0.12, 0.55)


@pytest.fixture(scope="module")
def many():
    impacts = synthetic.load(size=20_000, law="wang_mason", mu=0.12, eps=0.55, seed=1)
    return impacts.replace(object=("common",) * 19_989 + ("rare",) * 10 + ("once",))


def test_a_sample_is_even_over_objects_sequence_and_inputs(many):
    rows = space_filling(many, 500, seeded())
    assert len(rows.unique()) == 500
    assert torch.equal(rows, rows.sort().values)
    assert {many.object[row] for row in rows.tolist()} == {"common", "rare", "once"}
    for values in (many.order, many.q[:, 2], many.v_c[:, 0], many.v_c[:, 1]):
        octaves = torch.bincount(values.argsort().argsort()[rows] // 2500, minlength=8)
        assert (octaves - 62.5).abs().max() < 16  # 2 standard deviations of a random draw, of 32 cells in all
        assert (torch.bincount(values.argsort().argsort()[rows] // 10_000) - 250).abs().max() <= 6
    some = many[slice(0, 400)]
    counts = sum(torch.bincount(space_filling(some, 100, seeded(seed)), minlength=400) for seed in range(200))
    assert counts.min() > 20  # 50 on the average, 6 the deviation
    assert counts.max() < 80
    some = many.replace(validate=False)[torch.tensor([0, 1, 2, 1, 3, 0, 1])]
    r = some.r.clone()
    r[:, 0] = torch.tensor((0.0, 1, 2, 1, 3, -0.0, 1))
    assert repeated(some.replace(r=r)).tolist() == [False, False, False, True, False, True, True]


def grown(impacts, diagnosed, thresholds=SMALL, on_event=ignore, **options):
    """The diagnosis on subsamples, each of which another function diagnoses."""
    question = Question(
        law=None, given={}, candidates={}, laws={}, options=FitOptions(), limits={}, thresholds=thresholds,
        seconds=60.0, on_event=on_event,
    )  # fmt: skip
    with patch("contactlearn.diagnosis.sampling.diagnose_audited", diagnosed):
        return diagnose_subsamples(question, impacts, (), seed=0, **options)


def answering(laws, sizes):
    """A diagnosis that finds one law after the other."""
    left = iter(laws)

    def diagnosed(_, some, *others):
        sizes.append(len(some))
        return replace(made_up(30), law=next(left))

    return diagnosed


@pytest.mark.parametrize(("laws", "sizes", "limit"), [
    (("mirtich", "mirtich"), [150, 300], None),
    (("mirtich", "routh", "routh"), [150, 300, 600], None),
    (("mirtich", "routh", "mirtich"), [150, 300, 600], Limit.SIZE),
], ids=["at once", "later", "never"])  # fmt: skip
def test_subsamples_grow_until_two_answers_agree(many, laws, sizes, limit):
    diagnosed = []
    found = grown(many[slice(0, 2000)], answering(laws, diagnosed))
    assert diagnosed == sizes
    assert found.sample.limit is limit
    assert [one.law for one in found.sample.answers] == list(laws[: len(sizes)])
    assert found.law == laws[-1]
    assert found.sample.confirmation.trials == 2000 - sizes[-1]
    message = " ".join(phrases("sample_summary", found.sample))
    assert ("is not settled" in message) is (limit is Limit.SIZE)
    assert f"Diagnosed on {sizes[-1]} of 2000 trials" in message


def test_memory_takes_the_smaller_road(many):
    diagnosed = []
    assert affordable(1000, 0.5e9)
    assert not affordable(4000, 0.5e9)
    found = grown(many, answering(("mirtich",), diagnosed), Thresholds(), memory=0.5e9)
    assert diagnosed == [1000]
    assert found.sample.limit is Limit.MEMORY
    assert "memory" in phrases("sample_summary", found.sample)[0]


def test_a_stopped_run_goes_on_behind_its_finished_subsamples(many, tmp_path):
    table, diagnosed, events = many[slice(0, 2000)], [], RecordingObserver()

    def stopped(_, some, *others):
        if len(some) > 150:
            raise KeyboardInterrupt
        return replace(made_up(30), law="mirtich")

    resumed = {"on_event": events, "resume_folder": tmp_path / "parts"}
    with pytest.raises(KeyboardInterrupt):
        grown(table, stopped, **resumed)
    found = grown(table, answering(["mirtich"], diagnosed), **resumed)
    assert diagnosed == [300]
    heard = [(one.trials, one.resumed) for one in events.of(SubsampleStarted)]
    assert heard == [(150, False), (300, False), (150, True), (300, False)]
    undisturbed = grown(table, answering(["mirtich"] * 2, []))
    assert found == undisturbed
    (tmp_path / "parts" / "150" / "record.npz").write_bytes(b"half")  # what cannot be read is made again
    grown(table, answering(["mirtich"], diagnosed), **resumed)
    assert diagnosed == [300, 150]


@pytest.mark.nightly
@patch("contactlearn.inference.identification.scatter.COMPONENTS", TWO_COMPONENTS)
def test_a_large_table_is_diagnosed_on_samples():
    impacts, _ = hidden_effects.draw(8, effects=["contact_patch"], size=900)
    law, events = find("mirtich"), RecordingObserver()

    found = diagnose(
        impacts,
        law,
        options=DiagnoseOptions(candidates=few("contact_patch"), laws=[law], thresholds=SMALL),
        on_event=events,
    )
    assert found.effects == ("contact_patch",)
    assert [(one.trials, one.table_trials) for one in events.of(SubsampleStarted)] == [(150, 900), (300, 900)]
    sample = found.sample
    assert len(found.record.impacts) == sample.trials == 300
    assert sample.confirmation.agrees
    assert sample.confirmation.named.mean < 0.9 * sample.confirmation.base.mean
    assert sum(sample.confirmation.map.trials) == 900
    assert Diagnosis.from_json(found.to_json()) == found.without_record()
    assert "300 of 900 trials" in phrase("sample_support", found.sample)


def test_what_is_rare_is_found_among_all_trials(many):
    """A sample without any trial of a failing region of 1 %, and without the one outlier."""
    v_post = many.v_post.clone()
    failing = (many.q[:, 2].remainder(torch.pi) - 1).abs() < 0.0157
    v_post[failing, 0] += 0.3 * v_post[failing].norm(dim=-1)
    lost = int((~failing).nonzero()[123, 0])
    v_post[lost] += torch.tensor((3.0, 3.0, 100.0))
    impacts = many.replace(v_post=v_post)
    rows = (~failing).nonzero()[:, 0]
    rows = rows[rows != lost][::40]
    model = ContactModel(LAW)
    record = Record(impacts=impacts[rows], base=model, model=model, outcomes=torch.zeros(1, len(rows), 3))
    found = confirm(made_up(30), record, impacts, rows, generator=seeded(), noise=None, thresholds=Thresholds())
    (region,) = found.regions
    assert region.where.startswith(("|θ − 57°|", "|θ − 58°|"))  # the cells are of 2°
    assert region.trials < 500
    assert region.sampled < 10
    assert region.ratio.low > 3
    assert not found.agrees
    assert f"'{impacts.trial[lost]}'" in found.outliers.sentence or str(lost + 1) in str(found.outliers.evidence)


@pytest.fixture(scope="module")
def large():
    """A diagnosis of 4000 of 20 000 trials."""
    found = made_up(4000, EffectId("surface_tilt", "computed"), EffectId("side_drag", "linear"))
    return grown(synthetic.load(size=20_000, seed=2), lambda *_: found, Thresholds())


def test_the_page_of_a_large_table_is_small(large):
    content = of_diagnosis(large, provenance_of(large.record.impacts))
    assert content["trials"]["count"] == EMBEDDED
    assert content["arrays"]["v_post"]["shape"][1] == EMBEDDED
    assert len(render(content)) < 4.5e6
    assert sum(content["sample"]["map"]["trials"]) == 20_000
    assert any("4000 of 20\u00a0000 trials" in one for one in content["verdict"]["support"])
    assert large.record.impacts.trial[0] == content["trials"]["name"][0]
    assert large.record.impacts.trial[-1] == content["trials"]["name"][-1]
    one = large.sample.answers[0]
    assert one.agrees(replace(one, error=ERROR, trials=1))
    assert one.agrees(replace(one, effects=(EffectId("side_drag", "other"), EffectId("surface_tilt"))))
    assert not one.agrees(replace(one, effects=one.effects[:1]))
    assert not one.agrees(replace(one, physics=Verdict.UNKNOWN))
    found = made_up(30)
    content = of_diagnosis(found, provenance_of(found.record.impacts))
    assert "sample" not in content
    assert content["trials"]["count"] == 30
    assert phrase("sample_support", found.sample) == ""
