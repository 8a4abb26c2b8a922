"""Tables as instruments, spreadsheets and colleagues write them: every dialect of one table gives the same impacts."""

import codecs
import json
import math
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
import yaml
from commands import run
from refusals import refused
from scipy.spatial.transform import Rotation
from spatial import tossed

from contactlearn.core.errors import DataError
from contactlearn.data import table
from contactlearn.data.audit.findings import audit
from contactlearn.data.headers import propose
from contactlearn.data.table.dialect import with_one_unit
from contactlearn.data.table.names import impact_vocabulary, recognise, time_of, unit_in
from contactlearn.data.table.units import UNIT_FACTORS, powers_of
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import GRAVITY
from contactlearn.mechanics.space import PLANE, SPACE
from contactlearn.simulation import synthetic

SHAPE = {"kind": "ellipse", "semi_axes": [0.035, 0.025]}
BODY = {"shape": SHAPE, "mass": 0.0364}
COLUMNS = ("x", "y", "theta", "vx", "vy", "omega", "vx_post", "vy_post", "omega_post")
ROUNDING = 1e-12  # relative; a few float64 roundings of a product of factors
DIGITS = 6  # significant ones in the texts, of numbers that are rounded to them before


@pytest.fixture(scope="module")
def frame() -> pd.DataFrame:
    """Drops in SI, rounded as text has them."""
    drops = synthetic.load(size=30)
    values = torch.cat((drops.q, drops.v_pre, drops.v_post), 1).numpy()
    rounded = np.vectorize(lambda x: float(f"{x:.{DIGITS}g}"))(values)
    return pd.DataFrame(rounded, columns=[*COLUMNS])


def numbers(impacts: Impacts) -> np.ndarray:
    return torch.cat((impacts.q, impacts.v_pre, impacts.v_post), 1).numpy()


def text(frame: pd.DataFrame, separator: str = ",", decimal: str = ".", header: list[str] | None = None) -> str:
    rows = [[repr(x).replace(".", decimal) for x in row] for row in frame.to_numpy().tolist()]
    return "\n".join(separator.join(row) for row in [header or [*frame.columns], *rows]) + "\n"


def with_cell(path: Path, frame: pd.DataFrame, column: int, cell: str, *dialect: str) -> Path:
    """The file of a table, with another text in its fifth row."""
    lines = text(frame, *dialect).splitlines()
    cells = lines[5].split(dialect[0])
    lines[5] = dialect[0].join([*cells[:column], cell, *cells[column + 1 :]])
    path.write_text("\n".join(lines), "utf-8")
    return path


def group_rows(frame: pd.DataFrame) -> str:
    lines = text(frame).splitlines()
    return "\n".join([",,,before,,,after,,", "x,y,theta,vx,vy,omega,vx,vy,omega", *lines[1:]])


def spanning_rows(frame: pd.DataFrame) -> str:
    """The same in French, where the name of the first column spans both rows."""
    lines = text(frame).splitlines()
    above, below = "essai,,,,avant impact,,,après impact,,", ",x,y,theta,vx,vy,omega,vx,vy,omega"
    return "\n".join([above, below, *(f"{k},{line}" for k, line in enumerate(lines[1:], 1))])


def unit_row(frame: pd.DataFrame) -> str:
    lines = text(frame.assign(x=1e3 * frame.x, y=1e3 * frame.y)).splitlines()
    return "\n".join([lines[0], "mm,(mm),rad,m/s,m/s,rad/s,m/s,m/s,rad/s", *lines[1:]])


DIALECTS = {
    "decimal commas": (".csv", lambda f: text(f, ";", ",").encode(), ("semicolons", "decimal commas")),
    "a byte-order mark": (".csv", lambda f: codecs.BOM_UTF8 + text(f, ";", ",").encode(), ("decimal commas",)),
    "tabs": (".tsv", lambda f: text(f, "\t").encode(), ("tabs",)),
    "tabs and decimal commas": (".txt", lambda f: text(f, "\t", ",").encode(), ("tabs", "decimal commas")),
    "bars": (".txt", lambda f: text(f, "|").encode(), ("bars",)),
    "aligned by spaces": (".dat", lambda f: f.to_string(index=False, float_format="{:.15g}".format).encode(),
        ("spaces",)),
    "quoted decimal commas": (".csv", lambda f: text(f, '","', ",").replace("\n", '"\n"').join('""').encode()[:-2],
        ("decimal commas",)),
    "UTF-16 without a mark": (".csv", lambda f: text(f, "\t").encode("utf-16-le"), ("UTF-16", "tabs")),
    "Shift-JIS": (".csv", lambda f: text(f.assign(測定者=1.0)).encode("cp932"), ("Shift-JIS",)),
    "UTF-16": (".csv", lambda f: text(f, "\t").encode("utf-16"), ("UTF-16", "tabs")),
    "Windows-1251": (".csv", lambda f: text(f.assign(Проверка=1.0, Примечание=2.0, Испытание=3.0, Поверхность=4.0,
        Температура=5.0)).encode("cp1251"), ("Windows-1251",)),
    "Windows-1252": (".csv", lambda f: text(f.assign(Prüfer=1.0)).encode("cp1252"), ("Windows-1252",)),
    "comments": (".csv", lambda f: ("# drops, 3 May\n\n% camera 2\n" + text(f)).encode(), ("2 comment lines above",)),
    "a header in a comment": (".csv", lambda f: ("# " + text(f)).encode(), ("names in the last comment",)),
    "a title": (".csv", lambda f: ("Drops of Monday,,,,,,,,\n\n" + text(f)).encode(), ("1 line above the header",)),
    "two rows of names": (".csv", lambda f: group_rows(f).encode(), ("two rows of names",)),
    "a name over both rows": (".csv", lambda f: spanning_rows(f).encode(), ("two rows of names",)),
    "a row of units": (".csv", lambda f: unit_row(f).encode(), ("a row of units", "x is 'x [mm]' in mm")),
    "Windows' lines": (".csv", lambda f: text(f, ";", ",").replace("\n", "\r\n").encode(), ("semicolons",)),
    "Unicode's minus": (".csv", lambda f: text(f, ";", ",").replace("-", "\u2212").encode(), ("decimal commas",)),
    "empty cells at the end": (".csv", lambda f: text(f).replace("\n", ",,\n").replace("post,,", "post", 1).encode(),
        ()),
}  # fmt: skip


@pytest.mark.parametrize(("suffix", "content", "said"), DIALECTS.values(), ids=DIALECTS)
def test_every_dialect_is_the_same_table(tmp_path, frame, suffix, content, said):
    path = tmp_path / f"drops{suffix}"
    path.write_bytes(content(frame))
    found = table.read(path, **BODY)
    np.testing.assert_allclose(numbers(found.impacts), frame, rtol=ROUNDING, atol=0)
    for words in said:
        assert any(words in part for part in found.read_as), found.read_as
    assert bool(found.read_as) == bool(said)
    blocks = [*table.read_blocks(path, 7, **BODY)]  # of a large file: as the whole
    np.testing.assert_array_equal(np.concatenate([numbers(one.impacts) for one in blocks]), numbers(found.impacts))
    assert [one.name for one in propose(path).settings if one.value == "???"] == ["mass", "shape"]


def test_text_of_labview_and_of_other_suffixes(tmp_path, frame):
    """Between its marks LabVIEW writes one line a property, and a column of comments that no row has."""
    content = text(frame, "\t")
    for suffix in (".asc", ".prn", ".tab"):
        (tmp_path / f"drops{suffix}").write_text(content)
    above = "LabVIEW Measurement\t\nSeparator\tTab\n***End_of_Header***\t\n\t\nChannels\t9\nSamples" + "\t30" * 9
    header, _, rows = content.partition("\n")
    counted = "".join(f"{k}.0\t{row}\n" for k, row in enumerate(rows.splitlines()))
    lines = [above, "***End_of_Header***" + "\t" * 10, f"X_Value\t{header}\tComment", counted]
    (tmp_path / "drops.lvm").write_text("\n".join(lines))
    for path in tmp_path.iterdir():
        found = table.read(path, **BODY)
        np.testing.assert_allclose(numbers(found.impacts), frame, rtol=ROUNDING, atol=0)
        assert propose(path).source == "table"


def test_a_database_has_one_table_of_impacts(tmp_path, frame):
    """Beside others; of two you are asked for one, and nothing is written to it."""
    path = tmp_path / "drops.sqlite"
    with closing(sqlite3.connect(path)) as base:
        frame.to_sql('impacts of "May"', base, index=False)
        frame[["x", "y"]].to_sql("points", base, index=False)
        endless = "WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n) SELECT x AS vy_post FROM n"
        base.execute(f"CREATE VIEW endless AS {endless}")
    path.chmod(0o444)
    found = table.read(path, **BODY)
    np.testing.assert_array_equal(numbers(found.impacts), frame)
    assert found.read_as == ('table impacts of "May"',)
    assert propose(path).source == "table"
    path.chmod(0o644)
    with closing(sqlite3.connect(path)) as base:
        frame.to_sql("impacts of June", base, index=False)
    with refused(["has several tables, 'impacts of \"May\"', 'impacts of June'"]):
        table.read(path, **BODY)
    (tmp_path / "no.db").write_text("no database, but a text that is long enough to be looked at as one" * 9)
    with refused(["no.db: is no readable database of SQLite (file is not a database)"]):
        table.read(tmp_path / "no.db", **BODY)
    with closing(sqlite3.connect(tmp_path / "points.db")) as base:
        frame[["x", "y", "vx", "vy"]].to_sql("points", base, index=False)
    with refused(["points.db: has no velocity after contact"]):
        table.read(tmp_path / "points.db", **BODY)


STATISTICS = {
    "means below": (["Mittelwert;{}", "Std.-Abw.;{}", "n=30"], 3),
    "means by word": (["mean (n=30);{}", "SD;{}", "total;{}", "max;{}"], 4),
    "means in French": (["Moyenne;{}", "écart type;{}"], 2),
    "other languages": (["Standardabw.;{}", "medelvärde;{}", "odchylenie std.;{}", "среднее;{}"], 4),
    "comments": (["# cleaned", "% the floor, again"], 2),
    "a note": (["Trials 12 and 40 were repeated.", "-----", "Page 2;;;;;;;;;"], 3),
    "the header again": (["trial;" + ";".join(COLUMNS), ";mm;mm;rad;m/s;m/s;rad/s;m/s;m/s;rad/s"], 2),
}


@pytest.mark.parametrize(("below", "count"), STATISTICS.values(), ids=STATISTICS)
@pytest.mark.parametrize("place", ["between", "below"])
def test_rows_that_are_no_impacts_are_left_out(tmp_path, frame, below, count, place):
    """Of statistics, notes and pages, at the end of a table and within it."""
    path, lines = tmp_path / "drops.csv", text(frame.assign(x=1e3 * frame.x, y=1e3 * frame.y), ";").splitlines()
    numbered = [f"{k};{line}" for k, line in enumerate(lines[1:], 1)]
    below = [line.format(lines[3]) for line in below]
    numbered[20:20] = below if place == "between" else []
    numbered += below if place == "below" else []
    above = ["trial;" + lines[0], ";mm;mm;rad;m/s;m/s;rad/s;m/s;m/s;rad/s"]
    path.write_text("\n".join([*above, *numbered]), "utf-8")
    found = table.read(path, **BODY)
    np.testing.assert_allclose(numbers(found.impacts), frame, rtol=ROUNDING, atol=0)
    assert found.impacts.trial == tuple(map(str, range(1, 31)))
    (said,) = [part for part in found.read_as if "no impact" in part]
    assert said.startswith(f"left out {count} row")
    assert f"(line {23 if place == 'between' else 33})" in said
    blocks = [*table.read_blocks(path, 7, **BODY)]
    np.testing.assert_array_equal(np.concatenate([numbers(one.impacts) for one in blocks]), numbers(found.impacts))


def test_last_rows_that_begin_with_a_word_where_others_have_a_number_are_left_out(tmp_path, frame):
    """As means in any language; a trial that was repeated, 30b, is one."""
    lines = text(frame).splitlines()
    numbered = [f"{k},{line}" for k, line in enumerate(lines[1:], 1)]
    below = [f"30b,{lines[3]}", f"Keskihajonta,{lines[4]}", f"virhe,{lines[5]}"]
    (tmp_path / "drops.csv").write_text("\n".join(["trial," + lines[0], *numbered, *below]), "utf-8")
    found = table.read(tmp_path / "drops.csv", **BODY)
    assert found.impacts.trial[-2:] == ("30", "30b")
    assert found.read_as == ("left out 2 rows that are no impacts: 'Keskihajonta' (line 33), 'virhe' (line 34)",)


def test_a_last_trial_without_a_number_stays(tmp_path, frame):
    lines = text(frame).splitlines()
    rows = [f"{'NA' if k == 30 else k},{line}" for k, line in enumerate(lines[1:], 1)]
    (tmp_path / "drops.csv").write_text("\n".join([f"run,{lines[0]}", *rows]), "utf-8")
    assert len(table.read(tmp_path / "drops.csv", **BODY).impacts) == 30


def test_words_of_statistics_that_are_names_stay(tmp_path, frame):
    """Of bodies and of groups; and a trial that was lost is no note."""
    path, lines = tmp_path / "drops.csv", text(frame).splitlines()
    named = [f"{('mean', 'max', 'S')[k % 3]},{line}" for k, line in enumerate(lines[1:])]
    path.write_text("\n".join([f"setting,{lines[0]}", *named]), "utf-8")
    np.testing.assert_array_equal(numbers(table.read(path, **BODY).impacts), frame)
    lost = [f"drop {k},{line}" for k, line in enumerate(lines[1:], 1)] + ["drop 31" + 9 * ","]
    path.write_text("\n".join([f"trial,{lines[0]}", *lost]), "utf-8")
    assert table.read(path, drop_incomplete=True, **BODY).impacts.incomplete == ("drop 31",)
    path.write_text("\n".join([f"trial,{lines[0]}", *lost[:-1], "drop 31,oak"]), "utf-8")
    with refused(["row 31 (line 32) has 2 cells where the header has 10"]):
        table.read(path, **BODY)


def test_a_name_in_a_merged_cell_is_that_of_the_rows_below(tmp_path, frame):
    path, lines = tmp_path / "drops.csv", text(frame).splitlines()
    objects = ["" if k % 10 else f"wood {k}" for k in range(30)]
    remarks = ["" if k != 4 else "camera moved" for k in range(30)]
    rows = zip(objects, remarks, lines[1:], strict=True)
    path.write_text("\n".join([f"object,remark,{lines[0]}", *map(",".join, rows)]), "utf-8")
    found = table.read(path, **BODY)
    assert found.impacts.object == tuple(f"wood {k - k % 10}" for k in range(30))
    assert found.read_as[0] == "'object' filled in from the row above, where it is empty"
    blocks = [one.impacts.object for one in table.read_blocks(path, 7, **BODY)]
    assert sum(blocks, ()) == found.impacts.object


def test_groups_of_other_names(tmp_path, frame):
    """Over quantities as well as times, and over columns that are neither before nor after."""
    lines, path = text(frame).splitlines(), tmp_path / "drops.csv"
    above = "Lage beim Aufprall,,,Geschwindigkeit vor dem Stoß,,,Geschwindigkeit nach dem Stoß,,"
    path.write_text("\n".join([above, "x,y,Winkel,x,y,Drehrate,vx,vy,Drehrate", *lines[1:]]), "utf-8")
    np.testing.assert_array_equal(numbers(table.read(path, **BODY).impacts), frame)


def test_names_in_two_rows_of_a_parquet_file(tmp_path, frame):
    groups = [("post", name.removesuffix("_post")) if name.endswith("_post") else ("pre", name) for name in frame]
    groups = [("", "omega'") if group == ("post", "omega") else group for group in groups]
    frame.set_axis(pd.MultiIndex.from_tuples(groups), axis=1).to_parquet(tmp_path / "drops.parquet")
    found = table.read(tmp_path / "drops.parquet", **BODY)
    np.testing.assert_allclose(numbers(found.impacts), frame, rtol=ROUNDING, atol=0)


@pytest.mark.parametrize("suffix", [".xlsx", ".ods"])
def test_spreadsheets(tmp_path, frame, suffix):
    pytest.importorskip("openpyxl" if suffix == ".xlsx" else "odf")
    path = tmp_path / f"drops{suffix}"
    blank = [None] * len(frame.columns)
    rows = [["Drops of Monday", *blank], [None, *blank], [*frame.columns, "remark"]]
    rows += [[*row, "fine"] for row in frame.to_numpy().tolist()]
    engine = {".xlsx": "openpyxl", ".ods": "odf"}[suffix]
    with pd.ExcelWriter(path, engine=engine) as writer:
        pd.DataFrame(rows).to_excel(writer, sheet_name="drops", header=False, index=False)
        pd.DataFrame([["measured by", "me"], ["on", "Monday"]]).to_excel(
            writer, sheet_name="notes", header=False, index=False
        )
    found = table.read(path, **BODY)
    np.testing.assert_allclose(numbers(found.impacts), frame, rtol=ROUNDING, atol=0)
    assert found.read_as == ("worksheet drops", "1 line above the header")
    assert propose(path).source == "table"
    with pd.ExcelWriter(path, engine=engine, mode="w") as writer:  # means and parameters are no second table
        pd.DataFrame([["drop", "x"], [1, 2.0], ["mean", 2.0]]).to_excel(writer, sheet_name="means", header=False)
        frame.to_excel(writer, sheet_name="drops", index=False)
    assert "worksheet drops" in table.read(path, **BODY).read_as
    pd.DataFrame({"t": [0.1, 0.2], "x": [0.0, 1.0], "y": [0.0, 1.0]}).to_excel(path, engine=engine, index=False)
    assert propose(path).source == "tracks"
    with pd.ExcelWriter(path, engine=engine) as writer:
        for name in ("monday", "tuesday"):
            frame.to_excel(writer, sheet_name=name, index=False)
    both = table.read(path, **BODY)  # of one header, one below the other
    assert len(both.impacts) == 2 * len(frame)
    with pd.ExcelWriter(path, engine=engine) as writer:
        frame.to_excel(writer, sheet_name="monday", index=False)
        frame.drop(columns="theta").to_excel(writer, sheet_name="tuesday", index=False)
    with refused(["tables of numbers in its worksheets 'monday', 'tuesday'"]):
        table.read(path, **BODY)
    path.write_bytes(path.read_bytes()[:-400])
    with refused(["export it as CSV"]):
        table.read(path, **BODY)


def test_a_spreadsheet_without_its_library_says_what_to_install(tmp_path, monkeypatch, frame):
    pytest.importorskip("openpyxl")
    frame.to_excel(tmp_path / "drops.xlsx", index=False)
    monkeypatch.setitem(__import__("sys").modules, "openpyxl", None)
    with pytest.raises(ValueError, match=r"needs pip install 'contactlearn\[spreadsheets\]'.*or export it as CSV"):
        table.read(tmp_path / "drops.xlsx", **BODY)


def test_a_frame_is_read_as_its_file(frame):
    named = frame.rename(columns={"vx_post": "vx'", "omega": "ω [rpm]"}).assign(remark="fine")
    named["ω [rpm]"] *= 30 / math.pi
    found = table.read(named, **BODY)
    np.testing.assert_allclose(numbers(found.impacts), frame, rtol=ROUNDING, atol=0)
    assert (found.impacts.source, found.unused) == ("DataFrame", ("remark",))
    times = pd.MultiIndex.from_tuples([*((n, "") for n in COLUMNS[:3]), *((n, "before") for n in COLUMNS[3:6]),
                                       *((n, "after") for n in COLUMNS[3:6])])  # fmt: skip
    double = pd.DataFrame(frame.to_numpy(), columns=times)
    np.testing.assert_array_equal(numbers(table.read(double, **BODY).impacts), frame)
    gap = frame.astype({"vx": object})
    gap.loc[3, "vx"] = None
    with refused(["DataFrame: row 4, column vx", "empty"]):
        table.read(gap, **BODY)


NAMES = {
    "primes": {"vx_post": "vx'", "vy_post": "vy′", "omega_post": "ω'"},
    "signs": {"vx": "vx-", "vx_post": "vx+", "vy": "v_y⁻", "vy_post": "v_y⁺"},
    "in and out": {"vx": "vx_in", "vx_post": "vx_out", "vy": "vy_in", "vy_post": "vy_out"},
    "one body": {"vx": "ball_vx", "vy": "Ball vy", "vx_post": "ball_vx_post", "vy_post": "ball vy after"},
    "German": {
        "vx": "Geschwindigkeit x vorher",
        "vx_post": "Geschwindigkeit x nachher",
        "theta": "Winkel",
        "omega": "Drehgeschwindigkeit vorher",
        "omega_post": "Drehgeschwindigkeit nachher",
    },
    "contact in German": {"vx": "vx vor dem Stoß", "vx_post": "vx nach dem Stoß", "omega": "Drehzahl vor Aufprall"},
    "French": {"vx": "vitesse x avant", "vx_post": "vitesse x après", "omega": "vitesse angulaire"},
    "Swedish": {"vx": "hastighet vx före", "vx_post": "vx efter stöt", "theta": "vinkel", "omega": "ω före"},
    "Dutch": {"vx": "snelheid x voor botsing", "vx_post": "snelheid x na botsing", "theta": "hoek", "trial": "proef"},
    "Portuguese": {"vx": "velocidade x antes", "vx_post": "velocidade x depois", "theta": "ângulo"},
    "Polish": {"vx": "prędkość vx przed zderzeniem", "vx_post": "prędkość vx po zderzeniu", "theta": "kąt"},
    "Russian": {"vx": "скорость vx до удара", "vx_post": "скорость vx после удара", "theta": "угол θ"},
    "Japanese": {"vx": "速度 vx 衝突前", "vx_post": "速度 vx 衝突後", "theta": "角度"},
    "Chinese": {"vx": "碰前vx", "vy": "碰前速度y", "vx_post": "碰后vx", "vy_post": "碰后速度y", "omega": "碰前角速度"},
    "words": {"vx": "speed x before", "omega": "Spin", "theta": "Angle", "vy_post": "Vy after impact"},
}


@pytest.mark.parametrize("names", NAMES.values(), ids=NAMES)
def test_names_in_other_words(frame, names):
    found = table.read(frame.rename(columns=names), **BODY)
    np.testing.assert_array_equal(numbers(found.impacts), frame)
    assert found.unused == ()


UNITS = {
    "omega [rpm]": ("omega", 30 / math.pi), "omega vor [U/min]": ("omega", 30 / math.pi),
    "ω avant (tr/min)": ("omega", 30 / math.pi), "ω [min⁻¹]": ("omega", 30 / math.pi),
    "spin (rev/s)": ("omega", 0.5 / math.pi),
    "ω′ (deg/s)": ("omega_post", 180 / math.pi), "x_mm": ("x", 1e3), "y [in]": ("y", 1 / 0.0254),
    "vx [mph]": ("vx", 3.6 / 1.609344),
    "vx [km/h]": ("vx", 3.6), "vy' / m s⁻¹": ("vy_post", 1), "θ [°]": ("theta", 180 / math.pi),
    "vx_post [ft/s]": ("vx_post", 1 / 0.3048), "vy (µm/µs)": ("vy", 1),
}  # fmt: skip


@pytest.mark.parametrize("name", UNITS)
def test_units_that_names_state_are_converted(frame, name):
    column, factor = UNITS[name]
    changed = frame.assign(**{column: factor * frame[column]}).rename(columns={column: name})
    silent = {"length": "m"} if column in "xy" else {"angle": "rad"} if column in ("theta", "omega_post") else {}
    silent |= {"length": "m", "time": "s"} if column in ("vx_post", "vy") else {}
    for columns in (None, {column: name}):  # stated or recognised
        found = table.read(changed, columns=columns, units=silent, **BODY)
        np.testing.assert_allclose(numbers(found.impacts), frame, rtol=ROUNDING, atol=1e-15)


def test_names_of_rows_under_a_header_without_one(tmp_path, frame):
    """As write.table of R has them; a decimal comma that parts a cell in two is none."""
    lines = text(frame, " ").splitlines()
    (tmp_path / "drops.txt").write_text(
        "\n".join([lines[0], *(f'"{k}" {line}' for k, line in enumerate(lines[1:], 1))])
    )
    found = table.read(tmp_path / "drops.txt", **BODY)
    np.testing.assert_allclose(numbers(found.impacts), frame, rtol=ROUNDING, atol=0)
    assert "names of rows, which R writes" in found.read_as
    assert found.impacts.trial[-1] == "30"
    (tmp_path / "names.txt").write_text(
        "\n".join([lines[0], *(f'"drop {k}" {line}' for k, line in enumerate(lines[1:], 1))])
    )
    np.testing.assert_allclose(numbers(table.read(tmp_path / "names.txt", **BODY).impacts), frame, rtol=ROUNDING)
    (tmp_path / "commas.csv").write_text("nr,vx\n" + "".join(f"{k},0,5\n" for k in range(1, 6)))
    with refused(["row 1 (line 2) has 3 cells", "a decimal comma?"]):
        table.read(tmp_path / "commas.csv", **BODY)


def test_an_exponent_is_no_unit():
    assert with_one_unit(["3.2e-05"] * 3) is None
    assert with_one_unit(["3.2 g", "4 g"]) == (["3.2", "4"], "g")


def test_a_phase_in_dutch_is_no_missing_one():
    assert [time_of(word) for word in ("voor", "na", "NA", "na de botsing")] == ["pre", "post", None, None]


def test_other_descriptions_are_named_by_settings(frame):
    """Angles of speeds, in the unit of the column's name, that may be from the floor or from its normal."""
    ball = frame.drop(columns=["theta", "vx", "vy", "vx_post", "vy_post"]).assign(
        speed_in_mph=np.hypot(frame.vx, frame.vy) * 3600 / 1609.344,
        angle_in_deg=np.degrees(np.arctan2(-frame.vy, frame.vx)),
        speed_out_mph=np.hypot(frame.vx_post, frame.vy_post) * 3600 / 1609.344,
        angle_out_deg=np.degrees(np.arctan2(frame.vy_post, frame.vx_post)),
    )
    with refused(["'data.columns={direction_floor: angle_in_deg, direction_floor_post: angle_out_deg}'"]):
        table.read(ball, **BALL)
    columns = {"direction_floor": "angle_in_deg", "direction_floor_post": "angle_out_deg"}
    found = table.read(ball, columns=columns, **BALL)
    np.testing.assert_allclose(numbers(found.impacts)[:, 3:], frame[[*COLUMNS[3:]]], rtol=1e-9, atol=1e-9)


def test_in_and_out_are_before_and_after_contact(frame):
    """Beside a column that is called out, in is no inch."""
    mph, ounce = 1609.344 / 3600, 0.45359237 / 16
    names = {"vx": "Vx in [mph]", "vx_post": "Vx out [mph]", "vy": "Vy in [mph]", "vy_post": "Vy out [mph]"}
    there = frame.assign(**{column: frame[column] / mph for column in names}, mass=BODY["mass"] / ounce)
    there = there.rename(columns=names | {"mass": "mass [oz]"})
    found = table.read(there, **{key: value for key, value in BODY.items() if key != "mass"})
    np.testing.assert_allclose(numbers(found.impacts), frame, rtol=ROUNDING, atol=1e-15)
    assert found.impacts.mass.tolist() == pytest.approx([BODY["mass"]] * len(frame))


@pytest.mark.parametrize("space", [PLANE, SPACE], ids=str)
def test_a_unit_without_signs_has_one_meaning(space):
    """All products have a text of their own, such as m/ms and mm/s, and are read as it says."""
    for column, units in impact_vocabulary(space).items():
        quantities = {*powers_of(column)}
        meanings = {tuple(stated.items()) for stated in units.values()}  # m.s of m/s is also ms
        assert len(meanings) == (math.prod(len(UNIT_FACTORS[name]) for name in quantities) + 1 if quantities else 1), (
            column
        )
    for length in UNIT_FACTORS["length"]:
        for time in UNIT_FACTORS["time"]:
            known = recognise([f"v_x [{length}/{time}]"], impact_vocabulary(space))
            assert known.units == {"vx": {"length": length, "time": time}}


def test_covariances_have_the_units_of_their_velocities(frame):
    pairs = {"vx_vx": 1e6 * 4e-4, "vx_vy": 1e3 * 1e-5, "vx_omega": 1e3 * 1e-4}  # of mm/s
    pairs |= {"vy_vy": 5e-4, "vy_omega": 2e-4, "omega_omega": 9e-2}
    named = frame.assign(vx=1e3 * frame.vx, **{f"cov_{pair}": value for pair, value in pairs.items()})
    found = table.read(named.rename(columns={"vx": "vx [mm/s]"}), units={"length": "m"}, **BODY)
    expected = torch.tensor([[4e-4, 1e-5, 1e-4], [1e-5, 5e-4, 2e-4], [1e-4, 2e-4, 9e-2]], dtype=torch.float64)
    torch.testing.assert_close(found.impacts.v_pre_cov[0], expected, rtol=1e-9, atol=0)


def test_a_setting_that_no_column_has_is_refused(frame):
    named = frame.rename(
        columns={name: f"{name} [{'m' if name in 'xy' else 'm/s'}]" for name in frame if name[0] in "xyv"}
    )
    with refused(["data.units.length=mm", "'x [m]' says m"]):
        table.read(named, units={"length": "mm"}, **BODY)


@pytest.mark.parametrize("unit", ["1/s", "Hz", "furlongs/fortnight"])
def test_a_unit_that_is_not_known_is_no_si(frame, unit):
    named = frame.rename(columns={"omega": f"turns of the disc [{unit}]"})
    with refused([f"the unit {unit} of omega is not known", "convert the column to rad/s"]):
        table.read(named, columns={"omega": named.columns[5]}, **BODY)


def test_a_unit_of_another_quantity_is_refused(frame):
    for columns in (None, {"omega": "omega [mm/s]"}):
        with refused(["omega [mm/s]"]):
            table.read(frame.rename(columns={"omega": "omega [mm/s]"}), columns=columns, **BODY)


@pytest.mark.parametrize("cell", ["", "-", "n/a", "NA", "N/A", "#N/A", "#DIV/0!", "nan", "NaN", "null", "#WERT!"])
def test_missing_numbers_are_as_empty_cells(tmp_path, frame, cell):
    path = with_cell(tmp_path / "drops.csv", frame, 3, cell, ";", ",")
    with refused(["row 5 (line 6), column vx", "drop_incomplete"]):
        table.read(path, **BODY)
    found = table.read(path, drop_incomplete=True, **BODY)
    assert found.impacts.incomplete == ("5",)
    np.testing.assert_array_equal(numbers(found.impacts), frame.drop(index=4))


GROUPED = {
    "1.234,5": ("1.234,5", 1234.5), "1,234.5 in tabs": ("1,234.5", 1234.5), "1 234,5": ("1 234,5", 1234.5),
    "1'234.5": ("1'234.5", 1234.5), "1,234,567": ("1,234,567", 1234567.0), "narrow": ("1\u202f234,5", 1234.5),
}  # fmt: skip


@pytest.mark.parametrize(("cell", "value"), GROUPED.values(), ids=GROUPED)
def test_groups_of_thousands(tmp_path, frame, cell, value):
    decimal = "," if cell.rfind(",") > max(cell.rfind("."), cell.rfind("'")) and cell.count(",") == 1 else "."
    path = with_cell(tmp_path / "drops.csv", frame, 0, cell, "\t", decimal)
    assert table.read(path, **BODY).impacts.q[4, 0].item() == value


@pytest.mark.parametrize("decimal", [".", ","])
def test_whole_numbers_beside_groups_tell_thousands(tmp_path, frame, decimal):
    """833 and 1,470 in a column of whole numbers: no column of decimals has both."""
    spins, other = [833, -490, 1470, -3020, 16624, 0], {".": ",", ",": "."}[decimal]
    written = [f"{spin:,}".replace(",", other) for spin in spins]
    path, index = tmp_path / "drops.csv", COLUMNS.index("omega")

    def write(cells: list[str]) -> None:
        lines = [line.split(";") for line in text(frame[:6], ";", decimal).splitlines()]
        for line, cell in zip(lines[1:], cells, strict=True):
            line[index] = cell
        path.write_text("\n".join(map(";".join, lines)), "utf-8")

    write(written)
    found = table.read(path, validate=False, **BODY).impacts
    np.testing.assert_allclose(numbers(found), frame[:6].assign(omega=spins), rtol=ROUNDING)
    write(["8.33" if decimal == "." else "8,33", *written[1:]])  # which has decimals
    with refused([f"got '1{other}470', which is 1470, or "]):
        table.read(path, validate=False, **BODY)


def test_a_group_that_may_be_decimals_is_refused_in_its_row(tmp_path, frame):
    for cell, decimal in (("1,234", "."), ("1.234", ",")):
        path = with_cell(tmp_path / "drops.csv", frame, 0, cell, "\t", decimal)
        with refused(["row 5 (line 6), column x", f"'{cell}', which is 1234, or 1.234"]):
            table.read(path, **BODY)


def long(frame: pd.DataFrame) -> pd.DataFrame:
    """Two rows an impact."""
    before = frame[["x", "y", "theta", "vx", "vy", "omega"]].assign(trial=[f"d{k}" for k in range(len(frame))])
    after = before.assign(**{name: frame[f"{name}_post"] for name in ("vx", "vy", "omega")})
    both = pd.concat([before.assign(phase="before"), after.assign(phase="after")])
    return both.sort_index(kind="stable")


MEANS = "'vx' without errors (±): rows may be means of trials, which scatter less than single ones"
MARKED = {
    "units": (lambda x: f"{x!r} m/s", "'vx' in m/s, as its cells say"),
    "errors": (lambda x: f"{x!r} ± 0.02", MEANS),
    "errors and units": (lambda x: f"{x!r} +/- 0.02 m/s", "'vx' in m/s, as its cells say"),
    "digits of errors": (lambda x: f"{x!r}(12)", MEANS),
    "footnotes": (lambda x: f"{x!r}*" if x > 0 else f"{x!r}†", "'vx' without marks of footnotes"),
    "superscripts": (lambda x: f"{x!r}¹", "'vx' without marks of footnotes"),
    "Fortran": (lambda x: f"{x:.15E}".replace("E", "D"), None),
    "powers": (lambda x: f"{100 * x:.15g}×10⁻²", None),
    "en dashes": (lambda x: repr(x).replace("-", "–"), None),
}


@pytest.mark.parametrize("decimal", [".", ","])
@pytest.mark.parametrize(("written", "said"), MARKED.values(), ids=MARKED)
def test_numbers_with_something_beside_them(tmp_path, frame, decimal, written, said):
    path, units = tmp_path / "drops.csv", {"length": "m", "time": "s"}
    there = pd.DataFrame({name: [repr(x) for x in frame[name]] for name in frame})
    there["vx"] = [written(float(x)) for x in frame.vx]
    there = there.map(lambda cell: cell.replace(".", decimal))
    there.to_csv(path, sep=";", index=False)
    found = table.read(path, units=units, **BODY)
    np.testing.assert_allclose(numbers(found.impacts), frame, rtol=ROUNDING, atol=0)
    assert said is None or said in found.read_as


def test_units_in_cells(frame):
    """Of one unit in a column, which its name may say, too; of a column that a setting names, they are refused."""
    inches = frame.assign(x=[f"{x / 0.0254!r} in" for x in frame.x])
    found = table.read(inches.rename(columns={"x": "x [in]"}), units={"length": "m"}, **BODY)
    np.testing.assert_allclose(numbers(found.impacts), frame, rtol=ROUNDING, atol=0)
    np.testing.assert_array_equal(
        numbers(table.read(inches, units={"length": "m"}, **BODY).impacts), numbers(found.impacts)
    )
    mixed = inches.assign(x=["1 mm", *inches.x[1:]])
    with refused(["column x: its cells have mm in row 1 and in in row 2", "such as 'x [mm]'"]):
        table.read(mixed, **BODY)
    with refused(["column place: its cells have in in row 1", "such as 'place [in]'"]):
        table.read(inches.rename(columns={"x": "place"}), columns={"x": "place"}, **BODY)
    sized = frame.assign(object=["12 mm"] * 29 + ["14 mm"])  # a name
    assert table.read(sized, **BODY).impacts.object[-1] == "14 mm"


def test_stars_of_fortran_are_missing_numbers(tmp_path, frame):
    path = tmp_path / "drops.dat"
    lines = frame.to_string(index=False, float_format="{:.15g}".format).splitlines()
    above = "/* drop tower, v. 3\n   vx in m/s\n*/\n! run 7\n// camera 2\n"
    cells = lines[4].split()
    lines[4] = " ".join([*cells[:3], "********", *cells[4:]])
    path.write_text(above + "\n".join([*lines[:10], "\f", *lines[10:]]), "utf-8")
    assert table.read(path, drop_incomplete=True, **BODY).impacts.incomplete == ("4",)
    with refused(["row 4 (line 10)", "got ********: fill it in"]):
        table.read(path, **BODY)


def test_trials_that_begin_again_in_each_session(frame):
    """Beside two rows an impact: named by a column, or one session after the other."""
    both = long(frame).assign(trial=np.repeat(np.arange(30) % 15, 2))
    named = table.read(both.assign(day=np.repeat(["mon", "tue"], 30)), **BODY).impacts
    counted = table.read(both, **BODY).impacts
    for found, first in ((named, ("mon/0", "tue/0")), (counted, ("1/0", "2/0"))):
        np.testing.assert_array_equal(numbers(found), frame)
        assert found.trial[::15] == first
    with refused(["two rows before contact in column 'phase'"]):  # of one trial, which stands there twice
        table.read(pd.concat([both.iloc[:20], both.iloc[:2]]), **BODY)


def test_two_rows_an_impact(tmp_path, frame):
    path = tmp_path / "drops.csv"
    both = long(frame)
    both.to_csv(path, index=False)
    found = table.read(path, **BODY)
    np.testing.assert_array_equal(numbers(found.impacts), frame)
    assert found.impacts.trial[:2] == ("d0", "d1")
    assert found.impacts.q_post is None  # the pose is stated once, not measured twice
    assert numbers(next(table.read_blocks(path, 7, **BODY)).impacts).shape == (30, 9)
    np.testing.assert_array_equal(numbers(table.read(both.drop(columns="trial"), **BODY).impacts), frame)
    sorted_ = both.rename(columns={"trial": "shot"}).sort_values("phase", kind="stable")  # all after, then all before
    np.testing.assert_array_equal(numbers(table.read(sorted_, **BODY).impacts), frame)
    settings = {one.name: one.value for one in propose(path).settings}
    assert settings["columns.vx_post"] == "vx after"
    spins = both.assign(spin_rpm=both.omega * 30 / math.pi).drop(columns="omega")  # a unit holds after contact, too
    np.testing.assert_allclose(numbers(table.read(spins, **BODY).impacts), frame, rtol=ROUNDING, atol=0)
    for changed, fragments in (
        (both.iloc[:-1], ["trial 'd29' has no row after contact"]),
        (both.assign(trial="d1"), ["two rows before contact in column 'phase'"]),
    ):
        with refused(fragments):
            table.read(changed, **BODY)


def test_a_part_of_a_pose_in_two_rows_an_impact(frame):
    """The angle of a body whose place nobody measured, and the place of a ball, stand after contact, too."""
    both = long(frame)
    moved = both.assign(x=np.arange(len(both)) / 100, theta=both.theta + np.where(both.phase == "after", 0.01, 0.0))
    for part, other, body in (("theta", "x", BODY), ("x", "theta", BALL)):
        found = table.read(moved.drop(columns=[other, "y"]), **body)
        assert found.unused == (f"{part} after",)
        assert found.impacts.q_post is None
        np.testing.assert_array_equal(found.impacts.v_post.numpy(), frame[["vx_post", "vy_post", "omega_post"]])


def melted(frame: pd.DataFrame) -> pd.DataFrame:
    """A row a number, with units."""
    rows = []
    for k, row in enumerate(frame.to_dict("records")):
        for name, value in row.items():
            bare = name.removesuffix("_post")
            phase = "post" if bare != name else "pose" if bare in ("x", "y", "theta") else "pre"
            unit = "deg" if name == "theta" else {"x": "m", "y": "m", "v": "m/s", "o": "rad/s"}[bare[0]]
            value = math.degrees(value) if name == "theta" else value
            rows.append((f"T{k:03d}", phase, bare, value, unit))
    return pd.DataFrame(rows, columns=["trial", "phase", "variable", "value", "unit"])


def test_a_row_a_number(tmp_path, frame):
    path, there = tmp_path / "drops.csv", melted(frame)
    there.to_csv(path, index=False)
    found = table.read(path, units={"angle": "rad"}, **BODY)
    np.testing.assert_allclose(numbers(found.impacts), frame, rtol=ROUNDING, atol=0)
    assert found.impacts.trial[:2] == ("T000", "T001")
    assert found.read_as[0] == "a long table: 'value' of each 'variable' and 'phase'"
    assert propose(path).source == "table"
    assert numbers(next(table.read_blocks(path, 7, units={"angle": "rad"}, **BODY)).impacts).shape == (30, 9)
    sessions = there.assign(session=np.arange(len(there)) // 135, trial=np.arange(len(there)) // 9 % 15)  # begins again
    found = table.read(sessions.sample(frac=1, random_state=0).sort_values("session"), units={"angle": "rad"}, **BODY)
    assert {*found.impacts.trial} == {f"{k}/{j}" for k in (0, 1) for j in range(15)}
    incomplete = there.drop(index=25)
    with refused(["row 3", "column vy after", "the cell is empty"]):
        table.read(incomplete.assign(unit=""), units={"angle": "deg"}, **BODY)
    for changed, fragments in (
        (pd.concat([there, there.iloc[3:4]]), ["row 271: a second 'vx [m/s]' of trial=T000"]),
        (
            there.assign(unit=[*there.unit[:12], "mm/s", *there.unit[13:]]),
            ["row 13: 'vx' is in mm/s, and in m/s above"],
        ),
    ):
        with refused(fragments):
            table.read(changed, **BODY)


def nested(frame: pd.DataFrame) -> list[dict]:
    return [
        {
            "id": k, "pose": {"position": [row.x, row.y], "theta": row.theta},
            "before": {"linear": [row.vx, row.vy], "spin": row.omega},
            "after": {"velocity": {"x": row.vx_post, "y": row.vy_post}, "omega": row.omega_post},
        }
        for k, row in enumerate(frame.itertuples())
    ]  # fmt: skip


JSON = {
    "lines": (".jsonl", lambda f: f.to_json(orient="records", lines=True, double_precision=15)),
    "records": (".json", lambda f: f.to_json(orient="records", double_precision=15)),
    "columns": (".json", lambda f: f.to_json(double_precision=15)),
    "split": (".json", lambda f: f.to_json(orient="split", double_precision=15)),
    "lists": (".json", lambda f: json.dumps(f.to_dict("list"))),
    "under a name": (".json", lambda f: json.dumps({"by": "me", "trials": f.to_dict("records")})),
    "nested lines": (".ndjson", lambda f: "\n".join(map(json.dumps, nested(f)))),
    "under a name, a record a line": (
        ".json",
        lambda f: json.dumps({"by": "me", "trials": f.to_dict("records")}).replace('{"', '\n{"').lstrip(),
    ),
    "nested": (".json", lambda f: json.dumps(nested(f))),
}


@pytest.mark.parametrize(("suffix", "content"), JSON.values(), ids=JSON)
def test_records_of_json(tmp_path, frame, suffix, content):
    path = tmp_path / f"drops{suffix}"
    path.write_text(content(frame), "utf-8")
    found = table.read(path, **BODY)
    np.testing.assert_allclose(numbers(found.impacts), frame, rtol=ROUNDING, atol=0)
    assert [one.name for one in propose(path).settings if one.value == "???"] == ["mass", "shape"]


VECTORS = {
    "of NumPy": lambda *x: "[" + " ".join(f"{v: .6g}" for v in x) + "]",
    "tuples": lambda *x: str(tuple(float(v) for v in x)),
    "bare": lambda *x: ";".join(map(repr, map(float, x))),
    "of calls": lambda *x: f"array([{', '.join(map(repr, map(float, x)))}])",
    "lists": lambda *x: [float(v) for v in x],
}


@pytest.mark.parametrize("written", VECTORS.values(), ids=VECTORS)
def test_vectors_in_cells(tmp_path, frame, written):
    there = pd.DataFrame({
        "position": [*map(written, 1e3 * frame.x, 1e3 * frame.y)], "angle": frame.theta,
        "v_before": [*map(written, frame.vx, frame.vy)], "spin_before": frame.omega,
        "v_after": [*map(written, frame.vx_post, frame.vy_post)], "spin_after": frame.omega_post,
    })  # fmt: skip
    there = there.rename(columns={"position": "position [mm]"})
    there.to_csv(tmp_path / "drops.csv", sep="\t", index=False)
    for source in (there, tmp_path / "drops.csv"):
        found = table.read(source, units={"length": "m"}, **BODY)
        np.testing.assert_allclose(numbers(found.impacts), frame, rtol=ROUNDING, atol=0)
        assert "'v_after' holds vx_post, vy_post" in found.read_as
    gap = there.assign(v_after=[None, *there.v_after[1:]])
    assert table.read(gap, units={"length": "m"}, drop_incomplete=True, **BODY).impacts.incomplete == ("1",)
    gap = there.assign(v_after=[written(1, 2, 3), *there.v_after[1:]])
    with refused(["row 1", "column vx_post", str(written(1, 2, 3))[1:3]]):
        table.read(gap, units={"length": "m"}, **BODY)
    with refused(["column 'thing after' holds vectors of 2 numbers", "columns of their own, such as vx_post"]):
        table.read(there.rename(columns={"v_after": "thing after"}), **BODY)


def test_vectors_in_space():
    frame, q = in_space(last=True)
    sets = {"position": "xyz", "orientation": ("q0", "q1", "q2", "q3"), "before.linear": ("vx", "vy", "vz"),
            "before.angular": ("wx", "wy", "wz"), "after.linear": ("vx_post", "vy_post", "vz_post"),
            "after.angular": ("wx_post", "wy_post", "wz_post")}  # fmt: skip
    there = pd.DataFrame({name: frame[[*columns]].to_numpy().tolist() for name, columns in sets.items()})
    found = table.read(there, shape=CUBOID, mass=0.1, validate=False)  # the heights tell
    torch.testing.assert_close(found.impacts.q[:, 3:], q, rtol=0, atol=1e-15)
    stated = there.rename(columns={"orientation": "orientation_xyzw"})
    sphere = table.read(stated, shape={"kind": "sphere", "radius": 0.03}, mass=0.1, validate=False).impacts
    torch.testing.assert_close(sphere.q[:, 3:], q, rtol=0, atol=1e-15)
    torch.testing.assert_close(sphere.v_post, found.impacts.v_post)
    with refused(["'velocity after' holds vectors of 3 numbers", "it is not clear of what"]):  # vz, or ω in a plane
        table.read(pd.DataFrame({"velocity before": there["before.linear"], "velocity after": there["after.linear"]}))


def test_speed_and_angle(frame):
    polar = frame.drop(columns=["vx", "vy", "vx_post", "vy_post"])
    for end in ("", "_post"):
        vx, vy = frame[f"vx{end}"], frame[f"vy{end}"].abs()
        polar[f"speed{end} [km/h]"] = 3.6 * np.hypot(vx, vy)
        polar[f"angle from floor{end} [deg]"] = np.degrees(np.arctan2(vy, vx))
    np.testing.assert_allclose(numbers(table.read(polar, units={"angle": "rad"}, **BODY).impacts), frame, rtol=1e-9)
    plate = polar.rename(columns=lambda name: name.replace("from floor", "to the plate"))
    np.testing.assert_allclose(numbers(table.read(plate, units={"angle": "rad"}, **BODY).impacts), frame, rtol=1e-9)
    normal = polar.rename(columns=lambda name: name.replace("floor", "normal"))
    for end in ("", "_post"):
        normal[f"angle from normal{end} [deg]"] = 90 - normal[f"angle from normal{end} [deg]"]
    np.testing.assert_allclose(numbers(table.read(normal, units={"angle": "rad"}, **BODY).impacts), frame, rtol=1e-9)
    with refused(["may be from the floor or from its normal", "'angle from floor' or 'angle from normal'"]):
        table.read(polar.rename(columns=lambda name: name.replace("angle from floor", "direction")), **BODY)


@pytest.mark.parametrize(
    ("names", "speeds"),
    [
        pytest.param(("v_in", "v_out"), (1.0, 1.0), id="speeds"),
        pytest.param(("drop height [m]", "rebound height [m]"), (0.5, 0.5), id="heights"),
        pytest.param(("h", "h'"), (0.5, 0.5), id="h"),
        pytest.param(("Fallhöhe [m]", "Rücksprunghöhe [m]"), (0.5, 0.5), id="in German"),
        pytest.param(("hauteur de chute", "hauteur de rebond"), (0.5, 0.5), id="in French"),
        pytest.param(("Fallhöhe h [m]", "Rücksprunghöhe h' [m]"), (0.5, 0.5), id="with symbols"),
        pytest.param(("Drop height h1 (m)", "Rebound height h2 (m)"), (0.5, 0.5), id="with indices"),
        pytest.param(("h0 [m]", "h1 [m]"), (0.5, 0.5), id="by indices"),
        pytest.param(("velocity v before (m/s)", "velocity v after (m/s)"), (1.0, 1.0), id="a velocity v"),
        pytest.param(("Fallhöhe [m]", "Rückprallhöhe [m]"), (0.5, 0.5), id="another word in German"),
        pytest.param(("Abwurfhöhe", "Abprallhöhe"), (0.5, 0.5), id="a third one in German"),
        pytest.param(("fallhöjd [m]", "studshöjd [m]"), (0.5, 0.5), id="in Swedish"),
        pytest.param(("valhoogte [m]", "stuithoogte [m]"), (0.5, 0.5), id="in Dutch"),
        pytest.param(("wysokość spadku [m]", "wysokość odbicia [m]"), (0.5, 0.5), id="in Polish"),
        pytest.param(("altura de caída", "altura de rebote"), (0.5, 0.5), id="in Spanish"),
        pytest.param(("altura de suelta", "altura de rebote"), (0.5, 0.5), id="released in Spanish"),
        pytest.param(("Hauteur de lâcher [m]", "Hauteur du rebond [m]"), (0.5, 0.5), id="released in French"),
        pytest.param(("altezza di rilascio [m]", "altezza di rimbalzo [m]"), (0.5, 0.5), id="released in Italian"),
        pytest.param(("Loslasshöhe [m]", "Rückprallhöhe [m]"), (0.5, 0.5), id="released in German"),
        pytest.param(("impact speed [m/s]", "rebound speed [m/s]"), (1.0, 1.0), id="of impact"),
        pytest.param(("h", "v_out"), (0.5, 1.0), id="a height and a speed"),
        pytest.param(("v_impact (m/s)", "v_rebound (m/s)", "X_Value"), (1.0, 1.0), id="of LabVIEW"),
    ],
)
def test_bounces_along_the_normal(tmp_path, names, speeds):
    """A disc without slip and spin: heights are those of falls in vacuum."""
    speed = np.array([[1.0, 2.0, 3.0], [0.8, 1.5, 2.2]])
    values = [v if power == 1.0 else v**2 / (2 * GRAVITY) for v, power in zip(speed, speeds, strict=True)]
    values += [np.arange(3.0)] * (len(names) - 2)  # times
    path = tmp_path / "drops.csv"
    pd.DataFrame(dict(zip(names, values, strict=True))).to_csv(path, index=False)
    found = table.read(path, shape={"kind": "disc", "radius": 0.02}, mass=0.1)
    np.testing.assert_allclose(found.impacts.v_pre[:, 1], -speed[0])
    np.testing.assert_allclose(found.impacts.v_post[:, 1], speed[1])
    assert not found.impacts.v_pre[:, ::2].any()
    assert not found.impacts.v_post[:, ::2].any()
    assert {"slip", "spin", "orientation", "place", "r"} <= {*found.computed}
    if speeds == (1.0, 1.0):
        with refused(["'launch angle' may be the direction of", "'angle from floor'"]):
            frame = pd.read_csv(path).assign(**{"launch angle": 0.3})
            table.read(frame, shape={"kind": "disc", "radius": 0.02}, mass=0.1)
    settings = {setting.name: setting.value for setting in propose(path).settings}
    assert [name for name, value in settings.items() if value == "???"] == ["mass", "shape"]
    units = {name: settings[f"units.{name}"] for name in ("length", "time")}  # as `init` writes them
    columns = {name.removeprefix("columns."): value for name, value in settings.items() if name[:8] == "columns."}
    again = table.read(path, shape={"kind": "disc", "radius": 0.02}, mass=0.1, units=units, columns=columns)
    torch.testing.assert_close(again.impacts.v_post, found.impacts.v_post)


@pytest.mark.parametrize("name", ["Time interval {} (s)", "Flugzeit {} (ms)", "flight {}"])
def test_times_between_bounces_of_a_run(tmp_path, name):
    """As phyphox writes them; a run may have fewer. Times that grow are those of the bounces, and are refused."""
    times = np.array([[0.4, 0.3, 0.2], [0.5, 0.45, np.nan], [0.6, 0.4, 0.3]]) * (1e3 if "ms" in name else 1)
    frame = pd.DataFrame(times, columns=[name.format(k) for k in (1, 2, 3)])
    first, second, third = frame
    frame = frame[[first, third, second]].assign(mass=[0.1, 0.2, 0.3])
    frame.insert(0, "Run", ["a", "b", "c"])
    path, ball = tmp_path / "runs.csv", {"shape": {"kind": "disc", "radius": 0.02}}
    frame.assign(mass=[0.1, 0.2, "x"]).to_csv(path, index=False)
    with refused(["line 4", "'x'"]):
        table.read(path, **ball)
    frame.to_csv(path, index=False)
    found = table.read(path, **ball)
    assert found.impacts.trial == ("a/2", "a/3", "b/2", "c/2", "c/3")
    assert found.impacts.mass.tolist() == [0.1, 0.1, 0.2, 0.3, 0.3]
    np.testing.assert_allclose(found.impacts.v_pre[:, 1], -GRAVITY / 2 * np.array([0.4, 0.3, 0.5, 0.6, 0.4]))
    np.testing.assert_allclose(found.impacts.v_post[:, 1], GRAVITY / 2 * np.array([0.3, 0.2, 0.45, 0.4, 0.3]))
    assert propose(path).source == "table"
    frame.loc[2, first] = 0
    for doubtful in (frame, frame.drop(columns=third).loc[:1]):  # two times may be those of the bounces
        doubtful.to_csv(path, index=False)
        for use in (propose, lambda path: table.read(path, **ball)):
            with refused(["times between bounces? A body is in flight for t = 2 v/g"]):
                use(path)


def test_a_table_without_anything_after_contact_is_refused_so(tmp_path):
    path = tmp_path / "forces.csv"
    path.write_text("Drop height [mm],Peak force [N],Contact time [ms]\n" + "300,2344,1.9\n" * 9)
    for use in (propose, lambda path: table.read(path, **BODY)):
        with refused(["has no velocity after contact", "a height of rebound, or a coefficient", "'Peak force [N]'"]):
            use(path)


def test_missing_numbers_of_other_descriptions_are_dropped(tmp_path, frame, monkeypatch):
    """Of heights, of speeds with angles, of roll, pitch and yaw, and of trials with one of their two rows."""
    monkeypatch.chdir(tmp_path)
    ball = {"shape": {"kind": "disc", "radius": 0.02}, "mass": 0.1}
    heights = pd.DataFrame({"drop height [in]": ["72", "60", "48"], "rebound height [in]": ["50", "n/a", "30"]})
    heights.to_csv("drops.csv", index=False)
    assert propose(Path("drops.csv")).read_as[0].startswith("bounces along the normal")
    with refused(["row 2 (line 3), column rebound height [in]", "got n/a", "data.correct=[drop_incomplete]"]):
        table.read("drops.csv", **ball)
    found = table.read("drops.csv", drop_incomplete=True, **ball).impacts
    assert (found.trial, found.incomplete) == (("1", "3"), ("2",))
    np.testing.assert_allclose(found.v_pre[:, 1], -np.sqrt(2 * GRAVITY * 0.0254 * np.array([72, 48])))
    polar = frame.drop(columns=["vx", "vy", "vx_post", "vy_post"])
    for end in ("", "_post"):
        polar[f"speed{end}"] = np.hypot(frame[f"vx{end}"], frame[f"vy{end}"])
        polar[f"angle from floor{end}"] = np.arctan2(frame[f"vy{end}"].abs(), frame[f"vx{end}"])
    polar.loc[4, "speed_post"] = np.nan
    np.testing.assert_allclose(
        numbers(table.read(polar, drop_incomplete=True, **BODY).impacts), frame.drop(index=4), rtol=1e-9
    )
    both, half = long(frame), long(frame).iloc[:-1]
    whole = table.read(both.iloc[:-2], **BODY).impacts
    found = table.read(half, drop_incomplete=True, **BODY).impacts
    assert found.incomplete == ("d29",)
    np.testing.assert_array_equal(numbers(found), numbers(whole))
    turned, _ = in_space(last=False)
    angles = Rotation.from_quat(turned[["q0", "q1", "q2", "q3"]].to_numpy(), scalar_first=True).as_euler("xyz")
    turned = turned.drop(columns=["q0", "q1", "q2", "q3"]).assign(
        **dict(zip(("roll", "pitch", "yaw"), angles.T, strict=True))
    )
    turned.loc[3, "pitch"] = np.nan
    body = {"shape": CUBOID, "mass": 0.1, "validate": False}
    assert table.read(turned, drop_incomplete=True, **body).impacts.incomplete == ("4",)


def test_a_spin_that_nobody_measured_is_that_of_the_moments():
    """A disc that does not spin before contact is read exactly without its spins and angle."""
    drops = synthetic.load(size=30, shape={"kind": "disc", "radius": 0.03})
    frame = drops.to_frame().assign(omega=0.0)
    P = drops.mass[:, None] * (drops.v_post - drops.v_pre)[:, :2]
    omega = (drops.r[:, 0] * P[:, 1] - drops.r[:, 1] * P[:, 0]) / drops.inertia
    missing = frame.drop(columns=["omega", "omega_post", "theta", "rx", "ry"])
    found = table.read(missing, shape=drops.shape)
    torch.testing.assert_close(found.impacts.v_post[:, 2], omega)
    torch.testing.assert_close(found.impacts.v_post[:, :2], drops.v_post[:, :2])
    assert not found.impacts.v_pre[:, 2].any()
    (note,) = (one for one in audit(found.impacts) if one.name == "consistent")
    assert "closes exactly" in note.sentence  # spins that were computed from the balance are no evidence for it
    assert "no evidence" in note.sentence
    # Columns that may be what is missing are asked for, as is the angle of another body.
    for other in ("spin rate [yd]", "angular"):
        with refused(["missing column", "omega"]):
            table.read(missing.assign(**{other: 1.0}), shape=drops.shape)
    with refused(["missing column theta"]):
        table.read(missing, shape={"kind": "ellipse", "semi_axes": [0.02, 0.01]})
    with refused(["missing column", "vx, vx_post"]):
        table.read(missing.drop(columns=["vx", "vx_post"]).assign(**{"horizontal [yd]": 1.0}), shape=drops.shape)


def in_space(last: bool, *, positive: bool = False, numbered: bool = True) -> tuple[pd.DataFrame, torch.Tensor]:
    """Cuboids that touch the floor at their lowest corner, with the quaternion's scalar first or last."""
    generator = torch.Generator().manual_seed(2)
    q = torch.nn.functional.normalize(torch.randn(25, 4, generator=generator, dtype=torch.float64), dim=1)
    q = q * q[:, :1].sign() if positive else q
    corners = torch.cartesian_prod(*(torch.tensor((-a, a), dtype=torch.float64) for a in (0.05, 0.03, 0.02)))
    w, v = q[:, :1], q[:, 1:]
    turned = corners + 2 * torch.linalg.cross(
        v[:, None].expand(-1, 8, -1),
        torch.linalg.cross(v[:, None].expand(-1, 8, -1), corners.expand(25, -1, -1)) + w[:, None] * corners,
    )
    frame = pd.DataFrame({"x": 0.0, "y": 0.0, "z": (-turned[..., 2].min(1).values).numpy()})
    order = [1, 2, 3, 0] if last else [0, 1, 2, 3]
    for k, component in enumerate(order):
        frame[f"q{k}" if numbered else f"q{'wxyz'[component]}"] = q[:, component].numpy()
    velocity = torch.randn(25, 6, generator=generator, dtype=torch.float64)
    velocity[:, 2] = -velocity[:, 2].abs() - 0.1
    for end, sign in (("", 1), ("_post", -0.5)):
        for k, name in enumerate(("vx", "vy", "vz", "wx", "wy", "wz")):
            frame[name + end] = sign * velocity[:, k].numpy() * (1 if name == "vz" or sign > 0 else -1)
    return frame, q


CUBOID = {"kind": "cuboid", "half": [0.05, 0.03, 0.02]}


def test_roll_pitch_and_yaw_are_turns_about_fixed_axes():
    frame = tossed(40).to_frame()
    turns = Rotation.from_quat(frame[["qx", "qy", "qz", "qw"]].to_numpy()).as_euler("xyz", degrees=True)
    angles = dict(zip(("roll [deg]", "pitch [deg]", "yaw [deg]"), turns.T, strict=True))
    found = table.read(frame.drop(columns=["qw", "qx", "qy", "qz"]).assign(**angles))
    there = table.read(frame).impacts.q[:, 3:]
    torch.testing.assert_close((found.impacts.q[:, 3:] * there).sum(-1).abs(), torch.ones(40).double())
    (said,) = [words for words in found.read_as if "roll" in words]
    assert said == "roll, pitch and yaw in deg, about the fixed axes x, y, z in this order"


@pytest.mark.parametrize("last", [False, True], ids=["first", "last"])
def test_the_scalar_of_a_numbered_quaternion_is_what_signs_or_heights_tell(tmp_path, last):
    for positive, shape in ((False, CUBOID), (True, {"kind": "sphere", "radius": 0.03})):
        frame, q = in_space(last, positive=positive)
        found = table.read(frame, shape=shape, mass=0.1, validate=False)
        torch.testing.assert_close(found.impacts.q[:, 3:], q, rtol=0, atol=1e-15)
        assert any(f"the scalar is {'last' if last else 'first'}" in part for part in found.read_as)
    frame, q = in_space(last)
    for one in (frame, frame.assign(z=0.03)):  # of a sphere, whose heights differ by rounding only
        with refused(["may be first, 'data.columns={qw: q0, qx: q1", "or last, 'data.columns={qx: q0, qy: q1"]):
            table.read(one, shape={"kind": "sphere", "radius": 0.03}, mass=0.1, validate=False)
    stated = dict(
        zip(("qx", "qy", "qz", "qw") if last else ("qw", "qx", "qy", "qz"), ("q0", "q1", "q2", "q3"), strict=True)
    )
    found = table.read(frame, columns=stated, shape={"kind": "sphere", "radius": 0.03}, mass=0.1, validate=False)
    torch.testing.assert_close(found.impacts.q[:, 3:], q, rtol=0, atol=1e-15)
    frame.to_csv(tmp_path / "a.csv", index=False)
    assert any("scalar is first or last" in part for part in propose(tmp_path / "a.csv").read_as)


def test_init_knows_a_table_in_space(tmp_path):
    frame, _ = in_space(last=False, numbered=False)
    frame.to_csv(tmp_path / "a.csv", index=False)
    found = propose(tmp_path / "a.csv")
    assert (found.source, found.unused) == ("table", ())
    assert [one.name for one in found.settings if one.value == "???"] == ["mass", "shape"]


def test_init_to_verdict_in_three_commands(tmp_path, frame, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = [name.replace("_post", "'") + (" [rpm]" if name.startswith("omega") else "") for name in frame]
    rpm = frame.assign(omega=30 / math.pi * frame.omega, omega_post=30 / math.pi * frame.omega_post)
    Path("drops.txt").write_text(text(rpm, ";", ",", names), "utf-8")
    said = run("contactlearn", "init", "drops.txt", "--name", "mydata", cwd=".")
    assert "read as: semicolons, decimal commas" in said
    shape = "data.shape={kind: ellipse, semi_axes: [0.035, 0.025]}"
    printed = run("contactlearn", "audit", "data=mydata", "data.mass=0.0364", shape, cwd=".")
    assert "30 impacts" in printed
    assert "wrong" not in printed
    direct = run("contactlearn", "audit", "drops.txt", "data.mass=0.0364", shape, cwd=".")
    assert "read as: semicolons; decimal commas; omega is 'omega [rpm]' in rev/min" in direct
    said = [[line for line in one.splitlines()[2:] if not line.startswith("next:")] for one in (direct, printed)]
    assert said[0] == said[1]


def test_a_file_of_tum_poses_is_a_recording(tmp_path):
    path = tmp_path / "take.txt"
    path.write_text("".join(f"{k / 100} 0 0 1 0 0 0 1\n" for k in range(20)))
    assert propose(path).source == "tracks"
    path.write_text("".join(f"{k / 100};0;0\n" for k in range(20)))
    with pytest.raises(DataError, match="its first line must name the columns"):
        propose(path)


COMMENTS = {
    "sentences": ("lengths in mm, velocities in mm/s, angles in deg, angular rates in deg/s, mass 36.4 g",),
    "a list of units": ("units: mm, mm/s, deg and deg/s",),
    "columns by name": ("x and y in mm; vx, vy, vx_post, vy_post: mm/s", "theta (deg), omega, omega_post [deg/s]"),
}


@pytest.mark.parametrize("comments", COMMENTS.values(), ids=COMMENTS)
def test_comments_above_the_header_state_units(tmp_path, frame, comments):
    factors = {"x": 1e3, "y": 1e3, "vx": 1e3, "vy": 1e3, "theta": 180 / math.pi, "omega": 180 / math.pi}
    written = frame.assign(**{name: frame[name] * factors[name.removesuffix("_post")] for name in COLUMNS})
    path = tmp_path / "drops.csv"
    path.write_text("# camera 2, 1000 fps\n" + "".join(f"# {line}\n" for line in comments) + text(written))
    found = table.read(path, **BODY)
    np.testing.assert_allclose(numbers(found.impacts), frame, rtol=1e-9)
    assert "units as the comments above the header state them" in found.read_as
    mapped = table.read(path, **BODY, columns={"vx": "vx"})  # by its name in the file
    np.testing.assert_allclose(numbers(mapped.impacts), frame, rtol=1e-9)


@pytest.mark.parametrize("comment", ["lengths in mm, lengths in cm", "everything was measured in mm by hand"])
def test_comments_with_units_that_are_not_read_are_said(tmp_path, frame, comment):
    path = tmp_path / "drops.csv"
    path.write_text(f"# {comment}\n" + text(frame))
    found = table.read(path, **BODY)
    np.testing.assert_allclose(numbers(found.impacts), frame, rtol=ROUNDING)
    assert f"comments mention units, and are not read: {comment!r}" in found.read_as


@pytest.mark.parametrize("comment", ["all in SI: m, s", "ellipse 70 mm x 50 mm, 36 g", "3 May, run 2"])
def test_other_comments_are_passed_over(tmp_path, frame, comment):
    path = tmp_path / "drops.csv"
    path.write_text(f"# {comment}\n" + text(frame))
    assert [*table.read(path, **BODY).read_as] == ["1 comment line above the header"]


@pytest.mark.parametrize("name", ["drop", "Shot", "run nr", "#", "test_id", "No."])
def test_a_column_of_numbers_of_trials_names_them(tmp_path, frame, name):
    named = frame.assign(**{name: range(61, 91)}).iloc[::-1]
    assert table.read(named, **BODY).impacts.trial[0] == "90"
    grouped = frame.assign(**{name: [k // 10 for k in range(30)]})
    assert table.read(grouped, **BODY).impacts.trial[0] == "1"
    path = tmp_path / "drops.csv"
    named.to_csv(path, index=False)
    assert {one.name: one.value for one in propose(path).settings}["columns.trial"] == name


CHANGES = {
    "suffixes": ("dvx_ms", "dvy_ms", "dw_rads"),
    "Greek": ("Δvx [mm/s]", "Δvy [mm/s]", "Δω (deg/s)"),
    "words": ("change of vx", "vy change", "delta_omega [rpm]"),
    "underscores": ("dv_x", "delta_v_y", "d_omega"),
}


@pytest.mark.parametrize("names", CHANGES.values(), ids=CHANGES)
def test_changes_of_velocities(tmp_path, frame, names):
    changes = frame.drop(columns=["vx_post", "vy_post", "omega_post"])
    units = {"mm/s": 1e-3, "deg/s": math.pi / 180, "rpm": math.pi / 30}
    for column, name in zip(("vx", "vy", "omega"), names, strict=True):
        factor = next((factor for unit, factor in units.items() if unit in name), 1.0)
        changes[name] = (frame[f"{column}_post"] - frame[column]) / factor
    path = tmp_path / "drops.csv"
    changes.to_csv(path, index=False)
    found = table.read(path, **BODY)
    np.testing.assert_allclose(numbers(found.impacts), frame, rtol=0, atol=1e-9)
    assert any("those before it and the changes" in part for part in found.read_as)
    settings = {one.name: one.value for one in propose(path).settings}  # with what init writes, it is the same table
    columns = {name.removeprefix("columns."): one for name, one in settings.items() if name.startswith("columns.")}
    np.testing.assert_allclose(numbers(table.read(path, **BODY, columns=columns).impacts), frame, rtol=0, atol=1e-9)
    with_errors = frame.assign(**{names[0]: 0.01})  # beside all velocities, these are something else
    assert table.read(with_errors, **BODY).unused == (names[0],)
    backwards = changes.drop(columns=["vx", "vy", "omega"]).assign(**frame[["vx_post", "vy_post", "omega_post"]])
    np.testing.assert_allclose(numbers(table.read(backwards, **BODY).impacts), frame, rtol=0, atol=1e-9)


def test_changes_beside_velocities_that_settings_name(tmp_path, frame):
    changes = frame.drop(columns=["vx_post", "vy_post", "omega_post", "vy"])
    changes["drop [mm/s]"] = 1e3 * frame["vy"]
    for column in ("vx", "vy", "omega"):
        changes[f"delta {column}"] = frame[f"{column}_post"] - frame[column]
    path = tmp_path / "drops.csv"
    changes.to_csv(path, index=False)
    found = table.read(path, **BODY, columns={"vy": "drop [mm/s]"}, units={"length": "m"})
    np.testing.assert_allclose(numbers(found.impacts), frame, rtol=0, atol=1e-9)


def test_units_written_as_one_word():
    known = recognise(["vx_ms", "w_rads", "I_kgm2", "vy_mms", "m_kg"], impact_vocabulary(PLANE))
    assert {*known.names} == {"vx", "omega", "inertia", "vy", "mass"}
    assert known.units["vy"] == {"length": "mm", "time": "s"}
    assert known.units["inertia"] == {"mass": "kg", "length": "m"}


MOMENTA = {
    "letters": ("p_x", "p_y", "L", "p_x_post", "p_y_post", "L_post"),
    "words": (
        *("momentum x before [kg m/s]", "momentum y before [kg m/s]", "angular momentum before [kg m²/s]"),
        *("momentum x after [kg m/s]", "momentum y after [kg m/s]", "angular momentum after [kg m²/s]"),
    ),
    "units": ("px- (g mm/s)", "py- (g mm/s)", "L- (N m s)", "px+ (g mm/s)", "py+ (g mm/s)", "L+ (N m s)"),
}


@pytest.mark.parametrize("names", MOMENTA.values(), ids=MOMENTA)
def test_momenta_in_place_of_velocities(tmp_path, frame, names):
    inertia = 1.7e-5
    momenta = frame[["x", "y", "theta"]].copy()
    for column, name in zip(COLUMNS[3:], names, strict=True):
        turning = column.startswith("omega")
        momenta[name] = frame[column] * (inertia if turning else BODY["mass"] * (1e6 if "(g mm/s)" in name else 1))
    path = tmp_path / "drops.csv"
    momenta.to_csv(path, index=False)
    found = table.read(path, **BODY, inertia=inertia)
    np.testing.assert_allclose(numbers(found.impacts), frame, rtol=0, atol=1e-9)
    assert any("velocities by the momenta" in part for part in found.read_as)
    table.read(path, **BODY)  # with the moment of inertia of the shape
    with refused([f"{path}: {names[0]!r} looks like a momentum", "data.mass=…"]):
        table.read(path, shape=SHAPE)
    assert propose(path).source == "table"


@pytest.mark.parametrize(
    ("perpendicular", "parallel"),
    [
        ("v_perp", "v_par"), ("vn", "vt"), ("v_n", "v_t"), ("normal velocity", "tangential velocity"),
        ("velocity perpendicular to the wall", "velocity along the wall"), ("v_norm", "v_tan"),
        ("speed towards the plate", "speed parallel to the plate"), ("v (normal)", "v (parallel)"),
    ],
)  # fmt: skip
def test_components_along_the_normal_and_the_surface(frame, perpendicular, parallel):
    names = {
        "vx": f"{parallel} in",
        "vy": f"{perpendicular} in",
        "vx_post": f"{parallel} out",
        "vy_post": f"{perpendicular} out",
    }
    found = table.read(frame.rename(columns=names), **BODY)
    np.testing.assert_allclose(numbers(found.impacts), frame, rtol=ROUNDING)


BALL = {"shape": {"kind": "disc", "radius": 0.02}, "mass": 0.0027}


def leaning(frame: pd.DataFrame, tilt: np.ndarray, face: float) -> pd.DataFrame:
    """Velocities in room axes of a surface whose normal is at so many rad, row by row, and a name for its tilt."""
    turn, there = face + tilt - math.pi / 2, frame[["omega", "omega_post"]].copy()
    for time in ("", "_post"):
        vx, vy = frame[f"vx{time}"], frame[f"vy{time}"]
        there[f"vx{time}"], there[f"vy{time}"] = (
            vx * np.cos(turn) - vy * np.sin(turn), vx * np.sin(turn) + vy * np.cos(turn)
        )  # fmt: skip
    return there


@pytest.mark.parametrize("name", ["paddle tilt (deg)", "face angle [deg]", "tilt_deg", "incline of the floor (deg)"])
@pytest.mark.parametrize(("face", "said"), [(0.0, "+x"), (math.pi / 2, "+y"), (-math.pi, "−x")])
def test_a_surface_that_leans_differently_in_each_row(frame, name, face, said):
    tilt = np.random.default_rng(0).uniform(-0.2, 0.3, len(frame))
    there = leaning(frame, tilt, face).assign(**{name: np.degrees(tilt)})
    found = table.read(there, **BALL)
    np.testing.assert_allclose(numbers(found.impacts)[:, 3:], frame[[*COLUMNS[3:]]], rtol=0, atol=1e-9)
    assert any(repr(name) in part and part.endswith(f"its normal at 0 is {said}") for part in found.read_as)
    ball = frame.assign(omega_post=frame.omega + 75 * (frame.vx_post - frame.vx))  # of a moment of inertia of 2/3 m R²
    clockwise = leaning(ball, tilt, face).assign(**{name: -np.degrees(tilt)})
    found = table.read(clockwise, **BALL)
    np.testing.assert_allclose(numbers(found.impacts)[:, 3:], ball[[*COLUMNS[3:]]], rtol=0, atol=1e-9)
    assert any(f"{name!r}, positive clockwise" in part for part in found.read_as)
    turned = there.assign(theta=tilt + face - math.pi / 2)
    np.testing.assert_allclose(table.read(turned, **BALL).impacts.q[:, 2].cos().numpy(), 1, rtol=ROUNDING)
    assert table.read(turned.assign(**{name: 5.0}), **BALL, validate=False).unused == (
        name,
    )  # one angle is the audit's
    across = turned.rename(columns={"vx": "v_t", "vy": "v_n", "vx_post": "v_t after", "vy_post": "v_n after"})
    assert table.read(across, **BALL, validate=False).unused == (name,)  # in axes of the surface already
    for wrong in (there.assign(x=0.1), there.assign(vx=0.0, vy=0.0)):
        with refused([repr(name), "differs from row to row", "data.covariates"]):
            table.read(wrong, **BALL)


def test_a_spin_that_may_be_measured_is_asked_for(tmp_path, frame):
    names = ["topspin in (rev/s)", "spin rate (rpm)", "rotation before (deg/s)", "rotation speed"]
    foreign = ["effet avant (tr/min)", "Drall vor (U/min)", "efecto antes (rpm)", "effetto prima (giri/min)"]
    for name in foreign:
        assert recognise([name], impact_vocabulary(PLANE)).names == {"omega": name}
    for name in names:
        assert {*recognise([name], impact_vocabulary(PLANE)).names} <= {"omega"}
    for name in ("rotation före (varv/min)", "rotatie voor (omw/min)", "obroty przed (obr/min)"):
        assert unit_in(name, "omega", impact_vocabulary(PLANE)) == {"angle": "rev", "time": "min"}
    for name in ("momento d'inerzia [kg mm²]", "moment d'inertie (kg mm²)", "Trägheitsmoment (kg mm²)"):
        assert recognise([name], impact_vocabulary(PLANE)).names == {"inertia": name}
    spun = frame.drop(columns=["theta", "omega", "omega_post"]).assign(sidespin=frame.omega, sidespin2=0.0)
    path = tmp_path / "drops.csv"
    spun.to_csv(path, index=False)
    with refused(["missing column omega", "sidespin"]):
        table.read(path, **BALL)
    settings = {one.name: one for one in propose(path).settings}
    assert settings["units.angle"].value is None  # no column is an angle yet: the one to be named may say its unit
    with refused(["missing column omega", "'side (tr/min)'"]):  # by its unit
        table.read(spun.drop(columns="sidespin2").rename(columns={"sidespin": "side (tr/min)"}), **BALL)
    spun = spun.rename(columns={"sidespin": "side in (rev/s)"}).drop(columns="sidespin2")
    columns = {"omega": "side in (rev/s)", "omega_post": "side in (rev/s) "}
    found = table.read(spun.assign(**{columns["omega_post"]: 1.0}), columns=columns, units={"angle": None}, **BALL)
    assert found.impacts.v_pre[0, 2].item() == pytest.approx(2 * math.pi * frame.omega[0])


def pasted(frame: pd.DataFrame, rows: int = 12) -> str:
    """The table as a reader of a PDF copies it: a title, errors, and after some rows a new page."""
    header = "No.  " + "  ".join(
        ("θ (rad)", "vx1 (m/s)", "vy1 (m/s)", "ω1 (rad/s)", "vx2 (m/s)", "vy2 (m/s)", "ω2 (rad/s)")
    )
    values = [[f"{x!r} ± 0.02".replace("-", "−") for x in row] for row in frame[[*COLUMNS[2:]]].to_numpy().tolist()]
    lines = ["  ".join([f"{k}{'a' * (k == 3)}", *row]) for k, row in enumerate(values, 1)]
    page = ["", "413    Am. J. Exp. Mech., Vol. 12, No. 3", "", "Table 2. (continued)", header]
    title = "Table 2. Bounces (m = 36.4 g). Errors are one standard error."
    return "\n".join([title, "", header, *lines[:rows], *page, *lines[rows:], "a Ball cleaned before this bounce.", ""])


def test_a_table_out_of_a_pdf_has_columns_parted_by_two_blanks(tmp_path, frame):
    path = tmp_path / "table.txt"
    path.write_text(pasted(frame), "utf-8")
    found = table.read(path, **BODY)
    np.testing.assert_allclose(numbers(found.impacts)[:, 2:], frame[[*COLUMNS[2:]]], rtol=ROUNDING)
    assert found.read_as[0] == "columns parted by two or more blanks"
    assert any("left out 4 rows" in part and "Am. J. Exp. Mech." in part for part in found.read_as)


INDEXED = {
    "suffix": ("vx1", "vy1", "ω1 [rad/s]", "vx2", "vy2", "ω2 [rad/s]"),
    "infix": ("v1x", "v1y", "w1", "v2x", "v2y", "w2"),
    "letters": ("v_ix (m/s)", "v_iy (m/s)", "omega_i", "v_fx (m/s)", "v_fy (m/s)", "omega_f"),
    "letters last": ("vxi", "vyi", "ωi", "vxf", "vyf", "ωf"),
}


@pytest.mark.parametrize("names", INDEXED.values(), ids=INDEXED)
def test_an_index_says_before_and_after_where_both_stand(frame, names):
    there = frame.set_axis([*COLUMNS[:3], *names], axis=1)
    np.testing.assert_allclose(numbers(table.load(there, **BODY)), frame, rtol=ROUNDING)
    known = recognise([*names[:3], *names[3:5]], impact_vocabulary(PLANE)).names
    assert "vx_post" not in known  # without ω2, the indices may be of something else
    of_bodies = recognise(["m1", "m2", *names], impact_vocabulary(PLANE)).names
    assert "vx_post" not in of_bodies or "1" not in "".join(names)


def test_output_of_fortran(tmp_path, frame):
    names, path = [*COLUMNS], tmp_path / "fort21.dat"
    rows = ["".join(f"{x * (1 if name in ('theta', 'omega', 'omega_post') else 100):14.6E}".replace("E", "D")
                    for name, x in zip(names, row, strict=True)) for row in frame.to_numpy().tolist()]  # fmt: skip
    rows[4] = rows[4][:-14] + 14 * "*"
    above = [
        "C     DROPS OF 1988   M=0.0364 KG",
        "C     CGS UNITS: CM, CM/S, RAD, RAD/S",
        "C   N " + " ".join(names).upper(),
    ]
    path.write_text("\n".join([*above, *(f"{k:5}{row}" for k, row in enumerate(rows, 1))]), "ascii")
    found = table.read(path, **BODY, drop_incomplete=True)
    np.testing.assert_allclose(numbers(found.impacts), frame.drop(index=4), rtol=1e-6)
    assert found.impacts.incomplete == ("5",)
    assert "names in the last comment" in found.read_as
    path.write_text(path.read_text().replace("C   N X", "C   N X 2"))
    with refused(["row 1 (line 2)", "C DROPS OF 1988"]):
        table.read(path, **BODY)


def test_the_height_of_a_known_shape_needs_no_column(frame):
    there = frame.drop(columns=["x", "y"]).assign(**{"Drop height [m]": 1.0})
    found = table.read(there, **BODY)
    assert {"r", "height"} <= {*found.computed}
    assert found.unused == ("Drop height [m]",)
    torch.testing.assert_close(found.impacts.q[:, 1], -found.impacts.r[:, 1])
    with refused(["missing column y"]):
        table.read(there.assign(rx=0.0, ry=-0.03), **BODY)


@pytest.mark.parametrize("name", ["COR", "restitution coefficient (%)", "e_n", "e (–)", "ε [-]"])
def test_a_drop_height_and_a_coefficient_of_restitution_are_bounces(tmp_path, name):
    rows = [(40, 38.2, 21.5), (100, 47.8, 45.7), (20, 34.2, 20.7)]
    plain = name[0] in "eε"
    e = "{:.3f}" if plain else "{:.1f}" if "%" in name else "{:.1f}%"
    scale = 0.01 if plain else 1
    lines = [f'#{k},"{h}""",{t} °C,{e.format(scale * c)}' for k, (h, c, t) in enumerate(rows, 1)]
    path = tmp_path / "squash.csv"
    path.write_text("\n".join([f"Ball,Drop height,Temp.,{name}", *lines]), "utf-8")
    found = table.read(path, **BALL, covariates=["Temp."])
    speed = np.sqrt(2 * GRAVITY * 0.0254 * np.array([h for h, *_ in rows]))
    np.testing.assert_allclose(found.impacts.v_pre[:, 1].numpy(), -speed, rtol=ROUNDING)
    np.testing.assert_allclose(found.impacts.v_post[:, 1].numpy(), [c / 100 for _, c, _ in rows] * speed, rtol=ROUNDING)
    assert found.impacts.covariates["temp"].tolist() == [t for *_, t in rows]
    assert {"'Temp.' in °C, as its cells say", "'Drop height' in in, as its cells say"} <= {*found.read_as}
    assert propose(path).source == "table"
    path.write_text(path.read_text("utf-8").replace("%", ""), "utf-8")
    if name == "COR":
        with refused(["'COR' is up to 47.8", "per cent", "no ratio of heights"]):
            table.read(path, **BALL)


@pytest.mark.parametrize(("rotation", "sign"), [("counterclockwise", 1), ("clockwise", -1)])
def test_the_sense_of_topspin_is_said_as_it_is_stated(frame, rotation, sign):
    there = frame.rename(columns={"omega": "topspin", "omega_post": "topspin after"})
    found = table.read(there, units={"rotation": rotation}, **BODY)
    assert f"omega is 'topspin' in rad/s, positive {rotation.replace('counterc', 'counter-c')}" in found.read_as
    torch.testing.assert_close(found.impacts.v_pre[:, 2], sign * torch.tensor(frame.omega.to_numpy()))


def test_a_coefficient_of_restitution_is_no_velocity(tmp_path):
    """As a paper has it: means of restitution at some speeds, which settings name by any column."""
    path = tmp_path / "table3.csv"
    rows = "\n".join(f"steel;{v};0.{90 - k} ± 0.012;10" for k, v in enumerate((0.5, 1.0, 2.0)))
    path.write_text(f"Material;v_i (m/s);e (–);n\n{rows}\n", "utf-8")
    found = table.read(path, **BALL)
    np.testing.assert_allclose(found.impacts.v_post[:, 1].numpy(), [0.45, 0.89, 1.76], rtol=ROUNDING)
    path.write_text(f"Material;u (m/s);Rückgabe;n\n{rows}\n", "utf-8")
    named = table.read(path, **BALL, columns={"speed": "u (m/s)", "restitution": "Rückgabe"})
    torch.testing.assert_close(named.impacts.v_post, found.impacts.v_post)
    path.write_text(f"Material;u (m/s);e (–);n\n{rows}\n", "utf-8")
    with refused(["'data.columns={restitution: \"e (–)\"}'", "no velocity"]):
        table.read(path, **BALL, columns={"vy": "u (m/s)", "vy_post": "e (–)"})


def test_numbers_that_cannot_be_groups_are_no_covariate(frame):
    there = frame.assign(temperature=[f"{20 + k} °C" for k in range(len(frame))])
    assert table.load(there, **BODY, covariates=["temperature"]).covariates["temperature"][1].item() == 21
    with refused(["'temperature' has 30 names in 30 rows", "20 °C warm"]):
        table.read(
            there.assign(temperature=there.temperature + [" warm", " cold"] * 15), **BODY, covariates=["temperature"]
        )


def test_texts_with_decimal_commas_in_spreadsheets_and_frames(tmp_path, frame):
    commas = frame.map(lambda x: f"{x!r}".replace(".", ","))
    commas["theta"] = frame.theta  # a spreadsheet keeps numbers that were typed as its own language has them
    commas.to_excel(tmp_path / "drops.xlsx", index=False)
    commas.to_json(tmp_path / "drops.json", orient="records")
    for source in (tmp_path / "drops.xlsx", tmp_path / "drops.json", commas):
        np.testing.assert_allclose(numbers(table.load(source, **BODY)), frame, rtol=ROUNDING)
    assert "decimal commas" in table.read(tmp_path / "drops.xlsx", **BODY).read_as
    mixed = commas.assign(vy=frame.vy.map(repr), vx=["1,25", "2,25"] * 15)
    mixed.to_excel(tmp_path / "mixed.xlsx", index=False)
    for reading in (lambda: table.read(tmp_path / "mixed.xlsx", **BODY), lambda: propose(tmp_path / "mixed.xlsx")):
        with refused(["column x", "a decimal comma?", "30 rows of the column are like this one"]):
            reading()


@pytest.mark.parametrize("suffix", [".mat", ".npz"])
def test_arrays_of_a_table_of_impacts(tmp_path, suffix):
    from scipy.io import savemat

    drops, path = synthetic.load(size=30), tmp_path / f"drops{suffix}"
    arrays = {
        "mass_g": 1e3 * drops.mass[0].item(), "th": drops.q[:, 2:].numpy(), "vi": drops.v_pre.numpy(),
        "vf": drops.v_post.numpy(), "contact_mm": 1e3 * drops.r.T.numpy(),
    }  # fmt: skip
    savemat(path, {"drops": {**arrays, "comment": "of 1988"}}) if suffix == ".mat" else np.savez(path, **arrays)
    found = table.read(path, shape=SHAPE, units={"length": "m"})
    for read, there in ((found.impacts.v_pre, drops.v_pre), (found.impacts.v_post, drops.v_post)):
        torch.testing.assert_close(read, there, rtol=ROUNDING, atol=0)
    torch.testing.assert_close(found.impacts.r, drops.r, rtol=ROUNDING, atol=ROUNDING)
    assert "'vf' holds vx_post, vy_post, omega_post" in found.read_as
    assert propose(path).source == "table"
    np.savez(tmp_path / "none.npz", a=np.zeros(3), b=np.zeros(4))
    with refused(["no table of impacts", "it has a, b", "as CSV"]):
        table.read(tmp_path / "none.npz", **BODY)


def test_arrays_with_a_column_an_impact(tmp_path):
    """Which way round arrays are is said; of three impacts in a plane it is not seen."""
    from scipy.io import savemat

    for rows in (30, 3):
        drops, path = synthetic.load(size=rows), tmp_path / f"drops_{rows}.mat"
        fields = {"pose": drops.q, "v_pre": drops.v_pre, "v_post": drops.v_post}
        savemat(path, {"S": {name: one.T.numpy() for name, one in fields.items()}})
        if rows == 3:
            for reading in (lambda: table.read(path, mass=1, shape=SHAPE), lambda: propose(path)):  # noqa: B023
                with refused(["'pose' is 3 × 3", "may be rows or columns"]):
                    reading()
            continue
        found = table.read(path, mass=1, shape=SHAPE)
        torch.testing.assert_close(found.impacts.v_post, drops.v_post, rtol=ROUNDING, atol=0)
        assert "a column an impact in 'pose', 'v_pre', 'v_post'" in found.read_as
        savemat(path, {"S": {name: one.numpy() for name, one in fields.items()}})
        assert not any("a column an impact" in said for said in table.read(path, mass=1, shape=SHAPE).read_as)


def test_columns_that_two_descriptions_name_are_refused(tmp_path, frame):
    """Components of a vector beside columns of their names, and names that stand twice in the header."""
    vectors = [f"[{x} {y}]" for x, y in zip(frame.vx, frame.vy, strict=True)]
    frame.assign(velocity=vectors).to_csv(tmp_path / "vectors.csv", index=False)
    (tmp_path / "twice.csv").write_text(frame.assign(again=frame.vx).to_csv(index=False).replace("again", "vx"))
    for name in ("vectors.csv", "twice.csv"):
        with refused(["column names must be unique; repeated: 'vx'"]):
            table.read(tmp_path / name, **BODY)
    unused = frame.assign(a="x", b="y").to_csv(index=False).replace(",a,b", ",note,note")
    (tmp_path / "notes.csv").write_text(unused)
    np.testing.assert_allclose(numbers(table.load(tmp_path / "notes.csv", **BODY)), frame, rtol=ROUNDING)


def test_a_pointer_of_git_lfs_is_no_table(tmp_path):
    path = tmp_path / "drops.csv"
    path.write_text("version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 812345\n")
    with refused(["is a pointer of Git LFS", "git lfs pull"]):
        propose(path)


@pytest.mark.parametrize("kind", ["one table", "before and after", "beside settings"])
def test_groups_of_hdf5_are_tables_of_impacts(tmp_path, frame, kind):
    """With units in attributes; several tables are refused with their names."""
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "drops.h5"

    def write(group, ends):
        for end, columns in ends.items():
            v = group.create_dataset(f"velocity{end}", data=1e3 * frame[[*columns[:2]]].to_numpy())
            group.create_dataset(f"omega{end}", data=np.degrees(frame[columns[2]])).attrs["unit"] = "deg/s"
            v.attrs["units"] = "mm/s"

    before, after = COLUMNS[3:6], COLUMNS[6:]
    with h5py.File(path, "w") as file:
        file["theta"] = frame.theta
        file["position"] = frame[["x", "y"]]
        file["position"].attrs["units"] = "m"
        if kind == "before and after":
            write(file.create_group("before"), {"": before})
            write(file.create_group("after"), {"": after})
        else:
            group = file if kind == "one table" else file.create_group("impacts")
            write(group, {"_pre": before, "_post": after})
            if kind == "beside settings":
                file.move("theta", "impacts/theta")
                file.move("position", "impacts/position")
                file.create_group("camera")["rate"] = np.arange(3.0)
    found = table.read(path, units={"length": "m", "angle": "rad"}, **BODY)
    np.testing.assert_allclose(numbers(found.impacts), frame, rtol=1e-9, atol=1e-12)
    assert propose(path).source == "table"
    with h5py.File(path, "w") as file:
        for name in ("first", "second"):
            write(file.create_group(name), {"_pre": before, "_post": after})
    with refused(["has several tables of impacts, first, second"]):
        table.read(path, **BODY)


def test_structures_of_matlab_are_impacts(tmp_path, frame):
    """An impact each, with a structure of settings beside them."""
    from scipy.io import savemat

    records = [
        {
            "pre": {"vx": r.vx, "vy": r.vy, "omega": r.omega},
            "post": {"vx": r.vx_post, "vy": r.vy_post, "omega": r.omega_post},
            "pose": [r.x, r.y, r.theta],
        }
        for r in frame.itertuples()
    ]
    dtype = [(name, object) for name in records[0]]
    made = np.array([tuple(one.values()) for one in records], dtype=dtype)
    savemat(tmp_path / "drops.mat", {"impacts": made, "setup": {"fps": 500.0, "floor": "steel"}})
    found = table.read(tmp_path / "drops.mat", **BODY)
    np.testing.assert_allclose(numbers(found.impacts), frame, rtol=ROUNDING, atol=0)
    values = frame[[*COLUMNS]].to_numpy()
    made = [(float(k), row[:3], row[3:6], row[6:]) for k, row in enumerate(values, 1)]
    dtype = [(name, object) for name in ("id", "q_minus", "v_minus", "v_plus")]
    savemat(tmp_path / "signs.mat", {"trials": np.array(made, dtype=dtype), "params": {"m": 0.2, "a": 0.08}})
    found = table.read(tmp_path / "signs.mat", **BODY)
    np.testing.assert_allclose(numbers(found.impacts), frame, rtol=ROUNDING, atol=0)
    assert propose(tmp_path / "signs.mat").source == "table"


HEIGHTS = np.array([[0.9, 0.5, 0.3, 0.2], [1.0, 0.6, 0.4, np.nan]])


@pytest.mark.parametrize("kind", ["heights", "cm", "bounces"])
def test_a_running_number_makes_a_chain(tmp_path, kind):
    """Each neighbouring pair of flights of a run is an impact; times of bounces are in between."""
    times = np.sqrt(8 * HEIGHTS / GRAVITY)
    values, names = {
        "heights": (HEIGHTS, "Height {} (m)"),
        "cm": (100 * HEIGHTS, "h{} [cm]"),
        "bounces": (np.cumsum(np.column_stack([[0.4, 0.7], times]), 1), "Bounce {} (s)"),
    }[kind]
    frame = pd.DataFrame(values, columns=[names.format(k + 1) for k in range(values.shape[1])])
    if kind == "bounces":
        frame = frame.join(pd.DataFrame(HEIGHTS, columns=[f"Height {k + 1} (m)" for k in range(4)]))
    frame.assign(drop=["a", "b"]).to_csv(tmp_path / "drops.csv", index=False)
    found = table.read(tmp_path / "drops.csv", shape={"kind": "disc", "radius": 0.02}, mass=0.1)
    speeds = np.sqrt(2 * GRAVITY * HEIGHTS)
    np.testing.assert_allclose(found.impacts.v_pre[:, 1], -speeds[[0, 0, 0, 1, 1], [0, 1, 2, 0, 1]])
    np.testing.assert_allclose(found.impacts.v_post[:, 1], speeds[[0, 0, 0, 1, 1], [1, 2, 3, 1, 2]])
    first = 1 + (kind == "bounces")
    assert found.impacts.trial == tuple(f"{drop}/{first + k}" for drop, n in (("a", 3), ("b", 2)) for k in range(n))
    said = " ".join(found.read_as)
    assert ("not used: 'Height 1 (m)' … 'Height 4 (m)'" in said) == (kind == "bounces")
    assert propose(tmp_path / "drops.csv").source == "table"
    frame.iloc[0, 2] = 0.1 * frame.iloc[0, 3]  # neither falls nor grows
    frame.iloc[:, : values.shape[1]].to_csv(tmp_path / "drops.csv", index=False)
    with refused(["drops.csv: "]):
        table.read(tmp_path / "drops.csv", shape={"kind": "disc", "radius": 0.02}, mass=0.1)


@pytest.mark.parametrize(
    "names",
    [
        ("q_{}", "v_minus_{}", "v_plus_{}"),
        ("pose({})", "v before({})", "v after({})"),
        ("q{}", "v_pre.{}", "v_post.{}"),
    ],
)
def test_numbered_components_before_and_after_are_impacts(tmp_path, frame, names):
    """As writetable of MATLAB and DataFrames split matrices; a column trial makes them no recordings."""
    header = [name.format(k + 1) for name in names for k in range(3)]
    frame.set_axis(header, axis=1).assign(trial=range(30)).to_csv(tmp_path / "impacts.csv", index=False)
    found = table.read(tmp_path / "impacts.csv", **BODY)
    np.testing.assert_allclose(numbers(found.impacts), frame)
    assert f"{header[3]!r}, {header[4]!r}, {header[5]!r} are vx, vy, omega" in found.read_as
    contents = propose(tmp_path / "impacts.csv")
    assert (contents.source, contents.unused) == ("table", ())


def test_families_before_and_after_are_no_recordings(tmp_path, frame):
    """Names that say nothing else: init and audit show the same table of probable meanings."""
    names = ["k1", "k2", "k3", *(f"{name} {when}" for when in ("minus", "plus") for name in ("pp", "qq", "rr"))]
    path = tmp_path / "impacts.csv"
    frame.set_axis(names, axis=1).assign(trial=range(30)).to_csv(path, index=False)
    told = list[list[str]]()
    for use in (propose, lambda path: table.read(path, **BODY)):
        with refused(["'qq minus'", "vy? turns its sign at contact: 'qq plus'"]) as caught:
            use(path)
        told.append(str(caught.value).splitlines()[1:])
    assert told[0] == told[1]


def vectors_in_space() -> tuple[pd.DataFrame, torch.Tensor]:
    frame, q = in_space(last=True)
    sets = {"pos": "xyz", "lin_vel_before": ("vx", "vy", "vz"), "ang_vel_before": ("wx", "wy", "wz"),
            "lin_vel_after": ("vx_post", "vy_post", "vz_post"), "ang_vel_after": ("wx_post", "wy_post", "wz_post"),
            "orn": ("q0", "q1", "q2", "q3")}  # fmt: skip
    return pd.DataFrame({name: frame[[*columns]].to_numpy().tolist() for name, columns in sets.items()}), q


@pytest.mark.parametrize("name", ["orn", "base_orn", "anything"])
def test_vectors_of_length_1_are_the_quaternion(name):
    frame, q = vectors_in_space()
    found = table.read(frame.rename(columns={"orn": name}), shape=CUBOID, mass=0.1, validate=False)
    torch.testing.assert_close(found.impacts.q[:, 3:], q, rtol=0, atol=1e-15)
    assert f"{name!r} holds q0, q1, q2, q3" in found.read_as


def test_a_setting_names_a_column_of_vectors():
    frame, q = vectors_in_space()
    frame = frame.rename(columns={"orn": "A", "lin_vel_after": "B [cm/s]"}).assign(C=1.0)
    frame["B [cm/s]"] = [[100 * v for v in row] for row in frame["B [cm/s]"]]
    body = {"shape": {"kind": "sphere", "radius": 0.03}, "mass": 0.1, "validate": False}
    units = {"length": "m", "time": "s"}
    found = table.read(frame, columns={"quaternion_xyzw": "A", "velocity_post": "B"}, units=units, **body)
    torch.testing.assert_close(found.impacts.q[:, 3:], q, rtol=0, atol=1e-15)
    there = table.read(vectors_in_space()[0], columns={"quaternion_xyzw": "orn"}, **body)
    torch.testing.assert_close(found.impacts.v_post, there.impacts.v_post)
    with refused(["data.columns.quaternion=C: that column has no vectors"]):
        table.read(frame, columns={"quaternion": "C"}, **body)


def test_what_is_in_space_lacks_a_quaternion(tmp_path):
    frame, _ = in_space(last=False)
    plain = frame.drop(columns=["q0", "q1", "q2", "q3"])
    body = {"shape": CUBOID, "mass": 0.1, "validate": False}
    for one in (plain, plain.drop(columns=["z", "vz", "vz_post"]), plain.drop(columns=["wx", "wy", "wz"])):
        with refused(["missing quaternion, body to world", "data.columns={quaternion_xyzw: …}"]):
            table.read(one, **body)
    with refused(["four columns are {qx: a, qy: b, qz: c, qw: d}, whose length is 1"]):
        table.read(frame.rename(columns={"q0": "a", "q1": "b", "q2": "c", "q3": "d"}), **body)
    plain.to_csv(tmp_path / "a.csv", index=False)
    opened = {one.name for one in propose(tmp_path / "a.csv").settings if one.value == "???"}
    assert opened == {"mass", "shape", *(f"columns.q{letter}" for letter in "wxyz")}


@pytest.mark.parametrize("unit", ["1/s", "s^-1", "s⁻¹", "Hz"])
def test_a_spin_in_1_per_s_is_asked_for(tmp_path, frame, unit):
    path = tmp_path / "drops.csv"
    names = {"omega": f"ω vor dem Stoß [{unit}]", "omega_post": f"ω nach dem Stoß [{unit}]"}
    frame.rename(columns=names).to_csv(path, index=False)
    with refused(["may be in rad/s or in rev/s", "unit: rad/s}, omega_post: {column: "]) as caught:
        table.read(path, **BODY)
    columns = yaml.safe_load(str(caught.value).split("data.columns=")[1].split("' or unit")[0])
    stated = {"length": "m", "time": "s", "angle": "rad"}
    np.testing.assert_allclose(numbers(table.read(path, columns=columns, units=stated, **BODY).impacts), frame)
    asked = {one.name: one.comment for one in propose(path).settings if one.value == "???"}
    assert f'{{column: "{names["omega"]}", unit: rad/s}}' in asked["columns.omega"]


def test_a_unit_of_cells_excludes_a_meaning(tmp_path, frame):
    path = tmp_path / "drops.csv"
    frame.assign(T=[f"{20 + k / 10} °C" for k in range(30)]).to_csv(path, index=False)
    found = table.read(path, **BODY)
    assert (found.impacts.time, found.unused) == (None, ("T [°C]",))
    warm = table.read(path, covariates=["T"], **BODY).impacts.covariates["t"]
    np.testing.assert_allclose(warm, 20 + np.arange(30) / 10)
    assert "columns.time" not in {one.name for one in propose(path).settings}


def test_init_writes_what_it_has_seen_and_asks_for_the_rest(tmp_path, frame, monkeypatch):
    monkeypatch.chdir(tmp_path)
    polar = frame[["omega", "omega_post"]].assign(ground=["clay", "grass", "carpet"] * 10)
    for end, when in (("", "in"), ("_post", "out")):
        polar[f"V {when} [km/h]"] = 3.6 * np.hypot(frame[f"vx{end}"], frame[f"vy{end}"])
        polar[f"Angle {when} [°]"] = np.degrees(np.arctan2(frame[f"vy{end}"].abs(), frame[f"vx{end}"]))
    polar.loc[[4, 6], "omega_post"] = np.nan
    polar.to_csv("rig.csv", index=False)
    said = run("contactlearn", "init", "rig.csv", "--name", "open", cwd=".")
    assert "fill in: mass, shape, columns.direction_floor, columns.direction_floor_post: " in said
    settings = yaml.safe_load(Path("open.yaml").read_text("utf-8"))
    assert (settings["covariates"], settings["correct"]) == (["ground"], ["drop_incomplete"])
    assert "a number is missing in row 5, 7" in Path("open.yaml").read_text("utf-8")
    words = [
        "data.columns={direction_floor: Angle in, direction_floor_post: Angle out}", "data.mass=0.05",
        "data.shape={kind: disc, radius: 0.03}", "data.units={angle: rad}",
    ]  # fmt: skip
    run("contactlearn", "init", "rig.csv", *words, "--name", "filled", cwd=".")
    assert "???" not in Path("filled.yaml").read_text("utf-8").split("\n", 2)[2]
    filled = yaml.safe_load(Path("filled.yaml").read_text("utf-8"))
    del filled["_target_"], filled["correct"]
    found = table.load(**filled, validate=False, drop_incomplete=True)
    whole = frame.drop(index=[4, 6])
    np.testing.assert_allclose(found.v_post, whole[["vx_post", "vy_post", "omega_post"]], atol=1e-12)
    assert found.covariates["ground"][:3] == ("clay", "grass", "carpet")
    with pytest.raises(AssertionError, match=r"init only takes data.KEY=…"):
        run("contactlearn", "init", "rig.csv", "model=all", "--name", "other", cwd=".")


@pytest.mark.parametrize("angle", ["入射角 (°)", "Угол отклонения, °"])
def test_speeds_beside_an_angle_in_degrees_are_not_along_the_normal(tmp_path, angle):
    """Whatever its language says."""
    path = tmp_path / "a.csv"
    rows = [f"{7 - k / 10},{6 - k / 10},{20 + k}" for k in range(12)]
    path.write_text("\n".join([f"speed before (m/s),speed after (m/s),{angle.replace(',', '')}", *rows]), "utf-8")
    with refused(["may be the direction of 'speed before (m/s)'"]):
        table.read(path, **BALL)
