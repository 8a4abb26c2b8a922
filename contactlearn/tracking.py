"""One run's record: TensorBoard events and, beside them, metrics.jsonl, a line a record.

The x axis of every scalar is the number of training impacts, so that the runs of a sweep over sizes
lie along a learning curve.  Hyperparameters go into the run's one event file: TensorBoard's
`add_hparams` would make a stray run of its own.
"""

import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from torch.utils.tensorboard import SummaryWriter
from torch.utils.tensorboard.summary import hparams


class Tracker:
    """Writes scalars, figures and hyperparameters of one run into `folder`; a context manager."""

    def __init__(self, folder: Path, trained_on: int):
        self._writer = SummaryWriter(str(folder))
        self._lines = (folder / "metrics.jsonl").open("a", encoding="utf-8")
        self._trained_on = trained_on

    def __enter__(self) -> "Tracker":
        return self

    def __exit__(self, *_) -> None:
        self._writer.close()
        self._lines.close()

    def scalars(self, values: Mapping[str, float], trained_on: int | None = None) -> None:
        """Log values by tag, such as `mass_error/whittaker`, at a number of training impacts; by default the run's."""
        step = self._trained_on if trained_on is None else trained_on
        for tag, value in values.items():
            self._writer.add_scalar(tag, value, step)
        self._lines.write(json.dumps({"trained_on": step, **values}) + "\n")
        self._lines.flush()

    def series(self, tag: str, values: Sequence[float]) -> None:
        """Log a value after each step of a fit; its x axis is the step."""
        for step, value in enumerate(values):
            self._writer.add_scalar(tag, value, step)

    def figure(self, tag: str, png: bytes) -> None:
        """Log a picture."""
        import numpy as np
        from PIL import Image

        pixels = np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))
        self._writer.add_image(tag, pixels, self._trained_on, dataformats="HWC")

    def hyperparameters(self, values: Mapping[str, bool | float | str], metrics: Mapping[str, float]) -> None:
        """Log what the run was made with, and the metrics to compare runs by."""
        for summary in hparams(dict(values), dict(metrics)):
            self._writer.file_writer.add_summary(summary)
