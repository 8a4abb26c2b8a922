"""Rules of an effect, tried on impacts: its method returns what it must, is finite, differentiable, and can vanish.

`contactlearn.testing.EffectContract` asserts that nothing breaks them; a command raises the first sentence about an
effect of the user's own, and a formula about itself on the user's measurements.
"""

from collections.abc import Iterator
from string import Formatter
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.effects.base import Effect, outputs
from contactlearn.effects.state import State
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.space import PLANE, SPACE

_RETURNS = {
    "state": "a state, such as state.replace(r=…)",
    "law": "two tensors (mu, eps)",
    "wrench": "the wrench, a tensor [..., N, {D}]",
    "velocity": "v_post, a tensor [..., N, {D}]",
}
_FREE = (None, 0.25, 0.75)  # values of parameters that need not vanish: the start, and shares of the range
_SHARES = (-0.4, -0.15, 0.1, 0.3, 0.45)  # of a parameter's range from its start, where its gradient is tried


def violations(effect: Effect, impacts: Impacts, *, rounding: float = 0.0) -> Iterator[str]:
    """Yield each broken rule as the rest of a sentence whose subject is the effect.

    The method of the effect's place is called with μ = ε = 1/2, the measured wrench and the measured v_post.  An effect
    whose parameters follow from the data and that has none on these impacts breaks no rule.

    Args:
        effect: an effect that was prepared on the impacts.
        impacts: impacts on which it is tried.
        rounding: change, in the unit of an output, that counts as none where the effect vanishes.
    """
    if not effect.parameters:
        if type(effect).parameters is Effect.parameters:
            yield 'has no parameter to fit; declare one, such as u: float = parameter("u", "m/s", -0.5, 0.5)'
        return
    yield from _misdeclared(effect)
    returned = _call(effect, impacts)
    if not _fits(returned, effect.place, (len(impacts), impacts.space.D)):
        seen = f"{describe(returned)} on {len(impacts)} impacts"
        yield f"must return {_RETURNS[effect.place].format(D=impacts.space.D)}, from {effect.place}, got {seen}"
        return
    yield from _infinite(effect, impacts)
    for share in _FREE:
        yield from _lasting(effect, impacts, share, rounding)


def lost_gradients(effect: Effect, impacts: Impacts) -> Iterator[str]:
    """Yield each parameter that changes an output without a gradient, as the rest of a sentence about the effect."""
    for k, p in enumerate(effect.parameters):
        if _lacks_gradient(effect, k, impacts):
            yield (
                f"depends on {p.name}, but has no gradient in it, by which it is fitted; let torch alone compute with "
                "it: no float(), item(), detach(), round or numpy"
            )


def added(effect: Effect, impacts: Impacts, measured: Impacts) -> dict[str, Float[Tensor, "..."]]:
    """Return what an effect adds at its place to each quantity, by name, from the state of impacts before contact.

    Args:
        effect: prepared, away from its vanishing values.
        impacts: whose state it sees.
        measured: impacts that give it the same wrench and velocity after contact whatever its state is.
    """
    state, *given = _given(effect.place, measured)
    state = State.of(impacts).replace(mu=state.mu, eps=state.eps)
    before = _unchanged(effect.place, (state, *given))
    after = _outputs(effect.place, getattr(effect, effect.place)(state, *given))
    return {name: values - before[name] for name, values in after.items()}


def describe(returned: object) -> str:
    """Describe what a user's method returned, in a few words."""
    if isinstance(returned, tuple):
        return f"({', '.join(map(describe, returned))})"
    return f"a tensor {[*returned.shape]}" if isinstance(returned, Tensor) else type(returned).__name__


def named_outputs(place: str, parts: Float[Tensor, "... k"]) -> dict[str, Float[Tensor, "..."]]:
    """Return the parts of a wrench or a velocity [..., N, D] by the names of the place's outputs."""
    space = PLANE if parts.shape[-1] == PLANE.D else SPACE
    return dict(zip(outputs(place, space), parts.unbind(-1), strict=True))


def _misdeclared(effect: Effect) -> Iterator[str]:
    """Rules of the declared parameters."""
    for p in effect.parameters:
        if not p.unit:
            yield f"must give its parameter {p.name} a unit, – for a number"
        if not p.low < p.high or any(v is not None and not p.low <= v <= p.high for v in (p.start, p.vanishing)):
            yield f"must give its parameter {p.name} low < high, and a start and a vanishing value between them"
    named = sorted(name for _, name, _, _ in Formatter().parse(effect.in_words) if name is not None)
    if effect.in_words and named != sorted(p.name for p in effect.every_parameter()):
        yield f"must name each of its parameters once in in_words, got {effect.in_words!r}"


def _given(place: str, impacts: Impacts) -> tuple[Any, ...]:
    """Arguments of the method of a place."""
    middle = torch.full_like(impacts.mass, 0.5)
    state = State.of(impacts).replace(mu=middle, eps=middle)
    further = {"law": (middle, middle), "wrench": (impacts.wrench,), "velocity": (impacts.v_post,)}
    return state, *further.get(place, ())


def _call(effect: Effect, impacts: Impacts) -> Any:
    """Call the method of the effect's place."""
    return getattr(effect, effect.place)(*_given(effect.place, impacts))


def _fits(returned: object, place: str, shape: tuple[int, int]) -> bool:
    """Whether a method returned the type that its place requires, in the shape of the impacts."""
    if place == "state":
        return isinstance(returned, State)
    if place == "law":
        return isinstance(returned, tuple) and len(returned) == 2 and all(isinstance(x, Tensor) for x in returned)
    return isinstance(returned, Tensor) and returned.shape[-2:] == shape


def _outputs(place: str, returned: Any) -> dict[str, Float[Tensor, "..."]]:
    """Quantities [..., N] that a method returned by name, all that a state holds."""
    if place == "law":
        return dict(zip(("mu", "eps"), returned, strict=True))
    if place != "state":
        return named_outputs(place, returned)
    parts = dict(zip(("rx", "ry", "rz"), returned.r.unbind(-1), strict=False))
    parts |= {"mass": returned.mass, "corner": returned.corner, "tilt": returned.tilt}
    inertia = returned.inertia
    if returned.space is PLANE:
        parts["theta"], inertia = returned.theta, inertia[..., None]
    elif returned.tilt is not None:
        parts["tilt"] = (returned.tilt - torch.eye(3).to(returned.tilt)).abs().amax((-2, -1))  # from the identity
    vectors = {"v_pre": returned.v_pre, "q": returned.q, "inertia": inertia}
    for name, value in {"stretch": returned.stretch, **{name: x.unbind(-1) for name, x in vectors.items()}}.items():
        parts |= {f"{name}[{k}]": part for k, part in enumerate(value)}
    return {name: torch.as_tensor(0.0 if value is None else value) for name, value in parts.items()}


def _unchanged(place: str, given: tuple[Any, ...]) -> dict[str, Float[Tensor, "..."]]:
    """Quantities by name that a method of a place would return if it changed nothing, from its arguments."""
    return _outputs(place, given[1:] if place == "law" else given[-1])


def _infinite(effect: Effect, impacts: Impacts) -> Iterator[str]:
    """Outputs at the start, or else derivatives in the parameters, that are no finite numbers on some trials."""
    start = torch.tensor([[p.start] for p in effect.parameters], dtype=torch.float64).to(impacts.mass)
    with torch.enable_grad():
        values = [value.requires_grad_() for value in start.repeat(1, len(impacts)).unbind()]
        outputs = _outputs(effect.place, _call(effect.at(values), impacts))
        bad = [_bad_trials(f"gives {output} the value", value.detach(), impacts) for output, value in outputs.items()]
        if any(bad):
            yield from filter(None, bad)
            return
        changed = [value.sum() for value in outputs.values() if value.requires_grad]
        slopes = torch.autograd.grad(torch.stack(changed).sum(), values, allow_unused=True) if changed else ()
        for p, slope in zip(effect.parameters, slopes, strict=bool(changed)):
            if slope is not None and (broken := _bad_trials(f"has the derivative in {p.name}", slope, impacts)):
                yield broken


def _lasting(effect: Effect, impacts: Impacts, share: float | None, rounding: float) -> Iterator[str]:
    """Outputs that the effect changes where it should vanish, with the free parameters at a share of their ranges."""
    free = (p.start if share is None else p.low + share * (p.high - p.low) for p in effect.parameters)
    values = [f if p.vanishing is None else p.vanishing for f, p in zip(free, effect.parameters, strict=True)]
    given = _given(effect.place, impacts)
    before = _unchanged(effect.place, given)
    units = outputs(effect.place, impacts.space)
    for output, after in _outputs(effect.place, _call(effect.at(values), impacts)).items():
        change = (after - before[output]).abs()
        if broken := _bad_trials(f"gives {output}, where it should vanish, the value", change, impacts):
            yield broken
        elif change.max() > rounding:
            at = ", ".join(f"{p.name} = {v:g}" for p, v in zip(effect.parameters, values, strict=True))
            amount = f"{change.max():g} {units.get(output, '')}".rstrip()
            yield (
                f"must change nothing where it vanishes, and at {at} it adds up to {amount} to {output}; a factor is "
                "missing that is 0 there, or a parameter's vanishing value is another one"
            )


def _bad_trials(sentence: str, value: Float[Tensor, "..."], impacts: Impacts) -> str | None:
    """Name the first trial on which a value of each trial is infinite or no number."""
    value = value.broadcast_to(len(impacts))
    bad = ~value.isfinite()
    if not bad.any():
        return None
    row = int(bad.nonzero()[0, 0])
    return (
        f"{sentence} {value[row].item():g} on trial {impacts.trial[row]!r} of {impacts.source} ({int(bad.sum())} of "
        f"{len(impacts)} trials); is it a root, logarithm or power of a negative number or of 0, or should a parameter "
        "start elsewhere?"
    )


def _lacks_gradient(effect: Effect, k: int, impacts: Impacts) -> bool:
    """Whether an output depends on the k-th parameter, and none of its gradients shows it."""
    p = effect.parameters[k]
    shares = torch.tensor(_SHARES, dtype=torch.float64)[:, None].to(impacts.mass)
    tried = (p.start + shares * (p.high - p.low)).clamp(p.low, p.high).requires_grad_()
    others = [torch.full_like(tried, p.start + 0.3 * (p.high - p.start)) for p in effect.parameters]
    with torch.enable_grad():
        changed = _outputs(effect.place, _call(effect.at([*others[:k], tried, *others[k + 1 :]]), impacts)).values()
        if not any(value.ndim > 1 and bool((value != value[:1]).any()) for value in changed):
            return False
        total = torch.stack([value.sum() for value in changed]).sum()
        return not (total.requires_grad and bool(torch.autograd.grad(total, tried)[0].any()))
