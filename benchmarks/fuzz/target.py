"""A target: bytes to what a reader makes of them, and the judge of what came out.

Allowed are the errors of `contactlearn.core.errors` with a message of one line that is not longer than a screen, and no
more time and memory than a small input can be worth.
"""

import base64
import resource
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from contactlearn.core.errors import ContactLearnError

CORPUS = Path(__file__).resolve().parents[2] / "tests" / "corpus"
SECONDS, MEGABYTES, WORDS = 2.0, 256, 4000
"""That one input may take: processor time, growth of the process, characters of its message."""


@dataclass(frozen=True)
class Target:
    """What is fuzzed: a function, inputs to begin with, words worth knowing, and modules whose branches are counted."""

    read: Callable[[bytes], None]
    seeds: Callable[[], Sequence[bytes]]
    words: Sequence[str] = ()
    watched: Sequence[str] = ()


def replayed(name: str) -> list[bytes]:
    """The inputs of a target that the tests replay."""
    path = CORPUS / f"{name}.txt"
    return [base64.b64decode(line) for line in path.read_text("ascii").split("\n")[:-1]] if path.exists() else []


@contextmanager
def file(content: bytes, suffix: str) -> Iterator[Path]:
    """A file with this content, in memory where the system has a place for that."""
    root = "/dev/shm" if Path("/dev/shm").is_dir() else None
    with tempfile.TemporaryDirectory(prefix="fuzz-", dir=root) as folder:
        path = Path(folder, f"input{suffix}")
        path.write_bytes(content)
        yield path


def judged(target: Target, content: bytes) -> str | None:
    """What is wrong with what came of an input, as a name that stays the same for the same fault; None if nothing."""
    before, start = _grown(), time.process_time()
    try:
        target.read(content)
    except ContactLearnError as error:
        if len(str(error)) > WORDS:
            return f"a message of {len(str(error))} characters: {_place(error)}"
    except Exception as error:
        return f"{type(error).__name__}: {_place(error)}"
    if (took := time.process_time() - start) > SECONDS:
        return f"slow: {took:.0f} s"
    if (grown := _grown() - before) > MEGABYTES:
        return f"memory: {grown >> 6 << 6} MB"
    return None


def _grown() -> int:
    """The most memory that the process has had, MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10


def _place(error: BaseException) -> str:
    """Where an error comes from: the last place in this program, and the last of all."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = [frame for frame in frames if "/contactlearn/" in frame.filename]
    shown = [*ours[-1:], frames[-1]]
    return " ".join(dict.fromkeys(f"{Path(frame.filename).name}:{frame.lineno}" for frame in shown))
