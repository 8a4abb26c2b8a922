"""The interface of all laws: a frozen dataclass with its coefficients μ and ε, and one closed form.

    class Frictionless(Law):
        \"\"\"Newton restitution without friction.\"\"\"

        def solve(self, contact, mu, eps):
            P_n = -(1 + eps) * contact.v_n / contact.w_nn
            return 0 * P_n, P_n

Everything else follows from that: batches, identification, bounds, diagnosis, figures, the configuration.  Further
fields are options of the law, which are given and not fitted.  The class attributes say in what a law differs from
rigid contact with Coulomb friction; `contactlearn.testing.LawContract` holds it to them.  docs/laws.md is the guide.
"""

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any, ClassVar, Self

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.errors import ContactLearnError
from contactlearn.core.frozen import Frozen
from contactlearn.core.numerics import finite_number
from contactlearn.laws.contact import Contact, Impulse, SpatialContact, Values
from contactlearn.mechanics.space import BOTH, PLANE, SPACE, Space, require_space

_BLOCK = 1 << 16  # elements evaluated at once: the temporaries of a law then stay in cache
_COLUMNS = 128  # trials among them


class Law(Frozen, ABC):
    """An impact law (W, v_c, μ, ε) → P with its coefficients of friction μ ≥ 0 and of restitution ε in [0, 1].

    Both are dimensionless and broadcast against trials [..., N].  A law is not a `ContactModel`: it gives the impulse
    at the contact point and knows no body.
    """

    compares: ClassVar[bool] = True
    mu: Values | float = 0.0
    eps: Values | float = 0.0

    name: ClassVar[str]
    """Name of the family, such as `wang_mason`; the class name in snake case if left out."""
    variant: ClassVar[str] = "textbook"
    """Variant of the family: `textbook`, or `fazeli2017` for the law as the paper's authors computed it."""
    label: ClassVar[str]
    """Label in figures and text; derived from the name if left out."""
    citations: ClassVar[tuple[str, ...]] = ()
    """BibTeX keys of references.bib, or whole entries; `contactlearn.cite` prints them."""
    paper: ClassVar[int | None] = None
    """Place among the six laws that the paper compares, from 1; None for any other law."""
    mu_axis: ClassVar[str] = "Friction μ (–)"
    """Axis label of μ with its unit."""
    adds_energy: ClassVar[bool] = False
    """Whether the kinetic energy may increase."""
    leaves_cone: ClassVar[bool] = False
    """Whether |P_t| may exceed μ P_n."""
    pulls: ClassVar[bool] = False
    """Whether P_n may be negative."""
    penetrates: ClassVar[bool] = False
    """Whether v_n⁺ may be negative."""
    scales: ClassVar[bool] = True
    """Whether k times the velocity gives k times the impulse at the same μ and ε."""
    mirror_symmetric: ClassVar[bool] = True
    """Whether the mirror image of a contact has the mirror image of its impulse."""
    spaces: ClassVar[tuple[Space, ...]]
    """Spaces in which it exists: the plane, or both if it overrides `solve_in_space`."""
    refines: ClassVar[bool] = False
    """Whether a diagnosis tries it only in the place of a law that does no better, since it takes ten times as long."""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "name" not in cls.__dict__:
            cls.name = re.sub(r"(?<!^)(?=[A-Z])", "_", cls.__name__).lower()
        cls.spaces = (PLANE,) if cls.solve_in_space is Law.solve_in_space else BOTH
        if "label" not in cls.__dict__:
            cls.label = cls.name.replace("_", " ").capitalize()

    def __str__(self) -> str:
        mu, eps = (x.mean().item() for x in self.coefficients)
        return f"{self.name} ({self.variant}): μ = {mu:.3f}, ε = {eps:.3f}"

    @abstractmethod
    def solve(self, contact: Contact, mu: Values, eps: Values) -> tuple[Values, Values]:
        """Return the impulse (P_t, P_n) in N s in closed form.

        All tensors broadcast against [..., N].  A division by a quantity that may vanish in a branch that is not
        taken must be guarded, so that gradients stay finite there.

        Args:
            contact: W and v_c by component; v_n < 0, W positive definite.
            mu, eps: to be used instead of the law's own.
        """

    def solve_in_space(self, contact: SpatialContact, mu: Values, eps: Values) -> Impulse:
        """Return the impulse (P_1, P_2, P_n) in N s along the slip, across it and along the normal, as `solve`."""
        raise AssertionError(f"`impulse` refuses {self.name} in space")

    @property
    def coefficients(self) -> tuple[Values, Values]:
        """μ and ε as float64 tensors."""
        return torch.as_tensor(self.mu, dtype=torch.float64), torch.as_tensor(self.eps, dtype=torch.float64)

    @property
    def options(self) -> dict[str, Any]:
        """Fields other than μ and ε."""
        return {field.name: getattr(self, field.name) for field in fields(self) if field.name not in ("mu", "eps")}

    def at(self, mu: Values | float, eps: Values | float) -> Self:
        """Return the law with other coefficients.

        Raises:
            DataError: a number μ < 0 or ε outside [0, 1]; tensors, such as those of a search, are taken as they are.
        """
        for name, value, high in (("mu", mu, math.inf), ("eps", eps, 1.0)):
            if not isinstance(value, Tensor):
                finite_number(name, value, 0.0, high)
        return replace(self, mu=mu, eps=eps)

    def impulse(
        self,
        W: Float[Tensor, "*#batch d d"],
        v_c: Float[Tensor, "*#batch d"],
        *,
        out: Float[Tensor, "*batch d"] | None = None,
    ) -> Float[Tensor, "*batch d"]:
        """Return the contact impulse P [..., N, d] in N s, its normal component last.

        Args:
            W: inverse effective inertia [..., N, d, d] in 1/kg; d is 2 in the plane, 3 in space.
            v_c: contact-point velocity [..., N, d] in m/s before contact, v_n < 0.
            out: where to write P, so that repeated sweeps over a large grid reuse their memory; no gradients.

        The coefficients broadcast against [..., N]: μ of shape (G, 1) sweeps G values.

        Raises:
            ContactLearnError: no tensors, or of another shape; or the law does not exist in space.
        """
        sizes = (*W.shape[-2:], *v_c.shape[-1:]) if isinstance(W, Tensor) and isinstance(v_c, Tensor) else ()
        if sizes not in ((2, 2, 2), (3, 3, 3)):
            seen = " and ".join(f"{type(x).__name__} {list(getattr(x, 'shape', ()))}" for x in (W, v_c))
            raise ContactLearnError(
                f"W [..., N, d, d] and v_c [..., N, d] must be tensors, such as impacts.W and impacts.v_c, got {seen}"
            )
        if v_c.shape[-1] == 2:
            contact, direction, kind, solve = Contact.of(W, v_c), (), Contact, "solve"
        else:
            require_space(f"law {self.name} ({self.variant})", SPACE, self.spaces)
            (contact, direction), kind, solve = SpatialContact.of(W, v_c), SpatialContact, "solve_in_space"
        mu, eps = (torch.as_tensor(x, dtype=W.dtype, device=W.device) for x in (self.mu, self.eps))
        varying = {name: value for name, value in self.options.items() if isinstance(value, Tensor)}
        inputs = (*contact, mu, eps, *direction, *varying.values())
        shape = torch.broadcast_tensors(*inputs)[0].shape
        grad = torch.is_grad_enabled() and any(x.requires_grad for x in inputs)
        if out is None and (grad or len(shape) < 2 or shape.numel() <= _BLOCK):
            parts = _in_world(getattr(self, solve)(contact, mu, eps), direction)
            return torch.stack([part.expand(shape) for part in parts], -1)
        P = torch.empty((*shape, v_c.shape[-1]), dtype=W.dtype, device=W.device) if out is None else out
        ends = len(contact), len(contact) + 2, len(contact) + 2 + len(direction)
        for place in _blocks(shape):
            block = [_part(x, len(shape), place) for x in inputs]
            law = replace(self, **dict(zip(varying, block[ends[2] :], strict=True))) if varying else self
            parts = getattr(law, solve)(kind(*block[: ends[0]]), *block[ends[0] : ends[1]])
            for k, part in enumerate(_in_world(parts, block[ends[1] : ends[2]])):
                P[(*place, k)] = part
        return P


def _in_world(parts: Sequence[Tensor], direction: Sequence[Tensor]) -> Sequence[Tensor]:
    """Components of an impulse in world axes, from those in the axes of a slip of some direction, if it has one."""
    if not direction:
        return parts
    (P_1, P_2, P_n), (c, s) = parts, direction
    return c * P_1 - s * P_2, s * P_1 + c * P_2, P_n


def _blocks(shape: torch.Size) -> list[tuple[Any, ...]]:
    """Places of blocks of a few rows and columns each.

    A term that depends on one parameter alone is then computed once for all rows of a block, and not for every impulse.
    """
    columns = min(shape[-1], _COLUMNS)
    rows = max(1, _BLOCK // (shape[1:-1].numel() * columns))
    return [
        (slice(top, top + rows), ..., slice(left, left + columns))
        for top in range(0, shape[0], rows)
        for left in range(0, shape[-1], columns)
    ]


def _part(x: Tensor, dimensions: int, place: tuple[Any, ...]) -> Tensor:
    """The part of an input that a block of the broadcast result needs."""
    if x.ndim == dimensions and x.shape[0] > 1:
        x = x[place[0]]
    return x[..., place[-1]] if x.ndim and x.shape[-1] > 1 else x
