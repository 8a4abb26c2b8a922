"""What the columns of an unknown table probably are, by their numbers, and the command that names them.

impacts    a normal velocity turns its sign at contact and becomes smaller; what a body has before and after contact is
           correlated; spins are larger numbers than velocities; angles fill a turn; quaternions have norm 1
frames     times grow evenly; heights fall with 9.81 m/s²; some columns are the rate of change of others

These are guesses for a person to look at: nothing is read by them.
"""

import re
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import permutations
from pathlib import Path

import numpy as np
from jaxtyping import Float

from contactlearn.core.errors import DataError
from contactlearn.data.table.columns import setting_text
from contactlearn.data.table.sheet import Sheet
from contactlearn.mechanics.rigid_body import GRAVITY

Columns = Mapping[str, Float[np.ndarray, " n"]]

_NAMES = "x, y [m], theta [rad], vx, vy [m/s], omega [rad/s], their …_post after contact, rx, ry [m], mass, time"
_FORMS = '{column: "U", unit: km/h, factor: -1} states a unit and a sense, {value: 0} one number for all rows'
_MIN_ROWS = 8  # from which on numbers tell anything
_LARGEST, _SMALLEST = 1e50, 1e-50  # of numbers of which products are numbers
_CORRELATED = 0.3  # of a velocity before and after contact, at least
_DERIVED = 0.95  # the same of a column and the rate of change of another
_GRAVITY_SHARE = 0.1  # of gravity, by which the acceleration of a height may differ from it
_FALLING = 0.2  # share of windows in which a height falls so
_WINDOW = 0.05  # s, in which a body is in flight
_MOSTLY = 0.9  # share of rows
_UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254, "ft": 0.3048}
_TURNS = {"rad": np.pi, "deg": 180.0}


@dataclass(frozen=True, kw_only=True)
class _Guess:
    ours: str
    why: str
    unit: str = ""


def probable_columns(path: Path, cells: Sheet) -> str:
    """Return a line for each column, with its range and probable meaning, and the command that names them."""
    columns = {name: numbers for name in cells.header if (numbers := _numbers(cells, name)) is not None}
    whole = {name: one for name, one in columns.items() if (np.abs(one) < _LARGEST).all() and np.ptp(one) > _SMALLEST}
    clock = next((name for name, one in whole.items() if _is_clock(one)), None)
    if len(cells) < _MIN_ROWS:
        clock, guesses = None, dict[str, _Guess]()
    elif clock is not None and _are_smooth(whole, clock):
        guesses = _of_frames(whole, clock)
    else:
        clock, guesses = None, _of_impacts(whole)
    rows = [
        (repr(name), *_range(columns.get(name), cells, name), _said(guesses.get(name), columns.get(name)))
        for name in cells.header
    ]
    widths = [max(len(row[k]) for row in rows) for k in range(2)]
    lines = [f"  {row[0]:{widths[0]}}  {row[1]:{widths[1]}}  {row[2]}".rstrip() for row in rows]
    return "\n".join([*lines, *_command(path, guesses, of_frames=clock is not None)])


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
        return f"{guess.ours}? {guess.why}" if guess.ours else guess.why
    constant = numbers is not None and len(numbers) > 1 and np.ptp(numbers) == 0
    return "the same in all rows: a mass, a size or a setting?" if constant else ""


def _is_clock(one: Float[np.ndarray, " n"]) -> bool:
    """Whether numbers grow evenly, perhaps from the beginning again in each recording."""
    steps = np.diff(one)
    growing = steps[steps > 0]
    return len(growing) > _MOSTLY * len(steps) and (np.abs(growing / np.median(growing) - 1) < 0.5).mean() > _MOSTLY


def _are_smooth(whole: Columns, clock: str) -> bool:
    """Whether some columns change little from row to row, as those of frames do."""
    shares = [np.median(np.abs(np.diff(one))) / np.std(one) for name, one in whole.items() if name != clock]
    return sum(share < 0.2 for share in shares) >= 2


def _of_frames(whole: Columns, clock: str) -> dict[str, _Guess]:
    step = float(np.median(np.diff(whole[clock])))
    numbered = step == 1 and (whole[clock] == np.round(whole[clock])).all()
    about = "grows by 1: frame numbers, state data.rate" if numbered else f"grows by {step:.4g} a row"
    found = {clock: _Guess(ours="time", why=about)}
    others = {name: one for name, one in whole.items() if name != clock}
    for names in zip(*(([*others][k:]) for k in range(4)), strict=False):
        if np.allclose(np.linalg.norm([others[name] for name in names], axis=0), 1, atol=0.01):
            found |= {name: _Guess(ours="quaternion", why="the norm of these four is 1") for name in names}
    for name, of in permutations([name for name in others if name not in found], 2):
        rate = np.gradient(others[of]) / step
        if name not in found and of not in found and abs(_correlation(rate, others[name])) > _DERIVED:
            found[name] = _Guess(ours="", why=f"the rate of change of {of!r}: not needed")
    for name in (name for name in others if name not in found):
        turn = _turn(others[name])
        if turn and np.abs(np.diff(others[name])).max() > turn[1]:
            found[name] = _Guess(ours="angle", why=f"leaps by a turn: an angle in {turn[0]}", unit=turn[0])
    fits = [
        (float((np.abs(sign * accelerations * size / GRAVITY - 1) < _GRAVITY_SHARE).mean()), name, unit, sign)
        for name, one in others.items()
        if name not in found and not numbered
        for accelerations in [_accelerations(one, step)]
        for unit, size in _UNITS.items()
        for sign in (1, -1)
    ]
    share, name, unit, sign = max(fits, default=(0.0, "", "", 0))
    if share > _FALLING:
        axis = "up" if sign < 0 else "down"
        about = f"in {100 * share:.0f} % of the time it falls with gravity: a height in {unit}, {axis} positive"
        found[name] = _Guess(ours="position", why=about, unit=unit)
    return found


def _accelerations(one: Float[np.ndarray, " n"], step: float) -> Float[np.ndarray, " m"]:
    """Accelerations of parabolas in windows."""
    width = max(_MIN_ROWS, round(_WINDOW / step))
    time, starts = step * np.arange(width), range(0, len(one) - width, max(width // 2, 1))
    return np.array([2 * np.polyfit(time, one[k : k + width], 2)[0] for k in starts] or [0.0])


def _of_impacts(whole: Columns) -> dict[str, _Guess]:
    found = dict[str, _Guess]()
    for name, one in whole.items():
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
    if len(turns) == 1:
        name, unit = turns[0]
        found[name] = _Guess(ours="theta", why=f"fills three quarters of a turn or more: an angle in {unit}", unit=unit)
    left = [name for name in left if name not in found]
    normal = _pair(whole, left, opposite=True)
    if normal:
        before, after = normal
        ratio = float(np.median(np.abs(whole[after]) / np.abs(whole[before])))
        found[before] = _Guess(ours="vy", why=f"turns its sign at contact: {after!r} is {ratio:.2g} of it")
        found[after] = _Guess(ours="vy_post", why=f"has the other sign than {before!r}")
    pairs = list[tuple[str, str]]()
    while pair := _pair(whole, [name for name in left if name not in found and name not in sum(pairs, ())]):
        pairs.append(pair)
    pairs.sort(key=lambda names: np.std(whole[names[0]]))
    of_pairs = ("vx", "omega") if len(pairs) > 1 else ("vx",)
    for ours, (before, after) in zip(of_pairs, pairs, strict=False):
        about = "the larger numbers are spins" if ours == "omega" else "along the floor"
        found[before] = _Guess(ours=ours, why=f"correlated with {after!r}; {about}")
        found[after] = _Guess(ours=f"{ours}_post", why=f"correlated with {before!r}; {about}")
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


def _correlation(a: Float[np.ndarray, " n"], b: Float[np.ndarray, " n"]) -> float:
    return float(np.corrcoef(a, b)[0, 1]) if np.ptp(a) > 0 and np.ptp(b) > 0 else 0.0


def _command(path: Path, guesses: Mapping[str, _Guess], *, of_frames: bool) -> list[str]:
    """The command that reads the table once a person has filled in what is open."""
    by_ours = dict[str, list[str]]()
    for name, guess in guesses.items():
        text = setting_text(name) if name.isprintable() else "?"
        text = f"{{column: {text}, unit: {guess.unit}}}" if guess.unit == "deg" and not of_frames else text
        by_ours.setdefault(guess.ours, []).append(text)
    if of_frames:
        position = [*by_ours.get("position", []), "?", "?"][:2]
        columns = f"time: {by_ours['time'][0]}, position: [{', '.join(reversed(position))}]"
        turned = by_ours.get("quaternion", [])
        columns += f", quaternion: [{', '.join(turned)}]" if turned else f", angle: {by_ours.get('angle', ['?'])[0]}"
        verb, after, known = "impacts", " -o impacts.parquet", "position [x, y] or [x, y, z], angle null of a ball"
        forms = "data.unit and data.angle state the units, null as they are found"
        stated = [f"data.{guess.ours.replace('position', 'unit')}={guess.unit}" for guess in guesses.values()
                  if guess.unit and guess.ours in ("position", "angle")]  # fmt: skip
    else:
        wanted = ("qw", "qx", "qy", "qz") if "qw" in by_ours else ("theta",)
        wanted += ("vx", "vy", "omega", "vx_post", "vy_post", "omega_post")
        columns = ", ".join(f"{ours}: {by_ours.get(ours, ['?'])[0]}" for ours in wanted)
        verb, after, known, forms, stated = "audit", "", f"our names: {_NAMES}", _FORMS, list[str]()
    words = [f"data.columns={{{columns}}}", "data.mass=?", "data.shape={kind: disc, radius: ?}"]
    words += stated
    words += ["data.units.angle=?"] if "unit: deg" in columns and not of_frames else []  # of the spins
    quoted = " ".join(shlex.quote(word) if re.search(r"[ {]", word) else word for word in words)
    return [
        f"correct what is wrong and fill in each ? (SI), or leave it out: {known}; {forms}",
        f"  contactlearn {verb} {shlex.quote(str(path))} {quoted}{after}",
    ]
