"""What recordings tell of an apparatus without any impact, and what the audit and the fits make of it."""

from dataclasses import replace

import pandas as pd
import pytest
import torch

from contactlearn import laws
from contactlearn.apparatus import Apparatus, Measured
from contactlearn.audit.apparatus_findings import apparatus_notes, scale_findings
from contactlearn.audit.corrections import correct
from contactlearn.audit.findings import audit
from contactlearn.audit.thresholds import AuditThresholds
from contactlearn.data import synthetic, tracks
from contactlearn.data.tracks_synthetic import MASS, SEMI_AXES, simulate, write_recordings
from contactlearn.data.tracks_synthetic.camera import Camera
from contactlearn.effects import find_effect
from contactlearn.identification.joint import identify_jointly
from contactlearn.model import ContactModel
from contactlearn.shapes import Disc, Ellipse
from contactlearn.tracks.gravity import find_gravity

PLAIN = Camera(frames=220)
ZERO = Measured(value=0.0, error=1e-3)
KNOWN = Apparatus(gravity=Measured(value=9.81, error=0.01), drag=ZERO, slope=ZERO, orientation=ZERO, delay=ZERO)


def found_in(folder, change=lambda table: table, drag=0.0, shape=None, **settings):
    """Impacts of recordings whose tables are changed."""
    write_recordings(simulate(8, PLAIN, drag=drag, seed=5)[0], folder)
    for file in folder.iterdir():
        change(pd.read_csv(file)).to_csv(file, index=False)
    shape = Ellipse(SEMI_AXES) if shape is None else shape
    return tracks.find_impacts(folder, mass=MASS, shape=shape, options=tracks.track_options(**settings))


def within(measured, truth, sigmas=4):
    return abs(measured.value - truth) < sigmas * measured.error


@pytest.mark.parametrize("drag", [0.0, 0.4])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_gravity_and_drag_are_measured_within_their_errors(drag, seed):
    found = find_gravity(simulate(12, PLAIN, drag=drag, seed=seed)[0])
    assert abs(found.drag - drag) < 4 * found.drag_error
    assert abs(found.size - 9.81) < 4 * found.error
    assert found.drag_error < 0.03


def test_drag_is_allowed_for_in_the_velocities(tmp_path):
    """Flights without the drag meet in other velocities."""
    free, ignored = (tmp_path / name for name in ("free", "ignored"))
    found = found_in(free, drag=0.5)
    other = found_in(ignored, drag=0.5)
    assert within(found.impacts.apparatus.drag, 0.5)
    stated = tracks.find_impacts(ignored, mass=MASS, shape=Ellipse(SEMI_AXES), options=tracks.track_options(drag=0.0))
    assert torch.equal(found.impacts.v_pre, other.impacts.v_pre)
    names = [name for name in found.impacts.trial if name in stated.impacts.trial]
    rows, there = ([one.impacts.trial.index(name) for name in names] for one in (found, stated))
    apart = (found.impacts.v_post[rows] - stated.impacts.v_post[there])[:, :2].abs()
    assert apart.median() > 5e-3
    assert stated.impacts.apparatus.drag == Measured(value=0.0, error=0.0)


def test_the_zero_of_theta_shows_in_the_heights_of_the_contacts(tmp_path):
    known = found_in(tmp_path, lambda table: table.assign(theta=table.theta + 0.03)).impacts.apparatus
    assert within(known.orientation, -0.03)
    assert known.orientation.error < 2e-3
    assert within(known.slope, 0.0)


def test_the_slope_of_the_floor_shows_in_them_too(tmp_path):
    """Gravity stays upright; the floor falls away by 1 %, and with it the contacts, by time and not by a turn."""
    known = found_in(tmp_path, lambda table: table.assign(y=table.y + 0.01 * table.x)).impacts.apparatus
    assert within(known.slope, 0.01)
    assert known.slope.error < 1e-3


def test_a_round_body_has_no_zero_of_theta(tmp_path):
    found = found_in(tmp_path, shape=Disc(0.03), angle="rad", sense="as_read")
    assert found.impacts.apparatus.orientation is None


def test_parameters_stay_within_what_is_known():
    """Drops under a tilted floor, with a floor that was found to be level, or tilted a little."""
    tilt = find_effect("surface_tilt")
    model = laws.find("wang_mason").at(0.12, 0.55)
    states = synthetic.load(size=120, seed=1)
    tilted = states.replace(v_post=ContactModel(model, effects={"t": tilt(phi=0.05)}).predict(states).v_post)

    def fitted(slope):
        known = None if slope is None else replace(KNOWN, slope=slope)
        fit = identify_jointly(model, {"t": tilt()}, tilted.replace(apparatus=known))
        return fit.values[2].item()

    assert fitted(None) == pytest.approx(0.05, abs=1e-3)
    assert fitted(Measured(value=0.0, error=0.001)) == pytest.approx(0.003)
    assert fitted(Measured(value=0.02, error=0.001)) == pytest.approx(0.023)
    assert fitted(Measured(value=0.048, error=0.002)) == pytest.approx(0.05, abs=1e-3)


def test_a_wrong_scale_is_a_mistake_and_the_rest_is_a_note():
    impacts = synthetic.load(size=40).replace(apparatus=KNOWN)
    limits = AuditThresholds()
    assert scale_findings(impacts, limits) == []
    assert [(finding.name, finding.mistake) for finding in audit(impacts)] == [
        ("consistent", False),
        ("apparatus", False),
    ]
    off = impacts.replace(apparatus=replace(KNOWN, gravity=Measured(value=9.6, error=0.01)))
    (finding,) = scale_findings(off, limits)
    assert finding.mistake
    assert "-2.1%" in finding.sentence
    assert finding.value("gravity") == 9.6
    unsure = impacts.replace(apparatus=replace(KNOWN, gravity=Measured(value=9.6, error=0.1)))
    assert scale_findings(unsure, limits) == []
    assert apparatus_notes(synthetic.load(size=40)) == []


def test_corrections_of_axes_forget_the_apparatus():
    impacts = synthetic.load(size=40).replace(apparatus=KNOWN)
    assert correct(impacts, ["drop_duplicates"]).apparatus == KNOWN
    assert correct(impacts.replace(suspect=True), ["mirrored_x"]).apparatus is None
    assert impacts[:10].apparatus == KNOWN
    assert impacts.fingerprint() != impacts.replace(apparatus=None).fingerprint()
