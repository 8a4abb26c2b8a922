"""Finished trainings on disk, so that learning curves that were stopped go on behind them.

Each is one NumPy file, whole or not there.  What cannot be read is trained again.
"""

import zlib
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
import torch

from contactlearn.core.devices import moved
from contactlearn.core.numerics import written_whole
from contactlearn.mechanics.impacts import Prediction


@dataclass(frozen=True, kw_only=True)
class Trained:
    """One model trained on subsets of one size, for the held-out trials."""

    key: tuple[str, ...]  # of the curve
    size: int
    prediction: Prediction
    kind: str  # of the processes
    converged: float  # share of the processes whose training converged


def save_trained(folder: Path, trained: Trained) -> None:
    """Write a finished training.

    Raises:
        OSError: the file cannot be written.
    """
    said = moved(trained.prediction, "cpu")
    arrays = {"v_post": said.v_post.numpy(), "wrench": said.wrench.numpy()}
    arrays |= {"kind": np.array(trained.kind), "converged": np.array(trained.converged)}
    if said.covariance is not None:
        arrays["covariance"] = said.covariance.numpy()
    gone = suppress(FileNotFoundError)  # the same command beside this one has ended, and removed the folder
    with gone, written_whole(_path(folder, trained.key, trained.size)) as part:
        np.savez(part, allow_pickle=False, **arrays)


def load_trained(folder: Path, key: tuple[str, ...], size: int) -> Trained | None:
    """Read a training; None if it was not finished."""
    try:
        with _path(folder, key, size).open("rb") as file, np.load(file, allow_pickle=False) as held:
            prediction = Prediction(
                torch.from_numpy(held["v_post"]),
                torch.from_numpy(held["wrench"]),
                torch.from_numpy(held["covariance"]) if "covariance" in held else None,
            )
            kind, converged = str(held["kind"]), float(held["converged"])
    except (OSError, EOFError, ValueError, KeyError, TypeError, BadZipFile, zlib.error):
        return None
    return Trained(key=key, size=size, prediction=prediction, kind=kind, converged=converged)


def kept_trainings(folder: Path) -> int:
    """Count the trainings in a folder and below it; those that were being written are in hidden folders."""
    return sum(not path.parent.name.startswith(".") for path in folder.rglob("*.npz"))


def _path(folder: Path, key: tuple[str, ...], size: int) -> Path:
    return folder / "-".join(key) / f"{size}.npz"
