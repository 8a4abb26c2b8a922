"""Classes of a user's own, tried on a few drops before any work: a slip in them is one line, and no lost night.

A class that passes may still break a rule; `contactlearn.testing` has the whole contract.
"""

import inspect
import traceback
from collections.abc import Generator
from contextlib import contextmanager, suppress

import torch
from torch import Tensor

from contactlearn.cli.commands.job import reason
from contactlearn.core.errors import ContactLearnError
from contactlearn.effects import Effect, State
from contactlearn.laws import Contact, Law, find
from contactlearn.mechanics.impacts import Impacts
from contactlearn.models.contact_model import resolve
from contactlearn.simulation import synthetic

_DROPS, _MU, _EPS = 5, 0.2, 0.5
_ROUNDING = 1e-9  # m/s and rad/s
_SHARES = (-0.4, -0.15, 0.1, 0.3, 0.45)  # of a parameter's range, from its vanishing value on: where it is tried
_RETURNS = {
    "state": "a state, such as state.replace(r=…)",
    "law": "two tensors (mu, eps)",
    "wrench": "the wrench, a tensor [..., N, 3]",
    "velocity": "v_post, a tensor [..., N, 3]",
}

_NO_IF = "; a parameter has many values at once: torch.where(condition, a, b) takes the place of if"
_LOST = (
    "depends on {}, but has no gradient in it, by which it is fitted; let torch alone compute with it: "
    "no float(), item(), detach(), round or numpy"
)


@contextmanager
def in_one_line(target: object, kind: type) -> Generator[None]:
    """Say of whatever a class raises where in its own file that is.

    Raises:
        ContactLearnError: with the class, the method, the line and the error.
    """
    try:
        yield
    except ContactLearnError:
        raise
    except Exception as error:  # whatever code of the user's own may raise
        frames = traceback.extract_tb(error.__traceback__)
        own = [frame for frame in frames if frame.filename == inspect.getfile(kind)]
        where = (own or frames)[-1]
        hint = _NO_IF if str(error).startswith("Boolean value of Tensor") else ""
        said = f"{target} fails in {where.name}, line {where.lineno}: {reason(error)}{hint}"
        raise ContactLearnError(said) from error


def try_effect(effect: Effect, target: object) -> None:
    """Use an effect on a few drops, unless they are none for it.

    Raises:
        ContactLearnError: it has no parameter, returns something else than its method should, changes the outcome
            where it vanishes, or depends on a parameter without a gradient.
    """
    fault = None
    drops = synthetic.load(size=_DROPS)
    with suppress(ContactLearnError):  # of an effect that wants other drops
        fault = _fault(effect.prepare(drops), drops)
    if fault:
        raise ContactLearnError(f"{target} {fault}")


def _fault(effect: Effect, drops: Impacts) -> str | None:
    """What is wrong with an effect, as the end of a sentence."""
    if not effect.parameters and type(effect).parameters is not Effect.parameters:
        return None  # those of other drops, such as one a body
    if not effect.parameters:
        return 'has no parameter to fit; declare one, such as u: float = parameter("u", "m/s", -0.5, 0.5)'
    mu, eps = (torch.full((_DROPS,), value, dtype=torch.float64) for value in (_MU, _EPS))
    state = State.of(drops).replace(mu=mu, eps=eps)
    inputs = {"state": (state,), "law": (state, mu, eps), "wrench": (state, drops.wrench)}
    returned = getattr(effect, effect.place)(*inputs.get(effect.place, (state, drops.v_post)))
    if not _fits(returned, effect.place):
        seen = f"{_seen(returned)} on {_DROPS} impacts"
        return f"must return {_RETURNS[effect.place]}, from {effect.place}, got {seen}"
    rest = effect.vanished()
    moved = (_outcome(rest, drops) - _outcome(None, drops)).abs().max().item()
    if moved > _ROUNDING and any(p.vanishing is not None for p in effect.parameters):
        values = ", ".join(f"{p.name} = {p.start:g}" for p in rest.parameters)
        return f"must change nothing where it vanishes, at {values}, but changes the outcome by {moved:.3g}"
    lost = [p.name for k, p in enumerate(rest.parameters) if _is_lost(rest, k, drops)]
    return _LOST.format(lost[0]) if lost else None


def _fits(returned: object, place: str) -> bool:
    """Whether a method of an effect returns the kind of thing that it must, of the shape of the impacts."""
    if place == "state":
        return isinstance(returned, State)
    if place == "law":
        return isinstance(returned, tuple) and len(returned) == 2 and all(isinstance(x, Tensor) for x in returned)
    return isinstance(returned, Tensor) and returned.shape[-2:] == (_DROPS, 3)


def _seen(returned: object) -> str:
    """What a method has returned, in a few words."""
    if isinstance(returned, tuple):
        return f"({', '.join(map(_seen, returned))})"
    return f"a tensor {[*returned.shape]}" if isinstance(returned, Tensor) else type(returned).__name__


def _outcome(effect: Effect | None, drops: Impacts) -> Tensor:
    """v_post [..., N, 3] of a law with an effect, or without one."""
    effects = {} if effect is None else {effect.name: effect}
    like = torch.zeros(1) if effect is None else effect.values[0]
    mu, eps = (torch.full_like(like, value, dtype=torch.float64) for value in (_MU, _EPS))
    return resolve(find("wang_mason"), effects, State.of(drops), mu, eps).v_post


def _is_lost(effect: Effect, k: int, drops: Impacts) -> bool:
    """Whether the outcome depends on the k-th parameter, and none of its gradients says so."""
    own = effect.parameters[k]
    tried = own.start + torch.tensor(_SHARES, dtype=torch.float64)[:, None] * (own.high - own.low)
    tried = tried.clamp(own.low, own.high).requires_grad_()
    others = [torch.full_like(tried, p.start + _SHARES[-2] * (p.high - p.start)) for p in effect.parameters]
    values = [*others[:k], tried, *others[k + 1 :]]
    with torch.enable_grad():
        outcome = _outcome(effect.at(values), drops)
        slopes = torch.autograd.grad(outcome.sum(), tried) if outcome.requires_grad else [torch.zeros(1)]
    depends = outcome.ndim > 2 and bool((outcome != outcome[:1]).any())
    return depends and not slopes[0].any()


def try_law(law: Law, target: object) -> None:
    """Use a law on a few contacts, with several coefficients at once.

    Raises:
        ContactLearnError: it returns something else than two tensors of impulses, or no numbers.
    """
    drops = synthetic.load(size=_DROPS)
    mu, eps = (torch.tensor(values, dtype=torch.float64)[:, None] for values in ((0.1, _MU), (0.3, _EPS)))
    contact = Contact(drops.W[:, 0, 0], drops.W[:, 0, 1], drops.W[:, 1, 1], *drops.v_c.unbind(-1))
    returned: object = law.solve(contact, mu, eps)
    pair = isinstance(returned, tuple | list) and len(returned) == 2
    if not pair or not all(isinstance(part, Tensor) for part in returned):
        raise ContactLearnError(f"{target}.solve must return two tensors (P_t, P_n) of impulses, got {_seen(returned)}")
    if not law.at(mu, eps).impulse(drops.W, drops.v_c).isfinite().all():
        raise ContactLearnError(f"{target}.solve gives an impulse that is no finite number on ordinary contacts")
