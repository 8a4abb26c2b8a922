"""Twenty-two tables with one effect that has a name, and with two or three."""

from dataclasses import replace

from fifth_hand import known
from fifth_hand.bodies import weighed
from fifth_hand.instruments import Noise
from fifth_hand.laboratory import Scene
from fifth_hand.throws import DROP, MIXED, PENDULUM, ROBOT, SPIN
from fourth_hand.bodies import box, disc, ellipse, regular

ONE = [
    Scene(
        [weighed(ellipse(0.31, 0.06, 0.042))],
        320,
        ("mirtich", 0.3, 0.62),
        ROBOT,
        Noise("laplace", (0.0307, 0.0312, 0.498), before=0.6, angle=0.002, place=0.0005, rounded=True, by_speed=True),
        [known.surface_tilt(0.0162)],
    ),
    Scene(
        [weighed(disc(0.12, 0.032))],
        180,
        ("wang-mason", 0.22, 0.7),
        DROP,
        Noise("gauss", (0.0333, 0.0481, 1.21), before=0.2, angle=0.002, place=0.001),
        [known.varies("eps", "velocity_dependent_restitution", known.yields, 0.775)],
    ),
    Scene(
        [weighed(regular(0.26, 6, 0.045, 0.2))],
        500,
        ("wang-mason", 0.3, 0.5),
        ROBOT,
        Noise("gauss", (0.0417, 0.0348, 0.848), before=0.4, angle=0.006, place=0.0005),
        [known.times_friction("directional_friction", known.nap, 0.0661)],
    ),
    Scene(
        [weighed(ellipse(0.18, 0.075, 0.03))],
        260,
        ("ap-poisson", 0.25, 0.72),
        SPIN,
        Noise("gauss", (0.021, 0.0274, 0.152), before=1.0, angle=0.004, place=0.001),
        [known.varies("eps", "configuration_dependent_restitution", known.falls_and_settles_with_lever, 0.141)],
    ),
    Scene(
        [weighed(disc(0.2, 0.04), 1.1)],
        420,
        ("mirtich", 0.26, 0.66),
        ROBOT,
        Noise("gauss", (0.0574, 0.0642, 1.58), before=1.0, angle=0.002, place=0.001, rounded=True),
        [known.varies("eps", "orientation_dependent_restitution", known.soft_sector, 0.239)],
    ),
    Scene(
        [weighed(box(0.3, 0.09, 0.06))],
        900,
        ("wang-mason", 0.28, 0.45),
        replace(MIXED, x=(-0.15, 0.15)),
        Noise("laplace", (0.05, 0.06, 1.1), before=0.6, angle=0.004, place=0.0005),
        [known.varies("mu", "location_dependent_friction", known.varnished, 0.0159)],
    ),
    Scene(
        [weighed(disc(0.058, 0.0305), 1.2)],
        140,
        ("wang-mason", 0.5, 0.78),
        ROBOT,
        Noise("laplace", (0.0492, 0.0722, 1.52), before=1.0, angle=0.002, place=0.0005),
        [known.fading_tangential_restitution(0.39)],
    ),
    Scene(
        [weighed(ellipse(0.4, 0.05, 0.032))],
        650,
        ("mirtich", 0.35, 0.5),
        MIXED,
        Noise("laplace", (0.0422, 0.0429, 0.867), before=0.4, angle=0.006, place=0.001, by_speed=True),
        [known.saturating_contact_patch(0.00061)],
    ),
    Scene(
        [weighed(ellipse(0.25, 0.065, 0.04))],
        380,
        ("wang-mason", 0.3, 0.6),
        SPIN,
        Noise("contaminated", (0.021, 0.0281, 0.195), before=0.6, angle=0.006, place=0.001, by_speed=True),
        [known.sampling_delay(0.000474)],
    ),
    Scene(
        [weighed(disc(0.03, 0.025)), weighed(disc(0.075, 0.025))],
        240,
        ("ap-newton", 0.3, 0.8),
        DROP,
        Noise("student", (0.0183, 0.0244, 0.739), before=0.2, angle=0.002, place=0.001, rounded=True),
        [known.pull_off_work(0.00439)],
    ),
    Scene(
        [weighed(disc(0.5, 0.05), 1.3)],
        75,
        ("mirtich", 0.18, 0.55),
        SPIN,
        Noise("student", (0.0187, 0.015, 0.302), before=0.4, angle=0.002, place=0.001),
        [known.rolling_resistance(0.000493, 2.0)],
    ),
    Scene(
        [weighed(regular(0.35, 5, 0.05, 0.3))],
        450,
        ("ap-poisson", 0.33, 0.58),
        ROBOT,
        Noise("contaminated", (0.027, 0.0381, 0.279), before=0.6, angle=0.004, place=0.0005),
        [known.varies("eps", "parameter_drift", known.runs_in, 0.0815)],
    ),
]

SEVERAL = [
    Scene(
        [weighed(ellipse(0.24, 0.06, 0.045))],
        600,
        ("mirtich", 0.28, 0.68),
        MIXED,
        Noise("student", (0.0343, 0.0264, 0.598), before=0.4, angle=0.004, place=0.001, rounded=True, by_speed=True),
        [
            known.com_offset(0.000969),
            known.varies("eps", "velocity_dependent_restitution", known.falls_with_speed, 0.0193),
        ],
    ),
    Scene(
        [weighed(disc(0.09, 0.045))],
        240,
        ("whittaker", 0.3, 0.7),
        replace(ROBOT, x=(-0.2, 0.2)),
        Noise("laplace", (0.0373, 0.0457, 0.85), before=0.2, angle=0.006, place=0.0005, rounded=True),
        [known.side_drag(0.0734), known.varies("eps", "location_dependent_restitution", known.soft_middle, 0.129)],
    ),
    Scene(
        [weighed(box(0.42, 0.1, 0.05))],
        800,
        ("wang-mason", 0.32, 0.5),
        ROBOT,
        Noise("contaminated", (0.0407, 0.0542, 0.365), before=1.0, angle=0.004, place=0.001, rounded=True),
        [known.inertia_error(0.129), known.times_friction("directional_friction", known.brushed, 0.0451)],
    ),
    Scene(
        [weighed(ellipse(0.16, 0.05, 0.03))],
        1100,
        ("ap-poisson", 0.24, 0.6),
        DROP,
        Noise("laplace", (0.0199, 0.0236, 0.264), before=0.2, angle=0.002, place=0.001),
        [
            known.gravity_impulse(0.0053),
            known.varies("mu", "parameter_drift", known.polishes, 0.00931),
            known.varies("eps", "orientation_dependent_restitution", known.two_halves, 0.0159),
        ],
    ),
    Scene(
        [weighed(ellipse(0.5, 0.07, 0.045))],
        700,
        ("mirtich", 0.25, 0.55),
        PENDULUM,
        Noise("gauss", (0.0192, 0.0278, 0.158), before=0.6, angle=0.006, place=0.0005),
        [known.shape_error(0.00945), known.varies("mu", "velocity_dependent_friction", known.stribeck, 0.071)],
    ),
    Scene(
        [weighed(ellipse(0.2, 0.058, 0.03))],
        900,
        ("wang-mason", 0.3, 0.6),
        MIXED,
        Noise("gauss", (0.0217, 0.0308, 0.428), before=0.2, angle=0.004, place=0.0005),
        [
            known.orientation_offset(0.00854),
            known.varies("eps", "slip_dependent_restitution", known.rises_with_slip, 0.0316),
        ],
    ),
    Scene(
        [weighed(ellipse(0.33, 0.055, 0.035))],
        1300,
        ("mirtich", 0.35, 0.52),
        ROBOT,
        Noise("gauss", (0.0399, 0.0553, 0.677), before=0.4, angle=0.002, place=0.001, by_speed=True),
        [
            known.surface_tilt(0.0167),
            known.contact_patch(0.0314),
            known.times_friction("load_dependent_friction", known.hertzian, 0.318),
        ],
    ),
    Scene(
        [weighed(box(0.3, 0.12, 0.044))],
        1000,
        ("wang-mason", 0.3, 0.6),
        replace(MIXED, x=(-0.15, 0.15)),
        Noise("student", (0.0204, 0.0184, 0.221), before=0.4, angle=0.002, place=0.0005),
        [
            known.spin_damping(0.0241),
            known.varies("mu", "location_dependent_friction", known.dusty, 0.00663),
            known.varies("eps", "configuration_dependent_restitution", known.falls_with_lever, 0.0475),
        ],
    ),
    Scene(
        [weighed(disc(0.1, 0.036)), weighed(disc(0.24, 0.052))],
        340,
        ("wang-mason", 0.45, 0.72),
        PENDULUM,
        Noise("gauss", (0.0201, 0.0251, 0.281), before=0.4, angle=0.002, place=0.001),
        [known.rolling_resistance(0.000132, 1.0), known.tangential_restitution(0.0248)],
    ),
    Scene(
        [weighed(ellipse(0.07, 0.06, 0.035))],
        1200,
        ("ap-poisson", 0.27, 0.75),
        SPIN,
        Noise("laplace", (0.0505, 0.0538, 0.666), before=0.2, angle=0.002, place=0.0005),
        [
            known.sampling_delay(0.001),
            known.pull_off_impulse(0.00619),
            known.varies("eps", "parameter_drift", known.hardens, 0.053),
        ],
    ),
]
