"""Tables as they are copied out of papers, repositories and pages: LaTeX, Markdown and HTML."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest
import torch
from refusals import refused

from contactlearn.data import table
from contactlearn.data.headers import propose
from contactlearn.simulation import synthetic

BODY = {"shape": {"kind": "ellipse", "semi_axes": [0.035, 0.025]}, "mass": 0.0364}
NAMES = ("x", "y", "theta", "vx", "vy", "omega", "vx_post", "vy_post", "omega_post")
LATEX = (
    "$x$ (mm)", "{$y$ [\\si{\\milli\\metre}]}", "$\\theta$ (rad)", "$v_x$ (m/s)", "$v_{y}^{-}$ (m\\,s$^{-1}$)",
    "\\(\\omega\\)/(rad/s)", "$v_x^{+}$ [\\si{m.s^{-1}}]", "\\textbf{$v_y'$} (\\si{\\metre\\per\\second})",
    "$\\omega^+$ (\\unit{\\radian\\per\\second})",
)  # fmt: skip
Rows = Sequence[Sequence[str]]


@pytest.fixture(scope="module")
def values() -> np.ndarray:
    """Positions in mm, all else in SI, with five digits."""
    drops = synthetic.load(size=20)
    whole = torch.cat((drops.q, drops.v_pre, drops.v_post), 1).numpy() * ([1000, 1000] + [1] * 7)
    return np.vectorize(lambda x: float(f"{x:.5g}"))(whole)


def cells_of(values: np.ndarray, write: Callable[[str], str] = str) -> list[list[str]]:
    return [[write(f"{x:.5g}") for x in row] for row in values.tolist()]


def latex(header: Sequence[str], rows: Rows) -> str:
    body = "\n".join(" & ".join(row) + r" \\" + r"[1mm]" * (k == 3) for k, row in enumerate(rows))
    return (
        "\\begin{table}[ht]\\centering % of drops\n\\caption{Drops \\& rebounds.}\n"
        "\\begin{tabular}{@{}l S[table-format=-1.2] *{7}{c}@{}}\n\\toprule\n"
        + " & ".join(header)
        + " \\\\\\midrule\n% \\hline 1 & 2 \\\\\n"
        + body
        + "\n\\bottomrule\n\\end{tabular}\n\\end{table}\n"
    )


def markdown(header: Sequence[str], rows: Rows) -> str:
    rules = ["---", ":--:", "--:"] * 3
    return "# Drops\n\nA list | of drops.\n\n" + "\n".join(f"| {' | '.join(row)} |" for row in (header, rules, *rows))


def html(header: Sequence[str], rows: Rows) -> str:
    def row(tag: str, cells: Sequence[str]) -> str:
        return f"<tr>{''.join(f'<{tag} class=c>{cell}</{tag}>' for cell in cells)}</tr>\n"

    page = "<html><script>alert('<td>')</script><body><p>1 < 2<TABLE>\n<thead>"
    return page + row("th", header) + "</thead>" + "".join(row("td", one) for one in rows) + "</table></body></html>"


def check(found: table.Impacts, values: np.ndarray) -> None:
    wanted = values / ([1000, 1000] + [1] * 7)
    np.testing.assert_allclose(torch.cat((found.q, found.v_pre, found.v_post), 1).numpy(), wanted, rtol=1e-12)


@pytest.mark.parametrize(
    "write",
    [
        str,
        "${}$".format,
        "{{{}}}".format,
        r"\num{{{}}}".format,
        lambda x: "$" + x.replace("-", "-\\,") + "$",
        lambda x: f"${float(x) / 10:.8g} \\times 10^{{1}}$",
        lambda x: f"${x} \\pm 0.01$",
        lambda x: x.replace("-", "\u2212"),
        lambda x: x + "$^{\\dagger}$" * x.startswith("-"),
    ],
    ids=["plain", "$", "braces", "num", "thin space", "powers of ten", "errors", "minus", "footnotes"],
)
@pytest.mark.parametrize("suffix", [".tex", ".txt", ".csv"])
def test_a_table_of_latex(tmp_path, values, write, suffix):
    path = tmp_path / f"drops{suffix}"
    path.write_text(latex(LATEX, cells_of(values, write)), "utf-8")
    read = table.read(path, **BODY)
    check(read.impacts, values)
    assert "a table of LaTeX" in read.read_as
    assert propose(path).source == "table"


def test_rows_that_are_copied_without_their_tabular(tmp_path, values):
    path = tmp_path / "drops.txt"
    path.write_text("\\hline\n" + "\n".join(" & ".join(row) + " \\\\" for row in [LATEX, *cells_of(values)]), "utf-8")
    check(table.load(path, **BODY), values)


def test_derivatives_are_velocities(tmp_path, values):
    """As mechanics writes them, with their time as a superscript."""
    names = [rf"${name}^{{{time}}}$" for time in "-+" for name in (r"\dot{x}", r"\dot y", r"\dot{\theta}")]
    path = tmp_path / "drops.tex"
    path.write_text(latex(["$x$", "$y$", r"$\theta$", *names], cells_of(values)), "utf-8")
    check(table.load(path, **BODY), values * ([1000, 1000] + [1] * 7))


def test_groups_over_the_columns_of_latex(tmp_path, values):
    header = [r"{$x$ (mm)}", "$y$ (mm)", r"$\theta$", *[r"$v_x$ (m/s)", r"$v_y$ (m/s)", r"$\omega$"] * 2]
    text = latex(header, cells_of(values))
    groups = " & ".join(rf"\multicolumn{{3}}{{c|}}{{\emph{{{name}}}}}" for name in ("pose", "before", "after"))
    groups += r" \\ \cmidrule(lr){4-6}"
    path = tmp_path / "drops.tex"
    path.write_text(text.replace("\\toprule\n", f"\\toprule\n{groups}\n"), "utf-8")
    check(table.load(path, **BODY, units={"angle": "rad"}), values)


@pytest.mark.parametrize("write", [markdown, html])
@pytest.mark.parametrize("suffix", [".md", ".html", ".txt"])
def test_tables_of_markdown_and_html(tmp_path, values, write, suffix):
    header = ["x [mm]", "y [mm]", "theta", "vx [m/s]", "vy (m/s)", "**omega**" if write is markdown else "&omega;"]
    after = ["v<sub>x</sub><sup>+</sup> [m/s]", "v<sub>y</sub>' [m/s]", "&omega;&prime;"]
    header += after if write is html else ["vx\\_post [m/s]", "`vy_post` [m/s]", "omega'"]
    path = tmp_path / f"drops{suffix}"
    path.write_text(write(header, cells_of(values)), "utf-8")
    read = table.read(path, **BODY)
    check(read.impacts, values)
    assert f"a table of {'HTML' if write is html else 'Markdown'}" in read.read_as


def test_cells_over_several_rows_and_columns_of_html(tmp_path, values):
    top = "<th rowspan=2>x [mm]<th rowspan=2>y [mm]<th rowspan=2>theta<th colspan=3>before<th colspan=3>after"
    rows = cells_of(values)
    text = html([*["vx [m/s]", "vy [m/s]", "omega"] * 2], rows).replace("<thead>", f"<thead><tr>{top}</tr>")
    path = tmp_path / "drops.html"
    path.write_text(text, "utf-8")
    check(table.load(path, **BODY), values)


@pytest.mark.parametrize("write", [latex, markdown, html])
def test_of_several_tables_that_of_impacts_is_read(tmp_path, values, write):
    other = write(["body", "mass", "R"], [["a", "1", "2"], ["b", "2", "3"]])
    drops = write(NAMES, cells_of(values))
    path = tmp_path / "drops.txt"
    path.write_text(f"{other}\n\n{drops}", "utf-8")
    check(table.load(path, **BODY, units={"length": "m"}), values * ([1000, 1000] + [1] * 7))
    path.write_text(f"{drops}\n\n{drops}", "utf-8")
    with refused(["has 2 tables of ", "keep one in the file"]):
        table.load(path, **BODY)


@pytest.mark.parametrize("write", [latex, markdown, html])
def test_an_error_names_the_line_of_the_file(tmp_path, values, write):
    rows = cells_of(values)
    rows[7][4] = "oops"
    path = tmp_path / "drops.txt"
    path.write_text(write(NAMES, rows), "utf-8")
    line = next(k for k, one in enumerate(path.read_text("utf-8").splitlines(), 1) if "oops" in one)
    with refused([f"row 8 (line {line}), column vy: must be a finite number", "got 'oops'"]):
        table.load(path, **BODY)


def test_names_with_symbols_of_other_text_stay_as_they_are(tmp_path):
    """A bar, an ampersand or a backslash in a CSV is no markup."""
    drops = synthetic.load(size=5).to_frame().assign(note=["a & b \\\\", "c & d \\\\", "|--|--|", "<table", "\\hline"])
    path = tmp_path / "drops.csv"
    drops.to_csv(path, index=False)
    read = table.read(path)
    assert (len(read.impacts), read.unused) == (5, ("note",))
