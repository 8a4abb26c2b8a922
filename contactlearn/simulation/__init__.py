"""Simulated measurements, made without the package's laws and effects where they judge an analysis.

hidden_effects       drops with physics that is hidden from the analysis
synthetic            drops with a known law and known noise
mujoco               drops simulated by MuJoCo, an optional extra
recordings           recordings of simulated bodies, with the faults of real trackers
recordings_mujoco    the same, with MuJoCo's flights and contacts
"""

from typing import TYPE_CHECKING

from contactlearn.core.lazy import load_when_named

if TYPE_CHECKING:  # examples and notebooks name these; a type checker sees nothing of `load_when_named`
    from contactlearn.simulation import (
        hidden_effects as hidden_effects,
        mujoco as mujoco,
        recordings as recordings,
        recordings_mujoco as recordings_mujoco,
        synthetic as synthetic,
    )

load_when_named(__name__)
