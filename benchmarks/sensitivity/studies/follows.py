"""What a coefficient, or the outcome, may follow in planted sets: the sequence of the trials, or the state of each."""

import math
from collections.abc import Callable, Mapping

import torch
from torch import Tensor

from contactlearn.core.numerics import random as drawn
from contactlearn.effects import State

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
