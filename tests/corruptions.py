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
        new = old | {column: change(old) for column, change in CORRUPTIONS[name].items() if column in old}
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
    "contact_point_sign": scaled(-1, "rx", "ry"),
    "contact_point_mirrored": scaled(-1, "rx"),
    "swapped_axes": exchanged(("x", "y"), ("x_post", "y_post"), ("vx", "vy"), ("vx_post", "vy_post"), ("rx", "ry")),
    "swapped_pre_post": exchanged(*zip(POSE + VELOCITY, POSE_POST + VELOCITY_POST, strict=True)),
    "degrees": scaled(180 / math.pi, "theta", "theta_post", "omega", "omega_post"),
    "degrees_theta": scaled(180 / math.pi, "theta", "theta_post"),
    "degrees_omega": scaled(180 / math.pi, "omega", "omega_post"),
    "millimetres": scaled(1e3, "rx", "ry", "x", "y", "x_post", "y_post"),
    "millimetres_velocity": scaled(1e3, "vx", "vy", "vx_post", "vy_post"),
    "grams": scaled(1e3, "mass"),
}
"""What each column of a table is written as, from all columns, by the correction that undoes it."""
