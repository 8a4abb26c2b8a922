"""Bodies in the table have different friction."""

from contactlearn.effects.base import ChangesFriction, Effect
from contactlearn.effects.functions import ByBody


class BodyDependentFriction(ByBody, ChangesFriction, Effect):
    """Each object has its own μ: that of the law for the first, another by Δ for each of the others.

    It is not a change in time, which objects that were measured one after the other would show too
    (`parameter_drift`).
    """
