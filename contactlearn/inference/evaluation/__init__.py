"""Predictions against measurements.

metrics             errors of held-out trials, with intervals
impulse_space       what laws give at an impact, and can give: impulses, bound, reach, paths of the slip
reach               the share of the admissible impulses that a law can give
variables           what errors are compared along: orientation, lever arm, slip, mode
bounds              Best Post Hoc and the ideal rigid-body bound
partial_residuals   the share of the residual that one effect explains
"""

from contactlearn.core.lazy import load_when_named

load_when_named(__name__)
