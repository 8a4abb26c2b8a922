"""Drops simulated by MuJoCo: an engine that shares no equation with this package's laws.

An ellipse or a box, held in the plane by two slides and a hinge, starts where it touches the floor
with a random velocity; MuJoCo resolves the contact in about a hundred small steps.  Spreads:

    θ ~ U(−π, π) rad    v_x ~ ±U(0.3, 0.9) m/s    v_y ~ U(−2.9, −2.2) m/s    ω ~ N(0, 6²) rad/s

v_pre is the velocity at first touch and v_post that at separation, with gravity acting in between.
Left out and drawn again: approaches that the measurement would not show as such, second contacts
until the sample, a box that changes corners or lands on a side, and contacts that do not end.

**The contact.** MuJoCo gives its penetration r < 0 the acceleration −k r − c ṙ, as long as that pushes: a
spring and dashpot, scaled to the effective mass.  With ζ = c / (2 √k) = cos β the restitution is
ε = exp(−2β / tan β), the same for all poses and speeds but for the coupling with friction.  A soft
constraint (impedance 0.005) with a stiff friction (impratio 10⁵) is Coulomb's cone; MuJoCo's
default impedance, 0.9 and above, would add to the normal force where there is slip.

**Hidden effects**, each off at 0, act in the simulation and are not reported: what comes back is what a
laboratory would believe, a flat floor, a uniform body, and the velocity of its geometric centre.

Source: Todorov, Erez and Tassa (2012), IROS; the engine's own manual, "Computation", for solref.
"""

from collections.abc import Sequence

import torch
from torch import Tensor

from contactlearn.core.numerics import finite_number, whole
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.shapes import contact_point
from contactlearn.simulation.mujoco.bench import GRAVITY, KINDS, Bench, Hidden
from contactlearn.simulation.mujoco.simulation import collect

__all__ = ["GRAVITY", "KINDS", "load"]


def load(
    size: int = 500,
    kind: str = "ellipse",
    semi_axes: Sequence[float] = (0.035, 0.025),
    mass: float = 0.0364,
    mu: float = 0.12,
    eps: float = 0.55,
    contact_time: float = 2e-4,
    tilt: float = 0.0,
    com_offset: Sequence[float] = (0.0, 0.0),
    inertia_error: float = 0.0,
    damping: float = 0.0,
    delay: float = 0.0,
    velocity_noise: float = 0.01,
    spin_noise: float = 0.5,
    seed: int = 0,
) -> Impacts:
    """Simulated drops; the same arguments and version of MuJoCo give the same drops.

    Args:
        size: number of drops, at least 1.
        kind: of body, ellipse or box.
        semi_axes: (a, b) in m along the body's x and y axes; half the sides of a box;
            in [0.001, 10].
        mass: in kg, in [10⁻⁶, 10³].
        mu: coefficient of friction, in [0, 100]; the engine's own least is 10⁻⁵.
        eps: restitution of the spring and dashpot, in [0.2, 1].
        contact_time: how long they would take to rebound undamped, half a period, in s; in [10⁻⁵, 10⁻³].
        tilt: hidden: the floor is turned counter-clockwise by it, rad, in [−0.5, 0.5].
        com_offset: hidden: centre of mass minus the geometric centre, body axes, m; inside the semi-axes.
        inertia_error: hidden: κ in [−1, 1]; the true inertia is e^κ times the reported one.
        damping: hidden: drag at this rate in 1/s, m·rate on the tracked centre and I·rate on the spin,
            from touch to sample; in [0, 10⁶].
        delay: hidden: v_post is sampled this long after separation, in s; at most 0.1.
        velocity_noise: standard deviation in m/s of the noise on v_x and v_y, before and after.
        spin_noise: standard deviation in rad/s of the noise on ω, before and after.
        seed: of the random states and noise, an integer in [0, 2⁶³).

    Raises:
        ContactLearnError: MuJoCo is not installed.
        DataError: a value out of its range, or settings under which hardly any drop is a single contact.
        UnknownNameError: no such kind of body.
    """
    size, seed = whole("size", size, 1), whole("seed", seed, 0)
    hidden = Hidden(tilt=tilt, com_offset=com_offset, inertia_error=inertia_error, damping=damping, delay=delay)
    bench = Bench(kind=kind, semi_axes=semi_axes, mass=mass, mu=mu, eps=eps, contact_time=contact_time, hidden=hidden)
    sigma_v, sigma_omega = (
        finite_number("velocity_noise", velocity_noise, 0),
        finite_number("spin_noise", spin_noise, 0),
    )
    sigma = torch.tensor((sigma_v, sigma_v, sigma_omega), dtype=torch.float64)
    return _reported(bench, *collect(size, bench, sigma, torch.Generator().manual_seed(seed)), seed=seed)


def _reported(bench: Bench, q: Tensor, v_pre: Tensor, q_post: Tensor, v_post: Tensor, *, seed: int) -> Impacts:
    masses = torch.full((len(q),), bench.mass, dtype=torch.float64)
    return Impacts(
        mass=masses,
        inertia=torch.full_like(masses, bench.nominal_inertia),
        r=contact_point(bench.body, q[:, 2]),
        q=q,
        v_pre=v_pre,
        v_post=v_post,
        q_post=q_post,
        object=(bench.kind,) * len(q),
        shape=bench.body,
        source=f"MuJoCo drops (seed {seed})",
    )
