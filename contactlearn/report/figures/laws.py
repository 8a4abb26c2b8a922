"""The figures of a comparison and of a fit; each takes plain values or what a fit returned.

    energy_ellipse     Fig. 2.3  impulses that each law can give one impact (module `impulse_space`)
    cost_surface       Fig. 3.3  error of a law over (μ, ε)
    convergence        Fig. 3.4  identified (μ, ε) against the number of trials
    error_comparison   Fig. 3.5  distributions of the error by model
    trial_parameters   Fig. 3.6  (μ_k, ε_k) trial by trial
    patch_curve                  the IRB bound against the half-width of the contact patch

Impulses are shown in mN s, lengths in mm.  The figure numbers are those of Fazeli et al. (2017).
"""

from collections.abc import Mapping, Sequence
from textwrap import wrap
from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from torch import Tensor

from contactlearn.errors import ContactLearnError
from contactlearn.identification.per_trial import TrialFit
from contactlearn.identification.shared import Box, SharedFit
from contactlearn.impacts import Impacts
from contactlearn.report.figures.impulse_space import energy_ellipse
from contactlearn.report.figures.style import (
    BOUNDS,
    COLUMN,
    DARK,
    LAW_STYLE,
    MAP,
    MILLI,
    PAGE,
    array,
    law_style,
    look,
    name_axes,
    new_figure,
    plain,
    save,
    tint,
)

__all__ = [
    "LAW_STYLE",
    "convergence",
    "cost_surface",
    "energy_ellipse",
    "error_comparison",
    "patch_curve",
    "save",
    "trial_parameters",
]

_EPS = "Restitution ε (–)"


def _mu(law: str, variant: str) -> str:
    """Axis label of μ, which the viscous path of one variant measures in s/m."""
    return "Viscous friction μ (s/m)" if (law, variant) == ("mirtich", "fazeli2017") else "Friction μ (–)"


def _title(law: str, variant: str) -> str:
    return plain(law_style(law).label) + ("" if variant == "textbook" else f" ({plain(variant)})")


@look()
def cost_surface(
    mu: Tensor, eps: Tensor, cost: Tensor, best: tuple[float, float], law: str, *, variant: str = "textbook"
) -> Figure:
    """Fig. 3.3: mean impulse error over the parameters, and where it is least.

    Args:
        mu, eps: nodes [A] and [B].
        cost: mean ‖P − P̂‖ [A, B] in N s, as of `fit.cost_surface`.
        best: the identified (μ, ε).
        law, variant: for the title.
    """
    values = array(cost).T * MILLI
    figure = new_figure(COLUMN, 2.75)
    axes = name_axes(figure.subplots(), _mu(law, variant), _EPS)
    levels = MaxNLocator(14).tick_values(values.min(), values.max() + 1e-9 * (1 + abs(values.max())))
    surface = axes.contourf(array(mu), array(eps), values, levels, cmap=MAP)
    surface.set_edgecolor("face")  # no white seams between the levels in a PDF
    axes.plot(*best, "*", color="white", markeredgecolor="black", markersize=11, clip_on=False, zorder=5)
    axes.set_title(f"{_title(law, variant)}: least at μ = {best[0]:.3f}, ε = {best[1]:.3f}")
    bar = figure.colorbar(surface, ax=axes, pad=0.02)
    name_axes(bar.ax, y="Mean impulse error (mN s)")
    return figure


@look()
def convergence(fit: SharedFit) -> Figure:
    """Fig. 3.4: mean (μ, ε) over the repetitions against the number of trials, ± one standard deviation."""
    figure = new_figure(COLUMN, 3.2)
    style, repetitions = law_style(fit.law), len(fit.mu)
    panels = figure.subplots(2, 1, sharex=True)
    for axes, found, label in zip(panels, (fit.mu, fit.eps), (_mu(fit.law, fit.variant), _EPS), strict=True):
        mean = array(found).mean(0)
        marker = "o" if len(fit.sizes) < 12 else ""
        axes.plot(fit.sizes, mean, marker=marker, markersize=3.5, color=style.color, label="Mean", zorder=3)
        if repetitions > 1:
            std = array(found).std(0, ddof=1)
            for sign, name in ((-1, ""), (1, "± 1 standard deviation")):
                axes.plot(fit.sizes, mean + sign * std, "--", color=DARK, linewidth=0.8, label=name or None)
            axes.fill_between(fit.sizes, mean - std, mean + std, color=tint(style.color, 0.25), linewidth=0)
        name_axes(axes, y=label).margins(x=0.02)
    panels[1].set_xlabel("Number of trials k (–)")
    last, flat = fit.sizes[-1], int(fit.mu_flat[:, -1].sum())
    note = f"\nμ is left open by {flat} of them at k = {last}" if flat else ""
    panels[0].set_title(f"{_title(fit.law, fit.variant)}, {repetitions} random subsets{note}")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


@look()
def error_comparison(
    errors: Mapping[str, Tensor], intervals: Mapping[str, tuple[float, float, float]], metric: str
) -> Figure:
    """Fig. 3.5: the distribution of each model's error over the trials, from top to bottom as given.

    Boxes hold the middle half with the median, whiskers end at the 5th and 95th percentile; below
    each, a dot and a bar are the mean and its 95 % interval.  The bounds are hatched.

    Args:
        errors: per-trial errors [N] by model: a name or label of `LAW_STYLE`, or any other text.
        intervals: (mean, low, high) by model.
        metric: axis label with its unit.

    Raises:
        ContactLearnError: no models, no interval for one, or errors that are not finite.
    """
    if not errors or errors.keys() - intervals.keys():
        missing = ", ".join(errors.keys() - intervals.keys()) or "any model"
        raise ContactLearnError(f"error_comparison needs errors and an interval for each model, got none for {missing}")
    figure = new_figure(COLUMN, 0.75 + 0.34 * len(errors))
    axes = name_axes(figure.subplots(), metric)
    labels = []
    for place, (name, values) in enumerate(errors.items()):
        style, values = law_style(name), array(values)
        if not np.isfinite(values).all():
            raise ContactLearnError(
                f"errors of {name!r} must be finite, got {(~np.isfinite(values)).sum()} that are not"
            )
        bound = style.label in (LAW_STYLE[key].label for key in BOUNDS)
        box = axes.boxplot(
            values, positions=[place - 0.1], orientation="horizontal", widths=0.42, whis=(5, 95), showfliers=False,
            patch_artist=True, capwidths=0.2, manage_ticks=False,
            boxprops={"facecolor": "white" if bound else tint(style.color, 0.45), "edgecolor": style.color},
            medianprops={"color": DARK}, whiskerprops={"color": style.color}, capprops={"color": style.color},
        )  # fmt: skip
        if bound:
            box["boxes"][0].set(hatch="/////", linestyle="-")
        mean, low, high = intervals[name]
        dot = axes.errorbar(
            mean, place + 0.28, xerr=((mean - low,), (high - mean,)), fmt="o", color=DARK, markersize=2.5,
            elinewidth=0.8, capsize=2.5, capthick=0.8,
        )  # fmt: skip
        labels.append("\n".join(plain(line) for line in wrap(style.label, 16, max_lines=2, placeholder="…")))
    axes.set_yticks(range(len(labels)), labels)
    axes.tick_params(axis="y", length=0)
    axes.set_ylim(len(labels) - 0.45, -0.55)
    axes.set_xlim(left=0)
    figure.legend([dot], ["Mean, 95 % interval"], loc="outside upper right")
    return figure


@look()
def trial_parameters(fit: TrialFit, impacts: Impacts, *, box: Box | None = None) -> Figure:
    """Fig. 3.6: the parameters that suit each trial best, the error left, and their distributions.

    A trial that leaves μ open is drawn as the interval of μ that suits it as well, and is not in
    the histogram of μ.

    Args:
        fit: of these impacts.
        impacts: what was fitted.
        box: the parameters that were allowed; μ and ε in [0, 1] if left out.

    Raises:
        ContactLearnError: a fit of other impacts.
    """
    if len(fit.mu) != len(impacts):
        raise ContactLearnError(f"the fit must be of these impacts: {len(fit.mu)} trials, got {len(impacts)} impacts")
    box, style = box or Box(), law_style(fit.law)
    mu, eps, error = array(fit.mu), array(fit.eps), array(fit.error) * MILLI
    undetermined = array(fit.flat).astype(bool)
    determined = ~undetermined
    figure = new_figure(PAGE, 3.2)
    left, right = figure.subfigures(1, 2, width_ratios=(1.4, 1))
    axes = name_axes(left.subplots(), _mu(fit.law, fit.variant), _EPS)
    norm = Normalize(0, max(np.percentile(error, 95), 1e-6))
    low, high = (array(end).clip(*box.mu) for end in (fit.mu_low, fit.mu_high))
    segments = np.stack((np.stack((low, high), -1), np.stack((eps, eps), -1)), -1)[undetermined]
    lines = LineCollection(segments, array=error[undetermined], cmap=MAP, norm=norm, linewidths=0.3, zorder=1)
    axes.add_collection(lines, autolim=False)
    axes.scatter(mu[determined], eps[determined], 7, error[determined], cmap=MAP, norm=norm, linewidths=0, zorder=2)
    # Where μ is open it is so up to the box's end as a rule: the axis shows the μ that are determined.
    furthest = min(box.mu[1], 1.15 * np.where(determined, mu, low).max() + 1e-3)
    axes.set_xlim(box.mu[0] - 0.02 * (furthest - box.mu[0]), furthest)
    margin = 0.05 * np.ptp(eps) + 1e-3
    axes.set_ylim(eps.min() - margin, eps.max() + margin)
    bar = left.colorbar(ScalarMappable(norm, MAP), ax=axes, extend="max", pad=0.02)
    bar.solids.set(rasterized=False, edgecolor="face")
    name_axes(bar.ax, y="Impulse error left (mN s);\ncolours end at the 95th percentile")
    axes.set_title(f"{_title(fit.law, fit.variant)}, {len(impacts)} trials")
    handles = {"Trial": Line2D([], [], marker="o", markersize=3, linestyle="none", color=DARK)}
    if undetermined.any():
        label = f"Trial that leaves μ undetermined (up to {high[undetermined].max():.2g})"
        handles[label] = Line2D([], [], linewidth=0.6, color=DARK)
    left.legend(list(handles.values()), list(handles), loc="outside lower center", ncols=2)

    upper, lower = right.subplots(2, 1)
    for panel, values, label in ((upper, mu[determined], axes.get_xlabel()), (lower, eps, _EPS)):
        name_axes(panel, label, "Trials (count)")
        if len(values):
            panel.hist(
                values,
                round(2 * len(values) ** (1 / 3)),
                color=tint(style.color, 0.45),
                edgecolor=style.color,
                linewidth=0.4,
            )
            panel.axvline(values.mean(), color=DARK, linestyle="--", linewidth=0.9)
            panel.set_title(f"Mean {values.mean():.3f}, standard deviation {values.std():.3f}")
    upper.set_title(f"{undetermined.sum()} of {len(impacts)} trials leave μ undetermined\n{upper.get_title()}".strip())
    return figure


@look()
def patch_curve(widths_mm: Sequence[float], errors: Tensor, references: Mapping[str, float], metric: str) -> Figure:
    """The mean error of the IRB bound against the half-width of the contact patch.

    Args:
        widths_mm: half-widths [K] in mm, increasing.
        errors: mean error, and the ends of its 95 % interval, [K, 3].
        references: mean errors to compare with, by name as in `error_comparison`: the best law and
            Best Post Hoc.
        metric: axis label with its unit.
    """
    figure = new_figure(COLUMN, 2.6)
    axes = name_axes(figure.subplots(), "Half-width of the contact patch (mm)", metric)
    bound, values = LAW_STYLE["irb"], array(errors)
    for name, value in references.items():
        style = law_style(name)
        axes.axhline(value, color=style.color, linestyle=style.linestyle, label=plain(style.label))
    axes.fill_between(widths_mm, values[:, 1], values[:, 2], color=tint(bound.color, 0.35), linewidth=0)
    line: dict[str, Any] = {"color": bound.color, "linestyle": bound.linestyle, "marker": bound.marker, "markersize": 4}
    axes.plot(widths_mm, values[:, 0], **line, label=f"{bound.label}, 95 % interval")
    axes.margins(x=0.02)
    axes.set_ylim(bottom=0)
    columns = 2 if all(len(law_style(name).label) < 22 for name in references) else 1
    figure.legend(loc="outside upper center", ncols=columns, columnspacing=1.0, handlelength=1.8, handletextpad=0.5)
    return figure
