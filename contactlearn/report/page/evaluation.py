"""An evaluation as the data of its page: models side by side on the trials that were held out."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import torch

from contactlearn.inference.evaluation.metrics import METRICS
from contactlearn.report.figures.browser import as_plotly
from contactlearn.report.figures.comparison import error_comparison
from contactlearn.report.figures.learning import learning_curve
from contactlearn.report.figures.style import BOUNDS, law_style
from contactlearn.report.page.page import packed, reproduced
from contactlearn.report.page.trials import STEPS, digits, finely, impulse_figure, of_laws, of_outcomes, of_trials
from contactlearn.report.text.names import model_labels, sentence, source_label
from contactlearn.report.text.sentences import best_learned, evaluation_headline, learned_errors, phrase, phrases
from contactlearn.results.tables import HeldOut
from contactlearn.results.types import Evaluation


def of_evaluation(result: Evaluation, held_out: HeldOut) -> dict[str, Any]:
    """Return everything that the page of an evaluation says and draws, from what the run folder holds.

    Args:
        result: the numbers, as in results.json.
        held_out: the held-out trials and the predictions of every model and bound.

    Raises:
        UnknownNameError: a law of another package that has not been imported.
    """
    test, predictions = held_out.impacts, held_out.predictions
    labels = model_labels(result)
    names = [result.best, *result.differences, *(name for name in BOUNDS if name in predictions)]
    closest = min((fit.law for fit in result.fits), key=lambda name: result.errors[name].of(result.metric).mean)
    given = held_out.law_impulses(result)
    fitted, arrays = of_laws(given)
    sentences = _sentences(result, labels, closest, len(test))
    learned = best_learned(result)
    arrays |= of_outcomes(test, torch.stack([predictions[name].v_post for name in names]), result.norm)
    return {
        "title": f"Evaluation on {source_label(test.source)}",
        "verdict": {
            "key": "evaluation",
            "headline": evaluation_headline(result),
            "support": [sentences[0], *([learned] if learned else [])],
            "sentences": sentences[1:],
        },
        "law": {"name": closest, "label": law_style(closest).label},
        "_measure": phrase("measure", result.norm),
        "comparison": [
            {"key": key, "label": METRICS[key].label, "unit": METRICS[key].unit}
            for key in dict.fromkeys((result.metric, *METRICS))
        ],
        "models": [
            {
                "label": labels[name],
                **finely(asdict(errors.of(result.metric))),
                "errors": finely(asdict(errors)),
                "reach": result.reach.get(name),
                "kind": "bound" if name in BOUNDS else "law",
            }
            for name, errors in ((name, result.errors[name]) for name in names)
        ],
        "learned": _learned(result),
        "_shares": " ".join(
            map(sentence, (phrase("back_spin", result.back_spin), *((phrase("reach"),) if result.reach else ())))
        ),
        "chosen": 0,
        "yardstick": names.index(closest),
        "trials": of_trials(test, held_out.variables(closest)),
        "fitted": fitted,
        "impulses": impulse_figure(given.first),
        "curves": _curves(result),
        "figures": _figures(result, held_out, {name: labels[name] for name in names}),
        "reproduce": reproduced(result.provenance),
        **packed(arrays, STEPS),
    }


def _figures(result: Evaluation, held_out: HeldOut, labels: Mapping[str, str]) -> dict[str, Any]:
    """The figures that no choice changes, by their place on the page."""
    metric, means = METRICS[result.metric], {name: one.of(result.metric) for name, one in result.errors.items()}
    errors = {label: metric.error(held_out.impacts, held_out.predictions[name]) for name, label in labels.items()}
    intervals = {label: means[name] for name, label in labels.items()}
    figures = {"distributions": error_comparison(errors, intervals, metric.axis)}
    if result.learning_curves:
        curves = {
            name: torch.tensor([*map(tuple, one.of(result.metric))]) for name, one in result.learning_curves.items()
        }
        bounds = {name: means[name] for name in BOUNDS if name in means and name not in curves}
        sizes = next(iter(result.learning_curves.values())).sizes
        figures["curve"] = learning_curve(sizes, curves, bounds, metric.axis)
    return {place: digits(as_plotly(figure)) for place, figure in figures.items()}


def _sentences(result: Evaluation, labels: Mapping[str, str], closest: str, trials: int) -> list[str]:
    """The numbers behind the headline, and where the learned models are."""
    errors = {name: entry.of(result.metric) for name, entry in result.errors.items()}
    sentences = phrases("evaluation_summary", labels, errors, result.best, result.differences, closest, trials)
    if note := phrase("joint_row", result.fits, result.joint):
        sentences.append(sentence(note))
    if (judged := result.trained.get(result.model)) is not None:
        sentences.append(sentence(phrase("judged_model", labels[result.model], judged)))
    return sentences


def _learned(result: Evaluation) -> list[dict[str, Any]]:
    """The learned models at the largest number of training trials, the best first."""
    learned, size = learned_errors(result)
    return [
        {"label": name, "trials": size, "kind": "processes", **finely(asdict(error))}
        for name, error in sorted(learned.items(), key=lambda one: one[1].mean)
    ]


def _curves(result: Evaluation) -> list[dict[str, Any]]:
    """Each model's mean error at each number of training trials, and the bounds, as rows of a table."""
    if not result.learning_curves:
        return []
    sizes = next(iter(result.learning_curves.values())).sizes
    lines = {name: curve.of(result.metric) for name, curve in result.learning_curves.items()}
    levels = (name for name in BOUNDS if name in result.errors and name not in lines)
    lines |= {name: [result.errors[name].of(result.metric)] * len(sizes) for name in levels}
    return [
        {"label": law_style(name).label, "sizes": sizes, "intervals": finely([asdict(one) for one in line])}
        for name, line in lines.items()
    ]
