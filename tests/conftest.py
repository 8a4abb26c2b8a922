"""Fixtures that several test files share, and the inner loop `--quick`."""

import gc
import os
import signal
import sys

import hypothesis
import pytest
import quick
import torch
from browser import chromium, of_width
from threadpoolctl import threadpool_limits

from contactlearn.core.errors import DataError
from contactlearn.data import ellipse_drops as source

gc.disable()  # what is loaded while tests are collected stays: passing over it again and again finds no garbage
# Machines that forbid compiled files, as images of containers do, would have each process of the tests compile the
# package and rewrite the assertions again, which takes longer than many a test.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
torch.set_num_threads(1)  # the suite runs in parallel processes
threadpool_limits(1)  # the BLAS of NumPy and SciPy: threads that wait for each other compute nothing
os.environ.setdefault("OMP_NUM_THREADS", "1")  # of processes that the tests start
signal.signal(signal.SIGINT, signal.default_int_handler)  # a suite in the background would ignore Ctrl-C, as its tests
# On a busy machine making an example takes long; that is no fault of the test.
hypothesis.settings.register_profile("suite", suppress_health_check=[hypothesis.HealthCheck.too_slow])
hypothesis.settings.load_profile("suite")


def pytest_addoption(parser):
    parser.addoption("--quick", action="store_true", help="tests of what changed since the last commit")
    parser.addoption("--third", type=int, metavar="K", help="a third of the cases of each test; all in K, K + 1, K + 2")


def pytest_collection_modifyitems(config, items):
    chosen, third = [*items], config.getoption("--third")
    if config.getoption("--quick"):
        chosen = [*quick.kept(items, quick.changed())]
    if third is not None:
        chosen = [*quick.third_of(chosen, third)]
    if len(chosen) < len(items):
        config.hook.pytest_deselected(items=[item for item in items if item not in set(chosen)])
        items[:] = chosen


def pytest_collection_finish():
    gc.collect()  # laws and effects of which nothing is left but their class
    gc.freeze()
    gc.enable()


@pytest.fixture(scope="session")
def ellipse_drops():
    """The published drops, from CONTACTLEARN_DATA or the download cache.

    The one legitimate skip: no CONTACTLEARN_DATA, nothing in the cache and no network.  A wrong
    CONTACTLEARN_DATA, or a file that is not the published one, fails.
    """
    if os.environ.get("CONTACTLEARN_DATA"):
        return source.load()
    try:
        path = source.find()
    except DataError as error:
        pytest.skip(f"the published drops cannot be had: {error}")
    return source.load(path.parent)


@pytest.fixture(scope="session")
def chrome():
    """Headless Chromium, one for all tests of a process."""
    with chromium() as opened:
        yield opened


@pytest.fixture
def browser(chrome):
    """Chromium with a wide window; `nothing_sticks_out` makes it narrow."""
    return of_width(chrome, 1280)
