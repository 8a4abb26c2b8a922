"""What the columns of an unknown table probably are, by names and numbers, and the command that names them.

impacts    a normal velocity turns its sign at contact and becomes smaller; what a body has before and after contact is
           correlated; spins are larger numbers than velocities; angles fill a turn; quaternions have norm 1
frames     times grow evenly, and begin again in each recording; heights fall with 9.81 m/s², and what lies along the
           floor is straight meanwhile; some columns are the rate of change of others

These are guesses for a person to look at: nothing is read by them.
"""

import math
import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from jaxtyping import Float

from contactlearn.core.errors import DataError
from contactlearn.data.table.columns import recognised_columns, setting_text, without_unit
from contactlearn.data.table.names import (
    Vocabulary,
    impact_vocabulary,
    is_duration,
    name_words,
    recognise,
    times_in,
    unit_in,
)
from contactlearn.data.table.sheet import Sheet
from contactlearn.mechanics.rigid_body import GRAVITY
from contactlearn.mechanics.space import PLANE, SPACE

Columns = Mapping[str, Float[np.ndarray, " n"]]

_NAMES = "x, y [m], theta [rad], vx, vy [m/s], omega [rad/s], their …_post after contact, rx, ry [m], mass, time"
_FORMS = '{column: "U", unit: km/h, factor: -1} states a unit and a sense, {value: 0} one number for all rows'
_MIN_ROWS = 8  # from which on numbers tell anything
_LARGEST, _SMALLEST = 1e50, 1e-50  # of numbers of which products are numbers
_CORRELATED = 0.3  # of a velocity before and after contact, at least
_DERIVED = 0.95  # the same of a column and the rate of change of another
_GRAVITY_SHARE = 0.1  # of gravity, by which the acceleration of a height may differ from it
_FALLING = 0.1  # share of windows in which a height falls so: recordings begin in a hand, and end at rest
_STRAIGHT = 0.1  # change of a rate over a window, relative to it, of what is straight while a height falls
_WINDOW = 0.05  # s, in which a body is in flight
_LONGEST_STEP = 0.5  # s between frames, of which no flight has several
_CLOCKS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
_KNOWN_SHARE = 0.8  # of the numbers of a column, with which it is looked at
_MOSTLY = 0.9  # share of rows
_BOTH_TIMES = ("vx", "vy", "omega", "vx_post", "vy_post", "omega_post")  # what is measured before and after, or not
_UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254, "ft": 0.3048}
_TURNS = {"rad": np.pi, "deg": 180.0}


@dataclass(frozen=True, kw_only=True)
class _Guess:
    """What a column probably is, why, its unit, whether a factor to SI is to be stated, and whether it is a height."""

    ours: str
    why: str
    unit: str = ""
    scaled: bool = False
    upright: bool = False


Guesses = dict[str, _Guess]


def probable_columns(
    path: Path,
    cells: Sheet,
    frame_units: Vocabulary = MappingProxyType({}),
    stated: Mapping[str, Any] = MappingProxyType({}),
    *,
    source: str | None = None,
) -> str:
    """Return a line for each column, with its range and probable meaning, and the command that names them.

    Args:
        path: of the file, for the command.
        cells: its first rows.
        frame_units: our columns of frames, and their units; none of what is a table.
        stated: what is known of `rate` in frames a second, and of `unit`, such as the size of a pixel in m.
        source: `table` of impacts, or `tracks` of frames; None as the numbers show.
    """
    columns = {name: numbers for name in cells.header if (numbers := _numbers(cells, name)) is not None}
    known = {name: one for name, one in columns.items() if (np.abs(one) < _LARGEST).mean() >= _KNOWN_SHARE}
    rows = np.all([np.isfinite(one) for one in known.values()], axis=0) if known else np.zeros(0, bool)
    whole = {name: one[rows] for name, one in known.items()}
    whole = {
        name: one for name, one in whole.items()
        if len(one) >= _MIN_ROWS and (np.abs(one) < _LARGEST).all() and np.ptp(one) > _SMALLEST
    }  # fmt: skip
    frames = _by_name(cells.header, frame_units)
    clocks = sorted(whole, key=lambda name: name not in frames or frames[name].ours != "time")
    clock = next((name for name in clocks if _is_clock(whole[name])), None)
    of_frames = source == "tracks" or (source is None and clock is not None and _are_smooth(whole, clock))
    if of_frames:
        guesses = _of_frames(whole, clock, frames)
    else:
        space = recognised_columns(cells.header)[0]
        guesses = _of_impacts(whole, _by_name(cells.header, impact_vocabulary(space)))
    guesses = {name: guesses[name] for name in cells.header if name in guesses}
    rows = [
        (repr(name), *_range(columns.get(name), cells, name), _said(guesses.get(name), columns.get(name)))
        for name in cells.header
    ]
    widths = [max(len(row[k]) for row in rows) for k in range(2)]
    lines = [f"  {row[0]:{widths[0]}}  {row[1]:{widths[1]}}  {row[2]}".rstrip() for row in rows]
    gaps = not of_frames and bool(cells.missing([name for name in columns if name in guesses]))
    every = len(guesses) == len(cells.header)
    return "\n".join([*lines, *_command(path, guesses, stated, of_frames=of_frames, every=every, gaps=gaps)])


def _numbers(cells: Sheet, name: str) -> Float[np.ndarray, " n"] | None:
    """The numbers of a column, not a number where they are missing; None of text."""
    try:
        return replace(cells.measured([name]), gaps=True).numbers(name, "")
    except DataError:
        return None


def _range(numbers: Float[np.ndarray, " n"] | None, cells: Sheet, name: str) -> tuple[str]:
    if numbers is None:
        return (f"text, {len({*cells.names(name)})} different",)
    known = numbers[np.isfinite(numbers)]
    return (f"{known.min():.4g} … {known.max():.4g}" if len(known) else "empty",)


def _said(guess: _Guess | None, numbers: Float[np.ndarray, " n"] | None) -> str:
    if guess is not None:
        return f"{'angle' if guess.ours == 'towards' else guess.ours}? {guess.why}" if guess.ours else guess.why
    constant = numbers is not None and len(numbers) > 1 and np.ptp(numbers) == 0
    return "the same in all rows: a mass, a size or a setting?" if constant else ""


def _by_name(header: Sequence[str], vocabulary: Vocabulary) -> Guesses:
    """The columns that their names tell, of some without a unit, where it is none that the reader knows."""
    found, bare = Guesses(), {without_unit(name): name for name in header}
    for ours, name in recognise(header, vocabulary).names.items():
        found[name] = _Guess(ours=ours, why="by its name")
    left = [name for name in bare if bare[name] not in found]
    for ours, name in recognise(left, vocabulary).names.items():
        if bare[name] != name and ours not in {one.ours for one in found.values()}:
            found[bare[name]] = _Guess(ours=ours, why="by its name; state the factor of its unit to SI", scaled=True)
    return found


def _is_clock(one: Float[np.ndarray, " n"]) -> bool:
    """Whether numbers grow evenly, perhaps from the beginning again in each recording."""
    steps = np.diff(one)
    growing = steps[steps > 0]
    return len(growing) > _MOSTLY * len(steps) and (np.abs(growing / np.median(growing) - 1) < 0.5).mean() > _MOSTLY


def _are_smooth(whole: Columns, clock: str) -> bool:
    """Whether some columns change little from row to row, as those of frames do."""
    shares = [np.median(np.abs(np.diff(one))) / np.std(one) for name, one in whole.items() if name != clock]
    return sum(share < 0.2 for share in shares) >= 2


def _of_frames(whole: Columns, clock: str | None, known: Guesses) -> Guesses:
    pose = {"x": "position", "y": "position", "z": "position", "theta": "angle"}
    found = {
        name: replace(one, ours="quaternion" if one.ours.startswith("q") else pose.get(one.ours, one.ours))
        for name, one in known.items()
    }
    if clock is None:
        return found
    steps = np.diff(whole[clock])
    step = float(np.median(steps))
    numbered = step == 1 and (whole[clock] == np.round(whole[clock])).all()
    unit = "s" if numbered else next((unit for unit, size in _CLOCKS.items() if step * size < _LONGEST_STEP), "s")
    about = "grows by 1: frame numbers, state data.rate" if numbered else f"grows by {step:.4g} a row, in {unit}?"
    found[clock] = _Guess(ours="time", why=about, unit="" if unit == "s" else unit)
    step *= _CLOCKS[unit]
    others = {name: one for name, one in whole.items() if name != clock}
    for name, one in others.items():
        changes = np.diff(one) != 0
        if name not in found and (steps < 0).any() and (changes == (steps < 0)).all():
            found[name] = _Guess(ours="recording", why="changes where the times begin again")
    for names in zip(*(([*others][k:]) for k in range(4)), strict=False):
        if np.allclose(np.linalg.norm([others[name] for name in names], axis=0), 1, atol=0.01):
            found |= {name: _Guess(ours="quaternion", why="the norm of these four is 1") for name in names}
    for name, of in permutations([name for name in others if name not in found], 2):
        rate, inside = np.diff(others[of]), steps > 0  # of one recording
        if (
            name not in found
            and of not in found
            and abs(_correlation(rate[inside], others[name][1:][inside])) > _DERIVED
        ):
            found[name] = _Guess(ours="", why=f"the rate of change of {of!r}: not needed")
    for name in (name for name in others if name not in found):
        turn = _turn(others[name])
        if turn and np.abs(np.diff(others[name])).max() > turn[1]:
            found[name] = _Guess(ours="angle", why=f"leaps by a turn: an angle in {turn[0]}", unit=turn[0])
    left = {name: _accelerations(one, step) for name, one in others.items() if name not in found}
    falls = {name: _fall(bent, numbered=numbered) for name, bent in left.items()}
    if sum(one.ours == "position" for one in found.values()) > 1:
        return found | _further_point(others, found)
    height = max(falls, key=lambda name: falls[name][0].mean(), default="")
    if height and (falling := falls[height][0]).mean() > _FALLING:
        found[height] = _Guess(ours="position", why=falls[height][1], unit=falls[height][2], upright=True)
        straight = [
            name for name, one in others.items()
            if name not in found and np.median(np.abs(left[name] / _rates(one, step))[falling]) < _STRAIGHT
        ]  # fmt: skip
        turned = {"angle", "quaternion"} & {one.ours for one in found.values()}
        for name in straight:
            alone = turned or len(straight) == 1
            why = f"straight while {height!r} falls: along the floor" + ("" if alone else ", or an angle")
            found[name] = _Guess(ours="position" if alone else "", why=why)
    return found | _further_point(others, found)


def _further_point(others: Columns, found: Guesses) -> Guesses:
    """Two columns, x before y, of a point that keeps its distance from the position, and so shows the angle."""
    upright = {guess.upright: name for name, guess in found.items() if guess.ours == "position"}
    if len(upright) < 2 or {"angle", "quaternion"} & {guess.ours for guess in found.values()}:
        return {}
    position = np.stack([others[upright[False]], others[upright[True]]])
    for names in permutations([name for name in others if name not in found or not found[name].ours], 2):
        apart = np.linalg.norm(np.stack([others[name] for name in names]) - position, axis=0)
        if np.median(np.abs(apart - np.median(apart))) < _STRAIGHT * np.median(apart) < np.ptp(others[names[0]]):
            why = f"keeps its distance of {np.median(apart):.4g} from the position: a point that shows the angle"
            return {name: _Guess(ours="towards", why=why) for name in names}
    return {}


def _fall(bent: Float[np.ndarray, " m"], *, numbered: bool) -> tuple[np.ndarray, str, str]:
    """In which windows a column falls as a body does, in words, and its unit."""
    if numbered:
        alike = np.abs(bent - bent[:, None]) < _GRAVITY_SHARE * np.abs(bent[:, None])
        return alike[alike.sum(1).argmax()], "bent as the way of a body that falls: a height", ""
    fits = [
        (np.abs(sign * bent * size / GRAVITY - 1) < _GRAVITY_SHARE, unit, axis)
        for unit, size in _UNITS.items()
        for sign, axis in ((1, "down"), (-1, "up"))
    ]
    falling, unit, axis = max(fits, key=lambda fit: fit[0].mean())
    about = f"in {100 * falling.mean():.0f} % of the time it falls with gravity: a height in {unit}, {axis} positive"
    return falling, about, unit


def _rates(one: Float[np.ndarray, " n"], step: float) -> Float[np.ndarray, " m"]:
    """Mean rates of change in windows, over their duration: of the same unit as accelerations."""
    width = _width(step)
    return (
        np.array([one[k + width - 1] - one[k] or _SMALLEST for k in _starts(one, width)] or [1.0]) / (width * step) ** 2
    )


def _width(step: float) -> int:
    return max(_MIN_ROWS, round(_WINDOW / step))


def _starts(one: Float[np.ndarray, " n"], width: int) -> range:
    return range(0, len(one) - width, max(width // 2, 1))


def _accelerations(one: Float[np.ndarray, " n"], step: float) -> Float[np.ndarray, " m"]:
    """Accelerations of parabolas in windows."""
    width = _width(step)
    time = step * np.arange(width)
    return np.array([2 * np.polyfit(time, one[k : k + width], 2)[0] for k in _starts(one, width)] or [0.0])


def _may_be(name: str, ours: str) -> bool:
    """Whether the unit in a name is one of our column, or there is none."""
    vocabulary = impact_vocabulary(PLANE)
    if is_duration(name):
        return False
    units = {column for column in vocabulary if unit_in(name, column, vocabulary)}
    return not units or ours in units


def _of_impacts(whole: Columns, known: Guesses) -> Guesses:
    found = Guesses(known)
    for name, one in whole.items():
        if name in found:
            continue
        if (np.diff(one) == 1).all():
            found[name] = _Guess(ours="trial", why="counts the rows")
        elif (np.diff(one) > 0).all():
            found[name] = _Guess(ours="time", why="grows from row to row")
    left = [name for name in whole if name not in found]
    for names in zip(*(left[k:] for k in range(4)), strict=False):
        if np.allclose(np.linalg.norm([whole[name] for name in names], axis=0), 1, atol=0.01):
            found |= {
                name: _Guess(ours=ours, why="the norm of these four is 1")
                for name, ours in zip(names, ("qw", "qx", "qy", "qz"), strict=True)
            }
    left = [name for name in left if name not in found]
    turns = [(name, turn[0]) for name in left if name not in found and (turn := _turn(whole[name]))]
    if len(turns) == 1 and "theta" not in {one.ours for one in found.values()}:
        name, unit = turns[0]
        found[name] = _Guess(ours="theta", why=f"fills three quarters of a turn or more: an angle in {unit}", unit=unit)
    left = [name for name in left if name not in found]
    told = {one.ours for one in known.values()}
    normal = _pair(whole, [name for name in left if _may_be(name, "vy")], opposite=True)
    if normal and not {"vy", "vy_post"} & told:
        before, after = normal
        ratio = float(np.median(np.abs(whole[after]) / np.abs(whole[before])))
        found[before] = _Guess(ours="vy", why=f"turns its sign at contact: {after!r} is {ratio:.2g} of it")
        found[after] = _Guess(ours="vy_post", why=f"has the other sign than {before!r}")
    pairs = list[tuple[str, str]]()
    velocities = [name for name in left if _may_be(name, "vx") or _may_be(name, "omega")]
    while pair := _pair(whole, [name for name in velocities if name not in found and name not in sum(pairs, ())]):
        pairs.append(pair)
    pairs.sort(key=lambda names: np.std(whole[names[0]]))
    of_spins = [pair for pair in pairs if not _may_be(pair[0], "vx")]  # the unit says so
    pairs = [*[pair for pair in pairs if pair not in of_spins], *of_spins]
    of_pairs = ("vx", "omega") if len(pairs) > 1 else ("omega",) if of_spins else ("vx",)
    of_pairs = [ours for ours in of_pairs if not {ours, f"{ours}_post"} & told]
    for ours, (before, after) in zip(of_pairs, pairs, strict=False):
        about = "along the floor" if ours == "vx" else "by its unit" if of_spins else "the larger numbers are spins"
        found[before] = _Guess(ours=ours, why=f"correlated with {after!r}; {about}")
        found[after] = _Guess(ours=f"{ours}_post", why=f"correlated with {before!r}; {about}")
    speeds = {one.ours for one in found.values()}
    for name, one in found.items():
        end = "_post" if one.ours.endswith("_post") else ""
        if one.ours == f"theta{end}" and f"speed{end}" in speeds:
            why = f"of the speed, from the floor; direction_normal{end} if it is from the normal"
            found[name] = replace(one, ours=f"direction_floor{end}", why=why)
    return found


def _turn(one: Float[np.ndarray, " n"]) -> tuple[str, float] | None:
    """The unit of an angle, and half a turn in it, of numbers that fill three quarters of a turn to one."""
    for unit, half in _TURNS.items():
        inside = -1.01 * half <= one.min() and one.max() <= 2.01 * half
        if inside and 1.5 * half < np.ptp(one) <= 2.01 * half:
            return unit, half
    return None


def _pair(whole: Columns, names: list[str], *, opposite: bool = False) -> tuple[str, str] | None:
    """The two columns that are correlated most, as a velocity before and after contact, in the order of the file."""
    best, strongest = None, _CORRELATED
    for before, after in permutations(names, 2):
        if not _are_ends(before, after):
            continue
        a, b = whole[before], whole[after]
        if opposite:
            turned = abs(np.sign(a).mean()) > _MOSTLY and (np.sign(a) == -np.sign(b)).mean() > _MOSTLY
            smaller = turned and np.median(np.abs(b)) < np.median(np.abs(a))
            strength = 1 + _correlation(np.abs(a), np.abs(b)) if smaller else 0.0
        else:
            strength = _correlation(a, b) if names.index(before) < names.index(after) else 0.0
        if strength > strongest:
            best, strongest = (before, after), strength
    return best


def _are_ends(before: str, after: str) -> bool:
    """Whether names are those of one quantity before and after contact, or say nothing of it."""
    times = [times_in(name, opposite=True) for name in (before, after)]
    bare = [[word for word in name_words(name) if times_in(word, opposite=True) is None] for name in (before, after)]
    return times == [None, None] or (times == ["pre", "post"] and bare[0] == bare[1])


def _correlation(a: Float[np.ndarray, " n"], b: Float[np.ndarray, " n"]) -> float:
    return float(np.corrcoef(a, b)[0, 1]) if np.ptp(a) > 0 and np.ptp(b) > 0 else 0.0


def _factor(name: str, stated: Mapping[str, Any]) -> str:
    """The factor to SI of the unit in a name, of pixels and frames; ? where they are not known."""
    known = {"deg": np.pi / 180, "rad": 1.0, **_UNITS, **dict.fromkeys(("px", "pixel", "pixels"), stated.get("unit"))}
    per = {"s": 1.0, "ms": 1e3, **dict.fromkeys(("frame", "frames", "fr"), stated.get("rate"))}
    words = [word for word in name_words(name[len(without_unit(name)) :]) if word != "per"]
    factors = [of.get(word) for word, of in zip(words, (known, per), strict=False)]
    numbers = [float(one) for one in factors if one is not None]
    return f"{math.prod(numbers):.6g}" if 0 < len(words) == len(numbers) else "?"


def _command(
    path: Path, guesses: Guesses, known: Mapping[str, Any], *, of_frames: bool, every: bool, gaps: bool
) -> list[str]:
    """The command that reads the table once a person has filled in what is open.

    `every` if each column is guessed, `gaps` if numbers are missing.
    """
    by_ours = dict[str, list[str]]()
    for name, guess in guesses.items():
        text = setting_text(name) if name.isprintable() else "?"
        stated = of_frames and guess.ours != "time"
        text = f"{{column: {text}, unit: {guess.unit}}}" if guess.unit and not stated else text
        text = f"{{column: {text}, factor: {_factor(name, known)}}}" if guess.scaled else text
        by_ours.setdefault(guess.ours, []).append(text)
    if of_frames:
        position = by_ours.get("position", [])
        if len(position) == 2:  # angles are from the first of them
            upright = [one.upright for one in guesses.values() if one.ours == "position"]
            position = [text for _, text in sorted(zip(upright, position, strict=True), key=lambda one: one[0])]
        vertical = every and [guess.upright for guess in guesses.values() if guess.ours == "position"] == [True]
        position = [*["{value: 0}" if vertical else "?"] * (2 - len(position)), *position]
        by_ours |= {"angle": ["null"]} if vertical else {}
        columns = f"time: {by_ours.get('time', ['?'])[0]}, position: [{', '.join(position)}]"
        turned = by_ours.get("quaternion", [])
        towards = [f"[{', '.join(by_ours['towards'])}]"] if "towards" in by_ours else ["?"]
        angle = by_ours.get("angle", towards)[0]
        columns += f", quaternion: [{', '.join(turned)}]" if turned else f", angle: {angle}"
        columns += f", recording: {by_ours['recording'][0]}" if "recording" in by_ours else ""
        verb, after, names = "impacts", " -o impacts.parquet", "position [x, y] or [x, y, z], angle null of a ball"
        forms = f"data.unit and data.angle state the units, null as they are found; {_FORMS}"
        by_unit = {"unit" if one.ours == "position" else "angle": one for one in guesses.values()
                   if one.unit and one.ours in ("position", "angle")}  # fmt: skip
        units = {name: one.unit for name, one in by_unit.items()}
        if "time" not in by_ours or any("data.rate" in one.why for one in guesses.values()):
            units["rate"] = f"{known['rate']:g}" if "rate" in known else "?"
        units |= {"unit": str(known["unit"])} if "unit" in known else {}
        stated = [f"data.{name}={one}" for name, one in units.items()]
    else:
        pairs = [pair for pair in (("vy", "vy_post"), ("speed", "speed_post"), ("height", "height_post"))
                 if {*pair} & {*by_ours}] or [("vy", "vy_post")]  # fmt: skip
        vocabulary = dict.fromkeys((*impact_vocabulary(PLANE), *impact_vocabulary(SPACE)))
        there = {*by_ours, *pairs[0]} - {"trial", "time"}
        other = {f"{ours}_post" for ours in there} | {ours.removesuffix("_post") for ours in there}  # of the same time
        wanted = [ours for ours in vocabulary if ours in there or (ours in other and ours in _BOTH_TIMES)]
        columns = ", ".join(f"{ours}: {by_ours.get(ours, ['?'])[0]}" for ours in wanted)
        verb, after, names, forms, stated = "audit", "", f"our names: {_NAMES}", _FORMS, list[str]()
    body = "sphere" if {"quaternion", "qw"} & {*by_ours} else "disc"
    words = [f"data.columns={{{columns}}}", *([] if "mass" in by_ours else ["data.mass=?"])]
    words += [] if {"rx", "ry", "inertia"} <= {*by_ours} else [f"data.shape={{kind: {body}, radius: ?}}"]
    words += stated
    words += ["data.units.angle=?"] if "unit: deg" in columns and not of_frames else []  # of the spins
    words += ["data.correct=[drop_incomplete]"] if gaps else []
    quoted = " ".join(shlex.quote(word) if re.search(r"[ {]", word) else word for word in words)
    return [
        f"correct what is wrong, fill in each ? (SI), and add what else was measured: {names}; {forms}",
        f"  contactlearn {verb} {shlex.quote(str(path))} {quoted}{after}",
    ]
