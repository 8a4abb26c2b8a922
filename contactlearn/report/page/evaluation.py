"""An evaluation as the data of its page: models side by side on the trials that were held out."""

from collections.abc import Mapping, Sequence
from typing import Any

import torch

from contactlearn.evaluation.metrics import HEADLINE, METRICS, Interval, bootstrap, mass_error
from contactlearn.impacts import Impacts, Prediction
from contactlearn.laws import Law
from contactlearn.report.figures.style import BOUNDS
from contactlearn.report.page.arrays import packed
from contactlearn.report.page.trials import REACH, finely, look, of_laws, of_trials
from contactlearn.report.text import interval, listed, model_label, number

_RESAMPLES = 2000
_FEW = 3  # models that a headline names


def of_evaluation(
    test: Impacts,
    predictions: Mapping[str, Prediction],
    errors: Mapping[str, Mapping[str, Any]],
    laws: Mapping[str, Law],
    command: str,
    provenance: Mapping[str, Any],
    *,
    curves: Mapping[str, Mapping[str, Any]] | None = None,
) -> dict[str, Any]:
    """All that the page of an evaluation says and draws.

    Args:
        test: the trials that were held out.
        predictions: by the name of the model, bounds among them.
        errors: of each as in results.json: {metric: {mean, low, high}, outside_admissible}.
        laws: at their identified parameters, by name.
        command: that makes it again.
        provenance: data, versions and configuration, as in results.json.
        curves: learning curves as in results.json.
    """
    means = {name: errors[name][HEADLINE]["mean"] for name in predictions}
    models = sorted((name for name in predictions if name not in BOUNDS), key=means.get)
    names = [*models, *(name for name in BOUNDS if name in predictions)]
    best, behind = models[0], _behind(test, predictions, models)
    closest = min(laws, key=means.get)
    fitted, arrays = of_laws(test, laws)
    arrays["v_post"] = torch.stack([predictions[name].v_post for name in names])
    return {
        "title": f"Evaluation on {test.source}",
        "verdict": {
            "key": "evaluation",
            "headline": _headline(best, behind),
            "sentences": _sentences(errors, best, behind, closest, len(test), bool(curves)),
        },
        "law": look(closest) | {"name": closest},
        "comparison": [{"key": key, "label": metric.label, "unit": metric.unit} for key, metric in METRICS.items()],
        "models": [
            {
                **look(name),
                "label": model_label(name),
                **finely(dict(errors[name][HEADLINE])),
                "errors": finely(errors[name]),
            }
            for name in names
        ],
        "chosen": names.index(best),
        "yardstick": names.index(closest),
        "trials": of_trials(test, predictions[closest]),
        "fitted": fitted,
        "curves": _curves(curves or {}, [(name, errors[name]) for name in BOUNDS if name in errors]),
        "reproduce": {"command": command, "use": "", **provenance},
        **packed(arrays, {"reach": REACH, "torn": 1.0}),
    }


def _behind(test: Impacts, predictions: Mapping[str, Prediction], models: Sequence[str]) -> dict[str, Interval]:
    """How much more error than the first of the models each other leaves, over the same trials."""
    best, *others = (mass_error(test, predictions[name]) for name in models)
    generator = torch.Generator().manual_seed(0)
    return {
        name: bootstrap(error - best, generator, _RESAMPLES) for name, error in zip(models[1:], others, strict=True)
    }


def _headline(best: str, behind: Mapping[str, Interval]) -> str:
    """Which model leaves the least, and which cannot be told from it."""
    if not behind:
        return f"{model_label(best)} is the only model here."
    near = [model_label(name) for name, more in behind.items() if more.low <= 0]
    if not near:
        return f"{model_label(best)} leaves the least error of {len(behind) + 1} models."
    if len(near) > _FEW:
        near = [*near[: _FEW - 1], f"{len(near) - _FEW + 1} others"]
    return (
        f"{model_label(best)} leaves the least error of {len(behind) + 1} models, but {listed(near)} cannot be told "
        "from it."
    )


def _sentences(
    errors: Mapping[str, Mapping[str, Any]],
    best: str,
    behind: Mapping[str, Interval],
    closest: str,
    trials: int,
    learned: bool,
) -> list[str]:
    said = [
        f"On {trials} held-out trials {model_label(best)} leaves a mass error of {interval(errors[best][HEADLINE])}."
    ]
    worse = next((name for name, more in behind.items() if more.low > 0), None)
    if worse:
        mean, low, high = (number(x, 2) for x in behind[worse])
        nearest = "The next" if worse == next(iter(behind)) else "The nearest that can be told from it"
        said.append(f"{nearest}, {model_label(worse)}, leaves {mean} (95\u00a0%: {low}–{high}) more, trial by trial.")
    elif behind:
        said.append("No difference from it, trial by trial, has a 95\u00a0% interval without 0.")
    if best != closest:
        said.append(f"Of the laws alone {model_label(closest)} is the best with {interval(errors[closest][HEADLINE])}.")
    bounds = {
        "best_post_hoc": "The best law for each trial, chosen after the fact, leaves",
        "irb": "No impulse of a rigid point contact gets below",
    }
    said += [f"{words} {interval(errors[name][HEADLINE])}." for name, words in bounds.items() if name in errors]
    return said + (["Learned models are under Learning curves."] if learned else [])


def _curves(curves: Mapping[str, Mapping[str, Any]], levels: Sequence[tuple[str, Mapping]]) -> list[dict[str, Any]]:
    """Each model's mean error against the number of training trials, and the bounds as level lines."""
    if not curves:
        return []
    sizes = next(iter(curves.values()))["sizes"]
    lines = {name: entry[HEADLINE] for name, entry in curves.items()}
    lines |= {name: [entry[HEADLINE]] * len(sizes) for name, entry in levels}
    return [
        {**look(name), "sizes": list(sizes), "intervals": finely(line), "level": name in BOUNDS}
        for name, line in lines.items()
    ]
