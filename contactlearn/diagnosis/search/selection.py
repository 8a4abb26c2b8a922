"""Which effects are missing: forward selection over a catalogue, by score tests and held-out error.

    screen    score test of every candidate from the one fit of the present model: does the loss fall if it is let in?
    refit     the most promising are fitted together with the law and the effects chosen so far
    compare   the best of these, on folds that were not fitted to, trial by trial against the present model
    admit     the best, if the score test survives Bonferroni's correction over all candidates and the held-out
              error falls by more than chance and by more than is worth a name
    re-test   effects chosen earlier that are not missed any more are taken out again

until nothing earns its place.  All folds of a candidate are fitted at once.
Sources: Rao 1948, with the covariance of White 1982; Davies 1977; Stone 1974.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

import torch
from scipy.stats import chi2
from torch import Tensor

from contactlearn.diagnosis.discrimination.contest import robust_covariance
from contactlearn.effects import Effect, EffectId, columns
from contactlearn.errors import DataError
from contactlearn.evaluation.metrics import mass_error
from contactlearn.identification.joint import FitOptions, JointFit, identify_jointly, linearise
from contactlearn.identification.robust import robust_distance
from contactlearn.impacts import Impacts
from contactlearn.laws import Law

FALSE_ALARMS = 0.05
"""Chance that something is admitted where nothing is missing, over all candidates."""
LEAST_GAIN = 0.03
"""Share of the held-out error that an effect must take off to be worth a name."""
_REFITTED, _COMPARED = 8, 4
_PLACES = 8  # at which a candidate is tested whose place means nothing where it vanishes
_MOST = 10
_SURE = 60.0  # Wald statistic from which on an effect is missed without a doubt
_SIGMAS = 2.0  # that the held-out gain of an admitted effect must be from 0


@dataclass(frozen=True)
class Folds:
    """Rows to fit to [B, n] and held out [B, m] of repeated cross-validation; each trial is held out as often."""

    fitted: Tensor
    held_out: Tensor

    @classmethod
    def draw(cls, trials: int, generator: torch.Generator, folds: int = 5, repeats: int = 2) -> "Folds":
        if trials < 4 * folds:
            raise DataError(f"cross-validation in {folds} folds needs at least {4 * folds} trials, got {trials}")
        size = trials // folds
        fitted, held_out = [], []
        for _ in range(repeats):
            order = torch.randperm(trials, generator=generator)
            for k in range(folds):
                part = torch.zeros(trials, dtype=torch.bool)
                part[k * size : (k + 1) * size] = True
                held_out.append(order[part])
                fitted.append(order[~part])
        return cls(torch.stack(fitted), torch.stack(held_out))

    def scores(self, score: Tensor) -> Tensor:
        """Mean score [N] of each trial when it was held out, from scores [B, N]; nan where it never was."""
        picked = score.gather(1, self.held_out)
        total = torch.zeros(score.shape[1], dtype=score.dtype).index_add(0, self.held_out.flatten(), picked.flatten())
        return total / torch.bincount(self.held_out.flatten(), minlength=score.shape[1])


@dataclass(frozen=True)
class Fitted:
    """A model on all trials, and what it leaves of each when that is held out [N]."""

    effects: Mapping[str, Effect]
    fit: JointFit
    error: Tensor  # mass error
    loss: Tensor  # −log density of v_post but for a constant, robust and in the scatter that the model leaves, nats


@dataclass(frozen=True)
class Test:
    """A candidate beside the present model: its score test, and once refitted its held-out gain."""

    id: EffectId
    effect: Effect
    statistic: float
    p_value: float
    start: Tensor  # values of its parameters at which it vanishes and was tested, to be refitted from
    fitted: Fitted | None = None
    gain: float = math.nan  # of the held-out loss, nats a trial
    gain_error: float = math.nan
    error: float = math.nan  # held-out mass error

    @property
    def sigmas(self) -> float:
        return self.gain / self.gain_error if self.gain_error > 0 else math.nan


@dataclass(frozen=True)
class Step:
    """What one round of the selection saw and did."""

    before: Fitted
    tests: tuple[Test, ...]
    admitted: Test | None
    dropped: tuple[str, ...] = ()


class Selection:
    """Forward selection with re-testing; `steps` tells what was seen."""

    def __init__(
        self, law: Law, impacts: Impacts, candidates: Mapping[EffectId, Effect], folds: Folds,
        given: Mapping[str, Effect], options: FitOptions = FitOptions(),
    ):  # fmt: skip
        self.law, self.impacts, self.folds, self.options = law, impacts, folds, options
        self.candidates = {key: effect.prepare(impacts) for key, effect in candidates.items()}
        self.given = dict(given)
        first = identify_jointly(law, self.given, impacts, options=options)
        self.scatter: Tensor | None = None  # one yardstick for all losses; None: each model's own
        self.base = self.present = self.validated(self.given, first)
        self.steps: list[Step] = []

    def run(self, progress: Callable[[Iterable], Iterable] = iter) -> Fitted:
        """Admit and drop until nothing earns its place; the chosen model."""
        seen = [frozenset(identities(self.present.effects))]
        while len(self.present.effects) - len(self.given) < _MOST:
            before, tests = self.present, self.tests(progress)
            best = max((t for t in tests if self._earns(t)), key=lambda t: t.gain, default=None)
            dropped = ()
            if best is not None:
                best = self._searched(best)
                self.present = best.fitted
                dropped = self._drop(keep=best.id.name)
            self.steps.append(Step(before, tuple(tests), best, dropped))
            chosen = frozenset(identities(self.present.effects))
            if best is None or chosen in seen:
                break
            seen.append(chosen)
        return self.present

    def tests(self, progress: Callable[[Iterable], Iterable] = iter) -> list[Test]:
        """Every candidate that is in no form in the model yet, the most promising ones refitted and compared."""
        tests = [self.score_test(key) for key in self.candidates if key.name not in self.present.effects]
        tests.sort(key=lambda t: t.p_value)
        refits = {}
        for test in progress([t for t in tests[:_REFITTED] if t.p_value < FALSE_ALARMS]):
            start = torch.cat((self.present.fit.values, test.start))
            refits[test.id] = self.fit(self._with(test), start=start)
        trials = len(self.impacts)
        best = sorted(refits, key=lambda key: refits[key].loss.item() + len(refits[key].parameters) / trials)
        return [self._compared(t, refits[t.id]) if t.id in best[:_COMPARED] else t for t in tests]

    def score_test(self, candidate: EffectId) -> Test:
        """Whether the loss falls if the candidate is let in, from the present fit alone.

        With s the trials' gradients in the candidate's parameters at their vanishing values, made orthogonal to
        the parameters that are fitted already, (Σ s)ᵀ (Σ s sᵀ)⁻¹ (Σ s) is χ² with as many degrees as parameters.
        A parameter that means nothing where the effect vanishes, such as the place of a spot, is tried at several
        values, and the p-value is that of the best times their number (Davies 1977).
        """
        points = _where_it_vanishes(self.candidates[candidate])
        tests = [self._score_test(candidate, point) for point in points]
        best = min(tests, key=lambda t: t.p_value)
        return replace(best, p_value=min(1.0, len(tests) * best.p_value))

    def _score_test(self, candidate: EffectId, own: Tensor) -> Test:
        effect, present = self.candidates[candidate], self.present
        theta = torch.cat((present.fit.values, own))
        about = linearise(
            self.law,
            {**present.effects, candidate.name: effect},
            self.impacts,
            theta,
            present.fit.scatter,
            options=self.options,
        )
        slope = about.slope[..., about.slope.abs().amax((0, 1)) > 0]
        K = present.fit.values.shape[0]
        K = int((about.slope[..., :K].abs().amax((0, 1)) > 0).sum())
        weighted = (about.weight[:, None, None] * slope).flatten(0, 1)
        curvature = slope.flatten(0, 1).T @ weighted
        gradients = about.weight[:, None] * (slope * about.residual[..., None]).sum(1)  # [N, K]
        known, new = gradients[:, :K], gradients[:, K:]
        if new.shape[1] == 0:
            return Test(candidate, effect, 0.0, 1.0, own)
        efficient = new - known @ torch.linalg.lstsq(curvature[:K, :K], curvature[:K, K:]).solution
        total, spread = efficient.sum(0), efficient.T @ efficient
        scale = spread.diagonal().sqrt().clamp_min(1e-300)
        spread = spread / (scale[:, None] * scale) + 1e-9 * torch.eye(len(scale), dtype=spread.dtype)
        statistic = (total / scale @ torch.linalg.solve(spread, total / scale)).item()
        # At a bound, and drawn beyond it: it would stay where it vanishes.
        only = effect.parameters[0]
        if len(effect.parameters) == 1 and only.vanishing in (only.low, only.high):
            outwards = total.item() > 0 if only.vanishing == only.low else total.item() < 0  # the loss rises inwards
            if outwards:
                return Test(candidate, effect, 0.0, 1.0, own)
        return Test(candidate, effect, statistic, float(chi2.sf(statistic, new.shape[1])), own)

    def fit(self, effects: Mapping[str, Effect], start: Tensor | None = None) -> JointFit:
        """The law with effects, fitted to all trials: from a start, or by a search."""
        return identify_jointly(self.law, effects, self.impacts, options=replace(self.options, starts=4), start=start)

    def without(self, name: str) -> Fitted:
        """The present model without one of its effects, fitted again and validated."""
        others, values = without(self.present, name)
        return self.validated(others, self.fit(others, start=values))

    def _compared(self, test: Test, fit: JointFit) -> Test:
        """The candidate with a fit of it beside the present model."""
        fitted = self.validated(self._with(test), fit)
        gain, error = paired_gain(self.present, fitted)
        return replace(test, fitted=fitted, gain=gain, gain_error=error, error=fitted.error.nanmean().item())

    def _searched(self, test: Test) -> Test:
        """The candidate from other starts as well, where that is better."""
        fit = self.fit(self._with(test))
        return self._compared(test, fit) if fit.loss < test.fitted.fit.loss - 1e-6 else test

    def _with(self, test: Test) -> dict[str, Effect]:
        return {**self.present.effects, test.id.name: test.effect}

    def _earns(self, test: Test) -> bool:
        before = self.present.error.nanmean().item()
        return (
            test.p_value < FALSE_ALARMS / len(self.candidates)
            and test.sigmas > _SIGMAS
            and test.error < (1 - LEAST_GAIN) * before
        )

    def _drop(self, keep: str) -> tuple[str, ...]:
        """Take out what is not missed any more, one at a time, never what was given or has just come."""
        dropped = []
        while True:
            costs = []
            for name in self.present.effects:
                if name == keep or name in self.given or wald(self.present, name) > _SURE:
                    continue
                fitted = self.without(name)
                cost, error = paired_gain(fitted, self.present)
                costs.append((cost / max(error, 1e-300), name, fitted))
            if not costs or min(costs, key=lambda c: c[0])[0] > _SIGMAS:
                return tuple(dropped)
            _, name, self.present = min(costs, key=lambda c: c[0])
            dropped.append(name)

    def validated(self, effects: Mapping[str, Effect], fit: JointFit) -> Fitted:
        """Held-out scores of a model whose fit to all trials is known."""
        held = identify_jointly(
            self.law, effects, self.impacts, self.folds.fitted, options=self.options, start=fit.values
        ).model.predict(self.impacts)
        whole = self.impacts.v_post - fit.model.predict(self.impacts).v_post
        scatter = robust_covariance(whole) if self.scatter is None else self.scatter
        left = self.impacts.v_post - held.v_post
        loss = robust_distance(left, scatter.expand(len(left), 3, 3)) + 0.5 * scatter.logdet()
        return Fitted(effects, fit, self.folds.scores(mass_error(self.impacts, held)), self.folds.scores(loss))


def without(model: Fitted, name: str) -> tuple[dict[str, Effect], Tensor]:
    """The other effects of a model, and the values of its parameters but for those of the one."""
    kept = ~_own(model, name)
    return {key: effect for key, effect in model.effects.items() if key != name}, model.fit.values[kept]


def wald(model: Fitted, name: str) -> float:
    """How far the parameters of an effect are from where it vanishes, χ² with as many degrees of freedom."""
    own = _own(model, name)
    away = model.fit.values[own] - columns(*model.effects[name].vanished().values)
    return (away @ torch.linalg.solve(model.fit.covariance[own][:, own], away)).item()


def _own(model: Fitted, name: str) -> Tensor:
    """Which of a model's parameters [K] are those of one effect."""
    return torch.tensor([p.name.startswith(f"{name}.") for p in model.fit.parameters])


def identities(effects: Mapping[str, Effect]) -> list[EffectId]:
    """Return name and form of each effect of a model."""
    return [EffectId(name, effect.form) for name, effect in effects.items()]


def _where_it_vanishes(effect: Effect) -> Tensor:
    """Values [n, K] at which an effect vanishes: one, or several of the parameters that mean nothing there."""
    free = [k for k, p in enumerate(effect.parameters) if p.vanishing is None]
    vanished = columns(*effect.vanished().values)
    if not free:
        return vanished[None]
    low, high = torch.tensor([(p.low, p.high) for p in effect.parameters], dtype=torch.float64)[free].T
    places = torch.quasirandom.SobolEngine(len(free), scramble=True, seed=0).draw(_PLACES - 1, dtype=torch.float64)
    points = vanished.repeat(_PLACES, 1)
    points[1:, free] = low + places * (high - low)
    return points


def paired_gain(before: Fitted, after: Fitted) -> tuple[float, float]:
    """Mean held-out gain of the loss over the trials in nats, and its standard error."""
    gain = before.loss - after.loss
    gain = gain[gain.isfinite()]
    return gain.mean().item(), (gain.std() / math.sqrt(len(gain))).item()
