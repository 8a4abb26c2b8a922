"""Learning curves across runs: error against the number of training trials, a line for each choice of all else."""

from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from contactlearn.core.numerics import is_number
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.report.figures.browser import plotly_style
from contactlearn.report.figures.style import BOUNDS, MODEL_STYLE, STYLES
from contactlearn.report.page.runs.rows import HASH, LAW, Row
from contactlearn.report.page.runs.settings import Settings
from contactlearn.report.page.trials import digits
from contactlearn.report.text import effect_label

SIZE = "train.size"
_PLAIN = ("law", "command", "data")  # said without their key
_LOOKS = [name for name in (*MODEL_STYLE, *STYLES) if name not in BOUNDS]  # for lines whose own look is taken


@dataclass(frozen=True, kw_only=True)
class Line:
    """A line of the figure.

    Args:
        model: by name.
        traits: the words that tell it from other lines, by setting; those of the model have the key "".
        sha256: hash of its data.
        points: error by number of training trials.
        rows: its runs.
    """

    model: str
    traits: Mapping[str, str]
    sha256: str
    points: dict[float, Interval] = field(default_factory=dict)
    rows: list[int] = field(default_factory=list)


def learning_lines(runs: Sequence[Row], settings: Settings) -> list[dict[str, Any]]:
    """Return lines {label, sizes, intervals, level and how they are drawn}, and those of the bounds on the same data.

    A line is of runs that differ in `train.size` and in nothing else; without such, of a model of an evaluation that
    has learning curves.
    """
    lines = _across(runs, settings) or _within(runs)
    if not lines:
        return []
    drawn = [_entry(line, words) | {"runs": line.rows} for line, words in zip(lines, _labels(lines), strict=True)]
    _told_apart(drawn)
    sizes = sorted({size for line in lines for size in line.points})
    yardsticks = _yardsticks(runs, settings, {line.sha256 for line in lines})
    for line, words in zip(yardsticks, _labels(yardsticks), strict=True):
        values = list(line.points.values())
        if len({value.mean for value in values}) == 1:
            level = dict.fromkeys((sizes[0], sizes[-1]), values[0])
            drawn.append(_entry(line, words, level) | {"level": True})
        else:
            drawn.append(_entry(line, words))
    return drawn


def _across(runs: Sequence[Row], settings: Settings) -> list[Line]:
    """Lines of runs that differ in nothing but their size."""
    found: dict[tuple[tuple[str, str], ...], Line] = {}
    for k, size, traits in _sized(runs, settings):
        run = runs[k]
        if run.error is not None:
            name = run.law or "no law" if run.model == LAW else run.model
            law = {"law": plotly_style(run.law)["label"]} if run.law and name != run.law else {}
            traits = {"": plotly_style(name)["label"], **law, **traits, "command": f"{run.command}.py"}
            line = found.setdefault(tuple(traits.items()), Line(model=name, traits=traits, sha256=run.data.sha256))
            line.points.setdefault(size, run.error)
            line.rows.append(k)
    return [line for line in found.values() if len(line.points) > 1]


def _within(runs: Sequence[Row]) -> list[Line]:
    """Learning curves of evaluations."""
    return [
        Line(
            model=name,
            traits={"": plotly_style(name)["label"], **_parts(run), "run": run.name},
            sha256=run.data.sha256,
            points=dict(zip(sizes, values, strict=True)),
            rows=[k],
        )
        for k, run in enumerate(runs)
        for name, (sizes, values) in run.curves.items()
    ]


def _yardsticks(runs: Sequence[Row], settings: Settings, data: Container[str]) -> list[Line]:
    """The bounds of evaluations on these data, those once that are the same in several."""
    found: dict[tuple[str | tuple[str, str], ...], Line] = {}
    for k, size, traits in _sized(runs, settings):
        run = runs[k]
        if run.data.sha256 in data and run.command == "evaluate":
            for name, value in run.bounds.items():
                line = Line(model=name, traits={"": plotly_style(name)["label"], **traits}, sha256=run.data.sha256)
                found.setdefault((name, *traits.items()), line).points.setdefault(size, value)
    unique = {(line.model, line.sha256, *(x.mean for x in line.points.values())): line for line in found.values()}
    return list(unique.values())


def _sized(runs: Sequence[Row], settings: Settings) -> Iterator[tuple[int, float, dict[str, str]]]:
    """Places of runs with their number of training trials and with all else in which they differ from others."""
    for k, run in enumerate(runs):
        train = run.config.get("train")
        size = train.get("size") if isinstance(train, Mapping) else None
        if is_number(size) and 0 < size < 1e12:
            others = {key: x for key, values in settings if key != SIZE and (x := values[k]) is not None}
            yield k, size, _parts(run) | others


def _parts(run: Row) -> dict[str, str]:
    effects = {"effects": ", ".join(map(effect_label, run.given))} if run.given else {}
    return effects | {"data": f"{run.data.source} {run.data.sha256[:HASH]}"}


def _labels(lines: Iterable[Line]) -> list[str]:
    """Each line's model, and the traits in which the lines differ, data last."""
    traits = [line.traits for line in lines]
    values = {key: {one.get(key) for one in traits} for one in traits for key in one if key}
    differing = [key for key in values if len(values[key] - (set() if key in ("effects", "run") else {None})) > 1]
    differing.sort(key=lambda key: (key != "law", key != "effects", key == "data"))
    return [
        ", ".join((one[""], *(one[key] if key in _PLAIN else f"{key} {one[key]}" for key in differing if key in one)))
        for one in traits
    ]


def _entry(line: Line, words: str, points: Mapping[float, Interval] | None = None) -> dict[str, Any]:
    points = line.points if points is None else points
    sizes = sorted(points)
    intervals = [digits(asdict(points[size]), 8) for size in sizes]
    return {
        **plotly_style(line.model),
        "label": words,
        "sizes": sizes,
        "intervals": intervals,
        "level": False,
        "runs": [],
    }


def _told_apart(lines: Sequence[dict[str, Any]]) -> None:
    """Give a line a free colour if another has its own already; without a free one, colours come again."""
    taken = set()
    free = [name for name in _LOOKS if plotly_style(name)["color"] not in {line["color"] for line in lines}]
    for place, line in enumerate(lines):
        if line["color"] in taken:
            other = plotly_style(free.pop(0) if free else _LOOKS[place % len(_LOOKS)])
            line |= {key: other[key] for key in ("color", "symbol", "dash")}
        taken.add(line["color"])
