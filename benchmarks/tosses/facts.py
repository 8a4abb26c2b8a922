"""Hidden facts of tosses in space, their sizes, and the sets of both halves.

A laboratory reports a uniform ellipsoid or box of stated size on a level floor, the pose at contact, and velocities of
the geometric centre before and after it, with noise.  Facts are what is other than reported.  Names are right where
their formula contains the fact; they were decided from the physics before any answer.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import combinations

import torch
from torch import Tensor

from blind.judge import Truth
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.shapes import Cuboid, Ellipsoid

HALF, MASS = (0.05, 0.035, 0.025), 0.15  # m, kg
NOISE = torch.tensor((0.01,) * 3 + (0.3,) * 3, dtype=torch.float64)
ACCEPTED = {
    "centre": {"com_offset"}, "inertia": {"inertia_error"}, "tilt": {"surface_tilt"}, "torsion": {"torsional_friction"},
    "delay": {"sampling_delay", "gravity_impulse"}, "size": {"shape_error"}, "bodies": {"body_dependent_friction"},
}  # fmt: skip
"""Names that are right for each fact that both simulators can hide."""
ACCEPTED_OF_IMPULSE = {
    "late": {"sampling_delay"}, "speed": {"velocity_dependent_restitution"}, "slip": {"velocity_dependent_friction"},
    "place": {"location_dependent_friction"}, "damping": {"spin_damping"}, "drag": {"side_drag"},
    "wear": {"parameter_drift"},
}  # fmt: skip
"""Likewise of those that the simulator in steps of impulse can hide alone."""
UNKNOWN = {
    "stripes": ("mu", "x"), "magnet": (None, "orientation"), "lift": (None, "spin"),
}  # fmt: skip
"""Facts that no catalogue has: the coefficient that varies and a variable that it depends on."""


@dataclass(frozen=True, kw_only=True)
class Facts:
    """What a set hides, and how it was thrown.  Lengths in m, angles in rad, times in s."""

    hidden: tuple[str, ...]
    kind: str
    mu: tuple[float, ...]
    eps: float
    energetic: bool = False
    centre: tuple[float, ...] = (0.0, 0.0, 0.0)
    inertia: float = 0.0
    tilt: tuple[float, float] = (0.0, 0.0)
    torsion: float = 0.0
    delay: float = 0.0
    size: tuple[float, ...] = field(default=(1.0, 1.0, 1.0))
    late: float = 0.0
    speed: float = 0.0
    slip: float = 0.0
    place: float = 0.0
    damping: float = 0.0
    drag: float = 0.0
    wear: float = 0.0
    magnet: float = 0.0
    lift: float = 0.0

    def shape(self) -> Ellipsoid | Cuboid:
        """Return the stated shape."""
        return (Ellipsoid if self.kind == "ellipsoid" else Cuboid)(HALF)

    def inertia_stated(self) -> Tensor:
        """Return the principal moments of the stated body, kg m²."""
        square = torch.tensor(HALF).double() ** 2 * MASS / (5 if self.kind == "ellipsoid" else 3)
        return square.sum() - square


def draw(hidden: tuple[str, ...], seed: int) -> Facts:
    """Draw the sizes of hidden facts."""
    generator = torch.Generator().manual_seed(seed)

    def between(low: float, high: float) -> float:
        return low + (high - low) * torch.rand((), generator=generator).item()

    def signed(low: float, high: float) -> float:
        return between(low, high) * (1 if between(0, 1) < 0.5 else -1)

    mu, other, eps = between(0.1, 0.3), between(0.1, 0.2), between(0.4, 0.7)
    facts: dict[str, object] = {
        "centre": tuple(signed(0.001, 0.003) for _ in range(3)), "inertia": signed(0.1, 0.25),
        "tilt": (signed(0.015, 0.05), signed(0.015, 0.05)), "torsion": between(0.003, 0.01),
        "delay": between(2e-3, 5e-3), "size": (1.0, 1 + signed(0.05, 0.1), 1.0),
        "late": signed(3e-3, 8e-3), "speed": between(0.1, 0.25), "slip": between(0.5, 1.5), "place": signed(0.3, 0.6),
        "damping": between(0.05, 0.2), "drag": between(0.03, 0.1), "wear": between(0.15, 0.4),
        "magnet": signed(3e-4, 8e-4), "lift": signed(0.03, 0.08),
    }  # fmt: skip
    kind = "box" if seed % 2 and "delay" not in hidden else "ellipsoid"  # a box soon touches with another corner
    several = "bodies" in hidden or "stripes" in hidden
    return Facts(
        hidden=hidden, kind=kind, mu=(mu, mu + other) if several else (mu,), eps=eps, energetic=between(0, 1) < 0.5,
        **{name: facts[name] for name in hidden if name in facts},
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Toss:
    """A set: its maker and half, its seed, which is its name, and the facts that it hides."""

    suite: str
    half: str
    seed: int
    hidden: tuple[str, ...]

    def truth(self) -> Truth:
        """Return the ground truth as `blind.judge` reads it."""
        known = ACCEPTED | ACCEPTED_OF_IMPULSE
        accepted = [sorted(known[name]) for name in self.hidden if name in known]
        unknown = [UNKNOWN[name] for name in self.hidden if name in UNKNOWN]
        return Truth(
            group=f"{self.suite}: {('nothing', 'one', 'two')[len(self.hidden)] if not unknown else 'unknown'}",
            question="unknown" if unknown else "effects" if self.hidden else "nothing",
            n=0, half=self.half, hidden=self.hidden, accepted=accepted,
            coefficient=unknown[0][0] if unknown else None, variables=[one[1] for one in unknown],
        )  # fmt: skip


def suite(half: str) -> Iterator[Toss]:
    """Yield the sets of a half: nothing, each fact alone, some pairs, and unknown physics, of both makers."""
    look = half == "look"
    for maker, alone, start, unknown in (
        ("engine", ACCEPTED, 100, ("stripes", "stripes")),
        ("impulse", ACCEPTED_OF_IMPULSE, 200, ("stripes", "magnet", "lift")),
    ):
        pairs = list(combinations(sorted(ACCEPTED | alone), 2))
        step = 3 if maker == "engine" else 19
        chosen = pairs[0 if look else 1 :: step][:5] if maker == "engine" else pairs[(5 if look else 9) :: step]
        every = [(), (), (), *((name,) for name in sorted(alone)), *chosen, *((name,) for name in unknown)]
        for seed, hidden in enumerate(every, start if look else start + 400):
            yield Toss(suite=maker, half=half, seed=seed, hidden=hidden)


def rotation(q: Tensor) -> Tensor:
    """Rotation matrices of unit quaternions, from the body to the world."""
    w, x, y, z = q.unbind(-1)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return torch.stack([torch.stack(row, -1) for row in rows], -2)


def lowest(kind: str, half: Tensor, R: Tensor, normal: Tensor) -> Tensor:
    """Lowest point along a floor's normal, from the geometric centre, in world axes."""
    down = -(R.mT @ normal[:, None])[..., 0]
    body = half * down.sign() if kind == "box" else half**2 * down / (half * down).norm(dim=-1, keepdim=True)
    return (R @ body[..., None])[..., 0]


def tossed(count: int, generator: torch.Generator) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Return random quaternions, velocities, spins and places on the floor."""
    uniform = torch.rand(count, 5, generator=generator).double()
    quaternion = torch.randn(count, 4, generator=generator).double()
    quaternion = quaternion / quaternion.norm(dim=-1, keepdim=True)
    spin = 6 * torch.randn(count, 3, generator=generator).double()
    v = torch.cat((1.6 * uniform[:, :2] - 0.8, -1.2 - 1.7 * uniform[:, 2:3]), -1)
    return quaternion, v, spin, 0.4 * uniform[:, 3:] - 0.2


def table(facts: Facts, seed: int, which: Tensor, r: Tensor, q: Tensor, v_pre: Tensor, v_post: Tensor) -> Impacts:
    """Return the table that the laboratory reports; `which` of several frictions each trial had."""
    n = len(r)
    names = tuple(f"body {k}" for k in which.tolist()) if "bodies" in facts.hidden else (facts.kind,) * n
    inertia = facts.inertia_stated().expand(n, 3).clone()
    return Impacts(
        torch.full((n,), MASS).double(), inertia, r, q, v_pre, v_post, object=names, shape=facts.shape(),
        source=f"tosses {seed}", validate=False,
    )  # fmt: skip


def truths(maker: str) -> dict[str, Truth]:
    """Return the ground truth of all sets of a maker, by name, as `blind.judge.read_truth` does."""
    return {str(toss.seed): toss.truth() for half in ("look", "report") for toss in suite(half) if toss.suite == maker}
