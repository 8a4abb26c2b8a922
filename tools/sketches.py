"""Drawings of the documentation that show no run: axes, the flow of data, a sketch for each family of effects, and
figures of numbers that stand in its tables.

    python tools/sketches.py    all of them as SVG, into docs/pictures
"""

import re
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Circle, Ellipse, FancyArrowPatch, FancyBboxPatch, Polygon, Rectangle
from matplotlib.text import Text

DOCS = Path(__file__).parent.parent / "docs"
TARGET = DOCS / "pictures"
INK, FAINT, EFFECT, LAW = "#222222", "#9aa3ad", "#d95f02", "#1b5e9b"
A, B = 0.7, 0.5
"""Semi-axes of the body of the sketches."""


def blank(width=2.6, height=1.7):
    """A figure with one pair of equal axes and no frame."""
    figure = Figure((width, height))
    ax = figure.add_axes((0.01, 0.01, 0.98, 0.98))
    ax.set(aspect="equal", xlim=(-1.5, 1.5), ylim=(-0.25, 1.7))
    ax.axis("off")
    return figure, ax


def floor(ax, slope=0.0, color=INK, low=-1.45, high=1.45):
    """A floor with its hatching."""
    ax.plot([low, high], [low * slope, high * slope], color=color, lw=1.4)
    for x in np.arange(low + 0.1, high, 0.2):
        ax.plot([x, x - 0.09], [x * slope, x * slope - 0.11], color=color, lw=0.6)


def height(angle, a=A, b=B):
    """Height of an ellipse's middle above the floor that it touches."""
    return np.hypot(a * np.sin(angle), b * np.cos(angle))


def body(ax, x=0.0, angle=0.4, color=INK, ls="-", a=A, b=B, up=0.0, fill=True):
    """An ellipse that touches the floor; its middle and its contact point."""
    y = height(angle, a, b) + up
    face = "#e8edf2" if fill else "none"
    ax.add_patch(Ellipse((x, y), 2 * a, 2 * b, angle=np.degrees(angle), fc=face, ec=color, lw=1.2, ls=ls))
    touch = x - (a * a - b * b) * np.sin(angle) * np.cos(angle) / height(angle, a, b)
    return (x, y), (touch, up)


def arrow(ax, start, step, color=INK, label="", side=(0.06, 0.04), lw=1.6, ls="-"):
    """An arrow with a label beside its head."""
    end = (start[0] + step[0], start[1] + step[1])
    ax.add_patch(
        FancyArrowPatch(start, end, arrowstyle="-|>", mutation_scale=9, color=color, lw=lw, ls=ls, shrinkA=0, shrinkB=0)
    )
    if label:
        ax.text(end[0] + side[0], end[1] + side[1], label, color=color, fontsize=9)


def turn(ax, middle, radius, low, high, color=INK, label="", lw=1.6):
    """A spin: an arc with a head at its end."""
    ax.add_patch(Arc(middle, 2 * radius, 2 * radius, theta1=min(low, high), theta2=max(low, high), color=color, lw=lw))
    end, way = np.radians(high), np.sign(high - low)
    tip = np.array(middle) + radius * np.array([np.cos(end), np.sin(end)])
    step = 0.01 * way * np.array([-np.sin(end), np.cos(end)])
    arrow(ax, tip - step, step, color, lw=lw)
    if label:
        ax.text(tip[0] + 0.08, tip[1], label, color=color, fontsize=9)


def dot(ax, at, color=INK, label="", side=(0.07, 0.05)):
    """A point with a label."""
    ax.plot(*at, "o", color=color, ms=4)
    if label:
        ax.text(at[0] + side[0], at[1] + side[1], label, color=color, fontsize=9)


def curve(changed, across, up, law=0.55, low=0.0, high=1.0, more=()):
    """A coefficient over what it depends on: that of the law, and of the effect."""
    figure = Figure((2.6, 1.7))
    ax = figure.add_axes((0.12, 0.2, 0.84, 0.74))
    x = np.linspace(low, high, 200)
    ax.axhline(law, color=FAINT, lw=1.4)
    for other in more:
        ax.plot(x, other(x), color=EFFECT, lw=1.2, ls="--")
    ax.plot(x, changed(x), color=EFFECT, lw=2)
    ax.set(xlim=(low, high), ylim=(0.1, 1.0), xticks=[], yticks=[])
    ax.set_xlabel(across, fontsize=9)
    ax.set_ylabel(up, fontsize=10, rotation=0, labelpad=8)
    ax.spines[["top", "right"]].set_visible(False)
    return figure


def com_offset():
    figure, ax = blank()
    floor(ax)
    middle, touch = body(ax)
    dot(ax, middle, FAINT, "stated", (-0.62, 0.03))
    true = (middle[0] + 0.25, middle[1] + 0.12)
    dot(ax, true, EFFECT, "true")
    ax.plot(*zip(true, touch, strict=True), color=EFFECT, lw=1.2)
    ax.plot(*zip(middle, touch, strict=True), color=FAINT, lw=1, ls="--")
    return figure


def corner_radius():
    figure, ax = blank()
    floor(ax)
    square = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    c, s = np.cos(0.5), np.sin(0.5)
    turned = square @ np.array([[c, s], [-s, c]])
    lift = -turned[:, 1].min() - 0.1
    ax.add_patch(Polygon(turned + np.array([0, lift]), fc="none", ec=FAINT, lw=1.1, ls="--"))
    box = FancyBboxPatch(
        (-0.32, -0.32), 0.64, 0.64, boxstyle="round,pad=0.18,rounding_size=0.3", fc="#e8edf2", ec=EFFECT, lw=1.4
    )
    box.set_transform(mpl.transforms.Affine2D().rotate(0.5).translate(0, lift) + ax.transData)
    ax.add_patch(box)
    ax.text(0.45, 0.08, "ρ_c", color=EFFECT, fontsize=9)
    return figure


def inertia_error():
    figure, ax = blank()
    floor(ax)
    middle, _ = body(ax)
    for scale, color, ls in ((0.5, FAINT, "--"), (0.78, EFFECT, "-")):
        ax.add_patch(Ellipse(middle, 2 * A * scale, 2 * B * scale, angle=np.degrees(0.4), fc="none", ec=color, ls=ls))
    ax.text(middle[0] + 0.75, middle[1] + 0.35, "$I e^κ$", color=EFFECT, fontsize=9)
    return figure


def orientation_offset():
    figure, ax = blank()
    floor(ax)
    _, seen = body(ax, color=FAINT, ls="--", angle=0.1)
    _, true = body(ax, color=EFFECT, angle=0.45, fill=False)
    dot(ax, seen, FAINT)
    dot(ax, true, EFFECT)
    turn(ax, (0, 0.52), 1.0, 5, 27, EFFECT, "δ")
    return figure


def sampling_delay():
    figure, ax = blank()
    floor(ax)
    middle, _ = body(ax, x=-0.5, angle=1.0, up=0.35, color=FAINT, ls="--")
    now, touch = body(ax, x=0.35, angle=0.4, color=EFFECT, fill=False)
    arrow(ax, middle, (now[0] - middle[0], now[1] - middle[1]), EFFECT, "Δt v", (-0.35, 0.2))
    dot(ax, touch, EFFECT)
    ax.text(-1.4, 1.5, "last frame", color=FAINT, fontsize=8)
    return figure


def shape_error():
    figure, ax = blank()
    floor(ax)
    body(ax, color=FAINT, ls="--")
    _, touch = body(ax, color=EFFECT, a=0.9, b=0.45, fill=False)
    dot(ax, touch, EFFECT)
    return figure


def surface_tilt():
    figure, ax = blank()
    floor(ax, 0.12, EFFECT)
    ax.plot([-1.45, 1.45], [0, 0], color=FAINT, lw=1, ls="--")
    body(ax, up=0.03)
    ax.text(1.1, 0.0, "φ", color=EFFECT, fontsize=10)
    return figure


def by_body(of):
    figure, ax = blank()
    floor(ax)
    for x, color, share in ((-0.75, FAINT, 0.45), (0.75, EFFECT, 0.85)):
        ax.add_patch(Circle((x, 0.35), 0.35, fc="#e8edf2", ec=color, lw=1.4))
        arrow(ax, (x, 0.75), (0, share), color, of)
    ax.text(-0.95, 0.27, "oak", fontsize=8)
    ax.text(0.5, 0.27, "beech", fontsize=8)
    return figure


def body_dependent_friction():
    return by_body("μ")


def body_dependent_restitution():
    return by_body("ε")


def configuration_dependent_restitution():
    return curve(lambda x: 0.75 - 0.45 * x**2, "|r_x| / ρ", "ε", 0.75, more=[lambda x: 0.75 - 0.45 * x])


def covariate_dependent_restitution():
    return curve(lambda x: 0.75 - 0.3 * x, "a column of your own", "ε", 0.75, more=[lambda x: 0.75 - 0.3 * (x > 0.5)])


def incidence_dependent_friction():
    return curve(lambda x: 0.4 + 0.35 * x, "angle of incidence", "μ", 0.4, more=[lambda x: 0.4 + 0.3 * np.tanh(3 * x)])


def incidence_dependent_restitution():
    return curve(
        lambda x: 0.75 - 0.4 * x, "angle of incidence", "ε", 0.75, more=[lambda x: 0.75 - 0.35 * np.tanh(3 * x)]
    )


def load_dependent_friction():
    return curve(lambda x: 0.45 * (x / 0.5) ** -0.35, "approach speed |v_n|", "μ", 0.45, 0.1)


def over_place(of):
    return curve(lambda x: 0.5 + 0.2 * np.sin(5 * x) * (1 - 0.3 * x), "x along the floor", of, 0.5)


def location_dependent_friction():
    return over_place("μ")


def location_dependent_restitution():
    return over_place("ε")


def over_angle(of):
    spot = lambda x: 0.5 - 0.3 / (1 + ((x - 4) / 0.5) ** 4)  # noqa: E731
    figure = curve(lambda x: 0.5 + 0.15 * np.cos(x) + 0.07 * np.sin(2 * x), "θ", of, 0.5, 0, 2 * np.pi, [spot])
    figure.axes[0].set_xticks([0, np.pi, 6.0], ["0", "180°", "360°"], fontsize=7)
    figure.axes[0].tick_params(length=2, pad=1)
    figure.axes[0].xaxis.labelpad = -2
    return figure


def orientation_dependent_friction():
    return over_angle("μ")


def orientation_dependent_restitution():
    return over_angle("ε")


def orientation_dependent_moment():
    return over_angle("arm")


def parameter_drift():
    settling = lambda x: 0.5 + 0.3 * (1 - np.exp(-5 * x))  # noqa: E731
    return curve(lambda x: 0.5 + 0.3 * x, "number of the trial", "ε, μ", 0.5, more=[settling])


def slip_dependent_restitution():
    return curve(lambda x: 0.6 - 0.3 * x, "slip |v_t|", "ε", 0.6)


def velocity_dependent_friction():
    stribeck = lambda x: 0.35 + 0.4 * np.exp(-x / 0.15)  # noqa: E731
    return curve(lambda x: 0.35 + 0.35 * x, "slip |v_t|", "μ", 0.35, more=[stribeck])


def velocity_dependent_restitution():
    linear = lambda x: 0.75 - 0.4 * (x - 0.35)  # noqa: E731
    return curve(lambda x: 0.65 * (x / 0.5) ** -0.22, "approach speed |v_n|", "ε", 0.65, 0.08, more=[linear])


def adhesion():
    figure = curve(lambda x: np.maximum(0.1, 0.1 + 0.8 * x - 0.18), "rebound of the law", "v_n⁺", -1)
    figure.axes[0].plot([0, 1], [0.1, 0.9], color=FAINT, lw=1.4)
    return figure


def anisotropic_friction():
    figure, ax = blank()
    ax.set_ylim(-0.9, 1.1)
    ax.add_patch(Circle((0, 0.1), 0.7, fc="none", ec=FAINT, ls="--"))
    ax.add_patch(Ellipse((0, 0.1), 2.1, 1.0, angle=25, fc="#fdf0e6", ec=EFFECT, lw=1.4))
    arrow(ax, (0, 0.1), (0.55, 0.8), INK, "slip")
    arrow(ax, (0, 0.1), (-0.88, -0.5), EFFECT, "P_t", (-0.1, -0.25))
    return figure


def contact_duration():
    figure = curve(
        lambda x: 0.1 + 0.75 * np.maximum(0, np.sin(np.pi * (x - 0.1) / 0.7)) * (x < 0.8), "time", "force", -1
    )
    ax = figure.axes[0]
    ax.plot([0.45, 0.45], [0.1, 1.0], color=FAINT, lw=2)
    ax.annotate("", (0.1, 0.14), (0.8, 0.14), arrowprops={"arrowstyle": "<->", "color": EFFECT})
    ax.text(0.43, 0.19, "T", color=EFFECT, fontsize=9)
    return figure


def contact_patch():
    figure, ax = blank()
    floor(ax)
    middle, touch = body(ax, a=0.75, b=0.55)
    ax.add_patch(Rectangle((touch[0] - 0.35, -0.02), 0.7, 0.05, fc=EFFECT, ec="none"))
    arrow(ax, (touch[0] + 0.22, -0.2), (0, 0.85), EFFECT, "P_n")
    ax.plot([touch[0]] * 2, [-0.2, 0.1], color=INK, lw=1, ls=":")
    turn(ax, middle, 0.25, 20, 300, EFFECT, "τ")
    return figure


def directional_friction():
    figure, ax = blank()
    floor(ax)
    for x in np.arange(-1.35, 1.3, 0.16):
        ax.plot([x, x + 0.12, x + 0.12], [0, 0.08, 0], color=EFFECT, lw=1)
    for x, way, size in ((-0.75, 1, 0.35), (0.75, -1, 0.75)):
        ax.add_patch(Circle((x, 0.5), 0.4, fc="#e8edf2", ec=INK))
        arrow(ax, (x, 0.5), (0.5 * way, 0), INK, "slip", (-0.1, 0.1))
        arrow(ax, (x, 0.02), (-size * way, 0), EFFECT, "", lw=2)
    return figure


def rolling_resistance():
    figure, ax = blank()
    floor(ax)
    ax.add_patch(Circle((0, 0.6), 0.6, fc="#e8edf2", ec=INK, lw=1.2))
    turn(ax, (0, 0.6), 0.78, 150, 60, INK, "ω")
    arrow(ax, (0.2, -0.2), (0, 0.9), EFFECT, "P_n")
    ax.plot([0, 0], [-0.2, 0.6], color=FAINT, lw=1, ls=":")
    ax.text(0.05, 0.05, "c", color=EFFECT, fontsize=9)
    return figure


def spin_damping():
    figure, ax = blank()
    floor(ax)
    middle, _ = body(ax, x=-0.3, a=0.55, b=0.4, up=0.25)
    turn(ax, middle, 0.68, 5, 150, FAINT, "", 1.2)
    turn(ax, middle, 0.82, 5, 75, EFFECT, "(1 − c) ω⁺")
    return figure


def tangential_restitution():
    figure, ax = blank()
    floor(ax)
    _, touch = body(ax, angle=0.0, a=0.6, b=0.6)
    arrow(ax, (touch[0] - 1.15, 0.25), (0.65, 0), INK, "v_t", (-0.45, 0.08))
    arrow(ax, (touch[0] - 0.5, 0.12), (-0.45, 0), EFFECT, "v_t⁺", (-0.3, -0.05))
    x = np.linspace(0, 0.55, 60)
    ax.plot(0.35 + x, 0.12 + 0.06 * np.sin(34 * x), color=EFFECT, lw=1.2)
    return figure


def torsional_friction():
    figure, ax = blank()
    ax.set_ylim(-0.9, 1.1)
    ax.add_patch(Circle((0, 0.1), 0.8, fc="#e8edf2", ec=INK))
    ax.add_patch(Circle((0, 0.1), 0.3, fc="#fdf0e6", ec=EFFECT))
    turn(ax, (0, 0.1), 0.62, 10, 165, INK, "ω_n")
    turn(ax, (0, 0.1), 0.3, 130, 10, EFFECT, "τ_n")
    ax.text(-1.45, -0.8, "from above", fontsize=8, color=FAINT)
    return figure


def gravity_impulse():
    figure, ax = blank()
    floor(ax)
    body(ax, up=0.3)
    arrow(ax, (0, 0.8), (0, 0.75), FAINT, "v_y⁺")
    arrow(ax, (0.25, 0.8), (0, 0.45), EFFECT, "v_y⁺ − g Δt", (0.48, -0.1))
    return figure


def side_drag():
    figure, ax = blank()
    floor(ax)
    middle, _ = body(ax, x=-0.5, up=0.15)
    arrow(ax, middle, (1.3, 0.75), FAINT, "v⁺")
    arrow(ax, middle, (0.9, 0.52), EFFECT, "(1 − c) v⁺", (-0.05, -0.28))
    return figure


def axes():
    """World axes, the body's orientation θ, the contact point r, and the velocities."""
    figure, ax = blank(6.4, 3.5)
    ax.set_ylim(-0.2, 1.44)
    floor(ax)
    middle, touch = body(ax, angle=0.45)
    dot(ax, middle, INK, "centre of\nmass (x, y)", (0.06, -0.22))
    dot(ax, touch, EFFECT)
    arrow(ax, middle, (touch[0] - middle[0], touch[1] - middle[1]), EFFECT, "r = (r_x, r_y), r_y < 0", (0.62, 0.04))
    arrow(ax, (-1.4, 0.15), (0.4, 0), LAW, "x, tangent t", (-0.3, -0.12))
    arrow(ax, (-1.4, 0.15), (0, 0.4), LAW, "y, normal n", (-0.05, 0.05))
    ax.plot([middle[0], middle[0] + 1.05], [middle[1]] * 2, color=FAINT, lw=1, ls=":")
    end = (middle[0] + 1.05 * np.cos(0.45), middle[1] + 1.05 * np.sin(0.45))
    ax.plot(*zip(middle, end, strict=True), color=INK, lw=1, ls=":")
    turn(ax, middle, 0.9, 0, 25.8, INK, "θ", 1.2)
    ax.text(0.85, 0.42, "counter-clockwise", color=INK)
    arrow(ax, (middle[0] - 0.45, middle[1] + 0.65), (0.4, -0.6), LAW)
    ax.text(middle[0] - 0.8, middle[1] + 0.7, "v before", color=LAW)
    arrow(ax, middle, (0.42, 0.7), LAW, "v after")
    turn(ax, middle, 0.35, 160, 235, LAW, "", 1.4)
    ax.text(-0.45, middle[1] - 0.12, "ω", color=LAW)
    for text in ax.texts:
        text.set_fontsize(11)
    return figure


def how_it_works():
    """Five steps from top to bottom, and back up once an effect is added."""
    figure = Figure((6.4, 5.6))
    ax = figure.add_axes((0, 0, 1, 1))
    ax.set(xlim=(0, 64), ylim=(0, 56))
    ax.axis("off")
    steps = (
        ("Impacts", "a table, or recordings of a tracked body", LAW),
        ("Audit", "units, axes and geometry; no contact law needed", LAW),
        ("Model", "contact law + effects + learned residual + scatter", LAW),
        ("Diagnosis", "compared with impacts held out: which effects are missing?", EFFECT),
        ("Use it", "report, replay; C, JAX, ONNX, MuJoCo; next experiment", LAW),
    )
    for k, (head, words, color) in enumerate(steps):
        y = 46 - 11 * k
        shape = FancyBboxPatch((3, y), 50, 7, boxstyle="round,pad=0.4,rounding_size=1", fc="white", ec=color, lw=1.8)
        ax.add_patch(shape)
        ax.text(28, y + 5, head, ha="center", va="center", fontsize=14, fontweight="bold", color=color)
        ax.text(28, y + 1.7, words, ha="center", va="center", fontsize=11.5, color=INK)
        if k:
            arrow(ax, (28, y + 10.4), (0, -2.6), INK)
    ax.plot([53.6, 57.5, 57.5], [16.5, 16.5, 27.5], color=EFFECT, lw=1.8)
    arrow(ax, (57.5, 27.5), (-3.7, 0), EFFECT, lw=1.8)
    ax.text(59, 22, "add what is missing", rotation=90, va="center", fontsize=11.5, color=EFFECT)
    return figure


def reliability():
    """Shares of right names against the stated probability, with Wilson's intervals, of the table in its page."""
    text = (DOCS / "how-it-is-tested.md").read_text("utf-8")
    (row,) = re.findall(r"^\| \*\*all\*\* \|.*$", text, re.MULTILINE)
    high, low, *_ = re.findall(r"(\d+) of (\d+)\*\* \((\d+)–(\d+) %\)", row)
    figure = Figure((4.6, 3.2))
    ax = figure.add_axes((0.14, 0.17, 0.84, 0.8))
    ax.plot([0.45, 1], [0.45, 1], color=FAINT, lw=1)
    ax.text(0.47, 0.43, "stated = observed", color=FAINT, fontsize=9, rotation=37)
    for stated, found in ((0.7, low), (0.95, high)):
        right, n, start, end = map(int, found)
        ax.plot([stated, stated], [start / 100, end / 100], color=LAW, lw=1.6)
        ax.plot(stated, right / n, "o", color=LAW, ms=7)
        ax.text(stated - 0.02, right / n, f"{right} of {n}", color=LAW, fontsize=10, ha="right", va="center")
    ax.set(xlim=(0.45, 1.01), ylim=(0.4, 1.02), xlabel="stated probability of the name", ylabel="share of right names")
    ax.spines[["top", "right"]].set_visible(False)
    return figure


def case_study_ladder():
    """The ladder of the table in docs/case-study.md, in the colours of the report: physics, learned, noise."""
    text = (DOCS / "case-study.md").read_text("utf-8")
    rows = re.findall(
        r"^\| ([^|]+?) \| (0\.\d+) \[(0\.\d+), (0\.\d+)\] \|", text[text.index("| ladder |") :], re.MULTILINE
    )
    figure = Figure((7, 0.38 * len(rows) + 0.6))
    ax = figure.add_axes((0.46, 0.16, 0.5, 0.82))
    for k, (name, *numbers) in enumerate(rows):
        error, low, high = map(float, numbers)
        color = "#ebcb85" if "processes" in name else "#b1b1b1" if "noise" in name else "#8caac7"
        ax.barh(k, error, color=color, height=0.62, hatch="///" if "noise" in name else None, ec="white", lw=0)
        ax.plot([low, high], [k, k], color=INK, lw=1.6)
        ax.text(high + 0.003, k, f"{error:.3f}", va="center", fontsize=9)
    ax.set_yticks(range(len(rows)), [name for name, *_ in rows], fontsize=9)
    ax.invert_yaxis()
    ax.set(xlim=(0, 0.215), xlabel="Mass-weighted velocity error, held out")
    ax.spines[["top", "right"]].set_visible(False)
    return figure


EFFECTS = (
    com_offset, corner_radius, inertia_error, orientation_offset, sampling_delay, shape_error, surface_tilt,
    body_dependent_friction, body_dependent_restitution, configuration_dependent_restitution,
    covariate_dependent_restitution,
    incidence_dependent_friction, incidence_dependent_restitution, load_dependent_friction,
    location_dependent_friction, location_dependent_restitution, orientation_dependent_friction,
    orientation_dependent_restitution, parameter_drift, slip_dependent_restitution, velocity_dependent_friction,
    velocity_dependent_restitution, adhesion, anisotropic_friction, contact_duration, contact_patch,
    directional_friction, orientation_dependent_moment, rolling_resistance, spin_damping, tangential_restitution,
    torsional_friction, gravity_impulse, side_drag,
)  # fmt: skip


def typeset(figure):
    """The figure with subscripts in symbols such as v_n⁺."""
    for text in figure.findobj(Text):
        signs = re.sub(r"\b([^\W\d])_([a-z])(⁺?)", lambda m: f"${m[1]}_{m[2]}{'^+' if m[3] else ''}$", text.get_text())
        text.set_text(signs)
    return figure


if __name__ == "__main__":
    mpl.rcParams.update({"svg.hashsalt": "contactlearn", "font.family": "sans-serif", "svg.fonttype": "path"})
    (TARGET / "effects").mkdir(parents=True, exist_ok=True)
    for draw in (axes, how_it_works, reliability, case_study_ladder, *EFFECTS):
        folder = TARGET / "effects" if draw in EFFECTS else TARGET
        typeset(draw()).savefig(folder / f"{draw.__name__}.svg", metadata={"Date": None})
    print(len(EFFECTS) + 4, "drawings in", TARGET)
