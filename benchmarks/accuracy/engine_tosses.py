"""Is the diagnosis in space right about tosses by MuJoCo, an engine that shares no equation with the laws?

    python benchmarks/accuracy/engine_tosses.py {look,report} [--trials 300]

An ellipsoid or a box is thrown onto a floor with any pose and spin.  The engine resolves the contact in a hundred
steps, as a spring and dashpot with Coulomb friction.  A laboratory reports a uniform body of stated size on a level
floor, the velocities of its geometric centre at first touch and after the last one, with noise of 0.01 m/s and
0.3 rad/s.  Nothing, one fact or two are other than reported, by sizes drawn for each set; in the last sets friction
has stripes that no catalogue has.  The seeds of both halves differ: `look` is examined, `report` is scored alone.
"""

import argparse
import math
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import torch
from torch import Tensor

from blind.report import share
from contactlearn.diagnosis.pipeline import diagnose
from contactlearn.diagnosis.result import Verdict
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.shapes import Cuboid, Ellipsoid
from contactlearn.models.export.mujoco import solref
from contactlearn.simulation.mujoco import engine, simulated

HALF, MASS, CONTACT_TIME, STEPS = (0.05, 0.035, 0.025), 0.15, 2e-4, 100  # m, kg, s
NOISE = torch.tensor((0.01,) * 3 + (0.3,) * 3, dtype=torch.float64)
ACCEPTED = {
    "centre": {"com_offset"}, "inertia": {"inertia_error"}, "tilt": {"surface_tilt"}, "torsion": {"torsional_friction"},
    "delay": {"sampling_delay", "gravity_impulse"}, "size": {"shape_error"}, "bodies": {"body_dependent_friction"},
}  # fmt: skip
"""Names that are right for each hidden fact."""
SCENE = """<mujoco>
<option timestep="{step}" gravity="0 0 -9.81" cone="elliptic" impratio="1e5" tolerance="0" iterations="20">
<flag diagexact="enable"/></option><worldbody><geom name="floor" type="plane" size="0 0 1" zaxis="{normal}"/>
<body><freejoint/><inertial pos="{centre}" mass="{mass}" diaginertia="{inertia}"/>
<geom name="body" type="{kind}" size="{size}"/></body></worldbody>
<contact><pair geom1="floor" geom2="body" condim="4" friction="{mu} {mu} {torsion} 0 0" solimp="0.005 0.005 1"
solref="{k} {c}" solreffriction="-1 {grip}"/></contact>
<sensor><contact geom1="floor" geom2="body" data="found"/></sensor></mujoco>"""


@dataclass(frozen=True, kw_only=True)
class Truth:
    """What a set hides, and how it was thrown.  Lengths in m, angles in rad, times in s."""

    hidden: tuple[str, ...]
    kind: str
    mu: tuple[float, ...]
    eps: float
    striped: bool = False
    centre: tuple[float, ...] = (0.0, 0.0, 0.0)
    inertia: float = 0.0
    tilt: tuple[float, float] = (0.0, 0.0)
    torsion: float = 0.0
    delay: float = 0.0
    size: tuple[float, ...] = field(default=(1.0, 1.0, 1.0))


def draw(hidden: tuple[str, ...], seed: int) -> Truth:
    """Draw the sizes of hidden facts."""
    generator = torch.Generator().manual_seed(seed)

    def between(low: float, high: float) -> float:
        return low + (high - low) * torch.rand((), generator=generator).item()

    def signed(low: float, high: float) -> float:
        return between(low, high) * (1 if between(0, 1) < 0.5 else -1)

    mu, other, eps = between(0.1, 0.3), between(0.1, 0.2), between(0.4, 0.7)
    facts: dict[str, object] = {
        "centre": tuple(signed(0.001, 0.003) for _ in range(3)), "inertia": signed(0.1, 0.25),
        "tilt": (signed(0.015, 0.05), signed(0.015, 0.05)), "torsion": between(0.003, 0.01),
        "delay": between(2e-3, 5e-3), "size": (1.0, 1 + signed(0.05, 0.1), 1.0),
    }  # fmt: skip
    kind = "box" if seed % 2 and "delay" not in hidden else "ellipsoid"  # a box soon touches with another corner
    several = "bodies" in hidden or "stripes" in hidden
    return Truth(
        hidden=hidden, kind=kind, mu=(mu, mu + other) if several else (mu,), eps=eps,
        striped="stripes" in hidden, **{name: facts[name] for name in hidden if name in facts},
    )  # fmt: skip


def rotation(q: Tensor) -> Tensor:
    """Rotation matrices of unit quaternions, from the body to the world."""
    w, x, y, z = q.unbind(-1)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return torch.stack([torch.stack(row, -1) for row in rows], -2)


def lowest(kind: str, half: Tensor, R: Tensor, normal: Tensor) -> Tensor:
    """Lowest point along a floor's normal, from the geometric centre, in world axes."""
    down = -(R.mT @ normal[:, None])[..., 0]
    body = half * down.sign() if kind == "box" else half**2 * down / (half * down).norm(dim=-1, keepdim=True)
    return (R @ body[..., None])[..., 0]


def thrown(truth: Truth, mu: float, count: int, generator: torch.Generator) -> tuple[Tensor, ...]:
    """r, q, v_pre, v_post as reported, of tosses that are single contacts."""
    mujoco, rollout = engine()
    half, stated = torch.tensor(HALF).double() * torch.tensor(truth.size), torch.tensor(HALF).double()
    square = stated**2 * MASS / (5 if truth.kind == "ellipsoid" else 3)
    moments = (square.sum() - square) * math.exp(truth.inertia)
    normal = torch.tensor((math.tan(truth.tilt[0]), math.tan(truth.tilt[1]), 1.0)).double()
    normal = normal / normal.norm()
    k, c = solref(truth.eps, CONTACT_TIME)
    scene = SCENE.format(
        step=CONTACT_TIME / STEPS, normal=" ".join(map(str, normal.tolist())), centre=" ".join(map(str, truth.centre)),
        mass=MASS, inertia=" ".join(map(str, moments.tolist())), kind=truth.kind, mu=mu, torsion=truth.torsion,
        size=" ".join(map(str, half.tolist())), k=-k, c=-c, grip=-0.25 / CONTACT_TIME,
    )  # fmt: skip
    model = mujoco.MjModel.from_xml_string(scene)
    data, kept, found = mujoco.MjData(model), [], 0
    with rollout.Rollout(nthread=1) as runner:
        for _ in range(400):
            n = 300
            uniform = torch.rand(n, 5, generator=generator).double()
            quaternion = torch.randn(n, 4, generator=generator).double()
            quaternion = quaternion / quaternion.norm(dim=-1, keepdim=True)
            R, spin = rotation(quaternion), 6 * torch.randn(n, 3, generator=generator).double()
            v = torch.cat((1.6 * uniform[:, :2] - 0.8, -1.2 - 1.7 * uniform[:, 2:3]), -1)
            r = lowest(truth.kind, half, R, normal)
            place = 0.4 * uniform[:, 3:] - 0.2
            height = -(place * normal[:2]).sum(-1, keepdim=True) / normal[2]
            q = torch.cat((torch.cat((place, height), -1) - r, quaternion), -1)
            noise = NOISE * torch.randn(2, n, 6, generator=generator).double()
            seen = lowest(truth.kind, stated, R, torch.tensor((0.0, 0.0, 1.0)).double())
            v_pre = torch.cat((v, spin), -1) + noise[0]
            approach = ((v + torch.linalg.cross(spin, r)) * normal).sum(-1) < -0.3
            approach &= (v_pre[:, :3] + torch.linalg.cross(v_pre[:, 3:], seen))[:, 2] < -0.2
            early = q.clone()
            early[:, :3] -= v * model.opt.timestep / 2
            local = (R.mT @ spin[..., None])[..., 0]  # the engine's spin is in the axes of the body
            state, clean = after_contact(runner, model, data, early, torch.cat((v, local), -1), truth.delay)
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


def reported(truth: Truth, trials: int, seed: int) -> Impacts:
    """The table that the laboratory reports."""
    generator = torch.Generator().manual_seed(1000 + seed)
    parts = [thrown(truth, mu, trials, generator) for mu in truth.mu]
    r, q, v_pre, v_post = (torch.stack(part, 1) for part in zip(*parts, strict=True))
    which = torch.arange(trials) % len(truth.mu)
    if truth.striped:  # which of both frictions the floor has depends on the place
        place = q[:, 0, 0] + r[:, 0, 0]
        which = (torch.sin(150 * place) > 0).long()
    rows = torch.arange(trials)
    r, q, v_pre, v_post = (part[rows, which] for part in (r, q, v_pre, v_post))
    shape = (Ellipsoid if truth.kind == "ellipsoid" else Cuboid)(HALF)
    square = torch.tensor(HALF).double() ** 2 * MASS / (5 if truth.kind == "ellipsoid" else 3)
    names = tuple(f"body {k}" for k in which.tolist()) if "bodies" in truth.hidden else (truth.kind,) * trials
    return Impacts(
        torch.full((trials,), MASS).double(), (square.sum() - square).expand(trials, 3).clone(), r, q, v_pre, v_post,
        object=names, shape=shape, source=f"tosses {seed}", validate=False,
    )  # fmt: skip


def suite(half: str) -> Iterator[tuple[int, tuple[str, ...]]]:
    """Seeds and hidden facts: nothing, each alone, some pairs, stripes."""
    pairs = list(combinations(sorted(ACCEPTED), 2))
    chosen = pairs[::3][:5] if half == "look" else pairs[1::3][:5]
    every = [(), (), (), *((name,) for name in sorted(ACCEPTED)), *chosen, ("stripes",), ("stripes",)]
    start = 100 if half == "look" else 500
    yield from enumerate(every, start)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("half", choices=("look", "report"))
    parser.add_argument("--trials", type=int, default=300, help="impacts of a set")
    parser.add_argument("--only", type=int, default=None, help="seed of one set")
    given = parser.parse_args()
    first, exact, false, unknown, spent = [], [], [], [], []
    for seed, hidden in suite(given.half):
        if given.only not in (None, seed):
            continue
        truth = draw(hidden, seed)
        impacts, began = reported(truth, given.trials, seed), time.process_time()
        found = diagnose(impacts, seed=seed)
        spent.append(time.process_time() - began)
        right = [ACCEPTED[name] for name in hidden if name in ACCEPTED]
        wrong = [name for name in found.effects if not any(name in names for names in right)]
        false.append(bool(wrong))
        if right:
            first.append(bool(found.effects) and any(found.effects[0] in names for names in right))
            exact.append(not wrong and all(names & set(found.effects) for names in right))
        if truth.striped:
            unknown.append(found.verdict is Verdict.UNKNOWN)
        names, left = (
            ", ".join(some) or "–" for some in (found.effects, [one.effect.name for one in found.candidates])
        )
        errors = f"{found.law} {found.budget.base.mean:.3f} → {found.budget.named.mean:.3f}"
        head = f"{seed} {truth.kind:9} {'+'.join(hidden) or 'nothing':17} {found.verdict:8} {names}"
        print(f"{head} | candidates: {left} | {errors} | {spent[-1]:.0f} s", flush=True)
    rates = {"first name": first, "exact set": exact, "a false name": false, "stripes called unknown": unknown}
    for name, answers in rates.items():
        print(f"{name}: {share(answers)}")
    print(f"processor time: median {torch.tensor(spent).median():.0f} s, most {max(spent):.0f} s")


if __name__ == "__main__":
    main()
