"""Commands that are stopped from outside: one line, silent workers, and nobody left behind; text on any stream."""

import contextlib
import io
import json
import os
import pickle
import signal
import subprocess
import sys
import time
from functools import partial

import pytest
import torch
from repetitions import repeated

from contactlearn.core import workers
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
        assert message.startswith("stopped; the same command resumes ")
        assert message.count("\n") == 1
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
    pytest.param(("train", "data.size=40", "train.size=20", "bootstrap=20", "model=analytical"), "012", 0, id="none"),
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
    pytest.param(("train", "data.size=40", "train.repetitions=2", "bootstrap=20"), marks=pytest.mark.nightly),
    pytest.param(("diagnose", "data.size=24", "seconds=1"), marks=pytest.mark.nightly),
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


# --- Calls that two processes share ---------------------------------------------------------------------


@pytest.fixture
def copied(monkeypatch):
    """A second core, whether there is one or not."""
    monkeypatch.setattr(workers, "_can_be_copied", lambda: True)
    with workers.second_core():
        yield


def taken(k, seconds=0.02):
    time.sleep(seconds)
    return k, os.getpid()


def test_calls_are_shared_by_two_processes_and_their_results_in_order(copied):
    for _ in range(2):  # by the same copy
        numbers, processes = zip(*workers.side_by_side([partial(taken, k) for k in range(8)]), strict=True)
        assert numbers == tuple(range(8))
        assert len({*processes}) == 2
        assert os.getpid() in processes
    each = workers.side_by_side([partial(workers.side_by_side, [partial(taken, k)] * 2) for k in range(4)])
    assert all(one[1] == two[1] for one, two in each)  # calls within calls have no core of their own
    with workers.second_core():  # nor is there a third
        assert len({pid for _, pid in workers.side_by_side([partial(taken, 0)] * 8)}) == 2


def test_items_are_taken_a_few_at_a_time(copied):
    read = []
    done = workers.one_by_one(partial(taken, seconds=0.01), (read.append(k) or k for k in range(30)))
    first = next(done)
    assert len(read) < 30  # not all are in memory
    numbers, processes = zip(first, *done, strict=True)
    assert numbers == tuple(range(30))
    assert len({*processes}) == 2


def test_without_a_second_core_this_process_makes_the_calls():
    assert {pid for _, pid in workers.side_by_side([partial(taken, 0)] * 4)} == {os.getpid()}


def test_calls_that_cannot_be_sent_are_made_here(copied):
    assert workers.side_by_side([lambda: os.getpid()] * 4) == [os.getpid()] * 4
    assert len({pid for _, pid in workers.side_by_side([partial(taken, 0)] * 8)}) == 2


def fails(here, own):
    time.sleep(0.05)
    if (os.getpid() == here) is own:
        raise ZeroDivisionError
    return os.getpid()


@pytest.mark.parametrize("own", [True, False])
def test_a_call_that_fails_in_either_process_says_why(copied, own):
    here = os.getpid()
    with pytest.raises(ZeroDivisionError) if own else contextlib.nullcontext():
        assert workers.side_by_side([partial(fails, here, own)] * 2) == [here] * 2
    assert {pid for _, pid in workers.side_by_side([partial(taken, 0)] * 4)} == {here}  # the copy is no more


def test_tensors_arrive_with_their_layout(copied):
    whole = torch.arange(24.0, dtype=torch.float64).reshape(2, 3, 4)
    for x in (whole, whole.mT, whole[:, ::2, 1], whole[0, 0].expand(5, 4), torch.empty(0, 3), torch.tensor(True)):
        sent = pickle.loads(workers._pickled(x))
        assert sent.dtype is x.dtype
        assert sent.stride() == x.stride()
        assert torch.equal(sent, x)


_SHARED = """
import os, time
from contactlearn.core import workers
from contactlearn.core.signals import graceful_exit

def work():
    os.write(1, f"{os.getpid()}\\n".encode())
    time.sleep(60)

workers._can_be_copied = lambda: True
with graceful_exit(), workers.second_core():
    workers.side_by_side([work, work])
"""


def test_ctrl_c_ends_a_copy_silently():
    parent = subprocess.Popen(
        [sys.executable, "-c", _SHARED], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        start_new_session=True,
    )  # fmt: skip
    assert {int(parent.stdout.readline()) for _ in range(2)} > {parent.pid}
    os.killpg(parent.pid, signal.SIGINT)
    _, message = parent.communicate(timeout=20)  # once the copy has closed its pipes
    assert parent.returncode == 130
    assert message.count("\n") == 1
