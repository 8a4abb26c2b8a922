"""Effects that the catalogue has a name for: numbers of a formula of the literature → what is hidden."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from fifth_hand.bodies import stretched
from fourth_hand.laboratory import turned
from sixth_hand.bodies import touching
from sixth_hand.impact import Hidden, Impact

Of = Callable[[Impact], np.ndarray]


def varies(what: str, coefficient: str, change: Of) -> Hidden:
    """`mu` or `eps`, plus a function of the impact."""
    return Hidden(what, lambda now: setattr(now, coefficient, getattr(now, coefficient) + change(now)))


def times_friction(what: str, change: Of) -> Hidden:
    """μ (1 + a function of the impact)."""
    return varies(what, "mu", lambda now: now.mu * change(now))


def springs(what: str, **changes: Callable[[Impact], object]) -> Hidden:
    """Springs of the soft contact by functions of the impact."""

    def before(now: Impact) -> None:
        now.soft = replace(now.soft, **{name: change(now) for name, change in changes.items()})

    return Hidden(what, before)


# --- Restitution -----------------------------------------------------------------------------------


def viscoelastic_sphere(k: float, gamma: float) -> Hidden:
    """Force k d^1.5 + γ √d ḋ of a Hertz contact, so that ε falls about as 1 − a v^(1/5) (Kuwabara & Kono 1987)."""
    return springs("velocity_dependent_restitution", hertz=lambda now: k, gamma=lambda now: gamma)


def plastic_indentation(yield_speed: float) -> Hidden:
    """ε times the elastic and perfectly plastic sphere's of v_n over the yield speed, 1 at 1.8 m/s (Thornton 1997)."""

    def restitution(speed: np.ndarray | float) -> np.ndarray:
        u = np.minimum(yield_speed / speed, 1.0)
        return np.sqrt(6 * np.sqrt(3) / 5) * np.sqrt(1 - u**2 / 6) * (u / (u + 2 * np.sqrt(1.2 - 0.2 * u**2))) ** 0.25

    def change(now: Impact) -> np.ndarray:
        return now.eps * (restitution(now.approach) / restitution(1.8) - 1)

    return varies("velocity_dependent_restitution", "eps", change)


def softening(a: float, scale: float) -> Hidden:
    """ε + a (1/e − exp(−|v_n|/scale)), as of golf and tennis balls."""
    return varies(
        "velocity_dependent_restitution", "eps", lambda now: a * (np.exp(-1.0) - np.exp(-now.approach / scale))
    )


def oblique(a: float) -> Hidden:
    """ε + a 2/π atan(|v_t/v_n|/1.2) (Louge & Adams 2002)."""
    return varies(
        "incidence_dependent_restitution",
        "eps",
        lambda now: a * (2 / np.pi) * np.arctan(np.abs(now.slip) / now.approach / 1.2),
    )


def sheared_layer(loss: float, scale: float) -> Hidden:
    """ε − loss v_t²/(scale² + v_t²): the pile of a soft floor is sheared."""
    return varies("slip_dependent_restitution", "eps", lambda now: -loss * now.slip**2 / (scale**2 + now.slip**2))


def two_halves(step: float, angle: float, width: float) -> Hidden:
    """ε + step tanh(sin(θ − angle)/width): a body glued of two materials."""
    return varies(
        "orientation_dependent_restitution", "eps", lambda now: step * np.tanh(np.sin(now.theta - angle) / width)
    )


def clamped_board(loss: float, middle: float, length: float) -> Hidden:
    """ε − loss (1 − ((x − middle)/length)²)²: the board bends most in its middle (Zener 1941)."""

    def change(now: Impact) -> np.ndarray:
        return -loss * (1 - np.clip((now.x - middle) / length, -1, 1) ** 2) ** 2

    return varies("location_dependent_restitution", "eps", change)


def bending_mode(loss: float) -> Hidden:
    """ε − loss s^1.5/(1 + 0.3 s^1.5), s = |r_x|/ρ: energy stays in the body's bending (Stoianovici & Hurmuzlu 1996)."""

    def change(now: Impact) -> np.ndarray:
        s = (np.abs(now.r[:, 0]) / np.sqrt(now.inertia / now.mass)) ** 1.5
        return -loss * s / (1 + 0.3 * s)

    return varies("configuration_dependent_restitution", "eps", change)


def warming(rise: float, trials: float) -> Hidden:
    """ε − rise exp(−i/trials): a squash ball warms with every hit."""
    return varies("parameter_drift", "eps", lambda now: -rise * np.exp(-now.order / trials))


# --- Friction --------------------------------------------------------------------------------------


def polishing(fall: float, middle: float, width: float) -> Hidden:
    """μ − fall/(1 + exp(−(i − middle)/width)): wear-in."""
    return varies("parameter_drift", "mu", lambda now: -fall / (1 + np.exp(-(now.order - middle) / width)))


def stribeck(rise: float, scale: float) -> Hidden:
    """μ (1 + rise exp(−|slip|/scale)) with the slip at each instant (Bo & Pavelescu 1982)."""
    return springs(
        "velocity_dependent_friction",
        friction=lambda now: lambda mu, slip, load: mu * (1 + rise * np.exp(-np.abs(slip) / scale)),
    )


def junctions(speed: float) -> Hidden:
    """μ (N/N₀)^(−1/3) at each instant, N₀ the peak at this speed: a Hertz contact's junctions (Bowden & Tabor 1950)."""

    def friction(now: Impact) -> Callable[..., np.ndarray]:
        peak = speed * np.pi / now.soft.duration / float(np.median(now.W[2]))
        return lambda mu, slip, load: mu * np.clip(load / peak, 0.01, None) ** (-1 / 3)

    return springs("load_dependent_friction", friction=friction)


def friction_by_load(a: float, speed: float) -> Hidden:
    """μ (1 + a tanh ln(|v_n|/speed)), as of rubber."""
    return times_friction("load_dependent_friction", lambda now: a * np.tanh(np.log(now.approach / speed)))


def brushed(angle: float) -> Hidden:
    """tan(atan μ + angle sign v_t): asperities that lean (Patton 1966)."""

    def before(now: Impact) -> None:
        now.mu = np.tan(np.arctan(now.mu) + np.where(now.slip > 0, angle, -angle))

    return Hidden("directional_friction", before)


def by_body(coefficient: str, changes: Sequence[float]) -> Hidden:
    """μ or ε differ by body."""
    what = {"mu": "body_dependent_friction", "eps": "body_dependent_restitution"}[coefficient]
    return varies(what, coefficient, lambda now: np.array(changes)[now.index])


# --- Of the wrench ---------------------------------------------------------------------------------


def tangential_spring(ratio: float) -> Hidden:
    """A tangential spring, k_t = ratio k_n, with slip at the cone (Cundall & Strack 1979; Maw et al. 1976)."""
    return springs("tangential_restitution", tangential=lambda now: ratio)


def pressure_centre(offset: float) -> Hidden:
    """The contact acts at r_x − offset tanh(v_t/0.1): behind the lowest point, as the slip sees it (Cross 2002)."""

    def before(now: Impact) -> None:
        now.r = now.r - np.stack([offset * np.tanh(now.slip / 0.1), 0 * now.slip], 1)

    return Hidden("contact_patch", before)


def footprint(width: float) -> Hidden:
    """Moment −width sin(π r_x/(1.2 |r|)) P_n of the pressure under a soft corner."""

    def after(now: Impact) -> None:
        lean = now.r[:, 0] / np.hypot(*now.r.T)
        now.post[:, 2] += -width * np.sin(np.pi * lean / 1.2) * now.P[:, 1] / now.inertia

    return Hidden("contact_patch", after=after)


def rolling_friction(coefficient: float, radius: float) -> Hidden:
    """Moment −coefficient radius N sign ω at each instant (Tabor 1955; Iwashita & Oda 1998)."""
    return springs(
        "rolling_resistance",
        moment=lambda now: lambda v, load: -coefficient * radius * load * np.tanh(v[:, 2] / 0.5),
    )


def tacky(impulse: float) -> Hidden:
    """P_n is less by a constant (Johnson, Kendall & Roberts 1971)."""

    def after(now: Impact) -> None:
        now.post = now.post - now.change(np.stack([0 * now.x, 0 * now.x + impulse], 1))

    return Hidden("adhesion", after=after)


# --- After the impact ------------------------------------------------------------------------------


def twist_loss(share: float) -> Hidden:
    """A share of the spin is lost in guides."""

    def after(now: Impact) -> None:
        now.post[:, 2] *= 1 - share

    return Hidden("spin_damping", after=after)


def fly(now: Impact, drag: float, lift: float, seconds: float) -> None:
    """Fly for so long with drag and lift by spin per metre; gravity is taken out by the laboratory."""
    v = now.post
    for _ in range(20):
        speed, (x, y, omega) = np.hypot(v[:, 0], v[:, 1]), v.T
        force = np.stack([-drag * speed * x - lift * omega * y, -drag * speed * y + lift * omega * x], 1)
        v[:, :2] += seconds / 20 * force


def air_drag(k: float, seconds: float) -> Hidden:
    """dv/dt = −k |v| v until the second measurement."""
    return Hidden("side_drag", after=lambda now: fly(now, k, 0.0, seconds))


# --- Of the set-up ---------------------------------------------------------------------------------


def loaded(along: float, across: float) -> Hidden:
    """The centre of mass is off the outline's by this in the body's axes, as of a loaded die."""

    def before(now: Impact) -> None:
        now.r = now.r - turned(np.broadcast_to(np.array([along, across]), now.r.shape), now.theta)

    return Hidden("com_offset", before)


def sloping(angle: float) -> Hidden:
    """The floor slopes; the contact point was seen."""
    return Hidden("surface_tilt", lambda now: setattr(now, "tilt", angle))


def hollow(log_ratio: float) -> Hidden:
    """The moment of inertia is exp(log_ratio) times that of the table."""
    return Hidden("inertia_error", lambda now: setattr(now, "inertia", now.inertia * np.exp(log_ratio)))


def worn_outline(along: float, across: float) -> Hidden:
    """Semi-axes are longer by these shares than those that were told."""
    return Hidden(
        "shape_error", lambda now: setattr(now, "r", touching(stretched(now.bodies[0], along, across), now.theta))
    )


def round_corners(radius: float) -> Hidden:
    """Corners are round."""
    return Hidden("corner_radius", lambda now: setattr(now, "r", now.touching(now.theta, radius=radius)))


def turned_camera(angle: float) -> Hidden:
    """All that is measured is in axes turned by the angle: the floor slopes in them."""

    def before(now: Impact) -> None:
        now.v = np.column_stack([turned(now.v[:, :2], angle), now.v[:, 2]])
        now.r, now.theta = turned(now.r, angle), now.theta + angle

    def after(now: Impact) -> None:
        now.post[:, :2] = turned(now.post[:, :2], -angle)

    return Hidden("surface_tilt", before, after)


def early_frame(seconds: float) -> Hidden:
    """Poses were taken before contact: it happens at θ + ω seconds."""

    def before(now: Impact) -> None:
        now.theta = now.theta + now.v[:, 2] * seconds
        now.r = now.touching(now.theta)

    return Hidden("sampling_delay", before)
