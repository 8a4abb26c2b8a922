"""Per-trial predictions as a table file: a row for every held-out trial and model."""

import os
from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from contactlearn.errors import UnknownNameError
from contactlearn.impacts import COMPONENTS, Impacts, Prediction
from contactlearn.metrics import METRICS, outside_admissible

FORMATS = (".parquet", ".csv")


def save_predictions(impacts: Impacts, predictions: Mapping[str, Prediction], path: Path) -> None:
    """Write trial, model, v_post (m/s, rad/s), wrench (N s, N m s), every metric and the admissible flag.

    The file appears whole or not at all.

    Raises:
        UnknownNameError: a suffix that is neither .parquet nor .csv.
    """
    if path.suffix not in FORMATS:
        raise UnknownNameError("predictions format", path.suffix.removeprefix("."), [f[1:] for f in FORMATS])
    frames = []
    for model, prediction in predictions.items():
        columns: dict = {"trial": impacts.trial, "object": impacts.object, "model": model}
        columns |= dict(zip(COMPONENTS["v_post"], prediction.v_post.T.tolist(), strict=True))
        columns |= dict(zip(("P_t", "P_n", "tau"), prediction.wrench.T.tolist(), strict=True))
        columns |= {name: metric.error(impacts, prediction).tolist() for name, metric in METRICS.items()}
        columns["outside_admissible"] = outside_admissible(impacts, prediction.wrench[:, :2]).tolist()
        frames.append(pd.DataFrame(columns))
    part = path.with_name(f".{path.name}.part")
    table = pd.concat(frames, ignore_index=True)
    table.to_parquet(part, index=False) if path.suffix == ".parquet" else table.to_csv(part, index=False)
    os.replace(part, path)
