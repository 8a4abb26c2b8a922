"""An effect as one line of mathematics, such as `tau = -c*rx*Pn; c = [-1, 1]`.

Before the first semicolon stands an output and its expression, behind it the parameters with their ranges.  The line is
read by the same whitelist as `+effect.mine.tau="-c*rx*Pn" +effect.mine.parameters.c=[-1,1]` of a command.
"""

import re

from contactlearn.core.errors import ContactLearnError
from contactlearn.diagnosis.result import Formula
from contactlearn.effects import Effect
from contactlearn.effects.formula.effect import formula
from contactlearn.effects.formula.expression import FUNCTIONS
from contactlearn.effects.formula.symbols import FORMULA_OUTPUTS, at_place
from contactlearn.mechanics.space import PLANE, Space

EXAMPLE = "tau = -c*rx*Pn; c = [-1, 1]"
_LONGEST = 500
_RANGE = re.compile(r"\[\s*([^\s,\]]+)\s*,\s*([^\s,\]]+)\s*\]")


def line_name(place: int) -> str:
    """Name the effect of a line by its place among them, counted from 0."""
    return f"line{place + 1}"


def parse(line: str) -> tuple[str, str, dict[str, list[float]]]:
    """Take a line apart: output, expression, and the range of each parameter.

    Raises:
        ContactLearnError: a line of another shape.
    """
    if len(line) > _LONGEST:
        raise ContactLearnError(f"a line has up to {_LONGEST} characters, got {len(line)}")
    first, *rest = (part.strip() for part in line.split(";"))
    output, equals, expression = (part.strip() for part in first.partition("="))
    if not equals or not output or not expression:
        raise ContactLearnError(f"write an output and its expression, such as {EXAMPLE}; got {line!r}")
    ranges: dict[str, list[float]] = {}
    for part in filter(None, rest):
        name, equals, text = (one.strip() for one in part.partition("="))
        found = _RANGE.fullmatch(text)
        try:
            ranges[name] = [float(end) for end in found.groups()] if found else []
        except ValueError:
            ranges[name] = []
        if not ranges[name]:
            raise ContactLearnError(f"a parameter has a range, such as c = [-1, 1]; got {part!r}")
    return output, expression, ranges


def formula_line(found: Formula) -> str:
    """Write a formula that a diagnosis found as a line."""
    ranges = (f"c{k} = [{low:.4g}, {high:.4g}]" for k, (low, high) in enumerate(found.ranges, 1))
    return "; ".join((f"{found.output} = {found.text}", *ranges))


def parse_effect(line: str) -> Effect:
    """Return the effect of a line.

    Raises:
        ContactLearnError: a line of another shape, or an error of `formula`.
    """
    output, expression, ranges = parse(line)
    return formula(ranges, **{output: expression})


def overrides(line: str, name: str) -> list[str]:
    """Write a line as the words of a command that add its effect under a name."""
    output, expression, ranges = parse(line)
    words = [f'+effect.{name}.{output}="{expression}"']
    return words + [f"+effect.{name}.parameters.{key}=[{low:g},{high:g}]" for key, (low, high) in ranges.items()]


def completions(text: str, space: Space = PLANE) -> list[str]:
    """Complete the last word of a line with outputs, or with the symbols and functions that are known there."""
    before, word = re.fullmatch(r"(.*?)([A-Za-z_]\w*)?", text, re.DOTALL).groups("")  # pyright: ignore[reportOptionalMemberAccess]
    place_of = {output: place for place, outputs in FORMULA_OUTPUTS[space].items() for output in outputs}
    if "=" not in before:
        return [f"{before}{output} = " for output in place_of if output.startswith(word)]
    if not word or ";" in before:
        return []
    place = place_of.get(before.partition("=")[0].strip(), "state")
    known = [*at_place(place, [space]), *(f"{name}(" for name in FUNCTIONS)]
    return [before + name for name in known if name.startswith(word) and name != word]
