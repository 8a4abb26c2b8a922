"""Feature spaces: what a learned model sees of an impact.  `Impacts.features` gives each of them.

    state     10-D    {m, I, r_x, r_y, x, y, θ, v_x, v_y, ω}, θ as (cos θ, sin θ) because it is periodic
    x1        X1      {M_c,tt, M_c,tn, M_c,nn, v_t, v_n}, what the admissible impulses depend on
    x2        X2      M_c v_c, the momentum of the contact point: {p_t, p_n}
    x2_polar  X2      the same as angle from −n and norm, the form that the authors stored

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
from contactlearn.mechanics.space import require_space

if TYPE_CHECKING:  # pandas takes long to load
    import pandas as pd

    from contactlearn.mechanics.impacts import Impacts


class FeatureSpace(NamedTuple):
    """A feature space: its symbols with units, and how it is computed."""

    columns: dict[str, str]
    compute: "Callable[[Impacts], tuple[Tensor, ...]]"


def _state(impacts: "Impacts") -> tuple[Tensor, ...]:
    x, y, theta = impacts.q.unbind(-1)
    pose = x, y, theta.cos(), theta.sin()
    return impacts.mass, impacts.inertia, *impacts.r.unbind(-1), *pose, *impacts.v_pre.unbind(-1)


def _x1(impacts: "Impacts") -> tuple[Tensor, ...]:
    M_c = rigid_body.effective_inertia(impacts.W)
    M_tt, M_tn, M_nn = M_c[:, 0, 0], M_c[:, 0, 1], M_c[:, 1, 1]
    M_tn = torch.where(M_tn.abs() < 1e-12 * (M_tt * M_nn).sqrt(), 0.0, M_tn)  # a disc's is 0 but for rounding
    return M_tt, M_tn, M_nn, *impacts.v_c.unbind(-1)


def _x2(impacts: "Impacts") -> tuple[Tensor, ...]:
    return (rigid_body.effective_inertia(impacts.W) @ impacts.v_c[..., None])[..., 0].unbind(-1)


def _x2_polar(impacts: "Impacts") -> tuple[Tensor, ...]:
    p_t, p_n = _x2(impacts)
    return torch.atan2(p_t, -p_n), torch.hypot(p_t, p_n)


_STATE = {"m": "kg", "I": "kg m²", "r_x": "m", "r_y": "m", "x": "m", "y": "m", "cos θ": "–", "sin θ": "–"}
SPACES = {
    "state": FeatureSpace(_STATE | {"v_x": "m/s", "v_y": "m/s", "ω": "rad/s"}, _state),
    "x1": FeatureSpace({"M_c,tt": "kg", "M_c,tn": "kg", "M_c,nn": "kg", "v_t": "m/s", "v_n": "m/s"}, _x1),
    "x2": FeatureSpace({"p_t": "N s", "p_n": "N s"}, _x2),
    "x2_polar": FeatureSpace({"angle": "rad", "norm": "N s"}, _x2_polar),
}
"""Each feature space by name."""


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
    def of(cls, space: str, impacts: "Impacts") -> "Features":
        """Compute a feature space.

        Raises:
            UnknownNameError: no such space.
            ContactLearnError: the bodies do not move in a plane.
        """
        if space not in SPACES:
            raise UnknownNameError("feature space", space, SPACES)
        require_space(f"the feature space {space}", impacts.space)
        columns, compute = SPACES[space]
        return cls(values=torch.stack(compute(impacts), -1), units=columns, trial=impacts.trial)

    def table(self) -> "pd.DataFrame":
        """Return a row a trial: its name, and a column for each feature with its unit, such as `v_t (m/s)`."""
        import pandas as pd

        names = [f"{symbol} ({unit})".removesuffix(" (–)") for symbol, unit in self.units.items()]
        frame = pd.DataFrame(self.values.cpu().numpy(), columns=names)
        frame.insert(0, "trial", list(self.trial))
        return frame
