"""Trained models from the files of the setting `checkpoint`, and their names in tables."""

import hashlib
import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from contactlearn.cli.config_files import NAME
from contactlearn.core.errors import ContactLearnError
from contactlearn.core.serialisation import from_json
from contactlearn.effects import Effect
from contactlearn.inference.evaluation import metrics
from contactlearn.laws import Law
from contactlearn.mechanics.impacts import Impacts, Prediction
from contactlearn.models import checkpoint
from contactlearn.models.contact_model import ContactModel
from contactlearn.results.runs import differing, natural_order, printable
from contactlearn.results.state import unfinished
from contactlearn.results.types import JudgedModel, Provenance

_LONGEST = 60  # characters of the settings in a name


@dataclass(frozen=True, kw_only=True)
class TrainedModel:
    """A model of a checkpoint, on the CPU; `provenance` is None where the file does not state it."""

    path: Path
    model: ContactModel
    provenance: Provenance | None

    @property
    def law_model(self) -> ContactModel:
        """The model that has the law and the effects."""
        return self.model.law_model

    @property
    def law(self) -> Law | None:
        """The law that the model is, or builds on; None without a law."""
        return self.law_model.base if isinstance(self.law_model.base, Law) else None

    @property
    def effects(self) -> Mapping[str, Effect]:
        """The effects around its law, by name."""
        return self.law_model.effects

    @property
    def learned(self) -> str:
        """Name of a learned model in its training's configuration, else of its file or run folder; a law's own name."""
        if self.model.regressor is None:
            return "no law" if self.law is None else self.law.name
        names = None if self.provenance is None else self.provenance.config.get("model")
        if isinstance(names, Mapping) and len(names) == 1 and NAME.fullmatch(next(iter(names))):
            return next(iter(names))
        return printable(self.path.parent.name if self.path.stem == "model" else self.path.stem)

    @property
    def trained_on(self) -> int | None:
        """Number of training trials; None for a law in a file that does not state it."""
        if self.model.regressor is not None:
            return self.model.regressor.gps.train_targets.shape[-1]
        size = {} if self.provenance is None else self.provenance.config.get("train")
        size = size.get("size") if isinstance(size, Mapping) else None
        return size if isinstance(size, int) else None

    def judged(self, test: Impacts, prediction: Prediction) -> JudgedModel:
        """Return its origin, and how well its covariances cover the held-out trials."""
        coverage, density = None, None
        if prediction.covariance is not None:
            inside = metrics.squared_distance(test, prediction) <= metrics.CHI_SQUARED_95[test.space.D]
            coverage = inside.double().mean().item()
            density = metrics.negative_log_density(test, prediction).mean().item()
        return JudgedModel(
            path=str(self.path),
            sha256=hashlib.sha256(self.path.read_bytes()).hexdigest(),
            data=None if self.provenance is None else self.provenance.data,
            trained_on=self.trained_on,
            equation=str(self.model),
            coverage=coverage,
            negative_log_density=density,
        )


def load_model(path: str) -> TrainedModel:
    """Load the one model of a checkpoint or run folder.

    Raises:
        ContactLearnError: none is there, or several.
        DataError: see `checkpoint.load`.
    """
    files = _files(Path(path))
    if [file.name for file in files] == ["base.pt", "model.pt"]:  # of a diagnosis: its law alone, and what it chose
        files = files[1:]
    if len(files) > 1:
        raise ContactLearnError(
            f"{path} holds {len(files)} models ({files[0]} …); name one, or sweep: -m checkpoint=A,B"
        )
    return _load(files[0])


def load_models(paths: Sequence[str], taken: Iterable[str]) -> dict[str, TrainedModel]:
    """Load all models of checkpoints, run folders and folders of sweeps, by their names in tables.

    Models of the same name are distinguished by the settings in which their trainings differ.

    Args:
        paths: files and folders.
        taken: names of other models.

    Raises:
        ContactLearnError: a path without a model.
        DataError: see `checkpoint.load`.
    """
    models = [_load(file) for file in dict.fromkeys(file for path in paths for file in _files(Path(path)))]
    names = [printable(" + ".join((model.learned, *model.effects))) for model in models]
    labels = dict[int, str]()
    for name in dict.fromkeys(names):
        alike = [k for k, other in enumerate(names) if other == name]
        several = _distinguished(name, [models[k] for k in alike]) if len(alike) > 1 else [name]
        labels |= dict(zip(alike, several, strict=True))
    taken = set(taken)
    return {labels[k] + " (trained)" * (labels[k] in taken): model for k, model in enumerate(models)}


def _distinguished(name: str, models: Sequence[TrainedModel]) -> list[str]:
    """Names of models of the same kind: with the settings in which they differ, or with their files."""
    configs = [{} if model.provenance is None else model.provenance.config for model in models]
    settings = differing(configs, ["train"] * len(models)).items()
    words = [
        ", ".join(f"{key}={values[k]}" for key, values in settings if values[k] not in (None, "null"))
        for k in range(len(models))
    ]
    if len(set(words)) < len(words) or max(map(len, words)) > _LONGEST:
        top = os.path.commonpath([model.path.parent for model in models])
        paths = (os.path.relpath(model.path.with_suffix(""), top) for model in models)
        words = [printable(path.removesuffix(f"{os.sep}model")) for path in paths]
    return [f"{name} ({word})" for word in words]


def _files(path: Path) -> list[Path]:
    """The checkpoint of a path, or all that are in a folder and below it; those of unfinished runs are left out."""
    if not path.is_dir():
        return [path]
    below = (file for file in path.rglob("*.pt") if not any(part[0] == "." for part in file.relative_to(path).parts))
    files = sorted((file for file in below if not unfinished(file.parent)), key=lambda file: natural_order(str(file)))
    if not files:
        raise ContactLearnError(
            f"{path}: no trained model is in this folder; give a model.pt, the folder of a finished run, or of a sweep"
        )
    return files


def _load(path: Path) -> TrainedModel:
    model = checkpoint.load(path)
    try:
        provenance = from_json(Provenance, json.dumps(model.provenance))
    except ContactLearnError:  # of a program of the user's own
        provenance = None
    return TrainedModel(path=path, model=model, provenance=provenance)
