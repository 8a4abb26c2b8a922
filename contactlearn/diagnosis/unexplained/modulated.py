"""What the state of each trial explains of a remainder: a coefficient that depends on it.

Variables that the test suspects are the inputs of `learning`, each stretched by the order of its strongest function so
that a stripe is as wide as a slope.  Of the sets of variables and their union the one that predicts most is taken.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import torch
from torch import Tensor

from contactlearn.core.numerics import wrapped
from contactlearn.diagnosis.result.remainder import Coefficient, Modulation, VariableShare
from contactlearn.diagnosis.thresholds import Thresholds
from contactlearn.diagnosis.unexplained.learning import Learning, Learnt
from contactlearn.diagnosis.unexplained.modulation import StateSuspect, state_suspects, state_variables
from contactlearn.diagnosis.unexplained.scores import Scores
from contactlearn.diagnosis.unexplained.sobol import total_indices, variable_shares
from contactlearn.effects import State
from contactlearn.effects.formula.symbols import of_state
from contactlearn.inference.evaluation.partial_residuals import share_explained
from contactlearn.inference.identification.joint import FitOptions, JointFit
from contactlearn.mechanics.impacts import Impacts

_FEWEST, _BLOCKS = 40, 20  # trials, and blocks of them, below which nothing is said
_LEARNT = 560  # trials that are learnt from and held out, at most
_TRIED = 3  # suspects, the most surprising ones
_TOGETHER = 3  # variables of their union, at most


@dataclass(frozen=True, kw_only=True)
class Modulated:
    """What the state of the trials tells of a model's remainder, as processes have learnt it.

    Args:
        learning: the trials.
        inputs: variables that vary, by their symbols.
        suspect: the coefficient and its variables.
        learnt: the held-out prediction with them.
        p_value: of independence, over all suspects.
    """

    learning: Learning
    inputs: Mapping[str, Tensor]
    suspect: StateSuspect
    learnt: Learnt
    p_value: float


def find_modulation(
    impacts: Impacts,
    fit: JointFit,
    best: JointFit,
    options: FitOptions,
    thresholds: Thresholds = Thresholds(),
    block: int = 1,
) -> Modulation | None:
    """Find what the trials' own state tells of a fitted model's remainder; None where it tells nothing.

    A model has its effects for what they are worth.  What one with more of them does not show is explained by known
    effects, too small for a name.

    Args:
        impacts: measurements, in the sequence of their order.
        fit: of a law with effects to all of them.
        best: of the law and effects with the best score, the same or another one.
        options: of the fits.
        thresholds: of the level, and of what is large.
        block: neighbouring trials whose errors may resemble each other.
    """
    ask = partial(modulated, impacts, options=options, level=thresholds.modulation.level, trials=_LEARNT, block=block)
    found = ask(fit)
    if found is None or found.learnt.share.mean <= 0:
        return None
    if not torch.equal(best.model.predict(impacts).v_post, fit.model.predict(impacts).v_post):
        rest = ask(best)
        if rest is None or rest.learnt.share.mean <= 0:
            return None
    return _described(found, thresholds)


def modulated(
    impacts: Impacts, fit: JointFit, options: FitOptions, level: float, trials: int, block: int = 1
) -> Modulated | None:
    """Learn what the state tells of the remainder of a model from so many trials; None where it tells nothing."""
    if len(impacts) < max(_FEWEST, _BLOCKS * block):
        return None
    scores = Scores.of_state(impacts, fit, options, block)
    ordered = impacts[scores.rows]
    among = state_variables(ordered)
    p_value, found = state_suspects(scores, among, level, block)
    if not found:
        return None
    rows = torch.randperm(len(ordered), generator=torch.Generator().manual_seed(0))[:trials].sort().values
    learning = Learning.of(ordered, fit, scores, rows)
    inputs = {name: columns[rows] for name, columns in among.items()}
    tried = [(one, _learnt(learning, one.coefficient, one.orders, inputs)) for one in _tried(found)]
    suspect, learnt = max(tried, key=lambda one: one[1].share.mean)
    return Modulated(learning=learning, inputs=inputs, suspect=suspect, learnt=learnt, p_value=p_value)


def _described(found: Modulated, thresholds: Thresholds) -> Modulation:
    """The result, with its variables and with the effect of the model that has it in another form."""
    learning, coefficient, share = found.learning, found.suspect.coefficient, found.learnt.share
    variables = _variables(
        learning, found.learnt, found.suspect.orders, found.inputs, thresholds.remainder.variable_share
    )
    form_of = _same_dependence(learning, coefficient, variables, thresholds.remainder.follows)
    return Modulation(
        coefficient=coefficient,
        variables=variables,
        p_value=found.p_value,
        share=share,
        large=form_of is None and share.mean > thresholds.modulation.share,
        form_of=form_of,
    )


def _tried(found: Sequence[StateSuspect]) -> list[StateSuspect]:
    """The first suspects of different variables, and for each coefficient of theirs the union of its variables."""
    first: dict[tuple[Coefficient | None, frozenset[str]], StateSuspect] = {}
    for one in found:
        first.setdefault((one.coefficient, frozenset(one.orders)), one)
    chosen = list(first.values())[:_TRIED]
    for coefficient in {one.coefficient for one in chosen}:
        union: dict[str, int] = {}
        for one in first.values():
            if one.coefficient is coefficient and len({*union, *one.orders}) <= _TOGETHER:
                union |= {name: max(order, union.get(name, 1)) for name, order in one.orders.items()}
        if (coefficient, frozenset(union)) not in {(one.coefficient, frozenset(one.orders)) for one in chosen}:
            chosen.append(StateSuspect(coefficient=coefficient, orders=union, surprise=found[0].surprise))
    return chosen


def _learnt(
    learning: Learning, coefficient: Coefficient | None, orders: Mapping[str, int], inputs: Mapping[str, Tensor]
) -> Learnt:
    """Let a coefficient, or the velocities, depend on variables."""
    x = torch.cat([order * inputs[name] for name, order in orders.items()], -1)
    return learning.velocities(x) if coefficient is None else learning.coefficient(coefficient, x)


def _same_dependence(
    learning: Learning, coefficient: Coefficient | None, variables: Sequence[VariableShare], follows: float
) -> str | None:
    """The effect of the model that makes the same coefficient a function of the only variable."""
    state, model = State.of(learning.impacts), learning.fit.model
    values = of_state(state)
    values["theta"] = wrapped(values["theta"])
    if coefficient is None or len(variables) != 1 or variables[0].symbol not in values:
        return None
    x, k = values[variables[0].symbol], tuple(Coefficient).index(coefficient)
    for name, effect in model.effects.items():
        if effect.place == "law":
            changed = effect.law(state, *model.law.coefficients)[k]
            if share_explained(x, changed.expand(len(x))) > follows:
                return name
    return None


def _variables(
    learning: Learning, learnt: Learnt, names: Iterable[str], inputs: Mapping[str, Tensor], least: float
) -> tuple[VariableShare, ...]:
    """Shares of the variables in what was learnt, as it counts in the mass error."""
    groups, at = dict[str, range](), 0
    for name in names:
        groups[name], at = range(at, at + inputs[name].shape[1]), at + inputs[name].shape[1]
    index = total_indices(learnt.at, learnt.x, groups, torch.Generator().manual_seed(0))
    impacts, outputs = learning.impacts, index.shape[1]
    in_mass = torch.stack((impacts.mass, impacts.mass, impacts.inertia), -1).mean(0)
    return variable_shares(groups, (index * in_mass).sum(1) if outputs == 3 else index[:, 0], least)
