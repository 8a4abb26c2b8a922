"""A ContactModel as one .pt file, with where it came from: what `save` writes, `load` gives back.

    description   JSON text: format number, model, provenance; the model as a tree of its parts,
                  each of a kind, with the shape in place of a tensor
    tensors       float64 by their place in that tree, such as model.base.mu

A file holds tensors and text, and nothing in it is ever executed.  Gaussian processes are their
training data and GPyTorch's state dict; how their hyperparameters were found is not kept.
"""

import json
import os
from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from pickle import UnpicklingError
from typing import Any
from zipfile import ZIP_STORED, BadZipFile, ZipFile

import torch
from torch import Tensor

from contactlearn import effects, laws
from contactlearn.core.errors import ContactLearnError, DataError, UnknownNameError
from contactlearn.core.numerics import atomic_write
from contactlearn.effects import Effect, columns
from contactlearn.laws import Law
from contactlearn.mechanics.features import SPACES
from contactlearn.models.contact_model import RESIDUALS, ContactModel
from contactlearn.models.process_options import ProcessOptions
from contactlearn.models.regressor import Regressor
from contactlearn.models.standardisation import Standardisation
from contactlearn.scatter import Component, find_component

FORMAT = 3
"""Number of the file format; a file of a higher one is refused.

Format 1 has an effect's form among its options, format 2 no modules of processes other than the default ones.
"""

_KINDS = {kind.__name__: kind for kind in (ContactModel, Regressor, Standardisation)}
_NOT_KEPT = ("status", "provenance")  # a file has its own provenance beside the model
_INFINITE = (".scale", "_bound")  # may be so: of a constant column, of GPyTorch's constraints
_FIX = "copy the file again, upgrade contactlearn if a newer one wrote it, or save the model again"


def save(model: ContactModel, path: str | os.PathLike[str], *, provenance: Mapping[str, Any] | None = None) -> Path:
    """Write a model and its provenance; the file appears whole or not at all.

    Args:
        model: with leading axes or without.
        path: of a .pt file.
        provenance: settings and data that made the model, as JSON; `model.provenance` if None.

    Raises:
        DataError: a suffix other than .pt, or the file cannot be written.
        TypeError: the provenance is not JSON.
    """
    path, tensors, about = Path(path), {}, dict(model.provenance if provenance is None else provenance)
    if path.suffix != ".pt":
        raise DataError(f"{path}: a checkpoint is a .pt file, got suffix {path.suffix!r}")
    description = {"format": FORMAT, "model": _describe(model, "model", tensors), "provenance": about}
    contents = {"description": json.dumps(description), "tensors": tensors}
    try:
        with atomic_write(path) as part, part.open("wb") as file:  # of a path, PyTorch's error has no cause
            torch.save(contents, file)
    except (OSError, RuntimeError) as error:
        raise DataError(f"{path}: cannot be written: {getattr(error, 'strerror', None) or error}") from error
    return path


def load(path: str | os.PathLike[str]) -> ContactModel:
    """Read the model of a file, on the CPU, with its provenance.

    Raises:
        DataError: no such file, not a checkpoint, not all of one, or one of a newer format.
    """
    path = Path(path)
    if not path.exists():
        raise DataError(f"{path}: no such file; check the path (relative to {Path.cwd()})")
    try:
        return _read(path)
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error}") from error
    except ContactLearnError as error:
        raise DataError(f"{path}: {error}; {_FIX}") from error
    except UnpicklingError as error:  # its text tells how to execute the file all the same
        raise DataError(f"{path}: is not a checkpoint, for it holds more than tensors and text; {_FIX}") from error
    except Exception as error:  # a damaged file can break anything
        seen = f"{type(error).__name__}: {error}"
        raise DataError(f"{path}: is not a checkpoint, or not all of one ({seen}); {_FIX}") from error


def _read(path: Path) -> ContactModel:
    size = path.stat().st_size
    with ZipFile(path) as archive:  # PyTorch does not look at the checksums
        _refuse_bombs(archive, size)
        if damaged := archive.testzip():
            raise BadZipFile(f"wrong checksum of {damaged}")
    contents = torch.load(path, weights_only=True, map_location="cpu")
    description, tensors = json.loads(contents["description"]), contents["tensors"]
    if (swollen := sum(tensor.numel() * tensor.element_size() for tensor in tensors.values())) > size:
        raise DataError(f"has tensors of {swollen} bytes in {size}")  # such as one number with the shape of a matrix
    if description["format"] > FORMAT:
        raise DataError(f"is of format {description['format']}, and the newest known is {FORMAT}")
    model = _build(description["model"], "model", tensors)
    if tensors:
        raise DataError(f"no part of the model has a tensor {', '.join(tensors)}")
    if not isinstance(provenance := description["provenance"], dict):
        raise DataError(f"has provenance {provenance!r}, and it is always an object of JSON")
    return replace(model, provenance=provenance)


def _refuse_bombs(archive: ZipFile, size: int) -> None:
    """Refuse an archive that is larger inside than outside, before anything of it is read.

    `save` compresses nothing, and no part of its files lies within another.
    """
    inside = sum(part.file_size for part in archive.infolist())
    written = [(part.compress_type, part.compress_size - part.file_size) for part in archive.infolist()]
    if inside > size or any(one != (ZIP_STORED, 0) for one in written):
        raise DataError(f"is compressed, {inside} bytes in {size}, and a checkpoint never is")
    if any(part.external_attr for part in archive.infolist()):  # PyTorch leaves the memory of a folder as it was
        raise DataError("holds a folder, or a file with attributes, and a checkpoint never does")


def _describe(part: Any, name: str, tensors: dict[str, Tensor]) -> Any:
    """A part in JSON; its tensors are added to `tensors`, as copies: of a view, PyTorch saves all that it views."""
    if isinstance(part, Tensor | float | int):
        part = torch.as_tensor(part, dtype=torch.float64).detach().cpu()
        tensors[name] = part.clone(memory_format=torch.contiguous_format)
        return part.shape
    if part is None or isinstance(part, str):
        return part
    if isinstance(part, Mapping):
        return {"kind": "effects"} | {key: _describe(part[key], f"{name}.{key}", tensors) for key in part}
    if isinstance(part, Effect):
        values = _describe(columns(*part.values), f"{name}.values", tensors)
        return {"kind": "effect", "name": part.name, "form": part.form, "options": part.options, "values": values}
    if isinstance(part, Component):
        return {"kind": "scatter", "name": part.name, "sigma": _describe(part.sigma, f"{name}.sigma", tensors)}
    if isinstance(part, Law):
        plain = {key: value for key, value in part.options.items() if not isinstance(value, Tensor | float)}
        parts = {key: value for key, value in vars(part).items() if key not in plain}
        about = {"kind": "Law", "name": part.name, "variant": part.variant} | ({"options": plain} if plain else {})
    elif isinstance(part, torch.nn.Module):
        from contactlearn.models.gp.modules import as_text  # GPyTorch takes long to load

        gps: Any = part
        x, y, weight, options, noise = gps.data()
        parts = {"x": x, "y": y, "weight": weight, "noise": noise} | gps.state_dict()
        about = {"kind": type(part).__name__, "options": as_text(vars(replace(options, optimiser=None)))}
    else:
        parts = {field.name: getattr(part, field.name) for field in fields(part) if field.name not in _NOT_KEPT}
        about = {"kind": type(part).__name__}
    return about | {key: _describe(value, f"{name}.{key}", tensors) for key, value in parts.items()}


def _build(description: Any, name: str, tensors: dict[str, Tensor]) -> Any:
    """The part that `_describe` described; its tensors are removed from `tensors`."""
    if isinstance(description, list):
        return _take(tensors, name, tuple(description))
    if description is None or isinstance(description, str):
        return description
    kind = description.pop("kind")
    if kind == "effect":
        return _build_effect(description).at(_build(description["values"], f"{name}.values", tensors))
    if kind == "effects":
        return {key: _build(value, f"{name}.{key}", tensors) for key, value in description.items()}
    if kind == "scatter":
        sigma = _build(description["sigma"], f"{name}.sigma", tensors)
        return find_component(description["name"])(sigma=sigma.item())
    if kind == "Law":
        return _build_law(description, name, tensors)
    options = description.pop("options", {"prior": False})
    parts = {key: _build(value, f"{name}.{key}", tensors) for key, value in description.items()}
    if kind not in _KINDS:
        return _build_processes(kind, parts, options)
    part = _KINDS[kind](**parts)
    if isinstance(part, ContactModel) and part.target not in RESIDUALS:
        raise UnknownNameError("target", part.target, RESIDUALS)
    if isinstance(part, Regressor):
        _check_space(part, name)
    return part


def _build_processes(kind: str, parts: dict[str, Any], options: dict[str, Any]) -> torch.nn.Module:
    """Gaussian processes of a class by name, from their training data, the other tensors, and their modules."""
    from contactlearn.models.gp.exact import ExactGPs, checked_options  # GPyTorch takes long to load
    from contactlearn.models.gp.sparse import SparseGPs

    family = {"ExactGPs": ExactGPs, "SparseGPs": SparseGPs}[kind]
    parts = {"noise": None} | parts
    x, y, weight, noise = (parts.pop(key) for key in ("x", "y", "weight", "noise"))
    columns = list(map(str, range(x.shape[-1])))  # a file has their numbers
    gps = family(x, y, weight, checked_options(ProcessOptions(**options), columns), noise)
    gps.load_state_dict(parts)
    return gps.eval()


def _check_space(part: Regressor, name: str) -> None:
    """Refuse a regressor on an unknown feature space, or with another number of columns than its space has."""
    if part.space not in SPACES:
        raise UnknownNameError("feature space", part.space, SPACES)
    wanted, seen = SPACES[part.space], part.inputs.mean.shape[-1]
    if seen not in (len(wanted.columns), len(wanted.in_space)):
        raise DataError(
            f"{name}.inputs.mean has {seen} columns, and feature space {part.space} has {len(wanted.columns)}"
        )


def _build_effect(description: dict[str, Any]) -> Effect:
    """The effect of a description, before it gets its values; format 1 has the form among the options."""
    options = _tuples(description["options"])
    form = description["form"] if "form" in description else options.pop("form", None)
    return effects.find_effect(description["name"], form)(**options)


def _build_law(description: dict[str, Any], name: str, tensors: dict[str, Tensor]) -> Law:
    """The law of a description; in older files every law has an e_t, which most laws ignored."""
    law = laws.find(description.pop("name"), description.pop("variant"), **_tuples(description.pop("options", {})))
    parts = {key: _build(value, f"{name}.{key}", tensors) for key, value in description.items()}
    if "e_t" not in law.options:
        parts.pop("e_t", None)
    return replace(law, **parts)


def _tuples(value: Any) -> Any:
    """JSON's lists as tuples."""
    if isinstance(value, dict):
        return {key: _tuples(part) for key, part in value.items()}
    return tuple(map(_tuples, value)) if isinstance(value, list) else value


def _take(tensors: dict[str, Tensor], name: str, shape: tuple[int, ...]) -> Tensor:
    """Remove and return a tensor that is as it should be."""
    if name not in tensors:
        raise DataError(f"lacks the tensor {name}")
    tensor = tensors.pop(name)
    if (tensor.shape, tensor.dtype) != (shape, torch.float64):
        raise DataError(f"{name} must be float64 of shape {shape}, got {tensor.dtype} of {tuple(tensor.shape)}")
    good = ~tensor.isnan() if name.endswith(_INFINITE) else tensor.isfinite()
    if not good.all():
        raise DataError(f"{name} must be finite, got {tensor[~good][0].item()}")
    return tensor
