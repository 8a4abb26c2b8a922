"""The library of terms that formulas are made of, and the selection of those that a residual resembles.

A term is a quantity of the output's dimension (m*vy or Pn; rho*Pn or I*omega for the moment) and at most one
factor of it: a harmonic of θ, the sign of a velocity, the place, the order, another velocity.  The first of
these may stand alone.
Terms and residual are made orthogonal to the derivatives of the wrench in μ and ε.  Orthogonal matching
pursuit then adds terms one by one; each must pass a test with Bonferroni's correction over the library.
Sources: Pati, Rezaiifar & Krishnaprasad 1993; White 1980 for the test; Brunton, Proctor & Kutz 2016 for the idea.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.errors import ContactLearnError, installing
from contactlearn.diagnosis.result.remainder import WrenchComponent
from contactlearn.effects import State
from contactlearn.effects.base import OUTPUTS
from contactlearn.effects.formula.expression import Expression
from contactlearn.effects.formula.symbols import symbols
from contactlearn.mechanics.impacts import Impacts
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


@dataclass(frozen=True)
class Library:
    """Terms, their values of unit norm, orthogonal to the reach of μ and ε, and their norms."""

    terms: tuple[str, ...]
    columns: Float[Tensor, "n l"]
    norms: Float[Tensor, " l"]

    @classmethod
    def of(
        cls,
        impacts: Impacts,
        model: ContactModel,
        component: WrenchComponent,
    ) -> "tuple[Library, Float[Tensor, ' n']]":
        """Make the library, and y: the residual of the component that the law cannot explain.

        Raises:
            ContactLearnError: scikit-learn is not installed.
        """
        _pursuit()  # before any work is done
        k, wrench = list(WrenchComponent).index(component), model.base_prediction(impacts).wrench
        columns, texts = _values(impacts, model, component, wrench)
        reach = _reach_of_law(impacts, model)[:, k]
        residual = impacts.wrench[:, k] - wrench[:, k]
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
        library = cls(tuple(texts[i] for i in good), columns[:, good] / norms[good], norms[good])
        return library, residual

    def resembling(self, y: Float[Tensor, " n"], most: int) -> list[str]:
        """Find the terms that alone explain most of y beyond chance, no two of them identical on these data."""
        share = (self.columns.T @ y).square() / y.square().sum().clamp_min(1e-300)
        chosen: list[int] = []
        for k in share.argsort(descending=True, stable=True).tolist():
            correlations = [(self.columns[:, k] @ self.columns[:, other]).abs().item() for other in chosen]
            same = any(correlation > _IDENTICAL for correlation in correlations)
            if len(chosen) < most and not same and self._clear(y, [k], k):
                chosen.append(k)
        return [self.terms[k] for k in chosen]

    def pursued(self, y: Float[Tensor, " n"], first: str, starts: Sequence[str]) -> list[str]:
        """Find a term and the one that matching pursuit adds to it, none of the starts, beyond chance; else nothing."""
        k = self.terms.index(first)
        free = (self.columns.T @ self.columns[:, k]).abs() <= _IDENTICAL
        free[[self.terms.index(start) for start in starts if start != first]] = False
        free[k] = True
        if free.sum() < 2:
            return []
        fit = _pursuit()(n_nonzero_coefs=2, fit_intercept=False).fit(self.columns[:, free].numpy(), y.numpy())
        pair = free.nonzero()[:, 0][torch.from_numpy(fit.coef_ != 0)].tolist()
        second = [i for i in pair if i != k]
        return [first, self.terms[second[0]]] if len(pair) == 2 and second and self._clear(y, pair, second[0]) else []

    def _clear(self, y: Float[Tensor, " n"], which: list[int], last: int) -> bool:
        """Whether chance gives the last of these terms such a coefficient in fewer libraries than is allowed."""
        columns, own = self.columns[:, which], self.columns[:, last]
        residual = y - columns @ torch.linalg.lstsq(columns, y[:, None]).solution[:, 0]
        others = self.columns[:, [k for k in which if k != last]]
        own = own - others @ (others.T @ own)
        sigmas = (own @ y).abs() / (own * residual).norm().clamp_min(1e-300)  # White's standard error
        return sigmas.item() > -NormalDist().inv_cdf(_CHANCE / 2 / len(self.terms))

    def coefficients(self, terms: Sequence[str], y: Float[Tensor, " n"]) -> Float[Tensor, " t"]:
        """Fit the coefficients of terms, in their own units, by least squares."""
        which = [self.terms.index(term) for term in terms]
        return torch.linalg.lstsq(self.columns[:, which], y[:, None]).solution[:, 0] / self.norms[which]


def _values(
    impacts: Impacts, model: ContactModel, component: WrenchComponent, wrench: Float[Tensor, "n 3"]
) -> tuple[Float[Tensor, "n l"], list[str]]:
    """Every term of a component, with its values."""
    mu, eps = _coefficients(impacts, model)
    state = State.of(impacts).replace(mu=mu, eps=eps)
    so_far = dict(zip(OUTPUTS["wrench"], wrench.unbind(-1), strict=True))
    lines = {text: Expression(text) for text in _texts(component)}
    names = {name for line in lines.values() for name in line.names}
    known = symbols(state, names, "wrench", so_far)
    columns = torch.stack([line.evaluate(known).broadcast_to(len(impacts)) for line in lines.values()], -1)
    return columns, list(lines)


def _reach_of_law(impacts: Impacts, model: ContactModel) -> Float[Tensor, "n 3 2"]:
    """Derivative of the wrench in μ and ε."""
    return wrench_per_parameter(model.law, impacts, torch.stack(_coefficients(impacts, model), -1), model.effects)


def _coefficients(impacts: Impacts, model: ContactModel) -> tuple[Float[Tensor, " n"], Float[Tensor, " n"]]:
    """μ and ε of each trial."""
    mu, eps = (p.expand(len(impacts)) for p in model.law.coefficients)
    return mu, eps


def _texts(component: WrenchComponent) -> list[str]:
    """Every term, the short ones first."""
    quantities = _MOMENTS if component is WrenchComponent.MOMENT else _IMPULSES
    texts = {*_SHAPES, *(_product(a, b) for a in quantities for b in _FACTORS)}
    return sorted(texts, key=lambda text: (len(re.findall(r"\w+", text)), len(text), text))


def _product(quantity: str, factor: str) -> str:
    return quantity if factor == "1" else f"{quantity}*{factor}"


def _pursuit() -> type:
    try:
        from sklearn.linear_model import OrthogonalMatchingPursuit
    except ImportError as error:
        raise ContactLearnError(
            f"formulas for what remains need scikit-learn, which is not installed: {installing('formulas')}"
        ) from error
    return OrthogonalMatchingPursuit
