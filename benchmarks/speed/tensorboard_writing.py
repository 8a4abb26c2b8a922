"""Share of a run that its record takes: CPU time in TensorBoard and metrics.jsonl, writing thread included.

python benchmarks/speed/tensorboard_writing.py
"""

import contextlib
import io
import sys
import tempfile
import time
import warnings
from pathlib import Path
from unittest.mock import patch

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from contactlearn.__main__ import main
from contactlearn.report.tensorboard import Tracker
from speed.harness import header, parsed, parser, row

COMMANDS = {
    "`train.py`, 450 trials": ("train", "data.size=800", "model=x1_wrench", "train.size=450"),
    "`evaluate.py`, two models, five sizes": (
        "evaluate", "data.size=800", "model=[x1_wrench,residual_wrench]", "curves.sizes=[10,50,100,200,450]",
        "workers=1",
    ),
}  # fmt: skip
METHODS = ("__call__", "scalars", "series", "histogram", "figure", "card", "hyperparameters", "close")


class Clock:
    """CPU seconds of a whole command, and of those calls in it that it is put around, each counted once."""

    def __init__(self):
        self.inside, self._depth = 0.0, 0

    def around(self, method):
        def timed(*args, **settings):
            self._depth, start = self._depth + 1, time.process_time()
            try:
                return method(*args, **settings)
            finally:
                self._depth -= 1
                self.inside += 0 if self._depth else time.process_time() - start

        return timed


def run(words):
    """CPU seconds of a command, and of its record."""
    clock = Clock()
    with contextlib.ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        for name in METHODS:
            stack.enter_context(patch.object(Tracker, name, clock.around(getattr(Tracker, name))))
        stack.enter_context(contextlib.redirect_stdout(io.StringIO()))
        stack.enter_context(contextlib.suppress(SystemExit))
        start = time.process_time()
        main([*words, f"hydra.run.dir={folder}/run"])
        assert Path(folder, "run", "done.json").exists(), words
        return time.process_time() - start, clock.inside


if __name__ == "__main__":
    options = parsed(parser(__doc__, rounds=5))
    warnings.simplefilter("ignore")
    header("command", "whole run", "its record", "share")
    for name, words in COMMANDS.items():
        run(words)  # loads everything
        found = [run(words) for _ in range(options.rounds)]
        whole, record = sorted(found)[len(found) // 2]
        row(name, f"{whole:.2f} s", f"{1e3 * record:.0f} ms", f"{100 * record / whole:.1f} %")
