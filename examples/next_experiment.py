"""Design the next experiment.

Few drops of one kind often suit two explanations. Here a simulator is the laboratory. In each round the drops that
separate two models best are measured, and the models are fitted again; as many usual drops are the
comparison.
"""

import torch
from matplotlib.figure import Figure
from pages import settings, show

import contactlearn as cl

experiment = cl.diagnosis.discrimination.experiment
chosen = settings(trials=24, rounds=4, drops=4, damping=0.015, seed=1)
law, shape = cl.laws.find("wang_mason"), cl.shapes.Ellipse((0.035, 0.025))
names = "spin_damping", "rolling_resistance"

# The laboratory: its contacts take spin away, which only it knows. It measures v with 0.01 m/s of noise, and ω with
# 0.5 rad/s.
damping = cl.effects.find_effect(names[0])().at([chosen.damping])
truth = cl.ContactModel(law.at(0.12, 0.55), effects={names[0]: damping})
generator = torch.Generator().manual_seed(chosen.seed)


def measured(drops):
    """The drops with their outcomes."""
    noise = torch.randn(len(drops), 3, generator=generator, dtype=torch.float64)
    return drops.replace(
        v_post=truth.predict(drops).v_post + noise * torch.tensor([0.01, 0.01, 0.5], dtype=torch.float64)
    )


def set_up(drops):
    """Proposed drops as states before impact, at the height where the body touches the floor."""
    theta = torch.tensor([drop.theta for drop in drops], dtype=torch.float64)
    v = torch.tensor([[drop.v_x, drop.v_y, drop.omega] for drop in drops], dtype=torch.float64)
    r = cl.shapes.contact_point(shape, theta)
    q = torch.stack((0 * theta + 0.3, -r[:, 1], theta), -1)
    mass = torch.full_like(theta, 0.0364)
    return cl.Impacts(
        mass=mass, inertia=mass * shape.gyration_squared(), r=r, q=q, v_pre=v, v_post=v, shape=shape, source="proposed"
    )


def joined(first, second):
    """Two sets of drops as one."""
    fields = ("mass", "inertia", "r", "q", "v_pre", "v_post")
    both = {name: torch.cat((getattr(first, name), getattr(second, name))) for name in fields}
    return cl.Impacts(**both, shape=shape, source="all drops so far")


# Both models are fitted to the same drops. They have equally many parameters, so the difference of their log
# likelihoods is the evidence, in nats: 3 are odds of 20 to 1.
def judged(impacts):
    """Evidence for the first model in nats, and both fitted models."""
    fits = [cl.fit(impacts, law, [name]) for name in names]
    return len(impacts) * (fits[1].loss - fits[0].loss).item(), [fit.model for fit in fits]


start = measured(cl.simulation.synthetic.load(size=chosen.trials, seed=chosen.seed))
usual = cl.simulation.synthetic.load(size=chosen.rounds * chosen.drops, seed=chosen.seed + 100)
print(f"after {len(start)} usual drops: {judged(start)[0]:+.1f} nats for {names[0]} against {names[1]}")

# Round by round, the next drops are chosen within the limits of the set-up.
limits = {"v_x": (-1.0, 1.0), "v_y": (-3.0, -1.0), "omega": (-20.0, 20.0)}
key = experiment.Substitution(cl.effects.EffectId(names[0], "after"), cl.effects.EffectId(names[1]))
designed, plain = start, start
evidence = {"designed": [judged(start)[0]], "usual": [judged(start)[0]]}
for number in range(chosen.rounds):
    _, (model, rival) = judged(designed)
    rivals, how = {key: rival}, {"generator": generator, "limits": limits, "count": chosen.drops}
    proposed = experiment.next_experiment(designed, model, rivals, **how)
    designed = joined(designed, measured(set_up(proposed.drops)))
    plain = joined(plain, measured(usual[slice(number * chosen.drops, (number + 1) * chosen.drops)]))
    first = proposed.drops[0]
    print(
        f"round {number + 1}: v_x = {first.v_x:+.2f} m/s, v_y = {first.v_y:+.2f} m/s, ω = {first.omega:+.1f} rad/s, … ",
        end="",
    )
    for label, impacts in {"designed": designed, "usual": plain}.items():
        evidence[label].append(judged(impacts)[0])
    print(f"{evidence['designed'][-1]:+.1f} nats; with as many usual drops {evidence['usual'][-1]:+.1f}")

# The ambiguity is the probability that is left for the wrong model, if both were equally likely at first.
with cl.plot.style.look():
    figure = Figure((cl.plot.style.COLUMN, 2.4), layout="constrained")
    axes = cl.plot.style.name_axes(figure.subplots(), "Further drops (–)", "Probability of the wrong model (–)")
    made = [chosen.drops * number for number in range(chosen.rounds + 1)]
    for (label, nats), color in zip(evidence.items(), cl.plot.style.CONTRAST, strict=False):
        axes.semilogy(
            made,
            torch.sigmoid(-torch.tensor(nats, dtype=torch.float64)),
            color=color,
            marker="o",
            label=f"{label} drops",
        )
    axes.legend()
show(figure, chosen.out / "ambiguity")
