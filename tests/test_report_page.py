"""report.html: what it says, that it asks for nothing, and that it lives in a browser."""

import json
import re
import shutil
from dataclasses import asdict, replace

import pytest
import torch
from evaluations import evaluation_of, learning_curve

from contactlearn.audit.result import Evidence, Finding
from contactlearn.data import mystery, synthetic
from contactlearn.diagnosis.discrimination.equivalents import Equivalent
from contactlearn.diagnosis.pipeline import Diagnosis, diagnose
from contactlearn.diagnosis.search.candidates import all_candidates
from contactlearn.diagnosis.search.ladder import Missing
from contactlearn.diagnosis.search.subsets import Subsets, subsets
from contactlearn.diagnosis.unexplained.formulas import Formula
from contactlearn.diagnosis.unexplained.remainder import Remainder
from contactlearn.effects import EffectId
from contactlearn.evaluation.metrics import Interval, mass_error
from contactlearn.identification.joint import FitOptions, identify_jointly
from contactlearn.impacts import Prediction
from contactlearn.laws import PAPER_LAWS, find
from contactlearn.mechanics import energy_ellipse
from contactlearn.model import ContactModel
from contactlearn.report.page import diagnosis as content_module
from contactlearn.report.page.diagnosis import of_diagnosis
from contactlearn.report.page.evaluation import of_evaluation
from contactlearn.report.page.page import embedded, render, write
from contactlearn.report.page.trials import finely
from contactlearn.report.text import headline, label, measured, model_label, sentence, sentences

HOSTILE = '<script>window.hacked=1</script><img src=x onerror="window.hacked=1">\'{{ 7*7 }}&<b>\u2028'
COMMAND = "python diagnose.py data=mystery"
QUANTISED = 2e-4  # of the largest velocity two bytes resolve 3e-5


def seeded():
    return torch.Generator().manual_seed(0)


def provenance(impacts):
    data = {"source": impacts.source, "trials": len(impacts), "sha256": impacts.fingerprint()}
    return {"data": data, "versions": {"contactlearn": "0"}, "config": {HOSTILE: HOSTILE}}


@pytest.fixture(scope="module")
def found():
    """A tilt and a damped spin in 120 trials with names that try to be markup."""
    impacts, _ = mystery.draw(11, effects=["surface_tilt", "spin_damping"], size=120)
    names = (HOSTILE, *impacts.trial[1:])
    impacts = impacts.replace(trial=names, object=(HOSTILE,) * len(impacts), source=HOSTILE)
    kinds = ("surface_tilt", "spin_damping", "side_drag")
    candidates = {key: effect for key, effect in all_candidates().items() if key.name in kinds}
    return diagnose(impacts, find("wang_mason"), candidates=candidates)


@pytest.fixture(scope="module")
def content(found):
    return of_diagnosis(found, COMMAND, provenance(found.impacts), use="python evaluate.py")


@pytest.fixture(scope="module")
def page(found, tmp_path_factory):
    return write(tmp_path_factory.mktemp("run"), of_diagnosis(found, COMMAND, provenance(found.impacts)))


def data_of(path):
    """The JSON of a page."""
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', path.read_text(), re.S)[1])


def test_the_numbers_are_those_of_the_diagnosis(found, content):
    assert [missing.id.name for missing in found.missing] == [effect["name"] for effect in content["effects"]]
    for rung, (_, interval) in zip(content["ladder"], found.ladder, strict=True):
        assert (rung["mean"], rung["low"], rung["high"]) == pytest.approx(interval, rel=1e-4)
    for effect, missing in zip(content["effects"], found.missing, strict=True):
        assert effect["takes_off"] == pytest.approx(missing.takes_off, rel=1e-4)
        for said, known in zip(effect["parameters"], missing.parameters.values(), strict=True):
            assert said["value"] == pytest.approx(known["value"], rel=1e-3)
    whole = mass_error(found.impacts, found.model.predict(found.impacts)).mean().item()
    assert content["models"][-1]["mean"] == pytest.approx(whole, rel=1e-3)
    alone = mass_error(found.impacts, found.base.predict(found.impacts)).mean().item()
    assert content["models"][0]["mean"] == pytest.approx(alone, rel=1e-2)
    assert f"{found.ladder[0][1].mean:.4f}" in " ".join(content["verdict"]["sentences"])


def test_every_subset_is_a_joint_fit(found):
    names = [missing.id.name for missing in found.missing]
    chosen = subsets(found.impacts, found.model, names, generator=seeded())
    assert chosen.v_post.shape == (2 ** len(names), len(found.impacts), 3)
    for k in range(2 ** len(names)):
        effects = {name: found.model.effects[name] for j, name in enumerate(names) if k >> j & 1}
        fit = identify_jointly(find(found.law), effects, found.impacts)
        assert chosen.errors[k].mean == pytest.approx(
            mass_error(found.impacts, fit.model.predict(found.impacts)).mean().item(), rel=0.01
        )


def test_a_page_asks_for_nothing(page):
    text = re.sub(r'<script type="(application/json|text/plain)".*?</script>', "", page.read_text(), flags=re.S)
    loads = re.findall(r"(?:src|href|action|data)\s*=\s*[\"']([^\"']*)", text)
    assert all(target.startswith(("#", "data:")) for target in loads)
    assert not re.search(r"@import|url\(|fetch\(|XMLHttpRequest|WebSocket|EventSource|sendBeacon", text)
    assert "default-src 'none'" in text
    assert "unsafe-eval" not in text
    assert not list(page.parent.glob("*.part"))


def test_json_cannot_leave_its_script():
    text = embedded({"name": HOSTILE + "</script><!--"})
    assert not set("<>&\u2028\u2029") & set(text)
    assert json.loads(text)["name"] == HOSTILE + "</script><!--"
    with pytest.raises(ValueError, match="not JSON compliant"):
        embedded({"x": float("nan")})


def test_names_are_escaped(page):
    text = page.read_text()
    assert "<script>window" not in text
    assert "<img" not in text
    assert "{{ 7*7 }}" in text
    assert data_of(page)["trials"]["name"][0] == HOSTILE


def test_fatal_data_have_a_page(found, tmp_path):
    refused = Diagnosis(
        "bad_data",
        "best",
        {},
        (
            Finding(
                name="impossible",
                sentence="no hypothesis balances the moments",
                evidence=(Evidence(quantity="balance", value=0.3),),
                fatal=True,
            ),
        ),
    )
    text = write(tmp_path, of_diagnosis(refused, COMMAND, provenance(found.impacts))).read_text()
    assert "no correction that is known mends them" in text
    shown = text.partition("<script")[0]
    assert shown.count("o hypothesis balances the moments") == 1
    assert "mass-weighted" not in text
    assert 'id="library"' not in text


def made_up(monkeypatch, size, names):
    """A diagnosis with these effects, of which as many as may be are in play, and predictions nothing compresses."""
    impacts = synthetic.load(size=size, seed=0)
    ids = [EffectId.parse(name) for name in names]
    effects = {key.name: all_candidates()[key].prepare(impacts) for key in ids}
    model = ContactModel(find("wang_mason").at(0.12, 0.55), effects=effects)
    noise = torch.randn((64, len(impacts), 3), generator=seeded(), dtype=torch.float64)
    interval = Interval(0.1, 0.09, 0.11)
    made = Subsets(tuple(effects)[:6], impacts.v_post + noise, (interval,) * 64)
    monkeypatch.setattr(content_module, "subsets", lambda *_, **__: made)
    missing = tuple(Missing(key, effects[key.name], interval, interval, 0.01, 1.0, {}, (0.0, 0.0)) for key in ids)
    steps = tuple((name, interval) for name in ("wang_mason", *names))
    budget = {"base": asdict(interval)}
    parts = {"impacts": impacts, "base": replace(model, effects={}), "model": model}
    return Diagnosis("effects", "wang_mason", {}, (), missing, steps, budget, **parts)


SIX = ("surface_tilt", "spin_damping:after", "contact_patch", "inertia_error", "side_drag", "sampling_delay")


def test_a_large_page_is_small_enough(monkeypatch):
    """1718 trials and six effects in play."""
    whole = made_up(monkeypatch, 1718, SIX)
    text = render(of_diagnosis(whole, COMMAND, provenance(whole.impacts)))
    assert len(text.encode()) < 6e6


def test_effects_beyond_those_that_can_be_ticked_are_named(monkeypatch):
    """Nothing is called the law alone that is not."""
    whole = made_up(monkeypatch, 60, (*SIX, "adhesion:work"))
    content = of_diagnosis(whole, COMMAND, provenance(whole.impacts))
    names = [one["name"] for one in content["models"]]
    assert names[0] == "Wang–Mason + adhesion (work) (always on)"
    assert names[1] == f"{names[0]} + surface tilt"
    assert (content["base"], content["always"]) == ("Wang–Mason", ["adhesion (work)"])
    text = render(content)
    assert text.count('<th scope="row">Wang–Mason</th>') >= 2  # ladder and budget, where it is the law alone
    assert f'<th scope="row">{names[0]}</th>' in text


def test_numbers_are_written_as_in_the_ladder(found, content):
    """Rounding for JSON moves no fourth decimal."""
    assert f"{finely(0.1811496):.4f}" == "0.1811"
    text = render(content)
    for _, (mean, low, high) in found.ladder:
        assert f"{mean:.4f} ({low:.4f}–{high:.4f})" in text


def rest(share, components=("tau",)):
    return Remainder(None, None, None, share, components, {"omega": 0.61, "theta": 0.2}, ())


def test_the_headline_doubts_what_the_page_doubts(found):
    first = found.missing[0].id
    others = map(EffectId.parse, ("com_offset", "shape_error", "adhesion:work"))
    rivals = [Equivalent(other, 0.9, 0.0, 0.1, None) for other in others]
    plain = replace(found, equivalents={}, remainder=None, physics="effects")
    assert headline(plain).endswith("missing from Wang–Mason.")
    said = headline(replace(plain, equivalents={first.name: rivals[:1]}))
    assert said.endswith(f"missing from Wang–Mason; {label(first)} could also be com offset.")
    assert "com offset, shape error or another effect" in headline(replace(plain, equivalents={first.name: rivals}))
    more = rest(Interval(0.05, 0.02, 0.08))
    assert "; more is missing that no known effect explains." in headline(replace(plain, remainder=more))


def test_the_verdict_says_what_remains(found):
    """Components, variables and the best formula, as the terminal does."""
    before = torch.full((50,), 0.2, dtype=torch.float64)
    best = Formula("tau", ("omega",), ((-1.0, 1.0),), (0.1,), before, 0.75 * before)
    left = rest(Interval(0.4, 0.3, 0.5), ("tau", "t"))
    said = sentences(replace(found, physics="unknown", remainder=left, formulas=(best,)))
    text = " ".join(said).replace("\u00a0", " ")
    assert "take 40 % (30 % to 50 %) off what remains, in τ and P_t." in text
    assert "What remains depends on ω (61 %) and θ (20 %)." in text
    assert "The best formula for it is τ ← τ + c1*omega, which takes 25 % ± 0 % off the held-out error." in text


def test_the_verdict_says_how_large_the_effects_are(found):
    said = " ".join(sentences(found))
    for missing in found.missing:
        first = next(iter(missing.parameters.values()))
        assert f"{first['symbol']} = {measured(first['value'], first['standard_error'], first['unit'])}." in said


def test_words():
    assert measured(0.10512, 0.00412, "m") == "0.1051 ± 0.0041 m"
    assert measured(-3.2e-7, 4e-8) == "−3.2e−7 ± 4e−8"
    assert label("velocity_dependent_restitution:kuwabara_kono") == "velocity-dependent restitution (Kuwabara–Kono)"
    assert model_label("wang_mason + side_drag") == "Wang–Mason + side drag"
    assert sentence("x points left") == "x points left."
    assert sentence("no balance. Is it?") == "No balance. Is it?"


def test_noise_is_no_more_than_all(content):
    shares = {"noise": 1.7, "explained": 0.0, "left": 0.0, "beyond_rigid": 0.0}
    assert "100\u00a0% is noise" in render(content | {"shares": shares})


@pytest.fixture(scope="module")
def evaluation(tmp_path_factory, found):
    models = {
        law: identify_jointly(find(law), {}, found.impacts, options=FitOptions(starts=2)).model for law in PAPER_LAWS
    }
    laws = {law: find(law).at(model.base.mu, model.base.eps) for law, model in models.items()}
    predictions = {law: model.predict(found.impacts) for law, model in models.items()}
    curves = {HOSTILE: learning_curve((10, 100), (0.2, 0.1))}
    result, held_out = evaluation_of(found.impacts, predictions, laws, {HOSTILE: HOSTILE}, curves)
    return write(tmp_path_factory.mktemp("evaluation"), of_evaluation(result, held_out)), result


def test_an_evaluation_has_a_page(evaluation):
    path, result = evaluation
    said = data_of(path)
    assert {one["label"]: one["mean"] for one in said["models"]}["Mirtich"] == pytest.approx(
        result.errors["mirtich"].headline.mean, rel=1e-4
    )
    assert "<script>window" not in path.read_text()


def test_models_that_cannot_be_told_apart(found):
    """The headline names them; bounds come last, the others by their error."""
    impacts = found.impacts
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
    said = f"{labels[0]} leaves the least error of 3 models, but {labels[1]} cannot be told from it."
    assert content["verdict"]["headline"] == said
    assert "The nearest that can be told from it, Whittaker, leaves" in " ".join(content["verdict"]["sentences"])
    assert of(["whittaker", "mirtich"])["verdict"]["headline"] == "Mirtich leaves the least error of 2 models."


# In a browser.


@pytest.fixture(scope="module", params=[1280, 360], ids=lambda width: f"{width}px")
def browser(request):
    """Headless Chromium of a width, with its console and its network logged."""
    chromium, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if not chromium or not driver:
        pytest.skip("no chromium and chromedriver on this machine: apt-get install chromium chromium-driver")
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    for argument in (
        "headless", "no-sandbox", "disable-gpu", "disable-quic", "no-first-run", "disable-background-networking",
        "disable-component-update", "disable-sync", "disable-dev-shm-usage",
    ):  # fmt: skip
        options.add_argument(f"--{argument}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    opened = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    size = {"width": request.param, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    opened.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    yield opened
    opened.quit()


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


def test_everything_is_drawn_in_silence(shown):
    draw_everything(shown)
    width = shown.execute_script("return [document.documentElement.scrollWidth, document.documentElement.clientWidth]")
    assert width[0] <= width[1]
    shown.execute_script("dispatchEvent(new Event('beforeprint')); dispatchEvent(new Event('afterprint'))")
    assert shown.execute_script("return document.querySelector('#map').textContent.includes('undefined')") is False
    assert silent(shown)


def test_a_figure_fits_its_place_when_that_changes(shown):
    into_view(shown, "map")
    width = shown.execute_script("return document.documentElement.clientWidth")
    for narrower in (0.8, 1):
        shown.execute_script(f"document.body.style.width = '{narrower * width}px'")
        until(
            shown, "document.querySelector('#map .main-svg').clientWidth === document.querySelector('#map').clientWidth"
        )


def test_an_evaluation_is_drawn_in_silence(browser, evaluation):
    shown = opened(browser, evaluation[0])
    draw_everything(shown)
    assert silent(shown)


def test_ticking_an_effect_moves_numbers_map_and_curves(shown, content):
    into_view(shown, "map")
    colors = "document.querySelector('#map').data[0].marker.color.slice(0, 5).join()"
    said, before = (
        shown.execute_script(f"return {what}") for what in ("document.querySelector('.ticked').textContent", colors)
    )
    assert f"{content['models'][-1]['mean']:.4f}" in said
    shown.execute_script("document.querySelector('#map-0').click()")
    without = content["models"][-2]
    assert f"Error {without['mean']:.4f}" in shown.execute_script(
        "return document.querySelector('.ticked').textContent"
    )
    assert (
        shown.execute_script("return [...document.querySelectorAll('[data-bit=\"0\"]')].map(one => one.checked)")
        == [False] * 3
    )
    until(shown, f"{colors} !== '{before}'")
    into_view(shown, "curve-0")
    assert until(shown, "document.querySelector('#curve-0').data[2].line.dash === 'dot'")


def test_the_errors_of_the_trials_are_those_of_the_model(shown, found):
    error = torch.tensor(shown.execute_script("return massErrors(page.chosen)"), dtype=torch.float64)
    torch.testing.assert_close(
        error, mass_error(found.impacts, found.model.predict(found.impacts)), rtol=0, atol=QUANTISED * 5
    )


def test_mechanics_of_a_trial(shown, found):
    """The energy ellipse and the measured wrench that are drawn are those of Python."""
    drawn = torch.tensor(shown.execute_script("return energyEllipse(contact(3))"), dtype=torch.float64)
    torch.testing.assert_close(drawn, energy_ellipse(found.impacts.W[3], found.impacts.v_c[3]), rtol=1e-4, atol=1e-6)
    measured = shown.execute_script("return wrench(3, minus(measured(3), before(3)))")
    assert measured == pytest.approx(found.impacts.wrench[3].tolist(), rel=1e-3, abs=1e-7)
    momentum = shown.execute_script("return Math.hypot(...contact(3).centre)")
    for k, law in enumerate(PAPER_LAWS):
        most = find(law).at(1.0, 1.0).impulse(found.impacts.W[3], found.impacts.v_c[3])  # the last node of the reach
        node = shown.execute_script(f"return [0, 1].map(j => arrays.reach({k}, 3, 8, 4, j))")
        assert [momentum * x for x in node] == pytest.approx(most.tolist(), abs=2e-3 * momentum)


def test_selecting_a_trial_draws_it(shown, found):
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys

    into_view(shown, "picture")
    number = shown.find_element(By.ID, "number")
    number.clear()
    number.send_keys("3", Keys.ENTER)
    until(shown, f"document.getElementById('trial-name').textContent.includes('Trial {found.impacts.trial[2]} ')")
    assert f"{found.impacts.v_post[2, 0].item():.4g}".replace("-", "−") in shown.find_element(By.ID, "numbers").text
    assert found.impacts.trial[2] in shown.find_element(By.ID, "picture").get_attribute("aria-label")
    into_view(shown, "map")
    ring = "document.querySelector('#map').data[1].x[0] === document.querySelector('#map').data[0].x[2]"
    assert until(shown, ring)
    shown.execute_script(
        "document.querySelector('#map').emit('plotly_click', {points: [{curveNumber: 0, pointIndex: 0}]})"
    )
    assert number.get_attribute("value") == "1"
    assert HOSTILE.split("&")[0] in shown.execute_script("return document.getElementById('trial-name').textContent")
    draw_everything(shown)
    assert silent(shown)
