"""Candidates for missing effects: the catalogue in all its forms, the user's own, and the rules for refusing some.

An effect is refused if it could explain anything: with a parameter for every few trials, or with constants that it
takes from the outcomes it is to predict.  Effects that need a body's shape are left out where that is not known.
"""

from collections.abc import Iterable, Mapping

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.errors import ContactLearnError
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.effects import Effect, EffectId, State, catalogue, columns
from contactlearn.laws import PAPER_LAWS, Law, find
from contactlearn.laws.wang_mason import WangMason
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.space import PLANE, Space
from contactlearn.models.contact_model import resolve

SEARCHED_LAWS = (*PAPER_LAWS, "wang_mason_newton", "spring_dashpot")
"""Names of the laws that a diagnosis compares."""
_NUDGE = 0.1  # of a parameter's range: the change of an effect at which its prediction is looked at


def all_candidates(space: Space = PLANE) -> dict[EffectId, Effect]:
    """Return every effect of the catalogue in each of its forms that exists in a space."""
    return {kind.id: kind() for forms in catalogue().values() for kind in forms if space in kind.spaces}


def all_laws(space: Space = PLANE) -> list[Law]:
    """Return the textbook laws of the paper that exist in a space, and two that it leaves out."""
    return [law for law in map(find, SEARCHED_LAWS) if space in law.spaces]


def fitted_first(laws: Mapping[str, Law]) -> list[str]:
    """Return the names of the laws with which a search begins: all that refine no others, or all if there are none."""
    return [name for name, law in laws.items() if not law.refines] or list(laws)


def user_candidates(candidates: Iterable[EffectId]) -> tuple[EffectId, ...]:
    """Keep the candidates that do not come with this package: classes of another one, and lines of mathematics."""
    kinds = catalogue()
    shipped = {name for name, forms in kinds.items() if forms[0].__module__.startswith("contactlearn.effects.")}
    return tuple(key for key in candidates if key.name not in shipped)


def usable(
    candidates: Mapping[EffectId, Effect],
    impacts: Impacts,
    thresholds: Thresholds = Thresholds(),
) -> dict[EffectId, Effect]:
    """Keep the candidates that these measurements can decide about: a known shape, and enough trials a parameter.

    What the rig card has corrected is not offered again.

    Raises:
        ContactLearnError: no candidate is kept, or one takes its constants from the outcomes.
    """
    share = thresholds.trials_per_parameter
    settled = impacts.apparatus.settled if impacts.apparatus else ()
    able = {key: effect for key, effect in candidates.items() if impacts.space in effect.spaces}
    able = {key: effect for key, effect in able.items() if impacts.shape is not None or not effect.needs_shape}
    able = {key: effect for key, effect in able.items() if key.name not in settled}
    able = {key: effect for key, effect in able.items() if len(effect.parameters) * share <= len(impacts)}
    if not able:
        most = max((len(effect.parameters) for effect in candidates.values()), default=0)
        raise ContactLearnError(
            f"there are no candidates to choose from: {len(candidates)} given, of up to {most} parameters, for "
            f"{len(impacts)} trials; a parameter must have {share} trials to itself"
        )
    for key, effect in able.items():
        if _sees_outcomes(effect, impacts):
            raise ContactLearnError(
                f"candidate {key} changes its predictions with the measured v_post, so it could explain anything; its "
                "prepare() must take constants from the state before impact alone"
            )
    return able


def follows_order(effect: Effect, impacts: Impacts) -> bool:
    """Return whether the prediction of an effect changes once the order of the trials is reversed."""
    prepared, reversed_ = effect.prepare(impacts), impacts.replace(order=impacts.order.flip(0))
    return not torch.equal(_nudged(prepared, impacts), _nudged(prepared, reversed_))


def _sees_outcomes(effect: Effect, impacts: Impacts) -> bool:
    """Return whether its prediction changes once the outcomes of the trials are exchanged."""
    other = impacts.replace(v_post=1.1 * impacts.v_post.flip(0), validate=False)
    return not torch.equal(_nudged(effect.prepare(impacts), impacts), _nudged(effect.prepare(other), impacts))


def _nudged(effect: Effect, impacts: Impacts) -> Float[Tensor, "n D"]:
    """Prediction of v_post around some law by a prepared effect whose parameters are away from vanishing."""
    moved = columns(*effect.vanished().values) + _NUDGE * torch.tensor([p.high - p.low for p in effect.parameters])
    law = WangMason(0.2, 0.5)
    return resolve(law, {"": effect.at(moved)}, State.of(impacts), law.mu, law.eps).v_post.nan_to_num()
