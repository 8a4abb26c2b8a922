"""Are impacts from filmed tosses right?  A cube tossed onto a floor by MuJoCo, filmed with noise.

    python benchmarks/accuracy/filmed_tosses.py [--size 60] [--seed 1]

The engine's contacts are soft and last about 1 ms; its cube has sharp corners.  A touch is a run of steps with a
contact, and begins with the corners that carry it.  It is clean if one corner carries it throughout, and the flights
before and after have at least six frames.  An accepted impact is false if no touch of a single corner is within a frame
of it, or another touch begins within a frame.
"""

import argparse
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import pandas as pd

from blind.report import wilson
from contactlearn.data.tracks import Tracked, find_impacts, track_options
from contactlearn.mechanics.shapes import Cuboid

HALF, MASS, STEP, RATE = (0.05, 0.05, 0.05), 0.4, 2e-5, 148.0
SCENE = """<mujoco><option timestep="{step}" gravity="0 0 -9.81" cone="elliptic" impratio="10"/>
<worldbody><geom name="floor" type="plane" size="0 0 1"/>
<body><freejoint/><geom name="body" type="box" size="{size}" mass="{mass}"/></body></worldbody>
<contact><pair geom1="floor" geom2="body" condim="3" friction="{mu} {mu} 0 0 0" solref="{stiff} {damp}"
solimp="0.99 0.99 0.001"/></contact></mujoco>"""
_LASTS = 1e-3  # s, of half an undamped swing of a contact


@dataclass(frozen=True, kw_only=True)
class Touch:
    """A run of steps with a contact force: when in s, velocities before and after, and if one corner carries it."""

    start: float
    end: float
    before: np.ndarray
    after: np.ndarray
    single: bool


def toss(rng: np.random.Generator, seconds: float, half: tuple[float, ...] = HALF) -> tuple[np.ndarray, list[Touch]]:
    """Poses [T, 7] of a frame at the rate, and touches, of one toss."""
    import mujoco

    stiff = MASS * (np.pi / _LASTS) ** 2 / 3
    damp = 0.5 * np.sqrt(stiff * MASS)
    scene = SCENE.format(
        step=STEP, size=" ".join(map(str, half)), mass=MASS, mu=rng.uniform(0.1, 0.5), stiff=-stiff, damp=-damp
    )
    model = mujoco.MjModel.from_xml_string(scene)
    data = mujoco.MjData(model)
    q = rng.standard_normal(4)
    data.qpos[:] = (*rng.normal(0, 0.1, 2), rng.uniform(0.15, 0.3), *(q / np.linalg.norm(q)))
    data.qvel[:] = (*rng.normal(0, 0.7, 2), rng.uniform(-1.0, 0.5), *rng.normal(0, 6, 3))
    steps, phase = round(seconds / STEP), rng.uniform(0, 1 / RATE)
    frames, touches, state = [], list[Touch](), None
    due = phase
    for k in range(steps):
        if k * STEP >= due:
            frames.append((k * STEP, *data.qpos))
            due += 1 / RATE
        mujoco.mj_step1(model, data)
        if data.ncon and state is None:
            state = (k * STEP, spatial(data), data.ncon == 1, corner(data))
        elif data.ncon and state is not None:
            state = (*state[:2], state[2] and data.ncon == 1 and corner(data) == state[3], state[3])
        elif state is not None:
            touches.append(Touch(start=state[0], end=k * STEP, before=state[1], after=spatial(data), single=state[2]))
            state = None
        mujoco.mj_step2(model, data)
    return np.array(frames), touches


def corner(data) -> tuple[bool, ...]:
    """The corner of a contact, by the signs of its place in the body."""
    R = data.xmat[1].reshape(3, 3)
    return tuple(bool(x) for x in R.T @ (data.contact.pos[0] - data.xpos[1]) > 0)


def spatial(data) -> np.ndarray:
    """Velocity of the centre and spin, in world axes."""
    return np.concatenate((data.qvel[:3], data.xmat[1].reshape(3, 3) @ data.qvel[3:]))


def film(size: int, seed: int, folder: Path, noise: tuple[float, float] = (5e-5, 5e-4)) -> list[list[Touch]]:
    """Write noisy recordings of tosses, and return their touches; times count from the first frame."""
    from scipy.spatial.transform import Rotation

    rng, rows, truth = np.random.default_rng(seed), [], []
    for number in range(size):
        frames, touches = toss(rng, 0.9)
        turned = Rotation.from_rotvec(rng.normal(0, noise[1], (len(frames), 3))) * Rotation.from_quat(
            frames[:, 4:], scalar_first=True
        )
        position = frames[:, 1:4] + rng.normal(0, noise[0], (len(frames), 3))
        rows.append(
            np.column_stack(
                (
                    np.full(len(frames), number),
                    np.arange(len(frames)) / RATE,
                    position,
                    turned.as_quat(scalar_first=True),
                )
            )
        )
        start = frames[0, 0]
        truth.append([Touch(**{**vars(one), "start": one.start - start, "end": one.end - start}) for one in touches])
    table = pd.DataFrame(np.concatenate(rows), columns=["recording", "time", "x", "y", "z", "qw", "qx", "qy", "qz"])
    table.astype({"recording": int}).to_parquet(folder / "tosses.parquet")
    return truth


def judged(found: Tracked, truth: list[list[Touch]]) -> dict[str, object]:
    """Count clean touches that are found, false impacts, and components of velocities within 1.96 standard errors."""
    step, clean, hit, false, inside, apart = 1 / RATE, 0, 0, 0, [], []
    contacts: dict[int, list] = {}
    for row, contact in enumerate(found.survey.contacts):
        contacts.setdefault(int(contact.recording), []).append((row, contact))
    for number, touches in enumerate(truth):
        known = contacts.get(number, [])
        for k, one in enumerate(touches):
            gaps = (
                one.start - (touches[k - 1].end if k else 0),
                (touches[k + 1].start if k + 1 < len(touches) else 0.9) - one.end,
            )
            if one.single and min(gaps) > 6 * step and one.start > 6 * step:
                clean += 1
                hit += any(abs(c.time - one.start) < step for _, c in known)
        for row, c in known:
            near = [one for one in touches if one.start - step < c.time < one.end + step]
            right = len(near) == 1 and near[0].single
            false += not right
            if right:
                apart.append(c.chi_square)
                one = near[0]
                shift = c.time - np.array((one.start, one.end))
                for side, v, t in (("pre", one.before, shift[0]), ("post", one.after, shift[1])):
                    error = getattr(found.impacts, f"v_{side}")[row].numpy() - v + (0, 0, 9.81 * t, 0, 0, 0)
                    deviation = getattr(found.impacts, f"v_{side}_cov")[row].diagonal().sqrt().numpy()
                    inside.append(np.abs(error) < 1.96 * deviation)
    return {
        "clean": clean,
        "found": hit,
        "accepted": len(found.survey.contacts),
        "false": false,
        "inside": np.array(inside),
        "apart": apart,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        truth = film(options.size, options.seed, Path(folder))
        found = find_impacts(Path(folder), mass=MASS, shape=Cuboid(HALF), options=track_options())
    seen = judged(found, truth)
    inside = seen["inside"]
    print("clean found", seen["found"], "of", seen["clean"], wilson(seen["found"], seen["clean"]))
    print("false", seen["false"], "of", seen["accepted"], wilson(seen["false"], seen["accepted"]))
    print("coverage", inside.mean(), wilson(int(inside.sum()), inside.size), inside.mean(0))
    print("apart per dof", np.mean(seen["apart"]) / 5)
    for row in found.rig.rows():
        print(row)


if __name__ == "__main__":
    main()
