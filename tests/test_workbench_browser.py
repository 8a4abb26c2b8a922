"""The workbench in a browser: the whole loop on hidden physics, two tabs, links, hints, random clicks."""

import json
import sys
import threading
from urllib.parse import urlsplit

import pytest
from browser import of_width
from repetitions import repeated
from run_without_figures import __file__ as COMMAND

pytest.importorskip("dash", reason="the workbench needs Dash: pip install 'contactlearn[workbench]'")

from contactlearn.results.folder import find_results, read_result
from contactlearn.simulation import hidden_effects
from contactlearn.workbench.models import Models
from contactlearn.workbench.server import listen

SIZE = 200
MYSTERY = f"&data=mystery&data.seed=7&data.size={SIZE}"
_CLICKS = """
const [count, done] = arguments, skipped = /Save run|Search|Experiment|Saved runs|Compare them|Load|Learn/;
let random = 1;
const one = list => list[(random = random * 48271 % 2147483647) % list.length];
(async () => {
  for (let k = 0; k < count; k++) {
    const found = [...document.querySelectorAll("button:not([disabled]), [type=checkbox], [type=radio], select")];
    const place = one(found.filter(x => !skipped.test(x.textContent) && !x.closest(".modebar") && x.offsetParent));
    if (place.tagName === "SELECT") {
      place.value = one([...place.options]).value;
      place.dispatchEvent(new Event("change", {bubbles: true}));
    } else place.click();
    await new Promise(wait => setTimeout(wait, 20));
  }
  done(count);
})();
"""


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    """The address of a workbench that runs in a folder of its own, and whose diagnoses search and draw little."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("workbench"))
        patch.setattr("contactlearn.workbench.background._DIAGNOSE", (sys.executable, COMMAND, "diagnose"))
        server, address = listen("127.0.0.1", 0, Models())
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield address.url
        server.shutdown()
        thread.join()
        server.server_close()


def until(browser, condition, seconds=60):
    from selenium.webdriver.support.ui import WebDriverWait

    return WebDriverWait(browser, seconds, 0.05).until(lambda b: b.execute_script(f"return {condition}"))


def opened(browser, address):
    """The browser with a workbench that is drawn; one that a test has left at the address stays."""
    before, _, session = address.partition("token=")
    left = browser.current_url == before + session.partition("&")[2]  # the token is no part of it any more
    if not left:
        browser.get("about:blank")
    browser.get_log("browser"), browser.get_log("performance")
    if not left:
        browser.get(address)
    until(browser, "document.documentElement.dataset.shown")
    until(browser, "document.querySelectorAll('#ladder tr').length > 1")
    return browser


def text(browser, id):
    return browser.execute_script(f"return document.getElementById('{id}').textContent")


def click(browser, place, words):
    """Click on the button, or tick the row, of a pane that begins with some words."""
    among = f"[...document.querySelectorAll('#{place} button, #{place} label')]"
    found = f"{among}.filter(x => x.textContent.startsWith('{words}'))[0]"
    until(browser, f"Boolean({found})")
    browser.execute_script(f"const x = {found}; (x.querySelector('input') ?? x).click()")


def messages(browser):
    """Messages of the console, and requests to other servers."""
    own = urlsplit(browser.current_url).netloc
    events = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    urls = [event["params"]["request"]["url"] for event in events if event["method"] == "Network.requestWillBeSent"]
    foreign = [url for url in urls if not url.startswith(("data:", "blob:", "about:")) and urlsplit(url).netloc != own]
    return [entry["message"] for entry in browser.get_log("browser")] + foreign


def held_out(browser):
    return float(text(browser, "summary").split()[2])


def in_width(browser):
    """Whether nothing is wider than the window."""
    return browser.execute_script("return document.documentElement.scrollWidth <= document.documentElement.clientWidth")


@pytest.mark.nightly  # each of its steps is a test of test_workbench, and so is a diagnosis in the background
def test_the_whole_loop_on_hidden_physics(browser, served, tmp_path):
    """Upload, compare, see where it fails, add what is missing, undo, redo, save."""
    hidden_effects.load(7, size=SIZE, folder=str(tmp_path))
    opened(browser, served)
    browser.execute_script("document.querySelector('header details').open = true")
    browser.find_element("css selector", "#upload input[type=file]").send_keys(str(tmp_path / "drops.csv"))
    until(browser, "document.getElementById('source').textContent.includes('uploads/')")
    until(browser, "document.querySelectorAll('#compare .scale').length > 5")
    click(browser, "compare", "Mirtich")
    until(browser, "document.getElementById('parts').textContent.startsWith('Mirtich')")
    alone = held_out(browser)
    click(browser, "fails", "Worst")
    until(browser, "document.getElementById('trial-status').textContent.startsWith('Trial')")
    browser.execute_script("document.getElementById('impulse').scrollIntoView()")
    until(browser, "document.querySelector('#impulse .main-svg') !== null")
    until(browser, "document.querySelector('#missing label .value')?.textContent?.includes('(−')")
    first = browser.execute_script("return document.querySelector('#missing label .name').textContent")
    click(browser, "missing", first)
    until(browser, "location.search.includes('effect=')")
    until(browser, f"parseFloat(document.getElementById('summary').textContent.split(' ')[2]) < {0.8 * alone}")
    ticked = held_out(browser)
    until(browser, "document.querySelectorAll('#ladder tr').length === 3")
    browser.execute_script("document.getElementById('curve-0').scrollIntoView()")
    until(browser, "document.querySelector('#curve-0 .main-svg') !== null")
    click(browser, "bar", "Undo")
    until(browser, f"parseFloat(document.getElementById('summary').textContent.split(' ')[2]) === {alone}")
    click(browser, "bar", "Redo")
    until(browser, f"parseFloat(document.getElementById('summary').textContent.split(' ')[2]) === {ticked}")
    click(browser, "keep", "Save run")
    until(browser, "document.getElementById('diagnosis-status').textContent.startsWith('Running')")
    until(browser, "document.getElementById('diagnosis-status').textContent.startsWith('Written')", 240)
    (path,) = (path for path in find_results("outputs") if path.parent.name in text(browser, "diagnosis-status"))
    assert [one.name for one in read_result(path).diagnosis.given] == _ticked(browser)
    assert (path.parent / "report.html").exists()
    assert in_width(browser)
    assert not messages(browser)


def _ticked(browser):
    effects = browser.execute_script("return new URLSearchParams(location.search).getAll('effect')")
    return [one.partition(":")[0] for one in effects]


def test_a_link_shows_the_same_and_a_wrong_one_says_why(browser, served):
    link = f"{served}{MYSTERY}&law=mirtich&effect=sampling_delay&manual.mu=0.3&trial=4"
    summary = text(opened(browser, link), "summary")
    assert "set by hand" in summary
    browser.get("about:blank")
    assert text(opened(browser, link), "summary") == summary
    assert browser.execute_script("return state.trial") == 4
    browser.get(f"{served}{MYSTERY}&law=mirtisch")
    until(browser, "document.getElementById('trouble')?.textContent.includes(\"did you mean 'mirtich'\")")


def test_a_slider_moves_the_curves_and_the_fitted_value_is_a_click_away(browser, served):
    from selenium.webdriver.common.keys import Keys

    opened(browser, f"{served}{MYSTERY}&effect=sampling_delay")
    fitted = text(browser, "summary")
    thumb = browser.find_element("css selector", ".parameter [role=slider]")
    assert thumb.get_attribute("aria-label").startswith("μ = ")
    browser.execute_script("document.getElementById('curve-0').scrollIntoView()")
    until(browser, "document.getElementById('curve-0').data")
    residual = browser.execute_script("return get('curve-0').data[4].y")
    # As a pointer drags, before it lets go; again and again, for a page that has just come may be drawn once more.
    until(browser, "(preview({of: 'mu', value: 0.5}), document.documentElement.dataset.moving) === 'yes'")
    until(browser, f"JSON.stringify(get('curve-0').data[4].y) !== {json.dumps(json.dumps(residual))}")
    assert not browser.find_element("id", "summary").is_displayed()
    assert "manual.mu" not in browser.execute_script("return location.search")
    shown = browser.execute_script("return Number(document.documentElement.dataset.shown)")
    thumb = browser.find_element("css selector", ".parameter [role=slider]")
    thumb.send_keys(Keys.ARROW_RIGHT * 20)
    until(browser, f"Number(document.documentElement.dataset.shown) > {shown}")
    until(browser, "location.search.includes('manual.mu')")
    until(browser, "document.getElementById('summary').textContent.includes('set by hand')")
    assert in_width(browser)
    click(browser, "parts", "Fitted value")
    until(browser, "!location.search.includes('manual.mu')")
    until(browser, f"document.getElementById('summary').textContent === {json.dumps(fitted)}")
    assert not messages(browser)


def test_nothing_is_wider_than_a_narrow_window(chrome, served):
    shown = opened(of_width(chrome, 360), f"{served}{MYSTERY}&effect=sampling_delay&manual.mu=0.5")
    for figure in ("map", "curve-0"):
        shown.execute_script(f"document.getElementById('{figure}').scrollIntoView()")
        until(shown, f"document.querySelector('#{figure} .main-svg') !== null")
    assert in_width(shown)
    assert not messages(shown)


def test_a_box_on_the_map_selects_trials(browser, served):
    opened(browser, served + MYSTERY)
    box = [{"variable": "theta", "low": -90, "high": 90}, {"variable": "slip_speed", "low": 0, "high": 1}]
    browser.execute_script("document.getElementById('map').emit('plotly_selected', arguments[0])", _event(box))
    until(browser, "/trials are selected/.test(document.getElementById('window-status').textContent)")
    assert browser.execute_script("return new URLSearchParams(location.search).getAll('window').length") == 2
    click(browser, "fails", "Clear selection")
    until(browser, "!location.search.includes('window')")


@pytest.mark.nightly  # the box is drawn in the test before
def test_a_box_is_written_by_keyboard(browser, served):
    from selenium.webdriver.common.keys import Keys

    opened(browser, served + MYSTERY)
    until(browser, "document.querySelectorAll('#box input').length === 4")
    low = browser.find_element("css selector", "#box input")
    assert low.get_attribute("aria-label") == "|v_t| (m/s), lowest"
    low.send_keys("0.5" + Keys.ARROW_UP + Keys.ENTER)
    until(browser, "/trials are selected/.test(document.getElementById('window-status').textContent)")
    (window,) = browser.execute_script("return new URLSearchParams(location.search).getAll('window')")
    name, start, end = window.split(":")
    assert name == "slip_speed"
    assert 0.5 < float(start) < 1 < float(end)
    low.send_keys(Keys.BACKSPACE * 9 + Keys.ENTER)
    until(browser, "!location.search.includes('window')")
    browser.execute_script("const x = get('map-x'); x.value = 2; x.dispatchEvent(new Event('change'))")
    label = browser.execute_script("return trials.variables[2].label")
    assert browser.find_element("css selector", "#box input").get_attribute("aria-label") == f"{label}, lowest"
    assert not messages(browser)
    browser.get("about:blank")  # the next test begins with the default axes


def _event(box):
    """What plotly says of a box over (|v_t|, θ)."""
    up, across = ([one["low"], one["high"]] for one in box)
    return {"range": {"x": across, "y": up}}


def test_the_hints_lead_to_the_truth(browser, served):
    opened(browser, served + MYSTERY)
    for number in range(1, 5):
        until(browser, f"document.getElementById('hint-title').textContent.startsWith('{number} of 5')")
        assert not browser.find_element("id", "truth").is_displayed()
        click(browser, "hints", "Next hint")
    until(browser, "!document.getElementById('reveal').hidden")
    click(browser, "hints", "Reveal")
    until(browser, "document.getElementById('truth').textContent.includes('sampling_delay')")
    click(browser, "hints", "No more")
    until(browser, "document.getElementById('hints').hidden")


@pytest.mark.nightly  # test_workbench completes, checks and adds lines
def test_a_line_of_mathematics_is_completed_checked_and_added(browser, served):
    from selenium.webdriver.common.keys import Keys

    opened(browser, served + MYSTERY)
    line = browser.find_element("id", "line")
    line.send_keys("tau = -c*rx*P")
    until(browser, "document.querySelectorAll('#completions option').length === 2")
    line.send_keys("m; c = [-1, 1]")
    until(browser, "document.getElementById('line-status').textContent.includes(\"unknown symbol or parameter 'Pm'\")")
    line.send_keys(Keys.BACKSPACE * 14 + "n; c = [-1, 1]" + Keys.ENTER)
    until(browser, "document.querySelectorAll('#ladder tr').length === 3")
    assert "τ ← τ" in text(browser, "line-status")
    assert not messages(browser)


@pytest.mark.nightly  # test_workbench has both studies
def test_learned_models_and_learning_curve_are_shown_or_cancelled(browser, served):
    seed = browser.execute_script("return innerWidth")  # what was computed before is shown at once
    opened(browser, f"{served}&data=synthetic&data.size=60&data.seed={seed}")
    click(browser, "compare", "Learning curve")
    until(browser, "!document.getElementById('curve-bar').hidden")
    click(browser, "compare", "Learned models")
    until(
        browser, "document.querySelector('#learned-found tr') !== null", 120
    )  # the first of them, while others follow
    browser.execute_script("document.getElementById('learned-cancel').click()")
    until(browser, "document.getElementById('learned-status').textContent.endsWith('cancelled')")
    assert browser.execute_script("return document.getElementById('learned-bar').hidden")
    until(browser, "document.getElementById('curve-bar').hidden", 120)
    browser.execute_script("document.getElementById('curve').scrollIntoView()")
    until(browser, "document.querySelector('#curve .main-svg') !== null")
    assert not messages(browser)


@pytest.mark.parametrize("count", repeated(25, 1000))
def test_random_clicks_do_no_harm(count, browser, served):
    opened(browser, served + MYSTERY).set_script_timeout(280)
    assert browser.execute_async_script(_CLICKS, count) == count
    click(browser, "fails", "Worst")
    until(browser, "document.getElementById('summary').textContent.startsWith('Held-out error')")
    assert not messages(browser)
