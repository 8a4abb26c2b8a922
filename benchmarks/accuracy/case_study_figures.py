"""The figures of docs/case-study.md that show measurements, in the looks of the report.

    python benchmarks/accuracy/case_study_figures.py [FOLDER]    docs, if left out

case_study_frame       the moment balance of the published drops, as published and with x mirrored
case_study_location    restitution by place: its effect in the model of seven effects
case_study_spot        restitution by orientation: the same of the soft spot
"""

import sys
from pathlib import Path

from matplotlib.figure import Figure

import contactlearn as cl
from contactlearn.data import ellipse_drops
from contactlearn.data.audit.corrections import correct
from contactlearn.data.audit.evidence import BalanceSide
from contactlearn.effects import find_effect
from contactlearn.inference.evaluation.partial_residuals import partial_residuals
from contactlearn.inference.identification import joint
from contactlearn.laws import find
from contactlearn.mechanics.impacts import Impacts
from contactlearn.report.figures import style as st
from contactlearn.report.figures.diagnosis import dots, legend_below
from contactlearn.report.figures.effects import effect_curve

LADDER = (
    ("location_dependent_restitution", None), ("surface_tilt", None), ("contact_patch", None),
    ("parameter_drift", "friction"), ("sampling_delay", None), ("inertia_error", None),
    ("orientation_dependent_restitution", "spot"),
)  # fmt: skip
"""Effects and their forms, as in `case_study.py`."""


@st.look()
def frame(published: Impacts) -> Figure:
    """Both sides of the moment balance, as published and with x mirrored."""
    sides = {
        "As published": BalanceSide.of(published),
        "x mirrored": BalanceSide.of(correct(published, ["mirrored_x"])),
    }
    figure = st.new_figure(0.8 * st.PAGE, 3.1)
    figure.suptitle("Published x axis is mirrored: after correction the signs of both terms agree")
    panels = figure.subplots(1, 2)
    for axes, (title, side) in zip(panels, sides.items(), strict=True):
        moments = st.MILLI * side.moments
        reach = 1.1 * moments.abs().amax(0).quantile(0.99).item()
        st.name_axes(axes, "$r_x P_n - r_y P_t$ (mN m s)", "I Δω (mN m s)")
        axes.set_title(title)
        dots(axes, *moments)
        axes.axline((0, 0), slope=1, color=st.CONTRAST[1], label="Slope 1: balanced")
        axes.set(xlim=(-reach, reach), ylim=(-reach, reach))
        axes.set_box_aspect(1)
        fit = side.fit
        values = (("a", fit.a, fit.a_error), ("b", fit.b, fit.b_error))
        lines = (f"{x} = {y:+.2f} ± {error:.2f}".replace("-", "−") for x, y, error in values)
        axes.text(0.04, 0.96, "\n".join(lines), transform=axes.transAxes, va="top")
    legend_below(figure, *panels)
    return figure


def main() -> None:
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else Path(__file__).parents[2] / "docs")
    published = ellipse_drops.load()
    drops = correct(published, cl.audit(published).corrections)
    model = joint.fit(drops, find("wang_mason"), {name: find_effect(name, form)() for name, form in LADDER}).model
    figures = {
        "frame": frame(published),
        "location": effect_curve(
            partial_residuals(model, drops, "location_dependent_restitution"), "Restitution depends on the place"
        ),
        "spot": effect_curve(
            partial_residuals(model, drops, "orientation_dependent_restitution"), "A soft spot of the body"
        ),
    }
    with st.look():
        for name, figure in figures.items():
            for axes in figure.axes:
                axes.set_ylabel(axes.get_ylabel().replace("P_n", "$P_n$"))
            figure.savefig(folder / f"case_study_{name}.png", dpi=150)


if __name__ == "__main__":
    main()
