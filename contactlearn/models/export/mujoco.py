"""A law with its effects in MuJoCo: a scene, and where coefficients depend on the state a function that sets them.

**The contact.** MuJoCo gives its penetration r < 0 the acceleration −k r − c ṙ, as long as that pushes: a
spring and dashpot, scaled to the effective mass.  With ζ = c / (2 √k) = cos β the restitution is
ε = exp(−2β / tan β) > e⁻², the same for all poses and speeds but for the coupling with friction.  A soft
constraint (impedance 0.005) with a stiff friction (impratio 10⁵) is Coulomb's cone; MuJoCo's default impedance, 0.9 and
above, would add to the normal force where there is slip.  So the law is `spring_dashpot`, whichever was fitted.

Source: Todorov, Erez and Tassa (2012), IROS; the engine's own manual, "Computation", for solref.
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import torch

from contactlearn.core import __version__
from contactlearn.core.errors import ContactLearnError, DataError
from contactlearn.laws.spring_dashpot import SpringDashpot
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.mechanics.rigid_body import GRAVITY
from contactlearn.mechanics.shapes import Disc, Ellipse, Polygon, Shape
from contactlearn.models.contact_model import ContactModel
from contactlearn.models.export import source

STEPS = 100
"""Steps in one contact time."""

CONTACT_TIME = 2e-4
"""Time in s in which a body rebounds undamped: gravity and rotation then change the outcome by a few thousandths."""

_SOFT = 0.005  # impedance of the constraint; what slip adds to the normal force is in proportion to it
_GRIP = 50  # times that slip would decay by a factor e in one contact time, if friction could
_GEOMETRY = ("surface_tilt", "com_offset", "inertia_error", "orientation_offset", "shape_error")


def solref(eps: float, contact_time: float) -> tuple[float, float]:
    """Return stiffness k in 1/s² and damping c in 1/s of a spring and dashpot that only push.

    The penetration is x = −(v/ω_d) e^{−ζωt} sin ω_d t, and the force k x + c ẋ vanishes at ω_d t = 2β
    for ζ = cos β; from there on the body flies freely with ε = exp(−ζω t) = exp(−2β / tan β).
    """
    beta, low, high = 0.0, 0.0, math.pi / 2  # ε grows with β from e⁻² to 1
    for _ in range(60):
        beta = (low + high) / 2
        low, high = (beta, high) if math.exp(-2 * beta / math.tan(beta)) < eps else (low, beta)
    omega = math.pi / contact_time
    return omega**2, 2 * math.cos(beta) * omega


@dataclass(frozen=True, kw_only=True)
class Scene:
    """One body above a floor in the plane, held by two slides and a hinge at the tracked point.

    Args:
        shape: ellipse, disc or polygon.
        mass: in kg.
        inertia: about the mass centre in kg m².
        mu: coefficient of friction.
        eps: coefficient of restitution, more than e⁻².
        contact_time: in s.
        tilt: of the floor, counter-clockwise in rad.
        mass_centre: from the tracked point, along the body's axes in m.
        centre: of the shape, likewise.
        turn: of the shape against the zero of θ in rad.
        damping: drag at this rate in 1/s.
    """

    shape: Shape
    mass: float
    inertia: float
    mu: float
    eps: float
    contact_time: float = CONTACT_TIME
    tilt: float = 0.0
    mass_centre: tuple[float, float] = (0.0, 0.0)
    centre: tuple[float, float] = (0.0, 0.0)
    turn: float = 0.0
    damping: float = 0.0

    @property
    def step(self) -> float:
        """Largest step in s."""
        return self.contact_time / STEPS

    def xml(self) -> str:
        """Return the scene in MuJoCo's own language."""
        geom, vertices, outline = "", "", self.shape.outline()
        a, b = outline.amax(0).tolist()
        if isinstance(self.shape, Polygon):  # a double pyramid: a corner touches at one point, not two
            corners = " ".join(f"{x} 0 {z}" for x, z in self.shape.vertices)
            geom, vertices = 'type="mesh" mesh="outline"', f"{corners} 0 {b} 0 0 {-b} 0"
        else:
            geom = f'type="ellipsoid" size="{a} {b} {b}"'
        k, c = solref(self.eps, self.contact_time)
        return source.TEMPLATES.get_template("scene.xml.j2").render(
            **{name: getattr(self, name) for name in ("contact_time", "step", "mass", "inertia", "mu", "mass_centre")},
            gravity=-GRAVITY, unstable=self.contact_time / (_SOFT * _GRIP), vertices=vertices, geom=geom,
            centre=self.centre, floor_quat=_about_y(self.tilt), body_quat=_about_y(self.turn),
            drag=self.damping * self.mass, spin_drag=self.damping * self.inertia,
            soft=_SOFT, spring=(-k, -c), grip=(-1.0, -_SOFT * _GRIP / self.contact_time),
        )  # fmt: skip


class Exported(NamedTuple):
    """The scene, the function that sets its coefficients or None, and the share of the outcome that is lost."""

    scene: Scene
    hook: str | None
    lost: float


def export(model: ContactModel, impacts: Impacts) -> Exported:
    """Return a model in MuJoCo, for the body of some impacts.

    Args:
        model: without processes, of one value for each parameter.
        impacts: of bodies of one shape; the scene has their median mass and moment of inertia.

    Raises:
        ContactLearnError: an effect has no form in MuJoCo, which is named with the size of what it explains, or ε is
            too small.
        DataError: the impacts state no shape, or several.
    """
    source.require_exportable(model, impacts.shape)
    if not isinstance(impacts.shape, Ellipse | Disc | Polygon):
        raise DataError(f"a scene needs the one shape of the body, such as data.shape=…; got {impacts.shape}")
    for name, effect in model.effects.items():
        if name not in _GEOMETRY and effect.place != "law":
            rest = {other: one for other, one in model.effects.items() if other != name}
            share = difference(model.predict(impacts), replace(model, effects=rest).predict(impacts), impacts)
            raise ContactLearnError(
                f"{name} has no form in MuJoCo, and without it outcomes change by {share:.1%} (mass norm, mean of "
                f"{len(impacts)} impacts); use --to c or numpy, or fit a model without it"
            )
    if model.law.coefficients[1].item() <= math.exp(-2):
        raise ContactLearnError(f"MuJoCo's contact has ε above 0.135, and this law has {model.law.eps:.3f}")
    soft = replace(model, base=SpringDashpot(*model.law.coefficients))
    scene = _scene(model, impacts, impacts.shape)
    depends = any(effect.place == "law" for effect in model.effects.values())
    hook = _hook(model, scene, impacts.shape) if depends else None
    return Exported(scene, hook, difference(model.predict(impacts), soft.predict(impacts), impacts))


def difference(one: Prediction, other: Prediction, impacts: Impacts) -> float:
    """Return the mean of √(eᵀMe)/√(vᵀMv), e between two outcomes and v the first."""
    M = torch.stack((impacts.mass, impacts.mass, impacts.inertia), -1)
    e, v = (((x.square() * M).sum(-1)).sqrt() for x in (other.v_post - one.v_post, one.v_post))
    return (e / v).mean().item()


def _scene(model: ContactModel, impacts: Impacts, shape: Ellipse | Disc | Polygon) -> Scene:
    mu, eps = (x.item() for x in model.law.coefficients)
    values = {
        f"{name}.{p.name}": value.item()
        for name, effect in model.effects.items()
        for p, value in zip(effect.parameters, effect.values, strict=True)
    }
    known = values.get
    offset = known("com_offset.delta_a", 0.0), known("com_offset.delta_b", 0.0)
    tracked = "com_offset" in model.effects and model.effects["com_offset"].form == "tracked"
    stretch = 1 + known("shape_error.s_a", 0.0), 1 + known("shape_error.s_b", 0.0)
    return Scene(
        shape=_stretched(shape, *stretch),
        mass=impacts.mass.median().item(),
        inertia=impacts.inertia.median().item() * math.exp(known("inertia_error.kappa", 0.0)),
        mu=mu,
        eps=eps,
        tilt=known("surface_tilt.phi", 0.0),
        mass_centre=offset if tracked else (0.0, 0.0),
        centre=(0.0, 0.0) if tracked else (-offset[0], -offset[1]),
        turn=known("orientation_offset.delta", 0.0),
    )


def _stretched(shape: Ellipse | Disc | Polygon, s_a: float, s_b: float) -> Ellipse | Polygon:
    if isinstance(shape, Polygon):
        return Polygon(tuple((s_a * x, s_b * y) for x, y in shape.vertices))
    a, b = shape.semi_axes if isinstance(shape, Ellipse) else (shape.radius, shape.radius)
    return Ellipse((s_a * a, s_b * b))


def _hook(model: ContactModel, scene: Scene, shape: Shape) -> str:
    traced = source.trace(model, shape, coefficients=True)
    return source.TEMPLATES.get_template("hook.py.j2").render(
        version=__version__, equation=str(model).splitlines(), constants=traced.constants,
        used=source.leaves(traced.program), extra=[name for name in ("order", "body") if name in traced.arguments],
        statements=list(source.statements(traced.program, source.LANGUAGES["numpy"].spelled)),
        **{name: getattr(scene, name) for name in ("step", "contact_time", "mass", "inertia")},
    )  # fmt: skip


def _about_y(angle: float) -> str:
    return f"{math.cos(angle / 2)} 0 {-math.sin(angle / 2)} 0"
