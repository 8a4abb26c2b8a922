"""Is one impact in MuJoCo that of the exported model?

    python benchmarks/accuracy/export_mujoco.py

Laws and effects are fitted to some recordings and exported; the states of others are put into the scene.  Recordings
lie in CONTACTLEARN_DATA.  A line has the mean mass error of MuJoCo's outcome against the model's, of both against the
measurement, the change with half the step and contact time, and as a control the error with MuJoCo's default impedance.
"""

import argparse
from dataclasses import replace

import torch

from contactlearn.cli.commands.impacts import find_recorded
from contactlearn.cli.hydra_main import compose
from contactlearn.cli.settings import SourceSettings
from contactlearn.data import ellipse_drops
from contactlearn.data.audit.corrections import correct
from contactlearn.effects import State, find_effect
from contactlearn.inference.identification import joint
from contactlearn.laws.spring_dashpot import LEAST
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.shapes import contact_point
from contactlearn.models.contact_model import actual_coefficients, actual_state
from contactlearn.models.export.mujoco import Scene, difference, export
from contactlearn.simulation.mujoco import outcomes

LAWS = ("whittaker", "anitescu_potra_poisson", "drumwright_shell", "wang_mason", "wang_mason_newton", "mirtich")
EFFECTS = (
    *((name,) for name in ("com_offset", "inertia_error", "surface_tilt", "orientation_offset", "shape_error")),
    *((name,) for name in ("velocity_dependent_restitution", "load_dependent_friction")),
    ("com_offset", "inertia_error", "velocity_dependent_restitution"),
)
FOUND = ("com_offset", "corner_radius", "inertia_error")  # of the cube: docs/case-study-cubes.md


def halves(impacts: Impacts) -> tuple[Impacts, Impacts]:
    """Impacts to fit, and at most 300 of other recordings."""
    pool, test = impacts.split(0.6 if len(impacts) < 1000 else 0.25, torch.Generator().manual_seed(0))
    return pool[:400], test[:300]


def usual(scene: Scene) -> str:
    """The scene with MuJoCo's default impedance, cone and friction."""
    text = scene.xml().replace('solimp="0.005 0.005 1"', "").replace("elliptic", "pyramidal")
    return text.replace('impratio="1e5"', "")


def judge(law: str, names: tuple[str, ...], pool: Impacts, test: Impacts) -> str:
    """Fit, export, and compare one impact."""
    effects = {name: find_effect(name)().prepare(pool) for name in names}
    model = joint.fit(pool, law, effects).model
    if model.law.coefficients[1].item() < LEAST:
        return f"| {'+'.join((law, *names))} | refused: ε = {model.law.coefficients[1].item():.3f} |"
    scene, hook = export(model, test)
    coefficients = None
    if hook is not None:
        state = actual_state(model.effects, State.of(test))
        coefficients = actual_coefficients(model.effects, state, *model.law.coefficients)
    expected, found = model.predict(test).v_post, outcomes(scene, test, coefficients)
    half = outcomes(replace(scene, contact_time=scene.contact_time / 2), test, coefficients)
    control = outcomes(scene, test, xml=usual(scene)) if hook is None else torch.full_like(found, torch.nan)

    def apart(one: torch.Tensor, other: torch.Tensor) -> float:
        ended = (one.isfinite() & other.isfinite()).all(-1)
        return difference(one[ended], other[ended], test[ended]) if ended.any() else float("nan")

    numbers = apart(expected, found), apart(test.v_post, found), apart(test.v_post, expected), apart(found, half)
    cells = " | ".join(f"{x:.2%}" for x in (*numbers, apart(expected, control)))
    return f"| {'+'.join((law, *names))} | {int(found.isfinite().all(-1).sum())}/{len(test)} | {cells} |"


def main() -> None:
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    drops = correct(ellipse_drops.load(), ["mirrored_x"])
    drops = drops.replace(r=contact_point(drops.shape, drops.q[:, 2]), validate=False)
    cubes = find_recorded(SourceSettings.from_config(compose("diagnose", ["data=cube_tosses"]))).impacts
    sources = {"cube tosses": cubes, "ellipse drops": drops}
    for name, impacts in sources.items():
        pool, test = halves(impacts[impacts.v_c[:, -1] < -0.05].replace(validate=True))
        print(f"{name}: {len(pool)} to fit, {len(test)} held out")
        print("| model | single contacts | MuJoCo to model | MuJoCo to data | model to data | halved | default |")
        cases = [(law, ()) for law in LAWS] + [("wang_mason", names) for names in EFFECTS]
        cases += [("wang_mason", FOUND)] if impacts.space.d == 3 else [("spring_dashpot", ())]
        for law, names in cases:
            print(judge(law, names, pool, test), flush=True)


if __name__ == "__main__":
    main()
