"""The data sources: table files, the published drops, synthetic drops, and their configurations."""

import csv
import inspect
import threading
from pathlib import Path

import numpy as np
import pooch
import pyarrow
import pytest
import torch
from hydra.utils import instantiate
from hypothesis import given, settings, strategies as st
from omegaconf import OmegaConf
from pyarrow import parquet
from refusals import refused

from contactlearn.core.errors import ContactLearnError, DataError, UnknownNameError
from contactlearn.data import ellipse_drops as published, table, tracks
from contactlearn.laws import find, names
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.shapes import Disc, Ellipse, Polygon, contact_point, make_shape
from contactlearn.mechanics.space import PLANE
from contactlearn.models.contact_model import ContactModel
from contactlearn.simulation import hidden_effects, mujoco, recordings, recordings_mujoco, synthetic
from contactlearn.simulation.camera import Camera

CONFIGS = Path(__file__).parents[1] / "configs" / "data"
ROUNDING = 1e-12  # relative; a few hundred float64 roundings
SUFFIXES = [".csv", ".parquet"]

GOOD = {
    **{"trial": "1", "object": "body", "mass": "0.0364", "inertia": "1.7e-5", "rx": "0.005", "ry": "-0.03"},
    **{"x": "0.3", "y": "0.03", "theta": "0.1", "vx": "0.5", "vy": "-2.5", "omega": "1.0"},
    **{"vx_post": "0.3", "vy_post": "1.2", "omega_post": "4.0"},
}
HEADER, ROW = list(GOOD), list(GOOD.values())[1:]
POSE = ["x_post", "y_post", "theta_post"]


def grid(rows: int = 3) -> list[list[str]]:
    """Header and rows of a good table, as text."""
    return [HEADER, *([str(i + 1), *ROW] for i in range(rows))]


def text(cells: list[list[str]], comma: str = ",") -> str:
    return "".join(comma.join(row) + "\n" for row in cells)


def put(row: int, column: str, value: str) -> str:
    """A good table with one cell changed (row counted from 1, 0 is the header)."""
    cells = [list(line) for line in grid()]
    cells[row][HEADER.index(column)] = value
    return text(cells)


def without(*columns: str) -> str:
    keep = [i for i, name in enumerate(HEADER) if name not in columns]
    return text([[row[i] for i in keep] for row in grid()])


def extra(columns: list[str], value: str = "1.0") -> str:
    return text([row + (columns if i == 0 else [value] * len(columns)) for i, row in enumerate(grid())])


BAD_CSV = {
    "missing column": (without("vx"), ["missing column vx", "needed: mass"]),
    "missing columns": (without("mass", "omega_post"), ["missing column mass, omega_post"]),
    "misspelt column": (put(0, "vx_post", "vx_pots"), ["unknown column 'vx_pots'", "did you mean 'vx_post'", "known"]),
    "duplicated column": (put(0, "vx", "vy"), ["unique", "'vy'"]),
    "text": (put(2, "inertia", "heavy"), ["row 2 (line 3)", "column inertia", "number in kg m²", "'heavy'"]),
    "code": (put(1, "vx", "=1+1"), ["row 1 (line 2)", "column vx", "m/s", "'=1+1'"]),
    "underscore": (put(1, "mass", "1_0"), ["row 1 (line 2)", "column mass", "'1_0'"]),
    "unit": (put(3, "omega", "4 rad/s"), ["column omega", "no unit in row 1 and rad/s in row 3"]),
    "empty cell": (put(3, "theta", ""), ["row 3 (line 4)", "column theta", "rad", "empty", "leave the trial out"]),
    "blank cell": (put(3, "theta", "  "), ["row 3 (line 4)", "column theta", "empty"]),
    "nan": (put(2, "vy_post", "NaN"), ["row 2 (line 3)", "column vy_post", "finite", "NaN", "leave the trial out"]),
    "inf": (put(2, "x", "-inf"), ["row 2 (line 3)", "column x", "finite", "-inf"]),
    "overflow": (put(2, "x", "1e999"), ["row 2 (line 3)", "column x", "finite", "1e999"]),
    "zero mass": (put(1, "mass", "0"), ["row 1", "column mass", "positive", "got 0", "line 2"]),
    "negative inertia": (put(2, "inertia", "-1e-5"), ["row 2", "column inertia", "positive", "-1e-05", "line 3"]),
    "no approach": (put(3, "vy", "2.5"), ["row 3", "column vy", "approach", "2.505", "swapped", "line 4"]),
    "duplicated trial": (put(3, "trial", "1"), ["row 3", "column trial", "unique", "'1'", "row 1", "line 4"]),
    "empty trial": (put(2, "trial", ""), ["row 2", "column trial", "name", "line 3"]),
    "empty object": (put(2, "object", ""), ["row 2", "column object", "name", "line 3"]),
    "empty file": ("", ["empty", "first line", "columns"]),
    "blank file": ("\n\n  \n", ["empty"]),
    "header only": (text(grid(0)), ["header but no impacts", "at least one row"]),
    "no header": (text(grid()[1:]), ["its first line must name the columns"]),
    "two readings": (text([["x", "y"], *[["1,234", "5,678"]] * 3], ";"), ["1,234 is 1234, or 1.234"]),
    "two separators": ("x,y\n" + "1 234,5 678\n" * 3, ["separated by commas (2 columns) or spaces (3 columns)"]),
    "mixed marks": (text(grid(), ";").replace("0.0364", "0,0364", 1), ["row 1 (line 2)", "mass", "write 0.0364"]),
    "decimal comma": (put(2, "mass", '"0,0364"'), ["row 2 (line 3)", "'0,0364'", "decimal comma", "write 0.0364"]),
    "bare comma": (put(2, "mass", "0,0364"), ["row 2 (line 3)", "16 cells", "header has 15", "decimal comma"]),
    "short row": (text([*grid(), ["4", "body", "0.0364"]]),
        ["row 4 (line 5)", "3 cells", "header has 15", "truncated"]),
    "open quote": (put(3, "trial", '"1'), ["is not CSV", "line", "quotes"]),
    "half a pose": (extra(["x_post", "theta_post"]), ["all three or none", "missing: y_post"]),
    "bad pose": (extra(POSE, "?"), ["row 1 (line 2)", "column x_post", "number in m;", "'?'"]),
    "bad time": (extra(["time"], "noon"), ["row 1 (line 2)", "column time", "number in s;", "'noon'"]),
    "blank lines": (put(2, "mass", "x").replace("\n", "\n\n"), ["row 2 (line 5)", "column mass"]),
    "multi-line name": (put(1, "trial", '"a\nb"').replace("1.7e-5", "-1", 2), ["row 1", "column inertia", "line 3"]),
    "no text": (text(grid()).encode("utf-32-le"), ["is not text", "UTF-8"]),
    "binary": (bytes(range(256)), ["UTF-8"]),
}  # fmt: skip


@pytest.mark.parametrize(("content", "fragments"), BAD_CSV.values(), ids=BAD_CSV)
def test_csv_refuses(tmp_path, content, fragments):
    path = tmp_path / "drops.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with refused([str(path), *fragments]):
        table.load(path)


def write_parquet(path: Path, **changes) -> Path:
    """A good Parquet table with some columns replaced (None leaves one out)."""
    columns = {"trial": ["1", "2", "3"], "object": ["body"] * 3}
    columns |= {name: [float(value)] * 3 for name, value in zip(HEADER[2:], ROW[1:], strict=True)} | changes
    parquet.write_table(pyarrow.table({k: v for k, v in columns.items() if v is not None}), path)
    return path


BAD_PARQUET = {
    "missing column": ({"vx": None}, ["missing column vx"]),
    "unknown column": ({"vx": None, "vxx": [0.5] * 3}, ["unknown column 'vxx'", "did you mean 'vx'"]),
    "text": ({"mass": ["1", "heavy", "1"]}, ["row 2, column mass", "number in kg;", "'heavy'"]),
    "null": ({"mass": [1.0, 1.0, None]}, ["row 3, column mass", "empty"]),
    "nan": ({"theta": [0.1, float("nan"), 0.1]}, ["row 2, column theta", "finite", "rad", "nan"]),
    "truth value": ({"mass": [True] * 3}, ["row 1, column mass", "number in kg;", "True"]),
    "list": ({"mass": [[1.0]] * 3}, ["row 1, column mass", "[1.0]"]),
    "negative mass": ({"mass": [1.0, -1.0, 1.0]}, ["row 2", "column mass", "positive", "-1"]),
    "duplicated trial": ({"trial": [1, 2, 1]}, ["row 3", "column trial", "'1'", "row 1"]),
    "null trial": ({"trial": ["1", None, "3"]}, ["row 2", "column trial", "name"]),
    "no rows": ({name: pyarrow.array([], "float64") for name in HEADER}, ["header but no impacts"]),
}


@pytest.mark.parametrize(("changes", "fragments"), BAD_PARQUET.values(), ids=BAD_PARQUET)
def test_parquet_refuses(tmp_path, changes, fragments):
    path = write_parquet(tmp_path / "drops.parquet", **changes)
    with refused([str(path), *fragments]):
        table.load(path)


def test_broken_parquet_is_refused(tmp_path):
    path = tmp_path / "drops.parquet"
    names = [*HEADER, "mass"]
    parquet.write_table(pyarrow.table([["1"] if name in table.NAMES else [1.0] for name in names], names), path)
    with pytest.raises(DataError, match="unique; repeated: 'mass'"):
        table.load(path)
    path = table.save(synthetic.load(size=500), tmp_path / "drops.parquet")
    whole = path.read_bytes()
    middle = len(whole) // 2
    flipped = whole[:middle] + bytes([whole[middle] ^ 1]) + whole[middle + 1 :]
    for content in (b"", b"PAR1", b"not a table" * 100, whole[:-9], whole[: len(whole) // 2], flipped):
        path.write_bytes(content)
        with pytest.raises(DataError, match=r"drops\.parquet: is not a readable Parquet file .*write or copy it again"):
            table.load(path)


@pytest.mark.parametrize("name", ["drops.xls", "drops", "drops.csv.7z", "drops.pkl"])
def test_other_suffixes_are_refused(tmp_path, name):
    path = tmp_path / name
    path.write_text(text(grid()))
    for call in (lambda: table.load(path), lambda: table.save(synthetic.load(size=2), path)):
        with pytest.raises(DataError, match=rf"{name}: (a table is a \.csv or .* file, got suffix|is compressed)"):
            call()


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_missing_files_and_directories_are_refused(tmp_path, suffix):
    with pytest.raises(DataError, match="no such file; check the path"):
        table.load(tmp_path / f"drops{suffix}")
    folder = tmp_path / f"folder{suffix}"
    folder.mkdir()
    with pytest.raises(DataError, match="is a directory"):
        table.load(folder)
    with pytest.raises(DataError, match="cannot be written"):
        table.save(synthetic.load(size=2), folder)
    with pytest.raises(DataError, match="is a directory"):
        table.load(tmp_path)


def test_unreadable_file_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "drops.csv"
    path.write_text(text(grid()))

    def refuse(*args, **kwargs):
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(DataError, match=r"cannot be read.*Permission denied"):
        table.load(path)


def test_csv_as_people_write_it(tmp_path):
    path = tmp_path / "Drops.CSV"
    order = [*reversed(range(len(HEADER)))]
    cells = [[row[i] for i in order] for row in grid()]
    cells[0] = [f" {name} " for name in cells[0]]
    cells[1] = [f" {value}" for value in cells[1][:-1]] + ["007 "]
    path.write_bytes(b"\xef\xbb\xbf" + text(cells).replace("\n", "\r\n").encode() + b"," * 14 + b"\r\n\r\n")
    impacts = table.load(str(path), shape={"kind": "disc", "radius": 0.03})
    assert impacts.trial == ("007 ", "2", "3")
    assert impacts.object == (" body", "body", "body")
    assert (impacts.shape, impacts.source) == (Disc(0.03), str(path))
    assert impacts.mass.tolist() == [0.0364] * 3
    assert impacts.r[0].tolist() == [0.005, -0.03]
    assert impacts.v_post[2].tolist() == [0.3, 1.2, 4.0]
    assert (impacts.q_post, impacts.time) == (None, None)
    path = tmp_path / "drops.csv"
    path.write_text(without("trial", "object"))
    impacts = table.load(path)
    assert impacts.trial == ("1", "2", "3")
    assert impacts.object == ("body",) * 3
    with pytest.raises(UnknownNameError, match="did you mean 'disc'"):
        table.load(tmp_path / "none.csv", shape={"kind": "disk", "radius": 1})


def test_parquet_numbers_of_other_kinds_are_converted(tmp_path):
    path = write_parquet(
        tmp_path / "drops.parquet", trial=pyarrow.array([1, 2, 3], "int32"),
        object=pyarrow.array(["a", "b", "a"]).dictionary_encode(), mass=pyarrow.array([1, 2, 3], "int8"),
        inertia=pyarrow.array([0.1] * 3, "float32"),
    )  # fmt: skip
    impacts = table.load(path)
    assert impacts.trial == ("1", "2", "3")
    assert impacts.object == ("a", "b", "a")
    assert impacts.mass.tolist() == [1.0, 2.0, 3.0]
    assert impacts.inertia.tolist() == [float(np.float32(0.1))] * 3
    folder = tmp_path / "mass=3"
    folder.mkdir()
    assert table.load(write_parquet(folder / "drops.parquet")).mass.tolist() == [0.0364] * 3


def assert_same(a: Impacts, b: Impacts) -> None:
    """Equal to the last bit, names included."""
    for name in PLANE.components:
        mine, theirs = getattr(a, name), getattr(b, name)
        assert (mine is None) == (theirs is None)
        if mine is not None:
            assert torch.equal(mine.view(torch.int64), theirs.view(torch.int64))
    assert (a.trial, a.object) == (b.trial, b.object)


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize(
    "optional",
    [{}, {"time": torch.linspace(-1, 1 / 3, 40, dtype=torch.float64)}, {"q_post": None}],
    ids=["pose", "pose and time", "neither"],
)
def test_round_trip_is_exact(tmp_path, suffix, optional):
    impacts = synthetic.load(size=40).replace(**optional)
    path = table.save(impacts, tmp_path / "new" / "folder" / f"drops{suffix}")
    assert_same(table.load(path), impacts)
    assert [entry.name for entry in path.parent.iterdir()] == [path.name]


number = st.floats(-1e100, 1e100)
name = st.text(min_size=1, max_size=5)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    numbers=st.lists(st.tuples(*[number] * 8), min_size=1, max_size=4),
    trials=st.lists(name, min_size=4, max_size=4, unique=True),
    objects=st.lists(name, min_size=4, max_size=4),
)
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_round_trip_of_anything_is_exact(tmp_path_factory, suffix, numbers, trials, objects):
    n = len(numbers)
    values = torch.tensor(numbers, dtype=torch.float64)
    impacts = Impacts(
        mass=values[:, 0].abs() + 5e-324, inertia=values[:, 1].abs() + 5e-324,
        r=torch.stack((torch.zeros(n), values[:, 2]), -1), q=values[:, 2:5],
        v_pre=torch.stack((values[:, 5], -values[:, 6].abs() - 1e-300, values[:, 7]), -1), v_post=values[:, :3],
        trial=trials[:n], object=objects[:n],
    )  # fmt: skip
    path = tmp_path_factory.mktemp("round") / f"drops{suffix}"
    assert_same(table.load(table.save(impacts, path)), impacts)


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("fault", [OSError("disk full"), KeyboardInterrupt()], ids=repr)
def test_a_failed_save_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch, suffix, fault):
    path = table.save(synthetic.load(size=3), tmp_path / f"drops{suffix}")
    before = path.read_bytes()

    def fail(frames, part):
        part.write_text("half a")
        raise fault

    monkeypatch.setitem(table._WRITERS, suffix, fail)
    with pytest.raises(DataError if isinstance(fault, OSError) else KeyboardInterrupt):
        table.save(synthetic.load(size=9), path)
    assert path.read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


def test_saved_csv_is_plain_text_with_the_documented_columns(tmp_path):
    path = table.save(synthetic.load(size=2).replace(time=torch.ones(2)), tmp_path / "drops.csv")
    header, *rows = csv.reader(path.read_text(encoding="utf-8").splitlines())
    assert header == [column for column in table.COLUMNS if not column.startswith(("cov_", "apparatus_"))]
    assert rows[0][:3] == ["1", "ellipse", "0.0364"]


def test_published_drops_are_the_papers(ellipse_drops):
    assert len(ellipse_drops) == 1718
    assert set(ellipse_drops.object) == {"ellipse"}
    assert ellipse_drops.trial[0] == "1"
    assert int(ellipse_drops.trial[-1]) <= 2000
    assert ellipse_drops.shape == Ellipse((0.035, 0.025))
    assert ellipse_drops.time is None
    assert ellipse_drops.mass.unique().tolist() == [0.0364]
    assert ellipse_drops.inertia.unique().item() == pytest.approx(0.0364 * (0.035**2 + 0.025**2) / 4, rel=ROUNDING)
    error = (ellipse_drops.r - contact_point(ellipse_drops.shape, ellipse_drops.q[:, 2])).abs()
    # Means of 2.7e-4 and 1.2e-4 m and at most 1.7e-3 m: the published rows are not quite those of the ellipse.
    assert error[:, 0].mean() < 3e-4
    assert error[:, 1].mean() < 1.3e-4
    assert error.max() < 2e-3
    # Signs and order of the columns: down before, up after, and the pose hardly moves between frames.
    assert (ellipse_drops.v_pre[:, 1] < -2).all()
    assert (ellipse_drops.v_post[:, 1] > 0).all()
    moved = (ellipse_drops.q_post - ellipse_drops.q).abs()
    assert moved[:, :2].median() < 0.01
    assert moved[:, 2].median() < 0.3
    from scipy.io import loadmat

    array = loadmat(published.find())["bounce_array"]
    row = 1000
    drop = array[0, int(ellipse_drops.trial[row]) - 1]
    ours = torch.cat([getattr(ellipse_drops, name)[row] for name in ("q", "v_pre", "q_post", "v_post")])
    assert ours.tolist() == drop["states"][0].tolist()
    assert ellipse_drops.r[row].tolist() == [drop["n"][0, 2], -drop["d"][0, 2]]
    kept = {int(trial) - 1 for trial in ellipse_drops.trial}
    flags = [bool(drop["flags"].any()) for drop in array[0]]
    assert kept == {place for place, flag in enumerate(flags) if not flag}
    root = published.find().parent
    every = published.load(root, inertia="fazeli2017", flagged=True)
    assert len(every) == 2000
    assert every.trial == tuple(str(i + 1) for i in range(2000))
    assert every.inertia[0].item() == pytest.approx(0.8 * ellipse_drops.inertia[0].item(), rel=ROUNDING)
    fallen = published.load(root.parent, free_fall=0.008)
    assert (fallen.v_post - ellipse_drops.v_post)[0].tolist() == pytest.approx([0, 9.81 * 0.008, 0], abs=ROUNDING)
    with pytest.raises(DataError, match="free_fall must be a finite number at least 0, got -1"):
        published.load(root, free_fall=-1)
    with pytest.raises(UnknownNameError, match=r"unknown inertia 'uniform'.*did you mean 'uniform_disc'"):
        published.load(root, inertia="uniform")


FIELDS = ("states", "n", "d", "flags")


def make_mat(path: Path, monkeypatch, fields=FIELDS, drops: int = 3) -> Path:
    """A small file of the published form, and its checksum taken for the published one."""
    from scipy.io import savemat

    pose = [0.3, 0.03, 0.0]
    values = {
        "states": [[*pose, 0.5, -2.5, 0.0, *pose, 0.3, 1.2, 1.0]],
        "n": [[0.0, 1.0, 0.001]],
        "d": [[1.0, 0.0, 0.034]],
        "flags": np.zeros((1, 6), np.uint8),
    }
    array = np.empty((1, drops), dtype=[(field, object) for field in fields])
    for field in fields:
        for i in range(drops):
            array[0, i][field] = np.array(values[field])
    if "flags" in fields:
        array[0, 1]["flags"] = np.array([[0, 0, 0, 0, 0, 1]], np.uint8)
    path.parent.mkdir(parents=True, exist_ok=True)
    savemat(path, {"bounce_array": array}, do_compression=True)
    trust(path, monkeypatch)
    return path


def trust(path: Path, monkeypatch) -> None:
    monkeypatch.setattr(published, "SHA256", pooch.file_hash(str(path)))


@pytest.fixture
def no_download(monkeypatch):
    def refuse(*args, **kwargs):
        raise AssertionError("this test must not download")

    monkeypatch.delenv("CONTACTLEARN_DATA", raising=False)
    monkeypatch.setattr(pooch, "retrieve", refuse)


@pytest.mark.parametrize("place", ["ellipse_uniform.mat", "ellipse_drops/ellipse_uniform.mat"])
def test_mat_is_found_by_argument_and_by_environment(tmp_path, monkeypatch, no_download, place):
    make_mat(tmp_path / place, monkeypatch)
    impacts = published.load(tmp_path)
    assert impacts.trial == ("1", "3")
    assert impacts.r.tolist() == [[0.001, -0.034]] * 2
    assert impacts.v_post.tolist() == [[0.3, 1.2, 1.0]] * 2
    monkeypatch.setenv("CONTACTLEARN_DATA", str(tmp_path))
    assert published.load(flagged=True).trial == ("1", "2", "3")
    monkeypatch.setenv("CONTACTLEARN_DATA", str(tmp_path / "elsewhere"))
    assert len(published.load(tmp_path)) == 2  # the argument comes first


def test_mat_missing_under_the_given_root(tmp_path, monkeypatch, no_download):
    for call in (lambda: published.load(tmp_path), published.load):
        with refused((str(tmp_path / "ellipse_drops"), "ellipse_uniform.mat", "unset", "download")):
            call()
        monkeypatch.setenv("CONTACTLEARN_DATA", str(tmp_path))


def test_broken_mat_files_are_refused(tmp_path, monkeypatch, no_download):
    path = make_mat(tmp_path / "ellipse_uniform.mat", monkeypatch)
    whole = path.read_bytes()
    for content in (b"", b"garbage" * 99, whole[:200], whole + b"\0", whole[:-1] + bytes([whole[-1] ^ 1])):
        path.write_bytes(content)
        with refused((str(path), "sha256 must be", published.SHA256, f"{len(content)} bytes", "again from https://")):
            published.load(tmp_path)
    # Only the parser stands between these and the impacts: every truncation is refused.
    for content in [b"", b"garbage" * 99, *(whole[:size] for size in range(8, len(whole), 37))]:
        path.write_bytes(content)
        trust(path, monkeypatch)
        with pytest.raises(DataError, match=r"cannot be parsed as the published bounce_array .* fetch it again"):
            published.load(tmp_path)


def test_a_mat_file_of_other_content_is_refused(tmp_path, monkeypatch, no_download):
    make_mat(tmp_path / "ellipse_uniform.mat", monkeypatch, fields=("states", "n", "d"))
    with pytest.raises(DataError, match=r"cannot be parsed .*flags"):
        published.load(tmp_path)
    make_mat(tmp_path / "ellipse_uniform.mat", monkeypatch)
    monkeypatch.setattr(published, "MASS", -1.0)
    with pytest.raises(DataError, match=r"ellipse_uniform\.mat: row 1 .*mass.*positive"):
        published.load(tmp_path)


def test_download_is_checked_and_cached(tmp_path, monkeypatch):
    path = make_mat(tmp_path / "cache" / "ellipse_uniform.mat", monkeypatch)
    calls = []

    def retrieve(url, known_hash, fname, path):
        calls.append((url, known_hash, fname, path))
        return str(tmp_path / "cache" / fname)

    monkeypatch.setattr(pooch, "retrieve", retrieve)
    monkeypatch.setenv("CONTACTLEARN_DATA", "")
    assert len(published.load()) == 2
    ((url, known_hash, fname, folder),) = calls
    assert url.startswith("https://raw.githubusercontent.com/DAIRLab/ImpactModeling/")
    assert url.endswith("/Wang/Compare%20Wang/ellipse_uniform.mat")
    assert (known_hash, fname) == (f"sha256:{published.SHA256}", path.name)
    assert Path(folder) == Path(pooch.os_cache("contactlearn"))


@pytest.mark.parametrize("fault", [
    ConnectionError("Failed to resolve host " + "x" * 999),
    PermissionError(13, "Permission denied"),
    ValueError("hash"),
], ids=lambda fault: type(fault).__name__)  # fmt: skip
def test_download_that_fails(monkeypatch, fault):
    def retrieve(*args, **kwargs):
        raise fault

    monkeypatch.delenv("CONTACTLEARN_DATA", raising=False)
    monkeypatch.setattr(pooch, "retrieve", retrieve)
    parts = ("could not be downloaded", type(fault).__name__, "network", published.URL, "CONTACTLEARN_DATA")
    with refused(parts) as caught:
        published.load()
    assert len(str(caught.value)) < 700
    assert caught.value.__cause__ is fault


def test_the_download_itself(tmp_path, monkeypatch):
    """pooch against a server on this machine: fetched once, then read from the cache."""
    from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer

    path = make_mat(tmp_path / "served" / "a b" / "ellipse_uniform.mat", monkeypatch)
    served = []

    class Handler(SimpleHTTPRequestHandler):
        def __init__(self, *args):
            super().__init__(*args, directory=str(tmp_path / "served"))

        def log_message(self, form, *args):
            served.append(args)

    monkeypatch.delenv("CONTACTLEARN_DATA", raising=False)
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    monkeypatch.setattr(pooch, "os_cache", lambda name: tmp_path / "cache" / name)
    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            monkeypatch.setattr(published, "URL", f"http://127.0.0.1:{server.server_port}/a%20b/ellipse_uniform.mat")
            assert len(published.load()) == 2
            assert len(published.load()) == 2
            assert len(served) == 1
            monkeypatch.setattr(published, "SHA256", "0" * 64)
            with pytest.raises(DataError, match=r"could not be downloaded .*ValueError"):
                published.load()
        finally:
            server.shutdown()
    assert path.exists()


def test_synthetic_depends_on_its_seed_alone():
    state = torch.get_rng_state()
    a = synthetic.load(size=30, seed=5)
    assert torch.equal(torch.get_rng_state(), state)
    torch.manual_seed(99)
    assert_same(a, synthetic.load(size=30, seed=5))
    assert not torch.equal(a.q, synthetic.load(size=30, seed=6).q)
    torch.set_rng_state(state)
    drops = synthetic.load(size=2)
    wanted = {
        "q": (0.4874222607587523, 0.03440689397952069, 1.3057707185368015),
        "v_pre": (0.5696634122503194, -2.253656256264015, -4.743882767464342),
        "v_post": (0.7767210692931033, 1.0995898736005627, -22.19334717557038),
        "inertia": 1.6835000000000004e-05,
    }
    for name, first in wanted.items():
        assert getattr(drops, name)[0].tolist() == pytest.approx(first, rel=ROUNDING)
    base = synthetic.load(size=100)
    for change in ({"mu": 0.0}, {"eps": 0.1}, {"law": "whittaker", "mu": 0.5}, {"law": "whittaker"}):
        assert not torch.equal(synthetic.load(size=100, **change).v_post, base.v_post)
    textbook, theirs = (synthetic.load(law="whittaker", variant=v) for v in ("textbook", "fazeli2017"))
    assert not torch.equal(textbook.v_post, theirs.v_post)
    large = synthetic.load(size=300, shape=Ellipse((3.0, 1.0)))
    longest = synthetic.load(size=300, shape=Polygon(((1e6, 1), (-1e6, 1), (-1e6, -1), (1e6, -1))))
    noisy = synthetic.load(size=300, velocity_noise=5.0)
    for drops in (large, longest, noisy):
        assert len(drops) == 300
        assert (drops.v_c[:, 1] < 0).all()


@pytest.mark.parametrize("law", names())
def test_synthetic_without_noise_predicts_itself(law):
    drops = synthetic.load(size=200, law=law, velocity_noise=0, spin_noise=0)
    assert torch.equal(ContactModel(find(law).at(0.12, 0.55)).predict(drops).v_post, drops.v_post)
    assert drops.wrench[:, 2].abs().max() < ROUNDING


BODIES = {
    "ellipse": {"semi_axes": [0.05, 0.01]},
    "disc": {"radius": 0.03},
    "polygon": {"vertices": [[0.06, 0.005], [-0.06, 0.005], [-0.06, -0.005], [0.06, -0.005]]},
}


@pytest.mark.parametrize("kind", BODIES)
def test_synthetic_drops_of_any_body(kind):
    body = make_shape({"kind": kind, **BODIES[kind]})
    drops = synthetic.load(size=200, shape=body, velocity_noise=0, spin_noise=0)
    assert (drops.shape, set(drops.object)) == (body, {kind})
    assert torch.equal(drops.inertia, drops.mass * body.gyration_squared())
    assert torch.equal(drops.r, contact_point(body, drops.q[:, 2]))
    assert torch.equal(drops.q[:, 1], -drops.r[:, 1])
    assert drops.wrench[:, 2].abs().max() < ROUNDING  # the momentum balance about the contact point
    assert_same(drops, synthetic.load(size=200, shape={"kind": kind, **BODIES[kind]}, velocity_noise=0, spin_noise=0))


def test_synthetic_is_spread_like_the_real_drops():
    drops = synthetic.load(size=5000, velocity_noise=0, spin_noise=0)
    low = torch.stack((drops.q[:, 0], drops.q[:, 2], drops.v_pre[:, 0], drops.v_pre[:, 1])).aminmax(dim=1)
    wanted = torch.tensor([[0.08, -torch.pi, 0.3, -2.9], [0.5, torch.pi, 0.9, -2.2]], dtype=torch.float64)
    torch.testing.assert_close(torch.stack(low), wanted, rtol=0, atol=5e-3)
    assert drops.v_pre[:, 2].std().item() == pytest.approx(6, rel=0.05)
    assert torch.equal(drops.r, contact_point(drops.shape, drops.q[:, 2]))
    assert torch.equal(drops.q[:, 1], -drops.r[:, 1])
    assert torch.equal(drops.q_post, drops.q)
    assert drops.time is None
    assert drops.inertia[0].item() == pytest.approx(0.0364 * (0.035**2 + 0.025**2) / 4, rel=ROUNDING)
    size = 20_000
    exact = synthetic.load(size=size, velocity_noise=0, spin_noise=0)
    noisy = synthetic.load(size=size, velocity_noise=0.02, spin_noise=0.7)
    assert torch.equal(noisy.q, exact.q)
    noise = torch.cat((noisy.v_pre - exact.v_pre, noisy.v_post - exact.v_post), -1)
    wanted = torch.tensor([0.02, 0.02, 0.7] * 2, dtype=torch.float64)
    accuracy = 4 / size**0.5  # four standard errors; the variance's relative one is √(2/N)
    torch.testing.assert_close(noise.std(0), wanted, rtol=accuracy, atol=0)
    torch.testing.assert_close(noise.mean(0) / wanted, torch.zeros_like(wanted), rtol=0, atol=accuracy)
    torch.testing.assert_close(torch.corrcoef(noise.T), torch.eye(6, dtype=torch.float64), rtol=0, atol=accuracy)


BAD_SYNTHETIC = {
    "no drops": ({"size": 0}, ["size", "integer", "at least 1", "got 0"]),
    "half a drop": ({"size": 2.5}, ["size", "integer", "2.5"]),
    "unknown law": ({"law": "wang_masson"}, ["unknown law", "did you mean 'wang_mason'"]),
    "unknown variant": ({"variant": "text"}, ["unknown variant 'text'", "textbook"]),
    "negative friction": ({"mu": -0.1}, ["mu", "at least 0", "-0.1"]),
    "infinite friction": ({"mu": float("inf")}, ["mu", "finite", "inf"]),
    "too elastic": ({"eps": 1.1}, ["eps", "in [0, 1]", "1.1"]),
    "nan": ({"eps": float("nan")}, ["eps", "in [0, 1]", "nan"]),
    "text": ({"mu": "low"}, ["mu", "number", "'low'"]),
    "no mass": ({"mass": 0}, ["mass", "greater than 0", "got 0"]),
    "negative noise": ({"velocity_noise": -1}, ["velocity_noise", "at least 0", "-1"]),
    "negative spin noise": ({"spin_noise": -1}, ["spin_noise", "at least 0", "-1"]),
    "one axis": ({"shape": {"kind": "ellipse", "semi_axes": [0.03]}}, ["semi_axes", "2 positive", "metres"]),
    "no such body": ({"shape": {"kind": "rod"}}, ["unknown shape kind 'rod'", "polygon"]),
    "off its centroid": ({"shape": Polygon(((1, 0), (0, 1), (-1, -0.7)))}, ["centroid", "(0, 0.1) m", "subtract"]),
    "vanishing body": ({"shape": Ellipse((1e-200, 1e-200))}, ["only 0 of 80000 draws", "underflow", "1e-200"]),
    "negative seed": ({"seed": -1}, ["seed", "at least 0", "-1"]),
    "seed as text": ({"seed": "one"}, ["seed", "integer", "'one'"]),
}


@pytest.mark.parametrize(("options", "fragments"), BAD_SYNTHETIC.values(), ids=BAD_SYNTHETIC)
def test_synthetic_refuses(options, fragments):
    with refused(fragments, ContactLearnError):
        synthetic.load(**options)


SOURCES = {
    "ellipse_drops": published, "mujoco": mujoco, "mystery": hidden_effects,
    "synthetic": synthetic, "table": table, "tracks": tracks, "tracks_mujoco": recordings_mujoco,
    "tracks_synthetic": recordings,
}  # fmt: skip


@pytest.mark.parametrize("name", SOURCES)
def test_config_holds_every_argument_with_its_default_and_a_comment(name, monkeypatch):
    monkeypatch.delenv("CONTACTLEARN_DATA", raising=False)
    config, source = OmegaConf.load(CONFIGS / f"{name}.yaml"), SOURCES[name]
    assert config.pop("_target_") == f"{source.__name__}.load"
    assert config.pop("correct") == (["rig"] if "tracks" in name else [])  # `loading.load_data` takes it off
    arguments = {
        key: parameter
        for key, parameter in inspect.signature(source.find if "tracks" in name else source.load).parameters.items()
        if parameter.kind is not parameter.KEYWORD_ONLY  # for the library, such as table's `validate`
    }
    if arguments.pop("settings", None):  # of the search for impacts in recordings
        arguments |= inspect.signature(tracks.track_options).parameters
    if arguments.pop("camera", None):  # of simulated recordings
        for_the_library = {"frames", "held", "length", "degrees", "wrapped"}
        arguments |= {key: p for key, p in inspect.signature(Camera).parameters.items() if key not in for_the_library}
    for key, parameter in arguments.items():
        if parameter.default is parameter.empty:
            assert OmegaConf.is_missing(config, key)
        else:
            value = OmegaConf.to_container(config, resolve=True)[key]
            assert (tuple(value) if isinstance(value, list) else value) == parameter.default
        config.pop(key, None)
    assert not config
    lines = (CONFIGS / f"{name}.yaml").read_text(encoding="utf-8").splitlines()
    assert all("#" in line for line in lines if not line.startswith("_target_"))
    assert {path.stem for path in CONFIGS.glob("*.yaml")} == {*SOURCES, "cube_tosses"}


def test_the_published_tosses_are_settings_of_tracks():
    config, tracked = (OmegaConf.load(CONFIGS / f"{name}.yaml") for name in ("cube_tosses", "tracks"))
    assert {*config} < {*tracked}
    assert (config._target_, config.correct) == (tracked._target_, tracked.correct)


@pytest.mark.parametrize("convert", ["none", "all"])
def test_configs_load(tmp_path, monkeypatch, no_download, convert):
    def load(name, **changes):
        config = OmegaConf.merge(OmegaConf.load(CONFIGS / f"{name}.yaml"), changes)
        config.pop("correct")
        return instantiate(config, _convert_=convert)

    drops = load("synthetic", size=20)
    assert_same(drops, synthetic.load(size=20))
    assert load("synthetic", size=20, shape={"kind": "disc", "radius": 0.03}).shape == Disc(0.03)
    path = table.save(drops, tmp_path / "drops.csv")
    loaded = load("table", path=str(path), shape={"kind": "ellipse", "semi_axes": [0.035, 0.025]})
    assert_same(loaded, drops)
    assert loaded.shape == drops.shape
    make_mat(tmp_path / "ellipse_uniform.mat", monkeypatch)
    monkeypatch.setenv("CONTACTLEARN_DATA", str(tmp_path))
    assert load("ellipse_drops").trial == ("1", "3")
