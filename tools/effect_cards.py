"""The index and the cards of docs/effects.md, from the classes: headings, formulas, parameters and sources.

    python tools/effect_cards.py    writes them into the page, about `<a id="NAME">` and below `<!-- forms of NAME -->`

They stand in the page itself, so that they are read wherever it is: on the site, on GitHub and in an editor.
"""

import re
from collections.abc import Sequence
from pathlib import Path

from contactlearn.cli.config_files import summaries
from contactlearn.effects import Effect, catalogue
from contactlearn.effects.base import OUTPUTS
from contactlearn.report.text.names import capitalize_first, label

PAGE = Path(__file__).parent.parent / "docs" / "effects.md"
HEADING = re.compile(r'^#### .*(?=\n\n<a id="(\w+)"></a>`\1`$)', re.MULTILINE)
INDEX = re.compile(r"(?<=<!-- index -->\n\n).*?(?=<!-- end -->)", re.DOTALL)
TABLE = re.compile(r"(<!-- forms of (\w+) -->\n\n)(?:<details>.*?\n\n<!-- end -->\n\n)?", re.DOTALL)


def index() -> str:
    """All effects as a table: name with a link to the card, what happens, and place, in the order of the cards."""
    families, told = catalogue(), summaries("effect")
    rows = [
        f"| [{capitalize_first(label(name))}](#{label(name).lower().replace(' ', '-')}) | {told[name]} | `{place}` |"
        for place in OUTPUTS
        for name, (kind, *_) in families.items()
        if kind.place == place
    ]
    return f"| effect | what happens | place |\n|{' --- |' * 3}\n{chr(10).join(rows)}\n\n"


def forms_of(kinds: Sequence[type[Effect]]) -> str:
    """The forms of a family as a table that unfolds: formula, parameters with their ranges, source."""
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
    told = f"{len(rows)} forms: formulas and ranges" if len(rows) > 1 else "Formula and range"
    table = f"{head}{chr(10).join(rows)}\n\n*Comes from*: {kinds[0].source}.{needs}"
    return f"<details>\n<summary>{told}</summary>\n\n{table}\n\n</details>"


def renewed(text: str) -> str:
    """The text of the page with the names and tables of the classes as they are."""
    families = catalogue()
    text = INDEX.sub(lambda _: index(), text)
    text = HEADING.sub(lambda found: f"#### {capitalize_first(label(found[1]))}", text)
    return TABLE.sub(lambda found: f"{found[1]}{forms_of(families[found[2]])}\n\n<!-- end -->\n\n", text)


if __name__ == "__main__":
    PAGE.write_text(renewed(PAGE.read_text("utf-8")), "utf-8")
