"""Feature spaces: what a learned model sees of an impact.  `Features.of` gives each of them.

    state     10-D    {m, I, r_x, r_y, x, y, θ, v_x, v_y, ω}, θ as (cos θ, sin θ) because it is periodic
    x1        X1      {M_c,tt, M_c,tn, M_c,nn, v_t, v_n}, what the admissible impulses depend on
    x2        X2      M_c v_c, the momentum of the contact point: {p_t, p_n}
    x2_polar  X2      the same as angle from −n and norm, the form that the authors stored; in the plane alone

In space they are the same in the axes of the slip, 1 along it, 2 across it and n up (`rigid_body.slip_axes`): a turn
about the normal changes none.  The state has the direction of gravity in the body, g, for the angle, and no place.

Source: Fazeli et al. (2017), Section 4.1.  Its text calls the 5-D space of Class II X_5; it is X1.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.errors import UnknownNameError
from contactlearn.mechanics import rigid_body
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.space import PLANE, SPACE, Space, require_space

if TYPE_CHECKING:  # pandas takes long to load
    import pandas as pd


class FeatureSpace(NamedTuple):
    """A feature space: its symbols with units in the plane and in space, if it exists there, and how it is computed."""

    columns: dict[str, str]
    in_space: dict[str, str]
    compute: Callable[[Impacts], tuple[Tensor, ...]]


def _state(impacts: Impacts) -> tuple[Tensor, ...]:
    if impacts.space is SPACE:
        down = -rigid_body.rotation(impacts.q[:, 3:])[:, 2]
        vectors = _along_slip(impacts, impacts.r), down, _along_slip(impacts, impacts.v_pre)
        return impacts.mass, *impacts.inertia.unbind(-1), *torch.cat(vectors, -1).unbind(-1)
    x, y, theta = impacts.q.unbind(-1)
    pose = x, y, theta.cos(), theta.sin()
    return impacts.mass, impacts.inertia, *impacts.r.unbind(-1), *pose, *impacts.v_pre.unbind(-1)


def _along_slip(impacts: Impacts, vector: Tensor) -> Tensor:
    """Components in the axes of the slip, of a vector [N, d] or of a velocity [N, D]."""
    size = vector.shape[-1]
    return rigid_body.matvec(impacts.slip_axes.mT[:, :size, :size], vector)


def _x1(impacts: Impacts) -> tuple[Tensor, ...]:
    d = impacts.space.d
    axes = impacts.slip_axes[:, :d, :d]
    M_c = axes.mT @ rigid_body.effective_inertia(impacts.W) @ axes
    size = M_c.diagonal(dim1=-2, dim2=-1).sqrt()
    rounding = M_c.abs() < 1e-12 * size[:, :, None] * size[:, None]
    M_c = torch.where(rounding, M_c - M_c.detach(), M_c)  # a disc's M_c,tn is 0, and has a slope
    rows, columns = torch.triu_indices(d, d)
    v = _along_slip(impacts, impacts.v_c)
    return *M_c[:, rows, columns].unbind(-1), v[:, 0], v[:, -1]


def _x2(impacts: Impacts) -> tuple[Tensor, ...]:
    momentum = rigid_body.matvec(rigid_body.effective_inertia(impacts.W), impacts.v_c)
    return _along_slip(impacts, momentum).unbind(-1)


def _x2_polar(impacts: Impacts) -> tuple[Tensor, ...]:
    p_t, p_n = _x2(impacts)
    return torch.atan2(p_t, -p_n), torch.hypot(p_t, p_n)


def _units(unit: str, *symbols: str) -> dict[str, str]:
    return dict.fromkeys(symbols, unit)


_STATE = {"m": "kg", "I": "kg m²", "r_x": "m", "r_y": "m", "x": "m", "y": "m", "cos θ": "–", "sin θ": "–"}
_STATE_IN_SPACE = (
    {"m": "kg"}
    | _units("kg m²", "I_1", "I_2", "I_3")
    | _units("m", "r_1", "r_2", "r_n")
    | _units("–", "g_x", "g_y", "g_z")
    | _units("m/s", "v_1", "v_2", "v_n")
    | _units("rad/s", "ω_1", "ω_2", "ω_n")
)
_X1 = _units("kg", "M_c,tt", "M_c,tn", "M_c,nn") | _units("m/s", "v_t", "v_n")
_X1_IN_SPACE = _units("kg", "M_c,11", "M_c,12", "M_c,1n", "M_c,22", "M_c,2n", "M_c,nn") | _units("m/s", "slip", "v_n")
SPACES = {
    "state": FeatureSpace(_STATE | {"v_x": "m/s", "v_y": "m/s", "ω": "rad/s"}, _STATE_IN_SPACE, _state),
    "x1": FeatureSpace(_X1, _X1_IN_SPACE, _x1),
    "x2": FeatureSpace(_units("N s", "p_t", "p_n"), _units("N s", "p_1", "p_2", "p_n"), _x2),
    "x2_polar": FeatureSpace({"angle": "rad", "norm": "N s"}, {}, _x2_polar),
}
"""Each feature space by name."""


def feature_units(name: str, space: Space) -> dict[str, str]:
    """Return the symbols of a feature space with their units.

    Raises:
        UnknownNameError: no such feature space.
        ContactLearnError: it does not exist in space.
    """
    if name not in SPACES:
        raise UnknownNameError("feature space", name, SPACES)
    if space is PLANE:
        return SPACES[name].columns
    if not SPACES[name].in_space:
        require_space(f"the feature space {name}", space)
    return SPACES[name].in_space


@dataclass(frozen=True, kw_only=True, eq=False)
class Features:
    """A feature space of N impacts.

    Args:
        values: float64 in SI units.
        units: of the D columns by their symbols, in the order of the columns; "–" without a unit.
        trial: names of the impacts.
    """

    values: Float[Tensor, "n d"]
    units: dict[str, str]
    trial: tuple[str, ...]

    @classmethod
    def of(cls, impacts: Impacts, space: str) -> "Features":
        """Compute a feature space: `state`, `x1`, `x2` or `x2_polar`.

        Raises:
            UnknownNameError: no such space.
            ContactLearnError: the bodies move in space, where it does not exist.
        """
        units = feature_units(space, impacts.space)
        return cls(values=torch.stack(SPACES[space].compute(impacts), -1), units=units, trial=impacts.trial)

    def table(self) -> "pd.DataFrame":
        """Return a row a trial: its name, and a column for each feature with its unit, such as `v_t (m/s)`."""
        import pandas as pd

        names = [f"{symbol} ({unit})".removesuffix(" (–)") for symbol, unit in self.units.items()]
        frame = pd.DataFrame(self.values.cpu().numpy(), columns=names)
        frame.insert(0, "trial", list(self.trial))
        return frame
