"""Simulated rigs with every fault at once, filmed by a camera that shares no code with the recordings room.

    draw            the truth about a rig: its camera, floor, body and plates
    move, record    motions of bodies on rigs, and recordings of them with the truth about every contact
    film            both

A body of unit mass is followed in small steps of time.  Contacts are compliant, so that they last: every corner of a
rounded square, or the lowest point of an ellipse, has a spring and a dashpot to the floor that never pull, and a
tangential spring and dashpot with Coulomb's limit (Walton & Braun 1986).  The contact time π/√k is that of the unit
mass; a corner far from the centre is lighter and leaves sooner.  Between contacts the plates brake the body in
proportion to its velocities, and each flight has an acceleration of its own.  Bodies come to rest by themselves; one
that stays on the floor longer than `SETTLED` loses its spin to rolling resistance.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd

STEP = 2.5e-5  # s
GRAVITY, SIDE, SEMI_AXES = 9.81, 0.06, (0.035, 0.025)  # as stated: m/s², m
TANGENTIAL, SLOWING, HAND = 0.7, 0.08, 0.004  # stiffness over the normal one; s; s that a hand pushes
SETTLED = 0.02  # s
SCENES = ("drop", "clatter", "slide", "wall", "hand")
"""A body is thrown; dropped flat; slid (a square) or rolled (an ellipse) along the floor; thrown at a wall; struck."""
JOINED, LONGEST = 3e-3, 4.5e-3  # s between two touches of one contact, and from its first touch to its last


@dataclass(frozen=True, kw_only=True)
class Rig:
    """The truth about a rig, whose every fault is 0, or 1 for a ratio, where nothing is wrong.

    Args:
        body: square or ellipse.
        rate: true frames a second.
        noise: standard deviation of positions in m; that of angles is 35 rad/m times it.
        scale: recorded length over the true one.
        pace: stated frame rate over the true one.
        delay: s from the instant of the position to that of the angle in a frame.
        sense: −1 where angles are recorded clockwise.
        zero: recorded angle in rad of a body that stands straight.
        height: of the floor below the origin of the recording, negative, in m.
        slope: rise of the floor to the right in rad.
        size: true dimensions over the stated ones.
        radius: of a square's corners in m.
        tracked: the tracked point in the body frame, from the body's geometric centre, in m.
        centre: the mass centre likewise.
        inertia: true moment of inertia over that of the stated uniform shape.
        drag: of the velocity and of the spin in 1/s.
        plates: standard deviation in m/s² of a flight's own acceleration; of its spin, 30 rad/m times as much.
        lost: probability that the camera skips a frame at a contact of more than 1 m/s; a second one, a fifth of it.
        duration: contact time in s.
        damping: of the normal dashpot, as a share of the critical one.
        friction: coefficient of the floor.
    """

    body: str = "square"
    rate: float = 250.0
    noise: float = 5e-5
    scale: float = 1.0
    pace: float = 1.0
    delay: float = 0.0
    sense: int = 1
    zero: float = 0.0
    height: float = 0.0
    slope: float = 0.0
    size: float = 1.0
    radius: float = 1e-4
    tracked: tuple[float, float] = (0.0, 0.0)
    centre: tuple[float, float] = (0.0, 0.0)
    inertia: float = 1.0
    drag: tuple[float, float] = (0.0, 0.0)
    plates: float = 0.0
    lost: float = 0.0
    duration: float = 1e-3
    damping: float = 0.2
    friction: float = 0.2

    @property
    def shape(self) -> dict:
        """The shape as stated."""
        if self.body == "ellipse":
            return {"kind": "ellipse", "semi_axes": list(SEMI_AXES)}
        half = SIDE / 2
        return {"kind": "polygon", "vertices": [[half, half], [-half, half], [-half, -half], [half, -half]]}

    @property
    def gyration_squared(self) -> float:
        """True I/m in m²."""
        return self.inertia * (SIDE**2 / 6 if self.body == "square" else sum(a * a for a in SEMI_AXES) / 4)

    def card(self) -> dict[str, float]:
        """The true values of the rig card, by the fields of `Apparatus`, in recorded metres and seconds.

        Heights show a corner and a longer axis beside a stated size: these are the ones that make the true heights.
        """
        x, y = self.tracked
        known = {
            "gravity": GRAVITY * self.scale * self.pace**2, "drag": self.drag[0] * self.pace, "slope": self.slope,
            "orientation": -self.sense * self.zero, "middle_a": -x * self.scale, "middle_b": -y * self.scale,
            "centre_a": (self.centre[0] - x) * self.scale, "centre_b": (self.centre[1] - y) * self.scale,
            "inertia": math.log(self.inertia * self.scale**2), "late": -self.delay / self.pace,
        }  # fmt: skip
        if self.body == "square":
            return {**known, "corner": SIDE / 2 - (SIDE / 2 * self.size - self.radius) * self.scale}
        return {**known, "oblong": (SEMI_AXES[0] - SEMI_AXES[1]) * (self.size * self.scale - 1)}


def draw(body: str, rate: float, noise: float, seed: int) -> Rig:
    """A rig with every fault, of sizes seen on real rigs."""
    rng = np.random.default_rng(seed)
    normal, uniform = rng.normal, rng.uniform
    return Rig(
        body=body, rate=rate, noise=noise, scale=1 + normal(0, 0.005), pace=1 + normal(0, 0.003),
        delay=uniform(0, 5e-4), sense=int(rng.choice((-1, 1))), zero=normal(0, math.radians(2)),
        height=-uniform(0, 0.02), slope=normal(0, math.radians(0.3)), size=1 + normal(0, 0.007),
        radius=uniform(5e-4, 3e-3), tracked=tuple(normal(0, 5e-4, 2)), centre=tuple(normal(0, 3e-4, 2)),
        inertia=math.exp(normal(0, 0.08)), drag=(uniform(0.05, 0.4), uniform(0, 0.5)), plates=uniform(0.05, 0.15),
        lost=0.6, duration=uniform(5e-4, 3e-3), damping=uniform(0.12, 0.3), friction=uniform(0.1, 0.4),
    )  # fmt: skip


@dataclass(frozen=True, eq=False, kw_only=True)
class Contact:
    """A touch of floor, wall or hand, or several within `JOINED`.

    Args:
        recording: its number.
        stated: s of its middle in the recording's time, counted from the frame before it.
        time: true s from first touch to last release, [2].
        q: true pose [2, 3] of the mass centre then, above a level floor.
        v: velocity [2, 3] of the tracked point then, in the recording's axes and units.
        a: acceleration [2, 3] of the flights before and after, likewise.
        skipped: frames that the recording lacks there.
        frames: of the flights before and after it.
        floor: whether nothing but the floor was touched.
    """

    recording: int
    stated: float
    time: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    skipped: int
    frames: tuple[int, int]
    floor: bool

    @property
    def single(self) -> bool:
        """Whether it is one contact with the floor."""
        return self.floor and self.time[1] - self.time[0] < LONGEST


class Motion(NamedTuple):
    """A body's scene, the instant of its first frame in s, its true poses [T, 3] at frames, and touches.

    A touch is 1 where it begins, −1 where it ends or 0; time; q; v; a without the touch; whether the floor is not all.
    """

    scene: str
    start: float
    poses: np.ndarray
    touches: list[tuple]


@dataclass(frozen=True, eq=False, kw_only=True)
class Film:
    """Recordings of a rig in a table (recording, time, x, y, theta), the scene of each, and all contacts."""

    table: pd.DataFrame
    scenes: tuple[str, ...]
    contacts: tuple[Contact, ...]


def film(rigs: Sequence[Rig], count: int, seed: int) -> list[Film]:
    """Film `count` bodies on each rig; the rigs have one kind of body and one frame rate."""
    motions = move([rig for rig in rigs for _ in range(count)], seed)
    return [record(rig, motions[k * count : (k + 1) * count], seed + k) for k, rig in enumerate(rigs)]


def move(
    rigs: Sequence[Rig], seed: int, *, seconds: float = 1.6, others: float = 0.2, step: float = STEP
) -> list[Motion]:
    """Move a body on each rig in steps of time; a share `others` of scenes is no drop."""
    rng = np.random.default_rng(seed)
    scenes = np.where(rng.random(len(rigs)) < others, rng.choice(SCENES[1:], len(rigs)), "drop")
    bodies = _Bodies(rigs, scenes, rng, step)
    starts, (poses, touches) = bodies.phase * step, bodies.follow(seconds)
    return [Motion(*parts) for parts in zip(map(str, scenes), starts.tolist(), poses, touches, strict=True)]


def record(rig: Rig, motions: Sequence[Motion], seed: int) -> Film:
    """Record the motions of bodies on a rig."""
    rng, tables, contacts = np.random.default_rng(seed), [], []
    for number, motion in enumerate(motions, 1):
        table, found = _recorded(rig, number, motion, rng)
        tables.append(table)
        contacts += found
    scenes = tuple(motion.scene for motion in motions)
    return Film(table=pd.concat(tables, ignore_index=True), scenes=scenes, contacts=tuple(contacts))


class _Bodies:
    """N bodies in the axes of their floors: pose and velocity [N, 3] of the mass centre."""

    def __init__(self, rigs: Sequence[Rig], scenes: np.ndarray, rng: np.random.Generator, step: float):
        self.rng, self.ellipse, self.step, n = rng, rigs[0].body == "ellipse", step, len(rigs)
        self.plates, self.mu = (np.array([getattr(rig, name) for rig in rigs]) for name in ("plates", "friction"))
        self.size, self.radius = np.array([rig.size for rig in rigs]), np.array([rig.radius for rig in rigs])
        self.k = (math.pi / np.array([rig.duration for rig in rigs])) ** 2
        self.c = 2 * np.array([rig.damping for rig in rigs]) * np.sqrt(self.k)
        self.centre, self.slope = np.array([rig.centre for rig in rigs]), np.array([rig.slope for rig in rigs])
        self.inertia = np.array([rig.gyration_squared for rig in rigs])
        self.drag = np.array([(rig.drag[0], *rig.drag) for rig in rigs])
        (self.stride,) = {round(1 / (rig.rate * step)) for rig in rigs}  # steps of a frame
        self.late = np.array([round(rig.delay / step) for rig in rigs])
        self.phase = rng.integers(0, self.stride, n)
        self.radius = np.zeros(n) if self.ellipse else self.radius
        half = SIDE / 2 * self.size - self.radius
        signs = np.array(((1, 1), (-1, 1), (-1, -1), (1, -1)))
        self.corners = half[:, None, None] * signs - self.centre[:, None]
        self._place(scenes)

    def _place(self, scenes: np.ndarray) -> None:
        n, uniform, normal = len(scenes), self.rng.uniform, self.rng.normal
        x, height, theta = np.zeros(n), uniform(0.10, 0.30, n), uniform(-math.pi, math.pi, n)
        v = np.stack((uniform(-0.5, 0.5, n), uniform(-0.6, 0.3, n), normal(0, 7, n)), 1)
        flat = np.isin(scenes, ("clatter", "slide"))
        quarter = math.pi / 2 * self.rng.integers(0, 4, n)
        theta = np.where(flat & (not self.ellipse), quarter + normal(0, 0.02, n) * (scenes == "clatter"), theta)
        v[flat, 2] = normal(0, 0.3, flat.sum()) * (scenes[flat] == "clatter")
        height = np.where(scenes == "clatter", uniform(0.01, 0.05, n), height) * (scenes != "slide")
        slides = scenes == "slide"
        v[slides] = np.stack((uniform(0.4, 1.0, slides.sum()), 0 * v[slides, 0], 0 * v[slides, 0]), 1)
        if self.ellipse:
            v[slides, 2] = -v[slides, 0] / SEMI_AXES[0]
        v[scenes == "wall", 0] = uniform(0.6, 1.2, (scenes == "wall").sum())
        self.wall = np.where(scenes == "wall", uniform(0.06, 0.25, n), np.inf)
        self.strike = np.where(scenes == "hand", uniform(0.05, 0.8, n), np.inf)
        self.push = np.stack((normal(0, 250, n), normal(0, 250, n), normal(0, 3000, n)), 1)
        q = np.stack((x, height, theta), 1)
        low = self._feet(np.arange(n), theta)[0][..., 1].min(1)
        q[:, 1] -= low
        self.q, self.v, self.own = q, v, self._own(n, self.plates)

    def _own(self, n: int, plates: np.ndarray) -> np.ndarray:
        return plates[:, None] * np.array((1.0, 1.0, 30.0)) * self.rng.normal(0, 1, (n, 3))

    def _feet(self, rows: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Lowest points [n, C, 2] of all corners, from the mass centre, and how far the body reaches right [n, 2]."""
        c, s = np.cos(theta)[:, None], np.sin(theta)[:, None]
        if not self.ellipse:
            x, y = self.corners[rows, :, 0], self.corners[rows, :, 1]
            points = np.stack((c * x - s * y, s * x + c * y - self.radius[rows, None]), -1)
            right = np.take_along_axis(points, points[..., :1].argmax(1)[:, None], 1)[:, 0]
            return points, right + self.radius[rows, None]
        a, b = (axis * self.size[rows, None] for axis in SEMI_AXES)
        down, side = np.sqrt((a * s) ** 2 + (b * c) ** 2), np.sqrt((a * c) ** 2 + (b * s) ** 2)
        mixed = (a * a - b * b) * s * c
        x, y = self.centre[rows, :1], self.centre[rows, 1:]
        offset = np.concatenate((c * x - s * y, s * x + c * y), 1)
        points = np.concatenate((-mixed / down, -down), 1) - offset
        return points[:, None], np.concatenate((side, mixed / side), 1) - offset

    def follow(self, seconds: float) -> tuple[list[np.ndarray], list[list[tuple]]]:
        """Poses [T, 3] of every body at its frames, and its touches."""
        q, v, own, n = self.q, self.v, self.own, len(self.q)
        steps, stride = round(seconds / self.step), self.stride
        frames = np.full((n, steps // stride + 1, 3), np.nan)
        at, at_angle = ([np.flatnonzero((self.phase + late) % stride == r) for r in range(stride)]
                        for late in (0, self.late))  # fmt: skip
        gravity = -GRAVITY * np.stack((np.sin(self.slope), np.cos(self.slope), 0 * self.slope), 1)
        stretch = np.zeros((n, 1 if self.ellipse else 4))
        since, touched = np.full(n, np.inf), np.zeros(n, bool)
        touches: list[list[tuple]] = [[] for _ in range(n)]
        reach = 1.5 * max(SIDE / math.sqrt(2), *SEMI_AXES)
        for step in range(steps):
            now = step * self.step
            for rows, part in ((at[step % stride], slice(0, 2)), (at_angle[step % stride], slice(2, 3))):
                if len(rows):
                    late = self.late[rows] if part.start else 0
                    number = (step - self.phase[rows] - late) // stride
                    rows, number = rows[number >= 0], number[number >= 0]
                    frames[rows, number, part] = q[rows, part]
            middle = q + v * (self.step / 2)
            a = gravity + own - self.drag * v
            free = a.copy()
            near = np.flatnonzero((middle[:, 1] < reach) | (middle[:, 0] > self.wall - reach))
            touching, other = np.zeros(n, bool), np.zeros(n, bool)
            if len(near):
                force, floor, stretch[near] = self._floor(near, middle[near], v[near], stretch[near])
                pushed, wall = self._wall(near, middle[near], v[near])
                a[near] += force + pushed
                touching[near], other[near] = floor | wall, wall
            struck = (now >= self.strike) & (now < self.strike + HAND)
            if struck.any():
                a[struck] += self.push[struck]
                touching, other = touching | struck, other | struck
            for row in np.flatnonzero(touching != touched):
                begins = bool(touching[row])
                if not begins:
                    own[row] = self._own(1, self.plates[row : row + 1])[0]
                    free[row] = gravity[row] + own[row] - self.drag[row] * v[row]
                touches[row].append((1 if begins else -1, now, q[row].copy(), v[row].copy(), free[row], other[row]))
            since = np.where(touching, np.minimum(since, now), np.inf)
            for row in np.flatnonzero(other & touched):
                touches[row].append((0, now, q[row].copy(), v[row].copy(), free[row], True))
            touched = touching
            rolls = now - since > SETTLED
            a[rolls, 2] -= v[rolls, 2] / SLOWING
            v = v + a * self.step
            q = middle + v * (self.step / 2)
        return [poses[: steps // stride - 1] for poses in frames], touches

    def _floor(self, rows, q, v, stretch) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Acceleration [n, 3], whether the floor is touched [n], and the stretch [n, C] of the tangential springs."""
        feet = self._feet(rows, q[:, 2])[0]
        depth = -(q[:, 1:2] + feet[..., 1])
        inside, k, c = depth > 0, self.k[rows, None], self.c[rows, None]
        arm = -q[:, 1:2]  # of the floor from the mass centre
        slip, rise = v[:, :1] - v[:, 2:] * arm, v[:, 1:2] + v[:, 2:] * feet[..., 0]
        normal = np.where(inside, np.maximum(k * depth - c * rise, 0), 0)
        stretch = np.where(inside, stretch + slip * self.step, 0)
        grip = -TANGENTIAL * k * stretch - c * slip
        limit = self.mu[rows, None] * normal
        along = np.clip(grip, -limit, limit)
        stretch = np.where(np.abs(grip) > limit, -along / (TANGENTIAL * k), stretch)
        moment = (feet[..., 0] * normal - arm * along).sum(1) / self.inertia[rows]
        return np.stack((along.sum(1), normal.sum(1), moment), 1), inside.any(1), stretch

    def _wall(self, rows, q, v) -> tuple[np.ndarray, np.ndarray]:
        """Acceleration [n, 3] by a smooth wall, and whether it is touched [n]."""
        right = self._feet(rows, q[:, 2])[1]
        depth = q[:, 0] + right[:, 0] - self.wall[rows]
        push = np.maximum(self.k[rows] * depth + self.c[rows] * (v[:, 0] - v[:, 2] * right[:, 1]), 0) * (depth > 0)
        return np.stack((-push, 0 * push, right[:, 1] * push / self.inertia[rows]), 1), depth > 0


def _recorded(rig: Rig, number: int, motion: Motion, rng: np.random.Generator) -> tuple[pd.DataFrame, list[Contact]]:
    """A recording as the camera writes it, and its contacts."""
    clock = motion.start + np.arange(len(motion.poses)) / rig.rate
    kept, groups, skips = np.ones(len(clock), bool), _joined(motion.touches), []
    for group in groups:
        middle = (group[0][1] + group[-1][1]) / 2
        hard = group[0][3][1] < -1 and clock[0] + 0.02 < middle < clock[-1] - 0.02
        skips.append(int(hard and rng.random() < rig.lost) * (1 + int(rng.random() < 0.2)))
        kept[np.argsort(np.abs(clock - middle))[: skips[-1]]] = False
    poses, clock, stated = motion.poses[kept], clock[kept], rig.rate * rig.pace
    position, angle = _turned(rig, poses[:, :2] + _arm(rig, poses[:, 2])), rig.sense * (poses[:, 2] + rig.slope)
    position = rig.scale * (position + np.array((0, rig.height)) + rng.normal(0, rig.noise, (len(poses), 2)))
    angle = angle + rig.zero + rng.normal(0, 35 * rig.noise, len(poses))
    table = pd.DataFrame({
        "recording": f"{number:03d}", "time": np.arange(len(poses)) / stated, "x": position[:, 0], "y": position[:, 1],
        "theta": (angle + math.pi) % (2 * math.pi) - math.pi,
    })  # fmt: skip
    contacts = []
    ends = [0.0, *(group[-1][1] for group in groups)]
    starts = [*(group[0][1] for group in groups[1:]), math.inf]
    for group, lost, end, start in zip(groups, skips, ends, starts, strict=False):
        time = np.array((group[0][1], group[-1][1]))
        before = np.searchsorted(clock, time.mean()) - 1
        if group[-1][0] != -1 or not 0 <= before < len(clock) - 1:
            continue
        q, v, a = (np.stack((group[0][j], group[-1][j])) for j in (2, 3, 4))
        arm = _arm(rig, q[:, 2])
        v_seen = v[:, :2] + v[:, 2:] * arm[:, ::-1] * (-1, 1)
        a_seen = a[:, :2] + a[:, 2:] * arm[:, ::-1] * (-1, 1) - v[:, 2:] ** 2 * arm
        contacts.append(Contact(
            recording=number, stated=(before + (time.mean() - clock[before]) * rig.rate) / stated, time=time, q=q,
            v=rig.pace * np.column_stack((rig.scale * _turned(rig, v_seen), rig.sense * v[:, 2])),
            a=rig.pace**2 * np.column_stack((rig.scale * _turned(rig, a_seen), rig.sense * a[:, 2])), skipped=lost,
            frames=(int(((clock > end) & (clock < time[0])).sum()), int(((clock > time[1]) & (clock < start)).sum())),
            floor=not any(touch[5] for touch in group),
        ))  # fmt: skip
    return table, contacts


def _turned(rig: Rig, vectors: np.ndarray) -> np.ndarray:
    """Vectors [n, 2] in the axes of the floor in those of the recording."""
    c, s = math.cos(rig.slope), math.sin(rig.slope)
    return vectors @ np.array(((c, s), (-s, c)))


def _arm(rig: Rig, theta: np.ndarray) -> np.ndarray:
    """The tracked point [n, 2] from the mass centre."""
    (x, y), c, s = np.array(rig.tracked) - rig.centre, np.cos(theta), np.sin(theta)
    return np.stack((c * x - s * y, s * x + c * y), 1)


def _joined(touches: list[tuple]) -> list[list[tuple]]:
    """Touches of one contact, whose releases last at most `JOINED`."""
    groups: list[list[tuple]] = []
    for touch in touches:
        if groups and (touch[0] != 1 or touch[1] - groups[-1][-1][1] < JOINED):
            groups[-1].append(touch)
        else:
            groups.append([touch])
    return groups
