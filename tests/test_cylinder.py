"""Cylinders: cans, pucks and cups touch with a point of a rim."""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import torch
from scipy.spatial.transform import Rotation
from test_polyhedron import assert_tosses_are_found, fallen, normal, quaternions
from test_tracks_space import MASS, impacts_in, written

from contactlearn.core.errors import ContactLearnError, DataError
from contactlearn.data import table
from contactlearn.data.recordings.floor import find_floor, off_the_floor
from contactlearn.data.recordings.result import Reason, Rest
from contactlearn.effects import State, find_effect
from contactlearn.inference.identification import joint
from contactlearn.laws import find
from contactlearn.mechanics.bodies import make_shapes, shapes_entries
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import rotation
from contactlearn.mechanics.shapes import Cylinder, Polyhedron, contact_point, make_shape, scaled
from contactlearn.models.contact_model import ContactModel

PUCK, CUP, CAN = Cylinder(0.03, 0.015), Cylinder(0.04, 0.05, "y", -0.012), Cylinder(0.033, 0.06, "x")
EVERY = pytest.mark.parametrize("shape", [PUCK, CUP, CAN], ids=str)


def prism(shape, sides):
    """The polyhedron whose ends have corners on the rims."""
    angle = 2 * math.pi * np.arange(sides) / sides
    k = "xyz".index(shape.axis)
    points = np.zeros((2, sides, 3))
    points[:, :, (k + 1) % 3], points[:, :, (k + 2) % 3] = shape.radius * np.cos(angle), shape.radius * np.sin(angle)
    points[:, :, k] = np.array((1, -1))[:, None] * shape.half_length - shape.centre
    return Polyhedron(tuple(map(tuple, points.reshape(-1, 3).tolist())))


@EVERY
def test_contact_points_are_those_of_a_prism_of_many_sides(shape):
    q, sides = quaternions(500), 360
    found, close = contact_point(shape, q), contact_point(prism(shape, sides), q)
    short = shape.radius * (1 - math.cos(math.pi / sides))
    assert (found[:, 2] <= close[:, 2] + 1e-15).all()
    assert (found[:, 2] >= close[:, 2] - short).all()
    assert (found - close).norm(dim=-1).max() < shape.radius * math.pi / sides


@EVERY
def test_contact_points_are_differentiable_and_finite_on_flat_ends_and_sides(shape):
    assert torch.autograd.gradcheck(lambda d: shape.support(d), normal(20, 3).requires_grad_())
    scale = torch.tensor((1.1, 0.9, 1.2), dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda s: contact_point(shape, quaternions(20), s.unbind()), scale)
    along, first = shape.along, torch.eye(3, dtype=torch.float64)[int(shape.axis == "x")]
    flat = torch.stack((along, -along, 1e-200 * along, first)).requires_grad_()
    points = shape.support(flat)
    (slope,) = torch.autograd.grad(points.sum(), flat)
    assert slope.isfinite().all()
    ends = torch.tensor((1, -1, 1, 1)) * shape.half_length - shape.centre
    torch.testing.assert_close(points, shape.radius * first + ends[:, None] * along)


@EVERY
def test_its_outline_is_its_rims_and_lines_on_its_side(shape):
    outline = shape.outline(61)
    points = outline[~outline[:, 0].isnan()]
    height = points @ shape.along
    across = (points - height[:, None] * shape.along).norm(dim=-1)
    assert len(points) == 2 * 61 + 4 * 2
    assert across.sub(shape.radius).abs().max() < 1e-15
    assert (height + shape.centre).abs().sub(shape.half_length).abs().max() < 1e-15


def test_inertia_is_that_of_a_disc_of_a_rod_and_of_a_prism():
    assert Cylinder(0.02, 1e-9).gyration_squared() * 4 / 0.02**2 == pytest.approx((1, 1, 2), rel=1e-12)
    assert Cylinder(1e-9, 0.3, "y").gyration_squared()[0] * 12 / 0.6**2 == pytest.approx(1, rel=1e-12)
    for shape in (PUCK, CAN):
        assert prism(shape, 360).gyration_squared() == pytest.approx(shape.gyration_squared(), rel=2e-4)
    with pytest.raises(DataError, match=r"middle, and centre=-0\.012 m says otherwise: state .* data\.inertia="):
        CUP.gyration_squared()


def test_spellings_and_files_make_the_same_shape():
    for entries in ({"radius": 0.03, "half_length": 0.015}, {"diameter": 0.06, "length": 0.03, "axis": "z"}):
        assert make_shape({"kind": "cylinder", **entries}) == PUCK
    cup = {"kind": "cylinder", "diameter": 0.08, "height": 0.1, "axis": "y", "centre": -0.012}
    assert make_shape(cup) == CUP
    assert make_shapes(shapes_entries(CUP)) == CUP
    assert scaled(CUP, 2.0) == Cylinder(0.08, 0.1, "y", -0.024)


WRONG = {
    "axis": ({"radius": 1, "half_length": 1, "axis": "w"}, "axis of a cylinder is x, y or z of the body, got 'w'"),
    "two axes": ({"radius": 1, "half_length": 1, "axis": "xy"}, "x, y or z of the body, got 'xy'"),
    "flat": ({"radius": 1, "half_length": 0}, "half_length must be 1 positive"),
    "no length": ({"radius": 1}, "takes radius, half_length, axis, centre; got radius"),
    "two lengths": ({"radius": 1, "half_length": 1, "length": 2}, "got radius, half_length, length"),
    "from the end": ({"radius": 1, "half_length": 1, "centre": 1}, "half_length from the middle, .* got centre=1"),
}


@pytest.mark.parametrize(("entries", "message"), WRONG.values(), ids=WRONG)
def test_impossible_cylinders_are_refused_in_a_line(entries, message):
    with pytest.raises(ContactLearnError, match=message) as refused:
        make_shape({"kind": "cylinder", **entries})
    assert "\n" not in str(refused.value)


def drops(shape, count=60, inertia=None):
    """Impacts of Wang–Mason's law with contact points of the shape."""
    q, v = (
        torch.cat((normal(count, 3), quaternions(count)), 1),
        normal(count, 6, seed=1) * torch.tensor([1] * 3 + [6] * 3),
    )
    v[:, 2] -= 2
    mass, r = torch.full((count,), MASS).double(), contact_point(shape, q[:, 3:])
    inertia = mass[:, None] * (shape.gyration_squared() if inertia is None else torch.tensor(inertia))
    q[:, 2] = -r[:, 2]
    impacts = Impacts(mass, inertia, r, q, v, v, shape=shape, validate=False)
    impacts = impacts[impacts.v_c[:, 2] < -0.1]
    return impacts.replace(v_post=ContactModel(find("wang_mason").at(0.2, 0.6)).predict(impacts).v_post, validate=True)


def test_a_table_takes_contact_points_and_inertia_from_the_shape(tmp_path):
    made = drops(CAN)
    path = table.save(made, tmp_path / "a.csv")
    names = ["rx", "ry", "rz", "inertia_x", "inertia_y", "inertia_z"]
    pd.read_csv(path).drop(columns=names).to_csv(path, index=False)
    found = table.load(path, {"kind": "cylinder", "diameter": 0.066, "length": 0.12, "axis": "x"})
    torch.testing.assert_close(found.r, made.r)
    torch.testing.assert_close(found.inertia, made.inertia)
    mu, eps = joint.fit(found, "wang_mason").values
    assert (mu, eps) == (pytest.approx(0.2, abs=1e-4), pytest.approx(0.6, abs=1e-4))


def test_a_turn_about_its_own_axis_moves_no_contact():
    made = drops(CAN)
    offset = find_effect("orientation_offset")().prepare(made)
    moved = {
        name: (offset.at([0.05 * (one.name == name) for one in offset.parameters]).state(State.of(made)).r - made.r)
        for name in (one.name for one in offset.parameters)
    }
    assert moved["delta_a"].abs().max() < 1e-15
    assert moved["delta"].norm(dim=-1).median() > 1e-4


BARREL = Cylinder(0.05, 0.06, "x")


@pytest.fixture(scope="module")
def tosses(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tosses")
    made, _ = written(folder, 30, 5, solid=BARREL)
    return made, impacts_in(folder, shape=BARREL)


def test_tosses_are_found_with_their_velocities(tosses):
    made, tracked = tosses
    impacts = tracked.impacts
    assert len(impacts) >= 27
    assert set(impacts.object) == {"cylinder"}
    assert_tosses_are_found(made, impacts)


def test_another_axis_is_refused_with_the_right_one(tmp_path):
    written(tmp_path, 8, 3, solid=BARREL)
    with pytest.raises(DataError, match=r"contradict data\.shape: .* with it as axis: x; are its edges"):
        impacts_in(tmp_path, shape=replace(BARREL, axis="z"), sense="as_read")


def laid(shape, lean, *, on_side=False):
    """Quaternion of a body that leans by an angle in rad from its end, or from its side."""
    along = shape.along.numpy()
    beside = np.roll(along, 1)
    down = beside if on_side else along
    turn = Rotation.align_vectors([[0, 0, -1], [0, 1, 0]], [down, np.cross(along, beside)])[0]
    return (Rotation.from_rotvec((0, lean, 0)) * turn).as_quat(scalar_first=True)


@pytest.mark.parametrize(("lean", "on_side"), [(0.0, False), (5e-4, False), (0.0, True), (-5e-4, True)])
def test_impacts_of_a_whole_end_or_side_are_refused(tosses, lean, on_side):
    hits = tosses[1].survey.contacts
    for angle, count in ((lean, 1), (lean + 0.3, 0)):
        q = laid(BARREL, angle, on_side=on_side)
        pose = np.append((0.0, 0.0, tosses[1].floor.height.value - contact_point(BARREL, torch.tensor(q))[2].item()), q)
        contacts = [*hits, replace(hits[0], pose=pose, number=9)]
        kept, refusals = off_the_floor(contacts, BARREL, find_floor(contacts, BARREL))
        assert [one.reason for one in refusals] == [Reason.SECOND_CORNER] * count
        assert len(kept) == len(contacts) - count


def test_rests_on_an_end_or_the_side_show_the_floor(tosses):
    """Bodies that lie on a floor that is 3 mm high, seen with a lean; one that leans clearly is left out."""
    high, rests = 0.003, []
    for on_side, height in ((False, 0.06), (True, 0.05)):
        for lean in (0.0, 0.02, 0.5):
            pose = np.concatenate(((0.0, 0.0, height + high), laid(BARREL, lean, on_side=on_side)))
            rests.append(Rest(recording="a", pose=pose, error=np.full(6, 1e-5)))
    hits = [replace(hit, pose=hit.pose + np.array((0, 0, high, 0, 0, 0, 0))) for hit in tosses[1].survey.contacts]
    floor = find_floor(hits, BARREL, rests)
    assert floor.rests == 4
    assert floor.height.value == pytest.approx(high, abs=1e-4)


@pytest.mark.parametrize(("shape", "on_side"), [(PUCK, False), (CUP, False), (CAN, True)], ids=["puck", "cup", "can"])
def test_it_falls_onto_its_end_or_side_and_stays(shape, on_side):
    end = fallen(shape, laid(shape, 0.1, on_side=on_side), replace(shape, centre=0.0).gyration_squared(), time=0.15)
    cosines, heights = shape.flats(-rotation(end[3:])[2])
    cosine, face = cosines.max(0)
    assert cosine > 1 - 1e-4
    assert end[2].item() == pytest.approx(heights[face].item(), abs=1e-4)
