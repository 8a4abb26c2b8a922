"""Results by trial as table files, CSV or Parquet, each whole or not at all; predictions are read back exactly.

Held-out trials and the predictions of every model for them lie beside results.json; pages are drawn again from them.
"""

import math
from collections.abc import Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.csv as pacsv
import pyarrow.dataset as ds
import torch

from contactlearn.core.errors import DataError
from contactlearn.data import table
from contactlearn.data.blocks import sampled
from contactlearn.inference.evaluation.impulse_space import LawImpulses
from contactlearn.inference.evaluation.metrics import METRICS, Norm, outside_admissible
from contactlearn.inference.evaluation.variables import Variable, map_variables
from contactlearn.inference.identification.result import TrialFit
from contactlearn.inference.learning.curves import Curve
from contactlearn.laws import find
from contactlearn.mechanics.bodies import make_shapes
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.results.types import BEST_POST_HOC, IRB, Evaluation, metrics_of

_IMPACTS, _PREDICTIONS = "held_out", "predictions"

SHOWN = 10_000
"""Held-out trials that figures and pages show: a random sample where there are more."""

FORMATS = ("parquet", "csv")
"""Suffixes of the tables."""


def save_predictions(
    predicted: Iterable[tuple[Impacts, Mapping[str, Prediction]]], path: Path, norm: Norm = "mass"
) -> None:
    """Write a row for every trial and model: v_post (m/s, rad/s), wrench (N s, N m s), metrics, admissibility.

    The trials come in blocks; of each block all rows of a model stand together.  Bounds of `norm` have the metrics that
    they bound.
    """
    frames = (
        pd.DataFrame(
            _names(impacts)
            | {"model": model}
            | dict(zip(impacts.space.components["v_post"], prediction.v_post.T.numpy(), strict=True))
            | dict(zip(impacts.space.wrench, prediction.wrench.T.numpy(), strict=True))
            | {
                name: metric.error(impacts, prediction).numpy() if name in metrics_of(model, norm) else math.nan
                for name, metric in METRICS.items()
            }
            | {"outside_admissible": outside_admissible(impacts, prediction.wrench[:, : impacts.space.d]).numpy()}
        )
        for impacts, predictions in predicted
        for model, prediction in predictions.items()
    )
    table.write_frames(frames, path)


def save_trial_parameters(impacts: Impacts, fits: Sequence[TrialFit], path: Path) -> None:
    """Write a row for every trial and law: its best (μ, ε), the residual in N s, the range of μ."""
    frames = []
    for fit in fits:
        columns = _names(impacts) | {"law": fit.law.name, "variant": fit.law.variant}
        columns |= {name: getattr(fit, name).tolist() for name in ("mu", "eps", "error", "mu_low", "mu_high")}
        frames.append(pd.DataFrame(columns))
    table.write_frames([pd.concat(frames, ignore_index=True)], path)


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
            columns["coverage"] = curve.density.coverage.flatten().tolist()
        frames.append(pd.DataFrame(columns))
    table.write_frames([pd.concat(frames, ignore_index=True)], path)


def load_predictions(impacts: Impacts, path: Path) -> dict[str, Prediction]:
    """Read the predictions of `save_predictions` for some of its trials, exactly as they were, but for covariances.

    Raises:
        DataError: the file cannot be read, lacks a column, or belongs to other trials.
    """
    space = impacts.space
    columns = ["trial", "model", *space.components["v_post"], *space.wrench]
    with _readable(path):
        rows = _stored(path).to_table(columns=columns, filter=ds.field("trial").isin(impacts.trial)).to_pandas()
    by_model = {str(model): part for model, part in rows.groupby("model", sort=False)}
    return {model: _prediction(impacts, model, part, path) for model, part in by_model.items()}


def _stored(path: Path) -> ds.Dataset:
    """A table of a run; Arrow reads every number to its last digit, as pandas 2 does not."""
    texts = pacsv.ConvertOptions(column_types=dict.fromkeys(("trial", "object", "model"), pa.string()))
    return ds.dataset(path, format=ds.CsvFileFormat(convert_options=texts) if path.suffix == ".csv" else "parquet")


@contextmanager
def _readable(path: Path) -> Generator[None]:
    """Turn the errors of a file that is missing or damaged, which can break anything, into ours."""
    try:
        yield
    except FileNotFoundError:
        raise DataError(f"{path}: no such file; the run is not complete, or was moved without it") from None
    except Exception as error:
        raise DataError(f"{path}: is no table of a run, or not all of one: {error}") from None


def _prediction(impacts: Impacts, model: str, rows: pd.DataFrame, path: Path) -> Prediction:
    if tuple(rows["trial"].astype(str)) != impacts.trial:
        raise DataError(f"{path}: the trials of {model} are not the held-out ones; are the files of one run?")
    parts = impacts.space.components["v_post"], impacts.space.wrench
    v_post, wrench = (torch.tensor(rows[list(part)].to_numpy(float)) for part in parts)
    return Prediction(v_post, wrench)


def _names(impacts: Impacts) -> dict[str, tuple[str, ...]]:
    return {"trial": impacts.trial, "object": impacts.object}


@dataclass(frozen=True, kw_only=True)
class HeldOut:
    """Trials that no model was fitted to, at most `SHOWN`, and the predictions of every model and bound by name."""

    impacts: Impacts
    predictions: Mapping[str, Prediction]

    @property
    def bounds(self) -> dict[str, Prediction]:
        """The predictions of the bounds alone."""
        return {name: self.predictions[name] for name in (BEST_POST_HOC, IRB)}

    def law_impulses(self, result: Evaluation) -> LawImpulses:
        """What the laws of an evaluation give these trials, and can give them.

        Raises:
            UnknownNameError: a law of another package that has not been imported.
        """
        laws = {fit.law: find(fit.law, fit.variant, **fit.options).at(fit.mu, fit.eps) for fit in result.fits}
        return LawImpulses.of(self.impacts, laws)

    def variables(self, model: str) -> list[Variable]:
        """The variables of the trials; the prediction of a model decides which of them stick."""
        return map_variables(self.impacts, self.predictions[model])

    @classmethod
    def load(cls, folder: Path, result: Evaluation) -> "HeldOut":
        """Read those of a run's tables that its page shows, number by number the same.

        Raises:
            DataError: a file is missing or damaged, or is that of another run.
        """
        path = folder / f"{_IMPACTS}.{result.tables}"
        with _readable(path):
            stored = _stored(path)
            shown = sampled(torch.ones(stored.count_rows(), dtype=torch.bool), SHOWN)
            frame = stored.take(shown.nonzero()[:, 0].numpy()).to_pandas()
        impacts = table.load(frame, make_shapes(result.shape)).replace(source=result.provenance.data.source)
        path = folder / f"{_PREDICTIONS}.{result.tables}"
        predictions = load_predictions(impacts, path)
        if missing := result.errors.keys() - predictions.keys():
            raise DataError(f"{path}: lacks the predictions of {', '.join(sorted(missing))}; are the files of one run?")
        return cls(impacts=impacts, predictions=predictions)


def save_held_out(
    folder: Path,
    tables: str,
    impacts: Iterable[Impacts],
    predicted: Iterable[tuple[Impacts, Mapping[str, Prediction]]],
    norm: Norm = "mass",
) -> None:
    """Write held_out and predictions as files of the format `tables`, csv or parquet, block by block.

    `norm` is that of the bounds.

    Raises:
        DataError: a file cannot be written.
    """
    table.save(impacts, folder / f"{_IMPACTS}.{tables}")
    save_predictions(predicted, folder / f"{_PREDICTIONS}.{tables}", norm)
