"""Transfer to other bodies.

Is a model of one body any good on another one, and does it save trials there? The paper ends with these two
questions. The law under the model is wrong on purpose, so that there is something to learn.
"""

import torch
from pages import settings, show

import contactlearn as cl

chosen = settings(trials=150, seeds=4)
bodies = {
    "slender ellipse": {"kind": "ellipse", "semi_axes": [0.045, 0.018]},
    "triangle": {"kind": "polygon", "vertices": [[0.034, 0.0], [-0.017, 0.0294448], [-0.017, -0.0294448]]},
}

# Drops of an ellipse to learn from, and of two other bodies, half of them held out.
generator = torch.Generator().manual_seed(0)
source = cl.simulation.synthetic.load(size=chosen.trials)
others = {
    name: cl.simulation.synthetic.load(size=2 * chosen.trials, shape=shape, seed=seed).split(0.5, generator)
    for seed, (name, shape) in enumerate(bodies.items(), 1)
}

# Drumwright and Shell's law with Gaussian processes on its residual wrench: as it is on the other body; with processes
# on its own residual there; and learnt from that body's trials alone.
recipe = cl.Recipe("x1", "wrench", cl.laws.find("drumwright_shell"))
sizes = [size for size in (5, 10, 20, 50, 100) if size <= chosen.trials]
model, curves = cl.inference.learning.curves.transfer_curves(recipe, source, others, sizes, chosen.seeds, generator)

# The trained model is worth trials of the new body as long as its curve lies below that from scratch.
ways = {"scratch": "From scratch", "prior": "Trained model as prior"}
means = {
    body: {
        label: torch.tensor([tuple(one) for one in found[way].intervals("mass_error", generator, 500)])
        for way, label in ways.items()
    }
    for body, found in curves.items()
}
zero_shot = {
    body: tuple(found["zero_shot"].intervals("mass_error", generator, 500)[0]) for body, found in curves.items()
}
print(f"{'trials':>40}" + "".join(f"{size:>8}" for size in sizes))
for body, by_way in means.items():
    print(f"{body + ', no trial of it':<40}{zero_shot[body][0]:8.3f}")
    for label, rows in by_way.items():
        print(f"{body + ', ' + label.lower():<40}" + "".join(f"{mean:8.3f}" for mean in rows[:, 0].tolist()))
show(cl.plot.transfer_errors(sizes, means, zero_shot, "Mass error (–)"), chosen.out / "transfer")
