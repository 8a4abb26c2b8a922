"""Which names of the catalogue, and which words of the sequence, are right for what is hidden.

A name is right by the rule of `third_hand.meanings`; of the sequence, what the author wrote down with each set, as that
by which it can be recognised.
"""

from dataclasses import dataclass

KNOWN: dict[str, tuple[str, ...]] = {
    "restitution by lever": ("configuration_dependent_restitution",),
    # Debatable: incidence is slip over load, and follows it where impacts are about equally fast.
    "friction falls with slip": ("velocity_dependent_friction",),
    "friction drifts": ("parameter_drift",),
    "restitution settles": ("parameter_drift",),
    "rolling resistance": ("rolling_resistance",),
    "restitution by side of the body": ("orientation_dependent_restitution",),
    "floor tilted": ("surface_tilt",),
    "restitution falls with speed": ("velocity_dependent_restitution",),
    "tangential restitution": ("tangential_restitution",),
    "contact is a patch": ("contact_patch",),
    "mass centre off the tracked centre": ("com_offset",),
    "friction by place": ("location_dependent_friction",),
}


@dataclass(frozen=True)
class Sequence:
    """What is right to say: the coefficient that varies, what it follows, and its period in trials if there is one."""

    coefficient: str
    follows: tuple[str, ...]
    period: float | None = None


SEQUENCE: dict[str, Sequence] = {
    # The energy that an impact leaves is that of its normal speed for the most part, and its impulse follows that.
    "floor warmed by impacts": Sequence("eps", ("normal_impulse", "normal_speed", "order")),
    # Debatable: friction by the sign of v_t times that of the last v_t moves P_t by the last sign alone, so that to say
    # of the outcome that it depends on the last slip is true.  It is not counted, since it names no coefficient.
    "pile laid by the last slip": Sequence("mu", ("slip", "tangential_impulse")),
    "floor wiped every 26 trials": Sequence("mu", ("order", "period"), 26),
    "two grippers in turn": Sequence("eps", ("order", "period"), 4),
    # A loss of normal impulse, which restitution tells.
    "suction of a pump that cycles": Sequence("eps", ("order", "period"), 11.7),
    # By the distance between contact places, which could not be said when these sets were first asked.
    "foam dented by hits nearby": Sequence("eps", ("place",)),
    # A loss of v_y, which restitution tells; the slip work is friction times slip.
    "charge of earlier slips": Sequence("eps", ("slip_speed", "order")),
    "restitution by day and night": Sequence("eps", ("order", "period"), 720 / 11.3),
    "oil film squeezed by impacts": Sequence("mu", ("normal_impulse", "normal_speed")),
}
"""Of what follows the sequence of the trials."""
