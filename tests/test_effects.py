"""Every effect of the catalogue obeys the contract."""

import gc
import inspect
from dataclasses import FrozenInstanceError, dataclass, field
from pathlib import Path

import pytest

from contactlearn.core.errors import ContactLearnError, UnknownNameError
from contactlearn.effects import Effect, EffectId, catalogue, find_effect, forms_of, from_settings, parameter
from contactlearn.effects.functions import APPROACH, SLIP
from contactlearn.effects.spin_damping import SpinDamping
from contactlearn.laws import find
from contactlearn.mechanics.shapes import Polygon
from contactlearn.mechanics.space import SPACE
from contactlearn.simulation import synthetic
from contactlearn.testing import EffectContract

EXAMPLES = Path(__file__).parent.parent / "examples"

KINDS = [kind for forms in catalogue().values() for kind in forms]
HEXAGON = Polygon(((0.04, 0.0), (0.02, 0.025), (-0.02, 0.025), (-0.04, 0.0), (-0.02, -0.025), (0.02, -0.025)))
SHAPES = {"corner_radius": HEXAGON}
"""Of the effects that an ellipse does not show."""
LAWS = ("wang_mason", "mirtich")  # both where an effect sees the impulse of the law; each for half of the others
CASES = [
    pytest.param(kind, law, id=f"{kind.name}-{kind.form or ''}-{law}")
    for k, kind in enumerate(KINDS)
    for law in (LAWS if kind.place == "wrench" else LAWS[k % 2 :][:1])
]


@pytest.mark.parametrize(("kind", "law"), CASES)
class TestCatalogue(EffectContract):
    @pytest.fixture(autouse=True)
    def _chosen(self, kind, law):
        self.effect, self.law, self.shape = kind(), find(law), SHAPES.get(kind.name)


def test_an_effect_acts_at_one_place():
    with pytest.raises(TypeError, match="must override one of state, law, wrench, velocity, not none"):
        type("Nowhere", (Effect,), {})
    both = {"law": Effect.law, "wrench": Effect.wrench}
    with pytest.raises(TypeError, match="not \\['law', 'wrench'\\]"):
        type("Everywhere", (Effect,), both)
    with pytest.raises(ContactLearnError, match="side_drag:linear: c must be a number, got 'a'"):
        find_effect("side_drag")("a")
    assert find_effect("gravity_impulse").form is None
    with pytest.raises(ContactLearnError, match="effect gravity_impulse has no forms to choose from, got 'late'"):
        find_effect("gravity_impulse", "late")


def test_a_shared_function_states_its_form_for_each_quantity():
    for name in ("location_dependent", "orientation_dependent", "incidence_dependent"):
        friction, restitution = (catalogue()[f"{name}_{coefficient}"] for coefficient in ("friction", "restitution"))
        assert [kind.form for kind in friction] == [kind.form for kind in restitution]
        for mu, eps in zip(friction, restitution, strict=True):
            assert mu.formula.startswith("μ ← μ + ")
            assert mu.formula.replace("μ", "ε") == eps.formula.replace("ε − a", "ε + a")  # of a soft spot
            assert mu.refines == tuple(family.replace("restitution", "friction") for family in eps.refines)
    assert find_effect("location_dependent_friction", "spot", SPACE).refines == ("location_dependent_friction",)
    assert find_effect("orientation_dependent_moment").in_words.startswith("around the body the arm changes by {a1}")
    assert not any("{quantity}" in kind.formula + kind.in_words for kind in KINDS)


@pytest.fixture
def forgotten():
    """Classes made in the test leave the registry with their last reference."""
    yield
    gc.collect()


def family():
    """A third party's family; its argument keeps it out of the catalogue."""

    @dataclass(frozen=True, eq=False)
    class Gust(Effect):
        """Air moves.  It is not a drag."""

        place = "velocity"
        strength: float

    return Gust


def form_of(parent, name, **own):
    """A form that adds c to every velocity."""
    body = {"form": name, "formula": "v⁺ ← v⁺ + c", "c": parameter("c", "m/s", -1.0, 1.0)} | own
    body |= {"__annotations__": {"c": float}, "velocity": lambda self, state, v_post: v_post + self.c}
    return dataclass(frozen=True, eq=False)(type(f"{name.title()}Gust", (parent,), body))


def test_families_are_abstract_and_forms_final():
    for forms in catalogue().values():
        for kind in forms:
            parents = [base for base in kind.__mro__[1:] if base is not Effect and issubclass(base, Effect)]
            assert (kind.form is None) == (parents == [])
            assert all(inspect.isabstract(base) and base.name == kind.name for base in parents)
            assert not inspect.isabstract(kind)
    with pytest.raises(TypeError, match="abstract"):
        SpinDamping()
    assert [kind.form for kind in catalogue()["spin_damping"]] == ["after", "quadratic", "during", "lasting"]


def test_a_family_of_ones_own_is_known_by_its_forms(forgotten):
    # A form of one's own comes after those that are declared with the family, and so is never the default.
    turbulent = dataclass(frozen=True, eq=False)(
        type("Turbulent", (SpinDamping,), {"form": "turbulent", "wrench": lambda self, state, wrench: wrench})
    )
    assert find_effect("spin_damping", "turbulent") is turbulent
    assert find_effect("spin_damping").form == "after"
    parent = family()
    steady, gusty = form_of(parent, "steady"), form_of(parent, "gusty")
    assert "gust" not in catalogue()
    assert (find_effect("gust"), find_effect("gust", "gusty")) == (steady, gusty)
    assert forms_of(parent) == (steady, gusty)
    made = from_settings(parent, {"form": "gusty", "strength": 2})
    assert (type(made), made.id, made.strength, made.options) == (gusty, EffectId("gust", "gusty"), 2, {"strength": 2})
    with pytest.raises(UnknownNameError, match="unknown form of gust 'gutsy', did you mean 'gusty'"):
        find_effect("gust", "gutsy")
    with pytest.raises(ContactLearnError, match="gust needs the setting strength"):
        from_settings(parent, {"form": "gusty"})
    with pytest.raises(ContactLearnError, match=r"gust has no setting 'c' \(it is fitted\); it has: form, strength"):
        from_settings(gusty, {"c": 1})
    form_of(parent, "steady")
    with pytest.raises(ContactLearnError, match="two forms of gust are called steady"):
        forms_of(parent)


@pytest.mark.parametrize("decorate", [lambda kind: kind, dataclass(frozen=True, eq=False)], ids=["bare", "decorated"])
def test_a_class_is_a_frozen_dataclass_with_its_decorator_or_without(decorate, forgotten):
    @decorate
    class Draught(Effect):
        """v⁺ ← v⁺ + c."""

        formula = "v⁺ ← v⁺ + c"
        c: float = parameter("c", "m/s", -1.0, 1.0)
        trials: int = field(default=3, kw_only=True)

        def velocity(self, state, v_post):
            return v_post + self.c

    made = Draught(0.5, trials=4)
    assert [(p.name, p.unit, p.high) for p in made.parameters] == [("c", "m/s", 1.0)]
    assert (made.options, made.at([0.25]).values[0].item(), Draught().trials) == ({"trials": 4}, 0.25, 3)
    for change in (lambda: setattr(made, "c", 1.0), lambda: delattr(made, "c")):
        with pytest.raises(FrozenInstanceError, match="field 'c'"):
            change()


def test_what_is_of_the_plane_alone_is_refused_in_space():
    contract = EffectContract()
    contract.effect = find_effect("torsional_friction")()
    tosses = contract.impacts()
    for kind in (kind for kind in KINDS if SPACE not in kind.spaces):
        with pytest.raises(ContactLearnError, match=f"effect {kind.id} exists for bodies that move in a plane alone"):
            kind().prepare(tosses)


def test_a_form_of_the_plane_names_those_of_space():
    contract = EffectContract()
    contract.effect = find_effect("torsional_friction")()
    with pytest.raises(ContactLearnError, match=r"in space; there it is .*:viscous_path or .*:stribeck_path or"):
        find_effect("velocity_dependent_friction")().prepare(contract.impacts())


def test_two_effects_of_one_name_are_refused(forgotten):
    twice = dataclass(frozen=True)(type("SideDrag", (Effect,), {"velocity": Effect.velocity}))
    with pytest.raises(ContactLearnError, match="two effects are called side_drag, in contactlearn"):
        catalogue()
    assert twice.__name__ == "SideDrag"  # a class that nothing holds may be collected before it is found


BROKEN = {
    "no family": ((Effect,), {"form": "late"}, "has a form and no family"),
    "of a final class": ((find_effect("gravity_impulse"),), {}, "must not subclass GravityImpulse, which is final"),
    "of a form": ((find_effect("spin_damping"),), {"form": "late"}, "SpinDampingAfter, which is final"),
    "no form": ((SpinDamping,), {}, "must name its form of spin_damping"),
    "no place": ((SpinDamping,), {"form": "late", "wrench": SpinDamping.wrench}, "must override wrench, as its family"),
}


@pytest.mark.parametrize(("bases", "body", "message"), BROKEN.values(), ids=BROKEN)
def test_what_is_neither_effect_nor_form_is_refused(forgotten, bases, body, message):
    with pytest.raises(TypeError, match=message):
        type("Broken", bases, {"wrench": Effect.wrench} | body)


def test_a_form_may_act_at_another_place_than_its_family(forgotten):
    kinds = [find_effect("velocity_dependent_friction", form) for form in ("viscous", "viscous_path")]
    assert [kind.place for kind in kinds] == ["law", "wrench"]
    assert kinds[1].law is None


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: str(kind.id))
def test_what_breaks_the_symmetry_does(kind):
    """No effect says so without need."""
    contract = EffectContract()
    contract.effect, contract.shape = kind(), SHAPES.get(kind.name)
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


@pytest.mark.parametrize("kind", [kind for kind in KINDS if "v_ref" in kind().options], ids=lambda kind: str(kind.id))
def test_the_equation_states_the_reference_speed(kind):
    """What ε or μ means hangs on it."""
    impacts = synthetic.load(size=20, seed=0)
    speed = impacts.v_c[:, [SLIP, APPROACH].index(kind.speed)].abs().median().item()
    assert kind().equation == kind.formula
    formula, _, expected = kind().prepare(impacts).equation.rpartition(" at v_ref = ")
    assert formula == kind.formula
    assert float(expected.removesuffix(" m/s")) == pytest.approx(speed, rel=0.05)  # two digits
