"""What a diagnosis prints, and its ladder."""

from collections.abc import Sequence
from typing import Any

from matplotlib.figure import Figure

from contactlearn.diagnosis.audit import Finding
from contactlearn.diagnosis.diagnosis import Diagnosis, Missing
from contactlearn.impacts import Impacts
from contactlearn.metrics import HEADLINE, METRICS
from contactlearn.report import style as st
from contactlearn.report.terminal import say

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


def _laws(errors: dict[str, float]) -> None:
    ranked = sorted(errors, key=errors.get)
    first, second = ranked[:2]
    margin = errors[second] / errors[first] - 1
    say(
        f"law: {first} with a held-out mass error of {errors[first]:.4f}, {margin:.1%} below {second}; "
        f"{ranked[-1]} is the worst with {errors[ranked[-1]]:.4f}"
    )


def _regions(regions: Sequence[Any]) -> None:
    for region in regions:
        say(f"where it fails: {region}")
    if not regions:
        say("where it fails: the error is much the same everywhere")


def _law(name: str) -> None:
    say(f"law: with the effects that were found {name} does better, so it is taken")


def _no_formulas(reason: str) -> None:
    say(f"note: no formulas for what remains: {reason}")


_STAGES = {"audit": _audit, "laws": _laws, "regions": _regions, "law": _law, "no formulas": _no_formulas}


def show_verdict(found: Diagnosis, command: str) -> None:
    """Effects one by one, the ladder, the verdict, and what to do next."""
    for missing in found.missing:
        say(_effect(missing))
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
        say(f"  {interval.mean:.4f}  {interval.low:.4f}–{interval.high:.4f}  {step}")
    if found.equation:
        say(found.equation)
    say(f"verdict: {_VERDICTS[found.verdict]}")
    if found.missing:
        say(f"to use it: {command}")


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


def _effect(missing: Missing) -> str:
    values = ", ".join(
        f"{p['symbol']} = {p['value']:.3g} ± {p['standard_error']:.1g}" + ("" if p["unit"] == "–" else f" {p['unit']}")
        for p in missing.parameters.values()
    )
    before, after = missing.error_before.mean, missing.error_after.mean
    return f"missing: {missing.name}, error {before:.4f} → {after:.4f}; {values}"


@st.look()
def ladder(found: Diagnosis) -> Figure:
    """Held-out error of the law, and with effect after effect, with 95 % intervals; the IRB bound as a line."""
    figure = st.new_figure(st.PAGE, 0.9 + 0.25 * len(found.ladder))
    axes = st.name_axes(figure.subplots(), f"{METRICS[HEADLINE].label} ({METRICS[HEADLINE].unit})")
    for place, (_, interval) in enumerate(found.ladder):
        axes.barh(place, interval.mean, color=st.tint(st.CONTRAST[0], 0.45), height=0.6)
        axes.plot((interval.low, interval.high), (place, place), color=st.DARK)
    axes.set_yticks(range(len(found.ladder)), [st.plain(step.replace("_", " ")) for step, _ in found.ladder])
    axes.tick_params(axis="y", length=0)
    axes.invert_yaxis()
    style = st.law_style("irb")
    axes.axvline(found.budget["bound"]["mean"], color=style.color, linestyle=style.linestyle, label=style.label)
    axes.set_xlim(left=0)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center")
    return figure
