"""What an effect that was planted in measured impacts has become in the diagnosed model.

Measured impacts have effects of their own, also of the planted kind, so a parameter need not be the planted one.  The
same model, with all effects that the diagnosis lists, is fitted to the impacts with the planted change Δ of v_post and
without it.  There the effect may be needed with the other sign, which bounds would hide, so they are moved for it.  It
changes v_post by C, the prediction with it less that without it, and

    taken = ⟨C_with − C_without, Δ⟩ / ⟨Δ, Δ⟩        in the mass metric

is its part of Δ, with the standard error of the fit with Δ.  What its form can take is `able`, from a fit of law and
effect alone to the outcome of the law plus Δ, whose parameters are the right ones.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import torch
from torch import Tensor

from blind.load import BlindSet, load, planted_change
from contactlearn.diagnosis.result import Diagnosis
from contactlearn.diagnosis.search.candidates import all_candidates
from contactlearn.effects import Effect
from contactlearn.inference.identification import joint
from contactlearn.inference.identification.joint import Fit, assemble
from contactlearn.mechanics.impacts import Impacts


def planted_parts(blind_set: BlindSet, found: Diagnosis) -> dict[str, dict[str, float]]:
    """Compare every listed effect with the planted change.

    Returns:
        `taken`, its standard error `error`, `able`, and `off`, the largest distance of a parameter from the right one
        in its standard errors, by the name of the effect.
    """
    impacts, change = load(blind_set), planted_change(blind_set)
    without = impacts.replace(v_post=impacts.v_post - change)
    known = all_candidates()
    listed = {one.effect.name: known[one.effect] for one in (*found.candidates[::-1], *found.missing)}
    law = str(found.law)
    stated = joint.fit(impacts, law, listed)
    parts = dict[str, dict[str, float]]()
    for name, effect in listed.items():
        with either_sign(effect):
            whole = joint.fit(impacts, law, listed, start=stated.values)
            plain = joint.fit(without, law, listed, start=whole.values)
            own = joint.fit(without, law, {name: effect}).model
        exact = without.replace(v_post=replace(own, effects={}).predict(without).v_post + change)
        alone = joint.fit(exact, law, {name: effect})
        mine = [k for k, p in enumerate(stated.parameters) if p.name.startswith(f"{name}.")]
        off = (stated.values[mine] - alone.values[2:]).abs() / stated.standard_errors[mine]
        taken = _part(whole, name, impacts, change, whole.values)
        steps = 1e-3 * torch.diag(whole.standard_errors)
        slope = torch.stack([_part(whole, name, impacts, change, whole.values + step) - taken for step in steps])
        parts[name] = {
            "taken": (taken - _part(plain, name, without, change, plain.values)).item(),
            "error": 1e3 * (slope @ whole.correlation @ slope).sqrt().item(),
            "able": _part(alone, name, exact, change, alone.values).item(),
            "off": off.max().item(),
        }
    return parts


@contextmanager
def either_sign(effect: Effect) -> Iterator[None]:
    """Let parameters that vanish at their lower bound go as far below it as above."""
    kind, before = type(effect), effect.every_parameter()
    wider = (replace(p, low=2 * p.low - p.high) if p.low == p.vanishing else p for p in before)
    kind._parameters = tuple(wider)
    try:
        yield
    finally:
        kind._parameters = before


def _part(fit: Fit, name: str, impacts: Impacts, change: Tensor, values: Tensor) -> Tensor:
    """Part of a change of v_post that an effect of a model makes at some values of its parameters."""
    model = assemble(fit.model.law, fit.model.effects, values)
    less: dict[str, Effect] = {other: effect for other, effect in model.effects.items() if other != name}
    mine = model.predict(impacts).v_post - replace(model, effects=less).predict(impacts).v_post
    weighted = torch.stack((impacts.mass, impacts.mass, impacts.inertia), -1) * change
    return (weighted * mine).sum() / (weighted * change).sum()
