"""A diagnosis on the terminal: each stage's result as soon as it is known, and the verdict at the end."""

from collections.abc import Iterable, Sequence

from rich.progress import Progress

from contactlearn.diagnosis.observer import Item, Observer, Step, Task
from contactlearn.diagnosis.result import Diagnosis, ErrorLimits, Finding, LawFit, MissingEffect, Region, Sample
from contactlearn.effects import EffectId
from contactlearn.mechanics.impacts import Impacts
from contactlearn.report.terminal import say
from contactlearn.report.text import base_label, error, headline, rung_label, samples, search, sentence, stages

_TASKS = {
    Task.LAWS: "laws",
    Task.EFFECTS: "effects",
    Task.RIVALS: "rivals of the effects",
    Task.CHOICES: "choices of effects",
}


class TerminalObserver(Observer):
    """Prints each stage; long tasks are counted on a progress display if there is one."""

    def __init__(self, display: Progress | None = None) -> None:
        self._display = display

    def audit(self, findings: Sequence[Finding]) -> None:
        for finding in findings:
            _say_finding("audit", finding)
        if not findings:
            say(f"audit: {stages.CONSISTENT}")

    def step(self, step: Step) -> None:
        say(f"sample: {samples.step(step)}")

    def laws(self, law: str, laws: Sequence[LawFit]) -> None:
        say(f"law: {stages.laws(law, laws)}")

    def left_out(self, candidates: Sequence[EffectId]) -> None:
        say(f"note: {stages.left_out(candidates)}")

    def averaging(self, notes: Sequence[Finding]) -> None:
        for note in notes:
            _say_finding("note", note)

    def limits(self, limits: ErrorLimits) -> None:
        say(f"budget: {stages.limits(limits)}")

    def regions(self, regions: Sequence[Region]) -> None:
        for region in regions:
            say(f"region: {stages.region(region)}")
        if not regions:
            say(f"region: {stages.NO_REGION}")

    def law_changed(self, law: str) -> None:
        say(f"law: {stages.law_changed(law)}")

    def missing(self, effects: Sequence[MissingEffect], regions: Sequence[Region]) -> None:
        for effect in effects:
            say(f"missing: {stages.missing_effect(effect)}")
            for improvement in stages.improvements(effect, regions):
                say(f"  {improvement}")

    def no_formulas(self, reason: str) -> None:
        say(f"note: no formulas for the residual: {reason}")

    def confirmed(self, sample: Sample) -> None:
        for one in samples.summary_of(sample):
            say(f"all trials: {one}")

    def progress(self, task: Task, items: Iterable[Item]) -> Iterable[Item]:
        if self._display is None:
            return items
        return self._display.track(items, description=_TASKS[task])


def show_start(impacts: Impacts) -> None:
    """Print the data of a diagnosis."""
    say(f"{impacts.source}: {len(impacts)} impacts")


def show_verdict(found: Diagnosis, command: str) -> None:
    """Print rivals, the next experiment, the residual, the ladder and the verdict.

    Args:
        found: the diagnosis.
        command: that evaluates the model with the missing effects.
    """
    _show_search(found)
    _show_rivals(found)
    _show_residual(found)
    for rung in found.ladder:
        mean, low, high = map(error, rung.error)
        say(f"  {mean}  {low}–{high}  {rung_label(rung, base_label(found))}")
    if found.budget is not None:
        say(f"budget: {stages.noise(found.budget)} {stages.shares(found.budget)}")
    if found.equation:
        say(found.equation)
    say(f"verdict: {headline(found)}")
    for note in (stages.misfit(found), stages.better_law(found)):
        if note:
            say(f"note: {note}")
    if found.missing:
        say(f"to use it: {command}")


def _show_search(found: Diagnosis) -> None:
    """The best model of each number of effects, and the models that the data do not distinguish."""
    for model in found.frontier:
        say(f"frontier: {search.frontier_line(model)}")
    for model in search.listed_models(found):
        say(f"model: {search.share(model)}  {search.listed_name(found, model)}")
    for note in search.notes(found):
        say(f"note: {note}")


def _show_rivals(found: Diagnosis) -> None:
    """Effects that the data do not distinguish, and the drops that do."""
    for missing in found.missing:
        if missing.rivals:
            say(f"rivals: {stages.rivals(missing)}")
    if found.experiment is not None:
        for drop in found.experiment.drops:
            say(f"next experiment: {stages.drop(drop, found.experiment)}")
        for separation in found.experiment.separations:
            say(f"next experiment: {stages.needed_drops(separation)}")


def _show_residual(found: Diagnosis) -> None:
    """The predictable part of the residual, and formulas for it."""
    if found.remainder is not None:
        say(f"residual: {' '.join(stages.residual(found.remainder))}")
    for formula in found.formulas:
        say(f"formula: {stages.formula_change(formula)}: {stages.formula_overrides(formula)}")


def _say_finding(kind: str, finding: Finding) -> None:
    """A finding, and the correction that is made."""
    note = stages.correction_note(finding)
    say(f"{kind}: {sentence(finding.sentence)} {note}".rstrip())
