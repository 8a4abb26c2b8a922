"""`contactlearn report`: one page over several runs, read in Python and opened in headless Chromium."""

import html
import json
import os
import re
from urllib.parse import unquote

import pytest
from browser import nothing_sticks_out
from commands import run
from evaluations import evaluation, learning_curve, provenance, training
from test_report_page import HOSTILE, data_of, draw_everything, into_view, opened, silent, until

from contactlearn.__main__ import main
from contactlearn.core.errors import ContactLearnError
from contactlearn.core.serialisation import to_json
from contactlearn.diagnosis import result
from contactlearn.effects import EffectId
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.report.figures.style import law_style
from contactlearn.report.page.runs import write_runs
from contactlearn.report.text.sentences import conclusion
from contactlearn.results.types import DiagnosisRun

METRIC = "mass_error"


def interval(mean):
    return {"mean": mean, "low": 0.9 * mean, "high": 1.1 * mean}


def trained(**settings):
    """results.json of a training as plain objects."""
    return json.loads(to_json(training(**settings)))


def evaluated(**settings):
    """results.json of an evaluation as plain objects."""
    return json.loads(to_json(evaluation(**settings)))


def changed(content, *path, to):
    """A copy of plain objects with another entry at a path."""
    content = json.loads(json.dumps(content))
    *first, last = path
    part = content
    for key in first:
        part = part[key]
    part[last] = to
    return content


def diagnosed(names=("spin_damping:after",), first=0.3, law="wang_mason", **data):
    """diagnosis.json as plain objects."""
    of = lambda mean: Interval(**interval(mean))  # noqa: E731
    effects = tuple(map(EffectId.parse, names))
    missing = tuple(
        result.MissingEffect(
            effect=effect, equation="", parameters=(), error_before=of(0.2), error_after=of(0.1), error_reduction=0.1,
            share=1.0, confidence=1.0, level=result.Level.FOUND, inadmissible_before=0.0, inadmissible_after=0.0,
        )
        for effect in effects
    )  # fmt: skip
    kinds = (
        result.RungKind.LAW,
        *[result.RungKind.EFFECT] * len(names),
        result.RungKind.PROCESSES,
        result.RungKind.NOISE,
    )
    errors = [of(first / (k + 1)) for k in range(len(kinds))]
    rungs = zip(kinds, (None, *effects, None, None), errors, strict=True)
    budget = result.ErrorBudget(
        base=errors[0], ceiling=errors[1], bound=of(0.01), named=errors[len(names)], flexible=errors[-2],
        noise=errors[-1], noise_source=result.NoiseSource.STATED,
        shares=result.ErrorShares(noise=0.2, explained=0.5, unnamed=0.0, unexplained=0.3, beyond_rigid=0.0),
    )  # fmt: skip
    verdict = result.Verdict.EFFECTS if names else result.Verdict.NONE
    found = result.Diagnosis(
        verdict=verdict, physics=verdict, law=law, variant="textbook", findings=(), missing=missing, budget=budget,
        ladder=tuple(result.Rung(kind=kind, effect=effect, error=error) for kind, effect, error in rungs),
    )  # fmt: skip
    return ran(found, **data)


def ran(found, **data):
    """A diagnosis with its provenance as plain objects."""
    about = provenance({"effect": {}, "law": "best"}, **data)
    return json.loads(to_json(DiagnosisRun(provenance=about, use="contactlearn evaluate", diagnosis=found)))


def leave(folder, content, page=False):
    """A run folder."""
    folder.mkdir(parents=True)
    name = "diagnosis.json" if "diagnosis" in content else "results.json"
    (folder / name).write_text(content if isinstance(content, str) else json.dumps(content))
    if page:
        (folder / "report.html").write_text("its own")
    return folder


def row(text, name):
    """Cells of a run's row by the names of their columns."""
    head, body = re.search(r'<table id="runs">(.*?)</table>', text, re.S)[1].split("<tbody>")
    columns = [html.unescape(one) for one in re.findall(r"<button[^>]*>(.*?)</button>", head)]
    for line in body.split("<tr ")[1:]:
        cells = [html.unescape(re.sub("<.*?>", "", one)) for one in re.findall(r"<t[hd].*?>(.*?)</t[hd]>", line, re.S)]
        if cells[0] == name:
            return dict(zip(columns, cells, strict=True))
    raise KeyError(name)


def written(x):
    """An interval as the page writes it."""
    return f"{x['mean']:.4f} ({x['low']:.4f}–{x['high']:.4f})"


def text_of(folder):
    """The page over the runs in a folder."""
    return write_runs([folder])[0].read_text()


@pytest.fixture(scope="module")
def sweep(tmp_path_factory):
    """A real sweep with its page."""
    folder = tmp_path_factory.mktemp("sweep")
    small = ("data.size=80", "model=analytical", "train.repetitions=1", "bootstrap=20")
    words = ("train.size=10,40", "law=wang_mason,whittaker", f"hydra.sweep.dir={folder}")
    run("train.py", "-m", *small, *words)
    return run("contactlearn", "report", str(folder)), folder


@pytest.fixture(scope="module")
def mixed(tmp_path_factory):
    """Runs of every command on two sets of data, names that try to be markup or a script, and what is no run."""
    folder = tmp_path_factory.mktemp("mixed")
    leave(folder / "b10", trained(effects=["surface_tilt"], error=0.15))
    leave(folder / "b9", trained(error=0.4))
    leave(folder / "evaluation", evaluated(), page=True)
    leave(folder / "javascript:alert(1)" / "#<b>?%41", diagnosed(), page=True)
    two = leave(folder / "two", diagnosed(("surface_tilt", "spin_damping"), 0.6, sha256="b" * 64, source=HOSTILE))
    own = json.loads((two / "diagnosis.json").read_text())
    hostile = HOSTILE.replace(":", "")  # which the name of an effect must not have
    for one in (own["diagnosis"]["missing"][1], own["diagnosis"]["ladder"][2]):
        one["effect"]["name"] = hostile
    own["provenance"]["config"] |= {HOSTILE: HOSTILE, "law": HOSTILE}
    own["diagnosis"]["law"] = HOSTILE
    (two / "diagnosis.json").write_text(json.dumps(own))
    leave(folder / "cut", '{"diagnosis": ')
    (folder / "failed" / ".hydra").mkdir(parents=True)
    page, runs, skipped = write_runs([folder])
    return page, runs, dict(skipped)


def test_numbers_of_a_real_sweep(sweep):
    printed, folder = sweep
    assert "4 runs" in printed
    text = (folder / "report.html").read_text()
    jobs = [path.parent.name for path in folder.glob("*/results.json")]
    assert len(jobs) == 4
    for job in jobs:
        results = json.loads((folder / job / "results.json").read_text())
        (law, error), cells = next(iter(results["errors"].items())), row(text, job)
        assert cells["Held-out mass error"] == written(error[METRIC])
        assert cells["train.size"] == str(results["provenance"]["config"]["train"]["size"])
        assert cells["Law"].lower().replace("–", "_") == law
    columns = {"Run", "Held-out mass error", "train.size", "Law", "IRB bound"}
    assert set(row(text, jobs[0])) == columns  # the rest does not differ
    shared = html.unescape(re.search(r'id="shared">(.*?)</table>', text, re.S)[1])
    assert '<th scope="row">data.size</th><td>80</td>' in shared
    assert results["provenance"]["data"]["sha256"] in text
    assert "cannot be compared" not in text
    lines = {line["label"]: line for line in data_of(folder / "report.html")["curves"]}
    assert set(lines) == {"Wang–Mason", "Whittaker"}
    for place, law in ((place, law) for place in (0, 1) for law in ("wang_mason", "whittaker")):
        (job,) = folder.glob(f"train.size={(10, 40)[place]},law={law}-*")
        error = json.loads((job / "results.json").read_text())["errors"][law][METRIC]
        line = lines[law_style(law).label]
        assert line["sizes"] == [10, 40]
        assert line["intervals"][place] == pytest.approx(error, rel=1e-7)


def test_learning_curves_with_bounds(tmp_path):
    """Other settings and other data make other lines; a bound that is the same in all runs is level."""
    for k, size in enumerate((20, 50)):
        leave(tmp_path / f"train_{k}", trained(size=size, error=0.2 / (k + 1)))
        leave(tmp_path / f"tilt_{k}", trained(size=size, effects=["surface_tilt"], error=0.1 / (k + 1)))
        leave(tmp_path / f"other_{k}", trained(size=size, sha256="b" * 64))
        leave(tmp_path / f"evaluate_{k}", evaluated(size=size))
    content = data_of(write_runs([tmp_path])[0])
    lines = content["curves"]
    by_label = {line["label"]: line for line in lines}
    tilt = by_label[f"Mirtich, effects surface tilt, train.py, drops {'a' * 10}"]
    assert [x["mean"] for x in tilt["intervals"]] == pytest.approx([0.1, 0.05])
    assert [line["level"] for line in lines if line["label"] in ("Best Post Hoc", "IRB bound")] == [True, True]
    assert by_label["IRB bound"]["intervals"][0]["mean"] == 0.05
    trains = [line for line in lines if line["label"].startswith("Mirtich")]
    assert len(trains) == 4  # without and with the effect, on other data, and of the evaluations
    drawn = [one for one in content["figures"]["curve"]["data"] if one["name"].startswith("Mirtich")]
    assert len({one["line"]["color"] for one in drawn}) == len(drawn) == 4


def test_runs_are_compared_in_the_error_that_they_share(tmp_path):
    """Their headline; of both norms the mass error, in which the Euclidean bounds are none."""
    for name, norms in (("euclidean", ("euclidean",)), ("both", ("euclidean", "mass"))):
        for norm in norms:
            leave(tmp_path / name / norm, evaluated(norm=norm))
    assert {"Held-out Euclidean error", "IRB bound"} <= row(text_of(tmp_path / "euclidean"), "euclidean").keys()
    text = text_of(tmp_path / "both")
    assert "Their bounds are of different norms" in html.unescape(text)
    cells = {norm: row(text, norm) for norm in ("euclidean", "mass")}
    assert cells["euclidean"]["Held-out mass error"] == cells["mass"]["Held-out mass error"]
    assert cells["euclidean"]["IRB bound"] == "–" != cells["mass"]["IRB bound"]


def test_every_command_has_its_numbers(mixed, capsys):
    page, runs, skipped = mixed
    text = page.read_text()
    assert [one.name for one in runs][:3] == ["b9", "b10", "evaluation"]
    own = diagnosed()["diagnosis"]
    cells = row(text, "javascript:alert(1)/#<b>?%41")
    assert cells["Held-out mass error"] == written(own["ladder"][1]["error"])
    for column, part in {"Law alone": "base", "Noise floor": "noise", "IRB bound": "bound"}.items():
        assert cells[column] == written(own["budget"][part])
    assert (cells["Verdict"], cells["Missing effects"]) == ("effects are missing", "spin damping (after)")
    assert (cells["Command"], cells["Trials"], cells["SHA-256 of the data"]) == ("diagnose", "200", "a" * 10)
    assert (cells["spin damping"], cells["surface tilt"]) == ("✓ found", "")
    assert row(text, "b10")["surface tilt"] == "✓ "
    for run_name, column, error in (
        ("b10", "Held-out mass error", 0.15),
        ("b10", "Law alone", 1.5 * 0.15),
        ("b10", "IRB bound", 0.05),
        ("evaluation", "Held-out mass error", 0.2),
        ("evaluation", "IRB bound", 0.05),
    ):
        assert row(text, run_name)[column] == written(interval(error))
    for step in own["ladder"]:
        assert f'<td class="value">{written(step["error"])}</td>' in text
    assert "on 2 different sets of data, so their errors cannot be compared" in text
    assert "cross-validated over all trials" in text
    assert "<script>window" not in text
    assert "<img" not in text
    assert html.escape("javascript:alert(1)/#<b>?%41") in text
    links = [link for link in re.findall(r'<a href="([^"]*)"', text) if not link.startswith("#")]
    assert len(links) == 2
    for link in links:
        assert link.startswith("./")
        assert not set(link) & set(":#?<>")
        assert (page.parent / unquote(link)).read_text() == "its own"
    loads = re.findall(r"(?:src|action|data)\s*=\s*[\"']([^\"']*)", re.sub("<script.*?</script>", "", text, flags=re.S))
    assert not loads
    assert "default-src 'none'" in text
    assert len(runs) == 5
    assert "is not JSON, or was cut off" in skipped["cut (diagnosis.json)"]
    assert "the run failed or was stopped" in skipped["failed"]
    assert "<strong>failed</strong>: has neither" in page.read_text()
    assert main(["report", str(page.parent)]) == 0
    printed = capsys.readouterr().out
    assert "left out failed: has neither" in printed
    assert "5 runs, 2 left out" in printed


def test_settings_that_only_some_runs_have(tmp_path):
    """Those of another command or another source are no difference; those of the same kind of run are."""
    leave(tmp_path / "a", trained())
    other = trained() | {"learned": "x1_wrench", "law": None}
    other["provenance"]["config"] |= {
        "reference": {"mirtich": {"mu": 0.1}},
        "model": {"x1_wrench": {"law": None, "target": "wrench"}},
    }
    leave(tmp_path / "b", other)
    leave(tmp_path / "c", diagnosed())
    text = text_of(tmp_path)
    cells = row(text, "b")
    assert cells["reference"] == '{"mirtich": {"mu": 0.1}}'
    assert cells["model"] == cells["Model"].replace("X1 → wrench", "x1_wrench") == "x1_wrench"
    assert row(text, "a")["reference"] == row(text, "c")["model"] == "–"
    assert "train.size" not in cells  # 20 in all that have it


def test_data_that_had_to_be_corrected_have_a_verdict(tmp_path):
    finding = result.Finding(name="mirrored_x", sentence="", evidence=(), correction="mirrored_x")
    conclusions = (result.Verdict.NONE, result.Verdict.EFFECTS, result.Verdict.UNKNOWN, None)
    for physics in conclusions:
        found = result.Diagnosis(
            verdict=result.Verdict.BAD_DATA, physics=physics, law="mirtich", variant="textbook", findings=(finding,)
        )
        leave(tmp_path / f"{physics}", ran(found))
    text = text_of(tmp_path)
    for physics in conclusions:
        assert row(text, f"{physics}")["Verdict"] == conclusion(result.Verdict.BAD_DATA, physics, ("mirrored_x",))
    leave(
        tmp_path / "refused",
        ran(result.Diagnosis(verdict=result.Verdict.BAD_DATA, law=None, variant=None, findings=())),
    )
    cells = row(text_of(tmp_path), "refused")
    assert (cells["Held-out mass error"], cells["Verdict"]) == ("–", conclusion(result.Verdict.BAD_DATA, None))


LEARNT = json.loads(to_json(learning_curve((1,), (0.1,))))
ERROR = ("errors", "mirtich", METRIC)
DAMAGED = {
    "empty": ("", "is not JSON"),
    "foreign": ({"scores": [1, 2]}, "kind is not there"),
    "another kind": ({"kind": "dream"}, "kind: invalid enum value 'dream'"),
    "diagnosis": (trained() | {"kind": "diagnosis"}, "is not there"),
    "no hash": (changed(trained(), "provenance", "data", to={"source": "x", "trials": 3}), "sha256 is not there"),
    "no provenance": ({"kind": "training"}, "provenance is not there"),
    "no errors": (trained() | {"errors": {}}, "a model must be one of those in errors (none)"),
    "negative": (changed(trained(), *ERROR, "low", to=-1), "errors.mirtich: mass_error must be a number, 0 or more"),
    "errors a list": (trained() | {"errors": [1]}, "errors: expected object"),
    "deep": ("[" * 100_000, "is nested too deeply"),
    "transfer": (
        {"kind": "transfer", "norm": "mass", "provenance": trained()["provenance"], "sizes": [1], "transfer": {}},
        "is a transfer to other bodies"),
    "curves": (changed(evaluated(), "learning_curves", to={"m": {**LEARNT, "sizes": [1, 2]}}),
        "learning_curves.m: 2 sizes and 1 errors must be as many"),
    "verdict": (changed(diagnosed(), "diagnosis", "verdict", to="sure"), "diagnosis.verdict: invalid enum value"),
    "budget": (changed(diagnosed(), "diagnosis", "budget", "base", "low", to=-1.0),
        "an error of the diagnosis must be"),
    "missing": (changed(diagnosed(), "diagnosis", "missing", to=["tilt"]), "diagnosis.missing.0: expected object"),
}  # fmt: skip


@pytest.fixture(scope="module")
def damaged(tmp_path_factory):
    """A folder with each of the damaged files beside a good one, the runs of its page, and why others are left out."""
    folder = tmp_path_factory.mktemp("damaged")
    for name, (content, _) in DAMAGED.items():
        leave(folder / name / "run", content)
    leave(folder / "good", trained())
    _, runs, skipped = write_runs([folder])
    return folder, runs, {name.partition("/")[0]: reason for name, reason in skipped}


@pytest.mark.parametrize(("name", "reason"), [(name, reason) for name, (_, reason) in DAMAGED.items()], ids=DAMAGED)
def test_damaged_files_are_left_out(name, reason, damaged, capsys):
    folder, runs, left_out = damaged
    assert main(["report", str(folder / name)]) == 2
    printed = capsys.readouterr()
    assert printed.err.startswith("error: no run can be read in")
    assert reason in printed.err
    assert not list((folder / name).rglob("*.html"))
    assert [one.name for one in runs] == ["good"]
    assert reason in left_out[name]


def test_not_utf8(tmp_path):
    leave(tmp_path / "good", trained())
    (leave(tmp_path / "latin", "") / "results.json").write_bytes(b'{"\xe4": 1}')
    os.mkdir(os.fsencode(tmp_path) + b"/\xff\x1b[31m")
    with open(os.fsencode(tmp_path) + b"/\xff\x1b[31m/results.json", "w") as file:
        json.dump(trained(), file)
    page, runs, skipped = write_runs([tmp_path])
    assert {one.name for one in runs} == {"good", "  [31m"}
    assert skipped[0][0] == "latin (results.json)"
    assert "\ufffd" not in page.read_text(encoding="utf-8")


def test_where_the_page_goes(tmp_path, monkeypatch):
    one = leave(tmp_path / "one", trained(), page=True)
    leave(tmp_path / "two", trained())
    assert write_runs([tmp_path])[0] == tmp_path / "report.html"
    assert write_runs([tmp_path])[0] == tmp_path / "report.html"  # its own page it does replace
    monkeypatch.chdir(tmp_path)
    (tmp_path / "report.html").unlink()
    assert write_runs([one])[0] == tmp_path / "report.html"
    assert write_runs([one, tmp_path / "two"], "both.html")[0] == tmp_path / "both.html"
    assert len(write_runs([one, tmp_path], "both.html")[1]) == 2  # none twice
    monkeypatch.chdir(one)
    for out in (None, "report.html", one / "report.html"):
        with pytest.raises(ContactLearnError, match="is the page of the run in that folder"):
            write_runs([one], out)
    (tmp_path / "notes.html").write_text("mine")
    for out, reason in {
        "results.json": "must be an .html file",
        "no/folder.html": "no such folder",
        str(tmp_path / "notes.html"): "is no page over several runs",
    }.items():
        with pytest.raises(ContactLearnError, match=reason):
            write_runs([one], out)
    assert (one / "report.html").read_text() == "its own"
    assert (tmp_path / "notes.html").read_text() == "mine"
    with pytest.raises(ContactLearnError, match="no such folder"):
        write_runs([tmp_path / "nowhere"])
    (tmp_path / "empty").mkdir()
    with pytest.raises(ContactLearnError, match=r"neither diagnosis\.json nor results\.json is there"):
        write_runs([tmp_path / "empty"])


def test_help(capsys):
    with pytest.raises(SystemExit, match="0"):
        main(["report", "--help"])
    printed = " ".join(capsys.readouterr().out.split())
    assert "--out FILE" in printed
    assert "examples: contactlearn report" in printed


def order(browser):
    return browser.execute_script(
        "return [...document.querySelectorAll('#runs tbody tr:not([hidden])')].map(one => one.cells[0].textContent)"
    )


def press(browser, column):
    """A click on the button of a column; how it is sorted then."""
    return browser.execute_script(
        "const head = [...document.querySelectorAll('#runs thead th')].find(one => one.textContent === arguments[0]);"
        "head.querySelector('button').click(); return head.getAttribute('aria-sort')",
        column,
    )


def test_runs_are_drawn_in_silence(browser, mixed):
    shown = opened(browser, mixed[0])
    draw_everything(shown)
    assert "5 runs, the least of b10 with 0.1500" in shown.execute_script(
        "return document.getElementById('by-run').getAttribute('aria-label')"
    )
    assert nothing_sticks_out(shown)
    assert silent(shown)
    shown, names = opened(browser, mixed[0]), [one.name for one in mixed[1]]
    error = {one.name: one.error(METRIC).mean for one in mixed[1]}
    assert order(shown) == names
    assert press(shown, "Held-out mass error") == "ascending"
    assert order(shown) == sorted(names, key=error.get)
    assert press(shown, "Held-out mass error") == "descending"
    assert order(shown) == sorted(names, key=error.get, reverse=True)
    into_view(shown, "by-run")
    worst = f"document.querySelector('#by-run .ytick title').textContent.endsWith({json.dumps(order(shown)[0])})"
    assert until(shown, worst)
    noise = {one.name: x.mean for one in mixed[1] if (x := one.error(METRIC, "noise"))}
    for direction in (False, True):  # those without stay at the end
        press(shown, "Noise floor")
        assert order(shown)[: len(noise)] == sorted(noise, key=noise.get, reverse=direction)
    press(shown, "Run")
    assert order(shown) == names
    assert silent(shown)


def test_a_sweep_is_drawn_in_silence(browser, sweep):
    shown = opened(browser, sweep[1] / "report.html")
    draw_everything(shown)
    assert shown.execute_script("return document.getElementById('curve').data.length") == 4  # two lines, two bands
    assert silent(shown)


def test_runs_are_labelled_by_their_differences(browser, tmp_path):
    content = trained()
    for size in (20, 40):
        for law in ("wang_mason", "mirtich"):
            one = changed(content, "provenance", "config", "train", to={"size": size})
            leave(tmp_path / f"train.size={size},law={law}-90086986c6fb", changed(one, "law", to=law))
    page, _, _ = write_runs([tmp_path])
    shown = opened(browser, page)
    draw_everything(shown)
    assert until(shown, "document.querySelectorAll('#by-run .ytick title').length === 4")
    names = shown.execute_script("return document.querySelector('#by-run').layout.yaxis.ticktext")
    laws = ("mirtich", "wang_mason")
    assert names in (
        [f"law {law}, size {size}" for size in (20, 40) for law in laws],  # or where it is narrow
        [f"{law}, {size}" for size in (20, 40) for law in laws],
    )
    told = shown.execute_script("return document.querySelector('#by-run .ytick title').textContent")
    assert told == "law mirtich\nsize 20\ntrain.size=20,law=mirtich-90086986c6fb"
    assert silent(shown)


def test_filtering_by_effect(browser, mixed):
    shown = opened(browser, mixed[0])
    has = {one.name: {effect.name for effect in (*one.given, *one.found)} for one in mixed[1]}
    effects = shown.execute_script("return page.effects.map(one => one.name)")
    assert set(effects) == set().union(*has.values())

    def choose(effect, how):
        shown.execute_script(
            "const list = document.querySelector(`[data-effect='${arguments[0]}']`); list.value = arguments[1];"
            "list.dispatchEvent(new Event('change'))",
            effects.index(effect),
            how,
        )
        return order(shown)

    assert choose("surface_tilt", "with") == [name for name in has if "surface_tilt" in has[name]] == ["b10", "two"]
    assert "2 of 5 runs" in shown.execute_script("return document.getElementById('shown').textContent")
    ladders = "[...document.querySelectorAll('[data-ladder]')].filter(one => !one.hidden).map(one => one.textContent)"
    assert len(shown.execute_script(f"return {ladders}")) == 1
    into_view(shown, "by-run")
    assert until(shown, "document.querySelector('#by-run').layout.yaxis.ticktext.length === 2")
    assert choose("spin_damping", "without") == ["b10", "two"]
    assert choose("surface_tilt", "without") == ["b9", "evaluation"]
    assert choose("spin_damping", "with") == ["javascript:alert(1)/#<b>?%41"]
    choose("spin_damping", "")
    assert len(choose("surface_tilt", "")) == 5
    assert silent(shown)
