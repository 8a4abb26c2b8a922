"""The floor that contacts and bodies at rest share, robustly, and the refusals of contacts with something else.

heights    of contact points and of bodies at rest: on one line, whose slope is the floor's.  A zero of θ that is off by
           ζ moves contact points up and down as the body turns: y + r_y(θ + ζ) = h + x tan φ
angles     of bodies at rest: θ + ζ is that of the side they lie on, and the floor's
approach   v_n < 0 before contact and P_n > 0, or whatever was touched was no floor

Heights and angles have one scatter each, which the fit estimates with the floor (variance components, Förstner 1979):
it includes the scatter between bodies at rest, whose frames drift together.

A body is still where the means of its pose over a tenth of a second stay within the noise of a frame.  It rests on a
side that the foot of the perpendicular from its centre of mass is on, or on the flat pole of an ellipse.  On a floor
of slope φ, where gravity leans by γ, the sum of θ and the offset of its zero is then

    polygon      α + φ
    ellipse      α + γ + g (φ − γ) − δ cos(α − β) / (a²/b − b)      g = a² / (a² − b²),  a > b

where the side or pole is below at α on level ground.  An ellipse turns further than the floor, until its centre of mass
is above the contact; one that is δ off along the major axis, at β or 0, turns it to opposite sides on both poles.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.data.audit.rig import LATE, LONGEST, one_point, reshaped, root_of_mass
from contactlearn.data.recordings.flights import Indices
from contactlearn.data.recordings.poses import Array, away, displaced, orientation, turn
from contactlearn.data.recordings.result import Reason, RecordedContact, Refusal, Rest
from contactlearn.data.recordings.sufficiency import NEEDED
from contactlearn.data.recordings.thresholds import TrackThresholds
from contactlearn.data.recordings.track import Mask, Track
from contactlearn.mechanics.apparatus import REACH, Estimate
from contactlearn.mechanics.rigid_body import contact_jacobian, contact_velocity, in_world, rotation
from contactlearn.mechanics.shapes import Cornered, Cylinder, Ellipse, Polygon, Polytope, Shape, Solid, contact_point

_BLOCK = 0.1  # s
_MOVES = 1.5  # change of a block's mean in standard deviations of a frame, of a body at rest; 1 to 15 decide alike
_LASTS = 0.3  # s of a rest, at least; 0.1 to 0.3 decide alike, 0.8 finds half
_LEAST_NOISE = np.array((2e-5, 2e-5, 3e-4))  # m, m, rad: no frame of a body at rest is better
_ROUND_BODY = 1e-3  # relative difference of an ellipse's semi-axes, or change of the height with θ, of a round body


@dataclass(frozen=True, eq=False, kw_only=True)
class RestPoses:
    """Poses in which a body comes to rest.

    Args:
        angles: θ in rad on level ground, one for each stable side or pole; none of a disc.
        gain: turn of the body with the slope of the floor.
        arms: turn in rad per m by which the centre of mass is off along the major axis, at each of the angles.
    """

    angles: Float[Array, " k"]
    gain: float
    arms: Float[Array, " k"]

    @classmethod
    def of(cls, shape: Shape) -> "RestPoses":
        """Poses in which a shape comes to rest; none of one that is round or unknown."""
        match shape:
            case Polygon():
                angles = np.array(_sides(shape))
                return cls(angles=angles, gain=1.0, arms=np.zeros(len(angles)))
            case Ellipse(semi_axes=(first, second)) if abs(first / second - 1) > _ROUND_BODY:
                a, b = max(first, second), min(first, second)
                base, arm = 0.0 if first > second else math.pi / 2, b / (a**2 - b**2)
                angles = np.array((base, base + math.pi))
                return cls(angles=angles, gain=a**2 / (a**2 - b**2), arms=arm * np.array((-1.0, 1.0)))
            case _:
                return cls(angles=np.zeros(0), gain=1.0, arms=np.zeros(0))

    def nearest(self, theta: float) -> int:
        """Number of the side or pole on which a body with this θ lies."""
        return int(np.abs(turn(theta - self.angles)).argmin())

    def angle_to_rest(self, theta: float) -> float:
        """Angle in rad from there."""
        return float(turn(theta - self.angles[self.nearest(theta)]))


def _sides(shape: Polygon) -> list[float]:
    """θ at which each stable side of a polygon is below."""
    corners, angles = np.array(shape.vertices), list[float]()
    for p, q in zip(corners, np.roll(corners, -1, 0), strict=True):
        along = q - p
        if 0 < -(p @ along) < along @ along:
            out = p - along * (p @ along) / (along @ along)
            angles.append(-math.pi / 2 - math.atan2(out[1], out[0]))
    return angles


def find_rests(
    track: Track,
    spans: Sequence[tuple[float, float]],
    sigma: Float[Array, "k"],
) -> tuple[Rest, ...]:
    """Find where a body is still.

    Args:
        track: of it.
        spans: times in s of first and last frames between which to look; of each the longest rest is found.
        sigma: standard deviations of a frame's (x, y, θ).
    """
    size = max(round(_BLOCK / track.step), 2)
    fewest = max(round(_LASTS / (size * track.step)), 2)
    rests, floor_noise = list[Rest](), _LEAST_NOISE[np.arange(track.k) // track.d * 2]
    least = np.maximum(sigma, floor_noise)
    for begin, end in spans:
        frames = np.flatnonzero(track.seen & (track.time >= begin) & (track.time <= end))[::-1]
        blocks = frames[: len(frames) // size * size].reshape(-1, size)
        if not len(blocks):
            continue
        last = track.pose[frames[0]]
        means = (track.pose[blocks] if track.d == 2 else away(track.pose[blocks], last)).mean(1)
        moves = np.abs(np.diff(means, axis=0)) > _MOVES * least
        edges = np.concatenate(([0], np.flatnonzero(moves.any(1)) + 1, [len(blocks)]))
        longest = int(np.diff(edges).argmax())
        run = means[edges[longest] : edges[longest + 1]]
        if len(run) >= fewest:
            error, mean = run.std(0, ddof=1) / math.sqrt(len(run)), run.mean(0)
            pose = displaced(0 * mean if track.d == 2 else last, mean)
            rests.append(Rest(recording=track.name, pose=pose, error=np.maximum(error, floor_noise / size)))
    return tuple(rests)


_ROUNDS, _TURNS, _COMPONENTS = 10, 2, 6
_LASTING_SHARES = {"late": 0.07, "corner": 0.15}  # errors over the depth of contacts, roughly ∝ their speed
_GAP = 3e-4  # s, standard deviation that is expected between the instants at which heights and angles meet
_STEP = 1e-4  # rad, of a difference quotient
_MAX_DISTANCE = 7.5  # times the median distance: five standard deviations
_MIN_FREEDOM = 0.05  # of a contact's residual, at least, that its own leverage leaves
_MIN_SCATTER, _FIRST_SCATTER = 1e-9, 1e-4  # m or rad: of any scatter; m, of heights at first
_UPRIGHT = Estimate(value=0.0, error=0.0)
_SIDES = ("v_pre", "v_post")
_OUTLINE = ("late", "corner", "oblong", "middle_a", "middle_b", "middle_c")
_CHANGE = 0.3  # standard deviation that is expected of a corner's radius, or of `oblong`, relative to the body


@dataclass(frozen=True, kw_only=True)
class Floor:
    """The floor as contact points and bodies at rest show it.

    Args:
        height: in m at x = 0.
        slope: in rad; None where contacts are too few or in one place.
        orientation: in rad, to be added to θ; None where contacts and rests are too few or the body is round.
        outline: changes of the stated outline and its place, by the fields of `Apparatus` from `late` to `middle_b`.
        sinking: s by which contacts lie lower over v_n √(m_c/m), with the effective mass m_c there: they last.
        scatter: of the heights about it in m.
        rests: bodies at rest that it is fitted to.
        above: height of each contact point above the floor in m, all of this allowed for.
        slope_b: in rad, along y in space.
    """

    height: Estimate
    slope: Estimate | None
    orientation: Estimate | None
    outline: dict[str, Estimate]
    sinking: Estimate | None
    scatter: float
    rests: int
    above: Float[Array, " n"] = field(compare=False)
    slope_b: Estimate | None = None


def _lowest(contacts: Sequence[RecordedContact], shape: Shape, turned: float = 0.0) -> Float[Array, "n d"]:
    """Contact points in m, of a body that is turned further by an angle in rad, which is 0 in space."""
    pose = np.stack([contact.pose for contact in contacts])
    r = contact_point(shape, torch.from_numpy(orientation(pose) + turned)).numpy()
    return pose[:, : r.shape[1]] + r


def _changes(shape: Shape) -> tuple[str, ...]:
    """Names of changes of a shape that heights can show."""
    match shape:
        case Cornered() if shape.largest_corner():
            return ("corner",)
        case Ellipse(semi_axes=(a, b)) if abs(a / b - 1) > _ROUND_BODY:
            return ("oblong",)
        case _:
            return ()


def _raised(shape: Shape, name: str, theta: Array) -> Array:
    """Derivative of the height of the lowest point in a change of the shape."""
    angles, step = torch.from_numpy(theta), _STEP * float(shape.outline().norm(dim=-1).nanmean())
    other = reshaped(shape, {name: step})
    return ((contact_point(other, angles) - contact_point(shape, angles))[:, -1] / step).numpy()


def find_floor(
    contacts: Sequence[RecordedContact],
    shape: Shape,
    rests: Sequence[Rest] = (),
    *,
    lean: Estimate = _UPRIGHT,
    limits: TrackThresholds = TrackThresholds(),
) -> Floor:
    """Fit the floor to contact points and bodies at rest, robustly.

    An offset of the tracked point from the middle of the shape, round corners of a polygon, and another longer
    semi-axis of an ellipse also move the contact points up and down as the body turns.  They are fitted together with
    the body's zero of θ: where two are nearly collinear both have a large error.  So is a centre of mass that is off an
    ellipse's.  A rest that leans, or is off the floor, is left out.

    Args:
        contacts: one or more.
        shape: of the body.
        rests: of the body.
        lean: angle in rad of gravity from straight down to the right.
        limits: that decide.
    """
    lying, solid = RestPoses.of(shape), isinstance(shape, Solid)

    def leaning(rest: Rest) -> float:
        if isinstance(shape, Polytope | Cylinder):
            return _flat_below(shape, rest)[0]
        return abs(lying.angle_to_rest(float(rest.pose[2]))) if len(lying.angles) else 0.0

    used = [rest for rest in rests if leaning(rest) <= limits.leaning]
    while True:
        problem = _Problem(contacts=contacts, rests=used, shape=shape, lying=lying, lean=lean, limits=limits)
        floor, good = problem.solved(0.0, {})
        for _ in range(_TURNS):  # each about the body that the one before has found
            if solid or floor.orientation is not None:
                floor, good = problem.solved(floor.orientation.value if floor.orientation else 0.0, floor.outline)
        if solid or good.all():
            return floor
        used = [rest for rest, holds in zip(used, good, strict=True) if holds]


def _flat_below(shape: Polytope | Cylinder, rest: Rest) -> tuple[float, float]:
    """Angle in rad by which a body in space at rest leans from what is flat below it, and how far below it is in m."""
    cosines, heights = shape.flats(-rotation(torch.from_numpy(rest.pose[3:]))[2])
    upright, flat = cosines.max(-1)
    return math.acos(min(upright.item(), 1.0)), heights[flat].item()


@dataclass(frozen=True, eq=False, kw_only=True)
class _Design:
    """Least squares by named columns: heights of contacts, heights of rests, angles of rests, and a row a prior.

    Args:
        heights: right-hand side of the first two kinds of rows, in m.
        angles: that of the third, in rad; none in space.
        columns: derivatives of heights and of angles.
        priors: what is expected of a column from other measurements.
    """

    heights: Array
    angles: Array
    columns: dict[str, tuple[Array, Array | float]] = field(default_factory=dict)
    priors: dict[str, Estimate] = field(default_factory=dict)

    def expect(self, error: float, *names: str, about: Mapping[str, float] = {}) -> None:
        """Expect columns about 0, less what was done of them already, with a standard deviation."""
        self.priors.update({name: Estimate(value=-about.get(name, 0.0), error=error) for name in names})

    def solved(
        self, used: Mask, within: tuple[float, float]
    ) -> tuple[dict[str, Estimate], float, Float[Array, " contacts"], list[Mask]]:
        """Solve robustly: estimates by column, the scatter of contacts, their heights above the fit, and good rows.

        Args:
            used: contacts that take part, of all.
            within: scatter within bodies at rest, of heights and of angles.
        """
        errors = [max(one.error, _MIN_SCATTER) for one in self.priors.values()]
        matrix = np.stack(
            [
                np.concatenate(
                    (
                        heights,
                        np.broadcast_to(angles, len(self.angles)),
                        [(other == name) / error for other, error in zip(self.priors, errors, strict=True)],
                    )
                )
                for name, (heights, angles) in self.columns.items()
            ],
            1,
        )
        wanted = [one.value / error for one, error in zip(self.priors.values(), errors, strict=True)]
        value = np.concatenate((self.heights, self.angles, wanted))
        hits, rests = len(used), len(self.heights) - len(used)
        kinds: list[Indices] = np.split(np.arange(len(value)), np.cumsum((hits, rests, len(self.angles))))
        contacts, kinds[0] = kinds[0], kinds[0][used]
        good = _near(matrix, value, kinds, within[1])
        fit, deviations, scatter = _weighted(matrix, value, [rows[good[rows]] for rows in kinds], within)
        estimates = {
            name: Estimate(value=float(x), error=float(error))
            for name, x, error in zip(self.columns, fit, deviations, strict=True)
        }
        return estimates, scatter, (value - matrix @ fit)[contacts], [good[rows] for rows in kinds]


def _speeds(contacts: Sequence[RecordedContact], points: Float[Array, "n d"]) -> tuple[Array, Tensor, Tensor]:
    """v_n √(m_c/m) of contacts, by which they sink in, and the velocities before and after them."""
    v, w = (torch.from_numpy(np.stack([getattr(hit, name) for hit in contacts])) for name in _SIDES)
    r = torch.from_numpy(points - [hit.pose[: points.shape[1]] for hit in contacts])
    return (root_of_mass(r, v, w) * contact_velocity(r, v)[:, -1]).numpy(), v, w


@dataclass(frozen=True, eq=False, kw_only=True)
class _Problem:
    """The floor, from contacts and bodies at rest."""

    contacts: Sequence[RecordedContact]
    rests: Sequence[Rest]
    shape: Shape
    lying: RestPoses
    lean: Estimate
    limits: TrackThresholds

    def solved(self, turned: float, outline: Mapping[str, Estimate]) -> tuple[Floor, Mask]:
        """The floor, and which rests are on it.

        It is linearised about a body of such an outline that is turned further by an angle in rad, 0 in space.
        """
        change = {name: outline[name].value for name in _changes(self.shape) if name in outline}
        rests, solid = self.rests, isinstance(self.shape, Solid)
        design = self._design_in_space(change) if solid else self._design(turned, change)
        spread = np.sqrt(np.mean([rest.error**2 for rest in rests], axis=0)) if rests else np.zeros(3)
        within = float(spread[2 if solid else 1]), float(spread[2])  # of heights, and of θ in the plane
        estimates, scatter, above, (_, on_floor, flat, _) = design.solved(self._single(turned), within)
        for name, one in estimates.items():
            estimates[name] = replace(one, value=one.value + change.get(name, 0.0))
            if name.startswith("slope"):
                estimates[name] = Estimate(value=math.atan(one.value), error=one.error / (1 + one.value**2))
        zero, sinking = (estimates.get(name) for name in ("orientation", "sinking"))
        if solid and isinstance(self.shape, Cornered) and "corner" in estimates:  # no radius is less than 0
            estimates["corner"] = replace(estimates["corner"], value=max(estimates["corner"].value, -self.shape.corner))
        depth = abs(sinking.value) if sinking and not solid else 0.0
        for name in _LASTING_SHARES.keys() & estimates.keys():  # what the course of the force in a lasting contact adds
            typical = abs(float(np.median(design.columns["sinking"][0][: len(self.contacts)]))) if depth else 0.0
            speed = 1.0 if name == "late" else typical
            estimates[name] = replace(
                estimates[name], error=math.hypot(estimates[name].error, _LASTING_SHARES[name] * depth * speed)
            )
        floor = Floor(
            height=estimates["height"],
            slope=estimates.get("slope"),
            slope_b=estimates.get("slope_b"),
            orientation=zero and replace(zero, value=turned + zero.value),
            outline={name: estimates[name] for name in _OUTLINE if name in estimates},
            sinking=sinking,
            scatter=scatter,
            rests=int(on_floor.sum()),
            above=above,
        )
        return floor, on_floor & flat if len(flat) else on_floor

    def _single(self, turned: float) -> Mask:
        """Contacts of one point; all of them where these are too few to show the floor."""
        pose, v, w = (torch.from_numpy(np.stack([getattr(hit, n) for hit in self.contacts])) for n in ("pose", *_SIDES))
        single = one_point(self.shape, pose[:, 2] + turned, v, w).numpy()
        return single if single.sum() >= NEEDED.heights_of_slope else np.ones_like(single)

    def _design(self, turned: float, change: Mapping[str, float]) -> _Design:
        """Heights and angles of a body of such an outline that is turned further by an angle in rad."""
        shape, lying, contacts, limits = reshaped(self.shape, change), self.lying, self.contacts, self.limits
        size = float(shape.outline().norm(dim=-1).mean()) / 2**0.5
        points, theta = _lowest(contacts, shape, turned), np.array([hit.pose[2] for hit in contacts])
        rest = np.reshape([rest.pose for rest in self.rests], (-1, 3))
        side = [lying.nearest(angle) for angle in rest[:, 2].tolist()] if len(lying.angles) else []
        lies, none = lying.angles[side] if len(lying.angles) else rest[:, 2], np.zeros(len(rest))
        down = contact_point(shape, torch.from_numpy(lies))[:, 1].numpy()
        x, y = np.append(points[:, 0], rest[:, 0]), np.append(points[:, 1], rest[:, 1] + down)
        higher, lower = (_lowest(contacts, shape, turned + step)[:, 1] for step in (_STEP, -_STEP))
        rising = (higher - lower) / (2 * _STEP)  # of contact points as the body turns, in m/rad

        # Angles of rests show the zero of θ beside a slope; on one pole of an ellipse its centre of mass may be off.
        by_angle = len(side) >= limits.contacts_of_a_slope // 2 and len(x) >= limits.contacts_of_a_slope
        by_angle = by_angle and np.ptp(x) > 0 and (lying.gain == 1 or len(set(side)) > 1)
        by_height = len(theta) >= 2 * limits.contacts_of_a_slope and np.std(rising) > _ROUND_BODY * size
        off = turn(rest[:, 2] + turned - lies)[: len(side) if by_angle else 0]
        design = _Design(heights=y, angles=off)
        columns = design.columns
        columns["height"] = np.ones(len(x)), 0.0
        if len(x) >= NEEDED.heights_of_slope and np.ptp(x) > 0:
            columns["slope"] = x, lying.gain
        if len(rest):  # bodies at rest do not sink in as contacts do
            columns["raised"] = np.repeat((0.0, 1.0), (len(theta), len(rest))), 0.0
            design.expect(limits.off_least, "raised")
        if by_angle or by_height:
            columns["orientation"] = np.append(-rising, none), -1.0
        if by_height:
            angles = np.append(theta + turned, lies)
            columns |= {"middle_a": (-np.sin(angles), 0.0), "middle_b": (-np.cos(angles), 0.0)}
            speeds, v, w = _speeds(contacts, points)
            if np.ptp(speeds) > 0:
                columns["sinking"] = np.append(speeds, none), 0.0
                design.expect(LONGEST, "sinking")
            # A frame's angle is that of another instant than its position, and flights may meet in θ at a third one.
            for name, spin in {"late": (v + w)[:, 2].numpy() / 2, "gap": (w - v)[:, 2].numpy()}.items():
                columns[name] = np.append(-rising * spin, none), 0.0
            columns |= {name: (-_raised(shape, name, angles), 0.0) for name in _changes(shape)}
            design.expect(LATE, "late")
            design.expect(_GAP, "gap")
            design.expect(size, "middle_a", "middle_b")
            design.expect(_CHANGE * size, *_changes(shape), about=change)
        if by_angle and lying.gain != 1:  # an ellipse turns with its centre of mass, and with gravity that leans
            columns |= {"com_offset_major": (0 * x, lying.arms[side]), "lean": (0 * x, 1 - lying.gain)}
            design.expect(size, "com_offset_major")
            design.priors["lean"] = self.lean
        return design

    def _design_in_space(self, change: Mapping[str, float]) -> _Design:
        """Heights of a body in space of such an outline."""
        shape, contacts, limits = self.shape, self.contacts, self.limits
        changed, hits, none = (
            reshaped(shape, change),
            np.stack([hit.pose for hit in contacts]),
            np.zeros(len(self.rests)),
        )
        size, still = (
            float(shape.outline().norm(dim=-1).nanmean()),
            np.reshape([one.pose for one in self.rests], (-1, 7)),
        )
        if isinstance(shape, Polytope | Cylinder):
            down = -np.array([_flat_below(shape, rest)[1] for rest in self.rests])
        else:
            down = contact_point(shape, torch.from_numpy(still[:, 3:]))[:, 2].numpy()
        points, pose = _lowest(contacts, changed), np.concatenate((hits, still))
        x, y, _ = np.concatenate((points, still[:, :3])).T
        design = _Design(heights=np.concatenate((points[:, 2], still[:, 2] + down)), angles=np.zeros(0))
        heights = {"height": np.ones(len(x))}
        if len(contacts) > NEEDED.heights_of_slope:
            heights |= {"slope": x, "slope_b": y}
        if len(still):  # bodies at rest do not sink in as contacts do
            heights["raised"] = np.repeat((0.0, 1.0), (len(contacts), len(still)))
            design.expect(limits.off_least, "raised")
        if len(contacts) >= 2 * limits.contacts_of_a_slope:
            up = rotation(torch.from_numpy(pose[:, 3:]))[:, 2].numpy()
            heights |= {f"middle_{axis}": -up[:, k] for k, axis in enumerate("abc")}
            speeds, *_ = _speeds(contacts, points)
            heights["sinking"] = np.append(speeds, none)
            heights |= {name: np.append(-_raised(changed, name, hits[:, 3:]), none) for name in _changes(shape)}
            design.expect(size, "middle_a", "middle_b", "middle_c")
            design.expect(_CHANGE * size, *_changes(shape), about=change)
        design.columns.update({name: (column, 0.0) for name, column in heights.items()})
        return design


def _near(design: Array, value: Array, kinds: Sequence[Indices], within: float) -> Mask:
    """Rows that are near the fit of least absolute deviations; prior rows always are."""
    hits, rests, angles, _ = kinds
    weight, good, off = np.zeros(len(value)), np.ones(len(value), dtype=np.bool_), value.copy()
    weight[np.concatenate(kinds)] = 1.0
    for rows in (np.append(hits, rests), angles):
        off[rows] -= np.median(value[rows]) if len(rows) else 0.0
    for k in range(_ROUNDS + 1):
        away = np.abs(off)
        for rows, shown, least in (
            (np.append(hits, rests), hits, _MIN_SCATTER),
            (angles, angles, within + _MIN_SCATTER),
        ):
            middle = max(_middle(away[shown], design[shown]), least)
            weight[rows] = 1 / (middle * (np.maximum(away[rows], middle / 10) if k else middle))
            good[rows] = away[rows] <= _MAX_DISTANCE * middle
        if k < _ROUNDS:
            fit = np.linalg.lstsq(design * weight[:, None] ** 0.5, value * weight**0.5, rcond=None)[0]
            off = value - design @ fit
    return good


def _middle(away: Array, design: Array) -> float:
    """Median distance of rows, without one for each parameter that only these rows determine: those may be 0."""
    if not len(away):
        return 0.0
    fitted = min(int((np.ptp(design, axis=0) > 0).sum()) + 1, len(away) - 1)
    return float(np.sort(away)[fitted + (len(away) - fitted - 1) // 2])


def _weighted(
    design: Array, value: Array, kinds: Sequence[Indices], within: tuple[float, float]
) -> tuple[Array, Array, float]:
    """Fit, its errors and the scatter of contacts, each kind of row with the scatter that it shows.

    Some contacts scatter more than others, and not at random among the columns: errors follow from their own residuals
    (MacKinnon and White 1985, HC3).  `within` is the scatter within bodies at rest, of heights and of angles.
    """
    hits, rests, angles, _ = kinds
    sigma, spread, lies, turns = np.ones(len(value)), _FIRST_SCATTER, _FIRST_SCATTER, max(within[1], _MIN_SCATTER)
    rows, fit, errors = np.concatenate(kinds), np.zeros(0), np.zeros(0)
    uneven = np.ones(len(value))
    for _ in range(_COMPONENTS):
        sigma[hits], sigma[rests], sigma[angles] = spread, lies, turns
        scaled = design / sigma[:, None]
        size = np.linalg.norm(scaled[rows], axis=0)
        inverse = np.linalg.pinv(scaled[rows].T @ scaled[rows] / np.outer(size, size), hermitian=True)
        inverse = inverse / np.outer(size, size)
        fit, toward = inverse @ scaled[rows].T @ (value / sigma)[rows], scaled @ inverse
        squares, free = (value - design @ fit) ** 2, 1 - (toward * scaled).sum(1)
        uneven[hits] = squares[hits] / (sigma * np.maximum(free, _MIN_FREEDOM))[hits] ** 2
        errors = np.sqrt((uneven[:, None] * toward**2)[rows].sum(0))
        spread = max(float(squares[hits].sum() / max(free[hits].sum(), 1.0)) ** 0.5, _MIN_SCATTER)
        lies = _between(squares[rests], free[rests], within[0]) if len(rests) >= NEEDED.rests_of_scatter else spread
        turns = _between(squares[angles], free[angles], within[1])
    return fit, errors, spread


def _between(squares: Array, free: Array, within: float) -> float:
    """Scatter of bodies at rest: within one, and between them, which a few bodies show poorly."""
    beyond = float(squares.sum() - within**2 * free.sum()) / max(float(free.sum()) - 2, 1.0)
    return max(within**2 + max(beyond, 0.0), _MIN_SCATTER**2) ** 0.5


def off_the_floor(
    contacts: Sequence[RecordedContact],
    shape: Shape,
    floor: Floor,
    limits: TrackThresholds = TrackThresholds(),
    *,
    longest: float = 0.0,
) -> tuple[list[RecordedContact], list[Refusal]]:
    """Contacts with the floor, and refusals of those with a hand or a wall, or with several corners.

    Another corner may share the impulse if it comes down to the floor within the `longest` contact, in s.
    """
    kept, refusals = [], []
    points = _lowest(contacts, shape)
    d = points.shape[1]
    r = points - np.stack([contact.pose[:d] for contact in contacts])
    before = torch.from_numpy(np.stack([contact.v_pre for contact in contacts]))
    approach = contact_velocity(torch.from_numpy(r), before)[:, d - 1].numpy()
    clearances = _clearance(contacts, shape, floor, longest)
    for contact, above, v_n, clearance in zip(contacts, floor.above.tolist(), approach, clearances, strict=True):
        push = float(contact.v_post[d - 1] - contact.v_pre[d - 1])
        for holds, quantity, value, unit in (
            (
                abs(above) > max(limits.off_sigmas * floor.scatter, limits.off_least),
                "height of the contact above the floor",
                1e3 * above,
                "mm",
            ),
            (v_n >= 0, "normal velocity of the contact point", float(v_n), "m/s"),
            (push <= 0, "change of the upward velocity", push, "m/s"),
            (
                clearance <= 0,
                "height of another corner over what its error and the contact's duration allow",
                1e3 * clearance,
                "mm",
            ),
        ):
            if holds:
                refusal = Refusal(
                    recording=contact.recording,
                    reason=Reason.HAND_OR_WALL if clearance > 0 else Reason.SECOND_CORNER,
                    quantity=quantity,
                    value=value,
                    unit=unit,
                    time=(contact.time, contact.time),
                )
                refusals.append(refusal)
                break
        else:
            kept.append(contact)
    return kept, refusals


def _clearance(contacts: Sequence[RecordedContact], shape: Shape, floor: Floor, longest: float) -> Float[Array, " n"]:
    """Least height in m of another corner, or its arc, less three errors and its way down in the longest contact.

    Those of a cylinder are the lowest points of its rims, and the point of the lower rim opposite to that.
    """
    if not isinstance(shape, Polygon | Polytope | Cylinder):
        return np.full(len(contacts), np.inf)
    names = ("pose", "v_pre", "covariance")
    pose, v, errors = (torch.from_numpy(np.stack([getattr(hit, name) for hit in contacts])) for name in names)
    D = v.shape[1]
    if D == 3:
        pose[:, 2] += _sure(floor.orientation) - _sure(floor.slope)  # about the floor
    if isinstance(shape, Cylinder):
        places = shape.touching(-rotation(pose[:, 3:])[:, 2])
    else:
        places = shape.corners() + shape.corner * shape.arc_centres()
    corners = in_world(places, pose[:, None])
    order, d = corners[..., -1].argsort(1), corners.shape[-1]
    lowest, corners = corners.gather(1, order[..., None].expand_as(corners)).tensor_split([1], 1)
    offsets = corners - lowest
    lean = contact_jacobian(offsets)[..., -1, d:]  # of a height in small turns
    error = torch.einsum("nci,nij,ncj->nc", lean, errors[:, 2 * D + d : 3 * D, 2 * D + d : 3 * D], lean).sqrt()
    sinks = -contact_velocity(corners, v[:, None])[..., -1]
    return (offsets[..., -1] - REACH * error - sinks.clamp_min(0) * longest).amin(1).numpy()


def _sure(angle: Estimate | None) -> float:
    """An angle in rad that is more than three of its errors; else 0."""
    return angle.value if angle is not None and abs(angle.value) > REACH * angle.error else 0.0
