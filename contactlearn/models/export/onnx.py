"""A law with its effects as an ONNX graph in float64, of the operations that its runtime has in this precision.

    inputs     the arguments of `source`, [N, k] each, single numbers as columns [N, 1]
    outputs    velocity_after and wrench [N, D]

Fitted parameters are initialisers by name.  Operations that ONNX Runtime 1.32 lacks in float64, such as atan2, expm1
and sinh, are refused by name.
"""

from importlib import import_module

from contactlearn.core import __version__
from contactlearn.core.errors import ContactLearnError, install_hint
from contactlearn.mechanics.impacts import Impacts
from contactlearn.models.contact_model import ContactModel
from contactlearn.models.export.source import required, trace

_NODES = {
    **{"neg": "Neg", "abs": "Abs", "sign": "Sign", "sqrt": "Sqrt", "exp": "Exp", "log": "Log", "sin": "Sin"},
    **{"cos": "Cos", "tanh": "Tanh", "add": "Add", "sub": "Sub", "mul": "Mul", "div": "Div", "pow": "Pow"},
    **{"minimum": "Min", "maximum": "Max", "lt": "Less", "le": "LessOrEqual", "gt": "Greater", "ge": "GreaterOrEqual"},
    **{"eq": "Equal", "and": "And", "or": "Or", "not": "Not", "where": "Where", "stop": "Identity"},
}
"""Operations of ONNX by those of a `Program`, beside hypot and ne."""
_OPSET, _FORMAT = 20, 10


def graph(model: ContactModel, rows: Impacts) -> bytes:
    """Return the file of a model for the bodies of some impacts.

    Raises:
        ContactLearnError: see `source.trace`; an operation that the runtime lacks, or onnx is not installed.
    """
    try:
        onnx = import_module("onnx")
    except ImportError:
        raise ContactLearnError(f"--to onnx needs the package onnx; install it with: {install_hint('onnx')}") from None
    helper, number = onnx.helper, onnx.TensorProto.DOUBLE
    traced = trace(model, rows.shape, rows.space)
    nodes, known = [], [helper.make_tensor(one.name, number, [1, 1], [one.value]) for one in traced.constants]

    def node(kind: str, *names: str, to: str) -> str:
        nodes.append(helper.make_node(kind, [*names], [to]))
        return to

    for name, parts in traced.arguments.items():
        if len(parts) > 1:
            nodes.append(helper.make_node("Split", [name], [*parts], axis=1, num_outputs=len(parts)))
    names = dict[int, str]()
    for place in required(traced.program):
        kind, operands = traced.program.operations[place]
        to = f"k{place}"
        if kind == "constant":
            sort = onnx.TensorProto.BOOL if isinstance(operands[0], bool) else number
            known.append(helper.make_tensor(to, sort, [1, 1], [operands[0]]))
            names[place] = to
        elif kind in ("input", "parameter"):
            names[place] = operands[0]
        elif kind == "hypot":
            x, y = (node("Mul", names[k], names[k], to=f"{to}_{j}") for j, k in enumerate(operands))
            names[place] = node("Sqrt", node("Add", x, y, to=f"{to}_s"), to=to)
        elif kind == "ne":
            names[place] = node("Not", node("Equal", *(names[k] for k in operands), to=f"{to}_e"), to=to)
        elif kind in _NODES:
            names[place] = node(_NODES[kind], *(names[k] for k in operands), to=to)
        else:
            raise ContactLearnError(f"ONNX Runtime has no {kind} in float64, which this model computes; use --to c")
    node("Sub", "mass", "mass", to="none")  # results may be constants, which get a row for each impact here
    results = [node("Add", names[k], "none", to=name) for name, k in traced.program.results.items()]
    size = rows.space.D
    for name, parts in (("velocity_after", results[:size]), ("wrench", results[size:])):
        nodes.append(helper.make_node("Concat", parts, [name], axis=1))

    def columns(name: str, count: int) -> object:
        return helper.make_tensor_value_info(name, number, ["N", count])

    inputs = [columns(name, len(parts)) for name, parts in traced.arguments.items()]
    outputs = [columns(name, size) for name in ("velocity_after", "wrench")]
    made = helper.make_model(
        helper.make_graph(nodes, "impact", inputs, outputs, known, doc_string=repr(model)),
        opset_imports=[helper.make_opsetid("", _OPSET)], ir_version=_FORMAT,
        producer_name="contactlearn", producer_version=__version__,
    )  # fmt: skip
    onnx.checker.check_model(made)
    return made.SerializeToString()
