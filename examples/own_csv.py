"""Bring a CSV of your own.

A table with a row for each impact is enough, with your own names and units: state which column is which, the units, and
the sense in which angles are positive. The audit says what is wrong before anything is fitted.
"""

import math

import pandas as pd
from pages import settings, show

import contactlearn as cl

chosen = settings(trials=400)

# Here is such a file. Lengths are in mm, angles in degrees and positive clockwise, names its own. It has neither
# contact point nor moment of inertia. (It is made from synthetic drops, under Wang and Mason's law with μ = 0.12 and
# ε = 0.55.)
drops = cl.simulation.synthetic.load(size=chosen.trials)
frame = pd.DataFrame({"run": range(1, len(drops) + 1), "weight": 1e3 * drops.mass.numpy()})
for k, name in enumerate(("X", "Y", "angle")):
    unit = 1e3 if k < 2 else -180 / math.pi
    frame[name] = unit * drops.q[:, k].numpy()
    frame[f"{name}_speed"] = unit * drops.v_pre[:, k].numpy()
    frame[f"{name}_speed_after"] = unit * drops.v_post[:, k].numpy()
path = chosen.out / "drops.csv"
frame.to_csv(path, index=False)
print(frame.head(3).T.to_string(header=False))

# Names are mapped, ours first, and units stated. What the file lacks follows from the shape of the body.
columns = {"mass": "weight", "x": "X", "y": "Y", "theta": "angle", "inertia": None, "rx": None, "ry": None}
speeds = zip(("vx", "vy", "omega"), ("X", "Y", "angle"), strict=True)
columns |= {
    ours + end: f"{theirs}_speed{after}" for ours, theirs in speeds for end, after in (("", ""), ("_post", "_after"))
}
units = {"length": "mm", "mass": "g", "angle": "deg"}
shape = {"kind": "ellipse", "semi_axes": [0.035, 0.025]}

# Here the sense of rotation is missing. The audit finds that the moments do not balance. The data cannot tell clockwise
# angles from a mirrored x axis, the same experiment seen from behind. The audit proposes the latter; you know which it
# was.
wrong = cl.read_table(path, shape=shape, columns=columns, units=units, validate=False)
for finding in cl.audit(wrong):
    print(finding.sentence, "→ data.correct", finding.correction)

# Stated, the table is consistent. For commands `contactlearn init drops.csv` writes the same settings to a file.
impacts = cl.read_table(path, shape=shape, columns=columns, units=units | {"rotation": "clockwise"})
print(impacts)
for finding in cl.audit(impacts):
    print(finding.sentence)

# A law fits at once. A DataFrame would have done as well as a file: `cl.Impacts.from_frame(frame, shape=…)`.
fit = cl.fit(impacts, "wang_mason")
print(fit.summary())
print(f"mass error {fit.model.score(impacts, cl.metrics.mass_error):.4f}")
show(cl.plot.predictions(impacts, fit.model.predict(impacts)), chosen.out / "predictions")
