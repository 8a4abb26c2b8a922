"""Frames of tables that have not a row a frame and a number a cell, of other encodings, and of other programs."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch

from contactlearn.core.errors import DataError
from contactlearn.data import table
from contactlearn.data.headers import propose, stated_by_header
from contactlearn.data.recordings.readers import read
from contactlearn.data.recordings.track import Recording
from contactlearn.data.tracks import track_options
from contactlearn.simulation import synthetic
from contactlearn.simulation.camera import Camera
from contactlearn.simulation.recordings import simulate

TAKES, _ = simulate(2, Camera(frames=40), seed=1)
FRAMES = pd.concat(
    pd.DataFrame({"run": k, "t": one.time, "x": one.position[:, 0], "y": one.position[:, 1], "theta": one.angle})
    for k, one in enumerate(TAKES, 1)
)
SHAPE = {"kind": "ellipse", "semi_axes": [0.035, 0.025]}


def recordings(path: Path) -> list[Recording]:
    found = [*read(path, track_options(**stated_by_header(path)).layout)]
    assert all(isinstance(one, Recording) for one in found), found
    return found  # pyright: ignore[reportReturnType]


def check(path: Path) -> None:
    assert [one.value for one in propose(path).settings if one.name == "mass"] == ["???"]
    for found, wanted in zip(recordings(path), TAKES, strict=True):
        np.testing.assert_allclose(found.time, wanted.time, atol=1e-12)
        np.testing.assert_allclose(found.position, wanted.position, rtol=1e-12)
        np.testing.assert_allclose(found.angle, wanted.angle, rtol=1e-12)


@pytest.mark.parametrize("by_run", [True, False], ids=["frames", "quantities"])
def test_a_row_a_frame_and_quantity(tmp_path, by_run):
    """As a database writes it, with columns that only say where a series is."""
    long = FRAMES.melt(["run", "t"], ["x", "y", "theta"], var_name="_field", value_name="_value")
    long = long.sort_values(["run", "t"], kind="stable") if by_run else long
    long = long.assign(result="", table=long["_field"].map({"x": 0, "y": 1, "theta": 2}), _measurement="pose")
    long.rename(columns={"t": "_time"}).to_csv(tmp_path / "long.csv", index=False)
    check(tmp_path / "long.csv")


@pytest.mark.parametrize("form", ["[{}, {}]", "({} {})", "SVector{{2, Float64}}({}, {})", "array([{}, {}])"])
def test_several_numbers_in_a_cell(tmp_path, form):
    places = [form.format(x, y) for x, y in zip(FRAMES["x"], FRAMES["y"], strict=True)]
    FRAMES.drop(columns=["x", "y"]).assign(pos=places).to_csv(tmp_path / "vectors.csv", index=False)
    check(tmp_path / "vectors.csv")


@pytest.mark.parametrize("end", ["", ", true"])
def test_quaternions_in_a_cell_have_the_scalar_first(tmp_path, end):
    turned = [(np.cos(a / 2), 0.0, np.sin(a / 2), 0.0) for a in FRAMES["theta"]]
    cells = [f"Quaternion{{Float64}}({', '.join(map(repr, map(float, q)))}{end})" for q in turned]
    frame = pd.DataFrame({"run": FRAMES["run"], "t": FRAMES["t"], "q": cells})
    frame["position"] = [f"[{x}, 0.0, {y}]" for x, y in zip(FRAMES["x"], FRAMES["y"], strict=True)]
    frame.to_csv(tmp_path / "vectors.csv", index=False)
    found = recordings(tmp_path / "vectors.csv")
    assert [one.order for one in found] == ["wxyz", "wxyz"]
    np.testing.assert_allclose(np.concatenate([one.rotation for one in found]), turned, rtol=1e-12)


def test_names_that_stand_three_times_above_units(tmp_path):
    """As TrackMate writes spots."""
    names = ("LABEL,TRACK_ID,POSITION_X,POSITION_Y,POSITION_T", "Label,Track ID,X,Y,T", "Label,Track ID,X,Y,T")
    one = TAKES[0]
    rows = [
        f"ID{k},0,{float(1e3 * x)!r},{float(1e3 * y)!r},{float(t)!r}"
        for k, (t, (x, y)) in enumerate(zip(one.time, one.position, strict=True))
    ]
    (tmp_path / "spots.csv").write_text("\n".join([*names, ",,(mm),(mm),(sec)", *rows]) + "\n")
    settings = {setting.name: setting.value for setting in propose(tmp_path / "spots.csv").settings}
    assert settings["unit"] == "mm"
    columns = {"time": settings["columns.time"], "position": settings["columns.position"], "angle": None}
    (found,) = read(tmp_path / "spots.csv", track_options(columns=columns).layout)
    assert isinstance(found, Recording)
    np.testing.assert_allclose(found.position, 1e3 * one.position, rtol=1e-12)
    np.testing.assert_allclose(found.time, one.time, atol=1e-12)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be", "cp932", "cp1252"])
def test_encodings(tmp_path, encoding):
    names = {"t": "時間 [s]", "theta": "角度 [rad]"} if encoding == "cp932" else {"t": "Zeit für [s]"}
    names = names if encoding in ("cp932", "cp1252") else {}
    text = FRAMES.rename(columns=names if encoding == "cp932" else {}).to_csv(index=False, sep="\t")
    text = f"# Prüfer\n{text}" if encoding == "cp1252" else text
    (tmp_path / "takes.csv").write_bytes(text.encode(encoding))
    check(tmp_path / "takes.csv")


def test_frames_in_a_spreadsheet(tmp_path):
    pytest.importorskip("openpyxl")
    FRAMES.to_excel(tmp_path / "takes.xlsx", index=False)
    check(tmp_path / "takes.xlsx")


def test_a_row_of_units_below_the_names_of_frames(tmp_path):
    lines = FRAMES.to_csv(index=False).splitlines()
    (tmp_path / "takes.csv").write_text("\n".join([lines[0], "-,s,m,m,rad", *lines[1:]]) + "\n")
    check(tmp_path / "takes.csv")


def test_two_blanks_part_columns_whose_names_have_one(tmp_path):
    rows = ["   ".join(map(repr, map(float, row))) for row in FRAMES[FRAMES["run"] == 1].to_numpy()[:, 1:]]
    (tmp_path / "take.txt").write_text("\n".join(["time s   x pos m   y pos m   theta rad", *rows]) + "\n")
    columns = {"time": "time s", "position": ["x pos m", "y pos m"], "angle": "theta rad"}
    (found,) = read(tmp_path / "take.txt", track_options(columns=columns).layout)
    assert isinstance(found, Recording)
    np.testing.assert_allclose(found.position, TAKES[0].position, rtol=1e-12)


def drops() -> tuple[pd.DataFrame, torch.Tensor]:
    impacts = synthetic.load(size=12)
    values = torch.cat((impacts.q, impacts.v_pre, impacts.v_post), 1)
    names = ["x", "y", "theta", "vx", "vy", "omega", "vx_post", "vy_post", "omega_post"]
    return pd.DataFrame(values.numpy(), columns=names).assign(trial=range(1, 13)), values


def test_a_log_of_events_has_its_impacts_alone(tmp_path):
    frame, values = drops()
    lines = [{"ts": 0, "event": "start", "operator": "me"}]
    for row in frame.to_dict("records"):
        lines.append({"ts": 1, "event": "drop", "n": row["trial"]})
        sides = {
            side: {"v": [row[f"vx{end}"], row[f"vy{end}"]], "omega": row[f"omega{end}"]}
            for side, end in (("before", ""), ("after", "_post"))
        }
        lines.append({"ts": 2, "event": "impact", "pose": {one: row[one] for one in ("x", "y", "theta")}, **sides})
    path = tmp_path / "log.jsonl"
    path.write_text("\n".join(map(json.dumps, lines)))
    found = table.read(path, shape=SHAPE, mass=0.05)
    np.testing.assert_array_equal(torch.cat((found.impacts.q, found.impacts.v_pre, found.impacts.v_post), 1), values)
    assert "events event='impact' alone, 13 others left out" in found.read_as
    assert propose(path).source == "table"


@pytest.mark.parametrize("suffix", [".json", ".xlsx"])
def test_two_tables_are_joined_by_the_trial(tmp_path, suffix):
    """Whatever the order of their rows."""
    frame, values = drops()
    after = frame[["trial", "vx_post", "vy_post", "omega_post"]].rename(columns=lambda name: name.removesuffix("_post"))
    parts = {"before": frame.drop(columns=["vx_post", "vy_post", "omega_post"]), "after": after[::-1]}
    path = tmp_path / f"drops{suffix}"

    def write(parts):
        if suffix == ".json":
            path.write_text(json.dumps({name: part.to_dict("records") for name, part in parts.items()}))
            return
        pytest.importorskip("openpyxl")
        with pd.ExcelWriter(path) as file:
            for name, part in parts.items():
                part.to_excel(file, sheet_name=name, index=False)

    write(parts)
    found = table.load(path, shape=SHAPE, mass=0.05)
    np.testing.assert_allclose(torch.cat((found.q, found.v_pre, found.v_post), 1), values, rtol=1e-12)
    write({**parts, "after": after.assign(trial=after["trial"] + 1)})
    with pytest.raises(DataError, match=r"no column with the same values in each|tables of numbers in its worksheets"):
        table.load(path, shape=SHAPE, mass=0.05)
