"""Impacts of contacts: contact points from the body's shape, the floor that they all touch, and the last refusals.

    floor        height and slope of the line through all contact points, robustly: contacts off it are no floor's
    approach     v_n < 0 before contact and P_n > 0, or whatever was touched was no floor
    covariance   of v_pre and v_post, each with the error of the instant in it

Here the moment balance I Δω = r_x P_n − r_y P_t also says in which sense angles grow, and in which unit they are: the
reading in which it holds is taken if all others leave at least twice as much of it.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float

from contactlearn.errors import DataError
from contactlearn.impacts import Impacts
from contactlearn.mechanics import contact_velocity
from contactlearn.shapes import Shape, contact_point
from contactlearn.tracks.result import Hit, Reason, Refusal
from contactlearn.tracks.track import Array

_OFF = 8.0  # robust standard deviations of a contact point's height from the floor
_LEAST = 1e-3  # m that it may be off in any case
_ROUNDS = 10


@dataclass(frozen=True, kw_only=True)
class Floor:
    """The floor as contact points show it: height in m at x = 0, slope in rad, their errors, and scatter in m."""

    height: float
    slope: float
    height_error: float
    slope_error: float
    scatter: float


def lowest_points(contacts: Sequence[Hit], shape: Shape) -> Float[Array, "n 2"]:
    """Contact points minus tracked points in m."""
    angles = torch.tensor([float(contact.pose[2]) for contact in contacts], dtype=torch.float64)
    return contact_point(shape, angles).numpy()


def find_floor(contacts: Sequence[Hit], shape: Shape) -> Floor:
    """Fit the floor to the contact points, by least absolute deviations."""
    r = lowest_points(contacts, shape)
    pose = np.stack([contact.pose for contact in contacts])
    x, y = pose[:, 0] + r[:, 0], pose[:, 1] + r[:, 1]
    wide = len(x) > 2 and np.ptp(x) > 0
    design = np.stack((np.ones_like(x), x - x.mean() if wide else np.zeros_like(x)), 1)
    weight = np.ones_like(x)
    fit, scatter = np.zeros(2), 0.0
    for _ in range(_ROUNDS):
        weighted = design * weight[:, None]
        fit = np.linalg.lstsq(weighted.T @ design, weighted.T @ y, rcond=None)[0]
        off = np.abs(y - design @ fit)
        scatter = max(float(np.median(off)), 1e-9)
        weight = 1 / np.maximum(off, scatter / 10)
    good = np.abs(y - design @ fit) <= 5 * 1.5 * scatter
    spread = float(np.std((y - design @ fit)[good])) if good.any() else scatter
    errors = spread / np.sqrt(max(good.sum(), 1)), spread / np.sqrt(max(float((design[good, 1] ** 2).sum()), 1e-300))
    return Floor(
        height=float(fit[0] - fit[1] * x.mean()),
        slope=float(np.arctan(fit[1])),
        height_error=float(errors[0]),
        slope_error=float(errors[1]) if wide else float("inf"),
        scatter=max(spread, 1e-9),
    )


def off_the_floor(contacts: Sequence[Hit], shape: Shape, floor: Floor) -> tuple[list[Hit], list[Refusal]]:
    """Contacts with the floor, and refusals of those with a hand or a wall."""
    kept, refusals = [], []
    r = lowest_points(contacts, shape)
    before = torch.from_numpy(np.stack([contact.v_pre for contact in contacts]))
    approach = contact_velocity(torch.from_numpy(r), before)[:, 1].numpy()
    for contact, arm, v_n in zip(contacts, r, approach, strict=True):
        x, y = contact.pose[0] + arm[0], contact.pose[1] + arm[1]
        above = float(y - floor.height - np.tan(floor.slope) * x)
        push = float(contact.v_post[1] - contact.v_pre[1])
        for holds, quantity, value, unit in (
            (
                abs(above) > max(_OFF * floor.scatter, _LEAST),
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


def moment_imbalance(contacts: Sequence[Hit], shape: Shape, gyration_squared: float, sense: int = 1) -> float:
    """Median share of the moment balance that is left over, in [0, 1], if angles grow in this sense."""
    angles = torch.tensor([sense * float(contact.pose[2]) for contact in contacts], dtype=torch.float64)
    r = contact_point(shape, angles).numpy()
    change = np.stack([contact.v_post - contact.v_pre for contact in contacts]) * (1, 1, sense)
    terms = np.stack(
        (change[:, 2], -r[:, 0] * change[:, 1] / gyration_squared, r[:, 1] * change[:, 0] / gyration_squared)
    )
    return float(np.median(np.abs(terms.sum(0)) / np.maximum(np.abs(terms).sum(0), 1e-12)))


def impacts_of(contacts: Sequence[Hit], shape: Shape, mass: float, inertia: float, name: str, source: str) -> Impacts:
    """Return the impacts of contacts with the floor.

    Args:
        contacts: in their order.
        shape: of the body.
        mass: in kg.
        inertia: in kg m² about the centre of mass.
        name: of the body.
        source: of the impacts.

    Raises:
        DataError: there are none, or two have one name.
    """
    if not contacts:
        raise DataError(f"{source}: no contact between two free flights was found")
    twice = [name for name, count in Counter(contact.name for contact in contacts).items() if count > 1]
    if twice:
        name = twice[0].rpartition("#")[0]
        raise DataError(f"{source}: two recordings are called {name!r}; each needs a name of its own")
    n = len(contacts)
    covariance = torch.from_numpy(np.stack([contact.covariance for contact in contacts]))
    pose = torch.from_numpy(np.stack([contact.pose for contact in contacts]))
    return Impacts(
        mass=torch.full((n,), mass, dtype=torch.float64),
        inertia=torch.full((n,), inertia, dtype=torch.float64),
        r=contact_point(shape, pose[:, 2]),
        q=pose,
        v_pre=torch.from_numpy(np.stack([contact.v_pre for contact in contacts])),
        v_post=torch.from_numpy(np.stack([contact.v_post for contact in contacts])),
        v_pre_cov=covariance[:, :3, :3],
        v_post_cov=covariance[:, 3:6, 3:6],
        trial=tuple(contact.name for contact in contacts),
        object=(name,) * n,
        shape=shape,
        source=source,
    )
