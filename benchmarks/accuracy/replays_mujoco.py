"""Do cubes tossed in MuJoCo follow the recorded ones?  Three scenes, and roll-outs of the same models.

    python benchmarks/accuracy/replays_mujoco.py [--tosses 60] [--contact-time 2e-3]

Laws are fitted to the published tosses of even number, in CONTACTLEARN_DATA.  They predict those of odd number that
have an accepted contact: to the end, from the fitted first flight or, as published engines, from the first row.  All
have the gravity that the recordings show.

    usual        stated body and friction, with MuJoCo's default contact, solver and step of 2 ms
    stated       the scene of a law, fitted to the stated body
    identified   the scene of a law, fitted with mass centre, corner radius and inertia

Errors are the means over the frames of a toss of distance over width and of angle: mean ± standard deviation over
tosses, and median.  A prediction is lost where the distance exceeds a tenth of the width.
"""

import argparse
import math
import random
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import torch
from torch import Tensor

from contactlearn.cli.commands.impacts import find_recorded
from contactlearn.cli.hydra_main import compose
from contactlearn.cli.settings import SourceSettings
from contactlearn.inference.evaluation.replay import STARTS, ReplayErrors, Spread, replays
from contactlearn.inference.identification.joint import identify_jointly
from contactlearn.mechanics.body_state import BodyState
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import matvec, rotation
from contactlearn.models.contact_model import ContactModel
from contactlearn.models.export.mujoco import export
from contactlearn.models.roll_out import Until
from contactlearn.simulation.mujoco import engine

FITTED = {"stated": (), "identified": ("com_offset", "corner_radius", "inertia_error")}
USUAL = """<mujoco><default><geom friction="0.18 0.005 0.0001"/></default><worldbody>
<geom type="plane" size="0 0 1"/><body><freejoint/><geom type="box" size="{size}"/>
<inertial pos="0 0 0" mass="{mass}" diaginertia="{moments}"/></body></worldbody></mujoco>"""  # friction as published


@dataclass(frozen=True)
class Engine:
    """A scene of MuJoCo that rolls out as a `ContactModel` does, in air without drag."""

    xml: str
    body: ContactModel

    def contact_heights(self, impacts: Impacts) -> Tensor:
        """Return the heights of the contact points of the body of the scene."""
        return self.body.contact_heights(impacts)

    def roll_out(self, state: BodyState, *, until: Until, gravity: float, drag: float) -> SimpleNamespace:
        """Return when trajectories end, and their poses `at` times [N, T]."""
        assert drag == 0
        mujoco, _ = engine()
        model = mujoco.MjModel.from_xml_string(self.xml)
        model.opt.gravity[2] = -gravity
        rows = [*zip(state.pose, state.velocity, strict=True)]
        end = torch.full((len(rows),), until.time, dtype=torch.float64)
        return SimpleNamespace(
            end=end,
            at=lambda times: torch.stack([toss(model, *row, time) for row, time in zip(rows, times, strict=True)]),
        )


def toss(model: Any, pose: Tensor, velocity: Tensor, time: Tensor) -> Tensor:
    """Poses [T, 7] at times; between steps the body flies on, and where a time is nan so is the pose."""
    mujoco, _ = engine()
    data, poses = mujoco.MjData(model), torch.full((len(time), 7), torch.nan, dtype=torch.float64)
    data.qpos[:] = pose
    data.qvel[:] = torch.cat((velocity[:3], matvec(rotation(pose[3:]).mT, velocity[3:])))  # spin in the body's axes
    for row, t in zip(poses.numpy(), time[time.isfinite()].tolist(), strict=False):
        mujoco.mj_step(model, data, nstep=int((t - data.time) / model.opt.timestep))
        row[:] = data.qpos
        mujoco.mj_integratePos(model, row, data.qvel, t - data.time)
    return poses


def models_of(impacts: Impacts, contact_time: float) -> dict[str, Any]:
    """Fit, and return scenes and models by name."""
    fitted = {name: identify_jointly("wang_mason", effects, impacts).model for name, effects in FITTED.items()}
    size, moments = (" ".join(map(str, one)) for one in (impacts.shape.half, impacts.inertia[0].tolist()))
    usual = USUAL.format(size=size, mass=impacts.mass[0].item(), moments=moments)
    found = {"usual": Engine(usual, fitted["stated"])}
    for name, model in fitted.items():
        print(f"{name}: {model}")
        found[name] = Engine(replace(export(model, impacts).scene, contact_time=contact_time).xml(), model)
    return found | {f"{name}, roll-out": model for name, model in fitted.items()}


def line(name: str, errors: Mapping[str, ReplayErrors]) -> str:
    """A row of the table, with the errors by start."""

    def cell(x: Spread, unit: float, sign: str) -> str:
        return f"{x.mean * unit:.1f} ± {x.deviation * unit:.1f}{sign}, {x.median * unit:.1f}"

    cells = [name]
    for one in errors.values():
        lost = "–" if one.lost_after is None else f"{one.lost_after:.2f} s"
        cells += [cell(one.distance, 100, " %"), cell(one.angle, math.degrees(1), "°"), lost]
    return f"| {' | '.join(cells)} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tosses", type=int, default=60, help="replayed, drawn among those of odd number")
    parser.add_argument("--contact-time", type=float, default=2e-3, help="of the exported scenes, s")
    given = parser.parse_args()
    found = find_recorded(SourceSettings.from_config(compose("diagnose", ["data=cube_tosses"])))
    recordings = [trial.rpartition("#")[0] for trial in found.impacts.trial]
    odd = sorted({name for name in recordings if int(name) % 2})
    drawn = random.Random(0).sample(odd, min(given.tosses, len(odd)))
    models = models_of(found.impacts[torch.tensor([int(name) % 2 == 0 for name in recordings])], given.contact_time)
    errors = {}
    for start in STARTS:
        shown = replays(models, found, without={*recordings} - {*drawn}, start=start)
        print(f"{start}: {len(shown)} tosses")
        errors[start] = {name: ReplayErrors.of(shown, name) for name in models}
    for name in models:
        print(line(name, {start: errors[start][name] for start in STARTS}))


if __name__ == "__main__":
    main()
