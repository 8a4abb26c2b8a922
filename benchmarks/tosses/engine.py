"""Tosses by MuJoCo, an engine that shares no equation with the laws.

An ellipsoid or a box is thrown onto a floor with any pose and spin.  The engine resolves the contact in a hundred
steps, as a spring and dashpot with Coulomb friction.  Velocities are those at first touch and after the last one.
"""

import math

import torch
from torch import Tensor

from contactlearn.mechanics.impacts import Impacts
from contactlearn.models.export.mujoco import solref
from contactlearn.simulation.mujoco import engine, simulated
from tosses.facts import HALF, MASS, NOISE, Facts, lowest, rotation, table, tossed

CONTACT_TIME, STEPS = 2e-4, 100  # s
SCENE = """<mujoco>
<option timestep="{step}" gravity="0 0 -9.81" cone="elliptic" impratio="1e5" tolerance="0" iterations="20">
<flag diagexact="enable"/></option><worldbody><geom name="floor" type="plane" size="0 0 1" zaxis="{normal}"/>
<body><freejoint/><inertial pos="{centre}" mass="{mass}" diaginertia="{inertia}"/>
<geom name="body" type="{kind}" size="{size}"/></body></worldbody>
<contact><pair geom1="floor" geom2="body" condim="4" friction="{mu} {mu} {torsion} 0 0" solimp="0.005 0.005 1"
solref="{k} {c}" solreffriction="-1 {grip}"/></contact>
<sensor><contact geom1="floor" geom2="body" data="found"/></sensor></mujoco>"""


def thrown(facts: Facts, mu: float, count: int, generator: torch.Generator) -> tuple[Tensor, ...]:
    """r, q, v_pre, v_post as reported, of tosses that are single contacts."""
    mujoco, rollout = engine()
    half, stated = torch.tensor(HALF).double() * torch.tensor(facts.size), torch.tensor(HALF).double()
    moments = facts.inertia_stated() * math.exp(facts.inertia)
    normal = torch.tensor((math.tan(facts.tilt[0]), math.tan(facts.tilt[1]), 1.0)).double()
    normal = normal / normal.norm()
    k, c = solref(facts.eps, CONTACT_TIME)
    scene = SCENE.format(
        step=CONTACT_TIME / STEPS, normal=" ".join(map(str, normal.tolist())), centre=" ".join(map(str, facts.centre)),
        mass=MASS, inertia=" ".join(map(str, moments.tolist())), kind=facts.kind, mu=mu, torsion=facts.torsion,
        size=" ".join(map(str, half.tolist())), k=-k, c=-c, grip=-0.25 / CONTACT_TIME,
    )  # fmt: skip
    model = mujoco.MjModel.from_xml_string(scene)
    data, kept, found = mujoco.MjData(model), [], 0
    with rollout.Rollout(nthread=1) as runner:
        for _ in range(400):
            n = 300
            quaternion, v, spin, place = tossed(n, generator)
            R = rotation(quaternion)
            r = lowest(facts.kind, half, R, normal)
            height = -(place * normal[:2]).sum(-1, keepdim=True) / normal[2]
            q = torch.cat((torch.cat((place, height), -1) - r, quaternion), -1)
            noise = NOISE * torch.randn(2, n, 6, generator=generator).double()
            seen = lowest(facts.kind, stated, R, torch.tensor((0.0, 0.0, 1.0)).double())
            v_pre = torch.cat((v, spin), -1) + noise[0]
            approach = ((v + torch.linalg.cross(spin, r)) * normal).sum(-1) < -0.3
            approach &= (v_pre[:, :3] + torch.linalg.cross(v_pre[:, 3:], seen))[:, 2] < -0.2
            early = q.clone()
            early[:, :3] -= v * model.opt.timestep / 2
            local = (R.mT @ spin[..., None])[..., 0]  # the engine's spin is in the axes of the body
            state, clean = after_contact(runner, model, data, early, torch.cat((v, local), -1), facts.delay)
            turned = (rotation(state[:, 3:7]) @ state[:, 10:, None])[..., 0]
            v_post = torch.cat((state[:, 7:10], turned), -1) + noise[1]
            clean &= approach
            kept.append([part[clean] for part in (seen, q, v_pre, v_post)])
            found += int(clean.sum())
            if found >= count:
                break
    return tuple(torch.cat(parts)[:count] for parts in zip(*kept, strict=True))


def after_contact(runner, model, data, q: Tensor, v: Tensor, delay: float) -> tuple[Tensor, Tensor]:
    """State [n, 13] after the last touch, or so much later, and whether there was one contact at one point."""
    model.opt.timestep = CONTACT_TIME / STEPS
    states, contacts = simulated(runner, model, data, q, v, 3 * STEPS)
    touching, step = contacts > 0, torch.arange(contacts.shape[1])
    last = torch.where(touching, step, -1).amax(1)
    first = torch.where(touching, step, len(step)).amin(1)
    state = states[torch.arange(len(q)), last]
    clean = (first <= 2) & (touching.sum(1) == last - first + 1) & (last < len(step) - 1)
    clean &= (contacts.amax(1) == 1) & state.isfinite().all(-1)
    if delay:
        steps = math.ceil(delay / 1e-4)
        model.opt.timestep = delay / steps
        states, contacts = simulated(runner, model, data, *state.split((7, 6), -1), steps)
        state = states[:, -1]
        clean &= contacts.amax(1) == 0
    return state, clean


def reported(facts: Facts, trials: int, seed: int) -> Impacts:
    """The table that the laboratory reports."""
    generator = torch.Generator().manual_seed(1000 + seed)
    parts = [thrown(facts, mu, trials, generator) for mu in facts.mu]
    r, q, v_pre, v_post = (torch.stack(part, 1) for part in zip(*parts, strict=True))
    which = torch.arange(trials) % len(facts.mu)
    if "stripes" in facts.hidden:  # which of both frictions the floor has depends on the place
        which = (torch.sin(150 * (q[:, 0, 0] + r[:, 0, 0])) > 0).long()
    rows = torch.arange(trials)
    return table(facts, seed, which, *(part[rows, which] for part in (r, q, v_pre, v_post)))
