"""Names that come from others are text and nothing else: in the terminal, events, results, pages and names of files."""

import contextlib
import csv
import json
import re
import sys
from io import StringIO
from pathlib import Path

import pandas as pd
import pytest

from contactlearn.cli import hydra_main
from contactlearn.cli.hydra_main import compose
from contactlearn.cli.settings import DiagnoseSettings, EvaluateSettings
from contactlearn.core.errors import ContactLearnError, terminal_safe
from contactlearn.data import table
from contactlearn.report.terminal import print_line, print_table
from contactlearn.results.folder import read_result
from contactlearn.results.runs import write_table
from contactlearn.simulation import synthetic

PACKAGE = Path(__file__).parents[1] / "contactlearn"
HOSTILE = (
    "<script>window.hacked=1</script><img src=x onerror=window.hacked=1>",
    "../../etc/passwd",
    "C:\\temp\\x",
    "line\nbreak\r\n",
    "\x1b]0;title\x07\x1b[2J\x1b[31m",
    "[bold red]markup[/]",
    "[/nothing opened]",
    "{{ 7*7 }} ${oc.env:HOME} %s {0}",
    "=cmd|' /C calc'!A0",
    "\u202egnp.exe\u2028\u200b",
    "n" * 300,
)


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> tuple[Path, str]:
    """An evaluation of a table with such names of trials, objects, columns and of its file, and what it printed."""
    root = tmp_path_factory.mktemp("names")
    plain, path = root / "plain.csv", root / "<b>drops & [red]\x1b[31m.csv"
    table.save(synthetic.load(size=44), plain)
    with plain.open(newline="") as file:
        header, *rows = csv.reader(file)
    more = [name + " " for name in HOSTILE]  # columns that are not used
    for k, row in enumerate(rows):
        row[header.index("trial")] = f"{HOSTILE[k % len(HOSTILE)]}{k}"
        row[header.index("object")] = HOSTILE[k % 2]
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([[*header, *more], *([*row, *("1" for _ in more)] for row in rows)])
    words = ["data=table", f"data.path='{path}'", "data.shape={kind: ellipse, semi_axes: [0.035, 0.025]}"]
    words += ["train.size=10", "train.repetitions=2", "laws=[whittaker]", "model=[]", "bootstrap=20", "tables=csv"]
    words += ["figures.repetitions=1", "figures.parameters=whittaker", f"hydra.run.dir={root / 'run'}"]
    monkeypatch, printed = pytest.MonkeyPatch(), StringIO()
    monkeypatch.setattr(sys, "argv", ["evaluate.py", *words])
    with contextlib.redirect_stdout(printed):
        hydra_main.evaluate()
    monkeypatch.undo()
    return root, printed.getvalue()


def test_names_steer_no_terminal_file_page_or_result(run):
    root, printed = run
    assert "columns not used" in printed
    assert not re.search(r"[\x00-\x08\x0b-\x1f\x7f\u202e]", printed)
    assert {path.name for path in root.iterdir()} == {"plain.csv", "<b>drops & [red]\x1b[31m.csv", "run"}
    assert all(re.fullmatch(r"[\w.-]+", path.name) for path in (root / "run").rglob("*"))
    text = (root / "run" / "report.html").read_text(encoding="utf-8")
    assert "<script>window" not in text
    assert "<img src=x" not in text
    assert "<b>drops" not in text
    result = read_result(root / "run" / "results.json")
    assert "<b>drops & [red]\x1b[31m.csv" in result.provenance.data.source
    held_out = pd.read_csv(next((root / "run").glob("predictions.csv")), keep_default_na=False)
    assert any("<script>" in str(name) for name in held_out["trial"])
    for line in (root / "run" / "metrics.jsonl").read_text().splitlines():
        assert isinstance(json.loads(line), dict)
    frame, skipped = write_table([str(root / "run")], str(root / "run" / "all.csv"))
    assert len(frame) > 0
    assert not skipped


@pytest.mark.parametrize("part", ["effect", "model", "candidate"])
@pytest.mark.parametrize(
    "name", ["../up", "a/b", "a\\b", "<b>", "new\nline", "\x1b[2J", "[red]", "n" * 61, " ", ".hidden"]
)
def test_names_of_settings_are_words(part, name):
    """Files, charts and columns are named by them."""
    command, settings = ("diagnose", DiagnoseSettings) if part == "candidate" else ("evaluate", EvaluateSettings)
    cfg = compose(command, [])
    cfg[part] = {name: {"tau": "-c*Pn", "parameters": {"c": [0, 1]}}}
    with pytest.raises(ContactLearnError, match=f"a name in {part} has 1 to 60 letters"):
        settings.from_config(cfg)


def test_cells_of_tables_are_no_markup(capsys, monkeypatch):
    print_table("[/title]", ("body", ""), [(name, "") for name in HOSTILE[5:7]])
    print_line(HOSTILE[4])
    printed = capsys.readouterr().out
    assert all(name in printed for name in HOSTILE[5:7])
    assert "\x1b" not in printed
    # Its texts are children of Dash's components, which escape them; names in figures are Plotly's to escape.
    sources = [*(PACKAGE / "workbench").rglob("*.py"), *(PACKAGE / "workbench").rglob("*.js")]
    assert sources
    for path in sources:
        assert not re.search(
            r"Markdown|dangerously|innerHTML|outerHTML|document\.write|srcDoc", path.read_text("utf-8")
        ), path


@pytest.mark.parametrize("name", HOSTILE)
def test_harmless_text_steers_nothing(name):
    shown = terminal_safe(name)
    assert len(shown) == len(name)
    assert not re.search(r"[\x00-\x08\x0b-\x1f\x7f\u202e\u200b]", shown)
    assert terminal_safe("μ = 0.12 ± 0.01\n  é 日本") == "μ = 0.12 ± 0.01\n  é 日本"
