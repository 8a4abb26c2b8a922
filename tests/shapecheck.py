"""Shapes of tensors, checked at every call while testing: what `Float[Tensor, "*batch n 3"]` says must hold.

A call costs about a third more, too much for all tests, so test_shapes runs some commands in processes of their own
that begin with `install`.  It makes jaxtyping wrap every function and dataclass
of the package as it is imported.  Arrays alone are checked: the other annotations are pyright's, and tests pass wrong
values on purpose to see them refused.
"""

from collections.abc import Callable
from typing import Any, TypeVar, get_args

import beartype
from jaxtyping import AbstractArray, install_import_hook

Checked = TypeVar("Checked", bound=Callable[..., Any])


def install() -> None:
    """Check the package from its next import on."""
    install_import_hook("contactlearn", "shapecheck.arrays")


def arrays(function: Checked) -> Checked:
    """The function with its arrays checked, or itself where it names none."""
    hints = {name: hint for name, hint in function.__annotations__.items() if _has_array(hint)}
    if not hints:
        return function
    function.__annotations__ = hints
    return beartype.beartype(function)


def _has_array(hint: Any) -> bool:
    if isinstance(hint, type) and issubclass(hint, AbstractArray):
        return True
    return any(map(_has_array, get_args(hint)))
