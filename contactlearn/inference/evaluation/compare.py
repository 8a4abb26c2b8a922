"""Models side by side: the held-out error of each on the same impacts, with the bound that no rigid contact beats."""

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import torch

from contactlearn.core.errors import ContactLearnError, UnknownNameError
from contactlearn.inference.evaluation.bounds import irb
from contactlearn.inference.evaluation.metrics import METRICS, bootstrap
from contactlearn.mechanics.impacts import Impacts, require_impacts
from contactlearn.models.contact_model import ContactModel, ErrorOfImpacts, require_metric

if TYPE_CHECKING:
    from pandas import DataFrame

RIGID_BOUND = "rigid bound"
"""Row of the best impulse of a rigid point contact, chosen for each impact after the fact."""


def compare(
    models: Mapping[str, ContactModel] | Iterable[ContactModel],
    impacts: Impacts,
    metric: str | ErrorOfImpacts = "mass_error",
) -> "DataFrame":
    """Score models on the same impacts, best held out from their fits.

    Args:
        models: by name, or models alone, which are named by their law and effects.
        impacts: measurements.
        metric: an error of `contactlearn.metrics` or its name, see `metrics.METRICS`; of another there is no bound.

    Returns:
        A table with a row for each model, the best first: its mean `error`, `low` and `high` of its 95 % bootstrap
        interval, and its `largest` error.  A last row is the rigid bound, for a metric that has one.

    Raises:
        ContactLearnError: no model, or something else than models and impacts.
        UnknownNameError: no metric of this name.
    """
    from pandas import DataFrame  # takes long to load

    require_impacts(impacts)
    if isinstance(metric, str):
        if metric not in METRICS:
            raise UnknownNameError("metric", metric, METRICS)
        metric = METRICS[metric].error
    require_metric(metric)
    named = dict(models) if isinstance(models, Mapping) else _named(models)
    for model in named.values():
        if not isinstance(model, ContactModel):
            kind = type(model).__name__
            raise ContactLearnError(f"compare takes models, such as fit.model, in a list or by name; got a {kind}")
    norm = next((known.norm for known in METRICS.values() if known.error is metric), None)
    errors = {name: metric(impacts, model.predict(impacts)) for name, model in named.items()}
    errors = dict(sorted(errors.items(), key=lambda item: item[1].mean().item()))
    if norm is not None:
        errors[RIGID_BOUND] = metric(impacts, irb(impacts, norm))
    rows = {}
    for name, each in errors.items():
        mean = bootstrap(each, torch.Generator().manual_seed(0), groups=impacts.groups)
        rows[name] = {"error": mean.mean, "low": mean.low, "high": mean.high, "largest": each.max().item()}
    return DataFrame.from_dict(rows, orient="index").rename_axis("model")


def _named(models: Iterable[ContactModel]) -> dict[str, ContactModel]:
    """Name models by their equations without values; those of the same name are numbered."""
    if isinstance(models, ContactModel | Impacts | str) or not isinstance(models, Iterable):
        kind = type(models).__name__
        raise ContactLearnError(f"compare takes several models, such as [fit.model], then impacts; got a {kind} first")
    named: dict[str, ContactModel] = {}
    for model in models:
        label = model.name if isinstance(model, ContactModel) else "?"
        count = sum(name.split(" #")[0] == label for name in named)
        named[f"{label} #{count + 1}" if count else label] = model
    if not named:
        raise ContactLearnError("compare needs at least one model, got none")
    return named
