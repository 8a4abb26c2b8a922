"""Scatter of the contact: what no model of the state can predict, named and measured, one component a file.

base           `Component`: how a deviation enters law and state

Every other module is a component.  `COMPONENTS` lists them; `contactlearn.inference.identification.scatter` estimates
their standard deviations, and decides which of them the data want.
"""

from contactlearn.core.errors import UnknownNameError
from contactlearn.scatter.base import Component
from contactlearn.scatter.contact_point import ContactPoint
from contactlearn.scatter.friction import Friction
from contactlearn.scatter.normal import Normal
from contactlearn.scatter.normal_with_point import NormalWithPoint
from contactlearn.scatter.orientation import Orientation
from contactlearn.scatter.restitution import Restitution

COMPONENTS: tuple[type[Component], ...] = (
    Restitution,
    Friction,
    Normal,
    NormalWithPoint,
    ContactPoint,
    Orientation,
)
"""All components; the last is noise of the instrument, which is like scatter of the contact."""

__all__ = [
    "COMPONENTS",
    "Component",
    "ContactPoint",
    "Friction",
    "Normal",
    "NormalWithPoint",
    "Orientation",
    "Restitution",
    "find_component",
]


def find_component(name: str) -> type[Component]:
    """Return the class of a component by name; one of another package is known once that has been imported.

    Raises:
        UnknownNameError: no such component.
    """
    known = {kind.name: kind for kind in Component.__subclasses__()}
    if name not in known:
        raise UnknownNameError("component of scatter", name, known)
    return known[name]
