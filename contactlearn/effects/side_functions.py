"""Functions of the side on which a body in space lands, which restitution and friction share: their {quantity}.

    SidesOfBody      spherical harmonics of the first and second degree
    CapOnBody        a/(1 + (2 sin(γ/2)/w)⁴), γ from the middle of one side
    ContactOnBody    the same of the contact point
    FacesOfBody      a value for each of the six faces of a box
    CornersOfBody    a value for each of the eight corners of a box

They are functions of a direction in the axes of the body: n from its mass centre straight down to the floor, or that of
the contact point, which a polyhedron has for each of its corners alone.
"""

from abc import ABC, abstractmethod
from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.frozen import Frozen
from contactlearn.effects.base import OWN_FAMILY, parameter, usual_parameter
from contactlearn.effects.state import State
from contactlearn.mechanics.rigid_body import in_body, rotation
from contactlearn.mechanics.space import SPACE

_LEAST = 1e-12  # m


class OfSide(Frozen, ABC):
    """A function of a direction in the body's axes, added to a coefficient."""

    spaces = (SPACE,)
    mirror_symmetric = False
    refines: ClassVar[tuple[str, ...]] = (OWN_FAMILY,)
    of_contact_point: ClassVar[bool] = False
    """Whether the direction is that of the contact point, not of the floor."""

    @abstractmethod
    def change(self, direction: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n"]:
        """Evaluate the function at unit vectors [..., N, 3]."""

    def coefficient(self, state: State, value: Float[Tensor, "..."]) -> Float[Tensor, "..."]:
        """Return the coefficient with the function of the side added."""
        if not self.of_contact_point:
            return value + self.change(-rotation(state.q[..., 3:])[..., 2, :])
        point = in_body(state.r, state.q)
        return value + self.change(point / point.norm(dim=-1, keepdim=True).clamp_min(_LEAST))


class SidesOfBody(OfSide):
    """a·n + b_xx (n_x² − n_z²) + b_yy (n_y² − n_z²) + b_xy n_x n_y + b_yz n_y n_z + b_zx n_z n_x."""

    form = "sides"
    formula = (
        "{quantity} ← {quantity} + Σ a_i n_i + b_xx (n_x² − n_z²) + b_yy (n_y² − n_z²) + Σ b_ij n_i n_j, n to the floor"
    )
    refines = ()
    a_x: Tensor | float = usual_parameter("a_x")
    a_y: Tensor | float = usual_parameter("a_y")
    a_z: Tensor | float = usual_parameter("a_z")
    b_xx: Tensor | float = usual_parameter("b_xx")
    b_yy: Tensor | float = usual_parameter("b_yy")
    b_xy: Tensor | float = usual_parameter("b_xy")
    b_yz: Tensor | float = usual_parameter("b_yz")
    b_zx: Tensor | float = usual_parameter("b_zx")

    def change(self, direction: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n"]:
        x, y, z = direction.unbind(-1)
        first = self.a_x * x + self.a_y * y + self.a_z * z
        squares = self.b_xx * (x * x - z * z) + self.b_yy * (y * y - z * z)
        return first + squares + self.b_xy * x * y + self.b_yz * y * z + self.b_zx * z * x


class CapOnBody(OfSide):
    """a/(1 + (2 sin(γ/2)/w)⁴) at an angle γ from the direction of longitude λ and latitude β."""

    form = "cap"
    formula = "{quantity} ← {quantity} + a/(1 + (2 sin(γ/2)/w)⁴), γ from (λ, β) to the floor"
    in_words = "{quantity} changes by {a} on the side at longitude {longitude} and latitude {latitude}, within ±{w}"
    a: Tensor | float = usual_parameter("a")
    longitude: Tensor | float = parameter("λ", "rad", -3.2, 3.2, vanishing=None, start=0.0)
    latitude: Tensor | float = parameter("β", "rad", -1.6, 1.6, vanishing=None, start=0.0)
    w: Tensor | float = parameter("w", "rad", 0.2, 1.6, vanishing=None, start=0.8)

    def change(self, direction: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n"]:
        (x, y, z), turn, rise = direction.unbind(-1), torch.as_tensor(self.longitude), torch.as_tensor(self.latitude)
        cosine = rise.cos() * (turn.cos() * x + turn.sin() * y) + rise.sin() * z
        away = 2 * (1 - cosine) / torch.as_tensor(self.w) ** 2  # squared
        return self.a / (1 + away.square())


class ContactOnBody(CapOnBody):
    """The same by the direction of the contact point."""

    form = "contact"
    formula = "{quantity} ← {quantity} + a/(1 + (2 sin(γ/2)/w)⁴), γ from (λ, β) to the contact point"
    in_words = "{quantity} changes by {a} in contacts at longitude {longitude} and latitude {latitude}, within ±{w}"
    of_contact_point = True


class FacesOfBody(OfSide):
    """Δ of the face that is nearest to straight down; the mean of the six is 0."""

    form = "faces"
    formula = "{quantity} ← {quantity} + Δ of the face ±x, ±y, ±z of the body that is lowest"
    d_x: Tensor | float = usual_parameter("Δ_x")
    d_y: Tensor | float = usual_parameter("Δ_y")
    d_z: Tensor | float = usual_parameter("Δ_z")
    m_x: Tensor | float = usual_parameter("m_x")
    m_y: Tensor | float = usual_parameter("m_y")

    def change(self, direction: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n"]:
        lowest = direction.abs() >= direction.abs().amax(-1, keepdim=True)
        x, y, z = (direction.sign() * lowest).unbind(-1)  # d is half the difference of two faces, m their mean
        mean_x, mean_y = x * x - z * z, y * y - z * z
        return self.d_x * x + self.d_y * y + self.d_z * z + self.m_x * mean_x + self.m_y * mean_y


class CornersOfBody(OfSide):
    """Σ a_i s_i + b_xy s_x s_y + b_yz s_y s_z + b_zx s_z s_x + c s_x s_y s_z with the signs s: Walsh's functions."""

    form = "corners"
    formula = (
        "{quantity} ← {quantity} + Σ a_i s_i + Σ b_ij s_i s_j + c s_x s_y s_z, s signs of the contact point in the "
        "body's axes"
    )
    of_contact_point = True
    a_x: Tensor | float = usual_parameter("a_x")
    a_y: Tensor | float = usual_parameter("a_y")
    a_z: Tensor | float = usual_parameter("a_z")
    b_xy: Tensor | float = usual_parameter("b_xy")
    b_yz: Tensor | float = usual_parameter("b_yz")
    b_zx: Tensor | float = usual_parameter("b_zx")
    c: Tensor | float = usual_parameter("c")

    def change(self, direction: Float[Tensor, "... n 3"]) -> Float[Tensor, "... n"]:
        x, y, z = direction.sign().unbind(-1)
        first = self.a_x * x + self.a_y * y + self.a_z * z
        return first + self.b_xy * x * y + self.b_yz * y * z + self.b_zx * z * x + self.c * x * y * z
