"""The result of a diagnosis: everything that is decided, measured and shown, as frozen types.

    Diagnosis       the whole, written as diagnosis.json (docs/results.md) and read back equal
    MissingEffect   an effect of the model that was missing: errors, parameters, regions, rivals
    ErrorBudget     the error of the law in shares of noise, effects and the rest
    Experiment      drops that separate the effects from their rivals
    Remainder       the part of the residual that Gaussian processes still predict
    ContactScatter  what differs from impact to impact at random, or follows a structure that has no name
    Sample          the trials of a large table that were diagnosed, and the test of the answer on all others

All errors are mass errors (dimensionless), on held-out trials unless stated otherwise.  Arrays by trial and fitted
models are no part of the file: they are the `Record` beside it.  No stage of the diagnosis is imported here.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from html import escape

from contactlearn.core.errors import ContactLearnError
from contactlearn.core.serialisation import from_json, to_json
from contactlearn.data.audit.evidence import BalanceEvidence
from contactlearn.data.audit.result import Evidence, Finding
from contactlearn.diagnosis.record import Deviations, Record
from contactlearn.diagnosis.result.effects import (
    FLOORS,
    PROCESSES,
    Candidate,
    Choices,
    Drop,
    Experiment,
    FittedParameter,
    FrontierModel,
    Improvement,
    Level,
    MissingEffect,
    PlausibleModel,
    Region,
    Rival,
    Rung,
    RungKind,
    Separation,
    Verdict,
)
from contactlearn.diagnosis.result.remainder import (
    Coefficient,
    ComponentTest,
    Formula,
    LaggedVariable,
    Remainder,
    SerialDependence,
    StateDependence,
    VariableShare,
    WrenchComponent,
    wrench_columns,
)
from contactlearn.diagnosis.result.sample import Answer, Confirmation, ErrorMap, FailingRegion, Limit, Sample
from contactlearn.diagnosis.result.scatter import ContactScatter, DeviationDependence, ScatterComponent
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.effects import EffectId
from contactlearn.inference.evaluation.impulse_space import LawImpulses
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.inference.identification import joint
from contactlearn.inference.identification.joint import Fit, FitOptions
from contactlearn.laws import Law, find
from contactlearn.mechanics.impacts import Impacts
from contactlearn.models.contact_model import ContactModel

__all__ = [
    "FLOORS", "PROCESSES",
    "Answer", "Candidate", "Choices", "Coefficient", "ComponentTest", "Confirmation", "ContactScatter",
    "DeviationDependence", "Deviations", "Diagnosis", "Drop",
    "ErrorBudget", "ErrorLimits", "ErrorMap", "ErrorShares", "Evidence", "Experiment", "FailingRegion", "Finding",
    "FittedParameter", "Formula", "FrontierModel", "Improvement", "LaggedVariable", "LawFit", "Level", "Limit",
    "MissingEffect", "NoiseSource", "PlausibleModel", "Record", "Region", "Remainder", "Rival", "Rung", "RungKind",
    "Sample", "ScatterComponent", "Separation", "SerialDependence", "StateDependence", "VariableShare",
    "Verdict", "WrenchComponent", "wrench_columns",
]  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class LawFit:
    """A law by name and variant, with the held-out error of it and the given effects.

    `error_with_effects` is that with the missing effects as well; None for a law that these effects do not suit at all.
    `mu` and `eps` are those of the law without any effect, fitted to all trials; `options` its other fields.
    """

    name: str
    variant: str
    error: float
    mu: float
    eps: float
    error_with_effects: float | None = None
    options: dict[str, float | str | bool] = field(default_factory=dict)

    @classmethod
    def of(cls, law: Law, error: float) -> "LawFit":
        """Describe a fitted law."""
        options = {name: x if isinstance(x, str | bool) else float(x) for name, x in law.options.items()}
        return cls(
            name=law.name, variant=law.variant, error=error, mu=float(law.mu), eps=float(law.eps), options=options
        )

    @property
    def least_error(self) -> float:
        """The error alone or with the missing effects, whichever is less."""
        return self.error if self.error_with_effects is None else min(self.error, self.error_with_effects)

    def law(self) -> Law:
        """Rebuild the law.

        Raises:
            UnknownNameError: the law of another package, which has not been imported.
        """
        return find(self.name, self.variant, **self.options).at(self.mu, self.eps)


def clearly_better(laws: Iterable[LawFit], named: float, thresholds: Thresholds) -> LawFit | None:
    """Find the law that does clearly better than the full model with its error `named`; None where none does."""
    limit = (1 - thresholds.form_error) * named
    better = [law for law in laws if law.least_error < limit]
    return min(better, key=lambda law: law.least_error, default=None)


class NoiseSource(StrEnum):
    """The origin of the noise floor: stated noise, covariances of the trials, or differences between similar ones.

    Where scatter of the contact is estimated, the floor is that of instrument and scatter.
    """

    STATED = "stated"
    MEASURED = "measured"
    ESTIMATED = "estimated"
    SCATTER = "scatter"


@dataclass(frozen=True, kw_only=True)
class ErrorLimits:
    """Errors between which an effect can move the model: the law's, the least that is learnable, the rigid bound.

    `base` is the law with the given effects, `ceiling` the same with Gaussian processes of the whole state, `bound`
    the best impulse of a rigid point contact, chosen after the fact.
    """

    base: Interval
    ceiling: Interval
    bound: Interval


@dataclass(frozen=True, kw_only=True)
class ErrorShares:
    """Shares of the law's error, and the bound's excess over noise.

    Effects of the model explain a share, and candidates one that is unnamed so far.  What remains is noise or
    unexplained, both None where the noise floor is unknown.  Noise is that of the instrument and `scatter` of the
    contact, which is None where the two are not told apart.
    """

    noise: float | None
    explained: float
    unnamed: float
    unexplained: float | None
    beyond_rigid: float | None
    scatter: float | None = None

    @property
    def instrument(self) -> float | None:
        """The share of the instrument alone; None where it is one with the scatter, or the floor is unknown."""
        return None if self.noise is None or self.scatter is None else self.noise - self.scatter

    @property
    def parts(self) -> dict[str, tuple[str, float]]:
        """The parts above 0 in words, and their shares, by the kind of their cause."""
        parts = {
            "physics": ("explained by effects", self.explained),
            "unnamed": ("unnamed so far", self.unnamed),
            "unexplained": ("unexplained", self.unexplained),
            "noise": ("noise", self.noise) if self.scatter is None else ("instrument", self.instrument),
            "scatter": ("scatter of the contact", self.scatter),
        }
        return {kind: (name, share) for kind, (name, share) in parts.items() if share is not None and share > 0}

    @property
    def remaining(self) -> float:
        """The share that no effect of the model explains and that is no noise, as far as that is known."""
        return self.unnamed + (self.unexplained or 0.0)


@dataclass(frozen=True, kw_only=True)
class ErrorBudget:
    """`ErrorLimits` with the error of the full model, of processes on top of it, and of noise alone.

    `noise` is None where a model clearly undercuts it; otherwise it is no larger than any other error.  It is that of
    the instrument and the contact's scatter; `instrument` is that of the instrument alone, None where both are one.
    """

    base: Interval
    ceiling: Interval
    bound: Interval
    named: Interval
    flexible: Interval
    noise: Interval | None
    noise_source: NoiseSource
    shares: ErrorShares
    instrument: Interval | None = None

    @property
    def floors_differ(self) -> bool:
        """Whether the instrument alone makes less error than with the contact's scatter, beyond their intervals."""
        return self.instrument is not None and self.noise is not None and self.instrument.high < self.noise.low

    @property
    def reducible(self) -> float:
        """Part of the full model's squared error that something predictable makes, from 0 to 1.

        The geometric mean of two estimates: what exceeds noise and scatter, and what processes on the residual predict
        on held-out trials.  Of few trials the first is too large, of weak dependences the second is too small.
        """
        floors = [floor for floor in (self.noise, self.flexible) if floor is not None]
        excesses = [max(0.0, 1.0 - (floor.mean / self.named.mean) ** 2) if self.named.mean else 0.0 for floor in floors]
        return math.prod(excesses) ** (1 / len(excesses))

    def removed(self, reduction: float) -> float:
        """Squared error that an effect removes, over the full model's, if it reduces the mean error by so much."""
        return (1.0 + reduction / self.named.mean) ** 2 - 1.0 if self.named.mean else math.inf

    @property
    def rungs(self) -> tuple[Rung, ...]:
        """The last rungs of the ladder: processes and, where they are known, noise and its part of the instrument."""
        floors = {RungKind.NOISE: self.noise}
        if self.floors_differ:
            floors = {RungKind.SCATTER: self.noise, RungKind.INSTRUMENT: self.instrument}
        rungs = {RungKind.PROCESSES: self.flexible} | floors
        return tuple(Rung(kind=kind, error=error) for kind, error in rungs.items() if error is not None)


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """The complete result; a diagnosis of refused data has no more than a verdict, a law and findings.

    Args:
        verdict: the conclusion, `bad_data` where the measurements had to be corrected.
        physics: the conclusion about the corrected measurements; None where the data are refused.
        law: name of the law, given or chosen; None where the data are refused before one is chosen.
        variant: of the law.
        given: effects that were in the model from the start.
        findings: of the audit.
        laws: every law that was compared.
        missing: effects that are at least probable, by their error reduction, the largest first.
        candidates: effects that explain a part of the error under uncertain names, likewise.
        ladder: law, effect after effect, processes on the residual, noise.
        budget: the error of the law in parts.
        regions: where the law fails, the surest first.
        coefficients: μ and ε of the law in the full model.
        equation: the full model with parameters and standard errors as it prints itself.  It is stored as text because
            the law or an effect may come from a package that the reader of the file has not installed.
        experiment: drops that separate the effects from their rivals; None without rivals.
        remainder: the predictable part of the residual.
        formulas: for it, the best first.
        scatter: what differs from impact to impact around the full model; None of few or of exact data.
        choices: every subset of the missing effects.
        models: the chosen model and those that the data cannot distinguish from it, by their shares.
        shapeless: candidates that were not compared, because they need the body's shape and it is neither stated nor
            traced by the contact points.
        unwanted: candidates of one's own that were tested, and are in no plausible model and no rival.
        frontier: the best model with each number of effects, from none on.
        hidden: share of the error that another effect of the catalogue could remove, the upper end of the 95 % interval
            of the best one more; None where none was fitted.
        complete: whether the search came to its own end; if not, its time was up.
        sample: the trials of a large table that all this is about, and the test on all others; None where all are.
        thresholds: limits of every decision.
        evidence: of the findings by name, for their figures; no part of the file and of equality.
        record: impacts, models and arrays by trial; no part of the file and of equality.
    """

    verdict: Verdict
    law: str | None
    variant: str | None
    findings: tuple[Finding, ...]
    physics: Verdict | None = None
    given: tuple[EffectId, ...] = ()
    laws: tuple[LawFit, ...] = ()
    missing: tuple[MissingEffect, ...] = ()
    candidates: tuple[Candidate, ...] = ()
    ladder: tuple[Rung, ...] = ()
    budget: ErrorBudget | None = None
    regions: tuple[Region, ...] = ()
    coefficients: tuple[FittedParameter, ...] = ()
    equation: str = ""
    experiment: Experiment | None = None
    remainder: Remainder | None = None
    formulas: tuple[Formula, ...] = ()
    scatter: ContactScatter | None = None
    choices: Choices | None = None
    models: tuple[PlausibleModel, ...] = ()
    shapeless: tuple[EffectId, ...] = ()
    unwanted: tuple[EffectId, ...] = ()
    frontier: tuple[FrontierModel, ...] = ()
    hidden: float | None = None
    complete: bool = True
    sample: Sample | None = None
    thresholds: Thresholds = field(default_factory=Thresholds)
    evidence: Mapping[str, BalanceEvidence] = field(default_factory=dict, compare=False, repr=False)
    record: Record | None = field(default=None, compare=False, repr=False)

    def __repr__(self) -> str:
        """Write what a prompt shows, the story in a line; the fields have the rest."""
        story = [f"verdict={str(self.verdict)!r}", f"law={self.law!r}"]
        for effect in self.missing:
            sure = f"{100 * min(effect.claim_confidence, 0.99):.0f} %"
            story.append(f"{' or '.join(map(str, (effect.effect, *effect.alternatives)))} ({sure})")
        if self.budget is not None:
            story.append(f"error {self.budget.base.mean:.3g} → {self.budget.named.mean:.3g}")
        return f"Diagnosis({', '.join(story)})"

    def _repr_html_(self) -> str:
        """Draw the ladder: a bar for the held-out error of each rung, with its 95 % interval."""
        names = {RungKind.LAW: str(self.law), RungKind.PROCESSES: f"+ {PROCESSES}", **FLOORS}
        largest = max((rung.error.high for rung in self.ladder), default=1.0)
        bar = "<div style='background:#7a9cc6;height:0.8em;width:{:.2f}em'></div>"
        rows = [
            f"<tr><td style='text-align:left'>{escape(names.get(rung.kind, f'+ {rung.effect}'))}</td>"
            f"<td>{rung.error.mean:.3g} [{rung.error.low:.3g}, {rung.error.high:.3g}]</td>"
            f"<td>{bar.format(20 * rung.error.mean / largest)}</td></tr>"
            for rung in self.ladder
        ]
        head = "<tr><th>ladder</th><th>held-out mass error, 95 %</th><th></th></tr>" if rows else ""
        return f"<p>{escape(repr(self))}</p><table>{head}{''.join(rows)}</table>"

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the missing effects, without their forms."""
        return tuple(missing.effect.name for missing in self.missing)

    @property
    def model(self) -> ContactModel:
        """The law with the given and the missing effects, fitted to all impacts, with its contact's scatter.

        Deviations that follow something are scatter to a model that does not know of it.

        Raises:
            ContactLearnError: the data were refused, or the diagnosis was read without its record.
        """
        if self.record is None:
            raise ContactLearnError(f"the diagnosis has no record of its trials, and so no model: {self!r}")
        return self.record.model

    def fit(self, impacts: Impacts | None = None, *, options: FitOptions = FitOptions()) -> Fit:
        """Fit the law with the given and the missing effects again, in their forms, with errors and covariance.

        Args:
            impacts: measurements, corrected as `corrections` say; those of the diagnosis, corrected, if None.
            options: of the fit, such as the noise that the diagnosis was given.

        Raises:
            ContactLearnError: the data were refused, or the diagnosis was read without its record.
            DataError: fewer trials than the parameters need.
        """
        model = self.model
        if impacts is None:
            assert self.record is not None  # or there is no model
            impacts = self.record.impacts
        return joint.fit(impacts, model.law, model.effects, options=options)

    def law_impulses(self) -> LawImpulses:
        """What every law that was compared gives the trials of the record, and can give them.

        Raises:
            ContactLearnError: the data were refused, or the diagnosis was read without its record.
        """
        if self.record is None:
            raise ContactLearnError(f"the diagnosis has no record of its trials, and so no impulses: {self!r}")
        return LawImpulses.of(self.record.impacts, {fit.name: fit.law() for fit in self.laws})

    @property
    def corrections(self) -> tuple[str, ...]:
        """Names of the corrections of all findings, in the order in which they were applied."""
        return tuple(finding.correction for finding in self.findings if finding.correction is not None)

    @property
    def better_law(self) -> LawFit | None:
        """Another law that does clearly better than the full model, alone or with its effects; None where none does."""
        if self.budget is None:
            return None
        others = [law for law in self.laws if law.name != self.law]
        return clearly_better(others, self.budget.named.mean, self.thresholds)

    @property
    def simpler(self) -> FrontierModel | None:
        """The smallest model with fewer effects whose error is higher by no more than a wrong form may make it.

        None where every effect makes more, or none is missing.
        """
        if not self.missing or self.budget is None:
            return None
        limit = (1 + self.thresholds.form_error) * self.budget.named.mean
        near = [m for m in self.frontier if len(m.effects) < len(self.missing) and m.error.mean <= limit]
        return min(near, key=lambda model: len(model.effects), default=None)

    def without_record(self) -> "Diagnosis":
        """The diagnosis as it is written to a file."""
        return replace(self, record=None, evidence={})

    def to_json(self) -> str:
        """Encode all but the record as JSON.

        Raises:
            ContactLearnError: a number is not finite.
        """
        return to_json(self.without_record())

    @classmethod
    def from_json(cls, text: str | bytes) -> "Diagnosis":
        """Decode what `to_json` wrote; the record is read by `Record.load`.

        Raises:
            ContactLearnError: the entry that breaks a rule.
        """
        return from_json(cls, text)
