"""Reproduce the figures of the paper.

The figures and Table 1 of Fazeli et al. (2017): on synthetic drops, whose truth is known (Wang and Mason's law, μ =
0.12, ε = 0.55), or with `--data=ellipse_drops` on the published ones, with the conventions of the authors' script.
"""

import torch
from pages import settings, show

import contactlearn as cl

plot, bounds, shared = cl.plot, cl.inference.evaluation.bounds, cl.inference.identification.shared
learning = cl.inference.learning.curves
chosen = settings(data="synthetic", trials=600, repetitions=20, size=120, seeds=3, largest=200)
published = chosen.data == "ellipse_drops"
load = cl.data.ellipse_drops.load if published else cl.simulation.synthetic.load
impacts = load(inertia="fazeli2017") if published else load(size=chosen.trials)
variant, target = ("fazeli2017", "least_squares") if published else ("textbook", "momentum")
box = shared.Box((0.0, 0.4), (0.2, 1.0)) if published else shared.Box()
generator = torch.Generator().manual_seed(0)
pool, test = impacts.split(0.25, generator)
print(impacts.source, len(pool), "drops to identify from,", len(test), "held out")

# Table 1: μ and ε of the six laws, mean and standard deviation over random subsets.
paper = {name: cl.laws.find(name, variant) for name in cl.laws.PAPER_LAWS}
table_1 = {
    "whittaker": ((0.111, 0.008), (0.484, 0.011)),
    "anitescu_potra_newton": ((0.084, 0.007), (0.547, 0.009)),
    "anitescu_potra_poisson": ((0.101, 0.007), (0.526, 0.008)),
    "drumwright_shell": ((0.081, 0.008), (0.516, 0.009)),
    "wang_mason": ((0.120, 0.008), (0.537, 0.010)),
    "mirtich": ((0.062, 0.009), (0.558, 0.010)),
}
options = {"generator": generator, "target": target, "box": box}
fits = {
    name: cl.fit_subsets(pool, law, sizes=(chosen.size,), repetitions=chosen.repetitions, **options)
    for name, law in paper.items()
}
for name, fit in fits.items():
    found = "   ".join(f"{mean:.3f} ± {std:.3f}" for mean, std in zip(fit.mean(), fit.std(), strict=True))
    printed = "   ".join(f"{mean:.3f} ± {std:.3f}" for mean, std in table_1[name])
    print(f"{cl.laws.find(name).label:<24} {found}" + (f"   published {printed}" if published else ""))

# Figure 2.3: the impulses that each law can give one drop, in its energy ellipse.
identified = {name: fit.to_law() for name, fit in fits.items()}
drop = cl.inference.evaluation.impulse_space.ImpulseSpace.of(test[[0]], identified, box, target=target)
show(plot.reachable_impulses(drop), chosen.out / "figure_2_3")

# Figures 3.3 and 3.4: the cost over (μ, ε), and how the parameters settle with the number of trials.
law = paper["whittaker"]
mu, eps = box.axes()
sample = pool[: chosen.size]
least = cl.fit_subsets(sample, law, sizes=(chosen.size,), repetitions=1, target=target, box=box)
cost = shared.cost_surface(law, sample, mu, eps, target=target)
show(plot.cost_map(mu, eps, cost, least.mean(), law, chosen.size), chosen.out / "figure_3_3")
sizes = [size for size in (5, 10, 20, 40, 80, 160, 320) if size <= len(pool)]
show(plot.convergence(cl.fit_subsets(pool, law, sizes=sizes, repetitions=10, **options)), chosen.out / "figure_3_4")

# Figure 3.5: held-out errors of the laws beside Best Post Hoc, the best of all laws drop by drop, and the bound that
# no rigid point contact beats.
norm = "euclidean" if published else "mass"
predictions = {name: cl.ContactModel(law).predict(test) for name, law in identified.items()}
best, _ = bounds.best_post_hoc(test, predictions, norm)
limits = {"best_post_hoc": best, "irb": bounds.irb(test, norm)}
name = "normalised_euclidean_error" if published else "mass_error"
metric, axis = cl.metrics.METRICS[name], cl.metrics.METRICS[name].axis
errors = {name: metric.error(test, outcome) for name, outcome in (predictions | limits).items()}
intervals = {name: tuple(cl.metrics.bootstrap(error, generator, 1000)) for name, error in errors.items()}
show(plot.error_comparison(errors, intervals, axis), chosen.out / "figure_3_5")

# Figure 3.6: μ and ε of every single drop.
law = paper["anitescu_potra_newton"]
show(plot.trial_parameters(cl.fit_trials(test, law, target=target, box=box), test, box=box), chosen.out / "figure_3_6")

# Figures 4.1 and 4.2: learned models, with and without a law under them, against the number of training drops.
law = paper["wang_mason"]
recipes = {
    "x1_impulse": cl.Recipe("x1", "impulse"),
    "residual_impulse": cl.Recipe("x1", "impulse", law),
    "parameters_identified": cl.Recipe("x1", "parameters_identified", law),
}
sizes = [size for size in (10, 20, 50, 100, 200, 450) if size <= min(chosen.largest, len(pool))]
orders = learning.nested_orders(len(pool), chosen.seeds, generator)
fit = cl.fit_subsets(pool, law, sizes=sizes, orders=orders, target=target, box=box)
bases = {law.name: {size: learning.law_at(fit, size) for size in sizes}}
curves = learning.learning_curves(recipes, pool, test, orders, sizes, bases, impulse=target, box=box)
densities = {model: curve.errors[name][-1].flatten() for model, curve in curves.items()}
show(plot.error_densities(densities | {bound: errors[bound] for bound in limits}, axis), chosen.out / "figure_4_1")
means = {
    model: torch.tensor([tuple(one) for one in curve.intervals(name, generator, 500)])
    for model, curve in curves.items()
}
show(plot.learning_curve(sizes, means, {bound: intervals[bound] for bound in limits}, axis), chosen.out / "figure_4_2")
