"""The audit: mistakes in the measurements themselves, before any physics is fitted to them.

result        findings and their evidence, as types
thresholds    every limit of a finding
consistency   moment balance, energy, outliers, contradictions of each trial
corrections   named corrections of measurements
conventions   hypotheses about units and axes, compared, and their findings
findings      the audit: every finding, in order
model_checks  outliers of a fitted model, and velocities before impact that vary by noise alone
"""

TYPE_CHECKING = False
if not TYPE_CHECKING:  # with it a type checker would take any name for one of this room
    from contactlearn.core.lazy import submodules

    __getattr__, __dir__ = submodules(__name__, __path__)
