"""Impacts of contacts: contact points from the body's shape, and the covariance of v_pre and v_post.

The error of the instant of a contact is in both covariances.  Here the moment balance I Δω = r_x P_n − r_y P_t also
says in which sense angles grow, and in which unit they are: the reading in which it holds leaves the least of it.
"""

from collections import Counter
from collections.abc import Sequence

import numpy as np
import torch

from contactlearn.core.errors import DataError
from contactlearn.data.recordings.result import Hit
from contactlearn.mechanics.apparatus import Apparatus
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.shapes import Shape, contact_point


def moment_imbalance(contacts: Sequence[Hit], shape: Shape, gyration_squared: float, sense: int = 1) -> float:
    """Median share of the moment balance that is left over, in [0, 1], if angles grow in this sense."""
    angles = torch.tensor([sense * float(contact.pose[2]) for contact in contacts], dtype=torch.float64)
    r = contact_point(shape, angles).numpy()
    change = np.stack([contact.v_post - contact.v_pre for contact in contacts]) * (1, 1, sense)
    terms = np.stack(
        (change[:, 2], -r[:, 0] * change[:, 1] / gyration_squared, r[:, 1] * change[:, 0] / gyration_squared)
    )
    return float(np.median(np.abs(terms.sum(0)) / np.maximum(np.abs(terms).sum(0), 1e-12)))


def impacts_of(
    contacts: Sequence[Hit],
    shape: Shape,
    mass: float,
    inertia: float,
    name: str,
    source: str,
    apparatus: Apparatus | None = None,
) -> Impacts:
    """Return the impacts of contacts with the floor.

    Args:
        contacts: in their order.
        shape: of the body.
        mass: in kg.
        inertia: in kg m² about the centre of mass.
        name: of the body.
        source: of the impacts.
        apparatus: what is known of it.

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
        apparatus=apparatus,
    )
