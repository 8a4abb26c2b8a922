"""What recordings tell of an apparatus without any impact, and what the audit and the fits make of it."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import torch
from pairings import paired
from refusals import refused

from contactlearn import laws
from contactlearn.cli.commands.fitting import fit_with_effects
from contactlearn.core.events import ignore
from contactlearn.data import table, tracks
from contactlearn.data.audit.corrections import correct
from contactlearn.data.audit.findings import audit
from contactlearn.data.audit.thresholds import AuditThresholds
from contactlearn.data.audit.trials import rig_notes, scale_findings
from contactlearn.data.recordings.conventions import find_flight_model, find_frame, find_gravity
from contactlearn.data.recordings.floor import find_floor
from contactlearn.effects import find_effect
from contactlearn.inference.identification import joint
from contactlearn.inference.identification.joint import FitOptions, named_parameters
from contactlearn.inference.identification.shared import Box
from contactlearn.mechanics.apparatus import Apparatus, Estimate
from contactlearn.mechanics.shapes import Disc, Ellipse, contact_point
from contactlearn.models.contact_model import ContactModel
from contactlearn.report.text.sentences import phrase
from contactlearn.simulation import synthetic
from contactlearn.simulation.camera import Camera
from contactlearn.simulation.recordings import MASS, SEMI_AXES, simulate, write_recordings

PLAIN = Camera(frames=220)
ZERO = Estimate(value=0.0, error=1e-3)
KNOWN = Apparatus(gravity=Estimate(value=9.81, error=0.01), drag=ZERO, slope=ZERO, orientation=ZERO, delay=ZERO)


def found_in(folder, change=lambda table: table, drag=0.0, shape=None, **settings):
    """Impacts of recordings whose tables are changed."""
    write_recordings(simulate(8, PLAIN, drag=drag, seed=5)[0], folder)
    for file in folder.iterdir():
        change(pd.read_csv(file)).to_csv(file, index=False)
    shape = Ellipse(SEMI_AXES) if shape is None else shape
    return tracks.find_impacts(folder, mass=MASS, shape=shape, options=tracks.track_options(**settings))


def within(measured, truth, sigmas=4):
    return abs(measured.value - truth) < sigmas * measured.error


@pytest.mark.parametrize(("drag", "seed"), paired([0.0, 0.4], [1, 2, 3]))
def test_gravity_and_drag_are_measured_within_their_errors(drag, seed):
    found = find_gravity(simulate(12, PLAIN, drag=drag, seed=seed)[0])
    gravity, measured = found.measured
    assert within(measured, drag)
    assert within(gravity, 9.81)
    assert measured.error < 0.03
    assert found.drag == (measured.value if drag else 0.0)


def test_gravity_is_measured_where_frames_are_lost():
    """Of 14 frames a window the last 4, after which nothing tells its velocity, are lost."""
    recordings = simulate(12, replace(PLAIN, rate=240.0), seed=1)[0]
    for one in recordings:
        one.position[20::40] = one.position[21::40] = one.position[22::40] = one.position[23::40] = np.nan
    gravity, drag = find_gravity(recordings).measured
    assert within(gravity, 9.81)
    assert within(drag, 0.0)


def test_drag_is_allowed_for_in_the_velocities(tmp_path):
    """Flights without the drag meet in the same velocities, by their own accelerations, with larger errors."""
    found = found_in(tmp_path, drag=0.5)
    assert within(found.impacts.apparatus.drag, 0.5)
    stated = tracks.find_impacts(tmp_path, mass=MASS, shape=Ellipse(SEMI_AXES), options=tracks.track_options(drag=0.0))
    names = [name for name in found.impacts.trial if name in stated.impacts.trial]
    rows, there = ([one.impacts.trial.index(name) for name in names] for one in (found, stated))
    apart = (found.impacts.v_post[rows] - stated.impacts.v_post[there])[:, :2].abs()
    assert apart.median() < 2e-3  # 5e-3 without own accelerations
    larger = (stated.impacts.v_post_cov[there] / found.impacts.v_post_cov[rows]).diagonal(dim1=1, dim2=2)
    assert (larger[:, :2].median(0).values > 1.2).all()
    assert stated.impacts.apparatus.drag == Estimate(value=0.0, error=0.0)


def test_recordings_tell_zero_and_slope_by_the_heights_of_the_contacts(tmp_path):
    known = found_in(tmp_path, lambda table: table.assign(theta=table.theta + 0.03)).impacts.apparatus
    assert within(known.orientation, -0.03)
    assert known.orientation.error < 2e-3
    assert within(known.slope, 0.0)
    found = found_in(tmp_path, shape=Disc(0.03), angle="rad", sense="as_read")
    assert found.impacts.apparatus.orientation is None


def test_the_slope_of_the_floor_shows_in_them_too(tmp_path):
    """Gravity stays upright; the floor falls away by 1 %, and with it the contacts, by time and not by a turn."""
    known = found_in(tmp_path, lambda table: table.assign(y=table.y + 0.01 * table.x)).impacts.apparatus
    assert within(known.slope, 0.01)
    assert known.slope.error < 1e-3


@pytest.mark.parametrize(
    ("slope", "zero", "offset"),
    [(0.0, 0.0, 0.0), (0.02, 0.1, 0.0), (0.0, 0.0, 1e-3), (0.0, 0.1, 1e-3)],
    ids=["level", "tilted and turned", "tracked elsewhere", "turned and tracked elsewhere"],
)
def test_slope_and_zero_are_found_within_their_errors(slope, zero, offset):
    """Contacts of an ellipse on a floor, with noise; the tracked point may be off its centre, along its longer axis.

    One in 370 is beyond 3σ.
    """
    shape, rng, scores, lean = Ellipse(SEMI_AXES), np.random.default_rng(0), [], math.atan(slope)
    turn = np.array(((math.cos(lean), -math.sin(lean)), (math.sin(lean), math.cos(lean))))
    for _ in range(80):
        theta, x = rng.uniform(-math.pi, math.pi, 40), rng.uniform(-0.3, 0.3, 40)
        r = contact_point(shape, torch.from_numpy(theta + zero - lean)).numpy() @ turn.T
        y = slope * (x + r[:, 0]) - r[:, 1] + 5e-5 * rng.standard_normal(40)
        along = theta + zero - lean
        poses = np.stack((x + offset * np.cos(along), y + offset * np.sin(along), theta), 1)
        floor = find_floor(
            [SimpleNamespace(pose=pose, v_pre=rng.normal(-2, 0.5, 3), v_post=np.ones(3)) for pose in poses], shape
        )
        pairs = ((floor.slope, lean), (floor.orientation, zero), (floor.outline["middle_a"], -offset))
        scores.append([(one.value - truth) / one.error for one, truth in pairs])
    assert (np.std(scores, axis=0) < 1.3).all()
    assert (np.abs(scores) > 3).sum() <= 6


def test_gravity_is_found_where_noise_hides_it_in_short_windows():
    """Of 0.8 mm at 120 frames a second."""
    recordings = simulate(12, replace(PLAIN, frames=110, rate=120.0, noise=8e-4), seed=1)[0]
    gravity, _ = find_gravity(recordings).measured
    assert within(gravity, 9.81)
    assert gravity.error < 0.2


def test_flights_that_are_too_few_tell_no_drag():
    found = find_gravity(simulate(1, replace(PLAIN, frames=60), seed=2)[0])
    assert (found.drag, found.measured[1].error) == (0.0, math.inf)
    assert abs(found.size - 9.81) < 4 * found.error
    recordings = simulate(6, PLAIN, drag=0.5, seed=2)[0]
    found = find_gravity(recordings, drag=0.5)
    assert found.drag == 0.5
    assert abs(found.size - 9.81) < 4 * found.error


def test_gravity_is_fitted_with_the_drag_that_is_used():
    """Beside a free drag gravity is less certain; where no drag is seen there is none beside it."""
    recordings = simulate(6, PLAIN, seed=2)[0]
    unseen, stated = find_gravity(recordings), find_gravity(recordings, drag=0.0)
    assert unseen.drag == 0.0
    np.testing.assert_array_equal(unseen.vector, stated.vector)
    assert unseen.error == stated.error
    other = find_gravity(recordings, drag=0.5)
    assert abs(other.size - stated.size) > 4 * stated.error
    # Its error is one of all velocities alike: 0.5 mrad off are 0.5 mm/s after 0.1 s.
    assert find_gravity(recordings).vector[0] != 0
    model, lean = flight_model(recordings), 0.01
    assert model.gravity == (0, pytest.approx(-find_gravity(recordings).size))
    rolled = [replace(one, position=one.position @ ((1, lean), (-lean, 1))) for one in recordings]
    assert flight_model(rolled).gravity[0] == pytest.approx(9.81 * lean, rel=0.2)


def flight_model(recordings):
    gravity = find_gravity(recordings)
    return find_flight_model(recordings, find_frame(recordings, gravity), gravity)


def test_gravity_of_a_poor_tracker_is_not_chosen_by_its_size():
    """If only windows with a large acceleration were taken it would come out at 10.8 m/s²."""
    camera = replace(PLAIN, noise=4.5e-4)
    found = find_gravity(simulate(6, camera, seed=2)[0])
    assert abs(found.size - 9.81) < 3 * found.error < 0.3


def test_few_contacts_tell_neither_slope_nor_zero(tmp_path):
    write_recordings(simulate(2, PLAIN, seed=5)[0], tmp_path)
    settings = tracks.track_options(angle="rad", sense="as_read")
    known = tracks.find_impacts(tmp_path, mass=MASS, shape=Ellipse(SEMI_AXES), options=settings).impacts.apparatus
    assert (known.slope, known.orientation) == (None, None)


def test_a_range_holds_the_vanishing_value_and_no_more_than_the_declared_one():
    impacts = synthetic.load(size=40)

    def bounds(**changes):
        effects = {name: find_effect(name)() for name in ("surface_tilt", "gravity_impulse")}
        known = impacts.replace(apparatus=replace(KNOWN, **changes))
        return {p.name: (p.low, p.high) for p in named_parameters(effects, Box(), known)}

    assert bounds(slope=Estimate(value=0.02, error=0.001))["surface_tilt.phi"] == (0.0, pytest.approx(0.023))
    assert bounds(slope=Estimate(value=-0.02, error=0.001))["surface_tilt.phi"] == (pytest.approx(-0.023), 0.0)
    assert bounds(slope=Estimate(value=0.1, error=0.5))["surface_tilt.phi"] == (-0.2, 0.2)
    assert bounds(delay=Estimate(value=0.0, error=1e-3))["gravity_impulse.dt"] == (0.0, pytest.approx(3e-3))
    rounded = replace(KNOWN, corner=Estimate(value=0.0, error=1e-4, applied=4e-3))  # by a little too much, perhaps
    (rho,) = named_parameters({"c": find_effect("corner_radius")()}, Box(), impacts.replace(apparatus=rounded))[2:]
    assert (rho.low, rho.high) == (pytest.approx(-3e-4), pytest.approx(3e-4))
    wide = replace(KNOWN, slope=Estimate(value=0.0, error=1.0))
    impacts = synthetic.load(size=60).replace(apparatus=wide)
    (phi,) = named_parameters({"t": TILT()}, Box(), impacts)[2:]
    assert (phi.prior_from_flight, phi.low, phi.high) == (None, -0.2, 0.2)


def test_parameters_stay_within_what_is_known():
    """Drops under a tilted floor, with a floor that was found to be level, or tilted a little."""
    tilt = find_effect("surface_tilt")
    model = laws.find("wang_mason").at(0.12, 0.55)
    states = synthetic.load(size=120, seed=1)
    tilted = states.replace(v_post=ContactModel(model, effects={"t": tilt(phi=0.05)}).predict(states).v_post)

    def fitted(slope):
        known = None if slope is None else replace(KNOWN, slope=slope)
        fit = joint.fit(tilted.replace(apparatus=known), model, {"t": tilt()})
        return fit.values[2].item()

    assert fitted(None) == pytest.approx(0.05, abs=1e-3)
    assert fitted(Estimate(value=0.0, error=0.001)) == pytest.approx(0.003)
    assert fitted(Estimate(value=0.02, error=0.001)) == pytest.approx(0.023)
    assert fitted(Estimate(value=0.048, error=0.002)) == pytest.approx(0.05, abs=1e-3)


TILT = find_effect("surface_tilt")


@pytest.mark.parametrize(("planted", "noise", "slope", "message"), [
    (0.0, 5.0, (0.002, 0.001),
        "free flight determines t.phi more precisely than the impacts: φ = 0.0020 ± 0.0010 rad from free flight"),
    (0.05, 0.0, (0.002, 0.001),
        "imply more t.phi than free flight allows: φ = 0.0020 ± 0.0010 rad from free flight, 0.05"),
    (0.05, 0.01, (-0.002, 0.001), "the fit stops at the limit, 0.001;"),
    (0.0, 0.0, (0.02, 0.002), "imply less t.phi than free flight shows: φ = 0.0200 ± 0.0020 rad from free flight"),
    (0.05, 0.0, (0.048, 0.002), "impacts and free flight agree on t.phi"),
], ids=["better", "more", "other way", "less", "agree"])  # fmt: skip
def test_a_fit_compares_free_flight_with_the_impacts(planted, noise, slope, message):
    model = laws.find("wang_mason").at(0.12, 0.55)
    states = synthetic.load(size=120, seed=1)
    v_post = ContactModel(model, effects={"t": TILT(phi=planted)}).predict(states).v_post
    scatter = noise * torch.randn(v_post.shape, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    flight = Estimate(value=slope[0], error=slope[1])
    impacts = states.replace(v_post=v_post + scatter, apparatus=replace(KNOWN, slope=flight))
    (_, fit) = fit_with_effects(model, {"t": TILT()}, impacts, torch.arange(120), FitOptions(starts=2), ignore).values()
    (known,) = fit.known_parameters()
    assert message in phrase("known_parameter", known)
    assert known.flight == flight
    assert not {"t.phi"} & {*fit.undetermined(), *fit.at_bounds()}


def test_a_wrong_scale_is_a_mistake_and_the_rest_is_a_note():
    impacts = synthetic.load(size=40).replace(apparatus=KNOWN)
    limits = AuditThresholds()
    assert scale_findings(impacts, limits) == []
    assert [(finding.name, finding.mistake) for finding in audit(impacts)] == [
        ("consistent", False),
        ("rig", False),
    ]
    off = impacts.replace(apparatus=replace(KNOWN, gravity=Estimate(value=9.6, error=0.01)))
    (finding,) = scale_findings(off, limits)
    assert finding.mistake
    assert "too small by 2.1%" in finding.sentence
    assert finding.value("gravity") == 9.6
    unsure = impacts.replace(apparatus=replace(KNOWN, gravity=Estimate(value=9.6, error=0.1)))
    assert scale_findings(unsure, limits) == []
    assert rig_notes(synthetic.load(size=40)) == []
    assert impacts[:10].apparatus == KNOWN
    assert impacts.fingerprint() != impacts.replace(apparatus=None).fingerprint()


LEANING = replace(KNOWN, slope=Estimate(value=0.02, error=0.002), orientation=Estimate(value=-0.05, error=0.003))


@pytest.mark.parametrize(("names", "slope", "orientation", "gravity"), [
    (["drop_duplicates"], 0.02, -0.05, 9.81),
    (["swapped_pre_post"], 0.02, -0.05, 9.81),
    (["mirrored_omega"], 0.02, -0.05, 9.81),
    (["mirrored_x"], -0.02, -0.09, 9.81),
    (["mirrored_y"], -0.02, None, 9.81),
    (["mirrored_theta"], 0.02, 0.09, 9.81),
    (["mirrored_x", "mirrored_theta"], -0.02, 0.05, 9.81),
    (["swapped_axes"], None, None, 9.81),
    (["degrees"], 0.02, None, 9.81),
    (["millimetres"], 0.02, None, 9.81e-3),
    (["millimetres_velocity", "grams"], 0.02, -0.05, 9.81),
], ids=str)  # fmt: skip
def test_corrections_transform_or_drop_apparatus_estimates(names, slope, orientation, gravity):
    impacts = synthetic.load(size=40).replace(apparatus=LEANING, validate=False)
    known = correct(impacts, names).apparatus
    for one, value, error in ((known.slope, slope, 0.002), (known.orientation, orientation, 0.003)):
        assert (one is None) == (value is None)
        if one is not None:
            assert one.value == pytest.approx(value)
            assert error <= one.error < 3 * error
    assert known.gravity.value == pytest.approx(gravity)
    assert known.gravity.error / known.gravity.value == pytest.approx(0.01 / 9.81)
    assert (known.drag, known.delay) == (LEANING.drag, LEANING.delay)


@pytest.mark.parametrize(("name", "mirror"), [("mirrored_x", "x"), ("mirrored_theta", "theta")])
def test_corrected_estimates_equal_estimates_from_corrected_contacts(name, mirror):
    """Slope and zero of θ of contacts as read and of contacts with the correction made, for an ellipse."""
    shape, rng = Ellipse(SEMI_AXES), np.random.default_rng(1)
    theta, x = rng.uniform(-math.pi, math.pi, 60), rng.uniform(-0.3, 0.3, 60)
    r = contact_point(shape, torch.from_numpy(theta + 0.05)).numpy()
    y = 0.02 * (x + r[:, 0]) - r[:, 1] + 2e-5 * rng.standard_normal(60)
    read, corrected = (
        find_floor(
            [SimpleNamespace(pose=pose, v_pre=-np.ones(3), v_post=np.ones(3)) for pose in np.stack(columns, 1)], shape
        )
        for columns in ((x, y, theta), (-x if mirror == "x" else x, y, -theta if mirror == "theta" else theta))
    )
    known = replace(KNOWN, slope=read.slope, orientation=read.orientation)
    impacts = synthetic.load(size=40).replace(apparatus=known, validate=False)
    for field in ("slope", "orientation"):
        expected, seen = getattr(correct(impacts, [name]).apparatus, field), getattr(corrected, field)
        assert abs(expected.value) > 5 * expected.error
        assert abs(expected.value - seen.value) < 4 * max(expected.error, seen.error)


SOME = replace(LEANING, drag=None, orientation=None)
MADE = replace(KNOWN, slope=KNOWN.slope.made())


CARRIED = {"no": None, "all": KNOWN, "some": SOME, "made": MADE}


@pytest.mark.parametrize(("known", "suffix"), paired(CARRIED, [".csv", ".parquet"]))
def test_tables_carry_apparatus_estimates(tmp_path, suffix, known):
    impacts = synthetic.load(size=7).replace(apparatus=known)
    again = table.load(table.save(impacts, tmp_path / f"drops{suffix}"))
    assert again.apparatus == known
    assert again.fingerprint() == impacts.fingerprint()


@pytest.mark.parametrize(("change", "fragments"), [
    (lambda t: t.drop(columns="apparatus_slope_error"), ["come both or none; missing: apparatus_slope_error"]),
    (lambda t: t.filter(regex="^(?!apparatus_(gravity|delay))"), ["all four", "apparatus_gravity, "]),
    (lambda t: t.assign(apparatus_delay_error=-1.0), ["apparatus_delay_error", "at least 0"]),
    (lambda t: t.assign(apparatus_corner_applied=1e-3), ["come all three or none; missing: apparatus_corner"]),
    (lambda t: t.assign(apparatus_slope=range(7)), ["row 2, column apparatus_slope", "same in every row"]),
    (lambda t: t.assign(apparatus_slope=["steep"] * 7), ["apparatus_slope", "number in rad", "'steep'"]),
], ids=["half", "no gravity", "negative", "applied alone", "differs", "no number"])  # fmt: skip
def test_a_table_that_contradicts_itself_is_refused(tmp_path, change, fragments):
    path = table.save(synthetic.load(size=7).replace(apparatus=KNOWN), tmp_path / "drops.csv")
    change(pd.read_csv(path)).to_csv(path, index=False)
    with refused(fragments):
        table.load(path)
