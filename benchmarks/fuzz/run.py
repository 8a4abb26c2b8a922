"""Fuzz a target with atheris (libFuzzer), guided by the branches that inputs reach.

    python benchmarks/fuzz/run.py tables --cases 100000 [--seconds 600] [--keep FOLDER]

Needs the extra `fuzz`.  What is wrong is written to FOLDER/TARGET/wrong, one input for each fault, and the run goes on;
inputs that reach new branches are kept in FOLDER/TARGET, with which the next run begins.  One line at the end says
how many cases were tried.  --minimise copies the fewest inputs that reach what all of them reach to tests/corpus.
"""

import argparse
import hashlib
import re
import sys
import time
from importlib import import_module
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

CORPUS = Path(__file__).resolve().parents[2] / "tests" / "corpus"
TARGETS = ("tables", "mat", "recordings", "formulas", "overrides", "checkpoints")
MEMORY, HANGS, LENGTH = 3000, 60, 8192
"""MB and seconds at which a run is given up, with the input that did it; bytes of an input."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("target", choices=TARGETS)
    parser.add_argument("--cases", type=int, default=100_000)
    parser.add_argument("--seconds", type=int, default=0, help="at most; 0: no limit")
    parser.add_argument("--keep", type=Path, default=Path("outputs/fuzz"))
    parser.add_argument("--minimise", action="store_true")
    options = parser.parse_args()
    fuzz(options.target, options.cases, options.seconds, options.keep / options.target, minimise=options.minimise)


def fuzz(name: str, cases: int, seconds: int, folder: Path, *, minimise: bool) -> None:
    """Run atheris on a target; it ends the process itself."""
    import atheris

    module = import_module(f"fuzz.{name}")  # once without counters, so that what it watches is known
    watched = ["contactlearn", *module.TARGET.watched]
    for loaded in [one for one in sys.modules if one.split(".")[0] == "contactlearn" or one.startswith("fuzz.")]:
        del sys.modules[loaded]
    with atheris.instrument_imports(include=watched):
        target = import_module(f"fuzz.{name}").TARGET
        judged = import_module("fuzz.target").judged
        for content in target.seeds():  # so that modules that are imported late are counted too
            judged(target, content)
    for part in ("inputs", "wrong"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    for content in target.seeds():
        (folder / "inputs" / hashlib.sha1(content).hexdigest()).write_bytes(content)
    words = folder / "words"
    words.write_text("".join(f'"{_escaped(word)}"\n' for word in target.words), encoding="ascii")
    found: dict[str, int] = {}
    tried, start = 0, time.monotonic()

    def one(content: bytes) -> None:
        nonlocal tried
        tried += 1
        if (wrong := judged(target, content)) is not None:
            if wrong not in found:
                place = folder / "wrong" / f"{hashlib.sha1(wrong.encode()).hexdigest()[:12]}"
                place.write_bytes(content)
                print(f"{name}: {wrong} ({place})", flush=True)
            found[wrong] = found.get(wrong, 0) + 1
        if tried == cases or (seconds and time.monotonic() - start > seconds):
            print(
                f"{name}: {tried} cases in {time.monotonic() - start:.0f} s, {len(found)} faults: {found}", flush=True
            )

    limits = [f"-runs={cases}", f"-max_len={LENGTH}", f"-rss_limit_mb={MEMORY}", f"-timeout={HANGS}"]
    limits += [f"-max_total_time={seconds}"] if seconds else []
    places = [f"-dict={words}", f"-artifact_prefix={folder}/wrong/"]
    corpora = [str(CORPUS / name), str(folder / "inputs")] if minimise else [str(folder / "inputs")]
    if minimise:
        (CORPUS / name).mkdir(parents=True, exist_ok=True)
        limits = ["-merge=1", f"-max_len={LENGTH}"]
    atheris.Setup([sys.argv[0], *limits, *places, "-print_final_stats=1", "-verbosity=0", *corpora], one)
    atheris.Fuzz()


def _escaped(word: str) -> str:
    """A word as a dictionary of libFuzzer has it."""
    return re.sub(r"[^ !#-\[\]-~]", lambda c: "".join(f"\\x{b:02x}" for b in c[0].encode()), word)


if __name__ == "__main__":
    main()
