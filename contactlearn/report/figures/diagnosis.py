"""All figures of a diagnosis by file name, and the ladder of held-out errors.

drawn     audit, regions, residual, the curve of each effect, the ladder, the frontier
ladder    law, effect after effect, Gaussian processes, noise
frontier  the best model of each number of effects
"""

from matplotlib.figure import Figure

from contactlearn.data.audit.corrections import correct
from contactlearn.diagnosis.result import Diagnosis
from contactlearn.effects import EffectId
from contactlearn.mechanics.impacts import Impacts
from contactlearn.report.figures import style as st
from contactlearn.report.figures.audit import audit_figure, drawable
from contactlearn.report.figures.effects import effect_curve
from contactlearn.report.figures.regions import ERROR, regions_figure
from contactlearn.report.figures.residual import residual_figure
from contactlearn.report.text import base_label, effect_label, rung_label


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
    figure = st.new_figure(st.PAGE, 0.9 + 0.25 * len(found.ladder))
    axes = st.name_axes(figure.subplots(), ERROR)
    for place, rung in enumerate(found.ladder):
        axes.barh(place, rung.error.mean, color=st.tint(st.CONTRAST[0], 0.45), height=0.6)
        axes.plot((rung.error.low, rung.error.high), (place, place), color=st.DARK)
    names = [st.plain(rung_label(rung, base_label(found)), 60) for rung in found.ladder]
    axes.set_yticks(range(len(names)), names)
    axes.tick_params(axis="y", length=0)
    axes.invert_yaxis()
    if found.budget is not None:
        style = st.law_style("irb")
        bound = found.budget.bound.mean
        axes.axvline(bound, color=style.color, linestyle=style.linestyle, label=style.label)
    axes.set_xlim(left=0)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center")
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
