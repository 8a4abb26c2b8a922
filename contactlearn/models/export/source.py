"""A law with its effects as one file of NumPy, JAX, PyTorch or C99: one function of an impact, and a self-test.

    text = source.source_code(model, "c", rows=impacts[:10])

The fitted parameters are constants with their standard errors as comments.  Where the contact scatters, a second
function draws its deviations anew for each impact.  Nothing of contactlearn is needed to use the file.  Python
functions take arrays [...], the C functions one impact.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, repeat
from typing import NamedTuple

import torch
from jinja2 import Environment, PackageLoader

from contactlearn.core import __version__
from contactlearn.core.errors import ContactLearnError, DataError, UnknownNameError
from contactlearn.effects import State
from contactlearn.mechanics.bodies import AnyShape
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.space import PLANE, Space
from contactlearn.models.contact_model import ContactModel, actual_coefficients, actual_state, resolve
from contactlearn.models.export.tracing import LEAVES, Program, Tracer

TEMPLATES = Environment(loader=PackageLoader("contactlearn.models.export"), trim_blocks=True, lstrip_blocks=True)
"""Of the exported files."""

_LONGEST = 100  # characters of an expression that is written where its value is used, if that is once
_TRUTH = ("lt", "le", "gt", "ge", "eq", "ne", "and", "or", "not")
_INFIX = {
    "add": "+",
    "sub": "-",
    "mul": "*",
    "div": "/",
    "lt": "<",
    "le": "<=",
    "gt": ">",
    "ge": ">=",
    "eq": "==",
    "ne": "!=",
}


class Constant(NamedTuple):
    """A fitted parameter: name in the file, symbol, value, unit, standard error."""

    name: str
    symbol: str
    value: float
    unit: str
    error: float | None


class Deviation(NamedTuple):
    """A deviation of the contact: name in the file, standard deviation, unit."""

    name: str
    sigma: float
    unit: str


@dataclass(frozen=True, kw_only=True)
class Traced:
    """A model as operations on single numbers; `arguments` end with the `deviations`, if there are any."""

    program: Program
    constants: tuple[Constant, ...]
    arguments: Mapping[str, tuple[str, ...]]
    deviations: tuple[Deviation, ...]


def trace(
    model: ContactModel,
    shape: AnyShape | None = None,
    space: Space = PLANE,
    *,
    coefficients: bool = False,
    scatter: bool = False,
) -> Traced:
    """Record the arithmetic of a law with its effects.

    Args:
        model: without processes, see `without_residual`, and of one value for each parameter.
        shape: of the body, if an effect needs it.
        space: in which bodies move.
        coefficients: whether the results are μ and ε alone, of a body whose contact point is that of its shape.
        scatter: whether deviations of the contact are arguments; else there are none.

    Raises:
        ContactLearnError: a model of another kind, or the shape is not known.
    """
    require_exportable(model, shape)
    constants, components = tuple(_constants(model)), model.scatter.values() if scatter else ()
    deviations = tuple(
        Deviation(
            f"u_{one.name}" + (f"_{space.position[k][-1]}" if one.deviations(space) > 1 else ""), one.sigma, one.unit
        )
        for one in components
        for k in range(one.deviations(space))
    )
    tracer = Tracer()
    names = {
        **{"mass": ("mass",), "inertia": space.inertia, "r": space.position, "pose": space.pose},
        **{"velocity": space.velocity, "order": ("order",), "body": ("body",)},
        **({"deviations": tuple(deviation.name for deviation in deviations)} if deviations else {}),
    }
    example = chain(_EXAMPLE[space.name], repeat(0.0))
    values = dict[str, torch.Tensor]()
    with torch.enable_grad(), tracer:
        given = {
            argument: torch.stack([tracer.value("input", name, next(example)) for name in parts], -1)
            for argument, parts in names.items()
        }
        single = {argument: value[..., 0] for argument, value in given.items()}
        moved = model.at([tracer.value("parameter", one.name, one.value) for one in constants])
        state = State(
            mass=single["mass"],
            inertia=(single if space is PLANE else given)["inertia"],
            r=given["r"],
            q=given["pose"],
            v_pre=given["velocity"],
            order=single["order"],
            shape=shape,
            body=single["body"],
        )
        if coefficients:
            state = actual_state(moved.effects, state.replace(r=state.contact_points(state.orientation)))
            values["mu"], values["eps"] = actual_coefficients(moved.effects, state, *moved.law.coefficients)
        else:
            sizes = [component.deviations(space) for component in components]
            parts = given["deviations"].split(sizes, -1) if deviations else ()
            deviated = [*zip(components, parts, strict=True)]
            found = resolve(moved.law, moved.effects, state, *moved.law.coefficients, deviations=deviated)
            results = *(f"{name}_after" for name in space.velocity), *space.wrench
            values |= zip(results, (*found.v_post.unbind(-1), *found.wrench.unbind(-1)), strict=True)
        program = tracer.finish(values)
    optional = {"order", "body"} - leaves(program)
    arguments = {name: parts for name, parts in names.items() if name not in optional}
    return Traced(program=program, constants=constants, arguments=arguments, deviations=deviations)


_EXAMPLE = {
    "plane": (0.05, 1e-5, 0.01, -0.02, 0.1, 0.02, 0.3, 1.0, -2.0, 5.0, 1.0, 0.0),
    "space": (
        *(0.05, 1e-5, 2e-5, 3e-5, 0.01, 0.005, -0.02, 0.1, 0.2, 0.02, 0.5, 0.4, 0.6, 0.48),
        *(1.0, 0.5, -2.0, 5.0, 1.0, 2.0, 1.0, 0.0),
    ),
}
"""An impact by the name of its space, whose values matter no more than those of any other."""


def require_exportable(model: ContactModel, shape: AnyShape | None) -> None:
    """Refuse a model with processes or of several values, or without the shape that it needs.

    Raises:
        ContactLearnError: with the reason.
    """
    if model.regressor is not None or isinstance(model.base, ContactModel):
        raise ContactLearnError(
            "the model has Gaussian processes, which no such file can hold; --without-residual exports its law and "
            "effects alone"
        )
    sizes = {value.numel() for value in (*model.law.coefficients, *model.values)}
    if sizes != {1}:
        raise ContactLearnError(f"a model of one value for each parameter can be exported, got {max(sizes)} values")
    lacking = [name for name, effect in model.effects.items() if effect.needs_shape]
    if lacking and shape is None:
        raise DataError(
            f"effect {lacking[0]} needs the body's shape, which this run does not state; give its data: data=…"
        )


def without_residual(model: ContactModel) -> ContactModel:
    """Return the law and the effects of a model, without the processes that correct them.

    Raises:
        ContactLearnError: without its processes there is no law, or no μ and ε.
    """
    if model.law_model.base is None or model.law_model.parameters is not None:
        raise ContactLearnError("without its Gaussian processes this model has no law with μ and ε to export")
    under = model.law_model
    return replace(under, noise=None, provenance={})


def _constants(model: ContactModel) -> Iterator[Constant]:
    named = [("MU", "μ", "–"), ("EPS", "ε", "–")]
    named += [
        (f"{key}_{p.name}".upper(), p.symbol, p.unit) for key, one in model.effects.items() for p in one.parameters
    ]
    for (name, symbol, unit), value, error in zip(named, model.values, model.standard_errors(), strict=True):
        yield Constant(name, symbol, value.item(), unit, error)


def source_code(model: ContactModel, to: str, rows: Impacts) -> str:
    """Return the text of the file.

    Args:
        model: see `trace`.
        to: one of `LANGUAGES`.
        rows: impacts of the self-test, whose outcomes are the model's own, with the body's shape if an effect needs it.

    Raises:
        UnknownNameError: no such language.
        ContactLearnError: see `trace`.
    """
    if to not in LANGUAGES:
        raise UnknownNameError("language", to, LANGUAGES)
    rows = rows.replace(covariates={})  # which a state has none of
    traced = trace(model, rows.shape, rows.space, scatter=True)
    generator = torch.Generator().manual_seed(0)
    drawn = [(one, one.draw((len(rows),), rows.space, generator)) for one in model.scatter.values()]
    found = model.outcome(rows, drawn)
    columns = {"mass": rows.mass, "inertia": rows.inertia, "r": rows.r, "pose": rows.q, "velocity": rows.v_pre}
    columns |= {"order": rows.order, "body": rows.body.double()}
    columns |= {"deviations": torch.cat([u for _, u in drawn], -1)} if drawn else {}
    table = torch.cat([columns[name].reshape(len(rows), -1) for name in traced.arguments], 1)
    language = LANGUAGES[to]
    return TEMPLATES.get_template(language.template).render(
        version=__version__,
        equation=str(model).replace("\\", "/").splitlines(),
        module=language.module,
        random=language.random,
        constants=traced.constants,
        deviations=traced.deviations,
        used=leaves(traced.program),
        arguments=traced.arguments,
        statements=list(statements(traced.program, language.spelled)),
        results=[*traced.program.results],
        size=rows.space.D,
        axes=_AXES[rows.space.name],
        described={name: _described(name, parts) for name, parts in traced.arguments.items()},
        rows=list(zip(table.tolist(), torch.cat((found.v_post, found.wrench), 1).tolist(), strict=True)),
    )


def _described(argument: str, parts: tuple[str, ...]) -> str:
    """The meaning of an argument in words, with its components and their units."""
    components = f"({', '.join(parts)})"
    axes = f", about the axes of the body {components}" if parts[1:] else ""
    return {
        "mass": "in kg",
        "inertia": f"about the mass centre in kg m^2{axes}",
        "r": f"from the tracked point to the contact point {components} in m",
        "pose": f"of the tracked point {components} in m" + (", unit quaternion" if parts[3:] else " and rad"),
        "velocity": f"of the tracked point {components} in m/s and rad/s; the contact point approaches the floor",
        "order": "number of impacts of these surfaces so far, and this one",
        "body": "number of the body, zlib.crc32 of its name in Python",
        "deviations": f"of the contact from impact to impact {components}",
    }[argument]


_AXES = {
    "plane": "Axes: x right, y up, theta counter-clockwise.",
    "space": "Axes of the world, z up, also for the spin; quaternions take the body to the world, the scalar first.",
}
"""By the name of a space."""


def leaves(program: Program) -> set[str]:
    """Names of the inputs and parameters on which the results depend."""
    needed = (program.operations[place] for place in required(program))
    return {values[0] for kind, values in needed if kind in ("input", "parameter")}


def required(program: Program) -> list[int]:
    """Return the places of the operations on which the results depend, in order."""
    needed, left = set[int](), [*program.results.values()]
    while left:
        if (place := left.pop()) not in needed:
            needed.add(place)
            kind, operands = program.operations[place]
            left += [] if kind in LEAVES else operands
    return sorted(needed)


class Language(NamedTuple):
    """A template of the file, the spelling of an operation, the module of its functions, its random numbers.

    These are the name of their source, how it is made, and normal deviates of a shape.
    """

    template: str
    spelled: Callable[[str, list[str]], str]
    module: str
    random: tuple[str, str, str]


def statements(program: Program, spelled: Callable[[str, list[str]], str]) -> Iterator[tuple[str, str, bool]]:
    """Yield name, expression and whether it is a truth value, of each value that is used again, or is long."""
    needed = required(program)
    uses = Counter(
        k for place in needed if program.operations[place][0] not in LEAVES for k in program.operations[place][1]
    )
    uses.update(program.results.values())
    text, truth = dict[int, str](), dict[int, bool]()
    for place in needed:
        kind, operands = program.operations[place]
        if kind in LEAVES:
            text[place], truth[place] = (repr(operands[0]) if kind == "constant" else operands[0]), False
            if kind == "constant":
                text[place] = spelled(kind, [text[place]])
            continue
        text[place] = spelled(kind, [text[k] for k in operands])
        truth[place] = kind in _TRUTH or (kind in ("where", "stop") and truth[operands[-1]])
        if (uses[place] > 1 or len(text[place]) > _LONGEST) and text[place] != text[operands[0]]:
            yield (name := f"k{place}"), text[place], truth[place]
            text[place] = name
    for name, place in program.results.items():
        yield name, text[place], False


def _infix(kind: str, operands: list[str], names: Mapping[str, str], prefix: str) -> str:
    """An expression in what Python and C have in common."""
    if kind == "constant":
        return f"({operands[0]})" if operands[0].startswith("-") else operands[0]
    if kind in _INFIX:
        return f"({operands[0]} {_INFIX[kind]} {operands[1]})"
    if kind == "stop":
        return operands[0] if kind not in names else f"{names[kind]}({operands[0]})"
    if kind == "neg":
        return f"(-{operands[0]})"
    return f"{prefix}{names.get(kind, kind)}({', '.join(operands)})"


def _c_expression(kind: str, operands: list[str]) -> str:
    if kind == "constant":
        operands = [{"inf": "INFINITY", "-inf": "-INFINITY", "True": "1", "False": "0"}.get(operands[0], operands[0])]
    if kind == "where":
        return f"({operands[0]} ? {operands[1]} : {operands[2]})"
    if kind in ("and", "or"):
        return f"({operands[0]} {'&&' if kind == 'and' else '||'} {operands[1]})"
    names = {"abs": "fabs", "minimum": "least", "maximum": "greatest", "sign": "sign_of", "not": "!"}
    return _infix(kind, operands, names, "")


def _python_expression(module: str, names: Mapping[str, str], kind: str, operands: list[str]) -> str:
    if kind == "constant":
        operands = [{"inf": f"{module}.inf", "-inf": f"-{module}.inf"}.get(operands[0], operands[0])]
    if kind in ("and", "or"):
        return f"({operands[0]} {'&' if kind == 'and' else '|'} {operands[1]})"
    if kind == "not":
        return f"(~{operands[0]})"
    own = names.get(kind, "")
    return _infix(kind, operands, names, "" if own.startswith("_") else f"{module}.")


def _python(module: str, names: Mapping[str, str], *random: str) -> Language:
    source, made, normal = random
    return Language("module.py.j2", partial(_python_expression, module, names), module, (source, made, normal))


_INVERSE = {"atan2": "arctan2", "atanh": "arctanh"}
_FOR_TENSORS = {name: f"_{name}" for name in ("minimum", "maximum", "hypot", "where")}
LANGUAGES = {
    "numpy": _python("np", _INVERSE, "generator", "np.random.default_rng(seed)", "generator.standard_normal({})"),
    "jax": _python(
        "jnp", _INVERSE | {"stop": "jax.lax.stop_gradient"}, "key", "jax.random.key(seed)", "jax.random.normal(key, {})"
    ),
    "torch": _python(
        "torch",
        _FOR_TENSORS | {"stop": "torch.Tensor.detach"},
        "generator",
        "torch.Generator().manual_seed(seed)",
        "torch.randn({}, generator=generator, dtype=torch.float64)",
    ),
    "c": Language("impact.c.j2", _c_expression, "", ("state", "seed", "")),
}
"""Languages by name."""
