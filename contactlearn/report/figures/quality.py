"""Predictions, calibration and training of one learned model; each figure takes plain values.

predicted_against_measured  post-contact velocity, component by component
calibration_curve           share of the measurements inside the predicted regions
training                    loss of a fit, and how relevant it found each feature
"""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from torch import Tensor

from contactlearn.core.errors import ContactLearnError
from contactlearn.mechanics.space import BOTH
from contactlearn.report.figures import style as st

__all__ = ["calibration_curve", "predicted_against_measured", "training"]

_NEARLY = 0.99  # R² from which on three digits could be 1


@st.look()
def predicted_against_measured(
    measured: Float[Tensor, "n D"], predicted: Float[Tensor, "n D"], std: Float[Tensor, "n D"] | None = None
) -> Figure:
    """Draw the post-contact velocity as predicted and as measured, a panel a component.

    Args:
        measured, predicted: velocities in m/s and rad/s, of the plane or of space.
        std: standard deviations of the predictions, drawn as ± 1.96 of them; not where the density of many trials is.

    Raises:
        ContactLearnError: no trials, or shapes that differ.
    """
    shapes = [tuple(x.shape) for x in (measured, predicted, std) if x is not None]
    space = next((space for space in BOTH if shapes[0] == (len(measured), space.D)), None)
    if not len(measured) or space is None or len(set(shapes)) > 1:
        raise ContactLearnError(
            f"measured, predicted and std must all be [N, 3], or [N, 6] in space, with N ≥ 1, got {shapes}"
        )
    rows = space.D // 3
    figure = st.new_figure(st.PAGE, 2.4 * rows + 0.35)
    panels = figure.subplots(rows, 3, squeeze=False).flat
    for column, ((symbol, unit), axes) in enumerate(zip(space.symbols.items(), panels, strict=True)):
        name = f"${symbol}$" if "_" in symbol else symbol
        st.name_axes(axes, f"Measured {name} ({unit})", f"Predicted {name} ({unit})").set_box_aspect(1)
        spread = None if std is None else st.array(std)[:, column]
        _draw_component(axes, st.array(measured)[:, column], st.array(predicted)[:, column], spread, unit)
    figure.legend(*figure.axes[-1].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def _draw_component(axes: Axes, x: np.ndarray, y: np.ndarray, std: np.ndarray | None, unit: str) -> None:
    """One component as measured (x) and as predicted (y), with R² and the rms error above."""
    if len(x) > st.MANY:
        st.draw_density(axes, x, y, st.CONTRAST[0]).set_label("Trials, density")
    elif std is not None:
        reach, color = 1.96 * std, st.tint(st.CONTRAST[0], 0.3)
        axes.vlines(x, y - reach, y + reach, color=color, linewidth=0.6, label="± 1.96 standard deviations")
    axes.axline((0, 0), slope=1, color=st.DARK, linewidth=0.8, label="Predicted = measured")
    if len(x) <= st.MANY:
        axes.plot(x, y, "o", color=st.CONTRAST[0], markersize=2, markeredgewidth=0, label="Trial")
    low, high = min(x.min(), y.min()), max(x.max(), y.max())
    ends = low - 0.05 * (high - low) - 1e-3, high + 0.05 * (high - low) + 1e-3
    axes.set(xlim=ends, ylim=ends, title=f"{_r2(x, y)}, rms {np.sqrt(np.mean((y - x) ** 2)):.3g} {unit}")


@st.look()
def calibration_curve(coverage: Mapping[str, tuple[Float[Tensor, " levels"], Float[Tensor, " levels"]]]) -> Figure:
    """Draw the share of the measurements inside the predicted intervals against the intervals' level.

    A curve below the diagonal belongs to an overconfident model.

    Args:
        coverage: nominal levels and empirical shares by model, both in [0, 1].

    Raises:
        ContactLearnError: no models, or levels and shares that differ in number.
    """
    if not coverage:
        raise ContactLearnError("calibration_curve needs the coverage of at least one model, got none")
    figure = st.new_figure(st.COLUMN, 3.3 + st.ROW * (2 + len(coverage)))
    axes = st.name_axes(figure.subplots(), "Nominal level (–)", "Share of measurements inside (–)")
    axes.axline((0, 0), slope=1, color=st.DARK, linewidth=0.8, label="Calibrated")
    axes.axvline(0.95, color="#AAAAAA", linewidth=0.8, label="95 % interval")
    for name, style in st.law_styles(coverage).items():
        levels, shares = map(st.array, coverage[name])
        if not levels.size or levels.shape != shares.shape:
            raise ContactLearnError(f"{name!r} needs a share for each level, got {levels.size} and {shares.size}")
        st.draw_line(axes, levels, shares, style, markevery=max(1, len(levels) // 8))
    axes.set(xlim=(0, 1.02), ylim=(0, 1.02), aspect="equal")
    figure.legend(loc="outside lower center")
    return figure


@st.look()
def training(
    loss: Float[Tensor, "iterations *processes"],
    hyperparameters: Mapping[str, Mapping[str, float]],
    objective: str = "marginal likelihood",
) -> Figure:
    """Draw the loss of a fit, and the relevance of each feature for each output.

    Args:
        loss: negative logarithm of the objective per point in nats, [iterations], or [iterations, G] of
            G Gaussian processes.
        hyperparameters: by output and feature, 1/lengthscale of the scaled feature.
        objective: of the training, "posterior" or "marginal likelihood".

    Raises:
        ContactLearnError: no iterations, outputs or features.
    """
    losses = st.array(loss)[:, None] if loss.ndim == 1 else st.array(loss)
    features = list(dict.fromkeys(feature for by_feature in hyperparameters.values() for feature in by_feature))
    if not losses.size or not features:
        raise ContactLearnError("training needs the loss of at least one iteration and at least one relevance")
    outputs = len(hyperparameters)
    figure = st.new_figure(st.PAGE, max(2.5, 0.9 + st.ROW * outputs + 0.075 * (outputs + 1) * len(features)))
    left, right = figure.subplots(1, 2)
    st.name_axes(left, "Iteration (–)", f"Negative log {objective}\nper point (nats)").margins(x=0.02)
    if losses.shape[1] > 1:
        left.plot(losses, color=st.tint(st.CONTRAST[0], 0.4), linewidth=0.6)[0].set_label("One Gaussian process")
    left.plot(losses.mean(1), color=st.CONTRAST[0], label=f"Mean of {losses.shape[1]}")
    _draw_relevances(right, hyperparameters, features)
    for axes in (left, right)[losses.shape[1] == 1 :]:  # one line needs no legend
        st.legend_above(axes)
    return figure


def _draw_relevances(axes: Axes, hyperparameters: Mapping[str, Mapping[str, float]], features: Sequence[str]) -> None:
    """A bar for each output and feature, those of one feature side by side."""
    st.name_axes(axes, "Relevance 1/lengthscale (–)")
    outputs = len(hyperparameters)
    for place, (output, by_feature) in enumerate(hyperparameters.items()):
        y = np.arange(len(features)) + 0.8 * ((place + 0.5) / outputs - 0.5)
        relevance, (row, hue) = [by_feature.get(feature, 0) for feature in features], divmod(place, len(st.CONTRAST))
        color = st.tint(st.CONTRAST[hue], 0.45 if row else 1.0)  # six outputs in space: moments paler than impulses
        axes.barh(y, relevance, 0.8 / outputs, color=color, label=st.plain(output, 20))
    axes.set_yticks(range(len(features)), [st.plain(feature, 20) for feature in features])
    axes.set_ylim(len(features) - 0.5, -0.5)


def _r2(measured: np.ndarray, predicted: np.ndarray) -> str:
    """Coefficient of determination, which equal measurements leave undefined."""
    spread = np.sum((measured - measured.mean()) ** 2)
    if spread == 0:
        return "R² undefined"
    value = 1 - np.sum((measured - predicted) ** 2) / spread
    return f"R² = {value:{'.4f' if value > _NEARLY else '.3g'}}".replace("-", "−")
