"""Test of what remains against the state of each trial: coefficients, and outcomes, over one variable or two.

    one    cosines over the ranks of a variable, harmonics of θ, one body against the others
    two    products of these, of low orders: what changes with both, such as a friction by direction and angle

Sums over the trials of such a function times a score (or a whitened residual) are compared with the same under random
signs, each alone and all of a variable or pair together, as their `surprise`.  The largest of all is compared with
those of the random signs, so that the level is that of all of them together.
Source: Efron 1969 for the signs; ranks make it indifferent to the variables' distributions.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import one_hot

from contactlearn.diagnosis.result.remainder import Coefficient
from contactlearn.diagnosis.sequence import exceedance, random_signs
from contactlearn.diagnosis.unexplained.scores import Scores
from contactlearn.diagnosis.unexplained.surprise import of_normals, of_sums
from contactlearn.effects import State
from contactlearn.mechanics.impacts import Impacts

ANGLE, BODY, PLACE = "theta", "object", "x"
_ALONE = 16  # cosines over a variable alone
_TOGETHER = {PLACE: 8}  # of a variable in a product; floors have stripes
_FEW = 4  # of all other variables
_BODIES = 10  # at most, to be told apart
_KINDS = (*Coefficient, None, None, None)  # that may depend on the state: coefficients, whitened velocities


@dataclass(frozen=True, kw_only=True)
class StateSuspect:
    """What the state seems to tell of a coefficient, or of the velocities where that is None.

    Args:
        coefficient: of the law.
        orders: half periods over the range of each variable, by its symbol; of θ harmonics.
        surprise: of the strongest function.
    """

    coefficient: Coefficient | None
    orders: Mapping[str, int]
    surprise: float


def state_variables(impacts: Impacts) -> dict[str, Float[Tensor, "n c"]]:
    """Compute columns of each variable that varies: (cos θ, sin θ), each body alone, the others standardised."""
    state, names = State.of(impacts), list(dict.fromkeys(impacts.object))
    told = {"vn": state.v_n, "vt": state.v_t, "omega": state.omega, PLACE: state.x}
    found = {
        name: ((value - value.mean()) / value.std())[:, None]
        for name, value in told.items()
        if value.std() > 1e-9 * value.abs().max()
    }
    circle = torch.stack((state.theta.cos(), state.theta.sin()), -1)
    if circle.std(0).max() > 1e-9:
        found[ANGLE] = circle
    if 1 < len(names) <= _BODIES:
        found[BODY] = one_hot(torch.tensor([names.index(name) for name in impacts.object])).to(torch.float64)
    return found


def state_suspects(
    scores: Scores, among: Mapping[str, Float[Tensor, "n c"]], level: float, block: int = 1
) -> tuple[float, tuple[StateSuspect, ...]]:
    """Compute the p-value of independence, and what refutes it at the level, the most surprising first.

    Residuals of so many neighbouring trials, a `block`, may resemble each other: they have one random sign.
    """
    signs = random_signs(math.ceil(len(scores) / block)).repeat_interleave(block, 1)[:, : len(scores)]
    groups = list(_functions(among))
    alike = torch.eye(3, dtype=torch.float64).expand(len(scores), 3, 3)
    channels, found, told = torch.cat((scores.slope, alike), -1), list[StateSuspect](), list[Tensor]()
    for orders, functions in groups:
        for kind, channel in zip(_KINDS, channels.unbind(-1), strict=True):
            free = scores.free(channel[..., None] * (functions - functions.mean(0))[:, None])
            sums = signs @ (free * scores.residual[..., None]).sum(1)
            z = sums / sums.square().mean(0).sqrt().clamp_min(1e-300)
            each, together = of_normals(sums), of_sums(z.square().sum(1, keepdim=True))
            told.append(torch.cat((each, together), 1).nan_to_num(0.0).amax(1))
            strongest = orders[int(each[0].argmax())]
            found.append(StateSuspect(coefficient=kind, orders=strongest, surprise=told[-1][0].item()))
    surprise = torch.stack(told, 1)
    largest = surprise.amax(1)
    chance, enough = exceedance(largest), largest[1:].quantile(1 - level).item()
    if chance > level:
        return chance, ()
    return chance, tuple(sorted((one for one in found if one.surprise > enough), key=lambda one: -one.surprise))


def _functions(
    among: Mapping[str, Float[Tensor, "n c"]],
) -> Iterator[tuple[list[dict[str, int]], Float[Tensor, "n k"]]]:
    """Groups of functions of a variable, then of two, and the orders of each."""
    ladders = {name: _ladder(name, columns) for name, columns in among.items()}
    for name, (functions, orders) in ladders.items():
        yield [{name: order} for order in orders], functions
    for one, two in combinations(ladders, 2):
        (left, first), (right, second) = (_low(name, *ladders[name]) for name in (one, two))
        orders = [{one: a, two: b} for a in first for b in second]
        yield orders, (left[:, :, None] * right[:, None]).flatten(1)


def _ladder(name: str, columns: Float[Tensor, "n c"]) -> tuple[Float[Tensor, "n k"], list[int]]:
    """Functions of a variable and their orders, rising."""
    if name == BODY:
        return columns, [1] * columns.shape[1]
    if name == ANGLE:
        angle, orders = torch.atan2(columns[:, 1], columns[:, 0]), range(1, 1 + _ALONE // 2)
        return torch.stack([f(k * angle) for k in orders for f in (torch.cos, torch.sin)], -1), [
            k for k in orders for _ in range(2)
        ]
    orders = range(1, 1 + _ALONE)
    return (math.pi * _ranks(columns[:, 0])[:, None] * torch.tensor(orders)).cos(), list(orders)


def _low(name: str, functions: Float[Tensor, "n k"], orders: list[int]) -> tuple[Float[Tensor, "n l"], list[int]]:
    """Those of low orders."""
    most = len(orders) if name == BODY else _TOGETHER.get(name, _FEW)
    return functions[:, :most], orders[:most]


def _ranks(values: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
    """Ranks between 0 and 1, the same for equal values."""
    _, which, count = values.unique(return_inverse=True, return_counts=True)
    return ((count.cumsum(0) - count / 2) / len(values)).to(torch.float64)[which]
