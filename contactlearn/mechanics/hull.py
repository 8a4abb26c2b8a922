"""Convex hulls of points in space: their faces, and points from files of meshes.

A face is all triangles of the hull in one plane.  Source of the hull: Barber, Dobkin & Huhdanpaa (1996), Qhull.
"""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from contactlearn.core.errors import DataError

_FLAT = 1e-8  # 1 − cos of the angle between triangles of one face, which single precision bends
_THIN = 1e-6  # thickness of a body over its length, at least
_MAX_CORNERS = 1000  # corners: contact points are sought among all of them
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


@dataclass(frozen=True, eq=False, kw_only=True)
class Hull:
    """The convex hull of V points.

    Args:
        corners: numbers of the points that are no others' mean, in their order.
        triangles: that cover it, as numbers of points.
        normals: of its faces, outwards.
        heights: of the faces above the origin in m.
        touches: whether a point is a corner of a face.
    """

    corners: Int[Tensor, " k"]
    triangles: Int[Tensor, "t 3"]
    normals: Float[Tensor, "f 3"]
    heights: Float[Tensor, " f"]
    touches: Bool[Tensor, "f v"]


@lru_cache(maxsize=64)
def convex_hull(points: tuple[tuple[float, ...], ...]) -> Hull:
    """Find the convex hull of points in m.

    Raises:
        DataError: fewer than four, all in a plane, or too many corners.
    """
    from scipy.spatial import ConvexHull  # SciPy takes long to load

    if len(points) < 4:
        raise DataError(f"a polyhedron needs at least 4 vertices, got {len(points)}")
    places = np.array(points, dtype=np.float64)
    width = np.linalg.svd(places - places.mean(0), compute_uv=False)
    if not width[2] > _THIN * width[0]:
        raise DataError(f"the vertices of a polyhedron must not be all in a plane, got {len(points)} that are")
    found = ConvexHull(places)
    if len(found.vertices) > _MAX_CORNERS:
        raise DataError(
            f"a polyhedron has at most {_MAX_CORNERS} corners, got {len(found.vertices)}; simplify the mesh"
        )
    normals = found.equations[:, :3]
    first, face = np.unique((normals @ normals.T > 1 - _FLAT).argmax(1), return_inverse=True)
    touches = np.zeros((len(first), len(points)), dtype=np.bool_)
    touches[face[:, None], found.simplices] = True
    return Hull(
        corners=torch.from_numpy(np.sort(found.vertices)).long(),
        triangles=torch.from_numpy(found.simplices).long(),
        normals=torch.from_numpy(normals[first]),
        heights=torch.from_numpy(-found.equations[first, 3]),
        touches=torch.from_numpy(touches),
    )


def mesh_points(file: str | Path) -> tuple[tuple[float, ...], ...]:
    """Read the vertices of a Wavefront OBJ or an STL file, text or binary, each once.

    Raises:
        DataError: another kind of file, one that cannot be read, or a vertex that is not three finite numbers.
    """
    path = Path(file)
    kind = path.suffix.lower()
    if kind not in (".obj", ".stl"):
        raise DataError(f"a mesh is an .obj or .stl file, got {path}; export it as one of them, or state vertices")
    try:
        data = path.read_bytes()
    except OSError as error:
        raise DataError(f"the mesh {path} cannot be read: {error.strerror}; check data.shape.file") from None
    if kind == ".stl" and len(data) == 84 + _FACET.itemsize * int.from_bytes(data[80:84], "little"):
        rows = np.frombuffer(data, _FACET, offset=84)["corners"].reshape(-1, 3).tolist()
        return tuple(dict.fromkeys(map(tuple, rows)))
    word, found = "v" if kind == ".obj" else "vertex", dict[tuple[float, ...], None]()
    for number, line in enumerate(data.decode(errors="replace").splitlines(), 1):
        if (words := line.split())[:1] == [word]:
            try:
                x, y, z = map(float, words[1:4])
            except ValueError:
                raise DataError(f"{path}: line {number}: a vertex is three numbers, got {line.strip()!r}") from None
            found[x, y, z] = None
    if not found:
        raise DataError(f"{path} has no vertices; is it a {kind[1:].upper()} file?")
    return tuple(found)


def signed_areas(cells: Float[np.ndarray, "n 4 2"]) -> Float[np.ndarray, " n"]:
    """Return the areas of quadrilaterals, positive where the corners run counter-clockwise."""
    across, up = cells[:, 2] - cells[:, 0], cells[:, 3] - cells[:, 1]
    return 0.5 * (across[:, 0] * up[:, 1] - across[:, 1] * up[:, 0])
