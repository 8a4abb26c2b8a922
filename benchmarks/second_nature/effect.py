"""A planted effect: a name of the catalogue, or of nothing in it, and where it enters nature."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from second_nature.compliant import Compliance
from second_nature.path import Contacts

ANY = ("ellipse", "square", "rectangle", "disc", "triangle")
CORNERED = ("square", "rectangle", "triangle")
OBLONG = ("ellipse", "rectangle")


@dataclass(frozen=True)
class Circumstances:
    """What a form may depend on: states before contact in the contact's frame, and the place in the session."""

    contacts: Contacts
    theta: np.ndarray
    x: np.ndarray
    share: np.ndarray
    """Of the session that has passed, 0 to 1."""

    @property
    def speed(self):
        """|v_n| [n]."""
        return -self.contacts.approach(self.contacts.v)

    @property
    def slip(self):
        """v_t [n]."""
        return self.contacts.slip(self.contacts.v)

    @property
    def omega(self):
        """ω before contact [n]."""
        return self.contacts.v[:, 2]

    @property
    def rho(self):
        """Radius of gyration [n]."""
        return np.sqrt(self.contacts.inertia / self.contacts.mass)

    @property
    def lever(self):
        """r_x/ρ [n]."""
        return self.contacts.r[:, 0] / self.rho


@dataclass(frozen=True)
class Geometry:
    """How the real set-up differs from the declared one.

    `slope` of the floor in rad; `frame` the turn of the whole measurement frame; `com`, `scale`, `corner` of the body
    (com and corner in units of a); `angle` is added to the recorded θ; `delay` in s: the pose is recorded that much
    before contact; `inertia` is ln(I / declared).
    """

    slope: float = 0.0
    frame: float = 0.0
    com: tuple[float, float] = (0.0, 0.0)
    scale: tuple[float, float] = (1.0, 1.0)
    corner: float = 0.0
    angle: float = 0.0
    delay: float = 0.0
    inertia: float = 0.0


Form = Callable[[Circumstances], np.ndarray]


@dataclass(frozen=True)
class Effect:
    """Hooks of one physical effect; those left out do nothing.

    `eps` is added to ε and `mu` multiplies μ, by trial; `friction` multiplies μ by the present slip along the path;
    `moment` is a moment per normal impulse in m by the present velocity [n, 3]; `after` changes the velocity that the
    contact leaves.  `accepted` are the right names: more than one only where the physics is the same.
    `point` says which contact points a table may hold for the effect to be visible: seen, computed or either.
    """

    name: str
    form: str
    accepted: tuple[str, ...]
    eps: Form | None = None
    mu: Form | None = None
    friction: Callable[[np.ndarray], np.ndarray] | None = None
    moment: Callable[[Circumstances, np.ndarray], np.ndarray] | None = None
    rebound: float = 0.0
    after: Callable[[Circumstances, np.ndarray], np.ndarray] | None = None
    geometry: Geometry = field(default_factory=Geometry)
    compliance: Compliance | None = None
    bodies: tuple[str, ...] = ANY
    point: str = "either"
    variables: tuple[str, ...] = ()
    """Of an effect that is in no catalogue: the symbols that it depends on."""
