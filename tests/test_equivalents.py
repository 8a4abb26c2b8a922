"""Effects that coincide on the data are reported as equivalents, others are not; the next drops tell them apart."""

import math

import pytest
import torch
from drops import seeded
from spatial import tossed

from contactlearn import laws
from contactlearn.core.errors import DataError, UnknownNameError
from contactlearn.core.serialisation import from_json, to_json
from contactlearn.diagnosis.discrimination.experiment import (
    STATES,
    ModelDiscrimination,
    Substitution,
    next_experiment,
    separations_of,
    state_limits,
    within_a_turn,
)
from contactlearn.diagnosis.discrimination.rivals import find_rivals, similarity
from contactlearn.diagnosis.result.effects import Experiment
from contactlearn.diagnosis.search.candidates import all_candidates
from contactlearn.diagnosis.search.pool import Pool, Spec
from contactlearn.diagnosis.search.selection import Selection, select, validated
from contactlearn.effects import EffectId, find_effect
from contactlearn.inference.identification import joint
from contactlearn.inference.identification.joint import FitOptions
from contactlearn.inference.validation import Folds, paired_gain, robust_covariance
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.shapes import contact_point
from contactlearn.mechanics.space import PLANE
from contactlearn.models.contact_model import ContactModel
from contactlearn.report.text.sentences import phrase
from contactlearn.simulation import synthetic

NOISE = torch.tensor((0.01, 0.01, 0.5), dtype=torch.float64)
POWER, VISCOELASTIC = (EffectId("velocity_dependent_restitution", form) for form in ("power", "kuwabara_kono"))
LATE = EffectId("gravity_impulse")
PATCH = Substitution(LATE, EffectId("contact_patch", "linear"))
WIDE = {"v_x": (-2.0, 2.0), "v_y": (-4.0, -1.0), "omega": (-20.0, 20.0)}


def candidates(*names):
    """Those effects in all their forms; the whole catalogue if none is named."""
    return {key: one for key, one in all_candidates().items() if not names or key.name in names}


def measured(states, effect, seed):
    """What wang_mason with an effect makes of states, and noise."""
    noise = NOISE * torch.randn((len(states), 3), generator=seeded(seed), dtype=torch.float64)
    model = ContactModel(laws.find("wang_mason").at(0.12, 0.55), effects={effect.name: effect})
    return states.replace(v_post=model.predict(states).v_post + noise)


def drops(effect, size, seed=0, width=1.0):
    """Synthetic drops whose speeds of falling and spins are spread by a share `width` of the usual."""
    states = synthetic.load(size=size, seed=seed)
    v = states.v_pre.clone()
    v[:, 1] = -2.55 + width * (v[:, 1] + 2.55)
    v[:, 2] *= width
    states = states.replace(v_pre=v)
    return measured(states, effect.prepare(states), seed)


def having(impacts, *chosen, among=()):
    """A selection that has chosen these effects."""
    prepared = {key: effect.prepare(impacts) for key, effect in candidates(*among).items()}
    pool = Pool({"wang_mason": laws.find("wang_mason")}, impacts, prepared, {}, FitOptions())
    spec, folds = Spec("wang_mason", frozenset(chosen)), Folds.draw(len(impacts), seeded(0))
    base, present = (validated(pool, folds, pool.fitted(one)) for one in (Spec("wang_mason"), spec))
    return Selection(pool=pool, folds=folds, spec=spec, base=base, present=present, plausible=(), complete=True)


def chosen(law, impacts, given=None):
    """A selection from the whole catalogue."""
    folds = Folds.draw(len(impacts), seeded(0))
    return select({law: laws.find(law)}, impacts, candidates(), folds, given=given or {}, generator=seeded(0))


def gravity(dt):
    return find_effect("gravity_impulse")(dt=dt)


def slowing(p):
    return find_effect("velocity_dependent_restitution")(p=p)


@pytest.fixture(scope="module")
def one_height():
    """Sixty drops from one height with a late frame, and what could stand for it."""
    selection = having(drops(gravity(0.004), 60, seed=1, width=0.1), LATE)
    return selection, find_rivals(selection)[LATE]


@pytest.fixture(scope="module")
def rivals(one_height):
    selection, found = one_height
    models = {one.rival.effect.name: one.fitted.fit.model for one in found}
    return selection.impacts, selection.present.fit.model, {PATCH: models["contact_patch"]}


def test_drops_from_one_height_do_not_tell_a_late_frame_from_an_offset_of_the_contact(one_height):
    selection, found = one_height
    patch = next(one for one in found if one.rival.effect == EffectId("contact_patch", "linear"))
    assert patch.rival.similarity > 0.95
    assert 0 < patch.rival.loss_difference < min(0.1, 2 * patch.rival.standard_error)
    assert patch.fitted.effects.keys() == {"contact_patch"}
    worse = [one.rival.loss_difference for one in found]
    assert worse == sorted(worse)
    # Spin damping mimics some of it only with the wrong sign.
    assert "spin_damping" not in [one.rival.effect.name for one in found]
    models = {Substitution(LATE, one.rival.effect): one.fitted.fit.model for one in found}
    assert len(models) >= 2
    planned = next_experiment(selection.impacts, selection.present.fit.model, models, generator=seeded(0), limits=WIDE)
    assert [Substitution(one.effect, one.rival) for one in planned.separations] == [*models]
    assert all(one.drops_needed <= 60 for one in planned.separations)


@pytest.mark.nightly
def test_many_drops_from_many_heights_do():
    assert find_rivals(having(drops(gravity(0.02), 400), LATE)) == {LATE: ()}
    impacts = drops(gravity(0.004), 60, seed=1, width=0.1)
    given = {"gravity_impulse": gravity(0.0)}
    assert find_rivals(chosen("wang_mason", impacts, given)) == {}


def test_few_drops_do_not_tell_a_weak_dependence_on_the_speed_from_adhesion():
    selection = having(drops(slowing(-0.04), 60, 1), POWER, among=("velocity_dependent_restitution", "adhesion"))
    assert EffectId("adhesion", "work") in [one.rival.effect for one in find_rivals(selection)[POWER]]


def test_adhesion_and_other_forms_are_no_equivalents():
    """It mimics that to first order, but would have to be negative: the refit says so."""
    selection = having(drops(slowing(0.25), 100), POWER, among=("velocity_dependent_restitution", "adhesion"))
    assert similarity(selection, POWER)[EffectId("adhesion", "work")].similarity > 0.5
    assert find_rivals(selection) == {POWER: ()}
    selection = having(drops(slowing(0.1), 60), POWER, among=("velocity_dependent_restitution",))
    spec = Spec("wang_mason", frozenset({VISCOELASTIC}))
    other = validated(selection.pool, selection.folds, selection.pool.fitted(spec))
    assert abs(paired_gain(selection.present, other)[0]) < 0.01  # though they are as good
    assert find_rivals(selection) == {POWER: ()}


def test_an_angle_is_one_that_can_be_set():
    """−213° is 147°; an instrument that counts from 0 to 360° is left as it is."""
    theta = torch.tensor((-213.0, 147.0, -170.0), dtype=torch.float64).deg2rad()
    assert within_a_turn(theta, theta).rad2deg().tolist() == pytest.approx([147, 147, -170])
    assert within_a_turn(theta, theta.remainder(2 * math.pi)).rad2deg().tolist() == pytest.approx([147, 147, 190])


def test_next_drops_separate_better_than_random_ones(rivals):
    impacts, chosen, others = rivals
    best = next_experiment(impacts, chosen, others, generator=seeded(0), limits=WIDE).drops
    everywhere = next_experiment(impacts, chosen, others, generator=seeded(5), limits=WIDE, count=64, drawn=64).drops
    expected = [sum(d.differences[0] ** 2 for d in some) / len(some) for some in (best, everywhere)]
    assert expected[0] > 2 * expected[1]
    assert expected[1] > separations_of(impacts, chosen, others, impacts).mean()  # than the drops that were made
    limits = WIDE | {"theta": (-0.5, 0.5)}
    found = next_experiment(impacts, chosen, others, generator=seeded(0), limits=limits).drops
    assert len(found) == len(set(found)) == 6
    for drop in found:
        assert drop.x is None  # which neither of the two depends on
        for name, (low, high) in limits.items():
            assert low <= getattr(drop, name) <= high
        r_x = contact_point(impacts.shape, torch.tensor(drop.theta, dtype=torch.float64))[0].item()
        assert drop.v_y + r_x * drop.omega < 0
    assert max(d.v_y for d in found) - min(d.v_y for d in found) > 1
    first, again, other = (next_experiment(impacts, chosen, others, generator=seeded(s)) for s in (3, 3, 4))
    assert first == again != other
    assert from_json(Experiment, to_json(first)) == first
    found = next_experiment(impacts.replace(shape=None), chosen, others, generator=seeded(0)).drops
    assert all(d.theta in impacts.q[:, 2].tolist() for d in found)
    within = dict(zip(STATES[PLANE], state_limits(impacts, {"v_x": (0.0, 1.0)}).tolist(), strict=True))
    assert within["v_x"] == [0.0, 1.0]
    assert within["v_y"] == pytest.approx(
        [1.25 * impacts.v_pre[:, 1].min().item(), 0.75 * impacts.v_pre[:, 1].max().item()]
    )
    assert within["x"] == [impacts.q[:, 0].min(), impacts.q[:, 0].max()]
    bending = find_effect("location_dependent_restitution")().prepare(impacts)
    bent = bending.at([0.1] * len(bending.parameters))
    law = laws.find("wang_mason").at(0.12, 0.55)
    models = {PATCH: ContactModel(law, effects={bent.name: bent})}
    found = next_experiment(impacts, ContactModel(law), models, generator=seeded(0)).drops
    low, high = impacts.q[:, 0].aminmax()
    assert all(low <= d.x <= high for d in found)


def test_the_proposed_drops_discriminate_the_two(rivals):
    """After as many as are said to be needed the evidence is that promised; after some more there is no equivalent."""
    impacts, chosen, others = rivals
    planned = next_experiment(impacts, chosen, others, generator=seeded(0), limits=WIDE)
    made, needed = placed(impacts, planned.drops * 2), planned.separations[0].drops_needed
    patch, evidence = {"contact_patch": find_effect("contact_patch")()}, []
    for seed in range(6):
        together = joined(impacts, measured(made[:needed], gravity(0.004), seed))
        losses = [
            joint.fit(together, laws.find("wang_mason"), effects).loss.item()
            for effects in (patch, {"gravity_impulse": gravity(0.0)})
        ]
        evidence.append((losses[0] - losses[1]) * len(together))
    assert math.log(20) - 1 < sum(evidence) / 6 < math.log(20) + 4
    together = joined(impacts, measured(made, gravity(0.004), seed=9))
    selection = having(together, LATE, among=("gravity_impulse", "contact_patch"))
    assert find_rivals(selection) == {LATE: ()}


def placed(impacts, made):
    """The drops as states of the body."""
    values = torch.tensor([[d.theta, d.v_x, d.v_y, d.omega] for d in made], dtype=torch.float64)
    r = contact_point(impacts.shape, values[:, 0])
    q = torch.stack((torch.full((len(made),), 0.3, dtype=torch.float64), -r[:, 1], values[:, 0]), -1)
    body = (x[:1].expand(len(made)) for x in (impacts.mass, impacts.inertia))
    return Impacts(*body, r, q, values[:, 1:], values[:, 1:], shape=impacts.shape)


def joined(first, second):
    names = ("mass", "inertia", "r", "q", "v_pre", "v_post")
    return Impacts(*(torch.cat((getattr(first, n), getattr(second, n))) for n in names), shape=first.shape)


def test_evidence_drop_by_drop_is_that_of_all_of_them_together():
    difference, slope, root = (
        torch.randn(shape, generator=seeded(k), dtype=torch.float64)
        for k, shape in enumerate(((4, 3), (4, 3, 5), (5, 5)))
    )
    noise, covariance, total = torch.diag(NOISE), root @ root.T, 0.0
    discrimination = ModelDiscrimination(
        difference=difference, slope=slope, covariance=covariance, noise=noise.expand(4, -1, -1)
    )
    for k in range(4):
        total += discrimination.squared()[k]
        discrimination = discrimination.after(k)
    J = slope.flatten(0, 1)
    together = torch.block_diag(*[noise] * 4) + J @ covariance @ J.T
    assert total == pytest.approx((difference.flatten() @ torch.linalg.solve(together, difference.flatten())).item())
    left = NOISE * torch.randn((2000, 3), generator=seeded(0), dtype=torch.float64)
    left[:40] *= 30
    assert (robust_covariance(left).diagonal().sqrt() / NOISE - 1).abs().max() < 0.08
    alone = left * torch.tensor([0.0, 1.0, 0.0])  # of bounces along the normal: one degree of freedom, not three
    assert (robust_covariance(alone)[1, 1].sqrt() / NOISE[1] - 1).abs() < 0.08


def test_models_without_uncertainty_need_the_drops_of_a_likelihood_ratio(rivals):
    """With d standard deviations each, log(20) / (d²/2) of them."""
    impacts, _, _ = rivals
    law, none = laws.find("wang_mason").at(0.12, 0.55), {PATCH: ContactModel(laws.find("wang_mason").at(0.12, 0.55))}
    late = ContactModel(law, effects={"gravity_impulse": gravity(0.001)})
    found = next_experiment(impacts, late, none, generator=seeded(0), count=1)
    (one,), (drop,) = found.separations, found.drops
    assert one.drops_needed == math.ceil(math.log(20) / (drop.differences[0] ** 2 / 2))
    (same,) = next_experiment(impacts, late, {PATCH: late}, generator=seeded(0)).separations
    assert same.drops_needed is None


@pytest.mark.parametrize(("limits", "error", "words"), [
    ({"v_n": (-2, -1)}, UnknownNameError, "v_n"),
    ({"v_y": (-1, -2)}, DataError, "limits of v_y must be finite numbers"),
    ({"v_y": (1.0, 2.0), "omega": (0.0, 0.0)}, DataError, "no drop within the limits approaches the floor"),
])  # fmt: skip
def test_impossible_limits_are_refused(rivals, limits, error, words):
    impacts, chosen, others = rivals
    with pytest.raises(error, match=words):
        next_experiment(impacts, chosen, others, generator=seeded(0), limits=limits)
    with pytest.raises(DataError, match="at least one rival"):
        next_experiment(impacts, chosen, {}, generator=seeded(0))


def test_the_same_trace_in_a_poorer_form_is_a_rival():
    """A body that is turned a little further for every drop: no form of a drift is the harmonics of its orientation."""
    states = synthetic.load(size=150, seed=4)
    theta = torch.linspace(-math.pi, math.pi, 150, dtype=torch.float64)
    q = torch.cat((states.q[:, :2], theta[:, None]), 1)
    turned = states.replace(q=q, r=contact_point(states.shape, theta))
    around = EffectId("orientation_dependent_restitution", "harmonics")
    among = (around.name, "parameter_drift", "velocity_dependent_restitution")
    softer = find_effect(around.name)(a1=0.0, b1=0.07)
    found = find_rivals(having(measured(turned, softer, 4), around, among=among))[around]
    (drift,) = [one.rival for one in found]
    assert drift.effect == EffectId("parameter_drift", "restitution_curve")
    assert drift.similarity > 0.95
    assert drift.loss_difference > 2 * drift.standard_error


def test_next_tosses_in_space_separate_within_their_limits():
    """Of spins that fall after contact and friction against the spin about the normal."""
    tosses, law = tossed(150, seed=5), laws.find("wang_mason").at(0.2, 0.5)
    models = [
        ContactModel(law, effects={name: find_effect(name)().at(values)})
        for name, values in (("spin_damping", [0.1]), ("torsional_friction", [0.005]))
    ]
    key = Substitution(EffectId("spin_damping", "after"), EffectId("torsional_friction", "dry"))
    limits = {"v_z": (-3.0, -1.0), "w_z": (0.0, 20.0)}
    found = next_experiment(tosses, models[0], {key: models[1]}, generator=seeded(0), limits=limits)
    assert len(found.drops) == len(set(found.drops)) == 6
    for drop in found.drops:
        assert (drop.theta, drop.omega, drop.x, drop.y) == (None,) * 4
        r_x, r_y, _ = tosses.r[[tuple(q) for q in tosses.q[:, 3:].tolist()].index(drop.orientation)].tolist()
        assert drop.v_z + drop.w_x * r_y - drop.w_y * r_x < 0  # what was measured at that orientation approaches
        assert all(low <= getattr(drop, name) <= high for name, (low, high) in limits.items())
    spread = separations_of(tosses, models[0], {key: models[1]}, tosses).mean().item()
    assert sum(drop.differences[0] ** 2 for drop in found.drops) / 6 > 2 * spread
    assert from_json(Experiment, to_json(found)) == found
    assert "ω = (" in phrase("drop", found.drops[0], found)
    with pytest.raises(UnknownNameError, match="theta"):
        next_experiment(tosses, models[0], {key: models[1]}, generator=seeded(0), limits={"theta": (0.0, 1.0)})
