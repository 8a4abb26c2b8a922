"""Replays: the law that made recordings follows them, another one does not; the command and its page."""

import json

import pytest
import torch
from browser import chromium, nothing_sticks_out
from commands import run
from test_report_page import draw_everything, opened, silent, until

from contactlearn import ContactModel, laws
from contactlearn.core.errors import DataError
from contactlearn.data import tracks
from contactlearn.inference.evaluation.replay import ReplayErrors, replays
from contactlearn.mechanics.shapes import Ellipse
from contactlearn.models import checkpoint
from contactlearn.simulation.camera import Camera
from contactlearn.simulation.recordings import MASS, SEMI_AXES, simulate, write_recordings

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


def test_errors_are_distances_over_the_width_and_angles(shown):
    one = shown[0]
    apart = one.predicted["sticky"][5] - one.recorded[5]
    assert one.errors("sticky")[5, 0] == pytest.approx(apart[:2].norm().item() / (2 * SEMI_AXES[0]))
    whole_turn = one.recorded + torch.tensor([0.0, 0.0, 2 * torch.pi], dtype=torch.float64)
    moved = type(one)(**{**vars(one), "predicted": {"true": whole_turn}})
    assert moved.errors("true").max() < 1e-9


def test_corrections_of_impacts_are_those_of_recorded_poses(found, shown):
    mirrored = replays(MODELS, found, ["mirrored_x"])
    assert torch.allclose(mirrored[0].recorded[:, 0], -shown[0].recorded[:, 0])


def test_recordings_of_the_fit_are_left_out(found):
    names = [contact.recording for contact in found.survey.contacts]
    assert names[0] not in {one.recording for one in replays(MODELS, found, without={names[0]})}
    with pytest.raises(DataError, match="no recording is left"):
        replays(MODELS, found, without=set(names))


def test_the_command_and_its_page(folder, tmp_path):
    for name, model in MODELS.items():
        checkpoint.save(model, tmp_path / "run" / f"{name}.pt", provenance={})
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
        assert silent(page)
        assert nothing_sticks_out(page)
