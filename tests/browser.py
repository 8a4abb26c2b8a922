"""Headless Chromium for the tests of pages, with its console and its network logged, in windows of several widths."""

import shutil
from contextlib import contextmanager

import pytest

_ARGUMENTS = (
    "headless", "no-sandbox", "disable-gpu", "disable-quic", "no-first-run", "disable-background-networking",
    "disable-component-update", "disable-sync", "disable-dev-shm-usage",
)  # fmt: skip


@contextmanager
def chromium():
    """The browser; the test is skipped, and says so, where there is none."""
    binary, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if not binary or not driver:
        pytest.skip("no chromium and chromedriver on this machine: apt-get install chromium chromium-driver")
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = binary
    for argument in _ARGUMENTS:
        options.add_argument(f"--{argument}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    opened = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    yield opened
    opened.quit()


def of_width(browser, width):
    """The browser with a window of another width."""
    size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    return browser


def nothing_sticks_out(browser):
    """Whether a page keeps to the width of its window, and does so once that is as narrow as a telephone."""
    from selenium.webdriver.support.ui import WebDriverWait

    fits = "return document.documentElement.scrollWidth <= document.documentElement.clientWidth"
    wide = browser.execute_script(fits)
    of_width(browser, 360)
    return wide and WebDriverWait(browser, 20, 0.05).until(lambda narrow: narrow.execute_script(fits))
