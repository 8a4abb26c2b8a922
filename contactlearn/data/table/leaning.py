"""A racket, or a floor, that leans differently in each row: velocities in axes along it and along its normal.

    vx, vy, vx_post, vy_post, paddle tilt (deg)     v_n = vx cos φ + vy sin φ,  v_t = vx sin φ − vy cos φ

φ is the angle of the normal: that at a tilt of 0, and the tilt.  The face that is hit at 0, +x, +y, −x or −y, is the
only one that nearly all bodies approach and leave.  A tilt is positive counter-clockwise, unless the spins say
otherwise: those of a ball change as its velocity along the surface does.
"""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from contactlearn.core.errors import DataError
from contactlearn.data.table.columns import recognised_columns, setting_text
from contactlearn.data.table.names import SURFACES, impact_vocabulary, name_words, unit_in
from contactlearn.data.table.options import TableOptions
from contactlearn.data.table.sheet import Sheet
from contactlearn.data.table.units import Units
from contactlearn.mechanics.space import PLANE, SPACE

_TILTS = {"tilt", "incline", "inclination", "lean", "loft", "neigung"}
_OF_SURFACE = {"n", "vn", "normal", "norm", "perp", "perpendicular"}
_MIN_LEAN = 0.002  # rad, range of a tilt that differs from row to row
_FACING = 0.9  # share of rows that approach a face, and leave it
_CLEARER = 0.5  # of what one sense of the tilt leaves of the spins, up to which the other is taken
_FACES = {"+x": 0.0, "+y": np.pi / 2, "−x": np.pi, "−y": -np.pi / 2}
_VELOCITIES = ("vx", "vy", "vx_post", "vy_post")
_SPINS = ("omega", "omega_post")


def level(cells: Sheet, options: TableOptions) -> Sheet:
    """Return the table in axes along the surface and its normal, where it has a tilt that differs from row to row.

    A table of bodies in space is returned as it is, and so is a tilt that settings name.

    Raises:
        DataError: the velocities do not tell the face that is hit, or places would have to be turned as well.
    """
    chosen, units = options.chosen, options.units
    tilt = next((name for name in cells.header if name not in chosen and _is_tilt(name)), None)
    space, known = recognised_columns([name for name in cells.header if name != tilt], options.columns)
    names = options.names(cells, known)
    if tilt is None or space is SPACE or not {*_VELOCITIES} <= {*names}:
        return cells
    if _OF_SURFACE.intersection(name_words(names["vy"])):  # in its axes already
        return cells
    stated = unit_in(tilt, "theta", impact_vocabulary(PLANE))
    of_tilt, own = Units(units.stated, {"theta": stated} if stated else {}), Units(units.stated, known.units)
    angle = cells.quantity(tilt, "theta", of_tilt)
    whole = np.isfinite(angle)
    if not whole.any() or np.ptp(angle[whole]) < _MIN_LEAN:
        return cells
    if not stated and "angle" not in units.stated:
        body = f"of the body, 'data.columns={{theta: {{column: {setting_text(tilt)}, unit: deg}}}}' or unit: rad; "
        raise DataError(
            f"{cells.path}: {tilt!r} has no unit, {np.nanmin(angle):.4g} … {np.nanmax(angle):.4g} may be degrees or "
            f"radians, and does not say what leans: {'' if 'theta' in names else body}of the surface, call it 'surface "
            f"tilt (deg)' or 'surface tilt (rad)' in the file; where velocities are along it and across it already, "
            f"'data.covariates=[{setting_text(tilt)}]'"
        )
    leans = f"{cells.path}: the surface leans by {tilt!r}, which differs from row to row, and"
    otherwise = "where velocities are along it and across it already, say so by 'data.covariates=[…]' with its name"
    if beside := [names[column] for column in ("x", "y", "rx", "ry") if column in names]:
        raise DataError(
            f"{leans} {', '.join(beside)} are in axes of the room: turn all into axes along the surface and its "
            f"normal; {otherwise}"
        )
    columns_read = [*_VELOCITIES, *(column for column in _SPINS if column in names)]
    v = {column: cells.quantity(names[column], column, own) for column in columns_read}
    turned = {
        (sense, face): _turned(v, normal + sign * angle)
        for sense, sign in (("counter-clockwise", 1), ("clockwise", -1))
        for face, normal in _FACES.items()
    }
    hit = {  # nearly all normal velocities approach the face, and leave it
        key: one
        for key, one in turned.items()
        if min(np.mean(one["vy"][whole] < 0), np.mean(one["vy_post"][whole] > 0)) > _FACING
    }
    by_sense = {sense: [key for key in hit if key[0] == sense] for sense, _ in turned}
    chosen = _sense({keys[0]: hit[keys[0]] for keys in by_sense.values() if len(keys) == 1}, v, "theta" in names)
    if chosen is None:
        raise DataError(
            f"{leans} the velocities do not tell the face that is hit at 0: turn them into axes along the "
            f"surface and its normal; {otherwise}"
        )
    sense, face = chosen
    changes = {names[column]: {names[column]: one / own.factor(column)} for column, one in hit[chosen].items()}
    turn = _FACES[face] - np.pi / 2 + (angle if sense == "counter-clockwise" else -angle)
    for column in ("theta", "theta_post"):
        if column in names:
            values = cells.numbers(names[column], own.text(column)) - turn / own.factor(column)
            changes[names[column]] = {names[column]: values}
    said = f"velocities turned into the axes of the surface by {tilt!r}, positive {sense}; its normal at 0 is {face}"
    return cells.edited({**changes, tilt: {}}, said)


def _turned(
    v: Mapping[str, Float[np.ndarray, " n"]], normal: Float[np.ndarray, " n"]
) -> dict[str, Float[np.ndarray, " n"]]:
    """Velocities along a surface and along its normal, which has these angles in rad."""
    found = dict[str, Float[np.ndarray, " n"]]()
    for time in ("", "_post"):
        vx, vy = v[f"vx{time}"], v[f"vy{time}"]
        found[f"vx{time}"] = vx * np.sin(normal) - vy * np.cos(normal)
        found[f"vy{time}"] = vx * np.cos(normal) + vy * np.sin(normal)
    return found


def _sense(
    turned: Mapping[tuple[str, str], Mapping[str, Float[np.ndarray, " n"]]],
    v: Mapping[str, Float[np.ndarray, " n"]],
    turning: bool,
) -> tuple[str, str] | None:
    """The sense of the tilt and the face at 0, of those in which velocities have one face; None if there are none.

    Args:
        turned: velocities by sense and face.
        v: velocities and spins as they were measured.
        turning: whether bodies have an orientation, so that their spins follow the normal impulse as well.
    """
    senses = [*turned]
    if len(senses) < 2 or turning or not {*_SPINS} <= {*v}:
        return senses[0] if senses else None
    spin = v["omega_post"] - v["omega"]
    left = dict[tuple[str, str], float]()
    for key, one in turned.items():
        along = one["vx_post"] - one["vx"]
        there = np.isfinite(spin) & np.isfinite(along)
        norms = (spin[there] ** 2).sum() * (along[there] ** 2).sum()
        left[key] = 1 - (spin[there] * along[there]).sum() ** 2 / max(norms, 1e-300)
    return senses[1] if left[senses[1]] < _CLEARER * left[senses[0]] else senses[0]


def _is_tilt(name: str) -> bool:
    """Whether a column is the angle by which the surface leans."""
    words = {*name_words(name)}
    faces = {"face", "angle"} <= words
    others = words - _TILTS - SURFACES - {"face", "angle", "of", "the", "deg", "rad", "degrees", "°"}
    return bool(words & _TILTS or faces) and not others
