"""The outline of bodies whose shape is not stated, where their contact points trace it.

In the axes of the body a contact point is p = R(−θ) r, computed or seen, and lies on

    disc        p_x² + p_y² = R²
    ellipse     p_x²/a² + p_y²/b² = 1, which gives 1/a² and 1/b² by least squares
    polygon     one of a few corners

The simplest of these is the shape of the body if nearly all r are its lowest points at θ, or those above a floor that
leans by one angle, for which a contact point that was seen moves.  Noise may displace them from a disc or an ellipse by
a few percent, but nothing that follows θ, as a wrong shape, orientation or centre of mass does.  A deviation within the
tolerance does not matter: effects use how far the contact point moves along the outline, and never the outline alone.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.errors import DataError
from contactlearn.data.audit.result import Finding, evidence_of
from contactlearn.mechanics.bodies import AnyShape
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import rotate
from contactlearn.mechanics.shapes import Disc, Ellipse, Polygon, Shape, contact_point

_TOLERANCE = 0.005  # of |r|: below what any effect of the catalogue does to r
_NOISE = 0.03  # the same of deviations from a disc or an ellipse that do not follow θ; with 5 %, a 16-gon would pass
_HARMONICS = torch.arange(1, 9)  # of θ, which deviations may follow
_BETTER = 1.25  # ratio of deviations from which on the floor leans
_NEARLY_ALL = 0.95  # of the trials: the others may be outliers, or land so flat that either corner is lowest
_MAX_TRIALS = 5000  # trials of a body, spread evenly
_MIN_ORIENTATIONS = 10  # orientations, to within 0.01 rad; and two for each number of the shape
_SPREAD = 0.02  # least eigenvalue of the normalised design of 1/a² and 1/b²; 0.25 if the points go all around evenly
_CORNER = 0.02  # of the largest |r|: points as near as this are the same corner
_MAX_CORNERS = 16  # of a polygon, at most
_LEANS = 0.005 * torch.arange(-40, 41, dtype=torch.float64)  # rad; half a step moves r by less than the tolerance


class Outline(NamedTuple):
    """A shape, the median distance of r from its lowest points in m, and the angle φ by which the floor leans, rad."""

    shape: Shape
    off: float
    lean: float

    def __str__(self) -> str:
        match self.shape:
            case Disc(radius):
                text = f"a disc with a radius of {1e3 * radius:.4g} mm"
            case Ellipse((a, b)):
                text = f"an ellipse with semi-axes of {1e3 * a:.4g} × {1e3 * b:.4g} mm"
            case other:
                text = f"a polygon of {len(other.outline()) - 1} corners"
        floor = f" on a floor that leans by about {math.degrees(self.lean):.2g}°" if self.lean else ""
        size = f"{1e3 * self.off:.2g} mm" if self.off > 1e-4 else f"{max(1e6 * self.off, 0.01):.2g} µm"
        return f"{text} to within {size}{floor}"


def outline_notes(impacts: Impacts) -> list[Finding]:
    """Note the shape that is not stated, and that the contact points trace."""
    found = {} if impacts.shape is not None else traced_outlines(impacts)
    if not found:
        return []
    traced = ", ".join(f"{outline}{name and f' ({name})'}" for name, outline in found.items())
    sentence = f"data.shape is not stated; the contact points trace {traced}, which is taken as the shape"
    evidence = evidence_of(("off", max(one.off for one in found.values()), "m"))
    name = "traced_shape"
    return [Finding(name=name, sentence=sentence, evidence=evidence, correction=name, mistake=False)]


def traced_outlines(impacts: Impacts) -> dict[str, Outline]:
    """Return the outline that the contact points of all bodies trace, under an empty name, or that of each body.

    It is empty unless the contact points of every body trace one.
    """
    names = list(dict.fromkeys(impacts.object))
    objects = torch.tensor([names.index(name) for name in impacts.object])
    each = {"": _traced(impacts)} if len(names) == 1 else {}
    each = each or {name: _traced(impacts[objects == k]) for k, name in enumerate(names)}
    found = {name: outline for name, outline in each.items() if outline is not None}
    return found if len(found) == len(each) else {}


def with_traced_shape(impacts: Impacts) -> Impacts:
    """Return the impacts with the shape that the contact points trace, unless one is stated.

    Raises:
        DataError: they trace none.
    """
    if impacts.shape is not None:
        return impacts
    shapes: dict[str, Shape] = {name: outline.shape for name, outline in traced_outlines(impacts).items()}
    if not shapes:
        raise DataError(f"{impacts.source}: the contact points trace no disc, ellipse or polygon; state data.shape")
    shape: AnyShape = shapes.get("", shapes)
    return impacts.replace(shape=shape)


def _traced(impacts: Impacts) -> Outline | None:
    """Return the simplest outline of one body that the contact points trace."""
    rows = torch.linspace(0, len(impacts) - 1, min(len(impacts), _MAX_TRIALS)).round().long()
    r, theta = impacts.r[rows], impacts.q[rows, 2]
    orientations = len((theta.remainder(2 * math.pi) / 0.01).round().unique())
    for shape, numbers in _candidates(rotate(r, -theta)):
        lowest = rotate(contact_point(shape, theta - _LEANS[:, None]), _LEANS[:, None])
        off = (r - lowest) / r.norm(dim=-1, keepdim=True)
        farthest = off.norm(dim=-1).quantile(_NEARLY_ALL, -1)
        level, best = len(_LEANS) // 2, int(farthest.argmin())
        best = level if farthest[level] <= _BETTER * farthest[best] else best
        exact = farthest[best] <= _TOLERANCE
        noisy = not isinstance(shape, Polygon) and farthest[best] <= _NOISE
        if orientations < max(_MIN_ORIENTATIONS, 2 * numbers) or not (exact or noisy):
            continue
        near = off[best].norm(dim=-1) <= farthest[best]
        if exact or _following(theta[near], off[best][near]) <= _TOLERANCE:
            return Outline(shape, (r - lowest[best]).norm(dim=-1).median().item(), _LEANS[best].item())
    return None


def _following(theta: Float[Tensor, " n"], off: Float[Tensor, "n 2"]) -> float:
    """Root mean square of the part of deviations that follows θ, without the share of noise; infinite of few trials."""
    waves = theta[:, None] * _HARMONICS
    design = torch.cat((torch.ones_like(off[:, :1]), waves.cos(), waves.sin()), -1)
    free = len(off) - design.shape[-1]
    if free < design.shape[-1]:
        return math.inf
    part = design @ torch.linalg.lstsq(design, off).solution
    noise = (off - part).square().sum() / free
    return math.sqrt(max(0.0, (part.square().sum() - design.shape[-1] * noise).item()) / len(off))


def _candidates(points: Float[Tensor, "n 2"]) -> Iterator[tuple[Shape, int]]:
    """Yield the disc, ellipse and polygon that body-fixed points suggest, each with how many numbers it has."""
    squares = points**2
    inverse = torch.linalg.lstsq(squares, torch.ones_like(squares[:, :1])).solution[:, 0]
    shares = squares * inverse
    if inverse.min() > 0 and torch.linalg.eigvalsh(shares.T @ shares / len(shares))[0] > _SPREAD:
        a, b = inverse.rsqrt().tolist()
        yield Disc(math.sqrt(a * b)), 1
        yield Ellipse((a, b)), 2
    left, corners = points, []
    while len(left) and len(corners) < _MAX_CORNERS:
        near = (left - left[0]).norm(dim=-1) < _CORNER * points.norm(dim=-1).max()
        corners.append(left[near].median(0).values.tolist())
        left = left[~near]
    try:
        yield Polygon(tuple(sorted(corners, key=lambda corner: math.atan2(corner[1], corner[0])))), 2 * len(corners)
    except DataError:  # the corners are not convex, or not around the centre of mass
        return
