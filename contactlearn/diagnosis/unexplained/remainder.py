"""The remainder: the part of a model's residual that flexible models still predict, and its components and variables.

Gaussian processes learn the wrench (P_t, P_n, τ) that the model leaves, per unit mass and inertia, from the full state
and the order of the trials, on the fitted rows of each fold, and are tested on the rows held out.  In space P_t and τ
are vectors in the axes of the slip, and so are the velocities of the state.

    share        relative reduction of the held-out mass error; with the model of a law alone this is the ceiling
    components   components of the wrench that are predicted better than by 0, by held-out R² and its standard error
    variables    total Sobol index of the prediction: the part of its variance that is lost if a variable is another
                 trial's and everything else stays

For a body of known shape above a level floor r and y are functions of θ.  A symbol that is a function of θ moves with
it and has its name, so that no impossible state is predicted.  A wrench at the contact point has no unique cause: a
force elsewhere on the body shows as an impulse and a moment.
The model has few parameters and is fitted to all trials, so that next to nothing of those held out is in it.
Gross outliers count neither in training nor in the result, but have their `error`.
Sources: Rasmussen & Williams 2006, for the processes; Jansen 1999, for the indices.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from contactlearn.core.errors import DataError
from contactlearn.core.numerics import MAD_SCALE, wrapped
from contactlearn.diagnosis.result.remainder import (
    ComponentTest,
    Remainder,
    VariableShare,
    WrenchComponent,
    wrench_columns,
)
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.effects import State
from contactlearn.effects.formula.symbols import of_state
from contactlearn.inference.evaluation.metrics import Interval, mass_error
from contactlearn.inference.evaluation.partial_residuals import share_explained
from contactlearn.inference.validation import Folds
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.mechanics.noise_weight import noise_weight
from contactlearn.mechanics.rigid_body import matvec, rotation
from contactlearn.mechanics.space import PLANE, SPACE
from contactlearn.models.contact_model import ContactModel
from contactlearn.models.standardisation import Standardisation

if TYPE_CHECKING:  # GPyTorch takes long to load
    from contactlearn.models.gp.exact import ExactGPs

_INPUTS = ("m", "I", "rx", "ry", "x", "y", "theta", "vx", "vy", "omega", "order")
_COMPONENTS = tuple(WrenchComponent)
_GROSS = 8.0  # robust standard deviations, or medians, beyond which a residual is left out or curbed
_TRIALS = 450  # of a fold that the processes are fitted to, at most
_RESAMPLES = 2000
_LEAST_R_SQUARED = 0.04  # of a component that is named
FUNCTION_OF = 0.85
"""Share of a quantity's variance along a variable from which on it is a function of this variable."""
_ROUNDING = 1e-12  # of a mass error
_PERMUTATIONS = 2


# --- Processes -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Processes:
    """Gaussian processes of each fold for the D numbers of the residual wrench in the axes of the slip.

    `x` are the inputs, `unit` the unit of the wrench of each trial: masses and moments of inertia.
    """

    x: Float[Tensor, "n d"]
    unit: Float[Tensor, "n D"]
    inputs: Standardisation
    outputs: Standardisation
    gps: "ExactGPs"

    @classmethod
    def of(cls, impacts: Impacts, residual: Float[Tensor, "n D"], rows: Int[Tensor, "b m"]) -> "Processes":
        """Fit the processes to the rows of each fold.

        Raises:
            DataError: fewer than two rows.
        """
        from contactlearn.models.gp.exact import ExactGPs

        if rows.shape[-1] < 2:
            raise DataError(f"what remains needs at least 2 trials to learn from, got {rows.shape[-1]}")
        x = torch.cat([*input_columns(impacts).values()], -1)
        unit = impacts.mass_diagonal
        residual = residual / unit
        inputs, outputs = Standardisation.of(x[rows]), Standardisation.of(residual[rows])
        weight = noise_weight(impacts, "wrench")
        if weight is not None:
            parts = [weight[:, numbers] for numbers in wrench_columns(impacts.space).values()]
            weight = torch.cat([part.mean(1, keepdim=True).expand_as(part) for part in parts], 1)[rows].mT
        gps = ExactGPs(inputs.apply(x[rows]), outputs.apply(residual[rows]).mT, weight)
        gps.fit_folds()
        return cls(x, unit, inputs, outputs, gps)

    @cached_property
    def _mean(self) -> Callable[[Float[Tensor, "b m d"]], Float[Tensor, "b D m"]]:
        return self.gps.mean()

    def at(self, rows: Int[Tensor, "b m"], x: Float[Tensor, "b m d"] | None = None) -> Float[Tensor, "b m D"]:
        """Predict the wrench of the rows, or of other inputs of theirs, in their units."""
        mean = self._mean(self.inputs.apply(self.x[rows] if x is None else x))
        return self.outputs.undo(mean.mT) * self.unit[rows]


def input_columns(impacts: Impacts) -> dict[str, Float[Tensor, "n _"]]:
    """Compute the inputs by symbol, θ as (cos θ, sin θ); in space those that vary, in the axes of the slip."""
    known = of_state(State.of(impacts))
    if impacts.space is SPACE:
        axes = impacts.slip_axes.mT[:, :3, :3]
        r, spin = matvec(axes, impacts.r), matvec(axes, impacts.v_pre[:, 3:])
        down = -rotation(impacts.q[:, 3:])[:, 2]
        inputs = {"m": impacts.mass[:, None], "I": impacts.inertia, "orientation": torch.cat((r, down), -1)}
        inputs |= {name: known[name][:, None] for name in ("slip", "vn", "x", "floor_y", "order")}
        inputs |= {"spin": spin[:, :2], "twist": spin[:, 2:]}
        return {name: columns for name, columns in inputs.items() if _varies(columns)} | impacts.covariate_columns
    theta = torch.stack((known["theta"].cos(), known["theta"].sin()), -1)
    inputs = {name: theta if name == "theta" else known[name][:, None] for name in _INPUTS}
    return inputs | impacts.covariate_columns


def _varies(columns: Float[Tensor, "n c"]) -> bool:
    return bool((columns.amax(0) - columns.amin(0)).max() > 1e-9 * columns.abs().max())


# --- The remainder ---------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class LearnedRemainder:
    """A remainder with its arrays by trial.

    Args:
        remainder: the result.
        before: mass errors of the model alone, nan where a trial was never held out.
        error: the same with the processes, on held-out trials.
        v_post: predictions of the processes there, in (m/s, m/s, rad/s).
    """

    remainder: Remainder
    before: Float[Tensor, " n"]
    error: Float[Tensor, " n"]
    v_post: Float[Tensor, "n D"]


def learn_remainder(
    impacts: Impacts,
    model: ContactModel,
    folds: Folds,
    *,
    generator: torch.Generator,
    inliers: Bool[Tensor, " n"] | None = None,
    thresholds: Thresholds = Thresholds(),
) -> LearnedRemainder:
    """Learn the part of the residual of a model that flexible models predict.

    Args:
        impacts: measurements.
        model: fitted to these impacts, without leading axes.
        folds: trials to fit and to hold out; all folds are fitted at once.
        generator: of the permutations and the bootstrap.
        inliers: trials that are no gross outliers, see `Fit`; if None, those without a component beyond several
            robust standard deviations.
        thresholds: limits of what is named.

    Raises:
        DataError: fewer than two trials to learn from.
    """
    base = model.base_prediction(impacts)
    residual = matvec(impacts.slip_axes.mT, impacts.wrench - base.wrench)
    inliers = inlier_mask(residual) if inliers is None else inliers
    rows = [part[inliers[part]] for part in folds.fitted]
    size = min(_TRIALS, *map(len, rows))  # as many of each fold as every fold has, in their random order
    processes = Processes.of(impacts, residual, torch.stack([part[:size] for part in rows]))
    learned = _Learned(impacts, base, folds, processes.at(folds.held_out))
    error = learned.error(*_COMPONENTS)
    before = mass_error(impacts, base).where(error.isfinite(), torch.nan)
    counted = inliers & error.isfinite()
    share = relative_error_reduction(before[counted], error[counted], generator)
    large = share.mean > thresholds.form_error and share.low > thresholds.minor_share
    tested = [_tested(learned, residual, name, before, counted, thresholds) for name in _COMPONENTS]
    most = max(tested, key=lambda test: test.error_reduction)
    named = [test for test in tested if test.clear or (test is most and large)]
    named.sort(key=lambda test: -test.error_reduction)
    components = tuple(test.component for test in named)
    remainder = Remainder(
        share=share,
        large=large,
        components=components,
        variables=_variables(learned, processes, components, generator, thresholds),
        tested=tuple(tested),
    )
    return LearnedRemainder(remainder=remainder, before=before, error=error, v_post=learned.v_post())


@dataclass(frozen=True)
class _Learned:
    """Wrenches of the held-out rows of each fold as learned, in the axes of the slip, on top of a prediction."""

    impacts: Impacts
    base: Prediction
    folds: Folds
    wrench: Float[Tensor, "b m D"]

    def prediction(self, *which: WrenchComponent) -> Prediction:
        """Predict every trial in each fold, with some components of the learned wrench."""
        columns = [k for name in which for k in wrench_columns(self.impacts.space)[name]]
        added = torch.zeros(len(self.wrench), *self.impacts.wrench.shape, dtype=torch.float64)
        index = self.folds.held_out[..., None].expand(-1, -1, len(columns))
        added[..., columns] = added[..., columns].scatter(1, index, self.wrench[..., columns])
        return Prediction.from_wrench(self.impacts, self.base.wrench + matvec(self.impacts.slip_axes, added))

    def error(self, *which: WrenchComponent) -> Float[Tensor, " n"]:
        """Held-out mass error with some components."""
        return self.folds.scores(mass_error(self.impacts, self.prediction(*which)))

    def v_post(self) -> Float[Tensor, "n D"]:
        """Held-out prediction with all components, in (m/s, m/s, rad/s)."""
        parts = self.prediction(*_COMPONENTS).v_post.unbind(-1)
        return torch.stack([self.folds.scores(part) for part in parts], -1)


def _tested(
    learned: _Learned,
    residual: Float[Tensor, "n D"],
    name: WrenchComponent,
    before: Float[Tensor, " n"],
    counted: Bool[Tensor, " n"],
    thresholds: Thresholds,
) -> ComponentTest:
    """Test the held-out prediction of one component."""
    columns = wrench_columns(learned.impacts.space)[name]
    r_squared, error = _r_squared(learned.folds, residual[:, columns], learned.wrench[..., columns], counted)
    return ComponentTest(
        component=name,
        r_squared=r_squared,
        standard_error=error,
        error_reduction=(before - learned.error(name))[counted].mean().item(),
        clear=is_significant(r_squared, error, thresholds),
    )


def inlier_mask(residual: Float[Tensor, "n D"]) -> Bool[Tensor, " n"]:
    """Find the trials without a gross component of the residual."""
    off = (residual - residual.median(0).values).abs()
    return (off <= _GROSS * MAD_SCALE * off.median(0).values + 1e-300).all(-1)


def is_significant(r_squared: float, standard_error: float, thresholds: Thresholds) -> bool:
    """Return whether a component with this R² can be named: it is both large and certain."""
    certain = r_squared > thresholds.certain_sigmas * standard_error
    return r_squared > _LEAST_R_SQUARED and certain


def _r_squared(
    folds: Folds,
    residual: Float[Tensor, "n c"],
    learned: Float[Tensor, "b m c"],
    counted: Bool[Tensor, " n"],
) -> tuple[float, float]:
    """Held-out R² against 0 and its standard error over the trials that count."""
    y = residual[folds.held_out]
    gain = torch.zeros(len(y), len(residual), dtype=y.dtype)
    gain = gain.scatter(1, folds.held_out, (y.square() - (y - learned).square()).sum(-1))
    gain, size = folds.scores(gain)[counted], residual[counted].square().sum(-1).mean().clamp_min(1e-300)
    limit = _GROSS * gain.abs().median() + size  # curbs trials by which the mean would stand or fall
    gain = gain.clamp(-limit, limit) / size
    return gain.mean().item(), (gain.std() / math.sqrt(len(gain))).item()


def relative_error_reduction(
    before: Float[Tensor, " n"], error: Float[Tensor, " n"], generator: torch.Generator
) -> Interval:
    """Compute the relative reduction of the mean error with its 95 % paired bootstrap interval."""
    before, error = before + _ROUNDING, error + _ROUNDING
    rows = torch.randint(len(before), (_RESAMPLES, len(before)), generator=generator)
    falls = 1 - error[rows].mean(-1) / before[rows].mean(-1)
    low, high = falls.quantile(torch.tensor((0.025, 0.975), dtype=falls.dtype)).tolist()
    return Interval((1 - error.mean() / before.mean()).item(), low, high)


def _variables(
    learned: _Learned,
    processes: Processes,
    components: Sequence[WrenchComponent],
    generator: torch.Generator,
    thresholds: Thresholds,
) -> tuple[VariableShare, ...]:
    """Shares of the symbols in the prediction of the components, as it counts in the mass error."""
    if not components:
        return ()
    impacts, rows = learned.impacts, learned.folds.held_out
    groups = _groups(impacts)
    index = total_indices(lambda x: processes.at(rows, x), processes.x[rows], groups, generator)
    inverse = impacts.W.diagonal(dim1=-2, dim2=-1), 1 / impacts.mass_diagonal[:, impacts.space.d :]
    columns = [k for name in components for k in wrench_columns(impacts.space)[name]]
    total = (index * torch.cat(inverse, -1).mean(0))[:, columns].sum(-1)
    return variable_shares(groups, total, thresholds.minor_share)


def _groups(impacts: Impacts) -> dict[str, list[int]]:
    """Columns that move together, by the symbol that they go by; without those that are constant."""
    groups, at = {}, 0
    turn = wrapped(impacts.q[:, 2]) if impacts.space is PLANE else None
    for name, columns in input_columns(impacts).items():
        indices, at = list(range(at, at + columns.shape[-1])), at + columns.shape[-1]
        if not _varies(columns):
            continue
        moves = turn is not None and name in ("rx", "ry", "y") and share_explained(turn, columns[:, 0]) > FUNCTION_OF
        groups.setdefault("theta" if moves else name, []).extend(indices)
    return groups


# --- Sobol indices ---------------------------------------------------------------------------------


def total_indices(
    predict: Callable[[Float[Tensor, "b m d"]], Float[Tensor, "b m o"]],
    x: Float[Tensor, "b m d"],
    groups: Mapping[str, Sequence[int]],
    generator: torch.Generator,
) -> Float[Tensor, "g o"]:
    """Compute the mean square change of each output by each variable, in the outputs' units squared.

    Args:
        predict: the outputs at inputs.
        x: inputs of the trials of each fold.
        groups: columns of each variable, which move together.
        generator: of the other trials.
    """
    here, changes = predict(x), []
    for _ in range(_PERMUTATIONS):
        other = x[:, torch.randperm(x.shape[1], generator=generator)]
        for columns in groups.values():
            changed = x.clone()
            changed[..., columns] = other[..., columns]
            changes.append((predict(changed) - here).square().mean((0, 1)))
    return torch.stack(changes).unflatten(0, (_PERMUTATIONS, len(groups))).mean(0)


def variable_shares(
    groups: Mapping[str, Sequence[int]], total: Float[Tensor, " g"], least: float
) -> tuple[VariableShare, ...]:
    """Return the shares of the variables in their sum, the largest first, without those below the least."""
    each = zip(groups, (total / total.sum().clamp_min(1e-300)).tolist(), strict=True)
    ordered = sorted(each, key=lambda item: -item[1])
    return tuple(VariableShare(symbol=name, share=x) for name, x in ordered if x >= least)
