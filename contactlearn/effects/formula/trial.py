"""Trial of a formula effect on measurements: finite values and derivatives, and no change where it vanishes."""

from collections.abc import Mapping, Sequence
from typing import ClassVar, Protocol, Self

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.errors import ContactLearnError
from contactlearn.effects.base import Parameter
from contactlearn.effects.formula.symbols import OUTPUTS, SYMBOLS
from contactlearn.effects.state import State
from contactlearn.mechanics.impacts import Impacts


class Tried(Protocol):
    """Parts of a formula effect that a trial uses."""

    place: ClassVar[str]

    @property
    def expressions(self) -> Mapping[str, str]: ...

    @property
    def current(self) -> tuple[Tensor | float, ...]: ...

    @property
    def parameters(self) -> tuple[Parameter, ...]: ...

    def at(self, values: Tensor | Sequence[Tensor | float]) -> Self: ...

    def added(self, state: State, so_far: Mapping[str, Tensor]) -> dict[str, Tensor]: ...


def check_on(effect: Tried, impacts: Impacts) -> None:
    """Evaluate a formula effect and its derivatives on measurements, with μ = ε = 1/2.

    Raises:
        ContactLearnError: the effect adds something where it should vanish, or it or its derivative in a parameter
            is not finite at the start.
    """
    state, so_far = _measured(impacts, effect.place)
    start = torch.tensor([[p.start] for p in effect.parameters], dtype=torch.float64).to(impacts.mass)
    start = start.repeat(1, len(impacts))
    with torch.enable_grad():
        tried = effect.at([value.requires_grad_() for value in start.unbind()])
        parameters = [torch.as_tensor(value) for value in tried.current]
        for output, value in tried.added(state, so_far).items():
            _refuse_infinite(effect, impacts, output, "value", value)
            if not value.requires_grad:  # of no parameter
                continue
            slopes = torch.autograd.grad(value.sum(), parameters, allow_unused=True)
            for p, slope in zip(effect.parameters, slopes, strict=True):
                if slope is not None:
                    _refuse_infinite(effect, impacts, output, f"derivative in {p.name}", slope)
    for share in (None, 0.25, 0.75):  # whatever the values of those that need not vanish
        _refuse_lasting(_vanished(effect, share), impacts, state, so_far)


def named_outputs(place: str, parts: Float[Tensor, "... k"]) -> dict[str, Float[Tensor, "..."]]:
    """The parts of a wrench or a velocity [..., N, 3] by the names of the place's outputs."""
    return dict(zip(OUTPUTS[place], parts.unbind(-1), strict=True))


def _vanished(effect: Tried, share: float | None) -> Tried:
    """The effect where it vanishes; a parameter that need not vanish at its start, or a share of its range up."""
    free = (p.start if share is None else p.low + share * (p.high - p.low) for p in effect.parameters)
    return effect.at([f if p.vanishing is None else p.vanishing for f, p in zip(free, effect.parameters, strict=True)])


def _refuse_lasting(vanished: Tried, impacts: Impacts, state: State, so_far: Mapping[str, Tensor]) -> None:
    for output, value in vanished.added(state, so_far).items():
        _refuse_infinite(vanished, impacts, output, "value where it should vanish", value)
        if value.any():
            at = ", ".join(f"{p.name} = {v:g}" for p, v in zip(vanished.parameters, vanished.current, strict=True))
            raise ContactLearnError(
                f"an effect must change nothing where it vanishes, and at {at} {vanished.expressions[output]!r} adds "
                f"up to {value.abs().max():g} {SYMBOLS[output].unit} to {output}; a factor is missing that is 0 "
                "there, or a parameter's vanishing value is another one"
            )


def _refuse_infinite(effect: Tried, impacts: Impacts, output: str, what: str, value: Tensor) -> None:
    bad = ~value.detach().isfinite().broadcast_to(len(impacts))
    if bad.any():
        row = int(bad.nonzero()[0, 0])
        seen = value.detach().broadcast_to(len(impacts))[row].item()
        raise ContactLearnError(
            f"the formula {effect.expressions[output]!r} of {output} has the {what} {seen:g} on trial "
            f"{impacts.trial[row]!r} of {impacts.source} ({int(bad.sum())} of {len(impacts)} trials); is it a "
            "root, logarithm or power of a negative number or of 0, or should a parameter start elsewhere?"
        )


def _measured(impacts: Impacts, place: str) -> tuple[State, dict[str, Tensor]]:
    """The measurements as an effect of that place sees them, with coefficients in the middle of their ranges."""
    middle = torch.full_like(impacts.mass, 0.5)
    state = State.of(impacts).replace(mu=middle, eps=middle)
    parts = {"wrench": impacts.wrench, "velocity": impacts.v_post}
    if place == "law":
        return state, {"mu": middle, "eps": middle}
    return state, named_outputs(place, parts[place]) if place in parts else {}
