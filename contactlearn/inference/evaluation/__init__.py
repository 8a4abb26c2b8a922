"""Predictions against measurements.

metrics             errors of held-out trials, with intervals
reach               the share of the admissible impulses that a law can give
bounds              Best Post Hoc and the ideal rigid-body bound
partial_residuals   the share of the residual that one effect explains
"""

from contactlearn.core.lazy import load_when_named

load_when_named(__name__)
