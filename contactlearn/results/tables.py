"""Results by trial as table files, CSV or Parquet, each whole or not at all; predictions are read back exactly."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd
import torch

from contactlearn.errors import DataError
from contactlearn.evaluation.metrics import CHI_SQUARED_95, METRICS, outside_admissible
from contactlearn.identification.per_trial import TrialFit
from contactlearn.impacts import COMPONENTS, Impacts, Prediction
from contactlearn.learning.curves import Curve
from contactlearn.numerics import written_whole

_V_POST, _WRENCH = COMPONENTS["v_post"], ("P_t", "P_n", "tau")
_WRITERS = {"parquet": pd.DataFrame.to_parquet, "csv": pd.DataFrame.to_csv}
FORMATS = tuple(_WRITERS)
"""Suffixes of the files that can be written."""


def save_predictions(impacts: Impacts, predictions: Mapping[str, Prediction], path: Path) -> None:
    """Write a row for every trial and model: v_post (m/s, rad/s), wrench (N s, N m s), metrics, admissibility."""
    frames = []
    for model, prediction in predictions.items():
        columns = _names(impacts) | {"model": model}
        columns |= dict(zip(_V_POST, prediction.v_post.T.tolist(), strict=True))
        columns |= dict(zip(_WRENCH, prediction.wrench.T.tolist(), strict=True))
        columns |= {name: metric.error(impacts, prediction).tolist() for name, metric in METRICS.items()}
        columns["outside_admissible"] = outside_admissible(impacts, prediction.wrench[:, :2]).tolist()
        frames.append(pd.DataFrame(columns))
    write_frames(frames, path)


def save_trial_parameters(impacts: Impacts, fits: Sequence[TrialFit], path: Path) -> None:
    """Write a row for every trial and law: its best (μ, ε), the residual in N s, the range of μ."""
    frames = []
    for fit in fits:
        columns = _names(impacts) | {"law": fit.law.name, "variant": fit.law.variant}
        columns |= {name: getattr(fit, name).tolist() for name in ("mu", "eps", "error", "mu_low", "mu_high")}
        frames.append(pd.DataFrame(columns))
    write_frames(frames, path)


def save_curves(curves: Mapping[str, Curve], path: Path) -> None:
    """Write a row for every model, number of training trials and subset: means over the held-out trials."""
    frames = []
    for model, curve in curves.items():
        subsets = next(iter(curve.errors.values())).shape[1]
        columns = {"model": model, "trained_on": [size for size in curve.sizes for _ in range(subsets)]}
        columns["subset"] = [*range(subsets)] * len(curve.sizes)
        columns |= {name: errors.mean(-1).flatten().tolist() for name, errors in curve.errors.items()}
        if curve.density is not None:
            columns["negative_log_density"] = curve.density.negative_log.mean(-1).flatten().tolist()
            columns["coverage"] = (curve.density.distance <= CHI_SQUARED_95).double().mean(-1).flatten().tolist()
        frames.append(pd.DataFrame(columns))
    write_frames(frames, path)


def load_predictions(impacts: Impacts, path: Path) -> dict[str, Prediction]:
    """Read the predictions of `save_predictions` for the same impacts, exactly as they were, but for covariances.

    Raises:
        DataError: the file cannot be read, lacks a column, or belongs to other trials.
    """
    try:
        frame = pd.read_parquet(path) if path.suffix == ".parquet" else _read_csv(path)
        found = {}
        for model, rows in frame.groupby("model", sort=False):
            if tuple(rows["trial"].astype(str)) != impacts.trial:
                raise DataError(f"{path}: the trials of {model} are not the held-out ones; are the files of one run?")
            v_post, wrench = (torch.tensor(rows[list(part)].to_numpy(float)) for part in (_V_POST, _WRENCH))
            found[str(model)] = Prediction(v_post, wrench)
    except FileNotFoundError:
        raise DataError(f"{path}: no such file; the run is not complete, or was moved without it") from None
    except DataError:
        raise
    except Exception as error:  # a damaged file can break anything
        raise DataError(f"{path}: is no table of predictions, or not all of one: {error}") from None
    return found


def _read_csv(path: Path) -> pd.DataFrame:
    return pd.read_csv(path, dtype={"trial": str, "model": str}, keep_default_na=False)


def _names(impacts: Impacts) -> dict[str, tuple[str, ...]]:
    return {"trial": impacts.trial, "object": impacts.object}


def write_frames(frames: list[pd.DataFrame], path: Path) -> None:
    """Write tables, one below the other, to a file with a suffix of `FORMATS`, whole or not at all.

    Raises:
        OSError: it cannot be written.
    """
    with written_whole(path) as part:
        _WRITERS[path.suffix.removeprefix(".")](pd.concat(frames, ignore_index=True), part, index=False)
