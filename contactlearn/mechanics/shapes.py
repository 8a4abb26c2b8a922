"""Convex bodies on a flat floor, in the plane and in space: where they touch it, and how hard they are to turn.

`contact_point` is the body's lowest point at orientation θ, in space at a quaternion, relative to the centre of mass
and in world axes: r [..., d] in metres, its last component < 0, differentiable in the orientation and in the body's
scale (of a body with corners, between the jumps from one to the next).  `gyration_squared` is I/m of the body if its
density is uniform.  Shapes are plain values; `None` stands for an unknown shape.
"""

import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import Field, dataclass, fields
from functools import cached_property, lru_cache
from inspect import signature
from typing import Any, ClassVar, Protocol

import torch
from jaxtyping import Float, Int
from torch import Tensor

from contactlearn.core.errors import DataError, UnknownNameError
from contactlearn.core.numerics import finite_number
from contactlearn.mechanics.hull import Hull, convex_hull, mesh_points
from contactlearn.mechanics.rigid_body import matvec, rotate, rotation
from contactlearn.mechanics.space import SPACE, Space

_OFF = 1e-6  # products of inertia over the sum of moments, at most
_ROUNDED = 1e-3  # distance of the origin from the centroid over the body's size, at most: vertices are rounded
_UNIT = 1e-3  # by which the length of a quaternion may differ from 1
_AXES = ("x", "y", "z")
_TOUCHING = 1e-6  # of a sphere of radius 1 from the faces of a corner, at most


class Shape(Protocol):
    """A convex body; the body frame has its origin at the centre of mass and is turned by θ."""

    def support(self, direction: Float[Tensor, "*batch d"]) -> Float[Tensor, "*batch d"]:
        """Farthest point [..., d] in m in a direction [..., d] of any length, both in the body frame."""
        ...

    def gyration_squared(self) -> Any:
        """Squared radius of gyration ρ² = I/m in m² about the centre of mass, at uniform density; in space [3]."""
        ...

    def outline(self, points: int = 181) -> Float[Tensor, "points d"]:
        """Closed boundary [points, d] in m, in the body frame; in space of the shadow along y."""
        ...


def contact_point(
    shape: Shape,
    theta: Float[Tensor, "..."],
    scale: Sequence[Float[Tensor, "*#batch"] | float] = (1.0, 1.0),
    corner: Tensor | float = 0.0,
) -> Float[Tensor, "..."]:
    """Lowest point r [..., d] in m at orientation θ [...] in rad, in space at a quaternion [..., 4].

    The body may be stretched by `scale` along its own x and y (and z) axes: the farthest point of S K in the
    direction d is S times that of K in the direction S d.  Its corners, if any, are rounder by `corner` in m.
    """
    down, in_world = _placed(theta, 3 if isinstance(shape, Solid) else 2)
    s = torch.stack(torch.broadcast_tensors(*(down.new_ones(()) * x for x in (*scale, 1.0)[: down.shape[-1]])), -1)
    lowest = s * shape.support(down * s)
    if isinstance(shape, Cornered) and (isinstance(corner, Tensor) or corner):
        lowest = lowest + shape.rounding(shape.facing(down), down, corner)
    return in_world(lowest)


def _placed(orientation: Float[Tensor, "..."], d: int) -> tuple[Float[Tensor, "*batch d"], Callable[[Tensor], Tensor]]:
    """Straight down in the axes of a body, and the way from these to the world's."""
    if d == 2:
        down = torch.stack((-orientation.sin(), -orientation.cos()), -1)
        return down, lambda vector: rotate(vector, orientation)
    R = rotation(orientation)
    return -R[..., 2, :], lambda vector: matvec(R, vector)


@dataclass(frozen=True)
class _Elliptic:
    """A body of the semi-axes (a, b), in space (a, b, c)."""

    semi_axes: tuple[float, ...]

    def __post_init__(self) -> None:
        count = 3 if isinstance(self, Solid) else 2
        object.__setattr__(self, "semi_axes", _lengths("semi_axes", self.semi_axes, count))

    def support(self, direction: Float[Tensor, "*batch d"]) -> Float[Tensor, "*batch d"]:
        """A² d / |A d|, A = diag(a, b) or diag(a, b, c)."""
        axes = direction.new_tensor(self.semi_axes)
        return axes**2 * direction / (axes * direction).square().sum(-1, keepdim=True).sqrt()


@dataclass(frozen=True)
class _Round:
    """A body of one radius about its centre of mass."""

    radius: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", _lengths("radius", [self.radius], 1)[0])

    def support(self, direction: Float[Tensor, "*batch d"]) -> Float[Tensor, "*batch d"]:
        """The radius along d."""
        return self.radius * direction / direction.norm(dim=-1, keepdim=True)


@dataclass(frozen=True)
class Ellipse(_Elliptic):
    """Ellipse with `semi_axes` (a, b) in m along the body's x and y axes."""

    def gyration_squared(self) -> float:
        """ρ² = (a² + b²) / 4."""
        return (self.semi_axes[0] ** 2 + self.semi_axes[1] ** 2) / 4

    def outline(self, points: int = 181) -> Float[Tensor, "points 2"]:
        """Boundary at equal steps of the eccentric angle, closed."""
        angle = torch.linspace(0, 2 * math.pi, points, dtype=torch.float64)
        return torch.stack((self.semi_axes[0] * angle.cos(), self.semi_axes[1] * angle.sin()), -1)


@dataclass(frozen=True)
class Disc(_Round):
    """Disc of `radius` in m about its centre of mass."""

    def gyration_squared(self) -> float:
        """ρ² = R² / 2."""
        return self.radius**2 / 2

    def outline(self, points: int = 181) -> Float[Tensor, "points 2"]:
        """Boundary at equal steps of the angle, closed."""
        return Ellipse((self.radius, self.radius)).outline(points)


class Cornered(ABC):
    """A body with corners, in the plane or in space.

    They are arcs of radius `corner` within their two sides, in space parts of spheres within their faces.  On a flat
    side or an edge several corners are lowest; the contact point is then the first of them, so r jumps there, as it
    does for the real body.
    """

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]
    corner: float

    @abstractmethod
    def corners(self) -> Float[Tensor, "v d"]:
        """Return the places in m in which sides or faces meet, in the body frame."""

    @abstractmethod
    def edges(self) -> Int[Tensor, "e 2"]:
        """Return the pairs of corners that an edge joins."""

    @abstractmethod
    def arc_centres(self) -> Float[Tensor, "v d"]:
        """Return the way from each corner to the centre of its arc or sphere, of radius 1: a · n = −1 for its sides."""

    def largest_corner(self) -> float:
        """Largest radius in m at which no two corners overlap: each shortens its edges, of direction e, by a · e."""
        corners, cut, (one, other) = self.corners(), self.arc_centres(), self.edges().unbind(-1)
        along = corners[other] - corners[one]
        length = along.norm(dim=-1)
        shorter = ((cut[one] - cut[other]) * along).sum(-1) / length
        return (length / shorter.clamp_min(1e-300)).min().item()

    def facing(self, direction: Float[Tensor, "*batch d"]) -> Int[Tensor, "*batch"]:
        """The corner of the greatest d · p, the first of equals, by its number."""
        return (direction @ self.corners().to(direction).T).argmax(-1)

    def support(self, direction: Float[Tensor, "*batch d"]) -> Float[Tensor, "*batch d"]:
        """The corner that faces d, or the point of its arc with the normal d."""
        faces = self.facing(direction)
        sharp = self.corners().to(direction)[faces]
        return sharp + self.rounding(faces, direction, self.corner) if self.corner else sharp

    def rounding(
        self, corner: Int[Tensor, "*#batch"], direction: Float[Tensor, "*#batch d"], radius: Tensor | float
    ) -> Float[Tensor, "*#batch d"]:
        """From corners to the points of arcs of a radius in m that have these normals, in the body frame."""
        arcs = self.arc_centres().to(direction)[corner] + direction / direction.norm(dim=-1, keepdim=True)
        return (arcs.new_ones(()) * radius)[..., None] * arcs

    def lowest_corners(self, orientation: Float[Tensor, "..."]) -> tuple[Float[Tensor, "n d"], Float[Tensor, "n d"]]:
        """The lowest corner and the next at orientations [N] or [N, 4], from the centre of mass in world axes, m."""
        sharp = self.corners().to(orientation)
        down, in_world = _placed(orientation.unsqueeze(1), sharp.shape[1])
        corners = in_world(sharp + self.rounding(torch.arange(len(sharp)), down, self.corner))
        every = torch.arange(len(corners), device=orientation.device)
        first, second = corners[..., -1].topk(2, largest=False).indices.unbind(-1)
        return corners[every, first], corners[every, second]


def _uniform(simplices: Float[Tensor, "s d d"]) -> tuple[Float[Tensor, " d"], Float[Tensor, "d d"]]:
    """Centroid in m and ∫ x xᵀ / V in m² of simplices with the origin, each by its other d corners p.

    They are Σ V_k Σp / (d + 1) V and Σ V_k (Σ p pᵀ + Σp Σpᵀ) / (d + 1) (d + 2) V.
    """
    share, total, d = torch.linalg.det(simplices).abs(), simplices.sum(1), simplices.shape[-1]
    share = share / share.sum()
    squares = simplices.mT @ simplices + total[:, :, None] * total[:, None]
    return share @ total / (d + 1), (share[:, None, None] * squares).sum(0) / ((d + 1) * (d + 2))


def _off_centroid(rule: str, centroid: Float[Tensor, " d"]) -> DataError:
    """The error of a body whose origin is not its centroid."""
    at = ", ".join(f"{x:.9g}" for x in centroid.tolist())
    mend = "" if len(centroid) == 2 else f", or state data.shape.centre=[{at}], and give poses of that point"
    return DataError(f"{rule} is at ({at}) m: subtract it from every vertex{mend}")


_INSIDE = "a polyhedron must have its centre of mass, the origin, inside; of uniform density it"
_CENTRED = "of uniform density has its centre of mass, the origin, at its centroid, but that"


@dataclass(frozen=True)
class Polygon(Cornered):
    """Convex polygon with `vertices` [V, 2] in m, in the body frame, in order around the body."""

    vertices: tuple[tuple[float, float], ...]
    corner: float = 0.0

    def __post_init__(self) -> None:
        try:
            corners = tuple((float(x), float(y)) for x, y in self.vertices)
        except (TypeError, ValueError):
            raise DataError(f"a polygon's vertices are pairs [x, y] in metres, got {self.vertices!r}") from None
        if len(corners) < 3:
            raise DataError(f"a polygon needs at least 3 vertices, got {len(corners)}")
        if not all(math.isfinite(x) and math.isfinite(y) for x, y in corners):
            raise DataError(f"a polygon's vertices must be finite numbers in metres, got {corners}")
        turns = {
            math.copysign(1, cross)
            for (x0, y0), (x1, y1), (x2, y2) in zip(
                corners, corners[1:] + corners[:1], corners[2:] + corners[:2], strict=True
            )
            if (cross := (x1 - x0) * (y2 - y1) - (y1 - y0) * (x2 - x1)) != 0
        }
        pairs = [*zip(corners, corners[1:] + corners[:1], strict=True)]
        beside = [x0 * y1 - y0 * x1 for (x0, y0), (x1, y1) in pairs]
        # Seen from the centre of mass a convex outline goes around once; a star goes around twice.
        around = sum(
            math.atan2(area, x0 * x1 + y0 * y1) for area, ((x0, y0), (x1, y1)) in zip(beside, pairs, strict=True)
        )
        if len(turns) == 1 and min(area * max(turns) for area in beside) <= 1e-6 * max(map(abs, beside)):
            x, y = (sum(part) / len(corners) for part in zip(*corners, strict=True))
            raise DataError(
                "a polygon must have its centre of mass, the origin, inside, and not on a side or beyond it; the mean "
                f"of these vertices is at ({x:.4g}, {y:.4g}) m: give them about the centre of mass"
            )
        if len(turns) != 1 or abs(abs(around) - 2 * math.pi) > 1e-6:
            raise DataError(f"a polygon must be convex, with its vertices in order around the body; got {corners}")
        object.__setattr__(self, "vertices", corners)
        object.__setattr__(self, "corner", finite_number("corner", self.corner, 0))
        if self.corner > (largest := self.largest_corner()):
            raise DataError(
                f"arcs of the corners must fit into the sides of a polygon, at most {largest:.4g} m, got corner="
                f"{self.corner:g}"
            )

    def corners(self) -> Float[Tensor, "v 2"]:
        """The vertices."""
        return _points(self.vertices)

    def edges(self) -> Int[Tensor, "v 2"]:
        """Each vertex and the next."""
        every = torch.arange(len(self.vertices))
        return torch.stack((every, every.roll(-1)), -1)

    def arc_centres(self) -> Float[Tensor, "vertices 2"]:
        """From each vertex to the centre of its arc, of radius 1: −(a + b)/(1 + a·b) of its sides' outward normals."""
        corners = self.corners()
        x, y = (corners.roll(-1, 0) - corners).unbind(-1)
        around = (corners[:, 0] * y - corners[:, 1] * x).sum().sign()  # 1 if counter-clockwise
        after = around * torch.stack((y, -x), -1) / torch.hypot(x, y)[:, None]  # of the side that begins at a vertex
        before = after.roll(1, 0)
        return -(before + after) / (1 + (before * after).sum(-1, keepdim=True))

    def gyration_squared(self) -> float:
        """ρ² = Σ A_k (|p|² + p·q + |q|²) / (6 Σ A_k) over the triangles from the origin to each side (p, q).

        Raises:
            DataError: the centroid is not at the origin, so the density cannot be uniform.
        """
        p = self.outline()[:-1]
        centroid, second = _uniform(torch.stack((p, p.roll(-1, 0)), 1))
        if centroid.abs().max() > _ROUNDED * p.abs().max():
            raise _off_centroid(f"a polygon {_CENTRED}", centroid)
        return second.trace().item()

    def outline(self, points: int = 181) -> Float[Tensor, "points 2"]:
        """The vertices, and the first again; round corners at equal angles."""
        if not self.corner:
            return torch.tensor((*self.vertices, self.vertices[0]), dtype=torch.float64)
        angle = torch.linspace(0, 2 * math.pi, points, dtype=torch.float64)
        return self.support(torch.stack((angle.cos(), angle.sin()), -1))


class Solid(ABC):
    """A convex body in space, whose support and gyration have three components."""

    @abstractmethod
    def support(self, direction: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        """Return the farthest point [..., 3] in m in a direction [..., 3], both in the body frame."""

    @abstractmethod
    def gyration_squared(self) -> Float[Tensor, "3"]:
        """Return I/m [3] in m² about the body's axes, at uniform density."""

    def outline(self, points: int = 181) -> Float[Tensor, "lines 3"]:
        """Return a closed line about each axis, with a gap (nan) behind each."""
        about = torch.cat((Disc(1.0).outline(points), torch.zeros(points, 1, dtype=torch.float64)), -1)
        return _with_gaps([self.support(about.roll(axis, -1)) for axis in range(3)])


@dataclass(frozen=True)
class Ellipsoid(_Elliptic, Solid):
    """Ellipsoid with `semi_axes` (a, b, c) in m along the body's axes."""

    def gyration_squared(self) -> Float[Tensor, "3"]:
        """(b² + c²)/5 and so on."""
        squares = torch.tensor(self.semi_axes, dtype=torch.float64).square()
        return (squares.sum() - squares) / 5


@dataclass(frozen=True)
class Sphere(_Round, Solid):
    """Ball of `radius` in m about its centre of mass."""

    def gyration_squared(self) -> Float[Tensor, "3"]:
        """ρ² = 2 R²/5 about every axis."""
        return torch.full((3,), 0.4 * self.radius**2, dtype=torch.float64)


@dataclass(frozen=True)
class Cylinder(Solid):
    """Cylinder of `radius` and `half_length` in m along the body's `axis`, x, y or z; its rims are sharp.

    The mass centre is `centre` in m along the axis from the middle, as that of a cup.  On a flat end a point of the rim
    is lowest, and on its side the end of positive axis: r jumps there, as it does for the real body.
    """

    radius: float
    half_length: float
    axis: str = "z"
    centre: float = 0.0

    def __post_init__(self) -> None:
        for name in ("radius", "half_length"):
            object.__setattr__(self, name, _lengths(name, [getattr(self, name)], 1)[0])
        if self.axis not in _AXES:
            raise DataError(f"axis of a cylinder is x, y or z of the body, got {self.axis!r}")
        object.__setattr__(self, "centre", finite_number("centre", self.centre, -math.inf))
        if abs(self.centre) >= self.half_length:
            raise DataError(
                "the mass centre of a cylinder is inside, less than half_length from the middle, which is "
                f"{self.half_length:g} m; got centre={self.centre:g}"
            )

    @property
    def along(self) -> Float[Tensor, "3"]:
        """Unit vector of the axis."""
        return torch.eye(3, dtype=torch.float64)[_AXES.index(self.axis)]

    def support(self, direction: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        """R d_⊥/|d_⊥| on the end of d; where d is along the axis, the point of the rim on the first axis across."""
        along = self.along.to(direction)
        height = direction @ along
        across = direction - height[..., None] * along
        upright = across.square().sum(-1, keepdim=True) == 0
        across = torch.where(upright, torch.eye(3).to(direction)[int(self.axis == "x")], across)
        end = torch.where(height >= 0, 1, -1).to(direction) * self.half_length - self.centre
        return self.radius * across / across.norm(dim=-1, keepdim=True) + end[..., None] * along

    def touching(self, direction: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3 3"]:
        """Return the farthest point, that of the other rim, and the opposite one of its own rim."""
        opposite = direction @ (2 * torch.diag(self.along) - torch.eye(3)).to(direction)
        return self.support(torch.stack((direction, -opposite, opposite), -2))

    def flats(self, direction: Float[Tensor, "*batch 3"]) -> tuple[Float[Tensor, "*batch 3"], Float[Tensor, "3"]]:
        """Return cosines of a unit direction with the two ends and the side, and their distances in m."""
        height = direction @ self.along.to(direction)
        side = (direction - height[..., None] * self.along.to(direction)).norm(dim=-1)
        ends = self.half_length - self.centre, self.half_length + self.centre
        return torch.stack((height, -height, side), -1), direction.new_tensor((*ends, self.radius))

    def gyration_squared(self) -> Float[Tensor, "3"]:
        """R²/2 about the axis, and (3 R² + L²)/12 across it.

        Raises:
            DataError: the mass centre is not in the middle, so the density cannot be uniform.
        """
        if self.centre:
            raise DataError(
                f"a cylinder of uniform density has its mass centre in the middle, and centre={self.centre:g} m says "
                "otherwise: state its moments of inertia, data.inertia=[Ix,Iy,Iz]"
            )
        across, about = self.radius**2 / 4 + self.half_length**2 / 3, self.radius**2 / 2
        return across + (about - across) * self.along

    def outline(self, points: int = 181) -> Float[Tensor, "lines 3"]:
        """Return both rims, and four lines from rim to rim, each with a gap (nan) behind."""
        first, second = (one for one in torch.eye(3, dtype=torch.float64) if not one.equal(self.along))
        angle = torch.linspace(0, 2 * math.pi, points, dtype=torch.float64)[:, None]
        about = angle.cos() * first + angle.sin() * second
        rims = [self.support(about + end * self.along) for end in (1, -1)]
        quarters = (
            torch.stack([self.support(q + end * self.along) for end in (1, -1)])
            for q in (first, second, -first, -second)
        )
        return _with_gaps([*rims, *quarters])


class Polytope(Cornered, Solid):
    """A convex body with flat faces."""

    @abstractmethod
    def _places(self) -> tuple[tuple[float, ...], ...]:
        """The corners in m, in the body frame."""

    @cached_property
    def hull(self) -> Hull:
        """Its faces."""
        return convex_hull(self._places())

    def corners(self) -> Float[Tensor, "v 3"]:
        """The vertices."""
        return _points(self._places())

    def flats(self, direction: Float[Tensor, "*batch 3"]) -> tuple[Float[Tensor, "*batch f"], Float[Tensor, " f"]]:
        """Return cosines of a unit direction with the normals of faces, and their distances in m."""
        return direction @ self.hull.normals.mT, self.hull.heights

    def edges(self) -> Int[Tensor, "e 2"]:
        """Pairs of corners of two faces."""
        touches = self.hull.touches.double()
        return (touches.mT @ touches).triu(1).ge(2).nonzero()

    @cached_property
    def _spheres(self) -> tuple[Float[Tensor, "v 3"], bool]:
        """Centres of spheres of radius 1 that are nearest to touching all faces of a corner, and whether they do."""
        n, touches = self.hull.normals, self.hull.touches.mT.double()
        squares = torch.einsum("vf,fi,fj->vij", touches, n, n)
        centres = -torch.linalg.solve(squares, touches @ n)
        return centres, bool((touches * (centres @ n.mT + 1)).abs().max() < _TOUCHING)

    def arc_centres(self) -> Float[Tensor, "v 3"]:
        """Spheres that touch the faces of a corner, or are nearest to it."""
        return self._spheres[0]

    def largest_corner(self) -> float:
        """Largest radius; 0 where no sphere touches all faces of some corner."""
        return super().largest_corner() if self._spheres[1] else 0.0

    def gyration_squared(self) -> Float[Tensor, "3"]:
        """I/m by the tetrahedra from the origin to the triangles of its faces; the rounding is left out.

        Raises:
            DataError: the centroid is not at the origin, or the body's axes are not principal.
        """
        centroid, second = self.uniform()
        if centroid.abs().max() > _ROUNDED * self.corners().abs().max():
            raise _off_centroid(f"a polyhedron {_CENTRED}", centroid)
        products = second - torch.diag(second.diagonal())
        if products.abs().max() > _OFF * second.trace():
            turn = ", ".join(f"{x:.9g}" for x in _principal_turn(second).tolist())
            raise DataError(
                "the axes of a polyhedron of uniform density must be principal axes, and these are turned against them "
                f"by the quaternion ({turn}): state data.shape.turn=[{turn}], and give poses of those axes"
            )
        return second.trace() - second.diagonal()

    def uniform(self) -> tuple[Float[Tensor, "3"], Float[Tensor, "3 3"]]:
        """Return the centroid in m, and ∫ x xᵀ / V in m² about it."""
        corners = self.corners()
        inside = corners.mean(0)
        off, second = _uniform((corners - inside)[self.hull.triangles])
        return inside + off, second - torch.outer(off, off)

    def outline(self, points: int = 181) -> Float[Tensor, "lines 3"]:
        """Return the border of each face, closed, with a gap (nan) behind it."""
        lines = list[Tensor]()
        for normal, on in zip(self.hull.normals, self.hull.touches, strict=True):
            flat = self.corners()[on] + self.corner * (self.arc_centres()[on] + normal)
            first, *_ = about = flat - flat.mean(0)
            angle = torch.atan2(about @ torch.linalg.cross(normal, first), about @ first)
            border = flat[angle.argsort()]
            lines.append(torch.cat((border, border[:1])))
        return _with_gaps(lines)


@dataclass(frozen=True)
class Polyhedron(Polytope):
    """Convex hull of `vertices` [V, 3] in m, in the body frame, in any order; it keeps those of the hull."""

    vertices: tuple[tuple[float, float, float], ...]
    corner: float = 0.0

    def __post_init__(self) -> None:
        given = _triples(self.vertices)
        object.__setattr__(self, "vertices", tuple(given[k] for k in convex_hull(given).corners.tolist()))
        if self.hull.heights.min() <= 0:
            raise _off_centroid(_INSIDE, self.uniform()[0])
        object.__setattr__(self, "corner", finite_number("corner", self.corner, 0))
        if self.corner and self.corner > (largest := self.largest_corner()):
            raise DataError(
                f"spheres of the corners must fit into the faces of a polyhedron, at most {largest:.4g} m, got corner="
                f"{self.corner:g}" + ("" if largest else "; some corner's faces touch no common sphere")
            )

    def _places(self) -> tuple[tuple[float, ...], ...]:
        return self.vertices


@dataclass(frozen=True)
class Cuboid(Polytope):
    """Cuboid with `half` sides (a, b, c) in m along the body's axes; edges and corners are rounded by `corner` in m."""

    half: tuple[float, float, float]
    corner: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "half", _lengths("half", self.half, 3))
        object.__setattr__(self, "corner", finite_number("corner", self.corner, 0))
        if self.corner > min(self.half):
            raise DataError(f"corners of a box have at most the least of its half sides as radius, got {self.corner:g}")

    def _places(self) -> tuple[tuple[float, ...], ...]:
        return tuple(itertools.product(*((x, -x) for x in self.half)))


def polyhedron(
    vertices: Sequence[Sequence[float]] | None = None,
    corner: float = 0.0,
    *,
    file: str | None = None,
    scale: float = 1.0,
    centre: Sequence[float] = (0.0, 0.0, 0.0),
    turn: Sequence[float] = (1.0, 0.0, 0.0, 0.0),
) -> Polyhedron:
    """Make a polyhedron from vertices, or from those of a mesh.

    Args:
        vertices: in m.
        corner: radius in m.
        file: .obj or .stl, in place of the vertices.
        scale: metres in the unit of vertices or file.
        centre: of mass in m, in the axes of vertices or file.
        turn: quaternion of the body's axes in those.

    Raises:
        DataError: not one of vertices and file, or an impossible entry.
    """
    if (vertices is None) == (file is None):
        raise DataError("a polyhedron takes vertices, [[x, y, z], …], or the file of a mesh: one of them")
    points = torch.tensor(_triples(vertices if file is None else mesh_points(file)), dtype=torch.float64)
    size, middle = finite_number("scale", scale, 0, above=True), torch.tensor(_triples([centre]), dtype=torch.float64)
    try:
        quaternion = torch.tensor(turn, dtype=torch.float64).reshape(4)
    except (TypeError, ValueError, RuntimeError):
        quaternion = torch.zeros(4, dtype=torch.float64)
    if not abs(quaternion.norm() - 1) < _UNIT:
        raise DataError(f"turn of a polyhedron is a quaternion [w, x, y, z] of length 1, got {turn!r}")
    placed = (size * points - middle) @ rotation(quaternion)
    return Polyhedron(tuple((x, y, z) for x, y, z in placed.tolist()), corner)


def _principal_turn(second: Float[Tensor, "3 3"]) -> Float[Tensor, "4"]:
    """Quaternion of the principal axes of a body that are nearest to its own."""
    from scipy.spatial.transform import Rotation  # SciPy takes long to load

    axes = torch.linalg.eigh(second).eigenvectors
    axes = max((axes[:, list(k)] for k in itertools.permutations(range(3))), key=lambda one: one.diagonal().abs().sum())
    axes = axes * axes.diagonal().sign()
    axes[:, 2] *= torch.linalg.det(axes).sign()
    return torch.from_numpy(Rotation.from_matrix(axes.numpy()).as_quat(scalar_first=True))


KINDS: dict[str, type[Ellipse | Polygon | Disc | Ellipsoid | Sphere | Cylinder | Cuboid | Polyhedron]] = {
    **{"ellipse": Ellipse, "polygon": Polygon, "disc": Disc},
    **{"ellipsoid": Ellipsoid, "sphere": Sphere, "cylinder": Cylinder, "cuboid": Cuboid, "polyhedron": Polyhedron},
}


_SAME_KIND = {"circle": "disc", "ball": "sphere", "box": "cuboid", "cube": "cuboid", "square": "rectangle"}
"""Other words for a kind."""
_SIDES = ("sides", "side", "size", "edges", "edge")
_EDGES = ("width", "height", "depth")
_HALVES = {"diameter": "radius", "length": "half_length", "height": "half_length"}


def _spelled(kind: str, entries: Mapping[str, Any]) -> tuple[str, dict[str, Any]]:
    """The kind and fields of a body in other words: full lengths, a diameter, a rectangle; others as they are.

    `sides: [0.1, 0.05]` or `width: 0.1, height: 0.05` are those of a rectangle, `side: 0.1` of a square or cube.  A box
    of two sides is a rectangle.
    """
    own, regular = dict(entries), kind in ("square", "cube")
    kind = _SAME_KIND.get(kind, kind)
    takes = signature(KINDS[kind]).parameters if kind in KINDS else ()
    for whole, half in _HALVES.items():
        if half in takes and whole in own and half not in own:
            own[half] = finite_number(whole, own.pop(whole), 0, above=True) / 2
    if kind not in ("cuboid", "rectangle") or (kind == "cuboid" and "half" in own):
        return kind, own
    name = next((name for name in ("half", *_SIDES) if name in own), "sides")
    stated: Any = own.pop(name) if name in own else [own.pop(edge) for edge in _EDGES if edge in own]
    sides: list[Any] = [*stated] if isinstance(stated, Sequence) and not isinstance(stated, str) else [stated]
    count = 2 if kind == "rectangle" or len(sides) == 2 else 3
    if not sides:
        raise DataError(f"a {kind} takes sides, its {count} lengths in m; got {', '.join(own) or 'nothing'}")
    lengths = _lengths(name, sides * count if regular and len(sides) == 1 else sides, count)
    a, b, *c = (length if name == "half" else length / 2 for length in lengths)
    if c:
        return kind, {**own, "half": [a, b, *c]}
    return "polygon", {**own, "vertices": [[a, b], [-a, b], [-a, -b], [a, -b]]}


def require_dimension(source: str, shape: Shape | None, space: Space) -> None:
    """Refuse the shape of a body in the plane for one in space, and the other way round.

    Raises:
        DataError: naming it.
    """
    if shape is not None and isinstance(shape, Solid) != (space is SPACE):
        if isinstance(shape, Sphere):
            raise DataError(
                f"{source}: a sphere is a body in space, whose tables have quaternions or no orientation at all; for "
                f"impacts in a plane write {{kind: disc, radius: {shape.radius:g}}}, and data.inertia: that of a solid "
                f"ball is {0.4 * shape.radius**2:.3g} m² (2/5 r²) times its mass, a disc's is 1/2 m r²"
            )
        rule = f"{source}: a body in {'space' if space is SPACE else 'a plane'} has the shape of one"
        raise DataError(
            f"{rule}, got {shape}; cuboid, cylinder, ellipsoid, polyhedron, sphere are of space, other kinds of the "
            "plane"
        )


def make_shape(spec: Mapping[str, Any] | Shape | None) -> Shape | None:
    """Shape from `{kind: ellipse, semi_axes: [a, b]}`, another kind with its fields, as of `polyhedron`, or None.

    A rectangle, square, circle, box, cube or ball is what its sides, radius or diameter say.

    Raises:
        DataError: a missing, unknown or impossible entry.
        UnknownNameError: a kind that does not exist.
    """
    if spec is None or isinstance(spec, tuple(KINDS.values())):
        return spec
    if not isinstance(spec, Mapping):
        raise DataError(f"a shape is given as {{kind: ellipse, semi_axes: [a, b]}}, got {spec!r}")
    entries = {key: one for key, one in spec.items() if key != "kind"}
    if any(isinstance(value, Mapping) for value in entries.values()):
        raise DataError(f"one shape is needed here, {{kind: …}}, for all; got one for each of {', '.join(spec)}")
    if "kind" not in spec:
        takes = {name: signature(kind).parameters for name, kind in KINDS.items()}
        needs = {name: {key for key, one in takes[name].items() if one.default is one.empty} for name in KINDS}
        fitting = [name for name in KINDS if needs[name] <= {*entries} <= {*takes[name]}]
        kinds, given = fitting or [*KINDS], ", ".join(f"{key}: {value}" for key, value in entries.items())
        raise DataError(
            f"a shape needs its kind: add kind: {' or '.join(kinds)}, as in data.shape.kind={kinds[0]}; "
            f"got {given or 'nothing'}"
        )
    kind, entries = _spelled(str(spec["kind"]), entries)
    if kind not in KINDS:
        raise UnknownNameError("shape kind", kind, (*KINDS, "rectangle", *_SAME_KIND))
    make = polyhedron if kind == "polyhedron" else KINDS[kind]
    try:
        return make(**{key: _plain(value) for key, value in entries.items()})
    except TypeError:
        wanted = ", ".join(signature(make).parameters)
        raise DataError(f"shape {kind!r} takes {wanted}; got {', '.join(map(str, entries)) or 'nothing'}") from None


def shape_entries(shape: Shape | None) -> dict[str, Any] | None:
    """The entries from which `make_shape` makes the same shape, as plain values for a file."""
    if shape is None:
        return None
    if not isinstance(shape, tuple(KINDS.values())):
        raise DataError(f"a shape in a file is one of {', '.join(KINDS)}, got {shape!r}")
    kind = next(name for name, kind in KINDS.items() if type(shape) is kind)
    return {"kind": kind, **{f.name: value for f in fields(shape) if (value := getattr(shape, f.name)) != 0}}


def scaled(shape: Shape, factor: float) -> Shape:
    """Return the shape with every length multiplied by a factor."""
    entries = {key: value for key, value in (shape_entries(shape) or {}).items() if key != "kind"}
    lengths = {
        key: value if isinstance(value, str) else (factor * torch.tensor(value, dtype=torch.float64)).tolist()
        for key, value in entries.items()
    }
    return type(shape)(**{key: _plain(value) for key, value in lengths.items()})


@lru_cache(maxsize=64)
def _points(vertices: tuple[tuple[float, ...], ...]) -> Float[Tensor, "v d"]:
    """Vertices as a tensor, which is not to be changed."""
    return torch.tensor(vertices, dtype=torch.float64)


def _with_gaps(lines: Sequence[Float[Tensor, "_ 3"]]) -> Float[Tensor, "all 3"]:
    """Lines behind each other, with a gap (nan) behind each."""
    return torch.cat([torch.cat((line, torch.full_like(line[:1], torch.nan))) for line in lines])


def _plain(value: Any) -> Any:
    return (
        tuple(_plain(item) for item in value) if isinstance(value, Sequence) and not isinstance(value, str) else value
    )


def _triples(vertices: Any) -> tuple[tuple[float, float, float], ...]:
    found = list[tuple[float, float, float]]()
    for one in vertices if isinstance(vertices, Sequence) else [vertices]:
        try:
            x, y, z = map(float, one)
        except (TypeError, ValueError):
            x = y = z = math.nan
        if not math.isfinite(x + y + z):
            raise DataError(f"a point of a polyhedron is three finite numbers, [x, y, z] in metres, got {one!r}")
        found.append((x, y, z))
    return tuple(found)


def _lengths(name: str, values: Sequence[float], count: int) -> tuple[float, ...]:
    try:
        lengths = tuple(float(value) for value in values)
    except (TypeError, ValueError):
        raise DataError(f"{name} must be {count} number(s) in metres, got {values!r}") from None
    if len(lengths) != count or not all(0 < length < math.inf for length in lengths):
        raise DataError(f"{name} must be {count} positive number(s) in metres, got {values!r}")
    return lengths
