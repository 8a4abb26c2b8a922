"""Shapes of tensors are those of the annotations: the check itself, and commands that run under it."""

from pathlib import Path

import pytest
import shapecheck
from commands import SMALL, run_alone

CASES = {
    "right": ("torch.zeros(4, 2), torch.zeros(4)", True),
    "leading axes": ("torch.zeros(7, 4, 2), torch.zeros(4)", True),
    "wrong width": ("torch.zeros(4, 3), torch.zeros(4)", False),
    "wrong length": ("torch.zeros(4, 2), torch.zeros(5)", False),
    "wrong kind": ("torch.zeros(4, 2).long(), torch.zeros(4)", False),
}
CALLS = """
import shapecheck, torch
shapecheck.install()
from contactlearn import mechanics
from jaxtyping import TypeCheckError
for arguments in {}:
    try:
        mechanics.rotate(*eval(arguments))
        print(True)
    except TypeCheckError:
        print(False)
"""
COMMANDS = {
    "evaluate": (
        *("evaluate.py", *SMALL[:5], "laws=[wang_mason,drumwright_shell]", "effect=[side_drag]", "tables=csv"),
        *("model=[x1_wrench,parameters_likelihood]", "curves.sizes=[10]", "curves.seeds=2", "workers=1"),
    ),
    "diagnose": ("diagnose.py", "data.size=40", "law=wang_mason", "seconds=1"),
}


def test_a_wrong_shape_is_found():
    calls = CALLS.format([arguments for arguments, _ in CASES.values()])
    found = run_alone("-c", calls, cwd=Path(__file__).parent).split()
    assert dict(zip(CASES, found, strict=True)) == {name: str(right) for name, (_, right) in CASES.items()}


def test_other_annotations_are_left_alone():
    def half(size: int) -> float:
        return size / 2

    assert shapecheck.arrays(half) is half


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A folder of runs by the names of their commands, and what these printed, in one process: it is slow to begin."""
    folder = tmp_path_factory.mktemp("runs")
    words = [word for name, command in COMMANDS.items() for word in ("--", *command, f"hydra.run.dir={folder / name}")]
    return folder, run_alone("tests/shapecheck.py", *words)


@pytest.mark.parametrize("name", COMMANDS)
def test_commands_keep_to_the_shapes(name, runs):
    folder, printed = runs
    assert str(folder / name) in printed
