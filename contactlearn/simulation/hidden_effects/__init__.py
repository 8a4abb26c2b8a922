"""The ground-truth simulator: impacts with hidden effects, and the truth about them.

    world     true body, floor and camera: from reported states to reported outcomes
    contact   rigid contacts in steps of impulse, compliant ones in time
    effects   the effects that may be hidden, by name, each in one form or several
    drops     `draw`: impacts and their truth from a seed
    truth     `load`: drops and truth into a folder; `reveal`: the truth in words

The simulator shares no law and no effect with the analysis, so that an effect that the analysis finds was there to be
found.
"""

from contactlearn.simulation.hidden_effects.drops import draw
from contactlearn.simulation.hidden_effects.effects import EFFECTS, UNKNOWN, comparable_parameters
from contactlearn.simulation.hidden_effects.truth import load, reveal

__all__ = ["EFFECTS", "UNKNOWN", "comparable_parameters", "draw", "load", "reveal"]
