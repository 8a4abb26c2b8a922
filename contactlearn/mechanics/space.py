"""The spaces in which bodies move, and the only facts in which they differ for a table or a batch of impacts.

               plane                        space
    r          (r_x, r_y)                   (r_x, r_y, r_z)
    q          (x, y, θ)                    (x, y, z, q_w, q_x, q_y, q_z)   unit quaternion, body to world
    v          (v_x, v_y, ω)                (v_x, v_y, v_z, ω_x, ω_y, ω_z)
    wrench     (P_t, P_n, τ)                (P_x, P_y, P_z, τ_x, τ_y, τ_z)
    inertia    I                            three principal moments, about the axes of the body
    up         y                            z

So the normal is the last of the d components of a position, and a velocity has D = d + those of the spin.  A planar
body is one in space with x → x, y → z, ω → −ω_y.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement

from contactlearn.core.errors import ContactLearnError

_AXES = ("x", "y", "z")


@dataclass(frozen=True, kw_only=True)
class Space:
    """The plane or space, with the columns of a table file by the field of `Impacts` that they fill.

    Args:
        name: of the space.
        inertia: columns of the moments of inertia.
        position: of the contact point.
        pose: of the body.
        velocity: of the body.
        wrench: in predictions.
    """

    name: str
    inertia: tuple[str, ...]
    position: tuple[str, ...]
    pose: tuple[str, ...]
    velocity: tuple[str, ...]
    wrench: tuple[str, ...]

    @property
    def d(self) -> int:
        """Components of a position, of an impulse and of the velocity of the contact point."""
        return len(self.position)

    @property
    def D(self) -> int:
        """Components of a velocity and of a wrench."""
        return len(self.velocity)

    @cached_property
    def symbols(self) -> dict[str, str]:
        """Symbols of the components of a velocity with their units."""
        names = (name.replace("omega", "ω").replace("w", "ω_").replace("v", "v_") for name in self.velocity)
        return {name: "m/s" if name[0] == "v" else "rad/s" for name in names}

    @cached_property
    def components(self) -> dict[str, tuple[str, ...]]:
        """Columns by the field that they fill."""
        pose_post, post = (tuple(f"{name}_post" for name in names) for names in (self.pose, self.velocity))
        return {
            "mass": ("mass",), "inertia": self.inertia, "r": self.position, "q": self.pose,
            "v_pre": self.velocity, "v_post": post, "q_post": pose_post, "time": ("time",), "order": ("order",),
        }  # fmt: skip

    @cached_property
    def covariances(self) -> dict[str, tuple[str, ...]]:
        """Columns by the covariance that they fill: those of `upper`, row by row."""
        pairs = ["_".join(pair) for pair in combinations_with_replacement(self.velocity, 2)]
        return {
            f"v_{when}_cov": tuple(f"cov_{pair}{end}" for pair in pairs)
            for when, end in (("pre", ""), ("post", "_post"))
        }

    @cached_property
    def upper(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Rows and columns of the upper half of a covariance of the velocity."""
        rows, columns = zip(*combinations_with_replacement(range(len(self.velocity)), 2), strict=True)
        return rows, columns

    def __str__(self) -> str:
        return self.name


PLANE = Space(
    name="plane",
    inertia=("inertia",),
    position=("rx", "ry"),
    pose=("x", "y", "theta"),
    velocity=("vx", "vy", "omega"),
    wrench=("P_t", "P_n", "tau"),
)
SPACE = Space(
    name="space",
    inertia=tuple(f"inertia_{axis}" for axis in _AXES),
    position=tuple(f"r{axis}" for axis in _AXES),
    pose=(*_AXES, "qw", *(f"q{axis}" for axis in _AXES)),
    velocity=(*(f"v{axis}" for axis in _AXES), *(f"w{axis}" for axis in _AXES)),
    wrench=(*(f"P_{axis}" for axis in _AXES), *(f"tau_{axis}" for axis in _AXES)),
)
BOTH = (PLANE, SPACE)


def require_space(what: str, space: Space, spaces: Sequence[Space] = (PLANE,), hint: str = "") -> None:
    """Refuse what does not exist in a space, with a hint at what does.

    Raises:
        ContactLearnError: naming it.
    """
    if space not in spaces:
        own, other = ("in space", "in a plane") if space is SPACE else ("in a plane", "in space")
        raise ContactLearnError(f"{what} exists for bodies that move {other} alone, and these move {own}{hint}")
