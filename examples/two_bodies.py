"""Compare two bodies.

Are two bodies made of the same stuff, as far as contact can tell? Their drops go into one table, with a column that
names the body, and each has its own shape. A law with its own restitution for each answers with a difference and its
standard error.
"""

import pandas as pd
import torch
from pages import settings, show

from contactlearn import laws
from contactlearn.data import table
from contactlearn.effects import find_effect
from contactlearn.inference.evaluation.metrics import bootstrap, mass_error
from contactlearn.inference.identification import joint
from contactlearn.report.figures.comparison import error_comparison
from contactlearn.simulation import synthetic

chosen = settings(trials=150, first=0.55, second=0.52)

# Two campaigns of synthetic drops, of a round and of a slender ellipse, under one law with the same friction; ε = 0.55
# and 0.52 unless the command line says otherwise.
shapes = {
    "oak": {"kind": "ellipse", "semi_axes": [0.035, 0.025]},
    "beech": {"kind": "ellipse", "semi_axes": [0.045, 0.018]},
}
frames = []
for seed, (body, eps) in enumerate({"oak": chosen.first, "beech": chosen.second}.items()):
    drops = synthetic.load(size=chosen.trials, eps=eps, shape=shapes[body], seed=seed)
    path = table.save(drops, chosen.out / f"{body}.csv")
    frames.append(
        pd.read_csv(path).assign(object=body, trial=lambda frame, body=body: body + frame["trial"].astype(str))
    )
pd.concat(frames).drop(columns="order").to_csv(chosen.out / "both.csv", index=False)
impacts = table.load(chosen.out / "both.csv", shape=shapes)
print(impacts)

# A model that treats both as one, and one with a restitution and a friction for each, are fitted to one half of the
# drops and judged on the other.
pool, test = impacts.split(0.5, torch.Generator().manual_seed(0))
effects = {name: find_effect(name)() for name in ("body_dependent_restitution", "body_dependent_friction")}
law, errors, intervals = laws.find("wang_mason"), {}, {}
for label, added in {"one for both": {}, "one for each": effects}.items():
    fit = joint.fit(pool, law, added)
    errors[label] = mass_error(test, fit.model.predict(test))
    intervals[label] = tuple(bootstrap(errors[label], torch.Generator().manual_seed(0), 1000))
    print(fit.model)
show(error_comparison(errors, intervals, "Mass error (–)"), chosen.out / "errors")

# The difference counts where it is several standard errors.
difference, error = (values[-2:].tolist() for values in (fit.values, fit.standard_errors))
for name, value, sigma in zip(("restitution", "friction"), difference, error, strict=True):
    print(f"{name}: Δ = {value:+.4f} ± {sigma:.4f}, {abs(value) / sigma:.1f} standard errors")
