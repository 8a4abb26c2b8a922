"""The result of each stage of a diagnosis in sentences, as the terminal prints them and the page shows them."""

import math
from collections.abc import Sequence

from contactlearn.core.numerics import measured, number
from contactlearn.diagnosis.result import (
    Diagnosis,
    Drop,
    ErrorBudget,
    ErrorLimits,
    Experiment,
    Finding,
    Formula,
    Improvement,
    LawFit,
    MissingEffect,
    NoiseSource,
    Region,
    Remainder,
    Separation,
)
from contactlearn.diagnosis.thresholds import NoiseThresholds
from contactlearn.effects import EffectId
from contactlearn.effects.formula.symbols import SYMBOLS
from contactlearn.report.text.names import (
    NOISE_SOURCES,
    WRENCH,
    base_label,
    effect_label,
    law_label,
    listed,
    opened,
)
from contactlearn.report.text.numbers import (
    compared,
    error,
    interval,
    p_value,
    percent,
    share_interval,
    share_of_whole,
    spaced,
    times,
)
from contactlearn.report.text.serial_dependence import serial_dependence
from contactlearn.report.text.state_dependence import state_dependence

CONSISTENT = (
    "The measurements are consistent with planar rigid impacts; there are too few trials to check units and axes."
)
NO_REGION = "No region has a significantly higher error than the rest."
NOT_PREDICTABLE = "Gaussian processes predict no component of the residual significantly on held-out trials."
NO_EFFECT = "No effect in the catalogue reduces the held-out error enough to be named."


# --- Audit, laws, limits --------------------------------------------------------------------------


def correction_note(finding: Finding) -> str:
    """Say that a correction is made, and how to make it elsewhere; empty where none is."""
    if finding.correction is None:
        return ""
    setting = f"data.correct=[{finding.correction}]"
    return f"The data are corrected from here on; {setting} applies the same correction in any command."


def correct_setting(made: Sequence[str], findings: Sequence[Finding]) -> str:
    """Write the setting with the corrections that were made and those of the findings; empty where these have none."""
    names = [finding.correction for finding in findings if finding.correction]
    return f"data.correct=[{','.join([*made, *names])}]" if names else ""


def laws(law: str, fits: Sequence[LawFit]) -> str:
    """Compare the law that was chosen or given with the others."""
    ranked = sorted(fits, key=lambda one: one.error)
    chosen = next(one for one in fits if one.name == law)
    best, worst = ranked[0], ranked[-1]
    said = f"{law_label(law)} has a held-out mass error of {error(chosen.error)}"
    if chosen is not best:
        return f"{said}, {law_label(best.name)} {error(best.error)}, {compared(best.error, chosen.error)}."
    if len(ranked) == 1:
        return f"{said}."
    return (
        f"{said}, {compared(chosen.error, ranked[1].error)} than {law_label(ranked[1].name)}; "
        f"{law_label(worst.name)} has the largest, {error(worst.error)}."
    )


def law_changed(law: str) -> str:
    """Say that another law replaces the first choice."""
    return f"Together with effects, {law_label(law)} has the lowest held-out error and replaces the first choice."


def left_out(candidates: Sequence[EffectId]) -> str:
    """Name the candidates that are not tested."""
    names = listed(effect_label(one) for one in candidates)
    return f"Not tested, because they need the body's shape or ten trials per parameter: {names}."


def limits(found: ErrorLimits) -> str:
    """Say between which errors an effect can move the model."""
    base, ceiling, bound = found.base.mean, found.ceiling.mean, found.bound.mean
    learned = f"reduce it to {error(ceiling)}" if ceiling < base else "do not reduce it"
    return (
        f"The law has an error of {error(base)}; Gaussian processes of the full state {learned}; "
        f"the ideal rigid-body bound (IRB) is {error(bound)}."
    )


# --- Regions and effects --------------------------------------------------------------------------


def region(found: Region) -> str:
    """Describe a region by its window, its error and the certainty of it."""
    return f"{found.where}: {region_error(found)}"


def region_error(found: Region) -> str:
    """Compare the error of a region with that of the rest."""
    ratio = found.ratio.mean
    return f"error {times(ratio)} that of the rest, {found.trials} trials, {p_value(found.p_value)}"


def missing_effect(found: MissingEffect) -> str:
    """Say the errors before and after an effect, its parameters, and the inadmissible impulses that come with it."""
    before, after = error(found.error_before.mean), error(found.error_after.mean)
    said = f"{effect_label(found.effect)}: held-out error {before} → {after}"
    if found.parameters:
        said += f"; {parameters(found)}"
    return said + (f"; {inadmissible(found)}" if inadmissible(found) else "")


def parameters(found: MissingEffect) -> str:
    """List the parameters of an effect with standard errors and units."""
    values = (f"{p.symbol} = {measured(p.value, p.standard_error, p.unit)}" for p in found.parameters)
    return ", ".join(values)


def inadmissible(found: MissingEffect) -> str:
    """Say how many impulses are inadmissible with an effect, where they are more than without it."""
    if found.inadmissible_after <= found.inadmissible_before:
        return ""
    return (
        f"with this effect {percent(found.inadmissible_after, 1)} of the impulses gain energy, pull or penetrate, "
        f"without it {percent(found.inadmissible_before, 1)}"
    )


def improvements(found: MissingEffect, regions: Sequence[Region]) -> list[str]:
    """Say in which regions an effect reduces the error."""
    pairs = zip(regions, found.improvements, strict=True) if found.improvements else ()
    return [improvement(where, change) for where, change in pairs if change.helped]


def improvement(where: Region, change: Improvement) -> str:
    """Compare the error of a region, and of the rest, before and after an effect."""
    inside = f"{number(change.before, 3)} → {number(change.after, 3)}"
    return spaced(
        f"{where.where}: error {inside} (rest {number(change.rest_before, 3)} → {number(change.rest_after, 3)})"
    )


# --- Rivals and the next experiment ---------------------------------------------------------------


def rivals(found: MissingEffect) -> str:
    """Name the effects that these data do not distinguish from a missing one."""
    names = listed((effect_label(one.effect) for one in found.rivals), "or")
    return f"These data cannot distinguish {effect_label(found.effect)} from {names}."


def separation_label(found: Separation) -> str:
    """Name a rival in the place of an effect."""
    return f"{effect_label(found.rival)} in place of {effect_label(found.effect)}"


def needed_drops(found: Separation) -> str:
    """Say how many drops distinguish an effect from a rival."""
    pair = f"{effect_label(found.effect)} from {effect_label(found.rival)}"
    if found.drops_needed is None:
        return f"No feasible drop distinguishes {pair}."
    drops = "drop like the first distinguishes" if found.drops_needed == 1 else "drops like these distinguish"
    return f"About {found.drops_needed} {drops} {pair}."


def drop(found: Drop, experiment: Experiment) -> str:
    """Describe a drop to make, and how far the model's outcome is from each rival's there."""
    place = "" if found.x is None else f"x = {number(found.x, 3)} m, "
    state = f"{place}θ = {number(math.degrees(found.theta), 3)}°"
    speed = f"v = ({number(found.v_x, 3)}, {number(found.v_y, 3)}) m/s, ω = {number(found.omega, 3)} rad/s"
    far = listed(
        f"{difference:.1f} σ from {separation_label(one)}"
        for difference, one in zip(found.differences, experiment.separations, strict=True)
    )
    of = "" if found.body is None else f" of {found.body}"
    return f"A drop{of} at {state}, {speed}: the prediction differs by {far}."


# --- The residual and the budget ------------------------------------------------------------------


def residual(found: Remainder) -> list[str]:
    """Say how much Gaussian processes predict of the residual, by which variables, and what else remains."""
    said = [NOT_PREDICTABLE]
    if found.predictable:
        said = [f"{residual_share(found)}, in {listed(WRENCH[name] for name in found.components)}."]
    if found.predictable and found.variables:
        shares = listed(f"{SYMBOLS[one.symbol].letter} ({percent(one.share)})" for one in found.variables)
        said.append(f"The predicted residual depends on {shares}.")
    return said + besides(found)


def besides(found: Remainder) -> list[str]:
    """Say what else remains: that which depends on the state of each trial, and which follows the sequence."""
    said = [state_dependence(found.state_dependence)] if found.state_dependence is not None else []
    said += [serial_dependence(found.serial_dependence)] if found.serial_dependence is not None else []
    return [f"{opened(one)}." for one in said]


def residual_share(found: Remainder) -> str:
    """Say the share of the error that Gaussian processes on the residual take away, without a full stop."""
    return f"Gaussian processes on the residual reduce the held-out error by {share_interval(found.share)}"


def formula_change(found: Formula) -> str:
    """Write a formula as a change of its component, and the error reduction that it brings."""
    letter = WRENCH[found.component]
    return f"{letter} ← {letter} + {found.text} reduces the held-out error by {formula_gain(found)}"


def formula_gain(found: Formula) -> str:
    """Write the error reduction of a formula with its standard error."""
    return f"{percent(found.error_reduction)} ± {percent(found.standard_error)}"


def formula_overrides(found: Formula) -> str:
    """Write a formula as it stands behind a command, quoted for a shell."""
    return " ".join(f"'{one}'" for one in found.overrides())


def noise(budget: ErrorBudget) -> str:
    """Say the noise floor and its origin."""
    return f"The noise floor is {interval(budget.noise)}, {NOISE_SOURCES[budget.noise_source]}."


def shares(budget: ErrorBudget) -> str:
    """Divide the error of the law into explained, noise and unexplained, beside the reach of rigid contact."""
    parts = budget.shares
    explained, floor, left = map(share_of_whole, (parts.explained, min(1.0, parts.noise), parts.unexplained))
    said = f"Of the law's error the effects explain {explained}, {floor} is noise and {left} is unexplained"
    if not parts.beyond_rigid:
        return f"{said}."
    return f"{said}; beyond noise, no rigid point contact can explain {share_of_whole(parts.beyond_rigid)} of it."


def misfit(found: Diagnosis, thresholds: NoiseThresholds = NoiseThresholds()) -> str:  # noqa: B008  # frozen
    """Question stated noise that does not agree with the residual; empty where it does, or is not stated."""
    budget, left = found.budget, found.remainder
    if budget is None or left is None or budget.noise_source is not NoiseSource.STATED:
        return ""
    ratio, limit = (budget.named.mean / budget.noise.mean if budget.noise.mean else 1.0), thresholds.stated_ratio
    if ratio >= 1 / limit and (ratio <= limit or left.found):
        return ""
    return (
        f"The residual is {number(ratio, 2)} times as large as the stated noise implies; is fit.noise in m/s and rad/s?"
    )


def better_law(found: Diagnosis) -> str:
    """Name a law that does clearly better than the chosen one; empty where there is none."""
    better = found.better_law
    if better is None or found.budget is None:
        return ""
    how = "alone" if better.error <= better.least_error else "with the same effects"
    return (
        f"{law_label(better.name)} {how} has an error of {error(better.least_error)}, {base_label(found)} with the "
        f"missing effects {error(found.budget.named.mean)}: try law={better.name}."
    )


def worst_region(found: Diagnosis) -> str:
    """Name the region in which the law fails most surely; empty where there is none."""
    if not found.regions:
        return ""
    return spaced(f"{opened(base_label(found))} fails most clearly where {region(found.regions[0])}.")
