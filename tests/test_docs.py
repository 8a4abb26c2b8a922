"""What the documents show works: Python blocks run, commands compose, links lead somewhere."""

import gc
import json
import re
import runpy
import shlex
from pathlib import Path

import pytest
from commands import small_search
from evaluations import training

import contactlearn
from contactlearn import laws
from contactlearn.cli.command_line import one_of_each
from contactlearn.cli.config_files import choice_settings, choices
from contactlearn.cli.hydra_main import compose
from contactlearn.diagnosis.search.candidates import all_laws, fitted_first
from contactlearn.effects import catalogue
from contactlearn.effects.base import OUTPUTS
from contactlearn.effects.formula.symbols import KNOWN, SYMBOLS
from contactlearn.mechanics.space import SPACE
from contactlearn.report.text.names import capitalize_first, label
from contactlearn.results import folder

ROOT = Path(__file__).parent.parent
DOCUMENTS = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("benchmarks/**/*.md")])
HELP = sorted(ROOT.glob("configs/hydra/help/*.yaml"))
QUOTES = runpy.run_path(str(ROOT / "tools" / "quotes.py"))
SCRIPTS = sorted(path for path in ROOT.glob("benchmarks/*/*.py") if path.name != "__init__.py")


def test_claims_of_the_paper_are_those_of_the_results():
    claims = runpy.run_path(str(ROOT / "benchmarks" / "accuracy" / "paper_claims.py"))
    made = claims["tables"](json.loads(claims["RESULTS"].read_text()))
    assert f"<!-- paper_claims -->\n\n{made}\n\n<!-- end -->" in claims["PAGE"].read_text("utf-8")
    words = ["experiment=fazeli2017", *claims["SMALLER"], claims["LEARNED"], "data.free_fall=0.008"]
    assert [*compose("evaluate", words).model] == claims["LEARNED"][7:-1].split(",")


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.name)
def test_every_benchmark_finds_what_it_measures(script, monkeypatch):
    """What it imports is there; it is not run."""
    monkeypatch.syspath_prepend(script.parents[1])
    runpy.run_path(str(script))


def _blocks(document):
    """The Python blocks of a document, each with the line of the document at which it begins."""
    text = document.read_text("utf-8")
    for found in re.finditer(r"```python\n(.*?)```", text, re.DOTALL):
        yield found[1], text.count("\n", 0, found.start(1))


WITH_BLOCKS = [document for document in DOCUMENTS if list(_blocks(document))]
COMMAND = re.compile(r"^ *(?:PYTHONPATH=\S+ )?contactlearn ((?:train|evaluate|diagnose) .*)", re.MULTILINE)
DIAGNOSE = ("reading.md",)  # as the blocks of the README do


def _commands():
    """(name, overrides) of `contactlearn train …` and the other two in the documents and the help, each once."""
    seen = set()
    for document in [*DOCUMENTS, *HELP]:
        text = re.sub(r"\s*\\\n\s*", " ", document.read_text("utf-8"))  # a command over several lines
        for line in COMMAND.findall(text):
            command = re.split(r"\s{2,}|`|\s#", line)[0]
            if command not in seen:
                seen.add(command)
                name, *words = shlex.split(command)
                yield pytest.param(name, words, id=f"{document.name}: {command}")


def _pass_contracts(names):
    """Run the tests that the classes of a document inherit."""
    for name in [name for name in names if name.startswith("Test")]:
        test = names[name]()
        for method in [method for method in dir(test) if method.startswith("test_")]:
            getattr(test, method)()


@pytest.mark.parametrize("document", WITH_BLOCKS, ids=lambda document: document.name)
def test_python_blocks_run(document, tmp_path, monkeypatch):
    """One after the other, in a folder that holds one run and nothing else; so do the contracts that they inherit."""
    folder.write_result(tmp_path / "outputs" / "train", training())
    monkeypatch.chdir(tmp_path)
    names = {}
    with small_search():
        for code, line in _blocks(document):
            exec(compile("\n" * line + code, document, "exec"), names)
    _pass_contracts(names)
    names.clear()
    gc.collect()  # classes that a block defines are laws and effects until they are gone


def test_the_page_of_the_front_door_lists_every_name():
    """And no other: a name that is added or removed changes the page."""
    text = (ROOT / "docs" / "api.md").read_text("utf-8")
    listed = {name for row in re.findall(r"^\| (`.*?) \|", text, re.MULTILINE) for name in re.findall(r"`(\w+)", row)}
    assert listed | {"Diagnosis", "Fit", "Recipe", "__version__"} == {*contactlearn.__all__}
    assert all(f"`{name}`" in text for name in ("Diagnosis", "Fit", "Recipe"))


def test_errors_in_the_readme_are_those_of_the_case_studies():
    """Each percentage of an error in its table is the two digits of an error of the study that the row links."""
    text = (ROOT / "README.md").read_text("utf-8")
    rows = re.findall(r"^\| \[.*?\]\((docs/case-study\S*?\.md)\).*?\| (\d\S*) % → \*\*(\S+) %\*\*", text, re.MULTILINE)
    assert len(rows) == 3
    for study, *errors in rows:
        measured = re.findall(r"0\.\d{3}", (ROOT / study).read_text("utf-8"))
        for error in errors:
            assert error in {f"{100 * float(one):.{len(error.partition('.')[2])}f}" for one in measured}, (study, error)


@pytest.mark.nightly
@pytest.mark.parametrize("document", QUOTES["documents"](), ids=lambda document: document.name)
def test_quotations_are_what_the_program_prints(document):
    """If not: `python tools/quotes.py DOCUMENT`."""
    assert QUOTES["renewed"](document) == document.read_text("utf-8")


@pytest.mark.parametrize(("name", "words"), list(_commands()))
def test_commands_compose(name, words, tmp_path, monkeypatch):
    """In a folder with the files that `contactlearn init` writes there, as the documents show one."""
    shown, *_ = re.findall(r"```yaml\n(.*?)```", (ROOT / "docs" / "your-data.md").read_text("utf-8"), re.DOTALL)
    (tmp_path / "mydata.yaml").write_text(shown, "utf-8")
    (tmp_path / "takes.yaml").write_text("_target_: contactlearn.data.tracks.load", "utf-8")
    monkeypatch.chdir(tmp_path)
    overrides = [word for word in words if "=" in word]
    if "-m" in words:  # one job of the sweep; a sweeper need not be installed
        _, (overrides, *_) = one_of_each([word for word in overrides if not word.startswith("hydra/sweeper")])
        overrides = [word for word in overrides if not word.startswith("hydra.sweeper.")]
    assert compose(name, overrides).data._target_.startswith(("contactlearn.data.", "contactlearn.simulation."))


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_links_lead_somewhere(document):
    for target in re.findall(r"\]\((?!http)([^)#]+)", document.read_text("utf-8")):
        assert (document.parent / target).exists(), target


def test_messages_of_the_troubleshooting_page_are_those_of_the_program():
    """Each fragment in its first column stands in a string of the package."""
    files = (path for kind in ("py", "j2", "js") for path in (ROOT / "contactlearn").rglob(f"*.{kind}"))
    package = re.sub(r'"\s*\n\s*f?"', "", " ".join(path.read_text("utf-8") for path in files))
    text = (ROOT / "docs" / "troubleshooting.md").read_text("utf-8")
    ours, _, shell = text.partition("## From the shell")
    messages = [
        part for cell in re.findall(r"^\| (.*?) \|", ours, re.MULTILINE) for part in re.findall(r"`(.*?)`", cell)
    ]
    assert len(messages) > 12
    assert shell
    assert [message for message in messages if message not in package] == []


def test_every_setting_is_explained():
    """Each value in the shipped configurations has a comment; hydra's own part is Hydra's to explain."""
    for path in [*ROOT.glob("configs/*.yaml"), *ROOT.glob("configs/data/*.yaml"), *ROOT.glob("configs/model/*.yaml")]:
        ours = re.split(r"^hydra:$", path.read_text("utf-8"), flags=re.MULTILINE)[0]
        for line in ours.splitlines():
            if re.match(r" *[a-z_]+: +\S", line) and not line.lstrip().startswith(("_target_", "defaults")):
                assert "#" in line, f"{path.name}: {line}"


def test_every_effect_has_a_card():
    """A heading in words, the name in code below its place, a drawing, its neighbours, formulas, ranges; an index.

    If the tables are not those of the classes: `python tools/effect_cards.py`.
    """
    text = (ROOT / "docs" / "effects.md").read_text("utf-8")
    assert runpy.run_path(str(ROOT / "tools" / "effect_cards.py"))["renewed"](text) == text
    places = re.split(r"^### `(\w+)`: .*$", text, flags=re.MULTILINE)
    cards = {}
    for place, part in zip(places[1::2], places[2::2], strict=True):
        for name, card in zip(
            *[iter(re.split(r'^<a id="(\w+)"></a>`\1`$', part, flags=re.MULTILINE)[1:])] * 2, strict=True
        ):
            cards[name] = place, card.replace("\\|", "|")
    assert list(cards) == [name for place in OUTPUTS for name, (kind, *_) in catalogue().items() if kind.place == place]
    for name, kinds in catalogue().items():
        place, card = cards[name]
        assert place == kinds[0].place
        assert f"(pictures/effects/{name}.svg)" in card
        assert "*Not to be confused with*" in card
        assert f"*Comes from*: {kinds[0].source}" in card
        for kind in kinds:
            assert f"| `{kind.form or kind.name}` | {kind.formula} |" in card
            for p in kind().parameters:
                assert f"{p.symbol} in [{p.low:g}, {p.high:g}]" in card
    headings = re.findall(r"^#### (.*)$", text, flags=re.MULTILINE)
    assert headings == [capitalize_first(label(name)) for name in cards]
    index = text.partition("\n## Index\n")[2].partition("\n## ")[0]
    assert re.findall(r"^\| \[(.*)\]\(#[\w-]+\) \| \S.* \| `\w+` \|$", index, flags=re.MULTILINE) == headings
    for anchor in re.findall(r"\]\(#([\w-]+)\)", text):
        assert anchor in [heading.lower().replace(" ", "-") for heading in headings], anchor


def test_pages_agree_on_the_laws_that_a_diagnosis_compares():
    searched = {law.name: law for law in all_laws()}
    last = set(searched) - {*fitted_first(searched)}
    assert (len(laws.names()), len(searched), last) == (9, 9, {"spring_dashpot"})
    said = "eight of the nine laws, (each with effects around it, )?and tries the ninth, `spring_dashpot`, in place of"
    for page in ("choose", "diagnosis", "laws"):
        assert re.search(said, (ROOT / "docs" / f"{page}.md").read_text("utf-8")), page


def test_summary_of_the_tests_adds_up():
    """The last row is the sum of the others, with Wilson's intervals."""
    text = (ROOT / "docs" / "how-it-is-tested.md").read_text("utf-8")
    table = re.search(r"^\| test sets \|.*?\n\n", text, re.MULTILINE | re.DOTALL)
    assert table
    *rows, total = [line.split("|")[3:7] for line in table[0].strip().splitlines()[2:]]
    for column, whole in zip(zip(*rows, strict=True), total, strict=True):
        right, n = (sum(map(int, re.findall(part, " ".join(column)))) for part in (r"(\d+) of", r"of (\d+)"))
        z2, share = 1.96**2, right / n
        middle = (share + z2 / (2 * n)) / (1 + z2 / n)
        half = (z2 * (share * (1 - share) / n + z2 / (4 * n * n))) ** 0.5 / (1 + z2 / n)
        low, high = 100 * (middle - half), 100 * (middle + half)
        assert whole.strip() == f"**{right} of {n}** ({low:.0f}–{high:.0f} %)"


def test_all_that_a_person_must_fill_in_is_listed():
    section = (ROOT / "CONTRIBUTING.md").read_text("utf-8").partition("## What a person fills in")[2]
    listed = re.findall(r"^\| `([\w./]+)` \|", section, re.MULTILINE)
    files = [*ROOT.glob("*.*"), ROOT / "LICENSE", *ROOT.glob("docs/*.*"), *ROOT.glob("configs/**/*.yaml")]
    files = [path for path in files if path.is_file() and path.suffix in ("", ".md", ".toml", ".cff", ".py", ".yaml")]
    texts = {path.relative_to(ROOT).as_posix(): path.read_text("utf-8") for path in files}
    empty = {name for name, text in texts.items() if re.search(r"OWNER|the contactlearn authors", text)}
    assert empty == {*listed, "CONTRIBUTING.md"}


def test_symbols_of_a_line_of_mathematics_are_listed():
    text = (ROOT / "docs" / "effects.md").read_text("utf-8")
    for name, symbol in SYMBOLS.items():
        assert f"| `{name}` | {symbol.unit} | {symbol.description} |" in text
    assert all(f"`{name}`" in text for name, symbol in KNOWN[SPACE].items() if symbol.of)


def test_every_effect_and_law_is_a_choice():
    """With the options of its class and their defaults, which the documents explain."""
    effects, about = catalogue(), (ROOT / "docs" / "effects.md").read_text("utf-8")
    assert choices("effect") == sorted(effects)
    for name, (default, *_) in effects.items():
        (one,) = choice_settings("effect", name).values()
        assert one.pop("_target_") == f"contactlearn.effects.{name}.{name.title().replace('_', '')}"
        assert one.pop("form", None) == default.form
        assert one == default().options
        for option in one:
            assert f"| `{option}` |" in about
    assert choices("law") == sorted([*laws.names(), "best"])
    for name in laws.names():
        one, kind = choice_settings("law", name), laws.catalogue()[name]["textbook"]
        assert one.pop("_target_") == f"{kind.__module__}.{kind.__name__}"
        assert not one
        assert f"| `{name}` |" in (ROOT / "docs" / "laws.md").read_text("utf-8")
