"""The figure of docs/case-study-bounces.md: held-out errors of table-tennis bounces against their angle of incidence.

    python benchmarks/accuracy/case_study_bounces.py racket_01.csv docs/bounces_region.png

Each bounce is predicted by models that were fitted to four fifths of the others.
"""

import sys
from pathlib import Path

import torch
from matplotlib.figure import Figure
from torch import Tensor

import contactlearn as cl
from contactlearn.effects import Effect, find_effect
from contactlearn.mechanics.impacts import Impacts

FOLDS, WINDOW = 5, 25  # bounces of a running median
MODELS: dict[str, tuple[str, str, dict[str, Effect]]] = {
    "Coulomb friction (Whittaker)": ("#9aa3ad", "whittaker", {}),
    "best law (Drumwright–Shell)": ("#1b5e9b", "drumwright_shell", {}),
    "Whittaker with tangential and\nspeed-dependent restitution": (
        "#d95f02",
        "whittaker",
        {
            "tangential_restitution": find_effect("tangential_restitution", "slip")(),
            "velocity_dependent_restitution": find_effect("velocity_dependent_restitution", "linear")(),
        },
    ),
}


def held_out(impacts: Impacts, law: str, effects: dict[str, Effect]) -> Tensor:
    """Errors [N] of bounces that the model was not fitted to."""
    fold = torch.randperm(len(impacts), generator=torch.Generator().manual_seed(0)) % FOLDS
    errors = torch.zeros(len(impacts), dtype=torch.float64)
    for k in range(FOLDS):
        rest, here = torch.nonzero(fold != k)[:, 0], torch.nonzero(fold == k)[:, 0]
        model = cl.fit(impacts[rest], law, effects).model
        errors[here] = cl.metrics.mass_error(impacts[here], model.predict(impacts[here]))
    return errors


def main(table: str, figure: str) -> None:
    """Print the mean errors, and draw those of all bounces."""
    impacts = cl.read_table(table, shape=cl.shapes.Disc(0.02))
    v_t, v_n = impacts.v_c.abs().unbind(-1)
    angle = torch.rad2deg(torch.atan2(v_t, v_n))
    order = angle.argsort()
    drawn = Figure((7, 4), layout="constrained")
    ax = drawn.add_subplot()
    for name, (color, law, effects) in MODELS.items():
        errors = held_out(impacts, law, effects)
        print(f"{errors.mean():.4f}  {name}".replace("\n", " "))
        median = errors[order].unfold(0, WINDOW, 1).median(-1).values
        ax.plot(angle, errors, ".", color=color, ms=3, alpha=0.5)
        ax.plot(angle[order][WINDOW // 2 : WINDOW // 2 + len(median)], median, color=color, lw=2, label=name)
    ax.set(xlabel="angle of incidence (°)", ylabel="mass error, held out", ylim=(0, 0.8))
    ax.legend(frameon=False)
    drawn.savefig(Path(figure), dpi=150)


if __name__ == "__main__":
    main(*sys.argv[1:])
