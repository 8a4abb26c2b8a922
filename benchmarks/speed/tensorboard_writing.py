"""Share of a run that its record takes: the CPU time of a command with TensorBoard and metrics.jsonl, and without.

python benchmarks/speed/tensorboard_writing.py
"""

import contextlib
import io
import sys
import tempfile
import time
import warnings
from pathlib import Path
from unittest.mock import MagicMock, patch

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from contactlearn.__main__ import main
from contactlearn.cli.commands import record
from speed.harness import header, interleaved, medians, parser, row

COMMANDS = {
    "`train.py`, 450 trials": ("train", "data.size=800", "model=x1_wrench", "train.size=450"),
    "`evaluate.py`, two models, five sizes": (
        "evaluate", "data.size=800", "model=[x1_wrench,residual_wrench]", "curves.sizes=[10,50,100,200,450]",
        "workers=1",
    ),
}  # fmt: skip
WITHOUT = MagicMock()  # takes everything and writes nothing
WITHOUT.return_value.__enter__.return_value = MagicMock()


def seconds(words, tracked):
    """CPU seconds of a command, all threads together."""
    with (
        tempfile.TemporaryDirectory() as folder,
        patch.object(sys, "argv", ["contactlearn", *words, f"hydra.run.dir={folder}/run"]),
        patch.object(record, "Tracker", record.Tracker if tracked else WITHOUT),
        contextlib.redirect_stdout(io.StringIO()),
    ):
        start = time.process_time()
        with contextlib.suppress(SystemExit):
            main()
        return time.process_time() - start


if __name__ == "__main__":
    options = parser(__doc__, rounds=5).parse_args()
    warnings.simplefilter("ignore")
    header("command", "without", "with", "more")
    for name, words in COMMANDS.items():
        seconds(words, True)  # loads everything
        clocks = {tracked: lambda tracked=tracked, words=words: seconds(words, tracked) for tracked in (False, True)}
        times = medians(interleaved(clocks, 1 if options.quick else options.rounds))
        row(name, *(f"{times[key]:.2f} s" for key in (False, True)), f"{100 * (times[True] / times[False] - 1):.1f} %")
