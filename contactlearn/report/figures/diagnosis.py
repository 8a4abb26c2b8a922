"""All figures of a diagnosis by file name, and the ladder of held-out errors.

drawn     audit, regions, residual, the curve of each effect, the ladder, the frontier
ladder    law, effect after effect, Gaussian processes, noise; beside it the laws alone
frontier  the best model of each number of effects
"""

from collections.abc import Sequence

from matplotlib.figure import Figure

from contactlearn.data.audit.corrections import correct
from contactlearn.diagnosis.result import Diagnosis, RungKind
from contactlearn.effects import EffectId
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.mechanics.impacts import Impacts
from contactlearn.report.figures import style as st
from contactlearn.report.figures.audit import audit_figure, drawable
from contactlearn.report.figures.effects import effect_curve
from contactlearn.report.figures.regions import ERROR, regions_figure
from contactlearn.report.figures.residual import residual_figure
from contactlearn.report.text import base_label, effect_label, error, rung_label


def drawn(found: Diagnosis, raw: Impacts) -> dict[str, Figure]:
    """Draw every figure of a diagnosis.

    They are `audit_<finding>`, `regions`, `residual`, `effect_<name>`, `ladder` and `frontier`.

    Args:
        found: the diagnosis, with its record unless the data were refused.
        raw: the impacts that were diagnosed, before their corrections.
    """
    figures, record = _audit_figures(found, raw), found.record
    if record is not None and found.regions:
        figures["regions"] = regions_figure(found.regions, record)
    if record is not None and found.remainder is not None:
        figures["residual"] = residual_figure(found.remainder, record)
    if record is not None:
        for missing, partial in zip(found.missing, record.residuals, strict=True):
            figures[_file(missing.effect)] = effect_curve(partial, effect_label(missing.effect))
    if found.ladder:
        figures["ladder"] = ladder_figure(found)
    if found.frontier:
        figures["frontier"] = frontier_figure(found)
    return figures


def _audit_figures(found: Diagnosis, raw: Impacts) -> dict[str, Figure]:
    """A figure for each finding; the corrections of the findings before it are made in both of its sides."""
    figures, impacts = {}, raw.replace(validate=False)
    for finding in filter(drawable, found.findings):
        names = [finding.correction] if finding.correction else finding.hypothesis
        after = correct(impacts, names)
        figures[f"audit_{finding.name}"] = audit_figure(finding, impacts, after)
        impacts = after
    return figures


def _file(effect: EffectId) -> str:
    """Name of the file of an effect's figure."""
    return "_".join(("effect", effect.name, *([effect.form] if effect.form is not None else [])))


@st.look()
def ladder_figure(found: Diagnosis) -> Figure:
    """Draw the held-out error of each rung with its 95 % interval; the IRB bound is a line."""
    names = [rung_label(rung, base_label(found)) for rung in found.ladder]
    physical = [rung.kind in (RungKind.LAW, RungKind.EFFECT) for rung in found.ladder]
    figure = _bars(names, [rung.error for rung in found.ladder], physical)
    if found.budget is not None:
        style = st.law_style("irb")
        look = {"color": style.color, "linestyle": style.linestyle, "zorder": 0.5}
        figure.axes[0].axvline(found.budget.bound.mean, **look, label=style.label)
        figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center")
    return figure


@st.look()
def laws_figure(found: Diagnosis) -> Figure:
    """Draw the held-out error of each law without effects, the least first."""
    laws = sorted(found.laws, key=lambda one: one.error)
    errors = [Interval(one.error, one.error, one.error) for one in laws]
    return _bars([st.law_style(one.name).label for one in laws], errors, [True] * len(laws))


def _bars(names: Sequence[str], errors: Sequence[Interval], physical: Sequence[bool]) -> Figure:
    """Errors from top to bottom, each below its number and name; models without physics are grey."""
    figure = st.new_figure(st.PAGE, 0.7 + 0.38 * len(names))
    axes = st.name_axes(figure.subplots(), ERROR)
    blue, grey, places = st.tint(st.CONTRAST[0], 0.45), st.tint(st.DARK, 0.2), range(len(names))
    axes.barh(places, [x.mean for x in errors], color=[blue if one else grey for one in physical], height=0.42)
    axes.hlines(places, [x.low for x in errors], [x.high for x in errors], color=st.DARK, linewidth=1.8)
    for place, name in enumerate(names):
        axes.text(0, place - 0.24, f"{error(errors[place].mean)}  {st.plain(name, 60)}", va="bottom")
    axes.set(xlim=(0, 1.04 * max(x.high for x in errors)), ylim=(len(names) - 0.6, -0.8))
    axes.set_yticks([])
    return figure


@st.look()
def frontier_figure(found: Diagnosis) -> Figure:
    """Draw the held-out error of the best model of each number of effects; the chosen number is marked."""
    figure = st.new_figure(st.PAGE, 2.6)
    axes = st.name_axes(figure.subplots(), "number of effects (–)", ERROR)
    sizes = [len(model.effects) for model in found.frontier]
    means = [model.error.mean for model in found.frontier]
    lows, highs = ([getattr(model.error, end) for model in found.frontier] for end in ("low", "high"))
    axes.vlines(sizes, lows, highs, color=st.DARK)
    axes.plot(sizes, means, color=st.CONTRAST[0], marker="o", label="best of each number")
    chosen = len(found.missing)
    if chosen in sizes:
        axes.plot(chosen, means[sizes.index(chosen)], color=st.CONTRAST[1], marker="o", linestyle="", label="chosen")
    if found.budget is not None:
        axes.axhline(found.budget.noise.mean, color=st.DARK, linestyle=":", label="noise floor")
    axes.set_xticks(sizes)
    axes.set_ylim(bottom=0)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure
