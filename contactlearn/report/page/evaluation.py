"""An evaluation as the data of its page: models side by side on the trials that were held out."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import torch

from contactlearn.evaluation.metrics import METRICS, Interval, bootstrap, mass_error
from contactlearn.impacts import Impacts, Prediction
from contactlearn.laws import find
from contactlearn.report.figures.style import BOUNDS
from contactlearn.report.page.arrays import packed
from contactlearn.report.page.trials import REACH, finely, look, of_laws, of_trials
from contactlearn.report.text import interval, listed, model_label, number
from contactlearn.results.estimates import ModelErrors
from contactlearn.results.evaluation import Evaluation
from contactlearn.results.held_out import HeldOut

_RESAMPLES = 2000
_FEW = 3  # models that a headline names


def of_evaluation(result: Evaluation, held_out: HeldOut) -> dict[str, Any]:
    """Return everything that the page of an evaluation says and draws, from what the run folder holds.

    Args:
        result: the numbers, as in results.json.
        held_out: the held-out trials and the predictions of every model and bound.

    Raises:
        UnknownNameError: a law of another package that has not been imported.
    """
    test, predictions, errors = held_out.impacts, held_out.predictions, result.errors
    means = {name: errors[name].headline.mean for name in predictions}
    models = sorted((name for name in predictions if name not in BOUNDS), key=means.get)
    names = [*models, *(name for name in BOUNDS if name in predictions)]
    best, behind = models[0], _behind(test, predictions, models)
    laws = {fit.law: find(fit.law, fit.variant, **fit.options).at(fit.mu, fit.eps) for fit in result.fits}
    closest = min(laws, key=means.get)
    fitted, arrays = of_laws(test, laws)
    arrays["v_post"] = torch.stack([predictions[name].v_post for name in names])
    return {
        "title": f"Evaluation on {test.source}",
        "verdict": {
            "key": "evaluation",
            "headline": _headline(best, behind),
            "sentences": _sentences(errors, best, behind, closest, len(test), bool(result.learning_curves)),
        },
        "law": look(closest) | {"name": closest},
        "comparison": [{"key": key, "label": metric.label, "unit": metric.unit} for key, metric in METRICS.items()],
        "models": [_model(name, errors[name]) for name in names],
        "chosen": names.index(best),
        "yardstick": names.index(closest),
        "trials": of_trials(test, predictions[closest]),
        "fitted": fitted,
        "curves": _curves(result),
        "reproduce": {"use": "", **asdict(result.provenance)},
        **packed(arrays, {"reach": REACH, "torn": 1.0}),
    }


def _model(name: str, errors: ModelErrors) -> dict[str, Any]:
    """A row of the table of models."""
    return {
        **look(name),
        "label": model_label(name),
        **finely(asdict(errors.headline)),
        "errors": finely(asdict(errors)),
    }


def _behind(test: Impacts, predictions: Mapping[str, Prediction], models: Sequence[str]) -> dict[str, Interval]:
    """Mean difference of each model's error from that of the first, with its paired interval over the trials."""
    best, *others = (mass_error(test, predictions[name]) for name in models)
    generator = torch.Generator().manual_seed(0)
    return {
        name: bootstrap(error - best, generator, _RESAMPLES) for name, error in zip(models[1:], others, strict=True)
    }


def _headline(best: str, behind: Mapping[str, Interval]) -> str:
    """Name the model with the least error, and those that cannot be told from it."""
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
    errors: Mapping[str, ModelErrors],
    best: str,
    behind: Mapping[str, Interval],
    closest: str,
    trials: int,
    learned: bool,
) -> list[str]:
    said = [f"On {trials} held-out trials {model_label(best)} leaves a mass error of {_interval(errors[best])}."]
    worse = next((name for name, more in behind.items() if more.low > 0), None)
    if worse:
        mean, low, high = (number(x, 2) for x in behind[worse])
        nearest = "The next" if worse == next(iter(behind)) else "The nearest that can be told from it"
        said.append(f"{nearest}, {model_label(worse)}, leaves {mean} (95\u00a0%: {low}–{high}) more, trial by trial.")
    elif behind:
        said.append("No difference from it, trial by trial, has a 95\u00a0% interval without 0.")
    if best != closest:
        said.append(f"Of the laws alone {model_label(closest)} is the best with {_interval(errors[closest])}.")
    bounds = {
        "best_post_hoc": "The best law for each trial, chosen after the fact, leaves",
        "irb": "No impulse of a rigid point contact gets below",
    }
    said += [f"{words} {_interval(errors[name])}." for name, words in bounds.items() if name in errors]
    return said + (["Learned models are under Learning curves."] if learned else [])


def _interval(errors: ModelErrors) -> str:
    return interval(asdict(errors.headline))


def _curves(result: Evaluation) -> list[dict[str, Any]]:
    """Each model's mean error against the number of training trials, and the bounds as level lines."""
    if not result.learning_curves:
        return []
    sizes = next(iter(result.learning_curves.values())).sizes
    lines = {name: curve.headline for name, curve in result.learning_curves.items()}
    lines |= {name: [result.errors[name].headline] * len(sizes) for name in BOUNDS if name in result.errors}
    return [
        {
            **look(name),
            "sizes": list(sizes),
            "intervals": finely([asdict(one) for one in line]),
            "level": name in BOUNDS,
        }
        for name, line in lines.items()
    ]
