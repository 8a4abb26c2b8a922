"""Learned parts of a model: features of an impact, and Gaussian processes on them.

features    what the processes see: the 10-D state, X1, X2
regressor   standardised processes from features to impulse, wrench, velocity or (μ, ε)
gp          exact and sparse Gaussian processes, many at once
"""
