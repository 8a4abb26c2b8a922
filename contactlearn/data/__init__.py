"""Measurements: bytes to impacts.  A source is a module with one function `load(...) -> Impacts`.

table          the user's own CSV or Parquet file (and `save`, the exporter)
tracks         recordings of tracked poses: impacts with covariances, and refusals with reasons
ellipse_drops  the published drops of Fazeli et al. (2017)
headers        settings of a source from the names of a file's columns
blocks         measurements that need not fit in memory
recordings     how recordings become impacts: readers, conventions, flights, contacts
audit          mistakes in the measurements, and their corrections

A source takes plain keyword arguments, reads or simulates, and leaves validation to `Impacts`.
Nothing downstream reads a file again.  Simulated sources are in `contactlearn.simulation`.
"""

TYPE_CHECKING = False
if not TYPE_CHECKING:  # with it a type checker would take any name for one of this room
    from contactlearn.core.lazy import submodules

    __getattr__, __dir__ = submodules(__name__, __path__)
