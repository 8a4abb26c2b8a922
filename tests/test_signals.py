"""Commands that are stopped from outside: one line of theirs, silent workers, and nobody left behind."""

import contextlib
import os
import signal
import subprocess
import sys

import pytest
from repetitions import repeated

from contactlearn.core.signals import defer_interrupts

_AT_WORK = """
import os, signal, time
from contactlearn.core.signals import graceful_exit
from contactlearn.core.workers import WorkerPool

def work():
    print(os.getpid(), signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, []), flush=True)
    time.sleep(60)

if __name__ == "__main__":
    with graceful_exit(), WorkerPool(2) as pool:
        for future in [pool.submit(work) for _ in range(4)]:
            future.result()
"""


@pytest.mark.parametrize(("stop", "status"), [
    pytest.param(lambda parent: os.killpg(parent, signal.SIGINT), 130, id="Ctrl-C"),  # goes to the workers as well
    pytest.param(lambda parent: os.kill(parent, signal.SIGTERM), 143, id="SIGTERM", marks=pytest.mark.nightly),
    pytest.param(lambda parent: os.kill(parent, signal.SIGKILL), -signal.SIGKILL, id="SIGKILL"),
])  # fmt: skip
def test_workers_end_silently_with_their_parent(stop, status, tmp_path):
    (tmp_path / "at_work.py").write_text(_AT_WORK)
    parent = subprocess.Popen(
        [sys.executable, "at_work.py"], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        start_new_session=True, env=os.environ | {"PYTHONPATH": os.getcwd()},
    )  # fmt: skip
    workers, deaf = zip(*(parent.stdout.readline().split() for _ in range(2)), strict=True)
    assert deaf == ("True", "True")  # to Ctrl-C, which their parent answers
    stop(parent.pid)
    try:
        _, message = parent.communicate(
            timeout=20
        )  # which all that hold its pipes must have closed, workers among them
    finally:
        for worker in map(int, workers):
            with contextlib.suppress(ProcessLookupError):
                os.kill(worker, signal.SIGKILL)
    assert parent.returncode == status
    if status > 0:
        assert message == "stopped; the same command resumes where a sweep, learning curves or a large diagnosis was\n"
    else:  # Python's own resource tracker warns of what the killed one did not clean up
        assert "Traceback" not in message


@pytest.mark.parametrize(
    "words",
    repeated(
        ("train", "-m", "data=synthetic", "train.size=-1,-2"), ("--help",), ("audit", "--help"), ("train", "--help")
    ),
)
def test_output_that_nobody_reads(words, tmp_path):
    ours, theirs = os.pipe()
    os.close(ours)
    done = subprocess.run(
        [sys.executable, "-m", "contactlearn", *words], cwd=tmp_path, stdout=theirs, stderr=subprocess.PIPE, text=True,
        env=os.environ | {"PYTHONPATH": os.getcwd(), "PYTHONUNBUFFERED": ""},
    )  # fmt: skip
    os.close(theirs)
    assert done.returncode == 141
    assert done.stderr == ""


def test_a_step_is_stopped_afterwards():
    done, before = [], signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt), defer_interrupts():  # noqa: PT012 - the step goes on
        signal.raise_signal(signal.SIGINT)
        done.append("the rest of it")
    assert done
    assert signal.getsignal(signal.SIGINT) is before
