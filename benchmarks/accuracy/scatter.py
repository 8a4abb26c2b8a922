"""Scatter of the contact, planted by an independent simulator: which components are found, and how large.

python benchmarks/accuracy/scatter.py [--half develop|fresh] [--sets N] [--trials N] [--space] [--workers N]
python benchmarks/accuracy/scatter.py --data FOLDER      cubes and squares, halves by toss and by recording

Half of the sets have no stated noise.  The law is fitted first, then the scatter is estimated around it.
"""

import argparse
import math
import sys
import warnings
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import torch

from contactlearn.data import tracks
from contactlearn.data.audit.corrections import correct
from contactlearn.diagnosis.unexplained.deviations import screen_deviations
from contactlearn.effects.velocity_dependent_restitution import LinearFallRestitution
from contactlearn.inference.identification.joint import fit
from contactlearn.inference.identification.scatter import Scatter, fit_scatter
from contactlearn.inference.learning.recipe import Recipe, learn
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import matvec
from contactlearn.models.contact_model import ContactModel

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from accuracy.scattered_impacts import World, simulated

PLANTED = {
    "restitution": {"sigma_eps": 0.05},
    "friction": {"sigma_mu": 0.04},
    "normal": {"sigma_normal": math.radians(1.5)},
    "contact_point": {"sigma_point": 0.001},
    "restitution + normal": {"sigma_eps": 0.04, "sigma_normal": math.radians(2)},
    "friction + contact_point": {"sigma_mu": 0.03, "sigma_point": 0.0008},
    "restitution + friction": {"sigma_eps": 0.06, "sigma_mu": 0.05},
    "all": {"sigma_eps": 0.04, "sigma_mu": 0.03, "sigma_normal": math.radians(1), "sigma_point": 0.0006},
    "restitution, effect": {"sigma_eps": 0.04, "speed_loss": 0.1},
    "normal, t(4)": {"sigma_normal": math.radians(1.5), "tails": 4},
    "restitution, outliers": {"sigma_eps": 0.05, "outliers": 0.03},
    "none": {},
    "none, effect": {"speed_loss": 0.1},
    "none, t(4)": {"tails": 4},
    "none, outliers": {"outliers": 0.03},
    "none, noisy": {"noise": 0.02},
}
NAMES = {
    "restitution": "sigma_eps",
    "friction": "sigma_mu",
    "normal": "sigma_normal",
    "contact_point": "sigma_point",
}
FRESH = 20_000  # seeds of the half that nothing was tuned on


def judged(kind: str, seed: int, *, space: bool, trials: int) -> tuple[str, bool, set[str], dict[str, float], str]:
    """Kind, whether noise is stated, names, ratios of found to planted standard deviations, and what is said."""
    torch.set_num_threads(1)
    planted = PLANTED[kind]
    generator = torch.Generator().manual_seed(seed)
    mu, eps, slip = (
        a + b * torch.rand(1, generator=generator).item() for a, b in ((0.12, 0.2), (0.35, 0.3), (1.0, 1.5))
    )
    world = World(space=space, mu=mu, eps=eps, slip=slip * (1.5 if space else 1), seed=seed, **planted)
    stated = seed % 2 == 0
    impacts = simulated(world, trials, stated=stated)
    effects = {"velocity_dependent_restitution": LinearFallRestitution()} if world.speed_loss else {}
    found = fit_scatter(impacts, fit(impacts, "wang_mason", effects).model)
    sizes = {name: found.model.scatter[name].sigma for name in found.names}
    ratios = {name: sizes[name] / getattr(world, NAMES[name]) for name in found.names if getattr(world, NAMES[name])}
    return kind, stated, set(found.names), ratios, repr(found).replace("\n", "; ")


def planted_sets(args: argparse.Namespace) -> None:
    """Print rates over planted sets."""
    first = FRESH if args.half == "fresh" else 0
    jobs = [(kind, first + 100 * k + s) for k, kind in enumerate(PLANTED) for s in range(args.sets)]
    ask = partial(judged, space=args.space, trials=args.trials)
    with ProcessPoolExecutor(args.workers) as pool:
        results = list(pool.map(ask, *zip(*jobs, strict=True)))
    for group in (True, False):
        some = [one for one in results if one[1] is group]
        right = invented = named = close = total = pure = 0
        for kind, _, names, ratios, said in some:
            wanted = {name for name, field in NAMES.items() if field in PLANTED[kind]}
            right += bool(wanted) and names == wanted
            named += bool(wanted)
            pure += not wanted
            invented += not wanted and bool(names)
            close += sum(abs(ratio - 1) <= 0.2 for ratio in ratios.values())
            total += len(ratios)
            if names != wanted or any(abs(ratio - 1) > 0.2 for ratio in ratios.values()):
                print(f"  {kind}: {said}; ratios {', '.join(f'{x:.2f}' for x in ratios.values())}")
        print(
            f"noise {'stated' if group else 'not stated'}: exactly the planted components {right} of {named}, standard "
            f"deviations within 20 % {close} of {total}, invented {invented} of {pure}",
            flush=True,
        )


def held_out(found: Scatter, impacts: Impacts) -> str:
    """Coverage of 95 % ellipsoids and intervals, and size of what is left, of impacts not fitted."""
    covariance, D = found.covariance(impacts), impacts.space.D
    error = impacts.v_post - found.model.base_prediction(impacts).v_post
    distance = (error * torch.linalg.solve(covariance, error[..., None])[..., 0]).sum(-1)
    inside = (error.abs() < 1.96 * covariance.diagonal(dim1=-2, dim2=-1).sqrt()).double().mean(0)
    radius = {3: 7.815, 6: 12.592}[D]
    ordinary = distance[distance < 4 * radius]
    size = (found.inflation * ordinary.mean() / D).sqrt()  # in units of instrument and scatter, not inflated
    return (
        f"95 % ellipsoids hold {(distance < radius).double().mean():.1%} of {len(impacts)}, components "
        f"{', '.join(f'{x:.1%}' for x in inside.tolist())}; left in units of instrument and scatter {size:.2f}, "
        f"inflation {found.inflation:.2f}"
    )


def densities(found: Scatter, processes: ContactModel, impacts: Impacts) -> str:
    """Negative log densities of impacts not fitted, by scatter with its mixture and by processes on the residual."""
    covariance = found.covariance(impacts) / found.inflation
    error, seen = impacts.v_post - found.model.base_prediction(impacts).v_post, processes.predict(impacts)
    distance = (error * torch.linalg.solve(covariance, error[..., None])[..., 0]).sum(-1)
    mixture = found.mixture.log_density(distance, impacts.space.D).logsumexp(-1)
    own = 0.5 * torch.linalg.slogdet(covariance).logabsdet - mixture
    missed = impacts.v_post - seen.v_post
    away = (missed * torch.linalg.solve(seen.covariance, missed[..., None])[..., 0]).sum(-1)
    volume = torch.linalg.slogdet(seen.covariance).logabsdet + impacts.space.D * math.log(2 * math.pi)
    less = own - 0.5 * (away + volume)
    return (
        f"negative log density {own.mean():.2f}, of processes {0.5 * (away + volume).mean():.2f}; "
        f"difference {less.mean():+.2f} ± {less.std() / math.sqrt(len(less)):.2f}"
    )


def measured_sets(folder: Path) -> None:
    """Print what is found on halves of the cubes and squares, and how it holds on the other halves."""
    cube = {"kind": "cuboid", "half": [0.0524] * 3}
    square = {"kind": "polygon", "vertices": [[-0.03, -0.03], [0.03, -0.03], [0.03, 0.03], [-0.03, 0.03]]}
    columns = {"position": ["x", "z"], "angle": "th", "recording": "recording"}
    cubes = tracks.load(path=folder / "cube_tosses/tosses.parquet", mass=0.37, shape=cube, inertia=8.1e-4)
    drops = folder / "square_drops/recordings.parquet"
    squares = tracks.load(path=drops, mass=0.0485, shape=square, rate=250, columns=columns)
    cubes, squares = correct(cubes, ["rig"]), correct(squares, ["rig", "drop_outliers"])
    speed = "velocity_dependent_restitution"
    for name, impacts, law, effects in (
        ("cubes", cubes, "mirtich", ()),
        ("cubes", cubes, "mirtich", (speed, "configuration_dependent_restitution")),
        ("squares", squares, "wang_mason_newton", ()),
        ("squares", squares, "wang_mason_newton", (speed, "tangential_restitution")),
    ):
        number = torch.tensor([int(trial.split("#")[0]) for trial in impacts.trial])
        for half in (0, 1):
            fitted, rest = impacts[number % 2 == half], impacts[number % 2 != half]
            model = fit(fitted, law, effects).model
            found = fit_scatter(fitted, model)
            learned = learn(fitted, Recipe("state", "wrench", model.law), base=model)
            print(densities(found, learned, rest))
            print(f"{name}, half {half}, {len(fitted)} impacts, {found.model}\n{found}\n  {held_out(found, rest)}")
            print(f"  ΔBIC {found.bic:.0f}; instrument alone: {left(found, rest):.2f} of its units are left")
            for one in screen_deviations(found, fitted):
                share = math.nan if one.share is None else one.share
                print(f"  {one.component} depends on {one.variable}: {share:.0%} of its deviations", flush=True)


def left(found: Scatter, impacts: Impacts) -> float:
    """Root mean square of errors in units of the instrument."""
    error = impacts.v_post - found.model.base_prediction(impacts).v_post
    inverse = torch.linalg.inv(found.instrument(impacts))
    return (error * matvec(inverse, error)).sum(-1).mean().div(impacts.space.D).sqrt().item()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--half", choices=("develop", "fresh"), default="develop")
    parser.add_argument("--sets", type=int, default=4, help="of each kind")
    parser.add_argument("--trials", type=int, default=300)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--space", action="store_true")
    parser.add_argument("--data", type=Path)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    if given.data:
        measured_sets(given.data)
    else:
        planted_sets(given)
