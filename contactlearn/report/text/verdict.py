"""The conclusion of a diagnosis: a clause, a headline, the sentence behind it, and a summary with its numbers."""

from collections.abc import Sequence

from contactlearn.core.numerics import measured
from contactlearn.diagnosis.result import Diagnosis, ErrorShares, MissingEffect, RungKind, Verdict
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.report.text import stages
from contactlearn.report.text.names import base_label, effect_label, listed, opened, sentence, shortened
from contactlearn.report.text.numbers import compared, error, fine_percent, interval, percent
from contactlearn.report.text.serial_dependence import follows
from contactlearn.report.text.state_dependence import depends

VERDICTS = {
    Verdict.EFFECTS: "effects are missing",
    Verdict.NONE: "no missing effect is detectable",
    Verdict.UNKNOWN: "an unknown effect is missing",
    Verdict.UNFINISHED: "something is missing, and the search ran out of time",
    Verdict.BAD_DATA: "the measurements are inconsistent",
}
"""Each verdict in a clause."""

_RIVALS = 2  # that a headline names
_TINY = 0.001  # of the law's error, below which a headline gives no size


def conclusion(verdict: Verdict, physics: Verdict | None, corrections: Sequence[str] = ()) -> str:
    """Write a verdict in a clause; of corrected data also the conclusion about them.

    Args:
        verdict: of the diagnosis.
        physics: the conclusion about the corrected data; None where they are refused.
        corrections: names of the corrections.
    """
    if verdict is not Verdict.BAD_DATA or physics is None:
        return VERDICTS[verdict]
    said = f"the data were corrected ({', '.join(corrections)})" if corrections else VERDICTS[verdict]
    return f"{said}; {VERDICTS[physics]}"


def headline(found: Diagnosis) -> str:
    """Write the verdict in one line."""
    law = base_label(found)
    if any(finding.fatal for finding in found.findings):
        return "The measurements are inconsistent, and no known correction resolves this."
    effects = listed(effect_label(one.effect) for one in found.missing) if found.missing else ""
    return f"{_finding(found, law, effects)}{_doubt(found)}"


def _finding(found: Diagnosis, law: str, effects: str) -> str:
    """The missing effects, or their absence, with what else the data show."""
    predictable = found.remainder is not None and found.remainder.found
    verb = "is" if len(found.missing) == 1 else "are"
    if found.physics == Verdict.UNKNOWN:
        known = f" {opened(effects)} {verb} missing as well{_rivals(found.missing)}." if effects else ""
        if found.better_law is not None:
            return f"{law} does not describe these data: {stages.better_law(found)}{known}"
        if effects and found.budget is not None and found.budget.shares.explained > found.budget.shares.unexplained:
            rest = _unexplained(found, "no effect in the catalogue explains the rest")
            known = f"{opened(effects)} {verb} missing from {law}{_rivals(found.missing)}"
            return f"{known}, and so is something unknown{_size_of(found.budget.shares)}: {rest}."
        rest = _unexplained(found, "no effect in the catalogue explains its error")
        return f"An unknown effect is missing from {law}: {rest}.{known}"
    if found.physics == Verdict.UNFINISHED:
        besides = f"{opened(effects)} {verb} missing from {law}, and so is something else" if effects else ""
        return f"{besides or f'Something is missing from {law}'}; the search ran out of time before identifying it."
    if effects:
        rest = "; no known effect explains the predictable part of the residual" if predictable else ""
        return f"{opened(effects)} {verb} missing from {law}{_rivals(found.missing)}{rest}."
    if predictable:
        return f"No known effect is missing from {law}, but a small part of its residual is predictable."
    return f"These data show no effect missing from {law}."


def _size_of(shares: ErrorShares) -> str:
    """The unexplained part, behind its mention; empty where noise alone is as large as what is left."""
    if not shares.unexplained:
        return ""
    size = fine_percent(shares.unexplained) if shares.unexplained >= _TINY else f"less than {percent(_TINY, 1)}"
    return f", {size} of the law's error"


def _unexplained(found: Diagnosis, said: str) -> str:
    """What is unknown: what follows the sequence or depends on the state where that is large, and what is said."""
    left = found.remainder
    clauses = []
    if left is not None and left.serial_dependence is not None and left.serial_dependence.large:
        clauses.append(follows(left.serial_dependence))
    if left is not None and left.state_dependence is not None and left.state_dependence.large:
        clauses.append(depends(left.state_dependence))
    return listed([*clauses, said])


def _rivals(missing: Sequence[MissingEffect]) -> str:
    """The rivals of the effects, behind their names."""
    said = ""
    for one in missing:
        others = shortened([effect_label(other.effect) for other in one.rivals], _RIVALS, "effect")
        if others:
            said += f"; these data cannot distinguish {effect_label(one.effect)} from {listed(others, 'or')}"
    return said


def _doubt(found: Diagnosis) -> str:
    """The audit's opinion of the data, behind a headline."""
    if found.corrections:
        return " The data were corrected first."
    return " The audit questions the data." if any(finding.mistake for finding in found.findings) else ""


def support(found: Diagnosis) -> str:
    """Write what a headline rests on in one sentence; empty for data that were refused."""
    if not found.ladder or found.budget is None:
        return ""
    before, noise = found.ladder[0].error.mean, found.budget.noise.mean
    floor = f"noise alone accounts for {error(noise)}"
    if not found.missing:
        return f"{base_label(found)} has a held-out mass error of {error(before)}; {floor}."
    after, sure = _after(found).mean, listed(confidence(one) for one in found.missing)
    names = "the name is correct" if len(found.missing) == 1 else "the names are correct"
    falls = f"The held-out mass error falls from {error(before)} to {error(after)}, {compared(after, before)}"
    return f"{falls}, and {floor}; {names} with a probability of {sure}."


def confidence(missing: MissingEffect) -> str:
    """Write the probability that a name is right, calibrated on planted data, which tell no more than 99 %."""
    return percent(min(missing.confidence, 0.99))


def summary(found: Diagnosis) -> list[str]:
    """Write the numbers behind a verdict, a sentence each."""
    if not found.ladder:
        return [sentence(finding.sentence) for finding in found.findings if finding.fatal]
    said = [f"{base_label(found)} has a held-out mass error of {interval(found.ladder[0].error)}.", *_reduction(found)]
    said += [_size(missing) for missing in found.missing if missing.parameters]
    if found.remainder is not None:
        said += stages.residual(found.remainder)
        said += [f"The best formula for the residual: {stages.formula_change(one)}." for one in found.formulas[:1]]
    if found.budget is not None:
        said.append(stages.noise(found.budget))
    said += [one for one in (stages.better_law(found), stages.worst_region(found)) if one]
    return said + _confused(found)


def _reduction(found: Diagnosis) -> list[str]:
    """The error with the missing effects."""
    if not found.missing:
        return []
    before, after = found.ladder[0].error, _after(found)
    these = "This effect reduces" if len(found.missing) == 1 else f"These {len(found.missing)} effects reduce"
    share = 1 - after.mean / before.mean if before.mean else 0.0
    return [f"{these} it to {interval(after)}: an error reduction of {percent(share)}."]


def _after(found: Diagnosis) -> Interval:
    """The error with all missing effects."""
    return next(rung.error for rung in reversed(found.ladder) if rung.kind is RungKind.EFFECT)


def _size(missing: MissingEffect) -> str:
    """An effect with the first of its parameters."""
    first = missing.parameters[0]
    size = measured(first.value, first.standard_error, first.unit)
    return f"{opened(effect_label(missing.effect))}: {first.symbol} = {size}."


def _confused(found: Diagnosis) -> list[str]:
    """The effects that have rivals, and whether an experiment helps."""
    names = [effect_label(missing.effect) for missing in found.missing if missing.rivals]
    if not names:
        return []
    decided = found.experiment is not None and any(one.drops_needed for one in found.experiment.separations)
    help_ = "; the next experiment distinguishes them" if decided else ""
    return [f"These data cannot distinguish {listed(names)} from other effects{help_}."]
