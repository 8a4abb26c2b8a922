"""Derivatives of every kind of model in its inputs, against central differences of fourth order.

Optimal control and differentiable simulation take them: a derivative that is cut is a wrong answer without a word.
"""

from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from spatial import tossed
from torch import Tensor

from contactlearn.core.errors import ContactLearnError
from contactlearn.effects import find_effect
from contactlearn.effects.formula.effect import formula
from contactlearn.inference.identification.joint import fit
from contactlearn.inference.learning.recipe import Recipe, learn
from contactlearn.laws import find
from contactlearn.mechanics.body_state import BodyState
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.shapes import Disc, Ellipse, Ellipsoid, Shape
from contactlearn.mechanics.space import PLANE
from contactlearn.models import checkpoint, regressor
from contactlearn.models.contact_model import ContactModel
from contactlearn.models.process_options import ProcessOptions
from contactlearn.models.roll_out import Until
from contactlearn.simulation import synthetic

TOLERANCE = 1e-6
"""Of a derivative, relative to the largest of its kind: differences of fourth order leave 1e-8 at conditions of 1e5."""

STEP = 1e-4
"""Of a difference, relative to the spread of an input."""

PLANAR, SPATIAL = synthetic.load(60, seed=3), tossed(60)
ROWS = torch.arange(40)
LAW = find("mirtich").at(0.2, 0.5)
DRAG = {"side_drag": find_effect("side_drag")(c=0.1)}
MATERN = {"_target_": "gpytorch.kernels.MaternKernel", "nu": 2.5}
COLUMN = {"_target_": "gpytorch.kernels.RBFKernel", "active_dims": [4]}
LINEAR = {"_target_": "gpytorch.means.LinearMean"}
FEW = {"starts": 1, "iterations": 20}


def learned(impacts: Impacts, features: str, target: str, base=None, **options) -> ContactModel:
    under = base.law_model.base if isinstance(base, ContactModel) else base
    law = under if target.startswith("parameters") or base is under else None
    return learn(impacts, Recipe(features, target, law, ProcessOptions(**options)), rows=ROWS, base=base)


def kinds() -> dict[str, tuple[Impacts, Callable[[], ContactModel]]]:
    """Impacts and a model of each kind."""
    found: dict[str, tuple[Impacts, Callable[[], ContactModel]]] = {}
    for name, impacts in (("plane", PLANAR), ("space", SPATIAL)):
        law = LAW if impacts is PLANAR else find("whittaker").at(0.2, 0.5)
        laws = (
            [law] if impacts is SPATIAL else [find(one).at(0.2, 0.5) for one in ("mirtich", "anitescu_potra_poisson")]
        )

        def add(kind: str, make: Callable[..., ContactModel], *args, of=(name, impacts), **options) -> None:
            found[f"{of[0]} {kind}"] = of[1], lambda: make(*args, **options)

        for features in ("state", "x1", "x2"):
            add(f"velocity({features})", learned, impacts, features, "velocity")
        for target in ("impulse", "wrench"):
            add(f"{target}(x1)", learned, impacts, "x1", target)
            add(f"law + {target}(x1)", learned, impacts, "x1", target, law)
        for target in ("parameters_identified", "parameters_likelihood"):
            add(target, learned, impacts, "x2", target, law)
        for one in laws:
            add(one.name, ContactModel, one)
        add("Matérn", learned, impacts, "x1", "wrench", kernel=MATERN, optimiser=FEW)
        add("one column", learned, impacts, "x1", "wrench", kernel=COLUMN, mean=LINEAR, optimiser=FEW)
    plane = learned(PLANAR, "x2_polar", "impulse")
    under = ContactModel(LAW, effects=DRAG | {"tilt": find_effect("surface_tilt")(phi=0.05)})
    located = ContactModel(
        LAW, effects={"place": formula(mu="c*x", eps="-d*theta", parameters={"c": [-1, 1], "d": [-1, 1]})}
    )
    located = located.at([0.2, 0.5, 0.4, 0.1])
    found["plane impulse(x2_polar)"] = PLANAR, lambda: plane
    found["plane effects"] = PLANAR, lambda: under
    found["plane formula"] = PLANAR, lambda: located
    found["plane effects + wrench(x1)"] = PLANAR, lambda: learned(PLANAR, "x1", "wrench", under)
    found["plane formula, parameters"] = PLANAR, lambda: learned(PLANAR, "x1", "parameters_likelihood", located)
    found["plane learned on learned"] = PLANAR, lambda: learned(PLANAR, "x2", "impulse", plane)
    found["plane fit"] = PLANAR, lambda: fit(PLANAR, "mirtich", ["side_drag"]).model
    return found


KINDS = kinds()


def jacobian(function: Callable[[Tensor], Tensor], inputs: Tensor) -> Tensor:
    """Derivative [N, O, K] of outcomes [N, O] in the inputs [N, K] of their own trials, by backpropagation."""
    own = inputs.clone().requires_grad_()
    outcome = function(own)
    assert outcome.requires_grad
    return torch.stack([torch.autograd.grad(part.sum(), own, retain_graph=True)[0] for part in outcome.unbind(-1)], 1)


def differences(function: Callable[[Tensor], Tensor], inputs: Tensor) -> Tensor:
    """The same, by differences, all in one batch."""
    size = STEP * torch.where(inputs.std(0) > 0, inputs.std(0), inputs.abs().mean(0))
    moves = torch.tensor((-2, -1, 1, 2), dtype=torch.float64)[:, None, None, None] * size.diag()[:, None]
    far_down, down, up, far_up = function((inputs + moves).flatten(0, 2)).view(4, len(size), len(inputs), -1)
    return ((8 * (up - down) - (far_up - far_down)).movedim(0, -1)) / (12 * size)


def assert_derivatives(function: Callable[[Tensor], Tensor], inputs: Tensor) -> None:
    exact, approximate = jacobian(function, inputs), differences(function, inputs)
    size = torch.maximum(exact.abs(), approximate.abs()).amax(0)
    error = ((exact - approximate).abs() / size.clamp_min(1e-6 * size.max())).flatten(1).amax(1)
    assert error.max() < TOLERANCE, error


def inputs_of(impacts: Impacts) -> tuple[Tensor, Callable[[Tensor], Impacts]]:
    """Everything that was measured before contact, side by side, and the way back."""
    names = ("mass", "inertia", "r", "q", "v_pre")
    parts = [getattr(impacts, name).reshape(len(impacts), -1) for name in names]
    sizes = [part.shape[1] for part in parts]

    def back(flat: Tensor) -> Impacts:
        mass, inertia, *others = flat.split(sizes, -1)
        inertia = inertia[:, 0] if impacts.space is PLANE else inertia
        return Impacts(mass[:, 0], inertia, *others, torch.zeros_like(others[-1]), shape=impacts.shape)

    return torch.cat(parts, 1), back


@pytest.mark.parametrize("kind", KINDS)
def test_predictions_have_their_derivatives(kind):
    impacts, make = KINDS[kind]
    model, (inputs, back) = make(), inputs_of(impacts[40:])

    def outcome(flat: Tensor) -> Tensor:
        found = model.predict(back(flat))
        covariance = [] if found.covariance is None else [found.covariance.flatten(-2)]
        return torch.cat((found.v_post, found.wrench, *covariance), -1)

    assert_derivatives(outcome, inputs)
    assert not outcome(inputs).requires_grad


@pytest.mark.parametrize("kind", ["plane wrench(x1)", "plane law + wrench(x1)", "plane parameters_likelihood"])
def test_sparse_processes_and_those_of_a_file_have_them_too(kind, monkeypatch, tmp_path):
    monkeypatch.setattr(regressor, "EXACT_LIMIT", 10)
    impacts, make = KINDS[kind]
    model, (inputs, back) = make(), inputs_of(impacts[40:])
    assert "sparse" in model.processes.kind
    loaded = checkpoint.load(checkpoint.save(model, tmp_path / "model.pt", provenance={}))
    for one in (model, loaded):
        assert_derivatives(lambda flat, one=one: one.predict(back(flat)).v_post, inputs)
        assert not one.predict(impacts).v_post.requires_grad


def states(impacts: Impacts, shape: Shape) -> BodyState:
    """Bodies of a shape that approach the floor."""
    parts = {"pose": impacts.q, "velocity": impacts.v_pre, "mass": impacts.mass, "inertia": impacts.inertia}
    fast = BodyState(shape=shape, **parts).as_impacts(validate=False).v_c[:, -1] < -0.1
    return BodyState(shape=shape, **{name: part[fast][:6] for name, part in parts.items()})


STATES = {
    "plane": states(PLANAR, Ellipse((0.035, 0.025))),
    "space": states(SPATIAL, Ellipsoid((0.05, 0.04, 0.03))),
}


def states_of(state: BodyState) -> tuple[Tensor, Callable[[Tensor], BodyState]]:
    """Pose and velocity side by side, and the way back."""
    size = state.pose.shape[-1]

    def back(flat: Tensor) -> BodyState:
        fixed = {
            name: (x := getattr(state, name)).repeat(len(flat) // len(x), *[1] * (x.ndim - 1))
            for name in ("mass", "inertia")
        }
        return BodyState(pose=flat[:, :size], velocity=flat[:, size:], shape=state.shape, **fixed)

    return torch.cat((state.pose, state.velocity), -1), back


STEPPED = [kind for kind in KINDS if "x1" in kind or "para" in kind or "fit" in kind or "mirtich" in kind]


@pytest.mark.parametrize("kind", STEPPED)
def test_a_step_has_its_derivatives_and_so_has_its_covariance(kind):
    model, (inputs, back) = KINDS[kind][1](), states_of(STATES[kind.split()[0]])
    sure = model.noise is not None or model.law_model.parameter_covariance is not None

    def outcome(flat: Tensor) -> Tensor:
        found = model.step(back(flat), uncertainty=sure)
        covariance = [] if found.covariance is None else [found.covariance.flatten(-2)]
        return torch.cat((found.velocity, found.wrench, *covariance), -1)

    assert_derivatives(outcome, inputs)
    for way in (torch.func.jacrev, torch.func.jacfwd):
        one = way(outcome)(inputs)[range(len(inputs)), :, range(len(inputs))]
        torch.testing.assert_close(one, jacobian(outcome, inputs), rtol=1e-9, atol=1e-9)


def test_the_parts_of_a_state_may_be_tensors():
    speed = torch.tensor(-2.0, dtype=torch.float64, requires_grad=True)
    state = BodyState(pose=(0, 0.02, 0.3), velocity=(0.5, speed, 1), mass=0.05, inertia=1e-5, shape=Disc(0.02))
    (slope,) = torch.autograd.grad(ContactModel(LAW).step(state).velocity[1], speed)
    torch.testing.assert_close(slope, torch.tensor(-0.5, dtype=torch.float64), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("kind", ["plane wrench(x1)", "plane effects + wrench(x1)", "plane mirtich", "space whittaker"])
def test_a_roll_out_has_its_derivatives(kind):
    """Of two bounces: times, poses and velocities, and where the body is between and after them."""
    model, state = KINDS[kind][1](), STATES[kind.split()[0]]
    up = state.velocity.shape[-1] // 3
    state = replace(state, pose=state.pose.index_fill(-1, torch.tensor([up]), 0.1))
    inputs, back = states_of(state)
    between = model.roll_out(state, until=Until(bounces=2)).times.mean(-1, keepdim=True)

    def outcome(flat: Tensor) -> Tensor:
        path = model.roll_out(back(flat), until=Until(bounces=2))
        assert (path.contacts == 2).all()
        parts = (
            path.times,
            path.poses.flatten(1),
            path.before.flatten(1),
            path.after.flatten(1),
            path.at(between.repeat(len(flat) // len(between), 1)).flatten(1),
        )
        return torch.cat(parts, -1)

    assert_derivatives(outcome, inputs)


def test_a_covariance_beside_springs_is_known_and_its_derivative_refused():
    """Their derivatives are by hand, and have none of their own: an error, and no wrong number."""
    springs = find_effect("tangential_restitution", "spring")()
    springs = springs.at([(p.low + p.high) / 2 for p in springs.parameters])
    covariance = 1e-4 * torch.eye(2 + len(springs.values), dtype=torch.float64)
    model = ContactModel(LAW, effects={"springs": springs}, parameter_covariance=covariance)
    inputs, back = states_of(STATES["plane"])
    assert model.step(back(inputs), uncertainty=True).covariance.isfinite().all()
    assert_derivatives(lambda flat: model.step(back(flat)).velocity, inputs)
    own = inputs.clone().requires_grad_()
    with pytest.raises(ContactLearnError, match="has first derivatives alone"):
        torch.autograd.grad(model.step(back(own), uncertainty=True).covariance.sum(), own)
