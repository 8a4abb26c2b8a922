"""Impacts: an immutable batch of measured impacts.  Prediction: the outcomes by a model.

Everything downstream of the data sources takes an `Impacts` and nothing reads a file again.  It holds float64 tensors
in SI units, all on one device (`contactlearn.core.devices` moves them); validation happens once, at construction.

    mass, inertia      [N]     kg, kg m²   about the centre of mass; in space inertia [N, 3], principal moments
    r                  [N, d]  m           contact point minus centre of mass, world axes
    q                  [N, 3]  m, m, rad   pose (x, y, θ) before contact; in space [N, 7], (x, y, z) and a quaternion
    v_pre, v_post      [N, D]  m/s, rad/s  velocity of the centre of mass, then spin, before and after contact
    q_post, time       as q, [N]           optional: pose after contact, time of contact in s
    v_pre_cov, v_post_cov  [N, D, D]       optional: covariances of the errors of v_pre and v_post
    outcome_cov        [N, D, D]           optional: covariance of v_post about any model of the state, estimated
    outcome_shift      [N, D]              with it: by how much the scatter moves the mean of v_post
    order              [N]                 place in the sequence of measurements; 1, 2, 3 … if left out
    trial, object      tuples of N names
    recording          optional: names of the recordings of the trials; those of one are held out together
    covariates         optional: other quantities by name, numbers [N] or N names, such as temperature and operator
    shape                              optional: that of all bodies, or by object (`contactlearn.mechanics.bodies`)
    apparatus                          optional: estimates of its parameters from other measurements

(d, D) = (2, 3) in the plane and (3, 6) in space (`mechanics.space`); r says which it is.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from html import escape
from typing import TYPE_CHECKING, Any, ClassVar, Literal, get_args

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn.functional import one_hot

from contactlearn.core.errors import ContactLearnError, DataError, UnknownNameError
from contactlearn.core.fingerprint import Fingerprint
from contactlearn.core.numerics import random_share
from contactlearn.mechanics import rigid_body
from contactlearn.mechanics.apparatus import Apparatus
from contactlearn.mechanics.bodies import AnyShape, body_codes, complete_shapes, contact_points, numbered, shapes_among
from contactlearn.mechanics.shapes import require_dimension
from contactlearn.mechanics.space import PLANE, SPACE, Space

if TYPE_CHECKING:
    from pandas import DataFrame

_ROUNDING = 1e-9  # of a correlation
_MIN_TRIALS, _OPPOSITE = 5, 0.5  # trials; ratio of distances from which on spins turn against the axes
UNIT = 1e-3
"""Difference from 1 that the length of a quaternion may have, as numbers of a few digits do."""

OPTIONAL = ("q_post", "time", "order")

COVARIATE = "covariate_"
"""Start of the names of columns of covariates."""
Covariates = Mapping[str, Float[Tensor, "n"] | tuple[str, ...]]
"""Quantities of each trial by name: numbers, or names of groups."""
MOST_GROUPS = 10
"""Groups of a covariate, at most, that are told apart."""

ImpulseTarget = Literal["momentum", "least_squares", "contact"]
IMPULSE_TARGETS: tuple[ImpulseTarget, ...] = get_args(ImpulseTarget)
"""Definitions of the measured impulse, see `measured_impulse`."""


@dataclass(frozen=True, eq=False)
class Impacts:
    """N measured impacts of rigid bodies with a fixed floor; see the module's table for the fields.

    Raises:
        DataError: naming the rule, the value, the row (counted from 1) and the column, where
            a number is missing or not finite, a mass or inertia is not positive, a covariance is
            not symmetric and positive semi-definite, a contact point does not approach the floor (v_n ≥ 0), or a trial
            name occurs twice.

    With `validate=False` neither the approach nor unique names are checked: the measurements are as read, for the audit
    and for corrections, and may be in a wrong frame or order.  No model takes them.  `incomplete` names the trials of
    the source that were left out, since a number of theirs is missing.
    """

    mass: Float[Tensor, "n"]
    inertia: Float[Tensor, "n"] | Float[Tensor, "n 3"]
    r: Float[Tensor, "n d"]
    q: Float[Tensor, "n pose"]
    v_pre: Float[Tensor, "n D"]
    v_post: Float[Tensor, "n D"]
    q_post: Float[Tensor, "n pose"] | None = None
    time: Float[Tensor, "n"] | None = None
    v_pre_cov: Float[Tensor, "n D D"] | None = field(default=None, kw_only=True)
    v_post_cov: Float[Tensor, "n D D"] | None = field(default=None, kw_only=True)
    outcome_cov: Float[Tensor, "n D D"] | None = field(default=None, kw_only=True)
    outcome_shift: Float[Tensor, "n D"] | None = field(default=None, kw_only=True)
    order: Float[Tensor, "n"] = field(default=None)  # pyright: ignore[reportAssignmentType]  (filled in below)
    trial: tuple[str, ...] = ()
    object: tuple[str, ...] = ()
    shape: AnyShape | None = None
    recording: tuple[str, ...] = field(default=(), kw_only=True)
    covariates: Covariates = field(default_factory=dict, kw_only=True)
    apparatus: Apparatus | None = field(default=None, kw_only=True)
    source: str = field(default="unnamed", kw_only=True)
    validate: bool = field(default=True, kw_only=True)
    incomplete: tuple[str, ...] = field(default=(), kw_only=True)

    from_frame: ClassVar[Callable[..., "Impacts"]]
    """`contactlearn.read_table`, which takes a DataFrame as it takes a file; the reader of tables puts it here."""

    def __post_init__(self) -> None:
        n = len(self.mass)
        if self.space is SPACE and torch.as_tensor(self.inertia).ndim == 1:  # the same about every axis
            object.__setattr__(self, "inertia", torch.as_tensor(self.inertia)[:, None].expand(-1, 3))
        for name, columns in self.space.components.items():
            if getattr(self, name) is not None or name not in OPTIONAL:
                self._take(name, (n,) if len(columns) == 1 else (n, len(columns)))
        if self.order is None:  # left out
            object.__setattr__(self, "order", torch.arange(1, n + 1).to(self.mass))
        for name in (*self.space.covariances, "outcome_cov"):
            if getattr(self, name) is not None:
                self._take(name, (n, self.space.D, self.space.D))
        if self.outcome_shift is not None:
            self._take("outcome_shift", (n, self.space.D))
        object.__setattr__(self, "trial", tuple(map(str, self.trial)) or tuple(str(i + 1) for i in range(n)))
        object.__setattr__(self, "object", tuple(map(str, self.object)) or ("body",) * n)
        object.__setattr__(self, "covariates", {name: _covariate(one) for name, one in self.covariates.items()})
        self._validate()

    def _take(self, name: str, shape: tuple[int, ...]) -> None:
        """Take a copy of a field, since the caller may overwrite theirs."""
        given = getattr(self, name)
        plain = given.to_numpy().copy() if hasattr(given, "to_numpy") else given
        value = torch.as_tensor(plain, dtype=torch.float64)
        if value.shape != shape:
            raise DataError(f"{name} must have shape {shape}, got {tuple(value.shape)}")
        object.__setattr__(self, name, value.clone(memory_format=torch.contiguous_format))
        if value.device != self.mass.device:
            raise DataError(f"{name} must be on {self.mass.device} as mass is, got {value.device}; move all or none")

    def _validate(self) -> None:
        n = len(self)
        if n == 0:
            raise DataError(f"{self.source}: no impacts; at least one is needed")
        for name in ("trial", "object", *(("recording",) if self.recording else ())):
            if len(getattr(self, name)) != n:
                raise DataError(f"{self.source}: {len(getattr(self, name))} {name} names for {n} impacts")
            if "" in getattr(self, name):
                row = getattr(self, name).index("") + 1
                raise DataError(f"{self.source}: row {row}, column {name}: must have a name, got an empty one", row=row)
        for name, values in self.covariates.items():
            if len(values) != n:
                raise DataError(f"{self.source}: {len(values)} values of the covariate {name} for {n} impacts")
            if isinstance(values, Tensor):
                self._refuse(~torch.isfinite(values), name, values, "must be a finite number")
            elif "" in values:
                row = values.index("") + 1
                raise DataError(f"{self.source}: row {row}, column {name}: must have a name, got an empty one", row=row)
        object.__setattr__(self, "shape", complete_shapes(self.shape, self.object, self.source))
        for one in shapes_among(self.shape).values():
            require_dimension(self.source, one, self.space)
        for name, columns in self.space.components.items():
            if (value := getattr(self, name)) is None or torch.isfinite(value).all():
                continue
            for column, values in zip(columns, value.reshape(n, -1).unbind(-1), strict=True):
                self._refuse(~torch.isfinite(values), column, values, "must be a finite number")
        moments = zip(self.space.inertia, self.inertia.reshape(n, -1).unbind(-1), strict=True)
        for column, values in (("mass", self.mass), *moments):
            self._refuse(values <= 0, column, values, f"must be positive, in {'kg' if column == 'mass' else 'kg m²'}")
        for name, columns in self.space.covariances.items():
            if getattr(self, name) is not None:
                self._refuse_covariance(name, columns)
        if self.space is SPACE:
            self._validate_bodies()
        if self.validate:
            if self.space is SPACE:
                self._check_scalar()
                self._check_handedness()
            self._check_approach()
            self._check_unique_trials()

    def _validate_bodies(self) -> None:
        """Refuse poses and moments of inertia that no body in space has."""
        for name, column in (("q", "qw"), ("q_post", "qw_post")):
            if (pose := getattr(self, name)) is not None:
                length = pose[:, 3:].norm(dim=-1)
                rule = "the quaternion (qw, qx, qy, qz) must be of length 1; are its columns mixed up?  Its length"
                self._refuse((length - 1).abs() > UNIT, column, length, rule)
        most = self.inertia.argmax(-1)
        excess = 2 * self.inertia.amax(-1) - self.inertia.sum(-1)
        for axis, column in enumerate(self.space.inertia):
            rule = "a moment of inertia is at most the sum of the two others; state principal moments in kg m².  Excess"
            self._refuse((most == axis) & (excess > _ROUNDING * self.inertia.amax(-1)), column, excess, rule)

    def _check_scalar(self) -> None:
        """Refuse quaternions with the scalar last: the shape then touches the floor where the bodies do."""
        if self.shape is None or len(self) < _MIN_TRIALS:
            return
        turns = self.q[:, 3:], self.q[:, 3:].roll(1, -1)
        points = (contact_points(self.shape, self.body, turn) for turn in turns)
        first, last = ((point - self.r).norm(dim=-1).median().item() for point in points)
        if last < _OPPOSITE * first:
            raise DataError(
                f"{self.source}: the scalar of a quaternion must come first, in qw; as it is the shape's lowest points "
                f"are {first:.3g} m off (rx, ry, rz), and {last:.3g} m with the scalar last; rename the columns"
            )

    def _check_handedness(self) -> None:
        """Refuse spins that turn against the axes: the changes of spin are then opposite to the moments of Δv."""
        change = self.v_post - self.v_pre
        spun = rigid_body.spin_momentum(self.world_inertia, change[:, 3:])
        moment = rigid_body.moment(self.r, self.mass[:, None] * change[:, :3])
        apart, opposite = ((spun - sign * moment).norm(dim=-1).median().item() for sign in (1, -1))
        if len(self) >= _MIN_TRIALS and opposite < _OPPOSITE * apart:
            raise DataError(
                f"{self.source}: axes must be right-handed, and I Δω is nearer to −r × m Δv ({opposite:.3g} N m s) "
                f"than to r × m Δv ({apart:.3g}); turn the signs of wx, wy, wz, or mirror one axis of all columns"
            )

    def _check_approach(self) -> None:
        """Refuse contact points that leave the floor before contact, as in axes that are not ours."""
        v_n = self.v_c[:, -1]
        if self.space is PLANE:
            rule = "v_n = vy + rx ω < 0 before contact (columns swapped, y down, a speed towards it, or ω in degrees?"
            rule += " contactlearn audit FILE tells; in Python, cl.audit of what is read with validate=False)"
        else:
            low = self.r.mean(0)
            axis = int(low.abs().argmax())
            lies = f"{'+-'[int(low[axis] < 0)]}{'xyz'[axis]}"
            rule = "v_n = vz + wx ry − wy rx < 0 before contact; the normal is z, upwards, and the contact points lie "
            rule += f"towards {lies} on average (turn the axes until that is -z; ω in degrees?)"
        self._refuse(v_n >= 0, self.space.velocity[self.space.d - 1], v_n, f"must approach the floor: {rule}")

    def _refuse_covariance(self, name: str, columns: Sequence[str]) -> None:
        """Refuse a matrix that is no covariance, and make it symmetric to the last bit."""
        value: Tensor = getattr(self, name)
        for column, i, j in zip(columns, *self.space.upper, strict=True):
            both = torch.stack((value[:, i, j], value[:, j, i]), -1)
            self._refuse(~torch.isfinite(both).all(-1), column, value[:, i, j], "must be a finite number")
            size = (value[:, i, i].abs() * value[:, j, j].abs()).sqrt()
            apart = (both[:, 0] - both[:, 1]).abs()
            self._refuse(apart > _ROUNDING * size, column, apart, f"{name} must be symmetric; the halves differ by it")
            if i == j:
                self._refuse(value[:, i, i] < 0, column, value[:, i, i], "is a variance, and must not be negative")
        deviation = value.diagonal(dim1=-2, dim2=-1).sqrt()
        scale = torch.where(deviation > 0, 1 / deviation, 0.0)
        correlation = scale[:, :, None] * value * scale[:, None, :]
        lost = ((value != 0) & (correlation == 0)).any(-1).any(-1)  # a covariance with what has no variance
        least = torch.where(lost, -1.0, torch.linalg.eigvalsh(correlation)[:, 0])
        rule = f"{name} must be positive semi-definite; the least eigenvalue of its correlations is negative"
        self._refuse(least < -_ROUNDING, columns[1], least, rule)
        object.__setattr__(self, name, (value + value.mT) / 2)

    def _check_unique_trials(self) -> None:
        seen: dict[str, int] = {}
        for row, name in enumerate(self.trial, 1):
            if (first := seen.setdefault(name, row)) != row:
                raise DataError(
                    f"{self.source}: trial names must be unique; row {row}, column trial repeats {name!r} "
                    f"of row {first} (data.correct=[drop_duplicates] drops rows that repeat others)",
                    row=row,
                )

    def _refuse(self, bad: Tensor, column: str, values: Tensor, rule: str) -> None:
        if bool(bad.any()):
            row = int(bad.nonzero()[0, 0])
            more = int(bad.sum()) - 1
            others = f" (and {more} more rows)" if more else ""
            raise DataError(
                f"{self.source}: row {row + 1} (trial {self.trial[row]!r}), column {column}: "
                f"{rule}; got {values[row].item():g}{others}",
                row=row + 1,
                column=column,
            )

    def __len__(self) -> int:
        return len(self.mass)

    def to_frame(self) -> "DataFrame":
        """Return a table with a row for each impact, in SI units; `from_frame` reads it back, but for the shape."""
        from pandas import DataFrame  # takes long to load

        columns: dict[str, Sequence[Any] | np.ndarray] = {"trial": self.trial, "object": self.object}
        for name, names in self.space.components.items():
            if (value := getattr(self, name)) is not None:
                columns |= zip(names, value.cpu().reshape(len(self), -1).T.numpy(), strict=True)
        for name, names in self.space.covariances.items():
            if (value := getattr(self, name)) is not None:
                columns |= zip(names, value.cpu()[:, *self.space.upper].T.numpy(), strict=True)
        for name, values in self.covariates.items():
            columns[f"{COVARIATE}{name}"] = values.cpu().numpy() if isinstance(values, Tensor) else values
        known = {} if self.apparatus is None else self.apparatus.to_columns()
        return DataFrame(columns | {name: [value] * len(self) for name, value in known.items()})

    def _repr_html_(self) -> str:
        """Show the first rows, as a notebook does."""
        return f"<p>{escape(repr(self))}</p>" + self[:5].to_frame().to_html(float_format="{:.4g}".format, index=False)

    def __repr__(self) -> str:
        objects = ", ".join(dict.fromkeys(self.object))
        return f"Impacts({len(self)} trials of {objects}, shape={self.shape}, source={self.source!r})"

    def __getitem__(self, rows: Int[Tensor, "k"] | Bool[Tensor, "n"] | Sequence[int] | int | slice) -> "Impacts":
        """The trials at `rows` (one index, several, a boolean mask or a slice), in that order."""
        if isinstance(rows, int) and not -len(self) <= rows < len(self):
            raise IndexError(f"trial {rows} of {len(self)}")  # which also ends a loop over the trials
        index = self.numbered(rows).reshape(-1).cpu()
        picked, index = index.tolist(), index.to(self.mass.device)
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        for name in (*self.space.components, *self.space.covariances, "outcome_cov", "outcome_shift"):
            if values[name] is not None:
                values[name] = values[name][index]
        for name in ("trial", "object", "recording"):
            values[name] = tuple(values[name][i] for i in picked) if values[name] else ()
        values["covariates"] = {
            name: one[index] if isinstance(one, Tensor) else tuple(one[i] for i in picked)
            for name, one in self.covariates.items()
        }
        return Impacts(**values)

    def numbered(self, rows: Tensor | Sequence[int] | int | slice) -> Int[Tensor, "..."]:
        """Return the numbers from 0 of rows: whole numbers, of which negative ones count from the end, a mask, a slice.

        Raises:
            DataError: numbers that are not whole, a row that is not there, or a mask of another length.
        """
        numbers = torch.arange(len(self), device=self.mass.device)
        if isinstance(rows, slice):
            return numbers[rows]
        try:
            held = rows if isinstance(rows, Tensor) else np.array(rows)  # a copy: masks of pandas are read-only
            index = torch.as_tensor(held, device=self.mass.device)
            return numbers[index.long() if not index.numel() and index.dtype is not torch.bool else index]
        except (IndexError, RuntimeError, TypeError, ValueError):
            raise DataError(
                f"{self.source}: rows must be whole numbers from 0 to {len(self) - 1}, or a mask of {len(self)} truth "
                f"values, got {' '.join(str(rows).split())}"
            ) from None

    def replace(self, **changes: Any) -> "Impacts":
        """A copy with some fields changed, validated again."""
        return replace(self, **changes)

    @cached_property
    def body(self) -> Int[Tensor, "n"]:
        """Number of each trial's body, `contactlearn.mechanics.bodies.body_code` of its name."""
        return body_codes(self.object).to(self.mass.device)

    @cached_property
    def groups(self) -> Int[Tensor, "n"] | None:
        """Number of each trial's recording, counted from 0; None where recordings are not named."""
        return numbered(self.recording) if self.recording else None

    @cached_property
    def covariate_codes(self) -> dict[str, Float[Tensor, "n"]]:
        """Numbers [N] of each covariate; `body_code` of the names of groups."""
        return {
            name: one if isinstance(one, Tensor) else body_codes(one).to(self.mass)
            for name, one in self.covariates.items()
        }

    @cached_property
    def covariate_columns(self) -> dict[str, Float[Tensor, "n c"]]:
        """Columns [N, c] of the covariates that vary: numbers, or an indicator of each group, of at most ten."""
        found: dict[str, Tensor] = {}
        for name, one in self.covariates.items():
            _, number = self.covariate_codes[name].unique(return_inverse=True)
            groups = int(number.max()) + 1
            if isinstance(one, Tensor) and groups > 1:
                found[name] = one[:, None]
            elif 1 < groups <= MOST_GROUPS:
                found[name] = one_hot(number).to(self.mass)
        return found

    @property
    def space(self) -> Space:
        """The plane, or space."""
        return SPACE if np.shape(self.r)[1:] == (3,) else PLANE

    @cached_property
    def world_inertia(self) -> Float[Tensor, "n"] | Float[Tensor, "n 3 3"]:
        """Moment of inertia in kg m²: [N] in the plane, [N, 3, 3] in world axes in space."""
        return rigid_body.inertia_in_world(self.inertia, self.q)

    @cached_property
    def W(self) -> Float[Tensor, "n d d"]:
        """Inverse effective inertia at the contact, [N, d, d] in 1/kg."""
        return rigid_body.inverse_inertia(self.mass, self.world_inertia, self.r)

    @cached_property
    def v_c(self) -> Float[Tensor, "n d"]:
        """Velocity of the contact point before contact, its normal component last, [N, d] in m/s."""
        return rigid_body.contact_velocity(self.r, self.v_pre)

    @cached_property
    def slip_axes(self) -> Float[Tensor, "n D D"]:
        """Rotation [N, D, D] from the axes of the slip to those of the world, see `rigid_body.slip_axes`."""
        return rigid_body.slip_axes(self.W, self.v_c)

    @cached_property
    def scales(self) -> tuple[float, float, float]:
        """Medians of the radius of gyration in m, the mass in kg, and the speed of the contact point in m/s."""
        gyration = (self.inertia.reshape(len(self), -1).mean(-1) / self.mass).sqrt()
        return gyration.median().item(), self.mass.median().item(), self.v_c.norm(dim=-1).median().item()

    @cached_property
    def wrench(self) -> Float[Tensor, "n D"]:
        """Measured wrench (P, τ) [N, D] in (N s, N m s): exact and unique."""
        return rigid_body.measured_wrench(self.mass, self.world_inertia, self.r, self.v_pre, self.v_post)

    @cached_property
    def whitening(self) -> Float[Tensor, "n D D"] | None:
        """Inverse Cholesky factors [N, D, D] of `outcome_cov`, which weigh the trials; None where all weigh alike."""
        if self.outcome_cov is None:
            return None
        root = torch.linalg.cholesky(self.outcome_cov)
        return torch.linalg.solve_triangular(root, torch.eye(self.space.D).to(root).expand_as(root), upper=False)

    @property
    def centred(self) -> Float[Tensor, "n D"]:
        """v_post without the shift by the scatter: what a model without it is compared with."""
        return self.v_post if self.outcome_shift is None else self.v_post - self.outcome_shift

    def residual(self, v_post: Float[Tensor, "*b n D"]) -> Float[Tensor, "*b n D"]:
        """Compute the centred v_post less a predicted one, whitened by `outcome_cov` where that is known."""
        residual = self.centred - v_post
        return residual if self.whitening is None else rigid_body.matvec(self.whitening, residual)

    @property
    def mass_diagonal(self) -> Float[Tensor, "n D"]:
        """Masses and moments of inertia [N, D], in space the mean one: M without its directions."""
        moments = self.inertia[:, None] if self.space is PLANE else self.inertia.mean(-1, keepdim=True)
        d, D = self.space.d, self.space.D
        return torch.cat((self.mass[:, None].expand(-1, d), moments.expand(-1, D - d)), -1)

    def fingerprint(self) -> str:
        """SHA-256 of the names and numbers, to tell later which data a result came from."""
        digest = Fingerprint()
        self.add_to(digest)
        return digest.hexdigest()

    def add_to(self, digest: Fingerprint) -> None:
        """Continue a fingerprint with the names and numbers of these impacts."""
        digest.add_texts("trial", self.trial)
        digest.add_texts("object", self.object)
        for name in (*self.space.components, *self.space.covariances):
            if (value := getattr(self, name)) is not None:
                digest.add_numbers(name, value)
        for name, one in self.covariates.items():
            if isinstance(one, Tensor):
                digest.add_numbers(f"{COVARIATE}{name}", one)
            else:
                digest.add_texts(f"{COVARIATE}{name}", one)
        if self.apparatus is not None:
            digest.set_text("apparatus", repr(self.apparatus))

    def split(self, test: float, generator: torch.Generator | None = None) -> tuple["Impacts", "Impacts"]:
        """Random (training pool, held-out test) with a share `test` of the trials, or recordings, held out.

        The generator has seed 0 if it is left out.
        """
        generator = torch.Generator().manual_seed(0) if generator is None else generator
        held_out = random_share(len(self), test, generator, self.source, self.groups)
        return self[~held_out], self[held_out]


def _covariate(values: Any) -> Tensor | tuple[str, ...]:
    """A covariate as numbers, or as names."""
    if isinstance(values, Sequence) and all(isinstance(value, str) for value in values):
        return tuple(values)
    return torch.as_tensor(values, dtype=torch.float64).clone()


def measured_impulse(impacts: Impacts, target: str = "momentum") -> Float[Tensor, "n d"]:
    """Return the measured impulse P [N, d] in N s, to which a law is fitted.

    The targets differ where the moment τ is not 0.

    Args:
        impacts: measurements.
        target: `momentum` is m Δ(v_x, v_y), exact.  `least_squares` and `contact` solve Δv = M⁻¹JᵀP over all of Δv,
            without weights (the paper's text), and weighted by M (P = M_c J Δv, the authors' published script).

    Raises:
        UnknownNameError: no such target.
    """
    if target == "momentum":
        return impacts.wrench[:, : impacts.space.d]
    dv = impacts.v_post - impacts.v_pre
    if target == "least_squares":
        return rigid_body.least_squares_impulse(impacts.mass, impacts.world_inertia, impacts.r, dv)
    if target == "contact":
        return rigid_body.matvec(rigid_body.effective_inertia(impacts.W), rigid_body.contact_velocity(impacts.r, dv))
    raise UnknownNameError("impulse target", target, IMPULSE_TARGETS)


@dataclass(frozen=True, eq=False, repr=False)
class Prediction:
    """Prediction of a model for N impacts; leading axes, such as seeds, may come before N.

    v_post [..., N, 3] in (m/s, m/s, rad/s) and wrench [..., N, 3] in (N s, N s, N m s); covariance
    [..., N, 3, 3] of the measured v_post about it, for a model that says how sure it is.
    """

    v_post: Float[Tensor, "*#batch n 3"]
    wrench: Float[Tensor, "*#batch n 3"]
    covariance: Float[Tensor, "*#batch n 3 3"] | None = None

    def __repr__(self) -> str:
        """Write how many impacts are predicted, and the mean velocity after them."""
        *batch, n, _ = self.v_post.shape
        several = f" by each of {tuple(batch)} models" if batch else ""
        mean = ", ".join(f"{x:.3g}" for x in self.v_post.reshape(-1, self.v_post.shape[-1]).mean(0).tolist())
        sure = "" if self.covariance is None else ", with covariances"
        return f"Prediction({n} impacts{several}, mean v_post ({mean}){sure})"

    def _repr_html_(self) -> str:
        if self.v_post.ndim > 2:
            return f"<p>{escape(repr(self))}</p>"
        table = self.to_frame().head(5).to_html(float_format="{:.4g}".format, index=False)
        return f"<p>{escape(repr(self))}</p>{table}"

    def to_frame(self) -> "DataFrame":
        """Return a table with a row for each impact: velocity after it, wrench, and covariances as `Impacts` has them.

        Raises:
            ContactLearnError: a prediction with leading axes.
        """
        from pandas import DataFrame  # takes long to load

        if self.v_post.ndim > 2:
            shape = tuple(self.v_post.shape)
            raise ContactLearnError(f"a table has a row for each impact; these are predictions {shape} of several")
        space = PLANE if self.v_post.shape[-1] == PLANE.D else SPACE
        columns = dict(zip(space.components["v_post"], self.v_post.detach().cpu().T.numpy(), strict=True))
        columns |= zip(space.wrench, self.wrench.detach().cpu().T.numpy(), strict=True)
        if self.covariance is not None:
            upper = self.covariance.detach().cpu()[:, *space.upper].T.numpy()
            columns |= zip(space.covariances["v_post_cov"], upper, strict=True)
        return DataFrame(columns)

    @classmethod
    def from_wrench(cls, impacts: Impacts, wrench: Float[Tensor, "*#batch n 3"]) -> "Prediction":
        """The post velocity follows from the wrench (P_t, P_n, τ) by the equation of motion."""
        v_post = rigid_body.apply_wrench(impacts.mass, impacts.world_inertia, impacts.r, impacts.v_pre, wrench)
        return cls(v_post, wrench)


def require_impacts(given: object) -> None:
    """Refuse anything but impacts, such as a DataFrame or a path.

    Raises:
        ContactLearnError: with the way from a table to impacts.
    """
    if isinstance(given, Impacts):
        return
    kind = type(given).__name__
    call = "Impacts.from_frame(frame, shape=…)" if kind == "DataFrame" else "read_table('drops.csv', shape=…)"
    raise ContactLearnError(f"impacts must be Impacts, got {kind}; contactlearn.{call} makes them")
