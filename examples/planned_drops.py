"""Plan the drops, and when to stop.

A rig drops a body from heights up to half a metre, at any angle, with a spin. The laboratory is a simulator that hides
one to three effects. Plan, measure, diagnose and plan again, until the plan says to stop.
"""

import torch
from matplotlib.figure import Figure
from pages import settings, show

import contactlearn as cl

chosen = settings(seed=7, batch=20, budget=160)

# The rig: heights to 2 mm, angles to 2°, spins to a tenth. Where on the floor the body lands comes by chance.
rig = cl.Rig(
    limits={
        "height": cl.Limits(low=0.05, high=0.5, precision=0.002),
        "theta": cl.Limits(low=-torch.pi, high=torch.pi, precision=0.035),
        "omega": cl.Limits(low=-30, high=30, share=0.1),
        "x": cl.Limits(low=0.08, high=0.5, settable=False),
    }
)
laboratory = cl.simulation.hidden_effects.drops.Laboratory.of(chosen.seed)
body = cl.Specimen(mass=laboratory.mass, inertia=laboratory.inertia, shape=laboratory.shape, name="ellipse")

# Before anything is measured, drops are spread, and chosen so that all effects of the catalogue show, each by itself.
plan = cl.plan(body, rig, count=chosen.batch, budget=chosen.budget)
print(f"{len(plan.drops)} drops; no drop within these limits shows {', '.join(plan.hidden)}")

# Then the loop runs by itself.
generator, drops = torch.Generator().manual_seed(chosen.seed), []
while plan.stop is None:
    made = cl.planning.measurement.carry_out(
        cl.Rig(limits=plan.rig), plan.drops, [body], laboratory,
        generator=generator, first=1 + sum(map(len, drops)),
    )  # fmt: skip
    drops.append(made)
    found = cl.diagnose(cl.data.blocks.joined(drops))
    plan = cl.plan(found, rig, count=chosen.batch, budget=chosen.budget, looks=plan.looks)
    best = plan.possibilities[0]
    print(
        f"{plan.looks[-1].trials} drops: {', '.join(best.effects) or 'nothing'} with probability {best.probability:.2f}"
    )
print(f"stop: {plan.stop}; found {', '.join(plan.looks[-1].found) or 'nothing'}")

# The last plan, which need not be carried out, among all that was measured.
show(cl.plot.planned(plan, cl.planning.rig.settings_of(found.record.impacts)), chosen.out / "plan")

# How sure the tool was of each name, over the drops.
with cl.plot.style.look():
    figure = Figure((cl.plot.style.COLUMN, 2.2), layout="constrained")
    axes = cl.plot.style.name_axes(figure.subplots(), "Drops (–)", "Names found and probable (–)")
    trials = [look.trials for look in plan.looks]
    for names, marker, color in (
        ("found", "o-", cl.plot.style.CONTRAST[0]),
        ("probable", "s--", cl.plot.style.CONTRAST[2]),
    ):
        axes.plot(trials, [len(getattr(look, names)) for look in plan.looks], marker, color=color, label=names)
    axes.legend()
show(figure, chosen.out / "looks")
