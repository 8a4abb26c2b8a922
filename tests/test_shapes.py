"""Shapes of tensors are those of the annotations: the check itself, and commands that run under it."""

from pathlib import Path

import pytest
import shapecheck
from commands import run_alone

TESTS = Path(__file__).parent
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
from contactlearn.mechanics import rigid_body
from jaxtyping import TypeCheckError
for arguments in {}:
    try:
        rigid_body.rotate(*eval(arguments))
        print(True)
    except TypeCheckError:
        print(False)
from commands import run  # from here on the package is imported
print(run(*{}))
"""
COMMAND = (
    "evaluate.py", "data.size=40", "train.size=10", "train.repetitions=1", "figures.repetitions=1", "bootstrap=50",
    "laws=[drumwright_shell]", "effect=[side_drag]", "tables=csv", "model=[x1_wrench,parameters_likelihood]",
    "curves.sizes=[8]", "curves.seeds=2", "workers=1",
)  # fmt: skip


@pytest.mark.nightly
def test_a_wrong_shape_is_found_and_commands_have_none(tmp_path):
    words = (*COMMAND, f"hydra.run.dir={tmp_path / 'evaluate'}")
    printed = run_alone("-c", CALLS.format([arguments for arguments, _ in CASES.values()], words), cwd=TESTS)
    found = printed.split()[: len(CASES)]
    assert dict(zip(CASES, found, strict=True)) == {name: str(right) for name, (_, right) in CASES.items()}
    assert str(tmp_path / "evaluate") in printed


def test_other_annotations_are_left_alone():
    def half(size: int) -> float:
        return size / 2

    assert shapecheck.arrays(half) is half
