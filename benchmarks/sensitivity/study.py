"""A study of thresholds: null and planted cases, their material, and the decision under some thresholds."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any

from contactlearn.data.recordings.thresholds import TrackThresholds
from contactlearn.diagnosis.thresholds import Thresholds

Case = tuple[Any, ...]


@dataclass(frozen=True, kw_only=True)
class AllThresholds(Thresholds):
    """Thresholds of a diagnosis, and of the step from recordings to impacts before it."""

    tracks: TrackThresholds = field(default_factory=TrackThresholds)


@dataclass(frozen=True, kw_only=True)
class Study:
    """Data sets in which an alarm is false (`null`) or right (`planted`), and the decision about them."""

    name: str  # unique among all studies
    null: tuple[Case, ...]  # arguments of `prepare`, a tuple for each case
    planted: tuple[Case, ...]  # likewise
    # makes the data of a case, and everything expensive that depends on no threshold of the study
    prepare: Callable[..., Any]
    # decides by the package's own code on that material under some thresholds
    alarm: Callable[[Any, AllThresholds], bool]
    false_alarm: Callable[[Any, AllThresholds], bool] | None = None  # decides in null cases, by default as `alarm` does


def paths(thresholds: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield path and default of every threshold, such as `audit.consistent`."""
    for one in fields(thresholds):
        value, path = getattr(thresholds, one.name), prefix + one.name
        if is_dataclass(value):
            yield from paths(value, f"{path}.")
        else:
            yield path, value


def replaced(thresholds: Any, path: str, value: Any) -> Any:
    """Return the thresholds with another value at a path."""
    name, _, rest = path.partition(".")
    return replace(thresholds, **{name: replaced(getattr(thresholds, name), rest, value) if rest else value})


def each(count: int, *kinds: Any) -> tuple[Case, ...]:
    """Return (kind, seed) for so many cases of each kind; a kind of several arguments is a tuple."""
    return tuple(
        (*(kind if isinstance(kind, tuple) else (kind,)), 1000 * j + k)
        for j, kind in enumerate(kinds)
        for k in range(count)
    )
