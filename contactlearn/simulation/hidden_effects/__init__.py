"""Mystery drops: simulated impacts with hidden physics, and a sealed account of what was hidden.

    world     what is true of body, floor and camera: from reported states to reported outcomes
    nature    contacts followed in small steps of impulse; springs: contacts with compliance, in time
    forms     how a hidden effect is written down; camera, floor, unknown: the effects; hidden: by name
    drops     `draw`: all of it from a seed
    seal      `load`: drops into a folder, with the sealed account; `reveal`: the account

The simulation shares no law and no effect with the analysis, so an effect that the analysis finds was
there to be found.
"""

from contactlearn.simulation.hidden_effects.drops import draw
from contactlearn.simulation.hidden_effects.hidden import EFFECTS, UNKNOWN, meant
from contactlearn.simulation.hidden_effects.seal import load, reveal

__all__ = ["EFFECTS", "UNKNOWN", "draw", "load", "meant", "reveal"]
