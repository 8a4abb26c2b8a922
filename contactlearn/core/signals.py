"""Signals and streams: one line after Ctrl-C or SIGTERM, silence when the output pipe is closed, text on any stream."""

import os
import select
import signal
import sys
import threading
from collections.abc import Generator
from contextlib import contextmanager
from io import TextIOWrapper
from types import FrameType
from typing import NoReturn

_STOPS = (signal.SIGINT, signal.SIGTERM)
_LAST_STREAM = 2  # the number of the standard error


class _Terminated(KeyboardInterrupt):
    """SIGTERM: it stops a command as Ctrl-C does, so that its workers end and its locks are freed."""


@contextmanager
def graceful_exit() -> Generator[None]:
    """End with one line and the status of a shell for Ctrl-C and SIGTERM, and silently for a closed `| head`.

    The line has the last note of the interruption, by which a command says what it leaves.  See `prepare_process` for
    what else a command needs.

    The default for a closed pipe, death by SIGPIPE, would also kill a parent that writes to a dead worker.

    Raises:
        SystemExit: 130 after Ctrl-C, 143 after SIGTERM, 141 where nobody reads the output any more.
    """
    prepare_process()
    alone = threading.current_thread() is threading.main_thread()  # the only one that may set what a signal does
    before = signal.signal(signal.SIGTERM, _terminate) if alone else None
    try:
        try:
            yield
        finally:
            sys.stdout.flush()
    except KeyboardInterrupt as stop:
        print("; ".join(("stopped", *getattr(stop, "__notes__", [])[-1:])), file=sys.stderr)
        sys.exit(128 + (signal.SIGTERM if isinstance(stop, _Terminated) else signal.SIGINT))
    except BrokenPipeError:
        if not _unread():
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # the rest is flushed at exit
        sys.exit(128 + signal.SIGPIPE)
    finally:
        if alone:
            signal.signal(signal.SIGTERM, before)


def write_output(text: str) -> None:
    """Write to the standard output at once.

    Raises:
        SystemExit: 2 with a line where it cannot be written, as on a full disk.
        BrokenPipeError: nobody reads it any more.
    """
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        print(f"error: the output cannot be written: {error.strerror}", file=sys.stderr)
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # the rest is flushed at exit
        sys.exit(2)


def prepare_process() -> None:
    """Make this process fit for a command: streams that take any text, and no window for figures.

    A closed stream (`>&-`) is the null device from here on.  A character that the encoding of a stream lacks, such as
    μ in Latin-1, is a question mark.
    """
    os.environ["MPLBACKEND"] = "agg"  # Jupyter names a backend that need not be installed beside this package
    # The next file would take the number of a closed stream, and get what libraries write to that stream.
    while (null := os.open(os.devnull, os.O_RDWR)) <= _LAST_STREAM:
        pass
    os.close(null)
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None or stream.closed:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115 - until the process ends
        elif isinstance(stream, TextIOWrapper):  # a notebook's, or a test's, takes any text
            stream.reconfigure(errors="replace")


@contextmanager
def defer_interrupts() -> Generator[None]:
    """Let Ctrl-C and SIGTERM wait for the end of a step that would answer them with another error.

    What OmegaConf tidies up fails where it is interrupted, and that error takes the place of the interruption.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came = list[int]()
    before = {number: signal.signal(number, lambda number, _: came.append(number)) for number in _STOPS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for number in came:
            signal.raise_signal(number)


def _terminate(number: int, frame: FrameType | None) -> NoReturn:
    raise _Terminated


def _unread() -> bool:
    """Whether the standard output is a pipe that nobody reads."""
    ends = select.poll()
    ends.register(sys.stdout, 0)
    return any(event & select.POLLERR for _, event in ends.poll(0))


def is_interruption(error: BaseException | None) -> bool:
    """Whether an error came in place of Ctrl-C or SIGTERM."""
    return error is not None and (isinstance(error, KeyboardInterrupt) or is_interruption(error.__context__))
