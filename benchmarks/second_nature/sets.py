"""All sets, by group.  A set follows from its seed; even seeds are of the half "learn", odd ones of "report".

The forms of the groups "other_…" were written from the literature by someone who had seen neither the catalogue of the
package nor the forms of the other groups.  These groups are of the half "report" alone.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from second_nature import bodies, engines, published
from second_nature.designs import TWINS
from second_nature.effect import Effect
from second_nature.forms import FORMS
from second_nature.noise import KINDS, TRACKERS
from second_nature.other_forms import OTHER
from second_nature.other_setup import OTHER_NAMES
from second_nature.planted import (
    Builders,
    Laboratory,
    balanced,
    draw,
    exact,
    laboratory_for,
    plant,
    said,
    scene_drops,
    scene_for,
)
from second_nature.setup import NAMES, RECENT, UNKNOWN
from second_nature.truth import Asked, Planted, PlantedSet, Truth

Make = Callable[[np.random.Generator, int], Planted]

CELLS = (
    (300, 0.5), (60, 0.5), (500, 0.3), (150, 0.6), (300, 0.2), (60, 0.35), (500, 0.08), (300, 0.8), (150, 0.3),
    (300, 0.1), (40, 0.6), (1000, 0.15), (60, 0.7), (500, 0.6), (300, 0.3), (150, 0.2), (2000, 0.06),
)  # fmt: skip
"""Trials and the share that single effects should have, in turn: an odd number, so that each falls into both halves."""
PAIRS = (
    ("velocity_dependent_restitution", "directional_friction"),
    ("com_offset", "side_drag"),
    ("rolling_resistance", "parameter_drift"),
    ("surface_tilt", "tangential_restitution"),
    ("inertia_error", "slip_dependent_restitution"),
    ("orientation_dependent_restitution", "spin_damping"),
    ("location_dependent_restitution", "load_dependent_friction"),
    ("configuration_dependent_restitution", "location_dependent_friction"),
    ("sampling_delay", "velocity_dependent_restitution"),
    ("shape_error", "velocity_dependent_friction"),
    ("contact_patch", "gravity_impulse"),
    ("adhesion", "surface_tilt"),
    ("orientation_offset", "side_drag"),
    ("tangential_restitution", "velocity_dependent_restitution"),
)
TRIPLES = (
    ("velocity_dependent_restitution", "com_offset", "side_drag"),
    ("location_dependent_restitution", "directional_friction", "spin_damping"),
    ("surface_tilt", "parameter_drift", "inertia_error"),
    ("orientation_dependent_restitution", "rolling_resistance", "load_dependent_friction"),
    ("slip_dependent_restitution", "contact_patch", "location_dependent_friction"),
    ("tangential_restitution", "velocity_dependent_restitution", "side_drag"),
)


def single(name: str, form: int, share: float) -> Make:
    """One effect in one of its forms."""

    def make(rng, n):
        effect = FORMS[name][form](rng)
        return plant(scene_for([effect], rng), n, share, rng, exact([effect]))

    return make


def several(names: Sequence[str], share: float) -> Make:
    """Two or three effects together."""

    def make(rng, n):
        scene = balanced(names, rng)
        return plant(scene, n, share, rng, exact(scene.effects))

    return make


def any_of(names: Sequence[str], count: int, forms: Builders = FORMS) -> Make:
    """So many effects of those names, whichever the seed draws, none of which makes less than 5 % of the error."""

    def make(rng, n):
        for _ in range(50):
            drawn = [str(name) for name in rng.choice(names, count, replace=False)]
            try:
                scene = balanced(drawn, rng, forms)
            except ValueError:  # no body suits them all, or one is always much smaller than the others
                continue
            planted = plant(scene, n, rng.uniform(0.2, 0.7), rng, exact(scene.effects))
            if min(planted.truth.shares) > 0.05:
                return planted
        raise ValueError(f"no {count} of {', '.join(names)} suit each other")

    return make


def nothing(kind: str, noise: str, level: float) -> Make:
    """Only the law, on a body of a kind, with an instrument's errors."""

    def make(rng, n):
        scene = scene_for((), rng, body=kind)
        laboratory = Laboratory(noise, level, laboratory_for(rng).scatter)
        record = draw(scene, n, laboratory, scene_drops(scene, rng, n), int(rng.integers(2**31)))
        return Planted(record.impacts(scene.body.shape), Truth(asked=Asked.EXACT, share=0.0, **said(laboratory)))

    return make


def memory(rng: np.random.Generator, n: int) -> Planted:
    """ε remembers the speed of the impact before: of one row alone nobody can tell, so no effect is there to name."""
    c = rng.uniform(0.08, 0.12)
    effect = Effect("unknown", "ε by the speed of the impact before", (), eps=lambda k: c * np.tanh(_before(k.speed)))
    return plant(scene_for([effect], rng), n, 0.3, rng, Truth(asked=Asked.EXACT))


def _before(speed):
    return np.roll(speed, 1) - speed.mean()


def by_body(rng: np.random.Generator, n: int) -> Planted:
    """Two to four bodies of one shape and different materials and masses, in turn or at random, and nothing else."""
    kind, count = str(rng.choice(bodies.KINDS)), int(rng.integers(2, 5))
    first, laboratory = scene_for((), rng, body=kind), laboratory_for(rng, level=0.02)
    drops, seed, owner = scene_drops(first, rng, n), int(rng.integers(2**31)), rng.integers(count, size=n)
    if rng.random() < 0.3:
        owner = np.sort(owner)
    tables = []
    for k in range(count):
        eps, mu = 0.4 + 0.45 * k / (count - 1), 0.3 / (1 + k)
        body = replace(first.body, mass=first.body.mass * rng.uniform(0.5, 2))
        scene = replace(first, eps=eps, mu=mu, body=body, restitution=first.restitution)
        tables.append(draw(scene, n, laboratory, drops, seed))
    rows = [tables[k].rows(slice(i, i + 1)) for i, k in enumerate(owner)]
    record = type(rows[0])(*(np.concatenate([getattr(r, f) for r in rows]) for f in vars(rows[0])))
    names = tuple("ABCD"[k] for k in owner)
    truth = Truth(asked=Asked.EXACT, share=0.0, **said(laboratory))
    return Planted(record.impacts(first.body.shape, names), truth)


def unknown(which: int) -> Make:
    """Physics that is in no catalogue."""

    def make(rng, n):
        effect = UNKNOWN[which](rng)
        truth = Truth(asked=Asked.UNKNOWN, variables=effect.variables, tolerated=effect.accepted)
        return plant(scene_for([effect], rng), n, rng.uniform(0.4, 0.7), rng, truth)

    return make


def twin(design, kind: str, name: str, form: int, rivals: tuple[str, ...]) -> Make:
    """An effect on drops that cannot tell it from its rivals."""

    def make(rng, n):
        effect = FORMS[name][form](rng)
        truth = Truth(asked=Asked.TWIN, effects=(effect.accepted,), rivals=rivals)
        return plant(scene_for([effect], rng, design, kind), n, 0.5, rng, truth)

    return make


def on_drops(effect: Callable[[np.random.Generator], Effect] | None) -> Make:
    """An effect on the published drops, or none."""

    def make(rng, n):
        return published.planted_on_drops(effect(rng) if effect else None, rng, n)

    return make


def _group(name: str, first: int, entries: Sequence[tuple[int, Make]]) -> list[PlantedSet]:
    """Sets of a group with seeds in a row from an even one."""
    return [PlantedSet(group=name, seed=first + i, n=n, make=make) for i, (n, make) in enumerate(entries)]


def _reported(name: str, first: int, entries: Sequence[tuple[int, Make]]) -> list[PlantedSet]:
    """Sets of a group with odd seeds alone."""
    return [PlantedSet(group=name, seed=first + 2 * i + 1, n=n, make=make) for i, (n, make) in enumerate(entries)]


def _singles() -> list[tuple[int, Make]]:
    forms = [(name, k) for name in NAMES for k in (0, 1)]
    forms += [(name, k) for name in NAMES for k in range(2, len(FORMS[name]))]
    forms += [(name, 0) for name in NAMES[1::5]]
    forms += [(name, k) for name in RECENT for k in (0, 1)]
    cells = [CELLS[i % len(CELLS)] for i in range(len(forms))]
    return [(n, single(name, k, share)) for (name, k), (n, share) in zip(forms, cells, strict=True)]


def _nothing() -> list[tuple[int, Make]]:
    sizes, levels = (60, 150, 300, 500, 300, 60, 1000), (0.01, 0.03, 0.06)
    cases = [(sizes[i % 7], nothing(bodies.KINDS[i % 5], KINDS[(i + i // 5) % 5], levels[i % 3])) for i in range(14)]
    return [*cases, (300, memory), (300, memory)]


def _other_one() -> list[tuple[int, Make]]:
    """Each name once, and then any."""
    names = [*((name,) for name in OTHER_NAMES), *[OTHER_NAMES] * (36 - len(OTHER_NAMES))]
    return [((60, 150, 300, 500)[i % 4], any_of(one, 1, OTHER)) for i, one in enumerate(names)]


_ANY = (*NAMES, *RECENT)

SETS: tuple[PlantedSet, ...] = (
    *_group("single", 1000, _singles()),
    *_group("pair", 2000, [((300, 500, 150)[i % 3], several(names, 0.55)) for i, names in enumerate(PAIRS)]),
    *_group("triple", 3000, [((500, 300, 1000)[i % 3], several(names, 0.6)) for i, names in enumerate(TRIPLES)]),
    *_group("any_one", 13000, [((60, 300, 150, 500)[i // 2 % 4], any_of(_ANY, 1)) for i in range(48)]),
    *_group("any_two", 14000, [((300, 500, 150)[i // 2 % 3], any_of(_ANY, 2)) for i in range(48)]),
    *_group("any_three", 15000, [((500, 300, 1000)[i // 2 % 3], any_of(_ANY, 3)) for i in range(24)]),
    *_reported("other_one", 16000, _other_one()),
    *_reported("other_two", 17000, [((150, 300, 500)[i % 3], any_of(OTHER_NAMES, 2, OTHER)) for i in range(24)]),
    *_reported("other_three", 18000, [((300, 500, 1000)[i % 3], any_of(OTHER_NAMES, 3, OTHER)) for i in range(12)]),
    *_group("none", 4000, _nothing()),
    *_group(
        "tracker",
        5000,
        [
            ((150, 300, 500)[i % 3], nothing(bodies.KINDS[i % 5], TRACKERS[i // 4], (0.03, 0.06)[i % 2]))
            for i in range(8)
        ],
    ),
    *_group("by_body", 6000, [((300, 150, 500)[i % 3], by_body) for i in range(6)]),
    *_group("unknown", 7000, [((300, 300, 500, 500, 150)[i % 5], unknown(i // 2)) for i in range(12)]),
    *_group("twin", 8000, [((150, 300)[i % 2], twin(*case)) for i, case in enumerate(TWINS)]),
    *_group("mujoco", 9000, engines.MUJOCO),
    *_group("pymunk", 10000, engines.PYMUNK),
    *_group("published", 11000, [(700, on_drops(effect)) for effect in (*published.ON_DROPS, None, None)]),
    *_group("table_tennis", 12000, [
        (199, published.table_tennis), (150, published.table_tennis),
        (120, published.table_tennis), (80, lambda rng, n: published.table_tennis(rng, n, slice(80)))]),
)  # fmt: skip
