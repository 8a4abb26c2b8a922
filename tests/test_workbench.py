"""The workbench without a browser: addresses, lines, caches, models, commands, background and saved runs."""

import base64
import contextlib
import gzip
import io
import re
import sys
import threading
import time
import zipfile
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from commands import run
from omegaconf import OmegaConf
from run_without_figures import __file__ as COMMAND

pytest.importorskip("dash", reason="the workbench needs Dash: pip install 'contactlearn[workbench]'")

from dash import no_update

from contactlearn.cli.hydra_main import compose
from contactlearn.cli.settings import EvaluateSettings
from contactlearn.core.errors import ContactLearnError, DataError, UnknownNameError
from contactlearn.data import table
from contactlearn.diagnosis.events import AuditFindings, EffectsFound, LawsCompared, RemainderLearned
from contactlearn.diagnosis.result import Diagnosis, Formula, PlausibleModel, Verdict, WrenchComponent
from contactlearn.effects import EffectId
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.inference.evaluation.partial_residuals import partial_residuals
from contactlearn.inference.evaluation.variables import map_variables
from contactlearn.mechanics.apparatus import Apparatus, Estimate
from contactlearn.report.text.numbers import brief_interval, error
from contactlearn.report.text.sentences import names_by_level
from contactlearn.results.folder import read_result
from contactlearn.simulation import synthetic
from contactlearn.workbench import background, commands, content, lines, server
from contactlearn.workbench.arrays import inside, of_model
from contactlearn.workbench.background import BackgroundRuns, RunStatus, learned_steps
from contactlearn.workbench.background_callbacks import diagnosis_progress
from contactlearn.workbench.components import bar
from contactlearn.workbench.files import FileCallbacks, SavedRuns, diagnosed_session
from contactlearn.workbench.models import Cache, Models
from contactlearn.workbench.session import Option, Session, Window
from contactlearn.workbench.session_callbacks import SessionCallbacks

LINE = "tau = -c*rx*Pn; c = [-1, 1]"
DRAG = EffectId("side_drag", "linear")


def of_table(impacts, path, **choices):
    """Write a table; return a session of it."""
    table.save(impacts, path)
    return Session(data=("data=table", f"data.path={path}"), **choices)


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    """Drops with a planted drag."""
    impacts = synthetic.load(size=240, seed=3)
    v_post = impacts.v_post * torch.tensor([0.8, 0.8, 1.0])
    return of_table(impacts.replace(v_post=v_post), tmp_path_factory.mktemp("workbench") / "drops.csv")


@pytest.fixture(scope="module")
def drops(session):
    """The file of these drops."""
    return Path(session.data[1].removeprefix("data.path="))


@pytest.fixture(scope="module")
def page():
    return SessionCallbacks(Models())


@pytest.fixture(scope="module")
def models(page):
    return page.models


@pytest.fixture(scope="module")
def act(page):
    """The session after an action."""
    return lambda session, kind, of="", value=None: page.actions.handlers[kind](session, of, value)


def action(n, kind, of="", value=None):
    """An action as the page sends it."""
    return {"n": n, "kind": kind, "of": of, "value": value}


SESSIONS = {
    "defaults": Session(),
    "data": Session(data=("data=mystery", "data.seed=7")),
    "shape": Session(data=("data=table", "data.path=a b.csv", "data.shape={kind:disc,radius:0.02}")),
    "all": Session(
        law="mirtich", effects=(DRAG, EffectId("surface_tilt")), lines=(LINE, "eps = c; c = [-1, 1]"),
        manual=(("mu", 0.1),), options=(
            Option(effect="side_drag", name="x", value=(0.5,)), Option(effect="side_drag", name="y", value=(-1.0, 2.0)),
        ),
        seed=3, trial=12, windows=(Window(variable="v_x", low=-0.1, high=1e-9),),
    ),
}  # fmt: skip


@pytest.mark.parametrize("session", SESSIONS.values(), ids=SESSIONS)
def test_an_address_is_the_session(session):
    assert Session.read(session.address) == session
    assert Session.read(session.address).address == session.address


@pytest.mark.parametrize(("address", "message"), [
    ("?manual.mu=much", "an address holds numbers such as 0.25, got 'much'"),
    ("?manual.mu=nan", "finite numbers only"),
    ("?option.side_drag=1", "an option is option.EFFECT.NAME"),
    ("?option.a.b=inf", "finite numbers only"),
    ("?seed=-1", "seed is a whole number"),
    ("?trial=x", "trial is a whole number"),
    ("?window=v_x:1", "a window is variable:low:high"),
    ("?data=${oc.env:HOME}", "without [$]"),
    ("?data=mystery&data.seed=7%0Alaw=x", "data is named as"),
    ("?effect=side_drag&effect=side_drag:linear", "once, in one form"),
    ("?effect=a:b:c", "without a colon"),
    ("?law=" + 30_000 * "x", "up to 20000 characters"),
])  # fmt: skip
def test_a_wrong_address_is_one_clear_error(address, message):
    with pytest.raises(ContactLearnError, match=message):
        Session.read(address)


def test_a_bar_that_is_longer_than_there_is_room_fades_out():
    inside, outside = bar(Interval(0.5, 0.4, 1.2), 1.0), bar(Interval(1.2, 1.1, 1.3), 1.0)
    assert [one.className for one in (inside, outside)] == ["scale", "scale beyond"]
    assert [len(one.children) for one in (inside, outside)] == [2, 1]  # no interval at an end that is none


def test_a_tick_takes_the_place_of_another_form():
    session = Session(effects=(DRAG, EffectId("surface_tilt")), manual=(("mu", 0.1),))
    other = session.with_effect(EffectId("side_drag", "quadratic"))
    assert [str(one) for one in other.effects] == ["side_drag:quadratic", "surface_tilt"]
    assert other.manual == ()  # the values of another model
    assert session.without_effect(DRAG.name).effects == (EffectId("surface_tilt"),)
    given, own = EffectId("side_drag", "linear"), EffectId("spin_damping", "after")
    found = Diagnosis(verdict=Verdict.EFFECTS, law="wang_mason", variant="textbook", findings=(), given=(given,))
    model = PlausibleModel(law="mirtich", effects=(own,), share=1.0)
    shown = str(content._adopt_button("Take", Session(), found, model))
    assert "Mirtich + side drag (linear) + spin damping (after)" in shown
    assert str(Session(law="mirtich", effects=(given, own)).address) in shown


def test_a_line_is_the_effect_of_the_command(session, models, act):
    effect = lines.parse_effect(LINE)
    assert effect.equation == "τ ← τ + (-c*rx*Pn)"
    words = [*session.data, *lines.overrides(LINE, "mine")]
    assert EvaluateSettings.from_config(compose("evaluate", words)).effects["mine"].options == effect.options
    assert lines.completions("ta") == ["tau = "]
    assert lines.completions("tau = -c*rx*P") == ["tau = -c*rx*Pt", "tau = -c*rx*Pn"]
    assert "eps = c*P" not in "".join(lines.completions("eps = c*P"))  # the impulse is not known at the law
    assert lines.completions("tau = -c*rx*Pn; c") == []
    found = Formula(
        component=WrenchComponent.MOMENT, terms=("Pn*sin(3*theta)",), ranges=((-0.5, 0.5),), coefficients=(0.1,),
        error_reduction=0.1, standard_error=0.01,
    )  # fmt: skip
    assert lines.parse_effect(lines.formula_line(found)).equation == "τ ← τ + (c1*Pn*sin(3*theta))"
    with pytest.raises(ContactLearnError, match="must change nothing where it vanishes"):
        act(session, "line", "tau = c + Pn; c = [-1, 1]")


@pytest.mark.parametrize(("line", "message"), [
    ("tau", "write an output and its expression"),
    ("tau = c*Pn; c", "a parameter has a range"),
    ("tau = c*Pn; c = [0, x]", "a parameter has a range"),
    ("tau = c*Pm; c = [0, 1]", "unknown symbol or parameter 'Pm'"),
    ("tau = __import__('os').system('x')*c; c = [0, 1]", "only mathematics, not Python"),
    ("speed = c; c = [0, 1]", "unknown output"),
    ("tau = c*" + 600 * "1" + "; c = [0, 1]", "up to 500 characters"),
])  # fmt: skip
def test_a_wrong_line_is_one_clear_error(line, message):
    with pytest.raises(ContactLearnError, match=message):
        lines.parse_effect(line)


def test_a_cache_computes_once_and_forgets_the_oldest():
    cache, computed = Cache(2), []

    def slow(key):
        computed.append(key)
        time.sleep(0.05)
        return key

    threads = [threading.Thread(target=lambda: cache.get("a", lambda: slow("a"))) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert computed == ["a"]
    for key in "bca":
        cache.get(key, lambda key=key: slow(key))
    assert computed == ["a", "b", "c", "a"]
    assert len(cache) == 2
    cache = Cache(2)
    with pytest.raises(ZeroDivisionError):
        cache.get("a", lambda: 1 / 0)
    assert cache.get("a", lambda: 1) == 1


@pytest.mark.parametrize(("words", "opened"), [([], "mirtich"), (["law=whittaker"], "whittaker")])
def test_it_opens_on_the_law_with_the_smallest_error(words, opened, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    served = SimpleNamespace(serve_forever=lambda: None, server_close=lambda: None)
    monkeypatch.setattr(server, "listen", lambda *_: (served, SimpleNamespace(url="http://127.0.0.1/?token=t")))
    server.serve(["data=mystery", "data.seed=7", *words], "127.0.0.1", None, browser=False)
    assert f"&law={opened}" in capsys.readouterr().out


def test_an_effect_that_is_planted_lowers_the_held_out_error(session, models, act):
    alone, ticked = models.fitted(session), models.fitted(session.with_effect(DRAG))
    assert ticked.error.mean < 0.5 * alone.error.mean
    value = dict(zip((p.name for p in ticked.fit.parameters), ticked.fit.values.tolist(), strict=True))["side_drag.c"]
    assert value == pytest.approx(0.2, abs=0.01)
    assert [one.error.mean for one in models.ladder(session.with_effect(DRAG))] == [alone.error.mean, ticked.error.mean]
    first = models.predicted_gains(session)[0]
    fitted = models.fitted(session.with_effect(first.effect)).error.mean
    assert first.effect.name == "side_drag"
    assert 0.8 * fitted < first.error < 0.5 * models.fitted(session).error.mean
    assert all(one.effect.name != "side_drag" for one in models.predicted_gains(session.with_effect(DRAG)))
    ticked = act(session, "ticks", "side_drag", True)
    best = next(one.effect for one in models.predicted_gains(session) if one.effect.name == "side_drag")
    assert ticked.effects == (best,)
    assert act(ticked, "ticks", "side_drag", False) == session
    fitted = models.fitted(session)
    assert error(fitted.error.mean) in "".join(content.error_summary(session, fitted, models.manual(session), fitted))


def test_a_parameter_is_set_by_hand_and_back(session, models, act):
    fitted, moved = models.fitted(session), act(session, "slider", "mu", 0.5)
    assert models.manual(moved).error.mean > fitted.error.mean
    assert models.manual(moved).model.law.mu == 0.5
    assert act(moved, "slider", "mu", 0.5) is moved  # the slider was set to this value
    assert act(moved, "fit", "mu") == session
    assert models.manual(session).error == fitted.error
    with pytest.raises(UnknownNameError, match="unknown parameter of this model 'nu'"):
        models.manual(replace(session, manual=(("nu", 1.0),)))


def test_a_slider_that_is_dragged_is_answered_with_the_changes_at_its_place(session, models, page):
    session = session.with_effect(DRAG)
    sent = page.preview(session.address, "side_drag.c", 0.3)
    moved = models.manual(session.with_value("side_drag.c", 0.3))
    assert _floats(sent["v_post"]).reshape(-1, 3) == pytest.approx(moved.v_post.numpy(), rel=1e-5, abs=1e-6)
    partial = partial_residuals(moved.model, models.split(session).impacts, "side_drag")
    component = ("v_x⁺", "v_y⁺", "ω⁺").index(partial.component)
    change = _floats(sent["changes"]).reshape(1, -1, 3)[0, :, component]
    assert change == pytest.approx(partial.explained.numpy(), rel=1e-5, abs=1e-6)
    _, number, rest = sent["summary"]
    assert number == brief_interval(moved.error)
    assert "set by hand" in rest
    fitted = models.fitted(session).fit.values[2].item()
    assert "set by hand" not in page.preview(session.address, "side_drag.c", fitted)["summary"][2]


def _floats(text):
    return np.frombuffer(base64.b64decode(text), "<f4")


def test_without_a_shape_no_effect_that_needs_it_has_a_predicted_gain(session, models):
    shape = "data.shape={kind:ellipse,semi_axes:[0.04,0.02]}"
    shaped = {one.effect.name for one in models.predicted_gains(replace(session, data=(*session.data, shape)))}
    assert "shape_error" in shaped
    assert "shape_error" not in {one.effect.name for one in models.predicted_gains(session)}


def test_a_changed_file_is_read_again(models, tmp_path):
    other = of_table(synthetic.load(size=100, seed=1), tmp_path / "drops.csv")
    before = models.fingerprint(other)
    of_table(synthetic.load(size=101, seed=1), tmp_path / "drops.csv")
    assert models.fingerprint(other) != before
    assert len(models.split(other).impacts) == 101


def test_windows_hold_trials_also_around_the_circle(session, models, monkeypatch, page, act):
    impacts = models.split(session).impacts
    among = map_variables(impacts, models.fitted(session).model.predict(impacts))
    assert inside((Window(variable="theta", low=-180.0, high=180.0),), among).all()
    some = inside((Window(variable="theta", low=170.0, high=190.0),), among)
    angle = torch.rad2deg(impacts.q[:, 2]).remainder(360)
    assert torch.equal(some, (angle >= 170) & (angle <= 190))
    monkeypatch.setattr("contactlearn.workbench.arrays._CURVE_TRIALS", 10)
    fitted, impacts = models.fitted(session.with_effect(DRAG)), models.split(session).impacts
    sent = of_model(impacts, fitted.v_post, fitted.v_post, fitted.model)
    assert sent["effects"] == []
    order, first = page.actions.ranked(session), act(session, "worst")
    assert first.trial == order[0]
    assert act(first, "worse").trial == order[1]
    assert act(replace(session, trial=len(order) - 1), "next").trial == 0
    assert page.actions.trial(replace(session, trial=10**8)) == len(order) - 1


def test_the_rig_card_is_a_table_with_differences_in_bold():
    rows = Apparatus(gravity=Estimate(value=9.81, error=0.01), delay=Estimate(value=2e-3, error=1e-4)).rows()
    shown = str(content.rig_card(rows))
    assert "B('2.00 ± 0.10 ms')" in shown
    assert "Span('9.810 ± 0.010 m/s²')" in shown


def test_a_correction_of_the_audit_is_applied_and_taken_back(models, page, tmp_path):
    impacts, left = synthetic.load(size=160, seed=3), torch.tensor([-1.0, 1.0, 1.0])
    mirrored = impacts.replace(v_pre=impacts.v_pre * left, v_post=impacts.v_post * left, q=impacts.q * left)
    turned = of_table(mirrored, tmp_path / "drops.csv", effects=(DRAG,))
    (button,) = _buttons(page.findings("drawn", turned.address)[1])
    assert getattr(button, "data-action") == "correct"
    correct = action(1, "correct", getattr(button, "data-of"))
    address, history, *_ = page.act([correct], None, turned.address, None)
    corrected = Session.read(address)
    assert corrected.corrections == ("mirrored_x", "traced_shape")
    assert corrected.effects == turned.effects
    assert models.fitted(corrected).error.mean < 0.1 * models.fitted(turned).error.mean
    assert "data.correct=[mirrored_x,traced_shape]" in commands.words_of(corrected)
    assert OmegaConf.create(commands.experiment(corrected)).data.correct == ["mirrored_x", "traced_shape"]
    (button,) = _buttons(page.findings("drawn", address)[1])
    for back in (getattr(button, "data-action"), "undo"):
        assert page.act([action(2, back)], 1, address, history)[0] == turned.address
    assert "unknown correction" in page.act([correct | {"of": "x]', y"}], None, address, history)[3]


def test_data_that_break_a_rule_are_offered_corrected(models, tmp_path):
    impacts, down = synthetic.load(size=160, seed=3), torch.tensor([1.0, -1.0, 1.0])
    turned = {name: getattr(impacts, name) * down for name in ("v_pre", "v_post", "q")}
    of_table(impacts.replace(validate=False, **turned, r=impacts.r * down[:2]), tmp_path / "down.csv")
    files = FileCallbacks(models, SavedRuns(tmp_path))
    path = files.store_table("down.csv", _dropped((tmp_path / "down.csv").read_bytes()))
    session = Session(data=("data=table", f"data.path={path}"))
    with pytest.raises(ContactLearnError):
        models.split(session)
    (button,) = _buttons(files.corrections(session))
    corrected = Session.read(getattr(button, "data-of"))
    assert corrected.corrections == ("mirrored_y", "traced_shape")
    assert len(models.split(corrected).impacts) == 160


def _dropped(content):
    """A dropped file as a browser sends it."""
    return f"data:text/csv;base64,{base64.b64encode(content).decode()}"


def _buttons(parts):
    return [one for part in parts for one in part._traverse() if hasattr(one, "data-action")]


def test_an_option_is_written_fitted_and_in_the_command(session, models, act):
    name = "velocity_dependent_restitution"
    plain = session.with_effect(EffectId(name, "power")).with_effect(EffectId("location_dependent_friction", "along"))
    opted = act(plain, "option", f"{name}.v_ref", "0.7")
    opted = act(opted, "option", "location_dependent_friction.span", "[−0.05, 0.1]")
    effects = models.fitted(opted).effects
    assert effects[name].v_ref == 0.7
    assert effects["location_dependent_friction"].span == (-0.05, 0.1)
    assert models.fitted(plain).effects[name].v_ref not in (None, 0.7)
    assert Session.read(opted.address) == opted
    assert replace(commands.session_of(commands.words_of(opted)), data=opted.data) == opted
    assert OmegaConf.create(commands.experiment(opted)).effect[name].v_ref == 0.7
    assert act(opted, "option", f"{name}.v_ref", "").options == opted.options[:1]
    assert opted.with_effect(EffectId(name, "linear")).options == opted.options[:1]  # another form has its defaults
    fields = [
        str(one.id)
        for part in content.parts(opted, models.fitted(opted), models.manual(opted))
        for one in _inputs(part)
    ]
    assert len(fields) == 2
    for text, message in (("fast", "v_ref is a number"), ("-1", "must be a positive"), ("1, 2", "must be a positive")):
        with pytest.raises(ContactLearnError, match=message):
            models.fitted(act(plain, "option", f"{name}.v_ref", text))
    with pytest.raises(ContactLearnError, match="a span must be"):
        models.fitted(act(plain, "option", "location_dependent_friction.span", "3"))
    with pytest.raises(ContactLearnError, match="has no setting"):
        models.fitted(act(plain, "option", f"{name}.w_ref", "1"))


def _inputs(part):
    return [one for one in part._traverse() if type(one).__name__ == "Input"]


def test_a_command_line_is_a_session_and_back(drops, session):
    words = ["data=table", f"data.path={drops}", "law=mirtich", "effect=[side_drag]", "effect.side_drag.form=quadratic"]
    session = commands.session_of(words)
    assert session.effects == (EffectId("side_drag", "quadratic"),)
    assert commands.session_of([w for w in commands.words_of(session) if w]) == session
    text = commands.experiment(session.with_value("mu", 0.25))
    assert "set by hand, which no command can do: mu = 0.25" in text
    assert OmegaConf.create(text).seed == 0


@pytest.mark.parametrize("words", [["model=[]"], ["law=best"], ["law._target_=os.system"], ["effect=[nothing]"]])
def test_what_the_workbench_does_not_take_is_refused(words):
    with pytest.raises(ContactLearnError):
        commands.session_of(words)


def test_the_shell_gives_the_same_error(session, models, tmp_path):
    session = replace(session.with_effect(DRAG), lines=("eps = -c*vn; c = [-0.5, 0.5]",))
    words = [*commands.words_of(session), "model=[]", "fit.starts=4"]
    small = ("train.size=20", "train.repetitions=2", "figures.repetitions=2", "bootstrap=50", "laws=[mirtich]")
    run("evaluate.py", *words, *small, "hydra.run.dir=run", cwd=tmp_path)
    result = read_result(tmp_path / "run" / "results.json")
    assert result.errors[result.model].mass_error.mean == pytest.approx(models.fitted(session).error.mean, rel=1e-9)


def ended(run, seconds=120):
    """Wait for a background run; return its status."""
    end = time.monotonic() + seconds
    while run.status is RunStatus.RUNNING and time.monotonic() < end:
        time.sleep(0.1)
    return run.status


def test_a_diagnosis_runs_in_the_background_and_its_model_is_taken_over(drops, models, tmp_path, monkeypatch):
    monkeypatch.setattr(background, "_DIAGNOSE", (sys.executable, COMMAND, "diagnose"))
    (tmp_path / "few.csv").write_text("\n".join(drops.read_text().splitlines()[:101]))
    session = Session(data=("data=table", f"data.path={tmp_path / 'few.csv'}"))
    runs, saved = BackgroundRuns(tmp_path / "outputs"), SavedRuns(tmp_path / "outputs")
    speed = EffectId("velocity_dependent_restitution", "linear")  # it takes a constant from the data
    words = [*commands.words_of(session.with_effect(DRAG).with_effect(speed)), "seconds=1"]
    name = runs.diagnose(words)
    run = runs.find(name)
    assert runs.diagnose(words) == name
    assert (run.status, run.events) == (RunStatus.RUNNING, [])
    assert ended(run) is RunStatus.DONE, run.error
    progress = [diagnosis_progress(run.events[:k]) for k in range(len(run.events) + 1)]
    assert progress == sorted(progress)
    assert (progress[0], progress[-1]) == (0, pytest.approx(5.9 / 6))
    assert {type(one) for one in run.events} >= {AuditFindings, LawsCompared, EffectsFound, RemainderLearned}
    (listed,) = saved.latest()
    assert listed.has_page
    assert listed.session is not None
    assert DRAG in listed.session.effects
    assert models.fitted(listed.session).error.mean < 0.5 * models.fitted(session).error.mean
    result = saved.diagnosis(listed.name)
    assert diagnosed_session(result) == listed.session
    shown = str(content.diagnosis_content(result, listed.name, session))
    assert all(text in shown for level, name in names_by_level(result.diagnosis) for text in (level, name))
    for file in ("report.html", "diagnosis.json", "metrics.jsonl"):
        assert (tmp_path / "outputs" / listed.name / file).exists()
    words = content.rig_words(content.rig_limits(models.split(session).impacts))
    assert re.fullmatch(r"rig\.x=\[.*\] rig\.theta=\[.*\] rig\.omega=\[.*\] rig\.height=\[.*\]", words)
    with contextlib.chdir(tmp_path):
        (text, link) = FileCallbacks(models, saved).plan(1, words, name)
    assert "20 drops for" in text.children
    assert f"drops: {Path('outputs', 'plans', name, 'plan.csv')}\n" in text.children
    assert (tmp_path / "outputs" / "plans" / name / "plan.csv").exists()
    assert link.children.href == f"/runs/plans/{name}/plan.html"
    saved.compare([listed.name])
    assert (tmp_path / "outputs" / "runs.html").exists()


def test_the_model_is_exported_and_a_plan_needs_a_search(session, models, tmp_path):
    files = FileCallbacks(models, SavedRuns(tmp_path))
    for target, name, start in (("c", "impact.c", b"/*"), ("json", "impact.json", b"{")):
        sent, trouble = files.export(1, target, session.address)
        assert trouble == ""
        assert sent["filename"] == name
        assert base64.b64decode(sent["content"]).startswith(start)
    sent, trouble = files.export(1, "mujoco", session.with_effect(DRAG).address)  # of a body without a shape
    assert trouble.startswith("a scene needs the one shape of the body")
    assert sent is no_update
    (refusal,) = files.plan(1, "", None)
    assert refusal.children.startswith("search laws and effects first")


def test_diagnoses_are_cancelled_fail_with_their_error_and_no_more_than_two_run(session, tmp_path):
    runs = BackgroundRuns(tmp_path)
    first, second = (runs.find(runs.diagnose([*session.data, f"seed={seed}"])) for seed in range(2))
    with pytest.raises(ContactLearnError, match="2 diagnoses are running"):
        runs.diagnose([*session.data, "seed=2"])
    first.cancel()
    assert ended(first) is RunStatus.CANCELLED
    wrong = runs.find(runs.diagnose(["data=mystry"]))
    assert ended(wrong) is RunStatus.FAILED
    assert "did you mean 'mystery'" in wrong.error
    runs.close()
    assert ended(second) is RunStatus.CANCELLED


@pytest.mark.nightly
def test_studies_are_cancelled_fail_with_their_error_and_can_be_started_again(session, tmp_path):
    runs = BackgroundRuns(tmp_path)
    first, second = (runs.find(runs.study(kind, session, "")) for kind in ("learned", "curve"))
    with pytest.raises(ContactLearnError, match="2 studies are running"):
        runs.study("curve", session.with_effect(DRAG), "")
    for study in (first, second):
        study.cancel()
        assert ended(study, 10) is RunStatus.CANCELLED
    again = runs.find(runs.study("learned", session, ""))
    assert again is not first
    wrong = runs.find(runs.study("curve", replace(session, law="mirtisch"), ""))
    assert ended(wrong) is RunStatus.FAILED
    assert "did you mean 'mirtich'" in wrong.error
    again.cancel()


def test_learned_models_are_those_of_the_configuration_around_the_model(session, models, monkeypatch):
    few = ["analytical", "parameters_identified", "residual_impulse", "x2_impulse"]
    monkeypatch.setattr("contactlearn.workbench.background.choices", lambda _: few)
    steps = list(learned_steps(models, session.with_effect(DRAG)))
    assert [(one.done, one.total, len(one.errors)) for one in steps] == [(0, 2, 0), (1, 2, 1), (2, 2, 2)]
    around, free = (steps[-1].errors[name][0] for name in ("residual_impulse", "x2_impulse"))
    assert around[0] == free[0] == len(models.split(session).pool)
    assert around[1].mean < 1.2 * models.fitted(session.with_effect(DRAG)).error.mean < free[1].mean
    assert len(list(learned_steps(models, session))) == 4  # without effects the third of them is learnt, too


@pytest.mark.parametrize("name", ["..", "../..", "/etc", "diagnose/../../x"])
def test_no_path_leads_out_of_the_runs(name, tmp_path):
    with pytest.raises(ContactLearnError, match="a folder below"):
        SavedRuns(tmp_path / "outputs").inside(name)


def _zipped(path: Path) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        archive.write(path, path.name)
    return content.getvalue()


def test_a_dropped_file_is_read_by_the_reader_of_tables(drops, models, tmp_path):
    files = FileCallbacks(models, SavedRuns(tmp_path))
    path = files.store_table("mine.CSV", _dropped(drops.read_bytes()))
    assert path.read_bytes() == drops.read_bytes()
    assert path == files.store_table("other.csv", _dropped(drops.read_bytes()))
    for name, packed in (("mine.csv.gz", gzip.compress(drops.read_bytes())), ("mine.zip", _zipped(drops))):
        again = files.store_table(name, _dropped(packed))
        assert table.load(again).v_pre.equal(table.load(drops).v_pre)
        again.unlink()
    with pytest.raises(DataError, match=r"^bad.csv: 13 columns are missing, .*not used: 'a'"):
        files.store_table("bad.csv", _dropped(b"a\n1\n"))
    with pytest.raises(DataError, match=r"a table is a \.csv or .* file, got suffix '\.pkl'"):
        files.store_table("model.pkl", _dropped(b"x"))
    with pytest.raises(DataError, match="did not arrive whole"):
        files.store_table("x.csv", "data:text/csv;base64,!!!")
    assert len(list((tmp_path / "uploads").iterdir())) == 1


def test_unanswered_actions_are_done_once_and_impossible_ones_are_refused(session, page):
    """The page sends actions again until they are answered; `done` is the last one that is in the address."""
    tick, law = action(1, "ticks", "side_drag", True), action(2, "law", "mirtich")
    address, history, done, trouble, *_ = page.act([tick, law], None, session.address, None)
    both = Session.read(address)
    assert (both.law, both.effects[0].name, done, trouble) == ("mirtich", "side_drag", 2, "")
    assert len(history["past"]) == 2
    back, history, *_ = page.act([tick, law, action(3, "undo")], 2, address, history)
    assert Session.read(back).law == session.law
    again, history, *_ = page.act([action(4, "redo")], 3, back, history)
    assert again == address
    wrong = action(5, "line", "tau = c; d")
    *same, done, trouble, ticks, chosen = page.act([wrong], 4, again, history)
    assert same == [no_update, no_update]
    assert (done, ticks, chosen) == (5, ["side_drag"], "mirtich")
    assert "a parameter has a range" in trouble
    assert "unknown action" in page.act([wrong | {"kind": "format_disk"}], 4, again, history)[3]


def test_a_hint_whose_answer_the_page_dropped_is_given_again(models, tmp_path):
    hint, alone = FileCallbacks(models, SavedRuns(tmp_path)).hint, "?data=mystery&data.seed=7"
    *_, first = hint(0, 0, alone, None)
    assert hint(1, 0, alone, first)[1].startswith("2 of 5")  # dropped, since the page settled meanwhile
    *_, second = hint(1, 0, alone, first)
    assert second == [1, 1] == hint(1, 0, alone, second)[-1]
    *_, ticked = hint(1, 0, f"{alone}&effect=sampling_delay", second)
    assert ticked == [3, 1]
    assert hint(2, 0, f"{alone}&effect=sampling_delay", ticked)[1].startswith("5 of 5")
