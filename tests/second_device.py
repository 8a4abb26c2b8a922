"""A second device on the CPU, which is as strict about where tensors lie as a GPU, for machines without one.

A tensor of the device holds a tensor of the CPU, on which everything is computed, and has PyTorch's key for devices
of others (PrivateUse1): dispatch, autograd and vmap treat it as they treat a GPU's.  Raised are the errors of a
GPU: a tensor of the CPU beside one of the device, unless it is a number that PyTorch would take along or an index, and
`.numpy()`.  It knows nothing of kernels, memory or speed of a real one.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import torch
from torch.overrides import TorchFunctionMode
from torch.utils import _pytree
from torch.utils.backend_registration import _setup_privateuseone_for_python_backend

NAME = "twin"
_FROM_PYTHON = (torch.tensor, torch.as_tensor)
_INDEXING = (torch.Tensor.__getitem__, torch.Tensor.__setitem__)
_CONTAINERS = (list, tuple, dict)
_COPIES = ("aten::copy_", "aten::_copy_from", "aten::_to_copy")
_INDEXED = ("aten::index", "aten::index_put", "aten::index_put_", "aten::_index_put_impl_")


class Twin(torch.Tensor):
    """A tensor of the second device, with its numbers in `raw`."""

    raw: torch.Tensor

    @staticmethod
    def __new__(cls, raw: torch.Tensor):
        layout = {"strides": raw.stride(), "storage_offset": raw.storage_offset(), "dtype": raw.dtype}
        twin = torch.Tensor._make_wrapper_subclass(cls, raw.size(), device=f"{NAME}:0", **layout)
        twin.raw = raw
        return twin

    def __repr__(self) -> str:
        return f"Twin({self.raw!r})"

    def tolist(self) -> Any:
        return self.raw.tolist()

    def numpy(self, **_: Any) -> Any:
        raise TypeError(f"can't convert {NAME}:0 device type tensor to numpy. Use Tensor.cpu() first.")

    __array__ = numpy

    @classmethod
    def __torch_dispatch__(cls, op, types, args=(), kwargs=None):
        return _compute(op, *args, **(kwargs or {}))


def _compute(op, *args, **kwargs):
    """Compute on the CPU what is asked for on the device."""
    flat, built = _flat(args, kwargs)
    away = [x for x in flat if isinstance(x, torch.Tensor) and not isinstance(x, Twin)]
    if away and len(away) < sum(isinstance(x, torch.Tensor) for x in flat) and not _goes_along(op, args, away):
        raise RuntimeError(f"Expected all tensors to be on the same device, but found {NAME}:0 and cpu, in {op}")
    raw = [x.raw if isinstance(x, Twin) else torch.device("cpu") if isinstance(x, torch.device) else x for x in flat]
    own_args, own_kwargs = built(raw)
    result = op(*own_args, **own_kwargs)
    if op._schema.name == "aten::_copy_from":
        return args[1]
    if kwargs.get("device") is not None and torch.device(kwargs["device"]).type == "cpu":
        return result
    known = {id(own): twin for own, twin in zip(raw, flat, strict=True) if isinstance(twin, Twin)}  # changed in place
    if isinstance(result, torch.Tensor):
        return known[id(result)] if id(result) in known else Twin(result)
    return _pytree.tree_map_only(torch.Tensor, lambda x: known[id(x)] if id(x) in known else Twin(x), result)


def _flat(args, kwargs) -> tuple[list[Any], Callable[[list[Any]], tuple[Any, Any]]]:
    """What an operation is given as one list, and how to build it again; most are given no lists, which is quick."""
    flat = [*args, *kwargs.values()]
    if any(isinstance(x, _CONTAINERS) for x in flat):
        flat, spec = _pytree.tree_flatten((args, kwargs))
        return flat, lambda parts: _pytree.tree_unflatten(parts, spec)
    return flat, lambda parts: (parts[: len(args)], dict(zip(kwargs, parts[len(args) :], strict=True)))


def _goes_along(op, args, away: list[torch.Tensor]) -> bool:
    """Whether PyTorch takes tensors of the CPU along in an operation on a GPU."""
    name = op._schema.name
    if name in _COPIES:
        return True
    if op._schema.is_mutable and not isinstance(args[0], Twin):
        return False
    if name in _INDEXED:
        return isinstance(args[0], Twin) and (len(args) < 3 or isinstance(args[2], Twin) or args[2].dim() == 0)
    tensors = sum(isinstance(x, torch.Tensor) for x in args)
    pointwise = name == "aten::where" or (torch.Tag.pointwise in op.tags and tensors <= 2)
    return pointwise and all(x.dim() == 0 for x in away)


class _BeforeDispatch(TorchFunctionMode):
    """What does not get as far as dispatch: numbers and lists of Python come by way of the CPU, and `x.data = y`."""

    def __torch_function__(self, function, types, args=(), kwargs=None):
        kwargs = dict(kwargs or {})
        if function in _FROM_PYTHON and not isinstance(args[0], torch.Tensor) and kwargs.get("device") is not None:
            device = kwargs.pop("device")
            return function(*args, **kwargs).to(device)
        if function in _INDEXING and isinstance(args[1], list):
            return function(args[0], torch.tensor(args[1]), *args[2:])
        if function == torch.Tensor.data.__set__ and isinstance(args[0], Twin):
            args[0].raw = args[1].raw
        return function(*args, **kwargs)


_LIBRARY: list[torch.library.Library] = []


@contextmanager
def second_device() -> Iterator[torch.device]:
    """The device, which is made once for the process; constructors know it within."""
    if not _LIBRARY:
        _setup_privateuseone_for_python_backend(NAME)
        _LIBRARY.append(torch.library.Library("_", "IMPL"))
        _LIBRARY[0].fallback(_compute, "PrivateUse1")
    # Backward passes in this thread: one that ends with the process must not hold tensors of Python.
    with _BeforeDispatch(), torch.autograd.set_multithreading_enabled(False):
        yield torch.device(NAME)
