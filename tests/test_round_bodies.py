"""Recordings of round bodies: what shows the sense of angles, and what is known without an angle."""

import math
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from contactlearn.core.errors import DataError
from contactlearn.data.tracks import _check_still as check_still, find
from contactlearn.mechanics.shapes import Sphere

RADIUS, MASS, RATE = 0.033, 0.058, 240.0
DISC = {"kind": "disc", "radius": RADIUS}
MU, EPS = 0.2, 0.75


def takes(tmp_path, slope=0.0, *, name="takes", seed=0, recordings=10, seconds=2.0, rate=RATE):
    """Write the frames of discs that bounce until they roll on a floor that is inclined by an angle in rad."""
    rng, tables = np.random.default_rng(seed), []
    along, normal = np.array((math.cos(slope), math.sin(slope))), np.array((-math.sin(slope), math.cos(slope)))
    gravity, time = np.array((0.0, -9.81)), np.arange(round(seconds * rate)) / rate
    for k in range(recordings):
        start, x = 0.0, np.array((rng.uniform(-0.1, 0.1), 0.0)) + normal * rng.uniform(0.5, 0.9)
        v, theta, omega = rng.uniform((-1.0, -1.0), (1.0, 0.5)), rng.uniform(-3, 3), rng.uniform(-15, 15)
        pose = np.zeros((len(time), 3))
        while start < seconds:
            a, b, c = normal @ gravity / 2, normal @ v, normal @ x - RADIUS
            lasts = max((-b - math.sqrt(max(b * b - 4 * a * c, 0.0))) / (2 * a), 1e-4)
            rows = (time >= start) & (time < start + lasts)
            tau = (time[rows] - start)[:, None]
            pose[rows] = np.column_stack((x + v * tau + gravity * tau**2 / 2, theta + omega * tau))
            x, v, theta = x + v * lasts + gravity * lasts**2 / 2, v + gravity * lasts, theta + omega * lasts
            push = -(1 + EPS) * (normal @ v)  # impulses over the mass
            slip = along @ v + RADIUS * omega
            drag = -np.sign(slip) * min(MU * push, abs(slip) / 3)
            v, omega = v + push * normal + drag * along, omega + 2 * drag / RADIUS
            start += lasts
        pose += rng.standard_normal(pose.shape) * (1e-4, 1e-4, 2e-3)
        table = pd.DataFrame({"time": time, "x": pose[:, 0], "y": pose[:, 1], "theta": pose[:, 2]})
        tables.append(table.assign(recording=f"drop{k}"))
    path = tmp_path / f"{name}.csv"
    pd.concat(tables).to_csv(path, index=False)
    return path


def rewritten(path, **columns):
    """The same file with other columns; None takes one away."""
    table = pd.read_csv(path)
    for name, value in columns.items():
        table = table.drop(columns=name) if value is None else table.assign(**{name: value(table)})
    table.to_csv(path, index=False)
    return path


def angles(found):
    (clue,) = (clue for clue in found.survey.frame.clues if clue.convention == "angles")
    return clue


@pytest.mark.parametrize(("slope", "turned"), [(0.0, 1), (10.0, -1), (-10.0, 1)], ids=["flat", "mirrored", "downhill"])
def test_bounces_with_a_moment_show_the_sense_on_any_floor(tmp_path, slope, turned):
    """Most bounces of a ball that soon rolls have no moment; on a ramp the moment is that about the point below it."""
    path = rewritten(takes(tmp_path, math.radians(slope)), theta=lambda table: turned * table.theta)
    found = find(path, MASS, DISC)
    assert angles(found).value == ("rad, as_read" if turned > 0 else "rad, mirrored")
    assert found.floor.slope is not None
    assert math.degrees(found.floor.slope.value) == pytest.approx(slope, abs=0.05)
    assert len(found.impacts) > 40
    with pytest.raises(DataError, match=r"contradict data\.sense=\w+: .* with data\.angle=rad and data\.sense="):
        find(path, MASS, DISC, sense="mirrored" if turned > 0 else "as_read")


def test_a_question_names_the_values_of_its_settings(tmp_path):
    noise = np.random.default_rng(0)
    path = rewritten(takes(tmp_path, recordings=3), theta=lambda table: 2e-3 * noise.standard_normal(len(table)))
    with pytest.raises(DataError, match=r"state data\.angle=rad or deg, and data\.sense=as_read or mirrored$"):
        find(path, MASS, DISC)


@pytest.mark.parametrize("places", [[(0.02, 0.0), (-0.01, 0.015), (-0.01, -0.02)], [(0.0, 0.0), (0.03, 0.0)]])
def test_markers_define_the_sense_and_move_about_the_centre_of_mass(tmp_path, places):
    """Few contacts are enough, and the places of the markers are the same in all recordings."""
    path, arms = takes(tmp_path, recordings=2), dict(enumerate(places))
    table = pd.read_csv(path)
    for k, (a, b) in arms.items():
        c, s = np.cos(table.theta), np.sin(table.theta)
        table[f"x{k}"], table[f"y{k}"] = table.x + a * c - b * s, table.y + a * s + b * c
    table.drop(columns=["x", "y", "theta"]).to_csv(path, index=False)
    found = find(path, MASS, DISC, columns={"markers": [[f"x{k}", f"y{k}"] for k in arms]})
    assert (angles(found).value, angles(found).stated) == ("rad, as_read", True)
    theta = pd.read_csv(takes(tmp_path, name="again", recordings=2)).groupby("recording").theta.first().iloc[0]
    (a, b), c, s = np.mean(places, axis=0), math.cos(theta), math.sin(theta)
    from_centre = np.mean(found.options.layout.places, axis=0)  # in axes of the first frame
    np.testing.assert_allclose(from_centre, (c * a - s * b, s * a + c * b), atol=3e-4)
    np.testing.assert_allclose(found.survey.model.centre, 0, atol=3e-4)
    e = -found.impacts.v_post[:, 1] / found.impacts.v_pre[:, 1]
    assert e[:4].mean().item() == pytest.approx(EPS, abs=0.01)


@pytest.mark.parametrize("change", [{"theta": lambda table: 0 * table.x}, {"theta": None}], ids=["constant", "missing"])
def test_an_angle_that_was_not_measured_shows_no_centre_and_no_spin(tmp_path, change):
    path = rewritten(takes(tmp_path, recordings=6), **change)
    found = find(path, MASS, DISC)
    rig, impacts = found.rig, found.impacts
    assert angles(found).value == "not measured"
    assert (rig.centre_a, rig.centre_b, rig.inertia) == (None, None, None)
    assert found.survey.model.centre == (0, 0)
    assert impacts.v_pre_cov is not None
    assert (impacts.v_pre[:, 2] == 0).all()
    rolling = impacts.v_pre[:, :2].norm(dim=1) / RADIUS
    np.testing.assert_allclose(impacts.v_pre_cov[:, 2, 2].sqrt(), rolling)
    assert (impacts.v_pre_cov[:, 1, 1].sqrt() < 0.02).all()
    square = {"kind": "polygon", "vertices": [[0.03, 0.03], [-0.03, 0.03], [-0.03, -0.03], [0.03, -0.03]]}
    with pytest.raises(DataError, match="no orientation was measured"):
        find(path, MASS, square)


# --- In space, and on a racket ---------------------------------------------------------------------


def bounces(rise: float, up: int = 1) -> pd.DataFrame:
    """Balls without turns in space on a floor that rises at a velocity; falls in vacuum between its contacts."""
    rng, frames = np.random.default_rng(3), list[pd.DataFrame]()
    clock = np.arange(0, 1.2, 1 / 240)
    for k in range(12):
        p, v, start = np.array((0.0, 0.0, 0.6 + rng.uniform(-0.1, 0.1))), rng.uniform((0.3, -0.5, -1), (1, 0.5, 0)), 0.0
        seen = np.empty((0, 3))
        while len(seen) < len(clock):
            gap, closing = p[2] - 0.033 - rise * start, v[2] - rise
            lasts = (closing + np.sqrt(closing**2 + 2 * 9.81 * gap)) / 9.81
            t = clock[(clock >= start) & (clock < start + lasts)] - start
            seen = np.vstack((seen, p + t[:, None] * v - np.outer(t**2, (0, 0, 9.81 / 2))))
            start, p = start + lasts, p + lasts * v - np.array((0, 0, 9.81 / 2)) * lasts**2
            v = np.array((0.8 * v[0], 0.8 * v[1], rise - 0.75 * (v[2] - 9.81 * lasts - rise)))
            if lasts < 0.05:
                break
        seen = seen[: len(clock)] + rng.normal(0, 2e-4, seen[: len(clock)].shape)
        frame = pd.DataFrame(seen * (1, 1, up), columns=[*"xyz"])
        frames.append(frame.assign(time=clock[: len(seen)], recording=f"take {k}"))
    return pd.concat(frames)


def test_a_fit_through_all_of_few_contacts_shows_no_racket():
    """Three changes of height are those of two slopes and a velocity, whatever they are."""
    rng = np.random.default_rng(0)
    contacts = [
        SimpleNamespace(pose=np.append(rng.normal(0, 0.1, 3), (1, 0, 0, 0)), time=k / 4, recording="a",
                        v_pre=np.array((0, 0, -1.0, 0, 0, 0)))
        for k in range(4)
    ]  # fmt: skip
    check_still("a.csv", contacts, Sphere(RADIUS))


@pytest.mark.parametrize("up", [1, -1])
def test_a_ball_in_space_whose_turns_nobody_measured(up, tmp_path):
    bounces(0.0, up).to_csv(tmp_path / "balls.csv", index=False)
    found = find(tmp_path / "balls.csv", mass=0.058, shape={"kind": "sphere", "radius": 0.033})
    assert len(found.impacts) >= 20
    ratio = (-found.impacts.v_post[:, 2] / found.impacts.v_pre[:, 2]).median().item()
    assert ratio == pytest.approx(0.75, abs=0.01)
    assert (found.impacts.v_pre_cov[:, 3, 3].sqrt() > 1).all()  # rad/s: of a ball that may roll
    with pytest.raises(DataError, match="no orientation was measured"):
        find(tmp_path / "balls.csv", mass=0.058, shape={"kind": "cuboid", "half": [0.03, 0.03, 0.03]})


def test_a_racket_that_rises_is_said(tmp_path):
    bounces(0.35).to_csv(tmp_path / "balls.csv", index=False)
    with pytest.raises(DataError, match=r"contacts rise by 0\.35 ± .* m/s within recordings.*as a racket does"):
        find(tmp_path / "balls.csv", mass=0.058, shape={"kind": "sphere", "radius": 0.033})
