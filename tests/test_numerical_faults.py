"""Measurements that break numerics: a right answer or a clear refusal, never a number that is none.

Faults by functions in one table, on a few trials each; and the same drops of another mass and size, whose answers are
the same.  All effects were tried on all faults by hand; here are those of each place that divide, take powers or roots.
"""

import math
import warnings
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from functools import cache
from typing import Any

import pytest
import torch
from diagnoses import few
from pairings import paired
from torch import Tensor

from contactlearn import diagnose, laws
from contactlearn.core.errors import ContactLearnError
from contactlearn.data.audit.findings import audit
from contactlearn.diagnosis.options import DiagnoseOptions
from contactlearn.effects import find_effect
from contactlearn.inference.evaluation import bounds, metrics
from contactlearn.inference.evaluation.partial_residuals import partial_residuals
from contactlearn.inference.identification import joint
from contactlearn.inference.identification.joint import FitOptions
from contactlearn.inference.identification.per_trial import fit_trials
from contactlearn.inference.identification.problem import suited
from contactlearn.inference.identification.shared import fit_subsets
from contactlearn.inference.learning.recipe import Recipe, learn
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.shapes import Disc, Ellipse
from contactlearn.models.contact_model import ContactModel
from contactlearn.simulation import synthetic

SIZE = 12
SAME = 1e-6
"""Relative: digits that iterations may lose in another unit."""
DISC = {"kind": "disc", "radius": 0.03}


def exact(**settings) -> Impacts:
    return synthetic.load(size=SIZE, velocity_noise=0.0, spin_noise=0.0, **settings)


def copied(drops: Impacts, times: int, jitter: float = 0.0) -> Impacts:
    rows = torch.arange(len(drops)).repeat(times)
    parts = {name: getattr(drops, name)[rows] for name in ("mass", "inertia", "r", "q", "v_pre", "v_post")}
    noise = torch.randn(parts["v_pre"].shape, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    return Impacts(**parts | {"v_pre": parts["v_pre"] + jitter * noise}, shape=drops.shape)


def vertical(noise: float = 0.0) -> Impacts:
    """Discs that fall straight down without spin: no slip, no lever, no friction to be seen."""
    v = torch.zeros(SIZE, 3, dtype=torch.float64)
    v[:, 1] = -torch.linspace(1, 2, SIZE, dtype=torch.float64)
    errors = noise * torch.randn(v.shape, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    mass, below = torch.full((SIZE,), 0.05, dtype=torch.float64), torch.tensor([0.0, -0.03], dtype=torch.float64)
    pose = torch.tensor([0.0, 0.03, 0.0], dtype=torch.float64)
    return Impacts(
        mass=mass, inertia=mass * 0.03**2 / 2, r=below.expand(SIZE, 2), q=pose.expand(SIZE, 3), v_pre=v,
        v_post=-0.5 * v + errors, shape=Disc(0.03),
    )  # fmt: skip


def of_all_masses() -> Impacts:
    drops, factor = synthetic.load(size=SIZE), 10 ** torch.linspace(-6, 6, SIZE, dtype=torch.float64)
    return drops.replace(mass=drops.mass * factor, inertia=drops.inertia * factor)


def grazing() -> Impacts:
    drops = synthetic.load(size=SIZE, shape=DISC)
    return drops.replace(v_pre=drops.v_pre * torch.tensor([1, 1e-9, 0], dtype=torch.float64))


FAULTS: dict[str, Callable[[], Impacts]] = {
    "duplicate trials": lambda: copied(synthetic.load(size=SIZE // 2), 2),
    "one trial, repeated": lambda: copied(synthetic.load(size=1), SIZE),
    "nearly one trial": lambda: copied(synthetic.load(size=1), SIZE, 1e-12),
    "all stick": lambda: exact(mu=5.0),
    "no friction": lambda: exact(mu=0.0),
    "no restitution": lambda: exact(eps=0.0),
    "no noise": exact,
    "vertical": vertical,
    "vertical, with noise": lambda: vertical(0.01),
    "discs": lambda: synthetic.load(size=SIZE, shape=DISC),
    "one trial": lambda: synthetic.load(size=1),
    "two trials": lambda: synthetic.load(size=2),
    "at rest afterwards": lambda: exact().replace(v_post=0 * exact().v_post),
    "nothing happens": lambda: exact().replace(v_post=exact().v_pre),
    "masses over twelve decades": of_all_masses,
    "grazing": grazing,
    "needles": lambda: synthetic.load(size=SIZE, shape={"kind": "ellipse", "semi_axes": [1.0, 1e-6]}),
}
EFFECTS = {
    "com_offset": None, "velocity_dependent_friction": "stribeck", "velocity_dependent_restitution": None,
    "location_dependent_friction": None, "tangential_restitution": None, "adhesion": None, "spin_damping": None,
}  # fmt: skip
ROUTH = laws.find("wang_mason")


def with_laws(drops: Impacts) -> Iterator[Any]:
    for family in laws.catalogue().values():
        for kind in family.values():
            for mu, eps in ((0.0, 0.0), (0.2, 0.5), (50.0, 1.0)):
                yield kind().at(mu, eps).impulse(drops.W, drops.v_c)


def with_identification(drops: Impacts) -> Iterator[Any]:
    for name in laws.names():
        law = laws.find(name)
        fit = fit_subsets(drops, law, sizes=(len(drops),), repetitions=1)
        yield fit
        for mu, eps in ((fit.mu, fit.eps), (fit.mu_range, fit.eps_range)):
            assert (mu >= 0).all()
            assert ((eps >= 0) & (eps <= 1)).all()
        yield fit_trials(drops, law)


def with_bounds(drops: Impacts) -> Iterator[Any]:
    models = {name: ContactModel(laws.find(name).at(0.2, 0.5)).predict(drops) for name in laws.PAPER_LAWS}
    for norm in ("mass", "euclidean"):
        yield bounds.irb(drops, norm)
        yield bounds.irb(drops, norm, patch=0.01)
        yield bounds.best_post_hoc(drops, models, norm)


def with_effects(drops: Impacts) -> Iterator[Any]:
    for name, form in EFFECTS.items():
        try:
            fit = joint.fit(drops, ROUTH, {name: find_effect(name, form)()}, options=FitOptions(starts=2))
        except ContactLearnError:  # too few trials
            yield from ()
        else:
            low, high = torch.tensor([(p.low, p.high) for p in fit.parameters], dtype=torch.float64).T
            assert ((low <= fit.values) & (fit.values <= high)).all()
            yield from (fit.values, fit.standard_errors, fit.at_bounds(), fit.trade_offs(), fit.model.predict(drops))
            yield partial_residuals(fit.model, drops, name)


def with_learned_models(drops: Impacts) -> Iterator[Any]:
    rows = torch.arange(len(drops))
    for space, target in (("state", "velocity"), ("x1", "wrench"), ("x2", "impulse"), ("x2", "parameters_identified")):
        law = ROUTH.at(0.2, 0.5) if target.startswith("parameters") else None
        try:
            yield learn(drops, Recipe(space, target, law), rows=rows, base=law).predict(drops)
        except ContactLearnError:  # one trial
            yield from ()


def with_audit(drops: Impacts) -> Iterator[Any]:
    yield [[one.value for one in finding.evidence] for finding in audit(drops)]


FUNCTIONS = (with_laws, with_identification, with_bounds, with_effects, with_learned_models, with_audit)


def numbers(value: Any) -> Iterator[Tensor]:
    """Every number in a result."""
    if isinstance(value, Tensor):
        yield value.detach()
    elif isinstance(value, float):
        yield torch.tensor(value)
    elif is_dataclass(value):
        for field in fields(value):
            yield from numbers(getattr(value, field.name))
    elif isinstance(value, dict):
        for part in value.values():
            yield from numbers(part)
    elif isinstance(value, list | tuple):
        for part in value:
            yield from numbers(part)


@pytest.mark.parametrize(("fault", "function"), paired([*FAULTS], {one.__name__: one for one in FUNCTIONS}))
def test_answers_are_numbers(fault, function):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for result in function(FAULTS[fault]()):
            for number in numbers(result):
                assert number.isfinite().all() if number.is_floating_point() else True


SCALES = {
    "1 mg, 1 mm": (1e-6 / 0.0364, 1e-3 / 0.03), "1000 t, 1 km": (1e6 / 0.0364, 1e3 / 0.03),
    "1000 t, 1 mm": (1e6 / 0.0364, 1e-3 / 0.03), "1 mg, 1 km": (1e-6 / 0.0364, 1e3 / 0.03),
}  # fmt: skip
ALIKE = ("1000 t, 1 mm", "1 mg, 1 km")  # each end of mass and of length is in the others


def scaled(drops: Impacts, mass: float, length: float) -> Impacts:
    """Times as they are: velocities go with the lengths, spins stay."""
    factor = torch.tensor([length, length, 1.0], dtype=torch.float64)
    a, b = drops.shape.semi_axes
    return drops.replace(
        mass=drops.mass * mass, inertia=drops.inertia * mass * length**2, r=drops.r * length, q=drops.q * factor,
        v_pre=drops.v_pre * factor, v_post=drops.v_post * factor, shape=Ellipse((a * length, b * length)), q_post=None,
    )  # fmt: skip


def measures(drops: Impacts, mass: float = 1.0, length: float = 1.0) -> dict[str, Tensor]:
    """Numbers without unit, which may not depend on the units of mass and length."""
    found: dict[str, Tensor] = {}
    for name in laws.names():
        law = laws.find(name)
        found[f"impulse {name}"] = law.at(0.2, 0.5).impulse(drops.W, drops.v_c) / mass / length
        fit, trials = fit_subsets(drops, law, sizes=(len(drops),), repetitions=1), fit_trials(drops, law)
        found[f"shared {name}"] = torch.cat((fit.mu, fit.eps, fit.cost / mass / length))
        found[f"trials {name}"] = torch.cat((trials.error / mass / length, trials.flat.double()))
    for patch in (0.0, 0.01):
        found[f"bound {patch}"] = metrics.mass_error(drops, bounds.irb(drops, patch=patch * length))
    for name in ("com_offset", "spin_damping", "adhesion", "side_drag"):
        fit = joint.fit(drops, ROUTH, {name: find_effect(name)()}, options=FitOptions(starts=2))
        found[f"with {name}"] = torch.cat((fit.values[:2], metrics.mass_error(drops, fit.model.predict(drops))))
    rows = torch.arange(len(drops))
    for space, target in (("x1", "wrench"), ("state", "velocity")):
        predicted = learn(drops, Recipe(space, target), rows=rows).predict(drops)
        found[f"learned {target}"] = metrics.mass_error(drops, predicted)
    return found


@cache
def as_they_are() -> tuple[Impacts, dict[str, Tensor]]:
    drops = synthetic.load(size=SIZE)
    return drops, measures(drops)


@pytest.mark.parametrize(("mass", "length"), SCALES.values(), ids=SCALES)
def test_mass_and_size_change_nothing_but_units(mass, length):
    drops, expected = as_they_are()
    for name, value in measures(scaled(drops, mass, length), mass, length).items():
        tolerance = 1e-3 if name.startswith("with ") else SAME  # a fit stops at a small step
        torch.testing.assert_close(value, expected[name], rtol=tolerance, atol=tolerance, msg=name)


def test_ranges_go_with_the_body():
    """Of a tiny slow body, and of a huge fast one, a range is no larger and no smaller than usual beside the body."""
    drops = synthetic.load(size=SIZE)
    for name, form in (("velocity_dependent_friction", "stribeck"), ("com_offset", None), ("adhesion", None)):
        parameters = find_effect(name, form)().parameters
        assert suited(parameters, drops) == parameters
        for mass, length in SCALES.values():
            for p, one in zip(parameters, suited(parameters, scaled(drops, mass, length)), strict=True):
                unit = {"m": length, "m/s": length, "N s": mass * length, "J": mass * length**2}.get(p.unit, 1.0)
                assert one.low <= one.start <= one.high
                assert abs(math.log10((one.high - one.low) / (p.high - p.low) / unit)) <= 4


@pytest.mark.nightly
def test_the_diagnosis_names_the_same():
    """A planted effect has its name, whatever the units."""
    drops = synthetic.load(size=60, seed=2)
    true = ContactModel(ROUTH.at(0.12, 0.55), effects={"": find_effect("spin_damping")().at([0.4])})
    noise = torch.randn(60, 3, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    drops = drops.replace(v_post=true.predict(drops).v_post + noise * torch.tensor([0.01, 0.01, 0.3]))
    three, named = few("spin_damping", "com_offset", "adhesion"), []
    for mass, length in ((1.0, 1.0), SCALES["1 mg, 1 mm"]):
        found = diagnose(scaled(drops, mass, length), ROUTH, options=DiagnoseOptions(candidates=three, laws=[ROUTH]))
        named.append([one.effect for one in found.missing])
    assert named[0] == named[1]
    assert [one.name for one in named[0]] == ["spin_damping"]


def test_a_diagnosis_is_complete():
    """Its JSON holds no number that is none: `to_json` refuses those."""
    drops = copied(FAULTS["vertical"](), 2, 1e-3)
    assert diagnose(
        drops,
        ROUTH,
        options=DiagnoseOptions(candidates=few("spin_damping", "tangential_restitution"), laws=[ROUTH], seconds=5),
    ).to_json()


@pytest.mark.parametrize("fault", ["one trial", "one trial, repeated"])
def test_a_diagnosis_of_one_trial_is_refused(fault):
    with pytest.raises(ContactLearnError, match="at least 20 trials, got 1"):
        diagnose(FAULTS[fault](), ROUTH)
