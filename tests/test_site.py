"""The documentation site: it builds without a warning, asks for nothing from elsewhere, and has every public name."""

import inspect
import json
import re
import subprocess
import sys
import zlib
from html.parser import HTMLParser
from pathlib import Path

import pytest
from browser import nothing_sticks_out

from contactlearn import laws

ROOT = Path(__file__).parent.parent
pytest.importorskip("sphinx", reason="the site is built with the extra docs: pip install '.[docs]'")


FEW = {
    "index.md": "# Pages\n\n$$ v^+ = v + M^{-1} P $$\n\n```{toctree}\nlaws\ncontracts\nmodules\n```\n",
    "modules.md": "# All\n\n```{eval-rst}\n.. autosummary::\n   :toctree: api\n\n   contactlearn.core.devices\n```\n",
    "laws.md": "# Laws\n\n```{eval-rst}\n.. automodule:: contactlearn.laws\n   :members:\n```\n",
    "contracts.md": "# Contracts\n\nSee [laws](laws.md) and [their head](laws.md#laws).\n",
}
"""Pages of a site that is built as the documents are, in a tenth of the time."""


def build(source, target):
    """The process that builds a site as `make docs` does, finished."""
    settings = ["-W", "--keep-going", "-q", "-d", target / "pages", "-c", ROOT / "docs"]
    command = [sys.executable, "-m", "sphinx", *settings, source, target / "site"]
    return subprocess.run(command, cwd=source, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A site of a few pages; `make docs` builds that of all documents as strictly."""
    target = tmp_path_factory.mktemp("docs")
    source = target / "source"
    (source / "docs").mkdir(parents=True)
    for name, text in FEW.items():
        (source / "docs" / name).write_text(text, encoding="utf-8")
    built = build(source, target)
    assert built.returncode == 0, built.stderr
    assert not built.stderr
    return target / "site"


FAULTS = {
    "[there](nowhere.md)": "nowhere.md",
    "[there](#nothing)": "nothing",
    "![picture](none.png)": "none.png",
    "```{eval-rst}\n.. automodule:: contactlearn.nothing\n```": "contactlearn.nothing",
}


def test_faults_end_the_build(tmp_path):
    """A page, an anchor, a picture and a module that are not there."""
    page = tmp_path / "source" / "docs" / "index.md"
    page.parent.mkdir(parents=True)
    page.write_text("# A page\n\n" + "\n\n".join(FAULTS) + "\n", encoding="utf-8")
    built = build(tmp_path / "source", tmp_path)
    assert built.returncode != 0
    for fault in FAULTS.values():
        assert re.search(rf"WARNING: .*{re.escape(fault)}", built.stderr), fault


class _Loads(HTMLParser):
    """Addresses that a page loads by itself; where its links lead is not loaded."""

    def __init__(self, text):
        super().__init__()
        self.addresses = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        if tag in ("script", "img", "iframe", "source"):
            self.addresses.append(given.get("src") or "")
        elif tag == "link" and given.get("rel") != "canonical":
            self.addresses.append(given.get("href") or "")


def test_nothing_is_loaded_from_elsewhere(site):
    pages = list(site.rglob("*.html"))
    assert len(pages) > len(FEW)
    for page in pages:
        for address in _Loads(page.read_text("utf-8")).addresses:
            assert not re.match(r"(https?:)?//", address), (page.name, address)
            assert not address or (page.parent / address.split("?")[0].split("#")[0]).exists(), (page.name, address)
    for style in site.rglob("*.css"):
        assert not re.search(r"(url\(|@import)\s*['\"]?(https?:)?//", style.read_text("utf-8")), style


def test_every_public_name_is_in_the_reference(site):
    """Those of the package, and of the rooms that a user builds on."""
    inventory = (site / "objects.inv").read_bytes().split(b"\n", 4)[4]
    listed = {line.split(" ")[0] for line in zlib.decompress(inventory).decode().splitlines()}
    for room in (laws,):
        for name in room.__all__:
            value = getattr(room, name)
            if inspect.isclass(value) or inspect.isfunction(value):
                assert f"{value.__module__}.{value.__qualname__}" in listed, name


def test_a_page_of_a_module_has_signatures(site):
    """Our template makes it, in place of a bare list of names."""
    text = re.sub(r"<.*?>", "", (site / "docs" / "api" / "contactlearn.core.devices.html").read_text("utf-8"))
    assert re.search(r"contactlearn\.core\.devices\.find\(\s*\w+: str", text)


def test_equations_are_typeset_from_a_disk(site, browser):
    from selenium.webdriver.support.ui import WebDriverWait

    browser.get((site / "docs" / "index.html").as_uri())
    WebDriverWait(browser, 60).until(lambda b: b.execute_script("return document.querySelector('mjx-container svg')"))


def test_the_search_works_from_a_disk(site, browser):
    from selenium.webdriver.support.ui import WebDriverWait

    browser.get_log("browser"), browser.get_log("performance")
    browser.get(f"{(site / 'search.html').as_uri()}?q=restitution")
    links = "return [...document.querySelectorAll('ul.search li a')].map(link => link.href)"
    WebDriverWait(browser, 60).until(lambda b: any("laws.html" in link for link in b.execute_script(links)))
    assert nothing_sticks_out(browser)
    sent = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    urls = [event["params"]["request"]["url"] for event in sent if event["method"] == "Network.requestWillBeSent"]
    assert urls
    assert all(url.startswith(("file:", "data:")) for url in urls)
    assert not browser.get_log("browser")
