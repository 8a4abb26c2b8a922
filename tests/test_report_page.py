"""report.html: what it says, that it asks for nothing, and that it lives in a browser."""

import json
import re
from dataclasses import replace

import pytest
import torch
from browser import nothing_sticks_out
from diagnoses import SIX, few, made_up, provenance_of
from evaluations import evaluation_of, learning_curve

from contactlearn.data.audit.result import Evidence, Finding
from contactlearn.diagnosis.options import DiagnoseOptions
from contactlearn.diagnosis.pipeline import diagnose
from contactlearn.diagnosis.result import Candidate, Diagnosis, ErrorShares, PlausibleModel, Record, Verdict
from contactlearn.effects import EffectId
from contactlearn.inference.evaluation.bounds import irb
from contactlearn.inference.evaluation.metrics import METRICS, euclidean_error, mass_error
from contactlearn.inference.identification import joint
from contactlearn.inference.identification.joint import FitOptions
from contactlearn.laws import PAPER_LAWS, find
from contactlearn.mechanics.apparatus import Apparatus, Estimate
from contactlearn.mechanics.impacts import Prediction
from contactlearn.mechanics.rigid_body import admissible, energy_ellipse, energy_excess
from contactlearn.models.contact_model import ContactModel
from contactlearn.report.page.diagnosis import of_diagnosis, write_page
from contactlearn.report.page.evaluation import of_evaluation
from contactlearn.report.page.page import embedded, render, write
from contactlearn.report.page.trials import finely, of_outcomes
from contactlearn.results.types import CurveCalibration
from contactlearn.simulation import hidden_effects

HOSTILE = '<script>window.hacked=1</script><img src=x onerror="window.hacked=1">\'{{ 7*7 }}&<b>\u2028'
COMMAND = "contactlearn diagnose data=mystery"
QUANTISED = 2e-4  # of the largest velocity two bytes resolve 3e-5


def seeded():
    return torch.Generator().manual_seed(0)


@pytest.fixture(scope="module")
def found():
    """A tilt and a damped spin in 120 trials with names that try to be markup."""
    impacts, _ = hidden_effects.draw(11, effects=["surface_tilt", "spin_damping"], size=120)
    names = (HOSTILE, *impacts.trial[1:])
    impacts = impacts.replace(trial=names, object=(HOSTILE,) * len(impacts), source=HOSTILE)
    return diagnose(
        impacts,
        find("wang_mason"),
        options=DiagnoseOptions(candidates=few("surface_tilt", "spin_damping", "side_drag")),
    )


def about(impacts):
    return provenance_of(impacts, COMMAND, **{HOSTILE: HOSTILE})


@pytest.fixture(scope="module")
def content(found):
    return of_diagnosis(found, about(found.record.impacts), use="contactlearn evaluate")


@pytest.fixture(scope="module")
def page(found, tmp_path_factory):
    return write_page(tmp_path_factory.mktemp("run"), found, about(found.record.impacts))


def data_of(path):
    """The JSON of a page."""
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', path.read_text(), re.S)[1])


def test_the_numbers_are_those_of_the_diagnosis(found, content, page, tmp_path):
    impacts = found.record.impacts
    assert [str(missing.effect) for missing in found.missing] == [effect["name"] for effect in content["effects"]]
    for shown, rung in zip(content["ladder"], found.ladder, strict=True):
        assert (shown["mean"], shown["low"], shown["high"]) == pytest.approx(tuple(rung.error), rel=1e-4)
    for effect, missing in zip(content["effects"], found.missing, strict=True):
        for shown, known in zip(effect["parameters"], missing.parameters, strict=True):
            assert shown["value"] == pytest.approx(known.value, rel=1e-3)
    whole = mass_error(impacts, found.record.model.predict(impacts)).mean().item()
    assert content["models"][-1]["mean"] == pytest.approx(whole, rel=1e-3)
    alone = mass_error(impacts, found.record.base.predict(impacts)).mean().item()
    assert content["models"][0]["mean"] == pytest.approx(alone, rel=1e-2)
    assert f"{found.ladder[0].error.mean:.4f}" in " ".join(content["verdict"]["sentences"])
    assert [one["level"] for one in content["effects"]] == [str(one.level) for one in found.missing]
    # Rounding for JSON moves no fourth decimal.
    assert f"{finely(0.1811496):.4f}" == "0.1811"
    text = render(content)
    for rung in found.ladder:
        mean, low, high = rung.error
        assert f"{mean:.4f} ({low:.4f}–{high:.4f})" in text
    assert page.read_text().index('id="ladder"') < page.read_text().index("<summary>The numbers</summary>")
    # To the last digit, without the data source and without a fit.
    found.record.save(tmp_path, {"data": {}, "versions": {}, "config": {}})
    again = replace(Diagnosis.from_json(found.to_json()), record=Record.load(tmp_path))
    assert of_diagnosis(again, about(again.record.impacts), use="contactlearn evaluate") == content


def test_a_page_asks_for_nothing(page):
    text = re.sub(r'<script type="(application/json|text/plain)".*?</script>', "", page.read_text(), flags=re.S)
    loads = re.findall(r"(?:src|href|action|data)\s*=\s*[\"']([^\"']*)", text)
    assert all(target.startswith(("#", "data:")) for target in loads)
    assert not re.search(r"@import|url\(|fetch\(|XMLHttpRequest|WebSocket|EventSource|sendBeacon", text)
    assert "default-src 'none'" in text
    assert "unsafe-eval" not in text
    assert not list(page.parent.glob("*.part"))
    text = page.read_text()
    assert "<script>window" not in text
    assert "<img" not in text
    assert "{{ 7*7 }}" in text
    assert data_of(page)["trials"]["name"][0] == HOSTILE
    text = embedded({"name": HOSTILE + "</script><!--"})
    assert not set("<>&\u2028\u2029") & set(text)
    assert json.loads(text)["name"] == HOSTILE + "</script><!--"
    with pytest.raises(ValueError, match="not JSON compliant"):
        embedded({"x": float("nan")})


def test_the_rig_card_stands_below_the_verdict(found, tmp_path):
    tilt = Estimate(value=0.02, error=0.001)
    rows = Apparatus(gravity=Estimate(value=9.81, error=0.01), delay=tilt, slope=tilt).rows()
    card = Finding(name="rig", sentence="measured", evidence=(), rig=rows, mistake=False)
    carded = replace(found, findings=(card, *found.findings))
    assert Diagnosis.from_json(carded.to_json()).findings[0].rig == rows
    html = write_page(tmp_path, carded, about(found.record.impacts)).read_text()
    assert (
        html.index('<section id="verdict"') < html.index('<section id="card">') < html.index('<section id="effects">')
    )
    assert "<b>1.146 ± 0.057°</b>" in html
    assert (
        '<a href="#card">The set-up</a> is not as stated: delay of the states 20.0 ± 1.0 ms, slope of the floor' in html
    )
    # What is measured twice has one row.
    known = {"gravity": tilt, "delay": tilt, "inertia": Estimate(value=0.02, error=0.01)}
    rows = Apparatus(**known, rocking_inertia=Estimate(value=0.01, error=0.02)).rows()
    html = write_page(tmp_path, replace(found, findings=(replace(card, rig=rows),)), about(found.record.impacts))
    (row,) = re.findall(r"<tr><th scope=\"row\">inertia.*?</tr>", html.read_text())
    cells = ["1.020 ± 0.010", "1", "moment balance of impacts", "1.010 ± 0.020", "rocking on edges"]
    assert re.findall("<td>(.*?)</td>", row) == cells


def test_the_first_screen_has_the_size_and_the_certainty_of_each_effect(found, content, shown):
    assert len(content["verdict"]["named"]) == len(found.missing) == 2
    for line, missing in zip(content["verdict"]["named"], found.missing, strict=True):
        value = missing.parameters[0]
        assert re.search(r", \d\d\u00a0% sure: .*\d ± 0\.\d", line), value
    assert shown.execute_script("return document.querySelector('.named').getBoundingClientRect().bottom") < 450
    assert shown.execute_script("return document.querySelector('.switches').offsetHeight") < 50  # one line


def test_evidence_has_standard_errors_and_no_keys(found):
    numbers = {"a_measured": 0.9775, "a_error_measured": 0.0069, "r_squared_measured": 0.979, "error_before": 0.2}
    evidence = tuple(Evidence(quantity=name, value=value) for name, value in numbers.items())
    speed = (
        Evidence(quantity="velocity", value=0.0286, unit="m/s"),
        Evidence(quantity="error", value=0.0025, unit="m/s"),
    )
    rows = Evidence(quantity="rows", value="3, 4")
    finding = Finding(name="consistent", sentence="s", evidence=(*evidence, *speed, rows), mistake=False)
    (entry,) = of_diagnosis(replace(found, findings=(finding,)), about(found.record.impacts))["findings"]
    assert entry["name"] == "No mistake of units or axes"
    assert entry["evidence"] == [
        ("a", "0.9775 ± 0.0069"), ("R²", "0.979"), ("error before", "0.2"), ("velocity", "0.0286 ± 0.0025 m/s"),
        ("rows", "3, 4"),
    ]  # fmt: skip


def test_fatal_data_have_a_page(found, tmp_path):
    evidence = (Evidence(quantity="balance", value=0.3),)
    finding = Finding(name="impossible", sentence="no hypothesis balances the moments", evidence=evidence, fatal=True)
    refused = Diagnosis(verdict=Verdict.BAD_DATA, law=None, variant="textbook", findings=(finding,))
    text = write_page(tmp_path, refused, about(found.record.impacts)).read_text()
    assert "The measurements are inconsistent, and no known correction resolves this." in text
    shown = text.partition("<script")[0]
    assert shown.count("o hypothesis balances the moments") == 1
    assert "mass-weighted" not in text
    assert 'id="library"' not in text


def test_a_large_page_is_small_enough():
    """1718 trials and six effects in play."""
    whole = made_up(1718, *SIX)
    text = render(of_diagnosis(whole, about(whole.record.impacts)))
    assert len(text.encode()) < 6e6
    whole = made_up(60, EffectId("contact_patch", "linear"))
    assert "100\u00a0% is noise" in render(of_diagnosis(whole, about(whole.record.impacts)))
    unsure = Candidate(
        effect=SIX[4], equation="", parameters=(), error_after=0.1, error_reduction=0.004, confidence=0.26
    )
    proxy = replace(unsure, effect=SIX[5], confidence=None, proxy=True)
    text = render(of_diagnosis(replace(whole, candidates=(unsure, proxy)), about(whole.record.impacts)))
    assert '<th scope="row">side drag (linear)</th><td>26\u00a0%</td><td>0.1040 → 0.1000</td>' in text
    assert '<th scope="row">sampling delay</th><td>a proxy?</td>' in text
    assert "A proxy is an effect without which" in text
    assert "Undecided:" not in text
    models = (PlausibleModel(law=law, effects=(), share=0.5) for law in ("wang_mason", "mirtich"))
    text = render(of_diagnosis(replace(whole, models=tuple(models)), about(whole.record.impacts)))
    assert "<p>Undecided: Wang–Mason (50\u00a0%) or Mirtich (50\u00a0%).</p>" in text
    # Nothing is called the law alone that is not.
    whole = made_up(60, *SIX, EffectId("adhesion", "work"))
    content = of_diagnosis(whole, about(whole.record.impacts))
    names = [one["name"] for one in content["models"]]
    assert names[0] == "Wang–Mason + adhesion (work) (always on)"
    assert names[1] == f"{names[0]} + surface tilt (computed)"
    assert (content["base"], content["always"]) == ("Wang–Mason", ["adhesion (work)"])
    text = render(content)
    assert '<th scope="row">Wang–Mason</th>' in text  # in the ladder, where it is the law alone
    assert "<b>Try it with adhesion (work) and</b>" in text


@pytest.fixture(scope="module")
def evaluation(tmp_path_factory, found):
    models = {law: joint.fit(found.record.impacts, find(law), options=FitOptions(starts=2)).model for law in PAPER_LAWS}
    laws = {law: find(law).at(model.base.mu, model.base.eps) for law, model in models.items()}
    predictions = {law: model.predict(found.record.impacts) for law, model in models.items()}
    covered = CurveCalibration(
        processes=("exact",) * 2, converged=(1.0,) * 2, negative_log_density=(-3.0,) * 2, coverage=(0.9,) * 2,
        component_coverage=((0.9,) * 3,) * 2,
    )  # fmt: skip
    curves = {HOSTILE: replace(learning_curve((10, 100), (0.2, 0.1)), calibration=covered)}
    result, held_out = evaluation_of(found.record.impacts, predictions, laws, {HOSTILE: HOSTILE}, curves)
    return write(tmp_path_factory.mktemp("evaluation"), of_evaluation(result, held_out)), result


def test_an_evaluation_has_a_page(evaluation):
    path, result = evaluation
    page = data_of(path)
    assert {one["label"]: one["mean"] for one in page["models"]}["Mirtich"] == pytest.approx(
        result.errors["mirtich"].mass_error.mean, rel=1e-4
    )
    assert "<script>window" not in path.read_text()
    # Learned models stand beside the laws.
    assert [(one["label"], one["trials"], one["mean"]) for one in page["learned"]] == [(HOSTILE, 100, 0.1)]
    assert '<tr class="processes"><th scope="row">&lt;script&gt;window.hacked' in path.read_text()


def test_the_page_of_the_euclidean_norm_is_in_its_error(found):
    """Headline, table, trials and figures; the bound has no error of the mass norm."""
    impacts = found.record.impacts
    laws = {"mirtich": find("mirtich").at(0.1, 0.5)}
    bound, near = irb(impacts, "euclidean"), ContactModel(laws["mirtich"]).predict(impacts)
    content = of_evaluation(*evaluation_of(impacts, {"mirtich": near, "irb": bound}, laws, {}, norm="euclidean"))
    assert "Euclidean" in content["_measure"]
    assert [one["key"] for one in content["comparison"]][:2] == ["euclidean_error", "mass_error"]
    law, rigid = content["models"]
    assert (law["mean"], rigid["mean"]) == pytest.approx(
        [euclidean_error(impacts, one).mean().item() for one in (near, bound)], rel=1e-6
    )
    assert rigid["errors"]["mass_error"] is None
    assert content["figures"]["distributions"]["layout"]["xaxis"]["title"]["text"] == METRICS["euclidean_error"].axis
    assert "–</td>" in render(content)
    parts = of_outcomes(impacts, near.v_post[None], "euclidean")
    torch.testing.assert_close(parts["error"][0], euclidean_error(impacts, near))
    squares = (near.v_post - impacts.v_post).square()
    torch.testing.assert_close(parts["parts"][0], squares / squares.sum(-1, keepdim=True))


def test_models_that_cannot_be_told_apart(found):
    """The headline names them; bounds come last, the others by their error."""
    impacts = found.record.impacts
    noise = torch.randn((len(impacts), 3), generator=seeded(), dtype=torch.float64)
    other = torch.randn((len(impacts), 3), generator=seeded().manual_seed(1), dtype=torch.float64)
    scale = 0.1 * impacts.v_post.norm(dim=-1, keepdim=True)
    outcomes = {"irb": 0 * noise, "whittaker": 5 * noise, "mirtich": noise, "mirtich + side_drag": other}
    predictions = {name: Prediction(impacts.v_post + scale * x, impacts.wrench) for name, x in outcomes.items()}
    laws = {name: find(name).at(0.1, 0.5) for name in ("whittaker", "mirtich")}

    def of(names):
        chosen = {name: predictions[name] for name in names}
        known = {name: law for name, law in laws.items() if name in names}
        return of_evaluation(*evaluation_of(impacts, chosen, known, {}))

    content = of(predictions)
    labels = [one["label"] for one in content["models"]]
    assert sorted(labels[:2]) == ["Mirtich", "Mirtich + side drag"]
    assert labels[2:] == ["Whittaker", "IRB bound"]
    assert '<tr class="bound"><th scope="row">IRB bound</th>' in render(content)
    assert 'scale beyond"' not in render(content)
    longest = [
        one | {"mean": 9 * content["models"][0]["mean"]} if one["label"] == "Whittaker" else one
        for one in content["models"]
    ]
    bars = render(content | {"models": longest})
    assert re.findall(r'scale beyond"><i style="width:(.*?)%', bars) == ["100"]  # it fades at the end of the axis
    headline = f"{labels[0]} has the lowest error of 3 models, but these data cannot distinguish it from {labels[1]}."
    assert content["verdict"]["headline"] == headline
    assert "The next that these data can distinguish from it, Whittaker, has" in " ".join(
        content["verdict"]["sentences"]
    )
    assert of(["whittaker", "mirtich"])["verdict"]["headline"] == "Mirtich has the lowest error of 2 models."


@pytest.fixture
def shown(browser, page):
    return opened(browser, page)


def opened(browser, path):
    """The browser with a page whose scripts have run."""
    browser.get_log("browser"), browser.get_log("performance")
    browser.get(path.as_uri())
    until(browser, "document.documentElement.dataset.ready")
    return browser


def until(browser, condition):
    from selenium.webdriver.support.ui import WebDriverWait

    return WebDriverWait(browser, 20, 0.05).until(lambda b: b.execute_script(f"return {condition}"))


def into_view(browser, id):
    """A figure that has been drawn, since it is near."""
    browser.execute_script(f"document.getElementById('{id}').scrollIntoView()")
    until(browser, f"document.querySelector('#{id} .main-svg') !== null")


def silent(browser):
    """That the page asked for nothing but itself, that nothing was refused, and that no hostile name has run."""
    events = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    asked = [event["params"]["request"]["url"] for event in events if event["method"] == "Network.requestWillBeSent"]
    asked = [url for url in asked if not url.startswith(("data:", "blob:"))]
    return (
        asked == [browser.current_url]
        and not browser.get_log("browser")
        and not browser.execute_script("return window.hacked")
    )


def draw_everything(browser):
    for figure in browser.execute_script("return [...document.querySelectorAll('.plot')].map(one => one.id)"):
        into_view(browser, figure)


def test_everything_is_drawn_in_silence(browser, page):
    shown = opened(browser, page)
    draw_everything(shown)
    assert nothing_sticks_out(shown)
    shown.execute_script("dispatchEvent(new Event('beforeprint')); dispatchEvent(new Event('afterprint'))")
    assert shown.execute_script("return document.querySelector('#map').textContent.includes('undefined')") is False
    assert silent(shown)


def test_an_evaluation_is_drawn_in_silence(browser, evaluation):
    shown = opened(browser, evaluation[0])
    draw_everything(shown)
    assert silent(shown)


def test_rows_of_panels_have_room_for_their_titles(shown):
    """As many rows as deviations of the contact, of which a body in space has four."""
    two = "{xaxis: {}, yaxis: {domain: [0.6, 1]}, xaxis2: {}, yaxis2: {domain: [0, 0.4]}}"
    height = shown.execute_script(f"show('map', {{data: [], layout: {two}}}); return get('map').clientHeight")
    assert height >= 2 * 14 * 16


def test_a_trial_has_a_row_beside_its_name_only_where_they_differ(content):
    assert "<label>Row" in render(content)
    numbered = [str(row) for row in range(1, content["trials"]["count"] + 1)]
    assert "<label hidden>Row" in render(content | {"trials": content["trials"] | {"name": numbered}})


def test_the_map_begins_with_variables_that_vary(browser, content, tmp_path):
    """θ of a ball is 0 in every trial."""
    variables = [
        one | {"values": [0.0] * len(one["values"])} if one["name"] == "theta" else one
        for one in content["trials"]["variables"]
    ]
    path = tmp_path / "report.html"
    path.write_text(render(content | {"regions": [], "trials": content["trials"] | {"variables": variables}}))
    across, up = opened(browser, path).execute_script(
        "return ['map-x', 'map-y'].map(id => document.getElementById(id).selectedOptions[0].label)"
    )
    (theta,) = (one["label"] for one in variables if one["name"] == "theta")
    assert len({across, up, theta}) == 3


def test_every_part_of_the_error_has_the_colour_of_its_legend(shown, found):
    kinds = [*ErrorShares(noise=0.5, explained=0.2, unnamed=0.1, unexplained=0.2, beyond_rigid=None, scatter=0.1).parts]
    colours = shown.execute_script(
        """const kinds = arguments[0], [shares, note] = document.querySelectorAll("#budget .shares, #budget .note");
        shares.innerHTML = kinds.map(kind => `<i class="${kind}"></i>`).join("");
        note.innerHTML = kinds.map(kind => `<i class="key ${kind}"></i>`).join("");
        return [shares, note].map(part => [...part.children].map(one => {
            const style = getComputedStyle(one);
            return style.backgroundImage + style.backgroundColor; }))""",
        kinds,
    )
    assert colours[0] == colours[1]
    assert len({*colours[0]}) == len(kinds)


def test_ticking_an_effect_moves_numbers_map_and_curves(shown, content):
    into_view(shown, "map")
    title = "document.querySelector('#map').data[0].marker.colorbar.title.text"
    assert shown.execute_script(f"return {title}") == "Mass error of the ticked model"  # all boxes are ticked
    colors = "document.querySelector('#map').data[0].marker.color.slice(0, 5).join()"
    error, before = (
        shown.execute_script(f"return {what}") for what in ("document.querySelector('.ticked').textContent", colors)
    )
    assert f"{content['models'][-1]['mean']:.4f}" in error
    shown.execute_script("document.querySelector('[data-bit]').click()")
    without = content["models"][-2]
    assert f": {without['mean']:.4f}" in shown.execute_script("return document.querySelector('.ticked').textContent")
    until(shown, f"{colors} !== '{before}'")
    into_view(shown, "curve-0")
    assert until(shown, "document.querySelector('#curve-0').data[2].line.dash === 'dot'")


def test_the_errors_and_outcomes_of_the_trials_are_those_of_the_model(shown, found):
    impacts, chosen = found.record.impacts, found.record.model.predict(found.record.impacts)

    def held(array):
        values = shown.execute_script(
            f"return trials.name.map((_, i) => [0, 1, 2].map(k => arrays.{array}(page.chosen, i, k)))"
        )
        return torch.tensor(values, dtype=torch.float64)

    error = torch.tensor(shown.execute_script("return errorsOf(page.chosen)"), dtype=torch.float64)
    torch.testing.assert_close(error, mass_error(impacts, chosen), rtol=0, atol=QUANTISED * 5)
    torch.testing.assert_close(held("v_post"), chosen.v_post, rtol=0, atol=QUANTISED * chosen.v_post.abs().max().item())
    largest = chosen.wrench.abs().amax(0)
    torch.testing.assert_close(held("wrench") / (1e3 * largest), chosen.wrench / largest, rtol=0, atol=5 * QUANTISED)
    parts = torch.stack((impacts.mass, impacts.mass, impacts.inertia), -1) * (chosen.v_post - impacts.v_post) ** 2
    torch.testing.assert_close(held("parts"), parts / parts.sum(-1, keepdim=True), rtol=0, atol=0.02)


def test_mechanics_of_a_trial(shown, found):
    """The energy ellipse, the impulses and the reach that are drawn are those of Python."""
    impacts = found.record.impacts
    into_view(shown, "impulse")
    shown.execute_script("select(3)")
    trace = "get('impulse').data.find(one => one.meta === '{}')"
    until(shown, f"{trace.format('Measured')}.y[0].toFixed(1) === '{1e3 * impacts.wrench[3, 1]:.1f}'")

    def drawn(name):
        return (
            1e-3
            * torch.tensor(shown.execute_script(f"const one = {trace.format(name)}; return [one.x, one.y]")).mT.double()
        )

    W, v_c = impacts.W[3], impacts.v_c[3]
    size = energy_ellipse(W, v_c).abs().max()
    energy = -(v_c * torch.linalg.solve(W, -v_c)).sum() / 2
    assert energy_excess(W, v_c, drawn("ellipse")).abs().max() < 1e-2 * energy.abs()
    extent = energy_ellipse(W, v_c).aminmax(dim=0)
    for end, known in zip(drawn("ellipse").aminmax(dim=0), extent, strict=True):
        torch.testing.assert_close(end, known, rtol=0, atol=2e-3 * size.item())
    assert admissible(W, v_c, drawn("admissible"), tolerance=1e-2).all()
    compressed = v_c[1] + drawn("Maximum compression") @ W[1]
    assert compressed.abs().max() < 1e-2 * v_c.norm()
    sticking = v_c[0] + drawn("Sticking") @ W[0]
    assert sticking.abs().max() < 1e-2 * v_c.norm()
    torch.testing.assert_close(drawn("Measured")[0], impacts.wrench[3, :2], rtol=0, atol=1e-3 * size.item())
    momentum = 1e-3 * shown.execute_script("return Math.hypot(arrays.ellipse(3, 0, 0), arrays.ellipse(3, 0, 1))")
    for k, law in enumerate(PAPER_LAWS):
        most = find(law).at(1.0, 1.0).impulse(W, v_c)  # the last node of the reach
        node = shown.execute_script(f"return [0, 1].map(j => arrays.reach({k}, 3, 8, 4, j))")
        assert [momentum * x for x in node] == pytest.approx(most.tolist(), abs=2e-3 * momentum)
