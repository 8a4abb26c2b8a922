"""Load a frozen set: its impacts and what was handed over with them, without the ground truth.

A suite is a folder of `data`.  Its impacts.parquet has a row a trial and a column `set`; its truth.json has the
provenance of the suite and an entry for each set, of which this module reads the part that a laboratory hands over
(`given`) and nothing else.  World axes: x right, y up, floor below, in space z up; SI units.

Sets on published measurements are not stored: planted.parquet has the rows that were drawn from the publication and
the change of the velocity after contact that a hidden effect makes, which is added here.
"""

import json
import os
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd
import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.data import ellipse_drops, table
from contactlearn.mechanics.impacts import Impacts

DATA = Path(__file__).parent / "data"
SUITES = (
    "independent",
    "author_a",
    "author_b",
    "author_c",
    "author_d",
    "author_e",
    "author_f",
    "author_g",
    "author_h",
    "author_i",
    "author_j",
    "author_k",
    "author_l",
    "author_n",
    "author_o",
    "author_q",
    "author_r",
)


@dataclass(frozen=True, kw_only=True)
class BlindSet:
    """A set as the diagnosis may see it."""

    suite: str  # name of its folder
    name: str  # unique in the suite
    n: int  # number of trials
    # "learn" if its answers may be examined during development, "report" if not, None in suites of one part
    half: str | None = None
    # declared outline of all bodies or of each by name, in the entries of `make_shapes`; None if undeclared
    shape: dict[str, Any] | None = None
    measured: str | None = None  # publication whose measurements it uses, None for simulated sets


@cache
def read_suite(suite: str) -> dict[str, Any]:
    """Read the truth.json of a suite, with its provenance and the entries of its sets.

    Raises:
        ValueError: there is no suite of this name.
    """
    if suite not in SUITES:
        raise ValueError(f"no suite {suite!r}; there are {', '.join(SUITES)}")
    return json.loads((DATA / suite / "truth.json").read_text("utf-8"))


def blind_sets(suite: str) -> dict[str, BlindSet]:
    """Return the sets of a suite by name."""
    entries = read_suite(suite)["sets"].items()
    return {
        name: BlindSet(
            suite=suite, name=name, n=one["n"], half=one.get("half"), measured=one.get("measured"), **one["given"]
        )
        for name, one in entries
    }


def load(blind_set: BlindSet) -> Impacts:
    """Load the impacts of a set as a user loads a table: unvalidated, with the declared outlines.

    Raises:
        OSError: the published measurements of the set are neither found in $CONTACTLEARN_DATA nor downloadable.
    """
    source = f"{blind_set.suite}/{blind_set.name}"
    if blind_set.measured is not None:
        return _planted(blind_set).replace(source=source)
    rows = _rows(blind_set, "impacts.parquet").drop(columns="set")
    for column in rows.select_dtypes("float32"):  # the shortest decimal of a number in single precision, as written
        rows[column] = rows[column].astype(str).astype(float)
    rows["y"] = rows["y"].fillna(-rows["ry"])
    with TemporaryDirectory() as folder:
        path = Path(folder, "set.parquet")
        rows.dropna(axis="columns", how="all").to_parquet(path)
        return table.load(path, shape=blind_set.shape, validate=False).replace(source=source)


def _rows(blind_set: BlindSet, file: str) -> pd.DataFrame:
    """Return the rows of a set."""
    whole = _whole(DATA / blind_set.suite / file)
    return whole[whole["set"] == blind_set.name].reset_index(drop=True)


@cache
def _whole(path: Path) -> pd.DataFrame:
    return pd.read_parquet(path)


@cache
def _ellipse_drops() -> Impacts:
    """Return the published drops with x mirrored (positions and velocities), which closes the momentum balance."""
    drops = ellipse_drops.load(inertia="uniform_disc")
    flip = torch.tensor([-1.0, 1.0, 1.0], dtype=torch.float64)
    return drops.replace(q=drops.q * flip, v_pre=drops.v_pre * flip, v_post=drops.v_post * flip, q_post=None)


def _table_tennis() -> Impacts:
    """Return the bounces off the racket."""
    root = os.environ.get("CONTACTLEARN_DATA", DATA.parents[2] / "data")
    return table.load(Path(root) / "table_tennis" / "racket_01.csv", shape={"kind": "disc", "radius": 0.02})


def _planted(blind_set: BlindSet) -> Impacts:
    """Return published measurements with the change that the hidden effect makes."""
    recipe = _rows(blind_set, "planted.parquet")
    published = {"ellipse_drops": _ellipse_drops, "table_tennis": _table_tennis}[str(blind_set.measured)]()
    impacts = published[recipe["row"].tolist()]
    order = np.arange(1, blind_set.n + 1)
    v_post = impacts.v_post + planted_change(blind_set)
    return impacts.replace(v_post=v_post, order=order, trial=tuple(map(str, order)))


def planted_change(blind_set: BlindSet) -> Float[Tensor, "n 3"]:
    """Return the change of v_post in (m/s, m/s, rad/s) by the effect hidden in a set of measured impacts."""
    columns = _rows(blind_set, "planted.parquet")[["vx_post", "vy_post", "omega_post"]]
    return torch.tensor(columns.to_numpy(), dtype=torch.float64)
