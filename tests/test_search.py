"""The search over laws and effects: its linearisation, its exchanges, its set of models, and its clock."""

import itertools
import math
from dataclasses import replace
from types import SimpleNamespace

import pytest
import torch

from contactlearn.diagnosis.drift import dependence, lasts_beside
from contactlearn.diagnosis.options import DiagnoseOptions
from contactlearn.diagnosis.pipeline import diagnose
from contactlearn.diagnosis.result import Diagnosis, Level, Verdict
from contactlearn.diagnosis.search import selection
from contactlearn.diagnosis.search.candidates import all_candidates, follows_order
from contactlearn.diagnosis.search.frontier import Search
from contactlearn.diagnosis.search.ladder import coefficient_ends, name_probability
from contactlearn.diagnosis.search.pool import Pool, Spec, identities
from contactlearn.diagnosis.search.quadratic import Group
from contactlearn.diagnosis.search.selection import _pruned, inclusion, plausible_models
from contactlearn.diagnosis.sign_flips import chance_of_gain
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.effects import EffectId, columns, find_effect
from contactlearn.effects.formula.effect import formula
from contactlearn.inference.identification.joint import FitOptions, linearise
from contactlearn.inference.validation import Folds
from contactlearn.laws import find
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.shapes import Sphere
from contactlearn.models.contact_model import ContactModel
from contactlearn.report.text.sentences import headline
from contactlearn.simulation import hidden_effects, synthetic

PATCH, INERTIA = EffectId("contact_patch", "linear"), EffectId("inertia_error", "uniform")
SPIN, DRAG = EffectId("spin_damping", "after"), EffectId("side_drag", "linear")


def few(*ids):
    return {key: effect for key, effect in all_candidates().items() if key in ids}


def pooled(impacts, *ids, laws=("wang_mason",)):
    """A pool with the laws alone."""
    prepared = {key: effect.prepare(impacts) for key, effect in few(*ids).items()}
    pool = Pool({law: find(law) for law in laws}, impacts, prepared, {}, FitOptions())
    for law in laws:
        pool.fitted(Spec(law))
    return pool


def planted(size, seed=0, shape=None, **effects):
    """Synthetic drops with effects of these values."""
    states = synthetic.load(size=size, seed=seed, shape=shape)
    inside = {name: find_effect(name)(**values) for name, values in effects.items()}
    outcome = ContactModel(find("wang_mason").at(0.12, 0.55), effects=inside).predict(states).v_post
    generator, unit = torch.Generator().manual_seed(seed), torch.tensor((0.01, 0.01, 0.5), dtype=torch.float64)
    return states.replace(v_post=outcome + unit * torch.randn(size, 3, generator=generator, dtype=torch.float64))


def spec(*effects, law="wang_mason"):
    return Spec(law, frozenset(effects))


@pytest.mark.nightly
def test_a_law_that_is_far_off_alone_gets_the_effect_that_promises_most():
    """A superball with stated noise: the right law fits worst alone, and its linearisation says little."""
    n, generator = 150, torch.Generator().manual_seed(0)
    normal = torch.randn(n, 6, generator=generator, dtype=torch.float64)
    v = normal * torch.tensor((1.5, 1.5, 0.5, 10, 10, 10)) - torch.tensor((0, 0, 3.0, 0, 0, 0))
    level = torch.tensor((0, 0, 0.04, 1, 0, 0, 0), dtype=torch.float64).expand(n, -1)
    mass, r = torch.full((n,), 0.1, dtype=torch.float64), torch.tensor((0, 0, -0.04), dtype=torch.float64).expand(n, -1)
    ball = Impacts(mass, (0.4 * 0.1 * 0.04**2 + 0 * r).double(), r, level, v, v, shape=Sphere(0.04), validate=False)
    rebound = EffectId("tangential_restitution", "slip")
    superball = {rebound.name: find_effect(rebound.name, rebound.form)(0.55)}
    model = ContactModel(find("mirtich").at(0.34, 0.8), effects=superball)
    noise = (0.02, 0.02, 0.02, 0.2, 0.2, 0.2)
    errors = torch.randn(n, 6, generator=generator, dtype=torch.float64) * torch.tensor(noise)
    ball = ball.replace(v_post=model.predict(ball).v_post + errors)
    families = {f"{of}_dependent_restitution" for of in ("incidence", "slip", "velocity")} | {"load_dependent_friction"}
    every = all_candidates(ball.space).items()
    candidates = {key: one.prepare(ball) for key, one in every if key == rebound or key.name in families}
    laws = {law: find(law) for law in ("drumwright_shell", "mirtich", "whittaker")}
    pool = Pool(laws, ball, candidates, {}, FitOptions(noise=noise))
    pool.all_fitted({Spec(law): None for law in laws})
    assert pool.best().spec.law == "drumwright_shell"
    Search(pool, 2).run()
    assert pool.best().spec.effects == {rebound}


def test_derivatives_in_effects_that_vanish_are_their_own():
    impacts = planted(30)
    effects = {name: find_effect(name)().prepare(impacts) for name in ("surface_tilt", "inertia_error", "spin_damping")}
    others = [(key, effect.prepare(impacts)) for key, effect in all_candidates().items() if key.name not in effects]
    vanishing = {str(key): effect.vanished() for key, effect in others if effect.parameters}
    own = torch.tensor((0.12, 0.55, 0.01, 0.02, 0.1), dtype=torch.float64)
    theta = torch.cat((own, *(columns(*effect.values) for effect in vanishing.values())))
    law, scatter = find("wang_mason"), torch.eye(3, dtype=torch.float64)
    found = linearise(law, effects, impacts, theta, scatter, vanishing=vanishing)
    expected = linearise(law, {**effects, **vanishing}, impacts, theta, scatter)
    assert torch.equal(found.residual, expected.residual)
    torch.testing.assert_close(found.slope, expected.slope, rtol=1e-9, atol=1e-9)


def test_a_small_effect_gains_what_its_linearisation_predicts():
    impacts = planted(300, inertia_error={"kappa": 0.012}, contact_patch={"c": 0.00006})
    pool = pooled(impacts, SPIN, INERTIA, PATCH)
    base = pool.models[Spec("wang_mason")]
    quadratic = pool.quadratics([base])[0]
    sets = [frozenset(), *(frozenset({Group(effect)}) for effect in (INERTIA, PATCH))]
    losses, theta = quadratic.losses(sets)
    for one, loss, values in zip(sets[1:], losses[1:], theta[1:], strict=True):
        (effect,) = identities(one)
        fitted = pool.fitted(spec(effect))
        predicted = (losses[0] - loss).item()
        assert predicted == pytest.approx((base.fit.loss - fitted.fit.loss).item() * len(impacts), rel=0.3, abs=2.0)
        (fit,) = pool.polished(spec(effect))
        step, error = quadratic.values(one, values)[effect], fit.fit.standard_errors[-1].item()
        assert step == pytest.approx(fitted.values[effect], rel=0.3, abs=3 * error)
    impacts = planted(300, inertia_error={"kappa": 0.015}, spin_damping={"c": 0.1})
    pool = pooled(impacts, SPIN, INERTIA)
    both = pool.fitted(spec(SPIN, INERTIA))
    quadratic = pool.quadratics([both])[0]
    present = frozenset({Group(SPIN), Group(INERTIA)})
    assert quadratic.present == present
    losses, _ = quadratic.losses([present, present - {Group(INERTIA)}])
    without = pool.fitted(spec(SPIN))
    assert (losses[1] - losses[0]).item() == pytest.approx(
        (without.fit.loss - both.fit.loss).item() * len(impacts), rel=0.3, abs=2.0
    )
    # A loss of spin cannot be negative, so a spin that grows is no reason for it.
    drops = synthetic.load(size=200, seed=2)
    faster = drops.replace(v_post=drops.v_post * torch.tensor((1.0, 1.0, 1.1)), validate=False)
    pool = pooled(faster, SPIN)
    quadratic = pool.quadratics([pool.models[Spec("wang_mason")]])[0]
    _, theta = quadratic.losses([frozenset({Group(SPIN)})])
    assert theta[0, -1] == 0


def test_the_score_charges_for_parameters_and_for_choosing_among_many():
    impacts = synthetic.load(size=100)
    one, many = pooled(impacts, SPIN), pooled(impacts, SPIN, INERTIA, PATCH, DRAG)
    log_n = torch.tensor(100.0).log().item()
    assert one.penalty(frozenset({SPIN})) - one.penalty(frozenset()) == pytest.approx(log_n / 2)
    extra = many.penalty(frozenset({SPIN})) - many.penalty(frozenset())
    assert extra == pytest.approx(log_n / 2 + torch.tensor(4.0).log().item())


def worth(impacts, strong, weak, **limits):
    """What is named of a strong and a weak effect under other limits."""
    pool = pooled(impacts, strong, weak)
    both = pool.fitted(spec(strong, weak))
    folds = Folds.draw(len(impacts), torch.Generator().manual_seed(0))
    return _pruned(pool, folds, both, Thresholds(**limits)).spec.effects


def test_a_small_part_beside_a_strong_effect_is_not_worth_a_name():
    """It may be what the form of the strong one leaves, unless it is much of what is left."""
    impacts = planted(400, spin_damping={"c": 0.6}, inertia_error={"kappa": 0.03})
    assert worth(impacts, SPIN, INERTIA) == {SPIN}
    assert worth(impacts, SPIN, INERTIA, minor_share=0.0) == {SPIN, INERTIA}
    assert worth(impacts, SPIN, INERTIA, form_error=0.02) == {SPIN, INERTIA}


def test_what_is_left_without_an_effect_is_the_best_of_its_size():
    """The search ended with others than the hidden one, which alone is better than any two of them."""
    impacts = planted(300, spin_damping={"c": 0.3})
    pool = pooled(impacts, SPIN, INERTIA, PATCH, DRAG)
    pool.fitted(spec(SPIN))
    wrong = pool.fitted(spec(INERTIA, PATCH, DRAG))
    folds = Folds.draw(300, torch.Generator().manual_seed(0))
    assert _pruned(pool, folds, wrong, Thresholds()).spec == spec(SPIN)


def test_a_smaller_model_is_named_where_a_larger_one_is_not_worth_its_names(monkeypatch):
    """The strong effect, not the law alone, if three effects are no better than none."""
    impacts, third = planted(400, spin_damping={"c": 0.6}), EffectId("adhesion", "impulse")
    pool = pooled(impacts, SPIN, INERTIA, third)
    for size in (1, 2, 3):
        pool.all_fitted({spec(*some): None for some in itertools.combinations((SPIN, INERTIA, third), size)})

    def improves(without, whole, *_):
        sizes = len(without.fit.model.effects), len(whole.fit.model.effects)
        return sizes in ((2, 3), (1, 3), (0, 1))

    monkeypatch.setattr(selection, "_improves_enough", improves)
    folds = Folds.draw(len(impacts), torch.Generator().manual_seed(0))
    whole = pool.models[spec(SPIN, INERTIA, third)]
    assert _pruned(pool, folds, whole, Thresholds()).spec.effects == {SPIN}


@pytest.mark.nightly
def test_effects_that_together_stand_for_one_are_not_named():
    """A tangential spring is not quite any form of the catalogue: five effects score better, each with the others."""
    impacts, _ = hidden_effects.draw(103, effects=["tangential_restitution"], size=300)
    one = EffectId("tangential_restitution", "slip")
    five = {
        EffectId("contact_patch", "curve"),
        EffectId("inertia_error", "uniform"),
        EffectId("orientation_dependent_moment", "harmonics"),
        EffectId("orientation_dependent_restitution", "curve"),
        EffectId("shape_error"),
    }
    pool = pooled(impacts, one, *five, laws=("mirtich",))
    simple = pool.fitted(spec(one, law="mirtich"))
    many = pool.fitted(spec(*five, law="mirtich"))
    assert many.score < simple.score - 20
    folds = Folds.draw(300, torch.Generator().manual_seed(0))
    assert _pruned(pool, folds, many, Thresholds()) is simple


def test_two_effects_of_fewer_parameters_are_no_larger_than_one_of_many():
    """The arm of a moment around the body has four parameters, which an offset of θ and a patch of one each make."""
    impacts, _ = hidden_effects.draw(1, effects=["contact_patch", "orientation_offset"], size=40, strength=(1, 2.5))
    moment, patch, offset = (
        EffectId("orientation_dependent_moment", "harmonics"),
        EffectId("contact_patch", "linear"),
        EffectId("orientation_offset"),
    )
    pool = pooled(impacts, moment, patch, offset, laws=("mirtich",))
    one, two = (pool.fitted(spec(*some, law="mirtich")) for some in ((moment,), (patch, offset)))
    assert two.score < one.score - 5
    folds = Folds.draw(len(impacts), torch.Generator().manual_seed(0))
    assert _pruned(pool, folds, two, Thresholds()) is two
    plausible = plausible_models(pool, one, 7.0, torch.Generator().manual_seed(0))
    assert inclusion(plausible, moment) < 0.2


def test_a_spring_and_dashpot_are_tried_where_rigid_laws_do_no_better():
    """Else their rebound, which friction changes, is named restitution that depends on the configuration."""
    lever = EffectId("configuration_dependent_restitution", "linear")
    for planted_law, found in (("spring_dashpot", spec(law="spring_dashpot")), ("mirtich", spec(law="mirtich"))):
        impacts = synthetic.load(size=200, law=planted_law, mu=0.3, eps=0.4, velocity_noise=0.003, spin_noise=0.1)
        pool = pooled(impacts, lever, laws=("mirtich",))
        pool.laws["spring_dashpot"] = find("spring_dashpot")
        Search(pool, 1).run()
        assert pool.best().spec == found
        assert any(model.spec.law == "spring_dashpot" for model in pool.models.values()) == (found.law != "mirtich")


def test_springs_are_tried_where_another_rebound_is_found():
    """Where they vanish their slope says little: the search never begins with them."""
    impacts, _ = hidden_effects.draw(103, effects=["tangential_restitution"], size=300)
    slip, spring = (EffectId("tangential_restitution", form) for form in ("slip", "spring"))
    pool = pooled(impacts, slip, spring, SPIN, laws=("mirtich",))
    assert Search(pool, 1).run()
    assert pool.best().spec == spec(spring, law="mirtich")
    assert spring not in identities(frozenset(pool.quadratics([pool.models[spec(law="mirtich")]])[0].groups))


def test_law_and_effects_are_found_together():
    impacts, truth = hidden_effects.draw(31, size=300)
    hidden = {effect["name"] for effect in truth["effects"]}
    ids = [key for key in all_candidates() if key.name in hidden | {"adhesion", "gravity_impulse", "surface_tilt"}]
    pool = pooled(impacts, *ids, laws=("whittaker", "anitescu_potra_poisson", "wang_mason", "mirtich"))
    assert Search(pool, 4).run()
    best = pool.best()
    assert best.spec.families == hidden
    assert pool.models[best.spec.with_law(truth["law"])].score < best.score + 2


@pytest.mark.nightly
def test_effects_that_do_as_well_are_named_together():
    """On a disc, whose contact lies below its centre, adhesion and gravity on a late frame take the same from v_y⁺."""
    effects = EffectId("adhesion", "impulse"), EffectId("gravity_impulse")
    drops = planted(60, shape={"kind": "disc", "radius": 0.03}, gravity_impulse={"dt": 0.02})
    options = DiagnoseOptions(candidates=few(*effects, SPIN), laws=[find("wang_mason")])
    found = diagnose(drops, "wang_mason", options=options)
    (one,) = found.missing
    assert {one.effect, *one.alternatives} == {*effects}
    assert found.verdict is Verdict.EFFECTS
    assert (one.level, one.claim_level) == (Level.EITHER, Level.FOUND)
    assert one.confidence == pytest.approx(one.joint_confidence / 2, rel=0.02)
    assert headline(found).startswith("Either ")
    assert Diagnosis.from_json(found.to_json()) == found


def test_laws_that_agree_share_the_belief():
    """Where W_tn = 0 a ball follows Routh's path under every restitution."""
    drops = synthetic.load(size=120, seed=5)
    central = drops.replace(r=drops.r * torch.tensor((0.0, 1.0)), validate=False)
    noise = 0.01 * torch.randn(120, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    outcome = ContactModel(find("wang_mason").at(0.2, 0.6)).predict(central).v_post
    measured = central.replace(v_post=outcome + noise)
    pool = pooled(measured, SPIN, laws=("wang_mason", "mirtich", "drumwright_shell"))
    chosen = pool.models[Spec("wang_mason")]
    models = plausible_models(pool, chosen, 7.0, torch.Generator().manual_seed(0))
    shares = {one.model.spec.law: one.share for one in models}
    assert shares["wang_mason"] == pytest.approx(shares["mirtich"], abs=0.01)
    assert sum(shares.values()) == pytest.approx(1)
    assert inclusion(models, SPIN) == 0
    spun = pool.fitted(spec(SPIN))
    Search(pool, 1).exchange_all(spun, spun.score, 0)
    other = pool.models[spun.spec.with_law("mirtich")]
    assert other.fit.model.law.name == "mirtich"
    assert torch.equal(other.fit.values, spun.fit.values)


def test_a_larger_model_that_is_no_better_is_not_plausible():
    pool = pooled(planted(200, spin_damping={"c": 0.2}), SPIN, INERTIA, DRAG)
    alone, larger = (pool.fitted(spec(*some)) for some in ((SPIN,), (SPIN, DRAG)))
    assert alone.score < larger.score < alone.score + 7
    models = plausible_models(pool, larger, 7.0, torch.Generator().manual_seed(0))
    assert alone in [one.model for one in models]
    assert all(one.model.spec.effects != {SPIN, DRAG} or one.model is larger for one in models)
    found = plausible_models(pool, alone, 7.0, torch.Generator().manual_seed(0))
    assert [one.model for one in found] == [alone]
    assert inclusion(found, SPIN) == pytest.approx(1)


@pytest.mark.nightly
def test_a_search_without_time_is_reported():
    impacts, _ = hidden_effects.draw(12, effects=["spin_damping"], size=80)
    found = diagnose(
        impacts,
        find("wang_mason"),
        options=DiagnoseOptions(candidates=few(SPIN, DRAG), laws=[find("wang_mason")], seconds=1e-6),
    )
    assert not found.complete
    assert found.models
    assert found.frontier[0].effects == ()
    assert found.missing == ()  # what is missing is one of those that were not tried
    assert found.physics == found.verdict == "unfinished"
    assert "the search ran out of time" in headline(found)


def test_what_follows_the_order_is_known_by_its_predictions():
    """Also where it is one's own, so that no name is needed."""
    drops, candidates = synthetic.load(size=30), all_candidates()
    following = {key.name for key, effect in candidates.items() if follows_order(effect, drops)}
    assert following == {"parameter_drift"}
    assert follows_order(formula(eps="c*order", parameters={"c": [-1, 1]}), drops)
    assert not follows_order(formula(eps="c*vn", parameters={"c": [-1, 1]}), drops)


def wandering(impacts, memory, seed=1):
    """The same impacts with errors that wander, alike for all of them; `memory` is the correlation of neighbours."""
    generator, wander = torch.Generator().manual_seed(seed), torch.zeros(len(impacts), 3, dtype=torch.float64)
    for k in range(1, len(impacts)):
        step = torch.randn(3, generator=generator, dtype=torch.float64)
        wander[k] = memory * wander[k - 1] + math.sqrt(1 - memory**2) * step
    unit = torch.tensor((0.03, 0.03, 1.0), dtype=torch.float64)
    return impacts.replace(v_post=impacts.v_post + wander * unit, validate=False)


DRIFTS = [key for key in all_candidates() if key.name == "parameter_drift"]


def test_a_drifting_measurement_is_recognised():
    """Errors with a memory of ten trials, alike for all impacts: no physics."""
    drifting = wandering(synthetic.load(size=200, seed=3), memory=0.9)
    found = diagnose(
        drifting, find("wang_mason"), options=DiagnoseOptions(candidates=few(SPIN, *DRIFTS), laws=[find("wang_mason")])
    )
    (finding,) = (finding for finding in found.findings if finding.name == "measurement_drift")
    assert "Effects over the order are left out" in finding.sentence
    assert found.physics == "none"
    assert found.verdict == "bad_data"


@pytest.mark.nightly
def test_a_restitution_that_drifts_far_slower_is_named_beside_it():
    drifting = wandering(planted(240, parameter_drift={"c": 0.3}), memory=0.7)
    found = diagnose(
        drifting, find("wang_mason"), options=DiagnoseOptions(candidates=few(SPIN, *DRIFTS), laws=[find("wang_mason")])
    )
    (finding,) = (finding for finding in found.findings if finding.name == "measurement_drift")
    assert "Other effects over the order are left out" in finding.sentence
    assert found.effects == ("parameter_drift",)
    (drift,) = found.missing
    (per_thousand,), (first, last) = (one.value for one in drift.parameters), drift.coefficient_ends
    assert last - first == pytest.approx(0.239 * per_thousand)
    assert next(one for one in finding.evidence if one.quantity == "time_scale").value < 5


@pytest.mark.parametrize(("form", "ends"), [("restitution", (0.6, 0.5)), ("friction", (0.2, 0.1))])
def test_a_drift_ends_at_the_trial_that_was_measured_last(form, ends):
    """Wherever it stands in the table; c k/1000 of 101 trials is a tenth."""
    drops = synthetic.load(101)
    drops = drops.replace(order=drops.order.roll(40))
    effects = {"parameter_drift": find_effect("parameter_drift", form)(-1.0), "spin_damping": few(SPIN)[SPIN]}
    fitted = SimpleNamespace(fit=SimpleNamespace(model=ContactModel(find("wang_mason").at(0.2, 0.6), effects=effects)))
    assert coefficient_ends(fitted, drops, "parameter_drift") == pytest.approx(ends)
    assert coefficient_ends(fitted, drops, "spin_damping") is None


def test_other_forms_are_tried_where_a_linearisation_has_not_proposed_them():
    """Around every law of the beam, not only around that of the best model of a size."""
    states = synthetic.load(size=200, seed=3)
    nature = ContactModel(find("wang_mason").at(0.3, 0.6), effects={"it": find_effect("tangential_restitution")(0.8)})
    noise = torch.tensor((0.02, 0.02, 0.6)) * torch.randn(200, 3, generator=torch.Generator().manual_seed(3))
    impacts = states.replace(v_post=nature.predict(states).v_post + noise)
    slip, impulse = (EffectId("tangential_restitution", form) for form in ("slip", "impulse"))
    pool = pooled(impacts, slip, impulse, PATCH, laws=("wang_mason", "mirtich"))
    for law in pool.laws:
        pool.fitted(spec(impulse, law=law))
    Search(pool, 1)._exchange(1)
    assert {spec(slip), spec(slip, law="mirtich")} <= pool.models.keys()
    assert pool.best() is pool.models[spec(slip)]


@pytest.mark.nightly
def test_a_threshold_is_found_about_a_law_that_it_misleads():
    """As engines do, no rebound below 1 m/s: without it the law has a μ about which no threshold looks better."""
    generator = torch.Generator().manual_seed(0)
    disc = synthetic.load(size=220, shape={"kind": "disc", "radius": 0.03}, velocity_noise=0.0, spin_noise=0.0)
    low = torch.tensor([-2.0, -3.0, -30.0], dtype=torch.float64)
    high = torch.tensor([2.0, -0.3, 30.0], dtype=torch.float64)
    v_pre = low + (high - low) * torch.rand(220, 3, generator=generator, dtype=torch.float64)
    states = disc.replace(v_pre=v_pre, inertia=0.4 * disc.mass * 0.03**2)
    effect = find_effect("velocity_dependent_restitution", "threshold")(b=1.0, v_s=1.0)
    hidden = {"velocity_dependent_restitution": effect}
    outcome = ContactModel(find("whittaker").at(0.4, 0.66), effects=hidden).predict(states).v_post
    noise = 0.0007 * torch.tensor((1, 1, 30.0)) * torch.randn(220, 3, generator=generator, dtype=torch.float64)
    others = ("adhesion", "load_dependent_friction", "velocity_dependent_friction", "location_dependent_restitution")
    forms = [key for key in all_candidates() if key.name in (*hidden, *others)]
    pool = pooled(states.replace(v_post=outcome + noise), *forms, laws=("whittaker",))
    assert Search(pool, 3).run()
    assert EffectId("velocity_dependent_restitution", "threshold") in pool.best().spec.effects


@pytest.mark.parametrize("c", [0.2, 0.0], ids=["a restitution drifts", "nothing does"])
def test_held_out_blocks_distinguish_drift_from_correlated_noise(c):
    impacts = wandering(planted(240, parameter_drift={"c": c}), memory=0.7)
    pool = pooled(impacts, *DRIFTS)
    whole = pool.best(pool.fitted(spec(effect)) for effect in DRIFTS)
    residual = impacts.v_post - whole.fit.model.predict(impacts).v_post
    drift = dependence(residual, impacts.order)
    generator = torch.Generator().manual_seed(0)
    assert drift is not None
    alone, level = pool.models[Spec("wang_mason")], Thresholds().gain_level
    assert lasts_beside(drift, pool, whole, alone, level, generator) == (c > 0)


SURE = {"share": 0.99, "removed": 0.8, "reducible": 0.0, "trials": 200, "unknown": False}


def test_a_calibrated_confidence_is_a_probability():
    for share in (0.01, 0.5, 1.0):
        for removed in (-0.1, 0.0, 1.0, math.inf):
            for reducible in (0.0, 0.9):
                assert 0 < name_probability(share, removed, reducible, 50, unknown=reducible > 0) < 1
    assert name_probability(**SURE) > 0.9
    assert name_probability(share=0.9, removed=0.06, reducible=0.5, trials=200, unknown=False) < 0.5
    surest = name_probability(share=1.0, removed=math.inf, reducible=0.0, trials=10**6, unknown=False)
    assert surest <= 0.99  # nothing that was judged is surer


@pytest.mark.parametrize(("name", "less", "more"), [
    ("share", 0.4, 0.99), ("removed", 0.04, 1.0), ("reducible", 0.4, 0.0), ("trials", 40, 1000),
    ("unknown", True, False),
])  # fmt: skip
def test_more_evidence_means_more_confidence(name, less, more):
    assert name_probability(**(SURE | {name: less})) < name_probability(**(SURE | {name: more}))


@pytest.mark.parametrize("laws", [("wang_mason", "anitescu_potra_poisson"), ("anitescu_potra_poisson", "wang_mason")])
def test_laws_that_do_as_well_are_taken_in_the_order_of_the_question(laws):
    """A disc that slides throughout has the same outcome by both; the fits differ by what their tolerance leaves."""
    states = synthetic.load(size=60, shape={"kind": "disc", "radius": 0.03})
    side = torch.where(states.v_c[:, :1] < 0, -3.0, 3.0) * torch.tensor([1.0, 0.0, 0.0])  # m/s, so that none sticks
    states = states.replace(v_pre=states.v_pre + side)
    noise = 0.01 * torch.randn(60, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    impacts = states.replace(v_post=ContactModel(find("wang_mason").at(0.1, 0.5)).predict(states).v_post + noise)
    pool = pooled(impacts, laws=laws)
    first, second = (pool.models[Spec(law)] for law in laws)
    assert first.score == pytest.approx(second.score, abs=1e-6)
    for worse in (-1e-9, 1e-9):
        pool.models[Spec(laws[0])] = replace(first, score=second.score + worse)
        assert pool.best().spec.law == laws[0]


@pytest.mark.parametrize(("rest", "counts"), [(0.2, True), (-0.5, False)])
def test_a_gain_counts_where_few_trials_carry_it(rest, counts):
    """Four of 60 trials gain much, as where few slip: 2.3 standard errors of the mean."""
    gain = torch.tensor([5.0, 11.0, 17.0, 20.0, *[rest] * 56], dtype=torch.float64)
    assert (chance_of_gain(gain) < Thresholds().gain_level) == counts
    assert chance_of_gain(-gain) > 0.5
