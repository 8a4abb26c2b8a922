"""Signals and streams: one line after Ctrl-C or SIGTERM, silence when the output pipe is closed, text on any stream."""

import codecs
import os
import select
import signal
import sys
import threading
import unicodedata
from collections.abc import Generator
from contextlib import contextmanager
from io import TextIOWrapper
from types import FrameType
from typing import NoReturn

_STOPPED = "stopped; the same command resumes learning curves and large diagnoses, with hydra.sweep.dir=FOLDER a sweep"

_STOPS = (signal.SIGINT, signal.SIGTERM)
_SPELT = {
    "−": "-", "–": "-", "±": "+-", "×": "x", "·": "*", "⁄": "/", "→": "->", "←": "<-", "≥": ">=", "≤": "<=", "≈": "~",
    "√": "sqrt", "°": " deg", "‖": "|", "∞": "inf", "∂": "d", "✓": "yes",
}  # fmt: skip


class _Terminated(KeyboardInterrupt):
    """SIGTERM: it stops a command as Ctrl-C does, so that its workers end and its locks are freed."""


@contextmanager
def graceful_exit() -> Generator[None]:
    """End with one line and the status of a shell for Ctrl-C and SIGTERM, and silently for a closed `| head`.

    Streams take any text: see `spell_unencodable`.

    The default for a closed pipe, death by SIGPIPE, would also kill a parent that writes to a dead worker.

    Raises:
        SystemExit: 130 after Ctrl-C, 143 after SIGTERM, 141 where nobody reads the output any more.
    """
    spell_unencodable()
    alone = threading.current_thread() is threading.main_thread()  # the only one that may set what a signal does
    before = signal.signal(signal.SIGTERM, _terminate) if alone else None
    try:
        try:
            yield
        finally:
            sys.stdout.flush()
    except KeyboardInterrupt as stop:
        print(_STOPPED, file=sys.stderr)
        sys.exit(128 + (signal.SIGTERM if isinstance(stop, _Terminated) else signal.SIGINT))
    except BrokenPipeError:
        if not _unread():
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # the rest is flushed at exit
        sys.exit(128 + signal.SIGPIPE)
    finally:
        if alone:
            signal.signal(signal.SIGTERM, before)


def spell_unencodable() -> None:
    """Let the standard streams spell in ASCII what their encoding lacks, such as mu for μ, instead of raising.

    A pipe on Windows, and the C locale, have other encodings than UTF-8.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # a notebook's, or a test's, takes any text
            stream.reconfigure(errors="spelt")


def spelt(text: str) -> str:
    """Return text as the standard output has it, for what must know its width."""
    encoding = getattr(sys.stdout, "encoding", None) or "utf-8"
    return text.encode(encoding, "spelt").decode(encoding)


def _spelt(error: UnicodeError) -> tuple[str, int]:
    assert isinstance(error, UnicodeEncodeError)
    return "".join(map(_ascii, error.object[error.start : error.end])), error.end


codecs.register_error("spelt", _spelt)


def _ascii(character: str) -> str:
    """A character in ASCII: its parts without accents, the name of a Greek letter, else "?"."""
    spelt = ""
    for part in unicodedata.normalize("NFKD", character):
        kind, _, letter = unicodedata.name(part, "").partition(" LETTER ")
        if kind.startswith("GREEK"):
            spelt += letter.title() if "CAPITAL" in kind else letter.lower()
        else:
            spelt += part if part.isascii() else _SPELT.get(part, "")
    return spelt or "?"


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
