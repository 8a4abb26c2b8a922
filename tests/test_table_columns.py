"""`data.columns` reads any table of a row an impact whose columns a person can name: units, senses and constants."""

import numpy as np
import pandas as pd
import pytest
import torch
from refusals import refused

from contactlearn.core.errors import UnknownNameError
from contactlearn.data import table
from contactlearn.mechanics.impacts import Impacts
from contactlearn.simulation import synthetic

SHAPE = {"kind": "ellipse", "semi_axes": [0.035, 0.025]}
NAMES = ("x", "y", "theta", "vx", "vy", "omega", "vx_post", "vy_post", "omega_post")


@pytest.fixture(scope="module")
def drops() -> pd.DataFrame:
    drops = synthetic.load(size=30)
    values = torch.cat((drops.q, drops.v_pre, drops.v_post), 1).numpy()
    return pd.DataFrame(values, columns=[*NAMES])


def check(found: Impacts, drops: pd.DataFrame) -> None:
    values = torch.cat((found.q, found.v_pre, found.v_post), 1).numpy()
    np.testing.assert_allclose(values, drops.to_numpy(), rtol=1e-12, atol=1e-14)


def foreign(drops: pd.DataFrame, **factors: float) -> pd.DataFrame:
    """Drops under names that say nothing, some of them in other units or senses."""
    scaled = drops.assign(**{name: drops[name] * factor for name, factor in factors.items()})
    return scaled.set_axis([f"c{k}" for k in range(1, 10)], axis=1)


PLAIN = {name: f"c{k}" for k, name in enumerate(NAMES, 1)}
RPM = 60 / (2 * np.pi)


@pytest.mark.parametrize(
    ("factors", "columns"),
    [
        ({}, {}),
        ({"vx": 3.6, "vx_post": 3.6}, {"vx": {"column": "c4", "unit": "km/h"},
                                       "vx_post": {"column": "c7", "unit": "km/h"}}),
        ({"x": 1e3, "y": 100}, {"x": {"column": "c1", "unit": "mm"}, "y": {"column": "c2", "unit": "cm"}}),
        ({"omega": RPM, "omega_post": -RPM}, {"omega": {"column": "c6", "unit": "rpm"},
                                              "omega_post": {"column": "c9", "unit": "rev/min", "factor": -1}}),
        ({"vy": -1}, {"vy": {"column": "c5", "factor": -1}}),
        ({"theta": -180 / np.pi}, {"theta": {"column": "c3", "unit": "deg", "factor": -1}}),
        ({"vy_post": 500}, {"vy_post": {"column": "c8", "factor": 0.002}}),
    ],
    ids=["names", "km/h", "mm and cm", "rpm", "downwards", "clockwise degrees", "counts"],
)  # fmt: skip
def test_each_column_has_its_unit_and_sense(drops, factors, columns):
    stated = {name: one for name, one in columns.items() if isinstance(one, dict) and "unit" in one}
    si = {"x": "m", "y": "m", "theta": "rad", "vx": "m/s", "vy": "m/s", "omega": "rad/s"}
    plain = {
        name: {"column": PLAIN[name], "unit": si[name.removesuffix("_post")]} for name in (NAMES if stated else ())
    }
    for name, one in columns.items():
        plain[name] = {"unit": si[name.removesuffix("_post")], **one} if stated else one
    found = table.read(foreign(drops, **factors), columns={**PLAIN, **plain}, shape=SHAPE, mass=0.0364)
    check(found.impacts, drops)
    for one in columns.values():
        if "factor" in one:
            assert f"'{one['column']}' times {one['factor']:g}" in found.read_as


def test_one_number_may_hold_for_all_rows(drops):
    constant = drops.assign(theta=np.pi / 2, omega=0.0)
    columns = {
        **PLAIN, "theta": {"value": 90, "unit": "deg"}, "omega": {"value": 0}, "mass": {"value": 36.4, "unit": "g"},
    }  # fmt: skip
    found = table.read(
        foreign(constant).drop(columns=["c3", "c6"]), columns=columns, shape=SHAPE,
        units={"angle": "rad", "length": "m", "time": "s"},
    )  # fmt: skip
    check(found.impacts, constant)
    assert found.impacts.mass.unique().item() == pytest.approx(0.0364, rel=1e-12)
    assert "theta is 90 deg in every row" in found.read_as


def test_one_column_may_be_two_of_ours_and_hide_another_name(drops):
    """A name that would be understood otherwise is what the setting says; a speed is that of both rows."""
    odd = drops.drop(columns="vy_post").rename(columns={"vx": "vy", "vy": "vx"})
    columns = {"vx": "vy", "vy": {"column": "vx"}, "vy_post": {"column": "vx", "factor": -1}}
    check(table.load(odd, columns=columns, shape=SHAPE, mass=0.0364), drops.assign(vy_post=-drops["vy"]))


def test_other_descriptions_have_units_too(drops):
    speed = np.hypot(drops["vx"], drops["vy"]) * 3.6
    odd = foreign(drops).assign(c4=speed, c5=np.degrees(np.arctan2(-drops["vy"], drops["vx"])))
    odd = odd.assign(c7=np.hypot(drops["vx_post"], drops["vy_post"]) * 3.6)
    odd = odd.assign(c8=np.degrees(np.arctan2(drops["vy_post"], drops["vx_post"])))
    columns = {name: {"column": PLAIN[name], "unit": "m"} for name in ("x", "y")}
    columns |= {"theta": {"column": "c3", "unit": "rad"}}
    columns |= {name: {"column": PLAIN[name], "unit": "rad/s"} for name in ("omega", "omega_post")}
    for end, (at, angle) in {"": ("c4", "c5"), "_post": ("c7", "c8")}.items():
        columns[f"speed{end}"] = {"column": at, "unit": "km/h"}
        columns[f"direction_floor{end}"] = {"column": angle, "unit": "deg"}
    found = table.load(odd, columns=columns, shape=SHAPE, mass=0.0364)
    np.testing.assert_allclose(found.v_pre[:, :2].numpy(), drops[["vx", "vy"]].to_numpy(), rtol=1e-9)


def test_blocks_of_a_large_table_are_read_alike(drops, tmp_path):
    path = tmp_path / "drops.csv"
    foreign(drops, vy=-1).to_csv(path, index=False)
    columns = {**PLAIN, "vy": {"column": "c5", "factor": -1}}
    blocks = [*table.read_blocks(path, 10, columns=columns, shape=SHAPE, mass=0.0364)]
    assert [len(one.impacts) for one in blocks] == [10, 10, 10]
    check(table.load(path, columns=columns, shape=SHAPE, mass=0.0364), drops)


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ({"column": "c4", "value": 1}, "data.columns.vx has both column and value: {column: …, unit: …"),
        ({"unit": "m/s"}, "data.columns.vx has neither column nor value"),
        ({"column": "c44"}, "data.columns.vx.column=c44: no such column, did you mean 'c4'?"),
        ({"column": "c4", "unit": "kg"}, "data.columns.vx.unit=kg is no unit of vx; it has length in m, cm, mm"),
        ({"column": "c4", "factor": "x"}, "data.columns.vx.factor must be a finite number"),
        ({"value": float("nan")}, "data.columns.vx.value must be a finite number"),
    ],
)
def test_an_entry_that_cannot_be_is_refused(drops, entry, said):
    with refused([said]):
        table.load(foreign(drops), columns={**PLAIN, "vx": entry}, shape=SHAPE, mass=0.0364)


def test_an_unknown_entry_is_refused(drops):
    with pytest.raises(UnknownNameError, match=r"entry of data.columns.vx: 'units', did you mean 'unit'"):
        table.load(foreign(drops), columns={**PLAIN, "vx": {"column": "c4", "units": "m/s"}})


def test_a_cell_that_is_no_number_names_its_row(drops):
    odd = foreign(drops, vy=-1).astype(object)
    odd.loc[4, "c5"] = "oops"
    columns = {**PLAIN, "vy": {"column": "c5", "factor": -1}}
    with refused(["row 5, column c5: must be a finite number", "'oops'"]):
        table.load(odd, columns=columns, shape=SHAPE, mass=0.0364)
    odd.loc[4, "c5"] = None
    with refused(["row 5, column c5", "the cell is empty"]):
        table.load(odd, columns=columns, shape=SHAPE, mass=0.0364)
    found = table.load(odd, columns=columns, shape=SHAPE, mass=0.0364, drop_incomplete=True)
    assert found.incomplete == ("5",)
