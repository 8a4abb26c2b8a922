"""Laws by name: `impulse` evaluates one on a batch, `Law` holds its parameters."""

from dataclasses import dataclass

import torch
from torch import Tensor

from contactlearn.errors import UnknownNameError
from contactlearn.laws import (
    anitescu_potra_newton,
    anitescu_potra_poisson,
    chatterjee_ruina,
    drumwright_shell,
    mirtich,
    wang_mason,
    whittaker,
)
from contactlearn.laws.base import Contact

_LAWS = {
    "whittaker": whittaker.VARIANTS,
    "anitescu_potra_newton": anitescu_potra_newton.VARIANTS,
    "anitescu_potra_poisson": anitescu_potra_poisson.VARIANTS,
    "drumwright_shell": drumwright_shell.VARIANTS,
    "wang_mason": wang_mason.VARIANTS,
    "mirtich": mirtich.VARIANTS,
    "chatterjee_ruina": chatterjee_ruina.VARIANTS,
}
PAPER_LAWS = tuple(name for name in _LAWS if name != "chatterjee_ruina")
"""The six laws that the paper compares."""

_BLOCK = 1 << 16  # elements evaluated at once: the temporaries of a law then stay in cache
_COLUMNS = 128  # trials among them


def names() -> tuple[str, ...]:
    """Names of all laws: the paper's six, then Chatterjee & Ruina's."""
    return tuple(_LAWS)


def check(name: str, variant: str = "textbook") -> None:
    """Raise UnknownNameError for a law or variant that does not exist."""
    if name not in _LAWS:
        raise UnknownNameError("law", name, _LAWS)
    if variant not in _LAWS[name]:
        raise UnknownNameError("variant", variant, _LAWS[name])


def impulse(
    name: str,
    W: Tensor,
    v_c: Tensor,
    mu: Tensor | float,
    eps: Tensor | float,
    *,
    variant: str = "textbook",
    e_t: Tensor | float = 0.0,
    out: Tensor | None = None,
) -> Tensor:
    """Contact impulse P = (P_t, P_n) [..., N, 2] in N s of the law `name`.

    Args:
        name: one of `names()`.
        W: inverse effective inertia [..., N, 2, 2] in 1/kg.
        v_c: contact-point velocity (v_t, v_n) [..., N, 2] in m/s before contact, v_n < 0.
        mu: coefficient of friction ≥ 0, broadcast against [..., N]: a (G, 1) tensor sweeps G values.
        eps: coefficient of restitution in [0, 1], likewise.
        variant: `textbook`, or `fazeli2017` for what the paper's authors computed.
        e_t: tangential restitution, Chatterjee & Ruina only.
        out: where to write P, so that repeated sweeps over a large grid reuse their memory; no gradients.

    Raises:
        UnknownNameError: no such law or variant.
    """
    check(name, variant)
    contact = Contact(W[..., 0, 0], W[..., 0, 1], W[..., 1, 1], v_c[..., 0], v_c[..., 1])
    mu, eps, e_t = (torch.as_tensor(x, dtype=W.dtype, device=W.device) for x in (mu, eps, e_t))
    parameters = (mu, eps, e_t) if name == "chatterjee_ruina" else (mu, eps)
    law = _LAWS[name][variant]
    inputs = (*contact, *parameters)
    shape = torch.broadcast_tensors(*inputs)[0].shape
    grad = torch.is_grad_enabled() and any(x.requires_grad for x in inputs)
    if out is None and (grad or len(shape) < 2 or shape.numel() <= _BLOCK):
        return torch.stack(torch.broadcast_tensors(*law(contact, *parameters)), -1)
    P = torch.empty((*shape, 2), dtype=W.dtype, device=W.device) if out is None else out
    # Blocks of a few rows and columns: what depends on one parameter alone is then computed once for
    # all rows of a block, and not once for every impulse.
    columns = min(shape[-1], _COLUMNS)
    rows = max(1, _BLOCK // (shape[1:-1].numel() * columns))
    for top in range(0, shape[0], rows):
        for left in range(0, shape[-1], columns):
            place = (slice(top, top + rows), ..., slice(left, left + columns))
            block = tuple(_part(x, len(shape), place) for x in inputs)
            P_t, P_n = law(Contact(*block[:5]), *block[5:])
            P[(*place, 0)], P[(*place, 1)] = P_t, P_n
    return P


def _part(x: Tensor, dimensions: int, place: tuple) -> Tensor:
    """The part of an input that a block of the broadcast result needs."""
    if x.ndim == dimensions and x.shape[0] > 1:
        x = x[place[0]]
    return x[..., place[-1]] if x.ndim and x.shape[-1] > 1 else x


@dataclass(frozen=True)
class Law:
    """A law with its parameters: μ (friction), ε (normal restitution), e_t (tangential restitution)."""

    name: str
    mu: Tensor | float
    eps: Tensor | float
    variant: str = "textbook"
    e_t: Tensor | float = 0.0

    def __post_init__(self):
        check(self.name, self.variant)

    def __str__(self) -> str:
        mu, eps = (torch.as_tensor(x, dtype=torch.float64).mean().item() for x in (self.mu, self.eps))
        return f"{self.name} ({self.variant}): μ = {mu:.3f}, ε = {eps:.3f}"

    def impulse(self, W: Tensor, v_c: Tensor) -> Tensor:
        """Contact impulse P [..., N, 2] in N s; see `impulse`."""
        return impulse(self.name, W, v_c, self.mu, self.eps, variant=self.variant, e_t=self.e_t)
