"""contactlearn: learn rigid-body contact from measurements.

Compare contact models with measured planar impacts, see where they fail, and learn which
physical effect is missing.  The public names below are loaded when they are first used, so that
`import contactlearn` and the commands' `--help` stay fast; editors and type checkers see them all.
"""

from importlib import import_module

TYPE_CHECKING = False  # a type checker takes it for true; typing takes longer to load than the rest
if TYPE_CHECKING:
    from contactlearn import (
        audit,
        checkpoint,
        data,
        diagnosis,
        effects,
        errors,
        evaluation,
        identification,
        impacts,
        laws,
        learning,
        mechanics,
        model,
        regression,
        report,
        results,
        shapes,
        testing,
        tracks,
    )
    from contactlearn.citation import cite
    from contactlearn.diagnosis.observer import Observer
    from contactlearn.diagnosis.pipeline import diagnose
    from contactlearn.diagnosis.result import Diagnosis
    from contactlearn.diagnosis.thresholds import Thresholds
    from contactlearn.errors import ContactLearnError, DataError, UnknownNameError
    from contactlearn.identification.joint import identify_jointly
    from contactlearn.identification.shared import identify
    from contactlearn.impacts import Impacts, Prediction
    from contactlearn.laws import Law
    from contactlearn.learning.recipe import Recipe, learn
    from contactlearn.model import ContactModel

__version__ = "0.1.0"

__all__ = [
    "ContactLearnError",
    "ContactModel",
    "DataError",
    "Diagnosis",
    "Impacts",
    "Law",
    "Observer",
    "Prediction",
    "Recipe",
    "Thresholds",
    "UnknownNameError",
    "__version__",
    "audit",
    "checkpoint",
    "cite",
    "data",
    "diagnose",
    "diagnosis",
    "effects",
    "errors",
    "evaluation",
    "identification",
    "identify",
    "identify_jointly",
    "impacts",
    "laws",
    "learn",
    "learning",
    "mechanics",
    "model",
    "regression",
    "report",
    "results",
    "shapes",
    "testing",
    "tracks",
]

# Where a public name is defined; tests hold this table and the imports above to each other.
_HOME = {
    "ContactLearnError": "errors",
    "ContactModel": "model",
    "DataError": "errors",
    "Diagnosis": "diagnosis.result",
    "Impacts": "impacts",
    "Law": "laws",
    "Observer": "diagnosis.observer",
    "Prediction": "impacts",
    "Recipe": "learning.recipe",
    "Thresholds": "diagnosis.thresholds",
    "cite": "citation",
    "UnknownNameError": "errors",
    "diagnose": "diagnosis.pipeline",
    "identify": "identification.shared",
    "identify_jointly": "identification.joint",
    "learn": "learning.recipe",
}


if not TYPE_CHECKING:  # with it a type checker would take any name for one of this package

    def __getattr__(name: str) -> object:
        if name in _HOME:
            return getattr(import_module(f"contactlearn.{_HOME[name]}"), name)
        if name in __all__:
            return import_module(f"contactlearn.{name}")
        raise AttributeError(f"module 'contactlearn' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
