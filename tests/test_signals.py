"""Commands that are stopped from outside: one line, silent workers, and nobody left behind; text on any stream."""

import contextlib
import io
import json
import os
import signal
import subprocess
import sys

import pytest

from contactlearn.core.signals import defer_interrupts, graceful_exit

_AT_WORK = """
import os, signal, time
from contactlearn.core import workers
from contactlearn.core.signals import graceful_exit
from contactlearn.core.workers import WorkerPool

def work():
    print(os.getpid(), signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, []), flush=True)
    time.sleep(60)

if __name__ == "__main__":
    with graceful_exit(), WorkerPool(1) as pool:
        for future in [pool.submit(work) for _ in range(2)]:
            future.result()
"""


@pytest.mark.parametrize(("stop", "status"), [
    pytest.param(lambda parent: os.killpg(parent, signal.SIGINT), 130, id="Ctrl-C"),  # goes to the worker as well
    pytest.param(lambda parent: os.kill(parent, signal.SIGTERM), 143, id="SIGTERM"),
    pytest.param(lambda parent: os.kill(parent, signal.SIGKILL), -signal.SIGKILL, id="SIGKILL"),
])  # fmt: skip
def test_workers_end_silently_with_their_parent(stop, status, tmp_path):
    (tmp_path / "at_work.py").write_text(_AT_WORK)
    parent = subprocess.Popen(
        [sys.executable, "at_work.py"], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        start_new_session=True, env=os.environ | {"PYTHONPATH": os.getcwd()},
    )  # fmt: skip
    worker, deaf = parent.stdout.readline().split()
    assert deaf == "True"  # to Ctrl-C, which the parent answers
    stop(parent.pid)
    try:
        _, message = parent.communicate(timeout=20)  # all that hold its pipes must have closed them, the worker too
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.kill(int(worker), signal.SIGKILL)
    assert parent.returncode == status
    if status > 0:
        assert message == "stopped\n"
    else:  # Python's own resource tracker warns of what the killed one did not clean up
        assert "Traceback" not in message


def test_output_that_nobody_reads(tmp_path):
    words = ("train", "-m", "data=synthetic", "data.size=10,11")
    ours, theirs = os.pipe()
    os.close(ours)
    done = subprocess.run(
        [sys.executable, "-m", "contactlearn", *words], cwd=tmp_path, stdout=theirs, stderr=subprocess.PIPE, text=True,
        env=os.environ | {"PYTHONPATH": os.getcwd(), "PYTHONUNBUFFERED": ""},
    )  # fmt: skip
    os.close(theirs)
    assert done.returncode == 141
    assert done.stderr == ""


@pytest.mark.parametrize(("encoding", "wanted"), [
    ("utf-8", "μ = 0.1 ± 0.02 m², 日"), ("ascii", "? = 0.1 ? 0.02 m?, ?"), ("cp1252", "? = 0.1 ± 0.02 m², ?"),
])  # fmt: skip
def test_streams_take_text_that_their_encoding_lacks(encoding, wanted, monkeypatch):
    stream = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    monkeypatch.setattr(sys, "stdout", stream)
    with graceful_exit():
        print("μ = 0.1 ± 0.02 m², 日", end="")
    assert stream.buffer.getvalue().decode(encoding) == wanted


_CLOSED = """
import os, sys
for number in map(int, sys.argv.pop(1)):
    os.close(number)
os.execv(sys.executable, [sys.executable, "-m", "contactlearn", *sys.argv[1:]])
"""


@pytest.mark.parametrize(("words", "closed", "status"), [
    pytest.param(("--help",), "1", 0, id="no output"),
    pytest.param(("train", "dta=synthetic"), "12", 2, id="no messages"),
    pytest.param(
        ("train", "data.size=40", "train.repetitions=1", "bootstrap=20", "model=analytical"), "012", 0, id="none"
    ),
])  # fmt: skip
def test_commands_need_neither_streams_nor_a_window(words, closed, status, tmp_path):
    """Jupyter's backend of matplotlib, named to every process that a notebook starts, is not installed."""
    environment = os.environ | {"PYTHONPATH": os.getcwd(), "MPLBACKEND": "module://not_installed.backend_inline"}
    done = subprocess.run(
        [sys.executable, "-c", _CLOSED, closed, *words], cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    assert (done.returncode, done.stdout) == (status, "")
    assert "Error" not in done.stderr
    results = [json.loads(path.read_text("utf-8")) for path in tmp_path.glob("outputs/train/*/results.json")]
    assert len(results) == (words[0] == "train" and status == 0)


@pytest.mark.parametrize("words", [
    ("train", "--help"), ("impacts", "--help"),
], ids=" ".join)  # fmt: skip
def test_commands_write_to_an_ascii_pipe(words, tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "contactlearn", *words], cwd=tmp_path, capture_output=True, text=True,
        env=os.environ | {"PYTHONPATH": os.getcwd(), "PYTHONUTF8": "0", "LC_ALL": "C", "PYTHONIOENCODING": "ascii"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.isascii()


def test_a_step_is_stopped_afterwards():
    done, before = [], signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt), defer_interrupts():  # noqa: PT012 - the step goes on
        signal.raise_signal(signal.SIGINT)
        done.append("the rest of it")
    assert done
    assert signal.getsignal(signal.SIGINT) is before
