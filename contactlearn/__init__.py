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
    "Recipe": "contactlearn.learning",
    "learn": "contactlearn.learning",
    "identify_jointly": "contactlearn.fit_effects",
    "diagnose": "contactlearn.diagnosis.diagnosis",
    "Diagnosis": "contactlearn.diagnosis.diagnosis",
    "ContactLearnError": "contactlearn.errors",
    "DataError": "contactlearn.errors",
    "UnknownNameError": "contactlearn.errors",
}
_MODULES = (
    "bounds",
    "checkpoint",
    "data",
    "diagnosis",
    "effects",
    "errors",
    "features",
    "fit",
    "fit_effects",
    "gp",
    "impacts",
    "laws",
    "mechanics",
    "metrics",
    "model",
    "shapes",
    "study",
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
