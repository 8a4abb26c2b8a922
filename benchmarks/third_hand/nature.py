"""From a scene to a laboratory's table: drops, the impact of each, and what instruments make of it.

Everything random follows from the scene's seed.  Trials that break physics under the hidden effects (energy gained, a
tangential impulse outside the cone, a body sunk in) are replaced by others.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from third_hand.bodies import Body, contact_points
from third_hand.designs import ascending
from third_hand.effect import Effect, State
from third_hand.laws import impulse, inverse_mass
from third_hand.noise import Noise

BEFORE, AFTER = ("vx", "vy", "omega"), ("vx_post", "vy_post", "omega_post")
COLUMNS = (*BEFORE, *AFTER, "x", "y", "theta", "rx", "ry", "mass", "inertia")
Design = Callable[[np.random.Generator, int], State]


@dataclass(frozen=True)
class Contact:
    """A law by its name in `laws.LAWS`, with its parameters."""

    law: str
    mu: float
    eps: float


@dataclass(frozen=True)
class Scene:
    """A laboratory: bodies, the law with its parameters, how bodies are dropped, what is hidden, and the instruments.

    `kind` is what is to be found out: single, pair, triple, nothing, unknown, confounded or measurement.  `seen`: the
    contact point in the table is where the body touched; else it is computed from the nominal outline at the recorded
    angle above a level floor.
    """

    kind: str
    n: int
    bodies: Sequence[Body]
    contact: Contact
    design: Design
    effects: Sequence[Effect]
    noise: Noise
    seen: bool = False


@dataclass(frozen=True)
class Table:
    """What the laboratory writes down: columns of equal length, and whose impact each is."""

    columns: dict[str, np.ndarray]
    objects: list[str] = field(default_factory=list)


def simulate(scene: Scene, drops: State, effects: Sequence[Effect]) -> tuple[State, State]:
    """What perfect instruments record of the drops, and the true state."""
    record: State = dict(drops)
    record["order"] = np.arange(len(record["vx"]))
    state = dict(record) | {"phi": 0.0, "bodies": scene.bodies, "seen": scene.seen}
    for effect in effects:
        if effect.before:
            effect.before(state, record)
    _approach(scene, state, drops, effects)
    for name, value in zip(AFTER, _depart(scene, state, effects), strict=True):
        record[name] = value
    for effect in effects:
        if effect.instrument:
            effect.instrument(record)
    return record, state


def _approach(scene: Scene, state: State, drops: State, effects: Sequence[Effect]) -> None:
    """Velocities in the contact's axes, and the parameters of the law."""
    c, s, n = np.cos(state["phi"]), np.sin(state["phi"]), len(drops["vx"])
    omega = state["omega"]
    state["ux"], state["uy"] = c * state["vx"] + s * state["vy"], -s * state["vx"] + c * state["vy"]
    rx, ry = c * state["rx"] + s * state["ry"], -s * state["rx"] + c * state["ry"]
    state["arm"] = rx, ry
    state["vt"], state["vn"] = state["ux"] - ry * omega, state["uy"] + rx * omega
    state["lever"] = np.abs(rx) / np.sqrt(state["inertia"] / state["mass"])
    state["mu"] = scene.contact.mu + np.zeros(n) + drops.get("mu_scatter", 0)
    state["eps"] = scene.contact.eps + np.zeros(n) + drops.get("eps_scatter", 0)
    for effect in effects:
        if effect.law:
            effect.law(state)
    state["mu"], state["eps"] = np.maximum(state["mu"], 0), np.clip(state["eps"], 0, 1)
    state["W"] = inverse_mass(state["mass"], state["inertia"], rx, ry)


def _depart(scene: Scene, state: State, effects: Sequence[Effect]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The impact, and the velocities (v_x, v_y, ω) that are there to be measured."""
    mass, inertia, omega, (rx, ry) = state["mass"], state["inertia"], state["omega"], state["arm"]
    Pt, Pn = impulse(scene.contact.law, state["W"], state["vt"], state["vn"], state["mu"], state["eps"])
    for effect in effects:
        if effect.impulse:
            Pt, Pn = effect.impulse(state, Pt, Pn)
    state["Pt"], state["Pn"] = Pt, Pn
    state["w1"] = omega + (rx * Pn - ry * Pt) / inertia
    torque = np.zeros(len(omega))
    for effect in effects:
        if effect.moment:
            torque = torque + effect.moment(state)
    ux, uy, spin = state["ux"] + Pt / mass, state["uy"] + Pn / mass, state["w1"] + torque / inertia
    state["vn_post"] = uy + rx * spin
    state["energy"] = mass * (state["ux"] ** 2 + state["uy"] ** 2) + inertia * omega**2
    state["energy_post"] = mass * (ux**2 + uy**2) + inertia * spin**2
    c, s = np.cos(state["phi"]), np.sin(state["phi"])
    velocity = {"vx": c * ux - s * uy, "vy": s * ux + c * uy, "omega": spin}
    for effect in effects:
        if effect.after:
            effect.after(state, velocity)
    return velocity["vx"], velocity["vy"], velocity["omega"]


def broken(state: State) -> np.ndarray:
    """Trials in which the impact is no physical one."""
    Pt, Pn = state["Pt"], state["Pn"]
    wrong = ~np.isfinite(Pt + Pn) | (state["vn"] > -0.05) | (Pn < -1e-9) | (state["vn_post"] < -1e-7)
    wrong |= np.abs(Pt) > state["mu"] * Pn + 1e-9
    return wrong | (state["energy_post"] > state["energy"] * (1 + 1e-9))


def drawn(scene: Scene, n: int, rng: np.random.Generator) -> State:
    """Twice as many drops as are wanted, with scatter of the material, and whose law alone breaks nothing."""
    drops = scene.design(rng, n if scene.design is ascending else 2 * n + 200)
    k = len(drops["vx"])
    drops["ib"] = rng.integers(0, len(scene.bodies), k)
    drops["mass"] = np.array([body.mass for body in scene.bodies])[drops["ib"]]
    drops["inertia"] = np.array([body.inertia for body in scene.bodies])[drops["ib"]]
    drops["u1"], drops["time"] = rng.random(k), np.cumsum(rng.uniform(5, 60, k))
    for name, scatter in (("eps_scatter", scene.noise.eps), ("mu_scatter", scene.noise.mu)):
        if scatter:
            drops[name] = rng.normal(0, scatter, k)
    drops["rx"], drops["ry"] = contact_points(scene.bodies, drops["ib"], drops["theta"])
    drops["y"] = -drops["ry"]
    _, state = simulate(scene, drops, ())
    keep = np.flatnonzero(~broken(state) & (state["vn"] < -0.15))
    return {name: value[keep] for name, value in drops.items()}


def happen(scene: Scene, seed: int, n: int | None = None) -> Table:
    """The table of the scene, or one like it with `n` trials."""
    rng, n = np.random.default_rng(seed), n or scene.n
    drops = drawn(scene, n, rng)
    n = min(n, len(drops["vx"]))
    record, _ = simulate(scene, unbroken(scene, drops, n), scene.effects)
    after, before = scene.noise.errors(np.stack([record[name] for name in AFTER], 1), rng)
    columns = {name: record[name] for name in COLUMNS}
    for i, (first, second) in enumerate(zip(BEFORE, AFTER, strict=True)):
        columns[first], columns[second] = record[first] + before[:, i], record[second] + after[:, i]
    places = np.random.default_rng(n + int(1e6 * abs(record["x"][0])))
    for name in ("x", "y"):
        columns[name] = record[name] + places.normal(0, 2e-4, len(record["x"]))
    return Table(columns, [scene.bodies[i].name for i in record["ib"]])


def unbroken(scene: Scene, drops: State, n: int) -> State:
    """The first n drops, those that break physics replaced by later ones; their places in the order close up."""
    chosen, spare = {name: value[:n] for name, value in drops.items()}, n
    for _ in range(30):
        wrong = broken(simulate(scene, chosen, scene.effects)[1])
        if not wrong.any():
            break
        more = slice(spare, spare + int(wrong.sum()))
        spare += int(wrong.sum())
        chosen = {name: np.r_[value[~wrong], drops[name][more]] for name, value in chosen.items()}
    return chosen
