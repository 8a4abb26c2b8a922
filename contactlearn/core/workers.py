"""Processes that work side by side and end with this one, silently, however it ends."""

import os
import signal
import threading
from collections.abc import Callable, Generator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager, suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from types import TracebackType
from typing import ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")


class WorkerPool(ProcessPoolExecutor):
    """New processes of one thread each, as a context manager; an exception in it ends them at once.

    A fork would copy the locks of threads, but not the threads.  Each worker reads a pipe that only this process can
    close, and ends when it is closed: by an exception, or because this process has exited.
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
    import torch  # takes two seconds to load; a process that only waits for its workers need not have it

    torch.set_num_threads(1)
    threadpool_limits(1)
    threading.Thread(target=_end_with, args=(watched,), daemon=True).start()


def _end_with(watched: Connection) -> None:
    """End this process when its parent closes the pipe, or has exited."""
    with suppress(EOFError, OSError):
        watched.recv()
    os._exit(1)
