"""The arrays behind the findings of an audit, one type for each kind, for figures that compute nothing.

BalanceEvidence     moments on both sides of the balance and contradictions, without and with a correction
OutlierEvidence     the quantity of each reason, its limits, and the trials beyond them
EnergyEvidence      energy after impact over that before
ShapeEvidence       contact points as measured, and as the shape gives them at θ
OutlineEvidence     contact points in the axes of the body, and the outlines that they trace
DuplicateEvidence   the first trial with the same numbers
OrderEvidence       times in the order of the trials
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from contactlearn.core.numerics import MAD_SCALE
from contactlearn.data.audit.contradictions import contradictions
from contactlearn.data.audit.corrections import correct
from contactlearn.data.audit.moments import Balance, balance, kinetic_energy, torque
from contactlearn.data.audit.result import Finding
from contactlearn.data.audit.thresholds import AuditThresholds
from contactlearn.data.audit.trials import ENERGY_GAIN, gross_outliers, outliers
from contactlearn.mechanics.bodies import contact_points, shapes_among
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import rotate
from contactlearn.mechanics.space import PLANE

_NOT_SHOWN = ("incomplete_trials", "constant_columns", "rig", "rig_applied")  # notes that no trial shows


class AuditEvidence:
    """Base of the evidence of a finding."""


@dataclass(frozen=True, kw_only=True)
class BalanceSide:
    """Both sides of the moment balance of each trial, r_x P_n − r_y P_t and I Δω in N m s, and how it closes.

    Args:
        moments: [2, n].
        fit: both coefficients.
        contradictions: mean of each question.
    """

    moments: Float[Tensor, "2 n"]
    fit: Balance
    contradictions: Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class BalanceEvidence(AuditEvidence):
    """The moment balance without a correction, and with it; `after` is None where nothing changes."""

    before: BalanceSide
    after: BalanceSide | None


@dataclass(frozen=True, kw_only=True)
class OutlierReason:
    """A quantity [n] that makes trials gross outliers beyond its limits, and which trials are some."""

    values: Float[Tensor, " n"]
    limits: tuple[float, ...]
    bad: Bool[Tensor, " n"]


@dataclass(frozen=True, kw_only=True)
class OutlierEvidence(AuditEvidence):
    """The reasons for which trials are gross outliers, by name, and the names of the trials."""

    reasons: Mapping[str, OutlierReason]
    trials: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class EnergyEvidence(AuditEvidence):
    """Kinetic energy after impact over that before, of each sound trial [n], and the ratio that is a gain."""

    ratio: Float[Tensor, " n"]
    limit: float


@dataclass(frozen=True, kw_only=True)
class ShapeEvidence(AuditEvidence):
    """Contact points [n, 2] in m as measured, and as the shape gives them at θ."""

    measured: Float[Tensor, "n 2"]
    expected: Float[Tensor, "n 2"]


@dataclass(frozen=True, kw_only=True)
class OutlineEvidence(AuditEvidence):
    """Contact points [n, 2] in m in the axes of the body, and the outlines [points, 2] that they trace."""

    points: Float[Tensor, "n 2"]
    outlines: tuple[Float[Tensor, "points 2"], ...]


@dataclass(frozen=True, kw_only=True)
class DuplicateEvidence(AuditEvidence):
    """The first row (from 1) with the same numbers, of each row [n]."""

    first: Int[Tensor, " n"]


@dataclass(frozen=True, kw_only=True)
class OrderEvidence(AuditEvidence):
    """Places in the sequence [n] and times in s, in the order of the sequence."""

    order: Float[Tensor, " n"]
    time: Float[Tensor, " n"]


def evidence_arrays(
    findings: Sequence[Finding], raw: Impacts, thresholds: AuditThresholds = AuditThresholds()
) -> dict[str, AuditEvidence]:
    """Compute the evidence of each finding by its name; none in space, where the audit compares nothing.

    Args:
        findings: in the order in which their corrections were applied.
        raw: impacts before these corrections.
        thresholds: with which they were found.
    """
    found, impacts = dict[str, AuditEvidence](), raw.replace(validate=False)
    for finding in findings if raw.space is PLANE else ():
        if finding.name in _NOT_SHOWN:
            continue
        after = correct(impacts, [finding.correction] if finding.correction else finding.hypothesis)
        found[finding.name] = evidence_array(finding, impacts, after, thresholds)
        impacts = after
    return found


def evidence_array(
    finding: Finding, before: Impacts, after: Impacts, thresholds: AuditThresholds = AuditThresholds()
) -> AuditEvidence:
    """Compute the evidence of a finding from the impacts without and with its correction."""
    match finding.name:
        case "gross_outliers":
            return OutlierEvidence(reasons=_reasons(before, thresholds), trials=before.trial)
        case "energy_gained":
            energy, rebound = kinetic_energy(before[~outliers(before, thresholds)])
            return EnergyEvidence(ratio=rebound / energy, limit=ENERGY_GAIN)
        case "contact_point_off_shape" if before.shape is not None:
            sound = before[~outliers(before, thresholds)]
            return ShapeEvidence(measured=sound.r, expected=contact_points(before.shape, sound.body, sound.q[:, 2]))
        case "traced_shape":
            outlines = tuple(shape.outline() for shape in shapes_among(after.shape).values())
            return OutlineEvidence(points=rotate(after.r, -after.q[:, 2]), outlines=outlines)
        case "duplicated_trials":
            numbers, first = torch.cat((before.r, before.q, before.v_pre, before.v_post), -1), dict[object, int]()
            rows = [first.setdefault(tuple(row), k) for k, row in enumerate(numbers.tolist(), 1)]
            return DuplicateEvidence(first=torch.tensor(rows))
        case "out_of_order" if before.time is not None:
            by_order = before.order.argsort(stable=True)
            return OrderEvidence(order=before.order[by_order], time=before.time[by_order])
        case _:
            return BalanceEvidence(before=_side(before), after=None if after is before else _side(after))


def _side(impacts: Impacts) -> BalanceSide:
    terms = torque(impacts)
    means = {question: answer.mean().item() for question, answer in contradictions(impacts).items()}
    moments = impacts.inertia * torch.stack((terms.normal + terms.tangential, terms.spin))
    return BalanceSide(moments=moments, fit=balance(impacts), contradictions=means)


def _reasons(impacts: Impacts, thresholds: AuditThresholds) -> dict[str, OutlierReason]:
    """The quantity behind each reason that makes a trial an outlier, and the moments.

    A moment beyond its limit is gross only where it is a third of its own terms as well.
    """
    energy, rebound = kinetic_energy(impacts)
    residual = torque(impacts).residual.abs()
    ratios = torch.stack([_of_object(impacts, values) for values in (impacts.mass, impacts.inertia)])
    ratio = thresholds.gross_ratio
    quantities = {
        "moment": (residual, (thresholds.moment_sigmas * MAD_SCALE * residual.median().item(),)),
        "energy": (rebound / energy, (ratio,)),
        "approach": (impacts.v_c[:, 1], (0.0,)),
        "mass": (ratios.gather(0, ratios.log().abs().argmax(0)[None])[0], (1 / ratio, ratio)),
    }
    return {
        name: OutlierReason(values=quantities[name][0], limits=quantities[name][1], bad=bad)
        for name, bad in gross_outliers(impacts, thresholds).items()
        if bad.any() or name == "moment"
    }


def _of_object(impacts: Impacts, values: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
    """Values relative to the median of the same object's trials."""
    ratio = torch.empty_like(values)
    for name in set(impacts.object):
        same = torch.tensor([other == name for other in impacts.object])
        ratio[same] = values[same] / values[same].median()
    return ratio
