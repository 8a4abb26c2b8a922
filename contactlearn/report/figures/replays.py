"""Predicted trajectories beside recorded ones: bodies at a few times, and errors over time and over bounces."""

import itertools
from collections.abc import Sequence

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from contactlearn.inference.evaluation.replay import Replay
from contactlearn.mechanics.rigid_body import in_world
from contactlearn.report.figures import style as st
from contactlearn.report.figures.contact_in_space import CABINET

_BINS = 30  # of time
_MIN_RECORDINGS = 5  # recordings of which quartiles are drawn
_DEGREES = 180 / np.pi
_TIMES = 6  # at which bodies are drawn


@st.look()
def replay_figure(replays: Sequence[Replay]) -> Figure:
    """Draw medians and, dotted, quartiles over recordings: distance and angle over time, distance over bounces."""
    figure = st.new_figure(st.PAGE, 2.4 + st.ROW * len(replays[0].predicted))
    panels = figure.subplots(1, 3)
    longest = float(np.quantile([replay.time[-1].item() for replay in replays], 0.9))
    bins = [(replay.time / longest * _BINS).long() for replay in replays]
    for color, model in zip((*st.CONTRAST, st.DARK), replays[0].predicted, strict=False):
        errors = [replay.errors(model) * torch.tensor([100.0, _DEGREES]) for replay in replays]
        for k, axes in enumerate(panels[:2]):
            over = _quartiles([e[:, k] for e in errors], bins, _BINS)
            _draw(axes, (np.arange(_BINS) + 0.5) * longest / _BINS, over, color, model)
        bounces = [replay.bounces for replay in replays]
        most = max(int(b.max()) for b in bounces) + 1
        _draw(panels[2], np.arange(most), _quartiles([e[:, 0] for e in errors], bounces, most), color, model)
    st.name_axes(panels[0], "Time (s)", "Distance (% of the width)")
    st.name_axes(panels[1], "Time (s)", "Angle (°)")
    st.name_axes(panels[2], "Bounces", "Distance (% of the width)")
    figure.legend(handles=panels[0].lines[::3], loc="outside upper left")
    return figure


@st.look()
def bodies_figure(replay: Replay) -> Figure:
    """Draw the recorded body and the predicted ones at equal times; in space in a cabinet projection."""
    models, d = [*replay.predicted], 2 if replay.recorded.shape[1] == 3 else 3
    figure = st.new_figure(st.PAGE, 4.0 + st.ROW * len(models))
    panels = figure.subplots(2, _TIMES // 2, sharex=True, sharey=True, squeeze=False).ravel()
    outline, flat = replay.shape.outline(61), torch.eye(2, dtype=torch.float64) if d == 2 else CABINET
    every = torch.cat((replay.recorded, *replay.predicted.values()))[:, :d]
    low, high = every.amin(0) - outline.nan_to_num(0).amax(), every.amax(0) + outline.nan_to_num(0).amax()
    corners = [(0, 0), (1, 0), (1, 1), (0, 1), (0, 0)][: 2 if d == 2 else None]
    floor = torch.tensor([[(low, high)[end][axis] for axis, end in enumerate(c[: d - 1])] + [0.0] for c in corners])
    for axes, frame in zip(panels, np.linspace(0, len(replay.time) - 1, _TIMES).astype(int), strict=True):
        axes.plot(*st.array(floor.double() @ flat.mT).T * st.MILLI, color="#888888", linewidth=0.8)
        poses = {"Recorded": replay.recorded} | replay.predicted
        for (name, pose), color in zip(poses.items(), (st.DARK, *st.CONTRAST, "#888888"), strict=False):
            body = in_world(outline, pose[frame].expand(len(outline), -1)) + pose[frame, :d]
            width = 1.8 if name == "Recorded" else 0.9
            axes.plot(*st.array(body @ flat.mT).T * st.MILLI, color=color, linewidth=width, label=st.plain(name, 110))
        axes.set_aspect("equal")
        axes.set_title(f"{replay.time[frame]:.3f} s")
    st.name_axes(panels[_TIMES // 2], "x (mm)", "Height (mm)")
    figure.suptitle(f"Recording {st.plain(replay.recording)}")
    figure.legend(handles=panels[0].lines[1:], loc="outside lower center")
    return figure


@st.look()
def fan_figure(replays: Sequence[Replay], shown: Replay, model: str) -> Figure:
    """Draw the recorded positions of one recording in its fan, and how many of all lie within such bands over time.

    The bands hold 90 % and the darker ones 50 % of the trajectories, with the noise of the frames; lines are recorded
    contacts.
    """
    fan, d = shown.fans[model], len(shown.noise)
    color, time = st.CONTRAST[0], st.array(shown.time[: fan.shape[1]])
    figure = st.new_figure(st.PAGE, 2.9)
    panels = figure.subplots(1, 3)
    for axes, k, name in zip(panels, (0, d - 1), ("x (mm)", "Height (mm)"), strict=False):
        low, high = st.array(shown.band(model)[..., k]) * st.MILLI
        inner = np.quantile(st.array(fan[..., k]), (0.25, 0.75), axis=0) * st.MILLI
        axes.fill_between(time, low, high, color=st.tint(color, 0.3), linewidth=0, label="90 % of the fan")
        axes.fill_between(time, *inner, color=st.tint(color, 0.7), linewidth=0, label="50 %")
        recorded = st.array(shown.recorded[: len(time), k]) * st.MILLI
        axes.plot(time, recorded, ".", color=st.DARK, markersize=2.5, label="Recorded")
        for when in time[1:][np.diff(st.array(shown.bounces[: len(time)])) > 0]:
            axes.axvline(when, color=st.DARK, linewidth=0.6, linestyle=":")
        st.name_axes(axes, "Time (s)", name)
    share = [st.array(100 * replay.inside(model).double().mean(-1)) for replay in replays]
    since = [st.array(one.time[: len(held)]) - _first_bounce(one) for one, held in zip(replays, share, strict=True)]
    every, held = np.concatenate(since), np.concatenate(share)
    edges = np.linspace(0, np.quantile(every, 0.95), 13)
    means = [held[(every >= a) & (every < b)].mean() for a, b in itertools.pairwise(edges)]
    panels[2].axhspan(85, 95, color=st.tint(st.DARK, 0.12), linewidth=0)
    panels[2].plot((edges[1:] + edges[:-1]) / 2, means, "o-", color=st.CONTRAST[1], markersize=3.5)
    panels[2].set_ylim(0, 102)
    st.name_axes(panels[2], "Time since the first bounce (s)", "Positions within 90 % bands (%)")
    figure.suptitle(f"Recording {st.plain(shown.recording)}; {len(replays)} recordings")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def _first_bounce(replay: Replay) -> float:
    """Time of the first frame after a bounce; infinite without one."""
    after = (replay.bounces > 0).nonzero()
    return replay.time[after[0, 0]].item() if len(after) else np.inf


def _quartiles(errors: Sequence[torch.Tensor], places: Sequence[torch.Tensor], count: int) -> np.ndarray:
    """Quartiles [count, 3] over recordings of their mean errors at each place; NaN where these are few."""
    means = np.full((len(errors), count), np.nan)
    for row, (error, place) in enumerate(zip(errors, places, strict=True)):
        for k in place.unique().tolist():
            if k < count:
                means[row, k] = error[place == k].mean()
    quartiles = np.full((count, 3), np.nan)
    enough = np.isfinite(means).sum(0) >= min(_MIN_RECORDINGS, len(errors))
    quartiles[enough] = np.nanquantile(means[:, enough], (0.25, 0.5, 0.75), axis=0).T
    return quartiles


def _draw(axes: Axes, x: np.ndarray, quartiles: np.ndarray, color: str, label: str) -> None:
    there = np.isfinite(quartiles[:, 1])
    low, middle, high = quartiles[there].T
    axes.plot(x[there], middle, color=color, label=st.plain(label, 110))
    for quartile in (low, high):
        axes.plot(x[there], quartile, color=color, linestyle=":", linewidth=0.8)
