"""Examples as pages: their prose, their code, what it printed, and their figures.

    python examples/find_hidden_effect.py --trials=200   one example as a script; figures go into outputs/examples
    python examples/pages.py examples/as_pages           the pages of the site, made again after a change
    python examples/pages.py FOLDER                      a Markdown page with PNG figures of each, at its usual size
    python examples/pages.py FOLDER transfer --trials=60 of one, with its settings

The docstring and the comments that begin a line are the prose.  Each page has a notebook beside it, which needs nothing
but contactlearn.
"""

import argparse
import contextlib
import io
import json
import re
import sys
import types
from pathlib import Path

import torch

import contactlearn as cl

HERE = Path(__file__).parent
NAMES = (
    "paper_figures", "find_hidden_effect", "own_csv", "tracks_to_effect", "own_effect_and_law", "two_bodies",
    "transfer", "next_experiment", "planned_drops",
)  # fmt: skip
_ALONE = """# In Colab: !pip install contactlearn
from pathlib import Path
from types import SimpleNamespace

import torch

torch.set_num_threads(1)


def settings(**defaults):
    return SimpleNamespace(**defaults, out=Path("."))


def show(figure, path):
    display(figure)"""
_FIGURE = re.compile(r"^figure  .*?([^/\n]+\.png)\n", re.MULTILINE)


def settings(**defaults):
    """The settings of an example from its command line, each with its default; and `out`, a folder for its files."""
    script = Path(sys.argv[0])
    parser = argparse.ArgumentParser(script.name, formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    for name, value in defaults.items():
        parser.add_argument(f"--{name}", type=type(value), default=value, help=type(value).__name__)
    parser.add_argument("--out", type=Path, default=Path("outputs", "examples", script.stem), help="folder for files")
    torch.set_num_threads(1)
    chosen = parser.parse_args()
    chosen.out.mkdir(parents=True, exist_ok=True)
    return chosen


def show(figure, path):
    """Write a figure as PNG, and print its path."""
    with cl.plot.style.look():
        figure.savefig(path.with_suffix(".png"), dpi=150)
    print("figure ", path.with_suffix(".png"))


def page(script, folder, *words):
    """Run an example and write its page and figures into a folder; the page as Markdown."""
    head, *cells = _cells(script.read_text("utf-8"))
    title, _, rest = head.partition("\n")
    parts = [f"# {title.rstrip('.')}", rest.strip(), f"`python examples/{script.name}`"]
    module = types.ModuleType(script.stem)
    arguments, sys.modules[script.stem] = sys.argv, module
    sys.argv = [str(script), f"--out={folder}", *words]
    try:
        for number, prose, code in cells:
            printed = io.StringIO()
            with contextlib.redirect_stdout(printed):
                exec(compile("\n" * number + code, script, "exec"), module.__dict__)
            said = printed.getvalue()
            parts += [prose, f"```python\n{code.strip()}\n```"]
            parts += [f"```text\n{text}\n```" for text in [_FIGURE.sub("", said).strip()] if text]
            parts += [f"![{Path(name).stem.replace('_', ' ')}]({name})" for name in _FIGURE.findall(said)]
    finally:
        sys.argv = arguments
        del sys.modules[script.stem]
    text = "\n\n".join(part for part in parts if part) + "\n"
    (folder / f"{script.stem}.md").write_text(text, encoding="utf-8")
    return text


def notebook(script):
    """An example as a notebook: the same prose and code, and in place of this module what it takes from it."""
    head, *cells = _cells(script.read_text("utf-8"))
    title, _, rest = head.partition("\n")
    own = (HERE / f"{name}.py" for name in ("cable_torque", "smooth_floor") if f"\nfrom {name} " in cells[0][2])
    parts = [("markdown", f"# {title.rstrip('.')}\n{rest}"), ("code", _ALONE)]
    parts += [("code", path.read_text("utf-8")) for path in own]
    for _, prose, code in cells:
        parts += [("markdown", prose)] if prose else []
        parts.append(
            ("code", re.sub(r"^from (pages|cable_torque|smooth_floor) import .*\n", "", code, flags=re.MULTILINE))
        )
    made = [
        {"cell_type": kind, "id": f"cell-{k}", "metadata": {}, "source": text.strip()}
        | ({"outputs": [], "execution_count": None} if kind == "code" else {})
        for k, (kind, text) in enumerate(parts)
    ]
    about = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
    return json.dumps(
        {"cells": made, "metadata": about, "nbformat": 4, "nbformat_minor": 5}, ensure_ascii=False, indent=1
    )


def _cells(source):
    """The docstring, then for each block of code its first line, the comment before it, and the block."""
    _, doc, body = source.split('"""', 2)
    cells, prose, code, start = [doc.strip()], [], [], doc.count("\n")
    for number, line in enumerate(body.splitlines(), doc.count("\n")):
        if line.startswith("# "):
            if code and "\n".join(code).strip():
                cells.append((start, " ".join(prose), "\n".join(code)))
                prose, code = [], []
            prose.append(line.removeprefix("# "))
        else:
            start = start if code else number
            code.append(line)
    return [*cells, (start, " ".join(prose), "\n".join(code))]


if __name__ == "__main__":
    target, *rest = sys.argv[1:] or sys.exit(__doc__)
    sys.path.insert(0, str(HERE))
    wanted = [word for word in rest if not word.startswith("--")] or NAMES
    for name in wanted:
        folder = Path(target) / name
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"{name}.ipynb").write_text(notebook(HERE / f"{name}.py") + "\n", encoding="utf-8")
        page(HERE / f"{name}.py", folder, *(word for word in rest if word.startswith("--")))
        print(folder / f"{name}.md")
