"""Roll-outs of ten bounces: flights, contact times and impacts of a batch, against MuJoCo stepping the same bodies.

    python benchmarks/speed/roll_outs.py [--rounds 3] [--quick] [--threads 2]

Bodies are thrown at random from 0.1 m and higher, μ = 0.2, ε = 0.6.  MuJoCo steps a hundred of them for as long as
their ten bounces take, in steps of 1 ms with contacts of 10 ms (`contactlearn.models.export.mujoco.solref`), and its
seconds are extrapolated to all; a contact that soft is none of the two rigid laws.
"""

import sys
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import mujoco
import torch

from contactlearn import laws
from contactlearn.mechanics.body_state import BodyState
from contactlearn.mechanics.shapes import Cuboid, Disc, Ellipse, Sphere
from contactlearn.models.contact_model import ContactModel
from contactlearn.models.export.mujoco import solref
from speed.harness import compared, header, parsed, parser, row

BODIES = {
    "disc": (Disc(0.02), 'type="sphere" size="0.02"'),
    "ellipse": (Ellipse((0.03, 0.015)), 'type="ellipsoid" size="0.03 0.02 0.015"'),
    "sphere": (Sphere(0.02), 'type="sphere" size="0.02"'),
    "cube": (Cuboid((0.02, 0.02, 0.02)), 'type="box" size="0.02 0.02 0.02"'),
}
LAWS = "whittaker", "wang_mason"
STEPPED = 100
SCENE = """<mujoco><option timestep="0.001" cone="elliptic" impratio="100"/>
<worldbody><geom name="floor" type="plane" size="9 9 1"/>
<body pos="0 0 1"><freejoint/><geom name="body" mass="0.05" {geom}/></body></worldbody>
<contact><pair geom1="floor" geom2="body" condim="3" friction="0.2 0.2 0 0 0"
solref="-{stiffness} -{damping}" solimp="0.005 0.005 0.001 0.5 2"/></contact></mujoco>"""


def thrown(count: int, plane: bool) -> BodyState:
    """Return bodies above the floor."""
    generator = torch.Generator().manual_seed(0)
    sizes = (3, 3) if plane else (7, 6)
    pose, velocity = (torch.randn(count, size, generator=generator, dtype=torch.float64) for size in sizes)
    up = len(pose[0]) // 3
    pose[:, up] = 0.1 + pose[:, up].abs()
    pose[:, 3:] /= pose[:, 3:].norm(dim=-1, keepdim=True)
    velocity[:, up + 1 :] *= 10
    return BodyState(pose=pose, velocity=velocity, mass=0.05, inertia=1e-5)


def stepped(state: BodyState, geom: str, ends: torch.Tensor) -> None:
    """Step bodies by MuJoCo until their ends."""
    stiffness, damping = solref(0.6, 0.01)
    model = mujoco.MjModel.from_xml_string(SCENE.format(geom=geom, stiffness=stiffness, damping=damping))
    data = mujoco.MjData(model)
    for pose, velocity, end in zip(state.pose, state.velocity, ends.tolist(), strict=True):
        mujoco.mj_resetData(model, data)
        if len(pose) == 3:
            data.qpos[:3], data.qvel[:3] = (pose[0], 0, pose[1]), (velocity[0], 0, velocity[1])
            data.qvel[4] = -velocity[2]
        else:
            data.qpos[:], data.qvel[:] = pose, velocity
        while data.time < end:
            mujoco.mj_step(model, data)


def main() -> None:
    options = parser(__doc__, rounds=3)
    options.add_argument("--threads", type=int, default=1)
    options = parsed(options)
    count = 200 if options.quick else 10_000
    header("body", "law", "seconds", "MuJoCo, extrapolated")
    for name, (shape, geom) in BODIES.items():
        state, few = thrown(count, name in ("disc", "ellipse")), thrown(STEPPED, name in ("disc", "ellipse"))
        models = {law: ContactModel(laws.find(law).at(0.2, 0.6)) for law in LAWS}
        ends = models[LAWS[0]].roll_out(few, shape).end
        methods = {law: partial(model.roll_out, state, shape) for law, model in models.items()}
        _, times = compared(methods | {"mujoco": partial(stepped, few, geom, ends)}, options.rounds)
        rival = times["mujoco"] * count / STEPPED
        for law in LAWS:
            row(name, law, f"{times[law]:.2f}", f"{rival / times[law]:.0f} ×")


if __name__ == "__main__":
    main()
