"""A law with its effects in MuJoCo: a scene, and where coefficients depend on the state a function that sets them.

Where the contact scatters this function also draws its deviations, anew for each impact, and there is a table of
`ranges`, for simulators and domain randomisation that know nothing of impacts.

**The body.** It has a free joint, in the plane two slides and a hinge.  Corners are spheres, sharp ones tiny: each
touches at one point; a cylinder is MuJoCo's.  Planar vectors (x, y) are (x, 0, y), and planar angles turn about −y.

**The contact.** MuJoCo gives its penetration r < 0 the acceleration −k r − c ṙ, as long as that pushes: a
spring and dashpot, scaled to the effective mass.  With ζ = c / (2 √k) = cos β the restitution is
ε = exp(−2β / tan β), the same for all poses and speeds but for the coupling with friction.  A soft
constraint (impedance 0.005) with a stiff friction (impratio 10⁵) is Coulomb's cone; MuJoCo's default impedance, 0.9 and
above, would add to the normal force where there is slip.  So the law is `spring_dashpot`, whichever was fitted.

**Slides.** The friction of slides of a rig card holds in contacts that are no bounces, as in `roll_out`: those whose
√(ṙ² + k r²) is at most g `FAINT`.  The spring does not change this speed, and the dashpot lowers it.

**Scatter.** Before an impact the floor is turned by the deviations of the normal, so that it stays as far from the body
as it was; those of the contact point move what touches.  Nothing changes while the body touches.

Source: Todorov, Erez and Tassa (2012), IROS; the engine's own manual, "Computation", for solref.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import torch
from torch import Tensor

from contactlearn.core import __version__
from contactlearn.core.errors import ContactLearnError, DataError
from contactlearn.effects import State
from contactlearn.laws.spring_dashpot import LEAST, damping
from contactlearn.mechanics import rigid_body
from contactlearn.mechanics.apparatus import Estimate
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import GRAVITY
from contactlearn.mechanics.shapes import (
    Cornered,
    Cylinder,
    Disc,
    Ellipse,
    Ellipsoid,
    Polygon,
    Polyhedron,
    Shape,
    Sphere,
)
from contactlearn.mechanics.space import PLANE, SPACE, Space
from contactlearn.models.contact_model import ContactModel, actual_coefficients, actual_state
from contactlearn.models.export import source
from contactlearn.models.roll_out import FAINT

STEPS = 100
"""Steps in one contact time."""

CONTACT_TIME = 2e-4
"""Time in s in which a body rebounds undamped: gravity and rotation then change the outcome by a few thousandths."""

_SOFT = 0.005  # impedance of the constraint; what slip adds to the normal force is in proportion to it
_GRIP = 50  # times that slip would decay by a factor e in one contact time, if friction could
_SHARP = 1e-6  # m, radius of a sharp corner
_NEAR = 1e-3  # m above the floor up to which deviations are drawn
_DRAWS = 256  # for each impact, for a table of ranges
_SET_BY = {
    "friction": "model.pair_friction[:, :2]", "restitution": "solref", "damping": "-model.pair_solref[:, 1]",
    "normal": "model.geom_quat[floor]", "normal_with_point": "model.geom_quat[floor]",
    "contact_point": "model.geom_pos[parts]",
}  # fmt: skip
_GEOMETRY = ("surface_tilt", "com_offset", "inertia_error", "orientation_offset", "shape_error", "corner_radius")

Body = Ellipse | Disc | Ellipsoid | Sphere | Cylinder | Cornered
"""Shapes that a scene can have."""
Vector = tuple[float, ...]
"""(x, y, z) in axes of MuJoCo, z up."""


def solref(eps: float, contact_time: float) -> tuple[float, float]:
    """Return stiffness k in 1/s² and damping c in 1/s of a spring and dashpot that only push.

    The penetration is x = −(v/ω_d) e^{−ζωt} sin ω_d t, and the force k x + c ẋ vanishes at ω_d t = 2β
    for ζ = cos β; from there on it flies freely with ε = exp(−ζω t) = exp(−2β / tan β); β is imaginary for ζ > 1.
    """
    omega = math.pi / contact_time
    return omega**2, 2 * damping(torch.tensor(eps, dtype=torch.float64)).ratio.item() * omega


@dataclass(frozen=True, kw_only=True)
class Scene:
    """One body above a floor.

    Args:
        shape: of the body.
        mass: in kg.
        inertia: about the mass centre in kg m²; in space the principal moments, about the axes of the shape.
        mu: coefficient of friction.
        eps: coefficient of restitution, at least `spring_dashpot.LEAST`.
        contact_time: in s.
        tilt: rotation vector of the floor in rad.
        mass_centre: from the tracked point, along the body's axes in m.
        centre: of the shape, likewise.
        turn: rotation vector of the shape in rad.
        torsion: friction about the normal over P_n in m.
        damping: drag at this rate in 1/s, in the plane.
    """

    shape: Body
    mass: float
    inertia: float | Vector
    mu: float
    eps: float
    contact_time: float = CONTACT_TIME
    tilt: Vector = (0.0, 0.0, 0.0)
    mass_centre: Vector = (0.0, 0.0, 0.0)
    centre: Vector = (0.0, 0.0, 0.0)
    turn: Vector = (0.0, 0.0, 0.0)
    torsion: float = 0.0
    damping: float = 0.0

    @property
    def step(self) -> float:
        """Largest step in s."""
        return self.contact_time / STEPS

    @property
    def space(self) -> Space:
        """The plane, or space."""
        return SPACE if isinstance(self.inertia, tuple) else PLANE

    def geoms(self) -> list[str]:
        """Return what touches the floor: an ellipsoid, a cylinder, or a sphere for each corner."""
        if isinstance(self.shape, Cornered):
            radius = self.shape.corner or _SHARP
            corners = self.shape.corners() + radius * self.shape.arc_centres()
            return [f'type="sphere" size="{radius}" pos="{_text(_embedded(one))}"' for one in corners.tolist()]
        if isinstance(self.shape, Cylinder):
            size, along = f"{self.shape.radius} {self.shape.half_length}", self.shape.along
            middle = _text((-self.shape.centre * along).tolist())
            return [f'type="cylinder" size="{size}" zaxis="{_text(along.tolist())}" pos="{middle}"']
        axes = (self.shape.radius,) * 3 if isinstance(self.shape, Disc | Sphere) else self.shape.semi_axes
        return [f'type="ellipsoid" size="{_text(_embedded(axes, axes[-1]))}"']

    def xml(self) -> str:
        """Return the scene in MuJoCo's own language."""
        k, c = solref(self.eps, self.contact_time)
        moments = self.inertia if isinstance(self.inertia, tuple) else (self.inertia,) * 3
        return source.TEMPLATES.get_template("scene.xml.j2").render(
            **{name: getattr(self, name) for name in ("contact_time", "step", "mass", "mu", "torsion", "space")},
            gravity=-GRAVITY, unstable=self.contact_time / (_SOFT * _GRIP), geoms=self.geoms(),
            moments=_text(moments), mass_centre=_text(self.mass_centre), centre=_text(self.centre),
            floor=_text(_quaternion(self.tilt).tolist()), turn=_text(_quaternion(self.turn).tolist()),
            drag=self.damping * self.mass, spin_drag=self.damping * moments[1],
            soft=_SOFT, spring=(-k, -c), grip=(-1.0, -_SOFT * _GRIP / self.contact_time),
        )  # fmt: skip


def _quaternion(vector: Vector) -> Tensor:
    """Unit quaternion [4] of a rotation vector."""
    none = torch.tensor((1.0, 0.0, 0.0, 0.0), dtype=torch.float64)
    return rigid_body.turn_quaternion(none, torch.tensor(vector, dtype=torch.float64))


def _embedded(vector: Iterable[float], across: float = 0.0) -> Vector:
    """A vector of the plane or of space in space."""
    x, *between, z = vector
    return x, *(between or (across,)), z


def _text(vector: Iterable[float]) -> str:
    return " ".join(map(str, vector))


class Exported(NamedTuple):
    """The scene, and the function that sets its coefficients or None."""

    scene: Scene
    hook: str | None


def export(model: ContactModel, impacts: Impacts, contact_time: float = CONTACT_TIME) -> Exported:
    """Return a model in MuJoCo, for the body of some impacts, without effects of the recording.

    Args:
        model: without processes, of one value for each parameter.
        impacts: of bodies of one shape; the scene has their median mass and moment of inertia.
        contact_time: in s.

    Raises:
        ContactLearnError: an effect has no form in MuJoCo, which is named with the size of what it explains, neither
            has a component of scatter, or ε is too small.
        DataError: the impacts state no shape, or several.
    """
    source.require_exportable(model, impacts.shape)
    if not isinstance(impacts.shape, Body):
        raise DataError(f"a scene needs the one shape of the body, such as data.shape=…; got {impacts.shape}")
    model = model.physical
    for name, effect in model.effects.items():
        own = name in _GEOMETRY or (name == "torsional_friction" and effect.form == "sliding")
        if not own and effect.place != "law":
            rest = {other: one for other, one in model.effects.items() if other != name}
            with_it, without = (one.predict(impacts).v_post for one in (model, replace(model, effects=rest)))
            share = difference(with_it, without, impacts)
            raise ContactLearnError(
                f"{name} has no form in MuJoCo, and without it outcomes change by {share:.1%} (mass norm, mean of "
                f"{len(impacts)} impacts); use --to c or numpy, or fit a model without it"
            )
    for name in model.scatter:
        if name not in _SET_BY:
            raise ContactLearnError(f"scatter of {name} has no form in MuJoCo; use --to c or numpy")
    if model.law.coefficients[1].item() < LEAST:
        raise ContactLearnError(f"MuJoCo's contact has ε of at least {LEAST}, and this law has {model.law.eps:.3f}")
    scene = replace(_scene(model, impacts, impacts.shape), contact_time=contact_time)
    slides = None if impacts.apparatus is None else impacts.apparatus.friction
    depends = any(effect.place == "law" for effect in model.effects.values())
    hooked = depends or slides or model.scatter
    return Exported(scene, _hook(model, scene, impacts.shape, slides, depends) if hooked else None)


def ranges(model: ContactModel, impacts: Impacts, contact_time: float = CONTACT_TIME) -> dict[str, Any]:
    """Return what MuJoCo's contact has in impacts like some given ones, for domain randomisation, as JSON takes it.

    Parameters are drawn from their covariance, the deviations of the contact anew for each impact, and effects give
    each impact its own coefficients.  Of friction, restitution, the damping that makes it, the normal's angles in rad
    and the contact point's places in m it has mean, standard deviation, the range of 90 %, the part of the standard
    deviation that is scatter from impact to impact, and the correlation of all.

    Args:
        model: without processes.
        impacts: of the body.
        contact_time: in s.
    """
    generator, n, space = torch.Generator().manual_seed(0), len(impacts), impacts.space
    values = [x.reshape(1) for x in model.values]
    if model.parameter_covariance is not None:
        root = torch.linalg.cholesky(model.parameter_covariance)
        normal = torch.randn(_DRAWS, len(values), generator=generator, dtype=torch.float64)
        values = [x[:, None] for x in (torch.cat(values) + normal @ root.mT).unbind(-1)]
    drawn = model.at(values)
    state = actual_state(drawn.effects, State.of(impacts))
    mu, eps = (x.expand(_DRAWS, n) for x in actual_coefficients(drawn.effects, state, *drawn.law.coefficients))
    columns: dict[str, Tensor] = {}
    for name, one in model.scatter.items():
        u = one.draw((_DRAWS, n), space, generator)
        state, mu, eps = one.perturb(state, mu, eps, u)
        if name in ("normal", "normal_with_point", "contact_point"):
            names = [name] if space is PLANE else [f"{name}_x", f"{name}_y"]
            columns |= zip(names, u.unbind(-1), strict=True)
    eps = eps.clamp(LEAST, 1)
    omega = math.pi / contact_time
    columns = {"friction": mu, "restitution": eps, "damping": 2 * damping(eps).ratio * omega} | columns
    table = torch.stack([x.reshape(-1) for x in columns.values()])
    low, high = table.quantile(torch.tensor([0.05, 0.95], dtype=torch.float64), dim=1)
    units = {"damping": "1/s", "normal": "rad", "normal_with_point": "rad", "contact_point": "m"}
    quantities = {}
    for k, name in enumerate(columns):
        kind = name.removesuffix("_x").removesuffix("_y")
        quantities[name] = {
            "set": _SET_BY[kind], "unit": units.get(kind, "–"), "mean": table[k].mean().item(),
            "standard_deviation": table[k].std().item(), "low": low[k].item(), "high": high[k].item(),
            "scatter": model.scatter[kind].sigma if kind in model.scatter else None,
        }  # fmt: skip
    size = table.std(1)
    known = torch.where(size > 0, size, 1.0)
    correlation = table.cov() / (known[:, None] * known)
    return {"stiffness": omega**2, "quantities": quantities, "correlation": correlation.tolist()}


def difference(one: Tensor, other: Tensor, impacts: Impacts) -> float:
    """Return the mean of √(eᵀMe)/√(vᵀMv), e between two outcomes [N, D] and v the first."""
    body = impacts.mass, impacts.world_inertia
    square = rigid_body.squared_mass_norm(*body, other - one) / rigid_body.squared_mass_norm(*body, one)
    return square.sqrt().mean().item()


def _scene(model: ContactModel, impacts: Impacts, shape: Body) -> Scene:
    values = {
        f"{name}.{p.name}": value.item()
        for name, effect in model.effects.items()
        for p, value in zip(effect.parameters, effect.values, strict=True)
    }

    def known(effect: str, *names: str) -> list[float]:
        return [values.get(f"{effect}.{name}", 0.0) for name in names]

    axes = "abc"[: impacts.space.d]
    mu, eps = (x.item() for x in model.law.coefficients)
    phi, psi = known("surface_tilt", "phi", "psi")
    delta_a, delta, delta_c = known("orientation_offset", "delta_a", "delta", "delta_c")
    turn = delta_a, -delta, delta_c
    offset = torch.tensor(_embedded(known("com_offset", *(f"delta_{one}" for one in axes))), dtype=torch.float64)
    beside = (0.0,) * 3 if impacts.apparatus is None else impacts.apparatus.beside
    rig = torch.tensor(_embedded(beside[: impacts.space.d]), dtype=torch.float64)
    offset, rig = (rigid_body.matvec(rigid_body.rotation(_quaternion(turn)), one) for one in (offset, rig))
    tracked = "com_offset" in model.effects and model.effects["com_offset"].form == "tracked"
    state, error = State.of(impacts), model.effects.get("inertia_error")
    inertia = (state if error is None else error.state(state)).inertia.median(0).values
    return Scene(
        shape=_changed(shape, known("shape_error", *(f"s_{one}" for one in axes)), *known("corner_radius", "rho_c")),
        mass=impacts.mass.median().item(),
        inertia=inertia.item() if impacts.space is PLANE else tuple(inertia.tolist()),
        mu=mu,
        eps=eps,
        tilt=(psi, -phi, 0.0),
        mass_centre=tuple(offset.tolist()) if tracked else (0.0, 0.0, 0.0),
        centre=tuple((-rig if tracked else -rig - offset).tolist()),
        turn=turn,
        torsion=known("torsional_friction", "c")[0],
    )


def _changed(shape: Body, stretch: list[float], corner: float) -> Body:
    """A shape that is stretched along its axes, and has rounder corners."""
    by = [1 + s for s in stretch]
    if isinstance(shape, Cornered):
        stretched = tuple(map(tuple, (shape.corners() * torch.tensor(by, dtype=torch.float64)).tolist()))
        return (Polygon if len(by) == 2 else Polyhedron)(stretched, corner=shape.corner + corner)
    if isinstance(shape, Cylinder):
        if any(stretch):
            raise ContactLearnError(
                "shape_error makes the ends of a cylinder ellipses, which MuJoCo's cylinder has not; use --to c or "
                "numpy, or fit a model without it"
            )
        return shape
    axes = (shape.radius,) * len(by) if isinstance(shape, Disc | Sphere) else shape.semi_axes
    a, b, c = (*(k * x for k, x in zip(by, axes, strict=True)), 0.0)[:3]
    return Ellipsoid((a, b, c)) if len(by) == 3 else Ellipse((a, b))


def _hook(model: ContactModel, scene: Scene, shape: Shape, slides: Estimate | None, depends: bool) -> str:
    values = {name: getattr(scene, name) for name in ("step", "contact_time", "mass", "inertia", "space", "mu", "eps")}
    values |= {"scatter": {name: one.sigma for name, one in model.scatter.items()}, "near": _NEAR, "least": LEAST}
    if depends:
        traced = source.trace(model, shape, scene.space, coefficients=True)
        values |= {
            "constants": traced.constants, "used": source.leaves(traced.program),
            "extra": [name for name in ("order", "body") if name in traced.arguments],
            "statements": list(source.statements(traced.program, source.LANGUAGES["numpy"].spelled)),
        }  # fmt: skip
    return source.TEMPLATES.get_template("hook.py.j2").render(
        values, version=__version__, equation=str(model).splitlines(), slides=slides, faint=FAINT * GRAVITY
    )
