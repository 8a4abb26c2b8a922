"""Studies of effects that are confounded with a chosen one, on drops of nearly one state and on others."""

from typing import NamedTuple

import torch

from contactlearn import laws
from contactlearn.diagnosis.discrimination.rivals import find_rivals
from contactlearn.diagnosis.search.candidates import all_candidates, usable
from contactlearn.diagnosis.search.pool import Pool, Spec
from contactlearn.diagnosis.search.selection import Selection, select, validated
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.effects import EffectId, catalogue
from contactlearn.inference.identification.joint import FitOptions
from contactlearn.inference.validation import Folds
from contactlearn.mechanics.impacts import Impacts
from contactlearn.models.contact_model import ContactModel
from contactlearn.simulation import synthetic
from sensitivity.studies.cases import random
from sensitivity.study import Study, each

_LAW = "wang_mason"
_NOISE = torch.tensor((0.01, 0.01, 0.5), dtype=torch.float64)

_CONFOUNDED = (
    ("gravity_impulse", (("dt", 0.004),), 60, 0.1),
    ("gravity_impulse", (("dt", 0.004),), 60, 0.3),
    ("inertia_error", (("kappa", 0.1),), 60, 0.1),
    ("contact_patch", (("k", 0.03),), 60, 0.1),
    ("velocity_dependent_restitution", (("v_ref", 2.5), ("p", -0.04)), 60, 1.0),
)
"""An effect with its parameters, how many drops, and their spread in speed and spin; others have nearly its trace."""
_DISTINCT = (
    ("sampling_delay", (("dt", 0.003),), 60, 0.1),
    ("spin_damping", (("c", 0.1),), 60, 0.1),
    ("surface_tilt", (("phi", 0.02),), 60, 0.1),
    ("side_drag", (("c", 0.08),), 60, 0.1),
    ("spin_damping", (("c", 0.1),), 300, 1.0),
    ("gravity_impulse", (("dt", 0.01),), 300, 1.0),
)
"""Likewise, but no other effect has its trace."""


class Drops(NamedTuple):
    """Measured drops, and the effect behind them."""

    impacts: Impacts
    effect: EffectId

    def pool(self) -> Pool:
        """An empty pool of all candidates around the law."""
        among = usable(all_candidates(), self.impacts, Thresholds())
        prepared = {key: effect.prepare(self.impacts) for key, effect in among.items()}
        fitted = {key: effect for key, effect in prepared.items() if effect.parameters}
        return Pool({_LAW: laws.find(_LAW)}, self.impacts, fitted, {}, FitOptions())

    def folds(self) -> Folds:
        """One repeat of five folds."""
        return Folds.draw(len(self.impacts), random(0), repeats=1)


def _drops(name: str, values: tuple[tuple[str, float], ...], size: int, width: float, seed: int) -> Drops:
    """Drops whose speeds of falling and spins are spread by a share of the usual."""
    effect = catalogue()[name][0](**dict(values))
    states = synthetic.load(size=size, seed=seed)
    v = states.v_pre.clone()
    v[:, 1] = -2.55 + width * (v[:, 1] + 2.55)
    v[:, 2] *= width
    states = states.replace(v_pre=v)
    model = ContactModel(laws.find(_LAW).at(0.12, 0.55), effects={name: effect.prepare(states)})
    noise = _NOISE * torch.randn((size, 3), generator=random(seed), dtype=torch.float64)
    return Drops(states.replace(v_post=model.predict(states).v_post + noise), effect.id)


def _chosen(*case) -> Selection:
    """A selection that has chosen the effect behind the drops."""
    drops = _drops(*case)
    around, folds, spec = drops.pool(), drops.folds(), Spec(_LAW, frozenset({drops.effect}))
    base, present = (validated(around, folds, around.fitted(one)) for one in (Spec(_LAW), spec))
    return Selection(pool=around, folds=folds, spec=spec, base=base, present=present, plausible=(), complete=True)


def _exchanged(drops: Drops, thresholds: Thresholds) -> bool:
    """Whether the plausible models have others in the place of the effect."""
    found = select(
        {_LAW: laws.find(_LAW)}, drops.impacts, drops.pool().candidates, drops.folds(), given={},
        thresholds=thresholds, generator=random(0),
    )  # fmt: skip
    return any(drops.effect not in one.model.spec.effects for one in found.plausible)


RIVALS = Study(
    name="rivals", null=each(1, *_DISTINCT), planted=each(2, *_CONFOUNDED), prepare=_chosen,
    alarm=lambda selection, thresholds: any(find_rivals(selection, thresholds).values()),
)  # fmt: skip
PLAUSIBLE = Study(
    name="plausible models", null=each(1, *_DISTINCT), planted=each(1, *_CONFOUNDED), prepare=_drops, alarm=_exchanged,
)  # fmt: skip
