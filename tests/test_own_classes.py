"""Laws and effects of a user's own: a slip in them is one line that says what to write, before any work."""

import gc
from dataclasses import FrozenInstanceError, dataclass

import pytest
import torch

from contactlearn.cli.settings import check_effect, check_law, located_errors, parse_law
from contactlearn.core.errors import ContactLearnError
from contactlearn.effects import Effect, catalogue, choose_form, columns, parameter
from contactlearn.laws import Law, find, names

SHIPPED = catalogue()


@pytest.fixture(autouse=True)
def forgotten():
    """Classes are in the catalogue as long as they live."""
    yield
    gc.collect()


def effect_with(velocity):
    """An effect with this method."""

    @dataclass(frozen=True, eq=False)
    class Own(Effect):
        formula = "own"
        u: float = parameter("u", "m/s", -0.5, 0.5)

        def velocity(self, state, v_post):
            return velocity(self.u, v_post)

    return Own()


def law_with(solve):
    """A law with this method."""

    class OwnLaw(Law):
        def solve(self, contact, mu, eps):
            return solve(-(1 + eps) * contact.v_n / contact.w_nn)

    return OwnLaw()


SLIPS = {
    "a component": (lambda u, v: v[..., 0] + u, r"must return v_post, a tensor .* got a tensor \[5\] on 5 impacts"),
    "nothing": (lambda u, v: None, "from velocity, got NoneType"),
    "if": (lambda u, v: v if u > 0 else v + u, r"line \d+: RuntimeError: Boolean .*torch.where"),
    "detached": (lambda u, v: columns(v[..., 0] + u.detach(), v[..., 1], v[..., 2]),
        "depends on u, but has no gradient"),
    "float": (lambda u, v: v + float(u), "ValueError: only one element .*let torch alone compute with it"),
    "rounded": (lambda u, v: columns(v[..., 0] + (9 * u).round(), v[..., 1], v[..., 2]), "depends on u, but has no"),
    "never vanishes": (lambda u, v: columns(v[..., 0] + u + 0.1, v[..., 1], v[..., 2]),
        r"at u = 0 it adds .* 0\.1 m/s"),
}  # fmt: skip


def test_an_effect_may_state_its_place():
    class Stated(Effect):
        place = "velocity"
        formula = "own"
        u: float = parameter("u", "m/s", -0.5, 0.5)

        def velocity(self, state, v_post):
            return v_post + self.u

    class Unwritten(Effect):
        place = "velocity"

    assert choose_form(Stated) is Stated
    assert Stated().place == "velocity"
    with pytest.raises(ContactLearnError, match="Unwritten does not override its method velocity"):
        choose_form(Unwritten)


@pytest.mark.parametrize(("velocity", "message"), SLIPS.values(), ids=SLIPS)
def test_a_slip_in_an_effect_is_one_line(velocity, message):
    effect = effect_with(velocity)
    with pytest.raises(ContactLearnError, match=rf"^own\.Own .*{message}"), located_errors("own.Own", type(effect)):
        check_effect(effect, "own.Own")


@pytest.mark.parametrize("decorate", [lambda kind: kind, dataclass(frozen=True)], ids=["bare", "decorated"])
def test_a_law_is_a_frozen_dataclass_with_its_decorator_or_without(decorate):
    @decorate
    class Sticky(Law):
        share: float = 0.5

        def solve(self, contact, mu, eps):
            return 0 * contact.v_t, -(1 + eps) * contact.v_n / contact.w_nn

    assert (Sticky(0.1, share=0.2).options, Sticky(0.1), hash(Sticky())) == (
        {"share": 0.2},
        Sticky(0.1),
        hash(Sticky()),
    )
    with pytest.raises(FrozenInstanceError, match="share"):
        Sticky().share = 0.3


def test_no_effect_and_no_law_of_the_catalogue_is_refused():
    for name, forms in SHIPPED.items():
        for kind in forms:
            check_effect(kind(), name)
    for name in names():
        check_law(find(name), name)

    @dataclass(frozen=True, eq=False)
    class Fixed(Effect):
        formula = "v_x⁺ ← v_x⁺ + u"
        u: float = 0.1

        def velocity(self, state, v_post):
            return v_post

    with pytest.raises(ContactLearnError, match=r"own has no parameter to fit; .* parameter\("):
        check_effect(Fixed(), "own")


LAWS = {
    "one tensor": (lambda P: P, r"must return two tensors \(P_t, P_n\) of impulses, got a tensor \[2, 5\]"),
    "a number": (lambda P: (0.0, P), r"got \(float, a tensor \[2, 5\]\)"),
    "no numbers": (lambda P: (P.negative().sqrt(), P), "no finite number"),
    "another name": (lambda P: P.nothing, "fails in .*, line .*: AttributeError"),
}


@pytest.mark.parametrize(("solve", "message"), LAWS.values(), ids=LAWS)
def test_a_slip_in_a_law_is_one_line(solve, message):
    law = law_with(solve)
    with pytest.raises(ContactLearnError, match=message), located_errors("own.OwnLaw", type(law)):
        check_law(law, "own.OwnLaw")


def test_the_command_tries_a_law_user_candidates(monkeypatch):
    law = law_with(lambda P: (torch.zeros_like(P), P / 0))
    monkeypatch.setitem(globals(), "Mine", type(law))
    with pytest.raises(ContactLearnError, match=r"Mine\.solve gives an impulse that is no finite number"):
        parse_law({"_target_": f"{__name__}.Mine"}, "textbook")
    with pytest.raises(ContactLearnError, match=r"must be a class in its module, such as my_law\.Law, got my_law"):
        parse_law({"_target_": "my_law"}, "textbook")
