"""Results of the commands as types: each is written whole to its run folder, once, before anything is shown.

    types      laws, models and errors as numbers, the result of each command, and its provenance
    folder     the run folder: finds, writes and reads a result of any kind
    state      whether a run has finished
    tables     results by trial as CSV or Parquet; held-out trials with the predictions of every model
    runs       many runs: what they differ in, and one flat table of them

Nothing here fits or draws.
"""

from contactlearn.core.lazy import load_when_named

load_when_named(__name__)
