"""Polyhedra: a cuboid by its corners is the cuboid, and irregular ones by routes of their own."""

import itertools
import re
import struct
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation
from test_roll_out import energy
from test_tracks_space import BOX, MASS, impacts_in, written

from contactlearn.core.errors import ContactLearnError, DataError
from contactlearn.data import table
from contactlearn.data.recordings.floor import find_floor
from contactlearn.data.recordings.result import Rest
from contactlearn.effects import State, find_effect
from contactlearn.inference.identification import joint
from contactlearn.laws import find
from contactlearn.mechanics.apparatus import CHANGES
from contactlearn.mechanics.bodies import make_shapes, shapes_entries
from contactlearn.mechanics.body_state import BodyState
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import rotation
from contactlearn.mechanics.shapes import Cuboid, Polyhedron, contact_point, make_shape, polyhedron
from contactlearn.models.contact_model import ContactModel
from contactlearn.models.roll_out import Until

EXACT = {"rtol": 1e-12, "atol": 1e-12}
LAW = find("wang_mason").at(0.2, 0.6)
BRICK = Cuboid((0.03, 0.02, 0.025), corner=2e-3)


def normal(*shape, seed=0):
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def quaternions(count):
    q = normal(count, 4)
    return q / q.norm(dim=-1, keepdim=True)


def by_corners(box, corner=None):
    """The same body by its eight corners in another order, with points inside."""
    corners = [*itertools.product(*((-x, x) for x in box.half)), (0.0, 0.001, 0.002), (box.half[0], 0.0, 0.0)]
    return Polyhedron(tuple(corners), box.corner if corner is None else corner)


def mended(points):
    """The polyhedron of points about its mass centre and principal axes, as the messages say."""
    spec = {"kind": "polyhedron", "vertices": points}
    for name in ("centre", "turn"):
        with pytest.raises(DataError) as refused:
            make_shape(spec).gyration_squared()
        assert "\n" not in str(refused.value)
        (numbers,) = re.findall(rf"data\.shape\.{name}=\[(.*?)\]", str(refused.value))
        spec[name] = [float(x) for x in numbers.split(", ")]
    return make_shape(spec)


TETRAHEDRON = mended([[0.06, 0.0, 0.01], [-0.01, 0.07, 0.0], [0.0, 0.0, 0.08], [-0.04, -0.03, -0.02]])
ROCK = mended((0.04 * normal(14, 3, seed=3) + 0.2).tolist())
BODIES = {"tetrahedron": TETRAHEDRON, "rock": ROCK}
EVERY = pytest.mark.parametrize("shape", BODIES.values(), ids=BODIES)


@pytest.mark.parametrize("box", [BRICK, replace(BRICK, corner=0.0)], ids=["round", "sharp"])
def test_a_cuboid_by_its_corners_is_the_cuboid(box):
    same, q = by_corners(box), quaternions(200)
    assert len(same.vertices) == 8
    torch.testing.assert_close(contact_point(same, q), contact_point(box, q), **EXACT)
    torch.testing.assert_close(same.gyration_squared(), box.gyration_squared(), **EXACT)
    squares = torch.tensor(box.half, dtype=torch.float64).square()
    torch.testing.assert_close(box.gyration_squared(), (squares.sum() - squares) / 3, **EXACT)
    assert same.largest_corner() == pytest.approx(min(box.half), rel=1e-12)
    every = {tuple(p) for p in box.outline().nan_to_num(9).mul(1e9).round().tolist()}
    assert every == {tuple(p) for p in same.outline().nan_to_num(9).mul(1e9).round().tolist()}


@pytest.mark.nightly
def test_its_effects_and_roll_outs_are_those_of_the_cuboid():
    count = 40
    q, v = torch.cat((normal(count, 3), quaternions(count)), 1), normal(count, 6, seed=1)
    mass = torch.full((count,), 0.1, dtype=torch.float64)
    outcomes, paths = [], []
    for shape in (BRICK, by_corners(BRICK)):
        inertia, r = mass[:, None] * shape.gyration_squared(), contact_point(shape, q[:, 3:])
        impacts = Impacts(mass, inertia, r, q, v, v, shape=shape, validate=False)
        effects = {
            name: find_effect(name)().prepare(impacts)
            for name in ("corner_radius", "shape_error", "orientation_offset")
        }
        effects = {name: one.at([0.003 * (k + 1) for k in range(len(one.parameters))]) for name, one in effects.items()}
        impacts = impacts[impacts.v_c[:, 2] < -0.1]
        outcomes.append(ContactModel(LAW, effects=effects).predict(impacts).v_post)
        start = BodyState(
            pose=torch.cat((q[:, :2], 0.2 + q[:, 2:3].abs(), q[:, 3:]), 1),
            velocity=v,
            mass=mass,
            inertia=inertia,
            shape=shape,
        )
        paths.append(ContactModel(LAW).roll_out(start, until=Until(bounces=3)))
    torch.testing.assert_close(*outcomes, **EXACT)
    for name in ("times", "poses", "after"):
        one, other = (getattr(path, name) for path in paths)
        torch.testing.assert_close(one, other, rtol=1e-9, atol=1e-9, equal_nan=True)  # bounces amplify rounding


@pytest.mark.nightly
def test_its_impacts_and_rig_card_are_those_of_the_cuboid(tmp_path):
    written(tmp_path, 30, 8, centre=(0.003, -0.002, 0.004), corner=0.004)
    one, other = (impacts_in(tmp_path, shape=shape, sense="as_read") for shape in (BOX, by_corners(BOX)))
    assert len(one.impacts) > 24
    assert [(x.recording, x.reason) for x in one.survey.refusals] == [
        (x.recording, x.reason) for x in other.survey.refusals
    ]
    for name in ("q", "r", "v_pre", "v_post", "v_pre_cov", "inertia"):
        torch.testing.assert_close(getattr(one.impacts, name), getattr(other.impacts, name), **EXACT)
    cards = [found.impacts.apparatus for found in (one, other)]
    assert cards[0].corner.value > 3 * cards[0].corner.error
    for name in CHANGES:
        a, b = (getattr(card, name) for card in cards)
        assert (a is None) == (b is None)
        if a is not None:
            assert (a.value, a.error) == pytest.approx((b.value, b.error), rel=1e-9, abs=1e-12)


@EVERY
def test_contact_points_and_rounding_are_those_of_linear_programmes(shape):
    """The lowest point in the half-spaces of the faces, and of these moved inwards by the radius of a ball."""
    q, hull, vertices = quaternions(20), shape.hull, np.array(shape.vertices)
    assert (vertices @ hull.normals.numpy().T - hull.heights.numpy()).max() < 1e-12
    assert TETRAHEDRON.largest_corner() > 0.01
    assert ROCK.largest_corner() == 0
    for radius in (0.0, 0.005) if shape is TETRAHEDRON else (0.0,):
        found = contact_point(replace(shape, corner=radius), q)
        for R, r in zip(rotation(q).numpy(), found.numpy(), strict=True):
            inner = linprog(R[2], hull.normals.numpy(), hull.heights.numpy() - radius, bounds=(None, None)).x
            assert r == pytest.approx(R @ inner - (0, 0, radius), abs=1e-9)


def test_rounding_by_the_effect_is_that_of_the_shape():
    q, mass = torch.cat((normal(50, 3), quaternions(50)), 1), torch.full((50,), 0.1, dtype=torch.float64)
    inertia, v = mass[:, None] * TETRAHEDRON.gyration_squared(), normal(50, 6)
    sharp = Impacts(mass, inertia, contact_point(TETRAHEDRON, q[:, 3:]), q, v, v, shape=TETRAHEDRON, validate=False)
    rounded = find_effect("corner_radius")(0.005).state(State.of(sharp)).r
    torch.testing.assert_close(rounded, contact_point(replace(TETRAHEDRON, corner=0.005), q[:, 3:]), **EXACT)


def test_inertia_of_a_tetrahedron_is_that_of_its_corners():
    """The covariance of a uniform tetrahedron is Σ v vᵀ / 20 about its centroid, the mean of the corners."""
    corners = torch.tensor(TETRAHEDRON.vertices, dtype=torch.float64)
    second = corners.T @ corners / 20
    assert corners.mean(0).abs().max() < 1e-10
    assert (second - torch.diag(second.diagonal())).abs().max() < 1e-10
    torch.testing.assert_close(TETRAHEDRON.gyration_squared(), second.trace() - second.diagonal(), **EXACT)


@EVERY
def test_inertia_is_that_of_mujoco(shape):
    mujoco = pytest.importorskip("mujoco")
    points = " ".join(f"{x:.9g}" for one in shape.vertices for x in one)
    xml = f"""<mujoco><asset><mesh name="it" inertia="exact" vertex="{points}"/></asset>
        <worldbody><body><freejoint/><geom type="mesh" mesh="it" density="1000"/></body></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    found = np.sort(model.body_inertia[1] / model.body_mass[1])
    assert np.sort(shape.gyration_squared().numpy()) == pytest.approx(found, rel=1e-5)  # single precision
    assert model.body_ipos[1] == pytest.approx((0, 0, 0), abs=1e-7)


@pytest.fixture(scope="module")
def tosses(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tosses")
    made, _ = written(folder, 30, 5, solid=TETRAHEDRON)
    return made, impacts_in(folder, shape=TETRAHEDRON, sense="as_read")


def assert_tosses_are_found(made, impacts):
    """Their velocities within their errors, and the law of their impacts."""
    rows = [int(name) for name in impacts.recording]
    for side, truth in (("pre", 1), ("post", 2)):
        error = getattr(impacts, f"v_{side}") - torch.tensor(np.array([made[row][truth] for row in rows]))
        deviation = getattr(impacts, f"v_{side}_cov").diagonal(dim1=-2, dim2=-1).sqrt()
        assert 0.9 < (error.abs() < 1.96 * deviation).double().mean() < 0.99
    mu, eps = joint.fit(impacts, "wang_mason").values
    assert abs(mu - 0.18) < 0.02
    assert abs(eps - 0.5) < 0.03


def test_tosses_of_a_tetrahedron_are_found(tosses):
    made, impacts = tosses[0], tosses[1].impacts
    assert len(impacts) >= 29
    assert set(impacts.object) == {"polyhedron"}
    assert_tosses_are_found(made, impacts)


def laid(shape, face):
    """The turn by which a face is below."""
    return Rotation.align_vectors([[0, 0, -1]], [shape.hull.normals[face].numpy()])[0]


def fallen(shape, q, gyration_squared, time):
    """Pose in the end of a body that falls from 2 mm above the floor without a rebound."""
    body = {"mass": 0.05, "inertia": tuple((0.05 * gyration_squared).tolist())}
    pose = torch.tensor((0.0, 0.0, 0.0, *q), dtype=torch.float64)
    pose[2] = 0.002 - contact_point(shape, pose[3:])[2]
    state = BodyState(pose=pose, velocity=torch.zeros(6), **body)
    model = ContactModel(find("anitescu_potra_poisson").at(0.3, 0.0))
    found = model.roll_out(state, shape, until=Until(bounces=300, time=time))
    assert energy(body, found.flights.pose, found.flights.velocity).diff().max() < 1e-12
    return found.at(found.end[None])[0]


@EVERY
def test_it_falls_onto_a_face_and_stays(shape):
    """A body that leans by 0.2 rad."""
    widest = int(shape.hull.heights.argmin())
    q = (Rotation.from_rotvec((0.2, 0, 0)) * laid(shape, widest)).as_quat(scalar_first=True)
    end = fallen(shape, q, shape.gyration_squared(), time=0.2)
    down, face = (-rotation(end[3:])[2] @ shape.hull.normals.mT).max(0)
    assert face == widest
    assert down > 1 - 1e-5
    assert end[2].item() == pytest.approx(shape.hull.heights[face].item(), abs=1e-4)


def test_rests_on_faces_show_the_floor(tosses):
    """Bodies that lie on a face of a floor that is 3 mm high; one that leans is left out."""
    high, rests = 0.003, []
    for face, height in enumerate(TETRAHEDRON.hull.heights.tolist()):
        for lean in (0.0, 0.5) if face == 0 else (0.0,):
            turn = Rotation.from_rotvec((lean, 0, 0)) * laid(TETRAHEDRON, face)
            pose = np.concatenate(((0.0, 0.0, height + high), turn.as_quat(scalar_first=True)))
            rests.append(Rest(recording="a", pose=pose, error=np.full(6, 1e-5)))
    hits = [replace(hit, pose=hit.pose + np.array((0, 0, high, 0, 0, 0, 0))) for hit in tosses[1].survey.contacts]
    floor = find_floor(hits, TETRAHEDRON, rests)
    assert floor.rests == 4
    assert floor.height.value == pytest.approx(high, abs=2e-4)


def binary(triangles):
    rows = b"".join(struct.pack("<12fH", 0, 0, 0, *one.flatten().tolist(), 0) for one in triangles)
    return b"solid of a body".ljust(80) + struct.pack("<I", len(triangles)) + rows


@pytest.mark.parametrize("kind", ["obj", "text.stl", "binary.STL"])
def test_meshes_are_read(kind, tmp_path):
    points = 1000 * torch.tensor(ROCK.vertices, dtype=torch.float64) + 40
    triangles = points[ROCK.hull.triangles]
    lines = {
        "obj": ["# mm", *(f"v {x!r} {y!r} {z!r} 1.0" for x, y, z in points.tolist()), "vn 0 0 1", "f 1 2 3"],
        "text.stl": ["solid", *(f" vertex {x!r} {y!r} {z!r}" for x, y, z in triangles.reshape(-1, 3).tolist())],
    }
    path = tmp_path / f"rock.{kind}"
    path.write_bytes("\n".join(lines[kind]).encode() if kind in lines else binary(triangles.float()))
    found = make_shape({"kind": "polyhedron", "file": str(path), "scale": 1e-3, "centre": [0.04] * 3})
    accuracy = 1e-15 if kind in lines else 1e-8
    expected = np.array(sorted(ROCK.vertices))
    assert np.array(sorted(found.vertices)) == pytest.approx(expected, abs=max(accuracy, 1e-12))
    assert make_shapes(shapes_entries(found)) == found


WRONG = {
    "three points": ({"vertices": [[0, 0, 1]] * 3}, "needs at least 4 vertices, got 3"),
    "in a plane": ({"vertices": [[1, 0, 0], [0, 1, 0], [0, 0, 0], [1, 1, 0]]}, "must not be all in a plane"),
    "in the plane": ({"vertices": [[1, 0], [0, 1]]}, r"three finite numbers, \[x, y, z\] in metres, got \(1, 0\)"),
    "not finite": ({"vertices": [[1, 0, float("nan")]]}, "three finite numbers"),
    "outside": (
        {"vertices": [[1, 1, 1], [2, 1, 1], [1, 2, 1], [1, 1, 2]]},
        r"origin, inside; of uniform density it is at \(1\.25, 1\.25, 1\.25\) m.* data\.shape\.centre=\[1\.25, ",
    ),
    "no file": ({"file": "nowhere.obj"}, r"mesh nowhere\.obj cannot be read: No such file"),
    "another file": ({"file": "body.step"}, r"is an \.obj or \.stl file, got body\.step"),
    "nothing": ({}, "one of them"),
    "both": ({"vertices": [[1, 0, 0]], "file": "a.obj"}, "one of them"),
    "scale": ({"vertices": BRICK.corners().tolist(), "scale": 0}, "scale"),
    "turn": ({"vertices": BRICK.corners().tolist(), "turn": [1, 0]}, r"\[w, x, y, z\] of length 1, got \(1, 0\)"),
    "long turn": ({"vertices": BRICK.corners().tolist(), "turn": [1, 1, 0, 0]}, r"of length 1, got \(1, 1, 0, 0\)"),
    "too round": ({"vertices": BRICK.corners().tolist(), "corner": 0.03}, r"at most 0\.02 m, got corner=0\.03"),
    "never round": ({"vertices": ROCK.vertices, "corner": 1e-4}, "touch no common sphere"),
    "misspelt": ({"vertexes": []}, "takes vertices, corner, file, scale, centre, turn; got vertexes"),
    "many": ({"vertices": torch.nn.functional.normalize(normal(1100, 3)).tolist()}, "at most 1000 corners, got 1100"),
}


@pytest.mark.parametrize(("entries", "message"), WRONG.values(), ids=WRONG)
def test_impossible_polyhedra_are_refused_in_a_line(entries, message):
    with pytest.raises(ContactLearnError, match=message) as refused:
        make_shape({"kind": "polyhedron", **entries})
    assert "\n" not in str(refused.value)


def test_broken_meshes_are_refused_with_their_line(tmp_path):
    path = tmp_path / "a.obj"
    for text, message in (("v 1 2 3\nv 1 2\n", "line 2: a vertex is three numbers, got 'v 1 2'"), ("", "no vertices")):
        path.write_text(text)
        with pytest.raises(DataError, match=message):
            polyhedron(file=str(path))


def test_a_table_takes_contact_points_and_inertia_from_a_mesh(tmp_path):
    mesh = tmp_path / "body.obj"
    mesh.write_text("\n".join(f"v {x!r} {y!r} {z!r}" for x, y, z in TETRAHEDRON.vertices))
    q, mass, v = torch.cat((normal(20, 3), quaternions(20)), 1), torch.full((20,), MASS).double(), normal(20, 6)
    v[:, 2] -= 5
    r, inertia = contact_point(TETRAHEDRON, q[:, 3:]), mass[:, None] * TETRAHEDRON.gyration_squared()
    path = table.save(Impacts(mass, inertia, r, q, v, -v, validate=False), tmp_path / "a.parquet")
    import pandas as pd

    names = ["rx", "ry", "rz", "inertia_x", "inertia_y", "inertia_z"]
    pd.read_parquet(path).drop(columns=names).to_parquet(path)
    found = table.load(path, {"kind": "polyhedron", "file": str(mesh)})
    torch.testing.assert_close(found.r, r, **EXACT)
    torch.testing.assert_close(found.inertia, inertia, **EXACT)
    assert found.shape == TETRAHEDRON
