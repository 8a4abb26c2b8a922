"""Write an effect and a law of your own.

An effect is a small class with one method, at one of four places; a law is a class with one closed form. Both are
then fitted, printed, searched for and plotted as those of the catalogue are. On the command line the same classes are
`+effect.cable._target_=cable_torque.CableTorque` and `law._target_=smooth_floor.SmoothFloor`.
"""

import inspect

import torch
from cable_torque import CableTorque
from pages import settings, show
from smooth_floor import SmoothFloor

import contactlearn as cl

chosen = settings(trials=300, torque=0.0002)

# A cable hangs off the body and twists it back while it is in contact. The class is complete: the formula, the
# parameter with its unit and plausible range, and the method.
print(inspect.getsource(CableTorque))

# A law is as short: from the contact, μ and ε to the two components of the impulse.
print(inspect.getsource(SmoothFloor))

# Drops on which the cable acts, and half of them held out.
drops = cl.simulation.synthetic.load(size=chosen.trials)
truth = cl.ContactModel(cl.laws.find("wang_mason").at(0.12, 0.55), effects={"cable": CableTorque(k=chosen.torque)})
noise = torch.randn(len(drops), 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
sigma = torch.tensor([0.01, 0.01, 0.5], dtype=torch.float64)
impacts = drops.replace(v_post=truth.predict(drops).v_post + sigma * noise)
pool, test = impacts.split(0.5, torch.Generator().manual_seed(0))

# The effect can also be a line of mathematics. Such lines are parsed and never executed as Python.
line = cl.effects.formula.effect.formula(tau="-k*sin(theta)", parameters={"k": [-0.001, 0.001]})

# Four models of these drops, fitted alike.
models = {
    "Smooth floor": (SmoothFloor(), {}),
    "Wang–Mason": ("wang_mason", {}),
    "+ cable torque": ("wang_mason", {"cable": CableTorque()}),
    "+ the same line": ("wang_mason", {"line": line}),
}
fits = {label: cl.fit(pool, law, effects) for label, (law, effects) in models.items()}
for label, fit in fits.items():
    print(f"{label}\n{fit.model}\n")
table = cl.compare({label: fit.model for label, fit in fits.items()}, test)
print(table)
show(cl.plot.comparison(table.sort_values("error", ascending=False)), chosen.out / "errors")

# The moment that is left without the effect, along the orientation, and the effect's own curve through it.
model = cl.fit(pool, "wang_mason", {"cable": CableTorque()}).model
left = cl.inference.evaluation.partial_residuals.partial_residuals(model, test, "cable")
show(cl.plot.effect_curve(left, "cable torque"), chosen.out / "cable")
