"""Parameters that flight has measured, beside what the impacts alone say of them.

A fit goes no further than flight allows.  How far the impacts would go shows in the same fit without that limit.
"""

import math
from dataclasses import dataclass

from contactlearn.inference.identification.joint import JointFit
from contactlearn.mechanics.apparatus import REACH, Measured


@dataclass(frozen=True, kw_only=True)
class KnownParameter:
    """A fitted parameter that is also known without any impact.

    Args:
        name: `effect.parameter`.
        symbol: of the parameter.
        unit: of the numbers.
        value: fitted within what flight allows.
        alone: fitted to the impacts alone.
        flight: what is known without them.
    """

    name: str
    symbol: str
    unit: str
    value: float
    alone: Measured
    flight: Measured

    @property
    def contradicted(self) -> bool:
        """Whether impacts and flight are apart by more than their errors."""
        apart = abs(self.alone.value - self.flight.value)
        return apart > REACH * math.hypot(self.alone.error, self.flight.error)

    @property
    def more(self) -> bool:
        """Whether the impacts alone go beyond what flight allows, which is 0 and all up to three standard errors on."""
        low, high = self.flight.range
        return not low <= self.alone.value <= high

    @property
    def better_in_flight(self) -> bool:
        """Whether flight tells more of it than the impacts."""
        return not self.alone.error < self.flight.error


def known_parameters(fit: JointFit) -> tuple[KnownParameter, ...]:
    """Return the parameters of a single subset's fit whose range is what flight allows, beside the impacts alone."""
    if fit.alone is None:
        return ()
    alone = zip(fit.alone.values.tolist(), fit.alone.standard_errors.tolist(), strict=True)
    return tuple(
        KnownParameter(
            name=p.name,
            symbol=p.symbol,
            unit=p.unit,
            value=value,
            alone=Measured(value=there, error=error),
            flight=p.flight,
        )
        for p, value, (there, error) in zip(fit.parameters, fit.values.tolist(), alone, strict=True)
        if p.flight is not None
    )
