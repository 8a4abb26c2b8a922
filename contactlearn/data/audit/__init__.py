"""The audit: mistakes in the measurements themselves, before any physics is fitted to them.

result                findings and their evidence, as types
thresholds            every limit of a finding
consistency           moments, energy, outliers, contradictions of each trial
moments               the moment balance, fitted
corrections           named corrections of measurements
conventions           hypotheses about units and axes, compared
convention_findings   findings about units, axes and inertia
findings              the audit: every finding, in order
model_outliers        trials that a fitted model makes all but impossible
averaging             velocities before impact that vary by noise alone
"""

TYPE_CHECKING = False
if not TYPE_CHECKING:  # with it a type checker would take any name for one of this room
    from contactlearn.core.lazy import submodules

    __getattr__, __dir__ = submodules(__name__, __path__)
