"""Predictions against measurements.

metrics             errors of held-out trials, with intervals
reach               the share of the admissible impulses that a law can give
bounds              Best Post Hoc and the ideal rigid-body bound
partial_residuals   the share of the residual that one effect explains
"""

TYPE_CHECKING = False
if not TYPE_CHECKING:  # with it a type checker would take any name for one of this room
    from contactlearn.core.lazy import submodules

    __getattr__, __dir__ = submodules(__name__, __path__)
