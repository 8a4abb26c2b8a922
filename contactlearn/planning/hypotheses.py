"""The models between which a diagnosis leaves a choice, and the effects that it has not yet seen.

    plausible    models that the data cannot distinguish from the chosen one, by their shares
    doubted      the chosen model with a rival in the place of an effect, without one, or with a candidate; the frontier

The doubt of a diagnosis, one less the probability of its least sure name and at least a tenth, is spread evenly over
the doubted models.
`Candidates` are effects of the catalogue at values at which they change nothing, each known to a quarter of its range.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.errors import ContactLearnError
from contactlearn.diagnosis.result import Diagnosis, Verdict
from contactlearn.diagnosis.search.candidates import all_candidates, follows_order, usable
from contactlearn.effects import Effect, EffectId, find_effect
from contactlearn.inference.identification.joint import fit, linearise, named_parameters
from contactlearn.inference.identification.result import Box
from contactlearn.laws import Law, find
from contactlearn.mechanics.impacts import Impacts
from contactlearn.models.contact_model import ContactModel

_LEAST_DOUBT, _MOST_DOUBT = 0.1, 0.9
_MAX_MODELS = 12  # models
_LOOKED_AT = 100  # states by which an effect is found to act on none
_SHARE = 0.25  # of its plausible range, to which a parameter is known before anything is measured
_SHOWN = 1.0  # standard deviations of the noise by which an effect of that size changes a drop that shows it


@dataclass(frozen=True, kw_only=True)
class PossibleModel:
    """A fitted model, the names of its effects, and its probability."""

    model: ContactModel
    names: frozenset[str]
    probability: float


def hypotheses(diagnosis: Diagnosis) -> tuple[PossibleModel, ...]:
    """Fit the models between which a diagnosis leaves a choice to its impacts, the chosen one first.

    Raises:
        ContactLearnError: a diagnosis without its record, as of refused data.
    """
    chosen, impacts = diagnosis.model, diagnosis.record.impacts if diagnosis.record else None
    assert impacts is not None
    assert diagnosis.law is not None
    own = frozenset(one.effect for one in diagnosis.missing)
    shares = {(one.law, frozenset(one.effects)): one.share for one in diagnosis.models}
    doubted = [own - {one.effect} | {rival.effect} for one in diagnosis.missing for rival in one.rivals]
    doubted += [own | {one.effect} for one in diagnosis.candidates] + [own - {one.effect} for one in diagnosis.missing]
    every = dict.fromkeys((diagnosis.law, frozenset(effects)) for effects in doubted)
    every |= dict.fromkeys((one.law, frozenset(one.effects)) for one in diagnosis.frontier)
    named = {name.name for name in own}
    others = [spec for spec in every if {effect.name for effect in spec[1]} != named and spec not in shares]
    sure = min((effect.confidence for effect in diagnosis.missing), default=1.0)
    sure = min(sure, *(1 - (candidate.confidence or 0.0) for candidate in diagnosis.candidates), 1.0)
    sure = sure / 2 if diagnosis.verdict is Verdict.UNKNOWN else sure
    doubt = min(max(1 - sure, _LEAST_DOUBT), _MOST_DOUBT) if others else 0.0
    whole = sum(shares.values()) or 1.0
    weights = {spec: (1 - doubt) * share / whole for spec, share in shares.items()}
    weights = weights or {(diagnosis.law, own): 1 - doubt}
    weights |= {spec: doubt / len(others) for spec in others}
    ordered = sorted(weights, key=lambda spec: (spec != (diagnosis.law, own), -weights[spec]))[:_MAX_MODELS]
    fitted = list[PossibleModel]()
    for law, effects in ordered:
        try:
            model = _fitted(law, effects, diagnosis, impacts)
        except ContactLearnError:  # an effect of another package, or too few impacts for its parameters
            continue
        names = frozenset(effect.name for effect in effects)
        fitted.append(PossibleModel(model=model, names=names, probability=weights[law, effects]))
    if not fitted:
        fitted = [PossibleModel(model=chosen, names=frozenset(named), probability=1.0)]
    total = sum(one.probability for one in fitted)
    return tuple(PossibleModel(model=one.model, names=one.names, probability=one.probability / total) for one in fitted)


def _fitted(law: str, effects: frozenset[EffectId], diagnosis: Diagnosis, impacts: Impacts) -> ContactModel:
    """A law with effects and with those that were given, fitted."""
    known, variant = diagnosis.model.effects, "textbook" if law != diagnosis.law else diagnosis.variant or "textbook"
    given = {one.name: known[one.name] for one in diagnosis.given if one.name in known}
    same = {EffectId(name, effect.form): effect for name, effect in known.items()}  # those of other packages among them
    added = {effect.name: same.get(effect) or find_effect(effect.name, effect.form)() for effect in sorted(effects)}
    return fit(impacts, find(law, variant), given | added).model


@dataclass(frozen=True, kw_only=True)
class Candidates:
    """A model with effects that may be missing from it, at values at which these change nothing.

    Args:
        names: of the effect of each parameter; `mu` and `eps` of the law's own.
        slope: derivative of v_post in the parameters, whitened by its noise.
        model_parameters: number of the first parameters, which are those of the law and of the model's effects.
        prior: standard deviations of the parameters before anything is measured.
        information: Fisher information of the parameters by what is measured.
    """

    names: tuple[str, ...]
    slope: Float[Tensor, "n D k"]
    model_parameters: int
    prior: Float[Tensor, "k"]
    information: Float[Tensor, "k k"]

    @classmethod
    def about(
        cls,
        model: ContactModel,
        candidates: Mapping[str, Effect],
        states: Impacts,
        noise: Float[Tensor, "n D D"],
        measured: Impacts | None,
        spread: Float[Tensor, "D D"] | None,
    ) -> Self:
        """Linearise a law with effects, and with all candidates that it has not.

        Args:
            model: a law with effects.
            candidates: see `visible`.
            states: to which a drop may lead.
            noise: of v_post there.
            measured: impacts.
            spread: covariance of their v_post.
        """
        law = model.base
        assert isinstance(law, Law)
        prepared = states if measured is None else measured
        added = {
            name: effect.prepare(prepared).vanished()
            for name, effect in candidates.items()
            if name not in model.effects
        }
        every = [*model.effects.values(), *added.values()]
        values = [law.mu, law.eps, *(value for effect in every for value in effect.values)]
        theta = torch.stack([torch.as_tensor(value, dtype=torch.float64) for value in values])

        def whitened(impacts: Impacts, covariance: Tensor) -> Tensor:
            unit = torch.eye(impacts.space.D, dtype=torch.float64)
            slope = -linearise(law, model.effects, impacts, theta, unit, vanishing=added).slope.nan_to_num(
                0.0, 0.0, 0.0
            )
            return torch.linalg.solve_triangular(torch.linalg.cholesky(covariance), slope, upper=False)

        parameters = named_parameters({**model.effects, **added}, Box(), states)
        prior = torch.tensor([_SHARE * (p.high - p.low) for p in parameters], dtype=torch.float64)
        information = torch.zeros(len(prior), len(prior), dtype=torch.float64)
        if measured is not None:
            assert spread is not None
            known = whitened(measured, spread).flatten(0, 1)
            information = known.T @ known
        return cls(
            names=tuple(p.name.partition(".")[0] for p in parameters),
            slope=whitened(states, noise),
            model_parameters=2 + sum(len(effect.parameters) for effect in model.effects.values()),
            prior=prior,
            information=information,
        )

    def shown(self) -> set[str]:
        """Name the effects that some drop shows: at a typical size they change its outcome by more than the noise."""
        size = (self.slope * self.prior).square().sum(-2).amax(0).sqrt()
        return {name for name, one in zip(self.names, size.tolist(), strict=True) if one >= _SHOWN}


def visible(states: Impacts) -> tuple[dict[str, Effect], set[str]]:
    """Find the effects of the catalogue that may change an outcome of the states, and those that surely change none.

    An effect is in the form of its family with the fewest parameters.  Effects of the sequence, which no state shows,
    and those that are only tried in the place of others are neither.
    """
    some = states[:: -(-len(states) // _LOOKED_AT)]
    acting, ordered = dict[str, Effect](), some.replace(order=torch.arange(1, len(some) + 1))
    every = {key: effect for key, effect in all_candidates(states.space).items() if not effect.refines}
    able = usable(every, ordered)
    following = {key.name for key, effect in able.items() if follows_order(effect, ordered)}
    for key, effect in sorted(able.items(), key=lambda item: len(item[1].parameters)):
        if key.name not in following:
            acting.setdefault(key.name, effect)
    return acting, {key.name for key in every} - {key.name for key in able}
