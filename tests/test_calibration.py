"""The calibrated confidence rises with what speaks for a name and falls with what speaks against it."""

import math

import pytest

from contactlearn.diagnosis.search.ladder import calibrated

SURE = {"share": 0.99, "gain": 0.3, "left": 0.0, "unknown": False, "others": 0}


def test_it_is_a_probability():
    for share in (0.0, 0.5, 1.0):
        for gain in (-0.1, 0.0, 1.0):
            for left in (-0.2, 0.9):
                for others in (0, 5):
                    assert 0 < calibrated(share, gain, left, others > 0, others) < 1
    assert calibrated(**SURE) > 0.85
    assert calibrated(share=0.4, gain=0.03, left=0.3, unknown=True, others=2) < 0.5
    assert not math.isclose(calibrated(**SURE), 1.0, abs_tol=1e-3)  # nothing that was fitted is that sure


@pytest.mark.parametrize(("name", "less", "more"), [
    ("share", 0.4, 0.99), ("gain", 0.02, 0.5), ("left", 0.4, 0.0), ("unknown", True, False), ("others", 3, 0),
])  # fmt: skip
def test_more_evidence_never_means_less_confidence(name, less, more):
    assert calibrated(**(SURE | {name: less})) <= calibrated(**(SURE | {name: more}))
