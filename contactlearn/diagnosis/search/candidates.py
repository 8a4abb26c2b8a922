"""Candidates for missing effects: the catalogue in all its forms, the user's own, and the rules for refusing some.

An effect is refused if it could explain anything: with a parameter for every few trials, or with constants that it
takes from the outcomes it is to predict.  Effects that need a body's shape are left out where that is not known, and
those that act by a quantity that is the same in all trials: it is no measurement of any dependence.
"""

from collections.abc import Iterable, Mapping, Sequence
from itertools import product
from types import MappingProxyType
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.errors import ContactLearnError
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.effects import Effect, EffectId, State, catalogue, columns, find_effect
from contactlearn.effects.checks import added
from contactlearn.effects.functions import MOST_OBJECTS
from contactlearn.laws import PAPER_LAWS, Law, find
from contactlearn.laws.wang_mason import WangMason
from contactlearn.mechanics.impacts import Covariates, Impacts
from contactlearn.mechanics.shapes import Disc, Sphere
from contactlearn.mechanics.space import PLANE, Space
from contactlearn.models.contact_model import resolve

SEARCHED_LAWS = (*PAPER_LAWS, "wang_mason_newton", "chatterjee_ruina", "spring_dashpot")
"""Names of the laws that a diagnosis compares."""
_ROUNDING = 1e-9  # relative change of a quantity that counts as none
_FAR = 0.5  # of a parameter's range, where a coefficient must be constant too if it is no function of the state
_NUDGE = 0.1  # of a parameter's range: the change of an effect at which its prediction is looked at


def all_candidates(space: Space = PLANE, covariates: Covariates = MappingProxyType({})) -> dict[EffectId, Effect]:
    """Return every effect of the catalogue in each of its forms that exists in a space, and those of covariates.

    Those are named after the covariate, such as `temperature_dependent_restitution:linear`.
    """
    candidates: dict[EffectId, Effect] = {
        kind.id: kind() for forms in catalogue().values() for kind in forms if space in kind.spaces
    }
    for name, values in covariates.items():
        few = 1 < len({*values.tolist()} if isinstance(values, Tensor) else {*values}) <= MOST_OBJECTS
        forms = ["linear", "curve"] if isinstance(values, Tensor) else []
        forms += ["group"] if few else []
        for coefficient, form in product(("restitution", "friction"), forms):
            kind: Any = find_effect(f"covariate_dependent_{coefficient}", form)
            candidates[EffectId(f"{name}_dependent_{coefficient}", form)] = kind(covariate=name)
    return candidates


def all_laws(space: Space = PLANE) -> list[Law]:
    """Return the textbook laws of the paper that exist in a space, and three that it leaves out."""
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

    What reads a place, an orientation or a spin that is the same in all trials, or makes a coefficient that is, is left
    out, and of a disc or ball what reads the lever of a contact point that was seen, which is noise.  Of bounces along
    the normal, that is what would turn a body or push it sideways: of that, roundings alone would decide.  What the rig
    card has corrected is offered within the errors of the card.

    Raises:
        ContactLearnError: no candidate is kept, or one takes its constants from the outcomes.
    """
    share = thresholds.trials_per_parameter
    able = {key: effect for key, effect in candidates.items() if impacts.space in effect.spaces}
    able = {key: effect for key, effect in able.items() if impacts.shape is not None or not effect.needs_shape}
    noise = isinstance(impacts.shape, Disc | Sphere) and bool((impacts.r[:, 0] != impacts.r[0, 0]).any())
    able = {key: effect for key, effect in able.items() if not (effect.needs_lever and noise)}
    able = {key: effect for key, effect in able.items() if len(effect.parameters) * share <= len(impacts)}
    varied = _varied(impacts)
    able = {key: effect for key, effect in able.items() if not _unvaried(effect, impacts, varied)}
    across = [k for k in range(impacts.space.D) if k != impacts.space.d - 1]
    if (torch.cat((impacts.v_pre, impacts.v_post))[:, across].abs() <= _ROUNDING).all():
        able = {
            key: effect
            for key, effect in able.items()
            if (_nudged(effect.prepare(impacts), impacts)[:, across].abs() <= _ROUNDING).all()
        }
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


def _varied(impacts: Impacts) -> list[Impacts]:
    """List impacts with other values of each place or orientation that is the same in all trials, for what reads it."""
    q = impacts.q
    same = (q.amax(0) - q.amin(0) <= _ROUNDING * q.abs().max()).tolist()
    columns = (0, 2) if impacts.space is PLANE else (0, 1)  # heights play no part
    return [_with_spread(impacts, "q", k) for k in columns if same[k] and len(q) > 1]


def _with_spread(impacts: Impacts, field: str, column: int) -> Impacts:
    """Return impacts with values of a column that differ from trial to trial."""
    values = getattr(impacts, field).clone()
    values[:, column] = torch.linspace(-1, 1, len(values), dtype=torch.float64)
    return impacts.replace(**{field: values}, validate=False)


def without_spin(candidates: Mapping[EffectId, Effect], impacts: Impacts) -> dict[EffectId, Effect]:
    """Keep the candidates that do not read the spin, for measurements that have none; nor the slip of a round body."""
    varied = [_with_spread(impacts, "v_pre", k) for k in range(impacts.space.d, impacts.space.D)]
    return {key: effect for key, effect in candidates.items() if not _unvaried(effect, impacts, varied)}


def _unvaried(effect: Effect, impacts: Impacts, varied: Sequence[Impacts]) -> bool:
    """Whether an effect acts by quantities that are the same in all trials, so that no trial shows it by another."""
    try:
        moved, far = (_moved(effect.prepare(impacts), nudge) for nudge in (_NUDGE, _FAR))
    except ContactLearnError:  # it is refused elsewhere, by name
        return False
    here = added(moved, impacts, impacts)
    if effect.place == "law" and moved.parameters and len(impacts) > 1:  # an effect of several bodies has none for one
        each = (*here.values(), *added(far, impacts, impacts).values())  # a threshold is beyond all trials at one value
        if all((x.max() - x.min()).item() <= _ROUNDING for x in each):
            return True
    return any(
        not torch.allclose(x, here[name], rtol=1e-6, atol=_ROUNDING)
        for other in varied
        for name, x in added(moved, other, impacts).items()
        if not name.startswith("q[")  # a place that is only turned with the axes is not read
    )


def _moved(effect: Effect, nudge: float = _NUDGE) -> Effect:
    """A prepared effect whose parameters are away from vanishing."""
    ranges = torch.tensor([p.high - p.low for p in effect.parameters], dtype=torch.float64)
    return effect.at(columns(*effect.vanished().values) + nudge * ranges)


def _sees_outcomes(effect: Effect, impacts: Impacts) -> bool:
    """Return whether its prediction changes once the outcomes of the trials are exchanged."""
    other = impacts.replace(v_post=1.1 * impacts.v_post.flip(0), validate=False)
    return not torch.equal(_nudged(effect.prepare(impacts), impacts), _nudged(effect.prepare(other), impacts))


def _nudged(effect: Effect, impacts: Impacts) -> Float[Tensor, "n D"]:
    """Prediction of v_post around some law by a prepared effect whose parameters are away from vanishing."""
    law = WangMason(0.2, 0.5)
    return resolve(law, {"": _moved(effect)}, State.of(impacts), law.mu, law.eps).v_post.nan_to_num()
