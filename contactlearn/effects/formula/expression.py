"""Expression: one line of mathematics, such as -c*rx*Pn, as a differentiable function of tensors.

    numbers      2, 0.5, 1e-3; float64 as everything else, so 9**9**9 is inf at once
    names        whatever `evaluate` is given; pi and g (9.80665 m/s²) are always known
    operators    + − * / ** with Python's precedence, and parentheses
    functions    sin cos tan exp log sqrt abs sign tanh of one, min and max of two arguments

The text is data and is never executed.  It is cut into tokens, and anything else than the above is
refused there, so no quote, bracket, dot behind a name or keyword gets any further.  Python's parser then says
what binds to what, without compiling; its tree is checked node by node against the list above and kept
as steps for a stack.  Length, depth and number of steps are bounded.  Errors point at the character.
"""

import ast
import keyword
import math
import re
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import torch
from torch import Tensor

from contactlearn.core.errors import ContactLearnError, suggest

MAX_LENGTH, MAX_STEPS, MAX_DEPTH = 500, 200, 60
"""Characters; numbers, names, operators and calls; operators and calls within each other."""

CONSTANTS = {"pi": math.pi, "g": 9.80665}
FUNCTIONS = {
    "sin": (torch.sin, 1),
    "cos": (torch.cos, 1),
    "tan": (torch.tan, 1),
    "exp": (torch.exp, 1),
    "log": (torch.log, 1),
    "sqrt": (torch.sqrt, 1),
    "abs": (torch.abs, 1),
    "sign": (torch.sign, 1),
    "tanh": (torch.tanh, 1),
    "min": (torch.minimum, 2),
    "max": (torch.maximum, 2),
}
"""Function and number of arguments by name."""

_OPERATORS: dict[type[ast.operator] | type[ast.unaryop], Callable[..., Tensor]] = {
    ast.Add: torch.add,
    ast.Sub: torch.sub,
    ast.Mult: torch.mul,
    ast.Div: torch.div,
    ast.Pow: torch.pow,
    ast.USub: torch.neg,
    ast.UAdd: torch.positive,
}
_TOKEN = re.compile(r"(?P<number>(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?)|(?P<name>[A-Za-z_]\w*)|[-+*/(), ]", re.ASCII)
_INSTEAD = {"^": "**", "//": "/", "·": "*", "×": "*", "−": "-", "²": "**2", "³": "**3", "√": "sqrt", "π": "pi"} | dict(
    zip("μεθωτρ", ("mu", "eps", "theta", "omega", "tau", "rho"), strict=True)
)


class _Step(NamedTuple):
    """One operation on the stack: put a number or a name's tensor on it, or apply a function to its top."""

    kind: str
    what: Any
    arguments: int


class Expression:
    """A line of mathematics; `names` has its free names in order, each with the column of its first use.

    Raises:
        ContactLearnError: text that is anything else, with the text and a caret under the character.
    """

    text: str
    names: dict[str, int]

    def __init__(self, text: str):
        if not isinstance(text, str):
            raise ContactLearnError(f"an expression must be text, got {text!r}; write it in quotes")
        self.text, self.names, self._steps = re.sub(r"\s", " ", text.strip()), {}, []
        if not self.text:
            raise ContactLearnError("an expression must not be empty; write one such as -c*rx*Pn")
        if len(self.text) > MAX_LENGTH:
            raise self.error(MAX_LENGTH, f"an expression has at most {MAX_LENGTH} characters, got {len(self.text)}")
        self._scan()
        self._add(self._parse(), 1)

    def __repr__(self) -> str:
        return f"Expression({self.text!r})"

    def evaluate(self, values: Mapping[str, Tensor]) -> Tensor:
        """The value, with the names' values broadcast against each other.

        Raises:
            ContactLearnError: a name without a value.
        """
        self.require(values)
        stack: list[Tensor] = []
        for kind, what, arguments in self._steps:
            if kind == "number":
                stack.append(torch.tensor(what, dtype=torch.float64))
            elif kind == "name":
                stack.append(values[what])
            else:
                inputs = stack[-arguments:]
                stack[-arguments:] = [what(*inputs)]
        return stack.pop()

    def require(self, known: Iterable[str], kind: str = "symbol") -> None:
        """Refuse the first name that is not a known one."""
        known = list(known)
        for name, column in self.names.items():
            if name not in known:
                raise self.error(column, f"unknown {kind} {name!r}{suggest(name, known)}; known: {', '.join(known)}")

    def error(self, column: int, rule: str) -> ContactLearnError:
        """An error that shows the text, or as much of it as fits a line, with a caret under a column."""
        start, end = max(0, column - 60), column + 40
        before, after = ("…" if start else ""), ("…" if end < len(self.text) else "")
        shown = "".join(c if c.isprintable() else "?" for c in self.text[start:end])
        caret = " " * (len(before) + column - start)
        return ContactLearnError(f"{rule}\n    {before}{shown}{after}\n    {caret}^")

    def _scan(self) -> None:
        """Refuse every character that is no part of a number, a name, an operator or a parenthesis."""
        at, depth, previous = 0, 0, ""
        while at < len(self.text):
            token = _TOKEN.match(self.text, at)
            seen = "//" if self.text.startswith("//", at) else self.text[at]
            if seen in _INSTEAD or not token:
                hint = f"write {_INSTEAD[seen]}" if seen in _INSTEAD else "use names, numbers and + - * / **"
                raise self.error(at, f"{seen!r} is not allowed in an expression; {hint}")
            kind, part = token.lastgroup, token.group()
            if kind == "name":
                self._check_name(part, at, previous)
            depth += (part == "(") - (part == ")")
            if depth > MAX_DEPTH:
                raise self.error(at, f"an expression is at most {MAX_DEPTH} parentheses deep; name a part or simplify")
            at, previous = token.end(), kind

    def _check_name(self, name: str, column: int, previous: str | None) -> None:
        if previous == "number":
            raise self.error(column, f"a number and {name!r} without an operator between; write * for a product")
        if keyword.iskeyword(name) or name.startswith("_"):
            raise self.error(column, f"{name!r} is not allowed in an expression; it is only mathematics, not Python")

    def _parse(self) -> ast.expr:
        try:
            return ast.parse(self.text, mode="eval").body
        except SyntaxError as error:
            column = error.offset - 1 if error.offset else len(self.text)  # 0 for a text that ends too early
            raise self.error(min(column, len(self.text)), f"not a complete expression: {error.msg}") from None
        except (RecursionError, MemoryError, ValueError) as error:
            raise self.error(0, f"too deep for an expression ({type(error).__name__}); simplify it") from None

    def _add(self, node: ast.expr, depth: int) -> None:
        """Append the steps of a node and of all within it, or refuse it.  The text is ASCII: bytes are columns."""
        column = node.col_offset
        if depth > MAX_DEPTH:
            raise self.error(column, f"an expression is at most {MAX_DEPTH} operators deep; use fewer")
        match node:
            case ast.Constant(value=int() | float() as value):
                self._push("number", self._number(value, column), 0, column)
            case ast.Name(id=name) if name in FUNCTIONS:
                raise self.error(column, f"{name} is a function; write {name}(…) with what it is applied to")
            case ast.Name(id=name) if name in CONSTANTS:
                self._push("number", CONSTANTS[name], 0, column)
            case ast.Name(id=name):
                self.names.setdefault(name, column)
                self._push("name", name, 0, column)
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
                self._add(left, depth + 1)
                self._add(right, depth + 1)
                self._push("apply", _OPERATORS[type(op)], 2, column)
            case ast.UnaryOp(op=op, operand=operand) if type(op) in _OPERATORS:
                self._add(operand, depth + 1)
                self._push("apply", _OPERATORS[type(op)], 1, column)
            case ast.Call():
                self._call(node, depth)
            case ast.Tuple(elts=[first, *_]):
                comma = self.text.find(",", first.end_col_offset)
                raise self.error(comma, "a comma is only between the arguments of min and max; write a . in numbers")
            case _:
                raise self.error(column, "not allowed in an expression; it is only mathematics")

    def _call(self, node: ast.Call, depth: int) -> None:
        name = getattr(node.func, "id", None)
        if name not in FUNCTIONS:
            known, seen = ", ".join(FUNCTIONS), self.text[node.func.col_offset : node.func.end_col_offset]
            hint = f"{suggest(seen, FUNCTIONS)}; known: {known}; a product needs a *"
            raise self.error(node.func.col_offset, f"{seen!r} is not a function{hint}")
        function, count = FUNCTIONS[name]
        if node.keywords:
            raise self.error(node.keywords[0].col_offset, f"{name} takes its arguments as they are, without **")
        if len(node.args) != count:
            wanted = "one argument" if count == 1 else f"{count} arguments"
            raise self.error(node.col_offset, f"{name} takes {wanted}, got {len(node.args)}")
        for argument in node.args:
            self._add(argument, depth + 1)
        self._push("apply", function, count, node.col_offset)

    def _push(self, kind: str, what: Any, arguments: int, column: int) -> None:
        if len(self._steps) == MAX_STEPS:
            rule = f"an expression has at most {MAX_STEPS} numbers, names, operators and calls; simplify it"
            raise self.error(column, rule)
        self._steps.append(_Step(kind, what, arguments))

    def _number(self, value: int | float, column: int) -> float:
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if math.isinf(number):
            raise self.error(column, "a number must be below 1.8e308; write it smaller")
        return number
