"""Impacts of tossed cubes, from recordings whose truth is known; and from the published ones where they are."""

import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
from scipy.spatial.transform import Rotation

from contactlearn.core.errors import DataError
from contactlearn.data import cube_tosses
from contactlearn.laws import find
from contactlearn.mechanics import rigid_body
from contactlearn.mechanics.rigid_body import GRAVITY

HALF, MASS, INERTIA, RATE = 0.0524, 0.37, 8.1e-4, 148.0
NOISE = (5e-5, 4e-4)  # m and rad
LAW = find("wang_mason").at(0.18, 0.4)


def toss(rng):
    """Frames about one impact of a corner, the velocities before and after it, and the instant."""
    while True:
        turn = Rotation.random(random_state=rng)
        corners = HALF * turn.apply(np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T)
        r, second = corners[np.argsort(corners[:, 2])[:2]]
        before = np.concatenate((rng.normal(0, 0.7, 2), (-rng.uniform(0.8, 1.5),), rng.normal(0, 6, 3)))
        body = [torch.tensor(x)[None] for x in (MASS, INERTIA * np.eye(3), r)]
        v_c = rigid_body.contact_velocity(body[2], torch.tensor(before)[None])
        if v_c[0, 2] > -0.5 or second[2] - r[2] < 0.02:
            continue
        P = LAW.impulse(rigid_body.inverse_inertia(*body), v_c)
        wrench = torch.cat((P, torch.zeros(1, 3, dtype=torch.float64)), -1)
        after = rigid_body.apply_wrench(*body, torch.tensor(before)[None], wrench)[0].numpy()
        if after[2] + np.cross(after[3:], r)[2] > 0.2:
            break
    place, frames = rng.uniform(0, 1), []
    for count in range(-9, 10):
        t = (count + place) / RATE
        v = before if t < 0 else after
        position = (0, 0, -r[2]) + v[:3] * t - (0, 0, 0.5 * GRAVITY * t**2) + rng.normal(0, NOISE[0], 3)
        turned = Rotation.from_rotvec(rng.normal(0, NOISE[1], 3)) * Rotation.from_rotvec(v[3:] * t) * turn
        frames.append(((count + 9) / RATE, *position, *turned.as_quat(scalar_first=True)))
    return frames, before, after, (9 - place) / RATE


@pytest.fixture(scope="module")
def tosses(tmp_path_factory):
    rng = np.random.default_rng(5)
    made = [toss(rng) for _ in range(60)]
    rows = [(recording, *frame) for recording, (frames, *_) in enumerate(made) for frame in frames]
    folder = tmp_path_factory.mktemp("tosses")
    pd.DataFrame(rows, columns=cube_tosses._COLUMNS).to_parquet(folder / "tosses.parquet")
    return folder, made


def test_velocities_are_within_their_errors(tosses):
    folder, made = tosses
    impacts = cube_tosses.load(folder)
    assert len(impacts) > 50
    rows = [int(name.split("-")[0]) for name in impacts.trial]
    inside = []
    for side, truth in (("pre", 1), ("post", 2)):
        known = torch.tensor(np.array([made[row][truth] for row in rows]))
        error = getattr(impacts, f"v_{side}") - known
        deviation = getattr(impacts, f"v_{side}_cov").diagonal(dim1=-2, dim2=-1).sqrt()
        inside.append((error.abs() < 1.96 * deviation).double().mean().item())
    assert 0.93 < np.mean(inside) < 0.97
    instants = torch.tensor([made[row][3] for row in rows])
    assert (impacts.time - instants).abs().max() < 1e-3
    ratio = impacts.wrench[:, :2].norm(dim=-1) / impacts.wrench[:, 2]
    assert ratio.quantile(0.9) < 0.2  # μ is 0.18


def test_mistakes_are_refused_in_one_line(tosses, tmp_path):
    folder, _ = tosses
    frames = pd.read_parquet(folder / "tosses.parquet")
    with pytest.raises(DataError, match=r"no tosses\.parquet at .*; give its folder by data\.root"):
        cube_tosses.load(tmp_path)
    frames.assign(qw=2.0).to_parquet(tmp_path / "tosses.parquet")
    with pytest.raises(DataError, match=r"row 1, columns qw, qx, qy, qz: must be a quaternion of length 1, got 2\."):
        cube_tosses.load(tmp_path)
    lying = frames.assign(qw=np.cos(0.2), qx=0.0, qy=0.0, qz=np.sin(0.2))
    lying = lying.rename(columns={"qw": "qz", "qx": "qw", "qy": "qx", "qz": "qy"})
    lying.to_parquet(tmp_path / "tosses.parquet")
    with pytest.raises(DataError, match="the scalar must come first, qw, qx, qy, qz"):
        cube_tosses.load(tmp_path)


@pytest.mark.nightly  # seven seconds
def test_the_published_tosses():
    if not (Path(os.environ.get("CONTACTLEARN_DATA", "")) / "cube_tosses" / "tosses.parquet").is_file():
        pytest.skip("the published tosses are not here")
    impacts = cube_tosses.load()
    assert len(impacts) >= 460
    ratio = impacts.wrench[:, :2].norm(dim=-1) / impacts.wrench[:, 2]
    assert 0.1 < ratio.median() < 0.25  # the board was tilted to 0.18
