"""Bodies whose shape is known by their markers alone: contact points, centre of mass, errors, and what cannot work."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import torch
from scipy.spatial.transform import Rotation

from contactlearn import laws
from contactlearn.core.errors import DataError
from contactlearn.data import tracks
from contactlearn.data.recordings.frame import Frame
from contactlearn.data.recordings.markers import places_on_corners
from contactlearn.data.recordings.poses import turn
from contactlearn.data.recordings.track import Recording
from contactlearn.mechanics.shapes import Cuboid, Polygon, contact_point
from contactlearn.models.contact_model import ContactModel
from contactlearn.report.text.tracks import tracks_facts
from contactlearn.simulation.camera import AXES, Camera, record
from contactlearn.simulation.recordings import Body, throw

NOISE, MASS = 5e-5, 0.05  # m, kg
KITE = np.array(((0.03, 0.02), (-0.025, 0.028), (-0.035, -0.018), (0.012, -0.026)))  # m
INSIDE = np.array((0.004, 0.003))  # of the hull
SETTINGS = {"unit": "m", "columns": {"markers": [[f"x{k}", f"y{k}"] for k in range(5)]}}
CLEAN = Camera(frames=220, noise=0.0, angle_noise=0.0)


def centroid(corners):
    q = np.roll(corners, -1, 0)
    share = corners[:, 0] * q[:, 1] - corners[:, 1] * q[:, 0]
    return share @ (corners + q) / (3 * share.sum())


def write(folder, size=10, centre=None, dimensions=2, seed=4):
    """Markers of thrown kites on their corners, and one inside; the truth about every contact, and the body."""
    places = np.vstack((KITE, INSIDE)) - (centroid(KITE) if centre is None else centre)
    shape = Polygon(tuple(map(tuple, places[:4])))
    model = ContactModel(laws.find("wang_mason").at(0.12, 0.55))
    body = Body(shape=shape, mass=MASS, inertia=MASS * 4e-4, model=model)
    recordings, truth = record(throw(body, size, torch.Generator().manual_seed(seed)), CLEAN, seed)
    rng = np.random.default_rng(seed)
    for recording in recordings:
        c, s = np.cos(recording.angle), np.sin(recording.angle)
        turned = np.stack((np.stack((c, -s), -1), np.stack((s, c), -1)), -2)
        markers = recording.position[:, None] + np.einsum("tij,mj->tmi", turned, places)
        if dimensions == 3:
            away = np.broadcast_to(np.array((0.01, -0.01, 0.012, 0.004, 0.0))[:, None], (*markers.shape[:2], 1))
            markers = np.concatenate((markers, away), 2) @ np.asarray(AXES["z_up"]).T
        markers = markers + NOISE * rng.standard_normal(markers.shape)
        columns = {f"{axis}{k}": markers[:, k, i] for k in range(5) for i, axis in enumerate("xyz"[:dimensions])}
        pd.DataFrame({"time": recording.time, **columns}).to_csv(folder / f"{recording.name}.csv", index=False)
    return truth, shape


def paired(found, truth):
    """Rows of the true contacts that were found."""
    rows = []
    for contact in found.survey.contacts:
        mine = np.flatnonzero(truth.recording == int(contact.recording) - 1)
        rows.append(mine[np.abs(truth.time[mine] - contact.time).argmin()])
    return np.array(rows)


def found_in(path, **settings):
    body = {name: settings.pop(name) for name in ("centre", "inertia") if name in settings}
    return tracks.find_impacts(path, mass=MASS, **body, options=tracks.track_options(**(SETTINGS | settings)))


@pytest.fixture(scope="module")
def plane(tmp_path_factory):
    path = tmp_path_factory.mktemp("markers")
    truth, shape = write(path)
    return found_in(path, inertia=MASS * 4e-4), truth, shape


def test_contact_points_and_velocities_are_those_of_the_true_body_within_their_errors(plane):
    found, truth, shape = plane
    rows = paired(found, truth)
    assert len(rows) >= 20
    true = contact_point(shape, torch.from_numpy(truth.q[rows, 2])).numpy()
    off = found.impacts.r.numpy() - true
    score = np.einsum("ni,nij,nj->n", off, np.linalg.inv(found.r_cov), off)
    assert np.abs(off).max() < 3e-4
    assert np.median(score) < 4  # 1.4 is expected, and an error of the places is common to all
    assert np.sqrt(found.r_cov.diagonal(axis1=1, axis2=2)).max() < 2e-4
    # The markers' mean is 3 mm off it: its velocity is another by 20 mm/s in the median.
    errors = found.impacts.v_pre.numpy() - truth.v_pre[rows]
    scores = errors / found.impacts.v_pre_cov.diagonal(dim1=-2, dim2=-1).sqrt().numpy()
    assert np.abs(errors[:, :2]).max() < 5e-3
    assert (np.mean(scores**2, 0) < 3).all()
    assert len(found.shape.vertices) == 4
    assert found.shape.gyration_squared() == pytest.approx(shape.gyration_squared(), rel=0.01)
    assert 1e-7 < found.hull.error < 3e-5
    facts = dict(tracks_facts(found))
    assert facts["shape"].startswith("the convex hull of 5 markers, assumed to lie on the outline; uniform density")


def test_markers_in_space(tmp_path, plane):
    """The same motions, seen in space with markers before and behind the plane of motion."""
    truth, shape = write(tmp_path, dimensions=3)
    columns = {"markers": [[f"{axis}{k}" for axis in "xyz"] for k in range(5)]}
    found = found_in(tmp_path, columns=columns, inertia=MASS * 4e-4)
    rows = paired(found, truth)
    true = contact_point(shape, torch.from_numpy(truth.q[rows, 2])).numpy()
    mirror = np.sign((found.impacts.v_pre[:, 0].numpy() * truth.v_pre[rows, 0]).sum())  # which way is right is free
    assert np.abs(found.impacts.r.numpy() * (mirror, 1) - true).max() < 3e-4
    assert np.abs(found.impacts.v_pre.numpy()[:, 1] - truth.v_pre[rows, 1]).max() < 5e-3


def test_a_stated_centre_of_mass(tmp_path):
    """Weights 3, 1, 1, 1 and none put it nearer to the first corner."""
    weights = np.array((3, 1, 1, 1, 0)) / 6
    truth, shape = write(tmp_path, centre=weights[:4] @ KITE)
    found = found_in(tmp_path, centre=[3, 1, 1, 1, 0], inertia=MASS * 4e-4)
    rows = paired(found, truth)
    true = contact_point(shape, torch.from_numpy(truth.q[rows, 2])).numpy()
    assert np.abs(found.impacts.r.numpy() - true).max() < 3e-4
    assert "the centre of mass is the stated one" in dict(tracks_facts(found))["shape"]
    with pytest.raises(DataError, match=r"data\.inertia must be given with data.centre"):
        found_in(tmp_path, centre=[3, 1, 1, 1, 0])
    with pytest.raises(DataError, match=r"data\.centre must be mean, or 5 weights of the markers"):
        found_in(tmp_path, centre=[1, 2], inertia=1e-5)


def test_what_has_no_hull(tmp_path):
    write(tmp_path, size=2)
    two = {"markers": [["x0", "y0"], ["x1", "y1"]]}
    with pytest.raises(DataError, match=r"2 markers have no hull; 3 or more"):
        found_in(tmp_path, columns=two)
    line = {"markers": [["x0", "y0"], ["x1", "y1"], ["x0", "y0"]]}
    with pytest.raises(DataError, match="the markers are on a line"):
        found_in(tmp_path, columns=line)
    table = pd.read_csv(tmp_path / "0001.csv")
    for file in tmp_path.glob("*.csv"):
        file.unlink()
    poses = pd.DataFrame({"time": table.time, "x": table.x0, "y": table.y0, "theta": turn(table.time)})
    poses.to_csv(tmp_path / "poses.csv", index=False)
    with pytest.raises(DataError, match=r"data\.shape must be given: the contact point is the lowest point"):
        found_in(tmp_path, columns=None)


@pytest.mark.parametrize(
    ("dimensions", "chosen"),
    [(2, [2, 0, 3, 1]), (3, [2, 0, 3, 1]), (2, [0, 2]), (3, [4, 0, 1])],
    ids=["corners", "corners in space", "two corners", "one inside in space"],
)
def test_a_stated_shape_is_turned_to_its_markers(tmp_path, dimensions, chosen):
    """Marks on corners in any order, or elsewhere: θ is that of the shape, which the first frame does not show."""
    _, shape = write(tmp_path, dimensions=dimensions, size=14)
    axes = "xyz"[:dimensions]
    columns = {"markers": [[f"{axis}{k}" for axis in axes] for k in chosen]}
    found = tracks.find_impacts(
        tmp_path, mass=MASS, shape=shape, inertia=MASS * 4e-4, options=tracks.track_options(unit="m", columns=columns)
    )
    clue = next(one for one in found.survey.frame.clues if one.convention == "angles")
    assert clue.quantity == "impacts close their moment balance"
    zero = found.rig.orientation
    assert zero is not None
    assert abs(zero.value) < max(0.02, 4 * zero.error)
    if dimensions == 2 and len(chosen) == 4:
        centre = np.array([found.rig.centre_a.value, found.rig.centre_b.value])
        assert np.abs(centre).max() < 1e-3


def test_markers_that_do_not_show_a_body_in_space_are_refused(tmp_path):
    """Off its corners they say nothing of its axes; and a hull in the plane is none of a body that tumbles."""
    rng, time = np.random.default_rng(0), np.arange(60) / 200
    places = np.array(((0.1, 0.06, 0.05), (-0.12, 0.07, 0.05), (-0.09, -0.05, 0.05), (0.15, 0.02, 0.02)))
    for recording in range(4):
        turned = Rotation.from_rotvec(np.outer(time, 8 * rng.standard_normal(3))).as_matrix()
        away = np.stack((time, 0.3 * time, 1 + 0.3 * time - 9.81 / 2 * time**2), -1)
        markers = (away[:, None] + np.einsum("tij,mj->tmi", turned, places - places.mean(0))).reshape(len(time), -1)
        markers += NOISE * rng.standard_normal(markers.shape)
        names = [f"{axis}{k}" for k in range(4) for axis in "xyz"]
        pd.DataFrame(markers, columns=names).assign(time=time).to_csv(tmp_path / f"{recording}.csv", index=False)
    columns = {"markers": [[f"{axis}{k}" for axis in "xyz"] for k in range(4)]}
    for shape, said in (
        (Cuboid((0.15, 0.09, 0.055)), r"on no corners of the stated shape"),
        (None, r"all 4 recordings leave a plane.*data\.shape=\{kind: cuboid"),
    ):
        with pytest.raises(DataError, match=said):
            tracks.find_impacts(
                tmp_path, mass=MASS, shape=shape, options=tracks.track_options(unit="m", columns=columns)
            )


@pytest.mark.parametrize("mirrored", [False, True])
def test_markers_on_corners_in_space(mirrored):
    """Their places are those of the corners, unless only a mirrored body would have them; two alike show nothing."""
    box = Cuboid((0.07, 0.045, 0.03))
    corners = box.corners().numpy()[[0, 3, 5, 6, 7]]
    R = Rotation.from_rotvec((0.4, -1.1, 0.7)).as_matrix()
    marks = 1000 * corners @ R + (3.0, -8.0, 20.0)
    few = Recording(
        name="a", source="a", time=np.arange(2.0), position=np.zeros((2, 3)), quaternion=np.eye(4)[[0, 0]],
        markers=marks * (-1 if mirrored else 1),
    )  # fmt: skip
    frame = Frame(scale=1e-3, axes=np.eye(3))
    places = places_on_corners([few], frame, box)
    assert places is not None
    np.testing.assert_allclose(np.sort(np.abs(places), 0), np.tile((70.0, 45.0, 30.0), (5, 1)), atol=1e-6)
    flat = replace(few, markers=marks[:2])
    assert places_on_corners([flat], frame, box) is None


def test_markers_on_the_axis_of_a_rod_are_on_no_corners():
    """Which are nearer to them than a tenth of its length."""
    rod = Polygon(((0.1, 0.005), (-0.1, 0.005), (-0.1, -0.005), (0.1, -0.005)))
    few = Recording(
        name="a", source="a", time=np.arange(2.0), position=np.zeros((2, 2)), angle=np.zeros(2),
        markers=np.array(((0.1, 0.0), (-0.1, 0.0))),
    )  # fmt: skip
    assert places_on_corners([few], Frame(scale=1.0, axes=np.eye(2)), rod) is None
