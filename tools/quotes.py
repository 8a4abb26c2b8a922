"""Output that documents quote is what the program prints: this runs the commands, and writes or compares their output.

    python tools/quotes.py [DOCUMENT …]            write what the commands print into the documents
    python tools/quotes.py --check [DOCUMENT …]    exit with 1 and the difference where a document quotes anything else

A quotation is a block of `text` below a comment that names the command, and the beginnings of the first and the last
line that are quoted, or none for all:

    <!-- quoted: python diagnose.py data=mystery data.seed=7 | verdict: … report: -->
    <!-- quoted: python above -->      the Python block above it, after those before

Commands of a document run one after the other in an empty folder.  Long lines are folded, times of runs are "…".
"""

import contextlib
import difflib
import io
import os
import re
import shlex
import subprocess
import sys
import tempfile
import textwrap
from pathlib import Path

ROOT = Path(__file__).parent.parent
WIDTH = 80
QUOTED = re.compile(r"<!-- quoted: (.*?) -->\n\n```text\n(.*?)```", re.DOTALL)
BLOCK = re.compile(r"```python\n(.*?)```", re.DOTALL)


def documents():
    """Paths of the documents that quote anything."""
    paths = [ROOT / "README.md", *sorted(ROOT.glob("docs/*.md"))]
    return [path for path in paths if QUOTED.search(path.read_text("utf-8"))]


def printed(command, folder):
    """What a command prints, in a folder."""
    words = shlex.split(command)
    if words[0] == "contactlearn":
        words = ["python", "-m", *words]
    if words[0] == "python":
        words = [sys.executable, *(str(ROOT / word) if word.endswith(".py") else word for word in words[1:])]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "COLUMNS": "100"}
    done = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    return (done.stdout + done.stderr).replace(f"{ROOT}/", "")


def quotation(output, ends):
    """The quoted lines of an output, folded."""
    lines = [line.rstrip() for line in output.splitlines() if line.strip()]
    if ends:
        first, last = ends.split(" … ")
        start = next(k for k, line in enumerate(lines) if line.startswith(first))
        lines = lines[start : 1 + max(k for k, line in enumerate(lines) if line.startswith(last))]
    lines = [re.sub(r"\d{4}-\d\d-\d\d_\d\d-\d\d-\d\d", "…", line) for line in lines]
    return "".join(f"{part}\n" for line in lines for part in folded(line))


def folded(line):
    """A line in parts; columns stay as they are."""
    return textwrap.wrap(line, WIDTH, subsequent_indent="  ", break_long_words=False, drop_whitespace=True) if (
        len(line) > WIDTH and "   " not in line.strip()
    ) else [line]  # fmt: skip


def renewed(path):
    """The text of a document with what the program prints today."""
    text, names, ran = path.read_text("utf-8"), {}, 0
    with tempfile.TemporaryDirectory() as folder:
        made, end = [], 0
        for found in QUOTED.finditer(text):
            command, _, ends = found[1].partition(" | ")
            if command == "python above":
                output = ""
                with contextlib.chdir(folder):
                    for block in BLOCK.finditer(text, ran, found.start()):
                        said = io.StringIO()
                        with contextlib.redirect_stdout(said):
                            exec(compile(block[1], path.name, "exec"), names)
                        output, ran = said.getvalue(), block.end()
            else:
                output = printed(command, folder)
            made += [text[end : found.start(2)], quotation(output, ends)]
            end = found.end(2)
    return "".join(made) + text[end:]


if __name__ == "__main__":
    words = sys.argv[1:]
    check, chosen = "--check" in words, [Path(word).resolve() for word in words if word != "--check"]
    stale = []
    for document in chosen or documents():
        before, after = document.read_text("utf-8"), renewed(document)
        if before != after:
            stale += difflib.unified_diff(
                before.splitlines(), after.splitlines(), str(document), "printed", lineterm=""
            )
            if not check:
                document.write_text(after, "utf-8")
    print("\n".join(stale) or "every quotation is what the program prints")
    sys.exit(check and bool(stale))
