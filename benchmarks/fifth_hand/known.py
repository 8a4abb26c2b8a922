"""Effects that the author took for ones with a name: amplitude → what is hidden.

Each was scaled by its author until it was as large as wanted beside the noise, after the best refit of μ and ε; here
stands the amplitude that was found.
"""

import numpy as np

from fifth_hand.laboratory import Hidden, Impact
from fifth_hand.throws import G


def varies(coefficient, what, g, a):
    """`mu` or `eps`, plus a (g − mean of g with nothing hidden), g of the impact."""
    return Hidden(what, "law", lambda now, a, plain: _add(now, coefficient, a * (g(now) - g(plain).mean())), a)


def times_friction(what, g, a):
    """μ (1 + a g)."""
    return Hidden(what, "law", lambda now, a, plain: _add(now, "mu", now.mu * a * g(now)), a)


def _add(now, name, change):
    setattr(now, name, getattr(now, name) + change)


def lose_energy(now: Impact, energy):
    """Take normal energy in J on leaving: v_n⁺² − 2 U W_nn."""
    vn = now.vn + now.W[1] * now.Pt + now.W[2] * now.Pn
    left = np.minimum(np.sqrt(np.maximum(vn**2 - 2 * energy * now.W[2], 1e-6)), vn)
    now.Pn = now.Pn + (left - vn) / now.W[2]


# --- Of the set-up ---------------------------------------------------------------------------------


def surface_tilt(a):
    """The floor is turned by a rad about z, and touches the lowest point along its normal."""
    return Hidden("surface_tilt", "state", lambda now, a, plain: _add(now, "tilt", a), a)


def com_offset(a):
    """The mass centre off the markers' centre: r + R(θ) (−0.8, 0.6) a; velocities are those of the mass centre."""

    def act(now, a, plain):
        now.offset = (-0.8 * a, 0.6 * a)

    return Hidden("com_offset", "state", act, a)


def inertia_error(a):
    """I eᵃ (error of a bifilar pendulum)."""

    def act(now, a, plain):
        now.inertia = now.inertia * np.exp(a)

    return Hidden("inertia_error", "state", act, a)


def orientation_offset(a):
    """A marker glued at an angle: θ + a."""
    return Hidden("orientation_offset", "state", lambda now, a, plain: _add(now, "theta", a), a)


def sampling_delay(a):
    """A pose recorded a part of a frame before contact: θ + ω a, a in s."""
    return Hidden("sampling_delay", "state", lambda now, a, plain: _add(now, "theta", now.trials.v[:, 2] * a), a)


def shape_error(a):
    """Semi-axes longer by a, and shorter by 0.4 a."""

    def act(now, a, plain):
        now.stretch = (a, -0.4 * a)

    return Hidden("shape_error", "state", act, a)


# --- Of the wrench ---------------------------------------------------------------------------------


def _rebound_of_slip(now, a, of_sticking):
    """Sticking trials get v_t⁺ = −a v_t within the cone; `of_sticking` are clipped to the cone there alone."""
    sticks = np.abs(now.slip + now.W[0] * now.Pt + now.W[1] * now.Pn) < 1e-7
    cone = now.mu * now.Pn
    now.Pt = np.where(sticks, np.clip(now.Pt - a * of_sticking * now.slip / now.W[0], -cone, cone), now.Pt)


def tangential_restitution(a):
    """Sticking trials leave with v_t⁺ = −a v_t, within the cone (Walton 1993)."""
    return Hidden("tangential_restitution", "wrench", lambda now, a, plain: _rebound_of_slip(now, a, 1.0), a)


def fading_tangential_restitution(a):
    """The same times 1 − |v_t|/(3 μ |v_n|): it fades toward gross slip (Maw, Barber & Fawcett 1976; Foerster 1994)."""

    def act(now, a, plain):
        _rebound_of_slip(now, a, 1 - np.clip(np.abs(now.slip) / (3.0 * now.mu * np.abs(now.vn)), 0, 1))

    return Hidden("tangential_restitution", "wrench", act, a)


def contact_patch(a):
    """A finite area: τ = −a r_x P_n."""
    return Hidden("contact_patch", "wrench", lambda now, a, plain: _add(now, "moment", -a * now.r[:, 0] * now.Pn), a)


def saturating_contact_patch(a):
    """τ = −a tanh(r_x/0.012 m) P_n: Hertz's line contact of half-width a, whose pressure centre lags the lever."""

    def act(now, a, plain):
        now.moment = now.moment - a * np.tanh(now.r[:, 0] / 0.012) * now.Pn

    return Hidden("contact_patch", "wrench", act, a)


def rolling_resistance(a, scale):
    """τ = −a tanh(ω/scale) P_n: the normal force acts ahead of the centre (Cross 2002), a in m."""

    def act(now, a, plain):
        now.moment = now.moment - a * np.tanh(now.trials.v[:, 2] / scale) * now.Pn

    return Hidden("rolling_resistance", "wrench", act, a)


def pull_off_work(a):
    """A constant work of a J on leaving (JKR 1971; Thornton & Ning 1998)."""
    return Hidden("adhesion", "wrench", lambda now, a, plain: lose_energy(now, a), a)


def pull_off_impulse(a):
    """A tacky film takes a N s of every P_n."""
    return Hidden("adhesion", "wrench", lambda now, a, plain: _add(now, "Pn", -a), a)


# --- Of the flight ---------------------------------------------------------------------------------


def side_drag(a):
    """Guide panes: (v_x, v_y) times 1 − a after impact."""
    return Hidden("side_drag", "flight", lambda now, a, plain: _add(now, "post", now.post * [-a, -a, 0]), a)


def spin_damping(a):
    """A felt seal, or air: ω times 1 − a after impact."""
    return Hidden("spin_damping", "flight", lambda now, a, plain: _add(now, "post", now.post * [0, 0, -a]), a)


def gravity_impulse(a):
    """A late frame, by a s: v_y − g a."""
    return Hidden("gravity_impulse", "flight", lambda now, a, plain: _add(now, "post", np.array([0, -a * G, 0])), a)


# --- Restitution, as g of the impact ---------------------------------------------------------------


def yields(now):
    """A sphere yields above 1.7 m/s: min(1, (1.7/|v_n|)^¼) (Thornton 1997)."""
    return np.minimum(1, (1.7 / np.abs(now.vn)) ** 0.25)


def falls_with_speed(now):
    """−|v_n|, as of wood or cork on steel (Goldsmith 1960)."""
    return now.vn


def rises_with_slip(now):
    """The lesser of |v_t| and 2.5 m/s: normal restitution rises with obliquity (Louge & Adams 2002)."""
    return np.minimum(np.abs(now.slip), 2.5)


def falls_with_lever(now):
    """−(r_x/ρ)² (Stoianovici & Hurmuzlu 1996)."""
    return -(now.lever**2)


def falls_and_settles_with_lever(now):
    """−(1 − exp(−(r_x/0.45 ρ)²)): rods lose to vibration (Stoianovici & Hurmuzlu 1996), saturating."""
    return np.exp(-((now.lever / 0.45) ** 2)) - 1


def soft_sector(now):
    """A ball with a glued soft sector: −exp(1.5 (cos(θ − 1.1) − 1))."""
    return -np.exp(1.5 * (np.cos(now.trials.theta - 1.1) - 1))


def two_halves(now):
    """A body of two halves: cos(θ − 0.6)."""
    return np.cos(now.trials.theta - 0.6)


def soft_middle(now):
    """A plate on four supports: −exp(−(x/0.07)²)."""
    return -np.exp(-((now.trials.x / 0.07) ** 2))


def runs_in(now):
    """Wear that settles: exp(−order/(N/4))."""
    return np.exp(-now.trials.order / (0.25 * len(now.trials.x)))


def hardens(now):
    """Logarithmic work hardening: −ln(1 + order/60)."""
    return -np.log1p(now.trials.order / 60.0)


# --- Friction, as g of the impact ------------------------------------------------------------------


def nap(now):
    """The nap of a fabric: tanh(v_t/0.3) (Mróz & Stupkiewicz 1994)."""
    return np.tanh(now.slip / 0.3)


def brushed(now):
    """Brushed metal: the sign of v_t."""
    return np.sign(now.slip)


def varnished(now):
    """A plate half varnished, half raw: tanh((x_c − 0.02)/0.025)."""
    return np.tanh((now.place - 0.02) / 0.025)


def dusty(now):
    """A gradient of dust: sin(π x/0.24), no further than ±0.12."""
    return np.sin(np.clip(now.trials.x / 0.12, -1, 1) * np.pi / 2)


def polishes(now):
    """The plate is polished: order/N − ½."""
    return now.trials.order / len(now.trials.x) - 0.5


def stribeck(now):
    """exp(−|v_t|/0.5) (Stribeck 1902; Bo & Pavelescu 1982)."""
    return np.exp(-np.abs(now.slip) / 0.5)


def hertzian(now):
    """(|v_n|/1.5)^−0.33 − 1, as μ falls with the cube root of the load (Bowden & Tabor)."""
    return (np.maximum(np.abs(now.vn), 0.2) / 1.5) ** -0.33 - 1
