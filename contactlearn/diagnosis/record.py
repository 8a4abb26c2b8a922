"""Record of a diagnosis: impacts, models and arrays by trial, as files in the run folder.

    impacts.parquet    the corrected impacts
    base.pt, model.pt  the law with the given effects, and the full model, as checkpoints
    record.npz         outcomes of every choice of effects, partial residuals, deviations of the contact, the shapes of
                       bodies and the data's name

Nothing in these files is ever executed: the arrays hold numbers and text and are read without pickle.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Final, TypeVar, final

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from contactlearn.core.errors import ContactLearnError, DataError
from contactlearn.core.numerics import atomic_write
from contactlearn.data import table
from contactlearn.inference.evaluation.metrics import mass_error
from contactlearn.inference.evaluation.partial_residuals import Partial
from contactlearn.inference.evaluation.variables import Variable, map_variables
from contactlearn.mechanics.bodies import make_shapes, shapes_entries
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import matvec
from contactlearn.models import checkpoint
from contactlearn.models.contact_model import ContactModel

_IMPACTS, _BASE, _MODEL, _ARRAYS = "impacts.parquet", "base.pt", "model.pt", "record.npz"


@dataclass(frozen=True, kw_only=True)
class Deviations:
    """Most probable deviations u [N, k] of a component of scatter and their standard errors, in `unit`.

    They are against the sequence, and a variable x [N] with its letter and unit.
    """

    component: str
    symbol: str
    unit: str
    variable: str
    variable_unit: str
    x: Float[Tensor, " n"]
    order: Float[Tensor, " n"]
    u: Float[Tensor, "n k"]
    error: Float[Tensor, "n k"]


_Evidence = TypeVar("_Evidence", Partial, Deviations)


@final
class Record:
    """Everything that a page or a figure draws of a diagnosis beyond its numbers.

    Not a dataclass, so that no file can claim to contain one.

    Args:
        impacts: those of the models, corrected where they had to be.
        base: the law with the given effects, fitted to all impacts.
        model: the same with the missing effects.
        outcomes: v_post in (m/s, m/s, rad/s) of every choice of effects, see `Choices`.
        residuals: partial residuals of the missing effects, in their order.
        deviations: of the contact by component, of the impacts from which its scatter is estimated.
    """

    __slots__ = ("base", "deviations", "impacts", "model", "outcomes", "residuals")

    def __init__(
        self,
        *,
        impacts: Impacts,
        base: ContactModel,
        model: ContactModel,
        outcomes: Float[Tensor, "choices n D"],
        residuals: tuple[Partial, ...] = (),
        deviations: tuple[Deviations, ...] = (),
    ) -> None:
        self.impacts: Final = impacts
        self.base: Final = base
        self.model: Final = model
        self.outcomes: Final = outcomes
        self.residuals: Final = residuals
        self.deviations: Final = deviations

    def variables(self) -> list[Variable]:
        """Compute the variables of the trials; the law's prediction decides which of them stick."""
        return map_variables(self.impacts, self.base.predict(self.impacts))

    def errors(self) -> dict[str, Float[Tensor, "n"]]:
        """Compute the mass errors of `base`, and of `model` if it has further effects, on the trials of their fit."""
        models = {"base": self.base}
        if self.model.effects.keys() - self.base.effects.keys():
            models["model"] = self.model
        return {name: mass_error(self.impacts, model.outcome(self.impacts)) for name, model in models.items()}

    def residual(self) -> Float[Tensor, "n D"]:
        """Compute the measured wrench less that of the model without processes, in the axes of the slip."""
        wrench = self.impacts.wrench - self.model.base_prediction(self.impacts).wrench
        return matvec(self.impacts.slip_axes.mT, wrench)

    def save(self, folder: Path, provenance: Mapping[str, Any]) -> None:
        """Write the files of the module's table into a folder; each appears whole or not at all.

        Args:
            folder: of the run.
            provenance: of the models, see `checkpoint.save`.

        Raises:
            DataError: a file cannot be written.
        """
        table.save(self.impacts, folder / _IMPACTS)
        checkpoint.save(self.base, folder / _BASE, provenance=dict(provenance))
        checkpoint.save(self.model, folder / _MODEL, provenance=dict(provenance))
        shape = shapes_entries(self.impacts.shape)
        about = {"source": self.impacts.source, "validate": self.impacts.validate, "shape": shape}
        arrays = {"about": np.asarray(json.dumps(about)), "outcomes": self.outcomes.numpy()}
        arrays |= _evidence_arrays("", self.residuals) | _evidence_arrays("deviations_", self.deviations)
        try:
            with atomic_write(folder / _ARRAYS) as part:
                np.savez_compressed(part, allow_pickle=False, **arrays)
        except OSError as error:
            raise DataError(f"{folder / _ARRAYS}: cannot be written: {error}") from error

    @classmethod
    def load(cls, folder: Path) -> "Record":
        """Read what `save` wrote.

        Raises:
            ContactLearnError: a file is missing, damaged, or does not fit the others.
        """
        arrays = _arrays(folder / _ARRAYS)
        try:
            about, outcomes = json.loads(str(arrays["about"])), torch.from_numpy(arrays["outcomes"])
            residuals, deviations = _evidence(arrays, "", Partial), _evidence(arrays, "deviations_", Deviations)
            impacts = table.load(folder / _IMPACTS, make_shapes(about["shape"]), validate=False)
            impacts = impacts.replace(source=str(about["source"]), validate=bool(about["validate"]))
        except (KeyError, TypeError, ValueError) as error:
            raise DataError(f"{folder / _ARRAYS}: is no record of a diagnosis, or not all of one: {error}") from None
        if outcomes.ndim != 3 or outcomes.shape[1:] != impacts.v_post.shape:
            raise DataError(
                f"{folder / _ARRAYS}: outcomes must have shape (choices, {len(impacts)}, {impacts.space.D}) for the "
                f"{len(impacts)} trials of {_IMPACTS}, got {tuple(outcomes.shape)}; do the files belong to one run?"
            )
        base, model = (checkpoint.load(folder / name) for name in (_BASE, _MODEL))
        return cls(
            impacts=impacts, base=base, model=model, outcomes=outcomes, residuals=residuals, deviations=deviations
        )


def _arrays(path: Path) -> dict[str, np.ndarray]:
    try:
        with np.load(path, allow_pickle=False) as file:
            return dict(file)
    except FileNotFoundError:
        raise ContactLearnError(f"{path}: no such file; the run made no record, or it was moved") from None
    except Exception as error:  # a damaged file can break anything
        raise DataError(f"{path}: cannot be read: {type(error).__name__}: {error}") from None


def _evidence_arrays(prefix: str, evidence: tuple[Partial, ...] | tuple[Deviations, ...]) -> dict[str, np.ndarray]:
    """Fields of each evidence by prefix, field and number."""
    return {
        f"{prefix}{field.name}_{k}": np.asarray(getattr(item, field.name))
        for k, item in enumerate(evidence)
        for field in fields(item)
    }


def _evidence(arrays: Mapping[str, np.ndarray], prefix: str, kind: type[_Evidence]) -> tuple[_Evidence, ...]:
    """Read what `_evidence_arrays` wrote."""
    names = [field.name for field in fields(kind)]
    evidence, count = list[_Evidence](), sum(name.startswith(f"{prefix}{names[0]}_") for name in arrays)
    for k in range(count):
        read = {name: arrays[f"{prefix}{name}_{k}"] for name in names}
        values: dict[str, Any] = {n: str(x) if x.dtype.kind == "U" else torch.from_numpy(x) for n, x in read.items()}
        evidence.append(kind(**values))
    return tuple(evidence)
