"""A GPU gives what the CPU gives, for everything that computes where its impacts lie; needs a GPU."""

from dataclasses import fields, is_dataclass, replace

import pytest
import torch
from commands import run
from torch import Tensor

from contactlearn import laws
from contactlearn.core import devices
from contactlearn.core.devices import moved
from contactlearn.core.errors import DataError
from contactlearn.effects import State, catalogue, find_effect
from contactlearn.inference.evaluation import bounds, metrics
from contactlearn.inference.evaluation.metrics import ErrorSums
from contactlearn.inference.evaluation.partial_residuals import changes, partial_residuals
from contactlearn.inference.identification import joint
from contactlearn.inference.identification.joint import FitOptions, assemble, linearise
from contactlearn.inference.identification.per_trial import fit_trials
from contactlearn.inference.identification.shared import Box, cost_surface, fit_subsets
from contactlearn.inference.learning.curves import (
    joint_curve,
    law_at,
    law_curves,
    learning_curves,
    nested_orders,
    transfer_curves,
)
from contactlearn.inference.learning.recipe import Recipe, learn
from contactlearn.mechanics.shapes import Polygon
from contactlearn.mechanics.space import PLANE
from contactlearn.models import checkpoint, regressor
from contactlearn.models.contact_model import ContactModel, linearised, resolve
from contactlearn.models.gp import sparse
from contactlearn.results.folder import read_result
from contactlearn.simulation import synthetic

if not torch.cuda.is_available():
    pytest.skip("no GPU that PyTorch sees", allow_module_level=True)

CLOSED_FORM = 1e-9
"""Relative to the largest number of its kind: closed forms and sums, some roundings apart."""

FITTED = 1e-6
"""Likewise, of what a search ends at: parameters, and what is predicted with them."""

SMALLEST = 1e-3
"""In SI units; numbers that are all below it, such as slopes where an effect is spent, are roundings of larger ones."""

HEXAGON = Polygon(((0.04, 0.0), (0.02, 0.025), (-0.02, 0.025), (-0.04, 0.0), (-0.02, -0.025), (0.02, -0.025)))
KINDS = [kind for forms in catalogue().values() for kind in forms if PLANE in kind.spaces]
LAWS = [kind for family in laws.catalogue().values() for kind in family.values()]
ROUTH = laws.find("wang_mason")


RECIPES = {
    "velocity": Recipe("state", "velocity"),
    "impulse": Recipe("x2", "impulse"),
    "wrench": Recipe("x1", "wrench", ROUTH),
    "polar": Recipe("x2_polar", "impulse", ROUTH),
    "likelihood": Recipe("x1", "parameters_likelihood", ROUTH),
}


@pytest.fixture(scope="module")
def device():
    return torch.device("cuda")


@pytest.fixture(scope="module")
def drops():
    """Drops of three objects."""
    drops = synthetic.load(size=60, seed=3)
    return drops.replace(object=tuple(("first", "second", "third")[k % 3] for k in range(60)))


def numbers(thing, name="") -> dict[str, Tensor]:
    """All numbers of a thing at any depth, by their place in it."""
    if isinstance(thing, Tensor):
        return {name: thing}
    if isinstance(thing, float):
        return {name: torch.tensor(thing, dtype=torch.float64)}
    if isinstance(thing, torch.nn.Module):
        thing = dict(thing.state_dict())
    elif is_dataclass(thing):
        thing = {field.name: getattr(thing, field.name) for field in fields(thing)}
    elif isinstance(thing, list | tuple):
        thing = dict(enumerate(thing))
    found = {}
    for key, part in thing.items() if hasattr(thing, "items") else ():
        found |= numbers(part, f"{name}.{key}")
    return found


def assert_alike(found, expected, device, tolerance):
    """The numbers of `found` lie on the device, and are those of `expected`, which lie on the CPU."""
    found, expected = numbers(found), numbers(expected)
    assert found.keys() == expected.keys() != set()
    off = []
    for name, value in found.items():
        assert value.ndim == 0 or value.device.type == device.type, f"{name} is on {value.device}"
        own, true = value.cpu().double(), expected[name].double()
        finite = true[true.isfinite()].abs()
        scale = max(finite.max().item(), SMALLEST) if len(finite) else 1.0
        apart = torch.where((own == true) | (own.isnan() & true.isnan()), 0.0, (own - true).abs())
        if (apart > tolerance * scale).any():
            off.append(f"{name} is {apart.max():.2g} off, of {scale:.2g}")
    assert not off, "; ".join(off)


def test_impacts_move_there_and_back(drops, device):
    drops = drops.replace(v_post_cov=torch.eye(3, dtype=torch.float64).expand(len(drops), 3, 3))
    there = moved(drops, device)
    assert all(value.device.type == device.type for value in numbers(there).values() if value.ndim)
    assert there.fingerprint() == drops.fingerprint() == moved(there, "cpu").fingerprint()
    rows = torch.tensor((3, 1))
    assert there[rows].fingerprint() == there[rows.to(device)].fingerprint() == drops[rows].fingerprint()
    assert there[there.v_c[:, 0] > 0].trial == drops[drops.v_c[:, 0] > 0].trial
    for generator in (torch.Generator().manual_seed(k) for k in range(2)):
        state = generator.get_state()
        parts = drops.split(0.25, generator)
        assert [x.trial for x in there.split(0.25, generator.set_state(state))] == [x.trial for x in parts]


def test_impacts_lie_on_one_device(drops, device):
    with pytest.raises(DataError, match=f"r must be on {device.type}:0 as mass is, got cpu"):
        moved(drops, device).replace(r=drops.r)
    with pytest.raises(DataError, match=r"row 2 .* column mass: must be positive"):
        moved(drops, device).replace(mass=torch.where(torch.arange(60) == 1, -1.0, drops.mass).to(device))


@pytest.mark.parametrize("kind", LAWS, ids=lambda kind: f"{kind.name}-{kind.variant}")
def test_laws(kind, drops, device):
    """Single contacts, a grid in blocks, into given memory, and slopes."""

    def computed(drops):
        mu, eps = (torch.linspace(0, end, 20).to(drops.mass) for end in (1.2, 1.0))
        grid = kind().at(mu[:, None, None], eps[:, None])
        block = [kind().at(0.3, 0.4).impulse(drops.W, drops.v_c), grid.impulse(drops.W, drops.v_c)]
        block.append(grid.impulse(drops.W, drops.v_c, out=torch.empty_like(block[1])))
        own = [torch.full_like(drops.mass, value) for value in (0.2, 0.5)]
        _, slope = linearised(lambda *own: kind().at(*own).impulse(drops.W, drops.v_c), own)
        return *block, slope, kind().at(0.1, 0.2).impulse(drops.W[:1], drops.v_c[:1])

    monkey = moved(drops, device)
    assert_alike(computed(monkey), computed(drops), device, CLOSED_FORM)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: f"{kind.name}-{kind.form or ''}")
def test_effects(kind, drops, device):
    """Prediction with numbers, with values on the device, and slopes, of the body that shows the effect."""
    shape = HEXAGON if kind.name == "corner_radius" else drops.shape
    drops = drops.replace(shape=shape)
    effect = kind().prepare(drops)
    assert kind().prepare(moved(drops, device)).options == effect.options
    middle = [p.start + (p.high - p.start) / 4 for p in effect.parameters]

    def computed(drops):
        model = ContactModel(ROUTH.at(0.2, 0.5), effects={"it": effect.at(middle)})
        theta = torch.tensor([[0.2, 0.5, *middle], [0.1, 0.6, *middle]], dtype=torch.float64).to(drops.mass)
        batch = assemble(ROUTH, {"it": effect}, theta)
        own = [torch.full_like(drops.mass, value) for value in middle]
        _, slope = linearised(
            lambda *own: resolve(ROUTH, {"it": effect.at(own)}, State.of(drops), 0.2, 0.5).v_post, own
        )
        return (
            model.predict(drops),
            batch.predict(drops),
            slope,
            partial_residuals(moved(model, drops.mass.device), drops, "it"),
            changes(batch, drops, ["it"]),
        )

    assert_alike(computed(moved(drops, device)), computed(drops), device, CLOSED_FORM)


@pytest.mark.parametrize("norm", metrics.NORMS)
def test_bounds(norm, drops, device):
    def computed(drops):
        models = {name: ContactModel(laws.find(name).at(0.2, 0.5)).predict(drops) for name in laws.PAPER_LAWS}
        width = torch.linspace(0, 0.01, 3, dtype=torch.float64)[:, None]
        best, model = bounds.best_post_hoc(drops, models, norm)
        return best, model, bounds.irb(drops, norm), bounds.irb(drops, norm, patch=width)

    assert_alike(computed(moved(drops, device)), computed(drops), device, CLOSED_FORM)


def test_errors(drops, device):
    """The same intervals on every device: resampling is done on the CPU."""
    models = {name: ContactModel(laws.find(name).at(0.2, 0.5)) for name in laws.PAPER_LAWS[:2]}
    found = []
    for there in (drops, moved(drops, device)):
        sums = ErrorSums(models)
        predictions = {name: model.predict(there) for name, model in models.items()}
        sums.add(there, predictions)
        sums.add(there, predictions)
        generator = torch.Generator().manual_seed(0)
        whittaker = [sums.interval(name, "whittaker", generator, 100) for name in metrics.METRICS]
        several = torch.stack([metrics.mass_error(there, one) for one in predictions.values()])
        level, share = metrics.calibration(several[0])
        found.append((whittaker, sums.outside_admissible("whittaker"), metrics.bootstrap(several, generator, 100)))
        found[-1] += (level.cpu(), share.cpu())
    assert_alike(found[1], found[0], torch.device("cpu"), CLOSED_FORM)


@pytest.mark.parametrize("target", ["momentum", "least_squares", "contact"])
def test_shared_parameters(target, drops, device):
    drops, orders = drops[:30], nested_orders(30, 3, torch.Generator().manual_seed(0))

    def computed(drops, orders):
        box = Box(nodes=5)
        fit = fit_subsets(drops, "whittaker", sizes=(10, 20), orders=orders, target=target, box=box)
        one = fit_subsets(drops, "whittaker", sizes=(30,), repetitions=1, target=target, box=box)
        known = torch.where(fit.mu_flat, torch.nan, fit.mu)  # elsewhere any μ of the interval is as good
        return replace(fit, mu=known), one, cost_surface(one.to_law(), drops, *box.axes(), target=target)

    expected = computed(drops, orders)
    assert not expected[0].mu_flat.all()
    assert_alike(computed(moved(drops, device), orders), expected, device, FITTED)
    assert_alike(computed(moved(drops, device), orders.to(device)), expected, device, FITTED)


@pytest.mark.parametrize("name", ["whittaker", "wang_mason"])
def test_single_trials(name, drops, device):
    few = drops[:25]
    found, expected = fit_trials(moved(few, device), laws.find(name)), fit_trials(few, laws.find(name))
    known = ~expected.flat  # elsewhere any μ of the interval is as good
    for part in ("error", "mu_low", "mu_high"):
        assert_alike(getattr(found, part), getattr(expected, part), device, FITTED)
    for part in ("mu", "eps"):
        assert_alike(getattr(found, part)[known.to(device)], getattr(expected, part)[known], device, FITTED)


JOINT = {
    "no effect": ([], FitOptions(starts=4)),
    "two effects": (["spin_damping", "surface_tilt"], FitOptions(starts=4)),
    "wrench": (["contact_patch"], FitOptions(starts=2, target="wrench")),
    "curve": (["parameter_drift"], FitOptions(starts=2)),
    "noise": (["side_drag"], FitOptions(starts=2, noise=(0.01, 0.01, 0.5))),
    "noise before": (["side_drag"], FitOptions(starts=2, noise=(0.01, 0.01, 0.5), noise_before=(0.02, 0.0, 0.1))),
}


@pytest.mark.parametrize(("names", "options"), JOINT.values(), ids=JOINT)
def test_joint_fits(names, options, drops, device):
    def computed(drops, rows):
        fit = joint.fit(drops, ROUTH, names, rows=rows, options=options)
        one = linearise(ROUTH, fit.model.effects, drops, fit.values[0], fit.scatter[0], options=options)
        return fit, one, fit.model.predict(drops)

    rows = nested_orders(60, 2, torch.Generator().manual_seed(0))[:, :40]
    there = computed(moved(drops, device), rows)
    assert_alike(there, computed(drops, rows), device, FITTED)
    back = moved(there[0].model, "cpu")
    assert_alike(back.predict(drops), moved(there[2], "cpu"), torch.device("cpu"), CLOSED_FORM)
    assert str(back) == str(there[0].model)


@pytest.mark.parametrize("limit", [2000, 20], ids=["exact", "sparse"])
@pytest.mark.parametrize("recipe", RECIPES.values(), ids=RECIPES)
def test_learned_models(recipe, limit, drops, device, monkeypatch, tmp_path):
    """What they predict, how sure they are, and the same from a checkpoint; flat optima may be met elsewhere."""
    monkeypatch.setattr(regressor, "EXACT_LIMIT", limit)
    monkeypatch.setattr(sparse, "INDUCING", 15)
    rows = nested_orders(60, 2, torch.Generator().manual_seed(0))[:, :40]
    base = recipe.law and recipe.law.at(0.12, 0.55)
    there = learn(moved(drops, device), recipe, rows=rows, base=base)
    model = learn(drops, recipe, rows=rows, base=base)
    assert type(there.processes.gps) is type(model.processes.gps)
    found = there.predict(moved(drops, device)), there.processes.leave_one_out()
    assert_alike(found, (model.predict(drops), model.processes.leave_one_out()), device, FITTED)
    checkpoint.save(there, tmp_path / "model.pt", provenance={})
    loaded = checkpoint.load(tmp_path / "model.pt")
    back = moved(there, "cpu")
    for one in (loaded, back, moved(moved(loaded, device), "cpu")):
        assert_alike(one.predict(drops), moved(found[0], "cpu"), torch.device("cpu"), CLOSED_FORM)
    assert_alike(moved(back, device).predict(moved(drops, device)), moved(found[0], "cpu"), device, CLOSED_FORM)


def test_models_of_identified_parameters_follow(drops, device):
    """Their numbers are not compared: they learn arbitrary μ of trials that stick, which a rounding decides."""
    recipe = Recipe("x1", "parameters_identified", ROUTH)
    there = moved(drops, device)
    found = learn(there, recipe, rows=torch.arange(40), base=ROUTH.at(0.12, 0.55)).predict(there)
    assert found.v_post.device.type == device.type
    assert found.v_post.isfinite().all()


def test_stated_noise_weights_trials_there(drops, device):
    covariance = torch.rand(60, 1, 1, generator=torch.Generator().manual_seed(0)).double() * 1e-4 * torch.eye(3)
    drops, rows = drops.replace(v_post_cov=covariance), torch.arange(40)
    there = learn(moved(drops, device), RECIPES["wrench"], rows=rows, base=ROUTH.at(0.12, 0.55)).predict(
        moved(drops, device)
    )
    here = learn(drops, RECIPES["wrench"], rows=rows, base=ROUTH.at(0.12, 0.55)).predict(drops)
    assert_alike(there, here, device, FITTED)


def test_learning_curves(drops, device):
    """Of laws, of a law with an effect and of a learned model, and its transfer to another body."""
    orders = nested_orders(40, 2, torch.Generator().manual_seed(0))

    def computed(pool, test):
        fits, curves = law_curves([ROUTH], pool, test, orders, (20, 30), box=Box(nodes=9))
        bases = {ROUTH.name: {size: law_at(fits[ROUTH.name], size) for size in (20, 30)}}
        learned = learning_curves({"wrench": RECIPES["wrench"]}, pool, test, orders, (20, 30), bases)
        joint = joint_curve(
            ROUTH, {"it": find_effect("spin_damping")()}, pool, test, orders, (30,), FitOptions(starts=2)
        )
        generator = torch.Generator().manual_seed(0)
        bodies = {"same": (pool, test)}
        return curves, learned, joint, transfer_curves(RECIPES["velocity"], pool, bodies, (20,), 2, generator)[1]

    pool, test = drops[:40], drops[40:]
    assert_alike(computed(*moved((pool, test), device)), computed(pool, test), device, FITTED)


SMALL = ("data.size=32", "train.size=10", "train.repetitions=2", "bootstrap=20", "model=analytical")
COMMANDS = {
    "law": ("train.py", *SMALL, "law=mirtich"),
    "effects": ("train.py", *SMALL, "effect=[spin_damping]", "fit.starts=2"),
    "learned": ("train.py", *SMALL, "effect=[spin_damping]", "fit.starts=2", "model=residual_wrench"),
    "evaluation": (
        "evaluate.py", *SMALL, "effect=[spin_damping]", "fit.starts=2", "figures.repetitions=2", "laws=[whittaker]",
        "model=[residual_wrench]", "curves.sizes=[8]", "curves.seeds=2",
    ),
    "transfer": (
        "evaluate.py", "experiment=transfer", *SMALL, "model=[x1_wrench]", "transfer.sizes=[10]", "transfer.seeds=2",
    ),
}  # fmt: skip


@pytest.mark.parametrize("words", COMMANDS.values(), ids=COMMANDS)
def test_commands(words, device, tmp_path):
    """The same results, tables and checkpoints, which say where they were computed."""
    run(*words, "workers=1" if words[0] == "evaluate.py" else "threads=1", f"hydra.run.dir={tmp_path / 'cpu'}")
    printed = run(*words, "device=cuda", f"hydra.run.dir={tmp_path / 'there'}")
    assert f"computed on {devices.described(device)}" in printed
    found, expected = (read_result(tmp_path / name / "results.json") for name in ("there", "cpu"))
    assert (found.provenance.device, expected.provenance.device) == (devices.described(device), "cpu")
    found, expected = (replace(result, provenance=expected.provenance) for result in (found, expected))
    assert_alike(found, expected, torch.device("cpu"), FITTED)
    assert sorted(path.name for path in (tmp_path / "there").iterdir() if "events" not in path.name) == sorted(
        path.name for path in (tmp_path / "cpu").iterdir() if "events" not in path.name
    )


@pytest.mark.parametrize("words", [("train.py",), ("evaluate.py", "laws=[whittaker]", "figures.repetitions=2")])
def test_a_checkpoint_is_judged_and_gone_on_from(words, drops, device, tmp_path):
    model = learn(drops, Recipe("x1", "wrench"), rows=torch.arange(15))
    path = checkpoint.save(model, tmp_path / "model.pt", provenance={})
    test_commands((*words, *SMALL[:-1], "data=synthetic", f"checkpoint={path}"), device, tmp_path)
