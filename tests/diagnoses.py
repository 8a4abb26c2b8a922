"""Diagnoses that no data gave, for tests of the report."""

from dataclasses import replace

import torch

from contactlearn.diagnosis import result
from contactlearn.diagnosis.search.candidates import all_candidates
from contactlearn.effects import Effect, EffectId, catalogue
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.inference.evaluation.partial_residuals import partial_residuals
from contactlearn.laws import PAPER_LAWS, find
from contactlearn.mechanics.impacts import Impacts
from contactlearn.models.contact_model import ContactModel
from contactlearn.results.types import DataSource, Provenance
from contactlearn.scatter import Normal, Restitution
from contactlearn.simulation import synthetic

ERROR = Interval(0.1, 0.09, 0.11)
SIX = (
    EffectId("surface_tilt", "computed"), EffectId("spin_damping", "after"), EffectId("contact_patch", "linear"),
    EffectId("inertia_error", "uniform"), EffectId("side_drag", "linear"), EffectId("sampling_delay"),
)  # fmt: skip
MOST = 6  # effects in play
TWO_COMPONENTS = Restitution, Normal  # of scatter, where diagnoses are about something else


def few(*names: str) -> dict[EffectId, Effect]:
    """Candidates for what is not about forms: the first form of each effect, since others take as long again."""
    return {forms[0].id: forms[0]() for forms in map(catalogue().__getitem__, names)}


def provenance_of(impacts: Impacts, command: str = "", **config) -> Provenance:
    data = DataSource(source=impacts.source, trials=len(impacts), sha256=impacts.fingerprint())
    return Provenance(data=data, versions={"contactlearn": "0"}, config=config, command=command)


def made_up(size: int, *effects: EffectId) -> result.Diagnosis:
    """A diagnosis with these effects, of which as many as may be are in play, and predictions nothing compresses."""
    shares = result.ErrorShares(noise=1.0, explained=0.0, unnamed=0.0, unexplained=0.0, beyond_rigid=0.0)
    errors = dict.fromkeys(("base", "ceiling", "bound", "named", "flexible", "noise"), ERROR)
    rungs = (result.Rung(kind=result.RungKind.EFFECT, error=ERROR, effect=effect) for effect in effects)
    record = record_of(size, *effects)
    return result.Diagnosis(
        verdict=result.Verdict.EFFECTS, physics=result.Verdict.EFFECTS, law="wang_mason", variant="textbook",
        findings=(),
        laws=tuple(result.LawFit(name=law, variant="textbook", error=0.1, mu=0.1, eps=0.5) for law in PAPER_LAWS),
        missing=tuple(missing(effect, ERROR if k < MOST else None) for k, effect in enumerate(effects)),
        ladder=(result.Rung(kind=result.RungKind.LAW, error=ERROR), *rungs),
        budget=result.ErrorBudget(**errors, noise_source=result.NoiseSource.ESTIMATED, shares=shares),
        choices=result.Choices(effects=effects[:MOST], errors=(ERROR,) * len(record.outcomes)), record=record,
    )  # fmt: skip


def missing(effect: EffectId, reduction: Interval | None = None) -> result.MissingEffect:
    return result.MissingEffect(
        effect=effect, equation="", parameters=(), error_before=ERROR, error_after=ERROR, error_reduction=0.01,
        share=1.0, confidence=1.0, level=result.Level.FOUND, inadmissible_before=0.0, inadmissible_after=0.0,
        reduction_on_all_trials=reduction,
    )  # fmt: skip


def record_of(size: int, *effects: EffectId) -> result.Record:
    impacts = synthetic.load(size=size, seed=0)
    candidates = all_candidates()
    model = ContactModel(
        find("wang_mason").at(0.12, 0.55),
        effects={effect.name: candidates[effect].prepare(impacts) for effect in effects},
    )
    choices = 2 ** min(MOST, len(effects))
    generator = torch.Generator().manual_seed(0)
    noise = torch.randn((choices, len(impacts), 3), generator=generator, dtype=torch.float64)
    return result.Record(
        impacts=impacts, base=replace(model, effects={}), model=model, outcomes=impacts.v_post + noise,
        residuals=tuple(partial_residuals(model, impacts, effect.name) for effect in effects),
    )  # fmt: skip


def remainder(share: Interval, *components: result.WrenchComponent) -> result.Remainder:
    variables = result.VariableShare(symbol="omega", share=0.61), result.VariableShare(symbol="theta", share=0.2)
    named = components or (result.WrenchComponent.MOMENT,)
    return result.Remainder(share=share, large=False, components=named, variables=variables, tested=())
