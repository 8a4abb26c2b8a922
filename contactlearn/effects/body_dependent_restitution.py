"""Bodies in the table have different restitution."""

from contactlearn.effects.base import ChangesRestitution, Effect
from contactlearn.effects.functions import ByBody


class BodyDependentRestitution(ByBody, ChangesRestitution, Effect):
    """Each object has its own ε: that of the law for the first, another by Δ for each of the others.

    It is not a change in time, which objects that were measured one after the other would show too
    (`parameter_drift`).
    """
