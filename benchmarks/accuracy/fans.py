"""Do fans of replays hold what was recorded?  Cubes and squares of which no fit has seen the recordings.

    python benchmarks/accuracy/fans.py cubes|squares [--every 1] [--figures FOLDER]

Law, effects and scatter are estimated from the impacts of recordings of even number, after the correction `rig`, in
CONTACTLEARN_DATA.  Those of odd number are followed from their first flight to the contact after the third bounce.
Given are the shares of recorded positions within the 90 % bands, and 95 % intervals by recordings: of all, and of those
without an impact that the audit drops as a gross outlier, such as one on two corners.  The rival has no scatter: its
bands have the errors of the first flight and of the floor's height and the noise of the frames alone.
"""

import argparse
import re
import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import torch
from torch import Tensor

from contactlearn.cli.commands.impacts import find_recorded
from contactlearn.cli.hydra_main import compose
from contactlearn.cli.settings import SourceSettings
from contactlearn.data.audit.corrections import correct
from contactlearn.inference.evaluation.impulse_space import ScatterCloud
from contactlearn.inference.evaluation.replay import BOUNCES, Replay, coverage, replays
from contactlearn.inference.identification.joint import fit
from contactlearn.inference.identification.scatter import Scatter, fit_scatter
from contactlearn.mechanics.impacts import Impacts
from contactlearn.models.contact_model import ContactModel
from contactlearn.report.figures.impulse_space import scattered_impulses
from contactlearn.report.figures.replays import fan_figure
from contactlearn.report.figures.style import save

SQUARE = [
    *("data=tracks", "data.path=${oc.env:CONTACTLEARN_DATA}/square_drops/recordings.parquet", "data.mass=0.0485"),
    "data.shape={kind:polygon,vertices:[[-0.03,-0.03],[0.03,-0.03],[0.03,0.03],[-0.03,0.03]]}",
    *("data.columns={position:[x,z],angle:th,recording:recording}", "data.rate=250"),
]
SPEED = "velocity_dependent_restitution"
CASES = {
    "cubes": (["data=cube_tosses"], ["rig"], "mirtich", (SPEED, "configuration_dependent_restitution")),
    "squares": (SQUARE, ["rig", "drop_outliers"], "wang_mason_newton", (SPEED, "tangential_restitution")),
}
"""Configuration, corrections, law and effects."""
RESAMPLES = 1000


def interval(shown: Sequence[Replay], model: str) -> str:
    """Coverage after each bounce and over all, with 95 % intervals by recordings."""
    inside = [one.inside(model).double().mean(-1) for one in shown]
    sums = torch.zeros(len(shown), BOUNCES, 2, dtype=torch.float64)
    for row, (one, held) in zip(sums, zip(shown, inside, strict=True), strict=True):
        for k in range(BOUNCES):
            here = one.bounces[: len(held)] == k + 1
            row[k, 0], row[k, 1] = held[here].sum(), here.sum()
    sums = torch.cat((sums, sums.sum(1, keepdim=True)), 1)
    drawn = torch.randint(len(shown), (RESAMPLES, len(shown)), generator=torch.Generator().manual_seed(0))

    def share(parts: Tensor) -> Tensor:
        return parts[..., 0] / parts[..., 1]

    low, high = share(sums[drawn].sum(1)).nanquantile(torch.tensor([0.025, 0.975], dtype=torch.float64), 0)
    cells = zip(share(sums.sum(0)).tolist(), low.tolist(), high.tolist(), strict=True)
    return " | ".join(f"{x:.1%} [{a:.1%}, {b:.1%}]" for x, a, b in cells)


def with_noise(scatter: Scatter, impacts: Impacts) -> ContactModel:
    """The model with the mean noise of the instrument."""
    turned = impacts.slip_axes.mT @ scatter.instrument(impacts) @ impacts.slip_axes
    return replace(scatter.model, noise=turned.mean(0))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bodies", choices=CASES)
    parser.add_argument("--every", type=int, default=1, help="of the recordings of odd number that is followed")
    parser.add_argument("--figures", type=Path, help="folder for the fan of the median recording and the impulse plane")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    words, corrections, law, effects = CASES[given.bodies]
    found = find_recorded(SourceSettings.from_config(compose("diagnose", words)))
    impacts = correct(found.impacts, corrections)
    number = torch.tensor([int(re.findall(r"\d+", trial.rpartition("#")[0])[-1]) for trial in impacts.trial])
    fitted = impacts[number % 2 == 0]
    scatter = fit_scatter(fitted, fit(fitted, law, effects).model)
    print(f"{len(fitted)} impacts: {scatter.model}\n{scatter}")
    still = {name: replace(one, sigma=0.0) for name, one in scatter.model.scatter.items()}
    models = {"scatter": scatter.model, "none": replace(scatter.model, scatter=still)}
    names = sorted({contact.recording for contact in found.survey.contacts})
    odd = [name for name in names if int(re.findall(r"\d+", name)[-1]) % 2]
    kept = set(odd[:: given.every])
    shown = replays(models, found, [corrections[0]], without={*names} - kept)
    print(f"{len(shown)} of {len(odd)} recordings; {BOUNCES} bounces and all")
    dropped = {trial.rpartition("#")[0] for trial in {*found.impacts.trial} - {*impacts.trial}}
    regular = [one for one in shown if one.recording not in dropped]
    for name in models:
        assert torch.isfinite(coverage(shown, name)).all()
        print(f"| {given.bodies}, {name}, {len(shown)} | {interval(shown, name)} |")
        if dropped:
            print(f"| without outliers, {len(regular)} | {interval(regular, name)} |")
    if given.figures:
        middle = sorted(shown, key=lambda one: one.inside("scatter").double().mean().item())[len(shown) // 2]
        save(fan_figure(shown, middle, "scatter"), given.figures, f"fan_{given.bodies}")
        clouds = ScatterCloud.along(with_noise(scatter, fitted), impacts[number % 2 == 1])
        save(scattered_impulses(clouds), given.figures, f"impulses_{given.bodies}")


if __name__ == "__main__":
    main()
