"""Results about the scatter of the contact: what differs from impact to impact around the full model."""

from dataclasses import dataclass

from contactlearn.inference.identification.scatter import INSTRUMENT, StandardDeviation


@dataclass(frozen=True, kw_only=True)
class DeviationDependence:
    """A dependence of the deviations of a component of scatter, which is then no scatter.

    Args:
        component: name of the component.
        variable: symbols of the state, with ", periodically" where they are followed by a wave; `pose`, `heading`,
            `order`, `period`, or a quantity of earlier impacts.
        order: half periods over the range of the variable, periods of a wave, harmonic of an angle, or trials of a
            window or period.
        share: of the variance of the deviations that all tested functions of the variable explain (of a pose, those of
            this order), adjusted for their number; None of order and period, whose smooth course is not estimated.
        p_value: of independence, over everything that was tested.
    """

    component: str
    variable: str
    order: float
    share: float | None
    p_value: float


@dataclass(frozen=True, kw_only=True)
class ScatterComponent:
    """A component of the contact's scatter.

    Args:
        deviation: name, symbol, unit, standard deviation and its standard error.
        relative: standard deviation over the coefficient that deviates; None where that is no coefficient.
        share: of the law's error, its part of `ErrorShares.scatter` by its variance of the outcome.
        follows: share of its variance that follows something known of the impacts, and is no scatter; all of it where
            what it follows is not known well enough to take it away.
    """

    deviation: StandardDeviation
    relative: float | None
    share: float
    follows: float = 0.0


@dataclass(frozen=True, kw_only=True)
class ContactScatter:
    """What differs from impact to impact around the full model, at random as far as that can be tested.

    Args:
        components: of the contact; none where no scatter is seen.
        instrument: standard deviations of the instrument's noise, beside the stated noise where that is `stated`.
        stated: whether noise was stated, or the trials carry covariances.
        trials: of the estimate.
        bic: less that of no scatter; negative where scatter is wanted.
        confounded: pairs of components that the data do not tell apart.
        dependences: of the deviations on what is known of the impacts, the most significant first.
        converged: whether the estimate settled.
    """

    components: tuple[ScatterComponent, ...]
    instrument: tuple[StandardDeviation, ...]
    stated: bool
    trials: int
    bic: float
    confounded: tuple[tuple[str, str], ...]
    dependences: tuple[DeviationDependence, ...]
    converged: bool

    @property
    def seen(self) -> bool:
        """Whether contact or recorded pose differ from impact to impact by more than what follows something."""
        recorded = any(deviation.name not in INSTRUMENT for deviation in self.instrument)
        return recorded or any(component.follows < 1 for component in self.components)

    @property
    def random(self) -> bool:
        """Whether they do, and nothing that is known of the impacts explains any of it."""
        return self.seen and not self.dependences
