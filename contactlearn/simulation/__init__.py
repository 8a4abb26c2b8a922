"""Simulated measurements, made without the package's laws and effects where they judge an analysis.

hidden_effects       drops with physics that is hidden from the analysis
synthetic            drops with a known law and known noise
mujoco               drops simulated by MuJoCo, an optional extra
recordings           recordings of simulated bodies, with the faults of real trackers
recordings_mujoco    the same, with MuJoCo's flights and contacts
"""

from contactlearn.core.lazy import load_when_named

load_when_named(__name__)
