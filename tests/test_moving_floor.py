"""A floor or a racket that moves along its normal, and what looks like it."""

import pytest
import torch
from spatial import in_space

from contactlearn.data.audit.corrections import correct
from contactlearn.data.audit.findings import audit
from contactlearn.data.audit.moving_floor import moving_floor
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.shapes import Disc

RADIUS, EPS = 0.02, 0.7


def bounces(velocity=0.0, *, eps=lambda speed: EPS + 0 * speed, loss=0.0, scatter=0.02, size=200, seed=0):
    """Discs that meet a floor of some velocity at 0.3 to 5 m/s relative to it, and roll or slip a little."""
    generator = torch.Generator().manual_seed(seed)
    draw = lambda: torch.rand(size, dtype=torch.float64, generator=generator)  # noqa: E731
    speed, slip, omega = 0.3 + 4.7 * draw(), 2 * draw() - 1, 20 * draw() - 10
    noise = torch.randn(2, size, 3, dtype=torch.float64, generator=generator) * torch.tensor((2e-3, 2e-3, 0.05))
    ratio = eps(speed) + scatter * torch.randn(size, dtype=torch.float64, generator=generator)
    push = (1 + ratio) * speed - loss
    drag = -(slip.sign() * torch.minimum(0.1 * push, slip.abs() / 3))
    before = torch.stack((slip - RADIUS * omega, -speed, omega), -1)
    after = before + torch.stack((drag, push, 2 * drag / RADIUS), -1)
    moves = torch.tensor((0.0, velocity, 0.0))
    mass = torch.full((size,), 0.03, dtype=torch.float64)
    return Impacts(
        mass=mass,
        inertia=mass * RADIUS**2 / 2,
        r=torch.tensor((0.0, -RADIUS), dtype=torch.float64).expand(size, 2),
        q=torch.zeros(size, 3, dtype=torch.float64),
        v_pre=before + moves + noise[0],
        v_post=after + moves + noise[1],
        shape=Disc(RADIUS),
        validate=False,
    )


def found(impacts):
    return [finding for finding in audit(impacts) if finding.name == "moving_floor"]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("velocity", [0.2, 0.5])
def test_a_floor_that_rises_is_found_and_taken_off(velocity, seed):
    impacts = bounces(velocity, seed=seed)
    (finding,) = found(impacts)
    assert finding.correction == "moving_floor"
    floor = moving_floor(impacts)
    assert floor is not None
    assert floor.velocity.value == pytest.approx(velocity, abs=4 * floor.velocity.error)
    assert floor.velocity.error < 0.02
    assert floor.restitution == pytest.approx(EPS, abs=0.03)
    assert moving_floor(correct(impacts, ["moving_floor"])) is None


@pytest.mark.parametrize(
    "eps",
    [
        lambda speed: EPS + 0 * speed,
        lambda speed: EPS * speed**-0.25,
        lambda speed: 0.9 - 0.05 * speed,
        lambda speed: 1 - 0.3 * speed**0.2,
    ],
    ids=["constant", "plastic", "linear", "viscoelastic"],
)
@pytest.mark.parametrize("seed", range(3))
def test_a_restitution_that_depends_on_the_speed_is_no_moving_floor(eps, seed):
    assert not [finding for finding in found(bounces(eps=eps, seed=seed)) if finding.mistake]


def test_what_adhesion_explains_as_well_is_noted():
    (finding,) = found(bounces(loss=0.2))
    assert (finding.mistake, finding.correction) == (False, None)
    assert finding.value("velocity") < -0.05


@pytest.mark.parametrize("velocity", [0.2, 0.5])
def test_a_floor_that_rises_under_bodies_in_space(velocity):
    """The planar bounces as spatial ones: z is up."""
    spatial = in_space(bounces(velocity))
    (finding,) = found(spatial)
    assert finding.correction == "moving_floor"
    assert finding.value("velocity") == pytest.approx(velocity, abs=4 * finding.value("error"))
    level = correct(spatial, ["moving_floor"])
    assert moving_floor(level) is None
    torch.testing.assert_close(level.v_pre - spatial.v_pre, level.v_post - spatial.v_post)
    assert not found(in_space(bounces(0.0)))


def test_the_error_that_the_floor_gives_the_restitution():
    impacts = bounces(0.3)
    floor = moving_floor(impacts)
    assert floor is not None
    (finding,) = found(impacts)
    assert finding.value("restitution_error") == pytest.approx(floor.restitution_error)
    before, after = impacts.v_pre[:, 1], impacts.v_post[:, 1]

    def restitution(velocity):
        return ((after - velocity) / (velocity - before)).median().item()

    change = restitution(floor.velocity.value) - restitution(floor.velocity.value + floor.velocity.error)
    assert floor.restitution_error == pytest.approx(change, rel=0.05)
