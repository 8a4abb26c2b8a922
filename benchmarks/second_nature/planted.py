"""Drawing a set: a scene, drops, noise of a size that gives the effects the share that is wanted."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from second_nature import bodies, noise
from second_nature.effect import Effect
from second_nature.forms import FORMS
from second_nature.nature import Design, Drops, Record, Scene, free, happen, measured
from second_nature.path import NEWTON, POISSON, STRONGE
from second_nature.share import law_error
from second_nature.truth import Asked, Planted, Truth

Builders = Mapping[str, Sequence[Callable[[np.random.Generator], Effect]]]
"""Forms by the name of their effect."""

LEVELS = (0.004, 0.15)  # m/s: no instrument is better, and none worth using is worse
SPARE = 1.4  # drops made for each that is kept: some do not approach, jam or touch with two corners


@dataclass(frozen=True)
class Laboratory:
    """An instrument: kind of noise, its level in m/s, and the scatter of (ε, μ) in a level of 1 m/s."""

    kind: str
    level: float
    scatter: tuple[float, float] = (0.0, 0.0)


PERFECT = Laboratory("gaussian", 0.0)
_LIKELY = {"ellipse": 2.0, "disc": 1.5, "rectangle": 1.0, "square": 0.7, "triangle": 0.7}


def scene_for(effects: Sequence[Effect], rng: np.random.Generator, design: Design = free, body: str = "") -> Scene:
    """A body on which the effects show, with a law whose restitution suits it."""
    kinds = [kind for kind in bodies.KINDS if all(kind in e.bodies for e in effects)]
    points = {e.point for e in effects} - {"either"}
    if not kinds or len(points) > 1:
        raise ValueError(f"no body and contact point suit {', '.join(e.form for e in effects)} together")
    weights = np.array([_LIKELY[kind] for kind in kinds])
    kind = body or str(rng.choice(kinds, p=weights / weights.sum()))
    sticky = any(e.rebound or (e.compliance and e.compliance.tangential) for e in effects)
    mu = rng.uniform(0.35, 0.6) if sticky else rng.uniform(0.12, 0.3)
    usual = (POISSON, STRONGE, NEWTON) if kind == "disc" or mu < 0.17 else (POISSON, STRONGE)
    return Scene(
        body=bodies.draw(kind, rng),
        mu=mu,
        eps=rng.uniform(0.5, 0.75),
        restitution=str(rng.choice(usual)),
        effects=tuple(effects),
        seen=points == {"seen"} or (not points and rng.random() < 0.5),
        design=design,
        in_time=any(e.compliance for e in effects),
    )


def draw(scene: Scene, n: int, laboratory: Laboratory, drops: Drops, seed: int) -> Record:
    """The first n valid rows of the table; the same seed gives a twin scene the same scatter and noise."""
    rng = np.random.default_rng(seed)
    scatter = rng.standard_normal((len(drops.x), 2)) * laboratory.scatter * laboratory.level
    record = measured(happen(scene, drops, scatter), laboratory.kind, laboratory.level, rng)
    kept = np.flatnonzero(record.valid)[:n]
    if len(kept) < n:
        raise ValueError(f"only {len(kept)} of {len(drops.x)} drops are valid, {n} are needed")
    return record.rows(kept)


def scene_drops(scene: Scene, rng: np.random.Generator, n: int) -> Drops:
    """Drops of a scene's design, and some to spare."""
    return scene.design(rng, int(SPARE * n) + 20, scene.body)


def level_for(scene: Scene, drops: Drops, share: float, laboratory: Laboratory) -> float:
    """The level of noise at which the effects make about `share` of the law's error.

    Errors of independent causes add by squares: e₀ = d (1 − s)/√(1 − (1 − s)²) for an effect that alone makes d.
    """
    n = int(len(drops.x) * 0.7)
    effect, _ = law_error(draw(scene, n, PERFECT, drops, 0), scene.restitution)
    wanted = effect * (1 - share) / np.sqrt(1 - (1 - share) ** 2)
    trial = replace(laboratory, level=0.03)
    made, _ = law_error(draw(replace(scene, effects=()), n, trial, drops, 0), scene.restitution)
    return float(np.clip(trial.level * wanted / made, *LEVELS))


def shares(scene: Scene, n: int, laboratory: Laboratory, drops: Drops, seed: int) -> tuple[float, tuple[float, ...]]:
    """The share of all effects, and of each: of what the law's error loses without it."""

    def error(effects):
        return law_error(draw(replace(scene, effects=effects), n, laboratory, drops, seed), scene.restitution)[0]

    effects, whole = scene.effects, error(scene.effects)
    each = [1 - error(effects[:k] + effects[k + 1 :]) / whole for k in range(len(effects))]
    return (each[0] if len(each) == 1 else 1 - error(()) / whole), tuple(each)


def laboratory_for(rng: np.random.Generator, level: float = 0.03, kinds: Sequence[str] = noise.KINDS) -> Laboratory:
    """An instrument of a random kind; ε and μ scatter in half of them (0.02 and a tenth at 0.03 m/s)."""
    kind = "gaussian" if rng.random() < 0.4 and "gaussian" in kinds else str(rng.choice(kinds))
    return Laboratory(kind, level, (0.6, 3.0) if rng.random() < 0.5 else (0.0, 0.0))


def plant(scene: Scene, n: int, share: float, rng: np.random.Generator, truth: Truth) -> Planted:
    """The set of a scene with its effects at about a share of the law's error; the truth learns what it came to."""
    laboratory, drops, seed = laboratory_for(rng), scene_drops(scene, rng, n), int(rng.integers(2**31))
    laboratory = replace(laboratory, level=level_for(scene, drops, share, laboratory))
    record = draw(scene, n, laboratory, drops, seed)
    total, each = shares(scene, n, laboratory, drops, seed)
    truth = replace(truth, share=total, shares=each, **said(laboratory, scene.effects))
    return Planted(record.impacts(scene.body.shape), truth)


def said(laboratory: Laboratory, effects: Sequence[Effect] = ()) -> dict:
    """What a truth says of the instrument and the forms."""
    kind = laboratory.kind + (" and scatter" if any(laboratory.scatter) else "")
    return {"noise": kind, "level": laboratory.level, "forms": tuple(e.form for e in effects)}


def balanced(names: Sequence[str], rng: np.random.Generator, forms: Builders = FORMS) -> Scene:
    """A scene with a form for each name, none of which alone makes less than 0.6 of the error that another makes."""
    for _ in range(100):
        scene = scene_for(_chosen(names, rng, forms), rng)
        drops = scene_drops(scene, rng, 120)
        alone = [draw(replace(scene, effects=(one,)), 120, PERFECT, drops, 0) for one in scene.effects]
        errors = [law_error(record, scene.restitution)[0] for record in alone]
        if min(errors) > 0.6 * max(errors):
            return scene
    raise ValueError(f"no forms of {', '.join(names)} are of like size")


def _chosen(names: Sequence[str], rng: np.random.Generator, forms: Builders) -> tuple[Effect, ...]:
    """One form for each name, such that one body and one kind of table suit all and none is integrated in time."""
    for _ in range(200):
        effects = tuple(forms[name][rng.integers(len(forms[name]))](rng) for name in names)
        points = {e.point for e in effects} - {"either"}
        kinds = set.intersection(*(set(e.bodies) for e in effects))
        if len(points) <= 1 and kinds and not any(e.compliance for e in effects):
            return effects
    raise ValueError(f"no forms of {', '.join(names)} suit each other")


def exact(effects: Sequence[Effect]) -> Truth:
    """The truth that asks for these effects and no other."""
    return Truth(asked=Asked.EXACT, effects=tuple(e.accepted for e in effects))
