"""What a diagnosis prints."""

from collections.abc import Sequence
from typing import Any

from contactlearn.audit.result import Finding
from contactlearn.diagnosis.noise import HOW
from contactlearn.diagnosis.pipeline import Diagnosis
from contactlearn.diagnosis.search.ladder import Missing
from contactlearn.impacts import Impacts
from contactlearn.report.terminal import say

_OFF = 1.4  # times the stated noise
_VERDICTS = {
    "effects": "physical effects are missing",
    "none": "nothing is missing that these data could show",
    "unknown": "something is missing that none of the known effects explains",
    "bad_data": "the data contradict themselves",
}


def show_start(impacts: Impacts) -> None:
    """What is diagnosed."""
    say(f"{impacts.source}: {len(impacts)} impacts")


def show_stage(stage: str, result: Any) -> None:
    """A stage's result as soon as it is known."""
    if stage in _STAGES:
        _STAGES[stage](result)


def _audit(findings: Sequence[Finding]) -> None:
    if not findings:
        say("audit: the measurements are consistent with planar rigid impacts")
    for finding in findings:
        fix = f"; corrected from here on, as data.correct=[{finding.correction}] does" if finding.correction else ""
        say(f"audit: {finding.sentence}{fix}")


def _laws(result: tuple[str, dict[str, float]]) -> None:
    law, errors = result
    ranked = sorted(errors, key=errors.get)
    best, worst = ranked[0], ranked[-1]
    line = f"law: {law} leaves a held-out mass error of {_number(errors[law])}"
    if law == best:
        margin = errors[ranked[1]] / errors[law] - 1
        line += f", {margin:.1%} below {ranked[1]}; {worst} is the worst with {_number(errors[worst])}"
    else:
        line += f", as given; {best} would leave {_number(errors[best])}, {errors[law] / errors[best]:.1f} times less"
    say(line)


def _notes(notes: Sequence[Finding]) -> None:
    for note in notes:
        say(f"note: {note.sentence}; done from here on, as data.correct=[{note.correction}] does")


def _regions(regions: Sequence[Any]) -> None:
    for region in regions:
        say(f"where it fails: {region}")
    if not regions:
        say("where it fails: the error is much the same everywhere")


def _budget(budget: dict[str, dict]) -> None:
    base, ceiling, bound = (budget[key]["mean"] for key in ("base", "ceiling", "bound"))
    learned = f"take it to {_number(ceiling)}" if ceiling < base else "find nothing more"
    say(
        f"budget: the law leaves {_number(base)}; Gaussian processes that see the whole state {learned}; "
        f"the best impulse of a rigid point contact, chosen after the fact, leaves {_number(bound)}"
    )


def _left_out(names: Sequence[str]) -> None:
    say(f"left out, for want of a body's shape or of ten trials a parameter: {', '.join(names)}")


def _missing(effects: Sequence[Missing]) -> None:
    for missing in effects:
        say(_effect(missing))


def _law(name: str) -> None:
    say(f"law: with the effects that were found {name} does better, so it is taken")


def _no_formulas(reason: str) -> None:
    say(f"note: no formulas for what remains: {reason}")


_STAGES = {
    "audit": _audit,
    "laws": _laws,
    "left out": _left_out,
    "notes": _notes,
    "regions": _regions,
    "budget": _budget,
    "law": _law,
    "missing": _missing,
    "no formulas": _no_formulas,
}


def show_verdict(found: Diagnosis, command: str) -> None:
    """What cannot be told apart, what remains, the ladder, the verdict, and what to do next."""
    for name, others in found.equivalents.items():
        for other in others:
            say(f"cannot be told apart here: {name} and {other}")
    if found.experiment is not None:
        for drop in found.experiment.drops:
            say(f"next experiment: {drop}")
        for rival, needed in found.experiment.needed.items():
            enough = f"about {needed} drops like these would rule out" if needed else "no drops within reach rule out"
            say(f"{enough} {rival}")
    if found.remainder is not None:
        _remainder(found)
    for step, interval in found.ladder:
        say(f"  {_number(interval.mean)}  {_number(interval.low)}–{_number(interval.high)}  {step}")
    if "shares" in found.budget:
        _shares(found)
    if found.equation:
        say(found.equation)
    say(f"verdict: {_verdict(found)}")
    best = min(found.laws, key=found.laws.get, default=found.law)
    if found.physics == "unknown" and found.laws[best] < found.budget["named"]["mean"]:
        say(f"{best} alone leaves {_number(found.laws[best])}, less than {found.law} with all this: try law={best}")
    if found.missing:
        say(f"to use it: {command}")


def _verdict(found: Diagnosis) -> str:
    if found.verdict != "bad_data" or found.physics is None:
        return _VERDICTS[found.verdict]
    return f"{_VERDICTS['bad_data']}; corrected, {_VERDICTS[found.physics]}"


def _shares(found: Diagnosis) -> None:
    shares, noise = found.budget["shares"], found.budget["noise"]
    say(
        f"of the error {shares['explained']:.0%} is explained by the effects, {min(1, shares['noise']):.0%} is noise "
        f"({_number(noise['mean'])}, {noise['how']}), {shares['left']:.0%} is left; {shares['beyond_rigid']:.0%} more "
        "than noise is out of reach of any rigid point contact"
    )
    factor = found.budget["named"]["mean"] / noise["mean"] if noise["mean"] else 1.0
    if noise["how"] == HOW["stated"] and (factor < 1 / _OFF or (factor > _OFF and not found.remainder.found)):
        say(f"note: what is left is {factor:.2g} times what the stated noise would make; is that in m/s and rad/s?")


def _remainder(found: Diagnosis) -> None:
    """What flexible processes still take off, in which component, and by what."""
    left = found.remainder
    if not left.found:
        say("what remains: nothing that Gaussian processes could predict")
        return
    components = ", ".join({"t": "P_t", "n": "P_n", "tau": "τ"}[name] for name in left.components)
    matter = ", ".join(f"{name} {share:.0%}" for name, share in left.variables.items())
    say(
        f"what remains: Gaussian processes take {left.share.mean:.0%} ({left.share.low:.0%} to {left.share.high:.0%}) "
        f"more off the error, in {components}; it depends on {matter}"
    )
    for one in found.formulas:
        say(f"a formula for it: {one}")


def _number(error: float) -> str:
    """Four decimals, or two digits of what would be none."""
    return f"{error:.4f}" if error >= 1e-3 or error == 0 else f"{error:.2g}"


def _effect(missing: Missing) -> str:
    values = ", ".join(
        f"{p['symbol']} = {p['value']:.3g} ± {p['standard_error']:.1g}" + ("" if p["unit"] == "–" else f" {p['unit']}")
        for p in missing.parameters.values()
    )
    before, after = missing.error_before.mean, missing.error_after.mean
    line = f"missing: {missing.id}, error {_number(before)} → {_number(after)}; {values}"
    if missing.inadmissible[1] > missing.inadmissible[0]:
        line += f"; {missing.inadmissible[1]:.1%} of its impulses gain energy, pull or penetrate"
    return line + "".join(f"\n  it helps where {region}" for region in missing.helps)
