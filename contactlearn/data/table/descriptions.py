"""Other descriptions of the same impact, as columns that the reader knows; long tables and vectors are in `reshaped`.

two rows an impact            trial, vx, vy, omega, phase      before and after in a column of any name
speed and direction           speed, angle from floor [deg]    in place of vx and vy; or angle from normal
quaternion by numbers         q0, q1, q2, q3                   the scalar first or last, as signs or heights tell
roll, pitch, yaw              roll [deg], pitch [deg], …       turns about the fixed axes x, y, z, in this order
a racket, club or floor       vx, vy, racket_vx, racket_vy     velocities are made relative to it
momenta                       px, py, L, px_post, …        velocities, by the mass and the moment of inertia
changes of velocities         vx, vy, omega, dvx, dvy, dw   after contact they are those before it and the changes
a surface that leans          vx, vy, paddle tilt (deg)     velocities are turned into its axes, row by row
bounces along the normal      drop height, rebound height      or v_in, v_out: without slip and spin

Heights are those of falls in vacuum.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import torch

from contactlearn.core.errors import DataError
from contactlearn.data.table.columns import columns_of, recognised_columns, setting_text, without_unit
from contactlearn.data.table.dialect import is_missing, with_one_unit, written_in
from contactlearn.data.table.leaning import level
from contactlearn.data.table.names import (
    MOMENTA,
    MOVING,
    NAMES,
    OTHERS,
    PER_CENT,
    SURFACES,
    VECTORS,
    Recognised,
    impact_vocabulary,
    is_coefficient,
    name_words,
    time_of,
    unit_in,
)
from contactlearn.data.table.options import TableOptions
from contactlearn.data.table.reshaped import are_vectors, by_bounce, by_component, by_flight, by_repeat, by_trial
from contactlearn.data.table.sheet import LEAVE_OUT, Cells, Sheet, taken
from contactlearn.data.table.units import Units, powers_of
from contactlearn.mechanics.bodies import contact_points
from contactlearn.mechanics.rigid_body import GRAVITY
from contactlearn.mechanics.shapes import require_dimension
from contactlearn.mechanics.space import PLANE, SPACE

_SPREAD_RATIO = 3  # times less spread of the floor, with which a quaternion is read; 2 and 5 decide alike on 20 trials
_MIN_HEIGHT_SHARE = 0.02  # of the height, that heights must differ: those of a sphere do by rounding only
_MIN_NEGATIVE = 8  # negative values of one end of a quaternion, and none of the other: 1 in 2⁸ by chance
_POSES = ("x", "y", "z", "theta", "qw", "qx", "qy", "qz")
_SURFACE = re.compile(rf"[_ .:-]*(?:{'|'.join(sorted(SURFACES))})[_ .:-]*", re.IGNORECASE)
_DIRECTED = {
    "along",
    "parallel",
    "perpendicular",
    "normal",
    "to",
    "towards",
    "toward",
    "into",
    "from",
    "off",
    "against",
}
"""Words between a velocity of the body and the surface that says its direction: v along the wall."""
_ANGLES = {"angle", "angles", "direction", "azimuth", "elevation", "winkel", "ángulo", "angulo", "angolo"}
_OTHERS = ("restitution", *(f"{other}{end}" for other in OTHERS for end in ("", "_post")), *MOVING)
_VELOCITIES = ("vx", "vy", "vz", "omega", "wx", "wy", "wz", *OTHERS)


def restated(cells: Sheet, options: TableOptions) -> Sheet:
    """Return a table with a row an impact and velocities by components; columns that settings name stay as they are.

    Raises:
        DataError: a trial without its row before or after contact, or a description that has two readings.
    """
    chosen = options.chosen
    cells = _with_other_units(by_repeat(by_flight(by_bounce(by_trial(replace(cells, gaps=options.gaps))))), chosen)
    numbers = {name for ours, name in recognised_columns(cells.header)[1].names.items() if ours not in NAMES} - chosen
    numbers |= {name for name in cells.header if is_coefficient(name)}
    mapped = {name for ours, name in options.columns.items() if name is not None and ours not in NAMES}
    cells = by_component(cells.unmarked(numbers, mapped), chosen)
    phase = phase_column(cells)
    cells = _without_angles(cells if phase is None else _paired(cells, phase), options.units)
    for step in (_with_quaternion, _without_momenta, _with_changes, _relative_to_surface, _by_components, level):
        cells = step(cells, options)
    return replace(cells, gaps=False)


def by_settings(cells: Sheet, mapped: Mapping[str, str | None]) -> tuple[Sheet, dict[str, str | None]]:
    """Return the table with names of other descriptions that settings map, such as height, and the other mappings."""
    whole = {without_unit(name): name for name in cells.header} | {name: name for name in cells.header}
    other = (*VECTORS, *_OTHERS)
    mapped = {ours: whole.get(name, name) if name and ours in other else name for ours, name in mapped.items()}
    free = {*cells.header} - {*columns_of(PLANE)}
    named = {name: ours for ours, name in mapped.items() if ours in other and name is not None and name in free}
    for name, ours in named.items():
        if ours in VECTORS and not are_vectors(cells, name):
            raise DataError(f"{cells.path}: data.columns.{ours}={name}: that column has no vectors in its cells")
    vocabulary = impact_vocabulary(PLANE)
    renamed = {
        name: ours.replace("_", " ") + (f" [{Units(stated).text(ours)}]" if stated else name[len(without_unit(name)) :])
        for name, ours in named.items()
        for stated in [unit_in(name, ours, vocabulary)]
    }
    return cells.renamed(renamed), {ours: name for ours, name in mapped.items() if ours not in named.values()}


def _with_other_units(cells: Sheet, chosen: set[str]) -> Sheet:
    """The table with units of cells in the names of columns that these exclude: T in °C is no time."""
    known = {name: ours for ours, name in recognised_columns(cells.header)[1].names.items() if powers_of(ours)}
    names = dict[str, str]()
    for name in known.keys() - chosen:
        first = next((cell for cell in cells.columns[name] if not is_missing(cell)), None)
        if isinstance(first, str) and written_in(first) is None and (found := with_one_unit(cells.columns[name])):
            names[name] = f"{name} [{found[1]}]"
    return cells.renamed(names)


def phase_column(cells: Sheet) -> str | None:
    """Return the column that says of each row whether it is before or after contact, if there is one."""
    for name, column in cells.columns.items():
        if not isinstance(column, list) or not column or not time_of(str(column[0])):
            continue  # as most columns, which are long
        if {time_of(cell) for cell in {*map(str, column)}} == {"pre", "post"}:
            return name
    return None


_TIMES: dict[str | None, str] = {"pre": "before", "post": "after"}


def _paired(cells: Sheet, phase: str) -> Sheet:
    """The rows before contact, with velocities and poses of the row after it beside them."""
    known = recognised_columns(cells.header)[1].names
    times = [time_of(str(cell)) for cell in cells.columns[phase]]
    name = known.get("trial") or _pairing(cells, phase, times)
    trials = cells.names(name) if name else [str(k // 2) for k in range(len(times))]
    if name and (sessions := _sessions(cells, trials, times, [name, phase])):
        trials = [f"{session}/{trial}" for session, trial in zip(sessions, trials, strict=True)]
    rows: dict[str, dict[str | None, int]] = {}
    for row, (trial, time) in enumerate(zip(trials, times, strict=True)):
        pair = rows.setdefault(trial, {})
        if time in pair:
            word = f"column {name}: trial {trial!r} has" if name else "without a column of trials, there are"
            raise DataError(
                f"{cells.path}: row {row + 1}, {word} two rows {_TIMES[time]} contact in column {phase!r}, a row "
                "before and a row after are needed",
                row=row + 1,
            )
        pair[time] = row
    for trial, pair in rows.items():
        if len(pair) < 2 and not cells.gaps:
            row = next(iter(pair.values())) + 1
            lacking = next(word for time, word in _TIMES.items() if time not in pair)
            few = f"row {row}, trial {trial!r} has no row {lacking} contact"
            raise DataError(f"{cells.path}: {few}: add it, or {LEAVE_OUT}", row=row)
    before, after = ([pair.get(time) for pair in rows.values()] for time in ("pre", "post"))
    either = [min(pair.values()) for pair in rows.values()]
    whole = [(pair["pre"], pair["post"]) for pair in rows.values() if len(pair) == 2]
    changing = [name for ours, name in known.items() if ours in _VELOCITIES]
    poses = [name for ours, name in known.items() if ours in _POSES]
    columns = {**cells.columns, **({name: [*trials]} if name else {})}
    if any(columns[name][k] != columns[name][later] for name in poses for k, later in whole):
        changing += poses
    first = ((one, taken(columns[one], before if one in changing else either)) for one in columns if one != phase)
    later = ((f"{one} after", taken(columns[one], after)) for one in changing)
    return cells.gathered(either).with_columns([*first, *later], f"two rows an impact, by {phase!r}")


def _sessions(
    cells: Sheet, trials: Sequence[str], times: Sequence[str | None], taken: Sequence[str]
) -> Sequence[str] | None:
    """The session of each row, where numbers of trials begin again in each: by a column, or one after the other."""
    ends = [*zip(trials, times, strict=True)]
    if len({*ends}) == len(ends):
        return None
    measured = recognised_columns(cells.header)[1].names.values()
    for column in (column for column in cells.header if column not in (*taken, *measured)):
        sessions = cells.names(column)
        if len({*zip(sessions, ends, strict=True)}) == len(ends) and all(sessions):
            return sessions
    seen, counted = dict[tuple[str, str | None], int](), list[int]()
    for end in ends:
        seen[end] = seen.get(end, 0) + 1
        counted.append(seen[end])
    several = all(len({trial for trial, k in zip(trials, counted, strict=True) if k == one}) > 1 for one in {*counted})
    return [*map(str, counted)] if counted == sorted(counted) and several else None


def _pairing(cells: Sheet, phase: str, times: Sequence[str | None]) -> str | None:
    """The first column in which every cell stands once before contact and once after it."""
    for name, column in cells.columns.items():
        ends = {(str(cell), time) for cell, time in zip(column, times, strict=True)} if name != phase else set()
        if len(ends) == len(times) and len({cell for cell, _ in ends}) == len(times) / 2:
            return name
    return None


def _without_angles(cells: Sheet, units: Units) -> Sheet:
    """The table with qw, qx, qy, qz in place of roll, pitch and yaw."""
    names = {words[0]: name for name in cells.header if (words := name_words(name)) and words[0] in _TURNS}
    if len(names) < len(_TURNS):
        return cells
    from scipy.spatial.transform import Rotation  # SciPy takes long to load

    vocabulary = impact_vocabulary(PLANE)
    factors, said = list[float](), "rad"
    for name in names.values():
        of_angle = Units(units.stated, {"theta": stated} if (stated := unit_in(name, "theta", vocabulary)) else {})
        factors.append(of_angle.factor("theta"))
        said = of_angle.text("theta")
    turns = [cells.numbers(names[turn], said) * factor for turn, factor in zip(_TURNS, factors, strict=True)]
    quaternions = Rotation.from_euler("xyz", np.stack(turns, -1)).as_quat()
    kept = ((name, column) for name, column in cells.columns.items() if name not in names.values())
    made = zip(_ORDERS["last"], quaternions.T, strict=True)
    said = f"roll, pitch and yaw in {said}, about the fixed axes x, y, z in this order"
    return cells.with_columns([*kept, *made], said)


_TURNS = ("roll", "pitch", "yaw")


def _with_quaternion(cells: Sheet, options: TableOptions) -> Sheet:
    """The table with qw, qx, qy, qz in place of four numbered components, if signs or heights tell the scalar."""
    numbered = {
        words[1]: name for name in cells.header if len(words := name_words(name)) == 2 and words[0] in _QUATERNIONS
    }
    digits = sorted(numbered)
    if digits not in (list("0123"), list("1234")) or options.chosen & {*numbered.values()}:
        return cells
    names = [numbered[digit] for digit in digits]
    place, why = _scalar_by_sign(cells, names) or _scalar_by_height(cells, names, options) or ("", "")
    if not place:
        first, last = (
            ", ".join(f"{ours}: {name}" for ours, name in zip(order, names, strict=True)) for order in _ORDERS.values()
        )
        if options.asked:
            raise DataError(
                f"{cells.path}: the scalar of the quaternion {names[0]} … {names[3]} may be first, "
                f"'data.columns={{{first}}}', or last, 'data.columns={{{last}}}': neither signs nor heights over "
                "the floor, of a body that is no sphere, tell"
            )
        why = "its scalar is first or last, which the body's shape may tell"
    renamed = dict(zip(names, _ORDERS[place or "first"], strict=True))
    return cells.renamed(renamed, f"quaternion {names[0]} … {names[3]}: {why}")


def _scalar_by_sign(cells: Sheet, names: Sequence[str]) -> tuple[str, str] | None:
    """Where the scalar is in a quaternion of a tracker that makes the sign unique: its scalar is never negative."""
    negative = [int((cells.numbers(name, "1") < 0).sum()) for name in (names[0], names[3])]
    if min(negative) or max(negative) < _MIN_NEGATIVE:
        return None
    place = "last" if negative[1] == 0 else "first"
    return place, f"the scalar is {place}, for it is never negative"


def _scalar_by_height(cells: Sheet, names: Sequence[str], options: TableOptions) -> tuple[str, str] | None:
    """Where the scalar is, by heights: the lowest point of a body in contact lies on the floor."""
    known, shape = recognised_columns([*cells.header, *_ORDERS["first"]])[1], options.shape
    if shape is None or isinstance(shape, Mapping) or "z" not in known.names:
        return None
    require_dimension(str(cells.path), shape, SPACE)
    z = torch.from_numpy(cells.quantity(known.names["z"], "z", Units(options.units.stated, known.units)))
    components = [torch.from_numpy(cells.numbers(name, "1")) for name in names]
    whole = torch.stack([z, *components]).isfinite().all(0)
    z, components = z[whole], [component[whole] for component in components]
    spread: dict[str, float] = {}
    for place, order in _ORDERS.items():
        quaternion = torch.stack([components[order.index(name)] for name in _ORDERS["first"]], -1)
        floor = z + contact_points(shape, None, quaternion / quaternion.norm(dim=1, keepdim=True).clamp(min=1e-9))[:, 2]
        spread[place] = (floor - floor.median()).abs().median().item()
    place = min(spread, key=lambda one: spread[one])
    if max(spread.values()) < max(_SPREAD_RATIO * spread[place], _MIN_HEIGHT_SHARE * z.abs().median().item()):
        return None
    spreads = f"{spread[place]:.2g} m against {max(spread.values()):.2g} m"
    return place, f"the scalar is {place}, with which the lowest points lie on one floor ({spreads})"


_QUATERNIONS = ("q", "quat", "quaternion")
_ORDERS = {"first": ("qw", "qx", "qy", "qz"), "last": ("qx", "qy", "qz", "qw")}


def _without_momenta(cells: Sheet, options: TableOptions) -> Sheet:
    """The table with velocities in place of momenta that stand in it before and after contact."""
    chosen, shape, stated = options.chosen, options.shape, options.body
    known = recognised_columns([name for name in cells.header if name not in chosen], options.columns)[1]
    own = options.names(cells, known)
    ends = ("", "_post")
    momenta = {
        f"{momentum}{end}": f"{velocity}{end}"
        for momentum, velocity in MOMENTA.items()
        for end in ends
        if all(f"{momentum}{one}" in known.names and f"{velocity}{one}" not in own for one in ends)
    }
    if not momenta:
        return cells
    units = options.units_of(known)

    def of_body(column: str) -> np.ndarray | None:
        if name := own.get(column):
            return cells.quantity(name, column, units)
        return stated[column].numpy() if column in stated and not stated[column].ndim else None

    mass, inertia = of_body("mass"), of_body("inertia")
    if inertia is None and mass is not None and shape is not None and not isinstance(shape, Mapping):
        require_dimension(str(cells.path), shape, PLANE)
        inertia = mass * float(shape.gyration_squared())
    changes = dict[str, dict[str, Cells]]()
    for momentum, velocity in momenta.items():
        name, turning = known.names[momentum], momentum.startswith("angular")
        divisor = inertia if turning else mass
        if divisor is None and options.asked:
            needed = (
                "moment of inertia in kg m², data.inertia=…, or its mass and shape" if turning else "mass, data.mass=…"
            )
            raise DataError(f"{cells.path}: {name!r} looks like a momentum, whose velocity needs the body's {needed}")
        values = cells.quantity(name, momentum, units) / (1.0 if divisor is None else divisor)
        changes[name] = {f"{velocity} [{'rad/s' if turning else 'm/s'}]": values}
    said = f"velocities by the momenta {', '.join(repr(known.names[one]) for one in momenta)} over the mass"
    said += " or the moment of inertia" if any(one.startswith("angular") for one in momenta) else ""
    return cells.edited(changes, said)


def _with_changes(cells: Sheet, options: TableOptions) -> Sheet:
    """The table with velocities after contact, or before it, in place of their changes, after minus before."""
    bare = {
        name: match["of"] or f"{match['before']}{match['end']}" if (match := _CHANGE.fullmatch(name)) else ""
        for name in cells.header
        if name not in options.chosen
    }
    changes = recognised_columns([one for one in bare.values() if one])[1]
    changed = {column: name for column, one in changes.names.items() for name in bare if bare[name] == one}
    changed = {column: name for column, name in changed.items() if column in _VELOCITIES and column not in OTHERS}
    space, own = recognised_columns([name for name in cells.header if name not in changed.values()], options.columns)
    names = options.names(cells, own)
    outcomes = [column for column in space.components["v_post"] if column in names]
    if outcomes and any(column in names for column in space.components["v_pre"]):
        return cells  # they may be errors of the velocities
    known, of_change = options.units_of(own), Units(options.units.stated, changes.units)
    changes_of = dict[str, dict[str, Cells]]()
    for column, name in changed.items():
        given, made, sign = (f"{column}_post", column, -1) if outcomes else (column, f"{column}_post", 1)
        if given not in names:
            continue
        there = cells.numbers(names[given], known.text(given))
        change = cells.numbers(name, of_change.text(column), of_change.factor(column) / known.factor(given))
        unit = known.text(given)
        made += f" [{unit}]" if given in own.units or unit != Units(options.units.stated).text(given) else ""
        changes_of[name] = {made: there + sign * change}
    if not changes_of:
        return cells
    rule = "before contact are those after it less" if outcomes else "after contact are those before it and"
    return cells.edited(changes_of, f"velocities {rule} the changes {', '.join(map(repr, changes_of))}")


_CHANGE = re.compile(
    r"(?:(?:change|jump|diff(?:erence)?|delta|[dδ∆])(?:[ _]*(?:of|in))?[ _]*(?P<of>\S.*))"
    r"|(?:(?P<before>\S+?)[ _]+(?:change|jump|diff(?:erence)?|delta)(?P<end>\b.*))",
    re.IGNORECASE,
)


def _by_components(cells: Sheet, options: TableOptions) -> Sheet:
    """The table with vx and vy in place of speeds and directions."""
    chosen = options.chosen
    known = recognised_columns([name for name in cells.header if name not in chosen])[1]
    if {"vx", "vy", "vx_post", "vy_post"} & {*known.names} or not {"speed", "height"} & {*known.names}:
        return cells
    if "speed" not in known.names or "speed_post" not in known.names or not direction_in(known):
        return _along_normal(cells, known, options)
    made, used = dict[str, Cells](), set[str]()
    units = Units(options.units.stated, known.units)
    for end, sign in (("", -1.0), ("_post", 1.0)):
        direction = next((f"{one}{end}" for one in OTHERS[3:] if f"{one}{end}" in known.names), None)
        if direction is None:
            if not options.asked:
                return cells
            names = {one: direction_in(known, one) or next(iter(known.others), "…") for one in ("", "_post")}
            mapped = ", ".join(f"direction_floor{one}: {setting_text(name)}" for one, name in names.items())
            raise DataError(
                f"{cells.path}: the angle {names[end]!r} may be from the floor or from its normal: say which, "
                f"'data.columns={{{mapped}}}' or direction_normal, direction_normal_post; or call it 'angle from "
                "floor' or 'angle from normal', with its unit"
            )
        speed, angle = known.names[f"speed{end}"], known.names[direction]
        values = cells.numbers(speed, units.text(f"speed{end}"))
        turn = cells.numbers(angle, units.text(direction), abs(units.factor(direction)))
        along, up = (np.sin(turn), np.cos(turn)) if "normal" in direction else (np.cos(turn), np.sin(turn))
        unit = f" [{units.text(f'speed{end}')}]" if f"speed{end}" in known.units else ""
        made |= {f"vx{end}{unit}": values * along, f"vy{end}{unit}": sign * values * up}
        used |= {speed, angle}
    kept = ((name, column) for name, column in cells.columns.items() if name not in used)
    return cells.with_columns([*kept, *made.items()], "velocities by speed and angle")


def _along_normal(cells: Sheet, known: Recognised, options: TableOptions) -> Sheet:
    """The table with vy in place of speeds, or heights from which bodies fall and to which they rebound in vacuum."""
    ends = {
        end: next((f"{one}{end}" for one in ("speed", "height") if f"{one}{end}" in known.names), None)
        for end in ("", "_post")
    }
    coefficient = _coefficient(cells, known) if ends["_post"] is None else None
    if ends[""] is None or (ends["_post"] is None and coefficient is None):
        return cells
    named = [known.names[column] for column in ends.values() if column and column.startswith("speed")]
    vocabulary = impact_vocabulary(PLANE)
    angles = [
        name
        for name in known.others
        if _ANGLES.intersection(name_words(name)) or unit_in(name, "theta", vocabulary).get("angle") == "deg"
    ]
    if named and angles and not options.asked:
        return cells
    if named and angles:
        raise DataError(
            f"{cells.path}: {angles[0]!r} may be the direction of {named[0]!r}: name it 'angle from floor' or 'angle "
            "from normal', with its unit, or leave it out of the table"
        )
    told = next((known.units[column] for column in ends.values() if column and column in known.units), {})
    stated = options.units.stated
    alike = "length" not in stated  # the one end without a unit is in that of the other
    of_ends = {column: known.units.get(column, told if alike else {}) for column in ends.values() if column}
    units, factor = Units(stated, of_ends), Units(stated).factor("vy")
    changes, speeds = dict[str, dict[str, Cells]](), np.zeros(0)
    for end, column in ends.items():
        if column is not None:
            values = np.abs(cells.quantity(known.names[column], column, units))
            speeds = np.sqrt(2 * GRAVITY * values) if column.startswith("height") else values
            changes[known.names[column]] = {f"vy{end}": (speeds if end else -speeds) / factor}
        elif coefficient is not None:
            changes[coefficient[0]] = {"vy_post": coefficient[1] * speeds / factor}
    said = " and ".join(map(repr, changes))
    said += f", both in {told['length']}" if alike and told and len(of_ends) > len({*known.units} & {*of_ends}) else ""
    return cells.edited(changes, f"bounces along the normal by {said}")


def _coefficient(cells: Sheet, known: Recognised) -> tuple[str, np.ndarray] | None:
    """The column of a coefficient of restitution, a speed after contact over that before it, and its numbers.

    Raises:
        DataError: they are above 1, and not said to be in per cent.
    """
    names = [name for name in known.others if is_coefficient(name)]
    if len(names) != 1:
        return None
    name = names[0]
    found = with_one_unit(cells.columns[name])
    values = cells.measured(names).numbers(name, "1 or %")
    if PER_CENT.search(name) or (found is not None and found[1] == "%"):
        return name, values / 100
    if (values > 1).any():
        raise DataError(
            f"{cells.path}: the coefficient of restitution {name!r} is up to {values.max():.4g}: call it '{name} [%]' "
            "if it is in per cent; it is the speed after contact over that before it, and no ratio of heights"
        )
    return name, values


def _relative_to_surface(cells: Sheet, options: TableOptions) -> Sheet:
    """The table with velocities relative to a racket, club or floor whose own velocity stands in it."""
    moving = {
        name: _SURFACE.sub(" ", name).strip()
        for name in cells.header
        if SURFACES.intersection(words := name_words(name))
        and not _DIRECTED.intersection(words)
        and cells.is_numeric(name)  # not the material of a surface
    }
    for name in options.chosen:
        moving.pop(name, None)
    surface = recognised_columns([*moving.values()])[1]
    by_bare = {bare: name for name, bare in moving.items()}
    own = recognised_columns([name for name in cells.header if name not in moving])[1]
    names = options.names(cells, own)
    changes, used = dict[str, dict[str, Cells]](), dict[str, Mapping[str, Cells]]()
    with_speeds = {*names}
    if not {"speed", "speed_post"} <= {*names} or not _have_senses(cells, names["speed"], names["speed_post"]):
        with_speeds.discard("speed")  # of numbers without signs it is not known whether the surface goes with the body
    for column in ("vx", "vy", "vz", "speed"):
        for end in ("", "_post"):
            source = f"{column}{end}" if f"{column}{end}" in surface.names else column
            source = "speed" if column == "vy" and source not in surface.names and "vx" not in names else source
            if source not in surface.names or f"{column}{end}" not in names or column not in with_speeds:
                continue
            name, moved = names[f"{column}{end}"], by_bare[surface.names[source]]
            ours, theirs = options.units_of(own), Units(options.units.stated, surface.units)
            factor = theirs.factor(source) / ours.factor(f"{column}{end}")
            velocity = cells.numbers(moved, theirs.text(source), factor)
            changes[name] = {name: cells.numbers(name, ours.text(f"{column}{end}")) - velocity}
            used[moved] = {}
    left = by_bare.get(surface.names.get("speed", ""))
    told = _with_senses(names)
    if options.asked and left not in (None, *used) and told is not None:
        racket = setting_text(str(left))
        raise DataError(
            f"{cells.path}: {left!r} is a velocity of what the body hits, which is taken off: along its normal, away "
            f"from it positive, 'data.columns={{{told}racket_vy: {racket}}}', along the surface racket_vx; where "
            f"velocities are relative to it already, 'data.covariates=[{racket}]'"
        )
    if not used:
        return cells
    said = f"velocities relative to the surface: {' and '.join(map(repr, used))} taken off before and after contact"
    return cells.edited(changes | used, said)


def _with_senses(names: Mapping[str, str]) -> str | None:
    """Settings of the normal velocities, which speeds are without their senses; None without any of them."""
    if "vy" in names:
        return ""
    if "speed" not in names:
        return None
    speed = setting_text(names["speed"])
    if "speed_post" not in names:  # as of a golf ball
        return f"vy: {{value: 0}}, vy_post: {speed}, "
    return f"vy: {{column: {speed}, factor: -1}}, vy_post: {setting_text(names['speed_post'])}, "


def _have_senses(cells: Sheet, before: str, after: str) -> bool:
    """Whether speeds are velocities along the normal, which turn their sign at contact."""
    turned = np.sign(cells.numbers(before, "")) * np.sign(cells.numbers(after, ""))
    return bool(np.nanmean(turned) < 0)


def direction_in(known: Recognised, end: str = "") -> str | None:
    """Return the column that is the direction of a speed, if only by the name "angle", else that of the body."""
    for column in (*OTHERS[2:], "theta"):
        name = known.names.get(f"{column}{end}")
        if name is not None and (column != "theta" or "angle" in name_words(name)):
            return name
    return None
