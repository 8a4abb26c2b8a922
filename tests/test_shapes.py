"""Shapes of tensors are those of the annotations: the check itself, which tests of commands run under."""

import subprocess
import sys
from pathlib import Path

import pytest
import shapecheck

ROOT = Path(__file__).parent.parent
CALL = "import shapecheck, torch; shapecheck.install(); from contactlearn import mechanics; mechanics.rotate(*{})"


@pytest.mark.parametrize(
    ("arguments", "found"),
    {
        "right": ("(torch.zeros(4, 2), torch.zeros(4))", False),
        "leading axes": ("(torch.zeros(7, 4, 2), torch.zeros(4))", False),
        "wrong width": ("(torch.zeros(4, 3), torch.zeros(4))", True),
        "wrong length": ("(torch.zeros(4, 2), torch.zeros(5))", True),
        "wrong kind": ("(torch.zeros(4, 2).long(), torch.zeros(4))", True),
    }.values(),
)
def test_a_wrong_shape_is_found(arguments, found):
    done = subprocess.run(
        [sys.executable, "-c", CALL.format(arguments)], cwd=ROOT / "tests", capture_output=True, text=True, timeout=120
    )
    assert ("TypeCheckError" in done.stderr) == found, done.stderr
    assert bool(done.returncode) == found


def test_other_annotations_are_left_alone():
    def half(size: int) -> float:
        return size / 2

    assert shapecheck.arrays(half) is half
