"""The held-out trials of an evaluation with every model's predictions, as tables beside results.json."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import torch

from contactlearn.core.errors import DataError
from contactlearn.data import table
from contactlearn.data.blocks import sampled
from contactlearn.data.table import table_blocks
from contactlearn.mechanics.bodies import make_shapes
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.results.evaluation import BEST_POST_HOC, IRB, Evaluation
from contactlearn.results.tables import load_predictions, save_predictions

_IMPACTS, _PREDICTIONS = "held_out", "predictions"

SHOWN = 10_000
"""Held-out trials that figures and pages show: a random sample where there are more."""


@dataclass(frozen=True, kw_only=True)
class HeldOut:
    """Trials that no model was made from, at most `SHOWN`, and the predictions of every model and bound by name."""

    impacts: Impacts
    predictions: Mapping[str, Prediction]

    @property
    def bounds(self) -> dict[str, Prediction]:
        """The predictions of the bounds alone."""
        return {name: self.predictions[name] for name in (BEST_POST_HOC, IRB)}

    @classmethod
    def load(cls, folder: Path, result: Evaluation) -> "HeldOut":
        """Read those of a run's tables that its page shows, number by number the same.

        Raises:
            DataError: a file is missing or damaged, or is that of another run.
        """
        shape = make_shapes(result.shape)
        blocks = table_blocks(folder / f"{_IMPACTS}.{result.tables}", shape)
        shown = sampled(torch.ones(blocks.trials, dtype=torch.bool), SHOWN)
        impacts = blocks.pick(shown).replace(source=result.provenance.data.source)
        path = folder / f"{_PREDICTIONS}.{result.tables}"
        predictions = load_predictions(impacts, path, shown.nonzero()[:, 0])
        if missing := result.errors.keys() - predictions.keys():
            raise DataError(f"{path}: lacks the predictions of {', '.join(sorted(missing))}; are the files of one run?")
        return cls(impacts=impacts, predictions=predictions)


def save_held_out(
    folder: Path,
    tables: str,
    impacts: Iterable[Impacts],
    predicted: Iterable[tuple[Impacts, Mapping[str, Prediction]]],
) -> None:
    """Write held_out and predictions as files of the format `tables`, csv or parquet, block by block.

    Raises:
        DataError: a file cannot be written.
    """
    table.save(impacts, folder / f"{_IMPACTS}.{tables}")
    save_predictions(predicted, folder / f"{_PREDICTIONS}.{tables}")
