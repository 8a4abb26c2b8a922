"""Studies of the audit of units and axes, of the inertia, and of data that no rigid impact made."""

import math
from typing import NamedTuple

import torch

from contactlearn.data.audit.conventions import ConventionComparison, compare, impossible_findings
from contactlearn.data.audit.findings import audit
from contactlearn.data.audit.rig import simplest_rig
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.mechanics.bodies import contact_points
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import rotate
from contactlearn.mechanics.shapes import Disc
from contactlearn.simulation import synthetic
from sensitivity.studies.cases import (
    MIRRORS,
    SPOILT,
    after,
    between,
    body,
    heavier,
    random,
    shuffled,
    simulated,
    spoilt,
    textbook,
)
from sensitivity.study import Study, each


class Written(NamedTuple):
    """Measurements, and the corrections that undo the mistakes made in writing them down."""

    impacts: Impacts
    mistakes: tuple[str, ...] = ()


_SIZES = (20, 60, 150)
_PAIRS = (
    ("mirrored_x", "degrees"), ("mirrored_theta", "millimetres"), ("swapped_pre_post", "grams"),
    ("mirrored_y", "degrees_omega"), ("contact_point_sign", "mirrored_theta"), ("swapped_axes", "millimetres"),
)  # fmt: skip
_STRONG = (
    "contact_patch", "spin_damping", "surface_tilt", "com_offset", "shape_error", "orientation_offset",
    "rolling_resistance", "sampling_delay",
)  # fmt: skip


def _written(kind: str, seed: int) -> Written:
    """Clean, rough or disturbed drops, or drops with one or two mistakes in units and axes."""
    size, level = _SIZES[seed % 3], between(0.01, 0.1, seed)
    match kind:
        case "clean":
            return Written(simulated(seed, size=size)[0])
        case "disturbed":
            return Written(simulated(seed, (_STRONG[seed % len(_STRONG)],), size, strength=(5, 10))[0])
        case "rough":
            level = between(0.02, 0.4, seed)
            return Written(textbook(seed, size, level, 20 * level, body(seed)))
        case "driven":  # off a floor that moves up
            impacts = textbook(seed, size, level, 20 * level, body(seed))
            return Written(after(impacts, between(1.1, 1.6, seed) * impacts.v_post))
        case "torn":  # outcomes of some trials exchanged
            return Written(shuffled(textbook(seed, size, level, 20 * level, body(seed)), between(0.1, 0.5, seed), seed))
        case "round":
            return Written(textbook(seed, size, level, 20 * level, body(seed, 1.1)))
    every = _PAIRS if kind == "two" else [(name,) for name in (*MIRRORS, *SPOILT)]
    mistakes = every[seed % 1000 % len(every)]
    shape = body(seed, 1.1 if kind == "one, round" else 4.0)
    return Written(spoilt(textbook(seed, size, level, 20 * level, shape), *mistakes), mistakes)


def _named(impacts: Impacts, thresholds: Thresholds) -> list[set[str]]:
    """The hypothesis that the audit believes and those that it calls equivalent; empty where it says nothing."""
    for finding in audit(impacts, thresholds.audit):
        if finding.hypothesis and not finding.fatal:
            return [set(names) for names in (finding.hypothesis, *finding.alternatives)]
    return []


def _corrected(written: Written, thresholds: Thresholds) -> bool:
    """Whether the mistakes are named, or anything where there are none."""
    named = _named(written.impacts, thresholds)
    return set(written.mistakes) in named if written.mistakes else bool(named)


CONVENTIONS = Study(
    name="units and axes",
    null=each(3, "clean", "disturbed", "rough", "driven", "torn", "round"),
    planted=(*each(13, "one", "one, round"), *each(4, "two")), prepare=_written, alarm=_corrected,
)  # fmt: skip


def _on_a_floor(kind: str, seed: int) -> Impacts:
    """Drops onto a level floor, also with effects that bend the balance, or onto one that is inclined by 6 to 60°."""
    if kind == "disturbed":
        return simulated(seed, (_STRONG[seed % len(_STRONG)],), _SIZES[seed % 3], strength=(5, 10))[0]
    level = between(0.01, 0.1, seed)
    impacts = textbook(seed, _SIZES[seed % 3], level, 20 * level, body(seed))
    if kind == "level":
        return impacts
    angle = torch.full((len(impacts),), math.radians(between(6, 60, seed)), dtype=torch.float64)
    q, v_pre, v_post = (
        torch.cat((rotate(x[:, :2], angle), x[:, 2:]), -1) for x in (impacts.q, impacts.v_pre, impacts.v_post)
    )
    q[:, 2] += angle
    r = contact_points(impacts.shape, impacts.body, q[:, 2])  # as one computes them for a level floor
    return impacts.replace(q=q, q_post=None, r=r, v_pre=v_pre, v_post=v_post, validate=False)


def _is_inclined(impacts: Impacts, thresholds: Thresholds) -> bool:
    """Whether the audit finds that the floor is inclined."""
    return any(finding.name == "inclined_floor" for finding in audit(impacts, thresholds.audit))


INCLINED = Study(
    name="inclined floors", null=each(12, "level", "disturbed"), planted=each(20, "inclined"),
    prepare=_on_a_floor, alarm=_is_inclined,
)  # fmt: skip


def _weighed(kind: str, seed: int) -> Impacts:
    """Moments of inertia that are a little off, as by an effect, or grossly; and disturbed moments."""
    sign = 1 - 2 * (seed % 2)
    match kind:
        case "little":
            return heavier(textbook(seed, 100), between(1.01, 2.4, seed) ** sign)
        case "gross":
            return heavier(textbook(seed, 100), between(2.6, 1000 if sign > 0 else 30, seed) ** sign)
        case "moderate":
            noise = 0.01 * (1 + 3 * (seed % 4))
            return heavier(textbook(seed, 100, noise, 50 * noise), between(2.6, 8.0, seed) ** sign)
        case "noise":
            level = between(0.02, 0.2, seed)
            return textbook(seed, 100, level, 20 * level, body(seed))
    return simulated(seed, (kind,), strength=(4, 10))[0]


def _scaled(impacts: Impacts, thresholds: Thresholds) -> bool:
    return any(finding.correction == "inertia_scaled" for finding in audit(impacts, thresholds.audit))


_OFF = (*each(8, "little", "noise"), *each(2, "contact_patch", "spin_damping"))
INERTIA = Study(name="moment of inertia", null=_OFF, planted=each(20, "gross"), prepare=_weighed, alarm=_scaled)
RIG = Study(
    name="rig of a table", null=(*each(8, "noise"), *each(4, "contact_patch", "spin_damping")),
    planted=each(16, "little"), prepare=_weighed,
    alarm=lambda impacts, thresholds: simplest_rig(impacts, thresholds.audit) is not None,
)  # fmt: skip


def _torn(kind: str, seed: int) -> ConventionComparison:
    """Measurements of rigid impacts, however disturbed, or outcomes of other trials; compared once."""
    match kind:
        case "shuffled":
            impacts = shuffled(textbook(seed, 60), between(0.4, 1, seed), seed)
        case "random":
            impacts = textbook(seed, 60)
            impacts = after(impacts, impacts.v_post.std(0) * torch.randn(60, 3, generator=random(seed)).double())
        case "reversed":
            impacts = textbook(seed, 60)
            rows = torch.rand(60, generator=random(seed)) < between(0.3, 0.7, seed)
            impacts = impacts.replace(
                v_pre=torch.where(rows[:, None], impacts.v_post, impacts.v_pre),
                v_post=torch.where(rows[:, None], impacts.v_pre, impacts.v_post), validate=False,
            )  # fmt: skip
        case "rough":
            level = between(0.05, 0.4, seed)
            impacts = textbook(seed, 60, level, 20 * level, body(seed))
        case _:
            impacts = simulated(seed, (kind,), size=60, strength=(4, 10))[0]
    return compare(impacts.replace(validate=False), Thresholds().audit)


IMPOSSIBLE = Study(
    name="impossible data", null=(*each(6, "rough"), *each(2, "contact_patch", "magnetic_pull", "spin_damping")),
    planted=each(4, "shuffled", "random", "reversed"), prepare=_torn,
    alarm=lambda comparison, thresholds: bool(impossible_findings(comparison, thresholds.audit)),
)  # fmt: skip


def _moments(kind: str, seed: int) -> Impacts:
    """Drops whose spins answer fully to the moments, noise apart, drops with effects, or spins off by a factor."""
    level = between(0.005, 0.05, seed)
    match kind:
        case "clean":
            return simulated(seed)[0]
        case "rough":
            return textbook(seed, 100, level, 20 * level, body(seed))
        case "open":
            impacts = textbook(seed, 100, 0.01, 0.2, body(seed))
            factor = torch.tensor((1.0, 1.0, between(1.1, 1.39, seed) ** (1 - 2 * (seed % 2))), dtype=torch.float64)
            return after(impacts, impacts.v_pre + factor * (impacts.v_post - impacts.v_pre))
        case "uneven":  # one term answers by another factor than the other
            impacts = textbook(seed, 100, 0.01, 0.2, body(seed, 3.0))
            dv = impacts.v_post - impacts.v_pre
            a, b = between(1.0, 1.3, seed), between(1.55, 2.0, seed + 1)
            moment = a * impacts.r[:, 0] * dv[:, 1] - b * impacts.r[:, 1] * dv[:, 0]
            spin = impacts.v_pre[:, 2] + moment * impacts.mass / impacts.inertia
            return after(impacts, torch.cat((impacts.v_post[:, :2], spin[:, None]), -1))
        case "noisy":  # too few trials with too much noise of the spin
            return textbook(seed, 20, 0.02, between(8.0, 30.0, seed), Disc(0.03))
        case "vertical":  # a disc without slip and spin: no moment at all
            return _pushed(_discs(seed, 0.0), level, 0.0)
        case "slight":  # little friction, and spins off by a factor
            factor = between(0.4, 0.65, seed)
            return _pushed(_discs(seed, 0.03), 0.002, factor)
        case "still":  # spins that answer to no moment, noise apart
            return _pushed(textbook(seed, 100, 0.0, 0.0, Disc(0.03)), level, 0.0)
    return simulated(seed, (kind,))[0]


def _discs(seed: int, mu: float) -> Impacts:
    return synthetic.load(size=100, shape=Disc(0.03), seed=seed, mu=mu, velocity_noise=0.0, spin_noise=0.0)


def _pushed(impacts: Impacts, level: float, factor: float) -> Impacts:
    """Drops without tangential velocity where they have no friction, spins that change by a factor, and noise."""
    slip = float(bool((impacts.v_post - impacts.v_pre)[:, 0].abs().max() > 1e-9))
    keep = torch.tensor((slip, 1.0, slip), dtype=torch.float64)
    change = torch.tensor((1.0, 1.0, factor), dtype=torch.float64) * (impacts.v_post - impacts.v_pre)
    noise = torch.randn(2, len(impacts), 3, generator=random(len(impacts) + int(1e4 * level))).double()
    noise = noise * level * torch.tensor((1.0, 1.0, 30.0), dtype=torch.float64)
    return impacts.replace(
        v_pre=keep * impacts.v_pre + noise[0], v_post=keep * impacts.v_pre + change + noise[1], validate=False
    )


OPEN = Study(
    name="moment balance", null=each(8, "clean", "rough"), planted=each(16, "open"), prepare=_moments,
    alarm=lambda drops, thresholds: any(one.name == "moment_balance_open" for one in audit(drops, thresholds.audit)),
)  # fmt: skip
DOUBTED = Study(
    name="doubted balance", null=each(5, "contact_patch", "rolling_resistance", "side_drag", "spin_damping"),
    planted=each(16, "uneven"), prepare=_moments,
    alarm=lambda drops, thresholds: any(finding.mistake for finding in audit(drops, thresholds.audit)),
)  # fmt: skip
