"""The library of terms that formulas are made of, and which of them what remains of a component resembles.

A term is a quantity of the output's dimension (m*vy or Pn; rho*Pn or I*omega for the moment) and at most one
modulation of it: a harmonic of θ, the sign of a velocity, the place, the order, another velocity.  The first of
these may stand alone.
Both the terms and what the model leaves are made orthogonal to what μ and ε could still do.  Orthogonal matching
pursuit then adds terms one by one; each must pass a test with Bonferroni's correction over the library.
Sources: Pati, Rezaiifar & Krishnaprasad 1993; White 1980 for the test; Brunton, Proctor & Kutz 2016 for the idea.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from scipy.stats import norm
from torch import Tensor

from contactlearn.diagnosis.unexplained.remainder import COMPONENTS
from contactlearn.effects import State
from contactlearn.effects.formula.expression import Expression
from contactlearn.effects.formula.symbols import OUTPUTS, symbols
from contactlearn.errors import ContactLearnError
from contactlearn.impacts import Impacts
from contactlearn.model import ContactModel, wrench_per_parameter

_IMPULSES = ("Pn", "Pt", "m*vx", "m*vy", "m*vt", "m*vn", "m*rho*omega")
_MOMENTS = (
    *("rho*Pn", "rho*Pt", "rx*Pn", "ry*Pn", "rx*Pt", "ry*Pt"),
    *("I*omega", "m*rho*vx", "m*rho*vy", "m*rho*vt", "m*rho*vn"),
)
_HARMONICS = tuple(f"{f}({k}theta)" for k in ("", "2*", "3*") for f in ("sin", "cos"))
_SHAPES = ("1", *_HARMONICS, "sign(vt)", "sign(omega)", "order", "x")
_MODULATIONS = (*_SHAPES, "abs(vt)", "abs(omega)", "vx", "vy", "vt", "vn", "omega", "rx", "ry")
_ALIKE = 0.995  # correlation from which on two terms are the same to this data
_FALSE_ALARMS = 0.05  # of a term, over the library
_GROSS = 8.0  # robust standard deviations at which a remainder is curbed


@dataclass(frozen=True)
class Library:
    """Terms and their values [N, L] of unit norm, orthogonal to what the law can still do, and their norms [L]."""

    terms: tuple[str, ...]
    columns: Tensor
    norms: Tensor

    @classmethod
    def of(cls, impacts: Impacts, model: ContactModel, component: str) -> "tuple[Library, Tensor]":
        """The library, and y [N]: what the model leaves of the component and the law cannot do, gross values curbed.

        Raises:
            ContactLearnError: scikit-learn is not installed.
        """
        _pursuit()  # before any work is done
        k, wrench = COMPONENTS.index(component), model.base_prediction(impacts).wrench
        mu, eps = (
            torch.as_tensor(p, dtype=torch.float64).expand(len(impacts)) for p in (model.base.mu, model.base.eps)
        )
        state = State.of(impacts).replace(mu=mu, eps=eps)
        so_far = dict(zip(OUTPUTS["wrench"], wrench.unbind(-1), strict=True))
        lines = {text: Expression(text) for text in _texts(component)}
        names = {name for line in lines.values() for name in line.names}
        known = symbols(state, names, "wrench", so_far)
        columns = torch.stack([line.evaluate(known).broadcast_to(len(impacts)) for line in lines.values()], -1)
        able = wrench_per_parameter(model.base, impacts, torch.stack((mu, eps), -1), model.effects)[:, k]
        able, scale, _ = torch.linalg.svd(able, full_matrices=False)
        able = able[:, scale > 1e-9 * scale.max().clamp_min(1e-300)]
        left = impacts.wrench[:, k] - wrench[:, k]
        limit = _GROSS * 1.4826 * (left - left.median()).abs().median()
        left = left.clamp(left.median() - limit, left.median() + limit)
        whole = columns.norm(dim=0)
        columns, left = (part - able @ (able.T @ part) for part in (columns, left))
        norms = columns.norm(dim=0)
        terms, good = list(lines), []
        for i in (norms > 0.05 * whole).nonzero()[:, 0].tolist():  # else μ or ε does the same
            unit = columns[:, i] / norms[i]
            if all((unit @ columns[:, j] / norms[j]).abs() < 1 - 1e-6 for j in good):  # the same, in other words
                good.append(i)
        return cls(tuple(terms[i] for i in good), columns[:, good] / norms[good], norms[good]), left

    def resembling(self, y: Tensor, most: int) -> list[str]:
        """The terms that alone leave least of y, no two alike, of those that are no chance."""
        share = (self.columns.T @ y).square() / y.square().sum().clamp_min(1e-300)
        chosen: list[int] = []
        for k in share.argsort(descending=True, stable=True).tolist():
            alike = any((self.columns[:, k] @ self.columns[:, other]).abs() > _ALIKE for other in chosen)
            if len(chosen) < most and not alike and self._clear(y, [k], k):
                chosen.append(k)
        return [self.terms[k] for k in chosen]

    def pursued(self, y: Tensor, first: str, starts: Sequence[str]) -> list[str]:
        """The term and what matching pursuit adds to it, none of the starts, if that is no chance; else empty."""
        k = self.terms.index(first)
        free = (self.columns.T @ self.columns[:, k]).abs() <= _ALIKE
        free[[self.terms.index(start) for start in starts if start != first]] = False
        free[k] = True
        if free.sum() < 2:
            return []
        fit = _pursuit()(n_nonzero_coefs=2, fit_intercept=False).fit(self.columns[:, free].numpy(), y.numpy())
        pair = free.nonzero()[:, 0][torch.from_numpy(fit.coef_ != 0)].tolist()
        second = [i for i in pair if i != k]
        return [first, self.terms[second[0]]] if len(pair) == 2 and second and self._clear(y, pair, second[0]) else []

    def _clear(self, y: Tensor, which: list[int], last: int) -> bool:
        """Whether chance gives the last of these terms such a coefficient in less than one library in twenty."""
        columns, own = self.columns[:, which], self.columns[:, last]
        left = y - columns @ torch.linalg.lstsq(columns, y[:, None]).solution[:, 0]
        others = self.columns[:, [k for k in which if k != last]]
        own = own - others @ (others.T @ own)
        sigmas = (own @ y).abs() / (own * left).norm().clamp_min(1e-300)  # White's standard error
        return sigmas.item() > norm.isf(_FALSE_ALARMS / 2 / len(self.terms))

    def coefficients(self, terms: Sequence[str], y: Tensor) -> Tensor:
        """Of the terms themselves, by least squares."""
        which = [self.terms.index(term) for term in terms]
        return torch.linalg.lstsq(self.columns[:, which], y[:, None]).solution[:, 0] / self.norms[which]


def _texts(component: str) -> list[str]:
    """Every term, the short ones first."""
    quantities = _MOMENTS if component == "tau" else _IMPULSES
    texts = {*_SHAPES, *(_product(a, b) for a in quantities for b in _MODULATIONS)}
    return sorted(texts, key=lambda text: (len(re.findall(r"\w+", text)), len(text), text))


def _product(quantity: str, modulation: str) -> str:
    return quantity if modulation == "1" else f"{quantity}*{modulation}"


def _pursuit() -> type:
    try:
        from sklearn.linear_model import OrthogonalMatchingPursuit
    except ImportError as error:
        raise ContactLearnError(
            "formulas for what remains need scikit-learn, which is not installed: pip install 'contactlearn[formulas]'"
        ) from error
    return OrthogonalMatchingPursuit
