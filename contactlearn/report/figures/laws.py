"""Identified parameters of the laws; each figure takes what a fit returned.

    cost_map           Fig. 3.3  error of a law over (μ, ε)
    convergence        Fig. 3.4  identified (μ, ε) against the number of trials
    trial_parameters   Fig. 3.6  (μ_k, ε_k) trial by trial

Impulses are shown in mN s.  The figure numbers are those of Fazeli et al. (2017).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from torch import Tensor

from contactlearn.core.errors import ContactLearnError
from contactlearn.inference.identification.result import Box, SubsetFit, TrialFit
from contactlearn.laws import Law
from contactlearn.mechanics.impacts import Impacts
from contactlearn.report.figures import style as st

_EPS = "Restitution ε (–)"


def _title(law: Law) -> str:
    return st.plain(law.label) + ("" if law.variant == "textbook" else f" ({st.plain(law.variant)})")


# --- Shared by all trials -------------------------------------------------------------------------


@st.look()
def cost_map(
    mu: Float[Tensor, " a"],
    eps: Float[Tensor, " b"],
    cost: Float[Tensor, "a b"],
    best: tuple[float, float],
    law: Law,
    trials: int,
) -> Figure:
    """Draw the mean impulse error over the parameters, and its minimum (Fig. 3.3).

    Args:
        mu, eps: nodes.
        cost: mean ‖P − P̂‖ in N s, as of `identification.shared.cost_surface`.
        best: the identified (μ, ε).
        law: for the title.
        trials: number k of trials behind the cost, for the title.
    """
    values = st.array(cost).T * st.MILLI
    figure = st.new_figure(st.COLUMN, 2.75)
    axes = st.name_axes(figure.subplots(), law.mu_axis, _EPS)
    levels = MaxNLocator(14).tick_values(values.min(), values.max() + 1e-9 * (1 + abs(values.max())))
    surface = axes.contourf(st.array(mu), st.array(eps), values, levels, cmap=st.MAP)
    surface.set_edgecolor("face")  # no white seams between the levels in a PDF
    axes.plot(*best, "*", color="white", markeredgecolor="black", markersize=11, clip_on=False, zorder=5)
    axes.set_title(f"{_title(law)}, {trials} trials:\nleast at μ = {best[0]:.3f}, ε = {best[1]:.3f}")
    bar = figure.colorbar(surface, ax=axes, pad=0.02)
    st.name_axes(bar.ax, y="Mean impulse error (mN s)")
    return figure


@st.look()
def convergence(fit: SubsetFit) -> Figure:
    """Draw the mean (μ, ε) over the repetitions against the number of trials, ± one standard deviation (Fig. 3.4)."""
    figure = st.new_figure(st.COLUMN, 3.2)
    panels = figure.subplots(2, 1, sharex=True)
    for axes, found, label in zip(panels, (fit.mu, fit.eps), (fit.law.mu_axis, _EPS), strict=True):
        _draw_means(axes, fit, st.array(found))
        st.name_axes(axes, y=label).margins(x=0.02)
    panels[1].set_xlabel("Number of trials k (–)")
    last, flat = fit.sizes[-1], int(fit.mu_flat[:, -1].sum())
    note = f"\nμ is left open by {flat} of them at k = {last}" if flat else ""
    panels[0].set_title(f"{_title(fit.law)}, {len(fit.mu)} random subsets{note}")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def _draw_means(axes: Axes, fit: SubsetFit, values: Float[np.ndarray, "repetitions sizes"]) -> None:
    """Mean and standard deviation of one parameter over the repetitions."""
    style, mean = st.law_style(fit.law.name), values.mean(0)
    marker = "o" if len(fit.sizes) <= 16 else ""
    axes.plot(fit.sizes, mean, marker=marker, markersize=3.5, color=style.color, label="Mean", zorder=3)
    if len(values) > 1:
        std = values.std(0, ddof=1)
        for sign, name in ((-1, ""), (1, "± 1 standard deviation")):
            axes.plot(fit.sizes, mean + sign * std, "--", color=st.DARK, linewidth=0.8, label=name or None)
        axes.fill_between(fit.sizes, mean - std, mean + std, color=st.tint(style.color, 0.25), linewidth=0)


# --- Trial by trial -------------------------------------------------------------------------------


@st.look()
def trial_parameters(fit: TrialFit, impacts: Impacts, *, box: Box | None = None) -> Figure:
    """Draw the best parameters of each trial, the error that remains, and their distributions (Fig. 3.6).

    A trial that leaves μ undetermined is drawn as the interval of μ with the same error, and is not in
    the histogram of μ.  Of many trials the density of those that determine μ is drawn.

    Args:
        fit: of these impacts.
        impacts: that were fitted.
        box: the parameters that were allowed; μ and ε in [0, 1] if left out.

    Raises:
        ContactLearnError: a fit of other impacts.
    """
    if len(fit.mu) != len(impacts):
        raise ContactLearnError(f"the fit must be of these impacts: {len(fit.mu)} trials, got {len(impacts)} impacts")
    shown = _Scatter.of(fit, box or Box())
    figure = st.new_figure(st.PAGE, 3.2)
    left, right = figure.subfigures(1, 2, squeeze=False, width_ratios=(1.4, 1))[0]
    axes = st.name_axes(left.subplots(), fit.law.mu_axis, _EPS)
    if len(shown.mu) > st.MANY:
        _draw_density(left, axes, shown, st.law_style(fit.law.name).color)
    else:
        _draw_trials(left, axes, shown)
    axes.set_title(f"{_title(fit.law)}, {len(impacts)} trials")
    upper, lower = right.subplots(2, 1)
    color, open_ = st.law_style(fit.law.name).color, shown.undetermined
    _draw_histogram(st.name_axes(upper, axes.get_xlabel(), "Trials (count)"), shown.mu[~open_], color)
    _draw_histogram(st.name_axes(lower, _EPS, "Trials (count)"), shown.eps, color)
    upper.set_title(f"{open_.sum()} of {len(impacts)} trials leave μ undetermined\n{upper.get_title()}".strip())
    return figure


@dataclass(frozen=True, kw_only=True)
class _Scatter:
    """Parameters of each trial as they are drawn; errors in mN s."""

    box: Box
    mu: Float[np.ndarray, " n"]
    eps: Float[np.ndarray, " n"]
    low: Float[np.ndarray, " n"]  # ends of the interval of μ with the same error
    high: Float[np.ndarray, " n"]
    error: Float[np.ndarray, " n"]
    undetermined: Bool[np.ndarray, " n"]

    @classmethod
    def of(cls, fit: TrialFit, box: Box) -> "_Scatter":
        low, high = (st.array(end).clip(*box.mu) for end in (fit.mu_low, fit.mu_high))
        undetermined, error = st.array(fit.flat).astype(bool), st.array(fit.error) * st.MILLI
        mu, eps = st.array(fit.mu), st.array(fit.eps)
        return cls(box=box, mu=mu, eps=eps, low=low, high=high, error=error, undetermined=undetermined)


def _draw_trials(figure: SubFigure, axes: Axes, shown: _Scatter) -> None:
    """A dot for each trial that determines μ, a line for each that does not, coloured by the error."""
    norm, open_ = Normalize(0, max(np.percentile(shown.error, 95), 1e-6)), shown.undetermined
    ends = np.stack((shown.low, shown.high), -1), np.stack((shown.eps, shown.eps), -1)
    lines = [*np.stack(ends, -1)[open_]]
    axes.add_collection(
        LineCollection(lines, array=shown.error[open_], cmap=st.MAP, norm=norm, linewidths=0.3, zorder=1),
        autolim=False,
    )
    dots = shown.mu[~open_], shown.eps[~open_], 7, shown.error[~open_]
    axes.scatter(*dots, cmap=st.MAP, norm=norm, linewidths=0, zorder=2)
    _limit_axes(axes, shown)
    bar = figure.colorbar(ScalarMappable(norm, st.MAP), ax=axes, extend="max", pad=0.02)
    assert bar.solids is not None  # as on every bar that is not of contours
    bar.solids.set(rasterized=False, edgecolor="face")
    st.name_axes(bar.ax, y="Impulse error left (mN s);\ncolours end at the 95th percentile")
    handles = {"Trial": Line2D([], [], marker="o", markersize=3, linestyle="none", color=st.DARK)}
    if open_.any():
        label = f"Trial that leaves μ undetermined (up to {shown.high[open_].max():.2g})"
        handles[label] = Line2D([], [], linewidth=0.6, color=st.DARK)
    figure.legend(list(handles.values()), list(handles), loc="outside lower center", ncols=2)


def _draw_density(figure: SubFigure, axes: Axes, shown: _Scatter, color: str) -> None:
    """How many of the trials that determine μ lie in each cell of μ and ε."""
    cells = st.draw_density(axes, shown.mu[~shown.undetermined], shown.eps[~shown.undetermined], color)
    _limit_axes(axes, shown)
    bar = figure.colorbar(cells, ax=axes, pad=0.02)
    st.name_axes(bar.ax, y="Trials that determine μ (count)")


def _limit_axes(axes: Axes, shown: _Scatter) -> None:
    """Show the μ that are determined: an open μ is open up to the box's end as a rule."""
    first, last = shown.box.mu
    furthest = min(last, 1.15 * np.where(shown.undetermined, shown.low, shown.mu).max() + 1e-3)
    axes.set_xlim(first - 0.02 * (furthest - first), furthest)
    margin = 0.05 * np.ptp(shown.eps) + 1e-3
    axes.set_ylim(shown.eps.min() - margin, shown.eps.max() + margin)


def _draw_histogram(axes: Axes, values: Float[np.ndarray, " n"], color: str) -> None:
    """The distribution of a parameter over the trials, if there are any, with its mean."""
    if len(values):
        st.draw_histogram(axes, values, round(2 * len(values) ** (1 / 3)), color)
        axes.axvline(values.mean(), color=st.DARK, linestyle="--", linewidth=0.9)
        axes.set_title(f"Mean {values.mean():.3f}, standard deviation {values.std():.3f}")
