"""Everything that fits or scores a model: identification, evaluation, learning curves, validation on held-out folds."""

TYPE_CHECKING = False
if not TYPE_CHECKING:  # with it a type checker would take any name for one of this room
    from contactlearn.core.lazy import submodules

    __getattr__, __dir__ = submodules(__name__, __path__)
