"""`contactlearn init`: what columns say of a file, as settings that every command takes by one name."""

import csv
import math
import re
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pandas as pd
import pytest
import torch
import yaml
from commands import TRAIN, run
from spatial import tossed

from contactlearn.cli.commands.loading import load_data
from contactlearn.cli.config_files import own_data
from contactlearn.cli.hydra_main import compose
from contactlearn.cli.settings import SourceSettings
from contactlearn.core.errors import ContactLearnError, DataError
from contactlearn.data import table, tracks
from contactlearn.data.headers import OPEN, propose, stated_by_header
from contactlearn.data.recordings.readers import Layout, read
from contactlearn.mechanics.apparatus import Apparatus, Estimate
from contactlearn.mechanics.space import PLANE
from contactlearn.simulation import recordings, synthetic
from contactlearn.workbench.commands import experiment, session_of

SHAPE = "{kind: ellipse, semi_axes: [0.035, 0.025]}"
MILLIMETRES = {
    "x": ("pos_x (mm)", 1e3), "y": ("pos_y (mm)", 1e3), "theta": ("angle [deg]", 180 / math.pi),
    "vx": ("speed_x_before [mm/s]", 1e3), "vy": ("VyPre / mm s-1", 1e3), "omega": ("spin_deg_s", 180 / math.pi),
    "vx_post": ("v_x after [mm/s]", 1e3), "vy_post": ("velocity_y_post_mm_per_s", 1e3),
    "omega_post": ("angular velocity after impact (°/s)", 180 / math.pi),
}  # fmt: skip
SAID = {"length": "mm", "mass": "kg", "angle": "deg", "time": "s", "rotation": "counterclockwise"}
WRITTEN = 1e-9  # m; the last digit in the files of recordings
ROUNDING = 1e-12  # relative; a few float64 roundings of a product of factors


def header(path: Path, *names: str) -> Path:
    """A file of columns with one row of zeros."""
    path.parent.mkdir(exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([names, [0] * len(names)])
    return path


def proposed(path: Path, *names: str) -> dict:
    return {one.name: one.value for one in propose(header(path, *names)).settings}


@pytest.fixture
def drops(tmp_path, monkeypatch):
    """Drops, written as somebody would in millimetres and degrees, in the working directory."""
    monkeypatch.chdir(tmp_path)
    impacts = synthetic.load(size=40)
    columns = {}
    for field in ("q", "v_pre", "v_post"):
        for ours, values in zip(PLANE.components[field], getattr(impacts, field).T, strict=True):
            name, factor = MILLIMETRES[ours]
            columns[name] = (values * factor).tolist()
    with open("drops.csv", "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerows([[*columns, "remark"], *([*row, "fine"] for row in zip(*columns.values(), strict=True))])
    return impacts


def filled_in(name: str, **values: str) -> None:
    """Fill in values that were left open."""
    path = Path(f"{name}.yaml")
    text = path.read_text("utf-8")
    for key, value in values.items():
        assert f"\n{key}: ???" in text
        text = text.replace(f"\n{key}: ???", f"\n{key}: {value}")
    path.write_text(text, "utf-8")


def test_a_table_is_read_as_its_columns_say(drops):
    told = run("contactlearn", "init", "drops.csv", "--name", "mydata", cwd=".")
    assert "mydata.yaml written: drops.csv is a table of impacts" in told
    assert "fill in: mass, shape: each has a comment" in told
    assert "not used: 'remark'" in told
    lacking = run("contactlearn", "audit", "data=mydata", cwd=".", status=2)
    assert "error: data.mass, data.shape must be given: data.mass=…, or in mydata.yaml" in lacking
    filled_in("mydata", mass=str(drops.mass[0].item()), shape=SHAPE)
    assert "mydata" in own_data()
    source = SourceSettings.from_config(compose("train", ["data=mydata"]))
    assert source.options["units"] == SAID
    found = load_data(source).impacts
    for field in ("mass", "inertia", "r", "q", "v_pre", "v_post"):
        torch.testing.assert_close(getattr(found, field), getattr(drops, field), rtol=ROUNDING, atol=ROUNDING)
    assert "40 impacts" in run("contactlearn", "audit", "data=mydata", cwd=".")
    assert SourceSettings.from_config(compose("diagnose", ["data=mydata", "data.units.mass=g"])).options["units"] == {
        **SAID, "mass": "g",
    }  # fmt: skip
    assert experiment(session_of(["data=mydata"])).count("override /data: mydata") == 1
    run("train.py", "data=mydata", *[word for word in TRAIN if not word.startswith("data.")], cwd=".")


def test_recordings_are_read_as_their_columns_say(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    takes, _ = recordings.simulate(3, seed=3)
    recordings.write_recordings(takes, Path("takes"))
    for file in Path("takes").iterdir():
        lines = file.read_text().splitlines()
        assert lines[0] == "time,x,y,theta"
        file.write_text("\n".join(["t,x [m],z [m],th", *lines[1:]]))
    told = run("contactlearn", "init", "takes", cwd=".")
    assert "fill in: mass, shape" in told
    assert "next: contactlearn impacts data=takes -o impacts.parquet, contactlearn audit data=takes, and" in told
    filled_in("takes", mass=str(recordings.MASS), shape=SHAPE)
    with patch("contactlearn.cli.commands.impacts.write_impacts", return_value="") as written:
        run("contactlearn", "impacts", "data=takes", "-o", "impacts.csv", cwd=".")
    ((source, _), _) = written.call_args
    assert source == SourceSettings.from_config(compose("evaluate", ["data=takes"]))
    options = {name: source.options[name] for name in ("columns", "unit", "angle", "rate")}
    assert (options["unit"], options["angle"], options["rate"]) == ("m", None, None)
    (found,) = read(Path("takes/0001.csv"), tracks.track_options(**options).layout)
    np.testing.assert_allclose(found.position, takes[0].position, atol=WRITTEN)
    header(Path("drops.csv"), "vx", "vx_post")
    run("contactlearn", "init", "drops.csv", cwd=".")
    refused = run("contactlearn", "impacts", "data=drops", "-o", "a.csv", cwd=".", status=2)
    assert "data=drops is another source" in refused


def test_recordings_without_settings_are_read_as_their_columns_say(tmp_path):
    takes, _ = recordings.simulate(3, seed=3)
    recordings.write_recordings(takes, tmp_path)
    for file in tmp_path.iterdir():
        numbers = np.loadtxt(file, delimiter=",", skiprows=1) * (1, 1e3, 1e3, 180 / np.pi)
        np.savetxt(file, numbers, delimiter=",", header="t [s],X [mm],Y [mm],phi [deg]", comments="")
    found = tracks.find(tmp_path, mass=recordings.MASS, shape={"kind": "ellipse", "semi_axes": [0.035, 0.025]})
    clues = {clue.convention: clue.value for clue in found.survey.frame.clues}
    assert clues["unit"] == "mm"
    assert clues["angles"].startswith("deg")


@pytest.mark.parametrize(
    ("names", "wanted"),
    [
        pytest.param(["x", "x_mm", "vx_post"], {"units.length": "m"}, id="our name goes first"),
        pytest.param(["vx_post", "x_com", "x [mm]", "X (m)"], {"columns.x": OPEN}, id="two columns of one meaning"),
        pytest.param(["vx_post", "x [yd]"], {"columns.x": OPEN}, id="an unknown unit"),
        pytest.param(["x_mm", "vx_post [m/s]"], {"units.length": None}, id="two units of one quantity"),
        pytest.param(["vx_post [cm/s]", "x_cm"], {"columns.x": "x_cm", "units.length": "cm"}, id="centimetres"),
        pytest.param(["vx_post", "x_cm"], {"columns.x": "x_cm", "units.length": OPEN}, id="a column without a unit"),
        pytest.param(["omega' [rpm]", "vx_post"], {"units.time": "s", "units.angle": None}, id="rpm is no minute"),
        pytest.param(["omega' [rpm]", "vx_post", "theta"], {"units.angle": "rad"}, id="rpm beside an angle"),
        pytest.param(["vx_post", "x_contact"], {"columns.x": OPEN}, id="the contact is not the centre"),
        pytest.param(["vx_post", "I [g mm^2]", "m_g"], {"columns.mass": "m_g", "units.mass": "g"}, id="a mass"),
        pytest.param(["vx_post", "inertia [g·mm²]", "massKg"], {"units.mass": None}, id="two masses"),
        pytest.param(["vx_post", "vx_pots"], {"columns.vx": OPEN}, id="a slip"),
        pytest.param(["vx_post", "mass", "inertia", "rx", "ry"], {"shape": None}, id="nothing to compute"),
        pytest.param(["vx_post", "inertia", "rx"], {"shape": None, "columns.ry": OPEN}, id="half of a contact point"),
        pytest.param(["time", "x", "y", "theta"], {"mass": OPEN, "unit": None, "angle": None}, id="a recording"),
        pytest.param(["t_ms", "x", "y", "phi"], {"columns.time": "t_ms"}, id="milliseconds"),
        pytest.param(["time", "x", "y"], {"mass": OPEN, "shape": OPEN}, id="a ball without an angle"),
        pytest.param(["t", "x", "y", "z", "theta"], {"columns.position": OPEN}, id="which plane"),
        pytest.param(
            ["time", *(f"pose.position.{k}" for k in "xyz"), *(f"pose.orientation.{k}" for k in "xyzw")],
            {"columns.quaternion": [f"pose.orientation.{k}" for k in "wxyz"], "shape": OPEN},
            id="in space",
        ),
        pytest.param(
            ["time", *(f"{body}_{name}" for body in ("puck", "mallet") for name in ("x", "y", "theta"))],
            {"body": OPEN, "shape": OPEN},
            id="two bodies",
        ),
        pytest.param(
            ["t", "x1", "y1", "x2", "y2", "x3", "y3"],
            {"columns.markers": [["x1", "y1"], ["x2", "y2"], ["x3", "y3"]], "shape": None},
            id="markers",
        ),
    ],
)
def test_what_columns_say(tmp_path, names, wanted):
    found = proposed(tmp_path / "a.csv", *names)
    assert found == found | wanted


def test_a_node_that_writes_stamps_and_several_bodies(tmp_path):
    """Times in ns since 1970 are seen in "stamp", and rows alternate between bodies."""
    stamps = 1716900000000000000 + np.arange(30) * 8333333
    rows = [f"{t},{k},{name},0,0,{k}.5,0,0,0,1" for k, t in enumerate(stamps) for name in ("cube_a", "cube_b")]
    (tmp_path / "take.csv").write_text("\n".join(["stamp,seq,name,x,y,z,qx,qy,qz,qw", *rows]) + "\n")
    contents = propose(tmp_path / "take.csv")
    settings = {one.name: one for one in contents.settings}
    assert settings["columns.time"].value == "stamp"
    assert "rate" not in settings
    assert settings["body"].value == OPEN
    assert settings["body"].comment == "cube_a or cube_b, in column 'name'"
    (found,) = read(tmp_path / "take.csv", Layout(time="stamp", body="cube_b"))
    np.testing.assert_allclose(np.diff(found.time), 8333333e-9, rtol=1e-3)


def test_counted_frames_stay_the_clock(tmp_path):
    """Where frames are numbered, the numbers show which were dropped: only the rate is asked."""
    settings = proposed(tmp_path / "a.csv", "frame", "x", "y", "theta")
    assert settings["rate"] == OPEN
    assert proposed(tmp_path / "ball.csv", "Frame", "x_cm", "y_cm")["columns.angle"] is None
    assert "columns.time" not in settings


def clips(path: Path, *remarks: str, name: str = "clip") -> Path:
    """A ball in three clips, in pixels with y down; the numbers of frames begin anew."""
    lines = [f"{one},{first + k},{100 + k},{0.05 * k**2}" for one, first in (("a", 20), ("b", 5), ("c", 9))
             for k in range(40)]  # fmt: skip
    path.write_text("\n".join([*remarks, f"{name},frame,x_px,y_px", *lines]) + "\n")
    return path


@pytest.mark.parametrize(
    ("remarks", "rate", "unit"),
    [
        (("# GoPro 119.88 fps, 1920 x 1680", "# scale: 0.91 mm/px"), 119.88, 0.00091),
        (("# frame rate = 240",), 240, OPEN),
        (("# 240 fps, played at 30 fps",), OPEN, OPEN),
        ((), OPEN, OPEN),
    ],
)
def test_clips_of_a_ball_in_pixels(tmp_path, remarks, rate, unit):
    """Comments may state the rate and the size of a pixel; a clip is a recording, and a ball has no angle."""
    path = clips(tmp_path / "ball.csv", *remarks)
    settings = {one.name: one.value for one in propose(path).settings}
    assert {name: settings[name] for name in ("rate", "unit")} == {"rate": rate, "unit": unit}
    columns = {name.removeprefix("columns."): value for name, value in settings.items() if name[:8] == "columns."}
    assert columns == {"recording": "clip", "position": ["x_px", "y_px"], "angle": None}
    stated = stated_by_header(path)
    assert stated.get("rate", OPEN) == rate
    found = [*read(path, tracks.track_options(**{"rate": 100} | stated).layout)]
    assert [(one.name, len(one)) for one in found] == [("a", 40), ("b", 40), ("c", 40)]
    found = [*read(path, Layout(rate=100, position=("x_px", "y_px"), angle=None))]
    assert [one.name for one in found] == ["a", "b", "c"]


@pytest.mark.parametrize(
    ("name", "unit"),
    [("Heading_deg_cw", "deg"), ("yaw", None), ("bearing [°]", "deg"), ("rotation (rad)", "rad"), ("angle cw", None)],
)
def test_a_heading_is_the_angle(tmp_path, name, unit):
    """The impacts show its sense, whatever its name says: in an image y may point down."""
    found = proposed(tmp_path / "a.csv", "Time", "X_cm", "Y_cm", name)
    assert (found["columns.angle"], found["angle"]) == (name, unit)
    turns = proposed(tmp_path / "b.csv", "t", "x", "y", "z", "roll", "pitch", "yaw")
    assert "columns.angle" not in turns  # yaw is one of three


@pytest.mark.parametrize(
    ("file", "names"),
    [
        ("raw.csv", ["Time (s)", *(f"Acceleration {axis} (m/s^2)" for axis in "xyz"), "Absolute acceleration (m/s^2)"]),
        ("raw.csv", ["Time (s)", *(f"Gyroscope {axis} (rad/s)" for axis in "xyz")]),
        ("imu.csv", ["timestamp", *(f"{kind}{axis}" for kind in "ag" for axis in "xyz")]),
        ("imu.csv", ["t", "acc_x", "acc_y", "acc_z", "gyro_x [°/s]", "gyro_y [°/s]", "gyro_z [°/s]"]),
        ("log.csv", ["time", "X (m/s²)", "Y (m/s²)", "Z (m/s²)"]),
        ("log.csv", ["time", "x [g]", "y [g]", "z [g]", "a_total [g]"]),
        ("Accelerometer.csv", ["time", "seconds_elapsed", "z", "y", "x"]),
    ],
)
def test_readings_of_a_sensor_are_no_positions(tmp_path, file, names):
    path = header(tmp_path / file, *names)
    for use in (propose, lambda path: tracks.find(path, mass=1, shape={"kind": "disc", "radius": 1})):
        with pytest.raises(DataError, match="these are accelerations and rates of a sensor on the body; positions and"):
            use(path)
    if file != "Accelerometer.csv":
        stated = Layout(time=names[0], position=names[1:3], angle=None)
        with pytest.raises(DataError, match="is no position and no angle: these are accelerations"):
            list(read(path, stated))


def test_readings_of_a_sensor_beside_positions_are_not_asked_for(tmp_path):
    settings = proposed(tmp_path / "a.csv", "time_s", "x_mm", "y_mm", "acc_x (m/s^2)", "gyro_z (deg/s)")
    assert settings["columns.angle"] is None
    assert settings["columns.position"] == ["x_mm", "y_mm"]


def test_a_column_that_no_header_explains_is_asked_for(tmp_path):
    path = header(tmp_path / "a.csv", "t", "x [mm]", "y [mm]", "score")
    with pytest.raises(
        DataError, match=r"a\.csv: which column is which\? .*angle: .*if it is among score; null: nobody"
    ):
        tracks.find(path, mass=1, shape={"kind": "disc", "radius": 1})


def test_positions_of_recordings_may_be_called_px(tmp_path):
    """In a table of impacts Px is an impulse."""
    settings = proposed(tmp_path / "a.csv", "t", "px", "py", "pz", *(f"r{i}{j}" for i in "123" for j in "123"))
    assert settings["columns.position"] == ["px", "py", "pz"]


def test_one_setting_that_is_left_and_a_source_that_is_not_there(drops):
    header(Path("a.csv"), "mass", "vx_post", "vx", "vy", "vy_post", "omega", "omega_post", "x", "y", "theta")
    told = run("contactlearn", "init", "a.csv", cwd=".")
    assert "fill in: shape: its line has a comment" in told
    recordings.write_recordings(recordings.simulate(1, seed=3)[0], Path("takes"))
    assert "written: takes holds recordings of tracked poses" in run("contactlearn", "init", "takes", cwd=".")
    told = run("contactlearn", "audit", "data=cube", cwd=".", status=2)
    assert (
        "unknown data 'cube': no file cube.yaml is in this folder; `contactlearn init FILE --name cube` writes it; "
        in told
    )
    assert "unknown data 'tabel', did you mean 'table'?" in run(
        "contactlearn", "audit", "data=tabel", cwd=".", status=2
    )


def test_a_name_in_a_file_is_text(drops):
    """Whatever stands in a header: no reference, no new line of YAML, no sequence that steers a terminal."""
    hostile = "${oc.env:HOME}\n_target_: os.system\u2028\x1b[31m"
    header(Path("odd.csv"), "vx_post", f"vx {hostile}", "${vx} [mm/s]", "vy [m/s]\r\nmass: 1", hostile)
    told = run("contactlearn", "init", "odd.csv", cwd=".")
    assert "\x1b" not in told
    source = SourceSettings.from_config(compose("evaluate", ["data=odd", "data.mass=1"]))
    assert source.target == "contactlearn.data.table.load"
    assert source.options["columns"]["vx"] == "${vx} [mm/s]"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nowhere.csv"], "nowhere.csv: no such file or folder"),
        (["drops.tar"], "drops.tar: is compressed; unpack it first"),
        (["broken.jsonl"], "broken.jsonl: is no whole JSON: it breaks off at line 2"),
        (["other.json"], "other.json: holds neither frames nor impacts"),
        (["drops.csv", "--name", "table"], "data=table is a source of this package; choose another name"),
        (["drops.csv", "--name", "my data"], "a word of the letters a to z, digits and _ for data=NAME, got 'my data'"),
        (["taken.csv"], "taken.yaml exists already and is not replaced"),
        (["other.csv"], "other.csv: is neither a table of impacts"),
        (["times.csv"], "are 'Time 1 (s)', 'Time 2 (s)' times between bounces?"),
        (["ratios.csv"], "the coefficients 'e_n [-]', 'e_t [-]' give those after it: add vy_post"),
        (["tables"], "tables: holds 1 table, a.csv; give it: tables/a.csv"),
    ],
)
def test_init_refuses(drops, words, message):
    Path("taken.yaml").write_text("mine")
    for name in ("taken.csv", "tables/a.csv"):
        header(Path(name), "vx_post")
    header(Path("other.csv"), "a", "b")
    header(Path("times.csv"), "run", "Time 1 (s)", "Time 2 (s)")
    header(Path("ratios.csv"), "v_in [m/s]", "theta_in [deg]", "e_n [-]", "e_t [-]")
    Path("drops.tar").write_bytes(b"")
    Path("broken.jsonl").write_text('{"vx_post": 1}\n{"vx_post": \n')
    Path("other.json").write_text('{"rate": 100, "by": "me"}')
    before = sorted(Path().rglob("*"))
    told, *columns = run("contactlearn", "init", *words, cwd=".", status=2).splitlines()
    assert message in told
    assert not columns or told.endswith("; its columns are")
    assert sorted(Path().rglob("*")) == before
    assert Path("taken.yaml").read_text() == "mine"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: [", "mydata.yaml: a configuration file is not YAML"),
        ("path: drops.csv", "mydata.yaml: is no source of data; it begins with _target_: contactlearn.data.table.load"),
        ("_target_: os.system\npath: ls", "mydata.yaml: is no source of data"),
        ("_target_: contactlearn.data.table.load\nunit: mm", "setting in mydata.yaml: 'unit', did you mean 'units'?"),
        ("- 1", "mydata.yaml: must hold settings by name"),
    ],
)
def test_a_file_of_settings_is_checked(tmp_path, monkeypatch, text, message):
    monkeypatch.chdir(tmp_path)
    Path("mydata.yaml").write_text(text)
    with pytest.raises(ContactLearnError, match=rf"^[^\n]*{re.escape(message)}[^\n]*$"):
        compose("train", ["data=mydata"])


def test_a_table_and_a_setting_may_state_the_same_mass(tmp_path):
    drops = synthetic.load(size=5)
    path = table.save(drops, tmp_path / "a.csv")
    mass, inertia = drops.mass[0].item(), drops.inertia[0].item()
    assert table.load(path, mass=mass, inertia=inertia).mass.tolist() == drops.mass.tolist()
    with pytest.raises(DataError, match=r"data.mass=0.05, but the column 'mass' has 0.0364 in row 1; leave"):
        table.load(path, mass=0.05)
    with pytest.raises(DataError, match=r"data.inertia=1e-05, but the column 'inertia' has 1.68\S* in row 1; leave"):
        table.load(path, inertia=1e-5)
    tosses = table.save(tossed(5), tmp_path / "tosses.csv")
    with pytest.raises(DataError, match=r"data.inertia=1, but the column 'inertia_x' has"):
        table.load(tosses, inertia=[1, 2, 2])
    found = table.load(path, columns={"mass": None, "inertia": None}, mass=0.05, inertia=2e-5)
    assert found.mass.tolist() == [0.05] * 5
    assert found.inertia.tolist() == [2e-5] * 5
    with pytest.raises(DataError, match=r"data.mass must be a finite number greater than 0, got -1"):
        table.load(path, mass=-1)


@pytest.mark.parametrize(
    "form", ["{body}_{name}_{when}", "{name}_{when}.{body}", "{name} {body} {when}"], ids=["first", "last", "between"]
)
def test_of_two_bodies_in_a_row_one_is_to_be_chosen(tmp_path, form):
    path, drops = tmp_path / "pucks.csv", synthetic.load(size=4)
    states = {"before": drops.v_pre, "after": drops.v_post}
    columns = {
        form.format(body=body, name=name, when=when): states[when][:, k].tolist()
        for body in ("red", "blue") for when in states for k, name in enumerate(("vx", "vy", "omega"))
    }  # fmt: skip
    pd.DataFrame({"release": range(4), **columns}).to_csv(path, index=False)
    with pytest.raises(DataError, match="each row has the impacts of 2 bodies, red, blue; choose one") as caught:
        propose(path)
    (said,) = re.findall(r"'data\.columns=({.*?})'", str(caught.value))
    disc = {"kind": "disc", "radius": 0.04}
    with pytest.raises(DataError, match="each row has the impacts of 2 bodies, red, blue; choose one"):
        table.load(path, disc, mass=0.03)
    chosen = table.load(path, disc, mass=0.03, columns=yaml.safe_load(said))
    assert chosen.v_post.tolist() == drops.v_post.tolist()


def test_names_that_stand_twice_are_no_lack_of_velocities(tmp_path):
    path = tmp_path / "drops.csv"
    path.write_text("vx,vy,omega,vx,vy,omega\n0.1,-2,3,0.1,1,2\n0.2,-2,3,0.1,1,2\n")
    with pytest.raises(DataError, match=r"must be unique; repeated: 'vx', .*call those after contact vx_post, vy_post"):
        propose(path)


def test_two_tracks_of_a_video_may_be_two_bodies(tmp_path):
    """Tracker writes the times of each track: only a person knows whether both are points of one body."""
    rows = "\n".join(f"{k / 30}\t1.0\t{2 - k}\t{k / 30}\t3.0\t{4 - k}" for k in range(9))
    path = tmp_path / "drop.txt"
    path.write_text(f"mass_A\t\t\tmass_B\t\t\nt\tx\ty\tt\tx\ty\n{rows}\n")
    (body,) = (one for one in propose(path).settings if one.name == "body")
    assert body.value is None
    assert body.comment == "mass_A or mass_B, if each is one; null: points of one"


def test_a_trial_without_its_row_after_contact_is_left_out_as_its_message_says(tmp_path, monkeypatch):
    """Numbers of trials begin again in each session, and one row of the second is lost."""
    monkeypatch.chdir(tmp_path)
    drops = synthetic.load(size=6)
    rows = [
        ("Mon" if k < 3 else "Wed", k % 3 + 1, state, drops.q[k, 2].item(), *v[k].tolist())
        for k in range(6) for state, v in (("before", drops.v_pre), ("after", drops.v_post))
    ]  # fmt: skip
    frame = pd.DataFrame(rows, columns=["session", "trial", "state", "theta", "vx", "vy", "omega"])
    frame.drop(index=9).to_csv("carpet.csv", index=False)
    run("contactlearn", "init", "carpet.csv", cwd=tmp_path)
    words = ["data=carpet", "data.mass=0.0364", f"data.shape={SHAPE}"]
    with pytest.raises(DataError, match=r"trial 'Wed/2' has no row after contact: add it, or leave") as caught:
        load_data(SourceSettings.from_config(compose("train", [*words, "data.correct=[]"])))
    (way,) = re.findall(r"data\.correct=\S+\]", str(caught.value))
    for more in ([way], []):  # as init has seen and written
        assert len(load_data(SourceSettings.from_config(compose("train", [*words, *more]))).impacts) == 5


def test_a_setting_that_is_left_out_is_asked_for_with_its_file_and_choices(tmp_path):
    names = ["time", *(f"{name}_{body}" for body in ("red", "blue") for name in ("x", "y", "theta"))]
    header(tmp_path / "pucks.csv", *names)
    run("contactlearn", "init", "pucks.csv", "--name", "two", cwd=tmp_path)
    (tmp_path / "other.yaml").write_text("_target_: contactlearn.data.tracks.load\npath: other.csv\nbody: ???\n")
    words = ["impacts", "data=two", "data.mass=0.1", "data.shape={kind: disc, radius: 0.03}", "-o", "a.csv"]
    said = run("contactlearn", *words, cwd=tmp_path, status=2)
    wanted = "data.body=…, or in two.yaml; data.body is red or blue, in names of columns"
    assert said == f"error: data.body must be given: {wanted}\n"


def test_four_parts_of_a_rotation_are_a_quaternion_and_three_are_turns(tmp_path):
    path, frames = tmp_path / "log.csv", np.random.default_rng(0).normal(size=(60, 7))
    for parts, name in (("xyzw", "quaternion"), ("xyz", "euler")):
        header = ["pos.x", "pos.y", "pos.z", *(f"rot.{part}" for part in parts)]
        log = pd.DataFrame(frames[:, : len(header)], columns=header)
        log.insert(0, "time", np.arange(60) / 200)
        log.to_csv(path, index=False)
        columns = {one.name: one.value for one in propose(path).settings}
        assert columns[f"columns.{name}"] == [f"rot.{part}" for part in sorted(parts)], columns


def test_a_table_of_a_laboratory_in_french_is_read(tmp_path):
    """Normal and tangential velocities in Windows-1252, with decimal commas and missing numbers."""
    names = [f"vitesse {way} {when} (cm/s)" for when in ("avant", "après") for way in ("tangentielle", "normale")]
    rows = [f"{k};{k},5;-{k},25;{k},1;{'n.d.' if k == 3 else f'{k},2'}" for k in range(1, 30)]
    path = tmp_path / "essais.csv"
    path.write_text("\n".join([";".join(["n°", *names]), *rows]), encoding="cp1252")
    settings = {one.name: one.value for one in propose(path).settings}
    ours = ("vx", "vy", "vx_post", "vy_post")
    assert {f"columns.{one}": settings[f"columns.{one}"] for one in ours} == dict(
        zip((f"columns.{one}" for one in ours), names, strict=True)
    )
    assert settings["correct"] == ["drop_incomplete"]


def test_units_of_columns_that_are_still_open_are_not_overruled(tmp_path):
    names = [f"{word} {when} [cm/s]" for when in ("before", "after") for word in ("crosswise", "downright")]
    settings = {one.name: one for one in propose(header(tmp_path / "a.csv", *names, "omega_post [rad/s]")).settings}
    assert settings["units.length"].value is None
    assert "cm as in" in settings["units.length"].comment


def test_the_material_of_a_surface_is_no_velocity_of_it(drops):
    rows = pd.read_csv("drops.csv").assign(surface="steel")
    rows.to_csv("floors.csv", index=False)
    settings = {one.name: one.value for one in propose(Path("floors.csv")).settings}
    columns = {name.removeprefix("columns."): one for name, one in settings.items() if name.startswith("columns.")}
    units = {one: settings[f"units.{one}"] for one in ("length", "mass", "angle", "time", "rotation")}
    impacts = table.load(Path("floors.csv"), shape=yaml.safe_load(SHAPE), columns=columns, units=units, mass=0.05)
    assert len(impacts) == len(rows)


def test_a_message_that_was_written_twice_is_one_frame(tmp_path):
    frames = [f"{k / 100},{0.1 * k},{1 - (k / 100) ** 2},0" for k in range(20)]
    whole, twice = tmp_path / "whole.csv", tmp_path / "twice.csv"
    whole.write_text("\n".join(["time,x,y,theta", *frames]))
    twice.write_text("\n".join(["time,x,y,theta", *frames[:7], frames[6], *frames[7:]]))
    (one,), (other,) = read(whole, Layout()), read(twice, Layout())
    np.testing.assert_array_equal(one.position, other.position)
    np.testing.assert_array_equal(one.time, other.time)
    again = tmp_path / "again.csv"
    again.write_text("\n".join(["time,x,y,theta", *frames[:7], "0.06,9,9,0", *frames[7:]]))
    with pytest.raises(DataError, match="time must grow; it repeats at frame 8"):
        list(read(again, Layout()))


def test_an_angle_beside_a_speed_is_its_direction(tmp_path):
    path = tmp_path / "court.csv"
    generator = np.random.default_rng(0)
    speed, angle = generator.uniform(10, 20, 40), generator.uniform(10, 60, 40)
    rows = np.stack((speed, angle, 0.7 * speed, angle + 3), 1)
    np.savetxt(path, rows, delimiter=",", header="Speed in (km/h),Angle in (deg),Speed out (km/h),Angle out (deg)",
               comments="")  # fmt: skip
    contents = propose(path)
    assert 'direction_floor: "Angle in (deg)"' in contents.column_listing.replace("'", '"')
    assert "theta:" not in contents.column_listing


def test_a_table_that_was_found_in_recordings_says_its_rig(tmp_path):
    apparatus = Apparatus(gravity=Estimate(value=9.81, error=0.01), delay=Estimate(value=0.0, error=1e-4))
    path = tmp_path / "impacts.parquet"
    table.save(synthetic.load(size=20).replace(apparatus=apparatus), path)
    contents = propose(path)
    settings = {one.name: one.value for one in contents.settings}
    assert settings["correct"] == ["rig"]
    assert not contents.unused


def test_horizontal_and_vertical_velocities_are_known_in_several_languages(tmp_path):
    for way in (("horizontal", "vertical"), ("水平", "鉛直")):
        words = ("velocity", "before", "after") if way[0] == "horizontal" else ("速度", "前", "後")
        names = [f"{one} {words[0]} {when} [mm/s]" for when in words[1:] for one in way]
        columns = proposed(tmp_path / f"{way[0]}.csv", *names)
        assert [columns[f"columns.{ours}"] for ours in ("vx", "vy", "vx_post", "vy_post")] == names
        assert columns["units.length"] == "mm"


def test_units_of_columns_that_settings_name_are_theirs(tmp_path):
    names = ("upward A [mm/s]", "upward B [mm/s]", "sideways A [mm/s]", "sideways B [mm/s]")
    columns = dict(zip(("vy", "vy_post", "vx", "vx_post"), names, strict=True))
    settings = {one.name: one.value for one in propose(header(tmp_path / "a.csv", *names), columns).settings}
    assert settings["units.length"] == "mm"


def test_times_of_a_light_gate_are_no_velocities(tmp_path):
    path = tmp_path / "gate.csv"
    dark = np.linspace(10, 100, 20)
    pd.DataFrame({"Dunkelzeit vor Stoß (ms)": dark, "Dunkelzeit nach Stoß (ms)": 1.2 * dark}).to_csv(path, index=False)
    with pytest.raises(DataError, match=r"times in which a light gate is dark\? v = width/t: write columns v_in"):
        propose(path)
    columns = {"vy": "Dunkelzeit vor Stoß (ms)", "vy_post": "Dunkelzeit nach Stoß (ms)"}
    with pytest.raises(DataError, match="a time by its name, and no velocity"):
        table.load(path, columns=columns, mass=1.0, shape={"kind": "disc", "radius": 0.02})


def test_spins_about_z_are_those_of_a_plane():
    impacts = synthetic.load(size=20)
    spins = {
        f"wz_{when} [deg/s]": v[:, 2] * 180 / math.pi for when, v in (("in", impacts.v_pre), ("out", impacts.v_post))
    }
    rows = pd.DataFrame({
        "x": impacts.q[:, 0], "y": impacts.q[:, 1], "theta [rad]": impacts.q[:, 2],
        "vx_in": impacts.v_pre[:, 0], "vy_in": impacts.v_pre[:, 1],
        "vx_out": impacts.v_post[:, 0], "vy_out": impacts.v_post[:, 1], **spins,
    })  # fmt: skip
    read_back = table.load(rows, shape=yaml.safe_load(SHAPE), mass=impacts.mass[0].item())
    torch.testing.assert_close(read_back.v_pre, impacts.v_pre, rtol=ROUNDING, atol=0)
    torch.testing.assert_close(read_back.v_post, impacts.v_post, rtol=ROUNDING, atol=0)
