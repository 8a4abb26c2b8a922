"""Learned parts of a model: features of an impact, and Gaussian processes on them.

features    what the processes see: the 10-D state, X1, X2
regressor   standardised processes from features to impulse, wrench, velocity or (μ, ε)
gp          exact and sparse Gaussian processes, many at once
"""

TYPE_CHECKING = False
if not TYPE_CHECKING:  # with it a type checker would take any name for one of this room
    from contactlearn.lazy import submodules

    __getattr__, __dir__ = submodules(__name__, __path__)
