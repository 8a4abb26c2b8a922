"""Formulas for what remains: sparse regression over the documented symbols, as lines to paste.

    +effect.mine.tau="c1*Pn*sin(3*theta)" +effect.mine.parameters.c1=[-0.01,0.01]

One or two terms of a `library` that the remainder resembles are fitted together with the law and its effects, and
compared on held-out trials, as a named effect would be.  The terms are chosen on all trials and only
their coefficients on the fitted ones, so that the held-out gain flatters a formula a little; chance passes a
library in one of twenty.  A formula is a description, not a cause: where symbols move together others do as
well, and those that do are told beside the best.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from contactlearn.diagnosis.search.selection import Folds
from contactlearn.diagnosis.unexplained.library import Library
from contactlearn.diagnosis.unexplained.remainder import COMPONENTS
from contactlearn.effects import Effect
from contactlearn.effects.formula.effect import formula
from contactlearn.errors import ContactLearnError, UnknownNameError
from contactlearn.evaluation.metrics import mass_error
from contactlearn.identification.joint import FitOptions, identify_jointly
from contactlearn.impacts import Impacts
from contactlearn.laws import Law
from contactlearn.model import ContactModel

OUTPUT = {"t": "Pt", "n": "Pn", "tau": "tau"}
"""The output of a formula for each component."""

_RANGE = 4.0  # of a parameter on either side of 0, in units of its value in the regression
_STARTS = 3  # single terms that are fitted
_SIGMAS = 2.0  # that a held-out gain must be from 0
_WORTH = 0.01  # share of the held-out error that a formula must take off to be told


@dataclass(frozen=True, eq=False)
class Formula:
    """One or two terms on top of an output, with the range [low, high] of each coefficient.

    `before` and `error` [N] are held-out mass errors without and with it, `values` its coefficients on all trials.
    """

    output: str
    terms: tuple[str, ...]
    ranges: tuple[tuple[float, float], ...]
    values: tuple[float, ...] = ()
    before: Tensor | None = None
    error: Tensor | None = None

    @property
    def text(self) -> str:
        """Such as c1*Pn*sin(3*theta) + c2*Pn."""
        parts = (f"c{k}" + ("" if term == "1" else f"*{term}") for k, term in enumerate(self.terms, 1))
        return " + ".join(parts)

    @property
    def parameters(self) -> dict[str, list[float]]:
        """[low, high] by name."""
        return {f"c{k}": list(limits) for k, limits in enumerate(self.ranges, 1)}

    @cached_property
    def effect(self) -> Effect:
        """The formula as an effect, its coefficients starting at 0."""
        return formula(self.parameters, **{self.output: self.text})

    def overrides(self, name: str = "mine") -> tuple[str, ...]:
        """What a command takes, one argument each; quote them for a shell."""
        ranges = (f"+effect.{name}.parameters.{key}=[{low:g},{high:g}]" for key, (low, high) in self.parameters.items())
        return (f'+effect.{name}.{self.output}="{self.text}"', *ranges)

    @property
    def gain(self) -> float:
        """Share of the held-out mass error that it takes off."""
        return 1 - (self.error.nanmean() / self.before.nanmean()).item()

    @property
    def gain_error(self) -> float:
        """Standard error of the gain, over the trials."""
        return _error_of_mean(self.before - self.error) / self.before.nanmean().item()

    def __str__(self) -> str:
        line = " ".join(f"'{override}'" for override in self.overrides())
        return f"{line}  takes {self.gain:.0%} ± {self.gain_error:.0%} off the held-out error"


def formulas(
    impacts: Impacts,
    model: ContactModel,
    component: str,
    folds: Folds,
    *,
    most: int = 2,
    name: str = "mine",
    options: FitOptions = FitOptions(),
) -> list[Formula]:
    """The best formula for a component of what a model leaves, at most two terms, and others as good on this data.

    Empty where none is clear.  Two terms must do clearly better than either.

    Args:
        model: a law with effects, fitted to these impacts.
        component: t, n or tau.
        folds: what the coefficients are fitted to, and held out.
        most: formulas, at most.
        name: of the effect while it is fitted; no effect of the model may have it.
        options: of the fits.

    Raises:
        UnknownNameError: no such component.
        ContactLearnError: scikit-learn is not installed, or the model has no law.
    """
    if component not in COMPONENTS:
        raise UnknownNameError("component of the wrench", component, COMPONENTS)
    if not isinstance(model.base, Law):
        raise ContactLearnError(f"a formula acts around a law, got {model.base}; fit one, such as law=wang_mason")
    if name in model.effects:
        raise ContactLearnError(f"the model has an effect {name} already; give the formula another name")
    library, y = Library.of(impacts, model, component)
    values = [model.base.mu, model.base.eps, *(v for effect in model.effects.values() for v in effect.values)]
    start = torch.stack([torch.as_tensor(value, dtype=torch.float64).reshape(()) for value in values])

    def held_out(effects, start: Tensor) -> Tensor:
        fit = identify_jointly(model.base, effects, impacts, folds.fitted, options=options, start=start)
        return folds.scores(mass_error(impacts, fit.model.predict(impacts)))

    before = held_out(model.effects, start)

    def tried(terms: Sequence[str]) -> Formula:
        coefficients = library.coefficients(terms, y)
        candidate = Formula(OUTPUT[component], tuple(terms), tuple(_limits(c) for c in coefficients.tolist()))
        effects = {**model.effects, name: candidate.effect}
        fit = identify_jointly(model.base, effects, impacts, options=options, start=torch.cat((start, coefficients)))
        own = tuple(fit.values[len(start) :].tolist())
        return Formula(
            *(candidate.output, candidate.terms, candidate.ranges),
            values=own, before=before, error=held_out(effects, fit.values),
        )  # fmt: skip

    starts = library.resembling(y, _STARTS)
    pairs = [pair for term in starts if (pair := library.pursued(y, term, starts))]
    one = [tried([term]) for term in dict.fromkeys((*starts, *itertools.chain(*pairs)))]
    two = [tried(pair) for pair in {frozenset(pair): pair for pair in pairs}.values()]
    two = [f for f in two if all(_clearly(single.error - f.error) for single in one)]
    found = sorted((*one, *two), key=lambda f: f.error.nanmean().item())
    told = [f for f in found if f.gain > _WORTH and _clearly(f.before - f.error)]
    told = [f for f in told if not _clearly(f.error - told[0].error)]
    return [f for f in told if f is told[0] or not {*told[0].terms} & {*f.terms}][:most]


def _clearly(gain: Tensor) -> bool:
    """Whether the mean of a gain [N] over the trials is above 0 by more than chance."""
    return gain.nanmean().item() > _SIGMAS * _error_of_mean(gain)


def _limits(coefficient: float) -> tuple[float, float]:
    """A range of two digits about 0 that holds the coefficient amply."""
    high = float(f"{_RANGE * abs(coefficient):.1e}") or 1.0
    return -high, high


def _error_of_mean(x: Tensor) -> float:
    x = x[x.isfinite()]
    return (x.std() / math.sqrt(len(x))).item()
