"""Figures of a diagnosis: they show its numbers, say their units, and no finding or name breaks them."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
import torch
from corruptions import corrupt
from diagnoses import few
from matplotlib.text import Text
from test_figures import DEGENERATE, HOSTILE, assert_fits, assert_units, visible_axes

from contactlearn.data.audit.contradictions import contradictions
from contactlearn.data.audit.corrections import correct
from contactlearn.data.audit.evidence import balance_evidence
from contactlearn.data.audit.findings import audit
from contactlearn.data.audit.moments import balance, torque
from contactlearn.data.audit.result import Finding
from contactlearn.diagnosis import result
from contactlearn.diagnosis.options import DiagnoseOptions
from contactlearn.diagnosis.pipeline import diagnose
from contactlearn.effects import EffectId
from contactlearn.inference.evaluation.metrics import Interval, mass_error
from contactlearn.inference.evaluation.partial_residuals import Partial
from contactlearn.inference.evaluation.variables import variables
from contactlearn.laws import find
from contactlearn.mechanics.impacts import Impacts
from contactlearn.report.figures import style as st
from contactlearn.report.figures.diagnosis import audit_figure, drawn, ladder_figure, regions_figure, residual_figure
from contactlearn.report.figures.effects import effect_curve
from contactlearn.report.text.names import rung_label
from contactlearn.simulation import hidden_effects

UNIT = re.compile(r"\((\$10\^\{-?\d+\}\$ )?(mN m s|mN s|mm|m/s|rad/s|rad|°|kg|m|s|–|count)\)")
TRIALS = 150


@pytest.fixture(scope="module")
def drops() -> Impacts:
    return hidden_effects.draw(700, effects=[], size=TRIALS)[0]


@pytest.fixture(scope="module")
def found() -> result.Diagnosis:
    impacts, truth = hidden_effects.draw(3, effects=["spin_damping"], size=250)
    return diagnose(impacts, find(truth["law"]), options=DiagnoseOptions(candidates=few("spin_damping", "adhesion")))


def refused(findings: tuple[Finding, ...], raw: Impacts) -> result.Diagnosis:
    """A diagnosis without a model, of data with these findings."""
    shown = balance_evidence(findings, raw)
    about = {"verdict": result.Verdict.BAD_DATA, "law": "best", "variant": "textbook"}
    return result.Diagnosis(**about, findings=tuple(findings), evidence=shown)


def pictured(finding: Finding, raw: Impacts):
    return audit_figure(finding, balance_evidence([finding], raw)[finding.name])


def recorded(record: result.Record, **changes) -> result.Record:
    """A record with some of its parts changed."""
    return result.Record(**{name: getattr(record, name) for name in result.Record.__slots__} | changes)


def of_regions(found: result.Diagnosis):
    return regions_figure(found.regions, found.record)


def of_residual(found: result.Diagnosis):
    return residual_figure(found.remainder, found.record)


def shuffled(drops: Impacts) -> Impacts:
    order = torch.randperm(TRIALS, generator=torch.Generator().manual_seed(0))
    return drops.replace(v_post=drops.v_post[order] * torch.tensor((1.0, -1.0, 3.0)), validate=False)


SPOILT = {
    "mirrored_x": lambda d: corrupt(d, "mirrored_x"),
    "swapped_axes": lambda d: corrupt(d, "swapped_axes"),
    "swapped_pre_post": lambda d: corrupt(d.replace(q_post=d.q), "swapped_pre_post"),
    "degrees": lambda d: corrupt(d, "degrees"),
    "millimetres": lambda d: corrupt(d, "millimetres"),
    "inertia_scaled": lambda d: d.replace(inertia=1e7 * d.inertia),
    "impossible": shuffled,
}  # fmt: skip
"""Data with findings about the moment balance, by their names."""


def assert_sound(figure) -> None:
    """It fits its paper, has units wherever it has numbers, and one size of text."""
    assert_fits(figure)
    assert figure.get_figwidth() in (st.COLUMN, st.PAGE)
    assert_units(figure, UNIT)
    assert {text.get_fontsize() for text in figure.findobj(Text) if text.get_text().strip()} == {st.FONT_SIZE}


def line(axes, label: str) -> np.ndarray:
    """Points [n, 2] of what a panel's legend calls `label`."""
    (one,) = (one for one in axes.lines if one.get_label() == label)
    return np.stack(one.get_data(), -1)


@pytest.mark.parametrize("name", SPOILT)
def test_findings_about_the_balance_have_a_figure(name, drops):
    spoilt = SPOILT[name](drops)
    findings = audit(spoilt)
    assert name in [finding.name for finding in findings]
    figures = drawn(refused(findings, spoilt))
    assert {*figures} <= {f"audit_{finding.name}" for finding in findings}
    for figure in figures.values():
        assert_sound(figure)
    figure = figures[f"audit_{name}"]
    number = r"[ab] = −?\d+\.\d\d"
    assert re.fullmatch(rf"Moment balance: (({number}(, {number})?|open)( → )?)+", figure.get_suptitle())


def test_the_figure_of_a_finding_is_written(drops, tmp_path):
    spoilt = SPOILT["mirrored_x"](drops)
    figure = drawn(refused(audit(spoilt), spoilt))["audit_mirrored_x"]
    png, pdf = st.save(figure, tmp_path, "mirrored_x")
    assert png.read_bytes().startswith(b"\x89PNG")
    assert pdf.read_bytes().startswith(b"%PDF")


@pytest.mark.parametrize("name", ["mirrored_x", "degrees", "inertia_scaled"])
def test_the_moment_balance_is_shown_without_and_with_the_correction(name, drops):
    spoilt = SPOILT[name](drops)
    mended = correct(spoilt, [name])
    (finding,) = audit(spoilt)
    *panels, answers = pictured(finding, spoilt).axes
    for axes, impacts, message in zip(panels, (spoilt, mended), ("Without", "With"), strict=True):
        title, *slopes = axes.get_title().replace("−", "-").splitlines()
        assert title == f"{message} {name}"
        fit = balance(impacts)
        for text, value, error in zip(slopes, (fit.a, fit.b), (fit.a_error, fit.b_error), strict=True):
            if error == math.inf:
                assert text.endswith("is open")
            else:
                assert float(text.split()[2]) == pytest.approx(value, rel=0.01)
        power = re.search(r"10\^\{(-?\d+)\}", axes.get_xlabel())
        unit = 1e-3 * 10.0 ** (int(power[1]) if power else 0)
        terms = torque(impacts)
        made, spin = (unit * line(axes, "Trial")).T
        assert made == pytest.approx((impacts.inertia * (terms.normal + terms.tangential)).numpy(), rel=1e-9)
        assert spin == pytest.approx((impacts.inertia * terms.spin).numpy(), rel=1e-9)
        balanced = next(one for one in axes.lines if one.get_label() == "Slope 1: balanced")
        assert balanced.get_slope() == 1
        assert axes.get_xlim() == axes.get_ylim() == (-axes.get_xlim()[1], axes.get_xlim()[1])
    for impacts, message in ((spoilt, "Without"), (mended, "With")):
        means = [answer.mean().item() for answer in contradictions(impacts).values()]
        assert line(answers, f"{message} {name}")[:, 0] == pytest.approx(means)
    assert len(answers.get_yticklabels()) == len(means)


def test_each_of_two_corrections_is_shown_after_the_one_before_it(drops):
    spoilt = corrupt(drops, "mirrored_x", "grams")
    findings = audit(spoilt)
    first, second = drawn(refused(findings, spoilt)).values()
    assert [finding.correction for finding in findings] == ["mirrored_x", "grams"]
    half = correct(spoilt, ["mirrored_x"])
    shown = line(first.axes[1], "Trial"), line(second.axes[0], "Trial"), line(second.axes[1], "Trial")
    assert (shown[0] == shown[1]).all()
    assert (shown[1][:, 1] == (1e3 * (half.inertia * torque(half).spin)).numpy()).all()
    assert abs(shown[2][:, 0] - shown[2][:, 1]).max() < 0.2


def test_a_finding_without_correction_shows_the_data_as_read(drops):
    (finding,) = audit(shuffled(drops))
    assert finding.fatal
    best = replace(finding, hypothesis=("mirrored_x",))
    *panels, _ = drawn(refused((best,), shuffled(drops)))["audit_impossible"].axes
    assert [axes.get_title().splitlines()[0] for axes in panels] == ["As read", "Under the best hypothesis"]
    best = replace(finding, hypothesis=())
    panels = drawn(refused((best,), shuffled(drops)))["audit_impossible"].axes
    assert len(panels) == 2


def with_regions(found: result.Diagnosis, *limits: tuple[str, float, float]) -> result.Diagnosis:
    record = found.record
    known = {v.name: v for v in variables(record.impacts, record.base.predict(record.impacts))}
    regions = (
        result.Region(
            variable=name, where=known[name].window_text(low, high), low=low if math.isfinite(low) else None,
            high=high if math.isfinite(high) else None, ratio=Interval(2.3, 1.5, 3.0), p_value=3e-8,
            rows=tuple(range(250)),
        )
        for name, low, high in limits
    )  # fmt: skip
    return replace(found, regions=tuple(regions))


def shaded(axes) -> tuple[float, float]:
    (span,) = (patch for patch in axes.patches if patch.get_label() == "Region")
    return span.get_x(), span.get_x() + span.get_width()


DEGREE = math.pi / 180
LIMITS = {
    "inside": ("spin", -3.0, 2.5, (-3, 2.5), "ω (rad/s)"),
    "degrees": ("incidence", 10 * DEGREE, 30 * DEGREE, (10, 30), "incidence (°)"),
    "folded": ("theta_folded", -20 * DEGREE, 18 * DEGREE, (160, 198), "θ (°)"),
    "around": ("theta", 170 * DEGREE, 210 * DEGREE, (-190, -150), "θ (°)"),
    "mode": ("mode", -0.5, 0.5, (-0.5, 0.5), ""),
    "direction": ("direction", 0.5, math.inf, (0.5, 1.5), ""),
}


@pytest.mark.parametrize("case", LIMITS)
def test_the_shaded_span_is_the_region(case, found):
    name, low, high, wanted, label = LIMITS[case]
    (axes,) = of_regions(with_regions(found, (name, low, high))).axes
    assert shaded(axes) == pytest.approx(wanted)
    assert axes.get_xlabel() == label
    assert axes.get_ylabel() == "Mass-weighted velocity error (–)"
    assert axes.get_xlim()[0] <= wanted[0] < wanted[1] <= axes.get_xlim()[1]
    if "θ" in label:
        assert sum(axes.get_xlim()) / 2 == pytest.approx(sum(wanted) / 2)


@pytest.mark.parametrize("groups", ["ab", "abcd"])
def test_a_region_of_a_group_of_any_number(groups, found):
    sessions = tuple(groups[k % len(groups)] for k in range(250))
    there = recorded(found.record, impacts=found.record.impacts.replace(covariates={"session": sessions}))
    (axes,) = of_regions(with_regions(replace(found, record=there), ("session", -1.5, -0.5))).axes
    assert sorted(label.get_text() for label in axes.get_xticklabels()) == [f"session {name}" for name in groups]
    assert axes.get_xlim() == (-1.5, len(groups) - 1.5)
    assert shaded(axes) == (-1.5, -0.5)


def test_up_to_five_regions_reach_the_ends_of_their_axes(found):
    left, right = of_regions(with_regions(found, ("location", -math.inf, 0.3), ("spin_rate", 4, math.inf))).axes
    assert shaded(left) == pytest.approx((left.get_xlim()[0], 0.3))
    assert shaded(right) == pytest.approx((4, right.get_xlim()[1]))
    regions = with_regions(found, ("mode", -0.5, 0.5), ("spin", -3, 2)).regions
    figure = regions_figure(regions, recorded(found.record, model=found.record.base, residuals=()))
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        "Region", "Trial, law", "Law, running median",
    ]  # fmt: skip


def test_errors_of_law_and_model_are_those_of_all_trials(found):
    (axes,) = of_regions(with_regions(found, ("spin", -3, 2.5))).axes
    impacts = found.record.impacts
    before, after = (mass_error(impacts, model.predict(impacts)) for model in (found.record.base, found.record.model))
    points = line(axes, "Trial, law")
    assert len(points) == 250
    assert (points[:, 0] == impacts.v_pre[:, 2].numpy()).all()
    assert (points[:, 1] == before.numpy()).all()
    order = impacts.v_pre[:, 2].argsort()
    for label, errors in (("Law", before), ("With effects", after)):
        middle = line(axes, f"{label}, running median")[-1]
        last = order[-20:]
        assert middle == pytest.approx((np.median(impacts.v_pre[last, 2]), np.median(errors[last])))
    title = " ".join(axes.get_title().replace("\u00a0", " ").splitlines())
    assert title == "-3 ≤ ω < 2.5 rad/s 2.3× the error elsewhere, 250 trials, p = 3e−8"


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_up_to_five_regions_have_a_panel_each(count, found):
    limits = [limits[:3] for limits in LIMITS.values()][:count]
    figure = of_regions(with_regions(found, *limits))
    assert len(visible_axes(figure)) == count
    assert_sound(figure)


COMPONENTS = tuple(result.WrenchComponent)


def with_remainder(
    found: result.Diagnosis, components: tuple[str, ...], variables: dict[str, float]
) -> result.Diagnosis:
    tested = tuple(
        result.ComponentTest(
            component=name, r_squared=0.1 + 0.2 * k, standard_error=0.03, error_reduction=0.1, clear=True
        )
        for k, name in enumerate(COMPONENTS)
    )
    shares = tuple(result.VariableShare(symbol=symbol, share=share) for symbol, share in variables.items())
    share = Interval(0.3, 0.2, 0.4) if components else Interval(0.0, -0.1, 0.1)
    named = tuple(map(result.WrenchComponent, components))
    left = replace(found.remainder, components=named, variables=shares, tested=tested, share=share)
    return replace(found, remainder=left)


@pytest.mark.parametrize(
    ("components", "variables"),
    [(("n",), {"vx": 0.9}), (("tau", "t"), {"theta": 0.6, "omega": 0.3, "x": 0.1}), (COMPONENTS, {"m": 1.0}), ((), {})],
    ids=["one", "two by two", "three", "nothing"],
)
def test_what_remains_is_the_measured_wrench_without_the_models(components, variables, found):
    figure = of_residual(with_remainder(found, components, variables))
    assert_sound(figure)
    columns, rows = min(2, len(variables)) or 1, len(components) or 1
    assert len(figure.axes) == columns * rows
    left = 1e3 * (found.record.impacts.wrench - found.record.model.predict(found.record.impacts).wrench)
    for axes, name in zip(figure.axes[::columns], components or ("tau",), strict=True):
        k = COMPONENTS.index(result.WrenchComponent(name))
        label = ("Residual of P_t (mN s)", "Residual of P_n (mN s)", "Residual of τ (mN m s)")[k]
        assert axes.get_ylabel() == label
        assert f"R² = {0.1 + 0.2 * k:.2f} ± 0.03" in axes.get_title(loc="left")
        shown = line(axes, "Trial")[:, 1]
        assert set(shown) <= set(left[:, k].tolist())
        assert 0.97 * 250 <= len(shown) <= 0.99 * 250
        bars = next(one for one in axes.containers if "Mean of" in one.get_label())
        y = bars.lines[0].get_ydata()
        assert len(y) == 20
        assert y.mean() == pytest.approx(shown.mean(), abs=0.1 * shown.std())
    message = " ".join(figure.get_suptitle().split())
    assert message == (
        "Gaussian processes on the residual reduce the held-out error by 30 % (20 % to 40 %)"
        if components
        else "Gaussian processes predict no component of the residual significantly on held-out trials."
    )


def test_means_and_standard_errors_are_those_of_the_trials_in_a_group(found):
    (axes,) = of_residual(with_remainder(found, ("n",), {"vx": 1.0})).axes
    assert axes.get_xlabel() == "v_x (m/s), 100\u00a0% of the prediction"
    points = line(axes, "Trial")
    points = points[points[:, 0].argsort(kind="stable")]
    groups = np.array_split(points, 20)
    bars = next(one for one in axes.containers if "Mean of" in one.get_label())
    assert np.stack(bars.lines[0].get_data(), -1) == pytest.approx(np.stack([group.mean(0) for group in groups]))
    heights = [np.ptp(segment[:, 1]) / 2 for segment in bars.lines[2][0].get_segments()]
    wanted = [group[:, 1].std() / math.sqrt(len(points) / 20) for group in groups]
    assert heights == pytest.approx(wanted)
    impacts = found.record.impacts
    turned = impacts.replace(q=impacts.q + torch.tensor((0, 0, 14 * math.pi), dtype=torch.float64))
    left = with_remainder(found, ("tau",), {"theta": 1.0}).remainder
    (axes,) = residual_figure(left, recorded(found.record, impacts=turned)).axes
    assert abs(line(axes, "Trial")[:, 0]).max() <= math.pi


def test_a_diagnosis_is_drawn_by_name(found):
    figures = drawn(with_regions(found, ("spin", -3, 2)))
    effects = [f"effect_{str(missing.effect).replace(':', '_')}" for missing in found.missing]
    assert found.effects == ("spin_damping",)
    audit = [f"audit_{name}" for name in found.evidence]
    assert list(figures) == [*audit, "regions", "residual", *effects, "ladder", "budget", "frontier"]
    for name in ("regions", "residual", "ladder", "frontier"):
        assert_sound(figures[name])
    assert "regions" not in drawn(replace(found, regions=()))


def test_the_ladder_shows_errors_intervals_and_the_bound(found):
    (axes,) = ladder_figure(found).axes
    errors = [rung.error for rung in found.ladder]
    assert [bar.get_width() for bar in axes.patches] == [error.mean for error in errors]
    (intervals,), (bound,) = axes.collections, axes.lines
    assert [tuple(ends[:, 0]) for ends in intervals.get_segments()] == [(error.low, error.high) for error in errors]
    assert bound.get_xdata()[0] == found.budget.bound.mean
    assert axes.get_xlim()[0] == 0
    names = [rung_label(rung, "Wang–Mason") for rung in found.ladder]
    written = [text.get_text() for text in axes.texts]
    assert written == [f"{rung.error.mean:.4f}  {name}" for rung, name in zip(found.ladder, names, strict=True)]
    rungs = (result.Rung(kind=result.RungKind.EFFECT, error=errors[0], effect=EffectId(name)) for name in HOSTILE)
    assert_sound(ladder_figure(replace(found, ladder=tuple(rungs))))


@pytest.mark.parametrize("kind", DEGENERATE.values(), ids=DEGENERATE)
def test_evidence_of_degenerate_impacts_is_drawn(kind, drops):
    """Vertical drops have no moments."""
    finding = Finding(name="consistent", sentence="", evidence=())
    pictured(finding, kind(drops)).draw_without_rendering()


def test_an_effect_that_changes_nothing_is_drawn():
    zero = torch.zeros(30, dtype=torch.float64)
    partial = Partial("side_drag", "P_t", "N s", "x", "m", torch.linspace(0, 1, 30), zero, zero)
    effect_curve(partial).draw_without_rendering()
