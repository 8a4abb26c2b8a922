"""Fixtures that several test files share, the order of the files, and the inner loop `--quick`."""

import gc
import os
import pickle
import signal
import sys

import hypothesis
import pytest
import quick
import torch
import yaml
from browser import chromium, of_width
from fontTools.subset import Options
from hydra._internal.hydra import Hydra
from repetitions import repeated
from threadpoolctl import threadpool_limits

from contactlearn.core.errors import DataError
from contactlearn.data import ellipse_drops as source

# Machines that forbid compiled files, as images of containers do, would have each process of the tests compile the
# package and rewrite the assertions again, which takes longer than many a test.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
torch.set_num_threads(1)  # the suite runs in parallel processes
threadpool_limits(1)  # the BLAS of NumPy and SciPy: threads that wait for each other compute nothing
os.environ.setdefault("OMP_NUM_THREADS", "1")  # of processes that the tests start
signal.signal(signal.SIGINT, signal.default_int_handler)  # a suite in the background would ignore Ctrl-C, as its tests
gc.disable()  # until all is collected: it would look through half a million objects again and again
# On a busy machine making an example takes long; that is no fault of the test.
hypothesis.settings.register_profile("suite", suppress_health_check=[hypothesis.HealthCheck.too_slow])
hypothesis.settings.load_profile("suite")

# The files that take longest begin: a worker that takes one of them last would be waited for.
LONGEST = (
    "test_sweeps.py", "test_commands.py", "test_workbench_browser.py", "test_diagnosis.py", "test_track_commands.py",
    "test_devices.py", "test_workbench.py", "test_hidden_effects.py", "test_signals.py", "test_fit.py",
    "test_dependences.py", "test_report_page.py", "test_audit.py", "test_learning.py", "test_search.py",
    "test_diagnosis_in_space.py", "test_recordings_page.py", "test_numerical_faults.py", "test_docs.py",
    "test_laws.py", "test_tracks_mujoco.py", "test_bodies.py", "test_fit_trials.py", "test_shapes.py",
    "test_mujoco_drops.py", "test_large_tables.py", "test_figures.py", "test_apparatus.py", "test_trained.py",
    "test_report_runs.py", "test_space.py", "test_learning_figures.py", "test_law_and_effect_commands.py",
    "test_diagnosis_figures.py", "test_large.py", "test_user_errors.py", "test_remainder.py", "test_blind.py",
    "test_tables.py", "test_package.py", "test_rigs.py", "test_tracking.py", "test_fit_effects.py",
    "test_structure.py", "test_gp.py", "test_effects_against_nature.py", "test_proxy_effects.py", "test_plugins.py",
    "test_study.py", "test_examples.py", "test_equivalents.py", "test_candidates.py",
    "test_workbench_security.py", "test_hostile_names.py", "test_effects.py", "test_rests.py",
)  # fmt: skip


def pytest_addoption(parser):
    parser.addoption("--quick", action="store_true", help="tests of what changed, and one of every other file")


def pytest_collection_modifyitems(config, items):
    place = {name: number for number, name in enumerate(LONGEST)}
    items.sort(key=lambda item: place.get(item.path.name, len(LONGEST)))
    if config.getoption("--quick"):
        chosen = list(quick.kept(items, quick.changed()))
        config.hook.pytest_deselected(items=[item for item in items if item not in set(chosen)])
        items[:] = chosen


def pytest_collection_finish():
    """What is imported and collected stays, and is no longer looked through for garbage."""
    gc.freeze()
    gc.enable()


@pytest.fixture(autouse=True, scope="session")
def no_work_in_vain():
    """What other packages do in this process and no test looks at.

    Hydra composes each configuration twice, at first to see whether it sets `hydra.mode`, which none here does, and
    parses the shipped files again in each run; the PDF of each figure gets its fonts' rules for scripts that nothing
    here is written in.
    """
    parse, parsed = yaml.load, {}

    def once(stream, Loader):
        text = stream if isinstance(stream, str | bytes) else stream.read()
        if (text, Loader.__name__) not in parsed:
            parsed[text, Loader.__name__] = pickle.dumps(parse(text, Loader))
        return pickle.loads(parsed[text, Loader.__name__])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(yaml, "load", once)
        patch.setattr(Hydra, "get_mode", lambda *_, **__: None)
        patch.setattr(Options, "_drop_tables_default", [*Options._drop_tables_default, "GDEF", "GPOS", "GSUB"])
        yield


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


@pytest.fixture(params=repeated(1280, 360), ids="{}px".format)
def browser(chrome, request):
    """Chromium, in `make test` with a wide window alone."""
    return of_width(chrome, request.param)
