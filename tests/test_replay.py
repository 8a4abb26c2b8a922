"""Replays: the law that made recordings follows them, another one does not; the command and its page."""

import json
import shlex
from dataclasses import replace
from types import SimpleNamespace

import pandas as pd
import pytest
import torch
from browser import chromium, nothing_sticks_out
from commands import run
from scipy.spatial.transform import Rotation
from test_report_page import draw_everything, opened, silent, until

from contactlearn import ContactModel, laws
from contactlearn.core.errors import DataError
from contactlearn.data import tracks
from contactlearn.effects import find_effect
from contactlearn.inference.evaluation.replay import STARTS, Replay, ReplayErrors, replays
from contactlearn.mechanics.apparatus import Apparatus, Estimate
from contactlearn.mechanics.body_state import BodyState
from contactlearn.mechanics.shapes import Cuboid, Ellipse
from contactlearn.mechanics.space import PLANE, SPACE
from contactlearn.models import checkpoint
from contactlearn.models.roll_out import Until
from contactlearn.report.page.replays import write_replay_page
from contactlearn.report.text.replays import replay_sentence
from contactlearn.scatter import Normal, Restitution
from contactlearn.simulation.camera import Camera
from contactlearn.simulation.recordings import MASS, SEMI_AXES, random_throws, simulate, write_recordings
from contactlearn.workbench.files import SavedRun, SavedRuns, run_list

MODELS = {
    "true": ContactModel(laws.find("wang_mason").at(0.12, 0.55)),
    "sticky": ContactModel(laws.find("wang_mason").at(0.9, 0.55)),
}
SHAPE = f"data.shape={{kind:ellipse,semi_axes:[{SEMI_AXES[0]},{SEMI_AXES[1]}]}}"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("takes")
    write_recordings(simulate(8, Camera(frames=400), seed=3)[0], folder)
    return folder


@pytest.fixture(scope="module")
def found(folder):
    return tracks.find_impacts(folder, mass=MASS, shape=Ellipse(SEMI_AXES))


@pytest.fixture(scope="module")
def shown(found):
    return replays(MODELS, found)


def test_the_law_that_made_recordings_follows_them(shown):
    true, sticky = (ReplayErrors.of(shown, name) for name in MODELS)
    assert len(shown) == 8
    assert true.distance.median < 0.01
    assert true.angle.median < 0.02
    assert sticky.distance.median > 5 * true.distance.median
    assert sticky.lost_after is not None
    assert all(one.errors("sticky")[one.bounces == 0].max() < 0.01 for one in shown)


def test_a_model_of_a_larger_body_flies_as_high_above_its_own_floor(found):
    """Before its first contact a prediction does not depend on the outline."""
    sizes = {"shape_error": find_effect("shape_error")().at(torch.tensor([0.25, 0.25]))}
    larger = ContactModel(MODELS["true"].base, effects=sizes)
    for one in replays(MODELS | {"larger": larger}, found):
        flying = one.bounces == 0
        assert torch.allclose(one.predicted["larger"][flying], one.predicted["true"][flying], atol=1e-9)


def test_errors_are_distances_over_the_width_and_angles(shown):
    one = shown[0]
    apart = one.predicted["sticky"][5] - one.recorded[5]
    assert one.errors("sticky")[5, 0] == pytest.approx(apart[:2].norm().item() / (2 * SEMI_AXES[0]))
    whole_turn = one.recorded + torch.tensor([0.0, 0.0, 2 * torch.pi], dtype=torch.float64)
    moved = type(one)(**{**vars(one), "predicted": {"true": whole_turn}})
    assert moved.errors("true").max() < 1e-9


def test_corrections_of_impacts_are_those_of_recorded_poses(found, shown):
    mirrored = replays({"true": MODELS["true"]}, found, ["mirrored_x"])
    assert torch.allclose(mirrored[0].recorded[:, 0], -shown[0].recorded[:, 0])


def test_recordings_of_the_fit_are_left_out(found):
    names = [contact.recording for contact in found.survey.contacts]
    assert names[0] not in {one.recording for one in replays({"true": MODELS["true"]}, found, without={names[0]})}
    with pytest.raises(DataError, match="no recording is left"):
        replays(MODELS, found, without=set(names))


def filmed(world, count, folder):
    """Throws of the ellipse by a model whose contact scatters, at 500 frames a second with noise."""
    generator = torch.Generator().manual_seed(11)
    q, v = random_throws(count, generator)
    body = BodyState(pose=q, velocity=v, shape=Ellipse(SEMI_AXES), mass=MASS, inertia=1.7e-5)
    path, frames = world.roll_out(body, until=Until(bounces=4), samples=1, generator=generator), []
    for k, end in enumerate(path.end[0].tolist()):
        time = torch.arange(0, end, 1 / 500, dtype=torch.float64)
        seen = path.at(time)[0, k]
        seen = seen + torch.randn(seen.shape, generator=generator) * torch.tensor([5e-5, 5e-5, 1e-3])
        frames.append(pd.DataFrame(seen.numpy(), columns=PLANE.pose).assign(recording=f"throw{k}", time=time.numpy()))
    pd.concat(frames).to_parquet(folder / "throws.parquet")
    return tracks.find_impacts(folder / "throws.parquet", mass=MASS, inertia=1.7e-5, shape=Ellipse(SEMI_AXES))


@pytest.mark.nightly
def test_a_fan_holds_what_a_contact_that_scatters_does(tmp_path):
    """Recordings by a law whose restitution and normal scatter; bands without that hold far fewer positions."""
    components = {"restitution": Restitution(sigma=0.05), "normal": Normal(sigma=0.03)}
    world = replace(MODELS["true"], scatter=components)
    still = replace(world, scatter={"restitution": Restitution(sigma=1e-6)})
    fitted = {"scatter": world, "still": still, "true": MODELS["true"]}
    found = filmed(world, 40, tmp_path)
    shown = replays(fitted, found)
    errors = {name: ReplayErrors.of(shown, name) for name in fitted}
    assert len(shown) >= 30
    assert all(0.82 < share < 0.97 for share in errors["scatter"].coverage[:2]), errors
    assert errors["still"].coverage[1] < 0.5
    assert errors["true"].coverage is None
    before = shown[0].bounces[: shown[0].fans["scatter"].shape[1]] == 0
    spread = shown[0].fans["scatter"].std(0)[:, :2]
    assert spread[before].max() < 1e-3
    assert "% lie in the 90 % bands after one, two, three bounces" in replay_sentence(errors["scatter"]).replace(
        "\u00a0", " "
    )


def test_the_command_and_its_page(folder, tmp_path):
    for name, model in MODELS.items():
        scatter = {"normal": Normal(sigma=0.02)} if name == "true" else {}
        checkpoint.save(replace(model, scatter=scatter), tmp_path / "run" / f"{name}.pt", provenance={})
    words = ("data=tracks", f"data.path={folder}", f"data.mass={MASS}", SHAPE)
    printed = run("contactlearn", "replay", "run", *words, "-o", "seen", cwd=tmp_path)
    assert "8 of 8 recordings" in printed
    assert set(json.loads((tmp_path / "seen" / "replay.json").read_text())) == {
        f"wang_mason ({name})" for name in MODELS
    }
    with chromium() as browser:
        page = opened(browser, tmp_path / "seen" / "replay.html")
        draw_everything(page)
        page.execute_script("const w = get('when'); w.value = 30; w.dispatchEvent(new Event('input'))")
        assert until(page, "document.getElementById('now').textContent.length > 3")
        page.execute_script("get('play').click()")
        assert until(page, "replayed.frame > 30")
        assert page.execute_script("return track().fan.length === 1 && track().fan[0].length > 10")
        assert silent(page)
        assert nothing_sticks_out(page)


CUBE, BODY = Cuboid((0.05, 0.05, 0.05)), {"mass": 0.4, "inertia": 8e-4}


@pytest.fixture(scope="module")
def tossed(tmp_path_factory):
    """Tosses of a cube by the first law, at 240 frames a second with errors of 0.05 mm and half a milliradian."""
    generator, path = torch.Generator().manual_seed(5), tmp_path_factory.mktemp("tosses") / "tosses.parquet"
    pose, velocity = (torch.randn(8, k, generator=generator, dtype=torch.float64) for k in (7, 6))
    pose[:, 2], pose[:, 3:] = 0.3, pose[:, 3:] / pose[:, 3:].norm(dim=-1, keepdim=True)
    state = BodyState(pose=pose, velocity=velocity * torch.tensor((0.5, 0.5, 0.5, 4, 4, 4)), shape=CUBE, **BODY)
    found = MODELS["true"].roll_out(state, until=Until(bounces=4))
    frames = []
    for k, end in enumerate(found.end.tolist()):
        time = torch.arange(0, end, 1 / 240, dtype=torch.float64)
        seen = found.at(time.expand(8, -1))[k]
        seen = seen + torch.randn(seen.shape, generator=generator) * torch.tensor([5e-5] * 3 + [2.5e-4] * 4)
        seen[:, 3:] /= seen[:, 3:].norm(dim=-1, keepdim=True)
        frames.append(pd.DataFrame(seen.numpy(), columns=SPACE.pose).assign(recording=f"toss{k}", time=time.numpy()))
    pd.concat(frames).to_parquet(path)
    return tracks.find_impacts(path, shape=CUBE, **BODY)


@pytest.mark.nightly
def test_in_space_the_law_that_made_recordings_follows_them(tossed, tmp_path):
    medians = {}
    for start in STARTS:
        shown = replays(MODELS, tossed, start=start)
        true, sticky = (ReplayErrors.of(shown, name) for name in MODELS)
        assert all(one.recorded.shape == (len(one.time), 7) for one in shown)
        assert sticky.distance.median > 3 * true.distance.median
        medians[start] = true.distance.median
    assert medians["flight"] < 0.03
    assert medians["flight"] < medians["frames"] < 0.3
    page = write_replay_page(tmp_path / "replay.html", shown, {name: true for name in MODELS}, "all of them")
    with chromium() as browser:
        page = opened(browser, page)
        draw_everything(page)
        page.execute_script("const w = get('view'); w.value = 90; w.dispatchEvent(new Event('input'))")
        summary = "get('bodies').layout.meta ?? document.getElementById('bodies').innerHTML"
        assert page.execute_script(f"return String({summary}).length") > 0
        assert page.execute_script("return !get('view').closest('p').hidden")
        assert silent(page)
        assert nothing_sticks_out(page)


@pytest.mark.nightly
def test_a_mass_centre_on_the_rig_card_is_that_of_an_effect(tossed):
    """Corrected recordings with the law, and recordings as they are with the effect, turn alike."""
    delta = 0.006
    card = Apparatus(
        gravity=tossed.rig.gravity, delay=tossed.rig.delay, centre_c=Estimate(value=delta, error=delta / 100)
    )
    known = replace(tossed, impacts=tossed.impacts.replace(apparatus=card))
    offset = find_effect("com_offset", "tracked")().at([torch.tensor(x) for x in (0.0, 0.0, delta)])
    other = ContactModel(MODELS["true"].base, effects={"com_offset": offset})
    corrected, stated = replays({"law": MODELS["true"]}, known, ["rig"]), replays({"law": other}, known)
    for one, two in zip(corrected, stated, strict=True):
        assert (two.errors("law")[:, 1] - one.errors("law")[:, 1]).abs().max() < 1e-6
        assert (two.errors("law")[-1, 1]) > 0.01


def test_an_angle_in_space_is_that_of_the_turn_between():
    turned = torch.tensor([[0.1, 0, 0, *Rotation.from_rotvec((0, 0.3, 0.4)).as_quat(scalar_first=True)]])
    still = torch.tensor([[0.0, 0, 0, 1, 0, 0, 0]])
    one = Replay(
        recording="a", time=torch.zeros(1), recorded=still, predicted={"m": turned, "opposite": -turned},
        bounces=torch.zeros(1, dtype=torch.int64), shape=CUBE, fans={}, noise=torch.zeros(3),
    )  # fmt: skip
    assert one.errors("m")[0].tolist() == pytest.approx([1.0, 0.5])
    assert one.errors("opposite")[0, 1].item() == pytest.approx(0.5)


@pytest.mark.nightly
def test_the_workbench_writes_and_opens_the_replay_of_a_run(folder, tmp_path, monkeypatch):
    checkpoint.save(MODELS["true"], tmp_path / "run" / "model.pt", provenance={})
    words = shlex.join(["diagnose", "data=tracks", f"data.path={folder}", f"data.mass={MASS}", SHAPE])
    found = SimpleNamespace(law="wang_mason", given=(), missing=())
    run = SimpleNamespace(diagnosis=found, provenance=SimpleNamespace(command=words))
    monkeypatch.setattr(SavedRuns, "diagnosis", lambda self, name: run)
    saved = SavedRuns(tmp_path)
    saved.replay("run")
    about = {"name": "run", "kind": "diagnosis", "description": "", "has_page": False, "recorded": True}
    without, beside = (str(run_list([SavedRun(**about, has_replay=there)])) for there in (False, True))
    assert "/runs/run/replay.html" not in without
    assert "Button" in without
    assert "/runs/run/replay.html" in beside
    assert (tmp_path / "run" / "replay.html").is_file()
