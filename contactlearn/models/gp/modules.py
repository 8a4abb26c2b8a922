"""GPyTorch modules from descriptions: which kernel, mean and likelihood a process has.

A description is what a YAML file or a checkpoint says: a class by `_target_`, its arguments by name, positional ones
under `_args_`, and other modules as descriptions of their own.

    {"_target_": "gpytorch.kernels.MaternKernel", "nu": 1.5}

A class is found among GPyTorch's own kernels, means, likelihoods, priors and constraints, and among subclasses of these
that have been imported already: a description never imports anything.  `batch_shape`, `ard_num_dims`, `num_dims`,
`input_size` and the fixed `noise` of a likelihood are filled in where a class takes them and the description leaves
them out.
"""

import inspect
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import gpytorch
import torch
from gpytorch.constraints import Interval
from gpytorch.kernels import Kernel
from gpytorch.likelihoods import Likelihood
from gpytorch.means import Mean
from gpytorch.priors import Prior
from torch import optim

from contactlearn.core.errors import ContactLearnError, UnknownNameError
from contactlearn.core.numerics import is_whole

_PACKAGES = {"kernels": Kernel, "means": Mean, "likelihoods": Likelihood, "priors": Prior, "constraints": Interval}
_OF_DERIVATIVES = "is of a function and its derivatives, and no derivative is measured"
_OF_TASKS = "is of several tasks by their numbers, and each output has processes of its own"
_OF_DISTRIBUTIONS = "is of distributions, and features are numbers"
_APPROXIMATE = "approximates another kernel; take that one: beyond 2000 trials the processes are sparse by themselves"
NOT_FOR_FEATURES = {
    "CylindricalKernel": "is defined within the unit ball, and standardised features lie outside",
    "DistributionalInputKernel": _OF_DISTRIBUTIONS,
    "GaussianSymmetrizedKLKernel": _OF_DISTRIBUTIONS,
    "GridInterpolationKernel": _APPROXIMATE,
    "GridKernel": _APPROXIMATE,
    "HammingIMQKernel": "is of sequences of letters, and features are numbers",
    "IndexKernel": _OF_TASKS,
    "InducingPointKernel": _APPROXIMATE,
    "Kernel": "is the base of all kernels",
    "LCMKernel": _OF_TASKS,
    "Matern52KernelGrad": _OF_DERIVATIVES,
    "MultiDeviceKernel": "shares the work among GPUs; take the kernel in it, and device=cuda",
    "MultitaskKernel": _OF_TASKS,
    "NewtonGirardAdditiveKernel": "computes in single precision; take AdditiveStructureKernel",
    "PolynomialKernelGrad": _OF_DERIVATIVES,
    "RBFKernelGrad": _OF_DERIVATIVES,
    "RBFKernelGradGrad": _OF_DERIVATIVES,
}
"""Kernels of GPyTorch that processes on features cannot have, and why."""

_LARGEST = 10_000  # of a whole number: a shared description must not fill the memory


def find(target: object) -> type[torch.nn.Module]:
    """Return the class of a dotted name, or the class itself.

    Raises:
        UnknownNameError: GPyTorch has no such module.
        ContactLearnError: no class of this name has been imported.
    """
    if isinstance(target, type) and issubclass(target, tuple(_PACKAGES.values())):
        return target
    library, _, path = str(target).partition(".")
    package, _, name = path.partition(".")
    if library == "gpytorch" and package in _PACKAGES:
        classes, base = vars(getattr(gpytorch, package)), _PACKAGES[package]
        known = {key: kind for key, kind in classes.items() if isinstance(kind, type) and issubclass(kind, base)}
        if name not in known:
            raise UnknownNameError(f"module of gpytorch.{package}", name, known)
        return known[name]
    for kind in (kind for base in _PACKAGES.values() for kind in _subclasses(base)):
        if target == dotted_name(kind):
            return kind
    raise ContactLearnError(
        f"{target} is no module of GPyTorch's {', '.join(_PACKAGES)}, and no subclass of one that has been imported; "
        f"import {str(target).rpartition('.')[0] or 'its module'} first, if you trust it"
    )


def dotted_name(kind: type) -> str:
    """Return the name by which `find` finds a class."""
    for package in _PACKAGES:
        if vars(getattr(gpytorch, package)).get(kind.__name__) is kind:
            return f"gpytorch.{package}.{kind.__name__}"
    return f"{kind.__module__}.{kind.__qualname__}"


def _subclasses(base: type) -> Iterator[type]:
    for kind in base.__subclasses__():
        yield kind
        yield from _subclasses(kind)


def resolved(description: Mapping[str, Any], columns: Sequence[str], package: str | None = None) -> dict[str, Any]:
    """Return a description with classes for their names, and column numbers for names of features.

    Args:
        description: of a module.
        columns: names of the features.
        package: kernels, means or likelihoods, if the module must be from it.

    Raises:
        ContactLearnError: no `_target_`, a class that is not found, or an argument that it does not take.
        UnknownNameError: no such feature.
    """
    if "_target_" not in description:
        raise ContactLearnError(f"needs a class, such as _target_: gpytorch.kernels.MaternKernel; got {description}")
    kind = find(description["_target_"])
    if package is not None and not issubclass(kind, _PACKAGES[package]):
        raise ContactLearnError(f"must be a class of gpytorch.{package}, got {dotted_name(kind)}")
    if kind.__module__.startswith("gpytorch.") and (reason := NOT_FOR_FEATURES.get(kind.__name__)):
        raise ContactLearnError(f"{kind.__name__} {reason}")
    classes: dict[str, Any] = {"_target_": kind}
    for name, value in description.items():
        if name not in ("_target_", "_args_") and name not in (known := _parameters(kind)):
            raise UnknownNameError(f"argument of {kind.__name__}", name, sorted(known))
        if name == "active_dims" and value is not None:
            value = [_column(one, columns) for one in (value if isinstance(value, list | tuple) else [value])]
        if name != "_target_":
            classes[name] = _plain(name, value, columns)
    return classes


def resolved_optimiser(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings of an optimiser with its class for its name, after a trial.

    Raises:
        ContactLearnError: counts below 1, arguments without a class, or with one that does not take them.
        UnknownNameError: torch.optim has no such optimiser.
    """
    found = {name: value for name, value in settings.items() if value is not None}
    for name in ("starts", "iterations"):
        if not is_whole(found.get(name, 1), 1):
            raise ContactLearnError(f"{name} must be a whole number, 1 or more, got {found[name]!r}")
    arguments = {name: value for name, value in found.items() if name not in ("_target_", "starts", "iterations")}
    known = {f"torch.optim.{name}": kind for name, kind in vars(optim).items() if isinstance(kind, type)}
    target = found.get("_target_")
    if target is None and arguments:
        raise ContactLearnError(f"{', '.join(arguments)} needs a class, such as _target_: torch.optim.Adam")
    if target is not None:
        if target not in known and target not in known.values():
            raise UnknownNameError("optimiser", str(target), known)
        kind: Any = known.get(target, target)
        found["_target_"] = kind
        kind([torch.zeros(1, requires_grad=True)], **arguments)
    return found


def _column(name: object, columns: Sequence[str]) -> int:
    """The number of a feature."""
    if isinstance(name, str) and name not in columns:
        raise UnknownNameError("feature", name, columns)
    number = columns.index(name) if isinstance(name, str) else name
    if type(number) is not int or not 0 <= number < len(columns):
        raise ContactLearnError(
            f"active_dims are names of features, or numbers from 0 to {len(columns) - 1}, of {', '.join(columns)}; "
            f"got {name!r}"
        )
    return number


def _plain(name: str, value: Any, columns: Sequence[str]) -> Any:
    """An argument: a number, text, a list of such, or a module's description."""
    if isinstance(value, Mapping):
        return resolved(value, columns)
    if isinstance(value, list | tuple):
        return [_plain(name, one, columns) for one in value]
    if not (value is None or isinstance(value, bool | int | float | str)) or (
        isinstance(value, int) and abs(value) > _LARGEST
    ):
        raise ContactLearnError(f"{name} must be a number (whole ones up to {_LARGEST}), a word or a list, got {value}")
    return value


def as_text(description: Any) -> Any:
    """Return a resolved description, or several by name, with names for the classes, as JSON."""
    if isinstance(description, Mapping):
        return {name: as_text(value) for name, value in description.items()}
    if isinstance(description, list):
        return [as_text(value) for value in description]
    return dotted_name(description) if isinstance(description, type) else description


def build(description: Mapping[str, Any], filled: Mapping[str, Any]) -> Any:
    """Make the module of a resolved description.

    Args:
        description: see `resolved`.
        filled: arguments for classes that take them, where the description leaves them out.  `ard_num_dims`,
            `num_dims` and `input_size` are the number of features; those of a kernel on some columns are these alone.
    """
    kind, filled = description["_target_"], dict(filled)
    if description.get("active_dims") is not None:
        filled |= dict.fromkeys(("ard_num_dims", "num_dims"), len(description["active_dims"]))
    arguments = {name: value for name, value in description.items() if name not in ("_target_", "_args_")}
    inner = dict(filled)
    if kind is gpytorch.kernels.ArcKernel:
        inner["ard_num_dims"] *= 2  # each feature is a cosine and a sine to the kernel inside
    arguments = {name: _argument(value, kind, inner) for name, value in arguments.items()}
    parts = [_argument(value, kind, inner) for value in description.get("_args_", ())]
    if any(isinstance(part, Kernel) for part in (*arguments.values(), *parts)):
        del filled["ard_num_dims"]  # of the kernels inside
    takes = _parameters(kind)
    return kind(*parts, **{name: value for name, value in filled.items() if name in takes} | arguments)


def _argument(value: Any, kind: type, filled: Mapping[str, Any]) -> Any:
    if isinstance(value, Mapping):
        return build(value, filled)
    exact = isinstance(value, float | list) and issubclass(kind, Prior)
    return torch.tensor(value, dtype=torch.float64) if exact else value


def _parameters(kind: type) -> set[str]:
    """Names of a constructor's arguments, those that it hands on to its base with ** among them."""
    names: set[str] = set()
    for base in kind.__mro__:
        if "__init__" in vars(base):
            parameters = list(inspect.signature(base.__init__).parameters.values())[1:]
            names |= {one.name for one in parameters if one.kind in (one.POSITIONAL_OR_KEYWORD, one.KEYWORD_ONLY)}
            if not any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters):
                break
    return names
