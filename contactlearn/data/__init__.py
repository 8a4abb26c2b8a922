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

from contactlearn.core.lazy import load_when_named

load_when_named(__name__)
