"""Plausible ranges of parameters that suit the measurements, whatever the size, mass and speed of the body.

Effects declare ranges for bodies of some centimetres and grams at a few m/s.  Those of lengths, speeds, impulses and
energies go with the body where it is larger, heavier or faster than that, or smaller, lighter or slower.
"""

from collections.abc import Iterable
from dataclasses import replace

from contactlearn.effects import Parameter
from contactlearn.mechanics.impacts import Impacts

_SIZE = 0.003, 0.03  # m, radii of gyration for which the declared ranges hold as they are
_MASS = 0.001, 0.1  # kg
_SPEED = 0.3, 10.0  # m/s, of the contact point before contact


def suited(parameters: Iterable[Parameter], impacts: Impacts) -> tuple[Parameter, ...]:
    """Return parameters with ranges, and first values, in proportion to measurements."""
    size = _beyond((impacts.inertia / impacts.mass).sqrt().median().item(), *_SIZE)
    mass = _beyond(impacts.mass.median().item(), *_MASS)
    speed = _beyond(impacts.v_c.norm(dim=-1).median().item(), *_SPEED)
    factors = {"m": size, "m/s": speed, "s/m": 1 / speed, "N s": mass * speed, "J": mass * speed**2}
    return tuple(_times(p, factors.get(p.unit, 1.0)) for p in parameters)


def _beyond(value: float, least: float, most: float) -> float:
    """By which factor a value is outside of a range; 1 within."""
    return value / min(max(value, least), most)


def _times(p: Parameter, factor: float) -> Parameter:
    vanishing = None if p.vanishing is None else p.vanishing * factor
    return replace(p, low=p.low * factor, high=p.high * factor, start=p.start * factor, vanishing=vanishing)
