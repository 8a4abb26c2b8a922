"""Pictures of the program for the README and the documentation, taken in Chromium from the program itself.

    python tools/pictures.py            all of them, into docs/pictures
    python tools/pictures.py loop       one of them

A diagnosis of `data=mystery data.seed=7` is made first where `outputs/pictures/diagnosis` has none.
"""

import contextlib
import io
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

from PIL import Image
from selenium.webdriver.support.ui import WebDriverWait

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "tests"))

from browser import chromium  # noqa: E402

TARGET = ROOT / "docs" / "pictures"
RUNS = ROOT / "outputs" / "pictures"
MYSTERY = ("data=mystery", "data.seed=7")
STEPS = ("sampling delay", "velocity-dependent restitution", "orientation-dependent restitution")
"""The effects that the moving picture ticks, one after the other."""


def diagnosis():
    """The folder of a diagnosis of the mystery drops."""
    folder = RUNS / "diagnosis"
    if not (folder / "report.html").exists():
        command = [sys.executable, "diagnose.py", *MYSTERY, f"hydra.run.dir={folder}"]
        subprocess.run(command, cwd=ROOT, check=True)
    return folder


def sized(browser, width, height, scale=1):
    """The browser with a window of another size; a narrow one is that of a telephone."""
    size = {"width": width, "height": height, "deviceScaleFactor": scale, "mobile": width < 500}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    return browser


def until(browser, condition, seconds=120):
    """Wait for a condition of JavaScript."""
    WebDriverWait(browser, seconds, 0.1).until(lambda b: b.execute_script(f"return Boolean({condition})"))


def shot(browser, clip=None):
    """What the window shows, or a part of it (x, y, width, height in pixels of the page)."""
    picture = Image.open(io.BytesIO(browser.get_screenshot_as_png())).convert("RGB")
    scale = picture.width / browser.execute_script("return innerWidth")
    return picture.crop(tuple(int(scale * c) for c in clip)) if clip else picture


def write(picture, name):
    """A picture as WebP, which is a third of its PNG."""
    TARGET.mkdir(exist_ok=True)
    path = TARGET / f"{name}.webp"
    picture.save(path, quality=88, method=6)
    print(path.relative_to(ROOT), f"{path.stat().st_size >> 10} kB")


@contextlib.contextmanager
def workbench():
    """The address of a workbench with the mystery drops."""
    from contactlearn.workbench.models import Models
    from contactlearn.workbench.server import listen

    with contextlib.chdir(RUNS):
        server, address = listen("127.0.0.1", 0, Models())
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield address.url + "".join(f"&{word}" for word in MYSTERY) + "&law=mirtich"
        finally:
            server.shutdown()
            thread.join()
            server.server_close()


def opened(browser, url):
    """The browser with a workbench that has drawn its page."""
    browser.get(url)
    until(browser, "document.documentElement.dataset.shown")
    until(browser, "document.querySelectorAll('#ladder tr').length > 0")
    time.sleep(2)
    return browser


ROW = """
const rows = [...document.querySelectorAll('#missing label')];
for (const row of rows) row.style.outline = '';
const row = rows.filter(x => x.textContent.toLowerCase().startsWith(arguments[0]))[0];
row.style.outline = '3px solid #d95f02';
row.style.outlineOffset = '-3px';
return row.querySelector('input');
"""
ABOVE = """
for (const row of document.querySelectorAll('#missing label')) row.style.outline = '';
const [bar, main] = ['bar', 'main'].map(id => document.getElementById(id));
scrollTo(0, main.offsetTop - bar.offsetHeight);
document.querySelector('#missing .effects').scrollTo(0, 0);
"""
TRIAL = """
const head = document.getElementById('trial-status'), above = document.getElementById('bar').offsetHeight + 20;
scrollTo({top: head.getBoundingClientRect().top + scrollY - above, behavior: 'instant'});
"""
ESTIMATED = "[...document.querySelectorAll('#missing label:has(input:checked) .value')].every(x => !x.textContent)"
"""The errors beside the effects are those of the model that is ticked."""
FLOOR = "document.querySelector('#floor .noise')"


def loop(browser):
    """The loop: the law alone, then an effect is ticked and the error falls, until only noise is left."""
    with workbench() as url:
        opened(sized(browser, 1120, 900), url)
        until(browser, FLOOR)
        browser.execute_script("document.getElementById('hints').hidden = true;" + ABOVE)
        time.sleep(1)
        frames = [(shot(browser), 1800)]
        for effect in STEPS:
            box = browser.execute_script(ROW, effect)
            frames.append((shot(browser), 900))
            before = browser.execute_script("return document.getElementById('summary').textContent")
            browser.execute_script("arguments[0].click()", box)
            until(browser, f"document.getElementById('summary').textContent !== {before!r}")
            until(browser, ESTIMATED)
            time.sleep(3)  # the figures are drawn again
            browser.execute_script(ABOVE)
            time.sleep(0.5)
            frames.append((shot(browser), 1800))
    frames[-1] = (frames[-1][0], 4000)
    pictures, times = zip(*frames, strict=True)
    path = TARGET / "loop.webp"
    pictures[0].save(path, save_all=True, append_images=pictures[1:], duration=times, loop=0, quality=80, method=6)
    print(path.relative_to(ROOT), f"{path.stat().st_size >> 10} kB")


def bench(browser):
    """The workbench with the law alone, and its panes below."""
    with workbench() as url:
        opened(sized(browser, 1400, 1000), f"{url}&effect=sampling_delay")
        until(browser, FLOOR)
        write(shot(browser), "workbench")
        browser.execute_script(TRIAL)
        time.sleep(3)
        write(shot(browser), "workbench_trial")


CALLOUT = """
const [selector, words, place, number] = arguments;
const found = [...document.querySelectorAll(selector)].filter(x => x.textContent.includes(words))[place];
if (!found) throw new Error(`the page has no ${selector} with "${words}"`);
const box = found.getBoundingClientRect(), mark = document.createElement('div');
mark.textContent = number;
mark.style.cssText = `position:absolute;z-index:999;left:${Math.max(2, box.left - 42)}px;top:${box.top + scrollY - 2}px;
  width:32px;height:32px;border-radius:50%;background:#d95f02;color:#fff;font:bold 18px/32px system-ui;
  text-align:center`;
document.body.append(mark);
return box.top + scrollY;
"""
MARKED = (
    (
        "report_annotated",
        (
            ("h2", "Verdict", 0),
            ("table", "Error on held-out trials", 0),
            ("p", "error falls", 0),
            (".switches", "Try", 0),
        ),
    ),
    ("report_budget", (("h2", "Error budget", 0),)),
    ("report_effect", (("h2", "Missing effects", 0),)),
)
"""Parts of the report, each with the places that get a number, which docs/reading.md explains."""


UNCOVER = """
const covered = document.querySelector('.switches').getBoundingClientRect().bottom;
if (covered > 0 && covered < innerHeight / 3) scrollBy({top: -covered - 10, behavior: 'instant'});
"""
"""The effects to tick stay in view, over what is scrolled to."""


def report(browser):
    """The first screen of a report, wide and as narrow as a telephone; and parts of it with numbers."""
    page = (diagnosis() / "report.html").as_uri()
    for width, height, name in ((1400, 900, "report"), (390, 844, "report_narrow")):
        sized(browser, width, height, 1 if width > 500 else 2).get(page)
        time.sleep(3)
        write(shot(browser), name)
    sized(browser, 1300, 1100).get(page)
    time.sleep(3)
    number = 0
    for name, places in MARKED:
        tops = []
        for place in places:
            number += 1
            tops.append(browser.execute_script(CALLOUT, *place, number))
        browser.execute_script("scrollTo({top: arguments[0], behavior: 'instant'})", min(tops) - 30)
        browser.execute_script(UNCOVER)
        time.sleep(2)
        write(shot(browser), name)


def board(browser):
    """TensorBoard on the run folder of the diagnosis."""
    folder = diagnosis()
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "tensorboard.main", "--logdir", folder.name, "--port", str(port)]
    served = subprocess.Popen(command, cwd=folder.parent, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        time.sleep(12)
        for tab in ("custom_scalars", "images"):
            sized(browser, 1400, 900).get("about:blank")
            browser.get(f"http://127.0.0.1:{port}/#{tab}")
            time.sleep(8)
            write(shot(browser), f"tensorboard_{tab}")
    finally:
        served.terminate()


if __name__ == "__main__":
    makers = {maker.__name__: maker for maker in (loop, bench, report, board)}
    RUNS.mkdir(parents=True, exist_ok=True)
    TARGET.mkdir(exist_ok=True)
    with chromium() as chrome:
        for name in sys.argv[1:] or makers:
            makers[name](chrome)
