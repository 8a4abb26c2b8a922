"""Feature spaces by their physics and units, and standardisation by its two promises: no leak, no division by 0."""

import math

import numpy as np
import pytest
import torch
from contacts import random_bodies
from hypothesis import given, settings, strategies as st
from torch import Tensor

from contactlearn.core.errors import UnknownNameError
from contactlearn.mechanics import rigid_body
from contactlearn.mechanics.features import SPACES, Features
from contactlearn.mechanics.impacts import Impacts
from contactlearn.models.regressor import Regressor
from contactlearn.models.standardisation import Standardisation
from contactlearn.simulation import synthetic

ROUNDING = 1e-9
"""Relative: a few roundings, times the condition number of W, which is up to a thousand for the random bodies."""

CLOSE = {"rtol": ROUNDING, "atol": ROUNDING}
close = torch.testing.assert_close
PROFILE = settings(derandomize=True, deadline=None, database=None, max_examples=100)
SPACE = pytest.mark.parametrize("space", SPACES)


@pytest.fixture(scope="module")
def impacts() -> Impacts:
    """Random bodies of all sizes, anywhere and at any angle."""
    bodies = random_bodies(500, seed=0)
    draw = torch.randn((2, 500, 3), generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    return Impacts(bodies.mass, bodies.inertia, bodies.r, 3 * draw[0], bodies.v, draw[1])


def column(space: str, name: str, impacts: Impacts) -> Tensor:
    return Features.of(impacts, space).values[:, list(SPACES[space].columns).index(name)]


@SPACE
def test_a_row_a_trial_and_a_column_a_symbol(space, impacts):
    x = Features.of(impacts, space).values
    assert x.shape == (len(impacts), len(SPACES[space].columns))
    assert x.dtype == torch.float64
    assert x.isfinite().all()
    assert x.std(0).min() > 0
    rows = torch.tensor([7, 499, 0, 7])
    picked = impacts[rows[:3]]
    assert torch.equal(Features.of(picked, space).values, Features.of(impacts, space).values[rows[:3]])
    later = impacts.replace(v_post=impacts.v_post + 1, q_post=impacts.q + 1, time=torch.arange(500.0))
    assert torch.equal(Features.of(later, space).values, Features.of(impacts, space).values)


POWERS = {  # of kg, m and s
    "–": (0, 0, 0),
    "rad": (0, 0, 0),
    "kg": (1, 0, 0),
    "kg m²": (1, 2, 0),
    "m": (0, 1, 0),
    "m/s": (0, 1, -1),
    "rad/s": (0, 0, -1),
    "N s": (1, 1, -1),
}


@SPACE
@pytest.mark.parametrize("units", [(1000.0, 1.0, 1.0), (1.0, 1000.0, 1.0), (1.0, 1.0, 1000.0)], ids=["g", "mm", "ms"])
def test_units_are_those_that_the_numbers_scale_with(space, units, impacts):
    """In grams, millimetres or milliseconds each column is as many times larger as its unit says."""
    kg, m, s = units
    v, q = torch.tensor([[m / s, m / s, 1 / s], [m, m, 1]], dtype=torch.float64)
    other = Impacts(
        kg * impacts.mass, kg * m**2 * impacts.inertia, m * impacts.r, q * impacts.q, v * impacts.v_pre, impacts.v_post
    )
    powers = torch.tensor([POWERS[unit] for unit in SPACES[space].columns.values()], dtype=torch.float64)
    factor = (torch.tensor(units, dtype=torch.float64) ** powers).prod(-1)
    close(Features.of(other, space).values / factor, Features.of(impacts, space).values, **CLOSE)


ODD = {"r_x", "x", "sin θ", "v_x", "ω", "M_c,tn", "v_t", "p_t", "angle"}


@SPACE
def test_mirror(space, impacts):
    """Left for right turns the sign of what points or turns to one side."""
    flip = torch.tensor([-1.0, 1.0, -1.0])
    mirrored = impacts.replace(r=impacts.r * flip[:2], q=impacts.q * flip, v_pre=impacts.v_pre * flip)
    sign = torch.tensor([-1.0 if name in ODD else 1.0 for name in SPACES[space].columns])
    close(Features.of(mirrored, space).values, sign * Features.of(impacts, space).values, rtol=1e-14, atol=1e-14)


def test_state_is_the_measured_state(impacts):
    x, y, theta = impacts.q.numpy().T
    wanted = {
        "m": impacts.mass,
        "I": impacts.inertia,
        "r_x": impacts.r[:, 0],
        "r_y": impacts.r[:, 1],
        "x": x,
        "y": y,
        "cos θ": np.cos(theta),
        "sin θ": np.sin(theta),
        **dict(zip(("v_x", "v_y", "ω"), impacts.v_pre.T, strict=True)),
    }
    assert list(wanted) == list(SPACES["state"].columns)
    np.testing.assert_allclose(Features.of(impacts, "state").values, np.stack(list(wanted.values()), -1), rtol=1e-14)
    with pytest.raises(UnknownNameError, match="unknown feature space 'x2_pola', did you mean 'x2_polar'"):
        Features.of(impacts, "x2_pola")


@pytest.mark.parametrize("turns", [1, -1, 5])
def test_a_full_turn_is_no_turn(turns, impacts):
    turned = impacts.replace(q=impacts.q + torch.tensor([0, 0, 2 * math.pi * turns], dtype=torch.float64))
    for space in SPACES:
        close(Features.of(turned, space).values, Features.of(impacts, space).values, **CLOSE)
    half = impacts.replace(q=impacts.q + torch.tensor([0, 0, math.pi], dtype=torch.float64))
    assert (Features.of(half, "state").values - Features.of(impacts, "state").values).norm(dim=-1).min() > 1.9


@pytest.mark.parametrize("space", ["x1", "x2", "x2_polar"])
def test_contact_spaces_do_not_know_the_place(space, impacts):
    assert torch.equal(Features.of(impacts.replace(q=impacts.q + 1), space).values, Features.of(impacts, space).values)


def test_x1_is_the_inverse_of_w_and_the_contact_points_velocity(impacts):
    """From J and M as matrices, inverted by LAPACK."""
    wanted = []
    for mass, inertia, (r_x, r_y), v in zip(
        *(part.numpy() for part in (impacts.mass, impacts.inertia, impacts.r, impacts.v_pre)), strict=True
    ):
        J = np.array([[1, 0, -r_y], [0, 1, r_x]])
        M_c = np.linalg.inv(J @ np.diag([1 / mass, 1 / mass, 1 / inertia]) @ J.T)
        wanted.append([M_c[0, 0], M_c[0, 1], M_c[1, 1], *(J @ v)])
    np.testing.assert_allclose(Features.of(impacts, "x1").values, wanted, rtol=ROUNDING, atol=ROUNDING)
    stop = torch.nn.functional.pad(-Features.of(impacts, "x2").values, (0, 1))
    v = rigid_body.apply_wrench(impacts.mass, impacts.inertia, impacts.r, impacts.v_pre, stop)
    # What is left, by the sizes of what was added up.
    size = impacts.v_pre.norm(dim=-1) + impacts.r.norm(dim=-1) * (v - impacts.v_pre).norm(dim=-1) + v.norm(dim=-1)
    left = rigid_body.contact_velocity(impacts.r, v).norm(dim=-1) / size
    assert left.max() < ROUNDING
    tt, tn, nn, v_t, v_n = Features.of(impacts, "x1").values.T
    close(Features.of(impacts, "x2").values, torch.stack((tt * v_t + tn * v_n, tn * v_t + nn * v_n), -1), **CLOSE)
    angle, norm = Features.of(impacts, "x2_polar").values.T
    close(Features.of(impacts, "x2").values, torch.stack((norm * angle.sin(), -norm * angle.cos()), -1), **CLOSE)
    assert (norm > 0).all()
    assert (angle.abs() <= math.pi).all()
    # Straight down is the angle 0, and it grows towards +t.
    assert (column("x2_polar", "angle", impacts) * column("x2", "p_t", impacts) >= 0).all()


def test_x1_is_a_point_mass_where_nothing_turns():
    """With a very large inertia the contact point weighs what the body weighs."""
    impacts = synthetic.load(20)
    impacts = impacts.replace(inertia=1e12 * torch.ones(20), v_pre=impacts.v_pre * torch.tensor([1.0, 1.0, 0.0]))
    wanted = torch.stack((impacts.mass, 0 * impacts.mass, impacts.mass, *impacts.v_pre[:, :2].T), -1)
    close(Features.of(impacts, "x1").values, wanted, **CLOSE)


@SPACE
def test_a_table_has_units_in_its_header(space, impacts):
    found = Features.of(impacts, space)
    frame = found.table()
    assert tuple(frame.trial) == impacts.trial
    assert np.array_equal(frame.to_numpy()[:, 1:].astype(float), found.values)
    assert [name.partition(" (")[0] for name in frame.columns[1:]] == list(SPACES[space].columns)
    assert {"x1": "v_t (m/s)", "state": "cos θ"}.get(space, "trial") in frame


def sample(*shape: int, seed: int = 0) -> Tensor:
    """Columns of very different means and scales."""
    generator = torch.Generator().manual_seed(seed)
    scale, mean = 10 ** torch.linspace(-3, 3, shape[-1], dtype=torch.float64), torch.linspace(-5, 5, shape[-1])
    return scale * (mean + torch.randn(shape, generator=generator, dtype=torch.float64))


def test_standard_values_have_mean_0_and_scale_1():
    x = sample(3, 40, 5)
    z, x = Standardisation.of(x).apply(x).numpy(), x.numpy()
    np.testing.assert_allclose(z, (x - x.mean(1, keepdims=True)) / x.std(1, keepdims=True), rtol=ROUNDING)
    np.testing.assert_allclose(z.mean(1), 0, atol=1e-12)
    np.testing.assert_allclose((z**2).mean(1), 1, rtol=1e-12)


@pytest.mark.parametrize("batch", [(), (4,), (2, 3)], ids=str)
def test_leading_axes_are_a_loop(batch):
    x, new = sample(*batch, 12, 3), sample(*batch, 5, 3, seed=1)
    every = Standardisation.of(x)
    assert every.mean.shape == every.scale.shape == (*batch, 1, 3)
    for index in np.ndindex(batch):
        one = Standardisation.of(x[index])
        close(one.apply(new[index]), every.apply(new)[index], rtol=1e-14, atol=1e-14)
        close(one.undo(new[index]), every.undo(new)[index], rtol=1e-14, atol=1e-14)


def numbers(largest: float) -> st.SearchStrategy[float]:
    """Floats whose squares are none or normal numbers."""
    return st.floats(-largest, largest).map(lambda value: value if abs(value) > 1e-150 else 0.0)


@PROFILE
@given(
    x=st.lists(st.tuples(numbers(1e6), numbers(1e-6)), min_size=2, max_size=8),
    new=st.tuples(numbers(1e6), numbers(1e6)),
)
def test_any_numbers_come_back_or_are_constant(x, new):
    x, new = torch.tensor(x, dtype=torch.float64), torch.tensor([new], dtype=torch.float64)
    standard = Standardisation.of(x)
    z = standard.apply(new)
    assert z.isfinite().all()
    back, constant = standard.undo(z)[0], standard.scale[0].isinf()
    # A constant is told from the others by nine digits, and no division leaves more than that of it.
    size = x.abs().amax(0) + new[0].abs()
    wanted = torch.where(constant, x.mean(0), new[0])
    assert ((back - wanted).abs() <= 1e-6 * size).all()
    assert (z[0][constant] == 0).all()
    spread = x.amax(0) - x.amin(0)
    assert constant[spread == 0].all()
    assert not constant[spread > 1e-8 * x.shape[0] * x.abs().amax(0)].any()


@pytest.mark.parametrize("value", [0.0, 0.0364, 0.1, -1e6, 1e-12, 1e300])
@pytest.mark.parametrize("n", [1, 2, 3, 7, 100])
@pytest.mark.parametrize("D", [1, 2])
def test_a_constant_column_is_exactly_zero_everywhere(value, n, D):
    """Also where the mean of n equal numbers is off by a rounding, as that of 0.1 is, alone or beside others."""
    x = sample(n, D)
    x[:, -1] = value
    standard = Standardisation.of(x)
    new = sample(50, D, seed=1)
    new[:25, -1] = value
    z = standard.apply(new)
    assert z.isfinite().all()
    assert (z[:, -1] == 0).all()
    back = standard.undo(sample(50, D, seed=2))[:, -1]
    close(back, torch.full_like(back, value), rtol=1e-14, atol=0)
    assert standard.spread[0, -1] == 0


def test_a_small_variation_about_a_large_mean_is_no_constant():
    x = sample(2, 10, 1)
    x[0] = 3.0
    z = Standardisation.of(x).apply(sample(4, 1))
    assert (z[0] == 0).all()
    assert (z[1] != 0).all()
    # Milligrams in a kilogram are information; they are told from rounding by a margin of 10⁷.
    x = 1 + 1e-6 * sample(30, 1)
    close(Standardisation.of(x).apply(x), Standardisation.of(sample(30, 1)).apply(sample(30, 1)), rtol=1e-6, atol=1e-6)
    # A disc's contact is below its centre: M_c,tn says nothing, whatever its last digits are.
    disc = synthetic.load(40, shape={"kind": "ellipse", "semi_axes": [0.03, 0.03]})
    scale = Standardisation.of(Features.of(disc, "x1").values).scale
    assert torch.isinf(scale[0, 1])
    assert torch.isfinite(scale[0, 3:]).all()


@SPACE
def test_statistics_are_of_the_training_rows_alone(space):
    """Neither the numbers of a trial that is not trained on nor its presence changes a prediction."""
    drops = synthetic.load(40)
    order = torch.randperm(40, generator=torch.Generator().manual_seed(0))
    rows, held_out = order[:20].view(2, 10), order[20:]
    factor = torch.ones((40, 1), dtype=torch.float64).index_fill(0, held_out, 3.0)
    other = drops.replace(
        mass=drops.mass * factor[:, 0], q=drops.q * factor, v_pre=drops.v_pre * factor, v_post=drops.v_post * factor
    )
    fits = [Regressor.fit(space, trials, rows, trials.wrench[rows]) for trials in (drops, other)]
    assert torch.equal(fits[0].inputs.mean, Features.of(drops, space).values[rows].mean(-2, keepdim=True))
    for name in ("inputs", "outputs"):
        assert torch.equal(getattr(fits[0], name).mean, getattr(fits[1], name).mean)
        assert torch.equal(getattr(fits[0], name).scale, getattr(fits[1], name).scale)
    for one, two in zip(fits[0].predict(drops), fits[1].predict(drops), strict=True):
        assert torch.equal(one, two)
