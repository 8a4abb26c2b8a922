"""Declaration of a formula effect, read and checked: expressions by output, and parameters by name.

A parameter is [low, high], or these by name with a unit, a symbol, a start, and the value where the effect
vanishes: 0 if left out, null if another parameter makes it vanish.
"""

import keyword
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

from contactlearn.core.errors import ContactLearnError, UnknownNameError
from contactlearn.effects.base import OUTPUTS, Parameter
from contactlearn.effects.formula.expression import CONSTANTS, FUNCTIONS, Expression
from contactlearn.effects.formula.symbols import SYMBOLS, at_place

_KEYS = ("low", "high", "unit", "vanishing", "start", "symbol")


@dataclass(frozen=True, kw_only=True)
class Declaration:
    """Expressions by output, all of one place, and the parameters that they use."""

    lines: Mapping[str, Expression]
    parameters: tuple[Parameter, ...]

    @classmethod
    def read(cls, place: str, expressions: Mapping[str, str], declared: Mapping[str, Any]) -> Self:
        """Read text by output and parameters by name; see the module.

        Raises:
            ContactLearnError: an output of another place, an expression that cannot be read, a name that is neither
                a symbol of this place nor a parameter, or a parameter that is not used or whose numbers are not
                sensible.
        """
        place_of_outputs(expressions, place)
        if not isinstance(declared, Mapping) or not declared:
            raise ContactLearnError(
                f"a formula needs a parameter that is fitted, got {declared!r}; write such as parameters.c=[-1, 1]"
            )
        parameters = tuple(_parameter(name, given) for name, given in declared.items())
        lines = {output: Expression(text) for output, text in expressions.items()}
        read = cls(lines=lines, parameters=parameters)
        used = {name for output, line in lines.items() for name in _names(place, output, line, declared)}
        for name in declared:
            if name not in used:
                raise ContactLearnError(
                    f"parameter {name} is not used in {read.equation}; use it in an expression or leave it out"
                )
        return read

    @property
    def equation(self) -> str:
        """Text such as τ ← τ + (-c*rx*Pn)."""
        letters = {output: SYMBOLS[output].letter for output in self.lines}
        return ", ".join(f"{letters[o]} ← {letters[o]} + ({line.text})" for o, line in self.lines.items())

    @property
    def declared(self) -> dict[str, dict[str, Any]]:
        """The parameters as plain numbers and text, complete."""
        keys = ("symbol", "unit", "low", "high", "vanishing", "start")
        return {p.name: {key: getattr(p, key) for key in keys} for p in self.parameters}


def place_of_outputs(expressions: Mapping[str, str], wanted: str | None = None) -> str:
    """Return the one place of the outputs, which must be the wanted one if there is one.

    Raises:
        UnknownNameError: no such output.
        ContactLearnError: no outputs, outputs of several places, or of another place than the wanted one.
    """
    place_of = {output: place for place, outputs in OUTPUTS.items() for output in outputs}
    if not isinstance(expressions, Mapping) or not expressions:
        raise ContactLearnError(
            f'a formula needs an output, got {expressions!r}; write such as tau="-c*rx*Pn", for {", ".join(place_of)}'
        )
    for output in expressions:
        if output not in place_of:
            raise UnknownNameError("output of a formula", output, [*place_of, "parameters"])
    places = {place_of[output] for output in expressions}
    if len(places) > 1 or places != {wanted or place_of[next(iter(expressions))]}:
        seen = ", ".join(f"{output} of the {place_of[output]}" for output in expressions)
        rule = f"must be of the {wanted}" if wanted else "must be of one place"
        raise ContactLearnError(f"the outputs of a formula {rule}, got {seen}; make an effect for each place")
    return places.pop()


def _names(place: str, output: str, line: Expression, declared: Mapping[str, Any]) -> Mapping[str, int]:
    """Names of an expression, all of them symbols of its place or parameters."""
    for name, column in line.names.items():
        if name in SYMBOLS and place not in SYMBOLS[name].places:
            places = ", ".join(SYMBOLS[name].places)
            raise line.error(column, f"{name} is known only at {places}, and an effect on {output} acts at {place}")
    line.require([*declared, *at_place(place)], "symbol or parameter")
    return line.names


def _parameter(name: str, given: Any) -> Parameter:
    """A parameter with its start, symbol and unit, checked."""
    _check_name(name)
    given = _entries(name, given)
    low, high = (_number(name, key, given[key]) for key in ("low", "high"))
    if not low < high:
        raise ContactLearnError(f"parameter {name} must have low < high, got [{low:g}, {high:g}]; swap them?")
    vanishing = given.get("vanishing", 0.0)
    vanishing = None if vanishing is None else _number(name, "vanishing", vanishing)
    start = given.get("start")
    middle = (low + high) / 2 if vanishing is None else vanishing
    start = middle if start is None else _number(name, "start", start)
    for key, value in (("vanishing", vanishing), ("start", start)):
        if value is not None and not low <= value <= high:
            raise ContactLearnError(
                f"parameter {name} must have {key} in [{low:g}, {high:g}], got {value:g}; widen the range, or say "
                "vanishing: null if another parameter makes the effect vanish"
            )
    texts = {key: given.get(key, default) for key, default in (("symbol", name), ("unit", "–"))}
    for key, text in texts.items():
        if not isinstance(text, str) or not text.isprintable():
            raise ContactLearnError(f"{key} of parameter {name} must be text, got {text!r}; write it in quotes")
    return Parameter(name, **texts, low=low, high=high, vanishing=vanishing, start=start)


def _check_name(name: Any) -> None:
    """Refuse a parameter's name that an expression could not hold, or that means something else there."""
    if not isinstance(name, str) or not re.fullmatch(r"[A-Za-z]\w{0,29}", name, re.ASCII) or keyword.iskeyword(name):
        raise ContactLearnError(f"a parameter's name is up to 30 letters, digits and _, got {name!r}; such as c or k_1")
    for kind, taken in (("symbol", SYMBOLS), ("function", FUNCTIONS), ("constant", CONSTANTS)):
        if name in taken:
            raise ContactLearnError(f"a parameter must not have the name of a {kind}, got {name!r}; such as c_{name}")


def _entries(name: str, given: Any) -> Mapping[str, Any]:
    """The entries of a parameter by key, from [low, high] or a mapping."""
    if isinstance(given, Sequence) and not isinstance(given, str) and len(given) == 2:
        given = {"low": given[0], "high": given[1]}
    if not isinstance(given, Mapping) or not {"low", "high"} <= set(given):
        raise ContactLearnError(f"parameter {name} must be [low, high], or have low: and high:, got {given!r}")
    for key in given:
        if key not in _KEYS:
            raise UnknownNameError(f"entry of parameter {name}", key, _KEYS)
    return given


def _number(name: str, key: str, value: Any) -> float:
    try:
        number = math.nan if isinstance(value, bool | str) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise ContactLearnError(f"{key} of parameter {name} must be a finite number, got {value!r}")
    return number
