"""Studies of formulas for a residual, of the mean in place of a noisy velocity, and of a noise that was stated."""

from typing import NamedTuple

import torch
from torch import Tensor

from contactlearn import laws
from contactlearn.data.audit.model_checks import averaged
from contactlearn.diagnosis.pipeline import diagnose
from contactlearn.diagnosis.result import Diagnosis
from contactlearn.diagnosis.search.candidates import all_candidates
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.diagnosis.unexplained import formulas as written
from contactlearn.diagnosis.unexplained.formulas import formulas
from contactlearn.diagnosis.unexplained.remainder import learn_remainder
from contactlearn.effects import EffectId
from contactlearn.inference.identification.joint import FitOptions, identify_jointly
from contactlearn.inference.validation import Folds, held_out_error
from contactlearn.mechanics.impacts import Impacts
from contactlearn.models.contact_model import ContactModel
from contactlearn.report.text import misfit
from sensitivity.studies.cases import between, random, textbook
from sensitivity.studies.memory import remember
from sensitivity.studies.residuals import ACTS, Learning, residual
from sensitivity.studies.study import Row, Study, each

remember("identify_jointly", written)


def _offered(learning: Learning, thresholds: Thresholds) -> bool:
    """Whether a formula is offered; where something is hidden, one with a variable in which it acts."""
    folds = Folds.draw(len(learning.impacts), torch.Generator().manual_seed(0), repeats=1)
    component = learning.component or ("t", "n", "tau")[round(1e6 * learning.impacts.v_post[0, 0].item()) % 3]
    found = formulas(learning.impacts, learning.fit.model, component, folds, thresholds=thresholds.formulas)
    text = " ".join(term for formula in found for term in formula.terms)
    return any(name in text for name in learning.variables) if learning.variables else bool(found)


FORMULAS = Study(
    name="formulas", null=each(5, ("clean", (2, 5)), ("heavy", (2, 5))),
    planted=each(4, *((kind, (0.5, 2)) for kind in ACTS)), prepare=residual, alarm=_offered,
)  # fmt: skip


class Levelled(NamedTuple):
    """Drops, their outcomes as flexible models predict them, and the folds."""

    impacts: Impacts
    predicted: Tensor
    folds: Folds


def _levelled(spread: tuple[float, float] | None, seed: int) -> Levelled:
    """Drops whose velocities before impact vary by their measurement's noise alone, or truly by some times that."""
    drops, n, sigma = textbook(seed, 100), 100, torch.tensor((0.03, 0.03, 1.0), dtype=torch.float64)
    normal = torch.randn(3, n, 3, generator=random(seed), dtype=torch.float64)
    times = between(*spread, seed) if spread else 0.0
    true = torch.tensor((0.6, -2.5, 0.0), dtype=torch.float64) + times * sigma * normal[0]
    exact = drops.replace(v_pre=true)
    v_post = ContactModel(laws.find("wang_mason").at(0.2, 0.5)).predict(exact).v_post
    seen = drops.replace(v_pre=true + sigma * normal[1], v_post=v_post + sigma * normal[2])
    folds = Folds.draw(n, torch.Generator().manual_seed(0), repeats=1)
    fit = identify_jointly(laws.find("wang_mason"), {}, seen)
    learned = learn_remainder(seen, fit.model, folds, generator=torch.Generator().manual_seed(0), inliers=fit.inliers)
    return Levelled(seen, learned.v_post, folds)


def _averaged(levelled: Levelled, thresholds: Thresholds) -> bool:
    """Whether the mean of any velocity replaces its measurements."""

    def held_out(impacts: Impacts) -> float:
        return held_out_error(laws.find("wang_mason"), {}, impacts, levelled.folds, FitOptions())

    return bool(averaged(levelled.impacts, levelled.predicted, held_out, thresholds.audit))


AVERAGING = Study(
    name="mean for a noisy velocity", null=each(12, ((1.0, 6.0),)), planted=each(12, (None,)),
    prepare=_levelled, alarm=_averaged,
)  # fmt: skip


def _stated(kind: str, seed: int) -> Diagnosis:
    """A diagnosis with noise that was stated about right, or in other units or off by a factor."""
    off = {"right": between(0.8, 1.25, seed), "degrees": 57.3, "millimetres": 1000.0, "factor": between(1.5, 5, seed)}
    factor = off[kind] ** (1 - 2 * (seed % 2))
    noise = (0.01, 0.01, 0.5 * factor) if kind == "degrees" else (0.01 * factor, 0.01 * factor, 0.5 * factor)
    law, tilt = laws.find("wang_mason"), EffectId("surface_tilt", "computed")
    return diagnose(textbook(seed, 100), law, laws=[law], candidates={tilt: all_candidates()[tilt]}, noise=noise)


def _questioned(found: Diagnosis, thresholds: Thresholds) -> bool:
    return bool(misfit(found, thresholds.noise))


STATED = Study(
    name="stated noise", null=each(12, "right"), planted=each(4, "degrees", "millimetres", "factor"),
    prepare=_stated, alarm=_questioned,
)  # fmt: skip

_F = "formulas."
ROWS = (
    Row(field="noise.stated_ratio", values=(1.05, 1.2, 1.4, 2.0, 4.0), study=STATED),
    Row(field="audit.noisy_spread", values=(0.75, 1.1, 1.5, 2.5, 1e9), study=AVERAGING),
    Row(field=_F + "sigmas", values=(0.0, 1.0, 2.0, 3.0, 5.0), study=FORMULAS),
    Row(field=_F + "identical", values=(0.8, 0.95, 0.995, 0.9999), study=FORMULAS),
)
