"""From tracks to a named effect.

A motion tracker gives poses over time, and no impacts. The impacts between free flights are found, with the
covariance of each velocity; what is no impact is refused with its reason. Then the diagnosis names the effect that is
missing.
"""

from collections import Counter

from pages import settings, show

import contactlearn as cl

recordings = cl.simulation.recordings
chosen = settings(recordings=100, damping=0.15)

# Recordings of an ellipse that is thrown onto a floor, two seconds each at 250 frames a second, a CSV file each. In
# their simulation contact takes spin away, τ = −c I ω⁺.
effect = cl.effects.find_effect("spin_damping")().at([chosen.damping])
takes, truth = recordings.simulate(chosen.recordings, effects={"spin_damping": effect}, seed=3)
folder = chosen.out / "takes"
recordings.write_recordings(takes, folder)

# Length unit and axes are found from gravity. Unit and sense of the angles would follow from the moment balance, which
# contacts that take spin away leave open, so they are stated beside mass and shape.
shape = {"kind": "ellipse", "semi_axes": list(recordings.SEMI_AXES)}
found = cl.read_recordings(folder, mass=recordings.MASS, shape=shape, angle="rad", sense="as_read")
print(f"{len(found.impacts)} impacts of {len(truth.time)} true contacts; refused:")
for reason, count in Counter(str(refusal.reason) for refusal in found.survey.refusals).most_common():
    print(f"  {count:4d} {reason}")

# One of the contacts: both flights, what they leave, and the body there.
contact = found.survey.contacts[0]
(recording,) = found.reload([contact.recording])
show(cl.plot.contact(recording, contact, found.shape), chosen.out / "contact")

# The covariances of the impacts are the noise of every fit.
diagnosis = cl.diagnose(found.impacts)
print(diagnosis)
print(diagnosis.equation)
for one in diagnosis.missing:
    print(f"{one.effect}: probability of the name {one.confidence:.2f}")
show(cl.plot.ladder(diagnosis), chosen.out / "ladder")
