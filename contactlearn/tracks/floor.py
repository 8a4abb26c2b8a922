"""The floor that all contacts touch, robustly, and the refusals of contacts with something else.

    floor      height and slope of the line through all contact points: contacts off it are no floor's; and the angle by
               which the body's zero of θ is off, which moves them up and down as the body turns
    approach   v_n < 0 before contact and P_n > 0, or whatever was touched was no floor
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float

from contactlearn.apparatus import Measured
from contactlearn.mechanics import contact_velocity
from contactlearn.shapes import Shape, contact_point
from contactlearn.tracks.result import Hit, Reason, Refusal
from contactlearn.tracks.thresholds import FloorThresholds
from contactlearn.tracks.track import Array

_ROUNDS, _TURNS = 10, 2
_FEW = 3  # contacts to which a slope is fitted, so that those off it can be refused
_STEP = 1e-4  # rad, of a difference quotient
_ROUND = 1e-3  # relative change of the height with θ up to which a body is round


@dataclass(frozen=True, kw_only=True)
class Floor:
    """The floor as contact points show it.

    Args:
        height: in m at x = 0.
        slope: in rad; None where contacts are too few or in one place.
        orientation: in rad, to be added to θ; None where contacts are too few or the body is round.
        scatter: of the contact points about it in m.
    """

    height: Measured
    slope: Measured | None
    orientation: Measured | None
    scatter: float

    def above(self, contacts: Sequence[Hit], shape: Shape) -> Float[Array, " n"]:
        """Height of contact points above the floor in m."""
        slope, orientation = (0.0 if one is None else one.value for one in (self.slope, self.orientation))
        points = _lowest(contacts, shape, orientation)
        return points[:, 1] - self.height.value - np.tan(slope) * points[:, 0]


def _lowest(contacts: Sequence[Hit], shape: Shape, turned: float = 0.0) -> Float[Array, "n 2"]:
    """Contact points in m, of a body that is turned further by an angle in rad."""
    pose = np.stack([contact.pose for contact in contacts])
    return pose[:, :2] + contact_point(shape, torch.from_numpy(pose[:, 2] + turned)).numpy()


def find_floor(contacts: Sequence[Hit], shape: Shape, limits: FloorThresholds = FloorThresholds()) -> Floor:
    """Fit the floor to the contact points, robustly.

    An offset of the tracked point from the centre of the shape, which also moves the contact points up and down as the
    body turns, is fitted beside the body's zero of θ: where the two look alike the zero has a large error.
    """
    floor = _fitted_floor(contacts, shape, 0.0, limits)
    for _ in range(_TURNS):
        if floor.orientation is not None:
            floor = _fitted_floor(contacts, shape, floor.orientation.value, limits)
    return floor


def _fitted_floor(contacts: Sequence[Hit], shape: Shape, turned: float, limits: FloorThresholds) -> Floor:
    """Fit the floor, linearised about a body that is turned further by an angle in rad."""
    points, theta = _lowest(contacts, shape, turned), np.array([contact.pose[2] for contact in contacts])
    rising = (_lowest(contacts, shape, turned + _STEP) - _lowest(contacts, shape, turned - _STEP))[:, 1] / (2 * _STEP)
    told = {"height": np.ones(len(points))}
    if len(points) >= _FEW and np.ptp(points[:, 0]) > 0:
        told["slope"] = points[:, 0]
    if len(points) >= 2 * limits.contacts_of_a_slope and np.std(rising) > _ROUND * shape.gyration_squared() ** 0.5:
        told |= {"orientation": -rising, "sine": np.sin(theta), "cosine": np.cos(theta)}
    design, weight = np.stack([*told.values()], 1), np.ones(len(points))
    off = points[:, 1] - np.median(points[:, 1])
    for _ in range(_ROUNDS):
        fit = np.linalg.lstsq(design * weight[:, None] ** 0.5, points[:, 1] * weight**0.5, rcond=None)[0]
        off = np.abs(points[:, 1] - design @ fit)
        weight = 1 / np.maximum(off, max(float(np.median(off)), 1e-9) / 10)
    good = off <= 5 * 1.5 * max(float(np.median(off)), 1e-9)
    fit = np.linalg.lstsq(design[good], points[good, 1], rcond=None)[0]
    free = max(int(good.sum()) - len(fit), 1)
    spread = max(float(((points[good, 1] - design[good] @ fit) ** 2).sum() / free) ** 0.5, 1e-9)
    errors = spread * np.linalg.pinv(design[good].T @ design[good], hermitian=True).diagonal() ** 0.5
    found = {name: (float(x), float(error)) for name, x, error in zip(told, fit, errors, strict=True)}
    slope, zero = found.get("slope"), found.get("orientation")
    return Floor(
        height=Measured(value=found["height"][0], error=found["height"][1]),
        slope=slope and Measured(value=float(np.arctan(slope[0])), error=slope[1] / (1 + slope[0] ** 2)),
        orientation=zero and Measured(value=turned + zero[0], error=zero[1]),
        scatter=spread,
    )


def off_the_floor(
    contacts: Sequence[Hit], shape: Shape, floor: Floor, limits: FloorThresholds = FloorThresholds()
) -> tuple[list[Hit], list[Refusal]]:
    """Contacts with the floor, and refusals of those with a hand or a wall."""
    kept, refusals = [], []
    pose = np.stack([contact.pose for contact in contacts])
    r = _lowest(contacts, shape) - pose[:, :2]
    before = torch.from_numpy(np.stack([contact.v_pre for contact in contacts]))
    approach = contact_velocity(torch.from_numpy(r), before)[:, 1].numpy()
    for contact, above, v_n in zip(contacts, floor.above(contacts, shape).tolist(), approach, strict=True):
        push = float(contact.v_post[1] - contact.v_pre[1])
        for holds, quantity, value, unit in (
            (
                abs(above) > max(limits.off_sigmas * floor.scatter, limits.off_least),
                "height of the contact above the floor",
                1e3 * above,
                "mm",
            ),
            (v_n >= 0, "normal velocity of the contact point", float(v_n), "m/s"),
            (push <= 0, "change of the upward velocity", push, "m/s"),
        ):
            if holds:
                refusals.append(
                    Refusal(
                        recording=contact.recording,
                        reason=Reason.HAND_OR_WALL,
                        quantity=quantity,
                        value=value,
                        unit=unit,
                        time=(contact.time, contact.time),
                    )
                )
                break
        else:
            kept.append(contact)
    return kept, refusals
