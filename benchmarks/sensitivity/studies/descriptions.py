"""Study of a stated noise."""

from dataclasses import replace

from contactlearn import laws
from contactlearn.diagnosis.pipeline import diagnose
from contactlearn.diagnosis.result import Diagnosis
from contactlearn.diagnosis.search.candidates import all_candidates
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.effects import EffectId
from contactlearn.report.text import misfit
from sensitivity.studies.cases import between, textbook
from sensitivity.study import Study, each


def _stated(kind: str, seed: int) -> Diagnosis:
    """A diagnosis with noise that was stated about right, or in other units or off by a factor."""
    off = {"right": between(0.8, 1.25, seed), "degrees": 57.3, "millimetres": 1000.0, "factor": between(1.5, 5, seed)}
    factor = off[kind] ** (1 - 2 * (seed % 2))
    noise = (0.01, 0.01, 0.5 * factor) if kind == "degrees" else (0.01 * factor, 0.01 * factor, 0.5 * factor)
    law, tilt = laws.find("wang_mason"), EffectId("surface_tilt", "computed")
    return diagnose(textbook(seed, 100), law, laws=[law], candidates={tilt: all_candidates()[tilt]}, noise=noise)


def _questioned(found: Diagnosis, thresholds: Thresholds) -> bool:
    return bool(misfit(replace(found, thresholds=thresholds)))


STATED = Study(
    name="stated noise", null=each(12, "right"), planted=each(4, "degrees", "millimetres", "factor"),
    prepare=_stated, alarm=_questioned,
)  # fmt: skip
