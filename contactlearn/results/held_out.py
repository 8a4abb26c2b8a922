"""The held-out trials of an evaluation with every model's predictions, as tables beside results.json."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from contactlearn.data import table
from contactlearn.errors import DataError
from contactlearn.impacts import Impacts, Prediction
from contactlearn.results.evaluation import Evaluation
from contactlearn.results.tables import load_predictions, save_predictions
from contactlearn.shapes import make_shape

_IMPACTS, _PREDICTIONS = "held_out", "predictions"


@dataclass(frozen=True, kw_only=True)
class HeldOut:
    """Trials that no model was made from, and the predictions of every model and bound by name."""

    impacts: Impacts
    predictions: Mapping[str, Prediction]

    def save(self, folder: Path, tables: str) -> None:
        """Write held_out and predictions as files of the format `tables`, csv or parquet.

        Raises:
            DataError: a file cannot be written.
        """
        table.save(self.impacts, folder / f"{_IMPACTS}.{tables}")
        save_predictions(self.impacts, self.predictions, folder / f"{_PREDICTIONS}.{tables}")

    @classmethod
    def load(cls, folder: Path, result: Evaluation) -> "HeldOut":
        """Read what `save` wrote beside a result, number by number the same.

        Raises:
            DataError: a file is missing or damaged, or is that of another run.
        """
        shape = make_shape(None if result.shape is None else dict(result.shape))
        impacts = table.load(folder / f"{_IMPACTS}.{result.tables}", shape)
        impacts = impacts.replace(source=result.provenance.data.source)
        path = folder / f"{_PREDICTIONS}.{result.tables}"
        predictions = load_predictions(impacts, path)
        if missing := result.errors.keys() - predictions.keys():
            raise DataError(f"{path}: lacks the predictions of {', '.join(sorted(missing))}; are the files of one run?")
        return cls(impacts=impacts, predictions=predictions)
