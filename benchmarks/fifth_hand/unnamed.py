"""Twenty-two tables with unknown physics: of the state of each impact, and along the sequence of the trials."""

from dataclasses import replace

from fifth_hand import known, sequence, state
from fifth_hand.bodies import weighed
from fifth_hand.instruments import Noise
from fifth_hand.laboratory import Hidden, Scene
from fifth_hand.throws import DROP, MIXED, ROBOT, SPIN
from fourth_hand.bodies import box, disc, ellipse, regular

STATE = [
    Scene(
        [weighed(ellipse(0.15, 0.05, 0.032))],
        700,
        ("mirtich", 0.2, 0.8),
        ROBOT,
        Noise("gauss", (0.0372, 0.035, 0.473), before=1.0, angle=0.002, place=0.001, by_speed=True),
        [Hidden("wet film on a half", "law", state.wet_half_film, 0.284)],
    ),
    Scene(
        [weighed(regular(0.3, 5, 0.05, 0.4))],
        500,
        ("wang-mason", 0.28, 0.5),
        MIXED,
        Noise("contaminated", (0.0526, 0.053, 0.541), before=1.0, angle=0.004, place=0.0005),
        [known.times_friction("corner digs in where it is pushed", state.corner_digs_in, 0.216)],
    ),
    Scene(
        [weighed(disc(0.22, 0.045), 1.1)],
        420,
        ("mirtich", 0.25, 0.72),
        ROBOT,
        Noise("gauss", (0.0437, 0.0545, 1.16), before=0.2, angle=0.002, place=0.001),
        [known.varies("eps", "loose mass inside", state.loose_internal_mass, 0.237)],
    ),
    Scene(
        [weighed(disc(0.11, 0.03))],
        800,
        ("ap-newton", 0.22, 0.75),
        replace(DROP, x=(-0.14, 0.14)),
        Noise("gauss", (0.0241, 0.0318, 0.633), before=0.6, angle=0.002, place=0.0005),
        [known.varies("eps", "resonance of a beam", state.beam_resonance, 0.186)],
    ),
    Scene(
        [weighed(disc(0.4, 0.05), 0.9)],
        360,
        ("mirtich", 0.3, 0.68),
        SPIN,
        Noise("student", (0.0271, 0.0313, 0.587), before=0.6, angle=0.002, place=0.001),
        [known.varies("eps", "half-filled tank with a baffle", state.half_filled_tank, 0.0887)],
    ),
    Scene(
        [weighed(ellipse(0.02, 0.035, 0.024))],
        520,
        ("ap-poisson", 0.25, 0.85),
        DROP,
        Noise("gauss", (0.0222, 0.0177, 0.332), before=0.6, angle=0.002, place=0.001, rounded=True),
        [Hidden("charged side", "wrench", state.charged_side, 0.00287)],
    ),
    Scene(
        [weighed(disc(0.14, 0.03))],
        600,
        ("wang-mason", 0.15, 0.65),
        ROBOT,
        Noise("laplace", (0.0549, 0.0596, 1.19), before=0.4, angle=0.006, place=0.001),
        [Hidden("eddy-current brake", "flight", state.eddy_current_brake, 0.29)],
    ),
    Scene(
        [weighed(box(0.16, 0.1, 0.06))],
        900,
        ("mirtich", 0.3, 0.55),
        replace(ROBOT, faces=0.28),
        Noise("contaminated", (0.0257, 0.0315, 0.347), before=0.4, angle=0.002, place=0.0005, rounded=True),
        [Hidden("air cushion of a closing face", "approach", state.air_cushion, 0.111)],
    ),
    Scene(
        [weighed(box(0.25, 0.09, 0.06))],
        600,
        ("wang-mason", 0.3, 0.45),
        replace(DROP, faces=0.35),
        Noise("contaminated", (0.0527, 0.0584, 0.495), before=1.0, angle=0.006, place=0.0005, by_speed=True),
        [Hidden("second corner within a frame", "rebound", state.second_corner, 0.00177)],
    ),
    Scene(
        [weighed(disc(0.09, 0.028))],
        1500,
        ("wang-mason", 0.25, 0.6),
        ROBOT,
        Noise("laplace", (0.0539, 0.0808, 1.23), before=0.2, angle=0.006, place=0.0005),
        [known.times_friction("ratchet floor", state.ratchet_floor, 0.396)],
    ),
    Scene(
        [weighed(regular(0.2, 6, 0.04, 0.1))],
        1000,
        ("ap-poisson", 0.25, 0.5),
        replace(MIXED, x=(-0.16, 0.16)),
        Noise("laplace", (0.0397, 0.046, 1.18), before=0.2, angle=0.004, place=0.0005, by_speed=True),
        [known.varies("mu", "joints with a lip", state.joint_with_lip, 0.0905)],
    ),
    Scene(
        [weighed(disc(0.3, 0.033), 1.3)],
        450,
        ("mirtich", 0.1, 0.6),
        ROBOT,
        Noise("gauss", (0.036, 0.0289, 0.836), before=0.2, angle=0.004, place=0.0005),
        [known.times_friction("flash melting", state.flash_melting, 0.399)],
    ),
    Scene(
        [weighed(disc(0.35, 0.04))],
        300,
        ("wang-mason", 0.3, 0.7),
        ROBOT,
        Noise("student", (0.0218, 0.0192, 0.452), before=0.4, angle=0.004, place=0.001),
        [Hidden("slope of a trampoline", "state", state.trampoline_slope, 0.0721)],
    ),
    Scene(
        [weighed(ellipse(0.28, 0.06, 0.04))],
        260,
        ("mirtich", 0.3, 0.6),
        MIXED,
        Noise("contaminated", (0.0308, 0.0253, 0.259), before=0.4, angle=0.006, place=0.001),
        [Hidden("rotor on a one-way clutch", "wrench", state.one_way_clutch, 0.134)],
    ),
    Scene(
        [weighed(ellipse(0.12, 0.07, 0.03)), weighed(ellipse(0.36, 0.07, 0.03))],
        700,
        ("wang-mason", 0.25, 0.66),
        ROBOT,
        Noise("gauss", (0.0577, 0.081, 0.931), before=0.4, angle=0.006, place=0.001),
        [known.varies("eps", "foam that bottoms out", state.foam_bottoms_out, 0.438)],
    ),
    Scene(
        [weighed(disc(0.035, 0.06), 1.3)],
        380,
        ("ap-newton", 0.1, 0.7),
        ROBOT,
        Noise("gauss", (0.0199, 0.0278, 0.335), before=0.2, angle=0.004, place=0.0005, by_speed=True),
        [Hidden("Magnus' force", "flight", state.magnus_force, 0.00406)],
    ),
]

SEQUENCE = [
    Scene(
        [weighed(disc(0.18, 0.035))],
        520,
        ("mirtich", 0.28, 0.62),
        ROBOT,
        Noise("gauss", (0.0504, 0.0598, 1.19), before=1.0, angle=0.002, place=0.001, rounded=True),
        [known.varies("eps", "wear of the place", sequence.wear_of_the_place, 0.363)],
        sequence.visits,
    ),
    Scene(
        [weighed(disc(0.05, 0.03))],
        360,
        ("wang-mason", 0.35, 0.7),
        DROP,
        Noise("contaminated", (0.0404, 0.047, 1.33), before=0.4, angle=0.002, place=0.0005, by_speed=True),
        [known.varies("eps", "rubber heated by hits", sequence.self_heating, 0.04)],
        sequence.bursts,
    ),
    Scene(
        [weighed(box(0.28, 0.08, 0.056))],
        640,
        ("wang-mason", 0.3, 0.5),
        ROBOT,
        Noise("laplace", (0.0438, 0.0328, 0.817), before=0.4, angle=0.006, place=0.001),
        [known.times_friction("thermostat", sequence.thermostat, 0.0916)],
    ),
    Scene(
        [weighed(disc(0.02, 0.025))],
        480,
        ("ap-newton", 0.3, 0.8),
        ROBOT,
        Noise("student", (0.0315, 0.0449, 1.08), before=0.6, angle=0.006, place=0.0005, by_speed=True),
        [Hidden("charge of earlier slips until a spark", "wrench", sequence.tribo_charge, 0.00276)],
    ),
    Scene(
        [weighed(ellipse(0.2, 0.045, 0.035))],
        820,
        ("wang-mason", 0.4, 0.55),
        ROBOT,
        Noise("gauss", (0.0581, 0.043, 1.13), before=0.6, angle=0.002, place=0.0005),
        [known.varies("mu", "dust blown away by hits", sequence.dust, 0.447)],
    ),
    Scene(
        [weighed(regular(0.3, 3, 0.055, 0.5))],
        600,
        ("ap-poisson", 0.3, 0.6),
        MIXED,
        Noise("gauss", (0.0337, 0.0484, 0.311), before=1.0, angle=0.002, place=0.0005),
        [known.varies("eps", "corners that blunt", sequence.blunting, 0.261)],
    ),
]
