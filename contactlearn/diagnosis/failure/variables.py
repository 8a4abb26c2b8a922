"""Variables of regions: quantities of the contact before impact, their windows, and the words for those.

θ                            orientation, also modulo the symmetry of the body
r_x/ρ, |r_x|/ρ               lever arm in radii of gyration
direction, |v_t|, |v_t|/|v_n|, incidence   of the slip; incidence is the angle of v_c against the normal
|v_n|, ω, |ω|                approach speed and spin
x, order                     where on the floor, and when
mode                         the fate of the slip as the model predicts it: it goes on, ends or turns round
"""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn.functional import pad

from contactlearn.effects import State
from contactlearn.mechanics.bodies import AnyShape, shapes_among
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.mechanics.rigid_body import contact_velocity
from contactlearn.mechanics.shapes import contact_point

MODES = ("predicted to reverse its slip", "predicted to stick", "predicted to slide")
DIRECTIONS = ("slip to the left (v_t < 0)", "no slip", "slip to the right (v_t > 0)")
_STUCK = 0.01  # of the speed of the contact point: slip after impact up to which the contact stuck
_CELLS, _OF_MANY = 48, 200  # quantiles of a variable, at most; of tables that leave each of them `_MANY` trials
_MANY = 250
_FINEST = 4  # trials between two of them in the half that is searched, at least


@dataclass(frozen=True)
class Variable:
    """A quantity of each trial in SI units; one of unit ° is in rad, modulo `period` in rad, and written in degrees.

    With `labels` the values −1, 0 and 1 stand for three names.
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

    def said(self, low: float, high: float) -> str:
        """Write the window [low, high) in words: |θ − 90°| < 20° (mod 180°), |v_t| < 0.3 m/s, 0.1 ≤ x < 0.2 m."""
        if self.labels:
            return self.labels[(low > -1) + (low > 0)]
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
    """Compute all variables; incidence is the signed angle of the contact's velocity against the normal."""
    state = State.of(impacts)
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
    ]


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


@dataclass(frozen=True)
class Grid:
    """A variable in cells of about equal number, its windows from one cell up to another, and their limits."""

    variable: Variable
    cell: Int[Tensor, " n"]
    count: int
    ends: Int[Tensor, "c 2"]
    limits: Float[Tensor, "c 2"]

    @classmethod
    def of(cls, variable: Variable, searched: Bool[Tensor, " n"]) -> "Grid":
        """Divide a variable by quantiles of the trials that are searched."""
        period, values = variable.period, variable.values
        values = values.remainder(period) if period else values.contiguous()
        cuts = _cuts(variable, values[searched])
        cell, count = torch.searchsorted(cuts, values, right=True), len(cuts) + 1
        bounds = pad(pad(cuts, (1, 0), value=-math.inf), (0, 1), value=math.inf)
        if period and count > 1:  # the first and the last cell are one, and windows may go on around the circle
            cell, count = cell.remainder(count - 1), count - 1
            bounds = torch.cat((cuts[-1:] - period, cuts, cuts + period))
        start = torch.arange(count)[:, None]
        length = torch.arange(1, 2 if variable.labels else max(count, 2))
        ends = torch.stack(torch.broadcast_tensors(start, start + length), -1).reshape(-1, 2)
        ends = ends[ends[:, 1] < len(bounds)]
        return cls(variable, cell, count, ends, bounds[ends])

    def rows(self, window: int, margin: int = 0) -> Bool[Tensor, " n"]:
        """Find the trials in a window and in `margin` more cells on either side."""
        start, stop = self.ends[window].tolist()
        place = self.cell - (start - margin)
        place = place.remainder(self.count) if self.variable.period else place
        return (place >= 0) & (place < stop - start + 2 * margin)

    def sums(self, *weights: Float[Tensor, " n"]) -> Float[Tensor, "w c"]:
        """Sum each of the weights over the trials of each window."""
        cells = torch.stack([torch.bincount(self.cell, weight, minlength=self.count) for weight in weights])
        up_to = pad(torch.cat((cells, cells), -1).cumsum(-1), (1, 0))
        return up_to[:, self.ends[:, 1]] - up_to[:, self.ends[:, 0]]


def _cuts(variable: Variable, values: Float[Tensor, " m"]) -> Float[Tensor, " k"]:
    """Limits between cells of about equal number, ascending, rounded as they are written."""
    if variable.labels:
        return torch.tensor((-0.5, 0.5), dtype=torch.float64)
    cells = min(max(_CELLS, min(_OF_MANY, len(values) // _MANY)), len(values) // _FINEST)
    if cells < 2 or values.min() == values.max():
        return values[:0]
    values = variable.scale * values
    low, *inner, high = values.quantile(torch.linspace(0, 1, cells + 1, dtype=torch.float64)).tolist()
    step = (
        2.0
        if variable.period
        else 10.0 ** math.floor(math.log10((inner[-1] - inner[0] or high - low) / max(50, cells)))
    )
    step = max(step, 1.0) if variable.name == "order" else step
    rounded = {round(x / step) for x in (low, *inner) if low < round(x / step) * step < high}
    return step * torch.tensor(sorted(rounded), dtype=torch.float64) / variable.scale
