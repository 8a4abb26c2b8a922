"""What can be hidden in a set, and the state of the impacts that it acts on.

A `State` maps names to arrays by trial: velocities before (`vx`, `vy`, `omega`), place (`x`, `theta`), the arm (`rx`,
`ry`), `mass`, `inertia`, the number of the `order`, and what no table has (`u1`, `time`).  The simulation adds the
approach in the contact's axes (`vt`, `vn`), the parameters `mu` and `eps` and W, and in the end the impulse.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

State = dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class Effect:
    """Hooks, in the order in which they act; None where it does not.

    `before` changes the true state, and the recorded one where that shows.  `law` changes μ and ε.  `impulse` and
    `moment` change P and add an impulse of torque.  `after` changes the velocities before they are measured.
    `instrument` changes the numbers that are written down.
    """

    what: str
    before: Callable[[State, State], None] | None = None
    law: Callable[[State], None] | None = None
    impulse: Callable[[State, Any, Any], tuple[Any, Any]] | None = None
    moment: Callable[[State], Any] | None = None
    after: Callable[[State, State], None] | None = None
    instrument: Callable[[State], None] | None = None
