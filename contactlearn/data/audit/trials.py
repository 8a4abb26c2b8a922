"""Trials that no impact of a laboratory can have produced, and estimates of the apparatus that contradict one.

Each finding is about the rows of a table as read, or with corrected units and axes; no hypotheses are compared.
"""

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from contactlearn.core.numerics import MAD_SCALE, measured, number
from contactlearn.data.audit.moments import kinetic_energy, torque
from contactlearn.data.audit.result import Finding, evidence_of
from contactlearn.data.audit.thresholds import AuditThresholds
from contactlearn.mechanics.bodies import body_code, contact_points, numbered, per_body, shapes_among
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import GRAVITY, in_body
from contactlearn.mechanics.shapes import Polygon, Shape
from contactlearn.mechanics.space import SPACE

FASTEST = 100.0
"""Plausible speed before impact in m/s."""
ENERGY_GAIN = 1.25
"""Ratio of kinetic energies after and before impact above which a trial gains energy; 1 to 1.25 decide the same."""
_SLIGHT_GAIN = 0.005  # of the energy, that is gained in as many trials as noise never gives: rounding is less
_GAIN_SIGMAS = 4.0  # standard errors by which the mean gain differs from 0, and the share of gaining trials from a half
_GAINING_SHARE = 0.05  # share of trials that gain energy above which this is reported; it guards against noise
_IMBALANCE = 1 / 3  # share of the terms of the balance that a gross residual exceeds: the spread of exact data is tiny
_COMMON_SHARE = 0.1  # share of an object's trials with a gross mass from which on it is two bodies of one name
_APPARATUS_SIGMAS = 3.0  # standard errors by which the scale must be off, too
_SECONDS_A_TRIAL = 0.5  # that a trial takes at least: times that span less are no clock of the session
_UNEVEN = 0.01  # of the median standard deviation; flights of few frames and of many differ by ten
_RANK_CORRELATION = 0.8  # of time and order, from which on such times are a clock all the same
_SORTED = 0.9  # rank correlation of the order and the state from which on trials are sorted by it: chance gives 0.5
_MIN_SORTED = 20  # trials below which chance sorts them, and no dependence on the order is tested
_UNCHANGED_SHARE = 0.5  # of the trials, whose velocities do not change, from which on they are no impacts
_ROUNDING = 1e-9  # relative change of a quantity that counts as none
_MAX_STRAY_SHARE = 0.01  # share of outliers up to which the others are no worse for them: dropping them is a note
_COMPARED = 10_000  # trials, spread evenly, by which it is seen which components of an outcome were measured
_BODIES, _MIN_OF_BODY = 6, 5  # bodies at most, and trials of each at least, that masses tell apart
_LISTED = 5  # values that a sentence names
_MIN_SATURATED, _REPEATED = 5, 3  # trials at a limit, and how often their number is that of any other reading
_CLOSED, _OPEN = 0.3, 0.9  # shares of the trials with the least residual, and without the largest
_FAR_OFF, _OPEN_BY = 12.0, 0.1  # ratio of these residuals, below 9 in all sets in space; imbalance of the second
_MIN_OF_KINDS = 40  # trials: of fewer such a ratio is chance
_TOGETHER = 0.8  # share of a stretch of rows from which on it is one
_ALL_BUT_FEW = 0.98  # of the spins, which noise of the orientation does not make the largest
_AT_END = 0.04  # relative distance from the largest spins of those that end there, by noise of the orientation
_SHARP = 1e-4  # the same of spins in the axes in which they were read, of which five do not agree by chance
_ENDED_SHARE = 0.2  # of the spins about any axis; of 128 sets of five authors without a limit none has more than 0.06
_SATURATED_SHARE = 0.5  # of the trials at a limit from which on it is a state that was set, or no measurement


def trial_findings(impacts: Impacts, thresholds: AuditThresholds) -> list[Finding]:
    """Find the mistakes that need no comparison of hypotheses; gross outliers do not count for energy and shape."""
    by_reason, kinds = gross_outliers(impacts, thresholds), two_kinds_findings(impacts)
    good = ~torch.stack([*by_reason.values()]).any(0)
    if impacts.space is SPACE:
        return [*kinds, *_outlier_findings(impacts, by_reason, thresholds), *order_findings(impacts)]
    stray, fast = _outlier_findings(impacts, by_reason, thresholds), speed_findings([impacts])
    if any(one.correction for one in stray) and not speed_findings([impacts[good]]):
        fast = [replace(one, mistake=False) for one in fast]  # they are left out
    findings = kinds + scale_findings(impacts, thresholds) + fast + stray
    if good.any():
        findings += _energy_findings(impacts[good]) + _shape_findings(impacts[good], thresholds)
    return findings + order_findings(impacts)


def two_kinds_findings(impacts: Impacts) -> list[Finding]:
    """Find that the moment balance closes in many trials and is far off in the others, as no instrument's noise is.

    It is a mistake where these trials follow each other, or repeat the row before them; a second corner that strikes
    looks alike otherwise.
    """
    terms = torque(impacts)
    left = terms.size(terms.residual)
    least, most = left.quantile(_CLOSED).item(), left.quantile(_OPEN).item()
    if len(impacts) < _MIN_OF_KINDS or most < _FAR_OFF * least or terms.imbalance.quantile(_OPEN) < _OPEN_BY:
        return []
    off = left > math.sqrt(least * most)
    rows = off.nonzero()[:, 0]
    first, last = int(rows[0]) + 1, int(rows[-1]) + 1
    sentence = (
        f"the moment balance closes in {1 - off.double().mean().item():.0%} of the trials, and in the others it is off "
        f"by {most / least:.0f} times as much"
    )
    together = len(rows) > _TOGETHER * (last - first + 1) and len(rows) < _TOGETHER * len(impacts)
    if together:
        sentence += f": they are in rows {first} to {last}; do all columns belong to the same trial there?"
    d, held = impacts.space.d, dict[str, int]()
    for when, velocity in (("before", impacts.v_pre), ("after", impacts.v_post)):
        same = (velocity[1:, d:] == velocity[:-1, d:]).all(-1) & (velocity[1:, d:] != 0).any(-1) & off[1:]
        if int(same.sum()) >= _MIN_SATURATED:
            held[when] = int(same.sum())
    for when, count in held.items():
        sentence += f"; {count} of them repeat the spin {when} impact of the row before, as readings that were held"
    evidence = evidence_of(("trials", float(len(rows)), "trials"), ("ratio", most / least))
    return [Finding(name="two_kinds", sentence=sentence, evidence=evidence, mistake=together or bool(held))]


def rig_notes(impacts: Impacts) -> list[Finding]:
    """The rig card: what differs from what was stated, or was applied, and how it limits effects."""
    rig = impacts.apparatus
    if rig is None:
        return []
    others = [str(row) for row in rig.rows() if not row.estimate.applied]
    sentence = f"measured without a law of contact: {', '.join(others)}"
    if rig.differing:
        names = ", ".join(row.quantity for row in rig.differing)
        sentence += f"; {names} differ from what is stated, which data.correct=[rig] corrects"
    sentence += "; effects are limited to three standard errors beyond these values"
    notes = [Finding(name="rig", sentence=sentence, evidence=(), rig=rig.rows(), mistake=False)]
    if rig.applied:
        sentence = f"applied first, as measured without a law of contact: {', '.join(map(str, rig.applied))}"
        notes.append(Finding(name="rig_applied", sentence=sentence, evidence=(), mistake=False))
    return notes


def incomplete_findings(impacts: Impacts) -> list[Finding]:
    """Note the trials that were left out as the table was read, because a number is missing."""
    left_out = impacts.incomplete
    if not left_out:
        return []
    names = ", ".join(map(repr, left_out[:_LISTED])) + (", …" if len(left_out) > _LISTED else "")
    sentence = (
        f"{len(left_out)} of {len(impacts) + len(left_out)} trials of the table were left out because a number is "
        f"missing or none, or the row is cut short: {names}"
    )
    evidence = evidence_of(("trials", float(len(left_out)), "trials"), ("names", ", ".join(left_out)))
    return [Finding(name="incomplete_trials", sentence=sentence, evidence=evidence, mistake=False)]


def duplicate_findings(impacts: Impacts) -> list[Finding]:
    """Rows that repeat an earlier one bit for bit."""
    twice = copied(impacts)
    count = int(twice.sum())
    if not count:
        return []
    first = impacts.trial[int(twice.nonzero()[0, 0])]
    sentence = f"{count} of {len(impacts)} trials repeat an earlier trial to the last digit, the first is {first!r}"
    evidence = evidence_of(("trials", float(count), "trials"), ("share", count / len(impacts)), ("first", first))
    return [Finding(name="duplicated_trials", sentence=sentence, evidence=evidence, correction="drop_duplicates")]


def unchanged_findings(impacts: Impacts) -> list[Finding]:
    """Velocities after impact that are, to the last digit, those before it in most trials; fatal."""
    same = (impacts.v_post == impacts.v_pre).all(-1)
    count = int(same.sum())
    if count <= _UNCHANGED_SHARE * len(impacts):
        return []
    sentence = (
        f"the velocities after impact are those before it, to the last digit, in {count} of {len(impacts)} trials: "
        "nothing was hit, or the columns before were copied to those after"
    )
    evidence = evidence_of(("trials", float(count), "trials"), ("share", count / len(impacts)))
    return [Finding(name="unchanged_velocities", sentence=sentence, evidence=evidence, fatal=True)]


def copied(impacts: Impacts) -> Bool[Tensor, " n"]:
    """Find the repeated trials; none where a single number was measured after contact: readings repeat by chance."""
    twice = repeated(impacts)
    outcomes = impacts.v_post[:: max(1, len(impacts) // _COMPARED)]
    return twice if int((outcomes != outcomes[0]).any(0).sum()) != 1 else torch.zeros_like(twice)


def repeated(impacts: Impacts) -> Bool[Tensor, " n"]:
    """Find the trials whose every pose and velocity equals, bit for bit, that of an earlier row."""
    numbers = torch.cat((impacts.r, impacts.q, impacts.v_pre, impacts.v_post), -1) + 0.0  # −0 is 0
    mixed = numbers.view(torch.int64) * torch.arange(1, 2 * numbers.shape[1], 2).pow(9)
    _, which, count = (mixed ^ (mixed >> 29)).sum(-1).unique(return_inverse=True, return_counts=True)
    seen: set[tuple[float, ...]] = set()
    twice = torch.zeros(len(numbers), dtype=torch.bool)
    for place in (count[which] > 1).nonzero()[:, 0].tolist():  # equal rows have equal sums, others almost never
        row = tuple(numbers[place].tolist())
        twice[place] = row in seen
        seen.add(row)
    return twice


def saturation_findings(impacts: Impacts) -> list[Finding]:
    """Find velocities that stop at a limit in several trials, as those of a gyroscope or an encoder do."""
    sides = [("before", impacts.v_pre), ("after", impacts.v_post)]
    symbols = impacts.space.symbols.items()
    stopped = [
        (f"{name} {when} impact", unit, velocity[at, k].abs().max().item(), count)
        for when, velocity in sides
        for k, (name, unit) in enumerate(symbols)
        if (count := int((at := _at_limit(velocity[:, k])).sum()))
    ]
    if not stopped:
        return []
    count = int(saturated(impacts).sum())
    listed = ", ".join(f"{name} at ±{number(limit, 4)} {unit} in {n}" for name, unit, limit, n in stopped)
    sentence = (
        f"readings stop at a limit in {count} of {len(impacts)} trials ({listed}), as an instrument that saturates: "
        "the true values lie beyond"
    )
    evidence = evidence_of(("trials", float(count), "trials"), *((name, x, unit) for name, unit, x, _ in stopped))
    return [Finding(name="saturated_readings", sentence=sentence, evidence=evidence, correction="drop_saturated")]


def gyroscope_findings(impacts: Impacts) -> list[Finding]:
    """Find spins in space that end at one number about the axes of the body, as those of a gyroscope do; fatal.

    Spins before impact may be set; those after it never end anywhere.
    """
    spins = in_body(impacts.v_post[:, 3:], impacts.q).abs()
    ended = spins > (1 - _AT_END) * spins.flatten().quantile(_ALL_BUT_FEW)
    sharply = spins > (1 - _SHARP) * spins.max()
    if ended.double().mean() < _ENDED_SHARE and sharply.sum() < _MIN_SATURATED:
        return []
    limit, trials = spins[ended].median().item(), ended.any(-1).double().mean().item()
    sentence = (
        f"spins after impact, about the axes of the body, end at ±{number(limit, 3)} rad/s ({math.degrees(limit):.0f} "
        f"°/s) in {trials:.0%} of {len(impacts)} trials, as those of a gyroscope whose range is too small: the true "
        "ones are lost"
    )
    evidence = evidence_of(("limit", limit, "rad/s"), ("trials", trials))
    return [Finding(name="saturated_gyroscope", sentence=sentence, evidence=evidence, fatal=True)]


def saturated(impacts: Impacts) -> Bool[Tensor, " n"]:
    """Find the trials with a velocity at the limit of its readings."""
    velocities = torch.cat((impacts.v_pre, impacts.v_post), -1).unbind(-1)
    return torch.stack([_at_limit(values) for values in velocities]).any(0)


def _at_limit(values: Float[Tensor, " n"]) -> Bool[Tensor, " n"]:
    """Where a reading is the largest in size, if several are, and no other reading repeats nearly as often."""
    size, which, count = values.abs().unique(return_inverse=True, return_counts=True)
    most, others = int(count[-1]), int(count[:-1].amax()) if len(count) > 1 else len(values)
    found = size[-1] > 0 and max(_MIN_SATURATED, _REPEATED * others) <= most < _SATURATED_SHARE * len(values)
    return which == len(count) - 1 if found else torch.zeros_like(which, dtype=torch.bool)


def state_notes(impacts: Impacts) -> list[Finding]:
    """Note by how much outcomes differ among trials of one state before impact: it is scatter, and no mistake."""
    body = torch.stack((impacts.mass, impacts.body.to(impacts.mass)), -1)
    before = torch.cat((body, impacts.r, impacts.q, impacts.v_pre), -1)
    _, which, count = before.unique(dim=0, return_inverse=True, return_counts=True)
    several = count[which] > 1
    if not several.any():
        return []
    means = torch.zeros(len(count), impacts.space.D, dtype=torch.float64).index_add(0, which, impacts.v_post)
    off = (impacts.v_post - (means / count[:, None])[which])[several]
    freedom = int(several.sum()) - int((count > 1).sum())
    symbols = impacts.space.symbols.items()
    deviation = (off.square().sum(0) / freedom).sqrt()
    spread = torch.where(deviation > _ROUNDING * impacts.v_post.abs().amax(0), deviation, 0.0).tolist()
    if not any(spread):
        return []
    sizes = ", ".join(f"{number(x, 2)} {unit} in {name}" for x, (name, unit) in zip(spread, symbols, strict=True))
    sentence = (
        f"{int(several.sum())} of {len(impacts)} trials share their state before impact with others, and their "
        f"outcomes differ by {sizes} (standard deviations): scatter of the contact or the instrument, or columns of "
        "too few digits"
    )
    evidence = evidence_of(
        ("trials", float(several.sum()), "trials"),
        *((name, x, unit) for x, (name, unit) in zip(spread, symbols, strict=True)),
    )
    return [Finding(name="equal_states", sentence=sentence, evidence=evidence, mistake=False)]


def sorted_notes(impacts: Impacts) -> list[Finding]:
    """Note that the trials are sorted by their state before impact, which no drift can then be told from."""
    d = impacts.space.d
    states = {name: v for name, v in zip(impacts.space.symbols, impacts.v_pre.unbind(-1), strict=True)}
    states |= {"v_n": impacts.v_c[:, d - 1], "the slip": impacts.v_c[:, : d - 1].norm(dim=-1)}
    states |= {"θ": impacts.q[:, 2]} if d == 2 else {}
    place = _ranks(impacts.order)
    agreement = {
        name: torch.corrcoef(torch.stack((_ranks(values), place)))[0, 1].item()
        for name, values in states.items()
        if values.max() - values.min() > _ROUNDING * values.abs().max()
    }
    most = max(agreement, key=lambda name: abs(agreement[name]), default=None)
    if len(impacts) < _MIN_SORTED or most is None or abs(agreement[most]) < _SORTED:
        return []
    sentence = (
        f"the trials are sorted by {most} before impact (rank correlation {agreement[most]:+.2f}): a dependence "
        "on it holds if nothing drifted meanwhile, since a drift would look the same and none is looked for; measure "
        "in random order"
    )
    evidence = evidence_of(("variable", most), ("rank_correlation", agreement[most]))
    return [Finding(name="sorted_trials", sentence=sentence, evidence=evidence, mistake=False)]


def mass_notes(impacts: Impacts) -> list[Finding]:
    """Note that trials without names of bodies have a few masses, which then tell the bodies apart."""
    count = Counter(named_by_mass(impacts))
    named = len({*impacts.object}) > 1 or isinstance(impacts.shape, Mapping)
    if named or not 1 < len(count) <= _BODIES or min(count.values()) < _MIN_OF_BODY:
        return []
    bodies = ", ".join(f"{n} of {mass}" for mass, n in count.items())
    sentence = f"trials without names of bodies have {len(count)} masses ({bodies}): those of one mass are of one body"
    evidence = evidence_of(("masses", float(len(count)), "masses"))
    return [Finding(name="masses", sentence=sentence, evidence=evidence, correction="named_by_mass", mistake=False)]


def named_by_mass(impacts: Impacts) -> tuple[str, ...]:
    """Return the mass of each trial to four digits, as a name of its body."""
    return tuple(f"{number(1e3 * mass, 4)} g" for mass in impacts.mass.tolist())


def _ranks(values: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
    """Ranks of values; equal ones share theirs."""
    values = values.contiguous()
    ranked = values.sort().values
    return (torch.searchsorted(ranked, values) + torch.searchsorted(ranked, values, side="right")).double()


def covariance_findings(impacts: Impacts) -> list[Finding]:
    """Variances that are far smaller than those of most trials, as of another unit: they would decide alone."""
    for name, columns in impacts.space.covariances.items():
        if (covariance := getattr(impacts, name)) is None:
            continue
        variance = covariance.diagonal(dim1=-2, dim2=-1)
        typical = variance.median(0).values
        small = (variance < _UNEVEN**2 * typical).any(-1)
        if not small.any():
            continue
        row = int(small.nonzero()[0, 0])
        k = int((variance[row] / typical.clamp_min(1e-300)).argmin())
        column = columns[impacts.space.upper[0].index(k)]
        ratio = (typical[k] / variance[row, k].clamp_min(1e-300)).sqrt().item()
        more = f" (and {int(small.sum()) - 1} more rows)" if small.sum() > 1 else ""
        sentence = (
            f"{name} has another scale in row {row + 1} (trial {impacts.trial[row]!r}), column {column}{more}: its "
            f"standard deviation {variance[row, k].sqrt().item():.2g} is {min(ratio, 1e6):.0f} times smaller than the "
            f"median {typical[k].sqrt().item():.2g}; it would weigh {min(ratio**2, 1e12):.0e} times as much as another "
            "trial; is its unit another one?"
        )
        evidence = evidence_of(("rows", float(small.sum())), ("ratio", ratio))
        return [Finding(name="uneven_covariances", sentence=sentence, evidence=evidence, mistake=False)]
    return []


def order_findings(impacts: Impacts) -> list[Finding]:
    """Times that contradict the order of the trials; a time within each recording cannot, only a common clock."""
    if impacts.time is None or len(impacts) < 3:
        return []
    time = impacts.time[impacts.order.argsort(stable=True)]
    back = (time.diff() < 0).double().mean().item()
    rank = time.argsort().argsort().double()
    agreement = torch.corrcoef(torch.stack((rank, torch.arange(len(rank), dtype=rank.dtype))))[0, 1].item()
    long = (time.max() - time.min()).item() > _SECONDS_A_TRIAL * len(time)
    if not back or not (long or abs(agreement) > _RANK_CORRELATION):
        return []
    sentence = (
        f"the trials are not in the order of their times: time runs back in {back:.0%} of steps "
        f"(rank correlation {agreement:+.2f})"
    )
    evidence = evidence_of(("back", back), ("rank_correlation", agreement))
    return [Finding(name="out_of_order", sentence=sentence, evidence=evidence, correction="ordered_by_time")]


def scale_findings(impacts: Impacts, thresholds: AuditThresholds) -> list[Finding]:
    """Gravity in free flight that is not 9.81 m/s²: the scale or the frame rate is wrong."""
    if impacts.apparatus is None:
        return []
    gravity = impacts.apparatus.gravity
    off, error = gravity.value / GRAVITY - 1, gravity.error / GRAVITY
    if abs(off) <= max(thresholds.scale_off, _APPARATUS_SIGMAS * error):
        return []
    wrong = "large" if off > 0 else "small"
    sentence = (
        f"gravity in free flight is {measured(gravity.value, gravity.error, 'm/s²')} instead of {GRAVITY} m/s²: "
        f"lengths are too {wrong} by {abs(off):.1%}, or the frame rate is by {abs((1 + off) ** 0.5 - 1):.1%}"
    )
    evidence = evidence_of(("gravity", gravity.value, "m/s²"), ("standard_error", gravity.error, "m/s²"), ("off", off))
    return [Finding(name="scale_off", sentence=sentence, evidence=evidence)]


def _outlier_findings(
    impacts: Impacts, by_reason: Mapping[str, Bool[Tensor, " n"]], thresholds: AuditThresholds
) -> list[Finding]:
    """Trials that cannot be real measurements, by reason; fatal where energy or approach forbids too many to drop."""
    reasons = {name: count for name, bad in by_reason.items() if (count := float(bad.sum()))}
    bad = torch.stack([*by_reason.values()]).any(0)
    count, share = int(bad.sum()), bad.double().mean().item()
    if not count:
        return []
    counts = ", ".join(f"{name} {n:.0f}" for name, n in reasons.items())
    first = impacts.trial[int(bad.nonzero()[0, 0])]
    sentence = (
        f"{count} of {len(impacts)} trials ({share:.1%}) cannot be real measurements ({counts}), the first is {first!r}"
    )
    few = share <= thresholds.dropped_share
    if not few:
        sentence += (
            f"; these are too many to drop unasked: what is different about them?  data.correct=[drop_outliers] keeps "
            f"the other {len(impacts) - count}"
        )
    evidence = evidence_of(
        ("trials", float(count), "trials"),
        ("share", share),
        ("first", first),
        *((reason, n, "trials") for reason, n in reasons.items()),
    )
    correction = "drop_outliers" if few else None
    mistake = share > _MAX_STRAY_SHARE
    against = [bad for name, bad in by_reason.items() if name in ("energy", "approach")]
    fatal = bool(against) and torch.stack(against).any(0).double().mean().item() > thresholds.dropped_share
    finding = Finding(name="gross_outliers", sentence=sentence, evidence=evidence, correction=correction)
    return [replace(finding, mistake=mistake, fatal=fatal)]


def gross_outliers(impacts: Impacts, thresholds: AuditThresholds = AuditThresholds()) -> dict[str, Bool[Tensor, " n"]]:
    """Find the trials that cannot be the impacts that they claim to be, by reason.

    `moment`: the residual of the moment balance is gross; `mass`: the mass or inertia is not that of the same object's
    other trials; and in the plane `energy`: the body gains too much; `approach`: the contact point does not approach
    the floor.
    """
    terms, residual = torque(impacts), _least_residual(impacts)
    before, after = kinetic_energy(impacts)
    spread = MAD_SCALE * terms.size(terms.residual).median()
    gross = residual > thresholds.moment_sigmas * spread
    inertia = impacts.inertia.reshape(len(impacts), -1).unbind(-1)
    far = (_mass_outliers(impacts, values, thresholds) for values in (impacts.mass, *inertia))
    reasons = {"moment": gross & (terms.imbalance > _IMBALANCE), "mass": torch.stack([*far]).any(0)}
    if impacts.space is SPACE:
        return reasons
    return reasons | {"energy": after > thresholds.gross_ratio * before, "approach": impacts.v_c[:, -1] >= 0}


def outliers(impacts: Impacts, thresholds: AuditThresholds = AuditThresholds()) -> Bool[Tensor, " n"]:
    """Find the gross outliers of any reason."""
    return torch.stack([*gross_outliers(impacts, thresholds).values()]).any(0)


def _least_residual(impacts: Impacts) -> Float[Tensor, " n"]:
    """|τ| / I at the given contact point or, for a polygon, at either of its two lowest corners.

    A body that lands nearly flat may touch with the other corner, for which no measurement is to blame.
    """
    terms, theta = torque(impacts), impacts.q[:, 2]
    least = terms.size(terms.residual)
    if (
        impacts.space is SPACE
        or impacts.shape is None
        or not any(isinstance(one, Polygon) for one in shapes_among(impacts.shape).values())
    ):
        return least

    def corners(shape: Shape) -> Float[Tensor, "n 4"]:
        return torch.cat(shape.lowest_corners(theta) if isinstance(shape, Polygon) else (impacts.r, impacts.r), -1)

    for r in per_body(impacts.shape, impacts.body, corners).chunk(2, -1):
        least = least.minimum(torque(impacts.replace(r=r, validate=False)).residual.abs())
    return least


def _mass_outliers(impacts: Impacts, values: Float[Tensor, " n"], thresholds: AuditThresholds) -> Bool[Tensor, " n"]:
    """Trials with a value far from its object's median; where that is common, two bodies share a name."""
    objects = numbered(impacts.object)
    unlike = torch.zeros(len(impacts), dtype=torch.bool)
    order, counts = objects.argsort(stable=True), torch.bincount(objects).tolist()
    for same in order.split(counts):
        far = (values[same] / values[same].median()).log().abs() > math.log(thresholds.gross_ratio)
        if far.sum() < _COMMON_SHARE * len(same):
            unlike[same] = far
    return unlike


def speed_findings(blocks: Iterable[Impacts]) -> list[Finding]:
    """Implausible speeds of the body, or of its contact point relative to the centre of mass, in blocks of trials."""
    trials, bad, count, fastest, seen, listed = 0, 0, 0, 0.0, list[str](), dict[str, None]()
    for impacts in blocks:
        lengths, velocities = impacts.r.norm(dim=-1), torch.stack((impacts.v_pre, impacts.v_post), 1)
        speeds = torch.stack((velocities[..., :2].norm(dim=-1), (velocities[..., 2] * lengths[:, None]).abs()), -1)
        fast = speeds > FASTEST
        fastest, count = max(fastest, speeds.max().item()), count + int(fast.sum())
        bad += int(fast.flatten(1).any(-1).sum())
        for row, when, turning in fast.nonzero()[: _LISTED - len(seen)].tolist():
            v_x, v_y, omega = velocities[row, when].tolist()
            value = f"ω = {omega:.3g} rad/s" if turning else f"|v| = {math.hypot(v_x, v_y):.3g} m/s"
            name = str(trials + row + 1)
            seen.append(f"row {name} (trial {impacts.trial[row]!r}) {value} {('before', 'after')[when]} impact")
            listed[name] = None
        trials += len(impacts)
    if not bad:
        return []
    more = f" and {count - len(seen)} more" if count > len(seen) else ""
    sentence = (
        f"speeds above {FASTEST:g} m/s, of the centre of mass or of the contact point relative to it, in "
        f"{bad} of {trials} trials: {'; '.join(seen)}{more}; are the columns' units right?"
    )
    evidence = evidence_of(("trials", float(bad), "trials"), ("fastest", fastest, "m/s"), ("rows", ", ".join(listed)))
    return [Finding(name="impossible_speeds", sentence=sentence, evidence=evidence)]


def _energy_findings(impacts: Impacts) -> list[Finding]:
    """More trials than noise explains gain energy."""
    before, after = kinetic_energy(impacts)
    share = (after > ENERGY_GAIN * before).double().mean().item()
    if share <= _GAINING_SHARE:
        return _slight_gain(after / before - 1)
    ratio = (after / before).median().item()
    sentence = (
        f"{share:.0%} of trials gain at least a quarter of their kinetic energy (median ratio "
        f"{ratio:.2f}): is the floor driven, or are speeds before contact measured too early?"
    )
    evidence = evidence_of(("share", share), ("median_ratio", ratio))
    return [Finding(name="energy_gained", sentence=sentence, evidence=evidence)]


def _slight_gain(gain: Float[Tensor, " n"]) -> list[Finding]:
    """Note that most impacts gain a little energy, more than the errors of velocities make."""
    share, n = (gain > 0).double().mean().item(), len(gain)
    middle, error = gain.median().item(), MAD_SCALE * (gain - gain.median()).abs().median().item() / math.sqrt(n)
    often = share - 0.5 > _GAIN_SIGMAS * 0.5 / math.sqrt(n)
    if not often or middle < max(_SLIGHT_GAIN, _GAIN_SIGMAS * error):
        return []
    sentence = (
        f"energy is gained in {share:.0%} of impacts, {middle:.1%} ± {error:.1%} in the median, more than the errors "
        "of the velocities: an engine that pushes bodies out of the floor, or a floor that moves"
    )
    evidence = evidence_of(("share", share), ("median_gain", middle), ("standard_error", error))
    return [Finding(name="energy_gained", sentence=sentence, evidence=evidence, mistake=False)]


def _shape_findings(impacts: Impacts, thresholds: AuditThresholds) -> list[Finding]:
    """Contact points that are not where the body's shape touches the floor at θ: of all, or of the worst body."""
    if impacts.shape is None:
        return []
    expected = contact_points(impacts.shape, impacts.body, impacts.q[:, 2])
    off, length = (impacts.r - expected).norm(dim=-1), impacts.r.norm(dim=-1)
    shapes = shapes_among(impacts.shape)
    trials = {name: impacts.body == body_code(name) if name else off >= 0 for name in shapes}
    medians = {name: (off / length)[rows].median().item() for name, rows in trials.items() if rows.any()}
    worst = max(medians, key=lambda name: medians[name])
    median, rows = medians[worst], trials[worst]
    if median <= thresholds.contact_point_off:
        return []
    ratio = (length / expected.norm(dim=-1))[rows].median().item()
    sentence = (
        f"the contact points{worst and f' of {worst!r}'} are not those of {shapes[worst]} at θ: they are {median:.0%} "
        f"of |r| off in the median ({1e3 * off[rows].median():.3g} mm; |r| is {ratio:.3g} times the shape's); is the "
        "shape in metres, and is θ measured from its axes?"
    )
    evidence = evidence_of(("off", median), ("length_ratio", ratio))
    return [Finding(name="contact_point_off_shape", sentence=sentence, evidence=evidence)]
