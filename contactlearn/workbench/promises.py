"""What each effect of the catalogue would take off the present model, before it is fitted.

The model is linearised with all candidates around it (`diagnosis.search.quadratic`); for each effect the best step of
all parameters follows from sums of products, and the model at this step is tried on the held-out trials.  It is an
estimate for the order in which to try effects: a strongly non-linear effect does better or worse once it is fitted.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.cli.commands.loading import Split
from contactlearn.diagnosis.search.candidates import all_candidates, usable
from contactlearn.diagnosis.search.quadratic import Group, Quadratic
from contactlearn.effects import Effect, EffectId
from contactlearn.inference.evaluation.metrics import mass_error
from contactlearn.inference.identification.joint import FitOptions, assemble
from contactlearn.workbench.cache import Cache
from contactlearn.workbench.models import STARTS, Fitted, Models
from contactlearn.workbench.session import Session

_KEPT = 100
_TRIALS = 4000  # at most, of the linearisation


@dataclass(frozen=True, kw_only=True)
class Promise:
    """An effect that could be added.

    Args:
        effect: its identity.
        gain: fall of the loss in nats over all training trials, less the price of its parameters.
        error: held-out error at the linear step.
    """

    effect: EffectId
    gain: float
    error: float


class Promises:
    """The promises of all sessions."""

    def __init__(self, models: Models) -> None:
        self._models = models
        self._candidates: Cache[dict[EffectId, Effect]] = Cache(_KEPT)
        self._found: Cache[tuple[Promise, ...]] = Cache(_KEPT)

    def of(self, session: Session) -> tuple[Promise, ...]:
        """Return the effects that the model of a session does not have, the most promising first."""
        data, fitted = self._models.split(session), self._models.fitted(session)
        part = (self._models.fingerprint(session), session.seed)
        among = self._candidates.get(part, lambda: _candidates(data))
        key = (*part, session.model)
        return self._found.get(key, lambda: _promises(fitted, among, data))


def _candidates(data: Split) -> dict[EffectId, Effect]:
    """Effects that these data can decide about, prepared."""
    return {key: effect.prepare(data.pool) for key, effect in usable(all_candidates(), data.pool).items()}


def _promises(fitted: Fitted, candidates: Mapping[EffectId, Effect], data: Split) -> tuple[Promise, ...]:
    others = {key: effect for key, effect in candidates.items() if key.name not in fitted.effects}
    quadratic = Quadratic.about(
        fitted.law,
        fitted.effects,
        fitted.fit,
        data.pool[:_TRIALS],
        given=tuple(fitted.effects),
        candidates=others,
        options=FitOptions(starts=STARTS),
    )
    groups = [group for group in quadratic.groups if group.effect is not None]
    if not groups:
        return ()
    losses, theta = quadratic.losses([frozenset[Group](), *(frozenset({group}) for group in groups)])
    best: dict[EffectId, tuple[float, Float[Tensor, " q"], Group]] = {}
    for group, fall, values in zip(groups, (losses[0] - losses[1:]).tolist(), theta[1:], strict=True):
        assert group.effect is not None  # those of all models are not among them
        gain = fall - len(quadratic.groups[group]) / 2 * math.log(quadratic.trials)
        if group.effect not in best or gain > best[group.effect][0]:
            best[group.effect] = gain, values, group
    found = [
        Promise(effect=key, gain=gain, error=_error(fitted, others[key], quadratic, group, values, data))
        for key, (gain, values, group) in best.items()
    ]
    return tuple(sorted(found, key=lambda one: -one.gain))


def _error(
    fitted: Fitted, effect: Effect, quadratic: Quadratic, group: Group, values: Float[Tensor, " q"], data: Split
) -> float:
    """Held-out error at the linear step of one effect."""
    kept = [*quadratic.groups[Group(None)], *quadratic.groups[group]]
    model = assemble(fitted.law, {**fitted.effects, "new": effect}, values[kept])
    with torch.no_grad():
        return mass_error(data.test, model.predict(data.test)).mean().item()
