"""What remains: whether a flexible model still does clearly better than the best named one, and in what.

Gaussian processes learn the wrench (P_t, P_n, τ) that the model leaves, per unit mass and inertia, from the full state
and the order of the trials, on the fitted rows of each fold, and are tested on the rows held out:

    share        how far the held-out mass error falls: with the model of a law alone this is the ceiling
    components   those of the wrench that are predicted better than by 0, by held-out R² and its standard error
    variables    the total Sobol index of what is predicted: how much of its variance goes if a variable is another
                 trial's and everything else stays

For a body of known shape above a level floor r and y are functions of θ.  What follows from θ moves with it
and goes by its name, so that no state is asked about that could not be.  A wrench at the contact point has no unique
cause: a force elsewhere on the body shows as an impulse and a moment.
The model has few parameters and is fitted to all trials, so that next to nothing of those held out is in it.
Gross outliers count neither in training nor in what is said, but have their `error`.
Sources: Rasmussen & Williams 2006, for the processes; Jansen 1999, for the index.
"""

import math
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from contactlearn.diagnosis.search.selection import Folds
from contactlearn.effects import State
from contactlearn.effects.formula.symbols import of_state
from contactlearn.errors import DataError
from contactlearn.evaluation.metrics import Interval, mass_error
from contactlearn.evaluation.partial_residuals import share_explained
from contactlearn.impacts import Impacts, Prediction
from contactlearn.model import ContactModel
from contactlearn.regression.features import Standardisation
from contactlearn.regression.gp.exact import ExactGPs

COMPONENTS = ("t", "n", "tau")
"""Of the wrench: P_t, P_n (N s) and τ (N m s)."""

CLEARLY = 0.1
"""Share of the model's error that the processes must take off for something unknown to be missing; half of it must be
certain."""
SIGMAS = 3.0
"""Standard errors by which the R² of a component must be above 0 …"""
LEAST = 0.04
"""… and how large it must be, for the component to be named."""
_TRIALS = 450  # of a fold that are learnt from, at most
_INPUTS = ("m", "I", "rx", "ry", "x", "y", "theta", "vx", "vy", "omega", "order")
_FOLLOWS = 0.85  # share of a symbol's variance along θ from which on it is taken to follow from it
_GROSS = 8.0  # robust standard deviations, where it is not said which trials are usual
_NAMED = 0.05  # share below which a variable is not named
_PERMUTATIONS, _RESAMPLES = 2, 2000
_ROUNDING = 1e-12  # of a mass error


@dataclass(frozen=True)
class Component:
    """How well one component of the remainder is predicted where it was not learnt.

    `r_squared` is 1 − Σ (y − ŷ)² / Σ y² with gross values curbed, `taken` what this component alone takes off the
    mean mass error.
    """

    name: str
    r_squared: float
    standard_error: float
    taken: float

    @property
    def clear(self) -> bool:
        """Whether it can be named."""
        return self.r_squared > LEAST and self.r_squared > SIGMAS * self.standard_error


@dataclass(frozen=True, eq=False)
class Remainder:
    """See the module.

    `before` and `error` [N] are the mass errors of the model alone and with the processes on held-out trials, nan
    where one never was, `v_post` [N, 3] what these predict there, in (m/s, m/s, rad/s); `share` the relative fall of
    the mean errors with its 95 % interval, at or below 0 where there is nothing to learn.  `components` are the
    clear ones, the one that takes most off the error first, and that one if the share is large; `variables` the
    shares of those symbols that matter for them, `tested` the numbers behind the components.
    """

    error: Tensor
    before: Tensor
    v_post: Tensor
    share: Interval
    components: tuple[str, ...]
    variables: dict[str, float]
    tested: tuple[Component, ...]

    @property
    def large(self) -> bool:
        """Whether so much remains that something unknown must be missing."""
        return _large(self.share)

    @property
    def found(self) -> bool:
        """Whether something clearly remains."""
        return bool(self.components) and self.share.low > 0

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        said = {"share": self.share.mean, "interval": [self.share.low, self.share.high]}
        tested = {c.name: {"r_squared": c.r_squared, "standard_error": c.standard_error} for c in self.tested}
        return said | {"components": list(self.components), "variables": dict(self.variables), "tested": tested}


def remainder(
    impacts: Impacts,
    model: ContactModel,
    folds: Folds,
    *,
    generator: torch.Generator,
    usual: Tensor | None = None,
) -> Remainder:
    """What the model leaves of the impacts and flexible models can predict.

    Args:
        model: fitted to these impacts, without leading axes.
        folds: what is learnt from and what is held out; all are learnt at once.
        generator: of the permutations and the bootstrap.
        usual: trials [N] that are no gross outliers, see `JointFit`.  If left out, those without a component beyond
            eight robust standard deviations.

    Raises:
        DataError: fewer than two trials to learn from.
    """
    base = model.base_prediction(impacts)
    left = impacts.wrench - base.wrench
    usual = _usual(left) if usual is None else usual
    processes = _Processes.of(impacts, left, _rows(folds, usual))
    learned = processes.at(folds.held_out)

    def predicted(*which: int) -> Prediction:
        added = torch.zeros(len(learned), len(impacts), 3, dtype=torch.float64)
        index = folds.held_out[..., None].expand(-1, -1, len(which))
        added[..., list(which)] = added[..., list(which)].scatter(1, index, learned[..., list(which)])
        return Prediction.from_wrench(impacts, base.wrench + added)

    def held_out(*which: int) -> Tensor:
        return folds.scores(mass_error(impacts, predicted(*which)))

    error = held_out(0, 1, 2)
    v_post = torch.stack([folds.scores(part) for part in predicted(0, 1, 2).v_post.unbind(-1)], -1)
    before = mass_error(impacts, base).where(error.isfinite(), torch.nan)
    said = usual & error.isfinite()
    tested = tuple(
        Component(
            name, *_r_squared(folds, left[:, k], learned[..., k], said), (before - held_out(k))[said].mean().item()
        )
        for k, name in enumerate(COMPONENTS)
    )
    share = _share(before[said], error[said], generator)
    most = max(tested, key=lambda c: c.taken)
    clear = sorted((c for c in tested if c.clear or (c is most and _large(share))), key=lambda c: -c.taken)
    return Remainder(
        error,
        before,
        v_post,
        share,
        tuple(c.name for c in clear),
        _variables(impacts, processes, folds, learned, [COMPONENTS.index(c.name) for c in clear], generator),
        tested,
    )


@dataclass(frozen=True)
class _Processes:
    """Processes of each fold for the three components; `x` [N, D] is what they see of the trials."""

    x: Tensor
    unit: Tensor  # [N, 3], of the wrench: mass, mass, inertia
    inputs: Standardisation
    outputs: Standardisation
    gps: ExactGPs

    @classmethod
    def of(cls, impacts: Impacts, left: Tensor, rows: Tensor) -> "_Processes":
        if rows.shape[-1] < 2:
            raise DataError(f"what remains needs at least 2 trials to learn from, got {rows.shape[-1]}")
        x = torch.cat([columns for columns in _columns(impacts).values()], -1)
        unit = torch.stack((impacts.mass, impacts.mass, impacts.inertia), -1)
        left = left / unit
        inputs, outputs = Standardisation.of(x[rows]), Standardisation.of(left[rows])
        gps = ExactGPs(inputs.apply(x[rows]), outputs.apply(left[rows]).mT)
        gps.fit()
        return cls(x, unit, inputs, outputs, gps)

    def at(self, rows: Tensor, x: Tensor | None = None) -> Tensor:
        """Predicted wrench [B, m, 3] of the rows [B, m], or of inputs x [B, m, D]."""
        mean, _ = self.gps.predict(self.inputs.apply(self.x[rows] if x is None else x))
        unit = self.unit[rows].repeat(1, mean.shape[-1] // rows.shape[1], 1)
        return self.outputs.undo(mean.mT) * unit


def _columns(impacts: Impacts) -> dict[str, Tensor]:
    """Input columns [N, 1 or 2] by symbol, θ as (cos θ, sin θ)."""
    known = of_state(State.of(impacts))
    theta = torch.stack((known["theta"].cos(), known["theta"].sin()), -1)
    return {name: theta if name == "theta" else known[name][:, None] for name in _INPUTS}


def _usual(left: Tensor) -> Tensor:
    """Trials [N] without a gross component."""
    off = (left - left.median(0).values).abs()
    return (off <= _GROSS * 1.4826 * off.median(0).values + 1e-300).all(-1)


def _rows(folds: Folds, usual: Tensor) -> Tensor:
    """Of each fold's fitted rows as many usual ones as every fold has, in their random order."""
    rows = [part[usual[part]] for part in folds.fitted]
    size = min(_TRIALS, *map(len, rows))
    return torch.stack([part[:size] for part in rows])


def _r_squared(folds: Folds, left: Tensor, learned: Tensor, said: Tensor) -> tuple[float, float]:
    """Held-out R² against 0 and its standard error over the trials that count."""
    y = left[folds.held_out]
    gain = torch.zeros(len(y), len(left), dtype=y.dtype).scatter(1, folds.held_out, y.square() - (y - learned).square())
    gain, size = folds.scores(gain)[said], left[said].square().mean().clamp_min(1e-300)
    limit = _GROSS * gain.abs().median() + size  # curbs trials by which the mean would stand or fall
    gain = gain.clamp(-limit, limit) / size
    return gain.mean().item(), (gain.std() / math.sqrt(len(gain))).item()


def _large(share: Interval) -> bool:
    return share.mean > CLEARLY and share.low > CLEARLY / 2


def _share(before: Tensor, error: Tensor, generator: torch.Generator) -> Interval:
    """Relative fall of the mean error with its 95 % paired bootstrap interval."""
    before, error = before + _ROUNDING, error + _ROUNDING
    rows = torch.randint(len(before), (_RESAMPLES, len(before)), generator=generator)
    falls = 1 - error[rows].mean(-1) / before[rows].mean(-1)
    low, high = falls.quantile(torch.tensor((0.025, 0.975), dtype=falls.dtype)).tolist()
    return Interval((1 - error.mean() / before.mean()).item(), low, high)


def _variables(
    impacts: Impacts, processes: _Processes, folds: Folds, learned: Tensor, which: list[int], generator: torch.Generator
) -> dict[str, float]:
    """Shares of the symbols in what is predicted of the components, as it counts in the mass error."""
    if not which:
        return {}
    groups, size = _groups(impacts), folds.held_out.shape[1]
    x = processes.x[folds.held_out]
    moved = []
    for _ in range(_PERMUTATIONS):
        other = x[:, torch.randperm(size, generator=generator)]
        for columns in groups.values():
            changed = x.clone()
            changed[..., columns] = other[..., columns]
            moved.append(changed)
    there = processes.at(folds.held_out, torch.cat(moved, 1)).unflatten(1, (_PERMUTATIONS, len(groups), size))
    index = (there - learned[:, None, None]).square().mean((0, 1, 3))  # [G, 3]
    in_mass = torch.stack((impacts.W[:, 0, 0], impacts.W[:, 1, 1], 1 / impacts.inertia), -1).mean(0)
    total = (index * in_mass)[:, which].sum(-1)
    shares = dict(zip(groups, (total / total.sum().clamp_min(1e-300)).tolist(), strict=True))
    return {name: share for name, share in sorted(shares.items(), key=lambda s: -s[1]) if share >= _NAMED}


def _groups(impacts: Impacts) -> dict[str, list[int]]:
    """Columns that move together, by the symbol that they go by; without those that are constant."""
    groups, at, theta = {}, 0, impacts.q[:, 2]
    turn = torch.atan2(theta.sin(), theta.cos())
    for name, columns in _columns(impacts).items():
        own, at = list(range(at, at + columns.shape[-1])), at + columns.shape[-1]
        if (columns.amax(0) - columns.amin(0)).max() <= 1e-9 * columns.abs().max():
            continue
        follows = name in ("rx", "ry", "y") and share_explained(turn, columns[:, 0]) > _FOLLOWS
        groups.setdefault("theta" if follows else name, []).extend(own)
    return groups
