"""Physics without a name that depends on the state of each impact: numbers of a formula → what is hidden."""

import numpy as np

from fourth_hand.laboratory import turned
from sixth_hand.impact import Hidden, Impact
from sixth_hand.known import fly, springs, times_friction, varies
from sixth_hand.soft import stiffness, two_corners
from sixth_hand.throws import G


def _axis(now: Impact) -> np.ndarray:
    """The body's long axis."""
    return np.stack([np.cos(now.theta), np.sin(now.theta)], 1)


def _blow(now: Impact) -> np.ndarray:
    """Change of velocity along that axis."""
    return np.sum((now.post[:, :2] - now.v[:, :2]) * _axis(now), axis=1)


def electret_stripes(kick: float, width: float) -> Hidden:
    """v_y⁺ + kick q(θ) q(x)/(0.5 + |v_n|): halves of the body and stripes of the floor have charges of both signs."""

    def after(now: Impact) -> None:
        charge = np.tanh(np.sin(now.theta) / 0.3) * np.tanh(2 * np.sin(np.pi * now.x / width))
        now.post[:, 1] += kick * charge / (0.5 + now.approach)

    return Hidden("electret stripes", after=after)


def slug(mass_share: float, rest: float) -> Hidden:
    """v⁺ − share (1 + rest) u (u · Δv): a slug keeps its velocity along its slot u(θ), then strikes the slot's end."""

    def after(now: Impact) -> None:
        now.post[:, :2] -= (mass_share * (1 + rest) * _blow(now))[:, None] * _axis(now)

    return Hidden("slug in a slot", after=after)


def flap(a: float, scale: float) -> Hidden:
    """ε + a tanh(r_x ω/scale): a hinged flap is closed or opened by the rotation of the struck side."""
    return varies("hinged flap", "eps", lambda now: a * np.tanh(now.r[:, 0] * now.v[:, 2] / scale))


def second_corner(seconds: float) -> Hidden:
    """The two lowest corners are on springs for so long: the second lands before the body is away."""
    return Hidden("second corner", solve=lambda now: two_corners(now, seconds))


def corrugated(slope: float, wavelength: float) -> Hidden:
    """The floor's normal is turned by slope sin(2π x/wavelength)."""
    return Hidden("corrugated floor", lambda now: setattr(now, "tilt", slope * np.sin(2 * np.pi * now.x / wavelength)))


def travelling_wave(speed: float, frequency: float, number: float) -> Hidden:
    """The floor moves up with speed sin(2π f |v_y|/g − k x): a shaker releases the body, so its fall sets the phase."""

    def before(now: Impact) -> None:
        phase = 2 * np.pi * frequency * np.abs(now.v[:, 1]) / G - number * now.x
        now.floor = np.stack([0 * phase, speed * np.sin(phase)], 1)

    return Hidden("travelling wave in the floor", before)


def ring_mode(a: float, turns: float, angle: float) -> Hidden:
    """ε + a cos 4(θ − angle) cos(2π turns |v_n|^(−1/5)): a mode gives energy back in phase with separation or not."""

    def change(now: Impact) -> np.ndarray:
        phase = 2 * np.pi * turns * now.approach**-0.2
        return a * np.cos(4 * (now.theta - angle)) * np.cos(phase)

    return varies("mode of a slotted ring", "eps", change)


def magnus(lift: float, seconds: float) -> Hidden:
    """dv/dt = lift ω × v until the second measurement."""
    return Hidden("Magnus lift", after=lambda now: fly(now, 0.0, lift, seconds))


def gecko(share: float, angle: float) -> Hidden:
    """The floor pulls on unloading with a share of the peak force where sin(θ − angle) v_t > 0: flakes with a lay."""

    def pull(now: Impact):
        active = 0.5 * (1 + np.tanh(np.sin(now.theta - angle) * now.slip / 0.15))
        peak = now.approach * np.sqrt(stiffness(now) / now.W[2])
        return lambda depth, unloading: np.where(unloading & (depth > 0), share * peak * active, 0.0)

    return springs("directional dry adhesive", pull=pull)


def seams(angle: float, lobes: int) -> Hidden:
    """The normal is turned by angle sin(lobes θ): a ball with raised seams."""
    return Hidden("seams of the ball", lambda now: setattr(now, "tilt", angle * np.sin(lobes * now.theta)))


def wedge_of_putty(loss: float, rate: float, width: float) -> Hidden:
    """ε − loss/cosh²(ln(|v_n|/h(x)/rate)/width): a layer loses most where the rate meets its relaxation time."""

    def change(now: Impact) -> np.ndarray:
        thickness = 0.003 * (1 + now.x / 0.28)
        return -loss / np.cosh((np.log(now.approach / thickness) - np.log(rate)) / width) ** 2

    return varies("wedge of damping putty", "eps", change)


def electroadhesion(a: float, pitch: float) -> Hidden:
    """μ (1 ± a) by the polarity of finger(x) and of the face (Johnsen & Rahbek 1923)."""

    def change(now: Impact) -> np.ndarray:
        return a * np.sign(np.sin(np.pi * now.x / pitch)) * np.tanh(np.cos(now.theta - 0.7) / 0.25)

    return times_friction("electroadhesive fingers", change)


def tether(share: float, slack: float) -> Hidden:
    """v_x⁺ loses a share, and v_y⁺ is pulled down, where x v_x⁺ is more than the slack: an umbilical goes taut."""

    def after(now: Impact) -> None:
        taut = share / (1 + np.exp(-(now.x * now.post[:, 0] - slack) / 0.01))
        now.post[:, 0] -= taut * now.post[:, 0]
        now.post[:, 1] -= 0.6 * taut * np.abs(now.post[:, 0])

    return Hidden("tether goes taut", after=after)


def immersed(along: float, across: float, seconds: float) -> Hidden:
    """Added mass that differs along and across the body, and Munk's moment (Lamb 1932; Munk 1924)."""

    def before(now: Impact) -> None:
        c, s, a, b = np.cos(now.theta), np.sin(now.theta), 1 / (1 + along), 1 / (1 + across)
        full = np.zeros((len(c), 3, 3))
        full[:, 0, 0], full[:, 1, 1] = (c**2 * a + s**2 * b) / now.mass, (s**2 * a + c**2 * b) / now.mass
        full[:, 0, 1] = full[:, 1, 0] = c * s * (a - b) / now.mass
        full[:, 2, 2] = 1 / (now.inertia * (1 + 0.3 * across))
        now.full = full

    def after(now: Impact) -> None:
        body = turned(now.post[:, :2], -now.theta)
        now.post[:, 2] -= (across - along) * now.mass * body[:, 0] * body[:, 1] * seconds / now.inertia

    return Hidden("immersed in a liquid", before, after)


def plunger(kick: float, threshold: float) -> Hidden:
    """A kick along a direction of the body where |u(θ) · Δv| is more than a threshold: a cocked spring goes off."""

    def after(now: Impact) -> None:
        blow = _blow(now)
        size = kick * (np.abs(blow) > threshold) * np.sign(blow)
        now.post[:, :2] += size[:, None] * turned(_axis(now), 0.8)

    return Hidden("cocked plunger", after=after)


def bristles(ratio: float, tile: float) -> Hidden:
    """A tangential spring with slip where the slip runs against the lay of the tile at x, Coulomb where with it."""

    def tangential(now: Impact) -> np.ndarray:
        return np.where(np.sign(np.sin(np.pi * now.x / tile)) * now.slip < 0, ratio, np.inf)

    return springs("leaning bristles", tangential=tangential)
