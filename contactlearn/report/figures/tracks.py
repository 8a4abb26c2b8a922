"""Recordings as they were searched for impacts, for paper; the page of recordings shows each of them.

contact_figure     a recording about one contact: both flights, their residuals, the body at contact
residuals_figure   residuals of all flights in units of the stated noise: are the stated errors right?
"""

import math
from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float
from matplotlib.figure import Figure

from contactlearn.core.numerics import measured
from contactlearn.data.recordings.result import Found, Hit
from contactlearn.data.recordings.poses import Array, turn
from contactlearn.mechanics.rigid_body import rotate
from contactlearn.mechanics.shapes import Shape
from contactlearn.report.figures import style as st

_BLUE, _RED, _YELLOW = st.CONTRAST
_LABELS = ("x (m)", "y (m)", "θ (rad)")
_UNITS = (1e3, 1e3, 180 / math.pi)  # mm, mm and degrees of residuals
_VELOCITIES = [
    (f"{name}{when}", unit) for when in ("", "⁺") for name, unit in (("v_x", "m/s"), ("v_y", "m/s"), ("ω", "rad/s"))
]


@st.look()
def contact_figure(found: Found, contact: Hit, shape: Shape) -> Figure:
    """Draw x, y and θ over time with both flights and the instant of contact, residuals below, and the body there."""
    track, flights = found.track, found.flights[contact.flight : contact.flight + 2]
    figure = st.new_figure(st.PAGE, 4.2)
    panels = figure.subplots(2, 4, height_ratios=(2, 1))
    for k, label in enumerate(_LABELS):
        upper, lower = panels[0, k], panels[1, k]
        for flight, color, late in zip(flights, (_BLUE, _RED), (0, contact.missing), strict=True):
            time = track.time[flight.frames]
            line = flight.poses(time)[:, k]
            seen = line + flight.residual[:, k]
            upper.plot(time + late * track.step, seen, ".", color="0.5", markersize=2)
            upper.plot(time + late * track.step, line, color=color, linewidth=0.7)
            lower.plot(time + late * track.step, _UNITS[k] * flight.residual[:, k], ".", color=color, markersize=2)
        for axes in (upper, lower):
            axes.axvline(contact.time, color="0.3", linewidth=0.6)
        st.name_axes(upper, "", label)
        st.name_axes(lower, "Time (s)", f"Residual ({('mm', 'mm', '°')[k]})")
    body = panels[0, 3]
    outline = rotate(shape.outline(), torch.tensor(float(contact.pose[2]), dtype=torch.float64)).numpy()
    body.plot(outline[:, 0] + contact.pose[0], outline[:, 1] + contact.pose[1], color=_BLUE)
    body.axhline(float(outline[:, 1].min() + contact.pose[1]), color="0.3", linewidth=0.8)
    body.set_aspect("equal", adjustable="datalim")
    st.name_axes(body, "x (m)", "y (m)")
    panels[1, 3].axis("off")
    errors = np.sqrt(contact.covariance.diagonal())
    values = zip(_VELOCITIES, (*contact.v_pre, *contact.v_post), errors[:6].tolist(), strict=True)
    text = "\n".join(f"{name} = {measured(float(value), error, unit)}" for (name, unit), value, error in values)
    panels[1, 3].text(0, 1, text, va="top", fontsize="x-small")
    figure.suptitle(f"{st.plain(contact.name)}: contact at {contact.time:.5f} s ± {1e6 * errors[9]:.2g} µs")
    return figure


@st.look()
def residuals_figure(founds: Sequence[Found]) -> Figure:
    """Draw the distribution of residuals in standard deviations and the normal one, for x, y and θ."""
    figure = st.new_figure(st.PAGE, 2.2)
    grid, scores = np.linspace(-5, 5, 101), standardised(founds).clip(-5, 5)
    for k, axes in enumerate(figure.subplots(1, 3, sharey=True)):
        axes.hist(scores[:, k], bins=50, range=(-5, 5), density=len(scores) > 0, color=st.tint(_BLUE, 0.5))
        axes.plot(grid, np.exp(-(grid**2) / 2) / math.sqrt(2 * math.pi), color=_RED)
        st.name_axes(axes, f"Residual of {_LABELS[k].split()[0]} in standard deviations", "Density" if k == 0 else "")
    return figure


def standardised(founds: Sequence[Found]) -> Float[Array, "n 3"]:
    """Residuals of all flights in units of their standard deviation, the fit's own share allowed for."""
    parts = [np.zeros((0, 3))]
    for found in founds:
        for flight in found.flights:
            residual = flight.residual.copy()
            residual[:, 2] = turn(residual[:, 2])
            parts.append(residual / found.sigma / math.sqrt(1 - 2 / max(len(residual), 3)))
    return np.concatenate(parts)
