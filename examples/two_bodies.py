"""Compare two bodies.

Are two bodies made of the same stuff, as far as contact can tell? Their drops go into one table, with a column that
names the body, and each has its own shape. A law with its own restitution for each answers with a difference and its
standard error.
"""

import pandas as pd
from pages import settings, show

import contactlearn as cl

chosen = settings(trials=150, first=0.55, second=0.52)

# Two campaigns of synthetic drops, of a round and of a slender ellipse, under one law with the same friction; ε = 0.55
# and 0.52 unless the command line says otherwise.
shapes = {
    "oak": {"kind": "ellipse", "semi_axes": [0.035, 0.025]},
    "beech": {"kind": "ellipse", "semi_axes": [0.045, 0.018]},
}
frames = []
for seed, (body, eps) in enumerate({"oak": chosen.first, "beech": chosen.second}.items()):
    drops = cl.simulation.synthetic.load(size=chosen.trials, eps=eps, shape=shapes[body], seed=seed)
    frame = drops.to_frame().drop(columns="order")
    frames.append(frame.assign(object=body, trial=body + frame["trial"]))
impacts = cl.Impacts.from_frame(pd.concat(frames), shape=shapes)
print(impacts)

# A model that treats both as one, and one with a restitution and a friction for each, are fitted to one half of the
# drops and judged on the other.
pool, test = impacts.split(0.5)
effects = ["body_dependent_restitution", "body_dependent_friction"]
one_for_both, fit = cl.fit(pool, "wang_mason"), cl.fit(pool, "wang_mason", effects)
print(fit.summary())
table = cl.compare({"one for both": one_for_both.model, "one for each": fit.model}, test)
print(table)
show(cl.plot.comparison(table), chosen.out / "errors")

# The difference counts where it is several standard errors.
difference, error = (values[-2:].tolist() for values in (fit.values, fit.standard_errors))
for name, value, sigma in zip(("restitution", "friction"), difference, error, strict=True):
    print(f"{name}: Δ = {value:+.4f} ± {sigma:.4f}, {abs(value) / sigma:.1f} standard errors")
