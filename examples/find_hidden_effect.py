"""Find a hidden effect.

Mystery drops are simulated impacts of an ellipse on a floor, with physics that no law of the catalogue has. The
simulation shares no law and no effect with the analysis. The diagnosis must name the missing effect, with a
probability.
"""

from pages import settings, show

import contactlearn as cl

chosen = settings(trials=300, seed=7, hidden="contact_patch,side_drag")
impacts, truth = cl.simulation.hidden_effects.draw(chosen.seed, size=chosen.trials, effects=chosen.hidden.split(","))
print(impacts)

# One call audits the measurements, compares the laws, finds where the best of them fails, and searches law and effects
# together. Everything it decides is held against trials that it was not fitted to.
found = cl.diagnose(impacts)
print(found)
print(found.equation)

# The ladder starts at the law alone. Each step adds an effect; the last two bars are what a flexible model can still
# learn, and the measurement noise.
show(cl.plot.ladder(found), chosen.out / "ladder")

# The law alone fails in these regions; with the missing effects the error is even.
if found.regions:
    show(cl.plot.regions(found), chosen.out / "regions")

# Now compare with the truth. The probability is calibrated: of names stated at 0.9, about nine in ten should be right.
hidden = {one["name"] for one in truth["effects"]}
print("hidden:", *sorted(hidden))
for one in found.missing:
    right = "hidden indeed" if one.effect.name in hidden else "not hidden"
    print(f"found:  {one.effect.name}, probability of the name {one.confidence:.2f}, {right}")
