"""Formulas about bodies in space: effects that they spell, and the search that finds planted ones."""

import pickle

import pytest
import torch
from diagnoses import few
from spatial import tossed

from contactlearn.core.errors import ContactLearnError, UnknownNameError
from contactlearn.core.serialisation import from_json, to_json
from contactlearn.diagnosis.options import DiagnoseOptions
from contactlearn.diagnosis.pipeline import diagnose
from contactlearn.diagnosis.result import Formula
from contactlearn.diagnosis.result.remainder import WrenchComponent
from contactlearn.diagnosis.unexplained.formulas import Library, axes, formula_effect, formulas
from contactlearn.effects import State
from contactlearn.effects.base import PLACES
from contactlearn.effects.configuration_dependent_restitution import QuadraticLeverRestitution
from contactlearn.effects.formula.effect import formula
from contactlearn.effects.formula.symbols import FORMULA_OUTPUTS, KNOWN, at_place, of_state, symbols
from contactlearn.inference.identification import joint
from contactlearn.inference.validation import Folds
from contactlearn.laws import find as find_law
from contactlearn.mechanics import rigid_body
from contactlearn.mechanics.rigid_body import apply_wrench, matvec, turn_quaternion
from contactlearn.mechanics.space import BOTH, PLANE, SPACE
from contactlearn.models import checkpoint
from contactlearn.models.contact_model import ContactModel
from contactlearn.report.text.sentences import phrase
from contactlearn.simulation import synthetic
from contactlearn.testing import EffectContract
from contactlearn.workbench import lines

ROUNDING = {"rtol": 1e-12, "atol": 1e-12}
TOSSED, DROPS = tossed(200), synthetic.load(60, seed=5)
LAW = find_law("wang_mason").at(0.25, 0.6)
C = {"c": [-1, 1]}
BY_PLACE = {
    "state": formula(rx="a*x/100", rz="b*rho/10", parameters={k: [-0.1, 0.1] for k in "ab"}),
    "law": formula(mu="c*slip", eps="-d*lever*sin(incidence)", parameters={"c": [-0.1, 0.1], "d": [-0.5, 0.5]}),
    "wrench": formula(
        P1="a*mu*Pn", P2="b*Pn*twist/10", tau2="-c*rho*P1", taun="-d*rho*Pn*sign(twist)",
        parameters={k: [-0.2, 0.2] for k in "abcd"},
    ),
    "velocity": formula(vz_post="-c*g", wx_post="-d*wx_post", parameters={"c": [0, 0.02], "d": [0, 1]}),
}  # fmt: skip


class TestStateFormula(EffectContract):
    effect = BY_PLACE["state"]


class TestLawFormula(EffectContract):
    effect = BY_PLACE["law"]


class TestWrenchFormula(EffectContract):
    effect = BY_PLACE["wrench"]


class TestVelocityFormula(EffectContract):
    effect = BY_PLACE["velocity"]


class TestFormulaOfBothSpaces(EffectContract):
    effect = formula(mu="c*vn", eps="d*order/100", parameters={"c": [-0.1, 0.1], "d": [-0.1, 0.1]})


def predict(effect, impacts=TOSSED):
    return ContactModel(LAW, effects={"mine": effect}).predict(impacts)


def test_a_formula_equals_the_effect_that_it_spells():
    mine = formula(eps="-c*lever**2", parameters=C).prepare(TOSSED).at([0.2])
    theirs = QuadraticLeverRestitution().prepare(TOSSED).at([0.2])
    torch.testing.assert_close(predict(mine).v_post, predict(theirs).v_post, **ROUNDING)
    assert (predict(mine).v_post - ContactModel(LAW).predict(TOSSED).v_post).abs().max() > 1e-3


def test_torsional_friction_is_a_formula():
    """τ_n = −c P_n sign(ω_n): before the spin stops it is the dry torsional friction of a light moment."""
    mine = formula(taun="-c*Pn*sign(twist)", parameters=C).at([1e-5])
    change = predict(mine).wrench - ContactModel(LAW).predict(TOSSED).wrench
    expected = torch.zeros_like(change)
    law = ContactModel(LAW).predict(TOSSED).wrench
    expected[:, 5] = -1e-5 * law[:, 2] * TOSSED.v_pre[:, 5].sign()
    torch.testing.assert_close(change, expected, rtol=1e-9, atol=1e-15)


def test_friction_in_the_axes_of_the_slip_turns_with_the_contact():
    about = torch.tensor((0.0, 0.0, 0.7), dtype=torch.float64)
    R = rigid_body.rotation(turn_quaternion(torch.tensor((1.0, 0, 0, 0)).double(), about))
    q = torch.cat((TOSSED.q[:, :3] @ R.mT, turn_quaternion(TOSSED.q[:, 3:], about)), -1)
    both = torch.block_diag(R, R)
    image = TOSSED.replace(r=TOSSED.r @ R.mT, q=q, v_pre=TOSSED.v_pre @ both.mT, validate=False)
    mine = BY_PLACE["wrench"].at([0.1, 0.05, 0.2, 0.01])
    torch.testing.assert_close(predict(mine, image).v_post, predict(mine).v_post @ both.mT, rtol=1e-9, atol=1e-9)
    along = predict(formula(P1="-c*Pn", parameters=C).at([0.1])).wrench - ContactModel(LAW).predict(TOSSED).wrench
    slip = torch.nn.functional.normalize(TOSSED.v_c[:, :2], dim=-1)
    normal = ContactModel(LAW).predict(TOSSED).wrench[:, 2]
    torch.testing.assert_close(along[:, :2], -0.1 * normal[:, None] * slip, **ROUNDING)


def test_symbols_have_their_named_values():
    state = State.of(TOSSED).replace(mu=torch.tensor(0.25).double(), eps=torch.tensor(0.5).double())
    assert {*of_state(state)} <= {*KNOWN[SPACE]}, "regions and remainders have the words of formulas"
    for place in PLACES:
        names = at_place(place, [SPACE])
        assert {*FORMULA_OUTPUTS[SPACE][place]} <= {*names}
        given = {"wrench": TOSSED.wrench, "velocity": TOSSED.v_post, "law": torch.rand(200, 2).double()}.get(place)
        so_far = {} if given is None else dict(zip(FORMULA_OUTPUTS[SPACE][place], given.unbind(-1), strict=True))
        seen = symbols(state, names, place, so_far)
        assert all(value.broadcast_to(200).dtype == torch.float64 for value in seen.values())
        torch.testing.assert_close(seen["slip"], TOSSED.v_c[:, :2].norm(dim=-1), **ROUNDING)
        torch.testing.assert_close(seen["twist"], TOSSED.v_pre[:, 5], **ROUNDING)
        torch.testing.assert_close(seen["rho"] ** 2, TOSSED.inertia.mean(-1) / TOSSED.mass, **ROUNDING)
        for name, value in so_far.items():
            assert torch.equal(seen[name], state.mu if name == "mu" and place != "law" else value)
    for symbol in KNOWN[SPACE].values():
        assert all((symbol.letter, symbol.unit, symbol.description))
    with pytest.raises(UnknownNameError, match="place law 'theta'"):
        symbols(state, ["theta"], "law")


SPACES = {
    "both": ({"mu": "c*vn"}, BOTH),
    "plane by a symbol": ({"mu": "c*theta"}, (PLANE,)),
    "plane by an output": ({"tau": "c*Pn"}, (PLANE,)),
    "space by a symbol": ({"eps": "c*twist"}, (SPACE,)),
    "space by an output": ({"P2": "c*Pn"}, (SPACE,)),
}


@pytest.mark.parametrize(("lines_", "spaces"), SPACES.values(), ids=SPACES)
def test_a_formula_exists_where_its_names_do(lines_, spaces):
    effect = formula(**lines_, parameters=C)
    assert effect.spaces == spaces
    for impacts in (DROPS, TOSSED):
        if impacts.space in spaces:
            effect.prepare(impacts)
            continue
        with pytest.raises(ContactLearnError, match=r"the formula .* exists for bodies that move in"):
            effect.prepare(impacts)
        with pytest.raises(ContactLearnError, match=r"exists for bodies that move in"):
            predict(effect, impacts)


BAD = {
    "symbols of both": ({"mu": "c*theta*slip"}, "must be all of the plane, or all of space, got mu, .*theta"),
    "outputs of both": ({"Pt": "c*Pn", "P1": "c*Pn"}, "must be all of the plane, or all of space, got Pt, P1, Pn"),
    "misspelt": ({"P1": "c*slipp"}, r"parameter 'slipp', did you mean 'slip'\?"),
    "no symbol of space": ({"taun": "c*theta"}, "unknown symbol or parameter 'theta'"),
    "another place": ({"eps": "c*P1*slip"}, "P1 is known only at wrench"),
    "a parameter": ({"eps": "slip", "parameters": {"slip": [0, 1]}}, "name of a symbol, got 'slip'"),
}


@pytest.mark.parametrize(("entries", "message"), BAD.values(), ids=BAD)
def test_formulas_that_make_no_sense_are_refused(entries, message):
    with pytest.raises(ContactLearnError, match=message):
        formula(**({"parameters": C} | entries))


@pytest.mark.parametrize("place", PLACES)
def test_formulas_survive_pickling_and_a_checkpoint(place, tmp_path):
    effect = BY_PLACE[place].at([0.01 * (k + 1) for k in range(len(BY_PLACE[place].parameters))])
    model = ContactModel(LAW, effects={"mine": effect})
    loaded = checkpoint.load(checkpoint.save(model, tmp_path / "model.pt", provenance={}))
    assert str(loaded) == str(model)
    for again in (pickle.loads(pickle.dumps(effect)), loaded.effects["mine"]):
        assert again.spaces == (SPACE,)
        assert torch.equal(predict(again).v_post, predict(effect).v_post)


# --- The search ------------------------------------------------------------------------------------


def measured(component, axis, planted, seed=3, count=200):
    """Tosses of random bodies by a law with a wrench on top, in the axes of the slip, and the law fitted to them."""
    impacts = tossed(count, seed)
    prediction = ContactModel(LAW).predict(impacts)
    more = torch.zeros_like(prediction.wrench)
    more[:, axes(component, SPACE)[axis]] = planted(impacts, prediction.wrench[:, 2])
    still = torch.zeros_like(impacts.v_pre)
    body = impacts.mass, impacts.world_inertia, impacts.r
    v_post = prediction.v_post + apply_wrench(*body, still, matvec(impacts.slip_axes, more))
    noise = torch.randn(v_post.shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    return impacts.replace(v_post=v_post + noise * torch.tensor((0.01,) * 3 + (0.2,) * 3), validate=False)


def radius(impacts):
    return (impacts.inertia.mean(-1) / impacts.mass).sqrt()


PLANTED = {
    "moment": ("tau", "n", lambda one, P_n: -0.4 * radius(one) * P_n * one.v_pre[:, 5].sign(),
        "rho*Pn*sign(twist)", -0.4),
    "side force": ("t", "2", lambda one, P_n: 0.03 * P_n * one.v_pre[:, 5], "Pn*twist", 0.03),
    "drag along the slip": ("t", "1", lambda one, P_n: -0.25 * one.mass * one.v_c[:, :2].norm(dim=-1), "m*slip", -0.25),
    "lift": ("n", "", lambda one, P_n: 0.05 * P_n * one.v_pre[:, 3:].norm(dim=-1), "Pn*spin", 0.05),
}  # fmt: skip


@pytest.mark.parametrize(("component", "axis", "planted", "term", "value"), PLANTED.values(), ids=PLANTED)
def test_a_planted_dependence_is_found_by_its_formula(component, axis, planted, term, value):
    impacts = measured(WrenchComponent(component), axis, planted)
    fit = joint.fit(impacts, LAW)
    folds = Folds.draw(len(impacts), torch.Generator().manual_seed(0))
    best, *_ = formulas(impacts, fit.model, component, folds)
    assert (best.axis, best.terms) == (axis, (term,))
    assert best.coefficients[0] == pytest.approx(value, rel=0.15)
    assert best.error_reduction > 5 * best.standard_error > 0
    assert from_json(Formula, to_json(best)) == best
    again = lines.parse_effect(lines.formula_line(best))
    assert again.spaces in ((SPACE,), BOTH)
    assert phrase("formula_change", best).startswith(KNOWN[SPACE][best.output].letter)


@pytest.mark.parametrize("component", WrenchComponent)
def test_every_term_is_accepted_and_none_is_found_where_nothing_is_planted(component):
    impacts = measured(component, next(iter(axes(component, SPACE))), lambda one, P_n: 0 * P_n, seed=4)
    fit = joint.fit(impacts, LAW)
    for axis in axes(component, SPACE):
        library, _ = Library.of(impacts, fit.model, component, axis)
        for term in library.terms:
            formula_effect(component.output(axis), (term,), ((-1.0, 1.0),)).prepare(impacts)
    assert formulas(impacts, fit.model, component, Folds.draw(200, torch.Generator().manual_seed(0))) == ()


@pytest.mark.nightly
def test_a_diagnosis_proposes_a_formula():
    component, axis, planted, term, _ = PLANTED["drag along the slip"]
    impacts = measured(WrenchComponent(component), axis, planted, count=80)
    found = diagnose(impacts, options=DiagnoseOptions(laws=[LAW], candidates=few("inertia_error")))
    assert found.formulas[0].output == "P1"
    assert found.formulas[0].terms == (term,)
    assert '+effect.mine.P1="c1*m*slip"' in found.formulas[0].overrides()
