"""Impacts and the shapes: what they refuse, what they keep, and where a body touches the floor."""

import dataclasses
import math
import pickle

import matplotlib.path
import numpy as np
import pytest
import torch
from refusals import refused

from contactlearn.core.errors import ContactLearnError, DataError, UnknownNameError
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.mechanics.shapes import Cuboid, Disc, Ellipse, Polygon, Sphere, contact_point, make_shape
from contactlearn.mechanics.space import PLANE
from contactlearn.simulation import synthetic

ROUNDING = 1e-12  # relative; a few hundred float64 roundings
POINTS = 400_001
SPACING = 2 * math.pi * 0.035 / (POINTS - 1)  # m between neighbours of a brute-force outline (1e-6 m steps)


def make(n: int = 4, **changes) -> Impacts:
    """n plain impacts, with some fields changed."""
    fields = {
        "mass": torch.full((n,), 0.0364),
        "inertia": torch.full((n,), 1.7e-5),
        "r": torch.tensor([[0.005, -0.03]]).repeat(n, 1),
        "q": torch.tensor([[0.3, 0.03, 0.1]]).repeat(n, 1) + torch.arange(n)[:, None],
        "v_pre": torch.tensor([[0.5, -2.5, 1.0]]).repeat(n, 1),
        "v_post": torch.tensor([[0.3, 1.2, 4.0]]).repeat(n, 1),
    }
    return Impacts(**(fields | changes))


def cell(field: str, row: int, value: float, column: int = 0) -> dict:
    """A change of one number, row counted from 1."""
    values = getattr(make(), field)
    values.view(4, -1)[row - 1, column] = value
    return {field: values}


BAD = {
    "nan": (cell("r", 2, math.nan, 1), ["drops.csv", "row 2", "'2'", "column ry", "finite", "nan"]),
    "inf": (cell("v_post", 4, math.inf, 2), ["row 4", "column omega_post", "finite", "inf"]),
    "zero mass": (cell("mass", 3, 0.0), ["row 3", "column mass", "positive", "kg", "got 0"]),
    "negative inertia": (cell("inertia", 1, -1e-5), ["row 1", "column inertia", "positive", "kg m²", "-1e-05"]),
    "no approach": (cell("v_pre", 2, 0.4, 1), ["row 2", "column vy", "approach", "rx ω < 0", "0.405", "swapped"]),
    "resting": ({"v_pre": torch.zeros(4, 3)}, ["row 1", "column vy", "got 0", "3 more rows"]),
    "nan in q_post": ({"q_post": torch.full((4, 3), math.nan)}, ["row 1", "column x_post", "3 more rows"]),
    "nan in time": ({"time": torch.tensor([0.0, 1, 2, math.nan])}, ["row 4", "column time"]),
    "trial twice": ({"trial": "abca"}, ["row 4", "column trial", "unique", "'a'", "row 1"]),
    "empty trial": ({"trial": ("1", "2", "", "4")}, ["row 3", "column trial", "name"]),
    "empty object": ({"object": ("", "b", "c", "d")}, ["row 1", "column object", "name"]),
    "few names": ({"trial": ("1", "2")}, ["2 trial names for 4 impacts"]),
    "many objects": ({"object": ("a",) * 5}, ["5 object names for 4 impacts"]),
    "wrong width": ({"q": torch.zeros(4, 2)}, ["q must have shape (4, 3)", "(4, 2)"]),
    "wrong length": ({"inertia": torch.ones(3)}, ["inertia must have shape (4,)", "(3,)"]),
}


@pytest.mark.parametrize(("changes", "fragments"), BAD.values(), ids=BAD)
def test_impacts_refuse(changes, fragments):
    with refused(fragments):
        make(source="drops.csv", **changes)


def test_names_default_to_the_row_and_body():
    with pytest.raises(DataError, match="at least one"):
        make(0)
    impacts = make(3)
    assert impacts.trial == ("1", "2", "3")
    assert impacts.object == ("body",) * 3
    assert make(2, trial=(7, "007")).trial == ("7", "007")
    impacts = make(2, mass=[1, 2], inertia=np.array([1, 2]), q=torch.ones(2, 3, dtype=torch.float32))
    assert {getattr(impacts, name).dtype for name in PLANE.components if getattr(impacts, name) is not None} == {
        torch.float64
    }
    assert repr(make(shape=Disc(0.03), source="a.csv")) == (
        "Impacts(4 trials of body, shape=Disc(radius=0.03), source='a.csv')"
    )


@pytest.mark.parametrize(("rows", "expected"), [
    ([2, 0], [2, 0]),
    (torch.tensor([3, 1]), [3, 1]),
    (np.array([1, 2]), [1, 2]),
    (torch.tensor([True, False, False, True]), [0, 3]),
    ([False, True, True, False], [1, 2]),
    (slice(1, None), [1, 2, 3]),
    (slice(None, None, 2), [0, 2]),
    ([-1], [3]),
], ids=str)  # fmt: skip
def test_indexing_picks_every_field_in_the_given_order(rows, expected):
    impacts = make(
        4, q_post=torch.arange(12.0).reshape(4, 3), time=torch.arange(4.0), trial="wxyz", object="abcd",
        shape=Disc(0.03), source="s",
    )  # fmt: skip
    picked = impacts[rows]
    for name in PLANE.components:
        assert torch.equal(getattr(picked, name), getattr(impacts, name)[expected])
    assert picked.trial == tuple("wxyz"[i] for i in expected)
    assert picked.object == tuple("abcd"[i] for i in expected)
    assert (picked.shape, picked.source) == (impacts.shape, "s")
    assert torch.equal(picked.W, impacts.W[expected])


def test_indexing_keeps_absent_fields_absent_and_refuses_repeats():
    impacts = make()
    assert impacts[[0]].q_post is None
    with pytest.raises(DataError, match="unique"):
        impacts[[1, 1]]
    with pytest.raises(DataError, match="at least one"):
        impacts[torch.zeros(4, dtype=torch.bool)]


def test_split_partitions_the_trials_and_follows_its_generator():
    impacts = make(20)
    pool, test = impacts.split(0.25, torch.Generator().manual_seed(1))
    assert (len(pool), len(test)) == (15, 5)
    assert sorted(pool.trial + test.trial, key=int) == list(impacts.trial)
    assert list(test.trial) == sorted(test.trial, key=int)
    again = impacts.split(0.25, torch.Generator().manual_seed(1))[1]
    other = impacts.split(0.25, torch.Generator().manual_seed(2))[1]
    assert again.trial == test.trial != other.trial


@pytest.mark.parametrize("share", [0.0, 1.0, -0.1, 1.5, 0.01])
def test_split_refuses_an_empty_side(share):
    with pytest.raises(DataError, match="hold out"):
        make(20).split(share, torch.Generator())


def test_impacts_are_immutable():
    theirs = torch.full((4,), 0.0364, dtype=torch.float64)
    array = np.full(4, 1.7e-5)
    impacts = make(mass=theirs, inertia=array)
    theirs[0], array[0] = -1, -1
    assert (impacts.mass > 0).all()
    assert (impacts.inertia > 0).all()
    with pytest.raises(dataclasses.FrozenInstanceError):
        impacts.mass = theirs
    part = impacts[:2]
    part.q[0] = 99
    assert impacts.q.max() < 99
    impacts = make()
    heavy = impacts.replace(mass=2 * impacts.mass)
    assert torch.equal(heavy.mass, 2 * impacts.mass)
    assert torch.equal(heavy.W, heavy.replace().W)
    assert not torch.equal(heavy.W, impacts.W)
    with pytest.raises(DataError, match="positive"):
        impacts.replace(mass=-impacts.mass)
    impacts = synthetic.load(size=50)
    prediction = Prediction.from_wrench(impacts, impacts.wrench)
    torch.testing.assert_close(prediction.v_post, impacts.v_post, rtol=1e-10, atol=1e-12)


def test_errors_come_back_from_a_worker_process_as_they_are():
    for error in (UnknownNameError("law", "newton", ["wang_mason"]), DataError("a rule", row=3)):
        copy = pickle.loads(pickle.dumps(error))
        assert (type(copy), str(copy), vars(copy)) == (type(error), str(error), vars(error))
        assert isinstance(copy, ContactLearnError)
    assert "did you mean 'wang_mason'" in str(UnknownNameError("law", "wang-mason", ["wang_mason", "mirtich"]))


THETA = torch.linspace(-7, 7, 57, dtype=torch.float64)
ROUND = {"ellipse": Ellipse((0.035, 0.025)), "upright": Ellipse((0.01, 0.03)), "disc": Disc(0.03)}
CORNERED = {
    "square": Polygon(((0.02, 0.02), (-0.02, 0.02), (-0.02, -0.02), (0.02, -0.02))),
    "clockwise triangle": Polygon(((0.0, 0.03), (0.02, -0.01), (-0.03, -0.02))),
    "five sides": Polygon(((0.03, 0), (0.01, 0.025), (-0.02, 0.02), (-0.025, -0.01), (0.005, -0.03))),
}


def lowest(outline: torch.Tensor, theta: torch.Tensor) -> torch.Tensor:
    """The lowest of the points of a body-frame outline turned by θ: brute force."""
    c, s = theta.cos(), theta.sin()
    turned = outline @ torch.stack((torch.stack((c, s)), torch.stack((-s, c))))
    return turned[turned[:, 1].argmin()]


@pytest.mark.parametrize("shape", ROUND.values(), ids=ROUND)
def test_round_contact_point_is_the_lowest_of_the_outline(shape):
    outline = shape.outline(POINTS)
    for theta, r in zip(THETA, contact_point(shape, THETA), strict=True):
        brute = lowest(outline, theta)
        # The height is stationary there, so it is off by the spacing squared; the place by a spacing or so.
        assert abs(r[1] - brute[1]) < SPACING**2 / 0.005
        assert abs(r[0] - brute[0]) < 2 * SPACING


@pytest.mark.parametrize("shape", CORNERED.values(), ids=CORNERED)
def test_polygon_contact_point_is_the_lowest_of_the_outline(shape):
    corners = shape.outline()
    steps = torch.linspace(0, 1, 101, dtype=torch.float64)[:, None, None]
    sides = (corners[:-1] + steps * (corners[1:] - corners[:-1])).reshape(-1, 2)
    for theta, r in zip(THETA[:-1] + 0.01, contact_point(shape, THETA[:-1] + 0.01), strict=True):
        torch.testing.assert_close(r, lowest(sides, theta), rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("shape", [*ROUND.values(), *CORNERED.values()], ids=[*ROUND, *CORNERED])
def test_contact_point_of_a_batch_is_that_of_each(shape):
    theta = THETA[:56].reshape(7, 8) + 0.01
    batch = contact_point(shape, theta)
    assert batch.shape == (7, 8, 2)
    assert (batch[..., 1] < 0).all()
    torch.testing.assert_close(batch[3, 5], contact_point(shape, theta[3, 5]), rtol=ROUNDING, atol=0)


WEIGHED = {
    **ROUND,
    "square": CORNERED["square"],
    "rod": Polygon(((0.06, 0.005), (-0.06, 0.005), (-0.06, -0.005), (0.06, -0.005))),
    "clockwise triangle": Polygon(((0.0, 0.03), (0.02, -0.01), (-0.02, -0.02))),
    "hexagon": Polygon(((0.03, 0.01), (0.01, 0.03), (-0.02, 0.02), (-0.03, -0.01), (-0.01, -0.03), (0.02, -0.02))),
}


@pytest.mark.parametrize("shape", WEIGHED.values(), ids=WEIGHED)
def test_gyration_is_the_mean_square_distance_of_the_points_inside(shape):
    outline = shape.outline(2001)
    low, high = outline.aminmax(dim=0)
    cells = (torch.arange(500, dtype=torch.float64)[:, None] + 0.5) / 500
    points = torch.cartesian_prod(*(low + cells * (high - low)).unbind(-1))
    inside = points[matplotlib.path.Path(outline.numpy()).contains_points(points.numpy())]
    # The cells that the outline cuts, some 4/500 of all, are in or out as their middles are: ± by chance.
    assert shape.gyration_squared() == pytest.approx(inside.square().sum(1).mean().item(), rel=1e-3)


@pytest.mark.parametrize("turn", [0.0, 0.7, -2.0])
def test_gyration_of_a_rectangle_however_it_is_written(turn):
    w, h = 0.12, 0.01
    corners = [(w / 2, h / 2), (-w / 2, h / 2), (-w / 2, -h / 2), (w / 2, -h / 2)]
    c, s = math.cos(turn), math.sin(turn)
    turned = [(c * x - s * y, s * x + c * y) for x, y in corners]
    for vertices in (turned, turned[::-1], turned[1:] + turned[:1]):
        assert Polygon(vertices).gyration_squared() == pytest.approx((w**2 + h**2) / 12, rel=ROUNDING)


def test_gyration_of_a_disc_is_that_of_its_ellipse_and_of_many_sides():
    disc = Disc(0.03)
    assert disc.gyration_squared() == pytest.approx(Ellipse((0.03, 0.03)).gyration_squared(), rel=ROUNDING)
    sides = 1000  # a regular polygon's ρ² = R² (2 + cos(2π/n)) / 6 falls short of R²/2 by (2π/n)²/6 of it
    assert Polygon(disc.outline(sides + 1)[:-1].tolist()).gyration_squared() == pytest.approx(
        0.03**2 * (2 + math.cos(2 * math.pi / sides)) / 6, rel=ROUNDING
    )
    corners = [(0.03, 0.0), (0.0, 0.03), (-0.01, -0.01)]
    with pytest.raises(DataError, match=r"centroid.*\(0\.00666666667, 0\.00666666667\) m: subtract it"):
        Polygon(corners).gyration_squared()
    mended = Polygon([(x - 0.00666666667, y - 0.00666666667) for x, y in corners])
    assert mended.gyration_squared() > 0
    square = CORNERED["square"]
    assert contact_point(square, torch.tensor(0.0, dtype=torch.float64)).tolist() == [-0.02, -0.02]
    outline = Ellipse((0.035, 0.025)).outline(41)
    on = (outline / torch.tensor([0.035, 0.025], dtype=torch.float64)).square().sum(-1)
    torch.testing.assert_close(on, torch.ones(41, dtype=torch.float64), rtol=ROUNDING, atol=0)
    torch.testing.assert_close(outline[0], outline[-1], rtol=0, atol=ROUNDING)


def test_rounded_vertices_are_centred_and_a_side_is_no_inside():
    square = torch.tensor(((0.03, 0.03), (-0.03, 0.03), (-0.03, -0.03), (0.03, -0.03)), dtype=torch.float64)
    assert Polygon(tuple(map(tuple, (square + 2e-5).tolist()))).gyration_squared() == pytest.approx(6e-4, rel=1e-5)
    with refused(["inside, and not on a side", "the mean of these vertices is at (0, 0.03) m"]):
        Polygon(tuple(map(tuple, (square + torch.tensor((0.0, 0.03))).tolist())))
    with refused(["must be convex"]):
        Polygon(((0.03, 0.03), (0.0, 0.01), (-0.03, 0.03), (-0.03, -0.03), (0.03, -0.03)))


def test_make_shape():
    assert make_shape(None) is None
    assert make_shape(Disc(0.1)) == Disc(0.1)
    assert make_shape({"kind": "ellipse", "semi_axes": [0.035, 0.025]}) == Ellipse((0.035, 0.025))
    assert make_shape({"kind": "disc", "radius": "0.1"}) == Disc(0.1)
    corners = [[1, 0], [0, 1], [-1, -1]]
    assert make_shape({"kind": "polygon", "vertices": corners}) == Polygon(((1, 0), (0, 1), (-1, -1)))


@pytest.mark.parametrize(
    ("spec", "same"),
    [
        ({"kind": "rectangle", "sides": [2, 4]}, Polygon(((1, 2), (-1, 2), (-1, -2), (1, -2)))),
        ({"kind": "rectangle", "width": 2, "height": 4}, Polygon(((1, 2), (-1, 2), (-1, -2), (1, -2)))),
        ({"kind": "square", "side": 2, "corner": 0.1}, Polygon(((1, 1), (-1, 1), (-1, -1), (1, -1)), 0.1)),
        ({"kind": "box", "size": [2, 4]}, Polygon(((1, 2), (-1, 2), (-1, -2), (1, -2)))),
        ({"kind": "box", "size": [2, 4, 6]}, Cuboid((1, 2, 3))),
        ({"kind": "box", "width": 2, "height": 4, "depth": 6}, Cuboid((1, 2, 3))),
        ({"kind": "cube", "side": 2, "corner": 0.1}, Cuboid((1, 1, 1), 0.1)),
        ({"kind": "cube", "half": [1, 1, 1]}, Cuboid((1, 1, 1))),
        ({"kind": "circle", "radius": 0.1}, Disc(0.1)),
        ({"kind": "disc", "diameter": 0.2}, Disc(0.1)),
        ({"kind": "ball", "diameter": 0.2}, Sphere(0.1)),
    ],
)  # fmt: skip
def test_shapes_in_other_words(spec, same):
    assert make_shape(spec) == same


BAD_SHAPES = {
    "no sides": ({"kind": "rectangle"}, ["takes sides", "2 lengths", "got nothing"]),
    "one side": ({"kind": "rectangle", "side": 1}, ["2 positive number"]),
    "a side too many": ({"kind": "square", "sides": [1, 2, 3]}, ["2 positive number"]),
    "no length": ({"kind": "cube", "breadth": 1}, ["takes sides", "got breadth"]),
    "flat box": ({"kind": "box", "sides": [0, 1, 1]}, ["3 positive number"]),
    "no such entry": ({"kind": "square", "side": 1, "colour": 3}, ["takes vertices, corner"]),
    "unknown": ({"kind": "elipse", "semi_axes": [1, 2]}, ["'elipse'", "did you mean 'ellipse'", "polygon"]),
    "no kind": ({"radius": 1}, ["add kind: disc or sphere, as in data.shape.kind=disc", "got radius: 1"]),
    "no kind in space": ({"radius": 1, "half_length": 2}, ["add kind: cylinder, as in data.shape.kind=cylinder"]),
    "nothing": ({}, ["add kind: ellipse or polygon", "got nothing"]),
    "not a mapping": ("ellipse", ["kind: ellipse", "'ellipse'"]),
    "missing entry": ({"kind": "disc"}, ["'disc'", "takes radius", "got nothing"]),
    "wrong entry": ({"kind": "disc", "semi_axes": [1, 1]}, ["takes radius", "got semi_axes"]),
    "one axis": ({"kind": "ellipse", "semi_axes": [1]}, ["semi_axes", "2 positive", "metres"]),
    "axis as text": ({"kind": "ellipse", "semi_axes": ["a", 1]}, ["semi_axes", "2 number", "'a'"]),
    "axes as a number": ({"kind": "ellipse", "semi_axes": 1}, ["semi_axes", "2 number"]),
    "zero axis": ({"kind": "ellipse", "semi_axes": [0, 1]}, ["positive", "metres"]),
    "nan radius": ({"kind": "disc", "radius": math.nan}, ["radius", "positive", "nan"]),
    "two corners": ({"kind": "polygon", "vertices": [[0, 0], [1, 1]]}, ["at least 3", "got 2"]),
    "not pairs": ({"kind": "polygon", "vertices": [1, 2, 3]}, ["pairs", "metres"]),
    "nan corner": ({"kind": "polygon", "vertices": [[1, 0], [0, math.nan], [-1, -1]]}, ["finite", "nan"]),
    "dented": ({"kind": "polygon", "vertices": [[2, -1], [0, 2], [-2, -1], [0, -0.5]]}, ["convex"]),
    "star": ({"kind": "polygon", "vertices": [[math.cos(2 * k * 1.2566), math.sin(2 * k * 1.2566)] for k in range(5)]},
        ["convex", "in order"]),
    "flat": ({"kind": "polygon", "vertices": [[-1, 0], [0, 0], [1, 0]]}, ["convex"]),
    "centre outside": ({"kind": "polygon", "vertices": [[1, 1], [2, 1], [1, 2]]}, ["centre of mass", "inside"]),
}  # fmt: skip


@pytest.mark.parametrize(("spec", "fragments"), BAD_SHAPES.values(), ids=BAD_SHAPES)
def test_make_shape_refuses(spec, fragments):
    with refused(fragments, ContactLearnError):
        make_shape(spec)


@pytest.mark.parametrize("rows", [[40], [-41], [0.5], [True] * 39, None, "first"], ids=str)
def test_rows_that_are_not_there_are_refused_in_a_line(rows):
    with pytest.raises(DataError, match=r"rows must be whole numbers from 0 to 39, or a mask of 40 truth values, got"):
        synthetic.load(40)[rows]


def test_rows_may_be_numbers_masks_and_slices():
    drops = synthetic.load(40)
    mask = torch.arange(40) > 36
    read_only = mask.numpy().copy()
    read_only.flags.writeable = False  # as those of pandas are
    for rows in ([37, 38, 39], [-3, -2, -1], mask, mask.tolist(), read_only, slice(37, None)):
        assert drops[rows].trial == ("38", "39", "40")


@pytest.mark.parametrize("share", [math.nan, math.inf, None, "half", -0.1, 0, 1, 1.5])
def test_an_impossible_share_is_refused_in_a_line(share):
    with pytest.raises(DataError, match="hold out"):
        synthetic.load(40).split(share, torch.Generator().manual_seed(0))
