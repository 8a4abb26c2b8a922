"""How a hidden effect is written down: a text, parameters and a change of the `World`.

Parameters are of two kinds: `Grows` vanishes with the size of the effect and is at its plausible limit
at size 1; `Within` is drawn once, whatever the size.  An effect may have several forms, of which one is
drawn.  The decorator `form` adds one under a name of the catalogue of effects, `uncatalogued` one under
another name:

    @form("adhesion", "parting costs the work w", w=Grows(0.02, "J", "plus"))
    def _(world, w):
        return replace(world, adhesion=w)
"""

import random
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import torch
from torch import Tensor

from contactlearn.simulation.hidden_effects.world import Here, World


@dataclass(frozen=True)
class Grows:
    """A parameter that is ± `limit` × size, times a share drawn from [`share`, 1]."""

    limit: float
    unit: str
    signs: Literal["both", "plus", "minus"] = "both"
    share: float = 1.0


@dataclass(frozen=True)
class Within:
    """A parameter that is drawn from [`low`, `high`]."""

    low: float
    high: float
    unit: str


@dataclass(frozen=True)
class Form:
    """One form of an effect: its text and parameters, and how it acts on a world."""

    text: str
    parameters: dict[str, Grows | Within]
    act: Callable[..., World]

    def draw(self, rng: random.Random) -> Callable[[float], dict[str, float]]:
        """The parameters as a function of the size in [0, 1]."""
        drawn = {}
        for name, parameter in self.parameters.items():
            if isinstance(parameter, Grows):
                sign = {"both": rng.choice((-1, 1)), "plus": 1, "minus": -1}[parameter.signs]
                drawn[name] = sign * parameter.limit * rng.uniform(parameter.share, 1)
            else:
                drawn[name] = rng.uniform(parameter.low, parameter.high)
        growing = {name for name, parameter in self.parameters.items() if isinstance(parameter, Grows)}
        return lambda size: {name: value * (size if name in growing else 1) for name, value in drawn.items()}


KNOWN: dict[str, list[Form]] = {}
OTHERS: dict[str, list[Form]] = {}


Act = Callable[..., World]


def _register(table: dict[str, list[Form]], name: str, text: str, **parameters: Grows | Within) -> Callable[[Act], Act]:
    def register(act: Act) -> Act:
        table.setdefault(name, []).append(Form(text, parameters, act))
        return act

    return register


form = partial(_register, KNOWN)
uncatalogued = partial(_register, OTHERS)


def later(world: World, change: Callable[[Here, Tensor], Tensor]) -> World:
    """The world in which `change`, (here, velocity) → velocity [N, 3], follows contact."""
    return replace(world, after=(*world.after, change))


def push(v: Tensor, x: Tensor | float = 0.0, y: Tensor | float = 0.0, spin: Tensor | float = 0.0) -> Tensor:
    """v [N, 3] changed by (x, y, spin)."""
    return torch.stack((v[:, 0] + x, v[:, 1] + y, v[:, 2] + spin), -1)
