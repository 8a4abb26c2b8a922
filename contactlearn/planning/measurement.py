"""Planned drops carried out: settings are reached as well as the rig does it, and a laboratory measures the impacts."""

from collections.abc import Sequence
from typing import Protocol

import torch
from jaxtyping import Bool
from torch import Tensor

from contactlearn.core.errors import DataError
from contactlearn.data.blocks import joined
from contactlearn.mechanics.impacts import Impacts
from contactlearn.planning.result import PlannedDrop
from contactlearn.planning.rig import Rig, Specimen, states

_TRIES = 20  # of a drop that does not touch the floor clearly


class Measures(Protocol):
    """A laboratory: a simulator, or a program that drives an apparatus."""

    def measured(self, drops: Impacts, generator: torch.Generator) -> tuple[Impacts | None, Bool[Tensor, "n"]]:
        """Return impacts measured from true states before impact, in order, and which of the states made one."""
        ...


def carry_out(
    rig: Rig,
    drops: Sequence[PlannedDrop],
    specimens: Sequence[Specimen],
    laboratory: Measures,
    *,
    generator: torch.Generator,
    first: int = 1,
) -> Impacts:
    """Make planned drops and measure them; one that does not touch the floor clearly is made again, as a robot does.

    Args:
        rig: complete, see `Rig.completed`; what it does not set is drawn within its limits.
        drops: of a plan, or any others.
        specimens: the bodies by their names.
        laboratory: measures impacts.
        generator: of what the rig does not reach or set, and of the noise.
        first: number of the first impact in the sequence of all measurements, by which it is named.

    Raises:
        DataError: a drop of an unknown body, without a setting of the rig, or that never touches the floor.
    """
    numbers = {one.name: k for k, one in enumerate(specimens)}
    settable = [name for name, one in rig.limits.items() if one.settable]
    for row, drop in enumerate(drops, 1):
        if drop.body not in numbers:
            raise DataError(f"drop {row}: no body is called {drop.body!r}; there are {', '.join(numbers)}")
        if lacks := next((name for name in settable if name not in drop.settings), None):
            raise DataError(f"drop {row}: the plan must state {lacks}, which the rig sets")
    values = {name: torch.tensor([drop.settings[name] for drop in drops], dtype=torch.float64) for name in settable}
    body, order = torch.tensor([numbers[drop.body] for drop in drops]), torch.arange(len(drops)) + float(first)
    parts, rows, left = list[Impacts](), list[Tensor](), torch.arange(len(drops))
    for _ in range(_TRIES):
        reached = rig.reached({name: value[left] for name, value in values.items()}, generator)
        before, good = states(specimens, body[left], reached, generator)
        if before is not None:
            found, touched = laboratory.measured(before.replace(order=order[left[good]]), generator)
            good[good.clone()] = touched
            parts += [] if found is None else [found]
            rows.append(left[good])
        left = left[~good]
        if not len(left):
            break
    else:
        raise DataError(f"drop {int(left[0]) + 1}: its contact point does not approach the floor in {_TRIES} tries")
    names = [part.replace(trial=tuple(f"{int(k)}" for k in part.order.tolist())) for part in parts]
    return joined(names)[torch.cat(rows).argsort()]
