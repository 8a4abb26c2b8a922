"""Commands as a user types them: in this process, which has loaded what they need, or in one of their own."""

import base64
import contextlib
import io
import logging
import subprocess
import sys
from pathlib import Path
from unittest.mock import patch

from diagnoses import TWO_COMPONENTS, few
from matplotlib.figure import Figure

from contactlearn.__main__ import main
from contactlearn.cli import hydra_main
from contactlearn.effects import catalogue

ROOT = Path(__file__).parent.parent
SMALL = ("data.size=80", "train.size=20", "train.repetitions=4", "figures.repetitions=2", "bootstrap=50", "model=[]")
TRAIN = ("data.size=80", "train.size=20", "train.repetitions=4", "bootstrap=50", "model=analytical")
LAWS = ("wang_mason", "mirtich")  # of a small search
EFFECTS = ("surface_tilt", "spin_damping", "side_drag", "contact_patch", "sampling_delay", "parameter_drift")
PIXEL = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR4nGNoAAAAggCBd81ytgAAAABJRU5ErkJggg=="
)  # a PNG


def run(*arguments, cwd=ROOT, status=0, figures=False):
    """Run `train.py …`, `evaluate.py …`, `diagnose.py …` or `contactlearn …` from `cwd`; its output.

    Unless `figures`, the files of figures hold nothing, for drawing takes longer than everything else;
    a diagnosis is a `small_search`.
    """
    printed, handlers = io.StringIO(), list(logging.getLogger().handlers)
    try:
        with (
            contextlib.nullcontext() if figures else without_figures(),
            small_search() if arguments[0] == "diagnose.py" else contextlib.nullcontext(),
            contextlib.chdir(cwd),
            contextlib.redirect_stdout(printed),
            contextlib.redirect_stderr(printed),
            patch.object(sys, "argv", list(arguments)),
        ):
            done = _exit_status(*arguments)
    finally:
        logging.getLogger().handlers = handlers  # Hydra's write to what is closed now
    assert done == status, printed.getvalue()
    return printed.getvalue()


@contextlib.contextmanager
def small_search():
    """Diagnoses search six effects, and a user's own, two laws, and two components of scatter, half of the time.

    It is for tests that are not about the search.
    """

    def first(*_):
        own = (name for name, (kind, *_) in catalogue().items() if not kind.__module__.startswith("contactlearn."))
        return few(*EFFECTS, *own)

    with (
        patch("contactlearn.cli.settings.SEARCHED_LAWS", LAWS),
        patch("contactlearn.diagnosis.search.candidates.SEARCHED_LAWS", LAWS),
        patch("contactlearn.diagnosis.pipeline.all_candidates", first),
        patch("contactlearn.cli.commands.diagnose.all_candidates", first),
        patch("contactlearn.inference.identification.scatter.COMPONENTS", TWO_COMPONENTS),
    ):
        yield


def without_figures():
    """The files of figures hold nothing."""
    return patch.object(Figure, "savefig", _save_a_pixel)


def _save_a_pixel(figure, file, **options):
    file.write(PIXEL)


def _exit_status(command, *arguments):
    """The exit status of a command."""
    if command == "contactlearn":
        return main(list(arguments))
    try:
        getattr(hydra_main, command.removesuffix(".py"))()
    except SystemExit as end:
        return end.code
    return 0


def run_alone(*arguments, cwd=ROOT):
    """Run Python in a process of its own, for what a process loads, or where; its output."""
    done = subprocess.run([sys.executable, *arguments], cwd=cwd, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr
