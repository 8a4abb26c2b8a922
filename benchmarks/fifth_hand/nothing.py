"""Twelve tables with nothing hidden; the errors of the last four follow one another."""

from fifth_hand.bodies import heavier, weighed
from fifth_hand.instruments import Noise
from fifth_hand.laboratory import Scene
from fifth_hand.throws import DROP, MIXED, PENDULUM, RAMP, ROBOT, SPIN
from fourth_hand.bodies import box, disc, ellipse, regular

NOTHING = [
    Scene(
        [weighed(box(0.37, 0.074, 0.054))],
        110,
        ("wang-mason", 0.24, 0.42),
        MIXED,
        Noise("contaminated", (0.0312, 0.0411, 0.439), before=0.4, angle=0.004, place=0.0005),
    ),
    Scene(
        [weighed(regular(0.2, 5, 0.0494, 0.511884), 1.15)],
        501,
        ("ap-newton", 0.48, 0.76),
        DROP,
        Noise("contaminated", (0.0566, 0.0658, 0.946), before=1.0, angle=0.004, place=0.001, rounded=True),
    ),
    Scene(
        [weighed(regular(0.704, 5, 0.0438, 0.221367))],
        1082,
        ("ap-newton", 0.43, 0.47),
        SPIN,
        Noise("gauss", (0.0497, 0.0498, 0.626), before=1.0, angle=0.006, place=0.0005, by_speed=True, scatter=True),
    ),
    Scene(
        [weighed(ellipse(0.066, 0.0523, 0.0288), 0.9), heavier(weighed(ellipse(0.066, 0.0523, 0.0288), 0.9))],
        160,
        ("ap-poisson", 0.47, 0.51),
        SPIN,
        Noise("student", (0.0388, 0.0439, 0.694), before=0.2, angle=0.002, place=0.0005),
    ),
    Scene(
        [weighed(ellipse(0.233, 0.0514, 0.0345))],
        388,
        ("whittaker", 0.45, 0.65),
        MIXED,
        Noise("laplace", (0.0524, 0.0633, 0.764), before=0.2, angle=0.002, place=0.0005),
    ),
    Scene(
        [weighed(regular(0.159, 3, 0.0598, 0.13794)), heavier(weighed(regular(0.159, 3, 0.0598, 0.13794)))],
        483,
        ("ap-newton", 0.21, 0.66),
        RAMP,
        Noise("laplace", (0.0201, 0.0214, 0.402), before=1.0, angle=0.006, place=0.001, scatter=True),
    ),
    Scene(
        [weighed(disc(0.256, 0.056), 1.4)],
        578,
        ("ap-poisson", 0.47, 0.76),
        RAMP,
        Noise("laplace", (0.0187, 0.0228, 0.289), before=0.2, angle=0.004, place=0.0005),
    ),
    Scene(
        [weighed(ellipse(0.311, 0.0675, 0.0446))],
        644,
        ("mirtich", 0.3, 0.39),
        PENDULUM,
        Noise("student", (0.0346, 0.0315, 0.356), before=1.0, angle=0.002, place=0.0005),
    ),
    Scene(
        [weighed(disc(0.061, 0.0426)), heavier(weighed(disc(0.061, 0.0426)))],
        667,
        ("ap-poisson", 0.28, 0.34),
        ROBOT,
        Noise("gauss", (0.0199, 0.0292, 0.486), before=0.6, angle=0.002, place=0.0005, memory=0.8),
    ),
    Scene(
        [weighed(regular(0.087, 6, 0.0466, 0.565739))],
        182,
        ("ap-poisson", 0.5, 0.46),
        DROP,
        Noise("gauss", (0.0536, 0.0631, 1.37), before=0.4, angle=0.002, place=0.001, memory=0.87),
    ),
    Scene(
        [weighed(regular(0.069, 6, 0.0406, 0.803286), 0.9)],
        788,
        ("mirtich", 0.19, 0.55),
        MIXED,
        Noise(
            "contaminated", (0.0303, 0.0313, 0.736), before=1.0, angle=0.006, place=0.001, by_speed=True, memory=0.92
        ),
    ),
    Scene(
        [weighed(ellipse(0.089, 0.0787, 0.0414), 0.9)],
        218,
        ("ap-poisson", 0.33, 0.5),
        SPIN,
        Noise("gauss", (0.0182, 0.0222, 0.169), before=0.6, angle=0.004, place=0.001, memory=0.95),
    ),
]
