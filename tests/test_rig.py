"""The rig card: a square with round corners and a zero that is off, tracked and balanced elsewhere, without a law."""

import math

import numpy as np
import pytest
import torch

from contactlearn.cli.settings import SourceSettings
from contactlearn.data.audit.corrections import correct
from contactlearn.data.audit.moments import balance
from contactlearn.data.audit.rig import changed, one_point, reshaped, simplest_rig, with_balance
from contactlearn.data.audit.trials import rig_notes
from contactlearn.data.recordings.flights import Air, fit
from contactlearn.data.recordings.track import Track
from contactlearn.data.recordings.wobble import centre_of_mass, wobble
from contactlearn.diagnosis.search.candidates import all_candidates, usable
from contactlearn.effects import EffectId
from contactlearn.inference.identification.joint import named_parameters
from contactlearn.inference.identification.shared import Box
from contactlearn.mechanics.apparatus import Apparatus, Estimate
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.shapes import Ellipse, Polygon, contact_point

SIDE = 0.06
SQUARE = Polygon(((-SIDE / 2, -SIDE / 2), (SIDE / 2, -SIDE / 2), (SIDE / 2, SIDE / 2), (-SIDE / 2, SIDE / 2)))
TRUTH = {"orientation": 0.035, "corner": 0.005, "middle_a": 4e-4, "centre_b": -6e-4, "inertia": -0.35}
GRAVITY, DELAY = Estimate(value=9.81, error=0.01), Estimate(value=0.0, error=1e-4)


def squares(count=200, damping=0.0, noise=0.003):
    """Impacts of the true body, as a rig of which nothing is known states them."""
    rng = torch.Generator().manual_seed(5)
    draw = lambda *size: torch.randn(*size, generator=rng, dtype=torch.float64)  # noqa: E731
    q = torch.cat((draw(count, 2), 2 * torch.pi * torch.rand(count, 1, generator=rng, dtype=torch.float64)), 1)
    v = draw(count, 3) * torch.tensor([0.5, 0.3, 6.0]) - torch.tensor([0.0, 1.8, 0.0])
    full = torch.ones(count, dtype=torch.float64)
    mass, inertia = 0.05 * full, 0.05 * SQUARE.gyration_squared() * full
    stated = Impacts(
        mass=mass,
        inertia=inertia,
        r=contact_point(SQUARE, q[:, 2]),
        q=q,
        v_pre=v,
        v_post=v,
        shape=SQUARE,
        validate=False,
    )
    true = changed(stated, TRUTH)
    P = torch.stack(
        (0.3 * draw(count) * mass, mass * (1.0 + 2.4 * torch.rand(count, generator=rng, dtype=torch.float64))), 1
    )
    moment = true.r[:, 0] * P[:, 1] - true.r[:, 1] * P[:, 0]
    step = torch.cat((P / mass[:, None], (moment / true.inertia)[:, None]), 1)
    after = true.v_pre + step
    after[:, 2] *= 1 - damping
    back = changed(true.replace(v_post=after, shape=None), {name: -TRUTH[name] for name in ("centre_b",)})
    return stated.replace(
        v_pre=v, v_post=back.v_post + noise * draw(count, 3) * torch.tensor([1.0, 1.0, 30.0]), validate=False
    )


def rig(**known):
    return Apparatus(gravity=GRAVITY, delay=DELAY, **known)


KNOWN = {
    name: Estimate(value=TRUTH[name], error=1e-4 if name != "orientation" else 1e-3)
    for name in TRUTH
    if name != "inertia"
}


def test_the_inertia_is_found_and_the_corrected_balance_closes():
    stated = squares()
    card = with_balance(stated, rig(**KNOWN))
    assert abs(card.inertia.value - TRUTH["inertia"]) < 3.5 * card.inertia.error < 0.1
    assert balance(stated).imbalance > 0.1
    corrected = correct(stated.replace(apparatus=card), ["rig"])
    fit = balance(corrected)
    assert abs(fit.a - 1) < 0.02
    assert abs(fit.b - 1) < 0.03
    assert corrected.shape.corner == pytest.approx(card.corner.value)
    assert not corrected.apparatus.differing
    assert {row.name for row in card.differing} == {*TRUTH}
    assert torch.equal(correct(corrected, ["rig"]).r, corrected.r)
    assert {row.name for row in corrected.apparatus.applied} == {*TRUTH}


@pytest.mark.parametrize("cause", ["late", "swing"])
def test_contacts_that_last_and_late_angles_do_not_bias_the_inertia(cause):
    stated = squares()
    spins, change = stated.v_pre + stated.v_post, stated.v_post - stated.v_pre
    lighter = change[:, 1] / (change[:, 1] + stated.r[:, 0] * change[:, 2])  # the contact than the body
    turn = spins[:, 2] / 2 if cause == "late" else lighter.clamp(0.05, 2).sqrt() * change[:, 2]
    theta = stated.q[:, 2] - 4e-4 * turn
    q = torch.cat((stated.q[:, :2], theta[:, None]), 1)
    card = with_balance(stated.replace(q=q, r=contact_point(SQUARE, theta), validate=False), rig(**KNOWN))
    assert abs(card.inertia.value - TRUTH["inertia"]) < 3 * card.inertia.error < 0.1


def test_a_second_corner_that_reaches_the_floor_is_seen():
    """A side that falls flat lands on two corners; one that leans by 20°, or is slow, on one."""
    v = torch.tensor([[0.0, -1.0, 0.0], [0.0, -1.0, 0.0], [0.0, -0.01, 0.0]], dtype=torch.float64)
    theta = torch.tensor([0.02, 0.35, 0.02], dtype=torch.float64)
    assert one_point(SQUARE, theta, v, -v).tolist() == [False, True, True]
    assert one_point(Ellipse((0.03, 0.02)), theta, v, -v).all()


def test_what_others_measured_keeps_its_error_in_the_inertia():
    """Ten times the impacts do not reduce what an error of the corners adds."""
    loose, lasting = KNOWN | {"corner": Estimate(value=TRUTH["corner"], error=2e-3)}, Estimate(value=1e-5, error=1e-6)
    few, many = (with_balance(squares(count), rig(**loose), lasting).inertia.error for count in (200, 2000))
    tight = with_balance(squares(2000), rig(**KNOWN), lasting).inertia.error
    assert 0.8 * few < many
    assert tight < many / 3


def test_a_loss_of_spin_after_contact_is_not_taken_for_an_inertia():
    right = {name: Estimate(value=0.0, error=1e-5) for name in ("corner", "orientation")}
    true = changed(squares(), TRUTH)
    spun = true.replace(v_post=true.v_post * torch.tensor([1.0, 1.0, 0.6]), validate=False)
    assert with_balance(spun, rig(**right)).inertia is None


def test_few_impacts_tell_no_inertia():
    assert with_balance(squares(8), rig(**KNOWN)).inertia is None


def test_a_change_of_nothing_changes_nothing():
    impacts = squares(20)
    for name in ("r", "q", "v_pre", "v_post", "inertia"):
        assert torch.equal(getattr(changed(impacts, {}), name), getattr(impacts, name))


def test_a_sloping_floor_becomes_level():
    """A body on a floor inclined by φ is one on level ground, turned by φ."""
    level = squares(20)
    turn = torch.tensor([[math.cos(0.1), -math.sin(0.1)], [math.sin(0.1), math.cos(0.1)]], dtype=torch.float64)
    tilted = level.replace(
        r=level.r @ turn.T,
        q=torch.cat((level.q[:, :2] @ turn.T, level.q[:, 2:] + 0.1), 1),
        v_pre=torch.cat((level.v_pre[:, :2] @ turn.T, level.v_pre[:, 2:]), 1),
        v_post=torch.cat((level.v_post[:, :2] @ turn.T, level.v_post[:, 2:]), 1),
        validate=False,
    )
    back = changed(tilted.replace(shape=None), {"slope": 0.1})
    for name in ("r", "q", "v_pre", "v_post"):
        assert torch.allclose(getattr(back, name), getattr(level, name), atol=1e-12)


def test_the_centre_of_mass_is_found_from_the_wobble_within_its_error():
    """Sets of flights, a third of which spin fast: in 60 numbers one or two are beyond 2.3 errors by chance."""
    rng, centre, sigma = np.random.default_rng(1), np.array((5e-4, -8e-4)), np.array((3e-5, 3e-5, 1e-3))
    air, scores, found = Air(prior=((0.1, 0.1, 3.0), (1e-3, 1e-3, 1e-3))), [], []
    for _ in range(30):
        found = []
        for k in range(30):
            time, theta_0, spin = np.arange(40) / 250, rng.uniform(-3, 3), rng.uniform(10, 25) / (1 + k % 3)
            theta = theta_0 + spin * time + rng.normal(0, 3) * time**2 / 2
            c, s = np.cos(theta), np.sin(theta)
            (x, y), push = np.array((0.4, 0.3))[:, None] * time, rng.normal(0, 0.1, 2)
            x = x + push[0] * time**2 / 2 - c * centre[0] + s * centre[1]
            y = y + (push[1] - GRAVITY.value) * time**2 / 2 - s * centre[0] - c * centre[1]
            pose = np.stack((x, y, theta), 1) + sigma * rng.standard_normal((40, 3))
            track = Track(name="", time=time, pose=pose)
            found.append(wobble(track, fit(time, pose, np.arange(40), sigma, air), air.prior))
        scores += [(one.value - truth) / one.error for one, truth in zip(centre_of_mass(found), centre, strict=True)]
    assert 0.65 < np.sqrt(np.mean(np.square(scores))) < 1.25  # noise alone is no less
    assert (np.abs(scores) > 2.3).sum() <= 4
    assert centre_of_mass(found[:3]) is None


def test_recordings_have_their_rig_corrected_unless_told_otherwise():
    target = "contactlearn.data.tracks.load"
    assert SourceSettings.from_values({"_target_": target}).corrections == ("rig",)
    assert SourceSettings.from_values({"_target_": target, "correct": []}).corrections == ()
    assert SourceSettings.from_values({"_target_": "contactlearn.data.table.load"}).corrections == ()


def test_what_was_applied_is_said_and_offered_within_its_errors():
    stated = squares().replace(apparatus=rig(**KNOWN))
    note, applied = rig_notes(correct(stated, ["rig"]))
    assert "zero of θ 2.005 ± 0.057°" in applied.sentence
    assert "differ from what is stated" not in note.sentence
    assert "data.correct=[rig]" in rig_notes(stated)[0].sentence
    corrected = correct(stated, ["rig"])
    offered = usable(all_candidates(), corrected)
    for name, error in (("orientation_offset", 1e-3), ("corner_radius", 1e-4)):
        effect = offered[EffectId(name)].prepare(corrected)
        *_, one = named_parameters({name: effect}, Box(), corrected)
        assert (one.low, one.high) == pytest.approx((-3 * error, 3 * error))


def test_a_table_has_the_simplest_rig_that_closes_its_balance_proposed():
    impacts = squares()
    stated = changed(impacts, {name: x for name, x in TRUTH.items() if name not in ("inertia", "orientation")})
    fit = simplest_rig(stated.replace(shape=stated.shape))
    assert {*fit.estimates} == {"inertia", "orientation"}
    for name, one in fit.estimates.items():
        assert abs(one.value - TRUTH[name]) < 4 * one.error
    assert fit.remaining < 0.5 * fit.physical
    assert simplest_rig(changed(impacts, TRUTH)) is None


def test_an_ellipse_of_the_balance_keeps_its_axes():
    """A step of the fit may take more off an axis than it has."""
    flat = reshaped(Ellipse((0.03, 0.02)), {"oblong": -1.0})
    assert flat.semi_axes == (0.015, 0.02)
