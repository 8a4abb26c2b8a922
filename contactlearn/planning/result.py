"""A plan: the drops to make next, what they are expected to tell, and whether to stop.  Written as plan.json."""

from dataclasses import dataclass, field
from enum import StrEnum

from contactlearn.diagnosis.result import Diagnosis, Level
from contactlearn.planning.rig import Limits


class Goal(StrEnum):
    """What the drops are to make known: names of effects, parameters, or predictions."""

    NAMES = "names"
    PARAMETERS = "parameters"
    PREDICTION = "prediction"


class Purpose(StrEnum):
    """What a drop was chosen for.

    `effects` are those of the catalogue that no drop has shown or excluded yet, `space` an even spread.
    """

    NAMES = "names"
    PARAMETERS = "parameters"
    PREDICTION = "prediction"
    EFFECTS = "effects"
    SPACE = "space"


class Stop(StrEnum):
    """Why a sequence of plans has come to its end, see `stopping`."""

    SETTLED = "settled"
    NO_GAIN = "no_gain"
    BUDGET = "budget"


@dataclass(frozen=True, kw_only=True)
class PlannedDrop:
    """A drop: values in SI units of what the rig sets, by name."""

    settings: dict[str, float]
    purpose: Purpose
    body: str = "body"


@dataclass(frozen=True, kw_only=True)
class Possibility:
    """Effects that may be the ones that are missing, none of them too, and the probability of that."""

    effects: tuple[str, ...]
    probability: float


@dataclass(frozen=True, kw_only=True)
class ParameterForecast:
    """A parameter of the chosen model, and its standard error now and after the batch."""

    name: str
    symbol: str
    unit: str
    value: float
    error: float
    error_after: float


@dataclass(frozen=True, kw_only=True)
class Forecast:
    """What is expected after more drops like those of the plan.

    Args:
        drops: numbers of further drops, from 0 on.
        right_name: expected probability of the right name after each; empty where no other name is in question.
        error: standard deviation of the prediction over all drops within the limits, in units of the noise.
        parameters: of the chosen model.
        gain: what the batch adds to the goal: to the probability of the right name, or the relative fall of errors;
            None before a diagnosis.
        worthwhile: number of further drops after which a batch no longer pays; None beyond the last of `drops`.
    """

    drops: tuple[int, ...]
    right_name: tuple[float, ...]
    error: tuple[float, ...]
    parameters: tuple[ParameterForecast, ...]
    gain: float | None
    worthwhile: int | None


@dataclass(frozen=True, kw_only=True)
class Look:
    """A diagnosis on the way: number of measured drops, the names found, others that are probable, and the gain.

    `gain` is what the next batch was expected to add to the goal.
    """

    trials: int
    found: tuple[str, ...]
    probable: tuple[str, ...]
    gain: float

    @classmethod
    def of(cls, diagnosis: Diagnosis, *, gain: float) -> "Look":
        """Look at a diagnosis."""
        at = {
            level: tuple(sorted(one.effect.name for one in diagnosis.missing if one.level is level)) for level in Level
        }
        trials = 0 if diagnosis.record is None else len(diagnosis.record.impacts)
        return cls(trials=trials, found=at[Level.FOUND], probable=at[Level.PROBABLE], gain=gain)


@dataclass(frozen=True, kw_only=True)
class Plan:
    """A batch of drops.

    Args:
        goal: of the plan.
        space: of the bodies, `plane` or `space`.
        rig: limits of every quantity, by name.
        noise: standard deviations of the measured velocity after impact.
        drops: in the order in which to make them.
        possibilities: the names in question, the most probable first; none before a diagnosis.
        forecast: of what these drops tell.
        hidden: effects of the catalogue that no drop within the limits shows.
        looks: at the measurements so far.
        budget: impacts to measure at most, all told.
        stop: why to make no more drops; None to go on.
        bodies: mass in kg and moments of inertia in kg m² of each body by its name; empty in plans of older versions.
    """

    goal: Goal
    space: str
    rig: dict[str, Limits]
    noise: tuple[float, ...]
    drops: tuple[PlannedDrop, ...]
    budget: int
    possibilities: tuple[Possibility, ...] = ()
    forecast: Forecast
    hidden: tuple[str, ...] = ()
    looks: tuple[Look, ...] = ()
    stop: Stop | None = None
    bodies: dict[str, tuple[float, ...]] = field(default_factory=dict)
