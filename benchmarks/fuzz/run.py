"""Fuzz a target with atheris (libFuzzer), guided by the branches that inputs reach.

    python benchmarks/fuzz/run.py tables --cases 100000 [--seconds 600] [--keep FOLDER]
    python benchmarks/fuzz/run.py tables --collect

Needs the extra `fuzz`.  What is wrong is written to FOLDER/TARGET/wrong, one input for each fault, and the run goes on;
inputs that reach new branches are kept in FOLDER/TARGET/inputs, with which the next run begins.  Lines say how many
cases were tried.  --collect runs nothing: it puts the smallest of the kept inputs into tests/corpus, which the tests
replay.
"""

import argparse
import base64
import hashlib
import re
import sys
import time
from importlib import import_module
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from fuzz.target import CORPUS, replayed

TARGETS = ("tables", "dialects", "mat", "recordings", "formulas", "overrides", "checkpoints")
MEMORY, HANGS, LENGTH = 3000, 60, 8192
"""MB and seconds at which a run is given up, with the input that did it; bytes of an input."""
COLLECTED, LONGEST = 60, 1024
"""Inputs of a target in tests/corpus, and bytes of each, at most."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("target", choices=TARGETS)
    parser.add_argument("--cases", type=int, default=100_000)
    parser.add_argument("--seconds", type=int, default=0, help="at most; 0: no limit")
    parser.add_argument("--keep", type=Path, default=Path("outputs/fuzz"))
    parser.add_argument("--collect", action="store_true")
    options = parser.parse_args()
    folder = options.keep / options.target
    if options.collect:
        collect(options.target, folder)
    else:
        fuzz(options.target, options.cases, options.seconds, folder)


def collect(name: str, folder: Path) -> None:
    """Put the smallest inputs of a folder into tests/corpus."""
    known = sorted({path.read_bytes() for path in (folder / "inputs").iterdir()}, key=len)
    step = max(1, len(known) // COLLECTED)  # of every length
    lines = [base64.b64encode(content).decode() for content in known[::step][:COLLECTED] if len(content) <= LONGEST]
    CORPUS.mkdir(parents=True, exist_ok=True)
    (CORPUS / f"{name}.txt").write_text("".join(f"{line}\n" for line in lines), encoding="ascii")


def fuzz(name: str, cases: int, seconds: int, folder: Path) -> None:
    """Run atheris on a target; it ends the process itself."""
    import atheris

    watched = ["contactlearn", *import_module(f"fuzz.{name}").TARGET.watched]  # once without counters, to know them
    for loaded in [one for one in sys.modules if one.split(".")[0] == "contactlearn" or one.startswith("fuzz.")]:
        del sys.modules[loaded]
    with atheris.instrument_imports(include=watched):
        target = import_module(f"fuzz.{name}").TARGET
        judged = import_module("fuzz.target").judged
        known = [*target.seeds(), *replayed(name)]
        for content in known:  # so that modules that are imported late are counted too
            judged(target, content)
    for part in ("inputs", "wrong"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    for content in known:
        (folder / "inputs" / hashlib.sha1(content).hexdigest()).write_bytes(content)
    words = folder / "words"
    words.write_text("".join(f'"{_escaped(word)}"\n' for word in target.words), encoding="ascii")
    found: dict[str, int] = {}
    tried, start = 0, time.monotonic()

    def one(content: bytes) -> None:
        nonlocal tried
        tried += 1
        wrong = judged(target, content)
        if wrong is not None:
            if wrong not in found:
                place = folder / "wrong" / hashlib.sha1(wrong.encode()).hexdigest()[:12]
                place.write_bytes(content)
                print(f"{name}: {wrong} ({place})", flush=True)
            found[wrong] = found.get(wrong, 0) + 1
        if tried % 10_000 == 0 or tried == cases:
            print(
                f"{name}: {tried} cases in {time.monotonic() - start:.0f} s, {len(found)} faults: {found}", flush=True
            )

    limits = [f"-runs={cases}", f"-max_len={LENGTH}", f"-rss_limit_mb={MEMORY}", f"-timeout={HANGS}"]
    limits += [f"-max_total_time={seconds}"] if seconds else []
    places = [f"-dict={words}", f"-artifact_prefix={folder}/wrong/", str(folder / "inputs")]
    atheris.Setup([sys.argv[0], *limits, "-print_final_stats=1", "-verbosity=0", *places], one)
    atheris.Fuzz()


def _escaped(word: str) -> str:
    """A word as a dictionary of libFuzzer has it."""
    return re.sub(r"[^ !#-\[\]-~]", lambda c: "".join(f"\\x{b:02x}" for b in c[0].encode()), word)


if __name__ == "__main__":
    main()
