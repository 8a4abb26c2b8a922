"""Diagnosis: from measurements and a contact model to a named missing effect, or to an honest alternative.

pipeline         all stages in order, and the verdict
budget, noise    the shares of the error that are noise, explained, unexplained or out of reach
search           candidates, the selection among them, and the ladder of held-out errors
failure          regions in which a model fails
discrimination   effects that these data cannot tell apart, and the drops that would
unexplained      the remainder that flexible models predict, and formulas for it
"""

TYPE_CHECKING = False
if not TYPE_CHECKING:  # with it a type checker would take any name for one of this room
    from contactlearn.core.lazy import submodules

    __getattr__, __dir__ = submodules(__name__, __path__)
