"""The audit: mistakes in the measurements themselves, before any physics is fitted to them.

result        findings and their evidence, as types
thresholds    every limit of a finding
moments       moment balance and energy, of impacts or of many hypotheses about them
trials        which trials cannot be real, and what the apparatus contradicts
corrections   named corrections of measurements
conventions   which units and axes: hypotheses by the contradictions under each
balance       whether the moment balance closes then
one_term      the one wrong term that closes the moment balance in space
parts         part of the trials in other units or axes
outline       the shape, where the contact points trace it
findings      the audit: one question after the other
model_checks  outliers of a fitted model, and velocities before impact that vary by noise alone
"""

from contactlearn.core.lazy import load_when_named

load_when_named(__name__)
