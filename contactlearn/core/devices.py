"""Devices on which tensors lie and are computed: the CPU, or a GPU that PyTorch sees.

    there = moved(impacts, "cuda")
    fit = moved(fit(there, "mirtich", ["spin_damping"]), "cpu")

Laws, effects, identification, bounds, errors and processes compute where their impacts lie, and their results stay
there.  Random numbers are drawn on the CPU, so that they are the same on every device.  A model predicts impacts on its
own device; numbers alone (a law at μ = 0.2) go with any.
"""

import copy
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from types import MappingProxyType
from typing import Any, TypeVar

import torch
from torch import Tensor

from contactlearn.core.errors import ContactLearnError, UnknownNameError

NAMES = ("auto", "cpu", "cuda")
"""Devices by name; `auto` is the GPU if there is one."""

Thing = TypeVar("Thing")


def find(name: str) -> torch.device:
    """Return a device by name.

    Raises:
        UnknownNameError: no such device.
        ContactLearnError: there is no GPU, or this build of PyTorch cannot use it.
    """
    if str(name).lower() in ("gpu", "cuda:0"):
        raise ContactLearnError(f"unknown device {name!r}, did you mean 'cuda'?; known: {', '.join(NAMES)}")
    if name not in NAMES:
        raise UnknownNameError("device", name, NAMES)
    there = name != "cpu" and torch.cuda.is_available()
    if name == "cuda" and not there:
        built = torch.version.cuda or torch.version.hip
        why = f"built for {built}" if built else "built for the CPU alone"
        fix = (
            "look at the driver (nvidia-smi) and at CUDA_VISIBLE_DEVICES"
            if built
            else "install one for CUDA, see pytorch.org"
        )
        raise ContactLearnError(
            f"device=cuda needs a GPU, and PyTorch {torch.__version__}, {why}, sees none; {fix}, or use device=cpu"
        )
    return torch.device("cuda" if there else "cpu")


def described(device: torch.device) -> str:
    """Return a device in words, a GPU with its name."""
    return f"cuda ({torch.cuda.get_device_name(device)})" if device.type == "cuda" else device.type


def moved(thing: Thing, device: torch.device | str) -> Thing:
    """Return a thing with all its tensors on a device.

    Args:
        thing: a tensor, a PyTorch module, or a dataclass, named tuple, tuple, list or dictionary of such, at any depth:
            impacts, laws, effects, models, fits, predictions.  What is there already is returned as it is.
        device: of PyTorch.
    """
    found: Any = thing
    if isinstance(thing, Tensor):
        found = thing.to(device)
    elif isinstance(thing, torch.nn.Module):
        away = any(part.to(device) is not part for part in (*thing.parameters(), *thing.buffers()))
        found = copy.deepcopy(thing).to(device) if away else thing
    elif isinstance(thing, dict | MappingProxyType):
        parts = {key: moved(part, device) for key, part in thing.items()}
        found = parts if _differ(parts, thing) else thing
    elif isinstance(thing, tuple | list):
        several = [moved(part, device) for part in thing]
        if any(new is not old for new, old in zip(several, thing, strict=True)):
            found = type(thing)._make(several) if hasattr(thing, "_make") else type(thing)(several)  # pyright: ignore[reportAttributeAccessIssue]
    elif is_dataclass(thing) and not isinstance(thing, type):
        own = {field.name: getattr(thing, field.name) for field in fields(thing) if field.init}
        parts = moved(own, device)
        found = replace(thing, **parts) if parts is not own else thing
    return found


def _differ(new: Mapping[Any, Any], old: Mapping[Any, Any]) -> bool:
    return any(new[key] is not old[key] for key in old)
