"""The numbers of docs/case-study.md: the published drops diagnosed, and rigid against wrench models at each rung.

    python benchmarks/accuracy/case_study.py [--seed 0]

First the drops as published, under the best law; then a ladder of effects, one after the other, on the drops that the
diagnosis corrects, with the parameters of all.  On each rung Gaussian processes learn what the model leaves, from the
state (the paper's 10-D space), on 450 trials of each fold:

    rigid     (P_t, P_n), the impulse at the contact point that comes nearest to the outcome in the mass norm
    wrench    (P_t, P_n, τ), any outcome at all
    gain      mean of rigid − wrench, trial by trial, and its standard error

All errors are the mass error of trials held out, five folds; the IRB bound is the least that any impulse at the
measured contact point leaves.
"""

import argparse
import math
from collections.abc import Mapping

import torch
from torch import Tensor

from contactlearn import diagnose
from contactlearn.data import ellipse_drops
from contactlearn.diagnosis.options import DiagnoseOptions
from contactlearn.effects import Effect, find_effect
from contactlearn.inference.evaluation import bounds
from contactlearn.inference.evaluation.metrics import bootstrap, mass_error
from contactlearn.inference.identification import joint
from contactlearn.inference.identification.joint import Fit
from contactlearn.inference.validation import Folds
from contactlearn.laws import find
from contactlearn.mechanics import rigid_body
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.models.regressor import Regressor

TRIALS = 450
LADDER = (
    ("location_dependent_restitution", None), ("surface_tilt", None), ("contact_patch", None),
    ("parameter_drift", "friction"), ("sampling_delay", None), ("inertia_error", None),
    ("orientation_dependent_restitution", "spot"),
)  # fmt: skip
"""Effects and their forms."""


def rung(law: str, effects: Mapping[str, Effect], impacts: Impacts, folds: Folds) -> tuple[Fit, list[Tensor]]:
    """Fit, and held-out errors [N]: of a law with effects alone, with a learned impulse, and with a learned wrench."""
    fit = joint.fit(impacts, find(law), effects)
    base = joint.fit(impacts, find(law), effects, rows=folds.fitted, start=fit.values).model.predict(impacts)
    rows = folds.fitted[:, :TRIALS]
    body = impacts.mass, impacts.inertia, impacts.r
    left = impacts.v_post - base.v_post
    at_contact = rigid_body.contact_velocity(impacts.r, left)[..., None]
    impulse = (rigid_body.effective_inertia(impacts.W) @ at_contact)[..., 0]
    wrench = rigid_body.measured_wrench(*body, torch.zeros_like(left), left)
    errors = [folds.scores(mass_error(impacts, base))]
    for target in (impulse, wrench):
        values = target.gather(-2, rows[..., None].expand(-1, -1, target.shape[-1]))
        learned, _ = Regressor.fit("state", impacts, rows, values).predict(impacts)
        learned = torch.nn.functional.pad(learned, (0, 3 - learned.shape[-1]))
        changed = base.v_post + (rigid_body.velocity_per_wrench(*body) @ learned[..., None])[..., 0]
        errors.append(folds.scores(mass_error(impacts, Prediction(changed, base.wrench + learned))))
    return fit, errors


def line(name: str, errors: list[Tensor], bound: Tensor) -> str:
    generator = torch.Generator().manual_seed(0)
    alone, rigid, wrench = [error[error.isfinite()] for error in errors]
    _, low, high = bootstrap(alone, generator)
    gain = rigid - wrench
    return (
        f"| {name} | {alone.mean():.3f} [{low:.3f}, {high:.3f}] | {rigid.mean():.3f} | {wrench.mean():.3f} | "
        f"{gain.mean():+.4f} ± {gain.std() / math.sqrt(len(gain)):.4f} | {bound.mean():.3f} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0, help="of the folds")
    seed = parser.parse_args().seed
    torch.set_num_threads(1)
    published = ellipse_drops.load()
    found = diagnose(published, options=DiagnoseOptions(seed=seed))
    print(f"{found.equation}\n")
    print("| model | alone | + rigid | + wrench | rigid − wrench | IRB bound |\n|---|---|---|---|---|---|")
    for impacts in (published, found.record.impacts):
        folds = Folds.draw(len(impacts), torch.Generator().manual_seed(seed), repeats=1)
        bound = mass_error(impacts, bounds.irb(impacts, "mass"))
        frame = "as published" if impacts is published else "corrected"
        fit, errors = rung(found.law, {}, impacts, folds)
        print(line(f"{found.law}, {frame}", errors, bound), flush=True)
    effects = dict[str, Effect]()
    for name, form in LADDER:
        effects[name] = find_effect(name, form)()
        fit, errors = rung(found.law, effects, impacts, folds)
        print(line(f"+ {name}", errors, bound), flush=True)
    print()
    for parameter, value, error in zip(fit.parameters, fit.values.tolist(), fit.standard_errors.tolist(), strict=True):
        print(f"{parameter.name} = {value:.4g} ± {error:.2g} {parameter.unit}")


if __name__ == "__main__":
    main()
