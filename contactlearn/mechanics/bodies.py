"""Bodies of a table: one shape of all of them, or a shape of each by its name.

`Impacts.shape` is a `Shape` where every body has the same, a mapping from the names of bodies (`Impacts.object`) to
shapes where they differ, or None where it is not known.  Values of each trial follow from it and from the number of the
trial's body (`Impacts.body`, `State.body`), in one pass over the few shapes that there are:

    contact_points(shape, body, theta)      contact points [..., N, d] of bodies at orientations [..., N], [..., N, 4]
    per_body(shape, body, value)         any other value of a trial that its body's shape gives
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any
from zlib import crc32

import torch
from jaxtyping import Float, Int
from torch import Tensor

from contactlearn.core.errors import ContactLearnError, DataError, suggest
from contactlearn.core.numerics import finite_number
from contactlearn.mechanics.shapes import Shape, contact_point, make_shape, shape_entries

_ROUNDING = 1e-9  # of moments of inertia that are as large as the sum of two others, as of a thin plate

AnyShape = Shape | Mapping[str, Shape]
"""The shape of every body, or shapes by the names of bodies."""


@dataclass(frozen=True, repr=False)
class Shapes(Mapping[str, Shape]):
    """Shapes by the names of bodies, as a mapping that stays as it is and can be compared and hashed."""

    pairs: tuple[tuple[str, Shape], ...]

    @classmethod
    def of(cls, shapes: Mapping[str, Shape]) -> "Shapes":
        """Return a copy of shapes by name."""
        return cls(tuple((str(name), shape) for name, shape in shapes.items()))

    def __getitem__(self, name: str) -> Shape:
        return dict(self.pairs)[name]

    def __iter__(self) -> Iterator[str]:
        return (name for name, _ in self.pairs)

    def __len__(self) -> int:
        return len(self.pairs)

    def __repr__(self) -> str:
        return repr(dict(self.pairs))


def per_body(
    shape: AnyShape, body: Int[Tensor, "*#batch n"] | None, value: Callable[[Shape], Float[Tensor, "... n k"]]
) -> Float[Tensor, "... n k"]:
    """Compute a value [..., N, K] of each trial from the shape of its body.

    Args:
        shape: one of all bodies, or by name.
        body: number of each trial's body [..., N], see `body_code`; of shapes by name it must be there.
        value: of all trials, if they had this shape.

    Raises:
        ContactLearnError: shapes by name, and nothing says which body a trial is of.
    """
    if not isinstance(shape, Mapping):
        return value(shape)
    if body is None:
        raise ContactLearnError("shapes by body need the body of each trial; give state.replace(body=…)")
    (_, first), *others = shape.items()
    found = value(first)
    for name, one in others:
        found = torch.where((body == body_code(name))[..., None], value(one), found)
    return found


def contact_points(
    shape: AnyShape, body: Int[Tensor, "*#batch n"] | None, theta: Float[Tensor, "..."]
) -> Float[Tensor, "*batch n d"]:
    """Contact point [..., N, d] in m of each trial at orientation θ [..., N] in rad, or quaternion [..., N, 4]."""
    return per_body(shape, body, lambda one: contact_point(one, theta))


def shapes_among(shape: AnyShape | None) -> dict[str, Shape]:
    """Return the shapes there are by the names of their bodies, one of all bodies under an empty name."""
    if shape is None:
        return {}
    return dict(shape) if isinstance(shape, Mapping) else {"": shape}


def body_code(name: str) -> int:
    """Return the number that stands for the name of a body, the same in every table."""
    return crc32(name.encode())


def numbered(names: Sequence[str]) -> Int[Tensor, "n"]:
    """Return the numbers [N] of names, counted from 0 in the order in which they appear."""
    numbers = {name: number for number, name in enumerate(dict.fromkeys(names))}
    return torch.tensor([numbers[name] for name in names])


@lru_cache(maxsize=16)
def body_codes(names: tuple[str, ...]) -> Int[Tensor, "n"]:
    """Return the numbers [N] of bodies by name."""
    return torch.tensor([body_code(name) for name in names])


def complete_shapes(shape: AnyShape | None, names: Sequence[str], source: str) -> Shape | Shapes | None:
    """Return a shape, or a copy of shapes by name; each body of the trials' `names` must have one.

    Raises:
        DataError: naming the first row (from 1) of a body without a shape.
    """
    if not isinstance(shape, Mapping):
        return shape
    lacking = next((name for name in dict.fromkeys(names) if name not in shape), None)
    if lacking is not None:
        row = names.index(lacking) + 1
        raise DataError(
            f"{source}: row {row}, column object: the body {lacking!r} must have a shape{suggest(lacking, shape)}; "
            f"data.shape has those of {', '.join(shape)}",
            row=row,
            column="object",
        )
    return Shapes.of(shape)


def check_body_names(shapes: Mapping[str, Shape], names: Collection[str], source: str) -> None:
    """Check that every shape belongs to a body of the table; a misspelt name would be ignored otherwise.

    Raises:
        DataError: naming the first of them.
    """
    for name in shapes:
        if name not in names:
            raise DataError(
                f"{source}: data.shape.{name} is of no body of the table{suggest(name, names)}; its column object has "
                f"{', '.join(names)}"
            )


def make_shapes(spec: Mapping[str, Any] | Shape | None) -> AnyShape | None:
    """Shape as `shapes.make_shape` takes it, or shapes by body: `{oak: {kind: ellipse, …}, beech: {kind: disc, …}}`.

    Raises:
        DataError: a missing, unknown or impossible entry, or a shape together with shapes by body.
        UnknownNameError: a kind that does not exist.
    """
    if not isinstance(spec, Mapping) or isinstance(spec, Shapes):
        return spec if isinstance(spec, Shapes) else make_shape(spec)
    entries = {str(name): entry for name, entry in spec.items()}
    named = [name for name, entry in entries.items() if isinstance(entry, Mapping) or hasattr(entry, "support")]
    if not named:
        return make_shape(spec)
    if others := [f"{name}: {entry}" for name, entry in entries.items() if name not in named]:
        raise DataError(
            "data.shape is one shape, {kind: …}, or one for each body, {oak: {kind: …}, beech: {kind: …}}; got "
            f"shapes of {', '.join(named)}, and also {', '.join(others)}"
        )
    return Shapes.of({name: _made(name, entry) for name, entry in entries.items()})


def _made(name: str, entry: Mapping[str, Any] | Shape) -> Shape:
    """The shape of a body by name, whose errors name it."""
    try:
        shape = make_shape(entry)
    except ContactLearnError as error:
        raise DataError(f"data.shape.{name}: {error}") from None
    assert shape is not None  # of an entry
    return shape


def shapes_entries(shape: AnyShape | None) -> dict[str, Any] | None:
    """The entries from which `make_shapes` makes the same, as plain values for a file."""
    if not isinstance(shape, Mapping):
        return shape_entries(shape)
    return {name: shape_entries(one) for name, one in shape.items()}


def principal_moments(inertia: float | Sequence[float]) -> Float[Tensor, "3"]:
    """Moments of inertia of a body in space in kg m², about its axes, as settings state them: one for all, or three.

    Raises:
        DataError: they are not three, not positive, or one is larger than the sum of the others.
    """
    moments = [*inertia] if isinstance(inertia, Sequence) and not isinstance(inertia, str) else [inertia] * 3
    if len(moments) != 3:
        raise DataError(f"data.inertia is one number in space, or three along the body's axes, got {inertia!r}")
    values = torch.tensor([finite_number("inertia", one, 0, above=True) for one in moments], dtype=torch.float64)
    if 2 * values.max() > values.sum() * (1 + _ROUNDING):
        raise DataError(
            f"data.inertia: a moment of inertia is at most the sum of the two others, got {values.tolist()}; state "
            "principal moments in kg m²"
        )
    return values
