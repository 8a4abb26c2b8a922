"""Formulas for the remainder: sparse regression over the documented symbols, as lines to paste.

    +effect.mine.tau="c1*Pn*sin(3*theta)" +effect.mine.parameters.c1=[-0.01,0.01]

One or two terms of a `library` that the residual resembles are fitted together with the law and its effects, and
compared on held-out trials, as a named effect would be.  The terms are chosen on all trials and only
their coefficients on the fitted ones, so that the held-out gain flatters a formula a little; chance passes a
library in one of twenty.  A formula is a description, not a cause: where symbols move together others do as
well, and those that do are reported beside the best.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.errors import ContactLearnError, UnknownNameError
from contactlearn.diagnosis.result.remainder import Formula, WrenchComponent
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.diagnosis.unexplained.library import Library
from contactlearn.effects import Effect
from contactlearn.effects.formula.effect import formula
from contactlearn.inference.evaluation.metrics import mass_error
from contactlearn.inference.identification.joint import FitOptions, identify_jointly
from contactlearn.inference.validation import Folds
from contactlearn.laws import Law
from contactlearn.mechanics.impacts import Impacts
from contactlearn.models.contact_model import ContactModel

_RANGE = 4.0  # of a parameter on either side of 0, in units of its value in the regression
_STARTS = 3  # single terms that are fitted
_TOLERANCE = 1e-5  # nats a trial, of fits that begin next to their ends


def formula_effect(component: WrenchComponent, terms: Sequence[str], ranges: Sequence[tuple[float, float]]) -> Effect:
    """Make the effect that a formula describes, its coefficients c1, c2 starting at 0."""
    text = Formula.sum_of(terms)
    return formula({f"c{k}": list(limits) for k, limits in enumerate(ranges, 1)}, **{component.output: text})


def formulas(
    impacts: Impacts,
    model: ContactModel,
    component: str,
    folds: Folds,
    *,
    most: int = 2,
    name: str = "mine",
    options: FitOptions = FitOptions(),
    thresholds: Thresholds = Thresholds(),
) -> tuple[Formula, ...]:
    """Find the best formula for a component of the residual, at most two terms, and others as good on these data.

    Empty where none is clear.  Two terms must do clearly better than either.

    Args:
        impacts: measurements.
        model: a law with effects, fitted to these impacts.
        component: t, n or tau.
        folds: to fit the coefficients to, and to hold out.
        most: formulas, at most.
        name: of the effect while it is fitted; no effect of the model may have it.
        options: of the fits.
        thresholds: limits of what is reported.

    Raises:
        UnknownNameError: no such component.
        ContactLearnError: scikit-learn is not installed, or the model has no law.
    """
    if component not in (known := [one.value for one in WrenchComponent]):
        raise UnknownNameError("component of the wrench", component, known)
    if not isinstance(model.base, Law):
        raise ContactLearnError(f"a formula acts around a law, got {model.base}; fit one, such as law=wang_mason")
    if name in model.effects:
        raise ContactLearnError(f"the model has an effect {name} already; give the formula another name")
    component = WrenchComponent(component)
    library, y = Library.of(impacts, model, component)
    trials = _Trials(impacts, model, component, folds, name, replace(options, tolerance=_TOLERANCE))
    starts = library.resembling(y, _STARTS)
    pairs = [pair for term in starts if (pair := library.pursued(y, term, starts))]
    before = trials.held_out(model.effects, trials.start)

    def tried(terms: Sequence[str]) -> _Trial:
        return trials.tried(terms, library.coefficients(terms, y))

    one = [tried([term]) for term in dict.fromkeys((*starts, *itertools.chain(*pairs)))]
    two = [tried(pair) for pair in {frozenset(pair): pair for pair in pairs}.values()]
    return tuple(trial.formula(before) for trial in _best(one, two, before, most, thresholds))


@dataclass(frozen=True)
class _Trial:
    """Terms with ranges and fitted coefficients, and the held-out mass error with them."""

    component: WrenchComponent
    terms: tuple[str, ...]
    ranges: tuple[tuple[float, float], ...]
    coefficients: tuple[float, ...]
    error: Float[Tensor, " n"]

    def reduction(self, before: Float[Tensor, " n"]) -> float:
        """Share of the held-out error that the terms take away."""
        return 1 - (self.error.nanmean() / before.nanmean()).item()

    def formula(self, before: Float[Tensor, " n"]) -> Formula:
        """The trial as a result."""
        return Formula(
            component=self.component,
            terms=self.terms,
            ranges=self.ranges,
            coefficients=self.coefficients,
            error_reduction=self.reduction(before),
            standard_error=_error_of_mean(before - self.error) / before.nanmean().item(),
        )


@dataclass(frozen=True)
class _Trials:
    """Fits of terms on top of a model."""

    impacts: Impacts
    model: ContactModel
    component: WrenchComponent
    folds: Folds
    name: str
    options: FitOptions

    @property
    def start(self) -> Float[Tensor, " k"]:
        """Values of the model's parameters."""
        law = self.model.law
        values = [law.mu, law.eps, *(v for effect in self.model.effects.values() for v in effect.values)]
        return torch.stack([torch.as_tensor(value, dtype=torch.float64).reshape(()) for value in values])

    def held_out(self, effects: Mapping[str, Effect], start: Float[Tensor, " k"]) -> Float[Tensor, " n"]:
        """Held-out mass error of the law with effects."""
        law, rows = self.model.law, self.folds.fitted
        fit = identify_jointly(law, effects, self.impacts, rows, options=self.options, start=start)
        return self.folds.scores(mass_error(self.impacts, fit.model.predict(self.impacts)))

    def tried(self, terms: Sequence[str], coefficients: Float[Tensor, " t"]) -> _Trial:
        """Fit terms, from the coefficients of the regression, and validate them."""
        ranges = tuple(_limits(c) for c in coefficients.tolist())
        effects = {**self.model.effects, self.name: formula_effect(self.component, terms, ranges)}
        start = torch.cat((self.start, coefficients))
        fit = identify_jointly(self.model.law, effects, self.impacts, options=self.options, start=start)
        own = tuple(fit.values[len(self.start) :].tolist())
        return _Trial(self.component, tuple(terms), ranges, own, self.held_out(effects, fit.values))


def _best(
    one: Sequence[_Trial],
    two: Sequence[_Trial],
    before: Float[Tensor, " n"],
    most: int,
    thresholds: Thresholds,
) -> list[_Trial]:
    """The best trial of one or two terms, and others as good that share no term with it."""

    def clearly(gain: Tensor) -> bool:
        return gain.nanmean().item() > thresholds.chance_sigmas * _error_of_mean(gain)

    two = [trial for trial in two if all(clearly(single.error - trial.error) for single in one)]
    found = sorted((*one, *two), key=lambda trial: trial.error.nanmean().item())
    good = [t for t in found if clearly(before - t.error)]
    good = [t for t in good if not clearly(t.error - good[0].error)]
    return [t for t in good if t is good[0] or not {*good[0].terms} & {*t.terms}][:most]


def _limits(coefficient: float) -> tuple[float, float]:
    """A range of two digits about 0 that holds the coefficient amply."""
    high = float(f"{_RANGE * abs(coefficient):.1e}") or 1.0
    return -high, high


def _error_of_mean(x: Float[Tensor, " n"]) -> float:
    x = x[x.isfinite()]
    return (x.std() / math.sqrt(len(x))).item()
