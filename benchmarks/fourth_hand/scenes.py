"""The thirty tables in the author's order: unknown effects, known and unknown ones, nothing, and known ones."""

from fourth_hand import bodies, known, sequence, state
from fourth_hand.laboratory import Hidden, Noise, Scene, Throw


def _scene(body, n, law, throw, noise, known=None, unknown=None):
    name, mu, eps = law
    body = body if isinstance(body, list) else [body]
    return Scene(bodies=body, n=n, law=name, mu=mu, eps=eps, throw=throw, noise=noise, known=known, unknown=unknown)


_UNKNOWN = [
    # --- Along the sequence
    _scene(
        bodies.ellipse(0.24, 0.052, 0.034),
        520,
        ("wang-mason", 0.28, 0.52),
        Throw(heights=(0.05, 0.12, 0.22, 0.34, 0.5), vx=(-0.8, 0.8), omega=(-7, 7)),
        Noise(0.005, 0.05),
        unknown=Hidden("floor warmed by impacts", sequence.heat, 1.1, 0.01),
    ),
    _scene(
        bodies.box(0.18, 0.09, 0.03),
        440,
        ("mirtich", 0.34, 0.45),
        Throw(vx=(-1.5, 1.5), omega=(-6, 6), vy=(-2, -1)),
        Noise(0.006, 0.06, degrees=5),
        unknown=Hidden("pile laid by the last slip", sequence.pile, 1.5, 0.01),
    ),
    _scene(
        [bodies.ellipse(0.33, 0.061, 0.047), bodies.ellipse(0.15, 0.055, 0.025)],
        780,
        ("ap-poisson", 0.22, 0.58),
        Throw(sideways=(-1.1, -0.4, 0.5, 1.2), vy=(-2.3, -0.8)),
        Noise(0.004, 0.05, before=0.3),
        unknown=Hidden("floor wiped every 26 trials", sequence.wiped, 0.7, 0.01),
    ),
    _scene(
        bodies.regular(0.41, 6, 0.045, 0.2),
        360,
        ("wang-mason", 0.4, 0.37),
        Throw(vy=(-2.4, -1), vx=(-0.7, 0.7), omega=(-9, 9)),
        Noise(0.006, 0.05),
        unknown=Hidden("two grippers in turn", sequence.gripper, 0.9, 0.01),
    ),
    _scene(
        bodies.ellipse(0.11, 0.04, 0.03),
        640,
        ("mirtich", 0.18, 0.63),
        Throw(vy=(-1.9, -0.7), vx=(-1, 1), spread=6),
        Noise(0.005, 0.06, degrees=6),
        unknown=Hidden("suction of a pump that cycles", sequence.suction, 0.55, 0.01),
    ),
    _scene(
        bodies.triangle(0.27),
        850,
        ("wang-mason", 0.31, 0.5),
        Throw(x=(-0.07, 0.07), vy=(-2.1, -0.9), vx=(-0.6, 0.6)),
        Noise(0.005, 0.05),
        unknown=Hidden("foam dented by hits nearby", sequence.foam, 1.2, 0.01),
    ),
    # --- Of the state
    _scene(
        bodies.box(0.21, 0.1, 0.022),
        480,
        ("ap-poisson", 0.26, 0.48),
        Throw(vy=(-2.2, -0.8), x=(-0.12, 0.12), vx=(-0.8, 0.8)),
        Noise(0.005, 0.07, before=0.25),
        unknown=Hidden("magnet above a strip of poles", state.magnet, 0.8, 0.01),
    ),
    _scene(
        bodies.ellipse(0.16, 0.058, 0.036),
        300,
        ("mirtich", 0.3, 0.42),
        Throw(vx=(-1.6, 1.6), vy=(-2, -1), omega=(-5, 5)),
        Noise(0.006, 0.06),
        unknown=Hidden("scaled skin that turns along", state.ratchet, 1.8, 0.01),
    ),
    _scene(
        [bodies.ellipse(0.19, 0.05, 0.036), bodies.ellipse(0.37, 0.064, 0.046)],
        560,
        ("wang-mason", 0.24, 0.55),
        Throw(vy=(-2.6, -0.8), vx=(-0.9, 0.9), omega=(-6, 6)),
        Noise(0.006, 0.05, degrees=5),
        unknown=Hidden("yield by energy and curvature", state.curved_yield, 1.0, 0.01),
    ),
    _scene(
        [bodies.disc(0.045, 0.032), bodies.disc(0.06, 0.04, 1.7)],
        260,
        ("ap-newton", 0.07, 0.7),
        Throw(vy=(-2.4, -1), vx=(-1.3, 1.3), omega=(-130, 130)),
        Noise(0.004, 0.08),
        unknown=Hidden("Magnus force after impact", state.magnus, 1.3, 1e-4),
    ),
    _scene(
        bodies.box(0.2, 0.11, 0.028),
        700,
        ("mirtich", 0.29, 0.46),
        Throw(vy=(-2.6, -1.2), vx=(-0.7, 0.7), omega=(-16, 16)),
        Noise(0.006, 0.07),
        unknown=Hidden("loose ball in a bore", state.loose_ball, 0.6, 0.001),
    ),
    _scene(
        bodies.ellipse(0.3, 0.045, 0.041),
        410,
        ("ap-poisson", 0.2, 0.6),
        Throw(vy=(-2.7, -1.1), vx=(-0.8, 0.8)),
        Noise(0.004, 0.05),
        unknown=Hidden("floor rings by the time of fall", state.ringing_floor, 0.5, 0.005),
    ),
]

_BOTH = [
    _scene(
        bodies.ellipse(0.14, 0.048, 0.029),
        600,
        ("wang-mason", 0.27, 0.5),
        Throw(vx=(-1.4, 1.4)),
        Noise(0.006, 0.06),
        Hidden("friction drifts", known.friction_drifts, 0.8, 0.05),
        Hidden("charge of earlier slips", sequence.charge, 1.0, 0.01),
    ),
    _scene(
        [bodies.box(0.12, 0.06, 0.04), bodies.box(0.2, 0.09, 0.035)],
        500,
        ("mirtich", 0.33, 0.5),
        Throw(vy=(-2.3, -0.7), omega=(-6, 6), vx=(-0.6, 0.6)),
        Noise(0.005, 0.05),
        Hidden("restitution falls with speed", known.restitution_falls_with_speed, 1.0, 0.05),
        Hidden("squeeze film of air", state.gas, 0.8, 0.01),
    ),
    _scene(
        bodies.ellipse(0.26, 0.05, 0.044),
        450,
        ("ap-poisson", 0.11, 0.5),
        Throw(sideways=(-1.5, -1.1, -0.8, 0.8, 1.1, 1.5), vy=(-2.8, -0.5), omega=(-5, 5)),
        Noise(0.006, 0.06, degrees=6),
        Hidden("tangential restitution", known.tangential_restitution, 0.9, 0.05),
        Hidden("friction falls by a step with slip and load", state.flash, 1.2, 0.01),
    ),
    _scene(
        bodies.regular(0.22, 5, 0.043, 0.1),
        720,
        ("wang-mason", 0.35, 0.44),
        Throw(vx=(-0.8, 0.8)),
        Noise(0.005, 0.05),
        Hidden("contact is a patch", known.patch, 0.7, 0.05),
        Hidden("restitution by day and night", sequence.day, 0.6, 0.01),
    ),
    _scene(
        bodies.ellipse(0.17, 0.075, 0.028),
        330,
        ("mirtich", 0.23, 0.54),
        Throw(x=(-0.12, 0.1), vy=(-2.2, -1), vx=(-0.9, 0.9)),
        Noise(0.006, 0.06, before=0.2),
        Hidden("mass centre off the tracked centre", known.mass_centre, 0.9, 0.001),
        Hidden("curtain brushed before", state.curtain, 0.9, 0.01),
    ),
    _scene(
        bodies.box(0.25, 0.07, 0.05),
        650,
        ("ap-newton", 0.24, 0.5),
        Throw(vx=(-1.5, 1.5), vy=(-2.4, -0.7), x=(-0.18, 0.18)),
        Noise(0.006, 0.05),
        Hidden("friction by place", known.friction_by_place, 0.8, 0.05),
        Hidden("oil film squeezed by impacts", sequence.film, 1.4, 0.01),
    ),
]

_NOTHING = [
    _scene(bodies.ellipse(0.2, 0.05, 0.035), 150, ("wang-mason", 0.25, 0.55), Throw(), Noise(0.004, 0.05)),
    _scene(
        bodies.box(0.16, 0.08, 0.04),
        420,
        ("mirtich", 0.3, 0.4),
        Throw(vx=(-1.2, 1.2)),
        Noise(0.006, 0.06, degrees=3),
    ),
    _scene(
        [bodies.ellipse(0.09, 0.042, 0.03), bodies.ellipse(0.28, 0.06, 0.03)],
        600,
        ("ap-poisson", 0.2, 0.6),
        Throw(heights=(0.08, 0.18, 0.3)),
        Noise(0.005, 0.05, before=0.5),
    ),
    _scene(
        bodies.triangle(0.3),
        880,
        ("ap-newton", 0.38, 0.35),
        Throw(vy=(-2, -0.8), sideways=(-0.8, 0, 0.8)),
        Noise(0.005, 0.07, degrees=6),
    ),
    _scene(
        bodies.disc(0.12, 0.04),
        240,
        ("wang-mason", 0.14, 0.65),
        Throw(omega=(-30, 30), vx=(-1.5, 1.5)),
        Noise(0.004, 0.06),
    ),
    _scene(
        bodies.regular(0.35, 8, 0.05, 0.0),
        540,
        ("mirtich", 0.45, 0.5),
        Throw(omega=(-10, 10)),
        Noise(0.007, 0.08, before=0.3),
    ),
]

_KNOWN = [
    _scene(
        bodies.box(0.19, 0.085, 0.03),
        380,
        ("wang-mason", 0.3, 0.48),
        Throw(),
        Noise(0.006, 0.05),
        Hidden("restitution by lever", known.restitution_by_lever, 1.0, 0.05),
    ),
    _scene(
        bodies.ellipse(0.23, 0.05, 0.038),
        500,
        ("mirtich", 0.16, 0.52),
        Throw(vx=(-2.2, 2.2), vy=(-2, -0.8)),
        Noise(0.005, 0.06, degrees=6),
        Hidden("friction falls with slip", known.friction_falls_with_slip, 1.3, 0.05),
    ),
    _scene(
        bodies.ellipse(0.13, 0.045, 0.032),
        640,
        ("ap-poisson", 0.22, 0.6),
        Throw(vy=(-2.3, -0.9)),
        Noise(0.005, 0.05),
        Hidden("restitution settles", known.restitution_settles, 0.5, 0.05),
    ),
    _scene(
        bodies.regular(0.32, 6, 0.05, 0.4),
        280,
        ("wang-mason", 0.36, 0.42),
        Throw(omega=(-8, 8)),
        Noise(0.006, 0.06),
        Hidden("rolling resistance", known.rolling_resistance, 0.8, 0.0005),
    ),
    _scene(
        bodies.ellipse(0.29, 0.06, 0.042),
        450,
        ("ap-newton", 0.26, 0.5),
        Throw(),
        Noise(0.005, 0.05, before=0.3),
        Hidden("restitution by side of the body", known.restitution_by_side, 0.7, 0.05),
    ),
    _scene(
        bodies.ellipse(0.22, 0.06, 0.038),
        330,
        ("mirtich", 0.31, 0.45),
        Throw(vx=(-1, 1)),
        Noise(0.006, 0.06),
        Hidden("floor tilted", known.tilted_floor, 1.5, 0.005),
    ),
]

SCENES = [*_UNKNOWN, *_BOTH, *_NOTHING, *_KNOWN]
