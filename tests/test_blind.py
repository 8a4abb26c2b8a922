"""Blind sets are unchanged, answers are scored by the protocol, and an interrupted run resumes."""

import hashlib
import json
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import torch
from diagnoses import few

from contactlearn import diagnose
from contactlearn.diagnosis.options import DiagnoseOptions
from contactlearn.diagnosis.result import Coefficient, LaggedVariable
from contactlearn.effects import EffectId, catalogue
from contactlearn.effects.formula.symbols import SYMBOLS
from contactlearn.laws import find
from contactlearn.mechanics.shapes import shape_entries
from contactlearn.simulation import synthetic

sys.path.append(str(Path(__file__).parent.parent / "benchmarks"))
from blind import calibrate, load, planted, report, run
from blind.judge import Answer, Score, answer_of, read_truth, score

if not load.DATA.exists():
    pytest.skip("the blind sets are in the repository, not in the source package", allow_module_level=True)

SIZES = {
    "independent": 364,
    "author_a": 48,
    "author_b": 30,
    "author_c": 56,
    "author_d": 64,
    "author_e": 48,
    "author_f": 32,
    "author_g": 60,
    "author_h": 56,
    "author_i": 24,
    "author_j": 28,
    "author_k": 20,
    "author_l": 24,
    "author_n": 24,
    "author_o": 24,
    "author_q": 24,
    "author_r": 20,
}
TRUTHS = {suite: read_truth(suite) for suite in load.SUITES}
QUESTIONS = {"effects", "nothing", "unknown", "confounded", "measurement", "includes", "ordered", "unjudged"}


def test_suites_are_known_by_name():
    assert {path.name for path in load.DATA.iterdir()} == set(load.SUITES) == set(SIZES)
    with pytest.raises(ValueError, match="no suite 'author_z'; there are independent, author_a"):
        load.read_suite("author_z")


@pytest.mark.parametrize("suite", load.SUITES)
def test_files_are_unchanged(suite):
    header = load.read_suite(suite)
    files = {path.name: path.read_bytes() for path in (load.DATA / suite).glob("*.parquet")}
    assert {name: hashlib.sha256(content).hexdigest() for name, content in files.items()} == header["sha256"]
    assert header["suite"] == suite
    assert all(header[name] for name in ("author", "method", "written", "frozen", "seed", "format"))
    counts = pd.concat([pd.read_parquet(load.DATA / suite / name, columns=["set"]) for name in files]).value_counts(
        "set"
    )
    assert counts.to_dict() == {name: one.n for name, one in load.blind_sets(suite).items()}
    assert len(counts) == SIZES[suite]


@pytest.mark.parametrize("suite", load.SUITES)
def test_simulated_sets_load_as_declared(suite):
    """One in five: their files are unchanged."""
    for one in [*load.blind_sets(suite).values()][::5]:
        if one.measured is not None:
            continue
        impacts = load.load(one)
        assert (len(impacts), impacts.validate, impacts.source) == (one.n, False, f"{suite}/{one.name}")
        if one.shape is None:
            assert impacts.shape is None
        elif "kind" in one.shape:
            assert json.loads(json.dumps(shape_entries(impacts.shape))) == one.shape
        else:
            assert set(impacts.object) <= set(one.shape) == set(impacts.shape)


def test_numbers_of_a_set_are_the_laboratory_s():
    """The decimals of the author's files, which single precision keeps."""
    first = load.load(load.blind_sets("author_a")["06"])[[0]]
    assert first.object == ("square",)
    assert first.v_pre.tolist() == [[-0.051432, -1.77584, -0.565614]]
    assert first.v_post.tolist() == [[-0.58409, 0.0762809, 33.6756]]
    assert first.q.tolist() == [[-0.296359, 0.0364935, -1.82017]]
    assert (first.r.tolist(), first.mass.item(), first.inertia.item()) == ([[0.0216682, -0.0364759]], 0.08, 4.8e-05)
    one = load.blind_sets("author_d")["12"]
    impacts = load.load(one)
    corners = torch.tensor(one.shape["vertices"], dtype=torch.float64)
    c, s = impacts.q[:, 2].cos()[:, None], impacts.q[:, 2].sin()[:, None]
    heights = s * corners[:, 0] + c * corners[:, 1]
    assert torch.allclose(impacts.r[:, 1], heights.min(1).values, atol=1e-12)


def test_a_hidden_effect_on_published_drops_changes_their_outcome_alone(ellipse_drops, monkeypatch):
    monkeypatch.setattr(load.ellipse_drops, "load", lambda **_: ellipse_drops)
    monkeypatch.setattr(load, "_rows", lambda one, file: rows[one.name].assign(row=np.arange(60)))
    sets = {name: replace(one, n=60) for name, one in load.blind_sets("independent").items() if one.measured}
    whole = pd.read_parquet(load.DATA / "independent" / "planted.parquet")
    rows = {name: some.head(60) for name, some in whole.groupby("set")}
    load._ellipse_drops.cache_clear()
    plain, dragged = (load.load(sets[f"published-{seed}"]) for seed in (11012, 11000))
    load._ellipse_drops.cache_clear()
    assert torch.equal(plain.v_pre, dragged.v_pre)
    assert torch.equal(plain.v_pre[:, 1], ellipse_drops.v_pre[:60, 1])
    assert torch.equal(plain.v_post[:, 1], ellipse_drops.v_post[:60, 1])
    change = rows["published-11000"][["vx_post", "vy_post", "omega_post"]].to_numpy()
    assert torch.allclose(dragged.v_post - plain.v_post, torch.tensor(change, dtype=torch.float64))
    assert plain.wrench[:, 2].abs().mean() < 0.5 * ellipse_drops[:60].wrench[:, 2].abs().mean()  # momentum closes


@pytest.mark.parametrize("suite", load.SUITES)
def test_the_truth_speaks_the_words_of_the_package(suite):
    sets = load.read_suite(suite)["sets"]
    for name, truth in TRUTHS[suite].items():
        assert truth.question in QUESTIONS, name
        assert truth.right | {*truth.tolerated, *truth.ignored} <= set(catalogue())
        assert truth.coefficient in (*Coefficient, None)
        assert set(truth.variables) <= set(SYMBOLS)
        assert set(truth.follows) <= set(LaggedVariable)
        assert bool(truth.accepted) == (truth.question in ("effects", "confounded", "includes", "ordered")) or (
            truth.question == "unknown" and suite == "author_b"
        )
        assert (truth.question == "measurement") == (truth.bad_data is True)
        if suite == "independent":
            assert truth.half == ("learn", "report")[sets[name]["seed"] % 2]
        elif suite.startswith("author_") and suite > "author_d":
            assert truth.half == ("learn", "report")[int(name) % 2]
        else:
            assert truth.half is None


def test_forms_by_another_author_are_only_reported():
    halves = {}
    for truth in TRUTHS["independent"].values():
        halves.setdefault(truth.group, set()).add(truth.half)
    for group, found in halves.items():
        assert found == ({"report"} if group.startswith("other_") else {"learn", "report"}), group


def scored(suite, name, *effects, truth=None, verdict="effects", **more) -> Score:
    """Score an answer with these names."""
    more = {"confidence": [0.9] * len(effects)} | more
    answer = Answer(suite=suite, name=name, verdict=verdict, effects=list(effects), **more)
    return score(answer, truth or TRUTHS[suite][name])


def test_known_effects():
    pair = ["location_dependent_restitution", "com_offset"]
    right = scored("author_a", "04", *pair)
    assert (right.first, right.exact, right.simpler, right.bad_data, right.false_unknown) == (True,) * 4 + (False,)
    assert right.named == ((0, True), (1, True))
    many = scored("author_a", "04", *pair, "adhesion", simpler=pair)
    assert (many.first, many.exact, many.simpler) == (True, False, True)
    wrong = scored("author_a", "04", "adhesion")
    assert (wrong.first, wrong.exact, wrong.simpler, wrong.named) == (False, False, False, ((0, False),))
    assert not scored("author_a", "04", verdict="none").first
    assert scored("author_c", "13", verdict="unknown").false_unknown
    truth = replace(TRUTHS["author_a"]["04"], accepted=(("a",), ("b", "c")))
    assert scored("author_a", "04", "c", "a", truth=truth).exact
    assert not scored("author_a", "04", "c", "b", truth=truth).exact
    truth = replace(TRUTHS["author_a"]["04"], accepted=(("a",), ("b",)))
    assert scored("author_a", "04", "d", truth=truth).plausible is None
    assert scored("author_a", "04", "d", truth=truth, models=[["d"], ["b", "a"]]).plausible
    assert scored("author_a", "04", "d", truth=truth, models=[["d"]], simpler=["a", "b"]).plausible
    assert not scored("author_a", "04", "d", truth=truth, models=[["d"]]).plausible
    name, truth = next(
        (name, one) for name, one in TRUTHS["independent"].items() if one.accepted == [["shape_error", "corner_radius"]]
    )
    found = scored("independent", name, "corner_radius", models=[["corner_radius"]], truth=truth)
    assert (found.first, found.exact, found.plausible, found.named) == (True, True, True, ((0, True),))


@pytest.mark.parametrize(("suite", "name", "effects", "expected"), [
    ("author_c", "02", ["configuration_dependent_restitution"], (True, True)),
    ("author_c", "02", ["orientation_dependent_restitution"], (True, True)),  # acceptable
    ("author_c", "53", ["orientation_dependent_restitution"], (False, False)),
    ("author_c", "51", ["parameter_drift", "sampling_delay", "gravity_impulse"], (True, True)),
    ("author_c", "51", ["adhesion", "gravity_impulse", "sampling_delay"], (True, False)),
    ("author_d", "13", ["tangential_restitution", "side_drag"], (True, True)),
    ("author_d", "13", ["incidence_dependent_restitution", "side_drag"], (False, False)),
    ("author_d", "47", ["contact_patch", "body_dependent_restitution", "body_dependent_friction"], (True, True)),
])  # fmt: skip
def test_names_of_authors_sets(suite, name, effects, expected):
    found = scored(suite, name, *effects)
    assert (found.first, found.exact) == expected


def test_nothing_hidden():
    silent = scored("author_c", "08", verdict="none")
    assert (silent.no_false_name, silent.false_unknown, silent.first) == (True, False, None)
    assert scored("author_c", "08", verdict="unknown").false_unknown
    assert not scored("author_c", "08", "adhesion").no_false_name
    name = next(name for name, one in TRUTHS["independent"].items() if one.group == "several_bodies")
    bodies = scored("independent", name, "body_dependent_friction", models=[["body_dependent_friction"]])
    assert (bodies.no_false_name, bodies.plausible, bodies.named) == (True, True, ())
    assert not scored("independent", name, "adhesion").no_false_name


def test_confounded_effects():
    drift = scored("author_a", "15", "parameter_drift", rivals=[["velocity_dependent_restitution"]])
    assert (drift.first, drift.exact, drift.confounded) == (True, True, True)
    assert not scored("author_a", "15", "parameter_drift", rivals=[[]]).confounded
    models = {"rivals": [[]], "models": [["velocity_dependent_restitution"]]}
    assert not scored("author_a", "15", "parameter_drift", **models).confounded  # the suite asks for the rivals
    name = "confounded-8000"
    assert scored("independent", name, "parameter_drift", **models).confounded
    assert not scored("independent", name, "parameter_drift", "adhesion", **models).exact


def test_faults_of_measurement():
    mirrored = scored("author_a", "08", verdict="bad_data", corrections=["mirrored_omega"])
    assert (mirrored.bad_data, mirrored.correction) == (True, True)
    assert not scored("author_a", "31", verdict="bad_data", corrections=["inertia_scaled"]).correction
    missed = scored("author_a", "33", "adhesion")
    assert (missed.bad_data, missed.correction) == (False, None)
    assert not scored("author_a", "04", verdict="bad_data").bad_data
    assert scored("author_a", "02", verdict="bad_data").bad_data is None  # errors are correlated: either is right


def test_measured_sets():
    sets = TRUTHS["independent"]
    name = next(name for name, one in sets.items() if one.question == "includes")
    assert scored("independent", name, "adhesion", *sets[name].accepted[0]).first
    assert not scored("independent", name, "adhesion").first
    part = {"taken": 0.9, "error": 0.06, "able": 1.0, "off": 3.0}
    taken = scored("independent", name, planted={sets[name].accepted[0][0]: part})
    assert (taken.planted, taken.parameters, scored("independent", name).planted) == (True, False, False)
    plain = next(name for name, one in sets.items() if one.question == "unjudged")
    assert scored("independent", plain, "adhesion") == Score()
    bounces = next(name for name, one in sets.items() if one.question == "ordered")
    story = ["tangential_restitution", "velocity_dependent_restitution"]
    assert scored("independent", bounces, *story, "adhesion").exact
    backwards = scored("independent", bounces, *story[::-1])
    assert (backwards.first, backwards.exact) == (False, False)


def test_a_planted_effect_counts_beside_one_of_the_same_kind(monkeypatch):
    """Drops that gain speed of their own lose less than was planted, but what they lose by it is all of that."""
    drops = synthetic.load(size=150, velocity_noise=0.003, spin_noise=0.1, seed=4)
    change = -0.1 * drops.v_post * torch.tensor([1.0, 1.0, 0.0], dtype=torch.float64)
    own = drops.v_post - 0.5 * change
    monkeypatch.setattr(planted, "load", lambda _: drops.replace(v_post=own + change))
    monkeypatch.setattr(planted, "planted_change", lambda _: change)
    drag = SimpleNamespace(effect=EffectId("side_drag", "linear"))
    found = SimpleNamespace(law="wang_mason", missing=(drag,), candidates=())
    part = planted.planted_parts(load.blind_sets("independent")["published-11000"], found)["side_drag"]
    assert part["off"] > 3
    assert part["taken"] == pytest.approx(part["able"], abs=2 * part["error"])
    assert part["able"] == pytest.approx(1, abs=0.02)
    assert all(p.low == 0 for p in catalogue()["side_drag"][0]().parameters)  # the bounds are as they were


def test_unknown_physics_of_the_state():
    right = scored("author_c", "43", verdict="unknown", variables=["vx", "theta"])
    assert right == Score(no_false_name=True, unknown=True, acceptable=True, dependence=True)
    for variables in ([], ["vx", "x", "theta"]):
        assert not scored("author_c", "43", verdict="unknown", variables=variables).dependence
    named = scored("author_c", "43", "orientation_dependent_restitution")
    assert (named.unknown, named.acceptable, named.named) == (False, True, ((0, True),))
    more = scored("author_c", "43", "orientation_dependent_restitution", "adhesion")
    assert (more.acceptable, more.no_false_name, more.named[1]) == (False, False, (1, False))
    assert not scored("author_c", "43", verdict="none").acceptable
    serial = {"coefficient": "eps", "follows": "order", "trials": 4.0, "share": 0.27}
    assert not scored("author_c", "43", verdict="unknown", serial_dependence=serial).dependence
    state = {"coefficient": "mu", "variables": ["rx", "y"], "share": 0.1}
    assert scored("author_d", "02", verdict="unknown", state_dependence=state).dependence
    assert not scored("author_d", "25", verdict="unknown", state_dependence=state).dependence
    name, truth = next((name, one) for name, one in TRUTHS["independent"].items() if one.group == "unknown")
    assert truth.variables
    found = scored("independent", name, verdict="bad_data", physics="unknown", variables=["m", truth.variables[0]])
    assert (found.unknown, found.dependence, found.acceptable) == (True, True, None)
    assert not scored("independent", name, verdict="unknown", physics=None).unknown
    named = scored("author_b", "29", "contact_patch")
    assert (named.first, named.unknown, named.follows, named.no_false_name) == (True, False, False, True)
    assert scored("author_b", "13", "adhesion", "surface_tilt", verdict="unknown").false_unknown


@pytest.mark.parametrize(("suite", "name", "changes", "expected"), [
    ("author_c", "55", {}, (True, True)),
    ("author_c", "55", {"coefficient": "eps"}, (True, False)),
    ("author_c", "55", {"trials": 94.0}, (True, False)),
    ("author_c", "55", {"coefficient": "eps", "follows": "spin"}, (False, False)),
    ("author_d", "63", {"coefficient": "eps", "follows": "normal_speed"}, (True, None)),  # no coefficient changes
    ("author_d", "63", {"coefficient": "eps", "follows": "spin"}, (False, None)),
    ("author_d", "56", {"coefficient": "eps", "trials": 41.03}, (True, True)),
    ("author_d", "56", {"coefficient": "eps", "trials": 20.5}, (True, False)),
    ("author_d", "22", {"coefficient": "eps", "follows": "place"}, (True, True)),
    ("author_d", "19", {"coefficient": "eps", "follows": "place"}, (True, False)),
    ("author_b", "26", {"coefficient": "eps", "trials": 4.0}, (True, True)),
    ("author_b", "26", {"trials": 4.0}, (True, False)),
    ("author_b", "26", {"coefficient": "eps", "trials": 8.0}, (True, False)),
    ("author_b", "24", {}, (None, None)),  # along no sequence
])  # fmt: skip
def test_unknown_serial_dependence(suite, name, changes, expected):
    serial = {"coefficient": "mu", "follows": "period", "trials": 46.0, "share": 0.27} | changes
    found = scored(suite, name, verdict="unknown", serial_dependence=serial)
    assert (found.dependence, found.follows) == expected
    assert found.unknown


def test_wilson_interval_equals_the_textbook():
    low, high = report.wilson(8, 10)
    assert (low, high) == (pytest.approx(0.4901, abs=1e-3), pytest.approx(0.9433, abs=1e-3))
    assert report.wilson(10, 10)[1] == pytest.approx(1.0)


def answer(name, *effects, suite="author_c", confidence=0.93, **more) -> Answer:
    """Make an answer with these names, all of one stated probability."""
    names = {"effects": list(effects), "forms": list(effects), "confidence": [confidence] * len(effects)}
    return Answer(suite=suite, name=name, **({"verdict": "effects" if effects else "none"} | names | more))


def test_the_tables_show_right_and_wrong_answers():
    serial = {"coefficient": "eps", "follows": "spin", "trials": 1.0, "share": 0.046}
    shown = report.report(
        [
            answer("55", serial_dependence=serial, variables=["vt", "x"]),
            answer("08"),
            answer("53", "adhesion"),
            answer("43", "adhesion", confidence=0.81),
        ]
    )
    header, _, *rows = (line.split(" | ") for line in shown.split("\n\n")[0].splitlines())
    groups = {row[0].removeprefix("| "): dict(zip(header, row, strict=True)) for row in rows}
    assert groups["nothing"]["no false name"].startswith("1/1")
    assert groups["all unknown physics"]["sets"] == "2"
    assert groups["one effect"]["exact set"].startswith("1/1")
    assert "| 0.9–1.0 | 0.930 | 1/1 (21–100 %) |  |  | 0.930 | 1/1 (21–100 %) |" in shown
    assert "| 0.8–0.9 |  |  | 0.810 | 0/1 (0–79 %) | 0.810 | 0/1 (0–79 %) |" in shown
    assert "| depends on vt, x; eps follows spin (4.6 %) | called unknown, " in shown
    assert "| 08 |" not in shown
    assert "| 53 |" not in shown
    assert report.report([]) == "no set is finished"
    shown = report.report(
        [
            answer("02", suite="author_d", verdict="unknown", candidates=["shape_error", "adhesion"]),
            answer("46", "contact_patch", suite="author_d", verdict="unknown"),
            answer("09", "spin_damping", suite="author_d"),
        ]
    )
    assert "| as named | 1 | 1/2" in shown
    assert "| with candidates | 3 | 0/2" in shown
    sets = [answer(f"single-{seed}", "adhesion", suite="independent", complete=False) for seed in (1000, 1001)]
    shown = report.report(sets)
    assert "| single-1000 | 300 | 0.50 | settles at speed" in shown
    assert "| single-1001 |" not in shown
    assert "| n ≥ 300, share ≥ 15 % | 0/1" in shown
    assert "| n ≤ 60, share ≥ 15 % | 0/1" in shown
    assert "ran out of time on 2 sets: single-1000, single-1001" in shown


def test_sets_are_chosen_evenly_from_all_groups():
    chosen = run.choose("independent", "learn", {"single", "none", "pair"}, set(), 6)
    groups = [TRUTHS["independent"][one.name].group for one in chosen]
    assert set(groups) == {"none", "pair", "single"}
    assert len(groups) == 6
    assert {one.half for one in chosen} == {"learn"}
    assert [one.name for one in run.choose("author_a", None, set(), {"16", "06"}, None)] == ["06", "16"]
    with pytest.raises(ValueError, match="no group wind in author_a; there are "):
        run.choose("author_a", None, {"wind"}, set(), None)
    with pytest.raises(ValueError, match="no set 99 in author_a; there are 01"):
        run.choose("author_a", None, set(), {"99"}, None)


@pytest.fixture
def stubbed(monkeypatch):
    """Answers without a diagnosis, in this process; the names of the sets."""
    names = []

    def ask(one, seconds, shapeless):
        names.append(one.name)
        return answer(one.name, suite=one.suite, seconds=seconds)

    monkeypatch.setattr(run, "ask", ask)
    monkeypatch.setattr(run, "ProcessPoolExecutor", lambda workers, mp_context, initializer: ThreadPoolExecutor(1))
    return names


def test_an_interrupted_run_resumes(stubbed, tmp_path, capsys):
    path = tmp_path / "answers.jsonl"
    command = ["--suite", "author_a", "--answers", str(path), "--seconds", "7"]
    run.main([*command, "--only", "06"])
    run.main([*command, "--only", "06", "10"])
    assert stubbed == ["06", "10"]
    assert [one["name"] for one in map(json.loads, path.read_text().splitlines())] == ["06", "10"]
    assert run.read(path)["author_a", "06"] == answer("06", suite="author_a", seconds=7.0)
    capsys.readouterr()
    run.main([*command, "--table"])
    assert stubbed == ["06", "10"]
    assert "| nothing | 1 | " in capsys.readouterr().out


def test_the_truth_is_opened_on_request_only(stubbed, capsys):
    run.main(["--suite", "author_a", "--only", "06", "--reveal"])
    assert json.loads(capsys.readouterr().out)["06"]["group"] == "nothing"
    with pytest.raises(SystemExit):
        run.main(["--suite", "author_a", "--only", "99"])
    assert "no set 99" in capsys.readouterr().err
    assert not stubbed


def test_a_diagnosis_is_written_down():
    one = load.blind_sets("author_a")["06"]
    found = diagnose(
        load.load(one),
        "wang_mason",
        options=DiagnoseOptions(candidates=few("adhesion", "spin_damping"), laws=[find("wang_mason")]),
    )
    written = answer_of("author_a", "06", found)
    assert Answer(**json.loads(json.dumps(asdict(written)))) == written
    assert (written.effects, written.verdict) == (list(found.effects), str(found.verdict))
    assert written.models
    assert len(written.removed) == len(written.shares) == len(written.confidence) == len(found.missing)
    assert score(written, TRUTHS["author_a"]["06"]).no_false_name


def test_a_failed_diagnosis_is_a_wrong_answer(monkeypatch):
    def fail(*_, **__):
        raise RuntimeError("no")

    monkeypatch.setattr(run, "diagnose", fail)
    failed = run.ask(load.blind_sets("author_a")["04"], 1.0)
    assert (failed.verdict, failed.error) == ("failed", "RuntimeError: no")
    assert not score(failed, TRUTHS["author_a"]["04"]).exact


def test_calibration_fits_the_odds_of_right_names():
    rng = np.random.default_rng(0)
    x = np.column_stack([np.ones(4000), rng.normal(0, 2, 4000), rng.integers(0, 2, 4000)])
    share, true = rng.uniform(0.5, 1, 4000), np.array([-0.5, 1.7, -1.0])
    y = (rng.random(4000) < calibrate.probabilities(x, share, true)).astype(float)
    assert calibrate.fit(x, share, y) == pytest.approx(true, abs=0.3)
    one = answer(
        "single-1000", "adhesion", suite="independent", shares=[0.5], removed=[0.22], reducible=0.2, trials=100
    )
    regressors, share, right = calibrate.design([one])
    assert regressors == pytest.approx(np.array([[1.0, 0.0, 0.0]]))
    assert (share.tolist(), right.tolist()) == ([0.5], [0.0])
