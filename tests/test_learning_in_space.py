"""Features, parameters of single trials and learned models in space: turned with the impact, and the plane's there."""

import math

import pytest
import torch
from spatial import in_space, tossed

from contactlearn.core.errors import ContactLearnError
from contactlearn.effects import find_effect
from contactlearn.inference.evaluation.partial_residuals import partial_residuals
from contactlearn.inference.identification.per_trial import fit_trials
from contactlearn.inference.learning.recipe import TARGETS, Recipe, learn, target_units
from contactlearn.laws import find
from contactlearn.mechanics.features import SPACES, Features, feature_units
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.space import SPACE
from contactlearn.models import checkpoint
from contactlearn.models.contact_model import ContactModel
from contactlearn.models.process_options import ProcessOptions
from contactlearn.simulation import synthetic

CLOSE = {"rtol": 1e-9, "atol": 1e-9}
PLANAR = synthetic.load(60, seed=3)
TOSSED = tossed(90)
ROWS = torch.arange(60)
LAW = find("whittaker").at(0.2, 0.5)
IN_SPACE = [name for name, one in SPACES.items() if one.in_space]


def turned(impacts: Impacts, angle: float) -> tuple[Impacts, torch.Tensor]:
    """The same impacts turned about the normal, and the rotation of velocities and wrenches."""
    c, s = math.cos(angle), math.sin(angle)
    R = torch.tensor([[c, -s, 0], [s, c, 0], [0, 0, 1]], dtype=torch.float64)
    turn = torch.block_diag(R, R)
    half = torch.tensor([math.cos(angle / 2), 0, 0, math.sin(angle / 2)], dtype=torch.float64)
    (a, d), (w, x, y, z) = (half[0], half[3]), impacts.q[:, 3:].T
    spun = torch.stack((a * w - d * z, a * x - d * y, a * y + d * x, a * z + d * w), -1)
    q = torch.cat((impacts.q[:, :3] @ R.T, spun), -1)
    velocities = {name: getattr(impacts, name) @ turn.T for name in ("v_pre", "v_post")}
    return impacts.replace(r=impacts.r @ R.T, q=q, **velocities), turn


@pytest.mark.parametrize("name", IN_SPACE)
def test_a_turn_about_the_normal_changes_no_feature(name):
    other, _ = turned(TOSSED, 1.1)
    torch.testing.assert_close(Features.of(other, name).values, Features.of(TOSSED, name).values, **CLOSE)
    assert Features.of(TOSSED, name).values.shape == (90, len(feature_units(name, SPACE)))


def test_features_are_those_of_the_plane_along_the_slip():
    """A planar body in space: what lies across the plane is 0, and signs are those of the slip."""
    there, here = Features.of(in_space(PLANAR), "x1"), Features.of(PLANAR, "x1")
    sign = here.values[:, 3].sign()
    known = dict(zip(there.units, there.values.T, strict=True))
    for name, values in {"11": here.values[:, 0], "1n": sign * here.values[:, 1], "nn": here.values[:, 2]}.items():
        torch.testing.assert_close(known[f"M_c,{name}"], values, **CLOSE)
    torch.testing.assert_close(known["slip"], here.values[:, 3].abs(), **CLOSE)
    assert (known["M_c,12"].abs() + known["M_c,2n"].abs() < 1e-9).all()


def test_parameters_of_single_trials_are_those_of_the_plane():
    plane, space = (fit_trials(impacts, LAW) for impacts in (PLANAR, in_space(PLANAR)))
    torch.testing.assert_close(space.error, plane.error, rtol=1e-6, atol=1e-9)
    shared = (LAW.impulse(TOSSED.W, TOSSED.v_c) - TOSSED.wrench[:, :3]).norm(dim=-1)
    assert (fit_trials(TOSSED, LAW).error <= shared + 1e-12).all()


@pytest.mark.parametrize("target", TARGETS)
def test_learned_models_turn_with_the_impact_and_load_again(target, tmp_path):
    recipe = Recipe("x1", target, LAW)
    model = learn(TOSSED, recipe, rows=ROWS, base=LAW)
    held_out, (other, turn) = TOSSED[60:], turned(TOSSED[60:], 2.0)
    predicted, again = model.predict(held_out), model.predict(other)
    torch.testing.assert_close(again.v_post, predicted.v_post @ turn.T, rtol=1e-7, atol=1e-7)
    torch.testing.assert_close(again.covariance, turn @ predicted.covariance @ turn.T, rtol=1e-6, atol=1e-6)
    assert model.processes.outputs.mean.shape[-1] == len(target_units(target, SPACE))
    checkpoint.save(model, tmp_path / "model.pt", provenance={})
    loaded = checkpoint.load(tmp_path / "model.pt")
    assert torch.equal(loaded.predict(held_out).v_post, predicted.v_post)
    with pytest.raises(ContactLearnError, match="has learnt from 8 features of bodies in space"):
        loaded.predict(PLANAR)


def test_partial_residuals_are_those_of_the_plane_along_the_slip():
    """A planar body in space: the same change of the normal impulse; its symbols are the spatial ones."""
    model = ContactModel(LAW, effects={"adhesion": find_effect("adhesion")().at([0.002])})
    plane, space = (partial_residuals(model, impacts, "adhesion") for impacts in (PLANAR, in_space(PLANAR)))
    assert (plane.component, space.component) == ("P_n", "P_n")
    torch.testing.assert_close(space.explained, plane.explained, **CLOSE)
    torch.testing.assert_close(space.measured, plane.measured, **CLOSE)


def test_kernels_name_the_features_of_space():
    """`v_n` is the last of eight columns there and the last of five in the plane."""
    kernel = {"_target_": "gpytorch.kernels.RBFKernel", "active_dims": ["v_n"]}
    recipe = Recipe("x1", "impulse", processes=ProcessOptions(kernel=kernel))
    for impacts, last in ((PLANAR, 4), (TOSSED, 7)):
        model = learn(impacts, recipe, rows=torch.arange(12))
        lengths = model.processes.gps.hyperparameters()[0, :-2]
        assert lengths.isfinite().nonzero()[:, 0].tolist() == [last]
    Recipe("x1", "impulse", processes=ProcessOptions(kernel=kernel | {"active_dims": ["slip"]}))
