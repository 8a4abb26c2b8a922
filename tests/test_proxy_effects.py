"""Effects that only stand for something unknown, or for one that was not compared, are left out; true ones are not."""

from types import SimpleNamespace

import pytest
import torch
from diagnoses import few
from drops import LAW, NOISE, fitted, normal, thrown

from contactlearn import diagnose
from contactlearn.diagnosis import stages
from contactlearn.diagnosis.options import DiagnoseOptions
from contactlearn.diagnosis.result import Diagnosis, Verdict
from contactlearn.diagnosis.search.pool import Spec
from contactlearn.diagnosis.stages import Confidence, SearchResult
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.diagnosis.unexplained.proxy_effects import index_without_proxies
from contactlearn.effects import EffectId, State, find_effect
from contactlearn.inference.identification import joint
from contactlearn.inference.identification.joint import FitOptions
from contactlearn.laws import find
from contactlearn.mechanics.space import PLANE
from contactlearn.models.contact_model import ContactModel
from contactlearn.report.text.names import effect_label
from contactlearn.report.text.sentences import phrase

STAND_IN, TRUE = "slip_dependent_restitution", "side_drag"


def by_slip_and_angle(drops):
    state = State.of(drops)
    return 0.1 * state.v_t.abs() * (1 + (2 * state.theta).sin())


def hidden(restitution=by_slip_and_angle, size=300):
    """Drops that lose a tenth of their velocity, and whose restitution rises with slip at some angles."""
    drops, _ = fitted(size, 1, restitution=restitution)
    return drops.replace(v_post=drops.v_post * torch.tensor((0.9, 0.9, 1.0), dtype=torch.float64))


def models(drops, *sets):
    return [joint.fit(drops, LAW, {name: find_effect(name)() for name in names}) for names in sets]


def test_nothing_is_left_out_where_the_state_tells_nothing():
    drops = hidden(restitution=None)
    fits = models(drops, (TRUE,), (TRUE, "spin_damping"))
    assert index_without_proxies(drops, fits, FitOptions(), Thresholds()) == 1


@pytest.mark.nightly
def test_a_diagnosis_reports_excluded_candidates():
    found = diagnose(
        hidden(size=180),
        "wang_mason",
        options=DiagnoseOptions(candidates=few(TRUE, STAND_IN), laws=[find("wang_mason")]),
    )
    assert found.verdict is Verdict.UNKNOWN
    assert {*found.effects, *(one.effect.name for one in found.candidates if one.confidence is not None)} == {TRUE}
    assert found.remainder is not None
    assert found.remainder.state_dependence is not None
    (left_out,) = (one for one in found.candidates if one.confidence is None)
    assert left_out.effect.name == STAND_IN
    assert phrase("candidate", left_out).startswith(f"{effect_label(left_out.effect)} (a proxy?)")
    assert Diagnosis.from_json(found.to_json()) == found


def test_an_effect_that_leaves_a_little_of_its_own_dependence_is_no_proxy(monkeypatch):
    """A restitution that rises with the slip, at some angles by a fifth less: the form is not quite the catalogue's.

    Even where processes over the state predict as well without it.
    """
    monkeypatch.setattr(stages, "index_without_proxies", lambda *arguments: 0)

    def nearly(drops):
        state = State.of(drops)
        return 0.15 * state.v_t.abs() * (1 + 0.1 * (2 * state.theta).sin())

    drops, _ = fitted(300, 1, restitution=nearly, errors=lambda n, seed: 0.2 * normal(n, 3, seed=seed))
    options = DiagnoseOptions(candidates=few(TRUE, STAND_IN), laws=[find("wang_mason")])
    found = diagnose(drops, "wang_mason", options=options)
    assert found.effects == (STAND_IN,)
    assert found.missing[0].confidence > 0.5
    assert found.remainder.state_dependence.large


def test_a_name_that_stays_in_another_form_is_no_candidate_as_well():
    """Each name has one row: found, or a candidate for one reason."""
    curve, linear = (EffectId("velocity_dependent_friction", form) for form in ("curve", "linear"))
    drag, plain = EffectId("side_drag", "linear"), SimpleNamespace(shown_equation="", parameters=())
    fit = SimpleNamespace(
        model=SimpleNamespace(effects=dict.fromkeys((curve.name, drag.name), plain)),
        parameters=(), values=torch.zeros(0), standard_errors=torch.zeros(0), at_ends=set,
    )  # fmt: skip

    def chosen(*effects):
        return SimpleNamespace(
            missing=[*effects], spec=Spec(law="wang_mason", effects=frozenset(effects)),
            impacts=SimpleNamespace(space=PLANE), present=SimpleNamespace(fit=fit, mean_error=0.1),
            without_each=lambda lacking: [SimpleNamespace(mean_error=0.12)] * len(lacking),
        )  # fmt: skip

    search = SearchResult(selection=chosen(curve, drag), notes=(), limits=None, regions=())
    smaller = search.reduced(chosen(linear), {})
    assert [one.effect for one in smaller.candidates] == [drag]
    assert [one.effect for one in smaller.reduced(chosen(), {linear: Confidence(0.2, 0.2)}).candidates] == [
        drag,
        linear,
    ]


@pytest.mark.nightly
def test_a_moment_at_the_contact_is_no_more_than_a_candidate_where_the_shape_is_unknown():
    drops, proxy = thrown(100, 1), "orientation_dependent_moment"
    turned = ContactModel(LAW, effects={"turned": find_effect("orientation_offset")(0.1)}).predict(drops)
    drops = drops.replace(v_post=turned.v_post + NOISE * normal(len(drops), 3, seed=3))
    bodies = ["beech"] * 5 + ["oak"] * (len(drops) - 5)  # too few beeches for an outline, so no body has one
    drops = drops.replace(shape=None, object=bodies)
    candidates = few("orientation_offset", proxy)
    found = diagnose(drops, "wang_mason", options=DiagnoseOptions(candidates=candidates, laws=[find("wang_mason")]))
    assert found.shapeless == (EffectId("orientation_offset"),)
    assert (found.effects, found.verdict) == ((), Verdict.UNKNOWN)
    (candidate,) = found.candidates
    assert (candidate.effect.name, candidate.confidence < 0.5) == (proxy, True)
