"""Parameters from measurements.

shared      one (μ, ε) for all trials, from random subsets, as in the paper
per_trial   (μ, ε) of every single trial
joint       (μ, ε) together with the parameters of the effects, with standard errors
problem     the residual of a law with effects over subsets of trials
robust      the robust likelihood that the joint fit maximises
errors_in_variables   the states before impact, where v_pre is known to be noisy
"""

TYPE_CHECKING = False
if not TYPE_CHECKING:  # with it a type checker would take any name for one of this room
    from contactlearn.core.lazy import submodules

    __getattr__, __dir__ = submodules(__name__, __path__)
