"""Diagnosis: from measurements and a contact model to a named missing effect, or to an honest alternative.

pipeline         `diagnose`: audit, corrections, and the choice between one pass and subsamples
stages           all stages in order, from the laws to the result
sampling         large tables, diagnosed on subsamples
search           candidates, the selection among them, and the ladder of held-out errors
regions          regions in which a model fails
discrimination   confounded effects, and the drops that discriminate between them
drift            drift of the measurement
unexplained      the remainder that flexible models predict: its dependences, proxy effects, and formulas
error_budget     the shares of the error that are noise, explained, unexplained or out of reach
"""

TYPE_CHECKING = False
if not TYPE_CHECKING:  # with it a type checker would take any name for one of this room
    from contactlearn.core.lazy import submodules

    __getattr__, __dir__ = submodules(__name__, __path__)
