"""contactlearn: learn rigid-body contact from measurements.

Compare contact models with measured planar impacts, see where they fail, and learn which
physical effect is missing.  The public names below are loaded when they are first used, so that
`import contactlearn` and the commands' `--help` stay fast.
"""

from importlib import import_module

__version__ = "0.1.0"
_PUBLIC = {
    "Impacts": "contactlearn.impacts",
    "Prediction": "contactlearn.impacts",
    "ContactModel": "contactlearn.model",
    "Law": "contactlearn.laws",
    "Recipe": "contactlearn.learning.recipe",
    "learn": "contactlearn.learning.recipe",
    "identify_jointly": "contactlearn.identification.joint",
    "diagnose": "contactlearn.diagnosis.pipeline",
    "Diagnosis": "contactlearn.diagnosis.pipeline",
    "ContactLearnError": "contactlearn.errors",
    "DataError": "contactlearn.errors",
    "UnknownNameError": "contactlearn.errors",
}
_MODULES = (
    "audit",
    "checkpoint",
    "data",
    "diagnosis",
    "effects",
    "errors",
    "evaluation",
    "identification",
    "impacts",
    "laws",
    "learning",
    "mechanics",
    "model",
    "regression",
    "shapes",
)
__all__ = [*_PUBLIC, *_MODULES, "__version__"]


def __getattr__(name: str):
    if name in _PUBLIC:
        return getattr(import_module(_PUBLIC[name]), name)
    if name in _MODULES:
        return import_module(f"contactlearn.{name}")
    raise AttributeError(f"module 'contactlearn' has no attribute {name!r}")


def __dir__():
    return __all__
