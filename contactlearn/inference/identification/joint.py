"""Joint identification of a law's (μ, ε) and the parameters of the effects around it.

The residual e_k of trial k is its measured post velocity (or wrench) less the predicted one (`problem`).  `robust`
maximises the likelihood of the residuals under Student's t distribution, for many subsets and starts at once.  Where
the noise of the velocities is known, `errors_in_variables` estimates the states before impact with the parameters.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple, cast

import torch
from torch import Tensor

from contactlearn.core.errors import DataError, UnknownNameError
from contactlearn.core.numerics import is_number, measured
from contactlearn.effects import Effect, Parameter, named_effects
from contactlearn.inference.identification import errors_in_variables, robust
from contactlearn.inference.identification.problem import JointProblem, effects_at, suited
from contactlearn.inference.identification.result import Box
from contactlearn.inference.identification.vanishing import Vanishing
from contactlearn.laws import Law, named
from contactlearn.mechanics.apparatus import Estimate, KnownParameter
from contactlearn.mechanics.impacts import Impacts, require_impacts
from contactlearn.mechanics.space import require_space
from contactlearn.models.contact_model import ContactModel

if TYPE_CHECKING:
    from pandas import DataFrame


@dataclass(frozen=True, kw_only=True)
class FitThresholds:
    """Limits of the statements about a fit."""

    outlier_weight: float = 0.07
    """Weight of a trial, 1 for an ordinary one, below which it is a gross outlier: that of five standard deviations in
    each of three components."""
    open_share: float = 0.125
    """Standard error of a parameter, relative to its plausible range, above which it is not determined: its 95 %
    interval then covers half of the range."""
    collinearity: float = 0.95
    """Correlation above which two parameters trade off on these data, and share R² of an effect's change that another
    effect reproduces above which only their functional forms differ."""
    effective_trials: float = 5.0
    """Effective number of trials below which too few inform a parameter."""


FIT_TARGETS = ("velocity", "wrench")
_MOST_OUTLIERS = 0.1  # of the trials


@dataclass(frozen=True, kw_only=True)
class FitOptions:
    """Options of a joint fit.

    Raises:
        DataError: noise that is not three (in space six) positive numbers, or noise before impact alone.
        UnknownNameError: no such target.
    """

    box: Box = Box()
    """Limits of μ and ε."""
    target: str = "velocity"
    """The compared quantity: `velocity` for v_post, or `wrench`."""
    noise: tuple[float, ...] | None = None
    """Standard deviations of the measured v_x, v_y (m/s) and ω (rad/s) after impact, known up to a common factor.

    In space there are six, of the components of the velocity and of the spin.

    If None, it is that of the covariances of the impacts, see `with_noise_of`; where they have none, the residual is
    weighted by its own scatter, and v_pre is treated as exact.
    """
    noise_before: tuple[float, ...] | None = None
    """Standard deviations before impact, in the units and up to the factor of `noise`; equal to `noise` if None.

    0 is an exact component; one that is the same in all trials is treated as exact.
    """
    starts: int = 8
    """Number of starts of the search, for each subset."""
    tolerance: float = robust.TOLERANCE
    """Decrease of the loss in nats a trial below which a step is no improvement; two in a row end the fit."""
    standard_errors: bool = True
    """Whether they are estimated, which takes as long as one more step; a search has no use for them."""
    thresholds: FitThresholds = FitThresholds()
    """Limits of the statements about the fit."""

    def __post_init__(self):
        for name, sign, least in (("noise", "positive", 5e-324), ("noise_before", "non-negative", 0.0)):
            sigma = getattr(self, name)
            if sigma is not None and (len(sigma) not in (3, 6) or not all(is_number(x) and x >= least for x in sigma)):
                raise DataError(
                    f"{name} must be three {sign} standard deviations, of v_x, v_y in m/s and ω in rad/s; got {sigma}"
                )
        if self.noise_before is not None and self.noise is None:
            raise DataError(f"noise_before={self.noise_before} needs noise, that after impact, in the same units")
        if self.target not in FIT_TARGETS:
            raise UnknownNameError("target of a joint fit", self.target, FIT_TARGETS)

    def with_noise_of(self, impacts: Impacts) -> "FitOptions":
        """Return the options with the noise that the covariances of the impacts imply, where none is stated.

        It is the root of their mean variances.  Covariances of one side serve for both; those that leave a component
        without any noise after impact serve for nothing.
        """
        sides = [x for x in (impacts.v_pre_cov, impacts.v_post_cov) if x is not None]
        if self.noise is not None or not sides:
            return self
        before, after = (_deviations(sides[k]) for k in (0, -1))
        return replace(self, noise=after, noise_before=before) if min(after) > 0 else self


@dataclass(frozen=True, repr=False)
class Fit:
    """Result of a joint fit, for each subset (leading axes).

    `values` [..., K] and `covariance` [..., K, K] follow `parameters`, named `mu`, `eps` and `effect.parameter`.
    """

    model: ContactModel
    parameters: tuple[Parameter, ...] = field(repr=False)
    values: Tensor = field(repr=False)
    covariance: Tensor = field(repr=False)  # nan, as the effective trials, where the options leave it out
    scatter: Tensor = field(repr=False)  # robust covariance [..., D, D] of residuals: target's units², or white
    weight: Tensor = field(repr=False)  # [..., n] of the trials, near 0 for gross outliers and 1 for ordinary ones
    effective_trials: Tensor = field(repr=False)  # [..., K] effective number of trials that inform each parameter
    loss: Tensor  # [...] the minimum of the loss, nats a trial
    agreement: Tensor  # [...] share of the starts followed to the end that reached this minimum
    converged: Tensor  # [...] whether the best start converged
    thresholds: FitThresholds = field(default_factory=FitThresholds, repr=False)
    alone: "Fit | None" = None  # to the impacts alone, where free flight has an estimate

    def __repr__(self) -> str:
        """Write the model with its values; those of several subsets are means."""
        subsets = self.loss.numel()
        equation = "; ".join(line.removeprefix("  + ") for line in str(self.model).splitlines())
        trials = f"{self.weight.shape[-1]} trials" if self.loss.ndim == 0 else f"{subsets} subsets"
        ended = "" if bool(self.converged.all()) else ", not converged"
        return f"Fit({equation}; {trials}, {self.outliers} outliers{ended})"

    def _repr_html_(self) -> str:
        return self.to_frame().to_html(float_format="{:.4g}".format)

    @property
    def params(self) -> dict[str, float]:
        """Values of the parameters by name, means over the subsets."""
        return dict(zip((p.name for p in self.parameters), self._means(self.values), strict=True))

    def _means(self, x: Tensor) -> list[float]:
        """Means [K] over the subsets."""
        return x.reshape(-1, len(self.parameters)).mean(0).tolist()

    def to_frame(self) -> "DataFrame":
        """Return a table of the parameters: symbol, value, standard error, unit and the range that was searched.

        Values and standard errors of several subsets are means.
        """
        from pandas import DataFrame, Index  # takes long to load

        rows = zip(self.parameters, self._means(self.values), self._means(self.standard_errors), strict=True)
        columns = [
            {"symbol": p.symbol, "value": value, "standard_error": error, "unit": p.unit, "low": p.low, "high": p.high}
            for p, value, error in rows
        ]
        return DataFrame(columns, index=Index([p.name for p in self.parameters], name="parameter"))

    def summary(self) -> str:
        """Describe the fit: a line for each parameter, then everything that limits what it says."""
        rows = zip(self.parameters, self._means(self.values), self._means(self.standard_errors), strict=True)
        width = max(len(p.name) for p in self.parameters)
        law = self.model.law
        lines = [
            f"{law.name} ({law.variant})",
            *(f"  + {name}: {e.equation}" for name, e in self.model.effects.items()),
            "",
        ]
        lines += [f"  {p.name:<{width}}  {p.symbol} = {measured(value, error, p.unit)}" for p, value, error in rows]
        lines += [
            "",
            f"  {self.weight.shape[-1]} trials, {self.outliers} outliers, loss {self.loss.mean():.3f} nats a trial",
        ]
        if not bool(self.converged.all()):
            lines.append("  the best start has not converged: use more starts")
        if bool(self.effective_trials.isfinite().all() and self.covariance.isnan().any()):
            lines.append("  no standard errors: all trials are copies of one")
        if self.loss.ndim == 0 and bool(self.covariance.isfinite().all()):
            lines += [f"  {name} is not determined: {reason}" for name, reason in self.undetermined().items()]
            lines += [f"  {name} {reason}" for name, reason in self.at_bounds().items()]
            lines += [f"  {sentence}" for sentence in self.trade_offs()]
        return "\n".join(lines)

    @property
    def standard_errors(self) -> Tensor:
        """Standard errors [..., K] of the parameters."""
        return self.covariance.diagonal(dim1=-2, dim2=-1).sqrt()

    @cached_property
    def correlation(self) -> Tensor:
        """Correlation matrix [..., K, K] of the parameters."""
        error = self.standard_errors
        return self.covariance / (error[..., :, None] * error[..., None, :])

    @property
    def inliers(self) -> Tensor:
        """Whether a trial [..., n] is no gross outlier: the residual of one is over five times the typical.

        Where more than a tenth are that far, as beside a small stated noise, the model lacks what moves them, and none
        is an outlier.
        """
        far = self.weight < self.thresholds.outlier_weight
        return ~far | (far.double().mean(-1, keepdim=True) > _MOST_OUTLIERS)

    @property
    def outliers(self) -> int:
        """Number of trials of negligible weight, over all subsets."""
        return int((self.weight < self.thresholds.outlier_weight).sum())

    def known_parameters(self) -> tuple[KnownParameter, ...]:
        """Return a single subset's parameters that free flight limits, with their fit to the impacts alone."""
        if self.alone is None:
            return ()
        alone = zip(self.alone.values.tolist(), self.alone.standard_errors.tolist(), strict=True)
        return tuple(
            KnownParameter(
                name=p.name,
                symbol=p.symbol,
                unit=p.unit,
                value=value,
                alone=Estimate(value=there, error=error),
                flight=p.prior_from_flight,
            )
            for p, value, (there, error) in zip(self.parameters, self.values.tolist(), alone, strict=True)
            if p.prior_from_flight is not None
        )

    def undetermined(self) -> dict[str, str]:
        """Explain which parameters a single subset does not determine: parameter → reasons with their numbers.

        Those with an estimate from free flight are left to `known_parameters`.
        """
        reasons = {
            p.name: " and ".join(self._open(k)) for k, p in enumerate(self.parameters) if p.prior_from_flight is None
        }
        return {name: found for name, found in reasons.items() if found}

    def _open(self, k: int) -> list[str]:
        """List the reasons why the data do not determine parameter k."""
        limits, reasons = self.thresholds, []
        share = self.standard_errors[k].item() / (self.parameters[k].high - self.parameters[k].low)
        if share >= 1:
            reasons.append("the outcome barely depends on it")
        elif share > limits.open_share:
            reasons.append(f"its standard error is {share:.0%} of its plausible range")
        trials = self.effective_trials[k].item()
        if trials < limits.effective_trials and share <= 1:
            reasons.append(f"about {max(1, round(trials))} trials constrain it")
        return reasons

    def trade_offs(self) -> tuple[str, ...]:
        """Name the strongly correlated pairs of a single subset's parameters; each may still be determined well."""
        pairs = (self.correlation.abs().triu(1) > self.thresholds.collinearity).nonzero().tolist()
        names, of = [p.name for p in self.parameters], self.correlation
        return tuple(f"{names[k]} and {names[j]} trade off: correlation {of[k, j]:+.2f}" for k, j in pairs)

    def at_bounds(self) -> dict[str, str]:
        """Explain which parameters of a single subset end at a bound, but for those: parameter → the meaning."""
        found, ends = {}, self.at_ends()
        for p, value, error in zip(self.parameters, self.values.tolist(), self.standard_errors.tolist(), strict=True):
            if p.name in ends:
                found[p.name] = f"ends at its bound {value:g}; the other parameters may be biased"
            elif not p.low < value < p.high and p.prior_from_flight is None:
                found[p.name] = f"is not seen: |{p.symbol}| < {1.645 * error:.2g} {p.unit} with 95 %".replace(" –", "")
        return found

    def at_ends(self) -> set[str]:
        """Name the parameters of a single subset at an end of their range that is not where their effect vanishes."""
        return {
            p.name
            for p, value in zip(self.parameters, self.values.tolist(), strict=True)
            if not p.low < value < p.high and value != p.vanishing and p.prior_from_flight is None
        }


def fit(
    impacts: Impacts,
    law: Law | str,
    effects: Mapping[str, Effect] | Iterable[str | Effect] = (),
    *,
    rows: Tensor | None = None,
    options: FitOptions = FitOptions(),
    start: Tensor | None = None,
) -> Fit:
    """Fit a law with effects to trials.

    Args:
        impacts: measurements.
        law: an analytical law or its name; its own μ and ε are ignored.
        effects: by name, or a list of names and effects; constants that they leave open are taken from the impacts.
        rows: subsets [..., n] of equal size as rows of the impacts; all of them if None.
        options: of the fit.
        start: values [..., K] to begin at instead of a search.

    Raises:
        DataError: fewer trials than K parameters need, (K + D (D + 1)) // D + 1; or an effect needs an unknown shape.
        ContactLearnError: law or effects do not exist in space.
    """
    require_impacts(impacts)
    law, listed = named(law), named_effects(effects, impacts.space)
    require_space(f"law {law.name} ({law.variant})", impacts.space, law.spaces)
    added = {name: effect.prepare(impacts) for name, effect in listed.items()}
    rows = impacts.numbered(slice(None) if rows is None else rows)
    parameters = named_parameters(added, options.box, impacts)
    least = least_trials(len(parameters), impacts.space.D)
    if rows.shape[-1] < least:
        raise DataError(f"{len(parameters)} parameters need at least {least} trials, got {rows.shape[-1]}")
    flat = rows.reshape(-1, rows.shape[-1])
    problem, noise = _observed(law, added, impacts, flat, parameters, options)
    if noise is None:
        found = robust.search(problem, options.starts, start, options.tolerance)
    else:
        problem, found = errors_in_variables.solve(problem, noise, options.starts, start, options.tolerance)
    theta, scatter, residual, loss, agreement, converged = found
    weight = robust.trial_weights(residual, scatter)
    if options.standard_errors:
        covariance, effective = robust.uncertainty(problem, theta, scatter)
        covariance[_copies(impacts, flat)] = torch.nan
    else:
        covariance, effective = torch.full_like(theta[..., None] * theta[..., None, :], torch.nan), theta * torch.nan
    back = (
        x.reshape(rows.shape[:-1] + x.shape[1:])
        for x in (theta, covariance, scatter, weight, effective, loss, agreement, converged)
    )
    theta, covariance, *others = back
    model = assemble(law, added, theta, covariance if options.standard_errors else None)
    return Fit(model, parameters, theta, covariance, *others, thresholds=options.thresholds)


def least_trials(parameters: int, D: int) -> int:
    """Return the number of trials that so many parameters need.

    A scatter matrix has D (D + 1)/2 numbers; twice as many residuals keep it from being singular.
    """
    return (parameters + D * (D + 1)) // D + 1


def _copies(impacts: Impacts, rows: Tensor) -> Tensor:
    """Whether the trials of each subset [B, n] are copies of one, whose scatter shows no error of anything."""
    trials = torch.cat((impacts.r, impacts.q, impacts.v_pre, impacts.v_post), -1)[rows]
    return (trials == trials[:, :1]).flatten(1).all(1)


class Linearisation(NamedTuple):
    """A residual [n, D] and its derivative [n, D, K] about given parameters, both whitened, and weights [n]."""

    residual: Tensor
    slope: Tensor
    weight: Tensor


def linearise(
    law: Law,
    effects: Mapping[str, Effect],
    impacts: Impacts,
    theta: Tensor,
    scatter: Tensor,
    *,
    vanishing: Mapping[str, Effect] = MappingProxyType({}),
    options: FitOptions = FitOptions(),
) -> Linearisation:
    """Linearise the residual of a law with effects about parameters.

    Args:
        law: its own μ and ε are ignored.
        effects: by name, prepared.
        impacts: measurements.
        theta: parameters [K] of law, effects and `vanishing`.
        scatter: of the residual.
        vanishing: further effects, at values at which they change nothing.
        options: of a fit.
    """
    rows = torch.arange(len(impacts), device=impacts.mass.device)[None]
    every = {**effects, **{name: cast(Effect, Vanishing(effect)) for name, effect in vanishing.items()}}
    parameters = named_parameters(every, Box(), impacts)
    problem, noise = _observed(law, every, impacts, rows, parameters, options)
    if noise is not None:
        own, count = replace(problem, effects=effects), 2 + sum(len(effect.parameters) for effect in effects.values())
        about = errors_in_variables.about_latent_states(own, noise, theta[None, :count])
        problem = replace(about, effects=every)
    residual, slope = problem.linearised(theta[None])
    return Linearisation(*(part[0] for part in robust.whitened(residual, slope, scatter[None])))


def named_parameters(effects: Mapping[str, Effect], box: Box, impacts: Impacts) -> tuple[Parameter, ...]:
    """Return μ, ε and the parameters of the effects, the latter named `effect.parameter`.

    Ranges with units of length, speed or mass suit the measurements, see `ranges.suited`.  What is known of the
    apparatus narrows them.
    """
    shared = (
        Parameter("mu", "μ", "–", *box.mu, vanishing=None),
        Parameter("eps", "ε", "–", *box.eps, vanishing=None),
    )
    known = {} if impacts.apparatus is None else dict(impacts.apparatus.parameters())
    declared = [(name, effect.name, p) for name, effect in effects.items() for p in effect.parameters]
    own: list[Parameter] = []
    for (name, family, _), p in zip(declared, suited([p for *_, p in declared], impacts), strict=True):
        low, high = p.low, p.high
        flight = known.get(f"{family}.{p.name}")
        if flight is not None:
            low = min(low, low - flight.applied)  # of a radius that was applied a part may be taken back
            within = max(low, flight.range[0]), min(high, flight.range[1])
            flight = None if within == (low, high) else flight
            low, high = within
        own.append(replace(p, name=f"{name}.{p.name}", low=low, high=high, prior_from_flight=flight))
    return (*shared, *own)


def assemble(law: Law, effects: Mapping[str, Effect], theta: Tensor, covariance: Tensor | None = None) -> ContactModel:
    """Return the model at parameters [..., K], whose leading axes broadcast against the trials [..., N]."""
    shaped = theta[..., None, :] if theta.ndim > 1 else theta
    return ContactModel(
        law.at(shaped[..., 0], shaped[..., 1]), effects=effects_at(effects, shaped), parameter_covariance=covariance
    )


def _observed(
    law: Law,
    effects: Mapping[str, Effect],
    impacts: Impacts,
    rows: Tensor,
    parameters: tuple[Parameter, ...],
    options: FitOptions,
) -> tuple[JointProblem, errors_in_variables.Noise | None]:
    """Return the problem of rows [B, n] at measured v_pre, and the noise if v_pre has one."""
    options = options.with_noise_of(impacts)
    deviations = partial(torch.tensor, dtype=torch.float64, device=impacts.mass.device)
    after = None if options.noise is None else deviations(options.noise)
    problem = JointProblem.of(law, effects, impacts, rows, parameters, options.target, after)
    if after is None:
        return problem, None
    before = after if options.noise_before is None else deviations(options.noise_before)
    before = before * (impacts.v_pre != impacts.v_pre[0]).any(0)
    noise = errors_in_variables.Noise(before, after if impacts.outcome_cov is None else None)
    return problem, noise if before.any() else None


def _deviations(covariance: Tensor) -> tuple[float, ...]:
    """Root of the mean variances of covariances [N, D, D]."""
    return tuple(covariance.diagonal(dim1=-2, dim2=-1).mean(0).sqrt().tolist())
