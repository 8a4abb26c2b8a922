"""Sets of engines that nobody here wrote: their options are the effects, their documents the truth.

Chipmunk's contact is Anitescu and Potra's with Newton's restitution.  MuJoCo's is convex: its normal force rises with
the slip that friction has to stop, which no law has.  Friction is therefore small with MuJoCo, smaller still on bodies
with a lever, and the noise is several times what remains (a test measures it): nothing but the option is there to name.
"""

from importlib import import_module

import numpy as np

from second_nature import bodies
from second_nature.nature import free, measured
from second_nature.path import NEWTON
from second_nature.share import law_error
from second_nature.truth import Asked, Planted, Truth

SPARE = 1.6


def _planted(engine: str, truth: dict, kind: str, level: float, friction: tuple[float, float], options: dict):
    """A maker of sets: the engine with its options, and its plain twin for the share."""

    def make(rng, n):
        simulator = import_module(f"second_nature.{engine}_drops")
        body, mu, eps = bodies.draw(kind, rng), rng.uniform(*friction), rng.uniform(0.5, 0.75)
        drops = free(rng, int(SPARE * n) + 30, body)
        chosen = simulator.Options(**{name: draw(rng, body) for name, draw in options.items()})
        noise, seed = str(rng.choice(("gaussian", "heavy"))), int(rng.integers(2**31))

        def table(what):
            record = simulator.simulate(body, mu, eps, drops, what)
            record = measured(record, noise, level, np.random.default_rng(seed))
            return record.rows(np.flatnonzero(record.valid)[:n])

        record = table(chosen)
        share = 1 - law_error(table(simulator.Options()), NEWTON)[0] / law_error(record, NEWTON)[0]
        known = {
            "forms": (f"{engine}: {', '.join(options) or 'plain'}",),
            "share": share,
            "shares": (share,) if len(truth["effects"]) == 1 else (),
            "noise": noise,
            "level": level,
        }
        return Planted(record.impacts(body.shape), Truth(**truth, **known))

    return make


def _mujoco(n, kind, *names, **options):
    truth = {"asked": Asked.EXACT, "effects": tuple((name,) for name in names)}
    return n, _planted("mujoco", truth, kind, 0.05, (0.05, 0.1) if kind == "disc" else (0.01, 0.03), options)


def _pymunk(n, kind, *names, variables=(), **options):
    asked = Asked.UNKNOWN if variables else Asked.EXACT
    truth = {"asked": asked, "effects": tuple((name,) for name in names), "variables": variables}
    return n, _planted("pymunk", truth, kind, 0.04, (0.15, 0.35), options)


def _between(low, high, sign=False):
    return lambda rng, body: rng.uniform(low, high) * (rng.choice([-1.0, 1.0]) if sign else 1.0)


def _arm(rng, body):
    return rng.uniform(0.1, 0.16) * np.sqrt(body.rho2)


def _gravity(rng, body):
    return 9.81


def _ballast(rng, body):
    return tuple(rng.choice([-1.0, 1.0], 2) * rng.uniform(0.08, 0.12, 2))


MUJOCO = [
    _mujoco(300, "disc"),
    _mujoco(300, "ellipse"),
    _mujoco(300, "disc", "rolling_resistance", rolling_resistance=_arm),
    _mujoco(150, "disc", "rolling_resistance", rolling_resistance=_arm),
    _mujoco(150, "disc", "spin_damping", spin_damping=_between(0.15, 0.3)),
    _mujoco(300, "disc", "side_drag", side_drag=_between(0.12, 0.2)),
    _mujoco(300, "ellipse", "surface_tilt", surface_tilt=_between(0.05, 0.08, True)),
    _mujoco(150, "disc", "surface_tilt", surface_tilt=_between(0.05, 0.08, True)),
    _mujoco(300, "rectangle", "inertia_error", inertia_error=_between(0.3, 0.5)),
    _mujoco(300, "ellipse", "gravity_impulse", gravity_impulse=_gravity),
]
BELT = ("vt", "vx", "omega")
PYMUNK = [
    _pymunk(300, "disc"),
    _pymunk(300, "rectangle"),
    _pymunk(300, "disc", variables=BELT, belt=_between(0.4, 0.8, True)),
    _pymunk(300, "square", variables=BELT, belt=_between(0.4, 0.8, True)),
    _pymunk(300, "disc", "side_drag", "spin_damping", damping=_between(0.12, 0.2)),
    _pymunk(500, "rectangle", "side_drag", "spin_damping", damping=_between(0.12, 0.2)),
    _pymunk(300, "square", "shape_error", corner=_between(0.2, 0.35)),
    _pymunk(300, "rectangle", "com_offset", com=_ballast),
    _pymunk(150, "triangle", "surface_tilt", slope=_between(0.05, 0.08, True)),
    _pymunk(300, "square", "location_dependent_friction", grip=_between(0.5, 0.8, True)),
    _pymunk(300, "disc", "location_dependent_restitution", bounce=_between(0.08, 0.14, True)),
    _pymunk(150, "disc", "velocity_dependent_restitution", speed=_between(0.3, 0.6)),
]
