"""Predictions beside measurements.

metrics             errors of held-out trials, with intervals
bounds              Best Post Hoc and the ideal rigid-body bound
partial_residuals   the share of the residual that one effect explains
"""
