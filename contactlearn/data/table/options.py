"""What settings state of a table, for the steps that restate and name its columns."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from torch import Tensor

from contactlearn.data.table.names import Recognised, impact_vocabulary, unit_in
from contactlearn.data.table.sheet import Sheet
from contactlearn.data.table.units import Units
from contactlearn.mechanics.bodies import AnyShape, shapes_among
from contactlearn.mechanics.shapes import Disc, Sphere
from contactlearn.mechanics.space import PLANE, SPACE


@dataclass(frozen=True, kw_only=True)
class TableOptions:
    """What settings state of a table.

    Args:
        units: of its columns.
        columns: its columns by ours, None where it has no such column.
        shape: of all bodies or of each by its name, where it is known.
        body: mass and inertia of every body in SI.
        asked: whether what the table leaves open, such as which end of a quaternion is its scalar, is refused.
        gaps: whether numbers may be missing, with which those made of them are missing, too.
    """

    units: Units
    columns: Mapping[str, str | None]
    shape: AnyShape | None = None
    body: Mapping[str, Tensor] = field(default_factory=dict[str, Tensor])
    asked: bool = True
    gaps: bool = False

    @property
    def chosen(self) -> set[str]:
        """Return the table's columns that settings name."""
        return {name for name in self.columns.values() if name is not None}

    @property
    def turning(self) -> bool:
        """Return whether contact points depend on the orientation, as they do unless all bodies are discs."""
        return self.shape is None or not all(
            isinstance(one, Disc | Sphere) for one in shapes_among(self.shape).values()
        )

    def names(self, cells: Sheet, known: Recognised) -> dict[str, str]:
        """Return the table's columns by ours, as settings say and otherwise their names."""
        stated = {ours: name for ours, name in self.columns.items() if name is not None and name in cells.columns}
        return {**known.names, **stated}

    def units_of(self, known: Recognised) -> Units:
        """Return the units that settings state, and those in the names of columns that are known or that they name."""
        vocabulary = {**impact_vocabulary(PLANE), **impact_vocabulary(SPACE)}
        named = {
            ours: unit for ours, name in self.columns.items() if name and (unit := unit_in(name, ours, vocabulary))
        }
        return Units(self.units.stated, {**known.units, **named})
