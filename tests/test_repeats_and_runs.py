"""Tables of which a row has several impacts or runs, and names that rows below them or a second point complete."""

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from refusals import refused

from contactlearn.core.errors import DataError, UnknownLayoutError
from contactlearn.data import table
from contactlearn.data.headers import propose
from contactlearn.data.recordings.readers import Layout, read
from contactlearn.data.recordings.readers.nested import json_table
from contactlearn.data.table import files
from contactlearn.data.tracks import track_options
from contactlearn.mechanics.rigid_body import GRAVITY

BALL = {"mass": 0.05, "shape": {"kind": "disc", "radius": 0.02}}
EXACT = 1e-12  # relative, of numbers that are converted


def written(path: Path, text: str) -> Path:
    path.write_text(text, "utf-8")
    return path


def velocities(path: Path, **settings: object) -> list[tuple[float, float]]:
    """Normal velocities before and after contact."""
    impacts = table.read(path, **{**BALL, **settings}).impacts  # pyright: ignore[reportArgumentType]
    return [*zip(impacts.v_pre[:, 1].tolist(), impacts.v_post[:, 1].tolist(), strict=True)]


def fallen(height: float, rebound: float) -> tuple[float, float]:
    before, after = np.sqrt(2 * GRAVITY * np.array([height, rebound]))
    return pytest.approx(-before, rel=EXACT), pytest.approx(after, rel=EXACT)


@pytest.mark.parametrize(
    "names", ["drop (cm),rebound 1 (cm),rebound 2 (cm)", "h (cm),h1,h2", "h0 (cm),trial 1,trial 2"]
)
def test_repeats_of_a_rebound_are_an_impact_each(tmp_path: Path, names: str) -> None:
    """Those without a unit are in that of the drop; an empty cell is no impact."""
    path = written(tmp_path / "a.csv", f"{names}\n50,30,31\n60,36,\n70,41,42\n80,49,48\n")
    found = velocities(path)
    heights = ((0.5, 0.3), (0.5, 0.31), (0.6, 0.36), (0.7, 0.41), (0.7, 0.42), (0.8, 0.49), (0.8, 0.48))
    assert found == [fallen(*pair) for pair in heights]


def test_heights_that_fall_from_that_of_the_drop_are_bounces(tmp_path: Path) -> None:
    rows = "".join(f"{h},{0.8 * h},{0.6 * h},{0.4 * h}\n" for h in range(50, 100, 10))
    path = written(
        tmp_path / "a.csv", f"drop (cm),bounce height 1 (cm),bounce height 2 (cm),bounce height 3 (cm)\n{rows}"
    )
    assert velocities(path)[:2] == [fallen(0.5, 0.4), fallen(0.4, 0.3)]


def test_few_rebounds_that_fall_are_asked_about(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", "h,h1,h2\n0.5,0.4,0.3\n0.6,0.5,0.4\n")
    with refused(["'h1', 'h2' fall in each row", "'data.columns={height: h, height_post: h1}'"]):
        velocities(path)
    assert velocities(path, columns={"height": "h", "height_post": "h1"})[0] == fallen(0.5, 0.4)


def test_comments_below_the_names_tell_before_from_after(tmp_path: Path) -> None:
    """As Origin writes long names, units and comments."""
    path = written(
        tmp_path / "a.dat",
        "Run\tVx\tVy\tSpin\tVx\tVy\tSpin\n\tmm/s\tmm/s\trev/s\tmm/s\tmm/s\trev/s\n"
        "\tincoming\tincoming\tincoming\trebound\trebound\trebound\n"
        "1\t100.5\t-1000\t1.5\t90\t800\t2\n2\t100.5\t-2000\t1.5\t90\t1600\t2\n",
    )
    assert velocities(path) == [(-1.0, 0.8), (-2.0, 1.6)]


def test_longer_names_tell_of_what_the_names_leave_open(tmp_path: Path) -> None:
    head = "Shot\tvp\tvn_in\tvt_in\tvn_out\tvt_out\n\tPlate velocity\tNormal before\tb\tNormal after\td\n"
    path = written(
        tmp_path / "a.txt", f"{head}\tm/s\tm/s\tm/s\tm/s\tm/s\n1\t1\t-2\t0.1\t2.5\t0.2\n2\t1\t-3\t0.1\t3\t0.2\n"
    )
    with refused(["'Plate velocity [m/s]'", "racket_vy", "data.covariates"]):
        velocities(path)
    assert velocities(path, columns={"racket_vy": "Plate velocity"}) == [(-3.0, 1.5), (-4.0, 2.0)]


def test_a_signed_velocity_of_the_plate_is_taken_off(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", "v ball before,v ball after,v plate\n-1,0.9,0.2\n-2,1.5,-0.1\n-1,-0.1,-0.5\n")
    assert velocities(path) == [tuple(map(pytest.approx, pair)) for pair in ((-1.2, 0.7), (-1.9, 1.6), (-0.5, 0.4))]


@pytest.mark.parametrize(
    "names", [("vy pelota antes", "vy pala", "vy pelota después"), ("vy balle avant", "vy raquette", "vy balle après")]
)
def test_balls_and_rackets_of_other_languages(tmp_path: Path, names: tuple[str, ...]) -> None:
    path = written(tmp_path / "a.csv", f"{';'.join(f'{name} (m/s)' for name in names)}\n-1;0,2;1,25\n-2;0,1;1,85\n")
    assert velocities(path) == [tuple(map(pytest.approx, pair)) for pair in ((-1.2, 1.05), (-2.1, 1.75))]


def test_the_club_of_a_ball_at_rest_is_asked_about(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", "club speed (m/s),ball speed (m/s)\n40,55\n41,57\n")
    with refused(['\'data.columns={vy: {value: 0}, vy_post: "ball speed (m/s)", racket_vy: "club speed (m/s)"}\'']):
        velocities(path)
    columns = {"vy": {"value": 0}, "vy_post": "ball speed (m/s)", "racket_vy": "club speed (m/s)"}
    assert velocities(path, columns=columns) == [(-40.0, 15.0), (-41.0, 16.0)]


def test_a_racket_is_taken_off_columns_that_settings_name_in_their_units(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", "pitch (mph),bat speed (mph),exit (mph)\n0,70,90\n50,70,100\n")
    columns = {"vy": {"column": "pitch (mph)", "factor": -1}, "vy_post": "exit (mph)", "racket_vy": "bat speed (mph)"}
    mph = 0.44704
    expected = [(-70 * mph, 20 * mph), (-120 * mph, 30 * mph)]
    assert velocities(path, columns=columns) == [tuple(map(pytest.approx, pair)) for pair in expected]


def test_instants_of_bounces_a_row_each(tmp_path: Path) -> None:
    """Runs of four and five bounces, whose flights shrink by the restitution of their floor."""
    rows, expected = ["essai;support;rebond n°;instant (s)"], list[tuple[float, float]]()
    for run, (support, restitution, count) in enumerate((("oak", 0.5, 4), ("lino", 0.8, 5)), 1):
        flights = 0.6 * restitution ** np.arange(count - 1)
        instants = 1.5 + np.concatenate(([0.0], np.cumsum(flights)))
        rows += [f"{run};{support};{k};{instant!r}".replace(".", ",") for k, instant in enumerate(instants.tolist(), 1)]
        speeds = GRAVITY / 2 * flights
        expected += [(pytest.approx(-a), pytest.approx(b)) for a, b in pairwise(speeds)]
    path = written(tmp_path / "a.csv", "\n".join(rows))
    assert velocities(path, covariates=["support"]) == expected
    found = table.read(path, covariates=["support"], **BALL).impacts  # pyright: ignore[reportArgumentType]
    assert found.trial == ("1/2", "1/3", "2/2", "2/3", "2/4")
    assert found.covariates["support"] == ("oak",) * 2 + ("lino",) * 3
    assert propose(path).source == "table"


def test_names_of_rows_stand_in_any_order(tmp_path: Path) -> None:
    path = written(tmp_path / "a.txt", '"vy.pre" "vy.post"\n"5" -1.5 1.2\n"14" -2.5 2.0\n"1" -1.1 0.9\n')
    assert velocities(path) == [(-1.5, 1.2), (-2.5, 2.0), (-1.1, 0.9)]


def test_a_tilt_without_a_unit_is_asked_about(tmp_path: Path) -> None:
    rows = "".join(f"0.1,-{1 + k / 9},0.2,{k / 4},0.1,{1 + k / 12},2\n" for k in range(9))
    path = written(tmp_path / "a.csv", f"vx,vy,omega (rad/s),tilt,vx',vy',omega' (rad/s)\n{rows}")
    with refused(["'tilt' has no unit", "'data.columns={theta: {column: tilt, unit: deg}}'"]):
        velocities(path)
    assert len(velocities(path, columns={"theta": {"column": "tilt", "unit": "deg"}})) == 9


def test_titles_of_further_bodies_are_refused(tmp_path: Path) -> None:
    rows = "".join(f"{k},{0.7 * k}\n" for k in (30, 60, 90))
    path = written(
        tmp_path / "a.csv", f"drop (cm),rebound (cm)\n{rows}Super ball mass = 26 g,\ndrop (cm),rebound (cm)\n{rows}"
    )
    with refused(["tables of several bodies", "Super ball mass = 26 g"]):
        velocities(path)


def test_numbers_beside_the_records_of_json_hold_for_all(tmp_path: Path) -> None:
    content = {"mass": 0.05, "impacts": [{"vy": -1.0, "vy_post": 0.8}, {"vy": -2.0, "vy_post": 1.5}]}
    path = written(tmp_path / "a.json", json.dumps(content))
    assert table.read(path, shape=BALL["shape"]).impacts.mass.tolist() == [0.05, 0.05]  # pyright: ignore[reportArgumentType]


def test_a_twist_has_its_spin_first_where_the_last_three_go_to_the_floor(tmp_path: Path) -> None:
    """As Drake writes spatial velocities."""
    rng = np.random.default_rng(1)
    records = [
        {"X_WB": {"quaternion_wxyz": [1, 0, 0, 0], "translation": [0, 0, 0.02]}, "V_WB_before": [*before, 0.1, 0.2, -1],
         "V_WB_after": [*after, 0.1, 0.2, 0.8]} for before, after in rng.normal(size=(20, 2, 3)).round(3).tolist()
    ]  # fmt: skip
    path = written(tmp_path / "a.json", json.dumps(records))
    assert propose(path).source == "table"
    impacts = table.read(path, mass=0.05, shape={"kind": "sphere", "radius": 0.02}).impacts
    assert impacts.v_pre[0].tolist() == [0.1, 0.2, -1.0, *records[0]["V_WB_before"][:3]]


def test_lists_of_different_lengths_are_left_out_of_frames(tmp_path: Path) -> None:
    frames = [{"t": 0.1 * k, "x": 0.1, "y": 0.2, "tags": [1] * (1 + k % 3)} for k in range(6)]
    assert [*json_table(written(tmp_path / "a.json", json.dumps(frames))).columns] == ["t", "x", "y"]


def test_runs_side_by_side_are_recordings(tmp_path: Path) -> None:
    names = ",".join(f"Time (s) Run #{k},Position (m) Run #{k}" for k in (1, 2))
    rows = "".join(f"{0.02 * k:.2f},{k / 9:.3f},{0.02 * k:.2f},{k / 7:.3f}\n" for k in range(20))
    path = written(tmp_path / "a.csv", f"{names}\n{rows}0.40,2.2,,\n")
    layout = Layout(time="Time (s)", position=({"value": 0}, "Position (m)"), angle=None)  # pyright: ignore[reportArgumentType]
    found = [*read(path, layout)]
    assert [(one.name, len(one.time)) for one in found if not isinstance(one, DataError)] == [
        ("run 1", 21),
        ("run 2", 20),
    ]


def test_worksheets_of_one_header_are_recordings() -> None:
    frames = {
        name: pd.DataFrame([["t", "x", "y"], *np.full((3, 3), k).tolist()]) for k, name in enumerate(("T01", "T02"))
    }
    cells = files._stacked_sheets(Path("a.xlsx"), frames)  # pyright: ignore[reportPrivateUsage]
    assert cells is not None
    assert cells.header == ["recording", "t", "x", "y"]
    assert cells.columns["recording"] == ["T01"] * 3 + ["T02"] * 3


def test_the_longer_axis_of_time_is_that_which_changes_less(tmp_path: Path) -> None:
    """Simulators write [T, environments, 13]."""
    states = np.zeros((30, 4, 13))
    states[:, :, 0] = np.arange(4) * 5 + 0.01 * np.arange(30)[:, None]
    states[:, :, 3] = 1
    np.savez(tmp_path / "a.npz", root_states=states, dt=0.01)
    assert [len(one.time) for one in read(tmp_path / "a.npz") if not isinstance(one, DataError)] == [30] * 4


def test_a_second_point_shows_the_angle(tmp_path: Path) -> None:
    t = np.arange(160) / 100
    flight = t % 0.4  # between bounces
    x, y, angle = 0.5 * t, 0.05 + GRAVITY / 2 * flight * (0.4 - flight), 0.3 + 8 * t
    frame = pd.DataFrame(
        {"Time": t, "a/X": x, "a/Y": y, "b/X": x + 0.03 * np.cos(angle), "b/Y": y + 0.03 * np.sin(angle)}
    )
    path = tmp_path / "a.csv"
    frame.to_csv(path, index=False)
    options = track_options(columns={"time": "Time", "position": ["a/X", "a/Y"], "angle": ["b/X", "b/Y"]})
    (found,) = read(path, options.layout)
    assert (options.conventions.angle, options.conventions.sense) == ("rad", "as_read")
    assert not isinstance(found, DataError)
    assert found.angle is not None
    assert np.allclose(np.unwrap(found.angle), angle)
    assert 'angle: ["b/X", "b/Y"]' in propose(path).column_listing


def test_the_command_of_an_open_table_names_what_was_found(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    before = -1 - rng.random(20)
    frame = pd.DataFrame({"A": before, "B": -0.7 * before, "note": rng.random(20)})
    frame.to_csv(tmp_path / "a.csv", index=False)
    with refused(["'data.columns={vy: A, vy_post: B}'"], UnknownLayoutError):
        propose(tmp_path / "a.csv")
