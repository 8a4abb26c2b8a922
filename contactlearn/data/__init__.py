"""Where measurements come from: each module has one function `load(...) -> Impacts`.

    table          the user's own CSV or Parquet file (and `save`, the exporter)
    tracks         recordings of tracked poses: impacts with covariances, and refusals with reasons
    ellipse_drops  the published drops of Fazeli et al. (2017)
    synthetic      simulated drops with a known law and known noise
    tracks_synthetic  recordings of simulated bodies, with the faults of real trackers
    tracks_mujoco     the same, with MuJoCo's flights and contacts
    mystery        simulated drops with physics that is hidden from whoever analyses them
    mujoco         drops simulated by MuJoCo, an optional extra

A source takes plain keyword arguments, reads or simulates, and leaves validation to `Impacts`.
Nothing downstream reads a file again.
"""

TYPE_CHECKING = False
if not TYPE_CHECKING:  # with it a type checker would take any name for one of this room
    from contactlearn.lazy import submodules

    __getattr__, __dir__ = submodules(__name__, __path__)
