"""The simulated experiment: the true body and floor, and the same in MuJoCo's own language."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from contactlearn.core.errors import DataError, UnknownNameError
from contactlearn.core.numerics import finite_number
from contactlearn.mechanics.rigid_body import contact_velocity, rotate
from contactlearn.mechanics.shapes import Ellipse, Polygon, Shape, contact_point

KINDS = ("ellipse", "box")
GRAVITY = 9.81  # m/s²
STEPS = 100  # in one contact time

# y points away from the reader, who sees x to the right and z up, so counter-clockwise is about −y.
MODEL = """
<mujoco>
  <option timestep="{step}" gravity="0 0 {gravity}" cone="elliptic" impratio="1e5" tolerance="0" iterations="20">
    <flag diagexact="enable"/>
  </option>
  <asset>{asset}</asset>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1" quat="{quat}"/>
    <body>
      <joint type="slide" axis="1 0 0" damping="{drag}"/>
      <joint type="slide" axis="0 0 1" damping="{drag}"/>
      <joint type="hinge" axis="0 -1 0" damping="{spin_drag}"/>
      <inertial pos="{com}" mass="{mass}" diaginertia="{inertia} {inertia} {inertia}"/>
      <geom name="body" {geom}/>
    </body>
  </worldbody>
  <contact>
    <pair geom1="floor" geom2="body" condim="3" friction="{mu} {mu} 0 0 0" solimp="{soft} {soft} 1"
          solref="{spring}" solreffriction="{grip}"/>
  </contact>
  <sensor><contact geom1="floor" geom2="body" data="found"/></sensor>
</mujoco>
"""
SOFT = 0.005  # impedance of the constraint; what slip adds to the normal force is in proportion to it
GRIP = 50  # times that slip would decay by a factor e in one contact time, if friction could


@dataclass(frozen=True, kw_only=True)
class Hidden:
    """Effects that act in the simulation and are not reported, each off at 0; see `mujoco.load`."""

    tilt: float = 0.0
    com_offset: Sequence[float] = (0.0, 0.0)
    inertia_error: float = 0.0
    damping: float = 0.0
    delay: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Bench:
    """The simulated experiment: body, contact and hidden effects, as `mujoco.load` takes them.

    Raises:
        DataError: a value out of its range.
        UnknownNameError: no such kind of body.
    """

    kind: str
    semi_axes: Sequence[float]
    mass: float
    mu: float
    eps: float
    contact_time: float
    hidden: Hidden

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise UnknownNameError("kind of body", self.kind, KINDS)
        a, b = _pair("semi_axes", self.semi_axes, (1e-3, 1e-3), (10, 10))
        hidden = Hidden(
            tilt=finite_number("tilt", self.hidden.tilt, -0.5, 0.5),
            com_offset=_pair("com_offset", self.hidden.com_offset, (-a, -b), (a, b)),
            inertia_error=finite_number("inertia_error", self.hidden.inertia_error, -1, 1),
            damping=finite_number("damping", self.hidden.damping, 0, 1e6),
            delay=finite_number("delay", self.hidden.delay, 0, 0.1),
        )
        checked = {
            "semi_axes": (a, b),
            "mass": finite_number("mass", self.mass, 1e-6, 1e3),
            "mu": finite_number("mu", self.mu, 0, 100),
            "eps": finite_number("eps", self.eps, 0.2, 1),
            "contact_time": finite_number("contact_time", self.contact_time, 1e-5, 1e-3),
            "hidden": hidden,
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @cached_property
    def body(self) -> Shape:
        """The body as drawn, of uniform density."""
        a, b = self.semi_axes
        return Ellipse((a, b)) if self.kind == "ellipse" else Polygon(((a, b), (-a, b), (-a, -b), (a, -b)))

    @cached_property
    def nominal_inertia(self) -> float:
        """Moment of inertia in kg m² of the body as drawn: the reported one."""
        return self.mass * self.body.gyration_squared()

    def touch(self, theta: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch 2"]:
        """Where the body meets the tilted floor, from its geometric centre, in world axes in m."""
        tilt = torch.tensor(self.hidden.tilt, dtype=torch.float64)
        return rotate(contact_point(self.body, theta - tilt), tilt)

    def approaches(self, theta: Float[Tensor, "*batch"], v: Float[Tensor, "*batch 3"]) -> Bool[Tensor, "*batch"]:
        """Whether the touching point moves into the tilted floor."""
        velocity = contact_velocity(self.touch(theta), v)
        return velocity[..., 1] * math.cos(self.hidden.tilt) < velocity[..., 0] * math.sin(self.hidden.tilt)

    def spec(self) -> str:
        """The experiment in MuJoCo's own language."""
        a, b = self.body.outline()[:, 0].max().item(), self.body.outline()[:, 1].max().item()
        spring, grip = _solref(self.eps, self.contact_time), (1.0, SOFT * GRIP / self.contact_time)
        # A box is a double pyramid with its rectangle in the middle: a corner touches at one point, not two.
        corners = " ".join(f"{x} 0 {z}" for x, z in ((a, b), (-a, b), (-a, -b), (a, -b)))
        ellipse = isinstance(self.body, Ellipse)
        inertia = self.nominal_inertia * math.exp(self.hidden.inertia_error)
        return MODEL.format(
            step=self.contact_time / STEPS,
            gravity=-GRAVITY,
            quat=f"{math.cos(self.hidden.tilt / 2)} 0 {-math.sin(self.hidden.tilt / 2)} 0",
            asset="" if ellipse else f'<mesh name="box" vertex="{corners} 0 {b} 0 0 {-b} 0"/>',
            geom=f'type="ellipsoid" size="{a} {b} {b}"' if ellipse else 'type="mesh" mesh="box"',
            com=f"{self.hidden.com_offset[0]} 0 {self.hidden.com_offset[1]}",
            mass=self.mass,
            inertia=inertia,
            drag=self.hidden.damping * self.mass,
            spin_drag=self.hidden.damping * inertia,
            mu=self.mu,
            soft=SOFT,
            spring=f"{-spring[0]} {-spring[1]}",
            grip=f"{-grip[0]} {-grip[1]}",
        )


def _solref(eps: float, contact_time: float) -> tuple[float, float]:
    """Stiffness k in 1/s² and damping c in 1/s of a spring and dashpot that only push.

    The penetration is x = −(v/ω_d) e^{−ζωt} sin ω_d t, and the force k x + c ẋ vanishes at ω_d t = 2β
    for ζ = cos β; from there on the body flies freely with ε = exp(−ζω t) = exp(−2β / tan β).
    """
    beta, low, high = 0.0, 0.0, math.pi / 2  # ε grows with β from e⁻² to 1
    for _ in range(60):
        beta = (low + high) / 2
        low, high = (beta, high) if math.exp(-2 * beta / math.tan(beta)) < eps else (low, beta)
    omega = math.pi / contact_time
    return omega**2, 2 * math.cos(beta) * omega


def _pair(
    name: str, values: Sequence[float], low: tuple[float, float], high: tuple[float, float]
) -> tuple[float, float]:
    try:
        first, second = values
    except (TypeError, ValueError):
        raise DataError(f"{name} must be two numbers in m, got {values!r}") from None
    return finite_number(name, first, low[0], high[0]), finite_number(name, second, low[1], high[1])
