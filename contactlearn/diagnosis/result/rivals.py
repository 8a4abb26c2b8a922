"""Results of the discrimination: rivals of the missing effects, and drops that separate them."""

from dataclasses import dataclass

from contactlearn.effects import EffectId


@dataclass(frozen=True, kw_only=True)
class Rival:
    """An effect that explains these data as well as a missing one.

    `similarity` is the share R² of the missing effect's change of v_post that the rival reproduces to first order,
    `loss_difference` the rise of the held-out loss in nats a trial with the rival instead.
    """

    effect: EffectId
    similarity: float
    loss_difference: float
    standard_error: float


@dataclass(frozen=True, kw_only=True)
class Separation:
    """A missing effect and a rival, and the drops expected to decide between them; None if a thousand do not."""

    effect: EffectId
    rival: EffectId
    drops_needed: int | None


@dataclass(frozen=True, kw_only=True)
class Drop:
    """A state before impact in m, rad, m/s, rad/s; `x` is None where no model depends on it.

    `body` is its name, None where all measurements are of one.  `differences` are distances of the
    model's outcome from each rival's in standard deviations, in the order of `Experiment.separations`.
    """

    theta: float
    v_x: float
    v_y: float
    omega: float
    differences: tuple[float, ...]
    x: float | None = None
    body: str | None = None


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """Drops that separate the model from its rivals, the best first."""

    separations: tuple[Separation, ...]
    drops: tuple[Drop, ...]
