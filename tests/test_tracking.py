"""TensorBoard: what runs leave for it, read back through TensorBoard's own readers and plugins."""

import html
import json
import re
import warnings

import pytest
import torch
from commands import SMALL, TRAIN, run
from logged import Events
from observers import RecordingObserver
from tensorboard.backend.event_processing.data_provider import MultiplexerDataProvider
from tensorboard.backend.event_processing.plugin_event_multiplexer import EventMultiplexer
from tensorboard.context import RequestContext
from tensorboard.plugins.base_plugin import TBContext
from tensorboard.plugins.custom_scalar.layout_pb2 import Layout
from tensorboard.plugins.hparams.plugin_data_pb2 import HParamsPluginData

from contactlearn.__main__ import main
from contactlearn.cli.commands import curves
from contactlearn.data import table
from contactlearn.diagnosis.result import FLOORS
from contactlearn.effects import find_effect
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.inference.identification import robust
from contactlearn.inference.learning.curves import Curve, CurvePoints
from contactlearn.inference.learning.recipe import Recipe, learn
from contactlearn.laws import find
from contactlearn.mechanics.features import SPACES
from contactlearn.models.contact_model import ContactModel
from contactlearn.report.figures import quality
from contactlearn.report.figures.style import save
from contactlearn.report.tensorboard import SUMMARY, Tracker, ends, shown_as
from contactlearn.report.text.names import base_label, rung_label
from contactlearn.results import folder as run_folder
from contactlearn.results.estimates import process_estimates
from contactlearn.simulation import hidden_effects, synthetic

with warnings.catch_warnings():  # the copy of html5lib in TensorBoard warns of itself
    warnings.simplefilter("ignore", DeprecationWarning)
    from tensorboard.plugin_util import markdown_to_safe_html
    from tensorboard.plugins.custom_scalar.custom_scalars_plugin import CustomScalarsPlugin

HOSTILE = "a|b <img src=x onerror=alert(1)> *c* [d](javascript:e) `f`\n# g &amp; h_i_j ~~k~~ \\| {{l}}"
HELD_OUT = "Learning curves: held-out mass error against the number of training impacts"
COMMANDS = {
    "train": ("train.py", *TRAIN, "effect=[surface_tilt]"),
    "learned": ("train.py", *TRAIN, "model=x1_wrench"),
    "evaluate": ("evaluate.py", *SMALL[:5], "model=[x1_wrench]", "curves.sizes=[10,20]", "curves.seeds=1",
                 "laws=[wang_mason]", "workers=1"),
    "evaluate_with": ("evaluate.py", *SMALL, "effect=[side_drag]", "laws=[whittaker]"),
    "transfer": ("evaluate.py", "experiment=transfer", "model=[x1_wrench]", "data.size=60", "train.size=30",
                 "transfer.sizes=[4,8]", "transfer.seeds=2", "bootstrap=50", "~transfer.bodies.rod", "workers=1"),
    "diagnose": ("diagnose.py", "data=mystery", "data.seed=170", "data.size=100", "law=wang_mason"),
}  # fmt: skip


def read(folder):
    """The events of a run, which are all in one file."""
    assert len(list(folder.rglob("events.*"))) == 1
    return Events(str(folder)).Reload()


def hparams(events, part):
    """One of the three messages to the hparams plugin."""
    tag = f"_hparams_/{part}"
    return getattr(HParamsPluginData.FromString(events.SummaryMetadata(tag).plugin_data.content), part)


def values(events):
    """Hyperparameters as Python values, by name."""
    return {name: getattr(x, x.WhichOneof("kind")) for name, x in hparams(events, "session_start_info").hparams.items()}


def layout(events):
    """{category: {title: chart}} of one run."""
    (event,) = events.Tensors("custom_scalars__config__")
    found = Layout.FromString(event.tensor_proto.string_val[0])
    return {category.title: {chart.title: chart for chart in category.chart} for category in found.category}


def merged(folder):
    """{category: [titles]} as the custom scalars tab gets them from all runs below a folder."""
    multiplexer = EventMultiplexer().AddRunsFromDirectory(str(folder)).Reload()
    provider = MultiplexerDataProvider(multiplexer, str(folder))
    found = CustomScalarsPlugin(TBContext(data_provider=provider)).layout_impl(RequestContext(), "")
    return {part["title"]: [chart["title"] for chart in part["chart"]] for part in json.loads(found)["category"]}


def card(events):
    """Statements and rows of the card as TensorBoard shows them, each a list of parts without markup."""
    (event,) = events.Tensors(SUMMARY)
    shown = markdown_to_safe_html(event.tensor_proto.string_val[0].decode())
    rows = [list(pair) for pair in re.findall(r"<p><strong>(.*?):</strong> (.*?)</p>", shown)]
    rows += [
        re.findall(r"<t[hd]>(.*?)</t[hd]>", row, re.DOTALL) for row in re.findall(r"<tr>(.*?)</tr>", shown, re.DOTALL)
    ]
    assert not re.search(r"<(?!/?(table|thead|tbody|tr|th|td|p|strong)>)", shown)
    return [[html.unescape(cell) for cell in row] for row in rows]


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A folder with one small run of each kind, and their events by name."""
    folder = tmp_path_factory.mktemp("runs")
    for name, command in COMMANDS.items():
        run(*command, f"hydra.run.dir={folder / name}")
    return folder, {name: read(folder / name) for name in COMMANDS}


def test_what_is_shown_has_a_heading_and_a_description(tmp_path, caplog):
    """And TensorBoard finds none of them odd."""
    figure = quality.calibration_curve({"x1_wrench": (torch.ones(1), torch.ones(1))})
    (png, _), drops = save(figure, tmp_path / "figures", "effect_side_drag"), synthetic.load(20)
    with Tracker(tmp_path, 40) as tracker:
        tracker.scalars({"mass_error/model": Interval(0.5, 0.4, 0.6)})
        tracker.figure("figures/effect_side_drag", png.read_bytes())
        tracker.histogram("residuals/v_x", drops.v_post[:, 0])
        tracker.card({"Verdict": "nothing is missing"}, [])
    found = EventMultiplexer().AddRun(str(tmp_path), "run").Reload()
    told = {
        "HParams/Mass error of the model": ("Mass error of the model", "One number of this run"),
        "HParams/Mass error of the model, low end": ("Mass error of the model, low end", "The 95 % interval"),
        "Figures/Effect: side drag": ("Effect: side drag", "What the effect explains"),
        "Residuals/v_x": ("v_x", "Measured minus predicted"),
        SUMMARY: (SUMMARY, "What was run and found"),
    }
    for tag, (name, start) in told.items():
        about = found.SummaryMetadata("run", tag)
        assert (about.display_name, about.summary_description.startswith(start)) == (name, True), tag
    assert "not associated with a plugin" not in caplog.text


@pytest.mark.parametrize(
    ("tag", "heading"),
    [
        ("curve_mass_error/x1_wrench", "Learning curves/X1 → wrench"),
        ("curve_mass_error/wang_mason, law=wang_mason", "Learning curves/Wang–Mason, law=wang_mason"),
        ("interval/curve_euclidean_error/irb/high", "Learning curves/IRB bound, high end"),
        ("transfer_mass_error/rod/x1_wrench/prior", "Transfer to other bodies/rod/X1 → wrench/prior"),
        ("figures/patch_curve", "Figures/IRB bound by width of the contact patch"),
        ("figures/effect_velocity_dependent_restitution_power", "Figures/Effect: velocity-dependent restitution power"),
        ("of an own class", "of an own class"),
    ],
)
def test_a_tag_is_shown_in_words(tag, heading):
    assert shown_as(tag) == heading


def test_a_mean_and_the_ends_of_its_interval(tmp_path):
    with Tracker(tmp_path, 40) as tracker:
        tracker.scalars({"error/a": Interval(0.5, 0.25, 1.0), "share/a": 0.125})
        tracker.scalars({"error/a": Interval(0.25, 0.125, 0.5)}, 80)
        tracker.series("ladder", [Interval(2.0, 1.0, 3.0), 1.5])
    events = read(tmp_path)
    seen = {tag: [(event.step, event.value) for event in events.Scalars(tag)] for tag in events.Tags()["scalars"]}
    assert seen == {
        "error/a": [(40, 0.5), (80, 0.25)],
        "error/a, low end": [(40, 0.25), (80, 0.125)],
        "error/a, high end": [(40, 1.0), (80, 0.5)],
        "share/a": [(40, 0.125)],
        "ladder": [(0, 2.0), (1, 1.5)],
        "ladder, low end": [(0, 1.0)],
        "ladder, high end": [(0, 3.0)],
    }
    lines = [json.loads(line) for line in (tmp_path / "metrics.jsonl").read_text().splitlines()]
    assert [(line["trained_on"], line.get("rung")) for line in lines] == [(40, None), (80, None), (40, 0), (40, 1)]
    assert lines[0]["interval/error/a/high"] == 1.0


def test_a_new_attempt_replaces_the_record_of_a_former_one(tmp_path):
    """Also in a TensorBoard that has read the former one; a run without a value leaves nothing."""
    shown = Events(str(tmp_path)).Reload()
    for sizes in ((10, 20, 40), (10, 30)):
        with Tracker(tmp_path, 1) as tracker:
            for size in sizes:
                tracker.scalars({"error": size}, size)
        assert [event.step for event in shown.Reload().Scalars("error")] == list(sizes)
        with Tracker(tmp_path, 1):
            pass
        lines = (tmp_path / "metrics.jsonl").read_text().splitlines()
        assert [json.loads(line)["error"] for line in lines] == list(sizes)
    assert [event.step for event in Events(str(tmp_path)).Reload().Scalars("error")] == [10, 30]


def test_a_training_is_logged_round_by_round(runs):
    folder, events = runs
    events, rounds = events["learned"], []
    for line in (folder / "learned" / "metrics.jsonl").read_text().splitlines():
        rounds += [found] if "round" in (found := json.loads(line)) else []
    results = json.loads((folder / "learned" / "results.json").read_text())
    loss = {one["output"]: one["loss"] for one in results["processes"]}
    lines = [one for one in rounds if "fit/loss" in one]
    assert {output: lines[-1][f"fit/loss/{output}"] for output in loss} == loss
    assert {"fit/noise/τ", "fit/length_scale/τ/v_n"} <= {*lines[-1]}
    for tag in ("fit/loss", "fit/mass_error", "fit/negative_log_density"):
        logged = [(one["round"], one[tag]) for one in rounds if tag in one]
        seen = [(event.step, event.value) for event in events.Scalars(shown_as(tag))]
        assert seen == [(step, torch.tensor(value, dtype=torch.float32).item()) for step, value in logged], tag
    steps = [event.step for event in events.Scalars(shown_as("fit/loss"))]
    scored = [event.step for event in events.Scalars(shown_as("fit/mass_error"))]
    assert steps == list(range(1, len(steps) + 1))
    assert scored == [*(k for k in (1, 2, 4, 8, 16) if k < len(steps)), len(steps)]
    error = results["errors"]["x1_wrench"]["mass_error"]["mean"]
    assert events.Scalars(shown_as("fit/mass_error"))[-1].value == pytest.approx(error, rel=1e-6)
    assert len(events.Scalars(shown_as("fit/loss"))) > 3


def test_an_evaluation_logs_its_table_before_the_learning_curves(tmp_path, monkeypatch):
    def killed(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(curves, "learning_study", killed)
    run("evaluate.py", *SMALL[:5], "model=[x1_wrench]", f"hydra.run.dir={tmp_path}", status=130)
    logged = read(tmp_path)
    assert {*map(shown_as, ("mass_error/model", "mass_error/irb"))} <= {*logged.Tags()["scalars"]}
    lines = (tmp_path / "metrics.jsonl").read_text().splitlines()
    tags = {tag for line in lines for tag in json.loads(line)}
    assert {"mass_error/whittaker", "back_spin/whittaker", "parameters/whittaker/mu"} <= tags
    assert card(logged)
    with pytest.raises(KeyError):  # a run that was stopped has no row under HParams
        hparams(logged, "session_start_info")


def test_constant_columns_have_no_length_scale():
    drops, recipe = synthetic.load(20), Recipe("state", "velocity")  # of one body
    regressor = learn(drops, recipe, rows=torch.arange(20)).processes
    for one in process_estimates(recipe, regressor, drops.space):
        assert {*SPACES["state"].columns} - {*one.length_scales} == {"m", "I"}


def test_hyperparameters_keep_their_kinds(tmp_path):
    with Tracker(tmp_path, 1) as tracker:
        given = {"law": "mirtich", "effect_a": True, "effect_b": False, "train_size": 20}
        tracker.hyperparameters(given, {"law": ("mirtich", "whittaker")}, {"error/model": "error"})
    events = read(tmp_path)
    assert values(events) == given
    assert values(events)["effect_a"] is True
    experiment = hparams(events, "experiment")
    offered = {info.name: list(info.domain_discrete) for info in experiment.hparam_infos}
    assert offered == {
        "law": ["mirtich", "whittaker"],
        "effect_a": [False, True],
        "effect_b": [False, True],
        "train_size": [],
    }
    assert [info.name for info in experiment.hparam_infos if info.differs] == ["law", "train_size"]  # shown at first
    assert [(info.name.tag, info.display_name) for info in experiment.metric_infos] == [("error/model", "error")]


def test_a_card_holds_names_and_no_markup(tmp_path):
    with Tracker(tmp_path, 1) as tracker:
        tracker.card({"Run": HOSTILE, HOSTILE: "x"}, [[("Model", "Mean"), ("wang_mason + a_b", "0.5")]])
    name = " ".join(HOSTILE.split())
    assert card(read(tmp_path)) == [["Run", name], [name, "x"], ["Model", "Mean"], ["wang_mason + a_b", "0.5"]]


def test_charts_of_all_runs_are_kept(tmp_path):
    """TensorBoard merges layouts, and loses charts under a category that the first run lacks."""
    for name in "abcd":
        with Tracker(tmp_path / name, 1, {"shared": {"all": "error/", name: [f"error/{name}"]}}) as tracker:
            tracker.scalars({})
    assert merged(tmp_path) == {"shared": ["all", *"abcd"]}


def test_every_run_has_the_same_hyperparameters_and_metrics(runs):
    folder, events = runs
    names = {name: list(values(found)) for name, found in events.items()}
    metrics = {
        name: [info.name.tag for info in hparams(found, "experiment").metric_infos] for name, found in events.items()
    }
    assert len({tuple(sorted(keys)) for keys in names.values()}) == 1
    assert len({tuple(tags) for tags in metrics.values()}) == 1
    for name, found in events.items():
        if name != "transfer":  # which has no error of one model
            shown = {tag for tag in metrics[name] if "Mass error" in tag}  # the others are those of another norm
            assert shown <= set(found.Tags()["scalars"]), name
        offered = [(info.name, str(info.domain_discrete)) for info in hparams(found, "experiment").hparam_infos]
        assert offered == [
            (i.name, str(i.domain_discrete)) for i in hparams(events["train"], "experiment").hparam_infos
        ]
    made = {name: values(found) for name, found in events.items()}
    missing = diagnosed(folder).diagnosis.effects
    assert missing
    expected = {
        "train": ("train", "wang_mason", "analytical", 20, ["surface_tilt"]),
        "learned": ("train", "none", "x1_wrench", 20, []),
        "evaluate": ("evaluate", "wang_mason", "analytical", 20, []),
        "evaluate_with": ("evaluate", "wang_mason", "analytical", 60, ["side_drag"]),
        "transfer": ("evaluate", "drumwright_shell", "x1_wrench", 30, []),
        "diagnose": ("diagnose", "wang_mason", "analytical", 100, missing),
    }
    for name, (*told, effects) in expected.items():
        assert [made[name][key] for key in ("command", "law", "model", "train_size")] == told, name
        assert made[name]["effects"] == (", ".join(effects) or "none")
        assert made[name]["settings"].startswith(" ".join(COMMANDS[name][1:3]))


def diagnosed(folder):
    """The result of the diagnosis among the runs."""
    return run_folder.read_result(folder / "diagnose" / "diagnosis.json")


@pytest.mark.parametrize(
    ("name", "model", "size"),
    [("train", "wang_mason + surface_tilt", 20), ("learned", "x1_wrench", 20), ("evaluate", "wang_mason", 20),
     ("evaluate_with", "wang_mason + side_drag", 60)],
)  # fmt: skip
def test_the_metric_is_the_error_of_the_runs_model(runs, name, model, size):
    folder, events = runs
    entry = json.loads((folder / name / "results.json").read_text())["errors"][model]["mass_error"]
    for tag, key in zip(("mass_error/model", *ends("mass_error/model")), ("mean", "low", "high"), strict=True):
        (event,) = events[name].Scalars(shown_as(tag))
        assert (event.step, event.value) == (size, torch.tensor(entry[key], dtype=torch.float32).item())


def test_a_run_has_few_tags_and_says_what_they_are(runs):
    for name, events in runs[1].items():
        tags = [tag for kind in ("scalars", "images", "histograms") for tag in events.Tags()[kind]]
        assert len(tags) <= 30, (name, tags)
        assert all(events.SummaryMetadata(tag).summary_description for tag in events.Tags()["scalars"]), name


def test_learning_curves_have_the_bounds_beside_them(runs):
    folder, events = runs
    results = json.loads((folder / "evaluate" / "results.json").read_text())
    charts = layout(events["evaluate"])[HELD_OUT]
    drawn = {series.value for series in charts["Learned models, Best Post Hoc and IRB bound"].margin.series}
    tags = drawn & {*events["evaluate"].Tags()["scalars"]}
    assert tags == {shown_as(f"curve_mass_error/{name}") for name in ("best_post_hoc", "irb", "x1_wrench")}
    for tag in tags:
        assert sorted({event.step for event in events["evaluate"].Scalars(tag)}) == [10, 20]
    (curve,) = [curve for name, curve in results["learning_curves"].items() if name == "x1_wrench"]
    lines = [json.loads(line) for line in (folder / "evaluate" / "metrics.jsonl").read_text().splitlines()]

    def logged(tag):
        return [line[tag] for line in lines if tag in line]

    lows = [point["low"] for point in curve["mass_error"]]
    assert logged("interval/curve_mass_error/x1_wrench/low") == pytest.approx(lows)
    losses = zip(*(logged(f"curve_loss/x1_wrench/{output}") for output in ("P_t", "P_n", "τ")), strict=True)
    assert logged("curve_loss/x1_wrench") == pytest.approx([sum(each) / 3 for each in losses])
    for tag in ("curve_noise/x1_wrench/τ", "curve_length_scale/x1_wrench/τ/v_n"):
        assert [value > 0 for value in logged(tag)] == [True, True]
    best = [point["mean"] for point in results["learning_curves"]["best_post_hoc"]["mass_error"]]
    level = results["errors"]["irb"]["mass_error"]["mean"]
    for name, line in {"best_post_hoc": best, "irb": [level, level]}.items():
        assert logged(f"curve_mass_error/{name}") == pytest.approx(line)
    # Charts name tags that are there, with the mean inside; lines match something.
    for name, found in events.items():
        tags, charts = found.Tags()["scalars"], [chart for part in layout(found).values() for chart in part.values()]
        for chart in charts:
            series = [one for one in chart.margin.series if one.value in tags]
            assert series or chart.multiline.tag, (name, chart.title)
            for one in series:
                for low, mean, high in zip(*map(found.Scalars, (one.lower, one.value, one.upper)), strict=True):
                    assert low.value <= mean.value <= high.value
                    assert low.step == mean.step == high.step
            for pattern in chart.multiline.tag:
                assert any(re.match(pattern, tag) for tag in tags), (name, pattern)
    titles = {name: [title for part in layout(found).values() for title in part] for name, found in events.items()}
    shown = merged(folder)
    assert {title for part in shown.values() for title in part} == {title for part in titles.values() for title in part}
    assert list(shown) == [
        "Ladder of a diagnosis",  # of the first run
        HELD_OUT,
        "Rounds of training: mass error",
        "Transfer to other bodies: held-out mass error against their training impacts",
    ]


def test_the_ladder_is_a_chart(runs, monkeypatch):
    folder, events = runs
    result, events = diagnosed(folder), events["diagnose"]
    found = result.diagnosis
    ladder, floor = ([rung.error.mean for rung in found.ladder if (rung.kind in FLOORS) is of] for of in (False, True))
    rungs = {event.step: event.value for event in events.Scalars(shown_as("ladder/mass_error"))}
    assert rungs == dict(enumerate(torch.tensor(ladder).tolist()))
    assert shown_as("ladder/mass_error").startswith("Steps of the ladder/")  # which no smoothing bends under Errors
    assert {tag.partition("/")[0] for tag in events.Tags()["scalars"]} == {"HParams", "Steps of the ladder"}
    noise = [event.value for event in events.Scalars(shown_as("floor/mass_error"))]
    assert noise == torch.tensor(floor[:1] * len(ladder)).tolist()
    series = next(iter(layout(events)["Ladder of a diagnosis"].values())).margin.series
    assert [one.value for one in series] == [shown_as(f"{kind}/mass_error") for kind in ("ladder", "floor")]
    model = events.Scalars(shown_as("mass_error/model"))
    assert model[0].value == torch.tensor(ladder[len(found.missing)]).item()
    assert shown_as("figures/ladder") in events.Tags()["images"]
    assert next(iter(layout(events))) == "Ladder of a diagnosis"  # the headline first
    rows = card(events)
    assert "missing from the Wang–Mason law" in dict(row[:2] for row in rows)["Verdict"]
    assert dict(row[:2] for row in rows)["Verdict"] == result.headline
    assert result.headline in html.unescape((runs[0] / "diagnose" / "report.html").read_text())
    assert dict(row[:2] for row in rows)["Next"] == f"contactlearn train model={folder / 'diagnose'}"
    steps = [rung_label(rung, base_label(found)) for rung in found.ladder]
    assert [row[0] for row in rows[-len(steps) :]] == steps
    assert any(row[0].partition(":")[0] == found.effects[0] for row in rows)
    # From the folder alone: neither the data nor any fit is there.
    folder = runs[0] / "diagnose"
    drawn = (folder / "report.html").read_bytes()
    (folder / "report.html").unlink()
    monkeypatch.setattr(hidden_effects, "load", None)
    monkeypatch.setattr(robust, "search", None)
    assert main(["report", str(folder)]) == 0
    assert (folder / "report.html").read_bytes() == drawn


def test_cards_tell_what_was_run_and_found(runs):
    folder, events = runs
    for name, command in COMMANDS.items():
        rows = dict(row[:2] for row in card(events[name]))
        result = next((folder / name).glob("[rd]*s.json"))
        content = json.loads(result.read_text())
        data = content.get("provenance", content)["data"]
        assert rows["Command"].startswith(f"contactlearn {command[0].removesuffix('.py')} {command[1]}")
        assert rows["SHA-256 of the data"] == data["sha256"]
        assert rows["Data"] == f"{data['source']}, {data['trials']} impacts"
        assert "contactlearn 0." in rows["Versions"]
    rows = dict(row[:2] for row in card(events["train"]))
    assert re.fullmatch(r"μ = 0\.\d+ ± 0\.\d+, ε = 0\.\d+ ± 0\.\d+", rows["wang_mason (textbook)"])
    assert rows["surface_tilt"].startswith(find_effect("surface_tilt").formula)
    assert re.search(r"φ = −?0\.\d+ ± 0\.\d+ rad$", rows["surface_tilt"])
    errors = json.loads((folder / "train" / "results.json").read_text())["errors"]
    shown = {row[0]: row[1:] for row in card(events["train"]) if len(row) == 3}
    entry = errors["wang_mason + surface_tilt"]["mass_error"]
    assert shown["wang_mason + surface_tilt"] == [f"{entry['mean']:.4f}", f"{entry['low']:.4f}–{entry['high']:.4f}"]


def test_a_diagnosis_of_no_impacts_is_a_run_too(tmp_path, runs):
    impacts, _ = hidden_effects.draw(5, effects=[], size=120)
    order = torch.randperm(120, generator=torch.Generator().manual_seed(0))
    spoilt = impacts.v_post[order] * torch.tensor((1.0, -1.0, 3.0))
    table.save(impacts.replace(v_post=spoilt, validate=False), tmp_path / "drops.csv")
    run("diagnose.py", "data=table", f"data.path={tmp_path / 'drops.csv'}", f"hydra.run.dir={tmp_path / 'run'}")
    events = read(tmp_path / "run")
    assert "inconsistent" in dict(row[:2] for row in card(events))["Verdict"]
    assert values(events).keys() == values(runs[1]["train"]).keys()
    assert values(events)["law"] == "none"
    assert shown_as("ladder/mass_error") not in events.Tags()["scalars"]


def test_points_of_learning_curves_are_logged_in_order_as_soon_as_they_are_there(tmp_path):
    """A size that is ready before a smaller one waits for it: TensorBoard drops what lies beyond a later step."""
    drops, seen = synthetic.load(40), RecordingObserver()
    points = CurvePoints((10, 20, 30), drops, seed=0, resamples=50, on_event=seen)
    predicted = ContactModel(find("whittaker")).predict(drops)
    for model, size in [("a", 10), ("a", 30), ("b", 20), ("a", 20), ("b", 10)]:
        points.add(model, Curve.of(drops, {size: predicted}))
    with Tracker(tmp_path, 1) as tracker:
        for event in seen:
            tracker(event)
    assert [(one.model, one.trained_on) for one in seen] == [("a", 10), ("a", 20), ("a", 30), ("b", 10), ("b", 20)]
    assert len({one.errors["mass_error"] for one in seen}) == 1  # the same resamples
    steps = [event.step for event in Events(str(tmp_path)).Reload().Scalars(shown_as("curve_mass_error/a"))]
    assert sorted({*steps}) == [10, 20, 30]
