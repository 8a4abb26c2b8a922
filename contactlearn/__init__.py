"""contactlearn: learn rigid-body contact from measurements.

Compare contact models with measured planar impacts, see where they fail, and learn which
physical effect is missing.  The public names below are loaded when they are first used, so that
`import contactlearn` and the commands' `--help` stay fast; editors and type checkers see them all.
"""

from importlib import import_module

from contactlearn.core import __version__

TYPE_CHECKING = False  # a type checker takes it for true; typing takes longer to load than the rest
if TYPE_CHECKING:
    from contactlearn import (
        data,
        diagnosis,
        effects,
        inference,
        laws,
        mechanics,
        models,
        report,
        results,
        simulation,
        testing,
    )
    from contactlearn.core.errors import ContactLearnError, DataError, UnknownNameError
    from contactlearn.diagnosis.events import Event
    from contactlearn.diagnosis.pipeline import diagnose
    from contactlearn.diagnosis.result import Diagnosis
    from contactlearn.diagnosis.thresholds import Thresholds
    from contactlearn.inference.identification.joint import identify_jointly
    from contactlearn.inference.identification.shared import identify
    from contactlearn.inference.learning.recipe import Recipe, learn
    from contactlearn.laws import Law
    from contactlearn.mechanics.body_state import BodyState
    from contactlearn.mechanics.impacts import Impacts, Prediction
    from contactlearn.models import checkpoint
    from contactlearn.models.citation import cite
    from contactlearn.models.contact_model import ContactModel

__all__ = [
    "BodyState",
    "ContactLearnError",
    "ContactModel",
    "DataError",
    "Diagnosis",
    "Event",
    "Impacts",
    "Law",
    "Prediction",
    "Recipe",
    "Thresholds",
    "UnknownNameError",
    "__version__",
    "checkpoint",
    "cite",
    "data",
    "diagnose",
    "diagnosis",
    "effects",
    "identify",
    "identify_jointly",
    "inference",
    "laws",
    "learn",
    "mechanics",
    "models",
    "report",
    "results",
    "simulation",
    "testing",
]

# The module that defines each public name; tests hold this table and the imports above to each other.
_HOME = {
    "BodyState": "mechanics.body_state",
    "ContactLearnError": "core.errors",
    "ContactModel": "models.contact_model",
    "DataError": "core.errors",
    "Diagnosis": "diagnosis.result",
    "Event": "diagnosis.events",
    "Impacts": "mechanics.impacts",
    "Law": "laws",
    "Prediction": "mechanics.impacts",
    "Recipe": "inference.learning.recipe",
    "Thresholds": "diagnosis.thresholds",
    "UnknownNameError": "core.errors",
    "checkpoint": "models",
    "cite": "models.citation",
    "diagnose": "diagnosis.pipeline",
    "identify": "inference.identification.shared",
    "identify_jointly": "inference.identification.joint",
    "learn": "inference.learning.recipe",
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
