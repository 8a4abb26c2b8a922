"""Parameters from measurements.

shared      one (μ, ε) for all trials, from random subsets, as in the paper
per_trial   (μ, ε) of every single trial
joint       (μ, ε) together with the parameters of the effects, with standard errors
problem     the residual of a law with effects over subsets of trials
robust      the robust likelihood that the joint fit maximises
errors_in_variables   the states before impact, where v_pre is known to be noisy
"""

from contactlearn.core.lazy import load_when_named

load_when_named(__name__)
