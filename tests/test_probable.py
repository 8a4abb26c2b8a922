"""Of a file whose names say nothing, init says what each column probably is, and prints the command that names them."""

import shlex

import numpy as np
import pandas as pd
import pytest
import torch
from commands import run
from scipy.spatial.transform import Rotation

from contactlearn.core.errors import DataError
from contactlearn.data.headers import propose
from contactlearn.simulation import synthetic
from contactlearn.simulation.recordings import simulate


@pytest.fixture(scope="module")
def discs() -> pd.DataFrame:
    """Drops of a disc, whose velocities before and after contact are correlated, as measured; names say nothing."""
    generator = np.random.default_rng(1)
    n, e, k, R = 80, 0.6, 0.3, 0.03
    vx, vy, omega = generator.uniform(-2, 2, n), -generator.uniform(1, 3, n), generator.uniform(-60, 60, n)
    slip = vx + R * omega
    columns = {
        "lauf": np.arange(1, n + 1), "art": ["a", "b"] * (n // 2), "gew": 58.0,
        "s9": np.degrees(generator.uniform(-np.pi, np.pi, n)),
        "s1": omega, "s2": vy, "s3": vx, "s4": -e * vy, "s5": vx - k * slip, "s6": omega - 2 * k * slip / R,
    }  # fmt: skip
    return pd.DataFrame(columns)


def told(path) -> dict[str, str]:
    """What is said of each column, and the command."""
    with pytest.raises(DataError) as caught:
        propose(path)
    lines = [line.strip() for line in str(caught.value).splitlines()]
    return {line.split("'")[1]: line for line in lines[1:] if line.startswith("'")} | {"command": lines[-1]}


def test_impacts_by_what_contact_does_to_them(tmp_path, discs, monkeypatch):
    monkeypatch.chdir(tmp_path)
    discs.to_csv("drops.csv", index=False)
    said = told(tmp_path / "drops.csv")
    wanted = {"lauf": "trial", "s9": "theta", "s1": "omega", "s2": "vy", "s3": "vx", "s4": "vy_post", "s5": "vx_post"}
    for name, ours in {**wanted, "s6": "omega_post"}.items():
        assert f" {ours}? " in said[name], said[name]
    assert "text, 2 different" in said["art"]
    assert "the same in all rows" in said["gew"]
    assert "an angle in deg" in said["s9"]
    assert "'s4' is 0.6 of it" in said["s2"]
    command = said["command"].replace("mass=?", "mass=0.058").replace("radius: ?", "radius: 0.03")
    assert "80 impacts" in run(*shlex.split(command.replace("angle=?", "angle=rad")), cwd=".")
    lines = run("contactlearn", "init", "drops.csv", cwd=".", status=2).splitlines()
    assert (len(lines), lines[-1].split()[:3]) == (13, ["contactlearn", "audit", "drops.csv"])


def test_frames_by_their_clock_and_gravity(tmp_path):
    (take, _), _ = simulate(2, seed=1)
    frames = pd.DataFrame(
        {"a": 1e3 * take.position[:, 0], "b": 1e3 * take.position[:, 1], "c": np.degrees(take.angle), "tick": take.time}
    )
    frames["d"] = np.gradient(frames["b"]) / np.gradient(frames["tick"])
    frames.to_csv(tmp_path / "take.csv", index=False)
    said = told(tmp_path / "take.csv")
    for name, words in {
        "tick": "time? grows by 0.004",
        "b": "a height in mm, up positive",
        "c": "angle? leaps by a turn: an angle in deg",
        "d": "the rate of change of 'b'",
    }.items():
        assert words in said[name], said[name]
    assert "straight while 'b' falls" in said["a"]
    assert "'data.columns={time: tick, position: [a, b], angle: c}'" in said["command"]
    assert "data.unit=mm data.angle=deg" in said["command"] or "data.angle=deg data.unit=mm" in said["command"]


def test_the_command_reads_frames_in_other_units_as_it_says(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    takes, _ = simulate(2, seed=1)
    frames = [
        pd.DataFrame({"n": k, "s": 1e3 * one.time, "b": -100 * one.position[:, 1], "a": 100 * one.position[:, 0],
                      "c": -np.degrees(one.angle)})
        for k, one in enumerate(takes)
    ]  # fmt: skip
    pd.concat(frames).to_csv("takes.csv", index=False)
    command = told(tmp_path / "takes.csv")["command"].replace("mass=?", "mass=0.05")
    assert "time: {column: s, unit: ms}, position: [a, b], angle: c, recording: n}'" in command
    command = command.replace("{kind: disc, radius: ?}", "{kind: ellipse, semi_axes: [0.035, 0.025]}")
    assert "impacts from 2 recordings" in run(*shlex.split(command), cwd=".")


def test_frame_numbers_and_pixels_have_the_rate_and_size_of_the_comment(tmp_path):
    (take, _), _ = simulate(2, seed=1)
    numbers = {
        "frame": np.arange(len(take)),
        "u [px]": take.position[:, 0] / 5e-4,
        "w [px]": take.position[:, 1] / 5e-4,
    }
    frame = pd.DataFrame({**numbers, "a": take.angle})
    (tmp_path / "take.csv").write_text("# scale 0.5 mm/px, 250 fps\n" + frame.to_csv(index=False))
    contents = propose(tmp_path / "take.csv")
    command = contents.column_listing.splitlines()[-1]
    assert 'position: ["u [px]", "w [px]"], angle: a' in command
    assert "data.rate=250 data.unit=0.0005" in command


def test_pixels_a_frame_have_their_factor(tmp_path, discs, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {"s9": "theta (deg)", "s3": "vx (px/frame)", "s2": "vy (px/frame)", "s1": "omega (deg/frame)"}
    after = {"s5": "vx after (px/frame)", "s4": "vy after (px/frame)", "s6": "omega after (deg/frame)"}
    table = discs[[*names, *after]].rename(columns=names | after)
    for name in table:
        table[name] /= 0.125 if "px" in name else np.radians(250) if "frame" in name else 1
    (tmp_path / "drops.csv").write_text("# 250 fps, 1 px = 0.5 mm\n" + table.to_csv(index=False))
    command = told(tmp_path / "drops.csv")["command"]
    assert 'vx: {column: "vx (px/frame)", factor: 0.125}' in command
    command = command.replace("mass=?", "mass=0.058").replace("radius: ?", "radius: 0.03")
    assert "consistent with planar rigid impacts" in run(*shlex.split(command), cwd=".")


@pytest.mark.parametrize(
    "remark",
    [
        "0.5 mm/px",
        "1 px = 0.5 mm",
        "mm_per_px: 0.5",
        "2 px/mm",
        "px per mm = 2",
        "pixel size: 0.5 mm",
        "scale [mm/px] 0.5",
    ],
)
def test_sizes_of_a_pixel(tmp_path, remark):
    rows = "".join(f"{k / 100},{k},1.0,0.5\n" for k in range(12))
    (tmp_path / "take.csv").write_text(f"# {remark}\ntime,x [px],y [px],theta\n{rows}")
    assert {one.name: one.value for one in propose(tmp_path / "take.csv").settings}["unit"] == 0.0005


def test_a_quaternion_by_its_norm(tmp_path):
    turns = Rotation.random(30, random_state=np.random.default_rng(0)).as_quat()
    numbers = np.random.default_rng(2).uniform(-1, 1, (30, 2))
    frame = pd.DataFrame(np.column_stack([numbers, turns]), columns=[*"abcdef"])
    frame.to_csv(tmp_path / "drops.csv", index=False)
    said = told(tmp_path / "drops.csv")
    for name, ours in zip("cdef", ("qw", "qx", "qy", "qz"), strict=True):
        assert f" {ours}? the norm of these four is 1" in said[name]


@pytest.mark.parametrize("rows", [1, 2, 9, 200])
@pytest.mark.parametrize("kind", ["constant", "noise", "gaps", "text", "whole"])
def test_any_numbers_are_described(tmp_path, rows, kind):
    generator = np.random.default_rng(rows)
    numbers = generator.normal(size=(rows, 5)) * 10.0 ** generator.integers(-300, 300, 5)
    if kind == "gaps":
        numbers[generator.random(numbers.shape) < 0.5] = np.nan
    other = {"constant": np.zeros((rows, 5)), "whole": np.tile(np.arange(rows), (5, 1)).T}
    frame = pd.DataFrame(other.get(kind, numbers))
    frame = frame.astype(str) + "?" if kind == "text" else frame
    frame.set_axis([*"ABCDE"], axis=1).to_csv(tmp_path / "odd.csv", index=False)
    assert told(tmp_path / "odd.csv")["command"].startswith("contactlearn ")


def test_a_hostile_name_is_quoted(tmp_path):
    numbers = torch.cat((synthetic.load(size=20).v_pre, synthetic.load(size=20).v_post), 1).numpy()
    names = ["a b", "c'd", '"e"', "$(x)", "{f", "g, h"]
    pd.DataFrame(numbers, columns=names).to_csv(tmp_path / "a b's.csv", index=False)
    with pytest.raises(DataError) as caught:
        propose(tmp_path / "a b's.csv")
    assert shlex.split(str(caught.value).splitlines()[-1])[2] == str(tmp_path / "a b's.csv")
