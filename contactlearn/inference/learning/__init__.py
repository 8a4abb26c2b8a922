"""Learned models of the paper.

recipe   one model from one set of training trials
curves   learning curves of every model, and its transfer to other bodies
"""

TYPE_CHECKING = False
if not TYPE_CHECKING:  # with it a type checker would take any name for one of this room
    from contactlearn.core.lazy import submodules

    __getattr__, __dir__ = submodules(__name__, __path__)
