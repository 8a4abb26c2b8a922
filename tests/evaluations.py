"""Results of runs made by hand, for tests of what reads and shows them."""

import torch

from contactlearn.effects import EffectId
from contactlearn.inference.evaluation.metrics import METRICS, ErrorSums, Interval, bootstrap, headline_metric
from contactlearn.mechanics.shapes import shape_entries
from contactlearn.results.estimates import ranked
from contactlearn.results.tables import HeldOut
from contactlearn.results.types import (
    DataSource,
    Evaluation,
    JointEstimate,
    LawEstimate,
    LearningCurve,
    ModelErrors,
    Provenance,
    Training,
    metrics_of,
)


def interval(mean):
    return Interval(mean, 0.9 * mean, 1.1 * mean)


def errors(mean, model="", norm="mass"):
    return ModelErrors(**dict.fromkeys(metrics_of(model, norm), interval(mean)), outside_admissible=0.0, back_spin=0.0)


def provenance(config, source="drops", trials=200, sha256="a" * 64):
    data = DataSource(source=source, trials=trials, sha256=sha256)
    return Provenance(data=data, versions={"contactlearn": "0.1.0"}, config=config, command="contactlearn train")


def law_estimate(law, mu=0.1, eps=0.5):
    return LawEstimate(
        law=law, variant="textbook", options={}, trials=20, repetitions=1, mu=mu, mu_std=None, eps=eps, eps_std=None,
        cost=0.01, mu_range=(0.0, 1.0), eps_range=(0.4, 0.6), mu_undetermined=0.0,
    )  # fmt: skip


def joint_estimate(law="mirtich", *effects):
    return JointEstimate(
        law=law, effects=tuple(map(EffectId.parse, effects)), equation="", parameters=(), correlation=(),
        undetermined={}, at_bounds={}, loss=0.0, starts_at_best=1.0, converged=True, trials=20, outliers=0,
    )  # fmt: skip


def learning_curve(sizes, means):
    rows = dict.fromkeys(METRICS, tuple(map(interval, means)))
    return LearningCurve(sizes=tuple(sizes), **rows, below={}, settled={})


def training(law="mirtich", size=20, error=0.2, effects=(), **data):
    """A training of a law, or of a law with effects."""
    config = {"law": law, "model": {"analytical": {"law": law}}, "effect": {name: {} for name in effects}, "seed": 0}
    model = " + ".join((law, *effects))
    return Training(
        provenance=provenance(config | {"train": {"size": size}}, **data), model=model, learned=None, law=law,
        effects=tuple(map(EffectId.parse, effects)), trained_on=size, equation=law, fits=(),
        joint={law: joint_estimate(law), model: joint_estimate(law, *effects)} if effects else {},
        errors={law: errors(1.5 * error)} | {model: errors(error)}
        | {bound: errors(mean, bound) for bound, mean in (("best_post_hoc", 0.1), ("irb", 0.05))},
        back_spin=0.25, norm="mass", processes=(), processes_kind=None,
    )  # fmt: skip


def evaluation(size=20, norm="mass", **data):
    """An evaluation of two laws."""
    config = {"law": "mirtich", "laws": ["mirtich", "whittaker"], "effect": {}, "seed": 0, "train": {"size": size}}
    means = {"mirtich": 0.2, "whittaker": 0.3, "best_post_hoc": 0.1, "irb": 0.05}
    return Evaluation(
        provenance=provenance(config, **data), model="mirtich", law="mirtich", effects=(), norm=norm,
        fits=(law_estimate("mirtich"), law_estimate("whittaker")), joint={},
        errors={name: errors(mean, name, norm) for name, mean in means.items()}, back_spin=0.25,
        reach={"mirtich": 0.2, "whittaker": 0.21}, best="mirtich",
        differences={"whittaker": interval(0.1)}, tables="parquet", shape=None,
    )  # fmt: skip


def evaluation_of(impacts, predictions, laws, config, curves=(), norm="mass"):
    """The evaluation of predictions of all impacts, and what lies beside it; `laws` at their (μ, ε) by name."""
    generator = torch.Generator()
    table = {}
    for name, prediction in predictions.items():
        intervals = {
            key: bootstrap(METRICS[key].error(impacts, prediction), generator.manual_seed(0), 100)
            for key in metrics_of(name, norm)
        }
        table[name] = ModelErrors(**intervals, outside_admissible=0.0, back_spin=0.0)
    sums = ErrorSums(predictions)
    sums.add(impacts, predictions)
    best, differences = ranked(sums, headline_metric(norm))
    law = min(laws, key=lambda name: table[name].of(headline_metric(norm)))
    result = Evaluation(
        provenance=provenance(config, impacts.source, len(impacts), impacts.fingerprint()), model=law, law=law,
        effects=(), norm=norm,
        fits=tuple(law_estimate(name, float(one.mu), float(one.eps)) for name, one in laws.items()),
        joint={name: joint_estimate(*name.split(" + ")) for name in predictions if " + " in name}, errors=table,
        back_spin=0.25, reach=dict.fromkeys(laws, 0.2), best=best, differences=differences, tables="parquet",
        shape=shape_entries(impacts.shape), learning_curves=dict(curves),
    )  # fmt: skip
    return result, HeldOut(impacts=impacts, predictions=predictions)
