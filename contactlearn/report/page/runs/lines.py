"""Learning curves across runs: error against the number of training trials, a line for each choice of all else."""

from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from typing import Any

from contactlearn.report.figures.style import BOUNDS, MODEL_STYLE, STYLES
from contactlearn.report.page.runs.read import HASH, Run
from contactlearn.report.page.runs.settings import Settings
from contactlearn.report.page.trials import digits, look
from contactlearn.report.text import label

Line = tuple[str, dict[str, str], str, dict[float, dict[str, float]], list[int]]
"""Model, what tells it from others, hash of its data, error by number of training trials, and its runs."""
SIZE = "train.size"
_PLAIN = ("law", "command", "data")  # said without their key
_LOOKS = [name for name in (*MODEL_STYLE, *STYLES) if name not in BOUNDS]  # for lines whose own look is taken


def learning_lines(runs: Sequence[Run], settings: Settings) -> list[dict[str, Any]]:
    """Lines {label, sizes, intervals, level and how they are drawn}, and those of the bounds on the same data.

    A line is of runs that differ in `train.size` and in nothing else; without such, of a model of an evaluation that
    has learning curves.
    """
    lines = _across(runs, settings)
    if not lines:
        for k, run in enumerate(runs):
            for name, (sizes, values) in run.curves.items():
                what = {"": look(name)["label"], **_parts(run), "run": run.name}
                lines.append((name, what, run.data["sha256"], dict(zip(sizes, values, strict=True)), [k]))
    if not lines:
        return []
    drawn = [
        _line(name, said, points) | {"runs": rows}
        for (name, _, _, points, rows), said in zip(lines, _labels(lines), strict=True)
    ]
    _told_apart(drawn)
    sizes = sorted({size for *_, points, _ in lines for size in points})
    yardsticks = _yardsticks(runs, settings, {sha256 for _, _, sha256, *_ in lines})
    for (name, *_, points, _), said in zip(yardsticks, _labels(yardsticks), strict=True):
        if len({value["mean"] for value in points.values()}) == 1:
            points = dict.fromkeys((sizes[0], sizes[-1]), next(iter(points.values())))
            drawn.append(_line(name, said, points) | {"level": True})
        else:
            drawn.append(_line(name, said, points))
    return drawn


def _across(runs: Sequence[Run], settings: Settings) -> list[Line]:
    """Of runs that differ in nothing but their size."""
    found = {}
    for k, size, what in _sized(runs, settings):
        run = runs[k]
        if run.error is not None:
            name = run.law or "no law" if run.model == "law" else run.model
            law = {"law": look(run.law)["label"]} if run.law and name != run.law else {}
            what = {"": look(name)["label"], **law, **what, "command": f"{run.command}.py"}
            line = found.setdefault(tuple(what.items()), (name, what, run.data["sha256"], {}, []))
            line[3].setdefault(size, run.error)
            line[4].append(k)
    return [line for line in found.values() if len(line[3]) > 1]


def _yardsticks(runs: Sequence[Run], settings: Settings, data: Container[str]) -> list[Line]:
    """The bounds of evaluations on these data, those once that are the same in several."""
    found = {}
    for k, size, what in _sized(runs, settings):
        run = runs[k]
        if run.data["sha256"] in data and run.command == "evaluate":
            for name, value in run.bounds.items():
                line = (name, {"": look(name)["label"], **what}, run.data["sha256"], {}, [])
                found.setdefault((name, *what.items()), line)[3].setdefault(size, value)
    unique = {(line[0], line[2], *(value["mean"] for value in line[3].values())): line for line in found.values()}
    return list(unique.values())


def _sized(runs: Sequence[Run], settings: Settings) -> Iterator[tuple[int, float, dict[str, str]]]:
    """Places of runs with their number of training trials and with all else in which they differ from others."""
    for k, run in enumerate(runs):
        train = run.config.get("train")
        size = train.get("size") if isinstance(train, Mapping) else None
        if isinstance(size, (int, float)) and 0 < size < 1e12:
            others = {key: values[k] for key, values in settings if key != SIZE and values[k] is not None}
            yield k, size, _parts(run) | others


def _parts(run: Run) -> dict[str, str]:
    effects = {"effects": ", ".join(map(label, run.given))} if run.given else {}
    return effects | {"data": f"{run.data['source']} {run.data['sha256'][:HASH]}"}


def _labels(lines: Iterable[tuple]) -> list[str]:
    """Each line's first part, and those others in which the lines differ, data last."""
    told = [what for _, what, *_ in lines]
    values = {key: {what.get(key) for what in told} for what in told for key in what if key}
    telling = [key for key in values if len(values[key] - (set() if key in ("effects", "run") else {None})) > 1]
    telling.sort(key=lambda key: (key != "law", key != "effects", key == "data"))
    return [
        ", ".join((what[""], *(what[key] if key in _PLAIN else f"{key} {what[key]}" for key in telling if key in what)))
        for what in told
    ]


def _line(name: str, said: str, points: Mapping[float, dict]) -> dict[str, Any]:
    sizes = sorted(points)
    intervals = [digits(points[size], 8) for size in sizes]
    return {**look(name), "label": said, "sizes": sizes, "intervals": intervals, "level": False, "runs": []}


def _told_apart(lines: Sequence[dict[str, Any]]) -> None:
    """Gives a line whose colour another has already one that is free, and when none is left, they come again."""
    taken = set()
    free = [name for name in _LOOKS if look(name)["color"] not in {line["color"] for line in lines}]
    for place, line in enumerate(lines):
        if line["color"] in taken:
            other = look(free.pop(0) if free else _LOOKS[place % len(_LOOKS)])
            line |= {key: other[key] for key in ("color", "symbol", "dash")}
        taken.add(line["color"])
