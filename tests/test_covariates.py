"""Columns of one's own: temperature, operator, batch as variables of effects, screens and regions."""

import numpy as np
import pandas as pd
import pytest
import torch
from refusals import refused

from contactlearn.data import table
from contactlearn.data.blocks import Blocks
from contactlearn.data.headers import propose
from contactlearn.diagnosis.regions import find_regions
from contactlearn.diagnosis.search.candidates import all_candidates, usable
from contactlearn.diagnosis.unexplained.deviations import screen_deviations
from contactlearn.diagnosis.unexplained.state_dependence import find_state_dependence
from contactlearn.effects import EffectId, find_effect
from contactlearn.effects.covariate_dependent_friction import CovariateDependentFriction
from contactlearn.effects.covariate_dependent_restitution import CovariateDependentRestitution
from contactlearn.inference.identification import joint
from contactlearn.inference.identification.joint import FitOptions
from contactlearn.inference.identification.scatter import fit_scatter
from contactlearn.laws import find
from contactlearn.models import checkpoint
from contactlearn.models.export.source import source_code
from contactlearn.report.terminal import model_commands
from contactlearn.scatter import find_component
from contactlearn.simulation import synthetic
from contactlearn.testing import EffectContract

N, SIGMAS = 300, 4.0
RANGE = (5.0, 35.0)  # °C
SLOPE, STEP = -0.004, 0.06  # of ε, in 1/°C and of the second operator


def planted(slope: float = 0.0, step: float = 0.0, friction: float = 0.0, seed: int = 0):
    """Drops of many sessions, each simulated at its own ε and μ, with its temperature, humidity and operator."""
    rng, frames = np.random.default_rng(seed), []
    for k in range(20):
        warm, damp, operator = rng.uniform(*RANGE), rng.uniform(30, 60), "AB"[rng.integers(2)]
        eps = 0.55 + slope * (warm - 20) + step * (operator == "B")
        frame = synthetic.load(size=N // 20, eps=eps, mu=0.12 + friction * (warm - 20), seed=100 + k).to_frame()
        frames.append(frame.assign(**{"temperature [°C]": warm, "humidity (%)": damp, "Operator": operator}))
    mixed = pd.concat(frames).sample(frac=1, random_state=seed)
    return mixed.drop(columns=["trial", "order", "object"]).reset_index(drop=True)


def read(frame, *covariates: str):
    return table.load(frame, synthetic.load(size=2).shape, covariates=covariates)


ALL = ("temperature", "humidity", "operator")


@pytest.mark.parametrize(
    "effect",
    [
        find_effect(f"covariate_dependent_{coefficient}", form)(covariate=name)
        for coefficient in ("restitution", "friction")
        for form, name in (("linear", "temperature"), ("curve", "temperature"), ("group", "operator"))
    ],
    ids=lambda effect: str(effect.id),
)
class TestContract(EffectContract):
    @pytest.fixture(autouse=True)
    def _chosen(self, effect):
        self.effect = effect


def test_numbers_and_names_are_read_saved_and_split(tmp_path):
    frame = planted()
    impacts = read(frame, *ALL)
    assert torch.equal(impacts.covariates["temperature"], torch.tensor(frame["temperature [°C]"].to_numpy()))
    assert impacts.covariates["operator"] == tuple(frame["Operator"])
    for suffix in (".csv", ".parquet"):
        again = table.load(table.save(impacts, tmp_path / f"drops{suffix}"), impacts.shape)
        assert again.fingerprint() == impacts.fingerprint()
    some = impacts[[7, 3]]
    assert some.covariates["operator"] == tuple(frame["Operator"].iloc[[7, 3]])
    assert some.covariates["temperature"].tolist() == frame["temperature [°C]"].iloc[[7, 3]].tolist()
    assert impacts.fingerprint() != read(frame, "temperature").fingerprint()


def test_blocks_read_each_covariate_alike(tmp_path):
    frame = planted().assign(batch=[str(k % 3) if k < 290 else "late" for k in range(N)])
    frame.to_csv(tmp_path / "drops.csv", index=False)
    shape = synthetic.load(size=2).shape

    def blocks(*covariates):
        return lambda: table.blocks_of(
            table.read_blocks(tmp_path / "drops.csv", 100, shape=shape, covariates=covariates), lambda one: one.impacts
        )

    whole = Blocks.survey(blocks(*ALL)).pick(torch.ones(N, dtype=torch.bool))
    assert whole.covariates["operator"] == tuple(frame["Operator"])
    assert len(whole.covariates["temperature"]) == N
    with refused(("row 291", "column batch", "'late'")):  # numbers in the blocks before
        Blocks.survey(blocks("batch"))


@pytest.mark.parametrize(
    ("covariates", "said"),
    [
        (["temprature"], ("'temprature' is no column", "temperature [°C]")),
        ("temperature", ("is a list of columns", "[temperature, operator]")),
    ],
)
def test_a_wrong_setting_is_refused(covariates, said):
    with refused(said):
        table.load(planted(), covariates=covariates)


def test_a_wrong_cell_is_refused_with_its_row():
    frame = planted()
    frame["temperature [°C]"] = frame["temperature [°C]"].astype(object)
    frame.loc[4, "temperature [°C]"] = "warm"
    with refused(("row 5", "temperature [°C]", "'warm'")):
        read(frame, "temperature")
    frame.loc[4, "temperature [°C]"] = None
    with refused(("row 5", "temperature [°C]", "empty")):
        read(frame, "temperature")
    shape = synthetic.load(size=2).shape
    assert len(table.read(frame, shape=shape, covariates=["temperature"], drop_incomplete=True).impacts) == N - 1


@pytest.mark.parametrize(
    ("kind", "name", "form", "told"),
    [
        (CovariateDependentRestitution, "temperature", "linear", {"slope": SLOPE}),
        (CovariateDependentRestitution, "operator", "group", {"step": STEP}),
        (CovariateDependentFriction, "temperature", "linear", {"friction": 0.003}),
    ],
)
def test_a_fit_finds_what_was_planted(kind, name, form, told):
    impacts = read(planted(**told), *ALL)
    effect = find_effect(kind.name, form)(covariate=name).prepare(impacts)
    fit = joint.fit(impacts, find("wang_mason"), {"it": effect})
    (truth,) = told.values()
    if form == "linear":
        low, high = effect.span
        truth *= high - low
    elif effect.objects[0] == "B":
        truth = -truth
    error = fit.covariance[2, 2].sqrt().item()
    assert abs(fit.values[2].item() - truth) < SIGMAS * error < 0.3 * abs(truth)


def test_candidates_are_named_after_covariates():
    impacts = read(planted(), *ALL)
    found = usable(all_candidates(impacts.space, impacts.covariates), impacts)
    own = {str(key) for key in found if key.name.startswith(ALL)}
    assert own == {
        f"{name}_dependent_{coefficient}:{form}"
        for name, forms in (("temperature", "linear curve"), ("humidity", "linear curve"), ("operator", "group"))
        for coefficient in ("restitution", "friction")
        for form in forms.split()
    }
    constant = impacts.replace(covariates={"temperature": torch.full((N,), 20.0)})
    assert not any(
        key.name.startswith("temperature") for key in usable(all_candidates(covariates=constant.covariates), constant)
    )


def test_screens_and_regions_name_the_covariate():
    """Without the effect among the candidates."""
    impacts = read(planted(slope=2 * SLOPE), *ALL)
    fit = joint.fit(impacts, find("wang_mason"))
    found = find_state_dependence(impacts, fit, fit, FitOptions())
    assert found.variables[0].symbol == "temperature"
    impacts = read(planted(step=3 * STEP), *ALL)
    known = joint.fit(impacts[torch.tensor([one == "A" for one in impacts.covariates["operator"]])], find("wang_mason"))
    generator = torch.Generator().manual_seed(0)
    (first, *_) = find_regions(impacts, known.model.predict(impacts), generator=generator)
    assert first.where == "operator B"


def test_deviations_that_follow_a_covariate_are_no_scatter():
    impacts = read(planted(slope=2 * SLOPE), *ALL)
    model = joint.fit(impacts, find("wang_mason")).model
    scatter = fit_scatter(impacts, model, components=[find_component("restitution")()], quick=True)
    first = screen_deviations(scatter, impacts)[0]
    assert (first.component, first.variable) == ("restitution", "temperature")


def test_files_and_other_data(tmp_path):
    """A checkpoint keeps the covariate, data without it are refused, and an exported function is at its middle."""
    impacts = read(planted(slope=SLOPE), *ALL)
    effect = find_effect("covariate_dependent_restitution", "linear")(covariate="temperature").prepare(impacts)
    model = joint.fit(impacts, find("wang_mason"), {"temperature_dependent_restitution": effect}).model
    checkpoint.save(model, tmp_path / "model.pt", provenance={})
    assert torch.equal(checkpoint.load(tmp_path / "model.pt").predict(impacts).v_post, model.predict(impacts).v_post)
    with refused(("has no covariate 'temperature'", "data.covariates=[temperature]")):
        effect.prepare(impacts.replace(covariates={}))
    assert "impact" in source_code(model, "c", impacts[:5])
    assert EffectId("temperature_dependent_restitution", "linear") in all_candidates(covariates=impacts.covariates)


def test_the_next_command_names_classes_of_other_packages_alone(tmp_path):
    """A covariate's class is this package's own, and is in the run; another package's must be typed."""
    ours = "+effect.warm._target_=contactlearn.effects.covariate_dependent_restitution.RestitutionLinearInCovariate"
    theirs = "+effect.cable._target_=my_module.CableDrag"
    printed, _ = model_commands(
        f"contactlearn evaluate data=mydata {ours} +effect.warm.covariate=temperature {theirs}", tmp_path
    )
    assert printed == f"contactlearn train model={tmp_path} {theirs}"


def test_a_temperature_is_proposed(tmp_path):
    frame = synthetic.load(size=20).to_frame().assign(**{"Température (°C)": [18.0, 27.5] * 10, "index": range(20)})
    frame.to_csv(tmp_path / "drops.csv", index=False)
    (found,) = (one.value for one in propose(tmp_path / "drops.csv").settings if one.name == "covariates")
    assert found == ["Température (°C)"]
