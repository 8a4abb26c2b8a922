"""Figures of learned models: they draw the right numbers, say their units, and no name or data breaks or clips them."""

import itertools
import re

import numpy as np
import pytest
import torch
from matplotlib.image import imread
from test_figures import HOSTILE, assert_fits, assert_units, visible_axes

from contactlearn.core.errors import ContactLearnError
from contactlearn.report.figures import learning, quality, style

METRIC = "Normalised velocity error (–)"
SIZES = [10, 25, 50, 100, 200, 300, 450]
MODELS = (*style.CLASS_I, *style.CLASS_II)
UNIT = re.compile(r"\((–|m/s|rad/s|per m/s|nats)\)$")


def decay(last: float, first: float = 2.0, sizes=SIZES) -> torch.Tensor:
    """A curve [S, 3] that falls from `first` to `last`."""
    share = torch.linspace(1, 0, len(sizes), dtype=torch.float64) ** 3
    mean = last + (first - last) * share
    return torch.stack((mean, 0.9 * mean, 1.1 * mean), -1)


def curve(names=MODELS, references=(*style.BOUNDS, "anitescu_potra_newton"), sizes=SIZES, **options):
    curves = {name: decay(0.3 + 0.03 * place, **options, sizes=sizes) for place, name in enumerate(names)}
    return learning.learning_curve(sizes, curves, dict.fromkeys(references, (0.5, 0.48, 0.53)), METRIC)


def trials(mean: float, size: int = 400) -> torch.Tensor:
    generator = torch.Generator().manual_seed(round(1000 * mean))
    return mean * torch.rand(2, size, generator=generator, dtype=torch.float64).sum(0)


def densities(names=(*style.BOUNDS, *MODELS), metric=METRIC, size=400):
    return learning.error_densities({name: trials(0.3 + 0.03 * k, size) for k, name in enumerate(names)}, metric)


def velocities(size=300, std=True):
    generator = torch.Generator().manual_seed(0)
    measured, noise = torch.randn(2, size, 3, generator=generator, dtype=torch.float64)
    predicted = measured + 0.2 * noise
    return quality.predicted_against_measured(measured, predicted, torch.full_like(noise, 0.2) if std else None)


def covered(names=MODELS):
    levels = torch.tensor([0.1, 0.5, 0.9, 0.95])
    return quality.calibration_curve({name: (levels, levels ** (0.8 + 0.1 * k)) for k, name in enumerate(names)})


def transferred(bodies=("Square", "Triangle"), labels=("from scratch", "trained model as prior")):
    curves = {body: {label: decay(0.3 + 0.05 * k) for k, label in enumerate(labels)} for body in bodies}
    return learning.transfer_errors(SIZES, curves, dict.fromkeys(bodies, (0.5, 0.45, 0.54)), METRIC)


def trained(processes=3, outputs=("P_t", "P_n", "τ"), features=("v_t", "v_n", "sin 2θ")):
    loss = torch.exp(-torch.arange(100) / 20)[:, None] + torch.arange(max(processes, 1))
    relevances = {output: {feature: 0.1 + k for k, feature in enumerate(features)} for output in outputs}
    return quality.training(loss if processes else loss[:, 0], relevances)


NOT_RUN = torch.full((7, 3), torch.nan)
GAP = decay(0.3).index_fill(0, torch.tensor([0, 3]), torch.nan)

FIGURES = {
    "curve": curve,
    "curve of Class I": lambda: curve(style.CLASS_I),
    "curve of Class II": lambda: curve(style.CLASS_II),
    "curve of a law and unknown models": lambda: curve(("x1_wrench", "wang_mason", "my GP", "my network"), ()),
    "curve at one size": lambda: curve(sizes=[1]),
    "curve at many sizes": lambda: curve(sizes=[*range(1, 20), *range(20, 1001, 20)]),
    "curve that was not run": lambda: learning.learning_curve(SIZES, {"x1_wrench": NOT_RUN}, {}, METRIC),
    "curve with gaps": lambda: learning.learning_curve(SIZES, {"x1_wrench": GAP, "mine": NOT_RUN}, {}, METRIC),
    "curve of zeros": lambda: learning.learning_curve(SIZES, {"x1_wrench": 0 * decay(1)}, {}, METRIC),
    "densities": densities,
    "densities of bounds": lambda: densities(style.BOUNDS),
    "densities of Class II": lambda: densities((*style.BOUNDS, *style.CLASS_II), "Velocity error (m/s)"),
    "densities of one trial": lambda: densities(size=1),
    "densities of two trials": lambda: densities(size=2),
    "densities of zeros": lambda: learning.error_densities({"irb": torch.zeros(9), "x1_wrench": trials(0.3)}, METRIC),
    "densities of zeros alone": lambda: learning.error_densities({"irb": torch.zeros(9)}, METRIC),
    "density far away": lambda: learning.error_densities({"irb": trials(0.3), "mine": torch.ones(3) * 1e6}, METRIC),
    "velocities": velocities,
    "velocities without deviation": lambda: velocities(std=False),
    "velocities of one trial": lambda: velocities(1),
    "calibration": covered,
    "calibration of one": lambda: covered(("my GP",)),
    "transfer": transferred,
    "transfer to one": lambda: transferred(("Square",)),
    "transfer to five": lambda: transferred("ABCDE", ("x1_wrench", "a", "b", "c")),
    "training": trained,
    "training of one": lambda: trained(0, ("P_n",), ("v_n",)),
    "training of the 10-D state": lambda: trained(3, ("v_x", "v_y", "ω"), [f"x{k}" for k in range(10)]),
}


def assert_readable(figure) -> None:
    """What `assert_fits` demands, of the legends above the panels as well: on the paper, on nothing else."""
    assert_fits(figure)
    legends = [axes.get_legend() for axes in figure.axes if axes.get_legend()]
    others = [axes.title for axes in figure.axes if axes.get_title()] + list(figure.legends)
    boxes = [artist.get_window_extent().padded(-1.5) for artist in (*legends, *others, *visible_axes(figure))]
    assert not any(a.overlaps(b) for a, b in itertools.combinations(boxes, 2))
    assert all(box.x0 >= 0 and box.x1 <= figure.bbox.x1 and box.y1 <= figure.bbox.y1 for box in boxes)
    for axes in figure.axes:
        ticks = [t.get_window_extent() for t in axes.get_xticklabels() if t.get_text() and t.get_visible()]
        assert not any(a.overlaps(b) for a, b in itertools.combinations(ticks, 2))


@pytest.mark.parametrize("build", FIGURES.values(), ids=FIGURES)
def test_every_figure_is_readable_and_names_its_units(build):
    figure = build()
    assert figure.get_figwidth() in (3.4, 7.0)
    assert_readable(figure)
    assert_units(figure, UNIT)


@pytest.mark.parametrize("name", [name for name in FIGURES if " " not in name])
def test_figures_are_written_as_vectors(name, tmp_path):
    png, pdf = style.save(FIGURES[name](), tmp_path, "figure")
    assert imread(png)[..., :3].std() > 0.05
    for forbidden in (b"/Type3", b"/Subtype /Image"):
        assert forbidden not in pdf.read_bytes()


NAMED = {
    "curve": lambda name: curve((name, "x1_wrench")),
    "densities": lambda name: densities(("irb", name)),
    "calibration": lambda name: covered((name,)),
    "transfer": lambda name: transferred((name,), (name,)),
}


def names_in(builders):
    """Each name in the first of the figures, and two that break most in each."""
    telling, first = ("two\nlines\t字", "$x$ & $y"), next(iter(builders))
    for name, kind in itertools.product(HOSTILE, builders):
        if name in telling or kind == first:
            yield pytest.param(name, builders[kind], id=f"{name}-{kind}")


@pytest.mark.parametrize(("name", "build"), list(names_in(NAMED)))
def test_names_are_shown_as_they_are(name, build):
    figure = build(name)
    assert_readable(figure)
    legends = [*figure.legends, *(axes.get_legend() for axes in figure.axes if axes.get_legend())]
    shown = [text.get_text() for legend in legends for text in legend.get_texts()]
    assert style.plain(name, 30) in shown


NAMED_BESIDES = {
    "bounds": lambda name: curve(("x1_wrench", "mine"), (name, f"{name} again", "irb")),
    "inputs and outputs": lambda name: trained(1, (name,), (name,)),
}


@pytest.mark.parametrize(("name", "build"), list(names_in(NAMED_BESIDES)))
def test_figures_with_such_names_are_readable(name, build):
    assert_readable(build(name))


def test_classes_hold_the_learned_models():
    assert (*style.CLASS_I, *style.CLASS_II) == tuple(style.MODEL_STYLE)
    assert len(style.CLASS_I) == len(style.CLASS_II) == 4
    assert style.law_style("X1 → wrench") is style.law_style("x1_wrench") is style.MODEL_STYLE["x1_wrench"]
    names = [f"model {k}" for k in range(50)]
    styles = style.law_styles(("irb", *names))
    assert styles["irb"] is style.LAW_STYLE["irb"]
    assert styles["model 0"] == style.law_style("model 0")
    assert len({(styles[name].marker, styles[name].linestyle) for name in names}) == 50


def line(axes, label: str):
    return next(line for line in axes.lines if line.get_label() == label)


@pytest.mark.parametrize(("names", "titles"), [
    (MODELS, ["Learned without a law (Class I)", "Learned with a law (Class II)"]),
    (style.CLASS_II, ["Learned with a law (Class II)"]),
    (("X1 → wrench", "mirtich"), ["Learned without a law (Class I)", "Others"]),
    (("mine", "residual_wrench"), ["Learned with a law (Class II), and others"]),
])  # fmt: skip
def test_classes_have_their_panels(names, titles):
    for figure in (curve(names), densities((*style.BOUNDS, *names))):
        assert [axes.get_legend().get_title().get_text() for axes in figure.axes] == titles


def test_learning_curve_shows_what_was_run():
    figure = learning.learning_curve(SIZES, {"x1_wrench": GAP, "x1_impulse": decay(0.4)}, {}, METRIC)
    x, y = line(figure.axes[0], "X1 → wrench").get_data()
    np.testing.assert_allclose(x, np.array(SIZES)[[1, 2, 4, 5, 6]], rtol=0.05)
    np.testing.assert_array_equal(y, GAP[[1, 2, 4, 5, 6], 0])
    bars = figure.axes[0].collections[0].get_segments()
    np.testing.assert_allclose([bar[:, 1] for bar in bars], GAP[[1, 2, 4, 5, 6], 1:])
    at = [line(figure.axes[0], name).get_xdata()[-1] for name in ("X1 → wrench", "X1 → impulse")]
    assert at[0] < 450 < at[1]  # side by side


def test_no_error_of_a_learning_curve_is_cut_off_or_flattens_the_others():
    def scaled(curve, level):
        figure = learning.learning_curve(SIZES, {"x1_wrench": curve}, {"irb": level}, METRIC)
        return figure.axes[0].get_yscale(), pytest.approx(figure.axes[0].get_ylim())

    assert scaled(decay(0.3, 0.9), (0.4, 0.3, 0.5)) == ("linear", (0, 1.05 * 0.99))
    assert scaled(decay(3.0, 90.0), (0.2, 0.1, 0.3)) == ("log", (0.8 * 0.2, 1.1 * 99))
    assert scaled(decay(3.0, 90.0), (1e-16, 0.0, 1e-15)) == ("log", (0.8 * 0.099, 1.1 * 99))  # three decades
    assert {axes.get_yscale() for axes in curve(first=90.0).axes} == {"log"}


@pytest.mark.parametrize("size", [50, 20_000])
def test_densities_integrate_to_one_and_mark_the_mean(size):
    errors = trials(0.4, size)
    axes = learning.error_densities({"x1_wrench": errors, "irb": trials(1.0)}, METRIC).axes[0]
    drawn = line(axes, "X1 → wrench")
    x, y = drawn.get_data()
    assert np.trapezoid(y, x) == pytest.approx(1, abs=0.01)
    assert x[drawn.get_markevery()[0]] == pytest.approx(errors.mean().item(), abs=x[1])


def test_spike_of_a_bound_does_not_flatten_the_models():
    errors = {"irb": torch.cat((1e-4 * trials(1.0), trials(0.2, 20))), "x1_wrench": trials(0.4)}
    axes = learning.error_densities(errors, METRIC).axes[0]
    assert axes.get_ylim()[1] < 1.6 * line(axes, "X1 → wrench").get_ydata().max()
    errors = torch.cat((trials(0.4), torch.tensor([500.0])))
    axes = learning.error_densities({"x1_wrench": errors}, METRIC).axes[0]
    assert axes.get_xlim()[1] < 1
    assert line(axes, "X1 → wrench").get_ydata().max() > 1  # the kernels are no wider for it


def test_velocities_state_their_fit():
    measured = torch.tensor([[0.0, 1.0, 0.0], [1.0, 1.0, 10.0]])
    axes = quality.predicted_against_measured(measured, measured + torch.tensor([0.1, 0.0, -50.0])).axes
    assert [a.get_title() for a in axes] == [
        "R² = 0.96, rms 0.1 m/s", "R² undefined, rms 0 m/s", "R² = −99, rms 50 rad/s",
    ]  # fmt: skip
    axes = velocities(5).axes[0]
    heights = [np.ptp(bar[:, 1]) for bar in axes.collections[0].get_segments()]
    np.testing.assert_allclose(heights, 2 * 1.96 * 0.2)
    axes = covered(("x1_impulse",)).axes[0]
    x, y = line(axes, "X1 → impulse").get_data()
    np.testing.assert_allclose(y, x**0.8, rtol=1e-6)


def test_transfer_has_one_legend_and_one_scale_for_all_bodies():
    figure = transferred()
    entries = [text.get_text() for text in figure.legends[0].get_texts()]
    assert entries == ["from scratch", "trained model as prior", "Trained model, no trial of this body"]
    assert len({axes.get_ylim() for axes in figure.axes}) == 1
    assert [axes.get_title() for axes in figure.axes] == ["Square", "Triangle"]
    figure = quality.training(torch.ones(5), {"P_t": {"v_t": 0.4}, "P_n": {"v_n": 0.7, "v_t": 0.1}})
    left, right = figure.axes
    assert left.get_legend() is None
    assert [bar.get_width() for bars in right.containers for bar in bars] == [0.4, 0, 0.1, 0.7]
    assert [tick.get_text() for tick in right.get_yticklabels()] == ["v_t", "v_n"]


ONE = {"x1_wrench": decay(0.3)}
PAIR = torch.zeros(2, 3)
BAD = {
    "no sizes": (lambda: learning.learning_curve([], ONE, {}, METRIC), "got 0 and 1"),
    "no curves": (lambda: learning.learning_curve(SIZES, {}, {}, METRIC), "got 7 and 0"),
    "other sizes": (lambda: learning.learning_curve(SIZES[1:], ONE, {}, METRIC), r"'x1_wrench' must be \(6, 3\)"),
    "falling sizes": (lambda: learning.learning_curve(SIZES[::-1], ONE, {}, METRIC), "must increase"),
    "no impacts": (lambda: learning.learning_curve([0, *SIZES[1:]], ONE, {}, METRIC), "1 or more, got .0, 25"),
    "no errors": (lambda: learning.error_densities({}, METRIC), "each model, got none"),
    "no trial": (lambda: learning.error_densities({"a": torch.ones(0)}, METRIC), "others of .*'a'"),
    "nan": (lambda: learning.error_densities({"a": torch.tensor([torch.nan])}, METRIC), "finite .*'a'"),
    "negative": (lambda: learning.error_densities({"a": -torch.ones(3)}, METRIC), "≥ 0 .*'a'"),
    "no velocities": (lambda: quality.predicted_against_measured(PAIR[:0], PAIR[:0]), "N ≥ 1"),
    "other trials": (lambda: quality.predicted_against_measured(PAIR, PAIR[:1]), r"\(2, 3\), \(1, 3\)"),
    "no spin": (lambda: quality.predicted_against_measured(PAIR[:, :2], PAIR[:, :2]), r"\(2, 2\)"),
    "no coverage": (lambda: quality.calibration_curve({}), "at least one model"),
    "no levels": (lambda: quality.calibration_curve({"a": (PAIR[:0, 0], PAIR[:0, 0])}), "got 0 and 0"),
    "other levels": (lambda: quality.calibration_curve({"a": (PAIR[0], PAIR[0, :2])}), "'a' .* got 3 and 2"),
    "no bodies": (lambda: learning.transfer_errors(SIZES, {}, {}, METRIC), "at least one body"),
    "no model of a body": (lambda: learning.transfer_errors(SIZES, {"Square": {}}, {}, METRIC), "got 7 and 0"),
    "transfer at other sizes": (lambda: learning.transfer_errors(SIZES[1:], {"Square": ONE}, {}, METRIC),
        "must be .6, 3"),
    "no iterations": (lambda: quality.training(torch.ones(0), {"P_t": {"v_t": 1.0}}), "one iteration"),
    "no features": (lambda: quality.training(torch.ones(3), {"P_t": {}}), "one relevance"),
}  # fmt: skip


@pytest.mark.parametrize(("build", "message"), BAD.values(), ids=BAD)
def test_what_cannot_be_drawn_is_refused(build, message):
    with pytest.raises(ContactLearnError, match=message):
        build()
