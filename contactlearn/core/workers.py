"""Processes that work side by side and end with this one, silently, however it ends."""

import os
import pickle
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager, suppress
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection
from types import TracebackType
from typing import ParamSpec, TypeVar

import torch
from threadpoolctl import threadpool_limits

_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")


class WorkerPool(ProcessPoolExecutor):
    """New processes of one thread each, as a context manager; an exception in it ends them at once.

    A fork would copy the locks of threads, but not the threads.  Each worker reads a pipe that this process alone can
    close, and ends when it is closed: by an exception, or because this process is no more.
    """

    def __init__(self, processes: int) -> None:
        context = get_context("spawn")
        watched, self._open = context.Pipe(duplex=False)
        super().__init__(processes, context, initializer=_begin, initargs=(watched,))

    def submit(
        self, fn: Callable[_Arguments, _Result], /, *args: _Arguments.args, **kwargs: _Arguments.kwargs
    ) -> Future[_Result]:
        """Have a worker call a function; the first calls start the workers."""
        with without_interrupts():
            return super().submit(fn, *args, **kwargs)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is not None:
            self._open.close()
        self.shutdown()
        self._open.close()


@contextmanager
def without_interrupts() -> Generator[None]:
    """Hold Ctrl-C back; processes that start here never get it, and leave it to their parent to say so."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin(watched: Connection) -> None:
    torch.set_num_threads(1)
    threadpool_limits(1)
    threading.Thread(target=_end_with, args=(watched,), daemon=True).start()


def _end_with(watched: Connection) -> None:
    """End this process when its parent closes the pipe, or is no more."""
    with suppress(EOFError, OSError):
        watched.recv()
    os._exit(1)


# --- A second core for a moment ------------------------------------------------------------------------


def side_by_side(calls: Sequence[Callable[[], _Result]], fewest: int = 2) -> list[_Result]:
    """Return the results of independent calls, which a second core shares with this one where there is one.

    A copy of this process takes calls in turn with it; what the calls change in the copy is lost.  The results do not
    depend on the cores, for a call that the copy does not answer is made here.  A worker has one core, and calls within
    calls have none to share.  A process with threads at work or a GPU cannot be copied safely, nor can one on another
    system than Linux.

    Args:
        calls: at most 256, each of some hundredths of a second at least, which a copy takes.
        fewest: calls that a copy pays for.
    """
    if not fewest <= len(calls) <= 256 or _sharing.locked() or not _can_be_copied():
        return [call() for call in calls]
    with _sharing:
        return _shared(calls)


_sharing = threading.Lock()
_OTHERS = 0.5  # mean of the processes that wait for a core, beyond which a copy would be one more
_PATIENCE = 60.0  # s, after which a copy that says nothing is given up


def _can_be_copied() -> bool:
    if sys.platform != "linux" or parent_process() is not None:
        return False
    cores = len(os.sched_getaffinity(0))
    if cores < 2 or os.getloadavg()[0] > cores + _OTHERS:
        return False
    busy = {thread for thread in threading.enumerate() if not thread.daemon} - {threading.current_thread()}
    return not busy and not torch.cuda.is_available()


def _shared(calls: Sequence[Callable[[], _Result]]) -> list[_Result]:
    context = get_context("fork")
    waiting, queue = os.pipe()  # of the numbers of calls that nobody has taken
    os.write(queue, bytes(range(len(calls))))
    os.close(queue)
    receiving, sending = context.Pipe(duplex=False)
    copy = context.Process(target=_send, args=(sending, calls, waiting), daemon=True)
    with without_interrupts(), warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of threads, which are those of idle libraries
        copy.start()
    sending.close()
    try:
        done = dict(_taken(calls, waiting))
        with suppress(EOFError):
            if receiving.poll(_PATIENCE):
                done |= pickle.loads(receiving.recv_bytes())
    finally:
        copy.kill()
        copy.join()
        receiving.close()
        os.close(waiting)
    return [done[k] if k in done else call() for k, call in enumerate(calls)]


def _taken(calls: Sequence[Callable[[], _Result]], waiting: int) -> Iterator[tuple[int, _Result]]:
    """The calls that nobody else takes, by their numbers, with their results."""
    while number := os.read(waiting, 1):
        yield number[0], calls[number[0]]()


def _send(sending: Connection, calls: Sequence[Callable[[], object]], waiting: int) -> None:
    """Send the results of the calls that the other process does not take; nothing if one fails."""
    with suppress(BaseException):  # the other process says why it ends
        torch.set_num_threads(1)  # a copy has none of the threads that its libraries count on
        sending.send_bytes(pickle.dumps(dict(_taken(calls, waiting))))
