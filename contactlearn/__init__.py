"""contactlearn: learn rigid-body contact from measurements.

    import contactlearn as cl

    impacts = cl.read_table("drops.csv", shape=cl.shapes.Ellipse((0.035, 0.025)))
    found = cl.diagnose(impacts)
    print(found)
    print(found.fit().summary())

The names below are loaded when they are first used, so that `import contactlearn` and the commands' `--help` stay fast;
editors and type checkers see them all.  The rooms (`contactlearn.mechanics`, `contactlearn.inference` …) have the rest.
"""

from importlib import import_module

from contactlearn.core import __version__ as __version__

TYPE_CHECKING = False  # a type checker takes it for true; typing takes longer to load than the rest
if TYPE_CHECKING:
    from contactlearn import (
        data as data,
        diagnosis as diagnosis,
        effects as effects,
        inference as inference,
        laws as laws,
        mechanics as mechanics,
        models as models,
        planning as planning,
        report as report,
        results as results,
        simulation as simulation,
    )
    from contactlearn.core.errors import ContactLearnError as ContactLearnError, DataError as DataError
    from contactlearn.data import table, tracks
    from contactlearn.data.audit.corrections import correct as correct
    from contactlearn.data.audit.findings import audit as audit
    from contactlearn.data.table import Impacts as Impacts
    from contactlearn.diagnosis.options import DiagnoseOptions as DiagnoseOptions
    from contactlearn.diagnosis.pipeline import diagnose as diagnose
    from contactlearn.diagnosis.result import Diagnosis as Diagnosis
    from contactlearn.inference.evaluation import metrics as metrics
    from contactlearn.inference.evaluation.compare import compare as compare
    from contactlearn.inference.identification.joint import Fit as Fit, fit as fit
    from contactlearn.inference.identification.per_trial import fit_trials as fit_trials
    from contactlearn.inference.identification.scatter import fit_scatter as fit_scatter
    from contactlearn.inference.identification.shared import fit_subsets as fit_subsets
    from contactlearn.inference.learning.recipe import Recipe as Recipe, learn as learn
    from contactlearn.laws import Law as Law
    from contactlearn.mechanics import shapes as shapes
    from contactlearn.mechanics.body_state import BodyState as BodyState
    from contactlearn.mechanics.impacts import Prediction as Prediction
    from contactlearn.models.checkpoint import load as load, save as save
    from contactlearn.models.citation import cite as cite
    from contactlearn.models.contact_model import ContactModel as ContactModel
    from contactlearn.planning.design import plan as plan
    from contactlearn.planning.rig import Limits as Limits, Rig as Rig, Specimen as Specimen
    from contactlearn.report import plot as plot
    from contactlearn.report.page.diagnosis import save_report as save_report

    read_recordings, read_table = tracks.find, table.load

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
    "Rig": "planning.rig",
    "Limits": "planning.rig",
    "Specimen": "planning.rig",
    "audit": "data.audit.findings",
    "cite": "models.citation",
    "compare": "inference.evaluation.compare",
    "correct": "data.audit.corrections",
    "diagnose": "diagnosis.pipeline",
    "fit": "inference.identification.joint",
    "fit_scatter": "inference.identification.scatter",
    "fit_subsets": "inference.identification.shared",
    "fit_trials": "inference.identification.per_trial",
    "learn": "inference.learning.recipe",
    "load": "models.checkpoint",
    "metrics": "inference.evaluation",
    "plan": "planning.design",
    "plot": "report",
    "read_recordings": "data.tracks:find",
    "read_table": "data.table:load",
    "save": "models.checkpoint",
    "save_report": "report.page.diagnosis",
    "shapes": "mechanics",
}
_ROOMS = (
    "data", "diagnosis", "effects", "inference", "laws", "mechanics", "models", "planning", "report", "results",
    "simulation",
)  # fmt: skip


if not TYPE_CHECKING:  # with it a type checker would take any name for one of this package
    __all__ = sorted((*_HOME, "effects", "laws", "simulation", "__version__"))

    def __getattr__(name: str) -> object:
        if name in _HOME:
            module, *there = _HOME[name].split(":")
            return getattr(import_module(f"contactlearn.{module}"), there[0] if there else name)
        if name in _ROOMS:
            return import_module(f"contactlearn.{name}")
        from contactlearn.core.errors import no_attribute

        raise no_attribute("contactlearn", name, __all__)

    def __dir__() -> list[str]:
        return __all__
