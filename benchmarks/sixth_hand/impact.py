"""The impact: trials as they really are, by a law of `third_hand.laws` or a soft contact, with what is hidden in it."""

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fourth_hand.bodies import Body
from sixth_hand.bodies import touching
from sixth_hand.soft import Soft, soft_contact
from third_hand.laws import impulse


@dataclass(eq=False)
class Impact:
    """All trials of a table, which effects change in place.

    By trial: `index` of the body, `x`, `theta`, `v` = (v_x, v_y, ω) before, `mass`, `inertia`, the contact point `r`
    from the centre [n, 2], and `order` from 0.  `mu` and `eps` of the law, the floor's `tilt` and velocity `floor`
    [n, 2], and the `full` inverse inertia [n, 3, 3] where it is not that of the mass and inertia.  After the law the
    impulse `P` = (P_t, P_n) and the velocities `post`.
    """

    bodies: Sequence[Body]
    index: np.ndarray
    x: np.ndarray
    theta: np.ndarray
    v: np.ndarray
    soft: Soft
    mass: np.ndarray = field(init=False)
    inertia: np.ndarray = field(init=False)
    r: np.ndarray = field(init=False)
    order: np.ndarray = field(init=False)
    floor: np.ndarray = field(init=False)
    tilt: Any = 0.0
    full: np.ndarray | None = None
    mu: Any = 0.0
    eps: Any = 0.0
    P: Any = None
    post: Any = None

    def __post_init__(self):
        self.mass, self.inertia = (
            np.array([getattr(body, name) for body in self.bodies])[self.index] for name in ("mass", "inertia")
        )
        self.order, self.floor = np.arange(len(self.x), dtype=float), np.zeros((len(self.x), 2))
        self.r = self.touching(self.theta)

    def touching(self, theta: np.ndarray, tilt: float = 0.0, radius: float = 0.0) -> np.ndarray:
        """Contact points that the outlines give."""
        r = np.zeros((len(theta), 2))
        for k, body in enumerate(self.bodies):
            mine = self.index == k
            r[mine] = touching(body, theta[mine], tilt, radius)
        return r

    @property
    def J(self) -> np.ndarray:
        """Velocity (t, n) of the contact point by (v_x, v_y, ω) [n, 2, 3]."""
        tilt = np.broadcast_to(np.asarray(self.tilt, float), self.x.shape)
        c, s = np.cos(tilt), np.sin(tilt)
        rx, ry = self.r.T
        return np.stack([np.stack([c, s, s * rx - c * ry], 1), np.stack([-s, c, c * rx + s * ry], 1)], 1)

    @property
    def inverse(self) -> np.ndarray:
        """Inverse inertia [n, 3, 3]."""
        if self.full is not None:
            return self.full
        return np.stack([1 / self.mass, 1 / self.mass, 1 / self.inertia], 1)[:, :, None] * np.eye(3)

    @property
    def W(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Inverse mass at the contact, W_tt, W_tn, W_nn."""
        J = self.J
        W = J @ self.inverse @ np.swapaxes(J, 1, 2)
        return W[:, 0, 0], W[:, 0, 1], W[:, 1, 1]

    @property
    def contact_velocity(self) -> np.ndarray:
        """Of the contact point over the floor, (t, n)."""
        return np.einsum("nij,nj->ni", self.J, self.v) - self.floor

    @property
    def slip(self) -> np.ndarray:
        """Tangential velocity of the contact point before impact."""
        return self.contact_velocity[:, 0]

    @property
    def approach(self) -> np.ndarray:
        """Normal speed before impact."""
        return np.maximum(-self.contact_velocity[:, 1], 1e-3)

    def change(self, P: np.ndarray) -> np.ndarray:
        """Velocities [n, 3] that an impulse (P_t, P_n) at the contact point brings."""
        return np.einsum("nij,nkj,nk->ni", self.inverse, self.J, P)


def _nothing(now: Impact) -> None:
    pass


@dataclass(frozen=True, eq=False)
class Hidden:
    """An effect: its name, and what it changes of an impact before the law and after it, or in place of it."""

    what: str
    before: Callable[[Impact], None] = _nothing
    after: Callable[[Impact], None] = _nothing
    solve: Callable[[Impact], np.ndarray] | None = None


def struck(trials: Impact, law: str, mu: np.ndarray, eps: np.ndarray, hidden: Sequence[Hidden]) -> Impact:
    """The impact of these trials by a law, or a `soft` contact, with μ and ε."""
    now = copy(trials)
    now.mu, now.eps = mu, eps
    for one in hidden:
        one.before(now)
    now.mu, now.eps = np.clip(now.mu, 0.0, 3.0), np.clip(now.eps, 0.02, 0.995)
    solve = next((one.solve for one in hidden if one.solve), None)
    if solve is not None:
        now.post = solve(now)
    elif law == "soft":
        now.post, now.P = soft_contact(now)
    else:
        vc = now.contact_velocity
        now.P = np.stack(impulse(law, now.W, *vc.T, now.mu, now.eps), 1)
        now.post = now.v + now.change(now.P)
    for one in hidden:
        one.after(now)
    return now
