"""One impact in space, in the axes of its slip: 1 along the slip before contact, 2 across it, n up.

    slip_hodograph    the slip before contact and after it, by each law and as measured, and Routh's path between them
    body_at_contact   the body with its velocities before and after contact, as measured and as predicted

Distances across the slip are drawn obliquely, at 45° and half their length (a cabinet projection), so that the plane of
slip and normal is to scale.  Source of the path: Keller (1986).
"""

from collections.abc import Mapping
from typing import Any

import torch
from jaxtyping import Float
from matplotlib.figure import Figure
from torch import Tensor

from contactlearn.inference.evaluation.bounds import irb
from contactlearn.laws import Law
from contactlearn.laws.contact import SpatialContact
from contactlearn.laws.hodograph import Hodograph, after_impulse
from contactlearn.mechanics import rigid_body
from contactlearn.mechanics.bodies import shapes_among
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.report.figures import style as st

_OBLIQUE = 0.5**1.5  # half the length, at 45°
CABINET = torch.tensor([[1, _OBLIQUE, 0], [0, _OBLIQUE, 1]], dtype=torch.float64)
"""The projection of points in space, the second axis away from the eye."""
_STEPS = 24  # of a path
_POINT: dict[str, Any] = {"markersize": 8, "markeredgecolor": "white", "markeredgewidth": 0.7, "linestyle": "none"}


def slip_after(impacts: Impacts, v_post: Float[Tensor, "*batch n 6"]) -> Float[Tensor, "*batch n 2"]:
    """Slip [..., N, 2] of the contact point with a velocity of the body, along the slip before contact and across."""
    v_c = rigid_body.contact_velocity(impacts.r, v_post)
    return rigid_body.matvec(impacts.slip_axes.mT[:, :2, :2], v_c[..., :2])


def slip_paths(impacts: Impacts, law: Law, steps: int = _STEPS) -> Float[Tensor, "n {steps}+1 2"]:
    """Routh's path of the slip [N, steps + 1, 2] in m/s at the friction of a law, up to its normal impulse."""
    contact, _ = SpatialContact.of(impacts.W, impacts.v_c)
    path, P_n = Hodograph(contact, law.coefficients[0].to(impacts.mass)), law.impulse(impacts.W, impacts.v_c)[:, 2]
    shares = torch.linspace(0, 1, steps + 1, dtype=torch.float64).to(P_n)
    points = [path.followed(path.start(), after_impulse(share * P_n)) for share in shares]
    return torch.stack([torch.stack((one.v_1, one.v_2), -1) for one in points], 1)


@st.look()
def slip_hodograph(trial: Impacts, laws: Mapping[str, Law], prediction: Prediction | None = None) -> Figure:
    """Draw the slip of one impact before and after contact, and the path between them at the friction of the first law.

    Args:
        trial: one impact in space.
        laws: at their identified parameters, by name.
        prediction: of a further model; None for a browser, whose script places it.
    """
    figure = st.new_figure(st.COLUMN, 3.9)
    axes = st.name_axes(figure.subplots(), "Slip along its first direction (m/s)", "Slip across it (m/s)")
    axes.axhline(0, color="#AAAAAA", linewidth=0.6, zorder=1)
    axes.axvline(0, color="#AAAAAA", linewidth=0.6, zorder=1)
    first = next(iter(laws.values()))
    path: dict[str, Any] = {"color": st.law_style(first.name).color, "label": "Routh's path", "gid": "path"}
    axes.plot(*st.array(slip_paths(trial, first)[0]).T, **path, zorder=2)
    axes.plot(*st.array(slip_after(trial, trial.v_pre)[0]), "o", color=st.DARK, label="Before", gid="before", zorder=3)
    for place, law in enumerate(laws.values()):
        style = st.law_style(law.name)
        end = trial.v_c + rigid_body.matvec(trial.W, law.impulse(trial.W, trial.v_c))
        end = rigid_body.matvec(trial.slip_axes.mT[:, :2, :2], end[:, :2])[0]
        axes.plot(*st.array(end), style.marker, color=style.color, **_POINT, label=style.label, gid=f"law {place}")
    ends = {"Measured": ("x", trial.v_post, "black")}
    if prediction is not None:
        ends["IRB bound"] = ("o", irb(trial).v_post, st.DARK)
    ends["Chosen model"] = ("s", (prediction or trial).v_post, st.CONTRAST[1])
    for label, (marker, v_post, color) in ends.items():
        look: dict[str, Any] = {"color": color, "markerfacecolor": "white", "markersize": 7, "linestyle": "none"}
        axes.plot(*st.array(slip_after(trial, v_post)[0]), marker, **look, label=label, gid=label, zorder=6)
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
