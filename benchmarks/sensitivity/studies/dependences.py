"""Drops whose coefficients, outcomes or errors depend on the sequence or the state, and a study of them."""

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import torch
from torch import Tensor

from contactlearn import laws
from contactlearn.core.numerics import random as drawn
from contactlearn.diagnosis.result import SerialDependence, StateDependence
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.diagnosis.unexplained.serial_dependence import find_serial_dependence
from contactlearn.diagnosis.unexplained.state_dependence import find_state_dependence
from contactlearn.effects import Effect, State, find_effect
from contactlearn.inference.identification import joint
from contactlearn.inference.identification.joint import Fit, FitOptions
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.shapes import Ellipse
from contactlearn.models.contact_model import predict_with
from contactlearn.simulation import synthetic
from sensitivity.studies.cases import between, random
from sensitivity.study import Study, each

Follows = Callable[[State, Tensor, torch.Generator], Tensor]
"""Values [n] that a coefficient follows, from the states, the predicted wrench [n, 3], and a source of chance."""


def _before(x: Tensor) -> Tensor:
    return torch.cat((x.mean()[None], x[:-1]))


def _sawtooth(state: State, wrench: Tensor, generator: torch.Generator) -> Tensor:
    period = int(torch.randint(7, 60, (), generator=generator))
    return (state.order + torch.randint(period, (), generator=generator)).remainder(period)


def _sine(state: State, wrench: Tensor, generator: torch.Generator) -> Tensor:
    turns = 2 * math.pi / (5 + 55 * drawn(torch.rand, (1,), generator))
    return (turns * state.order + 6 * drawn(torch.rand, (1,), generator)).sin()


def _walk(state: State, wrench: Tensor, generator: torch.Generator) -> Tensor:
    steps, keep = drawn(torch.randn, (len(state.order),), generator), 0.7 + 0.27 * torch.rand((), generator=generator)
    values = [steps[0]]
    for step in steps[1:]:
        values.append(keep * values[-1] + (1 - keep**2).sqrt() * step)
    return torch.stack(values)


def _changed(state: State, wrench: Tensor, generator: torch.Generator) -> Tensor:
    """A surface that is changed every 20 trials or so, each worse or better by chance."""
    lots = drawn(torch.rand, (len(state.order),), generator)
    return drawn(torch.randn, (len(lots),), generator)[(lots < 0.05).cumsum(0)]


def _heated(state: State, wrench: Tensor, generator: torch.Generator) -> Tensor:
    """Warmed by every impact, and cooling."""
    warm, values = torch.zeros(()), []
    for heat in wrench[:, 1].square() / wrench[:, 1].square().mean():
        values.append(warm)
        warm = 0.75 * warm + heat
    return torch.stack(values).to(torch.float64)


def _hits(state: State, keep: float, generator: torch.Generator) -> Tensor:
    """Earlier impacts near the place of each, all or the last ten."""
    place = state.x + state.r[..., 0]
    width = (0.05 + 0.1 * torch.rand((), generator=generator)) * (place.max() - place.min())
    near = (-0.5 * ((place[:, None] - place) / width).square()).exp()
    ago = (state.order[:, None] - state.order - 1).clamp_min(0)
    return (near * keep**ago).tril(-1).sum(-1)


FOLLOWS: Mapping[str, Follows] = {
    "sawtooth": _sawtooth,
    "sine": _sine,
    "walk": _walk,
    "changed": _changed,
    "last speed": lambda state, wrench, generator: _before(state.v_n.abs()),
    "last slip": lambda state, wrench, generator: _before(state.v_t),
    "last spin rate": lambda state, wrench, generator: _before(state.omega.abs()),
    "heated": _heated,
    "worn place": lambda state, wrench, generator: _hits(state, 1.0, generator),
    "dented place": lambda state, wrench, generator: _hits(state, 0.9, generator),
}
"""What a coefficient may follow along the sequence."""


def _turn(generator: torch.Generator) -> float:
    return 2 * math.pi * torch.rand((), generator=generator).item()


def _along(x: Tensor) -> Tensor:
    """From 0 to 1 over the range."""
    return (x - x.min()) / (x.max() - x.min())


def _above(x: Tensor, share: float = 0.5) -> Tensor:
    """A step at a quantile, a little soft."""
    return ((x - x.quantile(share)) / (0.08 * x.std())).tanh()


def _curtain(state: State) -> Tensor:
    """A curtain that is touched from some place on, with the body's upper side."""
    push = (state.x - state.x.quantile(0.7)).clamp_min(0)
    return torch.stack((-push, 0 * push, 0.5 * push / state.r.norm(dim=-1)), -1)


DEPENDS: Mapping[str, tuple[str, Follows]] = {
    "direction and angle": ("mu", lambda s, w, g: s.v_t.sign() * (2 * s.theta + _turn(g)).sin()),
    "friction power": ("mu", lambda s, w, g: -_above((s.v_n * s.v_t).abs().log())),
    "stripes by direction": ("mu", lambda s, w, g: s.v_t.sign() * (4 * math.pi * _along(s.x)).sin()),
    "side and angle": ("mu", lambda s, w, g: (s.theta + _turn(g)).sin() * _above(s.x)),
    "spin threshold": ("mu", lambda s, w, g: _above(s.omega.abs())),
    "direction, spin and angle": ("mu", lambda s, w, g: (s.v_t * s.omega).sign() * (s.theta + _turn(g)).cos()),
    "place and angle": ("eps", lambda s, w, g: (2 * s.theta + _turn(g)).cos() * (_along(s.x) - 0.5)),
    "spin with slip": ("eps", lambda s, w, g: (s.omega * s.v_t).sign()),
    "yield energy": ("eps", lambda s, w, g: -_above((s.v_n.square() / s.W[..., 1, 1]).log(), 0.6)),
    "two thresholds": ("eps", lambda s, w, g: (1 + _above(s.x, 0.45)) * (1 + _above(s.v_n.abs(), 0.45))),
    "ringing": ("eps", lambda s, w, g: (2 * math.pi * 4.5 * _along(s.v_n) + _turn(g)).sin()),
    "travelling wave": ("eps", lambda s, w, g: (s.theta - 2 * math.pi * 2.5 * _along(s.x)).sin()),
    "Magnus": ("velocity", lambda s, w, g: torch.stack((-s.omega * s.v_n, 0.5 * s.omega * s.v_t, 0 * s.x), -1)),
    "curtain": ("velocity", lambda s, w, g: _curtain(s)),
    "magnet": (
        "velocity",
        lambda s, w, g: torch.stack((0 * s.x, 0 * s.x, (s.theta - 6 * math.pi * _along(s.x)).sin() / s.v_n.abs()), -1),
    ),
}
"""What a coefficient, or the velocities after impact, may depend on in the state of each trial."""


LAWS = ("wang_mason", "mirtich", "anitescu_potra_poisson")
NAMED: Mapping[str, tuple[float, ...]] = {
    "spin_damping": (0.15,),
    "directional_friction": (0.3,),
    "parameter_drift": (0.15,),
    "surface_tilt": (0.02,),
}
"""Effects of the simulation that the fitted model has."""

ERRORS = ("iid", "heavy", "ar1", "weak ar1", "wander", "hetero", "before")
"""Errors of measurement; `before` are errors of v_pre as large as those of v_post."""
DESIGNS = ("drops", "throws", "ascending", "turned")
"""How bodies are thrown: dropped, thrown to both sides, ever faster, each orientation many times in a row."""
NARROW, BODIES = "alike", "two bodies"
"""Two designs more: throws within 5 % of each other, and two bodies in turn."""


class Drops(NamedTuple):
    """Drops with the true model fitted to them."""

    impacts: Impacts
    fit: Fit


def made(
    seed: int,
    *,
    size: int = 300,
    design: str = "throws",
    errors: str = "iid",
    follows: str = "",
    coefficient: str = "mu",
    strength: float = 1.0,
    named: str = "",
    missed: float = 0.0,
) -> Drops:
    """Make drops and fit the true model, without what follows the sequence.

    Args:
        seed: of everything.
        size: trials.
        design: of `DESIGNS`.
        errors: of `ERRORS`.
        follows: of `FOLLOWS` or `DEPENDS`; nothing if empty.
        coefficient: mu or eps; or velocity, for the outcome whatever the impact.
        strength: size of what follows the sequence, in standard deviations of the noise.
        named: of `NAMED`, in the simulation and in the model; nothing if empty.
        missed: size of a restitution over orientation that the model lacks, likewise.
    """
    generator = random(seed)
    law, mu, eps = laws.find(LAWS[seed % len(LAWS)]), between(0.12, 0.4, seed), between(0.35, 0.75, seed + 1)
    impacts = _thrown(design, size, generator)
    effects = {named: find_effect(named)().prepare(impacts).at(NAMED[named])} if named else {}
    coefficients = torch.tensor((mu, eps), dtype=torch.float64).repeat(size, 1)
    base = predict_with(law, impacts, coefficients, effects)
    noise = between(0.015, 0.06, seed + 2) * torch.tensor((1.0, 1.0, 15.0), dtype=torch.float64)
    shift = torch.zeros(size, 3, dtype=torch.float64)
    if follows:
        own = FOLLOWS[follows] if follows in FOLLOWS else DEPENDS[follows][1]
        change = own(State.of(impacts), base.wrench, generator)
        if coefficient == "velocity":
            shift = change - change.mean(0)
            shift = strength * shift / (shift / noise).square().mean().sqrt()
        else:
            change = _standard(change)
            coefficients = _scaled(impacts, law, effects, coefficients, coefficient, change, strength, noise)
    if missed:
        change = _standard((2 * State.of(impacts).theta).cos())
        coefficients = _scaled(impacts, law, effects, coefficients, "eps", change, missed, noise)
    exact = predict_with(law, impacts, coefficients, effects).v_post + shift
    after = _errors(errors, exact, generator) * noise
    before = drawn(torch.randn, (size, 3), generator) * noise if errors == "before" else torch.zeros(size, 3)
    impacts = impacts.replace(v_pre=impacts.v_pre + before, v_post=exact + after, validate=False)
    impacts = impacts[impacts.v_c[:, 1] < -0.01].replace(validate=True)
    fitted = {named: find_effect(named)()} if named else {}
    return Drops(impacts, joint.fit(impacts, law, fitted, options=FitOptions(starts=4)))


def _standard(x: Tensor) -> Tensor:
    return (x - x.mean()) / x.std()


def _thrown(design: str, size: int, generator: torch.Generator) -> Impacts:
    """States before impact; outcomes are still to be made."""
    seed = int(torch.randint(2**31, (), generator=generator))
    kinds = {"drops": Ellipse((0.035, 0.025)), "turned": Ellipse((0.05, 0.03))}
    impacts = synthetic.load(
        3 * size, "wang_mason", 0.2, 0.5, kinds.get(design), velocity_noise=0.0, spin_noise=0.0, seed=seed
    )
    if design == "drops":
        return impacts[:size]
    if design == BODIES:
        other = synthetic.load(
            3 * size, "wang_mason", 0.2, 0.5, Ellipse((0.05, 0.03)), 0.08, velocity_noise=0.0, spin_noise=0.0, seed=seed
        )
        second = torch.arange(3 * size) % 2 == 1
        mixed = {
            name: torch.where(second.view(-1, *[1] * (own.ndim - 1)), getattr(other, name), own)
            for name in ("mass", "inertia", "r", "q")
            if (own := getattr(impacts, name)) is not None
        }
        names = tuple("second" if one else "first" for one in second.tolist())
        impacts = impacts.replace(**mixed, v_post=impacts.v_pre, object=names, shape=None, validate=False)
    speed = 1 + 2.5 * drawn(torch.rand, (3 * size,), generator)
    if design == "ascending":
        speed = speed.sort().values
    down = math.radians(25) + math.radians(50) * drawn(torch.rand, (3 * size,), generator)
    side = 2.0 * torch.randint(0, 2, (3 * size,), generator=generator) - 1
    spin = 9 * drawn(torch.randn, (3 * size,), generator)
    v_pre = torch.stack((side * speed * down.cos(), -speed * down.sin(), spin), -1)
    if design == NARROW:
        v_pre = torch.tensor((0.8, -2.0, 3.0)) + 0.1 * drawn(torch.randn, (3 * size, 3), generator)
    impacts = impacts.replace(v_pre=v_pre, v_post=v_pre, validate=False)
    if design == "turned":
        impacts = impacts[(impacts.q[:, 2] / (math.pi / 6)).round().argsort(stable=True)]
    impacts = impacts[impacts.v_c[:, 1] < -0.2]
    kept = torch.linspace(0, len(impacts) - 1, size).round().long()
    order = torch.arange(1, size + 1)
    return impacts[kept].replace(order=order, trial=tuple(map(str, order.tolist())), validate=True)


def _scaled(
    impacts: Impacts, law: Any, effects: Mapping[str, Effect], at: Tensor, name: str, change: Tensor, size: float,
    noise: Tensor,
) -> Tensor:  # fmt: skip
    """Coefficients [n, 2] of which one changes v_post by `size` standard deviations of the noise."""
    k, before = ("mu", "eps").index(name), predict_with(law, impacts, at, effects).v_post
    low, high = 0.0, 0.6
    moved = at.clone()
    for _ in range(30):
        middle = (low + high) / 2
        moved[:, k] = (at[:, k] + middle * change).clamp(0.01, 2.0 if k == 0 else 0.98)
        off = (predict_with(law, impacts, moved, effects).v_post - before) / noise
        low, high = (middle, high) if off.square().mean().sqrt() < size else (low, middle)
    return moved


def _errors(kind: str, exact: Tensor, generator: torch.Generator) -> Tensor:
    """Standardised errors [n, 3]."""
    z = drawn(torch.randn, tuple(exact.shape), generator)
    if kind == "heavy":
        z = z / drawn(torch.randn, (len(z), 4), generator).square().mean(-1, keepdim=True).sqrt() / math.sqrt(2)
    if kind in ("ar1", "weak ar1"):
        keep = 0.5 + 0.45 * torch.rand((), generator=generator, dtype=torch.float64)
        rows = [z[0]]
        for step in z[1:]:
            rows.append(keep * rows[-1] + (1 - keep**2).sqrt() * step)
        share = 1.0 if kind == "ar1" else 0.15
        z = math.sqrt(share) * torch.stack(rows) + math.sqrt(1 - share) * drawn(torch.randn, tuple(z.shape), generator)
    if kind == "wander":
        slow = drawn(torch.randn, tuple(z.shape), generator).cumsum(0)
        z = 0.5 * (slow - slow.mean(0)) / slow.std(0) + 0.87 * z
    if kind == "hetero":
        z = z * (0.3 + exact.norm(dim=-1, keepdim=True) / exact.norm(dim=-1).mean())
    return z


def serial_dependence(drops: Drops, thresholds: Thresholds) -> SerialDependence | None:
    """Test for serial dependence as a diagnosis does."""
    return find_serial_dependence(drops.impacts, drops.fit, FitOptions(), thresholds)


def state_dependence(drops: Drops, thresholds: Thresholds, block: int = 1) -> StateDependence | None:
    """Test for state dependence where no model is better than the fitted one."""
    return find_state_dependence(drops.impacts, drops.fit, drops.fit, FitOptions(), thresholds, block)


def _studied(kind: str, seed: int) -> Drops:
    """Drops whose errors are of a kind, or of which something depends faintly on the state."""
    if kind in DEPENDS:
        return made(seed, follows=kind, coefficient=DEPENDS[kind][0], strength=between(0.25, 1.0, seed), size=200)
    return made(seed, errors=kind, design=DESIGNS[seed % len(DESIGNS)], size=200)


_NULL = each(8, "iid", "heavy", "before")
_PLANTED = each(6, "direction and angle", "spin with slip", "curtain")
STATE = Study(
    name="state", null=_NULL, planted=_PLANTED, prepare=_studied,
    alarm=lambda drops, thresholds: state_dependence(drops, thresholds) is not None,
)  # fmt: skip
