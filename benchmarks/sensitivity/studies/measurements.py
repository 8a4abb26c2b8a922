"""Studies of the audit of single trials, energy, shape and order."""

from typing import NamedTuple

import torch
from torch import Tensor

from contactlearn.data.audit.model_checks import find_model_outliers
from contactlearn.data.audit.trials import gross_outliers, scale_findings, trial_findings
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.inference.identification import joint
from contactlearn.laws import find
from contactlearn.mechanics.apparatus import Apparatus, Estimate
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import GRAVITY
from contactlearn.mechanics.shapes import Ellipse
from contactlearn.models.contact_model import ContactModel
from sensitivity.studies.cases import after, between, heavy, random, simulated, some, spiked, textbook
from sensitivity.study import Study, each


class Marked(NamedTuple):
    """Measurements, and the trials that were spoilt."""

    impacts: Impacts
    rows: Tensor


class Modelled(NamedTuple):
    """Measurements, and a law that was fitted to them."""

    impacts: Impacts
    model: ContactModel


def _marked(kind: str, seed: int) -> Marked:
    """Outliers of every reason, and data that look a little like them."""
    impacts = textbook(seed, 100, *((0.0, 0.0) if kind == "exact" else ()))
    rows = some(impacts, 0.01, seed)
    match kind:
        case "heavy":
            return Marked(heavy(impacts, seed), rows & False)
        case "exact":
            return Marked(after(impacts, (impacts.v_post / 1e-4).round() * 1e-4), rows & False)
        case "spin":
            step = torch.tensor((0.0, 0.0, between(5, 100, seed)), dtype=torch.float64)
            return Marked(after(impacts, impacts.v_post + rows[:, None] * step), rows)
        case "velocity":
            step = torch.tensor((between(0.2, 4, seed), 0.0, 0.0), dtype=torch.float64)
            return Marked(after(impacts, impacts.v_post + rows[:, None] * step), rows)
        case "rough":  # 3 to 15 % of the speed: slow drops before a camera
            level = between(0.08, 0.4, seed)
            return Marked(textbook(seed, 100, level, 10 * level), rows & False)
        case "fast":
            return Marked(after(impacts, torch.where(rows[:, None], between(1.5, 5, seed), 1.0) * impacts.v_post), rows)
        case "scatter":
            return Marked(_weighed(impacts, torch.ones_like(rows), between(1.05, 1.3, seed), seed), rows & False)
        case "two bodies":
            rows = some(impacts, between(0.12, 0.5, seed), seed)
            return Marked(
                impacts.replace(mass=torch.where(rows, between(1.5, 6, seed), 1.0) * impacts.mass), rows & False
            )
        case "slip":
            factor = (10.0, 0.1, 2.2, 1000.0, 1 / 2.2)[seed % 5]
            rows = some(impacts, between(0.01, 0.08, seed), seed)
            return Marked(impacts.replace(mass=torch.where(rows, factor, 1.0) * impacts.mass), rows)
    return Marked(impacts, rows & False)


def _weighed(impacts: Impacts, rows: Tensor, factor: float, seed: int) -> Impacts:
    """Masses off at random, by such a factor as one standard deviation."""
    off = factor ** torch.randn(len(impacts), generator=random(seed), dtype=torch.float64)
    return impacts.replace(mass=torch.where(rows, off, 1.0) * impacts.mass)


def _found(reason: str):
    def alarm(marked: Marked, thresholds: Thresholds) -> bool:
        bad = gross_outliers(marked.impacts, thresholds.audit)[reason]
        return bool(bad[marked.rows].all() if marked.rows.any() else bad.any())

    return alarm


MOMENT = Study(
    name="moments of single trials", null=each(8, "gaussian", "heavy", "exact"), planted=each(12, "spin", "velocity"),
    prepare=_marked, alarm=_found("moment"),
)  # fmt: skip
WEIGHT = Study(
    name="masses of single trials", null=each(12, "scatter", "two bodies"), planted=each(24, "slip"),
    prepare=_marked, alarm=_found("mass"),
)  # fmt: skip


def _spiked(share: tuple[float, float], seed: int) -> Impacts:
    impacts = textbook(seed, 100)
    return spiked(impacts, some(impacts, between(*share, seed), seed), seed, 50, 200)


DROPPED = Study(
    name="share of outliers", null=each(20, ((0.01, 0.12),)), planted=each(20, ((0.25, 0.5),)),
    prepare=_spiked,
    alarm=lambda drops, thresholds: any(  # too many to be dropped
        finding.name == "gross_outliers" and finding.correction is None
        for finding in trial_findings(drops, thresholds.audit)
    ),
)  # fmt: skip


def _shaped(kind: str, seed: int) -> Impacts:
    """Contact points of a body that a physical effect moves a little, or of another body than stated."""
    if kind not in ("axes", "scale", "turned"):
        return simulated(seed, (kind,), strength=(4, 8))[0]
    impacts = simulated(seed)[0]
    a, b = impacts.shape.semi_axes
    if kind == "turned":
        turn = torch.tensor((0.0, 0.0, between(0.3, 1.5, seed)), dtype=torch.float64)
        return impacts.replace(q=impacts.q + turn, validate=False)
    factor = between(1.15, 3, seed)
    return impacts.replace(shape=Ellipse((b, a) if kind == "axes" else (factor * a, factor * b)), validate=False)


SHAPE = Study(
    name="contact point of the shape",
    null=each(5, "surface_tilt", "com_offset", "shape_error", "orientation_offset"),
    planted=each(7, "axes", "scale", "turned"), prepare=_shaped,
    alarm=lambda drops, thresholds: any(
        finding.name == "contact_point_off_shape" for finding in trial_findings(drops, thresholds.audit)
    ),
)  # fmt: skip


def _weighted(kind: str, seed: int) -> Impacts:
    """Gravity somewhere on earth, measured well or badly, or under a wrong scale."""
    off = between(0.985, 0.97, seed) ** (-1) ** seed if kind == "scale" else between(0.997, 1.003, seed)
    error = between(0.05, 0.2, seed) if kind == "badly" else between(0.002, 0.02, seed)
    noise = error * torch.randn((), generator=random(seed), dtype=torch.float64).item()
    gravity = Estimate(value=GRAVITY * off + noise, error=error)
    exact = Estimate(value=0.0, error=1e-3)
    known = Apparatus(gravity=gravity, drag=exact, slope=None, orientation=None, delay=exact)
    return textbook(seed, 20).replace(apparatus=known)


SCALE = Study(
    name="scale", null=each(16, "well", "badly"), planted=each(16, "scale"), prepare=_weighted,
    alarm=lambda drops, thresholds: bool(scale_findings(drops, thresholds.audit)),
)  # fmt: skip


def _modelled(kind: str, seed: int) -> Modelled:
    """Clean drops, heavy-tailed ones, or drops of which a few spins have the wrong sign, with a law fitted to them."""
    impacts = textbook(seed, 150, law="wang_mason")
    if kind == "heavy":
        impacts = heavy(impacts, seed)
    if kind == "turned":
        rows = some(impacts, 0.01, seed)
        mirror = torch.where(rows[:, None], torch.tensor((1.0, 1.0, -1.0), dtype=torch.float64), 1.0)
        impacts = after(impacts, impacts.v_post * mirror)
    return Modelled(impacts, joint.fit(impacts, find("wang_mason")).model)


MODELLED = Study(
    name="outliers of a model", null=each(16, "clean", "heavy"), planted=each(16, "turned"), prepare=_modelled,
    alarm=lambda modelled, thresholds: find_model_outliers(
        modelled.impacts, lambda drops: modelled.model.predict(drops).v_post, thresholds.audit
    ) is not None,
)  # fmt: skip
