"""Per-trial results as table files, CSV or Parquet; a file appears whole or not at all."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd

from contactlearn.evaluation.metrics import CHI_SQUARED_95, METRICS, outside_admissible
from contactlearn.identification.per_trial import TrialFit
from contactlearn.impacts import COMPONENTS, Impacts, Prediction
from contactlearn.learning.curves import Curve

_WRITERS = {"parquet": pd.DataFrame.to_parquet, "csv": pd.DataFrame.to_csv}
FORMATS = tuple(_WRITERS)
"""Suffixes of the files that can be written."""


def save_predictions(impacts: Impacts, predictions: Mapping[str, Prediction], path: Path) -> None:
    """A row for every trial and model: v_post (m/s, rad/s), wrench (N s, N m s), metrics, admissibility."""
    frames = []
    for model, prediction in predictions.items():
        columns = _names(impacts) | {"model": model}
        columns |= dict(zip(COMPONENTS["v_post"], prediction.v_post.T.tolist(), strict=True))
        columns |= dict(zip(("P_t", "P_n", "tau"), prediction.wrench.T.tolist(), strict=True))
        columns |= {name: metric.error(impacts, prediction).tolist() for name, metric in METRICS.items()}
        columns["outside_admissible"] = outside_admissible(impacts, prediction.wrench[:, :2]).tolist()
        frames.append(pd.DataFrame(columns))
    _write(frames, path)


def save_trial_parameters(impacts: Impacts, fits: Sequence[TrialFit], path: Path) -> None:
    """A row for every trial and law: the (μ, ε) that suit the trial best, the error left in N s, the range of μ."""
    frames = []
    for fit in fits:
        columns = _names(impacts) | {"law": fit.law.name, "variant": fit.law.variant}
        columns |= {name: getattr(fit, name).tolist() for name in ("mu", "eps", "error", "mu_low", "mu_high")}
        frames.append(pd.DataFrame(columns))
    _write(frames, path)


def save_curves(curves: Mapping[str, Curve], path: Path) -> None:
    """A row for every model, number of training trials and subset: means over the held-out trials."""
    frames = []
    for model, curve in curves.items():
        subsets = next(iter(curve.errors.values())).shape[1]
        columns = {"model": model, "trained_on": [size for size in curve.sizes for _ in range(subsets)]}
        columns["subset"] = [*range(subsets)] * len(curve.sizes)
        columns |= {name: errors.mean(-1).flatten().tolist() for name, errors in curve.errors.items()}
        if curve.density is not None:
            columns["negative_log_density"] = curve.density.mean(-1).flatten().tolist()
            columns["coverage"] = (curve.distance <= CHI_SQUARED_95).double().mean(-1).flatten().tolist()
        frames.append(pd.DataFrame(columns))
    _write(frames, path)


def _names(impacts: Impacts) -> dict:
    return {"trial": impacts.trial, "object": impacts.object}


def _write(frames: list[pd.DataFrame], path: Path) -> None:
    part = path.with_name(f".{path.name}.part")
    _WRITERS[path.suffix.removeprefix(".")](pd.concat(frames, ignore_index=True), part, index=False)
    os.replace(part, path)
