"""The audit: mistakes in the measurements themselves, before any physics is fitted to them.

result                findings and their evidence, as types
thresholds            every limit of a finding
consistency           moment balance, energy, outliers, contradictions of each trial
corrections           named corrections of measurements
conventions           hypotheses about units and axes, compared
convention_findings   findings about units, axes and inertia
findings              the audit: every finding, in order
model_outliers        trials that a fitted model makes all but impossible
averaging             velocities before impact that vary by noise alone
"""
