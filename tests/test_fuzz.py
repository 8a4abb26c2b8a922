"""What fuzzing found stays found: every reader has documented errors and no others, in bounded time and memory.

benchmarks/fuzz/run.py looks for more, guided by coverage; tests/corpus keeps small inputs of its runs.
"""

import logging
import sys
import warnings
from importlib import import_module
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parent.parent / "benchmarks"))

from fuzz.run import TARGETS
from fuzz.target import Target, judged, replayed

PARQUET = 1

FOUND = {
    "a column's name that is no UTF-8": ("tables", lambda seed: seed[PARQUET].replace(b"mass", b"ma\xffs")),
    "a formula without its parameter": ("formulas", lambda _: b"Pt=g*pi\nPn=k\nk:-1,1,0,0"),
    "text in place of states": ("mat", lambda _: b"\x01\x05\x01\x0c\x00|p|p|p"),
    "quaternions of zeros": ("recordings",
        lambda _: b"\x40time,x,y,z,qw,qx,qy,qz\n" + b"".join(b"%d,0,1,0,0,0,0,0\n" % k for k in range(20))),
    "coordinates whose squares overflow": ("recordings",
        lambda _: b"\x40time,x,y,theta\n" + b"".join(b"%d,1e300,-1e300,1e300\n" % k for k in range(20))),
    "a number in place of a part": ("overrides", lambda _: b"evaluate\ntrain=00\nmodel=[x1_wrench]"),
    "a choice of nothing": ("overrides", lambda _: b"diagnose\ndata=table\ndata.path=a.csv\nlaw=null"),
    "a list under the name of a package": ("overrides", lambda _: b"evaluate\n+effect@mine.parameters.c=[-1,1]"),
    "a null in place of a part": ("overrides", lambda _: b"evaluate\nfit=null"),
    "a text in place of Hydra's part": ("overrides", lambda _: b"evaluate\n++hydra="),
    "a number in place of effects": ("overrides", lambda _: b"evaluate\n++candidate=3\n++limits=[1]"),
}  # fmt: skip


@pytest.fixture(autouse=True)
def quiet():
    """Libraries may warn of broken files."""
    logging.disable()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield
    logging.disable(logging.NOTSET)


def target(name: str) -> Target:
    return import_module(f"fuzz.{name}").TARGET


@pytest.mark.parametrize("name", TARGETS)
def test_seeds_and_corpus(name):
    one, kept = target(name), replayed(name)
    assert kept
    assert [wrong for content in (*one.seeds(), *kept) if (wrong := judged(one, content))] == []


@pytest.mark.parametrize(("name", "content"), FOUND.values(), ids=FOUND)
def test_what_was_found(name, content):
    one = target(name)
    assert judged(one, content(one.seeds())) is None


def test_the_judge_sees_faults(monkeypatch):
    def undocumented(content: bytes) -> None:
        content.decode()

    assert judged(Target(undocumented, list), b"\xff").startswith("UnicodeDecodeError: test_fuzz.py")
    assert judged(Target(undocumented, list), b"x") is None
    for limit, wrong in (("SECONDS", "slow"), ("MEGABYTES", "memory")):
        with monkeypatch.context() as patched:
            patched.setattr(f"fuzz.target.{limit}", -1)
            assert judged(Target(undocumented, list), b"x").startswith(wrong)
