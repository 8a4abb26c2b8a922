"""Readers of recordings: what is written is read, and what cannot be read is one clear line."""

import json
import re
import sys
import tracemalloc
from io import StringIO
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
from refusals import refused
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from contactlearn.core.errors import ContactLearnError, DataError, UnknownNameError
from contactlearn.data import table
from contactlearn.data.cameras import images_of_cameras
from contactlearn.data.headers import propose, stated_by_header
from contactlearn.data.recordings.conventions import Conventions, find_frame, find_gravity
from contactlearn.data.recordings.frame import matrices, orders_of
from contactlearn.data.recordings.markers import pose_of_markers
from contactlearn.data.recordings.poses import turn
from contactlearn.data.recordings.readers import Layout, columns, read, recording_files
from contactlearn.data.recordings.readers.arrays import recordings_of
from contactlearn.data.recordings.track import Recording, on_grid
from contactlearn.data.tracks import track_options
from contactlearn.mechanics.rigid_body import GRAVITY
from contactlearn.simulation.camera import Camera
from contactlearn.simulation.recordings import AXES, simulate, write_recordings

FLAT, _ = simulate(2, Camera(frames=40, lost=0.1), seed=1)
POSE = "geometry_msgs/msg/PoseStamped"
SPACE, _ = simulate(2, Camera(frames=40, lost=0.1, axes=AXES["z_up"]), seed=1)


def same(a, b, rounding=1e-8) -> None:
    """Times, positions and rotations, lost frames among them."""
    for x, y in ((a.time, b.time), (a.position, b.position), (a.rotation, b.rotation)):
        np.testing.assert_allclose(x, y, rtol=rounding, atol=rounding)


@pytest.mark.parametrize("recordings", [FLAT, SPACE], ids=["in a plane", "in space"])
def test_csv(tmp_path, recordings):
    write_recordings(recordings, tmp_path)
    layout = Layout(quaternion=("q1", "q2", "q3", "q4"))
    for file, wanted in zip(recording_files(tmp_path), recordings, strict=True):
        (found,) = read(file, layout)
        same(found, wanted)
        assert (found.name, found.order, found.unit) == (wanted.name, None, None)


ODD = {  # as a tracker may write them
    "time": ("ms", lambda r: 1e3 * r.time), "x": ("cm", lambda r: 100 * r.position[:, 0]),
    "y": (None, lambda r: -r.position[:, 1] / 5e-4), "angle": ("deg", lambda r: -np.degrees(r.angle)),
}  # fmt: skip


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".json"])
def test_each_column_of_frames_has_its_unit_and_sense(tmp_path, suffix):
    frame = pd.DataFrame({name: of(FLAT[0]) for name, (_, of) in ODD.items()})
    path = tmp_path / f"take{suffix}"
    if suffix == ".json":
        frame.to_json(path, orient="records", double_precision=15)
    else:
        frame.to_csv(path, index=False) if suffix == ".csv" else frame.to_parquet(path)
    stated = {
        "time": {"column": "time", "unit": "ms"},
        "position": [{"column": "x", "unit": "cm"}, {"column": "y", "unit": "m", "factor": -5e-4}],
        "angle": {"column": "angle", "unit": "deg", "factor": -1},
    }
    options = track_options(columns=stated)
    (found,) = fail(read(path, options.layout))
    same(found, FLAT[0])
    assert (found.unit, options.conventions.angle, options.conventions.sense) == ("m", "rad", "as_read")
    (flat,) = fail(read(path, track_options(columns={**stated, "position": ["x", {"value": 0}]}).layout))
    assert (flat.unit, flat.position[:, 1].any()) == (None, False)


def test_rows_of_a_faster_instrument_between_the_frames_are_left_out(tmp_path):
    names = ["cam_px", "cam_py", "cam_pz", "cam_qx", "cam_qy", "cam_qz", "cam_qw"]
    pose = np.column_stack([np.random.default_rng(1).normal(size=(40, 3)), Rotation.random(40, rng=0).as_quat()])
    frame = pd.DataFrame(pose, columns=names).assign(time=np.arange(40) / 500, gyro=1.0)
    frame.loc[1::2, names] = np.nan
    frame.to_csv(tmp_path / "take.csv", index=False)
    assert columns.bodies_in_names(names, ["x", "y", "z", "qw", "qx", "qy", "qz"]) == {}  # and not cam_p and cam_q
    layout = track_options(columns={"position": names[:3], "quaternion": names[3:]}).layout
    (found,) = fail(read(tmp_path / "take.csv", layout))
    np.testing.assert_allclose(found.time, np.arange(20) / 250)
    np.testing.assert_allclose(found.position, pose[::2, :3])
    frame.loc[8:30, names[0]] = 0.0  # frames that a camera lost are none of another instrument
    frame.to_csv(tmp_path / "take.csv", index=False)
    (found,) = fail(read(tmp_path / "take.csv", layout))
    assert len(found.time) == 40


def test_columns_in_space_are_turned_about_by_their_factors(tmp_path):
    """A left-handed y up, z ahead becomes right-handed, and so do its quaternions."""
    turned = Rotation.random(12, random_state=np.random.default_rng(0)).as_quat()
    place = np.random.default_rng(1).normal(size=(12, 3))
    frame = pd.DataFrame(np.column_stack([place * (1, 1, -1), turned * (-1, -1, 1, 1)]), columns=[*"xyzabcd"])
    frame.assign(time=np.arange(12) / 250).to_csv(tmp_path / "take.csv", index=False)
    position = ["x", "y", {"column": "z", "factor": -1}]
    quaternion = [{"column": "a", "factor": -1}, {"column": "b", "factor": -1}, "c", "d"]
    (found,) = fail(
        read(tmp_path / "take.csv", track_options(columns={"position": position, "quaternion": quaternion}).layout)
    )
    np.testing.assert_allclose(found.position, place, rtol=1e-12)
    np.testing.assert_allclose(found.quaternion, turned, rtol=1e-12)
    euler = [{"column": name, "unit": "deg"} for name in "abc"]
    (found,) = fail(read(tmp_path / "take.csv", track_options(columns={"euler": euler}).layout))
    np.testing.assert_allclose(found.quaternion, np.radians(turned[:, :3] * (-1, -1, 1)), rtol=1e-12)


@pytest.mark.parametrize(
    ("columns", "settings", "said"),
    [
        ({"position": ["x", {"column": "y", "unit": "mm"}]}, {}, "position: state the unit of each column, or of none"),
        ({"position": ["x", {"column": "yy"}]}, {}, "position.column=yy: no such column, did you mean 'y'"),
        ({"angle": {"column": "angle", "unit": "mm"}}, {}, "data.columns.angle.unit=mm is no unit of theta"),
        ({"angle": {"column": "angle", "unit": "rad"}}, {"angle": "deg"}, "data.angle=deg is stated beside a unit"),
        ({"position": [{"column": one, "unit": "mm"} for one in "xy"]}, {"unit": "m"}, "data.unit=m is stated beside"),
        ({"recording": {"column": "x"}}, {}, "data.columns.recording is the name of a column"),
    ],
)  # fmt: skip
def test_columns_that_cannot_be_made_are_refused(tmp_path, columns, settings, said):
    pd.DataFrame({name: of(FLAT[0]) for name, (_, of) in ODD.items()}).to_csv(tmp_path / "take.csv", index=False)
    with refused([said]):
        [*fail(read(tmp_path / "take.csv", track_options(columns=columns, **settings).layout))]


def test_made_columns_are_of_tables_alone(tmp_path):
    np.save(tmp_path / "take.npy", np.zeros((12, 8)))
    with refused(["units, factors and values of columns are read of tables of frames"]):
        [*fail(read(tmp_path / "take.npy", Layout(time={"column": "t", "unit": "ms"})))]


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_long_file_names_its_recordings(tmp_path, suffix):
    names = {"time": "t", "position": ("px", "py"), "angle": "phi", "recording": "drop"}
    tables = [
        pd.DataFrame({"drop": r.name, "t": r.time, "px": r.position[:, 0], "py": r.position[:, 1], "phi": r.angle})
        for r in FLAT
    ]
    path = tmp_path / f"all{suffix}"
    pd.concat(tables).to_csv(path, index=False) if suffix == ".csv" else pd.concat(tables).to_parquet(path)
    for found, wanted in zip(read(path, Layout(**names)), FLAT, strict=True):
        same(found, wanted)
    pd.concat([*tables, tables[0]]).to_csv(tmp_path / "mixed.csv", index=False)
    errors = [one for one in read(tmp_path / "mixed.csv", Layout(**names)) if isinstance(one, DataError)]
    assert ["time must grow" in str(one) for one in errors] == [True]


MANY = {
    "good": ["a,0,1,2,3", "a,1,1,2,3"],
    "text": ["b,0,1,2,3", "b,1,1,two,3"],
    "back": ["c,0,1,2,3", "c,2,1,2,3", "c,1,1,2,3"],
    "repeats": ["d,0,1,2,3", "d,0,1,2,4"],
    "one": ["e,0,1,2,3"],
    "long": [f"f,{k},1,2,3" for k in range(9)],
    "last": ["g,0,1,2,3", "g,1,,,", "g,2,1,2,3"],
}


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@pytest.mark.parametrize("rows", [1, 4, 1000])
def test_a_bad_recording_of_many_is_its_error_and_the_others_go_on(tmp_path, monkeypatch, suffix, rows):
    """However many rows are read at once."""
    monkeypatch.setattr(columns, "_ROWS", rows)
    monkeypatch.setattr(columns, "MOST_FRAMES", 8)
    kinds = [name for name in MANY if suffix == ".csv" or name != "text"]  # a column of Parquet has one type
    text = "\n".join(("recording,time,x,y,theta", *(row for name in kinds for row in MANY[name])))
    path = tmp_path / f"all{suffix}"
    path.write_text(text) if suffix == ".csv" else pd.read_csv(StringIO(text)).to_parquet(path)
    found = dict(zip(kinds, read(path, Layout()), strict=True))
    assert [name for name, one in found.items() if isinstance(one, Recording)] == ["good", "last"]
    assert found["last"].seen.tolist() == [True, False, True]
    said = {name: str(one) for name, one in found.items()}
    assert "text" not in said or f"{path}: b: row 2, column y: must be a number, got 'two'" in said["text"]
    assert f"{path}: c: time must grow; it runs back at frame 3" in said["back"]
    assert f"{path}: d: time must grow; it repeats at frame 2" in said["repeats"]
    assert f"{path}: e: has 1 frames" in said["one"]
    assert f"{path}: f: has 9 frames, more than 8: split it" in said["long"]


def test_memory_is_bounded_by_a_few_recordings(tmp_path, monkeypatch):
    """Peak memory of Python's and NumPy's objects, while 40 and 160 recordings of one file are read in pieces."""
    monkeypatch.setattr(columns, "_ROWS", 2000)
    frames = pd.DataFrame({"time": np.arange(500) / 250, "x": 0.0, "y": 0.0, "theta": 0.0})
    peaks = []
    for count in (40, 160):
        path = tmp_path / f"{count}.parquet"
        pd.concat([frames.assign(recording=f"{k:04d}") for k in range(count)]).to_parquet(path, index=False)
        tracemalloc.start()
        assert sum(len(one) for one in read(path, Layout())) == 500 * count
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.3 * peaks[0]


def test_named_components_say_their_order(tmp_path, monkeypatch):
    assert Layout().order == "wxyz"
    assert Layout(quaternion=("rx", "ry", "rz", "rw")).order == "xyzw"
    assert Layout(quaternion=("q0", "q1", "q2", "q3")).order is None
    (tmp_path / "a.csv").write_text("x,y,theta\n1,2,3\n1,2,\n1,2,3\n")
    (found,) = read(tmp_path / "a.csv", Layout(rate=100))
    assert found.time.tolist() == [0, 0.01, 0.02]
    assert found.seen.tolist() == [True, False, True]
    monkeypatch.setattr(columns, "_ROWS", 4)
    monkeypatch.setattr(columns, "MOST_FRAMES", 8)
    path = tmp_path / "all.csv"
    path.write_text("time,x,y,theta\n" + "".join(f"{k},1,2,3\n" for k in range(20)) + "never,read\n")
    with pytest.raises(DataError, match="more than 8 frames and no column 'recording' of recordings: split it"):
        list(read(path, Layout()))


BAD = {
    "empty": ("", {}, ["the file is empty"]),
    "header alone": ("time,x,y,theta\n", {}, ["holds no frames"]),
    "one column too few": (
        "time,x,y,thet\n0,1,2,3\n1,1,2,3\n",
        {},
        ["no column 'theta'", "did you mean 'thet'", "data.columns"],
    ),
    "text": ("time,x,y,theta\n0,1,2,3\n1,1,two,3\n", {}, ["row 2, column y", "must be a number", "'two'"]),
    "time runs back": ("time,x,y,theta\n0,1,2,3\n2,1,2,3\n1,1,2,3\n", {}, ["time must grow", "frame 3"]),
    "time repeats": ("time,x,y,theta\n0,1,2,3\n0,1,2,4\n", {}, ["time must grow; it repeats"]),
    "no time": ("x,y,theta\n1,2,3\n1,2,3\n", {}, ["no column 'time'", "data.rate"]),
    "one frame": ("time,x,y,theta\n0,1,2,3\n", {}, ["has 1 frames"]),
    "more cells": ("time,x,y,theta\n0,1,2,3\n1,2,3,4,5,6\n", {}, ["cannot be read"]),
    "binary": (bytes(range(256)), {}, ["is neither UTF-8"]),
    "markers of one": ("time,x,y,theta\n0,1,2,3\n1,1,2,3\n", {"markers": [["x", "y"]]}, ["needs 2 markers, got 1"]),
}


@pytest.mark.parametrize(("content", "layout", "fragments"), BAD.values(), ids=BAD)
def test_what_cannot_be_read_is_one_clear_line(tmp_path, content, layout, fragments):
    path = tmp_path / "drop.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with refused([str(path), *fragments]) as caught:
        list(read(path, Layout(**layout)))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("rate", [100, 200.0, 201])
def test_a_frame_rate_that_contradicts_the_time_stamps_is_refused(tmp_path, rate):
    """Of 200 frames/s, rounded to ms, with frames that are skipped; without its time stamps the file is taken at it."""
    stamps = np.delete(np.arange(400) * 0.005, [7, 30, 31, 200]) + 0.2
    frames = pd.DataFrame({"time": stamps.round(3), "x": 0.0, "y": 0.0, "theta": 0.0})
    frames.to_csv(tmp_path / "a.csv", index=False)
    if rate > 100:
        (found,) = read(tmp_path / "a.csv", Layout(rate=rate))
        assert found.time[0] == 0.2
        return
    with pytest.raises(DataError, match=r"0.005 s apart by their time stamps, and 0.01 s by data.rate=100.*time: null"):
        list(read(tmp_path / "a.csv", Layout(rate=rate)))
    (found,) = read(tmp_path / "a.csv", Layout(rate=rate, time=None))
    assert found.time[:2].tolist() == [0, 0.01]
    (tmp_path / "b.csv").write_text("time,x,y,theta\n0,1,2,3\n,1,2,3\n0.1,1,2,3\n")
    with pytest.raises(DataError, match="time must grow; it is not a number at frame 2"):
        list(read(tmp_path / "b.csv", Layout(rate=rate)))
    with pytest.raises(DataError, match=r"has no times; state data.rate"):
        list(read(tmp_path / "a.csv", Layout(time=None)))


def test_folders(tmp_path):
    (tmp_path / "inner").mkdir()
    for name in ("b.csv", "inner/a.TUM", "notes.md", ".hidden.csv"):
        (tmp_path / name).touch()
    assert [file.name for file in recording_files(tmp_path)] == ["b.csv", "a.TUM"]
    with pytest.raises(DataError, match="no such file or folder"):
        recording_files(tmp_path / "none")
    with pytest.raises(DataError, match="holds no recordings"):
        recording_files(_empty(tmp_path))
    with pytest.raises(DataError, match="is no recording"):
        list(read(tmp_path / "notes.md"))


def _empty(folder: Path) -> Path:
    (folder / "empty").mkdir()
    return folder / "empty"


def motive(version: str, rows: np.ndarray, *, units="Millimeters") -> str:
    """An export of one rigid body and a marker, in the header of a version."""
    titled = version >= "1.24"
    lead = ["", "Type"] if titled else ["", ""]
    bodies, marker = ["Rigid Body"] * 7, ["Rigid Body Marker"] * 3
    head = [
        [f"Format Version,{version},Take Name,drop 1,Capture Frame Rate,240.000000,Export Frame Rate,240.000000,"
         f"Rotation Type,Quaternion,Length Units,{units},Coordinate Space,Global"],
        [""],
        lead + bodies + marker,
        (["", "Name"] if titled else ["", ""]) + ["rod"] * 7 + ["rod:Marker1"] * 3,
        (["", "ID"] if titled else ["", ""]) + ['"A1"'] * 10,
        *([["", "Parent"] + [""] * 10] if version >= "1.25" else []),
        ["", ""] + ["Rotation"] * 4 + ["Position"] * 6,
        ["Frame", "Time (Seconds)", "X", "Y", "Z", "W", "X", "Y", "Z", "X", "Y", "Z"],
    ]  # fmt: skip
    lines = [",".join(row) for row in head]
    for k, row in enumerate(rows):
        lines.append(
            ",".join([str(k), f"{k / 240:.6f}", *("" if np.isnan(x) else f"{x:.7f}" for x in row), "0", "0", "0"])
        )
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("version", ["1.21", "1.23", "1.24", "1.25"])
def test_motive(tmp_path, version):
    wanted = SPACE[0]
    assert wanted.quaternion is not None
    rows = np.column_stack((np.roll(wanted.quaternion, -1, axis=1), 1e3 * wanted.position))
    path = tmp_path / "drop.csv"
    path.write_text(motive(version, rows), encoding="utf-8-sig")
    (found,) = read(path, Layout())
    np.testing.assert_allclose(found.position, 1e3 * wanted.position, atol=1e-6)
    np.testing.assert_allclose(found.quaternion, wanted.quaternion, atol=1e-6)
    assert (found.unit, found.order, found.name) == ("mm", "wxyz", "drop")
    assert found.time[1] == pytest.approx(1 / 240, abs=1e-6)
    with pytest.raises(UnknownNameError, match="rigid body"):
        list(read(path, Layout(body="plate")))


def test_init_asks_for_the_body_of_motive(tmp_path):
    path = tmp_path / "drop.csv"
    first, blank, *lines = motive("1.24", np.column_stack((np.ones((3, 4)) / 2, np.zeros((3, 3))))).splitlines()
    path.write_text("\n".join([first, blank, *lines]))
    assert [one.name for one in propose(path).settings if one.value == "???"] == ["mass", "shape"]
    cells = [line.split(",") for line in lines]
    both = [",".join([*row[:9], *(cell.replace("rod", "plate") for cell in row[2:9]), *row[9:]]) for row in cells]
    path.write_text("\n".join([first, blank, *both]))
    asked = [one for one in propose(path).settings if one.value == "???"]
    assert [one.name for one in asked] == ["body", "mass", "shape"]
    assert "rod or plate" in asked[0].comment
    (found,) = read(path, Layout(body="plate"))
    assert len(found.time) == 3


def test_motive_exports_that_are_no_use(tmp_path):
    path, good = tmp_path / "drop.csv", motive("1.23", np.zeros((3, 7)))
    for change, message in (
        (("Quaternion", "XYZ"), "export them as Quaternion"),
        (("Rigid Body,", "Marker,"), "no rigid body"),
        (("Frame,", "Number,"), "no line of columns begins with Frame"),
        (("X,Y,Z,W", "X,Y,Z,Q"), "lacks Rotation W"),
    ):
        path.write_text(good.replace(*change))
        with pytest.raises(DataError, match=message):
            list(read(path, Layout()))


def test_tum(tmp_path):
    path, wanted = tmp_path / "drop.txt", SPACE[1]
    seen = wanted.seen
    assert wanted.quaternion is not None
    rows = np.column_stack((wanted.time, wanted.position, np.roll(wanted.quaternion, -1, axis=1)))[seen]
    np.savetxt(path, rows, header="timestamp tx ty tz qx qy qz qw", fmt="%.9f")
    (found,) = read(path, Layout())
    np.testing.assert_allclose(found.rotation, rows[:, 4:], atol=1e-8)
    assert found.order == "xyzw"
    path.write_text("# nothing\n")
    with pytest.raises(DataError, match="the file is empty"):
        list(read(path, Layout()))
    for content, message in (
        ("0 1 2 3\n", "is no TUM text, as which \\.txt is read: frame 1 has 4 words,"),
        ("it hit the wall at 3 s !\n", "holds no frames"),
    ):
        path.write_text(content)
        with pytest.raises(DataError, match=message):
            list(read(path, Layout()))


@pytest.mark.parametrize("dimensions", [2, 3])
def test_markers_give_the_pose(dimensions):
    rng = np.random.default_rng(0)
    arms = rng.normal(size=(5, dimensions))
    arms -= arms.mean(0)
    recording = FLAT[0] if dimensions == 2 else SPACE[0]
    if recording.quaternion is None:
        assert recording.angle is not None
        c, s = np.cos(recording.angle), np.sin(recording.angle)
        R = np.stack((np.stack((c, -s), -1), np.stack((s, c), -1)), -2)
    else:
        R = matrices(recording.quaternion, "wxyz")
    markers = recording.position[:, None] + (R @ arms.T).transpose(0, 2, 1)
    found = pose_of_markers(markers, recording.time, name="a", source="a")
    seen = recording.seen
    np.testing.assert_allclose(found.position, recording.position, atol=1e-12)
    if recording.angle is not None:
        assert found.angle is not None
        turned = found.angle - recording.angle
        np.testing.assert_allclose(turn(turned[seen] - turned[seen][0]), 0, atol=1e-9)
    else:
        assert found.quaternion is not None
        np.testing.assert_allclose(matrices(found.quaternion, "wxyz")[seen] @ R[seen][0], R[seen], atol=1e-9)


@pytest.mark.parametrize(("suffix", "library"), [(".h5", "h5py"), (".c3d", "ezc3d"), (".mcap", "rosbags")])
def test_formats_of_the_extra_ask_for_it(tmp_path, monkeypatch, suffix, library):
    for name in [library, *(name for name in sys.modules if name.startswith("contactlearn.data.recordings.readers."))]:
        if name != "contactlearn.data.recordings.readers":
            monkeypatch.setitem(sys.modules, name, None) if name == library else monkeypatch.delitem(sys.modules, name)
    path = tmp_path / f"drop{suffix}"
    path.touch()
    with pytest.raises(ContactLearnError, match=rf"need {library}.*contactlearn\[tracks\]"):
        list(read(path))


def test_hdf5(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "all.h5", "w") as file:
        for r in SPACE:
            group = file.create_group(r.name)
            group["time"], group["position"], group["quaternion"] = r.time, r.position, r.quaternion
    for found, wanted in zip(read(tmp_path / "all.h5"), SPACE, strict=True):
        same(found, wanted)


def test_c3d(tmp_path):
    ezc3d = pytest.importorskip("ezc3d")
    arms, wanted = np.array(((30.0, 0, 0), (-20, 10, 0), (0, -20, 10), (-10, 10, -10))), SPACE[0]
    assert wanted.quaternion is not None
    R, seen = matrices(wanted.quaternion, "wxyz"), wanted.seen
    markers = 1e3 * wanted.position[:, None] + (R @ arms.T).transpose(0, 2, 1)
    file = ezc3d.c3d()
    about = file["parameters"]["POINT"]
    about["RATE"]["value"], about["LABELS"]["value"], about["UNITS"]["value"] = [250.0], ("a", "b", "c", "d"), ["mm"]
    points = np.ones((4, 4, len(markers)))
    points[:3] = markers.transpose(2, 1, 0)
    file["data"]["points"] = points
    file.write(str(tmp_path / "a.c3d"))
    (found,) = read(tmp_path / "a.c3d")
    assert found.unit == "mm"
    np.testing.assert_allclose(found.position[seen], 1e3 * wanted.position[seen], atol=1e-3)  # single precision


def stamped(store, recording, **numbered):
    """Time in ns and PoseStamped of each seen frame; ROS 1 numbers its headers."""
    kinds = store.types
    for k in np.flatnonzero(recording.seen):
        time, place, (w, *axis) = recording.time[k], recording.position[k], recording.quaternion[k]
        stamp = kinds["builtin_interfaces/msg/Time"](sec=int(time), nanosec=round(1e9 * (time - int(time))))
        header = kinds["std_msgs/msg/Header"](stamp=stamp, frame_id="world", **numbered)
        point = kinds["geometry_msgs/msg/Point"](*map(float, place))
        turned = kinds["geometry_msgs/msg/Quaternion"](*map(float, axis), float(w))
        pose = kinds["geometry_msgs/msg/Pose"](position=point, orientation=turned)
        yield int(1e9 * time), kinds[POSE](header=header, pose=pose)


@pytest.mark.parametrize("kind", ["ROS 1", "SQLITE3", "MCAP"])
def test_ros_bags(kind, tmp_path):
    rosbag1, rosbag2 = pytest.importorskip("rosbags.rosbag1"), pytest.importorskip("rosbags.rosbag2")
    from rosbags.typesys import Stores, get_typestore

    one, wanted = kind == "ROS 1", SPACE[0]
    store = get_typestore(Stores.ROS1_NOETIC if one else Stores.LATEST)
    path = tmp_path / ("drop.bag" if one else "drop")
    plugin = {} if one else {"version": 9, "storage_plugin": rosbag2.StoragePlugin[kind]}
    with (rosbag1 if one else rosbag2).Writer(path, **plugin) as bag:
        topic = bag.add_connection("/body", POSE, typestore=store)
        for time, message in stamped(store, wanted, **({"seq": 0} if one else {})):
            bag.write(topic, time, (store.serialize_ros1 if one else store.serialize_cdr)(message, POSE))
    (file,) = recording_files(tmp_path)
    (found,) = read(file)
    np.testing.assert_allclose(found.time, wanted.time[wanted.seen], atol=1e-9)
    np.testing.assert_array_equal(found.position, wanted.position[wanted.seen])
    np.testing.assert_array_equal(found.quaternion, wanted.quaternion[wanted.seen])
    assert (found.order, found.unit) == ("wxyz", "m")


@pytest.mark.parametrize("kind", ["ros2 topic echo --csv", "a header", "rostopic echo -p", "a transform"])
def test_poses_of_ros_as_text(kind, tmp_path):
    """Whole seconds beside nanoseconds, without a header or with it; a header that begins as a comment."""
    one = SPACE[0]
    stamps = [round(1e9 * time) + 1_747_301_822_416_978_359 for time in one.time]
    poses = [
        ",".join(map(repr, row)) for row in np.column_stack((one.position, np.roll(one.quaternion, -1, 1))).tolist()
    ]
    poses = [line for line, seen in zip(poses, one.seen, strict=True) if seen]
    stamps = [stamp for stamp, seen in zip(stamps, one.seen, strict=True) if seen]
    header = [*(f"pose.position.{axis}" for axis in "xyz"), *(f"pose.orientation.{axis}" for axis in "xyzw")]
    path = tmp_path / "pose.csv"
    if kind == "rostopic echo -p":
        head = ",".join(["%time", "field.header.frame_id", *(f"field.{name}" for name in header)]) + "\n"
        lines = [f"{stamp},map,{pose}" for stamp, pose in zip(stamps, poses, strict=True)]
    elif kind == "a transform":  # the times of arrival are those of a network, and dates of their own
        names = ["time", ".header.seq", ".header.stamp.secs", ".header.stamp.nsecs", ".child_frame_id"]
        names += [f".transform.translation.{axis}" for axis in "xyz"]
        head = ",".join([*names, *(f".transform.rotation.{axis}" for axis in "xyzw")]) + "\n"
        lines = [
            f"2020/03/12/19:06:40.{k:03d}000,{k},{s // 10**9},{s % 10**9},cube,{pose}"
            for k, (s, pose) in enumerate(zip(stamps, poses, strict=True))
        ]
    else:
        head = ",".join(["header.stamp.sec", "header.stamp.nanosec", "header.frame_id", *header]) + "\n"
        head = head if kind == "a header" else ""
        lines = [f"{s // 10**9},{s % 10**9},map,{pose}" for s, pose in zip(stamps, poses, strict=True)]
    path.write_text(head + "\n".join(lines) + "\n")
    settings = {setting.name: setting.value for setting in propose(path).settings}
    assert [name for name, value in settings.items() if value == "???"] == ["mass", "shape"]
    columns = {name.removeprefix("columns."): value for name, value in settings.items() if name[:8] == "columns."}
    (found,) = read(path, Layout(**columns))
    np.testing.assert_allclose(np.diff(found.time), np.diff(one.time[one.seen]), atol=1e-6)
    np.testing.assert_allclose(found.position, one.position[one.seen], atol=1e-12)
    turned = np.roll(one.rotation[one.seen], -1 if found.order == "xyzw" else 0, 1)
    np.testing.assert_allclose(found.rotation, turned, atol=1e-12)
    if kind == "ros2 topic echo --csv":
        assert (found.order, found.unit) == ("xyzw", "m")


def two_bodies():
    time = np.arange(60) / 100
    for name in ("drop1", "drop2"):
        for body, speed in (("red", 1.0), ("blue", 2.0)):
            columns = {"time": time, "x": speed * time, "y": 1 - 4.905 * time**2, "theta": 3 * speed * time}
            yield pd.DataFrame(columns).assign(recording=name, thing=body)


def wide(frames):
    red, blue = (
        pd.concat([one for one in frames if one.thing.iloc[0] == body]).reset_index() for body in ("red", "blue")
    )
    parts = [one[["x", "y", "theta"]].add_suffix(f"_{body}") for one, body in ((red, "red"), (blue, "blue"))]
    return pd.concat([red[["time", "recording"]], *parts], axis=1)


@pytest.mark.parametrize(
    "arranged",
    [wide, pd.concat, lambda frames: pd.concat(frames).sort_values(["recording", "time"], kind="stable")],
    ids=["wide names", "one after the other", "interleaved"],
)
def test_of_two_bodies_in_a_file_one_is_asked_for(tmp_path, arranged):
    path = tmp_path / "takes.csv"
    arranged([*two_bodies()]).to_csv(path, index=False)
    with pytest.raises(DataError, match=r"has 2 bodies .*; state data\.body=red or data\.body=blue$"):
        [*fail(read(path))]
    for body, speed in (("red", 1.0), ("blue", 2.0)):
        found = [*fail(read(path, Layout(body=body)))]
        assert [one.name for one in found] == ["drop1", "drop2"]
        for one in found:
            np.testing.assert_allclose(one.position[:, 0], speed * np.arange(60) / 100)


def fail(recordings):
    """Raise the errors of recordings that were read."""
    for one in recordings:
        if isinstance(one, DataError):
            raise one
        yield one


@pytest.mark.parametrize("column", ["frame", "time"])
def test_frame_numbers_need_a_rate_and_show_dropped_frames(tmp_path, column):
    path, numbers = tmp_path / "a.csv", np.delete(np.arange(50), 20)
    pd.DataFrame({column: numbers, "x": 1.0 * numbers, "y": 0.0, "theta": 0.1}).to_csv(path, index=False)
    with pytest.raises(DataError, match=r"frames are numbered, and have no times; state data\.rate"):
        [*fail(read(path))]
    (found,) = fail(read(path, Layout(rate=240.0)))
    np.testing.assert_allclose(found.time, numbers / 240)


def test_dates_with_times_are_times(tmp_path):
    path, time = tmp_path / "a.csv", np.arange(50) / 250
    stamps = pd.Timestamp("2024-05-03 23:59:59.9") + pd.to_timedelta(time, unit="s")
    pd.DataFrame({"time": stamps, "x": time, "y": 0.0, "theta": 0.1}).to_csv(path, index=False)
    (found,) = fail(read(path))
    np.testing.assert_allclose(found.time, time, atol=1e-9)
    path.write_text(path.read_text().replace("2024-05-04 00:00:00.020", "noon"))
    with pytest.raises(DataError, match=r"row 31, column time: must be a date with a time, got 'noon'"):
        [*fail(read(path))]


@pytest.mark.parametrize(
    ("form", "start"),
    [("{h:02d}:{m:02d}:{s:06.3f}", 86399.9), ("{h}:{m:02d}:{s:06.3f}", 34199.9), ("{m:02d}:{s:06.3f}", 1799.9)],
    ids=["midnight", "an hour of one digit", "minutes"],
)
def test_times_of_day_are_times(form, start, tmp_path):
    """Rounded to ms at 240 Hz, steps are 4 and 5 ms: the even times of the frames are restored."""
    path, time = tmp_path / "a.txt", np.arange(60) / 240
    clock = [divmod(round(start + t, 3) % 86400, 60) for t in time]
    stamps = [form.format(h=int(m // 60), m=int(m % 60), s=s) for m, s in clock]
    pd.DataFrame({"time": stamps, "x": time, "y": 0.0, "theta": 0.1}).to_csv(path, index=False, sep="\t")
    (found,) = fail(read(path, Layout(rate=240.0)))
    np.testing.assert_allclose(found.time - found.time[0], time, atol=2e-4)
    np.testing.assert_allclose(np.diff(found.time), 1 / 240, rtol=2e-3)
    path.write_text(path.read_text().replace(stamps[30], "noon"))
    with pytest.raises(DataError, match=r"row 31, column time: must be a time of day as '.*' is, got 'noon'"):
        [*fail(read(path))]


def test_stamps_off_the_even_times_by_more_than_rounding_stay():
    even = np.arange(60) / 240
    late = even + np.where(np.arange(60) % 7 == 3, 0.002, 0.0)
    for time in (np.round(late, 3), even, np.round(even, 9)):
        np.testing.assert_array_equal(on_grid(time), time)
    dropped = np.delete(even, [10, 11, 12])
    np.testing.assert_allclose(np.diff(on_grid(np.round(dropped, 3))), np.diff(dropped), atol=2e-5)


@pytest.mark.parametrize(("unit", "factor"), [("t [ms]", 1e3), ("t_us", 1e6), ("time (min)", 1 / 60)])
def test_recordings_of_a_spreadsheet(tmp_path, unit, factor):
    """Semicolons, decimal commas, and times in the unit of their name."""
    frames = pd.concat([*two_bodies()][:1]).drop(columns=["thing", "recording"])
    written = frames.assign(time=factor * frames.time).rename(columns={"time": unit})
    written.to_csv(tmp_path / "take.csv", sep=";", decimal=",", index=False)
    (found,) = read(tmp_path / "take.csv", Layout(time=unit))
    np.testing.assert_allclose(found.time, frames.time, atol=1e-12)
    np.testing.assert_allclose(found.position, frames[["x", "y"]])


# --- Exports, turns, arrays ------------------------------------------------------------------------

PLACES = np.array(((0.05, 0.0, 0.0), (0.0, 0.04, 0.01), (-0.03, 0.0, 0.02), (0.0, -0.05, -0.01)))
NAMES = ("box_a", "box_b", "box_c", "box_d")


def whole() -> Recording:
    """A recording in space without lost frames, scalar first."""
    one = SPACE[1]
    seen = one.seen
    assert one.quaternion is not None
    frames = {"position": one.position[seen], "quaternion": one.quaternion[seen]}
    return Recording(name="a", source="a", time=np.arange(seen.sum()) / 250, order="wxyz", **frames)


def marked(one: Recording) -> np.ndarray:
    """Markers [T, 4, 3] of a body."""
    assert one.quaternion is not None
    return one.position[:, None] + (matrices(one.quaternion, "wxyz") @ PLACES.T).transpose(0, 2, 1)


def text(rows, separator: str) -> str:
    return "".join(separator.join(f"{cell:.9g}" for cell in row) + "\n" for row in rows)


def exported(kind: str, folder: Path) -> Path:
    """A file as the software writes it, in mm."""
    one = whole()
    frames, n = 1000 * marked(one).reshape(len(one), -1), len(one)
    number, R = np.arange(1, n + 1), matrices(one.quaternion, "wxyz")
    if kind.startswith("qualisys"):
        key = "BODY_NAMES\tbox" if kind.startswith("qualisys bodies") else "MARKER_NAMES\t" + "\t".join(NAMES)
        head = f"NO_OF_FRAMES\t{n}\nNO_OF_CAMERAS\t8\nFREQUENCY\t250\nTIME_STAMP\t2024-04-15, 10:39:38\n{key}\n"
        if kind.startswith("qualisys bodies"):
            rotation = "\t".join(f"Rot[{k}]" for k in range(9))
            head += f"{'box ' * ('named' in kind)}X\tY\tZ\tRoll\tPitch\tYaw\tResidual\t{rotation}\n"
            if "everywhere" in kind:  # before the name of each column
                head = re.sub(r"(?<=[\n\t])(?=[XYZ]\t|R[a-z])", "box ", head)
            turned = R.transpose(0, 2, 1).reshape(n, 9)
            frames = np.column_stack((1000 * one.position, np.zeros((n, 4)), turned))
        else:
            head += "TRAJECTORY_TYPES\t" + "\t".join(["Measured"] * 4) + "\n"
        if kind == "qualisys timed":
            frames = np.column_stack((number, one.time, frames))
        content, name = head + text(frames, "\t"), "take.tsv"
    elif kind == "vicon":
        above = ",," + ",".join(f"box:{one},," for one in NAMES)
        units = ",," + ",".join(["mm"] * 12)
        rows = np.column_stack((number, 0 * number, frames))
        head = f"Trajectories\n250\n{above}\nFrame,Sub Frame,{','.join(['X,Y,Z'] * 4)}\n{units}\n"
        content, name = head + text(rows, ",") + "\nModel Outputs\n250\n", "take.csv"
    elif kind == "vicon objects":
        head = "Objects\n250\n,,Global Angle (Quaternion) box:box,,,,,,\nFrame,Sub Frame,RX,RY,RZ,RW,TX,TY,TZ\n"
        head += ",,,,,,mm,mm,mm\n"
        rows = np.column_stack((number, 0 * number, np.roll(one.quaternion, -1, axis=1), 1000 * one.position))
        content, name = head + text(rows, ","), "take.csv"
    else:
        raise AssertionError(kind)
    path = folder / name
    path.write_text(content)
    return path


@pytest.mark.parametrize(
    "kind",
    [
        "qualisys",
        "qualisys timed",
        "qualisys bodies",
        "qualisys bodies named",
        "qualisys bodies everywhere",
        "vicon",
        "vicon objects",
    ],
)
def test_exports_of_space(kind, tmp_path):
    """Read without any setting: place, turns, unit and times."""
    (found,), wanted = read(exported(kind, tmp_path), Layout()), whole()
    np.testing.assert_allclose(found.time, found.time[0] + wanted.time, atol=1e-9)
    assert found.unit == "mm"
    assert found.quaternion is not None
    assert wanted.quaternion is not None
    order = found.order or "rows"
    R, true = matrices(found.quaternion, order), matrices(wanted.quaternion, "wxyz")
    np.testing.assert_allclose(R @ R[0].T, true @ true[0].T, atol=1e-6)
    if found.markers is None:
        np.testing.assert_allclose(found.position, 1000 * wanted.position, atol=1e-5)
    assert propose(tmp_path / ("take.tsv" if "qualisys" in kind else "take.csv")).source == "tracks"


@pytest.mark.parametrize("kind", ["tracker", "tracker commas", "deeplabcut", "sleap"])
def test_exports_of_the_plane(kind, tmp_path):
    """A point that a camera follows; below a likelihood it is lost."""
    t = np.arange(40) / 100
    x, y = 2 * t, 1 + 3 * t - 4.9 * t**2
    if kind.startswith("tracker"):
        rows = text(np.column_stack((t, x, y)), "\t")
        content, name = "mass A\t\t\nt\tx\ty\n" + (rows.replace(".", ",") if "commas" in kind else rows), "ball.txt"
    elif kind == "deeplabcut":
        head = "scorer,net,net,net\nbodyparts,ball,ball,ball\ncoords,x,y,likelihood\n"
        rows = np.column_stack((np.arange(40), x, y, np.where(np.arange(40) == 7, 0.1, 0.99)))
        content, name = head + text(rows, ","), "ballDLC.csv"
    else:
        head = "track,frame_idx,instance.score,ball.x,ball.y,ball.score\n"
        rows = text(np.column_stack((np.arange(40), 0 * t + 0.9, x, y, np.where(np.arange(40) == 7, 0.1, 0.99))), ",")
        content, name = head + "".join(f"track_0,{row}\n" for row in rows.splitlines()), "ball.csv"
    path = tmp_path / name
    path.write_text(content)
    assert propose(path).source == "tracks"
    if not kind.startswith("tracker"):
        with pytest.raises(DataError, match=r"state data\.rate"):
            list(read(path, Layout()))
    (found,) = read(path, Layout(rate=None if kind.startswith("tracker") else 100))
    np.testing.assert_allclose(found.time - found.time[0], t, atol=1e-9)
    lost = np.arange(40) == (-1 if kind.startswith("tracker") else 7)
    np.testing.assert_array_equal(found.seen, ~lost)
    np.testing.assert_allclose(found.position[~lost], np.column_stack((x, y))[~lost], atol=1e-8)


def test_tracks_of_sleap_are_asked(tmp_path):
    head, path = "track,frame_idx,instance.score,ball.x,ball.y,ball.score\n", tmp_path / "balls.csv"
    rows = [f"track_{one},{k},0.9,{100 * one + k},{0.1 * k**2},0.9\n" for k in range(40) for one in range(2)]
    path.write_text(head + "".join(rows))
    settings = {one.name: one for one in propose(path).settings}
    assert settings["body"].comment == "track_0 or track_1, in column 'track'"
    with pytest.raises(DataError, match=r"has 2 bodies in column 'track'; state data\.body=track_0 or"):
        list(read(path, Layout(rate=100)))
    (found,) = read(path, Layout(rate=100, body="track_1"))
    np.testing.assert_array_equal(found.position[:, 0], 100 + np.arange(40))


def test_bodies_of_an_export_are_asked(tmp_path):
    path = exported("vicon objects", tmp_path)
    lines = path.read_text().splitlines()
    two = [f"{line},{','.join(line.split(',')[2:])}".replace("box:box,", "box:box,", 1) for line in lines[2:]]
    two[0] = ",,box:box,,,,,,,ball:ball,,,,,,"
    path.write_text("\n".join([*lines[:2], *two]) + "\n")
    with pytest.raises(DataError, match=r"has the bodies box, ball; state data\.body=box or data\.body=ball"):
        list(read(path, Layout()))
    (found,) = read(path, Layout(body="ball"))
    np.testing.assert_allclose(found.position, 1000 * whole().position, atol=1e-5)


@pytest.mark.parametrize("plate", [5, 100])
def test_the_section_of_markers_stands_behind_that_of_a_force_plate(plate, tmp_path):
    """However long the other section is, frames have the rate of their own one."""
    path = exported("vicon", tmp_path)
    head = "Devices,,,,\n1000,,,,\n,,Force Plate - Force,,\nFrame,Sub Frame,Fx,Fy,Fz\n,,N,N,N\n"
    forces = "".join(f"{k // 5 + 1},{k % 5},0.1,0.2,{k}\n" for k in range(plate))
    path.write_text(head + forces + "\n" + path.read_text())
    (found,), wanted = read(path, Layout()), whole()
    np.testing.assert_allclose(np.diff(found.time), np.diff(wanted.time), atol=1e-9)
    assert len(found) == len(wanted)
    assert len(found.markers) == len(NAMES)
    path.write_text(head + forces)
    with refused(["has the sections Devices, and none of", "export Trajectories as well"]):
        propose(path)


def test_subjects_of_an_export_are_asked(tmp_path):
    """Markers of a racket and of a ball: those of one subject are one body, and a single one has no orientation."""
    path = exported("vicon", tmp_path)
    text = path.read_text()
    path.write_text(text.replace(f"box:{NAMES[0]}", f"ball:{NAMES[0]}"))
    with pytest.raises(DataError, match=r"has points of ball, box; state data\.body=ball or data\.body=box"):
        list(read(path, Layout()))
    assert [one.value for one in propose(path).settings if one.name == "body"] == ["???"]
    (found,) = read(path, Layout(body="ball"))
    assert found.markers is None
    assert not found.quaternion[:, 1:].any()  # not measured
    (box,) = read(path, Layout(body="box"))
    assert len(box.markers) == len(NAMES) - 1


@pytest.mark.parametrize("objects", [1, 2, 11])
def test_video_analysis_of_logger_pro(objects, tmp_path):
    """One of several objects in cm, with velocities of the program beside its places."""
    t = np.arange(40) / 60
    head, values = ["Video Analysis: Time (s)"], [t]
    for k in range(1, objects + 1):
        number = f" {k}" * (k > 1)
        head += [f"Video Analysis: {name}{number} ({unit})" for name, unit in
                 (("X", "cm"), ("Y", "cm"), ("X Velocity", "cm/s"), ("Y Velocity", "cm/s"))]  # fmt: skip
        values += [100.0 * k + t, 200.0 - 490 * t**2, 1 + 0 * t, -981 * t]
    path = tmp_path / "drop.csv"
    path.write_text(",".join(head) + "\n" + text(np.column_stack(values), ","))
    assert [one.name for one in propose(path).settings if one.value == "???"] == [
        *["body"] * (objects > 1), "mass", "shape",
    ]  # fmt: skip
    if objects > 1:
        with refused(["has points of object_1, object_2", "state data.body=object_1 or data.body=object_2"]):
            list(read(path, Layout()))
    (found,) = read(path, Layout(body="object_1" if objects > 1 else None))
    (named,) = read(path, Layout(time=head[0], position=head[1:3]))
    for one in (found, named):
        assert one.unit == "cm"
        np.testing.assert_allclose(one.time, t)
        np.testing.assert_allclose(one.position, np.column_stack(values[1:3]))
        assert not one.quaternion


@pytest.mark.parametrize("name", ["toss.7z", "tosses.tar"])
def test_a_compressed_file_is_to_be_unpacked(tmp_path, name):
    path = tmp_path / name
    path.touch()
    for use in (propose, recording_files, lambda file: list(read(file))):
        with pytest.raises(DataError, match="is compressed; unpack it first"):
            use(path)


def test_bodies_of_qualisys_whose_names_begin_their_columns(tmp_path):
    """Of two bodies the stated one; frames in which it is lost are zeros."""
    path = exported("qualisys bodies named", tmp_path)
    lines = path.read_text().splitlines()
    at = next(k for k, line in enumerate(lines) if line.startswith("box X"))
    lines[at - 1] += "\tlid"
    lost = "\t".join(["0.000"] * 16)
    doubled = [f"{line}\t{lost if k == 3 else line}" for k, line in enumerate(lines[at + 1 :])]
    path.write_text("\n".join([*lines[:at], f"{lines[at]}\t{lines[at].replace('box', 'lid')}", *doubled]) + "\n")
    with pytest.raises(DataError, match=r"has the bodies box, lid; state data\.body=box or data\.body=lid"):
        list(read(path, Layout()))
    (found,) = read(path, Layout(body="lid"))
    assert np.flatnonzero(~found.seen).tolist() == [3]
    assert found.quaternion is not None
    assert np.isfinite(matrices(found.quaternion, "rows")).all((1, 2)).sum() == len(found) - 1
    np.testing.assert_allclose(found.position[4:], 1000 * whole().position[4:], atol=1e-5)


def test_nine_numbers_that_are_no_turn_are_refused():
    mirrored = np.tile(np.diag((1.0, 1.0, -1.0)).ravel(), (20, 1))
    with pytest.raises(DataError, match="must be a matrix of a right-handed turn"):
        Recording(name="a", source="a", time=np.arange(20.0), position=np.zeros((20, 3)), quaternion=mirrored)


@pytest.mark.parametrize("order", ["xyz", "zyx", "zxy"])
def test_the_order_of_turns_is_among_the_steady_ones(order, tmp_path):
    one = whole()
    spin, q0 = np.array((3.0, -7.0, 5.0)), Rotation.from_rotvec((0.3, 0.2, -0.5))
    turned = Rotation.from_rotvec(one.time[:, None] * spin) * q0
    angles = turned.as_euler(order, degrees=True)[:, [order.index(axis) for axis in "xyz"]]
    frame = pd.DataFrame(angles, columns=["roll [deg]", "pitch [deg]", "yaw [deg]"])
    frame = frame.assign(time=one.time, **dict(zip("xyz", one.position.T, strict=True)))
    frame.to_csv(tmp_path / "box.csv", index=False)
    (found,) = read(tmp_path / "box.csv", Layout())
    assert found.quaternion is not None
    assert order in orders_of([found])
    assert len(orders_of([found])) <= 2
    np.testing.assert_allclose(matrices(found.quaternion, order), turned.as_matrix(), atol=1e-8)
    entries = pd.DataFrame(turned.as_matrix().reshape(-1, 9), columns=[f"r{i}{j}" for i in "123" for j in "123"])
    frame[["time", "x", "y", "z"]].join(entries).to_csv(tmp_path / "matrix.csv", index=False)
    (found,) = read(tmp_path / "matrix.csv", Layout())
    assert found.quaternion is not None
    np.testing.assert_allclose(matrices(found.quaternion, "rows"), turned.as_matrix(), atol=1e-8)


@pytest.mark.parametrize(
    "names", [("rvec_x", "rvec_y", "rvec_z"), ("rotvec0", "rotvec1", "rotvec2"), ("rx", "ry", "rz")]
)
@pytest.mark.parametrize("place", ["tvec_{}", "t{}", "{}"])
def test_vectors_of_rotation(names, place, tmp_path):
    """As OpenCV finds them; rx, ry and rz may also be turns, of which the steadier reading is taken."""
    one, spin = whole(), np.array((3.0, -7.0, 5.0))
    turned = Rotation.from_rotvec(one.time[:, None] * spin) * Rotation.from_rotvec((0.3, 0.2, -0.5))
    columns = dict(zip(names, turned.as_rotvec().T, strict=True))
    columns |= {place.format(axis): one.position[:, k] for k, axis in enumerate("xyz")}
    pd.DataFrame({"time": one.time, **columns}).to_csv(tmp_path / "box.csv", index=False)
    stated = stated_by_header(tmp_path / "box.csv")
    (found,) = read(tmp_path / "box.csv", track_options(**stated).layout)
    np.testing.assert_allclose(found.position, one.position)
    order = found.order or orders_of([found])[0]
    assert order == "rotvec"
    np.testing.assert_allclose(matrices(found.quaternion, order), turned.as_matrix(), atol=1e-8)


@pytest.mark.parametrize(
    ("title", "suffix", "header", "mark"),
    [
        ("run {}", ".txt", "each", " "),
        ("# toss {}", ".txt", "top", "\t"),
        ("=== Trial {} ===", ".csv", "top", ","),
        ("[drop {}] (red die)", ".csv", "each", ";"),
        ("# Wurf Nr. {}", ".txt", "comment", " "),
    ],
)
def test_titles_stand_above_recordings(title, suffix, header, mark, tmp_path):
    path, names = tmp_path / f"all{suffix}", mark.join(("t", "x", "y", "theta"))
    lines = {"top": [names], "comment": [f"# {names}"], "each": []}[header]
    for k, one in enumerate(FLAT, 1):
        lines += [title.format(k), *[names] * (header == "each")]
        rows = np.column_stack((one.time, one.position, one.angle))[one.seen]
        lines += [mark.join(f"{value:.9f}" for value in row) for row in rows] + [""]
    path.write_text("\n".join(lines))
    found = [*fail(read(path, track_options(**stated_by_header(path)).layout))]
    assert [one.name for one in found] == ["1", "2"]
    for one, wanted in zip(found, FLAT, strict=True):
        np.testing.assert_allclose(one.position, wanted.position[wanted.seen], atol=1e-8)
        np.testing.assert_allclose(one.angle, wanted.angle[wanted.seen], atol=1e-8)


def test_the_same_comment_stands_above_recordings(tmp_path):
    """As Kinovea writes trajectories, with times of hours, minutes, seconds and milliseconds."""
    path, lines = tmp_path / "all.txt", list[str]()
    for one in FLAT:
        lines += ["#Kinovea Trajectory data export", "#T X Y"]
        stamps = [round(1e3 * t) for t in one.time[one.seen]]
        clock = [f"0:{t // 60000:02d}:{t // 1000 % 60:02d}:{t % 1000:03d}" for t in stamps]
        places = one.position[one.seen]
        lines += [f"{t} {x:.9f} {y:.9f}" for t, (x, y) in zip(clock, places, strict=True)] + [""]
    path.write_text("\n".join(lines))
    assert [one.name for one in propose(path).settings if one.value == "???"] == ["mass", "shape"]
    found = [*fail(read(path, track_options(**stated_by_header(path)).layout))]
    assert [one.name for one in found] == ["1", "2"]
    for one, wanted in zip(found, FLAT, strict=True):
        np.testing.assert_allclose(one.position, wanted.position[wanted.seen], atol=1e-8)
        wanted_time = wanted.time[wanted.seen]
        np.testing.assert_allclose(one.time - one.time[0], wanted_time - wanted_time[0], atol=1e-3)


def test_a_pause_parts_recordings(tmp_path):
    """Whether frames are missing in it, or lost; a shorter gap does not part them."""
    one = whole()
    time = np.concatenate((one.time, one.time + one.time[-1] + 1, one.time + 2 * one.time[-1] + 1.2))
    rows = np.tile(np.column_stack((one.position, one.quaternion)), (3, 1))
    pause = np.arange(one.time[-1] + 0.01, one.time[-1] + 1, 0.01)
    rows = np.column_stack((time, rows))
    empty = np.column_stack((pause, np.full((len(pause), 7), np.nan)))
    for name, content in (("gap", rows), ("lost", np.concatenate((rows, empty)))):
        content = content[content[:, 0].argsort()]
        path = tmp_path / f"{name}.csv"
        pd.DataFrame(content, columns=["time", "x", "y", "z", "qw", "qx", "qy", "qz"]).to_csv(path, index=False)
        found = [*fail(read(path))]
        assert [each.name for each in found] == [f"{name} 1", f"{name} 2"]
        assert [len(each) for each in found] == [len(one), 2 * len(one)]


def test_environments_of_a_simulator_are_recordings(tmp_path):
    """A frame rate that the name of the column of times contradicts is refused, with what may be meant."""
    one, path = whole(), tmp_path / "log.csv"
    names = ["x", "y", "z", "qw", "qx", "qy", "qz"]
    poses = pd.DataFrame(np.column_stack((one.position, one.quaternion)), columns=names)
    for unit, factor in (("ms", 1e3), ("s", 1.0), ("s", 1e3)):
        frames = poses.assign(**{f"time [{unit}]": factor * one.time})
        pd.concat([frames.assign(env=k) for k in (0, 1)]).to_csv(path, index=False)
        if unit == "s" and factor > 1:
            with refused(["'time [s]'", "4 s apart", "are they in ms?", "time [ms]"]):
                propose(path)
            continue
        assert "body" not in {setting.name for setting in propose(path).settings}
        stated = stated_by_header(path)
        found = [*fail(read(path, track_options(**stated).layout))]
        assert [each.name for each in found] == ["0", "1"]
        np.testing.assert_allclose(found[1].time, one.time, atol=1e-9)
    interleaved = pd.concat([poses.assign(time=one.time, env=k) for k in (0, 1)]).sort_values("time", kind="stable")
    interleaved.to_csv(path, index=False)
    (found,) = read(path, track_options(body=1).layout)  # a number, as a setting is read
    np.testing.assert_allclose(found.position, one.position)


def test_titles_stand_above_the_frames_of_tum_text(tmp_path):
    one = whole()
    rows = text(np.column_stack((one.time, one.position, np.roll(one.quaternion, -1, 1))), " ")
    (tmp_path / "all.txt").write_text(f"# toss 1\n{rows}# toss 2\n{rows}")
    found = [*fail(read(tmp_path / "all.txt"))]
    assert [(each.name, len(each)) for each in found] == [("1", len(one)), ("2", len(one))]
    np.testing.assert_allclose(found[1].position, one.position, atol=1e-8)


def jsons(kind: str) -> str:
    one = FLAT[0]
    frames = [
        {"t": t, "pose": {"x": p[0], "y": p[1], "theta": a}}
        for t, p, a in zip(one.time.tolist(), one.position.tolist(), one.angle.tolist(), strict=True)
    ]
    listed = [{"t": t, "position": [*p.values()][:2], "theta": p["theta"]} for t, p in map(dict.values, frames)]
    columns = {"t": one.time.tolist(), "position": one.position.tolist(), "theta": one.angle.tolist()}
    if kind == "lines":
        return "\n".join(map(json.dumps, frames))
    untimed = {name: values for name, values in columns.items() if name != "t"}
    return json.dumps(
        {
            "frames": frames,
            "lists": listed,
            "columns": columns,
            "episodes": [{"id": name, "frames": listed} for name in "ab"],
            "by name": {"a": columns, "b": columns},
            "with a rate": {"fps": 250, "take": {"frames": untimed}},
        }[kind]
    )


@pytest.mark.parametrize("kind", ["frames", "lines", "lists", "columns", "episodes", "by name", "with a rate"])
def test_json(kind, tmp_path):
    path, wanted = tmp_path / ("a.jsonl" if kind == "lines" else "a.json"), FLAT[0]
    path.write_text(jsons(kind).replace("NaN", "null"))
    assert propose(path).source == "tracks"
    found = [*fail(read(path, track_options(**stated_by_header(path)).layout))]
    assert [one.name for one in found] == (["a", "b"] if kind in ("episodes", "by name") else ["a"])
    for one in found:
        np.testing.assert_allclose(one.time - one.time[0], wanted.time - wanted.time[0], atol=1e-9)
        np.testing.assert_allclose(one.position[one.seen], wanted.position[wanted.seen])
        np.testing.assert_allclose(one.angle[one.seen], wanted.angle[wanted.seen])


def test_json_of_poses_in_space(tmp_path):
    """Four numbers of a list are a quaternion, whose order impacts show."""
    one, path = whole(), tmp_path / "box.json"
    rows = zip(one.time.tolist(), one.position.tolist(), one.quaternion.tolist(), strict=True)
    path.write_text(json.dumps([{"time": t, "position": p, "quaternion": q} for t, p, q in rows]))
    (found,) = read(path, track_options(**stated_by_header(path)).layout)
    np.testing.assert_allclose(found.position, one.position)
    np.testing.assert_allclose(found.quaternion, one.quaternion)
    assert found.order is None


@pytest.mark.parametrize("kind", ["log", "motions", "nine"])
def test_json_of_poses_with_matrices(kind, tmp_path):
    """A log of tags with times in ns since 1970, motions of 4 × 4 numbers, and matrices as nine numbers."""
    one, path = whole(), tmp_path / "cube.jsonl"
    turned = matrices(one.quaternion, "wxyz")
    with path.open("w") as file:
        for t, p, R in zip(one.time, one.position, turned, strict=True):
            motion = [[*row, x] for row, x in zip(R.tolist(), p.tolist(), strict=True)] + [[0, 0, 0, 1]]
            frame = {
                "log": {"stamp_ns": 1690000000000000000 + round(1e9 * t), "pose_t": p.tolist(), "pose_R": R.tolist()},
                "motions": {"t": t, "T": motion},
                "nine": {"t": t, "pos": p.tolist(), "R": R.ravel().tolist()},
            }[kind]
            file.write(json.dumps({"toss": 1, **frame, "hamming": 0}) + "\n")
    (found,) = read(path, track_options(**stated_by_header(path)).layout)
    np.testing.assert_allclose(found.time - found.time[0], one.time - one.time[0], atol=1e-6)
    np.testing.assert_allclose(found.position, one.position)
    np.testing.assert_allclose(found.quaternion, turned.reshape(-1, 9))


@pytest.mark.parametrize("end", [-1, -20, 40])
@pytest.mark.parametrize("suffix", ["json", "jsonl"])
def test_a_json_that_breaks_off_says_so(end, suffix, tmp_path):
    """As of a download that was interrupted, in a word, a number or between two."""
    records = [{"t": k / 8, "x": 0.125, "y": 1.5, "theta": 0.25, "name": "a cube"} for k in range(9)]
    text = json.dumps(records) if suffix == "json" else "\n".join(map(json.dumps, records))
    path = tmp_path / f"a.{suffix}"
    path.write_text(text[:end])
    last = 1 if suffix == "json" or end == 40 else 9
    for use in (propose, lambda path: list(read(path)), table.load):
        with refused([f"a.{suffix}: is no whole JSON: it breaks off at line {last}", "copy or export the file again"]):
            use(path)


def test_markers_may_be_called_as_accelerations_are(tmp_path):
    pd.DataFrame({"time": np.arange(9) / 9, "ax": 0.0, "ay": 1.0, "bx": 1.0, "by": 1.0}).to_csv(tmp_path / "a.csv")
    (found,) = read(tmp_path / "a.csv", Layout(markers=[["ax", "ay"], ["bx", "by"]]))
    assert len(found.markers) == 2


def test_settings_beside_recordings_are_no_recordings(tmp_path):
    for name in ("a.json", "b.csv"):
        (tmp_path / name).touch()
    assert [file.name for file in recording_files(tmp_path)] == ["b.csv"]


@pytest.mark.parametrize("content", ["{", "[]", '{"a": 1}', "[1, 2, 3]", '{"note": ["a", "b"]}'])
def test_json_without_frames_is_one_line(content, tmp_path):
    (tmp_path / "a.json").write_text(content)
    for use in (propose, lambda path: list(read(path))):
        with refused(
            [
                "is no whole JSON: it breaks off at line 1"
                if content == "{"
                else "a.json: holds neither frames nor impacts; of JSON are read"
            ]
        ):
            use(tmp_path / "a.json")


def test_a_time_that_begins_a_comment_is_named_without_it(tmp_path):
    frames = "\n".join(f"{k / 100},{0.1 * k},0.5" for k in range(20))
    (tmp_path / "log.csv").write_text(f"%time,x,y\n{frames}\n", "utf-8")
    with refused(["'%' begins a comment", "data.columns.time=time"]):
        list(read(tmp_path / "log.csv", Layout(time="%time", position=("x", "y"), angle=None)))


@pytest.mark.parametrize("name", ["tosses.pkl", "tosses.pickle", "tosses.joblib"])
def test_a_pickle_is_never_opened(name, tmp_path):
    (tmp_path / name).write_bytes(b"cos\nsystem\n(S'exit 1'\ntR.")
    for use in (propose, recording_files, lambda file: list(read(file))):
        with refused(["is a pickle, which runs code when it is opened", "numpy.savez", "CSV", "vx_post"]):
            use(tmp_path / name)


@pytest.mark.parametrize(
    ("names", "cameras"),
    [
        ("frame,cam1_x,cam1_y,cam2_x,cam2_y", "cam1, cam2"),
        ("t,cam1_u,cam1_v,cam2_u,cam2_v", "cam1, cam2"),
        ("time,left_x_px,left_y_px,right_x_px,right_y_px", "left, right"),
        ("t,u1,v1,u2,v2", "1, 2"),
        ("t,cam_front_x,cam_front_y,cam_side_x,cam_side_y", "camfront, camside"),
        ("t,u_camA,v_camA,u_camB,v_camB", "cama, camb"),
    ],
)
def test_images_of_two_cameras_are_to_be_triangulated(tmp_path, names, cameras):
    path, (_, across, down, *_) = tmp_path / "two.csv", names.split(",")
    path.write_text(f"{names}\n" + "".join(f"{k},1,2,3,4\n" for k in range(30)))
    for use in (propose, stated_by_header, lambda file: table.load(file, {"kind": "sphere", "radius": 0.03})):
        with refused([f"has images of cameras {cameras}", "triangulate x, y and z first", f"[{across}, {down}]"]):
            use(path)


def test_positions_and_velocities_are_no_images():
    """Of bodies, of markers, in space, or before (u) and after (v) an impact."""
    assert not images_of_cameras(["t", "x1", "y1", "x2", "y2"])
    assert not images_of_cameras(["trial", "u1", "v1", "u2", "v2"])
    assert not images_of_cameras(["t", "left_x", "left_y", "left_z", "right_x", "right_y", "right_z"])
    assert not images_of_cameras(["t", "u_px", "v_px"])
    assert not images_of_cameras(["t", "left_hand_x", "left_hand_y", "right_hand_x", "right_hand_y"])
    assert not images_of_cameras(["t", "red_x", "red_y", "blue_x", "blue_y"])


@pytest.mark.parametrize("kind", ["npz", "npy", "pt", "mat", "h5", "iam.h5"])
def test_arrays_of_tosses(kind, tmp_path):
    """Poses with velocities after them, several tosses; never objects."""
    one = whole()
    pose = np.column_stack((one.position, one.quaternion, np.zeros((len(one), 6))))
    path = tmp_path / f"tosses.{kind}"
    if kind == "npz":
        np.savez(path, time=one.time, position=one.position, quaternion=one.quaternion)
    elif kind == "npy":
        np.save(path, np.stack((pose, pose)))
    elif kind == "pt":
        torch.save([torch.tensor(pose), torch.tensor(pose)], path)
    elif kind == "mat":
        R = matrices(one.quaternion, "wxyz").transpose(0, 2, 1).reshape(-1, 9).T
        bodies = {"Name": "box", "Positions": 1000 * one.position.T[None], "Rotations": R[None]}
        savemat(path, {"take": {"FrameRate": 250.0, "RigidBodies": bodies, "Trajectories": 0.0}})
    else:
        h5py = pytest.importorskip("h5py")
        H = np.zeros((len(one), 4, 4))
        H[:, :3, :3], H[:, :3, 3], H[:, 3, 3] = matrices(one.quaternion, "wxyz"), one.position, 1
        with h5py.File(path, "w") as file:
            if kind == "h5":
                for name in ("position", "quaternion", "time"):
                    file[f"toss/{name}"] = getattr(one, name)
            else:
                for body in ("Box5", "Board"):
                    file[f"Rec_1/SENSOR_MEASUREMENT/Mocap/{body}/transforms/ds"] = H.transpose(1, 2, 0)
    if kind == "iam.h5":
        with pytest.raises(DataError, match=r"has 2 bodies in 'Rec_1'; state data\.body=Board or data\.body=Box5"):
            list(read(path, Layout(rate=250)))
    found = [*read(path, Layout(rate=250 if kind != "mat" else None, body="Box5" if kind == "iam.h5" else None))]
    assert len(found) == (2 if kind in ("npy", "pt") else 1)
    for one_found in found:
        assert isinstance(one_found, Recording)
        R = matrices(one_found.quaternion, "rows" if one_found.quaternion.shape[1] == 9 else "wxyz")
        np.testing.assert_allclose(R, matrices(one.quaternion, "wxyz"), atol=1e-9)
        np.testing.assert_allclose(one_found.position, one.position * (1000 if kind == "mat" else 1), atol=1e-9)


def test_logs_of_simulators(tmp_path):
    """Rollouts of one length with the base's name before each array, no clock but dt, and velocities beside."""
    recordings = SPACE[:2]
    frames = min(len(one.time) for one in recordings)
    place, turn = (np.stack([getattr(one, name)[:frames] for one in recordings]) for name in ("position", "quaternion"))
    rest = {"base_lin_vel": np.zeros_like(place), "dt": np.float64(0.005), "seed": np.arange(2)}
    for orn, order in (("base_orn", None), ("base_quat_xyzw", "xyzw")):
        np.savez(tmp_path / "rollouts.npz", base_pos=place, **{orn: turn}, **rest)
        found = [*read(tmp_path / "rollouts.npz", Layout())]
        assert [one.name for one in found] == ["0", "1"]
        assert [one.order for one in found] == [order] * 2
        for one, there, turned in zip(found, place, turn, strict=True):
            np.testing.assert_array_equal(one.position, there)
            np.testing.assert_array_equal(one.quaternion, turned)
            np.testing.assert_allclose(np.diff(one.time), 0.005)
    np.savez(tmp_path / "rollouts.npz", p=place[0], o=turn[0], **rest)
    (found,) = read(tmp_path / "rollouts.npz", Layout(position="p", quaternion="o"))
    np.testing.assert_array_equal(found.position, place[0])
    np.savez(tmp_path / "rollouts.npz", box_pos=place[0], cube_pos=place[1], box_quat=turn[0])
    with refused(["holds no position with angle or quaternion; it has box_pos, cube_pos, box_quat"]):
        [*read(tmp_path / "rollouts.npz", Layout(rate=200.0))]
    (tmp_path / "a.csv").write_text("t,p\n0,1\n")
    with refused(["data.columns.position must name two or three columns"]):
        [*read(tmp_path / "a.csv", Layout(time="t", position="p"))]


@pytest.mark.parametrize("frames", [(40, 30), (40, 40)], ids=["of their own lengths", "of one length"])
def test_structures_of_matlab_are_recordings(tmp_path, frames):
    """Positions [2, T] in a row each; a file of bodies asks which."""
    one = FLAT[0]
    assert one.angle is not None
    each = [{"t": one.time[:n], "pos": one.position[:n].T, "angle": one.angle[:n], "comment": "drop"} for n in frames]
    savemat(tmp_path / "thesis.mat", {"drops": each})
    found = [*read(tmp_path / "thesis.mat", Layout())]
    assert [len(one) for one in found] == [*frames]
    assert len({one.name for one in found}) == len(frames)
    np.testing.assert_allclose(found[1].position, one.position[: frames[1]])
    savemat(tmp_path / "bodies.mat", {"bodies": [one | {"name": name} for one, name in zip(each, "ab", strict=True)]})
    with pytest.raises(DataError, match=r"has 2 bodies in 'bodies'; state data\.body=a or data\.body=b"):
        list(read(tmp_path / "bodies.mat", Layout()))
    (found,) = read(tmp_path / "bodies.mat", Layout(body="b"))
    assert len(found) == frames[1]


@pytest.mark.parametrize("clock", ["rate", "times"])
def test_groups_of_hdf5_share_a_rate_or_times(tmp_path, clock):
    h5py, one = pytest.importorskip("h5py"), whole()
    H = np.zeros((len(one), 4, 4))
    H[:, :3, :3], H[:, :3, 3], H[:, 3, 3] = matrices(one.quaternion, "wxyz"), one.position, 1
    with h5py.File(tmp_path / "archive.h5", "w") as file:
        for k in range(2):
            group = file.create_group(f"Rec_{k}/Mocap")
            for body in ("Box5", "Conveyor"):
                group[f"{body}/transforms/ds"] = H
                group[f"{body}/transforms/ds"].attrs["unit"] = "m"
            if clock == "rate":
                group.attrs["sample_frequency"] = 250.0
            else:
                group["datalog/time"] = one.time
    found = [*read(tmp_path / "archive.h5", Layout(body="Box5"))]
    assert [one.name for one in found] == ["Rec_0", "Rec_1"]
    for recording in found:
        assert recording.unit == "m"
        np.testing.assert_allclose(recording.time, one.time, atol=1e-12)
        np.testing.assert_allclose(recording.position, one.position)


@pytest.mark.parametrize("points", [1, 4])
@pytest.mark.parametrize("preset", ["matlab", "standard"])
def test_analysis_of_sleap(tmp_path, points, preset):
    h5py, one = pytest.importorskip("h5py"), whole()
    markers, scores = marked(one)[:, :points, :2], np.full((1, points, len(one)), 0.9)
    tracks = markers.transpose(2, 1, 0)[None].copy()
    tracks[0, :, 0, 5], scores[0, 0, 7] = np.nan, 0.1
    with h5py.File(tmp_path / "ball.analysis.h5", "w") as file:
        file["tracks"] = tracks if preset == "matlab" else tracks.transpose()
        file["point_scores"] = scores if preset == "matlab" else scores.transpose()
        file["track_occupancy"], file["track_names"] = np.ones((len(one), 1)), np.array([b"brick"])
    with pytest.raises(DataError, match=r"state data\.rate"):
        list(read(tmp_path / "ball.analysis.h5", Layout()))
    (found,) = read(tmp_path / "ball.analysis.h5", Layout(rate=250))
    assert np.flatnonzero(~found.seen).tolist() == [5, 7]
    np.testing.assert_allclose(found.position[8:], markers.mean(1)[8:], atol=1e-9)


def test_arrays_with_a_column_a_frame(tmp_path):
    """A structure of MATLAB with positions [3, T] or [T, 3], of which the first is said to be so."""
    time = np.arange(50) / 250
    noise = np.random.default_rng(0).normal(0, 1e-4, (50, 3))
    fall = noise + np.column_stack((time, 0 * time, 1 - GRAVITY / 2 * time**2)), np.tile((1.0, 0.0, 0.0, 0.0), (50, 1))
    for turned in (False, True):
        position, quaternion = (values.T if turned else values for values in fall)
        savemat(tmp_path / "fall.mat", {"S": {"time": time, "position": position, "quaternion": quaternion}})
        (found,) = [*read(tmp_path / "fall.mat")]
        assert isinstance(found, Recording)
        np.testing.assert_array_equal(found.position, fall[0])
        np.testing.assert_array_equal(found.quaternion, fall[1])
        clues = find_frame([found], find_gravity([found]), Conventions(order="wxyz"), in_space=True).clues
        assert ("arrays" in {clue.convention for clue in clues}) == turned
    savemat(tmp_path / "fall.mat", {"S": {"position": fall[0][:3], "quaternion": fall[1][:3]}})
    with pytest.raises(DataError, match=r"position is 3 × 3: its frames may be rows or columns"):
        [*read(tmp_path / "fall.mat", Layout(rate=250))]


def test_a_group_a_toss_in_groups_of_sessions(tmp_path):
    """Groups that are called as recordings are no bodies; times are in µs where seconds leave no flight."""
    time = np.arange(40) / 480
    fall = {"position": np.column_stack((time, time, 1 - time**2)), "orientation": np.tile((0.0, 0, 0, 1), (40, 1))}
    content = {day: {f"toss_0{k}": {"stamp": 1e6 * time, **fall} for k in (1, 2)} for day in ("session_a", "session_b")}
    found = [*recordings_of(tmp_path / "a.h5", content, Layout())]
    assert [one.name for one in found] == [f"session_{day} toss_0{k}" for day in "ab" for k in (1, 2)]
    np.testing.assert_allclose(found[0].time, time)
    bodies = {"toss_01": {"box": fall, "lid": fall}}
    with pytest.raises(DataError, match="has 2 bodies in 'toss_01'; state data"):
        [*recordings_of(tmp_path / "a.h5", bodies, Layout(rate=480))]


def test_transforms_of_several_frames_have_stamps_of_their_own(tmp_path):
    """As of /tf in ROS: the stamps of all rows together grow, too."""
    rows = pd.DataFrame({"stamp": np.arange(80) / 200, "child_frame_id": ["cube", "gripper"] * 40})
    rows = rows.assign(x=np.where(rows.child_frame_id == "cube", 1.0, 5.0), y=1 - rows.stamp**2, theta=0.0)
    rows.to_csv(tmp_path / "tf.csv", index=False)
    with pytest.raises(DataError, match="has 2 bodies in column 'child_frame_id'; state data"):
        [*read(tmp_path / "tf.csv", Layout(time="stamp"))]
    (found,) = [*read(tmp_path / "tf.csv", Layout(time="stamp", body="cube"))]
    assert len(found.time) == 40
    assert (found.position[:, 0] == 1).all()
    both = [*read(tmp_path / "tf.csv", Layout(time="stamp", recording="child_frame_id"))]
    assert [one.name for one in both] == ["cube", "gripper"]  # where a recording a frame is stated


def test_objects_of_arrays_are_refused(tmp_path):
    np.save(tmp_path / "bad.npy", np.array([{"a": 1}], dtype=object), allow_pickle=True)
    torch.save({"a": Path("x")}, tmp_path / "bad.pt")
    for name in ("bad.npy", "bad.pt"):
        with pytest.raises(DataError, match=r"bad\..* cannot be read"):
            list(read(tmp_path / name, Layout()))
    np.save(tmp_path / "flat.npy", np.zeros((5, 3)))
    with pytest.raises(DataError, match=r"holds no position.*an array \(5, 3\)"):
        list(read(tmp_path / "flat.npy", Layout()))


@pytest.mark.parametrize(
    ("stamps", "factor"), [(1000.0, 1), (1e6, 1), (None, 1)], ids=["milliseconds", "microseconds", "nanoseconds"]
)
def test_times_without_a_unit(stamps, factor, tmp_path):
    """Frames half a second apart show no flight; numbers of 2024 since 1970 are what they are."""
    one = FLAT[0]
    t = np.arange(len(one)) / 240
    written = (1.7e18 + 1e9 * t).astype(np.int64) if stamps is None else np.round(stamps * t, 2)
    frame = pd.DataFrame({"time": written, "x": one.position[:, 0], "y": one.position[:, 1], "theta": one.angle})
    frame.to_csv(tmp_path / "a.csv", index=False)
    (found,) = read(tmp_path / "a.csv", Layout())
    np.testing.assert_allclose(found.time - found.time[0], t, atol=2e-5)


def test_dropped_frames_that_stamps_hide(tmp_path):
    one = FLAT[0]
    number = np.delete(np.arange(len(one) + 2), [20, 21])
    frame = pd.DataFrame(
        {"time": np.arange(len(one)) / 240, "frame": number, "x": one.position[:, 0], "y": one.position[:, 1]}
    ).assign(theta=one.angle)
    frame.to_csv(tmp_path / "a.csv", index=False)
    (found,) = read(tmp_path / "a.csv", Layout())
    np.testing.assert_allclose(found.time, number / 240, atol=1e-9)


def test_states_of_lerobot(tmp_path):
    one = FLAT[0]
    state = [[*row] for row in np.column_stack((one.position, one.angle))]
    n = len(one)
    frame = pd.DataFrame({"observation.state": state, "timestamp": np.arange(n) / 240, "episode_index": [0] * n})
    frame.to_parquet(tmp_path / "file-000.parquet")
    columns = Layout(
        time="timestamp", recording="episode_index", angle="observation.state.2",
        position=["observation.state.0", "observation.state.1"],
    )  # fmt: skip
    (found,) = read(tmp_path / "file-000.parquet", columns)
    np.testing.assert_allclose(found.position, one.position)
    with pytest.raises(DataError, match=r"it has timestamp, episode_index, observation\.state\.0"):
        list(read(tmp_path / "file-000.parquet", Layout()))
