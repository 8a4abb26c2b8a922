"""State dependence: a law coefficient, or an outcome, that depends on the state of each trial before impact.

Screening tests what remains against functions of one variable (cosines over its ranks, harmonics of θ, one body against
the others) and against products of two such functions of low order.  In space the orientation has the components of
the body's axes and products of their upward ones; velocities are in world axes, so that a field or a floor that moves
is seen.  Sums over the trials of such a function times a score, or a whitened residual, are converted to −log p, each
alone and all of a variable or pair together.  The largest of all is compared with those under random signs, so that
the level holds for all of them together.

The estimate is a `VaryingCoefficientModel` over the screened variables, each stretched by the order of its strongest
function so that a stripe is as wide as a slope.  Of the sets of variables and their union the best predictor is chosen.
Source: Efron 1969 for the signs; ranks make the test indifferent to the distributions of the variables.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import one_hot

from contactlearn.core.numerics import wrapped
from contactlearn.diagnosis.result.remainder import Coefficient, StateDependence, VariableShare
from contactlearn.diagnosis.sign_flips import gamma_neg_log_p, normal_neg_log_p, random_signs, screened
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.diagnosis.unexplained.remainder import FUNCTION_OF, total_indices, variable_shares
from contactlearn.diagnosis.unexplained.scores import Scores
from contactlearn.diagnosis.unexplained.varying_coefficients import VaryingCoefficientFit, VaryingCoefficientModel
from contactlearn.effects import State
from contactlearn.effects.formula.symbols import of_state
from contactlearn.inference.evaluation.partial_residuals import share_explained
from contactlearn.inference.identification.joint import Fit, FitOptions
from contactlearn.mechanics.bodies import numbered
from contactlearn.mechanics.impacts import Impacts
from contactlearn.mechanics.rigid_body import rotation
from contactlearn.mechanics.space import PLANE, SPACE

ANGLE, BODY, PLACE, ORIENTATION = "theta", "object", "x", "orientation"
_PLACES = (PLACE, "floor_y")
_IN_SPACE = ("vn", "slip", "lever", "spin", "twist", *_PLACES)
_ALONE, _STRIPES = 16, 32  # cosines over a variable alone, over a place in space
_TOGETHER = {**dict.fromkeys((*_PLACES, ANGLE), 8), "vx": 0, ORIENTATION: 0}  # in a product; v_t stands for v_x
_FUNCTIONS_OF_OTHERS = 4  # of all other variables
_BODIES = 10  # at most, that have a function each
_TURNS = 0.05  # standard deviation of every component of the axes of bodies that lie in all directions
_MIN_TRIALS, _BLOCKS = 40, 20  # trials, and blocks of them, below which nothing is tested
_TRIALS = 560  # trials that processes are fitted to and tested on, at most
_MAX_TRIED = 3  # associations, the most significant ones
_UNION = 3  # variables of their union, at most


@dataclass(frozen=True, kw_only=True)
class StateAssociation:
    """A significant association of a coefficient, or of the velocities if it is None, with variables of the state.

    Args:
        coefficient: of the law.
        orders: half periods over the range of each variable, by its symbol; of θ harmonics.
        neg_log_p: of the strongest function.
    """

    coefficient: Coefficient | None
    orders: Mapping[str, int]
    neg_log_p: float


def state_variables(impacts: Impacts) -> dict[str, Float[Tensor, "n c"]]:
    """Compute columns of each variable that varies: (cos θ, sin θ) or axes, each body alone, others standardised."""
    state, bodies = State.of(impacts), numbered(impacts.object)
    names_of = _IN_SPACE if impacts.space is SPACE else ("vn", "vt", "vx", "omega", PLACE)
    known = of_state(state)
    values = {name: known[name] for name in names_of}
    if impacts.space is SPACE:  # stripes are narrower than a body, so the place is that of its contact
        values |= {name: known[name] + impacts.r[:, k] for k, name in enumerate(_PLACES)}
    variables = {
        name: ((value - value.mean()) / value.std())[:, None]
        for name, value in values.items()
        if value.std() > 1e-9 * value.abs().max()
    }
    if impacts.space is PLANE:
        circle = torch.stack((state.theta.cos(), state.theta.sin()), -1)
        if circle.std(0).max() > 1e-9:
            variables[ANGLE] = circle
    elif (axes := rotation(impacts.q[:, 3:]).flatten(1)).std(0).min() > _TURNS:
        variables[ORIENTATION] = axes
    if 1 <= bodies.max() < _BODIES:
        variables[BODY] = one_hot(bodies).to(torch.float64)
    return variables | {
        name: columns if columns.shape[1] > 1 else (columns - columns.mean(0)) / columns.std(0)
        for name, columns in impacts.covariate_columns.items()
    }


def screen_state_associations(
    scores: Scores, among: Mapping[str, Float[Tensor, "n c"]], level: float, block: int = 1
) -> tuple[float, tuple[StateAssociation, ...]]:
    """Compute the p-value of independence, and the associations that refute it at the level, most significant first.

    Residuals of so many neighbouring trials, a `block`, may resemble each other: they have one random sign.
    """
    signs = random_signs(math.ceil(len(scores) / block)).repeat_interleave(block, 1)[:, : len(scores)]
    groups = list(screened_functions(among))
    D = scores.residual.shape[-1]
    alike = torch.eye(D, dtype=torch.float64).expand(len(scores), -1, -1)
    kinds = (*Coefficient, *[None] * D)  # that may depend on the state: coefficients, whitened velocities
    changes, associations, largest = torch.cat((scores.slope, alike), -1), list[StateAssociation](), list[Tensor]()
    functions = torch.cat([columns - columns.mean(0) for _, columns in groups], 1)
    for kind, change in zip(kinds, changes.unbind(-1), strict=True):
        every = signs @ scores.terms(change, functions)
        for (orders, _), sums in zip(groups, every.split([len(orders) for orders, _ in groups], 1), strict=True):
            z = sums / sums.square().mean(0).sqrt().clamp_min(1e-300)
            each, together = normal_neg_log_p(sums), gamma_neg_log_p(z.square().sum(1, keepdim=True))
            largest.append(torch.cat((each, together), 1).nan_to_num(0.0).amax(1))
            strongest = orders[int(each[0].argmax())]
            associations.append(StateAssociation(coefficient=kind, orders=strongest, neg_log_p=largest[-1][0].item()))
    chance, refuting = screened(torch.stack(largest, 1), level)
    return chance, tuple(associations[k] for k in refuting)


def screened_functions(
    among: Mapping[str, Float[Tensor, "n c"]],
) -> Iterator[tuple[list[dict[str, int]], Float[Tensor, "n k"]]]:
    """Groups of functions of a variable, then of two, and the orders of each."""
    stripes = _STRIPES if {*_PLACES} <= {*among} else _ALONE
    ladders = {name: _ladder(name, columns, stripes if name in _PLACES else _ALONE) for name, columns in among.items()}
    for name, (functions, orders) in ladders.items():
        yield [{name: order} for order in orders], functions
    for one, two in combinations((name for name in ladders if _TOGETHER.get(name) != 0), 2):
        (left, first), (right, second) = (_low(name, *ladders[name]) for name in (one, two))
        orders = [{one: a, two: b} for a in first for b in second]
        yield orders, (left[:, :, None] * right[:, None]).flatten(1)


def _ladder(name: str, columns: Float[Tensor, "n c"], most: int) -> tuple[Float[Tensor, "n k"], list[int]]:
    """Functions of a variable and their orders, rising."""
    if columns.shape[1] > 1 and name not in (ANGLE, ORIENTATION):  # indicators of bodies, or of groups
        return columns, [1] * columns.shape[1]
    if name == ANGLE:
        angle, orders = torch.atan2(columns[:, 1], columns[:, 0]), range(1, 1 + _ALONE // 2)
        functions = [f(k * angle) for k in orders for f in (torch.cos, torch.sin)]
        return torch.stack(functions, -1), [k for k in orders for _ in range(2)]
    if name == ORIENTATION:
        rows, columns_of = torch.triu_indices(3, 3)
        up = columns[:, 6:]
        return torch.cat((columns, up[:, rows] * up[:, columns_of]), 1), [1] * 9 + [2] * len(rows)
    orders = range(1, 1 + most)
    _, which, count = columns[:, 0].unique(return_inverse=True, return_counts=True)
    ranks = ((count.cumsum(0) - count / 2) / len(columns)).to(torch.float64)[which]  # between 0 and 1
    return (math.pi * ranks[:, None] * torch.tensor(orders)).cos(), list(orders)


def _low(name: str, functions: Float[Tensor, "n k"], orders: list[int]) -> tuple[Float[Tensor, "n l"], list[int]]:
    """Those of low orders."""
    most = len(orders) if {*orders} == {1} else _TOGETHER.get(name, _FUNCTIONS_OF_OTHERS)  # every body, or group
    return functions[:, :most], orders[:most]


@dataclass(frozen=True, kw_only=True)
class StateDependenceFit:
    """The best varying-coefficient fit to the remainder of a model over the state of the trials.

    Args:
        model: the trials and their folds.
        inputs: variables that vary, by their symbols.
        association: the coefficient and its variables.
        fit: the coefficient as a function of them, with its held-out predictions.
        p_value: of independence, over all associations.
    """

    model: VaryingCoefficientModel
    inputs: Mapping[str, Tensor]
    association: StateAssociation
    fit: VaryingCoefficientFit
    p_value: float


def find_state_dependence(
    impacts: Impacts,
    fit: Fit,
    best: Fit,
    options: FitOptions,
    thresholds: Thresholds = Thresholds(),
    block: int = 1,
) -> StateDependence | None:
    """Find the dependence of a fitted model's remainder on the state of the trials; None without any.

    A dependence that the best-scoring model does not leave is explained by known effects that are too small for a name.

    Args:
        impacts: measurements, in the sequence of their order.
        fit: fit of a law with effects to all of them.
        best: fit of the law and effects with the best score, the same or another one.
        options: options of the fits.
        thresholds: level of the test, and size of a large share.
        block: neighbouring trials whose errors may resemble each other.
    """
    ask = partial(
        fit_state_dependence,
        impacts,
        options=options,
        level=thresholds.dependence_level,
        trials=_TRIALS,
        block=block,
    )
    dependence = ask(fit)
    if dependence is None or dependence.fit.share.mean <= 0:
        return None
    if not torch.equal(best.model.predict(impacts).v_post, fit.model.predict(impacts).v_post):
        rest = ask(best)
        if rest is None or rest.fit.share.mean <= 0:
            return None
    return _described(dependence, thresholds)


def fit_state_dependence(
    impacts: Impacts, fit: Fit, options: FitOptions, level: float, trials: int, block: int = 1
) -> StateDependenceFit | None:
    """Fit the remainder of a model over the state, on so many trials; None where it does not depend on it."""
    if len(impacts) < max(_MIN_TRIALS, _BLOCKS * block):
        return None
    scores = Scores.of_state(impacts, fit, options, block)
    ordered = impacts[scores.rows]
    among = state_variables(ordered)
    if not among:
        return None
    p_value, associations = screen_state_associations(scores, among, level, block)
    if not associations:
        return None
    rows = torch.randperm(len(ordered), generator=torch.Generator().manual_seed(0))[:trials].sort().values
    model = VaryingCoefficientModel.of(ordered, fit, scores, rows)
    inputs = {name: columns[rows] for name, columns in among.items()}
    tried = _tried(associations)
    products = (torch.cat([order * inputs[name] for name, order in a.orders.items()], -1) for a in tried)
    fits = [model.dependent(a.coefficient, product) for a, product in zip(tried, products, strict=True)]
    association, best = max(zip(tried, fits, strict=True), key=lambda pair: pair[1].share.mean)
    return StateDependenceFit(model=model, inputs=inputs, association=association, fit=best, p_value=p_value)


def _described(dependence: StateDependenceFit, thresholds: Thresholds) -> StateDependence:
    """The result, with its variables and with the effect of the model that has it in another form."""
    model, coefficient, share = dependence.model, dependence.association.coefficient, dependence.fit.share
    variables = _variables(dependence, thresholds.minor_share)
    form_of = _same_dependence(model, coefficient, variables)
    return StateDependence(
        coefficient=coefficient,
        variables=variables,
        p_value=dependence.p_value,
        share=share,
        large=form_of is None and share.mean > thresholds.least_gain,
        form_of=form_of,
    )


def _tried(associations: Sequence[StateAssociation]) -> list[StateAssociation]:
    """The first associations of different variables, and for each coefficient of theirs the union of its variables."""
    first: dict[tuple[Coefficient | None, frozenset[str]], StateAssociation] = {}
    for association in associations:
        first.setdefault((association.coefficient, frozenset(association.orders)), association)
    chosen = list(first.values())[:_MAX_TRIED]
    for coefficient in {association.coefficient for association in chosen}:
        union: dict[str, int] = {}
        for association in first.values():
            if association.coefficient is coefficient and len({*union, *association.orders}) <= _UNION:
                union |= {name: max(order, union.get(name, 1)) for name, order in association.orders.items()}
        if all((a.coefficient, a.orders.keys()) != (coefficient, union.keys()) for a in chosen):
            chosen.append(StateAssociation(coefficient=coefficient, orders=union, neg_log_p=associations[0].neg_log_p))
    return chosen


def _same_dependence(
    model: VaryingCoefficientModel,
    coefficient: Coefficient | None,
    variables: Sequence[VariableShare],
) -> str | None:
    """The effect of the model that makes the same coefficient a function of the only variable."""
    state, fitted = State.of(model.impacts), model.fit.model
    values = of_state(state)
    if state.space is PLANE:
        values["theta"] = wrapped(values["theta"])
    if coefficient is None or len(variables) != 1 or variables[0].symbol not in values:
        return None
    x, k = values[variables[0].symbol], tuple(Coefficient).index(coefficient)
    for name, effect in fitted.effects.items():
        if effect.place == "law":
            changed = effect.law(state, *fitted.law.coefficients)[k]
            if share_explained(x, changed.expand(len(x))) > FUNCTION_OF:
                return name
    return None


def _variables(dependence: StateDependenceFit, least: float) -> tuple[VariableShare, ...]:
    """Shares of the variables in the varying part, as it counts in the mass error."""
    groups, at, fit = dict[str, range](), 0, dependence.fit
    for name in dependence.association.orders:
        groups[name] = range(at, at + dependence.inputs[name].shape[1])
        at = groups[name].stop
    index = total_indices(fit.at, fit.x, groups, torch.Generator().manual_seed(0))
    in_mass = dependence.model.impacts.mass_diagonal.mean(0)
    return variable_shares(groups, (index * in_mass).sum(1) if index.shape[1] > 1 else index[:, 0], least)
