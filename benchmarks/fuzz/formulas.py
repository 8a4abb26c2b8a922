"""Effects from lines of mathematics: a line `output=expression` or `name:low,high,start,vanishing` each, in text.

What can be read is tried on a few measurements and used in a model, with its derivatives.
"""

import torch

from contactlearn import laws
from contactlearn.effects.base import OUTPUTS
from contactlearn.effects.formula import formula
from contactlearn.effects.formula.symbols import SYMBOLS
from contactlearn.models.contact_model import ContactModel
from contactlearn.simulation import synthetic
from fuzz.target import Target

DROPS = synthetic.load(size=3)
LAW = laws.find("wang_mason").at(0.2, 0.5)
LINES = (
    "tau=-c*rx*Pn\nc:-1,1",
    "mu=a*(1+exp(-abs(vt)/v))-a*(1+exp(-abs(vt)/v))+k*vt**2\na:0,1\nv:0.1,2,1,null\nk:-1,1",
    "eps=max(min(c*vn, 1), -1)*sign(omega)\nc:0,1",
    "theta=d\nrx=d*cos(theta)\nd:-0.1,0.1",
    "vx_post=-c*vx_post\nomega_post=c*tanh(omega_post)\nc:0,0.5",
    "Pt=k*sqrt(I/m)*log(2)*g*pi\nPn=k\nk:-1,1,0,0",
)


def read(content: bytes) -> None:
    """Make the effect, try it on the measurements, and predict with it."""
    expressions, parameters = {}, {}
    for line in content.decode("utf-8", "replace").split("\n"):
        head, equals, rest = line.partition("=")
        if equals:
            expressions[head] = rest
        elif line:
            name, _, numbers = line.partition(":")
            values = [None if one == "null" else _number(one) for one in numbers.split(",")]
            keys = ("low", "high", "start", "vanishing")
            parameters[name] = values if len(values) == 2 else dict(zip(keys, values, strict=False))
    effect = formula(parameters=parameters, **expressions).prepare(DROPS)
    values = torch.tensor([p.start for p in effect.parameters], dtype=torch.float64, requires_grad=True)
    for at in (values, values.detach() + 0.1):
        predicted = ContactModel(LAW, effects={"mine": effect.at(at)}).predict(DROPS)
    assert predicted.v_post.shape[-2:] == (3, 3)
    str(effect.equation), effect.options


def _number(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


NAMES = [*SYMBOLS, *(name for outputs in OUTPUTS.values() for name in outputs)]
FUNCTIONS = ["sin(", "exp(", "log(", "sqrt(", "abs(", "sign(", "tanh(", "min(", "max(", "tan("]
TARGET = Target(
    read, lambda: [line.encode() for line in LINES],
    words=[
        *dict.fromkeys(NAMES), *FUNCTIONS, "**", "1e308", "9**9**9", "lambda", "__class__", "null", "(((((", "not",
        "if",
    ],
)  # fmt: skip
