"""Every effect of the catalogue obeys the contract."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from contactlearn.effects import Effect, EffectId, catalogue
from contactlearn.errors import ContactLearnError
from contactlearn.laws import find
from contactlearn.testing import EffectContract

EXAMPLES = Path(__file__).parent.parent / "examples"

KINDS = [kind for forms in catalogue().values() for kind in forms]


@pytest.mark.parametrize("law", ["wang_mason", "mirtich"])
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: f"{kind.name}-{kind.form or ''}")
class TestCatalogue(EffectContract):
    @pytest.fixture(autouse=True)
    def _chosen(self, kind, law):
        self.effect, self.law = kind(), find(law)


def test_the_example_can_inherit_the_contract(tmp_path):
    """In a process of its own, for an effect that has been imported once is in the catalogue."""
    lines = (
        "from cable_torque import CableTorque",
        "from contactlearn.testing import EffectContract",
        "class TestCableTorque(EffectContract):",
        "    effect = CableTorque()",
    )
    (tmp_path / "test_cable_torque.py").write_text("\n".join(lines) + "\n")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(tmp_path)]
    done = subprocess.run(command, cwd=EXAMPLES, env=os.environ | {"PYTHONPATH": "."}, capture_output=True, text=True)
    assert "7 passed" in done.stdout, done.stdout + done.stderr


def test_an_effect_acts_at_one_place():
    with pytest.raises(TypeError, match="must override one of state, law, wrench, velocity, not none"):
        type("Nowhere", (Effect,), {})
    both = {"law": Effect.law, "wrench": Effect.wrench}
    with pytest.raises(TypeError, match="not \\['law', 'wrench'\\]"):
        type("Everywhere", (Effect,), both)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: str(kind.id))
def test_what_breaks_the_symmetry_does(kind):
    """No effect says so without need."""
    contract = EffectContract()
    contract.effect = kind()
    claim, kind.mirror_symmetric = kind.mirror_symmetric, True
    try:
        if claim:
            contract.test_it_mirrors_as_it_says()
        else:
            with pytest.raises(AssertionError, match="mirror image differs"):
                contract.test_it_mirrors_as_it_says()
    finally:
        kind.mirror_symmetric = claim


def test_an_identity_is_its_name_and_form():
    texts = ["spin_damping", "spin_damping:after", "spin_damping:during", "surface_tilt"]
    ids = [EffectId("surface_tilt"), *(EffectId("spin_damping", form) for form in ("during", None, "after"))]
    assert [str(each) for each in sorted(ids)] == texts
    assert {EffectId.parse(text) for text in texts} == set(ids)


@pytest.mark.parametrize("text", ["", ":during", "spin_damping:", "a:b:c"])
def test_text_that_is_no_identity_is_refused(text):
    with pytest.raises(ContactLearnError, match="without a colon"):
        EffectId.parse(text)
