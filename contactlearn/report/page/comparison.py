"""An evaluation as the data of its page: models side by side on the trials that were held out."""

from collections.abc import Mapping, Sequence
from typing import Any

import torch

from contactlearn.impacts import Impacts, Prediction
from contactlearn.laws import Law
from contactlearn.metrics import HEADLINE, METRICS
from contactlearn.report.page.arrays import packed
from contactlearn.report.page.trials import REACH, digits, look, of_laws, of_trials
from contactlearn.report.page.words import interval
from contactlearn.report.style import BOUNDS


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
    names = list(predictions)
    means = {name: errors[name][HEADLINE]["mean"] for name in names}
    best = min((name for name in names if name not in BOUNDS), key=means.get)
    closest = min(laws, key=means.get)
    fitted, arrays = of_laws(test, laws)
    arrays["v_post"] = torch.stack([predictions[name].v_post for name in names])
    return {
        "title": f"Evaluation on {test.source}",
        "verdict": {
            "key": "evaluation",
            "headline": f"{look(best)['label']} comes closest of {len(set(names) - set(BOUNDS))} models.",
            "sentences": _sentences(errors, best, closest, len(test)),
        },
        "law": look(closest) | {"name": closest},
        "comparison": [{"key": key, "label": metric.label, "unit": metric.unit} for key, metric in METRICS.items()],
        "models": [
            {**look(name), **digits(dict(errors[name][HEADLINE])), "errors": digits(errors[name])} for name in names
        ],
        "chosen": names.index(best),
        "yardstick": names.index(closest),
        "trials": of_trials(test, predictions[closest]),
        "fitted": fitted,
        "curves": _curves(curves or {}, [(name, errors[name]) for name in BOUNDS if name in errors]),
        "reproduce": {"command": command, "use": "", **provenance},
        **packed(arrays, {"reach": REACH, "torn": 1.0}),
    }


def _sentences(errors: Mapping[str, Mapping[str, Any]], best: str, closest: str, trials: int) -> list[str]:
    said = [
        f"On {trials} held-out trials {look(best)['label']} leaves a mass error of {interval(errors[best][HEADLINE])}."
    ]
    if best != closest:
        said.append(
            f"Of the laws alone {look(closest)['label']} is the best with {interval(errors[closest][HEADLINE])}."
        )
    bounds = {
        "best_post_hoc": "The best law for each trial, chosen after the fact, leaves",
        "irb": "No impulse of a rigid point contact gets below",
    }
    said += [f"{words} {interval(errors[name][HEADLINE])}." for name, words in bounds.items() if name in errors]
    return said


def _curves(curves: Mapping[str, Mapping[str, Any]], levels: Sequence[tuple[str, Mapping]]) -> list[dict[str, Any]]:
    """Each model's mean error against the number of training trials, and the bounds as level lines."""
    if not curves:
        return []
    sizes = next(iter(curves.values()))["sizes"]
    lines = {name: entry[HEADLINE] for name, entry in curves.items()}
    lines |= {name: [entry[HEADLINE]] * len(sizes) for name, entry in levels}
    return [
        {**look(name), "sizes": list(sizes), "intervals": digits(line), "level": name in BOUNDS}
        for name, line in lines.items()
    ]
