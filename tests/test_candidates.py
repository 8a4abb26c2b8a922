"""What may be missing, what is refused, and the user's own effects on the command line."""

import json
import shlex
from dataclasses import dataclass, replace

import pandas as pd
import pytest
import torch
from commands import run
from drops import seeded
from observers import RecordingObserver

from contactlearn.cli.config_files import with_diagnosed_model
from contactlearn.core.errors import ContactLearnError
from contactlearn.data import table
from contactlearn.diagnosis.events import CandidatesExcluded
from contactlearn.diagnosis.options import DiagnoseOptions
from contactlearn.diagnosis.pipeline import diagnose
from contactlearn.diagnosis.result import Diagnosis, Verdict
from contactlearn.diagnosis.search.candidates import all_candidates, usable
from contactlearn.effects import Effect, EffectId, catalogue, find_effect, parameter
from contactlearn.effects.formula.effect import formula
from contactlearn.inference.identification.joint import assemble
from contactlearn.laws import find
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import GRAVITY
from contactlearn.mechanics.shapes import Disc
from contactlearn.mechanics.space import PLANE, SPACE
from contactlearn.results import folder as run_folder
from contactlearn.simulation import synthetic


@dataclass(frozen=True, eq=False)
class Oracle(Effect):
    """Restitution that follows what was measured afterwards."""

    formula = "ε ← ε + c (v_y⁺ of the trial − mean)"
    trials: int  # without a default it is not in the catalogue
    c: torch.Tensor | float = parameter("c", "s/m", -1.0, 1.0)
    seen: torch.Tensor | None = None

    def prepare(self, impacts):
        return replace(self, seen=impacts.v_post[:, 1] - impacts.v_post[:, 1].mean())

    def law(self, state, mu, eps):
        return mu, eps + self.c * self.seen


@pytest.mark.parametrize("x", [0.0, 0.25, -1.23456])
def test_a_place_that_is_the_same_in_all_trials_decides_nothing(x):
    drops = synthetic.load(size=100)
    q = drops.q.clone()
    q[:, 0] = x
    found = usable(all_candidates(), drops.replace(q=q))
    assert found
    assert not [key for key in found if "location" in key.name]


def test_the_whole_catalogue_is_usable():
    drops = synthetic.load(size=200)
    planar = all_candidates()
    assert usable(all_candidates() | all_candidates(SPACE), drops).keys() == planar.keys()
    assert {key.name for key in all_candidates() | all_candidates(SPACE)} == catalogue().keys()
    drops = synthetic.load(size=200).replace(shape=None)
    missing = planar.keys() - usable(all_candidates(), drops).keys()
    assert missing == {key for key, effect in planar.items() if effect.needs_shape}
    assert missing
    with pytest.raises(ContactLearnError, match="candidate oracle changes its predictions with the measured v_post"):
        usable({EffectId("oracle"): Oracle(100)}, synthetic.load(size=100))


def test_the_lever_of_a_disc_is_noise():
    """A patch that takes all of the lever would be a contact point that was seen 0.2 mm beside the lowest one."""
    drops = synthetic.load(size=100, law="mirtich", mu=0.3, eps=0.5)
    r = torch.stack((0.0002 * torch.randn(100, generator=seeded(), dtype=torch.float64), torch.full((100,), -0.03)), 1)
    drops = drops.replace(shape=Disc(0.03), r=r.double(), validate=False)
    usual = usable(all_candidates(), drops)
    assert [key.form for key in usual if key.name == "contact_patch"] == ["slip"]
    assert {"com_offset", "rolling_resistance"} <= {key.name for key in usual}
    computed = drops.replace(r=r.double() * torch.tensor([0.0, 1.0]), validate=False)
    assert EffectId("contact_patch", "linear") in usable(all_candidates(), computed)  # its arm may be the same for all


def test_a_threshold_above_the_slowest_trials_is_usable():
    """At its first value no trial is below it, and the coefficient the same for all."""
    drops = synthetic.load(size=100)
    v_pre = drops.v_pre * torch.tensor([1.0, 0.5, 1.0]) - torch.tensor([0.0, 0.9, 0.0])
    drops = drops.replace(v_pre=v_pre, validate=False)
    fast = drops[(drops.v_c[:, 1] < -1.0) & (drops.v_c[:, 1] > -3.0)]
    assert len(fast) > 30
    assert EffectId("velocity_dependent_restitution", "threshold") in usable(all_candidates(), fast)


def test_a_parameter_for_every_few_trials_is_refused():
    terms = {f"c{k}": [-1, 1] for k in range(8)}
    many = formula(terms, tau=" + ".join(f"{c}*Pn*rx*sin({k}*order)" for k, c in enumerate(terms)))
    few = formula({"c": [-1, 1]}, tau="c*rx*Pn")
    drops = synthetic.load(size=60)
    assert usable({EffectId("many"): many, EffectId("few"): few}, drops).keys() == {EffectId("few")}
    with pytest.raises(ContactLearnError, match="of up to 8 parameters, for 60 trials"):
        usable({EffectId("many"): many}, drops)


def test_ones_own_candidate_is_found_from_the_command_line(tmp_path):
    """Make data, diagnose, evaluate by the printed command as it is: the held-out error falls."""
    drops = synthetic.load(size=120, velocity_noise=0, spin_noise=0)
    mine = formula({"c": [-0.02, 0.02]}, tau="c*Pn*sin(3*theta)")
    model = assemble(find("wang_mason"), {"mine": mine}, torch.tensor((0.12, 0.55, 0.004), dtype=torch.float64))
    noise = torch.randn(120, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    v_post = model.predict(drops).v_post + noise * torch.tensor((0.01, 0.01, 0.5))
    table.save(drops.replace(v_post=v_post), tmp_path / "drops.csv")
    shape = "data.shape={kind: ellipse, semi_axes: [0.035, 0.025]}"
    words = ["data=table", f"data.path={tmp_path / 'drops.csv'}", shape, "law=wang_mason"]
    own = ['+candidate.mine.tau="c*Pn*sin(3*theta)"', "+candidate.mine.parameters.c=[-0.02,0.02]"]
    printed = run("diagnose.py", *words, *own, f"hydra.run.dir={tmp_path / 'found'}")
    result = run_folder.read_result(tmp_path / "found" / "diagnosis.json")
    assert result.diagnosis.effects == ("mine",)
    assert not result.diagnosis.unwanted
    assert "found: mine" in printed
    assert "missing: mine" not in printed  # a detail
    assert "missing: mine" in (tmp_path / "found" / "diagnose.log").read_text()
    assert f"next: contactlearn train model={tmp_path / 'found'}\n" in printed
    assert f"report: {tmp_path / 'found' / 'report.html'}\n" in printed
    assert printed.endswith(f"  or: contactlearn export {tmp_path / 'found'} --to c\n")
    assert (tmp_path / "found" / "figures" / "ladder.png").exists()
    command = shlex.split(result.use)
    assert '+effect.mine.tau="c*Pn*sin(3*theta)"' in command
    assert with_diagnosed_model([f"model={tmp_path / 'found'}"], "evaluate") == command[2:]
    small = ("train.repetitions=2", "figures.repetitions=2", "bootstrap=50")
    run("evaluate.py", f"model={tmp_path / 'found'}", *small, f"hydra.run.dir={tmp_path / 'used'}")
    errors = json.loads((tmp_path / "used" / "results.json").read_text())["errors"]
    assert errors["wang_mason + mine"]["mass_error"]["high"] < errors["wang_mason"]["mass_error"]["low"]
    (c,) = result.diagnosis.missing[0].parameters
    assert c.value == pytest.approx(0.004, abs=4 * c.standard_error)


def test_a_candidate_with_the_name_of_another_effect_is_refused():
    message = run(
        "diagnose.py", "+candidate.surface_tilt.tau=c*Pn", "+candidate.surface_tilt.parameters.c=[0,1]", status=2
    )
    assert "candidate.surface_tilt has the name of another effect" in message


def test_excluded_candidates_are_reported():
    terms = {f"c{k}": [-1, 1] for k in range(8)}
    many = formula(terms, tau=" + ".join(f"{c}*Pn*rx*sin({k}*order)" for k, c in enumerate(terms, 1)))
    events = RecordingObserver()
    candidates = {EffectId("many"): many, EffectId("surface_tilt", "computed"): find_effect("surface_tilt")()}
    candidates[EffectId("wind")] = formula({"u": [-0.5, 0.5]}, vx_post="u")
    found = diagnose(
        synthetic.load(size=60), find("wang_mason"), options=DiagnoseOptions(candidates=candidates), on_event=events
    )
    assert events.last(CandidatesExcluded).candidates == (EffectId("many"),)
    assert found.unwanted == (EffectId("wind"),)  # tilt is of the catalogue, and nothing asked about the many
    assert Diagnosis.from_json(found.to_json()).unwanted == found.unwanted


def test_wrong_limits_of_the_experiment_are_refused():
    """Before a file is read, but for those of space for drops in a plane, which only the data tell."""
    printed = run("diagnose.py", "data.size=60", "+limits.v_z=[-3,-1]", status=2)
    assert "unknown limit of an experiment 'v_z'" in printed
    early = {
        "+limits.vy=[-3,-1]": "unknown limit of an experiment 'vy', did you mean 'v_y'?",
        "+limits.v_y=-3": "limits.v_y must be [low, high] in order, such as [-3, -1], got -3",
        "+limits.v_y=[-1,-3]": "limits.v_y must be [low, high] in order, such as [-3, -1], got [-1, -3]",
    }
    for word, message in early.items():
        assert message in run("diagnose.py", "data=table", "data.path=nowhere.csv", word, status=2)


def test_bounces_along_the_normal_show_restitution_alone():
    """What would turn a ball or push it sideways is left out: roundings of v_x and ω = 0 would decide about it."""
    impacts = bounces(24)
    able = usable(all_candidates(PLANE, impacts.covariates), impacts)
    assert EffectId("velocity_dependent_restitution", "power") in able
    assert EffectId("temperature_dependent_restitution", "linear") in able
    turning = [("contact_patch", "linear"), ("contact_patch", "point"), ("com_offset", "contact")]
    assert not {EffectId(*one) for one in turning} & able.keys()


@pytest.mark.parametrize("power", [0.08, 0.0])
def test_a_restitution_that_follows_the_speed_is_named_beside_a_temperature(power):
    """The held-out gain of bounces counts v_y alone; with the degrees of freedom of v_x and ω it was no evidence."""
    impacts = bounces(96, power)
    tried = ("temperature_dependent_restitution", "velocity_dependent_restitution", "contact_patch", "side_drag")
    candidates = {key: effect for key, effect in all_candidates(PLANE, impacts.covariates).items() if key.name in tried}
    options = DiagnoseOptions(candidates=candidates, laws=[find("whittaker"), find("wang_mason")])
    found = diagnose(impacts, find("whittaker"), options=options)
    named = {"temperature_dependent_restitution", *(["velocity_dependent_restitution"] if power else [])}
    assert {one.effect.name for one in found.missing} == named
    assert found.physics is Verdict.EFFECTS
    assert not found.candidates


def bounces(size: int, power: float = 0.0) -> Impacts:
    """A ball that falls from six heights at four temperatures, on both of which its restitution depends."""
    draw = torch.Generator().manual_seed(3)
    height = torch.tensor([0.4, 0.6, 0.8, 1.0, 1.2, 1.5]).double().repeat(size // 6)
    temperature = torch.tensor([18.0, 27.0, 36.0, 45.0]).double().repeat_interleave(6).repeat(size // 24)
    eps = (0.4 + 0.0062 * (temperature - 31)) * ((2 * GRAVITY * height).sqrt() / 4) ** -power
    rebound = eps.square() * height + 0.003 * torch.randn(size, generator=draw, dtype=torch.float64)
    columns = {"height": height, "height_post": rebound, "temperature": temperature}
    frame = pd.DataFrame({name: column.numpy() for name, column in columns.items()})
    shape = {"kind": "disc", "radius": 0.02}
    return table.read(frame, shape=shape, mass=0.024, units={"length": "m"}, covariates=["temperature"]).impacts
