"""Variables of an impact before contact, along which errors are compared and drawn.

θ                            orientation, also modulo the symmetry of the body
r_x/ρ, |r_x|/ρ               lever arm in radii of gyration
direction, |v_t|, |v_t|/|v_n|, incidence   of the slip; incidence is the angle of v_c against the normal
|v_n|, ω, |ω|                approach speed and spin
x, order                     where on the floor, and when
covariates                   of the table, by their names
mode                         the fate of the slip as the model predicts it: it continues, stops or reverses
"""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.effects import State
from contactlearn.mechanics.bodies import AnyShape, shapes_among
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.mechanics.rigid_body import contact_velocity
from contactlearn.mechanics.shapes import contact_point
from contactlearn.mechanics.space import SPACE

MODES = ("predicted to reverse its slip", "predicted to stick", "predicted to slide")
DIRECTIONS = ("slip to the left (v_t < 0)", "no slip", "slip to the right (v_t > 0)")
_STUCK = 0.01  # of the speed of the contact point: slip after impact up to which the contact stuck


@dataclass(frozen=True)
class Variable:
    """A quantity of each trial in SI units; one of unit ° is in rad, modulo `period` in rad, and written in degrees.

    With `labels` the values −1, 0, 1 … are the labels.
    """

    name: str
    letter: str
    unit: str
    values: Float[Tensor, " n"]
    period: float | None = None
    labels: tuple[str, ...] = ()

    @property
    def scale(self) -> float:
        """Factor from SI units to those of text and figures."""
        return math.degrees(1) if self.unit == "°" else 1.0

    def window_text(self, low: float, high: float) -> str:
        """Write the window [low, high) in words: |θ − 90°| < 20° (mod 180°), |v_t| < 0.3 m/s, 0.1 ≤ x < 0.2 m."""
        if self.labels:
            return self.labels[int(max(low, -1.5) + 1.5)]
        low, high = self.scale * low, self.scale * high
        unit = self.unit if self.unit == "°" else f" {self.unit}".rstrip(" –")
        if self.period:
            period, half, centre = math.degrees(self.period), (high - low) / 2, round((low + high) / 2, 1)
            centre = (centre + 180) % 360 - 180 if period > 359 else centre % period
            distance = f"{self.letter} {'−' if centre > 0 else '+'} {abs(centre):g}°" if centre else self.letter
            return f"|{distance}| < {half:.3g}° (mod {period:.3g}°)"
        lower, upper = (f"{limit:.6g}{unit}" for limit in (low, high))
        if low == -math.inf:
            return f"{self.letter} < {upper}"
        return f"{self.letter} ≥ {lower}" if high == math.inf else f"{low:.6g} ≤ {self.letter} < {upper}"


def variables(impacts: Impacts, prediction: Prediction) -> list[Variable]:
    """Compute all variables; incidence is the angle of the contact's velocity against the normal, in the plane signed.

    In space the mode is decided along the slip before contact, and the axes of the world have no part.
    """
    state = State.of(impacts)
    if state.space is SPACE:
        return _in_space(state, impacts, prediction)
    theta, v_t, v_n, lever = state.theta, state.v_t, state.v_n, state.r[:, 0] / (state.inertia / state.mass).sqrt()
    slip = contact_velocity(impacts.r, prediction.v_post.reshape(-1, len(impacts), 3).mean(0))[:, 0]
    mode = torch.where(slip.abs() <= _STUCK * state.v_c.norm(dim=-1), 0.0, (slip * v_t).sign())
    folds = symmetry(impacts.shape)
    folded = [Variable("theta_folded", "θ", "°", theta, 2 * math.pi / folds)] if folds > 1 else []
    return [
        *folded,
        Variable("theta", "θ", "°", theta, 2 * math.pi),
        Variable("mode", "mode", "–", mode, labels=MODES),
        Variable("direction", "direction", "–", v_t.sign(), labels=DIRECTIONS),
        Variable("slip_speed", "|v_t|", "m/s", v_t.abs()),
        Variable("approach_speed", "|v_n|", "m/s", v_n.abs()),
        Variable("slip_ratio", "|v_t|/|v_n|", "–", (v_t / v_n).abs()),
        Variable("incidence", "incidence", "°", torch.atan2(v_t, -v_n)),
        Variable("lever_arm", "r_x/ρ", "–", lever),
        Variable("lever_length", "|r_x|/ρ", "–", lever.abs()),
        Variable("spin", "ω", "rad/s", state.omega),
        Variable("spin_rate", "|ω|", "rad/s", state.omega.abs()),
        Variable("location", "x", "m", state.x),
        Variable("order", "order", "–", state.order),
        *_of_covariates(impacts),
    ]


def map_variables(impacts: Impacts, prediction: Prediction) -> list[Variable]:
    """Return the variables in which the map is drawn: those of regions, and the velocity before impact."""
    linear = zip(impacts.space.symbols, impacts.v_pre.T[: impacts.space.d], strict=False)
    plain = [Variable(name, name, "m/s", values) for name, values in linear]
    return [*variables(impacts, prediction), *plain]


def _in_space(state: State, impacts: Impacts, prediction: Prediction) -> list[Variable]:
    """The variables of bodies in space: none but the place depends on the direction of the slip."""
    v_post = prediction.v_post.reshape(-1, len(impacts), 6).mean(0)
    slip = contact_velocity(impacts.r, v_post)[:, :2]
    along = (slip * impacts.slip_axes[:, :2, 0]).sum(-1)
    mode = torch.where(slip.norm(dim=-1) <= _STUCK * state.v_c.norm(dim=-1), 0.0, along.sign())
    spin = state.v_pre[:, 3:]
    return [
        Variable("mode", "mode", "–", mode, labels=MODES),
        Variable("slip_speed", "|v_t|", "m/s", state.slip),
        Variable("approach_speed", "|v_n|", "m/s", state.v_n.abs()),
        Variable("slip_ratio", "|v_t|/|v_n|", "–", (state.slip / state.v_n).abs()),
        Variable("incidence", "incidence", "°", state.incidence),
        Variable("lever_length", "|r_t|/ρ", "–", state.lever),
        Variable("spin_rate", "|ω|", "rad/s", spin.norm(dim=-1)),
        Variable("twist", "ω_n", "rad/s", spin[:, 2]),
        Variable("location", "x", "m", state.x),
        Variable("location_y", "y", "m", state.q[:, 1]),
        Variable("order", "order", "–", state.order),
        *_of_covariates(impacts),
    ]


def _of_covariates(impacts: Impacts) -> list[Variable]:
    """Numbers, and groups by their names."""
    found: list[Variable] = []
    for name, columns in impacts.covariate_columns.items():
        one = impacts.covariates[name]
        if isinstance(one, Tensor):
            found.append(Variable(name, name, "–", one))
        else:
            number = columns.argmax(-1)
            labels = tuple(f"{name} {one[int((number == k).nonzero()[0, 0])]}" for k in range(columns.shape[1]))
            found.append(Variable(name, name, "–", number.to(columns) - 1, labels=labels))
    return found


def symmetry(shape: AnyShape | None) -> int:
    """Count the orientations in one turn in which all bodies look the same: 2 for an ellipse; 1 if unknown or discs."""
    shapes = shapes_among(shape).values()
    theta = torch.arange(7, dtype=torch.float64) + 0.1234  # any that put no flat side on the floor
    folds = range(2, 13)
    same = set(folds)
    for one in shapes:
        r = contact_point(one, theta)
        same &= {k for k in folds if (contact_point(one, theta + 2 * math.pi / k) - r).norm() < 1e-6 * r.norm()}
    return 1 if len(same) == len(folds) else max(same, default=1)
