"""The workbench in a browser: the whole loop on hidden physics, two tabs, links, hints, random clicks."""

import json
import sys
import threading
from urllib.parse import urlsplit

import pytest
from browser import of_width
from run_without_figures import __file__ as COMMAND

pytest.importorskip("dash", reason="the workbench needs Dash: pip install 'contactlearn[workbench]'")

from contactlearn.workbench.models import Models
from contactlearn.workbench.server import listen

SIZE = 200
MYSTERY = f"&data=mystery&data.seed=7&data.size={SIZE}"
_CLICKS = """
const [count, done] = arguments, skipped = /Save run|Search|Experiment|Saved runs|Compare them|Load|[Ll]earn/;
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
    until(browser, "document.querySelectorAll('#ladder tr').length > 0")
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


def _ticked(browser):
    effects = browser.execute_script("return new URLSearchParams(location.search).getAll('effect')")
    return [one.partition(":")[0] for one in effects]


@pytest.mark.nightly
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


def _event(box):
    """What plotly says of a box over (|v_t|, θ)."""
    up, across = ([one["low"], one["high"]] for one in box)
    return {"range": {"x": across, "y": up}}


def test_the_hints_lead_to_the_truth(browser, served):
    browser.get("about:blank")  # a box that another test drew has led to a later hint
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


def test_a_tick_leads_to_the_hint_that_follows_it_and_says_that_it_is_fitted(browser, served):
    opened(browser, served + MYSTERY + "&trial=3")
    until(browser, "document.getElementById('hint-title').textContent.startsWith('1 of 5')")
    until(browser, "document.querySelector('#missing label')")
    busy = "getComputedStyle(document.getElementById('busy')).visibility"
    assert browser.execute_script(f"document.querySelector('#missing label').click(); return {busy}") == "visible"
    until(browser, "document.getElementById('hint-title').textContent.startsWith('4 of 5')")
    until(browser, f"{busy} === 'hidden'")
    click(browser, "hints", "Next hint")
    until(browser, "document.getElementById('hint-title').textContent.startsWith('5 of 5')")


def test_all_bars_of_the_comparison_begin_and_end_together(browser, served):
    opened(browser, served + MYSTERY + "&effect=sampling_delay")
    until(browser, "document.querySelectorAll('#bounds .scale').length === 3")
    until(browser, "document.querySelectorAll('#compare .row .scale').length > 8")
    ends = """return [...document.querySelectorAll('#compare .scale')].map(one => one.getBoundingClientRect())
        .map(one => [Math.round(one.left), Math.round(one.right)].join(' '))"""
    assert len({*browser.execute_script(ends)}) == 1


def test_a_ticked_effect_is_in_the_model_at_once(browser, served):
    """Its row shows no error that was predicted for another model, however long the new ones take."""
    opened(browser, served + MYSTERY)
    row = "[...document.querySelectorAll('#missing label')].filter(x => x.textContent.startsWith('sampling delay'))[0]"
    until(browser, f"{row}?.innerText.includes('%')")
    shown = browser.execute_script(f"const x = {row}; x.querySelector('input').click(); return x.innerText")
    assert shown.split("\n")[-1] == "in the model"


def test_random_clicks_do_no_harm(browser, served):
    opened(browser, served + MYSTERY).set_script_timeout(280)
    assert browser.execute_async_script(_CLICKS, 25) == 25
    click(browser, "fails", "Worst")
    until(browser, "document.getElementById('summary').textContent.startsWith('Held-out error')")
    assert not messages(browser)
