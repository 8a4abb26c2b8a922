"""Figures: they draw the right numbers, say their units, and no name or data breaks or clips them."""

import html
import itertools
import json
import re
import string
from contextlib import contextmanager
from pathlib import Path

import matplotlib
import numpy as np
import pytest
import torch
from contacts import impulse
from matplotlib.colors import to_hex, to_rgb
from matplotlib.text import Text
from scipy.spatial import cKDTree

from contactlearn import laws
from contactlearn.core.errors import ContactLearnError
from contactlearn.inference.evaluation import bounds
from contactlearn.inference.evaluation.impulse_space import ImpulseSpace
from contactlearn.inference.evaluation.reach import reached_cells
from contactlearn.inference.identification import shared as fit
from contactlearn.inference.identification.per_trial import fit_trials
from contactlearn.mechanics import rigid_body
from contactlearn.mechanics.hull import signed_areas
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.shapes import Disc
from contactlearn.report.figures import laws as figures, learning, style
from contactlearn.report.figures.browser import as_plotly
from contactlearn.report.figures.comparison import error_comparison, patch_curve
from contactlearn.report.figures.impulse_space import compared_impulses, reachable_impulses
from contactlearn.report.figures.style import LAW_STYLE, MODEL_STYLE, law_style, new_figure, plain, save
from contactlearn.simulation import synthetic

UNIT = re.compile(r"\((mN s|mm|s/m|–|count)\)")
HOSTILE = (
    "price_$5",
    "$x$ & $y",
    "_hidden",
    "<b>bold</b>",
    r"\frac{1}{2}$",
    "two\nlines\t字",
    "x" * 60,
    "long name " * 6,
)
TABLE = torch.tensor([[0.3, 0.2, 0.4], [0.2, 0.1, 0.25]])
BOUND = (0.1, 0.08, 0.12)
PIXEL = 1.5  # px at 100 dpi: text's own extent is rounded outwards


def reached(impacts: Impacts, row: int, given):
    return reachable_impulses(ImpulseSpace.of(impacts[[row]], given))


@pytest.fixture(scope="module")
def drops() -> Impacts:
    return synthetic.load(size=80)


def six(variant: str) -> dict[str, laws.Law]:
    return {name: laws.find(name, variant).at(0.12, 0.55) for name in laws.PAPER_LAWS}


def inadmissible(drops: Impacts, name: str = "1") -> Impacts:
    """One drop that comes back faster than it came."""
    return drops[[0]].replace(v_post=drops.v_pre[:1] * torch.tensor([1.0, -1.2, 1.0]), trial=(name,))


def shared(drops: Impacts, **options) -> fit.SubsetFit:
    return fit.fit_subsets(drops, laws.find("whittaker"), **{"sizes": (1, 2, 5, 10, 20), "repetitions": 8} | options)


def surface(drops: Impacts):
    mu, eps = fit.Box(nodes=16).axes()
    law = laws.find("wang_mason")
    return figures.cost_map(mu, eps, fit.cost_surface(law, drops, mu, eps), (0.12, 0.55), law, len(drops))


def comparison(names=(*LAW_STYLE, "X1 → (P, τ), 450 trials")):
    errors = {name: 0.1 + 0.02 * place + torch.rand(60, dtype=torch.float64) for place, name in enumerate(names)}
    intervals = {name: (x.mean().item(), x.mean().item() - 0.03, x.mean().item() + 0.05) for name, x in errors.items()}
    return error_comparison(errors, intervals, "Normalised velocity error (–)")


def patch(names=("anitescu_potra_newton", "best_post_hoc")):
    mean = torch.tensor([0.4, 0.3, 0.25])
    errors = torch.stack((mean, mean - 0.02, mean + 0.02), -1)
    return patch_curve([0, 1, 2], errors, dict.fromkeys(names, 0.45), "Normalised velocity error (–)")


FIGURES = {
    "ellipse inadmissible": lambda d: reached(inadmissible(d), 0, six("fazeli2017")),
    "ellipse one": lambda d: reached(inadmissible(d), 0, {"mirtich": laws.find("mirtich").at(0.1, 0.5)}),
    "ellipse seven": lambda d: reached(d, 5, {n: laws.find(n).at(0.1, 0.5) for n in laws.names()}),
    "cost surface": surface,
    "convergence": lambda d: figures.convergence(shared(d)),
    "convergence once": lambda d: figures.convergence(shared(d, sizes=(3,), repetitions=1)),
    "error comparison": lambda d: comparison(),
    "trial parameters": lambda d: figures.trial_parameters(fit_trials(d, laws.find("anitescu_potra_newton")), d),
    "patch curve": lambda d: patch(),
}


def visible_axes(figure) -> list:
    return [axes for axes in figure.axes if axes.get_visible()]


def assert_fits(figure) -> None:
    """Nothing written leaves the paper, and no title, axis label or legend entry lies on another."""
    figure.draw_without_rendering()
    labels = [figure._suptitle] if figure._suptitle else []
    for axes in visible_axes(figure):
        labels += [axes.title, axes.xaxis.label, axes.yaxis.label]
    for holder in (figure, *figure.subfigs):
        labels += [text for legend in holder.legends for text in legend.get_texts()]
    labels = [text for text in labels if text.get_text().strip()]
    boxes = {text: text.get_window_extent().padded(-PIXEL) for text in labels}
    for a, b in itertools.combinations(labels, 2):
        assert not boxes[a].overlaps(boxes[b]), (a, b)
    ticks = [axes.yaxis.get_tightbbox() for axes in visible_axes(figure)]
    for text, box in (*boxes.items(), *enumerate(box.padded(-PIXEL) for box in ticks if box)):
        assert box.x0 >= 0, text
        assert box.x1 <= figure.bbox.x1, text
        assert box.y0 >= 0, text
        assert box.y1 <= figure.bbox.y1, text


def assert_units(figure, unit=UNIT) -> None:
    """Wherever an axis has numbers, it or the one it is shared with has a label with their unit."""
    for axes, name in itertools.product(visible_axes(figure), "xy"):
        numbers = any(re.search(r"^−?\d", tick.get_text()) for tick in getattr(axes, f"get_{name}ticklabels")())
        siblings = getattr(axes, f"get_shared_{name}_axes")().get_siblings(axes)
        labels = [getattr(sibling, f"get_{name}label")() for sibling in siblings]
        assert not numbers or any(map(unit.search, labels)), (axes, name, labels)


@pytest.mark.parametrize("build", FIGURES.values(), ids=FIGURES)
def test_every_figure_fits_names_its_units_and_is_written_as_vectors(build, drops, tmp_path):
    before = dict(matplotlib.rcParams)
    figure = build(drops)
    assert dict(matplotlib.rcParams) == before
    assert figure.get_figwidth() in (3.4, 7.0)
    assert_fits(figure)
    assert_units(figure)
    assert all(text.get_fontsize() == 8 for text in figure.findobj(Text) if text.get_text().strip())
    png, pdf = (path.read_bytes() for path in save(figure, tmp_path / "new", "name"))
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == ["name.pdf", "name.png"]
    assert png.startswith(b"\x89PNG")
    assert int.from_bytes(png[16:20], "big") == round(200 * figure.get_figwidth())
    assert pdf.startswith(b"%PDF")
    assert b"/CIDFontType2" in pdf  # TrueType
    for forbidden in (b"/Type3", b"/Subtype /Image", b"CreationDate"):
        assert forbidden not in pdf
    assert len(pdf) < 500_000


def of_a_disc(drops: Impacts, v_post: torch.Tensor, v_pre: torch.Tensor) -> Impacts:
    """A disc of 33 mm whose contact point lies below its centre."""
    zero = torch.zeros(len(drops), dtype=torch.float64)
    r, q = torch.stack((zero, zero - 0.033), -1), torch.stack((zero, zero + 0.033, zero), -1)
    inertia = 0.5 * 0.033**2 * drops.mass
    return drops.replace(shape=Disc(0.033), r=r, q=q, inertia=inertia, v_pre=v_pre, v_post=v_post)


def motion(drops: Impacts, vx: float, vy: float, omega: float) -> torch.Tensor:
    return drops.v_pre * torch.tensor((vx, vy, omega), dtype=torch.float64)


DEGENERATE = {
    "vertical": lambda d: of_a_disc(d, v_pre=motion(d, 0, 1, 0), v_post=motion(d, 0, -0.7, 0)),
    "elastic, no friction": lambda d: of_a_disc(d, v_pre=d.v_pre, v_post=motion(d, 1, -1, 1)),
    "at rest afterwards": lambda d: of_a_disc(d, v_pre=d.v_pre, v_post=motion(d, 0, 0, 0)),
    "all the same": lambda d: of_a_disc(
        d, v_pre=d.v_pre[:1].expand(len(d), 3), v_post=motion(d[:1], 0.9, -0.7, 1).expand(len(d), 3)
    ),
}


@pytest.mark.parametrize("build", [FIGURES["ellipse seven"], FIGURES["cost surface"], FIGURES["trial parameters"]])
@pytest.mark.parametrize("kind", DEGENERATE.values(), ids=DEGENERATE)
def test_figures_of_degenerate_impacts_are_drawn(kind, build, drops):
    """Warnings are errors, such as those of axes that end where they begin."""
    build(kind(drops)).draw_without_rendering()


def test_same_figure_gives_same_bytes(tmp_path, monkeypatch):
    first, second = ([path.read_bytes() for path in save(patch(), tmp_path, "a")] for _ in range(2))
    assert first == second
    figure = patch()
    old = [path.read_bytes() for path in save(figure, tmp_path, "a")]
    write = figure.savefig

    def fail_on_pdf(file, **options):
        write(file, **options)
        if options["format"] == "pdf":
            raise OSError("disk full")

    monkeypatch.setattr(figure, "savefig", fail_on_pdf)
    figure.suptitle("changed")
    with pytest.raises(OSError, match="disk full"):
        save(figure, tmp_path, "a")
    assert [(tmp_path / f"a{suffix}").read_bytes() for suffix in (".png", ".pdf")] == old
    assert len(list(tmp_path.iterdir())) == 2
    sources = [path.read_text() for path in Path(figures.__file__).parent.glob("*.py")]
    assert len(sources) > 3
    assert not any("pyplot" in source for source in sources)


def traces_of(shown):
    return {trace["meta"] or trace["name"]: trace for trace in shown["data"]}


def test_a_browser_shows_symbols_with_subscripts():
    figure = learning.learning_curve([10, 100], {"mirtich": TABLE}, {}, "Residual of P_n, my_x, v_n⁺ (mN s)")
    words = "Residual of P<sub>n</sub>, my_x, v<sub>n</sub>⁺ (mN s)"
    assert as_plotly(figure)["layout"]["yaxis"]["title"]["text"] == words


def test_a_browser_shows_the_same_numbers_labels_and_scales(drops):
    figure = learning.learning_curve([10, 100], {"x1_wrench": TABLE, "mirtich": TABLE + 0.1}, {"irb": BOUND}, "e (–)")
    shown = as_plotly(figure)
    json.dumps(shown, allow_nan=False)
    first, second = (traces_of(shown)[name] for name in ("X1 → wrench", "Mirtich"))
    assert (first["y"], second["y"]) == (pytest.approx([0.3, 0.2]), pytest.approx([0.4, 0.3]))
    assert (first["xaxis"], second["xaxis"]) == ("x", "x2")
    assert first["line"]["color"] == to_hex(law_style("x1_wrench").color).lower()
    layout = shown["layout"]
    assert layout["xaxis"]["type"] == "log"
    assert layout["xaxis"]["ticktext"] == ["100", "10"]
    assert layout["yaxis"]["range"] == list(figure.axes[0].get_ylim())
    assert layout["yaxis"]["title"]["text"] == "e (–)"
    assert (layout["xaxis2"]["matches"], layout["yaxis2"]["matches"]) == ("x", "y")
    assert [note["text"] for note in layout["annotations"]] == ["Learned without a law (Class I)", "Others"]
    bands = [(one["y0"], one["y1"]) for one in layout["shapes"] if one["type"] == "rect"]
    assert bands == [pytest.approx(BOUND[1:])] * 2
    assert [one["showlegend"] for one in layout["shapes"] if one["name"] == "IRB bound"] == [True, False]


def test_a_browser_shows_bars_boxes_and_hidden_markers(drops):
    shown = as_plotly(comparison(("irb", "mirtich")))
    assert shown["layout"]["yaxis"]["ticktext"] == ["IRB bound", "Mirtich"]
    assert shown["layout"]["yaxis"]["range"][0] > shown["layout"]["yaxis"]["range"][1]
    assert [bool(one.get("fillpattern")) for one in shown["data"] if one.get("fill")] == [True, False]
    assert "Mean, 95 % interval" in traces_of(shown)
    densities = as_plotly(learning.error_densities({"x1_wrench": torch.rand(50)}, "e (–)"))
    (line,) = densities["data"]
    assert sum(size > 0 for size in line["marker"]["size"]) == 1
    with pytest.raises(TypeError, match="no counterpart"):
        as_plotly(surface(drops))


def test_a_browser_shows_every_law_in_impulse_space(drops):
    laws_ = six("fazeli2017")
    shown = as_plotly(compared_impulses(ImpulseSpace.of(drops[[3]], laws_, reached=1)))
    traces = traces_of(shown)
    for place, law in enumerate(laws_.values()):
        P = 1e3 * law.impulse(drops.W[3], drops.v_c[3])
        assert traces[f"law {place}"]["x"] + traces[f"law {place}"]["y"] == pytest.approx(P.tolist())
    assert shown["layout"]["xaxis"]["title"]["text"] == "Tangential impulse P<sub>t</sub> (mN s)"
    assert shown["layout"]["yaxis"]["scaleanchor"] == "x"
    vectors = rigid_body.ellipse_vectors(drops.W, drops.v_c)
    angle = torch.linspace(0, 6, 30, dtype=torch.float64)[:, None, None]
    P = vectors[:, 0] + angle.cos() * vectors[:, 1] + angle.sin() * vectors[:, 2]
    energy = (drops.v_c * vectors[:, 0]).sum(-1).abs()
    assert (rigid_body.energy_excess(drops.W, drops.v_c, P).abs() < 1e-9 * energy).all()


@pytest.mark.parametrize("name", HOSTILE)
def test_names_in_a_browser_are_text(name):
    shown = as_plotly(patch((name, "best_post_hoc")))
    assert "<" not in shown["layout"]["shapes"][0]["name"]
    assert html.unescape(shown["layout"]["shapes"][0]["name"]) == plain(name).replace(r"\$", "$").strip()


@pytest.mark.parametrize("name", HOSTILE)
def test_names_are_shown_as_they_are(name, drops):
    figure = reached(inadmissible(drops, name), 0, {"mirtich": laws.find("mirtich").at(0.1, 0.5)})
    assert_fits(figure)
    shown = " ".join(name.split())[:9]
    assert shown in figure.get_suptitle().replace(r"\$", "$")
    assert_fits(comparison(("wang_mason", name, f"$ {name}")))
    figure = patch((name, "best_post_hoc"))
    assert_fits(figure)
    assert len(figure.legends[0].get_texts()) == 3


def test_plain_text_is_no_formula():
    assert Text(text=plain("$a_b$"))._preprocess_math(plain("$a_b$")) == ("$a_b$", False)
    assert plain("x" * 30 + "y" * 30) == "x" * 20 + "…" + "y" * 19
    assert plain("π字") == "π?"
    assert law_style("Wang–Mason") is law_style("wang_mason") is LAW_STYLE["wang_mason"]
    assert law_style("my GP").label == "my GP"


def _seen(color: str, blindness: str) -> np.ndarray:
    """CIE L*a*b* of a colour as a dichromat sees it (Machado et al., 2009)."""
    rgb = np.array(to_rgb(color))
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    linear = (np.array(MACHADO[blindness]) @ linear).clip(0, 1)
    to_xyz = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    x = np.array(to_xyz) @ linear / np.array((0.9505, 1, 1.089))
    f = np.where(x > 0.008856, np.cbrt(x), 7.787 * x + 16 / 116)
    return np.array((116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])))


MACHADO = {
    "none": np.eye(3),
    "protan": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deutan": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritan": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}


@pytest.mark.parametrize("blindness", MACHADO)
def test_every_law_and_model_has_its_own_color_marker_and_line(blindness):
    known = {name: law_style(name) for name in (*laws.names(), "best_post_hoc", "irb")}
    assert known.items() >= LAW_STYLE.items()
    for styles, part in itertools.product((known, MODEL_STYLE), ("label", "color", "marker", "linestyle")):
        assert len({getattr(style, part) for style in styles.values()}) == len(styles)
    colors = {name: _seen(style.color, blindness) for name, style in (known | MODEL_STYLE).items()}
    pairs = [*itertools.combinations(known, 2), *itertools.combinations(LAW_STYLE | MODEL_STYLE, 2)]
    nearest = min((np.linalg.norm(colors[a] - colors[b]), a, b) for a, b in pairs)
    assert nearest[0] > 8, nearest  # ΔE of 2 to 3 is just noticed
    assert all(color[0] < 80 for color in colors.values())  # seen on white paper


@pytest.mark.parametrize("variant", ["textbook", "fazeli2017"])
@pytest.mark.parametrize("name", laws.names())
def test_reach_holds_what_the_law_gives_and_nothing_else(name, variant, drops):
    generator = torch.Generator().manual_seed(0)
    mu, eps = torch.rand(2, 4000, 1, generator=generator, dtype=torch.float64)
    for row in (3, 8):
        W, v_c = drops.W[row], drops.v_c[row]
        cells = reached_cells(laws.find(name, variant).at(0.1, 0.5), W, v_c, fit.Box())
        assert (signed_areas(cells) >= -1e-12).all()
        P = impulse(name, drops.W[[row]], drops.v_c[[row]], mu**2, eps, variant=variant)[:, 0].numpy()
        size = np.ptp(rigid_body.energy_ellipse(W, v_c).numpy(), axis=0).max()
        # Every impulse lies at a cell, and every cell at an impulse of a dense sweep.  Whittaker's P̂ jumps,
        # and there the cells are small: whole cells left out would leave 0.008.
        apart = cKDTree(np.concatenate((cells.reshape(-1, 2), cells.mean(1)))).query(P)[0].max()
        assert apart < (0.006 if (name, variant) == ("whittaker", "textbook") else 0.012) * size
        sweep = torch.linspace(0, 1, 400)[:, None] ** 2, torch.linspace(0, 1, 100)
        dense = impulse(name, W, v_c, *sweep, variant=variant).reshape(-1, 2)
        assert cKDTree(dense.numpy()).query(cells.mean(1))[0].max() < 0.02 * size


def test_ellipse_shows_measurement_prediction_and_bound(drops):
    impacts, law = inadmissible(drops), laws.find("wang_mason").at(0.12, 0.55)
    axes = reached(impacts, 0, {"wang_mason": law}).axes[0]
    points = [line.get_xydata()[0] for line in axes.lines if len(line.get_xydata()) == 1]
    expected = (law.impulse(impacts.W, impacts.v_c)[0], impacts.wrench[0, :2], bounds.irb(impacts).wrench[0, :2])
    np.testing.assert_allclose(np.sort(points, 0), np.sort(1e3 * torch.stack(expected).numpy(), 0), rtol=1e-12)
    shaded = torch.from_numpy(axes.patches[0].get_xy() / 1e3)
    assert rigid_body.admissible(impacts.W[0], impacts.v_c[0], shaded, tolerance=1e-9).all()
    inside = reached(drops, 3, {"wang_mason": law})
    assert "IRB bound" not in [text.get_text() for text in inside.legends[0].get_texts()]


def test_convergence_and_comparison_show_their_numbers(drops):
    found = shared(drops)
    upper = figures.convergence(found).axes[0]
    drawn = sorted(line.get_ydata()[-1] for line in upper.lines)
    mean, std = found.mean()[0], found.std()[0]
    np.testing.assert_allclose(drawn, (mean - std, mean, mean + std), rtol=1e-12)
    names = ("irb", "mirtich", "best_post_hoc", "my GP")
    axes = comparison(names).axes[0]
    assert [t.get_text() for t in axes.get_yticklabels()] == ["IRB bound", "Mirtich", "Best Post Hoc", "my GP"]
    assert axes.get_ylim()[0] > axes.get_ylim()[1]  # the first on top
    assert [bool(patch.get_hatch()) for patch in axes.patches] == [True, False, True, False]


def test_trials_that_leave_friction_open_are_intervals(drops):
    found = fit_trials(drops, laws.find("anitescu_potra_newton"))
    flat = int(found.flat.sum())
    assert 0 < flat < len(drops)
    axes = figures.trial_parameters(found, drops, box=fit.Box(mu=(0.0, 0.5))).axes
    lines, dots = axes[0].collections
    assert len(lines.get_segments()) == flat
    assert len(dots.get_offsets()) == len(drops) - flat
    assert max(segment[:, 0].max() for segment in lines.get_segments()) <= 0.5
    assert any(f"{flat} of 80 trials leave μ undetermined" in a.get_title() for a in axes)
    rows = found.flat.nonzero()[:, 0]
    found = fit_trials(drops[rows], laws.find("anitescu_potra_newton"))
    assert_fits(figures.trial_parameters(found, drops[rows]))
    found = fit_trials(drops[:5], laws.find("mirtich", "fazeli2017"))
    assert figures.trial_parameters(found, drops[:5]).axes[0].get_xlabel().endswith("(s/m)")


BAD = {
    "no laws": (lambda d: reached(d, 0, {}), "at least one law"),
    "other impacts": (lambda d: figures.trial_parameters(fit_trials(d[:4], laws.find("mirtich")), d), "4 .* 80"),
    "no models": (lambda d: error_comparison({}, {}, "e (–)"), "any model"),
    "no interval": (lambda d: error_comparison({"mirtich": torch.ones(3)}, {}, "e (–)"), "none for mirtich"),
    "not finite": (
        lambda d: error_comparison({"a": torch.tensor([1.0, torch.nan])}, {"a": (1, 1, 1)}, "e (–)"),
        "'a' must be finite, got 1",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("build", "message"), BAD.values(), ids=BAD)
def test_what_cannot_be_drawn_is_refused(build, message, drops):
    with pytest.raises(ContactLearnError, match=message):
        build(drops)


@pytest.mark.parametrize("ending", [".png", ".pdf"])
def test_a_full_disk_is_an_error_of_the_disk(ending, tmp_path, monkeypatch):
    @contextmanager
    def on_a_full_disk(path):
        part = tmp_path / path.name
        if path.suffix == ending:
            part.symlink_to("/dev/full")
        yield part

    monkeypatch.setattr(style, "atomic_write", on_a_full_disk)
    figure = new_figure(1, 1)
    figure.text(0, 0, "many glyphs, each a stream of the PDF: " + string.ascii_letters + string.digits)
    with pytest.raises(OSError, match="No space left on device"):
        save(figure, tmp_path, "figure")
