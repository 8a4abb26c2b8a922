"""The audit in space: mistakes of units, axes and quaternions are found, and what nothing repairs is refused."""

import math
import re
from collections.abc import Callable

import pytest
import torch
from scipy.spatial.transform import Rotation
from spatial import BOX, box_tosses
from torch import Tensor

from contactlearn.core.errors import ContactLearnError
from contactlearn.data.audit.balance import balance_finding
from contactlearn.data.audit.corrections import correct
from contactlearn.data.audit.findings import audit
from contactlearn.data.audit.one_term import one_term_findings
from contactlearn.data.audit.thresholds import AuditThresholds
from contactlearn.mechanics.bodies import contact_points
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import contact_velocity, in_body, in_world, turn_quaternion
from contactlearn.simulation import synthetic

MIRROR = torch.diag(torch.tensor((1.0, -1.0, 1.0), dtype=torch.float64))
CONJUGATE = torch.tensor((1.0, -1.0, -1.0, -1.0), dtype=torch.float64)
HEADING = torch.from_numpy(Rotation.from_rotvec((0.0, 0.0, 0.65)).as_matrix())
EAST = torch.tensor((1.14, 1.0, 1.0, 1.0, 1.0, 1.0), dtype=torch.float64)  # the scale of v_x alone
RAISED = torch.tensor((0.0, 0.0, 0.006), dtype=torch.float64)
UP = torch.tensor(((1.0, 0, 0), (0, 0, 1), (0, -1, 0)), dtype=torch.float64)  # y points up


@pytest.fixture(scope="module")
def tosses() -> Impacts:
    """With noise of 3 cm/s and 1 rad/s."""
    return box_tosses(0.25, 0.6, noise=0.03)


def spun(impacts: Impacts, change) -> Impacts:
    """The same with other spins."""
    parts = {name: getattr(impacts, name) for name in ("v_pre", "v_post")}
    return impacts.replace(**{name: torch.cat((v[:, :3], change(v[:, 3:])), -1) for name, v in parts.items()})


def turned(impacts: Impacts, turn: Tensor) -> Impacts:
    """All columns, spins and quaternions too, as arrows in other axes, left-handed ones if `turn` is a mirror."""
    both = torch.block_diag(turn, turn)
    q = torch.cat((impacts.q[:, :3] @ turn.T, impacts.q[:, 3:4], impacts.q[:, 4:] @ turn.T), -1)
    return impacts.replace(q=q, r=impacts.r @ turn.T, v_pre=impacts.v_pre @ both.T, v_post=impacts.v_post @ both.T)


def y_up_with_body_spins(impacts: Impacts) -> Impacts:
    """An export with y up in the world alone, beside the spins of a gyroscope in the body."""
    both, body = torch.block_diag(UP, torch.eye(3).double()), spun(impacts, lambda w: in_body(w, impacts.q))
    turn = torch.tensor((-math.pi / 2, 0.0, 0.0), dtype=torch.float64)
    q = torch.cat((impacts.q[:, :3] @ UP.T, turn_quaternion(impacts.q[:, 3:], turn)), -1)
    return body.replace(q=q, r=impacts.r @ UP.T, v_pre=body.v_pre @ both.T, v_post=body.v_post @ both.T)


def with_quaternion(impacts: Impacts, q: Tensor) -> Impacts:
    return impacts.replace(q=torch.cat((impacts.q[:, :3], q), -1))


def lengthened(impacts: Impacts, factor: float) -> Impacts:
    """Velocities in another unit of length."""
    by = torch.tensor([factor] * 3 + [1.0] * 3, dtype=torch.float64)
    return impacts.replace(v_pre=by * impacts.v_pre, v_post=by * impacts.v_post)


def after(impacts: Impacts, change: Callable[[Impacts], Impacts]) -> Impacts:
    """A mistake of the velocities after impact alone."""
    return impacts.replace(v_post=change(impacts).v_post)


def rates_of_angles(impacts: Impacts) -> Impacts:
    """Spins as rates of roll, pitch and yaw, by small steps of each angle."""
    angles = torch.from_numpy(Rotation.from_quat(impacts.q[:, [4, 5, 6, 3]]).as_euler("xyz"))
    axes = []
    for step in 1e-6 * torch.eye(3, dtype=torch.float64):
        turn = Rotation.from_euler("xyz", angles + step) * Rotation.from_euler("xyz", angles).inv()
        axes.append(torch.from_numpy(turn.as_rotvec()) / 1e-6)
    return spun(impacts, lambda w: torch.linalg.solve(torch.stack(axes, -1), w))


def of_markers(impacts: Impacts) -> Impacts:
    """Velocities of the origin of a cluster of markers, beside the centre of mass."""
    arm = in_world(torch.tensor((0.012, -0.009, 0.031), dtype=torch.float64).expand(len(impacts), 3), impacts.q)
    moved = {
        name: torch.cat((contact_velocity(arm, v), v[:, 3:]), -1)
        for name in ("v_pre", "v_post")
        for v in (getattr(impacts, name),)
    }
    return impacts.replace(**moved)


def turned_normal(impacts: Impacts) -> Impacts:
    by = torch.tensor((1.0, 1, -1, 1, 1, 1), dtype=torch.float64)
    return impacts.replace(v_pre=by * impacts.v_pre, v_post=by * impacts.v_post)


def in_body_axes(one: Impacts) -> Impacts:
    return spun(one, lambda w: in_body(w, one.q))


MISTAKES = {
    "none": (lambda one: one, set()),
    "scalar last": (lambda one: with_quaternion(one, one.q[:, 3:].roll(-1, -1)), {"scalar_last"}),
    "world to body": (lambda one: with_quaternion(one, one.q[:, 3:] * CONJUGATE), {"inverse_quaternion"}),
    "body axes": (in_body_axes, {"spin_in_body_axes"}),
    "left-handed spins": (lambda one: spun(one, lambda w: -w), {"mirrored_spin"}),
    "one spin": (lambda one: spun(one, lambda w: w * torch.tensor((1.0, -1.0, 1.0))), {"mirrored_wy"}),
    "left-handed axes": (lambda one: turned(one, MIRROR), {"mirrored_spin", "inverse_quaternion"}),
    "y up": (lambda one: turned(one, UP), {"y_up_in_body"}),
    "y up, body axes": (y_up_with_body_spins, {"y_up", "spin_in_body_axes"}),
    "y up in the spin": (lambda one: spun(one, lambda w: w @ UP.T), {"y_up_in_spin"}),
    "y up after": (lambda one: after(one, lambda x: spun(x, lambda w: w @ UP.T)), {"y_up_in_spin_post"}),
    "body axes after": (lambda one: after(one, in_body_axes), {"spin_in_body_axes_post"}),
    "rates of angles": (rates_of_angles, {"spin_of_angles"}),
    "markers": (of_markers, {"velocity_of_point"}),
    "heading of a compass": (lambda one: spun(one, lambda w: w @ HEADING.T), {"turned_spin"}),
    "v_z": (lambda one: turned_normal(one), {"mirrored_vz"}),
    "degrees": (lambda one: spun(one, lambda w: w * 180 / math.pi), {"degrees_omega"}),
    "millimetres": (lambda one: lengthened(one, 1e3), {"millimetres_velocity"}),
    "before and after": (lambda one: one.replace(v_pre=one.v_post, v_post=one.v_pre), {"swapped_pre_post"}),
    "contact point": (lambda one: one.replace(r=in_body(one.r, one.q)), {"contact_point_in_body_axes"}),
    "moments": (lambda one: one.replace(inertia=one.inertia[:, [1, 0, 2]]), {"inertia_yxz"}),
}  # fmt: skip


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_found_and_undone(tosses, name):
    change, names = MISTAKES[name]
    wrong = change(tosses)
    found = audit(wrong)
    corrections = [one.correction for one in found if one.correction]
    assert set(corrections) == names
    assert not any(one.fatal for one in found)
    left = [one.name for one in audit(correct(wrong, corrections))]
    assert left == ["consistent"]


@pytest.mark.parametrize("name", ["scalar last", "moments"])
def test_moments_tell_a_mistake_without_a_shape(tosses, name):
    change, names = MISTAKES[name]
    found = audit(change(tosses).replace(shape=None))
    assert {one.correction for one in found if one.correction} == names


@pytest.mark.parametrize("name", ["scalar last", "left-handed axes", "y up"])
def test_computed_contact_points_follow_the_correction(tosses, name):
    change, names = MISTAKES[name]
    wrong = change(tosses)
    wrong = wrong.replace(r=contact_points(BOX, None, wrong.q[:, 3:]).float().double())  # as a file has them
    corrections = [one.correction for one in audit(wrong) if one.correction]
    assert set(corrections) == names
    right = correct(wrong, corrections)
    torch.testing.assert_close(right.r, contact_points(BOX, None, right.q[:, 3:]), rtol=0, atol=1e-12)


def test_what_no_hypothesis_repairs_is_refused(tosses):
    (fatal, *_) = audit(tosses.replace(v_post=tosses.v_post.roll(7, 0)))
    assert fatal.fatal
    assert "no impact of a rigid body can have produced these data" in fatal.sentence


def test_rows_of_other_trials_after_impact_are_said_to_be_that(tosses):
    (fatal, *_) = audit(tosses.replace(v_post=tosses.v_post.roll(1, 0)))
    assert fatal.fatal
    assert "velocities after impact stand one row too low" in fatal.sentence


def test_spins_that_end_at_the_range_of_a_gyroscope_are_refused(tosses):
    def limited(w):
        return in_world(in_body(w, tosses.q).clamp(-4.36, 4.36), tosses.q)

    assert not [one.name for one in audit(tosses) if "gyroscope" in one.name]
    noise = 0.01 * torch.randn(len(tosses), 3, generator=torch.Generator().manual_seed(0)).double()
    (fatal, *_) = audit(spun(tosses, lambda w: limited(w) + noise).replace(shape=None))
    assert fatal.name == "saturated_gyroscope"
    assert "end at ±4.36 rad/s (250 °/s)" in fatal.sentence


def test_rows_that_belong_to_others_from_one_on_are_found():
    tosses = box_tosses(0.25, 0.6, noise=0.003)
    spins = tosses.v_post[:, 3:].clone()
    spins[120:-1] = spins[121:].clone()
    (found, *_) = audit(tosses.replace(v_post=torch.cat((tosses.v_post[:, :3], spins), -1)))
    assert (found.name, found.mistake) == ("two_kinds", True)
    assert "they are in rows 121 to 199; do all columns belong to the same trial there?" in found.sentence


def test_readings_that_were_held_are_found():
    tosses = box_tosses(0.25, 0.6, noise=0.003)
    spins = tosses.v_pre[:, 3:].clone()
    for row in range(3, 200, 3):
        spins[row] = spins[row - 1]
    (found, *_) = audit(tosses.replace(v_pre=torch.cat((tosses.v_pre[:, :3], spins), -1)))
    assert (found.name, found.mistake) == ("two_kinds", True)
    assert "repeat the spin before impact of the row before, as readings that were held" in found.sentence
    assert not [one.name for one in audit(tosses) if one.name == "two_kinds"]


def test_a_balance_that_explains_little_is_said_to_be_that(tosses):
    noise = 30.0 * torch.randn(len(tosses), 3, generator=torch.Generator().manual_seed(0)).double()
    noisy = after(tosses, lambda one: spun(one, lambda w: w + noise))
    note = balance_finding(noisy, 1, AuditThresholds(), explained=True)
    assert "of the change of the spin: the rest is noise of the spins" in note.sentence
    assert "the moment balance deviates by " in balance_finding(tosses, 1, AuditThresholds(), explained=True).sentence


def test_corrections_of_space_are_refused_in_a_plane():
    with pytest.raises(ContactLearnError, match="correction scalar_last exists for bodies that move in space alone"):
        correct(synthetic.load(size=10), ["scalar_last"])


def test_an_approach_speed_that_hardly_varies_is_said_to_show_no_dependence(tosses):
    still = tosses.v_c.clone()
    slow = tosses.v_pre.clone()
    slow[:, 2] += -2.0 - still[:, 2]  # the contact point approaches at 2 m/s in all trials
    slow[::2, 2] -= 0.04
    (note,) = [one for one in audit(tosses.replace(v_pre=slow, validate=False)) if one.name == "narrow_speed"]
    assert "the approach speed hardly varies, 2.02 ± 0.02 m/s" in note.sentence
    assert not [one for one in audit(tosses) if one.name == "narrow_speed"]


def turned_principal_axes(tosses: Impacts) -> Impacts:
    """A body whose stated axes are 25° from its principal ones, with the diagonal of the inertia matrix alone."""
    turn = Rotation.from_rotvec((0.0, 0.0, math.radians(25)))
    R = torch.from_numpy(turn.as_matrix())
    q = torch.from_numpy((Rotation.from_quat(tosses.q[:, [4, 5, 6, 3]]) * turn).as_quat())[:, [3, 0, 1, 2]]
    matrices = R.T @ torch.diag_embed(tosses.inertia) @ R
    return with_quaternion(tosses, q).replace(inertia=matrices.diagonal(dim1=-2, dim2=-1), shape=None)


def with_a_heading(tosses: Impacts, first: float, last: float) -> Impacts:
    """Orientations and spins that are turned about the vertical by a growing angle in degrees."""
    angle = torch.linspace(math.radians(first), math.radians(last), len(tosses), dtype=torch.float64)
    turn = Rotation.from_rotvec(torch.nn.functional.pad(angle[:, None], (2, 0)))
    q = torch.from_numpy((turn * Rotation.from_quat(tosses.q[:, [4, 5, 6, 3]])).as_quat())[:, [3, 0, 1, 2]]
    R = torch.from_numpy(turn.as_matrix())
    return spun(with_quaternion(tosses, q), lambda w: (R @ w[..., None])[..., 0]).replace(shape=None)


def with_masses_exchanged(tosses: Impacts) -> Impacts:
    first = torch.arange(len(tosses)) % 2 == 0
    factor = torch.where(first, 0.85, 1 / 0.85).double()
    names = tuple("glass" if one else "steel" for one in first.tolist())
    return tosses.replace(mass=factor * tosses.mass, object=names, shape=None)


@pytest.mark.parametrize(
    ("change", "name", "said"),
    [
        (lambda one: one.replace(v_pre=one.v_pre * EAST, v_post=one.v_post * EAST), "scale_of_axis", "v_x is 1.1"),
        (lambda one: one.replace(r=one.r + RAISED, shape=None), "contact_points_moved", r", 5\.9+\) mm along x, y, z"),
        (turned_principal_axes, "products_of_inertia", "not its principal axes"),
        (lambda one: with_a_heading(one, 0, 26), "heading_drifts", "by 2[5-7](.[0-9]+)?° from the first"),
        (with_masses_exchanged, "bodies_exchanged", "for 'glass'"),
    ],
    ids=["scale", "floor", "products", "drift", "masses"],
)
def test_the_one_wrong_term_that_closes_the_balance_is_named(change, name, said):
    tosses = box_tosses(0.25, 0.6, noise=0.003)
    found = {one.name: one.sentence for one in audit(change(tosses)) if one.mistake}
    assert name in found
    assert re.search(said, found[name])
    assert not one_term_findings(tosses)


def test_a_heading_of_another_instrument_is_one_turn():
    (found,) = one_term_findings(with_a_heading(box_tosses(0.25, 0.6, noise=0.003), 14, 14))
    assert found.name == "heading_turned"
    assert re.search(r"by 1[34](\.\d+)?° in all trials", found.sentence)


def test_spins_of_a_gyroscope_that_is_mounted_askew_are_said_to_be_turned():
    tosses = box_tosses(0.25, 0.6, noise=0.003)
    R = torch.from_numpy(Rotation.from_rotvec((math.radians(14), 0.0, 0.0)).as_matrix())
    (found,) = one_term_findings(spun(tosses, lambda w: in_world(in_body(w, tosses.q) @ R.T, tosses.q)))
    assert found.name == "gyroscope_turned"
    assert "by 14° about (−1, " in found.sentence


def test_two_components_of_the_spin_that_are_exchanged_are_named():
    tosses = box_tosses(0.25, 0.6, noise=0.003)
    exchanged = after(tosses, lambda one: spun(one, lambda w: w[:, [1, 0, 2]]))
    (found,) = one_term_findings(exchanged)
    assert found.sentence.startswith("ω_x and ω_y after impact are exchanged")


def test_a_scale_of_all_lengths_is_seen_in_heights_and_moments():
    tosses = box_tosses(0.25, 0.6, noise=0.003)
    upright = torch.cat((tosses.q[:, :2], -contact_points(BOX, None, tosses.q[:, 3:])[:, 2:], tosses.q[:, 3:]), -1)
    standing = tosses.replace(q=upright)
    assert not one_term_findings(standing)
    longer = lengthened(standing, 1.08)
    scaled = longer.replace(q=torch.cat((1.08 * upright[:, :3], upright[:, 3:]), -1))
    (found,) = one_term_findings(scaled)
    assert found.sentence.startswith("lengths are 1.08 times what they should be")
    assert [one.name for one in one_term_findings(longer)] != ["scale_of_lengths"]


def test_physics_is_no_wrong_term(tosses):
    spins = torch.tensor([1.0] * 3 + [0.8] * 3, dtype=torch.float64)
    assert not one_term_findings(tosses.replace(v_post=tosses.v_post * spins))
    assert not one_term_findings(tosses.replace(inertia=tosses.inertia * torch.tensor([1.3, 1.0, 1.0]).double()))


def test_contact_points_in_whole_centimetres_are_said_to_be_that(tosses):
    (note,) = [one for one in audit(tosses.replace(r=tosses.r.round(decimals=2), shape=None)) if one.name == "rounded"]
    assert "the contact point to 0.01 m, an error of " in note.sentence
    assert not [one for one in audit(tosses) if one.name == "rounded"]


def test_spins_that_are_zero_in_all_trials_are_said_in_space(tosses):
    still = tosses.v_pre * torch.tensor([1.0] * 3 + [0.0] * 3, dtype=torch.float64)
    (note,) = [one for one in audit(tosses.replace(v_pre=still, validate=False)) if one.name == "constant_columns"]
    assert "ω_x before impact = 0" in note.sentence
    assert note.sentence.endswith("cannot show whether anything depends on the spin")
