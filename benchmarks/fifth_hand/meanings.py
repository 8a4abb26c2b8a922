"""Which names, and which words of what remains, are right for what is hidden: the author's truth, beside every table.

The author named each known effect by its name in the catalogue, and fitted every name of the catalogue to the outcomes
without noise.  A name is acceptable where it does as well as the right one within chance (χ² within 9, or 93 % of it),
for unknown physics where it takes more than half of what is left, or where an expert would take it.
"""

from dataclasses import dataclass

ACCEPTABLE: dict[str, dict[str, tuple[str, ...]]] = {
    # By number of the set, and by hidden effect
    "02": {"configuration_dependent_restitution": ("orientation_dependent_restitution",)},
    "51": {"adhesion": ("gravity_impulse", "velocity_dependent_restitution")},
    "53": {"adhesion": ("velocity_dependent_restitution",)},
}
"""Names of known effects that are acceptable in place of the hidden one."""


@dataclass(frozen=True)
class Right:
    """What is right to say of unknown physics.

    Args:
        coefficient: of the law that varies, `mu` or `eps`; None where it is another thing.
        variables: symbols of those that it depends on.
        acceptable: names that describe a part of it.
        follows: what it follows along the sequence of the trials.
        period: of that in trials, if it has one.
    """

    coefficient: str | None
    variables: tuple[str, ...]
    acceptable: tuple[str, ...] = ()
    follows: tuple[str, ...] = ()
    period: float | None = None


RESTITUTION, FRICTION, OTHER = "eps", "mu", None
# A disc touches below its centre, so that its v_n is its v_y: where one is right the other is.
SPEED = ("vn", "vy")

UNKNOWN: dict[str, Right] = {
    "wet film on a half": Right(RESTITUTION, ("x", "theta", "vn")),
    "corner digs in where it is pushed": Right(FRICTION, ("vt", "rx")),
    "loose mass inside": Right(RESTITUTION, ("theta", *SPEED), ("orientation_dependent_restitution",)),
    "resonance of a beam": Right(RESTITUTION, ("x", *SPEED), ("velocity_dependent_restitution",)),
    "half-filled tank with a baffle": Right(RESTITUTION, ("omega", "theta")),
    "charged side": Right(RESTITUTION, ("theta", "vn"), ("orientation_dependent_restitution", "adhesion")),
    "eddy-current brake": Right(OTHER, ("x", "vx", *SPEED)),
    "air cushion of a closing face": Right(OTHER, ("theta", "omega", "vn")),
    "second corner within a frame": Right(OTHER, ("theta", "omega")),
    "ratchet floor": Right(FRICTION, ("x", "vt")),
    "joints with a lip": Right(FRICTION, ("x", "vt")),
    "flash melting": Right(FRICTION, ("vt", *SPEED), ("velocity_dependent_friction", "load_dependent_friction")),
    "slope of a trampoline": Right(OTHER, ("x", *SPEED)),
    # By the sign of the moment r_x P_n − r_y P_t.
    "rotor on a one-way clutch": Right(OTHER, ("rx", "vt"), ("inertia_error",)),
    # By v_n²/(2 W_nn): two bodies of one outline, whose moments of inertia are as their masses.
    "foam that bottoms out": Right(
        RESTITUTION,
        ("vn", "Wnn", "m", "I", "rx"),
        ("velocity_dependent_restitution", "configuration_dependent_restitution"),
    ),
    "Magnus' force": Right(OTHER, ("omega", "vx", *SPEED)),
    "wear of the place": Right(
        RESTITUTION,
        ("order", "x"),
        ("parameter_drift", "location_dependent_restitution"),
        ("order", "period"),
        130,
    ),
    # The normal impulse of an impact follows its speed, as it does in `fourth_hand.meanings`.
    "rubber heated by hits": Right(
        RESTITUTION, ("order",), ("parameter_drift",), ("order", "normal_speed", "normal_impulse")
    ),
    "thermostat": Right(FRICTION, ("order",), ("parameter_drift",), ("order", "period"), 47),
    "charge of earlier slips until a spark": Right(
        RESTITUTION,
        ("order", *SPEED),
        ("parameter_drift", "adhesion", "velocity_dependent_restitution"),
        ("order", "slip_speed"),
    ),
    "dust blown away by hits": Right(FRICTION, ("order", "x"), follows=("order", "normal_speed", "normal_impulse")),
    "corners that blunt": Right(RESTITUTION, ("order", "theta"), ("parameter_drift",), ("order", "period"), 160),
}
