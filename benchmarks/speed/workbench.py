"""Times of the workbench in a browser: start, first paint, ticks, sliders, maps of many trials, memory.

    python benchmarks/speed/workbench.py

The command is started as a user starts it, and headless Chromium clicks.  A tick adds a fifth effect to four, another
one each time, so no fit is known before; its time ends when error and parameters stand in the page.  Times are medians
and depend on other work of the machine: the load average is printed first.
"""

import os
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from selenium import webdriver

TICKS, REFITS = 30, 200
FOUR = "effect=[side_drag,surface_tilt,spin_damping,rolling_resistance]"
MORE = (
    "velocity_dependent_restitution", "velocity_dependent_friction", "tangential_restitution", "sampling_delay",
    "location_dependent_friction", "location_dependent_restitution", "orientation_dependent_restitution", "com_offset",
    "inertia_error", "contact_patch",
)  # fmt: skip
_TICK = """
const [name, done] = arguments, parts = document.getElementById("parts"), began = performance.now();
const box = document.querySelector(`#missing input[value="${name}"]`);
const seen = new MutationObserver(() => { seen.disconnect(); done(performance.now() - began); });
seen.observe(parts, {childList: true, subtree: true});
box.click();
"""
_SLIDE = """
const [done] = arguments, path = () => document.querySelector("#curve-0 .js-line")?.getAttribute("d"), before = path();
const thumb = [...document.querySelectorAll(".parameter [role=slider]")].find(x => /^c = /.test(x.ariaLabel));
const began = performance.now();
const seen = new MutationObserver(() => {
  if (!path() || path() === before) return;
  seen.disconnect();
  requestAnimationFrame(() => setTimeout(() => done(performance.now() - began)));  // behind the frame that shows it
});
seen.observe(document.getElementById("curve-0"), {subtree: true, childList: true, attributes: true});
thumb.focus({preventScroll: true});
thumb.dispatchEvent(new KeyboardEvent("keydown", {key: "ArrowRight", bubbles: true}));
"""


def main():
    """Print a table."""
    if not shutil.which("chromium") or not shutil.which("chromedriver"):
        print("no chromium and chromedriver on this machine: apt-get install chromium chromium-driver")
        return
    print(f"load average {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    for size in (400, 1718):
        with Served(f"data.size={size}", FOUR) as served:
            browser, ticks = served.browser, []
            for seed in range(TICKS // len(MORE)):
                served.open(f"&seed={seed}")
                ticks += [tick(browser, name) for name in MORE]
            slides = slid(served)
            print(
                f"{size} trials: up {served.up:.1f} s, first paint {served.paint:.2f} s, figures {served.drawn:.2f} s"
            )
            print(f"  tick → error {_ms(ticks)}, slider → curves {_ms(slides)}")
            if size == 400:
                refits(served)
    with Served("data.size=50000") as served:
        print(f"50000 trials: figures {served.drawn:.1f} s after the address, {served.memory():.0f} MiB")


def tick(browser, name):
    """Milliseconds from a tick to the new error; the tick is taken back."""
    took = browser.execute_async_script(_TICK, name)
    time.sleep(0.5)
    browser.execute_async_script(_TICK, name)
    time.sleep(1.5)  # until the slower parts are updated
    return took


def slid(served):
    """Milliseconds from a key on a slider to the first frame that shows another curve of its effect."""
    served.browser.set_window_size(1280, 1700)  # the slider and two curves are in view together
    served.browser.execute_script("document.getElementById('parts').scrollIntoView()")
    time.sleep(3)
    return [served.browser.execute_async_script(_SLIDE) for _ in range(TICKS) if time.sleep(1) is None]


def refits(served):
    """Memory after many refits, each of another model: other splits of the data."""
    for seed in range(REFITS // len(MORE)):
        served.open(f"&seed={seed + 10}")
        for name in MORE:
            served.browser.execute_async_script(_TICK, name)
    print(f"  memory after {REFITS} refits: {served.memory():.0f} MiB")


def _ms(times):
    return f"{statistics.median(times) / 1000:.3f} s (up to {max(times) / 1000:.2f}, {len(times)} times)"


class Served:
    """A workbench in a process of its own, and a browser that shows it."""

    def __init__(self, *words):
        self.words = ("data=mystery", "data.seed=7", *words)

    def __enter__(self):
        self.folder = tempfile.TemporaryDirectory()
        began = time.monotonic()
        call = [sys.executable, "-m", "contactlearn", "workbench", *self.words, "--no-browser", "--port", "0"]
        self.process = subprocess.Popen(call, cwd=self.folder.name, stdout=subprocess.PIPE, text=True)
        self.address = self.process.stdout.readline().split()[1]
        self.up = time.monotonic() - began
        options = webdriver.ChromeOptions()
        options.binary_location = shutil.which("chromium")
        for argument in ("headless", "no-sandbox", "disable-gpu", "disable-dev-shm-usage", "window-size=1280,900"):
            options.add_argument(f"--{argument}")
        self.browser = webdriver.Chrome(options=options, service=webdriver.ChromeService(shutil.which("chromedriver")))
        self.browser.set_script_timeout(120)
        self.open("")
        return self

    def open(self, more):
        """Open the page, and wait for its figures."""
        began = time.monotonic()
        self.browser.get(self.address + more)
        while not self.browser.execute_script("return document.querySelector('#map .main-svg') !== null"):
            time.sleep(0.01)
        self.drawn = time.monotonic() - began
        paint = "return performance.getEntriesByName('first-contentful-paint')[0].startTime"
        self.paint = self.browser.execute_script(paint) / 1000
        time.sleep(3)

    def memory(self):
        """Largest memory of the server so far, in MiB."""
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        return int(re.search(r"VmHWM:\s+(\d+)", status)[1]) / 1024

    def __exit__(self, *_):
        self.browser.quit()
        self.process.terminate()
        self.process.wait()
        self.folder.cleanup()


if __name__ == "__main__":
    main()
