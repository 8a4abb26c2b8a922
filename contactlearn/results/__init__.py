"""Results of the commands as types: each is written whole to its run folder, once, before anything is shown.

    provenance   data, versions, configuration and command behind every result
    estimates    laws, laws with effects, learned models and errors, as numbers
    training     the result of train
    evaluation   the result of evaluate
    held_out     its held-out trials with the predictions of every model
    tables       results by trial as CSV or Parquet
    transfer     the result of evaluate with `transfer`
    diagnosis    the result of diagnose with its provenance
    folder       the run folder: finds, writes and reads a result of any kind

Nothing here fits or draws.
"""

TYPE_CHECKING = False
if not TYPE_CHECKING:  # with it a type checker would take any name for one of this room
    from contactlearn.core.lazy import submodules

    __getattr__, __dir__ = submodules(__name__, __path__)
