"""Do bodies tossed in MuJoCo follow the recorded ones?  Three scenes, and roll-outs of the same models.

    python benchmarks/accuracy/replays_mujoco.py cubes|squares [--contact-time 2e-3]

Laws are fitted to the published recordings of even number, in CONTACTLEARN_DATA.  They predict those of odd number that
have an accepted contact: to the end, from the fitted first flight or, as published engines, from the first row.  All
have the gravity, the drag and, but for the usual settings, the friction of slides that the recordings show.

    usual        stated body, with MuJoCo's default contact, solver and step of 2 ms
    stated       the scene of a law, fitted to the stated body
    identified   the scene of a law, fitted with what differs from the stated body
    card         a law, fitted after the correction `rig`

Errors are the means over the frames of a recording of distance over width and of angle: mean ± standard deviation over
recordings, 95 % interval of the mean, and median.  A prediction is lost where the distance exceeds a tenth of the
width.
"""

import argparse
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import torch
from torch import Tensor

from contactlearn.cli.commands.impacts import find_recorded
from contactlearn.cli.hydra_main import compose
from contactlearn.cli.settings import SourceSettings
from contactlearn.data.audit.corrections import correct
from contactlearn.inference.evaluation.replay import STARTS, ReplayErrors, Spread, replays, width
from contactlearn.inference.identification import joint
from contactlearn.mechanics.body_state import BodyState
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import matvec, rotation
from contactlearn.models.contact_model import ContactModel
from contactlearn.models.export.mujoco import export
from contactlearn.models.roll_out import Until
from contactlearn.simulation.mujoco import engine

BODY = ("com_offset", "corner_radius", "inertia_error")
SQUARE = [
    *("data=tracks", "data.path=${oc.env:CONTACTLEARN_DATA}/square_drops/recordings.parquet", "data.mass=0.0485"),
    "data.shape={kind:polygon,vertices:[[-0.03,-0.03],[0.03,-0.03],[0.03,0.03],[-0.03,0.03]]}",
    *("data.columns={position:[x,z],angle:th,recording:recording}", "data.rate=250"),
]
CASES = {
    "cubes": (["data=cube_tosses"], BODY, 0.18),  # friction as published
    "squares": (SQUARE, (*BODY, "orientation_offset", "surface_tilt"), None),
}
"""Configuration, effects of the identified body, and stated friction; that of the fitted law if None."""
JOINTS = {
    2: '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/><joint axis="0 -1 0"/>',
    3: "<freejoint/>",
}
USUAL = """<mujoco><default><geom friction="{mu} 0.005 0.0001"/></default><worldbody>
<geom type="plane" size="0 0 1"/><body>{joints}<geom type="box" size="{half} {half} {half}"/>
<inertial pos="0 0 0" mass="{mass}" diaginertia="{moments}"/></body></worldbody></mujoco>"""


@dataclass(frozen=True)
class Engine:
    """A scene of MuJoCo that rolls out as a `ContactModel` does, with the friction of slides of its hook."""

    xml: str
    body: ContactModel
    hook: str | None = None

    @property
    def law_model(self) -> ContactModel:
        """The model whose scene it is."""
        return self.body

    def contact_heights(self, impacts: Impacts) -> Tensor:
        """Return the heights of the contact points of the body of the scene."""
        return self.body.contact_heights(impacts)

    def roll_out(
        self, state: BodyState, *, until: Until, gravity: float, drag: float, friction: float | None
    ) -> SimpleNamespace:
        """Return when trajectories end, and their poses `at` times [N, T]."""
        mujoco, _ = engine()
        model = mujoco.MjModel.from_xml_string(self.xml)
        model.opt.gravity[2], model.dof_damping[: state.space.d] = -gravity, drag * model.body_mass[-1]
        own: dict[str, Any] = {}
        exec(self.hook or "def set_contact(model, data): pass", own)
        rows = [*zip(state.pose, state.velocity, strict=True)]
        end = torch.full((len(rows),), until.time, dtype=torch.float64)
        return SimpleNamespace(
            end=end,
            at=lambda times: torch.stack(
                [toss(model, *row, time, own["set_contact"]) for row, time in zip(rows, times, strict=True)]
            ),
        )


def toss(model: Any, pose: Tensor, velocity: Tensor, time: Tensor, set_contact: Callable[[Any, Any], None]) -> Tensor:
    """Poses [T, 3 or 7] at times; between steps the body flies on, and where a time is nan so is the pose."""
    mujoco, _ = engine()
    data, poses = mujoco.MjData(model), torch.full((len(time), len(pose)), torch.nan, dtype=torch.float64)
    if len(pose) == 7:
        velocity = torch.cat((velocity[:3], matvec(rotation(pose[3:]).mT, velocity[3:])))  # spin in the body's axes
    data.qpos[:], data.qvel[:] = pose, velocity
    for row, t in zip(poses.numpy(), time[time.isfinite()].tolist(), strict=False):
        for _ in range(int((t - data.time) / model.opt.timestep)):
            set_contact(model, data)
            mujoco.mj_step(model, data)
        row[:] = data.qpos
        mujoco.mj_integratePos(model, row, data.qvel, t - data.time)
    return poses


def models_of(impacts: Impacts, effects: tuple[str, ...], mu: float | None, contact_time: float) -> dict[str, Any]:
    """Fit, and return scenes and models by name."""
    kinds = {"stated": (), "identified": effects}
    fitted = {name: joint.fit(impacts, "wang_mason", some).model for name, some in kinds.items()}
    usual = USUAL.format(
        mu=fitted["stated"].law.mu.item() if mu is None else mu, joints=JOINTS[impacts.space.d],
        half=width(impacts.shape) / 2, mass=impacts.mass[0].item(),
        moments=" ".join(map(str, impacts.inertia[0].expand(3).tolist())),
    )  # fmt: skip
    found: dict[str, Any] = {"usual": Engine(usual, fitted["stated"])}
    for name, model in fitted.items():
        print(f"{name}: {model}")
        scene, hook = export(model, impacts, contact_time)
        found[name] = Engine(scene.xml(), model, hook)
    return found | {f"{name}, roll-out": model for name, model in fitted.items()}


def line(name: str, errors: Mapping[str, ReplayErrors], count: int) -> str:
    """A row of the table, with the errors by start."""

    def cell(x: Spread, unit: float, sign: str) -> str:
        low, high = (x.mean + k * 1.96 * x.deviation / math.sqrt(count) for k in (-1, 1))
        about = f"[{low * unit:.1f}, {high * unit:.1f}], {x.median * unit:.1f}"
        return f"{x.mean * unit:.1f} ± {x.deviation * unit:.1f}{sign}, {about}"

    cells = [name]
    for one in errors.values():
        lost = "–" if one.lost_after is None else f"{one.lost_after:.2f} s"
        cells += [cell(one.distance, 100, " %"), cell(one.angle, math.degrees(1), "°"), lost]
    return f"| {' | '.join(cells)} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bodies", choices=CASES)
    parser.add_argument("--contact-time", type=float, default=2e-3, help="of the exported scenes, s")
    given = parser.parse_args()
    words, effects, mu = CASES[given.bodies]
    found = find_recorded(SourceSettings.from_config(compose("diagnose", words)))
    recordings = [trial.rpartition("#")[0] for trial in found.impacts.trial]
    even = torch.tensor([int(re.findall(r"\d+", name)[-1]) % 2 == 0 for name in recordings])
    fitted_to = {name for name, fits in zip(recordings, even.tolist(), strict=True) if fits}
    models = models_of(found.impacts[even], effects, mu, given.contact_time)
    card = joint.fit(correct(found.impacts, ["rig"])[even], "wang_mason").model
    print(f"card: {card}\nfriction of slides: {found.rig.friction}")
    rows, count = {name: {} for name in (*models, "card, roll-out")}, 0
    for start in STARTS:
        shown = replays(models, found, without=fitted_to, start=start)
        corrected = replays({"card, roll-out": card}, found, ["rig"], without=fitted_to, start=start)
        count = len(shown)
        print(f"{start}: {count} of {len({*recordings} - fitted_to)} recordings")
        for name, errors in rows.items():
            errors[start] = ReplayErrors.of(shown if name in models else corrected, name)
    for name, errors in rows.items():
        print(line(name, errors, count))


if __name__ == "__main__":
    main()
