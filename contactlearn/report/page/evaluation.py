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
from contactlearn.report.text import model_label
from contactlearn.report.text.evaluation import evaluation_headline, evaluation_summary
from contactlearn.results.estimates import ModelErrors
from contactlearn.results.evaluation import Evaluation
from contactlearn.results.held_out import HeldOut

_RESAMPLES = 2000


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
            "headline": evaluation_headline(best, behind),
            "sentences": _sentences(result, best, behind, closest, len(test)),
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


def _sentences(result: Evaluation, best: str, behind: Mapping[str, Interval], closest: str, trials: int) -> list[str]:
    """The numbers behind the headline, and where the learned models are."""
    errors = {name: entry.headline for name, entry in result.errors.items()}
    said = evaluation_summary(errors, best, behind, closest, trials)
    return said + (["Learned models are under Learning curves."] if result.learning_curves else [])


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
