"""Tables as people have them: other names, units and senses, further columns, columns that the shape gives."""

import csv
import json
import math
import re
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from commands import run
from corruptions import corrupt
from hypothesis import given, settings, strategies as st
from refusals import refused

from contactlearn.cli.commands import loading
from contactlearn.cli.commands.loading import load_data
from contactlearn.cli.settings import SourceSettings
from contactlearn.core.errors import DataError, UnknownNameError
from contactlearn.data import table
from contactlearn.data.audit.corrections import CORRECTIONS, correct
from contactlearn.data.audit.findings import audit, quick_audit
from contactlearn.data.table.units import UNIT_FACTORS
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.shapes import contact_point, make_shape
from contactlearn.mechanics.space import PLANE
from contactlearn.simulation import synthetic

ROOT = Path(__file__).parents[1]
ROUNDING = 1e-12  # relative; a few float64 roundings of a product of factors
SHAPE = {"kind": "ellipse", "semi_axes": [0.035, 0.025]}
ELLIPSE = f"data.shape={SHAPE}".replace("'", "")

# How many of a unit make one in SI, by hand.
LENGTH = {"m": 1, "cm": 100, "mm": 1000, "um": 1e6, "km": 1e-3, "in": 1 / 0.0254, "ft": 1 / 0.3048, "mi": 1 / 1609.344}
MASS = {"kg": 1, "g": 1000, "mg": 1e6, "lb": 1 / 0.45359237, "oz": 16 / 0.45359237}
ANGLE = {"rad": 1, "deg": 180 / math.pi, "rev": 0.5 / math.pi}
TIME = {"s": 1, "ms": 1000, "us": 1e6, "min": 1 / 60, "h": 1 / 3600}
SENSE = {"counterclockwise": 1, "clockwise": -1}


def measured(size: int = 30) -> Impacts:
    """Drops with everything optional: poses after contact, times, covariances."""
    drops = synthetic.load(size=size)
    half = torch.randn(size, 3, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(1))
    errors = {"v_pre_cov": half @ half.mT, "v_post_cov": half.mT @ half}
    return drops.replace(time=torch.linspace(0, 600, size, dtype=torch.float64), **errors)


def columns_of(impacts: Impacts) -> dict[str, list]:
    """The columns of a table by our names, in SI."""
    columns: dict[str, list] = {"trial": [*impacts.trial], "object": [*impacts.object]}
    for field, names in PLANE.components.items():
        if getattr(impacts, field) is not None:
            columns |= zip(names, getattr(impacts, field).reshape(len(impacts), -1).T.tolist(), strict=True)
    for field, names in PLANE.covariances.items():
        if getattr(impacts, field) is not None:
            columns |= zip(names, getattr(impacts, field)[:, *PLANE.upper].T.tolist(), strict=True)
    return columns


def in_units(length: str, mass: str, angle: str, time: str, rotation: str) -> dict[str, float]:
    """How many of the file's units one SI unit of each column is."""
    a, t, turn = LENGTH[length], TIME[time], ANGLE[angle] * SENSE[rotation]
    speed, spin = a / t, turn / t
    factors = dict.fromkeys(("rx", "ry", "x", "y", "x_post", "y_post"), a) | {"mass": MASS[mass], "time": t}
    factors |= dict.fromkeys(("theta", "theta_post"), turn) | {"inertia": MASS[mass] * a**2}
    for end in ("", "_post"):
        factors |= {f"vx{end}": speed, f"vy{end}": speed, f"omega{end}": spin}
        factors |= dict.fromkeys((f"cov_vx_vx{end}", f"cov_vx_vy{end}", f"cov_vy_vy{end}"), speed**2)
        factors |= dict.fromkeys((f"cov_vx_omega{end}", f"cov_vy_omega{end}"), speed * spin)
        factors |= {f"cov_omega_omega{end}": spin**2}
    return factors


def written(path: Path, columns: dict[str, list]) -> Path:
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([columns, *zip(*columns.values(), strict=True)])
    return path


def assert_close(mine: Impacts, theirs: Impacts) -> None:
    for name in (*PLANE.components, *PLANE.covariances):
        a, b = getattr(mine, name), getattr(theirs, name)
        assert (a is None) == (b is None), name
        if b is not None:
            torch.testing.assert_close(a, b, rtol=ROUNDING, atol=0, msg=name)
    assert (mine.trial, mine.object) == (theirs.trial, theirs.object)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    units=st.fixed_dictionaries({quantity: st.sampled_from([*units]) for quantity, units in UNIT_FACTORS.items()}),
    mapped=st.sets(st.sampled_from(table.COLUMNS[:31])),
    order=st.randoms(use_true_random=False),
)
def test_any_names_and_units_give_the_same_impacts(tmp_path_factory, units, mapped, order):
    drops = measured()
    factors = in_units(**units)
    columns = {
        f"column {name}" if name in mapped else name: [x * factors.get(name, 1) for x in values]
        if name not in table.NAMES
        else values
        for name, values in columns_of(drops).items()
    }
    shuffled = order.sample([*columns], len(columns))
    path = written(tmp_path_factory.mktemp("own") / "own.csv", {name: columns[name] for name in shuffled})
    names = {name: f"column {name}" for name in mapped if f"column {name}" in columns}
    assert_close(table.load(path, SHAPE, names, units), drops)


def test_every_unit_is_tried_above():
    tried = {"length": LENGTH, "mass": MASS, "angle": ANGLE, "time": TIME, "rotation": SENSE}
    assert {name: {*units} for name, units in UNIT_FACTORS.items()} == {name: {*units} for name, units in tried.items()}


@pytest.fixture
def drops():
    return synthetic.load(size=40)


def test_names_may_be_exchanged(tmp_path, drops):
    columns = columns_of(drops)
    columns["vx"], columns["vy"] = columns["vy"], columns["vx"]
    assert_close(table.load(written(tmp_path / "own.csv", columns), columns={"vx": "vy", "vy": "vx"}), drops)
    # As those after impact are; names that are given or written as ours go first, and covariances keep theirs.
    columns = columns_of(drops)
    before = {f"{name}_pre" if name in ("vx", "vy", "omega") else name: values for name, values in columns.items()}
    assert_close(table.load(written(tmp_path / "own.csv", before)), drops)
    turned = before | {"vx_pre": columns["vy"], "vy_pre": columns["vx"]}
    mapped = {"vx": "vy_pre", "vy": "vx_pre"}
    assert_close(table.load(written(tmp_path / "own.csv", turned), columns=mapped), drops)
    both = table.read(written(tmp_path / "own.csv", columns | {"vx_pre": [0.0] * len(drops)}))
    assert both.unused == ("vx_pre",)
    assert_close(both.impacts, drops)
    for name in ("omega_pre", "vx_pre"):
        part = {key: values for key, values in before.items() if key != name}
        with pytest.raises(DataError, match=f"missing column {name.removesuffix('_pre')}"):
            table.load(written(tmp_path / "own.csv", part))


def test_errors_name_the_column_and_the_value_as_written(tmp_path, drops):
    names, units = {"vy": "sink rate", "mass": "weight"}, {"length": "mm", "time": "ms", "mass": "g"}
    own = {names.get(name, name): values for name, values in columns_of(drops).items()}
    for column, value, fragments in (
        ("sink rate", "fast", ["row 2 (line 3), column sink rate: must be a finite number in mm/ms; got 'fast'"]),
        ("weight", "-5", ["row 2", "got -0.005", "line 3 of the file; column weight has '-5' there"]),
        ("inertia", "", ["column inertia: must be a finite number in g mm²"]),
    ):
        changed = own | {column: [own[column][0], value, *own[column][2:]]}
        with refused(fragments):
            table.load(written(tmp_path / "own.csv", changed), columns=names, units=units, validate=False)
    columns = columns_of(drops)
    gaps = [*columns["vx"][:7], "", *columns["vx"][8:20], "nan", *columns["vx"][21:]]
    with pytest.raises(DataError, match=r"row 8 .*the cell is empty: .*\(2 rows of the column are like this one\)"):
        table.load(written(tmp_path / "own.csv", columns | {"vx": gaps}))
    with pytest.raises(DataError, match=r"the cell is empty.*drop_incomplete[^(]*$"):
        table.load(written(tmp_path / "own.csv", columns | {"vx": [*columns["vx"][:7], "", *columns["vx"][8:]]}))


def test_incomplete_rows_of_a_logger_that_crashed(tmp_path, drops):
    """Cut short, with a separator lost, with control bytes, with an error of a spreadsheet: only whole rows remain."""
    path = written(tmp_path / "log.csv", {"trial": [*range(1, 41)], **columns_of(drops)})
    header, *lines = path.read_text("utf-8").splitlines()
    width = header.count(",")
    lines[3] = ",".join(lines[3].split(",")[:5])
    lines[7] = "".join(lines[7].rsplit(",", 1))
    cells = {10: "\xff\xff\x01?", 20: "#VALUE!", 30: "1.23450.9876"}
    for row, cell in cells.items():
        lines[row] = ",".join([*lines[row].split(",")[:-1], cell])
    path.write_bytes("\n".join([header, *lines, ""]).encode("latin-1"))
    with pytest.raises(DataError, match=rf"row 4 .* has 5 cells where the header has {width + 1}.*drop_incomplete"):
        table.read(path)
    found = table.read(path, drop_incomplete=True).impacts
    assert found.incomplete == ("4", "8", "11", "21", "31")
    whole = [k for k in range(40) if str(k + 1) not in found.incomplete]
    assert_close(found, drops[whole])
    assert any("5 of 40 trials" in finding.sentence for finding in audit(found))
    mostly = [line if k % 3 else line.rsplit(",", 1)[0] for k, line in enumerate(lines)]
    mostly = [line if k % 3 == 1 else line.rsplit(",", 1)[0] for k, line in enumerate(mostly)]
    path.write_bytes("\n".join([header, *mostly, ""]).encode("latin-1"))
    with pytest.raises(DataError, match="cells where the header has"):
        table.read(path, drop_incomplete=True)


def test_further_columns_are_not_used_and_named(tmp_path, drops, capsys):
    extra = {"friction": ["?"] * 40, "": [*range(40)], "temperature": [""] * 40}
    path = written(tmp_path / "own.csv", columns_of(drops) | extra)
    found = table.read(path, drop_incomplete=True)
    assert found.unused == ("friction", "", "temperature")
    assert found.impacts.incomplete == ()
    assert_close(found.impacts, drops)
    load_data(SourceSettings(target="contactlearn.data.table.load", options={"path": str(path)}))
    assert capsys.readouterr().out == "columns not used: friction, '', temperature\n"
    path = written(tmp_path / "own.csv", columns_of(drops) | {"inertia": [7.0] * 40, "tme": ["noon"] * 40})
    found = table.read(path, shape=SHAPE, columns={"inertia": None, "time": None})
    assert found.unused == ("inertia", "tme")
    torch.testing.assert_close(found.impacts.inertia, drops.inertia, rtol=ROUNDING, atol=0)
    with pytest.raises(DataError, match=r"'tme', did you mean 'time'\?; 'data.columns=\{time: tme\}.*\{time: null\}"):
        table.read(path)


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_table_of_our_own_uses_and_computes_everything(tmp_path, drops, capsys, suffix):
    path = table.save(drops, tmp_path / f"drops{suffix}")
    assert (table.read(path, shape=SHAPE).unused, table.read(path, shape=SHAPE).computed) == ((), ())
    load_data(SourceSettings(target="contactlearn.data.table.load", options={"path": str(path)}))
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    "shape",
    [SHAPE, {"kind": "disc", "radius": 0.03}, {"kind": "polygon", "vertices": [[1, 2], [-1, 2], [-1, -2], [1, -2]]}],
    ids=lambda shape: shape["kind"],
)
@pytest.mark.parametrize("left_out", [("rx", "ry"), ("inertia",), ("rx", "ry", "inertia")], ids="-".join)
def test_the_shape_gives_what_is_left_out(tmp_path, drops, shape, left_out):
    body = make_shape(shape)
    other = {"rx": [0.0] * 40, "ry": [-1.0] * 40, "inertia": [7.0] * 40}
    path = written(tmp_path / "own.csv", {n: x for n, x in (columns_of(drops) | other).items() if n not in left_out})
    found = table.read(path, shape=shape, validate=False)
    assert {column for field in found.computed for column in PLANE.components[field]} == {*left_out}
    r, inertia = contact_point(body, drops.q[:, 2]), drops.mass * body.gyration_squared()
    assert torch.equal(found.impacts.r, r) == ("rx" in left_out)
    assert torch.equal(found.impacts.inertia, inertia) == ("inertia" in left_out)


BAD_HEADER = {
    "needs a shape": ({"rx": None, "ry": None}, None, ["missing column rx, ry", "data.shape={kind: …}, from which"]),
    "inertia needs one": ({"inertia": None}, None, ["missing column inertia", "data.shape="]),
    "a ball": ({"theta": None}, {"kind": "sphere", "radius": 0.02},
        ["a sphere is a body in space", "no orientation at all", "in a plane write {kind: disc, radius: 0.02}",
         "data.inertia: that of a solid ball is 0.00016 m² (2/5 r²) times its mass"]),
    "half a contact point": ({"ry": None}, SHAPE, ["missing column ry"]),
    "slips": ({"vx": "vx_", "omega": "sipn", "vy": "vvy"}, SHAPE,
        ["'vvy', did you mean 'vy'?", "missing column omega", "not used: 'sipn'", "data.columns={vy: vvy, omega: …}"]),
    "names of their own": ({"mass": "weight", "x": "right", "y": "high", "rx": None, "ry": None}, None, [
        "5 columns are missing, or have other names than ours",
        "'data.columns={mass: …, rx: …, ry: …, x: …, y: …}' says", "not used: 'weight', 'right', 'high'",
        "data.shape={kind: …}, from which rx, ry, x, y are computed"]),
    "two near one": ({"vx": "vxx", "vy": None, "omega_post": "omega_pots", "omega": "omega_b"}, SHAPE,
        ["data.columns={vx: vxx, omega: omega_b, omega_post: omega_pots, vy: …}'"]),
    "two of one meaning": ({"x": "x_mm", "vx_post": "X [cm]"}, SHAPE,
        ["column x may be 'x_mm' or 'X [cm]'", "data.columns={x: x_mm}"]),
    "units that half of the columns state": ({"x": "x [mm]"}, SHAPE,
        ["'x [mm]' is in mm", "data.units.length=mm if these are too", "data.units.length=m if they are in m"]),
}  # fmt: skip


@pytest.mark.parametrize(("renamed", "shape", "fragments"), BAD_HEADER.values(), ids=BAD_HEADER)
def test_headers_that_are_refused(tmp_path, drops, renamed, shape, fragments):
    columns = {renamed.get(name, name): values for name, values in columns_of(drops).items()}
    columns.pop(None, None)
    with refused(fragments):
        table.load(written(tmp_path / "own.csv", columns), shape)


def test_names_with_units_are_proposed_as_a_shell_and_hydra_take_them(tmp_path, drops):
    own = {"theta": "theta (rad)", "omega": "omega [rad/s]", "vx": 'vx"\\', "vy": "vy's", "mass": "mass"}
    columns = {own.get(name, name): values for name, values in columns_of(drops).items()}
    path = written(tmp_path / "own.csv", columns)
    expected = run("contactlearn", "audit", str(path), status=2)
    proposed = shlex.split(re.search(r"; ('data.columns=.*) says which columns", expected)[1])
    assert len(proposed) == 1
    assert f"{len(drops)} impacts" in run("contactlearn", "audit", str(path), *proposed)


BAD_SETTINGS = {
    "our name last": ({"columns": {"speed": "vx"}}, UnknownNameError, ["our name comes first: {vx: speed}"]),
    "no such name": ({"columns": {"vxx": "speed"}}, UnknownNameError, ["data.columns: 'vxx', did you mean 'vx'"]),
    "no such column": ({"columns": {"vx": "omga"}}, DataError, ["data.columns.vx=omga: no such column, did you mean"]),
    "one for two": ({"columns": {"vx": "vy"}}, DataError, ["uses 'vy' 2 times"]),
    "a list": ({"columns": ["vx"]}, DataError, ["data.columns is given as {vx: speed_x", "['vx']"]),
    "no such quantity": ({"units": {"lenght": "mm"}}, UnknownNameError, ["'lenght', did you mean 'length'"]),
    "no such unit": ({"units": {"angle": "degree"}}, UnknownNameError, ["data.units.angle: 'degree', did you mean"]),
    "one unit": ({"units": "mm"}, DataError, ["data.units is given as {length: mm", "'mm'"]),
}


@pytest.mark.parametrize(("changes", "kind", "fragments"), BAD_SETTINGS.values(), ids=BAD_SETTINGS)
def test_settings_that_are_refused(tmp_path, drops, changes, kind, fragments):
    path = table.save(drops, tmp_path / "drops.csv")
    if changes.get("columns") == {"vx": "vy"}:
        changes = {"columns": {"vx": "vy", "vy": "vy"}}
    with refused(fragments, kind):
        table.load(path, **changes)


@pytest.mark.parametrize("names", [["mirrored_theta"], ["mirrored_theta", "inertia_scaled"]], ids="-".join)
def test_computed_contact_points_follow_corrections(tmp_path, drops, names):
    """Those of the corrected θ, before the next correction looks at them."""
    wrong = corrupt(drops, "mirrored_theta").replace(inertia=drops.inertia * (10 if "inertia_scaled" in names else 1))
    columns = {name: values for name, values in columns_of(wrong).items() if name not in ("rx", "ry")}
    path = written(tmp_path / "own.csv", columns)
    cfg = {"_target_": "contactlearn.data.table.load", "path": str(path), "shape": SHAPE, "correct": names}
    corrected = load_data(SourceSettings.from_values(cfg)).impacts
    assert (corrected.validate, corrected.source) == (True, f"{path} (corrected: {', '.join(names)})")
    torch.testing.assert_close(corrected.inertia, drops.inertia, rtol=0.05, atol=0)
    torch.testing.assert_close(corrected.r, drops.r, rtol=1e-9, atol=1e-12)
    garbage = table.load(path, SHAPE, validate=False)
    assert torch.allclose(correct(garbage, ["mirrored_theta"]).r, drops.r, atol=1e-12)


def test_contact_points_are_not_computed_from_degrees(tmp_path, drops):
    columns = columns_of(corrupt(drops, "degrees"))
    path = written(tmp_path / "own.csv", {name: x for name, x in columns.items() if name not in ("rx", "ry")})
    for validate in (False, True):
        with pytest.raises(DataError, match=r"theta, which is [\d.]+ rad in the median.*data.units.angle=deg"):
            table.load(path, SHAPE, validate=validate)
    torch.testing.assert_close(table.load(path, SHAPE, units={"angle": "deg"}).r, drops.r, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("mistakes", [(), ("mirrored_theta",), ("mirrored_y", "mirrored_theta", "grams")])
@pytest.mark.parametrize("size", [200, 1718])
def test_the_quick_audit_finds_what_the_audit_finds(mistakes, size):
    drops = corrupt(synthetic.load(size=size), *mistakes)
    state = torch.get_rng_state()
    found = [finding.correction for finding in quick_audit(drops)]
    assert torch.equal(torch.get_rng_state(), state)
    assert found == [finding.correction for finding in audit(drops) if finding.mistake]
    assert sorted(found) == sorted(mistakes)


def test_the_quick_audit_looks_at_all_for_repetitions_and_order():
    clock = torch.rand(1500, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    drops = synthetic.load(size=1500).replace(validate=False)
    within = drops.replace(time=400 * clock)[[*range(1500), 700]]  # in each recording: no clock of the session
    assert [finding.name for finding in quick_audit(within)] == ["duplicated_trials"]
    session = within.replace(time=10 * within.time)
    assert [finding.name for finding in quick_audit(session)] == ["duplicated_trials", "out_of_order"]


def test_the_quick_audit_looks_at_all_for_the_ends_of_a_part_and_for_speeds():
    drops = synthetic.load(size=1500).replace(validate=False)
    scale = torch.ones(1500, 3, dtype=torch.float64)
    scale[602:703, :2] = 1e3  # between those of the sample
    mixed = drops.replace(v_pre=scale * drops.v_pre, v_post=scale * drops.v_post)
    sampled = mixed[::4]
    for found in (quick_audit(mixed), quick_audit(sampled, lambda: (mixed[:650], mixed[650:]))):
        assert "in trials '603' to '703' (7% of the trials) velocities are in mm/s" in found[0].sentence
    v_post = drops.v_post.clone()
    v_post[[401, 701], 0] = torch.tensor((2e3, 1e3), dtype=torch.float64)
    fast = drops.replace(v_post=v_post)
    for found in (quick_audit(fast), quick_audit(fast[::4], lambda: (fast[:700], fast[700:]))):
        (one,) = found
        assert (one.name, one.value("rows"), one.value("trials")) == ("impossible_speeds", "402, 702", 2.0)
        assert one.value("fastest") == pytest.approx(2e3, rel=1e-3)
        assert "more" not in one.sentence


SMALL = ("train.size=20", "train.repetitions=4", "bootstrap=50", "model=analytical")


@pytest.mark.nightly
def test_training_reports_the_audit_and_continues(tmp_path, monkeypatch):
    path = table.save(corrupt(synthetic.load(size=80), "mirrored_theta"), tmp_path / "own.csv")
    words = ("train.py", "data=table", f"data.path={path}", ELLIPSE, *SMALL)
    expected = "audit: θ and ω are positive clockwise: use data.correct=[mirrored_theta]\n"
    assert expected in run(*words, f"hydra.run.dir={tmp_path}/a")
    monkeypatch.setattr(loading, "quick_audit", lambda impacts, every: ())
    assert "audit" not in run(*words, f"hydra.run.dir={tmp_path}/b")
    with_audit, without = (json.loads((tmp_path / name / "results.json").read_text()) for name in "ab")
    assert [with_audit[part] for part in ("fits", "errors")] == [without[part] for part in ("fits", "errors")]
    monkeypatch.undo()
    for name, mended in (("c", "data.correct=[mirrored_theta]"), ("d", "data.units.rotation=clockwise")):
        assert "audit" not in run(*words, mended, f"hydra.run.dir={tmp_path}/{name}")


@pytest.mark.nightly
def test_evaluation_reports_the_audit(tmp_path):
    path = table.save(corrupt(synthetic.load(size=80), "grams", "mirrored_theta"), tmp_path / "own.csv")
    words = ("evaluate.py", "data=table", f"data.path={path}", "model=[]", "laws=[mirtich]", "figures.repetitions=1")
    printed = run(*words, *SMALL, f"hydra.run.dir={tmp_path}/run")
    assert printed.count(": use data.correct=[mirrored_theta,grams]\n") == 2
    assert "audit: the mass is in g: use" in printed


def test_the_audit_alone(tmp_path):
    path = table.save(corrupt(synthetic.load(size=80), "mirrored_theta"), tmp_path / "own.csv")
    printed = run("contactlearn", "audit", str(path), ELLIPSE, status=1)
    assert printed.startswith(f"{path}: 80 impacts\nwrong: θ and ω are positive clockwise.\nevidence: I Δω")
    assert printed.endswith("\nto correct it: data.correct=[mirrored_theta] on any command\n")
    for mended in ("data.units.rotation=clockwise", "data.correct=[mirrored_theta]"):
        printed = run("contactlearn", "audit", ELLIPSE, str(path), mended)
        assert "note: The measurements are consistent" in printed
        assert "wrong" not in printed
        words = ("contactlearn", "diagnose", "data=table", ELLIPSE, mended, f"data.path={path}")
        assert printed.endswith(f"\nnext: {shlex.join(words)}\n")
    twice = table.save(corrupt(synthetic.load(size=80), "grams", "mirrored_theta"), tmp_path / "own.csv")
    printed = run("contactlearn", "audit", str(twice), "data.correct=[grams]", status=1)
    assert "to correct it: data.correct=[grams,mirrored_theta,traced_shape] on any command" in printed
    assert "synthetic drops (wang_mason, seed 0): 30" in run("contactlearn", "audit", "data=synthetic", "data.size=30")
    assert "too few" in run("contactlearn", "audit", "data=synthetic", "data.size=5")
    assert [entry.name for entry in tmp_path.iterdir()] == ["own.csv"]


@pytest.mark.parametrize(("words", "fragment"), [
    (["none.csv"], "none.csv: no such file"),
    (["a.csv", "b.csv"], "audit takes one file or folder at a time, got a.csv, b.csv"),
    (["data=tabel"], "did you mean 'table'"),
    (["data=table"], "data.path must be given"),
])  # fmt: skip
def test_the_audit_refuses(words, fragment):
    assert fragment in run("contactlearn", "audit", *words, status=2)


@pytest.mark.parametrize("script", ["train.py", "evaluate.py", "diagnose.py"])
def test_help_lists_sources(script):
    sources, _, end = run(script, "--help").partition("\nData: ")[2].partition("\nCorrections")
    assert f"a diagnosis {Thresholds().fewest_trials} at least" in " ".join(end.split())
    for path in (ROOT / "configs" / "data").glob("*.yaml"):
        assert path.stem in sources.replace(",", "").split(), path.stem


def test_the_document_lists_columns_units_and_corrections():
    text = (ROOT / "docs" / "tables.md").read_text("utf-8")
    for name, correction in CORRECTIONS.items():
        assert f"| `{name}` | {correction.description} |" in text
    for quantity, units in UNIT_FACTORS.items():
        assert f"| `{quantity}` | {', '.join(f'`{unit}`' for unit in units)} |" in text
    for column in table.COLUMNS:
        if not column.startswith("apparatus_") and not (column.startswith("cov_") and column.endswith("_post")):
            assert f"`{column}`" in text


def test_additions_of_spreadsheets_and_instruments_are_named(tmp_path, drops):
    """Comments and a row of units are called so, and not a truncated file or many missing columns."""
    text = written(tmp_path / "own.csv", columns_of(drops)).read_text("utf-8").splitlines()
    units = ",".join(["-", "body", *["m"] * (text[0].count(",") - 1)])
    for lines, message in (
        ([*text[:4], "#1,2", *text[4:]], r"row 4 \(line 5\) has 2 cells .*; is it a comment\? remove it"),
        ([text[0], units, *text[1:]], r"unknown column 'omega \[m\]', did you mean 'omega'"),
    ):
        (tmp_path / "own.csv").write_text("\n".join(lines), "utf-8")
        with pytest.raises(DataError, match=message):
            table.load(tmp_path / "own.csv")
    long = [f"{k},{name},{values[k]}" for k in range(40) for name, values in columns_of(drops).items()]
    (tmp_path / "own.csv").write_text("\n".join(["trial,quantity,value", *long]), "utf-8")
    assert_close(table.load(tmp_path / "own.csv"), replace(drops, trial=tuple(map(str, range(40)))))
    commas = {name: [str(value).replace(".", ",") for value in values] for name, values in columns_of(drops).items()}
    assert_close(table.load(written(tmp_path / "own.csv", commas)), drops)
    with pytest.raises(DataError, match=r"row 1 .*'heavy'"):
        table.load(written(tmp_path / "own.csv", columns_of(drops) | {"mass": ["heavy"] * 40}))


@pytest.mark.parametrize("without", [("y",), ("x", "y"), ("x", "y", "rx", "ry")], ids=len)
def test_a_table_without_places(without, tmp_path):
    """The contact point gives the height, of the table or of the shape; places along the floor are 0."""
    drops = synthetic.load(size=30)
    frame = drops.to_frame().drop(columns=[*without, "x_post", "y_post", "theta_post"])
    frame.to_csv(tmp_path / "a.csv", index=False)
    found = table.read(tmp_path / "a.csv", shape=drops.shape if "rx" in without else None)
    assert {"height", *(["place"] if "x" in without else [])} <= {*found.computed}
    torch.testing.assert_close(found.impacts.q[:, 1], drops.q[:, 1])
    assert bool(found.impacts.q[:, 0].any()) == ("x" not in without)
    if "x" not in without:
        return
    frame.assign(**{"x [yd]": 1.0}).to_csv(tmp_path / "a.csv", index=False)
    with pytest.raises(DataError, match=r"missing column x; not used: 'x \[yd\]'"):  # it may be the place
        table.read(tmp_path / "a.csv", shape=drops.shape)


def test_a_name_like_a_reference_is_a_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    table.save(synthetic.load(size=30), "x${y}.csv")
    assert run("contactlearn", "audit", "x${y}.csv", ELLIPSE, cwd=".").startswith("x${y}.csv: 30 impacts")


@pytest.mark.parametrize("names", [("racket_vx", "racket_vy"), ("Racket vx [mm/s]", "v_y of floor [cm/s]")])
def test_velocities_are_made_relative_to_a_moving_surface(names):
    drops = synthetic.load(size=30)
    surface = np.linspace(-1.0, 1.0, 30)
    frame = drops.to_frame()
    for name, column, factor in zip(names, ("vx", "vy"), (1e3, 1e2) if "[" in names[0] else (1, 1), strict=True):
        frame[name] = factor * surface
        frame[column] += surface
        frame[f"{column}_post"] += surface
    units = {"length": "m"}
    found = table.read(frame, shape=drops.shape, units=units)
    torch.testing.assert_close(found.impacts.v_pre, drops.v_pre)
    torch.testing.assert_close(found.impacts.v_post, drops.v_post)
    assert any("velocities relative to the surface" in line for line in found.read_as)
    assert not found.unused


def test_a_surface_that_another_velocity_has_after_contact():
    drops = synthetic.load(size=30)
    frame = drops.to_frame().assign(racket_vy=0.5, racket_vy_post=0.25)
    found = table.read(frame, shape=drops.shape)
    torch.testing.assert_close(found.impacts.v_pre[:, 1], drops.v_pre[:, 1] - 0.5)
    torch.testing.assert_close(found.impacts.v_post[:, 1], drops.v_post[:, 1] - 0.25)


def test_a_column_that_may_be_the_surface_is_asked_for(tmp_path):
    frame = synthetic.load(size=30).to_frame().assign(racket_speed=0.0)
    frame.to_csv(tmp_path / "a.csv", index=False)
    ask = ("contactlearn", "audit", str(tmp_path / "a.csv"), ELLIPSE)
    said = run(*ask, status=2)
    assert "'racket_speed' is a velocity of what the body hits, which is taken off" in said
    for setting in re.findall(r"'(data\.[^']*)'", said):  # each way that it names
        assert "30 impacts" in run(*ask, setting)
