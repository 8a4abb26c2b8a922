"""The moment balance and the energy of measured impacts, and the coefficients that the measurements give the balance.

    I Δω = a r_x P_n − b r_y P_t with P = m Δv; a = b = 1 for a rigid impact
    I Δω = a r × P_n + b r × P_t            in space, in world axes

Neither friction nor restitution enters.  `torque` has the terms of each trial, of impacts or of many hypotheses about
them at once; `balance` fits the coefficients, and leaves open what these data do not determine.
"""

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from contactlearn.core.numerics import MAD_SCALE, Z_95, biweight
from contactlearn.data.audit.thresholds import AuditThresholds
from contactlearn.data.audit.units import MISWRITTEN
from contactlearn.mechanics.bodies import AnyShape, shapes_among
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import (
    contact_velocity,
    in_world,
    inertia_in_world,
    moment,
    spin,
    squared_mass_norm,
    swept,
)
from contactlearn.mechanics.space import PLANE, SPACE, Space

BALANCE = {
    "plane": "I Δω = a r_x P_n − b r_y P_t",
    "space": "I Δω = a r × P_n + b r × P_t",
}
"""The moment balance in words, by the name of the space."""
_FIELDS = ("mass", "inertia", "r", "q", "v_pre", "v_post", "q_post")
HEAVIEST = 8.0
"""Largest plausible (I/m)/|r|² of a body of unknown outline: one that lands flat, far inside its outline."""
_ROUNDED = 1.1  # of the largest I of an outline: what noise adds to that of a hoop
_INERTIA_UNITS = {1e-3: "g m²", 1e-6: "kg mm²", 1e-9: "g mm²", 1e-4: "kg cm²", 1e-7: "g cm²"}
_BESIDE = 0.1  # least I about the centre of mass over that about an axis within reach: a rod about its end has 1/4
_MAX_ROUNDS, _ABSOLUTE_ROUNDS = 40, 10  # of robust weights, the first by absolute deviations
_CONVERGED = 1e-12  # change of a weight
_PROPORTIONAL = 1e-6  # relative singular value up to which two terms are in proportion: numbers of a file have 7 digits
_SMALL_MOMENTS = 0.05  # median of a term, of |Δv| / ρ, up to which it may be noise of some 5 % of the speeds
_SURE_MOMENTS = 4.0  # standard errors from 0 from which on the coefficient of such a term is judged


@dataclass(frozen=True, kw_only=True)
class Columns:
    """Fields of `Impacts` in their units and of their components, with leading axes; nothing is validated."""

    mass: Float[Tensor, "*batch n"]
    inertia: Float[Tensor, "..."]
    r: Float[Tensor, "*batch n d"]
    q: Float[Tensor, "*batch n pose"]
    v_pre: Float[Tensor, "*batch n D"]
    v_post: Float[Tensor, "*batch n D"]
    q_post: Float[Tensor, "*batch n pose"] | None
    shape: AnyShape | None
    body: Int[Tensor, " n"]

    @classmethod
    def of(cls, impacts: Impacts) -> "Columns":
        """Return the columns of impacts as those of one hypothesis, [1, n]."""
        there = (name for name in _FIELDS if getattr(impacts, name) is not None)
        fields: dict[str, Any] = {"q_post": None} | {name: getattr(impacts, name)[None] for name in there}
        return cls(**fields, shape=impacts.shape, body=impacts.body)

    @property
    def v_c(self) -> Float[Tensor, "*batch n d"]:
        """Velocity of the contact point before contact in m/s, its normal component last."""
        return contact_velocity(self.r, self.v_pre)

    @property
    def space(self) -> Space:
        """The plane, or space."""
        return PLANE if self.r.shape[-1] == PLANE.d else SPACE

    @property
    def world_inertia(self) -> Float[Tensor, "..."]:
        """Moment of inertia in kg m², in space in world axes."""
        return inertia_in_world(self.inertia, self.q)

    def replace(self, **changes: Tensor) -> "Columns":
        """Return the columns with some of them changed."""
        return replace(self, **changes)

    def __getitem__(self, which: Tensor) -> "Columns":
        """Return the hypotheses at these places of the first axis."""
        fields = {name: x[which] for name in _FIELDS if (x := getattr(self, name)) is not None}
        return replace(self, **fields)

    def room(self, size: int) -> "Columns":
        """Return columns of so many hypotheses, whose numbers are to be set."""
        fields = {name: x for name in _FIELDS if (x := getattr(self, name)) is not None}
        return replace(self, **{name: x.new_empty(size, *x.shape[1:]) for name, x in fields.items()})

    def __setitem__(self, which: Tensor | slice, others: "Columns") -> None:
        """Set the hypotheses at these places of the first axis."""
        for name in _FIELDS:
            if (x := getattr(self, name)) is not None:
                x[which] = getattr(others, name)


class Torque(NamedTuple):
    """Terms [..., n], in space [..., n, 3], of the moment balance spin = normal + tangential, all in rad/s.

    `spin` is Δω, `normal` r_x P_n / I, `tangential` −r_y P_t / I, in space I⁻¹ (r × P_n) and I⁻¹ (r × P_t), and `scale`
    [..., n] |Δv| / ρ with ρ² = I/m: the spin that the same momentum at one radius of gyration makes.
    """

    spin: Float[Tensor, "..."]
    normal: Float[Tensor, "..."]
    tangential: Float[Tensor, "..."]
    scale: Float[Tensor, "*batch n"]

    @property
    def residual(self) -> Float[Tensor, "..."]:
        """τ / I in rad/s: the part of the spin that no point contact makes."""
        return self.spin - self.normal - self.tangential

    def size(self, term: Float[Tensor, "..."]) -> Float[Tensor, "*batch n"]:
        """Return the size of a term of each trial."""
        return term.abs() if term.ndim == self.scale.ndim else term.norm(dim=-1)

    def by_component(self, term: Float[Tensor, "..."]) -> Float[Tensor, "*batch m"]:
        """Return the components of a term of all trials in one row, which the balance holds one by one."""
        return term if term.ndim == self.scale.ndim else term.flatten(-2)

    @property
    def imbalance(self) -> Float[Tensor, "*batch n"]:
        """|residual| relative to the terms, in [0, 1]; a twentieth of `scale` is added to them, for tiny terms."""
        size = self.size(self.spin) + self.size(self.normal) + self.size(self.tangential) + 0.05 * self.scale
        return (self.size(self.residual) / size.clamp_min(torch.finfo(size.dtype).tiny)).clamp_max(1)

    @property
    def explained(self) -> Float[Tensor, "*batch"]:
        """Share of Δω that the balance with coefficients +1 and +1 explains, by medians; ≤ 0 if none."""
        residual, spin = (self.size(x).median(-1).values for x in (self.residual, self.spin))
        return 1 - (residual / spin.clamp_min(1e-300)) ** 2

    @property
    def inertia_factor(self) -> Float[Tensor, "*batch"]:
        """Factor on I at which the moments balance; nan where no positive one fits.

        It is the geometric mean of the slopes of r × P over I Δω and of I Δω over r × P, by least absolute deviations
        through the origin: noise in neither biases it, and it is robust to outliers.
        """
        moment, spin = map(self.by_component, (self.normal + self.tangential, self.spin))
        one, other = _slope(moment, spin), _slope(spin, moment)
        return torch.where((one > 0) & (other > 0), (one / other).sqrt(), math.nan)


def torque(impacts: Impacts | Columns) -> Torque:
    """Compute the terms of the moment balance I Δω = r × P with P = m Δv."""
    dv = impacts.v_post - impacts.v_pre
    if impacts.space is SPACE:
        along = dv[..., :3] * torch.tensor((1.0, 1.0, 0.0)).to(dv)
        inertia, mass = impacts.world_inertia, impacts.mass[..., None]
        normal, tangential = (spin(inertia, moment(impacts.r, mass * part)) for part in (dv[..., :3] - along, along))
        rho = (impacts.inertia.mean(-1) / impacts.mass).sqrt()
        return Torque(dv[..., 3:], normal, tangential, dv[..., :3].norm(dim=-1) / rho)
    gyration = impacts.inertia / impacts.mass
    normal, tangential = impacts.r[..., 0] * dv[..., 1] / gyration, -impacts.r[..., 1] * dv[..., 0] / gyration
    return Torque(dv[..., 2], normal, tangential, dv[..., :2].norm(dim=-1) / gyration.sqrt())


def drag_factor(impacts: Impacts) -> float:
    """Compute the factor on velocities after contact at which the moments balance, by least absolute deviations."""
    d, mass = impacts.space.d, impacts.mass[:, None]
    before, after = (
        spin(impacts.world_inertia, moment(impacts.r, mass * v[:, :d])) for v in (impacts.v_pre, impacts.v_post)
    )
    change = (impacts.v_post - impacts.v_pre)[:, d:]
    return _slope((change + before).flatten(), after.flatten()).item()


def _slope(y: Float[Tensor, "*batch n"], x: Float[Tensor, "*batch n"]) -> Float[Tensor, "*batch"]:
    """Slope of y over x by least absolute deviations: the median of y/x, weighted by |x|; nan where x is 0."""
    ratio, order = torch.where(x == 0, 0.0, y / x).sort(-1)
    share = x.abs().gather(-1, order).cumsum(-1)
    middle = torch.searchsorted(share, share[..., -1:] / 2).clamp_max(x.shape[-1] - 1)
    return torch.where(share[..., -1] > 0, ratio.gather(-1, middle)[..., 0], math.nan)


def kinetic_energy(impacts: Impacts | Columns) -> tuple[Float[Tensor, "*batch n"], Float[Tensor, "*batch n"]]:
    """Compute the kinetic energy in J before and after contact."""
    inertia = impacts.world_inertia
    before, after = (squared_mass_norm(impacts.mass, inertia, v) / 2 for v in (impacts.v_pre, impacts.v_post))
    return before, after


@dataclass(frozen=True, kw_only=True)
class Balance:
    """The moment balance Δω = a r_x P_n / I − b r_y P_t / I, fitted robustly: a = b = 1 for consistent data.

    `a_error` and `b_error` are standard errors, `a_size` and `b_size` the medians of the terms, as shares of that of
    |Δv| / ρ, `r_squared` the share of Δω that the fit explains, without outliers, `freedom` the trials that count, less
    the two coefficients.
    """

    a: float
    b: float
    a_error: float
    b_error: float
    a_size: float
    b_size: float
    r_squared: float
    freedom: float

    @property
    def terms(self) -> dict[str, tuple[float, float, float]]:
        """By coefficient its value and the ends of its 95 % interval; those that the data leave open are not there."""
        values = {"a": (self.a, Z_95 * self.a_error), "b": (self.b, Z_95 * self.b_error)}
        return {name: (x, x - e, x + e) for name, (x, e) in values.items() if e < math.inf}

    @property
    def imbalance(self) -> float:
        """Relative amount by which a coefficient differs from 1 at least, with 95 %; infinite for a wrong sign.

        Noise in a moment shrinks its coefficient, to no less than the partial R² of its term (Frisch's bound).
        """
        most = 0.0
        for x, low, high in self.terms.values():
            noise = self.freedom * ((high - x) / Z_95) ** 2
            high = high / max(x**2 / (x**2 + noise) if x else 0.0, 1e-6)
            off = low - 1 if low > 1 else (1 / high - 1 if 0 < high < 1 else 0.0)
            most = max(most, math.inf if high <= 0 else off)
        return most

    @property
    def judged(self) -> "Balance":
        """The balance without coefficients that noise alone may have made.

        Of a term that is all noise nothing is left, whatever its coefficient is: vertical drops without spin.
        """
        open_ = {
            f"{name}_error": math.inf
            for name in "ab"
            if getattr(self, f"{name}_size") <= _SMALL_MOMENTS
            and abs(getattr(self, name)) <= _SURE_MOMENTS * getattr(self, f"{name}_error")
        }
        return replace(self, **open_)

    def coefficients(self, when: str) -> dict[str, float]:
        """Coefficients, standard errors and R² by name and the data that they are of; without those that are open."""
        names = ("a", "a_error", "b", "b_error", "r_squared")
        return {f"{name}_{when}": x for name in names if math.isfinite(x := getattr(self, name))}

    @property
    def tested(self) -> float:
        """Half-width of the narrower interval, the precision to which the data test the balance; infinite if none."""
        return min((high - x for x, _, high in self.terms.values()), default=math.inf)

    def __str__(self) -> str:
        numbers = {name: map(_signed, term) for name, term in self.terms.items()}
        text = " and ".join(f"{name} = {x} [{low}, {high}]" for name, (x, low, high) in numbers.items())
        return f"{text or 'no coefficient'} (95 %, R² = {self.r_squared:.2f})"


def _signed(value: float) -> str:
    return f"{value:+.2f}" if abs(value) >= 0.095 or value == 0 else f"{value:+.1g}"


def balance(impacts: Impacts) -> Balance:
    """Fit both coefficients of the moment balance by Tukey's biweight, from least absolute deviations.

    A term that is 0 in every trial (r_x of a disc) has the coefficient 0 ± ∞, and both are ± ∞ where their terms are
    in proportion in all trials, as those of one trial and its copies.
    """
    terms = torque(impacts)
    normal, tangential, y = map(terms.by_component, (terms.normal, terms.tangential, terms.spin))
    X = torch.stack((normal, tangential), -1)
    X = torch.where((X**2).sum(0) > 1e-12 * (terms.scale**2).sum(), X, 0.0)  # r_x of a disc is 0 but for rounding
    there = (X**2).sum(0) > 1e-12 * (y**2).sum()
    some, weight, least = X[:, there], torch.ones_like(y), 1e-9 * y.abs().mean() + 1e-300
    fit, inverse, size = y[:0], y[:0], y
    for step in range(_MAX_ROUNDS):
        inverse = torch.linalg.pinv(some.mT @ (weight[:, None] * some), hermitian=True)
        fit = inverse @ (some.mT @ (weight * y))
        size = (y - some @ fit).abs()
        spread = (MAD_SCALE * size.median()).clamp_min(least)
        absolute, before = step < _ABSOLUTE_ROUNDS, weight
        weight = 1 / size.clamp_min(spread / 10) if absolute else biweight(size / spread)
        if not absolute and torch.allclose(weight, before, rtol=0, atol=_CONVERGED):
            break
    residual = (weight * size**2).sum()
    freedom = (weight.sum() - 2).clamp_min(1)
    r_squared = 1 - residual / (weight * y**2).sum().clamp_min(1e-300)
    error = torch.full_like(there, math.inf, dtype=y.dtype)
    if torch.linalg.matrix_rank(some / some.norm(dim=0), rtol=_PROPORTIONAL) == some.shape[1]:
        error[there] = (inverse.diagonal() * residual / freedom).sqrt()
    a, b = torch.zeros_like(error).masked_scatter(there, fit).tolist()
    a_error, b_error = error.tolist()
    a_size, b_size = (X.abs().median(0).values / terms.scale.median().clamp_min(1e-300)).tolist()
    more = {"a_error": a_error, "b_error": b_error, "a_size": a_size, "b_size": b_size}
    return Balance(a=a, b=b, **more, r_squared=r_squared.item(), freedom=freedom.item())


def needed_inertia(impacts: Impacts | Columns, thresholds: AuditThresholds) -> Float[Tensor, "*batch"]:
    """Compute the factor on I at which the moments balance, where that is a mistake in the data; nan elsewhere.

    A small one is the effect `inertia_error`.  None makes I larger than if the whole mass were at the farthest point
    of the outline, or of a body of unknown outline than if that were well beyond its contact points.
    """
    factor = torque(impacts).inertia_factor
    gyration = median_gyration(impacts)
    if impacts.shape is None:
        most = HEAVIEST * impacts.r.norm(dim=-1).median(-1).values ** 2
    else:
        farthest = max(
            shape.outline().norm(dim=-1).nan_to_num().max() for shape in shapes_among(impacts.shape).values()
        )
        most = _ROUNDED * farthest**2
    wrong = factor.log().abs() > math.log(thresholds.inertia_factor)
    return torch.where(wrong & (factor * gyration <= most), factor, math.nan)


def tracked_point(impacts: Impacts) -> Float[Tensor, " d"]:
    """Compute the point in m, from the centre of mass in the axes of the body, of which velocities balance the moments.

    Those of a point d are v + ω × d, so Δω = I⁻¹ r × m (Δv − Δω × d) is linear in d; by Tukey's biweight.
    """
    d, terms = impacts.space.d, torque(impacts)
    change, inertia = (impacts.v_post - impacts.v_pre)[:, d:], impacts.world_inertia
    arms = (in_world(axis.expand(len(impacts), d), impacts.q) for axis in torch.eye(d, dtype=torch.float64))
    forces = (impacts.mass[:, None] * swept(arm, change) for arm in arms)
    columns = torch.stack([spin(inertia, moment(impacts.r, force)).flatten() for force in forces], -1)
    left, weight = -terms.residual.flatten(), torch.ones(len(columns), dtype=torch.float64)
    point = columns[0]
    for _ in range(_ABSOLUTE_ROUNDS):
        point = torch.linalg.lstsq(weight[:, None] * columns, weight * left).solution
        weight = _weight((left - columns @ point).abs()).sqrt()
    return point


def spin_turn(impacts: Impacts) -> Float[Tensor, "3 3"]:
    """Compute the turn of the spins in space, from their axes to those of the world, at which the moments balance best.

    See `best_turn`.
    """
    terms = torque(impacts)
    return best_turn(terms.spin, terms.normal + terms.tangential)


def best_turn(change: Float[Tensor, "n 3"], needed: Float[Tensor, "n 3"]) -> Float[Tensor, "3 3"]:
    """Compute the turn that brings vectors nearest to others: Wahba 1965, by singular values and Tukey's biweight."""
    weight, turn = torch.ones(len(change), dtype=torch.float64), torch.eye(3, dtype=torch.float64)
    for _ in range(_ABSOLUTE_ROUNDS):
        U, _, Vh = torch.linalg.svd(needed.T @ (weight[:, None] * change))
        turn = U @ torch.diag(torch.tensor((1.0, 1.0, torch.linalg.det(U @ Vh)), dtype=torch.float64)) @ Vh
        weight = _weight((needed - change @ turn.T).norm(dim=-1))
    return turn


def _weight(off: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
    return biweight(off / (MAD_SCALE * off.median()).clamp_min(1e-300))


def point_text(impacts: Impacts) -> str:
    """Write where that point is."""
    place = ", ".join(f"{1e3 * x:.3g}".replace("-", "−") for x in tracked_point(impacts).tolist())
    return f"they are of the point at ({place}) mm from the centre of mass in the axes of the body"


def turn_text(impacts: Impacts) -> str:
    """Write that turn."""
    from scipy.spatial.transform import Rotation  # SciPy takes long to load

    vector = torch.from_numpy(Rotation.from_matrix(spin_turn(impacts).numpy()).as_rotvec())
    axis = ", ".join(f"{round(x, 2) + 0.0:.2f}".replace("-", "−") for x in (vector / vector.norm()).tolist())
    return f"a turn by {math.degrees(vector.norm().item()):.3g}° about ({axis}) takes it to those of the world"


def median_gyration(impacts: Impacts | Columns) -> Float[Tensor, "*batch"]:
    """Compute the median of I/m in m², in space of its mean over the axes."""
    inertia = impacts.inertia if impacts.space is PLANE else impacts.inertia.mean(-1)
    return (inertia / impacts.mass).median(-1).values


def inertia_text(factor: float) -> str:
    """Write a factor on I, the unit in which I may be, and the axis that it may be about.

    About an axis beside the centre of mass I is larger; where the mass is in g as well, both make the factor.
    """
    unit = next((u for scale, u in _INERTIA_UNITS.items() if abs(math.log(factor / scale)) < 0.3), None)
    axis = "about an axis that does not pass through the centre of mass"
    if unit:
        hint = f" (is it in {unit}?)"
    elif _BESIDE <= factor < 1:
        hint = f" (is it {axis}?)"
    elif _BESIDE <= (left := factor * MISWRITTEN["grams"].factor) < 1:
        hint = f" (is the mass in g, and the inertia {1 / left:.3g} times too large, as {axis}?)"
    else:
        hint = ""
    return f"{factor:.3g}{hint}"
