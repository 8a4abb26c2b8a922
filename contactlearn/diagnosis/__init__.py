"""Diagnosis: from measurements and a contact model to a named missing effect, or to an honest alternative.

pipeline         `diagnose`: audit, corrections, and the choice between one pass and subsamples
options          `DiagnoseOptions`: candidates, laws, noise, time and limits
stages           all stages in order, from the laws to the result
sampling         large tables, diagnosed on subsamples
search           candidates, the selection among them, and the ladder of held-out errors
regions          regions in which a model fails
discrimination   confounded effects, and the drops that discriminate between them
drift            drift of the measurement
unexplained      the remainder that flexible models predict: its dependences, proxy effects, and formulas
error_budget     the shares of the error that are noise, explained, unexplained or out of reach
"""

from contactlearn.core.lazy import load_when_named

load_when_named(__name__)
