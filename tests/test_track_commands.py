"""From a folder of recordings to impacts: conventions found or asked for, refusals, the command and the sources."""

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
from commands import run

from contactlearn.cli.commands.loading import load_data
from contactlearn.cli.hydra_main import compose
from contactlearn.cli.settings import SourceSettings
from contactlearn.core.errors import DataError, UnknownNameError
from contactlearn.data import table, tracks
from contactlearn.data.recordings import survey
from contactlearn.data.recordings.poses import turn
from contactlearn.data.recordings.result import Reason, Refusal
from contactlearn.mechanics.apparatus import Estimate
from contactlearn.mechanics.rigid_body import contact_velocity
from contactlearn.mechanics.shapes import Ellipse, make_shape
from contactlearn.report.text.tracks import tracks_facts, tracks_headline, tracks_summary
from contactlearn.simulation import recordings
from contactlearn.simulation.camera import Camera
from contactlearn.simulation.recordings import AXES, MASS, SEMI_AXES, simulate, write_recordings

SHAPE = Ellipse(SEMI_AXES)
PLAIN = Camera(frames=220)
GENERIC = {"columns": {"quaternion": ["q1", "q2", "q3", "q4"]}}
DEGREES = replace(PLAIN, degrees=True)
TILTED = tuple(map(tuple, np.asarray(AXES["y_up"]) @ ((0.94, 0, 0.342), (0, 1, 0), (-0.342, 0, 0.94))))


def folder(path, camera=PLAIN, size=6, seed=3):
    recordings, truth = simulate(size, camera, seed=seed)
    write_recordings(recordings, path)
    return truth


def found_in(path, **settings):
    return tracks.find_impacts(path, mass=MASS, shape=SHAPE, options=tracks.track_options(**settings))


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    path = tmp_path_factory.mktemp("plain")
    folder(path)
    return path, found_in(path)


def test_impacts_have_contact_points_covariances_and_names(plain):
    _, found = plain
    impacts = found.impacts
    assert impacts.trial[0] == "0001#1"
    assert (contact_velocity(impacts.r, impacts.v_pre)[:, 1] < 0).all()
    assert torch.allclose(impacts.q[:, 1] + impacts.r[:, 1], torch.tensor(0.0).double(), atol=3e-4)  # on the floor
    sigma = impacts.v_post_cov.diagonal(dim1=-2, dim2=-1).sqrt()
    assert (sigma.median(0).values < torch.tensor((2e-3, 2e-3, 0.1))).all()
    assert abs(found.floor.height.value) < 2e-4
    assert abs(found.floor.slope.value) < 1e-3
    assert np.hypot(*found.survey.model.gravity) == pytest.approx(9.81, rel=0.01)


@pytest.mark.parametrize(
    ("camera", "settings"),
    [
        (replace(PLAIN, axes=AXES["image"], length=1e3, degrees=True), {}),
        (replace(PLAIN, axes=AXES["z_up"], order="xyzw", length=100.0), GENERIC),
        (replace(PLAIN, axes=((0.94, 0.342, 0), (-0.342, 0.94, 0))), {"unit": "m", "angle": "rad"}),
    ],
    ids=["image in mm and degrees", "space in cm, scalar last", "turned by 20°"],
)
def test_conventions_are_found(tmp_path, plain, camera, settings):
    """The velocities are those of the same motions with plain axes, but for the noise."""
    folder(tmp_path, camera)
    impacts, wanted = found_in(tmp_path, **settings).impacts, plain[1].impacts
    rows = {name: k for k, name in enumerate(wanted.trial)}
    both = [(k, rows[name]) for k, name in enumerate(impacts.trial) if name in rows]
    assert len(both) >= 0.8 * len(wanted)
    here, there = (torch.tensor(part) for part in zip(*both, strict=True))
    apart = (impacts.v_pre[here] - wanted.v_pre[there]).abs().median(0).values
    assert (apart < torch.tensor((2e-3, 2e-3, 0.05))).all()


@pytest.mark.parametrize(
    ("camera", "settings", "fragments"),
    [
        (replace(PLAIN, stated_rate=240.0), {}, ["gravity is 9.0", "none of m, dm", "data.rate"]),
        (replace(PLAIN, stated_rate=240.0), {"unit": "m"}, ["frame rate 1.04", "data.unit=m"]),
        (replace(PLAIN, length=1e3), {"unit": "m"}, ["is the unit mm?"]),
        (replace(PLAIN, axes=AXES["image"]), {"up": "y"}, ["data.up", "is up -y?"]),
        (PLAIN, {"up": "z"}, ["no such axis"]),
        (replace(PLAIN, axes=TILTED, order="xyzw"), GENERIC | {"order": "wxyz"}, ["data.order=wxyz", "with xyzw"]),
        (PLAIN, {"sense": "mirrored"}, ["contradict data.sense=mirrored:", "with data.angle=rad and data.sense=as"]),
        (DEGREES, {"angle": "rad", "sense": "mirrored"}, ["contradict data.angle=rad and data.sense=mirrored:"]),
        (DEGREES, {"angle": "rad"}, ["contradict data.angle=rad:", "with data.angle=deg and data.sense=as_read"]),
        (replace(PLAIN, frames=30), {}, ["data.unit|no impact in|angles are measured"]),
    ],
    ids=["rate", "rate and unit", "unit", "up", "axis", "order", "sense", "both", "angle", "none"],
)  # fmt: skip
def test_wrong_conventions_are_caught(tmp_path, camera, settings, fragments):
    folder(tmp_path, camera)
    with pytest.raises(DataError) as caught:
        found_in(tmp_path, **settings)
    for fragment in fragments:
        assert any(part in str(caught.value) for part in fragment.split("|"))


@pytest.mark.parametrize("stated_rate", [0.25, 2.5e-4], ids=["ms", "µs"])
def test_times_in_which_no_flight_would_last_are_read_in_a_smaller_unit(tmp_path, stated_rate):
    folder(tmp_path, replace(PLAIN, stated_rate=stated_rate))
    assert len(found_in(tmp_path).impacts) > 10


def test_the_sense_is_found_though_the_zero_of_angles_is_off(tmp_path):
    """Friction alone shows the sense of a symmetric body, and a zero off by 5° makes a torque as large as it."""
    recordings, truth = simulate(8, mu=0.02, seed=4)
    off = np.radians(5)
    write_recordings([replace(one, angle=one.angle + off) for one in recordings], tmp_path)
    found = found_in(tmp_path)
    assert found.survey.frame.sense == 1
    hit = found.survey.contacts[0]
    mine = truth.recording == int(hit.recording) - 1
    j = np.flatnonzero(mine)[np.abs(truth.time[mine] - hit.time).argmin()]
    assert abs(turn(hit.pose[2] - truth.q[j, 2] - off)) < 0.02


def test_the_order_is_asked_for_where_both_fit(tmp_path):
    """With z up and the motion along x, exchanged components turn about the same axis."""
    folder(tmp_path, replace(PLAIN, axes=((1, 0, 0), (0, 0, -1), (0, 1, 0))))
    with pytest.raises(DataError, match="both orders fit the plane of motion; state data"):
        found_in(tmp_path, **GENERIC)
    assert len(found_in(tmp_path, **GENERIC, order="wxyz").impacts) > 10


def test_trials_out_of_the_plane_are_refused_with_their_number(tmp_path):
    folder(tmp_path, replace(PLAIN, axes=AXES["y_up"]))
    leaving = pd.read_csv(tmp_path / "0002.csv")
    leaving["z"] += 0.3 * leaving["time"]
    leaving.to_csv(tmp_path / "0002.csv", index=False)
    (refusal,) = [r for r in found_in(tmp_path, **GENERIC).survey.refusals if r.reason is Reason.OUT_OF_PLANE]
    assert (refusal.recording, refusal.unit) == ("0002", "mm")
    assert refusal.value > 50
    with pytest.raises(UnknownNameError, match="axes"):
        recordings.load(size=2, folder=str(tmp_path), axes="sideways")
    with pytest.raises(DataError, match="exposure"):
        recordings.load(size=2, folder=str(tmp_path), exposure=1.0)
    assert math.isclose(Camera().angle_noise, math.radians(0.1))


def test_a_wall_is_refused(tmp_path):
    """A recording whose floor is half a metre higher than that of the others."""
    folder(tmp_path)
    higher = pd.read_csv(tmp_path / "0001.csv")
    higher["y"] += 0.5
    higher.to_csv(tmp_path / "0001.csv", index=False)
    found = found_in(tmp_path)
    assert all(not name.startswith("0001") for name in found.impacts.trial)
    assert {r.recording for r in found.survey.refusals if r.reason is Reason.HAND_OR_WALL} == {"0001"}


def test_the_command_writes_impacts_and_refusals(tmp_path, plain):
    path, found = plain
    for file in path.iterdir():
        (tmp_path / "in").mkdir(exist_ok=True)
        (tmp_path / "in" / file.name).write_bytes(file.read_bytes())
    (tmp_path / "in" / "9_broken.csv").write_text("time,x\n1,2\n")
    shape = f"data.shape={{kind: ellipse, semi_axes: {list(SEMI_AXES)}}}"
    out = tmp_path / "out.parquet"
    told = run("contactlearn", "impacts", str(tmp_path / "in"), "-o", str(out), f"data.mass={MASS}", shape)
    impacts = table.load(out, shape=SHAPE)
    assert torch.equal(impacts.v_pre_cov, found.impacts.v_pre_cov)
    assert impacts.trial == found.impacts.trial
    for fragment in (
        "impacts from 6 recordings",
        "rad, as_read (turning as the axes do), found: impacts close their moment balance better than with",
        "ms, assumed 0 ms, from contacts",
        "unit",
        "gravity",
        "were refused",
        "left out",
        "9_broken.csv: has no column",
        "('data.columns={time: t, position: [px, py], angle: phi}' says which",
    ):
        assert fragment in told
    refused = pd.read_csv(tmp_path / "out.refused.csv")
    assert len(refused) == len(found.survey.refusals) + 1
    assert "not_read" in set(refused["reason"])


BODY = ("data.mass=1", "data.shape={kind: disc, radius: 1}")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["-o", "b.csv"], "error: data.mass must be given: data.mass=…"),
        (["-o", "b.csv", "mass=1"], "impacts only takes data=… and data.KEY=…, got mass=1: data.mass=1?"),
        (["-o", "b.csv", *BODY, "data.colour=red"], "unknown setting 'data.colour'"),
        (["-o", "a.txt", *BODY], "a table is a .csv or .parquet file"),
        (["-o", "b.csv", *BODY, "data.unit=inch"], "unknown data.unit 'inch'"),
        (["-o", "b.csv", *BODY, "data.units=mm"], "data.units is a setting of other choices"),
        (["-o", "b.csv", *BODY, "data.rate=5"], "s by data.rate=5;"),
        (["-o", "b.csv", "data.columns={time: t (s)}"], "data.columns={time: t (s)} cannot be read: "),
        (["-o", "b.csv", *BODY, "data.columns={angel: a}"], "did you mean 'angle'"),
        (["-o", "there.csv", *BODY], "there.csv is there already and is not replaced"),
    ],
)
def test_the_command_says_what_is_wrong(tmp_path, words, message):
    (tmp_path / "a.csv").write_text("time,x,y,theta\n0,1,2,3\n1,1,2,3\n")
    (tmp_path / "there.csv").write_text("mine")
    said = run("contactlearn", "impacts", str(tmp_path / "a.csv"), *words, cwd=tmp_path, status=2)
    assert message in said
    assert (tmp_path / "there.csv").read_text() == "mine"


@pytest.mark.parametrize(("rate", "warned"), [(50.0, True), (250.0, False)])
def test_few_frames_a_second_are_warned_of(tmp_path, rate, warned):
    folder(tmp_path, Camera(frames=round(0.9 * rate), rate=rate), size=16)
    found = found_in(tmp_path, unit="m", angle="rad", sense="as_read", fewest=5)
    facts = dict(tracks_facts(found))
    assert ("frames" in facts) == warned
    if warned:
        assert re.match(r"only 50 a second: velocities after contact are uncertain by ± [\d.]+ mm/s", facts["frames"])


def test_a_centre_of_mass_that_nothing_shows_is_said_to_be_assumed(tmp_path):
    folder(tmp_path, size=3)
    found = found_in(tmp_path, unit="m", angle="rad", sense="as_read")
    assert "centre" not in dict(tracks_facts(found))
    unseen = found.impacts.replace(apparatus=replace(found.rig, centre_a=None, centre_b=None))
    facts = dict(tracks_facts(replace(found, impacts=unseen)))
    assert facts["centre"] == "of mass, assumed: the point that was tracked; flights do not show where it is"


def test_refusals_name_settings(tmp_path, plain):
    folder(tmp_path / "in", size=3)
    (tmp_path / "in" / "z.csv").write_text("x,y,theta\n1,2,3\n")
    shape = f"data.shape={{kind: ellipse, semi_axes: {list(SEMI_AXES)}}}"
    run("contactlearn", "impacts", str(tmp_path / "in"), "-o", str(tmp_path / "a.csv"), f"data.mass={MASS}", shape)
    assert "state data.rate" in (tmp_path / "a.refused.csv").read_text()


def test_the_sources_compose(tmp_path, plain):
    overrides = ["data=tracks_synthetic", "data.size=4", f"data.folder={tmp_path / 'drops'}", "data.lost=0.02"]
    impacts = load_data(SourceSettings.from_config(compose("evaluate", overrides))).impacts
    assert impacts.v_post_cov is not None
    path, found = plain
    words = ["data=tracks", f"data.path={path}", f"data.mass={MASS}"]
    words += [f"data.shape={{kind:ellipse,semi_axes:[{SEMI_AXES[0]},{SEMI_AXES[1]}]}}"]
    impacts = load_data(SourceSettings.from_config(compose("evaluate", words))).impacts
    assert impacts.fingerprint() == found.impacts.fingerprint()


@pytest.mark.nightly
def test_a_long_file_is_shared_between_processes(tmp_path, monkeypatch):
    """In the file's order, with its refusals, and with progress by pieces of so many recordings."""
    monkeypatch.setattr(survey, "_CHUNK", 4)
    recordings, _ = simulate(6, PLAIN, seed=9)
    names = ("time", "x", "y", "theta")
    parts = [
        pd.DataFrame(dict(zip(names, (r.time, *r.position.T, r.angle), strict=True))).assign(recording=r.name)
        for r in recordings
    ]
    parts[3].loc[7, "time"] = parts[3].loc[6, "time"]
    pd.concat(parts).to_csv(tmp_path / "long.csv", index=False)
    pieces = []

    def counted(parts):
        for part in parts:
            pieces.append(len(part))
            yield part

    path, options = tmp_path / "long.csv", [tracks.track_options(unit="m", workers=workers) for workers in (1, 2)]
    found = [tracks.find_impacts(path, mass=MASS, shape=SHAPE, options=each, progress=counted) for each in options]
    assert pieces == [4, 2] * 2
    alone, shared = found
    assert shared.impacts.trial == alone.impacts.trial
    assert torch.equal(shared.impacts.v_post_cov, alone.impacts.v_post_cov)
    assert [str(one) for one in shared.survey.refusals] == [str(one) for one in alone.survey.refusals]
    assert shared.survey.recordings == alone.survey.recordings == 5
    assert sum(one.reason is Reason.NOT_READ for one in shared.survey.refusals) == 1


def test_pixels_have_a_size_in_metres(tmp_path):
    """The error says how large one is by gravity; y points down, as in an image."""
    pixel = 0.00048
    recordings, _ = simulate(6, replace(PLAIN, length=1 / pixel, axes=((1, 0, 0), (0, -1, 0))), seed=3)
    write_recordings(recordings, tmp_path)
    with pytest.raises(DataError, match=r"of pixels state .* data\.unit=0\.0004[78]\d+$"):
        found_in(tmp_path)
    with pytest.raises(DataError, match=r"gravity is 4\.9\d* m/s² with data\.unit=0\.00024"):
        found_in(tmp_path, unit=pixel / 2)
    with pytest.raises(UnknownNameError, match=r"data\.unit '-0\.1'"):
        found_in(tmp_path, unit=-0.1)
    found = found_in(tmp_path, unit=pixel)
    assert found.survey.frame.scale == pytest.approx(pixel)
    assert (found.impacts.q[:, 1] + found.impacts.r[:, 1]).abs().max() < 1e-3  # on the floor


@pytest.mark.parametrize(("ends", "message"), [(True, "ends before the contact"), (False, "begins at the contact")])
def test_recordings_with_one_flight_each_say_how_they_must_go_on(tmp_path, ends, message):
    """As a trigger cuts them: at the first contact, or from there to shortly before the next one."""
    rng, (a, b) = np.random.default_rng(4), SEMI_AXES
    for k in range(10):
        t = np.arange(50 if ends else 40) / 250
        v, height = (0.0, 0.4) if ends else (1.8, 0.03)
        pose = (rng.uniform(-1, 1) * t, height + v * t - 4.905 * t**2, 1 + rng.uniform(-9, 9) * t)
        x, y, theta = (
            one + scale * rng.normal(size=len(t)) for one, scale in zip(pose, (1e-4, 1e-4, 2e-3), strict=True)
        )
        table = pd.DataFrame({"time": t, "x": x, "y": y, "theta": theta})
        table.to_csv(tmp_path / f"{k}.csv", index=False)
    words = ["impacts", str(tmp_path), "-o", str(tmp_path / "a.parquet"), f"data.mass={MASS}", "data.angle=rad"]
    said = run("contactlearn", *words, f"data.shape={{kind: ellipse, semi_axes: [{a}, {b}]}}", status=2)
    assert said.startswith("error: ")  # and no empty line
    assert said.count("\n") == 1
    assert f"no impact in 10 recordings: each has one free flight, and {message}" in said
    assert f"8 frames or more {'after' if ends else 'before'} contact" in said


@pytest.mark.parametrize(("rate", "wanted"), [(25, "film at"), (600, None)])
def test_flights_of_few_frames_say_how_fast_to_film(tmp_path, rate, wanted):
    """Bodies that fall from 20 cm and bounce once, filmed too slowly; or a clock that runs too fast."""
    rng, rows = np.random.default_rng(5), []
    for k in range(12):
        t = np.arange(rng.uniform(0, 0.04), 0.5, 0.04)
        fall = (2 * 0.2 / 9.81) ** 0.5
        bounce = 0.4 * 9.81 * fall
        y = np.where(t < fall, 0.2 - 4.905 * t**2, np.maximum(bounce * (t - fall) - 4.905 * (t - fall) ** 2, 0))
        y = 0.03 + y + 3e-4 * rng.normal(size=len(t))
        rows += [(k, i / rate, 0.2 * t[i], y[i], 1 + 2 * t[i]) for i in range(len(t))]
    pd.DataFrame(rows, columns=["recording", "time", "x", "y", "theta"]).to_csv(tmp_path / "a.csv", index=False)
    with pytest.raises(DataError, match="no free flight is seen") as caught:
        found_in(tmp_path / "a.csv")
    if wanted is None:
        assert "check that frames are 0.001667 s apart" in str(caught.value)
    else:
        assert re.search(
            r"flights have about [4-6] frames at 25 frames a second .*, and 11 are needed", str(caught.value)
        )
        assert re.search(r"film at (50|60|70) frames a second or more, or let the body fall", str(caught.value))


def test_small_errors_are_no_zero_and_a_star_is_explained(plain):
    _, found = plain
    told = tracks_summary(found, Path("a.csv"), Path("b.csv"))
    assert re.search(r"± [\d.]+ mm/s \([\d.]+\s% of them\), written to", told[0])
    assert not any(" *, from" in line or line.startswith("  * ") for line in told)
    exact = replace(found, impacts=found.impacts.replace(v_pre_cov=1e-8 * found.impacts.v_pre_cov))
    assert re.search(r"± [\d.e−]+ mm/s$", tracks_headline(exact))
    gravity = replace(found.impacts.apparatus.gravity, value=9.7, error=0.01)
    off = replace(found, impacts=found.impacts.replace(apparatus=replace(found.impacts.apparatus, gravity=gravity)))
    told = "\n".join(tracks_summary(off, Path("a.csv"), Path("b.csv")))
    assert re.search(
        r"assumed 9\.81.* \*, from[^*]*\n  \* differs from what is assumed or stated by more than three", told
    )


def test_a_round_rim_as_a_polygon_is_said(plain):
    _, found = plain
    hit = Refusal(recording="a", reason=Reason.SECOND_CORNER, quantity="height", value=-1.0, unit="mm")
    survey = replace(found.survey, refusals=(hit,) * (len(found.impacts) + 1))
    rim = [[0.03 * math.cos(math.tau * k / 24), 0.03 * math.sin(math.tau * k / 24)] for k in range(24)]
    for vertices, said in ((rim, True), (rim[::6], False)):
        impacts = found.impacts.replace(shape=make_shape({"kind": "polygon", "vertices": vertices}), validate=False)
        told = "\n".join(tracks_summary(replace(found, impacts=impacts, survey=survey), Path("a.csv"), Path("b.csv")))
        assert ("has 24 corners: of a round rim" in told) == said
    assert "corners: of a round rim" not in "\n".join(tracks_summary(found, Path("a.csv"), Path("b.csv")))
    off = replace(found.impacts.apparatus, centre_a=Estimate(value=0.034, error=1e-5))
    moved = replace(found, impacts=found.impacts.replace(apparatus=off))
    assert "from the tracked point, assumed 0 mm" in "\n".join(tracks_summary(moved, Path("a.csv"), Path("b.csv")))


def test_each_part_between_flights_is_a_contact_or_refused(plain):
    """Before the first flight, between two, and behind the last one, where recordings end in the middle of a bounce."""
    parts = 0
    for one in plain[1].searched.values():
        inner, outer = len(one.flights) - 1, [one.flights[0].first > 0, one.flights[-1].last < len(one.track) - 1]
        assert len(one.contacts) + len(one.refusals) == inner + sum(outer)
        parts += sum(outer)
    assert parts  # of which the ends are some
