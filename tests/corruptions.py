"""Mistakes in tables of measurements, made by hand on the columns: corrections undo them, the audit finds them."""

import math
from collections.abc import Callable

import torch

from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.space import PLANE


def corrupt(impacts: Impacts, *names: str) -> Impacts:
    """Impacts as they would have been written down with these mistakes, made one after the other."""
    for name in names:
        fields = {field: columns for field, columns in PLANE.components.items() if getattr(impacts, field) is not None}
        old = {}
        for field, columns in fields.items():
            old |= zip(columns, getattr(impacts, field).reshape(len(impacts), -1).unbind(-1), strict=True)
        changes = (CORRUPTIONS_AND_UNITS | MEANINGS)[name].items()
        new = old | {column: change(old) for column, change in changes if column in old}
        values = {
            field: new[columns[0]] if len(columns) == 1 else torch.stack([new[column] for column in columns], -1)
            for field, columns in fields.items()
        }
        impacts = impacts.replace(validate=False, **values)
    return impacts


def scaled(factor: float, *names: str) -> dict:
    return {name: lambda old, name=name: old[name] * factor for name in names}


def exchanged(*pairs: tuple[str, str]) -> dict:
    moved = {a: (lambda old, b=b: old[b]) for a, b in pairs}
    return moved | {b: (lambda old, a=a: old[a]) for a, b in pairs}


POSE, POSE_POST = ("x", "y", "theta"), ("x_post", "y_post", "theta_post")
VELOCITY, VELOCITY_POST = ("vx", "vy", "omega"), ("vx_post", "vy_post", "omega_post")
CORRUPTIONS: dict[str, dict[str, Callable]] = {
    "mirrored_x": scaled(-1, "x", "x_post", "vx", "vx_post"),
    "mirrored_y": scaled(-1, "y", "y_post", "vy", "vy_post", "ry"),
    "mirrored_theta": scaled(-1, "theta", "theta_post", "omega", "omega_post"),
    "mirrored_omega": scaled(-1, "omega", "omega_post"),
    "mirrored_vy": scaled(-1, "vy", "vy_post"),
    "contact_point_sign": scaled(-1, "rx", "ry"),
    "contact_point_mirrored": scaled(-1, "rx"),
    "swapped_axes": exchanged(("x", "y"), ("x_post", "y_post"), ("vx", "vy"), ("vx_post", "vy_post"), ("rx", "ry")),
    **{
        name: {angle: (lambda old, angle=angle, turn=turn: old[angle] - turn) for angle in ("theta", "theta_post")}
        for name, turn in (("quarter_turn", math.pi / 2), ("quarter_turn_back", -math.pi / 2), ("half_turn", math.pi))
    },
    "swapped_pre_post": exchanged(*zip(POSE + VELOCITY, POSE_POST + VELOCITY_POST, strict=True)),
    "degrees": scaled(180 / math.pi, "theta", "theta_post", "omega", "omega_post"),
    "degrees_theta": scaled(180 / math.pi, "theta", "theta_post"),
    "degrees_omega": scaled(180 / math.pi, "omega", "omega_post"),
    "millimetres": scaled(1e3, "rx", "ry", "x", "y", "x_post", "y_post"),
    "millimetres_velocity": scaled(1e3, "vx", "vy", "vx_post", "vy_post"),
    "radians_omega": scaled(math.pi / 180, "omega", "omega_post"),
    "grams": scaled(1e3, "mass"),
}
"""What each column of a table is written as, from all columns, by the correction that undoes it."""

_SPEEDS = {"millimetres": 1e3, "centimetres": 1e2, "inches": 1 / 0.0254, "feet": 1 / 0.3048, "kmh": 3.6}
_SPEEDS |= {"mph": 3600 / 1609.344}
_SPINS = {"degrees": 180 / math.pi, "rpm": 60 / (2 * math.pi), "revolutions": 1 / (2 * math.pi)}
_SIDES = {"": ("", "_post"), "_pre": ("",), "_post": ("_post",)}
UNITS: dict[str, dict[str, Callable]] = {
    f"{unit}_{quantity}{side}": scaled(factor, *(f"{one}{time}" for one in columns for time in times))
    for quantity, columns, factors in (("velocity", ("vx", "vy"), _SPEEDS), ("omega", ("omega",), _SPINS))
    for unit, factor in factors.items()
    for side, times in _SIDES.items()
}
UNITS |= {
    name: scaled(_SPEEDS[name], "rx", "ry", "x", "y", "x_post", "y_post")
    for name in ("millimetres", "centimetres", "inches", "feet")
}
UNITS |= {
    "grams": scaled(1e3, "mass"),
    "ounces": scaled(16 / 0.45359237, "mass"),
    "pounds": scaled(1 / 0.45359237, "mass"),
    "mirrored_omega_pre": scaled(-1, "omega"),
    "mirrored_omega_post": scaled(-1, "omega_post"),
}
UNITS = {name: change for name, change in UNITS.items() if name not in CORRUPTIONS}
CORRUPTIONS_AND_UNITS = CORRUPTIONS | UNITS
"""The same, with all other units in which columns may be written."""
MEANINGS: dict[str, dict[str, Callable]] = {
    "changes_post": {
        f"{name}_post": (lambda old, name=name: old[f"{name}_post"] - old[name]) for name in ("vx", "vy", "omega")
    },
    "approach_speed": scaled(-1, "vy"),
}
"""The same where velocities mean something else."""
