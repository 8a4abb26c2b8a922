"""Data sets for the studies: simulated and textbook drops, and mistakes of measurement."""

import math
from functools import cache

import torch
from torch import Tensor

from contactlearn.data.audit.corrections import correct
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.shapes import Ellipse, Shape
from contactlearn.simulation import hidden_effects, synthetic

Truth = dict


@cache
def simulated(
    seed: int,
    effects: tuple[str, ...] = (),
    size: int = 150,
    noise: float = 1.0,
    strength: tuple[float, float] = (2, 5),
) -> tuple[Impacts, Truth]:
    """Draw drops of `data=mystery` with their ground truth."""
    return hidden_effects.draw(seed, effects=list(effects), size=size, noise=noise, strength=strength)


def textbook(
    seed: int, size: int = 150, v: float = 0.01, omega: float = 0.5, shape: Shape | None = None, law: str = "wang_mason"
) -> Impacts:
    """Drops by a textbook law with noise of v (m/s) and omega (rad/s); friction and restitution come from the seed."""
    uniform = torch.rand(2, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    mu, eps = (0.08 + 0.3 * uniform[0]).item(), (0.3 + 0.5 * uniform[1]).item()
    return synthetic.load(
        size=size, law=law, mu=mu, eps=eps, velocity_noise=v, spin_noise=omega, seed=seed, shape=shape
    )


def drops(
    effects: tuple[str, ...], size: int, seed: int, strength: tuple[float, float] = (2, 5)
) -> tuple[Impacts, str]:
    """Draw drops with hidden effects, or textbook drops without, with their true law."""
    if not effects:
        return textbook(seed, size), "wang_mason"
    impacts, truth = simulated(seed, effects, size, strength=strength)
    return impacts, truth["law"]


def body(seed: int, flattest: float = 4.0) -> Ellipse:
    """An ellipse of a semi-axis of 5 to 100 mm, up to so many times as long as it is high."""
    length, ratio = torch.rand(2, generator=torch.Generator().manual_seed(seed)).tolist()
    a = 0.005 * 20**length
    return Ellipse((a, a / flattest**ratio))


def random(seed: int) -> torch.Generator:
    """A generator apart from those of the drops of the same seed."""
    return torch.Generator().manual_seed(987_654 + seed)


def between(low: float, high: float, seed: int) -> float:
    """A number that is log-uniform between two."""
    return low * (high / low) ** torch.rand((), generator=random(seed), dtype=torch.float64).item()


def some(impacts: Impacts, share: float, seed: int) -> Tensor:
    """A share of the trials, at least one, as a mask [n]."""
    chosen = torch.zeros(len(impacts), dtype=torch.bool)
    count = max(1, round(share * len(impacts)))
    chosen[torch.randperm(len(impacts), generator=random(seed))[:count]] = True
    return chosen


def after(impacts: Impacts, v_post: Tensor) -> Impacts:
    """The trials with other outcomes."""
    return impacts.replace(v_post=v_post, validate=False)


def heavy(impacts: Impacts, seed: int, scale: tuple[float, float, float] = (0.01, 0.01, 0.5)) -> Impacts:
    """Outcomes with further noise of Student's t with 2 degrees of freedom."""
    normal = torch.randn(len(impacts), 3, generator=random(seed), dtype=torch.float64)
    chi = torch.randn(len(impacts), 3, 2, generator=random(seed + 1), dtype=torch.float64).square().mean(-1).sqrt()
    return after(impacts, impacts.v_post + normal / chi * torch.tensor(scale, dtype=torch.float64))


def spiked(impacts: Impacts, rows: Tensor, seed: int, low: float, high: float) -> Impacts:
    """Outcomes of some trials off by low to high times 0.02 m/s or 1 rad/s in one component."""
    generator, n = random(seed), len(impacts)
    size = low * (high / low) ** torch.rand(n, generator=generator, dtype=torch.float64)
    size = size * (1 - 2 * torch.randint(2, (n,), generator=generator))
    component = torch.randint(3, (n,), generator=generator)
    step = torch.nn.functional.one_hot(component, 3) * torch.tensor((0.02, 0.02, 1.0), dtype=torch.float64)
    return after(impacts, impacts.v_post + (rows * size)[:, None] * step)


def shuffled(impacts: Impacts, share: float, seed: int) -> Impacts:
    """Outcomes of a share of the trials exchanged among them."""
    rows = some(impacts, share, seed).nonzero()[:, 0]
    v_post = impacts.v_post.clone()
    v_post[rows] = v_post[rows[torch.randperm(len(rows), generator=random(seed + 1))]]
    return after(impacts, v_post)


def _written(factors: dict[str, tuple[float, ...]]):
    def write(impacts: Impacts) -> Impacts:
        numbers = {field: torch.tensor(factor, dtype=torch.float64) for field, factor in factors.items()}
        changes = {f: getattr(impacts, f) * x for f, x in numbers.items() if getattr(impacts, f) is not None}
        return impacts.replace(validate=False, **changes)

    return write


_TURN, _MM = (1.0, 1.0, 180 / math.pi), (1e3, 1e3, 1.0)
SPOILT = {
    "degrees": _written(dict.fromkeys(("q", "q_post", "v_pre", "v_post"), _TURN)),
    "degrees_theta": _written(dict.fromkeys(("q", "q_post"), _TURN)),
    "degrees_omega": _written(dict.fromkeys(("v_pre", "v_post"), _TURN)),
    "millimetres": _written({"q": _MM, "q_post": _MM, "r": (1e3, 1e3)}),
    "millimetres_velocity": _written({"v_pre": _MM, "v_post": _MM}),
    "grams": _written({"mass": (1e3,)}),
}
"""Other units, by the correction that undoes them."""
MIRRORS = (
    "mirrored_x", "mirrored_y", "mirrored_theta", "contact_point_sign", "contact_point_mirrored", "swapped_axes",
    "swapped_pre_post",
)  # fmt: skip
"""Corrections that undo themselves."""


def spoilt(impacts: Impacts, *names: str) -> Impacts:
    """The data as a table with these mistakes would have them; `correct` with the same names undoes it."""
    for name in names:
        impacts = impacts.replace(validate=False)
        impacts = SPOILT[name](impacts) if name in SPOILT else correct(impacts, [name])
    return impacts


def heavier(impacts: Impacts, factor: float, rows: Tensor | None = None) -> Impacts:
    """Some trials, or all, with the inertia multiplied as written down."""
    rows = torch.ones(len(impacts), dtype=torch.bool) if rows is None else rows
    return impacts.replace(inertia=torch.where(rows, factor * impacts.inertia, impacts.inertia), validate=False)
