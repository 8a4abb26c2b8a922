"""Conventions of units and axes: hypotheses about them, compared by the contradictions in the measurements under each.

A hypothesis is a few named corrections; `contradictions` asks the same questions of each trial under each.  The mean of
the answers over the trials is compared pairwise, with its standard error.

All sensible combinations of a few corrections are compared, shorter ones first.  Those of one correction are compared
on all trials, longer ones on a sample of them, from which the best few go on to all trials.  A hypothesis is accepted
only if the moments balance under it and contradictions are negligible; otherwise the data stay as given.

Constants of units come before constants of bodies: where a known unit explains the moments as well as an inertia that
is fitted to them, it is the unit.  Last comes a floor that is inclined by any angle, beyond what an effect describes.
"""

import functools
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.errors import DataError
from contactlearn.data.audit.contradictions import contradictions
from contactlearn.data.audit.corrections import CORRECTIONS, correct, units_and_axes
from contactlearn.data.audit.incline import incline_text
from contactlearn.data.audit.moments import (
    BALANCE,
    Balance,
    Columns,
    balance,
    inertia_text,
    needed_inertia,
    point_text,
    spin_turn,
    torque,
    turn_text,
)
from contactlearn.data.audit.result import Evidence, Finding, evidence_of
from contactlearn.data.audit.thresholds import AuditThresholds
from contactlearn.data.audit.units import MISWRITTEN
from contactlearn.mechanics.bodies import shapes_among
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.shapes import Disc
from contactlearn.mechanics.space import PLANE, SPACE

_TURNS = ("quarter_turn", "quarter_turn_back", "half_turn")
AXES = (
    "swapped_pre_post",
    "mirrored_y",
    "swapped_axes",
    "mirrored_vy",
    "mirrored_x",
    "mirrored_theta",
    "mirrored_omega",
    *_TURNS,
    "contact_point_sign",
    "contact_point_mirrored",
)
_MIRRORED_SPINS = ("mirrored_spin", "mirrored_wx", "mirrored_wy", "mirrored_wz")
_UPWARDS = ("y_up", "x_up", "z_down", "y_up_in_body", "x_up_in_body", "z_down_in_body")
_UPWARDS_IN_SPIN = ("y_up_in_spin", "x_up_in_spin", "z_down_in_spin")
_SPIN_AT_ONE_TIME = tuple(
    f"{name}_{time}" for name in (*_UPWARDS_IN_SPIN, "spin_in_body_axes") for time in ("pre", "post")
)
"""Axes of the spin before impact or after it alone, beside which nothing else is wrong but the order of the inertia."""
_MIRRORS_IN_SPACE = ("mirrored_x_in_space", "mirrored_y_in_space", "mirrored_z_in_space")
AXES_IN_SPACE = (
    "swapped_pre_post",
    *("scalar_last", "inverse_quaternion", *_MIRRORED_SPINS, *_UPWARDS_IN_SPIN),
    *_SPIN_AT_ONE_TIME,
    *("spin_in_body_axes", "spin_of_angles", "contact_point_in_body_axes"),
    *_UPWARDS,
    *_MIRRORS_IN_SPACE,
    "mirrored_vz",
    "contact_point_sign",
)
"""Arrows in the axes of the body are taken to those of the world by the recorded quaternion, before the world turns."""
_INERTIA = ("inertia_xzy", "inertia_yxz", "inertia_yzx", "inertia_zxy", "inertia_zyx")
_MEANINGS = ("changes_post", "approach_speed")
"""What velocities mean: few other mistakes come with it, and only where nearly all trials have such numbers."""
_EXCLUSIVE = (
    *(("swapped_axes", *_TURNS), _UPWARDS, _UPWARDS_IN_SPIN, _MIRRORS_IN_SPACE, _MIRRORED_SPINS, _INERTIA),
    ("swapped_pre_post", *_MEANINGS),
    ("spin_in_body_axes", "spin_of_angles"),
    ("approach_speed", "mirrored_y", "mirrored_vy", "z_down", "z_down_in_body", "mirrored_z_in_space", "mirrored_vz"),
)
"""Of which a hypothesis has one: two are a third, or a floor that is inclined by 90°."""
_AXES_OF_INERTIA = {"scalar_last", "inverse_quaternion", "turned_spin", *_INERTIA}
"""Corrections that the moments alone may show, by the axes of the inertia or of the spin."""
DEGREES = ("degrees_omega", "degrees_theta", "degrees")
UNITS = (*DEGREES, "millimetres", "millimetres_velocity", "grams", "inertia_scaled")
_RARE = tuple(name for name, unit in MISWRITTEN.items() if name not in UNITS and "shape" not in unit.columns)
"""Units that occur once in a table, beside few other mistakes; those of one side of the impact alone."""
BALANCED = {*UNITS, *_RARE, "inclined_floor", "velocity_of_point", "turned_spin"} - {"degrees_theta"}
"""Corrections that the moment balance depends on."""
_MIRRORS = ((), ("mirrored_x",), ("mirrored_theta",), ("mirrored_omega",))
"""Corrections that an inclined floor may come with; a mirror of y is one of x and a turn."""
_SIGMAS = 5.0  # standard errors of the fall of contradictions: up to some thousand hypotheses are compared
_INDISTINCT = 0.02  # difference of the sum of contradictions below which two hypotheses are equivalent
EXPLAINED = 0.5  # share of Δω that the balance explains under other units, which else only shrink a Δω that is noise
_SHARPER = 0.5  # of the residual of the moment balance
_REVERSED = 0.4  # share of trials with a pulling floor, or without approach, from which on no impact made the data
_STEPS = {
    "plane": (*AXES[:3], *_MEANINGS, "mirrored_y", *AXES[3:], *UNITS[:-1], *_RARE, "inertia_scaled"),
    "space": (*_MEANINGS, *AXES_IN_SPACE, "degrees_omega", *UNITS[3:-1], *_RARE, *_INERTIA, "inertia_scaled"),
}
"""Corrections by the name of the space, in the order in which they are applied.

A swap of the axes and a mirror of y are a turn by 90°, whose sense depends on which of them comes first.
"""
FITTED = {"inertia_scaled", "inclined_floor", "velocity_of_point", "turned_spin"}  # numbers that moments show
_CONFUSED = {*UNITS, *_RARE}  # what an inclined floor may look like
# contradictions of an accepted hypothesis from which on an inclined floor is tried, which must leave less
_MAX_CONTRADICTIONS = 0.15
_MAX_CONTRADICTIONS_OF_UNIT = 0.05  # the same where it is a unit: an inclined floor that looks like one leaves more
_UNIT_R_SQUARED = 0.8  # share of Δω that the balance explains, with whatever coefficients, under a rare unit
_SETTLING = 0.04  # fall of contradictions for each correction more than those of an accepted hypothesis
_SETTLED = 0.25  # of the contradictions that an accepted hypothesis leaves, which a longer one may leave in its place
_OPEN_MOMENTS = 0.1  # mean contradiction of the moments from which on fitted corrections are tried
_LEAST_TURN = 0.1  # rad, of the spins against the world: less is errors
_SLIGHT = 0.2  # rad, range of the effect `surface_tilt`
_OF_ONE_SIDE, _OF_BOTH_SIDES = {"mirrored_omega_pre", "mirrored_omega_post"}, (("mirrored_omega",), ("mirrored_spin",))
_EXCHANGED = 0.5  # contradictions that two exchanged columns may leave, of those that the best hypothesis leaves
_VELOCITIES = [f"{name} {when} impact" for when in ("before", "after") for name in ("v_x", "v_y", "ω")]
# corrections at once: the pictures of a camera may give mm, mm/s and degrees with y downwards; no table that anybody
# brought had more than three. 150 impacts in the plane are 1, 44, 249, 1244, and 818 hypotheses (0.3 s for the last).
_DEPTH = {"plane": 4, "space": 3}
_MIN_CHANGE = 0.005  # change of a mean contradiction from which on it is part of the evidence
_MAX_BESIDE_RARE = 2  # other corrections that a rare unit, or another meaning of velocities, may come with
_NEARLY_ALL = 0.9  # share of trials whose numbers may be changes, or speeds towards the floor, before either is tried
_UNIT_MARGIN = 0.1  # contradictions by which an inertia may explain more than a unit before it is preferred to it
_FITS = 4.0  # standard errors of the moment balance within which a unit explains it
_UNIT_ERROR = 0.5  # of the logarithm of a unit: imbalance that may be left of a mistake that it explains
_SAMPLE, _FINALISTS = 64, 8  # trials on which combinations are compared, and combinations that go on to all trials


@dataclass(frozen=True, kw_only=True)
class Hypothesis:
    """Corrections by name, in the order in which they are applied, and the impacts that they give."""

    names: tuple[str, ...]
    impacts: Impacts
    thresholds: AuditThresholds

    @functools.cached_property
    def answers(self) -> dict[str, Float[Tensor, " n"]]:
        """Contradictions of each trial by question."""
        return contradictions(self.impacts)

    @functools.cached_property
    def total(self) -> Float[Tensor, " n"]:
        """Sum of the contradictions of each trial."""
        first, *others = self.answers.values()
        return sum(others, first)

    @property
    def score(self) -> float:
        """Mean sum of the contradictions."""
        return self.total.mean().item()

    @functools.cached_property
    def balance(self) -> Balance:
        """The moment balance, fitted."""
        return balance(self.impacts)

    @property
    def closed(self) -> bool:
        """Whether contradictions are negligible, those of the moments included."""
        return self.score < self.thresholds.consistent

    @property
    def fits(self) -> bool:
        """Whether no other inertia balances the moments clearly better, within the errors of the coefficients."""
        error = min(self.balance.a_error, self.balance.b_error)
        return not abs(torque(self.impacts).inertia_factor.log().item()) > _FITS * error

    def means(self) -> dict[str, float]:
        """Mean contradiction by question."""
        return {question: answer.mean().item() for question, answer in self.answers.items()}

    def __str__(self) -> str:
        return hypothesis_text(self.names)


def hypothesis_text(names: tuple[str, ...]) -> str:
    """Write a hypothesis as its corrections, for display."""
    return " + ".join(names) or "as they are"


@dataclass(frozen=True, kw_only=True)
class ConventionComparison:
    """The data as given, the best hypothesis, others of its length as good as it, and the number compared."""

    given: Hypothesis
    best: Hypothesis
    equals: tuple[Hypothesis, ...]
    tried: int

    @property
    def gain(self) -> float:
        """Fall of the mean sum of contradictions under the best hypothesis."""
        return (self.given.total - self.best.total).mean().item()

    @property
    def sigmas(self) -> float:
        """The same in standard errors."""
        return _sigmas(self.given.total - self.best.total)


def _sigmas(gain: Float[Tensor, " n"]) -> float:
    error = gain.std() / math.sqrt(len(gain)) if len(gain) > 1 else torch.tensor(math.inf)
    return (gain.mean() / error.clamp_min(1e-3)).item()


def compare(impacts: Impacts, thresholds: AuditThresholds = AuditThresholds()) -> ConventionComparison:
    """Find the best of the smallest hypotheses that are accepted, or the data as given where there is none.

    One that leaves contradictions gives way to a longer one that leaves next to none.
    """
    given = Hypothesis(names=(), impacts=impacts.replace(validate=False), thresholds=thresholds)
    as_given = ConventionComparison(given=given, best=given, equals=(), tried=1)
    tried, doubtful = 1, None
    for depth in range(1, _DEPTH[impacts.space.name] + 1):
        if depth > 1 and given.closed and not impossible_findings(as_given, thresholds):
            break
        if doubtful is not None and depth > len(doubtful.best.names) + 1:
            break
        screened = _screened(given.impacts, depth, thresholds)
        tried += len(screened.names)
        applied = (_applied(given, names) for names in screened.best())
        accepted = [h for h in applied if h is not None and _better(h, given)]
        if given.score > thresholds.sound and (accepted or depth == 1):
            axes = [name for name in min(accepted, key=lambda h: h.score).names if name in AXES] if accepted else []
            pairs = _pairs_of_units(axes)
            scores = _total(_under(given.impacts, pairs)).mean(-1).tolist()
            closed = [pair for pair, score in zip(pairs, scores, strict=True) if score < thresholds.consistent]
            applied = (_applied(given, pair) for pair in closed)
            accepted += [h for h in applied if h is not None and _better(h, given) and h.fits]
            tried += len(pairs)
        if doubtful is not None:
            accepted = [h for h in accepted if _settles(h, doubtful.best)]
        if accepted:
            chosen = _chosen(given, accepted, tried)
            if doubtful is None and chosen.best.score >= _most_contradictions(chosen.best):
                chosen = _chosen(given, [*accepted, *_fitted(given)], tried + len(_MIRRORS))
            if chosen.best.score < _MAX_CONTRADICTIONS_OF_UNIT:
                return chosen
            doubtful = doubtful or chosen
    if doubtful is not None:
        return doubtful
    opened = given.means()["moment"] > _OPEN_MOMENTS
    accepted = _fitted(given) if given.score > thresholds.sound or opened else []
    if accepted:
        return _chosen(given, accepted, tried + len(_MIRRORS))
    return ConventionComparison(given=given, best=given, equals=(), tried=tried)


def _most_contradictions(accepted: Hypothesis) -> float:
    """Contradictions up to which an accepted hypothesis needs no other."""
    return _MAX_CONTRADICTIONS_OF_UNIT if _CONFUSED.intersection(accepted.names) else _MAX_CONTRADICTIONS


def _settles(longer: Hypothesis, doubtful: Hypothesis) -> bool:
    """Whether a longer hypothesis leaves next to none of the contradictions of an accepted one."""
    gain, more = doubtful.total - longer.total, max(1, len(longer.names) - len(doubtful.names))
    clearly = gain.mean().item() >= _SETTLING * more and _sigmas(gain) > _SIGMAS
    return clearly and longer.score < min(_MAX_CONTRADICTIONS_OF_UNIT, _SETTLED * doubtful.score)


def _under(impacts: Impacts, hypotheses: list[tuple[str, ...]]) -> Columns:
    """The columns under each of some hypotheses of units and axes."""
    given = Columns.of(impacts)
    columns = given.room(len(hypotheses))
    for k, names in enumerate(hypotheses):
        columns[k : k + 1] = functools.reduce(units_and_axes, names, given)
    return columns


def _total(columns: Columns) -> Float[Tensor, "hypotheses n"]:
    """Sum of the contradictions of each trial under each hypothesis."""
    first, *others = contradictions(columns).values()
    return sum(others, first)


def _pairs_of_units(axes: list[str]) -> list[tuple[str, ...]]:
    """Hypotheses of a unit of speeds and one of spins, or of one unit of all lengths, by name.

    The ratio of two units looks like another inertia: spins in rev/min beside speeds in mph are 0.234 of it, spins in
    rev/s beside them an impossible 14, and inches beside in/s are 1550.
    """
    speeds = _whole("velocity")
    pairs = [*itertools.product(speeds, _whole("omega"))]
    pairs += [(name.removesuffix("_velocity"), name) for name in speeds if name.removesuffix("_velocity") in _RARE]
    return [(*axes, *pair) for pair in pairs]


def _whole(quantity: str) -> list[str]:
    """Corrections that convert a velocity before and after contact, and nothing else."""
    columns = (f"{quantity}_pre", f"{quantity}_post")
    return [name for name, unit in MISWRITTEN.items() if unit.columns == columns]


def _fitted(given: Hypothesis) -> list[Hypothesis]:
    """The accepted hypotheses of another point of the body, of turned spins, and in the plane of an inclined floor.

    An incline within the range of `surface_tilt` is left to that effect, unless the data are impossible without it.
    """
    names = ["velocity_of_point"]
    if given.impacts.space is SPACE and torch.trace(spin_turn(given.impacts)) < 1 + 2 * math.cos(_LEAST_TURN):
        names += ["turned_spin"]
    applied = (_applied(given, (name,)) for name in names)
    accepted = [h for h in applied if h is not None and h.score <= _MAX_CONTRADICTIONS and _better(h, given)]
    for mirrors in _MIRRORS if given.impacts.space is PLANE else ():
        level, inclined = _applied(given, mirrors), _applied(given, (*mirrors, "inclined_floor"))
        if level is None or inclined is None or inclined.score > _MAX_CONTRADICTIONS or not _better(inclined, given):
            continue
        angle = (level.impacts.q[0, 2] - inclined.impacts.q[0, 2] + math.pi).remainder(2 * math.pi) - math.pi
        alone = ConventionComparison(given=given, best=level, equals=(), tried=1)
        if abs(angle.item()) > _SLIGHT or impossible_findings(alone, given.thresholds):
            accepted.append(inclined)
    return accepted


def _chosen(given: Hypothesis, accepted: Sequence[Hypothesis], tried: int) -> ConventionComparison:
    """The best of accepted hypotheses: one without a fitted number if it is nearly as good as the others."""
    least = min(accepted, key=lambda h: h.score)
    known = [
        h
        for h in accepted
        if not FITTED.intersection(h.names) and h.score < least.score + _margin(h, least) + _INDISTINCT
    ]
    new = min(known or accepted, key=lambda h: h.score)
    if _OF_ONE_SIDE.intersection(new.names):  # where it is clearly better than the sign of both sides
        both = (h for h in accepted if h.names in _OF_BOTH_SIDES and _sigmas(h.total - new.total) < _SIGMAS)
        new = next(both, new)
    equal = [h for h in accepted if h is new or new.score <= h.score < new.score + _INDISTINCT]
    equal = [h for h in equal if h.fits] or equal  # 3.6 and 1/0.3048 differ by less than an effect may
    best, *equals = sorted(equal, key=_simplicity)
    return ConventionComparison(given=given, best=best, equals=tuple(equals), tried=tried)


def _simplicity(hypothesis: Hypothesis) -> tuple[bool, int, bool, list[int]]:
    """The order among equal hypotheses: without a fitted number, shorter, above zero, earlier in the list.

    Of balls, whose topspin is clockwise for one that flies to the right, the sense of the spin goes first.
    """
    names, shape = hypothesis.names, hypothesis.impacts.shape
    balls = shape is not None and all(isinstance(one, Disc) for one in shapes_among(shape).values())
    order = [*CORRECTIONS]
    places = [-1 if balls and name == "mirrored_omega" else order.index(name) for name in names]
    below = hypothesis.impacts.q[:, hypothesis.impacts.space.d - 1].median().item() < 0  # heights, most often
    return bool(FITTED.intersection(names)), len(names), below, places


def _margin(unit: Hypothesis, least: Hypothesis) -> float:
    """Contradictions that a unit may leave beyond those of an inertia that is preferred to it otherwise.

    What it leaves of the moments alone, as of a hollow ball that was taken for a solid one, is a wrong inertia too.
    """
    if "inertia_scaled" not in least.names:
        return 0.0
    return _UNIT_MARGIN if unit.fits else max(0.0, unit.means()["moment"] - least.means()["moment"])


def _better(new: Hypothesis, given: Hypothesis) -> bool:
    """Whether a hypothesis is clearly better; other units must not merely shrink a Δω that is all noise."""
    gain, thresholds = given.total - new.total, new.thresholds
    least = 0.0 if _sharper(new, given) else thresholds.convention_gain * len(new.names)
    if not new.closed or gain.mean().item() < least or _sigmas(gain) < _SIGMAS or not _explains(new):
        return False
    judged = new.balance.judged  # three components of Δω that are mostly noise tell no axes
    left_open = judged.r_squared < EXPLAINED or judged.imbalance > thresholds.doubted_balance
    if new.impacts.space is SPACE and judged.terms and left_open:
        return False
    return not BALANCED.intersection(new.names) or torque(new.impacts).explained.item() > EXPLAINED


def _sharper(new: Hypothesis, given: Hypothesis) -> bool:
    """Whether other axes of the inertia, and nothing else, halve what is left of the moment balance."""
    if not _AXES_OF_INERTIA.issuperset(new.names):
        return False
    left = [(terms := torque(one.impacts)).size(terms.residual).median() for one in (new, given)]
    return bool(left[0] < _SHARPER * left[1])


def _explains(new: Hypothesis) -> bool:
    """Whether a rare unit explains the imbalance, which then is no physics of about its size."""
    rare = [MISWRITTEN[name].factor for name in new.names if name in _RARE]
    if rare and not new.balance.judged.terms:  # vertical drops without spin: no moment tells any unit
        return False
    if rare and new.balance.r_squared < _UNIT_R_SQUARED:  # as of spins that end at a limit
        return False
    left = abs(torque(new.impacts).inertia_factor.log().item())
    if len(rare) != 1:
        return not rare or new.fits
    size, reach = abs(math.log(abs(rare[0]))), math.log(new.thresholds.inertia_factor)
    return new.fits if size < reach else left < min(_UNIT_ERROR * size, reach)  # what is left is an effect


class _Screened(NamedTuple):
    """Hypotheses by name, and the mean sum of the contradictions under each; infinite for those that are excluded."""

    names: list[tuple[str, ...]]
    scores: Float[Tensor, " hypotheses"]

    def best(self) -> list[tuple[str, ...]]:
        """The few with the fewest contradictions."""
        ranked = self.scores.argsort(stable=True)[:_FINALISTS].tolist()
        return [self.names[k] for k in ranked if self.scores[k] < math.inf]


def _screened(impacts: Impacts, depth: int, thresholds: AuditThresholds) -> _Screened:
    """Compare all hypotheses of so many corrections, more than one of them on a sample of the trials."""
    if depth > 1 and len(impacts) > _SAMPLE:
        impacts = impacts[torch.randperm(len(impacts), generator=torch.Generator().manual_seed(0))[:_SAMPLE]]
    names, columns = combinations(impacts, depth, thresholds)
    shrunk = torch.tensor([bool(BALANCED.intersection(have)) for have in names])
    shrunk &= torque(columns).explained <= EXPLAINED
    return _Screened(names, _total(columns).mean(-1).masked_fill(shrunk, math.inf))


def combinations(impacts: Impacts, depth: int, thresholds: AuditThresholds) -> tuple[list[tuple[str, ...]], Columns]:
    """Return all sensible hypotheses of so many corrections by name, and the columns under each."""
    names, steps = _sequences(impacts.space.name, depth)
    given = Columns.of(impacts)
    columns, plausible = given.room(len(names)), torch.zeros(len(names), dtype=torch.bool)
    columns[:1], plausible[0] = given, True
    for name, before, after in steps:
        some = plausible[before]
        changed, good = _changed(columns[before[some]], name, thresholds)
        columns[after[some]], plausible[after[some]] = changed, good
    chosen = [k for k, good in enumerate(plausible.tolist()) if good and len(names[k]) == depth]
    return [names[k] for k in chosen], columns[torch.tensor(chosen, dtype=torch.long)]


@functools.cache
def _sequences(space: str, depth: int) -> tuple[list[tuple[str, ...]], list[tuple[str, Tensor, Tensor]]]:
    """All sensible hypotheses of at most so many corrections; by correction the places of those before and after it."""
    names: list[tuple[str, ...]] = [()]
    made = list[tuple[str, Tensor, Tensor]]()
    for step, name in enumerate(_STEPS[space]):
        again = name in _STEPS[space][:step]
        before = [k for k, have in enumerate(names) if len(have) < depth and _sensible(have, name, again)]
        made.append((name, torch.tensor(before, dtype=torch.long), len(names) + torch.arange(len(before))))
        names += [(*names[k], name) for k in before]
    return names, made


def _sensible(have: tuple[str, ...], name: str, again: bool) -> bool:
    """Whether a step may follow others; the second of its name follows a swap alone.

    A column is converted once, and only one correction changes I relative to m.  Before and after are not swapped
    together with two other changes of the axes: a mirrored film run backwards explains any body that gains energy.
    A rare unit comes with few other mistakes, that of one side of the impact with none.
    """
    names = {*have, name}
    if name in have or (again and "swapped_axes" not in have):
        return False
    if names.intersection(_SPIN_AT_ONE_TIME) and len(names.difference(_INERTIA)) > 1:
        return False
    if any(len(names.intersection(some)) > 1 for some in _EXCLUSIVE):
        return False
    columns = [column for one in names if one in MISWRITTEN for column in MISWRITTEN[one].columns]
    columns += ["mass"] * ("inertia_scaled" in names)
    if len(columns) > len(set(columns)) or len(names.intersection(DEGREES)) > 1:
        return False
    if names.intersection(_MEANINGS) and len(names) > 1 + _MAX_BESIDE_RARE:
        return False
    rare = names.intersection(_RARE)
    beside = 0 if any(one.endswith(("_pre", "_post")) for one in rare) else _MAX_BESIDE_RARE
    if rare and (len(names) > 1 + beside or len(rare) > 1 or "inertia_scaled" in names):
        return False
    return "swapped_pre_post" not in names or len(names.intersection({*AXES, *AXES_IN_SPACE})) < 3


def _changed(columns: Columns, name: str, thresholds: AuditThresholds) -> tuple[Columns, Tensor]:
    """Columns [B] after a correction, and the hypotheses [B] for which it is plausible.

    Another inertia is not where the balance requires a negative one, an impossible one, or one that is only a little
    different; another meaning of velocities is where nearly all trials move away from the floor before contact, or
    faster after it.
    """
    if name in _MEANINGS:
        before, after = columns.v_pre[..., columns.space.d - 1], columns.v_post[..., columns.space.d - 1]
        meant = before > 0 if name == "approach_speed" else (before < 0) & (after > -before)
        return units_and_axes(columns, name), meant.double().mean(-1) > _NEARLY_ALL
    if name != "inertia_scaled":
        return units_and_axes(columns, name), torch.ones(len(columns.mass), dtype=torch.bool)
    factor = needed_inertia(columns, thresholds)
    scaled = columns.inertia * factor.view(-1, *[1] * (columns.inertia.ndim - 1))
    return columns.replace(inertia=scaled), factor.isfinite()


def _applied(given: Hypothesis, names: tuple[str, ...]) -> Hypothesis | None:
    """Apply corrections to all trials; None where these require no other inertia or no incline."""
    impacts, thresholds = given.impacts, given.thresholds
    for name in names:
        if name == "inertia_scaled" and not needed_inertia(impacts, thresholds).isfinite():
            return None
        try:
            impacts = CORRECTIONS[name].function(impacts, AuditThresholds())  # none of these drops a trial
        except DataError:  # no incline balances the moments
            return None
    return Hypothesis(names=names, impacts=impacts, thresholds=thresholds)


def convention_findings(comparison: ConventionComparison) -> list[Finding]:
    """A finding for each correction of the best hypothesis; the evidence is that of all of them together.

    The last one has it in words, and the hypotheses that are as good.
    """
    given, best = comparison.given, comparison.best
    if not best.names:
        return []
    evidence, numbers = _comparison_evidence(comparison)
    alternatives = tuple(equal.names for equal in comparison.equals)
    others = " or ".join(f"data.correct=[{','.join(names)}]" for names in alternatives)
    which = "these" if len(best.names) > 1 else "this"
    equal = f"; these data cannot distinguish {which} from {others}" if others else ""
    findings = []
    for place, name in enumerate(best.names):
        factor = None
        if name == "inertia_scaled":
            factor = (best.impacts.inertia.mean() / given.impacts.inertia.mean()).item()
        text = CORRECTIONS[name].description + ("" if factor is None else f", {inertia_text(factor)}")
        if name == "inclined_floor":
            text = incline_text(correct(given.impacts, best.names[:place]))
        if name in (said := {"velocity_of_point": point_text, "turned_spin": turn_text}):
            text += f"; {said[name](correct(given.impacts, best.names[:place]))}"
        last = place == len(best.names) - 1
        finding = Finding(
            name=name,
            sentence=text + equal if last else text,
            grounds=numbers if last else "",
            evidence=evidence if factor is None else (*evidence, *evidence_of(("factor", factor))),
            correction=name,
            hypothesis=best.names,
            alternatives=alternatives,
        )
        findings.append(finding)
    return findings


def _comparison_evidence(comparison: ConventionComparison) -> tuple[tuple[Evidence, ...], str]:
    """Evidence for a hypothesis, and its numbers in words."""
    given, best = comparison.given, comparison.best
    before, after = given.balance, best.balance
    means = {question: (mean, best.means()[question]) for question, mean in given.means().items()}
    total = given.total.mean().item(), best.total.mean().item()
    better = (best.total < given.total).double().mean().item()
    turned = str(before) != str(after)
    changed = {question: pair for question, pair in means.items() if abs(pair[0] - pair[1]) > _MIN_CHANGE}
    evidence = evidence_of(
        *(before.coefficients("before").items() if turned else ()),
        *after.coefficients("after").items(),
        *((f"{name}_{when}", pair[k]) for name, pair in changed.items() for k, when in enumerate(("before", "after"))),
        ("contradictions_before", total[0]),
        ("contradictions_after", total[1]),
        ("standard_errors", comparison.sigmas),
        ("better_in", better),
        ("hypotheses", float(comparison.tried)),
    )
    most = max(means, key=lambda question: means[question][0] - means[question][1])
    rule = f"{BALANCE[given.impacts.space.name]} should give a = b = 1"
    numbers = f"{rule}: as read {before}; corrected {after}; " if turned else ""
    numbers += (
        f"the contradictions per trial, mostly of {most}, fall from {total[0]:.2f} to {total[1]:.2f}, in {better:.0%} "
        f"of {len(given.total)} trials, by {comparison.sigmas:.0f} standard errors"
    )
    return evidence, numbers


def impossible_findings(comparison: ConventionComparison, thresholds: AuditThresholds) -> list[Finding]:
    """Data that no impact of a rigid body can have produced under any hypothesis; fatal."""
    best = comparison.best
    share, means, fit = max(0.0, torque(best.impacts).explained.item()), best.means(), best.balance
    moment = best.answers["moment"]
    at_least = moment.mean().item() - 2 * moment.std().item() / math.sqrt(len(moment))
    judged = bool(fit.judged.terms)
    unbalanced = judged and at_least > thresholds.impossible and share < thresholds.impossible
    reasons = {
        f"the residual of the moment balance is {means['moment']:.0%} of its terms: with the coefficients +1 and +1 "
        f"it explains {share:.0%} of Δω, and fitted to it {fit}": unbalanced,
        f"the floor pulls in {means['push']:.0%} of trials": means["push"] > _REVERSED,
        f"{means['approach']:.0%} of trials do not approach the floor": means["approach"] > _REVERSED,
    }
    reasons = [reason for reason, holds in reasons.items() if holds]
    if not reasons:
        return []
    space = best.impacts.space
    tried = (
        "the shape, mirrored, swapped and reversed axes, a floor inclined by any angle, and another moment of inertia"
    )
    if space is SPACE:
        tried = "the shape, turned, mirrored and body axes, other quaternions, and other moments of inertia"
    sentence = (
        f"no {'planar ' if space is PLANE else ''}impact of a rigid body can have produced these data: under the best "
        f"of {comparison.tried} hypotheses about units and axes ({best}) {'; '.join(reasons)}. Tried were the units of "
        f"every column and of {tried}. {_lead(best)}"
    )
    evidence = evidence_of(
        ("hypotheses", float(comparison.tried)), ("explained", share), *fit.coefficients("best").items(), *means.items()
    )
    return [Finding(name="impossible", sentence=sentence, evidence=evidence, fatal=True, hypothesis=best.names)]


def _lead(best: Hypothesis) -> str:
    """The likeliest causes of impossible data, by what is seen most under the best hypothesis."""
    means, normal = best.means(), "y" if best.impacts.space is PLANE else "z"
    if max(means["approach"], means["push"]) > _REVERSED:
        seen = "do not approach the floor" if means["approach"] >= means["push"] else "are pulled by it"
        return (
            f"That bodies {seen} has two likely causes: the normal of the surface is not {normal}, as of a wall or a "
            "racket that leans, or of several walls, which want a table each, or the surface moves, and its velocity "
            "was not taken off"
        )
    if best.balance.r_squared > EXPLAINED:
        return (
            f"Spins follow the impulses (R² = {best.balance.r_squared:.2f}), but not as they should: is the shape that "
            "of this body, with θ about its axes, or are columns after impact something else than velocities?"
        )
    for rows, where in ((1, "low"), (-1, "high")):
        moved = best.impacts.replace(v_post=best.impacts.v_post.roll(-rows, 0), validate=False)
        closed = Hypothesis(names=(), impacts=moved, thresholds=best.thresholds).closed
        if closed and torque(moved).explained.item() > EXPLAINED:
            return f"The velocities after impact stand one row too {where}: shifted by one they close the balance"
    return "Do before and after belong to the same trials, and ω to the same body?"


def exchanged_findings(comparison: ConventionComparison) -> list[Finding]:
    """Two columns of velocities that were mixed up: their exchange closes what no other hypothesis does; fatal."""
    best, impacts = comparison.best, comparison.given.impacts
    velocities = torch.cat((impacts.v_pre, impacts.v_post), -1)
    orders = list[list[int]]()
    for pair in itertools.combinations(range(velocities.shape[-1]), 2):
        order = [*range(velocities.shape[-1])]
        order[pair[0]], order[pair[1]] = reversed(pair)
        orders.append(order)
    columns = _under(impacts, [()] * len(orders))
    v_pre, v_post = velocities[:, torch.tensor(orders)].movedim(1, 0).split(3, -1)
    least = int(_total(columns.replace(v_pre=v_pre, v_post=v_post)).mean(-1).argmin())
    exchange = Hypothesis(
        names=tuple(name for k, name in enumerate(_VELOCITIES) if orders[least][k] != k),
        impacts=impacts.replace(validate=False, v_pre=v_pre[least], v_post=v_post[least]),
        thresholds=best.thresholds,
    )
    clearly = exchange.score < _EXCHANGED * best.score and _sigmas(best.total - exchange.total) > _SIGMAS
    if not exchange.closed or not clearly:
        return []
    first, second = exchange.names
    sentence = (
        f"{first} and {second} are exchanged: with these two columns mixed up the contradictions per trial fall from "
        f"{comparison.given.score:.2f} to {exchange.score:.2f}, and under the best of {comparison.tried} hypotheses "
        f"about units and axes ({best}) to {best.score:.2f} alone; name the columns the other way round (data.columns)"
    )
    evidence = evidence_of(
        ("contradictions_before", comparison.given.score),
        ("contradictions_after", exchange.score),
        ("contradictions_otherwise", best.score),
    )
    return [Finding(name="exchanged_columns", sentence=sentence, evidence=evidence, fatal=True)]
