"""Physical effects: named corrections of a rigid contact, one a file, with few parameters each.

base           the seam: `Effect`, its four places and its parameters
state          what an effect sees of the impacts
registry       families and their forms by name: `catalogue()`, `find_effect(name, form)`
identity       `EffectId`, name and form of an effect
formula        effects from a line of mathematics
functions      splines, harmonics, reference speeds and other functions that effects share
impulse_path   changes of Routh's path while the contact lasts

Every other module is an effect.  docs/effects.md lists them with their formulas.
"""

from contactlearn.effects.base import PLACES, ChangesFriction, ChangesRestitution, Effect, Parameter, parameter
from contactlearn.effects.identity import EffectId
from contactlearn.effects.registry import (
    ENTRY_POINT,
    catalogue,
    choose_form,
    find_effect,
    forms_of,
    from_settings,
    named_effects,
)
from contactlearn.effects.state import State, columns

__all__ = [
    "ENTRY_POINT",
    "PLACES",
    "ChangesFriction",
    "ChangesRestitution",
    "Effect",
    "EffectId",
    "Parameter",
    "State",
    "catalogue",
    "choose_form",
    "columns",
    "find_effect",
    "forms_of",
    "from_settings",
    "named_effects",
    "parameter",
]
