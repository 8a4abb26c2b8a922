"""A diagnosis as the data of its page: plain numbers and text, for the templates and for JSON."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, fields
from typing import Any

import torch

from contactlearn.diagnosis.discrimination.experiment import STATES
from contactlearn.diagnosis.pipeline import Diagnosis
from contactlearn.diagnosis.search.ladder import Missing
from contactlearn.diagnosis.search.subsets import Subsets, subsets
from contactlearn.effects.formula.symbols import SYMBOLS
from contactlearn.evaluation.metrics import Interval, bootstrap, mass_error
from contactlearn.evaluation.partial_residuals import COMPONENTS, Partial, partial_residuals
from contactlearn.identification.joint import FitOptions, identify_jointly
from contactlearn.impacts import Impacts, Prediction
from contactlearn.laws import PAPER_LAWS, Law, find
from contactlearn.report.page.arrays import packed
from contactlearn.report.page.trials import REACH, digits, finely, look, of_laws, of_trials
from contactlearn.report.text import (
    BUDGET,
    WRENCH,
    always,
    base,
    headline,
    label,
    listed,
    measured,
    sentence,
    sentences,
)

_RESAMPLES = 1000


def of_diagnosis(
    found: Diagnosis,
    command: str,
    provenance: Mapping[str, Any],
    *,
    use: str = "",
    noise: tuple[float, float, float] | None = None,
    progress: Callable[[Iterable], Iterable] = iter,
) -> dict[str, Any]:
    """All that the page of a diagnosis says and draws.

    Args:
        found: the diagnosis.
        command: that makes it again.
        provenance: data, versions and configuration, as in diagnosis.json.
        use: the command that evaluates what was found.
        noise: standard deviations of the measured v_x, v_y and ω, as the diagnosis had them.
        progress: wraps the fits of every choice of effects.
    """
    content = {
        "title": f"Diagnosis of {provenance['data']['source']}",
        "verdict": {"key": found.verdict, "headline": headline(found), "sentences": sentences(found)},
        "findings": [
            {
                "name": label(finding.name),
                "sentence": sentence(finding.sentence),
                "evidence": [[label(one.quantity), digits(one.value)] for one in finding.evidence],
                "correction": finding.correction,
                "fatal": finding.fatal,
            }
            for finding in found.findings
        ],
        "law": look(found.law) | {"name": found.law},
        "reproduce": {"command": command, "use": use, **provenance},
        "trials": None,
    }
    if found.model is None:
        return content
    impacts, generator = found.impacts, torch.Generator().manual_seed(0)
    in_play = (missing.id.name for missing in found.missing)
    chosen = subsets(
        impacts, found.model, in_play, generator=generator, progress=progress, options=FitOptions(noise=noise)
    )
    own = found.base.base
    compared = {name: find(name, own.variant) for name in PAPER_LAWS} | {own.name: own}
    fitted = {name: _alone(law, found, noise) for name, law in compared.items()}
    laws, arrays = of_laws(impacts, fitted)
    curves = [partial_residuals(found.model, impacts, missing.id.name) for missing in found.missing]
    arrays["v_post"] = chosen.v_post
    said = {missing.id.name: label(missing.id) for missing in found.missing}
    on = [said[name] for name in always(found, chosen.names)]
    least = [base(found), *(f"{words} (always on)" for words in on)]
    if curves:
        arrays["explained"] = torch.stack([curve.explained for curve in curves], -1)
    return content | {
        "laws": sorted(
            ({**look(name), "error": finely(error)} for name, error in found.laws.items()), key=lambda one: one["error"]
        ),
        "ladder": [{"name": label(step), **finely(asdict(interval))} for step, interval in found.ladder],
        "base": base(found),
        "budget": _budget(found),
        "shares": digits(found.budget.get("shares")),
        "regions": [digits(region.to_dict()) for region in found.regions],
        "trials": of_trials(impacts, found.base.predict(impacts)),
        "models": [
            {"name": " + ".join((*least, *_ticked(chosen, k, said))), **finely(asdict(error))}
            for k, error in enumerate(chosen.errors)
        ],
        "yardstick": 0,
        "chosen": len(chosen.errors) - 1,
        "switches": [{"name": name, "label": said[name]} for name in chosen.names],
        "always": [*map(label, found.base.effects), *on],
        "fitted": laws,
        "effects": [
            _effect(found, missing, curve, chosen, generator)
            for missing, curve in zip(found.missing, curves, strict=True)
        ],
        "experiment": _experiment(found),
        "remains": _remains(found),
        "equation": found.equation,
        **packed(arrays, {"reach": REACH, "torn": 1.0}),
    }


def _alone(law: Law, found: Diagnosis, noise: tuple[float, float, float] | None) -> Law:
    """A law without effects, fitted to all trials."""
    return identify_jointly(law, {}, found.impacts, options=FitOptions(noise=noise, starts=2)).model.base


def _budget(found: Diagnosis) -> list[dict[str, Any]]:
    """Its rows; without effects those with them would be the law's again."""
    same = set() if found.missing else {"named", "flexible"}
    return [
        {
            "name": words.format(law=base(found), **found.budget[key]),
            **finely({part.name: found.budget[key][part.name] for part in fields(Interval)}),
        }
        for key, words in BUDGET.items()
        if key in found.budget and key not in same
    ]


def _ticked(chosen: Subsets, k: int, said: Mapping[str, str]) -> list[str]:
    return [said[name] for j, name in enumerate(chosen.names) if k >> j & 1]


def _effect(
    found: Diagnosis, missing: Missing, curve: Partial, chosen: Subsets, generator: torch.Generator
) -> dict[str, Any]:
    quantity = next(name for name, parts in COMPONENTS.items() if curve.component in dict(parts))
    return {
        "name": missing.id.name,
        "label": label(missing.id),
        "formula": missing.effect.equation,
        "before": finely(asdict(missing.error_before)),
        "after": finely(asdict(missing.error_after)),
        "takes_off": finely(missing.takes_off),
        "all_trials": _taken(found.impacts, missing.id.name, chosen, generator),
        "confidence": digits(missing.confidence, 4),
        "parameters": [
            digits(entry, 4) | {"said": measured(entry["value"], entry["standard_error"], entry["unit"])}
            for entry in missing.parameters.values()
        ],
        "inadmissible": digits(missing.inadmissible, 3),
        "helps": list(missing.helps),
        "alike": [
            digits({**other.to_dict(), "label": label(other.id)})
            for other in found.equivalents.get(missing.id.name, ())
        ],
        "curve": {
            "quantity": quantity,
            "component": [letter for letter, _ in COMPONENTS[quantity]].index(curve.component),
            "letter": curve.component,
            "unit": curve.component_unit,
            "variable": curve.variable,
            "variable_unit": "" if curve.variable_unit == "–" else curve.variable_unit,
            "x": digits(curve.x, 4),
        },
    }


def _taken(impacts: Impacts, name: str, chosen: Subsets, generator: torch.Generator) -> dict[str, float] | None:
    """Mean mass error without the effect less that with it, over the same trials; None if it is always on."""
    if name not in chosen.names:
        return None
    full = len(chosen.errors) - 1
    errors = [
        mass_error(impacts, Prediction(chosen.v_post[k], impacts.wrench))
        for k in (full - 2 ** chosen.names.index(name), full)
    ]
    return finely(asdict(bootstrap(errors[0] - errors[1], generator, _RESAMPLES)))


def _experiment(found: Diagnosis) -> dict[str, Any] | None:
    """The drops by what they set, θ in °, and by how much the model differs there from each rival."""
    if found.experiment is None:
        return None
    drops, needed = found.experiment.drops, found.experiment.needed
    columns = {"x": ("x", "x (m)"), "theta": ("theta", "θ (°)"), "v_x": ("vx", "v_x (m/s)"), "v_y": ("vy", "v_y (m/s)"),
               "omega": ("omega", "ω (rad/s)")}  # fmt: skip
    states = [name for name in STATES if name != "x" or drops[0].x is not None]
    scale = {name: math.degrees(1) if name == "theta" else 1.0 for name in states}
    return {
        "axes": [
            {"name": name, "column": columns[name][0], "label": columns[name][1], "scale": scale[name]}
            for name in states
        ],
        "rivals": [
            {"name": _rival(name), "pair": listed(map(label, reversed(name.split(" for ")))), "drops": count}
            for name, count in needed.items()
        ],
        "drops": [
            digits({name: scale[name] * getattr(drop, name) for name in states}, 3)
            | {"differences": [digits(drop.differences[name], 2) for name in needed]}
            for drop in drops
        ],
    }


def _rival(name: str) -> str:
    """`other for effect` in words."""
    return " in place of ".join(label(part) for part in name.split(" for "))


def _remains(found: Diagnosis) -> dict[str, Any] | None:
    left = found.remainder
    if left is None:
        return None
    return {
        "found": left.found,
        "share": digits(asdict(left.share)),
        "components": [
            digits(
                {
                    "name": WRENCH[one.name],
                    "r_squared": one.r_squared,
                    "standard_error": one.standard_error,
                    "said": measured(one.r_squared, one.standard_error),
                    "named": one.clear,
                },
                3,
            )
            for one in left.tested
        ],
        "variables": [
            {"name": SYMBOLS[name].letter, "what": SYMBOLS[name].description, "share": digits(share, 3)}
            for name, share in left.variables.items()
        ],
        "formulas": [
            {
                "code": " ".join(f"'{override}'" for override in formula.overrides()),
                **digits({"gain": formula.gain, "gain_error": formula.gain_error}, 3),
            }
            for formula in found.formulas
        ],
        "where": listed(WRENCH[name] for name in left.components) if left.components else "",
    }
