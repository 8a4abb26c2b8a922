"""Friction of slides: bodies that slide to rest with a known μ in the plane and in space, and those that do not."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from contactlearn.data.recordings.slides import find_slides, friction_of
from contactlearn.data.recordings.track import Track
from contactlearn.mechanics.rigid_body import GRAVITY

MU, NOISE, STEP, HEIGHT = 0.2, 1e-4, 1 / 240, 0.05  # –, m, s, m


def slid(seed, *, d, speed=0.6, drag=0.0, spin=0.0):
    """A track of a body that falls for a tenth of a second, slides and lies still for as long."""
    rng, decay = np.random.default_rng(seed), max(drag, 1e-9)
    slides = np.log1p(decay * speed / (MU * GRAVITY)) / decay  # s until v = (v₀ + μ g/c) e^(−c t) − μ g/c is 0
    time = np.arange(0, 0.1 + slides + 0.1, STEP)
    t = np.clip(time - 0.1, 0, slides)
    way = (speed + MU * GRAVITY / decay) * -np.expm1(-decay * t) / decay - MU * GRAVITY / decay * t
    height, turned = HEIGHT + GRAVITY / 2 * np.clip(0.1 - time, 0, None) ** 2, spin * t
    if d == 2:
        pose = np.stack((way, height, turned), 1)
    else:
        along = rng.normal(size=2)
        horizontal = way[:, None] * along / np.linalg.norm(along)
        turn = Rotation.from_rotvec(turned[:, None] * np.array((0.0, 1.0, 0.0))).as_quat(scalar_first=True)
        pose = np.concatenate((horizontal, height[:, None], turn), 1)
    pose[:, :d] += NOISE * rng.standard_normal((len(time), d))
    return Track(name=str(seed), time=time, pose=pose)


def slides_of(count=20, **settings):
    d = settings["d"]
    sigma = np.array([NOISE] * d + [2e-3] * (2 * d - 3))
    tracks = [slid(seed, **settings) for seed in range(count)]
    return [one for track in tracks for one in find_slides(track, [(0.0, track.time[-1])], sigma)]


@pytest.mark.parametrize("drag", [0.0, 0.7], ids=["no drag", "drag"])
@pytest.mark.parametrize("d", [2, 3], ids=["plane", "space"])
def test_friction_is_found_within_its_error(d, drag):
    slides = slides_of(d=d, drag=drag)
    found = friction_of(slides, GRAVITY, drag)
    assert len(slides) > 15
    assert abs(found.value - MU) < 4 * found.error
    assert found.error < 0.01 * MU


def test_drag_that_is_left_out_passes_for_friction():
    found = friction_of(slides_of(d=2, drag=0.7), GRAVITY, 0.0)
    assert found.value - MU > 4 * found.error


@pytest.mark.parametrize("d", [2, 3], ids=["plane", "space"])
@pytest.mark.parametrize("settings", [{"spin": 12.0}, {"speed": 0.02}], ids=["rolls", "too slow"])
def test_what_does_not_slide_is_left_out(d, settings):
    assert not slides_of(d=d, **settings)


def test_too_few_slides_show_nothing():
    assert friction_of(slides_of(7, d=2), GRAVITY, 0.0) is None
