"""Columns without a measurement: one value in every trial, outcomes that nobody measured, a shape in another unit.

They are looked for before anything else is asked of the data, since a constant shows no dependence, and zeros for a
spin contradict every impulse that turns the body.
"""

import math
from dataclasses import replace

import torch

from contactlearn.core.numerics import MAD_SCALE, number
from contactlearn.data.audit.contradictions import contradictions
from contactlearn.data.audit.corrections import correct
from contactlearn.data.audit.moments import torque
from contactlearn.data.audit.result import Finding, evidence_of
from contactlearn.data.audit.thresholds import AuditThresholds
from contactlearn.data.audit.units import MISWRITTEN
from contactlearn.data.table.units import UNIT_FACTORS
from contactlearn.mechanics.bodies import contact_points
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import orientation_of
from contactlearn.mechanics.space import PLANE

_ROUNDING = 1e-9  # relative change of a column that counts as none
_COLUMNS = (  # with what they cannot show, of the plane
    ("x", "q", 0, "m", "the place"),
    ("θ", "q", 2, "rad", "the orientation"),
    ("v_x before impact", "v_pre", 0, "m/s", ""),
    ("v_y before impact", "v_pre", 1, "m/s", "the speed"),
    ("ω before impact", "v_pre", 2, "rad/s", "the spin"),
    ("v_x after impact", "v_post", 0, "m/s", ""),
    ("v_y after impact", "v_post", 1, "m/s", ""),
    ("ω after impact", "v_post", 2, "rad/s", ""),
)
_COLUMNS_IN_SPACE = (
    *((axis, "q", k, "m", "the place") for k, axis in enumerate("xy")),
    *((f"{x}_{axis} {when} impact", field, 3 * j + k, unit, "the spin" if (x, when) == ("ω", "before") else "")
      for field, when in (("v_pre", "before"), ("v_post", "after"))
      for j, (x, unit) in enumerate((("v", "m/s"), ("ω", "rad/s"))) for k, axis in enumerate("xyz")),
)  # fmt: skip
_COARSE = 0.03  # error of a rounded column over its values, from which on the rounding is said
_STEPS = tuple(k * 10.0**n for n in range(2, -5, -1) for k in (5, 2, 1))  # of a number that was rounded, in SI
_EXACTLY = 1e-3  # of a step, by which numbers in single precision differ from one
_FEWEST_VALUES = 4  # of a column that was rounded, and is no setting of a rig
_NARROW = 0.05  # standard deviation of the approach speed over its mean, up to which nothing is seen to depend on it
_UNIT_AGREES = 0.05  # relative difference of a ratio of lengths from a constant of units, and its spread
_LABORATORY, _SIZES = 20.0, 500.0  # m, and sizes of the body: places farther apart may be in another unit
_ROUND = 0.05  # lever r_x of a round body, relative, on a floor whose slope was corrected
_LIGHTEST = 0.1  # mass over |r|³ in kg/m³: a balloon has 5 with its air, and a shape in cm a millionth of what it had
_DENSEST = 22_600.0  # kg/m³, osmium; more in the sphere of the farthest contact is another unit of mass
_WORSE = 0.01  # sum of contradictions that another unit of the shape may add: none but noise


def constant_notes(impacts: Impacts) -> list[Finding]:
    """Note the columns whose value is the same in all trials, and what they can therefore not show."""
    constant = [
        (name, values[0, k].item() + 0.0, unit, shown)  # −0 is 0
        for name, field, k, unit, shown in (_COLUMNS if impacts.space is PLANE else _COLUMNS_IN_SPACE)
        if _same((values := getattr(impacts, field))[:, k], values)
    ]
    if not constant:
        return []
    named = ", ".join(f"{name} = {number(value, 3)}{f' {unit}' if value else ''}" for name, value, unit, _ in constant)
    hidden = [*dict.fromkeys(shown for *_, shown in constant if shown)]
    sentence = f"{named} in all {len(impacts)} trials"
    if hidden:
        sentence += f", so these data cannot show whether anything depends on {' or '.join(hidden)}"
    evidence = evidence_of(*((name, value, unit) for name, value, unit, _ in constant))
    return [Finding(name="constant_columns", sentence=sentence, evidence=evidence, mistake=False)]


def rounded_notes(impacts: Impacts) -> list[Finding]:
    """Note contact points and velocities after impact, which nobody sets, that are rounded coarsely."""
    d, found = impacts.space.d, dict[str, float]()
    measured = (
        ("the contact point", impacts.r, "m"),
        ("velocities after impact", impacts.v_post[:, :d], "m/s"),
        ("spins after impact", impacts.v_post[:, d:], "rad/s"),
    )
    for name, values, unit in measured:
        size = values.square().sum(-1).mean().sqrt().item()
        for step in (x for x in _STEPS if _COARSE * size * math.sqrt(12) < x < size):
            rounded = (values / step).round() * step
            exactly = (rounded - values).abs().max() < _EXACTLY * step
            if exactly and len(rounded.unique(dim=0)) >= _FEWEST_VALUES:
                found[f"{name} to {number(step)} {unit}"] = step / math.sqrt(12) / size
                break
    if not found:
        return []
    sentence = "numbers are rounded: " + ", ".join(f"{name}, an error of {error:.0%}" for name, error in found.items())
    evidence = evidence_of(*found.items())
    return [Finding(name="rounded", sentence=sentence, evidence=evidence, mistake=False)]


def narrow_notes(impacts: Impacts) -> list[Finding]:
    """Note an approach speed that hardly varies, as of one height of release: nothing is seen to depend on it."""
    speed = impacts.v_c[:, -1].abs()
    spread, mean = speed.std().item(), speed.mean().item()
    if not _ROUNDING < spread / max(mean, 1e-300) < _NARROW:
        return []
    sentence = (
        f"the approach speed hardly varies, {number(mean, 3)} ± {number(spread, 2)} m/s: these data cannot show "
        "whether anything depends on it; drop from other heights"
    )
    evidence = evidence_of(("mean", mean, "m/s"), ("spread", spread, "m/s"))
    return [Finding(name="narrow_speed", sentence=sentence, evidence=evidence, mistake=False)]


def spin_notes(impacts: Impacts) -> list[Finding]:
    """Note spins that are one number before and after all impulses, which turn the body: nobody measured them."""
    terms = torque(impacts)
    moment = terms.normal + terms.tangential
    spins = torch.cat((impacts.v_pre[:, 2:], impacts.v_post[:, 2:]))
    if not _same(spins, spins) or not (moment.abs() > _ROUNDING * terms.scale).any():
        return []
    value = number(spins[0].item() + 0.0, 3)
    seen = f"ω is {value} before and after every impact, though the impulses turn the body: the spin was not measured. "
    told = "friction, slip and what acts on the spin cannot be determined"
    ball = terms.normal.abs().max() < _ROUND * terms.scale.max()
    if ball and len(set(impacts.recording)) < len(impacts.recording):
        # The first bounce turns a ball, and the next begins with that spin.
        how, correction = f"Bounces are compared along the normal alone: {told}", "normal_alone"
    else:
        taken = "It is taken to be 0 before impact, and after it what the moment of the impulse makes"
        how, correction = f"{taken}; {told}", "spin_from_moments"
    evidence = evidence_of(("moment", moment.abs().median().item(), "rad/s"))
    finding = Finding(name="spin_not_measured", sentence=seen + how, evidence=evidence, correction=correction)
    return [replace(finding, mistake=False)]


def unmeasured_findings(impacts: Impacts) -> list[Finding]:
    """Find velocities after impact that are one number in all trials though nothing before it is; fatal.

    A spin that is one number before impact, too, is that of `spin_notes`; v_y⁺ = 0 of a centre above its contact is a
    restitution of zero.
    """
    found = []
    for k, (name, unit) in enumerate((("v_x", "m/s"), ("v_y", "m/s"), ("ω", "rad/s"))):
        plastic = k == 1 and _same(impacts.r[:, 0], impacts.r)
        if plastic or not _same(impacts.v_post[:, k], impacts.v_post) or _same(impacts.v_pre[:, k], impacts.v_pre):
            continue
        value = impacts.v_post[0, k].item() + 0.0
        sentence = (
            f"{name} after impact is {number(value, 3)} in all {len(impacts)} trials, though {name} before impact "
            f"varies: it was not measured, and no law can be compared with it. Is the outcome in another column? Say "
            "which with data.columns"
        )
        evidence = evidence_of(("value", value, unit), ("trials", float(len(impacts))))
        found.append(Finding(name="outcome_not_measured", sentence=sentence, evidence=evidence, fatal=True))
    return found


def shape_unit_findings(impacts: Impacts) -> list[Finding]:
    """Find a stated shape whose size differs from |r|, or from the height above the floor, by a constant of units.

    Where contact points are computed from the shape, a greater height is one of positions in another unit.
    """
    if impacts.shape is None:
        return []
    expected, computed = contact_points(impacts.shape, impacts.body, impacts.q[:, 2]), _computed(impacts)
    if computed:
        ratio, of = impacts.q[:, 1] / -expected[:, 1], "the height y at contact"
    else:
        ratio, of = impacts.r.norm(dim=-1) / expected.norm(dim=-1), "|r|"
    middle = ratio.median().item()
    spread = MAD_SCALE * (ratio - middle).abs().median().item()
    if not middle > 0 or spread > _UNIT_AGREES * middle:
        return []
    for name, unit in MISWRITTEN.items():
        if unit.columns not in {("shape",), ("place",) if computed else ()}:
            continue
        expected_ratio = unit.factor if unit.columns == ("shape",) else 1 / unit.factor
        if abs(math.log(middle / expected_ratio)) > _UNIT_AGREES:
            continue
        before, after = (_contradictory(one) for one in (impacts, correct(impacts, [name])))
        if after <= before + _WORSE:
            words = unit.words.replace(" and the contact point", "") if computed else unit.words
            sentence = f"{words}: {of} is {number(middle, 3)} times what the shape gives"
            evidence = evidence_of(
                ("ratio", middle), ("contradictions_before", before), ("contradictions_after", after)
            )
            return [Finding(name=name, sentence=sentence, evidence=evidence, correction=name)]
    return []


def light_body_findings(impacts: Impacts, thresholds: AuditThresholds) -> list[Finding]:
    """Find the unit of a shape in which bodies would be lighter than air, where another one balances the moments.

    It is looked for where contact points are computed from the shape, with or without heights and inertia.
    """
    size, mass = impacts.r.norm(dim=-1).median().item(), impacts.mass.median().item()
    if impacts.shape is None or mass > _LIGHTEST * size**3 or not _computed(impacts):
        return []
    units = [name for name, unit in MISWRITTEN.items() if unit.columns == ("shape",)]
    before, after = _contradictory(impacts), {name: _contradictory(correct(impacts, [name])) for name in units}
    best = min(after, key=lambda name: after[name])
    if after[best] > before - thresholds.convention_gain:
        return []
    sentence = (
        f"{MISWRITTEN[best].words}: the contact point is {number(size, 3)} m from the centre of a {number(1e3 * mass)} "
        f"g body, and lengths of a shape are in m; corrected, the contradictions per trial fall from {before:.2f} to "
        f"{after[best]:.2f}"
    )
    evidence = evidence_of(
        ("size", size, "m"),
        ("mass", mass, "kg"),
        ("contradictions_before", before),
        ("contradictions_after", after[best]),
    )
    return [Finding(name=best, sentence=sentence, evidence=evidence, correction=best)]


def heavy_body_notes(impacts: Impacts) -> list[Finding]:
    """Note a mass that no material has in the sphere about the centre of mass that reaches to the farthest contact."""
    size, mass = impacts.r.norm(dim=-1).max().item(), impacts.mass.median().item()
    density = mass / (4 / 3 * math.pi * size**3) if size > 0 else 0.0
    if density < _DENSEST:
        return []
    sentence = (
        f"a body of {number(mass, 3)} kg that touches at most {number(size, 2)} m from its centre of mass would have "
        f"{number(density, 2)} kg/m³, and the densest metal has {number(_DENSEST, 3)}: is its mass in g? Write the "
        "unit into the name of the column, such as m [g]"
    )
    evidence = evidence_of(("mass", mass, "kg"), ("size", size, "m"))
    return [Finding(name="heavy_body", sentence=sentence, evidence=evidence, mistake=False)]


def place_notes(impacts: Impacts) -> list[Finding]:
    """Note places in the plane that are farther apart than any laboratory, and than bodies of this size bounce."""
    x, size = impacts.q[:, 0], impacts.r.norm(dim=-1).median().item()
    span = (x.quantile(0.95) - x.quantile(0.05)).item()
    if span < max(_LABORATORY, _SIZES * size):
        return []
    sentence = (
        f"x spans {number(span, 3)} m, {number(span / size, 2)} times the distance of the contact point from the "
        "centre of mass: is it in another unit? Write it into the name of the column, such as x [mm]"
    )
    evidence = evidence_of(("span", span, "m"), ("size", size, "m"))
    return [Finding(name="far_apart", sentence=sentence, evidence=evidence, mistake=False)]


def shape_findings_in_space(impacts: Impacts) -> list[Finding]:
    """Find a stated shape whose size differs from the height above the floor by a constant of units, in space."""
    if impacts.shape is None:
        return []
    expected = -contact_points(impacts.shape, impacts.body, impacts.q[:, 3:])[:, 2]
    middle = (impacts.q[:, 2] / expected).median().item()
    for length, factor in UNIT_FACTORS["length"].items():
        if length != "m" and middle > 0 and abs(math.log(middle * factor)) <= _UNIT_AGREES:
            sentence = (
                f"heights at contact are {number(middle, 3)} times what the shape gives: are lengths in {length}? say "
                f"data.units.length={length}, with the shape in m"
            )
            return [Finding(name="shape_unit", sentence=sentence, evidence=evidence_of(("ratio", middle)))]
    return []


def _computed(impacts: Impacts) -> bool:
    """Whether contact points are those of the stated shape to within rounding."""
    assert impacts.shape is not None
    expected = contact_points(impacts.shape, impacts.body, orientation_of(impacts.q))
    return bool((impacts.r - expected).norm() <= _ROUNDING * expected.norm())


def _contradictory(impacts: Impacts) -> float:
    return torch.stack([*contradictions(impacts).values()]).sum(0).mean().item()


def _same(column: torch.Tensor, all_of_them: torch.Tensor) -> bool:
    return bool(column.max() - column.min() <= _ROUNDING * all_of_them.abs().max())
