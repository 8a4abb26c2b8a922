"""What the few steps of a law in space leave out of its outcomes.

    v_post′ = v_post − (v⁺ in many steps − v⁺ in few)        of the law alone, fitted

The steps of `laws.hodograph` err by some thousandths of the impulse where the slip turns or all but stops.  Beside
little noise that would pass for scatter or for something unknown, and following every contact in many steps would take
the search ten times as long.  Effects change these errors by little.
"""

from contactlearn.laws import Law
from contactlearn.laws.hodograph import STEPS, followed_in
from contactlearn.mechanics.impacts import Impacts
from contactlearn.models.contact_model import ContactModel

_FINE = 64 * STEPS  # errors of less than 1e-4 of the impulse


def less_error_of_steps(impacts: Impacts, law: Law) -> Impacts:
    """Return impacts with which a law in few steps agrees as it would with `impacts` in many; the same in the plane."""
    model = ContactModel(law)
    with followed_in(_FINE):
        fine = model.outcome(impacts).v_post
    left_out = fine - model.outcome(impacts).v_post
    return impacts.replace(v_post=impacts.v_post - left_out, validate=False) if left_out.any() else impacts
