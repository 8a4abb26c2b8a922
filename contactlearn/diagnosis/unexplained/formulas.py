"""Formulas for the remainder: sparse regression over the documented symbols, as lines to paste.

    +effect.mine.tau="c1*Pn*sin(3*theta)" +effect.mine.parameters.c1=[-0.01,0.01]

A term of the library is a quantity of the output's dimension (m*vy or Pn; rho*Pn or I*omega for the moment) times at
most one factor: a harmonic of θ, the sign of a velocity, the place, the order, another velocity; the first of these may
stand alone.  In space a component is taken along each axis of the slip, and the factors are those that no turn about
the normal changes, and the place.  Terms and residual are made orthogonal to the derivatives of the wrench in μ and ε.
Orthogonal matching pursuit then adds terms one by one; each must pass a test with Bonferroni's correction over the
libraries.

One or two terms that the residual resembles are fitted together with the law and its effects, and compared on held-out
trials, as a named effect would be.  The terms are chosen on all trials and only their coefficients on the fitted ones,
so that the held-out gain flatters a formula a little; chance passes a library in one of twenty.  A formula is a
description, not a cause: where symbols move together others do as well, and those are reported beside the best.
Sources: Pati, Rezaiifar & Krishnaprasad 1993; White 1980 for the test; Brunton, Proctor & Kutz 2016 for the idea.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.errors import ContactLearnError, UnknownNameError
from contactlearn.diagnosis.result.remainder import Formula, WrenchComponent, wrench_columns
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.effects import Effect, State
from contactlearn.effects.formula.effect import formula
from contactlearn.effects.formula.expression import Expression
from contactlearn.effects.formula.symbols import FORMULA_OUTPUTS, symbols
from contactlearn.inference.evaluation.metrics import mass_error
from contactlearn.inference.identification import joint
from contactlearn.inference.identification.joint import FitOptions
from contactlearn.inference.validation import Folds
from contactlearn.laws import Law
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import matvec
from contactlearn.mechanics.space import PLANE, SPACE, Space
from contactlearn.models.contact_model import ContactModel, wrench_per_parameter

_CHANCE = 0.05  # that chance gives a term a coefficient, over the library, so that what is fitted has a prospect
_IDENTICAL = 0.995  # correlation from which on two terms are the same to these data
_DISTINCT = 1e-3  # share of a term's norm that μ and ε cannot reproduce, below which they do the same
_IMPULSES = ("Pn", "Pt", "m*vx", "m*vy", "m*vt", "m*vn", "m*rho*omega")
_MOMENTS = (
    *("rho*Pn", "rho*Pt", "rx*Pn", "ry*Pn", "rx*Pt", "ry*Pt"),
    *("I*omega", "m*rho*vx", "m*rho*vy", "m*rho*vt", "m*rho*vn"),
)
_HARMONICS = tuple(f"{f}({k}theta)" for k in ("", "2*", "3*") for f in ("sin", "cos"))
_SHAPES = ("1", *_HARMONICS, "sign(vt)", "sign(omega)", "order", "x")
_FACTORS = (*_SHAPES, "abs(vt)", "abs(omega)", "vx", "vy", "vt", "vn", "omega", "rx", "ry")
_IMPULSES_IN_SPACE = ("Pn", "P1", "m*slip", "m*vn", "m*rho*spin", "m*rho*twist")
_SHAPES_IN_SPACE = ("1", "sign(twist)", "order", "x", "floor_y")
_QUANTITIES_IN_SPACE = ("slip", "vn", "incidence", "lever", "spin", "twist", "abs(twist)")
LIBRARIES = {
    PLANE: (_IMPULSES, _MOMENTS, _SHAPES, _FACTORS),
    SPACE: (
        _IMPULSES_IN_SPACE,
        tuple(f"rho*{quantity}" for quantity in _IMPULSES_IN_SPACE),
        _SHAPES_IN_SPACE,
        (*_SHAPES_IN_SPACE, *_QUANTITIES_IN_SPACE),
    ),
}
"""Quantities with the dimensions of impulses and of moments, factors that may stand alone, and all factors."""
_RANGE = 4.0  # of a parameter on either side of 0, in units of its value in the regression
_STARTS = 3  # single terms that are fitted
_MOST_FORMULAS = 2
_OPTIONS = FitOptions(tolerance=1e-5)  # nats a trial, of fits that begin next to their ends


# --- The library -----------------------------------------------------------------------------------


@dataclass(frozen=True)
class Library:
    """Terms, their values of unit norm, orthogonal to the reach of μ and ε, their norms; the number of libraries."""

    terms: tuple[str, ...]
    columns: Float[Tensor, "n l"]
    norms: Float[Tensor, " l"]
    libraries: int = 1

    @classmethod
    def of(
        cls,
        impacts: Impacts,
        model: ContactModel,
        component: WrenchComponent,
        axis: str = "",
    ) -> "tuple[Library, Float[Tensor, ' n']]":
        """Make the library, and y: the residual of the component, along an axis, that the law cannot explain."""
        every, slip = axes(component, impacts.space), impacts.slip_axes.mT
        k, wrench = every[axis], matvec(slip, model.base_prediction(impacts).wrench)
        columns, texts = _values(impacts, model, component, wrench)
        coefficients = torch.stack(_coefficients(impacts, model), -1)
        reach = (slip @ wrench_per_parameter(model.law, impacts, coefficients, model.effects))[:, k]
        residual = matvec(slip, impacts.wrench)[:, k] - wrench[:, k]
        span, scale, _ = torch.linalg.svd(reach, full_matrices=False)
        span = span[:, scale > 1e-9 * scale.max().clamp_min(1e-300)]
        whole = columns.norm(dim=0)
        columns, residual = (part - span @ (span.T @ part) for part in (columns, residual))
        norms = columns.norm(dim=0)
        good: list[int] = []
        for i in (norms > _DISTINCT * whole).nonzero()[:, 0].tolist():  # else μ or ε does the same
            unit = columns[:, i] / norms[i]
            if all((unit @ columns[:, j] / norms[j]).abs() < 1 - 1e-6 for j in good):  # the same, in other words
                good.append(i)
        library = cls(tuple(texts[i] for i in good), columns[:, good] / norms[good], norms[good], len(every))
        return library, residual

    def resembling(self, y: Float[Tensor, " n"], most: int) -> dict[str, float]:
        """Find the terms that alone explain most of y² beyond chance, and what, no two identical on these data."""
        share = (self.columns.T @ y).square()
        chosen: list[int] = []
        for k in share.argsort(descending=True, stable=True).tolist():
            correlations = [(self.columns[:, k] @ self.columns[:, other]).abs().item() for other in chosen]
            same = any(correlation > _IDENTICAL for correlation in correlations)
            if len(chosen) < most and not same and self._clear(y, [k], k):
                chosen.append(k)
        return {self.terms[k]: share[k].item() for k in chosen}

    def pursued(self, y: Float[Tensor, " n"], first: str, starts: Sequence[str]) -> list[str]:
        """Find a term and the one that matching pursuit adds to it, none of the starts, beyond chance; else nothing."""
        k = self.terms.index(first)
        free = (self.columns.T @ self.columns[:, k]).abs() <= _IDENTICAL
        free[[self.terms.index(start) for start in starts if start != first]] = False
        free[k] = True
        if free.sum() < 2:
            return []
        pair, residual = list[int](), y
        for _ in range(2):
            pair = sorted((*pair, int((self.columns.T @ residual).abs().where(free, -1.0).argmax())))
            columns = self.columns[:, pair]
            residual = y - columns @ torch.linalg.lstsq(columns, y[:, None]).solution[:, 0]
        second = [i for i in pair if i != k]
        return [first, self.terms[second[0]]] if self._clear(y, pair, second[0]) else []

    def _clear(self, y: Float[Tensor, " n"], which: list[int], last: int) -> bool:
        """Return whether the coefficient of the last of these terms is significant."""
        columns, column = self.columns[:, which], self.columns[:, last]
        residual = y - columns @ torch.linalg.lstsq(columns, y[:, None]).solution[:, 0]
        others = self.columns[:, [k for k in which if k != last]]
        column = column - others @ (others.T @ column)
        sigmas = (column @ y).abs() / (column * residual).norm().clamp_min(1e-300)  # White's standard error
        return sigmas.item() > -NormalDist().inv_cdf(_CHANCE / 2 / len(self.terms) / self.libraries)

    def coefficients(self, terms: Sequence[str], y: Float[Tensor, " n"]) -> Float[Tensor, " t"]:
        """Fit the coefficients of terms, in their own units, by least squares."""
        which = [self.terms.index(term) for term in terms]
        return torch.linalg.lstsq(self.columns[:, which], y[:, None]).solution[:, 0] / self.norms[which]


def _values(
    impacts: Impacts, model: ContactModel, component: WrenchComponent, wrench: Float[Tensor, "n D"]
) -> tuple[Float[Tensor, "n l"], list[str]]:
    """Every term of a component, with its values."""
    mu, eps = _coefficients(impacts, model)
    state = State.of(impacts).replace(mu=mu, eps=eps)
    so_far = dict(zip(FORMULA_OUTPUTS[impacts.space]["wrench"], wrench.unbind(-1), strict=True))
    lines = {text: Expression(text) for text in _texts(component, impacts.space)}
    names = {name for line in lines.values() for name in line.names}
    known = symbols(state, names, "wrench", so_far)
    columns = torch.stack([line.evaluate(known).broadcast_to(len(impacts)) for line in lines.values()], -1)
    return columns, list(lines)


def _coefficients(impacts: Impacts, model: ContactModel) -> tuple[Float[Tensor, " n"], Float[Tensor, " n"]]:
    """μ and ε of each trial."""
    mu, eps = (p.expand(len(impacts)) for p in model.law.coefficients)
    return mu, eps


def axes(component: WrenchComponent, space: Space) -> dict[str, int]:
    """Columns of a component in a wrench by the axis of the slip, 1, 2 or n: of friction and moment in space."""
    columns = wrench_columns(space)[component]
    return {"": columns[0]} if len(columns) == 1 else dict(zip("12n", columns, strict=False))


def _texts(component: WrenchComponent, space: Space) -> list[str]:
    """Every term, the short ones first."""
    impulses, moments, shapes, factors = LIBRARIES[space]
    quantities = moments if component is WrenchComponent.MOMENT else impulses
    texts = {*shapes, *(a if b == "1" else f"{a}*{b}" for a in quantities for b in factors)}
    return sorted(texts, key=lambda text: (len(re.findall(r"\w+", text)), len(text), text))


# --- Fitted formulas -------------------------------------------------------------------------------


def formula_effect(output: str, terms: Sequence[str], ranges: Sequence[tuple[float, float]]) -> Effect:
    """Make the effect that a formula describes, its coefficients c1, c2 starting at 0."""
    text = Formula.sum_of(terms)
    return formula({f"c{k}": list(limits) for k, limits in enumerate(ranges, 1)}, **{output: text})


def formulas(
    impacts: Impacts,
    model: ContactModel,
    component: str,
    folds: Folds,
    *,
    name: str = "mine",
    thresholds: Thresholds = Thresholds(),
) -> tuple[Formula, ...]:
    """Find the best formula for a component of the residual, at most two terms, and others as good on these data.

    Empty where none is clear.  Two terms must do clearly better than either.

    Args:
        impacts: measurements.
        model: a law with effects, fitted to these impacts.
        component: t, n or tau.
        folds: to fit the coefficients to, and to hold out.
        name: of the effect while it is fitted; no effect of the model may have it.
        thresholds: limits of what is reported.

    Raises:
        UnknownNameError: no such component.
        ContactLearnError: the model has no law.
    """
    if component not in (known := [kind.value for kind in WrenchComponent]):
        raise UnknownNameError("component of the wrench", component, known)
    if not isinstance(model.base, Law):
        raise ContactLearnError(f"a formula acts around a law, got {model.base}; fit one, such as law=wang_mason")
    if name in model.effects:
        raise ContactLearnError(f"the model has an effect {name} already; give the formula another name")
    component = WrenchComponent(component)
    libraries = {axis: Library.of(impacts, model, component, axis) for axis in axes(component, impacts.space)}
    trials = _Trials(impacts, model, component, folds, name)
    alike = dict[tuple[str, str], float]()
    for axis, (library, y) in libraries.items():
        alike |= {(axis, term): share for term, share in library.resembling(y, _STARTS).items()}
    starts = sorted(alike, key=alike.__getitem__, reverse=True)[:_STARTS]
    pairs = dict[tuple[str, frozenset[str]], list[str]]()
    for axis, term in starts:
        library, y = libraries[axis]
        if pair := library.pursued(y, term, [other for start_axis, other in starts if start_axis == axis]):
            pairs[axis, frozenset(pair)] = pair
    before = trials.held_out(model.effects, trials.start)

    single = [*dict.fromkeys((*starts, *((axis, term) for (axis, _), pair in pairs.items() for term in pair)))]
    terms = [*((axis, [term]) for axis, term in single), *((axis, pair) for (axis, _), pair in pairs.items())]
    coefficients = (libraries[axis][0].coefficients(some, libraries[axis][1]) for axis, some in terms)
    tried = [trials.tried(*term, c) for term, c in zip(terms, coefficients, strict=True)]
    best = _best(tried[: len(single)], tried[len(single) :], before, thresholds)
    return tuple(trial.formula(before) for trial in best)


@dataclass(frozen=True)
class _Trial:
    """Terms with ranges and fitted coefficients, and the held-out mass error with them."""

    component: WrenchComponent
    axis: str
    terms: tuple[str, ...]
    ranges: tuple[tuple[float, float], ...]
    coefficients: tuple[float, ...]
    error: Float[Tensor, " n"]

    def formula(self, before: Float[Tensor, " n"]) -> Formula:
        """The trial as a result."""
        return Formula(
            component=self.component,
            axis=self.axis,
            terms=self.terms,
            ranges=self.ranges,
            coefficients=self.coefficients,
            error_reduction=1 - (self.error.nanmean() / before.nanmean()).item(),
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

    @property
    def start(self) -> Float[Tensor, " k"]:
        """Values of the model's parameters."""
        return torch.stack([value.reshape(()) for value in self.model.values])

    def held_out(self, effects: Mapping[str, Effect], start: Float[Tensor, " k"]) -> Float[Tensor, " n"]:
        """Held-out mass error of the law with effects."""
        law, rows = self.model.law, self.folds.fitted
        fit = joint.fit(self.impacts, law, effects, rows=rows, options=_OPTIONS, start=start)
        return self.folds.scores(mass_error(self.impacts, fit.model.predict(self.impacts)))

    def tried(self, axis: str, terms: Sequence[str], coefficients: Float[Tensor, " t"]) -> _Trial:
        """Fit terms along an axis, from the coefficients of the regression, and validate them."""
        highs = [float(f"{_RANGE * abs(c):.1e}") or 1.0 for c in coefficients.tolist()]  # two digits, amply
        ranges = tuple((-high, high) for high in highs)
        effects = {**self.model.effects, self.name: formula_effect(self.component.output(axis), terms, ranges)}
        start = torch.cat((self.start, coefficients))
        fit = joint.fit(self.impacts, self.model.law, effects, options=_OPTIONS, start=start)
        fitted = tuple(fit.values[len(self.start) :].tolist())
        return _Trial(self.component, axis, tuple(terms), ranges, fitted, self.held_out(effects, fit.values))


def _best(
    single: Sequence[_Trial],
    pairs: Sequence[_Trial],
    before: Float[Tensor, " n"],
    thresholds: Thresholds,
) -> list[_Trial]:
    """The best trial of one or two terms, and others as good that share no term with it."""

    def clearly(gain: Tensor) -> bool:
        return gain.nanmean().item() > thresholds.chance_sigmas * _error_of_mean(gain)

    pairs = [pair for pair in pairs if all(clearly(trial.error - pair.error) for trial in single)]
    ranked = sorted((*single, *pairs), key=lambda trial: trial.error.nanmean().item())
    good = [t for t in ranked if clearly(before - t.error)]
    good = [t for t in good if not clearly(t.error - good[0].error)]
    return [t for t in good if t is good[0] or not {*good[0].terms} & {*t.terms}][:_MOST_FORMULAS]


def _error_of_mean(x: Float[Tensor, " n"]) -> float:
    x = x[x.isfinite()]
    return (x.std() / math.sqrt(len(x))).item()
