"""The arithmetic of a model for one impact: a list of operations on single numbers, recorded while PyTorch computes it.

Every tensor that depends on an input has a second one of the same shape, of whole numbers: the places in the list of
the operations whose results its elements are.  What only moves elements about moves these numbers likewise.
"""

import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import reduce
from typing import Any

import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves, tree_map

from contactlearn.core.errors import ContactLearnError

Operation = tuple[str, tuple[Any, ...]]
"""Name and operands: places of other operations, or the one value of `constant`, `input` and `parameter`."""

_ELEMENTS = {
    **{name: name for name in ("neg", "abs", "sign", "sqrt", "exp", "expm1", "log", "sin", "cos", "sinh", "cosh")},
    **{name: name for name in ("tanh", "atanh", "mul", "div", "pow", "atan2", "hypot", "minimum", "maximum", "where")},
    **{name: name for name in ("lt", "le", "gt", "ge", "eq", "ne")},
    **{f"{kind}_{name}": name for kind in ("bitwise", "logical") for name in ("and", "or", "not")},
}
"""Operations of single numbers by their names in PyTorch, beside add and sub, which may have a factor."""

_MOVES = (
    *("view", "_unsafe_view", "reshape", "select", "slice", "unsqueeze", "squeeze", "cat", "stack", "unbind", "split"),
    "split_with_sizes",
    *("permute", "t", "transpose", "expand", "clone", "alias", "detach", "lift_fresh", "roll", "index_select"),
    *("_to_copy", "diagonal"),
)
_CONSTANT = ("zeros_like", "ones_like", "full_like", "empty_like", "new_zeros", "new_ones", "new_empty", "new_full")
LEAVES = ("constant", "input", "parameter")
"""Operations without operands."""
_KNOWN: Mapping[str, Callable[[Any, Any], Any]] = {
    name: getattr(operator, name) for name in ("add", "sub", "mul", "lt", "le", "gt", "ge", "eq", "ne")
}
"""Operations that are carried out where both operands are constants."""


@dataclass(frozen=True)
class Program:
    """Operations in an order in which each follows its operands, and the places of the results by name."""

    operations: list[Operation] = field(default_factory=list)
    results: dict[str, int] = field(default_factory=dict)
    _places: dict[Operation, int] = field(default_factory=dict, repr=False)

    def add(self, name: str, *operands: Any) -> int:
        """Return the place of an operation, which is added unless it is there already or its value is known."""
        if name not in LEAVES:
            values = [values[0] for kind, values in (self.operations[k] for k in operands) if kind == "constant"]
            if name in _KNOWN and len(values) == 2:
                return self.add("constant", _KNOWN[name](*values))
            if name == "stop" and values:
                return operands[0]
            if name == "where" and self.operations[operands[0]][0] == "constant":
                return operands[1] if values[0] else operands[2]
            if name == "mul" and self.operations[operands[1]] == ("constant", (1.0,)):
                return operands[0]
        key = (name, _bits(*operands) if name == "constant" else operands)
        if key not in self._places:
            self._places[key] = len(self.operations)
            self.operations.append((name, operands))
        return self._places[key]


def _bits(value: Any) -> Any:
    """A constant as a key: −0 is not 0, and true is not 1."""
    return type(value), value, math.copysign(1, value)


class Tracer(TorchDispatchMode):
    """Context in which operations on its inputs are recorded in `program`; `stop` is where derivatives end."""

    def __init__(self) -> None:
        super().__init__()
        self.program = Program()
        self._known: dict[int, Tensor] = {}
        self._still = set[int]()  # tensors without derivatives
        self._alive: list[Tensor] = []  # or another tensor might get the identity of one that is gone

    def value(self, kind: str, name: str, example: float) -> Tensor:
        """Return an input or a parameter of one trial [1] by name, with the value of the example."""
        tensor = torch.tensor([example], dtype=torch.float64)
        self._remember(tensor, torch.tensor([self.program.add(kind, name)]))
        return tensor

    def finish(self, results: Mapping[str, Tensor]) -> Program:
        """Return the program that computes some results [1] by name."""
        self.program.results.update({name: int(self._places(value)) for name, value in results.items()})
        return self.program

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        """Compute an operation, and record it if it depends on an input."""
        kwargs = kwargs or {}
        result = func(*args, **kwargs)
        if not any(id(x) in self._known for x in tree_leaves((args, kwargs))):
            return result
        name = func.overloadpacket.__name__.removesuffix("_")  # an operation in place is one like another
        still = name == "detach" or not torch.is_grad_enabled()
        if name == "any":  # what some trials need is computed for all
            return torch.ones_like(result)
        if name in _CONSTANT:
            return result
        places = self._recorded(name, func, args, kwargs, result)
        for part, one in [(result, places)] if isinstance(result, Tensor) else zip(result, places, strict=True):
            self._remember(part, one)
            if still:
                self._still.add(id(part))
        return result

    def _remember(self, tensor: Tensor, places: Tensor) -> None:
        self._known[id(tensor)] = places
        self._alive.append(tensor)

    def _places(self, value: Any) -> Tensor:
        """The places of the elements of a tensor or number; constants are added."""
        if isinstance(value, Tensor) and id(value) in self._known:
            places = self._known[id(value)]
            return self._each("stop", places) if id(value) in self._still and torch.is_grad_enabled() else places
        tensor = value if isinstance(value, Tensor) else torch.tensor(value, dtype=torch.float64)
        flat = [self.program.add("constant", x if isinstance(x, bool) else float(x)) for x in tensor.flatten().tolist()]
        return torch.tensor(flat, dtype=torch.int64).reshape(tensor.shape)

    def _each(self, name: str, *operands: Tensor) -> Tensor:
        """Places of an operation element by element, of places."""
        operands = torch.broadcast_tensors(*operands)
        each = [self.program.add(name, *one) for one in zip(*(x.flatten().tolist() for x in operands), strict=True)]
        return torch.tensor(each, dtype=torch.int64).reshape(operands[0].shape)

    def _recorded(self, name: str, func: Any, args: Any, kwargs: Any, result: Any) -> Any:
        """Places of the elements of a result."""
        each, one = self._each, self._places(1.0)
        if name in _MOVES:
            moved = tree_map(lambda x: self._places(x) if isinstance(x, Tensor) else x, args[0])
            return func(moved, *args[1:], **{key: x for key, x in kwargs.items() if key in ("dim", "memory_format")})
        first, *others = (self._places(x) if isinstance(x, Tensor | float | int) else x for x in args)
        if name in ("add", "sub", "rsub"):
            second = each("mul", others[0], self._places(kwargs["alpha"])) if kwargs.get("alpha", 1) != 1 else others[0]
            return each("sub", second, first) if name == "rsub" else each(name, first, second)
        if name == "pow" and args[1] in (2, 3):
            return each("mul", each("mul", first, first), first if args[1] == 3 else one)
        if name in _ELEMENTS:
            name = "logical_and" if name == "mul" and result.dtype == torch.bool else name
            return each(_ELEMENTS[name], first, *others)
        if name in ("reciprocal", "rsqrt"):
            return each("div", one, first if name == "reciprocal" else each("sqrt", first))
        if name == "sigmoid":
            return each("div", one, each("add", one, each("exp", each("neg", first))))
        if name == "sinc":
            angle = each("mul", first, self._places(math.pi))
            none = each("eq", angle, self._places(0.0))
            angle = each("where", none, one, angle)
            return each("where", none, one, each("div", each("sin", angle), angle))
        if name == "addcmul":
            return each("add", first, each("mul", each("mul", *others), self._places(kwargs.get("value", 1.0))))
        if name.startswith("clamp"):
            sides = ("min", "max") if name == "clamp" else (name.removeprefix("clamp_"),)
            given = dict(zip(sides, others, strict=False)) | {key: self._places(x) for key, x in kwargs.items()}
            for side, bound in given.items():
                first = first if bound is None else each("maximum" if side == "min" else "minimum", first, bound)
            return first
        if name == "constant_pad_nd":
            return func(first, args[1], self.program.add("constant", float(args[2]) if len(args) > 2 else 0.0))
        if name in ("sum", "amax", "amin", "linalg_vector_norm"):
            return self._reduced(name, first, args, result)
        if name in ("mm", "bmm", "mv", "dot"):
            flat = name in ("mv", "dot")
            products = each("mul", first.unsqueeze(-1), others[0].unsqueeze(-1) if flat else others[0].unsqueeze(-3))
            return self._reduced("sum", products, (None, [-2]), result)
        if name == "linalg_cross":
            (a, b), (c, d) = ([x.roll(-1, -1), x.roll(1, -1)] for x in (first, others[0]))
            return each("sub", each("mul", a, d), each("mul", b, c))
        if name == "argmax":
            return self._greatest(first.movedim(args[1], -1) if len(args) > 1 else first.flatten(), result)
        if name == "index" and len(args[1]) == 1:
            found, chosen = first[0], self._places(args[1][0])[(..., *(None,) * (first.ndim - 1))]
            for k in range(1, len(first)):
                found = each("where", each("eq", chosen, self._places(k)), first[k], found)
            return found.expand(result.shape)
        raise ContactLearnError(f"the model computes {func}, which has no form in single numbers")

    def _reduced(self, name: str, places: Tensor, args: Any, result: Tensor) -> Tensor:
        """Places of a sum, an extreme or a Euclidean norm over some axes."""
        axes = (args[2] if len(args) > 2 else None) if name == "linalg_vector_norm" else (args[1:] or (None,))[0]
        axes = [axes] if isinstance(axes, int) else axes or list(range(places.ndim))
        rows = places.movedim(axes, list(range(len(axes)))).flatten(0, len(axes) - 1)
        if name == "linalg_vector_norm":
            rows = self._each("mul", rows, rows)
        step = {"amax": "maximum", "amin": "minimum"}.get(name, "add")
        found = reduce(lambda a, b: self._each(step, a, b), rows)
        return (self._each("sqrt", found) if name == "linalg_vector_norm" else found).reshape(result.shape)

    def _greatest(self, places: Tensor, result: Tensor) -> Tensor:
        """Places of the number of the greatest element along the last axis, the first of equals."""
        best, number = places[..., 0], self._places(0)
        for k in range(1, places.shape[-1]):
            more = self._each("gt", places[..., k], best)
            best = self._each("where", more, places[..., k], best)
            number = self._each("where", more, self._places(k), number)
        return number.reshape(result.shape)
