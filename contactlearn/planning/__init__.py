"""Planning: the impacts to measure next, and the point at which to stop.

rig           limits of the apparatus, and the bodies that it drops; settings to states before impact
hypotheses    the models between which a diagnosis leaves a choice, and effects that it has not yet seen
criteria      expected information of a drop: about names, parameters, predictions, and empty parts of the space
result        `Plan`, its drops and its forecast
stopping      the rule by which a sequence of plans ends
design        `plan`, which chooses a batch of drops
measurement  drops of a plan made in a simulated laboratory
"""

from typing import TYPE_CHECKING

from contactlearn.core.lazy import load_when_named

if TYPE_CHECKING:  # examples and notebooks name these; a type checker sees nothing of `load_when_named`
    from contactlearn.planning import measurement as measurement, rig as rig

load_when_named(__name__)
