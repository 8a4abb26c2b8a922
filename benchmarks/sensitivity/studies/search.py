"""Studies of whole diagnoses: laws and missing effects, large tables, a stated noise."""

from dataclasses import replace
from typing import NamedTuple

import torch

from contactlearn import laws
from contactlearn.core.errors import DataError
from contactlearn.diagnosis.options import DiagnoseOptions
from contactlearn.diagnosis.pipeline import diagnose
from contactlearn.diagnosis.result import Diagnosis
from contactlearn.diagnosis.search.candidates import all_candidates, usable
from contactlearn.diagnosis.search.selection import Selection, select
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.effects import EffectId
from contactlearn.inference.validation import Folds
from contactlearn.mechanics.impacts import Impacts
from contactlearn.report.text.sentences import misfit
from contactlearn.simulation import hidden_effects
from sensitivity.studies.cases import between, drops, heavy, textbook
from sensitivity.study import Study, each


class Hidden(NamedTuple):
    """Measurements with hidden effects, and the law of the simulated contacts."""

    impacts: Impacts
    law: str
    effects: tuple[str, ...] = ()

    def folds(self) -> Folds:
        """One repeat of five folds."""
        return Folds.draw(len(self.impacts), torch.Generator().manual_seed(0), repeats=1)

    def selection(self, thresholds: Thresholds, law: str | None = None) -> Selection:
        """Select around a law, by default the true one."""
        limits, law = thresholds, law or self.law
        among = usable(all_candidates(), self.impacts, limits)
        return select(
            {law: laws.find(law)}, self.impacts, among, self.folds(), given={}, thresholds=limits,
            generator=torch.Generator().manual_seed(0),
        )  # fmt: skip


def _hidden(effects: tuple[str, ...], strength: tuple[float, float], size: int, seed: int) -> Hidden:
    """Simulated drops; ("heavy",) has no effect, but noise of heavy tails."""
    named = tuple(name for name in effects if name != "heavy")
    impacts, law = drops(named, size, seed, strength)
    known = tuple(name for name in named if name in hidden_effects.EFFECTS)
    return Hidden(heavy(impacts, seed) if "heavy" in effects else impacts, law, known)


def _named(hidden: Hidden, thresholds: Thresholds) -> bool:
    """Whether all hidden effects are named; where the catalogue has none of them, whether any effect is."""
    found = hidden.selection(thresholds).present.effects
    return set(hidden.effects) <= set(found) if hidden.effects else bool(found)


_WEAK, _CLEAR, _STRONG = (0.7, 2.0), (2.0, 5.0), (8.0, 16.0)
_EFFECTS = tuple(((name,), _WEAK, 100) for name in hidden_effects.EFFECTS)
_UNKNOWN = tuple(((name,), _CLEAR, 100) for name in hidden_effects.UNKNOWN)
_PAIRS = tuple(
    (pair, _CLEAR, 100)
    for pair in (
        ("contact_patch", "side_drag"), ("directional_friction", "surface_tilt"),
        ("parameter_drift", "tangential_restitution"), ("com_offset", "velocity_dependent_restitution"),
    )
)  # fmt: skip

SELECTION = Study(
    name="missing effects",
    null=(*each(4, ((), _CLEAR, 100)), *each(3, (("heavy",), _CLEAR, 100)), *each(1, *_UNKNOWN)),
    planted=(*each(1, *_EFFECTS[::2]), *each(1, *_PAIRS[:1])), prepare=_hidden, alarm=_named,
)  # fmt: skip
SMALL = Study(
    name="missing effects, few trials",
    null=each(5, ((), _CLEAR, 20), ((), _CLEAR, 40)),
    planted=each(1, *((effect, _CLEAR, size) for effect, *_ in _EFFECTS[::4] for size in (20, 40))),
    prepare=_hidden, alarm=_named,
)  # fmt: skip


def _diagnosed(hidden: Hidden, thresholds: Thresholds) -> bool:
    """Whether the data are diagnosed at all and the hidden effect is named, or any where there is none."""
    try:
        found = diagnose(hidden.impacts, laws.find(hidden.law), options=DiagnoseOptions(thresholds=thresholds)).missing
    except DataError:  # too few trials
        return False
    names = {missing.effect.name for missing in found}
    return bool(names & set(hidden.effects)) if hidden.effects else bool(names)


FEW = Study(
    name="few trials in all", null=each(3, ((), _CLEAR, 20), ((), _CLEAR, 30), ((), _CLEAR, 40)),
    planted=each(1, *((effect, _CLEAR, size) for effect, *_ in _EFFECTS[::7] for size in (20, 30, 40))),
    prepare=_hidden, alarm=_diagnosed,
)  # fmt: skip


def _named_in_table(table: Hidden, thresholds: Thresholds) -> bool:
    """Whether the hidden effects are named, each of its family; where there are none, whether any is."""
    found = diagnose(
        table.impacts, laws.find(table.law), options=DiagnoseOptions(candidates=all_candidates(), thresholds=thresholds)
    ).effects
    return set(table.effects) <= set(found) if table.effects else bool(found)


_FAINT = (0.3, 0.7)
NAMES = Study(
    name="names in large tables", null=each(2, ((), _FAINT)),
    planted=each(1, *(((name,), _FAINT) for name in ("surface_tilt", "side_drag", "com_offset", "parameter_drift"))),
    prepare=lambda effects, strength, seed: Hidden(*drops(effects, 6000, seed, strength), effects),
    alarm=_named_in_table,
)  # fmt: skip


def _stated(kind: str, seed: int) -> Diagnosis:
    """A diagnosis with noise that was stated about right, or in other units or off by a factor."""
    off = {"right": between(0.8, 1.25, seed), "degrees": 57.3, "millimetres": 1000.0, "factor": between(1.5, 5, seed)}
    factor = off[kind] ** (1 - 2 * (seed % 2))
    noise = (0.01, 0.01, 0.5 * factor) if kind == "degrees" else (0.01 * factor, 0.01 * factor, 0.5 * factor)
    law, tilt = laws.find("wang_mason"), EffectId("surface_tilt", "computed")
    return diagnose(
        textbook(seed, 100),
        law,
        options=DiagnoseOptions(laws=[law], candidates={tilt: all_candidates()[tilt]}, noise=noise),
    )


STATED = Study(
    name="stated noise", null=each(12, "right"), planted=each(4, "degrees", "millimetres", "factor"),
    prepare=_stated, alarm=lambda found, thresholds: bool(misfit(replace(found, thresholds=thresholds))),
)  # fmt: skip
