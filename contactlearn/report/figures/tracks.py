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
from matplotlib.ticker import MaxNLocator

from contactlearn.core.numerics import measured
from contactlearn.data.recordings.poses import Array, away, rotated, turn
from contactlearn.data.recordings.result import RecordedContact, SearchedTrack
from contactlearn.mechanics.rigid_body import rotate
from contactlearn.mechanics.shapes import Shape
from contactlearn.mechanics.space import PLANE, SPACE
from contactlearn.report.figures import style as st

_BLUE, _RED, _YELLOW = st.CONTRAST
_DEGREES = 180 / math.pi


@st.look()
def contact_figure(searched: SearchedTrack, contact: RecordedContact, shape: Shape) -> Figure:
    """Draw x, y and θ over time with both flights and the instant of contact, residuals below, and the body there.

    The velocity before and after contact stands above each panel.  In space rotations are counted from the pose at
    contact, and the body is seen along y.
    """
    track, flights = searched.track, searched.flights[contact.flight : contact.flight + 2]
    names, d, rows = residual_names(track.k), track.d, track.k // 3
    errors = np.sqrt(contact.covariance.diagonal())
    figure = st.new_figure(st.PAGE, 3.8 if d == 2 else 7.0)
    panels = figure.subplots(2 * rows, 4, height_ratios=(2, 1) * rows, width_ratios=(1, 1, 1, 0.7))
    symbols = (PLANE if d == 2 else SPACE).symbols
    for k, (name, (symbol, per_second)) in enumerate(zip(names, symbols.items(), strict=True)):
        upper, lower = panels[k // 3 * 2, k % 3], panels[k // 3 * 2 + 1, k % 3]
        unit, fine = ("m", 1e3) if k < d else ("rad", _DEGREES)
        for flight, color, late in zip(flights, (_BLUE, _RED), (0, contact.missing), strict=True):
            time = track.time[flight.frames]
            poses = flight.poses(time)
            line = (poses if d == 2 or k < d else away(poses, contact.pose))[:, k]
            seen = line + flight.residual[:, k]
            upper.plot(time + late * track.step, seen, ".", color="0.5", markersize=2)
            upper.plot(time + late * track.step, line, color=color, linewidth=0.7)
            lower.plot(time + late * track.step, fine * flight.residual[:, k], ".", color=color, markersize=2)
        for axes in (upper, lower):
            axes.axvline(contact.time, color="0.3", linewidth=0.6)
            axes.yaxis.set_major_locator(MaxNLocator(4))
        ends = ((contact.v_pre[k], errors[k]), (contact.v_post[k], errors[track.k + k]))
        before, after = (measured(float(value), error).partition(" ±")[0] for value, error in ends)
        upper.set_title(f"{st.plain(symbol)}: {before} → {after} {per_second}")
        upper.tick_params(labelbottom=False)
        st.name_axes(upper, "", f"{name} ({unit})")
        st.name_axes(lower, "Time (s)", f"Residual ({'mm' if k < d else '°'})")
    for empty in panels[:, -1]:
        empty.remove()
    body, upwards = figure.add_subplot(panels[0, 0].get_gridspec()[:, -1]), d - 1
    outline = (
        shape.outline().numpy() if d == 3 else rotate(shape.outline(), torch.tensor(float(contact.pose[2]))).numpy()
    )
    outline = st.MILLI * (contact.pose[:d] + (rotated(contact.pose[3:], outline) if d == 3 else outline))
    body.plot(outline[:, 0], outline[:, upwards], color=_BLUE)
    body.axhline(float(np.nanmin(outline[:, upwards])), color="0.3", linewidth=0.8)
    body.set_aspect("equal", adjustable="box")
    body.set_title("At contact")
    st.name_axes(body, "x (mm)", f"{names[upwards]} (mm)")
    figure.align_ylabels()
    when = f"{contact.time:.5f} s ± {1e6 * errors[-1]:.2g} µs"
    figure.suptitle(f"Recording {st.plain(contact.recording)}, contact {contact.number}: {when}")
    return figure


@st.look()
def residuals_figure(tracks: Sequence[SearchedTrack]) -> Figure:
    """Draw the distribution of residuals in standard deviations and the normal one, for each coordinate."""
    figure = st.new_figure(st.PAGE, 2.2)
    grid, scores = np.linspace(-5, 5, 101), standardised(tracks).clip(-5, 5)
    names = residual_names(scores.shape[1])
    for k, axes in enumerate(figure.subplots(1, len(names), sharey=True)):
        axes.hist(scores[:, k], bins=50, range=(-5, 5), density=len(scores) > 0, color=st.tint(_BLUE, 0.5))
        axes.plot(grid, np.exp(-(grid**2) / 2) / math.sqrt(2 * math.pi), color=_RED)
        st.name_axes(
            axes,
            f"Residual of {names[k]} in standard deviations" if len(names) == 3 else f"{names[k]} (σ)",
            "Density" if k == 0 else "",
        )
    return figure


def residual_names(coordinates: int) -> tuple[str, ...]:
    """Name the coordinates of residuals: three in the plane, six in space."""
    return ("x", "y", "θ") if coordinates == 3 else ("x", "y", "z", "θ_x", "θ_y", "θ_z")


def standardised(tracks: Sequence[SearchedTrack]) -> Float[Array, "n k"]:
    """Residuals of all flights in units of their standard deviation, the fit's own share allowed for."""
    parts = [np.zeros((0, tracks[0].track.k if tracks else 3))]
    for searched in tracks:
        for flight in searched.flights:
            residual = flight.residual.copy()
            if searched.track.d == 2:
                residual[:, 2] = turn(residual[:, 2])
            parts.append(residual / flight.sigma / math.sqrt(1 - 2 / max(len(residual), 3)))
    return np.concatenate(parts)
