"""Headings, and tables of formulas, parameters and sources, on the cards of docs/effects.md, from the classes.

    python tools/effect_cards.py    writes them into the page, about `<a id="NAME">` and below `<!-- forms of NAME -->`

They stand in the page itself, so that they are read wherever it is: on the site, on GitHub and in an editor.
"""

import re
from collections.abc import Sequence
from pathlib import Path

from contactlearn.effects import Effect, catalogue
from contactlearn.report.text.names import capitalize_first, label

PAGE = Path(__file__).parent.parent / "docs" / "effects.md"
HEADING = re.compile(r'^#### .*(?=\n\n<a id="(\w+)"></a>`\1`$)', re.MULTILINE)
TABLE = re.compile(r"(<!-- forms of (\w+) -->\n\n)(?:\|.*?\n\n<!-- end -->\n\n)?", re.DOTALL)


def forms_of(kinds: Sequence[type[Effect]]) -> str:
    """The forms of a family as a table: formula, parameters with their ranges, source."""
    rows = []
    for of in kinds:
        effect, ranges = of(), list[str]()
        for p in of.every_parameter():
            unit = ("" if p.unit == "–" else f" {p.unit}") + ("" if p in effect.parameters else ", in space")
            ranges.append(f"{p.symbol} in [{p.low:g}, {p.high:g}]{unit}")
        where = " and ".join(space.name for space in of.spaces)
        cells = (f"`{of.form or of.name}`", effect.formula, "<br>".join(ranges) or "one for each further body", where)
        rows.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    head = f"| form | what it does | parameters | bodies in |\n|{' --- |' * 4}\n"
    needs = " It needs the body's shape." if kinds[0].needs_shape else ""
    return f"{head}{chr(10).join(rows)}\n\n*Source*: {kinds[0].source}.{needs}"


def renewed(text: str) -> str:
    """The text of the page with the names and tables of the classes as they are."""
    families = catalogue()
    text = HEADING.sub(lambda found: f"#### {capitalize_first(label(found[1]))}", text)
    return TABLE.sub(lambda found: f"{found[1]}{forms_of(families[found[2]])}\n\n<!-- end -->\n\n", text)


if __name__ == "__main__":
    PAGE.write_text(renewed(PAGE.read_text("utf-8")), "utf-8")
