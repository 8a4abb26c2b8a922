"""Formulas: what a line of mathematics may say, that it means what it says, and that nothing else gets in."""

import json
import math
import pickle
import random
import re

import pytest
import torch
from omegaconf import OmegaConf
from torch import Tensor

from contactlearn import laws
from contactlearn.core.errors import ContactLearnError, DataError, UnknownNameError
from contactlearn.effects import PLACES, State, catalogue, find_effect
from contactlearn.effects.base import OUTPUTS
from contactlearn.effects.configuration_dependent_restitution import QuadraticLeverRestitution
from contactlearn.effects.formula.effect import WrenchFormula, formula
from contactlearn.effects.formula.expression import CONSTANTS, FUNCTIONS, MAX_DEPTH, MAX_LENGTH, MAX_STEPS, Expression
from contactlearn.effects.formula.symbols import SYMBOLS, at_place, of_state, symbols
from contactlearn.effects.orientation_offset import OrientationOffset
from contactlearn.effects.spin_damping import SpinDampingAfter
from contactlearn.mechanics.impacts import Impacts
from contactlearn.models import checkpoint
from contactlearn.models.contact_model import ContactModel, resolve
from contactlearn.simulation import synthetic

ROUNDING = 1e-12
"""Relative: the same arithmetic in another order."""

DIFFERENCES = 1e-7
"""Relative: central differences with steps of 1e-6 lose half the digits."""

DROPS = synthetic.load(60, seed=5)
LAW = laws.find("wang_mason").at(0.12, 0.55)
C = {"c": [-1, 1]}

BY_PLACE = {
    "state": formula(rx="a*sin(theta)", ry="b*x", theta="d*omega", parameters={k: [-0.1, 0.1] for k in "abd"}),
    "law": formula(mu="c*abs(vt)", eps="-d*(rx/rho)**2", parameters={"c": [-0.3, 0.3], "d": [-0.5, 1]}),
    "wrench": formula(
        Pt="a*mu*Pn*tanh(vt_post)", Pn="-b*eps*Pn", tau="-c*rx*Pn+d*Pn/10", parameters={k: [-0.5, 1] for k in "abcd"}
    ),
    "velocity": formula(vy_post="-c*g", omega_post="-d*omega_post*abs(vn)", parameters={"c": [0, 0.02], "d": [0, 1]}),
}
POINTS = {"state": (0.01, 0.02, 0.001), "law": (0.1, 0.2), "wrench": (0.3, 0.1, 0.2, 0.01), "velocity": (0.004, 0.05)}
PLACE = pytest.mark.parametrize("place", PLACES)


def predict(effect, impacts: Impacts = DROPS) -> Tensor:
    return ContactModel(LAW, effects={"mine": effect}).predict(impacts).v_post


def pointed(text: str) -> tuple[str, str]:
    """The message of a refused expression, and the text from the caret on."""
    with pytest.raises(ContactLearnError) as caught:
        Expression(text)
    message = str(caught.value)
    rule, shown, caret = message.split("\n")
    assert re.fullmatch(" *\\^", caret)
    return rule, shown[len(caret) - 1 :]


X, Y = (torch.linspace(*ends, 7, dtype=torch.float64) for ends in ((-2, 3), (0.5, 4)))
MEANINGS = {
    "x + y*2 - 1": X + Y * 2 - 1,
    "-x**2": -(X**2),
    "y**-2": Y**-2.0,
    "y**x**2": Y ** (X**2),
    "x - y - 1": X - Y - 1,
    "x/y/2": X / Y / 2,
    "-(x + y)*+3e-1": -(X + Y) * 0.3,
    "sin(x) + cos(x)*tan(x)": X.sin() + X.cos() * X.tan(),
    "exp(-y/.5)": (-Y / 0.5).exp(),
    "log(y)*sqrt(y)": Y.log() * Y.sqrt(),
    "abs(x) + sign(x) + tanh(x)": X.abs() + X.sign() + X.tanh(),
    "min(x, y) + max(x, 1.)": torch.minimum(X, Y) + X.clamp_min(1),
    "pi*g*x": math.pi * 9.80665 * X,
    "  ((x)) ": X,
    "x\n+\ty": X + Y,
}


@pytest.mark.parametrize("text", MEANINGS)
def test_expressions_mean_what_they_mean_in_python(text):
    expression = Expression(text)
    assert set(expression.names) <= {"x", "y"}
    value = expression.evaluate({"x": X, "y": Y})
    assert value.dtype == torch.float64
    torch.testing.assert_close(value, MEANINGS[text], rtol=ROUNDING, atol=ROUNDING)
    assert torch.equal(pickle.loads(pickle.dumps(expression)).evaluate({"x": X, "y": Y}), value)


def test_expressions_are_differentiable():
    assert Expression("b*a + sin(b) + pi*c2").names == {"b": 0, "a": 2, "c2": 18}
    x, y = X.clone().requires_grad_(), Y.clone().requires_grad_()
    smooth = Expression("sin(x)*y**2 + exp(-y)*tanh(x) + sqrt(y)*x**3/2 - min(x, y)*max(x, 0.1) + abs(x)")
    assert torch.autograd.gradcheck(lambda x, y: smooth.evaluate({"x": x, "y": y}), (x, y))
    with pytest.raises(ContactLearnError, match=r"unknown symbol 'omga', did you mean 'omega'\?.*\n.*\n {6}\^"):
        Expression("c*omga").evaluate({"c": X, "omega": Y})
    assert Expression("x" * MAX_LENGTH).names
    assert Expression("(" * MAX_DEPTH + "x" + ")" * MAX_DEPTH).names
    assert Expression("-" * (MAX_DEPTH - 1) + "x").names
    terms = "+".join(["(x+x+x+x+x)"] * (MAX_STEPS // 10))
    assert Expression(terms).evaluate({"x": X}).allclose(X * 5 * (MAX_STEPS // 10))


@pytest.mark.parametrize(("text", "value"), [("9**9**9", math.inf), ("1/0", math.inf), ("-1/0", -math.inf)])
def test_numbers_are_float64_at_once(text, value):
    assert Expression(text).evaluate({}).item() == value
    assert Expression("0/0").evaluate({}).isnan()


REFUSED = {  # text: (what the caret is under and what follows, part of the message)
    "attribute": ("x.real", ".real", "'.' is not allowed"),
    "attribute of a number": ("1.real", "real", "without an operator"),
    "attribute in parentheses": ("(x). __class__", ". __class__", "'.'"),
    "dunder": ("__import__('os')", "__import__('os')", "not Python"),
    "underscore": ("1 + _x", "_x", "not Python"),
    "keyword argument": ("sin(x=1)", "=1)", "'='"),
    "double star": ("sin(**x)", "**x)", "without **"),
    "starred": ("sin(*x)", "*x)", "not allowed"),
    "starred alone": ("max(x, *y)", "*y)", "not allowed"),
    "ellipsis": ("...", "...", "'.'"),
    "complex": ("x + 2j", "j", "'j'"),
    "hexadecimal": ("0x1f", "x1f", "'x1f'"),
    "underscored number": ("1_000", "_000", "'_000'"),
    "floor division": ("x // y", "// y", "write /"),
    "power": ("x^2", "^2", "write **"),
    "Greek": ("c*μ*Pn", "μ*Pn", "write mu"),
    "minus sign": ("a − b", "− b", "write -"),
    "superscript": ("ω²", "ω²", "write omega"),
    "mathematical letter": ("c*𝑥 + y", "𝑥 + y", "'𝑥'"),
    "wide letter": ("sin(ｘ)", "ｘ)", "'ｘ'"),
    "Arabic digit": ("c*٣", "٣", "'٣'"),
    "zero byte": ("c\0", "?", r"'\x00'"),
    "escape": ("c*\x1b[2J", "?[2J", r"'\x1b'"),
    "right to left": ("c*\u202ex", "?x", r"'\u202e'"),
    "surrogate": ("c*\ud800", "?", r"'\ud800'"),
    "unknown function": ("c*eval(x)", "eval(x)", "'eval' is not a function"),
    "misspelt function": ("1 + sine(x)", "sine(x)", "did you mean 'sin'"),
    "call of a number": ("1 + 2(x)", "2(x)", "needs a *"),
    "call of a call": ("x + sin(x)(y)", "sin(x)(y)", "'sin(x)' is not a function"),
    "function alone": ("2*sin", "sin", "sin(…)"),
    "too few arguments": ("1 + max(x)", "max(x)", "2 arguments, got 1"),
    "too many arguments": ("sin(x, y)", "sin(x, y)", "one argument, got 2"),
    "comma": ("1,5*x", ",5*x", "write a ."),
    "no arguments": ("x + ()", "()", "not allowed"),
    "product without a sign": ("2x", "x", "write *"),
    "two names": ("a*(x y)", "x y)", "not a complete"),
    "too early an end": ("x +", "", "not a complete"),
    "open": ("2*(x", "(x", "never closed"),
    "closed": ("x) + (y", ") + (y", "unmatched"),
    "two points": ("1.2.3", ".3", "not a complete"),
    "huge number": ("c*1e999", "1e999", "below 1.8e308"),
    "huge integer": ("c + " + "9" * 400, "9" * 40 + "…", "below 1.8e308"),
    "long": ("x" * (MAX_LENGTH + 1), "x", f"{MAX_LENGTH} characters, got 501"),
    "very long": ("9**" * 10**6 + "9", ("**9" * 99)[1:41] + "…", "3000001"),
    "parentheses": ("(" * 240 + "x" + ")" * 240, "(" * 40 + "…", "parentheses deep"),
    "functions": ("sin(" * 80 + "x" + ")" * 80, "(" + ("sin(" * 99)[:39] + "…", "parentheses deep"),
    "signs": ("-" * 499 + "x", "-" * 40 + "…", "operators deep"),
    "powers": ("x**" * 150 + "x", ("x**" * 99)[:40] + "…", "operators deep"),
    "steps": ("+".join(["(x+x+x+x+x+x)"] * 30), "x)+", "at most 200"),
}


@pytest.mark.parametrize(("text", "rest", "fragment"), REFUSED.values(), ids=REFUSED)
def test_anything_else_is_refused_where_it_stands(text, rest, fragment):
    rule, seen = pointed(text)
    assert fragment in rule
    assert seen.startswith(rest) if fragment == "at most 200" else seen == rest


@pytest.mark.parametrize("part", [
    *"[]{}\"':;=#\\<>%@|&~!?$`", "lambda", "for", "if", "and", "or", "not", "await", "yield", "True", "None",
])  # fmt: skip
def test_what_is_python_and_no_mathematics_is_refused_where_it_stands(part):
    rule, seen = pointed(f"x {part} y")
    assert f"'{part}'" in rule or "is not allowed" in rule
    assert seen == f"{part} y"


def test_random_text_is_an_expression_or_refused():
    """No other error and no warning."""
    draw, read = random.Random(0), 0
    tokens = re.findall(r"\S+", "x 2 0.5 1e3 . e + - * / ** ( ) , sin( max( pi if lambda _ 07 : ' = μ")
    for _ in range(5000):
        text = draw.choice(("", " ")).join(draw.choices(tokens, k=draw.randint(1, 9)))
        try:
            expression = Expression(text)
        except ContactLearnError:
            continue
        read += 1
        assert expression.evaluate(dict.fromkeys(expression.names, X)).dtype == torch.float64
    assert read > 200


@pytest.mark.parametrize("text", ["", "  ", None, 2.5, b"x", ["x"]])
def test_only_text_is_an_expression(text):
    with pytest.raises(ContactLearnError, match=r"must be text|must not be empty"):
        Expression(text)


def test_symbols_have_their_named_values():
    state = State.of(DROPS).replace(mu=torch.tensor(0.25).double(), eps=torch.tensor(0.5).double())
    wrench = dict(zip(OUTPUTS["wrench"], DROPS.wrench.unbind(-1), strict=True))
    seen = symbols(state, SYMBOLS, "wrench", wrench)
    assert list(seen) == list(SYMBOLS)
    measured = [DROPS.mass, DROPS.inertia, *DROPS.r.T, *DROPS.q.T, *DROPS.v_pre.T, *DROPS.v_c.T]
    measured += [DROPS.W[:, 0, 0], DROPS.W[:, 0, 1], DROPS.W[:, 1, 1], (DROPS.inertia / DROPS.mass).sqrt(), DROPS.order]
    measured += [torch.tensor(0.25).double(), torch.tensor(0.5).double(), *DROPS.wrench.T, *DROPS.v_post.T]
    measured += [DROPS.v_post[:, 0] - DROPS.r[:, 1] * DROPS.v_post[:, 2]]
    measured += [DROPS.v_post[:, 1] + DROPS.r[:, 0] * DROPS.v_post[:, 2]]
    for (name, value), expected in zip(seen.items(), measured, strict=True):
        torch.testing.assert_close(value, expected.double(), rtol=1e-9, atol=1e-9, msg=name)
    seen = of_state(State.of(DROPS))
    assert list(seen) == at_place("state")
    assert all(value.shape == (60,) and value.dtype == torch.float64 for value in seen.values())
    state = State.of(DROPS)
    with pytest.raises(UnknownNameError, match=r"place law 'omga', did you mean 'omega'"):
        symbols(state, ["omga"], "law")
    with pytest.raises(UnknownNameError, match=r"symbol of the place state 'Pn'"):
        symbols(state, ["Pn"])
    for names in (["mu"], ["vt_post"], ["Pn"]):
        with pytest.raises(ContactLearnError, match="not known yet: give the wrench so far, or a state with mu"):
            symbols(state, names, "wrench")


@PLACE
def test_the_place_follows_from_the_outputs(place):
    assert set(OUTPUTS[place]) <= set(at_place(place))
    for name, symbol in SYMBOLS.items():
        assert all((symbol.letter, symbol.unit, symbol.description))
        assert set(symbol.places) <= set(PLACES)
        assert name not in FUNCTIONS
        assert name not in CONSTANTS
    effect = BY_PLACE[place]
    assert (effect.place, effect.name) == (place, f"{place}_formula")
    assert find_effect(effect.name) is type(effect)
    assert effect.name not in catalogue()
    assert (effect.mirror_symmetric, effect.adds_energy) == (False, True)
    assert effect.needs_shape == (place == "state")
    effect = BY_PLACE[place].prepare(DROPS)
    plain = ContactModel(LAW).predict(DROPS)
    mine = ContactModel(LAW, effects={"mine": effect.vanished()}).predict(DROPS)
    assert torch.equal(mine.wrench, plain.wrench)
    assert torch.equal(mine.v_post, plain.v_post)
    assert not torch.equal(predict(effect.at(POINTS[place])), plain.v_post)
    scales = torch.linspace(-1, 1, 5, dtype=torch.float64)
    points = scales[:, None] * torch.tensor(POINTS[place], dtype=torch.float64)
    together = predict(BY_PLACE[place].at(points[:, None]))
    assert together.shape == (5, 60, 3)
    for one, point in zip(together, points, strict=True):
        torch.testing.assert_close(one, predict(BY_PLACE[place].at(point)), rtol=ROUNDING, atol=ROUNDING)


EQUIVALENTS = {
    "spin_damping": (formula(tau="-c*I*omega_post", parameters=C), SpinDampingAfter(), [0.3]),
    "restitution": (formula(eps="-c*(rx/rho)**2", parameters=C), QuadraticLeverRestitution(), [0.2]),
    "orientation_offset": (formula(theta="c", parameters=C), OrientationOffset(), [0.05]),
}


@pytest.mark.parametrize("name", EQUIVALENTS)
def test_formulas_equal_the_effects_that_they_spell(name):
    mine, theirs, values = EQUIVALENTS[name]
    values = torch.tensor(values, dtype=torch.float64)
    expected = predict(theirs.at(values))
    assert (expected - predict(theirs)).abs().max() > 1e-3
    torch.testing.assert_close(predict(mine.prepare(DROPS).at(values)), expected, rtol=ROUNDING, atol=ROUNDING)


def test_each_output_follows_its_expression():
    state = State.of(DROPS)
    c, mu, eps = torch.tensor([0.1, 0.3, 0.5], dtype=torch.float64)
    mu, eps = BY_PLACE["law"].at([0.1, 0.2]).law(state, mu, eps)
    assert torch.allclose(mu, 0.3 + 0.1 * state.v_t.abs(), rtol=ROUNDING)
    assert torch.allclose(eps, 0.5 - 0.2 * state.r[:, 0] ** 2 * state.mass / state.inertia, rtol=ROUNDING)
    for effect in (formula(rx="c", parameters=C), formula(ry="c*x", parameters=C)):
        moved = effect.at([c]).state(state).r - state.r
        along = [c.expand(60), 0 * c] if "rx" in effect.expressions else [0 * c, c * state.x]
        assert torch.allclose(moved, torch.stack(torch.broadcast_tensors(*along), -1), atol=ROUNDING)
    turned = formula(theta="c", rx="c", parameters=C).at([c]).state(state)
    assert torch.allclose(turned.theta, state.theta + c)
    assert torch.allclose(turned.r[:, 0], state.turned(c).r[:, 0] + c)
    late = BY_PLACE["velocity"].at([0.01, 0.0]).velocity(state, DROPS.v_post)
    assert torch.allclose(late - DROPS.v_post, torch.tensor([0, -0.0980665, 0]).double(), atol=ROUNDING)


@PLACE
def test_gradients_are_those_of_differences(place):
    effect, point = BY_PLACE[place], torch.tensor(POINTS[place], dtype=torch.float64)

    def outcome(x: Tensor) -> Tensor:
        effects = {"mine": effect.at(x[2:])}
        return resolve(LAW, effects, State.of(DROPS), x[0], x[1]).v_post.sum(0)

    x = torch.cat((torch.tensor([0.12, 0.55]).double(), point))
    exact = torch.autograd.functional.jacobian(outcome, x)
    steps = 1e-6 * torch.eye(len(x), dtype=torch.float64)
    numeric = torch.stack([(outcome(x + step) - outcome(x - step)) / 2e-6 for step in steps], -1)
    assert (exact - numeric).abs().max() <= DIFFERENCES * exact.abs().max()
    assert (exact.abs().amax(0) > 0).all()


@PLACE
def test_formulas_survive_pickling_their_own_options_and_a_checkpoint(place, tmp_path):
    effect = BY_PLACE[place].at(POINTS[place])
    again = pickle.loads(pickle.dumps(effect))
    options = json.loads(json.dumps(effect.options))
    assert options == effect.options
    for copy in (again, type(effect)(**options).at(POINTS[place])):
        assert (copy.parameters, copy.equation, copy.options) == (effect.parameters, effect.equation, effect.options)
        assert copy.needs_shape == effect.needs_shape
        assert torch.equal(predict(copy), predict(effect))
    for values in (POINTS[place], torch.tensor(POINTS[place]).double() * torch.tensor([[[1.0]], [[0.5]]]).double()):
        model = ContactModel(LAW, effects={"mine": BY_PLACE[place].at(values)})
        loaded = checkpoint.load(checkpoint.save(model, tmp_path / "model.pt", provenance={}))
        assert str(loaded) == str(model)
        assert torch.equal(loaded.predict(DROPS).v_post, model.predict(DROPS).v_post)
        assert loaded.effects["mine"].parameters == BY_PLACE[place].parameters


def test_parameters_are_as_declared():
    effect = formula(tau="-c*rx*Pn ", Pn="d*Pn", parameters={"c": {"low": 0, "high": 1, "unit": "m"}, "d": [-1, 1]})
    assert effect.equation == "τ ← τ + (-c*rx*Pn), P_n ← P_n + (d*Pn)"
    assert "mine: τ ← τ + (-c*rx*Pn), P_n ← P_n + (d*Pn), c = 0 m, d = 0" in str(
        ContactModel(LAW, effects={"mine": effect})
    )
    assert formula(vx_post="-c*vx_post", parameters=C).equation == "v_x⁺ ← v_x⁺ + (-c*vx_post)"
    given = {"low": -1, "high": 2, "unit": "m", "symbol": "k₁"}
    plain, full, free = formula(
        tau="c*k*p",
        parameters={"c": (-1, 1), "k": given | {"vanishing": 1, "start": 2}, "p": given | {"vanishing": None}},
    ).parameters
    assert (plain.name, plain.symbol, plain.unit) == ("c", "c", "–")
    assert (plain.low, plain.high, plain.vanishing, plain.start) == (-1, 1, 0, 0)
    assert (full.symbol, full.unit, full.low, full.high, full.vanishing, full.start) == ("k₁", "m", -1, 2, 1, 2)
    assert (free.vanishing, free.start) == (None, 0.5)
    lines = ["tau=-c*d*rx*Pn", "parameters.c=[-1,1]", "parameters.d={low: 1, high: 2, unit: m, vanishing: null}"]
    effect = formula(**OmegaConf.from_dotlist(lines))
    assert json.loads(json.dumps(effect.options)) == effect.options
    assert type(effect.expressions["tau"]) is str
    assert [p.vanishing for p in effect.prepare(DROPS).parameters] == [0, None]
    assert pickle.loads(pickle.dumps(effect)).options == effect.options
    with pytest.raises(ContactLearnError, match="has 1 parameters, got 2 values"):
        formula(tau="c*Pn", parameters=C).at([0.1, 0.2])
    with pytest.raises(ContactLearnError, match="must be of the wrench, got mu of the law"):
        WrenchFormula({"mu": "c"}, C)
    first = int((DROPS.r[:, 0] < 0).nonzero()[0]) + 1
    with pytest.raises(ContactLearnError, match=f"value nan on trial '{first}' of"):
        formula(tau="c*sqrt(rx)", parameters=C).prepare(DROPS)
    bare = DROPS.replace(shape=None)
    with pytest.raises(DataError, match="state_formula moves the contact point, so it needs the body's shape"):
        formula(theta="c", parameters=C).prepare(bare)
    formula(rx="c", parameters=C).prepare(bare)


BAD = {
    "no output": ({"parameters": C}, "needs an output"),
    "no parameter": ({"tau": "-rx*Pn"}, "needs a parameter that is fitted"),
    "unknown output": ({"tua": "c", "parameters": C}, r"unknown output of a formula 'tua', did you mean 'tau'"),
    "misspelt parameters": ({"tau": "c", "parameter": C}, "did you mean 'parameters'"),
    "two places": ({"tau": "c", "mu": "c", "parameters": C},
        "must be of one place, got tau of the wrench, mu of the law"),
    "number": ({"tau": 0.1, "parameters": C}, "must be text, got 0.1"),
    "syntax": ({"tau": "c*rx^2", "parameters": C}, r"write \*\*\n    c\*rx\^2\n {8}\^"),
    "unknown symbol": ({"tau": "c*vtt", "parameters": C},
        r"parameter 'vtt', did you mean 'vt'\?.*\n    c\*vtt\n {6}\^"),
    "symbol of another place": ({"mu": "c*Pn", "parameters": C}, r"Pn is known only at wrench.*\n.*\n {6}\^"),
    "state without mu": ({"rx": "c*mu", "parameters": C}, "mu is known only at law, wrench, velocity"),
    "unused": ({"tau": "c*Pn", "parameters": C | {"d": [0, 1]}}, "parameter d is not used in τ ← τ"),
    "name of a symbol": ({"tau": "m*Pn", "parameters": {"m": [0, 1]}}, "name of a symbol, got 'm'"),
    "name of a function": ({"tau": "sin*Pn", "parameters": {"sin": [0, 1]}}, "name of a function"),
    "name of a constant": ({"tau": "g*Pn", "parameters": {"g": [0, 1]}}, "name of a constant"),
    "keyword": ({"tau": "c", "parameters": {"in": [0, 1]}}, "parameter's name is"),
    "Greek": ({"tau": "c", "parameters": {"κ": [0, 1]}}, "parameter's name is"),
    "number as name": ({"tau": "c", "parameters": {1: [0, 1]}}, "parameter's name is"),
    "list of parameters": ({"tau": "c", "parameters": ["c"]}, "needs a parameter"),
    "no range": ({"tau": "c", "parameters": {"c": 1}}, r"must be \[low, high\]"),
    "half a range": ({"tau": "c", "parameters": {"c": {"low": 0, "hihg": 1}}}, r"or have low: and high:"),
    "unknown entry": ({"tau": "c", "parameters": {"c": {"low": 0, "high": 1, "units": "m"}}}, "did you mean 'unit'"),
    "empty range": ({"tau": "c", "parameters": {"c": [1, 1]}}, r"low < high, got \[1, 1\]"),
    "infinite": ({"tau": "c", "parameters": {"c": [0, math.inf]}}, "high of parameter c must be a finite number"),
    "text": ({"tau": "c", "parameters": {"c": ["a", 1]}}, "low of parameter c must be a finite number, got 'a'"),
    "boolean": ({"tau": "c", "parameters": {"c": [False, True]}}, "must be a finite number, got False"),
    "huge": ({"tau": "c", "parameters": {"c": [0, 10**400]}}, "must be a finite number"),
    "outside": ({"tau": "c", "parameters": {"c": [1, 2]}}, r"vanishing in \[1, 2\], got 0; .* vanishing: null"),
    "start": ({"tau": "c", "parameters": {"c": {"low": 0, "high": 1, "start": 2}}}, r"start in \[0, 1\], got 2"),
    "unit": ({"tau": "c", "parameters": {"c": {"low": 0, "high": 1, "unit": 1}}}, "unit of parameter c must be text"),
}  # fmt: skip


@pytest.mark.parametrize(("entries", "message"), BAD.values(), ids=BAD)
def test_formulas_that_make_no_sense_are_refused(entries, message):
    with pytest.raises(ContactLearnError, match=message):
        formula(**entries)


NULL = {"low": 0.0, "high": 1.0, "vanishing": None}
UNFIT = {
    "constant": ({"tau": "rx*Pn + c", "parameters": C},
        r"rx\*Pn \+ c\) must .* at c = 0 it adds up to 0\.\d+ N m s to tau; a fac"),
    "factor": ({"mu": "exp(c*vt)", "parameters": C}, "adds up to 1 – to mu; a factor is missing"),
    "vanishing": ({"mu": "c - 0.5", "parameters": C}, "adds up to 0.5"),
    "nothing vanishes": ({"mu": "p", "parameters": {"p": NULL}}, "p = 0.5"),
    "vanishes at a start": ({"mu": "c + p - 0.5", "parameters": C | {"p": NULL}},
        r"at c = 0, p = 0\.25 .* up to 0\.25"),
    "one output of two": ({"mu": "c", "eps": "0.1 + c", "parameters": C}, "adds up to 0.1 – to eps"),
    "logarithm": ({"tau": "c*log(vn)", "parameters": C},
        r"value nan on trial '1' of synthetic drops .*60 of 60 trials"),
    "division": ({"tau": "1/c", "parameters": C}, "value inf on trial '1'"),
    "slope": ({"tau": "sqrt(c)", "parameters": {"c": [0, 1]}}, "derivative in c inf on trial '1'"),
    "power": ({"tau": "c*abs(vn)**(p*1e6)", "parameters": C | {"p": NULL}}, "value"),
}  # fmt: skip


@pytest.mark.parametrize(("entries", "message"), UNFIT.values(), ids=UNFIT)
def test_formulas_that_do_not_fit_the_measurements_are_refused(entries, message):
    effect = formula(**entries)
    with pytest.raises(ContactLearnError, match=message):
        effect.prepare(DROPS)


@pytest.mark.parametrize("grad", [torch.no_grad, torch.enable_grad])
@PLACE
def test_prepare_gives_the_effect_back(place, grad):
    effect = BY_PLACE[place].at(POINTS[place])
    with grad():
        assert effect.prepare(DROPS) is effect
