"""Layouts that are refused with what a person can do, and headers with lines above them."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from contactlearn.cli.commands.init import write_settings
from contactlearn.core.errors import DataError
from contactlearn.data.headers import OPEN, propose
from contactlearn.data.recordings.readers import Layout, read
from contactlearn.data.table.several import refusal_side_by_side


@pytest.mark.parametrize(
    ("header", "said"),
    [
        ("n,vx,vy,w,vx after,vy after,w after,,n,vx,vy,w,vx after,vy after,w after", "2 tables stand side by side"),
        ("shot,vx,vy,vx after,vy after,vx,vy,vx after,vy after", "2 bodies.*between two moving bodies is not covered"),
        (
            "shot,red_vx_before,red_vy_before,red_omega_before,red_vx_after,red_vy_after,red_omega_after,"
            "blue_vx_before,blue_vy_before,blue_omega_before,blue_vx_after,blue_vy_after,blue_omega_after",
            "2 bodies.*between two moving bodies is not covered",
        ),
    ],
)
def test_tables_side_by_side_are_refused(tmp_path: Path, header: str, said: str) -> None:
    file = tmp_path / "runs.csv"
    row = ",".join("" if not name else f"{k}.5" for k, name in enumerate(header.split(",")))
    file.write_text("\n".join([header, *[row] * 9]) + "\n", encoding="utf-8")
    with pytest.raises(DataError, match=said):
        propose(file)


@pytest.mark.parametrize(
    "header",
    [
        "frame,X,Y,theta,X,Y,theta",
        "vx,vy,omega,vx,vy,omega",
        "vx before,vx before,vy before,vy before,vx after,vx after,vy after,vy after",
    ],
)
def test_names_that_repeat_otherwise_are_no_tables(header: str) -> None:
    assert not refusal_side_by_side(header.split(","))


def test_a_cell_too_long_for_csv_is_refused_in_a_line(tmp_path: Path) -> None:
    file = tmp_path / "drops.csv"
    file.write_text(f"vx,vy\n{'1' * 200_000},2\n" * 3, encoding="utf-8")
    with pytest.raises(DataError, match=r"drops\.csv: "):
        propose(file)


def test_a_column_a_trial_is_to_be_transposed(tmp_path: Path) -> None:
    file = tmp_path / "drops.csv"
    names = ("theta", "vx before", "vy before", "omega before", "vx after", "vy after", "omega after")
    title = "drops of an ellipse" + ";" * 9 + "\n"
    file.write_text(
        title + "\n".join(f"{name};" + ";".join(f"{k},25" for k in range(9)) for name in ("drop", *names)) + "\n"
    )
    with pytest.raises(DataError, match="transpose"):
        propose(file)


def test_lines_above_the_header_and_marks_of_lost_frames(tmp_path: Path) -> None:
    file = tmp_path / "take.csv"
    rows = [f"{k},{k / 100},1.0,0.5" for k in range(12)] + ["12,-3.697314E28,-3.697314E28,-3.697314E28"]
    file.write_text("Number of frames: 13\nFrequency: 250.00\n\nFrame,x,y,theta\n" + "\n".join(rows) + "\n")
    assert {one.name: one.value for one in propose(file).settings}["rate"] == 250
    (recording,) = read(file, Layout(rate=250))
    assert not isinstance(recording, DataError)
    assert recording.seen.tolist() == [True] * 12 + [False]


@pytest.mark.parametrize(
    ("above", "rate"),
    [
        (["Sampling rate: 250 Hz", "Cutoff frequency: 6 Hz"], 250),
        (["camera_rate [Hz],120"], 120),
        (["Frequency: 250 Hz"], 250),
        (["Frequency: 250"], OPEN),
        (["Low-pass filter", "Frequency: 6 Hz"], OPEN),
        (["Cut-off frequency: 6 Hz"], OPEN),
        (["Sampling rate: 1.5 kHz"], OPEN),
    ],
)
def test_a_cutoff_is_no_rate_of_frames(tmp_path: Path, above: list[str], rate: float) -> None:
    file = tmp_path / "take.csv"
    file.write_text("\n".join([*above, "Frame,x,y,theta", *(f"{k},{k / 100},1.0,0.5" for k in range(12))]) + "\n")
    assert {one.name: one.value for one in propose(file).settings}["rate"] == rate


def test_a_row_longer_than_those_above_it_is_counted(tmp_path: Path) -> None:
    file = tmp_path / "take.csv"
    file.write_text("# a comment\ntime,x,y,theta\n0,1,2,3\n1,2,3,4,5,6\n")
    with pytest.raises(DataError, match="line 4 has 6 cells, and those above it have 4"):
        list(read(file, Layout()))


def test_a_file_whose_name_begins_with_a_digit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    file = Path("2026_drops.csv")
    file.write_text("time,x,y,theta\n" + "".join(f"{k / 100},{k / 100},1.0,0.5\n" for k in range(12)))
    write_settings(file, None)
    assert Path("data_2026_drops.yaml").is_file()


@pytest.mark.parametrize("header", ["trial,x,y,vx,vy,omega", "x,y,vx before,vy before,omega before,w"])
def test_values_before_contact_alone_are_no_recording(tmp_path: Path, header: str) -> None:
    file = tmp_path / "drops.csv"
    file.write_text("\n".join([header, *(f"{k},1.{k},0.5,{k % 3},-2.{k},{k}.5" for k in range(9))]) + "\n")
    with pytest.raises(DataError, match="has no velocity after contact") as refused:
        propose(file)
    assert "contactlearn audit" in str(refused.value)
    assert "position" not in str(refused.value)


def test_numbers_that_count_the_trials_are_no_frames(tmp_path: Path) -> None:
    """The page of a table whose rows grow evenly is that of impacts, once a name says so."""
    file = tmp_path / "fall.csv"
    rows = (f"{k};{2 + k // 9};{100 + k};{k % 4}" for k in range(20))
    file.write_text("\n".join(["Nr.;Masse [kg];Fallhöhe [mm];Rest [mm]", *rows]) + "\n")
    with pytest.raises(DataError, match=r"none of 'Nr\.', 'Rest \[mm\]' is known to be it") as refused:
        propose(file)
    assert "height? by its name" in str(refused.value)


def test_a_guess_has_the_unit_of_its_column(tmp_path: Path) -> None:
    """An angle is no spin, and revolutions are no speed; the speeds are in the file that init writes."""
    file, generator = tmp_path / "cushion.tsv", np.random.default_rng(0)
    speed, angle, spin = generator.uniform(1, 4, 40), generator.uniform(-60, 60, 40), generator.uniform(-9, 9, 40)
    columns = {"V1 (m/s)": speed, "alpha1 (deg)": angle, "side1 (rev/s)": spin}
    columns |= {"V2 (m/s)": 0.8 * speed, "alpha2 (deg)": 0.9 * angle, "side2 (rev/s)": 0.7 * spin - 0.01 * angle}
    pd.DataFrame(columns).to_csv(file, sep="\t", index=False)
    settings = {setting.name: setting.value for setting in propose(file).settings}
    assert (settings["columns.speed"], settings["columns.speed_post"]) == ("V1 (m/s)", "V2 (m/s)")
    assert settings["columns.direction_floor"] == OPEN
    guessed = {
        line.split("  ")[1]: line for line in propose(file).column_listing.splitlines() if line.startswith("  '")
    }
    assert "omega? " in guessed["'side1 (rev/s)'"]
    assert "?" not in guessed["'alpha1 (deg)'"]
