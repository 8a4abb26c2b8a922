"""Convex bodies on a flat floor, in the plane and in space: where they touch it, and how hard they are to turn.

`contact_point` is the body's lowest point at orientation θ, in space at a quaternion, relative to the centre of mass
and in world axes: r [..., d] in metres, its last component < 0, differentiable in the orientation and in the body's
scale (a polygon's and a box's, between the jumps from corner to corner).  `gyration_squared` is I/m of the body if its
density is uniform.  Shapes are plain values; `None` stands for an unknown shape.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import torch
from jaxtyping import Float, Int
from torch import Tensor

from contactlearn.core.errors import DataError, UnknownNameError
from contactlearn.core.numerics import finite_number
from contactlearn.mechanics.rigid_body import matvec, rotate, rotation
from contactlearn.mechanics.space import SPACE, Space


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
) -> Float[Tensor, "..."]:
    """Lowest point r [..., d] in m at orientation θ [...] in rad, in space at a quaternion [..., 4].

    The body may be stretched by `scale` along its own x and y (and z) axes: the farthest point of S K in the
    direction d is S times that of K in the direction S d.
    """
    if isinstance(shape, Solid):
        R = rotation(theta)
        s = torch.stack(torch.broadcast_tensors(*(R.new_ones(()) * one for one in (*scale, 1.0)[:3])), -1)
        return matvec(R, s * shape.support(-R[..., 2, :] * s))
    s_x, s_y, *_ = scale
    down = torch.stack((-theta.sin() * s_x, -theta.cos() * s_y), -1)  # world −y in the body frame, times S
    x, y = shape.support(down).unbind(-1)
    return rotate(torch.stack((s_x * x, s_y * y), -1), theta)


@dataclass(frozen=True)
class Ellipse:
    """Ellipse with `semi_axes` (a, b) in m along the body's x and y axes."""

    semi_axes: tuple[float, float]

    def __post_init__(self) -> None:
        object.__setattr__(self, "semi_axes", _lengths("semi_axes", self.semi_axes, 2))

    def support(self, direction: Float[Tensor, "*batch 2"]) -> Float[Tensor, "*batch 2"]:
        """(a² d_x, b² d_y) / √(a² d_x² + b² d_y²)."""
        a, b = self.semi_axes
        d_x, d_y = direction.unbind(-1)
        height = torch.sqrt((a * d_x) ** 2 + (b * d_y) ** 2)
        return torch.stack((a**2 * d_x / height, b**2 * d_y / height), -1)

    def gyration_squared(self) -> float:
        """ρ² = (a² + b²) / 4."""
        return (self.semi_axes[0] ** 2 + self.semi_axes[1] ** 2) / 4

    def outline(self, points: int = 181) -> Float[Tensor, "points 2"]:
        """Boundary at equal steps of the eccentric angle, closed."""
        angle = torch.linspace(0, 2 * math.pi, points, dtype=torch.float64)
        return torch.stack((self.semi_axes[0] * angle.cos(), self.semi_axes[1] * angle.sin()), -1)


@dataclass(frozen=True)
class Disc:
    """Disc of `radius` in m about its centre of mass."""

    radius: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", _lengths("radius", [self.radius], 1)[0])

    def support(self, direction: Float[Tensor, "*batch 2"]) -> Float[Tensor, "*batch 2"]:
        """The radius along d."""
        return self.radius * direction / direction.norm(dim=-1, keepdim=True)

    def gyration_squared(self) -> float:
        """ρ² = R² / 2."""
        return self.radius**2 / 2

    def outline(self, points: int = 181) -> Float[Tensor, "points 2"]:
        """Boundary at equal steps of the angle, closed."""
        return Ellipse((self.radius, self.radius)).outline(points)


@dataclass(frozen=True)
class Polygon:
    """Convex polygon with `vertices` [V, 2] in m, in the body frame, in order around the body.

    Its corners are arcs of radius `corner` in m within their two sides, whose lines meet in the vertices.  On a flat
    side both ends are lowest; the contact point is then the first of them in the given order, so r jumps there, as it
    does for the real body.
    """

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
        # Seen from the centre of mass the outline goes around once: not for a star, nor for a centre outside.
        around = sum(
            math.atan2(x0 * y1 - y0 * x1, x0 * x1 + y0 * y1)
            for (x0, y0), (x1, y1) in zip(corners, corners[1:] + corners[:1], strict=True)
        )
        if len(turns) != 1 or abs(abs(around) - 2 * math.pi) > 1e-6:
            raise DataError(
                "a polygon must be convex, with its vertices in order around the body and its centre of mass, "
                f"the origin, inside; got {corners}"
            )
        object.__setattr__(self, "vertices", corners)
        object.__setattr__(self, "corner", finite_number("corner", self.corner, 0))
        if self.corner > (largest := self.largest_corner()):
            raise DataError(
                f"arcs of the corners must fit into the sides of a polygon, at most {largest:.4g} m, got corner="
                f"{self.corner:g}"
            )

    def largest_corner(self) -> float:
        """Largest radius in m at which the arcs of two neighbouring corners do not overlap."""
        corners, cut = torch.tensor(self.vertices, dtype=torch.float64), self.arc_centres()
        reach = (cut.square().sum(-1) - 1).clamp_min(0).sqrt()  # of an arc along its sides, at radius 1
        return ((corners.roll(-1, 0) - corners).norm(dim=-1) / (reach + reach.roll(-1, 0))).min().item()

    def arc_centres(self) -> Float[Tensor, "vertices 2"]:
        """From each vertex to the centre of its arc, of radius 1: −(a + b)/(1 + a·b) of its sides' outward normals."""
        corners = torch.tensor(self.vertices, dtype=torch.float64)
        x, y = (corners.roll(-1, 0) - corners).unbind(-1)
        around = (corners[:, 0] * y - corners[:, 1] * x).sum().sign()  # 1 if counter-clockwise
        after = around * torch.stack((y, -x), -1) / torch.hypot(x, y)[:, None]  # of the side that begins at a vertex
        before = after.roll(1, 0)
        return -(before + after) / (1 + (before * after).sum(-1, keepdim=True))

    def facing(self, direction: Float[Tensor, "*batch 2"]) -> Int[Tensor, "*batch"]:
        """The vertex of the greatest d · p, the first of equals, by its number."""
        return (direction @ _like(direction, self.vertices).T).argmax(-1)

    def support(self, direction: Float[Tensor, "*batch 2"]) -> Float[Tensor, "*batch 2"]:
        """The vertex that faces d, or the point of its arc with the normal d."""
        corners, lowest = _like(direction, self.vertices), self.facing(direction)
        return corners[lowest] + self.rounding(lowest, direction, self.corner) if self.corner else corners[lowest]

    def rounding(
        self, vertex: Int[Tensor, "*batch"], direction: Float[Tensor, "*batch 2"], radius: Tensor | float
    ) -> Float[Tensor, "*batch 2"]:
        """From vertices to the points of arcs of a radius in m that have these normals, in the body frame."""
        arcs = self.arc_centres().to(direction)[vertex] + direction / direction.norm(dim=-1, keepdim=True)
        return (arcs.new_ones(()) * radius)[..., None] * arcs

    def lowest_corners(self, theta: Float[Tensor, " n"]) -> tuple[Float[Tensor, "n 2"], Float[Tensor, "n 2"]]:
        """The lowest corner and the next at orientations θ [N] in rad, from the centre of mass in world axes, m."""
        sharp = torch.tensor(self.vertices, dtype=theta.dtype, device=theta.device)
        down, every = torch.stack((-theta.sin(), -theta.cos()), -1)[:, None], torch.arange(len(sharp))
        corners = rotate(sharp + self.rounding(every, down, self.corner), theta[:, None])
        every = torch.arange(len(theta), device=theta.device)
        first, second = corners[..., 1].topk(2, largest=False).indices.unbind(-1)
        return corners[every, first], corners[every, second]

    def gyration_squared(self) -> float:
        """ρ² = Σ A_k (|p|² + p·q + |q|²) / (6 Σ A_k) over the triangles from the origin to each side (p, q).

        Raises:
            DataError: the centroid is not at the origin, so the density cannot be uniform.
        """
        p = self.outline()[:-1]
        q = p.roll(-1, 0)
        share = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
        share = share / share.sum()  # of each triangle in the area
        centroid = share @ (p + q) / 3
        if centroid.abs().max() > (1e-4 if self.corner else 1e-6) * p.abs().max():  # arcs are chords here
            x, y = centroid.tolist()
            raise DataError(
                "a polygon of uniform density has its centre of mass, the origin, at its centroid, but that is at "
                f"({x:.9g}, {y:.9g}) m: subtract it from every vertex"
            )
        return float(share @ (p * p + p * q + q * q).sum(1)) / 6

    def outline(self, points: int = 181) -> Float[Tensor, "points 2"]:
        """The vertices, and the first again; round corners at equal angles."""
        if not self.corner:
            return torch.tensor((*self.vertices, self.vertices[0]), dtype=torch.float64)
        angle = torch.linspace(0, 2 * math.pi, points, dtype=torch.float64)
        return self.support(torch.stack((angle.cos(), angle.sin()), -1))


_BESIDE = 1e-9  # of a direction, to either side of a plane of the body's axes


class Solid(ABC):
    """A convex body in space, whose support and gyration have three components."""

    @abstractmethod
    def support(self, direction: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        """Return the farthest point [..., 3] in m in a direction [..., 3], both in the body frame."""

    @abstractmethod
    def gyration_squared(self) -> Float[Tensor, "3"]:
        """Return I/m [3] in m² about the body's axes, at uniform density."""

    def outline(self, points: int = 181) -> Float[Tensor, "lines 3"]:
        """Return two closed lines about each axis, with a gap (nan) behind each: edges of a cuboid, else circles."""
        x, y = Disc(1.0).outline(points).unbind(-1)
        about = [torch.stack((x, y, torch.full_like(x, side)), -1) for side in (-_BESIDE, _BESIDE)]
        lines = [self.support(one.roll(axis, -1)) for axis in range(3) for one in about]
        return torch.cat([torch.cat((line, torch.full_like(line[:1], torch.nan))) for line in lines])


@dataclass(frozen=True)
class Ellipsoid(Solid):
    """Ellipsoid with `semi_axes` (a, b, c) in m along the body's axes."""

    semi_axes: tuple[float, float, float]

    def __post_init__(self) -> None:
        object.__setattr__(self, "semi_axes", _lengths("semi_axes", self.semi_axes, 3))

    def support(self, direction: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        """A² d / |A d|, A = diag(a, b, c)."""
        axes = _like(direction, self.semi_axes)
        scaled = axes * direction
        return axes * scaled / scaled.norm(dim=-1, keepdim=True)

    def gyration_squared(self) -> Float[Tensor, "3"]:
        """(b² + c²)/5 and so on."""
        squares = torch.tensor(self.semi_axes, dtype=torch.float64).square()
        return (squares.sum() - squares) / 5


@dataclass(frozen=True)
class Sphere(Solid):
    """Ball of `radius` in m about its centre of mass."""

    radius: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", _lengths("radius", [self.radius], 1)[0])

    def support(self, direction: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        """The radius along d."""
        return self.radius * direction / direction.norm(dim=-1, keepdim=True)

    def gyration_squared(self) -> Float[Tensor, "3"]:
        """ρ² = 2 R²/5 about every axis."""
        return torch.full((3,), 0.4 * self.radius**2, dtype=torch.float64)


@dataclass(frozen=True)
class Cuboid(Solid):
    """Cuboid with `half` sides (a, b, c) in m along the body's axes; edges and corners are rounded by `corner` in m."""

    half: tuple[float, float, float]
    corner: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "half", _lengths("half", self.half, 3))
        object.__setattr__(self, "corner", finite_number("corner", self.corner, 0))
        if self.corner > min(self.half):
            raise DataError(f"corners of a box have at most the least of its half sides as radius, got {self.corner:g}")

    def facing(self, direction: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        """Corner in a direction, by its signs."""
        return torch.where(direction < 0, -1.0, 1.0).to(direction)

    def support(self, direction: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        """The corner of the greatest d · p, or the point of its rounding with the normal d."""
        signs = self.facing(direction)
        sharp = _like(direction, self.half) * signs
        return sharp + self.rounding(signs, direction, self.corner) if self.corner else sharp

    def rounding(
        self, corner: Float[Tensor, "*batch 3"], direction: Float[Tensor, "*batch 3"], radius: Tensor | float
    ) -> Float[Tensor, "*#batch 3"]:
        """From corners to the points of spheres of a radius in m, within the sides, that have these normals."""
        spheres = direction / direction.norm(dim=-1, keepdim=True) - corner
        return (spheres.new_ones(()) * radius)[..., None] * spheres

    def gyration_squared(self) -> Float[Tensor, "3"]:
        """(b² + c²)/3 and so on; the rounding is left out."""
        squares = torch.tensor(self.half, dtype=torch.float64).square()
        return (squares.sum() - squares) / 3


KINDS: dict[str, type[Ellipse | Polygon | Disc | Ellipsoid | Sphere | Cuboid]] = {
    **{"ellipse": Ellipse, "polygon": Polygon, "disc": Disc},
    **{"ellipsoid": Ellipsoid, "sphere": Sphere, "cuboid": Cuboid},
}


def require_dimension(source: str, shape: Shape | None, space: Space) -> None:
    """Refuse the shape of a body in the plane for one in space, and the other way round.

    Raises:
        DataError: naming it.
    """
    if shape is not None and isinstance(shape, Solid) != (space is SPACE):
        rule = f"{source}: a body in {'space' if space is SPACE else 'a plane'} has the shape of one"
        raise DataError(f"{rule}, got {shape}; cuboid, ellipsoid, sphere are of space, other kinds of the plane")


def make_shape(spec: Mapping[str, Any] | Shape | None) -> Shape | None:
    """Shape from `{kind: ellipse, semi_axes: [a, b]}`, `polygon` with `vertices`, `disc` with `radius`, or None.

    Raises:
        DataError: a missing, unknown or impossible entry.
        UnknownNameError: a kind that does not exist.
    """
    if spec is None or isinstance(spec, tuple(KINDS.values())):
        return spec
    if not isinstance(spec, Mapping):
        raise DataError(f"a shape is given as {{kind: ellipse, semi_axes: [a, b]}}, got {spec!r}")
    entries = dict(spec)
    kind = str(entries.pop("kind", "none"))
    if kind not in KINDS:
        if any(isinstance(value, Mapping) for value in entries.values()):
            raise DataError(f"one shape is needed here, {{kind: …}}, for all; got one for each of {', '.join(spec)}")
        raise UnknownNameError("shape kind", kind, KINDS)
    try:
        return KINDS[kind](**{key: _plain(value) for key, value in entries.items()})
    except TypeError:
        wanted = ", ".join(KINDS[kind].__dataclass_fields__)
        raise DataError(f"shape {kind!r} takes {wanted}; got {', '.join(map(str, entries)) or 'nothing'}") from None


def shape_entries(shape: Shape | None) -> dict[str, Any] | None:
    """The entries from which `make_shape` makes the same shape, as plain values for a file."""
    if shape is None:
        return None
    if not isinstance(shape, tuple(KINDS.values())):
        raise DataError(f"a shape in a file is one of {', '.join(KINDS)}, got {shape!r}")
    kind = next(name for name, kind in KINDS.items() if type(shape) is kind)
    return {"kind": kind, **{name: value for name, value in vars(shape).items() if value != 0}}


def _like(tensor: Tensor, values: Any) -> Tensor:
    """Numbers of the type and on the device of a tensor."""
    return torch.tensor(values, dtype=tensor.dtype, device=tensor.device)


def _plain(value: Any) -> Any:
    return (
        tuple(_plain(item) for item in value) if isinstance(value, Sequence) and not isinstance(value, str) else value
    )


def _lengths(name: str, values: Sequence[float], count: int) -> tuple[float, ...]:
    try:
        lengths = tuple(float(value) for value in values)
    except (TypeError, ValueError):
        raise DataError(f"{name} must be {count} number(s) in metres, got {values!r}") from None
    if len(lengths) != count or not all(0 < length < math.inf for length in lengths):
        raise DataError(f"{name} must be {count} positive number(s) in metres, got {values!r}")
    return lengths
