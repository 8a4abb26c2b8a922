"""Bodies of different shape in one table: each is as it is alone, from the file to the page."""

import json
import pickle

import pandas as pd
import pytest
import torch
from commands import run
from hypothesis import given, strategies as st
from pyarrow.csv import read_csv
from test_report_page import into_view, opened, until

from contactlearn import laws
from contactlearn.core.errors import ContactLearnError, DataError
from contactlearn.data import table, tracks
from contactlearn.data.audit.corrections import correct
from contactlearn.data.audit.findings import audit
from contactlearn.data.audit.trials import gross_outliers
from contactlearn.data.blocks import joined
from contactlearn.data.table import table_blocks
from contactlearn.diagnosis.discrimination.experiment import Substitution, next_experiment
from contactlearn.diagnosis.record import Record
from contactlearn.effects import EffectId, State, columns, find_effect
from contactlearn.inference.evaluation.variables import symmetry
from contactlearn.inference.identification import joint
from contactlearn.inference.identification.joint import assemble
from contactlearn.mechanics.bodies import Shapes, contact_points, make_shapes, shapes_entries
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.shapes import Disc, Ellipse, Polygon, contact_point
from contactlearn.models import checkpoint
from contactlearn.models.contact_model import ContactModel
from contactlearn.report.page.trials import outlines
from contactlearn.results import folder as run_folder
from contactlearn.simulation import recordings, synthetic

OAK = {"kind": "ellipse", "semi_axes": [0.035, 0.025]}
BEECH = {"kind": "polygon", "vertices": [[0.03, 0.02], [-0.03, 0.02], [-0.03, -0.02], [0.03, -0.02]]}
SPECS = {"oak": OAK, "beech": BEECH}
SETTING = (
    "data.shape={oak: {kind: ellipse, semi_axes: [0.035, 0.025]}, "
    "beech: {kind: polygon, vertices: [[0.03, 0.02], [-0.03, 0.02], [-0.03, -0.02], [0.03, -0.02]]}}"
)
ROUNDING = 1e-12  # relative to 1 m/s and 10 rad/s: sums of a longer batch
MOVING = ("shape_error", "corner_radius", "orientation_offset", "sampling_delay", "surface_tilt", "com_offset")


def alone(name, size=150, seed=0, **settings):
    """Drops of one body, with trials of its name."""
    drops = synthetic.load(
        size=size, shape=SPECS[name], mass=0.05 if name == "beech" else 0.0364, seed=seed, **settings
    )
    return drops.replace(object=(name,) * size, trial=tuple(f"{name} {k}" for k in range(size)))


def mixed(first, second):
    """Both in one table, in turn."""
    both = joined([first.replace(shape=None), second.replace(shape=None)])
    order = torch.arange(len(both)).reshape(2, -1).T.flatten()
    return both[order].replace(shape=make_shapes(SPECS), order=torch.arange(len(both)) + 1.0)


@pytest.fixture(scope="module")
def parts():
    return {name: alone(name, seed=seed) for seed, name in enumerate(SPECS)}


@pytest.fixture(scope="module")
def both(parts):
    return mixed(*parts.values())


@pytest.fixture(scope="module")
def files(parts, both, tmp_path_factory):
    """Tables of each body and of both, without what the shape gives."""
    tmp_path = tmp_path_factory.mktemp("files")
    for name, impacts in {**parts, "both": both}.items():
        path = table.save(impacts, tmp_path / f"{name}.csv")
        pd.read_csv(path).drop(columns=["rx", "ry", "inertia"]).to_csv(path, index=False)
    return tmp_path


def of(impacts, name):
    """The trials of a body, in order."""
    return impacts[[k for k, other in enumerate(impacts.object) if other == name]]


def test_contact_points_and_inertia_are_those_of_the_bodies_alone(files):
    both = table.read(files / "both.csv", shape=SPECS)
    assert both.computed == ("inertia", "r")
    for name, shape in SPECS.items():
        own, single = of(both.impacts, name), table.load(files / f"{name}.csv", shape=shape)
        assert torch.equal(own.r, single.r)
        assert torch.equal(own.inertia, single.inertia)
        assert own.shape[name] == single.shape
    path = files / "both.csv"
    turned = read_csv(path).to_pandas().assign(theta=lambda frame: -frame["theta"], omega=lambda frame: -frame["omega"],
                                      omega_post=lambda frame: -frame["omega_post"])  # fmt: skip
    turned.to_csv(files / "turned.csv", index=False)
    spoilt = table.load(files / "turned.csv", shape=SPECS, validate=False)
    right = correct(spoilt, ["mirrored_theta"], computed_contact=True)
    assert torch.equal(right.r, table.load(path, shape=SPECS).r)


@pytest.mark.parametrize("law", laws.names())
def test_laws_predict_the_same(law, parts, both):
    model = ContactModel(laws.find(law).at(0.2, 0.5))
    for name, single in parts.items():
        found, expected = model.predict(of(both, name)), model.predict(single)
        assert torch.allclose(found.v_post, expected.v_post, rtol=ROUNDING, atol=ROUNDING)
        assert torch.allclose(model.predict(both).wrench[:, 2], torch.zeros(1).double(), atol=ROUNDING)


@pytest.mark.parametrize("name", MOVING)
def test_effects_predict_the_same(name, parts, both):
    """An effect of the shape acts on every body with the same parameters."""
    effect = find_effect(name)()
    low, high = torch.tensor([(p.low, p.high) for p in effect.parameters], dtype=torch.float64).T
    values = columns(*effect.vanished().values) + torch.tensor([[0.1], [-0.05]]) * (high - low)
    values = values.clamp(low, high)
    theta = torch.cat((torch.tensor((0.2, 0.5)).double().expand(2, 2), values), -1)
    model = assemble(laws.find("wang_mason"), {name: effect}, theta)
    together = model.predict(both).v_post
    for body, single in parts.items():
        rows = [k for k, other in enumerate(both.object) if other == body]
        assert torch.allclose(together[:, rows], model.predict(single).v_post, rtol=ROUNDING, atol=ROUNDING)


def test_residuals_of_a_fit_are_those_of_its_bodies(parts, both):
    fit = joint.fit(both, "wang_mason", ["shape_error"])
    residual = both.v_post - fit.model.predict(both).v_post
    for name, single in parts.items():
        rows = [k for k, other in enumerate(both.object) if other == name]
        expected = single.v_post - fit.model.predict(single).v_post
        assert torch.allclose(residual[rows], expected, rtol=ROUNDING, atol=ROUNDING)


@given(theta=st.lists(st.floats(-10, 10), min_size=1, max_size=8), which=st.randoms())
def test_batched_equals_looped(theta, which):
    shapes = {"oak": Ellipse((0.035, 0.025)), "beech": make_shapes(BEECH), "disc": Disc(0.02)}
    names = [which.choice([*shapes]) for _ in theta]
    angles = torch.tensor(theta, dtype=torch.float64)
    nothing = torch.zeros(len(theta))
    state = State.of(
        Impacts(*(nothing + 1,) * 2, *(nothing[:, None].expand(-1, n) for n in (2, 3, 3, 3)), object=tuple(names),
                shape=shapes, validate=False)
    )  # fmt: skip
    batch = torch.stack((angles, angles + 0.5))
    found = state.contact_points(batch)
    for k, name in enumerate(names):
        assert torch.allclose(found[:, k], contact_point(shapes[name], batch[:, k]), rtol=1e-14, atol=1e-16)


def test_contact_points_are_differentiable_and_symmetries_those_of_all(both):
    theta = both.q[:, 2].clone().requires_grad_()
    contact_points(both.shape, both.body, theta)[:, 1].sum().backward()
    r = contact_points(both.shape, both.body, both.q[:, 2])
    assert torch.allclose(theta.grad, r[:, 0], rtol=1e-9)  # the height falls as the body rolls: dr_y/dθ = r_x
    square = Polygon(((0.02, 0.02), (-0.02, 0.02), (-0.02, -0.02), (0.02, -0.02)))
    ellipse, disc = Ellipse((0.03, 0.02)), Disc(0.02)
    for shapes, folds in (((square,), 4), ((square, ellipse), 2), ((square, disc), 4), ((disc, disc), 1)):
        assert symmetry(Shapes(tuple((str(k), shape) for k, shape in enumerate(shapes)))) == folds


def test_one_shape_by_name_changes_no_bit(parts):
    single = parts["beech"]
    named = single.replace(shape={"beech": single.shape, "oak": Disc(1.0)})
    effects = {name: find_effect(name)() for name in ("shape_error", "corner_radius")}
    theta = torch.tensor((0.2, 0.5, 0.1, -0.05, 0.002)).double()
    model = assemble(laws.find("mirtich"), effects, theta)
    assert torch.equal(model.predict(named).v_post, model.predict(single).v_post)
    assert all(torch.equal(a, b) for a, b in zip(*(gross_outliers(x).values() for x in (named, single)), strict=True))


def test_the_shape_error_of_two_bodies_is_found():
    """Both bodies are 6 % longer along their first axis than they are said to be."""
    longer = {
        "oak": Ellipse((0.035 / 1.06, 0.025)),
        "beech": Polygon(tuple((x / 1.06, y) for x, y in BEECH["vertices"])),
    }
    drops = mixed(*(alone(name, size=300, seed=seed, spin_noise=0.1) for seed, name in enumerate(SPECS)))
    message = drops.replace(shape=longer, r=contact_points(longer, drops.body, drops.q[:, 2]), validate=False)
    good = message.v_c[:, 1] < 0
    fit = joint.fit(message[good].replace(validate=True), "wang_mason", ["shape_error"])
    s_a, s_b = fit.values[-2:].tolist()
    assert abs(s_a - 0.06) < 0.01
    assert abs(s_b) < 0.01


def test_the_audit_knows_each_body(both):
    shapes = {**both.shape, "beech": Disc(0.06)}
    (finding,) = [one for one in audit(both.replace(shape=shapes)) if one.name == "contact_point_off_shape"]
    assert "contact points of 'beech'" in finding.sentence
    assert "radius=0.06" in finding.sentence
    assert not [one for one in audit(both) if one.name == "contact_point_off_shape"]
    mirror = torch.tensor((-1.0, 1.0, 1.0))
    spoilt = both.replace(q=both.q * mirror, v_pre=both.v_pre * mirror, v_post=both.v_post * mirror, validate=False)
    assert [one.correction for one in audit(spoilt)] == ["mirrored_x"]


REFUSED = {
    "no shape": ({"oak": OAK}, ["row 2", "'beech' must have a shape", "has those of oak", "line 3"]),
    "a slip": ({"oka": OAK, "beech": BEECH}, ["row 1", "'oak' must have a shape, did you mean 'oka'?"]),
    "a stranger": ({**SPECS, "beach": OAK}, ["data.shape.beach is of no body", "did you mean 'beech'?", "oak, beech"]),
    "one and several": ({**OAK, "beech": BEECH}, ["one shape, {kind: …}, or one for each body", "kind: ellipse"]),
    "null": ({"oak": OAK, "beech": None}, ["shapes of oak, and also beech: None"]),
    "a kind": ({"oak": OAK, "beech": {"kind": "elipse"}}, ["data.shape.beech: unknown shape kind", "'ellipse'"]),
    "a length": ({"oak": OAK, "beech": {"kind": "disc", "radius": -1}}, ["data.shape.beech: radius", "positive"]),
}


@pytest.mark.parametrize("case", REFUSED)
def test_wrong_shapes_are_refused(case, files):
    shape, words = REFUSED[case]
    with pytest.raises(DataError) as caught:
        table.load(files / "both.csv", shape=shape)
    assert all(word in str(caught.value) for word in words), caught.value


def test_shapes_must_be_those_of_the_bodies(files, both):
    pd.read_csv(files / "both.csv").drop(columns="object").to_csv(files / "nameless.csv", index=False)
    with pytest.raises(DataError, match=r"shapes of oak, beech, but the table has no column object"):
        table.load(files / "nameless.csv", shape=SPECS)
    with pytest.raises(DataError, match="one shape is needed here"):
        synthetic.load(size=10, shape=SPECS)
    with pytest.raises(DataError, match="'beech' must have a shape"):
        both.replace(shape={"oak": Disc(0.02)})
    assert both.replace(shape=dict(both.shape)).shape == both.shape
    state = State.of(both).replace(body=None)
    with pytest.raises(ContactLearnError, match="need the body of each trial"):
        state.contact_points(state.theta)


def test_choosing_joining_and_pickling_keep_the_shapes(both, tmp_path, parts):
    assert both[:7].shape == both.shape
    assert joined([both[:7], both[7:]]).shape == both.shape
    again = pickle.loads(pickle.dumps(both))
    assert again.shape == both.shape
    assert hash(again.shape) == hash(both.shape)
    assert again.fingerprint() == both.fingerprint()
    assert make_shapes(json.loads(json.dumps(shapes_entries(both.shape)))) == both.shape
    # A held-out part may lack a body; the shapes of a larger table are no strangers to it.
    path = table.save(of(both, "oak"), tmp_path / "oak.csv")
    assert table_blocks(path, both.shape).pick(torch.ones(150, dtype=torch.bool)).shape == both.shape
    model = ContactModel(laws.find("wang_mason").at(0.2, 0.5))
    record = Record(impacts=both, base=model, model=model, outcomes=both.v_post[None])
    record.save(tmp_path, {})
    assert Record.load(tmp_path).impacts.shape == both.shape
    assert checkpoint.load(tmp_path / "model.pt").predict(both).v_post.equal(model.predict(both).v_post)
    found = outlines(both)
    assert [*found] == ["oak", "beech"]
    assert found["beech"] == outlines(parts["beech"])[""]
    assert outlines(both.replace(shape=None)) == {}


def test_a_large_table_is_refused_at_its_end(both, tmp_path):
    path = table.save(both, tmp_path / "both.csv")
    blocks = [*table.read_blocks(path, 7, shape=SPECS)]
    assert torch.equal(joined([one.impacts for one in blocks]).r, both.r)
    with pytest.raises(DataError, match=r"data\.shape\.ash is of no body"):
        [*table.read_blocks(path, 7, shape={**SPECS, "ash": OAK})]


def test_drops_to_come_are_of_a_named_body(both):
    chosen, other = (
        ContactModel(laws.find("wang_mason").at(0.2, 0.5), effects={"shape_error": find_effect("shape_error")().at(x)})
        for x in ([0.1, 0.0], [0.0, 0.1])
    )
    rival = Substitution(EffectId("shape_error", None), EffectId("com_offset", "contact"))
    seeded = torch.Generator().manual_seed(0)
    drops = next_experiment(both, chosen, {rival: other}, generator=seeded).drops
    assert {drop.body for drop in drops} <= {"oak", "beech"}
    drops = next_experiment(of(both, "oak"), chosen, {rival: other}, generator=seeded).drops
    assert {drop.body for drop in drops} == {None}


def test_recordings_are_of_one_of_the_bodies(tmp_path):
    recordings.write_recordings(recordings.simulate(12)[0], tmp_path)
    shape = {"oak": dict(OAK, semi_axes=list(recordings.SEMI_AXES)), "beech": BEECH}
    settings = {"mass": recordings.MASS, "shape": shape}
    found = tracks.find(tmp_path, **settings, body="oak").impacts
    assert found.object[0] == "oak"
    assert found.shape == make_shapes(shape["oak"])
    with pytest.raises(DataError, match=r"data\.body must say which body"):
        tracks.find(tmp_path, **settings)
    with pytest.raises(ContactLearnError, match="did you mean 'oak'"):
        tracks.find(tmp_path, **settings, body="oka")


WORDS = ("data=table", "data.path=few.csv", SETTING, "law=wang_mason")


@pytest.fixture(scope="module")
def printed(files):
    """What a diagnosis of a third of the trials into the folder `found` printed."""
    (files / "few.csv").write_text("".join((files / "both.csv").read_text().splitlines(keepends=True)[:101]))
    return run("diagnose.py", *WORDS, "hydra.run.dir=found", cwd=files)


def test_the_page_draws_the_body_of_the_trial(files, printed, browser):
    shown = opened(browser, files / "found" / "report.html")
    into_view(shown, "picture")
    for name, corners in (("oak", 91), ("beech", 5)):
        shown.execute_script(f"select(trials.object.indexOf('{name}'))")
        until(shown, f"document.getElementById('picture').data?.[0].x.length === {corners}")
    assert shown.get_log("browser") == []


@pytest.mark.nightly
def test_commands_take_shapes_by_body(files, printed):
    """Diagnose and evaluate a table of two bodies; pages are drawn again from their folders."""
    assert "computed: the inertia from the shape and the mass, at uniform density; contact points from" in printed
    assert Record.load(files / "found").impacts.shape == make_shapes(SPECS)
    small = ("train.repetitions=2", "figures.repetitions=2", "bootstrap=20", "effect=[shape_error]", "model=[]")
    run("evaluate.py", *WORDS, *small, "hydra.run.dir=used", cwd=files)
    result = run_folder.read_result(files / "used" / "results.json")
    assert make_shapes(result.shape) == make_shapes(SPECS)
    pages = [files / name / "report.html" for name in ("found", "used")]
    drawn = [page.read_text("utf-8") for page in pages]
    for page in pages:
        page.unlink()
        run("contactlearn", "report", str(page.parent))
    assert [page.read_text("utf-8") for page in pages] == drawn
    assert all('"beech"' in page for page in drawn)


def test_the_audit_command_and_export_take_shapes_by_body(files):
    printed = run("contactlearn", "audit", "both.csv", SETTING, cwd=files)
    assert "the moment balance closes" in printed
    run("contactlearn", "export", "out.csv", "data=table", "data.path=both.csv", SETTING, cwd=files)
    exported, read = (table.load(files / name, shape=SPECS) for name in ("out.csv", "both.csv"))
    assert torch.equal(exported.r, read.r)
    wrong = SETTING.replace("beech", "beach")
    printed = run("contactlearn", "audit", "both.csv", wrong, cwd=files, status=2)
    assert "'beech' must have a shape, did you mean 'beach'?" in printed


def test_the_workbench_takes_shapes_by_body(files):
    pytest.importorskip("dash")
    from contactlearn.workbench.arrays import of_data
    from contactlearn.workbench.models import Models
    from contactlearn.workbench.session import Session

    session = Session(
        data=("data=table", f"data.path={files / 'both.csv'}", SETTING), effects=(EffectId("shape_error", None),)
    )
    models = Models()
    impacts, fitted = models.split(session).impacts, models.fitted(session)
    assert impacts.shape == make_shapes(SPECS)
    assert [*of_data(impacts, fitted.fit.model.predict(impacts))["outlines"]] == ["oak", "beech"]
    other = Session(data=(*session.data[:2], SETTING.replace("0.035", "0.036")))
    assert models.fingerprint(other) != models.fingerprint(session)
