"""Effects added to measured outcomes: the published ellipse drops, and the bounces of a table-tennis ball.

Measured drops have effects of their own.  The difference that nature's path makes with and without an effect, from the
measured states, is added to the measured velocity after contact, noise and all: the planted effect must be named.
Table tennis is not planted: tangential restitution is the ball's first effect, restitution that falls with speed the
second (Gossard et al. 2026).

The share is 1 − e₀/√(e₀² + d²): e₀ is the error of the law on the drops as measured, d that on the path's own outcomes
with the effect, which have nothing else.
"""

import csv
import os
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np
import torch

from contactlearn.data.ellipse_drops import load
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.shapes import Disc
from second_nature import path
from second_nature.effect import Circumstances, Effect
from second_nature.nature import Record
from second_nature.path import Contacts
from second_nature.planted import Planted
from second_nature.share import law_error
from second_nature.truth import Asked, Truth


@cache
def mirrored() -> Impacts:
    """The published drops with x mirrored (positions and velocities along the floor), which closes the momentum."""
    drops = load(inertia="uniform_disc")
    flip = torch.tensor([-1.0, 1.0, 1.0], dtype=torch.float64)
    return drops.replace(q=drops.q * flip, v_pre=drops.v_pre * flip, v_post=drops.v_post * flip, q_post=None)


def planted_on_drops(effect: Effect | None, rng: np.random.Generator, n: int) -> Planted:
    """The effect on n of the mirrored drops, in their order; without an effect, the drops as they are."""
    drops = mirrored()
    drops = drops[np.sort(rng.choice(len(drops), n, replace=False)).tolist()].replace(
        trial=tuple(str(i + 1) for i in range(n)), order=np.arange(1, n + 1), source="measurements"
    )
    if effect is None:
        return Planted(drops, Truth(asked=Asked.INCLUDES, forms=("as measured",)))
    record = Record(
        *(getattr(drops, name).numpy() for name in ("mass", "inertia", "r", "q", "v_pre", "v_post")), np.ones(n, bool)
    )
    before, (mu, eps) = law_error(record, path.STRONGE)
    planted = _outcome(record, effect, mu, eps)
    change = np.nan_to_num(planted - _outcome(record, None, mu, eps))
    alone, _ = law_error(replace(record, v_post=np.where(np.isfinite(planted), planted, record.v_post)), path.STRONGE)
    share = float(1 - before / np.hypot(before, alone))
    truth = Truth(asked=Asked.INCLUDES, effects=(effect.accepted,), forms=(effect.form,), share=share, shares=(share,))
    return Planted(drops.replace(v_post=record.v_post + change), truth)


def _outcome(record: Record, effect: Effect | None, mu: float, eps: float) -> np.ndarray:
    """Velocity after contact of nature's path with the effect, from the measured states."""
    n = len(record.mass)
    contacts = Contacts(record.mass, record.inertia, record.r, record.v, np.full(n, mu), np.full(n, eps))
    if effect is None:
        return path.impact(contacts, path.STRONGE).v
    known = Circumstances(contacts, record.q[:, 2], record.q[:, 0], np.arange(n) / n)
    contacts = replace(
        contacts,
        eps=np.clip(eps + (effect.eps(known) if effect.eps else 0 * contacts.eps), 0.02, 0.98),
        mu=mu * (effect.mu(known) if effect.mu else 1 + 0 * contacts.mu),
    )
    lever = None if effect.moment is None else lambda v: effect.moment(known, v)
    v = path.impact(contacts, path.STRONGE, path.Extras(effect.friction, lever)).v
    return v if effect.after is None else effect.after(replace(known, contacts=contacts), v)


def _softer(k, at, c):
    return c * np.cos(k.theta - at)


def _effect(name, text, **hooks):
    return lambda rng: Effect(name, text, (name,), **{hook: build(rng) for hook, build in hooks.items()})


ON_DROPS = (
    _effect("side_drag", "a share that levels off with speed",
            after=lambda rng, c=0.25: lambda k, v: v * (1 - c * np.tanh(_speed(v) / 0.5) * [1, 1, 0])),
    _effect("side_drag", "quadratic in the speed",
            after=lambda rng, c=0.25: lambda k, v: v / (1 + c * _speed(v) * [1, 1, 0])),
    _effect("spin_damping", "quadratic in the spin",
            after=lambda rng, c=0.012: lambda k, v: v / (1 + c * np.abs(v[:, 2:]) * [0, 0, 1])),
    _effect("spin_damping", "a moment during contact, proportional to the present spin",
            moment=lambda rng, b=0.6: lambda k, v: -b * k.rho**2 * v[:, 2] / k.speed),
    _effect("rolling_resistance", "a constant arm against the present spin",
            moment=lambda rng, arm=0.08: lambda k, v: -arm * k.rho * np.tanh(v[:, 2] / 0.3)),
    _effect("contact_patch", "a lop-sided pad: τ = c P_n",
            moment=lambda rng, arm=0.1: lambda k, v: arm * k.rho),
    _effect("orientation_dependent_restitution", "a first harmonic over θ",
            eps=lambda rng: partial(_softer, at=rng.uniform(-np.pi, np.pi), c=0.1)),
    _effect("orientation_dependent_restitution", "a first harmonic over θ",
            eps=lambda rng: partial(_softer, at=rng.uniform(-np.pi, np.pi), c=0.07)),
    _effect("parameter_drift", "ε settles",
            eps=lambda rng: lambda k: 0.25 * (np.exp(-k.share / 0.3) - 0.3)),
    _effect("parameter_drift", "ε jumps",
            eps=lambda rng: lambda k: 0.07 * np.sign(k.share - 0.6)),
    _effect("location_dependent_restitution", "two plates side by side",
            eps=lambda rng: lambda k: 0.07 * np.tanh((k.x + 0.37) / 0.01)),
    _effect("slip_dependent_restitution", "saturates with the slip",
            eps=lambda rng: lambda k: 0.5 * (np.abs(k.slip) / (np.abs(k.slip) + 0.6) - 0.5)),
)  # fmt: skip
"""Effects that 700 of these drops can show: their speed of fall hardly varies, and their slip has one sign."""


def _speed(v):
    return np.hypot(v[:, :1], v[:, 1:2])


def table_tennis(rng: np.random.Generator, n: int, rows: slice = slice(None)) -> Planted:
    """Bounces of the racket's file: all, or those of one angle, in their order."""
    root = os.environ.get("CONTACTLEARN_DATA", Path(__file__).resolve().parents[2] / "data")
    with (Path(root) / "table_tennis" / "racket_01.csv").open(newline="") as file:
        lines = list(csv.DictReader(file))[rows]
    picked = np.sort(rng.choice(len(lines), min(n, len(lines)), replace=False))

    def columns(*names):
        values = np.array([[float(lines[i][name]) for name in names] for i in picked])
        return values[:, 0] if len(names) == 1 else values

    impacts = Impacts(
        columns("mass"), columns("inertia"), columns("rx", "ry"), columns("x", "y", "theta"),
        columns("vx", "vy", "omega"), columns("vx_post", "vy_post", "omega_post"),
        shape=Disc(0.02), source="measurements",
    )  # fmt: skip
    expected = (("tangential_restitution",), ("velocity_dependent_restitution",))
    return Planted(impacts, Truth(asked=Asked.ORDERED, effects=expected, forms=("measured",)))
