"""Layouts that are refused with what a person can do, and headers with lines above them."""

from pathlib import Path

import pytest

from contactlearn.core.errors import DataError
from contactlearn.data.headers import propose
from contactlearn.data.recordings.readers import Layout, read


@pytest.mark.parametrize(
    ("header", "said"),
    [
        ("Time (s) Run #1,X (m) Run #1,Y (m) Run #1,Time (s) Run #2,X (m) Run #2,Y (m) Run #2", "2 tables stand side"),
        ("n,vx,vy,w,vx after,vy after,w after,,n,vx,vy,w,vx after,vy after,w after", "2 tables stand side by side"),
    ],
)
def test_tables_side_by_side_are_refused(tmp_path: Path, header: str, said: str) -> None:
    file = tmp_path / "runs.csv"
    row = ",".join("" if not name else f"{k}.5" for k, name in enumerate(header.split(",")))
    file.write_text("\n".join([header, *[row] * 9]) + "\n", encoding="utf-8")
    with pytest.raises(DataError, match=said):
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
