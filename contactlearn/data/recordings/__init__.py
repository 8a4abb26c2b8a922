"""From recordings of poses to contacts between free flights, with their errors.

track        recordings as read, and tracks in the plane of motion
readers      one small module a format
conventions  gravity, units, axes, quaternion order: found from free flight or stated
angles       unit and sense of angles: found from the impacts or stated
frame        the way from a recording to a track
markers      poses and shapes from markers
flights      free flights of a track
contacts     contacts between two flights, and refusals
floor        bodies at rest, and the floor that they share with contacts
survey       all recordings of a file or folder
result       types of what is found
thresholds   every limit of a decision
sufficiency  how many samples show a quantity
"""

from contactlearn.core.lazy import load_when_named

load_when_named(__name__)

SOURCES = tuple(
    f"contactlearn.{name}.load" for name in ("data.tracks", "simulation.recordings", "simulation.recordings_mujoco")
)
"""Of data: those that read recordings."""
