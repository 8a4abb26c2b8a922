"""Drops of MuJoCo: a body in the plane (two slides, a hinge) that starts just above a plane and bounces once.

Contact: solref as stiffness and damping for a half-period of 0.1 ms, friction with strong damping of its own
(solreffriction), so that it is dry.  No gravity but where it is the effect.  Recorded: pose and velocity in the last
step without contact and in the first after it.  Effects are options that MuJoCo documents (XML reference):

    rolling_resistance   condim 6, rolling friction: a length, the moment is at most so much times the normal force
    spin_damping         damping of the hinge while the body flies on until it is seen
    side_drag            damping of the slides likewise
    surface_tilt         the plane is turned
    inertia_error        diaginertia differs from the declared one
    gravity_impulse      gravity while the body flies on until it is seen
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from second_nature.bodies import Body
from second_nature.nature import Drops, Record

PERIOD, STEP, FLIGHT, GLIDE = 1e-4, 2e-6, 0.02, 5e-4
FRICTION = "-1 -40000"


@dataclass(frozen=True)
class Options:
    """What differs from a plain contact, by the effect's name; sizes in SI units."""

    rolling_resistance: float = 0.0
    spin_damping: float = 0.0
    side_drag: float = 0.0
    surface_tilt: float = 0.0
    inertia_error: float = 0.0
    gravity_impulse: float = 0.0


def simulate(body: Body, mu: float, eps: float, drops: Drops, options: Options = Options()) -> Record:
    """Drop the body once from each state; `Drops` are states just above the floor."""
    model = mujoco.MjModel.from_xml_string(_xml(body, mu, eps, options))
    data, slope = mujoco.MjData(model), options.surface_tilt
    r = body.contact(drops.theta, slope)
    before, after, valid = np.zeros((len(r), 6)), np.zeros((len(r), 6)), np.zeros(len(r), bool)
    for i in range(len(r)):
        n = np.array([-np.sin(slope), np.cos(slope)])
        start = np.array([drops.x[i], np.tan(slope) * drops.x[i]]) + 1e-5 * n - r[i]
        mujoco.mj_resetData(model, data)
        data.qpos, data.qvel = [*start, drops.theta[i]], drops.v[i]
        valid[i] = _bounce(model, data, before[i], after[i])
    declared = np.full(len(r), body.mass)
    seen = body.contact(before[:, 2], slope)
    approach = before[:, 4] + seen[:, 0] * before[:, 5]
    valid &= (approach < -0.35) & (body.margin(drops.theta) > 0.12)
    return Record(declared, declared * body.rho2, seen, before[:, :3], before[:, 3:], after[:, 3:], valid)


def _bounce(model, data, before, after):
    """Fill the states before and after one contact; whether there was exactly one of ordinary length."""
    touched, model.opt.timestep = False, STEP
    for _ in range(int(6 * PERIOD / STEP)):
        before[:] = before if touched else np.concatenate((data.qpos, data.qvel))
        mujoco.mj_step(model, data)
        if data.ncon and np.any(data.efc_force):
            touched = True
        elif touched and not data.ncon:
            break
    else:
        return False
    extra = FLIGHT if model.opt.gravity[2] or model.dof_damping.any() else 0.0
    model.opt.timestep = GLIDE
    for _ in range(int(extra / GLIDE)):
        mujoco.mj_step(model, data)
        if data.ncon:
            return False
    after[:] = np.concatenate((data.qpos, data.qvel))
    return True


def _xml(body, mu, eps, options):
    zeta = np.log(1 / eps) / np.hypot(np.pi, np.log(1 / eps))
    omega = np.pi / PERIOD
    inertia = body.mass * body.rho2 * np.exp(options.inertia_error)
    size = {"disc": ("sphere", f"{body.a}"), "ellipse": ("ellipsoid", f"{body.a} {body.a} {body.b}")}
    kind, lengths = size.get(body.kind, ("box", f"{body.a} {body.a} {body.b}"))
    spin = options.spin_damping * inertia / FLIGHT
    drag = options.side_drag * body.mass / FLIGHT
    return f"""
    <mujoco>
      <option timestep="{STEP}" gravity="0 0 {-options.gravity_impulse}" cone="elliptic" impratio="1"
              iterations="200" tolerance="1e-12" integrator="implicitfast"/>
      <worldbody>
        <geom name="floor" type="plane" size="9 9 1" euler="0 {-np.rad2deg(options.surface_tilt)} 0"/>
        <body>
          <joint type="slide" axis="1 0 0" damping="{drag}"/>
          <joint type="slide" axis="0 0 1" damping="{drag}"/>
          <joint type="hinge" axis="0 -1 0" damping="{spin}"/>
          <inertial pos="0 0 0" mass="{body.mass}" diaginertia="{inertia} {inertia} {inertia}"/>
          <geom name="body" type="{kind}" size="{lengths}"/>
        </body>
      </worldbody>
      <contact>
        <pair geom1="floor" geom2="body" condim="{6 if options.rolling_resistance else 3}"
              friction="{mu} {mu} 1e-6 {max(options.rolling_resistance, 1e-9)} {max(options.rolling_resistance, 1e-9)}"
              solref="{-(omega**2)} {-2 * zeta * omega}" solreffriction="{FRICTION}" solimp="0.99 0.99 0.001"/>
      </contact>
    </mujoco>"""
