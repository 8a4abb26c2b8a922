"""Sweeps in processes of their own that have loaded everything already: they are forked from a server that waits."""

import os
import subprocess
import sys
import tempfile
from multiprocessing import get_context
from pathlib import Path

from commands import ROOT

from contactlearn.cli import hydra_main

_FORKS = get_context("forkserver")
_FORKS.set_forkserver_preload(["contactlearn.cli.commands", "contactlearn.cli.sweeps.sweep", "forked_sweeps"])


class ForkedSweep:
    """A sweep as `speed.sweeps.started` gives it, which takes half a second and not five to begin."""

    def __init__(self, folder, *words):
        self._printed = Path(tempfile.mkstemp(prefix="sweep-", suffix=".txt")[1])
        self._process = _FORKS.Process(target=_swept, args=(str(folder), words, str(self._printed)))
        self._process.start()
        self.pid = self._process.pid

    @property
    def returncode(self):
        return self._process.exitcode

    def poll(self):
        return self.returncode

    def communicate(self, timeout=None):
        self._process.join(timeout)
        if self.returncode is None:
            raise subprocess.TimeoutExpired("train.py", timeout)
        text = self._printed.read_text("utf-8")
        self._printed.unlink()
        return text, ""


def _swept(folder, words, printed):
    """The command, as the leader of a group of its own."""
    os.setsid()
    os.chdir(ROOT)
    sys.stdout = sys.stderr = open(printed, "w", encoding="utf-8")  # noqa: SIM115 - until the process ends
    sys.argv = ["train.py", "-m", *words, f"hydra.sweep.dir={folder}"]
    hydra_main.train()
