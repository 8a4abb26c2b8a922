"""One impact in space, in the axes of its slip: 1 along the slip before contact, 2 across it, n up.

    slip_hodograph    the slip before contact and after it, by each law and as measured, and Routh's path between them
    body_at_contact   the body with its velocities before and after contact, as measured and as predicted

Distances across the slip are drawn obliquely, at 45° and half their length (a cabinet projection), so that the plane of
slip and normal is to scale.
"""

from typing import Any

import torch
from jaxtyping import Float
from matplotlib.figure import Figure
from torch import Tensor

from contactlearn.inference.evaluation.impulse_space import SlipDiagram
from contactlearn.mechanics import rigid_body
from contactlearn.mechanics.bodies import shapes_among
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.report.figures import style as st

_OBLIQUE = 0.5**1.5  # half the length, at 45°
CABINET = torch.tensor([[1, _OBLIQUE, 0], [0, _OBLIQUE, 1]], dtype=torch.float64)
"""The projection of points in space, the second axis away from the eye."""
_POINT: dict[str, Any] = {"markersize": 8, "markeredgecolor": "white", "markeredgewidth": 0.7, "linestyle": "none"}


@st.look()
def slip_hodograph(slip: SlipDiagram) -> Figure:
    """Draw the slip of one impact before and after contact, and the path between them at the friction of the first law.

    The chosen model of a diagram without one is drawn as measured, for a browser, whose script places it.
    """
    figure = st.new_figure(st.COLUMN, 3.9)
    axes = st.name_axes(figure.subplots(), "Slip along its first direction (m/s)", "Slip across it (m/s)")
    axes.axhline(0, color="#AAAAAA", linewidth=0.6, zorder=1)
    axes.axvline(0, color="#AAAAAA", linewidth=0.6, zorder=1)
    path: dict[str, Any] = {"color": st.law_style(slip.laws[0].name).color, "label": "Routh's path", "gid": "path"}
    axes.plot(*st.array(slip.path).T, **path, zorder=2)
    axes.plot(*st.array(slip.before), "o", color=st.DARK, label="Before", gid="before", zorder=3)
    for place, (law, end) in enumerate(zip(slip.laws, slip.ends, strict=True)):
        style = st.law_style(law.name)
        axes.plot(*st.array(end), style.marker, color=style.color, **_POINT, label=style.label, gid=f"law {place}")
    ends = {"Measured": ("x", slip.measured, "black")}
    if slip.bound is not None:
        ends["IRB bound"] = ("o", slip.bound, st.DARK)
    chosen = slip.measured if slip.predicted is None else slip.predicted
    ends["Chosen model"] = ("s", chosen, st.CONTRAST[1])
    for label, (marker, end, color) in ends.items():
        look: dict[str, Any] = {"color": color, "markerfacecolor": "white", "markersize": 7, "linestyle": "none"}
        axes.plot(*st.array(end), marker, **look, label=label, gid=label, zorder=6)
    axes.set_aspect("equal", adjustable="datalim")
    figure.legend(loc="outside lower center", ncols=2, columnspacing=1.0)
    return figure


@st.look()
def body_at_contact(trial: Impacts, prediction: Prediction) -> Figure:
    """Draw a body at contact: the floor, the edges of its shape, and the velocities of the mass centre.

    The velocity before contact ends at the mass centre, those after it begin there; spins are in the legend.
    """
    axes_of_slip = trial.slip_axes[0, :3, :3]
    oblique = CABINET @ axes_of_slip.mT

    def flat(points: Float[Tensor, "... 3"]) -> Any:
        return st.array(rigid_body.matvec(oblique, points))

    centre, size = -trial.r[0], trial.r[0].norm().item()
    velocities = {"Before": trial.v_pre[0], "Measured": trial.v_post[0], "Predicted": prediction.v_post[0]}
    scale = 1.6 * size / max(v[:3].norm().item() for v in velocities.values())
    figure = st.new_figure(st.COLUMN, 3.0)
    axes = st.name_axes(figure.subplots(), "Along the slip, from the contact (mm)", "Height (mm)")
    corners = 1.5 * size * torch.tensor([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=torch.float64)
    axes.fill(*flat(corners @ axes_of_slip.mT).T * st.MILLI, color="#EFEFEF", zorder=0)
    for shape in list(shapes_among(trial.shape).values())[:1]:
        edges = shape.outline() @ rigid_body.rotation(trial.q[0, 3:]).mT + centre
        axes.plot(*flat(edges).T * st.MILLI, color="#888888", linewidth=0.8, zorder=1)
    axes.plot(*flat(torch.stack((centre, 0 * centre))).T * st.MILLI, ":o", color=st.DARK, markersize=4, zorder=2)
    for (name, v), color in zip(velocities.items(), ("#888888", st.DARK, st.CONTRAST[1]), strict=True):
        ends = torch.stack((centre - scale * v[:3], centre) if name == "Before" else (centre, centre + scale * v[:3]))
        begin, end = flat(ends) * st.MILLI
        axes.annotate("", end, begin, arrowprops={"arrowstyle": "-|>", "color": color, "linewidth": 1.5})
        spin = ", ".join(f"{x:.1f}" for x in v[3:].tolist()).replace("-", "−")
        axes.plot(*(flat(ends).T * st.MILLI), color=color, label=f"{name}, ω = ({spin}) rad/s", linewidth=0.1)
    axes.set_aspect("equal")
    legend = figure.legend(loc="outside lower center")
    for line in legend.get_lines():
        line.set_linewidth(1.5)
    figure.suptitle(f"Trial {st.plain(trial.trial[0])}: velocities {1e3 * scale:.0f} mm per m/s")
    return figure
