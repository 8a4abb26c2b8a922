"""Dataclasses as JSON: what is written is read again, and nothing else is believed."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import pytest
from hypothesis import given, strategies as st

from contactlearn.core import serialisation
from contactlearn.core.errors import ContactLearnError
from contactlearn.core.serialisation import from_json, to_json


class Colour(StrEnum):
    RED = "red"


@dataclass(frozen=True, kw_only=True)
class Part:
    x: float
    colour: Colour = Colour.RED
    sigma: float | None = None


@dataclass(frozen=True, kw_only=True)
class Whole:
    name: str
    parts: Mapping[str, Part] = field(default_factory=dict)
    steps: tuple[Part, ...] = ()
    config: Mapping[str, Any] = field(default_factory=dict)


numbers = st.floats(allow_nan=False, allow_infinity=False)
texts = st.text(st.characters(exclude_categories=["Cs"]))
parts = st.builds(Part, x=numbers, sigma=st.none() | numbers)
plain = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**53), 2**53) | numbers | texts,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(texts, inner, max_size=3),
    max_leaves=8,
)
wholes = st.builds(
    Whole, name=texts, parts=st.dictionaries(texts, parts, max_size=3), steps=st.lists(parts, max_size=3).map(tuple),
    config=st.dictionaries(texts, plain, max_size=3),
)  # fmt: skip


@given(wholes)
def test_round_trip_is_exact(whole):
    text = to_json(whole)
    assert from_json(Whole, text) == whole
    assert from_json(Whole, text.encode()) == whole


def test_text_is_indented_and_not_ascii(monkeypatch):
    assert to_json(Part(x=0.1)) == '{\n  "x": 0.1,\n  "colour": "red",\n  "sigma": null\n}\n'
    assert "μ" in to_json(Whole(name="μ"))
    content = '{"name": "", "parts": {"a.b[...]`": {"x": 1}, "c.[0]\\n": {"x": null}}}'
    with pytest.raises(ContactLearnError, match=r"^parts\.c\.\[0\] \.x: expected float, got null$"):
        from_json(Whole, content)
    with pytest.raises(ContactLearnError, match="is not JSON"):
        from_json(Whole, b'{"\xe4": 1}')
    monkeypatch.setattr(serialisation, "LARGEST_FILE", 5)
    with pytest.raises(ContactLearnError, match="is larger than"):
        from_json(Whole, '{"name": ""}')


@pytest.mark.parametrize("x", [float("nan"), float("inf")])
def test_numbers_that_are_not_finite(x):
    """They are null where a number may be missing, and refused where it may not."""
    assert from_json(Part, to_json(Part(x=1.0, sigma=x))) == Part(x=1.0)
    with pytest.raises(ContactLearnError, match=r"^parts\.b\.x: expected float, got null$"):
        to_json(Whole(name="", parts={"a": Part(x=1.0), "b": Part(x=x)}))


WRONG = {
    "": "is not JSON, or was cut off",
    '{"name": ': "is not JSON, or was cut off",
    "[" * 100_000: "is nested too deeply",
    '{"name": "", "config": ' + '{"a":' * 90 + "{}" + "}" * 91: "is nested too deeply",
    "[1]": "the file: expected object, got array",
    "{}": "name is not there",
    '{"name": NaN}': "is not JSON",
    '{"name": "\\ud800"}': "is not JSON",
    '{"name": 3}': "name: expected str, got int",
    '{"name": "", "parts": {"a": {"x": 1}, "b": {"x": "1"}, "c": {"x": true}}}': "parts.b.x: expected float, got str",
    '{"name": "", "parts": {"a": {"x": 1}, "b": {"x": 1}, "c": {}}}': "parts.c.x is not there",
    '{"name": "", "steps": [{"x": 1}, {"x": 1, "colour": "blue"}]}': "steps.1.colour: invalid enum value 'blue'",
    '{"name": "", "steps": [{"x": 1%s}]}' % ("0" * 400): "steps.0.x: number out of range",
    '{"name": "", "config": {"x": %s}}' % ("9" * 5000): "is not JSON",
    '{"name": "", "steps": [{"x": 1e999}]}': "is not JSON",
}


@pytest.mark.parametrize(("text", "reason"), WRONG.items(), ids=[reason[:20] for reason in WRONG.values()])
def test_wrong_entries_are_named(text, reason):
    with pytest.raises(ContactLearnError) as caught:
        from_json(Whole, text)
    assert str(caught.value).startswith(reason)
    assert "\n" not in str(caught.value)
