"""Gaussian processes on GPyTorch, many at once, with fast paths for training them.

modules    GPyTorch modules from descriptions
processes  the common parts of exact and sparse processes
evidence   marginal likelihood of a batch with its closed-form gradient
bfgs       minimisation of a batch of small problems in lock step
training   training by GPyTorch's own objective
exact      processes that condition on every trial
sparse     processes with inducing points, for many trials
"""

import warnings

with warnings.catch_warnings():  # of scripting, which newer versions of torch show to everybody; GPyTorch stands on it
    warnings.filterwarnings("ignore", message=r".torch\.jit\.\w+. is deprecated")
    import linear_operator as linear_operator
