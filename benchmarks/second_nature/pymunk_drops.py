"""Drops of pymunk (Chipmunk): a body in the plane that starts just above a segment and bounces once.

Chipmunk's contact is Newton's restitution with the product of both elasticities, and friction with the product of
both coefficients, opposing the final slip; it lasts one step.  No gravity.  Effects are options that pymunk documents:

    belt        Shape.surface_velocity of the floor: in no catalogue
    damping     Space.damping, of velocity and spin alike, while the body flies on until it is seen
    corner      radius of a polygon: round corners
    com         Body.center_of_gravity
    slope       of the floor
    grip, bounce    a second floor segment right of x = 0 with other friction, other elasticity
    speed       Arbiter.restitution set before the contact is solved, falling with the speed of approach
"""

from dataclasses import dataclass

import numpy as np
import pymunk

from second_nature.bodies import Body, turned
from second_nature.nature import Drops, Record

STEP, FLIGHT, SCALE = 1e-5, 0.02, 1000.0  # seconds; Chipmunk's tolerances suit millimetres


@dataclass(frozen=True)
class Options:
    """What differs from a plain contact, in SI units; `com` and `corner` in units of the body's a."""

    belt: float = 0.0
    damping: float = 0.0
    corner: float = 0.0
    com: tuple[float, float] = (0.0, 0.0)
    slope: float = 0.0
    grip: float = 0.0
    bounce: float = 0.0
    speed: float = 0.0


def simulate(body: Body, mu: float, eps: float, drops: Drops, options: Options = Options()) -> Record:
    """Drop the body once from each state; `Drops` are states just above the floor."""
    real = Body(body.kind, body.a, body.b, body.mass, body.rho2,
                com=tuple(body.a * np.array(options.com)), corner=body.a * options.corner)  # fmt: skip
    r = real.contact(drops.theta, options.slope)
    v_post, valid = np.zeros((len(r), 3)), np.zeros(len(r), bool)
    normal = np.array([-np.sin(options.slope), np.cos(options.slope)])
    for i in range(len(r)):
        floor = np.array([drops.x[i], np.tan(options.slope) * drops.x[i]])
        v_post[i], valid[i] = _bounce(
            real, mu, eps, options, (floor + 1e-6 * normal - r[i], drops.theta[i], drops.v[i])
        )
    mass = np.full(len(r), body.mass)
    seen = r if options.slope else body.contact(drops.theta)
    q = np.stack((drops.x, -r[:, 1], drops.theta), -1)
    approach = drops.v[:, 1] + seen[:, 0] * drops.v[:, 2]
    valid &= (approach < -0.35) & (body.margin(drops.theta) > 0.12)
    return Record(mass, mass * body.rho2, seen, q, drops.v, v_post, valid)


def _bounce(body, mu, eps, options, state):
    """Velocity after the contact, and whether there was one."""
    place, theta, v = state
    space = pymunk.Space()
    space.iterations, space.collision_slop, space.collision_bias = 100, 1e-5, 1.0
    moving = pymunk.Body(body.mass, body.mass * body.rho2 * SCALE**2)
    moving.center_of_gravity = tuple(np.array(body.com) * SCALE)
    moving.angle = float(theta)
    origin = place - turned(np.array([body.com]), theta)[0]
    moving.position = tuple(origin * SCALE)
    moving.velocity, moving.angular_velocity = tuple(v[:2] * SCALE), float(v[2])
    shape = _shape(moving, body)
    shape.friction, shape.elasticity = 1.0, 1.0
    space.add(moving, shape, *_floor(space, mu, eps, options))
    hits = []

    def solve(arbiter, space, data):
        hits.append(len(arbiter.contact_point_set.points))
        if options.speed and len(hits) == 1:
            seen = arbiter.contact_point_set
            arm = seen.points[0].point_a - moving.local_to_world(moving.center_of_gravity)
            approach = abs((moving.velocity + v[2] * arm.perpendicular()).dot(seen.normal)) / SCALE
            arbiter.restitution = eps * (1 + options.speed) / (1 + options.speed * approach / 1.5)

    space.on_collision(None, None, pre_solve=solve)
    for _ in range(40):
        space.step(STEP)
        if hits:
            break
    space.step(STEP)
    if options.damping:
        space.damping = float(np.exp(-options.damping / FLIGHT))
        for _ in range(20):
            space.step(FLIGHT / 20)
    return (*(np.array(moving.velocity) / SCALE), moving.angular_velocity), set(hits) == {1} and len(hits) <= 2


def _shape(moving, body):
    if body.kind == "disc":
        return pymunk.Circle(moving, body.a * SCALE)
    corner = body.corner * SCALE
    return pymunk.Poly(moving, [tuple(p) for p in body.inset() * SCALE], radius=corner)


def _floor(space, mu, eps, options):
    """One segment, or two that meet at x = 0."""
    t = 1000.0 * np.array([np.cos(options.slope), np.sin(options.slope)])
    ends = ((-t, 0 * t, 1.0), (0 * t, t, -1.0)) if options.grip or options.bounce else ((-t, t, 0.0),)
    floors = []
    for start, end, side in ends:
        floor = pymunk.Segment(space.static_body, tuple(start), tuple(end), 0.0)
        floor.friction, floor.elasticity = mu * (1 + side * options.grip), eps + side * options.bounce
        floor.surface_velocity = (options.belt * SCALE, 0.0)
        floors.append(floor)
    return floors
