"""Processes that work side by side and end with this one, silently, however it ends."""

import io
import os
import pickle
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager, suppress
from functools import partial
from itertools import islice
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Any, ParamSpec, TypeVar

import numpy as np
import torch
from threadpoolctl import threadpool_limits
from torch import Tensor

_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")
_Item = TypeVar("_Item")


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


# --- A second core -------------------------------------------------------------------------------------


@contextmanager
def second_core() -> Generator[None]:
    """Let a copy of this process share the calls of `side_by_side` within this context, if a second core is idle.

    A worker has one core, and so has a context in another.  A process with threads at work or a GPU cannot be copied
    safely, nor can one on another system than Linux.
    """
    global _copy
    if _copy is not None or not _can_be_copied():
        yield
        return
    _copy = _Copy()
    try:
        yield
    finally:
        _copy.close()
        _copy = None


def side_by_side(calls: Sequence[Callable[[], _Result]]) -> list[_Result]:
    """Return the results of independent calls, which a `second_core` shares with this one.

    The copy and this process take calls in turn; what the calls change in the copy is lost.  The results do not depend
    on the cores, for a call that the copy does not answer is made here.  Calls within calls have no core to share.

    Args:
        calls: at most 256 of some milliseconds each at least.  Those that cannot be pickled are made here.
    """
    copy = _copy
    if copy is None or not 2 <= len(calls) <= 256 or not copy.idle.acquire(blocking=False):
        return [call() for call in calls]
    try:
        done = copy.share(calls)
    finally:
        copy.idle.release()
    return [done[k] if k in done else call() for k, call in enumerate(calls)]


def one_by_one(work: Callable[[_Item], _Result], items: Iterable[_Item]) -> Iterator[_Result]:
    """Yield what `work` makes of each item, in order; a second core shares a few at a time, if one is idle."""
    rest = iter(items)
    with second_core():
        while some := [*islice(rest, _TOGETHER)]:
            yield from side_by_side([partial(work, item) for item in some])


_TOGETHER = 12  # items that are in memory at once
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


class _Copy:
    """A copy of this process that shares calls with it, until one fails in either."""

    def __init__(self) -> None:
        self.idle = threading.Lock()
        self._waiting, self._queue = os.pipe()  # of the numbers of calls that nobody has taken
        os.set_blocking(self._waiting, False)
        context = get_context("fork")
        self._there, there = context.Pipe()
        self._process = context.Process(target=self._serve, args=(there,), daemon=True)
        with without_interrupts(), warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # of threads, which are those of idle libraries
            self._process.start()
        there.close()

    def close(self) -> None:
        """End the copy, and close the pipes."""
        self._end()
        self._there.close()
        os.close(self._waiting)
        os.close(self._queue)

    def share(self, calls: Sequence[Callable[[], _Result]]) -> dict[int, _Result]:
        """Make calls in turn with the copy; return the results, by the numbers of the calls, that there are."""
        if not self._process.is_alive():
            return {}
        try:
            sent = _pickled(calls)
        except Exception:  # whatever an object of the caller may raise
            return {}
        try:
            os.write(self._queue, bytes(range(len(calls))))
            with suppress(OSError):
                self._there.send_bytes(sent)
            done = dict(self._taken(calls))
            with suppress(EOFError, OSError):
                if self._there.poll(_PATIENCE):
                    return done | pickle.loads(self._there.recv_bytes())
        except BaseException:
            self._end()
            raise
        self._end()
        return done

    def _end(self) -> None:
        self._process.kill()
        self._process.join()

    def _taken(self, calls: Sequence[Callable[[], _Result]]) -> Iterator[tuple[int, _Result]]:
        """The calls that the other process does not take, by their numbers, with their results."""
        with suppress(BlockingIOError):
            while number := os.read(self._waiting, 1):
                yield number[0], calls[number[0]]()

    def _serve(self, here: Connection) -> None:
        """Answer calls until the other process closes the pipe; nothing more once a call fails."""
        with suppress(BaseException):  # the other process says why it fails
            self._there.close()
            torch.set_num_threads(1)  # a copy has none of the threads that its libraries count on
            while True:
                here.send_bytes(_pickled(dict(self._taken(pickle.loads(here.recv_bytes())))))


class _Pickler(pickle.Pickler):
    """Pickler of tensors as arrays, for a tenth of the time."""

    def reducer_override(self, obj: Any) -> Any:
        """Reduce a tensor, with its place in memory, on which the last digits of sums depend."""
        if type(obj) is not Tensor or obj.requires_grad or not obj.numel():
            return NotImplemented
        size, stride = obj.size(), obj.stride()
        last = sum((n - 1) * step for n, step in zip(size, stride, strict=True))
        return _tensor, (obj.as_strided((last + 1,), (1,)).numpy(), size, stride)


def _tensor(array: np.ndarray, size: Sequence[int], stride: Sequence[int]) -> Tensor:
    return torch.from_numpy(array).as_strided(size, stride)


def _pickled(calls: object) -> bytes:
    with io.BytesIO() as file:
        _Pickler(file, pickle.HIGHEST_PROTOCOL).dump(calls)
        return file.getvalue()


_copy: _Copy | None = None
