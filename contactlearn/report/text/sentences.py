"""The sentences of the report: templates with typed values, which terminal, page, figures and workbench share.

    templates/diagnosis.txt.j2   each stage of a diagnosis, its search, its verdict, the subsamples of a large table
    templates/fits.txt.j2        evaluations, and parameters that free flight has measured
    templates/runs.txt.j2        the page over several runs

A macro is one sentence, or several; `phrase` and `phrases` render it by its name.
"""

import math
import re
from collections import defaultdict
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from jinja2.environment import TemplateModule
from jinja2.runtime import Macro

from contactlearn.core.numerics import measured, number
from contactlearn.diagnosis.result import (
    Candidate,
    Diagnosis,
    Finding,
    FittedParameter,
    Formula,
    FrontierModel,
    LaggedVariable,
    Level,
    Limit,
    MissingEffect,
    NoiseSource,
    PlausibleModel,
    RungKind,
    ScatterComponent,
    Verdict,
)
from contactlearn.effects import EffectId, catalogue
from contactlearn.effects.formula.symbols import symbol_named
from contactlearn.effects.functions import Argument
from contactlearn.inference.evaluation.metrics import Interval
from contactlearn.mechanics.apparatus import CHANGES
from contactlearn.report.text import names, numbers
from contactlearn.report.text.names import join_words
from contactlearn.results.types import Evaluation
from contactlearn.scatter import find_component

_MOST_MODELS = 5  # in the list of plausible models
_MOST_LISTED = 4  # parameters of an effect without words, and laws with their shares where these are alike
_LEAST_SHARE = 0.01  # of belief from which on a plausible model is listed, and of the error for a candidate
_LEAST_BELIEF = 0.05  # in another law or form, from which on it is undecided

_VERDICTS = {
    Verdict.EFFECTS: "effects are missing",
    Verdict.NONE: "no missing effect is detectable",
    Verdict.UNKNOWN: "an unknown effect is missing",
    Verdict.UNFINISHED: "something is missing, and the search ran out of time",
    Verdict.BAD_DATA: "the measurements are inconsistent",
}
_LIMITS = {
    Limit.SIZE: "larger subsamples are not diagnosed",
    Limit.MEMORY: "the free memory is too small for a larger one",
}
_LAGGED_QUANTITIES = {
    LaggedVariable.NORMAL_SPEED: "normal speed",
    LaggedVariable.NORMAL_IMPULSE: "normal impulse",
    LaggedVariable.SLIP: "signed slip velocity",
    LaggedVariable.SLIP_SPEED: "slip speed",
    LaggedVariable.SPIN: "signed spin",
    LaggedVariable.SPIN_RATE: "spin rate",
    LaggedVariable.TANGENTIAL_IMPULSE: "signed tangential impulse",
    LaggedVariable.SLIP_ALONG: "slip along the present one",
    LaggedVariable.SPIN_ALONG: "spin along the present one",
}


def phrase(name: str, *values: Any) -> str:
    """Render a macro of the templates as text on one line; empty where it has nothing to say.

    Raises:
        AttributeError: no template has such a macro.
    """
    return numbers.fix_spacing(_fold(macro(name)(*values)))


def phrases(name: str, *values: Any) -> list[str]:
    """Render a macro of several sentences as a list of them."""
    return [text for one in phrase(name, *values).split("¶") if (text := one.strip(" "))]


def conclusion(verdict: Verdict, physics: Verdict | None, corrections: Sequence[str] = ()) -> str:
    """Write a verdict in a clause; of corrected data also the conclusion about them.

    Args:
        verdict: of the diagnosis.
        physics: the conclusion about the corrected data; None where they are refused.
        corrections: names of the corrections.
    """
    return phrase("conclusion", verdict, physics, corrections)


def headline(diagnosis: Diagnosis) -> str:
    """Write the verdict in one sentence of at most 25 words; `grounds` has the rest."""
    return phrase("verdict", diagnosis)


def learned_errors(result: Evaluation) -> tuple[dict[str, Interval], int]:
    """Return the errors of the learned models of the learning curves, by label, and their number of training trials."""
    curves = {name: curve for name, curve in result.learning_curves.items() if curve.calibration is not None}
    last = {names.model_label(name): curve.of(result.metric)[-1] for name, curve in curves.items()}
    return last, next(iter(curves.values())).sizes[-1] if curves else 0


def best_learned(result: Evaluation) -> str:
    """Name the best learned model of the learning curves and its error; empty where there is none."""
    learned, size = learned_errors(result)
    return phrase("best_learned", learned, size) if learned else ""


def learned_leads(result: Evaluation) -> bool:
    """Whether a learned model of the learning curves has the least error of all models."""
    learned, _ = learned_errors(result)
    return any(one.mean < result.errors[result.best].of(result.metric).mean for one in learned.values())


def evaluation_headline(result: Evaluation) -> str:
    """Name the best model: a learned one where it has less error than all others, and then the best of these."""
    labels, error = names.model_labels(result), result.errors[result.best].of(result.metric).mean
    learned, size = learned_errors(result)
    if not learned_leads(result):
        return phrase("evaluation_headline", labels, result.best, result.differences)
    laws = {*result.differences, result.best} <= {fit.law for fit in result.fits}
    return phrase("learned_headline", learned, size, labels, result.best, result.differences, error, laws)


def grounds(diagnosis: Diagnosis) -> list[str]:
    """List what the verdict rests on: errors, probabilities, corrections, what is unknown."""
    return phrases("grounds", diagnosis)


def names_by_level(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    """List what is missing with its level: effects found or probable, then candidates, a clause each."""
    named = [(str(effect.level), phrase("named", effect)) for effect in diagnosis.missing]
    return named + [(str(Level.CANDIDATE), phrase("candidate", one)) for one in listed_candidates(diagnosis)]


def listed_candidates(diagnosis: Diagnosis) -> tuple[Candidate, ...]:
    """Return the candidates that are worth a line: those that remove 1 % of the law's error at least."""
    least = _LEAST_SHARE * diagnosis.budget.base.mean if diagnosis.budget is not None else 0.0
    return tuple(one for one in diagnosis.candidates if one.error_reduction >= least)


def _beliefs(diagnosis: Diagnosis) -> list[dict[str | EffectId, float]]:
    """List the forms of each effect, and the laws, of which several are likely, with shares among each other."""
    beliefs = {name: defaultdict[str | EffectId, float](float) for name in (*diagnosis.effects, "law")}
    for model in diagnosis.models:
        for name, one in (*((effect.name, effect) for effect in model.effects), ("law", model.law)):
            if name in beliefs:
                beliefs[name][one] += model.share
    listed = []
    for belief in beliefs.values():
        shares = {one: share / sum(belief.values()) for one, share in belief.items()}
        likely = sorted((share for share in shares if shares[share] >= _LEAST_BELIEF), key=lambda one: -shares[one])
        listed += [{one: shares[one] for one in likely}] if len(likely) > 1 else []
    return listed


def set_up(diagnosis: Diagnosis) -> str:
    """Say what of the set-up is not as stated, by measurements without a contact law; empty where nothing differs."""
    rows = [row for finding in diagnosis.findings for row in finding.rig if row.differs]
    made = [row for row in rows if row.estimate.applied]
    left = [row for row in rows if row.name in CHANGES and not row.estimate.applied]
    others = [row for row in rows if row not in (*made, *left)]
    return phrase("set_up", made, [] if made else left, others + (left if made else [])) if rows else ""


def uncertain_forms(diagnosis: Diagnosis, effect: EffectId) -> str:
    """Say which functional forms of an effect the data cannot distinguish; empty where it is certain."""
    belief = next((one for one in _beliefs(diagnosis) if effect in one), None)
    return phrase("forms", belief) if belief else ""


def undecided(diagnosis: Diagnosis) -> list[str]:
    """List effects, forms of an effect and laws that the data cannot distinguish, with shares among each other."""
    effects = phrases("undecided_effects", diagnosis, [one for one in _beliefs(diagnosis) if diagnosis.law not in one])
    return effects + undecided_laws(diagnosis)


def undecided_laws(diagnosis: Diagnosis) -> list[str]:
    """Say which laws the data cannot distinguish, with shares among each other; empty where one is certain."""
    listed = _beliefs(diagnosis)
    laws = listed[-1] if listed and diagnosis.law in listed[-1] else {}
    apart = [law.name for law in diagnosis.laws if law.name not in laws]
    agree = len(laws) > _MOST_LISTED and min(laws.values()) > max(laws.values()) / 2
    return phrases("undecided_laws", laws, apart if agree and len(apart) < len(laws) / 2 else None) if laws else []


def confidence(named: MissingEffect | Candidate) -> str:
    """Write the probability that a name, or one of its alternatives, is correct; calibration resolves 99 % at most."""
    sure = named.claim_confidence if isinstance(named, MissingEffect) else named.confidence
    return "a proxy?" if sure is None else numbers.percent(min(sure, 0.99))


def _brief_effect(missing: MissingEffect, only: bool) -> str:
    """Name an effect and what does as well in its place, without forms; in full only where it is the only one."""
    one, *others = [names.label(effect.name) for effect in (missing.effect, *missing.alternatives)]
    if not others:
        return one
    if len(others) == 1:
        return f"either {one} or {others[0]}" if only else f"{one} (or {others[0]})"
    listed = join_words(names.shortened([one, *others], 3, "effect"))
    return f"one of {listed}" if only else f"{one} (or another)"


def misfit(diagnosis: Diagnosis) -> str:
    """Question stated noise that does not agree with the residual; empty where it does, or is not stated."""
    budget, remainder = diagnosis.budget, diagnosis.remainder
    if budget is None or remainder is None or budget.noise_source is not NoiseSource.STATED:
        return ""
    if budget.noise is None:
        return phrase("misfit", None)
    ratio = budget.named.mean / budget.noise.mean if budget.noise.mean else 1.0
    return phrase("misfit", ratio) if ratio > diagnosis.thresholds.stated_noise_ratio and not remainder.found else ""


def listed_models(diagnosis: Diagnosis) -> tuple[PlausibleModel, ...]:
    """Return the models that are worth a line, the likeliest first: the chosen one is among them."""
    chosen = [model for model in diagnosis.models if _is_chosen(diagnosis, model)]
    others = [model for model in diagnosis.models if model not in chosen and model.share >= _LEAST_SHARE]
    return tuple(sorted((*chosen, *others[: _MOST_MODELS - len(chosen)]), key=lambda model: -model.share))


def searched_name(diagnosis: Diagnosis, model: FrontierModel | PlausibleModel) -> str:
    """Name a model of the search: its law, the effects that were given, and its own."""
    return phrase("model", model.law, (*diagnosis.given, *model.effects))


def listed_name(diagnosis: Diagnosis, model: PlausibleModel) -> str:
    """Name a model of the list, and mark the chosen one where there are others."""
    name = searched_name(diagnosis, model)
    return f"{name} (chosen)" if len(diagnosis.models) > 1 and _is_chosen(diagnosis, model) else name


def _is_chosen(diagnosis: Diagnosis, model: PlausibleModel) -> bool:
    """Whether a model is that of the verdict, which need not have the largest posterior share."""
    return model.law == diagnosis.law and {*model.effects} == {one.effect for one in diagnosis.missing}


def in_words(effect: MissingEffect | Candidate) -> str:
    """Say what the fitted parameters mean, and which of them a plausible range stops."""
    ends = [
        f"{one.symbol} at the end of its range, {numbers.Quantity(one):}" for one in effect.parameters if one.at_end
    ]
    beyond = f"; {join_words(ends)}: the true value may lie beyond" if ends else ""
    return _meaning(effect) + _drifted(effect) + beyond


def _drifted(effect: MissingEffect | Candidate) -> str:
    """Say from where to where a drift takes its coefficient over the trials."""
    if effect.coefficient_ends is None:
        return ""
    symbol = "μ" if "friction" in str(effect.effect.form) else "ε"
    first, last = (f"{x:.3f}".replace("-", "−") for x in effect.coefficient_ends)
    return f"; over these trials {symbol} goes from {first} to {last}"


def _meaning(effect: MissingEffect | Candidate) -> str:
    """Say what the fitted parameters mean; with their symbols where the effect has no words, or the range of many."""
    kind = next((kind for kind in catalogue().get(effect.effect.name, ()) if kind.id == effect.effect), None)
    words, values, curve = kind.in_words if kind else "", effect.parameters, ""
    if kind and isinstance(argument := getattr(kind, "argument", None), Argument):
        quantity = kind.formula.partition(" ")[0].replace("τ", "the arm of the normal impulse")
        curve = f"over {argument.symbol}{'' if argument.unit == '–' else f' in {argument.unit}'}, {quantity} "
    named = {value.name: numbers.Quantity(value) for value in values}
    words = re.sub(r"\[(.*?\{(\w+).*?)\]", lambda part: part[1] * (part[2] in named), words)  # of space alone
    with suppress(KeyError):  # parameters of another version
        if words:
            return curve + words.format_map(named)
    if len(values) > _MOST_LISTED:
        low, high = (pick(values, key=lambda one: one.value) for pick in (min, max))
        return f"{curve and f'{curve}is a curve with '}{len(values)} coefficients from {_shown(low)} to {_shown(high)}"
    return join_words(map(fitted_value, values))


def fitted_value(parameter: FittedParameter) -> str:
    """Write a fitted parameter with its standard error and unit: φ = 0.0020 ± 0.0010 rad, or φ undetermined."""
    if parameter.undetermined:
        return f"{parameter.symbol} undetermined"
    return f"{parameter.symbol} = {measured(parameter.value, parameter.standard_error, parameter.unit)}"


def _shown(parameter: FittedParameter) -> str:
    """Write a fitted parameter in the units of sentences: a₁ = 4.00 ± 0.33 mm."""
    return f"{parameter.symbol} = {numbers.Quantity(parameter)}"


def in_words_of_scatter(scatter: ScatterComponent) -> str:
    """Say what scatters and by how much: the normal by 0.65 ± 0.04°."""
    return find_component(scatter.deviation.name).in_words.format(sigma=scatter.deviation)


def dependence_variable(variable: str) -> str:
    """Name what deviations depend on: a variable of the state, the pose, the sequence, or earlier impacts."""
    quantity, _, earlier = variable.partition(" of ")
    if earlier:
        lagged = LaggedVariable(quantity)
        if lagged is LaggedVariable.PLACE:
            return "earlier impacts near the same place"
        return f"{earlier}' {_LAGGED_QUANTITIES[lagged]}"
    variable, comma, how = variable.partition(", ")
    if comma:
        return f"{dependence_variable(variable)}, {how}"
    named = {
        "pose": "the pose",
        "heading": "the direction of the slip",
        "order": "the sequence",
        "period": "the sequence, periodically",
    }
    return named.get(variable) or " together with ".join(map(_symbol, variable.split(" × ")))


def correct_setting(made: Sequence[str], findings: Sequence[Finding]) -> str:
    """Write the setting with the corrections that were made and those of the findings; empty where these have none."""
    proposed = [finding.correction for finding in findings if finding.correction]
    return f"data.correct=[{','.join([*made, *proposed])}]" if proposed else ""


def formula_overrides(formula: Formula) -> str:
    """Write a formula as it stands behind a command, quoted for a shell."""
    return " ".join(f"'{one}'" for one in formula.overrides())


def _symbol(name: str) -> str:
    """Write the letter of a variable."""
    return symbol_named(name).letter


def _described_symbol(name: str) -> str:
    """Write the letter of a variable with what it stands for: v_n (normal velocity …)."""
    return f"{_symbol(name)} ({symbol_named(name).description})"


def _error_after(diagnosis: Diagnosis) -> Interval:
    """Return the error of the ladder with all missing effects."""
    return next(rung.error for rung in reversed(diagnosis.ladder) if rung.kind is RungKind.EFFECT)


def _fold(text: str) -> str:
    """Make all white space one blank, and none before a punctuation mark or after an opening bracket."""
    text = re.sub(r"[ \n]+", " ", text)
    return re.sub(r" (?=[,;.:?)]+(?:\s|$))|(?<=\() ", "", text).strip(" ")


def macro(name: str) -> Macro:
    """Return the macro of a name, of whichever template has it.

    Raises:
        AttributeError: no template has such a macro.
    """
    first, *others = _modules()
    return getattr(next((one for one in others if hasattr(one, name)), first), name)


@cache
def _modules() -> tuple[TemplateModule, ...]:
    templates = Environment(
        loader=PackageLoader("contactlearn.report.text"),
        undefined=StrictUndefined,
        autoescape=False,  # plain text; a page escapes it
    )
    filters: dict[str, Any] = {
        "brief_effect": _brief_effect,
        "capitalize_first": names.capitalize_first,
        "coefficient": names.COEFFICIENTS.__getitem__,
        "compared": numbers.compared,
        "component": in_words_of_scatter,
        "confidence": confidence,
        "counted": numbers.counted,
        "degrees": math.degrees,
        "described": _described_symbol,
        "dependence": dependence_variable,
        "effect": names.effect_label,
        "error": numbers.error,
        "fine_percent": numbers.fine_percent,
        "fold": _fold,
        "in_words": in_words,
        "interval": numbers.interval,
        "label": names.label,
        "law": names.law_label,
        "lower_first": lambda text: text[0].lower() + text[1:],
        "like_shape": lambda one: any(kind.id == one and kind.like_shape for kind in catalogue().get(one.name, ())),
        "letter": names.WRENCH.__getitem__,
        "measured": measured,
        "noise_source": names.NOISE_SOURCES.__getitem__,
        "number": number,
        "of": lambda key, mapping: mapping[key],
        "p_value": numbers.p_value,
        "percent": numbers.percent,
        "sentence": names.sentence,
        "share": numbers.share_of_whole,
        "share_interval": numbers.share_interval,
        "shortened": names.shortened,
        "symbol": _symbol,
        "times": numbers.times,
        "words": join_words,
    }
    templates.filters.update(filters)
    values: dict[str, Any] = {
        "LIMITS": _LIMITS,
        "LAGGED_QUANTITIES": _LAGGED_QUANTITIES,
        "LaggedVariable": LaggedVariable,
        "Level": Level,
        "NoiseSource": NoiseSource,
        "VERDICTS": _VERDICTS,
        "Verdict": Verdict,
        "error_after": _error_after,
    }
    templates.globals.update(values)
    return tuple(templates.get_template(f"{name}.txt.j2").module for name in ("diagnosis", "fits", "runs"))
