"""contactlearn: learn rigid-body contact from measurements.

    import contactlearn as cl

    impacts = cl.read_table("drops.csv", shape=cl.shapes.Ellipse((0.035, 0.025)))
    found = cl.diagnose(impacts)
    fit = cl.fit(impacts, found.law, found.effects)
    print(fit.summary())

The names below are loaded when they are first used, so that `import contactlearn` and the commands' `--help` stay fast;
editors and type checkers see them all.  The rooms (`contactlearn.mechanics`, `contactlearn.inference` …) have the rest.
"""

from importlib import import_module

from contactlearn.core import __version__

TYPE_CHECKING = False  # a type checker takes it for true; typing takes longer to load than the rest
if TYPE_CHECKING:
    from contactlearn import data as data
    from contactlearn import diagnosis as diagnosis
    from contactlearn import effects, laws, simulation
    from contactlearn import inference as inference
    from contactlearn import mechanics as mechanics
    from contactlearn import models as models
    from contactlearn import report as report
    from contactlearn import results as results
    from contactlearn.core.errors import ContactLearnError, DataError
    from contactlearn.data.audit.findings import audit
    from contactlearn.data.table import Impacts
    from contactlearn.data.table import load as read_table
    from contactlearn.data.tracks import find as read_recordings
    from contactlearn.diagnosis.options import DiagnoseOptions
    from contactlearn.diagnosis.pipeline import diagnose
    from contactlearn.diagnosis.result import Diagnosis
    from contactlearn.inference.evaluation import metrics
    from contactlearn.inference.evaluation.compare import compare
    from contactlearn.inference.identification.joint import Fit, fit
    from contactlearn.inference.identification.per_trial import fit_trials
    from contactlearn.inference.identification.scatter import fit_scatter
    from contactlearn.inference.identification.shared import fit_subsets
    from contactlearn.inference.learning.recipe import Recipe, learn
    from contactlearn.laws import Law
    from contactlearn.mechanics import shapes
    from contactlearn.mechanics.body_state import BodyState
    from contactlearn.mechanics.impacts import Prediction
    from contactlearn.models.checkpoint import load, save
    from contactlearn.models.citation import cite
    from contactlearn.models.contact_model import ContactModel
    from contactlearn.report import plot
    from contactlearn.report.page.diagnosis import save_report

__all__ = [
    "BodyState",
    "ContactLearnError",
    "ContactModel",
    "DataError",
    "DiagnoseOptions",
    "Diagnosis",
    "Fit",
    "Impacts",
    "Law",
    "Prediction",
    "Recipe",
    "__version__",
    "audit",
    "cite",
    "compare",
    "diagnose",
    "effects",
    "fit",
    "fit_scatter",
    "fit_subsets",
    "fit_trials",
    "laws",
    "learn",
    "load",
    "metrics",
    "plot",
    "read_recordings",
    "read_table",
    "save",
    "save_report",
    "shapes",
    "simulation",
]

# The module that defines each public name, and its name there where it is another; tests hold this table and the
# imports above to each other.
_HOME = {
    "BodyState": "mechanics.body_state",
    "ContactLearnError": "core.errors",
    "ContactModel": "models.contact_model",
    "DataError": "core.errors",
    "DiagnoseOptions": "diagnosis.options",
    "Diagnosis": "diagnosis.result",
    "Fit": "inference.identification.joint",
    "Impacts": "data.table",  # the reader of tables, which gives it `from_frame`
    "Law": "laws",
    "Prediction": "mechanics.impacts",
    "Recipe": "inference.learning.recipe",
    "audit": "data.audit.findings",
    "cite": "models.citation",
    "compare": "inference.evaluation.compare",
    "diagnose": "diagnosis.pipeline",
    "fit": "inference.identification.joint",
    "fit_scatter": "inference.identification.scatter",
    "fit_subsets": "inference.identification.shared",
    "fit_trials": "inference.identification.per_trial",
    "learn": "inference.learning.recipe",
    "load": "models.checkpoint",
    "metrics": "inference.evaluation",
    "plot": "report",
    "read_recordings": "data.tracks:find",
    "read_table": "data.table:load",
    "save": "models.checkpoint",
    "save_report": "report.page.diagnosis",
    "shapes": "mechanics",
}
_ROOMS = ("data", "diagnosis", "effects", "inference", "laws", "mechanics", "models", "report", "results", "simulation")


if not TYPE_CHECKING:  # with it a type checker would take any name for one of this package

    def __getattr__(name: str) -> object:
        if name in _HOME:
            module, *there = _HOME[name].split(":")
            return getattr(import_module(f"contactlearn.{module}"), there[0] if there else name)
        if name in _ROOMS:
            return import_module(f"contactlearn.{name}")
        raise AttributeError(f"module 'contactlearn' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
