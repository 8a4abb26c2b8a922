"""Named corrections of measurements: each a pure function from impacts to impacts, requested by name.

    data.correct=[mirrored_x]              corrections in the order in which they are applied
    correct(impacts, ["mirrored_x"])       the same as a call

A finding of the audit names the correction that undoes the mistake.  A correction is made only on request,
and the source of the corrected impacts names it.  Most corrections are their own inverse (a mirror, a swap); those of
units are factors.  Estimates of the apparatus are transformed with the axes, and dropped where they make no sense in
others.  Some are estimated from the data: the factor on the moment of inertia, the angle of the floor, the shape, spins
that were not measured, and which trials are duplicates or gross outliers.

Rows with an empty cell never become impacts: `drop_incomplete` leaves them out as a table is read.
Trials that gain energy have no correction: to drop them is to choose by the outcome, which biases every ε.
A column swap of x and y leaves θ and ω as they are; axes that are turned by 90° are a swap and a mirror.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from typing import cast

import torch
from jaxtyping import Bool
from torch import Tensor

from contactlearn.core.errors import DataError, UnknownNameError
from contactlearn.data.audit.incline import floor_angle, levelled
from contactlearn.data.audit.moments import Columns, spin_turn, torque, tracked_point
from contactlearn.data.audit.moving_floor import moving_floor, on_still_floor
from contactlearn.data.audit.outline import with_traced_shape
from contactlearn.data.audit.rig import as_measured
from contactlearn.data.audit.thresholds import AuditThresholds
from contactlearn.data.audit.trials import named_by_mass, outliers, repeated, saturated
from contactlearn.data.audit.units import MISWRITTEN, Miswritten
from contactlearn.mechanics.apparatus import Apparatus
from contactlearn.mechanics.bodies import contact_points, per_body, shapes_among
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import (
    contact_jacobian,
    in_world,
    orientation_of,
    rotation,
    turn_quaternion,
)
from contactlearn.mechanics.shapes import scaled
from contactlearn.mechanics.space import BOTH, PLANE, SPACE, Space, require_space

_POSES, _VELOCITIES = ("q", "q_post"), ("v_pre", "v_post")
_FOLLOWS = 1e-4  # relative difference up to which r or I are those of the stated shape, from which they were computed
_ONE_TIME = {"": ("v_pre", "v_post"), "_pre": ("v_pre",), "_post": ("v_post",)}
_WHEN = {"": "", "_pre": " before impact", "_post": " after impact"}


@dataclass(frozen=True)
class Correction:
    """A mistake in the data, and the function that undoes it.

    Args:
        description: the mistake, for the user.
        function: undoes it; only `drop_outliers` uses the limits of outliers, which every function takes.
        apparatus: transforms the estimates of the apparatus.
        needs_all_trials: whether all trials must be in memory; otherwise blocks are corrected one by one.
        spaces: in which it exists.
    """

    description: str
    function: Callable[[Impacts, AuditThresholds], Impacts]
    apparatus: Callable[[Apparatus], Apparatus] = lambda apparatus: apparatus
    needs_all_trials: bool = False
    spaces: tuple[Space, ...] = BOTH


def correct(
    impacts: Impacts,
    names: Sequence[str],
    thresholds: AuditThresholds = AuditThresholds(),
    *,
    computed_contact: bool = False,
) -> Impacts:
    """Apply the named corrections in this order; the source of the result names them.

    Impacts that are not validated stay so; the others are validated in full after the last correction.

    Args:
        impacts: measurements.
        names: of `CORRECTIONS`.
        thresholds: limits of the outliers that `drop_outliers` drops.
        computed_contact: whether r was computed from shape and θ, and is so again after each correction.

    Raises:
        UnknownNameError: no such correction.
        DataError: names that are not a list, a correction that the data does not allow, or impacts
            that break a rule once corrected.
    """
    if isinstance(names, str):
        raise DataError(f"corrections must be a list of names, such as [{names}], got {names!r}")
    for name in names:
        if name not in CORRECTIONS:
            raise UnknownNameError("correction", str(name), CORRECTIONS)
    if not names:
        return impacts
    corrected = impacts.replace(validate=False)
    for name in names:
        require_space(f"correction {name}", impacts.space, CORRECTIONS[name].spaces)
        corrected = CORRECTIONS[name].function(corrected, thresholds)
        if computed_contact and corrected.shape is not None:
            corrected = corrected.replace(
                r=contact_points(corrected.shape, corrected.body, orientation_of(corrected.q))
            )
        if corrected.apparatus is not None:
            corrected = corrected.replace(apparatus=CORRECTIONS[name].apparatus(corrected.apparatus))
    return corrected.replace(validate=impacts.validate, source=f"{impacts.source} (corrected: {', '.join(names)})")


def units_and_axes(columns: Columns, name: str) -> Columns:
    """Apply a correction of units or axes to the columns of many hypotheses at once; the function is the same."""
    return cast("Callable[[Columns, AuditThresholds], Columns]", CORRECTIONS[name].function)(columns, AuditThresholds())


def _covariances(impacts: Impacts | Columns) -> list[tuple[str, Tensor]]:
    """The velocities whose errors are known, and their covariances; none of hypotheses."""
    if isinstance(impacts, Columns):
        return []
    return [(name, x) for name in _VELOCITIES if (x := getattr(impacts, f"{name}_cov")) is not None]


def _mapped(impacts: Impacts, A: Tensor, names: Sequence[str] = _VELOCITIES) -> Impacts:
    """Impacts with velocities A v and their covariances A C Aᵀ."""
    fields = {name: (getattr(impacts, name)[..., None, :] @ A.mT)[..., 0, :] for name in names}
    fields |= {f"{name}_cov": A @ x @ A.mT for name, x in _covariances(impacts) if name in names}
    return impacts.replace(**fields)


def _scaled(*groups: tuple[Sequence[float], Sequence[str]]) -> Callable[[Impacts, AuditThresholds], Impacts]:
    """A correction that multiplies groups of fields component by component, and their covariances with them."""

    def scale(impacts: Impacts, _: AuditThresholds) -> Impacts:
        for factors, names in groups:
            impacts = _multiplied(impacts, factors, names)
        return impacts

    return scale


def _multiplied(impacts: Impacts, factors: Sequence[float], names: Sequence[str]) -> Impacts:
    """Impacts with fields multiplied component by component, and their covariances with them."""
    factor = torch.tensor(factors, dtype=torch.float64)
    product = factor[:, None] * factor
    fields = {name: x * factor for name in names if (x := getattr(impacts, name)) is not None}
    fields |= {f"{name}_cov": x * product for name, x in _covariances(impacts) if name in names}
    return impacts.replace(**fields)


def _written(unit: Miswritten) -> Correction:
    """The correction that converts columns from another unit."""
    if "mass" in unit.columns:
        return Correction(unit.words, lambda impacts, _: impacts.replace(mass=impacts.mass * unit.factor))
    if "shape" in unit.columns:
        return Correction(unit.words, lambda impacts, _: _resized(impacts, unit.factor), Apparatus.without_outline)
    apparatus = lambda rig: rig.from_length(unit.factor) if "place" in unit.columns else rig  # noqa: E731
    if "theta" in unit.columns:
        return _with_contact(Correction(unit.words, _converted(unit), _forget("orientation"), spaces=(PLANE,)))
    written = Correction(unit.words, _converted(unit), apparatus)
    return _with_contact(written) if "place" in unit.columns else written


def _converted(unit: Miswritten) -> Callable[[Impacts, AuditThresholds], Impacts]:
    """Multiply the columns of a unit; θ is an angle in the plane alone, a quaternion has no unit."""

    def convert(impacts: Impacts, _: AuditThresholds) -> Impacts:
        d, D = impacts.space.d, impacts.space.D
        turn = ("theta",) if impacts.space is PLANE else ("quaternion",) * 4
        columns = {"q": ("place",) * d + turn, "q_post": ("place",) * d + turn, "r": ("place",) * d}
        columns |= {f"v_{time}": (f"velocity_{time}",) * d + (f"omega_{time}",) * (D - d) for time in ("pre", "post")}
        for field, each in columns.items():
            if set(each).intersection(unit.columns):
                factors = [unit.factor if column in unit.columns else 1.0 for column in each]
                impacts = _multiplied(impacts, factors, (field,))
        return impacts

    return convert


def _resized(impacts: Impacts, factor: float) -> Impacts:
    """Impacts of bodies of another size; r, y and the inertia follow where the stated shape gave them.

    Raises:
        DataError: no shape is stated.
    """
    if impacts.shape is None:
        raise DataError(f"{impacts.source}: no shape is stated whose unit could be wrong")
    shapes = {name: scaled(shape, factor) for name, shape in shapes_among(impacts.shape).items()}
    expected = contact_points(impacts.shape, impacts.body, orientation_of(impacts.q))
    uniform = per_body(impacts.shape, impacts.body, lambda one: impacts.mass[:, None] * one.gyration_squared())[:, 0]
    follows = (impacts.r - expected).norm() <= _FOLLOWS * expected.norm()
    computed = (impacts.inertia - uniform).abs().max() <= _FOLLOWS * uniform.max()
    up, q = impacts.space.d - 1, impacts.q.clone()
    if (q[:, up] + expected[:, up]).norm() <= _FOLLOWS * expected.norm():
        q[:, up] *= factor
    return impacts.replace(
        shape=shapes.get("", shapes),
        r=impacts.r * factor if follows else impacts.r,
        q=q,
        inertia=impacts.inertia * factor**2 if computed else impacts.inertia,
    )


def _inclined_floor(impacts: Impacts, _: AuditThresholds) -> Impacts:
    angle = floor_angle(impacts)
    if angle is None:
        raise DataError(f"{impacts.source}: no turn of the axes balances the moments")
    return levelled(impacts, angle.value)


def _spin_from_moments(impacts: Impacts, _: AuditThresholds) -> Impacts:
    terms = torque(impacts)
    v_pre, v_post = impacts.v_pre.clone(), impacts.v_post.clone()
    v_pre[:, 2], v_post[:, 2] = 0.0, terms.normal + terms.tangential
    return impacts.replace(v_pre=v_pre, v_post=v_post)


def _normal_alone(impacts: Impacts, _: AuditThresholds) -> Impacts:
    along = torch.tensor((0.0, 1.0, 0.0)).to(impacts.mass)
    return impacts.replace(v_pre=impacts.v_pre * along, v_post=impacts.v_post * along)


def _swapped_axes(impacts: Impacts, _: AuditThresholds) -> Impacts:
    fields = {name: x for name in (*_POSES, *_VELOCITIES) if (x := getattr(impacts, name)) is not None}
    order = [1, 0, 2]
    turned = {f"{name}_cov": x[:, order][:, :, order] for name, x in _covariances(impacts)}
    return impacts.replace(r=impacts.r.flip(-1), **{name: x[..., order] for name, x in fields.items()}, **turned)


def _swapped_pre_post(impacts: Impacts, _: AuditThresholds) -> Impacts:
    known = dict(_covariances(impacts))
    errors = {"v_pre_cov": known.get("v_post"), "v_post_cov": known.get("v_pre")} if known else {}
    swapped = impacts.replace(v_pre=impacts.v_post, v_post=impacts.v_pre, **errors)
    return swapped if impacts.q_post is None else swapped.replace(q=impacts.q_post, q_post=impacts.q)


def _turned_approach(impacts: Impacts, _: AuditThresholds) -> Impacts:
    d, D = impacts.space.d, impacts.space.D
    return _multiplied(impacts, [-1.0 if k == d - 1 else 1.0 for k in range(D)], ("v_pre",))


def _inertia_scaled(impacts: Impacts, _: AuditThresholds) -> Impacts:
    factor = torque(impacts).inertia_factor.item()
    if not 0 < factor < math.inf:
        raise DataError(
            f"{impacts.source}: no positive moment of inertia balances the moments; correct the signs first"
        )
    return impacts.replace(inertia=impacts.inertia * factor)


def _of_mass_centre(impacts: Impacts, _: AuditThresholds) -> Impacts:
    d, D = impacts.space.d, impacts.space.D
    arm = in_world(tracked_point(impacts).expand(len(impacts), d), impacts.q)
    still = torch.eye(D, dtype=torch.float64).expand(len(impacts), D, D)
    return _mapped(impacts, torch.cat((2 * still[:, :d] - contact_jacobian(arm), still[:, d:]), -2))


def _turned_spin(impacts: Impacts, thresholds: AuditThresholds) -> Impacts:
    turn = spin_turn(impacts)
    return _other_spin(lambda q: turn.expand(*q.shape[:-1], 3, 3))(impacts, thresholds)


# --- Space -----------------------------------------------------------------------------------------


def _turn(by: Tensor) -> Tensor:
    """Rotation matrix of quarter turns, by a vector in rad."""
    return rotation(turn_quaternion(torch.eye(4, dtype=torch.float64)[0], by)).round()


def _turned_axes(*vector: float, with_body: bool) -> Callable[[Impacts, AuditThresholds], Impacts]:
    """A correction to axes with z up, by a turn about a vector in rad, of the body's axes too or not."""

    def turned(impacts: Impacts, _: AuditThresholds) -> Impacts:
        by = torch.tensor(vector, dtype=torch.float64)
        turn = _turn(by)

        def quaternion(q: Tensor) -> Tensor:
            return torch.cat((q[..., :1], q[..., 1:] @ turn.T), -1) if with_body else turn_quaternion(q, by)

        fields = {
            name: torch.cat((x[..., :3] @ turn.T, quaternion(x[..., 3:])), -1)
            for name in _POSES
            if (x := getattr(impacts, name)) is not None
        }
        return _mapped(impacts, torch.block_diag(turn, turn)).replace(r=impacts.r @ turn.T, **fields)

    return turned


def _other_spin(axes: Callable[[Tensor], Tensor], time: str = "") -> Callable[[Impacts, AuditThresholds], Impacts]:
    """A correction of the axes of the spin, at both times or one: the columns of a matrix for each quaternion."""

    def corrected(impacts: Impacts, _: AuditThresholds) -> Impacts:
        columns = axes(impacts.q[..., 3:])
        both = torch.eye(6).to(columns).repeat(*columns.shape[:-2], 1, 1)
        both[..., 3:, 3:] = columns
        return _mapped(impacts, both, _ONE_TIME[time])

    return corrected


def _standing(*vector: float) -> Callable[[Tensor], Tensor]:
    """The axes of the world, turned about a vector in rad."""
    turn = _turn(torch.tensor(vector, dtype=torch.float64))
    return lambda q: turn.expand(*q.shape[:-1], 3, 3)


def _rates_of_angles(q: Tensor) -> Tensor:
    """The axes about which a body turns by roll, pitch and yaw, in world axes: those of z, of y and of x in turn."""
    R = rotation(q)
    yaw = torch.atan2(R[..., 1, 0], R[..., 0, 0])
    pitch = torch.stack((-yaw.sin(), yaw.cos(), 0 * yaw), -1)
    return torch.stack((R[..., 0], pitch, torch.eye(3).to(R)[2].expand_as(pitch)), -1)


def _other_quaternion(change: Callable[[Tensor], Tensor]) -> Callable[[Impacts, AuditThresholds], Impacts]:
    """A correction of what the four numbers of a quaternion mean."""

    def corrected(impacts: Impacts, _: AuditThresholds) -> Impacts:
        fields = {
            name: torch.cat((x[..., :3], change(x[..., 3:])), -1)
            for name in _POSES
            if (x := getattr(impacts, name)) is not None
        }
        return impacts.replace(**fields)

    return corrected


def _contact_in_body_axes(impacts: Impacts, _: AuditThresholds) -> Impacts:
    return impacts.replace(r=in_world(impacts.r, impacts.q))


def _mirrored(axis: int) -> Callable[[Impacts, AuditThresholds], Impacts]:
    """A correction that turns an axis of places, velocities and contact points; spins and quaternions stay."""
    signs = [-1.0 if k == axis else 1.0 for k in range(3)]
    return _scaled(((*signs, 1, 1, 1, 1), _POSES), ((*signs, 1, 1, 1), _VELOCITIES), (signs, ("r",)))


def _mirrored_spin(axis: int) -> Callable[[Impacts, AuditThresholds], Impacts]:
    """A correction that turns an axis of the spin alone."""
    return _scaled(((1, 1, 1, *(-1.0 if k == axis else 1.0 for k in range(3))), _VELOCITIES))


def _permuted(*axes: int) -> Callable[[Impacts, AuditThresholds], Impacts]:
    return lambda impacts, _: impacts.replace(inertia=impacts.inertia[..., axes])


def _turned_theta(quarters: int) -> Callable[[Impacts, AuditThresholds], Impacts]:
    """A correction of the axis that θ is measured from, by so many quarters of a turn."""

    def turned(impacts: Impacts, _: AuditThresholds) -> Impacts:
        turn = torch.tensor((0.0, 0.0, quarters * math.pi / 2), dtype=torch.float64)
        return impacts.replace(**{name: x + turn for name in _POSES if (x := getattr(impacts, name)) is not None})

    return turned


def _with_contact(one: Correction) -> Correction:
    """A correction of axes, θ or positions; contact points that were computed from the shape are so again after it."""

    def corrected(impacts: Impacts, thresholds: AuditThresholds) -> Impacts:
        after = one.function(impacts, thresholds)
        shape = impacts.shape
        if shape is None:
            return after
        before, now = (contact_points(shape, one.body, orientation_of(one.q)) for one in (impacts, after))
        rounding = _FOLLOWS * before.norm(dim=(-2, -1))
        off, moved = ((one - before).norm(dim=(-2, -1)) for one in (impacts.r, now))
        follows, moves = (off <= rounding)[..., None, None], (moved > rounding)[..., None, None]
        return after.replace(r=torch.where(follows, torch.where(moves, now, impacts.r), after.r))

    return replace(one, function=corrected)


_IN_PLANE = {
    "mirrored_y": Correction(
        "y points down: positions, velocities and the contact point",
        _scaled(((1, -1, 1), (*_POSES, *_VELOCITIES)), ((1, -1), ("r",))),
        Apparatus.with_y_mirrored,
    ),
    "mirrored_vy": Correction("v_y has the other sign, before and after impact", _scaled(((1, -1, 1), _VELOCITIES))),
    "swapped_axes": Correction(
        "x and y are exchanged: positions, velocities, contact point",
        _swapped_axes,
        lambda rig: rig.without("slope", "orientation"),
    ),
    "mirrored_x": Correction(
        "x points left in positions and velocities, but not in θ, ω and the contact point, or θ and ω are clockwise",
        _scaled(((-1, 1, 1), (*_POSES, *_VELOCITIES))),
        Apparatus.with_x_mirrored,
    ),
    "mirrored_theta": Correction(
        "θ and ω are positive clockwise",
        _scaled(((1, 1, -1), (*_POSES, *_VELOCITIES))),
        Apparatus.with_theta_mirrored,
    ),
    "mirrored_omega": Correction("ω is positive clockwise, θ is not", _scaled(((1, 1, -1), _VELOCITIES))),
    **{
        name: Correction(
            f"the zero of θ is off by {angle}: θ is measured from another axis than that of the shape, such as from "
            "the vertical, or the axes of the shape are exchanged",
            _turned_theta(quarters),
            Apparatus.without_outline,
        )
        for name, quarters, angle in (
            ("quarter_turn", 1, "90°"),
            ("quarter_turn_back", -1, "−90°"),
            ("half_turn", 2, "180°"),
        )
    },
    "contact_point_mirrored": Correction("x of the contact point points left", _scaled(((-1, 1), ("r",)))),
}
_IN_SPACE = {
    "scalar_last": Correction("the scalar of the quaternion is last", _other_quaternion(lambda q: q.roll(1, -1))),
    "inverse_quaternion": Correction(
        "the quaternion turns from the axes of the world to those of the body, or the other way round",
        _other_quaternion(lambda q: q * torch.tensor((1.0, -1.0, -1.0, -1.0), dtype=torch.float64)),
    ),
    **{
        f"spin_in_body_axes{time}": Correction(f"ω{when} is in the axes of the body", _other_spin(rotation, time))
        for time, when in _WHEN.items()
    },
    "spin_of_angles": Correction(
        "ω is the rates of roll, pitch and yaw, of turns about x, y and z of which that about z comes last",
        _other_spin(_rates_of_angles),
    ),
    "contact_point_in_body_axes": Correction("the contact point is in the axes of the body", _contact_in_body_axes),
    **{
        name + end: Correction(text + more, turned)
        for name, text, vector in (
            ("y_up", "y points up, not z", (math.pi / 2, 0.0, 0.0)),
            ("x_up", "x points up, not z", [-2 * math.pi / 3 / math.sqrt(3)] * 3),
            ("z_down", "z points down", (math.pi, 0.0, 0.0)),
        )
        for end, more, turned in (
            ("", "", _turned_axes(*vector, with_body=False)),
            ("_in_body", ", in the axes of the body too", _turned_axes(*vector, with_body=True)),
            *(
                (f"_in_spin{time}", f", in the spin{when} alone", _other_spin(_standing(*vector), time))
                for time, when in _WHEN.items()
            ),
        )
    },
    **{
        f"mirrored_{axis}_in_space": Correction(
            f"{axis} points the other way in positions, velocities and contact points, not in spins and quaternions",
            _mirrored(k),
        )
        for k, axis in enumerate("xyz")
    },
    "mirrored_vz": Correction(
        "v_z has the other sign, before and after impact", _scaled(((1, 1, -1, 1, 1, 1), _VELOCITIES))
    ),
    "mirrored_spin": Correction(
        "ω turns the other way, as in left-handed axes", _scaled(((1, 1, 1, -1, -1, -1), _VELOCITIES))
    ),
    **{
        f"mirrored_w{axis}": Correction(f"w_{axis} has the other sign", _mirrored_spin(k))
        for k, axis in enumerate("xyz")
    },
    **{
        f"inertia_{''.join('xyz'[k] for k in axes)}": Correction(
            f"the moments of inertia are about the axes {', '.join('xyz'[k] for k in axes)} of the body, in this order",
            _permuted(*(axes.index(k) for k in range(3))),
        )
        for axes in permutations(range(3))
        if axes != (0, 1, 2)
    },
}


def _drop(impacts: Impacts, bad: Bool[Tensor, " n"]) -> Impacts:
    if bool(bad.all()):
        raise DataError(f"{impacts.source}: none of {len(impacts)} trials would be left")
    return impacts[~bad]


def _averaged(column: int) -> Callable[[Impacts, AuditThresholds], Impacts]:
    """A correction that replaces a component of v_pre by its mean."""

    def average(impacts: Impacts, _: AuditThresholds) -> Impacts:
        v_pre = impacts.v_pre.clone()
        v_pre[:, column] = v_pre[:, column].mean()
        covariance = None if impacts.v_pre_cov is None else impacts.v_pre_cov.clone()
        if covariance is not None:  # the mean is as good as exact
            covariance[:, column] = covariance[:, :, column] = 0
        return impacts.replace(v_pre=v_pre, v_pre_cov=covariance)

    return average


def _moving_floor(impacts: Impacts, _: AuditThresholds) -> Impacts:
    floor = moving_floor(impacts)
    return impacts if floor is None else on_still_floor(impacts, floor.velocity.value)


def _contact_from_shape(impacts: Impacts, _: AuditThresholds) -> Impacts:
    if impacts.shape is None:
        raise DataError(f"{impacts.source}: no shape is stated that contact points could be computed from")
    return impacts.replace(r=contact_points(impacts.shape, impacts.body, orientation_of(impacts.q)))


def _ordered_by_time(impacts: Impacts, _: AuditThresholds) -> Impacts:
    if impacts.time is None:
        raise DataError(f"{impacts.source}: has no column time to order the trials by")
    return impacts.replace(order=impacts.time.argsort(stable=True).argsort() + 1)


def _forget(*names: str) -> Callable[[Apparatus], Apparatus]:
    """Drop estimates that make no sense in other units or axes."""
    return lambda apparatus: apparatus.without(*names)


CORRECTIONS = {
    "swapped_pre_post": _with_contact(
        Correction("before and after contact are exchanged: velocities and poses", _swapped_pre_post)
    ),
    "changes_post": Correction(
        "velocities after impact are changes, after minus before: those before impact are added to them",
        lambda impacts, _: impacts.replace(v_post=impacts.v_pre + impacts.v_post),
    ),
    "approach_speed": Correction(
        "the normal velocity before impact is a speed towards the floor: its sign is turned", _turned_approach
    ),
    **{name: replace(_with_contact(one), spaces=(PLANE,)) for name, one in _IN_PLANE.items()},
    **{
        name: replace(_with_contact(one), apparatus=Apparatus.without_outline, spaces=(SPACE,))
        for name, one in _IN_SPACE.items()
    },
    "contact_point_sign": _with_contact(
        Correction("r points from the contact to the centre of mass", lambda impacts, _: impacts.replace(r=-impacts.r))
    ),
    **{name: _written(one) for name, one in MISWRITTEN.items()},
    "inertia_scaled": Correction(
        "the moment of inertia is off by the factor that the moment balance of the data requires",
        _inertia_scaled,
        needs_all_trials=True,
    ),
    "velocity_of_point": Correction(
        "velocities are those of another point of the body, such as the origin of its markers: those of the centre of "
        "mass follow from the spin",
        _of_mass_centre,
        needs_all_trials=True,
    ),
    "turned_spin": Correction(
        "ω is in axes that are turned against those of the world, by an angle that follows from the moments",
        _turned_spin,
        needs_all_trials=True,
        spaces=(SPACE,),
    ),
    "inclined_floor": Correction(
        "the floor is inclined against the axes, which are turned by the angle at which the moments balance",
        _inclined_floor,
        _forget("slope", "slope_b", "orientation"),
        needs_all_trials=True,
        spaces=(PLANE,),
    ),
    "spin_from_moments": Correction(
        "the spin was not measured: it is 0 before impact, and after it what the moment of the impulse makes",
        _spin_from_moments,
        spaces=(PLANE,),
    ),
    "normal_alone": Correction(
        "the spin was not measured, and a ball has one from its bounce before: bounces count along the normal alone",
        _normal_alone,
        spaces=(PLANE,),
    ),
    "drop_incomplete": Correction(
        "trials of a table in which a number is missing or unreadable, or whose row is cut short: they are left out as "
        "it is read",
        lambda impacts, _: impacts,
    ),
    "drop_duplicates": Correction(
        "trials occur more than once: only the first remains",
        lambda impacts, _: _drop(impacts, repeated(impacts)),
        needs_all_trials=True,
    ),
    "drop_saturated": Correction(
        "velocities stop at a limit, as of an instrument that saturates: the trials at it are left out",
        lambda impacts, _: _drop(impacts, saturated(impacts)),
        needs_all_trials=True,
    ),
    "drop_outliers": Correction(
        "gross outliers, which cannot be real measurements",
        lambda impacts, limits: _drop(impacts, outliers(impacts, limits)),
        needs_all_trials=True,
    ),
    "named_by_mass": Correction(
        "bodies have no names, but a few masses: trials of one mass are of one body",
        lambda impacts, _: impacts.replace(object=named_by_mass(impacts)),
    ),
    "contact_from_shape": Correction(
        "contact points are known better from the shape than they are measured: those of the shape are used",
        _contact_from_shape,
    ),
    **{
        f"averaged_{name}": Correction(
            f"{symbol} before impact varies by no more than its noise: its mean is used",
            _averaged(column),
            needs_all_trials=True,
            spaces=(PLANE,),
        )
        for column, (name, symbol) in enumerate((("vx", "v_x"), ("vy", "v_y"), ("omega", "ω")))
    },
    "moving_floor": Correction(
        "the floor moves along its normal: velocities are taken relative to it", _moving_floor, needs_all_trials=True
    ),
    "ordered_by_time": Correction(
        "the order of the trials is not that of their times", _ordered_by_time, needs_all_trials=True
    ),
    "rig": Correction(
        "what the recordings say of the rig differs from what is stated",
        lambda impacts, _: as_measured(impacts),
        needs_all_trials=True,
    ),
    "traced_shape": Correction(
        "the shape is not stated, and the contact points trace it",
        lambda impacts, _: with_traced_shape(impacts),
        needs_all_trials=True,
        spaces=(PLANE,),
    ),
}
"""By name; the order is that in which several are applied where the audit proposes them together."""
