"""Scatter of the contact: standard deviations of random effects beside the noise of the instrument.

    y_k = f(x_k − δ_k, θ, u_k) + e_k,     u_k ~ N(0, Σ),  δ_k ~ N(0, A_b),  e_k ~ N(0, A_a)

f is a law with effects, u_k the deviations of its contact (`contactlearn.scatter`), δ_k and e_k the instrument's errors
before and after.  About each impact's most probable deviations û_k, with G = ∂f/∂u, J = ∂f/∂v_pre, X = ∂f/∂θ there,

    r_k = y_k − f(û_k) + G û_k − J δ̂_k,      S_k = A_a + J A_b Jᵀ + G Σ Gᵀ

is a linear mixed model (`variance_components`).  Its θ and Σ give new û_k, and so on.  A linearisation at u = 0 is
wrong where scatter makes a sliding impact stick: beside a planted normal it finds friction and restitution.

The instrument has two components, one standard deviation of all velocities and one of all spins, before as after: all
of its noise where none is stated (A = 0), else noise beside the stated one, a rival of the scatter.  The set of
components is the one of the least BIC, found by adding, removing and exchanging one at a time.

Sources: Lindstrom & Bates 1990 (conditional linearisation); Self & Liang 1987 (variances at the bound 0).
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import combinations, product
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from contactlearn.core.errors import ContactLearnError, DataError
from contactlearn.core.numerics import measured as written, number
from contactlearn.effects import State
from contactlearn.inference.identification.joint import assemble, named_parameters
from contactlearn.inference.identification.problem import effects_at
from contactlearn.inference.identification.shared import Box
from contactlearn.inference.identification.variance_components import MixedFit, MixedModel, Mixture
from contactlearn.mechanics.impacts import Impacts, require_impacts
from contactlearn.mechanics.rigid_body import matvec
from contactlearn.models.contact_model import ContactModel, linearised, resolve
from contactlearn.scatter import COMPONENTS, Component

INSTRUMENT = "instrument", "instrument_spin"
"""Names of its components, of all velocities in m/s and of all spins in rad/s."""
MIN_TRIALS = 40
"""Trials below which variances are not estimated: their standard errors are then a seventh of a normal sample's."""


@dataclass(frozen=True, kw_only=True)
class ScatterThresholds:
    """Limits of the statements about scatter."""

    least_gain: float = 10.0
    """Twice the gain in log likelihood that a component needs, where log N is less: very strong evidence after Kass &
    Raftery 1995.  Its chance without scatter is 0.1 % for normal noise."""
    least_share: float = 0.3
    """Share of the variance along a component's own directions below which it is none.  Laws in space, whose path has
    five steps, leave errors that look like a contact point off by 0.04 mm on a cube of 60 mm: a share of 0.1 to 0.26
    beside noise of 4 mm/s.  Planted components have 0.9."""
    rival: float = 6.0
    """Difference in BIC up to which another set is not excluded: a factor of twenty in likelihood."""
    collinearity: float = 0.95
    """Correlation of two estimates from which on the data do not tell them apart."""


_ROUNDS = 12
_SETTLED = 1e-2  # nats by which the likelihood changes in a round
_LENGTHS = (1.0, 0.5, 0.25, 0.0)  # of a step of the deviations that are tried; the best is taken
_UNCERTAIN = 60.0  # of a BIC whose fit may end before its maximum: a component that is seen changes it by hundreds
_REFITTED = 3  # sets that are linearised on their own, the best ones about the deviations of all components
_FIRST = len(INSTRUMENT)  # index of the first component of the contact
_LEVEL = 0.95  # of the ellipsoids
_DETERMINED = (
    0.1  # standard error over that with all others known, which is less where the pseudo-inverse leaves it out
)
_OPEN = 2.0  # standard error of a deviation that the data leave open, over its value
_START = 0.2  # of the greatest plausible standard deviation


@dataclass(frozen=True, kw_only=True)
class StandardDeviation:
    """Standard deviation of a component with its standard error."""

    name: str
    symbol: str
    unit: str
    value: float
    error: float

    def __str__(self) -> str:
        scale, unit = {"rad": (180 / math.pi, "°"), "m": (1e3, "mm")}.get(self.unit, (1.0, self.unit))
        if self.error > self.value:
            return f"at most {number(scale * math.hypot(self.value, 1.28 * self.error), 2)} {unit}".removesuffix(" –")
        return written(scale * self.value, scale * self.error, unit)


@dataclass(frozen=True, kw_only=True)
class Scatter:
    """Scatter of a contact, as the data want it.

    Args:
        model: law and effects as estimated beside the scatter, and the components with their standard deviations.
        deviations: standard deviations of the chosen components, those of the instrument first.
        correlation: of these estimates.
        stated: whether the instrument's noise was stated; its deviations are then those of noise beside it.
        log_likelihood: restricted, in nats; `log_likelihood_without` that of no scatter.
        bic: of the chosen set less that of none; negative where scatter is wanted.
        rivals: other sets that the data do not exclude, with their BIC less that of the chosen one.
        mixture: of ordinary trials, tails and outliers.
        each: most probable deviations [N, q] of the impacts by component, and their standard errors [N, q].
        distance: squared distance [N] of each impact from the model in units of instrument and scatter.
        converged: whether linearisation and deviations agree.
        recorded: components of the instrument, of which the model has none.
        inflation: factor of `covariance`.
    """

    model: ContactModel
    deviations: tuple[StandardDeviation, ...]
    correlation: Float[Tensor, "c c"]
    stated: bool
    log_likelihood: float
    log_likelihood_without: float
    bic: float
    rivals: tuple[tuple[tuple[str, ...], float], ...]
    mixture: Mixture
    each: Mapping[str, tuple[Float[Tensor, "n k"], Float[Tensor, "n k"]]]
    distance: Float[Tensor, " n"]
    converged: bool
    recorded: Mapping[str, Component] = field(default_factory=dict[str, Component])
    inflation: float = 1.0

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the components of the contact, without the instrument."""
        return tuple(self.model.scatter)

    def __repr__(self) -> str:
        """Say what scatters, and what cannot be told apart.

        the contact scatters: the normal by 0.65 ± 0.04°, friction by 0.016 ± 0.003
        the instrument has noise beside the stated: 0.100 ± 0.004 rad/s
        """
        values = {deviation.name: str(deviation) for deviation in self.deviations}
        parts = [component.in_words.format(sigma=values[name]) for name, component in self.model.scatter.items()]
        lines = ["the contact scatters: " + ", ".join(parts) if parts else "no scatter of the contact is seen"]
        noise = ", ".join(values[name] for name in (*INSTRUMENT, *self.recorded) if name in values)
        beside = "has noise beside the stated" if self.stated else "has noise"
        lines += [f"the instrument {beside}: {noise}"] if noise else []
        lines += [f"{a} and {b} cannot be told apart: correlation {c:+.2f}" for a, b, c in self.confounded()]
        lines += [f"not excluded: {', '.join(names) or 'none'} (ΔBIC {gap:+.1f})" for names, gap in self.rivals]
        _, tails, outliers = self.mixture.shares.tolist()
        _, wide, far = self.mixture.factors.tolist()
        lines += [f"{tails:.0%} of the trials are {wide:.1f} times as far off"] if tails > 0.01 else []
        lines += [f"{outliers:.0%} are outliers, {far:.0f} times as far off"] if outliers > 0.005 else []
        return "\n".join(lines)

    def confounded(self) -> tuple[tuple[str, str, float], ...]:
        """Pairs of components whose estimates are correlated too much to be told apart."""
        limit = ScatterThresholds().collinearity
        names = [deviation.name for deviation in self.deviations]
        pairs = (self.correlation.abs().triu(1) > limit).nonzero().tolist()
        return tuple((names[j], names[k], self.correlation[j, k].item()) for j, k in pairs)

    def instrument(self, impacts: Impacts) -> Float[Tensor, "n D D"]:
        """Covariance [N, D, D] that the instrument alone gives v_post − v̂_post; 0 where it is not known.

        It is the sum of that of the impacts and of the estimated one.
        """
        problem = _Problem.of(replace(self.model, scatter={}), impacts)
        values = {deviation.name: deviation.value**2 for deviation in self.deviations}
        before, after = problem.instrument(torch.tensor([values.get(name, 0.0) for name in INSTRUMENT]).double())
        theta = torch.stack([x.mean() for x in self.model.values])
        slope = problem.linearised(theta, *problem.still).slope_before
        recorded = replace(self.model, scatter=self.recorded).scatter_covariance(impacts)
        return after + slope @ before @ slope.mT + recorded

    def covariance(self, impacts: Impacts) -> Float[Tensor, "n D D"]:
        """Covariance [N, D, D] of measured v_post, of instrument and scatter.

        It is scaled so that 95 % of the impacts of the estimate, whose tails may be heavy, lie in 95 % ellipsoids.
        """
        return self.inflation * (self.instrument(impacts) + self.model.scatter_covariance(impacts))

    def sample(self, trials: int, impacts: Impacts, generator: torch.Generator) -> dict[str, Float[Tensor, "n k"]]:
        """Draw deviations [trials, k] of each component, as in the space of the impacts."""
        return {
            name: component.draw((trials,), impacts.space, generator) for name, component in self.model.scatter.items()
        }


def fit_scatter(
    impacts: Impacts,
    model: ContactModel,
    *,
    components: Iterable[Component] | None = None,
    thresholds: ScatterThresholds = ScatterThresholds(),
    quick: bool = False,
) -> Scatter:
    """Estimate the scatter around a law with effects, and both anew beside it.

    Args:
        impacts: measurements, with or without covariances of their velocities.
        model: a law with effects, fitted to these impacts; their values are where the estimate begins.
        components: that may scatter; all that suit the impacts if None.
        thresholds: of the statements.
        quick: whether all sets are compared about the deviations of all components, in a third of the time.  That is
            good enough for weights.

    Raises:
        DataError: fewer than `MIN_TRIALS` impacts.
        ContactLearnError: the model has a learned part, or no law, or the impacts determine too little.
    """
    require_impacts(impacts)
    if model.regressor is not None:
        raise ContactLearnError(f"scatter is estimated around a law with effects, not around {model}")
    if len(impacts) < MIN_TRIALS:
        raise DataError(f"{impacts.source}: scatter needs at least {MIN_TRIALS} impacts, got {len(impacts)}")
    candidates = list(components or ())
    if components is None:
        candidates = [one for one in (kind() for kind in COMPONENTS) if one.suits(impacts)]
    try:
        return _fitted(impacts, model, candidates, thresholds, quick)
    except torch.linalg.LinAlgError as error:  # pyright: ignore[reportPrivateImportUsage]
        raise ContactLearnError(
            f"{impacts.source}: the scatter cannot be estimated, for these impacts determine too little: {error}"
        ) from error


def _fitted(
    impacts: Impacts, model: ContactModel, candidates: Sequence[Component], thresholds: ScatterThresholds, quick: bool
) -> Scatter:
    """Search the components, and estimate the best sets anew unless it shall be `quick`."""
    problem = _Problem.of(replace(model, scatter={candidate.name: candidate for candidate in candidates}), impacts)
    theta, every = torch.stack([x.mean() for x in model.values]), torch.ones(len(problem.starts), dtype=torch.bool)
    whole = _estimate(problem, theta, every)
    penalty = max(math.log(len(impacts)), thresholds.least_gain)
    sets = _searched(whole, problem.fixed, penalty)
    none = min((free for free in sets if not any(free[_FIRST:])), key=sets.__getitem__)
    nearest = sorted(sets, key=sets.__getitem__)[: 1 if quick else _REFITTED]
    restricted = whole.without if quick else partial(whole.restricted, problem)
    refitted = {free: restricted(free) for free in (*nearest, none)}
    for free in [one.seen(problem, thresholds.least_share) for one in refitted.values()]:
        if free not in refitted:
            refitted[free] = restricted(free)
    without = refitted[none]
    clear = [one for free, one in refitted.items() if one.seen(problem, thresholds.least_share) == free]
    best = min(clear, key=lambda one: one.bic(penalty))
    rivals = [
        (problem.names(one.free), one.bic(penalty) - best.bic(penalty))
        for one in refitted.values()
        if one.bic(penalty) - best.bic(penalty) < thresholds.rival and bool((best.free & ~one.free).any())
    ]
    return _calibrated(_described(problem, best, without, tuple(rivals), penalty), impacts)


def _searched(whole: "_Estimate", fixed: Bool[Tensor, " c"], penalty: float) -> dict[tuple[bool, ...], float]:
    """BIC of the sets on the way from the components that are seen to the best set, and of those without scatter.

    A set is no likelier than one that has its components and more.  One that can be none of the best ones for that is
    not estimated.
    """
    seen, bic = (whole.fit.variances > 0) | fixed, dict[tuple[bool, ...], float]()

    def least(free: tuple[bool, ...]) -> float:
        more = (one for one in bic if all(a or not b for a, b in zip(one, free, strict=True)))
        return max((bic[one] - penalty * (sum(one) - sum(free)) for one in more), default=-math.inf)

    def criterion(free: tuple[bool, ...]) -> float:
        if free not in bic:
            if len(bic) >= _REFITTED and least(free) > sorted(bic.values())[_REFITTED - 1] + _UNCERTAIN:
                return math.inf
            bic[free] = whole.without(free).bic(penalty)
        return bic[free]

    best: tuple[bool, ...] | None = None
    near: Iterable[tuple[bool, ...]] = [tuple(seen.tolist())]
    while (nearest := min(near, key=criterion)) != best:
        best = nearest
        flips = [k for k, can in enumerate((seen & ~fixed).tolist()) if can]
        changes = [(), *((k,) for k in flips), *((j, k) for j, k in combinations(flips, 2) if best[j] != best[k])]
        near = [tuple(one != (k in change) for k, one in enumerate(best)) for change in changes]
    for instrument in product(*[(False, True) if x else (False,) for x in seen[:_FIRST].tolist()]):
        if bool((torch.tensor(instrument) >= fixed[:_FIRST]).all()):
            free = (*instrument, *[False] * (len(seen) - _FIRST))
            bic[free] = bic[free] if free in bic else whole.without(free).bic(penalty)
    return bic


class _Linearised(NamedTuple):
    """Outcome [N, D] about some deviations, and its derivatives in θ, in the deviations and in v_pre."""

    residual: Tensor
    slope: Tensor
    slope_deviations: Tensor
    slope_before: Tensor


@dataclass(frozen=True, kw_only=True)
class _Problem:
    """Impacts with a law, effects and candidate components."""

    model: ContactModel
    impacts: Impacts
    state: State
    stated: bool
    before: Tensor
    after: Tensor
    low: Tensor
    high: Tensor

    @classmethod
    def of(cls, model: ContactModel, impacts: Impacts) -> "_Problem":
        """Covariances of one side serve for both."""
        parameters = named_parameters(model.effects, Box(), impacts)
        limits = torch.tensor([(p.low, p.high) for p in parameters], dtype=torch.float64)
        sides = [x for x in (impacts.v_pre_cov, impacts.v_post_cov) if x is not None]
        D = impacts.space.D
        before, after = (sides[0], sides[-1]) if sides else [torch.zeros(len(impacts), D, D, dtype=torch.float64)] * 2
        return cls(
            model=model,
            impacts=impacts,
            state=State.of(impacts),
            stated=bool(sides),
            before=before,
            after=after,
            low=limits[:, 0],
            high=limits[:, 1],
        )

    @property
    def components(self) -> tuple[Component, ...]:
        return tuple(self.model.scatter.values())

    @property
    def sizes(self) -> list[int]:
        """Number of deviations of each component."""
        return [component.deviations(self.impacts.space) for component in self.components]

    @property
    def fixed(self) -> Bool[Tensor, " c"]:
        """Components that are in every set: the instrument's where no noise is stated."""
        return torch.tensor([not self.stated] * _FIRST + [False] * len(self.components))

    @property
    def still(self) -> tuple[Tensor, Tensor]:
        """No deviations, and no errors before impact."""
        n = len(self.impacts)
        return torch.zeros(n, sum(self.sizes), dtype=torch.float64), torch.zeros_like(self.impacts.v_pre)

    @cached_property
    def starts(self) -> Tensor:
        """Variances to begin with, those of the instrument first: a hundredth of the speeds."""
        d = self.impacts.space.d
        speeds = (self.impacts.v_pre[:, :d], self.impacts.v_pre[:, d:])
        instrument = [1e-4 * v.square().mean().item() + 1e-12 for v in speeds]
        own = [(_START * component.highest) ** 2 for component in self.components]
        return torch.tensor([*instrument, *own], dtype=torch.float64)

    def names(self, free: Tensor) -> tuple[str, ...]:
        """Names of the components of a set, the instrument's only where they need not be there."""
        every = [*INSTRUMENT, *(component.name for component in self.components)]
        chosen = (free & ~self.fixed).tolist()
        return tuple(name for name, is_chosen in zip(every, chosen, strict=True) if is_chosen)

    def outcome(self, theta: Tensor, u: Tensor, delta: Tensor) -> Tensor:
        """v_post [..., N, D] at parameters [..., N or 1, K], deviations [..., N, q] and errors of v_pre."""
        law, effects = self.model.law, effects_at(self.model.effects, theta)
        deviations = list(zip(self.components, u.split(self.sizes, -1), strict=True)) if self.components else []
        state = self.state.replace(v_pre=self.state.v_pre - delta)
        return resolve(law, effects, state, theta[..., 0], theta[..., 1], deviations=deviations).v_post

    def linearised(self, theta: Tensor, u: Tensor, delta: Tensor) -> _Linearised:
        """Linearise about deviations and errors; the residual is that of u = 0 and δ = 0."""
        sizes = [len(theta), u.shape[-1], delta.shape[-1]]
        columns = (*theta[:, None].expand(-1, len(u)), *u.unbind(-1), *delta.unbind(-1))

        def outcome(*parts: Tensor) -> Tensor:
            return self.outcome(*(torch.stack(part, -1) if part else u for part in _split(parts, sizes)))

        with torch.no_grad():  # the slopes themselves need no derivative
            value, slopes = linearised(outcome, columns)
        slope, per_u, per_delta = slopes.nan_to_num(0.0, 0.0, 0.0).split(sizes, -1)
        residual = self.impacts.v_post - value + matvec(per_u, u) + matvec(per_delta, delta)
        return _Linearised(residual, slope, per_u, -per_delta)

    def mixed(self, about: _Linearised) -> MixedModel:
        """Linear mixed model about a linearisation."""
        slope, units = about.slope_before, self.units
        known = self.after + slope @ self.before @ slope.mT
        instrument = [unit + slope @ unit @ slope.mT for unit in units]
        own = [g @ g.mT for g in about.slope_deviations.split(self.sizes, -1)] if self.components else []
        return MixedModel(
            residual=about.residual, slope=about.slope, known=known, bases=torch.stack([*instrument, *own])
        )

    def instrument(self, variances: Tensor) -> tuple[Tensor, Tensor]:
        """Covariances [N, D, D] of the errors before and after, from the variances of the components."""
        beside = torch.einsum("c,cij->ij", variances[:_FIRST], self.units)
        return self.before + beside, self.after + beside

    @property
    def units(self) -> Float[Tensor, "2 D D"]:
        """Covariances of velocities and spins of unit variance."""
        d, D = self.impacts.space.d, self.impacts.space.D
        return torch.diag_embed(torch.tensor([[1.0] * d + [0.0] * (D - d), [0.0] * d + [1.0] * (D - d)]).double())


def _split(parts: tuple[Tensor, ...], sizes: Sequence[int]) -> list[tuple[Tensor, ...]]:
    """Parts in groups of some sizes."""
    groups, at = list[tuple[Tensor, ...]](), 0
    for size in sizes:
        groups.append(parts[at : at + size])
        at += size
    return groups


@dataclass(frozen=True, kw_only=True)
class _Estimate:
    """Mixed model about the most probable deviations, its fit, and what it was linearised about."""

    theta: Tensor
    u: Tensor
    delta: Tensor
    free: Tensor
    model: MixedModel
    slope_deviations: Tensor
    fit: MixedFit
    converged: bool

    def bic(self, penalty: float) -> float:
        """BIC of the free components."""
        return -2 * self.fit.log_likelihood + penalty * int(self.free.sum())

    def without(self, free: Sequence[bool]) -> "_Estimate":
        """Estimate fewer components about the deviations of this estimate."""
        chosen = torch.tensor(free)
        return replace(self, free=chosen, fit=self.model.fit(self.fit.variances, chosen, self.fit.mixture))

    def seen(self, problem: _Problem, least: float) -> tuple[bool, ...]:
        """Free components whose mean share along their own directions is not less; the instrument's as they were."""
        whole = torch.einsum("nij,cnji->cn", self.fit.inverse, self.model.bases).mean(1)
        directions = torch.tensor([*[self.model.residual.shape[-1]] * _FIRST, *problem.sizes])
        large = self.fit.variances * whole >= least * directions
        large[:_FIRST] = True
        return tuple((self.free & large).tolist())

    def restricted(self, problem: _Problem, free: Sequence[bool]) -> "_Estimate":
        """Estimate fewer components on their own."""
        same = tuple(free) == tuple(self.free.tolist())
        return self if same else _estimate(problem, self.theta, torch.tensor(free), self)


def _estimate(problem: _Problem, theta: Tensor, free: Tensor, start: _Estimate | None = None) -> _Estimate:
    """Estimate the variances that are free: linear mixed models and most probable deviations in turn."""
    u, delta = problem.still
    variances, mixture = problem.starts, Mixture.initial()
    if start is not None:  # deviations of what is left out are 0
        kept = torch.cat([free[_FIRST + k].expand(size) for k, size in enumerate(problem.sizes)])
        u, delta, mixture = start.u * kept, start.delta, start.fit.mixture
        variances = torch.where(start.fit.variances > 0, start.fit.variances, 0.1 * problem.starts)
    last = -math.inf
    for left in reversed(range(_ROUNDS)):
        about = problem.linearised(theta, u, delta)
        model = problem.mixed(about)
        fit = model.fit(variances, free, mixture)
        variances, mixture = fit.variances, fit.mixture
        theta = _stepped(problem, about, fit, theta, u, delta)
        settled = abs(fit.log_likelihood - last) < _SETTLED
        if settled or left == 0:
            return _Estimate(
                theta=theta,
                u=u,
                delta=delta,
                free=free,
                model=model,
                slope_deviations=about.slope_deviations,
                fit=fit,
                converged=settled,
            )
        u, delta = _most_probable(problem, about, fit, theta, u, delta)
        last = fit.log_likelihood
        # A variance at 0 begins again with a little, since other deviations may show it.
        variances = torch.where(free & (variances <= 0), 1e-3 * problem.starts, variances)
    raise AssertionError("unreachable: the last round returns")


def _calibrated(scatter: Scatter, impacts: Impacts) -> Scatter:
    """Scale the covariance so that its 95 % ellipsoids hold 95 % of the impacts (Vovk et al. 2005)."""
    from scipy.special import chdtri  # SciPy takes long to load

    error = impacts.v_post - scatter.model.base_prediction(impacts).v_post
    inverse = torch.linalg.pinv(scatter.covariance(impacts), hermitian=True)
    distance = (error * matvec(inverse, error)).sum(-1)
    return replace(scatter, inflation=distance.quantile(_LEVEL).item() / float(chdtri(impacts.space.D, 1 - _LEVEL)))


def _prior(problem: _Problem, variances: Tensor) -> Tensor:
    """Variance [q] of each deviation."""
    each = variances[_FIRST:]
    return torch.cat([x.expand(size) for x, size in zip(each, problem.sizes, strict=True)]) if len(each) else each


def _stepped(problem: _Problem, about: _Linearised, fit: MixedFit, theta: Tensor, u: Tensor, delta: Tensor) -> Tensor:
    """Parameters after a step, shortened where the full law, whose contacts change their mode, is less likely there."""
    lengths = torch.tensor(_LENGTHS, dtype=torch.float64)[:, None]
    tried = (theta + lengths * fit.step).clamp(problem.low, problem.high)
    beside = matvec(about.slope_deviations, u) - matvec(about.slope_before, delta)
    left = problem.impacts.v_post - problem.outcome(tried[:, None], u, delta) + beside
    distance = (left * matvec(fit.inverse, left)).sum(-1)
    likelihood = fit.mixture.log_density(distance.flatten(), left.shape[-1]).logsumexp(-1).view_as(distance).sum(-1)
    return tried[likelihood.nan_to_num(-torch.inf).argmax()]


def _most_probable(
    problem: _Problem, about: _Linearised, fit: MixedFit, theta: Tensor, u: Tensor, delta: Tensor
) -> tuple[Tensor, Tensor]:
    """Most probable deviations and errors before impact, by a step from the last ones.

    A step is shortened where the full law, whose contacts change their mode, would be less probable after it.
    """
    prior, (before, after) = _prior(problem, fit.variances), problem.instrument(fit.variances)
    new_u = prior * matvec(about.slope_deviations.mT, fit.pull)
    new_delta = -matvec(before @ about.slope_before.mT, fit.pull)
    lengths = torch.tensor(_LENGTHS, dtype=torch.float64)[:, None, None]
    tried_u, tried_delta = u + lengths * (new_u - u), delta + lengths * (new_delta - delta)
    missed = problem.impacts.v_post - problem.outcome(theta.expand(1, 1, -1), tried_u, tried_delta)
    away = (tried_u.square() / prior.clamp_min(1e-300)).where(prior > 0, 0.0).sum(-1)
    for error, covariance in ((missed, after), (tried_delta, before)):
        away = away + (error * matvec(torch.linalg.pinv(covariance, hermitian=True), error)).sum(-1)
    best = away.nan_to_num(torch.inf).argmin(0)
    rows = torch.arange(len(best))
    return torch.where(prior > 0, tried_u[best, rows], 0.0), tried_delta[best, rows]


def _described(
    problem: _Problem,
    best: _Estimate,
    without: _Estimate,
    rivals: tuple[tuple[tuple[str, ...], float], ...],
    penalty: float,
) -> Scatter:
    """The result, with standard errors by Fisher information."""
    fit, components = best.fit, problem.components
    rows = (best.free & (fit.variances > 0)).nonzero()[:, 0]
    _, information = best.model.scores(fit)
    inside = information[rows][:, rows]
    size = inside.diagonal().sqrt()  # of units that differ
    covariance = torch.linalg.pinv(inside / (size[:, None] * size), hermitian=True) / (size[:, None] * size)
    spread = covariance.diagonal().clamp_min(0).sqrt()
    determined = spread * size > _DETERMINED
    labels = [(INSTRUMENT[0], "s_v", "m/s"), (INSTRUMENT[1], "s_ω", "rad/s")]
    labels += [(component.name, f"σ_{component.symbol}", component.unit) for component in components]
    deviations: list[StandardDeviation] = []
    for row, error, known in zip(rows.tolist(), spread.tolist(), determined.tolist(), strict=True):
        name, symbol, unit = labels[row]
        value = math.sqrt(fit.variances[row].item())
        near = min(error / (2 * value), math.sqrt(error)) if known else _OPEN * value  # of a variance that may be 0
        deviations.append(StandardDeviation(name=name, symbol=symbol, unit=unit, value=value, error=near))
    values = {deviation.name: deviation.value for deviation in deviations}
    estimated = {one.name: replace(one, sigma=values[one.name]) for one in components if one.name in values}
    scatter = {name: one for name, one in estimated.items() if not one.of_instrument(problem.impacts)}
    inverse = torch.linalg.inv(fit.precision)
    model = assemble(problem.model.law, problem.model.effects, best.theta, inverse)
    prior = _prior(problem, fit.variances)
    known = torch.einsum("nip,nij,njp->np", best.slope_deviations, fit.inverse, best.slope_deviations)
    errors = (prior - prior.square() * known).clamp_min(0).sqrt()
    each = zip(components, best.u.split(problem.sizes, -1), errors.split(problem.sizes, -1), strict=True)
    return Scatter(
        model=replace(model, scatter=scatter),
        deviations=tuple(deviations),
        correlation=(covariance / (spread[:, None] * spread)).nan_to_num(0.0, 0.0, 0.0),
        stated=problem.stated,
        log_likelihood=fit.log_likelihood,
        log_likelihood_without=without.fit.log_likelihood,
        bic=best.bic(penalty) - without.bic(penalty),
        rivals=rivals,
        mixture=fit.mixture,
        each={one.name: (u, error) for one, u, error in each if one.name in estimated},
        distance=fit.distance,
        converged=best.converged,
        recorded={name: one for name, one in estimated.items() if name not in scatter},
    )
