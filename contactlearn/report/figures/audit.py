"""The figures of the audit: the evidence for each finding about the measurements.

    audit_figure    the moment balance and the trials' contradictions, or the marked trials

A dot is a trial.  Moments are shown in mN m s, contact points in mm.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from textwrap import wrap

import torch
from jaxtyping import Bool, Float, Real
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from torch import Tensor

from contactlearn.core.numerics import MAD_SCALE
from contactlearn.data.audit.conventions import contradictions
from contactlearn.data.audit.moments import balance, kinetic_energy, torque
from contactlearn.data.audit.result import Finding
from contactlearn.data.audit.thresholds import AuditThresholds
from contactlearn.data.audit.trials import ENERGY_GAIN, gross_outliers, outliers
from contactlearn.mechanics.bodies import contact_points, shapes_among
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import rotate
from contactlearn.report.figures import style as st
from contactlearn.report.text import sentence

_BLUE, _RED, _ = st.CONTRAST
_ROW = "Trial, in the order read (–)"
_QUESTIONS = {
    "moment": "moments do not balance",
    "approach": "does not approach",
    "leaves": "does not leave",
    "push": "floor pulls",
    "below": "floor is above",
    "friction": "friction along slip",
    "energy": "gains energy",
    "units": "implausible units",
    "shape": "contact off shape",
}
_VECTOR = 5000  # dots that a PDF draws one by one


_OF_MODELS = ("measurement_drift", "model_outliers")  # findings about residuals, which the impacts alone do not show


def drawable(finding: Finding) -> bool:
    """Return whether the impacts show the evidence for a finding."""
    return finding.name not in _OF_MODELS


@st.look()
def audit_figure(
    finding: Finding, before: Impacts, after: Impacts, thresholds: AuditThresholds = AuditThresholds()
) -> Figure:
    """Draw the evidence for a finding, under its sentence.

    A finding about units, axes or inertia shows both sides of the moment balance and how much the trials contradict
    themselves, without its correction and with it, the outermost percent of the moments left out; the others mark the
    trials that they are about.

    Args:
        finding: of the audit.
        before, after: impacts without and with its correction, the corrections of earlier findings made in both.
        thresholds: with which it was found; the same limits are drawn.
    """
    draw, width, height = _EVIDENCE.get(finding.name, (_frame, st.PAGE, 2.85))
    lines = wrap(sentence(finding.sentence), 112 if width == st.PAGE else 54, max_lines=6, placeholder=" …")
    figure = st.new_figure(width, height + st.ROW * len(lines))
    figure.suptitle("\n".join(st.plain(line, 120) for line in lines))
    draw(figure, finding, before, after, thresholds)
    return figure


def _frame(figure: Figure, finding: Finding, before: Impacts, after: Impacts, thresholds: AuditThresholds) -> None:
    """The moment balance, and how much the trials contradict themselves, without and with a correction."""
    name = finding.correction
    titles = (f"Without {name}", f"With {name}") if name else ("As read", "Under the best hypothesis")
    shown = dict(zip(titles, (before, after)[: 1 if after is before else 2], strict=False))
    *panels, axes = figure.subplots(1, len(shown) + 1, width_ratios=(*(1 for _ in shown), 0.8))
    for panel, (title, impacts) in zip(panels, shown.items(), strict=True):
        _draw_balance(panel, title, impacts)
    _draw_contradictions(axes, shown, thresholds)
    legend_below(figure, panels[0], axes)


def _draw_balance(axes: Axes, title: str, impacts: Impacts) -> None:
    """I Δω against r_x P_n − r_y P_t, trial by trial, with the two slopes of the fitted balance."""
    terms, fit = torque(impacts), balance(impacts)
    moments = impacts.inertia * st.MILLI * torch.stack((terms.normal + terms.tangential, terms.spin))
    reach = 1.1 * moments.abs().amax(0).quantile(0.99).item()
    power = 0 if 1e-2 < reach < 1e4 else math.floor(math.log10(reach))
    unit = f"$10^{{{power}}}$ mN m s" if power else "mN m s"
    st.name_axes(axes, f"r_x P_n − r_y P_t ({unit})", f"I Δω ({unit})")
    dots(axes, *moments / 10**power)
    axes.axline((0, 0), slope=1, color=_RED, label="Slope 1: balanced")
    axes.set(xlim=(-reach / 10**power, reach / 10**power), ylim=(-reach / 10**power, reach / 10**power))
    axes.set_box_aspect(1)
    axes.xaxis.set_major_locator(MaxNLocator(4))
    axes.yaxis.set_major_locator(MaxNLocator(4))
    values = (("a", fit.a, fit.a_error), ("b", fit.b, fit.b_error))
    lines = (f"{x} = {y:+#.3g} ± {error:.1g}" if error < math.inf else f"{x} is open" for x, y, error in values)
    axes.set_title("\n".join((title, *lines)).replace("-", "−"))


def _draw_contradictions(axes: Axes, shown: Mapping[str, Impacts], thresholds: AuditThresholds) -> None:
    """The mean contradiction of each kind, of the impacts by title."""
    answers = {title: contradictions(impacts) for title, impacts in shown.items()}
    means = {title: [answer.mean().item() for answer in known.values()] for title, known in answers.items()}
    questions = [_QUESTIONS[key] for key in next(iter(answers.values()))]
    places = range(len(questions))
    st.name_axes(axes, "Mean contradiction (–)")
    ends = [*means.values()]
    axes.hlines(places, ends[0], ends[-1], color=st.DARK, linewidth=0.8)
    for size, face, (title, values) in zip((5, 4), ("white", _BLUE), means.items(), strict=False):
        axes.plot(values, places, "o", color=_BLUE, markerfacecolor=face, markersize=size, label=title)
    axes.set_yticks(places, questions)
    axes.set_xlim(-0.04, 1.04)
    axes.set_box_aspect(1 / 0.8)
    axes.invert_yaxis()


@dataclass(frozen=True)
class _Reason:
    """A quantity [N] that makes trials gross outliers beyond its limits, and its axis label."""

    label: str
    values: Float[Tensor, " n"]
    limits: tuple[float, ...]


def _reasons(impacts: Impacts, limits: AuditThresholds) -> dict[str, _Reason]:
    """The quantity behind each reason of `gross_outliers`.

    A moment beyond its limit is gross only where it is a third of its own terms as well.
    """
    energy, rebound = kinetic_energy(impacts)
    residual = torque(impacts).residual.abs()
    ratios = torch.stack([_of_object(impacts, values) for values in (impacts.mass, impacts.inertia)])
    furthest = ratios.gather(0, ratios.log().abs().argmax(0)[None])[0]
    return {
        "moment": _Reason("|τ|/I (rad/s)", residual, (limits.moment_sigmas * MAD_SCALE * residual.median().item(),)),
        "energy": _Reason("E_post/E_pre (–)", rebound / energy, (limits.gross_ratio,)),
        "approach": _Reason("v_n (m/s)", impacts.v_c[:, 1], (0.0,)),
        "mass": _Reason("m or I, of its\nobject's median (–)", furthest, (1 / limits.gross_ratio, limits.gross_ratio)),
    }


def _outliers(figure: Figure, finding: Finding, before: Impacts, after: Impacts, thresholds: AuditThresholds) -> None:
    """A panel for each reason, in which its outliers are marked and named."""
    reasons = {name: bad for name, bad in gross_outliers(before, thresholds).items() if bad.any() or name == "moment"}
    shown = _reasons(before, thresholds)
    panels = figure.subplots(len(reasons), 1, sharex=True, squeeze=False)[:, 0]
    figure.set_figheight(figure.get_figheight() + 1.3 * (len(reasons) - 1))
    rows = torch.arange(1, len(before) + 1)
    for axes, (name, bad) in zip(panels, reasons.items(), strict=True):
        reason = shown[name]
        st.name_axes(axes, y=reason.label)
        if name != "approach":
            st.scale_logarithmically(axes, (1, 2, 5) if reason.values.max() < 300 * reason.values.min() else (1,))
        dots(axes, rows[~bad], reason.values[~bad])
        axes.plot(st.array(rows[bad]), st.array(reason.values[bad]), "x", color=_RED, label="Gross outlier")
        for limit in reason.limits:
            axes.axhline(limit, color=_BLUE, linestyle="--", linewidth=0.9, label="Limit")
        _name_trials(axes, before, bad, reason.values)
        axes.margins(x=0.03, y=0.25)
    panels[-1].set_xlabel(_ROW)
    legend_below(figure, panels[0])


def _name_trials(axes: Axes, impacts: Impacts, bad: Bool[Tensor, " n"], values: Float[Tensor, " n"]) -> None:
    """Names beside bad trials, as far as a name overlaps no other."""
    free, trials = 0.0, len(impacts)  # from which row on a name overlaps no other
    for row in (bad.nonzero()[:, 0] + 1).tolist():
        name, turned = st.plain(impacts.trial[row - 1], 14), row > 0.8 * trials
        length = (0.03 + 0.012 * len(name)) * trials
        if row - turned * length >= free:
            side, ha = (-3, "right") if turned else (3, "left")
            place = row, values[row - 1].item()
            axes.annotate(name, place, (side, 3), textcoords="offset points", va="bottom", ha=ha)
            free = row + (0.02 * trials if turned else length)


def _of_object(impacts: Impacts, values: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
    """Values relative to the median of the same object's trials."""
    ratio = torch.empty_like(values)
    for name in set(impacts.object):
        same = torch.tensor([other == name for other in impacts.object])
        ratio[same] = values[same] / values[same].median()
    return ratio


def _energy(figure: Figure, finding: Finding, before: Impacts, after: Impacts, thresholds: AuditThresholds) -> None:
    energy, rebound = kinetic_energy(before[~outliers(before, thresholds)])
    axes = st.name_axes(figure.subplots(), "E_post/E_pre (–)", "Trials (count)")
    axes.hist(st.array(rebound / energy), 30, color=st.tint(_BLUE, 0.45), edgecolor=_BLUE, linewidth=0.4)
    axes.axvline(1, color=_RED, label="As much as before")
    axes.axvline(ENERGY_GAIN, color=_RED, linestyle="--", label=f"{ENERGY_GAIN - 1:.0%} more")
    axes.set_xlim(left=0)
    legend_below(figure, axes)


def _shape(figure: Figure, finding: Finding, before: Impacts, after: Impacts, thresholds: AuditThresholds) -> None:
    sound = before[~outliers(before, thresholds)]
    assert sound.shape is not None  # the finding is about it
    expected = contact_points(sound.shape, sound.body, sound.q[:, 2])
    panels = figure.subplots(1, 2)
    for axes, letter, given, own in zip(panels, "xy", sound.r.mT * st.MILLI, expected.mT * st.MILLI, strict=True):
        st.name_axes(axes, f"r_{letter} of the shape at θ (mm)", f"r_{letter} measured (mm)")
        dots(axes, own, given)
        axes.axline((own.mean().item(),) * 2, slope=1, color=_RED, label="As the shape")
    legend_below(figure, panels[0])


def _outline(figure: Figure, finding: Finding, before: Impacts, after: Impacts, thresholds: AuditThresholds) -> None:
    axes = st.name_axes(figure.subplots(), "Along the body's x (mm)", "Along the body's y (mm)")
    dots(axes, *rotate(after.r, -after.q[:, 2]).mT * st.MILLI, label="Contact point")
    for shape in shapes_among(after.shape).values():
        axes.plot(*st.array(shape.outline().mT * st.MILLI), color=_RED, linewidth=0.8, label="Outline")
    axes.set_aspect("equal", "datalim")
    legend_below(figure, axes)


def _duplicates(figure: Figure, finding: Finding, before: Impacts, after: Impacts, thresholds: AuditThresholds) -> None:
    numbers, first = torch.cat((before.r, before.q, before.v_pre, before.v_post), -1), {}
    rows = torch.arange(1, len(before) + 1)
    original = torch.tensor([first.setdefault(tuple(row), k) for k, row in enumerate(numbers.tolist(), 1)])
    again = original < rows
    axes = st.name_axes(figure.subplots(), _ROW, "First trial with these numbers (–)")
    dots(axes, rows[~again], original[~again])
    axes.plot(rows[again], original[again], "x", color=_RED, label="Repeated trial")
    axes.margins(x=0.03)
    legend_below(figure, axes)


def _order(figure: Figure, finding: Finding, before: Impacts, after: Impacts, thresholds: AuditThresholds) -> None:
    assert before.time is not None  # the finding is about it
    by_order = before.order.argsort(stable=True)
    order, time = before.order[by_order], before.time[by_order]
    back = torch.cat((torch.zeros(1, dtype=torch.bool), time.diff() < 0))
    axes = st.name_axes(figure.subplots(), "Order of the trial (–)", "Time of contact (s)")
    axes.plot(st.array(order), st.array(time), color=st.tint(st.DARK, 0.35), linewidth=0.5, zorder=1)
    dots(axes, order[~back], time[~back])
    axes.plot(st.array(order[back]), st.array(time[back]), "x", color=_RED, markersize=3.5, label="Before the last one")
    legend_below(figure, axes)


_EVIDENCE = {
    "gross_outliers": (_outliers, st.PAGE, 2.0),
    "energy_gained": (_energy, st.COLUMN, 2.5),
    "contact_point_off_shape": (_shape, st.PAGE, 2.8),
    "traced_shape": (_outline, st.COLUMN, 2.7),
    "duplicated_trials": (_duplicates, st.COLUMN, 2.7),
    "out_of_order": (_order, st.COLUMN, 2.7),
}
"""By finding, how it is drawn and the figure's width and height in inches without the sentence; others are `_frame`."""


def dots(axes: Axes, x: Real[Tensor, " n"], y: Real[Tensor, " n"], label: str = "Trial") -> None:
    """Draw a dot for each trial, x and y in the units of the axes."""
    axes.plot(
        st.array(x), st.array(y), ".", color=st.tint(st.DARK, 0.35), markersize=2.5, label=label, zorder=1,
        rasterized=len(x) > _VECTOR,
    )  # fmt: skip


def legend_below(figure: Figure, *panels: Axes) -> None:
    """Draw one legend below a figure for the artists of some of its panels, each label once."""
    handles = {}
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    columns = 2 if figure.get_figwidth() == st.COLUMN else 5
    figure.legend([*handles.values()], [*handles], loc="outside lower center", ncols=columns)
